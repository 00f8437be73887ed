"""Site sums with the kernel's gradient: Σ_j a_j φ(x_j − x) and Σ_j a_j ∂φ(x_j − x)/∂x, in closed form (formulas: what
∇v and ∇u are made of).

Every point collects the atoms within reach from bins of the cell, images included: exact, and the same for any number
of threads.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ..compiled import as_tuple, njit, specialise
from ..errors import AtcError
from ..kernels.binned import profile_of
from ..simd import JIT, address, peek
from ._points import reached
from .direct import in_bins

# Replaced in each copy (see `compiled.specialise`).
VALUE = None


def require_differentiable(kernel, users: str) -> None:
    """Raise for a kernel that jumps: its gradient is not a function."""
    if kernel.jumps:
        raise AtcError(
            f"{users}: kernel {kernel.name!r} jumps, so it has no gradient: use a continuous one, e.g. quartic, lucy "
            "or gaussian"
        )


def gather(bound, kernel, cell, x_nc, a_nk, w_n=None, gradient=True, threads=1, squared=False):
    """Σ a φ and Σ a ∂φ/∂x at the points of a grid.

    Parameters
    ----------
    bound : BoundGrid; on a slab grid the sums are averages over the cross-section, whose gradient is along the normal
    kernel : Kernel, internal units, without jumps if `gradient`
    cell : Cell of the atoms; its periodic axes repeat
    x_nc : (n, 3) positions, anywhere
    a_nk : (n, k) factors
    w_n : (n,) or None
        Three more factors w_j (x_j − x), through the image that is summed (held constant in the gradient). Not on
        slabs.
    gradient : whether the second sum is wanted
    threads : int
    squared : Σ a φ² instead, φ summed over an atom's images, without gradients; on a slab grid Σ a w², w what an atom
        counts in the average

    Returns
    -------
    values_gk : (g, k) or (g, k + 3)
    gradients_gkc : the same with the direction of the derivative last, or None
    """
    a_nk = np.ascontiguousarray(a_nk, dtype=np.float64)
    if bound.kind == "slab":
        if w_n is not None:
            raise ValueError("no first moments on slabs")
        return _gather_slab(bound, kernel, cell, x_nc, a_nk, gradient, squared)
    points = np.ascontiguousarray(bound.relative_points_gc)
    k = a_nk.shape[1]
    width = k + (3 if w_n is not None else 0)
    values = np.zeros((len(points), width))
    gradients = np.zeros((len(points), width, 3)) if gradient else np.zeros((0, width, 3))
    if len(x_nc) and len(points):
        radii, coef = kernel.pieces
        add = _core(kernel.compiled, squared)
        x, order, start, bins = _bins(cell, np.asarray(x_nc) - cell.origin, kernel.support)
        w = np.zeros(0) if w_n is None else np.ascontiguousarray(np.asarray(w_n, float)[order])
        geometry = tuple(map(as_tuple, (cell.vectors, cell.inverse, 1.0 / cell.heights, cell.periodic)))
        rest = (radii, coef, x, a_nk[order], w, start, bins, geometry)

        def part(a, b):
            # Room for a gradient and a distance, and to add up the images of an atom.
            room = (*np.zeros((2, 3)), np.zeros(len(x) * squared), np.zeros(len(x) * squared, np.int64))
            add(points[a:b], *rest, room, values[a:b], gradients[a:b])

        if threads == 1 or len(points) < 2 * threads:
            part(0, len(points))
        else:
            from concurrent.futures import ThreadPoolExecutor

            cuts = np.linspace(0, len(points), 4 * threads + 1).astype(int)
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, cuts[:-1], cuts[1:]))
    return values, gradients if gradient else None


@cache
def _core(compiled, squared=False):
    """The loop's copy for a family of kernels."""
    return specialise(_gather_squares if squared else _gather, compiled.name, JIT, VALUE=compiled.value)


def _bins(cell, x, support):
    """Positions wrapped and sorted by bin; their order, the first of each bin, and the geometry of the bins."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    s = x @ cell.inverse
    image = np.where(cell.periodic, np.floor(s), 0.0)
    for a in range(3):
        x = x - image[:, a, None] * cell.vectors[a]
    bins, order, start = in_bins(cell, s - image, support, 512)
    return x[order], order, start, tuple(map(as_tuple, bins))


@njit(**JIT, no_cpython_wrapper=True)
def _bins_reached(p0, p1, p2, support, bins, cell):
    """The first and the last bin within the support of a point, along each axis."""
    (n0, n1, n2), low, scale = bins
    _, inverse, per_height, periodic = cell
    (i00, i01, i02), (i10, i11, i12), (i20, i21, i22) = inverse
    s0 = (p0 * i00 + p1 * i10 + p2 * i20 - low[0]) * scale[0]
    s1 = (p0 * i01 + p1 * i11 + p2 * i21 - low[1]) * scale[1]
    s2 = (p0 * i02 + p1 * i12 + p2 * i22 - low[2]) * scale[2]
    return (
        reached(s0, support * per_height[0] * scale[0] + 1e-9, n0, periodic[0]),
        reached(s1, support * per_height[1] * scale[1] + 1e-9, n1, periodic[1]),
        reached(s2, support * per_height[2] * scale[2] + 1e-9, n2, periodic[2]),
    )


def _gather(points, radii, coef, x_nc, a_nk, w_n, start, bins, cell, room, values, gradients):
    """Points and atoms relative to the cell's origin, atoms sorted by bin."""
    support = radii[0]
    support2 = support * support
    k = a_nk.shape[1]
    moments = len(w_n) > 0
    gradient = len(gradients) > 0
    g, d, _, _ = room
    (n0, n1, n2), _, _ = bins
    (v00, v01, v02), (v10, v11, v12), (v20, v21, v22) = cell[0]
    for p in range(len(points)):
        p0, p1, p2 = points[p, 0], points[p, 1], points[p, 2]
        (lo0, hi0), (lo1, hi1), (lo2, hi2) = _bins_reached(p0, p1, p2, support, bins, cell)
        for c0 in range(lo0, hi0 + 1):
            m0 = c0 // n0
            for c1 in range(lo1, hi1 + 1):
                m1 = c1 // n1
                for c2 in range(lo2, hi2 + 1):
                    m2 = c2 // n2
                    at = ((c0 - m0 * n0) * n1 + c1 - m1 * n1) * n2 + c2 - m2 * n2
                    q0 = m0 * v00 + m1 * v10 + m2 * v20 - p0
                    q1 = m0 * v01 + m1 * v11 + m2 * v21 - p1
                    q2 = m0 * v02 + m1 * v12 + m2 * v22 - p2
                    for n in range(start[at], start[at + 1]):
                        d[0], d[1], d[2] = x_nc[n, 0] + q0, x_nc[n, 1] + q1, x_nc[n, 2] + q2
                        r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                        if r2 >= support2:
                            continue
                        value = VALUE(d[0], d[1], d[2], r2, radii, coef, g)
                        for b in range(k):
                            a_ = a_nk[n, b]
                            values[p, b] += a_ * value
                            if gradient:
                                for c in range(3):
                                    gradients[p, b, c] -= a_ * g[c]
                        if moments:
                            for b in range(3):
                                a_ = w_n[n] * d[b]
                                values[p, k + b] += a_ * value
                                if gradient:
                                    for c in range(3):
                                        gradients[p, k + b, c] -= a_ * g[c]


def _gather_squares(points, radii, coef, x_nc, a_nk, w_n, start, bins, cell, room, values, gradients):
    """Σ_n a_n (Σ_images φ)²: what `_gather` takes, without moments and gradients."""
    support = radii[0]
    support2 = support * support
    k = a_nk.shape[1]
    g, _, phi_n, seen = room
    (n0, n1, n2), _, _ = bins
    (v00, v01, v02), (v10, v11, v12), (v20, v21, v22) = cell[0]
    x_at = address(x_nc)
    for p in range(len(points)):
        count = 0
        p0, p1, p2 = points[p, 0], points[p, 1], points[p, 2]
        (lo0, hi0), (lo1, hi1), (lo2, hi2) = _bins_reached(p0, p1, p2, support, bins, cell)
        for c0 in range(lo0, hi0 + 1):
            m0 = c0 // n0
            for c1 in range(lo1, hi1 + 1):
                m1 = c1 // n1
                for c2 in range(lo2, hi2 + 1):
                    m2 = c2 // n2
                    at = ((c0 - m0 * n0) * n1 + c1 - m1 * n1) * n2 + c2 - m2 * n2
                    q0 = m0 * v00 + m1 * v10 + m2 * v20 - p0
                    q1 = m0 * v01 + m1 * v11 + m2 * v21 - p1
                    q2 = m0 * v02 + m1 * v12 + m2 * v22 - p2
                    for n in range(start[at], start[at + 1]):
                        d0, d1, d2 = peek(x_at, 3 * n) + q0, peek(x_at, 3 * n + 1) + q1, peek(x_at, 3 * n + 2) + q2
                        r2 = d0 * d0 + d1 * d1 + d2 * d2
                        if r2 >= support2:
                            continue
                        value = VALUE(d0, d1, d2, r2, radii, coef, g)
                        if value == 0.0:
                            continue
                        if phi_n[n] == 0.0:
                            seen[count] = n
                            count += 1
                        phi_n[n] += value
        for m in range(count):
            n = seen[m]
            for b in range(k):
                values[p, b] += a_nk[n, b] * phi_n[n] * phi_n[n]
            phi_n[n] = 0.0


def _gather_slab(bound, kernel, cell, x_nc, a_nk, gradient, squared=False):
    """Averages over the cross-section: Σ a φ₁(z_j − z)/area."""
    axis = bound.axis
    height = cell.heights[axis]
    normal = cell.inverse[:, axis] * height
    marginal = profile_of(kernel, bound)
    z = (np.asarray(x_nc) - cell.origin) @ normal
    periodic = bool(cell.periodic[axis])
    if periodic:
        z = z - np.floor(z / height) * height
    order = np.argsort(z, kind="stable")
    z, a_nk = z[order], a_nk[order]
    bins = bound.shape[0]
    values = np.zeros((bins, a_nk.shape[1]))
    slopes = np.zeros((bins, a_nk.shape[1]))
    reach = marginal.support
    for g in range(bins):
        centre = (g + 0.5) / bins * height
        w_n = np.zeros(len(z))
        first, last = (
            (int(np.floor((centre - reach) / height)), int(np.floor((centre + reach) / height))) if periodic else (0, 0)
        )
        for image in range(first, last + 1):
            a, b = np.searchsorted(z, [centre - image * height - reach, centre - image * height + reach])
            d = z[a:b] + image * height - centre
            if squared:
                w_n[a:b] += marginal.phi(d)
                continue
            values[g] += marginal.phi(d) @ a_nk[a:b]
            if gradient:
                slopes[g] -= marginal.slope(d) @ a_nk[a:b]
        if squared:
            values[g] = w_n**2 @ a_nk
    area = cell.volume / height
    if squared:
        return values / area**2, None
    return values / area, slopes[:, :, None] * (normal / area) if gradient else None
