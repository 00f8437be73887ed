"""The spectral deposit against the exact one."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import fsum

import numpy as np
import pytest
from scipy.integrate import quad

import atc
from atc.deposit import fourier, make
from atc.deposit.gradient import gather
from atc.errors import AtcError
from atc.frame import Cell
from atc.neighbors.cell_list import neighbor_list
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
    want, got = (
        both(m, shape, kern, cell, data, at=at, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": 1e-9}))
    )
    # One point may lie where the field is small.
    for g, w in zip(got, want):
        close(g, w, 1e-8)


def test_coarse_grid_is_a_subset_of_a_fine_one():
    cell, data = CELLS["triclinic"], sample(CELLS["triclinic"], 4)
    # The same modes: only rounding differs, that of single precision at the first.
    for name, tolerance, rounding in (("lucy", 1e-3, 1e-6), ("gaussian", 1e-8, 1e-12)):
        fine, coarse = (
            both("spectral", s, KERNELS[name], cell, data, at="corners", tolerance=tolerance)
            for s in ((12, 15, 8), (4, 5, 2))
        )
        for f, c in zip(fine, coarse):
            close(c.reshape(4, 5, 2, -1), f.reshape(12, 15, 8, -1)[::3, ::3, ::4], rounding)


@pytest.mark.parametrize(
    "name, radius, tolerance",
    [("gaussian", 40.0, 1e-8), ("lucy", 30.0, 1e-6), ("bspline", 25.0, 1e-5), ("quartic", 30.0, 1e-4)],
)
def test_kernel_wider_than_the_box(name, radius, tolerance):
    cell, kern = Cell([[6.0, 0, 0], [1.0, 5.0, 0], [0, -2.0, 7.0]]), atc.kernel(name, radius)
    data = sample(cell, 5, n=20, n_bond=40)
    want, got = (
        both(m, (3, 4, 2), kern, cell, data, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": tolerance}))
    )
    for g, w in zip(got, want):
        close(g, w, tolerance)


def test_box_and_origin_of_any_size():
    """A flat cell much smaller than the kernel along one axis, 1e6 Å from the origin."""
    cell, kern = Cell([30.0, 1.5, 9.0], [1e6, -1e6, 0.0]), atc.kernel("gaussian", width=1.0)
    data = sample(cell, 6)
    want, got = (
        both(m, (20, 3, 8), kern, cell, data, **kw) for m, kw in (("direct", {}), ("spectral", {"tolerance": 1e-6}))
    )
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
    # The sites are the same points in another order; how well a bond is integrated depends on the others of its piece.
    close(dep.site_sums(), want[0], 1e-13)
    close(dep.bond_sums(), want[1], 1e-6)
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
    dep = make(
        "spectral",
        atc.Grid.regular(shape=(3, 4, 5)).bind(METAL, cell, np.zeros((1, 3))),
        KERNELS["gaussian"],
        cell,
        2,
        6,
    )
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
        assert abs(kern.hat(np.array([0.6 * k, 0, 0.8 * k])) - sum(parts)) < 1e-11


def test_transform_of_the_spline():
    kern = KERNELS["bspline"]
    k = np.array([0.7, -1.3, 2.1])
    factors = [
        quad(lambda v, c=c: 2 * np.cos(c * v) * kern.phi(np.array([v, 0, 0])), 0, 5, points=[2.5], epsabs=1e-14)[0]
        for c in k
    ]
    assert abs(kern.hat(k) - np.prod(factors) / kern.peak**2) < 1e-12


@pytest.mark.parametrize("width, shape", [(3, 6.0), (6, 14.0), (9, 23.0), (12, 36.0)])
def test_window(width, shape):
    f = np.array([0.0, 0.1, 0.37, 1.2, 2.9])
    want = [
        quad(
            lambda x, q=q: 2 * np.cos(2 * np.pi * q * x) * fourier.window(x, width, shape),
            0,
            0.5 * width,
            limit=200,
            epsabs=1e-13,
        )[0]
        for q in f
    ]
    assert np.abs(fourier.window_hat(f, width, shape) - want).max() < 1e-12
    c = fourier.window_polynomials(width, shape, 1e-9)
    x = np.linspace(0, 1, 7)[:, None]
    got = np.polynomial.polynomial.polyval(x, c[:, :width][:, None], tensor=False)
    assert np.abs(got - fourier.window(x + np.arange(width) - 0.5 * width, width, shape)).max() < 2e-9


# --- any grid, any boundary
def compare(grid, kern, cell, data, tolerance, threads=1):
    """Spectral against direct sums on any grid, relative to the largest value on it or at an atom; the deposit."""
    x, i, r, a, G = data
    sums = []
    for method, at in (("direct", atc.Grid.atoms()), ("direct", grid), ("spectral", grid)):
        dep = make(method, at.bind(METAL, cell, x), kern, cell, a.shape[1], 6, threads, tolerance=tolerance)
        dep.add_sites(x, a)
        dep.add_bond_stress(x, i, r, G)
        sums.append((dep.site_sums(), dep.bond_sums()))
    for somewhere, want, got in zip(*sums):
        largest = max(np.abs(want).max(), np.abs(somewhere).max())
        assert got.shape == want.shape and largest > 0
        assert np.abs(got - want).max() <= tolerance * largest
    return dep


GRIDS = {
    "region": atc.Grid.regular([5.0, 4.0, 9.0], shape=(4, 3, 5), origin=[3.0, 1.0, 2.0]),
    "tilted region": atc.Grid.regular([[5.0, 1, 0], [0, 4, 2], [0, 1, 9]], shape=(4, 3, 5), origin=[-20.0, 1.0, 2.0]),
    "corners": atc.Grid.regular(shape=(6, 5, 4), at="corners"),
    "plane": atc.Grid.plane(axis="y", position=3.0, shape=(7, 5)),
    "tilted plane": atc.Grid.plane([1.0, 2, 3], [5.0, 1, 0], [0, 2.0, 7], shape=(7, 5)),
    "line": atc.Grid.line([1.0, 2, 3], [1.0, 2, 14.0], 9),
    "tilted line": atc.Grid.line([1.0, 2, 3], [7.0, -2, 14.0], 9),
    "points": atc.Grid.points(np.random.default_rng(2).normal(size=(40, 3)) * 15),
    "atoms": atc.Grid.atoms(),
}
BOUNDARIES = {
    "periodic": (True, True, True),
    "film": (True, True, False),
    "wire": (False, False, True),
    "cluster": (False, False, False),
}


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("grid", GRIDS)
def test_any_grid(grid, boundary):
    """All kinds of grid in a tilted cell with all kinds of boundary, in double and single precision."""
    v = CELLS["triclinic"]
    cell = Cell(v.vectors, v.origin, BOUNDARIES[boundary])
    data = sample(cell, 11)
    for tolerance in (1e-3, 1e-6):
        compare(GRIDS[grid], atc.kernel("gaussian", width=1.4), cell, data, tolerance, threads=2)
    compare(GRIDS[grid], KERNELS["lucy"], cell, data, 3e-3)


@pytest.mark.parametrize("name, tolerance", [("gaussian", 1e-9), ("lucy", 1e-3), ("bspline", 1e-3), ("quartic", 3e-3)])
def test_open_cell_wider_and_narrower_than_the_kernel(name, tolerance):
    for edge in (3.0, 40.0):
        cell = Cell([edge, 9.0, 11.0], [-4.0, 0.0, 1e3], periodic=(False, True, False))
        compare(atc.Grid.regular(shape=(9, 4, 6)), KERNELS[name], cell, sample(cell, 12), tolerance)


def test_empty_space_costs_nothing():
    """A wire along z in a cell a hundred times as wide: the mesh is as large as without the empty space, and the sums
    are right."""
    rng = np.random.default_rng(3)
    x = np.c_[rng.random((200, 2)) * 6 + 400, rng.random(200) * 20]
    i, r, G = rng.integers(0, 200, 500), rng.normal(size=(500, 3)), rng.normal(size=500)
    data = x, i, r, rng.normal(size=(200, 2)), G
    meshes = []
    for edge, origin in ((30.0, 390.0), (1000.0, 0.0), (1e6, -3e5)):
        cell = Cell([edge, edge, 20.0], [origin, origin, 0.0], periodic=(False, False, True))
        line = atc.Grid.line([395.0, 403, 3], [412.0, 403, 3], 50)
        meshes.append(compare(line, KERNELS["gaussian"], cell, data, 1e-6).mesh)
        dep = make(
            "spectral", atc.Grid.regular(shape=(64, 64, 4)).bind(METAL, cell, x), KERNELS["gaussian"], cell, 2, 6
        )
        dep.add_sites(x, data[3])
        assert dep.mesh.prod() < 3e5
    assert (meshes[0] == meshes[1]).all() and (meshes[0] == meshes[2]).all()


def test_mesh_grows_with_what_is_added():
    """Pieces that lie farther and farther out, on open axes; what the grid cannot see is left out."""
    cell = Cell([100.0, 10.0, 100.0], periodic=(False, True, False))
    rng = np.random.default_rng(4)
    bound = atc.Grid.regular(shape=(40, 3, 30)).bind(METAL, cell, np.zeros((1, 3)))
    for tolerance in (1e-3, 1e-6):
        deps = [make(m, bound, KERNELS["gaussian"], cell, 1, 1, tolerance=tolerance) for m in ("direct", "spectral")]
        for centre in (50, 30, 80, -500, 95, 5, 1e12):
            x = rng.random((30, 3)) * 10 + [centre, 0, centre]
            r, a, b = rng.normal(size=(30, 3)) * 4, rng.normal(size=(30, 1)), rng.normal(size=(30, 1))
            for dep in deps:
                dep.add_sites(x, a)
                dep.add_bonds(x, r, b)
        close(deps[1].site_sums(), deps[0].site_sums(), tolerance)
        close(deps[1].bond_sums(), deps[0].bond_sums(), tolerance)


def test_nothing_in_sight():
    cell = Cell([20.0] * 3, periodic=(False, False, False))
    dep = make(
        "spectral", atc.Grid.regular(shape=4).bind(METAL, cell, np.zeros((1, 3))), KERNELS["gaussian"], cell, 1, 6
    )
    dep.add_sites(np.full((3, 3), 1e5), np.ones((3, 1)))
    assert not dep.site_sums().any()


# --- gradients
@pytest.mark.parametrize("boundary", ["periodic", "film"])
@pytest.mark.parametrize("grid", ["corners", "tilted plane", "region"])
def test_gradients(grid, boundary):
    """Against the closed form, by gathering."""
    v = CELLS["triclinic"]
    cell = Cell(v.vectors, v.origin, BOUNDARIES[boundary])
    x, _, _, a, _ = sample(cell, 13)
    bound = GRIDS[grid].bind(METAL, cell, x)
    for name, tolerance in (
        ("gaussian", 1e-2),
        ("gaussian", 1e-4),
        ("gaussian", 1e-7),
        ("lucy", 1e-2),
        ("quartic", 2e-2),
        ("bspline", 1e-2),
    ):
        values, gradients = gather(bound, KERNELS[name], cell, x, a)
        dep = make("spectral", bound, KERNELS[name], cell, 3, 0, tolerance=tolerance, gradients=True)
        dep.add_sites(x, a)
        close(dep.site_sums(), values, tolerance)
        close(dep.site_gradients(), gradients, tolerance)


def test_divergence_of_a_bond_is_the_difference_of_its_ends():
    """∂_µ(r^µ β) = φ_k − φ_j: what makes the stress fulfil the balance of momentum."""
    cell, kern = CELLS["triclinic"], KERNELS["gaussian"]
    x, i, r, _, G = sample(cell, 14)
    bound = atc.Grid.regular(shape=(6, 5, 7)).bind(METAL, cell, x)
    dep = make("spectral", bound, kern, cell, 1, 3, tolerance=1e-7, gradients=True)
    dep.add_bonds(x[i], r, G[:, None] * r)
    dep.add_sites(x[i], G[:, None])
    dep.add_sites(x[i] - r, -G[:, None])
    divergence = np.einsum("gcc->g", dep.bond_gradients())
    # 1e-6: the tolerance, and the field of differences is smaller than that of its parts.
    close(-divergence, dep.site_sums()[:, 0], 1e-6)


def test_gradients_need_a_smooth_kernel_or_another_method():
    cell = CELLS["orthogonal"]
    bound = atc.Grid.regular(shape=3).bind(METAL, cell, np.zeros((1, 3)))
    with pytest.raises(AtcError, match="gradients"):
        make("direct", bound, KERNELS["gaussian"], cell, 1, 0, gradients=True)
    with pytest.raises(AtcError, match="linear"):
        make("spectral", bound, KERNELS["linear"], cell, 1, 0, tolerance=1e-4, gradients=True)


# --- hard cases
def test_many_frames_on_one_mesh():
    """1e4 small frames added one after the other, finished once: against the compensated sum of what each gives."""
    cell, kern = Cell([9.0, 10.0, 8.0]), KERNELS["gaussian"]
    rng = np.random.default_rng(5)
    frames = 10_000
    bound = atc.Grid.regular(shape=(3, 4, 2)).bind(METAL, cell, np.zeros((1, 3)))
    n = 3
    x = rng.random((frames, n, 3)) * 10
    a = 1.0 + rng.random((frames, n, 1))
    b = 1.0 + rng.random((frames, n, 1))
    r = rng.normal(size=(frames, n, 3))
    for tolerance in (1e-3, 1e-5, 1e-9):
        dep = make("spectral", bound, kern, cell, 1, 1, tolerance=tolerance)
        for k in range(frames):
            dep.add_sites(x[k], a[k])
            dep.add_bonds(x[k], r[k], b[k])
        got = dep.site_sums(), dep.bond_sums()
        if tolerance == 1e-3:
            want = []
            for rr, values in ((np.zeros_like(r), a), (r, b)):
                exact = [make("direct", bound, kern, cell, 0, 1) for _ in range(200)]
                for k, d in enumerate(exact):
                    part = slice(k * frames // 200, (k + 1) * frames // 200)
                    d.add_bonds(x[part].reshape(-1, 3), rr[part].reshape(-1, 3), values[part].reshape(-1, 1))
                parts = np.stack([d.bond_sums() for d in exact])
                want.append(np.array([fsum(parts[:, g, 0]) for g in range(parts.shape[1])])[:, None])
        for g, w in zip(got, want):
            # Small frames: the tolerance holds for each of them, errors of many average.
            close(g, w, tolerance)


@pytest.mark.parametrize("spread_of_strengths", [1e3, 1e30, 1e-30])
def test_strengths_of_any_size(spread_of_strengths):
    """Two atoms nearly on each other give a bond 1e30 times as strong; all of them weak. Single precision holds neither
    without a scale."""
    cell, kern = CELLS["triclinic"], KERNELS["gaussian"]
    x, i, r, a, G = sample(cell, 15)
    G[5:] *= 1e-3
    G[:5] *= spread_of_strengths
    compare(atc.Grid.regular(shape=6), kern, cell, (x, i, r, a, G), 1e-4)
    compare(atc.Grid.regular(shape=6), kern, cell, (x, i, r, a * 1e-300, G * 1e-35), 1e-4)
    # Piece after piece, each far stronger than the last one.
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, x)
    dep, exact = (make(m, bound, kern, cell, 0, 6, tolerance=1e-4) for m in ("spectral", "direct"))
    for k in range(12):
        part = slice(50 * k, 50 * (k + 1))
        for d in (dep, exact):
            d.add_bond_stress(x, i[part], r[part], G[part] * 1e4**k)
    close(dep.bond_sums(), exact.bond_sums(), 1e-4)


@pytest.mark.parametrize("shape", [(40, 2, 3), (3, 3, 3), (1, 1, 64)])
def test_grids_coarser_than_the_kernel_and_anisotropic(shape):
    cell = Cell([60.0, 58.0, 62.0])
    for name, tolerance in (("gaussian", 1e-6), ("lucy", 1e-3)):
        compare(
            atc.Grid.regular(shape=shape, at="corners"), KERNELS[name], cell, sample(cell, 16, 2000, 4000), tolerance
        )


def test_crystal_without_stress():
    """A field that cancels: the error is relative to the same sum of |b|."""
    a = 5.3
    base = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]) * a
    cells = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = (base + cells * a).reshape(-1, 3)
    cell = Cell([3 * a] * 3)
    i, _, r, _ = neighbor_list(x, cell, 1.1 * a)
    d = np.linalg.norm(r, axis=1)
    near = d < 0.9 * a
    # First and second shell in balance: Σ G r r = 0.
    G = np.where(near, 1.0, -np.sum(r[near] ** 2) / np.sum(r[~near] ** 2))
    bound = atc.Grid.regular(shape=9).bind(METAL, cell, x)
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        sums = []
        for method, factor in (("spectral", G), ("direct", G), ("direct", np.abs(G))):
            dep = make(method, bound, KERNELS["gaussian"], cell, 0, 6, tolerance=tolerance)
            dep.add_bond_stress(x, i, r, factor)
            sums.append(dep.bond_sums())
        assert np.abs(sums[0] - sums[1]).max() <= tolerance * np.abs(sums[2]).max()


def test_cheap_to_ask_what_it_would_do():
    """Parameters, mesh and modes without a buffer or a compilation: for the planner."""
    cell = Cell([300.0] * 3)
    bound = atc.Grid.regular(shape=64).bind(METAL, cell, np.zeros((1, 3)))
    dep = make("spectral", bound, KERNELS["gaussian"], cell, 1, 6, tolerance=1e-5)
    assert dep.mesh.shape == (3,) and (dep.modes < dep.mesh / 2).all() and dep.parameters.width >= 3
    assert not dep._meshes and not {"rules", "longest", "window"} & {*vars(dep), *vars(dep.bond_points)}


@pytest.mark.parametrize(
    "kern, tolerance, grid, cell, says",
    [
        (atc.kernel("box", 3.0), 1e-3, atc.Grid.regular(shape=3), CELLS["orthogonal"], "box"),
        (KERNELS["step"], 1e-3, atc.Grid.regular(shape=3), CELLS["orthogonal"], "step"),
        (KERNELS["quartic"], 1e-9, atc.Grid.regular(shape=3), CELLS["orthogonal"], "quartic"),
        (atc.kernel("gaussian", 0.01), 1e-5, atc.Grid.regular(shape=3), CELLS["orthogonal"], "mesh of"),
        (KERNELS["gaussian"], 1e-5, atc.Grid.slab("z", 4), CELLS["orthogonal"], "slab"),
    ],
)
def test_what_it_cannot_do_says_so(kern, tolerance, grid, cell, says):
    bound = grid.bind(METAL, cell, np.random.default_rng(0).random((5, 3)) * 10)
    with pytest.raises(AtcError, match=says) as e:
        make("spectral", bound, kern, cell, 1, 6, tolerance=tolerance)
    assert "direct" in str(e.value) and "\n" not in str(e.value)


@pytest.mark.parametrize("name", ["lucy", "hardy", "piecewise-linear"])
def test_table_of_the_transform(name):
    """Every mode's factor, tabulated, against φ̂ itself; cell tilted, so that the largest |k| is at one corner only."""
    kern, cell = KERNELS[name], CELLS["triclinic"]
    dep = make(
        "spectral", atc.Grid.regular(shape=3).bind(METAL, cell, np.zeros((1, 3))), kern, cell, 1, 0, tolerance=1e-2
    )
    dep.add_sites(np.zeros((1, 3)), np.ones((1, 1)))
    modes = dep._transformed("site", dep._groups(1)[0])[0]
    k_c = np.stack([modes.wave_vector(c) for c in range(3)], -1)
    w0, w1, w2 = np.ix_(*[modes.window_hat(a) for a in range(3)])
    want = kern.hat(k_c) / cell.volume
    assert np.abs(modes.response() * w0 * w1 * w2 - want).max() < 1e-9 / cell.volume
