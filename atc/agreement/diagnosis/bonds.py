"""Differences along bonds and within molecules: constraints, and bonded terms."""

from __future__ import annotations

import numpy as np

from .case import Case

#: Bonds of one type whose lengths differ by less than this part are held fixed: shake leaves 1e-4 and less, heat a few
#: per cent.
RIGID = 2e-3
#: Molecules are fitted only up to so many bonds.
MOST_BONDS = 30_000


def rigid(c: Case) -> str:
    """Constraint forces: sums of forces along the bonds (and the third sides of angles) of molecules whose bonds do not
    change their lengths."""
    lines = _molecule_lines(c)
    if lines is None:
        return ""
    ends, kinds, lengths, e_bc = lines
    bonds = kinds > 0
    fixed = [t for t in np.unique(kinds[bonds]) if (kinds == t).sum() > 1 and _spread(lengths[kinds == t]) < RIGID]
    if not fixed:
        return ""
    thirds = [t for t in np.unique(kinds[~bonds]) if _spread(lengths[kinds == t]) < RIGID]
    held = np.isin(kinds, [*fixed, *thirds])
    if _left_along(c, ends[held], e_bc[held]):
        names = ", ".join(map(str, fixed))
        return (
            f"constraint forces along bonds of fixed length (bond type {names}): fix shake, rattle or rigid "
            "molecules, which the potential does not have"
        )
    return ""


def bonded(c: Case) -> str:
    """Forces within molecules: along bonds, or along bonds and the third sides of angles."""
    lines = _molecule_lines(c)
    if lines is None:
        return _within_molecules(c)
    ends, kinds, _, e_bc = lines
    bonds = kinds > 0
    if _left_along(c, ends[bonds], e_bc[bonds]):
        found = np.unique(kinds[bonds & (c.odd[ends[:, 0]] & c.odd[ends[:, 1]])])
        return (
            f"forces along bonds (types {', '.join(map(str, found))}): bond coefficients, or bonds that were switched "
            "off or broken"
        )
    if _left_along(c, ends, e_bc):
        return "forces within bonded triples: angle or bond coefficients, or angles that were switched off"
    return _within_molecules(c)


def _molecule_lines(c: Case):
    """Bonds and 1-3 pairs of the atoms that differ: ends (b, 2), kind (bond type, or minus an angle type), length, unit
    vector; None without bonds."""
    t = c.frame.topology
    if t is None or not len(t.bonds):
        return None
    bonds, kinds = t.bonds, t.bond_types
    thirds = t.angles[:, [0, 2]] if len(t.angles) else np.zeros((0, 2), np.int64)
    ends = np.concatenate([bonds, thirds])
    kinds = np.concatenate([kinds, -t.angle_types]) if len(thirds) else kinds.copy()
    here = c.odd[ends].any(axis=1)
    ends, kinds = ends[here], kinds[here]
    if not len(ends) or len(ends) > MOST_BONDS:
        return None
    r = _nearest(c.frame, c.frame.positions[ends[:, 0]] - c.frame.positions[ends[:, 1]])
    lengths = np.linalg.norm(r, axis=1)
    return ends, kinds, lengths, r / np.maximum(lengths, 1e-300)[:, None]


def _spread(a) -> float:
    return float(np.ptp(a) / a.mean()) if len(a) > 1 else 0.0


def _nearest(frame, r):
    s = np.where(frame.cell.periodic, np.rint(r @ frame.cell.inverse), 0.0)
    return r - s @ frame.cell.vectors


def _left_along(c: Case, ends, e_bc) -> bool:
    """Whether D = Σ_b λ_b (e_b on the one end, −e_b on the other) for some λ."""
    if not len(ends):
        return False
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import lsmr

    b = np.repeat(np.arange(len(ends)), 3)
    rows = [(3 * ends[:, side, None] + np.arange(3)).ravel() for side in (0, 1)]
    values = np.concatenate([e_bc.ravel(), -e_bc.ravel()])
    A = coo_array((values, (np.concatenate(rows), np.tile(b, 2))), shape=(3 * len(c.frame), len(ends))).tocsr()
    D = np.where(c.odd[:, None], c.D_nc, 0.0).ravel()
    solution = lsmr(A, D, atol=1e-10, btol=1e-10, maxiter=400)[0]
    return c.holds(D - A @ solution)


def _within_molecules(c: Case) -> str:
    """Differences that add up to zero in every molecule, though not on its atoms."""
    mol = c.frame.extra.get("mol")
    if mol is None or np.ndim(mol) != 1 or c.frame.topology is not None:
        return ""
    number = np.unique(np.asarray(mol).astype(np.int64), return_inverse=True)[1]
    many = np.bincount(number)
    if len(many) < 2 or many.max() < 2 or many.max() > 0.5 * len(mol):
        return ""
    sums = np.stack([np.bincount(number, weights=c.D_nc[:, k]) for k in range(3)], axis=1)
    if c.holds(sums):
        return (
            "forces within molecules (they add up to zero in each): bonded terms or constraints that the potential "
            "does not have"
        )
    return ""
