"""Cases: the TOML file in which a person describes a peridynamic body, what acts on it, and what to keep of the run.

Sections ``[body]``, ``[regions.NAME]``, ``[[material]]``, ``[[interface]]``, ``[damage]``, ``[contact]``,
``[[notch]]``, ``[[indenter]]``, ``[[wall]]``, ``[[initial]]``, ``[[prescribed]]``, ``[[temperature]]``,
``[[heat_source]]``, ``[[body_force]]``, ``[run]``,
``[output]``, and ``[kernel]``, ``[grid]``, ``[fields]`` as in scenes. Everything is checked before anything is
computed, and every complaint names the file and the line. Numbers are in any one consistent system of units; the output
labels them as SI. Paths are relative to the case.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ..config.document import Document
from ..config.toml import shown, toml_document
from ..config.words import guess, unknown
from ..errors import AtcError
from .crystals import check as check_crystals
from .crystals import has_density
from .materials import bond_based, keys_of
from .schema import ARRAYS, TABLES

#: Keys of which tables of these sections need exactly one.
_ONE_OF = {
    "prescribed": [("velocity", "displacement")],
    "initial": [("velocity", "displacement")],
    "body_force": [("density", "total")],
    "heat_source": [("density", "total")],
    "temperature": [("value",)],
    "indenter": [("radius",), ("stiffness",), ("center",)],
    "wall": [("point",), ("normal",), ("stiffness",)],
}


@dataclass
class Case(Document):
    """A checked case.

    Attributes
    ----------
    data : {section: {key: value}}, and lists of such tables for the sections that may be repeated
    folder : where relative paths start
    name : what to call the case in messages
    sets : {name: (n,) bools} of the mesh that its body was made from
    crystals : {number of the material: (Crystal at rest, Potential)}, as they are made
    """

    what = "case"
    example = "run.steps=100"
    tables = TABLES
    arrays = ARRAYS

    sets: dict = field(default_factory=dict, repr=False, compare=False)
    crystals: dict = field(default_factory=dict, repr=False, compare=False)

    def tables_of(self, *sections):
        """(path, table) of every table in sections that may be repeated."""
        for section in sections:
            yield from (((section, str(k)), t) for k, t in enumerate(self.data.get(section, [])))

    def refuse(self, path, table, keys, why) -> None:
        """Raise if a table has one of some keys, which do not go with what it says."""
        for key in keys:
            if key in table:
                raise self.bad((*path, key), why)

    def check(self) -> None:
        for name in self.data.get("regions", {}):
            self.check_value(TABLES["body"]["region"], self.data["regions"], name, ("regions", name))
        for section, table in self.data.items():
            if section in ARRAYS:
                for path, t in self.tables_of(section):
                    self.check_table(path, t, self._keys(path, t), partial(self._not_of_bonds, t))
            elif section != "regions":
                self.check_table((section,), table, TABLES[section])
        self._check_body()
        self._check_things()
        for path, region in self._regions_used():
            self._check_region(region, path)

    @staticmethod
    def _not_of_bonds(table, key) -> str:
        if key not in ("poisson", "shear") or not bond_based(table.get("model")):
            return ""
        return (
            f"bonds of {table['model']} fix Poisson's ratio at 1/4 (plane stress 1/3): one modulus is all; take lps "
            "for another ratio"
        )

    def _keys(self, path, table):
        if path[0] != "material":
            return ARRAYS[path[0]]
        model = table.get("model")
        if model is None:
            raise self.wrong(path, 'needs model, e.g. model = "pmb"')
        return {**ARRAYS["material"], **keys_of(model, lambda why: self.bad((*path, "model"), why))}

    def _check_body(self):
        if "body" not in self.data:
            example = 'region = { shape = "box", ... }'
            raise self.need(
                "body", f"it needs region and spacing (a lattice), or file (nodes), and horizon, e.g. {example}"
            )
        body = self.data["body"]
        if ("region" in body) == ("file" in body):
            raise self.need(
                "body", "[body] needs region (a lattice inside it) or file (nodes from a file), and not both"
            )
        if "horizon" not in body:
            raise self.need("body", "[body] needs horizon, a length of about three spacings, e.g. horizon = 0.0015001")
        if "region" in body:
            if "spacing" not in body:
                raise self.need("body", "[body] needs spacing, the distance between the nodes of its lattice")
            why = "belongs to nodes from a file; those of a lattice have spacing^3 "
            why += "(spacing^2 thickness in two dimensions)"
            self.refuse(("body",), body, ["volume"], why)
        else:
            why = "belongs to a lattice (region and spacing), not to nodes from a file"
            self.refuse(("body",), body, ("offset", "jitter", "seed", "cut"), why)
            path = self.path("body", "file")
            if not os.path.isfile(path):
                raise self.bad(("body", "file"), f"there is no file {path}")
        if body.get("dimension", 3) == 3:
            why = "belongs to a body of dimension 2 (plane, thickness) or 1 (thickness: its cross-section)"
            self.refuse(("body",), body, ("plane", "thickness"), why)
        elif body["dimension"] == 1:
            self.refuse(("body",), body, ["plane"], "belongs to a body of dimension 2")
        if "periodic" in body and any(body["periodic"]) and "cell" not in body:
            raise self.bad(("body", "periodic"), "a periodic body needs cell, three lengths or edge vectors")
        if "cell" in body and "periodic" not in body:
            raise self.bad(("body", "cell"), "say which of its axes are periodic: periodic = [true, true, true]")
        if "strain" in body:
            self._check_strain(body)
        if not self.data.get("material"):
            raise self.need("material", 'it needs model and its constants, e.g. model = "pmb" and bulk = 14.9e9')
        if "density" not in body and "file" not in body and not all(has_density(m) for m in self.data["material"]):
            raise self.need("body", "[body] needs density, a mass per volume")

    def _check_strain(self, body):
        H = body["strain"]
        if not any(body.get("periodic", ())):
            raise self.bad(("body", "strain"), "belongs to a periodic body: give cell and periodic")
        d = body.get("dimension", 3)
        if any(H[i][j] for i in range(3) for j in range(3) if max(i, j) >= d):
            raise self.bad(("body", "strain"), f"a body of dimension {d} has no strain along {'xyz'[d:]}")
        F = [[H[i][j] + (i == j) for j in range(3)] for i in range(3)]
        turns = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        J = sum(F[0][i] * (F[1][j] * F[2][k] - F[1][k] * F[2][j]) for i, j, k in turns)
        if not J > 0:
            raise self.bad(("body", "strain"), f"would turn the body inside out: det(1 + strain) = {J:g}")

    def _check_things(self):
        def one_of(path, table, *keys, least=1):
            given = [k for k in keys if k in table]
            if len(given) != 1 and (given or least):
                raise self.wrong(path, f"needs {'exactly one of ' if len(keys) > 1 else ''}{' and '.join(keys)}")

        for path, t in self.tables_of(*ARRAYS):
            for keys in _ONE_OF.get(path[0], ()):
                one_of(path, t, *keys)
            if path[0] == "notch" and set(t) - {"as_damage"} not in ({"start", "end"}, {"origin", "a", "b"}):
                why = "needs start and end (a line in the plate), or origin, a and b (a parallelogram)"
                raise self.wrong(path, why)
            where = {"indenter": "center", "wall": "point"}.get(path[0])
            if where and (isinstance(t[where], dict) or any(isinstance(c, (str, dict)) for c in t[where])):
                self.refuse(path, t, ["velocity"], f"{where} is a function of time already: give one of the two")
        numbers = [m.get("id", k + 1) for k, m in enumerate(self.data["material"])]
        if len(set(numbers)) < len(numbers):
            raise self.need("material", f"two materials have the same number: {numbers}")
        check_crystals(self)
        from .damage import check

        breaking = check(self, one_of)
        run = self.data.get("run", {})
        if "steps" not in run:
            raise self.need("run", "it needs steps, e.g. steps = 2000")
        if "dt" in run:
            self.refuse(("run",), run, ["safety"], "dt is given: give one of the two")
        if run.get("solver", "verlet") != "verlet":
            why = f"belongs to motion: solver = {run['solver']!r} looks for equilibrium at every step"
            self.refuse(("run",), run, ("safety", "damping"), why)
            why = f"what is at rest under friction depends on how it came there: solver = {run['solver']!r} has none"
            for path, t in [(("contact",), self.data.get("contact", {})), *self.tables_of("indenter", "wall")]:
                if t.get("friction"):
                    raise self.bad((*path, "friction"), why)
            if breaking:
                why = 'leave [damage], s00 and Gc out, or take solver = "verlet" with damping'
                raise AtcError(f'{self.where(*breaking)}: solver = "{run["solver"]}" breaks no bonds: {why}')
        else:
            self.refuse(("run",), run, ("tolerance", "iterations"), 'belongs to solver = "relax" or "static"')
        output = self.data.get("output", {})
        from .run import QUANTITIES

        for q in output.get("quantities", []):
            if q not in QUANTITIES:
                raise self.bad(("output", "quantities"), unknown(repr(q), q, QUANTITIES))
        if Path(output.get("extxyz", "frames.xyz")).suffix not in (".extxyz", ".xyz"):
            why = f"expected a name that ends in .extxyz or .xyz, got {output['extxyz']!r}"
            raise self.bad(("output", "extxyz"), why)
        from .fields import scene_of

        scene_of(self)
        restart = self.path("run", "restart")
        if restart is not None and not os.path.isfile(restart):
            raise self.bad(("run", "restart"), f"there is no file {restart}")

    def _regions_used(self):
        for name, region in self.data.get("regions", {}).items():
            yield ("regions", name), region
        if "region" in self.data["body"]:
            yield ("body", "region"), self.data["body"]["region"]
        for region in self.get("damage", "no_fail", []):
            yield ("damage", "no_fail"), region
        for path, t in self.tables_of(*ARRAYS):
            if "region" in t:
                yield (*path, "region"), t["region"]

    def _check_region(self, region, path, inside=()):
        known = self.data.get("regions", {})
        if isinstance(region, str):
            if region not in known:
                names = ", ".join(known) or "none; write [regions.NAME]"
                raise self.bad(path, f"there is no region {region!r}: {guess(region, known)}known: {names}")
            if region in inside:
                raise self.bad(("regions", region), "is made of itself")
            self._check_region(known[region], ("regions", region), (*inside, region))
            return
        for r in [*region.get("any", ()), *region.get("all", ()), *([region["not"]] if "not" in region else ())]:
            self._check_region(r, path, inside)
        shape = region.get("shape")
        if shape == "set" and "file" not in self.data["body"]:
            raise self.bad(path, f"the set {region['name']!r} is one of a mesh: give [body] file, or another shape")
        if shape == "box" and any(a > b for a, b in zip(region["lo"], region["hi"])):
            raise self.bad(path, f"a box needs lo <= hi, got {shown(region['lo'])} and {shown(region['hi'])}")

    # ---- what it means

    def simulation(self, threads: int = 0, state=None):
        """The `atc.pd.Simulation` this case describes, at its start (or at `state`)."""
        from .build import simulation

        return simulation(self, threads, state)

    def run(self, out, *, threads: int = 0, progress=None, resume: bool = True):
        """Run the case into `out` (.zarr or .nc); see `atc.cases.run.run`. Returns the xarray.Dataset."""
        from .run import run

        return run(self, out, threads=threads, progress=progress, resume=resume)

    def output(self, given=None, overwrite: bool = False, resume: bool = False) -> Path:
        path = super().output(given, overwrite, resume)
        # What an interrupted run has left of them is its own.
        begun = path.with_name(path.name + ".partial").exists()
        for key in () if overwrite or begun else ("vtk", "extxyz", "restart"):
            other = self.path("output", key)
            if other is not None and other.exists():
                raise self.bad(("output", key), f"{other} exists: give --overwrite to replace it, or another name")
        self.check_places()
        return path

    def check_places(self) -> None:
        """Raise if the folders of what is written at the end of a run are not there: before it, not after hours."""
        for key in ("extxyz", "restart"):
            path = self.path("output", key)
            if path is not None and not (path.parent.is_dir() and os.access(path.parent, os.W_OK | os.X_OK)):
                why = f"there is no directory {path.parent} to write in: make it, or choose another place"
                raise self.bad(("output", key), why)

    def to_toml(self) -> str:
        """The case with its overrides as TOML; file names without their folders."""
        sections = {s: self.data[s] for s in (*TABLES, *ARRAYS) if s in self.data}
        return toml_document({s: self._plain(s, given) for s, given in sections.items()})

    def _plain(self, section, given):
        if isinstance(given, list):
            return [self._plain(section, table) for table in given]
        paths = {k for k, spec in {**TABLES, **ARRAYS}[section].items() if spec.path}
        return {k: Path(v).name if k in paths and isinstance(v, str) else v for k, v in given.items()}
