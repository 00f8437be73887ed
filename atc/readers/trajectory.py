"""The lazy sequence of frames that every reader is."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Sequence

import numpy as np

from ..errors import AtcWarning
from ..frame import Frame
from ..units import Units
from .resolution import decimal_resolution


class Trajectory(Sequence):
    """Frames that are read when they are asked for.

    ``len(traj)``, ``traj[3]``, ``traj[-1]``, ``for frame in traj`` and slices (``traj[::10]``, ``traj[2:5]``,
    ``traj[::-1]``), which are trajectories themselves and read nothing. Frames are not kept: each access reads again.
    Trajectories can be pickled; a copy in another process opens the file again. Threads may share one.

    Attributes
    ----------
    units : Units
        The user's unit system; the frames themselves are in internal units.
    source : str
        What to call the trajectory in messages, usually its path.
    type_names : dict
        {type: name} where the source knows names (elements, type labels).
    dimension : int or None
        2 or 3 where whoever opened it said so (2: its frames are those of a two-dimensional run, see `atc.planar`);
        None: nobody did.

    For a new source, subclass it and write ``__len__`` and ``_frame(k)`` for 0 ≤ k < len.
    """

    units: Units
    source: str = "trajectory"
    #: What the reader takes for granted because the format cannot say it: sentences for `atc info`.
    assumed: tuple[str, ...] = ()
    dimension: int | None = None
    #: whether frames come from a run that goes on: once, one after the other, nobody knows how many
    streamed: bool = False
    #: the LAMMPS data file that says what its frames do not, if one does
    _data = None

    def __init__(self):
        self._guard = threading.RLock()
        self._names = {}
        self._names_seen = 0
        self._earlier = None  # gives types to names in files before this one, where there are any

    # What a reader provides
    # -------------------------------------------------------------------------------------------------------

    def __len__(self):
        raise NotImplementedError

    def _frame(self, k: int) -> Frame:
        raise NotImplementedError

    def _has(self, k: int) -> bool:
        """Whether frame k ≥ 0 exists. A reader that finds out frame by frame need not know the length for it."""
        return k < len(self)

    def _species(self, k: int):
        """Names of the species of frame k in atom order, for readers whose types come from names."""
        raise NotImplementedError

    def _precision(self, frame: Frame) -> tuple[float, str]:
        """Absolute resolution of the positions (internal units) and what it was taken from."""
        return decimal_resolution(frame.positions)

    # Sequence
    # ------------------------------------------------------------------------------------------------------------------

    def __getitem__(self, key):
        if isinstance(key, slice):
            return _View(self, key)
        try:
            k = key.__index__()
        except AttributeError:
            raise TypeError(f"frames are numbered by integers or slices, not {type(key).__name__}") from None
        if k < 0:
            k += len(self)
        if k < 0 or not self._has(k):
            # IndexError, as for every sequence: it also ends a for loop of the old protocol.
            raise IndexError(f"{self.source} has {len(self)} frames, there is no number {key}")
        return self._frame(k)

    def __iter__(self):
        k = 0
        while self._has(k):
            yield self._frame(k)
            k += 1

    def __repr__(self):
        return f"<{type(self).__name__} {self.source!r}, units {self.units.name!r}>"

    def _repr_html_(self):
        """For notebooks: what is in it, from its first and last frame."""
        from ..terminal import html_table

        if self.streamed:
            return html_table(
                f"{type(self).__name__} {self.source}", [("units", self.units.name), ("frames", "a stream")]
            )
        info = self.info()
        rows = [("units", info["units"]), ("frames", info["frames"])]
        if info["frames"]:
            first, last = info["atoms"]
            kinds = [f"{k['count']} {k['name'] or f'type {t}'}" for t, k in info["types"].items()]
            lengths = " x ".join(f"{v:.6g}" for v in info["cell"]["lengths"])
            periodic = "".join("p" if p else "f" for p in info["cell"]["periodic"])
            rows += [
                ("atoms", f"{first}" if first == last else f"{first} to {last}"),
                ("types", ", ".join(kinds)),
                ("cell", f"{lengths} {self.units.label('length')}, {periodic}"),
                ("holds", ", ".join(info["quantities"] + info["extra"])),
            ]
            for key in ("step", "time"):
                if info[key] is not None:
                    unit = f" {self.units.label('time')}" if key == "time" else ""
                    rows.append((key, f"{info[key][0]:g} to {info[key][1]:g}{unit}"))
        return html_table(f"{type(self).__name__} {self.source}", rows)

    def __getstate__(self):
        state = self.__dict__.copy()
        state.pop("_guard", None)
        return state

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._guard = threading.RLock()

    def close(self):
        """Close the file, if there is one. Nothing else can be read afterwards."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # Species
    # ------------------------------------------------------------------------------------------------------------------

    @property
    def type_names(self) -> dict:
        return {t: name for name, t in self._names.items()}

    def _types_from_names(self, names, k: int) -> np.ndarray:
        """Types from 1, in the order in which names first appear in the trajectory: the same however frames are
        visited."""
        names = np.asarray(names)
        unique, inverse = np.unique(names, return_inverse=True)
        unique = [str(u) for u in unique]
        if not all(u in self._names for u in unique):
            with self._guard:
                self._learn_names(unique, k)
                if not all(u in self._names for u in unique):
                    self._learn(names)
                    self._names_seen = max(self._names_seen, k + 1)
        return np.array([self._names[u] for u in unique], np.int64)[inverse]

    def _learn_names(self, wanted, stop: int) -> None:
        """Give types to the names of the frames before `stop` that have not been looked at, in their order, until all
        wanted ones have one."""
        if self._earlier is not None:
            self._earlier(wanted)
        self._learn_own_names(wanted, stop)

    def _learn_own_names(self, wanted, stop: int) -> None:
        for m in range(self._names_seen, stop):
            if all(u in self._names for u in wanted):
                return  # frames further on need not be looked at
            self._learn(np.asarray(self._species(m)))
            self._names_seen = m + 1

    def _learn(self, names) -> None:
        for name in dict.fromkeys(names.tolist()):
            self._names.setdefault(str(name), len(self._names) + 1)

    # Description
    # ----------------------------------------------------------------------------------------------------------------

    def info(self) -> dict:
        """What is in the trajectory, from its first and last frame, as plain Python values for printing or JSON.

        Lengths are in the user's units. Keys: source, reader, units, frames, atoms (first, last), ids (whether the
        source numbers its atoms), cell (vectors, origin, periodic, volume, lengths), quantities (what frames carry),
        extra (columns atc does not interpret), types ({type: {count, name, mass}} of the first frame), topology (counts
        of bonded terms) or None, step and time (first, last) or None, coordinate_resolution (smallest step between
        neighbouring coordinate values, estimated) and coordinate_resolution_from.
        """
        n = len(self)
        out = {"source": self.source, "reader": type(self).__name__, "units": self.units.name, "frames": n}
        if n == 0:
            return out
        first = self[0]
        last = self[-1] if n > 1 else first
        u = self.units
        cell = first.cell
        out["atoms"] = [len(first), len(last)]
        out["ids"] = self._numbered()
        out["cell"] = {
            "vectors": u.to_user("length", cell.vectors).tolist(),
            "origin": u.to_user("length", cell.origin).tolist(),
            "periodic": cell.periodic.tolist(),
            "volume": u.to_user("volume", cell.volume),
            "lengths": u.to_user("length", np.linalg.norm(cell.vectors, axis=1)).tolist(),
            "changes": first.cell != last.cell,
        }
        out["quantities"] = ["positions"] + [
            name for name in ("velocities", "forces", "masses", "charges", "images") if getattr(first, name) is not None
        ]
        out["extra"] = sorted(first.extra)
        out["types"] = {}
        values, counts = np.unique(first.types, return_counts=True)
        for t, count in zip(values.tolist(), counts.tolist()):
            mass = None
            if first.masses is not None:
                m = np.unique(first.masses[first.types == t])
                mass = u.to_user("mass", float(m[0])) if len(m) == 1 else "various"
            out["types"][t] = {"count": count, "name": first.type_names.get(t), "mass": mass}
        t = first.topology
        out["topology"] = {k: len(getattr(t, k)) for k in ("bonds", "angles", "dihedrals", "impropers")} if t else None
        out["step"] = None if first.step is None or last.step is None else [int(first.step), int(last.step)]
        times = first.time, last.time
        out["time"] = None if None in times else [u.to_user("time", float(t)) for t in times]
        resolution, why = self._precision(first)
        out["coordinate_resolution"] = float(u.to_user("length", resolution))
        out["coordinate_resolution_from"] = why
        return out

    def _numbered(self) -> bool:
        return True


class Over(Trajectory):
    """Another trajectory, `base`, whose frames are given in another form: what is not said otherwise is the base's."""

    def __init__(self, base: Trajectory):
        super().__init__()
        self.base, self.units, self.source = base, base.units, base.source
        self.assumed, self.dimension = base.assumed, base.dimension

    @property
    def type_names(self):
        return self.base.type_names

    def __len__(self):
        return len(self.base)

    def _has(self, k):
        return self.base._has(k)

    def _precision(self, frame):
        return self.base._precision(frame)

    def _numbered(self):
        return self.base._numbered()

    def close(self):
        self.base.close()


class _View(Over):
    """A slice of another trajectory."""

    def __init__(self, base: Trajectory, which: slice | range):
        super().__init__(base)
        self._which = which
        if isinstance(which, slice) and which.step == 0:
            raise ValueError("slice step cannot be zero")

    def _range(self) -> range:
        if isinstance(self._which, slice):
            self._which = range(len(self.base))[self._which]
        return self._which

    def __len__(self):
        return len(self._range())

    def _number(self, k) -> int | None:
        """Which frame of the base the k-th is, None if there is none. A slice that counts from the beginning is not
        asked for the length: a compressed file need not be decompressed twice."""
        w = self._which
        if isinstance(w, slice) and (w.start or 0) >= 0 and (w.step or 1) > 0 and (w.stop is None or w.stop >= 0):
            m = (w.start or 0) + k * (w.step or 1)
            return m if (w.stop is None or m < w.stop) and self.base._has(m) else None
        return self._range()[k] if k < len(self) else None

    def _frame(self, k):
        return self.base._frame(self._number(k))

    def _has(self, k):
        return self._number(k) is not None

    def __getitem__(self, key):
        if isinstance(key, slice):
            return _View(self.base, self._range()[key])
        return super().__getitem__(key)


def resolution_of(frames, frame: Frame) -> float:
    """Step of the last digit of a frame's positions (internal), as far as the trajectory it comes from knows it; 0 if
    unknown."""
    known = isinstance(frames, Trajectory)
    return float((frames._precision(frame) if known else decimal_resolution(frame.positions))[0])


def warn(message: str) -> None:
    """An AtcWarning that points at the caller of whoever calls this."""
    warnings.warn(message, AtcWarning, stacklevel=3)
