"""The algebra of fields at points, on plain arrays: symmetric tensors as six components xx, yy, zz, yz, xz, xy, others
with three more; quotients and their gradients; moments of velocities about others.
"""

from __future__ import annotations

import numpy as np

_FULL = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def full(a_6) -> np.ndarray:
    """(..., 6) symmetric components xx, yy, zz, yz, xz, xy to (..., 3, 3)."""
    return np.asarray(a_6)[..., _FULL]


_ACROSS = np.array([[0, 2, 1], [2, 0, 0], [1, 0, 0]])
_SIGN = np.array([[0.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, -1.0, 0.0]])


def general(a_9) -> np.ndarray:
    """(..., 9) the components of the symmetric part, then yz, xz, xy of the antisymmetric one, to (..., 3, 3)."""
    a_9 = np.asarray(a_9)
    return full(a_9[..., :6]) + _SIGN * a_9[..., 6:][..., _ACROSS]


def outer6(v_nc) -> np.ndarray:
    """v⊗v as 6 components, (n, 3) to (n, 6)."""
    x, y, z = v_nc.T
    return np.stack([x * x, y * y, z * z, y * z, x * z, x * y], axis=1)


def quotient(a, w) -> np.ndarray:
    """a/w, w along the first axes of a; 0 where w is not positive."""
    w = w.reshape(w.shape + (1,) * (a.ndim - w.ndim))
    return np.divide(a, w, out=np.zeros_like(a), where=w > 0)


def quotient_gradient(weight_g, mean_gk, gradient_g1c, gradient_gkc) -> np.ndarray:
    """(g, c, k) ∂_c of a mean Σ w a φ / Σ w φ, from its value and the sums with ∂φ/∂x; 0 where the weight is."""
    top = np.swapaxes(gradient_gkc, 1, 2) - np.swapaxes(gradient_g1c, 1, 2) * mean_gk[:, None, :]
    w = weight_g[:, None, None]
    return np.divide(top, w, out=np.zeros_like(top), where=w > 0)


def eshelby(energy_g, piola_gcc, displacement_gradient_gcc) -> np.ndarray:
    """W I − P (Grad u)ᵀ with piola[i, k] and gradient[j, k] = ∂u_k/∂X_j: component [i, j], i the direction of the
    divergence."""
    out = -np.einsum("gik,gjk->gij", piola_gcc, displacement_gradient_gcc)
    out[:, range(3), range(3)] += energy_g[:, None]
    return out


def curl(gradient_gcc) -> np.ndarray:
    """(g, 3) ε_ijk ∂_j v_k from [j, k] = ∂_j v_k."""
    L = gradient_gcc
    return np.stack([L[:, 1, 2] - L[:, 2, 1], L[:, 2, 0] - L[:, 0, 2], L[:, 0, 1] - L[:, 1, 0]], axis=1)


def kinetic_flux(rho, u_gc, thermal_g6, flux_gc) -> np.ndarray:
    """Σ ½ m |c − u|² (c − u) φ from ρ, u = Σ m c φ/ρ, Σ m (c − u)⊗(c − u) φ and Σ ½ m c² c φ; 0 where there is no
    mass."""
    half_trace = 0.5 * thermal_g6[:, :3].sum(1, keepdims=True)
    streaming = 0.5 * rho[:, None] * np.einsum("gc,gc->g", u_gc, u_gc)[:, None]
    out = flux_gc - (half_trace + streaming) * u_gc - np.einsum("gij,gj->gi", full(thermal_g6), u_gc)
    out[~(rho > 0)] = 0.0
    return out


def kinetic_flux_about(mass_g1, momentum_gc, kinetic_g6, flux_gc, u_gc) -> np.ndarray:
    """Σ ½ m |c − u|² (c − u) φ from Σ m φ, Σ m c φ, Σ m c⊗c φ, Σ ½ m c² c φ, for any u."""
    u2 = np.einsum("gc,gc->g", u_gc, u_gc)[:, None]
    pu = np.einsum("gc,gc->g", momentum_gc, u_gc)[:, None]
    energy = 0.5 * kinetic_g6[:, :3].sum(1, keepdims=True)
    carried = np.einsum("gij,gj->gi", full(kinetic_g6), u_gc)
    return flux_gc - energy * u_gc - carried + pu * u_gc + 0.5 * u2 * momentum_gc - 0.5 * mass_g1 * u2 * u_gc


def thermal(mass_g1, momentum_gc, kinetic_g6, u_gc=None) -> np.ndarray:
    """Σ m (c − u)⊗(c − u) φ = T − π⊗u − u⊗π + ρ u⊗u as 6 components, u = π/ρ if it is not given; its diagonal is a sum
    of squares, so what rounding leaves below 0 is cut off."""
    if u_gc is None:
        out = kinetic_g6 - outer6(quotient(momentum_gc, mass_g1[:, 0])) * mass_g1
        out[~(mass_g1[:, 0] > 0)] = 0.0
    else:
        p, u = momentum_gc, u_gc
        out = kinetic_g6.copy()
        for k, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
            out[:, k] += mass_g1[:, 0] * u[:, a] * u[:, b] - p[:, a] * u[:, b] - u[:, a] * p[:, b]
    np.maximum(out[:, :3], 0.0, out=out[:, :3])
    return out


def within_thermal(rho_g, v_gc, thermal_g6, limit) -> bool:
    """Whether the speed is no more than so many thermal speeds wherever there is mass."""
    mass = rho_g > 0
    v2 = np.einsum("gc,gc->g", v_gc, v_gc)
    heat = quotient(thermal_g6[:, :3].sum(1), rho_g)
    return bool((v2[mass] <= limit * limit * heat[mass]).all())
