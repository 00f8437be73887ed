"""Colloids: spheres that are continua of Lennard-Jones particles, among each other and in a solvent of such
particles."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ..registry import StyleInput, pair_style
from .loop import pair_law
from .radial import RadialStyle, mix_lj_distances, one_cutoff


class Colloid(RadialStyle):
    """Hamaker's attraction and the integrated repulsion of two spheres with diameters d1 and d2 (LAMMPS ``colloid``;
    Everaers & Ejtehadi, PRE 67, 041710).

    A diameter of 0 is a solvent particle: of the two, one or none may be a sphere. The sizes are coefficients, not the
    atoms' own. Numbers: A (Hamaker constant), sigma, d1, d2, cutoff; see `RadialStyle`.
    """

    name = "colloid"
    numbers = (("A", "energy"), ("sigma", "length"), ("d1", "length"), ("d2", "length"), ("cutoff", "length"))

    def columns(self, A, sigma, d1, d2, cutoff):
        # The order of the two does not matter; the law finds the larger one first.
        return A, sigma, 0.5 * np.maximum(d1, d2), 0.5 * np.minimum(d1, d2)

    def trouble(self, ti, tj, d):
        if d <= self.table[ti, tj, 3:5].sum():
            return (
                "the colloidal particles overlap (pair_style colloid): their distance is less than the sum of their "
                "radii"
            )
        return None

    @pair_law
    def law(d2, A, sigma, a1, a2):
        if a1 == 0.0:
            return _solvent(d2, A, sigma)
        if d2 <= (a1 + a2) * (a1 + a2):
            return np.nan, np.nan
        if a2 == 0.0:
            return _sphere_solvent(d2, A, sigma, a1)
        return _two_spheres(np.sqrt(d2), A, sigma, a1, a2)


_from_lines = one_cutoff(
    Colloid,
    mix=mix_lj_distances,
    check=lambda *v: (
        None if v[1] > 0 and v[2] >= 0 and v[3] >= 0 else "sigma must be positive and the diameters not negative"
    ),
)


@pair_style("colloid")
def _colloid_style(inp: StyleInput):
    style = _from_lines(inp)
    for line in inp.coeffs:
        if any(i == j for i, j in line.covers(inp.n_types)) and float(line.words[2]) != float(line.words[3]):
            raise inp.wrong(f"{inp.command}: d1 and d2 must be equal for a type with itself", line)
    return style


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _solvent(d2, A, sigma):
    """U and U'/d of two solvent particles."""
    s2 = sigma * sigma / d2
    s6 = s2 * s2 * s2
    return A / 36.0 * (s6 * s6 - s6), -A / 36.0 * (12.0 * s6 * s6 - 6.0 * s6) / d2


@njit(cache=True, nogil=True, error_model="numpy")
def _sphere_solvent(d2, A, sigma, a):
    """U and U'/d of a sphere of radius a and a solvent particle."""
    a2 = a * a
    s3 = sigma * sigma * sigma
    i = 1.0 / (a2 - d2)
    i3 = i * i * i
    k = 2.0 / 9.0 * a * a2 * s3 * A * i3
    n = (
        s3
        * s3
        * (5.0 * a2 * a2 * a2 + 45.0 * a2 * a2 * d2 + 63.0 * a2 * d2 * d2 + 15.0 * d2 * d2 * d2)
        / 15.0
        * i3
        * i3
    )
    slope = s3 * s3 * (90.0 * a2 * a2 + 252.0 * a2 * d2 + 90.0 * d2 * d2) / 15.0 * i3 * i3
    return k * (1.0 - n), k * (6.0 * i - slope - 18.0 * n * i)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _part(d, k, c):
    """(d² + 7kd + c)/(d + k)⁷ and its slope."""
    s = 1.0 / (d + k)
    s7 = s**7
    p = d * d + 7.0 * k * d + c
    return p * s7, (2.0 * d + 7.0 * k - 7.0 * p * s) * s7


@njit(cache=True, nogil=True, error_model="numpy")
def _two_spheres(d, A, sigma, a1, a2):
    """U and U'/d of two spheres."""
    add, sub, product = a1 + a2, a1 - a2, a1 * a2
    x = 1.0 / (d * d - add * add)
    y = 1.0 / (d * d - sub * sub)
    u = -A / 6.0 * (2.0 * product * (x + y) + np.log(y / x))
    g = -A / 6.0 * (-4.0 * product * (x * x + y * y) + 2.0 * (x - y))
    near = 6.0 * (a1 * a1 + a2 * a2)
    p1, q1 = _part(d, -add, near + 42.0 * product)
    p2, q2 = _part(d, add, near + 42.0 * product)
    p3, q3 = _part(d, sub, near - 42.0 * product)
    p4, q4 = _part(d, -sub, near - 42.0 * product)
    k = A / 37800.0 * sigma**6 / d
    p, q = p1 + p2 - p3 - p4, q1 + q2 - q3 - q4
    return u + k * p, g + k * (q - p / d) / d
