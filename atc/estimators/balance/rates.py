"""What the potential says of a frame in motion: the rates of its atoms' momenta and energies, and the factors of its
bonds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...compiled import njit
from ...decomposers.constraints.virtual_sites import seen_by
from ..atom_pass import drift_velocity
from ..tensors import full


@dataclass
class Motion:
    """The atoms of a frame and their exact rates; velocities relative to the drift."""

    frame: object
    drift: np.ndarray
    v_nc: np.ndarray
    energies_n: np.ndarray  # U^(j)
    forces_nc: np.ndarray
    slope_nc: np.ndarray  # Σ_p ∂U^(p)/∂x_k, own shares by translation invariance
    share_rate_n: np.ndarray  # dU^(j)/dt
    flux_n: np.ndarray  # ∇·A = Σ flux_j φ_j
    torque_nc: np.ndarray  # ∇·M = Σ torque_j φ_j
    stiffness_n: np.ndarray  # √Σ |∂U/∂x|² over an atom's bonds: how strongly energies respond to its position
    notes: dict = field(default_factory=dict)
    outside_nc: np.ndarray | None = None  # forces from outside, where there are any

    @property
    def total_n(self) -> np.ndarray:
        """e_j = ½ m v² + U^(j)."""
        return 0.5 * self.frame.masses * (self.v_nc**2).sum(1) + self.energies_n


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(i, j, F, D, P, v, slope, rate, flux, torque, stiff):
    for b in range(len(F)):
        p, q = i[b], j[b]
        a = P[b] if len(P) else 0.0  # what messages carry from q to p
        rate[p] += a
        rate[q] -= a
        d2 = 0.0
        for c in range(3):
            Dp, Dq = D[b, 0, c], D[b, 1, c]  # ∂U^(p)/∂x_q, ∂U^(q)/∂x_p
            w = v[q, c] - v[p, c]
            rate[p] += w * Dp
            rate[q] -= w * Dq
            slope[q, c] += Dp - Dq
            slope[p, c] += Dq - Dp
            a += v[q, c] * Dp - v[p, c] * Dq
            # ∇·(r β) = φ_q − φ_p
            torque[q, c] += Dp - Dq
            torque[p, c] -= Dp - Dq
            d2 += F[b, c] ** 2
        flux[q] += a
        flux[p] -= a
        stiff[p] += d2
        stiff[q] += d2


@njit(cache=True, nogil=True, error_model="numpy")
def _bond_factors(i, j, r, F, D, P, v, out):
    """−r⊗F (9), A = (v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i + P) r (3), M = r⊗(∂U^(i)/∂x_j − ∂U^(j)/∂x_i) (9)."""
    for b in range(len(F)):
        a = P[b] if len(P) else 0.0
        for c in range(3):
            a += v[j[b], c] * D[b, 0, c] - v[i[b], c] * D[b, 1, c]
        for m in range(3):
            out[b, 9 + m] = a * r[b, m]
            for c in range(3):
                out[b, 3 * m + c] = -r[b, m] * F[b, c]
                out[b, 12 + 3 * m + c] = r[b, m] * (D[b, 0, c] - D[b, 1, c])


def motion(frame, pot, threads: int = 1, deposit=None) -> Motion:
    """One pass over the bonds of a frame: the atoms' rates, and into `deposit` (of 21 bond components) the bonds'
    factors."""
    fields = pot.fields
    n = len(frame)
    drift = drift_velocity(frame)
    v_nc = np.ascontiguousarray(frame.velocities - drift)
    parts = [[np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(n)] for _ in range(threads)]

    def consume(bonds, thread):
        F_bc = bonds.forces()
        _scatter(bonds.i, bonds.j, F_bc, bonds.D_bdc, bonds.powers(), v_nc, *parts[thread])
        if deposit is not None:
            b_bk = np.empty((len(bonds), 21))
            _bond_factors(bonds.i, bonds.j, bonds.r_bc, F_bc, bonds.D_bdc, bonds.powers(), v_nc, b_bk)
            deposit.add_bonds(frame.positions[bonds.i], bonds.r_bc, b_bk, thread=thread)

    d = pot.stream(frame, consume, threads=threads, energies=True, forces=True, sources=True)
    slope, rate, flux, torque, stiff = (sum(p[k] for p in parts) for k in range(5))
    for term in fields:
        seen = seen_by(term, frame)
        m = len(seen)
        _add_field(term, seen, v_nc[:m], slope[:m], rate[:m], flux[:m], torque[:m], stiff[:m])
    return Motion(frame, drift, v_nc, d.energies_n, d.forces_nc, slope, rate, flux, torque, np.sqrt(stiff), d.notes)


def _add_field(term, frame, v_nc, slope, rate, flux, torque, stiff) -> None:
    """The rates of a field's shares U^(j), such as ½ q_j Φ(x_j) + const; it churns nothing: ∇·z = 0."""
    smooth = term.modes(frame, term.threads)
    force_nc = smooth.forces_nc()
    power = np.einsum("nc,nc->n", v_nc, force_nc)
    share_rate = smooth.share_rates_n(v_nc)
    slope -= force_nc
    rate += share_rate
    flux -= share_rate + power
    torque -= force_nc
    stiff += (force_nc**2).sum(1)


#: What of a field's modes may be left out: far below what stencils tell apart.
FIELD_TOLERANCE = 1e-11


def field_bonds(frame, pot, kern, x_gc, threads: int = 1) -> np.ndarray | float:
    """(g, 21) what fields add to the bonds' sums of `motion` at points, mode by mode; velocities relative to the
    drift."""
    from ...grids import Grid
    from ..field_pass import FieldSums

    terms = pot.fields
    if not terms:
        return 0.0
    u = frame.units
    bound = Grid.points(u.to_user("length", x_gc)).bind(u, frame.cell, frame.positions)
    sums = FieldSums(terms, ["stress", "power", "sources"], bound, kern, FIELD_TOLERANCE, threads)
    sums.add(frame, drift_velocity(frame))
    found = sums.at(np.arange(len(bound)))
    return np.concatenate([full(found["stress"]).reshape(-1, 9), found["power"], found["sources"]], axis=1)
