"""The laws with the divergences of the deposited fields, on small stencils."""

from __future__ import annotations

import numpy as np

from ..tensors import full, outer6, quotient
from .laws import Exact, Law, size
from .rates import FIELD_TOLERANCE, Motion

#: Steps of a stencil in units of h; pairs ±s along each axis.
STEPS = (1.0, 2.0, 4.0)


def stencil(x_gc, h: float, dimension: int = 3) -> np.ndarray:
    """(g·19, 3): every point, then x ± h, ± 2h, ± 4h along each axis; in the plane, out of which nothing changes, the
    point itself for those along z."""
    steps = np.concatenate([np.zeros((1, 3)), *[[k * s * h * e for s in STEPS for k in (1, -1)] for e in np.eye(3)]])
    steps[:, dimension:] = 0.0
    return (x_gc[:, None] + steps).reshape(-1, 3)


def divergence(values_g, h: float) -> tuple[np.ndarray, np.ndarray]:
    """∂_µ f[µ, ...] of sixth order from a field on stencils, and (g,) how far two results of fourth order differ:
    rounding and kinks."""
    v = np.asarray(values_g).reshape(-1, 19, *np.shape(values_g)[1:])
    pairs = v[:, 1:].reshape(len(v), 3, 3, 2, *v.shape[2:])
    slopes = []
    for k, s in enumerate(STEPS):
        difference = pairs[:, :, k, 0] - pairs[:, :, k, 1]
        slopes.append(np.einsum("gmm...->g...", difference) / (2.0 * s * h))
    fourth = [(4.0 * slopes[0] - slopes[1]) / 3.0, (4.0 * slopes[1] - slopes[2]) / 3.0]
    return (16.0 * fourth[0] - fourth[1]) / 15.0, size(fourth[0] - fourth[1])


def deposit_at(x_gc, kern, cell, threads: int):
    """A direct deposit at scattered points for the 21 bond components of `motion`; 14 site components."""
    from ...deposit import exact_at

    return exact_at(x_gc, kern, cell, 14, 21, threads)


def deposited(state: Motion, deposit, field_g21=0.0) -> dict[str, np.ndarray]:
    """density, momentum, velocity, energy, stress, heat_flux, heat_flux_churning, churning at the deposit's points,
    relative to the drift. field_g21 : of `field_bonds`"""
    frame, v = state.frame, state.v_nc
    m, e = frame.masses[:, None], state.total_n[:, None]
    deposit.add_sites(frame.positions, np.concatenate([m, m * v, m * outer6(v), e, e * v], axis=1))
    site, bond = deposit.site_sums(), deposit.bond_sums() + field_g21
    rho, pi, T, eps, J = site[:, 0], site[:, 1:4], full(site[:, 4:10]), site[:, 10], site[:, 11:14]
    S, A, M = bond[:, :9].reshape(-1, 3, 3), bond[:, 9:12], bond[:, 12:].reshape(-1, 3, 3)
    v_g = quotient(pi, rho)
    kinetic = -(T - pi[:, :, None] * v_g[:, None, :])
    z = S + M
    churning = np.einsum("gmn,gn->gm", z, v_g)
    q = J - eps[:, None] * v_g + np.einsum("gmn,gn->gm", kinetic, v_g) + A - np.einsum("gmn,gn->gm", M, v_g) + churning
    return {
        "density": rho, "momentum": pi, "velocity": v_g, "energy": eps, "stress": S + kinetic, "heat_flux": q,
        "heat_flux_churning": churning, "churning": z, "bonds": bond,
    }  # fmt: skip


def from_fields(frame, pot, kern_user, x_gc, threads: int) -> dict[str, np.ndarray]:
    """The same fields as `atc.fields` writes them, as far as it knows them; internal units. `frame` has its drift taken
    off."""
    from ...grids import Grid
    from ..driver import fields_of
    from ..registry import QUANTITIES
    from ..settings import Settings

    names = [
        n for n in ("density", "momentum", "velocity", "energy", "stress", "heat_flux", "churning") if n in QUANTITIES
    ]
    u = frame.units
    grid = Grid.points(u.to_user("length", x_gc))
    more = {"tolerance": FIELD_TOLERANCE} if pot.fields else {}
    result = fields_of([frame], Settings(tuple(names), pot, kern_user, grid, threads=threads, check_points=1, **more))
    if "heat_flux" in names:
        names.append("heat_flux_churning")
    return {n: u.to_internal(QUANTITIES[n].dimension, result.arrays[n]) for n in names}


def field_laws(exact_laws, exact: Exact, fields, h: float) -> dict[str, Law]:
    """The laws with exact rates and with the divergences of deposited fields on stencils of step h."""
    rho, v = fields["density"], fields["velocity"]
    stress, q, qC = fields["stress"], fields["heat_flux"], fields["heat_flux_churning"]
    momentum_flux = rho[:, None, None] * v[:, :, None] * v[:, None, :] - stress
    energy_flux = fields["energy"][:, None] * v - np.einsum("gmn,gn->gm", stress, v) + q
    out = {}
    for law, rate, flux in (
        ("mass", exact.rho_t, fields["momentum"]),
        ("momentum", exact.pi_t - exact.body, momentum_flux),
        ("energy", exact.energy_t - exact.body_power, energy_flux),
    ):
        div, limit = divergence(flux, h)
        out[law] = Law(exact_laws[law].terms, rate + div, limit=limit)
    div, limit = divergence(energy_flux - qC, h)
    out["energy"].without = exact.energy_t - exact.body_power + div
    div, limit = divergence(fields["churning"], h)
    out["churning"] = Law(exact_laws["churning"].terms, div, limit=limit)
    return out
