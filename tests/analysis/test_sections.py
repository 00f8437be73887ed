"""Forces through cross-sections: of slab profiles and padded regular grids alike, and of a wire the reaction of its
grips."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.errors import AtcError
from atc.units import units
from atc.units.words import in_units

LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"


def wire(seed=0):
    """Open across, periodic along z, and rattled."""
    rng = np.random.default_rng(seed)
    a = np.arange(4) * 3.8
    x = np.stack(np.meshgrid(a, a, np.arange(8) * 3.8, indexing="ij"), -1).reshape(-1, 3)
    x = x + rng.uniform(-0.25, 0.25, x.shape)
    lo, hi = x.min(0), x.max(0)
    cell = atc.Cell(np.diag([*(hi - lo)[:2], 30.4]), [*lo[:2], 0.0], (False, False, True))
    return atc.Frame(x, cell, units("metal"), masses=np.full(len(x), 39.948))


def forces_across(frame, z0, pot):
    """Σ over bonds that cross the plane at z0 (through the periodic face too) of the force of what is above on what is
    below, z component, eV/Å."""
    b = pot.decompose(frame).bonds
    lo = frame.positions[b.i, 2]
    hi = lo - b.r_bc[:, 2]
    total = np.zeros(3)
    for shift in (-30.4, 0.0, 30.4):
        below, above = (lo < z0 + shift) & (hi > z0 + shift), (hi < z0 + shift) & (lo > z0 + shift)
        F = b.forces()
        total += F[below].sum(0) - F[above].sum(0)
    return total


def test_wire():
    f, pot = wire(), atc.potential(LJ, units="metal")
    kern = atc.kernel("quartic", 4.0)
    names = ["stress_potential"]
    slab = atc.fields([f], pot, kern, atc.Grid.slab("z", 16), names, tolerance=1e-12).atc.section_force()
    assert slab.dims == ("frame", "z", "i") and slab.attrs["units"] == "eV/angstrom"
    # a slab's section force is the forces across planes, averaged with the kernel's profile
    marginal = kern.marginal()
    z = slab.z.values[5]
    s = np.linspace(-4.0, 4.0, 801)
    w = marginal.phi(s)
    want = sum(wk * forces_across(f, z + sk, pot) for sk, wk in zip(s, w)) / w.sum()
    assert np.allclose(slab[0, 5].values, want, atol=2e-3 * abs(want).max())
    fine = atc.Grid.regular(spacing=0.5, padding="auto")
    whole = atc.fields([f], pot, kern, fine, names, tolerance=1e-6)
    padded = whole.atc.section_force("z")
    middle = [abs(slab[0] - padded[0].interp(z=slab.z, kwargs={"fill_value": "extrapolate"})).max()][0]
    # quadrature over points 0.5 Å apart, interpolated between layers
    assert middle < 5e-3 * abs(slab).max()
    with pytest.warns(atc.AtcWarning, match="beyond them"):
        bare = atc.fields([f], pot, kern, atc.Grid.regular(spacing=0.5), names, tolerance=1e-6)
    assert abs(bare.atc.section_force("z")[0, :, 2]).mean() < 0.9 * abs(padded[0, :, 2]).mean()
    for units_ in ("GPa, nm", "si"):
        other = in_units(whole, units_).atc.section_force("z")
        assert np.allclose(other, padded, rtol=1e-6) and other.attrs["units"] == "eV/angstrom"


def test_averages_and_parts():
    frames = [argon(seed=k, temperature=90.0) for k in range(3)]
    for f in frames:
        f.masses, f.types = np.full(len(f), 39.948), np.arange(len(f)) % 2 + 1
    pot = atc.potential(LJ, units="metal")
    args = (frames, pot, atc.kernel("quartic", 4.0), atc.Grid.slab("x", 6), ["stress"])
    whole, parts = atc.fields(*args, tolerance=1e-12), atc.fields(*args, by="type", tolerance=1e-12)
    a, b = whole.atc.section_force(), parts.atc.section_force()
    assert b.dims == ("frame", "species", "x", "i")
    assert abs(a - b.sum("species")).max() < 1e-12 * abs(a).max()
    area = 10.0 * 11.0
    bar = 6.241509596477043e-07  # eV/Å³, as LAMMPS has it
    assert np.allclose(a, whole.stress[..., 0, :] * area * bar, rtol=1e-6)


@pytest.mark.parametrize(
    ("grid", "more", "said"),
    [
        (atc.Grid.points([[1.0, 2.0, 55.0]]), {}, "this is a points"),
        (atc.Grid.regular(shape=3), {}, "expected x or y or z"),
        (atc.Grid.regular(shape=3), {"quantity": "density", "axis": "x"}, "is no stress"),
        (atc.Grid.slab("z", 3), {"axis": "x"}, "expected z"),
    ],
)
def test_what_has_no_section(grid, more, said):
    ds = atc.fields([argon(temperature=90.0)], None, atc.kernel("quartic", 4.0), grid, ["stress_kinetic", "density"])
    ds["stress"] = ds["stress_kinetic"]
    with pytest.raises(AtcError, match=said):
        ds.atc.section_force(**more)


def test_net_section_stress():
    """Of a block that fills its cell the stress itself; with a notch, force over what is left; on a profile the same."""
    pot, kern = atc.potential(LJ, units="metal"), atc.kernel("gaussian", width=2.0)
    what = ["stress", "number_density"]
    rng = np.random.default_rng(1)
    a = np.arange(5) * 3.8
    x = np.stack(np.meshgrid(a, a, a, indexing="ij"), -1).reshape(-1, 3)
    x = x + rng.uniform(-0.1, 0.1, x.shape)
    cell = atc.Cell(np.diag([19.0, 19.0, 19.0]))

    def frame(x):
        v = np.zeros(x.shape)
        return atc.Frame(x, cell, units("metal"), masses=np.full(len(x), 39.948), velocities=v)

    full = atc.fields([frame(x)], pot, kern, atc.Grid.regular(shape=(10, 10, 10)), what, tolerance=1e-10)
    bulk = len(x) / 19.0**3
    net = full.atc.section_stress("z", bulk=bulk)
    flat = full.stress.isel(i=2, drop=True).mean(("x", "y")).rename(j="i") / (
        full.number_density.mean(("x", "y")) / bulk
    )
    assert net.dims == ("frame", "z", "i") and net.attrs["units"] == "bar"
    np.testing.assert_allclose(net, flat.transpose(..., "i"), rtol=1e-12)
    assert full.atc.section_stress("z").values == pytest.approx(net.values, rel=0.02)  # bulk found: its median

    cut = frame(x[~((x[:, 0] > 9) & (abs(x[:, 2] - 7.6) < 3))])
    regular = atc.fields([cut], pot, kern, atc.Grid.regular(shape=(10, 10, 10)), what, tolerance=1e-10)
    profile = atc.fields([cut], pot, kern, atc.Grid.slab("z", 10), what, tolerance=1e-10)
    one, other = regular.atc.section_stress("z", bulk=bulk), profile.atc.section_stress(bulk=bulk)
    np.testing.assert_allclose(one.values, other.values, rtol=1e-6, atol=1e-6 * abs(other.values).max())
    force = profile.atc.section_force()
    area = profile.number_density / bulk * 19.0**2
    bar = 6.241509596477043e-07
    np.testing.assert_allclose((other * area * bar).transpose(*force.dims), force, rtol=1e-6)
    assert float(area.min()) < 0.75 * 19.0**2 < 0.9 * float(area.max())
    for words, wrong in (("bulk=", profile), ("no density", profile[["stress", "cell"]])):
        with pytest.raises(AtcError, match=words):
            wrong.atc.section_stress("z")
    with pytest.raises(AtcError, match="positive number"):
        profile.atc.section_stress("z", bulk=0.0)
