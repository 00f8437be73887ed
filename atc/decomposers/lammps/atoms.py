"""The atoms of a LAMMPS script: what its commands make of those of the data file before the run starts.

Commands are carried out on a table of atoms. What cannot be known (random choices, positions of atoms that
``create_atoms`` made, what a run moved) is marked as unknown, atom by atom and property by property, with the reason:
it matters only where it is needed and the frames do not show it.
"""

from __future__ import annotations

import numpy as np

from .atom_commands import PROPERTIES, RANDOM, SECTIONS, SET, boundary_words, set_keywords, touches, without_boundary
from .atom_table import rows_of
from .bond_commands import Bonds
from .group_command import Groups
from .place_commands import Places
from .read_data import read_data
from .regions import Trouble, lattice_spacing, parse_region


class Atoms(Groups, Bonds, Places):
    """The table (see `AtomTable`) with every command that LAMMPS has for atoms."""

    # Carrying out
    # ------------------------------------------------------------------------------------------------------------------

    def carry_out(self, commands) -> Atoms:
        """Carry out the commands, in order."""
        self.last_type_change = max(
            (k for k, c in enumerate(commands) if c.name == "set" and "types" in touches(c)), default=-1
        )
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
            rows, found = rows_of(self.shown_ids, self.ids)
            take = self.unknown["types"] & found
            self.types = np.where(take, self.shown_types[rows], self.types)
            self.unknown["types"] = self.unknown["types"] & ~take

    # Commands
    # ------------------------------------------------------------------------------------------------------------------

    def _run(self, c):
        self._taint("positions", self.alive.copy(), f"atoms have moved in the run of {c.where}")

    def _boundary(self, c):
        self.boundary = boundary_words(c)

    def _change_box(self, c):
        if "boundary" in c.words:
            self.boundary = boundary_words(c)
        if {"x", "y", "z", "xy", "xz", "yz", "remap"} & set(without_boundary(c.words[1:])):
            self.box = None
            why = f"{c.where}: change_box changes the box that atoms are put into"
            self._taint("positions", self.alive.copy(), why)

    def _lattice(self, c):
        self.spacing = lattice_spacing(c.words, self.origin.units, self.origin.dimension)

    def _region(self, c):
        if len(c.words) < 2:
            raise c.error("region needs a name and a style")
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
        self.n_types = max(self.n_types, int(c.words[0]) if c.words[:1] and c.words[0].isdigit() else 2)
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
            raise c.error(f"expected 'mass type value', got 'mass {' '.join(c.words)}'") from None
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
        self.complete = False
        self._add_fresh(f"{c.where}: create_atoms makes atoms whose places are not known")
        if "mol" in c.words:
            why = f"{c.where}: create_atoms makes molecules, whose bonds and charges are not known"
            everyone = self.fresh & self.alive
            for what in ("charges", "molecules", "masses", *SECTIONS):
                self._taint(what, everyone, why)

    def _read_restart(self, c):
        self.complete, self.n_types = False, 2
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

    def _set_property(self, what, key, values, chosen, c, why):
        some = chosen.inside | chosen.unsure
        if key in RANDOM:
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
            why = f"{c.where}: which atoms 'set {' '.join(c.words[:2])}' means is not known: {why}"
            self._taint(what, chosen.unsure, why)

    def _set_bonded(self, section, key, value, chosen, c, why):
        types, members = self.bonded[section]
        label = self._label(key, value)
        if not label.lstrip("-").isdigit():
            raise Trouble(f"set {key} {value}: expected a type")
        inside, unsure = self._of(members, chosen)
        types[inside.all(1)] = int(label)
        if (unsure.any(1) & (inside | unsure).all(1)).any():
            meant = f"which {section.lower()} 'set {' '.join(c.words[:2])}' means"
            self._taint(section, None, f"{c.where}: {meant} is not known: {why}")

    def _read_data(self, c):
        read_data(self, c)
