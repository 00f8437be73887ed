"""Several files as one trajectory."""

import gzip
import pickle

import numpy as np
import pytest
from ase.build import bulk
from ase.io import write
from test_readers_dump import simple, write_dump

import atc
from atc.errors import AtcError, AtcWarning


@pytest.fixture
def parts(tmp_path):
    """Ten frames in files of 3, 1, 4 and 2, the last of them compressed; names sort by number, not by letter."""
    frames = [simple(step=10 * k) for k in range(10)]
    paths, at = [], 0
    for k, n in zip((1, 2, 9, 10), (3, 1, 4, 2)):
        path = tmp_path / f"run.{k}.dump{'.gz' if k == 10 else ''}"
        text = write_dump(frames[at : at + n], "metal").encode()
        path.write_bytes(gzip.compress(text) if k == 10 else text)
        paths.append(path)
        at += n
    whole = tmp_path / "whole.lammpstrj"
    whole.write_text(write_dump(frames, "metal"))
    return paths, atc.read(whole)


def same(a, b):
    np.testing.assert_array_equal(a.positions, b.positions)
    assert a.step == b.step and a.cell == b.cell


@pytest.mark.parametrize("how", ["list", "pattern", "pattern in a list", "texts"])
def test_as_one(parts, how):
    paths, whole = parts
    pattern = paths[0].parent / "run.*.dump*"
    source = {"list": paths, "pattern": pattern, "pattern in a list": [str(pattern)], "texts": [str(p) for p in paths]}[
        how
    ]
    traj = atc.read(source)
    assert len(traj) == 10 and traj.units.name == "metal"
    for a, b in zip(traj, whole, strict=True):
        same(a, b)
    for k in (0, 3, 4, 7, 8, 9, -1, -10):
        same(traj[k], whole[k])
    assert [f.step for f in traj[1:9:3]] == [10, 40, 70] and [f.step for f in traj[::-1]][:3] == [90, 80, 70]
    with pytest.raises(IndexError):
        traj[10]
    copy = pickle.loads(pickle.dumps(traj))
    same(copy[5], whole[5])
    assert "run.9.dump" in copy[5].source


def test_nothing_beyond_what_is_asked_is_opened(parts):
    paths, whole = parts
    paths[3].write_bytes(b"no dump at all")
    traj = atc.read(paths)
    same(traj[6], whole[6])
    assert [f.step for f in traj[:8]] == [10 * k for k in range(8)]
    with pytest.raises(AtcError, match=r"run\.10"):
        len(traj)


def test_a_thousand_snapshots_in_a_file_each(tmp_path):
    """As LAMMPS writes them with dump.*: found in the order of their steps, and never many files open at once."""
    import os

    for k in range(1000):
        (tmp_path / f"snap.{k}.lammpstrj").write_text(write_dump([simple(n=2, step=k)], "metal"))
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    traj = atc.read(tmp_path / "snap.*.lammpstrj")
    assert [f.step for f in traj] == list(range(1000)) and len(traj) == 1000
    assert traj[777].step == 777 and traj[-1].step == 999
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) < before + 30


def test_a_run_that_goes_on_has_each_moment_once(tmp_path):
    import warnings

    frames = [simple(step=10 * k) for k in range(8)]

    def joined(first, second):
        for name, some in (("a.dump", first), ("b.dump", second)):
            (tmp_path / name).write_text(write_dump(some, "metal"))
        return atc.read([tmp_path / "a.dump", tmp_path / "b.dump"])

    # the step that a continued run writes once more: nothing to tell
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        traj = joined(frames[:4], frames[3:])
        assert [f.step for f in traj] == [10 * k for k in range(8)] and len(traj) == 8
    # continued from a restart some way back
    traj = joined(frames[:6], frames[3:])
    with pytest.warns(AtcWarning, match=r"b\.dump goes on from step 30, .*a\.dump ends at step 50: .* 3 frames"):
        assert len(traj) == 8
    for k in (7, 2, 3, 4):
        assert np.allclose(traj[k].positions[:, 0], frames[k]["columns"]["x"])
    # in any order of asking
    traj = joined(frames[:6], frames[3:])
    with pytest.warns(AtcWarning, match="goes on from step 30"):
        assert traj[5].step == 50 and traj[-1].step == 70
    # the same steps of another run: nothing is left out, and it is said
    other = [{**simple(step=900 + k), "step": 10 * k} for k in range(3, 8)]
    traj = joined(frames[:6], other)
    with pytest.warns(AtcWarning, match="do not have that moment in common"):
        assert len(traj) == 11


def test_species_keep_their_types_through_files(tmp_path):
    write(tmp_path / "a.xyz", bulk("Cu", "fcc", 3.6), format="extxyz")
    write(tmp_path / "b.xyz", bulk("NaCl", "rocksalt", 5.6), format="extxyz")
    traj = atc.read([tmp_path / "a.xyz", tmp_path / "b.xyz"])
    assert [f.types.tolist() for f in traj] == [[1], [2, 3]]
    assert traj[1].type_names[2] == "Na" and traj.units.name == "ase"


def test_units_must_agree(tmp_path):
    (tmp_path / "a.dump").write_text(write_dump([simple()], "metal"))
    (tmp_path / "b.dump").write_text(write_dump([simple(step=5)], "real"))
    with pytest.raises(AtcError, match=r"b\.dump.*'real'.*'metal'"):
        list(atc.read([tmp_path / "a.dump", tmp_path / "b.dump"]))


def test_nothing_found(tmp_path):
    with pytest.raises(AtcError, match=r"no file matches"):
        atc.read(tmp_path / "dump.*")


def test_in_a_scene(parts, tmp_path):
    from atc.config.scene import Scene

    table = {
        "kernel": {"name": "quartic", "radius": 3.0},
        "grid": {"kind": "regular", "shape": 4},
        "fields": {"quantities": ["number_density"]},
    }
    paths, _ = parts
    for given in ("run.*.dump*", [p.name for p in paths]):
        scene = Scene.load({"trajectory": {"file": given}, **table})
        scene.folder = tmp_path
        ds = scene.run()
        assert ds.sizes["frame"] == 10 and ds.step.values.tolist() == [10 * k for k in range(10)]
        assert "run." in ds.attrs["scene"] and str(tmp_path) not in ds.attrs["scene"]
    scene = Scene.load({"trajectory": {"file": ["run.1.dump", "gone.dump"]}, **table})
    scene.folder = tmp_path
    with pytest.raises(AtcError, match=r"there is no file .*gone\.dump"):
        scene.run()


def test_types_do_not_depend_on_what_is_read_first(tmp_path):
    """Species are numbered in order of first appearance in the whole trajectory, as in one file, whichever frame is
    asked for first."""
    from itertools import permutations

    from ase import Atoms

    species = ["ArNe", "NeXe", "XeAr", "KrAr"]
    atoms = [Atoms(s, [[0, 0, 0], [3, 0, 0]], cell=[10, 10, 10], pbc=True) for s in species]
    for k, a in enumerate(atoms):
        write(tmp_path / f"v{k}.extxyz", a)
    write(tmp_path / "whole.extxyz", atoms)
    expected = [[1, 2], [2, 3], [3, 1], [4, 1]]
    assert [f.types.tolist() for f in atc.read(tmp_path / "whole.extxyz")] == expected
    for order in permutations(range(4)):
        traj = atc.read(tmp_path / "v?.extxyz")
        assert {k: traj[k].types.tolist() for k in order} == dict(enumerate(expected)), order
    traj = pickle.loads(pickle.dumps(atc.read(tmp_path / "v?.extxyz")[2:]))
    assert [f.types.tolist() for f in traj] == expected[2:] and traj[1].type_names == {
        1: "Ar",
        2: "Ne",
        3: "Xe",
        4: "Kr",
    }


def test_types_survive_closing(tmp_path, monkeypatch):
    from ase import Atoms

    from atc.readers import chain

    monkeypatch.setattr(chain, "_OPEN", 1)
    names = ["He", "Ne", "Ar", "Kr", "Xe"]
    for k in range(5):
        write(
            tmp_path / f"v{k}.extxyz", Atoms([names[k], names[0]], [[0, 0, 0], [3, 0, 0]], cell=[10, 10, 10], pbc=True)
        )
    traj = atc.read(tmp_path / "v?.extxyz")
    assert atc.read(tmp_path / "v?.extxyz")[2].types.tolist() == [3, 1]
    assert traj[4].types.tolist() == [5, 1] and [f.types.tolist() for f in traj] == [[k + 1, 1] for k in range(5)]
