"""Kinematics: how the motion, and the displacement since a reference frame, change from place to place."""

from __future__ import annotations

from ..tensors import curl
from .quantity import VELOCITY, Quantity, largest

_GRADIENT_SIGN = "component [i, j]: i the direction of the derivative, j the component of the vector"

_DISPLACEMENT = {"site": ("mass",), "gather": ("mass", "displacement")}
_BY_KERNEL = "from the gradient of the kernel, no finite differences"


def _kinematic(dimension, long_name, form, rank, sign=_GRADIENT_SIGN, gradient=True, comment="", scale=lambda s: 0.0):
    return {
        "dimension": dimension,
        "rank": rank,
        "masked": True,
        "weight": "mass",
        "gradient": gradient,
        "long_name": long_name,
        "form": form,
        "sign": sign,
        "comment": comment,
        "scale": scale,
    }


def _slope(s, mean_gc) -> float:
    """What the gradient of a mean is the difference of: ∂ρ times the mean, over ρ."""
    rho = largest(s.gathered["mass"])
    return largest(s.gradient["mass"]) * largest(mean_gc) / rho if rho > 0 else 0.0


def _velocity_slope(s) -> float:
    return _slope(s, s.velocity)


def _velocity_slopes(s) -> float:
    return max(_velocity_slope(s), largest(s.velocity_gradient))


QUANTITIES = [
    Quantity(
        "velocity_gradient",
        **VELOCITY,
        **_kinematic(
            "rate", "velocity gradient", lambda s: s.velocity_gradient, 2, comment=_BY_KERNEL, scale=_velocity_slope
        ),
    ),
    Quantity(
        "strain_rate",
        **VELOCITY,
        **_kinematic(
            "rate",
            "rate of strain",
            lambda s: 0.5 * (s.velocity_gradient + s.velocity_gradient.swapaxes(1, 2)),
            2,
            sign="positive where material lengthens; symmetric part of the velocity gradient",
            comment=_BY_KERNEL,
            scale=_velocity_slopes,
        ),
    ),
    Quantity(
        "vorticity",
        **VELOCITY,
        **_kinematic(
            "rate",
            "vorticity",
            lambda s: curl(s.velocity_gradient),
            1,
            sign="curl of the velocity, right-handed: twice the rotation rate",
            comment=_BY_KERNEL,
            scale=_velocity_slopes,
        ),
    ),
    Quantity(
        "displacement",
        **_DISPLACEMENT,
        **_kinematic(
            "length",
            "displacement since the reference frame",
            lambda s: s.displacement,
            1,
            sign="positive along +x, +y, +z",
            gradient=False,
            comment="mass-weighted mean of x_j - X_j over the atoms that are near the point now (current positions)",
        ),
    ),
    Quantity(
        "displacement_gradient",
        **_DISPLACEMENT,
        **_kinematic(
            "dimensionless",
            "gradient of the displacement",
            lambda s: s.displacement_gradient,
            2,
            comment="with respect to current positions; the inverse of the deformation gradient is I minus "
            "it; " + _BY_KERNEL,
            scale=lambda s: _slope(s, s.displacement),
        ),
    ),
]
