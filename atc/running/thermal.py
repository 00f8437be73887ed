"""Thermal motion in time averages: what can only be said of the averages, not of each frame.

Relative to the averaged velocity U = <π>/<ρ>: <T> − <π>⊗U − U⊗<π> + <ρ> U⊗U, T = Σ m v⊗v φ. Relative to the velocity
of each frame, a frame in which an atom is alone in reach of a point says nothing of thermal motion there, and its
kinetic stress is 0: the others stand for it, by <n>/<n where it is not alone>.
"""

from __future__ import annotations

import numpy as np

from ..estimators.registry import hidden
from ..estimators.tensors import quotient

#: What goes with the kinetic stress.
_TENSORS = ("stress_kinetic", "stress")


def finish_thermal(job, means: dict, extra: dict) -> None:
    """Complete the averages of temperature and kinetic stress (arrays in the user's units, changed in place), and drop
    what was averaged for that alone. extra : their standard errors, `<name>_stderr`"""
    velocity = job.request.velocity
    if velocity == "average":
        _about_average(job, means)
    elif velocity == "frame" and "_paired" in means:
        _for_the_lonely(means, extra, apart=job.parts is not None)
    for name in [name for name in means if hidden(name)]:
        del means[name]
        for key in ("stderr", "correlated"):
            extra.pop(f"{name}_{key}", None)


def _for_the_lonely(means, extra, apart) -> None:
    number = means["_number"].sum(0) if apart else means["_number"]
    paired = means["_paired"][0] if apart else means["_paired"]
    factor = np.where(paired > 0, quotient(number, paired), 1.0)
    if (factor == 1.0).all():
        return
    more = np.where(factor > 1.0, factor - 1.0, 0.0)[..., None, None]
    kinetic, error = means["stress_kinetic"], extra["stress_kinetic_stderr"]
    if "stress" in means:
        means["stress"] = means["stress"] + more * kinetic
        extra["stress_stderr"] = extra["stress_stderr"] + more * error
    means["stress_kinetic"], extra["stress_kinetic_stderr"] = kinetic + more * kinetic, error + more * error


def _about_average(job, means) -> None:
    u = job.first.units
    rho = u.to_internal("density", means["density"])
    momentum = u.to_internal("momentum", means["momentum"])
    if job.parts is not None:
        U = np.broadcast_to(quotient(momentum.sum(0), rho.sum(0)), momentum.shape)
    else:
        U = quotient(momentum, rho)
    streaming = momentum[..., :, None] * U[..., None, :]
    streaming = streaming + np.swapaxes(streaming, -1, -2) - rho[..., None, None] * U[..., :, None] * U[..., None, :]
    for name in _TENSORS:
        if name in means:
            means[name] = means[name] + u.to_user("pressure", streaming)
    if "temperature" in means:
        degrees = u.to_internal("number_density", means["_degrees"])
        share = np.trace(streaming, axis1=-2, axis2=-1) / (u.dimension * u.boltzmann)
        means["temperature"] = means["temperature"] - u.to_user("temperature", quotient(share, degrees))


def described(velocity: str, quantity) -> str:
    """What a field's comment says of it; "" for fields that have nothing to do with it."""
    if not quantity.thermal:
        return ""
    return {
        "frame": "velocities relative to the one at the point in each frame, and corrected for it by 1/(1 - 1/N), "
        "N = n rho/sum(m phi^2), the effective number of atoms in reach: unbiased from two atoms on, if their "
        "velocities are independent",
        "local": "velocities relative to the one at the point in each frame, uncorrected: of N atoms in reach only "
        "1 - 1/N of their thermal motion is seen",
        "average": "velocities relative to the time average of the one at the point: what flows to and fro within the "
        "average counts as thermal motion, and of N atoms in reach in F frames 1/(N F) is missed",
        "none": "velocities in the frame of the simulation: streaming counts as thermal motion",
    }[velocity]
