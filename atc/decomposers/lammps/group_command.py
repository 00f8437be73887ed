"""LAMMPS's ``group`` command on the table of atoms."""

from __future__ import annotations

import numpy as np

from .atom_table import AtomTable, Group
from .regions import Trouble


class Groups(AtomTable):
    """Groups: by type, number, molecule, region, and of other groups."""

    def _group(self, c):
        name, style, args = (*c.words[:2], c.words[2:]) if len(c.words) > 1 else ("", "", ())
        if not style:
            raise c.error("group needs a name and a style")
        nobody = np.zeros(len(self.ids), bool)
        if style == "delete":
            self.groups.pop(name, None)
            self.group_why.pop(name, None)
            return
        if style in ("clear", "empty"):
            self.groups[name] = Group(nobody, nobody.copy())
            self.group_why.pop(name, None)
            return
        if style == "static":
            return
        old = self.groups.get(name, Group(nobody, nobody))
        new, why = self._members(style, args, name, old)
        self.groups[name] = Group(old.inside | new.inside, (old.unsure | new.unsure) & ~(old.inside | new.inside))
        if new.unsure.any() and why:
            self.group_why.setdefault(name, f"{c.where}: group {name} {style}: {why}")

    def _members(self, style, args, name, old):
        if style == "region":
            return self._where(args[0] if args else ""), self.why.get("positions", "")
        if style in ("type", "id", "molecule"):
            prop = {"type": "types", "id": "ids", "molecule": "molecules"}[style]
            holds = self._listed(args, style)
            if prop == "ids":
                return Group(self.alive & holds(self.ids), np.zeros(len(self.ids), bool)), ""
            return self._by(prop, holds), self._why_of(prop)
        if style == "include" and args[:1] == ("molecule",):
            ids = np.unique(self.molecules[old.inside])
            g = self._by("molecules", lambda v: np.isin(v, ids[ids != 0]))
            return Group(g.inside, g.unsure | (self.alive & old.unsure.any())), self.why.get("molecules", "")
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
                    inside = inside & ~(p.inside | p.unsure)
                    unsure = maybe & ~p.inside & ~inside
            return Group(inside, unsure), why
        raise Trouble(
            "its members change as the run goes"
            if style == "dynamic"
            else f"group {style} depends on what the run computes"
        )

    def _listed(self, args, kind):
        """A test of numbers from ``1 2 4:8:2`` or ``<= 5`` or ``<> 3 7``."""
        tests = {
            "<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal,
            "!=": np.not_equal,
        }  # fmt: skip
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
                one = w in self.origin.labels.get(label, {})
                parts = [int(self._label(label, p)) for p in ([w] if one else w.split(":"))]
                lo, hi, step = (*parts, 1) if len(parts) == 2 else (parts[0], parts[0], 1) if len(parts) == 1 else parts
                spans.append((lo, hi, max(step, 1)))
        except (ValueError, IndexError):
            raise Trouble(f"expected numbers such as 1 2 4:8, or '<= 5', got {' '.join(args)!r}") from None
        return lambda v: np.any(
            [(v >= lo) & (v <= hi) & ((v - lo) % step == 0) for lo, hi, step in spans] or [np.zeros(len(v), bool)],
            axis=0,
        )
