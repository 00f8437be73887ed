"""A peridynamic state through the estimators of atoms: what is uniform comes out uniform, forces are divergences,
whatever the material and dimension."""

import numpy as np
import pytest
from naive_fields import site_sum

import atc
from atc import pd
from atc.cases.run import nodal_stress
from atc.errors import AtcError
from atc.frame import Cell
from atc.pd.materials import MATERIALS

LS, W, WN, NODAL = (
    f"peridynamic_stress{v}" for v in ("", "_weighted_virial", "_weighted_virial_normalised", "_nodal_virial")
)
E = np.array([[1.0, 0.3, 0.2], [0.3, -0.25, 0.1], [0.2, 0.1, 0.5]]) * 1e-5


def block(dimension):
    half = 7.0 if dimension == 3 else 12.0
    flat = [half if k < dimension else 0.0 for k in range(3)]
    return pd.Body.lattice(
        pd.Box([-f for f in flat], flat), 1.0, 3.015, 2.0, dimension=dimension, thickness=0.7 if dimension < 3 else None
    )


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("name", MATERIALS)
def test_uniform_strain(name, dimension):
    """In the middle of a uniformly strained block every stress is that of its bonds, density and energy density those
    of the body."""
    try:
        material = MATERIALS[name](1.0, 0.6)
        body = block(dimension)
        strain = E.copy()
        strain[dimension:] = strain[:, dimension:] = 0.0
        sim = pd.Simulation(body, material, displacements=body.X_nc @ strain, velocities=np.array([0.1, 0.0, 0.0]))
    except AtcError as e:
        pytest.skip(f"{name} in {dimension} dimensions: {e}")
    frame, bonds = pd.snapshot(sim, units="lj")
    middle = int(np.argmin((body.X_nc**2).sum(1)))
    points = np.zeros((5, 3))
    points[:, :dimension] = np.random.default_rng(0).uniform(-0.5, 0.5, (5, dimension))
    # at w = 0.85 spacings a Gaussian sums a unit lattice to exp(-2 pi^2 w^2) = 6e-7
    kern = atc.kernel("gaussian", width=0.85)
    ds = atc.fields(frame, bonds, kern, atc.Grid.points(points), ["density", "velocity", "energy_potential", LS, NODAL])
    f = sim.bond_forces()
    mine = (f.i == middle).astype(float) + (f.j == middle)
    virial = -0.5 * np.einsum("b,bi,bk->ik", mine, f.r_bc, f.F_bc) / body.V_n[middle]
    # The kernel reaches beyond the nodes whose families are whole only in its tail; positions differ from the lattice
    # by the strain.
    np.testing.assert_allclose(ds[LS][0], np.broadcast_to(virial, (5, 3, 3)), rtol=0, atol=1e-4 * np.abs(virial).max())
    np.testing.assert_allclose(ds.density[0], 2.0, rtol=1e-4)
    np.testing.assert_allclose(ds.velocity[0], np.broadcast_to([0.1, 0, 0], (5, 3)), atol=1e-12)
    np.testing.assert_allclose(ds.energy_potential[0], sim.strain_energy_n()[middle] / body.V_n[middle], rtol=1e-3)
    np.testing.assert_allclose(ds[NODAL][0, middle], virial, rtol=0, atol=1e-12 * np.abs(virial).max())
    np.testing.assert_allclose(nodal_stress(sim)[middle], virial, rtol=0, atol=1e-12 * np.abs(virial).max())


@pytest.mark.parametrize("name", MATERIALS)
def test_divergence_is_the_force_density(name):
    """For a random displacement of a small body, by differences of the field; with reference positions too."""
    material = MATERIALS[name](1.0, 0.6)
    body = pd.Body.lattice(pd.Box([0, 0, 0], [4, 3, 3]), 1.0, 2.015, 1.0, jitter=0.1, seed=4)
    u = np.random.default_rng(5).uniform(-0.15, 0.15, body.X_nc.shape)
    sim = pd.Simulation(body, material, displacements=u)
    frame, bonds = pd.snapshot(sim, units="lj")
    reference = pd.reference_frame(sim, units="lj")
    kern = atc.kernel("gaussian", width=0.9)
    h = 0.09
    c = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260]) / h
    centre = np.array([[1.3, 1.4, 1.6], [3.0, 0.2, 2.2]])
    points = np.array([p + s * k * h * e for p in centre for e in np.eye(3) for k in range(1, 6) for s in (1, -1)])
    ds = atc.fields(
        frame,
        bonds,
        kern,
        atc.Grid.points(points),
        [LS, "peridynamic_piola_stress"],
        tolerance=1e-12,
        reference=reference,
    )
    for field, x in ((LS, frame.positions), ("peridynamic_piola_stress", reference.positions)):
        s = ds[field].values.reshape(2, 3, 5, 2, 3, 3)
        divergence = np.einsum("k,pmkmn->pn", c, s[:, :, :, 0] - s[:, :, :, 1])
        want = site_sum(centre, x, sim.forces(), kern, Cell(20 * np.eye(3), periodic=[False] * 3))
        np.testing.assert_allclose(divergence, want, rtol=0, atol=1e-8 * np.abs(want).max(), err_msg=field)
    assert not np.allclose(ds[LS], ds["peridynamic_piola_stress"])
    got = bonds.stream(frame, forces=True).forces_nc
    np.testing.assert_allclose(got, sim.forces(), rtol=0, atol=1e-12 * np.abs(got).max())


def test_weighted_virial_in_the_plane_ignores_the_layers():
    """In two dimensions the body is repeated along z for the smoothed fields; the weighted virial sees it once,
    whatever the layer."""
    body = block(2)
    sim = pd.Simulation(body, pd.PMB(bulk=1.0), displacements=body.X_nc @ np.diag([1e-5, 0, 0]))
    points = np.random.default_rng(1).uniform(-2, 2, (6, 3)) * [1, 1, 0]
    found = []
    for layer in (0.25, 0.1):
        frame, bonds = pd.snapshot(sim, units="lj", layer=layer)
        found.append(atc.fields(frame, bonds, grid=atc.Grid.points(points), quantities=[W, WN]))
    for q in (W, WN):
        np.testing.assert_allclose(found[0][q], found[1][q], rtol=0, atol=1e-12 * float(abs(found[0][q]).max()))
    lam, mu = sim.materials[1].lame(body)
    assert 0.15 < float(found[0][W][0, :, 0, 0].mean()) / ((lam + 2 * mu) * 1e-5) < 0.3


def test_snapshot_in_si_has_si_units():
    body = pd.Body.lattice(pd.Box([0, 0, 0], [0.01, 0.01, 0.01]), 1e-3, 3.01e-3, 2440.0)
    sim = pd.Simulation(body, pd.PMB(bulk=5e10), displacements=1e-4 * body.X_nc, velocities=np.array([0.0, 3.0, 0.0]))
    frame, bonds = pd.snapshot(sim)
    ds = atc.fields(
        frame,
        bonds,
        atc.kernel("quartic", 0.003),
        atc.Grid.points([[0.005] * 3]),
        ["density", "velocity", LS, "displacement"],
        reference=pd.reference_frame(sim),
    )
    assert ds[LS].attrs["units"] == "Pa" and ds.density.attrs["units"] == "kg/m^3"
    # K e 3 of a lattice with 3 spacings: 0.87 of it
    assert 0.8 < float(ds[LS][0, 0, 0, 0]) / (3 * 5e10 * 1e-4) < 0.95
    np.testing.assert_allclose(ds.displacement[0, 0], 5e-7, rtol=2e-2)
    np.testing.assert_allclose(ds.velocity[0, 0], [0, 3, 0], atol=1e-9)


def test_snapshots_are_of_one_moment():
    body = block(2)
    sim = pd.Simulation(body, pd.PMB(bulk=1.0), velocities=1e-3 * body.X_nc)
    frame, bonds = pd.snapshot(sim, units="lj")
    sim.step(2)
    later, _ = pd.snapshot(sim, units="lj")
    with pytest.raises(AtcError, match="belong to step 0"):
        atc.fields(later, bonds, atc.kernel("quartic", 3.0), atc.Grid.points([[0, 0, 0]]), [LS])
    with pytest.raises(AtcError, match="gone on to step 2"):
        atc.fields(frame, bonds, atc.kernel("quartic", 3.0), atc.Grid.points([[0, 0, 0]]), ["energy_potential"])
    with pytest.raises(AtcError, match="layer must be"):
        pd.snapshot(sim, layer=-1)


@pytest.mark.parametrize("units", ["si", "lj", "metal", "real", "nano"])
def test_a_strained_cell_is_the_snapshots_cell(units):
    """Density ρ0/J and the virial of the deformed box, in every style: moduli are energy/length³ of it."""
    H = np.array([[0.2, 0.05, 0.0], [0.0, -0.03, 0.0], [0.0, 0.0, 0.1]])
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (7, 7, 7)), 1.0, 3.015, 2.0, cell=Cell([8.0, 8, 8]), warn=False
    )  # fmt: skip
    sim = pd.Simulation(body, pd.LPS(1.0, 0.6), strain=H)
    frame, bonds = pd.snapshot(sim, units=units)
    J = np.linalg.det(np.eye(3) + H)
    u = frame.units
    assert frame.cell.volume == pytest.approx(512 * J * u.factor("length") ** 3, rel=1e-12)
    mass = u.factor("energy") * (u.factor("time") / u.factor("length")) ** 2
    assert frame.masses.sum() / frame.cell.volume == pytest.approx(2.0 * mass / J / u.factor("length") ** 3, rel=1e-12)
    f = sim.bond_forces()
    box = -np.einsum("bi,bj->ij", f.r_bc, f.F_bc) / (512 * J) * u.factor("energy") / u.factor("length") ** 3
    virial = bonds.stream(frame, energies=True)
    np.testing.assert_allclose(virial.virial_cc / frame.cell.volume, box, rtol=1e-12, atol=1e-12 * np.abs(box).max())
    assert virial.energy == pytest.approx(sim.energies().strain * u.factor("energy"), rel=1e-12)
    # through the estimators, at points anywhere: a uniform body at w = 0.85 spacings
    ds = atc.fields(
        frame, bonds, atc.kernel("gaussian", width=1.2), atc.Grid.regular(shape=(3, 3, 3)), ["density", LS]
    )  # fmt: skip
    scale = u.to_user("pressure", np.abs(box).max())
    np.testing.assert_allclose(
        ds[LS][0], np.broadcast_to(u.to_user("pressure", box), (3, 3, 3, 3, 3)), atol=1e-3 * scale
    )
    assert float(ds.density[0].std() / ds.density[0].mean()) < 1e-3
    # the undeformed body is what it was
    assert pd.reference_frame(sim, units).cell.volume == pytest.approx(512 * u.factor("length") ** 3, rel=1e-12)
