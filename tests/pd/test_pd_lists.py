"""What makes peridynamic runs fast and must change nothing, not one bit: the two contact lists, and rows without their
broken bonds."""

import numpy as np
import pytest

from atc import pd
from atc.errors import AtcError
from atc.frame import Cell
from atc.pd import standing
from atc.pd.blocks import Crew, node_rows
from atc.pd.contact import Contact, ContactSearch

SIDE = np.array([9.0, 8.0, 7.0])


def all_pairs_contact(body, u, k, cell, before):
    """Contact forces and energy of every pair, through its nearest image: cells are much longer than contact
    reaches."""
    X, y = body.X_nc, body.X_nc + u
    r, xi = y[None] - y[:, None], X[None] - X[:, None]
    S = -np.rint(r @ np.linalg.inv(cell)) * body.cell.periodic
    r, xi = r + S @ cell, xi + S @ before
    length, r0 = np.linalg.norm(r, axis=2), np.linalg.norm(xi, axis=2)
    d = np.minimum(0.9 * r0, 1.35 * (body.radius_n[:, None] + body.radius_n))
    i, j = np.nonzero((length < d) & ~np.eye(len(X), dtype=bool))
    push = k * body.V_n[i] * body.V_n[j] * (d - length)[i, j]
    F = np.zeros_like(u)
    np.add.at(F, i, -(push / length[i, j])[:, None] * r[i, j])
    return F, 0.25 * (push * (d - length)[i, j]).sum()


@pytest.mark.parametrize("periodic, strained", [(False, False), (True, False), ((True, False, True), True)])
def test_contact_lists_miss_nothing(periodic, strained):
    """A body of which a part flies, then all of it: forces of every step are those of all pairs, and bitwise those of
    lists made anew."""
    rng = np.random.default_rng(3)
    cell = Cell(SIDE, periodic=periodic)
    points = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in SIDE), indexing="ij"), -1).reshape(-1, 3)
    points += rng.uniform(-0.12, 0.12, points.shape)
    body = pd.Body(points, rng.uniform(0.6, 1.4, len(points)), 1.0, 0.9, cell=cell, spacing=1.0)
    H = np.array([[0.02, 0.01, 0], [0, -0.03, 0], [0.01, 0, 0.01]]) if strained else None
    now = cell.vectors @ (np.eye(3) + (H if strained else 0)).T
    k = np.array([2.0])

    def search():
        out = ContactSearch(body, Contact(), k, (np.zeros(len(body), np.int64), 1), Crew(1))
        out.strain = H
        return out

    kept = search()
    z = node_rows(len(body))
    z[:, 3:6] = points
    if strained:
        z[:, :3] = points @ H.T
    v = rng.normal(size=points.shape) * 2e-4
    flies = rng.random(len(points)) < 0.04
    v[flies] = rng.normal(size=(flies.sum(), 3)) * 0.05
    followed = surveyed = touching = 0
    for step in range(90):
        if step == 60:
            v = rng.normal(size=points.shape) * 0.04
        z[:, :3] += v
        before = (kept.rebuilt, kept.home_nc)
        F, G = np.zeros_like(v), np.zeros_like(v)
        energy = kept.add(z, F)
        assert energy == search().add(z, G) and np.array_equal(F, G)
        want, want_energy = all_pairs_contact(body, z[:, :3], k[0] * 15 / body.horizon, now, cell.vectors)
        np.testing.assert_allclose(F, want, atol=1e-11 * max(1.0, np.abs(want).max()))
        assert energy == pytest.approx(want_energy, rel=1e-12, abs=1e-13)
        touching += energy > 0
        surveyed += kept.rebuilt > before[0] and kept.home_nc is not before[1]
        followed += kept.rebuilt > before[0] and kept.home_nc is before[1]
    assert followed > 5 and surveyed > 3 and touching > 60
    assert kept.reach > kept.shortest, "where everything moves, slow nodes get more room"


def test_contact_says_when_a_run_has_blown_up():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (3.1,) * 3), 1.0, 1.5, 1.0)
    sim = pd.Simulation(body, pd.PMB(1.0), contact=True, dt=0.01)
    sim.step(1)
    # Not the last node: whatever comes after must not hide it.
    sim._z[3, 1] = np.nan
    with pytest.raises(AtcError, match="blown up"):
        sim.step(1)


def shattering(material, share, monkeypatch, horizon=3.01, threads=1, state=None, counts=(11, 8, 7)):
    monkeypatch.setattr(standing, "_SHARE", share)
    body = pd.Body.lattice(pd.Box((0, 0, 0), np.array(counts) - 0.9), 1.0, horizon, 2.0, jitter=0.05)
    return pd.Simulation(
        body,
        material,
        damage=pd.CriticalStretch(0.02, 0.25),
        contact=True,
        no_fail=pd.Box((None,) * 3, (1.5, None, None)),
        threads=threads,
        indenter=pd.Indenter(3.0, 20.0, (5, 9.0, 3), (0, -1.0, 0)),
        velocities=None if state else np.sin(body.X_nc[:, ::-1]) * 0.05,
        state=state,
    )


def same(a, b):
    x, y = a.to_arrays(), b.to_arrays()
    assert set(x) == set(y)
    for k in x:
        assert np.array_equal(x[k], y[k]), k


# Horizon 4.7: rows longer than the kernels' buffers, and so of two parts.
@pytest.mark.parametrize("horizon", [3.01, 4.7])
@pytest.mark.parametrize("material", [pd.PMB(1.3), pd.LPS(1.3, 0.5)], ids=["pmb", "lps"])
def test_rows_without_broken_bonds_change_nothing(material, horizon, monkeypatch):
    """Never drawn together, in the usual way, and in every step: bitwise the same run; restarted in the midst too."""
    never = shattering(material, np.inf, monkeypatch, horizon)
    never.step(60)
    assert never.n_broken > 0.2 * len(never.body.bonds)
    assert never.model._standing.bond_b is None
    for share in (0.1, 0.0):
        sim = shattering(material, share, monkeypatch, horizon)
        sim.step(30)
        half = pd.State.from_arrays(sim.state.to_arrays())
        sim.step(30)
        rows = sim.model._standing
        assert len(rows.bond_b) < 0.9 * len(sim.body.bonds) and sim.n_broken == never.n_broken
        assert np.array_equal(sim.state.intact_b[rows.bond_b], rows.intact_b)
        same(sim.state, never.state)
        assert sim.energies() == never.energies() and np.array_equal(sim.damage(), never.damage())
        again = shattering(material, share, monkeypatch, horizon, state=half)
        again.step(30)
        same(again.state, never.state)


def test_rows_follow_bonds_that_are_cut_or_healed_by_hand(monkeypatch):
    runs = []
    for share in (np.inf, 0.05):
        sim = shattering(pd.LPS(1.3, 0.5), share, monkeypatch)
        sim.step(40)
        whole, broken = np.flatnonzero(sim.state.intact_b), np.flatnonzero(sim.state.intact_b == 0)
        sim.step(1)
        # As many healed as cut, so that their number does not give it away; the very last bond among them.
        sim.state.intact_b[whole[10:20]] = 0
        sim.state.intact_b[broken[:10]] = 1
        sim.step(1)
        sim.state.intact_b[-1] ^= 1
        sim.step(10)
        runs.append(sim)
    assert runs[0].model._standing.bond_b is None and runs[1].model._standing.bond_b is not None
    same(runs[0].state, runs[1].state)


def test_threads_change_nothing_in_a_shattered_body(monkeypatch):
    a, b = (shattering(pd.PMB(1.3), 0.02, monkeypatch, threads=t, counts=(26, 18, 16)) for t in (1, 3))
    for sim in (a, b):
        sim.step(25)
    assert a.model.blocks.count > 1 and a.model._standing.bond_b is not None and a.n_broken == b.n_broken
    same(a.state, b.state)


def test_a_notch_beside_a_face_of_a_periodic_cell():
    """It cuts what it cuts in the middle of the cell, bonds through the face too, wherever along both axes it lies."""
    n = 20
    x = np.stack(np.meshgrid(np.arange(n), np.arange(n), [0], indexing="ij"), axis=-1).reshape(-1, 3) + 0.5
    found = []
    for start, y in ((6.0, 10.01), (6.0, 19.01), (6.0, 0.99), (0.0, 10.01), (13.0, 19.01)):
        notch = pd.Notch.line((start, y), (start + 7.0, y), as_damage=True)
        cell = Cell([float(n), n, 1.0], periodic=[True, True, False])
        body = pd.Body(x, 1.0, 1.0, 3.015, cell=cell, dimension=2, spacing=1.0, notches=notch)
        assert len(body.bonds) == 14 * n * n
        found.append(int(body.cuts[0]))
    assert found[0] > 60 and found == found[:1] * 5
