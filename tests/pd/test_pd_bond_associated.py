"""Bond-associated correspondence: exact in homogeneous strain, no zero-energy modes, and what plain numpy makes of it."""

import numpy as np
import pytest

from atc import pd
from atc.errors import AtcError
from atc.frame import Cell

K, G = 1.3, 0.5


def block(counts=(6, 5, 5), horizon=2.01, **options):
    return pd.Body.lattice(pd.Box((0, 0, 0), np.array(counts) - 0.9), 1.0, horizon, 2.0, **options)


def energy_by_hand(body, material, u, intact):
    """U_n by the definition, one bond after the other."""
    lam, mu = material.lame(body)
    t, d = body.bonds, body.dimension
    V, xi, W = body.V_n, t.xi_bc(body.X_nc), body.V_n[t.i_b] * body.V_n[t.j_b] * body.nu_b()
    out = np.zeros(len(body))
    for n in range(len(body)):
        mine = np.flatnonzero(((t.i_b == n) | (t.j_b == n)) & intact)
        x = np.where((t.i_b[mine] == n)[:, None], xi[mine], -xi[mine])
        other = np.where(t.i_b[mine] == n, t.j_b[mine], t.i_b[mine])
        y = x + u[other] - u[n]
        for k in range(len(mine)):
            family = np.linalg.norm(x - x[k], axis=1) <= body.horizon
            w, a, b = W[mine][family], x[family], y[family]
            F = np.eye(3)
            F[:, :d] = (np.einsum("b,bi,bj->ij", w, b, a)[:, :d]) @ np.linalg.inv(
                np.einsum("b,bi,bj->ij", w, a, a)[:d, :d]
            )
            E = 0.5 * (F.T @ F - np.eye(3))
            out[n] += W[mine[k]] / W[mine].sum() * V[n] * (0.5 * lam * np.trace(E) ** 2 + mu * (E * E).sum())
    return out


def test_energy_is_that_of_the_definition_and_forces_are_its_derivative():
    body = block((4, 4, 3), jitter=0.1)
    material, rng = pd.BondAssociated(K, G), np.random.default_rng(1)
    u = rng.uniform(-0.05, 0.05, body.X_nc.shape)
    state = pd.State.rest(body)
    state.intact_b[rng.choice(len(body.bonds), 12, replace=False)] = 0
    state.u_nc[:] = u
    sim = pd.Simulation(body, material, state=state, threads=1)
    np.testing.assert_allclose(
        sim.strain_energy_n(), energy_by_hand(body, material, u, state.intact_b != 0), rtol=1e-10
    )
    F = np.zeros_like(u)
    f = sim.bond_forces()
    np.add.at(F, f.i, f.F_bc)
    np.add.at(F, f.j, -f.F_bc)
    scale, step = np.abs(F).max(), 1e-6
    for n, c in ((0, 0), (17, 1), (40, 2)):
        slope = []
        for sign in (1, -1):
            moved = u.copy()
            moved[n, c] += sign * step
            slope.append(energy_by_hand(body, material, moved, state.intact_b != 0).sum())
        assert -(slope[0] - slope[1]) / (2 * step) == pytest.approx(F[n, c], abs=1e-7 * scale)
    assert np.abs(F.sum(axis=0)).max() < 1e-12 * scale
    y = body.X_nc + u
    assert np.abs(np.cross(y, F).sum(axis=0)).max() < 1e-11 * scale * np.abs(y).max()


@pytest.mark.parametrize("dimension, plane", [(1, "stress"), (2, "stress"), (2, "strain"), (3, "stress")])
def test_linear_patch(dimension, plane):
    """Every node of any cloud has the energy of the strain, rim included; on a lattice nodes two horizons from the rim are in
    balance."""
    size = np.where(np.arange(3) < dimension, {1: 30.1, 2: 10.1, 3: 8.1}[dimension], 0)
    options = dict(dimension=dimension, plane=plane)
    H = 1e-3 * np.array([[1.0, 0.3, 0.2], [-0.2, 0.5, 0.1], [0.4, 0.6, -0.7]])
    H[dimension:] = H[:, dimension:] = 0
    material = pd.BondAssociated(K, G)
    for jitter in (0.0, 0.15):
        body = pd.Body.lattice(pd.Box((0, 0, 0), size), 1.0, 2.01, 2.0, jitter=jitter, **options)
        lam, mu = material.lame(body)
        sim = pd.Simulation(body, material, displacements=body.X_nc @ H.T)
        E = 0.5 * (H + H.T + H.T @ H)
        want = 0.5 * lam * np.trace(E) ** 2 + mu * (E * E).sum()
        np.testing.assert_allclose(sim.strain_energy_n() / body.V_n, want, rtol=1e-10)
        if jitter == 0:
            deep = ((body.X_nc > 3.9) & (body.X_nc < size - 3.9))[:, :dimension].all(axis=1)
            F = sim.forces()
            assert deep.any() and np.abs(F[deep]).max() < 1e-10 * np.abs(F).max()


def stiffness(body, material):
    """(3n, 3n) by differences about rest, in the directions of the body's dimension."""
    d, n, step = body.dimension, len(body), 1e-6
    sim = pd.Simulation(body, material, threads=1)
    F = np.zeros((n, 3))
    out = np.zeros((n * d, n * d))
    smin = np.full(n, np.inf)
    intact = sim.state.intact_b
    for k in range(n * d):
        for sign in (1, -1):
            z = sim._z.copy()
            z[k // d, k % d] += sign * step
            sim.model.forces(z, intact, F, smin, False)
            out[:, k] -= sign * F[:, :d].ravel() / (2 * step)
    return 0.5 * (out + out.T)


@pytest.mark.parametrize("jitter", [0.0, 0.15])
def test_no_zero_energy_modes(jitter):
    """Of a free plate only the three rigid motions cost nothing; plain correspondence without stabilisation has soft
    modes beside. The stable step is one."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (6.1, 5.1, 0)), 1.0, 2.01, 2.0, dimension=2, jitter=jitter)
    held, plain = (
        np.linalg.eigvalsh(stiffness(body, m))
        for m in (pd.BondAssociated(K, G), pd.Correspondence(K, G, stabilisation=0.0))
    )
    assert np.abs(held[:3]).max() < 1e-8 * held[-1]
    # The longest bending wave, (π/L)⁴-soft, is the lowest: the material's own.
    assert held[3] > 0.02 * held[-1]
    assert plain[3] < 0.2 * held[3]
    sim = pd.Simulation(body, pd.BondAssociated(K, G))
    mass = body.rho_n[0] * body.V_n.min()
    assert sim.time_step_stable < 2 / np.sqrt(held[-1] / mass)


def test_sawtooth_in_the_bulk_pushes_back():
    body = block((9, 9, 9))
    u = np.zeros_like(body.X_nc)
    u[:, 0] = 1e-3 * (-1.0) ** np.rint(body.X_nc.sum(axis=1))
    middle = np.argmin(np.abs(body.X_nc - 4).max(axis=1))
    bare, held = (
        pd.Simulation(body, m, displacements=u)
        for m in (pd.Correspondence(K, G, stabilisation=0.0), pd.BondAssociated(K, G))
    )
    assert abs(bare.forces()[middle, 0]) < 1e-12 * K
    assert held.forces()[middle, 0] * u[middle, 0] < -0.1 * u[middle, 0] ** 2 * K


def test_long_waves_in_a_bar_have_its_speed():
    """A standing wave of 80 spacings in a periodic bar: c = √(E/ρ), to the dispersion (kδ)²."""
    n = 80
    body = pd.Body(
        np.arange(n)[:, None] * [1.0, 0, 0], 1.0, 2.0, 2.01,
        cell=Cell([float(n), 1, 1], periodic=(True, False, False)), dimension=1, spacing=1.0,
    )  # fmt: skip
    material = pd.BondAssociated(youngs=1.5, poisson=0.2)
    k = 2 * np.pi / n
    u = np.zeros((n, 3))
    u[:, 0] = 1e-6 * np.cos(k * body.X_nc[:, 0])
    sim = pd.Simulation(body, material, displacements=u)
    period = n / np.sqrt(1.5 / 2.0)
    amplitude = [sim.state.u_nc[:, 0] @ u[:, 0]]
    while sim.state.time < 0.5 * period:
        sim.step(1)
        amplitude.append(sim.state.u_nc[:, 0] @ u[:, 0])
    down = np.flatnonzero(np.array(amplitude) < 0)[0]
    a, b = amplitude[down - 1 : down + 1]
    quarter = sim.dt * (down - 1 + a / (a - b))
    assert quarter == pytest.approx(0.25 * period, rel=(2.01 * k) ** 2)


def test_what_it_refuses():
    with pytest.raises(AtcError, match="horizon reaches 1.1 spacings, take 2 or more"):
        pd.Simulation(block(horizon=1.1), pd.BondAssociated(K, G))
    two = block()
    body = pd.Body(two.X_nc, two.V_n, 2.0, two.horizon, spacing=1.0, materials=np.arange(len(two)) % 2 + 1)
    with pytest.raises(AtcError, match="bond-associated: bonds of this material have no stiffness"):
        pd.Simulation(body, {m: pd.BondAssociated(K, G) for m in (1, 2)}, interfaces={(1, 2): 0.5})


@pytest.mark.parametrize("kind", [pd.BondAssociated, pd.Correspondence])
def test_influence_of_direction(kind):
    """K takes any even ω(ξ): the energy of every homogeneous strain stays the isotropic one, momentum rounding; forces
    of others are not those of ω = 1. What is odd, or for a material that would be anisotropic, is refused."""
    body = block((6, 5, 5), jitter=0.1)
    omega = lambda xi: 1 + 4 * xi[:, 0] ** 2 / (xi**2).sum(axis=1)  # noqa: E731
    material = kind(K, G, influence=omega)
    lam, mu = material.lame(body)
    H = 1e-3 * np.array([[1.0, 0.3, 0.2], [-0.2, 0.5, 0.1], [0.4, 0.6, -0.7]])
    sim = pd.Simulation(body, material, displacements=body.X_nc @ H.T)
    E = 0.5 * (H + H.T + H.T @ H)
    want = 0.5 * lam * np.trace(E) ** 2 + mu * (E * E).sum()
    np.testing.assert_allclose(sim.strain_energy_n() / body.V_n, want, rtol=1e-10)
    u = np.random.default_rng(3).uniform(-0.05, 0.05, body.X_nc.shape)
    F, plain = (pd.Simulation(body, m, displacements=u).forces() for m in (material, kind(K, G)))
    scale = np.abs(F).max()
    assert np.abs(F.sum(axis=0)).max() < 1e-12 * scale and np.abs(F - plain).max() > 0.05 * scale
    for bad, words in (
        (lambda xi: 1 + 0.1 * xi[:, 0], "even"),
        (lambda xi: -np.ones(len(xi)), "0 or more"),
        (lambda xi: xi, "expected"),
    ):
        with pytest.raises(AtcError, match=f"influence: .*{words}"):
            pd.Simulation(body, kind(K, G, influence=bad))
    with pytest.raises(AtcError, match="influence: .*anisotropic"):
        pd.Simulation(body, pd.LPS(K, G, influence=omega))
