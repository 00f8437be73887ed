"""What a quantity is: what it needs, and how it is formed from the finished sums."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..summed import BOND, GATHER, POINT, SITE, WHOLE
from ..sums import Sums

STRESS_SIGN = (
    "Cauchy stress, tension positive (the opposite of a pressure); component [i, j]: i the face normal (divergence "
    "direction), j the force component"
)
#: The first Piola-Kirchhoff stress's.
PIOLA_SIGN = (
    "tension positive; component [i, j]: i the reference direction (face normal and divergence with respect to "
    "reference positions), j the component of the current force; not symmetric"
)
#: What velocities, and what is relative to them, are made of.
MEAN = ("mass", "momentum")
#: The sums that a velocity and its gradient are made of.
VELOCITY = {"site": MEAN, "gather": MEAN}
#: The energy that a flux carries depends on how it is shared among the atoms.
SHARED = (
    "depends on how the energy of a term is shared among its atoms (see decomposition); the divergence of the total "
    "does not"
)


@dataclass(frozen=True)
class Quantity:
    """One field atc can compute.

    `form` gets a `sums.Sums` and returns the field in internal units: (g, ...) for kind ``grid``, (...) for ``box``,
    (n, ...) for ``atom``. Where there is no mass it returns 0 (the limit of the sums); the mask is applied afterwards
    (`masked`), so that time averages count empty space as empty. `weight` names the site sum that turns an intensive
    quotient back into a sum: a time average of a quotient is <weight·X>/<weight>.
    """

    name: str
    dimension: str
    long_name: str
    form: Callable[[Sums], np.ndarray]
    rank: int = 0
    kind: str = "grid"
    site: tuple[str, ...] = ()
    bond: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    gather: tuple[str, ...] = ()
    point: tuple[str, ...] = ()
    gradient: bool = False  # whether the gathered sums are wanted with ∂φ/∂x
    parts: tuple[str, ...] = ()
    masked: bool = False
    weight: str | None = None
    # Whether the field, times its weight, is linear in its sums, with velocities taken from the same drift in all
    # frames: then it is formed once from the mean sums of several frames. What is relative to the velocity field, or
    # the drift, of each frame is not. Wholes are the sums of their parts.
    linear: bool = False
    sign: str = "plain sum, no sign convention"
    comment: str = ""
    # The size of what the field is the difference of: a field that is 0 but for rounding has its error measured against
    # this.
    scale: Callable[[Sums], float] = lambda s: 0.0

    def sources(self):
        """Everything this quantity sums, as `Source`s."""
        found = ((SITE, self.site), (BOND, self.bond), (WHOLE, self.whole), (GATHER, self.gather), (POINT, self.point))
        return [kind[name] for kind, names in found for name in names]

    @property
    def thermal(self) -> bool:
        """Whether it is made of velocities relative to the local one, squared."""
        return self.masked and "kinetic" in self.site and "kinetic_flux" not in self.site

    @property
    def relative(self) -> bool:
        """Whether velocities in it are those relative to the local velocity."""
        return "kinetic" in self.site or "kinetic_flux" in self.site or (self.masked and self.weight is None)

    @property
    def on_reference(self) -> bool:
        """Whether its grid is that of the reference frame."""
        return any(s.on_reference for s in self.sources())

    @property
    def symmetric_if_central(self) -> bool:
        """Whether it is a stress of forces on the grid, symmetric as long as they act along bonds."""
        return self.sign == STRESS_SIGN and self.kind == "grid" and any(s.bonds for s in self.sources())

    @property
    def kernel(self) -> bool:
        """Whether it needs a kernel."""
        return self.kind == "grid" and not self.point


def largest(a) -> float:
    """The largest value of any component, 0 of nothing."""
    return float(np.abs(a).max(initial=0.0))
