"""Slab profiles of means over bins: whole sums are whole, and values are integrals of the profile over the bin."""

import numpy as np
import pytest
from lammps_oracle import lammps_session
from test_deposit_direct import CELLS, KERNELS, METAL, close, sample

import atc
import atc.units
from atc.deposit import make
from atc.frame import Cell
from atc.kernels.binned import SHORT, Binned

FAMILIES = ["quartic", "lucy", "hardy", "table", "gaussian", "step"]


def deposit(bins, axis, kern, cell, x, i, r, a, b, means=True):
    dep = make("direct", atc.Grid.slab(axis, bins, means=means).bind(METAL, cell), kern, cell, a.shape[1], b.shape[1])
    dep.add_sites(x, a)
    dep.add_bonds(x[i], r, b)
    return dep


def mean_of(profile, z, width, n=4001):
    """Over the bin, by midpoints."""
    s = ((np.arange(n) + 0.5) / n - 0.5) * width
    return profile.phi(np.asarray(z)[..., None] + s).mean(-1)


@pytest.mark.parametrize("box", ["orthogonal", "triclinic"])
@pytest.mark.parametrize("kind", FAMILIES)
def test_sums_are_whole(kind, box):
    """Over a periodic cell: atoms are counted, bonds give their virial, whatever the width of bins and kernel."""
    cell = CELLS[box]
    if not cell.periodic[2]:
        cell = Cell(cell.vectors, cell.origin, (True, True, True))
    x, i, r, a, b = sample(cell, 3)
    r = np.concatenate([r, r * [1.0, 1.0, 0.0], r * 1e-5])  # across the bins, and hardly
    i, b = np.tile(i, 3), np.tile(b, (3, 1))
    for scale in (1.0, 1e-3, 40.0):
        kern = KERNELS[kind][0].scaled(scale)
        if scale > 1.0 and kern.support > 30 * cell.heights[2]:
            continue
        for bins in (1, 7, 300):
            dep = deposit(bins, "z", kern, cell, x, i, r, a, b)
            sites, bonds = dep.site_sums().mean(0) * cell.volume, dep.bond_sums().mean(0) * cell.volume
            assert np.abs(sites - a.sum(0)).max() < 1e-13 * np.abs(a).sum(0).max()
            assert np.abs(bonds - b.sum(0)).max() < 1e-13 * np.abs(b).sum(0).max()


@pytest.mark.parametrize("kind", [*FAMILIES, "box", "trilinear", "bspline", "disc"])
def test_integrals_of_the_profile(kind):
    """Against midpoints in the bin and along the bond; the compiled functions and numpy's alike."""
    kern = {
        "box": lambda: atc.kernel("box", size=[2.0, 2.0, 2.0]),
        "trilinear": lambda: atc.kernel("trilinear", size=[2.0, 2.0, 2.0]),
        "bspline": lambda: atc.kernel("bspline", 2.0),
        "disc": lambda: atc.kernel("hardy", 2.0).planar(),
    }.get(kind, lambda: KERNELS[kind][0])()
    normal = (0.0, 1.0, 0.0)
    of = kern.marginal(normal)
    R = min(of.support, 4.0)
    rng = np.random.default_rng(0)
    z = rng.uniform(-1.4, 1.4, 24) * R
    for width in (0.01 * R, 0.4 * R, 3.0 * R):
        binned = Binned(of, width)
        # midpoints: kinks and jumps cost 1/n of the bin
        assert np.allclose(binned.phi(z), mean_of(of, z, width), rtol=0, atol=2e-3 / R)
        # ∫ B over z by its own cumulative
        h = 1e-4 * R
        slope = (binned.cumulative(z + h) - binned.cumulative(z - h)) / (2 * h)
        assert np.allclose(slope, mean_of(binned, z, 2 * h, 201), rtol=0, atol=1e-4 / R)
        assert binned.cumulative(np.array([-9.0, 9.0]) * R).tolist() == pytest.approx([0.0, 1.0], abs=1e-12)
        for r in (0.7 * R, -0.2 * R, 1.01 * SHORT * R, 0.9 * SHORT * R, -0.3 * SHORT * R, 0.0):
            t = (np.arange(2001) + 0.5) / 2001
            want = binned.phi(z[:, None] - t * r).mean(-1)
            found = compiled(binned, z, r)
            assert np.abs(found - want).max() < 2e-6 * max(np.abs(want).max(), 1e-3 / R), (width, r)
            if abs(r) > SHORT * max(R, width):
                assert np.abs(binned.beta(z, r) - found).max() < 1e-9 / R


def compiled(profile, z, r):
    """The compiled mean for each z, in a bin of its own: a slab of one bin in an open cell."""
    from atc.deposit._slab import slab_bonds
    from atc.deposit.direct import _core

    core = _core(slab_bonds, profile.compiled)
    radii, coef = profile.pieces
    out = np.zeros(len(z))
    for k, d in enumerate(z):
        acc = np.zeros(8)
        x = np.array([[0.0, 0.0, 0.5 + d]])
        core(
            x, np.zeros(1, np.int32), np.array([[0.0, 0.0, r]]), np.ones((1, 1)), np.zeros(3),
            np.array([0.0, 0.0, 1.0]), radii, np.ascontiguousarray(coef), 1.0, 1, False, acc, 4,
        )  # fmt: skip
        out[k] = acc[0]
    return out


def test_same_values_at_points_as_before():
    """Means over ever narrower bins are the values at their centres, which are what they were."""
    cell = CELLS["orthogonal"]
    x, i, r, a, b = sample(cell, 4)
    kern = KERNELS["quartic"][0]
    fine = deposit(2000, "x", kern, cell, x, i, r, a, b)
    points = deposit(2000, "x", kern, cell, x, i, r, a, b, means=False)
    assert np.abs(fine.bond_sums() - points.bond_sums()).max() < 1e-4 * np.abs(points.bond_sums()).max()
    assert np.abs(fine.site_sums() - points.site_sums()).max() < 1e-4 * np.abs(points.site_sums()).max()
    # Means over wide bins are those over the narrow ones in them.
    wide = deposit(20, "x", kern, cell, x, i, r, a, b)
    close(wide.bond_sums(), fine.bond_sums().reshape(20, 100, -1).mean(1), 1e-11)


U = atc.units.units("lj")
FLUID = "pair_style lj/cut 2.2\npair_coeff * * 1.0 1.0"


@pytest.fixture(scope="module")
def fluid():
    """A frame of a Lennard-Jones fluid and what LAMMPS's stress/cartesian says of it, in two widths of bins."""
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units lj
            atom_modify map array sort 0 0
            lattice fcc 0.8 origin 0.13 0.17 0.21
            region b block -1 2 -2 2 0 3
            create_box 1 b
            create_atoms 1 box
            mass 1 1.0
            {FLUID}
            velocity all create 3.0 3
            fix 1 all nve
            compute p all stress/cartesian y 0.5 NULL 0
            fix a all ave/time 1 1 1 c_p[*] mode vector
            run 40""")
        box, n = lmp.extract_box(), lmp.get_natoms()
        order = np.argsort(lmp.numpy.extract_atom("id")[:n])
        x, v = (np.array(lmp.numpy.extract_atom(name))[:n][order] for name in "xv")
        table = np.array(lmp.numpy.extract_compute("p", 0, 2))
    lo, hi = np.array(box[0]), np.array(box[1])
    return atc.Frame(x, Cell(np.diag(hi - lo), lo), U, masses=np.ones(n), velocities=v), table


def test_without_a_kernel_as_lammps(fluid):
    """compute stress/cartesian: the fraction of each bond in each bin, atoms counted; pressures where we have
    tensions."""
    frame, table = fluid
    pot = atc.potential(FLUID, units="lj")
    grid = atc.Grid.slab("y", len(table), means=True)
    names = ["stress", "number_density", "virial_stress"]
    ds = atc.fields([frame], pot, None, grid, names, threads=1, velocity="none")
    assert np.allclose(ds.y, table[:, 0]) and np.allclose(ds.number_density[0], table[:, 1], rtol=1e-12)
    for k in range(3):
        for name, at in (("stress_kinetic", 2), ("stress_potential", 5)):
            want = -table[:, at + k]
            assert np.abs(ds[name][0, :, k, k] - want).max() < 1e-11 * np.abs(want).max()
    assert np.allclose(ds.stress_potential.mean("y"), ds.virial_stress_potential, rtol=1e-12)
    # The same scene again from what the output says of itself: no kernel, means.
    assert "[kernel]" not in ds.attrs["scene"] and "means = true" in ds.attrs["scene"]


@pytest.mark.parametrize("name", ["quartic", "gaussian", None])
def test_fields(fluid, name):
    """Atoms are counted, the stress's mean is the virial, energy is energy: to rounding, with all checks on."""
    frame, _ = fluid
    pot = atc.potential(FLUID, units="lj")
    kern = None if name is None else atc.kernel(name, 1.5)
    grid = atc.Grid.slab("z", 9, means=True)
    names = ["stress_potential", "number_density", "energy", "virial_stress", "temperature", "energy_flux"]
    names += ["heat_current"]
    ds = atc.fields([frame], pot, kern, grid, names, threads=1)
    volume = frame.cell.volume
    assert abs(float(ds.number_density.mean()) * volume - len(frame)) < 1e-13 * len(frame)
    want = ds.virial_stress_potential
    assert np.abs(ds.stress_potential.mean("z") - want).max() < 1e-12 * np.abs(want).max()
    d = pot.decompose(frame)
    assert float(ds.energy_potential.mean()) * volume == pytest.approx(d.energy, rel=1e-12)
    assert np.allclose(ds.energy_flux.mean("z") * volume, ds.heat_current, rtol=1e-10)
    assert ds.temperature.min() > 1.0
    # points for comparison: other numbers, which bins do not add up
    if kern is not None:
        at = atc.fields([frame], pot, kern, atc.Grid.slab("z", 9), ["number_density"], threads=1)
        assert np.abs(at.number_density - ds.number_density).max() > 1e-6


def test_open_faces_and_modes():
    """Padded bins of an open cell have all atoms; long-range forces in bins are means of those at points."""
    from frames import argon

    frame = argon("slab", n=(2, 3, 4))
    grid = atc.Grid.slab("z", 11, padding="auto", means=True)
    ds = atc.fields([frame], None, atc.kernel("quartic", 4.0), grid, ["number_density"], threads=1)
    step = float(ds.z[1] - ds.z[0])
    area = frame.cell.volume / frame.cell.heights[2]
    assert float(ds.number_density.sum()) * step * area == pytest.approx(len(frame), rel=1e-13)
    cell = Cell([9.0, 10.0, 11.0])
    charged = argon(cell, n=(2, 3, 3))
    charged = charged.replace(charges=np.resize([0.5, -0.5], len(charged)))
    salt = "pair_style lj/cut/coul/long 4.0\npair_coeff * * 0.0104 3.4\nkspace_style ewald 1e-4"
    pot, kern = atc.potential(salt, units="metal"), atc.kernel("gaussian", width=1.5)
    names = ["stress_potential"]
    bins = atc.fields([charged], pot, kern, atc.Grid.slab("z", 5, means=True), names, tolerance=1e-9, threads=1)
    points = atc.fields([charged], pot, kern, atc.Grid.slab("z", 500), names, tolerance=1e-9, threads=1)
    want = points.stress_potential.values.reshape(5, 100, 3, 3).mean(1)
    assert np.abs(bins.stress_potential[0] - want).max() < 1e-4 * np.abs(want).max()
    with pytest.raises(atc.AtcError, match="belong to no bonds"):
        atc.fields([charged], pot, None, atc.Grid.slab("z", 5, means=True), names, threads=1)
    with pytest.raises(atc.AtcError, match="no gradient|jumps"):
        atc.fields([charged], None, None, atc.Grid.slab("z", 5, means=True), ["velocity_gradient"], threads=1)
