"""Chains: forces against naive sums, energies against forces, Verlet against its closed form and the exact solution,
the numbers of the paper."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atc.errors import AtcError
from atc.upscaling.chain import LJ_SPINODAL, LennardJones, Springs, bump, smoothstep, square_pulse
from atc.upscaling.continuum import Peridynamics, cin, cin_ratio, wave_equation
from atc.upscaling.evolve import count_steps, modal, relative_density, relative_error, verlet


def naive_force(model, u, boundary):
    """ρ ü by the sums of the paper, (A.2) and (5.3), one bond at a time."""
    n, dx, M = len(u), model.spacing, model.neighbors
    out = np.zeros(n)
    for i in range(n):
        for j in (*range(-M, 0), *range(1, M + 1)):
            k = i + j
            other = u[k % n] if boundary == "periodic" else (u[k] if 0 <= k < n else 0.0)
            if isinstance(model, Springs):
                out[i] += model.weights[abs(j) - 1] * (other - u[i])
            else:
                y = j * dx + other - u[i]
                z12, z6 = (sum(q**-s for q in range(1, M + 1)) for s in (12.0, 6.0))
                s = dx * model.sigma
                out[i] -= 24 * model.epsilon * (2 / z12 * s**12 / y**13 - 1 / z6 * s**6 / y**7)
    return out


MODELS = [Springs.paper(0.5, 4, 1.7, 2.0), Springs(0.3, [1.0, -0.1, 0.05], 0.7), LennardJones(2.0, 3, density=1.5)]


@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
def test_forces_and_energies(model, boundary):
    u = np.random.default_rng(3).normal(0, 0.02 * model.spacing, 23)
    force = naive_force(model, u, boundary)
    np.testing.assert_allclose(model.acceleration(u, boundary) * model.density, force, rtol=1e-12, atol=1e-13)
    # −dE/du_i is the force on a node of length Δx: central differences, error h²
    h, numeric = 1e-5 * model.spacing, np.empty(len(u))
    for i in range(len(u)):
        step = np.zeros(len(u))
        step[i] = h
        numeric[i] = -(model.potential_energy(u + step, boundary) - model.potential_energy(u - step, boundary)) / (
            2 * h
        )
    np.testing.assert_allclose(numeric, force * model.spacing, rtol=1e-6, atol=1e-8 * np.abs(force).max())
    assert model.potential_energy(np.zeros(23), boundary) == 0


def test_paper_springs_are_equation_4_1():
    """m ÿ_i = Σ K(N)/|ja| (…) with m = ρa."""
    model = Springs.paper(0.25, 20)
    K = 2 / (20 * 21)
    np.testing.assert_allclose(model.weights * 0.25, [K / (j * 0.25) for j in range(1, 21)], rtol=1e-14)
    for dx, M in ((0.25, 20), (0.5, 10), (0.01, 500)):
        assert Springs.paper(dx, M, 3.0, 2.0).sound_speed == pytest.approx(math.sqrt(1.5), rel=1e-12)


@pytest.mark.parametrize("M", [3, 104])  # the sum over neighbours and the convolution
@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
def test_verlet_is_its_closed_form(boundary, M):
    """Every step of velocity Verlet equals the closed form of its powers, displacement and velocity, to rounding (1e-16
    a step, 200 steps)."""
    model = Springs.paper(1.0, M)
    rng = np.random.default_rng(1)
    u0, v0 = rng.normal(size=211), rng.normal(size=211)
    dt = 0.9 * model.stable_time_step
    run = verlet(model, u0, v0, dt=dt, steps=200, every=7, boundary=boundary)
    u, v = modal(model, u0, run.t_t, v0, boundary=boundary, dt=dt)
    scale = np.abs(run.u_tn).max()
    np.testing.assert_allclose(run.u_tn, u, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(run.v_tn, v, rtol=0, atol=1e-11 * scale)
    assert run.t_t[-1] == pytest.approx(200 * dt)
    np.testing.assert_allclose(run.potential_t, [model.potential_energy(w, boundary) for w in run.u_tn], rtol=1e-11)


def test_modal_is_exact():
    """d'Alembert for the wave equation; energy to rounding; Verlet converges to it at second order."""
    n, dx = 2048, 0.25
    x = np.arange(n) * dx
    u0 = bump(x, 256.0, 30.0)
    u, v = modal(wave_equation(), u0, 60.0, spacing=dx)
    np.testing.assert_allclose(u, 0.5 * (bump(x, 196.0, 30.0) + bump(x, 316.0, 30.0)), atol=1e-9)
    chain = Springs.paper(dx, 12)
    errors = []
    for steps in (100, 200):
        run = verlet(chain, u0, dt=60.0 / steps, steps=steps)
        errors.append(relative_error(run.u_tn[-1], modal(chain, u0, 60.0)[0]))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.05)
    u_t, v_t = modal(chain, u0, [0.0, 33.0, 1000.0])
    energy = [chain.potential_energy(a) + 0.5 * dx * (b @ b) for a, b in zip(u_t, v_t)]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    # between two steps: Hermite's cubic
    run = verlet(chain, u0, dt=0.1, steps=100)
    assert relative_error(run.at(5.05), modal(chain, u0, 5.05, dt=0.1)[0]) < 1e-6
    np.testing.assert_array_equal(run.at(5.0), run.u_tn[50])


@given(k=st.floats(1e-8, 200), M=st.integers(1, 40))
@settings(max_examples=60, deadline=None)
def test_dispersion(k, M):
    """A plane wave is an eigenvector of the force with −ρω²."""
    model = Springs.paper(0.3, M, 1.3, 0.8)
    wave = lambda x: np.exp(1j * k * x)  # noqa: E731
    force = sum(w * (wave(q * 0.3) + wave(-q * 0.3) - 2) for q, w in enumerate(model.weights, 1))
    assert float(model.frequency_squared(k)) == pytest.approx(
        -force.real / 0.8, rel=1e-6, abs=1e-13 * model.weights.sum()
    )


def test_cin_and_its_limits():
    import mpmath

    z = np.concatenate([np.logspace(-9, 1, 41), [1.999999, 2.0, 2.000001, 50.0, 1e4]])
    with mpmath.workdps(60):  # γ + ln z − Ci z cancels: twice the digits it loses
        exact = [float(mpmath.euler + mpmath.log(mpmath.mpf(v)) - mpmath.ci(mpmath.mpf(v))) for v in z]
    np.testing.assert_allclose(cin(z), exact, rtol=3e-14)
    np.testing.assert_allclose(cin(-z), cin(z), rtol=0)
    assert cin(0.0) == 0 and cin_ratio(0.0) == 1
    # kδ → 0: no 0/0, and the wave equation
    pd = Peridynamics(5.0, 2.0, 0.5)
    k = np.logspace(-12, -3, 10)
    np.testing.assert_allclose(pd.frequency(k), 2 * k * (1 - (5 * k) ** 2 / 48), rtol=1e-9)
    assert Peridynamics(0.0).frequency(3.0) == 3.0
    h = 1e-6
    np.testing.assert_allclose(
        pd.group_velocity(0.7), (pd.frequency(0.7 + h) - pd.frequency(0.7 - h)) / (2 * h), rtol=1e-8
    )
    assert pd.group_velocity(0.0) == pytest.approx(2.0)


def test_a_fine_chain_is_continuous_peridynamics():
    """ω of the chain goes to Cin's at first order in Δx with the paper's K(M), at second once δ² = a²N(N+1)."""
    k = np.linspace(0.05, 2, 30)
    errors = {}
    for M in (50, 100):
        a = 5.0 / M
        chain = Springs.paper(a, M).frequency(k)
        errors[M] = [np.abs(chain / Peridynamics(h).frequency(k) - 1).max() for h in (5.0, a * math.sqrt(M * (M + 1)))]
    assert math.log2(errors[50][0] / errors[100][0]) == pytest.approx(1, abs=0.1)
    assert math.log2(errors[50][1] / errors[100][1]) == pytest.approx(2, abs=0.1)


def test_numbers_of_the_paper():
    md, pd, ccm = Springs.paper(0.25, 20), Springs.paper(0.5, 10), Springs.paper(0.01, 20)
    assert count_steps(300, md.time_step()) == 184
    assert count_steps(300, pd.time_step()) == 162
    assert 2001 * 10 * 162 / (4001 * 20 * 184) == pytest.approx(0.22016, abs=5e-6)
    assert ccm.time_step() == pytest.approx(0.064940, abs=5e-7)
    slack = [(m := Springs.paper(5 / M, M)).stable_time_step / m.sufficient_time_step - 1 for M in range(4, 26)]
    assert 0.20 < min(slack) and max(slack) < 0.30
    for model in (md, pd, ccm, Springs.paper(0.01, 500)):
        cancelled = 2 * (model.time_step() / model.spacing) ** 2 / (model.neighbors * (model.neighbors + 1))
        assert 0.10 < cancelled < 0.25


def test_stability_limit():
    """At 0.999 of 2/ω_max a run stays bounded; at 1.001 it is refused, and rightly so."""
    model = Springs.paper(1.0, 6)
    u0 = square_pulse(np.arange(201.0), 100.0, 5.0)
    run = verlet(model, u0, dt=0.999 * model.stable_time_step, steps=3000, every=3000)
    assert np.abs(run.u_tn[-1]).max() < 30
    with pytest.raises(AtcError, match="unstable at and above"):
        verlet(model, u0, dt=1.001 * model.stable_time_step, steps=10)
    u, dt = [u0, u0 + 0.5 * (dt := 1.02 * model.stable_time_step) ** 2 * model.acceleration(u0)], dt
    for _ in range(1500):
        u = [u[1], 2 * u[1] - u[0] + dt**2 * model.acceleration(u[1])]
    assert not np.abs(u[1]).max() < 1e3


def test_horizon_exact_in_n():
    """Fine peridynamics with δ = a√(N(N+1)) against the exact chain: 0.55 %, with δ = Na 23.6 % (t = 150.05)."""
    chain, x = Springs.paper(0.25, 20), np.arange(20000) * 0.05
    exact, _ = modal(chain, bump(x[::5]), 150.05)

    def error(horizon):
        return relative_error(modal(Peridynamics(horizon), bump(x), 150.05, spacing=0.05)[0][::5], exact)

    assert error(5.0) == pytest.approx(0.236, abs=0.001)
    assert (
        error(0.25 * math.sqrt(20 * 21)) == pytest.approx(0.0055, abs=0.0001)
        and error(0.25 * math.sqrt(20 * 21)) < 0.01
    )


def test_bump():
    x = np.linspace(480, 520, 4001)
    u = bump(x)
    assert u[2000] == 1 and u[:1000].max() == 0 and u[3001:].max() == 0
    from math import comb

    s = np.linspace(0, 1, 11)
    exact = sum(comb(10 + j, j) * comb(21, 10 - j) * (-s) ** j for j in range(11)) * s**11
    np.testing.assert_allclose(smoothstep(s), exact, atol=1e-9)
    np.testing.assert_allclose(u, bump(1000 - x), atol=1e-14)


def test_relative_density():
    """A uniform stretch F of the inside has density 1/F there."""
    u = 0.05 * np.arange(50) * 0.5
    np.testing.assert_allclose(relative_density(u, 0.5)[1:-1], 1 / 1.05)
    np.testing.assert_allclose(relative_density(np.zeros((2, 9)), 1.0, "clamped"), 1)


# --------------------------------------------------------------------------------------------------------------------
# Lennard-Jones.


@pytest.mark.parametrize("M", [1, 2, 5])
def test_lennard_jones_chain(M):
    """At rest at its spacing; unit sound speed from the springs of its bonds; the stress of a stretch does not depend
    on M; small waves follow the linear chain."""
    chain = LennardJones(2.0, M)
    assert np.abs(chain.acceleration(np.zeros(31), "clamped")).max() < 1e-15
    assert chain.sound_speed == pytest.approx(1, rel=1e-14) and chain.linearised().sound_speed == pytest.approx(
        1, rel=1e-12
    )
    F = 1.03
    A, B = chain.coefficients
    r = np.arange(1, M + 1) * 2.0
    assert float(chain.stress(F)) == pytest.approx(
        float((r * (-12 * A / (F * r) ** 13 + 6 * B / (F * r) ** 7)).sum()), rel=1e-12
    )
    assert float(chain.stress(F)) == pytest.approx(float(LennardJones(1.0, 1).stress(F)), rel=1e-14)
    top = LJ_SPINODAL
    assert chain.stress(top) > chain.stress(top - 0.01) and chain.stress(top) > chain.stress(top + 0.01)
    x = np.arange(200) * 2.0
    u0 = 1e-5 * bump(x, 200.0, 40.0)
    run = verlet(chain, u0, dt=0.05, steps=800, every=800)
    assert relative_error(run.u_tn[-1], modal(chain.linearised(), u0, 40.0)[0]) < 1e-3


@pytest.mark.parametrize("spacing, M", [(1.0, 4), (2.0, 2), (4.0, 1)])
def test_lennard_jones_energy(spacing, M):
    """Total energy through shock formation: within 2e-3 at the paper's Δt = 0.1, falling as Δt²; ends and momentum."""
    x = np.arange(round(1000 / spacing) + 1) * spacing
    u0 = bump(x, half_width=100.0, amplitude=2.0)
    drift = []
    for dt in (0.1, 0.05):
        run = verlet(
            LennardJones(spacing, M), u0, dt=dt, steps=round(300 / dt), every=round(3 / dt), boundary="clamped"
        )
        drift.append(np.abs(run.total_t / run.total_t[0] - 1).max())
    assert drift[0] < 2e-3
    assert math.log2(drift[0] / drift[1]) == pytest.approx(2, abs=0.2)
    assert run.kinetic_t[0] == 0 and run.kinetic_t[-1] > 0.3 * run.total_t[0]
    closed = verlet(LennardJones(spacing, M), u0, dt=0.1, steps=500, every=100)
    assert np.abs(closed.v_tn.sum(axis=1)).max() < 1e-11


def test_beyond_the_spinodal():
    x = np.arange(1001.0)
    chain = LennardJones(1.0, 4)
    with pytest.raises(
        AtcError,
        match=r"at the start the bond between nodes 494 and 495 .* stretch 1\.65.* beyond the spinodal 1\.1087",
    ):
        verlet(chain, bump(x, amplitude=2.0), dt=0.1, steps=10)
    with pytest.raises(AtcError, match="changed places"):
        verlet(chain, bump(x, half_width=3.0, amplitude=8.0), dt=0.1, steps=10, beyond_spinodal="allow")
    # A bond that reaches the spinodal on the way: which, and when.
    v0 = np.where(x > 500, 0.2, -0.2)
    with pytest.raises(AtcError, match=r"at t = [\d.]+ the bond between nodes 500 and 501"):
        verlet(chain, np.zeros(1001), v0, dt=0.1, steps=3000)
    # Allowed, it breaks: no NaN, and energy stays.
    run = verlet(chain, np.zeros(1001), v0, dt=0.01, steps=3000, every=100, boundary="clamped", beyond_spinodal="allow")
    assert np.isfinite(run.u_tn).all() and np.diff(run.u_tn[-1]).max() > 5
    assert np.abs(run.total_t / run.total_t[0] - 1).max() < 1e-3
    # A step too long for a violent start ends in a message as well.
    with pytest.raises(AtcError, match="smaller time step"):
        verlet(chain, np.zeros(1001), -np.sign(x - 500) * 3.0, dt=0.5, steps=3000, beyond_spinodal="allow")


def test_square_pulse_does_not_converge_pointwise():
    """L2 differences are small, the value at nodes near the jump goes on changing by a tenth and more as Δx is halved
    from 0.5 to 1/64."""
    changes, before = [], None
    for M in (10, 20, 40, 80, 160, 320):
        x = np.arange(200 * M) * 5.0 / M
        u, _ = modal(Springs.paper(5.0 / M, M), square_pulse(x), 60.4)
        coarse = u[:: M // 10]
        if before is not None:
            changes.append((np.abs(coarse - before).max(), relative_error(before, coarse)))
        before = coarse
    assert min(c[0] for c in changes) > 0.1 and changes[-1][0] > 0.3
    # a smooth start does converge, at second order with the horizon that is exact in N
    smooth = [
        modal(Springs.paper(5.0 / M, M), bump(np.arange(200 * M) * 5.0 / M), 60.4)[0][:: M // 10]
        for M in (80, 160, 320)
    ]
    assert np.abs(smooth[2] - smooth[1]).max() < 0.6 * np.abs(smooth[1] - smooth[0]).max() < 0.01


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: Springs.paper(0.0, 3), "spacing = 0.0: expected"),
        (lambda: Springs.paper(1.0, 0), "neighbors = 0: expected a whole number"),
        (lambda: Springs(1.0, [[1.0]]), "weights of a chain"),
        (lambda: Springs.peridynamics(5.0, 0.3), "not a multiple"),
        (lambda: LennardJones(1.0, 2, sigma=1.0), "equilibrium"),
        (lambda: verlet(Springs.paper(1.0, 5), np.zeros(10), dt=0.1, steps=1), "at least 11 nodes"),
        (lambda: verlet(Springs.paper(1.0, 1), np.full(10, np.nan), dt=0.1, steps=1), "finite number for each node"),
        (lambda: verlet(Springs.paper(1.0, 1), np.zeros(10), dt=0.1, steps=1, boundary="free"), "periodic, clamped"),
        (lambda: verlet(Peridynamics(1.0), np.zeros(10), dt=0.1, steps=1), "not a chain"),
        (lambda: modal(LennardJones(1.0, 1), np.zeros(10), 1.0), "only linear models"),
        (lambda: modal(Springs(1.0, [1.0, -0.5]), np.zeros(10), 1.0), "unstable"),
        (lambda: Peridynamics(-1.0), "horizon"),
    ],
)
def test_refused(call, message):
    with pytest.raises(AtcError, match=message) as e:
        call()
    assert "\n" not in str(e.value)


def lammps_chain(model, u0, dt, steps, pair, bonds=()):
    """Positions, velocities and total energy of a periodic chain along x after `steps` steps of LAMMPS's own velocity
    Verlet."""
    from lammps_oracle import lammps_session

    n, dx = len(u0), model.spacing
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units lj
            atom_style bond
            atom_modify map array
            region box block 0 {n * dx} -50 50 -50 50
            create_box 1 box{" bond/types " + str(len(bonds)) + " extra/bond/per/atom 40 extra/special/per/atom 4000" if bonds else ""}
            mass 1 {model.density * dx!r}
            comm_modify cutoff {3 * max(model.horizon, 1.0)}
            timestep {dt!r}
        """)
        x = np.zeros((n, 3))
        x[:, 0] = np.arange(n) * dx + u0
        lmp.create_atoms(n, list(range(1, n + 1)), [1] * n, x.ravel().tolist())
        lmp.commands_string(pair)
        if bonds:
            lmp.command("special_bonds lj 1 1 1")
            lmp.commands_string(
                "bond_style harmonic\n" + "\n".join(f"bond_coeff {q} {k!r} {q * dx!r}" for q, k in enumerate(bonds, 1))
            )
            for q in range(1, len(bonds) + 1):
                for i in range(n):
                    lmp.command(f"create_bonds single/bond {q} {i + 1} {(i + q) % n + 1} special no")
        lmp.commands_string(f"fix 1 all nve\nthermo_modify norm no\nrun {steps} post no")
        order = np.argsort(lmp.numpy.extract_atom("id")[:n])
        image = lmp.numpy.extract_atom("image")[:n][order]
        unwrapped = lmp.numpy.extract_atom("x")[:n, 0][order] + ((image & 1023) - 512) * n * dx
        v = lmp.numpy.extract_atom("v")[:n, 0][order].copy()
        return unwrapped, v, lmp.get_thermo("etotal")


@pytest.mark.parametrize("spacing, M", [(1.0, 4), (2.0, 2)])
def test_lennard_jones_chain_is_lammps(spacing, M):
    """The same chain as `pair_style lj/cut` with a cutoff between the M-th and the next neighbour: positions after 2000
    steps, through the shock."""
    x = np.arange(300) * spacing
    u0 = bump(x, 150 * spacing, 60.0 * spacing, 1.2 * spacing)
    chain = LennardJones(spacing, M, density=1.3)
    A, B = (c * spacing for c in chain.coefficients)  # of one bond, not per length
    sigma, epsilon = (A / B) ** (1 / 6), B * B / (4 * A)
    run = verlet(chain, u0, dt=0.1, steps=2000, every=50)
    # No other bond ever comes within the cutoff, and none of these leaves it.
    y = x + run.u_tn
    y = np.concatenate([y, y + 300 * spacing], axis=1)
    cutoff = (M + 0.5) * spacing
    assert (y[:, M : 300 + M] - y[:, :300]).max() < cutoff < (y[:, M + 1 : 301 + M] - y[:, :300]).min()
    positions, velocities, energy = lammps_chain(
        chain, u0, 0.1, 2000, f"pair_style lj/cut {cutoff!r}\npair_coeff 1 1 {epsilon!r} {sigma!r}"
    )
    # rounding of positions near 300 (6e-14), two thousand steps
    np.testing.assert_allclose(positions - x, run.u_tn[-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(velocities, run.v_tn[-1], rtol=0, atol=1e-9)
    rest = 300 * sum(
        4 * epsilon * ((sigma / (j * spacing)) ** 12 - (sigma / (j * spacing)) ** 6) for j in range(1, M + 1)
    )
    assert energy - rest == pytest.approx(run.total_t[-1], rel=1e-8)
    assert run.density_tn.max() > 1.05, "there is a shock"


def test_springs_are_lammps():
    """`bond_style harmonic` (K r² with K half the stiffness) to five neighbours: 300 steps."""
    model = Springs.paper(0.5, 5, 1.4, 0.9)
    x = np.arange(80) * 0.5
    u0 = bump(x, 20.0, 6.0, 0.3)
    stiffness = model.weights * model.spacing  # per bond
    dt = model.time_step()
    run = verlet(model, u0, dt=dt, steps=300, every=300)
    positions, velocities, energy = lammps_chain(
        model, u0, dt, 300, "pair_style zero 4.0\npair_coeff * *", [float(k) / 2 for k in stiffness]
    )
    np.testing.assert_allclose(positions - x, run.u_tn[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(velocities, run.v_tn[-1], rtol=0, atol=1e-10)
    assert energy == pytest.approx(run.total_t[-1], rel=1e-9)
