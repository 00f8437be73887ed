"""Every other file of atoms that LAMMPS writes (dcd, extxyz, yaml, cfg, plain xyz) against the arrays in its memory,
frame by frame."""

import bz2
import gzip
import lzma
import pickle
import struct
import warnings

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError, AtcWarning
from atc.readers.lammps.cfg import LammpsCfg
from atc.readers.lammps.dcd import LammpsDcd
from atc.readers.lammps.yaml import LammpsYamlDump
from atc.readers.xyz import ExtendedXyz
from atc.units import units

BOXES = {"orthogonal": ("p p f", "block 0 12 0 11 0 13"), "tilted": ("p p p", "prism 1 13 2 13 3 16 4 -3 2")}
TIMESTEP = 1 / 64  # times are exact, also with six decimals
STEPS = (10, 12, 14, 16)


def run(lmp, folder, style, box):
    """A soft, warm crystal that drifts across faces; all formats every second step. Returns LAMMPS's memory at each of
    those steps."""
    boundary, region = BOXES[box]
    lmp.commands_string(f"""
        units {style}
        atom_style charge
        atom_modify map array sort 2 1.0
        boundary {boundary}
        region box {region}
        create_box 2 box
        labelmap atom 1 Si 2 "C'"
        lattice sc {3.0 if style != "lj" else 1 / 27}
        region inside block 4 11 3 9 4 12 units box
        create_atoms 1 region inside
        set group all type/fraction 2 0.4 99
        set type 1 charge 0.5
        set type 2 charge -0.25
        mass 1 28.5
        mass 2 12.25
        pair_style zero 1.0
        pair_coeff * *
        displace_atoms all random 0.4 0.4 0.4 11
        velocity all set 60 -40 0 units box
        velocity all ramp vx 0 9 y 0 10 sum yes units box
        fix pull all setforce 0.5 -0.25 0.125
        fix move all nve
        timestep {TIMESTEP}
        reset_timestep 10
        dump w all dcd 2 {folder}/w.dcd
        dump u all dcd 2 {folder}/u.dcd
        dump_modify u unwrap yes
        dump y all yaml 2 {folder}/t.yaml id type x y z vx vy vz fx fy fz q ix iy iz mass
        dump_modify y units yes time yes thermo yes format float %.17g
        dump yb all yaml 2 {folder}/bare.yaml id type xs ys zs
        dump e all extxyz 2 {folder}/t.extxyz
        dump_modify e vel yes forces yes mass yes format line "%s{10 * " %.17g"}"
        dump eb all extxyz 2 {folder}/bare.extxyz
        dump_modify eb vel no forces no element Si C
        dump x all xyz 2 {folder}/plain.xyz
        dump_modify x format line "%s %.17g %.17g %.17g"
        dump xe all xyz 2 {folder}/named.xyz
        dump_modify xe element Si C
        dump c all cfg 2 {folder}/c.*.cfg mass type xs ys zs id type vx vy vz fx fy fz q x ix iy iz
        dump_modify c format float %.17g element Si C
        dump cu all cfg 2 {folder}/u.*.cfg mass type xsu ysu zsu id
        dump_modify cu format float %.17g element Si C
        dump cn all cfg 2 {folder}/n.*.cfg mass type xs ys zs id
        write_data {folder}/start.data nocoeff
    """)
    memory = []
    for k in range(len(STEPS)):
        lmp.command(f"run {2 if k else 0} post no")
        n = lmp.extract_global("nlocal")
        order = np.argsort(np.array(lmp.numpy.extract_atom("id")[:n]))
        get = {name: np.array(lmp.numpy.extract_atom(name))[:n][order] for name in ("id", "type", "x", "v", "f", "q")}
        packed = np.array(lmp.numpy.extract_atom("image"))[:n][order].astype(np.int64)
        get["image"] = np.stack([(packed & 1023) - 512, (packed >> 10 & 1023) - 512, (packed >> 20) - 512], 1)
        get["mass"] = np.array([28.5, 12.25])[get["type"] - 1]
        lo, hi, xy, yz, xz, periodic, _ = lmp.extract_box()
        get["vectors"] = np.array([[hi[0] - lo[0], 0, 0], [xy, hi[1] - lo[1], 0], [xz, yz, hi[2] - lo[2]]])
        get["origin"], get["periodic"] = np.array(lo), np.array(periodic, bool)
        memory.append(get)
    assert memory[-1]["image"].any()
    return memory


@pytest.fixture(scope="module", params=["metal-tilted", "lj-orthogonal", "real-tilted", "electron-orthogonal"])
def written(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    style, box = request.param.split("-")
    with lammps_session() as lmp:
        memory = run(lmp, folder, style, box)
    return folder, units(style), memory


def same(frame, u, m, position=1e-14, cell=2e-14, velocities=0.0):
    """Positions within `position` of the run's (in its units, absolutely); None: not compared."""
    np.testing.assert_allclose(frame.cell.vectors, m["vectors"] * u.length, rtol=0, atol=cell * u.length)
    if position is not None:
        np.testing.assert_allclose(frame.positions, m["x"] * u.length, rtol=0, atol=position * u.length)
    if velocities is not None:
        np.testing.assert_allclose(frame.velocities, m["v"] * u.velocity, rtol=velocities, atol=0)
        np.testing.assert_allclose(frame.forces, m["f"] * u.factor("force"), rtol=velocities, atol=0)
        np.testing.assert_array_equal(frame.masses, m["mass"] * u.mass)


def test_yaml(written):
    folder, u, memory = written
    traj = atc.read(folder / "t.yaml")
    assert isinstance(traj, LammpsYamlDump) and len(traj) == 4 and traj.units is u
    for f, m, step in zip(traj, memory, STEPS, strict=True):
        same(f, u, m, velocities=1e-15)
        assert f.step == step and f.time == step * TIMESTEP * u.time
        np.testing.assert_allclose(f.cell.origin, m["origin"] * u.length, rtol=0, atol=2e-14 * u.length)
        np.testing.assert_array_equal(f.cell.periodic, m["periodic"])
        np.testing.assert_array_equal(f.ids, m["id"])
        np.testing.assert_array_equal(f.types, m["type"])
        np.testing.assert_array_equal(f.images, m["image"])
        np.testing.assert_array_equal(f.charges, m["q"] * u.charge)
    assert traj.info()["coordinate_resolution_from"].endswith("significant digits")
    bare = atc.read(folder / "bare.yaml", units=u.name)
    same(bare[-1], u, memory[-1], position=2e-5, velocities=None)  # six digits of scaled coordinates
    assert bare[-1].time is None
    with pytest.raises(AtcError, match="its units are not in the file"):
        atc.read(folder / "bare.yaml")
    # Random access, pickles and compression, as for text dumps.
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(traj[::2]))[1].positions, traj[2].positions)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
def test_compressed_yaml_extxyz_and_dcd(written, tmp_path, pack):
    folder, u, memory = written
    for name in ("t.yaml", "t.extxyz", "w.dcd"):
        (tmp_path / name).write_bytes(pack((folder / name).read_bytes()))
        a, b = atc.read(tmp_path / name, units=u.name), atc.read(folder / name, units=u.name)
        assert len(a) == len(b) == 4
        np.testing.assert_array_equal(a[3].positions, b[3].positions)
        np.testing.assert_array_equal(a[1].positions, b[1].positions)


def test_cut_yaml_at_every_place(written, tmp_path):
    folder, u, memory = written
    data = (folder / "t.yaml").read_bytes()
    start = data.rindex(b"---")
    path = tmp_path / "t.yaml"
    for cut in range(start + 1, len(data), 7):
        path.write_bytes(data[:cut])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            n = len(atc.read(path))
        whole = cut >= len(data) - 1  # only the line end behind "..." is missing
        assert n == 3 + whole and len(caught) == 1 - whole, cut


@pytest.mark.parametrize("name", ["w.dcd", "u.dcd"])
def test_dcd(written, name):
    folder, u, memory = written
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        traj = atc.read(folder / name, units=u.name, topology=folder / "start.data")
        assert isinstance(traj, LammpsDcd) and len(traj) == 4
    for f, m, step in zip(traj, memory, STEPS, strict=True):
        x = m["x"] + (m["image"] @ m["vectors"] if name == "u.dcd" else 0.0)
        # float32 of numbers up to 50; the cell from cosines, three roundings of 20
        same(f, u, {**m, "x": x}, position=4e-6, cell=2e-14, velocities=None)
        assert f.step == step and f.time == pytest.approx(step * TIMESTEP * u.time, rel=1e-15)
        np.testing.assert_array_equal(f.ids, m["id"])
        np.testing.assert_array_equal(f.types, m["type"])
        np.testing.assert_array_equal(f.masses, m["mass"] * u.mass)
        np.testing.assert_array_equal(f.charges, m["q"] * u.charge)
    with pytest.raises(AtcError, match="its units are not in the file; give the unit style"):
        atc.read(folder / name)
    with pytest.warns(AtcWarning, match="holds no types"):
        alone = atc.read(folder / name, units=u.name)[0]
    assert alone.masses is None and len(alone) == len(memory[0]["id"])


def test_dcd_that_is_cut_damaged_or_of_other_atoms(written, tmp_path):
    folder, u, memory = written
    data = (folder / "w.dcd").read_bytes()
    n = len(memory[0]["id"])
    size = 56 + 3 * (8 + 4 * n)
    path = tmp_path / "t.dcd"
    for cut in (1, 4, size // 2, size - 1):
        path.write_bytes(data[:-cut])
        with pytest.warns(
            AtcWarning, match=r"t.dcd: its last frame \(number 3, from byte \d+\) is not complete and is left out"
        ):
            assert len(atc.read(path, units=u.name)) == 3
    bad = bytearray(data)
    bad[20:24] = struct.pack("<i", 99)  # the last step: no longer first + 3 intervals
    path.write_bytes(bytes(bad))
    with pytest.warns(AtcWarning, match="its frames have neither step nor time"):
        traj = atc.read(path, units=u.name)
        assert len(traj) == 4 and traj[-1].step is None and traj[-1].time is None
    body = len(data) - 4 * size
    for at, what in (
        (body, r"frame 0, byte \d+: a record of 12345678 bytes, expected 48; the file is damaged"),
        (body + 56, r"frame 0, byte \d+: a record of 12345678 bytes"),
        (body - 8, "holds no complete frame"),  # the number of atoms
        (body - 12, r"byte \d+: a record of 12345678 bytes where at most 4 are expected"),
        (88, r"byte \d+: a record that ends with another length than it begins with"),
    ):
        bad = bytearray(data)
        bad[at : at + 4] = struct.pack("<i", 12345678)
        path.write_bytes(bytes(bad))
        with warnings.catch_warnings(), pytest.raises(AtcError, match=what):
            warnings.simplefilter("ignore")
            atc.read(path, units=u.name)[0]
    other = (
        "x\n\n1 atoms\n1 atom types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\nMasses\n\n1 1\n\nAtoms # charge\n\n1 1 "
        "0 1 1 1\n"
    )
    (tmp_path / "other.data").write_text(other)
    with pytest.raises(AtcError, match=rf"w.dcd: {n} atoms, but .*other.data holds 1"):
        atc.read(folder / "w.dcd", units=u.name, topology=tmp_path / "other.data")
    import MDAnalysis

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(str(folder / "w.dcd"))
    with pytest.raises(AtcError, match="a DCD that LAMMPS wrote, whose units MDAnalysis does not know"):
        atc.read(universe)


def test_dcd_whose_steps_are_not_even(tmp_path):
    """`first yes` between two multiples: 3, 4, 6, 8. What the header says of its steps contradicts itself."""
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units lj
            region b block 0 4 0 4 0 4
            create_box 1 b
            create_atoms 1 single 1 1 1
            create_atoms 1 single 2 2 2
            mass 1 1
            pair_style zero 1
            pair_coeff * *
            fix 1 all nve
            reset_timestep 3
            dump d all dcd 2 {tmp_path}/t.dcd
            dump_modify d first yes
            run 5 post no
        """)
    with pytest.warns(AtcWarning, match="not evenly spaced"):
        traj = atc.read(tmp_path / "t.dcd", units="lj")
        assert len(traj) == 4 and [f.step for f in traj] == [None] * 4 and [f.time for f in traj] == [None] * 4


def test_extxyz(written):
    folder, u, memory = written
    with pytest.raises(
        AtcError,
        match="was written by LAMMPS in the units of its run, which it does not say: give them, e.g. units='metal'",
    ):
        atc.read(folder / "t.extxyz")
    with pytest.raises(AtcError, match="never ASE's"):
        atc.read(folder / "t.extxyz", units="ase")
    traj = atc.read(folder / "t.extxyz", units=u.name)
    assert isinstance(traj, ExtendedXyz) and len(traj) == 4
    for f, m, step in zip(traj, memory, STEPS, strict=True):
        same(f, u, m, cell=6e-5, velocities=1e-15)  # the Lattice has six digits
        assert f.step == step and f.time == step * TIMESTEP * u.time
        np.testing.assert_array_equal(f.cell.periodic, m["periodic"])
        assert [f.type_names[t] for t in f.types.tolist()] == [("Si", "C'")[t - 1] for t in m["type"].tolist()]
    with_data = atc.read(folder / "t.extxyz", topology=folder / "start.data")
    assert with_data.units is u
    np.testing.assert_array_equal(with_data[2].types, memory[2]["type"])
    np.testing.assert_array_equal(with_data[2].charges, memory[2]["q"] * u.charge)
    np.testing.assert_array_equal(with_data[2].velocities, traj[2].velocities)
    bare = atc.read(folder / "bare.extxyz", units=u.name)[3]
    assert (
        bare.velocities is None and bare.forces is None and bare.masses is None and bare.time == 16 * TIMESTEP * u.time
    )
    same(bare, u, memory[3], position=6e-5, cell=6e-5, velocities=None)


def test_extxyz_of_small_times_and_shifted_open_boxes(tmp_path):
    """Six decimals leave nothing of a femtosecond in seconds; and LAMMPS does not write where an open box begins."""
    for style, box, dt in (("si", "0 4", 1e-15), ("lj", "2 6", 0.5)):
        with lammps_session() as lmp:
            lmp.commands_string(f"""
                units {style}
                boundary p p f
                region b block 0 4 0 4 {box}
                create_box 1 b
                create_atoms 1 single 1 1 {3 if style == "si" else 5}
                create_atoms 1 single 2 2 {3 if style == "si" else 5}
                mass 1 1
                pair_style zero 1
                pair_coeff * *
                fix 1 all nve
                timestep {dt}
                dump d all extxyz 1 {tmp_path}/{style}.extxyz
                dump_modify d element Ar
                run 2 post no
            """)
    with pytest.warns(AtcWarning, match="six decimals leave too little of its times"):
        traj = atc.read(tmp_path / "si.extxyz", units="si")
        assert [(f.step, f.time) for f in traj] == [(0, 0.0), (1, None), (2, None)]
    with pytest.raises(AtcError, match="atoms lie outside the box along the open axis z"):
        atc.read(tmp_path / "lj.extxyz", units="lj")[0]


@pytest.mark.parametrize("name", ["plain.xyz", "named.xyz"])
def test_plain_xyz(written, tmp_path, name):
    folder, u, memory = written
    for given in (None, u.name):
        with pytest.raises(
            AtcError,
            match=r"is a plain XYZ file of LAMMPS \(dump xyz\), which holds neither the box nor velocities: dump it "
            r"as custom",
        ):
            atc.read(folder / name, units=given)
    with pytest.warns(AtcWarning, match="its box is not in the file and is taken from"):
        traj = atc.read(folder / name, topology=folder / "start.data")
        assert len(traj) == 4
        for f, m, step in zip(traj, memory, STEPS, strict=True):
            same(f, u, m, position=1e-14 if name == "plain.xyz" else 6e-5, velocities=None)
            assert f.step == step and f.time is None
            np.testing.assert_array_equal(f.types, m["type"])
            np.testing.assert_array_equal(f.masses, m["mass"] * u.mass)
    if name == "plain.xyz":
        text = (folder / name).read_text().split("\n")
        kind, rest = text[2].split(" ", 1)
        text[2] = f"{3 - int(kind)} {rest}"
        (tmp_path / name).write_text("\n".join(text))
        with pytest.warns(AtcWarning), pytest.raises(AtcError, match="its types are not those of .*start.data"):
            atc.read(tmp_path / name, topology=folder / "start.data")[0]


def test_cfg(written, tmp_path):
    folder, u, memory = written
    # Files of one snapshot each: the pattern joins them, in the order of their steps.
    traj = atc.read(folder / "c.*.cfg", units=u.name)
    assert len(traj) == 4
    for f, m in zip(traj, memory, strict=True):
        x = m["x"] - m["origin"]  # the corner of the box is not in the file
        same(f, u, {**m, "x": x}, position=6e-5, cell=6e-5, velocities=1e-15)  # H0 has six digits
        np.testing.assert_array_equal(f.ids, m["id"])
        np.testing.assert_array_equal(f.types, m["type"])
        np.testing.assert_array_equal(f.charges, m["q"] * u.charge)
        np.testing.assert_array_equal(f.images, m["image"])
        np.testing.assert_allclose(
            f.cell.fractional(f.positions), (m["x"] - m["origin"]) @ np.linalg.inv(m["vectors"]), rtol=0, atol=1e-14
        )
        np.testing.assert_array_equal(f.extra["auxiliary x"], m["x"][:, 0])
    assert isinstance(atc.read(folder / "c.10.cfg", units=u.name), LammpsCfg)
    for k, step in enumerate(STEPS):
        f, m = atc.read(folder / f"u.{step}.cfg", units=u.name)[0], memory[k]
        x = m["x"] - m["origin"] + m["image"] @ m["vectors"]
        same(f, u, {**m, "x": x}, position=6e-4, cell=6e-5, velocities=None)
        assert [f.type_names[t] for t in f.types.tolist()] == [("Si", "C")[t - 1] for t in m["type"].tolist()]
    # Without names, LAMMPS calls all types C: only their masses differ.
    with pytest.raises(
        AtcError, match="atoms called 'C' have masses 12.25 and 28.5, so this name stands for several types"
    ):
        atc.read(folder / "n.10.cfg", units=u.name)[0]
    f = atc.read(folder / "n.10.cfg", topology=folder / "start.data")[0]
    np.testing.assert_array_equal(f.types, memory[0]["type"])
    with pytest.raises(AtcError, match="its units are not in the file"):
        atc.read(folder / "c.10.cfg")
    data = (folder / "c.10.cfg").read_bytes()
    for cut in (1, 5, 40, 300):
        (tmp_path / "t.cfg").write_bytes(data[:-cut])
        with pytest.raises(AtcError, match=r"t.cfg holds no complete frame"):
            atc.read(tmp_path / "t.cfg", units=u.name)
    for old, new, what in (
        (b"H0(1,2) = ", b"H0(1,7) = ", "expected 'Number of particles', 'A' and the nine numbers"),
        (b"H0(1,1) = 12", b"H0(1,1) = nan", "not finite"),
        (b"A = 1 ", b"A = 7 ", "LAMMPS writes 1, or 10"),
        (b"entry_count = 1", b"entry_count = 2", "entry_count is"),
        (b"28.500000 \nSi \n0.", b"28.500000 \nSi \n0.x", "column 'xs' holds '0.x"),
    ):
        assert old in data
        (tmp_path / "t.cfg").write_bytes(data.replace(old, new, 1))
        with pytest.raises(AtcError, match=what):
            atc.read(tmp_path / "t.cfg", units=u.name)[0]


def test_options_of_dump_modify(tmp_path):
    """Formats, sorting, thresholds, type labels beside types, and groups that are empty at some steps."""
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units metal
            region b block 0 4 0 4 0 4
            create_box 2 b
            labelmap atom 1 C,x] 2 H_{{1}}
            create_atoms 2 single 2 2 2
            create_atoms 1 single 1 1 1
            create_atoms 2 single 3 3 3
            mass * 1
            pair_style zero 1
            pair_coeff * *
            velocity all set 1 0 0
            fix 1 all nve
            timestep 0.5
            dump a all custom 1 {tmp_path}/a.dump id type typelabel x y z vx
            dump_modify a units yes time yes sort -4 format float %-20.12e
            dump b all custom 1 {tmp_path}/b.dump id type x y z
            dump_modify b units yes thresh x > 3
            dump bb all custom 1 {tmp_path}/b.bin id type x y z
            dump_modify bb units yes thresh x > 3
            dump by all yaml 1 {tmp_path}/b.yaml id type x y z
            dump_modify by units yes thresh x > 3
            dump c all custom 1 {tmp_path}/c.dump id type x y z
            dump_modify c units yes thresh x > 100
            dump l all atom 1 {tmp_path}/l.dump
            dump_modify l units yes scale no image yes
            run 2 post no
        """)
    f = atc.read(tmp_path / "a.dump")[1]
    assert f.ids.tolist() == [1, 2, 3] and f.types.tolist() == [2, 1, 2] and f.type_names == {1: "C,x]", 2: "H_{1}"}
    np.testing.assert_allclose(f.positions, [[2.5, 2, 2], [1.5, 1, 1], [3.5, 3, 3]], rtol=1e-12)
    assert f.time == 0.5 * f.units.time
    assert atc.read(tmp_path / "l.dump")[1].positions.tolist() == f.positions.tolist()
    for name in ("b.dump", "b.bin", "b.yaml"):
        with pytest.warns(AtcWarning, match=r"its first 1 frames hold no atoms"):
            traj = atc.read(tmp_path / name)
            assert len(traj) == 3 and [len(f) for f in traj] == [0, 1, 1]
            assert traj[2].positions.tolist() == [[4, 3, 3]] and traj.info()["atoms"] == [0, 1]
    with pytest.raises(AtcError, match="c.dump: none of its 3 frames holds an atom"):
        atc.read(tmp_path / "c.dump")
    (tmp_path / "b.extxyz").write_text('0\nLattice="4 0 0 0 4 0 0 0 4" Properties=species:S:1:pos:R:3\n')
    with pytest.raises(AtcError, match="b.extxyz, frame 0, line 1: a frame without atoms"):
        atc.read(tmp_path / "b.extxyz")
