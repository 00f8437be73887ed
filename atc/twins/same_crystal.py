"""Whether the reference of a twin is the crystal that [twin] says, and lies as it says: what is derived from another
one, or from a turned one, would be wrong without anything else showing it."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..neighbors.cell_list import neighbor_list

#: A bond points along one of the crystal's if less than this is between them: at the melting point hardly one in a
#: hundred is turned by as much.
_ANGLE = np.deg2rad(15)
#: Shares of bonds, less what chance gives, below which it is said and refused.
_SAID, _REFUSED = 0.8, 0.3


def shells(crystal) -> tuple[float, float, np.ndarray]:
    """Distances of nearest and second neighbours in a crystal; (b, 3) unit vectors to the nearest ones of all places of
    the basis."""
    block, _ = crystal.supercell((4, 4, 1) if crystal.dimension == 2 else (3, 3, 3))
    _, _, r, _ = neighbor_list(block.positions, block.cell, 2.0 * crystal.volume ** (1 / crystal.dimension), half=False)
    d = np.linalg.norm(r, axis=1)
    first = d.min()
    n = r[d < 1.02 * first] / first
    return first, d[d > 1.02 * first].min(), np.unique(np.round(n, 6), axis=0)


def share_along(reference, crystal, axes) -> tuple[float, float]:
    """Share of the nearest-neighbour bonds of a frame that point along those of a crystal, and the share that would by
    chance. axes : (3, 3) rows, where the crystal's x, y, z point"""
    first, second, n_bc = shells(crystal)
    i, _, r, _ = neighbor_list(reference.positions, reference.cell, 0.5 * (first + second))
    d = crystal.dimension
    chance = len(n_bc) * (_ANGLE / np.pi if d == 2 else 0.5 * (1 - np.cos(_ANGLE)))
    if not len(i):
        return 0.0, chance
    r = r / np.linalg.norm(r, axis=1)[:, None]
    return float(np.mean((r @ (n_bc @ axes).T).max(axis=1) > np.cos(_ANGLE))), chance


def require_same_crystal(reference, crystal, axes, what, where, refuse: bool) -> None:
    """Say that the reference's atoms do not lie as the crystal's, or refuse it.

    Parameters
    ----------
    what, where : the crystal's name, and what of a scene asks for it
    refuse : whether the material depends on where the crystal's axes point
    """
    share, chance = share_along(reference, crystal, axes)
    like = (share - chance) / (1 - chance)
    if like > _SAID:
        return
    said = (
        f"{where}: [twin] structure, orient: {100 * share:.2g} % of the nearest-neighbour bonds of "
        f"{reference.source} point along those of {what} with these axes ({100 * chance:.2g} % would by chance): check "
        "structure, lattice_constant and orient; a melt, a glass or many grains have no such twin"
    )
    if refuse and like < _REFUSED:
        raise AtcError(said)
    warnings.warn(said, AtcWarning, stacklevel=3)
