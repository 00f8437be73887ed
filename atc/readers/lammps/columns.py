"""From named columns of a LAMMPS dump, text or binary, to a Frame in internal units."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Cell, Frame, Topology
from .._parse import gather, sorting
from ..masses import Masses
from ..trajectory import Trajectory, warn
from .units import settle_units

# How positions can be given, best first: (columns, scaled by the cell, wrapped into it).
_POSITIONS = (
    (("x", "y", "z"), False, True),
    (("xu", "yu", "zu"), False, False),
    (("xs", "ys", "zs"), True, True),
    (("xsu", "ysu", "zsu"), True, False),
)
_VELOCITY, _FORCE = ("vx", "vy", "vz"), ("fx", "fy", "fz")
INT_COLUMNS = frozenset(("id", "type", "mol", "proc", "procp1", "ix", "iy", "iz"))
TEXT_COLUMNS = frozenset(("element", "typelabel"))
KNOWN_FLOATS = frozenset("x y z xu yu zu xs ys zs xsu ysu zsu vx vy vz fx fy fz q mass".split())
_FLAGS = frozenset("pfsm")


def periodic_flags(flags, where: str) -> list[bool]:
    """Per axis from LAMMPS's ``pp ff ss mm fs ..``: periodic only if both faces are."""
    if len(flags) != 3 or any(len(f) != 2 or not _FLAGS.issuperset(f) or (f != "pp" and "p" in f) for f in flags):
        raise AtcError(f"{where}: expected three boundary flags such as 'pp pp ff', got {' '.join(flags)!r}")
    return [f == "pp" for f in flags]


def cell_from_bounds(lo, hi, tilt, periodic, length: float) -> Cell:
    """From what a dump prints: the bounding box of the tilted box, not its edges (LAMMPS manual, Howto_triclinic)."""
    xy, xz, yz = tilt
    lo, hi = np.array(lo, float), np.array(hi, float)
    lo[0] -= min(0.0, xy, xz, xy + xz)
    hi[0] -= max(0.0, xy, xz, xy + xz)
    lo[1] -= min(0.0, yz)
    hi[1] -= max(0.0, yz)
    if not (hi > lo).all():
        raise AtcError(f"the box bounds {lo.tolist()} to {hi.tolist()} enclose no volume")
    return Cell.from_lammps(lo * length, hi * length, np.array(tilt, float) * length, periodic)


def edge_vectors(lengths, cosines) -> np.ndarray | None:
    """(3, 3) edge vectors as rows, the first along x, the second in the plane z = 0, of a cell with these three lengths
    and cosines of its angles α, β, γ; None if there is none."""
    ca, cb, cg = cosines
    with np.errstate(divide="ignore", invalid="ignore"):
        sg = np.sqrt(1 - cg * cg)
        third = np.array([cb, (ca - cb * cg) / sg, 0.0])
    rest = 1 - third @ third
    if not rest > 0:
        return None
    third[2] = np.sqrt(rest)
    return np.array([[1.0, 0, 0], [cg, sg, 0], third]) * np.asarray(lengths)[:, None]


class Columns:
    """The columns of one frame: name → (n,) array, in file order; texts as arrays of str."""

    def __init__(self, columns: dict, order, where, line_of):
        self.columns, self.order, self.where, self.line_of = columns, order, where, line_of

    def __contains__(self, name):
        return name in self.columns

    def __getitem__(self, name):
        a = self.columns[name]
        return a if self.order is None else a[self.order]

    def has(self, names):
        return all(n in self.columns for n in names)

    def scaled(self, name, factor: float, out):
        a = self.columns[name]
        if self.order is None:
            np.multiply(a, factor, out=out)
        else:
            gather(a, self.order, factor, out)

    def vector(self, names, factor: float) -> np.ndarray:
        out = np.empty((len(self.columns[names[0]]), 3))
        for c, name in enumerate(names):
            self.scaled(name, factor, out[:, c])
        return out

    def scalar(self, name, factor: float) -> np.ndarray:
        out = np.empty(len(self.columns[name]))
        self.scaled(name, factor, out)
        return out


def sort_order(ids, where: str, line_of):
    """Permutation that sorts by id, None if sorted already; a repeated id is an error."""
    if not len(ids):
        return None
    ids = np.ascontiguousarray(ids)
    order = np.empty(len(ids), np.int64)
    state, row = sorting(ids, order)
    if state == 0:
        return None
    if state == 3:
        order = np.argsort(ids, kind="stable")
        same = np.flatnonzero(np.diff(ids[order]) == 0)
        if len(same):
            state, row = 2, int(order[same[0] + 1])
    if state == 2:
        raise AtcError(
            f"{where}, {line_of(row)}: atom {ids[row]} is there twice; ids must be unique (was the file appended to, "
            "or joined?)"
        )
    return order


class LammpsTrajectory(Trajectory):
    """What all files of LAMMPS share: units, topology, masses, and the making of frames."""

    #: What to say once of files without an 'id' column; None where they cannot have one.
    _without_ids: str | None = (
        "has no 'id' column: atoms are numbered in file order and cannot be followed from frame to frame"
    )

    _without_types = (
        "has no 'type' or 'element' column: all atoms are taken to be of type 1; dump type too if there are more"
    )

    def __init__(self, path, topology, units, masses, file_units):
        super().__init__()
        self.path = path
        self.source = str(path)
        self._data = _data_file(topology, self.source)
        declared = [(file_units, self.source)] if file_units else []
        if self._data is not None and self._data.unit_style:
            declared.append((self._data.unit_style, self._data.source))
        self.units = settle_units(units, declared, self.source)
        if self._data is not None:
            self._data.use_units(self.units)
        self._masses = None if masses is None else Masses(masses, self.units)
        self._warned = set()
        self._topology = (None, None)

    def _once(self, key, message):
        if key not in self._warned:
            self._warned.add(key)
            warn(message)

    def _require_atoms(self, count) -> None:
        """A file that never holds an atom is none of atoms; a step without any among others is what the run wrote, and
        is said once."""
        k = 0
        while self._has(k):
            if count(k):
                if k:
                    self._once(
                        "none",
                        f"{self.source}: its first {k} frames hold no atoms: the dump's group or threshold selected "
                        "none",
                    )
                return
            k += 1
        raise AtcError(
            f"{self.source}: none of its {k} frame{'s' * (k != 1)} holds an atom: the dump's group or threshold "
            "selected none"
        )

    @property
    def type_names(self):
        names = super().type_names
        if self._data is not None:
            names = {**self._data.type_names, **names}
        return names

    def _build(self, columns: dict, cell: Cell, k: int, where: str, step, time, line_of) -> Frame:
        """The Frame of frame k. `columns` in file order; `line_of(row)` says where an atom's line is, for messages."""
        u = self.units
        order = sort_order(columns["id"], where, line_of) if "id" in columns else None
        if "id" not in columns and self._without_ids:
            self._once("id", f"{self.source} {self._without_ids}")
        c = Columns(columns, order, where, line_of)
        n = len(next(iter(columns.values())))
        if not n:
            self._once("none", f"{where} holds no atoms: the dump's group or threshold selected none at this step")
        used = {"id", "type", "q", "mass", "ix", "iy", "iz"}
        found = next((p for p in _POSITIONS if c.has(p[0])), None)
        if found is None:
            raise AtcError(
                f"{where}: no positions among the columns ({' '.join(columns)}): expected x y z, xu yu zu, xs ys zs "
                "or xsu ysu zsu"
            )
        names, by_cell, wrapped = found
        used.update(names)
        x = c.vector(names, 1.0 if by_cell else u.length)
        if by_cell:
            x = cell.cartesian(x)
        images = None
        if wrapped and c.has(("ix", "iy", "iz")):
            images = np.stack([np.asarray(c[a]).astype(np.int64) for a in ("ix", "iy", "iz")], axis=1)
        v = f = None
        if c.has(_VELOCITY):
            v = c.vector(_VELOCITY, u.velocity)
            used.update(_VELOCITY)
        if c.has(_FORCE):
            f = c.vector(_FORCE, u.factor("force"))
            used.update(_FORCE)
        ids = np.asarray(c["id"]).astype(np.int64) if "id" in c else None
        if self._data is not None and ids is None:
            raise AtcError(f"{where}: a topology needs the 'id' column, to know which atom is which; dump id too")
        rows = self._data.rows(ids) if self._data is not None else None

        types, names = self._atom_types(c, k, n, rows, ids, where)
        given = {}
        if "type" not in c:
            # Elements are numbered in the order in which they appear, which need not be that of the run's types.
            given["types"] = "assumed" if rows is None else self._data.source
        charges = c.scalar("q", u.charge) if "q" in c else None
        if charges is None and rows is not None and self._data.charges is not None:
            charges = self._data.charges[self._data.all_rows(rows, ids, where, "charges")]
            given["charges"] = self._data.source
        masses = None
        if self._masses is not None:
            masses = self._masses(types, names, where)
        elif "mass" in c:
            masses = c.scalar("mass", u.mass)
        elif rows is not None and self._data.has_masses:
            masses = self._data.masses_of(types, names, rows, ids, where)
            given["masses"] = self._data.source
        molecules = np.asarray(c["mol"]).astype(np.int64) if "mol" in c else None
        topology = self._topology_of(ids, where) if self._data is not None else None
        if topology is not None:
            given["topology"] = self._data.source
        extra = {name: np.ascontiguousarray(c[name]) for name in columns if name not in used}
        return Frame(
            positions=x,
            cell=cell,
            units=u,
            types=types,
            ids=ids,
            masses=masses,
            velocities=v,
            forces=f,
            charges=charges,
            images=images,
            step=step,
            time=None if time is None else time * u.time,
            topology=topology,
            source=where,
            type_names=names,
            extra=extra,
            molecules=molecules,
            given=given,
        )

    def _atom_types(self, c, k, n, rows, ids, where):
        label = _label_among(c)
        if "type" in c:
            types = np.asarray(c["type"]).astype(np.int64)
            if n and types.min() < 1:
                raise AtcError(f"{where}: type {types.min()} among the atoms; LAMMPS types count from 1")
            names = dict(self.type_names)
            if label:
                unique, first = np.unique(types, return_index=True)
                names.update({int(t): str(name) for t, name in zip(unique, c[label][first])})
            return types, names
        if rows is not None:
            return self._data.types[self._data.all_rows(rows, ids, where, "types")], self.type_names
        if label:
            return self._types_from_names(c[label], k), self.type_names
        if self._masses is not None and len(self._masses) > 1:
            raise AtcError(
                f"{where}: {len(self._masses)} masses are given but there is no 'type' or 'element' column to tell "
                "the atoms apart; dump type too"
            )
        if self._masses is None and "mass" not in c:
            self._once("type", f"{self.source} {self._without_types}")
        return np.ones(n, np.int64), {}

    def _ids_of_data(self, n, where):
        """Ids of a file that does not number its atoms but is sorted: with as many atoms, those of the data file."""
        ids = np.sort(np.asarray(self._data.ids))
        if len(ids) != n:
            raise AtcError(
                f"{where}: {n} atoms, but {self._data.source} holds {len(ids)}: such files do not number their atoms, "
                "so both must hold the same ones"
            )
        return ids

    def _species(self, k):
        """Names in the order of ids."""
        columns, where, line_of = self._columns_of(k)
        label = _label_among(columns)
        if label is None:
            return []
        order = sort_order(columns["id"], where, line_of) if "id" in columns else None
        return columns[label] if order is None else columns[label][order]

    def _columns_of(self, k):
        """Columns of frame k in file order, and what `_build` needs for messages."""
        raise NotImplementedError

    def _topology_of(self, ids, where) -> Topology | None:
        known, topology = self._topology
        if known is None or not np.array_equal(known, ids):
            topology = self._data.topology_for(ids, where)
            self._topology = (ids, topology)
        return topology

    def __getstate__(self):
        state = super().__getstate__()
        state["_topology"] = (None, None)
        return state


class ScannedTrajectory(LammpsTrajectory):
    """A file whose frames are found one after the other, as far as they are needed: `_scan` finds one more and is False
    at the end of the file, when it sets `_complete`, and is not asked again; `_found` is how many there are so far."""

    _complete = False
    _found = 0

    def _scan(self) -> bool:
        raise NotImplementedError

    def _has(self, k):
        if k >= self._found and not self._complete:
            with self._guard:
                while k >= self._found and self._scan():
                    pass
        return k < self._found

    def __len__(self):
        with self._guard:
            while not self._complete and self._scan():
                pass
        return self._found

    def _bytes_of(self, k: int, start: int, end: int) -> np.ndarray:
        """The bytes of frame k, which has been found from `start` to `end`."""
        buf = self._bytes.read(start, end)
        if len(buf) < end - start:
            raise self._shorter(k)
        return buf

    def _shorter(self, k: int) -> AtcError:
        return AtcError(
            f"{self.source}, frame {k}: the file has become shorter since it was opened; is something writing it anew?"
        )

    def close(self):
        self._bytes.close()


def _label_among(columns) -> str | None:
    return next((name for name in ("typelabel", "element") if name in columns), None)


def _data_file(topology, source):
    if topology is None:
        return None
    from .data import LammpsData

    if isinstance(topology, LammpsData):
        return topology
    if isinstance(topology, (str, bytes)) or hasattr(topology, "__fspath__"):
        return LammpsData(topology, getattr(topology, "atom_style", None))
    raise AtcError(f"{source}: topology: expected the path of a LAMMPS data file, got {type(topology).__name__}")
