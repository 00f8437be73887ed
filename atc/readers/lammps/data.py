"""LAMMPS data files (``write_data``, ``read_data``): masses, atoms, velocities, bonded terms."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Cell, Topology
from ...units import Units
from ..masses import Masses
from ..trajectory import warn
from .atom_styles import ASK, WHOLE, AtomStyle, inferred_style, style_of_comment
from .data_header import LARGE, SMALL, DataHeader, header_line
from .masses import SHAPES, centres, masses_by_shape
from .molecule import bonded_of_templates
from .sections import SectionedFile, number_of, shortened, whole_of

_BONDED = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
_KINDS = ("Atom", "Bond", "Angle", "Dihedral", "Improper")
#: Sections of coefficients: whose types their lines begin with, and the words of class 2 that stand for the cross term
#: in a coeff command.
COEFFS = {
    "Pair Coeffs": ("pair", ""), "PairIJ Coeffs": ("pairij", ""), "Bond Coeffs": ("bond", ""),
    "Angle Coeffs": ("angle", ""), "Dihedral Coeffs": ("dihedral", ""), "Improper Coeffs": ("improper", ""),
    "BondBond Coeffs": ("angle", "bb"), "BondAngle Coeffs": ("angle", "ba"), "UreyBradley Coeffs": ("angle", "ub"),
    "MiddleBondTorsion Coeffs": ("dihedral", "mbt"), "EndBondTorsion Coeffs": ("dihedral", "ebt"),
    "AngleTorsion Coeffs": ("dihedral", "at"), "AngleAngleTorsion Coeffs": ("dihedral", "aat"),
    "BondBond13 Coeffs": ("dihedral", "bb13"), "AngleAngle Coeffs": ("improper", "aa"),
}  # fmt: skip
SECTIONS = frozenset(
    "Atoms Velocities Masses Ellipsoids Lines Triangles Bodies".split()
    + [*_BONDED, *COEFFS, *(f"{k} Type Labels" for k in _KINDS)]
)


class LammpsData(DataHeader):
    """What a LAMMPS data file says, in the file's own order and units until `use_units`.

    Attributes after `use_units` (internal units, atoms sorted by id): ``ids``, ``types``, ``positions``, ``images``,
    ``charges``, ``velocities``,
    ``per_atom_mass`` (styles whose atoms have a mass of their own), ``masses`` {type: mass}, ``type_names`` {type:
    label}, ``cell``,
    ``bonded`` {section: (types (m,), ids (m, 2..4))}, ``extra``.

    Parameters
    ----------
    path : str or Path, plain or compressed
    atom_style : the run's ``atom_style`` line, e.g. "hybrid sphere molecular". It goes before the comment behind
        ``Atoms``; without both, the style is
        taken from the number of columns if that leaves one possibility.
    molecules : `LammpsMolecule`s of the run's molecule template, for the bonded terms of atom_style template

    The file does not know the boundaries: ``pp pp pp``, LAMMPS's own default, is assumed.

    Raises
    ------
    AtcError, with file and line, for what LAMMPS would not read, or what is not certain.
    """

    def __init__(self, path, atom_style=None, molecules=None):
        self.source = str(path)
        self._file = SectionedFile(path, SECTIONS, header_line, "data file")
        self._read_header()
        self._read_sections(None if atom_style is None else AtomStyle(atom_style, self.source))
        del self._file
        if molecules is not None:
            self.use_molecules(molecules)

    # Reading
    # ------------------------------------------------------------------------------------------------------------------

    def _read_sections(self, given: AtomStyle | None):
        f = self._file
        self.labels, self.bonded, self._mass_of_key = {}, {}, {}
        self._raw = {"velocities": None}
        for kind in _KINDS:
            if f"{kind} Type Labels" in f.places:
                self.labels[kind] = self._read_labels(kind)
        if "Masses" in f.places:
            self._read_masses()
        if "Atoms" in f.places:
            self._read_atoms(f.section("Atoms"), given)
        elif self.counts["atoms"]:
            raise AtcError(f"{self.source}: no 'Atoms' section")
        else:
            self.style = given or AtomStyle("atomic", self.source)
            self.atom_style = self.style.name
            kinds = {"id": np.int64, "type": np.int64, "x": float, "y": float, "z": float}
            self._raw["atoms"] = {c: np.zeros(0, kind) for c, kind in kinds.items()}
            self._mass_n, self._masses_unsure, self._certain, self._lines = None, False, True, ()
        self._default_bounds([self._raw["atoms"][c] for c in "xyz"])
        if "Velocities" in f.places:
            self._read_velocities(f.section("Velocities"))
        for name, width in _BONDED.items():
            self._read_bonded(name, width)
        for name in f.others:
            if name != "CMAP":
                warn(
                    f"{self.source}: section {shortened(name)!r} is none of LAMMPS's own (a fix of the run reads it): "
                    "what it says is not used here"
                )
        #: {name: lines as words} of sections that fixes read, such as CMAP
        self.of_fixes = {name: f.section(name) for name in f.others}

    def _read_labels(self, kind) -> dict:
        s = self._file.section(f"{kind} Type Labels")
        s.require(self.counts.get(f"{kind.lower()} types"))
        out = {}
        for k, words in enumerate(s.rows()):
            number = whole_of(words[0])
            if len(words) != 2 or number is None:
                raise AtcError(
                    f"{s.where(k)}: expected 'type label' in section {s.name}, got {shortened(' '.join(words))!r}"
                )
            if words[1] in out:
                raise AtcError(f"{s.where(k)}: label {shortened(words[1])!r} is there twice in section {s.name}")
            out[words[1]] = number
        return out

    def _read_masses(self):
        s = self._file.section("Masses")
        expected = self.counts.get("atom types")
        if expected is not None and len(s) != expected:
            raise AtcError(
                f"{self.source}, line {s.line}: section Masses has {len(s)} lines, its header announces {expected}"
            )
        for k, words in enumerate(s.rows()):
            if len(words) < 2:
                raise AtcError(f"{s.where(k)}: expected 'type mass' in section Masses")
            t = self.labels.get("Atom", {}).get(words[0], whole_of(words[0]))
            if t is None:
                raise AtcError(
                    f"{s.where(k)}: {shortened(words[0])!r} is neither a number nor one of the file's Atom Type Labels"
                )
            mass = number_of(words[1])
            if mass is None or not SMALL < mass < LARGE:
                raise AtcError(
                    f"{s.where(k)}: the mass of {shortened(words[0])} is {shortened(words[1])!r}, expected a positive "
                    "number"
                )
            if t in self._mass_of_key:
                raise AtcError(f"{s.where(k)}: type {t} is there twice in section Masses")
            self._mass_of_key[t] = (words[1], int(s.number[k]))

    def _read_velocities(self, s):
        s.require(self.counts["atoms"])
        width = len(s.rows(1)[0]) if len(s) else 4
        columns = self.style.velocity_columns() if self.style.parts else ["id", "vx", "vy", "vz"]
        if width > len(columns) and not self._certain:
            columns = [*columns, *(f"_{k}" for k in range(width - len(columns)))]
        table = s.table(columns, WHOLE)
        self._raw["velocities"] = (table["id"], np.stack([table[v] for v in ("vx", "vy", "vz")], axis=1))

    def _read_bonded(self, name, width):
        one = name[:-1].lower()
        found = self._file.bonded(name, width, self.counts.get(name.lower()), self.labels.get(name[:-1]))
        if found is None:
            return
        s, types, members = found
        top = self.counts.get(f"{one} types")
        wrong = (types < 1) | (types > (2**62 if top is None else top))
        if wrong.any():
            k = int(wrong.argmax())
            raise AtcError(
                f"{s.where(k)}: {one} type {types[k]} in section {name}: types go from 1 to "
                f"{'the header has none' if top is None else top}"
            )
        twice = (np.diff(np.sort(members, axis=1), axis=1) == 0).any(axis=1)
        if twice.any():
            raise AtcError(f"{s.where(int(twice.argmax()))}: a {one} of one atom with itself in section {name}")
        self.bonded[name] = (types, members)

    def _read_atoms(self, s, given):
        n = self.counts["atoms"]
        s.require(n)
        sample = s.rows(500)
        row = sample[0] if sample else None
        at = s.where(0) if len(s) else f"{self.source}, line {s.line}"
        hint = style_of_comment(s.comment)
        bonded = any(self.counts.get(name.lower()) for name in _BONDED)
        style = given or hint or (AtomStyle("atomic", at) if row is None else inferred_style(sample, bonded, at))
        self._certain = bool((given or hint) is not None and style.parts)
        columns = self._fitting(style, row, given, at)
        if given is not None and hint is not None and hint.parts and _same_columns(hint, given, row) is False:
            warn(
                f"{at}: the comment behind Atoms says {hint.name!r}, but the run's atom style is {given.name!r}: read "
                "as the latter, as LAMMPS does"
            )
        self.style, self.atom_style = style, style.name
        a = s.table(columns, WHOLE, self.labels.get("Atom"))
        ids = a["id"]
        if len(ids) and ids.min() < 1:
            k = int(ids.argmin())
            raise AtcError(f"{s.where(k)}: atom id {ids[k]} in section Atoms: ids count from 1")
        if "spin" in style.parts and not style.hybrid:
            _check_spins(a, s)
        self._raw["atoms"], self._lines = a, s.number
        shapes = {}
        for name, flag, of in SHAPES.values():
            if flag in a and name in self._file.places:
                section = self._file.section(name)
                section.require(self.counts.get(name.lower()))
                shapes[name] = section.table(of.split(), WHOLE)
        self._mass_n = masses_by_shape(style.parts, a, shapes, self.source)
        for part in {"line", "tri"} & set(style.parts):
            centres(part, a, shapes)
        # A hybrid whose parts are not known may have masses of its own, which go before those of section Masses.
        self._masses_unsure = "peri" in style.parts and self._mass_n is None
        self._masses_unsure |= (
            style.hybrid and not style.parts and (row is None or len(row) > 6) and not self._without_shapes()
        )

    def _without_shapes(self):
        """Whether the lines of section Velocities show that no part of a hybrid has a mass of its own (those have
        angular velocities too)."""
        if "Velocities" not in self._file.places:
            return False
        rows = self._file.section("Velocities").rows(1)
        shaped = any(name in self._file.places for name in ("Ellipsoids", "Bodies", "Lines", "Triangles"))
        return bool(rows) and len(rows[0]) == 4 and not shaped

    def _fitting(self, style, row, given, at) -> list[str]:
        """The columns of a style, with image flags if the lines have them; an error if the lines have other ones."""
        if style.hybrid and not style.parts:
            return self._unnamed_hybrid(row)
        columns = style.columns()
        width = len(columns) if row is None else len(row)
        if style.certain or style.hybrid:
            if width == len(columns) + 3:
                columns = [*columns, "ix", "iy", "iz"]
        elif width > len(columns):
            columns = style.columns(width)  # tdpd: concentrations, and perhaps image flags, which are not told apart
        if width != len(columns):
            by = " (the atom_style given)" if given is not None else ""
            raise AtcError(
                f"{at}: atom style {style.name!r}{by} has the columns {shortened(' '.join(columns), 200)} (and ix iy "
                f"iz), the line has {width}; " + ("correct the atom_style" if given is not None else ASK)
            )
        return columns

    def _unnamed_hybrid(self, row):
        """id type x y z, then what each sub-style adds that those before it have not. LAMMPS itself writes 'Atoms #
        hybrid' alone."""
        n = 5 if row is None else len(row)
        if n > 5:
            warn(
                f"{self.source}: 'Atoms # hybrid' does not name its sub-styles, so charges, masses and image flags in "
                "it are not used: write them behind it as in the run's atom_style line, e.g. 'Atoms # hybrid sphere "
                "charge', or give it as atom_style"
            )
        return ["id", "type", "x", "y", "z", *(f"hybrid_{k}" for k in range(n - 5))]

    # Molecules of templates
    # -----------------------------------------------------------------------------------------------------------

    def use_molecules(self, molecules) -> None:
        """Take the bonded terms of atoms of style template from the molecules that the run's ``molecule`` command
        named, in its order."""
        if "template_index" in self._raw["atoms"] and molecules:
            self.bonded = bonded_of_templates(self._raw["atoms"], molecules, self.source)

    @property
    def untold(self) -> str:
        """Why the bonded terms of the atoms are not known; empty if they are."""
        a = self._raw["atoms"]
        if "template_index" in a and not self.bonded and (a["template_index"] > 0).any():
            return (
                f"{self.source}: the bonds of atom_style template are in the molecule files of the run: which atoms "
                "are bonded is not known; give a data file of another atom style, with sections Bonds, Angles, ..."
            )
        return ""

    # Units
    # ------------------------------------------------------------------------------------------------------------------

    def _atom_line(self, row: int) -> str:
        return f", line {self._lines[row]}" if row < len(self._lines) else ""

    def use_units(self, u: Units):
        """Convert to internal units and sort by id."""
        a = self._raw["atoms"]
        where = self.source
        order = np.argsort(a["id"], kind="stable")
        self.ids = a["id"][order]
        twice = np.flatnonzero(np.diff(self.ids) == 0)
        if len(twice):
            line = self._atom_line(int(order[twice[0] + 1]))
            raise AtcError(f"{where}{line}: atom {self.ids[twice[0]]} is there twice in section Atoms")
        self.types = a["type"][order]
        if len(self.types) and self.types.min() < 1:
            k = int(self.types.argmin())
            raise AtcError(
                f"{where}{self._atom_line(int(order[k]))}: atom {self.ids[k]} has type {self.types[k]}; types count "
                "from 1"
            )
        self.positions = np.stack([a[c] for c in "xyz"], axis=1)[order] * u.length
        self.images = np.stack([a[c] for c in ("ix", "iy", "iz")], axis=1)[order] if "ix" in a else None
        self.charges = a["q"][order] * u.charge if "q" in a else None
        self.per_atom_mass = None if self._mass_n is None else self._mass_n[order] * u.mass
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

    # As topology
    # ------------------------------------------------------------------------------------------------------------------

    @property
    def has_masses(self):
        return self.per_atom_mass is not None or (self.masses is not None and not self._masses_unsure)

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
                f"{where}: atom {ids[np.flatnonzero(rows < 0)[0]]} is not in {self.source}, which should give its "
                f"{what}; they belong to different systems"
            )
        return rows

    def masses_of(self, types, names, rows, ids, where):
        if self.per_atom_mass is not None:
            return self.per_atom_mass[self.all_rows(rows, ids, where, "mass")]
        return self.masses(types, names, where)

    def topology_for(self, ids, where) -> Topology | None:
        """Bonded terms with ids replaced by indices into the sorted `ids`."""
        if self.untold:
            return Topology(untold=self.untold)
        if not any(len(t) for t, _ in self.bonded.values()):
            return None
        out = {}
        for name, (types, members) in self.bonded.items():
            at = np.minimum(np.searchsorted(ids, members), max(len(ids) - 1, 0))
            missing = (ids[at] != members) if len(ids) else np.ones(members.shape, bool)
            if missing.any():
                row, col = np.argwhere(missing)[0]
                if members[row, col] not in self.ids:
                    raise AtcError(
                        f"{self.source}: {name[:-1].lower()} {row + 1} in section {name} has atom "
                        f"{members[row, col]}, which is not in section Atoms"
                    )
                raise AtcError(
                    f"{where}: atom {members[row, col]} of {name[:-1].lower()} {row + 1} in {self.source} is not in "
                    "the frame; dump all bonded atoms"
                )
            out[name.lower()] = at
            out[f"{name[:-1].lower()}_types"] = types
        return Topology(**out)


def _same_columns(one: AtomStyle, other: AtomStyle, row):
    """Whether two styles read a line alike, as far as atc uses it; None if that is not known."""
    if not (one.certain and other.certain):
        return None
    used = {"id", "mol", "type", "q", "mass", "x", "y", "z", "diameter", "density"}
    a, b = one.columns(), other.columns()
    return len(a) == len(b) and all(p == q for p, q in zip(a, b, strict=True) if {p, q} & used)


def _check_spins(a, s):
    """Versions of LAMMPS before 2018 had the size of the spin in front of the position; read as today's, directions are
    no unit vectors then."""
    norm = np.sqrt(a["spx"] ** 2 + a["spy"] ** 2 + a["spz"] ** 2)
    older = np.sqrt(a["spy"] ** 2 + a["spz"] ** 2 + a["sp"] ** 2)
    odd = np.abs(norm - 1) > 0.02
    if len(norm) and odd.any() and not (norm[odd] == 0).all() and (np.abs(older - 1) < 0.02).all():
        k = int(odd.argmax())
        raise AtcError(
            f"{s.where(k)}: the spin's direction is no unit vector, as if the columns were id type sp x y z spx spy "
            "spz of an old LAMMPS: today's are id type x y z spx spy spz sp; convert the file"
        )
