"""Neuroevolution potentials (NEP): energies of atoms as a small network of what their neighbours look like.

How a frame is done is in `edges`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...errors import AtcError, located
from ...frame import Frame
from ...units import units as system
from ..potentials import Potential
from ..registry import pair_style
from .edges import Edges
from .elements import SYMBOLS, ElementMap, mapped_line
from .nep_file import NEPFile, read_nep
from .nep_kernels import centres, coupling, norms

#: The number of the invariant of five bodies, (1, 1, 1, 1), is found by its degrees.
_FIVE = (1, 1, 1, 1)
#: The universal screening function: factors and exponents; exponents are over a, 1/a = (Z_i^0.23 + Z_j^0.23)/0.46848 Å.
_FACTORS, _EXPONENTS = (0.18175, 0.50986, 0.28022, 0.02817), (3.1998, 0.94229, 0.4029, 0.20162)
_INVERSE_A, _POWER = 2.134563, 0.23
#: e²/4πε0 in eV Å, with GPUMD's digits.
_COULOMB = 14.399645


class NEP(Edges):
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
    reference : see `nep`

    Notes
    -----
    Source: Fan, Zeng, Zhang et al., Phys. Rev. B 104, 104309 (2021); Fan, J. Phys.: Condens. Matter 34, 125902 (2022);
    Fan, Wang, Ying et al., J. Chem. Phys. 157, 114801 (2022); Song, Zhao, Liu et al., Nat. Commun. 15, 10208 (2024).
    """

    style = "NEP"

    def __init__(self, file: NEPFile, elements=None, where: str = "nep.txt", reference=None):
        self.model, self.where = file, where
        self.elements = None if elements is None else [None if e in (None, "NULL") else str(e) for e in elements]
        if self.elements is not None:
            ElementMap(self.elements, file.names, where)  # which says what is wrong with them
        u = system("metal")
        self.length, self.energy = float(u.length), float(u.energy)
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
        self.b1, self.reference = self._relative(reference)
        self.w0 = np.ascontiguousarray(file.w0_thd * file.scale_d)
        self.c_radial, self.c_angular = (
            np.ascontiguousarray(c.transpose(0, 1, 3, 2)) for c in (file.c_radial, file.c_angular)
        )

    def _relative(self, reference) -> tuple[np.ndarray, str]:
        """b1 with the energies of single atoms in it, and what to say of them."""
        b0, w1, b1 = self.model.b0_th, self.model.w1_th, self.model.b1_t
        if reference is None:
            return b1, "the model's own zero, which may hold energies of single atoms (b1)"
        if reference == "isolated":
            alone = -(w1 * np.tanh(b0)).sum(1) - b1
        elif not isinstance(reference, Mapping):
            raise AtcError(
                f'{self.where}: reference must be "isolated", or energies of atoms in eV to subtract, e.g. '
                f'{{"{self.model.names[0]}": -4.6}}, got {reference!r}'
            )
        else:
            odd = next((k for k in reference if k not in self.model.names), None)
            if odd is not None:
                raise AtcError(f"{self.where}: reference: no element {odd!r}: it has {', '.join(self.model.names)}")
            try:
                alone = np.array([float(reference.get(name, 0.0)) for name in self.model.names])
            except (TypeError, ValueError):
                alone = np.array([np.nan])
            if not np.isfinite(alone).all():
                raise AtcError(f"{self.where}: reference: expected an energy for each element, got {reference!r}")
        said = ", ".join(f"{name} {e:.10g}" for name, e in zip(self.model.names, alone))
        return b1 + alone, f"energies of atoms less {said} eV"

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

    def centres(self, work, task, g_end, energies) -> float:
        file = self.model
        radial, angular = (file.rc_radial, self.c_radial), (file.rc_angular, self.c_angular)
        invariants = file.l_max, self.norm, self.abc, self.C, self.which, self.fifth, len(file.many)
        network, units = (self.w0, file.b0_th, file.w1_th, self.b1), (self.length, self.energy)
        around = *work.atoms(task), work.near.most(task)[0], work.lists
        return centres(*around, radial, angular, invariants, network, self.core, units, g_end, energies)


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


@pair_style("nep", "nep/cpu", mapped=True)
def _nep_style(inp):
    """``pair_style nep`` with ``pair_coeff * * nep.txt Te Pb``, or the older ``pair_style nep nep.txt`` with
    ``pair_coeff * *``, where types have the file's order."""
    if inp.units.name != "metal":
        raise inp.error(f"{inp.command} is for units metal, not {inp.units.name}")
    if not inp.args:
        path, elements, line = mapped_line(inp, " nep.txt")
        return NEP(_read_here(path, line.where), elements, path.name)
    if len(inp.args) > 1 or len(inp.coeffs) != 1 or inp.coeffs[0].words:
        raise inp.error(
            f"{inp.command}: expected pair_coeff * * nep.txt and the element of each atom type, or the file behind "
            "pair_style nep and pair_coeff * * alone"
        )
    path = inp.path(inp.args[0])
    file = _read_here(path, inp.where)
    return NEP(file, file.names, path.name)


def _read_here(path, where) -> NEPFile:
    with located(where):
        return read_nep(path)


def nep(path, types=None, reference=None) -> Potential:
    """A neuroevolution potential (NEP2, NEP3, NEP4, NEP5) from its ``nep.txt``.

    Stress and heat flux are those of the model's own gradients (see `nep.NEP`): momentum and energy are
    in balance to rounding. Needs nothing but numba.

    Parameters
    ----------
    path : the file, as GPUMD's ``nep`` writes it
    types : the element of each atom type from 1, in the file's names, e.g. ``["Te", "Pb"]``; None or "NULL" for types
        that do not interact. Default: by the names that the trajectory has for its types; a file of one element needs
        none.
    reference : energies of single atoms to subtract: "isolated", the model's own of an atom without neighbours, or
        {element: eV}. Default: none. They carry heat with atoms that diffuse: the heat flux of a mixture depends on
        them, forces and stress do not.

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

    term = NEP(read_nep(path), types, Path(path).name, reference)
    pot = Potential([term], "metal")
    pot.learned = "nep", term.where, {"types": term.elements, "reference": reference}
    return pot
