"""Neuroevolution potentials (NEP): energies of atoms as a small network of what their neighbours look like."""

from __future__ import annotations

import numpy as np

from ..bonds import Bonds
from ..errors import AtcError
from ..frame import Frame
from ..units import units as system
from .base import Potential, Term, Work
from .elements import SYMBOLS, ElementMap
from .neighbor_work import NeighborWork, room, shares
from .nep_file import NEPFile, read_nep
from .nep_kernels import centres, coupling, merge, norms

#: The number of the invariant of five bodies, (1, 1, 1, 1), is found by its degrees.
_FIVE = (1, 1, 1, 1)
#: The universal screening function: factors and exponents; exponents are over a, 1/a = (Z_i^0.23 + Z_j^0.23)/0.46848 Å.
_FACTORS, _EXPONENTS = (0.18175, 0.50986, 0.28022, 0.02817), (3.1998, 0.94229, 0.4029, 0.20162)
_INVERSE_A, _POWER = 2.134563, 0.23
#: e²/4πε0 in eV Å, with GPUMD's digits.
_COULOMB = 14.399645


class NEP(Term):
    """U = Σ_j [w1·tanh(w0 q_j − b0) − b1], q_j descriptors of the neighbours of atom j (NEP2 to NEP5), with a
    screened repulsion of nuclei besides if the file has one (ZBL).

    Descriptors: Σ g_n(d) of neighbours; with A_nlm = Σ g_n Y_lm, the three-body Σ_m |A_nlm|²; the four-body
    Σ (l1 l2 l3; m1 m2 m3) A_nl1m1 A_nl2m2 A_nl3m3 (Wigner's 3j symbols) for the degrees 222, 112, 123, 233, 134; the
    five-body (7/15) (Σ_m |A_n1m|²)². g_n = Σ_k c_nk f_k, c for each pair of elements, f_k Chebyshev polynomials times
    ½ (1 + cos π d/r_c).

    Forces do not act along bonds: ∂U^(j)/∂x_k has parts across x_k − x_j. The stress of a pair is −r⊗F, nine
    components; its divergence is the force density exactly. It is not symmetric at a point; its integral is.

    Parameters
    ----------
    file : NEPFile
    elements : the file's name of each atom type from 1, None or "NULL" for types left out. None: by the names that
        frames have for their types, or, where the file has one element only, all atoms.

    Notes
    -----
    Source: Fan, Zeng, Zhang et al., Phys. Rev. B 104, 104309 (2021); Fan, J. Phys.: Condens. Matter 34, 125902 (2022);
    Fan, Wang, Ying et al., J. Chem. Phys. 157, 114801 (2022); Song, Zhao, Liu et al., Nat. Commun. 15, 10208 (2024).
    """

    central, edges = False, True

    def __init__(self, file: NEPFile, elements=None, where: str = "nep.txt"):
        self.model, self.where = file, where
        self.elements = None if elements is None else [None if e in (None, "NULL") else str(e) for e in elements]
        if self.elements is not None:
            ElementMap(self.elements, file.names, where)  # which says what is wrong with them
        u = system("metal")
        self.length, self.energy = float(u.to_internal("length", 1.0)), float(u.to_internal("energy", 1.0))
        self.core = _core(file, where)
        reach = file.rc_radial.max()
        if len(self.core):
            reach = max(reach, self.core[..., 1].max())
        self.cutoff = float(reach * self.length)
        self.norm = norms(file.l_max)
        terms = [(k, coupling(file.l_max, m)) for k, m in enumerate(file.many) if len(m) == 3]
        self.which = np.concatenate([np.zeros(0, np.int64), *(np.full(len(C), k) for k, (_, C) in terms)])
        self.abc = np.concatenate([np.zeros((0, 3), np.int64), *(abc for _, (abc, _) in terms)])
        self.C = np.concatenate([np.zeros(0), *(C for _, (_, C) in terms)])
        self.fifth = file.many.index(_FIVE) if _FIVE in file.many else -1
        self.w0 = np.ascontiguousarray(file.w0_thd * file.scale_d)
        self.c_radial, self.c_angular = (
            np.ascontiguousarray(c.transpose(0, 1, 3, 2)) for c in (file.c_radial, file.c_angular)
        )

    def describe(self) -> str:
        core = ", ZBL" if len(self.core) else ""
        return (
            f"nep{self.model.version} ({' '.join(self.model.names)}{core}), edge gradient of the energy of "
            "each atom, one hop, energy to the atom whose neighbours it has; one merged bond a pair"
        )

    def map(self, frame: Frame) -> ElementMap:
        """Which element each type of the frame is."""
        names = self.model.names
        if self.elements is not None:
            return ElementMap(self.elements, names, self.where)
        present = np.unique(frame.types)
        unknown = [int(t) for t in present if frame.type_names.get(int(t)) not in names]
        if not unknown:
            top = int(present.max(initial=0))
            return ElementMap(
                [frame.type_names.get(k) if k in present else None for k in range(1, top + 1)] or names,
                names,
                self.where,
            )
        named = [str(frame.type_names[t]) for t in unknown if t in frame.type_names]
        if not named and len(names) == 1 and len(present) == 1:
            return ElementMap(None, names, self.where)
        raise AtcError(
            f"{frame.source}: {self.where} has the elements {', '.join(names)}, but types "
            f"{', '.join(map(str, unknown))} are {', '.join(named) or 'not named'}: say the element of each type, "
            f"types={[*names]!r} or the like"
        )

    def prepare(self, frame: Frame) -> Work:
        return _NEPWork(self, frame)


def _core(file: NEPFile, where: str) -> np.ndarray:
    """(t, t, 11) rows of `screened` in Å and eV; empty if the file has no ZBL."""
    if file.zbl is None:
        return np.zeros((0, 0, 11))
    odd = [e for e in file.names if e not in SYMBOLS]
    if odd:
        raise AtcError(f"{where}: ZBL needs nuclear charges, and {odd[0]!r} is no element")
    Z = np.array([SYMBOLS.index(e) + 1.0 for e in file.names])
    t = len(Z)
    out = np.zeros((t, t, 11))
    inverse_a = _INVERSE_A * (Z[:, None] ** _POWER + Z[None, :] ** _POWER)
    out[..., 2] = _COULOMB * Z[:, None] * Z[None, :]
    if isinstance(file.zbl, tuple):
        out[..., :2] = file.zbl
        out[..., 3::2] = _FACTORS
        out[..., 4::2] = _EXPONENTS
    else:
        out[..., :2] = file.zbl[..., :2]
        out[..., 3:] = file.zbl[..., 2:]
    out[..., 4::2] *= inverse_a[..., None]
    return out


class _NEPWork(NeighborWork):
    """The energy of each atom with its gradient by the vector to each neighbour, into slots of their own (one for each
    end of a pair); one bond a pair."""

    def __init__(self, term: NEP, frame: Frame):
        super().__init__(term, frame, "NEP", *term.map(frame).apply(frame))

    @property
    def own(self):
        return self._centres, self._merge

    def joined(self, acc):
        self.g_end = np.zeros((len(self.near.a), 2, 3))

    def _centres(self, task, acc):
        term, file = self.term, self.term.model
        acc.energy += centres(
            *self.atoms(task),
            self.near.most(task)[0],
            self.lists,
            file.rc_radial,
            file.rc_angular,
            term.c_radial,
            term.c_angular,
            file.l_max,
            term.norm,
            term.abc,
            term.C,
            term.which,
            term.fifth,
            len(file.many),
            term.w0,
            file.b0_th,
            file.w1_th,
            file.b1_t,
            term.core,
            term.length,
            term.energy,
            self.g_end,
            shares(acc),
        )

    def _merge(self, task, acc):
        p0, p1 = self.pairs(task)
        m = p1 - p0
        i, j, r, _, D = room(acc, m)
        F = np.empty((m, 3))
        bad = merge(p0, p1, self.lists, self.g_end, acc.sources, i, j, r, F, D)
        self.require_finite(bad)
        # No G: the force is not along the bond.
        return Bonds(i[:m], j[:m], r[:m], np.full(m, np.nan), D if acc.sources else None, F)


def nep(path, types=None) -> Potential:
    """A neuroevolution potential (NEP2, NEP3, NEP4, NEP5) from its ``nep.txt``.

    Stress and heat flux are those of the model's own gradients (see `atc.decomposers.nep.NEP`): momentum and energy are
    in balance to rounding. Needs nothing but numba.

    Parameters
    ----------
    path : the file, as GPUMD's ``nep`` writes it
    types : the element of each atom type from 1, in the file's names, e.g. ``["Te", "Pb"]``; None or "NULL" for types
        that do not interact. Default: by the names that the trajectory has for its types; a file of one element needs
        none.

    Returns
    -------
    Potential, of lengths in Å and energies in eV

    Raises
    ------
    AtcError for files that are not such a potential, elements that it does not have.

    Examples
    --------
    >>> pot = atc.nep("nep.txt")                                                            # doctest: +SKIP
    >>> atc.fields("run.xyz", pot, atc.kernel("quartic", 8.0), grid, ["stress", "heat_flux"])  # doctest: +SKIP
    """
    from pathlib import Path

    term = NEP(read_nep(path), types, Path(path).name)
    pot = Potential([term], "metal")
    pot.learned = "nep", term.where, {"types": term.elements}
    return pot
