"""Slow twins, to be checked by eye: kernels as in the literature, β by adaptive quadrature, sums as loops over images,
bonds and points."""

import itertools
import math

import numpy as np
from scipy.integrate import quad


def profile(name, s):
    """φ without its normalisation, s = r/R."""
    if s >= 1:
        return 0.0
    return {
        "step": lambda: 1.0,
        "linear": lambda: 1 - s,
        "cubic": lambda: 1 - 3 * s**2 + 2 * s**3,
        "quartic": lambda: (1 - s**2) ** 2,
        "lucy": lambda: (1 - s) ** 3 * (1 + 3 * s),
        "hardy": lambda: 1.0 if s < 0.5 else 2 * (1 - s),
    }[name]()


# Times π R³; formula sheet of the issue, and recomputed in test_kernels.
NORMALISATION = {"step": 3 / 4, "linear": 3, "cubic": 15 / 4, "quartic": 105 / 32, "lucy": 105 / 16, "hardy": 8 / 5}
RADIAL = tuple(NORMALISATION)


def cubic_bspline(v):
    """M4 by its defining recursion on the knots -2 .. 2."""

    def b(k, i, t):
        if k == 0:
            return 1.0 if i <= t < i + 1 else 0.0
        return ((t - i) * b(k - 1, i, t) + (i + k + 1 - t) * b(k - 1, i + 1, t)) / k

    return b(3, -2, v)


class NaiveKernel:
    """`name` and one length: R for radial kernels and bspline, w for gaussian, the edge of the cube for box, three
    edges of elements for trilinear; or a table."""

    def __init__(self, name, length=None, table=None):
        self.name, self.length, self.table = name, length, table
        if table is not None:
            r, v = np.array(table, float).T
            self.r, self.v = r, v
            f = lambda x: 4 * math.pi * x * x * np.interp(x, r, v, right=0.0)  # noqa: E731
            knots = [0.0, *r[r > 0]]
            self.norm = 1 / sum(quad(f, a, b, epsabs=1e-16, epsrel=1e-13)[0] for a, b in itertools.pairwise(knots))

    def phi(self, d):
        d = np.asarray(d, float)
        r = math.sqrt(d @ d)
        L = self.length
        if self.table is not None:
            return self.norm * float(np.interp(r, self.r, self.v, right=0.0)) if r < self.r[-1] else 0.0
        if self.name == "gaussian":
            return math.exp(-r * r / (2 * L * L)) / ((2 * math.pi) ** 1.5 * L**3)
        if self.name == "bspline":
            h = L / 2
            return math.prod(cubic_bspline(c / h) / h for c in d)
        if self.name == "trilinear":
            return math.prod(max(1 - abs(c) / h, 0.0) / h for c, h in zip(d, L))
        if self.name == "box":
            return 1 / L**3 if all(-L / 2 <= c < L / 2 for c in d) else 0.0
        return NORMALISATION[self.name] / (math.pi * L**3) * profile(self.name, r / L)

    def breaks(self, d, r):
        """Times at which the integrand along the bond may have a kink: spheres crossed, knot planes crossed, nearest
        approach."""
        L, out = self.length, []
        rr = float(r @ r)
        if rr == 0:
            return []
        if self.name == "trilinear":
            out = [(d[a] - p) / r[a] for a in range(3) for p in (-L[a], 0.0, L[a]) if r[a] != 0]
        elif self.name in ("bspline", "box"):
            planes = [k * L / 2 for k in (-2, -1, 0, 1, 2)] if self.name == "bspline" else [-L / 2, L / 2]
            out = [(d[a] - p) / r[a] for a in range(3) for p in planes if r[a] != 0]
        else:
            foot = float(d @ r) / rr
            across = d - foot * r
            radii = (
                self.r
                if self.table is not None
                else {"hardy": [L / 2, L], "gaussian": [L, 3 * L, 6 * L]}.get(self.name, [L])
            )
            out = [foot]
            for R in radii:
                chord = (R * R - float(across @ across)) / rr
                if chord > 0:
                    out += [foot - math.sqrt(chord), foot + math.sqrt(chord)]
        return [t for t in out if 0 < t < 1]

    def beta(self, d, r):
        """∫₀¹ φ(d − t r) dt by adaptive quadrature between the breaks."""
        d, r = np.asarray(d, float), np.asarray(r, float)
        peak = max(self.phi(np.zeros(3)), 1e-300)
        times = [0.0, *sorted(self.breaks(d, r)), 1.0]
        return sum(
            quad(lambda t: self.phi(d - t * r), a, b, epsabs=1e-15 * peak, epsrel=1e-13, limit=200)[0]
            for a, b in itertools.pairwise(times)
            if b > a
        )


def images(cell, reach):
    """(t, 3) all translations by periodic cell vectors that are no longer than `reach`."""
    n = [math.ceil(reach / h) if p else 0 for h, p in zip(cell.heights, cell.periodic)]
    T = np.stack(np.meshgrid(*[np.arange(-m, m + 1) for m in n], indexing="ij"), -1).reshape(-1, 3) @ cell.vectors
    return T[np.linalg.norm(T, axis=1) <= reach]


def site_sums(points, cell, kernel_phi, support, x, a, many=False):
    """Σ_j Σ_images a_j φ(x_j + T − x). `kernel_phi` takes one vector, or with `many` several."""
    none = np.zeros_like(x)
    return bond_sums(points, cell, (lambda d, r: kernel_phi(d)), support, x, none, a, many)


def bond_sums(points, cell, kernel_beta, support, x, r, b, many=False):
    """Σ_bonds Σ_images b β: the bond runs from x to x − r. `kernel_beta` takes one d and one r, or with `many`
    several."""
    out = np.zeros((len(points), b.shape[1]))
    length2 = np.maximum(np.einsum("bc,bc->b", r, r), 1e-300)
    for g, p in enumerate(points):
        # |T| ≤ support + |x − p| + |r|, or the whole bond is out of reach.
        far = support + np.linalg.norm(x - p, axis=1).max() + np.linalg.norm(r, axis=1).max()
        T = images(cell, far)
        d = x[None] + T[:, None] - p
        # Distance from the point to the bond.
        t = np.clip(np.einsum("tbc,bc->tb", d, r) / length2, 0, 1)
        near, bond = np.nonzero(((d - t[..., None] * r) ** 2).sum(-1) < (support * 1.0001) ** 2)
        if many:
            out[g] = kernel_beta(d[near, bond], r[bond]) @ b[bond]
        else:
            for m, k in zip(near, bond):
                out[g] += b[k] * kernel_beta(d[m, k], r[k])
    return out
