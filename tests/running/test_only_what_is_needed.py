"""Model only what a scene needs, by counting: kernels called, sums made, bins, visits, lists built."""

import numpy as np
import pytest
from test_run import Stop, same, stop_after

import atc
import atc.analysis.heat_currents
import atc.decomposers.many_body.neighbor_work as triplet_module
import atc.deposit
from atc.decomposers.many_body.neighborhood import Neighborhood
from atc.estimators.atom_pass import AtomFactors
from atc.frame import Cell
from atc.neighbors import cell_list as neighbors
from atc.neighbors.verlet import Anchor, KeptList, anchor_of, cell_list
from atc.plan import plan, prepare
from atc.planning.calibrate import argon, silicon

KERN = atc.kernel("quartic", radius=6.0)
GRID = atc.Grid.regular(shape=5)


class Counter:
    """How often something is called, and with what."""

    def __init__(self, patch, owner, name, keep=lambda *a: None):
        self.calls, real = [], getattr(owner, name)

        def counted(*args, **more):
            self.calls.append(keep(*args))
            return real(*args, **more)

        patch.setattr(owner, name, counted)


def test_no_triplet_is_looked_at_for_a_pair_potential(monkeypatch):
    triplets = Counter(monkeypatch, triplet_module, "sw_triplets")
    joined = Counter(monkeypatch, Neighborhood, "join")
    frame, pot = argon(3)
    atc.fields(frame, pot, KERN, GRID, ["stress", "heat_flux"])
    assert not triplets.calls and not joined.calls
    crystal, sw = silicon(2)
    atc.fields(crystal, sw, KERN, GRID, ["stress_potential"])
    assert triplets.calls
    triplets.calls.clear()
    pairs = atc.decomposers.StillingerWeber(
        2.1683, 2.0951, 1.8, 21.0, 1.2, -1 / 3, 7.05, 0.602, 4.0, 0.0, threebody=False
    )
    atc.fields(crystal, atc.potential(pairs, units="metal"), KERN, GRID, ["stress_potential"])
    assert not triplets.calls


def test_no_sum_depends_on_velocities_if_only_the_potential_stress_is_wanted(monkeypatch):
    columns = Counter(monkeypatch, AtomFactors, "columns", lambda self, names: tuple(names))
    made = Counter(monkeypatch, atc.deposit, "make", lambda method, bound, kern, cell, n_site, n_bond: (n_site, n_bond))
    frame, pot = argon(3)
    atc.fields(frame, pot, KERN, GRID, ["stress_potential"])
    assert not columns.calls and all(n_site == 0 for n_site, _ in made.calls)
    atc.fields(frame, pot, KERN, GRID, ["stress"])
    assert columns.calls and any(n_site for n_site, _ in made.calls)


def test_a_virial_makes_no_field(monkeypatch):
    made = Counter(monkeypatch, atc.deposit, "make")
    frame, pot = argon(3)
    atc.fields(frame, pot, None, None, ["virial_stress"])
    assert not made.calls


def nanowire(edge):
    """The same wire along z in boxes of different cross-section."""
    frame, pot = argon(6)
    x = frame.positions
    L = frame.cell.vectors[0, 0]
    keep = ((x[:, :2] - L / 2) ** 2).sum(1) < 9.0**2
    moved = x[keep] + [edge / 2 - L / 2, edge / 2 - L / 2, 0]
    return frame.replace(
        positions=moved, velocities=None, masses=None, types=None, ids=None, cell=Cell([edge, edge, L])
    ), pot


def test_empty_space_costs_nothing(monkeypatch):
    """A wire in boxes of 60 and 600 Å: the same visits; no more bins than a small multiple of the atoms; the same
    predicted work."""
    deposits = []
    real = atc.deposit.make

    def make(method, bound, *rest, **more):
        deposits.append((bound.kind, method, real(method, bound, *rest, **more)))
        return deposits[-1][2]

    monkeypatch.setattr(atc.deposit, "make", make)
    lists = Counter(monkeypatch, neighbors.CellList, "_chunks", lambda self: (int(np.prod(self.n_bins)), self.n))
    seen, planned = [], []
    for edge in (60.0, 600.0):
        frame, pot = nanowire(edge)
        grid = atc.Grid.regular(shape=(int(edge / 3), int(edge / 3), 8))
        for kern in (KERN, atc.kernel("gaussian", radius=6.0)):
            deposits.clear()
            ds = atc.fields(frame, pot, kern, grid, ["stress_potential"], 1e-3, threads=1)
            p = plan(frame, pot, kern, grid, ["stress_potential"], 1e-3, threads=1)
            method = next(m for kind, m, _ in deposits if kind == "regular")
            visits = sum(d.visits for kind, _, d in deposits if kind == "regular" and method == "direct")
            seen.append((edge, kern.name, method, visits))
            planned.append(p.parts["deposit of bonds"])
            assert ds.attrs["measured_error"] <= 1e-3
    small, small_gauss, large, large_gauss = seen
    assert small[2] == large[2] == "direct" and small[3] == large[3] > 0
    assert planned[2] == pytest.approx(planned[0], rel=0.05)
    # The mesh of the spectral method fills the box: where that costs more than the atoms do, it is not taken.
    assert large_gauss[2] == "direct"
    assert all(bins <= max(64, 4 * n) for bins, n in lists.calls)


@pytest.mark.parametrize("system", ["lj", "sw", "sw with others"])
@pytest.mark.parametrize("cell", ["cubic", "tilted", "mixed"])
def test_a_kept_list_has_the_pairs_of_a_new_one(system, cell):
    """Whatever moves by less than half a skin, re-wrapped anywhere: the same pairs, the same vectors, through the same
    images."""
    frame, pot = (argon(3) if system == "lj" else silicon(3))[:2]
    rng = np.random.default_rng(4)
    if cell != "cubic":
        shear = np.array([[1, 0, 0], [0.3, 1, 0], [-0.2, 0.25, 1.0]])
        periodic = (True, cell == "tilted", True)
        frame = frame.replace(
            positions=frame.positions @ shear + 3.0, cell=Cell(frame.cell.vectors @ shear, [3.0] * 3, periodic)
        )
    who = (
        np.sort(rng.choice(len(frame), len(frame) // 2, replace=False)).astype(np.int32)
        if system == "sw with others"
        else None
    )
    skin, cutoff = 1.0, pot.cutoff
    step = rng.normal(size=frame.positions.shape)
    step *= 0.499 * skin * rng.random((len(step), 1)) / np.linalg.norm(step, axis=1, keepdims=True)
    wrap = np.where(frame.cell.periodic, rng.integers(-2, 3, step.shape), 0)
    moved = frame.replace(positions=frame.positions + step + wrap @ frame.cell.vectors)
    anchor = Anchor(frame, skin)
    x = moved.positions if who is None else moved.positions[who]
    with anchor.at(moved):
        kept = cell_list(x, moved.cell, cutoff, who)
    fresh = cell_list(x, moved.cell, cutoff, who)
    assert isinstance(kept, KeptList) and isinstance(fresh, neighbors.CellList)

    def pairs(cells):
        ws, out = neighbors.Workspace(), []
        for c in range(cells.n_chunks):
            n = cells.half(c, ws)
            flip = np.where(ws.i[:n] > ws.j[:n], -1.0, 1.0)
            r = ws.r[:n] * flip[:, None]
            same = ws.i[:n] == ws.j[:n]
            # an atom and its own image: the vector's sign is free
            r[same] *= np.where(r[same] @ [1.0, 1e-3, 1e-6] < 0, -1.0, 1.0)[:, None]
            out.append(np.column_stack([np.minimum(ws.i[:n], ws.j[:n]), np.maximum(ws.i[:n], ws.j[:n]), r]))
        out = np.concatenate(out)
        return out[np.lexsort(np.round(out, 6).T[::-1])]

    a, b = pairs(kept), pairs(fresh)
    assert len(a) == len(b) > 100 and (a[:, :2] == b[:, :2]).all()
    np.testing.assert_allclose(a[:, 2:], b[:, 2:], rtol=0, atol=1e-12)
    # one atom a hair too far, another cell, other atoms: a new list
    far = moved.positions.copy()
    far[0] = frame.positions[0] + [0.51 * skin, 0, 0]
    assert anchor.moved(moved.replace(positions=far)) is None
    assert (
        anchor.moved(moved.replace(cell=Cell(frame.cell.vectors * 1.001, frame.cell.origin, frame.cell.periodic)))
        is None
    )
    assert anchor.moved(moved.replace(ids=moved.ids + 1)) is None


def vibrating(n=6):
    frame, pot = silicon(2)
    rng = np.random.default_rng(1)
    frames = [
        frame.replace(
            positions=frame.positions + rng.normal(0, 0.02, frame.positions.shape), source=f"silicon frame {k}"
        )
        for k in range(n)
    ]
    gone = frames[3].positions.copy()
    gone[5] += 1.0
    frames[3] = frames[3].replace(positions=gone)  # one frame with an atom that has jumped
    return frames, pot


def test_lists_are_built_once_for_frames_that_stay_near(monkeypatch, tmp_path):
    """Six frames, one of which has an atom out of place: the kept list and one new one, and the same fields to
    rounding; bit for bit however computed."""
    frames, pot = vibrating()
    arguments = (frames, pot, KERN, GRID, ["stress", "virial_stress"])
    with monkeypatch.context() as patch:
        patch.setattr("atc.running.run.anchor_of", lambda request: None)
        want = atc.fields(*arguments, threads=1)
    with monkeypatch.context() as patch:
        built = Counter(patch, neighbors.CellList, "_chunks")
        ds = atc.fields(*arguments, threads=1)
        assert len(built.calls) == 2
    np.testing.assert_allclose(ds.stress, want.stress, rtol=0, atol=1e-12 * float(np.abs(want.stress).max()))
    same(ds, atc.fields(*arguments, threads=1, workers=2))
    out = tmp_path / "o.zarr"
    with pytest.raises(Stop):
        atc.fields(*arguments, threads=1, out=out, progress=stop_after(2))
    same(ds, atc.fields(*arguments, threads=1, out=out))


def test_liquids_and_changing_cells_keep_no_list():
    from atc.plan import Request

    frames, pot = vibrating()
    rng = np.random.default_rng(2)
    flowing = [f.replace(positions=f.positions + rng.normal(0, 0.4, f.positions.shape)) for f in frames]
    squeezed = [f.replace(cell=f.cell.scaled(1 + 1e-4 * k)) for k, f in enumerate(frames)]
    for some, kept in ((frames, True), (flowing, False), (squeezed, False), (frames[:2], False)):
        assert (anchor_of(prepare(Request(some, pot, KERN, GRID, ["stress"]))) is not None) == kept


@pytest.mark.parametrize("walk, lists", [(0.0, (2, 2)), (0.04, (3, 10)), (0.5, (40, 40))])
def test_green_kubo_keeps_its_neighbours(monkeypatch, walk, lists):
    """A solid is searched twice in 40 frames, once with a skin; a liquid now and then; atoms that are elsewhere in each
    frame without a skin, every time."""
    frame, pot = argon(4)
    rng = np.random.default_rng(0)
    x, trajectory = frame.positions, []
    for k in range(40):
        x = x + rng.normal(0, walk, x.shape)
        trajectory.append(frame.replace(positions=x + rng.normal(0, 0.02, x.shape), time=0.01 * k))
    built = Counter(monkeypatch, neighbors.CellList, "_chunks")
    kept = atc.analysis.heat_currents.heat_currents(iter(trajectory), pot)
    made = len(built.calls)
    assert lists[0] <= made <= lists[1]
    monkeypatch.setattr("atc.neighbors.verlet.Following.at", lambda self, frame: None)
    every = atc.analysis.heat_currents.heat_currents(trajectory, pot)
    assert len(built.calls) == made + 40
    # rounding: sums in another order
    np.testing.assert_allclose(kept.J_tc, every.J_tc, rtol=0, atol=1e-12 * np.abs(every.J_tc).max())
