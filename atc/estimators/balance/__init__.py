"""Residuals of the balance laws of mass, momentum and energy, and of ∇·z = 0, at points (formulas.md §4; R
4.0.78-4.0.116).

    ∂ρ/∂t + ∇·(ρ v) = 0,   ∂(ρ v)/∂t + ∇·(ρ v⊗v) = ∇·σ + b,   ∂ε/∂t + ∇·(ε v) = ∇·(σ·v − q) + p,   ∇·z = 0,

b = Σ F_ext φ and p = Σ F_ext·v φ what acts from outside, q = q_K + q_U + q_C with the churning heat flux q_C = z·v.
Three ways, each blind to what another one sees:

``laws``         everything in closed form: ∂φ_j/∂t = −v_j·∇φ_j, dv_j/dt = F_j/m_j, dU^(j)/dt = Σ_k v_k·∂U^(j)/∂x_k, and
                 ∇·(r β) = φ_j − φ_i for every bond. Rounding only; tests that forces, stress and energy sources belong
                 to each other.
``stencils``     the fluxes as they are deposited, differentiated on small stencils; tests β, φ and the algebra of the
                 fields.
``differences``  rates as differences between frames; tests that the potential, the units and the time are those of the
                 run (``limits``: what limits these).

``points`` has the exact sums of atoms at points, ``rates`` what the potential says of a frame in motion.

All of it is done in the frame of reference that moves with the drift of the atoms: the laws are the same there
(Galilei), and a drift far above the thermal speed costs no digits.
"""

from .differences import energy_rates, frame_residuals, sums_of_frame
from .laws import DIMENSIONS, LAWS, Exact, Law, size
from .points import Sites, choose_points
from .rates import FIELD_TOLERANCE, Motion, field_bonds, motion
from .stencils import deposit_at, deposited, divergence, field_laws, from_fields, stencil

__all__ = [
    "DIMENSIONS", "FIELD_TOLERANCE", "LAWS", "Exact", "Law", "Motion", "Sites", "choose_points", "deposit_at",
    "deposited", "divergence", "energy_rates", "field_bonds", "field_laws", "frame_residuals", "from_fields", "motion",
    "size", "stencil", "sums_of_frame",
]  # fmt: skip
