"""ASE sources: what ASE holds or wrote comes back, in ASE's units, frame by frame."""

import gzip
import pickle

import ase
import ase.io
import numpy as np
import pytest
from ase.build import bulk, molecule
from ase.calculators.singlepoint import SinglePointCalculator

import atc
from atc.errors import AtcError, AtcWarning
from atc.readers.ase import AseFile, AseTrajFile, ExtendedXyz


def snapshot(k=0):
    rng = np.random.default_rng(k)
    atoms = bulk("NaCl", "rocksalt", a=5.6).repeat((2, 1, 1))
    atoms.set_cell(atoms.cell + rng.normal(size=(3, 3)) * 0.1)
    atoms.positions += rng.normal(size=atoms.positions.shape)
    atoms.set_momenta(rng.normal(size=atoms.positions.shape))
    atoms.pbc = [True, False, True]
    atoms.calc = SinglePointCalculator(atoms, forces=rng.normal(size=atoms.positions.shape), energy=1.5)
    return atoms


def same(frame, atoms, rtol=0.0, forces=True):
    close = dict(rtol=rtol, atol=rtol)
    np.testing.assert_allclose(frame.positions, atoms.positions, **close)
    np.testing.assert_allclose(frame.cell.vectors, atoms.cell.array, **close)
    np.testing.assert_array_equal(frame.cell.periodic, atoms.pbc)
    np.testing.assert_allclose(frame.velocities, atoms.get_velocities(), **close)
    np.testing.assert_allclose(frame.masses, atoms.get_masses(), **close)
    if forces:
        np.testing.assert_allclose(frame.forces, atoms.get_forces(), **close)
    assert [frame.type_names[t] for t in frame.types.tolist()] == atoms.get_chemical_symbols()
    assert frame.units.name == "ase"


def test_atoms_and_lists():
    a = snapshot()
    traj = atc.read(a)
    assert len(traj) == 1
    same(traj[0], a)
    items = [snapshot(k) for k in range(7)]
    traj = atc.read(items)
    for f, b in zip(traj, items, strict=True):
        same(f, b)
    same(traj[::3][-1], items[6])
    same(pickle.loads(pickle.dumps(traj))[2], items[2])
    kinetic = 0.5 * (traj[0].masses[:, None] * traj[0].velocities ** 2).sum()
    assert kinetic == pytest.approx(items[0].get_kinetic_energy(), rel=1e-14)


def test_only_what_is_there():
    a = bulk("Si", cubic=True)
    f = atc.read(a)[0]
    assert f.velocities is None and f.forces is None and f.charges is None
    with pytest.raises(AtcError, match="velocities are missing but temperature needs them"):
        f.require("velocities", why="temperature")
    a.set_initial_charges(np.arange(8.0))
    a.set_masses(np.arange(8) + 1.0)
    a.arrays["mine"] = np.arange(8)
    f = atc.read(a)[0]
    assert (
        f.charges.tolist() == list(range(8))
        and f.masses.tolist() == list(range(1, 9))
        and f.extra["mine"].tolist() == list(range(8))
    )
    from ase.calculators.emt import EMT

    b = bulk("Cu").repeat(2)
    b.rattle(0.1)
    b.calc = EMT()
    assert atc.read(b)[0].forces is None  # nothing is calculated
    forces = b.get_forces()
    np.testing.assert_array_equal(atc.read(b)[0].forces, forces)
    b.positions[0] += 0.1
    assert atc.read(b)[0].forces is None  # what is stored belongs to other positions


def test_types_do_not_depend_on_the_order_of_reading():
    items = [ase.Atoms("OH"), ase.Atoms("NH2"), ase.Atoms("CO")]
    forward, backward = atc.read(items), atc.read(items)
    assert (
        [f.types.tolist() for f in forward]
        == [f.types.tolist() for f in backward[::-1]][::-1]
        == [[1, 2], [3, 2, 2], [4, 1]]
    )
    assert atc.read(items, masses={"O": 1, "H": 2, "N": 3, "C": 4})[2].masses.tolist() == [4, 1]


def test_open_cells():
    f = atc.read(molecule("H2O"))[0]
    assert not f.cell.periodic.any() and f.cell.complete and f.cell.volume > 0
    a = ase.Atoms("Ar2", positions=[[0, 0, 0], [1, 2, 3]], cell=[5, 6, 0], pbc=[True, True, False])
    f = atc.read(a)[0]
    np.testing.assert_array_equal(f.cell.vectors[:2], np.diag([5.0, 6, 0])[:2])
    assert f.cell.vectors[2, 2] == 3 and f.cell.periodic.tolist() == [True, True, False]
    a.pbc = True
    with pytest.raises(AtcError, match=r"ase.Atoms frame 0: a periodic axis of the cell has zero length"):
        atc.read(a)[0]


@pytest.mark.parametrize("name", ["t.traj", "t.extxyz", "t.xyz", "t.extxyz.gz"])
def test_files_written_by_ase(tmp_path, name):
    items = [snapshot(k) for k in range(9)]
    path = tmp_path / name
    plain = path.with_suffix("") if name.endswith(".gz") else path
    ase.io.write(plain, items, format=None if name == "t.traj" else "extxyz")
    if plain != path:
        path.write_bytes(gzip.compress(plain.read_bytes()))
    traj = atc.read(path)
    assert isinstance(traj, AseTrajFile if name == "t.traj" else ExtendedXyz) and len(traj) == 9
    rtol = 0.0 if name == "t.traj" else 1e-7  # eight decimals or more in extended xyz, depending on the version
    for k in (0, 8, 3, 5, 1):
        same(traj[k], items[k], rtol)
    for f, a in zip(traj[::4], items[::4], strict=True):
        same(f, a, rtol)
    copy = pickle.loads(pickle.dumps(traj))
    same(copy[-1], items[-1], rtol)
    info = traj.info()
    assert info["units"] == "ase" and info["quantities"] == ["positions", "velocities", "forces", "masses"]


def test_extended_xyz_reads_only_what_is_asked_for(tmp_path, monkeypatch):
    ase.io.write(tmp_path / "t.extxyz", [snapshot(k) for k in range(30)])
    import ase.io.extxyz as module

    traj = atc.read(tmp_path / "t.extxyz")
    counted = []
    original = module._read_xyz_frame
    monkeypatch.setattr(module, "_read_xyz_frame", lambda *a, **k: counted.append(1) or original(*a, **k))
    assert len(traj) == 30 and traj[-1] is not None and len(list(traj[::10])) == 3
    assert len(counted) <= 4 + 1  # the species of frame 0 may be looked up for the numbering of types


def test_damaged_xyz(tmp_path):
    path = tmp_path / "t.extxyz"
    ase.io.write(path, [snapshot(k) for k in range(3)])
    text = path.read_text()
    path.write_text(text[:-200])
    with pytest.warns(
        AtcWarning, match=r"t.extxyz: its last frame \(number 2, from line 13\) is not complete and is left out"
    ):
        assert len(atc.read(path)) == 2
    path.write_text(text.rstrip("\n"))
    with pytest.warns(AtcWarning, match="has no line end"):
        assert len(atc.read(path)) == 2
    lines = text.split("\n")
    path.write_text("\n".join([*lines[:8], "Cl x y z", *lines[9:]]))
    with pytest.raises(AtcError, match=r"t.extxyz, frame 1, line 9: column 'pos\[1\]' holds 'x', expected a number"):
        atc.read(path)[1]
    path.write_text("\n".join([*lines[:6], "many", *lines[7:]]))
    with pytest.raises(AtcError, match=r"t.extxyz, frame 1, line 7: expected the number of atoms, got 'many'"):
        len(atc.read(path))


@pytest.mark.parametrize("name,form", [("POSCAR", "vasp"), ("t.cif", "cif"), ("XDATCAR", "vasp-xdatcar")])
def test_other_formats_through_iread(tmp_path, name, form):
    rng = np.random.default_rng(0)
    items = []
    for _ in range(3 if form == "vasp-xdatcar" else 1):
        a = bulk("NaCl", "rocksalt", a=5.6, cubic=True)
        a.positions += rng.random(a.positions.shape) * 0.2 + 0.1
        items.append(a[a.numbers.argsort()])
    ase.io.write(tmp_path / name, items if len(items) > 1 else items[0], format=form)
    traj = atc.read(tmp_path / name)
    assert isinstance(traj, AseFile) and len(traj) == len(items)
    for k in (0, len(items) - 1, 0):
        np.testing.assert_allclose(traj[k].positions, items[k].positions, atol=1e-6)  # as printed by these formats
    assert len(pickle.loads(pickle.dumps(traj))) == len(items)


def test_what_ase_is_not_asked_for(tmp_path):
    with pytest.raises(AtcError, match=r"ASE's units are eV, Å, amu \('ase'\), but the units argument says 'metal'"):
        atc.read(bulk("Si"), units="metal")
    with pytest.raises(AtcError, match="no bonded terms"):
        atc.read(bulk("Si"), topology="x.data")
    with pytest.raises(AtcError, match="item 1 of the list is a int, expected ase"):
        atc.read([bulk("Si"), 3])
    (tmp_path / "x.foo").write_text("something else\n" * 9)
    with pytest.raises(AtcError, match=r"x.foo: neither LAMMPS, nor a format that MDAnalysis or ASE knows"):
        atc.read(tmp_path / "x.foo")
    # A dump without a telling name is LAMMPS's all the same, and its units are asked for.
    dump = (
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\nITEM: ATOMS id type x "
        "y z\n1 1 1 1 1\n"
    )
    for name in ("x.xyz", "x.traj", "x.trr", "noname"):
        (tmp_path / name).write_text(dump)
        with pytest.raises(AtcError, match="its units are not in the file"):
            atc.read(tmp_path / name)
        assert atc.read(tmp_path / name, units="metal")[0].units.name == "metal"
