"""Long-range dispersion, −C_ij/r⁶ of all pairs: what is inside a cutoff as bonds, the smooth rest by its modes.

With b = αr the bonds are −C e^{−b²}(1 + b² + b⁴/2)/r⁶ (Karasawa & Goddard, J. Phys. Chem. 93 (1989) 7320). The rest has
the modes, x = k/2α,

    V(k²) = −(π^{3/2}/12) [√π k³ erfc(x) + (4α³ − 2αk²) e^{−x²}],   V(0) = −π^{3/2} α³/3

and the stress of the package's docstring with this V. The matrix of the C_ij, types by types, is a sum of products λ w
wᵀ, each like charges of its own: no mixing rule is needed. The divided difference D(a, b) of V is a sum of few products
as well, Σ λ_r f_r(a) f_r(b), found as its eigenfunctions: with ψ_r of modes f_r ρ and Φ of modes V ρ,

    σ = −λ { ½ (ρΦ − ½ ∇² Σ λ_r ψ_r²) 1 + Σ λ_r ∇ψ_r⊗∇ψ_r },

and with currents J like ρ, j_r like ψ_r and W of modes V J the energy current

    A = ½ λ { ½ (Wρ + JΦ) + Σ λ_r [−½ ∇²(j_r ψ_r) + (∇ j_r)·∇ψ_r + (∇·j_r) ∇ψ_r] }.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from math import exp, pi, sqrt

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..base import Term, Work
from ..pairs.pairs import MAX_TYPES, kinds_of
from .ewald import Smooth, SmoothWork
from .split import ACCURACY, Gaussian
from .stress import Products
from .transform import wave_vectors

#: Shares of the matrix of the C_ij below this are rounding.
_ROUNDING = 1e-13
#: Gauss-Legendre nodes that the eigenfunctions of D are found on, and points of their tables.
_NODES, _TABLE = 160, 3000


@dataclass(frozen=True)
class DispersionSplit(Gaussian):
    """Where −C/r⁶ is split, as `Split`."""

    alpha: float
    cutoff: float
    accuracy: float = ACCURACY

    @classmethod
    def of(cls, cutoff: float, accuracy: float = ACCURACY) -> DispersionSplit:
        """The smallest α whose bonds end at the cutoff."""
        return cls(_reach(accuracy) / cutoff, cutoff, accuracy)

    def at(self, accuracy: float) -> DispersionSplit:
        """The same α with another accuracy."""
        return DispersionSplit(self.alpha, _reach(accuracy) / self.alpha, accuracy)

    def modes(self, k):
        """V and dV/dk² at wave numbers k."""
        from scipy.special import erfc

        a, x = self.alpha, k / (2.0 * self.alpha)
        gauss, tail = np.exp(-x * x), sqrt(pi) * erfc(x)
        V = -(pi**1.5 / 12.0) * (k**3 * tail + (4.0 * a**3 - 2.0 * a * k * k) * gauss)
        return V, -(pi**1.5 / 8.0) * (k * tail - 2.0 * a * gauss)


def _reach(accuracy: float) -> float:
    """b with e^{−b²}(1 + b² + b⁴/2) = accuracy."""
    from scipy.optimize import brentq

    if not 0.0 < accuracy < 0.1:
        raise AtcError(f"long-range dispersion: the accuracy must be between 0 and 0.1, got {accuracy:g}")
    return brentq(lambda b: exp(-b * b) * (1.0 + b * b + 0.5 * b**4) - accuracy, 1.0, 8.0)


def as_products(C6):
    """[(λ, w)] with C6 = Σ λ w wᵀ, w by type."""
    value, vector = np.linalg.eigh(C6[1:, 1:])
    size = np.abs(value).max(initial=0.0)
    return [(float(v), np.r_[0.0, vector[:, k]]) for k, v in enumerate(value) if abs(v) > _ROUNDING * size]


class LongRangeDispersion(Term):
    """What of −C_ij/r⁶ is no bond of a `LennardJonesLong`; shared half to each atom of a pair.

    Parameters
    ----------
    split : DispersionSplit
    C6 : (n_types + 1, n_types + 1), internal units
    run : what the script asked for, see `RunAccuracy`, or None
    kinds : as of `Pairs`
    grow : function n_types → C6 for a frame with more types (``pair_coeff * *``), or None if there is no more to know
    """

    pairwise = True
    field = True
    needs_charges = False
    slab = None
    #: what its attributes are called
    prefix = "dispersion"
    #: what of the tolerance its modes may take, over Coulomb's: bonds of repulsion leave a tenth of it
    share = 0.1

    def __init__(self, split: DispersionSplit, C6, run=None, kinds: str = "", grow=None):
        self.split, self.C6, self.run, self.kinds, self.grow = split, np.asarray(C6, float), run, kinds, grow
        self.parts = as_products(self.C6)
        self.threads, self._kept, self._grown = 1, None, {}

    def __getstate__(self):
        return {**self.__dict__, "_kept": None, "_grown": {}}

    def _of(self, frame: Frame) -> LongRangeDispersion:
        """The same for all types of a frame, as far as the lines say them."""
        top = int(kinds_of(frame, self.kinds).max(initial=0))
        if top < len(self.C6) or self.grow is None or top > MAX_TYPES:
            return self
        if top not in self._grown:
            new = LongRangeDispersion(self.split, self.grow(top), self.run, self.kinds)
            new.threads = self.threads
            self._grown[top] = new
        return self._grown[top]

    def use_threads(self, count: int) -> None:
        self.threads = count

    def describe(self) -> str:
        return (
            f"dispersion: straight bonds (alpha = {self.split.alpha:.6g}/angstrom, cutoff {self.split.cutoff:.6g} "
            "angstrom) and the field of the smooth part"
        )

    def at(self, accuracy: float, alpha: float | None = None) -> LongRangeDispersion:
        """The same with another accuracy."""
        new = copy(self)
        new.split, new._kept, new._grown = self.split.at(accuracy), None, {}
        return new

    def check(self, frame: Frame) -> None:
        """Raise AtcError for frames that the sum is not made for."""
        if frame.dimension == 2 or not frame.cell.periodic.all():
            raise AtcError(f"{frame.source}: long-range dispersion needs a cell that is periodic along x, y and z")
        top = int(kinds_of(frame, self.kinds).max(initial=0))
        if top >= len(self._of(frame).C6):
            raise AtcError(
                f"{frame.source}: atoms of type {top} but the pair coefficients cover types 1 to "
                f"{len(self.C6) - 1}: add a pair_coeff line for it"
            )

    def box(self, frame: Frame):
        """(edge vectors, origin) of the periodic box of the modes."""
        return np.array(frame.cell.vectors), frame.cell.origin

    def bare_field(self, frame: Frame) -> float:
        return 0.0

    def modes(self, frame: Frame, threads: int = 1):
        """`SmoothDispersion` of a frame; the last one is remembered."""
        if self._kept is None or self._kept[0] is not frame.positions:
            self._kept = frame.positions, SmoothDispersion(self._of(frame), frame, threads)
        return self._kept[1]

    def nodes(self, tolerance: float, wave: float, hat) -> int:
        """About how many functions D is a sum of products of."""
        return len(_shapes(round((self.split.largest_wave(tolerance) + wave) * sqrt(self.split.s), 2), tolerance))

    def transforms(self, kinds, nodes: int) -> int:
        """How many transforms `DispersionProducts` makes."""
        each = {"stress": (8, 2, 4), "power": (6, 10, 16), "power_lab": (6, 10, 16)}
        return sum(each[k][0] + len(self.parts) * (each[k][1] + each[k][2] * nodes) for k in kinds)

    def products(self, frame, layout, threads: int):
        return DispersionProducts(self._of(frame), frame, layout, threads)

    def prepare(self, frame: Frame) -> Work:
        self.check(frame)
        return SmoothWork(self, frame)


class _Part(Smooth):
    """The smooth part of one product λ w wᵀ: w are its charges."""

    def __init__(self, term, frame, weights, threads, transform=None):
        self.part_weights = weights[kinds_of(frame, term.kinds)]
        super().__init__(term, frame, threads, transform=transform)

    def charges(self, frame):
        return self.part_weights

    def potentials(self):
        return self.split.modes(np.sqrt(self.k2))

    @property
    def own_n(self):
        """Σ of these is the energy of every atom with itself, which is taken off."""
        return -(self.split.alpha**6 / 12.0) * self.q_n**2


class SmoothDispersion:
    """The smooth part of one frame: the sum over the products that C_ij is made of."""

    def __init__(self, term: LongRangeDispersion, frame: Frame, threads: int = 1):
        self.parts, transform = [], None
        for value, weights in term.parts:
            part = _Part(term, frame, weights, threads, transform)
            transform = part.transform
            self.parts.append((value, part))
        self.n = len(frame)

    def _sum(self, of, nothing):
        return sum((value * of(part) for value, part in self.parts), nothing)

    @property
    def energy(self) -> float:
        return self._sum(lambda p: p.energy, 0.0)

    @property
    def virial_cc(self) -> np.ndarray:
        return self._sum(lambda p: p.virial_cc, np.zeros((3, 3)))

    def energies_n(self) -> np.ndarray:
        return self._sum(lambda p: p.energies_n(), np.zeros(self.n))

    def forces_nc(self) -> np.ndarray:
        return self._sum(lambda p: p.forces_nc(), np.zeros((self.n, 3)))

    def virials_n6(self) -> np.ndarray:
        return self._sum(lambda p: p.virials_n6(), np.zeros((self.n, 6)))

    def share_rates_n(self, v_nc) -> np.ndarray:
        return self._sum(lambda p: p.share_rates_n(v_nc), np.zeros(self.n))


# --- stress and energy current


class DispersionProducts(Products):
    """The fields of one frame on a mesh, and the modes of their products."""

    def __init__(self, term, frame, layout, threads: int):
        super().__init__(
            term, frame, layout.largest, layout.tolerance, 1, threads, layout.wide, layout.single, charges=False
        )
        k = np.sqrt(self.k2.astype(float))
        self.V = term.split.modes(k)[0].astype(self.real)
        shapes = divided_difference(term.split, float(k.max()), layout.tolerance)
        self.tables = [(value, f(k).astype(self.real)) for value, f in shapes]

    def _charges(self, w) -> np.ndarray:
        """(n, 1) of one of the products."""
        return w[kinds_of(self.frame, self.term.kinds)][:, None]

    def stress(self) -> np.ndarray:
        """(6, q0, q1, q2) xx, yy, zz, yz, xz, xy; tension positive, energy."""
        from .stress import PAIRS

        total = [np.zeros(self.counts, self.real) for _ in PAIRS]
        plain, squares = np.zeros(self.counts, self.real), np.zeros(self.counts, self.real)
        for weight, w in self.term.parts:
            rho = self.transform.modes(self.frame.positions, self._charges(w))[0].astype(self.complex)
            plain += weight * (self._real(rho) * self._real(self.V * rho))
            for value, f in self.tables:
                psi = f * rho
                squares += (weight * value) * self._real(psi) ** 2
                g = self._gradient(psi)
                for out, (a, b) in zip(total, PAIRS):
                    out += (weight * value) * (g[a] * g[b])
        modes = -np.stack([self._modes(out) for out in total])
        Q2 = sum(q * q for q in wave_vectors(self.q_index, self.vectors))
        modes[:3] -= 0.5 * (self._modes(plain) + 0.5 * Q2 * self._modes(squares))
        return modes

    def current(self, v_nc) -> np.ndarray:
        """(3, q0, q1, q2) A for atoms that move with v (n, 3)."""
        plain = [np.zeros(self.counts, self.real) for _ in range(3)]
        squares = [np.zeros(self.counts, self.real) for _ in range(3)]
        for weight, w in self.term.parts:
            q, x = self._charges(w), self.frame.positions
            rho = self.transform.modes(x, q)[0].astype(self.complex)
            J = self.transform.modes(x, q * v_nc).astype(self.complex)
            near, wide = self._real(rho), self._real(self.V * rho)
            for out, j in zip(plain, J):
                out += (0.5 * weight) * (self._real(self.V * j) * near + self._real(j) * wide)
            for value, f in self.tables:
                psi, g = self._real(f * rho), self._gradient(f * rho)
                div = self._real(f * sum(1j * k * j for k, j in zip(self.k_c, J)))
                for a in range(3):
                    part = div * g[a]
                    for b in range(3):
                        part += self._real(1j * self.k_c[a] * (f * J[b])) * g[b]
                    plain[a] += (weight * value) * part
                    squares[a] += (weight * value) * (self._real(f * J[a]) * psi)
        Q2 = sum(q * q for q in wave_vectors(self.q_index, self.vectors))
        return np.stack([0.5 * (self._modes(a) + 0.5 * Q2 * self._modes(b)) for a, b in zip(plain, squares)])


def divided_difference(split: DispersionSplit, k_max: float, tolerance: float):
    """[(λ, f)] with Σ λ f(a) f(b) = (V(b²) − V(a²))/(b² − a²) for wave numbers up to k_max, f functions of a wave
    number; times a and b (or α where they are smaller) it is right to the tolerance of V(0)."""
    scale = 2.0 * split.alpha
    return [(value, _Scaled(f, scale)) for value, f in _shapes(round(k_max / scale, 2) + 0.01, tolerance)]


@dataclass
class _Scaled:
    """A function of x = k/2α as one of k: V is that of α = ½ times (2α)³, D times 2α."""

    f: object
    scale: float

    def __call__(self, k):
        return sqrt(self.scale) * self.f(k / self.scale)


@lru_cache(maxsize=8)
def _shapes(X: float, tolerance: float):
    from scipy.interpolate import CubicSpline

    unit = DispersionSplit(0.5, 1.0)
    t, w = np.polynomial.legendre.leggauss(_NODES)
    x, w = 0.5 * X * (1.0 + t), 0.5 * X * w
    root, size = np.sqrt(w), np.sqrt(x * x + 0.25)
    A = size[:, None] * _difference(unit, x[:, None], x[None]) * size
    value, vector = np.linalg.eigh(root[:, None] * A * root)
    order = np.argsort(-np.abs(value))
    fine = np.linspace(0.0, X, _TABLE)
    D = _difference(unit, fine[:, None], x[None])
    out, left = [], A.copy()
    for r in order:
        if np.abs(left).max() <= tolerance * abs(unit.modes(np.zeros(1))[0][0]):
            break
        h = vector[:, r] / root
        left -= value[r] * np.outer(h, h)
        f = D @ (w * size * h) / value[r]
        out.append((float(value[r]), CubicSpline(fine, f)))
    return out


def _difference(split, a, b):
    """(V(b²) − V(a²))/(b² − a²) of wave numbers."""
    u, v = a * a + 0.0 * b, b * b + 0.0 * a
    apart = v - u
    far = np.abs(apart) > 1e-3 * (u + v)
    t, w = np.polynomial.legendre.leggauss(6)
    near = sum(0.5 * wi * split.modes(np.sqrt(u + 0.5 * (1.0 + ti) * apart))[1] for ti, wi in zip(t, w))
    plain = (split.modes(np.sqrt(v))[0] - split.modes(np.sqrt(u))[0]) / np.where(far, apart, 1.0)
    return np.where(far, plain, near)
