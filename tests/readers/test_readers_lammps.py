"""Files that LAMMPS itself wrote, in several units and boxes, against the arrays in its memory when it wrote them."""

import gzip
import struct

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError, AtcWarning
from atc.readers.lammps.binary import LammpsBinaryDump
from atc.readers.lammps.dump import LammpsDump
from atc.units import units

BOXES = {
    "orthogonal": ("p p p", "block 0 12 0 11 0 13"),
    "slab": ("p p f", "block -3 9 -4 7 -1 14"),
    "mixed": ("p fs s", "block 0 12 0 11 0 13"),
    "tilted": ("p p p", "prism 1 13 2 13 3 16 4 -3 2"),
    "tilted_open": ("p p f", "prism 0 12 0 11 0 13 5 0 0"),
}
# A spacing, mass and time step for which a soft lattice moves a little and stays whole, in each style's own numbers.
STYLES = ("lj", "metal", "real", "si", "electron")


def run(lmp, folder, style, box):
    """A soft, warm crystal after some steps; every kind of file at the last step. Returns what LAMMPS has in memory."""
    boundary, region = BOXES[box]
    lmp.commands_string(f"""
        units {style}
        atom_style full
        boundary {boundary}
        region box {region}
        create_box 2 box
        lattice sc {3.0 if style != "lj" else 1 / 27}
        region inside {region.split()[0]} {" ".join(region.split()[1:])}
        create_atoms 1 region inside
        set group all type/fraction 2 0.4 99
        set type 1 charge 0.5
        set type 2 charge -0.25
        set group all image 1 NULL NULL
        mass 1 2.5
        mass 2 1.25
        pair_style zero 2.0
        pair_coeff * *
        displace_atoms all random 0.4 0.4 0.4 11
        displace_atoms all move 6 0 0
        velocity all set 0.3 -0.2 0.1
        fix pull all setforce 0.5 -0.25 0.125
        fix move all nve
        timestep 0.001
        thermo_modify lost ignore
        dump text all custom 2 {folder}/text.dump type vz id xu x y z vx vy fx fy fz q ix iy iz mol mass
        dump_modify text format float %.17g units yes time yes
        dump zipped all custom 2 {folder}/zip.dump.gz id type xs ys zs ix iy iz
        dump_modify zipped format float %.17g
        dump unwrapped all custom 2 {folder}/xsu.dump id type xsu ysu zsu
        dump_modify unwrapped format float %.17g units yes
        dump plain all custom 2 {folder}/xu.dump id type element xu yu zu
        dump_modify plain units yes element Si C
        dump atoms all atom 2 {folder}/atom.dump
        dump binary all custom 2 {folder}/custom.bin id type x y z vx vy vz fx fy fz q ix iy iz mass
        dump_modify binary units yes time yes
        dump short all atom 2 {folder}/atom.bin
        dump_modify short image yes
        run 6 post no
    """)
    n = lmp.extract_global("nlocal")
    order = np.argsort(np.array(lmp.numpy.extract_atom("id")[:n]))
    get = {
        k: np.array(lmp.numpy.extract_atom(k))[:n][order]
        for k in ("id", "type", "x", "v", "f", "q", "mass", "image")
        if k not in ("mass", "image")
    }
    packed = np.array(lmp.numpy.extract_atom("image"))[:n][order].astype(np.int64)
    get["image"] = np.stack(
        [(packed & 1023) - 512, (packed >> 10 & 1023) - 512, (packed >> 20) - 512], 1
    )  # SMALLBIG packing
    lo, hi, xy, yz, xz, periodic, _ = lmp.extract_box()
    get["vectors"] = np.array([[hi[0] - lo[0], 0, 0], [xy, hi[1] - lo[1], 0], [xz, yz, hi[2] - lo[2]]])
    get["origin"], get["periodic"] = np.array(lo), np.array(periodic, bool)
    lmp.command(f"write_data {folder}/end.data")  # wraps the atoms and shrink-wraps the box first
    lo, hi, xy, yz, xz, *_ = lmp.extract_box()
    get["vectors_end"] = np.array([[hi[0] - lo[0], 0, 0], [xy, hi[1] - lo[1], 0], [xz, yz, hi[2] - lo[2]]])
    return get


@pytest.fixture(
    scope="module",
    params=[*((s, "tilted") for s in STYLES), *(("metal", b) for b in BOXES if b != "tilted")],
    ids="-".join,
)
def written(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lammps")
    style, box = request.param
    with lammps_session() as lmp:
        memory = run(lmp, folder, style, box)
    return folder, units(style), memory


def same_box(frame, u, memory):
    # Bounds are printed with 17 digits, but as those of the bounding box: a rounding or two of numbers up to 30.
    np.testing.assert_allclose(frame.cell.vectors, memory["vectors"] * u.length, rtol=0, atol=2e-14 * u.length)
    np.testing.assert_allclose(frame.cell.origin, memory["origin"] * u.length, rtol=0, atol=2e-14 * u.length)
    np.testing.assert_array_equal(frame.cell.periodic, memory["periodic"])


def test_text_dump(written):
    folder, u, memory = written
    traj = atc.read(folder / "text.dump")
    assert isinstance(traj, LammpsDump) and len(traj) == 4
    f = traj[-1]
    assert f.units is u and f.step == 6 and f.time == pytest.approx(0.006 * u.time)
    same_box(f, u, memory)
    np.testing.assert_array_equal(f.ids, memory["id"])
    np.testing.assert_array_equal(f.types, memory["type"])
    # 17 digits are exact, but LAMMPS takes tilted boxes apart and together again after the dump: a few ulp of numbers
    # up to 20.
    np.testing.assert_allclose(f.positions, memory["x"] * u.length, rtol=0, atol=1e-14 * u.length)
    np.testing.assert_array_equal(f.velocities, memory["v"] * u.velocity)
    np.testing.assert_array_equal(f.forces, memory["f"] * u.factor("force"))
    np.testing.assert_array_equal(f.charges, memory["q"] * u.charge)
    np.testing.assert_array_equal(f.images, memory["image"])
    assert f.images.any()
    np.testing.assert_array_equal(f.masses, np.array([2.5, 1.25])[memory["type"] - 1] * u.mass)
    assert set(f.extra) == {"xu", "mol"}


def test_scaled_unwrapped_and_zipped(written):
    folder, u, memory = written
    style = u.name
    near = 1e-13 * u.length  # xs was divided by and is multiplied with a box of size 13
    f = atc.read(folder / "zip.dump.gz", units=style)[-1]
    same_box(f, u, memory)
    np.testing.assert_allclose(f.positions, memory["x"] * u.length, rtol=0, atol=near)
    np.testing.assert_array_equal(f.images, memory["image"])
    unwrapped = (memory["x"] + memory["image"] @ memory["vectors"]) * u.length
    f = atc.read(folder / "xsu.dump")[-1]
    # LAMMPS adds 512 + image to the fraction and takes 512 away: half an ulp of 512, times box lengths and tilts up to
    # 13 + 4 + 3.
    np.testing.assert_allclose(f.positions, unwrapped, rtol=0, atol=5.7e-14 * 20 * u.length)
    assert f.images is None
    traj = atc.read(folder / "xu.dump")
    f = traj[-1]
    assert f.type_names == {1: "Si", 2: "C"}
    # %g: six digits of numbers up to 30
    np.testing.assert_allclose(f.positions, unwrapped, rtol=0, atol=0.51e-4 * u.length)
    assert traj.info()["coordinate_resolution"] == pytest.approx(1e-4)
    f = atc.read(folder / "atom.dump", units=style)[-1]
    np.testing.assert_allclose(
        f.positions, memory["x"] * u.length, rtol=0, atol=0.51e-5 * 20 * u.length
    )  # %g of up to 1.1


def test_binary_dumps(written):
    folder, u, memory = written
    traj = atc.read(folder / "custom.bin")
    assert isinstance(traj, LammpsBinaryDump) and len(traj) == 4
    f = traj[-1]
    assert traj.frames_parsed == 1 and f.step == 6 and f.time == pytest.approx(0.006 * u.time)
    same_box(f, u, memory)
    np.testing.assert_array_equal(f.ids, memory["id"])
    np.testing.assert_array_equal(f.types, memory["type"])
    np.testing.assert_allclose(f.positions, memory["x"] * u.length, rtol=0, atol=1e-14 * u.length)
    np.testing.assert_array_equal(f.velocities, memory["v"] * u.velocity)
    np.testing.assert_array_equal(f.forces, memory["f"] * u.factor("force"))
    np.testing.assert_array_equal(f.charges, memory["q"] * u.charge)
    np.testing.assert_array_equal(f.images, memory["image"])
    np.testing.assert_array_equal(f.masses, np.array([2.5, 1.25])[memory["type"] - 1] * u.mass)
    assert [g.step for g in traj[::-1]] == [6, 4, 2, 0]
    short = atc.read(folder / "atom.bin", units=u.name, topology=folder / "end.data")[-1]
    np.testing.assert_allclose(short.positions, memory["x"] * u.length, rtol=0, atol=1e-13 * u.length)
    np.testing.assert_array_equal(short.images, memory["image"])
    np.testing.assert_allclose(short.masses, np.array([2.5, 1.25])[memory["type"] - 1] * u.mass)
    zipped = folder / "copy.bin.gz"
    zipped.write_bytes(gzip.compress((folder / "custom.bin").read_bytes()))
    np.testing.assert_array_equal(atc.read(zipped)[-1].positions, f.positions)


def test_data_file_alone_and_as_topology(written):
    folder, u, memory = written
    traj = atc.read(folder / "end.data")  # write_data says the units in its first line
    assert len(traj) == 1 and traj.units is u
    f = traj[-1]
    np.testing.assert_array_equal(f.ids, memory["id"])
    np.testing.assert_array_equal(f.types, memory["type"])
    # write_data wraps the atoms first, and prints 16 or 17 digits, depending on the version: a few ulp of numbers up to
    # 40.
    unwrapped = memory["x"] + memory["image"] @ memory["vectors"]
    np.testing.assert_allclose(
        f.positions + f.images @ f.cell.vectors, unwrapped * u.length, rtol=0, atol=3e-14 * u.length
    )
    np.testing.assert_allclose(f.velocities, memory["v"] * u.velocity, rtol=2e-15)
    np.testing.assert_allclose(f.charges, memory["q"] * u.charge, rtol=2e-15)
    np.testing.assert_allclose(f.masses, np.array([2.5, 1.25])[memory["type"] - 1] * u.mass, rtol=2e-15)
    np.testing.assert_allclose(f.cell.vectors, memory["vectors_end"] * u.length, rtol=0, atol=1e-14 * 30 * u.length)
    assert f.cell.periodic.all()
    # Units of the dump from the data file; masses and charges as well.
    g = atc.read(folder / "atom.dump", topology=folder / "end.data")[-1]
    np.testing.assert_array_equal(g.masses, f.masses)
    np.testing.assert_array_equal(g.charges, f.charges)
    with pytest.raises(AtcError, match="says its units are"):
        atc.read(folder / "atom.dump", topology=folder / "end.data", units="cgs")


def test_general_triclinic(tmp_path):
    """One run written in LAMMPS's rotated frame and in the user's: the same fractional positions, and vectors turned
    alike."""
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units metal
            lattice custom 5.4 a1 1 0.2 0 a2 -0.2 0.9 0.1 a3 0.1 0.1 1.1 basis 0 0 0 basis 0.4 0.5 0.3 triclinic/general
            create_box 1 NULL 0 2 0 2 0 2
            create_atoms 1 box
            mass 1 28
            pair_style zero 4
            pair_coeff * *
            velocity all create 300 1
            dump g all custom 1 {tmp_path}/g.dump id type x y z vx vy vz ix iy iz
            dump_modify g units yes triclinic/general yes format float %.17g
            dump r all custom 1 {tmp_path}/r.dump id type x y z vx vy vz
            dump_modify r units yes format float %.17g
            dump b all custom 1 {tmp_path}/g.bin id type x y z vx vy vz
            dump_modify b units yes triclinic/general yes
            run 0 post no
            write_data {tmp_path}/g.data triclinic/general
        """)
    want = np.array([[1, 0.2, 0], [-0.2, 0.9, 0.1], [0.1, 0.1, 1.1]]) * 5.4 * 2
    restricted = atc.read(tmp_path / "r.dump")[0]
    for name in ("g.dump", "g.bin", "g.data"):
        f = atc.read(tmp_path / name)[0]
        np.testing.assert_allclose(f.cell.vectors, want, rtol=0, atol=1e-14 * 12)
        s = f.cell.fractional(f.positions)
        np.testing.assert_allclose(s, restricted.cell.fractional(restricted.positions), rtol=0, atol=1e-14)
        # Components along the edges do not know about the rotation.
        np.testing.assert_allclose(
            f.velocities @ f.cell.vectors.T, restricted.velocities @ restricted.cell.vectors.T, rtol=0, atol=1e-13
        )


def test_molecule_with_every_kind_of_bonded_term_and_type_labels(tmp_path):
    (tmp_path / "in.data").write_text(
        "a chain of four\n\n4 atoms\n2 atom types\n3 bonds\n2 bond types\n2 angles\n1 angle types\n1 dihedrals\n1 "
        "dihedral types\n1 impropers\n1 improper types\n"
        "0 20 xlo xhi\n0 20 ylo yhi\n0 20 zlo zhi\n\nAtom Type Labels\n\n1 C2\n2 Hx\n\nBond Type Labels\n\n1 C2-C2\n2 "
        "C2-Hx\n\n"
        "Masses\n\nC2 12.0\nHx 1.0\n\nAtoms # full\n\n30 7 C2 -0.5 1 1 1 0 0 0\n10 7 C2 0.25 2.5 1 1\t0 1 0 # a "
        "comment\n20 7 Hx 0.25 2.5 2.5 1 0 0 -1\n40 7 Hx 0 4 2.5 2 0 0 0\n\n"
        "Bonds\n\n1 C2-C2 30 10\n2 C2-Hx 10 20\n3 2 20 40\n\nAngles\n\n1 1 30 10 20\n2 1 10 20 40\n\nDihedrals\n\n1 1 "
        "30 10 20 40\n\nImpropers\n\n1 1 10 30 20 40\n"
    )
    data = (tmp_path / "in.data").read_text().replace("0 1 0 # a comment", "0 1 0")
    (tmp_path / "plain.data").write_text(data)
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units real
            atom_style full
            bond_style zero
            angle_style zero
            dihedral_style zero
            improper_style zero
            pair_style zero 5
            read_data {tmp_path}/plain.data
            pair_coeff * *
            bond_coeff *
            angle_coeff *
            dihedral_coeff *
            improper_coeff *
            dump d all custom 1 {tmp_path}/d.dump id x y z
            dump_modify d format float %.17g
            run 0 post no
            write_data {tmp_path}/out.data
            write_data {tmp_path}/nolabels.data types numeric
        """)
    for name in ("in.data", "out.data", "nolabels.data"):
        frame = atc.read(tmp_path / name, units="real")[0]
        assert frame.ids.tolist() == [10, 20, 30, 40] and frame.types.tolist() == [1, 2, 1, 2]
        assert frame.masses.tolist() == [12, 1, 12, 1] and frame.charges.tolist() == [0.25, 0.25, -0.5, 0]
        if name != "nolabels.data":
            assert frame.type_names == {1: "C2", 2: "Hx"}
        assert frame.images.tolist() == [[0, 1, 0], [0, 0, -1], [0, 0, 0], [0, 0, 0]]
        dumped = atc.read(tmp_path / "d.dump", topology=tmp_path / name, units="real")[0]
        np.testing.assert_array_equal(dumped.positions, frame.positions)
        assert dumped.types.tolist() == [1, 2, 1, 2] and dumped.masses.tolist() == [12, 1, 12, 1]
        assert dumped.charges.tolist() == [0.25, 0.25, -0.5, 0]
        for t in (frame.topology, dumped.topology):
            order = np.argsort(t.bond_types, kind="stable")
            assert sorted(zip(t.bond_types.tolist(), map(tuple, np.sort(t.bonds, axis=1).tolist()))) == [
                (1, (0, 2)),
                (2, (0, 1)),
                (2, (1, 3)),
            ]
            assert len(order) == 3
            assert sorted(map(tuple, t.angles.tolist())) == [(0, 1, 3), (2, 0, 1)]
            assert t.dihedrals.tolist() == [[2, 0, 1, 3]] and t.impropers.tolist() == [[0, 2, 1, 3]]
            assert (
                t.angle_types.tolist() == [1, 1]
                and t.dihedral_types.tolist() == [1]
                and t.improper_types.tolist() == [1]
            )


def test_bonded_atoms_that_are_not_in_the_frame(tmp_path):
    (tmp_path / "m.data").write_text(
        "x\n\n3 atoms\n1 atom types\n1 bonds\n1 bond types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\nMasses\n\n1 "
        "1\n\nAtoms # bond\n\n"
        "1 1 1 1 1 1\n2 1 1 2 1 1\n3 1 1 3 1 1\n\nBonds\n\n1 1 1 3\n"
    )
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\nITEM: ATOMS "
    (tmp_path / "part.dump").write_text(head + "id type x y z\n1 1 1 1 1\n2 1 2 1 1\n")
    (tmp_path / "other.dump").write_text(head + "id x y z\n1 1 1 1\n7 2 1 1\n")
    (tmp_path / "noid.dump").write_text(head + "type x y z\n1 1 1 1\n1 2 1 1\n")
    with pytest.raises(
        AtcError, match=r"part.dump frame 0: atom 3 of bond 1 in .*m.data is not in the frame; dump all bonded atoms"
    ):
        atc.read(tmp_path / "part.dump", topology=tmp_path / "m.data", units="lj")[0]
    with pytest.raises(AtcError, match=r"other.dump frame 0: atom 7 is not in .*m.data, which should give its types"):
        atc.read(tmp_path / "other.dump", topology=tmp_path / "m.data", units="lj")[0]
    with (
        pytest.warns(AtcWarning),
        pytest.raises(AtcError, match=r"noid.dump frame 0: a topology needs the 'id' column"),
    ):
        atc.read(tmp_path / "noid.dump", topology=tmp_path / "m.data", units="lj")[0]


# Binary files: damage and the old format
# --------------------------------------------------------------------------------------------------


def test_damaged_binary_dumps(tmp_path):
    with lammps_session() as lmp:
        run(lmp, tmp_path, "metal", "orthogonal")
    data = (tmp_path / "custom.bin").read_bytes()
    path = tmp_path / "cut.bin"
    whole = len(atc.read(tmp_path / "custom.bin"))
    frame = len(data) // whole
    for cut in (frame * 3 + 4, frame * 3 + 60, len(data) - frame // 2, len(data) - 1):
        path.write_bytes(data[:cut])
        with pytest.warns(
            AtcWarning, match=r"cut.bin: its last frame \(number 3, from byte \d+\) is not complete and is left out"
        ):
            assert len(atc.read(path)) == 3
    second = data.index(b"DUMPCUSTOM", 100) - 8
    for at, what in (
        (9, "magic string"),
        (18, "byte-order marker"),
        (34, "atoms are there but"),
        (42, "not the header of a frame"),
    ):
        bad = bytearray(data)
        bad[second + at] ^= 0x55
        path.write_bytes(bytes(bad))
        with pytest.raises(AtcError, match=rf"cut.bin, frame 1, byte \d+: .*{what}"):
            len(atc.read(path))
    value = struct.pack("<d", float("nan"))
    path.write_bytes(data[:-8] + value)
    assert len(atc.read(path)) == 4
    columns = 16
    nan_x = data[: len(data) - 8 * (columns - 2)] + value + data[len(data) - 8 * (columns - 3) :]
    path.write_bytes(nan_x)
    with pytest.raises(AtcError, match=r"cut.bin frame 3: atom \d+ has positions that are not finite"):
        atc.read(path)[3]
    nan_id = data[: len(data) - 8 * columns] + value + data[len(data) - 8 * (columns - 1) :]
    path.write_bytes(nan_id)
    with pytest.raises(
        AtcError, match=r"cut.bin frame 3, atom \d+ of the file: column 'id' holds nan, expected an integer"
    ):
        atc.read(path)[3]
    path.write_bytes(b"\x00" * 50)
    with pytest.raises(AtcError, match="not a LAMMPS dump"):
        atc.read(path, units="metal")


def old_binary(x, ids, lo, hi, endian="<", tilt=None, images=None, chunks=1):
    """The format before 2020: no magic string, no column names."""
    n = len(x)
    columns = [ids, np.ones(n), *x.T] + ([] if images is None else list(images.T))
    table = np.column_stack(columns).astype(float)
    out = struct.pack(endian + "qqi6i", 77, n, int(tilt is not None), 0, 0, 0, 0, 1, 1)
    out += struct.pack(endian + "6d", *np.column_stack([lo, hi]).ravel())
    if tilt is not None:
        out += struct.pack(endian + "3d", *tilt)
    out += struct.pack(endian + "ii", table.shape[1], chunks)
    for part in np.array_split(table, chunks):
        out += struct.pack(endian + "i", part.size) + part.astype(endian + "f8").tobytes()
    return out


@pytest.mark.parametrize("endian", "<>")
@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("chunks", [1, 3])
def test_old_binary_format(tmp_path, endian, scaled, chunks):
    rng = np.random.default_rng(0)
    n, lo, hi = 200, np.array([-1.0, 2, 3]), np.array([19.0, 20, 30])
    s = rng.random((n, 3))
    images = rng.integers(-2, 3, (n, 3))
    ids = rng.permutation(n) + 1
    x = s if scaled else lo + s * (hi - lo)
    path = tmp_path / "old.bin"
    path.write_bytes(2 * old_binary(x, ids, lo, hi, endian, images=images if scaled else None, chunks=chunks))
    traj = atc.read(path, units="lj")
    assert len(traj) == 2
    f = traj[1]
    order = np.argsort(ids)
    np.testing.assert_allclose(f.positions, (lo + s * (hi - lo))[order], rtol=0, atol=1e-14)
    assert f.step == 77 and f.cell.periodic.tolist() == [True, True, False]
    if scaled:
        np.testing.assert_array_equal(f.images, images[order])


def test_old_binary_format_that_cannot_be_told(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "old.bin"
    path.write_bytes(old_binary(rng.random((10, 3)), np.arange(10) + 1, np.zeros(3), np.ones(3)))
    with pytest.raises(AtcError, match=r"does not name its columns.*binary2txt"):
        atc.read(path, units="lj")[0]
    with pytest.raises(AtcError, match="its units are not in the file"):
        atc.read(path)


HYBRID = """units lj
atom_style hybrid {styles}
region b block 0 5 0 5 0 5
create_box 1 b bond/types 1 extra/bond/per/atom 2
create_atoms 1 single 1 1 1
create_atoms 1 single 2.25 1 1
create_atoms 1 single 4.5 4.5 0.5
set atom 1*2 charge -0.5
set group all image 1 -1 2
set group all diameter 1.25
set group all density 0.75
mass * 2.0
bond_style harmonic
bond_coeff 1 1 1
create_bonds single/bond 1 1 2
pair_style zero 2
pair_coeff * *
write_data {path}
"""


@pytest.mark.parametrize("styles", ["sphere charge bond", "charge sphere molecular", "full sphere", "bond sphere full"])
def test_hybrid_atom_styles(tmp_path, styles):
    """LAMMPS writes 'Atoms # hybrid' and nothing of the sub-styles: with their names behind it everything is read,
    without them it is said."""
    path = tmp_path / "h.data"
    with lammps_session() as lmp:
        lmp.commands_string(HYBRID.format(styles=styles, path=path))
    with pytest.warns(AtcWarning, match="does not name its sub-styles"):
        frame = atc.read(path)[0]
    assert frame.charges is None and frame.images is None
    np.testing.assert_allclose(frame.positions, [[1, 1, 1], [2.25, 1, 1], [4.5, 4.5, 0.5]])
    path.write_text(path.read_text().replace("Atoms # hybrid", f"Atoms # hybrid {styles}"))
    frame = atc.read(path)[0]
    np.testing.assert_array_equal(frame.charges, [-0.5, -0.5, 0.0])
    np.testing.assert_array_equal(frame.images, [[1, -1, 2]] * 3)
    np.testing.assert_allclose(frame.masses, np.pi / 6 * 1.25**3 * 0.75, rtol=1e-14)
    assert frame.topology.bonds.tolist() == [[0, 1]]
