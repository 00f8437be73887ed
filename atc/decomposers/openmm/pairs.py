"""Pair interactions that OpenMM has and LAMMPS has not: Lennard-Jones whose energy is switched off, the reaction field,
pairs with numbers of their own (exceptions)."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ..base import Accumulator
from ..bonded.cluster import ClusterTerm
from ..pairs.charmm import force_switched_powers
from ..pairs.gromacs import LennardJonesGromacs, shifted_powers
from ..pairs.lennard_jones import LennardJones
from ..pairs.loop import pair_law
from ..pairs.radial import ChargedStyle, RadialStyle

_lj = LennardJones.law


class LennardJonesPowers(RadialStyle):
    """U = A/d¹² − B/d⁶ for d < cutoff; numbers A [energy length¹²], B [energy length⁶], cutoff."""

    name = "A/r^12 - B/r^6"
    numbers = (("A", {"energy": 1, "length": 12}), ("B", {"energy": 1, "length": 6}), ("cutoff", "length"))
    law = _lj


class LennardJonesSwitched(RadialStyle):
    """U = S (A/d¹² − B/d⁶), S = 1 − 10t³ + 15t⁴ − 6t⁵, t = (d − r_s)/(r_c − r_s) from the switching distance r_s on, as
    OpenMM and GROMACS (potential-switch) have it.

    Numbers A, B, switch [length], cutoff.
    """

    name = "A/r^12 - B/r^6, switched"
    numbers = (*LennardJonesPowers.numbers[:2], ("switch", "length"), LennardJonesPowers.numbers[2])
    shifts = False

    def columns(self, A, B, switch, cutoff):
        return A, B, switch, 1.0 / (cutoff - switch)

    @pair_law
    def law(d2, a12, c6, switch, per):
        u, g = _lj(d2, a12, c6)
        d = np.sqrt(d2)
        t = max(0.0, (d - switch) * per)
        s = 1.0 + t * t * t * (-10.0 + t * (15.0 - 6.0 * t))
        ds = -30.0 * t * t * (1.0 - t) * (1.0 - t) * per
        return s * u, s * g + ds * u / d


class LennardJonesForceSwitched(RadialStyle):
    """A/d¹² − B/d⁶ with CHARMM's vfswitch: each power 1/dⁿ, n = 12 and 6, is 1/dⁿ − 1/(r_s r_c)^{n/2} up to r_s, and
    r_c^{n/2}/(r_c^{n/2} − r_s^{n/2}) (1/d^{n/2} − 1/r_c^{n/2})² beyond (Steinbach & Brooks, J. Comput. Chem. 15 (1994)
    667).

    Numbers A, B, switch [length], cutoff.
    """

    name = "A/r^12 - B/r^6, vfswitch"
    numbers = LennardJonesSwitched.numbers
    shifts = False

    def columns(self, A, B, switch, cutoff):
        return A, B, switch**2, *force_switched_powers(A, B, switch, cutoff)

    @pair_law
    def law(d2, a12, c6, switch2, offset, k12, k6, end3):
        if d2 <= switch2:
            u, g = _lj(d2, a12, c6)
            return u + offset, g
        s2 = 1.0 / d2
        s3 = s2 * np.sqrt(s2)
        x, y = s3 * s3 - end3 * end3, s3 - end3
        return k12 * x * x - k6 * y * y, (-12.0 * k12 * x * s3 + 6.0 * k6 * y) * s3 * s2


class LennardJonesShifted(LennardJonesGromacs):
    """A/d¹² − B/d⁶ with GROMACS's force-switch, see `LennardJonesGromacs`. Numbers A, B, switch [length], cutoff."""

    name = "A/r^12 - B/r^6, force-switch"
    numbers = LennardJonesSwitched.numbers

    def columns(self, A, B, switch, cutoff):
        return shifted_powers(A, B, switch, cutoff)


#: By the words of `load.SWITCHES`.
SWITCHED = {
    "potential-switch": LennardJonesSwitched,
    "force-switch": LennardJonesShifted,
    "vfswitch": LennardJonesForceSwitched,
}


class ReactionField(ChargedStyle):
    """U = C q_i q_j (1/d + k d² − c), k = (ε − 1)/((2ε + 1) r_c³), c = 1/r_c + k r_c²: a cutoff in a medium of
    dielectric constant ε (Tironi et al., J. Chem. Phys. 102 (1995) 5451).

    Numbers k [1/length³], c [1/length], cutoff.
    """

    name = "reaction field"
    numbers = (("k", {"length": -3}), ("c", {"length": -1}), ("cutoff", "length"))

    @pair_law
    def law(d2, qq, k, c):
        inverse = 1.0 / np.sqrt(d2)
        return qq * (inverse + k * d2 - c), qq * (2.0 * k - inverse / d2)


class Exceptions(ClusterTerm):
    """C q q′/d + A/d¹² − B/d⁶ of listed pairs, whatever their distance: OpenMM's exceptions, as 1-4 pairs.

    Parameters
    ----------
    atoms : (m, 2); numbers : (m, 3) C q q′, A, B, internal
    reach : the pair term knows of excluded pairs up to this distance
    """

    bodies = 2
    weights = np.array([0.5, 0.5])
    pairwise = True
    #: whether special_bonds is none of its business
    unweighted = True

    def __init__(self, atoms, numbers, reach: float = np.inf):
        from .atoms import listed

        self.numbers, self.far = np.ascontiguousarray(numbers, dtype=float), reach
        self.count = int(np.count_nonzero(self.numbers.any(axis=1)))
        listed(self, atoms, np.arange(len(atoms)))

    def describe(self) -> str:
        if not self.count:
            return f"{len(self.numbers)} excluded pairs"
        return f"{self.count} exceptions (1-4 pairs with their own numbers), energy shared half to each atom"

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        d2 = ((x_tkc[:, 1] - x_tkc[:, 0]) ** 2).sum(axis=1)
        if len(d2) and d2.max() >= self.far**2:
            raise AtcError(
                f"two excluded atoms are {np.sqrt(d2.max()):.4g} Å apart, more than the cutoff: is the trajectory one "
                "of this System?"
            )
        z, a, c = self.numbers[types].T
        with np.errstate(all="ignore"):
            s2 = np.where((z != 0) | (a != 0) | (c != 0), 1.0 / d2, 0.0)
            s6, q = s2**3, z * np.sqrt(s2)
            U[:] = q + (a * s6 - c) * s6
            G[:, 0] = -(q + (12.0 * a * s6 - 6.0 * c) * s6) * s2
        bad = np.flatnonzero(~np.isfinite(U + G[:, 0]))
        return int(bad[0]) if len(bad) else -1
