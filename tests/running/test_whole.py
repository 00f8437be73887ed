"""Datasets that are written whole: checksums of every chunk, and under their name always all of one of them."""

import errno

import numpy as np
import pytest
import xarray as xr
from test_cli import tree
from test_stopped import flip

from atc.errors import AtcError
from atc.running import whole
from atc.running.opening import damage, open_dataset
from atc.running.whole import write_dataset


def dataset(seed=0):
    """Of all kinds of variables that twins, profiles and dispersion have."""
    rng = np.random.default_rng(seed)
    return xr.Dataset(
        {
            "stress": (("frame", "x", "i"), rng.normal(size=(3, 40, 3)), {"units": "bar"}),
            "large": (("frame", "x", "y"), rng.normal(size=(3, 40, 2000))),
            "mask": (("frame", "x"), rng.random((3, 40)) < 0.5),
            "empty": (("frame", "none"), np.zeros((3, 0))),
            "tension": ((), 0.1),
        },
        {"i": ("i", ["x", "y", "z"]), "label": ("frame", np.array(["a", "bc", ""], object)), "frame": [0, 1, 2]},
        {"title": "all kinds"},
    )


def chunks(path):
    """{name of the variable: [where the numbers of a chunk stand: (file, offset)]}."""
    if path.suffix == ".zarr":
        return {
            v.name: [(f, f.stat().st_size // 2) for f in sorted(v.iterdir()) if not f.name.startswith(".")]
            for v in path.iterdir()
            if v.is_dir()
        }
    import h5py

    with h5py.File(path) as f:
        found = {
            name: [a.id.get_chunk_info(k) for k in range(a.id.get_num_chunks())]
            for name, a in f.items()
            if a.chunks and a.dtype.kind != "O"
        }
    return {name: [(path, c.byte_offset + c.size // 2) for c in places] for name, places in found.items()}


@pytest.mark.parametrize("name", ["o.nc", "o.zarr"])
def test_every_chunk_has_a_checksum(tmp_path, name):
    path = tmp_path / name
    write_dataset(dataset(), path)
    xr.testing.assert_equal(open_dataset(path).load(), dataset())
    assert list(open_dataset(path)) == list(dataset()) and damage(path) is None
    found = chunks(path)
    assert {"stress", "large", "mask", "frame"} <= set(found) and len(found["large"]) > 1
    for variable, places in found.items():
        if variable == "label":  # words: no library checks them
            continue
        for file, at in places:
            flip(file, at)
            assert f"{variable}" in damage(path) and "not what was written" in damage(path), variable
            flip(file, at)
    if name == "o.zarr":
        found["stress"][0][0].unlink()
        assert "stress: 1 of 1 chunks are missing" in damage(path)


def fails(ds, path):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("name, step", [("o.nc", "_to_netcdf"), ("o.zarr", "_to_zarr")])
def test_what_was_there_stays_until_the_new_one_is_whole(tmp_path, monkeypatch, name, step):
    path = tmp_path / name
    write_dataset(dataset(0), path)
    before = tree(tmp_path)
    real = getattr(whole, step)

    def failing(error):
        def write(ds, part):
            real(ds, part)
            raise error

        monkeypatch.setattr(whole, step, write)

    for error, kind, says in (
        (OSError(errno.ENOSPC, "No space left on device"), AtcError, f"{name}: the disk is full"),
        (OSError(errno.EFBIG, "File too large"), AtcError, "larger than a file may be here"),
        (KeyboardInterrupt(), KeyboardInterrupt, None),
    ):
        failing(error)
        with pytest.raises(kind, match=says) as e:
            write_dataset(dataset(1), path)
        assert ".partial" not in str(e.value) and tree(tmp_path) == before
    monkeypatch.setattr(whole, step, real)
    write_dataset(dataset(1), path)
    xr.testing.assert_equal(open_dataset(path).load(), dataset(1))
    assert [f.name for f in tmp_path.iterdir()] == [name]


def test_a_kill_between_the_two_renames(tmp_path, monkeypatch):
    """The old one comes back before anything else is done."""
    path = tmp_path / "o.zarr"
    write_dataset(dataset(0), path)
    path.rename(tmp_path / ".o.zarr.old")
    with monkeypatch.context() as m, pytest.raises(AtcError, match="full"):
        m.setattr(whole, "_to_zarr", fails)
        write_dataset(dataset(1), path)
    xr.testing.assert_equal(open_dataset(path).load(), dataset(0))
    write_dataset(dataset(1), path)
    assert [f.name for f in tmp_path.iterdir()] == ["o.zarr"]
