"""Ziegler-Biersack-Littmark screened nuclear repulsion."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...units import Units
from ...units import units as get_units
from ..registry import StyleInput, pair_style
from .gromacs import joined_to_zero
from .input import as_matrix, fill
from .loop import pair_law
from .radial import RadialStyle

# The universal screening function and length of Ziegler, Biersack, Littmark (1985), with LAMMPS's digits.
_C = np.array([0.02817, 0.28022, 0.50986, 0.18175])
_D = np.array([0.20162, 0.40290, 0.94229, 3.19980])
_POWER = 0.23
_A0 = 0.46850  # Å

# LAMMPS's own sizes of the electron's charge and of an Å (Update::set_units), so that energies agree to rounding.
_ELECTRON = {"si": 1.6021765e-19, "cgs": 4.8032044e-10, "micro": 1.6021765e-7}
_ANGSTROM = {"si": 1e-10, "cgs": 1e-8, "micro": 1e-4, "nano": 0.1, "electron": 1.88972612}


class ZBL(RadialStyle):
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
    shifts = False
    numbers = (("z_i", "dimensionless"), ("z_j", "dimensionless"), ("inner", "length"), ("cutoff", "length"))

    def __init__(self, z, inner, outer, *, units):
        if not 0 < inner < outer:
            raise AtcError(f"ZBL: expected 0 < inner < outer, got inner {inner} and outer {outer}")
        z = np.atleast_1d(np.asarray(z, float))
        self.units, on = get_units(units), as_matrix(1.0, len(z))
        zi = np.zeros_like(on)
        zi[1:, 1:] = z[:, None]
        inner, outer = (self.units.to_internal("length", r) for r in (inner, outer))
        self.fill(zi, zi.T, on * inner, on * outer, shift=False)

    @classmethod
    def of(cls, inp: StyleInput, *arrays):
        style = cls.__new__(cls)
        style.units = inp.units
        style.fill(*arrays, shift=False)
        return style

    def columns(self, zi, zj, inner, outer):
        u = self.units
        a0 = u.to_internal("length", _A0 * _ANGSTROM.get(u.name, 1.0))
        e2 = u.coulomb * u.to_internal("charge", _ELECTRON.get(u.name, 1.0)) ** 2
        k, c = _D[:, None, None] * (zi**_POWER + zj**_POWER) / a0, _C[:, None, None] * zi * zj * e2
        x = c * np.exp(-k * outer)
        f0 = x.sum(0) / outer
        f1 = -(k * x).sum(0) / outer - f0 / outer
        f2 = ((k * k * x).sum(0) + 2 * (k * x).sum(0) / outer + 2 * x.sum(0) / outer**2) / outer
        return *c, *k, *joined_to_zero(f0, f1, f2, inner, outer), inner

    @pair_law
    def law(d2, c1, c2, c3, c4, k1, k2, k3, k4, A, B, C, inner):
        d = np.sqrt(d2)
        s = 1.0 / d
        x1, x2, x3, x4 = c1 * np.exp(-k1 * d), c2 * np.exp(-k2 * d), c3 * np.exp(-k3 * d), c4 * np.exp(-k4 * d)
        u = (x1 + x2 + x3 + x4) * s + C
        du = -(x1 * (k1 + s) + x2 * (k2 + s) + x3 * (k3 + s) + x4 * (k4 + s)) * s
        t = d - inner
        if t > 0.0:
            u += t * t * t * (A + B * t)
            du += t * t * (3.0 * A + 4.0 * B * t)
        return u, du * s


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
    return ZBL.of(inp, zi, zj, on * inner, on * outer)
