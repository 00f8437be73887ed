"""The peridynamics engine against closed forms, balance laws and invariances; every invariance loops over the table of
materials."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from atc import pd
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell

K, G = 1.3, 0.5
NAMES = sorted(pd.MATERIALS)


def block(counts=(6, 5, 5), horizon=3.01, **options):
    return pd.Body.lattice(pd.Box((0, 0, 0), np.array(counts) - 0.9), 1.0, horizon, 2.0, **options)


def forces_of(body, material, u, **options):
    return pd.Simulation(body, material, displacements=u, threads=1, **options).forces()


def force_scale(body, material):
    """Forces when every node is displaced at random by a tenth of a spacing."""
    u = np.random.default_rng(5).uniform(-0.1, 0.1, (len(body), 3))
    return np.abs(forces_of(body, material, u)).max()


# ---- families


def naive_families(X, cell, horizon):
    reach = 0 if not cell.periodic.any() else 3
    pairs = []
    shifts = list(itertools.product(*(range(-reach, reach + 1) if p else (0,) for p in cell.periodic)))
    for i in range(len(X)):
        for j in range(i, len(X)):
            for s in shifts:
                if i == j and s <= (0, 0, 0):
                    continue
                xi = X[j] - X[i] + np.array(s) @ cell.vectors
                if np.linalg.norm(xi) <= horizon:
                    pairs.append((i, j, *np.round(xi, 9)))
    return sorted(pairs)


@pytest.mark.parametrize("periodic", [(False, False, False), (True, True, True), (True, False, True)])
def test_families_are_all_pairs_within_the_horizon(periodic):
    X = np.random.default_rng(2).uniform(0, 4, (40, 3))
    cell = Cell([4.0, 4.0, 4.0], periodic=periodic)
    body = pd.Body(X, 1.0, 1.0, 2.1, cell=cell)
    t = body.bonds
    mine = sorted((int(i), int(j), *np.round(xi, 9)) for i, j, xi in zip(t.i_b, t.j_b, t.xi_bc(X), strict=True))
    want = naive_families(X, cell, 2.1)
    assert len(mine) == len(want) > 100
    for a, b in zip(mine, want, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-9)
    assert (t.i_b <= t.j_b).all() and t.start_n[-1] == len(t)


def test_horizon_at_an_exact_multiple_counts_those_bonds_and_warns():
    for shift in (0.0, 1 / 3, 10.0, 1e3 / 7):
        body = pd.Body.lattice(
            pd.Box((shift, 0, 0), (shift + 0.6005, 0.6005, 0.6005)), 0.1, 0.3, 1.0, offset=(shift, 0, 0)
        )
        with pytest.warns(AtcWarning, match="exact bond length"):
            t = body.bonds
        # The node in the middle of a 7³ block has the whole lattice ball of radius 3 around it: 122 partners.
        middle = np.argmin(np.abs(body.X_nc - [shift + 0.3, 0.3, 0.3]).max(axis=1))
        assert np.count_nonzero(t.i_b == middle) + np.count_nonzero(t.j_b == middle) == 122


def test_lattice_of_the_disk_has_the_published_numbers():
    """A slice of R's disk is counted by hand here; the whole (103,110 nodes) is a slow test."""
    body = pd.Body.lattice(pd.Cylinder("y", (0, 0), 0.037, 0.0, 0.0), 0.0005, 0.0015001, 2200.0)
    k = np.arange(-80, 81) * 0.0005
    x, z = np.meshgrid(k, k)
    assert len(body) == np.count_nonzero(np.sqrt(x * x + z * z) <= 0.037) == 103110 // 6


def test_a_notch_cuts_exactly_the_bonds_that_cross_it():
    notch = pd.Notch((2.5, -1, -1), (0, 3.5, 0), (0, 0, 9))
    body, whole = block(notches=[notch]), block()
    t = whole.bonds
    a, b = whole.X_nc[t.i_b], whole.X_nc[t.j_b]
    at = (2.5 - a[:, 0]) / np.where(b[:, 0] == a[:, 0], np.nan, b[:, 0] - a[:, 0])
    y = a[:, 1] + at * (b[:, 1] - a[:, 1])
    cut = (at >= 0) & (at <= 1) & (y <= 2.5)
    assert 0 < cut.sum() == len(t) - len(body.bonds)
    damaged = block(notches=[pd.Notch((2.5, -1, -1), (0, 3.5, 0), (0, 0, 9), as_damage=True)])
    sim = pd.Simulation(damaged, pd.PMB(K))
    assert np.array_equal(sim.state.intact_b == 0, cut) and sim.n_broken == cut.sum()
    assert sim.damage().max() > 0.3 and np.all(pd.Simulation(body, pd.PMB(K)).damage() == 0)


# ---- invariances, for every material


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shift", [0.0, 1 / 3, 10.0, 12345.678])
def test_rest_is_exactly_at_rest_wherever_the_body_is(name, shift):
    body = block(jitter=0.1, offset=(0.0, 0.0, 0.0))
    moved = pd.Body(body.X_nc + shift, body.V_n, 2.0, body.horizon, spacing=1.0)
    material = pd.MATERIALS[name](K, G)
    assert np.all(forces_of(moved, material, None) == 0)
    # A rigid translation of the body is as good as none: bonds see differences only.
    sim = pd.Simulation(
        body, material, displacements=np.full(3, shift), damage=pd.CriticalStretch(1e-12, 0.25), contact=True
    )
    sim.step(3)
    assert (
        np.all(sim.forces() == 0) and np.all(sim.state.v_nc == 0) and sim.n_broken == 0 and sim.energies().strain == 0
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("degrees", [1, 30, 90, 135, 180])
def test_rotations_cost_nothing(name, degrees):
    body, material = block(jitter=0.1), pd.MATERIALS[name](K, G)
    R = Rotation.from_rotvec(np.radians(degrees) * np.array([1, 2, -2]) / 3).as_matrix()
    sim = pd.Simulation(body, material, displacements=body.X_nc @ (R - np.eye(3)).T + 10.0, threads=1)
    # Rounding of displacements of up to 20 spacings, against forces at strains of a tenth.
    assert np.abs(sim.forces()).max() < 1e-12 * force_scale(body, material)
    assert sim.energies().strain < 1e-24


@pytest.mark.parametrize("name", NAMES)
def test_forces_are_minus_the_gradient_of_the_energy_and_balance(name):
    body, material = block((5, 4, 4), jitter=0.1), pd.MATERIALS[name](K, G)
    rng = np.random.default_rng(1)
    sim = pd.Simulation(body, material, displacements=rng.normal(size=(len(body), 3)) * 0.05, threads=1)
    F, intact = sim.forces(), sim.state.intact_b
    for n, c in ((0, 0), (31, 1), (60, 2)):
        energy = []
        for h in (1e-5, -1e-5):
            z = sim._z.copy()
            z[n, c] += h
            energy.append(sim.model.energy_n(z, intact).sum())
        assert F[n, c] == pytest.approx(-(energy[0] - energy[1]) / 2e-5, abs=1e-9 * np.abs(F).max())
    assert np.abs(F.sum(axis=0)).max() < 1e-13 * np.abs(F).max() * len(body)
    assert np.abs(np.cross(sim.positions_nc, F).sum(axis=0)).max() < 1e-13 * np.abs(F).max() * len(body) * 5
    b = sim.bond_forces()
    again = np.zeros_like(F)
    np.add.at(again, b.i, b.F_bc)
    np.add.at(again, b.j, -b.F_bc)
    np.testing.assert_allclose(again, F, atol=1e-13 * np.abs(F).max())
    np.testing.assert_allclose(b.r_bc, sim.positions_nc[b.i] - sim.positions_nc[b.j], atol=1e-14)
    np.testing.assert_array_equal(b.R_bc, body.X_nc[b.i] - body.X_nc[b.j])
    if b.G_b is not None:
        np.testing.assert_allclose(b.F_bc, -b.G_b[:, None] * b.r_bc, atol=1e-15)


def naive_pmb(body, c, u):
    """PMB as in the literature, by positions, node by node, over both ends of every bond: force densities."""
    y, f = body.X_nc + u, np.zeros_like(u)
    t = body.bonds
    nu = np.where(t.r0_b > body.horizon - body.spacing / 2, 0.5 + (body.horizon - t.r0_b) / body.spacing, 1.0)
    for i, j, r0, share in zip(t.i_b, t.j_b, t.r0_b, nu, strict=True):
        M = (y[j] - y[i]) / np.linalg.norm(y[j] - y[i])
        s = np.linalg.norm(y[j] - y[i]) / r0 - 1
        f[i] += c * s * share * body.V_n[j] * M
        f[j] -= c * s * share * body.V_n[i] * M
    return f


def naive_lps(body, K, G, u):
    """R algorithms 2-4."""
    y, f = body.X_nc + u, np.zeros_like(u)
    t, n = body.bonds, len(body)
    nu = np.where(t.r0_b > body.horizon - body.spacing / 2, 0.5 + (body.horizon - t.r0_b) / body.spacing, 1.0)
    V = body.V_n
    m, theta = np.zeros(n), np.zeros(n)
    rows = list(zip(t.i_b, t.j_b, t.r0_b, nu, strict=True))
    for i, j, r0, share in rows:
        m[i] += r0 * share * V[j]
        m[j] += r0 * share * V[i]
    for i, j, r0, share in rows:
        e = np.linalg.norm(y[j] - y[i]) - r0
        theta[i] += 3 / m[i] * e * share * V[j]
        theta[j] += 3 / m[j] * e * share * V[i]
    for i, j, r0, share in rows:
        d = y[j] - y[i]
        e = np.linalg.norm(d) - r0
        pull = (3 * K - 5 * G) * (theta[i] / m[i] + theta[j] / m[j]) + 15 * G * (1 / m[i] + 1 / m[j]) * e / r0
        f[i] += pull * share * V[j] * d / np.linalg.norm(d)
        f[j] -= pull * share * V[i] * d / np.linalg.norm(d)
    return f


def test_naive_twins_with_unequal_volumes():
    rng = np.random.default_rng(3)
    body = pd.Body(
        block((5, 5, 4), jitter=0.1).X_nc, rng.uniform(0.5, 1.5, 100), rng.uniform(1, 3, 100), 2.7, spacing=1.0
    )
    u = rng.normal(size=(100, 3)) * 0.05
    c = pd.PMB(K).micromodulus(body)
    assert c == pytest.approx(18 * K / (np.pi * 2.7**4), rel=1e-14)
    np.testing.assert_allclose(forces_of(body, pd.PMB(K), u) / body.V_n[:, None], naive_pmb(body, c, u), atol=1e-13)
    np.testing.assert_allclose(
        forces_of(body, pd.LPS(K, G), u) / body.V_n[:, None], naive_lps(body, K, G, u), atol=1e-13
    )


# ---- discrete truths


def periodic_block(n=8, horizon=3.0001):
    return pd.Body.lattice(pd.Box((0, 0, 0), (n - 0.9,) * 3), 1.0, horizon, 2.0, cell=Cell([float(n)] * 3))


def test_pmb_on_a_cubic_lattice_has_nine_tenths_of_its_bulk_modulus():
    """δ = 3Δx with ν: K is 0.900 of the input (formulas §9); W = 4.5 K e² in a dilatation e."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (12.1,) * 3), 1.0, 3.0001, 1.0)
    e = 1e-6
    sim = pd.Simulation(body, pd.PMB(K), displacements=body.X_nc * e)
    middle = np.abs(body.X_nc - 6).max(axis=1) < 1.5
    W = sim.strain_energy_n()[middle]
    assert np.ptp(W) < 1e-12 * W.mean()
    assert W.mean() / (4.5 * K * e**2) == pytest.approx(0.900, abs=0.0005)
    assert np.abs(sim.forces()[middle]).max() < 1e-9 * np.abs(sim.forces()).max()
    lps = pd.Simulation(body, pd.LPS(K, G), displacements=body.X_nc * e)
    # LPS is normalised by the lattice's own m: exact in a dilatation, W = ½ K (3e)².
    np.testing.assert_allclose(lps.strain_energy_n()[middle], 4.5 * K * e**2, rtol=1e-5)


def test_lps_with_three_fifths_is_pmb():
    body = periodic_block()
    u = np.random.default_rng(0).normal(size=body.X_nc.shape) * 0.01
    lps, pmb = forces_of(body, pd.LPS(K, 0.6 * K), u), forces_of(body, pd.PMB(K), u)
    # m of the lattice against πδ⁴ of the integral: one factor for all bonds, 1/0.900.
    t = body.bonds
    m = (t.sums(t.r0_b * body.nu_b())).mean()
    np.testing.assert_allclose(lps, pmb * np.pi * body.horizon**4 / m, atol=1e-13 * np.abs(lps).max())
    assert m / (np.pi * body.horizon**4) == pytest.approx(0.900, abs=5e-4)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("compat", [False, True])
def test_uniform_strain_of_a_periodic_body_gives_no_force(name, compat):
    body, material = periodic_block(), pd.MATERIALS[name](K, G)
    e = 1e-4
    for H in (e * np.eye(3), e * np.array([[1.0, 0.3, 0], [-0.2, 0.5, 0.1], [0, 0, -0.7]])):
        sim = pd.Simulation(body, material, strain=H, lammps_compat=compat, contact=True)
        scale = np.abs(sim.bond_forces().F_bc).max()
        if compat and name in ("lps", "elastic"):
            # LAMMPS leaves the images out of m: its spurious force.
            assert np.abs(sim.forces()).max() > scale
            continue
        assert np.abs(sim.forces()).max() < 1e-11 * scale
        W = sim.strain_energy_n()
        assert np.ptp(W) < 1e-11 * W.mean()
        if H[0, 1] == 0:
            want = 4.5 * K * e**2 * (0.900 if name == "pmb" else 1.0)
            # Correspondence has Green's strain in it: e (1 + e/2).
            assert W.mean() == pytest.approx(want, rel=5e-4)


@pytest.mark.parametrize("name", NAMES)
def test_forces_of_a_periodic_body_move_with_it_through_the_faces(name):
    body, material = periodic_block(), pd.MATERIALS[name](K, G)
    u = np.random.default_rng(0).normal(size=body.X_nc.shape) * 1e-3
    cells = np.rint(body.X_nc).astype(int)
    index = {tuple(x): k for k, x in enumerate(cells.tolist())}
    shifted = np.array([index[tuple(x)] for x in ((cells + [1, 2, 3]) % 8).tolist()])
    moved = np.empty_like(u)
    moved[shifted] = u
    F = forces_of(body, material, u)
    np.testing.assert_allclose(forces_of(body, material, moved)[shifted], F, atol=1e-13 * np.abs(F).max())
    assert np.abs(F.sum(axis=0)).max() < 1e-12 * np.abs(F).max()


@pytest.mark.parametrize("name", ["pmb", "lps"])
def test_plane_waves_follow_the_lattice_sum(name):
    """ω² of a plane wave on the lattice, PMB: Σ c ν V (1 − cos k·ξ)(n·ξ)²/|ξ|³, times ρ; LPS adds the dilatation's. To
    1e-10."""
    body, material = periodic_block(12), pd.MATERIALS[name](K, G)
    X = body.X_nc
    t = body.bonds
    mine = (t.i_b == 0) | (t.j_b == 0)
    xi = t.xi_bc(X)[mine] * np.where(t.i_b[mine] == 0, 1, -1)[:, None]
    assert len(xi) == 122
    r = np.linalg.norm(xi, axis=1)
    nu = np.where(r > body.horizon - 0.5, 0.5 + (body.horizon - r) / 1.0, 1.0)
    for kvec, pol in (((1, 0, 0), (1, 0, 0)), ((1, 2, 0), (0, 0, 1)), ((3, 3, 0), (1, 1, 0)), ((6, 0, 0), (1, 0, 0))):
        k = 2 * np.pi / 12 * np.array(kvec)
        n = np.array(pol) / np.linalg.norm(pol)
        phase = xi @ k
        if name == "pmb":
            b_over_m = material.micromodulus(body) * nu / r**3
            D = (b_over_m * (xi @ n) ** 2 * (1 - np.cos(phase))).sum()
        else:
            m = (r * nu).sum()
            D = 2 * 15 * G / m * (nu / r**3 * (xi @ n) ** 2 * (1 - np.cos(phase))).sum()
            # θ of a wave n cos(k·x): −(3/m) Σ ν ξ·n/|ξ| sin(k·ξ) sin(k·x): its own force is the same sum once more.
            S = (nu / r * (xi @ n) * np.sin(phase)).sum()
            D += 3 * (3 * K - 5 * G) / m**2 * S**2
        # Amplitudes so small that the forces are linear to rounding: extensions come from displacements without
        # cancellation.
        u = 1e-11 * np.cos(X @ k)[:, None] * n
        F = forces_of(body, material, u)
        np.testing.assert_allclose(F, -D * u, atol=1e-10 * D * 1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_energy_and_momentum_are_conserved(name):
    body, material = block((8, 5, 5)), pd.MATERIALS[name](K, G)
    drift = []
    for refine in (1, 2):
        sim = pd.Simulation(body, material, velocities=np.sin(body.X_nc[:, ::-1]) * 1e-2, threads=1)
        sim.dt /= 4 * refine
        p0 = (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)
        e0 = sim.energies().total
        worst = 0.0
        for _ in range(10):
            sim.step(20 * refine)
            worst = max(worst, abs(sim.energies().total - e0) / e0)
        p = (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)
        assert np.abs(p - p0).max() < 1e-13 * (sim.mass_n[:, None] * np.abs(sim.state.v_nc)).sum()
        drift.append(worst)
    # Second order: a quarter of it with half the step.
    assert drift[0] < 5e-3 and drift[1] < drift[0] / 3


@pytest.mark.parametrize("name", NAMES)
def test_ledger_closes_through_fracture_contact_indenter_and_prescribed_motion(name):
    """The two halves of a bar are torn apart while an indenter presses: what is put in is found again, up to O(Δt²) of
    the integrator."""
    body, material = block((12, 4, 4), horizon=2.01, warn=False), pd.MATERIALS[name](K, G)
    left, right = body.nodes(lambda X: X[:, 0] < 1.5), body.nodes(lambda X: X[:, 0] > 9.5)
    errors = []
    for refine in (1, 4):
        sim = pd.Simulation(
            body,
            material,
            damage=pd.CriticalStretch(0.06, 0.25),
            contact=True,
            no_fail=[left, right],
            indenter=pd.Indenter(3.0, 0.02, (5.5, 5.4, 1.5), (0, -0.005, 0)),
            conditions=[
                pd.Prescribed(left, velocity=(0, 0, 0)),
                pd.Prescribed(right, velocity=(0.04, None, 0)),
                pd.BodyForce(None, (0, 0, 1e-4)),
            ],
        )
        sim.dt = 0.1 * sim.time_step_stable / refine
        start = sim.energies().total
        while sim.state.time < 120 * 0.1 * sim.time_step_stable * 3:
            sim.step(20)
        e = sim.energies()
        assert sim.n_broken > 20 and e.dissipated_fracture > 0 and e.work_constraint > 0 and e.work_external != 0
        errors.append(abs(e.total - start) / (abs(e.work_constraint) + abs(e.work_external)))
        safe = np.isin(body.bonds.i_b, np.r_[left, right]) | np.isin(body.bonds.j_b, np.r_[left, right])
        assert np.all(sim.state.intact_b[safe] == 2)
    # O(Δt²) for springs; where the going of one bond changes the pull of others at once, O(Δt).
    within = {"pmb": 1e-4, "lps": 2e-4, "elastic": 2e-4, "correspondence": 3e-3, "bond-associated": 3e-3}[name]
    assert errors[0] < within and errors[1] < errors[0] / (10 if name == "pmb" else 2.5)


# ---- bookkeeping


def loaded(body, threads=1, **options):
    return pd.Simulation(
        body,
        pd.LPS(K, G),
        damage=pd.CriticalStretch(0.02, 0.25),
        contact=True,
        indenter=pd.Indenter(3.0, 0.5, (4, 9.5, 2), (0, -0.1, 0)),
        walls=pd.Wall((0, -0.5, 0), (0, 1, 0), 1.0),
        conditions=[pd.Prescribed(pd.Box((None,) * 3, (0.5, None, None)), velocity=lambda t: (0.01 * t, 0, 0))],
        damping=1e-3,
        threads=threads,
        **options,
    )


def test_a_restart_is_bitwise_the_uninterrupted_run():
    body = block((9, 7, 5))
    whole, first = loaded(body), loaded(body)
    whole.step(70)
    first.step(33)
    again = loaded(body, state=pd.State.from_arrays(first.state.to_arrays()))
    again.step(37)
    assert whole.n_broken == again.n_broken > 0
    a, b = whole.state.to_arrays(), again.state.to_arrays()
    assert set(a) == set(b)
    for k in a:
        assert np.array_equal(a[k], b[k]), k
    assert whole.energies() == again.energies()


def test_results_do_not_depend_on_threads():
    body = block((26, 18, 16))
    assert len(body) > 4096
    a, b = loaded(body, 1), loaded(body, 3)
    a.step(12)
    b.step(12)
    assert a.model.blocks.count > 1 and a.n_broken == b.n_broken > 0
    x, y = a.state.to_arrays(), b.state.to_arrays()
    for k in x:
        assert np.array_equal(x[k], y[k]), k


def test_damage_is_the_lost_share_of_the_family_and_strictly_beyond_the_threshold():
    """A chain pulled uniformly: bonds at exactly s0 hold, those beyond break after the second step only, and both ends
    lose them."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (5.1, 0, 0)), 1.0, 1.5, 1.0, dimension=1)
    u = np.zeros((6, 3))
    u[3:, 0] = 0.25
    for s00, breaks in ((0.25, False), (0.2499, True)):
        sim = pd.Simulation(body, pd.PMB(1.0), damage=pd.CriticalStretch(s00), displacements=u, dt=1e-9)
        assert sim.n_broken == 0
        sim.step(1)
        assert sim.n_broken == 0, "s0 is infinite in the first step"
        sim.state.v_nc[:] = 0
        sim._z[:, :3] = u
        sim.step(1)
        assert sim.n_broken == int(breaks)
        np.testing.assert_allclose(sim.damage(), [0, 0, 0.5, 0.5, 0, 0] if breaks else 0, atol=1e-15)


@pytest.mark.parametrize("dimension, plane", [(1, "stress"), (2, "stress"), (2, "strain"), (3, "stress")])
def test_constants_of_every_dimension(dimension, plane):
    """Energy of uniform strains in the continuum limit (δ = 8Δx): ½λ tr² + μ ε:ε of the dimension, all materials."""
    n = {1: 40, 2: 24, 3: 13}[dimension]
    horizon = {1: 8.0, 2: 8.0, 3: 5.0}[dimension] + 1e-4
    size = np.zeros(3)
    size[:dimension] = n - 0.9 if dimension < 3 else 12.1
    body = pd.Body.lattice(pd.Box((0, 0, 0), size), 1.0, horizon, 1.0, dimension=dimension, plane=plane, thickness=0.7)
    middle = np.argmin(np.abs(body.X_nc - size / 2).max(axis=1))
    E, nu = 2.0, 0.25 if plane == "strain" or dimension == 3 else 1 / 3
    state_based = [m(youngs=E, poisson=nu) for m in (pd.LPS, pd.Correspondence, pd.BondAssociated)]
    for material in (pd.PMB(youngs=E), *state_based):
        lam, mu = material.lame(body)
        if dimension == 2 and plane == "stress":
            assert mu == pytest.approx(E / (2 * (1 + nu))) and lam == pytest.approx(E * nu / (1 - nu**2))
        if dimension == 1:
            assert lam + 2 * mu == pytest.approx(E)
        for eps in (np.diag([1.0, 0, 0]), np.diag([1.0, 1, 0]), np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, 0]])):
            eps = eps.copy()
            eps[dimension:] = eps[:, dimension:] = 0
            if not eps.any():
                continue
            # Small enough that Green's strain is the linear one.
            sim = pd.Simulation(body, material, displacements=body.X_nc @ eps.T * 1e-7)
            W = sim.strain_energy_n()[middle] / body.V_n[middle] / 1e-14
            want = 0.5 * lam * np.trace(eps) ** 2 + mu * (eps * eps).sum()
            # The lattice as a quadrature of the horizon: ν takes off about 1/8 Δx of δ, to the power d + 1 in PMB,
            # normalised away by m in LPS; correspondence materials have no such error.
            within = {"pmb": 0.125, "lps": 0.06, "correspondence": 1e-5, "bond-associated": 1e-5}[material.name]
            assert W == pytest.approx(want, rel=within), (material.name, eps)
    c = pd.PMB(youngs=E).micromodulus(body)
    h, delta = body.thickness, body.horizon
    known = {
        1: 2 * E / (delta**2 * h),
        2: (9 if plane == "stress" else 48 / 5) * E / (np.pi * h * delta**3),
        3: 12 * E / (np.pi * delta**4),
    }
    assert c == pytest.approx(known[dimension], rel=1e-12)


def test_critical_stretch_from_fracture_energy():
    body3 = block()
    d = pd.CriticalStretch.from_energy(3.0, pd.PMB(K), body3)
    assert d.s00 == pytest.approx(np.sqrt(5 * 3.0 / (9 * K * body3.horizon)), rel=1e-12)
    assert pd.CriticalStretch.from_energy(3.0, pd.LPS(K, 0.6 * K), body3).s00 == pytest.approx(d.s00, rel=1e-9)
    plate = pd.Body.lattice(pd.Box((0, 0, 0), (5, 5, 0)), 1.0, 3.01, 1.0, dimension=2, thickness=0.3)
    s = pd.CriticalStretch.from_energy(3.0, pd.PMB(youngs=2.0), plate).s00
    assert s == pytest.approx(np.sqrt(4 * np.pi * 3.0 / (9 * 2.0 * 3.01)), rel=1e-12)


def test_contact_repels_pairs_equally_whatever_their_volumes():
    X = np.array([[0.0, 0, 0], [5.0, 0, 0]])
    body = pd.Body(X, [1.0, 3.0], 1.0, 2.0, spacing=1.0)
    sim = pd.Simulation(body, pd.PMB(K), contact=True, displacements=np.array([[0, 0, 0], [-4.0, 0.1, 0]]), dt=0.1)
    c = 18 * K / (np.pi * 2.0**4)
    r = np.hypot(1.0, 0.1)
    d = 1.35
    F = sim.forces()
    np.testing.assert_allclose(F[1], 15 * c * 3.0 * (d - r) / 2.0 * np.array([1.0, 0.1, 0]) / r, rtol=1e-14)
    np.testing.assert_array_equal(F[0], -F[1])
    assert sim.energies().contact == pytest.approx(0.5 * 15 * c * 3.0 * (d - r) ** 2 / 2.0)


def test_zero_energy_modes_of_correspondence_need_the_stabilisation():
    """A sawtooth is invisible to F on a lattice: no force without stabilisation, a restoring one with it."""
    body = block((9, 9, 9), horizon=2.01)
    u = np.zeros_like(body.X_nc)
    u[:, 0] = 1e-3 * (-1.0) ** np.rint(body.X_nc.sum(axis=1))
    middle = np.argmin(np.abs(body.X_nc - 4).max(axis=1))
    bare = pd.Simulation(body, pd.Correspondence(K, G, stabilisation=0.0), displacements=u)
    held = pd.Simulation(body, pd.Correspondence(K, G), displacements=u)
    assert abs(bare.forces()[middle, 0]) < 1e-12 * K
    assert held.forces()[middle, 0] * u[middle, 0] < -1e-4 * u[middle, 0] ** 2 * K
    assert held.strain_energy_n()[middle] > 1e3 * abs(bare.strain_energy_n()[middle])


@pytest.mark.parametrize("name", NAMES)
def test_a_body_that_goes_to_pieces_does_not_explode(name):
    """Nearly every bond breaks: what is left of families must not push harder than the bodies' energy allows."""
    body = block((8, 7, 6), jitter=0.1)
    v = np.random.default_rng(2).normal(size=body.X_nc.shape) * 0.1
    sim = pd.Simulation(body, pd.MATERIALS[name](K, G), velocities=v, damage=pd.CriticalStretch(0.03), threads=1)
    start = sim.energies().kinetic
    sim.step(150)
    e = sim.energies()
    assert sim.n_broken > 0.9 * len(body.bonds) and e.kinetic + e.strain < start


@pytest.mark.parametrize("solver", ["relax", "solve_static"])
def test_static_solvers_agree_with_a_chain_by_hand(solver):
    body = pd.Body.lattice(pd.Box((0, 0, 0), (9.1, 0, 0)), 1.0, 1.2, 1.0, dimension=1)
    load = 1e-5
    sim = pd.Simulation(
        body,
        pd.PMB(1.0, volume_correction=False),
        conditions=[pd.Prescribed([0], displacement=(0, 0, 0)), pd.BodyForce([9], total=(load, 0, 0))],
    )
    out = getattr(pd, solver)(sim, tolerance=1e-9)
    k = sim.model.W_b[0]
    # Nine springs in series, each stretched by load/k; the exact nonlinear spring is linear in 1-D.
    np.testing.assert_allclose(sim.state.u_nc[:, 0], np.arange(10) * load / k, rtol=1e-7, atol=1e-12)
    assert out.residual <= 1e-9 and np.all(sim.state.v_nc == 0)


def bar_in_tension(material, solver=None):
    L, w = 24, 8
    body = pd.Body.lattice(pd.Box((0, 0, 0), (L + 0.1, w + 0.1, w + 0.1)), 1.0, 3.01, 1.0)
    stress = 1e-4 * material.uniaxial(body)
    force = stress * (w + 1) ** 2
    sim = pd.Simulation(
        body, material, conditions=[
            pd.BodyForce(lambda X: X[:, 0] > L - 2.5, total=(force, 0, 0)),
            pd.BodyForce(lambda X: X[:, 0] < 2.5, total=(-force, 0, 0)),
            pd.Prescribed(lambda X: np.abs(X - [L / 2, w / 2, w / 2]).max(axis=1) < 0.6, displacement=(0, 0, 0)),
        ],
    )  # fmt: skip
    pd.relax(sim, tolerance=1e-5)
    u, X = sim.state.u_nc, body.X_nc
    middle = np.abs(X[:, 0] - L / 2) < 5
    e = np.polyfit(X[middle, 0], u[middle, 0], 1)[0]
    lateral = np.polyfit(X[middle, 1], u[middle, 1], 1)[0]
    return stress / e / material.uniaxial(body), -lateral / e / material.poisson(body)


@pytest.mark.parametrize(
    "material, within",
    [(pd.Correspondence(1.0, 0.35), 0.02), (pd.PMB(1.0, surface_correction="energy"), 0.10)],
    ids=["correspondence", "pmb with surface correction"],
)
def test_uniform_tension_recovers_youngs_modulus_and_poissons_ratio(material, within):
    E, nu = bar_in_tension(material)
    assert abs(E - 1) < within and abs(nu - 1) < within


def test_surface_correction_is_what_makes_the_bar_right():
    E, _ = bar_in_tension(pd.PMB(1.0))
    assert E < 0.8


def test_waves_in_a_bar_run_at_the_bar_speed_with_refinement():
    """A pulse in a 1-D bar: its speed approaches √(E/ρ) as δ → 0 against the pulse's width."""
    errors = []
    for per_width in (8, 16, 32):
        dx = 1.0 / per_width
        body = pd.Body.lattice(pd.Box((0, 0, 0), (20.0001, 0, 0)), dx, 3.0001 * dx, 2.0, dimension=1, thickness=1.0)
        x = body.X_nc[:, 0]
        E = 5.0
        pulse = 1e-5 * np.exp(-((x - 6.0) ** 2))
        u = np.zeros_like(body.X_nc)
        u[:, 0] = pulse
        c = np.sqrt(E / 2.0)
        v = np.zeros_like(u)
        v[:, 0] = -c * np.gradient(pulse, dx)
        # Without ν the 1-D lattice sum of c is exact up to the end points of the horizon: normalise by it.
        sim = pd.Simulation(body, pd.LPS(youngs=E, poisson=0.25), displacements=u, velocities=v, dt=0.2 * dx / c)
        steps = round(8.0 / c / sim.dt)
        sim.step(steps)
        moved = (x * sim.state.u_nc[:, 0] ** 2).sum() / (sim.state.u_nc[:, 0] ** 2).sum() - 6.0
        errors.append(abs(moved / (steps * sim.dt) / c - 1))
    assert errors[-1] < 2e-3 and errors[0] > 3 * errors[1] > 9 * errors[2]


def test_several_materials_meet_in_series():
    body = block((8, 4, 4))
    left = body.X_nc[:, 0] < 3.5
    two = pd.Body(body.X_nc, body.V_n, 2.0, body.horizon, spacing=1.0, materials=np.where(left, 1, 2))
    u = np.random.default_rng(0).normal(size=body.X_nc.shape) * 0.02
    same = forces_of(two, {1: pd.PMB(K), 2: pd.PMB(K)}, u)
    np.testing.assert_allclose(same, forces_of(body, pd.PMB(K), u), atol=1e-14)
    sim = pd.Simulation(
        two,
        {1: pd.PMB(K), 2: pd.PMB(3 * K)},
        displacements=u,
        damage={1: pd.CriticalStretch(0.1), 2: pd.CriticalStretch(0.2)},
    )
    t = two.bonds
    across = left[t.i_b] != left[t.j_b]
    ratio = sim.model.W_b / pd.Simulation(two, pd.PMB(K)).model.W_b
    assert set(np.round(ratio[across], 12)) == {1.5} and set(np.round(ratio, 12)) == {1.0, 1.5, 3.0}
    own = pd.Simulation(two, {1: pd.PMB(K), 2: pd.PMB(3 * K)}, interfaces={(1, 2): pd.PMB(0.1 * K)})
    assert set(np.round((own.model.W_b / sim.model.W_b)[across] * 15, 10)) == {1.0}
    mixed = pd.Simulation(two, {1: pd.LPS(K, G), 2: pd.LPS(2 * K, G)}, displacements=u)
    assert np.abs(mixed.forces().sum(axis=0)).max() < 1e-13


def test_errors_say_what_to_do():
    body = block()
    for make, words in (
        (lambda: pd.PMB(), "exactly one"),
        (lambda: pd.PMB(-1.0), "positive"),
        (lambda: pd.LPS(1.0), "bulk and shear"),
        (lambda: pd.Body(np.zeros((2, 3)), 1.0, 1.0, 1.0).bonds, "same place"),
        (lambda: pd.Body(np.zeros((2, 2)), 1.0, 1.0, 1.0), "shape"),
        (lambda: pd.Body(body.X_nc, 1.0, 1.0, 1.0, dimension=2), "constant z"),
        (lambda: pd.Simulation(body, {2: pd.PMB(1.0)}), "material 1"),
        (lambda: pd.Simulation(body, pd.PMB(1.0), damage={3: pd.CriticalStretch(1.0)}), "no material 3"),
        (lambda: pd.Simulation(body, pd.PMB(1.0), state=pd.State.rest(block((3, 3, 3)))), "another body"),
        (
            lambda: pd.Simulation(
                body, pd.PMB(1.0), conditions=[pd.BodyForce(pd.Box((50,) * 3, (60,) * 3), (1, 0, 0))]
            ),
            "no node",
        ),
        (lambda: pd.Prescribed(None), "exactly one"),
        (lambda: pd.Prescribed(None, velocity=(1, 2)), "three components"),
        (lambda: pd.CriticalStretch(-1.0), "positive"),
        (lambda: pd.PMB(1.0, influence="bell").micromodulus(body), "bell"),
        (lambda: pd.State.from_arrays({}), "restart"),
    ):
        with pytest.raises(AtcError, match=words):
            make()


def test_a_step_too_long_and_a_horizon_too_short_are_said():
    from atc.errors import AtcWarning

    X = np.indices((4, 4, 4)).reshape(3, -1).T * 1.0
    body = pd.Body(X, 1.0, 1.0, 1.5)
    stable = pd.Simulation(body, pd.PMB(1.0)).time_step_stable
    with pytest.warns(AtcWarning, match="3 times the step that is surely stable"):
        pd.Simulation(body, pd.PMB(1.0), dt=3 * stable)
    with pytest.warns(AtcWarning, match="nothing holds it together"):
        pd.Simulation(pd.Body(X, 1.0, 1.0, 0.5), pd.PMB(1.0), dt=0.1)
