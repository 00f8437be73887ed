"""Coulomb pair styles without a long-range part: cut, damped shifted force, Wolf; and Lennard-Jones with them."""

from __future__ import annotations

from math import erfc

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import units as get_units
from ..registry import StyleInput, pair_style
from .input import as_matrix, named, one_cutoff_each
from .loop import pair_law
from .radial import CUTOFF, ChargedStyle

_SQRT_PI = np.sqrt(np.pi)


class CoulombCut(ChargedStyle):
    """U = C q_i q_j/(ε d) for d < cutoff (LAMMPS ``coul/cut``). Numbers: cutoff; see `ChargedStyle`."""

    name = "coul/cut"
    numbers = (CUTOFF,)

    @pair_law
    def law(d2, c):
        u = c / np.sqrt(d2)
        return u, -u / d2


class _Damped(ChargedStyle):
    """One damping for all pairs of types; atoms have a self energy; excluded pairs lose the full Coulomb energy, not
    the damped one. The law's coefficients are α, and what shifts energy and force.

    Parameters
    ----------
    alpha : float, 1/length. cutoff : float. units : unit style of both and of the Coulomb constant. dielectric : float.
    n_types : number of types (default 1)
    """

    keeps_excluded = True

    def __init__(self, alpha, cutoff, *, units, dielectric: float = 1.0, n_types: int | None = None):
        self.units = u = get_units(units)
        if np.ndim(cutoff) or np.ndim(alpha):
            raise AtcError(f"{type(self).__name__}: alpha and the cutoff are one number for all types")
        if not (np.isfinite(cutoff) and cutoff > 0):
            raise AtcError(f"{type(self).__name__}: the cutoff must be positive, got {cutoff}")
        on = as_matrix(1.0, n_types or 1)
        self._damp(on, alpha / u.length, u.to_internal("length", cutoff), u.coulomb / dielectric)

    @classmethod
    def everywhere(cls, on, alpha, cutoff, constant):
        """On the pairs of types `on` ((n_types + 1, n_types + 1) bool); internal units."""
        style = cls.__new__(cls)
        style._damp(on, alpha, cutoff, constant)
        return style

    def _damp(self, on, alpha, cutoff, constant):
        self.alpha, self.constant = alpha, constant
        self.e_shift, self.f_shift = self.shifts(alpha, cutoff)
        self._set(np.where(on, cutoff, 0.0), alpha, self.e_shift, self.f_shift)

    @staticmethod
    def shifts(alpha, cutoff) -> tuple[float, float]:
        """e_s and f_s."""
        raise NotImplementedError

    def self_energy(self, frame):
        q = np.where(self.active()[frame.types], frame.charges, 0.0)
        return -(self.e_shift / 2.0 + self.alpha / _SQRT_PI) * self.constant * q * q


@njit(nogil=True, error_model="numpy", inline="always")
def _shifted_force(d2, d, c, erfc_, gauss, alpha, e_shift, f_shift):
    """U and U'/d of the damped shifted force."""
    return c / d * (erfc_ - d * e_shift - d2 * f_shift), -(c / d) * (
        erfc_ + (2.0 / np.sqrt(np.pi) * alpha * gauss + d * f_shift) * d
    ) / d2


class CoulombDSF(_Damped):
    """Damped shifted force: U = C q_i q_j [erfc(αd)/d − e_s − (d) f_s], force zero at the cutoff (LAMMPS ``coul/dsf``;
    Fennell & Gezelter 2006). Parameters: see `_Damped`.

    e_s and f_s are LAMMPS's e_shift and f_shift; each atom has the energy −(e_s/2 + α/√π) C q². erfc is LAMMPS's
    rational approximation (Abramowitz & Stegun 7.1.26, 1.5e-7), so that energies and forces are LAMMPS's.
    """

    name = "coul/dsf"

    @staticmethod
    def shifts(alpha, cutoff):
        a, b = erfc(alpha * cutoff), np.exp(-((alpha * cutoff) ** 2))
        f_shift = -(a / cutoff**2 + 2.0 / _SQRT_PI * alpha * b / cutoff)
        return a / cutoff - f_shift * cutoff, f_shift

    @pair_law
    def law(d2, c, alpha, e_shift, f_shift):
        d = np.sqrt(d2)
        gauss = np.exp(-alpha * alpha * d2)
        t = 1.0 / (1.0 + 0.3275911 * alpha * d)
        s = 0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))
        return _shifted_force(d2, d, c, t * s * gauss, gauss, alpha, e_shift, f_shift)


class CoulombDSFExact(CoulombDSF):
    """`CoulombDSF` with erfc to all digits, as LAMMPS has it in ``born/coul/dsf``."""

    @pair_law
    def law(d2, c, alpha, e_shift, f_shift):
        d = np.sqrt(d2)
        return _shifted_force(d2, d, c, erfc(alpha * d), np.exp(-alpha * alpha * d2), alpha, e_shift, f_shift)


class CoulombWolf(_Damped):
    """Wolf's damped and shifted sum: U = C q_i q_j [erfc(αd)/d − erfc(αr_c)/r_c], force shifted to zero at the cutoff
    too (LAMMPS ``coul/wolf``). Parameters: see `_Damped`.

    The force is not the derivative of this energy (it is shifted, the energy only by a constant): LAMMPS's, and Wolf's,
    choice. Each atom has the energy −[erfc(αr_c)/(2 r_c) + α/√π] C q².
    """

    name = "coul/wolf"

    @staticmethod
    def shifts(alpha, cutoff):
        e_shift = erfc(alpha * cutoff) / cutoff
        return e_shift, -(e_shift + 2.0 * alpha / _SQRT_PI * np.exp(-((alpha * cutoff) ** 2))) / cutoff

    @pair_law
    def law(d2, c, alpha, e_shift, f_shift):
        d = np.sqrt(d2)
        erfc_ = erfc(alpha * d)
        slope = erfc_ / d2 + 2.0 * alpha / np.sqrt(np.pi) * np.exp(-alpha * alpha * d2) / d + f_shift
        return c / d * (erfc_ - e_shift * d), -(c / d) * slope


@pair_style("coul/cut", "coul/cut/global")
def _coul_cut_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [CUTOFF])
    return CoulombCut.of(inp, one_cutoff_each(inp, rc, own=inp.name == "coul/cut"))


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
        return cls.everywhere(named(inp) > 0, alpha, positive(inp, rc), inp.coulomb)

    pair_style(*names)(build)


_damped(CoulombDSF, "coul/dsf")
_damped(CoulombWolf, "coul/wolf", "coul/wolf/cs")
