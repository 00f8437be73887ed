"""Files of HDF5 are looked at before the library opens them: no damaged structure reaches it unseen."""

import base64
import random
import time
import zlib

import h5py
import numpy as np
import pytest
import xarray as xr

from atc.errors import AtcError
from atc.running import sealed
from atc.running.opening import damage, open_dataset
from atc.running.sealed import MAGIC, Damaged, require_sound
from atc.running.whole import write_dataset


@pytest.fixture
def path(tmp_path):
    """A small file with chunks, strings and attributes."""
    path = tmp_path / "a.nc"
    ds = xr.Dataset(
        {"a": (("frame", "x"), np.arange(2400.0).reshape(3, 800), {"units": "bar"})},
        coords={"i": ("i", np.array(["x", "y"], dtype=object))},
        attrs={"variables": "a"},
    )
    ds["a"].encoding = {"chunksizes": (1, 800), "fletcher32": True}
    sealed.to_netcdf(ds, path)
    return path


@pytest.fixture
def tried(monkeypatch):
    """The files that were left to a process of their own."""
    paths = []
    monkeypatch.setattr(sealed, "_survived", lambda path: paths.append(path) or True)
    return paths


def test_sound_file_is_opened_at_once(path, tried):
    require_sound(path)
    assert open_dataset(path)["a"].sum() == np.arange(2400.0).sum()
    assert damage(path) is None and not tried


@pytest.mark.parametrize("name", ["b.nc", "b.zarr"])
def test_what_is_written_whole_is_sealed_too(path, tmp_path, tried, name):
    """Outputs of profiles, twins and dispersion."""
    write_dataset(open_dataset(path).load(), tmp_path / name)
    assert open_dataset(tmp_path / name)["a"].sum() == np.arange(2400.0).sum() and not tried
    with pytest.raises(AtcError, match="must end in .zarr or .nc"):
        write_dataset(open_dataset(path), tmp_path / "b.txt")


def test_every_flipped_bit_of_the_structure_is_seen(path, tried):
    """Bits of chunks are their checksums' business; of the magic word at the end, the file is one without a seal."""
    content = path.read_bytes()
    chunks = {k for begin, end in sealed._stretches_of_data(path).tolist() for k in range(begin, end)}
    assert len(chunks) == 3 * (800 * 8 + 4)
    rng = random.Random(1)
    for k in sorted(set(range(len(content))) - chunks):
        damaged = bytearray(content)
        damaged[k] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        before = len(tried)
        if k < len(content) - len(MAGIC):
            with pytest.raises(Damaged, match="its structure is not what was written"):
                require_sound(path)
        else:
            require_sound(path)
            assert len(tried) == before + 1
    assert len(tried) == len(MAGIC)


def test_pieces_cut_out_doubled_and_added_are_seen(path, tried):
    content, rng = path.read_bytes(), random.Random(2)
    for _ in range(300):
        a = rng.randrange(len(content) - len(MAGIC))
        b = min(len(content) - len(MAGIC), a + rng.choice([1, 8, 600]))
        path.write_bytes(content[:a] + rng.choice([b"", 2 * content[a:b]]) + content[b:])
        with pytest.raises(Damaged):
            require_sound(path)
    assert not tried
    path.write_bytes(content[:-1])
    require_sound(path)
    assert len(tried) == 1


def test_damaged_chunks_are_named_by_their_frame(path):
    content = bytearray(path.read_bytes())
    begin = sealed._stretches_of_data(path)[0, 0]
    content[begin + 800 * 8 + 4 + 100] ^= 1
    path.write_bytes(content)
    require_sound(path)
    assert "of frame 1" in damage(path)


@pytest.mark.parametrize("change", ["value", "attribute"])
def test_changes_by_other_programs_are_no_damage(path, change):
    with h5py.File(path, "r+") as f:
        if change == "value":
            f["a"][1, 1] = 7.0
        else:
            f["a"].attrs["units"] = "MPa"
    assert not path.read_bytes().endswith(MAGIC)
    require_sound(path)
    with open_dataset(path) as ds:
        assert ds["a"][1, 1] == (7.0 if change == "value" else 801.0)
    sealed.seal(path)
    require_sound(path)


def test_file_without_a_seal_is_tried_for_so_long(path, monkeypatch):
    """One that cannot be read, and one that the library does not come back from."""
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(Damaged):
        require_sound(path)
    path.write_bytes(content[:-1])
    monkeypatch.setattr(sealed, "PATIENCE", 1.0)
    monkeypatch.setattr(sealed, "_TRY", "while True: pass")
    began = time.monotonic()
    for read in (require_sound, open_dataset):
        with pytest.raises(AtcError, match="its structure is not what was written"):
            read(path)
    assert time.monotonic() - began < 10.0


#: A file of h5py with one word of its structure changed, such that HDF5 2.0 reads it for ever.
ENDLESS = (
    "c-rloF>ljA6vv;>Nouu0b)^mgRl<}|GC^nqbgK~!ct8{ZLzo~`L8*k=Dh*a8z5on-2S!FqEZv&1BO@atW5;gAzWZOAvx=)qMbz+q%is6>e0E>&"
    "E|<LLkHPYT3*(o@DZz25KrW4P2=*4twm$y~YC%6hzX)x&<+%#%F8Yryt9BRm=TDnWA~EbgeV=+ksfYIFEu~M0`5y?H_vF7iLc0YW)c@>#EgDl}"
    "+tTftQlShs{4hL^X;<W>Q{ECe(&AHNf*OZ#EXLO4ys%Y=6Y&U74lGMwujb2}x1IiKx6@mgS9S+8$`<x^@n{Mb<f)i)d>>^j(R6Hjx4zcjirW|C"
    "j$Jtq^`GPz^EY{{XmWH;J4QU7JziP1;@fDeXJ^MxuO<~Q+fT0#wJX_vx|_w>e2?d3y-U`{^m<o4;ktwCN~@`LH_c4V^b^1F^J`{1J$@ZtdKiXb"
    "7=~f~Di80kJhDbM)_VV^zc0LQ_l*6X-p|!<+&20dOmZw4hG7_nVHk#C80Ne(g)jc;JbRe}{2ox2`M!34^<~)UZLMvrOZ#c^enQ%dsk~>}-<8L%"
    "L&Lmg!Z4pHR6cW<r?etuuF@H$&$)>E*~ept<6*>O!0|BRvB&W+;_;2+VZ`G*$HR!nk6g#&^zl3Ttk$333A%0rH9=H@j?wYaQS2|_z=xN=d$9Xn"
    "9lNkiLo3i3pI!)5@p-V#LaWd@pFY`NdDq4;48t(zZQu0spV&9Gp&{zQL%bglqFy@0`wL+MigJkX4)iW`(cE9P&iFZ1{d9?R*==w&+h3Qrw@xSw"
    "#$!|WTDBiHX0$z*?H53!o7sN){fnLXyw8LET+f4F(JO;d"
)


def test_file_that_hdf5_reads_for_ever(tmp_path, monkeypatch):
    path = tmp_path / "endless.nc"
    path.write_bytes(zlib.decompress(base64.b85decode(ENDLESS)))
    monkeypatch.setattr(sealed, "PATIENCE", 5.0)
    assert "its structure" in damage(path)
    with pytest.raises(AtcError, match="its structure"):
        open_dataset(path)
