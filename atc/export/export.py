"""Outputs in the formats of other programs: VTK for ParaView (.pvd with .vtu, .vti or .vts files, one a frame),
extended XYZ (ASE, OVITO), and the form of LAMMPS's ``dump grid`` (OVITO)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..pictures.geometry import grid_dims, points_of_grid
from ..running.whole import renamed

FORMATS = (".pvd", ".vtu", ".vti", ".vts", ".grid", ".extxyz", ".xyz")


def export(out, target=None, *, quantities=None, frames=None, species=None) -> Path:
    """Write an output of ``atc fields`` or ``atc pd`` in another format.

    Parameters
    ----------
    out : the output, a path (.zarr, .nc) or a Dataset
    target : the file to write. ``.pvd`` (default): a folder beside it holds a file for each frame: .vti for regular
        grids along x, y and z, .vts for other
        lattices, .vtu for points, atoms and nodes. ``.extxyz``: frames of points, atoms or nodes with their fields as
        columns. ``.grid``: frames of regular grids and slab profiles as LAMMPS's ``dump grid`` writes them, a column
        for each component (``stress_xy``). ``.vtu``, ``.vti``, ``.vts``: one frame (the last) in one file.
    quantities : names; default all fields
    frames : slice of frames; default all
    species : which of the species that the fields are taken apart by

    Returns
    -------
    the path of what was written

    Raises
    ------
    AtcError : for formats that cannot hold the output, fields that are not there
    """
    from ..running.opening import load, of_species

    ds = of_species(load(out), species)
    if target is None:
        if not isinstance(out, (str, os.PathLike)):
            raise AtcError("export: give the file to write")
        target = Path(out).with_suffix(".pvd")
    return export_dataset(ds, target, quantities=quantities, frames=frames)


def export_dataset(ds, target, *, quantities=None, frames=None) -> Path:
    """`export` of an open dataset."""
    target = Path(target)
    kind = target.suffix.lower()
    if kind not in FORMATS:
        raise AtcError(f"{target}: expected a name that ends in {', '.join(FORMATS)}")
    if not target.parent.is_dir():
        raise AtcError(f"{target}: there is no directory {target.parent}: make it, or choose another place")
    source = _Nodes(ds, quantities) if ds.attrs.get("kind") == "peridynamics" else _Fields(ds, quantities)
    which = range(ds.sizes.get("frame", 1))[frames] if frames is not None else range(ds.sizes.get("frame", 1))
    if not len(which):
        raise AtcError(f"{target}: no frame is selected: the output has {ds.sizes.get('frame', 1)}")
    try:
        if kind in (".extxyz", ".xyz"):
            return _write_xyz(source, target, which)
        if kind == ".grid":
            return _write_grid(source, target, which)
        if kind != ".pvd":
            if source.suffix != kind:
                raise AtcError(f"{target}: this output goes into {source.suffix} files (or .pvd, a series of them)")
            source.write(which[-1], target)
            return target
        folder = target.with_suffix("")
        folder.mkdir(exist_ok=True)
        files = [folder / f"{target.stem}_{k:05d}{source.suffix}" for k in which]
        for k, path in zip(which, files, strict=True):
            source.write(k, path)
        from .vtk import write_series

        write_series(target, files, [source.time(k) for k in which])
        return target
    except OSError as e:
        raise AtcError(f"{target}: cannot be written ({e.strerror or e}): choose another place or make room") from None


class _Source:
    """What both kinds of output share."""

    def __init__(self, ds):
        self.ds = ds

    def time(self, k) -> float:
        """The time of a frame; its number where times are unknown."""
        t = float(self.ds["time"].values[k]) if "time" in self.ds else np.nan
        if np.isfinite(t):
            return t
        step = int(self.ds["step"].values[k]) if "step" in self.ds else -1
        return float(step if step >= 0 else k)

    def values(self, name, k):
        da = self.ds[name]
        return (da.isel(frame=k) if "frame" in da.dims else da).transpose(*self.dims, ...).values

    def arrays(self, k) -> dict:
        return {name: self.values(name, k) for name in self.names}

    def units(self) -> dict:
        """{name: unit} where the output says it."""
        return {n: str(da.attrs["units"]) for n, da in self.ds.variables.items() if da.attrs.get("units")}

    def wanted(self, known, quantities):
        if quantities is None:
            return known
        quantities = [quantities] if isinstance(quantities, str) else list(quantities)
        for q in quantities:
            if q not in known:
                raise AtcError(f"{q} is not a field of this output: it holds {', '.join(known) or 'none'}")
        return quantities


class _Nodes(_Source):
    """Nodes of a peridynamic body, where they are now."""

    suffix, dims, lattice = ".vtu", ("node",), None

    def __init__(self, ds, quantities):
        super().__init__(ds)
        self.names = self.wanted([n for n, da in ds.data_vars.items() if "node" in da.dims], quantities)
        self.X = np.stack([ds[f"position_{a}"].values for a in "xyz"], axis=1)

    def points(self, k):
        return self.X + self.values("displacement", k) if "displacement" in self.ds else self.X

    def arrays(self, k):
        return {**super().arrays(k), "volume": self.ds["volume"].values, "material": self.ds["material"].values}

    def write(self, k, path):
        from .vtk import write_nodes

        write_nodes(path, self.points(k), self.arrays(k), {"TIME": self.time(k)}, self.units())


class _Fields(_Source):
    """Fields on a grid."""

    def __init__(self, ds, quantities):
        from ..pictures.geometry import fields_of

        super().__init__(ds)
        names = [n for n in fields_of(ds) if grid_dims(ds[n])]
        if not names:
            raise AtcError("this output holds no field on a grid: there is nothing to export")
        first = self.wanted(names, quantities)[0]
        self.dims = tuple(grid_dims(ds[first]))
        self.names = [n for n in self.wanted(names, quantities) if tuple(grid_dims(ds[n])) == self.dims]
        self.names += [n for n in ("mask",) if n in ds and tuple(grid_dims(ds[n])) == self.dims and quantities is None]
        self.moving = "position_x" in ds and "frame" in ds["position_x"].dims
        self.place = points_of_grid(ds, ds[first].isel(frame=0) if "frame" in ds[first].dims else ds[first])
        x = np.asarray(self.place.x_gc)
        # Planes, lines and slabs are lattices with axes of one point.
        self.shape = (*x.shape[:-1], 1, 1)[:3] if len(self.dims) <= 3 else None
        self.lattice = x.reshape(*self.shape, 3) if self.place.kind not in ("points", "atoms") else None
        self.suffix = ".vtu" if self.lattice is None else ".vti" if self._straight() else ".vts"

    def _straight(self) -> bool:
        """Whether axis k of the lattice runs along x, y, z."""
        if self.place.kind not in ("volume",) or self.moving:
            return False
        steps = np.asarray(self.place.steps)
        off = np.abs(steps - np.diag(np.diag(steps))).max()
        return bool(off <= 1e-12 * np.abs(steps).max() and (np.diag(steps) >= 0).all())

    def points(self, k):
        if self.moving:
            import xarray as xr

            # Of an orthogonal lattice each axis has its own.
            axes = xr.broadcast(*(self.ds[f"position_{a}"].isel(frame=k) for a in "xyz"))
            return np.stack([a.transpose(*self.dims).values.reshape(-1) for a in axes], axis=1)
        return np.asarray(self.place.x_gc).reshape(-1, 3)

    def write(self, k, path):
        from .vtk import write_image, write_lattice, write_nodes

        about = {"TIME": self.time(k)}
        if self.lattice is None:
            write_nodes(path, self.points(k), self.arrays(k), about, self.units())
            return
        arrays = {n: a.reshape(*self.shape, *a.shape[len(self.dims) :]) for n, a in self.arrays(k).items()}
        if self.suffix == ".vti":
            spacing = np.diag(self.place.steps)
            spacing = np.where(spacing > 0, spacing, 1.0)
            write_image(path, self.lattice[0, 0, 0], spacing, self.shape, arrays, about, self.units())
        else:
            write_lattice(path, self.points(k).reshape(*self.shape, 3), arrays, about, self.units())


def _write_grid(source, target, which) -> Path:
    """The form of LAMMPS's ``dump grid``, one frame after another."""
    from .lammps_grid import columns_of, region_of, write_grid

    ds, place = source.ds, None if isinstance(source, _Nodes) else source.place
    if place is None or place.kind not in ("volume", "slab"):
        what = "nodes" if place is None else f"a {place.kind}" if place.kind in ("plane", "line") else place.kind
        raise AtcError(
            f"{target}: dump grid holds regular grids and slab profiles; this output is on {what}: take .pvd"
        )
    periodic = str(ds.attrs.get("periodic", "fff")).ljust(3, "p")
    # A slab's bins lie along one axis, each as wide as the cell across it.
    axis = None if place.kind == "volume" else "xyz".index(source.dims[0])
    shape = source.shape if axis is None else tuple(source.shape[0] if k == axis else 1 for k in range(3))

    def frames():
        for k in which:
            cell, origin = ds["cell"].values[k], ds["cell_origin"].values[k]
            points = source.points(k).reshape(*shape, 3).copy()
            if axis is not None:
                if np.count_nonzero(cell - np.diag(np.diag(cell))):
                    raise AtcError(f"{target}: bins of a slab in a tilted cell are no box: take .pvd")
                across = [c for c in range(3) if c != axis]
                points[..., across] = (origin + 0.5 * cell.sum(0))[across]
            arrays = {n: a.reshape(*shape, *a.shape[len(source.dims) :]) for n, a in source.arrays(k).items()}
            time = float(ds["time"].values[k]) if "time" in ds else np.nan
            step = int(ds["step"].values[k]) if "step" in ds else -1
            when = step if step >= 0 else k, time if np.isfinite(time) else None
            yield (*region_of(points, cell, periodic), columns_of(arrays, 3), *when, ds.attrs.get("units"))

    write_grid(target, frames())
    return target


def _write_xyz(source, target, which) -> Path:
    """Extended XYZ, one frame after another; undefined values are nan. The species is X, an element of none, which
    every reader knows."""
    if source.lattice is not None:
        raise AtcError(
            f"{target}: extended XYZ holds points, atoms and nodes; this output is on a {source.place.kind}: take .pvd"
        )
    cells = source.ds["cell"].values if "cell" in source.ds else None
    periodic = str(source.ds.attrs.get("periodic", "fff"))
    units = source.units()
    with renamed(target) as part, open(part, "w") as f:
        for k in which:
            x = source.points(k)
            columns, properties = [x], ["species:S:1", "pos:R:3"]
            labels = [f"pos={units['position_x']}"] if "position_x" in units else []
            for name, a in source.arrays(k).items():
                a = np.asarray(a).reshape(len(x), -1)
                columns.append(a)
                unit = units.get(name)
                # ASE takes columns of these names for results of a calculator and hides them.
                name = f"local_{name}" if name in ("energy", "stress") else name
                name = name.replace(":", "_")  # which separates properties
                properties.append(f"{name}:{'R' if a.dtype.kind == 'f' else 'I'}:{a.shape[1]}")
                if unit:
                    labels.append(f"{name}={unit}")
            head = f"Properties={':'.join(properties)} Time={source.time(k)!r}"
            if labels:
                head += f' Units="{" ".join(labels)}"'
            if cells is not None:
                head = f'Lattice="{" ".join(repr(float(v)) for v in cells[k].reshape(-1))}" ' + head
            f.write(f'{len(x)}\n{head} pbc="{" ".join("T" if p == "p" else "F" for p in periodic)}"\n')
            texts = [c.astype(int) if c.dtype.kind in "bi" else c for c in columns]
            for n in range(len(x)):
                f.write("X " + " ".join(repr(v) for c in texts for v in c[n].tolist()) + "\n")
    return target
