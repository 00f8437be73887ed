"""A table of atoms of which some properties may be unknown, with the reason; and who of them is meant."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import AtcError
from .atom_commands import MOLECULAR, PROPERTIES, SECTIONS, touches
from .regions import Region, Trouble
from .script import Command, span_of


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
class Group:
    inside: np.ndarray
    unsure: np.ndarray


class AtomTable:
    """The table, as commands change it.

    Parameters
    ----------
    origin : Origin
    shown_ids, shown_types : ids and types of the atoms of a frame: the atoms that no data file lists are among them;
        types None if the frame has none

    Attributes
    ----------
    ids, types, charges, molecules, masses, positions : (n,) and (n, 3), in the script's own units; masses are NaN where
        the type's holds
    unknown : {property: (n,) bool}. why : {property, section or "ids": reason}
    alive : (n,) bool, atoms that are still there
    bonded : {section: (types (m,), members (m, k))}, members by id. weighted : the same for special bonds where they
        differ, or None
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
        self.groups: dict[str, Group] = {}
        self.group_why: dict[str, str] = {}
        self.bonded = {s: (np.zeros(0, np.int64), np.zeros((0, k), np.int64)) for s, k in SECTIONS.items()}
        self.weighted = None
        self.type_masses: dict[int, float] = {}
        self.regions: dict[str, Region | str] = {}
        self.spacing, self.box, self.boundary = np.ones(3), None, None
        self.tilt = (0.0, 0.0, 0.0)
        self.files: list[Path] = []
        self.may_miss = ""
        self.n_types = 0  # as far as boxes and data files say
        self.complete = True  # whether every atom of the run is known to be in the table
        self.last_type_change = -1

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
            g = self.groups.setdefault(name, Group(np.zeros(len(self.ids), bool), np.zeros(len(self.ids), bool)))
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
        _, found = rows_of(self.ids[self.alive], self.shown_ids)
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
        self.groups[name] = Group(new.copy() if g is None else g.inside | new, nobody if g is None else g.unsure)

    def taint_everyone(self, what: str, why: str) -> None:
        """What is unknown of every atom, whether the table lists it or not."""
        self._taint(what, np.ones(len(self.ids), bool), why)
        self.why.setdefault(what, why)

    def change_later(self, c: Command) -> None:
        """A command behind the run, which holds for later frames: what it touches is unknown."""
        later = (
            f"{c.where}: {c.name} comes after a run, and holds for the frames behind it only: say run = N in "
            "[potential]"
        )
        if c.name == "group":
            nobody = np.zeros(len(self.ids), bool)
            for name in c.words[:1]:
                self.groups.setdefault(name, Group(nobody, nobody)).unsure = ~nobody
                self.group_why.setdefault(name, later)
        for what in touches(c):
            if what == "ids":
                if not (c.name == "delete_atoms" and self._keeps_ids(c)):
                    for p in ("charges", "molecules", "masses", *SECTIONS):
                        self.taint_everyone(p, f"{c.where}: {c.name} gives atoms new numbers after a run")
            elif what == "atoms":
                self.complete, self.may_miss = False, self.may_miss or f"{c.where}: {c.name} comes after a run"
            else:
                self.taint_everyone(what, later)

    def _keeps_ids(self, c: Command) -> bool:
        """Whether a ``delete_atoms`` command leaves the atoms their numbers: those of molecules do, and ``compress
        no``."""
        options = dict(zip(c.words, c.words[1:], strict=False))
        return options.get("compress", "yes") == "no" or bool(MOLECULAR & set(self.origin.atom_style))

    # What it says of frames
    # --------------------------------------------------------------------------------------------------------------

    def has_charges(self) -> bool:
        some = self.charges[self.alive].any() or self.unknown["charges"].any()
        return "charges" in self.origin.columns or bool(some)

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
                at, there = rows_of(frame.ids, members[keep].ravel())
                there = there.reshape(members[keep].shape)
                if not there.all():
                    row, col = np.argwhere(~there)[0]
                    raise AtcError(
                        f"{frame.source}: atom {members[keep][row, col]} of a {section[:-1].lower()} is not in the "
                        "frame; dump all bonded atoms"
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

    # Choosing
    # ------------------------------------------------------------------------------------------------------------------

    def _label(self, kind: str, word: str) -> str:
        return str(self.origin.labels.get(kind, {}).get(word, word))

    def _span(self, word: str, kind: str, lowest: int) -> tuple[int, float]:
        word = self._label(kind, word)
        span = span_of(word, lowest)
        if span is None:
            raise Trouble(f"expected a number or a range such as 2*4, got {word!r}")
        return span[0], np.inf if span[1] is None else span[1]

    def _by(self, prop: str, holds) -> Group:
        """Atoms whose property makes `holds` true."""
        values = getattr(self, prop)
        unsure = self.alive & self.unknown[prop]
        if prop == "types" and self.later:
            # Of atoms that create_atoms makes later there may be some of these types among those that are in the table
            # already.
            for types in self.later:
                some = True if types is None else np.isin(self.types, list(types))
                unsure = unsure | (self.alive & self.fresh & some)
        return Group(self.alive & holds(values) & ~unsure, unsure)

    def _where(self, region: str) -> Group:
        r = self.regions.get(region, f"region {region} is not defined")
        if isinstance(r, str):
            raise Trouble(r)
        unsure = self.alive & self.unknown["positions"]
        inside = np.zeros(len(self.ids), bool)
        known = np.flatnonzero(self.alive & ~unsure)
        inside[known] = r.holds(self._wrapped(self.positions[known]))
        return Group(inside, unsure)

    def group(self, name: str) -> Group:
        """Who is in a group."""
        if name == "all":
            return Group(self.alive.copy(), np.zeros(len(self.ids), bool))
        if name not in self.groups:
            raise Trouble(f"group {name} is not defined")
        g = self.groups[name]
        return Group(g.inside & self.alive, g.unsure & self.alive)

    def _chosen(self, style: str, word: str) -> tuple[Group, str]:
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
            return Group(self.alive & (self.ids >= lo) & (self.ids <= hi), np.zeros(len(self.ids), bool)), ""
        return self._by(prop, lambda v: (v >= lo) & (v <= hi)), self._why_of(prop)

    def _why_of(self, prop: str) -> str:
        """Why it is not certain which atoms have a value of a property."""
        return self.why.get(prop) or "atoms that are made later are not told apart from these"

    def _of(self, members, g: Group):
        """(m, k) bool: which members are in a group, and of which this is not known."""
        rows, found = rows_of(self.ids, members.ravel(), self.alive)
        return ((g.inside[rows] & found).reshape(members.shape), (g.unsure[rows] & found).reshape(members.shape))


def rows_of(ids, wanted, alive=None):
    """Row in `ids` of each wanted id (0 where there is none), and whether there is one."""
    alive = np.ones(len(ids), bool) if alive is None else alive
    order = np.flatnonzero(alive)[np.argsort(ids[alive], kind="stable")]
    if not len(order):
        return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
    sorted_ids = ids[order]
    at = np.minimum(np.searchsorted(sorted_ids, wanted), len(order) - 1)
    return order[at], sorted_ids[at] == wanted
