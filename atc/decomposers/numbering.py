"""Atoms by their ids, and pairs of atoms as single numbers."""

from __future__ import annotations

import numpy as np

from ..frame import Frame


def atoms_of_ids(frame: Frame, ids) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the atoms with these ids, and which of the ids the frame has."""
    ids = np.asarray(ids, np.int64)
    found, order = np.isin(ids, frame.ids), np.argsort(frame.ids, kind="stable")
    index = np.zeros(ids.shape, np.int64)
    index[found] = order[np.searchsorted(frame.ids, ids[found], sorter=order)]
    return index, found


def pair_codes(pairs, n: int) -> np.ndarray:
    """(m,) one number for each pair of n atoms, the same whichever comes first."""
    return np.sort(np.asarray(pairs, np.int64).reshape(-1, 2), axis=1) @ np.array([n, 1])
