"""Which frames of a time average are added up before their sums are finished, and what can be: sums over atoms and
bonds are linear.

One transform, one evaluation on the grid and one comparison then do for all frames of a group, and a time average gets
its blocks ready made. What is not linear in the sums (the kinetic stress, the temperature: relative to the velocity
field of each frame) is formed frame by frame, and its mean taken; sums over bonds that it does not need are added up
all the same. The error check goes its own way: the exact fields of each frame at random points, the same for all frames
of the group, and their mean. Of all strongest bonds of the group as many are summed exactly as of one frame, and the
rest watched.

What a group gives depends on its frames, the settings and the number of its first frame alone.
"""

from __future__ import annotations

from .quantities.quantity import Quantity
from .statistics import longest_block
from .work import Work

#: Atoms of all frames of a group, at most. The frames are held until the group is done: it may have to be computed
#: again.
ATOMS = 2**19
#: Random points of the error check: of all groups of a window together many more than of one frame.
POINTS = 24


def size_of(window: int, atoms: int) -> int:
    """How many frames of a window are added up: a power of two, so that blocks of blocks have whole numbers of
    groups."""
    most = max(1, min(longest_block(window), ATOMS // max(atoms, 1)))
    return 1 << (most.bit_length() - 1)


def added_up(work: Work) -> frozenset[str]:
    """The deposits whose sums can be added up over frames ("site", "bond"); none if there is no gain in groups, or
    something asked is not made for them."""
    if any(
        (work.gather, work.reference_gather, work.reference_bond, work.point, work.reference_point, work.on_reference)
    ):
        return frozenset()
    if any(q.kind == "atom" for q in work.quantities):
        return frozenset()
    uses = [(q.linear, {key for key in ("site", "bond") if getattr(q, key)}) for q in work.elements]
    found = set().union(*(keys for _, keys in uses))
    while True:
        spoilt = set().union(*(keys for linear, keys in uses if not (linear and keys <= found))) & found
        if not spoilt:
            break
        found -= spoilt
    return frozenset(found if "bond" in found or not work.bond else ())


def formed_once(work: Work) -> list[Quantity]:
    """Those that are formed once, from the mean sums."""
    together = added_up(work)
    return [q for q in work.elements if q.linear and {key for key in ("site", "bond") if getattr(q, key)} <= together]


def of_one_cell(frames) -> list[list]:
    """Consecutive frames that share a cell: a cell that changes ends a sum."""
    runs: list[list] = []
    for frame in frames:
        if runs and frame.cell.complete and frame.cell == runs[-1][-1].cell:
            runs[-1].append(frame)
        else:
            runs.append([frame])
    return runs
