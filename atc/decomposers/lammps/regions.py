"""LAMMPS's lattices and regions: which points a ``region`` holds.

Numbers are in the script's own units. Points on a surface are inside, as in LAMMPS.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

#: What LAMMPS means by INF.
_BIG = 1.0e20
_CUBIC = np.eye(3)
#: style → (edge vectors, atoms in the cell)
_LATTICES = {
    "none": (_CUBIC, 1),
    "sc": (_CUBIC, 1),
    "bcc": (_CUBIC, 2),
    "fcc": (_CUBIC, 4),
    "diamond": (_CUBIC, 8),
    "hcp": (np.diag([1.0, np.sqrt(3.0), np.sqrt(8.0 / 3.0)]), 4),
    "sq": (_CUBIC, 1),
    "sq2": (_CUBIC, 2),
    "hex": (np.diag([1.0, np.sqrt(3.0), 1.0]), 2),
    "custom": (_CUBIC, 0),
}


class Trouble(Exception):
    """What cannot be evaluated; the message says why."""


def _numbers(words, n, what):
    try:
        out = [float(w) for w in words[:n]]
    except ValueError:
        out = []
    if len(out) != n or not np.isfinite(out).all():
        raise Trouble(f"{what}: expected {n} numbers, got {' '.join(words[:n]) or 'nothing'}")
    return out


def lattice_spacing(words, units: str, dimension: int = 3) -> np.ndarray:
    """(3,) what ``xlat ylat zlat`` are after ``lattice <words>``."""
    if not words or words[0] not in _LATTICES:
        raise Trouble(f"lattice {' '.join(words[:1]) or 'without a style'} is not known")
    style = words[0]
    (scale,) = _numbers(words[1:], 1, f"lattice {style}")
    if style == "none":
        return np.full(3, scale)
    (vectors, count), orient, spacing, k = _LATTICES[style], np.eye(3), None, 2
    vectors = vectors.copy()
    while k < len(words):
        key = words[k]
        if key == "orient" and k + 4 < len(words) and words[k + 1] in "xyz":
            orient["xyz".index(words[k + 1])] = _numbers(words[k + 2 :], 3, "lattice orient")
            k += 5
        elif key == "spacing":
            spacing = np.array(_numbers(words[k + 1 :], 3, "lattice spacing"))
            k += 4
        elif key in ("a1", "a2", "a3"):
            vectors[int(key[1]) - 1] = _numbers(words[k + 1 :], 3, f"lattice {key}")
            k += 4
        elif key == "basis":
            count += style == "custom"
            k += 4
        elif key == "origin":
            k += 4
        elif key == "triclinic/general":
            raise Trouble("lattice triclinic/general is not supported")
        else:
            raise Trouble(f"lattice {style}: {key!r} is not known")
    if units == "lj":
        volume = abs(np.linalg.det(vectors))
        if dimension == 2:
            volume = abs(np.linalg.det(vectors[:2, :2]))
        if not (scale > 0 and count > 0 and volume > 0):
            raise Trouble(f"lattice {style} {scale:g} has no density")
        scale = (count / volume / scale) ** (1.0 / dimension)
    if spacing is not None:
        return spacing * scale
    length = np.linalg.norm(orient, axis=1)
    if not (length > 0).all():
        raise Trouble("lattice orient: a direction of length 0")
    corners = np.array([*product((0, 1), (0, 1), (0, 1) if dimension == 3 else (0,))], float) @ vectors
    turned = corners @ (orient / length[:, None]).T * scale
    out = turned.max(0) - turned.min(0)
    if dimension == 2:
        out[2] = scale
    return out


@dataclass(frozen=True)
class Region:
    """One region: style and numbers with lattice units put in, or the names of those it joins."""

    style: str
    numbers: tuple[float, ...] = ()
    axis: int = 2
    parts: tuple[Region, ...] = ()
    outside: bool = False
    moves: str = ""

    def holds(self, x_nc: np.ndarray) -> np.ndarray:
        """(n,) bool: which points are in it."""
        if self.moves:
            raise Trouble(self.moves)
        return getattr(self, f"_{self.style}")(x_nc) != self.outside

    def _block(self, x):
        lo, hi = np.array(self.numbers[0::2]), np.array(self.numbers[1::2])
        return ((x >= lo) & (x <= hi)).all(1)

    def _sphere(self, x):
        return np.sqrt(((x - self.numbers[:3]) ** 2).sum(1)) <= self.numbers[3]

    def _ellipsoid(self, x):
        a = np.array(self.numbers[3:6])
        return (((x - self.numbers[:3]) / a) ** 2).sum(1) <= 1.0

    def _cylinder(self, x):
        c1, c2, radius, lo, hi = self.numbers
        a, b = (k for k in range(3) if k != self.axis)
        z = x[:, self.axis]
        return (np.sqrt((x[:, a] - c1) ** 2 + (x[:, b] - c2) ** 2) <= radius) & (z >= lo) & (z <= hi)

    def _cone(self, x):
        c1, c2, r_lo, r_hi, lo, hi = self.numbers
        a, b = (k for k in range(3) if k != self.axis)
        z = x[:, self.axis]
        radius = r_lo + (z - lo) * (r_hi - r_lo) / (hi - lo)
        return (np.sqrt((x[:, a] - c1) ** 2 + (x[:, b] - c2) ** 2) <= radius) & (z >= lo) & (z <= hi)

    def _plane(self, x):
        p, n = np.array(self.numbers[:3]), np.array(self.numbers[3:6])
        return (x - p) @ (n / np.linalg.norm(n)) >= 0.0

    def _prism(self, x):
        xlo, xhi, ylo, yhi, zlo, zhi, xy, xz, yz = self.numbers
        edges = np.array([[xhi - xlo, 0, 0], [xy, yhi - ylo, 0], [xz, yz, zhi - zlo]])
        s = np.linalg.solve(edges.T, (x - [xlo, ylo, zlo]).T).T
        return ((s >= 0.0) & (s <= 1.0)).all(1)

    def _union(self, x):
        return np.any([r.holds(x) for r in self.parts], axis=0)

    def _intersect(self, x):
        return np.all([r.holds(x) for r in self.parts], axis=0)


#: style → which of its numbers are lengths along which axis ("c1": the first axis across; "d": along the axis), in
#: order
_SCALES = {
    "block": "xxyyzz", "sphere": "xyzx", "ellipsoid": "xyzxyz", "cylinder": "12 1dd".replace(" ", ""), "cone": "1211dd",
    "plane": "xyzxyz", "prism": "xxyyzzxxy",
}  # fmt: skip
_KEYWORDS = {"side": 1, "units": 1, "move": 3, "rotate": 7, "open": 1}


def parse_region(words, spacing, box, known: dict) -> Region:
    """From ``region ID <words>``.

    spacing : (3,) lattice spacings, or None if they are not known. box : (lo, hi) (3,) each or None. known : {ID:
        Region or a text why not}.
    """
    style, args = words[0], list(words[1:])
    if style in ("union", "intersect"):
        try:
            n = int(args[0])
        except (IndexError, ValueError):
            raise Trouble(f"region {style}: expected the number of regions") from None
        names, rest = args[1 : 1 + n], args[1 + n :]
        parts = []
        for name in names:
            part = known.get(name, f"region {name} is not defined")
            if isinstance(part, str):
                raise Trouble(part)
            parts.append(part)
        return _options(Region(style, parts=tuple(parts)), rest)
    if style not in _SCALES:
        raise Trouble(f"region {style} is not known")
    axis = 2
    if style in ("cylinder", "cone"):
        if not args or args[0] not in ("x", "y", "z"):
            raise Trouble(f"region {style}: expected x, y or z")
        axis = "xyz".index(args.pop(0))
    across = [k for k in range(3) if k != axis]
    along = [{"1": across[0], "2": across[1], "d": axis}.get(c, "xyz".find(c)) for c in _SCALES[style]]
    rest = args[len(along) :]
    region = _options(Region(style, axis=axis), rest)
    lattice = "box" not in [rest[k + 1] for k in range(len(rest) - 1) if rest[k] == "units"]
    if lattice and spacing is None:
        raise Trouble("the spacing of the lattice that the region is measured in is not known")
    numbers = []
    for k, (word, a) in enumerate(zip(args, along, strict=False)):
        low = k % 2 == 0 if style in ("block", "prism") else k == len(along) - 2
        if word == "INF":
            numbers.append(-_BIG if low else _BIG)
        elif word == "EDGE":
            if box is None:
                raise Trouble("the region reaches to the edge of a box that is not known")
            numbers.append(box[0 if low else 1][a])
        else:
            (value,) = _numbers([word], 1, f"region {style}")
            numbers.append(value * (spacing[a] if lattice else 1.0))
    if len(numbers) != len(along):
        raise Trouble(f"region {style}: expected {len(along)} numbers, got {len(numbers)}")
    return replace(region, numbers=tuple(numbers))


def _options(region: Region, words) -> Region:
    k = 0
    while k < len(words):
        key = words[k]
        if key not in _KEYWORDS:
            raise Trouble(f"region {region.style}: {key!r} is not known")
        value = words[k + 1] if k + 1 < len(words) else ""
        if key == "side":
            region = replace(region, outside=value == "out")
        elif key in ("move", "rotate"):
            region = replace(region, moves=f"the region moves ({key})")
        k += 1 + _KEYWORDS[key]
    return region
