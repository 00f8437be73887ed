"""The Gaussian: its bond function is the Gaussian of the distance from the bond's line times a difference of error
functions along it."""

from __future__ import annotations

from functools import cached_property
from math import erf, exp, expm1, factorial, log, pi, sqrt

import numpy as np

from ..compiled import njit
from ..simd import INLINE, JIT, JIT_FMA, exp2i4, largest4, load4, minimum4, peek, poke, splat4, store4
from .base import Compiled, Kernel, along, positive
from .lanes import LANES, SCRATCH
from .profile import GL_T, GL_W, TINY, CompiledProfile, Marginal

# The Gaussian is cut where it falls below this fraction of its peak.
GAUSSIAN_CUT = 1e-16


class Gaussian(Kernel):
    """exp(−ρ²/2w²)/(2π w²)^{d/2}, cut where it is 1e-16 of its peak."""

    name, aliases, takes = "gaussian", (), ("width", "radius")
    analytic = True
    last_mode = 90.0
    #: Relative accuracy of bond functions.
    accuracy = 1e-17

    @classmethod
    def of(cls, dimension=None, *, width=None, radius=None):
        return cls(positive("width", width, cls.name) if radius is None else positive("radius", radius, cls.name) / 3.0)

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

    @property
    def difference_step(self):
        # It has no kinks.
        return 0.0025 * self.width

    @property
    def pieces(self):
        return np.array([self.support]), np.array([[self.normalisation, self.width, self.accuracy]])

    def cut(self, beyond):
        from scipy.special import gammaincinv

        # ∫ beyond r of the normalised Gaussian is 1 − P(d/2, r²/2w²).
        reach = self.width * float(np.sqrt(2.0 * gammaincinv(0.5 * self.dimension, 1.0 - beyond)))
        # The bond function's series need not go further than that either.
        return CutGaussian(self.width, min(self.support, reach), max(1e-3 * beyond, self.accuracy), self.dimension)

    def above(self, value):
        ratio = value / self.peak
        reach = self.width * sqrt(-2.0 * log(min(ratio, 1.0))) if ratio > GAUSSIAN_CUT else self.support
        return CutGaussian(self.width, min(self.support, reach), self.accuracy, self.dimension)

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
        p2, D, length = along(d, r, self.support)
        s = length / (sqrt(2.0) * self.width)
        return self.normalisation * np.exp(-s * s * p2) * _mean_gauss(s, D)

    def squared(self):
        # exp(−r²/2w²)² is the Gaussian of width w/√2, whose integral over space is (2 √π w)^−d.
        narrow = CutGaussian(self.width / sqrt(2.0), self.support, self.accuracy, self.dimension)
        return (2.0 * sqrt(pi) * self.width) ** -self.dimension, narrow

    def hat(self, k):
        return np.exp(-0.5 * (np.sqrt((np.asarray(k, float) ** 2).sum(-1)) * self.width) ** 2)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        return GaussianMarginal(self.width)


class CutGaussian(Gaussian):
    """A Gaussian cut at `support`."""

    def __init__(self, width, support, accuracy=Gaussian.accuracy, dimension=3):
        super().__init__(width, dimension)
        self._support, self.accuracy = support, accuracy

    @property
    def support(self):
        return self._support


def _mean_gauss(s, D):
    """∫₀¹ exp(−s²(t − D)²) dt. For s < 1 by 8 Gauss-Legendre points (error 9e-15 s^16), where a difference of erf's
    would cancel."""
    from scipy.special import erf

    s, D = np.broadcast_arrays(s, D)
    quadrature = sum(w * np.exp(-((s * (t - D)) ** 2)) for t, w in zip(GL_T, GL_W))
    long = np.where(s < 1.0, 1.0, s)
    closed = 0.5 * sqrt(pi) / long * (erf(long * (1.0 - D)) + erf(long * D))
    return np.where(s < 1.0, quadrature, closed)


class GaussianMarginal(Marginal):
    """exp(−z²/2w²)/(√(2π) w)."""

    def __init__(self, width):
        self.width = float(width)

    @property
    def pieces(self):
        return np.array([self.support]), np.array([[self.normalisation, self.width, Gaussian.accuracy]])

    bin_pieces = pieces

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

    def second(self, z):
        z = np.asarray(z, float)
        return z * (self.cumulative(z) - 0.5) + self.width**2 * self.normalisation * np.expm1(
            -0.5 * (z / self.width) ** 2
        )

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        length = np.maximum(np.abs(r), TINY * self.support)
        return self.normalisation * _mean_gauss(length / (sqrt(2.0) * self.width), np.where(r < 0, -d, d) / length)


@njit(**INLINE)
def exp_minus(x):
    """exp(−x) for 0 ≤ x: 2^−n times a Taylor series of degree 13 on |t| ≤ ½ ln 2 (0.3466^14/14! = 4e-18)."""
    x = minimum4(x, 700.0)
    # To the nearest whole number by adding 1.5·2^52, where doubles have no fraction.
    n = (x * 1.4426950408889634 + 6755399441055744.0) - 6755399441055744.0
    t = n * 0.6931471803691238 - x + n * 1.9082149292705877e-10
    g = t * (1.0 / 6227020800.0) + 1.0 / 479001600.0
    g = g * t + 1.0 / 39916800.0
    g = g * t + 1.0 / 3628800.0
    g = g * t + 1.0 / 362880.0
    g = g * t + 1.0 / 40320.0
    g = g * t + 1.0 / 5040.0
    g = g * t + 1.0 / 720.0
    g = g * t + 1.0 / 120.0
    g = g * t + 1.0 / 24.0
    g = g * t + 1.0 / 6.0
    g = g * t + 0.5
    g = g * t + 1.0
    g = g * t + 1.0
    return g * exp2i4(-1.0 * n)


# Bonds longer than this times √2 w go by erf, shorter ones by a series (45 terms at most).
LONG = 3.0
_BOND_TERMS = 48


@njit(**JIT_FMA)
def _constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    """c0 exp(−ρ²/2w²), w = c1, to a relative accuracy of c2 (1e-17 is exact). With y = s²(D − ½), s = |r|/√2 w, the
    mean over the bond is exp(−s²(D − ½)²) ∫ exp(−s²t²) cosh(2yt) dt over |t| < ½ = exp(..) Σ_j y^2j 4^j/(2j)! ∫ t^2j
    exp(−s²t²) dt: all terms are positive.
    """
    s = length / (sqrt(2.0) * c_mk[piece, 1])
    k[0] = s * s
    k[1] = c_mk[piece, 0]
    if s > LONG:
        k[2] = -1.0
        k[3] = 0.5 * sqrt(np.pi) / s
        k[4] = s
        return
    # The last term that matters: the series is that of cosh(z) at most, z = 2 y_max/2.
    z = s * (R / (sqrt(2.0) * c_mk[piece, 1]) + 0.5 * s)
    last = 1
    term = z * z / 2.0
    total = 1.0 + term
    while term > c_mk[piece, 2] * total and last < _BOND_TERMS:
        last += 1
        term *= z * z / (2.0 * last * (2.0 * last - 1.0))
        total += term
    k[2] = float(last)
    # ∫ t^2j exp(−s²t²) over |t| < ½: the highest by its own series, the others downwards, I_j = [s² I_j+1 + e^(−s²/4)
    # 2^−(2j+1)] 2/(2j+1).
    e = exp(-0.25 * s * s)
    half = 0.5 ** (2 * last + 1)
    integral = 0.0
    term = 2.0 * half * e / (2.0 * last + 1.0)
    j = last
    while term > 0.1 * c_mk[piece, 2] * integral:
        integral += term
        j += 1
        term *= 0.5 * s * s / (2.0 * j + 1.0)
    factor = 1.0
    for j in range(1, last + 1):
        factor *= 4.0 / (2.0 * j * (2.0 * j - 1.0))
    for j in range(last, -1, -1):
        k[4 + j] = integral * factor
        if j > 0:
            half *= 4.0
            integral = (s * s * integral + e * half) * 2.0 / (2.0 * j - 1.0)
            factor *= 2.0 * j * (2.0 * j - 1.0) / 4.0


@njit(**INLINE)
def _beta(D, Y, M, k):
    p2 = M * M + Y * Y
    if peek(k, 2) > 0.0:
        c = D - 0.5
        y2 = (peek(k, 0) * c) * (peek(k, 0) * c)
        last = int(peek(k, 2))
        g = splat4(peek(k, 4 + last))
        for j in range(last - 1, -1, -1):
            g = g * y2 + peek(k, 4 + j)
        return peek(k, 1) * g * exp_minus(peek(k, 0) * (p2 + c * c))
    s = peek(k, 4)
    store4(k, SCRATCH, D)
    for l in range(4):
        d = peek(k, SCRATCH + l)
        poke(k, SCRATCH + l, erf(s * (1.0 - d)) + erf(s * d))
    return peek(k, 1) * peek(k, 3) * load4(k, SCRATCH) * exp_minus(peek(k, 0) * p2)


# In the pairs' k: s² of the last four pairs if they have one, s² that the J_j kept belong to, the last of these, and
# they. All −1 at first.
_SEEN, _KEPT, _LAST, _J = 56, 57, 58, 59
# The pairs' series goes so far at most; 1/(2j + 1)!, two more than that.
_TERMS = 60
_FACTORIALS = np.array([1.0 / factorial(2 * j + 1) for j in range(_TERMS + 4)])
# Steps of the tables in y and in s².
_STEP_Y, _STEP_S2 = 0.5, 0.5


def _series(radii_m, coef_mk) -> np.ndarray:
    """1/2w²; 1/(2j + 1)!; how many steps its two tables have; and the last term that matters, by y = s²|D − ½| and by
    s². With J_j as in `_pairs`, the terms beyond the last are to those before as those of cosh(2y t) at t = ½ at most;
    what is left out of J_0 is the product of what each step multiplies it with.
    """
    width, accuracy = coef_mk[0, 1], 0.1 * coef_mk[0, 2]
    farthest = LONG * (radii_m[0] / (sqrt(2.0) * width) + 0.5 * LONG)
    steps = int(farthest / _STEP_Y) + 2
    by_y, by_s2 = np.zeros(steps), np.zeros(int(LONG**2 / _STEP_S2) + 2)
    for table, last_of in (
        (by_y, lambda k: _last_by_y((k + 1) * _STEP_Y, accuracy)),
        (by_s2, lambda k: _last_by_s2((k + 1) * _STEP_S2, accuracy)),
    ):
        table[:] = [last_of(k) for k in range(len(table))]
    return np.concatenate([[0.5 / width**2], _FACTORIALS, [len(by_y), len(by_s2)], by_y, by_s2])


def _last_by_y(y, accuracy):
    last, term, total = 0, 1.0, 1.0
    while term > accuracy * total and last < _TERMS:
        last += 1
        term *= y * y / (2.0 * last * (2.0 * last - 1.0))
        total += term
    return last


def _last_by_s2(s2, accuracy):
    last, left = 0, 1.0
    while left > accuracy and last < _TERMS:
        last += 1
        left *= s2 * last / ((2.0 * last) * (2.0 * last + 1.0))
    return last


_N_FACTORIALS = len(_FACTORIALS)


@njit(**JIT_FMA)
def _last(y, s2, series_at):
    """The last term that matters for y and s² up to these."""
    at = 1 + _N_FACTORIALS
    n_y, n_s2 = int(peek(series_at, at)), int(peek(series_at, at + 1))
    at_y, at_s2 = min(int(y * (1.0 / _STEP_Y)), n_y - 1), min(int(s2 * (1.0 / _STEP_S2)), n_s2 - 1)
    return int(max(peek(series_at, at + 2 + at_y), peek(series_at, at + 2 + n_y + at_s2)))


@njit(**INLINE)
def _pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    """c0 exp(−ρ²/2w²). With s² = |r|²/2w² and y = s²(D − ½) the mean over the bond is exp(−s²(p² + (D − ½)² + ¼)) Σ_j
    J_j y^2j, where J_j = 4^j/(2j)! ∫ t^2j exp(s²(¼ − t²)) dt over |t| < ½ = (j + 1) s² J_j+1 + 1/(2j + 1)!: downwards,
    in step with Horner's rule; all terms are positive. Long bonds go by erf.
    """
    s2 = length2 * peek(series_at, 0)
    c = D - 0.5
    beta = splat4(0.0)
    longest, shortest = largest4(s2), 0.0 - largest4(s2 * -1.0)
    limit = LONG * LONG
    if shortest <= limit:
        if longest > limit:
            # Those that are too long are done below.
            s2 = minimum4(s2, limit)
        y = s2 * c
        y2 = y * y
        shared = shortest == longest
        if shared and peek(k, _KEPT) == longest:
            # Many pairs of one bond: its J_j are known. Even and odd powers of y² apart, so that the processor can
            # overlap them.
            last, y4 = int(peek(k, _LAST)), y2 * y2
            even, odd = splat4(peek(k, _J + last - 1)), splat4(peek(k, _J + last))
            for j in range(last - 3, -1, -2):
                even = even * y4 + peek(k, _J + j)
                odd = odd * y4 + peek(k, _J + j + 1)
            g = even + odd * y2
        else:
            last = _last(sqrt(largest4(y2)), min(longest, limit), series_at)
            J, g = splat4(peek(series_at, 2 + last)), splat4(0.0)
            for j in range(last, -1, -1):
                J = (s2 * (j + 1.0)) * J + peek(series_at, 1 + j)
                g = g * y2 + J
            if shared and peek(k, _SEEN) == longest:
                # From the third four on.
                last = _last(0.5 * longest + sqrt(longest * R2 * peek(series_at, 0)), longest, series_at) | 1
                J1 = peek(series_at, 2 + last)
                for j in range(last, -1, -1):
                    J1 = (longest * (j + 1.0)) * J1 + peek(series_at, 1 + j)
                    poke(k, _J + j, J1)
                poke(k, _LAST, float(last))
                poke(k, _KEPT, longest)
            poke(k, _SEEN, longest if shared else -1.0)
        beta = peek(c_at, 0) * g * exp_minus(s2 * (p2 + c * c + 0.25))
    if longest > limit:
        s2 = length2 * peek(series_at, 0)
        across = exp_minus(s2 * p2)
        store4(k, LANES, s2)
        store4(k, LANES + 4, D)
        store4(k, LANES + 8, across)
        store4(k, LANES + 12, beta)
        for l in range(4):
            if peek(k, LANES + l) > limit:
                s, d = sqrt(peek(k, LANES + l)), peek(k, LANES + 4 + l)
                mean = 0.8862269254527580 / s * (erf(s * (1.0 - d)) + erf(s * d))
                poke(k, LANES + 12 + l, peek(c_at, 0) * mean * peek(k, LANES + 8 + l))
        beta = load4(k, LANES + 12)
    return beta


@njit(**INLINE)
def _mean(z, r, radii_m, coef_mk, k):
    """Mean of c0 exp(−z²/2 c1²): the Gaussian's bond function on the bond's own line."""
    length = max(abs(r), 1e-30 * radii_m[0])
    zero = splat4(0.0)
    return _beta(z * ((-1.0 if r < 0.0 else 1.0) / length), zero, zero, k)


@njit(**JIT_FMA)
def _mean_constants(r, radii_m, coef_mk, k_):
    _constants(max(abs(r), 1e-30 * radii_m[0]), radii_m[0], coef_mk, 0, 0, 0, 0, k_)


@njit(**JIT)
def _value(d0, d1, d2, r2, radii, coef, g):
    w2 = coef[0, 1] * coef[0, 1]
    value = coef[0, 0] * exp(-0.5 * r2 / w2)
    g[0], g[1], g[2] = -value * d0 / w2, -value * d1 / w2, -value * d2 / w2
    return value


Gaussian.compiled = Compiled("gaussian", _constants, _beta, _pairs, _value, series=_series, seconds=5e-9)


@njit(**JIT_FMA)
def _integral(z, m, radii_m, coef_mk):
    """∫₀^z c0 exp(−z²/2 c1²)."""
    return 0.5 * erf(z / (sqrt(2.0) * coef_mk[m, 1]))


@njit(**JIT_FMA)
def _second(z, m, radii_m, coef_mk):
    w = coef_mk[m, 1]
    return z * _integral(z, m, radii_m, coef_mk) + w * w * coef_mk[m, 0] * expm1(-0.5 * (z / w) ** 2)


GaussianMarginal.compiled = CompiledProfile("gaussian", _mean_constants, _mean, _integral, _second)
