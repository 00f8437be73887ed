"""What is to be summed for some quantities, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..grids.planes import by_frames, through_planes
from .quantities.quantity import Quantity
from .registry import expand
from .summed import ALIKE, ALL, BOND, GATHER, POINT, SITE


@dataclass
class Work:
    """The least work that gives a set of quantities: which sums, over what, and which passes. Nothing else is
    computed."""

    quantities: list[Quantity]
    site: list[str] = field(default_factory=list)
    bond: list[str] = field(default_factory=list)
    reference_bond: list[str] = field(default_factory=list)
    whole: list[str] = field(default_factory=list)
    gather: list[str] = field(default_factory=list)
    reference_gather: list[str] = field(default_factory=list)
    point: list[str] = field(default_factory=list)
    reference_point: list[str] = field(default_factory=list)
    squares: list[str] = field(default_factory=list)  # factors whose sums with φ² are wanted too
    attributes: dict[str, list[str]] = field(default_factory=dict)  # frame attribute -> the quantities that need it
    kernel: bool = True  # whether sums on the grid are taken with one
    churnless: bool = False  # whether M = −S in every bond
    made_of: tuple = ()  # what `of` was given

    @classmethod
    def on(cls, grid, names, pot, parts: bool = False, velocity: str = "local") -> Work:
        """The work behind quantities on a grid (or None), with a potential (or None); on planes all motion counts."""
        central, churnless = pot is None or pot.central, pot is not None and pot.churnless
        if through_planes(grid):
            return cls.of(names, central, False, "none", churnless, kernel=False, by_frames=by_frames(grid))
        return cls.of(names, central, parts, velocity, churnless)

    @classmethod
    def of(
        cls, names, central: bool = True, parts: bool = False, velocity: str = "local", churnless: bool = False,
        kernel: bool = True, by_frames: bool = False,
    ) -> Work:  # fmt: skip
        """The work behind the quantities called `names` (wholes are expanded). `central`: whether forces act along
        bonds. `parts`: of one species after the other; what is relative to the local velocity is to that of all.
        `velocity`: what thermal motion is relative to, see `settings`. `churnless`: whether M = −S in every bond: it
        need not be summed up then (`sums.churn_nothing`). `kernel`: False on planes, where crossings are counted.
        `by_frames`: whether these are seen by where atoms were in the frame before, not by their velocities."""
        work = cls(expand(names), kernel=kernel, churnless=churnless)
        names = tuple(q.name for q in work.quantities)
        work.made_of = (names, central, parts, velocity, churnless, kernel, by_frames)
        for q in work.quantities:
            for have, asked in ((work.site, q.site), (work.whole, q.whole)):
                have.extend(s for s in asked if s not in have)
            for kind, names, here, there in (
                (BOND, q.bond, work.bond, work.reference_bond),
                (GATHER, q.gather, work.gather, work.reference_gather),
                (POINT, q.point, work.point, work.reference_point),
            ):
                for name in names:
                    have = there if kind[name].on_reference else here
                    if name not in have:
                        have.append(name)
            for source in q.sources():
                for a in source.frame:
                    users = work.attributes.setdefault(a, [])
                    if q.name not in users:
                        users.append(q.name)
        if by_frames and "power_lab" not in work.bond:  # what is on no grid needs them still
            moving = [q.name for q in work.quantities if q.kind != "grid"]
            users = [name for name in work.attributes.pop("velocities", []) if name in moving]
            work.attributes |= {"velocities": users} if users else {}
        if parts and any(q.relative for q in work.quantities):
            work.site += [ALL + "mass", ALL + "momentum"]
        if velocity == "frame" and any(q.thermal for q in work.quantities):
            work.squares = ["mass", ALL + "mass"] if parts else ["mass"]
            more = ["one", ALL + "one", ALL + "kinetic"] if parts else ["one"]
            work.site += [name for name in more if name not in work.site]
        if churnless:
            work.bond = list(dict.fromkeys("stress" if name == "sources" else name for name in work.bond))
        if not central:
            work.bond = ["moment" if name == "stress" else name for name in work.bond]
            work.site, work.whole = (
                ["atom_moment" if name == "atom_virial" else name for name in sums] for sums in (work.site, work.whole)
            )
        return work

    def __reduce__(self):  # quantities have functions
        return Work.of, self.made_of

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
    def force_users(self) -> list[str]:
        """Quantities that need the forces between atoms."""
        return self._any("forces")

    @property
    def source_users(self) -> list[str]:
        """Quantities that need the energy sources of the bonds."""
        return self._any("sources")

    @property
    def gradient_users(self) -> list[str]:
        """Quantities that need the gradient of the kernel."""
        return [q.name for q in self.quantities if q.gradient]

    @property
    def on_reference(self) -> list[str]:
        """Quantities on the grid of the reference frame."""
        return [q.name for q in self.quantities if q.on_reference]

    @property
    def reference_users(self) -> list[str]:
        return self._any("reference")

    @property
    def grid_users(self) -> list[str]:
        """Quantities that live on the grid."""
        return [q.name for q in self.quantities if q.kind == "grid"]

    @property
    def elements(self) -> list[Quantity]:
        """The fields on the grid that others are sums of."""
        return [q for q in self.quantities if q.kind == "grid" and not q.parts]

    @property
    def checkable(self) -> list[Quantity]:
        """The fields that points around the strongest bonds can be computed for: those of sums over bonds and atoms
        alone."""
        return [
            q
            for q in self.quantities
            if q.kind == "grid" and q.bond and not (q.on_reference or q.gather or q.gradient or q.point or q.whole)
        ]

    @property
    def kernel_users(self) -> list[str]:
        return [q.name for q in self.quantities if q.kernel and self.kernel]

    @property
    def horizon_users(self) -> list[str]:
        """Quantities that need a horizon."""
        return [q.name for q in self.quantities if q.point]

    @property
    def symmetric_users(self) -> list[str]:
        """Quantities that only know forces along bonds."""
        return [q.name for q in self.quantities if {"atom_virial"} & {*q.site, *q.whole}]

    @property
    def masked(self) -> bool:
        return any(q.masked for q in self.quantities)

    @property
    def atom_moment(self) -> bool:
        return "atom_moment" in self.site or bool({"atom_moment", "reference_atom_moment"} & {*self.whole})

    @property
    def atom_virial(self) -> bool:
        return "atom_virial" in self.site or "atom_virial" in self.whole

    @property
    def sized(self) -> bool:
        """Whether the size of the stress's terms is summed up too, at the points of the check."""
        return bool({"stress", "moment"} & {*self.bond})

    @property
    def beyond_bonds(self) -> bool:
        """Whether more of the potential is wanted than its bonds: energies, forces, virials of atoms or of the box."""
        wholes = {"box_virial", "box_power"} & {*self.whole}
        return bool(self.energy_users or self.force_users or self.atom_virial or self.atom_moment or wholes)

    @property
    def summed_site(self) -> list[str]:
        """Those of `site` that need a sum of their own: none where the sums with gradients have them all."""
        return [] if {*self.site} <= {*self.gather} & ALIKE else self.site

    @property
    def n_site(self) -> int:
        return sum(SITE[s].width for s in self.summed_site)

    @property
    def n_bond(self) -> int:
        return sum(BOND[b].width for b in self.bond)

    @property
    def n_reference_bond(self) -> int:
        return sum(BOND[b].width for b in self.reference_bond)

    @property
    def n_gather(self) -> int:
        return sum(GATHER[g].width for g in self.gather)

    @property
    def n_reference_gather(self) -> int:
        return sum(GATHER[g].width for g in self.reference_gather)

    def slopes(self, key: str) -> bool:
        """Whether the sums of "gather" or "reference_gather" are wanted with ∂φ/∂x."""
        return any(q.gradient for q in self.quantities if q.gather and q.on_reference == (key == "reference_gather"))
