"""SPICA's coarse-grained angle: harmonic, with the repulsion of the pair style between its outer atoms, which
special_bonds leave out there."""

from __future__ import annotations

import numpy as np

from ..registry import STYLES
from .angle import HarmonicAngle
from .bond import lengths
from .bond_pairwise import OwnPairs
from .cluster import ClusterWork, first_not_finite
from .topology import HybridWork


class SpicaAngle(HarmonicAngle):
    """U = K (θ − θ0)² + [U_pair(d_bc) + ε up to the minimum of U_pair] (LAMMPS ``spica``, ``sdk``). Coefficients K
    [energy/rad²], θ0 [degrees].

    U_pair is that of pair style ``lj/spica`` (``lj/sdk``) of the same potential, without its cutoff and shift.
    pairs : the `Pairs` term or the list of PairStyle with it
    """

    name = "spica"

    def __init__(self, coeffs, *, units="metal", partition="equal", pairs=None):
        super().__init__(coeffs, units=units, partition=partition)
        self.pairs = pairs

    def describe(self):
        return f"{super().describe()}; the repulsion of its outer atoms half to each of them"

    def prepare(self, frame):
        return HybridWork([super().prepare(frame), _Repulsion(self, frame)])

    def complaint(self, frame, atoms_k, kind, x_kc):
        if (x_kc[0] == x_kc[2]).all():
            ids = ", ".join(str(i) for i in frame.ids[atoms_k])
            return f"the outer atoms of the angle {ids} are at the same place, where their repulsion is infinite"
        return super().complaint(frame, atoms_k, kind, x_kc)

    @classmethod
    def build(cls, inp):
        if not any(s.name == "lj/spica" for s in inp.pair_styles):
            raise inp.error(
                f"{inp.command} adds the repulsion of pair_style lj/spica (lj/sdk) between its outer atoms, which is "
                "not there: give it first"
            )
        term = super().build(inp)
        term.pairs = inp.pairs
        return term


class _Repulsion(ClusterWork):
    """The outer atoms of all angles."""

    def __init__(self, term: SpicaAngle, frame):
        super().__init__(term, frame)
        own = OwnPairs(term.pairs, frame)
        self.weights = np.array([0.5, 0.0, 0.5])
        self.atom_types = own.types
        self.style = next((s for s, _ in own.styles if s.name == "lj/spica"), None)

    def evaluate(self, atoms, x, types, U, G, acc):
        U[:] = G[:] = 0.0
        if self.style is None or not len(U):
            return -1
        d = lengths(x)
        # cutoff², σ, A, n, B, m of U = A (σ/d)^n − B (σ/d)^m.
        _, sigma, A, n, B, m = self.style.table[self.atom_types[atoms[:, 0]], self.atom_types[atoms[:, 2]]].T[:6]
        on = (A > 0) & (B > 0)
        n, m, A, B = (np.where(on, v, w) for v, w in ((n, 2.0), (m, 1.0), (A, 1.0), (B, 1.0)))
        # At the minimum, −ε, n A x^n = m B x^m.
        x_min = (m * B / (n * A)) ** (1.0 / (n - m))
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            x = sigma / d
            near = on & (x > x_min)
            U[:] = np.where(near, A * x**n - B * x**m - (A * x_min**n - B * x_min**m), 0.0)
            G[:, 1] = np.where(near, (m * B * x**m - n * A * x**n) / d**2, 0.0)
        return first_not_finite(U, G)


STYLES["angle"].update(spica=SpicaAngle.build, sdk=SpicaAngle.build)
