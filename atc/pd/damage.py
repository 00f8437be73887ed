"""When bonds break: the critical stretch, with its dependence on a node's most compressed bond (Silling & Askari 2005;
R 3.0.8-3.0.10); or a critical energy, the work done on a bond (Foster, Silling & Chen 2011)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError


@dataclass(frozen=True)
class CriticalStretch:
    """A bond breaks for good when its stretch exceeds min(s0_i, s0_j), s0 = s00 − α·(smallest stretch of the node's
    bonds), both of the step before.

    s00 : critical stretch. alpha : α ≥ 0, how much compression strengthens. The comparison is strict, a breaking bond
        pulls once more, and nothing breaks in the first step (s0 is infinite until it has been computed once).
    """

    s00: float
    alpha: float = 0.0

    def __post_init__(self):
        if not self.s00 > 0:
            raise AtcError(f"the critical stretch s00 must be positive, got {self.s00!r}")
        if not (np.isfinite(self.alpha) and self.alpha >= 0):
            raise AtcError(f"alpha of the critical stretch must be zero or positive, got {self.alpha!r}")

    @property
    def size(self) -> float:
        """How strong: of two sides without a rule for their interface the smaller one counts."""
        return self.s00

    @property
    def never(self) -> bool:
        """Whether it says that nothing breaks."""
        return bool(np.isinf(self.s00))

    @classmethod
    def from_energy(
        cls, Gc: float, material, body, alpha: float = 0.0, *, other=None, interface=1.0
    ) -> CriticalStretch:
        """The s00 at which separating a plane costs the fracture energy `Gc` (energy per area) in this material and
        horizon.

        All bonds across the plane at their critical stretch: in 3-D G_c = (9/5) K δ s0² for PMB, in 2-D c h δ⁴ s0²/4.
        With `other`, a second material, the plane is the interface between the two, and `interface` what `Simulation`
        takes for it.
        """
        if not Gc > 0:
            raise AtcError(f"the fracture energy Gc must be positive, got {Gc!r}")
        for m in (material, other):
            if m is not None and not m.springs:
                raise AtcError(
                    f"{m.name}: the energy of its bonds does not grow like the square of their stretch: give the "
                    "critical stretch itself, s00"
                )
        one = (
            material.fracture_energy(body, 1.0) if other is None else material.interface_energy(other, body, interface)
        )
        return cls(float(np.sqrt(Gc / one)), alpha)


@dataclass(frozen=True)
class CriticalEnergy:
    """A bond of a state-based ordinary body breaks for good when the work done on it, ∫ f de per volumes of its ends
    (and their share ν), exceeds w_c, and it is longer than at rest. It pulls once more.

    Gc : fracture energy per area. w_c is that with which all bonds across a plane together cost it: of a lattice
        (`Body.lattice` without jitter) by its own sum, for the plane where that is least; of other bodies by the
        integral, 4Gc/(πδ⁴) in three dimensions, 3Gc/(2hδ³) in plates.
    """

    Gc: float

    def __post_init__(self):
        if not self.Gc > 0:
            raise AtcError(f"the fracture energy Gc must be positive, got {self.Gc!r}")

    @property
    def size(self) -> float:
        """How strong, as of a `CriticalStretch`."""
        return self.Gc

    never = False


def damage_n(body, intact_b) -> np.ndarray:
    """(n,) φ_i = 1 − ΣV_j over intact bonds / ΣV_j over the reference family (R 3.0.10); 0 for a node without a
    family."""
    b = body.bonds
    whole = np.asarray(intact_b) != 0
    n = len(body)
    i, j = b.i_b, b.j_b
    if whole.all():
        return np.zeros(n)
    # Sums of what broke, so that an undamaged node has exactly 0.
    gone = ~whole
    i, j = i[gone], j[gone]
    lost = np.bincount(i, body.V_n[j], n) + np.bincount(j, body.V_n[i], n)
    total = body.family_volume_n
    return np.divide(lost, total, out=np.zeros(n), where=total > 0)


class DamageRule:
    """Critical stretches, or energies, of every kind of bond, as the kernels want them. `rules` is None, one
    CriticalStretch or CriticalEnergy, or {material or (a, b): it}. `Gc` (kinds,) is None unless bonds break by
    energy."""

    def __init__(self, rules, ids, kinds, n_kinds):
        self.s00 = np.full(n_kinds, np.inf)
        self.alpha = np.zeros(n_kinds)
        self.Gc = None
        self.active = rules is not None
        if rules is None:
            return
        if isinstance(rules, CriticalEnergy):
            self.Gc = np.full(n_kinds, rules.Gc)
            return
        if isinstance(rules, CriticalStretch):
            self.s00[:], self.alpha[:] = rules.s00, rules.alpha
            return
        for key in rules:
            for a in key if isinstance(key, tuple) else (key,):
                if a not in ids:
                    raise AtcError(f"damage: there is no material {a!r} in this body; its materials are {sorted(ids)}")
        by_energy = {isinstance(r, CriticalEnergy) for r in rules.values() if not r.never}
        if len(by_energy) > 1:
            raise AtcError(
                "damage: the bonds of one body break by a critical stretch or by a critical energy, not both"
            )
        if by_energy == {True}:
            self.Gc = np.full(n_kinds, np.inf)
        for (a, b), k in kinds.items():
            rule = rules.get((a, b), rules.get((b, a)))
            if rule is None:
                # Without a rule of its own an interface is as weak as the weaker side; a side without a rule never
                # breaks.
                rule = min((rules[m] for m in (a, b) if m in rules), key=lambda r: r.size, default=None)
            if isinstance(rule, CriticalEnergy):
                self.Gc[k] = rule.Gc
            elif rule is not None:
                self.s00[k], self.alpha[k] = rule.s00, rule.alpha
