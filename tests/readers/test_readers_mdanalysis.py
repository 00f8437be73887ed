"""MDAnalysis sources, on the files of MDAnalysisTests, against MDAnalysis's own arrays and, where there is one, another
reader."""

import pickle
import warnings

import MDAnalysis
import numpy as np
import pytest
from MDAnalysisTests import datafiles as D

import atc
from atc.errors import AtcError, AtcWarning

pytestmark = pytest.mark.filterwarnings("ignore")

PS = 1e-12 / np.sqrt(1.66053906660e-27 * 1e-20 / 1.602176634e-19)  # a picosecond in units of sqrt(amu Å²/eV)
KJ_MOL = 1000 / (6.02214076e23 * 1.602176634e-19)

# trajectory, topology, velocities, forces
FILES = {
    "TRR": (D.TRR, D.GRO, True, False),
    "XTC": (D.XTC, D.GRO, False, False),
    "GRO with velocities": (D.GRO_velocity, None, True, False),
    "NetCDF": (D.NCDF, D.PRMncdf, False, False),
    "DCD": (D.DCD, D.PSF, False, False),
    "H5MD": (D.H5MD_xvf, D.TPR_xvf, True, True),
    "TNG": (D.TNG_traj_vels_forces, D.TNG_traj_gro, True, True),
}


@pytest.mark.parametrize("name", FILES)
def test_formats(name):
    path, topology, velocities, forces = FILES[name]
    traj = atc.read(path, topology=topology)
    u = MDAnalysis.Universe(topology, path) if topology else MDAnalysis.Universe(path)
    assert len(traj) == len(u.trajectory)
    for k in (0, -1, len(traj) // 2):
        f = traj[k]
        ts = u.trajectory[k]
        # float32 numbers in float64: exact
        np.testing.assert_array_equal(f.positions, ts.positions)
        assert (f.velocities is None) != velocities and (f.forces is None) != forces
        if velocities:
            np.testing.assert_allclose(
                f.velocities, np.asarray(ts.velocities, float) / PS, rtol=1e-9
            )  # constants written twice
        else:
            with pytest.raises(AtcError, match="velocities are missing"):
                f.require("velocities", why="temperature")
        if forces:
            np.testing.assert_allclose(f.forces, np.asarray(ts.forces, float) * KJ_MOL, rtol=1e-9)
        if ts.dimensions is None or not ts.dimensions[:3].any():
            assert not f.cell.periodic.any()
        else:
            # MDAnalysis's own vectors are float32, of the same lengths and angles
            np.testing.assert_allclose(f.cell.vectors, ts.triclinic_dimensions, atol=2e-6 * ts.dimensions[:3].max())
            assert f.cell.periodic.all()
        if f.time is not None:
            assert f.time == pytest.approx(ts.time * PS, rel=1e-9)
    assert atc.read(u).info()["frames"] == len(traj)


def test_trr_against_its_coordinates_in_nanometres():
    """The TRR and XTC of the same run, and the GRO of its first frame: three files, one set of atoms."""
    trr, xtc = atc.read(D.TRR, topology=D.GRO), atc.read(D.XTC, topology=D.GRO)
    # XTC keeps 0.01 Å: half of that, and float32.
    np.testing.assert_allclose(trr[3].positions, xtc[3].positions, atol=0.0051)
    assert trr[3].time == pytest.approx(xtc[3].time)
    info = xtc.info()
    assert info["coordinate_resolution"] == pytest.approx(0.01) and "velocities" not in info["quantities"]
    assert trr.info()["coordinate_resolution"] == pytest.approx(7.6e-6, rel=0.1)  # float32 at 100 Å
    assert atc.read(D.TRR).info()["types"][1]["name"] is None


def test_argon_is_liquid():
    """Kinetic temperature and density of the argon TNG in physical units: wrong factors would be off by 10 or more."""
    f = atc.read(D.TNG_traj_vels_forces, topology=D.TNG_traj_gro, masses=[39.948])[-1]
    kelvin = (f.masses[:, None] * f.velocities**2).sum() / (3 * len(f) * f.units.boltzmann)
    assert 50 < kelvin < 400
    assert 1.2 < f.masses.sum() / f.cell.volume * 1.66053906660 < 1.6  # g/cm^3


def test_masses_charges_bonds_and_types_of_the_topology():
    traj = atc.read(D.DCD, topology=D.PSF)
    u = MDAnalysis.Universe(D.PSF, D.DCD)
    f = traj[0]
    np.testing.assert_allclose(f.masses, u.atoms.masses)
    np.testing.assert_allclose(f.charges, u.atoms.charges)
    np.testing.assert_array_equal(f.topology.bonds, u.bonds.indices)
    np.testing.assert_array_equal(f.topology.angles, u.angles.indices)
    np.testing.assert_array_equal(f.types, u.atoms.types.astype(int))  # CHARMM's numbers in this PSF
    assert atc.read(D.NCDF, topology=D.PRMncdf)[0].type_names[1] == "N3"
    # Virtual sites have no mass, and their topology says so.
    water = atc.read(D.H5MD_xvf, topology=D.TPR_xvf)[0]
    assert (water.masses == 0).sum() == 4612 and water.masses.max() > 15


def test_masses_that_mdanalysis_does_not_know():
    with pytest.warns(AtcWarning, match="have no mass in MDAnalysis"):
        assert atc.read(D.GRO)[0].masses is None


def test_atom_groups():
    u = MDAnalysis.Universe(D.PSF, D.DCD)
    group = u.select_atoms("resid 1:5")
    assert len(atc.read(u.atoms)[0]) == len(u.atoms)
    with pytest.raises(AtcError, match="bonds lead out of the chosen atoms; choose whole molecules"):
        atc.read(group)
    argon = MDAnalysis.Universe(D.TNG_traj_gro, D.TNG_traj)
    part = atc.read(argon.atoms[::3], masses=[39.948])
    np.testing.assert_array_equal(part[5].positions, argon.trajectory[5].positions[::3])


def test_sequence_and_pickle():
    traj = atc.read(D.XTC, topology=D.GRO)
    times = [f.time for f in traj[::3]]
    assert times == [traj[k].time for k in (0, 3, 6, 9)] and times[0] < times[-1]
    copy = pickle.loads(pickle.dumps(traj[2:4]))
    np.testing.assert_array_equal(copy[1].positions, traj[3].positions)


def test_threads_do_not_mix_frames_up():
    from concurrent.futures import ThreadPoolExecutor

    traj = atc.read(D.TNG_traj, masses=[39.948])
    want = [f.positions.copy() for f in traj[:20]]
    with ThreadPoolExecutor(4) as pool:
        got = list(pool.map(lambda k: traj[k].positions, range(20)))
    for a, b in zip(want, got):
        np.testing.assert_array_equal(a, b)


def test_in_memory_universe_without_a_box():
    x = np.random.default_rng(0).random((4, 10, 3)).astype(np.float32)
    u = MDAnalysis.Universe.empty(10, trajectory=True)
    u.load_new(x)
    f = atc.read(u, masses=[1.0])[2]
    np.testing.assert_array_equal(f.positions, x[2])
    assert not f.cell.periodic.any() and f.cell.complete and f.masses.tolist() == [1] * 10


def relative(x):
    """Positions from the first atom: MDAnalysis moves the origin of the box, and by other amounts where coordinates are
    scaled."""
    return np.asarray(x, float) - np.asarray(x[0], float)


def test_lammps_files_are_not_taken_from_mdanalysis():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        u = MDAnalysis.Universe(D.LAMMPSDUMP, format="LAMMPSDUMP", topology_format="LAMMPSDUMP")
        v = MDAnalysis.Universe(D.LAMMPSdata, topology_format="DATA", format="DATA")
    with pytest.raises(AtcError, match="it reads a LAMMPS dump, whose units MDAnalysis does not know"):
        atc.read(u)
    with pytest.raises(AtcError, match="it reads a LAMMPS data file"):
        atc.read(v)
    ours = atc.read(D.LAMMPSDUMP, units="real")
    np.testing.assert_allclose(
        relative(ours[1].positions), relative(u.trajectory[1].positions), atol=1e-5
    )  # float32 and %g


def test_lammps_dumps_of_the_collection_against_mdanalysis():
    for path in (D.LAMMPSDUMP_triclinic, D.LAMMPSDUMP_allcoords, D.LAMMPSDUMP_image_vf, D.LAMMPSDUMP_non_linear):
        u = MDAnalysis.Universe(path, format="LAMMPSDUMP", topology_format="LAMMPSDUMP")
        ours = atc.read(path, units="real")
        assert len(ours) == len(u.trajectory)
        for k in (0, -1):
            f, ts = ours[k], u.trajectory[k]
            # float32 of numbers up to 40
            np.testing.assert_allclose(relative(f.positions), relative(ts.positions), atol=5e-5)
            np.testing.assert_allclose(f.cell.vectors, ts.triclinic_dimensions, atol=5e-5)


def test_errors(tmp_path):
    with pytest.raises(
        AtcError, match=r"MDAnalysis's units are Å, ps, kJ/mol \('mdanalysis'\), but the units argument says 'real'"
    ):
        atc.read(D.XTC, units="real")
    with pytest.raises(
        AtcError, match=r"adk\.psf holds a topology but no positions: give the trajectory's path, and this as topology="
    ):
        atc.read(D.PSF)
    with pytest.raises(AtcError, match="has its topology already"):
        atc.read(MDAnalysis.Universe(D.PSF, D.DCD), topology=D.PSF)
    (tmp_path / "x.trr").write_bytes(b"not a trr file, but long enough to look at" * 10)
    with pytest.raises(AtcError, match=r"x.trr: MDAnalysis cannot open it"):
        atc.read(tmp_path / "x.trr")
    with pytest.raises(AtcError, match="MDAnalysis cannot open it"):
        atc.read(D.XTC, topology=D.PSF)  # another number of atoms
    with pytest.raises(AtcError, match="no trajectory"):
        atc.read(MDAnalysis.Universe(D.PSF))
