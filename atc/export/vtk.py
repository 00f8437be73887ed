"""VTK's XML files for ParaView: nodes as .vtu, regular grids as .vti, other lattices as .vts, and the .pvd that makes a
time series of them.

Data are appended in raw binary: a file is as large as its numbers. Regular grids are the exception: their numbers stand
inline in base64, uncompressed and without bytes for yes and no, since OVITO reads no other .vti. Every file is written
beside its name and renamed, so that a viewer that looks while a run goes on never sees half a file.
"""

from __future__ import annotations

import os
from base64 import b64encode
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ..running.whole import renamed

_TYPES = {"f8": "Float64", "f4": "Float32", "i4": "Int32", "i8": "Int64", "u1": "UInt8", "i2": "Int16"}


class _Arrays:
    """The XML of arrays."""

    boolean = np.uint8

    def array(self, name: str, values, unit: str | None = None) -> str:
        a = np.ascontiguousarray(values)
        if a.dtype.kind == "b":
            a = a.astype(self.boolean)
        a = a.astype(a.dtype.newbyteorder("<"), copy=False)
        shape = a.shape
        components = 1 if a.ndim == 1 else int(np.prod(shape[1:]))
        extra = f' NumberOfComponents="{components}"' if components > 1 else ""
        data = a.tobytes()
        where, text = self.put(np.uint64(len(data)).tobytes() + data)
        tag = f'<DataArray type="{_TYPES[a.dtype.str[1:]]}" Name={quoteattr(name)}{extra} {where}'
        # What VTK itself writes for vtkDataArray::UNITS_LABEL; behind numbers, which begin where the tag ends.
        if unit:
            text += f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(unit)}</InformationKey>'
        return tag + (f">{text}</DataArray>" if text else "/>")

    def put(self, block: bytes) -> tuple[str, str]:
        """Where the numbers are (attributes of the array), and what stands within it."""
        raise NotImplementedError

    def point_data(self, arrays: dict, units: dict | None) -> str:
        data = "".join(self.array(name, a, (units or {}).get(name)) for name, a in arrays.items())
        return f"<PointData>{data}</PointData>"

    def field_data(self, values: dict) -> str:
        if not values:
            return ""
        out = []
        for name, v in values.items():
            a = np.atleast_1d(np.asarray(v))
            out.append(self.array(name, a).replace("<DataArray ", f'<DataArray NumberOfTuples="{len(a)}" ', 1))
        return "<FieldData>" + "".join(out) + "</FieldData>"

    def write(self, path: Path, kind: str, body: str) -> None:
        order = 'byte_order="LittleEndian" header_type="UInt64"'
        head = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" {order}>\n{body}\n'
        with renamed(path) as part, open(part, "wb") as f:
            f.writelines([head.encode(), *self.behind(), b"</VTKFile>\n"])

    def behind(self):
        """What follows the body, in pieces."""
        return ()


class _Appended(_Arrays):
    """Numbers follow in one raw block at the end of the file."""

    def __init__(self):
        self.blocks, self.offset = [], 0

    def put(self, block):
        where = f'format="appended" offset="{self.offset}"'
        self.blocks.append(block)
        self.offset += len(block)
        return where, ""

    def behind(self):
        return b'<AppendedData encoding="raw">\n_', *self.blocks, b"\n</AppendedData>\n"


class _Inline(_Arrays):
    """Numbers stand where their array is, in base64."""

    boolean = np.int32

    def put(self, block):
        return 'format="binary"', b64encode(block).decode()


def write_nodes(path, x_nc, arrays: dict, about: dict | None = None, units: dict | None = None) -> None:
    """A .vtu of points, each a vertex cell.

    Parameters
    ----------
    path : the file to write
    x_nc : (n, 3) positions
    arrays : {name: (n,), (n, 3) or (n, 3, 3)}; tensors are written row by row
    about : {name: number} of the whole file, e.g. the time
    units : {name: unit} of arrays, as the label that ParaView shows
    """
    out = _Appended()
    n = len(x_nc)
    index = np.int64 if n > 2**31 - 1 else np.int32
    body = (
        f'<UnstructuredGrid>{out.field_data(about or {})}<Piece NumberOfPoints="{n}" NumberOfCells="{n}">'
        + out.point_data(arrays, units)
        + "<Points>" + out.array("Points", np.asarray(x_nc, float)) + "</Points><Cells>"
        + out.array("connectivity", np.arange(n, dtype=index)) + out.array("offsets", np.arange(1, n + 1, dtype=index))
        + out.array("types", np.ones(n, np.uint8)) + "</Cells></Piece></UnstructuredGrid>"
    )  # fmt: skip
    out.write(Path(path), "UnstructuredGrid", body)


def write_image(
    path, origin, spacing, shape, arrays: dict, about: dict | None = None, units: dict | None = None
) -> None:
    """A .vti: a regular grid along x, y and z.

    origin, spacing : (3,) of the first point and between points. shape : (3,) numbers of points. arrays : {name:
        (*shape, ...)}, x slowest as in `atc.Grid`.
    """
    out = _Inline()
    extent = " ".join(f"0 {n - 1}" for n in shape)
    numbers = lambda a: " ".join(repr(float(v)) for v in a)  # noqa: E731
    body = (
        f'<ImageData WholeExtent="{extent}" Origin="{numbers(origin)}" '
        f'Spacing="{numbers(spacing)}">{out.field_data(about or {})}<Piece Extent="{extent}">'
        + out.point_data({k: _x_fastest(a) for k, a in arrays.items()}, units)
        + "</Piece></ImageData>"
    )
    out.write(Path(path), "ImageData", body)


def write_lattice(path, points, arrays: dict, about: dict | None = None, units: dict | None = None) -> None:
    """A .vts: points (nx, ny, nz, 3) in rows, wherever they are; arrays as in `write_image`."""
    out = _Appended()
    extent = " ".join(f"0 {n - 1}" for n in points.shape[:3])
    body = (
        f'<StructuredGrid WholeExtent="{extent}">{out.field_data(about or {})}<Piece Extent="{extent}">'
        + out.point_data({k: _x_fastest(a) for k, a in arrays.items()}, units)
        + "<Points>" + out.array("Points", _x_fastest(points)) + "</Points></Piece></StructuredGrid>"
    )  # fmt: skip
    out.write(Path(path), "StructuredGrid", body)


def write_series(path, files, times) -> None:
    """The .pvd: which file belongs to which time. File names are relative to it."""
    path = Path(path)
    rows = "\n".join(
        f'<DataSet timestep="{float(t)!r}" file={quoteattr(os.path.relpath(f, path.parent))}/>'
        for f, t in zip(files, times, strict=True)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0">\n'
    with renamed(path) as part:
        part.write_text(f"{head}<Collection>\n{rows}\n</Collection>\n</VTKFile>\n")


def _x_fastest(a):
    a = np.asarray(a)
    return np.ascontiguousarray(np.moveaxis(a, (0, 1, 2), (2, 1, 0))).reshape(-1, *a.shape[3:])
