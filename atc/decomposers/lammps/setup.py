"""What a script says of the atoms of a frame beyond what the frame shows: charges, types, masses, bonds, molecules,
boundaries.

A `Setup` is plain data: the commands of the script that concern atoms, and where it found its files. `Setup.complete`
carries them out for the atoms of a frame. What the frame itself shows goes before; what a data file that the user named
says must not contradict the script.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell, Topology
from ...units import units
from ..atom_columns import NAMES
from ..constraints.rules import UNSURE
from .atom_commands import MOLECULAR, SECTIONS, boundary_words, periodic_axes, set_keywords, touches
from .atom_table import Origin, rows_of
from .atoms import Atoms
from .read_data import data_options
from .regions import Trouble
from .script import Command, one_line, short

_FRAME = {"types": "types", "charges": "charges", "masses": "masses", "molecules": "molecules"}
_SAYS = {"types": "type", "charges": "charge", "masses": "mass", "molecules": "molecule"}
_UNITS = {"charges": "charge", "masses": "mass"}
_DUMP = {
    "types": "dump type too",
    "charges": "dump q too",
    "masses": "dump mass too",
    "molecules": "dump mol too",
    "topology": "name a data file that LAMMPS wrote behind these lines (write_data) as [trajectory] topology",
}


#: Instead of values: the frame is better off without the property.
_NOT_KNOWN = object()


@dataclass
class Setup:
    """The atoms of a script.

    Attributes
    ----------
    name : what to call the script
    commands : those that concern atoms, up to the run; later : those of other runs that go on from there
    changing : {property, "atoms" or "bonds": reason}, what fixes change while LAMMPS runs
    written : names of the data files that the script writes
    needs : which of "charges", "topology", "molecules" the potential depends on
    groups : names of the groups that pair exclusions, constraints and forces from outside need, bit k of
        `Frame.groups` the k-th; if_known : those of them that may stay unknown (see `constraint_rules.UNSURE`)
    may_lose : the line that lets atoms be lost, or ""
    columns : {column of a dump: property of atoms}, as the script's computes name them
    """

    name: str
    folder: Path
    units: str
    dimension: int = 3
    atom_style: tuple[str, ...] = ("atomic",)
    commands: tuple[Command, ...] = ()
    later: tuple[Command, ...] = ()
    changing: dict = field(default_factory=dict)
    written: tuple[str, ...] = ()
    needs: frozenset = frozenset()
    groups: tuple[str, ...] = ()
    may_lose: str = ""
    columns: dict = field(default_factory=dict)
    if_known: frozenset = frozenset()

    def __post_init__(self):
        self._cache = None
        self._files = {}
        self._stand_in = None
        for c in (*self.commands, *self.later):
            if c.name == "set" and not c.unknown:
                set_keywords(c)
            elif "boundary" in (c.name, *c.words[1:]) and c.name in ("boundary", "change_box") and not c.unknown:
                boundary_words(c)
        self.data_files = [data_options(c, self.folder).file for c in self.commands if c.name == "read_data"]
        edits = [c for c in self.commands if c.name not in ("read_data", "boundary", "mass") and touches(c)]
        #: {what: the first command that changes it behind the data files}
        self.edits = {}
        for c in edits:
            for what in touches(c):
                self.edits.setdefault(what, c)

    def __getstate__(self):
        return {**self.__dict__, "_cache": None, "_files": {}}

    def remarks(self) -> list[str]:
        """Where properties of atoms come from that the frames do not show, for `Potential.describe`."""
        if not self.data_files:
            return []
        files = " and ".join(dict.fromkeys(p.name for p in self.data_files))
        edits = dict.fromkeys(
            f"{c.name} ({short(c.where)})" for what, c in self.edits.items() if what not in ("boundary", "positions")
        )
        changed = f", changed by {', '.join(edits)}" if edits else ""
        return [f"what the frames do not show of atoms (charges, masses, bonds) is from {files}{changed}"]

    # Files
    # ------------------------------------------------------------------------------------------------------------------

    def _templates(self) -> list:
        """The molecules that ``atom_style template`` names, in their order; none if the script does not say them
        plainly."""
        from ...readers.lammps.molecule import read_molecule

        at = self.atom_style.index("template") + 1 if "template" in self.atom_style else len(self.atom_style)
        named = [c for c in self.commands if c.name == "molecule" and c.words[:1] == self.atom_style[at : at + 1]]
        if not named:
            return []
        # Words behind the files would shift types, or scale the molecule.
        files = [self.folder / w for w in named[-1].words[1:]]
        return [read_molecule(f) for f in files] if files and all(os.path.isfile(f) for f in files) else []

    def _open(self, path: Path, c: Command):
        """The data file of a read_data command; None if it is not there."""
        if self._stand_in is not None and self._stand_in.name == path.name and not os.path.exists(path):
            path = self._stand_in
        if path not in self._files:
            if not os.path.isfile(path):
                return None
            from ...readers.lammps.data import LammpsData

            with located(f"{c.where}: read_data"):
                data = LammpsData(path, " ".join(self.atom_style) or None)
                if data.untold:
                    data.use_molecules(self._templates())
                data.use_units(units(self.units))
            self._files[path] = data
        return self._files[path]

    def is_own(self, path) -> bool:
        """Whether a file is one that the script reads."""
        for mine in self.data_files:
            try:
                if Path(path).samefile(mine):
                    return True
            except OSError:
                continue
        return False

    @property
    def missing(self) -> Path | None:
        """A data file that the script reads and that is not there."""
        return next((p for p in self.data_files if not os.path.isfile(p)), None)

    @property
    def _lacking(self) -> Path | None:
        """The same, where no other file stands for it."""
        return self.missing if self._stand_in is None else None

    # Carrying out
    # ------------------------------------------------------------------------------------------------------------------

    def atoms(self, ids, types) -> Atoms:
        """The table of atoms at the run, for a frame that shows these ids and types (None: no types)."""
        last = self._cache
        if last is not None and np.array_equal(last[0], ids):
            if last[1] is types or (types is not None and last[1] is not None and np.array_equal(last[1], types)):
                return last[2]
        columns = {"charges": {"charge", "full", "dipole", "electron"}, "molecules": MOLECULAR | {"line", "tri", "smd"}}
        more = {
            "columns": {w for w, styles in columns.items() if styles & set(self.atom_style)},
            "mass_unit": units(self.units).mass,
        }
        origin = Origin(self.folder, self.units, self.dimension, self.atom_style, self._open, **more)
        table = Atoms(origin, ids, types).carry_out(self.commands)
        for c in self.later:
            table.change_later(c)
        for what, why in self.changing.items():
            if what == "atoms":
                table.complete, table.may_miss = False, table.may_miss or why
            for one in SECTIONS if what == "bonds" else [what]:
                table.taint_everyone(one, why)
        self._cache = (np.array(ids), None if types is None else np.array(types), table)
        return table

    def _table_of(self, frame) -> Atoms:
        return self.atoms(frame.ids, frame.types if self._own(frame, "types") else None)

    def complete(self, frame):
        """The frame with what the script says of its atoms.

        Raises
        ------
        AtcError for what is needed and not known, and for contradictions.
        """
        frame = self._with_names(frame)
        if not self._concerns(frame):
            return frame
        with one_line():
            return self._completed(frame)

    def _with_names(self, frame):
        """The frame whose columns have the names of what they hold, where potentials may depend on it: spx for c_3[1]
        of 'compute 3 all property/atom spx ...'."""
        held = ((self.columns.get(c), a) for c, a in frame.extra.items())
        more = {name: a for name, a in held if name in NAMES and name not in frame.extra}
        return frame.replace(extra={**frame.extra, **more}) if more else frame

    def _completed(self, frame):
        given = frame.given
        if given.get("ids"):
            return self._unnumbered(frame)
        self._named_file(given)
        table = self._table_of(frame)
        rows, found = rows_of(table.ids, frame.ids, table.alive)
        self._check_atoms(frame, table, found)
        changes, left = {}, {k: v for k, v in given.items() if k not in _FRAME and k not in ("topology", "boundary")}
        u = units(self.units)
        for p, attribute in _FRAME.items():
            value = self._property(frame, table, p, rows, found, u)
            if value is not None:
                changes[attribute] = None if value is _NOT_KNOWN else value
        top = self._topology(frame, table)
        if top is not None:
            changes["topology"] = top if top or self._has_bonds() else None
        if self.groups:
            changes["groups"] = self._group_bits(frame, table, rows, found)
        if given.get("boundary"):
            if "boundary" in table.why:
                raise AtcError(f"{frame.source}: the boundaries are not known: {table.why['boundary']}")
            if table.boundary is not None:
                changes["cell"] = Cell(frame.cell.vectors, frame.cell.origin, periodic_axes(table.boundary))
        return frame.replace(**changes, given=left)

    def _unnumbered(self, frame):
        """A frame whose atoms have no numbers of their own: nothing that the script says of single atoms can be put to
        them; masses are those of types, where no atom has one of its own."""
        table = self._table_of(frame)
        one_type = table.n_types == 1 and "types" not in self.changing
        if frame.masses is None and "masses" not in self.changing and (one_type or self._own(frame, "types")):
            of_type = table.type_masses
            every = np.isnan(table.masses).all() and not table.unknown["masses"].any()
            if every and set(np.unique(frame.types).tolist()) <= of_type.keys():
                top = int(frame.types.max(initial=0))
                m_t = np.array([of_type.get(t, 0.0) for t in range(top + 1)]) * units(self.units).mass
                frame = frame.replace(masses=m_t[frame.types])
        for p in ("types", "charges", "topology"):
            if p != "topology" and self._own(frame, p) and p not in self.changing:
                continue
            if p == "types" and one_type and (frame.types == 1).all():
                continue
            keys = SECTIONS if p == "topology" else (p,)
            c = next((self.edits[k] for k in (*keys, "ids") if k in self.edits), None)
            matters = self._has_bonds() if p == "topology" else p in self.needs or p != "charges"
            if c is not None and matters:
                raise AtcError(
                    f"{frame.source} does not number its atoms, so that {c.name} ({c.where}) cannot be put to them: "
                    "dump id too"
                )
        if needed := [g for g in self.groups if g != "all" and g not in self.if_known]:
            raise AtcError(
                f"{frame.source} does not number its atoms, so that who is in group {needed[0]} is not known: "
                "dump id too"
            )
        if self.groups:
            bits = sum(1 << (k + (0 if g == "all" else UNSURE)) for k, g in enumerate(self.groups))
            frame = frame.replace(groups=np.full(len(frame), bits, np.int64))
        periodic = self._periodic() if frame.given.get("boundary") else None
        return frame if periodic is None else frame.replace(cell=Cell(frame.cell.vectors, frame.cell.origin, periodic))

    def _periodic(self):
        """Which axes the last boundary line makes periodic, None if there is none."""
        found = [c for c in self.commands if c.name == "boundary" or (c.name == "change_box" and "boundary" in c.words)]
        return periodic_axes(boundary_words(found[-1])) if found else None

    def _own(self, frame, p) -> bool:
        """Whether a frame shows a property itself."""
        return getattr(frame, _FRAME[p]) is not None and p not in frame.given

    def _concerns(self, frame) -> bool:
        """Whether there is anything that the script could add to a frame, at little cost."""
        if self.groups or frame.given or self.changing or self.data_files:
            return True
        if frame.charges is None or frame.masses is None or ("molecules" in self.needs and frame.molecules is None):
            return bool(self.commands)
        return frame.topology is None and (self._has_bonds() or any(s in self.edits for s in SECTIONS))

    def _has_bonds(self) -> bool:
        return bool(MOLECULAR & set(self.atom_style))

    def _named_file(self, given) -> None:
        """A named data file that has the name of the one the script reads stands for it, where that is not there."""
        missing = self.missing
        files = [v for k, v in given.items() if k in (*_FRAME, "topology") and v not in ("assumed", "order")]
        named = Path(files[0]) if files else None
        self._stand_in = named if missing is not None and named is not None and named.name == missing.name else None

    def _check_atoms(self, frame, table, found) -> None:
        """The atoms of the frame are those of the script."""
        if not found.all() and table.complete and self.data_files and self._lacking is None:
            raise AtcError(
                f"{frame.source}: atom {frame.ids[~found][0]} is not among the atoms of {self.name} "
                f"({', '.join(p.name for p in self.data_files)}): they belong to different systems; where only the "
                "model of the script is meant, write its lines into lammps of [potential]"
            )
        if table.may_miss or self.may_lose or not self.data_files or self._lacking is not None:
            return
        _, there = rows_of(frame.ids, table.ids)
        gone = table.alive & ~there
        if gone.any():
            raise AtcError(
                f"{frame.source} has {len(frame)} of the {int(table.alive.sum())} atoms of {self.name}: atom "
                f"{table.ids[gone][0]} is missing, and the forces of "
                "atoms that are not there cannot be computed: dump all atoms"
            )

    def _trust(self, frame, what, file, why) -> None:
        """Whether to take the word of a file that the user named for what the script's commands leave open."""
        if file in ("assumed", "order") or self.is_own(file):
            raise AtcError(
                f"{frame.source}: the {what} of atoms are not known: {why}: {_DUMP.get(what, _DUMP['topology'])}"
            )
        if Path(file).name not in self.written and (self.data_files or what in self.changing):
            raise AtcError(
                f"{frame.source}: the {what} of atoms are taken from {file}, but {self.name} changes them: {why}: "
                f"{_DUMP.get(what, _DUMP['topology'])}"
            )

    def _property(self, frame, table, p, rows, found, u):
        """New values of a property, None to leave it as it is."""
        if self._own(frame, p):
            return None
        file = frame.given.get(p)
        old = getattr(frame, _FRAME[p])
        if p == "types" and table.n_types == 1:
            return None
        if p == "masses":
            values, known = table.mass_of(rows, found, frame.types)
        else:
            values, known = table.property_of(p, rows, found)
        if p == "charges" and not table.has_charges():
            return None
        if p == "molecules" and "molecules" not in self.needs:
            return None
        if not known.all():
            why = self._why(table, p, frame.ids[~known][0], found[~known][0])
            if old is not None and file:
                changed = p in self.edits or p in table.why or p in self.changing
                if changed and (p in self.needs or p == "types"):
                    self._trust(frame, p, file, why)
                return _NOT_KNOWN if changed and self.is_own(file) else None
            if p in self.needs or p == "types":
                raise AtcError(f"{frame.source}: the {p} of atoms are needed and not known: {why}: {_DUMP[p]}")
            return None
        if p in _UNITS:
            values = values * getattr(u, _UNITS[p])
        named = file and file not in ("assumed", "order") and not self.is_own(file) and self._stand_in is None
        if old is not None and named:
            same = np.isclose(values, old, rtol=1e-6, atol=0.0)
            if not same.all():
                a = np.flatnonzero(~same)[0]
                c = self.edits.get(p)
                by = f" ({c.name}, {c.where})" if c is not None else ""
                back = getattr(u, _UNITS[p]) if p in _UNITS else 1.0
                raise AtcError(
                    f"{frame.source}: {file} gives atom {frame.ids[a]} the {_SAYS[p]} {old[a] / back:g}, {self.name} "
                    f"the {_SAYS[p]} {values[a] / back:g}{by}: name the data file of this run, or none"
                )
        return values

    def _why(self, table, p, atom, listed) -> str:
        if p in table.why:
            return table.why[p]
        missing = self.missing
        if missing is not None:
            return f"{missing}, which {self.name} reads, is not there"
        if p == "masses":
            return f"{self.name} has no mass for its type"
        return f"atom {atom} is {'without one' if listed else 'not known'} in {self.name}"

    def _topology(self, frame, table):
        """The bonded terms of a frame, None to leave it as it is."""
        file = frame.given.get("topology")
        if frame.topology is not None and not file:
            return None
        why = next((table.why[s] for s in SECTIONS if s in table.why), None)
        missing = self._lacking
        if why is None and missing is not None and self._has_bonds():
            if file and not any(s in self.edits for s in SECTIONS):
                return None
            why = f"{missing}, which {self.name} reads, is not there"
        if not self._has_bonds() and frame.topology is None:
            return None
        if why is not None and (self._has_bonds() or file):
            if frame.topology is not None:
                self._trust(frame, "topology", file, why)
                return None
            raise AtcError(f"{frame.source}: the bonds are not known: {why}: {_DUMP['topology']}")
        if not any(len(t) for t, _ in table.bonded.values()) and table.weighted is None:
            if file and frame.topology and not self.is_own(file) and not self.data_files:
                return None
            return Topology() if frame.topology is not None or self._has_bonds() else None
        top = table.topology(frame)
        if file and not self.is_own(file) and self._stand_in is None:
            self._compare(frame, top, file)
        return top

    def _compare(self, frame, top, file) -> None:
        for section in SECTIONS:
            name = section.lower()
            both = top, frame.topology
            mine, theirs = (_canonical(getattr(t, name), getattr(t, f"{name[:-1]}_types")) for t in both)
            if not np.array_equal(mine, theirs):
                c = self.edits.get(section)
                by = f" (with {c.name}, {c.where})" if c is not None else ""
                raise AtcError(
                    f"{frame.source}: {file} and {self.name}{by} have different {name} ({len(theirs)} and "
                    f"{len(mine)}): name the data file of this run, or none"
                )

    def in_groups(self, names, frame) -> np.ndarray:
        """(n,) bool: which atoms of a frame are in all of some groups, as they are at the run.

        Raises
        ------
        AtcError for groups that there are not, and where it is not known who is in them.
        """
        if frame.given.get("ids"):
            who = f"who is in group {names[0]} is not known"
            raise AtcError(f"{frame.source} does not number its atoms, so that {who}: dump id too")
        table = self._table_of(frame)
        rows, found = rows_of(table.ids, frame.ids, table.alive)
        inside = np.ones(len(frame), bool)
        for name in names:
            if name != "all" and name not in table.groups:
                have = ", ".join(["all", *table.groups])
                raise AtcError(f"select groups: {self.name} has no group {name!r}: it has {have}")
            g = table.group(name)
            if name != "all" and not (found.all() and not g.unsure[rows].any()):
                unknown = frame.ids[~found] if not found.all() else []
                why = table.group_why.get(name) or (
                    f"atom {unknown[0]} is not among those of the script" if len(unknown) else "it changes"
                )
                raise AtcError(
                    f"{frame.source}: select groups: who is in group {name} is not known: {why}; select "
                    "them by types, ids or region"
                )
            inside &= g.inside[rows] if name != "all" else True
        return inside

    def _group_bits(self, frame, table, rows, found):
        bits = np.zeros(len(frame), np.int64)
        for k, name in enumerate(self.groups):
            try:
                g = table.group(name)
            except Trouble as e:
                raise AtcError(f"{self.name}: group {name}: {e}") from None
            if name in self.if_known and not (found.all() and not g.unsure[rows].any()):
                bits |= 1 << (k + UNSURE)
                continue
            if not found.all() and name != "all":
                raise AtcError(
                    f"{frame.source}: whether atom {frame.ids[~found][0]} is in group {name} is not known, on which "
                    "excluded pairs or constraints depend"
                )
            if found.any() and g.unsure[rows].any():
                raise AtcError(
                    f"{frame.source}: who is in group {name}, on which excluded pairs or constraints depend, is not "
                    f"known: {table.group_why.get(name, 'it changes')}"
                )
            bits |= np.where(g.inside[rows] if found.any() and name != "all" else name == "all", 1 << k, 0)
        return bits


def _canonical(atoms, types):
    """(m, k + 1) rows in an order of their own, each from the end that comes first."""
    atoms = np.asarray(atoms)
    if not len(atoms):
        return np.zeros((0, atoms.shape[1] + 1), np.int64)
    back = atoms[:, 0] > atoms[:, -1]
    rows = np.column_stack([np.where(back[:, None], atoms[:, ::-1], atoms), types])
    return rows[np.lexsort(rows.T[::-1])]
