"""Peridynamic kernels fitted to a crystal's dispersion, stable at every wave length.

D(k) is linear in a kernel's coefficients, so a fit is least squares on ω² with linear constraints; ω² ≥ 0 outside the
fitted band is imposed by cutting planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from .branches import FRACTIONS, Branch, branch_values, cubic_branches
from .crystal import Crystal
from .force_constants import ForceConstants, nearest_images
from .peridynamic_kernels import CoarseLattice, FittedKernel, KernelBasis, Lattice, ShellBasis


@dataclass
class Target:
    """What a kernel is fitted to: ω² of the crystal along its branches."""

    branches: list[Branch]
    fractions: np.ndarray
    values: np.ndarray  # (branches, fractions)
    weights: np.ndarray  # (fractions,)


def target_of(fc: ForceConstants, factor: float = 1.0, between: float = 1.0) -> Target:
    """ω² at `FRACTIONS` with weight 1, and every twentieth of the zone boundary in between with the weight
    `between`."""
    fractions = np.unique(np.round(np.concatenate([np.linspace(0.05, 1.0, 20), FRACTIONS]), 12))
    weights = np.where(np.isclose(fractions[:, None], FRACTIONS).any(axis=1), 1.0, between)
    branches = cubic_branches(fc.crystal, factor)
    lattice = Lattice(fc)
    values = np.array([branch_values(lattice, b, fractions) for b in branches])
    if (values <= 0).any():
        worst = branches[int(np.argmin(values.min(axis=1)))]
        raise AtcError(
            f"{fc.crystal.name}: the lattice itself is unstable along {worst.label} (imaginary frequencies): no "
            "kernel can be fitted; "
            "check the lattice constant and the potential"
        )
    return Target(branches, fractions, values, weights)


def wave_vectors(cutoff: float, spacing: float, lines: int = 10) -> np.ndarray:
    """(k, 3) points of the wedge kx ≥ ky ≥ kz ≥ 0 with 0 < |k| ≤ cutoff, `lines` times denser along [100], [110] and
    [111]."""
    m = int(np.ceil(cutoff / spacing))
    n = np.stack(np.meshgrid(*(np.arange(m + 1),) * 3, indexing="ij"), -1).reshape(-1, 3)
    n = n[(n[:, 0] >= n[:, 1]) & (n[:, 1] >= n[:, 2]) & (n[:, 0] > 0)]
    q = np.arange(1, lines * m + 1)[:, None] * (spacing / lines)
    k = np.vstack([n * spacing, *(q * np.array(d) / np.linalg.norm(d) for d in ((1, 0, 0), (1, 1, 0), (1, 1, 1)))])
    return k[np.linalg.norm(k, axis=1) <= cutoff * (1 + 1e-9)]


def zone_wave_vectors(crystal: Crystal, factor: float, n: int = 12) -> np.ndarray:
    """(k, 3) a uniform mesh of the (coarse) Brillouin zone, half of it: D(−k) is D(k)'s conjugate."""
    s = np.stack(
        np.meshgrid(*((np.arange(n) + 0.5) / n,) * 2, (np.arange(n // 2) + 0.5) / n, indexing="ij"), -1
    ).reshape(-1, 3)
    return nearest_images(s @ (crystal.reciprocal / factor), crystal.reciprocal / factor)


class LeastSquares:
    """min |Ax − b| subject to Gx ≥ h, A of full column rank (Lawson and Hanson, chapter 23: by way of a non-negative
    problem)."""

    def __init__(self, A, b):
        q, self.r = np.linalg.qr(A)
        self.x0 = np.linalg.solve(self.r, q.T @ b)

    def solve(self, G, h) -> np.ndarray:
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls

        x0 = self.x0
        if not len(G) or (G @ x0 >= h - 1e-12 * np.abs(h)).all():
            return x0
        M = solve_triangular(self.r, G.T, trans="T").T  # constraints on z = r(x − x0)
        v = h - G @ x0
        scale = np.linalg.norm(M, axis=1)
        M, v = M / scale[:, None], v / scale
        size = max(np.abs(v).max(), 1e-300)
        E = np.vstack([M.T, v / size])
        f = np.zeros(len(E))
        f[-1] = 1.0
        u, _ = nnls(E, f, maxiter=100 * E.shape[1])
        residual = E @ u - f
        if residual[-1] > -1e-14:
            raise AtcError("no kernel of this kind is stable: give it a longer horizon or more knots")
        return x0 + np.linalg.solve(self.r, -residual[:-1] / residual[-1] * size)


def fit_linear(
    basis,
    target: Target,
    *,
    nonnegative: bool = False,
    stable_k=None,
    floor: float = 0.02,
    ceiling: float = 1.3,
    smooth: float = 3e-4,
) -> np.ndarray:
    """Coefficients of a kernel linear in them: least squares on the relative error of ω², stable at every k of
    `stable_k`.

    Parameters
    ----------
    basis : with ``matrices(k)``, ``onsite()``, ``size``
    nonnegative : every coefficient ≥ 0 (then no instability is possible)
    stable_k : (k, 3) wave vectors at which ω² must lie between `floor` times min(1, (k/k_boundary)²) times the smallest
        ω² at the zone boundary, and
        `ceiling` times the largest ω² of the target. Planes are cut until it is so everywhere. The ceiling keeps the
        stable time step near the lattice's, and D(k) smooth between the points of `stable_k`.
    smooth : weight of the kernel's size, √(∫|C|²) in units of the largest ω², against the residual: keeps it from being
        rough where the data leave it open
    """
    rows, rhs = [], []
    for b, values in zip(target.branches, target.values):
        B = np.einsum("i,kmij,j->km", b.polarisation, basis.matrices(b.k(target.fractions)), b.polarisation)
        rows.append(0.5 * B / values[:, None] * target.weights[:, None])
        rhs.append(0.5 * target.weights)
    A, y = np.concatenate(rows), np.concatenate(rhs)
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    A = A / scale
    if nonnegative:
        from scipy.optimize import nnls

        return nnls(A, y, maxiter=200 * A.shape[1])[0] / scale
    size = smooth * basis.norms() / scale / target.values.max()
    A, y = np.vstack([A, np.diag(size)]), np.concatenate([y, np.zeros(A.shape[1])])
    if stable_k is None:
        return LeastSquares(A, y).x0 / scale
    limits = _Limits(target, floor, ceiling)
    rng = np.random.default_rng(0)
    k, limit = stable_k, basis.onsite()
    M = basis.matrices(k) / scale[None, :, None, None]
    G, h = np.zeros((0, len(scale))), np.zeros(0)
    problem, clean = LeastSquares(A, y), 0
    for _ in range(200):
        x = problem.solve(G, h)
        rows, need, slack = limits.cuts(x, k, M)
        if limit is not None:
            more = limits.cuts(x, np.full((1, 3), np.inf), limit[None] / scale[None, :, None, None])
            rows, need = np.vstack([rows, more[0]]), np.append(need, more[1])
        if len(need):
            if len(G) > 300:
                # Planes far from this kernel have served: those that come to matter again are cut again.
                near = G @ x - h < 0.1 * limits.reference
                G, h = G[near], h[near]
            G, h, clean = np.vstack([G, rows]), np.append(h, need), 0
            continue
        if clean == 2:
            return x / scale
        # Nothing is broken at the points known so far: look between them, around those that are nearest to it.
        clean += 1
        near = np.argsort(slack)[:40]
        new = (k[near][:, None, :] + rng.uniform(-1, 1, (len(near), 15, 3)) * 0.12 * limits.boundary / clean).reshape(
            -1, 3
        )
        far = np.linalg.norm(stable_k, axis=1).max()
        new = np.vstack([new, k[rng.integers(len(stable_k), size=500)] + rng.normal(size=(500, 3)) * 0.05 * far])
        new = new[(np.linalg.norm(new, axis=1) <= far) & (np.linalg.norm(new, axis=1) > 0.05 * limits.boundary)]
        if limit is None:
            new = nearest_images(new, basis.reciprocal)
        extra = basis.matrices(new) / scale[None, :, None, None]
        # Keep those that matter: the ones this kernel breaks or nearly breaks.
        keep = np.argsort(limits.cuts(x, new, extra)[2])[:400]
        k, M = np.vstack([k, new[keep]]), np.concatenate([M, extra[keep]])
    raise AtcError(
        "the fitted kernel did not become stable within 200 rounds of cutting planes: give it a longer horizon or "
        "more knots"
    )


class _Limits:
    """The bounds on ω²: a floor that no wave may fall below, a ceiling that none may exceed."""

    def __init__(self, target: Target, floor: float, ceiling: float):
        self.reference = target.values[:, -1].min()
        self.top = ceiling * target.values.max()
        self.floor = floor * self.reference
        self.boundary = min(b.boundary for b in target.branches)

    def cuts(self, x, k, M):
        """Planes (rows, right-hand sides) that the coefficients x violate, the worst first and a few dozen at most; and
        each k's slack."""
        need = self.floor * np.minimum(1.0, (np.linalg.norm(k, axis=1) / self.boundary) ** 2)
        values, modes = np.linalg.eigh(np.einsum("m,kmij->kij", x, M))
        below, above = (values[:, 0] - need) / self.reference, (self.top - values[:, 2]) / self.reference
        rows, rhs = [np.zeros((0, M.shape[1]))], [np.zeros(0)]
        for sign, which, slack in ((1, 0, below), (-1, 2, above)):
            bad = np.flatnonzero(slack < -1e-6)
            bad = bad[np.argsort(slack[bad])][:40]
            e = modes[bad, :, which]
            rows.append(sign * np.einsum("ki,kmij,kj->km", e, M[bad], e))
            rhs.append((need[bad] if sign > 0 else np.full(len(bad), -self.top)) + 1e-7 * self.reference)
        return np.vstack(rows), np.concatenate(rhs), np.minimum(below, above)


def fit_kernel(
    fc: ForceConstants, kind: str = "cubic", *, horizon: float | None = None, knots: int = 12, floor: float = 0.02
) -> FittedKernel:
    """A continuous peridynamic kernel for a cubic crystal.

    Parameters
    ----------
    fc : ForceConstants of a cubic crystal, cube axes along x, y, z
    kind : "isotropic" (a non-negative influence function, central forces), "cubic" (cubic harmonics of degree 0, 4, 6,
        central), "noncentral" (the
        same with transverse forces)
    horizon : internal length; default: 1.2 times the reach of the force constants
    knots : hats of each influence function
    floor : see `fit_linear`

    Returns
    -------
    FittedKernel; one displacement field, so with several atoms a cell it follows the acoustic branches.
    """
    forms = {
        "isotropic": ((0,), ("central",), "isotropic, non-negative"),
        "cubic": ((0, 4, 6), ("central",), "cubic, central"),
        "noncentral": ((0, 4, 6), ("central", "transverse"), "cubic, non-central"),
    }
    if kind not in forms:
        raise AtcError(f"kernel kind {kind!r}: expected one of {', '.join(forms)}")
    degrees, kinds, label = forms[kind]
    crystal = fc.crystal
    basis = KernelBasis(crystal, float(horizon or 1.2 * fc.reach), knots, degrees, kinds)
    g = 2 * np.pi / np.linalg.norm(crystal.conventional[0])
    stable = None if kind == "isotropic" else wave_vectors(4.05 * g, g / 6)
    return FittedKernel(
        basis, fit_linear(basis, target_of(fc), nonnegative=kind == "isotropic", stable_k=stable, floor=floor), label
    )


def fit_coarse(fc: ForceConstants, factor: int, *, horizon: float | None = None, floor: float = 0.02) -> CoarseLattice:
    """Force constants on a lattice `factor` times coarser that follow the crystal up to the coarse zone boundary.

    horizon : internal length; default: 2 · factor times the reach of the force constants (half of that costs accuracy:
        6 % instead of 1 % for argon).
    """
    basis = ShellBasis(fc.crystal, factor, float(horizon or 2 * factor * fc.reach))
    x = fit_linear(basis, target_of(fc, factor), stable_k=zone_wave_vectors(fc.crystal, factor), floor=floor)
    return CoarseLattice(basis, x, f"coarse lattice, {factor}a")
