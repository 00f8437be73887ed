"""Cases of `atc pd`: what is wrong is named by its line, a run that was killed ends as if it had not been, bodies come
from files, results go to other programs."""

import os
import shutil
import signal
import subprocess
import sys
import time

import held
import numpy as np
import pytest

from atc import pd
from atc.cases.build import make_body
from atc.cases.case import Case
from atc.errors import AtcError
from atc.running.opening import open_dataset

PLATE = """[body]
region = { shape = "box", lo = [0, 0, 0], hi = [0.03, 0.012, 0] }
spacing = 0.001
horizon = 0.003015
density = 2440
dimension = 2
jitter = 0.05

[material]
model = "pmb"
youngs = 72e9

[damage]
s00 = 0.002
alpha = 0.25
no_fail = ["top", { shape = "box", lo = [-inf, -inf, -inf], hi = [inf, 0.0025, inf] }]

[[notch]]
start = [-0.001, 0.0061]
end = [0.012, 0.0061]

[regions.top]
shape = "box"
lo = [-inf, 0.0095, -inf]
hi = [inf, inf, inf]

[regions.bottom]
not = { any = ["top", { shape = "box", lo = [-inf, 0.0025, -inf], hi = [inf, inf, inf] }] }

[[initial]]
region = "top"
velocity = [0, 8, 0]

[[prescribed]]
region = "top"
velocity = ["free", 8.0, "free"]
until = 1.5e-5

[[prescribed]]
region = "bottom"
displacement = { times = [0, 1e-5, 1], values = [[0, 0, 0], [0, -5e-5, 0], [0, -5e-5, 0]] }

[[wall]]
point = [0.0295, 0, 0]
normal = [-1, 0, 0]
stiffness = 1e19

[contact]

[run]
steps = 120
dt = 1.5e-7
damping = 10.0

[output]
every = 25
"""


def write(tmp_path, text=PLATE, name="plate.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def equal(a, b):
    """Bit for bit, attributes but the source included."""
    assert set(a.variables) == set(b.variables)
    for name in a.variables:
        assert np.array_equal(a[name].values, b[name].values, equal_nan=a[name].dtype.kind == "f"), name


# --- what a case means


def test_case_is_the_simulation_written_by_hand(tmp_path):
    case = Case.load(write(tmp_path))
    sim = case.simulation(1)
    body = pd.Body.lattice(
        pd.Box([0, 0, 0], [0.03, 0.012, 0]),
        0.001,
        0.003015,
        2440,
        dimension=2,
        jitter=0.05,
        notches=pd.Notch.line([-0.001, 0.0061], [0.012, 0.0061]),
    )
    inf = np.inf
    top, low = pd.Box([-inf, 0.0095, -inf], [inf] * 3), pd.Box([-inf] * 3, [inf, 0.0025, inf])
    bottom = ~(top | pd.Box([-inf, 0.0025, -inf], [inf] * 3))
    v = np.zeros((len(body), 3))
    v[body.nodes(top), 1] = 8
    times, values = np.array([0, 1e-5, 1]), np.array([[0, 0, 0], [0, -5e-5, 0], [0, -5e-5, 0.0]])
    other = pd.Simulation(
        body,
        pd.PMB(youngs=72e9),
        damage=pd.CriticalStretch(0.002, 0.25),
        no_fail=[top, low],
        contact=pd.Contact(),
        walls=pd.Wall([0.0295, 0, 0], [-1, 0, 0], 1e19),
        damping=10.0,
        dt=1.5e-7,
        velocities=v,
        threads=1,
        conditions=[
            pd.Prescribed(top, velocity=[None, 8.0, None], until=1.5e-5),
            pd.Prescribed(bottom, displacement=(times, values)),
        ],
    )
    sim.step(120)
    other.step(120)
    a, b = sim.state.to_arrays(), other.state.to_arrays()
    for name in a:
        assert np.array_equal(a[name], b[name]), name
    assert sim.n_broken > 20  # it cracks, or the test says little
    ds = case.run(tmp_path / "out.zarr", threads=1)
    assert np.array_equal(ds.displacement[-1], a["u_nc"]) and np.array_equal(ds.velocity[-1], a["v_nc"])
    assert np.array_equal(ds.damage[-1], sim.damage()) and np.array_equal(ds.energy[-1], sim.strain_energy_n())
    assert ds.step.values.tolist() == [0, 25, 50, 75, 100, 120] and ds.attrs["kind"] == "peridynamics"
    e = sim.energies()
    for name in (
        "kinetic",
        "strain",
        "work_constraint",
        "dissipated_damping",
        "dissipated_fracture",
        "contact",
        "total",
    ):
        assert ds[f"energy_{name}"].values[-1] == getattr(e, name)
    for v in ds.data_vars.values():
        assert {"units", "long_name", "sign_convention"} <= set(v.attrs)
    # the kept case is the case
    again = tmp_path / "again.toml"
    again.write_text(ds.attrs["case"])
    equal(Case.load(again).run(tmp_path / "again.nc", threads=2), ds)


def test_materials_by_region_and_overrides(tmp_path):
    text = PLATE.replace(
        "[material]",
        '[[material]]\nmodel = "pmb"\nyoungs = 9e9\ndensity = 1000\n\n[[material]]\nid = 7\nregion = "top"',
    )
    case = Case.load(write(tmp_path, text), ["body.jitter=0", "run.steps=3", "contact.strength=7"])
    sim = case.simulation(1)
    assert sim.contact.contact == pd.Contact(strength=7)
    body = sim.body
    top = body.X_nc[:, 1] >= 0.0095
    assert set(body.material_n[top]) == {7} and set(body.material_n[~top]) == {1}
    assert set(body.rho_n[top]) == {2440} and set(body.rho_n[~top]) == {1000}
    assert case.data["run"]["steps"] == 3 and len(body) == 31 * 13


def test_periodic_lattice_holds_every_node_once():
    case = Case.load(
        {
            "body": {
                "region": {"shape": "box", "lo": [0, 0, 0], "hi": [8.0, 8.0, 8.0]},
                "spacing": 1.0,
                "horizon": 2.01,
                "density": 1.0,
                "cell": [8.0, 8.0, 8.0],
                "periodic": [True, True, True],
            },
            "material": {"model": "pmb", "bulk": 1.0},
            "run": {"steps": 1},
        }
    )
    body = case.simulation(1).body
    assert len(body) == 512 and set(body.bonds.sums(np.ones(len(body.bonds)))) == {32.0}


@pytest.mark.parametrize("solver", ["relax", "static"])
def test_equilibrium_at_every_step(tmp_path, solver):
    """A bar pulled in three steps: Hooke's law at each, whatever the solver; kept entry by entry."""
    case = Case.load(
        {
            "body": {
                "region": {"shape": "box", "lo": [0, 0, 0], "hi": [40.0, 6.0, 0]},
                "spacing": 1.0,
                "horizon": 3.015,
                "density": 1.0,
                "dimension": 2,
            },
            "material": {"model": "correspondence", "youngs": 2.0, "poisson": 0.3},
            "prescribed": [
                {
                    "region": {"shape": "box", "lo": [-1.0, -1, -1], "hi": [2.5, 9, 1]},
                    "displacement": [0.0, "free", "free"],
                },
                {
                    "region": {"shape": "box", "lo": [-1.0, 2.5, -1], "hi": [0.5, 3.5, 1]},
                    "displacement": ["free", 0.0, "free"],
                },
                {
                    "region": {"shape": "box", "lo": [37.5, -1, -1], "hi": [41, 9, 1]},
                    "displacement": {"times": [0, 3], "values": [[0, "free", "free"], [0.003, "free", "free"]]},
                },
            ],
            "run": {"steps": 3, "solver": solver, "tolerance": 1e-7},
            "output": {"every": 1, "quantities": ["displacement", "stress", "force"]},
        }
    )
    ds = case.run(tmp_path / "out.zarr", threads=1)
    assert ds.time.values.tolist() == [0, 1, 2, 3]
    x = ds.position_x.values
    inner = (x > 15) & (x < 25)
    strain = np.array([np.polyfit(x[inner], ds.displacement[k, inner, 0].values, 1)[0] for k in range(4)])
    right = x > 37
    reaction = -ds.force[:, right, 0].sum("node").values / 7.0
    np.testing.assert_allclose(strain, strain[3] * np.arange(4) / 3, rtol=1e-3, atol=1e-12)
    # E of a thin bar; the free edges lack some of their bonds
    assert reaction[3] / strain[3] == pytest.approx(2.0, rel=0.02)
    assert float(abs(ds.force[3, inner]).max()) < 1e-5 * reaction[3]
    for section, key, value, words in (
        ("run", "damping", 1.0, "belongs to motion"),
        ("damage", "s00", 0.1, "breaks no bonds"),
    ):
        with pytest.raises(AtcError, match=words):
            Case.load(case.data, {f"{section}.{key}": value})


# --- what is wrong is named by its line


@pytest.mark.parametrize(
    "before, after, line, words",
    [
        ("spacing = 0.001", "spacign = 0.001", 3, "unknown key 'spacign'.*did you mean 'spacing'"),
        ("spacing = 0.001\n", "", 1, "needs spacing"),
        ("horizon = 0.003015\n", "", 1, "needs horizon"),
        ("density = 2440\n", "", 1, "needs density"),
        ("dimension = 2", "dimension = 4", 6, "expected 1, 2 or 3, got 4"),
        ("[damage]", "[damages]", 13, r"unknown section \[damages\].*did you mean 'damage'"),
        ('model = "pmb"', 'model = "pbm"', 10, "unknown 'pbm'.*did you mean 'pmb'.*known: .*pmb"),
        ('model = "pmb"\n', "", 9, 'needs model, e.g. model = "pmb"'),
        ("youngs = 72e9", "young = 72e9", 11, "unknown key 'young'.*did you mean 'youngs'"),
        ("youngs = 72e9", "youngs = -1", 11, "youngs: expected a number greater than 0, got -1"),
        ("youngs = 72e9\n", "", 9, "exactly one of"),
        ("s00 = 0.002", "s00 = 0.002\nGc = 3.0", 13, "exactly one of s00 and Gc"),
        ('["top", {', '["tpo", {', 16, "there is no region 'tpo': did you mean 'top'"),
        ("end = [0.012, 0.0061]", "", 18, r"\[notch\] needs start and end"),
        ("end = [0.012, 0.0061]", "end = [0.012]", 20, "expected the end of the line"),
        ('shape = "box"\nlo = [-inf, 0.0095', 'shape = "bx"\nlo = [-inf, 0.0095', 22, "shape must be one of box"),
        ("velocity = [0, 8, 0]\n", "", 30, "exactly one of velocity and displacement"),
        ('velocity = ["free", 8.0', 'velocity = ["fre", 8.0', 36, "unknown 'fre': did you mean 'free'"),
        ("times = [0, 1e-5, 1]", "times = [0, 1e-5, 1e-5]", 41, "increasing times"),
        ("normal = [-1, 0, 0]\n", "", 43, "needs normal"),
        ("point = [0.0295, 0, 0]", 'point = "x"', 44, "expected a point"),
        ("steps = 120\n", "", 50, "needs steps"),
        ("dt = 1.5e-7", "dt = 1.5e-7\nsafety = 0.5", 53, "dt is given"),
        ("every = 25", 'every = 25\nquantities = ["damag"]', 57, "unknown 'damag': did you mean 'damage'"),
        ("[run]", "[run\n", 50, "not valid TOML"),
        (
            'region = "bottom"',
            'region = { shape = "box", lo = [1, 1, 1], hi = [2, 2, 2] }',
            40,
            "no node of the body lies in it",
        ),
    ],
)
def test_mistakes_have_a_line(tmp_path, before, after, line, words):
    assert before in PLATE
    path = write(tmp_path, PLATE.replace(before, after, 1))
    with pytest.raises(AtcError, match=rf"(?s)plate\.toml:{line}: .*({words})") as e:
        Case.load(path).simulation(1)
    assert "\n" not in str(e.value)


def test_more_mistakes(tmp_path):
    with pytest.raises(AtcError, match="no such case file"):
        Case.load(tmp_path / "none.toml")
    with pytest.raises(AtcError, match=r"--set run.step=1: \[run\] step|unknown key 'step'"):
        Case.load(write(tmp_path), ["run.step=1"])
    with pytest.raises(AtcError, match="expected SECTION.KEY=VALUE"):
        Case.load(write(tmp_path), ["wall.stiffness=1"])
    with pytest.raises(AtcError, match="is made of itself"):
        Case.load(write(tmp_path, PLATE.replace('any = ["top"', 'any = ["bottom"')))
    with pytest.raises(AtcError, match="there is no file"):
        Case.load(
            write(
                tmp_path,
                PLATE.replace(
                    'region = { shape = "box", lo = [0, 0, 0], hi = [0.03, 0.012, 0] }', 'file = "x.csv"'
                ).replace("jitter = 0.05\n", ""),
            )
        )


def test_flags_are_read_as_those_of_scenes(tmp_path):
    case = Case.load(write(tmp_path), ["output.quantities=displacement, damage", "body.offset=0.0, 1e-4,0"])
    assert case.get("output", "quantities") == ["displacement", "damage"]
    assert case.get("body", "offset") == [0.0, 1e-4, 0]
    assert case.where("body", "offset") == "--set body.offset=0.0, 1e-4,0"
    with pytest.raises(AtcError, match=r"^--set run\.stepz=1: unknown key 'stepz' in \[run\]: did you mean 'steps'\?"):
        Case.load(write(tmp_path), ["run.stepz=1"])
    with pytest.raises(AtcError, match="did you mean run.steps"):
        Case.load(write(tmp_path), {"steps": 1})
    with pytest.raises(AtcError, match=r"there may be several \[\[wall\]\]: edit the case"):
        Case.load(write(tmp_path), ["wall.stiffness=1"])
    assert Case.load(Case.load(write(tmp_path)), {"run.steps": 7}).get("run", "steps") == 7


# --- interruptions


def arguments(case, out, *more, hold=None):
    """A run that waits for a signal after `hold` entries."""
    program = ["-m", "atc"] if hold is None else [held.__file__, str(hold)]
    return [sys.executable, *program, "pd", str(case), "-o", str(out), "-j", "1", "-q", *more]


def wait_for(journal, entries, process):
    for _ in range(3000):
        if journal.exists() and len(journal.read_text().splitlines()) >= entries:
            return
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    raise AssertionError("the run never got anywhere")


FIELDS = """
[kernel]
name = "quartic"
radius = 0.003

[grid]
kind = "line"
start = [0.002, 0.006, 0.0]
end = [0.028, 0.006, 0.0]
n = 14

[fields]
quantities = ["density", "velocity", "peridynamic_stress", "peridynamic_piola_stress", "peridynamic_stress_weighted_virial"]
"""


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT])
def test_interrupted_run_continues_bitwise(tmp_path, sign):
    text = PLATE + FIELDS if sign == signal.SIGINT else PLATE
    text = text.replace("steps = 120", "steps = 4000").replace(
        "every = 25", 'every = 200\nvtk = "frames"\nrestart = "end.npz"'
    )
    case = write(tmp_path, text)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    whole = Case.load(case).run(tmp_path / "whole.zarr", threads=1)
    end = dict(np.load(tmp_path / "end.npz"))
    out = tmp_path / "cut.zarr"
    with pytest.raises(AtcError, match=r"\[output\] vtk: .*frames exists: give --overwrite"):
        Case.load(case).output(out)
    shutil.rmtree(tmp_path / "frames")
    with pytest.raises(AtcError, match=r"\[output\] restart: .*end.npz exists"):
        Case.load(case).output(out)
    (tmp_path / "end.npz").unlink()
    process = subprocess.Popen(arguments(case, out, hold=4), env=env, stderr=subprocess.PIPE, text=True)
    wait_for(tmp_path / "cut.zarr.partial" / "journal.jsonl", 4, process)
    process.send_signal(sign)
    _, err = process.communicate(timeout=60)
    if sign == signal.SIGINT:
        assert process.returncode == 130 and "the same command continues" in err and "Traceback" not in err
    assert not out.exists() and (tmp_path / "cut.zarr.partial" / "restart.npz").exists()
    # the state between two entries, as a Ctrl-C leaves it, and a frame missing its entry
    before = int(np.load(tmp_path / "cut.zarr.partial" / "restart.npz")["step"])
    assert 0 < before < 4000 and (sign == signal.SIGKILL or before % 200 or before >= 600)
    with pytest.raises(AtcError, match="different: case"):
        Case.load(case, ["run.steps=3000"]).run(out, threads=1)
    finished = subprocess.run(arguments(case, out), env=env, capture_output=True, text=True, timeout=100)
    assert finished.returncode == 0, finished.stderr
    equal(open_dataset(out), whole)
    if sign == signal.SIGINT:
        equal(open_dataset(tmp_path / "cut-fields.zarr"), open_dataset(tmp_path / "whole-fields.zarr"))
    for name, a in np.load(tmp_path / "end.npz").items():
        assert np.array_equal(a, end[name]), name
    assert len(list((tmp_path / "frames").glob("*.vtu"))) == 21 and not (tmp_path / "cut.zarr.partial").exists()


def test_entry_whose_state_was_saved_is_made_up_for(tmp_path):
    """Killed between the state and its entry: the entry is written from the state."""
    from atc.cases import run as case_run

    case = Case.load(write(tmp_path))
    whole = case.run(tmp_path / "whole.zarr", threads=1)
    entry, count = case_run._Run._entry, [0]

    def fail(self, sim):
        count[0] += 1
        if count[0] == 3:
            raise RuntimeError("killed")
        entry(self, sim)

    case_run._Run._entry = fail
    try:
        with pytest.raises(RuntimeError):
            case.run(tmp_path / "cut.zarr", threads=1)
    finally:
        case_run._Run._entry = entry
    equal(case.run(tmp_path / "cut.zarr", threads=1), whole)


def test_restart_file_of_a_finished_run(tmp_path):
    """Two runs of 60 steps, the second from the first one's restart file, are the run of 120."""
    text = PLATE.replace("steps = 120", "steps = 60").replace("every = 25", 'every = 60\nrestart = "half.npz"')
    whole = Case.load(write(tmp_path)).run(tmp_path / "whole.nc", threads=1)
    Case.load(write(tmp_path, text)).run(tmp_path / "a.nc", threads=1)
    second = text.replace("steps = 60", 'steps = 60\nrestart = "half.npz"').replace('\nrestart = "half.npz"\n', "\n", 0)
    second = second.replace('every = 60\nrestart = "half.npz"', "every = 60")
    ds = Case.load(write(tmp_path, second, "second.toml")).run(tmp_path / "b.nc", threads=1)
    assert ds.step.values.tolist() == [60, 120]
    for name in ("displacement", "velocity", "damage", "force"):
        assert np.array_equal(ds[name][-1], whole[name][-1]), name
    (tmp_path / "half.npz").write_bytes(b"no such thing")
    with pytest.raises(AtcError, match="not a restart file"):
        Case.load(tmp_path / "second.toml").run(tmp_path / "c.nc", threads=1)


def test_fields_of_a_run_are_those_of_its_state(tmp_path):
    import atc

    case = Case.load(write(tmp_path, PLATE + FIELDS))
    case.run(tmp_path / "out.zarr", threads=1)
    ds = open_dataset(tmp_path / "out-fields.zarr")
    sim = case.simulation(1)
    sim.step(120)
    frame, bonds = pd.snapshot(sim)
    line = atc.Grid.line([0.002, 0.006, 0.0], [0.028, 0.006, 0.0], 14)
    names = [
        "density",
        "velocity",
        "peridynamic_stress",
        "peridynamic_piola_stress",
        "peridynamic_stress_weighted_virial",
    ]
    want = atc.fields(frame, bonds, atc.kernel("quartic", 0.003), line, names, reference=pd.reference_frame(sim))
    for name in names:
        # other threads, other order of sums
        np.testing.assert_allclose(ds[name][-1], want[name][0], rtol=0, atol=1e-11 * float(abs(want[name]).max()))
    assert ds.step.values.tolist() == [0, 25, 50, 75, 100, 120] and ds.attrs["sources"] == "plate.toml"
    for before, after, words in (
        ("radius = 0.003\n", "", r"plate.toml:58: \[kernel\]"),
        ("n = 14", "m = 14", r"plate.toml:66: unknown key 'm'"),
        ('"velocity",', '"velocty",', r"plate.toml:69: .*did you mean 'velocity'"),
        ('"velocity",', '"heat_flux",', "not defined for peridynamic bonds"),
    ):
        with pytest.raises(AtcError, match=words):
            Case.load(write(tmp_path, (PLATE + FIELDS).replace(before, after))).run(tmp_path / "no.zarr", threads=1)
    assert not list(tmp_path.glob("no*"))


def test_blown_up_runs_say_so(tmp_path):
    with pytest.raises(AtcError, match="blown up|no longer finite"):
        Case.load(write(tmp_path), ["run.dt=1e-5"]).run(tmp_path / "out.zarr", threads=1)


# --- bodies from files


def nodes_case(tmp_path, file, **body):
    case = {
        "body": {"file": str(file), "horizon": 2.01, **body},
        "material": {"model": "pmb", "bulk": 1.0},
        "run": {"steps": 1},
    }
    return make_body(Case.load(case))


def test_csv(tmp_path):
    (tmp_path / "n.csv").write_text("# nodes\nx, y, z, volume, material\n0,0,0,1.5,1\n1,0,0,2.5,1\n0,1,0,1,1\n")
    body = nodes_case(tmp_path, tmp_path / "n.csv", density=3.0)
    assert (
        body.X_nc.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
        and body.V_n.tolist() == [1.5, 2.5, 1.0]
        and set(body.rho_n) == {3.0}
    )
    with pytest.raises(AtcError, match="does not say the density"):
        nodes_case(tmp_path, tmp_path / "n.csv")
    for text, words in (
        ("x,y\n0,0\n", "missing: z"),
        ("x,y,z,w\n0,0,0,0\n", "unknown column 'w'"),
        ("x,y,z\n0,0,a\n", "'z' has no number in row 1"),
        ("x,y,z\n", "no nodes"),
    ):
        (tmp_path / "n.csv").write_text(text)
        with pytest.raises(AtcError, match=words):
            nodes_case(tmp_path, tmp_path / "n.csv", density=3.0, volume=1.0)


def test_extxyz(tmp_path):
    (tmp_path / "n.xyz").write_text(
        '2\nLattice="4 0 0 0 4 0 0 0 4" Properties=species:S:1:pos:R:3:volume:R:1:density:R:1 pbc="T T T"\nX 0 0 0 1 '
        "7\nX 1 0 0 2 8\n"
    )
    body = nodes_case(tmp_path, tmp_path / "n.xyz")
    assert body.V_n.tolist() == [1, 2] and body.rho_n.tolist() == [7, 8] and body.cell.periodic.all()


def test_lammps_data(tmp_path):
    (tmp_path / "n.data").write_text(
        "peri\n\n2 atoms\n1 atom types\n\n0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n\nAtoms # peri\n\n2 1 0.5 2200 1.1 0 "
        "0\n1 1 0.25 2200 0.1 0 0\n"
    )
    body = nodes_case(tmp_path, tmp_path / "n.data")
    assert (
        body.X_nc.tolist() == [[0.1, 0, 0], [1.1, 0, 0]]
        and body.V_n.tolist() == [0.25, 0.5]
        and set(body.rho_n) == {2200.0}
    )


def test_mesh(tmp_path):
    """Volumes of cells of every kind: a cube of side 2 in all the ways it can be cut, and a square in the plane."""
    import meshio

    c = 2.0 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    points = np.concatenate([c, [[1.0, 1.0, 1.0]]])
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (2, 3, 7, 6), (1, 2, 6, 5), (0, 4, 7, 3)]
    cuts = {
        "hexahedron": [list(range(8))],
        "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
        "pyramid": [[*f, 8] for f in faces],
        "tetra": [[a, b, c_, 8] for f in faces for a, b, c_ in ((f[0], f[1], f[2]), (f[0], f[2], f[3]))],
    }
    for name, cells in cuts.items():
        meshio.write(
            tmp_path / "m.vtu",
            meshio.Mesh(points, [(name, np.array(cells))], cell_data={"density": [np.arange(len(cells)) + 1.0]}),
        )
        body = nodes_case(tmp_path, tmp_path / "m.vtu")
        assert body.V_n.sum() == pytest.approx(8.0, rel=1e-12) and len(body) == len(cells)
        np.testing.assert_allclose(body.V_n @ body.X_nc / 8, [1, 1, 1], rtol=1e-12)
        assert body.rho_n.tolist() == [k + 1.0 for k in range(len(cells))]
    meshio.write(
        tmp_path / "m.vtu", meshio.Mesh(c[:4], [("quad", np.array([[0, 1, 2, 3]])), ("line", np.array([[0, 1]]))])
    )
    body = nodes_case(tmp_path, tmp_path / "m.vtu", dimension=2, thickness=0.5, density=1.0)
    assert body.V_n[0] == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(body.X_nc, [[1, 1, 0]], rtol=1e-12)
    with pytest.raises(AtcError, match="no cells of dimension 3: found line, quad"):
        nodes_case(tmp_path, tmp_path / "m.vtu", density=1.0)
    (tmp_path / "m.vtu").write_text("nothing")
    with pytest.raises(AtcError, match="not a mesh"):
        nodes_case(tmp_path, tmp_path / "m.vtu", density=1.0)


# --- to other programs


def test_vtk_extxyz_and_picture_of_a_run(tmp_path):
    import ase.io
    import meshio

    from atc.export.export import export
    from atc.pictures.plotting import plot_file

    text = PLATE.replace(
        "every = 25",
        'every = 40\nvtk = "frames"\nextxyz = "out.xyz"\nquantities = ["displacement", "damage", "stress", "energy"]',
    )
    ds = Case.load(write(tmp_path, text)).run(tmp_path / "out.zarr", threads=1)
    mesh = meshio.read(tmp_path / "frames" / "frames_00003.vtu")
    x = np.stack([ds[f"position_{a}"] for a in "xyz"], axis=1) + ds.displacement.values[-1]
    assert np.array_equal(mesh.points, x) and np.array_equal(mesh.point_data["damage"], ds.damage[-1])
    assert np.array_equal(mesh.point_data["stress"].reshape(-1, 3, 3), ds.stress[-1])
    pvd = (tmp_path / "frames" / "frames.pvd").read_text()
    assert all(f'timestep="{float(t)!r}" file="frames_{k:05d}.vtu"' in pvd for k, t in enumerate(ds.time.values))
    frames = ase.io.read(tmp_path / "out.xyz", index=":")
    assert (
        len(frames) == 4
        and np.array_equal(frames[3].positions, x)
        and np.array_equal(frames[2].arrays["damage"], ds.damage[2])
    )
    assert np.array_equal(frames[3].arrays["local_stress"].reshape(-1, 3, 3), ds.stress[-1])
    path = export(tmp_path / "out.zarr", quantities=["damage"], frames=slice(1, None, 2))
    assert sorted(p.name for p in path.with_suffix("").iterdir()) == ["out_00001.vtu", "out_00003.vtu"]
    mesh = meshio.read(path.with_suffix("") / "out_00003.vtu")
    assert set(mesh.point_data) == {"damage", "volume", "material"} and np.array_equal(mesh.points, x)
    for quantity in (None, "displacement", "stress"):
        assert plot_file(tmp_path / "out.zarr", quantity).stat().st_size > 5000
    with pytest.raises(AtcError, match="holds displacement, damage"):
        plot_file(tmp_path / "out.zarr", "temperature")
    with pytest.raises(AtcError, match="not a field"):
        export(tmp_path / "out.zarr", quantities=["temperature"])


def test_every_key_is_explained():
    """docs/case.md has every section and key of the schema, and every constant of every material."""
    import re
    from pathlib import Path

    from atc.cases.materials import models, parameters
    from atc.cases.run import QUANTITIES
    from atc.cases.schema import ARRAYS, SHAPES, TABLES

    text = (Path(__file__).resolve().parents[2] / "docs" / "case.md").read_text()
    words = set(re.findall(r"`([a-zA-Z_0-9-]+)`", text))
    sections = set(re.findall(r"\[(\w+)\]", " ".join(line for line in text.splitlines() if line.startswith("## "))))
    assert sections == {*TABLES, *ARRAYS}
    for name, known in {**TABLES, **ARRAYS}.items():
        if name not in ("kernel", "grid"):
            assert set(known) <= words, (name, set(known) - words)
    assert set(QUANTITIES) <= words and set(models()) <= words
    for cls in models().values():
        assert set(parameters(cls)) <= words, (cls.name, set(parameters(cls)) - words)
    assert all(f'shape = "{s}"' in text for s in SHAPES)


def test_names_of_the_engine_are_not_hidden_by_its_modules():
    """Importing a module must not put itself in the place of a function of the same name."""
    import pkgutil

    modules = {m.name for m in pkgutil.iter_modules(pd.__path__)}
    assert not modules & set(pd._LAZY)
    assert callable(pd.solve_static) and callable(pd.relax) and callable(pd.snapshot)


def bar_of_cubes(path, **more):
    """Four unit cubes in a row along x, as a mesh with sets; written as `path` says."""
    import meshio

    points = np.array([[x, y, z] for x in range(5) for y in (0, 1) for z in (0, 1)], float)
    cell = lambda k: [4 * k, 4 * k + 4, 4 * k + 6, 4 * k + 2, 4 * k + 1, 4 * k + 5, 4 * k + 7, 4 * k + 3]  # noqa: E731
    cells = [("hexahedron", np.array([cell(k) for k in range(4)])), *more.pop("faces", [])]
    meshio.write(
        path, meshio.Mesh(points, cells, **more), **({"file_format": "gmsh22"} if str(path).endswith("msh") else {})
    )


@pytest.mark.parametrize("kind", ["abaqus", "gmsh"])
def test_sets_of_a_mesh_are_regions(tmp_path, kind):
    """Element sets and node sets of Abaqus, physical groups of gmsh, faces too: materials, loads, and what is known."""
    if kind == "abaqus":
        file, end = tmp_path / "bar.inp", "LEFT"
        bar_of_cubes(file, cell_sets={"HARD": [np.array([2, 3])]}, point_sets={"LEFT": np.array([0, 1, 2, 3])})
        sets = {"HARD": [2, 3], "LEFT": [0]}
    else:
        file, end = tmp_path / "bar.msh", "left"
        bar_of_cubes(
            file, faces=[("quad", np.array([[0, 2, 3, 1]]))],
            cell_data={"gmsh:physical": [np.array([1, 1, 2, 2]), np.array([7])], "gmsh:geometrical": [np.array([1, 1, 2, 2]), np.array([7])]},
            field_data={"soft": np.array([1, 3]), "hard": np.array([2, 3]), "left": np.array([7, 2])},
        )  # fmt: skip
        sets = {"soft": [0, 1], "hard": [2, 3], "left": [0]}
    hard = "HARD" if kind == "abaqus" else "hard"
    case = {
        "body": {"file": str(file), "horizon": 1.5, "density": 2.0},
        "regions": {"end": {"shape": "set", "name": end}},
        "material": [
            {"model": "pmb", "youngs": 1.0},
            {"model": "pmb", "youngs": 3.0, "region": {"shape": "set", "name": hard}},
        ],
        "prescribed": [{"region": "end", "velocity": [0, 0, 0]},
                       {"region": {"all": [{"not": "end"}, {"shape": "set", "name": hard}]}, "velocity": [1, 0, 0]}],
        "run": {"steps": 1},
    }  # fmt: skip
    loaded = Case.load(case)
    sim = loaded.simulation(1)
    assert {n: np.flatnonzero(inside).tolist() for n, inside in loaded.sets.items()} == sets
    assert sim.body.material_n.tolist() == [1, 1, 2, 2]
    assert [p.nodes.tolist() for p in sim.prescribed] == [[0], [2, 3]]
    case["regions"]["end"]["name"] = "nowhere"
    with pytest.raises(AtcError, match=f"there is no set 'nowhere': expected a set of the mesh.*known: .*{end}"):
        Case.load(case).simulation(1)
    del case["body"]["file"]
    case["body"] |= {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [3, 1, 1]}, "spacing": 1.0}
    with pytest.raises(AtcError, match="the set 'nowhere' is one of a mesh: give \\[body\\] file"):
        Case.load(case)
