"""Peridynamic kernels fitted to a crystal's dispersion, stable at every wave length, and how well each model does.

The residual of a model is the relative error of ω at k = 0.1, 0.25, 0.5, 0.75 and 1 of the zone boundary on the
branches along [100], [110] and [111] (seven for a cubic crystal). D(k) is linear in a kernel's coefficients, so a fit
is least squares on ω² with linear constraints; ω² ≥ 0 outside the fitted band is imposed by cutting planes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from .crystal import Crystal
from .elasticity import ElasticConstants
from .force_constants import ForceConstants, nearest_images, signed_root
from .peridynamic_kernels import (
    Classical,
    CoarseLattice,
    FittedKernel,
    KernelBasis,
    Lattice,
    MollifiedLattice,
    ShellBasis,
)

#: Where residuals are taken, fractions of the zone boundary.
FRACTIONS = (0.1, 0.25, 0.5, 0.75, 1.0)

#: Directions and the polarisations that symmetry keeps pure along them: (direction, name, polarisation).
CUBIC_BRANCHES = (
    ((1, 0, 0), "L", (1, 0, 0)),
    ((1, 0, 0), "T", (0, 1, 0)),
    ((1, 1, 0), "L", (1, 1, 0)),
    ((1, 1, 0), "T1", (0, 0, 1)),
    ((1, 1, 0), "T2", (1, -1, 0)),
    ((1, 1, 1), "L", (1, 1, 1)),
    ((1, 1, 1), "T", (1, -1, 0)),
)


@dataclass(frozen=True)
class Branch:
    """One acoustic branch along a ray: where, how polarised, and how long the ray is (the zone boundary)."""

    direction: tuple
    name: str
    polarisation: np.ndarray
    unit: np.ndarray
    boundary: float

    @property
    def label(self) -> str:
        return "[" + "".join(f"{d:g}" for d in self.direction) + "] " + self.name

    def k(self, fractions) -> np.ndarray:
        """(f, 3) wave vectors."""
        return np.asarray(fractions)[:, None] * self.boundary * self.unit


def is_cubic(elastic: ElasticConstants, tolerance: float = 1e-6) -> bool:
    """Whether the elastic constants have the cube's symmetry, axes along x, y, z."""
    c11, c12, c44 = elastic.cubic
    ideal = np.zeros((6, 6))
    ideal[:3, :3] = c12
    ideal[[0, 1, 2], [0, 1, 2]] = c11
    ideal[[3, 4, 5], [3, 4, 5]] = c44
    return bool(np.abs(elastic.C_vv - ideal).max() < tolerance * abs(c11))


def cubic_branches(crystal: Crystal, factor: float = 1.0) -> list[Branch]:
    """The seven branches of a cubic crystal; `factor` divides the zone (coarse lattices)."""
    out = []
    for direction, name, p in CUBIC_BRANCHES:
        p = np.array(p, float) / np.linalg.norm(p)
        out.append(Branch(direction, name, p, crystal.direction(direction), crystal.zone_boundary(direction) / factor))
    return out


def branch_values(model, branch: Branch, fractions, velocities: bool = False):
    """ω² of the branch at `fractions` of its ray (negative: unstable); with `velocities` dω/dk too.

    Models of one displacement field: p·D·p, exact where symmetry keeps p pure. With more atoms a cell the branch is
    followed from long waves on, step by step by the overlap of eigenvectors, through whatever crosses it.
    """
    fractions = np.asarray(fractions, float)
    k = branch.k(fractions)
    D = model.dynamical_matrix(k)
    if D.shape[1] == 3:
        p = branch.polarisation
        value = np.einsum("i,kij,j->k", p, D.real, p)
        if not velocities:
            return value
        slope = np.einsum("i,kij,j->k", p, model.radial_gradient(k).real, p)
        with np.errstate(invalid="ignore", divide="ignore"):
            return value, slope / (2 * signed_root(value))
    path = np.unique(np.concatenate([np.linspace(1e-3, 1.0, 240), fractions]))
    values, modes = np.linalg.eigh(model.dynamical_matrix(branch.k(path)))
    n = len(model.crystal)
    whole = (np.sqrt(model.crystal.masses / model.crystal.masses.sum())[:, None, None] * np.eye(3)).reshape(3 * n, 3)
    current = whole @ branch.polarisation + 0j
    chosen = np.empty(len(path))
    vectors = np.empty((len(path), 3 * n), complex)
    for s in range(len(path)):
        # Project on each (nearly) degenerate space, so that an arbitrary basis within it does not matter.
        weight, at, start = -1.0, 0, 0
        for end in range(1, 3 * n + 1):
            if end < 3 * n and values[s, end] - values[s, end - 1] < 1e-7 * np.abs(values[s]).max():
                continue
            space = modes[s][:, start:end]
            inside = space @ (space.conj().T @ current)
            w = np.linalg.norm(inside)
            if w > weight:
                weight, at, best = w, start, inside / w
            start = end
        chosen[s], vectors[s], current = values[s, at], best, best
    where = np.searchsorted(path, fractions)
    if not velocities:
        return chosen[where]
    e = vectors[where]
    slope = np.einsum("ki,kij,kj->k", e.conj(), model.radial_gradient(k), e).real
    return chosen[where], slope / (2 * signed_root(chosen[where]))


# --------------------------------------------------------------------------------------------------------------------
# Fits.


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


# --------------------------------------------------------------------------------------------------------------------
# How well.


@dataclass
class Match:
    """A model against the crystal it stands for.

    Attributes
    ----------
    label : str
    branches : labels of the branches
    fractions : of the zone boundary (of the coarse zone for coarse lattices)
    error_bf : (branches, fractions) relative error of ω; 1 where ω is imaginary
    velocity_error_bf : error of the group velocity relative to the branch's speed of sound
    rms : over all of error_bf. band : over the whole zone, fifty fractions equally spaced
    min_omega2 : smallest ω² found outside the first zone's inscribed sphere up to |k| = 4 · 2π/a (lattices: in their
        zone), relative to the crystal's
        largest ω²; and where. stable : no ω² < 0 anywhere, long waves included
    omega_max : largest ω; stable time step 2/omega_max (internal units)
    """

    label: str
    branches: list[str]
    fractions: np.ndarray
    error_bf: np.ndarray
    velocity_error_bf: np.ndarray
    rms: float
    band: float
    min_omega2: float
    min_omega2_at: np.ndarray
    omega_max: float
    stable: bool
    model: object = None

    @property
    def stable_step(self) -> float:
        """2/ω_max, the limit of velocity Verlet, internal time."""
        return 2.0 / self.omega_max


def match(model, fc: ForceConstants, fractions=FRACTIONS) -> Match:
    """Residuals, group velocities, stability and the stable step of a model (see `Match`)."""
    factor = model.basis.factor if isinstance(model, CoarseLattice) else 1.0
    crystal, lattice = fc.crystal, Lattice(fc)
    branches = cubic_branches(crystal, factor)
    error, verror = [], []
    for b in branches:
        true, v_true = branch_values(lattice, b, fractions, velocities=True)
        mine, v_mine = branch_values(model, b, fractions, velocities=True)
        slow = np.sqrt(branch_values(lattice, b, [1e-3])[0]) / (1e-3 * b.boundary)
        error.append(signed_root(mine) / np.sqrt(true) - 1.0)
        verror.append((v_mine - v_true) / slow)
    error, verror = np.array(error), np.array(verror)
    dense = np.linspace(0.02, 1.0, 50)
    every = [
        signed_root(branch_values(model, b, dense)) / np.sqrt(branch_values(lattice, b, dense)) - 1.0 for b in branches
    ]
    band = float(np.sqrt(np.mean(np.square(every))))
    g = 2 * np.pi / np.linalg.norm(crystal.conventional[0])
    periodic = isinstance(model, (Lattice, CoarseLattice))
    if periodic:
        k = np.vstack([zone_wave_vectors(crystal, factor, 16), *(b.k(np.linspace(0.02, 1, 50)) for b in branches)])
    else:
        # Other points than those the fit looked at, and closer.
        k = np.vstack([wave_vectors(4 * g, g / 13.7)])
    values = np.linalg.eigvalsh(model.dynamical_matrix(k))
    beyond = np.linalg.norm(k, axis=1) >= 0.999 * min(b.boundary for b in branches)
    low, high = values[beyond, 0].min(), values[:, -1].max()
    at = k[beyond][int(np.argmin(values[beyond, 0]))]
    limit = model.onsite_matrix()
    if limit is not None:
        ends = np.linalg.eigvalsh(limit)
        high = max(high, ends[-1])
        if ends[0] < low:
            low, at = ends[0], np.full(3, np.inf)
    top = np.linalg.eigvalsh(fc.dynamical_matrix(zone_wave_vectors(crystal, 1.0, 16))).max()
    return Match(
        model.label,
        [b.label for b in branches],
        np.array(fractions),
        error,
        verror,
        float(np.sqrt(np.mean(error**2))),
        band,
        float(low / top),
        at,
        float(np.sqrt(high)),
        bool(values[:, 0].min() > -1e-9 * top and low > -1e-9 * top),
        model,
    )


MODELS = ("classical", "isotropic", "cubic", "noncentral", "mollified", "coarse2", "coarse3", "lattice")


def make_model(
    name: str,
    fc: ForceConstants,
    elastic: ElasticConstants,
    *,
    horizon=None,
    knots: int = 12,
    width=None,
    order: int = 4,
):
    """One of `MODELS` for a crystal. horizon, width: internal length (width by default as wide as the zone allows)."""
    if name == "classical":
        return Classical(elastic)
    if name == "lattice":
        return Lattice(fc)
    if name == "mollified":
        return MollifiedLattice(fc, width, order) if width else MollifiedLattice.for_zone(fc, order)
    if name in ("coarse2", "coarse3"):
        if len(fc.crystal) > 1:
            raise AtcError(
                f"{name}: coarse lattices are for crystals with one atom in the primitive cell; {fc.crystal.name} has "
                f"{len(fc.crystal)}"
            )
        return fit_coarse(fc, int(name[-1]))
    return fit_kernel(fc, name, horizon=horizon, knots=knots)
