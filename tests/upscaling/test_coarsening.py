"""Coarsening: the Schur complement wave by wave against one of a whole block as a matrix, and what cutting it costs."""

import numpy as np
import pytest
from crystals import constants, crystal, elastic

from atc import pd
from atc.errors import AtcError
from atc.frame import Cell
from atc.twins.linear import wave_constants
from atc.upscaling.coarsening import coarse_stiffness, coarsen, folded_waves, point_loads, zone_errors
from atc.upscaling.node_kernel import node_kernel


def waves(step, n):
    s = np.array(list(np.ndindex(n, n, n))) / n
    return s @ (2 * np.pi * np.linalg.inv(step).T)


def block(fc, repeat):
    """(cells, n, 3, cells, n, 3) stiffness of a periodic block of primitive cells as one matrix."""
    c, n = fc.crystal, len(fc.crystal)
    cells = np.array(list(np.ndindex(*repeat)))
    K = np.zeros((len(cells), n, 3, len(cells), n, 3))
    shift = np.rint((fc.r_bc - c.positions[fc.j] + c.positions[fc.i]) @ np.linalg.inv(c.vectors)).astype(int)
    for k, cell in enumerate(cells):
        to = np.ravel_multi_index(((cell + shift) % repeat).T, repeat)
        np.add.at(K, (k, fc.i, slice(None), to, fc.j), fc.phi_bcc)
        for a in range(n):
            K[k, a, :, k, a] += fc.onsite_ncc[a]
    return cells, K


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_it_is_the_schur_complement_of_the_block(name):
    """2 x 2 x 2 primitive cells to a node, 4 x 4 x 4 cells: all that is not a kept centre of mass eliminated at once."""
    fc, c = constants(name), crystal(name)
    repeat, step, m = (4, 4, 4), 2 * c.vectors, len(c)
    cells, K = block(fc, repeat)
    size = 3 * m * len(cells)
    K = K.reshape(size, size)
    # Coordinates: the centre of mass of each kept cell, and everything that leaves it where it is.
    share = np.hstack([np.eye(3) * w for w in c.masses / c.masses.sum()])
    kept = np.flatnonzero((cells % 2 == 0).all(axis=1))
    B = np.zeros((3 * len(kept), size))
    for row, cell in enumerate(kept):
        B[3 * row : 3 * row + 3, 3 * m * cell : 3 * m * (cell + 1)] = share
    q, _ = np.linalg.qr(B.T, mode="complete")
    rest, back = q[:, len(B) :], np.linalg.pinv(B)
    cc, ce, ee = back.T @ K @ back, back.T @ K @ rest, rest.T @ K @ rest
    wanted = cc - ce @ np.linalg.solve(ee, ce.T)
    k = waves(step, 2)
    x = cells[kept] @ c.vectors
    Kq = coarse_stiffness(fc, step, k)
    made = np.einsum("kij,kab->iajb", np.exp(1j * np.einsum("kc,ijc->kij", k, x[:, None] - x[None])), Kq).real / len(k)
    assert made.reshape(wanted.shape) == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())


def pair_of_loads(name, n=8, horizon=3.015):
    """(fine, coarsened in the engine, fitted to ω in the engine) displacements of nodes, a pair of loads on two of
    them."""
    fc, c = constants(name), crystal(name)
    step = c.conventional
    a = step[0, 0]
    X = np.array(list(np.ndindex(n, n, n)))
    far = np.array([n // 2, 0, 0])
    load = np.zeros((n**3, 3))
    load[0], load[np.flatnonzero((X == far).all(axis=1))[0]] = [1, 0, 0], [-1, 0, 0]
    K = coarse_stiffness(fc, step, waves(step, n))
    w = np.fft.fftn(load.reshape(n, n, n, 3), axes=(0, 1, 2)).reshape(-1, 3)
    w[1:] = np.linalg.solve(K[1:], w[1:, :, None])[..., 0]
    w[0] = 0
    fine = np.fft.ifftn(w.reshape(n, n, n, 3), axes=(0, 1, 2)).real.reshape(-1, 3)
    out = [fine]
    for kernel in (
        coarsen(fc, elastic(name), step, horizon * a, mesh=10),
        node_kernel(fc, elastic(name), step, 3.015 * a),
    ):
        body = pd.Body(X @ step, a**3, c.density, horizon * a, cell=Cell(step * n), warn=False)
        force = pd.BodyForce(None, load / a**3)
        sim = pd.Simulation(body, pd.Linear(kernel), conditions=[force])
        pd.solve_static(sim, tolerance=1e-7)
        out.append(sim.state.u_nc - sim.state.u_nc.mean(axis=0))
    return out


def test_loads_on_nodes_move_them_as_in_the_crystal_in_the_engine():
    fine, mine, fitted = pair_of_loads("argon")
    away = np.linalg.norm(fine, axis=1) < 0.9 * np.linalg.norm(fine, axis=1).max()
    assert away.sum() == len(fine) - 2
    # Where the loads are: what springs fitted to ω have too stiff by half is right.
    assert mine[0, 0] == pytest.approx(fine[0, 0], rel=0.01)
    assert fitted[0, 0] < 0.6 * fine[0, 0]
    off = [np.linalg.norm((u - fine)[away]) / np.linalg.norm(fine[away]) for u in (mine, fitted)]
    assert off[0] < 0.04 and off[0] < 0.5 * off[1]


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_elastic_constants_are_exact_and_every_wave_is_stable(name):
    fc, C, step = constants(name), elastic(name), crystal(name).conventional
    for cut in ("fit", "second", "fourth"):
        k = coarsen(fc, C, step, 3.015 * step[0, 0], cut=cut, mesh=8)
        assert wave_constants(k) == pytest.approx(C.C_vv, rel=1e-9, abs=1e-9 * C.C_vv.max())
        assert k.least > 0
        low = zone_errors(k, fc, 9)[:, 1:]
        assert low.mean() < -0.1 and np.isfinite(low).all()  # lumped masses: waves are too slow
    assert 0 < k.beyond < 0.03
    bare = coarsen(fc, C, step, 3.015 * step[0, 0], cut="bare", mesh=8)
    assert np.abs(wave_constants(bare) / C.C_vv - 1)[0, 0] > 0.01


def test_what_cannot_be_coarsened_says_so():
    fc, C, c = constants("argon"), elastic("argon"), crystal("argon")
    with pytest.raises(AtcError, match="must be lattice vectors"):
        folded_waves(c, 1.3 * c.conventional)
    assert len(folded_waves(c, 2 * c.conventional)) == 32
    with pytest.raises(AtcError, match="too few nodes for fourth moments"):
        coarsen(fc, C, c.conventional, 2.015 * c.conventional[0, 0], cut="fourth", mesh=6)
    with pytest.raises(AtcError, match="expected one of fit"):
        coarsen(fc, C, c.conventional, 20.0, cut="sharp")
    with pytest.raises(AtcError, match="add up to 0"):
        point_loads(fc, (2, 2, 2), [[0, 0, 0]], [[1.0, 0, 0]])


def test_point_loads_are_in_equilibrium():
    fc = constants("argon")
    repeat = (4, 4, 4)
    u = point_loads(fc, repeat, [[0, 0, 0], [2, 1, 0]], [[1.0, 2, 0], [-1, -2, 0]])
    cells, K = block(fc, repeat)
    f = K.reshape(3 * 64, -1) @ u.ravel()
    wanted = np.zeros((*repeat, 3))
    wanted[0, 0, 0], wanted[2, 1, 0] = [1, 2, 0], [-1, -2, 0]
    assert f == pytest.approx(wanted.ravel(), abs=1e-9)
