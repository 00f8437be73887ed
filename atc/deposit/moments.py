"""All bonds of an atom at once: for kernels wide against the bonds, their bond functions are expanded about both ends,
and atoms carry the sums.

The Fourier transform of a bond from x_i to x_j = x_i − r is φ̂(k) ∫₀¹ exp(−ik·(x_i − t r)) dt. Hermite's two-point rule
replaces the integral by values and derivatives at both ends, up to order P (derivative corrections of the trapezoidal
rule: Lanczos, Applied Analysis, 1956, ch. VI):

    ∫₀¹ g dt ≈ Σ_{p ≤ P} c_p [g⁽ᵖ⁾(0) + (−1)ᵖ g⁽ᵖ⁾(1)],     c_p = (P+1)!/((P−p)! (p+1)!) (2P+1−p)!/(2P+2)!,

exact for polynomials of degree 2P + 1. For a bond with the stress factor G r⊗r the p-th derivative is G r⊗r (ik·r)ᵖ
exp(…): what an atom has to carry is the totally symmetric Σ G r^{⊗n}, n = 2..P+2, over its bonds, r pointing to it from
each bond's other end. 16, 31, 52 or 80 numbers for P = 1..4 are spread once for each atom, where otherwise every bond
is several points; the powers of k wait until everything is transformed.
"""

from __future__ import annotations

from functools import cache, lru_cache
from math import factorial, frexp

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from ..compiled import njit
from ..simd import ENTRY, specialise
from . import fourier, spread
from .spread import begin

ORDERS = range(1, 6)
# Set by `core`: bytes of a row, doubles of it before the atom's position, and what is done for a bond.
BYTES, PLACE, ADD = 512, 30, None

_INT64, _INT32 = ir.IntType(64), ir.IntType(32)
# xx, yy, zz, yz, xz, xy: powers of x, y, z.
STRESS = np.array([[2, 0, 0], [0, 2, 0], [0, 0, 2], [0, 1, 1], [1, 0, 1], [1, 1, 0]])


def coefficients(order: int) -> np.ndarray:
    """(P + 1,) c_p."""
    P, f = order, factorial
    return np.array([f(P + 1) * f(2 * P + 1 - p) / (f(P - p) * f(p + 1) * f(2 * P + 2)) for p in range(P + 1)])


def powers(n: int) -> list[tuple[int, int, int]]:
    """Monomials of degree n: x times all of degree n − 1, then y times those without x, then zⁿ."""
    return [(a, b, n - a - b) for a in range(n, -1, -1) for b in range(n - a, -1, -1)]


def count(order: int, dimension: int = 3) -> int:
    """Numbers that an atom carries; in the plane those without z."""
    return sum(len(powers(n)) if dimension == 3 else n + 1 for n in range(2, order + 3))


def _padded(n):
    return 4 * ((n + 3) // 4)


class Layout:
    """Where what is in a row: degree by degree, each filled up to a multiple of four numbers; then the atom's position,
    in double precision.

    columns : (k,) of the monomials (in the plane of those without z, the others are 0); powers : (k, 3) theirs; place :
        of the position, in doubles; row : length, in numbers
    """

    def __init__(self, order, real, dimension=3):
        self.order, self.real = order, real
        columns, exponents, end = [], [], 0
        for n in range(2, order + 3):
            monomials = powers(n)
            columns += range(end, end + len(monomials))
            exponents += monomials
            end += _padded(len(monomials))
        size = np.dtype(real).itemsize
        self.columns, self.powers = np.array(columns), np.array(exponents)
        if dimension == 2:
            flat = self.powers[:, 2] == 0
            self.columns, self.powers = self.columns[flat], self.powers[flat]
        self.place = end * size // 8
        # Whole quarters of a cache line.
        self.row = 16 * ((end * size + 24 + 15) // 16) // size

    def parts(self, columns, component: int):
        """What some monomials are of a component of the stress: which of them are, powers α of k, and the factors p!/α!
        c_p of (ik)^α, p = |α|."""
        alphas = self.powers[columns] - STRESS[component]
        which = np.flatnonzero((alphas >= 0).all(1))
        factors = []
        for a in alphas[which]:
            p = int(a.sum())
            factors.append(factorial(p) / np.prod([factorial(x) for x in a]) * coefficients(self.order)[p])
        return which, np.ascontiguousarray(alphas[which]), np.array(factors)


# --- errors
class Errors:
    """What it costs to collapse bonds of any length, as `fourier` counts errors.

    Where |k·r| is large the two ends are large numbers of opposite sign: exactly they cancel, but what the mesh
    confuses at either end does not. That is part of the error.

    Parameters
    ----------
    kernel, order, gradient : see `fourier.spectrum`
    parameters, confused : of the mesh, and the error that modes taken for each other may make for a source of size one
    """

    def __init__(self, kernel, order, gradient, parameters, confused):
        self._spec = spec = fourier.spectrum(kernel, gradient)
        first, power, hat = fourier.by_decades(kernel, gradient)
        q, windows = fourier.products(first, len(power))
        # From the middle of the bond its ends are at e^{∓iq/2}: 2 Re Σ c_p (iq)^p e^{−iq/2} against sin(q/2)/(q/2).
        even, odd = np.zeros_like(q), np.zeros_like(q)
        for p, c in enumerate(coefficients(order)):
            (odd if p % 2 else even)[:] += 2.0 * c * (-1.0) ** (p // 2) * q**p
        wrong = windows(np.abs(np.cos(0.5 * q) * even + np.sin(0.5 * q) * odd - np.sinc(q / (2 * np.pi))))
        errors = np.maximum(wrong**2 @ power, (wrong * hat).max(-1) ** 2)
        # The ends' mean square against that of a point, where the mesh's errors are.
        k = np.minimum(10.0 ** (np.arange(first, first + len(power)) / fourier._DECADE), parameters.k_max * spec.scale)
        images, own = fourier.images(
            k * parameters.spacing / (2 * np.pi * spec.scale), parameters.width, parameters.shape
        )
        kept = k < parameters.k_max * spec.scale
        where = np.where(kept, images / own**2 * power, 0.0)
        size = 0.5 * (windows(even**2 + odd**2) @ where) / where.sum()
        errors += confused**2 * np.maximum(size - 1.0, 0.0)
        self._errors = np.maximum.accumulate(np.sqrt(errors))

    def longest(self, tolerances):
        """The longest bond that may be collapsed, for each tolerance."""
        at = np.searchsorted(self._errors, tolerances, side="right")
        return np.where(at > 0, fourier._LENGTHS[np.maximum(at - 1, 0)], 0.0) * self._spec.scale

    def of(self, length):
        """The error of bonds of these lengths and of all shorter ones; up to the next length of the table."""
        return self._errors[
            np.minimum(np.searchsorted(fourier._LENGTHS, np.asarray(length) / self._spec.scale), len(self._errors) - 1)
        ]


errors = lru_cache(maxsize=64)(Errors)


# --- summing
def _adder(order, real):
    """An intrinsic: (address of the row of i, of j, x, y, z, G): adds a bond's monomials to both rows, those of odd
    degree with the other sign to the second."""
    number = ir.FloatType() if real == np.float32 else ir.DoubleType()
    size = np.dtype(real).itemsize

    def codegen(context, builder, sig, args):
        at_i, at_j, *xyz, G = args
        contract = ("contract",)

        def cast(x):
            return builder.fptrunc(x, number) if size == 4 else x

        def shuffled(v, index):
            return builder.shuffle_vector(
                v, ir.Constant(v.type, ir.Undefined), ir.Constant(ir.VectorType(_INT32, len(index)), index)
            )

        four = ir.Constant(ir.VectorType(number, 4), [0.0] * 4)
        r = four
        for k in range(3):
            r = builder.insert_element(r, cast(xyz[k]), ir.Constant(_INT32, k))
        factor = builder.insert_element(four, cast(G), ir.Constant(_INT32, 0))
        # Of degree one: x, y, z, 0.
        v, many = builder.fmul(r, shuffled(factor, [0] * 4), flags=contract), 3
        end = 0
        for n in range(2, order + 3):
            fill = _padded(many + n + 1) - (many + n + 1)
            v = builder.fmul(
                shuffled(v, [*range(many), *range(many - n, many), many - 1] + [0] * fill),
                shuffled(r, [0] * many + [1] * n + [2] + [3] * fill),
                flags=contract,
            )
            many += n + 1
            for base, sign in ((at_i, builder.fadd), (at_j, builder.fsub if n % 2 else builder.fadd)):
                at = builder.gep(builder.inttoptr(base, number.as_pointer()), [ir.Constant(_INT64, end)])
                at = builder.bitcast(at, v.type.as_pointer())
                builder.store(sign(builder.load(at, align=size), v, flags=contract), at, align=size)
            end += _padded(many)
        return context.get_dummy_value()

    @intrinsic
    def add(typingctx, at_i, at_j, x, y, z, G):
        i, f = types.int64, types.float64
        return types.void(i, i, f, f, f, f), codegen

    return add


@cache
def core(order, real):
    """`add_bonds` for an order and a precision."""
    layout = Layout(order, real)
    tag = f"{order}_{np.dtype(real).name}"
    return specialise(
        add_bonds, tag, BYTES=layout.row * np.dtype(real).itemsize, PLACE=layout.place, ADD=_adder(order, real)
    )


def add_bonds(
    x_nc, i_b, j_b, r_bc, G_b, first, weight_k, slack, longest, inverse_length, inverse_scale, rows, places, rest
):
    """Add bonds `first`.. to the rows of their two atoms. Returns the bond before which an atom has moved (else their
    number; −1: it is nowhere), and how many are in `rest`.

    Parameters
    ----------
    weight_k : (6,) one over the mean |b| of a component
    slack, longest : by how many powers of two the error of a bond may be larger; and the longest bond (2 LEVELS + 1,)
        that may be collapsed when its
        error may be 2^(level − LEVELS) times the tolerance. Bonds more than 2^STRONG times as strong as the mean never
        are: they become the points by which they can be taken out again (`SpectralDeposit.add_strong`); what the mesh
        makes of two ends is not what it makes of points
    inverse_length, inverse_scale : r and G r⊗r are multiplied with these
    rows, places : (n, row), and the same memory as doubles
    rest : (b,) bonds that are not collapsed
    """
    at = begin(rows)
    w0, w1, w2, w3, w4, w5 = weight_k[0], weight_k[1], weight_k[2], weight_k[3], weight_k[4], weight_k[5]
    scale = inverse_scale / inverse_length
    many = 0
    for b in range(first, len(i_b)):
        x, y, z = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        xx, yy, zz = x * x, y * y, z * z
        p, q = max(xx * w0, yy * w1), max(zz * w2, abs(y * z) * w3)
        strength = abs(G_b[b]) * max(max(p, q), max(abs(x * z) * w4, abs(x * y) * w5))
        if strength == 0.0:
            continue
        power = frexp(strength)[1]
        level = min(max(spread.LEVELS - power + slack, 0), 2 * spread.LEVELS)
        if power > spread.STRONG or xx + yy + zz > longest[level] ** 2:
            rest[many] = b
            many += 1
            continue
        for a in (i_b[b], j_b[b]):
            known = places[a, PLACE]
            if known != x_nc[a, 0] or places[a, PLACE + 1] != x_nc[a, 1] or places[a, PLACE + 2] != x_nc[a, 2]:
                if known == known:
                    return b, many
                if not abs(x_nc[a, 0]) + abs(x_nc[a, 1]) + abs(x_nc[a, 2]) < np.inf:
                    return -1, many
                places[a, PLACE], places[a, PLACE + 1], places[a, PLACE + 2] = x_nc[a, 0], x_nc[a, 1], x_nc[a, 2]
        ADD(
            at + BYTES * i_b[b], at + BYTES * j_b[b], x * inverse_length, y * inverse_length, z * inverse_length,
            G_b[b] * scale / inverse_length,
        )  # fmt: skip
    return len(i_b), many


@njit(**ENTRY)
def survey(i_b, j_b, r_bc, G_b):
    """Mean size of each component of G r⊗r (6,), the largest, whether all is finite, and least and greatest index."""
    mean = np.zeros(6)
    most, check = 0.0, 0.0
    low, high = 0, -1
    if len(i_b):
        low, high = min(i_b[0], j_b[0]), max(i_b[0], j_b[0])
    for b in range(len(i_b)):
        x, y, z, G = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2], abs(G_b[b])
        check += 0.0 * (x + y + z + G)
        xx, yy, zz, yz, xz, xy = G * x * x, G * y * y, G * z * z, G * abs(y * z), G * abs(x * z), G * abs(x * y)
        mean[0] += xx
        mean[1] += yy
        mean[2] += zz
        mean[3] += yz
        mean[4] += xz
        mean[5] += xy
        trace = xx + yy + zz
        most = trace if trace > most else most
        low, high = min(low, i_b[b], j_b[b]), max(high, i_b[b], j_b[b])
    return mean / max(1, len(i_b)), most, check + 0.0 * most == 0.0, low, high


class Rows:
    """What the atoms carry, in one thread.

    scale : the rows hold moments times one over this
    """

    def __init__(self, layout: Layout, n: int):
        self.layout = layout
        self.rows = spread.aligned(n * layout.row, layout.real).reshape(n, layout.row)
        self.places = self.rows.view(np.float64)
        self.places[:, layout.place] = np.nan
        self.scale = 0.0

    def touched(self) -> np.ndarray:
        """Indices of the atoms that carry anything."""
        return np.flatnonzero(~np.isnan(self.places[:, self.layout.place]))

    def positions(self, which):
        return np.ascontiguousarray(self.places[which, self.layout.place : self.layout.place + 3])

    def join(self, other) -> bool:
        """Add another thread's; False, and nothing done, if atoms have different positions there."""
        a, b = (r.places[:, r.layout.place : r.layout.place + 3] for r in (self, other))
        both = ~np.isnan(a[:, 0]) & ~np.isnan(b[:, 0])
        if len(a) != len(b) or (a[both] != b[both]).any():
            return False
        _join(self.rows, self.scale, other.rows, other.scale, self.places, other.places, self.layout.place)
        return True


@njit(**ENTRY)
def _join(rows, scale, others, other_scale, places, other_places, place):
    factor = other_scale / scale if scale > 0.0 else 1.0
    k = place * 8 // rows.itemsize
    for a in range(len(rows)):
        if other_places[a, place] == other_places[a, place]:
            for c in range(k):
                rows[a, c] += factor * others[a, c]
            for c in range(3):
                places[a, place + c] = other_places[a, place + c]


# --- in the end
@njit(**ENTRY)
def contract(S, which, alphas, factors, n0, n1, n2, b, F):
    """F += Σ factor (ik)^α S over some monomials; S, F: real and imaginary parts side by side along the last axis.

    b : columns are the reciprocal vectors, in units of one over the length of the rows
    """
    many, most = len(n2), alphas.max()
    power = np.ones((3, most + 1, many), S.dtype)
    for i in range(len(n0)):
        for j in range(len(n1)):
            for c in range(3):
                first = n0[i] * b[c, 0] + n1[j] * b[c, 1]
                for k in range(many):
                    u = first + n2[k] * b[c, 2]
                    for p in range(most):
                        power[c, p + 1, k] = power[c, p, k] * u
            for t in range(len(which)):
                X, Y, Z = power[0, alphas[t, 0]], power[1, alphas[t, 1]], power[2, alphas[t, 2]]
                source, to = S[which[t], i, j], F[i, j]
                turn = (alphas[t, 0] + alphas[t, 1] + alphas[t, 2]) % 4
                factor = factors[t] if turn < 2 else -factors[t]
                if turn % 2:
                    for k in range(many):
                        w = factor * X[k] * Y[k] * Z[k]
                        to[2 * k] -= w * source[2 * k + 1]
                        to[2 * k + 1] += w * source[2 * k]
                else:
                    for k in range(many):
                        w = factor * X[k] * Y[k] * Z[k]
                        to[2 * k] += w * source[2 * k]
                        to[2 * k + 1] += w * source[2 * k + 1]
