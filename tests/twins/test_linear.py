"""Springs of a crystal on nodes: on the atoms they are molecular dynamics for small motions, on coarser nodes they carry
its long waves; kernels that nodes sample too coarsely are refused."""

import numpy as np
import pytest
from crystals import constants, crystal, elastic, model

from atc import pd
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.twins.body import body_of_atoms
from atc.twins.linear import LatticeSprings, linear, wave_constants
from atc.upscaling.fitting import fit_kernel
from atc.upscaling.node_kernel import condensed, node_kernel


def supercell(name, repeat=(3, 3, 3)):
    """Conventional cubes of a crystal as a frame."""
    c = crystal(name)
    A = c.conventional
    n = np.array(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij")).reshape(3, -1).T
    x = ((n @ c.vectors)[:, None] + c.positions).reshape(-1, 3)
    s = x @ np.linalg.inv(A)
    inside = ((s > -1e-6) & (s < 1 - 1e-6)).all(axis=1)
    cells = np.array(np.meshgrid(*[np.arange(r) for r in repeat], indexing="ij")).reshape(3, -1).T
    X = ((cells @ A)[:, None] + x[inside]).reshape(-1, 3)
    return Frame(X, Cell(A * np.array(repeat)[:, None]), c.units, masses=np.full(len(X), c.masses[0]), source=name)


def twin_of_atoms(name, **options):
    frame = supercell(name)
    fc = constants(name)
    made = body_of_atoms(frame, crystal(name).density, 1.02 * np.linalg.norm(fc.r_bc, axis=1).max())
    return frame, made.body, linear(crystal(name), model(name), np.eye(3), made, True)


def test_on_the_atoms_it_is_the_harmonic_crystal():
    """A thousand steps beside velocity Verlet with the force constants as one matrix: 1e-10 of the amplitude."""
    frame, body, twin = twin_of_atoms("argon")
    fc, X, n = constants("argon"), frame.positions, len(frame)
    K = np.zeros((n, 3, n, 3))
    for a in range(n):
        s = (X[a] + fc.r_bc[:, None] - X) @ frame.cell.inverse
        to = np.argmin(np.abs(s - np.rint(s)).max(axis=2), axis=1)
        np.add.at(K, (a, slice(None), to), fc.phi_bcc)
        K[a, :, a] -= fc.phi_bcc.sum(axis=0)
    K = K.reshape(3 * n, 3 * n)
    u = 1e-3 * np.random.default_rng(3).normal(size=(n, 3))
    u -= u.mean(axis=0)
    sim = pd.Simulation(body, twin.material, displacements=u, safety=0.5)
    dt, m = sim.dt, frame.masses[0]
    x, v = u.ravel().copy(), np.zeros(3 * n)
    f = -K @ x
    for _ in range(1000):
        v += 0.5 * dt / m * f
        x += dt * v
        f = -K @ x
        v += 0.5 * dt / m * f
    sim.step(1000)
    assert np.abs(sim.state.u_nc.ravel() - x).max() < 1e-10 * np.abs(u).max()


def test_a_basis_has_no_springs_between_its_atoms():
    with pytest.raises(AtcError, match="crystals of one atom a cell"):
        LatticeSprings(constants("silicon"))


def test_the_difference_from_the_potential_is_of_second_order():
    """Forces under the potential itself against those of the twin, at two amplitudes."""
    frame, body, twin = twin_of_atoms("argon")
    u = np.random.default_rng(4).normal(size=(len(frame), 3))
    off = []
    for size in (2e-4, 1e-4):
        sim = pd.Simulation(body, twin.material, displacements=size * u)
        f = model("argon").stream(frame.replace(positions=frame.positions + size * u), forces=True).forces_nc
        off.append(np.abs(sim.forces() - f).max() / np.abs(f).max())
    assert off[1] < 2e-3 and 1.6 < off[0] / off[1] < 2.4


@pytest.mark.parametrize("name, factor", [("silicon", 2.0)])
def test_coarse_nodes_carry_the_crystals_waves(name, factor):
    step = factor * crystal(name).conventional
    step[1] *= 1.1  # nodes need not lie on a cube
    kernel = node_kernel(constants(name), elastic(name), step, 3.015 * 1.1 * np.linalg.norm(step[0]))
    assert wave_constants(kernel) == pytest.approx(elastic(name).C_vv, rel=1e-9, abs=1e-9 * elastic(name).C_vv.max())
    assert 0 < kernel.least <= 1.0
    assert kernel.error_f[0] < 0.02 and kernel.error_f[1] < 0.07 and kernel.error_f[2] < 0.16
    k = np.random.default_rng(0).normal(size=(40, 3))
    k *= 0.1 * np.pi / step.max() / np.linalg.norm(k, axis=1)[:, None]
    a, b = (np.linalg.eigvalsh(f(k)) for f in (kernel.dynamical_matrix, lambda k: condensed(constants(name), k)))
    assert a == pytest.approx(b, rel=0.04)


def test_a_standing_wave_has_the_crystals_frequency():
    """In the engine: half a period turns the wave over."""
    name, n = "argon", 12
    step = crystal(name).conventional
    a = step[0, 0]
    kernel = node_kernel(constants(name), elastic(name), step, 3.015 * a)
    X = np.array(np.meshgrid(np.arange(n), np.arange(4), np.arange(4), indexing="ij")).reshape(3, -1).T @ step
    body = pd.Body(X, a**3, crystal(name).density, 3.015 * a, cell=Cell(step * np.array([[n], [4], [4]])), warn=False)
    k = 2 * np.pi / (n * a)
    u = 1e-3 * np.cos(k * X[:, [0]]) * [0, 1.0, 0]
    omega = np.sqrt(np.linalg.eigvalsh(constants(name).dynamical_matrix(np.array([[k, 0, 0]])))[0, 0])
    steps = 400
    sim = pd.Simulation(body, pd.Linear(kernel), displacements=u, dt=np.pi / omega / steps)
    sim.step(steps)
    assert sim.state.u_nc == pytest.approx(-u, abs=2e-2 * 1e-3)


def test_kernels_sampled_too_coarsely_are_refused_by_the_engine():
    """Few nodes within the horizon of a kernel that was fitted as an integral."""
    kernel = fit_kernel(constants("argon"), "isotropic", horizon=8.0, knots=6)
    a, n = 8.0 / 1.2, 4
    X = np.array(np.meshgrid(*[np.arange(n)] * 3, indexing="ij")).reshape(3, -1).T * a
    body = pd.Body(X, a**3, crystal("argon").density, kernel.horizon, cell=Cell(np.eye(3) * n * a), warn=False)
    with pytest.raises(AtcError, match="sample the kernel too coarsely"):
        pd.Simulation(body, pd.Linear(kernel))


def test_atoms_off_their_places_are_named():
    frame = supercell("argon")
    x = np.array(frame.positions)
    x[7] += 1.5
    made = body_of_atoms(frame.replace(positions=x), crystal("argon").density, 8.7)
    with pytest.raises(AtcError, match="atom 8 of the reference is not at a place of the crystal"):
        LatticeSprings(constants("argon")).springs(made.body)


def test_atoms_of_a_compressed_run_are_nodes():
    """Their mass is the run's, and their volumes are those of the crystal at rest, more than the cell has."""
    c = crystal("argon")
    frame = c.strained(-0.02 * np.eye(3)).supercell((5, 5, 5))[0]
    body = body_of_atoms(frame, c.density, 8.7).body
    assert body.V_n.sum() == pytest.approx(frame.cell.volume / 0.98**3, rel=1e-12)
    assert (body.rho_n * body.V_n).sum() == pytest.approx(frame.masses.sum(), rel=1e-12)
