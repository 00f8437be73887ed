"""The spectral deposit against the exact one."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import atc
from atc.deposit import fourier, make
from atc.errors import AtcError
from atc.frame import Cell
from atc.units import units

METAL = units("metal")
CELLS = {
    "orthogonal": Cell([12.0, 13.0, 14.0], [1.0, -2.0, 0.5]),
    "triclinic": Cell([[12, 0, 0], [5.1, 11, 0], [-3, 4.5, 13]], [1.0, -2.0, 0.5]),
    "left-handed, rotated": Cell(np.array([[0, 12, 1.0], [11, 0.5, 0], [1.0, 0, 13]])),
}
TABLE = [(0, 2.0), (1.2, 2.5), (2.1, 1.0), (5.0, 0.0)]
KERNELS = {
    name: atc.kernel("piecewise-linear", table=TABLE) if name == "piecewise-linear" else atc.kernel(name, 5.0)
    for name in ("gaussian", "lucy", "quartic", "cubic", "bspline", "hardy", "linear", "piecewise-linear", "step")
}


def sample(cell, seed=0, n=120, n_bond=600, length=2.0):
    """Atoms in the cell and outside; bonds short, of length 0, longer than the cell."""
    rng = np.random.default_rng(seed)
    x = cell.cartesian(3 * rng.random((n, 3)) - 1)
    i = rng.integers(0, n, n_bond).astype(np.int32)
    r = rng.normal(size=(n_bond, 3)) * length
    r[0] = 0
    r[1] *= 1e-9
    r[2] = 1.4 * cell.vectors[0]
    return x, i, r, rng.normal(size=(n, 3)), rng.normal(size=n_bond)


def both(method, shape, kern, cell, data, threads=1, at="cells", **kw):
    x, i, r, a, G = data
    bound = atc.Grid.regular(shape=shape, **({} if at == "cells" else {"at": at})).bind(METAL, cell, x)
    dep = make(method, bound, kern, cell, a.shape[1], 6, threads, **kw)
    dep.add_sites(x, a)
    dep.add_bond_stress(x, i, r, G)
    return dep.site_sums(), dep.bond_sums()


def close(got, want, tolerance):
    assert got.shape == want.shape
    assert np.abs(got - want).max() <= tolerance * np.abs(want).max()


# Tolerances for which the mesh stays small enough for a test.
@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
@pytest.mark.parametrize(
    "name, tolerances",
    [
        ("gaussian", (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)),
        ("lucy", (1e-2, 1e-3, 1e-4, 1e-5)),
        ("bspline", (1e-2, 1e-3, 1e-4)),
        ("quartic", (1e-2, 1e-3)),
        ("cubic", (1e-2, 1e-3)),
        ("hardy", (1e-2,)),
        ("linear", (1e-2,)),
        ("piecewise-linear", (1e-2,)),
    ],
)
def test_promise(name, tolerances, cell):
    data = sample(cell)
    want = both("direct", (9, 8, 10), KERNELS[name], cell, data)
    for tolerance in tolerances:
        got = both("spectral", (9, 8, 10), KERNELS[name], cell, data, tolerance=tolerance)
        close(got[0], want[0], tolerance)
        close(got[1], want[1], tolerance)


@pytest.mark.parametrize("seed", range(6))
def test_promise_for_other_sources(seed):
    """Few atoms, all of one sign, one atom alone: fields whose largest value is not that of a random sum."""
    cell = CELLS["triclinic"]
    n = (1, 2, 5, 20, 300, 3000)[seed]
    x, i, r, a, G = sample(cell, seed, n, 3 + n)
    data = x, i, r, np.abs(a), np.abs(G)
    for name, tolerance in (("gaussian", 1e-5), ("lucy", 1e-3), ("quartic", 3e-3)):
        want = both("direct", (12, 12, 12), KERNELS[name], cell, data)
        got = both("spectral", (12, 12, 12), KERNELS[name], cell, data, tolerance=tolerance)
        close(got[0], want[0], tolerance)
        close(got[1], want[1], tolerance)


@pytest.mark.parametrize("at", ["cells", "corners"])
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 3), (5, 4, 3), (7, 30, 2), (24, 20, 28)])
def test_any_number_of_points(shape, at):
    """Fewer points than modes (folded) and more (padded), even and odd numbers."""
    cell, kern = CELLS["triclinic"], atc.kernel("gaussian", width=1.1)
    data = sample(cell, 3)
    want, got = (both(m, shape, kern, cell, data, at=at, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": 1e-9})))
    # One point may lie where the field is small.
    for g, w in zip(got, want):
        close(g, w, 1e-8)


def test_coarse_grid_is_a_subset_of_a_fine_one():
    cell, data = CELLS["triclinic"], sample(CELLS["triclinic"], 4)
    # The same modes: only rounding differs, that of single precision at the first.
    for name, tolerance, rounding in (("lucy", 1e-3, 1e-6), ("gaussian", 1e-8, 1e-12)):
        fine, coarse = (both("spectral", s, KERNELS[name], cell, data, at="corners", tolerance=tolerance) for s in ((12, 15, 8), (4, 5, 2)))
        for f, c in zip(fine, coarse):
            close(c.reshape(4, 5, 2, -1), f.reshape(12, 15, 8, -1)[::3, ::3, ::4], rounding)


@pytest.mark.parametrize(
    "name, radius, tolerance", [("gaussian", 40.0, 1e-8), ("lucy", 30.0, 1e-6), ("bspline", 25.0, 1e-5), ("quartic", 30.0, 1e-4)]
)
def test_kernel_wider_than_the_box(name, radius, tolerance):
    cell, kern = Cell([[6.0, 0, 0], [1.0, 5.0, 0], [0, -2.0, 7.0]]), atc.kernel(name, radius)
    data = sample(cell, 5, n=20, n_bond=40)
    want, got = (both(m, (3, 4, 2), kern, cell, data, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": tolerance})))
    for g, w in zip(got, want):
        close(g, w, tolerance)


def test_box_and_origin_of_any_size():
    """A flat cell much smaller than the kernel along one axis, 1e6 Å from the origin."""
    cell, kern = Cell([30.0, 1.5, 9.0], [1e6, -1e6, 0.0]), atc.kernel("gaussian", width=1.0)
    data = sample(cell, 6)
    want, got = (both(m, (20, 3, 8), kern, cell, data, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": 1e-6})))
    for g, w in zip(got, want):
        close(g, w, 1e-6)


def test_threads_and_pieces_agree():
    cell, kern = CELLS["orthogonal"], KERNELS["gaussian"]
    x, i, r, a, G = sample(cell, 7)
    bound = atc.Grid.regular(shape=(6, 7, 8)).bind(METAL, cell, x)
    want = both("spectral", (6, 7, 8), kern, cell, (x, i, r, a, G), tolerance=1e-6)
    dep = make("spectral", bound, kern, cell, 3, 6, threads=2, tolerance=1e-6)

    def part(t):
        dep.add_sites(x[t::2], a[t::2], thread=t)
        for k in range(t, 10, 2):
            dep.add_bond_stress(x, i[k::10], r[k::10], G[k::10], thread=t)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(part, range(2)))
    # The same points in another order.
    close(dep.site_sums(), want[0], 1e-13)
    close(dep.bond_sums(), want[1], 1e-13)
    assert dep.visits > 0


@pytest.mark.parametrize("n_comp", [1, 4, 5, 8, 9, 21])
def test_any_number_of_components(n_comp):
    cell, kern = CELLS["triclinic"], KERNELS["gaussian"]
    x, i, r, _, _ = sample(cell, 8, n=30, n_bond=50)
    b = np.random.default_rng(1).normal(size=(50, n_comp))
    bound = atc.Grid.regular(shape=(3, 4, 5)).bind(METAL, cell, x)
    sums = []
    for method in ("direct", "spectral"):
        dep = make(method, bound, kern, cell, 0, n_comp)
        dep.add_bonds(x[i], r, b)
        sums.append(dep.bond_sums())
    close(sums[1], sums[0], 1e-5)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_positions_that_are_not_numbers(bad):
    cell = CELLS["orthogonal"]
    x, i, r, _, G = sample(cell, n=5, n_bond=9)
    dep = make("spectral", atc.Grid.regular(shape=2).bind(METAL, cell, x), KERNELS["gaussian"], cell, 1, 6)
    r[3, 1] = bad
    with pytest.raises(AtcError, match="not a finite number"):
        dep.add_bond_stress(x, i, r, G)


def test_nothing_added():
    cell = CELLS["orthogonal"]
    dep = make("spectral", atc.Grid.regular(shape=(3, 4, 5)).bind(METAL, cell, np.zeros((1, 3))), KERNELS["gaussian"], cell, 2, 6)
    dep.add_sites(np.zeros((0, 3)), np.zeros((0, 2)))
    assert dep.site_sums().shape == (60, 2) and not dep.site_sums().any()
    assert dep.bond_sums().shape == (60, 6) and not dep.bond_sums().any()


def test_the_integral_is_the_sum_of_the_sources():
    """∫ f dV over the box is Σ a, whatever the tolerance: the mode k = 0 is not truncated."""
    cell, kern = CELLS["triclinic"], KERNELS["gaussian"]
    data = sample(cell, 9)
    sites, _ = both("spectral", (8, 8, 8), atc.kernel("gaussian", width=5.0), cell, data, tolerance=1e-10)
    x, i, r, a, G = data
    # 1e-9: the tolerance, times the field's largest value over the mean.
    assert np.abs(sites.mean(0) * cell.volume - a.sum(0)).max() < 1e-8 * np.abs(a).sum()
    assert kern.radius == 5.0


@pytest.mark.parametrize("name", [k for k in KERNELS if k != "bspline"])
def test_transform_is_the_integral(name):
    """φ̂ against adaptive quadrature of 4π ρ sin(kρ)/k φ(ρ), on both sides of the change from series to recursion."""
    kern = KERNELS[name]
    nodes = [0, 1.2, 2.1, 2.5, 5.0] if name != "gaussian" else [0, 5.0, kern.support]
    for k in (1e-3, 0.3, 1.19, 1.21, 2.5, 20.0):

        def integrand(rho, k=k):
            return 4 * np.pi * rho * np.sin(k * rho) / k * kern.phi(np.array([rho, 0, 0]))

        parts = [quad(integrand, p, q, limit=200, epsabs=1e-13, epsrel=1e-13)[0] for p, q in pairwise(nodes)]
        # 1e-11: what quad promises for integrands of about 100.
        assert abs(fourier.phi_hat(kern, np.array([0.6 * k, 0, 0.8 * k])) - sum(parts)) < 1e-11


def test_transform_of_the_spline():
    kern = KERNELS["bspline"]
    k = np.array([0.7, -1.3, 2.1])
    factors = [quad(lambda v, c=c: 2 * np.cos(c * v) * kern.phi(np.array([v, 0, 0])), 0, 5, points=[2.5], epsabs=1e-14)[0] for c in k]
    assert abs(fourier.phi_hat(kern, k) - np.prod(factors) / kern.peak**2) < 1e-12


@pytest.mark.parametrize("width, shape", [(3, 6.0), (6, 14.0), (9, 23.0), (12, 36.0)])
def test_window(width, shape):
    f = np.array([0.0, 0.1, 0.37, 1.2, 2.9])
    want = [
        quad(lambda x, q=q: 2 * np.cos(2 * np.pi * q * x) * fourier.window(x, width, shape), 0, 0.5 * width, limit=200, epsabs=1e-13)[0]
        for q in f
    ]
    assert np.abs(fourier.window_hat(f, width, shape) - want).max() < 1e-12
    c = fourier.window_polynomials(width, shape, 1e-9)
    x = np.linspace(0, 1, 7)[:, None]
    got = np.polynomial.polynomial.polyval(x, c[:, :width][:, None], tensor=False)
    assert np.abs(got - fourier.window(x + np.arange(width) - 0.5 * width, width, shape)).max() < 2e-9


@pytest.mark.parametrize(
    "kern, tolerance, grid, cell, says",
    [
        (atc.kernel("box", 3.0), 1e-3, atc.Grid.regular(shape=3), CELLS["orthogonal"], "box"),
        (KERNELS["step"], 1e-3, atc.Grid.regular(shape=3), CELLS["orthogonal"], "step"),
        (KERNELS["quartic"], 1e-9, atc.Grid.regular(shape=3), CELLS["orthogonal"], "quartic"),
        (atc.kernel("gaussian", 0.01), 1e-5, atc.Grid.regular(shape=3), CELLS["orthogonal"], "mesh of"),
        (KERNELS["gaussian"], 1e-5, atc.Grid.slab("z", 4), CELLS["orthogonal"], "slab"),
        (KERNELS["gaussian"], 1e-5, atc.Grid.regular(shape=3), Cell([12.0, 13, 14], periodic=(True, True, False)), "periodic"),
    ],
)
def test_what_it_cannot_do_says_so(kern, tolerance, grid, cell, says):
    bound = grid.bind(METAL, cell, np.random.default_rng(0).random((5, 3)) * 10)
    with pytest.raises(AtcError, match=says) as e:
        make("spectral", bound, kern, cell, 1, 6, tolerance=tolerance)
    assert "direct" in str(e.value) and "\n" not in str(e.value)
