"""Paths through a crystal's Brillouin zone, by the names that its points have in the literature.

The points of the lattices in `TABLE` are those of Hinuma, Pizzi, Kumagai, Oba and Tanaka, Comput. Mater. Sci. 128, 140
(2017), in units of the reciprocal vectors of their primitive cells; other lattices are for seekpath, which has all of
theirs. Which lattice a crystal has is found from its vectors, so that any primitive cell in any orientation will do.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import combinations, pairwise, product

import numpy as np

from ..errors import AtcError
from .crystal import Crystal
from .sites import Sites

GAMMA = "Γ"
#: Words for Greek letters in seekpath's names.
GREEK = {"GAMMA": GAMMA, "SIGMA": "Σ", "DELTA": "Δ", "LAMBDA": "Λ"}
_SIXTH = {"K": "1/3 1/3 0", "M": "1/2 0 0", "A": "0 0 1/2", "L": "1/2 0 1/2", "H": "1/3 1/3 1/2"}

#: lattice: (name, the usual path, points). Numbers, or formulas of h and z (tetragonal, body-centred).
TABLE = {
    "cP": ("simple cubic", "Γ-X-M-Γ-R-X|R-M", {"X": "0 1/2 0", "M": "1/2 1/2 0", "R": "1/2 1/2 1/2"}),
    "cI": ("body-centred cubic", "Γ-H-N-Γ-P-H|P-N", {"H": "1/2 -1/2 1/2", "N": "0 0 1/2", "P": "1/4 1/4 1/4"}),
    "cF": (
        "face-centred cubic",
        "Γ-X-W-K-Γ-L",
        {"X": "1/2 0 1/2", "L": "1/2 1/2 1/2", "W": "1/2 1/4 3/4", "K": "3/8 3/8 3/4", "U": "5/8 1/4 5/8"},
    ),
    "hP": ("hexagonal", "Γ-M-K-Γ-A-L-H-A|L-M|H-K", _SIXTH),
    "tP": (
        "simple tetragonal",
        "Γ-X-M-Γ-Z-R-A-Z|X-R|M-A",
        {"X": "0 1/2 0", "M": "1/2 1/2 0", "Z": "0 0 1/2", "R": "0 1/2 1/2", "A": "1/2 1/2 1/2"},
    ),
    "tI1": (
        "body-centred tetragonal, c < a",
        "Γ-X-M-Γ-Z|Z0-M|X-P-N-Γ",
        {"M": "-1/2 1/2 1/2", "X": "0 0 1/2", "P": "1/4 1/4 1/4", "Z": "h h -h", "Z0": "-h 1-h h", "N": "0 1/2 0"},
    ),
    "tI2": (
        "body-centred tetragonal, c > a",
        "Γ-X-P-N-Γ-M-S|S0-Γ|X-R|G-M",
        {
            "M": "1/2 1/2 -1/2",
            "X": "0 0 1/2",
            "P": "1/4 1/4 1/4",
            "N": "0 1/2 0",
            "S0": "-h h h",
            "S": "h 1-h -h",
            "R": "-z z 1/2",
            "G": "1/2 1/2 -z",
        },
    ),
}
# Primitive vectors in units of the conventional ones.
_BODY = np.array([[-0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, -0.5]])
_FACE = np.array([[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]])
_CENTRES = {("c", 1): ("cP", np.eye(3)), ("c", 2): ("cI", _BODY), ("c", 4): ("cF", _FACE), ("h", 1): ("hP", np.eye(3))}


@dataclass
class Segment:
    """A straight piece of a path. ends : names of its two points. k_ec : (2, 3) where they are, internal 1/length."""

    ends: tuple[str, str]
    k_ec: np.ndarray

    @property
    def label(self) -> str:
        return "–".join(self.ends)

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.k_ec[1] - self.k_ec[0]))


def bravais(crystal: Crystal, tolerance: float = 1e-5):
    """The lattice of a crystal: its key in `TABLE`, and (3, 3) rows, a conventional cell; (None, None) for others.

    tolerance : of lengths, relative, and of cosines.
    """
    reach = np.linalg.norm(crystal.vectors, axis=1).max() * 2.01
    short = 1.0 / np.linalg.norm(np.linalg.inv(crystal.vectors), axis=0).max()
    most = min(int(np.ceil(reach / short)), 4)
    n = np.array([m for m in product(range(-most, most + 1), repeat=3) if m > (0, 0, 0)])
    v = n @ crystal.vectors
    length = np.linalg.norm(v, axis=1)
    order = np.argsort(np.rint(length / length.min() * 1e6), kind="stable")
    v, length = v[order][:120], length[order][:120]
    cosine = (v @ v.T) / np.outer(length, length)
    right = np.abs(cosine) < tolerance
    same = np.abs(length[:, None] - length[None]) < tolerance * length[None]
    sixth = np.abs(np.abs(cosine) - 0.5) < tolerance

    def cell(i, j, k):
        """Right-handed, and the first two at 120 degrees where they are not at 90."""
        a = v[[i, j, k]].copy()
        if a[0] @ a[1] > tolerance * length[i] * length[j]:
            a[1] = -a[1]
        if np.linalg.det(a) < 0:
            a[2] = -a[2]
        return a, round(np.linalg.det(a) / crystal.volume)

    across = {}
    for i, j in combinations(range(len(v)), 2):
        if not same[i, j]:
            continue
        kind = "t" if right[i, j] else "h" if sixth[i, j] else None
        if kind is None:
            continue
        for k in np.flatnonzero(right[i] & right[j]):
            cubic = kind == "t" and same[i, k]
            key = "c" if cubic else kind
            a, centres = cell(i, j, k)
            if key not in across or np.linalg.det(a) < np.linalg.det(across[key][0]) * (1 - 1e-6):
                across[key] = a, centres
    for key in ("c", "h", "t"):
        if key not in across:
            continue
        a, centres = across[key]
        if (key, centres) in _CENTRES:
            return _CENTRES[key, centres][0], a
        if key == "t" and centres == 1:
            return "tP", a
        if key == "t" and centres == 2:
            return ("tI1" if np.linalg.norm(a[2]) < np.linalg.norm(a[0]) else "tI2"), a
    return None, None


def special_points(crystal: Crystal):
    """(lattice, {name: k (3,)}): the named points of a crystal's zone; (None, {}) where `TABLE` has no such lattice."""
    lattice, a = bravais(crystal)
    if lattice is None:
        return None, {}
    centred = {"cI": _BODY, "cF": _FACE, "tI1": _BODY, "tI2": _BODY}.get(lattice, np.eye(3))
    reciprocal = 2 * np.pi * np.linalg.inv(centred @ a).T
    ratio = (np.linalg.norm(a[2]) / np.linalg.norm(a[0])) ** 2
    known = {"h": (1 + ratio) / 4, "z": 0.0} if lattice == "tI1" else {"h": (1 + 1 / ratio) / 4, "z": 0.5 / ratio}
    points = {GAMMA: np.zeros(3)}
    for name, text in TABLE[lattice][2].items():
        points[name] = np.array([_value(x, known) for x in text.split()]) @ reciprocal
    return lattice, points


def _value(text: str, known: dict) -> float:
    sign, text = (-1.0, text[1:]) if text.startswith("-") else (1.0, text)
    if text in known:
        return sign * known[text]
    if "-" in text:  # 1-h
        first, second = text.split("-")
        return _value(first, known) - _value(second, known)
    top, _, bottom = text.partition("/")
    return sign * float(top) / float(bottom or 1)


def zone_path(crystal: Crystal, path: str = "auto") -> list[Segment]:
    """A path through the zone.

    Parameters
    ----------
    crystal : Crystal, a primitive cell (phonons of a larger one are folded back)
    path : "auto", the usual path of the lattice in `TABLE`; "seekpath", that package's path, by the symmetry of the
        crystal with its atoms; or names of points, - between those of a piece and | between pieces, e.g.
        "Γ-X-W-K-Γ-L" (G and GAMMA are Γ too)

    Returns
    -------
    list of Segment

    Raises
    ------
    AtcError for a name that this lattice has not, and for a lattice that is not in the table.
    """
    if path == "seekpath":
        return _seekpath(crystal)
    lattice, points = special_points(crystal)
    if lattice is None:
        raise AtcError(
            f"{crystal.name}: its lattice is none of {', '.join(name for name, *_ in TABLE.values())}, whose paths are "
            'known here: say path = "seekpath", or directions'
        )
    if path == "auto":
        path = TABLE[lattice][1]
    names = [[_name(p, points) for p in piece.replace("–", "-").split("-")] for piece in path.split("|")]
    for piece in names:
        for p in piece:
            if p not in points:
                raise AtcError(
                    f"path {path!r}: a {TABLE[lattice][0]} lattice has no point {p!r}: expected names of "
                    f"{', '.join(points)} with - between them, e.g. {TABLE[lattice][1]!r}"
                )
        if len(piece) < 2 or any(a == b for a, b in pairwise(piece)):
            raise AtcError(
                f"path {path!r}: {'-'.join(piece)!r} is no line: expected two different points at least, e.g. "
                f"{TABLE[lattice][1]!r}"
            )
    return [Segment((a, b), np.array([points[a], points[b]])) for piece in names for a, b in pairwise(piece)]


def _name(text: str, points) -> str:
    text = text.strip().replace("_", "")
    return GAMMA if text.upper() in ("GAMMA", GAMMA) or (text == "G" and "G" not in points) else text


def plain(name: str) -> str:
    """A name of seekpath as it is written here: Γ for GAMMA, Σ0 for SIGMA_0."""
    for word, letter in GREEK.items():
        name = name.replace(word, letter)
    return name.replace("_", "")


def _seekpath(crystal: Crystal) -> list[Segment]:
    try:
        from seekpath import get_path_orig_cell
    except ImportError:
        raise AtcError('seekpath is not installed: pip install "atc[paths]"') from None

    inside = crystal.positions @ np.linalg.inv(crystal.vectors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = get_path_orig_cell((crystal.vectors, inside, crystal.types), with_time_reversal=True)
        except Exception as e:
            raise AtcError(
                f"{crystal.name}: seekpath finds no path for this crystal: {str(e).splitlines()[0]}"
            ) from None
    points = {plain(name): np.array(k) @ crystal.reciprocal for name, k in found["point_coords"].items()}
    return [Segment((plain(a), plain(b)), np.array([points[plain(a)], points[plain(b)]])) for a, b in found["path"]]


def commensurate_on(sites: Sites, segment: Segment) -> tuple[np.ndarray, np.ndarray]:
    """Wave vectors on a segment that fit into a supercell: fractions of the segment, ascending, and (k, 3) vectors;
    k = 0 is none."""
    turns = segment.k_ec @ sites.cell.T / (2 * np.pi)
    low, high = np.floor(turns.min(axis=0) - 1e-6), np.ceil(turns.max(axis=0) + 1e-6)
    n = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high)), indexing="ij"), -1).reshape(-1, 3)
    k = n @ np.linalg.inv(sites.cell).T * (2 * np.pi)
    along = segment.k_ec[1] - segment.k_ec[0]
    t = (k - segment.k_ec[0]) @ along / (along @ along)
    off = np.linalg.norm(k - segment.k_ec[0] - t[:, None] * along, axis=1)
    small = 1e-6 * np.linalg.norm(sites.crystal.reciprocal, axis=1).max()
    keep = (off < small) & (t > -1e-9) & (t < 1 + 1e-9) & (np.linalg.norm(k, axis=1) > small)
    order = np.argsort(t[keep])
    return np.clip(np.round(t[keep][order], 9), 0.0, 1.0), k[keep][order]


def outside_zone(crystal: Crystal, k_kc, factor: float = 1.0) -> np.ndarray:
    """Which wave vectors lie outside the first zone of the crystal's lattice `factor` times as wide; those on its
    surface are inside."""
    n = np.array([m for m in product(range(-2, 3), repeat=3) if any(m)])
    G = n @ crystal.reciprocal / factor
    half = 0.5 * (G**2).sum(axis=1)
    return ((np.atleast_2d(k_kc) @ G.T) > half * (1 + 1e-6)).any(axis=1)
