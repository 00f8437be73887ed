"""A micromodulus on the lattice of nodes that it will be used on: elastic constants exact, frequencies fitted over the
nodes' own Brillouin zone.

m D(k) = Σ 2 (1 − cos k·ξ) S(ξ) over pairs ±ξ. Its second moments are the crystal's acoustic tensor, Σ S ξ⊗ξ = V C
(constraints of the fit); the rest is least squares on the relative error of the crystal's stiffness, inner
displacements condensed at every k. Internal units.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..errors import AtcError
from ..pd.sampling import dynamical_matrix
from ..pd.voigt import BASIS, VOIGT, of_springs, to_voigt
from .elasticity import ElasticConstants
from .force_constants import ForceConstants, nearest_images, signed_root

#: Wave vectors along each reciprocal vector of the nodes, fractions of the zone boundary where errors are stated, and
#: the weight of a spring's size against the residual.
_MESH, FRACTIONS, _SMALL = 8, (0.1, 0.25, 0.5, 0.75, 1.0), 1e-4
#: Up to where nodes carry waves well, in parts of the nearest face of their zone.
_CARRIED = 0.4


@dataclass
class NodeKernel:
    """Springs between nodes of a lattice.

    step_cc : (3, 3) rows: the lattice of nodes. offsets_bc : (b, 3) ints, both of ±ξ. springs_bcc : (b, 3, 3)
        energy/length². mass, volume : of a node
    error_f : (fractions,) largest relative error of ω over the branches of all directions at `FRACTIONS` of the zone
        boundary
    least : the smallest ω² over the zone, relative to what the elastic constants alone would give there
    """

    step_cc: np.ndarray
    offsets_bc: np.ndarray
    springs_bcc: np.ndarray
    mass: float
    volume: float
    error_f: np.ndarray = None
    least: float = np.nan

    def dynamical_matrix(self, k_kc) -> np.ndarray:
        """(k, 3, 3)"""
        return dynamical_matrix(k_kc, self.offsets_bc @ self.step_cc, self.springs_bcc, self.mass)

    def __call__(self, xi_bc) -> np.ndarray:
        """(b, 3, 3) C(ξ) = S/V²: what `pd.Linear` takes."""
        n = np.rint(xi_bc @ np.linalg.inv(self.step_cc)).astype(int)
        table = {tuple(o): s for o, s in zip(self.offsets_bc.tolist(), self.springs_bcc)}
        unique, back = np.unique(n, axis=0, return_inverse=True)
        S = np.array([table.get(tuple(o), np.zeros((3, 3))) for o in unique.tolist()]).reshape(-1, 3, 3)
        return S[back.ravel()] / self.volume**2


def condensed(fc: ForceConstants, k_kc) -> np.ndarray:
    """(k, 3, 3) stiffness of a cell over its mass against a wave of its centre of mass, the basis at rest within:
    ω² of the acoustic branches for long waves."""
    crystal, n = fc.crystal, len(fc.crystal)
    D = fc.dynamical_matrix(k_kc)
    if n == 1:
        return D.real
    share = np.sqrt(crystal.masses / crystal.masses.sum())
    B = (share[:, None, None] * np.eye(3)).reshape(3 * n, 3)
    return np.linalg.inv(B.T @ np.linalg.inv(D) @ B).real


def node_kernel(fc: ForceConstants, elastic: ElasticConstants, step_cc, horizon: float) -> NodeKernel:
    """The kernel of a crystal on nodes `step_cc` apart.

    Raises
    ------
    AtcError where the family is too small, or no stable kernel is found.
    """
    step = np.asarray(step_cc, float)
    offsets = family(step, horizon)
    volume = abs(np.linalg.det(step))
    x = fit_springs(fc, elastic, step, offsets, lambda k: condensed(fc, k))
    mass = fc.crystal.density * volume
    made = NodeKernel(step, np.vstack([offsets, -offsets]), np.concatenate([x, x]), mass, volume)
    measure(made, fc, elastic, 2 * np.pi * np.linalg.inv(step).T)
    if not made.least > 0.0:
        u = fc.crystal.units
        apart = f"{u.to_user('length', np.linalg.norm(step, axis=1).max()):.4g} {u.label('length')}"
        raise AtcError(f"no stable kernel was found for nodes {apart} apart: take another horizon in [twin]")
    return made


def fit_springs(fc, elastic, step, offsets, stiffness) -> np.ndarray:
    """(p, 3, 3) springs of one of each pair ±ξ, elastic constants exact, otherwise near `stiffness(k)` (k, 3, 3), per
    mass, over the zone of the nodes."""
    xi = offsets @ step
    volume = abs(np.linalg.det(step))
    reciprocal = 2 * np.pi * np.linalg.inv(step).T
    s = (np.array(list(product(range(_MESH), repeat=3))) + 0.5) / _MESH
    k = nearest_images(s[s[:, 0] < 0.5] @ reciprocal, reciprocal)
    mass = fc.crystal.density * volume
    wanted = stiffness(k)
    if np.linalg.eigvalsh(wanted).min() <= 0:
        raise AtcError(
            f"{fc.crystal.name}: the lattice itself is unstable (imaginary frequencies): no kernel follows it"
        )
    xj = xi[:, [j for j, _ in VOIGT]] * xi[:, [l for _, l in VOIGT]]
    if np.linalg.matrix_rank(xj, tol=1e-9 * np.abs(xj).max()) < 6:
        raise AtcError("the horizon reaches too few nodes for the elastic constants: take a larger one in [twin]")
    start = np.linalg.lstsq(xj.T, wanted_moments(elastic, volume), rcond=None)[0]
    free = np.linalg.svd(xj)[0][:, 6:]
    edge = 0.5 * np.linalg.norm(reciprocal, axis=1).min()
    x = start + free @ _relative(wanted, k, 4 * np.sin(0.5 * k @ xi.T) ** 2 / mass, start, free, edge)
    return (x @ BASIS.reshape(6, 9)).reshape(-1, 3, 3)


def wanted_moments(elastic: ElasticConstants, volume: float) -> np.ndarray:
    """(6, 6) Σ ξ_p ξ_q S_ij over pairs ±ξ, in Voigt's notation (pq, ij), that give the elastic constants: Σ (k·ξ)² S is
    V C k k."""
    C = elastic.tensor
    return np.array([[0.5 * volume * (C[i, p, j, q] + C[i, q, j, p]) for i, j in VOIGT] for p, q in VOIGT])


def wave_constants(kernel) -> np.ndarray:
    """(6, 6) the constants whose acoustic tensor is that of the springs, each of which stands from both its ends."""
    return 0.5 * of_springs(kernel.springs_bcc, kernel.offsets_bc @ kernel.step_cc) / kernel.volume


def measure(made, fc, elastic, reciprocal):
    """Errors of ω and the smallest ω², at other wave vectors than those of the fit."""
    m = 2 * _MESH + 1
    s = np.array(list(product(range(m), repeat=3))) / m
    k = nearest_images(s[1:] @ reciprocal, reciprocal)
    own, long = (np.linalg.eigvalsh(D)[:, 0] for D in (made.dynamical_matrix(k), elastic.christoffel(k)))
    made.least = float((own / long).min())
    # Along every direction of the cube to the face of the zone it meets first.
    e = np.array([d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], float)
    e /= np.linalg.norm(e, axis=1)[:, None]
    n = np.array([o for o in product(range(-2, 3), repeat=3) if any(o)]) @ reciprocal
    along = e @ n.T
    ends = np.min(np.where(along > 1e-9, 0.5 * (n**2).sum(axis=1) / np.where(along > 1e-9, along, 1.0), np.inf), axis=1)

    def error(k):
        own = signed_root(np.linalg.eigvalsh(made.dynamical_matrix(k)))
        return np.abs(own / np.sqrt(np.linalg.eigvalsh(fc.dynamical_matrix(k))[:, :3]) - 1).max()

    made.error_f = np.array([error(f * ends[:, None] * e) for f in FRACTIONS])


def family(step, horizon) -> np.ndarray:
    """(p, 3) lattice offsets within the horizon, one of each pair ±ξ."""
    reach = np.ceil(horizon * np.linalg.norm(np.linalg.inv(step), axis=0)).astype(int)
    o = np.array([o for o in product(*(range(-r, r + 1) for r in reach)) if o > (0, 0, 0)])
    return o[np.linalg.norm(o @ step, axis=1) <= horizon * (1 + 1e-10)]


def _relative(wanted, k, phase_kp, start_pv, free_pf, edge) -> np.ndarray:
    """(f, 6) the free part of the springs: least squares on L⁻¹(D − D_c)L⁻ᵀ, D_c = L Lᵀ the crystal's."""
    inverse = np.linalg.inv(np.linalg.cholesky(wanted))
    # What a unit of each of the six components makes of it; off the diagonal twice in the norm.
    unit = np.stack([inverse @ b @ inverse.swapaxes(1, 2) for b in BASIS], axis=1)
    comp = np.array([1.0, 1, 1, 2**0.5, 2**0.5, 2**0.5])
    T = to_voigt(unit).swapaxes(1, 2) * comp[None, :, None]
    A = np.einsum("kf,kcv->kcfv", phase_kp @ free_pf, T).reshape(len(k) * 6, -1)
    one = np.array([1.0, 1, 1, 0, 0, 0])
    b = (one - np.einsum("kv,kcv->kc", phase_kp @ start_pv, T)).ravel()
    # Waves near the corners of the zone are beyond what nodes can carry: they must be stable, not near.
    weight = np.repeat(1 / (1 + (np.linalg.norm(k, axis=1) / (_CARRIED * edge)) ** 4), 6)
    normal = A.T @ (A * weight[:, None])
    normal[np.diag_indices(len(normal))] += _SMALL**2 * np.trace(normal) / len(normal)
    return np.linalg.solve(normal, A.T @ (b * weight)).reshape(-1, 6)
