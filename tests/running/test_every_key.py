"""Every key of a scene that changes a number is noticed when a run goes on; the keys are taken from the schema, so that
a new one cannot be forgotten."""

import copy

import nep_oracle
import numpy as np
import pytest
from test_cli import write_dump
from test_run import Stop, stop_after

from atc.config.potentials import SYSTEMS
from atc.config.scene import Scene
from atc.config.schema import GRIDS, SCHEMA
from atc.errors import AtcError

LJ = "pair_style lj/cut 7.0\npair_coeff 1 1 0.0104 3.4\n"
BASE = {
    "trajectory": {"file": "run.dump", "units": "metal", "masses": {"1": 39.948}},
    "potential": {"lammps": LJ},
    "kernel": {"name": "quartic", "radius": 5.0},
    "grid": {"kind": "regular", "shape": [3, 3, 3]},
    "fields": {"quantities": ["stress", "density"]},
}
PLANE = {"kind": "plane", "axis": "z", "shape": [3, 3]}
PLANE_OF_ITS_OWN = {**PLANE, "origin": [0.0, 0.0, 8.0], "u": [16.2, 0.0, 0.0], "v": [0.0, 16.2, 0.0]}
del PLANE_OF_ITS_OWN["axis"]
LINE = {"kind": "line", "start": [0.0, 0.0, 0.0], "end": [16.2, 0.0, 0.0], "n": 4}
SLAB = {"kind": "slab", "axis": "z", "bins": 4}
PLANES = {"kind": "planes", "axis": "z", "positions": [2.0, 5.0], "interval": 0.1}
OF_STRESS = {"fields": {"quantities": ["stress"]}}
BOX = {
    "kind": "regular",
    "shape": [3, 3, 3],
    "origin": [0.0, 0.0, 0.0],
    "vectors": [[16.2, 0, 0], [0, 16.2, 0], [0, 0, 16.2]],
}
DATA = {**BASE["trajectory"], "topology": "run.data", "atom_style": "molecular"}
OF_BOX = {"potential": {"lammps": LJ}, "fields": {"quantities": ["virial_stress"]}}
HALF = {"region": "block 0 8 0 8 0 8", "fixed": True}
PORE = {"kind": "cylindrical", "radius": 5.0, "shape": [2, 3, 2], "center": [8.0, 8.0, 8.0]}
BARE = {
    "trajectory": {"file": "bare.xyz", "units": "metal", "cell": [16.2, 16.2, 16.2], "pbc": True},
    "potential": None,
    "fields": {"quantities": ["number_density"]},
}
TABLE = [[0.0, 1.0], [2.5, 0.5], [5.0, 0.0]]


def held(**more):
    """A scene in which the distance of two atoms is fixed."""
    return {"constraints": {"pairs": [[1, 2]], "source": "velocities", **more}}


#: key: (what the scene is to begin with, the key's other value); {} is the base.
CHANGES = {
    "trajectory.file": ({}, "other.dump"),
    "trajectory.topology": ({"trajectory": {**DATA, "atom_style": "charge"}}, "other.data"),
    "trajectory.atom_style": ({"trajectory": DATA}, "charge"),
    "trajectory.units": ({}, "real"),
    "trajectory.masses": ({}, {"1": 40.0}),
    "trajectory.cell": (BARE, [16.2, 16.2, 16.3]),
    "trajectory.pbc": (BARE, "ppf"),
    "trajectory.dimension": (
        {
            "trajectory": {**BASE["trajectory"], "file": "flat.dump", "dimension": 2},
            **OF_BOX,
            "kernel": None,
            "grid": None,
        },
        3,
    ),
    "trajectory.frames": ({}, "1:"),
    "trajectory.timestep": ({"trajectory": {**BASE["trajectory"], "timestep": 0.001}}, 0.002),
    "trajectory.reference": (
        {"trajectory": {**BASE["trajectory"], "reference": 0}, "fields": {"quantities": ["displacement"]}},
        1,
    ),
    "potential.lammps": ({}, LJ.replace("3.4", "3.41")),
    "potential.input": ({"potential": {"input": "in.run"}}, "in.other"),
    "potential.nep": ({"potential": {"nep": "nep.txt", "types": ["Ar"]}}, "other.nep"),
    "potential.types": ({"potential": {"nep": "nep.txt", "types": ["Ar"]}}, ["Ne"]),
    "potential.units": (
        {"trajectory": {**BASE["trajectory"], "units": "real"}, "potential": {"lammps": LJ, "units": "real"}},
        "metal",
    ),
    "potential.run": ({"potential": {"input": "in.two", "run": 1}}, 2),
    "potential.partition": (
        {"potential": {"lammps": "pair_style sw\npair_coeff * * Ar.sw Ar\n", "partition": "equal"}},
        "center",
    ),
    "potential.alpha": (
        {
            "trajectory": {**DATA, "topology": "salt.data", "atom_style": "charge"},
            "potential": {
                "lammps": LJ.replace("lj/cut", "lj/cut/coul/long") + "kspace_style ewald 1e-4\n",
                "alpha": 0.5,
            },
            "kernel": {"name": "gaussian", "width": 2.0},
        },
        0.6,
    ),
    "kernel.name": ({}, "lucy"),
    "kernel.radius": ({}, 5.1),
    "kernel.width": ({"kernel": {"name": "gaussian", "width": 2.0}}, 2.1),
    "kernel.size": ({"kernel": {"name": "box", "size": [4.0, 4.0, 4.0]}}, [4.0, 4.0, 5.0]),
    "kernel.table": ({"kernel": {"name": "piecewise-linear", "table": TABLE}}, [[0.0, 1.0], [2.5, 0.6], [5.0, 0.0]]),
    "grid.kind": ({"grid": {"kind": "atoms"}}, {"kind": "points", "points": [[0.0, 0.0, 0.0]]}),
    "grid.shape": ({}, [3, 3, 4]),
    "grid.spacing": ({"grid": {"kind": "regular", "spacing": 6.0}}, 4.0),
    "grid.at": ({}, "corners"),
    "grid.padding": ({"grid": {**BASE["grid"], "padding": 2.0}}, 3.0),
    "grid.origin": ({"grid": BOX}, [0.1, 0.0, 0.0]),
    "grid.vectors": ({"grid": BOX}, [[16.2, 0, 0], [0, 16.2, 0], [0, 0, 16.0]]),
    "grid.axis": ({"grid": SLAB}, "y"),
    "grid.position": ({"grid": {**PLANE, "position": 2.0}}, 3.0),
    "grid.u": ({"grid": PLANE_OF_ITS_OWN}, [16.0, 0.0, 0.0]),
    "grid.v": ({"grid": PLANE_OF_ITS_OWN}, [0.0, 16.0, 0.0]),
    "grid.start": ({"grid": LINE}, [0.0, 0.0, 0.5]),
    "grid.end": ({"grid": LINE}, [16.2, 0.0, 0.5]),
    "grid.n": ({"grid": LINE}, 5),
    "grid.bins": ({"grid": SLAB}, 5),
    "grid.means": ({"grid": SLAB}, True),
    "grid.positions": ({"grid": PLANES, **OF_STRESS}, [2.0, 5.5]),
    "grid.patches": ({"grid": {**PLANES, "patches": [1, 2]}, **OF_STRESS}, [2, 2]),
    "grid.interval": ({"grid": PLANES, **OF_STRESS}, 0.2),
    "grid.follow": ({"grid": {"kind": "points", "points": [[1.0, 2.0, 3.0]]}, "select": HALF}, "mass"),
    "grid.center": ({"grid": PORE}, [8.0, 8.0, 8.5]),
    "grid.radius": ({"grid": PORE}, 5.5),
    "grid.inner": ({"grid": {**PORE, "inner": 1.0}}, 1.5),
    "grid.length": ({"grid": {**PORE, "length": 8.0}}, 9.0),
    "grid.points": ({"grid": {"kind": "points", "points": [[1.0, 2.0, 3.0]]}}, [[1.0, 2.0, 3.1]]),
    "select.types": ({"select": {"types": [1]}}, [1, 2]),
    "select.ids": ({"select": {"ids": "1:9"}}, "1:8"),
    "select.region": ({"select": {"region": "block 0 8 INF INF INF INF"}}, "block 0 9 INF INF INF INF"),
    "select.invert": ({"select": {"ids": "1:9", "invert": False}}, True),
    "select.fixed": ({"select": {"region": "block 0 8 INF INF INF INF", "fixed": False}}, True),
    "select.by": ({}, "type"),
    "select.bonds": ({"select": {"ids": "1:9", "bonds": "half"}}, "both"),
    "fields.quantities": ({}, ["density"]),
    "fields.column_units": ({"fields": {"quantities": ["column:vx"]}}, {"vx": "furlong"}),
    "fields.tolerance": ({}, 1e-6),
    "fields.method": ({}, "direct"),
    "fields.horizon": ({"fields": {"quantities": ["peridynamic_stress_weighted_virial"], "horizon": 5.0}}, 6.0),
    "fields.tiles": ({}, [2, 1, 1]),
    "fields.average": ({}, 2),
    "fields.velocity": ({}, "local"),
    "constraints.pairs": (held(), [[1, 3]]),
    "constraints.source": (held(temperature=100.0), "temperature"),
    "constraints.temperature": (held(source="temperature", temperature=100.0), 101.0),
    "constraints.timestep": (held(source="step", timestep=0.001), 0.002),
    "constraints.leapfrog": (held(source="step", timestep=0.001, leapfrog=False), True),
    "constraints.in_forces": (held(in_forces=True), False),
}
#: Keys of molecules, in the form of two tables of [constraints] that are not the same.
OF_MOLECULES = {
    "constraints.bonds": ({}, {"bonds": "hbonds"}),
    "constraints.rigid_water": ({"bonds": "hbonds"}, {"bonds": "hbonds", "rigid_water": False}),
    "constraints.molecules": ({"molecules": True}, {"molecules": [1, 2]}),
}
#: Keys of topologies that say what is held: decomposers/test_constraints_topology.py.
OF_TOPOLOGIES = {"constraints.topology"}
#: Keys of models that need packages of their own: torch_models/test_mace.py and so on, decomposers/test_kim.py,
#: decomposers/test_openmm.py.
APART = {f"potential.{k}" for k in ("mace", "nequip", "metatomic", "kim", "head", "stress", "reference")} | {
    f"potential.{k}" for k in {*SYSTEMS, *(key for keys in SYSTEMS.values() for key in keys)}
}
#: Ways to pick atoms that these files say nothing for: tests/estimators/test_selections.py.
OF_NAMES = {"select.atoms", "select.elements", "select.molecules", "select.groups"}
#: Keys that no number of `atc fields` depends on, and why.
CHANGE_NOTHING = {
    "potential.device": "where it is computed",
    "trajectory.forces": "what to do where the run's forces are not the potential's; compared again where it changes",
    "trajectory.log": "as forces",
    "check": "of atc check, which keeps nothing",
    "dispersion": "of atc dispersion, which computes everything anew",
    "twin": "of atc twin, which computes everything anew",
    "output": "where the result goes",
}
#: Files whose content counts, not their names: key of the scene, the scene, the file, what it says, what it says then.
CONTENTS = {
    "trajectory.topology": ({"trajectory": {**DATA, "atom_style": "charge"}}, "run.data", "other.data"),
    "trajectory.reference": (
        {"trajectory": {**BASE["trajectory"], "reference": "start.dump"}, "fields": {"quantities": ["displacement"]}},
        "start.dump",
        "other.dump",
    ),
    "potential.input": ({"potential": {"input": "in.run"}}, "in.run", "in.other"),
    "potential.lammps": ({"potential": {"lammps": "pair_style sw\npair_coeff * * Ar.sw Ar\n"}}, "Ar.sw", "Ar.other"),
    "potential.nep": ({"potential": {"nep": "nep.txt", "types": ["Ar"]}}, "nep.txt", "other.nep"),
    "kernel.table": ({"kernel": {"name": "piecewise-linear", "table": "phi.txt"}}, "phi.txt", "phi.other"),
    "grid.points": ({"grid": {"kind": "points", "points": "points.txt"}}, "points.txt", "points.other"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_dump("run.dump", frames=4)
    write_dump("other.dump", frames=4, seed=2)
    write_dump("start.dump", frames=1, seed=3)
    flat = (tmp_path / "run.dump").read_text().splitlines()
    for k, line in enumerate(flat):
        words = line.split()
        if len(words) == 8 and words[0] != "ITEM:":
            flat[k] = " ".join([*words[:4], "0", *words[5:7], "0"])
    frames = (tmp_path / "run.dump").read_text().split("ITEM: TIMESTEP")[1:]
    bare = [[line.split()[2:5] for line in f.splitlines()[9:]] for f in frames]
    (tmp_path / "bare.xyz").write_text(
        "".join(f"{len(f)}\n\n" + "".join(f"Ar {' '.join(x)}\n" for x in f) for f in bare)
    )
    (tmp_path / "flat.dump").write_text("\n".join(flat) + "\n")
    (tmp_path / "in.run").write_text("units metal\n" + LJ)
    (tmp_path / "in.other").write_text("units metal\n" + LJ.replace("3.4", "3.41"))
    (tmp_path / "in.two").write_text("units metal\n" + LJ + "run 200\npair_coeff 1 1 0.0104 3.41\nrun 200\n")
    sw = "Ar Ar Ar 2.1683 2.8 1.80 21.0 1.20 -0.3333\n 7.049 0.602 4.0 0.0 0.0\n"
    (tmp_path / "Ar.sw").write_text("# UNITS: metal\n" + sw)
    (tmp_path / "Ar.other").write_text("# UNITS: metal\n" + sw.replace("21.0", "21.1"))
    for seed, name in enumerate(("nep.txt", "other.nep")):
        nep_oracle.write(tmp_path / name, seed, names=("Ar", "Ne"))
    (tmp_path / "phi.txt").write_text("0 1\n2.5 0.5\n5 0\n")
    (tmp_path / "phi.other").write_text("0 1\n2.5 0.6\n5 0\n")
    (tmp_path / "points.txt").write_text("1 2 3\n")
    (tmp_path / "points.other").write_text("1 2 3.5\n")
    rows = np.array(
        [line.split() for line in (tmp_path / "run.dump").read_text().split("ITEM: TIMESTEP")[1].splitlines()[9:]],
        object,
    )
    for name, third in (("run.data", "1 1"), ("other.data", "2 2"), ("salt.data", "1 -1")):
        charges = [third.split()[k % 2] for k in range(len(rows))]
        atoms = "".join(f"{r[0]} 1 {q} {r[2]} {r[3]} {r[4]}\n" for r, q in zip(rows, charges))
        box = "".join(f"0 16.2 {a}lo {a}hi\n" for a in "xyz")
        (tmp_path / name).write_text(f"t\n\n{len(rows)} atoms\n2 atom types\n{box}\nAtoms\n\n{atoms}")
    return tmp_path


def sections(changes):
    return {s: t for s, t in copy.deepcopy({**BASE, **changes}).items() if t is not None}


def begin(scene, out):
    with pytest.raises(Stop):
        Scene.load(scene).write(out, progress=stop_after(2))


def noticed(scene, out):
    with pytest.raises(AtcError, match=r"different: |is not what it was") as e:
        Scene.load(scene).write(out)
    assert "\n" not in str(e.value)


def test_every_key_is_spoken_of():
    keys = {f"{s}.{k}" for s, t in SCHEMA.items() for k in t}
    unspoken = {
        k
        for k in keys - CHANGES.keys() - OF_MOLECULES.keys() - OF_NAMES - APART - OF_TOPOLOGIES
        if k not in CHANGE_NOTHING and k.split(".")[0] not in CHANGE_NOTHING
    }
    assert not unspoken and not set(CHANGES) - keys
    assert (
        not {k for s, t in SCHEMA.items() for k, spec in t.items() if spec.path for k in [f"{s}.{k}"]}
        - CONTENTS.keys()
        - APART
        - {
            # the frames' contents: test_same_run.py
            "trajectory.file",
            "trajectory.log",
            # read into pairs, which CHANGES has
            "constraints.pairs",
            "dispersion.unit_cell",
            "output.file",
            # of atc twin, which computes everything anew
            "twin.equilibrium",
        }
    )
    kinds = {"plane", "line", "slab", "points", "atoms", "regular", "cylindrical", "spherical", "planes"}
    assert kinds == set(GRIDS)


@pytest.mark.parametrize("key", CHANGES)
def test_a_changed_key_is_noticed(folder, key):
    changes, value = CHANGES[key]
    section, name = key.split(".")
    scene = sections(changes)
    begin(scene, folder / "out.zarr")
    if key == "grid.kind":
        scene["grid"] = value
    else:
        scene.setdefault(section, {})[name] = value
    noticed(scene, folder / "out.zarr")


@pytest.mark.parametrize("key", OF_MOLECULES)
def test_a_changed_key_of_molecules_is_noticed(key):
    import atc
    from atc.decomposers.constraints.scene import constrained
    from atc.planning.identity import digest
    from atc.units import units

    pot = atc.potential(LJ, units="metal")
    one, other = (digest(constrained(pot, table, units("metal"), "scene.toml")) for table in OF_MOLECULES[key])
    assert one != other
    assert one == digest(constrained(pot, OF_MOLECULES[key][0], units("metal"), "scene.toml"))


@pytest.mark.parametrize("key", CONTENTS)
def test_a_changed_file_is_noticed(folder, key):
    changes, name, other = CONTENTS[key]
    scene = sections(changes)
    begin(scene, folder / "out.zarr")
    (folder / name).write_bytes((folder / other).read_bytes())
    noticed(scene, folder / "out.zarr")


# --- cases of `atc pd`: the whole text counts, and what is in the files it names

TABLE_OF_CASE = (
    '[kernel]\nname = "piecewise-linear"\ntable = "phi.txt"\n\n[grid]\nkind = "points"\npoints = '
    '"points.txt"\n\n[fields]\nquantities = ["density"]\n'
)


@pytest.mark.parametrize("name, line", [("phi.txt", "0.003 0\n"), ("points.txt", "0.012 0.007 0\n")])
def test_files_of_a_case(tmp_path, name, line):
    from test_case import PLATE

    from atc.cases.case import Case

    (tmp_path / "phi.txt").write_text("0 1\n0.0015 0.5\n0.003 0\n")
    (tmp_path / "points.txt").write_text("0.01 0.006 0\n0.02 0.006 0\n")
    (tmp_path / "case.toml").write_text(PLATE + TABLE_OF_CASE)
    with pytest.raises(Stop):
        Case.load(tmp_path / "case.toml").run(tmp_path / "out.zarr", threads=1, progress=stop_after(50))
    text = (tmp_path / name).read_text()
    (tmp_path / name).write_text(text.replace(text.splitlines(keepends=True)[-1], line.replace("0.003", "0.0031")))
    with pytest.raises(AtcError, match=r"different: (kernel.table|grid.points)"):
        Case.load(tmp_path / "case.toml").run(tmp_path / "out.zarr", threads=1)


def test_every_file_of_a_case_is_a_key_of_a_table():
    """`_request` looks for files there."""
    from atc.cases.schema import ARRAYS

    assert not [k for keys in ARRAYS.values() for k, spec in keys.items() if spec.path]
