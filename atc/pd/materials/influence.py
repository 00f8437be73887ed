"""Influence functions ω, and what sums over a whole family come to: moments, a bond-based micromodulus, the work of
breaking all bonds across a plane."""

from __future__ import annotations

import inspect

import numpy as np

from ...errors import AtcError
from ..bonds import HORIZON_SLACK

INFLUENCE = {
    "one": lambda r, delta: np.ones_like(r),
    "inverse": lambda r, delta: 1.0 / r,
    "linear": lambda r, delta: np.clip(1.0 - r / delta, 0.0, None),
    "quadratic": lambda r, delta: np.clip(1.0 - (r / delta) ** 2, 0.0, None),
    "gaussian": lambda r, delta: np.exp(-((2.0 * r / delta) ** 2)),
}


def influence_function(which):
    """ω(|ξ|, δ) by name, or the user's own vectorised function of both."""
    if of_vector(which):
        raise AtcError(
            "influence: a function of the bond's vector, one argument, has no values by length alone, and makes all "
            "but correspondence and bond-associated materials anisotropic: give those one of (|xi|, horizon)"
        )
    if callable(which):
        return which
    if which not in INFLUENCE:
        raise AtcError(
            f"influence function {which!r} is not known: use one of {', '.join(INFLUENCE)}, or a function of (|xi|, "
            "horizon)"
        )
    return INFLUENCE[which]


def of_vector(influence) -> bool:
    """Whether an influence function is one of ξ, with its direction: it takes one argument."""
    if not callable(influence):
        return False
    try:
        parameters = list(inspect.signature(influence).parameters.values())
    except ValueError:
        return False
    return len(parameters) == 1 and parameters[0].kind in (
        inspect.Parameter.POSITIONAL_ONLY,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
    )


def sampled_influence(influence, xi_bc):
    """(b,) ω of bond vectors; refused where ω(ξ) is negative, or not ω(−ξ)."""
    ahead, back = (np.asarray(influence(xi), float) for xi in (xi_bc, -xi_bc))
    for w in (ahead, back):
        if w.shape != (len(xi_bc),):
            raise AtcError(
                f"influence: it gave shape {w.shape} for {len(xi_bc)} bond vectors, expected ({len(xi_bc)},)"
            )
        if not (np.isfinite(w) & (w >= 0)).all():
            raise AtcError("influence: it must be a number, 0 or more, of every bond vector")
    if not np.abs(ahead - back).max(initial=0.0) <= 1e-10 * ahead.max(initial=0.0):
        raise AtcError(
            "influence: it must be even, that of xi and -xi the same, or the two ends of a bond weigh it differently"
        )
    return 0.5 * (ahead + back)


def sphere_measure(dimension: int, thickness: float):
    """Surface of the unit sphere in this dimension × thickness (2-D) or cross-section (1-D): dV = this · r^(d−1) dr."""
    return {1: 2.0 * thickness, 2: 2.0 * np.pi * thickness, 3: 4.0 * np.pi}[dimension]


def moment(influence, body, power: int):
    """∫ω|ξ|^power dV over the horizon."""
    d, delta, surface = body.dimension, body.horizon, sphere_measure(body.dimension, body.thickness)
    if influence == "one":
        return surface * delta ** (d + power) / (d + power)
    from scipy.integrate import quad

    if of_vector(influence):
        raise AtcError(
            "influence: with one of the bond's direction an energy per area depends on the plane: give a critical "
            "stretch, s00, instead of Gc"
        )
    omega = influence_function(influence)
    return surface * quad(lambda r: float(omega(np.array([r]), delta)[0]) * r ** (d - 1 + power), 0, delta)[0]


#: Mean of |cos| over all directions, by dimension: of a bond of length r, |cos| r crosses a plane.
MEAN_COS = {1: 1.0, 2: 2 / np.pi, 3: 0.5}


def critical_work(Gc, body, volume_correction=True):
    """w_c of a bond, per volumes of its ends (and their share ν, with `volume_correction`), with which all bonds across
    a plane together cost Gc per area: of a lattice, the plane where its sum is least, which a crack takes."""
    if body.step_cc is None:
        # Every direction counts a bond twice.
        return Gc / (0.5 * moment("one", body, 1) * MEAN_COS[body.dimension])
    return Gc / least_cut(body, volume_correction)


def least_cut(body, volume_correction=True) -> float:
    """Σ ν V_i V_j over the bonds that a plane between the nodes of a body's lattice crosses, per area; of the plane
    that crosses least."""
    d, step = body.dimension, body.step_cc[: body.dimension, : body.dimension]
    reach = np.ceil(body.horizon * np.linalg.norm(np.linalg.inv(step), axis=0)).astype(int)
    n = np.stack(np.meshgrid(*(np.arange(-k, k + 1) for k in reach), indexing="ij"), axis=-1).reshape(-1, d)
    xi = n @ step
    r = np.linalg.norm(xi, axis=1)
    # Of ±ξ one.
    inside = (r > 0) & (r <= body.horizon * (1 + HORIZON_SLACK)) & (np.arange(len(r)) > len(r) // 2)
    xi, r = xi[inside], r[inside]
    V = abs(np.linalg.det(step)) * (body.thickness if d < 3 else 1.0)
    weight = V * (body.share(r) if volume_correction else np.ones(len(r)))
    # The sum over |ξ·n| is least for an n normal to bonds: to short ones, whose planes cross few.
    short = xi[np.argsort(r, kind="stable")[:13]]
    if d == 1:
        normals = np.ones((1, 1))
    elif d == 2:
        normals = short[:, ::-1] * [1.0, -1.0]
    else:
        normals = np.cross(short[:, None], short[None]).reshape(-1, 3)
    size = np.linalg.norm(normals, axis=1)
    normals = normals[size > 1e-9 * size.max()] / size[size > 1e-9 * size.max(), None]
    return float((np.abs(normals @ xi.T) @ weight).min())


def bond_based_shear(body, youngs=None, bulk=None):
    """μ (= λ) of a bond-based body, whose Poisson's ratio is 1/4 (plane stress 1/3), from Young's or the bulk
    modulus."""
    poisson = 1 / 3 if body.dimension == 2 and body.plane == "stress" else 1 / 4
    E = youngs if youngs is not None else 3 * bulk * (1 - 2 * poisson)
    return E / 3 if body.dimension == 1 else E / (2 * (1 + poisson))


def micromodulus(body, shear, influence="one"):
    """c of a bond-based body: W = ¼ c ∫ω|ξ| (tr² + 2ε:ε)/(d(d+2)) is that of λ = μ."""
    d = body.dimension
    return 2 * d * (d + 2) * shear / moment(influence, body, 1)
