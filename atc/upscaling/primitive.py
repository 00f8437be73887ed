"""The primitive cell of a crystal that was given by a larger one, whose bands are folded."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

import numpy as np

from .crystal import Crystal

#: How far an atom may be from where a translation puts it, in parts of the mean distance of atoms: what files round.
TOLERANCE = 1e-4


def translations(crystal: Crystal) -> np.ndarray:
    """(m, 3) the translations that map the crystal onto itself, one for each primitive cell in its own, 0 first."""
    from scipy.spatial import cKDTree

    inverse = np.linalg.inv(crystal.vectors)
    s = crystal.positions @ inverse
    s -= np.floor(s)
    s[s >= 1.0] = 0.0
    near = TOLERANCE * (crystal.volume / len(crystal)) ** (1 / 3)
    # In fractional coordinates a distance may look this much larger.
    reach = 2.0 * near * np.linalg.norm(inverse, ord=2)
    kinds, counts = np.unique(crystal.types, return_counts=True)
    trees = {t: (cKDTree(s[crystal.types == t], boxsize=1.0), s[crystal.types == t]) for t in kinds.tolist()}
    few = trees[int(kinds[np.argmin(counts)])][1]

    def maps(t):
        for tree, own in trees.values():
            moved = (own + t) % 1.0
            moved[moved >= 1.0] = 0.0
            distance, k = tree.query(moved, distance_upper_bound=reach)
            if not np.isfinite(distance).all():
                return False
            off = moved - own[k]
            if not (np.linalg.norm((off - np.rint(off)) @ crystal.vectors, axis=1) <= near).all():
                return False
        return True

    found = [few[k] - few[0] for k in range(1, len(few)) if maps(few[k] - few[0])]
    found = np.array([np.zeros(3), *found])
    # m of them are a group of m elements: m times each is a whole translation of the cell.
    return np.rint(found * len(found)) / len(found) @ crystal.vectors


def primitive(crystal: Crystal) -> Crystal:
    """The crystal by its primitive cell, atoms where they are; directions still refer to its conventional cell. Itself
    where its cell is primitive."""
    t = translations(crystal)
    if len(t) == 1:
        return crystal
    cells = np.array(list(product((-1, 0, 1), repeat=3))) @ crystal.vectors
    points = (t[:, None] + cells).reshape(-1, 3)
    size = np.linalg.norm(points, axis=1)
    kept = np.argsort(size, kind="stable")[: 1 + 40 + 3 * len(cells)]
    points = points[kept[size[kept] > 1e-6 * size.max()]]
    volume = crystal.volume / len(t)
    for three in combinations(range(len(points)), 3):
        vectors = points[list(three)]
        det = np.linalg.det(vectors)
        if abs(abs(det) - volume) < 1e-3 * volume:
            vectors = vectors if det > 0 else -vectors
            break
    inverse = np.linalg.inv(vectors)
    rest, own = list(range(len(crystal))), []
    while rest:
        first = rest[0]
        own.append(first)
        s = (crystal.positions[rest] - crystal.positions[first]) @ inverse
        off = np.linalg.norm((s - np.rint(s)) @ vectors, axis=1)
        same = (off < 10 * TOLERANCE * (crystal.volume / len(crystal)) ** (1 / 3)) & (
            crystal.types[rest] == crystal.types[first]
        )
        rest = [n for n, gone in zip(rest, same, strict=True) if not gone]
    return replace(
        crystal,
        vectors=vectors,
        positions=crystal.positions[own],
        masses=crystal.masses[own],
        types=crystal.types[own],
    )


def folded(crystal: Crystal) -> str:
    """One line that says that a crystal's bands are folded, and its primitive cell; empty where they are not."""
    small = primitive(crystal)
    if small is crystal:
        return ""
    u = crystal.units
    rows = ", ".join(
        "[" + " ".join(f"{x:.5g}" for x in row) + "]" for row in np.round(u.to_user("length", small.vectors), 10) + 0.0
    )
    return (
        f"bands are folded: {crystal.name} holds {len(crystal) // len(small)} primitive cells of {len(small)} "
        f"atom{'s' * (len(small) > 1)}, {rows} {u.label('length')}; [dispersion] primitive = true takes that cell"
    )
