"""Every pair style against LAMMPS itself: energy, per-atom energies, forces, the full virial; three kinds of boxes, several types and units."""

import pickle

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps, thermal_lattice

import atc
import atc.decomposers as D
from atc.errors import AtcError
from atc.units import units

# The same arithmetic in another order: sums over ~1e4 terms of both signs. The task asks for 1e-10; what is seen is 1e-13.
RTOL = 1e-10

# Edge lengths in lattice spacings: ordinary, tilted, and so small that a cutoff of 2.4 spacings passes half (and once all) of an edge.
BOXES = {
    "orthogonal": (np.diag([6.0, 5, 5]), (6, 5, 5)),
    "triclinic": (np.array([[6.0, 0, 0], [2.1, 5, 0], [-1.7, 1.3, 5]]), (6, 5, 5)),
    "small": (np.array([[2.0, 0, 0], [0.6, 3, 0], [0.4, -0.5, 3]]), (2, 3, 3)),
}
# Spacing of the lattice in the unit style's length.
SPACING = {"lj": 1.12, "metal": 3.3, "real": 3.3, "electron": 6.2, "si": 3.3e-10, "nano": 0.33}


def config(box, style, kinds=3, charges=True, seed=0, jitter=0.14):
    cell, counts = BOXES[box]
    a = SPACING[style]
    x, t = thermal_lattice(cell * a, counts, jitter=jitter, kinds=kinds, seed=seed)
    t[:kinds] = np.arange(1, kinds + 1)
    rng = np.random.default_rng(seed + 1)
    q = rng.uniform(-1, 1, len(x)) * (units(style).to_user("charge", 1.0) if not units(style).reduced else 1.0) if charges else None
    return Config(cell * a, x, t, units=style, charges=q, ntypes=kinds)


def agree(lines, c, potential=None, threads=1, before=(), rtol=RTOL):
    r = run_lammps(lines, c, before=before)
    pot = atc.potential("\n".join([*before, lines]), units=c.units) if potential is None else potential
    f = c.frame()
    d = pot.decompose(f, threads=threads)
    u = f.units
    force = np.abs(r.forces_nc).max()
    scale = np.abs(r.energies_n).sum()
    assert force > 0 and scale > 0
    assert abs(u.to_user("energy", d.energy) - r.energy) <= rtol * scale
    np.testing.assert_allclose(u.to_user("energy", d.energies_n), r.energies_n, rtol=0, atol=rtol * np.abs(r.energies_n).max())
    np.testing.assert_allclose(u.to_user("force", d.forces_nc), r.forces_nc, rtol=0, atol=rtol * force)
    np.testing.assert_allclose(u.to_user("pressure_volume", d.virial_cc), r.virial, rtol=0, atol=rtol * np.abs(r.virial).max())
    # The streamed sums are those of the bonds that were handed out.
    np.testing.assert_allclose(d.bonds.virial(), d.virial_cc, rtol=0, atol=1e-12 * np.abs(d.virial_cc).max())
    return r, d


# Lines for `metal` or `real`-like lengths in Å, spacing 3.3.
STYLES = {
    "lj/cut": ("metal", "pair_style lj/cut 7.9\npair_coeff * * 0.01 3.0\npair_coeff 1 2 0.02 2.8 6.5\npair_coeff 3 3 0.015 3.3 7.0"),
    "lj/cut mixed": (
        "real",
        "pair_style lj/cut 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.5\npair_coeff 3 3 0.15 3.3 7.0\npair_modify shift yes",
    ),
    "lj/cut arithmetic": (
        "metal",
        "pair_style lj/cut 7.9\npair_modify mix arithmetic\npair_coeff 1 1 0.02 3.0\npair_coeff 2 2 0.01 2.8 6.5\npair_coeff 3 3 0.015 3.3 7.0",
    ),
    "lj/cut sixthpower": (
        "electron",
        "pair_style lj/cut 15\npair_modify mix sixthpower shift yes\npair_coeff 1 1 0.0002 5.6\npair_coeff 2 2 0.0001 5.2 12.5\npair_coeff 3 3 0.00015 5.9 14",
    ),
    "lj/cut reduced": ("lj", "pair_style lj/cut 2.5\npair_coeff * * 1.0 1.0\npair_coeff 2 3* 0.7 1.05"),
    "lj/cut si": ("si", "pair_style lj/cut 7.9e-10\npair_coeff * * 1.6e-21 3.0e-10"),
    "lj/cut nano": ("nano", "pair_style lj/cut 0.79\npair_coeff * * 1.6 0.3"),
    "lj/smooth/linear": (
        "metal",
        "pair_style lj/smooth/linear 7.9\npair_coeff 1 1 0.02 3.0\npair_coeff 2 2 0.01 2.8 6.5\npair_coeff 3 3 0.015 3.3 7.0",
    ),
    "lj/expand": (
        "metal",
        "pair_style lj/expand 7.0\npair_coeff 1 1 0.02 2.6 0.3\npair_coeff 2 2 0.01 2.8 0.1 6.4\npair_coeff 3 3 0.015 3.3 -0.2\npair_modify shift yes mix arithmetic",
    ),
    "morse": ("metal", "pair_style morse 7.9\npair_coeff * * 0.3 1.4 3.1\npair_coeff 1 2 0.2 1.5 3.0 6.1\npair_modify shift yes"),
    "buck": ("metal", "pair_style buck 7.9\npair_coeff * * 800.0 0.35 30.0\npair_coeff 1 3 900.0 0.34 25.0 6.4\npair_modify shift yes"),
    "born": (
        "metal",
        "pair_style born 7.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0\npair_coeff 2 2 0.3 0.35 2.2 20.0 25.0 6.4\npair_modify shift yes",
    ),
    "yukawa": ("lj", "pair_style yukawa 1.7 2.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0\npair_modify shift yes"),
    "soft": ("lj", "pair_style soft 1.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0"),
    "soft sixthpower": (
        "lj",
        "pair_style soft 1.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0\npair_modify mix sixthpower",
    ),
    "coul/cut": ("real", "dielectric 1.7\npair_style coul/cut 7.9\npair_coeff 1 1\npair_coeff 2 2 6.0\npair_coeff 3 3 7.0"),
    "coul/cut electron": ("electron", "pair_style coul/cut 15\npair_coeff * *"),
    "coul/cut lj": ("lj", "pair_style coul/cut 2.6\npair_coeff * *"),
    "coul/dsf": ("metal", "pair_style coul/dsf 0.21 7.9\npair_coeff * *"),
    "coul/wolf": ("real", "pair_style coul/wolf 0.21 7.9\npair_coeff * *"),
    "coul/dsf electron": ("electron", "pair_style coul/dsf 0.1 15\npair_coeff * *"),
    "lj/cut/coul/cut": (
        "real",
        "pair_style lj/cut/coul/cut 6.5 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.0\npair_coeff 3 3 0.15 3.3 7.0 7.5\npair_modify shift yes",
    ),
    "lj/cut/coul/cut one": ("metal", "pair_style lj/cut/coul/cut 7.9\npair_coeff * * 0.01 3.0"),
    "lj/cut/coul/dsf": ("real", "pair_style lj/cut/coul/dsf 0.2 6.5 7.9\npair_coeff * * 0.2 3.0\npair_coeff 1 2 0.2 2.9 6.0"),
    "zbl": ("metal", "pair_style zbl 5.0 7.9\npair_coeff 1 1 14 14\npair_coeff 2 2 6 6\npair_coeff 3 3 29.0 29.0"),
    "zbl real": ("real", "pair_style zbl 5.0 7.9\npair_coeff * * 14 14\npair_coeff 1 2 6 14"),
    "zbl electron": ("electron", "pair_style zbl 9.0 15\npair_coeff * * 14 14"),
    "hybrid": (
        "metal",
        "pair_style hybrid lj/cut 7.9 morse 7.0 lj/cut 6.0\npair_coeff 1 1 lj/cut 1 0.02 3.0\npair_coeff 2 2 lj/cut 1 0.01 2.8\n"
        "pair_coeff 1 3 morse 0.2 1.5 3.0\npair_coeff 2 3 none\npair_coeff 3 3 lj/cut 2 0.02 3.1\npair_modify pair lj/cut 2 shift yes",
    ),
    "hybrid/overlay": (
        "metal",
        "pair_style hybrid/overlay lj/cut 7.9 coul/dsf 0.2 7.0 zbl 3.0 4.0\npair_coeff * * lj/cut 0.02 3.0\npair_coeff * * coul/dsf\n"
        "pair_coeff 1 2* zbl 14 6\npair_coeff 1 1 zbl 14 14\npair_modify shift yes",
    ),
    "hybrid/overlay self energies of some": (
        "metal",
        "pair_style hybrid/overlay lj/cut 7.9 coul/wolf 0.2 7.0\npair_coeff * * lj/cut 0.02 3.0\npair_coeff 1 1*2 coul/wolf\npair_coeff 2 2 coul/wolf",
    ),
    "lj/cut/omp": ("metal", "pair_style lj/cut 7.9\npair_coeff * * 0.01 3.0"),
}


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("style", STYLES)
def test_style(style, box):
    unit, lines = STYLES[style]
    agree(lines, config(box, unit, seed=len(style)), threads=2 if box == "triclinic" else 1)
