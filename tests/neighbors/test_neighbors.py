"""The cell list against ASE and vesin, pair for pair, on the cells where neighbour lists go wrong."""

import numpy as np
import pytest
from ase.neighborlist import primitive_neighbor_list
from hypothesis import given, settings
from hypothesis import strategies as st

from atc.errors import AtcError
from atc.frame import Cell
from atc.neighbors.cell_list import neighbor_list, sorted_by_bin

CELLS = {
    "orthogonal": np.diag([10.0, 12.0, 9.0]),
    "strongly tilted": np.array([[10.0, 0, 0], [9, 10, 0], [-7, 8, 10]]),
    "tiny": np.array([[2.0, 0, 0], [0.3, 2, 0], [0.1, 0.2, 2.5]]),
    "needle": np.array([[2.0, 0, 0], [0.3, 2, 0], [0.1, 0.2, 30]]),
    "left-handed and rotated": -np.array([[3.0, 1, 0], [0, 9, 2], [4, 1, 8]]),
}
PERIODIC = [(1, 1, 1), (1, 0, 1), (0, 0, 1), (0, 0, 0)]


def as_set(i, j, S):
    return sorted(map(tuple, np.c_[i, j, S].tolist()))


def check(x, cell, cutoff, tolerance=1e-9):
    full = neighbor_list(x, cell, cutoff, half=False)
    half = neighbor_list(x, cell, cutoff)
    i, j, S = primitive_neighbor_list("ijS", list(cell.periodic), cell.vectors, x, cutoff, self_interaction=False)
    # ASE: D = x_j − x_i + S·cell, so that r = x_i − x_j − S·cell.
    assert as_set(full[0], full[1], full[3]) == as_set(i, j, S)
    both = as_set(np.r_[half[0], half[1]], np.r_[half[1], half[0]], np.r_[half[3], -half[3]])
    assert both == as_set(i, j, S)
    for i, j, r, S in (full, half):
        expected = x[i] - x[j] - S @ cell.vectors
        assert np.abs(r - expected).max(initial=0) <= tolerance
        assert (np.linalg.norm(r, axis=1) < cutoff).all()
    return len(half[0])


@pytest.mark.parametrize("name", CELLS)
@pytest.mark.parametrize("periodic", PERIODIC)
@pytest.mark.parametrize("n", [1, 2, 60])
@pytest.mark.parametrize("cutoff", [2.3, 7.1])
def test_equals_ase(name, periodic, n, cutoff):
    rng = np.random.default_rng(n)
    v = CELLS[name]
    # Positions far outside the cell, too.
    x = rng.uniform(-2, 3, (n, 3)) @ v
    found = check(x, Cell(v, [1, -2, 3], periodic), cutoff)
    if all(periodic) and name == "tiny":  # one atom has its own images
        assert found > 0


def test_equals_vesin_for_many_atoms():
    import vesin

    rng = np.random.default_rng(3)
    v = np.array([[30.0, 0, 0], [8, 28, 0], [-9, 3, 33]])
    x = rng.uniform(0, 1, (4000, 3)) @ v
    i, j, r, S = neighbor_list(x, Cell(v), 4.5, threads=2)
    vi, vj, vS, vD = vesin.NeighborList(cutoff=4.5, full_list=True).compute(
        points=x, box=v, periodic=True, quantities="ijSD"
    )
    both = as_set(np.r_[i, j], np.r_[j, i], np.r_[S, -S])
    assert both == as_set(vi, vj, vS)
    assert len(vi) == 2 * len(i) > 50_000


def test_equals_matscipy_for_a_slab():
    from matscipy.neighbours import neighbour_list

    rng = np.random.default_rng(4)
    v = np.array([[15.0, 0, 0], [4, 14, 0], [0, 0, 40]])
    x = rng.uniform(0, 1, (700, 3)) @ v
    i, j, _, S = neighbor_list(x, Cell(v, periodic=(1, 1, 0)), 5.0)
    mi, mj, mS = neighbour_list("ijS", cutoff=5.0, positions=x, cell=v, pbc=[True, True, False])
    assert as_set(np.r_[i, j], np.r_[j, i], np.r_[S, -S]) == as_set(mi, mj, mS)


def test_far_origin_keeps_its_digits():
    rng = np.random.default_rng(5)
    # Multiples of 2^-20, so that moving by 1e6 is exact in the input.
    x = np.rint(rng.uniform(0, 12, (100, 3)) * 2**20) / 2**20
    near = neighbor_list(x, Cell(np.eye(3) * 12.0), 4.0)
    far = neighbor_list(x + 2.0**20, Cell(np.eye(3) * 12.0, [2.0**20] * 3), 4.0)
    assert np.array_equal(near[2], far[2])


def test_nearly_empty_box_costs_no_memory():
    x = np.array([[0.5, 0.5, 0.5], [9999.9, 9999.9, 9999.9]])
    i, _, r, S = neighbor_list(x, Cell(np.eye(3) * 1e4), 2.0)
    assert len(i) == 1 and abs(np.linalg.norm(r[0]) - 0.6 * 3**0.5) < 1e-9 and abs(S[0]).tolist() == [1, 1, 1]


@pytest.mark.parametrize("far", [1e12, 1e40, 1e150])
def test_atoms_that_have_flown_away_do_no_harm(far):
    """What is left of a run that blows up: bins by the axis do not even fit into integers."""
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [far, -far, far], [0.0, 1.5, 0]])
    i, j, _, _ = neighbor_list(x, Cell([5.0, 5, 5], periodic=False), 1.6)
    assert sorted(map(tuple, np.sort(np.c_[i, j], axis=1).tolist())) == [(0, 1), (0, 3)]


def test_neighbours_of_some_atoms_only():
    """`CellList.full` for some atoms only: the rows of these, no others."""
    from atc.neighbors.cell_list import CellList, Workspace

    rng = np.random.default_rng(8)
    x = rng.uniform(0, 30, (3000, 3))
    cl = CellList(x, Cell([30.0, 30, 30], periodic=(True, False, True)), 2.5)
    only = rng.random(3000) < 0.1
    ws = Workspace()
    pairs = {False: [], True: []}
    for some in pairs:
        for chunk in range(cl.n_chunks):
            m = cl.full(chunk, ws, only if some else None)
            pairs[some] += list(zip(ws.i[:m].tolist(), ws.j[:m].tolist(), ws.d2[:m].tolist(), strict=True))
    assert sorted(pairs[True]) == sorted(p for p in pairs[False] if only[p[0]]) and len(pairs[True]) > 1000


def test_no_atoms():
    assert len(neighbor_list(np.zeros((0, 3)), Cell(np.eye(3)), 1.0)[0]) == 0


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.nan, np.inf])
def test_bad_cutoff(cutoff):
    with pytest.raises(AtcError, match="cutoff"):
        neighbor_list(np.zeros((1, 3)), Cell(np.eye(3)), cutoff)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.5, 9.0),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
    st.integers(1, 25),
)
def test_any_cell(seed, cutoff, periodic, n):
    rng = np.random.default_rng(seed)
    v = rng.normal(0, 4, (3, 3))
    # A nearly flat cell is a good case, but its pairs and, for the oracle, its images within 3 Å can be 1e8, which once
    # filled the memory: a cell that is too thin is made larger in its own shape, and the cutoff is bounded by the
    # number of pairs and of images.
    heights = abs(np.linalg.det(v)) / np.linalg.norm(np.cross(v[[1, 2, 0]], v[[2, 0, 1]]), axis=1)
    grown = max(1.0, 0.3 / float(heights.min()))
    v, thickness = v * grown, float(heights.min()) * grown
    cutoff = min(cutoff, float(np.cbrt(5e4 * abs(np.linalg.det(v)) / (n * n * 4.19))), 20.0 * thickness)
    check(rng.uniform(-1, 2, (n, 3)) @ v, Cell(v, rng.normal(0, 5, 3), periodic), cutoff)


def test_a_cell_without_thickness_is_refused():
    """Three vectors all but in one plane: 1e7 images within the cutoff are a mistake in the cell, not a crystal."""
    v = np.array([[4.0, 1.0, 0.0], [-1.0, 5.0, 0.0], [3.3, 4.5, 0.002]])
    with pytest.raises(AtcError, match="nearly flat"):
        neighbor_list(np.zeros((1, 3)), Cell(v), 9.7)


@pytest.mark.parametrize("many", [1, 300, 1 << 16, 70_000, 1 << 20])
def test_sorted_by_bin(many):
    """Against one stable sort, also where bins have more numbers than sixteen bits."""
    bins = np.random.default_rng(many).integers(0, many, 5000)
    bins[:2] = many - 1
    order, start = sorted_by_bin(bins, many)
    assert (order == np.argsort(bins, kind="stable")).all()
    assert (start == np.searchsorted(bins[order], np.arange(many + 1))).all()
