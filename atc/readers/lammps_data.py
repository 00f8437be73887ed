"""LAMMPS data files (``write_data``, ``read_data``): masses, atoms, velocities, bonded terms."""

from __future__ import annotations

import re

import numpy as np

from ..errors import AtcError
from ..frame import Cell, Frame, Topology
from ..units import Units
from . import _parse
from ._bytes import open_bytes
from .lammps_units import settle_units
from .trajectory import Masses, Trajectory, warn

# Columns of the Atoms section by atom_style (LAMMPS manual, read_data). Three image flags may follow.
ATOM_STYLES = {
    "angle": "id mol type x y z",
    "atomic": "id type x y z",
    "body": "id type bodyflag mass x y z",
    "bond": "id mol type x y z",
    "bpm/sphere": "id mol type diameter density x y z",
    "charge": "id type q x y z",
    "dipole": "id type q x y z mux muy muz",
    "dpd": "id type theta x y z",
    "edpd": "id type edpd_temp edpd_cv x y z",
    "electron": "id type q espin eradius x y z",
    "ellipsoid": "id type ellipsoidflag density x y z",
    "full": "id mol type q x y z",
    "line": "id mol type lineflag density x y z",
    "mdpd": "id type rho x y z",
    "molecular": "id mol type x y z",
    "peri": "id type volume density x y z",
    "sph": "id type rho esph cv x y z",
    "sphere": "id type diameter density x y z",
    "spin": "id type x y z spx spy spz sp",
    "template": "id type mol template_index template_atom x y z",
    "tri": "id mol type triangleflag density x y z",
}
_BONDED = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
_SECTIONS = (
    "Atoms|Velocities|Masses|Bonds|Angles|Dihedrals|Impropers|Ellipsoids|Lines|Triangles|Bodies|"
    "(?:Atom|Bond|Angle|Dihedral|Improper) Type Labels|"
    "(?:Pair|PairIJ|Bond|Angle|Dihedral|Improper|MiddleBondTorsion|EndBondTorsion|AngleTorsion|AngleAngleTorsion|BondBond13|AngleAngle|BondBond|BondAngle) Coeffs"
)
_SECTION = re.compile(rf"^[ \t]*({_SECTIONS})[ \t]*(?:#[ \t]*([^\r\n]*))?\r?$".encode(), re.M)
# Sections of other packages (fix property/atom, CMAP ...): a line of words alone between blank lines.
_OTHER = re.compile(rb"\n[ \t]*\r?\n[ \t]*([A-Za-z][A-Za-z_/-]*(?:[ \t]+[A-Za-z_/-]+)*|[A-Za-z]\S*)[ \t]*(?:#[^\n]*)?\r?\n[ \t]*\r?\n")
_HEADER = re.compile(
    r"^\s*(\d+)\s+(atoms|bonds|angles|dihedrals|impropers|atom types|bond types|angle types|dihedral types|improper types)\s*$"
)


def looks_like_data(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a data file: a count of atoms, or atom types, or box bounds in its header."""
    lines = head.split(b"\n")[1:60]
    found = [re.match(rb"^\s*[-+\d.eE]+\s.*?(atoms|atom types|xlo xhi|avec)\s*(#.*)?\r?$", line) for line in lines]
    return sum(m is not None for m in found) >= 2


class LammpsData:
    """What a LAMMPS data file says, in the file's own order and units until `use_units`.

    Attributes after `use_units` (internal units, atoms sorted by id): ``ids``, ``types``, ``positions``, ``images``, ``charges``, ``velocities``,
    ``per_atom_mass`` (sphere-like styles: density · volume), ``masses`` {type: mass}, ``type_names`` {type: label}, ``cell``,
    ``bonded`` {section: (types (m,), ids (m, 2..4))}, ``extra``.

    The atom style is the comment behind ``Atoms``; without one, it is taken from the number of columns if that leaves one possibility.
    The file does not know the boundaries: ``pp pp pp``, LAMMPS's own default, is assumed.
    """

    def __init__(self, path):
        self.source = str(path)
        reader = open_bytes(path)
        parts, at = [], 0
        while len(part := reader.read(at, at + (1 << 24))):
            parts.append(part.tobytes())
            at += len(part)
        reader.close()
        text = b"".join(parts)
        if not text.endswith(b"\n"):
            text += b"\n"
        self._text = text
        self._read_header()
        self._read_sections()
        del self._text

    # Reading ------------------------------------------------------------------------------------------------------------------------

    def _line(self, position: int) -> int:
        return self._text.count(b"\n", 0, position) + 1

    def _read_header(self):
        self._marks = list(_SECTION.finditer(self._text, self._text.find(b"\n")))  # the first line is a title, whatever it says
        if not self._marks:
            raise AtcError(f"{self.source}: no 'Atoms' section; is it a LAMMPS data file?")
        head = self._text[: self._marks[0].start()].decode("utf-8", "replace").split("\n")
        found = re.search(r"\bunits\s*=\s*(\w+)", head[0])
        self.unit_style = found.group(1) if found else None
        self.counts = {}
        bounds, tilt, general = {}, (0.0, 0.0, 0.0), {}
        for number, raw in enumerate(head[1:], 2):
            line = raw.split("#")[0].rstrip()
            if not line.strip():
                continue
            m = _HEADER.match(line)
            if m:
                self.counts[m.group(2)] = int(m.group(1))
                continue
            words = line.split()
            try:
                if words[-2:] in (["xlo", "xhi"], ["ylo", "yhi"], ["zlo", "zhi"]):
                    bounds[words[-1][0]] = (float(words[0]), float(words[1]))
                elif words[-3:] == ["xy", "xz", "yz"]:
                    tilt = tuple(float(w) for w in words[:3])
                elif words[-1] in ("avec", "bvec", "cvec") or words[-2:] == ["abc", "origin"]:
                    general[words[-1]] = [float(w) for w in words[:3]]
            except ValueError:
                raise AtcError(f"{self.source}, line {number}: expected numbers in {line.strip()!r}") from None
        if "atoms" not in self.counts:
            raise AtcError(f"{self.source}: the header has no '<n> atoms' line; is it a LAMMPS data file?")
        self.box = None
        if general:
            if set(general) != {"avec", "bvec", "cvec", "origin"}:
                raise AtcError(f"{self.source}: a general triclinic box needs avec, bvec, cvec and 'abc origin' in the header")
            self.box = (np.array([general[v] for v in ("avec", "bvec", "cvec")]), np.array(general["origin"]))
        elif set(bounds) == set("xyz"):
            lo, hi = np.array([bounds[a] for a in "xyz"]).T
            xy, xz, yz = tilt
            if not (hi > lo).all():
                raise AtcError(f"{self.source}: the box bounds {lo.tolist()} to {hi.tolist()} enclose no volume")
            lx, ly, lz = hi - lo
            self.box = (np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]]), lo)

    def _read_sections(self):
        self.labels = {}
        self.bonded = {}
        self._mass_of_key = {}
        self._raw = {"velocities": None}
        bodies = {}
        others = [m.start(1) for m in _OTHER.finditer(self._text)]
        starts = sorted({m.start() for m in self._marks} | {p for p in others if p > self._marks[0].start()})
        for m in self._marks:
            name = m.group(1).decode()
            end = next((s for s in starts if s > m.start()), len(self._text))
            if name in bodies:
                raise AtcError(f"{self.source}, line {self._line(m.start())}: a second '{name}' section")
            bodies[name] = (m.end() + 1, end, (m.group(2) or b"").decode("utf-8", "replace").strip())
        for name in bodies:
            if name.endswith("Type Labels"):
                rows, lines = self._rows(name, *bodies[name][:2], None)
                self.labels[name.split()[0]] = {r[1]: self._int(r[0], line) for r, line in zip(rows, lines)}
        if "Masses" in bodies:
            rows, lines = self._rows("Masses", *bodies["Masses"][:2], self.counts.get("atom types"))
            for r, line in zip(rows, lines):
                if len(r) < 2:
                    raise AtcError(f"{self.source}, line {line}: expected 'type mass' in section Masses")
                self._mass_of_key[self._type(r[0], "Atom", line)] = (r[1], line)
        if "Atoms" not in bodies:
            raise AtcError(f"{self.source}: no 'Atoms' section")
        self._read_atoms(*bodies["Atoms"])
        if "Velocities" in bodies:
            begin, end, _ = bodies["Velocities"]
            rows, lines = self._rows_raw(begin, end)
            width = len(rows[0]) if rows else 4
            if width < 4:
                raise AtcError(f"{self.source}, line {lines[0]}: expected 'id vx vy vz' in section Velocities")
            table = self._table(
                "Velocities", begin, end, self.counts["atoms"], ["id", "vx", "vy", "vz"] + [f"_{k}" for k in range(width - 4)]
            )
            self._raw["velocities"] = (table["id"], np.stack([table[v] for v in ("vx", "vy", "vz")], axis=1))
        for name, width in _BONDED.items():
            if name not in bodies:
                if self.counts.get(name.lower()):
                    raise AtcError(
                        f"{self.source}: the header announces {self.counts[name.lower()]} {name.lower()} but there is no section '{name}'"
                    )
                continue
            columns = ["id", "type", *(f"atom{k}" for k in range(width))]
            begin, end, _ = bodies[name]
            table = self._table(name, begin, end, self.counts.get(name.lower()), columns, text_types=name[:-1])
            self.bonded[name] = (table["type"], np.stack([table[c] for c in columns[2:]], axis=1))

    def _rows_raw(self, begin, end, limit=1):
        rows, lines = [], []
        number = self._line(begin)
        for raw in self._text[begin:end].split(b"\n") if limit is None else self._text[begin : min(end, begin + 65536)].split(b"\n"):
            words = raw.split(b"#")[0].split()
            if words:
                rows.append([w.decode("utf-8", "replace") for w in words])
                lines.append(number)
                if limit is not None and len(rows) >= limit:
                    break
            number += 1
        return rows, lines

    def _rows(self, name, begin, end, expected):
        rows, lines = self._rows_raw(begin, end, None)
        if expected is not None and len(rows) != expected:
            raise AtcError(f"{self.source}: section {name} has {len(rows)} lines, its header announces {expected}")
        return rows, lines

    def _int(self, word, line):
        try:
            return int(word)
        except ValueError:
            raise AtcError(f"{self.source}, line {line}: expected an integer, got {word!r}") from None

    def _type(self, word, kind, line):
        """A numeric type or a type label."""
        if word.lstrip("+-").isdigit():
            return int(word)
        try:
            return self.labels[kind][word]
        except KeyError:
            raise AtcError(f"{self.source}, line {line}: {word!r} is neither a number nor one of the file's {kind} Type Labels") from None

    def _table(self, name, begin, end, expected, columns, text_types=None) -> dict:
        """The columns of a section by name. `text_types` names the kind of label the "type" column may hold."""
        text = self._text[begin:end]
        first = self._line(begin)
        if b"#" in text:
            text = re.sub(rb"#[^\n]*", b"", text)
        # The kernel wants the lines next to each other: leave blank ones out, and remember which were there.
        lines = text.split(b"\n")
        keep = [k for k, line in enumerate(lines) if line.strip()]
        if expected is None:
            expected = len(keep)
        if len(keep) != expected:
            at = first + (keep[min(expected, len(keep) - 1)] if keep else 0)
            raise AtcError(
                f"{self.source}, line {at}: section {name} has {len(keep)} lines, its header announces {expected}; the file is cut off or damaged"
            )
        number = [first + k for k in keep]
        buf = np.frombuffer(b"\n".join([lines[k] for k in keep]) + b"\n", np.uint8)
        del text, lines
        whole = {"id", "mol", "ix", "iy", "iz", "atom0", "atom1", "atom2", "atom3", "bodyflag", "ellipsoidflag", "lineflag", "triangleflag"}
        probe = buf[: 1 << 16].tobytes().split(b"\n", 1)[0].split()
        labelled = (
            text_types is not None
            and "type" in columns
            and len(probe) > columns.index("type")
            and not probe[columns.index("type")].isdigit()
        )
        kinds = [_parse.INT if c in whole or c == "type" else _parse.FLOAT for c in columns]
        if labelled:
            kinds[columns.index("type")] = _parse.TEXT
        slots = [sum(k == kinds[c] for k in kinds[:c]) for c in range(len(kinds))]
        n = expected
        floats = np.empty((n, kinds.count(_parse.FLOAT)))
        ints = np.empty((n, kinds.count(_parse.INT)), np.int64)
        texts = np.empty((n, kinds.count(_parse.TEXT), 2), np.int64)
        hard = np.empty((4096, 4), np.int64)
        status, row, pos = _parse.FULL, 0, 0
        while status == _parse.FULL:
            status, row, pos, n_hard = _parse.parse_table(buf, pos, np.array(kinds), np.array(slots), row, n, floats, ints, texts, hard)
            for r, c, a, b in hard[:n_hard].tolist():
                word = buf[a:b].tobytes().decode("utf-8", "replace")
                try:
                    value = float(word)
                    if "_" in word or not np.isfinite(value) or (kinds[c] == _parse.INT and not value.is_integer()):
                        raise ValueError
                except ValueError:
                    kind = "an integer" if kinds[c] == _parse.INT else "a finite number"
                    raise AtcError(
                        f"{self.source}, line {number[r]}: expected {kind} for {columns[c]!r} in section {name}, got {word!r}"
                    ) from None
                if kinds[c] == _parse.INT:
                    ints[r, slots[c]] = int(value)
                else:
                    floats[r, slots[c]] = value
        if status != _parse.DONE:
            line = buf[pos:].tobytes().split(b"\n", 1)[0].decode("utf-8", "replace").strip()
            raise AtcError(
                f"{self.source}, line {number[row]}: expected {len(columns)} columns ({' '.join(columns)}) in section {name}, got {len(line.split())}: '{line[:60]}'"
            )
        out = {}
        for c, kind, slot in zip(columns, kinds, slots):
            if kind == _parse.TEXT:
                words = [buf[a:b].tobytes().decode("utf-8", "replace") for a, b in texts[:, slot].tolist()]
                out[c] = np.array([self._type(w, text_types, number[k]) for k, w in enumerate(words)], np.int64)
            else:
                out[c] = (floats if kind == _parse.FLOAT else ints)[:, slot].copy()
        return out

    def _read_atoms(self, begin, end, comment):
        rows, lines = self._rows_raw(begin, end)
        width = len(rows[0]) if rows else None
        style, *self._substyles = comment.split() or [None]
        sample, _ = self._rows_raw(begin, end, 500)
        columns = self._columns(style, sample, lines[0] if lines else 0)
        if width is not None and width == len(columns) + 3:
            columns = [*columns, "ix", "iy", "iz"]
        if width is not None and width != len(columns):
            raise AtcError(
                f"{self.source}, line {lines[0]}: atom style {self.atom_style!r} has the columns {' '.join(columns)} (and ix iy iz), the line has {width}; write the style behind the name of the section, e.g. 'Atoms # full'"
            )
        self._raw["atoms"] = self._table("Atoms", begin, end, self.counts["atoms"], columns, text_types="Atom")

    def _columns(self, style, rows, line):
        row = rows[0] if rows else None
        self.atom_style = style
        if style == "hybrid":
            return self._hybrid_columns(row)
        if style == "tdpd" or style == "smd" or style == "dielectric":
            if style == "smd":
                return "id type mol volume mass kradius cradius x0 y0 z0 x y z".split()
            n = len(row) if row else 5
            if style == "dielectric":
                return ["id", "type", "q", "x", "y", "z", *(f"{style}_{k}" for k in range(n - 6))]
            return ["id", "type", "x", "y", "z", *(f"{style}_{k}" for k in range(n - 5))]
        ask = "write the style behind the name of the section, e.g. 'Atoms # full'"
        base = re.sub(r"/(kk|omp|gpu|device|host)$", "", style or "")
        if base in ATOM_STYLES:  # otherwise the comment says something else
            self.atom_style = base
            return ATOM_STYLES[base].split()
        if row is None:
            return ATOM_STYLES["atomic"].split()
        possible = {}
        has_molecules = any(self.counts.get(name.lower()) for name in _BONDED)
        for name, spec in ATOM_STYLES.items():
            columns = spec.split()
            for extra in ([], ["ix", "iy", "iz"]):
                full = columns + extra
                if len(full) != len(row) or (has_molecules and "mol" not in full):
                    continue
                if all(_fits(c, w) for words in rows if len(words) == len(row) for c, w in zip(full, words)):
                    # What differs only in columns atc does not use is the same to it.
                    key = tuple(c if c in _USED else "-" for c in full)
                    possible.setdefault(key, (name, columns))
        if any(key[-1] == "iz" for key in possible):
            # The last three columns hold integers alone: image flags, not positions.
            possible = {key: style for key, style in possible.items() if key[-3:] != ("x", "y", "z")}
        if len(possible) != 1:
            names = ", ".join(name for name, _ in possible.values()) or "none"
            raise AtcError(
                f"{self.source}, line {line}: which atom style has these {len(row)} columns is not certain (possible: {names}); {ask}"
            )
        self.atom_style, columns = next(iter(possible.values()))
        return columns

    def _hybrid_columns(self, row):
        """id type x y z, then what each sub-style adds that those before it have not. LAMMPS itself writes 'Atoms # hybrid' alone."""
        columns = "id type x y z".split()
        known = [re.sub(r"/(kk|omp|gpu|device|host)$", "", name) for name in self._substyles]
        if known and all(name in ATOM_STYLES for name in known):
            have = set(columns)
            for name in known:
                for c in ATOM_STYLES[name].split():
                    # A mass per atom is one property, however a style prints it.
                    same = {"mass", "density"} if c in ("mass", "density") else {c}
                    if not have & same:
                        columns.append(c)
                        have.add(c)
            return columns
        n = len(row) if row else 5
        if n > 5:
            warn(
                f"{self.source}: 'Atoms # hybrid' does not name its sub-styles, so charges, masses and image flags in it are not used: write them "
                "behind it as in the run's atom_style line, e.g. 'Atoms # hybrid sphere charge'"
            )
        return [*columns, *(f"hybrid_{k}" for k in range(n - 5))]

    # Units ------------------------------------------------------------------------------------------------------------------------

    def use_units(self, u: Units):
        """Convert to internal units and sort by id."""
        a = self._raw["atoms"]
        where = self.source
        order = np.argsort(a["id"], kind="stable")
        self.ids = a["id"][order]
        twice = np.flatnonzero(np.diff(self.ids) == 0)
        if len(twice):
            raise AtcError(f"{where}: atom {self.ids[twice[0]]} is there twice in section Atoms")
        self.types = a["type"][order]
        if len(self.types) and self.types.min() < 1:
            raise AtcError(f"{where}: atom {self.ids[self.types.argmin()]} has type {self.types.min()}; types count from 1")
        self.positions = np.stack([a[c] for c in "xyz"], axis=1)[order] * u.length
        self.images = np.stack([a[c] for c in ("ix", "iy", "iz")], axis=1)[order] if "ix" in a else None
        self.charges = a["q"][order] * u.charge if "q" in a else None
        self.per_atom_mass = None
        if "mass" in a:
            self.per_atom_mass = a["mass"][order] * u.mass
        elif "diameter" in a and "density" in a:
            # LAMMPS: density is the mass for a diameter of 0.
            d, rho = a["diameter"][order], a["density"][order]
            self.per_atom_mass = np.where(d > 0, np.pi / 6.0 * d**3 * rho * u.density * u.length**3, rho * u.mass)
        known = {"id", "type", "x", "y", "z", "ix", "iy", "iz", "q", "mass"}
        self.extra = {c: v[order] for c, v in a.items() if c not in known}
        self.velocities = None
        if self._raw["velocities"] is not None:
            ids, v = self._raw["velocities"]
            at = np.argsort(ids, kind="stable")
            if not np.array_equal(ids[at], self.ids):
                raise AtcError(f"{where}: sections Atoms and Velocities hold different atoms")
            self.velocities = v[at] * u.velocity
        given = {t: m for t, (m, _) in self._mass_of_key.items()}
        self.masses = Masses(given, u, f"section Masses of {where}") if given else None
        self.type_names = {t: name for name, t in self.labels.get("Atom", {}).items()}
        self.cell = None if self.box is None else Cell(self.box[0] * u.length, self.box[1] * u.length)

    # As topology ------------------------------------------------------------------------------------------------------------------

    @property
    def has_masses(self):
        return self.masses is not None or self.per_atom_mass is not None

    def rows(self, ids) -> np.ndarray:
        """Row of each id here, −1 where there is none."""
        if len(ids) == len(self.ids) and np.array_equal(ids, self.ids):
            return np.arange(len(ids))
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)

    def all_rows(self, rows, ids, where, what):
        if (rows < 0).any():
            raise AtcError(
                f"{where}: atom {ids[np.flatnonzero(rows < 0)[0]]} is not in {self.source}, which should give its {what}; they belong to different systems"
            )
        return rows

    def masses_of(self, types, names, rows, ids, where):
        if self.per_atom_mass is not None:
            return self.per_atom_mass[self.all_rows(rows, ids, where, "mass")]
        return self.masses(types, names, where)

    def topology_for(self, ids, where) -> Topology | None:
        """Bonded terms with ids replaced by indices into the sorted `ids`."""
        if not any(len(t) for t, _ in self.bonded.values()):
            return None
        out = {}
        for name, (types, members) in self.bonded.items():
            at = np.minimum(np.searchsorted(ids, members), max(len(ids) - 1, 0))
            missing = (ids[at] != members) if len(ids) else np.ones(members.shape, bool)
            if missing.any():
                row, col = np.argwhere(missing)[0]
                raise AtcError(
                    f"{where}: atom {members[row, col]} of {name[:-1].lower()} {row + 1} in {self.source} is not in the frame; dump all bonded atoms"
                )
            out[name.lower()] = at
            out[f"{name[:-1].lower()}_types"] = types
        return Topology(**out)


_USED = frozenset("id mol type q mass x y z ix iy iz diameter density".split())
_NOT_NEGATIVE = frozenset("theta rho diameter density mass volume eradius edpd_temp edpd_cv esph cv".split())
_WHOLE = frozenset("id mol ix iy iz bodyflag ellipsoidflag lineflag triangleflag template_index template_atom".split())


def _fits(column: str, word: str) -> bool:
    """Whether a word can stand in a column: integers where integers belong, nothing negative where that has no meaning."""
    if column == "type":
        return not re.fullmatch(r"[-+]?(\d+\.\d*|\.\d+|0|-\d+|\d*\.?\d+[eE].*)", word)
    if column in _WHOLE:
        return bool(re.fullmatch(r"[01]" if column.endswith("flag") else r"[-+]?\d+", word))
    return bool(re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", word)) and not (column in _NOT_NEGATIVE and word.startswith("-"))


class LammpsDataTrajectory(Trajectory):
    """A data file as a trajectory of one frame. The file does not know its boundaries: periodic, as LAMMPS's default."""

    def __init__(self, path, topology=None, units=None, masses=None):
        super().__init__()
        if topology is not None:
            raise AtcError(f"{path} is a LAMMPS data file and its own topology: leave the topology argument out")
        self.source = str(path)
        data = LammpsData(path)
        self.units = settle_units(units, [(data.unit_style, self.source)] if data.unit_style else [], self.source)
        data.use_units(self.units)
        if data.cell is None:
            raise AtcError(f"{path}: the header has no complete box (xlo xhi, ylo yhi, zlo zhi)")
        self._data = data
        self._masses = None if masses is None else Masses(masses, self.units)

    @property
    def type_names(self):
        return self._data.type_names

    def __len__(self):
        return 1

    def _frame(self, k):
        d = self._data
        masses = None
        if self._masses is not None:
            masses = self._masses(d.types, d.type_names, self.source)
        elif d.has_masses:
            masses = d.masses_of(d.types, d.type_names, np.arange(len(d.ids)), d.ids, self.source)
        # What a LAMMPS script says of these atoms goes before what the file says.
        given = dict.fromkeys(("types", "charges", "topology") + ("masses",) * (self._masses is None), self.source)
        return Frame(
            positions=d.positions.copy(), cell=d.cell, units=self.units, types=d.types, ids=d.ids, masses=masses, velocities=d.velocities,
            charges=d.charges, images=d.images, topology=d.topology_for(d.ids, self.source), source=self.source, type_names=d.type_names,
            extra=dict(d.extra), molecules=d.extra.get("mol"), given={**given, "boundary": "assumed"},
        )  # fmt: skip
