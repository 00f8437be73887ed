"""Higher-order gradient (HOG) series of molecular dynamics and peridynamics, to any order, in exact rationals.

Linear chains: ρ y_tt = Σ_m c_m ∂^{2m} y. `spring_series` has c_m of the paper's springs for a given N, as polynomials
in N, to leading order in N, and for continuous peridynamics; `inner_series` those of the inner expansion (Arndt &
Griebel 2005). `dispersion_series` turns them into ω(k); `well_posedness` says what a truncation is good for. Nonlinear
pair potentials: `atc.upscaling.gradients_nonlinear`.

Coefficients are in units of K₁ and of a length L to the power 2m − 2: L = a for chains, L = Na or δ where the name says
so. Only the standard library's fractions are used; `as_sympy` is for those who have sympy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise
from math import comb, factorial

import numpy as np

from ..errors import AtcError
from .chain import whole


class Polynomial(tuple):
    """A polynomial with rational coefficients, lowest power first: Polynomial((0, 1)) is N."""

    __slots__ = ()

    def __new__(cls, coefficients=()):
        c = [Fraction(v) for v in coefficients]
        while c and not c[-1]:
            c.pop()
        return super().__new__(cls, c)

    def __add__(self, other):
        other = _polynomial(other)
        n = max(len(self), len(other))
        return Polynomial((self[i] if i < len(self) else 0) + (other[i] if i < len(other) else 0) for i in range(n))

    def __mul__(self, other):
        other = _polynomial(other)
        out = [Fraction(0)] * max(len(self) + len(other) - 1, 0)
        for i, a in enumerate(self):
            for j, b in enumerate(other):
                out[i + j] += a * b
        return Polynomial(out)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self):
        return self * Fraction(-1)

    def __sub__(self, other):
        return self + _polynomial(other) * Fraction(-1)

    def __rsub__(self, other):
        return -self + other

    def __truediv__(self, number):
        return self * (1 / Fraction(number))

    def __call__(self, value):
        """The value, exact for whole numbers and fractions."""
        total = 0
        for c in reversed(self):
            total = total * value + c
        return total

    @property
    def degree(self) -> int:
        return len(self) - 1

    @property
    def leading(self) -> Fraction:
        return self[-1] if self else Fraction(0)

    def __divmod__(self, divisor) -> tuple[Polynomial, Polynomial]:
        """Quotient and remainder."""
        rest, divisor = list(self), _polynomial(divisor)
        out = [Fraction(0)] * max(len(rest) - len(divisor) + 1, 0)
        for k in range(len(out) - 1, -1, -1):
            out[k] = rest[k + len(divisor) - 1] / divisor.leading
            for i, b in enumerate(divisor):
                rest[k + i] -= out[k] * b
        return Polynomial(out), Polynomial(rest)

    def divided_by(self, divisor) -> Polynomial:
        """The quotient; `ArithmeticError` if there is a remainder."""
        out, rest = divmod(self, divisor)
        if rest:
            raise ArithmeticError("the division leaves a remainder")
        return out

    def text(self, variable: str = "N") -> str:
        terms = []
        for power, c in reversed(list(enumerate(self))):
            if not c:
                continue
            name = "" if power == 0 else variable if power == 1 else f"{variable}^{power}"
            size = str(abs(c)) if (abs(c) != 1 or not name) else ""
            terms.append(("-" if c < 0 else "+", f"{size} {name}".strip()))
        if not terms:
            return "0"
        head = ("-" if terms[0][0] == "-" else "") + terms[0][1]
        return head + "".join(f" {sign} {term}" for sign, term in terms[1:])

    def __str__(self):
        return self.text()

    __repr__ = __str__


def _polynomial(value) -> Polynomial:
    return value if isinstance(value, Polynomial) else Polynomial((value,))


N = Polynomial((0, 1))


@cache
def bernoulli(n: int) -> Fraction:
    """The Bernoulli number B_n, with B_1 = +1/2."""
    if n == 0:
        return Fraction(1)
    total = sum(comb(n + 1, k) * (bernoulli(k) if k != 1 else Fraction(-1, 2)) for k in range(n))
    value = -total / (n + 1)
    return -value if n == 1 else value


@cache
def faulhaber(p: int) -> Polynomial:
    """Σ_{j=1}^{N} j^p as a polynomial in N."""
    coefficients = [Fraction(0)] * (p + 2)
    for k in range(p + 1):
        coefficients[p + 1 - k] = comb(p + 1, k) * bernoulli(k) / (p + 1)
    return Polynomial(coefficients)


# --------------------------------------------------------------------------------------------------------------------
# Linear chains.


def spring_series(order: int, neighbors: int | str = "exact") -> list:
    """c_1 … c_order of ρ y_tt = K₁ Σ_m c_m L^{2m−2} ∂^{2m} y for the paper's springs (eqs. 4.1, 4.2, 4.6).

    c_m = 4 S_{2m−1}(N) / (N(N+1) (2m)!), S_p = Σ_{j≤N} j^p.

    Parameters
    ----------
    order : int
        How many terms; the last one has the derivative 2·order.
    neighbors : int or str
        A number N: Fractions, L = a. ``"exact"``: `Polynomial` in N, L = a. ``"leading"``: the terms that dominate for
        large N, L = Na (eq. 4.2), which are those of continuous peridynamics with L = δ.
    """
    order = whole("order", order)
    if neighbors == "leading":
        return peridynamic_series(order)
    exact = [
        (faulhaber(2 * m - 1) * Fraction(4, factorial(2 * m))).divided_by(N * (N + 1)) for m in range(1, order + 1)
    ]
    if neighbors == "exact":
        return exact
    n = whole("neighbors", neighbors)
    return [c(n) for c in exact]


def peridynamic_series(order: int) -> list[Fraction]:
    """c_m = 2 / (m (2m)!) of continuous peridynamics with micromodulus 2K₁/(δ²|ε|), L = δ (eq. 4.4)."""
    return [Fraction(2, m * factorial(2 * m)) for m in range(1, whole("order", order) + 1)]


def chain_series(weights: Sequence, order: int) -> list:
    """c_m = (2/(2m)!) Σ_q w_q q^{2m} of any chain, L = Δx and in units of w·Δx²; exact if the weights are Fractions."""
    return [
        sum(w * Fraction(2 * q ** (2 * m), factorial(2 * m)) for q, w in enumerate(weights, 1))
        for m in range(1, whole("order", order) + 1)
    ]


def odd_degree(degree: int) -> int:
    """The degree of an inner expansion, or an AtcError."""
    if whole("degree", degree) % 2 == 0:
        raise AtcError(
            f"degree = {degree}: expected an odd number: even derivatives drop out of y(x + r/2) − y(x − r/2)"
        )
    return degree


def inner_series(degree: int, neighbors: int | str = 1, consistent: bool = False) -> list[Fraction]:
    """c_m of the inner expansion: y expanded to the derivative `degree` (odd) about the middle of each bond, in the
    *energy*.

    The energy is then Σ_bonds ½ (K/r)(r y' + r³y'''/24 + …)², a square: ω² ≥ 0 at every wavenumber, and the truncation
    is well posed. It has terms up to ∂^{2·degree}, of which those up to a^{degree−1} agree with `spring_series`.
    `degree` = 3, N = 1: 1, 1/12, 1/576.

    Parameters
    ----------
    degree : int, odd
    neighbors : int, or "leading" (large N, L = Na; else L = a)
    consistent : bool
        Only the terms of the orders in a that are right, up to a^{degree−1} (order-consistent). That is `spring_series`
        again, and no longer a square.
    """
    degree = odd_degree(degree)
    half = [Fraction(2, 2**k * factorial(k)) for k in range(1, degree + 1, 2)]
    terms = (degree + 1) // 2 if consistent else degree
    out = []
    for m in range(1, terms + 1):
        # k + l = 2m, k and l odd and no larger than degree
        square = sum((half[i] * half[m - 1 - i] for i in range(len(half)) if 0 <= m - 1 - i < len(half)), Fraction(0))
        if neighbors == "leading":
            sums = Fraction(2, 2 * m)  # 2/(N(N+1)) Σ j^{2m−1} → 2 N^{2m−2}/(2m)
        else:
            n = whole("neighbors", neighbors)
            sums = faulhaber(2 * m - 1)(n) * Fraction(2, n * (n + 1))
        out.append(sums * square)
    return out


def dispersion_series(series: Sequence) -> list:
    """d_0 … of ω = √(K₁/ρ) k Σ_m d_m (kL)^{2m}, from c_1 … of the gradient series with c_1 = 1 (eqs. 4.8, 4.9): d = 1,
    −1/48, 17/69120, … for peridynamics."""
    if not series or _polynomial(series[0]) != Polynomial((1,)):
        raise AtcError("a dispersion series needs a gradient series that begins with 1 (a modulus of K₁)")
    squared = [c if m % 2 == 0 else -c for m, c in enumerate(series)]
    out = [Fraction(1)]
    for m in range(1, len(squared)):
        # (Σ d)² = squared, term by term
        rest = squared[m]
        for i in range(1, m):
            rest = rest - out[i] * out[m - i]
        out.append(rest / 2)
    return out


@dataclass(frozen=True)
class WellPosedness:
    """What a truncation Σ c_m L^{2m−2} ∂^{2m} is good for.

    Attributes
    ----------
    well_posed : bool
        ω²(k) is bounded from below: growth rates are bounded, solutions depend continuously on the data.
    stable : bool
        ω²(k) ≥ 0 for all k: nothing grows.
    band : (float, float) or None
        Where ω² < 0, as kL (the first such band); the upper end may be inf.
    growth : float
        The largest growth rate √(−ω²) over kL, in units of √(K₁/ρ)/L; inf for an ill-posed truncation.
    """

    terms: int
    well_posed: bool
    stable: bool
    band: tuple[float, float] | None
    growth: float

    def __str__(self):
        if not self.well_posed:
            return f"ill-posed: short waves, kL > {self.band[0]:.4g}, grow without bound (the bad sign)"
        if not self.stable:
            return (
                f"well-posed but unstable: waves {self.band[0]:.4g} < kL < {self.band[1]:.4g} grow, at most as "
                f"exp({self.growth:.3g} c t/L)"
            )
        return "well-posed and stable: ω² ≥ 0 at every wavenumber"


def well_posedness(series: Sequence) -> WellPosedness:
    """Whether ρ y_tt = K₁ Σ_m c_m L^{2m−2} ∂^{2m} y, cut after the terms given, is well posed and stable. Signs are
    decided in exact arithmetic (Sturm)."""
    c = [Fraction(v) for v in series]
    while c and not c[-1]:
        c.pop()
    if not c:
        raise AtcError("well-posedness of a series with no terms")
    # ω²/k² as a polynomial in s = (kL)²
    p = Polynomial(v if m % 2 == 0 else -v for m, v in enumerate(c))
    # Roots of odd multiplicity are changes of sign.
    roots = _sign_changes(p)
    negative_at_first = next(v for v in p if v) < 0
    edges = ([0.0] if negative_at_first else []) + [float(r) for r in roots]
    well_posed = p.leading > 0
    if not edges:
        return WellPosedness(len(c), well_posed, True, None, 0.0)
    band = (edges[0] ** 0.5, edges[1] ** 0.5 if len(edges) > 1 else float("inf"))
    growth = float("inf")
    if well_posed:
        q = np.polynomial.Polynomial([0.0, *map(float, p)])  # ω² over s
        real = [r.real for r in q.deriv().roots() if abs(r.imag) < 1e-9 * max(1.0, abs(r)) and r.real > 0]
        growth = float(np.sqrt(max(0.0, -min((q(float(s)) for s in real), default=0.0))))
    return WellPosedness(len(c), well_posed, False, band, growth)


def _derivative(p):
    return Polynomial(i * v for i, v in enumerate(p) if i)


def _gcd(a, b):
    while b:
        a, b = b, divmod(a, b)[1]
    return a / a.leading


def _odd_part(p):
    """The product of the factors of p of odd multiplicity (its sign changes where p does), by Yun's square-free
    factorisation."""
    odd, multiplicity = Polynomial((1,)), 1
    d = _derivative(p)
    if not d:
        return odd
    g = _gcd(p, d)
    b, c = p.divided_by(g), d.divided_by(g)
    c = c - _derivative(b)
    while b.degree > 0:
        factor = _gcd(b, c) if c else b / b.leading
        if multiplicity % 2:
            odd = odd * factor
        b = b.divided_by(factor)
        c = (c.divided_by(factor) if c else c) - _derivative(b)
        multiplicity += 1
    return odd


def _sign_changes(p):
    """Where p changes sign on s > 0, as Fractions within 1e-15 relative, by Sturm's theorem."""
    p = _odd_part(p)
    while p and not p[0]:  # a root at 0 is no change inside s > 0
        p = Polynomial(p[1:])
    if p.degree < 1:
        return []
    chain = [p, _derivative(p)]
    while chain[-1].degree > 0:
        chain.append(-divmod(chain[-2], chain[-1])[1])

    def variations(s):
        signs = [v > 0 for v in (q(s) for q in chain) if v]
        return sum(a != b for a, b in pairwise(signs))

    top = 1 + max(abs(v / p.leading) for v in p)
    found, stack = [], [(Fraction(0), Fraction(top))]
    while stack:
        lo, hi = stack.pop()
        count = variations(lo) - variations(hi)
        if count == 0:
            continue
        if count == 1 and hi - lo < Fraction(1, 10**15) * hi:
            found.append(hi)
            continue
        mid = (lo + hi) / 2
        stack += [(lo, mid), (mid, hi)]
    return sorted(found)


def as_sympy(series: Sequence, symbol: str = "N") -> list:
    """The coefficients as sympy expressions. `AtcError` if sympy is not installed (pip install "atc[generic]")."""
    try:
        import sympy
    except ImportError:
        raise AtcError('sympy is not installed: pip install "atc[generic]"') from None
    n = sympy.Symbol(symbol, positive=True)

    def convert(c):
        return sum(
            (sympy.Rational(v.numerator, v.denominator) * n**i for i, v in enumerate(_polynomial(c))), sympy.Integer(0)
        )

    return [sympy.factor(convert(c)) for c in series]
