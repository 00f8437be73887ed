"""Outputs on disk, opened and looked at: lazily loaded datasets, and what is wrong with a damaged file."""

from __future__ import annotations

from pathlib import Path

from ..errors import AtcError
from .sealed import Damaged, require_sound

#: Files opened by this process, to look at when something in one of them turns out to be unreadable.
opened: list[Path] = []


def _missing(path, name, a) -> str | None:
    if not any(type(f).__name__ == "CRC32" for f in a.filters) or a.nchunks_initialized >= a.nchunks:
        return None  # outputs of 0.4 and before leave chunks without numbers out
    return (
        f"{path}: {name}: {a.nchunks - a.nchunks_initialized} of {a.nchunks} chunks are missing: the file is damaged, "
        "compute it again"
    )


def damage(path) -> str | None:
    """What is wrong with an output file, in one line; None if every chunk is what was written."""
    path = Path(path)
    if path.suffix == ".zarr":
        import zarr

        try:
            arrays = dict(zarr.open_group(str(path), mode="r").arrays())
        except Exception as e:
            return f"{path}: its metadata cannot be read ({type(e).__name__}): the file is damaged, compute it again"
    else:
        import h5py

        try:
            require_sound(path)
            file = h5py.File(path, "r")
            arrays = {name: a for name, a in file.items() if isinstance(a, h5py.Dataset)}
        except Damaged as e:
            return str(e)
        except Exception:  # HDF5 has many words for it
            return f"{path}: its structure cannot be read: the file is damaged, compute it again"
    for name, a in arrays.items():
        if path.suffix == ".zarr" and (why := _missing(path, name, a)):
            return why
        for k in range(a.shape[0]) if a.ndim else (Ellipsis,):
            try:
                a[k]
            except Exception:  # each library has its own words for it
                at = f" of frame {k}" if a.ndim > 1 else ""
                return (
                    f"{path}: {name}{at} is not what was written (its checksum differs): the file is damaged, compute "
                    "it again"
                )
    return None


def open_dataset(path):
    """An output of atc as a lazily loaded `xarray.Dataset`."""
    import xarray as xr

    path = Path(path)
    if not path.exists():
        raise AtcError(f"{path}: there is no such file")
    opened.append(path)
    try:
        if path.suffix == ".zarr":
            import zarr

            for name, a in zarr.open_group(str(path), mode="r").arrays():
                if why := _missing(path, name, a):  # which reads as NaN
                    raise Damaged(why)
            ds = xr.open_dataset(path, engine="zarr", chunks=None, decode_times=False)
        else:
            require_sound(path)
            ds = xr.open_dataset(path, engine="h5netcdf", decode_times=False)
        # How this file is packed must not bind the next one: formats do not know each other's compressors.
        ds.encoding = {}
        for v in ds.variables.values():
            v.encoding = {}
        order = str(ds.attrs.get("variables", "")).split()
        if set(order) == set(ds.data_vars):
            ordered = xr.Dataset({name: ds.variables[name] for name in order}, coords=ds.coords, attrs=ds.attrs)
            ordered.set_close(ds.close)
            return ordered
        return ds
    except (OSError, ValueError, KeyError, RuntimeError) as e:
        why = damage(path) if isinstance(e, RuntimeError) or path.suffix == ".zarr" else None
        if why:
            raise Damaged(why) from None
        raise AtcError(f"{path}: is not an output of atc ({' '.join(str(e).split())[:120]})") from e


def load(path):
    """Open an output of ``atc fields`` (.zarr or .nc), or pass a Dataset through. `AtcError` for anything else."""
    import xarray as xr

    if isinstance(path, xr.Dataset):
        return path
    path = Path(path)
    if path.exists() and path.suffix not in (".zarr", ".nc"):
        raise AtcError(f"{path}: expected an output of atc fields, a name that ends in .zarr or .nc")
    ds = open_dataset(path)
    if not ds.data_vars:
        raise AtcError(f"{path}: holds no fields: not an output of atc fields, or a damaged one")
    return ds


def of_species(ds, species=None):
    """Of an output with fields of several species or molecules those of one, by its name; the only one need not be
    named. AtcError where the choice is open, or there is none of that name."""
    if "species" not in ds.dims:
        if species is not None:
            raise AtcError(
                f"species {species!r}: the fields of this output are not taken apart (by = ... makes them so)"
            )
        return ds
    names = [str(v) for v in ds["species"].values]
    if species is None and len(names) > 1:
        raise AtcError(f"this output has fields of {', '.join(names)} apart: name one with species (--species)")
    if species is not None and str(species) not in names:
        raise AtcError(f"species {species!r}: the output has {', '.join(names)}")
    return ds.isel(species=0 if species is None else names.index(str(species)))
