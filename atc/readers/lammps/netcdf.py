"""NetCDF trajectories that LAMMPS wrote (``dump netcdf``): AMBER's convention with LAMMPS's units and columns."""

from __future__ import annotations

from contextlib import closing

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell
from .._bytes import open_bytes
from ..netcdf_classic import ClassicFile
from ..resolution import decimal_resolution
from ..trajectory import warn
from .columns import INT_COLUMNS, ScannedTrajectory, edge_vectors

# (unit of length, unit of time), as the attributes of cell_lengths and time name them -> unit style
_STYLES = {
    ("lj", "lj"): "lj", ("angstrom", "femtosecond"): "real", ("angstrom", "picosecond"): "metal",
    ("meter", "second"): "si", ("centimeter", "second"): "cgs", ("bohr", "femtosecond"): "electron",
    ("micrometer", "microsecond"): "micro", ("nanometer", "nanosecond"): "nano",
}  # fmt: skip
# Vectors of a frame -> the columns of a dump they hold.
_VECTORS = {
    "coordinates": ("x", "y", "z"), "unwrapped_coordinates": ("xu", "yu", "zu"),
    "scaled_coordinates": ("xs", "ys", "zs"), "velocities": ("vx", "vy", "vz"), "forces": ("fx", "fy", "fz"),
    "mu": ("mux", "muy", "muz"),
}  # fmt: skip
_FILLS = (-2147483647, -9223372036854775806)  # what NetCDF puts where nothing was written, as int and int64


def is_netcdf(head: bytes) -> bool:
    """Whether a file is a classic NetCDF file of any kind."""
    return head[:3] == b"CDF" and head[3:4] in (b"\1", b"\2", b"\5")


def netcdf_by_lammps(head: bytes, path) -> bool:
    """Whether a classic NetCDF file says that LAMMPS wrote it."""
    if not is_netcdf(head) or b"program" not in head or b"LAMMPS" not in head:
        return False
    with closing(open_bytes(path)) as reader:
        return "LAMMPS" in str(ClassicFile(reader, str(path)).attrs.get("program", ""))


class LammpsNetcdf(ScannedTrajectory):
    """Frames of a NetCDF file of LAMMPS.

    Parameters and choices as for `atc.readers.lammps.dump.LammpsDump`: variables are columns of a dump. The unit style
    follows from the units that the file gives its lengths and its time; a `units` argument must agree. A
    ``scale_factor`` multiplies what is stored, whatever the variable; LAMMPS's velocities are in the units of its run,
    not in AMBER's (20.455 Å/ps), unless their own attribute says otherwise, which is refused. An axis of length 0 is
    open.
    """

    assumed = (
        "a NetCDF file of LAMMPS does not say which faces of its box are periodic: all with a length are taken to be",
    )
    _without_ids = (
        "has no 'id': atoms are numbered in file order, which is only theirs if LAMMPS sorted them (dump netcdf/mpiio "
        "does not)"
    )

    def __init__(self, path, topology=None, units=None, masses=None):
        self._bytes = open_bytes(path)
        self.source = str(path)
        self._file = ClassicFile(self._bytes, self.source)
        if self._file.attrs.get("Conventions") != "AMBER":
            raise AtcError(f"{path}: a NetCDF file of LAMMPS, but its Conventions are not 'AMBER': no trajectory")
        super().__init__(path, topology, units, masses, self._style())
        self._check_variables()
        if not self._has(0):
            raise AtcError(f"{path} holds no complete frame")
        self._require_atoms(lambda k: self._n)

    def _unit(self, name):
        v = self._file.variables.get(name)
        return None if v is None else str(v.attrs.get("units", "")).strip().lower().rstrip("s") or None

    def _style(self):
        return _STYLES.get((self._unit("cell_lengths") or self._unit("coordinates"), self._unit("time")))

    def _check_variables(self):
        f = self._file
        n = f.dims.get("atom")
        if n is None or n >= 1 << 40:
            raise AtcError(
                f"{self.source}: expected a dimension 'atom', got {', '.join(f.dims) or 'none'}; not a trajectory of "
                "LAMMPS"
            )
        self._n = n
        for name in ("cell_lengths", "cell_angles"):
            v = f.variables.get(name)
            if v is None or v.shape != (None, 3):
                raise AtcError(
                    f"{self.source}: expected a variable {name!r} with three numbers a frame; the file is damaged or "
                    "no trajectory of LAMMPS"
                )
        unit = self._unit("cell_angles")
        if unit not in (None, "degree"):
            raise AtcError(f"{self.source}: cell_angles are in {unit!r}, expected degrees")
        length = self._unit("cell_lengths")
        for name, per in (
            ("coordinates", ""),
            ("unwrapped_coordinates", ""),
            ("cell_origin", ""),
            ("velocities", self._unit("time")),
        ):
            unit = self._unit(name)
            allowed = {None, length, *((f"{length}/{per}", f"{length}/{per}s") if per else ())}
            if unit not in allowed:
                raise AtcError(
                    f"{self.source}: {name} are in {unit!r}, but the cell in {length!r}: expected one system of units"
                )

    def _scaled(self, name, k) -> np.ndarray:
        """Values of a variable with its scale factor. Whole numbers stay whole without one."""
        a = self._file.read(name, k)
        factor = self._file.variables[name].attrs.get("scale_factor")
        if factor is None:
            return a
        if not (isinstance(factor, np.ndarray) and factor.size == 1 and np.isfinite(factor[0]) and factor[0] != 0):
            raise AtcError(f"{self.source}: the scale_factor of {name} is no number")
        return a * float(factor[0])

    def _scan(self):
        self._bytes.hold = self._file._first + self._found * self._file.record_size
        if self._file.has_record(self._found):
            self._found += 1
            return True
        self._complete = True
        announced = self._file.announced
        if announced is not None and announced > self._found:
            warn(
                f"{self.source}: its header announces {announced} frames, the file ends within number {self._found}: "
                "it is left out"
            )
        return False

    def _columns_of(self, k):
        columns = {}
        for name, v in self._file.variables.items():
            if v.dims[1:2] != ("atom",) or not v.along_records:
                continue
            a = self._scaled(name, k)
            if a.ndim == 1:
                columns[name] = a
            elif a.ndim == 2 and name in _VECTORS and a.shape[1] == 3:
                columns.update(zip(_VECTORS[name], a.T))
            elif a.ndim == 2 and a.shape[1] <= 64:
                columns.update({f"{name}[{j + 1}]": c for j, c in enumerate(a.T)})
        # The number of atoms may shrink; the file's does not.
        there = ~np.isin(columns["id"], _FILLS) if "id" in columns else slice(None)
        out = {}
        for name, a in columns.items():
            a = a[there]
            if name in INT_COLUMNS:
                whole = np.rint(a.astype(np.float64)) if a.dtype.kind == "f" else a
                if not (whole == a).all():
                    raise AtcError(
                        f"{self.source}, frame {k}: variable {name!r} holds numbers that are not whole; the file is "
                        "damaged"
                    )
                out[name] = whole.astype(np.int64)
            elif a.dtype.kind in "fiu":
                out[name] = a.astype(np.float64)
        return out, f"{self.source} frame {k}", lambda row: f"atom {row + 1} of the file"

    def _frame(self, k):
        columns, where, line_of = self._columns_of(k)
        if not columns:
            raise AtcError(f"{where}: no variable has a value for each atom")
        step = time = None
        if "time" in self._file.variables and self._file.variables["time"].shape == (None,):
            stored = float(self._file.read("time", k))
            time = float(self._scaled("time", k))
            if not np.isfinite(time):
                raise AtcError(f"{where}: its time is {time}; the file is damaged")
            # LAMMPS stores the step, and the time step as its scale factor.
            if "scale_factor" in self._file.variables["time"].attrs and stored.is_integer() and abs(stored) < 2**53:
                step = int(stored)
        return self._build(columns, self._cell(k, where), k, where, step, time, line_of)

    def _cell(self, k, where) -> Cell:
        lengths = np.asarray(self._scaled("cell_lengths", k), float)
        angles = np.asarray(self._scaled("cell_angles", k), float)
        origin = np.zeros(3)
        v = self._file.variables.get("cell_origin")
        if v is not None and v.shape == (None, 3):
            origin = np.asarray(self._scaled("cell_origin", k), float)
        good = (lengths >= 0).all() and ((angles > 0) & (angles < 180)).all()
        if not (good and np.isfinite([*lengths, *angles, *origin]).all()):
            raise AtcError(
                f"{where}: lengths {lengths.tolist()} and angles {angles.tolist()} make no cell; the file is damaged"
            )
        vectors = edge_vectors(lengths, np.where(angles == 90, 0.0, np.cos(np.radians(angles))))
        if vectors is None:
            raise AtcError(f"{where}: angles {angles.tolist()} make no cell; the file is damaged")
        with located(where):
            return Cell(vectors * self.units.length, origin * self.units.length, lengths > 0)

    def _numbered(self):
        return "id" in self._file.variables

    def _precision(self, frame):
        step, why = decimal_resolution(frame.positions / self.units.length)
        return step * self.units.length, why
