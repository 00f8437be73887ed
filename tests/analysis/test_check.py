"""atc check: laws hold to the promised accuracy, and everything that breaks one is found and named."""

import json

import energy_systems
import numpy as np
import pytest
from frames import argon
from lammps_oracle import Config, lammps_session, thermal_lattice
from naive_fields import site_sum
from test_decomposers_eam import POTENTIALS
from typer.testing import CliRunner

import atc
from atc.analysis.check import check
from atc.bonds import Bonds
from atc.cli import app
from atc.estimators import balance
from atc.estimators.balance import limits
from atc.kernels import kernel
from atc.units import units

SILICON = """pair_style sw
pair_coeff * * Si.sw Si"""
SMOOTH = "pair_style lj/smooth/linear 8.0\npair_coeff 1 1 0.0104 3.4"
LAWS = ("mass", "momentum", "energy", "churning")


def hot(config, temperature, seed=0):
    """The frame of a `Config` with thermal velocities and a drift."""
    frame = config.frame()
    rng = np.random.default_rng(seed)
    v = rng.normal(size=frame.positions.shape) * np.sqrt(frame.units.boltzmann * temperature / frame.masses)[:, None]
    return frame.replace(velocities=v + [0.02, -0.01, 0.005])


def silicon_config(seed=0, shake=0.05):
    rng = np.random.default_rng(seed)
    a, cells = 5.431, 2
    basis = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corners + basis) * a).reshape(-1, 3)
    return Config(np.full(3, a * cells), x + rng.uniform(-shake, shake, x.shape), masses={1: 28.0855})


@pytest.fixture(scope="module")
def sw_lines():
    from pathlib import Path

    return SILICON.replace("Si.sw", str(Path(__file__).resolve().parents[2] / "data" / "silicon_plate" / "Si.sw"))


def eam():
    x, t = thermal_lattice(np.diag([8.2, 9.0, 10.4]), (3, 4, 4), jitter=0.15, kinds=2, seed=4)
    config = Config(
        np.array([[8.2, 0, 0], [3.1, 9.0, 0], [-2.6, 3.3, 10.4]]), x, types=t, masses={1: 63.546, 2: 26.98}, ntypes=2
    )
    return hot(config, 600), atc.potential(
        f"pair_style eam/alloy\npair_coeff * * {POTENTIALS}/AlCu.eam.alloy Cu Al", units="metal"
    )


def melt():
    from pathlib import Path

    folder = Path(__file__).resolve().parents[2] / "data" / "melt"
    return atc.read(folder / "melt.dump.gz", topology=folder / "melt.data")[3], atc.potential(folder / "in.melt")


def case(name, sw_lines):
    if name == "lj":
        frame = argon("tilted", n=(3, 3, 3))
        return (
            frame,
            atc.potential("pair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3", units="metal"),
            1.6,
        )
    if name == "sw":
        return hot(silicon_config(shake=0.2), 600), atc.potential(sw_lines, units="metal"), 1.6
    if name in ("nep", "snap"):
        return (*energy_systems.system(name), 1.6)
    return (*eam(), 1.6) if name == "eam" else (*melt(), 0.7)


@pytest.mark.parametrize(
    "name, churns", [("lj", None), ("sw", 1e-3), ("eam", None), ("melt", 1e-4), ("nep", None), ("snap", None)]
)
def test_laws_hold(name, churns, sw_lines):
    """Rounding in closed form; 1e-10 from the fields (rounding of a field over a step of width/400); heat flux without
    churning is wrong.

    Embedded atoms have none: with each embedding energy at its own atom, ∂U^(i)/∂x_j runs along the bond and z = S + M
    cancels bond by bond.
    """
    frame, pot, width = case(name, sw_lines)
    report = check(frame, pot, kernel("gaussian", width=width), atc.Grid.regular(shape=(4, 4, 4)), points=10)
    assert report.ok, report.verdict
    assert report.data["points"] == {"random": 10, "grid": 10}
    for law in LAWS:
        got = report.data["laws"][law]
        assert got["chain_rule"]["residual"] < 1e-12
        assert got["fields"]["residual"] < 1e-10
        assert got["fields"]["limit"] < 1e-9
        assert got["largest"] > 0
    energy = report.data["laws"]["energy"]
    if churns is None:
        assert any("no churning heat flux" in line for line in report.verdict)
        assert energy["fields"]["without_churning"] < 1e-10
    else:
        assert any("without the churning heat flux it would be off" in line for line in report.verdict)
        assert energy["chain_rule"]["without_churning"] > churns
        # two ways to the same number: z:∇v in closed form, and the divergence of z·v on stencils
        assert abs(energy["fields"]["without_churning"] / energy["chain_rule"]["without_churning"] - 1) < 1e-6
    assert set(report.data["fields_against_own_sums"]) >= {
        "density",
        "momentum",
        "velocity",
        "energy",
        "stress",
        "heat_flux",
        "churning",
    }
    json.loads(report.json())


# What stencils can do near the kinks of each kernel, and whether they can do anything where it jumps.
STENCILS = {
    "step": None,
    "box": None,
    "linear": 1e-4,
    "hardy": 1e-4,
    "cubic": 1e-7,
    "quartic": 1e-7,
    "lucy": 1e-8,
    "bspline": 1e-8,
}


@pytest.mark.parametrize("name", STENCILS)
def test_every_kernel(name, sw_lines):
    frame, pot, _ = case("sw", sw_lines)
    kern = kernel(name, radius=4.0)
    report = check(frame, pot, kern, points=8)
    assert report.ok, report.verdict
    for law in LAWS:
        got = report.data["laws"][law]
        assert got["chain_rule"]["residual"] < 1e-12
        if STENCILS[name] is not None:
            assert got["fields"]["residual"] < STENCILS[name]
    assert any("jumps" in note for note in report.notes) == (STENCILS[name] is None)


def test_drift_costs_no_digits(sw_lines):
    """A drift of 1e6 Å per time unit, 1e7 thermal speeds: its last digit is 1e-10, 1e-9 of a velocity."""
    frame, pot, width = case("sw", sw_lines)
    fast = frame.replace(velocities=frame.velocities + [1e6, -3e5, 2e5])
    reports = [check(f, pot, kernel("gaussian", width=width), points=6) for f in (frame, fast)]
    assert reports[1].ok
    for law in LAWS:
        a, b = (r.data["laws"][law] for r in reports)
        assert abs(a["largest"] / b["largest"] - 1) < 1e-7
        assert b["fields"]["residual"] < 1e-10


# ---- the closed forms against differences in time


def test_exact_rates(sw_lines):
    """Rates of ρ, ρ v and ε against differences of naive sums with all atoms moved, forces from differences of nothing
    but energies."""
    frame, pot, width = case("sw", sw_lines)
    kern = kernel("gaussian", width=width)
    x_gc = frame.cell.cartesian(np.random.default_rng(1).random((3, 3)))
    state = balance.motion(frame, pot)
    exact = balance.Exact(balance.Sites(x_gc, frame.positions, frame.cell, kern), state, np.zeros((3, 21)))
    F = np.zeros((4, 3))
    h = 2e-3
    for k in range(4):
        for c in range(3):
            for steps, weight in ((1, 2 / 3), (-1, -2 / 3), (2, -1 / 12), (-2, 1 / 12)):
                x = frame.positions.copy()
                x[k, c] += steps * h
                F[k, c] -= weight * pot.stream(frame.replace(positions=x)).energy / h
    # error of fourth order, h⁴ U⁗'/30 with U⁗' of some 1e2 eV/Å⁵
    np.testing.assert_allclose(state.forces_nc[:4], F, rtol=0, atol=1e-8)

    def at(t):
        x, v = frame.positions + t * state.v_nc, state.v_nc + t * state.forces_nc / frame.masses[:, None]
        e = pot.stream(frame.replace(positions=x), energies=True).energies_n + 0.5 * frame.masses * (v * v).sum(1)
        a = np.concatenate([frame.masses[:, None], frame.masses[:, None] * v, e[:, None]], axis=1)
        return site_sum(x_gc, x, a, kern, frame.cell)

    t = 1e-3 / np.abs(state.v_nc).max()
    rate = (8 * (at(t) - at(-t)) - (at(2 * t) - at(-2 * t))) / (12 * t)
    for got, want in (
        (exact.rho_t[:, None], rate[:, :1]),
        (exact.pi_t, rate[:, 1:4]),
        (exact.energy_t[:, None], rate[:, 4:]),
    ):
        # rounding 1e-15/1e-3 of the sum, fourth order in 1e-3
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * np.abs(want).max())


def test_sites_against_the_naive_sums():
    """A kernel wider than the cell, open and periodic axes, points anywhere."""
    for cell in ("tilted", "slab", "open"):
        frame = argon(cell)
        kern = kernel("lucy", radius=12.0)
        x_gc = frame.cell.cartesian(np.random.default_rng(0).uniform(-0.2, 1.2, (5, 3)))
        x_gc = frame.cell.wrap(x_gc)[0]
        a = np.random.default_rng(1).normal(size=(len(frame), 2))
        got = balance.Sites(x_gc, frame.positions, frame.cell, kern).sum(a)
        want = site_sum(x_gc, frame.positions, a, kern, frame.cell)
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-13 * np.abs(want).max())


def test_divergence_of_polynomials():
    """Sixth order: exact for polynomials of degree six."""
    x_gc = np.random.default_rng(0).normal(size=(4, 3))
    p = balance.stencil(x_gc, 0.1)
    x, y, z = p.T
    got, error = balance.divergence(np.stack([x**6 + y, x * y**5, z**4 * x**2], axis=1), 0.1)
    x, y, z = x_gc.T
    want = 6 * x**5 + 5 * x * y**4 + 4 * z**3 * x**2
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert (error > 1e-8).all()  # those of fourth order are not exact


# ---- teeth


class Spoiled:
    """A potential that spoils the bonds it hands out."""

    def __init__(self, pot, spoil):
        self.pot, self.spoil = pot, spoil

    def __getattr__(self, name):
        return getattr(self.pot, name)

    def stream(self, frame, consume=None, **options):
        def changed(bonds, thread):
            consume(self.spoil(bonds.copy()), thread)

        return self.pot.stream(frame, None if consume is None else changed, **options)


def _flip(bonds: Bonds) -> Bonds:
    if bonds.D_bdc is not None:
        bonds.D_bdc *= -1
    return bonds


def _half_of_a_pair(bonds: Bonds) -> Bonds:
    if bonds.D_bdc is not None:
        bonds.D_bdc[:, 0] *= 1.001
    return bonds


def _moved_shares(bonds: Bonds) -> Bonds:
    """The force's share stays right, the energies are others: Σ_p ∂U^(p)/∂x_k is kept, single derivatives are not."""
    if bonds.D_bdc is not None:
        bonds.D_bdc += 0.1 * bonds.G_b[:, None, None] * bonds.r_bc[:, None, :]
    return bonds


@pytest.mark.parametrize(
    "spoil, word", [(_flip, "energy balance"), (_half_of_a_pair, "energy balance"), (_moved_shares, "energy sources")]
)
def test_wrong_sources_are_found(spoil, word, sw_lines):
    frame, pot, width = case("sw", sw_lines)
    report = check(frame, Spoiled(pot, spoil), kernel("gaussian", width=width), points=4)
    assert not report.ok
    assert any(line.startswith("BROKEN") and word in line for line in report.verdict), report.verdict


def test_wrong_stress_is_found(sw_lines):
    """Bonds that carry 0.1 % more than the forces they are said to make."""
    frame, pot, width = case("sw", sw_lines)

    def spoil(bonds):
        bonds.G_b *= 1.001
        return bonds

    report = check(frame, Spoiled(pot, spoil), kernel("gaussian", width=width), points=4)
    assert not report.ok
    assert any("BROKEN: momentum balance from the fields" in line for line in report.verdict), report.verdict


@pytest.mark.parametrize("field, sign", [("heat_flux", 0.0), ("heat_flux", -1.0), ("stress", -1.0), ("churning", -1.0)])
def test_wrong_fields_are_found(field, sign, sw_lines, monkeypatch):
    """What `atc.fields` writes without its churning part (0) or with a part of the wrong sign (−1)."""
    frame, pot, width = case("sw", sw_lines)
    original = balance.from_fields

    def wrong(*args):
        out = original(*args)
        if field == "heat_flux":
            out["heat_flux"] = out["heat_flux"] + (sign - 1.0) * out["heat_flux_churning"]
        else:
            out[field] = sign * out[field]
        return out

    monkeypatch.setattr(balance, "from_fields", wrong)
    report = check(frame, pot, kernel("gaussian", width=width), points=4)
    assert not report.ok
    assert any(line.startswith("BROKEN") for line in report.verdict)
    if field == "heat_flux":
        assert report.data["laws"]["energy"]["fields"]["residual"] > 1e-3
        assert report.data["laws"]["momentum"]["fields"]["holds"]


# ---- differences between frames


def run(
    folder, lines, config, *, timestep, every, frames=9, temperature=600.0, warm=100, form="%.17g", then=(), time=True
):
    """A short constant-energy run of live LAMMPS; the dump's name."""
    data, dump = folder / "config.data", folder / "run.dump"
    config.write_data(data)
    with lammps_session() as lmp:
        for line in [
            f"units {config.units}",
            "atom_modify map array",
            "box tilt large",
            f"read_data {data}",
            *lines.splitlines(),
            f"velocity all create {temperature} 48 mom yes",
            f"timestep {4 * timestep}",
            "fix move all nve",
            f"run {warm}",
            *then,
            f"timestep {timestep}",
            "reset_timestep 0 time 0.0",
            f"dump out all custom {every} {dump} id type x y z vx vy vz",
            f"dump_modify out sort id time {'yes' if time else 'no'} units yes format float {form}",
            f"run {every * (frames - 1)}",
        ]:
            lmp.command(line)
    return dump


def liquid():
    x, _ = thermal_lattice(np.full(3, 17.4), (5, 5, 5), jitter=0.1, seed=3)
    return Config(np.full(3, 17.4), x, masses={1: 39.948})


@pytest.fixture(scope="module")
def silicon_run(tmp_path_factory, sw_lines):
    """0.2 fs between frames, 0.05 fs a step."""
    folder = tmp_path_factory.mktemp("silicon")
    return atc.read(run(folder, sw_lines, silicon_config(), timestep=5e-5, every=4), masses={1: 28.0855})


@pytest.fixture(scope="module")
def argon_run(tmp_path_factory):
    """1 fs between frames, 0.2 fs a step."""
    folder = tmp_path_factory.mktemp("argon")
    return atc.read(run(folder, SMOOTH, liquid(), timestep=2e-4, every=5, temperature=80.0), masses={1: 39.948})


def test_frames_are_second_order(silicon_run, argon_run, sw_lines):
    """The residual falls with the square of the spacing, and what is left belongs to the run's own time step."""
    for traj, lines, name, radius in ((silicon_run, sw_lines, "gaussian", 4.8), (argon_run, SMOOTH, "lucy", 6.0)):
        report = check(traj, atc.potential(lines, units="metal"), kernel(name, radius=radius))
        assert report.ok, report.verdict
        for law in ("mass", "momentum", "energy"):
            got = report.data["laws"][law]["frames"]
            # 0.1: the run's own time step adds a residual of order (1/16 … 1/25) to that of the smallest spacing
            np.testing.assert_allclose(got["order"], 2.0, atol=0.1)
            assert len(got["residuals"]) == 3
            assert got["residual"] < 0.2 * got["residuals"][0] < 1e-4
            assert got["holds"] is True
    # silicon needs its churning heat flux
    silicon = check(silicon_run, atc.potential(sw_lines, units="metal"), kernel("gaussian", radius=4.8))
    energy = silicon.data["laws"]["energy"]
    assert energy["frames"]["without_churning"] > 1e-3
    assert abs(energy["frames"]["without_churning"] / energy["chain_rule"]["without_churning"] - 1) < 1e-2
    assert any("residuals fall with the spacing to the power" in line for line in silicon.verdict)


def test_fewer_frames(argon_run):
    pot, kern = atc.potential(SMOOTH, units="metal"), kernel("lucy", radius=6.0)
    for n, spacings in ((3, 1), (5, 2)):
        report = check(argon_run[:n], pot, kern, points=5)
        assert report.ok
        assert len(report.data["laws"]["energy"]["frames"]["dt"]) == spacings
    report = check(argon_run[:2], pot, kern, points=5)
    assert "frames" not in report.data["laws"]["energy"]
    assert any("at least 3 frames" in note for note in report.notes)


def test_wrong_potential_and_masses_are_found(argon_run):
    kern = kernel("lucy", radius=6.0)
    wrong = check(argon_run, atc.potential(SMOOTH.replace("0.0104", "0.0105"), units="metal"), kern, points=5)
    assert not wrong.ok
    assert wrong.data["laws"]["mass"]["frames"]["holds"]
    # 1 % of the forces, measured against a largest term that may be another one
    assert 1e-3 < wrong.data["laws"]["momentum"]["frames"]["residual"] < 2e-2
    assert any("is the potential that of the run" in line for line in wrong.verdict)
    heavy = atc.read([f.replace(masses=1.01 * f.masses) for f in argon_run])
    assert not check(heavy, atc.potential(SMOOTH, units="metal"), kern, points=5).ok


@pytest.mark.parametrize("fix", ["fix heat all langevin 80 80 0.1 4848", "unfix move\nfix move all nvt temp 80 80 0.1"])
def test_thermostats_are_found(fix, tmp_path):
    dump = run(tmp_path, SMOOTH, liquid(), timestep=2e-4, every=5, temperature=80.0, then=fix.splitlines())
    report = check(
        atc.read(dump, masses={1: 39.948}), atc.potential(SMOOTH, units="metal"), kernel("lucy", radius=6.0), points=5
    )
    assert not report.ok
    assert report.data["laws"]["energy"]["frames"]["holds"] is False
    assert report.data["laws"]["energy"]["fields"]["holds"] is True


def test_drifting_run(argon_run):
    """A uniform motion of 1e4 thermal speeds, frame by frame exactly: same residuals."""
    pot, kern = atc.potential(SMOOTH, units="metal"), kernel("lucy", radius=6.0)
    V = argon_run.units.to_internal("velocity", np.array([1e4, -2e3, 0.0]))
    moving = atc.read([f.replace(positions=f.positions + V * f.time, velocities=f.velocities + V) for f in argon_run])
    a, b = (check(t, pot, kern, points=5).data["laws"] for t in (argon_run, moving))
    assert b["energy"]["frames"]["holds"]
    for law in ("mass", "momentum", "energy"):
        # positions 40 Å further on and velocities 1e4 times as large: digits lost are 1e-16 · 1e4 · 1 Å over
        # differences of 1e-6 Å
        np.testing.assert_allclose(b[law]["frames"]["residuals"], a[law]["frames"]["residuals"], rtol=1e-4)


def test_jumps_and_digits_limit(tmp_path):
    """An unshifted potential and six digits: both named, with the right size."""
    lines = "pair_style lj/cut 8.0\npair_coeff 1 1 0.0104 3.4"
    dump = run(tmp_path, lines, liquid(), timestep=2e-4, every=5, temperature=80.0)
    traj = atc.read(dump, masses={1: 39.948})
    pot, kern = atc.potential(lines, units="metal"), kernel("lucy", radius=6.0)
    report = check(traj, pot, kern, points=5)
    assert report.ok, report.verdict
    (jump,) = report.data["cutoff_jumps"]
    s6 = (3.4 / 8.0) ** 6
    assert jump["energy"] == pytest.approx(4 * 0.0104 * (s6**2 - s6), rel=1e-6)
    assert jump["force"] == pytest.approx(-24 * 0.0104 * (2 * s6**2 - s6) / 8.0, rel=1e-6)
    assert any("ends at its cutoff" in note and "energy" in note for note in report.notes)
    energy = report.data["laws"]["energy"]["frames"]
    assert max(energy["limits"], key=energy["limits"].get) == "jumps at the cutoff"
    # how many cross it, by moving the atoms: 1 % of a picosecond, hundreds of crossings
    frame = traj[4]
    (found,) = limits.cutoff_jumps(frame, pot)
    t = frame.units.to_internal("time", 0.05)
    lists = []
    for x in (frame.positions, frame.positions + t * frame.velocities):
        bonds = pot.decompose(frame.replace(positions=x)).bonds
        shift = np.rint((x[bonds.i] - x[bonds.j] - bonds.r_bc) @ frame.cell.inverse).astype(int)
        both = (bonds.i, bonds.j, shift), (bonds.j, bonds.i, -shift)
        lists.append(
            {(i, j, tuple(n)) for a, b, s in both for i, j, n in zip(a.tolist(), b.tolist(), s.tolist(), strict=True)}
        )
    crossed = len(lists[0] ^ lists[1]) / 2
    assert crossed > 100
    assert found.crossings * t == pytest.approx(crossed, rel=0.2)  # Poisson, and the shell's own few hundred pairs

    coarse = run(tmp_path, SMOOTH, liquid(), timestep=2e-4, every=5, temperature=80.0, form="%g")
    report = check(atc.read(coarse, masses={1: 39.948}), atc.potential(SMOOTH, units="metal"), kern, points=5)
    assert report.ok, report.verdict
    mass = report.data["laws"]["mass"]["frames"]
    assert max(mass["limits"], key=mass["limits"].get) == "precision of the file"
    assert 0.02 < mass["residual"] / mass["limit"] <= 1.0


def test_noise_of_rounding_against_rounded_frames():
    frame = argon("tilted", n=(3, 3, 3))
    pot = atc.potential("pair_style lj/smooth/linear 6.0\npair_coeff * * 0.0104 3.4", units="metal")
    kern = kernel("gaussian", width=1.6)
    x_gc = frame.cell.cartesian(np.random.default_rng(1).random((4, 3)))
    state = balance.motion(frame, pot)
    exact = balance.Exact(balance.Sites(x_gc, frame.positions, frame.cell, kern), state, np.zeros((4, 21)))
    dx, dv = 1e-4, 1e-5
    want = limits.resolution_noise(exact, dx, dv)
    rng = np.random.default_rng(5)
    samples = []
    for _ in range(60):
        near = frame.replace(
            positions=frame.positions + dx * (rng.random((len(frame), 3)) - 0.5),
            velocities=frame.velocities + dv * (rng.random((len(frame), 3)) - 0.5),
        )
        samples.append(balance.sums_of_frame(near, pot, x_gc, kern, state.drift, np.zeros(3), 1))
    for law in ("mass", "momentum", "energy"):
        spread = np.array([s[law] for s in samples]).std(0).reshape(4, -1)
        # energy: correlations of neighbours are left out; 60 samples know a deviation to 10 %
        np.testing.assert_array_less(np.sqrt((spread**2).sum(1)), 2.0 * want[law])
        np.testing.assert_array_less(want[law], 4.0 * np.sqrt((spread**2).sum(1)))


def test_times_that_cannot_be_used(argon_run):
    pot, kern = atc.potential(SMOOTH, units="metal"), kernel("lucy", radius=6.0)

    def note(change, **options):
        report = check(atc.read([change(f) for f in argon_run]), pot, kern, points=3, **options)
        assert "frames" not in report.data["laws"]["mass"]
        return next(n for n in report.notes if "no differences between frames" in n)

    assert "timestep" in note(lambda f: f.replace(time=None))
    assert "too far" in note(lambda f: f.replace(time=f.time * 1e4))
    assert "times as far as their velocities say" in note(lambda f: f.replace(time=f.time * 10))
    assert "evenly" in note(lambda f: f.replace(time=f.time**1.1))
    assert "cell changes" in note(lambda f: f.replace(cell=atc.Cell(f.cell.vectors * (1 + 1e-6 * f.step))))
    assert "same atoms" in note(lambda f: f.replace(ids=f.ids + f.step))
    still = check(atc.read([f.replace(time=None) for f in argon_run]), pot, kern, points=3, timestep=2e-4)
    assert still.data["laws"]["mass"]["frames"]["holds"]


def test_odd_frames():
    """One atom, atoms at rest, an open box, lj units."""
    pot = atc.potential("pair_style lj/cut 2.5\npair_coeff 1 1 1.0 1.0", units="lj")
    cell = atc.Cell([8.0, 8.0, 8.0], periodic=(False, True, True))
    kern = kernel("quartic", radius=2.0)
    x = np.array([[4.0, 4.0, 4.0], [5.1, 4.0, 4.2], [4.3, 5.2, 3.9]])
    v = np.array([[0.3, -1.0, 0.2], [1.0, 0.2, 0.0], [-0.4, 0.1, 0.5]])
    for n, speed in ((3, 1.0), (3, 0.0), (1, 1.0)):
        frame = atc.Frame(x[:n], cell, units("lj"), masses=np.ones(n), velocities=speed * v[:n])
        report = check(frame, pot, kern, points=5)
        assert report.ok, report.verdict
        json.loads(report.json())


# ---- the command

SCENE = """\
[trajectory]
file = "run.dump"
masses = {{ 1 = 39.948 }}

[potential]
lammps = '''
{lines}
'''

[kernel]
name = "lucy"
radius = 6.0

[grid]
kind = "regular"
shape = [4, 4, 4]

[check]
points = 5
"""


def command(*args):
    return CliRunner().invoke(app, ["check", *map(str, args)], prog_name="atc")


def test_command(tmp_path):
    run(tmp_path, SMOOTH, liquid(), timestep=2e-4, every=5, temperature=80.0)
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(lines=SMOOTH))
    done = command(scene)
    assert done.exit_code == 0, done.output
    assert "energy balance holds to" in done.stdout and "5 random points and 5 points of the grid" in done.stdout
    assert "frames 0.001, 0.002, 0.004 ps apart" in done.stdout
    got = json.loads(command(scene, "--json", "--points", 3, "--set", "check.seed=7").stdout)
    assert got["holds"] is True and got["points"]["random"] == 3 and got["frame"] == 4
    assert set(got["laws"]) == set(LAWS)
    assert command(scene, "-e", 1).exit_code == 0
    quiet = command(scene, "-q", "-e", 1)
    assert quiet.exit_code == 0 and quiet.stdout == ""

    scene.write_text(SCENE.format(lines=SMOOTH.replace("3.4", "3.41")))
    broken = command(scene)
    assert broken.exit_code == 1
    assert "BROKEN: momentum balance from differences between frames" in broken.stdout
    assert json.loads(command(scene, "--json").stdout)["holds"] is False


@pytest.mark.parametrize(
    "change, words",
    [
        (("[kernel]\nname", "[fields]\n#"), "no [kernel] section"),
        (("points = 5", "points = 0"), "[check] points"),
        (("points = 5", "seed = -1"), "[check] seed"),
        (("points = 5", "timestep = 0"), "[check] timestep"),
        (("points = 5", "pints = 5"), "did you mean 'points'"),
        (("[potential]\nlammps = '''", "[fields]\n#"), None),
    ],
)
def test_command_refuses(change, words, tmp_path):
    run(tmp_path, SMOOTH, liquid(), timestep=2e-4, every=5, frames=1, warm=1)
    text = SCENE.format(lines=SMOOTH)
    if words is None:
        text = text[: text.index("[potential]")] + text[text.index("[kernel]") :]
        words = "no [potential] section"
    elif "kernel" in words:
        text = text.replace('[kernel]\nname = "lucy"\nradius = 6.0\n', "")
    else:
        text = text.replace(*change)
    (tmp_path / "scene.toml").write_text(text)
    done = command(tmp_path / "scene.toml")
    assert done.exit_code == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and words in lines[0], done.stderr


def test_velocities_are_needed(argon_run):
    frame = argon_run[0].replace(velocities=None)
    with pytest.raises(atc.AtcError, match="velocities are missing but a balance law needs them"):
        check(frame, atc.potential(SMOOTH, units="metal"), kernel("lucy", radius=6.0))
