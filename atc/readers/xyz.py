"""XYZ files, plain, extended or i-PI's, plain or compressed: of ASE and its kin in ASE's units, of LAMMPS in the units
of its run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import AtcError, located
from ..frame import Cell
from ..units import LAMMPS_STYLES
from . import _parse
from ._bytes import open_bytes
from .lammps.columns import INT_COLUMNS, KNOWN_FLOATS, ScannedTrajectory
from .lammps.dump import whole
from .resolution import decimal_resolution, text_resolution_of_frames
from .sniff import shown
from .table import FLOAT, INT, TEXT, is_number, parse_columns
from .trajectory import Trajectory, warn
from .xyz_comment import CELL_UNIT_TAKEN, TIME_ROUNDED, Comment, read_comment

# What columns of extended XYZ are called, and the columns of a dump they are.
_SPECIES = ("species", "symbols", "element", "type_name")
_VELOCITIES = ("vel", "velo", "velocity", "velocities")
_FORCES = ("forces", "force", "frc")
_VECTORS = {"pos": ("x", "y", "z"), "positions": ("x", "y", "z")}
_VECTORS |= {n: ("vx", "vy", "vz") for n in _VELOCITIES} | {n: ("fx", "fy", "fz") for n in _FORCES}
_SCALARS = {
    "mass": "mass", "masses": "mass", "q": "q", "charge": "q", "charges": "q", "initial_charges": "q", "id": "id",
    "type": "type",
}  # fmt: skip
_OWN_MASS = "the file's own mass"
_DUMP = "dump it as custom (id type x y z vx vy vz) or extxyz instead"


def looks_like_xyz(head: bytes, suffix: str) -> bool:
    """Whether a file begins like XYZ: a number alone on the first line, a comment, and lines of a word and three
    numbers, or a comment that says so."""
    lines = head.split(b"\n")
    if not lines[0].strip().isdigit() or len(lines) < 2:
        return suffix in (".xyz", ".extxyz", ".exyz")
    if suffix in (".xyz", ".extxyz", ".exyz") or re.search(rb"\b(Properties|Lattice)\s*=|CELL[\(\[\{]", lines[1]):
        return True
    words = lines[2].split() if len(lines) > 3 else []
    return len(words) >= 4 and all(is_number(w) for w in words[1:4]) and not is_number(words[0])


class ExtendedXyz(ScannedTrajectory):
    """Frames of an XYZ file, found by counting lines.

    Parameters
    ----------
    path : file, plain or compressed
    topology : LAMMPS data file, for files in a unit style of LAMMPS. It gives types, masses, charges, bonded terms; to
        a plain XYZ file of LAMMPS also the box.
    units : "ase", "gpumd" (ASE's but for velocities in Å/fs, as in the files of GPUMD), or the LAMMPS unit style all
        numbers of the file are in. Default: ASE's, unless LAMMPS wrote the file, which needs it.
    masses : as for `atc.read`

    Notes
    -----
    In ASE's units, masses are those of the elements unless there is a column, and velocities come from ``momenta``.
    Columns ``vel``, ``velo``, ``velocities`` are of programs that each have units of their own: they are read when
    `units` says which, otherwise they are left among the extra columns, with a warning; so is ``Time`` (without
    one, or in ASE's).
    ``forces``, ``force`` and ``frc`` are forces; ``Timestep`` is the step. LAMMPS writes no corner of its box: where an
    open axis has atoms outside of 0 .. length, the box is not known, and the frame is refused. i-PI's cell and its
    units in braces are read from the comment.
    """

    _without_ids = None

    def __init__(self, path, topology=None, units=None, masses=None, boxed=False):
        Trajectory.__init__(self)  # its comments are read before its units are known
        self._boxed = boxed  # the cell is known from elsewhere
        self._bytes = open_bytes(path)
        self.source, self.path = str(path), Path(path)
        self._spans, self._next, self._line, self._complete = [], 0, 1, False
        if not self._has(0):
            raise AtcError(
                f"{path} holds no complete frame: it ends within its first one, or that one's last line has no line end"
            )
        comment = self._comment(0)
        self._by_lammps = comment.kind in ("lammps", "lammps plain")
        given = getattr(units, "name", units)
        if self._by_lammps and given in ("ase", "gpumd"):
            raise AtcError(
                f"{path} was written by LAMMPS: its units are those of the run, e.g. units='metal', never ASE's"
            )
        if comment.kind == "lammps plain" and topology is None and not boxed:
            raise AtcError(
                f"{path} is a plain XYZ file of LAMMPS (dump xyz), which holds neither the box nor velocities: "
                f"{_DUMP}, or if its box does not change give it as cell, or the data file of the run as topology, "
                "with units"
            )
        if comment.kind == "ipi" and given not in (None, "ase"):
            raise AtcError(
                f"{path}: its comment gives the units of i-PI, and it is read in ASE's: leave units={given!r} out"
            )
        if self._by_lammps and given is None and topology is None:
            raise AtcError(
                f"{path} was written by LAMMPS in the units of its run, which it does not say: give them, e.g. "
                "units='metal'"
            )
        self._ase = not self._by_lammps and given in (None, "ase", "gpumd")
        self._told = given is not None
        if self._ase and topology is not None:
            raise AtcError(
                f"{path}: a topology goes with the unit style of a LAMMPS run: give it too, e.g. units='metal' (XYZ "
                "is read in ASE's units otherwise)"
            )
        if self._ase:
            super().__init__(path, None, given or "ase", masses, None)
        else:
            super().__init__(path, topology, units, masses, None)
            if self.units.name not in LAMMPS_STYLES:
                raise AtcError(
                    f"{path}: units={self.units.name!r}: expected 'ase', 'gpumd' or a unit style of LAMMPS "
                    f"({', '.join(LAMMPS_STYLES)})"
                )
        if self._data is not None:
            self._ids_of_data(self._spans[0][3], f"{path}, frame 0")

    # Finding frames
    # ------------------------------------------------------------------------------------------------------------------

    def _scan(self):
        start, k = self._next, len(self._spans)
        self._bytes.hold = start
        head = self._bytes.read(start, start + 64).tobytes()
        if not head.strip():
            self._complete = True
            return False
        first, end, _ = head.partition(b"\n")
        try:
            if not end and len(head) == 64:
                raise ValueError
            n = whole(first.strip().decode("ascii", "replace")) if end else 0
            if n < 0 or n > 1 << 48:
                raise ValueError
        except ValueError:
            raise AtcError(
                f"{self.source}, frame {k}, line {self._line}: expected the number of atoms, got {shown(first)}"
            ) from None
        if end and not n:
            raise AtcError(f"{self.source}, frame {k}, line {self._line}: a frame without atoms")
        left, pos = n + 2, start
        while left:
            buf = self._bytes.read(pos, pos + (1 << 18))
            used, seen = _parse.skip_lines(buf, left)
            left -= seen
            pos += used
            if left and len(buf) < 1 << 18:
                self._complete = True
                if left == 1 and not k and self._whole_without_line_end(start, pos):
                    warn(
                        f"{self.source}: its only frame has no line end behind the last atom; it is read, but its "
                        "last number may have been cut off"
                    )
                    break
                warn(
                    f"{self.source}: its last frame (number {k}, from line {self._line}) is not complete and is left "
                    "out: the file ends within it, or within its last line, which has no line end"
                )
                return False
            if not seen and len(buf):
                raise AtcError(
                    f"{self.source}, frame {k}, byte {pos - used}: a line of more than {len(buf)} letters; the file "
                    "is damaged"
                )
        self._spans.append((start, pos, self._line, n))
        self._next, self._line = pos, self._line + n + 2
        return True

    def _whole_without_line_end(self, start, end):
        """Whether the last atom of a file of one frame may be complete although no line end follows it."""
        lines = self._bytes.read(start, end).tobytes().split(b"\n")
        words = lines[-1].split()
        return len(words) >= 4 and (len(lines) < 4 or len(words) == len(lines[-2].split()))

    @property
    def _found(self):
        return len(self._spans)

    # Reading one
    # ------------------------------------------------------------------------------------------------------------------

    def _text(self, k):
        start, end, line, n = self._spans[k]
        buf = self._bytes_of(k, start, end)
        if buf[-1] != 10:
            buf = np.append(buf, np.uint8(10))
        body, _ = _parse.skip_lines(buf, 2)
        comment = buf[:body].tobytes().split(b"\n")[1].decode("utf-8", "replace")
        return comment, buf[body:], line, n

    def _comment(self, k) -> Comment:
        start, end, line, _ = self._spans[k]
        head = self._bytes.read(start, min(end, start + (1 << 18))).tobytes().split(b"\n")
        return read_comment(head[1].decode("utf-8", "replace"), f"{self.source}, frame {k}, line {line + 1}")

    def _names_and_kinds(self, comment: Comment, buf, where):
        """Names of the columns as they are read (vectors as name[1] ...), and the kind of each."""
        sample = buf[: 1 << 16].tobytes().split(b"\n", 1)[0].split()
        names, kinds = [], []
        if not comment.columns:
            names = ["species", "pos[1]", "pos[2]", "pos[3]", *(f"column{j}" for j in range(5, len(sample) + 1))]
            kinds = [TEXT, FLOAT, FLOAT, FLOAT, *(FLOAT if is_number(w) else TEXT for w in sample[4:])]
            return names[: max(4, len(sample))], kinds
        for name, letter, width in comment.columns:
            names += [name] if width == 1 else [f"{name}[{j}]" for j in range(1, width + 1)]
            kinds += [{"S": TEXT, "L": TEXT, "R": FLOAT, "I": INT}[letter]] * width
        return names, kinds

    def _columns_of(self, k):
        text, buf, line, n = self._text(k)
        where = f"{self.source}, frame {k}, line {line + 1}"
        comment = read_comment(text, where)
        names, kinds = self._names_and_kinds(comment, buf, where)
        finite = KNOWN_FLOATS | {name for name in names if name.split("[")[0] in _VECTORS}
        raw = parse_columns(
            buf, names, kinds, n, lambda row: f"{self.source}, frame {k}, line {line + 2 + row}", finite
        )
        widths = {name: width for name, _, width in comment.columns} or {"species": 1, "pos": 3}
        columns = self._meanings(raw, widths, where, comment)
        if self._data is not None and "id" not in columns:
            columns["id"] = self._ids_of_data(n, where)
        return columns, f"{self.source} frame {k}", lambda row: f"line {line + 2 + row}"

    def _meanings(self, raw, widths, where, comment) -> dict:
        """Columns of the file under the names of a dump's; what is none stays as it is."""
        out = {}
        has_momenta = widths.get("momenta") == 3
        unknown, named = None, any(s in widths for s in _SPECIES)
        for name, width in widths.items():
            parts = [raw.pop(name)] if width == 1 else [raw.pop(f"{name}[{j}]") for j in range(1, width + 1)]
            low = name.lower()
            target = _VECTORS.get(low) if width == 3 else (_SCALARS.get(low),) if width == 1 else None
            if width == 3 and low in _VELOCITIES and self._ase and (has_momenta or not self._told):
                target = None
                unknown = None if has_momenta else name
            if self._ase and low in ("type", "charge", "charges", "q"):
                target = None  # ASE's own name is initial_charges; a type of others is not counted from 1
            if low == "id" and not self._by_lammps:
                if parts[0].dtype.kind != "i" or len(np.unique(parts[0])) < len(parts[0]):
                    target = None
            if low in _SPECIES and width == 1 and "element" not in out:
                out |= self._species_columns(parts[0].astype(str), where, comment)
            elif low == "z" and width == 1 and parts[0].dtype.kind == "i" and "element" not in out and not named:
                out["element"] = _symbols(parts[0], where)
            elif target and target != (None,) and target[0] not in out:
                out.update(zip(target, parts))
            else:
                out.update({name: parts[0]} if width == 1 else {f"{name}[{j}]": p for j, p in enumerate(parts, 1)})
        out.update(raw)
        for name, a in out.items():
            words = name in KNOWN_FLOATS | INT_COLUMNS and a.dtype.kind not in "fi"
            if words or (name in INT_COLUMNS and a.dtype.kind == "f" and (a != np.rint(a)).any()):
                raise AtcError(
                    f"{where}: Properties={comment.keys.get('properties', '')[:80]!r} has no numbers for {name}: "
                    f"expected R (I for whole ones) in place of {'S or L' if words else 'R'}"
                )
        if "x" not in out:
            raise AtcError(
                f"{where}: no positions among Properties={comment.keys.get('properties', '')[:80]!r}: expected pos:R:3"
            )
        if unknown:
            self._once(
                "velocities",
                f"{self.source}: its column {unknown!r} holds velocities in units that the file does not say; they "
                "are left out: give units='gpumd' if GPUMD wrote it (Å/fs), 'ase', or the LAMMPS unit style that all "
                "its numbers are in",
            )
        return out

    def _species_columns(self, names, where, comment):
        unique = np.unique(names).tolist()
        if not all(name.isdigit() for name in unique):
            return {"element": names}
        if self._by_lammps:  # the numbers of the types, where they have no names
            return {"type": names.astype(np.int64)}
        raise AtcError(
            f"{where}: the first column holds numbers ({', '.join(unique[:3])}), and nothing says whether they are "
            f"types of LAMMPS or atomic numbers: write the names of the elements (dump_modify element), or {_DUMP}"
        )

    def _frame(self, k):
        comment = self._comment(k)
        columns, where, line_of = self._columns_of(k)
        line = self._spans[k][2]
        if self._ase and "mass" in columns:
            columns[_OWN_MASS] = columns["mass"]
        if (comment.kind in ("lammps", "lammps plain")) != self._by_lammps:
            raise AtcError(
                f"{self.source}, frame {k}, line {line + 1}: a frame of another program than the first: give the "
                "parts as files of their own"
            )
        if comment.kind == "ipi":
            for name in "xyz":
                columns[name] = columns[name] * comment.length
        cell = self._cell(comment, columns, where)
        if self._data is not None and "type" in columns:
            self._types_agree(columns, where)
        if CELL_UNIT_TAKEN in comment.keys:
            self._once(
                "cell unit",
                f"{self.source}: i-PI did not name the unit of its cell: atomic_unit, i-PI's own, is taken; write "
                f"cell{{...}} into the comment if it is another",
            )
        if TIME_ROUNDED in comment.keys:
            self._once(
                "time",
                f"{self.source}: six decimals leave too little of its times in these units; steps without times are "
                "read",
            )
        time = None if self._ase and self.units.name != "gpumd" else comment.time
        frame = self._build(columns, cell, k, where, comment.step, time, line_of)
        if comment.kind == "lammps plain" and self._data is not None:  # whose box says nothing of boundaries
            frame = frame.replace(given={**frame.given, "boundary": "assumed"})
        return self._as_ase(frame, where) if self._ase else frame

    def _cell(self, comment: Comment, columns, where) -> Cell:
        u = self.units
        if comment.kind == "lammps plain" and self._data is not None:
            self._once(
                "box",
                f"{self.source}: its box is not in the file and is taken from {self._data.source}: right only if it "
                "never changes",
            )
            return self._data.cell
        if comment.vectors is None:
            if comment.periodic is not None and any(comment.periodic):
                raise AtcError(f"{where}: pbc says that axes are periodic, but there is no Lattice")
            if comment.periodic is None and not self._boxed and _fills_a_box(np.stack([columns[a] for a in "xyz"], 1)):
                self._once(
                    "open",
                    f"{where}: no Lattice, so it is read as an open cluster, but its atoms fill a box to its corners: "
                    'if it was periodic, give its cell, or write Lattice="..." into the comment; if not, pbc="F F F"',
                )
            return Cell(np.zeros((3, 3)), periodic=(False, False, False))
        origin = np.zeros(3) if comment.origin is None else comment.origin
        periodic = comment.periodic or (True, True, True)
        factor = comment.cell_length if comment.kind == "ipi" else 1.0
        with located(where):
            cell = Cell(comment.vectors * (factor * u.length), origin * u.length, periodic)
        if self._by_lammps and comment.origin is None and not all(periodic):
            s = (np.stack([columns[a] for a in "xyz"], 1) * u.length) @ np.linalg.inv(cell.vectors)
            outside = ~np.array(periodic) & ((s < -1e-6).any(axis=0) | (s > 1 + 1e-6).any(axis=0))
            if outside.any():
                axis = "xyz"[int(np.flatnonzero(outside)[0])]
                raise AtcError(
                    f"{where}: atoms lie outside the box along the open axis {axis}: LAMMPS does not write where the "
                    "corner of the box is into extended XYZ; dump custom has it"
                )
        return cell

    def _types_agree(self, columns, where):
        ids = np.asarray(columns["id"])
        rows = self._data.all_rows(self._data.rows(ids), ids, where, "types")
        if not np.array_equal(np.asarray(columns["type"]), self._data.types[rows]):
            raise AtcError(f"{where}: its types are not those of {self._data.source}: other atoms, or another order")

    def _as_ase(self, frame, where):
        """ASE's meanings: masses of the elements where there are none, velocities from momenta (with the file's own
        masses, not given ones)."""
        extra = dict(frame.extra)
        extra.pop("element", None)
        own = extra.pop(_OWN_MASS, None)
        momenta = [extra.pop(f"momenta[{j}]", None) for j in (1, 2, 3)]
        changes = {}
        if own is None and (frame.masses is None or momenta[0] is not None):
            own = self._element_masses(frame)
        if frame.masses is None:
            changes["masses"] = own
        if all(p is not None for p in momenta):
            if own is None:
                raise AtcError(f"{where}: momenta without masses: name the elements, or add a column of masses")
            if not (own > 0).all():
                raise AtcError(f"{where}: momenta of atoms without mass")
            changes["velocities"] = np.stack(momenta, 1) / own[:, None]
        # Vectors stay together among what is not interpreted.
        for base in [name[:-3] for name in extra if name.endswith("[1]")]:
            parts = []
            while f"{base}[{len(parts) + 1}]" in extra:
                parts.append(extra.pop(f"{base}[{len(parts) + 1}]"))
            extra[base] = np.stack(parts, 1)
        return frame.replace(extra=extra, **changes)

    def _element_masses(self, frame):
        """(n,) masses of the elements by their names; None where a name is none of an element."""
        names = frame.type_names
        if not names or any(names.get(t) is None for t in np.unique(frame.types).tolist()):
            return None
        need_ase(self.source)
        from ase.data import atomic_masses, atomic_numbers

        z = np.array([atomic_numbers.get(names.get(t), -1) for t in range(max(names) + 1)])[frame.types]
        return None if (z < 0).any() else atomic_masses[z]

    def _numbered(self):
        return self._data is not None or any(name == "id" for name, _, _ in self._comment(0).columns)

    def _precision(self, frame):
        if self._ase:
            return decimal_resolution(frame.positions)
        step, why = text_resolution_of_frames(self._sample, self._has)
        return step * self.units.length, why

    def _sample(self, k) -> list[str]:
        """Some of the coordinates of frame k, as text."""
        _, buf, _, _ = self._text(k)
        lines = buf[: 1 << 18].tobytes().split(b"\n")[:-1]
        names, _ = self._names_and_kinds(self._comment(k), buf, "")
        at = [j for j, name in enumerate(names) if name.split("[")[0] in ("pos", "positions")]
        words = [w.split() for w in lines[:: max(1, len(lines) // 1000)]]
        return [w[a].decode("utf-8", "replace") for w in words for a in at if a < len(w)]


def _symbols(numbers, where) -> np.ndarray:
    need_ase(where)
    from ase.data import chemical_symbols

    if not ((numbers >= 0) & (numbers < len(chemical_symbols))).all():
        raise AtcError(f"{where}: column Z holds {int(numbers.max())}, which is no atomic number")
    return np.array(chemical_symbols)[numbers]


def _fills_a_box(x_nc) -> bool:
    """Whether atoms are as dense in each corner of the box around them as in its middle, as in a periodic cell. Too few
    to tell (less than four expected in a corner of a quarter of each side), and flat ones, do not."""
    low, high = x_nc.min(axis=0), x_nc.max(axis=0)
    if len(x_nc) < 4 * 4**3 or not (np.isfinite(high - low).all() and (high > low).all()):
        return False
    s_nc = (x_nc - low) / (high - low)
    ends_nc = (s_nc <= 0.25) | (s_nc >= 0.75)
    corner_n = (s_nc[ends_nc.all(axis=1)] > 0.5) @ np.array([1, 2, 4])
    return bool(np.bincount(corner_n, minlength=8).min() >= 0.5 * len(x_nc) / 4**3)


def need_ase(path):
    """An AtcError unless ASE can be imported."""
    try:
        import ase.io  # noqa: F401
    except ImportError:
        raise AtcError(f"{path}: reading it needs ASE: pip install ase") from None
