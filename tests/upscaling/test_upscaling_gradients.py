"""Gradient series in exact rationals: the paper's equations symbolically, Faulhaber's sums, well-posedness, nonlinear
chains against direct sums."""

from fractions import Fraction as F

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from atc.errors import AtcError
from atc.upscaling.chain import LennardJones, Springs
from atc.upscaling.continuum import Peridynamics
from atc.upscaling.gradients import (
    N,
    Polynomial,
    as_sympy,
    chain_series,
    dispersion_series,
    faulhaber,
    inner_series,
    peridynamic_series,
    spring_series,
    well_posedness,
)  # fmt: skip
from atc.upscaling.gradients_nonlinear import (
    evaluate,
    inner_pair_series,
    lennard_jones_equation,
    pair_series,
    paper_equation_5_2,
    power_law,
    zeta,
)

n, a, k, delta, x = sympy.symbols("N a k delta x", positive=True)


@given(p=st.integers(0, 25), top=st.integers(1, 40))
def test_faulhaber(p, top):
    assert faulhaber(p)(top) == sum(j**p for j in range(1, top + 1))
    assert faulhaber(p).leading == F(1, p + 1)


def test_polynomials():
    assert str(N * (N + 1) / 24) == "1/24 N^2 + 1/24 N"
    assert (N * N - 1).divided_by(N - 1) == N + 1
    with pytest.raises(ArithmeticError):
        (N * N + 1).divided_by(N - 1)
    assert str(Polynomial()) == "0" and str(-N + 2) == "-N + 2"


def springs_by_sympy(order):
    """(4.1) expanded by sympy: Σ_j 2K(N)/(m j a) … with sympy's own sums."""
    j = sympy.Symbol("j", integer=True, positive=True)
    out = []
    for m in range(1, order + 1):
        total = sympy.summation(j ** (2 * m - 1), (j, 1, n))
        out.append(sympy.factor(4 * total / (n * (n + 1) * sympy.factorial(2 * m))))
    return out


def test_equations_4_2_and_exact_coefficients():
    ours = as_sympy(spring_series(7))
    for c, exact in zip(ours, springs_by_sympy(7)):
        assert sympy.simplify(c - exact) == 0
    assert sympy.simplify(ours[1] - n * (n + 1) / 24) == 0
    assert sympy.simplify(ours[2] - n * (n + 1) * (2 * n**2 + 2 * n - 1) / 2160) == 0
    # (4.2): the leading order
    leading = [sympy.limit(c / n ** (2 * m), n, sympy.oo) for m, c in enumerate(ours)]
    assert leading[:3] == [1, sympy.Rational(1, 24), sympy.Rational(1, 1080)]
    assert leading == as_sympy(spring_series(7, "leading"))


def test_equation_4_4_and_md_equals_pd():
    """∫ c/|ε| ε^{2m}/(2m)! dε with c = 2K₁/δ² by sympy; equal to the leading order of the chain for δ = Na, at every
    order."""
    e = sympy.Symbol("e", positive=True)
    ours = as_sympy(peridynamic_series(7))
    for m, c in enumerate(ours, 1):
        exact = (
            2
            * sympy.integrate(2 / delta**2 / e * e ** (2 * m) / sympy.factorial(2 * m), (e, 0, delta))
            / delta ** (2 * m - 2)
        )
        assert sympy.simplify(c - exact) == 0
    assert [c.leading for c in spring_series(12)] == peridynamic_series(12)
    assert ours[:3] == [1, sympy.Rational(1, 24), sympy.Rational(1, 1080)]


def test_equation_4_6():
    assert spring_series(3, 1) == [1, F(1, 12), F(1, 360)]
    assert chain_series([F(1)], 4) == spring_series(4, 1)
    assert chain_series([F(2, 12) / q for q in (1, 2, 3)], 5) == spring_series(5, 3)


def test_equations_4_8_and_4_9():
    """Series of √(ω²) by sympy, for peridynamics and exactly in N."""
    z = sympy.Symbol("z", positive=True)
    for terms in (as_sympy(peridynamic_series(5)), springs_by_sympy(4)):
        squared = sum((-1) ** m * c * z ** (2 * m) for m, c in enumerate(terms))
        exact = sympy.series(sympy.sqrt(squared), z, 0, 2 * len(terms)).removeO()
        ours = as_sympy(dispersion_series(peridynamic_series(5) if len(terms) == 5 else spring_series(4)))
        for m, d in enumerate(ours):
            assert sympy.simplify(exact.coeff(z, 2 * m) - d) == 0
    assert dispersion_series(peridynamic_series(3)) == [1, F(-1, 48), F(17, 69120)]
    exact = as_sympy(dispersion_series(spring_series(3)))
    assert sympy.simplify(exact[1] + n * (n + 1) / 48) == 0
    assert sympy.simplify(exact[2] - n * (n + 1) * (17 * n**2 + 17 * n - 16) / 69120) == 0


def test_series_are_the_dispersion():
    """Twelve terms at kL = 1 are ω to rounding: exact in N for the chain, Cin for peridynamics."""
    for M in (1, 3, 20):
        terms = dispersion_series(spring_series(14, M))
        kk = 1.0 / M
        assert float(Springs.paper(1.0, M).frequency(kk)) / kk == pytest.approx(
            sum(float(d) * kk ** (2 * m) for m, d in enumerate(terms)), rel=1e-13
        )
    terms = dispersion_series(peridynamic_series(14))
    assert float(Peridynamics(5.0).frequency(0.2)) / 0.2 == pytest.approx(sum(map(float, terms)), rel=1e-13)


def test_inner_expansion():
    assert inner_series(3) == [1, F(1, 12), F(1, 576)]
    assert inner_series(3, consistent=True) == [1, F(1, 12)]
    for degree in (1, 3, 5, 7, 9):
        half = (degree + 1) // 2
        for M in (1, 4, "leading"):
            inner, exact = inner_series(degree, M), spring_series(half, M)
            assert inner[:half] == exact == inner_series(degree, M, consistent=True)
            assert well_posedness(inner).stable, "a sum of squares"
        # one bond: exactly the square of the truncated 2 sin(kr/2)
        z = sympy.Symbol("z")
        square = sympy.expand(
            sum((-1) ** i * 2 * (z / 2) ** (2 * i + 1) / sympy.factorial(2 * i + 1) for i in range(half)) ** 2
        )
        ours = sum((-1) ** m * c * z ** (2 * m + 2) for m, c in enumerate(as_sympy(inner_series(degree))))
        assert sympy.expand(square - ours) == 0
    with pytest.raises(AtcError, match="odd"):
        inner_series(4)


def test_well_posedness():
    for cut in range(1, 9):
        verdict = well_posedness(peridynamic_series(cut))
        assert verdict.well_posed == verdict.stable == (cut % 2 == 1)
    bad = well_posedness([1, F(1, 24)])
    assert bad.growth == np.inf and bad.band[0] == pytest.approx(24**0.5, rel=1e-12) and "bad sign" in str(bad)
    # ω² = s(1 − 3s + s²): negative between the roots, largest growth at the minimum
    band = well_posedness([1, 3, 1])
    s = np.linspace(0, 3, 200001)
    assert band.well_posed and not band.stable
    np.testing.assert_allclose(np.square(band.band), np.sort(np.roots([1, -3, 1])), rtol=1e-12)
    assert band.growth == pytest.approx(np.sqrt(-(s * (1 - 3 * s + s * s)).min()), rel=1e-6)
    # a double root only touches zero: (1 − s)²
    assert well_posedness([1, 2, 1]).stable
    assert not well_posedness([-1, 1]).stable


@given(st.lists(st.fractions(-3, 3, max_denominator=7), min_size=1, max_size=6))
def test_well_posedness_by_sampling(series):
    """What Sturm's theorem says against a fine scan of ω²/k²."""
    if not any(series):
        return
    verdict = well_posedness(series)
    s = np.concatenate([np.linspace(0, 6, 6001)[1:], np.logspace(np.log10(6), 9, 3000)])
    values = sum(float(c) * (-s) ** m for m, c in enumerate(series))
    size = sum(abs(float(c)) * s**m for m, c in enumerate(series))
    if (values < -1e-9 * size).any():
        assert not verdict.stable
    elif (values > 1e-9 * size).all():
        assert verdict.stable
    last = [(-1) ** m * c for m, c in enumerate(series) if c][-1]
    assert verdict.well_posed == (last > 0)


# --------------------------------------------------------------------------------------------------------------------
# Nonlinear.


def test_equation_5_2():
    """All 22 terms of the paper, in exact arithmetic; direct and inner expansion agree to any order tried."""
    assert lennard_jones_equation(3) == paper_equation_5_2()
    for degree in (1, 3, 5, 7, 9):
        assert pair_series((degree + 1) // 2) == inner_pair_series(degree)


def test_nonlinear_series_by_sympy():
    """Two neighbours, V = A d^{−s}: sympy's expansion of V'(y(x+r) − y(x)) − V'(y(x) − y(x−r))."""
    r, s = sympy.Symbol("r", positive=True), 4
    y = [sympy.Symbol(f"y{i}", positive=True) for i in range(8)]
    right = sum(y[i] * r ** (i - 1) / sympy.factorial(i) for i in range(1, 8))
    left = sum((-1) ** (i - 1) * y[i] * r ** (i - 1) / sympy.factorial(i) for i in range(1, 8))
    force = -s * (right ** (-s - 1) - left ** (-s - 1))  # times r^{−s−1}
    series = sympy.series(force, r, 0, 6).removeO()
    ours = sum(
        sympy.Rational(c.numerator, c.denominator)
        * r**level
        * sympy.prod([y[i] for i in orders])
        / y[1] ** (s + 1 + len(orders))
        for (level, orders), c in power_law(s, 3).items()
    )
    assert sympy.simplify(series - ours) == 0


def test_linear_potential_gives_the_linear_series():
    """V = r²/2 has V'' = 1 and no more: what is left of the nonlinear table are Faulhaber's terms."""
    terms = {key: c for key, c in pair_series(5).items() if key[0] == 2}
    assert terms == {(2, 2 * m, (2 * m,)): F(2, int(sympy.factorial(2 * m))) for m in range(1, 6)}


@pytest.mark.parametrize("M, spacing", [(1, 0.15), (4, 0.05), (3, 0.1)])
def test_lennard_jones_series_against_the_chain(M, spacing):
    """ρ ÿ of a smooth deformation from four levels against the sum over bonds; the rest falls as a⁸."""

    def y(i, at):  # the i-th derivative of x + 0.02 sin(x + 0.3)
        return (at, 1.0, 0.0)[min(i, 2)] + 0.02 * np.sin(at + 0.3 + i * np.pi / 2)

    errors = []
    for dx in (4 * spacing, 2 * spacing):
        chain = LennardJones(dx, M)
        j = np.arange(1, M + 1)
        A, B = chain.coefficients
        here = 0.4
        slope = lambda d, A=A, B=B: -12 * A / d**13 + 6 * B / d**7  # noqa: E731
        exact = float((slope(y(0, here + j * dx) - y(0, here)) - slope(y(0, here) - y(0, here - j * dx))).sum())
        series = evaluate(
            lennard_jones_equation(4), {i: float(y(i, here)) for i in range(1, 9)}, M, dx, chain.epsilon, chain.sigma
        )
        errors.append(abs(series / exact - 1))
    assert errors[0] < 1e-3 and np.log2(errors[0] / errors[1]) == pytest.approx(8, abs=0.6)


def test_zeta():
    assert zeta(4, 6) == 1 + F(1, 64) + F(1, 729) + F(1, 4096)
    assert zeta(3, -2) == 14
