"""Energies that the user gives: exact derivatives, LAMMPS and closed forms, sources, five- and six-body terms, what is
refused."""

import math
import pickle

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, source_matrix, sources_are_derivatives
from lammps_oracle import Config, thermal_lattice
from numba import njit

import atc
from atc.decomposers.autodiff import compiled
from atc.decomposers.bonded.dihedral import OPLSTorsion
from atc.decomposers.many_body.of_distances import ManyBody
from atc.decomposers.recording import batch_source
from atc.frame import Cell, Frame, Topology
from atc.units import units

CELL = Cell([[8.0, 0, 0], [2.1, 8.5, 0], [-1.7, 2.5, 9.0]])
OPEN = Cell(np.eye(3) * 30, periodic=(False,) * 3)


def cluster(n=7, seed=0, cell=OPEN, spread=2.5):
    rng = np.random.default_rng(seed)
    return Frame(
        rng.normal(size=(n, 3)) * spread, cell, units("metal"), types=rng.integers(1, 3, n), ids=np.arange(n) * 2 + 1
    )


def slopes_of(f, points):
    """Energies and gradients from the compiled function."""
    Q = np.atleast_2d(np.array(points, float))
    U, G = np.zeros(len(Q)), np.zeros(Q.shape)
    compiled(batch_source(f, [f"q{k}" for k in range(Q.shape[1])], {}, "test"))(Q, U, G)
    return U, G


# Derivatives
# ----------------------------------------------------------------------------------------------------------------------


def helper(z):
    return math.exp(-z) * min(z, 2.0)


ZOO = {
    "polynomial": lambda a, b: 3 * a**4 - 2 * a * b**3 + b / 7 - a**-2 + 5,
    "elementary": lambda a, b: np.exp(-a) * np.sin(b) + np.log(a + b) * np.sqrt(b) / np.cos(0.3 * a) + np.tan(0.2 * b),
    "math and numpy": lambda a, b: math.exp(-a) * math.sin(b) + math.atan2(a, b) + math.hypot(a, b) + math.pow(a, 2.5),
    "inverse": lambda a, b: np.arcsin(a / 4) + np.arccos(b / 4) * np.arctan(a * b) + np.arctan2(b, a) + np.cbrt(a),
    "hyperbolic": lambda a, b: np.sinh(a) * np.tanh(b) - np.cosh(a - b) + np.expm1(a / 9) + np.log1p(b),
    "powers": lambda a, b: a**b + b**2.5 + 2.0**a + np.power(b, a) + np.square(a) + np.reciprocal(b),
    "choices": lambda a, b: (
        abs(a - b) * max(a, b)
        + np.where((a < b) | (b > 99), np.log(a), np.tanh(b))
        + np.clip(a, 1.2, 1.7)
        + np.maximum(a, 0.5)
    ),
    "error function": lambda a, b: math.erf(a) * math.erfc(b),
    "loops, arrays, helpers": lambda a, b: (
        sum(helper(a * k) for k in range(1, 4)) + np.sum(np.exp(-np.array([a, b])) ** 2) + np.dot([a, b], [b, 3.0])
    ),
    "constant": lambda a, b: 4.0,
    "compiled": njit(lambda a, b: a * np.exp(-b)),
}


@pytest.mark.parametrize("name", ZOO)
def test_derivatives_of_the_zoo(name):
    """Against the function itself, and central differences extrapolated twice."""
    f = getattr(ZOO[name], "py_func", ZOO[name])
    points = np.random.default_rng(3).uniform(0.6, 2.4, (5, 2))
    for x, u, g in zip(points, *slopes_of(ZOO[name], points), strict=True):
        assert u == pytest.approx(float(f(*x)), rel=1e-14)
        for k in range(2):
            e = np.eye(2)[k]
            d = [(f(*(x + h * e)) - f(*(x - h * e))) / (2 * h) for h in (1e-3, 5e-4, 2.5e-4)]
            # Two steps of Richardson: error h⁶ and 1e-16/h, about 1e-12.
            d = [(4 * d[1] - d[0]) / 3, (4 * d[2] - d[1]) / 3]
            assert g[k] == pytest.approx(float((16 * d[1] - d[0]) / 15), rel=1e-9, abs=1e-10)


def test_smooth_cutoff_with_a_where_whose_other_side_is_infinite():
    """exp(1/(d − 2)) beyond 2 overflows; the branch not taken must not spoil energy or derivative."""
    f = lambda d: np.where(d < 2.0, np.exp(1 / (d - 2.0)) * np.sqrt(2.0 - d), 0.0)  # noqa: E731
    points = [0.5, 1.9, 1.9999, 2.0, 2.0001, 3.0]
    for d, u, (g,) in zip(points, *slopes_of(f, np.array(points)[:, None]), strict=True):
        assert np.isfinite([u, g]).all()
        if d >= 2.0:
            assert u == g == 0.0
        else:
            t = d - 2.0
            assert g == pytest.approx(np.exp(1 / t) * (-np.sqrt(-t) / t**2 - 0.5 / np.sqrt(-t)), rel=1e-12)


def test_texts_and_sympy_are_the_same_as_functions():
    x = [1.3, 0.7, 1.9]
    names = ["d12", "d13", "d23"]
    want = [v[0] for v in slopes_of(lambda a, b, c: 2.5 * (a - 0.3) ** 2 * np.exp(-b / c) + np.where(a < c, b, c), x)]
    text = "k*(d12 - r0)**2*exp(-d13/d23) + (d13 if d12 < d23 else d23)"
    F = compiled(batch_source(text, names, {"k": 2.5, "r0": 0.3}, "t"))
    assert batch_source(text.replace("**", "^"), names, {"k": 2.5, "r0": 0.3}, "t") == batch_source(
        text, names, {"k": 2.5, "r0": 0.3}, "t"
    )
    U, G = np.zeros(1), np.zeros((1, 3))
    F(np.array([x]), U, G)
    np.testing.assert_allclose([U[0], *G[0]], [want[0], *want[1]], rtol=1e-14)
    sp = pytest.importorskip("sympy")
    d12, d13, d23, k = sp.symbols("d12 d13 d23 k")
    e = k * (d12 - sp.Rational(3, 10)) ** 2 * sp.exp(-d13 / d23) + sp.Piecewise((d13, d12 < d23), (d23, True))
    F = compiled(batch_source(e, names, {"k": 2.5}, "t"))
    F(np.array([x]), U, G)
    np.testing.assert_allclose([U[0], *G[0]], [want[0], *want[1]], rtol=1e-14)
    # sympy differentiates on its own: an independent gradient.
    other = [float(sp.diff(e, v).subs({d12: x[0], d13: x[1], d23: x[2], k: 2.5})) for v in (d12, d13, d23)]
    np.testing.assert_allclose(G[0], other, rtol=1e-13)


# Terms
# ----------------------------------------------------------------------------------------------------------------------


def test_four_body_function_is_the_torsion():
    """cos φ written in distances, as a user would, against the built-in OPLS torsion: G of every distance (they are
    independent for four atoms)."""

    def opls(d12, d13, d14, d23, d24, d34):
        p = (d13**2 - d12**2 - d23**2) / 2
        q = (d24**2 - d23**2 - d34**2) / 2
        t = (d14**2 - d12**2 - d23**2 - d34**2) / 2 - p - q
        c = (p * q - t * d23**2) / np.sqrt((d12**2 * d23**2 - p**2) * (d23**2 * d34**2 - q**2))
        return 0.5 * (1.3 * (1 + c) + 0.4 * (1 - (2 * c**2 - 1)) + 0.8 * (1 + 4 * c**3 - 3 * c))

    rng = np.random.default_rng(4)
    x = (np.cumsum(rng.normal(size=(5, 4, 3)), axis=1) + rng.uniform(0, 8, (5, 1, 3))).reshape(-1, 3)
    atoms = np.arange(20).reshape(5, 4)
    frame = Frame(x, CELL, units("metal"), topology=Topology(dihedrals=atoms, dihedral_types=np.ones(5, int)))
    a = atc.potential(ManyBody(opls, atoms=atoms)).decompose(frame, sources=True)
    b = atc.potential(OPLSTorsion((1.3, 0.4, 0.8, 0.0))).decompose(frame, sources=True)
    assert a.energy == pytest.approx(b.energy, rel=1e-12)
    np.testing.assert_array_equal(a.bonds.i, b.bonds.i)
    # Differences of squared distances lose digits in flat chains.
    np.testing.assert_allclose(a.bonds.G_b, b.bonds.G_b, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.bonds.D_bdc, b.bonds.D_bdc, rtol=1e-9, atol=1e-9)


def sw_three_body(d12, d13, d23, lam=21.0, eps=2.1683, sigma=2.0951, a=1.8, gamma=1.2):
    cos = (d12**2 + d13**2 - d23**2) / (2 * d12 * d13)
    inside = (d12 < a * sigma) & (d13 < a * sigma)
    return np.where(
        inside,
        lam * eps * (cos + 1 / 3) ** 2 * np.exp(gamma * sigma / (d12 - a * sigma) + gamma * sigma / (d13 - a * sigma)),
        0.0,
    )


@pytest.mark.parametrize("style", ["metal", "real"])
def test_neighbour_rule_is_stillinger_weber_of_lammps(tmp_path, style):
    """All triples of a centre and two neighbours: the three-body half of LAMMPS's sw, its two-body half switched off (A
    = 0)."""
    eps = 2.1683 if style == "metal" else 50.0
    (tmp_path / "three.sw").write_text(
        f"Si Si Si {eps} 2.0951 1.80 21.0 1.20 -0.333333333333333333 0 0.6022245584 4.0 0.0 0.0\n"
    )
    x, t = thermal_lattice(CELL.vectors, (3, 4, 4), jitter=0.25, seed=1)
    config = Config(CELL.vectors, x, units=style)
    pot = atc.potential(
        ManyBody(lambda a, b, c: sw_three_body(a, b, c, eps=eps), cutoff=1.8 * 2.0951, units=style), units=style
    )
    lines = f"pair_style sw\npair_coeff * * {tmp_path / 'three.sw'} Si"
    d, _ = agrees_with_lammps(pot, lines, config)
    assert d.n_bonds > 1000


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("partition", ["equal", "first", (0.2, 0.5, 0.3)])
def test_three_body_sources(partition, periodic):
    frame = cluster(8, cell=CELL if periodic else OPEN)
    smooth = "where(d12 < 4, (4 - d12)**3, 0)*where(d13 < 4, (4 - d13)**3, 0)*(1 + 0.3*d23**2)/50"
    term = ManyBody(smooth, cutoff=4.0, bodies=3, partition=partition)
    sources_are_derivatives(atc.potential(term), frame)
    before = atc.potential(term).decompose(frame)
    term.share("first")
    assert "energy to the first atom" in term.describe()
    after = atc.potential(term).decompose(frame)
    assert np.allclose(before.energies_n, after.energies_n) == (partition == "first")
    assert after.energies_n.sum() == pytest.approx(before.energy, rel=1e-13)
    np.testing.assert_array_equal(before.forces_nc, after.forces_nc)


def test_types_tell_atoms_apart():
    """Centre type 1, one neighbour of type 1 and one of type 2, an energy that is not symmetric: against a loop over
    all triples."""
    frame = cluster(9, seed=3)

    def f(a, b, c):
        return np.where((a < 5) & (b < 5), (5 - a) ** 3 * (5 - b) ** 4 * c, 0.0)

    d = atc.potential(ManyBody(f, cutoff=5.0, types=(1, 1, 2))).decompose(frame)
    want = 0.0
    x, t = frame.positions, frame.types
    for i in range(9):
        for j in range(9):
            for k in range(9):
                if len({i, j, k}) == 3 and (t[i], t[j], t[k]) == (1, 1, 2):
                    want += f(*(np.linalg.norm(v) for v in (x[i] - x[j], x[i] - x[k], x[j] - x[k])))
    assert d.energy == pytest.approx(want, rel=1e-12) and want > 0
    sources_are_derivatives(atc.potential(ManyBody(f, cutoff=5.0, types=(1, 1, 2))), frame)


def test_pair_rule_is_a_pair_potential():
    lines = "pair_style lj/cut 4.0\npair_coeff * * 0.3 2.0"
    x, t = thermal_lattice(CELL.vectors, (3, 4, 4), jitter=0.2, seed=2)
    config = Config(CELL.vectors, x)
    pot = atc.potential(
        ManyBody("4*e*((s/d12)**12 - (s/d12)**6)", cutoff=4.0, bodies=2, parameters={"e": 0.3, "s": 2.0})
    )
    agrees_with_lammps(pot, lines, config)
    frame = cluster(6, seed=2)
    some = atc.potential(ManyBody("d12**2", cutoff=9.0, bodies=2, types=(1, 2))).decompose(frame)
    r = frame.positions[frame.types == 1][:, None] - frame.positions[frame.types == 2][None]
    d2 = (r**2).sum(-1)
    assert some.energy == pytest.approx(d2[d2 < 81].sum(), rel=1e-12)


@pytest.mark.parametrize("k,variables", [(2, "distance"), (3, "xi"), (4, "distance"), (5, "xi"), (6, "distance")])
def test_random_terms_of_k_bodies(k, variables):
    """A random smooth function of all distances, across the faces of a small cell: forces and sources are derivatives
    of energy and shares."""
    rng = np.random.default_rng(k)
    n = k * (k - 1) // 2
    A, c = rng.normal(size=(n, n)) / n, rng.uniform(0.5, 1.5, n)

    def f(*q):
        s = [sum(A[r, m] * q[m] for m in range(n)) for r in range(n)]
        return sum(np.cos(s[r]) * np.exp(-0.1 * c[r] * q[r]) for r in range(n))

    x = np.cumsum(rng.normal(size=(k + 2, 3)), axis=0) + 4.0
    frame = Frame(x, CELL, units("metal"))
    atoms = np.array([np.roll(np.arange(k + 2), -s)[:k] for s in range(2)])
    pot = atc.potential(ManyBody(f, atoms=atoms, variables=variables))
    d = sources_are_derivatives(pot, frame)
    assert d.n_bonds == 2 * n
    for a in range(3):
        e = []
        for s in (1, -1):
            y = x.copy()
            y[1, a] += s * 1e-5
            e.append(pot.decompose(frame.replace(positions=y)).energy)
        assert d.forces_nc[1, a] == pytest.approx(-(e[0] - e[1]) / 2e-5, abs=1e-8)


def cayley_menger(*xi):
    """The determinant that vanishes for five points of three-dimensional space, by elimination in its 10 squared
    distances."""
    n = 5
    d = [[0.0] * n for _ in range(n)]
    e = 0
    for p in range(n):
        for q in range(p + 1, n):
            d[p][q] = d[q][p] = 2 * xi[e]
            e += 1
    # Gram matrix about the first point: its determinant is the Cayley-Menger determinant up to a factor.
    g = [[(d[0][p] + d[0][q] - d[p][q]) / 2 for q in range(1, n)] for p in range(1, n)]

    def det(m):
        if len(m) == 1:
            return m[0][0]
        return sum(
            (-1) ** c * m[0][c] * det([[row[j] for j in range(len(m)) if j != c] for row in m[1:]])
            for c in range(len(m))
        )

    return det(g)


def test_five_bodies_have_more_than_one_extension():
    """Adding what vanishes on all real configurations changes G and nothing that is physical: energy, forces, box
    virial."""
    frame = cluster(5, seed=8, spread=1.0)
    one = ManyBody(lambda *q: sum(np.cos(v) for v in q), atoms=[range(5)], variables="xi")
    two = ManyBody(lambda *q: sum(np.cos(v) for v in q) + 0.7 * cayley_menger(*q), atoms=[range(5)], variables="xi")
    a, b = (atc.potential(t).decompose(frame, sources=True) for t in (one, two))
    assert abs(a.energy - b.energy) < 1e-9
    np.testing.assert_allclose(a.forces_nc, b.forces_nc, rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.virial_cc, b.virial_cc, rtol=0, atol=1e-9)
    np.testing.assert_allclose(source_matrix(a.bonds, 5), source_matrix(b.bonds, 5), rtol=0, atol=1e-9)
    assert np.abs(a.bonds.G_b - b.bonds.G_b).max() > 0.1
    assert "extended off the distance constraint as given" in two.describe()


def test_two_extensions_give_two_stress_fields_of_one_divergence():
    """The central-force decomposition of five bodies and more is not unique: σ depends on the extension, ∇·σ and the
    box average do not."""
    frame = cluster(5, seed=8, spread=1.0)
    one = ManyBody(lambda *q: sum(np.cos(v) for v in q), atoms=[range(5)], variables="xi")
    two = ManyBody(lambda *q: sum(np.cos(v) for v in q) + 0.7 * cayley_menger(*q), atoms=[range(5)], variables="xi")
    kern, h = atc.kernel("gaussian", width=1.2), 0.02
    x_gc = frame.positions.mean(0) + np.random.default_rng(1).normal(0, 0.7, (8, 3))
    # Sixth-order central differences: their own error is about h⁶/140 of the field over width⁶, 1e-13.
    steps = h * np.arange(-3, 4)
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    grid = atc.Grid.points((x_gc[:, None, None] + steps[:, None] * np.eye(3)[:, None]).reshape(-1, 3))

    def field(term):
        ds = atc.fields(frame, atc.potential(term), kern, grid, ["stress_potential"], tolerance=1e-12)
        s = ds.stress_potential.values[0].reshape(len(x_gc), 3, 7, 3, 3)
        return s[:, 0, 3], np.einsum("k,gikij->gj", weights, s)

    (stress_a, force_a), (stress_b, force_b) = field(one), field(two)
    scale = np.abs(stress_b).max()
    assert np.abs(stress_a - stress_b).max() > 0.05 * scale
    np.testing.assert_allclose(force_a, force_b, rtol=0, atol=1e-9 * scale)
    assert np.abs(force_a).max() > 1e-3 * np.abs(stress_a).max()


def test_given_gradient_ids_threads_and_pickle():
    @njit
    def f(a, b, c):
        if a < 3.0:
            return (3.0 - a) ** 3 * b * c
        return 0.0

    @njit
    def g(a, b, c):
        if a < 3.0:
            return -3 * (3.0 - a) ** 2 * b * c, (3.0 - a) ** 3 * c, (3.0 - a) ** 3 * b
        return 0.0, 0.0, 0.0

    frame = cluster(7, seed=1)
    tuples = np.array([[1, 3, 5], [13, 11, 1], [5, 7, 9]])
    hand = atc.potential(ManyBody(f, gradient=g, ids=tuples)).decompose(frame)
    auto = ManyBody(lambda a, b, c: np.where(a < 3, (3 - a) ** 3 * b * c, 0), atoms=(tuples - 1) // 2)
    d = atc.potential(auto).decompose(frame, threads=2)
    assert hand.energy == pytest.approx(d.energy, rel=1e-13)
    np.testing.assert_allclose(hand.forces_nc, d.forces_nc, rtol=0, atol=1e-12)
    again = atc.potential(pickle.loads(pickle.dumps(auto))).decompose(frame)
    np.testing.assert_array_equal(again.forces_nc, atc.potential(auto).decompose(frame).forces_nc)
    with pytest.raises(atc.AtcError, match="names atom 99, which is not in this frame"):
        atc.potential(ManyBody("d12", ids=[[1, 99]])).decompose(frame)
    with pytest.raises(atc.AtcError, match="atoms 0 to 6"):
        atc.potential(ManyBody("d12", atoms=[[0, 7]])).decompose(frame)
    with pytest.raises(atc.AtcError, match="of the atoms 1, 3 has no finite energy"):
        atc.potential(ManyBody("log(d12)", atoms=[[0, 1]])).decompose(frame.replace(positions=np.zeros((7, 3))))


def branch(a):
    if a < 2:
        return a
    return a * a


REFUSED = [
    (lambda: ManyBody(branch, atoms=[[0, 1]]), "a branch .* use numpy.where"),
    (lambda: ManyBody(lambda a: float(a), atoms=[[0, 1]]), r"float\(\)"),
    (lambda: ManyBody(lambda a: np.floor(a), atoms=[[0, 1]]), "numpy.floor cannot be differentiated"),
    (lambda: ManyBody(lambda a: a.real, atoms=[[0, 1]]), "calling the energy function with 1 distances failed"),
    (lambda: ManyBody(lambda a, b: a, atoms=[[0, 1]]), "calling the energy function with 1 distances failed"),
    (lambda: ManyBody("d12*q", atoms=[[0, 1]]), "unknown name 'q'"),
    (lambda: ManyBody("__import__('os').system('true')", atoms=[[0, 1]]), "cannot read"),
    (lambda: ManyBody("gamma(d12)", atoms=[[0, 1]]), "unknown function 'gamma'"),
    (lambda: ManyBody("d12 +", atoms=[[0, 1]]), "expected an arithmetic expression"),
    (lambda: ManyBody("d12"), "exactly one of atoms=, ids= and cutoff="),
    (lambda: ManyBody("d12", cutoff=3.0), "bodies="),
    (lambda: ManyBody(lambda a, b, c: a * b * b, cutoff=3.0), "changes when the two neighbours"),
    (lambda: ManyBody(lambda a, b, c, d, e, f: a, cutoff=3.0), "list the tuples"),
    (lambda: ManyBody("d12", atoms=[list(range(7))]), "energies of 2 to 6 atoms"),
    (lambda: ManyBody("d12", atoms=[[1, 1]]), "names an atom twice"),
    (lambda: ManyBody("d12", atoms=[[1.5, 2]]), "whole numbers"),
    (lambda: ManyBody("d12", atoms=[[0, 1]], partition=(0.5, 0.6)), "add up to 1"),
    (lambda: ManyBody("d12", atoms=[[0, 1]], types=(1, 2)), "goes with cutoff="),
    (
        lambda: ManyBody(lambda a: a**3, gradient=lambda a: (2 * a**2,), atoms=[[0, 1]]),
        "gradient is not that of the energy",
    ),
    (lambda: ManyBody("d12", atoms=[[0, 1]], variables="r"), "expected 'distance' or 'xi'"),
]


@pytest.mark.parametrize("case", range(len(REFUSED)))
def test_refused(case):
    make, message = REFUSED[case]
    with pytest.raises(atc.AtcError, match=message) as e:
        make()
    assert "\n" not in str(e.value)
