"""The pair interaction of the two ends of a torsion that dihedral styles charmm and charmmfsw bring along, with
coefficients of a charmm pair style."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ..base import Term, Wrapper
from ..bonded.cluster import ClusterTerm, ClusterWork
from ..bonded.dihedral import CharmmFSWTorsion, CharmmTorsion
from ..bonded.topology import HybridTerm
from .pairs import Pairs

_BARE, _IMPLICIT, _SHIFTED = 0, 1, 2


class OneFourTerm(ClusterTerm):
    """w [4ε₁₄((σ₁₄/d)¹² − (σ₁₄/d)⁶) + C q₁q₄/d] of the first and fourth atom of each torsion with a weight w ≠ 0, half
    of it to each.

    There is no cutoff (so in LAMMPS). With an implicit-solvent pair style the charges' part is C q₁q₄/d²
    (its force is LAMMPS's, C q₁q₄/d³); with dihedral style charmmfsw it is
    C q₁q₄(1/d + d/r_c² − 2/r_c), and the Lennard-Jones energy has the constant of the force switch.

    Parameters
    ----------
    torsion : CharmmTorsion whose terms, types and weights these are
    coefficients : `OneFour` of the pair style
    """

    bodies = 4
    weights = np.array([0.5, 0.0, 0.0, 0.5])

    def __init__(self, torsion: CharmmTorsion, coefficients):
        self.torsion, self.coefficients = torsion, coefficients
        self.scale = np.zeros(max(torsion.covered) + 1)
        for t, w in torsion.end_weights.items():
            self.scale[t] = w
        shifted = isinstance(torsion, CharmmFSWTorsion)
        self.form = _SHIFTED if shifted else _IMPLICIT if coefficients.implicit else _BARE

    def describe(self) -> str:
        return f"1-4 pairs of dihedral {self.torsion.name}, energy shared half to each atom"

    def terms_of(self, frame: Frame):
        atoms, types = self.torsion.terms_of(frame)
        on = self.scale[types] != 0.0
        return np.ascontiguousarray(atoms[on]), np.ascontiguousarray(types[on])

    def prepare(self, frame: Frame):
        frame.require("charges", why="the 1-4 pairs of a charmm dihedral style")
        top = int(frame.types.max()) if len(frame) else 0
        if top >= len(self.coefficients.a):
            raise AtcError(
                f"{frame.source}: atoms of type {top} but the pair coefficients cover types 1 to "
                f"{len(self.coefficients.a) - 1}"
            )
        return _OneFourWork(self, frame)


class _OneFourWork(ClusterWork):
    def evaluate(self, atoms, x, types, U, G, acc):
        term, f = self.term, self.frame
        c = term.coefficients
        G[:] = 0.0
        coefficients = c.a, c.c, c.constant, term.form, c.offset, c.inverse_cutoff
        return _ends(x, f.types, f.charges, atoms, term.scale[types], coefficients, U, G)


def one_four_terms(terms: list[Term]) -> list[Term]:
    """For the terms of a potential from LAMMPS lines: one `OneFourTerm` for each charmm torsion with weights that are
    not 0.

    Raises AtcError if the pair style has no 1-4 coefficients, or not of the kind that the dihedral style needs.
    """
    torsions = [t for term in terms for t in _charmm_torsions(term) if t.end_weights]
    found = [s.one_four for term in terms if isinstance(term, Pairs) for s in term.styles if s.one_four is not None]
    out = []
    for torsion in torsions:
        t, w = next(iter(torsion.end_weights.items()))
        asks = f"dihedral_coeff {t} of {torsion.name}: the weight {w:g} asks for a 1-4 pair interaction"
        if len(found) != 1:
            have = (
                "is not supported without exactly one pair style that has its coefficients (lj/charmm/coul/charmm, "
                ".../implicit or lj/charmmfsw/coul/charmmfsh)"
            )
            raise AtcError(f"{asks}, which {have}: give one, or weight 0.0")
        if isinstance(torsion, CharmmFSWTorsion) and not found[0].shifted:
            raise AtcError(
                f"{asks}, for which it needs pair_style lj/charmmfsw/coul/charmmfsh; use dihedral_style charmm with "
                "the other charmm pair styles"
            )
        torsion.ends_done = True
        out.append(OneFourTerm(torsion, found[0]))
    return out


def _charmm_torsions(term: Term) -> list[CharmmTorsion]:
    if isinstance(term, Wrapper):
        return _charmm_torsions(term.term)
    if isinstance(term, HybridTerm):
        return [t for part in term.terms for t in _charmm_torsions(part)]
    return [term] if isinstance(term, CharmmTorsion) else []


@njit(cache=True, nogil=True, error_model="numpy")
def _ends(x, types, q, atoms, weight, coefficients, U, G):
    """U (m,) and G of the pair 14 (the third of six); the first pair that is not finite, or −1."""
    a, c, constant, form, offset, inverse_cutoff = coefficients
    for t in range(len(U)):
        i, j = atoms[t, 0], atoms[t, 3]
        ti, tj = types[i], types[j]
        d2 = 0.0
        for k in range(3):
            r = x[t, 3, k] - x[t, 0, k]
            d2 += r * r
        s2 = 1.0 / d2
        s6 = s2 * s2 * s2
        u = (a[ti, tj] * s6 - c[ti, tj]) * s6
        g = (12.0 * a[ti, tj] * s6 - 6.0 * c[ti, tj]) * s6 * s2
        z = constant * q[i] * q[j]
        d = np.sqrt(d2)
        if form == 0:
            u += z / d
            g += z / d * s2
        elif form == 1:
            u += z * s2
            # LAMMPS (22 Jul 2025) has half the slope of this energy here; measured, not documented.
            g += z * s2 * s2
        else:
            u += offset[ti, tj] + z * (1.0 / d + inverse_cutoff * (d * inverse_cutoff - 2.0))
            g += z * (s2 - inverse_cutoff * inverse_cutoff) / d
        U[t] = weight[t] * u
        G[t, 2] = -weight[t] * g
        if not np.isfinite(u + g):
            return t
    return -1
