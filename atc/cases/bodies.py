"""Nodes of a peridynamic body from files: CSV, extended XYZ, LAMMPS data files (atom_style peri), and the cells of a
mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from ..readers._bytes import require_file


@dataclass
class Nodes:
    """x_nc (n, 3), volume_n, density_n, material_n (n,); cell or None; sets, {name: (n,) bools} of a mesh. Numbers as
    in the file."""

    x_nc: np.ndarray
    volume_n: np.ndarray
    density_n: np.ndarray
    material_n: np.ndarray
    cell: object = None
    sets: dict = field(default_factory=dict)


def read_nodes(path, settings, bad) -> Nodes:
    """The nodes in a file.

    Parameters
    ----------
    path : ``.csv`` (a header with x, y, z and maybe volume, density, material), ``.xyz``/``.extxyz`` (columns volume,
        density, material), a LAMMPS data file with
        ``atom_style peri`` (its types are the materials), or a mesh that meshio reads (.vtu, .vtk, .msh, ...): a node
        for each cell, at its centroid, with its volume
    settings : {"density": ..., "volume": ..., "dimension": ..., "thickness": ...}: what the file does not say
    bad : makes the AtcError from a reason
    """
    path = Path(path)
    suffix = path.suffix.lower()

    try:
        require_file(path)  # no pipe or device, which libraries would wait for
        if suffix == ".csv":
            columns = _csv(path)
        elif suffix in (".xyz", ".extxyz"):
            columns = _extxyz(path)
        elif suffix in (".data", ".lmp", ".lammps") or _is_lammps(path):
            columns = _lammps(path)
        else:
            columns = _mesh(path, int(settings.get("dimension", 3)), float(settings.get("thickness", 1.0)))
    except AtcError as e:
        raise bad(str(e)) from None
    x = columns["x_nc"]
    if not len(x):
        raise bad(f"{path} holds no nodes")
    n = len(x)
    for name in ("volume", "density"):
        if name in settings:
            columns[name] = np.full(n, float(settings[name]))
        elif columns.get(name) is None:
            raise bad(f"{path} does not say the {name} of its nodes: give a column {name!r}, or {name} in [body]")
    material = columns.get("material")
    return Nodes(
        x,
        columns["volume"],
        columns["density"],
        np.ones(n, int) if material is None else np.asarray(material).astype(int),
        columns.get("cell"),
        columns.get("sets", {}),
    )


def _csv(path):
    import pandas as pd

    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (OSError, ValueError, UnicodeDecodeError) as e:
        raise AtcError(f"{path}: cannot be read as a table: {str(e).splitlines()[0]}") from None
    table.columns = [str(c).strip().lower() for c in table.columns]
    missing = [c for c in ("x", "y", "z") if c not in table]
    if missing:
        raise AtcError(
            f"{path}: its header needs the columns x, y, z (and maybe volume, density, material); missing: "
            f"{', '.join(missing)}"
        )
    unknown = [c for c in table if c not in ("x", "y", "z", "volume", "density", "material")]
    if unknown:
        raise AtcError(f"{path}: unknown column {unknown[0]!r}; known: x, y, z, volume, density, material")
    out = {}
    for name in table:
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
        if not np.isfinite(values).all():
            raise AtcError(
                f"{path}: column {name!r} has no number in row {int(np.flatnonzero(~np.isfinite(values))[0]) + 1} "
                "below the header"
            )
        out[name] = values
    out["x_nc"] = np.stack([out.pop(c) for c in "xyz"], axis=1)
    return out


def _extxyz(path):
    try:
        from ase.io import read
    except ImportError:
        raise AtcError(f"{path}: reading extended XYZ needs ASE: pip install ase") from None
    try:
        atoms = read(path, index=0, format="extxyz")
    except Exception as e:  # ase raises what it likes
        raise AtcError(f"{path}: not extended XYZ: {' '.join(str(e).split()) or type(e).__name__}") from None
    a = {k.lower(): np.asarray(v) for k, v in atoms.arrays.items()}
    out = {"x_nc": np.array(atoms.positions, float)}
    for name in ("volume", "density", "material"):
        if name in a:
            out[name] = a[name].astype(float)
    if atoms.pbc.any():
        out["cell"] = Cell(np.array(atoms.cell, float), periodic=atoms.pbc)
    return out


def _is_lammps(path) -> bool:
    from ..readers.lammps.data_header import looks_like_data

    with open(path, "rb") as f:
        return looks_like_data(f.read(4096))


def _lammps(path):
    from .. import read

    # "lj": numbers as they are
    frame = read(path, units="lj")[0]
    if "volume" not in frame.extra:
        raise AtcError(f"{path}: its atoms have no volume: expected a data file of atom_style peri (Atoms # peri)")
    return {
        "x_nc": frame.positions,
        "volume": frame.extra["volume"],
        "density": frame.extra["density"],
        "material": frame.types,
    }


# Cells of a mesh: how to cut them into simplices, by meshio's names (corner nodes only).
_SIMPLICES = {
    "line": [(0, 1)],
    "triangle": [(0, 1, 2)],
    "quad": [(0, 1, 2), (0, 2, 3)],
    "tetra": [(0, 1, 2, 3)],
    "pyramid": [(0, 1, 2, 4), (0, 2, 3, 4)],
    "wedge": [(0, 1, 2, 3), (1, 2, 3, 4), (2, 3, 4, 5)],
    "hexahedron": [(0, 1, 3, 4), (1, 2, 3, 6), (1, 4, 5, 6), (3, 4, 6, 7), (1, 3, 4, 6)],
}
_DIMENSION = {"line": 1, "triangle": 2, "quad": 2, "tetra": 3, "pyramid": 3, "wedge": 3, "hexahedron": 3}


def _mesh(path, dimension, thickness):
    try:
        import meshio
    except ImportError:
        raise AtcError(f"{path}: reading a mesh needs meshio: pip install meshio") from None
    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as e:  # meshio leaves through sys.exit for unknown formats
        raise AtcError(
            f"{path}: expected .csv, extended XYZ, a LAMMPS data file or a mesh; not a mesh that meshio reads: "
            f"{' '.join(str(e).split()) or type(e).__name__}"
        ) from None
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    centres, volumes, parts, kept = [], [], [], []
    for k, block in enumerate(mesh.cells):
        name = next((n for n in _SIMPLICES if block.type == n or block.type.rstrip("0123456789") == n), None)
        if name is None or _DIMENSION[name] != dimension:
            continue
        corners = points[block.data]
        total, moment = 0.0, 0.0
        for simplex in _SIMPLICES[name]:
            p = corners[:, list(simplex)]
            size = _size(p)
            total = total + size
            moment = moment + size[:, None] * p.mean(axis=1)
        centres.append(moment / total[:, None])
        volumes.append(total)
        parts.append(k)
        kept.append(block.data[:, : 1 + max(max(s) for s in _SIMPLICES[name])])
    if not centres:
        raise AtcError(
            f"{path}: has no cells of dimension {dimension}: found "
            f"{', '.join(sorted({b.type for b in mesh.cells})) or 'none'}"
        )
    out = {"x_nc": np.concatenate(centres), "volume": np.concatenate(volumes) * (thickness if dimension < 3 else 1.0)}
    for name in ("density", "material"):
        if name in mesh.cell_data:
            out[name] = np.concatenate([np.asarray(mesh.cell_data[name][k], float).reshape(-1) for k in parts])
    out["sets"] = _sets(mesh, parts, kept)
    if not (out["volume"] > 0).all():
        raise AtcError(f"{path}: cell {int(np.flatnonzero(~(out['volume'] > 0))[0])} has no volume")
    return out


def _sets(mesh, parts, kept) -> dict:
    """{name: (n,) bools over the body's cells} of a mesh's sets: Abaqus's ELSET and NSET, gmsh's physical groups,
    Exodus's node sets.

    A set of cells of the body holds them; one of faces or edges, the cells that have one of these whole; one of points,
    the cells with a corner among them. parts, kept : the body's blocks of cells, and their corners.
    """
    from scipy.sparse import csr_matrix

    counts = np.concatenate([np.full(len(c), c.shape[1]) for c in kept])
    which = np.repeat(np.arange(len(counts)), counts)
    points = np.concatenate([c.reshape(-1) for c in kept])
    touch = csr_matrix((np.ones(len(points)), (which, points)), shape=(len(counts), len(mesh.points)))
    start = dict(zip(parts, np.concatenate([[0], np.cumsum([len(c) for c in kept])]).tolist()))
    members: dict = {name: list(of) for name, of in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    physical = mesh.cell_data.get("gmsh:physical")
    for name, (number, _) in mesh.field_data.items() if physical is not None else ():
        members[name] = [np.flatnonzero(np.asarray(block).reshape(-1) == number) for block in physical]
    out = {}
    for name, of in members.items():
        inside = np.zeros(len(counts), bool)
        for k, cells in enumerate(of):
            if cells is None or not len(cells):
                continue
            cells = np.asarray(cells, int)
            if k in start:
                inside[start[k] + cells] = True
                continue
            plain = mesh.cells[k].type.rstrip("0123456789")
            n = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4}.get(plain)
            if n is not None:
                facet = mesh.cells[k].data[cells, :n]
                rows = np.repeat(np.arange(len(facet)), n)
                whole = csr_matrix((np.ones(facet.size), (rows, facet.reshape(-1))), (len(facet), len(mesh.points)))
                inside[(touch @ whole.T >= n).nonzero()[0]] = True
        out[name] = inside
    for name, nodes in mesh.point_sets.items():
        chosen = np.zeros(len(mesh.points))
        chosen[np.asarray(nodes, int)] = 1.0
        inside = touch @ chosen > 0
        out[name] = out[name] | inside if name in out else inside
    return out


def _size(p):
    """Length, area or volume of simplices (m, corners, 3)."""
    e = p[:, 1:] - p[:, :1]
    gram = np.einsum("mac,mbc->mab", e, e)
    return np.sqrt(np.maximum(np.linalg.det(gram), 0.0)) / [1, 1, 2, 6][e.shape[1]]
