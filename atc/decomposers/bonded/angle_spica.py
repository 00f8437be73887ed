"""SPICA's coarse-grained angle: harmonic, with the repulsion of the pair style between its outer atoms, which
special_bonds leave out there."""

from __future__ import annotations

import numpy as np

from ..registry import angle_style
from .angle import HarmonicAngle
from .bond import _BondWork
from .bond_pairwise import OwnPairs
from .topology import HybridWork, degrees, energy, first_true


class SpicaAngle(HarmonicAngle):
    """U = K (θ − θ0)² + [U_pair(d_bc) + ε up to the minimum of U_pair] (LAMMPS ``spica``, ``sdk``). Coefficients K
    [energy/rad²], θ0 [degrees].

    U_pair is that of pair style ``lj/spica`` (``lj/sdk``) of the same potential, without its cutoff and shift.
    pairs : the `Pairs` term or the list of PairStyle with it
    """

    name = "spica"
    wants = (("K", energy), ("theta0", degrees))

    def __init__(self, coeffs, *, units="metal", partition="equal", pairs=None):
        super().__init__(coeffs, units=units, partition=partition)
        self.pairs = pairs

    def describe(self):
        return f"{super().describe()}; the repulsion of its outer atoms half to each of them"

    def prepare(self, frame):
        return HybridWork([super().prepare(frame), _Repulsion(self, frame)])

    def refuse(self, t, d):
        return "where the repulsion of an angle's outer atoms is infinite: they are at the same place"


class _Repulsion(_BondWork):
    """The outer atoms of all angles, as bonds."""

    def __init__(self, term: SpicaAngle, frame):
        super().__init__(term, frame)
        self.apex = self.j
        self.j = np.ascontiguousarray(term.terms_of(frame)[0][:, 2])
        own = OwnPairs(term.pairs, frame)
        self.atom_types = own.types
        self.style = next((s for s, _ in own.styles if s.name == "lj/spica"), None)

    def vectors(self, here, r):
        # By way of the apex, as the angle has it.
        to_apex = np.empty_like(r)
        self.images.vectors_to(self.frame.positions, self.i[here], self.apex[here], r)
        self.images.vectors_to(self.frame.positions, self.j[here], self.apex[here], to_apex)
        r -= to_apex

    def add(self, i, j, types, d, U, G):
        if self.style is None or not len(d):
            return -1, 0
        # cutoff², σ, A, n, B, m of U = A (σ/d)^n − B (σ/d)^m.
        _, sigma, A, n, B, m = self.style.table[self.atom_types[i], self.atom_types[j]].T[:6]
        on = (A > 0) & (B > 0)
        n, m, A, B = (np.where(on, v, w) for v, w in ((n, 2.0), (m, 1.0), (A, 1.0), (B, 1.0)))
        # At the minimum, −ε, n A x^n = m B x^m.
        x_min = (m * B / (n * A)) ** (1.0 / (n - m))
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            x = sigma / d
            near = on & (x > x_min)
            U[:] = np.where(near, A * x**n - B * x**m - (A * x_min**n - B * x_min**m), 0.0)
            G[:] = np.where(near, (m * B * x**m - n * A * x**n) / d**2, 0.0)
        return first_true(~np.isfinite(U + G)), 0


@angle_style("spica", "sdk")
def _spica(inp):
    inp.no_arguments()
    if not any(s.name == "lj/spica" for s in getattr(inp.pairs, "styles", ())):
        raise inp.error(
            f"{inp.command} adds the repulsion of pair_style lj/spica (lj/sdk) between its outer atoms, which is not "
            "there: give it first"
        )
    term = SpicaAngle._from_input(inp.type_values(SpicaAngle.wanted(inp.units)), inp)
    term.pairs = inp.pairs
    return term
