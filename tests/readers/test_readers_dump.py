"""LAMMPS text dumps: what a small independent writer wrote comes back; every kind of damage is named with frame and
line."""

import bz2
import gzip
import lzma
import pickle
import re
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import atc
from atc.errors import AtcError, AtcWarning
from atc.units import units

PACK = {"": lambda b: b, ".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lambda b: lzma.compress(b, preset=0)}


def write_dump(frames, header_units=None):
    """Text of a dump. Each frame: step, lo, hi, tilt or None, flags, columns {name: values}, optional time. Numbers
    with 17 digits."""
    out = []
    for k, f in enumerate(frames):
        if header_units and k == 0:
            out += ["ITEM: UNITS", header_units]
        if f.get("time") is not None:
            out += ["ITEM: TIME", f"{f['time']:.16g}"]
        n = len(next(iter(f["columns"].values())))
        out += ["ITEM: TIMESTEP", str(f["step"]), "ITEM: NUMBER OF ATOMS", str(n)]
        lo, hi = np.array(f["lo"], float), np.array(f["hi"], float)
        if f.get("tilt") is None:
            out.append("ITEM: BOX BOUNDS " + f["flags"])
            out += [f"{a:.17g} {b:.17g}" for a, b in zip(lo, hi)]
        else:
            # The bounding box of the eight corners, found by looking at them.
            xy, xz, yz = f["tilt"]
            cell = np.array([[hi[0] - lo[0], 0, 0], [xy, hi[1] - lo[1], 0], [xz, yz, hi[2] - lo[2]]])
            corners = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)]) @ cell + lo
            blo, bhi = corners.min(axis=0), corners.max(axis=0)
            out.append("ITEM: BOX BOUNDS xy xz yz " + f["flags"])
            out += [f"{a:.17g} {b:.17g} {t:.17g}" for a, b, t in zip(blo, bhi, f["tilt"])]
        out.append("ITEM: ATOMS " + " ".join(f["columns"]))
        columns = [
            [v if isinstance(v, str) else f"{v:.17g}" for v in np.asarray(c).tolist()] for c in f["columns"].values()
        ]
        out += [" ".join(row) for row in zip(*columns)]
    return "\n".join(out) + "\n"


def simple(n=4, step=0, **changes):
    rng = np.random.default_rng(step)
    f = dict(step=step, lo=[0, 0, 0], hi=[10, 10, 10], flags="pp pp pp")
    f["columns"] = {"id": np.arange(1, n + 1), "type": np.ones(n, int), **dict(zip("xyz", rng.uniform(0, 10, (3, n))))}
    return {**f, **changes}


@pytest.fixture
def save(tmp_path):
    def save(text, name="t.dump"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return save


# Round trips
# ----------------------------------------------------------------------------------------------------------------------

number = st.floats(-1e3, 1e3, allow_subnormal=False)


@st.composite
def snapshots(draw):
    """Frames of one dump: same column names in one order, different atoms, boxes and steps."""
    style = draw(st.sampled_from(["x", "xu", "xs", "xsu"]))
    names = ["id", "type", *(a + style[1:] for a in "xyz")]
    images = style in ("x", "xs") and draw(st.booleans())
    velocities, forces, charge, element, other = (draw(st.booleans()) for _ in range(5))
    names += ["ix", "iy", "iz"] * images + ["vx", "vy", "vz"] * velocities + ["fx", "fy", "fz"] * forces
    names += ["q"] * charge + ["element"] * element + ["c_pe", "mol"] * other
    names = draw(st.permutations(names))
    frames = []
    for _k in range(draw(st.integers(1, 3))):
        n = draw(st.integers(1, 6))
        rng = np.random.default_rng(draw(st.integers(0, 2**32)))
        lo = np.array(draw(st.tuples(number, number, number)))
        hi = lo + np.array(draw(st.tuples(*[st.floats(0.5, 100)] * 3)))
        tilt = draw(st.none() | st.tuples(*[st.floats(-60, 60, allow_subnormal=False)] * 3))
        flags = " ".join(
            draw(st.lists(st.sampled_from(["pp", "ff", "ss", "mm", "fs", "sf", "fm"]), min_size=3, max_size=3))
        )
        vectors = np.diag(hi - lo)
        if tilt is not None:
            vectors[1, 0], vectors[2, 0], vectors[2, 1] = tilt
        s = rng.uniform(-0.5, 1.5, (n, 3))
        x = s @ vectors + lo
        ids = rng.permutation(3 * n)[:n] + 1
        data = {
            "id": ids,
            "type": rng.integers(1, 4, n),
            "q": rng.normal(size=n),
            "mol": rng.integers(0, 9, n),
            "c_pe": rng.normal(size=n),
        }
        data["element"] = rng.choice(["Si", "C", "Ge"], n)
        data |= {c + style[1:]: a for c, a in zip("xyz", (s if "s" in style else x).T)}
        for base in ("i", "v", "f"):
            data |= {base + c: (rng.integers(-5, 6, n) if base == "i" else rng.normal(size=n)) for c in "xyz"}
        time = draw(st.none() | st.floats(0, 1e6))
        columns = {name: data[name] for name in names}
        frames.append(
            dict(
                step=draw(st.integers(0, 10**12)),
                time=time,
                lo=lo,
                hi=hi,
                tilt=tilt,
                flags=flags,
                columns=columns,
                x=x,
                vectors=vectors,
            )
        )
    return frames


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    snapshots(),
    st.sampled_from(["real", "metal", "lj", "si", "nano", "electron"]),
    st.booleans(),
    st.sampled_from(list(PACK)),
)
def test_what_was_written_comes_back(tmp_path, frames, style, in_header, pack):
    path = tmp_path / f"h.dump{pack}"
    path.write_bytes(PACK[pack](write_dump(frames, style if in_header else None).encode()))
    u = units(style)
    traj = atc.read(path, units=None if in_header else style)
    assert traj.units is u and len(traj) == len(frames)
    for want, got in zip(frames, traj):
        c = want["columns"]
        order = np.argsort(c["id"])
        np.testing.assert_array_equal(got.ids, np.sort(c["id"]))
        np.testing.assert_array_equal(got.types, c["type"][order])
        # The bounding box is rounded when written and again when taken apart: a few ulp of its size, in the cell and in
        # scaled positions.
        size = np.abs([want["lo"], want["hi"]]).max() + np.abs(want["vectors"]).sum()
        near = 1e-14 * size * u.length
        np.testing.assert_allclose(got.cell.vectors, want["vectors"] * u.length, rtol=0, atol=near)
        np.testing.assert_allclose(got.cell.origin, want["lo"] * u.length, rtol=0, atol=near)
        np.testing.assert_array_equal(got.cell.periodic, [f == "pp" for f in want["flags"].split()])
        if "x" in c or "xu" in c:
            np.testing.assert_array_equal(got.positions, want["x"][order] * u.length)
        else:
            np.testing.assert_allclose(got.positions, want["x"][order] * u.length, rtol=0, atol=near)
        assert got.step == want["step"]
        assert got.time == (None if want["time"] is None else float(f"{want['time']:.16g}") * u.time)
        for name, columns, factor in (
            ("velocities", ("vx", "vy", "vz"), u.velocity),
            ("forces", ("fx", "fy", "fz"), u.energy / u.length),
            ("images", ("ix", "iy", "iz"), 1),
        ):
            a = getattr(got, name)
            if columns[0] in c:
                np.testing.assert_array_equal(a, np.stack([c[k] for k in columns], 1)[order] * factor)
            else:
                assert a is None
        if "q" in c:
            np.testing.assert_array_equal(got.charges, c["q"][order] * u.charge)
        else:
            assert got.charges is None
        assert set(got.extra) == {"element", "c_pe", "mol"} & set(c)
        for name in got.extra:
            np.testing.assert_array_equal(got.extra[name], np.asarray(c[name])[order])


def test_scaled_and_plain_positions_of_a_tilted_box_agree(save):
    f = simple(5, tilt=(3.0, -2.0, 1.5), lo=[1, 2, 3], hi=[11, 10, 12])
    vectors = np.array([[10, 0, 0], [3, 8, 0], [-2, 1.5, 9.0]])
    s = np.random.default_rng(0).random((5, 3))
    x = s @ vectors + [1, 2, 3]
    plain = {"id": np.arange(1, 6), "type": np.ones(5, int), **dict(zip("xyz", x.T))}
    scaled = {"id": np.arange(1, 6), "type": np.ones(5, int), "xs": s[:, 0], "ys": s[:, 1], "zs": s[:, 2]}
    a = atc.read(save(write_dump([{**f, "columns": plain}]), "a.dump"), units="lj")[0]
    b = atc.read(save(write_dump([{**f, "columns": scaled}]), "b.dump"), units="lj")[0]
    np.testing.assert_allclose(a.positions, b.positions, rtol=0, atol=1e-13)  # coordinates of 12, a few roundings
    np.testing.assert_allclose(a.cell.fractional(a.positions), s, rtol=0, atol=1e-14)


def test_general_triclinic_box(save):
    text = (
        "ITEM: UNITS\nlj\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS abc origin pp pp ff\n"
        "10 2 0 -1\n-2 9 1 -2\n1 1 11 -3\nITEM: ATOMS id type xs ys zs\n1 1 0.5 0.25 0.75\n"
    )
    f = atc.read(save(text))[0]
    vectors = np.array([[10, 2, 0], [-2, 9, 1], [1, 1, 11.0]])
    np.testing.assert_array_equal(f.cell.vectors, vectors)
    np.testing.assert_array_equal(f.cell.origin, [-1, -2, -3])
    np.testing.assert_array_equal(f.cell.periodic, [True, True, False])
    np.testing.assert_allclose(f.positions[0], np.array([0.5, 0.25, 0.75]) @ vectors - [1, 2, 3], rtol=1e-15)


def test_windows_line_ends_tabs_and_trailing_blanks(save):
    text = write_dump([simple(3), simple(3, 1)], "metal")
    a = atc.read(save(text, "a.dump"))
    b = atc.read(save(text.replace("\n", " \r\n").replace(" ", "\t", 0), "b.dump"))
    c = atc.read(save(text + "\n\n", "c.dump"))
    for k in range(2):
        np.testing.assert_array_equal(a[k].positions, b[k].positions)
        np.testing.assert_array_equal(a[k].positions, c[k].positions)
    assert len(a) == len(b) == len(c) == 2


# Laziness
# ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pack", list(PACK))
def test_frames_that_are_skipped_are_not_parsed(save, pack):
    path = save(PACK[pack](write_dump([simple(3 + k % 4, k) for k in range(25)]).encode()), f"t.dump{pack}")
    traj = atc.read(path, units="metal")
    assert traj[-1].step == 24 and traj.frames_parsed == 1
    assert [f.step for f in traj[::10]] == [0, 10, 20] and traj.frames_parsed == 4
    assert len(traj[2:5]) == 3 and len(traj) == 25 and traj.frames_parsed == 4
    assert [f.step for f in traj[::-8]] == [24, 16, 8, 0]
    assert [f.step for f in traj[20:][1::2][::-1]] == [23, 21]
    assert [f.step for f in traj[5:2:-1]] == [5, 4, 3]
    assert [f.step for f in traj[-3:]] == [22, 23, 24]
    assert [f.step for f in traj[23:99]] == [23, 24]
    assert not list(traj[30:]) and not list(traj[3:3])
    assert traj[2:5][-1].step == 4
    for bad in (25, -26):
        with pytest.raises(IndexError, match="has 25 frames"):
            traj[bad]
    with pytest.raises(TypeError):
        traj["3"]
    # The beginning is read without looking for the end.
    again = atc.read(path, units="metal")
    assert again[1].step == 1 and len(again._start) == 2
    assert [f.step for f in again[:6:2]] == [0, 2, 4] and len(again._start) <= 7


@pytest.mark.parametrize("pack", list(PACK))
def test_pickled_trajectories_and_views_read_on(save, pack):
    traj = atc.read(
        save(PACK[pack](write_dump([simple(4, k) for k in range(8)]).encode()), f"t.dump{pack}"), units="metal"
    )
    for there in (traj, traj[1::3]):
        copy = pickle.loads(pickle.dumps(there))
        assert [f.step for f in copy] == [f.step for f in there]
        np.testing.assert_array_equal(copy[-1].positions, there[-1].positions)


def test_large_compressed_file_random_access_and_several_streams(save, monkeypatch):
    """Frames of a .gz in any order, resumed between marks; streams one after the other, as `cat a.gz b.gz` makes."""
    import atc.readers._bytes as module

    monkeypatch.setattr(module, "_APART", 20000)
    monkeypatch.setattr(module, "_CHUNK", 1024)
    texts = [write_dump([simple(200, k)]) for k in range(20)]
    data = gzip.compress("".join(texts[:7]).encode()) + gzip.compress("".join(texts[7:]).encode()) + b"\0" * 100
    traj = atc.read(save(data, "t.dump.gz"), units="metal")
    want = {k: simple(200, k)["columns"]["x"] for k in range(20)}
    for k in [0, 19, 3, 11, 10, 18, 1]:
        np.testing.assert_array_equal(traj[k].positions[:, 0], want[k])
    assert len(traj._bytes._marks) > 3


def test_threads_share_a_trajectory(save):
    from concurrent.futures import ThreadPoolExecutor

    for pack in ("", ".gz"):
        traj = atc.read(
            save(PACK[pack](write_dump([simple(50, k) for k in range(40)]).encode()), f"t.dump{pack}"), units="metal"
        )
        with ThreadPoolExecutor(4) as pool:
            frames = list(pool.map(traj.__getitem__, range(40)))
        assert [f.step for f in frames] == list(range(40))
        for k, f in enumerate(frames):
            np.testing.assert_array_equal(f.positions[:, 0], simple(50, k)["columns"]["x"])


# Types, masses, units
# ---------------------------------------------------------------------------------------------------------------------


def test_types_from_elements_do_not_depend_on_the_order_of_reading(save):
    def frame(step, elements):
        f = simple(len(elements), step)
        del f["columns"]["type"]
        f["columns"]["element"] = np.array(elements)
        return f

    path = save(write_dump([frame(0, ["Si", "Si"]), frame(1, ["Ge", "C"]), frame(2, ["C", "Si", "Ge"])]))
    forward, backward = atc.read(path, units="metal"), atc.read(path, units="metal")
    a = [f.types.tolist() for f in forward]
    b = [f.types.tolist() for f in backward[::-1]][::-1]
    assert a == b == [[1, 1], [2, 3], [3, 1, 2]]
    assert forward[2].type_names == {1: "Si", 2: "Ge", 3: "C"}
    with_masses = atc.read(path, units="metal", masses={"Si": 28.0, "C": 12.0, "Ge": 72.0})
    np.testing.assert_array_equal(with_masses[2].masses, [12, 28, 72])


def test_element_beside_type_gives_names(save):
    f = simple(3)
    f["columns"]["type"] = np.array([2, 1, 2])
    f["columns"]["element"] = np.array(["C", "Si", "C"])
    got = atc.read(save(write_dump([f])), units="metal", masses={"Si": 28.0, "2": 12})[0]
    assert got.type_names == {1: "Si", 2: "C"}
    np.testing.assert_array_equal(got.masses, [12, 28, 12])


def test_masses_by_type_list_column_and_what_is_wrong_with_them(save):
    f = simple(3)
    f["columns"]["type"] = np.array([2, 1, 2])
    path = save(write_dump([f]))
    u = units("si")
    np.testing.assert_array_equal(atc.read(path, units="si", masses=[1.0, 3.0])[0].masses, np.array([3, 1, 3]) * u.mass)
    np.testing.assert_array_equal(
        atc.read(path, units="si", masses={1: 1.0, 2: 3.0})[0].masses, np.array([3, 1, 3]) * u.mass
    )
    f["columns"]["mass"] = np.array([5.0, 6.0, 7.0])
    column = save(write_dump([f]), "m.dump")
    np.testing.assert_array_equal(atc.read(column, units="si")[0].masses, np.array([5, 6, 7]) * u.mass)
    np.testing.assert_array_equal(atc.read(column, units="si", masses=[1, 2])[0].masses, np.array([2, 1, 2]) * u.mass)
    with pytest.raises(AtcError, match=r"t.dump frame 0: masses has no mass for type 2, only for 1; add it"):
        atc.read(path, units="si", masses=[1.0])[0]
    for bad in ([1.0, -2.0], [1.0, float("nan")], {1: "x"}, "12"):
        with pytest.raises(AtcError, match="mass"):
            atc.read(path, units="si", masses=bad)
    frame = atc.read(path, units="si")[0]
    assert frame.masses is None
    with pytest.raises(AtcError, match="masses are missing but density needs them: give a LAMMPS data file"):
        frame.require("masses", why="density")


def test_no_types_at_all(save):
    f = simple(3)
    del f["columns"]["type"]
    path = save(write_dump([f]))
    with pytest.warns(AtcWarning, match="no 'type' or 'element' column: all atoms are taken to be of type 1"):
        assert atc.read(path, units="lj")[0].types.tolist() == [1, 1, 1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert atc.read(path, units="lj", masses=[2.0])[0].masses.tolist() == [2, 2, 2]
    with pytest.raises(AtcError, match="2 masses are given but there is no 'type' or 'element' column"):
        atc.read(path, units="lj", masses=[2.0, 3.0])[0]


def test_no_ids(save):
    f = simple(3)
    del f["columns"]["id"]
    traj = atc.read(save(write_dump([f])), units="lj")
    with pytest.warns(AtcWarning, match="no 'id' column"):
        assert traj[0].ids.tolist() == [1, 2, 3]
    assert traj.info()["ids"] is False


def test_units_are_never_guessed(save):
    path = save(write_dump([simple()]))
    with pytest.raises(
        AtcError,
        match=r"t.dump: its units are not in the file; give the unit style of the LAMMPS run, e.g. units='metal'",
    ):
        atc.read(path)
    with pytest.raises(AtcError, match="unknown units 'Metal'"):
        atc.read(path, units="Metal")
    said = save(write_dump([simple()], "real"), "u.dump")
    assert atc.read(said).units.name == "real" == atc.read(said, units="real").units.name
    with pytest.raises(AtcError, match=r"u.dump says its units are 'real' but the units argument says 'metal'"):
        atc.read(said, units="metal")
    with pytest.raises(AtcError, match=r"b.dump: unknown units 'banana'"):
        atc.read(save(write_dump([simple()], "banana"), "b.dump"))
    two = write_dump([simple()], "real") + write_dump([simple(step=1)], "metal")
    with pytest.raises(AtcError, match=r"frame 1, line 16: the units change from 'real' to 'metal'"):
        len(atc.read(save(two, "two.dump")))


# Damage
# ----------------------------------------------------------------------------------------------------------------------

THREE = write_dump([simple(4, k) for k in range(3)])
LINES = THREE.split("\n")


def test_a_last_frame_that_is_cut_anywhere_is_left_out(save):
    """Every place of the cut, from the first letter of the last frame to the last line end."""
    data = THREE.encode()
    start = data.rindex(b"ITEM: TIMESTEP")
    for cut in range(start + 1, len(data)):
        path = save(data[:cut])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            traj = atc.read(path, units="lj")
            n = len(traj)
        assert n == 2, cut
        assert [w.category for w in caught] == [AtcWarning]
        assert re.search(
            r"t.dump: its last frame \(number 2, from line 27\) is not complete and is left out", str(caught[0].message)
        )
        assert [f.step for f in traj] == [0, 1]


def test_a_cut_number_is_never_taken_for_a_whole_one(save):
    rows = ["1 1 1.25 1.5 1.75", "2 1 2.25 2.5 2.75", "3 1 3.25 3.5 3.75"]
    head = (
        "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\nITEM: ATOMS id type "
        "x y z\n"
    )
    first = head.format(0) + "\n".join(rows) + "\n"
    second = head.format(1) + "\n".join(rows)
    traj = atc.read(save(first + second + "\n"), units="lj")
    assert len(traj) == 2 and traj[1].positions[2, 2] == 3.75
    # Whatever the last word looks like: without a line end, nobody knows that it is whole.
    for cut in range(6):
        with pytest.warns(
            AtcWarning, match=r"number 1, from line 13\) is not complete and is left out.*has no line end"
        ):
            assert len(atc.read(save(first + second[: len(second) - cut]), units="lj")) == 1
    # A file of one frame only: nothing else is left to read.
    with pytest.warns(AtcWarning, match="its last number may have been cut off"):
        assert atc.read(save(second[:-1]), units="lj")[0].positions[2, 2] == 3.7
    with pytest.warns(AtcWarning, match="left out"), pytest.raises(AtcError, match="holds no complete frame"):
        atc.read(save(second[:-5]), units="lj")


def test_an_exponent_that_was_cut_off(save):
    """The last word 1.23456e-05, cut to 1.23456, has as many digits as any other of its column."""
    frame = (
        "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n0 20\n0 20\n0 20\nITEM: ATOMS id "
        "type x y z\n1 1 1 1 1.34567\n2 1 3 3 1.23456e-05\n"
    )
    text = frame.format(0) + frame.format(10)
    assert len(atc.read(save(text), units="metal")) == 2
    with pytest.warns(AtcWarning, match="is not complete and is left out"):
        traj = atc.read(save(text[: -len("e-05\n")]), units="metal")
        assert len(traj) == 1 and traj[-1].step == 0


def test_a_frame_that_swallows_others_is_damaged_not_cut(save):
    lines = list(LINES)
    lines[16] = "1000000000000"
    with pytest.raises(AtcError, match=r"t.dump, frame 1, line 27: another frame begins here"):
        len(atc.read(save("\n".join(lines)), units="lj"))


@pytest.mark.parametrize("pack", [".gz", ".bz2", ".xz"])
def test_cut_compressed_file(save, pack):
    rng = np.random.default_rng(0)
    frames = [simple(9000, k) for k in range(6)]
    for f in frames:
        f["columns"]["x"] = rng.random(9000)
    data = PACK[pack](write_dump(frames).encode())
    with pytest.warns(AtcWarning, match="left out"):
        traj = atc.read(save(data[: len(data) * 3 // 4], f"t.dump{pack}"), units="lj")
        n = len(traj)
    assert 1 <= n < 6
    for k in range(n):
        np.testing.assert_array_equal(traj[k].positions[:, 0], frames[k]["columns"]["x"])


def test_damaged_gz(save):
    data = bytearray(gzip.compress(write_dump([simple(5000, k) for k in range(3)]).encode()))
    data[len(data) // 2] ^= 255
    with pytest.raises(AtcError, match=r"t.dump.gz"):
        for _ in atc.read(save(bytes(data), "t.dump.gz"), units="lj"):
            pass


def broken(line, new):
    """THREE with line `line` (from 1) replaced, or removed (None)."""
    lines = list(LINES)
    lines[line - 1 : line] = [] if new is None else [new]
    return "\n".join(lines)


@pytest.mark.parametrize(
    "text,message",
    [
        (broken(25, "3 1 1.0 2.0"), r"frame 1, line 25: expected 5 columns \(id type x y z\), got 4: '3 1 1.0 2.0'"),
        (broken(25, "3 1 1.0 2.0 3.0 4.0"), r"frame 1, line 25: expected 5 columns .* got 6"),
        (broken(25, ""), r"frame 1, line 25: expected 5 columns .* got 0"),
        (broken(25, None), r"frame 1, line 26: the frame ends after 3 atoms but announces 4; lines are missing"),
        (
            broken(25, LINES[24] + "\n5 1 1 1 1"),
            r"frame 1, line 27: expected 'ITEM: TIMESTEP' after 4 atoms; there are more lines than announced",
        ),
        (broken(25, "3 1 1.0 x2.0 3.0"), r"frame 1, line 25: column 'y' holds 'x2.0', expected a number"),
        (
            broken(25, "3 1 1.0 nan 3.0"),
            r"frame 1, line 25: column 'y' holds 'nan'; the run that wrote it has probably blown up",
        ),
        (broken(25, "3 1 1.0 -inf 3.0"), r"frame 1, line 25: column 'y' holds '-inf'"),
        (broken(25, "3 1 1.0 1e999 3.0"), r"frame 1, line 25: column 'y' holds '1e999'"),
        (broken(25, "3.5 1 1.0 2.0 3.0"), r"frame 1, line 25: column 'id' holds '3.5', expected an integer"),
        (broken(25, "2 1 1.0 2.0 3.0"), r"frame 1, line 25: atom 2 is there twice"),
        (broken(25, "3 0 1.0 2.0 3.0"), r"frame 1: type 0 among the atoms"),
        (broken(14, "ITEM: TIMESTOP"), r"frame 1, line 22: expected 'ITEM: TIMESTEP' before it"),
        (broken(15, "abc"), r"frame 1, line 15: expected numbers for 'ITEM: TIMESTEP', got 'abc'"),
        (broken(17, "-4"), r"frame 1, line 17: expected numbers for 'ITEM: NUMBER OF ATOMS', got '-4'"),
        (broken(17, "5"), r"frame 1, line 27: the frame ends after 4 atoms but announces 5; lines are missing"),
        (broken(17, "3"), r"frame 1, line 26: expected 'ITEM: TIMESTEP' after 3 atoms"),
        (
            broken(18, "ITEM: BOX BOUNDS"),
            r"frame 1, line 18: 'ITEM: BOX BOUNDS' has no boundary flags .* e.g. 'ITEM: BOX BOUNDS pp pp pp'",
        ),
        (broken(18, "ITEM: BOX BOUNDS pp pp pq"), r"frame 1, line 18: expected three boundary flags"),
        (broken(19, "0 0"), r"frame 1, line 18: the box bounds .* enclose no volume"),
        (broken(19, "10 0"), r"frame 1, line 18: the box bounds .* enclose no volume"),
        (broken(19, "0 ten"), r"frame 1, line 19: expected numbers for 'ITEM: BOX BOUNDS pp pp pp'"),
        (broken(19, "0 nan"), r"frame 1, line 18: "),
        (broken(20, "0 10 1"), r"frame 1, line 18: expected three lines of 2 numbers"),
        (broken(22, "ITEM: ATOMS"), r"frame 1, line 22: 'ITEM: ATOMS' does not name its columns"),
        (broken(22, "ITEM: ATOMS id type x y x"), r"frame 1, line 22: column 'x' is there twice"),
        (
            broken(22, "ITEM: ATOMS id type a b c"),
            r"frame 1: no positions among the columns \(id type a b c\): expected x y z",
        ),
        (broken(22, None), r"frame 1, line 22: expected an 'ITEM:' line, got '1 1 "),
        (
            "\n".join([*LINES[:18], *LINES[20:]]),
            r"frame 1, line 20: 'ITEM: ATOMS' stands where the lines of another item are expected",
        ),
        (
            broken(16, "ITEM: NUMBER OF ENTRIES"),
            r"line 16: 'NUMBER OF ENTRIES': this is a dump of something else than atoms",
        ),
    ],
)
def test_damage_is_named(save, text, message):
    path = save(text)
    with pytest.raises(AtcError, match=r"t\.dump.*" + message) as caught:
        for _ in atc.read(path, units="lj"):
            pass
    assert "\n" not in str(caught.value)


def test_not_a_dump(save, tmp_path):
    with pytest.raises(AtcError, match=r"nothing.dump: there is no such file"):
        atc.read(tmp_path / "nothing.dump")
    with pytest.raises(AtcError, match="is a directory"):
        atc.read(tmp_path)
    with pytest.raises(AtcError, match=r"e.dump is empty"):
        atc.read(save("", "e.dump"))
    with pytest.raises(AtcError, match="not a LAMMPS dump: a text dump starts with 'ITEM:'"):
        atc.read(save("3\ncomment\nAr 0 0 0\nAr 1 1 1\nAr 2 2 2\n", "x.lammpstrj"), units="lj")
    with pytest.raises(AtcError, match="cannot read a trajectory from int"):
        atc.read(3)
    with pytest.raises(AtcError, match=r"list \(empty\)"):
        atc.read([])


def test_a_file_that_grows_or_shrinks_after_opening(save):
    path = save(THREE)
    traj = atc.read(path, units="lj")
    assert len(traj) == 3
    path.write_text(THREE[: THREE.rindex("ITEM: TIMESTEP") + 10])
    assert traj[1].step == 1
    with pytest.raises(AtcError, match="frame 2"):
        traj[2]


def test_ids_far_apart_and_frames_of_no_atoms(save):
    f = simple(3)
    f["columns"]["id"] = np.array([10**15, 5, 10**9])
    traj = atc.read(save(write_dump([f, simple(0, 1), simple(2, 2)])), units="lj")
    with pytest.warns(AtcWarning, match="t.dump frame 1 holds no atoms: the dump's group or threshold selected none"):
        assert len(traj[1]) == 0
    assert traj[0].ids.tolist() == [5, 10**9, 10**15]
    np.testing.assert_array_equal(traj[0].positions[:, 0], f["columns"]["x"][[1, 2, 0]])
    assert len(traj[1]) == 0 and len(traj[2]) == 2
    f["columns"]["id"] = np.array([10**15, 5, 10**15])
    with pytest.raises(AtcError, match=r"line 12: atom 1000000000000000 is there twice"):
        atc.read(save(write_dump([f])), units="lj")[0]
    with pytest.raises(AtcError, match=r"t.dump: none of its 2 frames holds an atom"):
        atc.read(save(write_dump([simple(0, 1), simple(0, 2)])), units="lj")
    with pytest.warns(AtcWarning, match=r"its first 1 frames hold no atoms"):
        assert len(atc.read(save(write_dump([simple(0, 1), simple(2, 2)])), units="lj")) == 2


def test_info(save):
    f = simple(100, 5, time=0.25)
    f["columns"] |= {"vx": np.zeros(100), "vy": np.zeros(100), "vz": np.zeros(100), "c_1": np.zeros(100)}
    text = re.sub(r"(\d+\.\d{4})\d+", r"\1", write_dump([f, {**f, "step": 15, "time": 0.75}], "metal"))
    info = atc.read(save(text), masses=[12.5]).info()
    assert info["frames"] == 2 and info["atoms"] == [100, 100] and info["units"] == "metal" and info["ids"]
    assert info["step"] == [5, 15] and info["time"] == pytest.approx([0.25, 0.75])
    assert info["quantities"] == ["positions", "velocities", "masses"] and info["extra"] == ["c_1"]
    assert info["types"] == {1: {"count": 100, "name": None, "mass": 12.5}} and info["topology"] is None
    assert info["cell"]["lengths"] == pytest.approx([10, 10, 10]) and info["cell"]["periodic"] == [True] * 3
    assert info["coordinate_resolution"] == pytest.approx(1e-4)
    import json

    json.dumps(info)
