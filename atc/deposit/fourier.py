"""The kernels' Fourier transforms, and how fine a mesh has to be for a tolerance (the ground of the spectral deposit).

φ̂(k) = ∫ φ(x) exp(−i k·x) dx, φ̂(0) = 1. Errors are counted in two ways, both relative and both to be below the
tolerance:

- against the field of independent sources: the squared error is the integral of φ̂² (times the square of what is wrong
  with the mode) over the modes,
  divided by the integral of φ̂². As every cause of error depends on one component of k at a time, all these integrals
  are one-dimensional, over p(κ) = ∫ φ̂²(κ e + q) d²q (q normal to the unit vector e);
- against the field of sources in step with one mode, a crystal's for example: the largest |φ̂| times what is wrong.

In two dimensions k lies in the plane: φ̂ is Hankel's transform, and p(κ) an integral over the line normal to e.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from math import pi

import numpy as np

from ..compiled import njit
from ..errors import AtcError


@dataclass(frozen=True)
class Spectrum:
    """A kernel's modes along one direction, k in units of 1/scale.

    dimension : the kernel's. hat : φ̂(κ e); power : p(κ) dκ normalised to ∫₀^∞ p = 1; tail : ∫_κ^∞ p
    centre : how much of φ(0) the modes beyond κ make up
    """

    scale: float
    k: np.ndarray
    hat: np.ndarray
    power: np.ndarray
    tail: np.ndarray
    centre: np.ndarray
    dimension: int = 3


@lru_cache(maxsize=64)
def spectrum(kernel, gradient=False) -> Spectrum:
    """The spectrum that meshes and bond points are chosen by, of the field or of its gradient; AtcError for kernels
    that jump."""
    if kernel.last_mode is None:
        raise AtcError(
            f"kernel {kernel.name!r} {'jumps, its' if kernel.jumps else 'is not made for it: its'} modes decay too "
            "slowly for the spectral method: use method 'direct'"
        )
    d = kernel.dimension
    k = (np.arange(int(kernel.last_mode / 0.05)) + 0.5) * 0.05
    hat = kernel.hat_along(k)
    weight = k**2 if gradient else 1.0
    if not kernel.is_isotropic:
        # One axis after the other, all of them as the one whose modes decay most slowly.
        p, shell = hat**2 * weight, 1.0
    else:
        shell = k ** (d - 1)
        # ∫ φ̂² q dq over the plane at κ: all k from κ on; or over the line.
        p = _along_lines(k, hat**2 * weight) if d == 2 else np.cumsum((hat**2 * k * weight)[::-1])[::-1]
    centre = (1.0 if kernel.is_isotropic else float(d)) * hat * shell
    p = p / p.sum()
    total = (hat * shell).sum()
    centre = np.maximum.accumulate(np.abs(np.cumsum(centre[::-1]) / total))[::-1]
    if gradient:
        # In step: against the mode with the largest gradient.
        hat = hat * k / np.abs(hat * k).max()
    return Spectrum(kernel.scale, k, hat, p, np.cumsum(p[::-1])[::-1], centre, d)


def _along_lines(k, power):
    """∫ power(√(κ² + q²)) dq over the line at distance κ, for κ at k, the middles of equal steps: by the length of the
    line in each ring, at some κ, and in between by its logarithm."""
    step = k[1] - k[0]
    some = np.unique(np.r_[np.arange(0, min(40, len(k))), np.geomspace(1, len(k) - 1, 300).astype(int)])
    rim = np.r_[k - 0.5 * step, k[-1] + 0.5 * step]
    out = np.empty(len(some))
    for m, i in enumerate(some):
        q = np.sqrt(np.maximum(rim[i:] ** 2 - k[i] ** 2, 0.0))
        out[m] = power[i:] @ np.diff(q)
    return np.exp(np.interp(k, k[some], np.log(np.maximum(out, 1e-300))))


# --- the spreading window: Kaiser and Bessel's, x in mesh spacings, support |x| < width/2
def window(x, width, shape):
    """The Kaiser-Bessel window, 1 at x = 0 and 0 beyond width/2."""
    from scipy.special import i0

    u = 1.0 - (2.0 * np.asarray(x) / width) ** 2
    return np.where(u >= 0, i0(shape * np.sqrt(np.maximum(u, 0.0))), 0.0) / i0(shape)


def window_hat(f, width, shape):
    """∫ window(x) cos(2π f x) dx, f in cycles per spacing."""
    from scipy.special import i0

    s = np.asarray(shape) ** 2 - (pi * width * np.asarray(f)) ** 2
    r = np.sqrt(np.abs(s))
    safe = np.where(r > 1e-8, r, 1.0)
    return width / i0(shape) * np.where(r > 1e-8, np.where(s > 0, np.sinh(safe), np.sin(safe)) / safe, 1.0)


@lru_cache(maxsize=64)
def window_polynomials(width, shape, accuracy):
    """(degree + 1, 4⌈width/4⌉) coefficients of window(x + j − width/2) in powers of x, 0 ≤ x ≤ 1, for j =
    0..width−1."""
    nodes = 0.5 - 0.5 * np.cos(pi * (np.arange(40) + 0.5) / 40)
    j = np.arange(width)
    want = window(nodes[:, None] + j - 0.5 * width, width, shape)
    for degree in range(3, 16):
        fit = np.polynomial.Chebyshev(np.zeros(degree + 1), domain=[0, 1])
        T = np.polynomial.chebyshev.chebvander(2 * nodes - 1, degree)
        cheb = np.linalg.lstsq(T, want, rcond=None)[0]
        if np.abs(T @ cheb - want).max() <= accuracy or degree == 15:
            break
    out = np.zeros((degree + 1, 4 * ((width + 3) // 4)))
    for column in range(width):
        p = np.polynomial.Chebyshev(cheb[:, column], domain=fit.domain).convert(
            kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]
        )
        out[: len(p.coef), column] = p.coef
    return out


def images(f, width, shape):
    """The window's squared transform at the frequencies that the mesh takes for f, summed; and its transform at f
    itself."""
    return sum(window_hat(f + m, width, shape) ** 2 for m in (-3, -2, -1, 1, 2, 3)), window_hat(f, width, shape)


@njit(cache=True, error_model="numpy")
def _aliasing(f, power, hat, dimension, width, shape):
    """Error by the modes that the mesh confuses: f (cycles per spacing) are those kept, with their power and φ̂."""
    total, most = 0.0, 0.0
    for i in range(len(f)):
        others, own = 0.0, 1.0
        for m in range(-3, 4):
            # The window's transform but for a factor.
            s = shape * shape - (pi * width * (f[i] + m)) ** 2
            r = np.sqrt(abs(s))
            hat_m = 1.0 if r <= 1e-8 else np.sinh(r) / r if s > 0.0 else np.sin(r) / r
            if m == 0:
                own = hat_m
            else:
                others += hat_m * hat_m
        wrong2 = others / (own * own)
        total += wrong2 * power[i]
        most = max(most, np.sqrt(wrong2) * abs(hat[i]))
    # Each axis has its own images.
    return max(np.sqrt(dimension * total), most)


def aliasing(spec, width, shapes, spacing, upto, at, enough):
    """(error, index) by the modes that the mesh confuses, by one of some shape parameters: downhill from the one of
    index `at`, or the best of all where that is not `enough`.

    spacing : in units of spec.scale; modes k[:upto] are kept
    """
    thin = max(1, upto // 100)
    f = spec.k[:upto:thin] * spacing / (2 * pi)
    power, hat = np.add.reduceat(spec.power[:upto], np.arange(0, upto, thin)), spec.hat[:upto:thin]
    known = {}

    def error(k):
        if k not in known:
            known[k] = (
                _aliasing(f, power, hat, float(spec.dimension), width, shapes[k]) if 0 <= k < len(shapes) else np.inf
            )
        return known[k]

    while (best := min((at, at - 1, at + 1), key=error)) != at:
        at = best
    if error(at) > enough:
        at = min(range(len(shapes)), key=error)
    return error(at), at


@dataclass(frozen=True)
class Parameters:
    """What a tolerance asks for. Lengths in the kernel's unit.

    spacing : of the mesh along each edge, at most
    k_max : modes kept, |k·a|/|a| ≤ k_max for the cell's edges a
    width, shape : of the window
    """

    spacing: float
    k_max: float
    width: int
    shape: float
    error: float


WIDTHS = range(3, 13)


# ns a point, ns a point and mesh node, ns a mesh node: measured, in double and in single precision.
COSTS = {8: (25.0, 0.75, 130.0), 4: (25.0, 0.40, 70.0)}


@lru_cache(maxsize=64)
def cheapest_mesh(
    kernel, left_out, confused, points_density, costs=COSTS[8], gradient=False, centre=None
) -> Parameters:
    """The cheapest window and mesh whose estimated errors are below the shares of the tolerance.

    Parameters
    ----------
    left_out, confused : what the modes left out and the ones that the mesh takes for each other may cost
    points_density : points to spread per unit volume (in the plane: area)
    costs : see COSTS
    gradient : whether the errors are those of the field's gradient
    centre : how much of φ(0) may be left out: where fields are wanted at the kernels' centres
    """
    spec = spectrum(kernel, gradient)
    d = spec.dimension
    lost = np.sqrt(float(d) * spec.tail)
    worst = np.maximum.accumulate(np.abs(spec.hat)[::-1])[::-1]
    fine = np.maximum(lost, worst) <= left_out
    if centre is not None:
        fine &= spec.centre <= centre
    enough = np.flatnonzero(fine)
    # Near the table's end the tail is cut short.
    if not len(enough) or spec.k[enough[0]] > 0.5 * spec.k[-1]:
        raise AtcError(
            f"kernel {kernel.name!r}: its modes decay too slowly for this tolerance by method 'spectral': use method "
            "'direct'"
        )
    upto = max(int(enough[0]), 2)
    k_max = spec.k[upto]
    best = None

    def cost(oversampling, width):
        return (
            points_density * (costs[0] + costs[1] * width**d)
            + costs[2] * (k_max * oversampling / (pi * spec.scale)) ** d
        )

    for width in WIDTHS:
        shapes = width * np.linspace(1.0, 3.1, 22)
        # How many times more than two points for the shortest wave: the least that does, by halving, as long as that
        # may become the cheapest.
        low, high, found, at = 0.98, 3.0, None, 14
        for _ in range(7):
            if best is not None and cost(low, width) >= best[0]:
                found = None
                break
            oversampling = high if found is None else 0.5 * (low + high)
            error, at = aliasing(spec, width, shapes, pi / (k_max * oversampling), upto, at, confused)
            if error <= confused:
                high, found = oversampling, (oversampling, float(shapes[at]), float(error))
            elif found is None:
                break
            else:
                low = oversampling
        if found is not None and (best is None or cost(found[0], width) < best[0]):
            h = pi / (k_max * found[0]) * spec.scale
            error = float(np.hypot(found[2], max(lost[upto], worst[upto])))
            best = cost(found[0], width), Parameters(h, k_max / spec.scale, width, found[1], error)
    if best is None:
        raise AtcError("method 'spectral' does not reach this tolerance: use method 'direct'")
    return best[1]


# Errors of bonds depend on k times a length alone: both go by their logarithm, in steps of so many a decade.
_DECADE = 200
# Bond lengths, in units of the spectrum's scale, at which the rules' errors are known.
_STEPS = np.concatenate([np.arange(-1600, -600, 50), np.arange(-600, 401, 8)])
_LENGTHS = 10.0 ** (_STEPS / _DECADE)


@lru_cache(maxsize=64)
def by_decades(kernel, gradient=False):
    """(first, power, hat): a spectrum's modes by the logarithm of k: the least step, and in every step from there the
    power and the largest |φ̂|. A mode counts at the upper end of its step, where errors are larger."""
    spec = spectrum(kernel, gradient)
    step = np.ceil(_DECADE * np.log10(spec.k) - 1e-9).astype(int)
    first = int(step[0])
    hat = np.zeros(step[-1] - first + 1)
    np.maximum.at(hat, step - first, np.abs(spec.hat))
    return first, np.bincount(step - first, spec.power), hat


def products(first, count):
    """k times a length, in all steps that can occur; and what makes of values there those of `count` modes from step
    `first` on, (lengths, modes)."""
    x = 10.0 ** (np.arange(first + _STEPS[0], first + count + _STEPS[-1]) / _DECADE)
    return x, lambda values: np.lib.stride_tricks.sliding_window_view(values, count)[_STEPS - _STEPS[0]]


@cache
def legendre_rules(most):
    """(most, most) nodes and weights on [0, 1] of Gauss-Legendre rules of 1, 2, .. points, a row each."""
    nodes, weights = np.zeros((2, most, most))
    for m in range(most):
        x, w = np.polynomial.legendre.leggauss(m + 1)
        nodes[m, : m + 1], weights[m, : m + 1] = 0.5 * (x + 1.0), 0.5 * w
    return nodes, weights


@lru_cache(maxsize=64)
def _rule_errors(kernel, most, gradient):
    """(most, lengths) error by Gauss-Legendre rules of 1, 2, .. points for a bond of each length and all shorter
    ones."""
    first, power, hat = by_decades(kernel, gradient)
    x, windows = products(first, len(power))
    half = 0.5 * x
    exact = np.sinc(half / pi)
    errors = np.empty((most, len(_LENGTHS)))
    for m in range(1, most + 1):
        node, weight = np.polynomial.legendre.leggauss(m)
        # The rule is even: its positive nodes count twice, one in the middle once.
        wrong = -exact
        for t, w in zip(node[m // 2 :], weight[m // 2 :]):
            wrong = wrong + (0.5 if t == 0.0 else 1.0) * w * (np.cos(half * t) if t else 1.0)
        each = windows(np.abs(wrong))
        errors[m - 1] = np.maximum(np.sqrt(each**2 @ power), (each * hat).max(-1))
    return np.maximum.accumulate(errors, axis=1)


def longest_bonds(kernel, tolerances, most=10, gradient=False):
    """(tolerances, most) the longest bond that 1, 2, .. Gauss-Legendre points do for: longer ones than the last are cut
    into pieces."""
    errors = _rule_errors(kernel, most, gradient)
    at = np.array([np.searchsorted(e, tolerances, side="right") for e in errors]).T
    return np.where(at > 0, _LENGTHS[np.maximum(at - 1, 0)], 1e-9) * spectrum(kernel).scale


def rule_error(kernel, m, length, gradient=False, most=10):
    """(b,) error by m + 1 points for bonds of these lengths and all shorter ones; up to the next length of the
    table."""
    errors = _rule_errors(kernel, most, gradient)
    return errors[
        m, np.minimum(np.searchsorted(_LENGTHS, np.asarray(length) / spectrum(kernel).scale), len(_LENGTHS) - 1)
    ]
