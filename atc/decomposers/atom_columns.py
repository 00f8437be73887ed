"""Numbers of atoms besides place, type and charge that some forces depend on: columns of the trajectory under LAMMPS's
own names.

They move on their own as the run goes, so that only the frames can show them.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..frame import Frame

SPIN = ("spx", "spy", "spz")
ELECTRON = ("spin", "eradius")
#: Which row of a potential's tables an atom has, where a potential that knows its atoms says it.
KIND = "pair_kind"
#: Columns that some potential depends on.
NAMES = (*SPIN, *ELECTRON, KIND)


def atom_columns(frame: Frame, names: tuple[str, ...], why: str) -> np.ndarray:
    """(n, k) columns `names` of a frame. AtcError if it lacks one, or if it holds what is no number; `why`: what needs
    them."""
    missing = [n for n in names if n not in frame.extra]
    if missing:
        raise AtcError(
            f"{frame.source}: the columns {' '.join(missing)} are missing but {why} needs them: dump them from "
            "'compute name all property/atom "
            f"{' '.join(names)}', with the input script as potential or with 'dump_modify ... colname'"
        )
    try:
        out = np.stack([np.asarray(frame.extra[n], float) for n in names], axis=1)
    except (TypeError, ValueError):
        raise AtcError(
            f"{frame.source}: the columns {' '.join(names)} do not hold numbers, which {why} needs"
        ) from None
    bad = ~np.isfinite(out).all(axis=1)
    if bad.any():
        raise AtcError(f"{frame.source}: atom {frame.ids[bad][0]} has {' '.join(names)} that are not finite numbers")
    return out


def named_columns(words) -> dict[str, str]:
    """{column of a dump: property} of a line 'compute ID group property/atom ...', `words` behind "compute"; none for
    other computes.

    Only those of group all: others hold zeros for the atoms outside.
    """
    if len(words) < 4 or words[1] != "all" or words[2] != "property/atom":
        return {}
    names = words[3:]
    return {f"c_{words[0]}[{k}]" if len(names) > 1 else f"c_{words[0]}": name for k, name in enumerate(names, 1)}
