"""What both sides do at the nodes, and the classical wave equation from the same start."""

import numpy as np
import pytest
from crystals import crystal, elastic
from test_twin import block, scene, twin_of
from trembling import trembling

import atc
from atc.frame import Cell
from atc.twins.body import body_of
from atc.twins.linear import measured
from atc.twins.nodes import classical_waves, tensor_of
from atc.twins.smoothing import Smoothing


def test_classical_waves():
    """A standing and a running wave of an anisotropic solid in a sheared cell, against the closed form; momentum."""
    C = tensor_of(elastic("argon").C_vv)
    assert np.allclose(C, elastic("argon").tensor)
    rho, counts = 1.7, (6, 4, 5)
    cell = Cell(np.array([[12.0, 0, 0], [2.0, 9.0, 0], [0, 1.0, 11.0]]))
    s = np.stack(np.meshgrid(*(np.arange(n) / n for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    X = s @ cell.vectors
    k = 2 * np.pi * cell.inverse @ np.array([1, -1, 2])
    w2, e = np.linalg.eigh(np.einsum("ijkl,j,l->ik", C, k, k) / rho)
    for m in range(3):
        w = w2[m] ** 0.5
        u = lambda t, w=w, m=m: np.cos(X @ k - w * t)[:, None] * e[:, m]  # noqa: E731
        v = w * np.sin(X @ k)[:, None] * e[:, m]
        times = np.array([0.0, 0.3 / w, 7.0 / w])
        found = classical_waves(C, rho, cell, counts, u(0.0), v, times)
        assert found == pytest.approx(np.array([u(t) for t in times]), abs=1e-12)
    drift = np.broadcast_to([0.1, -0.2, 0.3], X.shape)
    assert classical_waves(C, rho, cell, counts, 0 * X, drift, [2.0])[0] == pytest.approx(2 * drift, abs=1e-12)


def test_at_the_nodes(tmp_path):
    """A long wave in argon: displacement at the nodes is the smoothed one of the run, the twin's starts there, and over a
    short while springs and the classical equation agree; no classical waves where something is held."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    k = 2 * np.pi / (5 * a)
    wave = lambda X: 1e-3 * np.sin(k * X[:, :1]) * np.array([[0, 1.0, 0]])  # noqa: E731
    frames = [block(), block(u=wave), block(u=wave, time=100.0)]
    found = twin_of(tmp_path / "run.dump", frames, material="linear")
    ds, body = found.dataset, found.body.body
    u = crystal("argon").units
    s = Smoothing(block(), atc.kernel("quartic", 12.0), body.X_nc)
    want = s.mean(wave(block().positions))
    assert ds["md_node_displacement"].values[0] == pytest.approx(want, abs=1e-9)
    assert ds["pd_node_displacement"].values[0] == pytest.approx(want, abs=1e-9)
    later = {side: ds[f"{side}_node_displacement"].values[1] for side in ("pd", "classical")}
    # A standing wave of the lattice: cos ωt, with ω of the nodes' springs and of sound; the run is a still picture.
    time = u.to_internal("time", 100.0 if u.name != "metal" else ds["time"].values[1] - ds["time"].values[0])
    sound = np.sqrt(elastic("argon").cubic[2] / crystal("argon").density) * k
    springs = np.sqrt(found.material.kernel.dynamical_matrix([k, 0, 0])[0, 1, 1])
    for side, w in (("pd", springs), ("classical", sound)):
        assert later[side] == pytest.approx(want * np.cos(w * time), abs=0.02 * np.abs(want).max())
    assert abs(np.cos(springs * time) - np.cos(sound * time)) < 0.2
    held = twin_of(tmp_path / "run.dump", frames, material="linear", grips=[[[-9, -9, -9], [a, 99, 99]]])
    assert "classical_node_displacement" not in held.dataset and "pd_node_displacement" in held.dataset


def test_measured_springs_as_material(tmp_path):
    """Samples of the harmonic crystal: constants with their error bars in the lines, and the nodes have just these."""
    made = body_of(block(), atc.kernel("quartic", 8.0), crystal("argon").density, 5.3, 11.0)
    found = measured(crystal("argon"), np.eye(3), made, trembling("argon", (4, 4, 4), 100))
    text = "\n".join(found.lines(crystal("argon").units))
    assert "100 frames" in text and "±" in text and "63 waves" in text
    assert found.error < 1e-9 and np.array_equal(found.crystal_vv, found.found.elastic.C_vv)
    with pytest.raises(atc.AtcError, match="one atom a cell"):
        measured(crystal("silicon"), np.eye(3), made, trembling("silicon", (2, 2, 2), 31))
    given = scene(tmp_path / "run.dump", [block(), block(time=1.0)], material="measured", equilibrium="nowhere.dump")
    with pytest.raises(atc.AtcError, match="there is no file"):
        atc.twin(given)
    with pytest.raises(atc.AtcError, match="too few for fluctuations"):
        atc.twin({**given, "twin": {k: v for k, v in given["twin"].items() if k != "equilibrium"}})
