"""Which atom of a frame sits at which site of a crystal, and which waves fit into its box."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, permutations, product

import numpy as np

from ..errors import AtcError
from .crystal import Crystal
from .force_constants import nearest_images


@dataclass
class Sites:
    """Which atom of a supercell sits at which site of a crystal.

    crystal : scaled so that the supercell is a whole number of its cells. counts : (3, 3) ints, supercell = counts @
        crystal.vectors.
    basis : (n,) which basis atom. sites : (n, 3) ideal positions. cell : (3, 3) the supercell.
    """

    crystal: Crystal
    counts: np.ndarray
    basis: np.ndarray
    sites: np.ndarray
    cell: np.ndarray

    @property
    def cells(self) -> int:
        return len(self.basis) // len(self.crystal)


def of_one_run(traj):
    """The first frame of a run, and all frames, the first included, one by one: AtcError where atoms come or go, or for
    no frame at all."""
    it = iter(traj)
    first = next(it, None)
    if first is None:
        raise AtcError("the trajectory has no frames")

    def frames():
        for frame in chain((first,), it):
            if len(frame) != len(first):
                raise AtcError(f"{frame.source}: {len(frame)} atoms, but the first frame has {len(first)}")
            yield frame

    return first, frames()


def find_sites(frame, crystal: Crystal, cell=None) -> Sites:
    """Lay a crystal under a frame.

    Parameters
    ----------
    frame : Frame of a whole number of cells of the crystal, in the crystal's orientation, every atom near its site
    crystal : Crystal; its lattice constant need only be near
    cell : (3, 3) the supercell, if not the frame's own (its mean over a run)

    Raises
    ------
    AtcError that says what does not fit: the box, the number of atoms, or atoms without a site (a defect, a liquid,
    another structure).
    """
    if not frame.cell.periodic.all():
        raise AtcError(f"{frame.source}: waves in a crystal need a box that is periodic along all axes")
    H = frame.cell.vectors if cell is None else cell
    exact = H @ np.linalg.inv(crystal.vectors)
    counts = np.rint(exact)
    if abs(np.linalg.det(counts)) < 0.5 or np.abs(exact - counts).max() > 0.25:
        along = np.linalg.norm(H, axis=1) / np.linalg.norm(crystal.conventional, axis=1)
        raise AtcError(
            f"{frame.source}: the box is not a whole number of cells of {crystal.name} (it is "
            f"{', '.join(f'{a:.3g}' for a in along)} conventional cells "
            f"of {crystal.lattice_constant:.6g} long): give the structure and lattice_constant of the crystal in the "
            "file"
        )
    fitted = np.linalg.solve(counts, H)
    F = (np.linalg.inv(crystal.vectors) @ fitted).T
    crystal = crystal.strained(F - np.eye(3))
    cells, n = round(abs(np.linalg.det(counts))), len(crystal)
    if len(frame) != cells * n:
        raise AtcError(
            f"{frame.source}: {len(frame)} atoms, but a perfect {crystal.name} of this box has {cells * n}: it has "
            "defects, or another structure"
        )
    x = frame.positions - frame.cell.origin
    inv = np.linalg.inv(crystal.vectors)
    # The crystal may be shifted: align on the first atom and each basis atom in turn, take the best.
    best = None
    for b in range(n):
        if crystal.types[b] != frame.types[0] and len(np.unique(crystal.types)) > 1:
            continue
        shift = x[0] - crystal.positions[b]
        for _ in range(3):
            d = x[:, None, :] - shift - crystal.positions[None]
            s = d @ inv
            off = (s - np.rint(s)) @ crystal.vectors
            which = np.argmin(np.einsum("nbc,nbc->nb", off, off), axis=1)
            u = off[np.arange(len(x)), which]
            shift = shift + u.mean(axis=0)
        error = np.sqrt((u**2).sum(axis=1)).max()
        if (best is None or error < best[0]) and (np.bincount(which, minlength=n) == cells).all():
            best = error, which, shift
    if best is None:
        raise AtcError(
            f"{frame.source}: its atoms do not sit at the sites of {crystal.name}: it has defects, has melted, or has "
            "another structure"
        )
    _, which, shift = best
    m = np.rint((x - shift - crystal.positions[which]) @ inv)
    sites = m @ crystal.vectors + crystal.positions[which] + shift
    key = np.rint(np.mod((m @ np.linalg.inv(counts)) + 1e-9, 1.0) * 1e6).astype(np.int64)
    if len(np.unique(np.column_stack([key, which]), axis=0)) != len(frame):
        raise AtcError(
            f"{frame.source}: two atoms sit at one site of {crystal.name}: it has defects, has melted, or has another "
            "structure"
        )
    return Sites(crystal, counts.astype(int), which, sites, H)


def star(k, cubic: bool) -> np.ndarray:
    """(s, 3) wave vectors that the cube's symmetry makes equivalent to k, one of each ±k; just k if not cubic."""
    if not cubic:
        return np.atleast_2d(k)
    out = []
    for p in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            q = np.array(k)[list(p)] * signs
            if not any(np.allclose(q, o, atol=1e-9) or np.allclose(-q, o, atol=1e-9) for o in out):
                out.append(q)
    return np.array(out)


def different(crystal: Crystal, k_kc) -> np.ndarray:
    """Those of wave vectors that are no other's ±k plus a reciprocal vector: the first of each kind."""
    whole = lambda d: np.abs(d - np.rint(d)).max(axis=-1) < 1e-6  # noqa: E731
    s = np.atleast_2d(k_kc) @ crystal.vectors.T / (2 * np.pi)
    keep = [i for i in range(len(s)) if not (whole(s[i] - s[:i]) | whole(s[i] + s[:i])).any()]
    return np.atleast_2d(k_kc)[keep]


def halved(crystal: Crystal, k) -> bool:
    """Whether k is half a reciprocal vector: k and −k are one wave, and its amplitudes real."""
    s = k @ crystal.vectors.T / np.pi
    return bool(np.abs(s - np.rint(s)).max() < 1e-6)


def commensurate(sites: Sites, direction, limit: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Wave vectors along `direction` that fit into the supercell, up to `limit` times the zone boundary: fractions of
    it and (k, 3) vectors."""
    crystal = sites.crystal
    e, boundary = crystal.direction(direction), crystal.zone_boundary(direction)
    # The shortest commensurate vector along e: k·H/2π must be integers.
    per = sites.cell @ e / (2 * np.pi)
    most = int(np.ceil(np.abs(sites.counts).sum() * 2)) + 1
    n = np.arange(1, most + 1)
    lead = np.abs(per).max()
    for m in n:
        q = m / lead
        if q > limit * boundary * (1 + 1e-9):
            break
        if np.abs(per * q - np.rint(per * q)).max() < 1e-6:
            steps = np.arange(1, int(limit * boundary * (1 + 1e-9) / q) + 1) * q
            return steps / boundary, steps[:, None] * e
    return np.zeros(0), np.zeros((0, 3))


def shortest_contact(sites: Sites) -> float:
    """The shortest distance of two sites."""
    c = sites.crystal
    d = (c.positions[None] - c.positions[:, None]).reshape(-1, 3)
    r = np.linalg.norm(nearest_images(d, c.vectors), axis=1)
    lattice = np.linalg.norm(np.array([m for m in product((-1, 0, 1), repeat=3) if any(m)]) @ c.vectors, axis=1).min()
    return float(min(lattice, r[r > 1e-6].min(initial=np.inf)))
