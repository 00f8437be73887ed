"""Linear bond-based peridynamic models of a crystal, ρ ü(x) = ∫ C(ξ) (u(x+ξ) − u(x)) dξ, and their dynamical matrices.

Every model has ``dynamical_matrix(k_kc)`` (k, m, m), ``radial_gradient(k_kc)`` = dD/d|k| along the ray, and
``onsite_matrix()``, what D tends to as |k| → ∞ (None for lattices, where it is periodic). A crystal's `ForceConstants`
wrapped in `Lattice` is one of them: peridynamics with one node an atom. Internal units.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import factorial

import numpy as np

from .crystal import Crystal
from .elasticity import ElasticConstants
from .force_constants import ForceConstants


class _Model:
    """What the models of a crystal have in common."""

    #: how many times coarser its nodes are than the crystal's cells
    factor = 1
    #: displacement fields: one, or one of each atom of the cell
    fields = 1


class Periodic(_Model):
    """Models whose D(k) is periodic, or unbounded, and tends to nothing."""

    def onsite_matrix(self):
        """What D(k) tends to for short waves: nothing."""
        return None


class Lattice(Periodic):
    """The crystal itself: discrete peridynamics with a node at every atom, its bonds those of the force constants."""

    label = "discrete, on the lattice"

    def __init__(self, fc: ForceConstants):
        self.fc = fc
        self.crystal = fc.crystal

    def dynamical_matrix(self, k_kc):
        return self.fc.dynamical_matrix(k_kc)

    def radial_gradient(self, k_kc):
        return self.fc.gradient(k_kc, _unit(k_kc))


class Classical(Periodic):
    """The classical continuum, ω = c k: what every model tends to for long waves."""

    label = "classical"

    def __init__(self, elastic: ElasticConstants):
        self.elastic = elastic
        self.crystal = elastic.crystal

    def dynamical_matrix(self, k_kc):
        return self.elastic.christoffel(k_kc)

    def radial_gradient(self, k_kc):
        k = np.atleast_2d(k_kc)
        return 2 * self.elastic.christoffel(k) / np.linalg.norm(k, axis=1)[:, None, None]


class MollifiedLattice(_Model):
    """Every bond of the lattice smeared out: C(ξ) = −(1/V) Σ_R Φ(R) g(ξ − R), ĝ(k) = e^{−x} Σ_{j≤p} x^j/j!, x = k²w²/2.

    Then D(k) = ĝ D_lattice + (1 − ĝ) D₀ with D₀ the on-site part, a mean of two positive semidefinite matrices: stable
    whenever the lattice is, at every wave length. ĝ = 1 − O(k^{2p+2}), so the elastic constants are exact for p ≥ 1. In
    space g is a Gaussian of width w times a Laguerre polynomial. A crystal of n atoms a cell has n displacement fields.

    Parameters
    ----------
    fc : ForceConstants
    width : w, internal length
    order : p ≥ 0
    """

    def __init__(self, fc: ForceConstants, width: float, order: int = 4):
        self.fc, self.width, self.order = fc, float(width), int(order)
        self.crystal = fc.crystal
        self.label = "mollified lattice kernel"
        self.lattice = Lattice(fc)
        self.fields = len(self.crystal)

    def transform(self, k):
        """ĝ at |k|."""
        x = 0.5 * (np.asarray(k) * self.width) ** 2
        return np.exp(-x) * sum(x**j / factorial(j) for j in range(self.order + 1))

    def mollifier(self, r):
        """g at distance r (1/volume): (2πw²)^(-3/2) exp(−s) L_p^{(3/2)}(s), s = r²/2w²."""
        from scipy.special import eval_genlaguerre

        s = 0.5 * (np.asarray(r) / self.width) ** 2
        return (2 * np.pi * self.width**2) ** -1.5 * np.exp(-s) * eval_genlaguerre(self.order, 1.5, s)

    def kernel(self, xi_bc, a: int = 0, b: int = 0):
        """(b, 3, 3) C(ξ) between the fields of basis atoms a and b: energy/length² per volume, squared."""
        fc = self.fc
        which = np.flatnonzero((fc.i == a) & (fc.j == b))
        d = np.linalg.norm(np.asarray(xi_bc)[:, None, :] - fc.r_bc[which][None], axis=2)
        return -np.tensordot(self.mollifier(d), fc.phi_bcc[which], axes=1) / self.crystal.volume

    @classmethod
    def for_zone(cls, fc: ForceConstants, order: int = 4, loss: float = 5e-4) -> MollifiedLattice:
        """As wide as can be with ĝ ≥ 1 − `loss` up to the farthest corner of the first zone's symmetry lines."""
        from scipy.optimize import brentq

        far = max(fc.crystal.zone_boundary(d) for d in ((1, 0, 0), (1, 1, 0), (1, 1, 1)))
        left = lambda x: np.exp(-x) * sum(x**j / factorial(j) for j in range(order + 1))  # noqa: E731
        x = brentq(lambda x: 1 - left(x) - loss, 1e-9, order + 1.0)
        return cls(fc, np.sqrt(2 * x) / far, order)

    @property
    def horizon(self) -> float:
        """Where |g| has fallen below 1e-4 of its value at 0, beyond the farthest bond."""
        r = np.linspace(0, 12 * self.width, 2400)
        g = np.abs(self.mollifier(r))
        return float(np.linalg.norm(self.fc.r_bc, axis=1).max() + r[np.flatnonzero(g > 1e-4 * g[0])[-1]])

    def dynamical_matrix(self, k_kc):
        k = np.atleast_2d(k_kc)
        g = self.transform(np.linalg.norm(k, axis=1))[:, None, None]
        return g * self.fc.dynamical_matrix(k) + (1 - g) * self.fc.onsite_matrix()

    def radial_gradient(self, k_kc):
        k = np.atleast_2d(k_kc)
        q = np.linalg.norm(k, axis=1)
        x = 0.5 * (q * self.width) ** 2
        slope = (-np.exp(-x) * x**self.order / factorial(self.order) * q * self.width**2)[:, None, None]
        g = self.transform(q)[:, None, None]
        return slope * (self.fc.dynamical_matrix(k) - self.fc.onsite_matrix()) + g * self.lattice.radial_gradient(k)

    def onsite_matrix(self):
        return self.fc.onsite_matrix()


# --------------------------------------------------------------------------------------------------------------------
# Kernels that are linear in coefficients.


def cubic_harmonic(l: int, n_qc) -> np.ndarray:
    """Cubic harmonics of degree 0, 4, 6 on unit vectors (not normalised)."""
    x2, y2, z2 = (n_qc**2).T
    four = x2**2 + y2**2 + z2**2 - 0.6
    if l == 0:
        return np.ones(len(n_qc))
    if l == 4:
        return four
    if l == 6:
        return x2 * y2 * z2 + four / 22 - 1 / 105
    raise ValueError(f"no cubic harmonic of degree {l} here")


def bond_tensors(n_qc, kinds) -> np.ndarray:
    """(kinds, q, 3, 3) tensors of a bond along n: central n⊗n, transverse 1 − n⊗n, cubic diag(n²)."""
    nn = n_qc[:, :, None] * n_qc[:, None, :]
    made = {"central": nn, "transverse": np.eye(3) - nn, "cubic": nn * np.eye(3)}
    return np.array([made[k] for k in kinds])


@dataclass
class KernelBasis:
    """C(ξ) = Σ coefficient · hat_m(|ξ|) K_l(ξ̂) T(ξ̂): piecewise linear influence functions times cubic harmonics times
    bond tensors.

    Attributes
    ----------
    crystal : Crystal
    horizon : δ, internal length; the hats vanish there
    knots : number of hats, at 0, δ/knots, ..., δ(1 − 1/knots)
    degrees : subset of (0, 4, 6). kinds : subset of ("central", "transverse", "cubic")
    """

    crystal: Crystal
    horizon: float
    knots: int
    degrees: tuple = (0,)
    kinds: tuple = ("central",)
    _r: np.ndarray = field(init=False, repr=False)
    _hat_rm: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        # Gauss points between knots: exact for hat · r² · (a smooth oscillation resolved by them).
        x, w = np.polynomial.legendre.leggauss(6)
        h = self.horizon / self.knots
        r = (np.arange(self.knots)[:, None] + 0.5 * (x + 1)).ravel() * h
        self._r = r
        weight = np.tile(0.5 * h * w, self.knots) * r**2
        self._hat_rm = self.hats(r) * weight[:, None]
        # Angular quadrature of the sphere, exact to degree 31 (integrands have at most 2·8 + 2).
        c, wc = np.polynomial.legendre.leggauss(16)
        phi = 2 * np.pi * (np.arange(32) + 0.5) / 32
        s = np.sqrt(1 - c**2)
        n = np.stack([np.outer(s, np.cos(phi)), np.outer(s, np.sin(phi)), np.outer(c, np.ones(32))], -1)
        self._n = n.reshape(-1, 3)
        f = self._angular(self._n)
        self._weights = np.repeat(wc, 32) * (2 * np.pi / 32)
        self._f_qac = np.stack(f, 1).reshape(len(self._n), len(f), 9) * self._weights[:, None, None]

    def _angular(self, n_qc) -> list:
        """[(q, 3, 3)] cubic harmonics times bond tensors along n."""
        return [
            cubic_harmonic(l, n_qc)[:, None, None] * t for l in self.degrees for t in bond_tensors(n_qc, self.kinds)
        ]

    def hats(self, r) -> np.ndarray:
        """(r, m) the influence functions at distances r."""
        x = np.asarray(r)[:, None] * (self.knots / self.horizon) - np.arange(self.knots)
        return np.clip(1 - np.abs(x), 0, None)

    @property
    def size(self) -> int:
        return len(self.degrees) * len(self.kinds) * self.knots

    def matrices(self, k_kc, gradient: bool = False) -> np.ndarray:
        """(k, size, 3, 3) D(k) of each basis function, ∫ C (1 − cos k·ξ) dξ / ρ, or its derivative along the ray.

        By the plane wave's expansion: ∫ f(ξ̂) cos(k·ξ) dΩ = 4π Σ_L (−1)^{L/2} j_L(kr) f_L(k̂) with f_L the part of
        degree L, which Funk and Hecke's formula projects out.
        """
        from scipy.special import eval_legendre, spherical_jn

        k = np.atleast_2d(np.asarray(k_kc, float))
        q = np.linalg.norm(k, axis=1)
        cosine = _unit(k) @ self._n.T
        z = q[:, None] * self._r
        angular, radial = [], []
        for L in range(0, max(self.degrees) + 4, 2):
            angular.append((L + 0.5) * 2 * (eval_legendre(L, cosine) @ self._f_qac.reshape(len(self._n), -1)))
            if gradient:
                f = -((-1) ** (L // 2)) * spherical_jn(L, z, derivative=True) * self._r
            else:
                f = one_minus_sinc(z) if L == 0 else -((-1) ** (L // 2)) * spherical_jn(L, z)
            radial.append(f @ self._hat_rm)
        out = np.stack(angular, -1) @ np.stack(radial, 1)  # (k, kind · 9, m)
        out = out.reshape(len(k), -1, 9, self.knots).transpose(0, 1, 3, 2)
        return out.reshape(len(k), self.size, 3, 3) / self.crystal.density

    def norms(self) -> np.ndarray:
        """(size,) root of ∫|C|² dξ · volume of the horizon, over ρ: no ω² of the basis function is larger than twice
        that."""
        radial = (self._hat_rm.T @ self.hats(self._r)).diagonal()
        # self._f_qac carries the quadrature's weights once: divide one of the two out.
        angular = np.einsum("qac,qac,q->a", self._f_qac, self._f_qac, 1.0 / self._weights)
        volume = 4 / 3 * np.pi * self.horizon**3
        return np.sqrt(np.outer(angular, radial) * volume).ravel() / self.crystal.density

    def onsite(self) -> np.ndarray:
        """(size, 3, 3) the limit k → ∞: ∫ C dξ / ρ."""
        angular = self._f_qac.sum(axis=0)
        return (angular[:, None, :] * self._hat_rm.sum(axis=0)[None, :, None]).reshape(
            self.size, 3, 3
        ) / self.crystal.density

    def kernel(self, xi_bc) -> np.ndarray:
        """(size, b, 3, 3) each basis function at ξ; 0 beyond the horizon."""
        xi = np.atleast_2d(np.asarray(xi_bc, float))
        r = np.linalg.norm(xi, axis=1)
        t = self._angular(_unit(xi))
        hats = self.hats(r) * (r > 0)[:, None]
        return (np.array(t)[:, None] * hats.T[None, :, :, None, None]).reshape(self.size, len(xi), 3, 3)


class _Fitted(_Model):
    """Matrices that are linear in fitted `coefficients` of a `basis`."""

    @property
    def crystal(self) -> Crystal:
        return self.basis.crystal

    @property
    def horizon(self) -> float:
        return self.basis.horizon

    def dynamical_matrix(self, k_kc):
        return np.einsum("m,kmij->kij", self.coefficients, self.basis.matrices(k_kc))

    def radial_gradient(self, k_kc):
        return np.einsum("m,kmij->kij", self.coefficients, self.basis.matrices(k_kc, gradient=True))


@dataclass
class FittedKernel(_Fitted):
    """A kernel with its coefficients: what `atc.upscaling.fitting.fit_kernel` returns."""

    basis: KernelBasis
    coefficients: np.ndarray
    label: str = "fitted kernel"

    def onsite_matrix(self):
        return np.einsum("m,mij->ij", self.coefficients, self.basis.onsite())

    def kernel(self, xi_bc) -> np.ndarray:
        """(b, 3, 3) C(ξ), energy/length² per volume squared."""
        return np.einsum("m,mbij->bij", self.coefficients, self.basis.kernel(xi_bc))


@dataclass
class ShellBasis:
    """Force constants on a coarser copy of a Bravais crystal's lattice: for each orbit of cubic symmetry its bond
    tensors.

    `factor` 2 or 3 scales the lattice; a node has the mass of factor³ cells. `horizon` is a distance in internal
    length.
    """

    crystal: Crystal
    factor: int
    horizon: float
    kinds: tuple = ("central", "transverse", "cubic")

    def __post_init__(self):
        A = self.crystal.vectors * self.factor
        reach = np.ceil(self.horizon / (1.0 / np.linalg.norm(np.linalg.inv(A), axis=0))).astype(int)
        n = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in reach), indexing="ij"), -1).reshape(-1, 3)
        r = n @ A
        d = np.linalg.norm(r, axis=1)
        r = r[(d > 1e-9) & (d <= self.horizon * (1 + 1e-9))]
        # Orbits: equal sorted |components| in units of the cube's edge.
        key = np.sort(np.abs(r), axis=1)
        edge = np.linalg.norm(self.crystal.conventional[0])
        _, orbit = np.unique(np.round(key / edge, 6), axis=0, return_inverse=True)
        order = np.argsort(orbit.ravel(), kind="stable")
        self.r_bc, self.orbit = r[order], orbit.ravel()[order]
        self.mass = self.crystal.masses.sum() * self.factor**3
        t = bond_tensors(_unit(self.r_bc), self.kinds)
        self._t = t.reshape(len(self.kinds), len(self.r_bc), 9)
        self.orbits = int(self.orbit.max()) + 1

    @property
    def size(self) -> int:
        return len(self.kinds) * self.orbits

    @property
    def reciprocal(self) -> np.ndarray:
        """Rows: reciprocal vectors of the coarse lattice."""
        return self.crystal.reciprocal / self.factor

    def matrices(self, k_kc, gradient: bool = False) -> np.ndarray:
        """(k, size, 3, 3) D(k) of each spring constant, or its derivative along the ray."""
        k = np.atleast_2d(np.asarray(k_kc, float))
        phase = k @ self.r_bc.T
        f = np.sin(phase) * (_unit(k) @ self.r_bc.T) if gradient else 2 * np.sin(0.5 * phase) ** 2
        out = np.zeros((len(k), len(self.kinds), self.orbits, 9))
        starts = np.searchsorted(self.orbit, np.arange(self.orbits + 1))
        for o in range(self.orbits):
            s = slice(starts[o], starts[o + 1])
            out[:, :, o] = np.einsum("kb,tbc->ktc", f[:, s], self._t[:, s])
        return out.reshape(len(k), self.size, 3, 3) / self.mass

    def norms(self) -> np.ndarray:
        """(size,) the largest ω² of each."""
        starts = np.searchsorted(self.orbit, np.arange(self.orbits))
        return 2 * np.add.reduceat(np.abs(self._t).max(axis=2), starts, axis=1).ravel() / self.mass

    def onsite(self):
        return None


@dataclass
class CoarseLattice(Periodic, _Fitted):
    """Nodes on a coarser lattice with fitted force constants; `basis` says which."""

    basis: ShellBasis
    coefficients: np.ndarray
    label: str = "coarse lattice"

    @property
    def factor(self) -> int:
        return self.basis.factor

    def springs(self) -> tuple[np.ndarray, np.ndarray]:
        """(b, 3) bonds of a node and (b, 3, 3) their spring constants (energy/length²)."""
        c = self.coefficients.reshape(len(self.basis.kinds), self.basis.orbits)[:, self.basis.orbit]
        return self.basis.r_bc, np.einsum("tb,tbc->bc", c, self.basis._t).reshape(-1, 3, 3)


def one_minus_sinc(z):
    """1 − sin(z)/z without cancellation for small z."""
    z = np.asarray(z, float)
    small = np.abs(z) < 0.5
    z2 = np.where(small, z * z, 0.0)
    series = z2 / 6 * (1 - z2 / 20 * (1 - z2 / 42 * (1 - z2 / 72 * (1 - z2 / 110 * (1 - z2 / 156)))))
    safe = np.where(small, 1.0, z)
    return np.where(small, series, 1 - np.sin(safe) / safe)


def _unit(v):
    v = np.atleast_2d(np.asarray(v, float))
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)
