"""Ewald's split: how much of the Coulomb interaction is bonds inside the cutoff, and up to which mode the rest goes."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt

from ...errors import AtcError

#: Relative size of what is left out by default, of the bonds at the cutoff and of the modes beyond the largest.
ACCURACY = 1e-8
#: What of a field's tolerance its split may leave out (in water the error of the stress is 70 times that), never less
#: and never more than these.
SHARE, FINEST, COARSEST = 2e-3, 1e-13, 1e-5


class Gaussian:
    """What splits share, whose smooth part falls like e^{−s k²}."""

    alpha: float
    accuracy: float

    @property
    def s(self) -> float:
        return 0.25 / self.alpha**2

    def largest_wave(self, accuracy: float | None = None) -> float:
        """The wave number a with e^{−s a²} = accuracy."""
        return sqrt(-log(self.accuracy if accuracy is None else accuracy) / self.s)


@dataclass(frozen=True)
class Split(Gaussian):
    """erfc(αd)/d is bonds, erf(αd)/d is smooth.

    alpha : 1/length. cutoff : of the bonds. constant : Coulomb's, over the dielectric constant. accuracy : see
        `ACCURACY`
    """

    alpha: float
    cutoff: float
    constant: float
    accuracy: float = ACCURACY

    @classmethod
    def of(cls, cutoff: float, constant: float, accuracy: float = ACCURACY) -> Split:
        """The smallest α whose bonds end at the cutoff: erfc(α r_c) is the accuracy."""
        return cls(float(_reach(accuracy)) / cutoff, cutoff, constant, accuracy)

    def at(self, accuracy: float, alpha: float | None = None) -> Split:
        """The same α, unless another is given, with another accuracy: bonds end where erfc(αd) is the accuracy. Local
        values depend on α, so it must not depend on how accurately they are wanted."""
        alpha = self.alpha if alpha is None else alpha
        return Split(alpha, float(_reach(accuracy)) / alpha, self.constant, accuracy)


def accuracy_for(tolerance: float) -> float:
    """Of a split whose part of a field's error is small beside the tolerance."""
    return min(max(SHARE * tolerance, FINEST), COARSEST)


def _reach(accuracy: float) -> float:
    """x with erfc(x) = accuracy."""
    from scipy.special import erfcinv

    if not 0.0 < accuracy < 0.1:
        raise AtcError(f"long-range Coulomb: the accuracy must be between 0 and 0.1, got {accuracy:g}")
    return erfcinv(accuracy)
