"""CHARMM's correction maps (LAMMPS ``fix cmap``): what they are, who uses which, and why they have no forces along
bonds.

A crossterm's energy is a map over two torsions (φ, ψ) of five atoms in a chain, both with their signs: CHARMM's maps
tell L- from D-amino acids. A mirror image has (−φ, −ψ); unless the map is the same there, the energy is not a function
of the distances between the five atoms, and no forces along bonds belong to it (R 4.0.28). So it is with all maps of
charmm22.cmap and charmm36.cmap. Glycine, which has no hand, is no exception: its maps are symmetric but for a few
entries of these files, which differ by up to 5.1 and 2.9 kcal/mol, and LAMMPS takes them as they stand.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...readers.whole import whole_text

#: points of a map in each direction: every 15°, from −180°
POINTS = 24


def read_maps(path, where: str = "") -> np.ndarray:
    """(maps, 24, 24) energies of a file of correction maps in its own units, φ in the first direction, both from −180°
    in steps of 15°.

    Raises AtcError for a missing file, a word that is no number, or an incomplete map.
    """
    lines = whole_text(path, "correction maps", where).splitlines()
    values = []
    for number, line in enumerate(lines, 1):
        for word in line.partition("#")[0].split():
            try:
                values.append(float(word))
            except ValueError:
                raise AtcError(f"{path}:{number}: expected the energies of a correction map, got {word!r}") from None
    if not values or len(values) % POINTS**2 or not np.isfinite(values).all():
        raise AtcError(
            f"{path}: correction maps have {POINTS} x {POINTS} finite numbers each, this file has {len(values)} numbers"
        )
    return np.reshape(values, (-1, POINTS, POINTS))


def read_crossterms(path, section: str = "CMAP") -> tuple[np.ndarray, np.ndarray]:
    """Types (m,) and atom ids (m, 5) of the section of a LAMMPS data file that ``read_data ... fix ID crossterm CMAP``
    names; empty without it.

    Raises AtcError for a row that is not ``index type`` and five ids.
    """
    lines = whole_text(path, "data").splitlines()
    start = next((k for k, line in enumerate(lines) if line.partition("#")[0].strip() == section), None)
    rows = []
    for number, line in enumerate(lines[start + 1 :] if start is not None else (), (start or 0) + 2):
        words = line.partition("#")[0].split()
        if not words:
            if rows:
                break
            continue
        if not all(re.fullmatch(r"\d+", w) for w in words):
            # The name of the next section.
            break
        if len(words) != 7:
            raise AtcError(
                f"{path}:{number}: a row of section {section} has an index, a type and five atom ids, got "
                f"{line.strip()!r}"
            )
        rows.append([int(w) for w in words[1:]])
    table = np.array(rows, np.int64).reshape(-1, 6)
    return table[:, 0], table[:, 1:]


def handedness(map_pq: np.ndarray) -> float:
    """The largest difference between a map and that of the mirror image, U(φ, ψ) − U(−φ, −ψ)."""
    mirror = -np.arange(len(map_pq)) % len(map_pq)
    return float(np.abs(map_pq - map_pq[np.ix_(mirror, mirror)]).max())


def check_fix_cmap(words, folder, where: str, types) -> None:
    """What a ``fix ID group cmap file`` line means for the model: nothing where no crossterm has energy, otherwise an
    error that says why.

    Parameters
    ----------
    words : the words behind ``cmap``: the file
    folder : where the file is looked up
    where : file and line, for messages
    types : (m,) types of the crossterms (`read_crossterms`), which choose the maps

    Raises
    ------
    AtcError for any crossterm that has energy: CHARMM's maps tell a molecule from its mirror image.
    """
    if len(words) != 1:
        raise AtcError(f"{where}: fix cmap takes the file of its maps, got {' '.join(words) or 'nothing'}")
    path = Path(words[0]).expanduser()
    path = path if path.is_absolute() else Path(folder) / path
    maps = read_maps(path, where)
    for t in np.unique(types):
        count = int(np.count_nonzero(np.asarray(types) == t))
        if not 1 <= t <= len(maps):
            raise AtcError(f"{where}: crossterms of type {t}, but {path} has {len(maps)} correction maps")
        m = maps[t - 1]
        if not m.any():
            continue
        differs = handedness(m)
        if differs > 1e-10 * np.ptp(m):
            why = (
                f"its energy over (phi, psi) differs from that of the mirror image by up to {differs:.4g}, so it is "
                "not a function of distances and has no forces along bonds"
            )
        else:
            why = "maps that are the same for the mirror image are not done yet"
        raise AtcError(
            f"{where}: fix cmap: {count} crossterms use map {t}: {why}: its forces cannot be part of the fields, so "
            "run without fix cmap"
        )
