"""Coulomb forces that are missing, of other charges, or of distant charges."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...units import LAMMPS_STYLES
from .case import Case, norm

#: Charges are varied only in frames up to this size.
MOST_ATOMS = 20_000


def charges(c: Case) -> str:
    """Coulomb forces that are missing, of other charges, or of distant charges."""
    q, n = c.frame.charges, len(c.frame)
    if q is None or not q.any() or n > MOST_ATOMS:
        return ""
    coulomb = _coulomb_forces(c, q)
    if coulomb is None:
        return ""
    if not coulomb.any():
        from ... import potential

        reach = c.frame.units.to_user("length", 12.0 if not c.frame.units.reduced else 3.5)
        damping = c.frame.units.length * 0.15 if not c.frame.units.reduced else 0.5
        sums = potential(
            f"pair_style coul/dsf {damping:.12g} {reach:.12g}\npair_coeff * *",
            units=c.frame.units.name if c.frame.units.name in LAMMPS_STYLES else "metal",
        )
        try:
            theirs = sums.stream(c.frame, None, threads=c.threads, forces=True).forces_nc
        except AtcError:
            return ""
        match = float((theirs * c.D_nc).sum()) / max(norm(theirs) * norm(c.D_nc), 1e-300)
        return "Coulomb forces that the potential does not have" if match > 0.8 else ""
    groups = _charge_groups(c.frame)
    found = _other_charges(c, q, coulomb, groups)
    return found or _distant_charges(c, q)


def _coulomb_forces(c: Case, q):
    """What of the potential's forces depends on charges `q`."""
    frames = c.frame.replace(charges=q), c.frame.replace(charges=np.zeros(len(q)))
    try:
        with_q, without = (c.pot.stream(f, None, threads=c.threads, forces=True).forces_nc for f in frames)
    except AtcError:
        return None
    return with_q - without


def _charge_groups(frame) -> list[np.ndarray]:
    """Atoms of one type, up to four groups of them that bear charges; [] for more."""
    kinds = np.unique(frame.types[frame.charges != 0])
    return [frame.types == t for t in kinds] if len(kinds) <= 4 else []


def _other_charges(c: Case, q, coulomb, groups) -> str:
    """D = Σ_ab λ_ab F_ab, F_ab the Coulomb forces between two groups: charges of the run are other multiples of these,
    1 + λ_ab = s_a s_b."""
    k = float((coulomb * c.D_nc).sum() / (coulomb**2).sum())
    if c.holds((c.D_nc - k * coulomb)[c.odd]) and k > -1.0 - 1e-9:
        if abs(k + 1.0) < 1e-6:
            return "Coulomb forces that the run did not have: charges that were 0 in it"
        return (
            f"Coulomb forces of other charges, all {np.sqrt(max(1.0 + k, 0.0)):.4g} times these (or another "
            "dielectric constant)"
        )
    if not 2 <= len(groups):
        return ""
    alone = [_coulomb_forces(c, np.where(g, q, 0.0)) for g in groups]
    parts = {(a, a): alone[a] for a in range(len(groups))}
    for a in range(len(groups)):
        for b in range(a + 1, len(groups)):
            both = _coulomb_forces(c, np.where(groups[a] | groups[b], q, 0.0))
            if both is None or alone[a] is None or alone[b] is None:
                return ""
            parts[a, b] = both - alone[a] - alone[b]
    keys = [key for key in parts if parts[key] is not None and parts[key].any()]
    M = np.stack([parts[key].ravel() for key in keys], axis=1)
    lam = np.linalg.lstsq(M, c.D_nc.ravel(), rcond=None)[0]
    left = c.D_nc - (M @ lam).reshape(-1, 3)
    if not c.holds(left):
        return ""
    scale = {}
    for (a, b), value in zip(keys, lam, strict=True):
        if a == b and 1.0 + value > 0:
            scale[a] = np.sqrt(1.0 + value)
    types = [int(c.frame.types[g][0]) for g in groups]
    said = ", ".join(f"{s:.4g} times these on type {types[a]}" for a, s in scale.items() if abs(s - 1.0) > 1e-3)
    return f"Coulomb forces of other charges{': ' + said if said else ''}"


def _distant_charges(c: Case, q) -> str:
    """Long-range Coulomb: a field E_i = D_i/q_i that hardly differs between near atoms, on charged atoms only."""
    from ...neighbors.cell_list import neighbor_list

    charged = q != 0
    if (c.odd & ~charged).sum() > 0.01 * c.odd.sum():
        return ""
    E = np.where(charged[:, None], c.D_nc / np.where(charged, q, 1.0)[:, None], 0.0)
    near = (c.frame.cell.volume / max(charged.sum(), 1)) ** (1.0 / 3.0)
    at = np.flatnonzero(charged)
    i, j, _, _ = neighbor_list(c.frame.positions[at], c.frame.cell, near)
    if len(i) < 20:
        return ""
    i, j = at[i], at[j]
    alike = float((E[i] * E[j]).sum()) / max(float(0.5 * ((E[i] ** 2).sum() + (E[j] ** 2).sum())), 1e-300)
    if alike > 0.6:
        return (
            "a smooth electric field on charged atoms: Coulomb forces from beyond the cutoff (kspace_style), or of "
            "other long-range terms"
        )
    return ""
