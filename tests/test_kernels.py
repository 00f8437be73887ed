import itertools
import math
import pickle

import numpy as np
import pytest
from naive import NORMALISATION, RADIAL, NaiveKernel
from scipy.integrate import quad

import atc
from atc.errors import AtcError
from atc.kernels import NAMES

TABLE = [(0.0, 2.0), (0.7, 2.5), (1.1, 1.0), (2.0, 0.3), (2.6, 0.0)]
JUMP = [(0.3, 1.0), (1.0, 2.0), (2.0, 0.5)]


def cases():
    """(kernel, its naive twin): every kernel there is, at an odd length."""
    R = 2.3
    out = [(atc.kernel(n, R), NaiveKernel(n, R)) for n in RADIAL]
    out += [
        (atc.kernel("gaussian", width=0.8), NaiveKernel("gaussian", 0.8)),
        (atc.kernel("bspline", R), NaiveKernel("bspline", R)),
        (atc.kernel("box", size=[R, R, R]), NaiveKernel("box", R)),
        (atc.kernel("trilinear", size=[1.1, 1.7, R]), NaiveKernel("trilinear", [1.1, 1.7, R])),
        (atc.kernel("piecewise-linear", table=TABLE), NaiveKernel("table", table=TABLE)),
        (atc.kernel("piecewise_linear", table=JUMP), NaiveKernel("table", table=[(0.0, 1.0), *JUMP])),
    ]
    return out


CASES = cases()
IDS = [f"{k.name}{i}" for i, (k, _) in enumerate(CASES)]
every = pytest.mark.parametrize("kern, twin", CASES, ids=IDS)


def test_all_names_are_covered():
    assert {k.name for k, _ in CASES} == set(NAMES)


@every
def test_phi_is_the_definition(kern, twin):
    rng = np.random.default_rng(1)
    d = rng.normal(size=(300, 3)) * kern.support / 2
    want = np.array([twin.phi(v) for v in d])
    assert np.count_nonzero(want) > 100
    # 1e-14: a polynomial of five terms against a product.
    np.testing.assert_allclose(kern.phi(d), want, rtol=0, atol=1e-14 * kern.peak)
    assert (kern.phi(d) >= -1e-15 * kern.peak).all()


@every
def test_integral_is_one_and_support_is_where_it_ends(kern, twin):
    # Along a ray for isotropic kernels, by the product of marginals for the others.
    if kern.is_isotropic:
        knots = np.linspace(0, kern.support, 24)
        if kern.name == "hardy":
            knots = np.sort([*knots, kern.radius / 2])
        elif kern.name == "piecewise-linear":
            knots = np.sort([*knots, *kern.radii])
        f = lambda r: 4 * math.pi * r * r * float(kern.phi([r, 0, 0]))  # noqa: E731
        total = sum(quad(f, a, b, epsabs=1e-15, epsrel=1e-13)[0] for a, b in itertools.pairwise(knots) if b > a)
        # 1e-13: two dozen pieces of adaptive quadrature.
        assert total == pytest.approx(1.0, abs=1e-13)
        assert kern.phi([0, kern.support * (1 + 1e-12), 0]) == 0
        assert kern.phi([0, kern.support * (1 - 1e-3), 0]) > 0
    else:
        x = np.linspace(-kern.radius, kern.radius, 5)
        one = sum(
            quad(lambda z: float(kern.marginal().phi(z)), a, b, epsabs=1e-15)[0] for a, b in itertools.pairwise(x)
        )
        assert one == pytest.approx(1.0, abs=1e-13)
        assert kern.phi(np.full(3, kern.support)) == 0


def test_normalisation_is_the_known_number():
    for name, factor in NORMALISATION.items():
        assert atc.kernel(name, 2.0).normalisation == pytest.approx(factor / (math.pi * 8), rel=1e-15)


def bonds(R, rng):
    """(what, d, r): the ordinary and the awkward bonds."""
    unit = lambda: (lambda v: v / np.linalg.norm(v))(rng.normal(size=3))  # noqa: E731
    for _ in range(25):
        yield "random", rng.normal(size=3) * R * 0.7, rng.normal(size=3) * R
    for _ in range(4):
        n = unit()
        t = unit()
        across = np.cross(n, t) / np.linalg.norm(np.cross(n, t))
        yield "crosses the boundary", 0.3 * R * across, 1.7 * R * n
        yield "inside", 0.2 * R * t, 0.1 * R * n
        yield "length 1e-12 R", 0.6 * R * t, 1e-12 * R * n
        yield "length 1e-6 R", 0.6 * R * t, 1e-6 * R * n
        yield "length 0", 0.6 * R * t, np.zeros(3)
        yield "x on the bond", 0.4 * R * n, 0.9 * R * n
        yield "x nearly on the bond", 0.4 * R * n + 1e-9 * R * across, 0.9 * R * n
        yield "x at its start", np.zeros(3), 0.9 * R * n
        yield "x at its end", 0.5 * R * n, 0.5 * R * n
        yield "tangent from inside", (1 - 1e-6) * R * across + 0.4 * R * n, 0.8 * R * n
        yield "tangent from outside", (1 + 1e-12) * R * across + 0.4 * R * n, 0.8 * R * n
        yield "100 R long", 0.3 * R * across + 40 * R * n, 100 * R * n
        yield "1e4 R long", 0.3 * R * across + 4e3 * R * n, 1e4 * R * n
        yield "starts on the boundary", R * n, 0.5 * R * t
        yield "along an axis", 0.3 * R * np.array([1.0, 0, 0]), R * np.eye(3)[rng.integers(3)]


@every
def test_beta_against_adaptive_quadrature(kern, twin):
    R = kern.support
    for what, d, r in bonds(R, np.random.default_rng(2)):
        got, want = float(kern.beta(d, r)), twin.beta(d, r)
        # The promise, relative to the kernel's peak. A kernel with a jump has β ~ √(depth) near tangency:
        # rounding of the geometry by 1e-16 R then moves β by up to 1e-16/√(1e-6).
        tolerance = 1e-12
        if kern.name in ("step", "box") or kern is CASES[-1][0]:
            tolerance = 3e-12
            if what == "starts on the boundary" or (what.startswith("length") and what.endswith("R")):
                continue
        assert abs(got - want) <= tolerance * kern.peak, (what, got, want)


@every
def test_beta_of_nothing_is_phi(kern, twin):
    d = np.random.default_rng(3).normal(size=(200, 3)) * kern.support / 2
    # 1e-14: the same polynomial through powers of √(p² + u²).
    np.testing.assert_allclose(kern.beta(d, np.zeros(3)), kern.phi(d), rtol=0, atol=1e-14 * kern.peak)


@every
def test_beta_does_not_know_which_end_is_first(kern, twin):
    rng = np.random.default_rng(4)
    d, r = rng.normal(size=(2, 200, 3)) * kern.support / 2
    # 3e-14: two different clippings of the same bond; √ of rounding where a jump is grazed.
    np.testing.assert_allclose(kern.beta(d, r), kern.beta(d - r, -r), rtol=0, atol=3e-14 * kern.peak)


JUMPS = ("step", "box", "piecewise-linear")


@pytest.mark.parametrize(
    "kern",
    [k for k, _ in CASES if k.name not in JUMPS],
    ids=[i for i, (k, _) in zip(IDS, CASES) if k.name not in JUMPS],
)
def test_phi_difference_is_the_divergence_of_beta(kern):
    """φ(d − r) − φ(d) = r·∂β/∂d with the sign of the bond: the property that makes β the bond function."""
    rng = np.random.default_rng(5)
    d, r = rng.normal(size=(2, 50, 3)) * kern.support / 3
    h = 1e-4 * kern.support
    n = r / np.linalg.norm(r, axis=1)[:, None]
    slope = (
        8 * (kern.beta(d + h * n, r) - kern.beta(d - h * n, r))
        - kern.beta(d + 2 * h * n, r)
        + kern.beta(d - 2 * h * n, r)
    ) / (12 * h)
    # 3e-5: fourth-order differences of h = 1e-4, second order (1e-4 of the slope's jump) where a kink of φ is inside
    # the stencil.
    np.testing.assert_allclose(
        slope * np.linalg.norm(r, axis=1), kern.phi(d) - kern.phi(d - r), rtol=0, atol=3e-5 * kern.peak
    )


@every
def test_gradient(kern, twin):
    rng = np.random.default_rng(6)
    d = rng.normal(size=(100, 3)) * kern.support / 3
    rho = np.linalg.norm(d, axis=1)
    h = 1e-4 * kern.support
    kinks = getattr(kern, "radii", np.zeros(0))
    away = (np.abs(rho[:, None] - kinks[None]) > 3 * h).all(1) & (rho > 0.2 * kern.support)
    if kern.name == "box":
        away &= (np.abs(np.abs(d) - kern.size / 2) > 3 * h).all(1)
    if kern.name == "trilinear":
        away = kern.kink_distance(d) > 3 * h
    if kern.name == "bspline":
        away &= (np.abs(np.abs(d)[..., None] - np.array([0, 0.5, 1]) * kern.radius) > 3 * h).all((1, 2))
    assert away.sum() > 20
    e = np.eye(3) * h
    num = np.stack(
        [(8 * (kern.phi(d + v) - kern.phi(d - v)) - kern.phi(d + 2 * v) + kern.phi(d - 2 * v)) / (12 * h) for v in e],
        -1,
    )
    # 1e-9: rounding 1e-16/1e-4 and the error h⁴ of the differences.
    np.testing.assert_allclose(
        kern.grad_phi(d)[away] * kern.support, num[away] * kern.support, rtol=0, atol=1e-9 * kern.peak
    )


@every
def test_marginal_is_the_integral_over_the_plane(kern, twin):
    m = kern.marginal()
    if kern.is_isotropic:
        for z in np.array([0.0, 0.13, 0.5, 0.77, 0.96]) * kern.support:
            edge = math.sqrt(max(kern.support**2 - z * z, 0.0))
            knots = np.sort(
                [*np.linspace(0, edge, 16), *[math.sqrt(R * R - z * z) for R in getattr(kern, "radii", []) if z < R]]
            )
            f = lambda q, z=z: 2 * math.pi * q * float(kern.phi([q, 0, z]))  # noqa: E731
            want = sum(quad(f, a, b, epsabs=1e-16, epsrel=1e-13)[0] for a, b in itertools.pairwise(knots) if b > a)
            for s in (z, -z):
                # 1e-13: two dozen quadratures.
                assert float(m.phi(s)) == pytest.approx(want, abs=1e-13 * m.phi(0.0))
    z = np.linspace(-1.1, 1.1, 7) * m.support
    for s in z:
        knots = np.sort(
            np.clip(
                [
                    -m.support,
                    *np.linspace(-1, 1, 20) * m.support,
                    *[x for R in getattr(m, "radii", []) for x in (-R, R)],
                    s,
                ],
                None,
                s,
            )
        )
        want = sum(
            quad(lambda t: float(m.phi(t)), a, b, epsabs=1e-16, epsrel=1e-13)[0]
            for a, b in itertools.pairwise(knots)
            if b > a
        )
        assert float(m.cumulative(s)) == pytest.approx(want, abs=1e-13)


@every
def test_marginal_beta(kern, twin):
    m = kern.marginal()
    rng = np.random.default_rng(8)
    R = m.support
    for r in (R * 5, R, 0.3 * R, 0.011 * R, 0.009 * R, 1e-5 * R, 1e-13 * R, 0.0):
        for d in rng.uniform(-1.3, 1.3, 6) * R + 0.5 * r:
            for s in (1, -1):
                cuts = [(d - z) / (s * r) for q in getattr(m, "radii", [R]) for z in (-q, 0.0, q)] if r else []
                knots = [0.0, *sorted(t for t in [*cuts, 0.25, 0.5, 0.75] if 0 < t < 1), 1.0]
                want = sum(
                    quad(lambda t, d=d, v=s * r: float(m.phi(d - t * v)), a, b, epsabs=1e-16, epsrel=1e-13)[0]
                    for a, b in itertools.pairwise(knots)
                )
                assert abs(float(m.beta(d, s * r)) - want) <= 1e-12 * float(m.phi(0.0)), (r, d)


@every
def test_scaled(kern, twin):
    big = kern.scaled(3.7)
    d, r = np.random.default_rng(9).normal(size=(2, 20, 3))
    assert big.support == pytest.approx(3.7 * kern.support, rel=1e-15)
    np.testing.assert_allclose(big.beta(3.7 * d, 3.7 * r) * 3.7**3, kern.beta(d, r), rtol=0, atol=1e-13 * kern.peak)
    assert kern.scaled(1.0) is kern
    again = pickle.loads(pickle.dumps(kern))
    assert again == kern and np.array_equal(again.beta(d, r), kern.beta(d, r))


def test_rebuilt_from_its_parameters():
    for kern, _ in CASES:
        assert atc.kernel(kern.name, **kern.parameters) == kern
        assert kern.name in kern.describe()


def test_gaussian_radius_is_three_widths():
    assert atc.kernel("gaussian", radius=6.0).width == pytest.approx(2.0, rel=1e-15)
    k = atc.kernel("gaussian", width=2.0)
    assert 0.99e-16 < math.exp(-(k.support**2) / 8) < 1.01e-16


def test_box_is_half_open():
    k = atc.kernel("box", size=[2, 4, 6])
    assert k.phi([-1, -2, -3]) == k.normalisation == 1 / 48
    assert k.phi([1, 0, 0]) == k.phi([0, 2, 0]) == k.phi([0, 0, 3]) == 0
    # A bond within a face: counted by one of the two boxes that share it.
    assert k.beta([-1, 0, 0], [0, 1, 0]) == k.normalisation and k.beta([1, 0, 0], [0, 1, 0]) == 0
    # 2e-16: half of it in each of two.
    assert k.beta([1.5, 0, 0], [1, 0, 0]) == pytest.approx(k.normalisation / 2, rel=2e-16)


def test_aliases():
    assert atc.kernel("cell", radius=1.0) == atc.kernel("box", size=[2, 2, 2])
    assert atc.kernel("quartic_sphere", 3.0) == atc.kernel("quartic", 3.0)
    assert atc.kernel("hardy", 2.0).phi([0.9, 0, 0]) == atc.kernel("hardy", 2.0).peak


@pytest.mark.parametrize(
    "args, kw, words",
    [
        (("quadric", 1.0), {}, "quartic"),
        ((None, 1.0), {}, "unknown kernel"),
        (("quartic", 0.0), {}, "positive"),
        (("quartic", -1.0), {}, "positive"),
        (("quartic", math.nan), {}, "positive and finite"),
        (("quartic", math.inf), {}, "finite"),
        (("quartic", "wide"), {}, "number"),
        (("quartic",), {}, "radius"),
        (("quartic", 1.0), {"width": 1.0}, "width"),
        (("gaussian",), {}, "width"),
        (("gaussian", 3.0), {"width": 1.0}, "exactly one"),
        (("box",), {"size": [1, 2]}, "three"),
        (("box",), {"size": [1, 2, 0]}, "positive"),
        (("piecewise-linear",), {"table": [(0, 1), (0, 2)]}, "increase"),
        (("piecewise-linear",), {"table": [(0, -1), (1, 2)]}, "negative"),
        (("piecewise-linear",), {"table": [(0, 0), (1, 0)]}, "zero everywhere"),
        (("piecewise-linear",), {"table": [1, 2, 3]}, "pairs"),
        (("piecewise-linear",), {"table": "abc"}, "pairs"),
    ],
)
def test_bad_input(args, kw, words):
    with pytest.raises(AtcError, match=words) as e:
        atc.kernel(*args, **kw)
    assert "\n" not in str(e.value)
