"""Thermal conductivity by Green and Kubo: the mathematics on synthetic currents of known integral, the currents against
LAMMPS, and (slow) argon."""

import json

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.analysis.green_kubo import _pm
from atc.errors import AtcError, AtcWarning
from atc.estimators.correlation import autocorrelation, plateau, running_integral, segment_integrals
from atc.frame import Cell, Frame
from atc.units import units


def ornstein_uhlenbeck(rng, n, dt, parts):
    """(n, 3) Gaussian series with C(t) = Σ a exp(−t/τ) cos(ωt) for (a, τ, ω) in `parts`, exact at the samples."""
    from scipy.signal import lfilter

    x = np.zeros((n, 3))
    for a, tau, omega in parts:
        pole = np.exp((-1.0 / tau + 1j * omega) * dt)
        e = (rng.normal(size=(n, 3)) + 1j * rng.normal(size=(n, 3))) * np.sqrt(a)
        e[1:] *= np.sqrt(1.0 - abs(pole) ** 2)  # the first sample is in equilibrium already
        x += lfilter([1.0], [1.0, -pole], e, axis=0).real
    return x


def integral_of(dt, parts):
    """The trapezoidal sum of C from 0 to ∞: a geometric series."""
    return sum(a * dt * (1.0 / (1.0 - np.exp((-1.0 / tau + 1j * omega) * dt)) - 0.5).real for a, tau, omega in parts)


def of_array(J, dt=0.04, **more):
    # lj units, V = T = 1: the conductivity is the integral itself.
    return atc.conductivity(J, dt=dt, volume=1.0, temperature=1.0, units="lj", **more)


# ---- the pieces


def test_autocorrelation_is_the_sum_over_pairs():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(37, 2)) + 0.3
    naive = np.array(
        [[sum(x[s, k] * x[s + t, k] for s in range(37 - t)) / (37 - t) for k in range(2)] for t in range(37)]
    )
    for lags in (1, 5, 37):
        # 1e-14: a transform of 100 numbers of size 1
        np.testing.assert_allclose(autocorrelation(x, lags), naive[:lags], rtol=0, atol=1e-14)


def test_running_integral_is_the_trapezoidal_rule():
    y = np.random.default_rng(2).normal(size=(9, 2))
    mine = running_integral(y, 0.3)
    for n in range(9):
        np.testing.assert_allclose(
            mine[n], np.trapezoid(y[: n + 1], dx=0.3, axis=0), rtol=0, atol=1e-15
        )  # a few roundings of numbers of size 1


def test_segments_do_not_see_each_other():
    x = np.random.default_rng(3).normal(size=(103, 3))
    runs = segment_integrals(x, 0.1, 4, lags=10)
    assert runs.acf_mlk.shape == (4, 10, 3)
    np.testing.assert_array_equal(runs.acf_mlk[2], autocorrelation(x[50:75], 10))


def test_plateau_begins_where_the_tail_is_lost_in_the_noise():
    """Exact integrals 1 − exp(−t) of four segments, each off by a small noise of its own that grows with time: nothing
    random."""
    t = 0.1 * np.arange(400)
    noise = (
        np.array([1.0, -1.0, 1.0, -1.0])[:, None] * 0.01 * np.sqrt(t)
    )  # mean 0: the step from window to window is the exact one
    found = plateau(1.0 - np.exp(-t) + noise)

    def mean(a, b):
        return 1.0 - np.exp(-t[a : b + 1]).mean()

    def error(a, b):
        return np.abs((0.01 * np.sqrt(t))[a : b + 1].mean())

    for l in range(1, 100):
        # The standard error of four numbers ±d is d·√(4/3)/2.
        scatter = (error(2 * l, 4 * l) - error(l, 2 * l)) * np.sqrt(4.0 / 3.0) / 2.0
        if mean(2 * l, 4 * l) - mean(l, 2 * l) <= scatter:
            break
    assert (found.begin, found.end, found.found) == (2 * l, 4 * l, True)
    assert found.step == pytest.approx(mean(2 * l, 4 * l) - mean(l, 2 * l), rel=1e-9)
    value, bar = found.value(1.0 - np.exp(-t) + noise)
    assert value == pytest.approx(mean(2 * l, 4 * l), rel=1e-12)
    assert bar == pytest.approx(np.hypot(error(2 * l, 4 * l) * np.sqrt(4.0 / 3.0) / 2.0, found.step), rel=1e-9)
    # An integral that climbs for ever has no plateau.
    assert not plateau(t + noise).found


# ---- the estimator: right on average, with an honest error


CASES = {
    "one decay": [(1.0, 1.0, 0.0)],
    "fast and slow": [(0.6, 0.15, 0.0), (0.4, 1.5, 0.0)],
    "oscillating": [(1.0, 0.5, 12.0), (0.2, 1.0, 0.0)],
}


@pytest.mark.filterwarnings("ignore:.*had not converged")  # one in ten, and said so
@pytest.mark.parametrize("name", CASES)
def test_known_integral_within_its_error_bar(name):
    """60 runs of 400 to 800 correlation times each. An honest error holds the truth in 68 % of them (once) and 95 %
    (twice)."""
    parts, dt, n, runs = CASES[name], 0.04, 20000, 60
    exact = integral_of(dt, parts)
    results = [of_array(ornstein_uhlenbeck(np.random.default_rng(seed), n, dt, parts), dt) for seed in range(runs)]
    value = np.array([r.value for r in results])
    z = (value - exact) / np.array([r.stderr for r in results])
    # Binomial scatter of 60 runs around 0.68 and 0.95: 0.06 and 0.03; three times that, and the bars may be wider than
    # they must.
    assert np.mean(abs(z) < 1) > 0.5
    assert np.mean(abs(z) < 2) > 0.86
    # The mean of 60 is known to its own standard error; the choice of the plateau may leave 5 % of bias.
    assert abs(value.mean() / exact - 1.0) < 0.05 + 3.0 * value.std() / exact / np.sqrt(runs)
    # ... and the bar is no wider than the scatter warrants.
    assert np.median([r.stderr for r in results]) < 1.5 * value.std()


def test_second_opinion_by_cepstral_analysis():
    """The same integral, without a plateau; both in the units of the value."""
    parts = [(1.0, 1.0, 0.0), (0.5, 0.3, 12.0)]
    J = ornstein_uhlenbeck(np.random.default_rng(11), 40_000, 0.04, parts)
    found, want = of_array(J), integral_of(0.04, parts)
    assert abs(found.cepstral - want) < 3 * found.cepstral_stderr < 0.5 * want
    assert abs(found.value - found.cepstral) < 4 * np.hypot(found.stderr, found.cepstral_stderr)
    assert found.cepstral_si is None and found.cepstral_coefficients > 1
    assert any(what == "cepstral" and "coefficients" in text for what, text in found.rows())
    metal = atc.conductivity(J, dt=0.04, volume=1.0, temperature=1.0, units="metal")
    assert metal.cepstral_si / metal.cepstral == pytest.approx(metal.si / metal.value, rel=1e-12)


def test_directions_and_a_plateau_of_ones_own():
    """Directions with different conductivities come out apart; a given plateau is used as it stands."""
    J = ornstein_uhlenbeck(np.random.default_rng(5), 60000, 0.05, [(1.0, 1.0, 0.0)]) * np.sqrt([1.0, 2.0, 4.0])
    r = of_array(J, 0.05, plateau=(5.0, 8.0))
    assert r.plateau == (5.0, 8.0) and r.converged
    for c, truth in zip("xyz", (1.0, 2.0, 4.0)):
        value, error = r.components[c]
        assert abs(value - truth) < 4.0 * error and error < 0.25 * truth
    assert r.value == pytest.approx(np.mean([v for v, _ in r.components.values()]), rel=1e-14)
    # By hand: integrals of the segments, averaged over lags 100 to 160.
    by_hand = [np.mean(running_integral(autocorrelation(x, 3000), 0.05)[100:161]) for x in np.split(J, 10)]
    assert r.value == pytest.approx(np.mean(by_hand), rel=1e-12)
    assert r.stderr == pytest.approx(np.std(by_hand, ddof=1) / np.sqrt(10), rel=1e-12)
    assert r.integral[130] == pytest.approx(
        np.mean([running_integral(autocorrelation(x, 131), 0.05)[-1].mean() for x in np.split(J, 10)])
    )


def test_units_of_an_array():
    """The same currents in two unit systems: one conductivity in W/(m K); volume, temperature and kB enter as they
    should."""
    J = ornstein_uhlenbeck(np.random.default_rng(6), 4000, 0.05, [(1.0, 0.5, 0.0)])
    real, metal, si = units("real"), units("metal"), units("si")
    a = atc.conductivity(J, dt=50.0, volume=2e4, temperature=70.0, units="real", plateau=(2e3, 4e3))
    convert = {d: real.factor(d) / metal.factor(d) for d in ("energy_current", "time", "volume")}
    assert convert["time"] == pytest.approx(
        1e-3, rel=1e-7
    )  # LAMMPS's constants of the two styles agree to their printed digits
    b = atc.conductivity(
        J * convert["energy_current"], dt=50.0 * convert["time"], volume=2e4, temperature=70.0, units="metal",
        plateau=(2e3 * convert["time"], 4e3 * convert["time"]),
    )  # fmt: skip
    # kB of LAMMPS's metal and real differ in the sixth digit.
    assert a.si == pytest.approx(b.si, rel=1e-5) and a.si_stderr == pytest.approx(b.si_stderr, rel=1e-5)
    assert (a.units, b.units) == ("kcal/mol/(fs*angstrom*K)", "eV/(ps*angstrom*K)")
    # In SI units, from scratch, CODATA: kcal/mol Å/fs in W m; κ = ∫/(V kB T²).
    watt_metre = 4184.0 / 6.02214076e23 * 1e-10 / 1e-15
    by_hand = atc.conductivity(
        J * watt_metre, dt=50e-15, volume=2e4 * 1e-30, temperature=70.0, units="si", plateau=(2e-12, 4e-12)
    )  # fmt: skip
    raw = of_array(J * watt_metre, 50e-15, plateau=(2e-12, 4e-12)).value / (2e-26 * 1.380649e-23 * 70.0**2)
    assert by_hand.value == pytest.approx(raw, rel=2e-6) and by_hand.si == pytest.approx(
        by_hand.value, rel=1e-14
    )  # kB: 1.3806504e-23 in LAMMPS
    # LAMMPS's femtosecond in real units is that of its mvv2e: seven digits.
    assert a.si == pytest.approx(by_hand.value, rel=2e-5)
    assert si.label("conductivity") == "J/(s*m*K)"


# ---- what goes wrong


def test_a_run_too_short_says_so():
    with pytest.warns(AtcWarning, match="had not converged"):
        r = of_array(ornstein_uhlenbeck(np.random.default_rng(7), 600, 0.05, [(1.0, 3.0, 0.0)]), 0.05)
    assert not r.converged and "may be too small" in r.notes[0]


@pytest.mark.filterwarnings("ignore:.*had not converged")
def test_a_flow_is_not_an_equilibrium():
    J = ornstein_uhlenbeck(np.random.default_rng(8), 20000, 0.05, [(1.0, 0.5, 0.0)]) + [0.0, 0.0, 0.5]
    with pytest.warns(AtcWarning, match="along z is not 0"):
        r = of_array(J, 0.05)
    assert any("equilibrium" in n for n in r.notes)


def test_coarse_sampling_is_noticed():
    parts = [(1.0, 0.5, 0.0)]
    fine = ornstein_uhlenbeck(np.random.default_rng(9), 400000, 0.05, parts)
    assert not of_array(fine, 0.05, plateau=(2.5, 5.0)).notes
    # Every 20th: dt is twice the correlation time, the trapezoidal rule is off by x coth x − 1 = 31 % at x = 1.
    with pytest.warns(AtcWarning, match="too far apart"):
        coarse = of_array(fine[::20], 1.0, plateau=(4.0, 6.0))
    assert any("too far apart" in n for n in coarse.notes)
    assert coarse.value == pytest.approx(0.5 / np.tanh(1.0), rel=0.1)  # 20000 samples, 2 to 3 % of noise


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda J: atc.conductivity(J), "need dt, volume, temperature, units"),
        (lambda J: of_array(J[:, :2]), "shape"),
        (lambda J: of_array(J[:100]), "leave 10 in each"),
        (lambda J: of_array(J, segments=1), "segments=1"),
        (lambda J: of_array(J, plateau=(3.0, 1.0)), "begin <= end"),
        (lambda J: of_array(J, plateau=4.0), "two times"),
        (lambda J: of_array(J, plateau=(1.0, 1e9)), "longest lag"),
        (lambda J: of_array(J, longest=0.01), "four times"),
        (lambda J: of_array(J, dt=-1.0), "dt="),
        (lambda J: of_array(J * 0.0, plateau=(1.0, 1.5)), "all 0"),
        (lambda J: atc.conductivity("run.dump"), "atc.read"),
        (lambda J: atc.conductivity([gas(0.0)]), "no potential"),
        (lambda J: atc.conductivity(iter([]), POT), "no frames"),
        (lambda J: atc.heat_currents([gas(0.0)], POT), "one frame"),
        (lambda J: atc.heat_currents([gas(None), gas(None)], POT), "give the time between frames as dt"),
        (lambda J: atc.heat_currents([gas(0.0), gas(1.0), gas(2.1)], POT), "equal distances"),
        (lambda J: atc.heat_currents([gas(0.0), gas(1.0, n=5)], POT), "same two or more atoms"),
        (lambda J: atc.heat_currents([gas(0.0).replace(velocities=None)], POT), "velocities"),
    ],
)
def test_complaints(call, message):
    J = ornstein_uhlenbeck(np.random.default_rng(10), 1000, 0.04, [(1.0, 0.3, 0.0)])
    with pytest.raises(AtcError, match=message) as e:
        call(J)
    assert "\n" not in str(e.value)


def gas(time, n=6):
    rng = np.random.default_rng(11)
    return Frame(
        positions=rng.uniform(0, 8, (n, 3)),
        cell=Cell([8.0, 8.0, 8.0]),
        units=units("lj"),
        types=np.ones(n, int),
        masses=np.ones(n),
        velocities=rng.normal(size=(n, 3)),
        time=time,
    )


POT = None


def setup_module():
    global POT
    POT = atc.potential("pair_style lj/cut 2.5\npair_coeff * * 1 1", units="lj")


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.2914, 0.0123, "0.291 ± 0.012"),
        (1.0, 1e-8, "1.000000000 ± 0.000000010"),  # of the order of one already: no power of ten makes it shorter
        (-3.25e-9, 4e-18, "(-3.2500000000 ± 0.0000000040)e-9"),
        (2.5e12, 3e10, "(2.500 ± 0.030)e+12"),
        (0.0, 4e-320, "0 ± 4e-320"),
        (1.0, 1e-300, "1 ± 1e-300"),
        (np.nan, np.nan, "–"),
    ],
)
def test_value_and_error(value, error, text):
    assert _pm(value, error) == text


def test_table_and_picture(tmp_path, capsys):
    from rich.console import Console

    r = of_array(ornstein_uhlenbeck(np.random.default_rng(12), 20000, 0.05, [(1.0, 0.5, 0.0)]), 0.05)
    r.print(Console(width=200))
    out = capsys.readouterr().out
    assert (
        "conductivity" in out and "kB/(sigma*tau)" in out and "10 independent segments" in out and "W/(m K)" not in out
    )
    assert f"{r.stderr:.3f}"[:3] in out
    data = json.loads(r.json())
    assert data["value"] == r.value and len(data["integral"]) == len(r.time)
    picture = r.picture(tmp_path / "gk.png")
    assert picture.stat().st_size > 10000
    axes = r.figure().axes
    assert len(axes) == 2 and "running integral" in axes[1].get_ylabel()


# ---- the current itself


def argon(lmp, cells, temperature=70.0, cutoff=13.0, lattice=5.376, seed=102486):
    """Solid argon in a live LAMMPS, at rest as a whole."""
    lmp.commands_string(f"""
        units real
        atom_style atomic
        atom_modify map array
        lattice fcc {lattice}
        region box block 0 {cells} 0 {cells} 0 {cells}
        create_box 1 box
        create_atoms 1 box
        mass 1 39.948
        pair_style lj/cut {cutoff}
        pair_coeff 1 1 0.2381 3.405
        neigh_modify delay 0 every 10 check yes
        timestep 4.0
        velocity all create {temperature} {seed} mom yes rot no dist gaussian
    """)


def live_frames(lmp, n, every, u):
    """`n` frames of a running LAMMPS, `every` steps apart, made when they are asked for."""
    masses = np.full(lmp.get_natoms(), u.to_internal("mass", 39.948))
    for k in range(n):
        if k:
            lmp.command(f"run {every} pre no post no")
        order = np.argsort(np.array(lmp.numpy.extract_atom("id")[: len(masses)]))
        lo, hi, *_ = lmp.extract_box()
        yield Frame(
            positions=u.to_internal("length", np.array(lmp.numpy.extract_atom("x"))[: len(masses)][order]),
            velocities=u.to_internal("velocity", np.array(lmp.numpy.extract_atom("v"))[: len(masses)][order]),
            cell=Cell(np.subtract(hi, lo) * u.length, np.array(lo) * u.length),
            units=u,
            types=np.ones(len(masses), int),
            masses=masses,
            time=u.to_internal("time", 4.0 * every * k),
            source="LAMMPS",
        )


def heat_flux_of_lammps(lmp):
    """(3,) LAMMPS's compute heat/flux: flux times volume; `lmp` must have the computes."""
    lmp.command("run 0 pre yes post no")
    return np.array(lmp.numpy.extract_compute("J", 0, 1))[:3]


HEAT_FLUX = (
    "compute ke all ke/atom\ncompute pe all pe/atom\ncompute st all stress/atom NULL virial\ncompute J all heat/flux "
    "ke pe st\n"
    "thermo_style custom step temp c_J[1] c_J[2] c_J[3]"
)


def test_currents_are_lammps_s():
    """Pair potentials: J of every frame equals compute heat/flux; the frames keep their time; a drift of the whole box
    changes nothing."""
    u = units("real")
    pot = atc.potential("pair_style lj/cut 8.5\npair_coeff 1 1 0.2381 3.405", units="real")
    with lammps_session() as lmp:
        argon(lmp, 4, temperature=140.0, cutoff=8.5)
        lmp.commands_string(HEAT_FLUX + "\nfix nve all nve\nrun 100 post no")
        frames, theirs = [], []
        for frame in live_frames(lmp, 3, 10, u):
            frames.append(frame)
            theirs.append(heat_flux_of_lammps(lmp))
        temperature = lmp.get_thermo("temp")
    mine = atc.heat_currents(frames, pot)
    theirs = u.to_internal("energy_current", np.array(theirs))
    # Sums over 256 atoms and 4e4 pairs that partly cancel.
    np.testing.assert_allclose(mine.J_tc, theirs, rtol=0, atol=1e-10 * np.abs(theirs).max())
    assert mine.dt == pytest.approx(u.to_internal("time", 40.0)) and mine.atoms == 256
    assert mine.volume == pytest.approx(frames[0].cell.volume, rel=1e-14)
    last = atc.heat_currents(frames[2:], pot, dt=40.0).temperature
    assert last == pytest.approx(temperature, rel=1e-12)
    drifting = [f.replace(velocities=f.velocities + [3.0, -2.0, 1.0]) for f in frames]
    moved = atc.heat_currents(drifting, pot)
    np.testing.assert_allclose(moved.J_tc, mine.J_tc, rtol=0, atol=1e-10 * np.abs(theirs).max())
    assert moved.temperature == pytest.approx(mine.temperature, rel=1e-12)


def test_command(tmp_path, capsys):
    """`atc conductivity` on a trajectory that LAMMPS wrote: the numbers of `atc.conductivity`, table, JSON and picture;
    complaints in one line."""
    from typer.testing import CliRunner

    from atc.cli import app

    with lammps_session() as lmp:
        argon(lmp, 2, temperature=100.0, cutoff=5.0)
        lmp.commands_string(
            f"fix nve all nve\ndump d all custom 10 {tmp_path}/run.dump id type x y z vx vy vz\ndump_modify d time "
            "yes units yes sort id\nrun 2490"
        )
    model = "pair_style lj/cut 5.0\npair_coeff 1 1 0.2381 3.405"
    text = f'[trajectory]\nfile = "run.dump"\nmasses = {{ 1 = 39.948 }}\n[potential]\nlammps = """\n{model}\n"""\n'
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "none.toml").write_text(text.split("[potential]")[0])

    def run(*arguments):
        return CliRunner().invoke(app, ["conductivity", *map(str, arguments)])

    scene = tmp_path / "scene.toml"
    done = run(scene, "--segments", 5, "--plateau", "300,500", "--json")
    assert done.exit_code == 0, done.output
    mine = json.loads(done.output)
    frames = atc.read(tmp_path / "run.dump", masses={1: 39.948})
    theirs = atc.conductivity(frames, atc.potential(model, units="real"), segments=5, plateau=(300.0, 500.0))
    assert (mine["value"], mine["stderr"], mine["samples"], mine["atoms"]) == (theirs.value, theirs.stderr, 250, 32)
    assert mine["dt"] == pytest.approx(40.0)
    done = run(scene, "--segments", 5, "--picture", tmp_path / "gk.png")
    assert (
        done.exit_code == 0 and "W/(m K)" in done.output and "gk.png" in done.output and (tmp_path / "gk.png").exists()
    )
    for arguments, message in (
        ((tmp_path / "none.toml",), "no [potential] section"),
        ((scene, "--plateau", "300"), "expected two lags"),
        ((scene, "--segments", "100"), "fewer segments"),
        ((scene, "-j", "-1"), "-j -1"),
    ):
        done = run(*arguments)
        assert (
            done.exit_code == 2
            and message in done.output
            and "Traceback" not in done.output
            and len(done.output.splitlines()) == 1
        )


@pytest.mark.slow
def test_argon_at_70_K():
    """Solid argon, 500 atoms, 70 K: 0.29 W/(m K), as LAMMPS's own example for `compute heat/flux` finds with the same
    model.

    Every frame goes through the program; LAMMPS only moves the atoms, and its own heat current is the check at a few
    steps.
    """
    u = units("real")
    frames_wanted, every = 9000, 10
    pot = atc.potential("pair_style lj/cut 13.0\npair_coeff 1 1 0.2381 3.405", units="real")
    checked = []
    with lammps_session() as lmp:
        argon(lmp, 5)
        lmp.commands_string(
            "fix nvt all nvt temp 70 70 400\nrun 8000 post no\nunfix nvt\nvelocity all zero linear\nfix nve all "
            "nve\nrun 0 post no"
        )

        def frames():
            for k, frame in enumerate(live_frames(lmp, frames_wanted, every, u)):
                if k % 3000 == 1500:
                    checked.append((k, frame))
                yield frame

        currents = atc.heat_currents(frames(), pot)
        lmp.commands_string("unfix nve\n" + HEAT_FLUX)
        for k, frame in checked:
            x, v = u.to_user("length", frame.positions), u.to_user("velocity", frame.velocities)
            lmp.scatter_atoms("x", 1, 3, np.ctypeslib.as_ctypes(np.ascontiguousarray(x).ravel()))
            lmp.scatter_atoms("v", 1, 3, np.ctypeslib.as_ctypes(np.ascontiguousarray(v).ravel()))
            theirs = u.to_internal("energy_current", heat_flux_of_lammps(lmp))
            np.testing.assert_allclose(currents.J_tc[k], theirs, rtol=0, atol=1e-9 * np.abs(currents.J_tc).max())
    result = atc.conductivity(currents)
    print(*result.rows(), *result.notes, sep="\n")
    assert abs(result.temperature - 70.0) < 3.0
    assert result.converged and result.si_stderr < 0.06
    assert abs(result.si - 0.29) < 2.0 * result.si_stderr


SALT = (
    "pair_style born/coul/long 6.0\npair_coeff 1 1 0.2637 0.317 2.340 1.0486 -0.4993\n"
    "pair_coeff 1 2 0.2110 0.317 2.755 6.9906 -8.6758\npair_coeff 2 2 0.1582 0.317 3.170 72.4022 -145.4285\n"
    "kspace_style ewald 1e-8\n"
)


def molten_salt(lmp, steps):
    """64 ions of sodium chloride (Fumi and Tosi), molten and brought to 1300 K."""
    lmp.commands_string(
        "units metal\natom_style charge\natom_modify map array sort 0 0\nlattice sc 3.15\nregion b block 0 4 0 4 0 4\n"
        "create_box 2 b\nlattice fcc 6.30\ncreate_atoms 1 box\nlattice fcc 6.30 origin 0.5 0 0\ncreate_atoms 2 box\n"
        "mass 1 22.98977\nmass 2 35.453\nset type 1 charge 1.0\nset type 2 charge -1.0\n"
        + SALT
        + "pair_modify table 0\ntimestep 0.001\nvelocity all create 3000.0 71034 mom yes rot no dist gaussian\n"
        f"fix nvt all nvt temp 1300.0 1300.0 0.1\nrun {steps} post no\nunfix nvt\nfix nve all nve\n{HEAT_FLUX}"
    )


def salt_frames(lmp, count, every, u):
    """Frames of the run, and LAMMPS's own current of each."""
    lmp.command("run 0 post no")
    box = lmp.extract_box()
    cell = Cell.from_lammps(box[0], box[1])
    q = np.array(lmp.numpy.extract_atom("q"))[:64]
    types = np.array(lmp.numpy.extract_atom("type"))[:64]
    mass = np.array([0.0, 22.98977, 35.453])[types]
    for k in range(count):
        lmp.command(f"run {every} pre no post no")
        x, v = (np.array(lmp.numpy.extract_atom(name))[:64] for name in "xv")
        yield Frame(
            u.to_internal("length", x), cell, u, types=types, masses=u.to_internal("mass", mass), charges=q,
            velocities=u.to_internal("velocity", v), time=u.to_internal("time", 0.001 * every * (k + 1)),
        ), u.to_internal("energy_current", np.array(lmp.numpy.extract_compute("J", 0, 1))[:3])  # fmt: skip


def salt_currents(steps, count, every):
    u, pot, theirs = units("metal"), atc.potential("units metal\n" + SALT), []
    with lammps_session() as lmp:
        molten_salt(lmp, steps)
        lmp.command(f"thermo {every}")  # energies and virials of atoms are there in these steps

        def frames():
            for frame, J in salt_frames(lmp, count, every, u):
                theirs.append(J)
                yield frame

        mine = atc.heat_currents(frames(), pot)
    return mine, np.array(theirs)


def test_currents_of_a_salt_are_lammps_s():
    """With the energies and virials of every ion in Ewald's sum: J of every frame equals compute heat/flux."""
    mine, theirs = salt_currents(200, 3, 20)
    # LAMMPS's sum stops at 1e-8 of the force of two charges, and its erfc is a polynomial.
    np.testing.assert_allclose(mine.J_tc, theirs, rtol=0, atol=2e-5 * np.abs(theirs).max())


@pytest.mark.slow
def test_conductivity_of_a_molten_salt():
    """Green-Kubo of 64 ions at 1300 K from currents of this program and from LAMMPS's own."""
    mine, theirs = salt_currents(4000, 4000, 4)
    assert np.abs(mine.J_tc - theirs).max() < 1e-4 * np.abs(theirs).max()
    ours = atc.conductivity(mine)
    J = mine.units.to_user("energy_current", theirs)
    u = mine.units
    more = {"dt": u.to_user("time", mine.dt), "volume": u.to_user("volume", mine.volume)}
    lammps = atc.conductivity(J, temperature=u.to_user("temperature", mine.temperature), units="metal", **more)
    print(*ours.rows(), *ours.notes, *lammps.rows(), np.abs(mine.J_tc - theirs).max() / np.abs(theirs).max(), sep="\n")
    assert abs(ours.si - lammps.si) < 0.1 * ours.si_stderr and ours.si_stderr < 0.5 * ours.si
