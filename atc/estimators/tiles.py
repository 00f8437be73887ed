"""A frame computed tile by tile, each small enough for one worker: every bond belongs to exactly one of them, so that
their sums add up.

How a frame is cut is in `tile_cuts`. The potential sees a tile as an open cluster. A bond is the tile's if its end with
the lower index is one of the tile's own atoms; a bond of an atom with its own image, if that image lies in the positive
direction. Where a bond's field falls does not matter: each tile adds to the whole grid of the whole cell. Sums per atom
are complete in the tile that owns the atom.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace

import numpy as np

from ..errors import AtcError
from .bond_pass import BondCollector, BondPass, BondTask, BondTotals, PerAtom
from .tile_cuts import Cut, Tile
from .work import Work


@dataclass(frozen=True)
class TileShare:
    """A tile's share of the sums over bonds, and the sums of its own atoms (indices `own`)."""

    own: np.ndarray
    totals: BondTotals
    per_atom: PerAtom
    notes: dict[str, int] = field(default_factory=dict)


def refuse(work: Work, pot) -> None:
    """Raise for what is not computed in tiles."""
    if not pot.terms:
        raise AtcError(
            "tiles: only potentials made of atc's terms are cut into tiles, not the bonds of a body: leave tiles out"
        )
    if work.force_users:
        raise AtcError(f"tiles: {', '.join(work.force_users)} need all forces on an atom at once: leave tiles out")
    if pot.constraints is not None:
        raise AtcError(
            f"tiles: the forces of {pot.constraints.describe()} depend on all forces on a molecule, which a tile does "
            "not have: leave tiles out"
        )


def tile_sums(tile: Tile, task: BondTask) -> TileShare:
    """The tile's share of every sum over bonds: on the grid, at the points of the check, of its own atoms, and the
    virial."""
    collector = BondCollector(tile.frame, task, tile.reference, tile=tile)
    decomposition = collector.stream(tile.potential(task.pot))
    own = np.flatnonzero(tile.own_p)
    found = collector.per_atom(decomposition)
    per_atom = PerAtom(*(None if (x := getattr(found, f.name)) is None else x[own] for f in fields(PerAtom)))
    return TileShare(tile.index_p[own], collector.totals(decomposition), per_atom, decomposition.notes)


def here_in_turn(f: Callable[[Tile, BondTask], TileShare], tiles: Iterable[Tile], task: BondTask):
    """Tiles computed one after the other, in this process."""
    return (f(tile, task) for tile in tiles)


def tiled_bond_pass(frame, task: BondTask, to_reference, counts, run) -> BondPass:
    """Like the pass over the bonds of a whole frame (`bond_pass.bond_pass`), tile by tile.

    counts : tiles along the cell's edges
    run : (tile_sums, iterable of tiles, task) -> their results in order; where the tiles are computed is its affair
    """
    work = task.work
    refuse(work, task.pot)
    cut = Cut(frame, counts, task.pot, to_reference)
    task = replace(
        task,
        pot=cut.pot,
        here=task.here if work.bond or work.point else None,
        reference=task.reference if work.reference_bond or work.reference_point else None,
    )
    totals, of_atoms, notes = None, {}, {}
    for share in run(tile_sums, cut.tiles(), task):
        totals = share.totals if totals is None else totals + share.totals
        for f in fields(PerAtom):
            values = getattr(share.per_atom, f.name)
            if values is not None:
                if f.name not in of_atoms:
                    of_atoms[f.name] = np.zeros((len(frame), *values.shape[1:]))
                of_atoms[f.name][share.own] = values
        # What neighbouring tiles both looked at is counted by both.
        for what, count in share.notes.items():
            notes[what] = notes.get(what, 0) + count
    return BondPass(totals, PerAtom(**of_atoms), notes)
