"""Scenes: the TOML file in which a person says what to compute.

A scene has the sections ``[trajectory]``, ``[potential]``, ``[kernel]``, ``[grid]``, ``[select]``, ``[fields]``,
``[check]``, ``[dispersion]``, ``[twin]`` and ``[output]``. Everything in it is checked before anything is computed;
every complaint names the file and the line (or the ``--set`` flag) and says what was expected. Paths are relative to
the scene file, lengths in the trajectory's unit style.
"""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import AtcError
from ..readers.whole import whole_text
from .schema import GRIDS, SCHEMA
from .toml import Document, complaint, key_lines, parse, read_document, shown, toml_document
from .words import frame_slice, unknown

#: What makes a potential of a learned model's file, or of a name, and what else [potential] may tell it.
LEARNED = {
    "nep": ("types", "reference"),
    "mace": ("types", "head", "stress", "reference", "device"),
    "nequip": ("types", "stress", "reference", "device"),
    "metatomic": ("types", "stress", "reference", "device"),
    "kim": ("types",),
}
#: Systems of other codes, and what [potential] may tell of the run besides.
_RUN = ("method", "cutoff", "switch", "switching", "chiral", "constraints", "rigid_water")
SYSTEMS = {
    "openmm": ("switching", "chiral"),
    "prmtop": _RUN,
    "psf": ("parameters", *_RUN),
    "top": ("defines", "include", *_RUN),
}
#: Formats that hold coordinates and do not say whose.
_BARE = {f".{w}" for w in "dcd xtc trr nc ncdf mdcrd crdbox trj tng inpcrd rst7 coor".split()}

# --------------------------------------------------------------------------------------------------------------------


@dataclass
class Scene(Document):
    """What to compute: a checked scene.

    Attributes
    ----------
    data : {section: {key: value}} after overrides, checked; values in the user's units, paths as written
    folder : where relative paths start
    name : what to call the scene in messages
    """

    data: dict[str, dict[str, Any]]
    folder: Path = field(default_factory=Path, compare=False)
    name: str = field(default="scene", compare=False)
    _lines: dict = field(default_factory=dict, repr=False, compare=False)
    _flags: dict = field(default_factory=dict, repr=False, compare=False)
    _text: str = field(default="", repr=False, compare=False)
    #: (what it was made from, potential), the last one read
    _made: tuple = field(default=(None, None), repr=False, compare=False)

    # ---- making one

    @classmethod
    def load(cls, source: str | os.PathLike | Mapping, overrides: Mapping[str, Any] | list[str] | None = None) -> Scene:
        """Read and check a scene.

        Parameters
        ----------
        source : path of a TOML file, or a mapping of sections
        overrides : ``{"kernel.radius": 10}`` or ``["kernel.radius=10"]`` (the value as TOML, or a bare word)

        Raises
        ------
        AtcError : naming file, line and key, for anything unknown, missing or malformed
        """
        if isinstance(source, Scene):
            return cls.load({s: dict(t) for s, t in source.data.items()}, overrides)._placed(source)
        if isinstance(source, Mapping):
            data = {k: dict(v) if isinstance(v, Mapping) else v for k, v in source.items()}
            return cls._build(data, Path(), "scene", {}, overrides)
        path = Path(source)
        return cls.loads(read_document(path, "scene"), name=str(path), folder=path.parent, overrides=overrides)

    @classmethod
    def loads(cls, text: str, name: str = "scene", folder: str | os.PathLike = ".", overrides=None) -> Scene:
        """Check a scene given as TOML text."""
        try:
            data = parse(text)
        except tomllib.TOMLDecodeError as e:
            if Path(name).suffix not in (".toml", ""):
                raise AtcError(f"{name}: is not a scene (a TOML file); of a trajectory, atc init writes one") from None
            raise AtcError(complaint(name, text, e)) from None
        scene = cls._build(data, Path(folder), name, key_lines(text), overrides)
        scene._text = text
        return scene

    def _placed(self, other: Scene) -> Scene:
        self.folder, self.name, self._lines, self._text = other.folder, other.name, other._lines, other._text
        return self

    @classmethod
    def _build(cls, data, folder, name, lines, overrides):
        scene = cls(data, folder, name, lines)
        for section, table in data.items():
            if section not in SCHEMA:
                raise AtcError(f"{scene.where(section)}: {unknown(f'section [{section}]', section, SCHEMA)}")
            if not isinstance(table, dict):
                raise AtcError(
                    f"{scene.where(section)}: {section} must be a section: write [{section}] and its keys below"
                )
        for path, value, flag in _overrides(overrides):
            section, key = path
            scene.data.setdefault(section, {})[key] = value
            scene._flags[section, key] = flag
        scene._check()
        return scene

    # ---- complaints

    def _bad(self, section, key, why) -> AtcError:
        return AtcError(f"{self.where(section, key)}: [{section}] {key}: {why}")

    def _unknown(self, section, key, word, known) -> AtcError:
        return self._bad(section, key, unknown(repr(word), word, known))

    @contextmanager
    def _value_of(self, section, key):
        """An error of a lower floor is what is wrong with the value of this key."""
        try:
            yield
        except AtcError as e:
            raise self._bad(section, key, e) from None

    @contextmanager
    def _placed_at(self, section, key=None):
        """An error of a lower floor is said with the line of this key; else of the section's key that it speaks of (or
        of the section)."""
        try:
            yield
        except AtcError as e:
            spoken = [k for k in self.data.get(section, {}) if k != "name" and k in str(e)] if key is None else [key]
            where = self.where(section, spoken[0]) if len(spoken) == 1 else self.where(section)
            raise AtcError(f"{where}: [{section}] {e}") from None

    def _check(self):
        for section, table in self.data.items():
            known = SCHEMA[section]
            for key in table:
                if key not in known:
                    what = unknown(f"key {key!r} in [{section}]", key, known)
                    raise AtcError(f"{self.where(section, key)}: {what}")
                self.check_value(known[key], table, key, partial(self._bad, section, key))
        unneeded = "dispersion" in self.data and "trajectory" not in self.data
        if "file" not in self.data.get("trajectory", {}) and not unneeded:
            raise self.need("trajectory", 'it needs file, the trajectory to read, e.g. file = "run.dump"')
        self._check_grid()
        self._check_potential()
        self._check_trajectory()
        self.selection()
        from ..estimators.columns import split
        from ..estimators.registry import QUANTITIES

        for q in self.get("fields", "quantities", []):
            if q.startswith("column:"):
                with self._value_of("fields", "quantities"):
                    split(q)
            elif q not in QUANTITIES:
                raise self._unknown("fields", "quantities", q, QUANTITIES)
        self._check_kernel()

    def _check_kernel(self):
        if "kernel" not in self.data:
            return
        from ..kernels import known

        name = self.get("kernel", "name")
        if name is None:
            raise self.need("kernel", f"[kernel] needs name, one of {', '.join(known())}")
        if name not in known():
            raise self._unknown("kernel", "name", name, known())
        if not isinstance(self.get("kernel", "table"), str):  # a table in a file is looked at when it is used
            self.kernel()

    def _check_trajectory(self):
        from ..readers.declared import cell_of, periodic_of

        for key, check in (("cell", lambda v: cell_of(v, 1.0)), ("pbc", periodic_of)):
            if self.get("trajectory", key) is not None:
                with self._value_of("trajectory", key):
                    check(self.get("trajectory", key))

    def _check_potential(self):
        if "potential" not in self.data:
            return
        table = self.data["potential"]
        given = [k for k in ("lammps", "input", *LEARNED, *SYSTEMS) if k in table]
        if not given:
            raise self.need(
                "potential",
                '[potential] needs lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file" (a LAMMPS input '
                'script) or a learned model: nep = "nep.txt", mace = "my.model", nequip = "my.nequip.zip", or a system '
                'of another code: openmm = "system.xml", prmtop = "x.prmtop", psf = "x.psf", top = "topol.top"',
            )
        if len(given) > 1:
            many = "both" if len(given) == 2 else "all"
            raise self._bad("potential", given[1], f"give {' or '.join(given)}, not {many}")
        makers = LEARNED | SYSTEMS
        for key in {k: None for keys in makers.values() for k in keys}:
            if key in table and key not in makers.get(given[0], ()):
                why = ": LAMMPS lines name their elements themselves" if key == "types" else ""
                if key in _RUN and given[0] == "openmm":
                    why = ": a System of OpenMM says it itself"
                of = [k for k, keys in makers.items() if key in keys]
                raise self._bad("potential", key, f"goes with {', '.join(of)}{why}")
        if "units" in table and given[0] in LEARNED:
            raise self._bad("potential", "units", "leave it out: learned models and those of KIM are in eV and Å")
        if "units" in table and given[0] in SYSTEMS:
            raise self._bad("potential", "units", "leave it out: the files of other codes say their units")
        if "run" in self.data["potential"] and given != ["input"]:
            raise self._bad("potential", "run", "goes with input, the script whose run it is")

    def _check_grid(self):
        if "grid" not in self.data:
            return
        table = self.data["grid"]
        kind = table.get("kind")
        if kind is None:
            raise self.need("grid", f"[grid] needs kind, one of {', '.join(GRIDS)}")
        needs, may = GRIDS[kind]
        allowed = ["kind", *may]
        for need in needs:
            options = need if isinstance(need, tuple) else (need,)
            allowed += options
            given = [k for k in options if k in table]
            if not given:
                examples = " or ".join(f"{k} ({SCHEMA['grid'][k].expected})" for k in options)
                raise self.need("grid", f"a {kind} grid needs {examples}")
            if len(given) > 1:
                raise self._bad("grid", given[1], f"give {' or '.join(options)}, not both")
        for key in table:
            if key not in allowed:
                raise self._bad("grid", key, f"does not belong to a {kind} grid; its keys: {', '.join(allowed)}")
        if not isinstance(table.get("points"), str):  # points in a file are looked at when they are used
            self.grid()

    def require_complete(self):
        """What the quantities asked for need must be there."""
        from ..estimators.work import Work

        quantities = self.get("fields", "quantities")
        if quantities is None:
            raise self.need("fields", 'it needs quantities, what to compute, e.g. quantities = ["stress", "density"]')
        work = Work.of(quantities, kernel=self.get("grid", "kind") != "planes")
        if work.bond_users and "potential" not in self.data:
            raise self.need(
                "potential",
                f'{work.bond_users[0]} needs one: lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file"',
            )
        if work.kernel_users and "kernel" not in self.data and not self.get("grid", "means"):
            raise self.need("kernel", f'{work.kernel_users[0]} needs one, e.g. name = "quartic" and radius = 8.0')
        if work.grid_users and "grid" not in self.data:
            raise self.need("grid", f'{work.grid_users[0]} needs one, e.g. kind = "regular" and spacing = 2.0')
        if work.reference_users and self.get("trajectory", "reference") is None:
            raise self.need(
                "trajectory",
                f"{work.reference_users[0]} needs reference, the index of the reference frame or the file that holds "
                "it, e.g. reference = 0",
            )

    # ---- what it means

    def trajectory(self):
        """The frames asked for, as `atc.read` gives them. `AtcError` if there are none."""
        whole = self._whole()
        frames = self.get("trajectory", "frames")
        if self._streams:
            if frames is not None:
                raise self._bad("trajectory", "frames", "a stream has no numbered frames: leave it out")
            return whole
        part = whole if frames is None else whole[frame_slice(frames)]
        if len(part) == 0:
            why = f"{whole.source} has {len(whole)} complete frame{'s' * (len(whole) != 1)}, numbered from 0"
            said = "all" if frames is None else shown(frames)
            raise self._bad("trajectory", "frames", f"{said} selects none: {why}")
        return part

    def _whole(self):
        from ..readers.memory import completed

        if self._streams:  # opened once; whoever takes its frames completes them
            if not hasattr(self, "_stream"):
                self._stream = self._read(self._files(), "file")
            return self._stream
        traj, script = self._read(self._files(), "file"), self._script()
        if script is not None and script.timestep is not None and self.get("trajectory", "timestep") is None:
            from ..readers.declared import Declared

            traj = Declared(traj, timestep=traj.units.to_user("time", script.timestep))
        return completed(traj, script)

    @property
    def _streams(self) -> bool:
        """Whether the frames come from a running simulation, by its address."""
        given = self.get("trajectory", "file")
        return isinstance(given, str) and given.startswith("imd://")

    def _files(self):
        """The path of the trajectory, or the paths of its files; or the address of a stream."""
        given = self.get("trajectory", "file")
        if self._streams:
            return given
        if isinstance(given, str):
            return self.path("trajectory", "file")
        return self._paths("trajectory", "file")

    def _paths(self, section, key) -> list[Path]:
        """The file names of a key that holds one or a list."""
        return [self.folder / Path(name).expanduser() for name in self._listed(self.get(section, key) or [])]

    def _read(self, path, key):
        from .. import read
        from ..readers.chain import matching

        for one in [] if str(path).startswith("imd://") else self._listed(path):
            with self._value_of("trajectory", key):
                if matching(one) is None and not os.path.exists(one):
                    raise AtcError(f"there is no file {one}")
        topology = self.path("trajectory", "topology")
        if topology is None:
            topology = self._topology_of_system(path)
        if topology is not None and not os.path.exists(topology):
            raise self._bad("trajectory", "topology", f"there is no file {topology}")
        try:
            return self._open(read, path, topology)
        except AtcError as e:
            named = any(str(one) in str(e) for one in (path if isinstance(path, list) else [path]))
            if topology is not None and str(topology) in str(e):
                key = "topology"
            raise AtcError(str(e) if named else f"{self.where('trajectory', key)}: {e}") from None

    def _topology_of_system(self, path):
        """The file of [potential] that says whose coordinates these are, where the trajectory does not."""
        if all(Path(one).suffix.lower() in _BARE for one in self._listed(path)):
            return next((p for k in ("prmtop", "psf") if (p := self.path("potential", k)) is not None), None)
        return None

    @staticmethod
    def _listed(path) -> list:
        return path if isinstance(path, list) else [path]

    def _open(self, read, path, topology):
        """The trajectory; where neither it nor the scene says its units or atom style, those of the script that made
        it."""
        units, masses = self.get("trajectory", "units"), self.get("trajectory", "masses")
        more = {k: self.get("trajectory", k) for k in ("dimension", "atom_style", "cell", "pbc", "timestep")}
        try:
            return read(path, topology=topology, units=units, masses=masses, **more)
        except AtcError as e:
            pot = self._script()
            if pot is None:
                raise
            more["atom_style"] = more["atom_style"] or pot.atom_style or None
            try:
                return read(path, topology=topology, units=units or pot.units.name, masses=masses, **more)
            except AtcError as again:
                data = pot.setup.data_files if pot.setup is not None else []
                # Plain XYZ of a run whose box is in the script's data file.
                if "give it as cell" not in str(again) or len(data) != 1 or not data[0].is_file():
                    raise e from None
                return read(path, topology=data[0], units=units or pot.units.name, masses=masses, **more)

    def _script(self):
        """The potential of the scene's LAMMPS script, None if it has none."""
        return self.potential() if self.get("potential", "input") is not None else None

    def reference(self):
        """The reference frame, or None: the index counts from the trajectory's first frame, whatever `frames` selects;
        of a file, its first frame."""
        value = self.get("trajectory", "reference")
        if value is None:
            return None
        if isinstance(value, str):
            return self._read(self.path("trajectory", "reference"), "reference")[0]
        whole = self._whole()
        if not -len(whole) <= value < len(whole):
            why = f"there is no frame {value}: {whole.source} has {len(whole)}, numbered from 0"
            raise self._bad("trajectory", "reference", why)
        return whole[value]

    def equilibrium(self):
        """The run that [twin] measures springs in: that of `equilibrium`, else the scene's own."""
        if self.get("twin", "equilibrium") is None:
            return self.trajectory()
        path = self.path("twin", "equilibrium")
        if path is None or not os.path.exists(path):
            raise self._bad("twin", "equilibrium", f"there is no file {path}")
        from .. import read

        return self._open(read, path, None)

    def log(self):
        """The log files of the run, as a list of paths; None if the scene names none."""
        paths = self._paths("trajectory", "log")
        for path in paths:
            if not os.path.isfile(path):
                raise self._bad("trajectory", "log", f"there is no file {path}")
        return paths or None

    def kernel(self):
        """The localisation function, in the user's unit of length; None if the scene has none."""
        if "kernel" not in self.data:
            return None
        from ..kernels import kernel

        table = dict(self.data["kernel"])
        name = table.pop("name")
        if isinstance(table.get("table"), str):
            table["table"] = self._columns("kernel", "table", 2)
        if isinstance(table.get("size"), list) and len(table["size"]) == 2:
            table["dimension"] = 2
        with self._placed_at("kernel"):
            return kernel(name, table.pop("radius", None), **table)

    def potential(self):
        """The model of the interactions; None if the scene has none. Files it names are relative to the scene."""
        if "potential" not in self.data:
            return None
        from .. import potential

        units, partition = self.get("potential", "units"), self.get("potential", "partition")
        for maker in LEARNED:
            if maker in self.data["potential"]:
                return self._shared(self._learned(maker), partition)
        for kind in SYSTEMS:
            if kind in self.data["potential"]:
                return self._shared(self._of_system(kind), partition)
        path = self.path("potential", "input")
        if path is not None:
            if not os.path.isfile(path):
                raise self._bad("potential", "input", f"there is no file {path}")
            return self._shared(self._of_script(path, units), partition)
        text = self.data["potential"]["lammps"]
        if units is None and "trajectory" in self.data and not re.search(r"^\s*units\s", text, re.MULTILINE):
            units = self.get("trajectory", "units") or self._whole().units.name
        # Empty lines in front, so that what is wrong with line 3 of the text is reported at its line of the scene.
        line = 0
        if ("potential", "lammps") not in self._flags:
            line = self._lines.get(("potential", "lammps"), 0)
            opening = self._text.split("\n")[line - 1].partition("=")[2].strip() if line else ""
            line -= bool(line) and opening not in ('"""', "'''")
        name = self._flags.get(("potential", "lammps"), self.name)
        return self._shared(potential("\n" * line + text + "\n", units=units, folder=self.folder, name=name), partition)

    def _learned(self, maker):
        """The machine-learned potential that is named."""
        import atc

        options = {k: v for k in LEARNED[maker] if (v := self.get("potential", k)) is not None}
        with self._placed_at("potential", maker):
            # A model of KIM has a name, the others are files.
            model = self.get("potential", maker) if maker == "kim" else self.path("potential", maker)
            return getattr(atc, maker)(model, **options)

    def _of_system(self, kind):
        """The potential of another code's system, read once."""
        from ..decomposers.openmm import potential_from_openmm

        options = {k: v for k in SYSTEMS[kind] if (v := self.get("potential", k)) is not None}
        if "parameters" in options:
            options["parameters"] = tuple(self._paths("potential", "parameters"))
        if "include" in options:
            options["include"] = self.path("potential", "include")
        path = self.path("potential", kind)
        key = (path, str(options))
        if self._made[0] != key:
            with self._placed_at("potential", kind):
                self._made = (key, potential_from_openmm(path, kind, **options))
        return self._made[1]

    def _of_script(self, path, units):
        """The potential of a script: read once, for the trajectory needs it too."""
        from .. import potential

        run, files = self.get("potential", "run"), self._files()
        key = (path, units, run, str(files))
        if self._made[0] != key:
            self._made = (key, potential(path, units=units, run=run, trajectory=self._listed(files)))
        return self._made[1]

    def _held(self, pot):
        """The potential with the constraints of the scene."""
        table = dict(self.data.get("constraints", {}))
        if not table:
            return pot
        from ..decomposers.constraints.scene import constrained
        from ..units import units

        if isinstance(table.get("pairs"), str):
            table["pairs"] = self._columns("constraints", "pairs", 2).astype(int).tolist()
        named = bool({"bonds", "pairs"} & {*table}) or bool(table.get("molecules"))
        if table.get("topology") and named:
            raise self._bad("constraints", "topology", "bonds, molecules and pairs say it, too: leave one of them out")
        if table.get("topology") is False and pot.constraints is None and not named:
            return pot.constrained(None)
        if pot.constraints is None and not named and not self._says_constraints():
            raise self.need("constraints", "the potential has none: say what is held: bonds, molecules or pairs")
        own = self.get("trajectory", "units")
        return constrained(pot, table, units(own) if own else pot.units, f"{self.where('constraints')}: [constraints]")

    def _says_constraints(self) -> bool:
        """Whether the topology is of the kind that says which distances the run held."""
        names = [*self._listed(self._files()), self.get("trajectory", "topology")]
        return any(str(name).lower().endswith(".tpr") for name in names if name is not None)

    def _shared(self, pot, partition):
        pot, alpha = self._held(pot), self.get("potential", "alpha")
        if alpha is not None:
            from ..decomposers.long_range.kspace import with_alpha

            with self._placed_at("potential", "alpha"):
                pot = with_alpha(pot, alpha)
        if partition is None:
            return pot
        with self._placed_at("potential", "partition"):
            return pot.partitioned(partition)

    def grid(self):
        """Where the fields are wanted; None if the scene has no grid."""
        if "grid" not in self.data:
            return None
        from ..grids import Grid

        table = dict(self.data["grid"])
        kind, follow = table.pop("kind"), table.pop("follow", None)
        if kind == "points":
            xyz = table["points"]
            table = {"xyz": self._columns("grid", "points", 3, 2) if isinstance(xyz, str) else xyz}
        if kind == "planes" and self.get("trajectory", "timestep") is not None:
            table.setdefault("interval", self.get("trajectory", "timestep"))
        with self._placed_at("grid"):
            made = getattr(Grid, kind)(**table)
            return made if follow is None else made.following(follow)

    def selection(self) -> dict:
        """What `atc.fields` takes as select, by and bonds; {} if the scene has none."""
        if "select" not in self.data:
            return {}
        from ..estimators.selections import select

        table = dict(self.data["select"])
        out: dict = {k: table.pop(k) for k in ("by", "bonds") if k in table}
        with self._placed_at("select"):
            if table:
                out["select"] = select(**table)
            elif "bonds" in out:
                raise AtcError(
                    "bonds: whose ends? say which atoms: types, elements, ids, molecules, groups, region or atoms"
                )
        return out

    def output(self, given=None, overwrite: bool = False, resume: bool = False) -> Path:
        """The file to write: `given`, else the scene's ``[output] file``. Whether it can be written is found out here,
        before anything is computed; with `resume` it may be that of a run which only has to clear away."""
        from ..running.output import require_place

        path, where = self.result(given)
        require_place(path, where, overwrite, resume)
        return path

    def arguments(self, jobs: int = 1) -> dict:
        """The arguments of `atc.fields` (and `atc.plan`) this scene stands for.

        `jobs` processors: whole frames to processes where there are as many frames, else threads within a frame; 0
        means all processors.
        """
        self.require_complete()
        from ..planning.job import cores
        from ..planning.method_choice import require_known

        jobs = cores(jobs)
        method = self.get("fields", "method", "auto")
        with self._placed_at("fields", "method"):
            require_known(method)
        traj = self.trajectory()
        parallel = jobs > 1 and not self._streams and len(traj) >= jobs
        pot, kern, grid = self.potential(), self.kernel(), self.grid()
        flat = traj.units.dimension == 2 or (pot is not None and pot.dimension == 2)
        self._require_dimension(2 if flat else 3, kern, grid)
        return {
            "traj": traj,
            "pot": pot,
            "kern": kern,
            "grid": grid,
            "reference": self.reference(),
            "method": method,
            "threads": 1 if parallel else jobs,
            "workers": jobs if parallel else 1,
            "forces": self.get("trajectory", "forces", "warn"),
            "log": self.log(),
            **self.selection(),
            "output_units": self.get("output", "units"),
            **{k: v for k, v in self.data["fields"].items() if k != "method"},
        }

    def live(self, **more):
        """An `atc.Live` for this scene; its trajectory is not read. `more`: arguments that go before the scene's."""
        from ..running.live import Live

        given = {k: v for k, v in self.data.get("fields", {}).items() if k not in ("tiles", "velocity")}
        asked = {
            "pot": self.potential(),
            "kern": self.kernel(),
            "grid": self.grid(),
            "forces": self.get("trajectory", "forces", "warn"),
            "masses": self.get("trajectory", "masses"),
            "scene": self.to_toml(),
        }
        return Live(**{**asked, **given, **more})

    def _require_dimension(self, dimension, kern, grid):
        """Raise unless kernel and grid have a meaning in so many dimensions."""
        for section, thing, check in (("kernel", kern, "in_dimension"), ("grid", grid, "require_dimension")):
            with self._placed_at(section):
                if thing is not None:
                    getattr(thing, check)(dimension)

    def plan(self, jobs: int = 1):
        """What `run` would do; nothing is computed."""
        from ..planning.report import plan

        return plan(**self.arguments(jobs))

    def run(self, out=None, *, jobs: int = 1, cluster=None, progress=None, resume: bool = True):
        """Compute the fields: `atc.fields` with this scene's arguments, into `out` (or in memory). Returns the
        xarray.Dataset."""
        if out is None:
            from .. import fields

            return fields(**self.arguments(jobs), cluster=cluster, progress=progress, scene=self.to_toml())
        from ..running.output import open_dataset

        self.write(out, jobs=jobs, cluster=cluster, progress=progress, resume=resume)
        return open_dataset(out)

    def write(self, out, *, jobs: int = 1, cluster=None, progress=None, resume: bool = True) -> dict:
        """Compute the fields into `out` and return the attributes of the dataset, which stays closed."""
        from ..planning.request import Request
        from ..running.run import fields, write

        if self._streams:
            return dict(fields(**self.arguments(jobs), progress=progress, scene=self.to_toml(), out=out).attrs)
        request = Request(**self.arguments(jobs), cluster=cluster, scene=self.to_toml())
        partial = Path(f"{out}.partial")
        there = partial.exists()
        try:
            return write(request, out, progress, resume)
        except AtcError:
            # Input that cannot be used leaves nothing behind; a run that has finished frames, or one that is not ours,
            # does.
            if not there and not (partial / "journal.jsonl").exists():
                shutil.rmtree(partial, ignore_errors=True)
            raise

    def _columns(self, section, key, count, fewer=None):
        """A text file of numbers, `count` to a line (or `fewer`)."""
        import numpy as np

        path = self.path(section, key)
        assert path is not None  # asked for where the key is given
        expected = f"{path}: expected {count} numbers a line"
        try:
            with self._value_of(section, key):
                values = np.loadtxt(whole_text(path, "text").splitlines(), ndmin=2)
        except ValueError as e:
            raise self._bad(section, key, f"{expected}: {' '.join(str(e).split())}") from None
        if values.shape[1] not in (count, fewer) or not len(values):
            raise self._bad(section, key, f"{expected}, found {values.shape[1] if len(values) else 'none'}")
        return values

    def to_toml(self) -> str:
        """The resolved scene as TOML. Absolute paths lose what lies outside the scene's folder, so that no user or host
        name is kept."""
        sections = {s: {k: self._plain(s, k, v) for k, v in self.data.get(s, {}).items()} for s in SCHEMA}
        return toml_document(sections)

    def _plain(self, section, key, value):
        """A value without the folders of a path."""
        if not SCHEMA[section][key].path:
            return value
        if isinstance(value, list):
            return [self._anonymous(v) if isinstance(v, str) else v for v in value]
        return self._anonymous(value) if isinstance(value, str) else value

    def _anonymous(self, name: str) -> str:
        if name.startswith("imd://"):
            return "imd://"
        path = Path(name).expanduser()
        if path.is_absolute():
            try:
                return path.relative_to(self.folder.resolve()).as_posix()
            except ValueError:
                return path.name
        if ".." in path.parts and Path.home().name in path.parts:
            return path.name
        return path.as_posix()

    def set(self, section: str, key: str, value, flag: str = "") -> None:
        """Change one key and check the scene again; `flag` is what a complaint then names."""
        before = {s: dict(t) for s, t in self.data.items()}
        self.data.setdefault(section, {})[key] = value
        self._flags[section, key] = flag or f"{section}.{key}"
        try:
            self._check()
        except AtcError:
            self.data = before
            raise


# --------------------------------------------------------------------------------------------------------------------


def _overrides(overrides):
    """((section, key), value, flag) of each override."""
    if not overrides:
        return
    if isinstance(overrides, Mapping):
        for dotted, value in overrides.items():
            yield _setting_path(dotted, dotted), value, dotted
        return
    for text in overrides:
        dotted, eq, value = text.partition("=")
        flag = f"--set {text}"
        if not eq:
            raise AtcError(f"{flag}: expected SECTION.KEY=VALUE, e.g. --set kernel.radius=10")
        section, key = path = _setting_path(dotted.strip(), flag)
        yield path, _typed(section, key, value.strip()), flag


def _setting_path(dotted: str, flag: str) -> tuple[str, str]:
    section, dot, key = dotted.partition(".")
    if not dot:
        homes = [s for s in SCHEMA if dotted in SCHEMA[s]]
        hint = f"did you mean {homes[0]}.{dotted}? " if homes else ""
        raise AtcError(
            f"{flag}: expected SECTION.KEY=VALUE, e.g. kernel.radius=10; {hint}got only {dotted!r} before the ="
        )
    if section not in SCHEMA:
        raise AtcError(f"{flag}: {unknown(f'section {section!r}', section, SCHEMA)}")
    if key not in SCHEMA[section]:
        raise AtcError(f"{flag}: {unknown(f'key {key!r} in [{section}]', key, SCHEMA[section])}")
    return section, key


def _typed(section: str, key: str, text: str):
    """The value a flag means: TOML where it is TOML, else the bare word; ``a,b`` where a list is wanted."""
    try:
        return parse(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        pass
    if (section, key) == ("fields", "quantities"):
        return [w.strip() for w in text.split(",") if w.strip()]
    if "," in text and not text.startswith("["):
        try:
            return parse(f"v = [{text}]")["v"]
        except tomllib.TOMLDecodeError:
            pass
    return text
