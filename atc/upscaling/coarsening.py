"""Coarsening of a crystal to fewer nodes (Silling, Int. J. Multiscale Comput. Eng. 9, 609 (2011)): what is left out is
in equilibrium given what is kept.

Kept are the centres of mass of the cells on a lattice of nodes. Eliminating the rest is a Schur complement; of a
periodic crystal it is one matrix a wave vector, because what is kept sees the folded waves q + g only through its
Green's function:

    K_c(q) = [1/M Σ_g b† K(q + g)⁻¹ b]⁻¹,   M cells a node, b_i = (m_i/m) exp(i (q + g)·(x_i − x_c)).

Springs are its back-transform. Cut at a horizon they lose moments: a single cell holds a solid weakly in three
dimensions, so K_c reaches far, the further in nodes' distances the more cells a node stands for. Either springs within
the horizon are fitted to K_c over the nodes' zone, or the moments of those that are left are mended; the elastic
constants are exact both ways. Internal units.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np

from ..errors import AtcError
from ..pd.voigt import VOIGT, from_voigt, to_voigt
from .crystal import Crystal
from .elasticity import ElasticConstants
from .force_constants import ForceConstants, nearest_images, signed_root
from .node_kernel import NodeKernel, family, fit_springs, measure, wanted_moments

#: How springs are kept within a horizon.
CUTS = ("fit", "second", "fourth", "bare")
#: Nodes along each edge of the periodic block whose springs are taken for those of the endless crystal.
_MESH = 14
#: Wave vectors at once.
_AT_ONCE = 4000


@dataclass
class CoarsenedKernel(NodeKernel):
    """Springs of a coarsened crystal on its nodes: a `NodeKernel` with

    cells : cells of the crystal a node stands for
    beyond : norm of the springs that the horizon cuts off, relative to the norm of all
    corrected : norm of the difference of the springs from those left by the horizon, relative to the norm of all
    """

    cells: int = 1
    beyond: float = np.nan
    corrected: float = np.nan


def folded_waves(crystal: Crystal, step_cc) -> np.ndarray:
    """(M, 3) the waves g that nodes on the lattice `step_cc` (rows) do not tell from 0, 0 the first; M cells a node.

    Raises
    ------
    AtcError where the nodes' lattice is not made of lattice vectors of the crystal.
    """
    N = np.asarray(step_cc, float) @ np.linalg.inv(crystal.vectors)
    whole = np.rint(N)
    M = round(abs(np.linalg.det(whole)))
    if np.abs(N - whole).max() > 1e-6 or M < 1:
        raise AtcError(
            f"{crystal.name}: coarsening keeps cells of the crystal as nodes: the steps from node to node must be "
            f"lattice vectors of it, got {np.round(N, 4).tolist()} primitive ones: take a spacing that is a multiple "
            "of the lattice constant"
        )
    inverse = np.linalg.inv(whole).T
    period = next(d for d in range(1, M + 1) if np.abs(d * inverse - np.rint(d * inverse)).max() < 1e-9)
    n = np.array(list(product(range(period), repeat=3)))
    key = np.rint((n @ inverse % 1.0) * M).astype(int) % M
    first = np.sort(np.unique(key, axis=0, return_index=True)[1])
    return n[first] @ (2 * np.pi * np.linalg.inv(np.asarray(step_cc, float)).T)


def coarse_stiffness(fc: ForceConstants, step_cc, q_kc) -> np.ndarray:
    """(k, 3, 3) stiffness of the nodes against a wave of theirs, energy/length²; 0 for q = 0.

    Parameters
    ----------
    fc : ForceConstants. step_cc : (3, 3) rows, the lattice of nodes

    Of crystals without a centre of symmetry the real part is taken: springs are symmetric.
    """
    g = folded_waves(fc.crystal, step_cc)
    q = np.atleast_2d(np.asarray(q_kc, float))
    size = np.linalg.norm(nearest_images(q, 2 * np.pi * np.linalg.inv(step_cc).T), axis=1)
    at_rest = size < 1e-9 / np.cbrt(fc.crystal.volume)
    out = np.zeros((len(q), 3, 3))
    moving = np.flatnonzero(~at_rest)
    for part in np.array_split(moving, max(1, len(moving) * len(g) // _AT_ONCE)):
        out[part] = _condense(fc, q[part], g)
    return out


def _condense(fc, q_kc, g_mc) -> np.ndarray:
    crystal, n, M = fc.crystal, len(fc.crystal), len(g_mc)
    k = (q_kc[:, None] + g_mc).reshape(-1, 3)
    share = crystal.masses / crystal.masses.sum()
    x = crystal.positions - share @ crystal.positions
    # D = m^-½ K m^-½, so that b†K⁻¹b = (m^-½ b)† D⁻¹ (m^-½ b).
    b = (share / np.sqrt(crystal.masses) * np.exp(-1j * k @ x.T))[:, :, None, None] * np.eye(3)
    b = b.reshape(len(k), 3 * n, 3)
    D = fc.dynamical_matrix(k)
    if np.linalg.eigvalsh(D).min() <= 0:
        raise AtcError(f"{crystal.name}: the lattice itself is unstable (imaginary frequencies): nothing to coarsen")
    green = (b.conj().swapaxes(1, 2) @ np.linalg.solve(D, b)).reshape(-1, M, 3, 3).mean(axis=1)
    K = np.linalg.inv(green).real
    return 0.5 * (K + K.swapaxes(1, 2))


def coarsen(
    fc: ForceConstants,
    elastic: ElasticConstants,
    step_cc,
    horizon: float,
    *,
    cut: str = "fit",
    mesh: int = _MESH,
) -> CoarsenedKernel:
    """The springs of a coarsened crystal, cut at a horizon.

    Parameters
    ----------
    fc, elastic : of the relaxed crystal. step_cc : (3, 3) rows, lattice vectors of it: from node to node
    horizon : internal length, beyond which springs are cut off
    cut : "fit": least squares on the relative error of the stiffness over the zone, elastic constants as constraints.
        "second", "fourth": what is left is given the elastic constants, or also the fourth moments of all springs, by
        the least change (weighed with length: shorter springs take more). "bare": what is left, as it is
    mesh : nodes along each edge of the periodic block that springs are taken from

    Returns
    -------
    CoarsenedKernel, for `pd.Linear`

    Raises
    ------
    AtcError where the nodes are no lattice of the crystal's, the family is too small, or cutting leaves a wave that
    grows.
    """
    if cut not in CUTS:
        raise AtcError(f"coarsening: cut = {cut!r}: expected one of {', '.join(CUTS)}")
    step = np.asarray(step_cc, float)
    cells = len(folded_waves(fc.crystal, step))
    inside = family(step, horizon)
    if len(inside) and 2 * np.abs(inside).max() >= mesh:
        mesh = 2 * int(np.abs(inside).max()) + 2
    reciprocal = 2 * np.pi * np.linalg.inv(step).T
    s = np.array(list(product(range(mesh), repeat=3))) / mesh
    K = coarse_stiffness(fc, step, s @ reciprocal).reshape(mesh, mesh, mesh, 3, 3)
    # K_c(q) = −Σ S exp(iq·ξ)
    S = -np.fft.ifftn(K, axes=(0, 1, 2)).real
    S = 0.5 * (S + S.swapaxes(3, 4))
    half = mesh // 2
    n = np.array([o for o in product(range(-half + 1, half), repeat=3) if o > (0, 0, 0)])
    every = S[tuple(n.T % mesh)]
    x = S[tuple(inside.T % mesh)]
    norm = np.linalg.norm(every)
    volume = abs(np.linalg.det(step))
    kept = x
    if cut == "fit":
        fitted = lambda k: coarse_stiffness(fc, step, k) / (fc.crystal.density * volume)  # noqa: E731
        x = fit_springs(fc, elastic, step, inside, fitted)
    elif cut != "bare":
        x = x + _correction(inside @ step, x, n @ step, every, wanted_moments(elastic, volume), cut == "fourth")
    beyond = float(np.sqrt(max(norm**2 - (kept**2).sum(), 0.0)) / norm)
    said = {"cells": cells, "beyond": beyond, "corrected": float(np.linalg.norm(x - kept) / norm)}
    bonds = np.vstack([inside, -inside]), np.concatenate([x, x])
    made = CoarsenedKernel(step, *bonds, fc.crystal.density * volume, volume, **said)
    measure(made, fc, elastic, reciprocal)
    if not made.least > 0.0:
        raise AtcError(
            f"coarsening: cut at {horizon / np.linalg.norm(step, axis=1).max():.3g} distances of nodes a wave grows "
            "(ω² < 0): take a larger horizon"
        )
    return made


def _correction(xi, S, all_xi, all_S, second_vv, fourth: bool) -> np.ndarray:
    """(p, 3, 3) the least change, Σ |ξ|⁴ |δS|², with which the moments of the springs become those wanted."""
    pairs = [tuple(v) for v in VOIGT]
    rows, wanted = [_monomials(xi, pairs)], [second_vv]
    if fourth:
        four = list(combinations_with_replacement(range(3), 4))
        rows.append(_monomials(xi, four))
        wanted.append(_monomials(all_xi, four).T @ to_voigt(all_S))
    # Orders in units of their own, so that ranks can be told.
    size = [np.abs(r).max() for r in rows]
    A = np.hstack([r / s for r, s in zip(rows, size)])
    b = np.vstack([w / s for w, s in zip(wanted, size)]) - A.T @ to_voigt(S)
    weight = (np.linalg.norm(xi, axis=1) / np.linalg.norm(xi, axis=1).min()) ** -2.0
    y = weight[:, None] * np.linalg.lstsq((A * weight[:, None]).T, b, rcond=1e-10)[0]
    if np.abs(A.T @ y - b).max() > 1e-8 * max(np.abs(A.T @ to_voigt(S)).max(), np.abs(b).max()):
        raise AtcError(
            f"the horizon reaches too few nodes for {'fourth' if fourth else 'second'} moments: take a larger one"
        )
    return from_voigt(y)


def _monomials(xi, powers) -> np.ndarray:
    return np.stack([np.prod(xi[:, list(p)], axis=1) for p in powers], axis=1)


def zone_errors(kernel, fc: ForceConstants, mesh: int = 17) -> np.ndarray:
    """(k, 4) relative errors of ω of a kernel's three branches on a uniform mesh of the nodes' zone, and before them
    |q| in parts of the distance of the zone's nearest face: rms over the zone is that of the last three columns."""
    reciprocal = 2 * np.pi * np.linalg.inv(kernel.step_cc).T
    s = np.array(list(product(range(mesh), repeat=3)))[1:] / mesh
    k = nearest_images(s @ reciprocal, reciprocal)
    mine = signed_root(np.linalg.eigvalsh(kernel.dynamical_matrix(k)))
    true = np.sqrt(np.linalg.eigvalsh(fc.dynamical_matrix(k))[:, :3])
    edge = 0.5 * np.linalg.norm(reciprocal, axis=1).min()
    return np.column_stack([np.linalg.norm(k, axis=1) / edge, mine / true - 1])


def point_loads(fc: ForceConstants, repeat, cells_pc, forces_pc) -> np.ndarray:
    """(n1, n2, n3, 3) displacements of the centres of mass of all cells of a periodic crystal at rest under forces on
    some: the fine solution, exact, by its waves.

    Parameters
    ----------
    repeat : cells along each primitive vector
    cells_pc : (p, 3) ints, where forces act. forces_pc : (p, 3), their sum 0; on the atoms of a cell by their masses
    """
    f = np.asarray(forces_pc, float)
    if np.abs(f.sum(axis=0)).max() > 1e-9 * np.abs(f).max(initial=0.0):
        raise AtcError("forces on a periodic crystal at rest must add up to 0")
    load = np.zeros((*repeat, 3))
    np.add.at(load, tuple(np.asarray(cells_pc).T % np.array(repeat)[:, None]), f)
    s = np.stack(np.meshgrid(*(np.arange(n) / n for n in repeat), indexing="ij"), axis=-1).reshape(-1, 3)
    K = coarse_stiffness(fc, fc.crystal.vectors, s @ fc.crystal.reciprocal)
    waves = np.fft.fftn(load, axes=(0, 1, 2)).reshape(-1, 3)
    out = np.zeros_like(waves)
    out[1:] = np.linalg.solve(K[1:], waves[1:, :, None])[..., 0]
    return np.fft.ifftn(out.reshape(*repeat, 3), axes=(0, 1, 2)).real
