"""LAMMPS's commands that take atoms away, number them anew, copy and move them."""

from __future__ import annotations

import numpy as np

from .atom_commands import PROPERTIES, SECTIONS, periodic_axes
from .atom_table import AtomTable, Group, rows_of
from .regions import Trouble

#: Copies of atoms that ``replicate`` makes here, at most.
_MOST_ATOMS = 50_000_000


class Places(AtomTable):
    """``delete_atoms``, ``reset_atoms``, ``displace_atoms``, ``replicate``, and the box that atoms are put into."""

    def _delete_atoms(self, c):
        style, which = (*c.words, "", "")[:2]
        options = dict(zip(c.words[2::2], c.words[3::2], strict=False))
        if style in ("group", "region"):
            gone, why = self._chosen(style, which)
        else:
            gone = Group(np.zeros(len(self.ids), bool), self.alive.copy())
            why = f"delete_atoms {style} chooses atoms by distance or at random"
            last = dict(zip(c.words[-6::2], c.words[-5::2], strict=False)) if len(c.words) > 2 else {}
            options = {key: value for key, value in last.items() if key in ("compress", "bond", "mol")}
        inside, unsure = gone.inside, gone.unsure
        if options.get("mol") == "yes":
            ids = np.unique(self.molecules[inside])
            inside = inside | (self.alive & np.isin(self.molecules, ids[ids != 0]))
            unsure = unsure | (self.alive & (unsure.any() | self.unknown["molecules"]))
        unsure = unsure & ~inside
        if unsure.any():
            # Those that are left are in the frame.
            _, found = rows_of(self.shown_ids, self.ids)
            if not self._keeps_ids(c):
                self.complete = False
            else:
                inside = inside | (unsure & ~found)
            self.may_miss = self.may_miss or f"{c.where}: {why}"
        self.alive = self.alive & ~inside
        # Terms go with the atoms that have them; bond yes takes those of the atoms that stay, too.
        whole = options.get("bond") == "yes"
        for bonded in (self.bonded, None if whole else self.weighted):
            for s in SECTIONS if bonded is not None else ():
                types, members = bonded[s]
                _, found = rows_of(self.ids, members.ravel(), self.alive)
                found = found.reshape(members.shape)
                keep = found.all(1) if whole else found.any(1)
                bonded[s] = types[keep], members[keep]
        if whole:
            self.weighted = None
        if not self._keeps_ids(c):
            self._renumber(f"{c.where}: delete_atoms gives atoms new numbers (compress no keeps them)")

    def _renumber(self, why: str):
        """Atoms lose their numbers: what is the same for all atoms of a type is still known, by the types that the
        frames show."""
        kept = {}
        for p in ("charges", "molecules", "masses"):
            values = getattr(self, p)
            sure = self.alive & ~self.unknown[p] & ~self.unknown["types"]
            kept[p] = {}
            for t in np.unique(self.types[self.alive & ~self.unknown["types"]]):
                mine = sure & (self.types == t)
                all_of_them = mine.sum() == (self.alive & (self.types == t)).sum()
                certain = all_of_them and not self.unknown["types"][self.alive].any()
                if certain and len(np.unique(values[mine])) == 1:
                    kept[p][int(t)] = values[mine][0]
        groups = {
            name: {
                int(t): bool(g.inside[self.alive & (self.types == t)].all())
                for t in np.unique(self.types[self.alive])
                if len(np.unique(g.inside[self.alive & (self.types == t)])) == 1 and not g.unsure[self.alive].any()
            }
            for name, g in self.groups.items()
        }
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
            raise c.error("expected 'reset_atoms id', 'image' or 'mol'")

    def _reset_mol_ids(self, c):
        self._taint("molecules", self.alive.copy(), f"{c.where}: {c.name} numbers molecules anew")

    # Places

    def _displace_atoms(self, c):
        if len(c.words) < 5:
            raise c.error("expected 'displace_atoms group style ...'")
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
        periodic = np.array(periodic_axes(self.boundary or "ppp"))
        s = (x - lo) @ np.linalg.inv(edges)
        shift = np.where(periodic, np.floor(s), 0.0)
        return np.where(shift.any(1)[:, None], x - shift @ edges, x)

    def _box_edges(self):
        """(3, 3) rows a, b, c."""
        (xy, xz, yz), (lx, ly, lz) = self.tilt, self.box[1] - self.box[0]
        return np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]])

    def _replicate(self, c):
        """Copies of the box along x, then y, then z; those of an atom have its number and molecule plus a multiple of
        the largest there is."""
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
        kept["molecules"] += m * molecule
        kept["positions"] += shift
        new = self._add(np.tile(self.ids[here], copies - 1) + m * top, kept.pop("types"), False, **kept)
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
