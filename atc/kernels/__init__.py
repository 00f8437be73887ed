"""Localisation functions φ and their bond functions β (formulas: R 4.0.56-4.0.90).

φ ≥ 0, ∫φ = 1. The bond function of a bond that runs from x_i to x_i − r, seen from x, is the mean of φ along it,
β(x) = ∫₀¹ φ(x_i − t r − x) dt, so that φ_j − φ_i is the divergence of r β and ∫β = 1.

Every isotropic kernel except the Gaussian is written as a sum of *pieces*, polynomials in ρ/R_m that are cut off at
R_m: φ(ρ) = Σ_m Σ_k c_mk (ρ/R_m)^k for ρ < R_m. A cone cut at R minus a cone cut at R/2 is MDStressLab's `hardy`, and
any piecewise linear table is a sum of cones. β of a piece is closed: clip the bond to the sphere, then take the mean of
ρ^k over what is left, with ρ² = p² + u² (p the distance of x from the bond's line, u the coordinate along it).

The means J_k = (1/Δ)∫ρ^k du over [u_a, u_b] follow from J_k = [D_k + k p² J_{k−2}]/(k+1), D_k = [u ρ^k]_a^b / Δ, Δ =
u_b − u_a. Written with S = ρ_a + ρ_b and T = u_a + u_b (so ρ_b − ρ_a = Δ T/S, and asinh(u_b/p) − asinh(u_a/p) = 2
atanh(Δ/S)) every term is positive and Δ has been divided out by hand: nothing cancels for bonds of any length, tangent,
or through x.

In two dimensions (`Kernel.planar`) φ is the same function of the distance in the plane with ∫φ dA = 1. Between points
and bonds of one plane every formula above holds as it is: a planar kernel is its three-dimensional twin times a
constant. Only what is integrated differs: the normalisation, the transform (`deposit.fourier`) and the profile, φ
integrated along lines of the plane instead of planes (`atc.disc`).
"""

from __future__ import annotations

from functools import cached_property
from math import exp, isfinite, log, pi, sqrt

import numpy as np

from ..errors import AtcError

# A bond shorter than this times the radius is given this length, in a direction that no longer matters: its β is φ to
# rounding.
TINY = 1e-30
# The Gaussian is cut where it falls below this fraction of its peak.
GAUSSIAN_CUT = 1e-16

# Names as the user may write them -> canonical name.
NAMES = ("step", "linear", "cubic", "quartic", "lucy", "hardy", "piecewise-linear", "gaussian", "bspline", "box")
_ALIASES = {
    "piecewise_linear": "piecewise-linear",
    "b-spline": "bspline",
    "cell": "box",
    "cubic_sphere": "cubic",
    "quartic_sphere": "quartic",
}

# Radial shapes: [(radius as a fraction of R, coefficients of (ρ/R_m)^k)], and the normalisation times R³ (in the plane
# see `_plane_integral`).
_SHAPES = {
    "step": ([(1.0, (1.0,))], 3 / (4 * pi)),
    "linear": ([(1.0, (1.0, -1.0))], 3 / pi),
    "cubic": ([(1.0, (1.0, 0.0, -3.0, 2.0))], 15 / (4 * pi)),
    "quartic": ([(1.0, (1.0, 0.0, -2.0, 0.0, 1.0))], 105 / (32 * pi)),
    "lucy": ([(1.0, (1.0, 0.0, -6.0, 8.0, -3.0))], 105 / (16 * pi)),
    "hardy": ([(1.0, (2.0, -2.0)), (0.5, (-1.0, 1.0))], 8 / (5 * pi)),
}

_GL_T, _GL_W = (lambda x, w: (0.5 * (x + 1.0), 0.5 * w))(*np.polynomial.legendre.leggauss(8))


def kernel(name, radius=None, *, width=None, size=None, table=None, dimension=None) -> Kernel:
    """Make a localisation function φ with ∫φ = 1, in the user's unit of length.

    Parameters
    ----------
    name : str
        ``"step"``, ``"linear"`` 1 − s, ``"cubic"`` 1 − 3s² + 2s³, ``"quartic"`` (1 − s²)², ``"lucy"`` (1 − s)³(1 + 3s),
        ``"hardy"`` (1 up to R/2, then falling linearly to 0 at R; MDStressLab's), with s = r/R; ``"piecewise-linear"``
        through `table`; ``"gaussian"`` exp(−r²/2w²); ``"bspline"``, the product of a cubic B-spline along each axis;
        ``"box"``, constant in a half-open box, −L/2 ≤ x_j − x < L/2 (LAMMPS fix atc's ``cell``).
    radius : float
        R, where φ ends. For ``gaussian`` it sets the width w = R/3 (the Gaussian itself goes on to 8.6 w, where it is
        1e-16 of its peak); for ``bspline`` it is the half support along each axis (two knot spacings); for ``box`` half
        the edge of a cube.
    width : float
        The Gaussian's w, its standard deviation along each axis.
    size : three floats
        The box's edge lengths; two with ``dimension=2``.
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
    if dimension is not None:
        if isinstance(dimension, bool) or dimension not in (2, 3):
            raise AtcError(f"kernel {name!r}: dimension must be 2 or 3, got {dimension!r}")
        if name in ("box", "cell") and radius is None and np.shape(size) == (2,) and dimension == 2:
            return Box(np.array([_positive("size", e, "box") for e in size]))
        return kernel(name, radius, width=width, size=size, table=table).in_dimension(dimension)
    if isinstance(name, Kernel):
        return name
    canonical = _ALIASES.get(name, name) if isinstance(name, str) else None
    if canonical not in NAMES:
        raise AtcError(f"unknown kernel {name!r}: expected one of {', '.join(NAMES)}")
    given = {k: v for k, v in (("radius", radius), ("width", width), ("size", size), ("table", table)) if v is not None}
    allowed = {"gaussian": ("width", "radius"), "box": ("size", "radius"), "piecewise-linear": ("table",)}.get(
        canonical, ("radius",)
    )
    for k in given:
        if k not in allowed:
            raise AtcError(f"kernel {canonical!r} does not take {k}: give {' or '.join(allowed)}")
    if len(given) != 1:
        raise AtcError(
            f"kernel {canonical!r} needs {'exactly one of ' if len(allowed) > 1 else ''}{' and '.join(allowed)}"
        )
    if canonical == "gaussian":
        return Gaussian(
            _positive("width", width, canonical) if radius is None else _positive("radius", radius, canonical) / 3.0
        )
    if canonical == "box":
        if radius is not None:
            return Box(np.full(3, 2.0 * _positive("radius", radius, canonical)), given=1)
        try:
            edges = np.array(np.broadcast_to(np.asarray(size, dtype=float), (3,)))
        except (ValueError, TypeError):
            raise AtcError(
                f"kernel 'box': size must be three edge lengths (two with dimension=2), got {size!r}"
            ) from None
        return Box(np.array([_positive("size", e, canonical) for e in edges]), given=np.size(size))
    if canonical == "piecewise-linear":
        return _from_table(table)
    R = _positive("radius", radius, canonical)
    if canonical == "bspline":
        return BSpline(R)
    shape, norm = _SHAPES[canonical]
    radii = np.array([f * R for f, _ in shape])
    coef_mk = np.zeros((len(shape), 5))
    for m, (_, c) in enumerate(shape):
        coef_mk[m, : len(c)] = c
    return Radial(canonical, radii, coef_mk, norm / R**3)


def _positive(what, value, name) -> float:
    try:
        v = float(value)
    except (TypeError, ValueError):
        raise AtcError(f"kernel {name!r}: {what} must be a number, got {value!r}") from None
    if not (isfinite(v) and v > 0):
        raise AtcError(f"kernel {name!r}: {what} must be positive and finite, got {value!r}")
    return v


def _from_table(table) -> Radial:
    try:
        t = np.array(table, dtype=float)
    except (ValueError, TypeError):
        raise AtcError("kernel 'piecewise-linear': table must be a list of (r, value) pairs") from None
    if t.ndim != 2 or t.shape[1] != 2 or len(t) < 1:
        raise AtcError(f"kernel 'piecewise-linear': table must be a list of (r, value) pairs, got shape {t.shape}")
    if not np.isfinite(t).all() or (t < 0).any():
        raise AtcError("kernel 'piecewise-linear': table holds numbers that are negative or not finite")
    r, v = t.T
    if (np.diff(r) <= 0).any():
        raise AtcError("kernel 'piecewise-linear': the distances of the table must increase")
    if r[0] > 0:
        r, v = np.concatenate([[0.0], r]), np.concatenate([v[:1], v])
    if len(r) < 2 or not (v[1:] + v[:-1]).any():
        raise AtcError("kernel 'piecewise-linear': the table is zero everywhere")
    # Line m (between r_m and r_m+1) as offset + slope·ρ; a piece is the difference of neighbouring lines, cut at the
    # node between them.
    slope = np.append(np.diff(v) / np.diff(r), 0.0)
    offset = np.append(v[:-1] - slope[:-1] * r[:-1], 0.0)
    radii, coef_mk = r[1:], np.zeros((len(r) - 1, 5))
    coef_mk[:, 0] = offset[:-1] - offset[1:]
    coef_mk[:, 1] = (slope[:-1] - slope[1:]) * radii
    # A continuous node is a pure cone: make its value at the cut exactly 0.
    inner = np.arange(len(radii)) < len(radii) - 1
    continuous = inner | (v[-1] == 0)
    coef_mk[continuous, 0] = -coef_mk[continuous, 1]
    keep = np.abs(coef_mk).max(axis=1) > 1e-15 * np.abs(coef_mk).max()
    radii, coef_mk = radii[keep], coef_mk[keep]
    integral = 4 * pi * (radii**3 * (coef_mk / (np.arange(5) + 3.0)).sum(axis=1)).sum()
    return Radial("piecewise-linear", radii, coef_mk, 1.0 / integral, table=t)


def _plane_integral(radii, coef_mk) -> float:
    """∫ Σ_m Σ_k c_mk (ρ/R_m)^k dA over the plane."""
    return float(2 * pi * (radii**2 * (coef_mk / (np.arange(5) + 2.0)).sum(axis=1)).sum())


def _along(d, r, R):
    """Bond geometry in units of the bond's length: p² and the foot of the perpendicular, D, along the bond from x_i,
    and |r|."""
    d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
    length = np.sqrt((r * r).sum(-1))
    short = length < TINY * R
    length = np.where(short, TINY * R, length)
    n = np.where(short[..., None], np.array([1.0, 0.0, 0.0]), r / length[..., None])
    s = (d * n).sum(-1)
    perpendicular = d - s[..., None] * n
    return (perpendicular**2).sum(-1) / length**2, s / length, length


class Kernel:
    """A localisation function. Lengths are in whatever unit it was made in; `scaled` converts."""

    name: str
    is_isotropic = True
    #: 2: normalised in the plane.
    dimension: int = 3

    def planar(self) -> Kernel:
        """The same kernel in two dimensions, with ∫φ dA = 1."""
        raise NotImplementedError

    def in_dimension(self, dimension: int) -> Kernel:
        """The same kernel for runs in so many dimensions; AtcError for one made for two dimensions in three."""
        if dimension == 2:
            return self if self.dimension == 2 else self.planar()
        if self.dimension == 2:
            raise AtcError(
                f"kernel {self.name!r} was made for two dimensions, but the run has three: leave its dimension out"
            )
        return self

    @property
    def support(self) -> float:
        """The largest distance at which φ is not 0."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Kernel:
        """The same kernel with its lengths multiplied by `factor`."""
        raise NotImplementedError

    def phi(self, d):
        """φ(d) for vectors d (..., 3)."""
        raise NotImplementedError

    def grad_phi(self, d):
        """∂φ/∂d (..., 3) for vectors d (..., 3); 0 where φ has a kink or a jump."""
        raise NotImplementedError

    def beta(self, d, r):
        """The bond function: the mean of φ(d − t r) over t in [0, 1], for d = x_i − x and r (..., 3), broadcast."""
        raise NotImplementedError

    def marginal(self, normal=(0.0, 0.0, 1.0)) -> Marginal:
        """φ integrated over the plane normal to `normal`, as a function of the distance along it."""
        raise NotImplementedError

    @property
    def peak(self) -> float:
        """φ at 0, the scale against which errors of β are measured."""
        return float(self.phi(np.zeros(3)))

    def describe(self) -> str:
        """One line: name and lengths."""
        return f"{self.name}, " + ", ".join(
            f"{k} {v:.12g}" if np.isscalar(v) else f"{k} {v}" for k, v in self.parameters.items()
        )

    @property
    def parameters(self) -> dict:
        """The keyword arguments of `kernel` that make this kernel."""
        raise NotImplementedError

    def __repr__(self):
        return f"<kernel {self.describe()}>"

    def __eq__(self, other):
        return (
            isinstance(other, Kernel)
            and self.name == other.name
            and self.dimension == other.dimension
            and str(self.parameters) == str(other.parameters)
        )

    def __hash__(self):
        return hash((self.name, self.dimension, str(self.parameters)))


class Radial(Kernel):
    """Σ_m Σ_k c_mk (ρ/R_m)^k, each m only for ρ < R_m."""

    def __init__(self, name, radii, coef_mk, normalisation, table=None, dimension=3):
        self.name, self.dimension = name, dimension
        self.radii = np.asarray(radii, float)
        self.coef_mk = np.asarray(coef_mk, float)
        self.normalisation = float(normalisation)
        self._table = table

    @property
    def radius(self) -> float:
        return float(self.radii.max())

    support = radius

    @property
    def parameters(self):
        return {"table": self._table.tolist()} if self._table is not None else {"radius": self.radius}

    def scaled(self, factor):
        table = None if self._table is None else self._table * [factor, 1.0]
        if factor == 1.0:
            return self
        return Radial(
            self.name,
            self.radii * factor,
            self.coef_mk,
            self.normalisation / factor**self.dimension,
            table,
            self.dimension,
        )

    def planar(self):
        return Radial(
            self.name,
            self.radii,
            self.coef_mk,
            1.0 / _plane_integral(self.radii, self.coef_mk),
            self._table,
            dimension=2,
        )

    def phi(self, d):
        rho = np.sqrt((np.asarray(d, float) ** 2).sum(-1))
        total = np.zeros_like(rho)
        for R, c in zip(self.radii, self.coef_mk):
            total += np.where(rho < R, np.polynomial.polynomial.polyval(rho / R, c), 0.0)
        return self.normalisation * total

    def grad_phi(self, d):
        d = np.asarray(d, float)
        rho = np.sqrt((d**2).sum(-1))
        slope_over_rho = np.zeros_like(rho)
        safe = np.where(rho > 0, rho, 1.0)
        for R, c in zip(self.radii, self.coef_mk):
            derivative = np.polynomial.polynomial.polyval(rho / R, c[1:] * np.arange(1, 5)) / R
            slope_over_rho += np.where((rho < R) & (rho > 0), derivative / safe, 0.0)
        return self.normalisation * slope_over_rho[..., None] * d

    def beta(self, d, r):
        p2, D, length = _along(d, r, self.support)
        total = np.zeros_like(p2)
        for R, c in zip(self.radii, self.coef_mk):
            half_chord = np.sqrt(np.maximum((R / length) ** 2 - p2, 0.0))
            lo, hi = np.maximum(D - half_chord, 0.0), np.minimum(D + half_chord, 1.0)
            share = np.maximum(hi - lo, 0.0)
            J = mean_powers(p2, lo - D, hi - D, share)
            total += share * sum(c[k] * (length / R) ** k * J[k] for k in range(5) if c[k] != 0)
        return self.normalisation * total

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        if self.dimension == 2:
            from .disc import DiscMarginal

            return DiscMarginal(self.radii, self.normalisation * self.coef_mk)
        coef = np.zeros((len(self.radii), 7))
        for m, R in enumerate(self.radii):
            c = 2 * pi * R**2 * self.normalisation * self.coef_mk[m] / (np.arange(5) + 2.0)
            coef[m, 0] = c.sum()
            coef[m, 2:] = -c
        return Marginal(self.radii, coef)


def mean_powers(p2, ua, ub, delta):
    """Means of ρ^k, k = 0..4, over the stretch from ua to ub = ua + delta of a line at distance √p2 (see the module's
    head)."""
    ra, rb = np.sqrt(p2 + ua * ua), np.sqrt(p2 + ub * ub)
    S = np.maximum(ra + rb, 1e-300)
    T = ua + ub
    x = np.minimum(delta / S, 1.0 - 2e-16)
    atanh_over_delta = np.where(x > 1e-8, np.arctanh(x) / np.where(x > 1e-8, delta, 1.0), 1.0 / S)
    T2S = T * T / S
    m2 = (ua * ua + ua * ub + ub * ub) / 3.0
    J1 = 0.5 * (0.5 * (S + T2S) + 2.0 * p2 * atanh_over_delta)
    J3 = 0.25 * (0.5 * (ra**3 + rb**3 + T2S * (ra * ra + ra * rb + rb * rb)) + 3.0 * p2 * J1)
    m4 = (ua**4 + ua**3 * ub + (ua * ub) ** 2 + ua * ub**3 + ub**4) / 5.0
    return np.ones_like(p2), J1, p2 + m2, J3, p2 * p2 + 2.0 * p2 * m2 + m4


class Gaussian(Kernel):
    """exp(−ρ²/2w²)/(2π w²)^{d/2}, cut where it is 1e-16 of its peak."""

    name = "gaussian"
    #: Relative accuracy of bond functions.
    accuracy = 1e-17

    def __init__(self, width, dimension=3):
        self.width, self.dimension = float(width), dimension

    @property
    def parameters(self):
        return {"width": self.width}

    @property
    def normalisation(self):
        return 1.0 / (2 * pi * self.width**2) ** (0.5 * self.dimension)

    @property
    def support(self):
        return self.width * sqrt(-2.0 * log(GAUSSIAN_CUT))

    @property
    def radius(self):
        """The radius that `kernel` would have been given: 3 w."""
        return 3.0 * self.width

    def scaled(self, factor):
        return self if factor == 1.0 else Gaussian(self.width * factor, self.dimension)

    def planar(self):
        return Gaussian(self.width, dimension=2)

    def phi(self, d):
        rho2 = (np.asarray(d, float) ** 2).sum(-1)
        return np.where(rho2 < self.support**2, self.normalisation * np.exp(-0.5 * rho2 / self.width**2), 0.0)

    def grad_phi(self, d):
        return -self.phi(d)[..., None] * np.asarray(d, float) / self.width**2

    def beta(self, d, r):
        p2, D, length = _along(d, r, self.support)
        s = length / (sqrt(2.0) * self.width)
        return self.normalisation * np.exp(-s * s * p2) * _mean_gauss(s, D)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        return GaussianMarginal(self.width)


def _mean_gauss(s, D):
    """∫₀¹ exp(−s²(t − D)²) dt. For s < 1 by 8 Gauss-Legendre points (error 9e-15 s^16), where a difference of erf's
    would cancel."""
    from scipy.special import erf

    s, D = np.broadcast_arrays(s, D)
    quadrature = sum(w * np.exp(-((s * (t - D)) ** 2)) for t, w in zip(_GL_T, _GL_W))
    long = np.where(s < 1.0, 1.0, s)
    closed = 0.5 * sqrt(pi) / long * (erf(long * (1.0 - D)) + erf(long * D))
    return np.where(s < 1.0, quadrature, closed)


class BSpline(Kernel):
    """Product over x, y, z (in the plane over x and y) of M4(d/h)/h, the cubic B-spline of knot spacing h = radius/2:
    not rotation invariant."""

    name = "bspline"
    is_isotropic = False

    def __init__(self, radius, dimension=3):
        self.radius, self.dimension = float(radius), dimension

    @property
    def parameters(self):
        return {"radius": self.radius}

    @property
    def _h(self):
        return 0.5 * self.radius

    @property
    def normalisation(self):
        # In the plane d_z is 0 and its factor M4(0) = 2/3 is in every product.
        return 1.0 / self._h**3 if self.dimension == 3 else 1.5 / self._h**2

    @property
    def support(self):
        return sqrt(float(self.dimension)) * self.radius

    def scaled(self, factor):
        return self if factor == 1.0 else BSpline(self.radius * factor, self.dimension)

    def planar(self):
        return BSpline(self.radius, dimension=2)

    def phi(self, d):
        return self.normalisation * _m4(np.asarray(d, float) / self._h).prod(-1)

    def grad_phi(self, d):
        v = np.asarray(d, float) / self._h
        f, g = _m4(v), _m4_slope(v)
        out = np.empty_like(v)
        for a in range(3):
            out[..., a] = g[..., a] * f[..., (a + 1) % 3] * f[..., (a + 2) % 3]
        return self.normalisation / self._h * out

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        # Between the times at which the bond crosses a knot plane the integrand is a polynomial of degree 9: five Gauss
        # points are exact.
        with np.errstate(divide="ignore", invalid="ignore"):
            knots = [
                np.where(r[..., a] != 0, (d[..., a] - k * self._h) / r[..., a], 0.0)
                for a in range(3)
                for k in (-2, -1, 0, 1, 2)
            ]
        times = np.sort(
            np.clip(np.nan_to_num(np.stack([*knots, np.ones_like(d[..., 0]), np.zeros_like(d[..., 0])], -1)), 0.0, 1.0),
            -1,
        )
        x, w = np.polynomial.legendre.leggauss(5)
        total = np.zeros(d.shape[:-1])
        for m in range(times.shape[-1] - 1):
            a, b = times[..., m], times[..., m + 1]
            for xi, wi in zip(x, w):
                t = a + 0.5 * (1.0 + xi) * (b - a)
                total += 0.5 * wi * (b - a) * self.phi(d - t[..., None] * r)
        return total

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        _along_axis(self, normal)
        h = self._h
        cubes = np.array([1.0, -3.0, 3.0, -1.0, 0.0, 0.0, 0.0])
        # M4(v) = [(2 − |v|)³₊ − 4 (1 − |v|)³₊]/6
        return Marginal(np.array([2 * h, h]), np.array([8.0 / 6.0, -4.0 / 6.0])[:, None] * cubes / h)


def _m4(v):
    v = np.abs(v)
    return (np.maximum(2.0 - v, 0.0) ** 3 - 4.0 * np.maximum(1.0 - v, 0.0) ** 3) / 6.0


def _m4_slope(v):
    s, v = np.sign(v), np.abs(v)
    return -0.5 * s * (np.maximum(2.0 - v, 0.0) ** 2 - 4.0 * np.maximum(1.0 - v, 0.0) ** 2)


def _along_axis(kern, normal) -> int:
    n = np.abs(np.asarray(normal, float))
    a = int(n.argmax())
    if n[a] < (1.0 - 1e-12) * sqrt((n**2).sum()):
        raise AtcError(
            f"kernel {kern.name!r} is a product along x, y, z: a profile along a tilted axis needs an isotropic "
            "kernel (quartic, lucy, gaussian, ...)"
        )
    return a


class Box(Kernel):
    """1/volume (1/area) for −L/2 ≤ d < L/2 along every axis: half-open, so that touching boxes count an atom on their
    face once.

    size : (3,) or (2,); given : how many numbers the user gave
    """

    name = "box"
    is_isotropic = False

    def __init__(self, size, given=None):
        self.size = np.asarray(size, float)
        self.dimension = len(self.size)
        self._given = self.dimension if given is None else given

    @property
    def parameters(self):
        return {"size": self.size.tolist()}

    @property
    def normalisation(self):
        return 1.0 / float(self.size.prod())

    @property
    def support(self):
        return 0.5 * float(np.sqrt((self.size**2).sum()))

    @property
    def radius(self):
        return 0.5 * float(self.size.max())

    def scaled(self, factor):
        return self if factor == 1.0 else Box(self.size * factor, self._given)

    def planar(self):
        if self._given == 3:
            raise AtcError(
                f"kernel 'box': size has three edge lengths, {self.size.tolist()}, but the run is two-dimensional: "
                "give two"
            )
        return Box(self.size[:2], self._given)

    def in_dimension(self, dimension):
        if dimension == 3 and self.dimension == 2:
            raise AtcError(
                f"kernel 'box': size has two edge lengths, {self.size.tolist()}, but the run has three dimensions: "
                "give three"
            )
        return super().in_dimension(dimension)

    def phi(self, d):
        d = np.asarray(d, float)[..., : self.dimension]
        return np.where(((d >= -0.5 * self.size) & (d < 0.5 * self.size)).all(-1), self.normalisation, 0.0)

    def grad_phi(self, d):
        return np.zeros_like(np.asarray(d, float))

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        lo, hi = np.zeros(d.shape[:-1]), np.ones(d.shape[:-1])
        half = 0.5 * self.size
        for a in range(self.dimension):
            moving = np.abs(r[..., a]) > TINY * self.size[a]
            step = np.where(moving, r[..., a], 1.0)
            t1, t2 = (d[..., a] - half[a]) / step, (d[..., a] + half[a]) / step
            inside = (d[..., a] >= -half[a]) & (d[..., a] < half[a])
            lo = np.where(moving, np.maximum(lo, np.minimum(t1, t2)), np.where(inside, lo, 2.0))
            hi = np.where(moving, np.minimum(hi, np.maximum(t1, t2)), hi)
        return self.normalisation * np.maximum(hi - lo, 0.0)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        edge = float(self.size[_along_axis(self, normal)])
        return Marginal(np.array([0.5 * edge]), np.array([[1.0 / edge, 0, 0, 0, 0, 0, 0]]), half_open=True)


class Marginal:
    """φ₁(z) = Σ_m Σ_k c_mk (|z|/R_m)^k, each m only for |z| < R_m: a kernel integrated over the planes normal to z; ∫φ₁
    dz = 1."""

    def __init__(self, radii, coef_mk, half_open=False):
        self.radii = np.asarray(radii, float)
        self.coef_mk = np.asarray(coef_mk, float)
        self.half_open = bool(half_open)

    @property
    def support(self) -> float:
        return float(self.radii.max())

    def phi(self, z):
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            inside = (z >= -R) & (z < R) if self.half_open else np.abs(z) < R
            total += np.where(inside, np.polynomial.polynomial.polyval(np.abs(z) / R, c), 0.0)
        return total

    def cumulative(self, z):
        """∫ φ₁ from −∞ to z."""
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.minimum(np.abs(z) / R, 1.0)
            total += R * u * np.polynomial.polynomial.polyval(u, c / (np.arange(7) + 1.0))
        return 0.5 + np.sign(z) * total

    def slope(self, z):
        """dφ₁/dz."""
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.abs(z) / R
            total += np.where(u < 1.0, np.polynomial.polynomial.polyval(u, c[1:] * np.arange(1, len(c))) / R, 0.0)
        return np.sign(z) * total

    def beta(self, d, r):
        """The mean of φ₁(d − t r) over t in [0, 1], for numbers d = z_i − z and r."""
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        if self.half_open:
            at_rest = np.abs(r) < TINY * self.support
        r = np.where(np.abs(r) < TINY * self.support, TINY * self.support, r)
        total = np.zeros(d.shape)
        for R, c in zip(self.radii, self.coef_mk):
            for side in (-1.0, 1.0):
                t1, t2 = d / r, (d - side * R) / r
                lo, hi = np.clip(np.minimum(t1, t2), 0.0, 1.0), np.clip(np.maximum(t1, t2), 0.0, 1.0)
                va, vb = np.abs(d - lo * r) / R, np.abs(d - hi * r) / R
                mean = np.zeros(d.shape)
                for k in range(7):
                    if c[k] != 0:
                        mean += c[k] / (k + 1.0) * sum(va**i * vb ** (k - i) for i in range(k + 1))
                total += (hi - lo) * mean
        return np.where(at_rest, self.phi(d), total) if self.half_open else total


class GaussianMarginal(Marginal):
    """exp(−z²/2w²)/(√(2π) w)."""

    half_open = False

    def __init__(self, width):
        self.width = float(width)

    @property
    def support(self):
        return self.width * sqrt(-2.0 * log(GAUSSIAN_CUT))

    @cached_property
    def normalisation(self):
        return 1.0 / (sqrt(2 * pi) * self.width)

    def phi(self, z):
        z = np.asarray(z, float)
        return np.where(np.abs(z) < self.support, self.normalisation * np.exp(-0.5 * (z / self.width) ** 2), 0.0)

    def slope(self, z):
        return -np.asarray(z, float) / self.width**2 * self.phi(z)

    def cumulative(self, z):
        from scipy.special import erf

        return 0.5 * (1.0 + erf(np.asarray(z, float) / (sqrt(2.0) * self.width)))

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        length = np.maximum(np.abs(r), TINY * self.support)
        return self.normalisation * _mean_gauss(length / (sqrt(2.0) * self.width), np.where(r < 0, -d, d) / length)


def _gl_error(s: float) -> float:
    """Bound of the 8-point rule's error in `_mean_gauss`, for the tests: s^16 (8!)^4 |H_16(0)| / (17 (16!)^3)."""
    return s**16 * exp(4 * 10.604602902745251 - 3 * 30.671860106080672) / 17 * 518918400.0
