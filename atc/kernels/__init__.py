"""Localisation functions φ and their bond functions β (formulas: R 4.0.56-4.0.90).

φ ≥ 0, ∫φ = 1. The bond function of a bond that runs from x_i to x_i − r, seen from x, is the mean of φ along it,
β(x) = ∫₀¹ φ(x_i − t r − x) dt, so that φ_j − φ_i is the divergence of r β and ∫β = 1.

A family is one file: `shapes` (polynomials of the distance; their formulas are in `radial`), `table`, `gaussian`,
`bspline`, `box`, `trilinear`. What it has to say of itself is in `base`, what it may share with others in `profile`
(integrals over planes), `disc` (those of planar kernels) and `lanes` (β in fours).
"""

from __future__ import annotations

from ..errors import AtcError
from .base import TINY, Compiled, Family, Kernel, Profile
from .box import Box
from .bspline import BSpline
from .gaussian import CutGaussian, Gaussian, GaussianMarginal
from .profile import Marginal
from .radial import Radial
from .shapes import SHAPES, Shape
from .table import Table
from .trilinear import Trilinear

__all__ = [
    "FAMILIES",
    "NAMES",
    "TINY",
    "BSpline",
    "Box",
    "Compiled",
    "CutGaussian",
    "Family",
    "Gaussian",
    "GaussianMarginal",
    "Kernel",
    "Marginal",
    "Profile",
    "Radial",
    "Shape",
    "Trilinear",
    "kernel",
    "known",
    "register",
]

#: What is known, by its name.
FAMILIES: dict[str, Family] = {}


def register(family: Family) -> Family:
    """Make a family of kernels known by its name and aliases, to `kernel` and to scenes. Also a decorator of a class of
    kernels.

    Raises
    ------
    AtcError
        If a name is taken by another family.
    """
    for name in (family.name, *family.aliases):
        for other in FAMILIES.values():
            if other.name != family.name and name in (other.name, *other.aliases):
                raise AtcError(f"kernel {name!r} is known already: give the family another name")
    FAMILIES[family.name] = family
    return family


for _family in (*SHAPES, Table(), Gaussian, BSpline, Box, Trilinear):
    register(_family)

#: Those of this package.
NAMES = tuple(FAMILIES)


def known() -> list[str]:
    """Every name that `kernel` takes."""
    return [*FAMILIES, *(alias for family in FAMILIES.values() for alias in family.aliases)]


def kernel(name, radius=None, *, width=None, size=None, table=None, dimension=None) -> Kernel:
    """Make a localisation function φ with ∫φ = 1, in the user's unit of length.

    Parameters
    ----------
    name : str
        ``"step"``, ``"linear"`` 1 − s, ``"cubic"`` 1 − 3s² + 2s³, ``"quartic"`` (1 − s²)², ``"lucy"`` (1 − s)³(1 + 3s),
        ``"hardy"`` (1 up to R/2, then falling linearly to 0 at R; MDStressLab's), with s = r/R; ``"piecewise-linear"``
        through `table`; ``"gaussian"`` exp(−r²/2w²); ``"bspline"``, the product of a cubic B-spline along each axis;
        ``"box"``, constant in a half-open box, −L/2 ≤ x_j − x < L/2 (LAMMPS fix atc's ``cell``); ``"trilinear"``, the
        product of a hat 1 − |x_j − x|/h along each axis (the shape functions of LAMMPS fix atc's elements); or one that
        was registered.
    radius : float
        R, where φ ends. For ``gaussian`` it sets the width w = R/3 (the Gaussian itself goes on to 8.6 w, where it is
        1e-16 of its peak); for ``bspline`` it is the half support along each axis (two knot spacings), for
        ``trilinear`` too; for ``box`` half the edge of a cube.
    width : float
        The Gaussian's w, its standard deviation along each axis.
    size : three floats
        The box's edge lengths; the edge lengths h of the elements of ``trilinear``, which reaches one to either side;
        two with ``dimension=2``.
    table : sequence of (r, value)
        Values of φ at increasing r, up to a common factor; linear in between, constant before the first, 0 after the
        last.
    dimension : 2 or 3
        2: normalised in the plane, ∫φ dA = 1, for two-dimensional runs. Not given: what the run is, when the kernel is
        used.

    Raises
    ------
    AtcError
        For an unknown name, a length that is not positive and finite, or parameters that do not belong to the kernel.

    Notes
    -----
    ``cubic``, ``quartic`` and ``step`` are LAMMPS fix atc's ``cubic_sphere``, ``quartic_sphere`` and ``step``.
    """
    if dimension is not None and (isinstance(dimension, bool) or dimension not in (2, 3)):
        raise AtcError(f"kernel {name!r}: dimension must be 2 or 3, got {dimension!r}")
    if isinstance(name, Kernel):
        return name if dimension is None else name.in_dimension(dimension)
    family = next((f for f in FAMILIES.values() if isinstance(name, str) and name in (f.name, *f.aliases)), None)
    if family is None:
        raise AtcError(f"unknown kernel {name!r}: expected one of {', '.join(FAMILIES)}")
    given = {k: v for k, v in (("radius", radius), ("width", width), ("size", size), ("table", table)) if v is not None}
    takes = family.takes
    for k in given:
        if k not in takes:
            raise AtcError(f"kernel {family.name!r} does not take {k}: give {' or '.join(takes)}")
    if len(given) != 1:
        raise AtcError(
            f"kernel {family.name!r} needs {'exactly one of ' if len(takes) > 1 else ''}{' and '.join(takes)}"
        )
    kern = family.of(dimension, **given)
    return kern if dimension is None else kern.in_dimension(dimension)
