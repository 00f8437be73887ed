"""LAMMPS's ``delete_bonds`` and ``create_bonds`` on the table of atoms.

Bonds of negative type are switched off, which leaves the weights of pairs (1-2, 1-3, 1-4) as they were; so does
``remove`` unless ``special`` is said.
"""

from __future__ import annotations

import numpy as np

from .atom_commands import SECTIONS
from .atom_table import AtomTable
from .regions import Trouble


class Bonds(AtomTable):
    """Bonds, angles, dihedrals and impropers that are switched off and on, or made."""

    def _delete_bonds(self, c):
        if len(c.words) < 2:
            raise c.error("expected 'delete_bonds group style ...'")
        style, k = c.words[1], 2
        chosen = self.group(c.words[0])
        sections = [s for s in SECTIONS if s[:-1].lower() == style] or list(SECTIONS)
        if style not in ("multi", "atom", "stats", "bond", "angle", "dihedral", "improper"):
            raise c.error(f"delete_bonds {style}: expected multi, atom, bond, angle, dihedral, improper or stats")
        lo, hi = 0, np.inf
        if style not in ("multi", "stats"):
            lo, hi = self._span(c.words[2] if len(c.words) > 2 else "", style, 0)
            k = 3
        flags = set(c.words[k:])
        if flags - {"any", "undo", "remove", "special"}:
            raise c.error(f"delete_bonds: expected any, undo, remove, special, got {' '.join(c.words[k:])}")
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
        section = {f"single/{s[:-1].lower()}": s for s in SECTIONS}.get(style)
        if section is None:
            raise Trouble(f"create_bonds {style or 'without a style'} chooses pairs by distance")
        width = SECTIONS[section]
        label = self._label(style.split("/")[1], c.words[1] if len(c.words) > 1 else "")
        try:
            t, ids = int(label), [int(w) for w in c.words[2 : 2 + width]]
        except ValueError:
            ids = []
        if len(ids) != width:
            raise c.error(f"create_bonds {style}: expected a type and {width} atoms, got {' '.join(c.words[1:])}")
        if c.words[2 + width :] == ("special", "no"):
            self._keep_weights()
        else:
            self.weighted = None
        types, members = self.bonded[section]
        self.bonded[section] = np.append(types, t), np.concatenate([members, [ids]])
