"""Ziegler-Biersack-Littmark screened nuclear repulsion."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ...units import units as get_units
from ..registry import StyleInput, pair_style
from .input import fill
from .pairs import PairStyle

# The universal screening function and length of Ziegler, Biersack, Littmark (1985), with LAMMPS's digits.
_C = np.array([0.02817, 0.28022, 0.50986, 0.18175])
_D = np.array([0.20162, 0.40290, 0.94229, 3.19980])
_POWER = 0.23
_A0 = 0.46850  # Å

# LAMMPS's own sizes of the electron's charge and of an Å (Update::set_units), so that energies agree to rounding.
_ELECTRON = {"si": 1.6021765e-19, "cgs": 4.8032044e-10, "micro": 1.6021765e-7}
_ANGSTROM = {"si": 1e-10, "cgs": 1e-8, "micro": 1e-4, "nano": 0.1, "electron": 1.88972612}


class ZBL(PairStyle):
    """U = (z_i z_j e²/d) Σ c_k e^{−d_k d/a} + S(d) for d < outer, a = 0.4685 Å/(z_i^0.23 + z_j^0.23) (LAMMPS ``zbl``).

    S is a constant for d ≤ inner and a quartic polynomial of d − inner beyond, such that U, U' and U'' vanish at the
    outer cutoff.

    Parameters
    ----------
    z : float or (n,) array, nuclear charges of types 1..n in elementary charges
    inner, outer : float, where switching starts and the cutoff
    units : unit style of inner and outer, and of LAMMPS's Coulomb constant
    """

    name = "zbl"
    weight = None

    def __init__(self, z, inner, outer, *, units):
        u = get_units(units)
        z = np.atleast_1d(np.asarray(z, float))
        n = len(z)
        if not 0 < inner < outer:
            raise AtcError(f"ZBL: expected 0 < inner < outer, got inner {inner} and outer {outer}")
        zi = np.zeros((n + 1, n + 1))
        zj = np.zeros((n + 1, n + 1))
        zi[1:, 1:], zj[1:, 1:] = z[:, None], z[None, :]
        on = np.zeros((n + 1, n + 1), bool)
        on[1:, 1:] = True
        self._fill(zi, zj, on, u.to_internal("length", inner), u.to_internal("length", outer), u)
        self.units = u

    @classmethod
    def of_pairs(cls, zi, zj, on, inner, outer, u: Units):
        """From (n_types + 1, n_types + 1) nuclear charges and which pairs interact, internal lengths."""
        style = cls.__new__(cls)
        style._fill(zi, zj, on, inner, outer, u)
        return style

    def _fill(self, zi, zj, on, inner, outer, u):
        a0 = u.to_internal("length", _A0 * _ANGSTROM.get(u.name, 1.0))
        e2 = u.coulomb * u.to_internal("charge", _ELECTRON.get(u.name, 1.0)) ** 2
        n = len(zi)
        table = np.zeros((n, n, 13))
        for i, j in np.argwhere(on):
            k = _D * (zi[i, j] ** _POWER + zj[i, j] ** _POWER) / a0
            c = _C * zi[i, j] * zj[i, j] * e2
            x = c * np.exp(-k * outer)
            f0 = x.sum() / outer
            f1 = -(k * x).sum() / outer - f0 / outer
            f2 = ((k * k * x).sum() + 2 * (k * x).sum() / outer + 2 * x.sum() / outer**2) / outer
            t = outer - inner
            A = (-3 * f1 + t * f2) / t**2
            B = (2 * f1 - t * f2) / t**3
            C = -f0 + t / 2 * f1 - t * t / 12 * f2
            table[i, j] = [outer**2, *c, *k, A, B, C, inner]
        self.table = table

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _zbl(types, i, j, d2, self.table, U, G)


def universal_screening(u: Units, zi, zj, r):
    """Unswitched U and dU/dr of two nuclei at distance r, all in the unit style's own units."""
    a = _A0 * _ANGSTROM.get(u.name, 1.0) / (zi**_POWER + zj**_POWER)
    e2 = u.coulomb * u.charge**2 / (u.energy * u.length) * _ELECTRON.get(u.name, 1.0) ** 2 * zi * zj
    terms = [c * np.exp(-k * r / a) for c, k in zip(_C, _D, strict=True)]
    U = e2 / r * sum(terms)
    return U, -U / r - e2 / (r * a) * sum(k * t for k, t in zip(_D, terms, strict=True))


@pair_style("zbl")
def _zbl_style(inp: StyleInput):
    inner, outer = inp.numbers(inp.args, [("inner", "length"), ("outer", "length")])
    inp.require(None if 0 < inner < outer else "expected 0 < inner < outer")
    given = {}
    for line in inp.coeffs:
        z1, z2 = inp.numbers(line.words, [("z_i", "dimensionless"), ("z_j", "dimensionless")], line)
        for i, j in line.covers(inp.n_types):
            if i == j and z1 != z2:
                raise inp.error(
                    f"{inp.command}: type {i} with itself needs twice the same nuclear charge, got {z1:g} and {z2:g}",
                    line,
                )
            given[i, j] = (z1, z2, 1.0)
    zi, zj, on = fill(inp, given, 3, mix=lambda a, b, rule: (a[0], b[0], 1.0))
    return ZBL.of_pairs(zi, zj, on > 0, inner, outer, inp.units)


@njit(cache=True, nogil=True, error_model="numpy")
def _zbl(types, i, j, d2, table, U, G):
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            d = np.sqrt(d2[b])
            s = 1.0 / d
            u = 0.0
            du = 0.0
            for k in range(4):
                x = p[1 + k] * np.exp(-p[5 + k] * d)
                u += x
                du -= x * (p[5 + k] + s)
            u = u * s + p[11]
            du *= s
            t = d - p[12]
            if t > 0.0:
                u += t * t * t * (p[9] / 3.0 + p[10] / 4.0 * t)
                du += t * t * (p[9] + p[10] * t)
            U[b] += u
            G[b] += du * s
