"""Pressure across an interface: argon's film against LAMMPS's own pressure of the same frames and against mechanical
equilibrium, ideal gases against the naive sum over atoms."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from lammps_oracle import lammps_session
from lammps_runs import water
from typer.testing import CliRunner

import atc
from atc.analysis.interface import CONSTANT, crossings, profile_of_scene
from atc.cli.root import app
from atc.config.scene import Scene
from atc.frame import Cell, Frame
from atc.planar import planar
from atc.units import units

DATA = Path(__file__).resolve().parents[2] / "data"
FILM = DATA / "argon_slab" / "scene.toml"
NOTHING = "pair_style lj/cut 2.0\npair_coeff * * 0.0 1.0"


@pytest.fixture(scope="module")
def film():
    return profile_of_scene(Scene.load(FILM))


def test_tension_is_that_of_lammps(film):
    rows = list(csv.DictReader(open(DATA / "argon_slab" / "thermo.csv")))
    p = {c: np.array([float(r[f"p{c}"]) for r in rows]) for c in ("xx", "yy", "zz")}
    lammps = float(np.mean(151.2 / 2 * (p["zz"] - 0.5 * (p["xx"] + p["yy"]))))
    # digits of the dump's velocities and positions: test_data has the same for the box
    assert film["surface_tension_box"].value == pytest.approx(lammps, rel=1e-5)
    # the sum over bins for the integral: kernel radius 4 bins and more
    assert film["surface_tension"].value == pytest.approx(lammps, rel=1e-5)
    assert film["surface_tension_difference"].value == pytest.approx(0.0, abs=1e-4 * film["surface_tension"].stderr)
    atm_angstrom = 101325.0 * 1e-10 * 1e3
    assert film["surface_tension_si"].value == pytest.approx(film["surface_tension"].value * atm_angstrom, rel=1e-6)
    assert film["surface_tension_si"].units == "mN/m"


def test_error_of_the_tension_is_that_of_the_frames(film):
    rows = list(csv.DictReader(open(DATA / "argon_slab" / "thermo.csv")))
    g_t = np.array([75.6 * (float(r["pzz"]) - 0.5 * (float(r["pxx"]) + float(r["pyy"]))) for r in rows])
    naive = g_t.std(ddof=1) / np.sqrt(len(g_t))
    assert 0.99 * naive < film["surface_tension"].stderr < 2.5 * naive


def test_normal_pressure_is_the_same_everywhere(film):
    assert film["normal_deviation"].value < CONSTANT
    assert not any("not constant" in doubt for doubt in film.warnings)
    # vapour: what little there is of it is nearly ideal, and its kinetic pressure is whole in spite of few atoms
    c = film["pressure_normal"]
    vapour = np.abs(film.z) > 45.0
    ideal = film["density"].values / 39.948 * 0.60221408 * 1.380649e-23 * 90.0 * 1e30 / 101325.0
    # 61 Å of it are 15 kernel radii: three errors of their mean
    assert c.values[vapour].mean() == pytest.approx(ideal[vapour].mean(), abs=3 * c.stderr[vapour].mean() / np.sqrt(15))
    # the tangential pressure is not constant
    t = film["pressure_tangential"]
    assert ((t.values - c.values) / t.stderr).min() < -4.0


def test_integral_and_moments_belong_to_the_columns(film):
    dz = film.z[1] - film.z[0]
    d = film["pressure_normal"].values - film["pressure_tangential"].values
    assert film["tension_integral"].values[-1] == pytest.approx(dz * (d.sum() - 0.5 * d[-1]), rel=1e-10)
    # the film is near the middle of its cell, so that the moments are those about its centre
    rho = film["density"].values
    z0 = (rho * film.z).sum() / rho.sum()
    for name, side in (("moment_below", film.z < z0), ("moment_above", film.z > z0)):
        assert film[name].value == pytest.approx(dz * (d * abs(film.z - z0) * side).sum(), rel=0.05)
    assert "gauge" in " ".join(film.notes)


def test_wrong_potential_breaks_the_balance():
    scene = Scene.load(FILM, {"trajectory.frames": ":16", "grid.bins": 40})
    data = {s: dict(t) for s, t in scene.data.items()}
    data["potential"] = {"lammps": "pair_style lj/cut 10.215\npair_coeff 1 1 0.32 3.405\npair_modify shift yes"}
    result = profile_of_scene(scene.instead(data))
    assert result["normal_deviation"].value > 1.5 * CONSTANT
    assert any("not constant" in doubt for doubt in result.warnings)


# ---- ideal gases


def gas(rng, frames, cell, flow=0.0, two=False, breathes=False):
    """Frames of few atoms that do not see each other, of which each has its own drift; the cell may change."""
    out, u = [], units("lj")
    for k in range(frames):
        s = rng.random((30, 3))
        v = rng.normal(size=(30, 3)) + rng.normal(size=3)
        v[:, 0] += flow * np.cos(2 * np.pi * s[:, 1])
        if two:
            s[:, 2] = 0.5
            v[:, 2] = 0.0
        edges = cell * (1.0 + 0.05 * k * breathes)
        frame = Frame(
            positions=s @ edges, types=np.ones(30, int), cell=Cell(edges), units=u, masses=rng.uniform(1, 2, 30),
            velocities=v, step=k,
        )  # fmt: skip
        out.append(planar(frame) if two else frame)
    return out


def naive(frames, kern, bins, axis, dim, flow):
    """p_N, p_T (z) by the sum over atoms, velocities relative to the drift of the profile, and the mean flow."""
    sums, cells = [], [f.cell.vectors for f in frames]
    for f in frames:
        c = f.cell.vectors
        n = np.linalg.cross(*(c[k] for k in range(3) if k != axis))
        n /= np.linalg.norm(n)
        h = abs(n @ c[axis])
        z = (np.arange(bins) + 0.5) / bins * h
        d = z[:, None] - (f.positions @ n * np.sign(n @ c[axis]))[None]
        d -= h * np.rint(d / h)
        w = (
            kern.marginal(np.array([0, 0, 1.0]) if dim == 3 else np.array([0, 1.0, 0])).phi(np.abs(d))
            * h
            / f.cell.volume
        )
        rho, mom = w @ f.masses, w @ (f.masses[:, None] * f.velocities)
        v = f.velocities - mom.sum(0) / rho.sum()
        sums.append((w, rho, w @ (f.masses[:, None] * v), v, f.masses, n))
    V = sum(s[2] for s in sums) / sum(s[1] for s in sums)[:, None]
    out = []
    for w, _, _, v, m, n in sums:
        rel = v[None] - (V[:, None] if flow else 0.0)
        p = np.einsum("zn,n,znc,znd->zcd", w, m, rel, rel)
        pn = np.einsum("c,zcd,d->z", n, p, n)
        pt = (np.trace(p, axis1=1, axis2=2) - pn) / (dim - 1)
        out.append((pn, pt, (pn - pt) * abs(n @ cells[len(out)][axis]) / bins))
    return np.mean(out, axis=0)


@pytest.mark.parametrize("flow", [False, True])
@pytest.mark.parametrize("axis, two", [(2, False), (1, False), (1, True)])
@pytest.mark.filterwarnings("ignore::atc.AtcWarning")
def test_gas_against_the_naive_sum(axis, two, flow):
    cell = np.array([[9.0, 0, 0], [2.0, 8.0, 0], [1.0, -1.5, 12.0]])
    if two:
        cell[2] = 0, 0, 1
    frames = gas(np.random.default_rng(5), 3, cell, flow=3.0, two=two, breathes=not two)
    kern, grid = atc.kernel("quartic", 1.5), atc.Grid.slab("xyz"[axis], 10)
    pot = atc.potential(NOTHING + ("\ndimension 2" if two else ""), units="lj")
    mine = atc.profile(frames, pot, kern, grid, flow=flow, tolerance=1e-12)
    pn, pt, tension = naive(frames, kern.in_dimension(2 if two else 3), 10, axis, 2 if two else 3, flow)
    np.testing.assert_allclose(mine["pressure_normal"].values, pn, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(mine["pressure_tangential"].values, pt, rtol=1e-10, atol=1e-12)
    assert mine["surface_tension"].value == pytest.approx(tension.sum() / 2, rel=1e-9)


def test_flow_is_said():
    frames = gas(np.random.default_rng(6), 20, np.diag([9.0, 8.0, 12.0]), flow=3.0)
    with pytest.warns(atc.AtcWarning, match="layers move along the interface"):
        atc.profile(
            frames, atc.potential(NOTHING, units="lj"), atc.kernel("quartic", 1.5), atc.Grid.slab("y", 10)
        )  # fmt: skip


def test_crossings():
    z = np.linspace(0, 1, 100, endpoint=False)
    for waves in (1, 2, 3):
        for shift in (0.0, 0.1, 0.3):
            assert crossings(np.tanh(5 * np.sin(2 * np.pi * (waves * z + shift)))) == 2 * waves


# ---- command


def run(*words):
    return CliRunner().invoke(app, ["profile", *map(str, words)])


def test_command(tmp_path):
    out, picture = tmp_path / "p.nc", tmp_path / "p.png"
    few = ("-e", 2, "--bins", 24)
    done = run(FILM, *few, "-o", out, "--picture", picture)
    assert done.exit_code == 0, done.output
    assert "mN/m" in done.output and "p_N" in done.output and "gauge" in done.output
    assert picture.stat().st_size > 1000
    ds = xr.load_dataset(out)
    table = json.loads(run(FILM, *few, "--json").stdout)
    rows = list(csv.reader(run(FILM, *few, "--csv").stdout.splitlines()))
    assert len(rows) == 25 and len(table["z"]) == 24
    name = "pressure_tangential"
    k = [r.partition(" (")[0] for r in rows[0]].index(name)
    np.testing.assert_allclose([float(r[k]) for r in rows[1:]], ds[name].values, rtol=1e-9)
    np.testing.assert_allclose(table["columns"][name]["values"], ds[name].values, rtol=1e-12)
    assert table["numbers"]["surface_tension"]["value"] == pytest.approx(float(ds["surface_tension"]), rel=1e-12)


@pytest.mark.parametrize(
    "words, why",
    [
        (("--interfaces", 0), "interfaces=0: expected a whole number of at least 1"),
        (("--set", 'grid.kind="regular"'), "grid"),
        (("--json", "--csv"), "not both"),
        (("--axis", "w"), "--axis w: expected x, y or z"),
        (("--bins", 0), "--bins 0: expected"),
    ],
)
def test_refusals(words, why):
    done = CliRunner().invoke(app, ["profile", str(FILM), "-e", "2", *map(str, words)])
    assert done.exit_code != 0
    assert isinstance(done.exception, (SystemExit, atc.AtcError)) and why in str(done.exception) + done.output


def test_missing_parts_are_named():
    frames = gas(np.random.default_rng(7), 1, np.diag([9.0, 8.0, 12.0]))
    pot, kern = atc.potential(NOTHING, units="lj"), atc.kernel("quartic", 1.5)
    with pytest.raises(atc.AtcError, match="slab grid"):
        atc.profile(frames, pot, kern, atc.Grid.regular(shape=3))
    with pytest.raises(atc.AtcError, match="needs kern"):
        atc.profile(frames, pot, None, atc.Grid.slab("z", 4))
    data = {"trajectory": {"file": str(FILM.parent / "argon_slab.dump.gz")}}
    with pytest.raises(atc.AtcError, match="slab"):
        profile_of_scene(Scene.load(data))


# ---- water


MODEL = """units real
atom_style full
pair_style lj/cut/coul/long 4.9
pair_modify table 0
kspace_style ewald 1e-9
bond_style harmonic
angle_style harmonic
read_data w.data
pair_coeff 1 1 0.155 3.166
pair_coeff 1 2 0.0 1.0
pair_coeff 2 2 0.0 1.0
bond_coeff 1 450.0 0.9572
angle_coeff 1 55.0 104.52
"""
COLUMNS = "id mol type q x y z vx vy vz fx fy fz"


@pytest.mark.filterwarnings("ignore::atc.AtcWarning")
def test_tension_of_shaken_water_with_ewald_sums(tmp_path):
    """A film in vacuum: p_N − p_T of pairs, the long-range field (in the vacuum, too) and constraints, against LAMMPS's
    pressure tensor."""
    data, dump = tmp_path / "w.data", tmp_path / "run.dump"
    water(n=3).write_data(data)
    model = MODEL.replace("w.data", str(data))
    grow = ["minimize 0 1e-4 60 100", "change_box all z scale 2.5", f"write_data {data} nocoeff"]
    with lammps_session() as lmp:
        for line in [*model.splitlines(), *grow]:
            lmp.command(line)
    script = (
        f"{model}timestep 1.0\nfix n all nve\nfix h all shake 1e-10 200 0 b 1 a 1\n"
        f"dump d all custom 20 {dump} {COLUMNS}\ndump_modify d sort id format float %.17g units yes time yes\nrun 20\n"
    )
    (tmp_path / "in.run").write_text(script)
    with lammps_session() as lmp:
        for line in script.splitlines():
            lmp.command(line)
        p = {c: lmp.get_thermo(f"p{c}{c}") for c in "xyz"}
        height = lmp.get_thermo("lz")
    pot, frame = atc.potential(tmp_path / "in.run"), atc.read(dump, units="real")[-1]
    mine = atc.profile(frame, pot, atc.kernel("quartic", 4.0), atc.Grid.slab("z", 100), tolerance=1e-6)
    # LAMMPS takes velocities as they are, the box relative to its drift.
    done = pot.complete(frame)
    m, v = done.masses, done.masses @ done.velocities / done.masses.sum()
    drift = frame.units.to_user("pressure", m.sum() * (v[2] ** 2 - 0.5 * (v[0] ** 2 + v[1] ** 2)) / frame.cell.volume)
    lammps = 0.5 * height * (p["z"] - 0.5 * (p["x"] + p["y"]) - drift)
    size = 0.5 * height * np.abs(list(p.values())).max()
    # LAMMPS's erfc is good to 1.5e-7, its sum over modes to 1e-9: of terms tens of times larger
    assert mine["surface_tension_box"].value == pytest.approx(lammps, abs=1e-5 * size)
    assert mine["surface_tension"].value == pytest.approx(lammps, abs=1e-5 * size)
    charge = mine["charge_density"].values
    # the sum over bins for the integral of the kernel
    assert abs(charge.sum()) < 1e-5 * abs(charge).sum() and mine["potential"].units == "V"
