"""Coulomb pair styles without a long-range part: cut, damped shifted force, Wolf; and Lennard-Jones with them."""

from __future__ import annotations

from math import erfc

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import units as get_units
from ..registry import StyleInput, pair_style
from .input import named, one_cutoff_each
from .pairs import PairStyle

_SQRT_PI = np.sqrt(np.pi)


class CoulombCut(PairStyle):
    """U = C q_i q_j/(ε d) for d < cutoff (LAMMPS ``coul/cut``), C the Coulomb constant of the unit style.

    Parameters
    ----------
    cutoff : float, or symmetric (n, n) array for types 1..n; 0 = no interaction
    units : unit style of the cutoff and of the constant
    dielectric : ε
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "coul/cut"
    weight = "coul"
    needs_charges = True
    numbers = (("cutoff", "length"),)

    def __init__(self, cutoff, *, units, dielectric: float = 1.0, n_types: int | None = None):
        self._take((cutoff,), units, n_types, False)
        self.constant = get_units(units).coulomb / dielectric

    def fill(self, cutoff, shift):
        self._set(cutoff)

    def prepare(self, frame):
        return frame.charges

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _coul_cut(types, i, j, d2, weights, self.table, self.constant, prepared, U, G)


class _Damped(PairStyle):
    """One damping for all pairs of types; atoms have a self energy; excluded pairs lose the full Coulomb energy, not
    the damped one."""

    weight = "coul"
    needs_charges = True
    keeps_excluded = True
    numbers = (("cutoff", "length"),)

    def __init__(self, alpha, cutoff, *, units, dielectric: float = 1.0, n_types: int | None = None):
        u = get_units(units)
        if np.ndim(cutoff) or np.ndim(alpha):
            raise AtcError(f"{type(self).__name__}: alpha and the cutoff are one number for all types")
        self._take((cutoff,), units, n_types, False)
        self._damp(alpha / u.length, u.to_internal("length", cutoff), u.coulomb / dielectric)

    def fill(self, cutoff, shift):
        self._set(cutoff)

    @classmethod
    def everywhere(cls, on, alpha, cutoff, constant):
        """On the pairs of types `on` ((n_types + 1, n_types + 1) bool); internal units."""
        style = cls.internal(np.where(on, cutoff, 0.0))
        style._damp(alpha, cutoff, constant)
        return style

    def prepare(self, frame):
        return frame.charges

    def self_energy(self, frame):
        q = np.where(self.active()[frame.types], frame.charges, 0.0)
        return -(self.e_shift / 2.0 + self.alpha / _SQRT_PI) * self.constant * q * q


class CoulombDSF(_Damped):
    """Damped shifted force: U = C q_i q_j [erfc(αd)/d − e_s − (d) f_s], force zero at the cutoff (LAMMPS ``coul/dsf``;
    Fennell & Gezelter 2006).

    e_s and f_s are LAMMPS's e_shift and f_shift; each atom has the energy −(e_s/2 + α/√π) C q². erfc is LAMMPS's
    rational approximation (Abramowitz & Stegun 7.1.26, 1.5e-7), so that energies and forces are LAMMPS's.

    Parameters
    ----------
    alpha : float, 1/length. cutoff : float. units : unit style of both and of the Coulomb constant. dielectric : float.
    n_types : number of types (default 1)
    """

    name = "coul/dsf"
    approximate = True

    def _damp(self, alpha, cutoff, constant):
        self.alpha, self.constant = alpha, constant
        a, b = erfc(alpha * cutoff), np.exp(-((alpha * cutoff) ** 2))
        self.f_shift = -(a / cutoff**2 + 2.0 / _SQRT_PI * alpha * b / cutoff)
        self.e_shift = a / cutoff - self.f_shift * cutoff

    def add(self, types, i, j, d2, weights, U, G, prepared):
        damping = self.alpha, self.e_shift, self.f_shift
        _dsf(types, i, j, d2, weights, self.table, self.constant, *damping, self.approximate, prepared, U, G)


class CoulombDSFExact(CoulombDSF):
    """`CoulombDSF` with erfc to all digits, as LAMMPS has it in ``born/coul/dsf``."""

    approximate = False


class CoulombWolf(_Damped):
    """Wolf's damped and shifted sum: U = C q_i q_j [erfc(αd)/d − erfc(αr_c)/r_c], force shifted to zero at the cutoff
    too (LAMMPS ``coul/wolf``).

    The force is not the derivative of this energy (it is shifted, the energy only by a constant): LAMMPS's, and Wolf's,
    choice. Each atom has the energy −[erfc(αr_c)/(2 r_c) + α/√π] C q².

    Parameters
    ----------
    alpha : float, 1/length. cutoff : float. units : unit style of both and of the Coulomb constant. dielectric : float.
    n_types : number of types (default 1)
    """

    name = "coul/wolf"

    def _damp(self, alpha, cutoff, constant):
        self.alpha, self.constant = alpha, constant
        self.e_shift = erfc(alpha * cutoff) / cutoff
        self.f_shift = -(self.e_shift + 2.0 * alpha / _SQRT_PI * np.exp(-((alpha * cutoff) ** 2))) / cutoff

    def add(self, types, i, j, d2, weights, U, G, prepared):
        damping = self.alpha, self.e_shift, self.f_shift
        _wolf(types, i, j, d2, weights, self.table, self.constant, *damping, prepared, U, G)


def coulomb_constant(inp: StyleInput) -> float:
    """C/ε of the model, internal units."""
    return inp.units.coulomb / inp.dielectric


def cut_style(inp: StyleInput, cutoff) -> CoulombCut:
    """A composite style's ``coul/cut`` part."""
    style = CoulombCut.internal(cutoff)
    style.constant = coulomb_constant(inp)
    return style


@pair_style("coul/cut", "coul/cut/global")
def _coul_cut_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    return cut_style(inp, one_cutoff_each(inp, rc, own=inp.name == "coul/cut"))


def positive(inp: StyleInput, cutoff: float) -> float:
    """The cutoff of the Coulomb part; raises AtcError unless it is positive."""
    inp.require(None if cutoff > 0 else "the Coulomb cutoff must be positive")
    return cutoff


def wanted_pairs(inp: StyleInput):
    """The Coulomb part acts wherever the style does, also on pairs of types whose Lennard-Jones cutoff is 0."""
    on = np.zeros((inp.n_types + 1, inp.n_types + 1), bool)
    on[1:, 1:] = True
    return on if inp.wanted is None else on & inp.wanted


def _damped(cls, *names):
    def build(inp: StyleInput):
        alpha, rc = inp.numbers(inp.args, [("alpha", {"length": -1}), ("cutoff", "length")])
        return cls.everywhere(named(inp) > 0, alpha, positive(inp, rc), coulomb_constant(inp))

    pair_style(*names)(build)


_damped(CoulombDSF, "coul/dsf")
_damped(CoulombWolf, "coul/wolf", "coul/wolf/cs")


@njit(cache=True, nogil=True, error_model="numpy")
def _coul_cut(types, i, j, d2, weights, table, constant, q, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p, k = i[b], j[b]
        if d2[b] < table[types[p], types[k], 0]:
            w = weights[b] if weighted else 1.0
            u = w * constant * q[p] * q[k] / np.sqrt(d2[b])
            U[b] += u
            G[b] -= u / d2[b]


@njit(cache=True, nogil=True, error_model="numpy")
def _dsf(types, i, j, d2, weights, table, constant, alpha, e_shift, f_shift, approximate, q, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p, k = i[b], j[b]
        if d2[b] < table[types[p], types[k], 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            c = constant * q[p] * q[k] / d
            gauss = np.exp(-alpha * alpha * d2[b])
            if approximate:
                # Abramowitz & Stegun 7.1.26, as LAMMPS has it.
                t = 1.0 / (1.0 + 0.3275911 * alpha * d)
                erfc_ = (
                    t
                    * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
                    * gauss
                )
            else:
                erfc_ = erfc(alpha * d)
            lost = 1.0 - w if w < 1.0 else 0.0
            U[b] += c * (erfc_ - d * e_shift - d2[b] * f_shift - lost)
            G[b] -= c * (erfc_ + (2.0 / np.sqrt(np.pi) * alpha * gauss + d * f_shift) * d - lost) / d2[b]


@njit(cache=True, nogil=True, error_model="numpy")
def _wolf(types, i, j, d2, weights, table, constant, alpha, e_shift, f_shift, q, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p, k = i[b], j[b]
        if d2[b] < table[types[p], types[k], 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            c = constant * q[p] * q[k] / d
            erfc_ = erfc(alpha * d)
            lost = 1.0 - w if w < 1.0 else 0.0
            U[b] += c * (erfc_ - e_shift * d - lost)
            slope = erfc_ / d2[b] + 2.0 * alpha / np.sqrt(np.pi) * np.exp(-alpha * alpha * d2[b]) / d + f_shift
            G[b] -= c * (slope - lost / d2[b])
