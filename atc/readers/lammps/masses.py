"""Masses of atoms that have a density and a shape of their own, as LAMMPS's read_data makes them.

The density is multiplied with the volume as it stands, in every unit style: LAMMPS does not convert it (with ``units
real`` or ``metal`` a density of 1 makes 1 g/mol/Å³). A particle without extent has the density column as its mass. A
hybrid of several shapes multiplies with the volume of each. Checked against the masses that LAMMPS 22 Jul 2025 has
behind read_data.
"""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from .atom_styles import SHAPED

# What belongs to each shape: the section, the column of the Atoms section that says whether an atom has it, the columns
# of the section.
SHAPES = {
    "ellipsoid": ("Ellipsoids", "ellipsoidflag", "id shapex shapey shapez quatw quati quatj quatk"),
    "line": ("Lines", "lineflag", "id x1 y1 x2 y2"),
    "tri": ("Triangles", "triangleflag", "id x1 y1 z1 x2 y2 z2 x3 y3 z3"),
}
_BALL = np.pi / 6.0
_POINT = 0.5**3 * 4.0 / 3.0 * np.pi  # lines and triangles without extent are balls of radius 1/2


def masses_by_shape(parts, atoms: dict, sections: dict, source: str) -> np.ndarray | None:
    """(n,) masses in the file's units and order; None if the style has none of its own.

    Parameters
    ----------
    parts : names of the atom style's parts
    atoms : columns of section Atoms
    sections : {"Ellipsoids": columns, ...}

    Raises
    ------
    AtcError for particles whose flag and section do not go together.
    """
    if "mass" in atoms:
        mass = atoms["mass"].copy()
    elif "density" in atoms and set(parts) & SHAPED:  # peri's density is none: LAMMPS moves its particles by it
        mass = atoms["density"].copy()
    else:
        return None
    d = atoms.get("diameter")
    for part in parts:
        if part in ("sphere", "bpm/sphere"):
            if d is None:
                return None  # smd's contact radius is its size
            mass = mass * np.where(d > 0, _BALL * d**3, 1.0)
            d = d / 2  # what a second such style takes for the diameter
        elif part in SHAPES:
            extent, has = _extents(part, atoms, sections, source)
            mass[has] *= extent
            if part != "ellipsoid":
                mass[~has] *= _POINT
    return mass


def centres(part, atoms: dict, sections: dict) -> None:
    """Lines and triangles lie where the middle of their corners is, as LAMMPS puts them: their positions in section
    Atoms are checked only roughly."""
    s = sections.get(SHAPES[part][0])
    if s is None or not len(s["id"]):
        return
    has = atoms[SHAPES[part][1]] != 0
    order = np.argsort(s["id"])
    row = order[np.searchsorted(s["id"][order], atoms["id"][has])]
    for a in "xyz":
        corners = [s[f"{a}{k}"] for k in (1, 2, 3) if f"{a}{k}" in s]
        if corners:
            atoms[a][has] = (sum(corners) / len(corners))[row]


def _extents(part, atoms, sections, source):
    """Volumes, areas or lengths of the atoms that have a shape, in the order of the file, and (n,) bool which they
    are."""
    name, flag, _ = SHAPES[part]
    has = atoms[flag] != 0
    s = sections.get(name)
    ids = np.zeros(0, np.int64) if s is None else s["id"]
    order = np.argsort(ids)
    if not np.array_equal(ids[order], np.sort(atoms["id"][has])):
        raise AtcError(
            f"{source}: section {name} has {len(ids)} lines, but {int(has.sum())} atoms with {flag} 1, or not of the "
            "same atoms"
        )
    if not len(ids):
        return np.zeros(0), has
    row = order[np.searchsorted(ids[order], atoms["id"][has])]
    if part == "ellipsoid":
        size = np.stack([s["shapex"], s["shapey"], s["shapez"]], axis=1)
        if (size < 0).any():
            raise AtcError(f"{source}: section {name}: atom {ids[(size < 0).any(axis=1)][0]} has a negative diameter")
        return _BALL * size.prod(axis=1)[row], has
    nothing, corners = np.zeros(len(ids)), [k for k in (1, 2, 3) if f"x{k}" in s]
    p = [np.stack([s.get(f"{a}{k}", nothing) for a in "xyz"], axis=1) for k in corners]
    if part == "line":
        return np.linalg.norm(p[1] - p[0], axis=1)[row], has
    return 0.5 * np.linalg.norm(np.cross(p[1] - p[0], p[2] - p[0]), axis=1)[row], has
