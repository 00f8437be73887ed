"""Higher-order gradient equations of nonlinear pair chains, to any order, in exact rationals.

A chain of bonds with potential V to its j-th neighbour has the force Σ_j [V_j'(y(x+r) − y(x)) − V_j'(y(x) − y(x−r))], r
= ja. Expanded in r it is a sum of terms  c · r^p · V^{(n)}(r y') · y^{(k₁)} y^{(k₂)} …  whose rationals c know nothing
of the potential. For V = A/d^s (Lennard-Jones is two of them) the sums over j become Z_N(s − 2i) = Σ_{j≤N} j^{−(s−2i)}
and the equation is the paper's (5.2).

Terms are dicts {(n, p, derivatives): c}; `derivatives` is a sorted tuple of orders, (2, 2, 3) for (y'')² y'''. In
`power_law` the y' are explicit too.
"""

from __future__ import annotations

from fractions import Fraction
from math import comb, factorial, prod

from .chain import whole
from .gradients import odd_degree


def _partitions(total: int, largest: int | None = None):
    """The multisets of whole numbers ≥ 1 with that sum, largest first."""
    largest = total if largest is None else largest
    if total == 0:
        yield ()
        return
    for part in range(min(total, largest), 0, -1):
        for rest in _partitions(total - part, part):
            yield (part, *rest)


def pair_series(order: int) -> dict:
    """The force on an atom from its two j-th neighbours, expanded directly, through `order` terms (even powers of a up
    to a^{2·order−2}).

    V'(r y' + r²y''/2 + …) − V'(r y' − r²y''/2 + …): a term for each multiset of derivatives k ≥ 2 with Σ(k − 1) odd:
    c = 2 / (Π k! · Π multiplicities!), n = 1 + number of factors, p = Σ k.

    Returns
    -------
    dict {(n, p, derivatives): Fraction}
    """
    out = {}
    # Σ (k − 1), the power of a beyond that of the potential's derivatives.
    for level in range(1, 2 * whole("order", order), 2):
        for parts in _partitions(level):
            orders = tuple(sorted(k + 1 for k in parts))
            out[(1 + len(orders), sum(orders), orders)] = Fraction(2, prod(map(factorial, orders)) * _repeats(orders))
    return out


def _repeats(orders) -> int:
    return prod(factorial(orders.count(k)) for k in set(orders))


def _differentiate(terms: dict) -> dict:
    """d/dx of terms whose potential is taken at D = r y' (so V^{(n)} gives V^{(n+1)} r y'')."""
    out: dict = {}
    for (n, p, orders), c in terms.items():
        key = (n + 1, p + 1, tuple(sorted((*orders, 2))))
        out[key] = out.get(key, 0) + c
        for k in set(orders):
            rest = list(orders)
            rest.remove(k)
            key = (n, p, tuple(sorted((*rest, k + 1))))
            out[key] = out.get(key, 0) + c * orders.count(k)
    return out


def inner_pair_series(degree: int) -> dict:
    """The same from the inner expansion: energy V(D), D = Σ_{k odd ≤ degree} 2 (r/2)^k y^{(k)}/k!, Euler–Lagrange, then
    V expanded about r y'.

    Order-consistent: cut after a^{degree−1}, the last power that `degree` derivatives give right; there it equals
    `pair_series((degree + 1) // 2)` identically, which is how the two ways to the paper's (5.2) are checked against
    each other.
    """
    degree = odd_degree(degree)
    # V'(D) about r y': D = r y' + Σ_{k = 3, 5, …} 2 (r/2)^k y^(k)/k!
    flux: dict = {}
    for level in range(0, degree, 2):
        for parts in _partitions(level // 2):
            orders = tuple(sorted(2 * k + 1 for k in parts))
            c = prod((Fraction(2, 2**k * factorial(k)) for k in orders), start=Fraction(1)) / _repeats(orders)
            flux[(1 + len(orders), sum(orders), orders)] = c
    out: dict = {}
    for k in range(1, degree + 1, 2):
        # Euler–Lagrange: (−1)^{k+1} d^k/dx^k ∂Φ/∂y^(k), and k is odd
        terms = {(n, p + k, orders): c * Fraction(2, 2**k * factorial(k)) for (n, p, orders), c in flux.items()}
        for _ in range(k):
            terms = _differentiate(terms)
        for key, c in terms.items():
            out[key] = out.get(key, 0) + c
    # n − 1 factors y^(k) with potential derivatives of order n; the level Σ(k − 1) = p − (n − 1) counts the power of a
    return {key: c for key, c in out.items() if c and key[1] - (key[0] - 1) <= degree}


def zeta(neighbors: int, s: int) -> Fraction:
    """Z_N(s) = Σ_{j ≤ N} j^{−s}, exact."""
    return sum((Fraction(j) ** -s for j in range(1, whole("neighbors", neighbors) + 1)), Fraction(0))


def power_law(exponent: int, order: int, terms: dict | None = None) -> dict:
    """ρ y_tt of a chain whose bonds have V_j = A/d^s, in units of A s a^{−s}/a² …: {(level, derivatives): coefficient}.

    Each entry stands for  coefficient · a^{level−1} Z_N(s + 1 − level) · Π y^{(k)} / (y')^{s + 1 + number of factors};
    level = 1, 3, 5 …

    Parameters
    ----------
    exponent : s
    order : int
        Number of levels.
    terms : dict, optional
        Of `pair_series` or `inner_pair_series`; the former by default.
    """
    s = whole("exponent", exponent)
    out = {}
    for (n, p, orders), c in (pair_series(order) if terms is None else terms).items():
        # V^(n)(r y') = A (−1)^n s (s+1) … (s+n−1) (r y')^{−s−n}
        rising = prod(range(s, s + n))
        level = p - (n - 1)
        out[(level, orders)] = c * (-1) ** n * rising
    return out


def lennard_jones_equation(order: int = 3) -> dict:
    """The right-hand side of (5.2), ρ y_tt / ε̄, term by term: {(s, level, derivatives): coefficient} with s = 12, 6.

    The entry stands for  coefficient · σ̄^s a^{level−1} · Z_N(s + 1 − level)/Z_N(s) · Π y^{(k)} / (y')^{s + 1 + number
    of factors}. It holds for peridynamics (5.3) just the same, with a → Δx and N → M.
    """
    out = {}
    for s, sign in ((12, 1), (6, -1)):
        for (level, orders), c in power_law(s, order).items():
            out[(s, level, orders)] = 4 * sign * c
    return out


def paper_equation_5_2() -> dict:
    """Eq. (5.2) as the paper prints it, in the form of `lennard_jones_equation(3)`, to compare with."""
    F = Fraction
    out = {}
    for s, factor in ((12, F(8 * 12)), (6, F(-8 * 6))):
        # binomials (13 1) (14 2) (15 3) (16 4) (17 5), and (7 1) (8 2) … for s = 6; alternating signs; 1/(y')^i in
        # front
        b = [comb(s + 1 + i, 1 + i) * (-1) ** i for i in range(5)]
        out |= {
            (s, 1, (2,)): factor * b[0] * F(1, 2),
            (s, 3, (4,)): factor * b[0] * F(1, 24),
            (s, 5, (6,)): factor * b[0] * F(1, 720),
            (s, 3, (2, 3)): factor * b[1] * F(1, 6),
            (s, 5, (2, 5)): factor * b[1] * F(1, 120),
            (s, 5, (3, 4)): factor * b[1] * F(1, 72),
            (s, 3, (2, 2, 2)): factor * b[2] * F(1, 8),
            (s, 5, (2, 2, 4)): factor * b[2] * F(1, 32),
            (s, 5, (2, 3, 3)): factor * b[2] * F(1, 24),
            (s, 5, (2, 2, 2, 3)): factor * b[3] * F(1, 12),
            (s, 5, (2, 2, 2, 2, 2)): factor * b[4] * F(1, 32),
        }
    return out


def evaluate(
    equation: dict,
    derivatives: dict[int, float],
    neighbors: int,
    spacing: float,
    epsilon: float = 1.0,
    sigma: float = 1.0,
) -> float:
    """ρ y_tt of `lennard_jones_equation` for given values of y', y'', … ({1: y', 2: y'', …}): to check it against the
    sum over the chain."""
    total = 0.0
    for (s, level, orders), c in equation.items():
        ratio = float(zeta(neighbors, s + 1 - level) / zeta(neighbors, s))
        product = prod(derivatives[k] for k in orders) / derivatives[1] ** (s + 1 + len(orders))
        total += float(c) * sigma**s * spacing ** (level - 1) * ratio * product
    return epsilon * total
