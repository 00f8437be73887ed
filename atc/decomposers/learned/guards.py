"""What every frame of a learned model must obey before anything is put out."""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcError, AtcWarning

#: The model's own call costs as much as a stress: the first evaluation and each tenth after it are compared with it.
COMPARE_EVERY = 10

#: Above this the per-atom identity, the virial's symmetry and the model's own numbers are not rounding.
GUARD = {"float64": 1e-9, "float32": 2e-4}


def _forces(edges, g_ec):
    c, n = edges.centre, edges.neighbour
    return np.stack([np.bincount(c, g, edges.n) - np.bincount(n, g, edges.n) for g in g_ec.T], axis=1)


def identity(term, edges, g_ec, a_e, share_n, v_nc, source: str) -> float:
    """v_j·F_j + dU^(j)/dt = Σ_{c=j} I_e − Σ_{n=j} I_e, I_e = g_e·v_n + a_e: the largest difference over the largest of
    what edges bring to an atom. Raises AtcError where it is not rounding."""
    c, n, size = edges.centre, edges.neighbour, edges.n
    F = _forces(edges, g_ec)
    I_e = np.einsum("ec,ec->e", g_ec, v_nc[n]) + a_e
    brought = np.bincount(c, I_e, size) - np.bincount(n, I_e, size)
    w = np.einsum("nc,nc->n", v_nc, F) + share_n
    scale = max(np.abs(w).max(initial=0.0), np.abs(I_e).max(initial=0.0))
    error = float(np.abs(w - brought).max(initial=0.0) / scale) if scale > 0 else 0.0
    if not error <= GUARD[term.precision]:
        raise AtcError(
            f"{source}: {term.name}: what edges carry differs from the change of the atoms' energies by {error:.1e}, "
            "so its messages are not understood (features that are summed at both ends of an edge, means over all "
            "atoms, fused or compiled gathers): no heat flux; the stress alone does not need them"
        )
    return error


def symmetric(term, edges, g_ec, source: str) -> None:
    """Σ r ⊗ g is symmetric where energies do not change as all is turned."""
    W = edges.r_ec.T @ g_ec
    scale = np.sqrt((edges.r_ec**2).sum() * (g_ec**2).sum()) if len(edges) else 0.0
    if not np.abs(W - W.T).max() <= max(GUARD[term.precision], 1e-9) * scale:
        raise AtcError(
            f"{source}: {term.name}: its virial is not symmetric, so its energy changes when all is turned: its stress "
            "would not balance torques"
        )


def against_own(term, edges, g_ec, energy_n, species_n, place, source: str, batch) -> None:
    """Energy, forces and virial against what the model itself says, by its own list of neighbours."""
    if batch is not None:
        warnings.warn(
            f"{source}: {term.name}: the frame does not fit into the memory at once, so it was not compared with "
            "the model's own energy, forces and virial",
            AtcWarning,
            stacklevel=2,
        )
        return
    energy, forces, virial = term.own(place.x_nc, place.cell, place.periodic, species_n, term)
    F, W = _forces(edges, g_ec), edges.r_ec.T @ g_ec
    size = np.sqrt((edges.r_ec**2).sum() * (g_ec**2).sum())
    for what, ours, theirs, scale in (
        ("energy", energy_n.sum(), energy, np.abs(energy_n).sum()),
        ("forces", F, forces, np.abs(F).max(initial=0.0)),
        ("virial", W, virial, size),
    ):
        if theirs is None:
            continue
        error = float(np.abs(ours - theirs).max() / scale) if scale > 0 else 0.0
        if not error <= GUARD[term.precision]:
            raise AtcError(
                f"{source}: {term.name}: {what} from the edges differ{'s' * (what != 'forces')} from the model's "
                f"own by {error:.1e}: its edges are not those of atc, or it has parts beyond them (long-range charges, "
                "dispersion): such models cannot be given by edges"
            )
