"""The quantities atc knows: what each needs, and how it is formed from site and bond sums.

One entry a quantity. `form` gets a `sums.Sums` and returns the field in internal units: (g, ...) for kind ``grid``, (...) for ``box``,
(n, ...) for ``atom``. Where there is no mass it returns 0 (the limit of the sums); the mask is applied afterwards (`masked`), so that
time averages count empty space as empty. `weight` names the site sum that turns an intensive quotient back into a sum: a time
average of a quotient is <weight·X>/<weight>.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from .sums import Sums, full

STRESS_SIGN = "Cauchy stress, tension positive (the opposite of a pressure); component [i, j]: i the face normal (divergence direction), j the force component"


@dataclass(frozen=True)
class Source:
    """A factor that is summed: its number of components and what it cannot do without."""

    width: int
    frame: tuple[str, ...] = ()
    bonds: bool = False  # needs the pass over the bonds
    energies: bool = False  # needs per-atom potential energies
    reference: bool = False  # needs the reference frame


# Factors a_j of Σ a_j φ(x − x_j). v is relative to the mass-mean velocity of the frame (see sums.Sums), but for kinetic_energy.
SITE = {
    "one": Source(1),
    "mass": Source(1, ("masses",)),
    "momentum": Source(3, ("masses", "velocities")),
    "kinetic": Source(6, ("masses", "velocities")),
    "kinetic_energy": Source(1, ("masses", "velocities")),
    "potential_energy": Source(1, bonds=True, energies=True),
    "atom_virial": Source(6, bonds=True),
}

# Factors b of Σ b β(x), each bond once.
BOND = {
    "stress": Source(6, bonds=True),
    "piola": Source(9, bonds=True, reference=True),
}

# Sums without any kernel: over the whole frame, or per atom.
WHOLE = {
    "box_kinetic": Source(6, ("masses", "velocities")),
    "box_virial": Source(9, bonds=True),
    "atom_kinetic": Source(6, ("masses", "velocities")),
    "atom_virial": Source(6, bonds=True),
}


@dataclass(frozen=True)
class Quantity:
    """One field atc can compute; see the module for `form` and `weight`."""

    name: str
    dimension: str
    long_name: str
    form: Callable[[Sums], np.ndarray]
    rank: int = 0
    kind: str = "grid"
    site: tuple[str, ...] = ()
    bond: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    masked: bool = False
    weight: str | None = None
    sign: str = "plain sum, no sign convention"
    comment: str = ""

    def sources(self):
        """Everything this quantity sums, as `Source`s."""
        return [SITE[s] for s in self.site] + [BOND[b] for b in self.bond] + [WHOLE[w] for w in self.whole]


_MEAN = ("mass", "momentum")
_VIRIAL_SIGN = "tension positive (the opposite of LAMMPS's stress/atom and pressure); component [i, j], symmetric"


def _stress(parts_form):
    return {"dimension": "pressure", "rank": 2, "sign": STRESS_SIGN, "form": parts_form}


_ALL = [
    Quantity("number_density", "number_density", "number density", lambda s: s.site["one"][:, 0], site=("one",), sign="positive"),
    Quantity("density", "density", "mass density", lambda s: s.rho, site=("mass",), sign="positive"),
    Quantity(
        "momentum", "momentum", "momentum density", lambda s: s.momentum, rank=1, site=_MEAN, sign="positive along +x, +y, +z"
    ),
    Quantity(
        "velocity", "velocity", "mass-averaged velocity", lambda s: s.velocity, rank=1, site=_MEAN, masked=True, weight="mass",
        sign="positive along +x, +y, +z",
    ),
    Quantity(
        "temperature", "temperature", "kinetic temperature relative to the local velocity", lambda s: s.temperature,
        site=("one", *_MEAN, "kinetic"), masked=True, weight="one", sign="positive",
        comment="-trace(stress_kinetic)/(3 n k_B): three degrees of freedom per atom, none removed for the local mean velocity or for constraints",
    ),
    Quantity(
        "stress_kinetic", site=(*_MEAN, "kinetic"), masked=True, long_name="kinetic part of Hardy's stress",
        comment="relative to the local mass-averaged velocity", **_stress(lambda s: -full(s.thermal)),
    ),
    Quantity("stress_potential", bond=("stress",), long_name="potential part of Hardy's stress", **_stress(lambda s: full(s.bond["stress"]))),
    Quantity(
        "stress", site=(*_MEAN, "kinetic"), bond=("stress",), parts=("stress_kinetic", "stress_potential"), masked=True,
        long_name="Hardy's stress", **_stress(lambda s: full(s.bond["stress"] - s.thermal)),
    ),
    Quantity(
        "virial_stress_kinetic", "pressure", "kinetic part of the virial stress of the box", lambda s: -full(s.whole["box_kinetic"]) / s.volume,
        rank=2, kind="box", whole=("box_kinetic",), sign=_VIRIAL_SIGN, comment="velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_potential", "pressure", "potential part of the virial stress of the box",
        lambda s: s.whole["box_virial"].reshape(3, 3) / s.volume, rank=2, kind="box", whole=("box_virial",), sign=_VIRIAL_SIGN,
    ),
    Quantity(
        "virial_stress", "pressure", "virial stress of the box",
        lambda s: (s.whole["box_virial"].reshape(3, 3) - full(s.whole["box_kinetic"])) / s.volume,
        rank=2, kind="box", whole=("box_kinetic", "box_virial"), parts=("virial_stress_kinetic", "virial_stress_potential"),
        sign=_VIRIAL_SIGN, comment="velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_per_atom_kinetic", "pressure_volume", "kinetic part of the per-atom virial",
        lambda s: -full(s.whole["atom_kinetic"]), rank=2, kind="atom", whole=("atom_kinetic",), sign=_VIRIAL_SIGN,
        comment="stress times volume; velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_per_atom_potential", "pressure_volume", "potential part of the per-atom virial",
        lambda s: full(s.whole["atom_virial"]), rank=2, kind="atom", whole=("atom_virial",), sign=_VIRIAL_SIGN,
        comment="stress times volume; half of each bond to each end",
    ),
    Quantity(
        "virial_stress_per_atom", "pressure_volume", "per-atom virial",
        lambda s: full(s.whole["atom_virial"] - s.whole["atom_kinetic"]), rank=2, kind="atom", whole=("atom_kinetic", "atom_virial"),
        parts=("virial_stress_per_atom_kinetic", "virial_stress_per_atom_potential"), sign=_VIRIAL_SIGN,
        comment="stress times volume; half of each bond to each end; velocities relative to the mean of the frame",
    ),
    Quantity(
        "smoothed_virial_stress_kinetic", "pressure", "kinetic part of the per-atom virial smoothed with the kernel",
        lambda s: -full(s.site["kinetic"]), rank=2, site=("kinetic",), sign=STRESS_SIGN,
        comment="velocities relative to the mean of the frame, not to the local one",
    ),
    Quantity(
        "smoothed_virial_stress_potential", "pressure", "potential part of the per-atom virial smoothed with the kernel",
        lambda s: full(s.site["atom_virial"]), rank=2, site=("atom_virial",), sign=STRESS_SIGN,
    ),
    Quantity(
        "smoothed_virial_stress", "pressure", "per-atom virial smoothed with the kernel",
        lambda s: full(s.site["atom_virial"] - s.site["kinetic"]), rank=2, site=("kinetic", "atom_virial"),
        parts=("smoothed_virial_stress_kinetic", "smoothed_virial_stress_potential"), sign=STRESS_SIGN,
        comment="what a smoothing of LAMMPS's stress/atom gives; not Hardy's stress",
    ),
    Quantity("energy_kinetic", "energy_density", "kinetic energy density", lambda s: s.site["kinetic_energy"][:, 0], site=("kinetic_energy",), sign="positive",
             comment="in the frame of the simulation, streaming motion included"),
    Quantity("energy_potential", "energy_density", "potential energy density", lambda s: s.site["potential_energy"][:, 0], site=("potential_energy",),
             sign="the potential's own zero", comment="each K-body term shared equally by its K atoms, unless the potential documents another share"),
    Quantity("energy", "energy_density", "energy density", lambda s: s.site["kinetic_energy"][:, 0] + s.site["potential_energy"][:, 0],
             site=("kinetic_energy", "potential_energy"), parts=("energy_kinetic", "energy_potential"), sign="the potential's own zero"),
    Quantity(
        "piola_stress", "pressure", "potential part of the first Piola-Kirchhoff stress", lambda s: s.bond["piola"].reshape(-1, 3, 3), rank=2,
        bond=("piola",),
        sign="tension positive; component [i, j]: i the reference direction (face normal and divergence with respect to reference positions), "
        "j the component of the current force; not symmetric",
        comment="grid points are points of the reference frame; the bond function runs between reference positions; no kinetic part",
    ),
]  # fmt: skip

QUANTITIES: dict[str, Quantity] = {q.name: q for q in _ALL}


def expand(names) -> list[Quantity]:
    """The quantities called `names`, each whole followed by its parts, without repetition, in the order asked."""
    if isinstance(names, str):
        names = [names]
    out: dict[str, Quantity] = {}
    for name in names:
        if name not in QUANTITIES:
            from difflib import get_close_matches

            close = get_close_matches(str(name), QUANTITIES, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise AtcError(f"unknown quantity {name!r}{hint}: expected some of {', '.join(QUANTITIES)}")
        for n in (name, *QUANTITIES[name].parts):
            out.setdefault(n, QUANTITIES[n])
    if not out:
        raise AtcError(f"no quantities were asked for: name at least one of {', '.join(QUANTITIES)}")
    return list(out.values())


@dataclass
class Work:
    """The least work that gives a set of quantities: which sums, over what, and which passes. Nothing else is computed."""

    quantities: list[Quantity]
    site: list[str] = field(default_factory=list)
    bond: list[str] = field(default_factory=list)
    reference_bond: list[str] = field(default_factory=list)
    whole: list[str] = field(default_factory=list)
    attributes: dict[str, list[str]] = field(default_factory=dict)  # frame attribute -> the quantities that need it

    @classmethod
    def of(cls, names) -> Work:
        """The work behind the quantities called `names` (wholes are expanded)."""
        work = cls(expand(names))
        for q in work.quantities:
            for have, asked in ((work.site, q.site), (work.whole, q.whole)):
                have.extend(s for s in asked if s not in have)
            for b in q.bond:
                have = work.reference_bond if BOND[b].reference else work.bond
                if b not in have:
                    have.append(b)
            for source in q.sources():
                for a in source.frame:
                    users = work.attributes.setdefault(a, [])
                    if q.name not in users:
                        users.append(q.name)
        return work

    def _any(self, what):
        return [q.name for q in self.quantities if any(getattr(s, what) for s in q.sources())]

    @property
    def bond_users(self) -> list[str]:
        """Quantities that need the potential and the pass over the bonds."""
        return self._any("bonds")

    @property
    def energy_users(self) -> list[str]:
        return self._any("energies")

    @property
    def reference_users(self) -> list[str]:
        return self._any("reference")

    @property
    def grid_users(self) -> list[str]:
        """Quantities that live on the grid and need a kernel."""
        return [q.name for q in self.quantities if q.kind == "grid"]

    @property
    def masked(self) -> bool:
        return any(q.masked for q in self.quantities)

    @property
    def atom_virial(self) -> bool:
        return "atom_virial" in self.site or "atom_virial" in self.whole

    @property
    def n_site(self) -> int:
        return sum(SITE[s].width for s in self.site)

    @property
    def n_bond(self) -> int:
        return sum(BOND[b].width for b in self.bond)

    @property
    def n_reference_bond(self) -> int:
        return sum(BOND[b].width for b in self.reference_bond)
