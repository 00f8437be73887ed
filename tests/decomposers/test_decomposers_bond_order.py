"""Tersoff's relatives (tersoff/mod, tersoff/mod/c, tersoff/zbl, gw, gw/zbl) and the shift keyword: LAMMPS, energy
sources, cutoffs, refused input."""

import re

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from many_body_systems import POTENTIALS, TILTS, crystal, lines_of

import atc
from atc.frame import Cell, Frame
from atc.units import units

# Style, file, elements, lattice constants: the crystal, and one so dense that bond orders are in their limits and the
# ZBL core is met.
CASES = [
    ("tersoff shift 0.1", "Si.tersoff", "Si", (5.43,)),
    ("tersoff shift -0.1", "SiC.tersoff", "Si C", (4.6,)),
    ("tersoff/mod", "Si.tersoff.mod", "Si", (5.43, 4.2)),
    ("tersoff/mod shift 0.05", "Si.tersoff.mod", "Si Si", (5.2,)),
    ("tersoff/mod/c", "Si.tersoff.modc", "Si", (5.43, 4.2)),
    ("tersoff/zbl", "SiC.tersoff.zbl", "Si C", (4.36, 2.4)),
    ("tersoff/zbl shift 0.2", "SiC.tersoff.zbl", "C Si C", (2.4,)),
    ("gw", "SiC.gw", "Si C", (4.36, 3.2)),
    ("gw/zbl", "SiC.gw.zbl", "C Si", (4.36, 2.2)),
]
EACH = [(s, f, e, a) for s, f, e, aa in CASES for a in aa]


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("style,file,elements,a", EACH)
def test_agrees_with_lammps(style, file, elements, a, tilt):
    lines = lines_of(style, file, elements)
    config = crystal(a, kinds=len(elements.split()), tilt=tilt)
    agrees_with_lammps(potential(lines, config), lines, config)


@pytest.mark.parametrize(
    "style,file,elements",
    [
        ("tersoff/mod/c", "Si.tersoff.modc", "Si"),
        ("tersoff/zbl", "SiC.tersoff.zbl", "Si C"),
        ("gw/zbl", "SiC.gw.zbl", "Si C"),
    ],
)
def test_real_units(style, file, elements):
    lines = lines_of(style, file, elements)
    config = crystal(3.9, kinds=len(elements.split()), style="real")
    with pytest.warns(atc.errors.AtcWarning, match="converted from metal to real"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)


def edited(tmp_path, file, pattern, by):
    text, count = re.subn(pattern, by, (POTENTIALS / file).read_text())
    assert count
    path = tmp_path / file
    path.write_text(text)
    return path


EDITS = [
    # β of gw, its λ3 with m = 3, η other than 1, β of tersoff/mod = 1 with a large α, a wide soft core that the whole
    # bond feels.
    ("gw", "SiC.gw", r" -1 (0\.[0-9]*) +1 ", r" -0.6 \1 0.5 ", "Si C"),
    ("gw", "SiC.gw", r" 1 (0\.01[0-9]*) 0 ", r" 3 \1 1.1 ", "Si C"),
    ("tersoff/mod", "Si.tersoff.mod", r"2\.3890327  -\.365  1\.0", "6.1 -.3 1.7", "Si"),
    ("gw/zbl", "SiC.gw.zbl", r" \.95 +14", " 1.8 3", "Si C"),
]


@pytest.mark.parametrize("style,file,pattern,by,elements", EDITS)
def test_every_parameter(tmp_path, style, file, pattern, by, elements):
    """Values that the published files do not have."""
    lines = lines_of(style, edited(tmp_path, file, pattern, by), elements)
    config = crystal(4.0, kinds=len(elements.split()))
    agrees_with_lammps(potential(lines, config), lines, config)


def test_hybrid_overlay():
    config = crystal(4.8, kinds=2)
    lines = [
        "pair_style hybrid/overlay tersoff/mod shift 0.05 lj/cut 4.0",
        f"pair_coeff * * tersoff/mod {POTENTIALS}/Si.tersoff.mod Si NULL",
    ]
    lines += ["pair_coeff 1 2 lj/cut 0.01 2.0", "pair_coeff 2 2 lj/cut 0.02 2.1"]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)


@pytest.mark.parametrize("partition", [None, "center"])
@pytest.mark.parametrize(
    "style,file,elements,a",
    [CASES[2][:3] + (5.2,), CASES[4][:3] + (5.0,), CASES[6][:3] + (3.6,), CASES[7][:3] + (4.2,)],
)
def test_sources(style, file, elements, a, partition):
    config = crystal(a, n=(1, 1, 1), kinds=len(elements.split()), jitter=0.2)
    pot = potential(lines_of(style, file, elements), config, partition=partition)
    assert pot.describe().startswith(style.split()[0] + " ")
    sources_are_derivatives(pot, config.frame(), atoms=range(0, 8, 3), tolerance=1e-7)


def test_cutoff_of_murty_is_smooth():
    """f_C of tersoff/mod has two continuous derivatives at R − D and R + D: the force of a dimer has a continuous
    slope."""
    pot = atc.potential(lines_of("tersoff/mod", "Si.tersoff.mod", "Si"), units="metal")

    def force(d):
        frame = Frame(np.array([[0.0, 0, 0], [d, 0, 0]]), Cell(np.eye(3) * 30, periodic=(False,) * 3), units("metal"))
        return pot.decompose(frame).forces_nc[0, 0]

    h = 1e-5
    for edge in (2.7, 3.3):
        left, right = (
            (force(edge - h) - force(edge - 3 * h)) / (2 * h),
            (force(edge + 3 * h) - force(edge + h)) / (2 * h),
        )
        # f_C''' jumps: slopes 4e-5 apart differ by h² times it, some 1e-3 of U'' ~ 10.
        assert abs(left - right) < 5e-2 * max(1.0, abs(left))
    assert force(3.3) == 0.0 and force(3.4) == 0.0


def test_core_ends_with_the_cutoff():
    """A pair within the list of a longer pair but beyond its own R + D has no ZBL energy left over."""
    pot = atc.potential(lines_of("tersoff/zbl", "SiC.tersoff.zbl", "Si C"), units="metal")
    frame = Frame(np.array([[0.0, 0, 0], [2.2, 0, 0]]), Cell(np.eye(3) * 30), units("metal"), types=[2, 2])
    d = pot.decompose(frame)
    assert d.energy == 0.0 and d.n_bonds == 0


DAMAGE = [
    ("tersoff/mod", "Si.tersoff.mod", r"Si  1\.0  2\.389", "Si  2.0  2.389", "Si", "beta must be 1 or 3, got 2"),
    ("tersoff/mod", "Si.tersoff.mod", r"\n +1\.0    1\.345", "\n 2.0 1.345", "Si", "beta_ters must be 1, got 2"),
    ("tersoff/mod", "Si.tersoff.mod", r" 26\.0", "", "Si", "has 19 of 20 words"),
    ("tersoff/mod/c", "Si.tersoff.modc", r" -0\.0059", " x", "Si", "c0 must be a number"),
    ("gw", "SiC.gw", r"0\.78000 1 1\.808", "nan 1 1.808", "Si C", "n must be a finite number"),
    ("tersoff/zbl", "SiC.tersoff.zbl", r"1\.8308e3", "1e300", "Si C", "A must be a finite number below"),
    ("gw", "SiC.gw", r"0\.78000 1 1\.808", "0.78 0 1.808", "Si C", "beta must be positive"),
    ("tersoff/zbl", "SiC.tersoff.zbl", r"14\t6\t\.95\t14", "14 7 .95 14", "Si C", "different c0 or ZBL numbers"),
]


@pytest.mark.parametrize("style,file,pattern,by,elements,message", DAMAGE)
def test_damaged_files(tmp_path, style, file, pattern, by, elements, message):
    path = edited(tmp_path, file, pattern, by)
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of(style, path, elements), units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)


REFUSED = [
    ("pair_style tersoff/mod shift x\npair_coeff * * {}/Si.tersoff.mod Si", "metal", "expected a number for shift"),
    ("pair_style gw 3\npair_coeff * * {}/SiC.gw Si", "metal", "expected nothing or shift"),
    ("pair_style tersoff/table\npair_coeff * * {}/Si.tersoff Si", "metal", "tersoff/table"),
    ("pair_style gw/zbl\npair_coeff * * {}/SiC.gw.zbl Si", "si", "only metal and real"),
]


@pytest.mark.parametrize("lines,style,message", REFUSED)
def test_refused(lines, style, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines.format(POTENTIALS), units=style)
    assert "\n" not in str(e.value)
