"""Scenes: the TOML file in which a person says what to compute.

A scene has the sections ``[trajectory]``, ``[potential]``, ``[kernel]``, ``[grid]``, ``[select]``, ``[fields]``,
``[check]``, ``[dispersion]``, ``[twin]`` and ``[output]``. Everything in it is checked before anything is computed;
every complaint names the file and the line (or the ``--set`` flag) and says what was expected. Paths are relative to
the scene file, lengths in the trajectory's unit style.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import AtcError
from ..readers.whole import whole_text
from . import potentials, trajectories
from .document import Document
from .rules import check, require_complete
from .schema import SCHEMA
from .toml import toml_document


@dataclass
class Scene(Document):
    """What to compute: a checked scene.

    Attributes
    ----------
    data : {section: {key: value}} after overrides, checked; values in the user's units, paths as written
    folder : where relative paths start
    name : what to call the scene in messages
    """

    what = "scene"
    example = "kernel.radius=10"
    begun_by = "; of a trajectory, atc init writes a scene"
    tables = SCHEMA

    #: (what it was made from, potential), the last one read
    made: tuple = field(default=(None, None), repr=False, compare=False)
    #: of frames that come from a running simulation, once it is opened
    stream: Any = field(default=None, repr=False, compare=False)

    def check(self) -> None:
        check(self)

    def require_complete(self) -> None:
        """Raise unless all is there that the quantities asked for need."""
        require_complete(self)

    # ---- what it means

    def trajectory(self):
        """The frames asked for, as `atc.read` gives them. `AtcError` if there are none."""
        return trajectories.trajectory(self)

    def read(self, path, key: str):
        """The trajectory in a file that a key names, with what [trajectory] says of such."""
        return trajectories.read_at(self, path, key)

    def reference(self):
        """The reference frame, or None: the index counts from the trajectory's first frame, whatever `frames` selects;
        of a file, its first frame."""
        return trajectories.reference(self)

    def equilibrium(self):
        """The run that [twin] measures springs in: that of `equilibrium`, else the scene's own."""
        return trajectories.equilibrium(self)

    def log(self):
        """The log files of the run, as a list of paths; None if the scene names none."""
        return trajectories.log(self)

    def potential(self):
        """The model of the interactions; None if the scene has none. Files it names are relative to the scene."""
        return potentials.potential(self)

    def kernel(self):
        """The localisation function, in the user's unit of length; None if the scene has none."""
        if "kernel" not in self.data:
            return None
        from ..kernels import kernel

        table = dict(self.data["kernel"])
        name = table.pop("name")
        if isinstance(table.get("table"), str):
            table["table"] = self.columns("kernel", "table", 2)
        if isinstance(table.get("size"), list) and len(table["size"]) == 2:
            table["dimension"] = 2
        with self.placed_at("kernel"):
            return kernel(name, table.pop("radius", None), **table)

    def grid(self):
        """Where the fields are wanted; None if the scene has no grid."""
        if "grid" not in self.data:
            return None
        from ..grids import Grid

        table = dict(self.data["grid"])
        kind, follow = table.pop("kind"), table.pop("follow", None)
        if kind == "points":
            xyz = table["points"]
            table = {"xyz": self.columns("grid", "points", 3, 2) if isinstance(xyz, str) else xyz}
        if kind == "planes" and self.get("trajectory", "timestep") is not None:
            table.setdefault("interval", self.get("trajectory", "timestep"))
        with self.placed_at("grid"):
            made = getattr(Grid, kind)(**table)
            return made if follow is None else made.following(follow)

    def selection(self) -> dict:
        """What `atc.fields` takes as select, by and bonds; {} if the scene has none."""
        if "select" not in self.data:
            return {}
        from ..estimators.selections import select

        table = dict(self.data["select"])
        out: dict = {k: table.pop(k) for k in ("by", "bonds") if k in table}
        with self.placed_at("select"):
            if table:
                out["select"] = select(**table)
            elif "bonds" in out:
                raise AtcError(
                    "bonds: whose ends? say which atoms: types, elements, ids, molecules, groups, region or atoms"
                )
        return out

    def arguments(self, jobs: int = 1) -> dict:
        """The arguments of `atc.fields` (and `atc.plan`) this scene stands for.

        `jobs` processors: whole frames to processes where there are as many frames, else threads within a frame; 0
        means all processors.
        """
        require_complete(self)
        from ..planning.job import cores
        from ..planning.method_choice import require_known

        jobs = cores(jobs)
        method = self.get("fields", "method", "auto")
        with self.placed_at("fields", "method"):
            require_known(method)
        traj = self.trajectory()
        parallel = jobs > 1 and not trajectories.streams(self) and len(traj) >= jobs
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
        with self.placed_at("kernel"):
            if kern is not None:
                kern.in_dimension(dimension)
        with self.placed_at("grid"):
            if grid is not None:
                grid.require_dimension(dimension)

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
        from ..running.opening import open_dataset

        self.write(out, jobs=jobs, cluster=cluster, progress=progress, resume=resume)
        return open_dataset(out)

    def write(self, out, *, jobs: int = 1, cluster=None, progress=None, resume: bool = True) -> dict:
        """Compute the fields into `out` and return the attributes of the dataset, which stays closed."""
        from ..planning.request import Request
        from ..running.run import fields, write

        if trajectories.streams(self):
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

    def columns(self, section, key, count, fewer=None):
        """The numbers of a text file that a key names, `count` to a line (or `fewer`)."""
        import numpy as np

        path = self.path(section, key)
        assert path is not None  # asked for where the key is given
        expected = f"{path}: expected {count} numbers a line"
        try:
            with self.value_of(section, key):
                values = np.loadtxt(whole_text(path, "text").splitlines(), ndmin=2)
        except ValueError as e:
            raise self.bad((section, key), f"{expected}: {' '.join(str(e).split())}") from None
        if values.shape[1] not in (count, fewer) or not len(values):
            raise self.bad((section, key), f"{expected}, found {values.shape[1] if len(values) else 'none'}")
        return values

    def to_toml(self) -> str:
        """The resolved scene as TOML. Absolute paths lose what lies outside the scene's folder, so that no user or host
        name is kept."""
        sections = {s: table for s in SCHEMA if (table := self.data.get(s))}
        return toml_document({s: {k: self._plain(s, k, v) for k, v in table.items()} for s, table in sections.items()})

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
        self.flags[section, key] = flag or f"{section}.{key}"
        try:
            check(self)
        except AtcError:
            self.data = before
            raise


# --------------------------------------------------------------------------------------------------------------------
