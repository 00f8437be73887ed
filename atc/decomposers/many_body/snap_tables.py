"""The bispectrum of a density on the 3-sphere as lists of products: what `snap_kernels` loops over.

Representations of SU(2) are counted by n = 2j. U^n_kl, 0 ≤ k, l ≤ n (k = j + m), is what (a b; −b* a*) does to the
basis √(n over k) xᵏ yⁿ⁻ᵏ of polynomials; it stands at ``offset(n) + k (n + 1) + l``. Since U_(n−k)(n−l) is
(−1)ᵏ⁺ˡ U_kl*, only the rows 2k ≤ n are computed and differentiated; of those with 2k < n everything counts twice.
"""

from __future__ import annotations

from functools import cache
from math import factorial, sqrt
from typing import NamedTuple

import numpy as np


def offset(n: int) -> int:
    """Σ_{m < n} (m + 1)²; of n = J + 1 the length of U."""
    return n * (n + 1) * (2 * n + 1) // 6


def triples(top: int) -> list[tuple[int, int, int]]:
    """(2j1, 2j2, 2j) of the components of the bispectrum up to 2J = `top`, in the order of their coefficients."""
    return [
        (n1, n2, n)
        for n1 in range(top + 1)
        for n2 in range(n1 + 1)
        for n in range(n1 - n2, min(top, n1 + n2) + 1, 2)
        if n >= n1
    ]


@cache
def clebsch_gordan(n1: int, n2: int, n: int) -> np.ndarray:
    """(n1 + 1, n + 1) [k1, k] of ⟨j1 m1 j2 m2|j m⟩ with m2 = m − m1; 0 where there is no such m2 (Racah's formula)."""
    f = factorial
    s = (n1 + n2 - n) // 2  # j1 + j2 − j; k1 + k2 = k + s
    front = (n + 1) * f((n + n1 - n2) // 2) * f((n - n1 + n2) // 2) * f(s) / f((n1 + n2 + n) // 2 + 1)
    out = np.zeros((n1 + 1, n + 1))
    for k1 in range(n1 + 1):
        for k in range(n + 1):
            k2 = k + s - k1
            if not 0 <= k2 <= n2:
                continue
            total = 0.0
            for t in range(min(s, n1 - k1, k2) + 1):
                p = (n - n2 + 2 * k1 - n1) // 2 + t  # j − j2 + m1 + t
                q = (n - n1 - 2 * k2 + n2) // 2 + t  # j − j1 − m2 + t
                if p < 0 or q < 0:
                    continue
                total += (-1) ** t / (f(t) * f(s - t) * f(n1 - k1 - t) * f(k2 - t) * f(p) * f(q))
            out[k1, k] = total * sqrt(front * f(k) * f(n - k) * f(k1) * f(n1 - k1) * f(k2) * f(n2 - k2))
    return out


class Products(NamedTuple):
    """Z = Σ C u_a u_b of the components' derivatives: ∂B/∂u*. Every segment is one element of one Z.

    Attributes
    ----------
    component : (s,) of the bispectrum. role : (s,) which of the three u is being differentiated by: 0, 1, 2 for that of
        j, j1, j2; `FACTORS` says which channels the other two are of
    out : (s,) where in U. weight : (s,) what Y gets Z times. own : (s,) what B gets Re u*_out Z times
    first : (s + 1,) the products of each. a, b : (p,) where in U. C : (p,)
    """

    component: np.ndarray
    role: np.ndarray
    out: np.ndarray
    weight: np.ndarray
    own: np.ndarray
    first: np.ndarray
    a: np.ndarray
    b: np.ndarray
    C: np.ndarray


#: Of what the u are that a role leaves, and of what it is itself: (a, b, out), 0, 1, 2 for j1, j2, j.
FACTORS = np.array([[0, 1, 2], [2, 1, 0], [2, 0, 1]])


@cache
def products(top: int, channels: bool, normalised: bool) -> Products:
    """The products up to 2J = `top`.

    channels : whether the three u of a component may be different densities. If not, what is equal is put together.
    normalised : B divided by 2j + 1

    B_j1j2j/(2j + 1) does not change when the three are exchanged, so each of its three derivatives is a Z of its own,
    times (2j + 1) over that of the one differentiated by (Thompson et al., eq. 17).
    """
    segments, a, b, C = [], [], [], []
    length = 0
    for component, (n1, n2, n) in enumerate(triples(top)):
        ways: dict[tuple, list] = {}
        for role, (of_a, of_b, of_out) in enumerate(FACTORS):
            na, nb, no = ((n1, n2, n)[k] for k in (of_a, of_b, of_out))
            if channels:
                ways[role, na, nb, no] = [1]
            else:
                # Which of two factors comes first is no matter, and equal ones are one.
                known = next((w for w in ways if w[1:] in ((na, nb, no), (nb, na, no))), (role, na, nb, no))
                ways.setdefault(known, []).append(1)
        # B itself is made with the shortest of its derivatives.
        shortest = min(ways, key=lambda way: way[3])
        for way, times in ways.items():
            role, na, nb, no = way
            ratio = (n + 1) / (no + 1) / (n + 1 if normalised else 1)
            G = clebsch_gordan(na, nb, no)
            s = (na + nb - no) // 2
            for k in range(no // 2 + 1):
                twice = 1.0 if 2 * k == no else 2.0
                rows = np.flatnonzero(G[:, k])
                for l in range(no + 1):
                    columns = np.flatnonzero(G[:, l])
                    at_a = offset(na) + (rows[:, None] * (na + 1) + columns).ravel()
                    at_b = offset(nb) + ((k + s - rows)[:, None] * (nb + 1) + l + s - columns).ravel()
                    c = np.outer(G[rows, k], G[columns, l]).ravel()
                    if na == nb and not channels:
                        c = np.where(at_a == at_b, c, 2 * c)[at_a <= at_b]
                        at_a, at_b = at_a[at_a <= at_b], at_b[at_a <= at_b]
                    own = ratio * twice if way == shortest else 0.0
                    segments.append((component, role, offset(no) + k * (no + 1) + l, len(times) * ratio * twice, own))
                    segments[-1] += (length,)
                    length += len(c)
                    a.append(at_a)
                    b.append(at_b)
                    C.append(c)
    component, role, out, weight, own, first = zip(*segments)
    return Products(
        *(np.array(x, np.int64) for x in (component, role, out)),
        np.array(weight),
        np.array(own),
        np.array([*first, length]),
        *(np.concatenate(x).astype(np.int64) for x in (a, b)),
        np.concatenate(C),
    )


class Rows(NamedTuple):
    """How the rows 2k ≤ n of U follow from those of n − 1, in this order.

    U_kl = √((n − l)/(n − k)) a* U'_kl − √(l/(n − k)) b* U'_k(l−1), U' that of n − 1; of the middle row, 2k = n,
    √(l/k) a U'_(k−1)(l−1) + √((n − l)/k) b U'_(k−1)l.

    Attributes
    ----------
    out, from_ : (rows,) where a row begins, and the one of n − 1 that it is made of. n : (rows,). middle : (rows,)
    p, q : (length of U,) the coefficients of U'_l and U'_(l−1)
    """

    out: np.ndarray
    from_: np.ndarray
    n: np.ndarray
    middle: np.ndarray
    p: np.ndarray
    q: np.ndarray


@cache
def rows(top: int) -> Rows:
    out, from_, of, middle = [], [], [], []
    p, q = np.zeros((2, offset(top + 1)))
    for n in range(1, top + 1):
        for k in range(n // 2 + 1):
            last = 2 * k == n
            at = offset(n) + k * (n + 1)
            l = np.arange(n + 1)
            below = k if last else n - k
            p[at : at + n + 1], q[at : at + n + 1] = np.sqrt((n - l) / below), np.sqrt(l / below)
            out.append(at)
            from_.append(offset(n - 1) + (k - last) * n)
            of.append(n)
            middle.append(last)
    return Rows(*(np.array(x, np.int64) for x in (out, from_, of)), np.array(middle), p, q)


@cache
def mirrored(top: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(to, from, sign) of the rows 2k > n: U_to = sign U_from*."""
    to, from_, sign = [], [], []
    for n in range(top + 1):
        for k in range(n // 2 + 1, n + 1):
            for l in range(n + 1):
                to.append(offset(n) + k * (n + 1) + l)
                from_.append(offset(n) + (n - k) * (n + 1) + n - l)
                sign.append((-1.0) ** (k + l))
    return np.array(to, np.int64), np.array(from_, np.int64), np.array(sign)
