"""The atoms of a LAMMPS script: what its commands make of those of the data file before the run starts.

Commands are carried out on a table of atoms. What cannot be known (random choices, positions of atoms that ``create_atoms`` made, what a run moved) is marked
as unknown, atom by atom and property by property, with the reason: it matters only where it is needed and the frames do not show it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import AtcError
from .regions import Region, Trouble, lattice_spacing, parse_region
from .script import Command

#: Properties of atoms that are kept, and what a created atom has.
PROPERTIES = {"types": 0, "charges": 0.0, "molecules": 0, "masses": np.nan, "positions": np.nan}
SECTIONS = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
#: Keywords of ``set``: how many values each has, and which property it changes ("" for what no supported force depends on).
SET = {
    "type": (1, "types"), "type/fraction": (3, "types"), "type/ratio": (3, "types"), "type/subset": (3, "types"), "mol": (1, "molecules"),
    "x": (1, "positions"), "y": (1, "positions"), "z": (1, "positions"), "charge": (1, "charges"), "mass": (1, "masses"), "density": (1, "masses"),
    "density/disc": (1, "masses"), "smd/mass/density": (1, "masses"), "bond": (1, "Bonds"), "angle": (1, "Angles"), "dihedral": (1, "Dihedrals"),
    "improper": (1, "Impropers"), "image": (3, ""), "vx": (1, ""), "vy": (1, ""), "vz": (1, ""), "dipole": (3, ""), "dipole/random": (2, ""), "spin": (4, ""),
    "spin/atom": (4, ""), "spin/random": (2, ""), "spin/atom/random": (2, ""), "spin/electron": (1, ""), "radius/electron": (1, ""), "quat": (4, ""),
    "quat/random": (1, ""), "diameter": (1, ""), "shape": (3, ""), "length": (1, ""), "tri": (1, ""), "theta": (1, ""), "theta/random": (1, ""),
    "angmom": (3, ""), "omega": (3, ""), "temperature": (1, ""), "volume": (1, ""), "sph/e": (1, ""), "sph/cv": (1, ""), "sph/rho": (1, ""),
    "rheo/rho": (1, ""), "rheo/status": (1, ""), "smd/contact/radius": (1, ""), "dpd/theta": (1, ""), "edpd/temp": (1, ""), "edpd/cv": (1, ""), "cc": (2, ""),
    "epsilon": (1, ""),
}  # fmt: skip
#: Copies of atoms that ``replicate`` makes here, at most.
_MOST_ATOMS = 50_000_000
_RANDOM = ("type/fraction", "type/ratio", "type/subset")
_MOLECULAR = {"angle", "bond", "full", "molecular", "template", "amoeba", "oxdna"}


def set_keywords(c: Command) -> list[tuple[str, tuple[str, ...]]]:
    """[(keyword, values), ...] of a ``set`` command. AtcError for a keyword that is not known."""
    out, k = [], 2
    if len(c.words) < 4:
        raise AtcError(f"{c.where}: expected 'set atom|type|mol|group|region <which> <keyword> <value>', got 'set {' '.join(c.words)}'")
    while k < len(c.words):
        key = c.words[k]
        n = 1 if re.match(r"[id]2?_", key) else SET.get(key, (0, ""))[0]
        if not n or k + n >= len(c.words):
            raise AtcError(f"{c.where}: set {key}: {'its value is missing' if n else 'no property of atoms that atc knows'}")
        out.append((key, c.words[k + 1 : k + 1 + n]))
        k += 1 + n
    return out


def boundary_words(c: Command) -> tuple[str, ...]:
    """The three words of a ``boundary`` command, or of ``change_box ... boundary``."""
    words = c.words if c.name == "boundary" else c.words[c.words.index("boundary") + 1 :][:3]
    if len(words) != 3 or any(not re.fullmatch("p|pp|[fsm]{1,2}", w) for w in words):
        raise AtcError(f"{c.where}: {c.name}: expected three of p, f, s, m, got {' '.join(words) or 'nothing'}")
    return tuple(words)


def _without_boundary(words):
    if "boundary" not in words:
        return words
    k = words.index("boundary")
    return words[:k] + words[k + 4 :]


def touches(c: Command) -> set[str]:
    """What a command changes: property names, section names, "boundary", "atoms" (which there are), "ids"."""
    if c.name == "set":
        return {SET.get(key, (0, ""))[1] for key, _ in set_keywords(c)} - {""}
    if c.name == "delete_atoms":
        return {"atoms", "ids", *SECTIONS}
    if c.name in ("delete_bonds", "create_bonds"):
        return set(SECTIONS)
    if c.name in ("read_data", "create_atoms", "replicate", "read_restart", "read_dump"):
        return {"atoms", "types", "charges", "molecules", "masses", *SECTIONS}
    if c.name in ("reset_atom_ids", "reset_ids") or (c.name == "reset_atoms" and c.words[:1] == ("id",)):
        return {"ids"}
    if c.name == "reset_mol_ids" or (c.name == "reset_atoms" and c.words[:1] == ("mol",)):
        return {"molecules"}
    if c.name == "change_box":
        return {"boundary"} if "boundary" in c.words else set()
    return {"boundary": {"boundary"}, "mass": {"masses"}}.get(c.name, set())


@dataclass
class Origin:
    """What the commands start from, apart from the files they name."""

    folder: Path
    units: str
    dimension: int
    atom_style: tuple[str, ...]
    open_data: object  # (path, command) → LammpsData in internal units, or None
    labels: dict = field(default_factory=dict)
    columns: set = field(default_factory=set)  # properties that the data file's own columns give
    mass_unit: float = 1.0


@dataclass
class _Group:
    inside: np.ndarray
    unsure: np.ndarray


class Atoms:
    """The table, as commands change it.

    Parameters
    ----------
    origin : Origin
    shown_ids, shown_types : ids and types of the atoms of a frame: the atoms that no data file lists are among them; types None if the frame has none

    Attributes
    ----------
    ids, types, charges, molecules, masses, positions : (n,) and (n, 3), in the script's own units; masses are NaN where the type's holds
    unknown : {property: (n,) bool}. why : {property, section or "ids": reason}
    alive : (n,) bool, atoms that are still there
    bonded : {section: (types (m,), members (m, k))}, members by id. weighted : the same for special bonds where they differ, or None
    type_masses : {type: mass}
    boundary : three of LAMMPS's words, or None
    """

    def __init__(self, origin: Origin, shown_ids, shown_types):
        self.origin, self.shown_ids, self.shown_types = origin, np.asarray(shown_ids), shown_types
        self.ids = np.zeros(0, np.int64)
        self.types = self.molecules = np.zeros(0, np.int64)
        self.charges = self.masses = np.zeros(0)
        self.positions = np.zeros((0, 3))
        self.alive = self.fresh = np.zeros(0, bool)
        self.unknown = {p: np.zeros(0, bool) for p in PROPERTIES}
        self.why: dict[str, str] = {}
        self.groups: dict[str, _Group] = {}
        self.group_why: dict[str, str] = {}
        self.bonded = {s: (np.zeros(0, np.int64), np.zeros((0, k), np.int64)) for s, k in SECTIONS.items()}
        self.weighted = None
        self.type_masses: dict[int, float] = {}
        self.regions: dict[str, Region | str] = {}
        self.spacing, self.box, self.boundary = np.ones(3), None, None
        self.tilt = (0.0, 0.0, 0.0)
        self.fresh_charges: dict[int, float] | None = None  # of renumbered atoms, by type; None: created atoms, without charge
        self.files: list[Path] = []
        self.may_miss = ""
        self.complete = True  # whether every atom of the run is known to be in the table
        self.last_type_change = -1
        self.later_types: list[set[int]] = []

    # Carrying out ------------------------------------------------------------------------------------------------------------------------

    def carry_out(self, commands) -> Atoms:
        """Carry out the commands, in order."""
        self.last_type_change = max((k for k, c in enumerate(commands) if c.name == "set" and "types" in touches(c)), default=-1)
        created = [(k, {int(c.words[0])} if c.words[:1] and c.words[0].isdigit() and "mol" not in c.words else None)
                   for k, c in enumerate(commands) if c.name == "create_atoms"]  # fmt: skip
        for k, c in enumerate(commands):
            self.later = [types for at, types in created if at > k]
            self.k = k
            method = getattr(self, f"_{c.name}", None)
            if method is None:
                continue
            try:
                if c.unknown:
                    raise Trouble(c.unknown)
                method(c)
            except Trouble as e:
                self._taint_all(c, f"{c.where}: {c.name}: {e}")
            self._settle_types(k)
        return self

    def _settle_types(self, k) -> None:
        """Behind the last command that changes types, atoms have those that the frame shows, if it shows any."""
        if k >= self.last_type_change and self.shown_types is not None and self.unknown["types"].any():
            rows, found = _rows(self.shown_ids, self.ids)
            take = self.unknown["types"] & found
            self.types = np.where(take, self.shown_types[rows], self.types)
            self.unknown["types"] = self.unknown["types"] & ~take

    def _taint(self, what: str, mask, why: str) -> None:
        if what in self.unknown:
            if np.any(mask & ~self.unknown[what]):
                self.why.setdefault(what, why)
            self.unknown[what] = self.unknown[what] | mask
        else:
            self.why.setdefault(what, why)

    def _taint_all(self, c: Command, why: str) -> None:
        """What a command that cannot be carried out may have changed is unknown from here on."""
        everyone = self.alive.copy()
        if c.name == "group":
            name = c.words[0] if c.words else ""
            g = self.groups.setdefault(name, _Group(np.zeros(len(self.ids), bool), np.zeros(len(self.ids), bool)))
            g.unsure = everyone
            self.group_why.setdefault(name, why)
        elif c.name == "region":
            self.regions[c.words[0] if c.words else ""] = why
        elif c.name == "lattice":
            self.spacing = None
        elif c.name in ("displace_atoms", "change_box", "read_dump"):
            self._taint("positions", everyone, why)
            if c.name == "change_box":
                self.box = None
                if "boundary" in c.words:
                    self._taint("boundary", None, why)
        elif c.name in ("create_box", "mass", "labelmap"):
            self._taint("masses" if c.name != "create_box" else "box", everyone, why)
        else:
            changed = touches(c)
            if "atoms" in changed:
                self.complete, self.may_miss = False, self.may_miss or why
            for what in changed - {"atoms"}:
                self._taint(what, everyone, why)

    def _add(self, ids, types, fresh: bool, **given) -> np.ndarray:
        """Add atoms; (n,) bool which they are."""
        n, m = len(self.ids), len(ids)
        self.ids = np.concatenate([self.ids, np.asarray(ids, np.int64)])
        self.types = np.concatenate([self.types, np.asarray(types, np.int64)])
        for p in ("charges", "molecules", "masses"):
            value = given.get(p)
            old = getattr(self, p)
            new = np.full(m, PROPERTIES[p], old.dtype) if value is None else np.asarray(value, old.dtype)
            setattr(self, p, np.concatenate([old, new]))
        x = given.get("positions")
        self.positions = np.concatenate([self.positions, np.full((m, 3), np.nan) if x is None else x])
        self.alive = np.concatenate([self.alive, np.ones(m, bool)])
        self.fresh = np.concatenate([self.fresh, np.full(m, fresh)])
        for p in PROPERTIES:
            self.unknown[p] = np.concatenate([self.unknown[p], np.zeros(m, bool)])
        for g in self.groups.values():
            g.inside, g.unsure = (np.concatenate([a, np.zeros(m, bool)]) for a in (g.inside, g.unsure))
        return np.arange(n + m) >= n

    def _add_fresh(self, why: str) -> np.ndarray:
        """The atoms of the frame that the table does not list."""
        _, found = _rows(self.ids[self.alive], self.shown_ids)
        ids = self.shown_ids[~found]
        types = np.zeros(len(ids), np.int64) if self.shown_types is None else self.shown_types[~found]
        new = self._add(ids, types, True)
        self._taint("positions", new, why)
        if self.shown_types is None or self.k < self.last_type_change:
            self._taint("types", new, f"{why}, and the frames do not show the types they had")
        return new

    def _join(self, name: str, new) -> None:
        g = self.groups.get(name)
        nobody = np.zeros(len(self.ids), bool)
        self.groups[name] = _Group(new.copy() if g is None else g.inside | new, nobody if g is None else g.unsure)

    def taint_everyone(self, what: str, why: str) -> None:
        """What is unknown of every atom, whether the table lists it or not."""
        self._taint(what, np.ones(len(self.ids), bool), why)
        self.why.setdefault(what, why)

    def change_later(self, c: Command) -> None:
        """A command behind the run, which holds for later frames: what it touches is unknown."""
        for what in touches(c):
            if what == "atoms":
                self.complete, self.may_miss = False, self.may_miss or f"{c.where}: {c.name} comes after a run"
            else:
                self.taint_everyone(
                    what, f"{c.where}: {c.name} comes after a run, and holds for the frames behind it only: say run = N in [potential]"
                )

    # What it says of frames --------------------------------------------------------------------------------------------------------------

    def has_charges(self) -> bool:
        return "charges" in self.origin.columns or bool(self.charges[self.alive].any()) or bool(self.unknown["charges"].any())

    def property_of(self, name, rows, found):
        """(n,) values of a property, and where they are known."""
        if not found.any():
            return np.full(len(rows), PROPERTIES[name]), found
        return getattr(self, name)[rows], found & ~self.unknown[name][rows]

    def mass_of(self, rows, found, types):
        """(n,) masses of atoms of a frame, and where they are known."""
        own = np.where(found, self.masses[rows] if len(self.masses) else np.nan, np.nan)
        unsure = found & self.unknown["masses"][rows] if len(self.masses) else np.zeros(len(found), bool)
        table = np.full(max(int(types.max(initial=0)), *self.type_masses, 0) + 1, np.nan)
        for t, m in self.type_masses.items():
            table[t] = m
        out = np.where(np.isfinite(own), own, table[types])
        return out, np.isfinite(out) & ~unsure

    def topology(self, frame):
        """The bonded terms that act, with those that weigh pairs beside them where they differ."""
        from ...frame import Topology

        def made(bonded, only_on):
            out = {}
            for section, (types, members) in bonded.items():
                keep = types > 0 if only_on else np.ones(len(types), bool)
                at, there = _rows(frame.ids, members[keep].ravel())
                there = there.reshape(members[keep].shape)
                if not there.all():
                    row, col = np.argwhere(~there)[0]
                    raise AtcError(
                        f"{frame.source}: atom {members[keep][row, col]} of a {section[:-1].lower()} is not in the frame; dump all bonded atoms"
                    )
                name = section.lower()
                out[name], out[f"{name[:-1]}_types"] = at.reshape(members[keep].shape), np.abs(types[keep])
            return Topology(**out)

        top = made(self.bonded, True)
        if self.weighted is not None:
            top.weighted = made(self.weighted, False)
        elif any((t <= 0).any() for t, _ in self.bonded.values()):
            top.weighted = made(self.bonded, False)
        return top

    # Choosing ----------------------------------------------------------------------------------------------------------------------------

    def _label(self, kind: str, word: str) -> str:
        return str(self.origin.labels.get(kind, {}).get(word, word))

    def _span(self, word: str, kind: str, lowest: int) -> tuple[int, float]:
        word = self._label(kind, word)
        m = re.fullmatch(r"(\d{0,18})(\*?)(\d{0,18})", word)
        if not m or not word or (not m.group(2) and m.group(3)):
            raise Trouble(f"expected a number or a range such as 2*4, got {word!r}")
        lo = int(m.group(1) or lowest)
        return lo, (lo if not m.group(2) else int(m.group(3)) if m.group(3) else np.inf)

    def _by(self, prop: str, holds) -> _Group:
        """Atoms whose property makes `holds` true."""
        values = getattr(self, prop)
        unsure = self.alive & self.unknown[prop]
        if prop == "types" and self.later:
            # Of atoms that create_atoms makes later there may be some of these types among those that are in the table already.
            for types in self.later:
                unsure = unsure | (self.alive & self.fresh & (True if types is None else np.isin(self.types, list(types))))
        return _Group(self.alive & holds(values) & ~unsure, unsure)

    def _where(self, region: str) -> _Group:
        r = self.regions.get(region, f"region {region} is not defined")
        if isinstance(r, str):
            raise Trouble(r)
        unsure = self.alive & self.unknown["positions"]
        inside = np.zeros(len(self.ids), bool)
        known = np.flatnonzero(self.alive & ~unsure)
        inside[known] = r.holds(self._wrapped(self.positions[known]))
        return _Group(inside, unsure)

    def group(self, name: str) -> _Group:
        """Who is in a group."""
        if name == "all":
            return _Group(self.alive.copy(), np.zeros(len(self.ids), bool))
        if name not in self.groups:
            raise Trouble(f"group {name} is not defined")
        g = self.groups[name]
        return _Group(g.inside & self.alive, g.unsure & self.alive)

    def _chosen(self, style: str, word: str) -> tuple[_Group, str]:
        """The atoms that ``set`` selects, and why some of them are not certain."""
        if style == "group":
            return self.group(word), self.group_why.get(word, "")
        if style == "region":
            return self._where(word), self.why.get("positions", "")
        if style not in ("atom", "type", "mol"):
            raise Trouble(f"expected atom, type, mol, group or region, got {style!r}")
        lo, hi = self._span(word, "atom" if style == "type" else "", 0 if style == "mol" else 1)
        prop = {"atom": "ids", "type": "types", "mol": "molecules"}[style]
        if prop == "ids":
            return _Group(self.alive & (self.ids >= lo) & (self.ids <= hi), np.zeros(len(self.ids), bool)), ""
        why = self.why.get(prop) or "atoms that are made later are not told apart from these"
        return self._by(prop, lambda v: (v >= lo) & (v <= hi)), why

    # Commands ----------------------------------------------------------------------------------------------------------------------------

    def _run(self, c):
        self._taint("positions", self.alive.copy(), f"atoms have moved in the run of {c.where}")

    def _boundary(self, c):
        self.boundary = boundary_words(c)

    def _change_box(self, c):
        if "boundary" in c.words:
            self.boundary = boundary_words(c)
        if {"x", "y", "z", "xy", "xz", "yz", "remap"} & set(_without_boundary(c.words[1:])):
            self.box = None
            self._taint("positions", self.alive.copy(), f"{c.where}: change_box changes the box that atoms are put into")

    def _lattice(self, c):
        self.spacing = lattice_spacing(c.words, self.origin.units, self.origin.dimension)

    def _region(self, c):
        if len(c.words) < 2:
            raise AtcError(f"{c.where}: region needs a name and a style")
        if c.words[1] == "delete":
            self.regions.pop(c.words[0], None)
            return
        self.regions[c.words[0]] = parse_region(c.words[1:], self.spacing, self._edges(), self.regions)

    def _edges(self):
        """Faces of the box; a shrink-wrapped one holds every atom."""
        if self.box is None:
            return None
        lo, hi = self.box[0].copy(), self.box[1].copy()
        for k, word in enumerate(self.boundary or ()):
            if "s" in word or "m" in word:
                lo[k], hi[k] = -1e20, 1e20
        return lo, hi

    def _create_box(self, c):
        r = self.regions.get(c.words[1] if len(c.words) > 1 else "", "the region of the box is not known")
        if isinstance(r, str) or r.style not in ("block", "prism"):
            raise Trouble(r if isinstance(r, str) else f"a box from a region of style {r.style}")
        self.box = np.array(r.numbers[0:6:2]), np.array(r.numbers[1:6:2])
        self.tilt = tuple(r.numbers[6:9]) or (0.0, 0.0, 0.0)

    def _mass(self, c):
        lo, hi = self._span(c.words[0], "atom", 1) if len(c.words) == 2 else (1, 0)
        try:
            value = float(c.words[1])
        except (IndexError, ValueError):
            raise AtcError(f"{c.where}: expected 'mass type value', got 'mass {' '.join(c.words)}'") from None
        top = max(int(self.types.max(initial=1)), *self.type_masses, 1 if hi == np.inf else int(hi))
        if self.shown_types is not None and len(self.shown_types):
            top = max(top, int(self.shown_types.max()))
        for t in range(lo, int(min(hi, top)) + 1):
            self.type_masses[t] = value

    def _labelmap(self, c):
        for number, label in zip(c.words[1::2], c.words[2::2], strict=False):
            if number.isdigit():
                self.origin.labels.setdefault(c.words[0], {})[label] = int(number)

    def _create_atoms(self, c):
        if self.complete:
            self.complete = False
        new = self._add_fresh(f"{c.where}: create_atoms makes atoms whose places are not known")
        if "mol" in c.words:
            why = f"{c.where}: create_atoms makes molecules, whose bonds and charges are not known"
            everyone = self.fresh & self.alive
            for what in ("charges", "molecules", "masses", *SECTIONS):
                self._taint(what, everyone, why)
        return new

    def _read_restart(self, c):
        self.complete = False
        new = self._add_fresh(f"{c.where}: atoms come from a restart file")
        for what in (*PROPERTIES, *SECTIONS):
            if what != "types":
                self._taint(what, new, f"{c.where}: atoms come from a restart file, which is not read")

    def _read_dump(self, c):
        why = f"{c.where}: read_dump brings positions from a file that is not read"
        self._taint("positions", self.alive.copy(), why)
        if "q" in c.words:
            self._taint("charges", self.alive.copy(), why)
        if {"add", "purge", "trim"} & set(c.words):
            raise Trouble("atoms are added or taken away as a file says that is not read")

    def _set(self, c):
        keywords = set_keywords(c)
        if not touches(c):
            return
        chosen, why = self._chosen(*c.words[:2])
        for key, values in keywords:
            what = SET.get(key, (0, ""))[1]
            if what in SECTIONS:
                self._set_bonded(what, key, values[0], chosen, c, why)
            elif what:
                self._set_property(what, key, values, chosen, c, why)
                if what == "types":
                    self._settle_types(self.k)
                    chosen, why = chosen, why

    def _set_property(self, what, key, values, chosen, c, why):
        some = chosen.inside | chosen.unsure
        if key in _RANDOM:
            self._taint(what, some, f"{c.where}: set {key} chooses atoms at random")
            return
        try:
            value = float(self._label("atom", values[0]) if what == "types" else values[0])
        except ValueError:
            self._taint(what, some, f"{c.where}: set {key} {values[0]}: the value of every atom is not known")
            return
        if key in ("density", "density/disc", "smd/mass/density"):
            self._taint(what, some, f"{c.where}: set {key}: masses follow from the sizes of atoms")
            return
        a = getattr(self, what)
        if what == "positions":
            a[chosen.inside, "xyz".index(key)] = value
        else:
            a[chosen.inside] = value
            self.unknown[what] = self.unknown[what] & ~chosen.inside
        if chosen.unsure.any():
            self._taint(what, chosen.unsure, f"{c.where}: which atoms 'set {' '.join(c.words[:2])}' means is not known: {why}")

    def _set_bonded(self, section, key, value, chosen, c, why):
        types, members = self.bonded[section]
        label = self._label(key, value)
        if not label.lstrip("-").isdigit():
            raise Trouble(f"set {key} {value}: expected a type")
        inside, unsure = self._of(members, chosen)
        types[inside.all(1)] = int(label)
        if (unsure.any(1) & (inside | unsure).all(1)).any():
            self._taint(section, None, f"{c.where}: which {section.lower()} 'set {' '.join(c.words[:2])}' means is not known: {why}")

    def _of(self, members, g: _Group):
        """(m, k) bool: which members are in a group, and of which this is not known."""
        rows, found = _rows(self.ids, members.ravel(), self.alive)
        return ((g.inside[rows] & found).reshape(members.shape), (g.unsure[rows] & found).reshape(members.shape))

    # Groups

    def _group(self, c):
        name, style, args = (*c.words[:2], c.words[2:]) if len(c.words) > 1 else ("", "", ())
        if not style:
            raise AtcError(f"{c.where}: group needs a name and a style")
        nobody = np.zeros(len(self.ids), bool)
        if style == "delete":
            self.groups.pop(name, None)
            self.group_why.pop(name, None)
            return
        if style in ("clear", "empty"):
            self.groups[name] = _Group(nobody, nobody.copy())
            self.group_why.pop(name, None)
            return
        if style == "static":
            return
        old = self.groups.get(name, _Group(nobody, nobody))
        new, why = self._members(style, args, name, old)
        self.groups[name] = _Group(old.inside | new.inside, (old.unsure | new.unsure) & ~(old.inside | new.inside))
        if new.unsure.any() and why:
            self.group_why.setdefault(name, f"{c.where}: group {name} {style}: {why}")

    def _members(self, style, args, name, old):
        if style == "region":
            return self._where(args[0] if args else ""), self.why.get("positions", "")
        if style in ("type", "id", "molecule"):
            prop = {"type": "types", "id": "ids", "molecule": "molecules"}[style]
            holds = self._listed(args, style)
            if prop == "ids":
                return _Group(self.alive & holds(self.ids), np.zeros(len(self.ids), bool)), ""
            return self._by(prop, holds), self.why.get(prop) or "atoms that are made later are not told apart from these"
        if style == "include" and args[:1] == ("molecule",):
            ids = np.unique(self.molecules[old.inside])
            g = self._by("molecules", lambda v: np.isin(v, ids[ids != 0]))
            return _Group(g.inside, g.unsure | (self.alive & old.unsure.any())), self.why.get("molecules", "")
        if style in ("subtract", "union", "intersect"):
            parts = [self.group(w) for w in args]
            why = next((self.group_why[w] for w in args if w in self.group_why), "")
            if not parts:
                raise Trouble(f"group {style} needs groups")
            inside, unsure = parts[0].inside, parts[0].unsure
            for p in parts[1:]:
                maybe = inside | unsure
                if style == "union":
                    inside = inside | p.inside
                    unsure = (unsure | p.unsure) & ~inside
                elif style == "intersect":
                    inside, unsure = inside & p.inside, maybe & (p.inside | p.unsure) & ~(inside & p.inside)
                else:
                    inside, unsure = inside & ~(p.inside | p.unsure), maybe & ~p.inside & ~(inside & ~(p.inside | p.unsure))
            return _Group(inside, unsure), why
        raise Trouble("its members change as the run goes" if style == "dynamic" else f"group {style} depends on what the run computes")

    def _listed(self, args, kind):
        """A test of numbers from ``1 2 4:8:2`` or ``<= 5`` or ``<> 3 7``."""
        tests = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal, "!=": np.not_equal}
        label = "atom" if kind == "type" else ""
        try:
            if args[:1] and args[0] in tests:
                value = int(self._label(label, args[1]))
                return lambda v: tests[args[0]](v, value)
            if args[:1] == ("<>",):
                lo, hi = (int(self._label(label, w)) for w in args[1:3])
                return lambda v: (v >= lo) & (v <= hi)
            spans = []
            for w in args:
                parts = (
                    [int(self._label(label, p)) for p in w.split(":")]
                    if w not in self.origin.labels.get(label, {})
                    else [int(self._label(label, w))]
                )
                lo, hi, step = (*parts, 1) if len(parts) == 2 else (parts[0], parts[0], 1) if len(parts) == 1 else parts
                spans.append((lo, hi, max(step, 1)))
        except (ValueError, IndexError):
            raise Trouble(f"expected numbers such as 1 2 4:8, or '<= 5', got {' '.join(args)!r}") from None
        return lambda v: np.any(
            [(v >= lo) & (v <= hi) & ((v - lo) % step == 0) for lo, hi, step in spans] or [np.zeros(len(v), bool)], axis=0
        )

    # Bonds

    def _delete_bonds(self, c):
        if len(c.words) < 2:
            raise AtcError(f"{c.where}: expected 'delete_bonds group style ...'")
        style, k = c.words[1], 2
        chosen = self.group(c.words[0])
        sections = {"bond": ["Bonds"], "angle": ["Angles"], "dihedral": ["Dihedrals"], "improper": ["Impropers"]}.get(style, list(SECTIONS))
        if style not in ("multi", "atom", "stats", "bond", "angle", "dihedral", "improper"):
            raise AtcError(f"{c.where}: delete_bonds {style}: expected multi, atom, bond, angle, dihedral, improper or stats")
        lo, hi = 0, np.inf
        if style not in ("multi", "stats"):
            lo, hi = self._span(c.words[2] if len(c.words) > 2 else "", style, 0)
            k = 3
        flags = set(c.words[k:])
        if flags - {"any", "undo", "remove", "special"}:
            raise AtcError(f"{c.where}: delete_bonds: expected any, undo, remove, special, got {' '.join(c.words[k:])}")
        why = f"{c.where}: which {{}} are switched off is not known: {self.group_why.get(c.words[0], '')}"
        for s in sections if style != "stats" else []:
            types, members = self.bonded[s]
            inside, unsure = self._of(members, chosen)
            here = inside.any(1) if "any" in flags else inside.all(1)
            maybe = ((inside | unsure).any(1) if "any" in flags else (inside | unsure).all(1)) & ~here
            if style == "atom":
                typed = self._by("types", lambda v: (v >= lo) & (v <= hi))
                a, b = (m.any(1) for m in self._of(members, typed))
                here, maybe = here & a, (here & b & ~a) | (maybe & (a | b))
            elif style != "multi":
                listed = (np.abs(types) >= lo) & (np.abs(types) <= hi)
                here, maybe = here & listed, maybe & listed
            if maybe.any():
                self._taint(s, None, why.format(s.lower()))
            types[here] = np.abs(types[here]) if "undo" in flags else -np.abs(types[here])
        if "remove" in flags:
            # Pairs stay weighted as if the bonds were there, until `special` counts them anew.
            self._keep_weights()
            for s in sections if style != "stats" else []:
                types, members = self.bonded[s]
                self.bonded[s] = types[types > 0], members[types > 0]
        if "special" in flags:
            self.weighted = None

    def _keep_weights(self):
        if self.weighted is None:
            self.weighted = {s: (t.copy(), m.copy()) for s, (t, m) in self.bonded.items()}

    def _create_bonds(self, c):
        style = c.words[0] if c.words else ""
        section = {"single/bond": "Bonds", "single/angle": "Angles", "single/dihedral": "Dihedrals", "single/improper": "Impropers"}.get(
            style
        )
        if section is None:
            raise Trouble(f"create_bonds {style or 'without a style'} chooses pairs by distance")
        width = SECTIONS[section]
        label = self._label(style.split("/")[1], c.words[1] if len(c.words) > 1 else "")
        try:
            t, ids = int(label), [int(w) for w in c.words[2 : 2 + width]]
        except ValueError:
            ids = []
        if len(ids) != width:
            raise AtcError(f"{c.where}: create_bonds {style}: expected a type and {width} atoms, got {' '.join(c.words[1:])}")
        if c.words[2 + width :] == ("special", "no"):
            self._keep_weights()
        else:
            self.weighted = None
        types, members = self.bonded[section]
        self.bonded[section] = np.append(types, t), np.concatenate([members, [ids]])

    # Atoms that go, and new numbers

    def _delete_atoms(self, c):
        style, k = (c.words[0] if c.words else ""), 2
        options = dict(zip(c.words[-6::2], c.words[-5::2], strict=False)) if len(c.words) > 2 else {}
        options = {key: value for key, value in options.items() if key in ("compress", "bond", "mol")}
        if style == "group":
            gone, why = self.group(c.words[1] if len(c.words) > 1 else ""), self.group_why.get(c.words[1] if len(c.words) > 1 else "", "")
        elif style == "region":
            gone, why = self._where(c.words[1] if len(c.words) > 1 else ""), self.why.get("positions", "")
        else:
            gone, why = (
                _Group(np.zeros(len(self.ids), bool), self.alive.copy()),
                f"delete_atoms {style} chooses atoms by distance or at random",
            )
        options = dict(zip(c.words[k::2], c.words[k + 1 :: 2], strict=False)) if style in ("group", "region") else options
        inside, unsure = gone.inside, gone.unsure
        if options.get("mol") == "yes":
            ids = np.unique(self.molecules[inside])
            inside = inside | (self.alive & np.isin(self.molecules, ids[ids != 0]))
            unsure = unsure | (self.alive & (unsure.any() | self.unknown["molecules"]))
        unsure = unsure & ~inside
        if unsure.any():
            # Those that are left are in the frame.
            _, found = _rows(self.shown_ids, self.ids)
            if options.get("compress", "yes") == "yes" and not self._molecular():
                self.complete = False
            else:
                inside = inside | (unsure & ~found)
            self.may_miss = self.may_miss or f"{c.where}: {why}"
        self.alive = self.alive & ~inside
        if options.get("bond") == "yes":
            for s in SECTIONS:
                types, members = self.bonded[s]
                _, found = _rows(self.ids, members.ravel(), self.alive)
                keep = found.reshape(members.shape).all(1)
                self.bonded[s] = types[keep], members[keep]
            self.weighted = None
        if options.get("compress", "yes") == "yes" and not self._molecular():
            self._renumber(f"{c.where}: delete_atoms gives atoms new numbers (compress no keeps them)")

    def _molecular(self) -> bool:
        return bool(_MOLECULAR & set(self.origin.atom_style))

    def _renumber(self, why: str):
        """Atoms lose their numbers: what is the same for all atoms of a type is still known, by the types that the frames show."""
        kept = {}
        for p in ("charges", "molecules", "masses"):
            values = getattr(self, p)
            sure = self.alive & ~self.unknown[p] & ~self.unknown["types"]
            kept[p] = {}
            for t in np.unique(self.types[self.alive & ~self.unknown["types"]]):
                mine = sure & (self.types == t)
                if (
                    mine.sum() == (self.alive & (self.types == t)).sum()
                    and len(np.unique(values[mine])) == 1
                    and not self.unknown["types"][self.alive].any()
                ):
                    kept[p][int(t)] = values[mine][0]
        groups = {
            name: {int(t): bool(g.inside[self.alive & (self.types == t)].all()) for t in np.unique(self.types[self.alive])
                   if len(np.unique(g.inside[self.alive & (self.types == t)])) == 1 and not g.unsure[self.alive].any()}
            for name, g in self.groups.items()
        }  # fmt: skip
        self.ids = self.ids[:0]
        for p in PROPERTIES:
            setattr(self, p, getattr(self, p)[:0])
            self.unknown[p] = self.unknown[p][:0]
        self.alive, self.fresh = self.alive[:0], self.fresh[:0]
        for g in self.groups.values():
            g.inside, g.unsure = g.inside[:0], g.unsure[:0]
        new = self._add_fresh(why)
        self.complete = False
        for p, by_type in kept.items():
            a = getattr(self, p)
            for t, value in by_type.items():
                a[new & (self.types == t)] = value
            self._taint(p, new & ~np.isin(self.types, list(by_type)), why)
            if self.unknown["types"].any():
                self._taint(p, new, why)
        for name, by_type in groups.items():
            g = self.groups[name]
            g.inside = np.isin(self.types, [t for t, inside in by_type.items() if inside])
            g.unsure = ~np.isin(self.types, list(by_type)) | self.unknown["types"]
            if g.unsure.any():
                self.group_why.setdefault(name, why)
        if any(len(t) for t, _ in self.bonded.values()):
            for s in SECTIONS:
                self._taint(s, None, why)

    def _reset_atom_ids(self, c):
        self._renumber(f"{c.where}: {c.name} gives atoms new numbers")

    _reset_ids = _reset_atom_ids

    def _reset_atoms(self, c):
        what = c.words[0] if c.words else ""
        if what == "id":
            self._reset_atom_ids(c)
        elif what == "mol":
            self._reset_mol_ids(c)
        elif what != "image":
            raise AtcError(f"{c.where}: expected 'reset_atoms id', 'image' or 'mol'")

    def _reset_mol_ids(self, c):
        self._taint("molecules", self.alive.copy(), f"{c.where}: {c.name} numbers molecules anew")

    # Places

    def _displace_atoms(self, c):
        if len(c.words) < 5:
            raise AtcError(f"{c.where}: expected 'displace_atoms group style ...'")
        g = self.group(c.words[0])
        box = "box" in c.words[5:]
        if c.words[1] != "move" or (not box and self.spacing is None):
            self._taint("positions", g.inside | g.unsure, f"{c.where}: displace_atoms {c.words[1]} moves atoms")
            return
        try:
            move = np.array([float(w) for w in c.words[2:5]]) * (1.0 if box else self.spacing)
        except ValueError:
            raise Trouble(f"displace_atoms move {' '.join(c.words[2:5])}: expected three numbers") from None
        self.positions[g.inside] += move
        self._taint("positions", g.unsure, f"{c.where}: displace_atoms moves atoms")

    def _wrapped(self, x):
        """Positions in the box, along its periodic edges."""
        if self.box is None or not len(x):
            return x
        lo, hi = self.box
        edges = self._box_edges()
        periodic = np.array([w in ("p", "pp") for w in self.boundary or ("p", "p", "p")])
        s = (x - lo) @ np.linalg.inv(edges)
        shift = np.where(periodic, np.floor(s), 0.0)
        return np.where(shift.any(1)[:, None], x - shift @ edges, x)

    def _box_edges(self):
        """(3, 3) rows a, b, c."""
        (xy, xz, yz), (lx, ly, lz) = self.tilt, self.box[1] - self.box[0]
        return np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]])

    def _replicate(self, c):
        """Copies of the box along x, then y, then z; those of an atom have its number and molecule plus a multiple of the largest there is."""
        if not self.complete or self.box is None or self.unknown["types"].any():
            raise Trouble("copies are made of atoms that are not known")
        try:
            counts = [int(w) for w in c.words[:3]]
        except ValueError:
            counts = []
        if len(counts) != 3 or min(counts) < 1 or set(c.words[3:]) - {"bbox"}:
            raise Trouble(f"replicate {' '.join(c.words)}: copies along periodic bonds, or none, are not made")
        here = self.alive
        if here.sum() * int(np.prod(counts)) > _MOST_ATOMS:
            raise Trouble("there are too many copies")
        edges = self._box_edges()
        top, molecule = int(self.ids[here].max(initial=0)), int(self.molecules[here].max(initial=0))
        copies = int(np.prod(counts))
        kept = {p: np.tile(getattr(self, p)[here], (copies - 1,) + (1,) * (p == "positions")) for p in PROPERTIES}
        m = np.repeat(np.arange(1, copies), here.sum())
        shift = np.stack([m % counts[0], m // counts[0] % counts[1], m // (counts[0] * counts[1])], axis=1) @ edges
        old = {p: np.tile(self.unknown[p][here], copies - 1) for p in PROPERTIES}
        groups = {n: [np.tile(a[here], copies - 1) for a in (g.inside, g.unsure)] for n, g in self.groups.items()}
        new = self._add(
            np.tile(self.ids[here], copies - 1) + m * top, kept["types"], False, charges=kept["charges"], masses=kept["masses"],
            molecules=kept["molecules"] + m * molecule, positions=kept["positions"] + shift,
        )  # fmt: skip
        for p in PROPERTIES:
            self.unknown[p][new] = old[p]
        for name, (inside, unsure) in groups.items():
            self.groups[name].inside[new], self.groups[name].unsure[new] = inside, unsure
        for bonded in (self.bonded, self.weighted or {}):
            for s, (types, members) in bonded.items():
                bonded[s] = np.tile(types, copies), np.concatenate([members + k * top for k in range(copies)])
        lo, hi = self.box
        self.box = lo, lo + (hi - lo) * counts
        self.tilt = tuple(t * counts[1 if k == 0 else 2] for k, t in enumerate(self.tilt))

    def _ndx2group(self, c):
        raise Trouble("groups come from a file that is not read")

    # Data files

    def _read_data(self, c):
        from .read_data import read_data

        read_data(self, c)


def _rows(ids, wanted, alive=None):
    """Row in `ids` of each wanted id (0 where there is none), and whether there is one."""
    if not len(ids):
        return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
    order = np.argsort(ids, kind="stable") if alive is None else np.flatnonzero(alive)[np.argsort(ids[alive], kind="stable")]
    if not len(order):
        return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
    sorted_ids = ids[order]
    at = np.minimum(np.searchsorted(sorted_ids, wanted), len(order) - 1)
    return order[at], sorted_ids[at] == wanted
