"""Beside dynasor, Euphonic and seekpath, which live in an environment of their own (make test-tools)."""

import numpy as np
import pytest
from crystals import constants
from test_zone import CELLS, liquid

from atc.upscaling.crystal import Crystal
from atc.upscaling.phonopy_bridge import write_phonopy
from atc.upscaling.structure_factors import structure_factors, wave_vectors
from atc.upscaling.zone import special_points, zone_path

pytestmark = pytest.mark.tools


@pytest.mark.parametrize("lattice", ["cP", "cI", "hP", "tP", "tI1", "tI2"])
def test_points_are_those_of_seekpath(lattice):
    pytest.importorskip("seekpath")
    c = Crystal(4.1 * CELLS[lattice], [[0, 0, 0]], 1.0, "metal")
    ours = special_points(c)[1]
    theirs = zone_path(c, "seekpath")
    assert [s.ends for s in theirs if "1" not in "".join(s.ends)] == [s.ends for s in zone_path(c)]
    G = np.stack(np.meshgrid(*3 * [np.arange(-3, 4)], indexing="ij"), -1).reshape(-1, 3) @ c.reciprocal
    around = lambda k: np.sort(np.linalg.norm(G - k, axis=1))[:8]  # noqa: E731
    for s in theirs:
        for name, k in zip(s.ends, s.k_ec):
            if name in ours:
                np.testing.assert_allclose(around(ours[name]), around(k), atol=1e-6)


HEX = 3.2 * np.array([[1.0, 0, 0], [-0.5, 0.75**0.5, 0], [0, 0, 1.633]])
STRUCTURES = {
    "fcc": Crystal.cubic("fcc", 4.05, 27.0, "metal"),
    "bcc": Crystal.cubic("bcc", 2.87, 56.0, "metal"),
    "sc": Crystal.cubic("sc", 3.3, 209.0, "metal"),
    "diamond": Crystal.cubic("diamond", 5.43, 28.0, "metal"),
    "zincblende": Crystal.cubic("diamond", 5.65, [69.7, 74.9], "metal"),
    "hcp": Crystal(HEX, np.array([[1 / 3, 2 / 3, 0.25], [2 / 3, 1 / 3, 0.75]]) @ HEX, 24.3, "metal"),
}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", STRUCTURES)
def test_names_of_crystals_are_those_of_seekpath(name, turned):
    """With their atoms, whose symmetry is seekpath's guide; as they are, and by another primitive cell, turned."""
    pytest.importorskip("seekpath")
    from scipy.spatial.transform import Rotation

    c = STRUCTURES[name]
    if turned:
        R = Rotation.random(random_state=5).as_matrix().T
        vectors = np.array([[1, 1, 0], [0, 1, 0], [1, 0, 1]]) @ c.vectors @ R
        c = Crystal(vectors, c.positions @ R, c.masses, "metal", types=c.types)
    theirs = {x: k for s in zone_path(c, "seekpath") for x, k in zip(s.ends, s.k_ec)}
    ours = special_points(c)[1]
    assert set(ours) == set(theirs)
    G = np.stack(np.meshgrid(*3 * [np.arange(-4, 5)], indexing="ij"), -1).reshape(-1, 3) @ c.reciprocal
    for x, k in ours.items():
        near = [np.sort(np.linalg.norm(G - q, axis=1))[:10] for q in (k, theirs[x])]
        np.testing.assert_allclose(*near, atol=1e-6)


def test_low_symmetry_goes_to_seekpath():
    """A face-centred orthorhombic lattice, whose points have Greek names too, and a triclinic one with two atoms."""
    pytest.importorskip("seekpath")
    fco = Crystal(np.array([[0, 2, 2.5], [1.5, 0, 2.5], [1.5, 2, 0]]), [[0, 0, 0]], 30.0, "metal")
    assert {"Γ", "Y", "Σ0", "U0"} <= {x for s in zone_path(fco, "seekpath") for x in s.ends}
    vectors = np.array([[3.1, 0, 0], [0.4, 4.2, 0], [0.3, 0.7, 5.1]])
    odd = Crystal(vectors, np.array([[0, 0, 0], [0.13, 0.21, 0.34]]) @ vectors, [30.0, 20.0], "metal", types=[1, 2])
    # Of a triclinic lattice all named points are half a reciprocal vector.
    for s in zone_path(odd, "seekpath"):
        half = s.k_ec @ odd.vectors.T / np.pi
        np.testing.assert_allclose(half, np.rint(half), atol=1e-9)


def test_structure_factors_are_those_of_dynasor(tmp_path):
    dynasor = pytest.importorskip("dynasor")
    frames = liquid()
    q = wave_vectors(frames[0].cell, 1.2)
    ds = structure_factors(frames, q, lags=9)
    edges = np.diag(frames[0].cell.vectors)
    with open(tmp_path / "run.xyz", "w") as f:
        for frame in frames:
            v = frame.velocities * float(frame.units.to_user("velocity", 1.0)) * 1e-3
            f.write(f'{len(frame)}\nLattice="{edges[0]} 0 0 0 {edges[1]} 0 0 0 {edges[2]}" ')
            f.write("Properties=species:S:1:pos:R:3:vel:R:3\n")
            for t, x in zip(frame.types, np.hstack([frame.positions, v])):
                f.write(("Al " if t == 1 else "Ni ") + " ".join(repr(float(c)) for c in x) + "\n")
    traj = lambda: dynasor.Trajectory(  # noqa: E731
        str(tmp_path / "run.xyz"),
        trajectory_format="extxyz",
        length_unit="Angstrom",
        time_unit="fs",
        atomic_indices={"Al": np.arange(20), "Ni": np.arange(20, 30)},
    )
    s = dynasor.compute_dynamic_structure_factors(traj(), q, dt=4.0, window_size=9, calculate_currents=True)
    names = {"Fqt": "Fqt_coh", "Sqw": "Sqw_coh"}
    for name in ("Fqt", "Sqw", "Clqt", "Clqw", "Ctqt", "Ctqw"):
        for pair in ("", "_Al_Al", "_Al_Ni", "_Ni_Ni"):
            theirs = s[names.get(name, name) + pair]
            np.testing.assert_allclose(ds[name + pair], theirs, atol=1e-9 * np.abs(theirs).max())
    np.testing.assert_allclose(ds["omega"], s.omega, rtol=1e-9)
    static = dynasor.compute_static_structure_factors(traj(), q)
    np.testing.assert_allclose(ds["Sq"], static["Sq"][:, 0], rtol=1e-10)


def test_euphonic_reads_what_is_written(tmp_path):
    euphonic = pytest.importorskip("euphonic")
    fc = constants("silicon")
    write_phonopy(fc, tmp_path, zone_path(fc.crystal))
    read = euphonic.ForceConstants.from_phonopy(
        path=str(tmp_path), summary_name="phonopy.yaml", fc_name="FORCE_CONSTANTS"
    )
    k = np.array([[0.31, -0.2, 0.4], [0.9, 0.3, 0.1]])
    modes = read.calculate_qpoint_phonon_modes(k @ fc.crystal.vectors.T / (2 * np.pi), asr=None)
    # meV to THz; Euphonic's constants are another CODATA's.
    np.testing.assert_allclose(
        modes.frequencies.to("meV").magnitude / 4.135667696, fc.frequencies(k) * 15.633302, rtol=1e-6
    )
    bands = euphonic.QpointFrequencies.from_phonopy(path=str(tmp_path), phonon_name="band.yaml")
    assert len(bands.qpts) == 5 * 51
