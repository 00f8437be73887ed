"""Bonds gathered at their atoms as moments (`atc.deposit.moments`), against the exact sum."""

import warnings
from math import prod

import numpy as np
import pytest

import atc
from atc.deposit import make, moments
from atc.deposit.collapse import spectral_deposit
from atc.errors import AtcError, AtcWarning
from atc.estimators.methods import Method
from atc.frame import Cell
from atc.neighbors.cell_list import neighbor_list
from atc.plan import Request, plan, prepare
from atc.planning.calibrate import argon
from atc.planning.costs import Costs
from atc.planning.method_choice import SpectralWays
from atc.units import units

METAL = units("metal")
TILTED = Cell([[12, 0, 0], [5.1, 11, 0], [-3, 4.5, 13]], [1.0, -2.0, 0.5])
CELLS = {
    "orthogonal": Cell([12.0, 13.0, 14.0], [1.0, -2.0, 0.5]),
    "triclinic": TILTED,
    "left-handed": Cell(np.array([[0, 12, 1.0], [11, 0.5, 0], [1.0, 0, 13]])),
    "film": Cell(TILTED.vectors, TILTED.origin, (True, True, False)),
    "wire": Cell(TILTED.vectors, TILTED.origin, (False, False, True)),
    "cluster": Cell(TILTED.vectors, TILTED.origin, (False, False, False)),
}


def sample(cell, seed=0, n=150, cutoff=3.5):
    """Atoms in the cell and, along periodic axes, outside; all pairs within the cutoff, and a few bonds of other
    kinds."""
    rng = np.random.default_rng(seed)
    x = cell.cartesian(rng.random((n, 3)))
    i, j, r, _ = neighbor_list(x, cell, cutoff)
    x = x + np.where(cell.periodic, rng.integers(-2, 3, (n, 3)), 0) @ cell.vectors
    if cell.periodic.all():
        # An atom and its own image, far away; a bond around the cell.
        i, j, r = np.r_[i, 3, 5], np.r_[j, 3, 5], np.r_[r, cell.vectors[:1], cell.vectors[1:2] - cell.vectors[:1]]
    return x, i.astype(np.int32), j.astype(np.int32), r, rng.normal(size=len(i))


def deposit(bound, kern, cell, tolerance, order, data, threads=1):
    x, i, j, r, G = data
    d = spectral_deposit(bound, kern, cell, 1, 6, threads, tolerance, order=order)
    for t in range(threads):
        d.add_bond_stress(x, i[t::threads], r[t::threads], G[t::threads], thread=t, j_b=j[t::threads])
    return d


def exact(bound, kern, cell, data):
    x, i, _, r, G = data
    d = make("direct", bound, kern, cell, 0, 6)
    d.add_bond_stress(x, i, r, G)
    return d.bond_sums()


def collapsed(d) -> bool:
    """Whether atoms carry anything."""
    return any(rows is not None and len(rows.touched()) for rows in getattr(d, "_rows", ()))


def close(got, want, tolerance):
    assert got.shape == want.shape
    assert np.abs(got - want).max() <= tolerance * np.abs(want).max()


# --- the rule
@pytest.mark.parametrize("order", [0, *moments.ORDERS])
def test_rule_is_exact_for_polynomials(order):
    c = moments.coefficients(order)
    for n in range(2 * order + 2):
        got = 0.0
        for p in range(min(order, n) + 1):
            falling = prod(range(n - p + 1, n + 1))
            got += c[p] * falling * ((n == p) + (-1.0) ** p)
        assert abs(got - 1 / (n + 1)) < 1e-13
    # and not for the next degree
    n = 2 * order + 2
    got = sum(c[p] * prod(range(n - p + 1, n + 1)) * (-1.0) ** p for p in range(order + 1))
    assert abs(got - 1 / (n + 1)) > 1e-12


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("order", moments.ORDERS)
def test_what_atoms_carry(order, real):
    """Every monomial of two bonds at both ends, by definition."""
    rng = np.random.default_rng(order)
    layout = moments.Layout(order, real)
    assert len(layout.columns) == moments.count(order) == sum((n + 1) * (n + 2) // 2 for n in range(2, order + 3))
    x, r, G = rng.normal(size=(3, 3)), rng.normal(size=(2, 3)), rng.normal(size=2)
    i, j = np.array([0, 1], np.int32), np.array([1, 2], np.int32)
    rows = moments.Rows(layout, 3)
    rows.scale, rest = 4.0, np.empty(2, np.int64)
    everything = np.full(49, 1e9)
    done = moments.core(order, real)(
        x, i, j, r, G, 0, np.ones(6), 0, everything, 1 / 3.0, 1 / 4.0, rows.rows, rows.places, rest
    )
    assert done == (2, 0) and (rows.positions([0, 1, 2]) == x).all()
    for atom in range(3):
        for c, e in zip(layout.columns, layout.powers):
            n = e.sum()
            want = sum(
                G[b] * np.prod((s * r[b]) ** e) / 3.0 ** (n - 2)
                for b, s, end in ((0, 1, i[0]), (0, -1, j[0]), (1, 1, i[1]), (1, -1, j[1]))
                if end == atom
            )
            assert rows.rows[atom, c] * 4.0 == pytest.approx(want, rel=0, abs=1e-5 if real is np.float32 else 1e-12)


def test_errors_of_bonds_are_those_of_their_modes():
    """The error of one bond, averaged over its directions, mode by mode."""
    kern = atc.kernel("gaussian", 10.0)
    box = Cell([70.0] * 3)
    bound = atc.Grid.regular(shape=4).bind(METAL, box, np.zeros((1, 3)))
    k = 2 * np.pi / 70 * np.stack(np.meshgrid(*[np.arange(-24, 25)] * 3, indexing="ij"), -1).reshape(-1, 3)
    hat = kern.hat(k)
    for order in (1, 2, 3, 4):
        d = spectral_deposit(bound, kern, box, 0, 6, 1, 1e-6, order=order)
        for length in (2.0, 4.0, 7.0):
            z = 1j * length * k[:, 0]
            series = sum(c * (z**p + (-z) ** p * np.exp(z)) for p, c in enumerate(moments.coefficients(order)))
            bond = np.where(z == 0, 1.0, np.expm1(z) / np.where(z == 0, 1.0, z))
            rms = np.sqrt((np.abs((series - bond) * hat) ** 2).sum() / (hat**2).sum())
            worst = np.abs((series - bond) * hat).max()
            # The table has the next length, up to 10 % more: 1.1^(2P + 2).
            assert max(rms, worst) * 0.99 <= d._errors.of(length) <= 1.1 ** (2 * order + 2) * max(rms, worst) + 1e-9


# --- the sums
@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
def test_every_order(cell):
    kern = atc.kernel("gaussian", 9.0)
    data = sample(cell)
    bound = atc.Grid.regular(shape=(6, 5, 7)).bind(METAL, cell, data[0])
    want = exact(bound, kern, cell, data)
    for tolerance, orders in (
        (1e-2, (1, 2)),
        (1e-3, (1, 2, 3)),
        (1e-4, (2, 3)),
        (1e-5, (1, 3, 4)),
        (1e-6, (3, 4)),
        (1e-8, (4, 5)),
        (1e-10, (5,)),
    ):
        for order in orders:
            d = deposit(bound, kern, cell, tolerance, order, data)
            if order >= {1e-2: 1, 1e-3: 2, 1e-4: 2, 1e-5: 2, 1e-6: 3, 1e-8: 4, 1e-10: 5}[tolerance]:
                assert collapsed(d)
            close(d.bond_sums(), want, tolerance)


@pytest.mark.parametrize("name, tolerance, order", [("lucy", 1e-3, 3), ("bspline", 1e-2, 2), ("quartic", 3e-3, 3)])
def test_other_kernels(name, tolerance, order):
    kern = atc.kernel(name, 14.0)
    for cell in (CELLS["triclinic"], CELLS["wire"]):
        data = sample(cell)
        bound = atc.Grid.regular(shape=(6, 5, 7)).bind(METAL, cell, data[0])
        close(deposit(bound, kern, cell, tolerance, order, data).bond_sums(), exact(bound, kern, cell, data), tolerance)


@pytest.mark.parametrize("boundary", ["triclinic", "film", "cluster"])
def test_any_grid(boundary):
    cell, kern = CELLS[boundary], atc.kernel("gaussian", 9.0)
    data = sample(cell, 1)
    # Relative to the largest value anywhere: that of the whole cell.
    everywhere = exact(atc.Grid.regular(shape=6).bind(METAL, cell, data[0]), kern, cell, data)
    for grid in (
        atc.Grid.regular([5.0, 4.0, 9.0], shape=(4, 3, 5), origin=[3.0, 1.0, 2.0]),
        atc.Grid.plane([1.0, 2, 3], [5.0, 1, 0], [0, 2.0, 7], shape=(7, 5)),
        atc.Grid.line([1.0, 2, 3], [7.0, -2, 14.0], 9),
        atc.Grid.points(np.random.default_rng(2).normal(size=(40, 3)) * 15),
        atc.Grid.atoms(),
    ):
        bound = grid.bind(METAL, cell, data[0])
        want = exact(bound, kern, cell, data)
        for tolerance, order in ((1e-3, 2), (1e-6, 4)):
            got = deposit(bound, kern, cell, tolerance, order, data, 2).bond_sums()
            assert np.abs(got - want).max() <= tolerance * max(np.abs(want).max(), np.abs(everywhere).max())


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_threads_and_frames(tolerance):
    """Pieces to any thread; frames one after the other in the same or another array; frames in different threads."""
    cell, kern = CELLS["triclinic"], atc.kernel("gaussian", 9.0)
    frames = [sample(cell, s) for s in range(3)]
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, frames[0][0])
    want = sum(exact(bound, kern, cell, data) for data in frames)
    one = deposit(bound, kern, cell, tolerance, 4, frames[0]).bond_sums()
    three = deposit(bound, kern, cell, tolerance, 4, frames[0], 3).bond_sums()
    close(three, one, 2 * tolerance)
    shared = frames[0][0].copy()
    serial, mixed = (spectral_deposit(bound, kern, cell, 0, 6, 2, tolerance, order=4) for _ in range(2))
    for k, (x, i, j, r, G) in enumerate(frames):
        shared[:] = x
        serial.add_bond_stress(shared, i, r, G, j_b=j)
        mixed.add_bond_stress(x, i, r, G, thread=k % 2, j_b=j)
    close(serial.bond_sums(), want, tolerance)
    close(mixed.bond_sums(), want, tolerance)
    # Asked for once more, and added to after that.
    close(mixed.bond_sums(), want, tolerance)
    x, i, j, r, G = frames[0]
    mixed.add_bond_stress(x, i, r, -G, j_b=j)
    close(mixed.bond_sums(), want - exact(bound, kern, cell, frames[0]), 2 * tolerance)


def test_mesh_grows_and_what_the_grid_cannot_see_is_left_out():
    cell, kern = Cell([60.0, 10.0, 60.0], periodic=(False, True, False)), atc.kernel("gaussian", 9.0)
    rng = np.random.default_rng(4)
    bound = atc.Grid.regular(shape=(20, 3, 15)).bind(METAL, cell, np.zeros((1, 3)))
    for tolerance in (1e-3, 1e-6):
        fast, direct = (
            spectral_deposit(bound, kern, cell, 0, 6, 1, tolerance, order=4),
            make("direct", bound, kern, cell, 0, 6),
        )
        for centre in (30, 20, 55, -500, 70, 1e7):
            x = rng.random((40, 3)) * 8 + [centre, 0, centre]
            i, j = rng.integers(0, 40, (2, 60)).astype(np.int32)
            r, G = x[i] - x[j], rng.normal(size=60)
            fast.add_bond_stress(x, i, r, G, j_b=j)
            direct.add_bond_stress(x, i, r, G)
        close(fast.bond_sums(), direct.bond_sums(), tolerance)


@pytest.mark.parametrize("size", [1e3, 1e12, 1e30, 1e-30])
def test_strengths_of_any_size(size):
    """Some bonds far stronger: they are collapsed only if they are short enough for it. Piece after piece too."""
    cell, kern = CELLS["triclinic"], atc.kernel("gaussian", 9.0)
    x, i, j, r, G = sample(cell, 15)
    G[:40] *= size
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, x)
    for tolerance in (1e-4, 1e-6):
        close(
            deposit(bound, kern, cell, tolerance, 4, (x, i, j, r, G)).bond_sums(),
            exact(bound, kern, cell, (x, i, j, r, G)),
            tolerance,
        )
        d = spectral_deposit(bound, kern, cell, 0, 6, 1, tolerance, order=4)
        for k in range(6):
            part = slice(k * len(i) // 6, (k + 1) * len(i) // 6)
            d.add_bond_stress(x, i[part], r[part], G[part] * 1e4**k, j_b=j[part])
        growing = G * 1e4 ** np.searchsorted(np.arange(1, 6) * len(i) // 6, np.arange(len(i)), side="right")
        close(d.bond_sums(), exact(bound, kern, cell, (x, i, j, r, growing)), tolerance)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_strong_bonds_are_taken_out_again(tolerance):
    """Nothing is left of bonds up to 1e4 times as strong as the others, but the tolerance of those."""
    frame, pot = argon(7)
    bonds = pot.decompose(frame).bonds
    kern, cell = atc.kernel("gaussian", 14.0), frame.cell
    bound = atc.Grid.regular(shape=6).bind(frame.units, cell)
    G = np.clip(bonds.G_b, -np.quantile(np.abs(bonds.G_b), 0.97), None)
    strong = np.argsort(-np.abs(bonds.G_b))[:64]
    G[strong] *= np.geomspace(300, 1e4, 64)
    data = frame.positions, bonds.i, bonds.j, bonds.r_bc, G
    d = deposit(bound, kern, cell, tolerance, 4, data)
    b = np.stack(
        [r[:, p] * r[:, q] for r in [bonds.r_bc[strong]] for p, q in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))],
        1,
    )
    d.add_strong(frame.positions[bonds.i[strong]], bonds.r_bc[strong], -G[strong][:, None] * b)
    others = np.delete(np.arange(len(G)), strong)
    want = exact(bound, kern, cell, tuple(a if a is frame.positions else a[others] for a in data))
    assert collapsed(d)
    close(d.bond_sums(), want, tolerance)


def test_gradients():
    cell, kern = CELLS["triclinic"], atc.kernel("gaussian", 9.0)
    x, i, j, r, G = data = sample(cell, 5)
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, x)
    fine = spectral_deposit(bound, kern, cell, 0, 6, 1, 1e-10, gradients=True)
    fine.add_bond_stress(x, i, r, G)
    for tolerance, order in ((1e-3, 3), (1e-6, 4)):
        d = spectral_deposit(bound, kern, cell, 0, 6, 1, tolerance, gradients=True, order=order)
        d.add_bond_stress(x, i, r, G, j_b=j)
        assert collapsed(d)
        close(d.bond_gradients(), fine.bond_gradients(), tolerance)
        close(d.bond_sums(), exact(bound, kern, cell, data), tolerance)


def test_positions_that_are_no_numbers():
    cell, kern = CELLS["orthogonal"], atc.kernel("gaussian", 9.0)
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, np.zeros((1, 3)))
    for c in range(3):
        for what in (np.nan, np.inf):
            x, i, j, r, G = sample(cell)
            x[i[7], c] = what
            d = spectral_deposit(bound, kern, cell, 0, 6, 1, 1e-4, order=3)
            with pytest.raises(AtcError, match="not a finite number"):
                d.add_bond_stress(x, i, r, G, j_b=j)
    x, i, j, r, G = sample(cell)
    r[3, 1] = np.nan
    with pytest.raises(AtcError, match="not a finite number"):
        spectral_deposit(bound, kern, cell, 0, 6, 1, 1e-4, order=3).add_bond_stress(x, i, r, G, j_b=j)


def test_bonds_without_their_other_ends_become_points():
    cell, kern = CELLS["orthogonal"], atc.kernel("gaussian", 9.0)
    x, i, j, r, G = data = sample(cell)
    bound = atc.Grid.regular(shape=6).bind(METAL, cell, x)
    d = spectral_deposit(bound, kern, cell, 0, 6, 1, 1e-4, order=3)
    d.add_bond_stress(x, i, r, G)
    assert not collapsed(d)
    close(d.bond_sums(), exact(bound, kern, cell, data), 1e-4)
    for bad in (np.full(len(j), len(x)), np.full(len(j), -1)):
        with pytest.raises(ValueError, match="outside"):
            d.add_bond_stress(x, i, r, G, j_b=bad)


# --- the choice
@pytest.fixture
def shipped(monkeypatch):
    monkeypatch.setenv("ATC_COSTS", "shipped")


def test_wide_kernels_choose_moments_and_short_ones_do_not(shipped):
    frame, _ = argon(3)
    cell = Cell([215.0] * 3)
    bound = atc.Grid.regular(shape=64).bind(METAL, cell, frame.positions)
    orders = {}
    for radius in (6.0, 20.0, 30.0):
        for tolerance in (1e-3, 1e-5):
            kern = atc.kernel("gaussian", radius)
            ways = SpectralWays(Costs(), bound, kern, cell, 8.5e6, 6.4, 6, carried=256e3)
            orders[radius, tolerance] = ways.deposit(tolerance).order
    assert orders[6.0, 1e-5] is None
    assert orders[20.0, 1e-5] >= orders[20.0, 1e-3] >= 1 and orders[20.0, 1e-5] >= orders[30.0, 1e-5] >= 1
    # Only where there are atoms to carry them.
    ways = SpectralWays(Costs(), bound, atc.kernel("gaussian", 30.0), cell, 8.5e6, 6.4, 6)
    assert ways.deposit(1e-5).order is None


def test_a_tighter_rung_has_its_own_order():
    m = Method("spectral", 1e-3, "why", (1e-4, 1e-5), order=2, orders=(3, None))
    assert m.tightened(1e-3, 2e-4) == Method("spectral", 1e-4, "why", (1e-5,), order=3, orders=(None,))
    assert m.tightened(1e-3, 2e-5) == Method("spectral", 1e-5, "why", ())
    assert Method.from_plain(m.plain()) == m


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_the_promise_at_every_point(tolerance, shipped):
    """A whole frame, forced and as planned, in tiles, and what the plan says of it."""
    frame, pot = argon(9)
    kern, grid, what = atc.kernel("gaussian", 16.0), atc.Grid.regular(shape=8), ["stress_potential"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        want = atc.fields(frame, pot, kern, grid, what, 1e-12, threads=1).stress_potential.values
        whole, tiled = (
            atc.fields(frame, pot, kern, grid, what, tolerance, method="spectral", threads=2, **more)
            for more in ({}, {"tiles": (2, 1, 1)})
        )
    assert "moments to order" in whole.attrs["method_details"]
    close(whole.stress_potential.values, want, tolerance)
    assert whole.stress_potential.attrs["error_max"] <= tolerance
    close(tiled.stress_potential.values, want, tolerance)
    request = prepare(Request(frame, pot, kern, grid, what, tolerance, method="spectral", threads=1))
    assert request.methods["bond"].order is not None
    assert "moments to order" in str(plan(frame, pot, kern, grid, what, tolerance, method="spectral", threads=1))
