"""Rigid indenters and walls: nodes inside are pushed out with a force density k·(depth)² (R "The Projectile"; LAMMPS
fix indent)."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from .bonds import JIT
from .conditions import as_function
from .friction import rub_rigid


class _Rigid:
    def __init__(self, place, velocity, friction, name):
        """place : (3,) or a function of time. velocity : (3,) added to a constant place, or None."""
        if not (friction >= 0 and np.isfinite(friction)):
            raise AtcError(f"{name}: friction is a coefficient, a number of 0 or more, got {friction!r}")
        self.friction = float(friction)
        if velocity is None:
            self.place = as_function(place, name)
            self.constant = None if callable(place) or (isinstance(place, tuple) and np.ndim(place[0])) else np.zeros(3)
        else:
            p, v = np.array(place, float), np.array(velocity, float)
            self.place, self.constant = lambda t: p + t * v, v

    def velocity(self, t, dt):
        """(3,) its velocity over the last step (at the start: over the first)."""
        if self.constant is not None:
            return self.constant
        a, b = (t - dt, t) if t >= dt else (t, t + dt)
        return (np.asarray(self.place(b), float) - np.asarray(self.place(a), float)) / dt

    def add(self, t, z, F_nc):
        """Add the forces on the body at time t to F (n, 3); returns the energy stored in the penetration."""
        raise NotImplementedError

    def rub(self, t, z, v_nc, mass_n, dt, F_nc):
        """Add Coulomb's friction at time t to F (n, 3); returns what power it brings from outside. The push that it is
        of stays for `pushed`."""
        self.push_nc[:] = 0.0
        self.energy = self.add(t, z, self.push_nc)
        return rub_rigid(self.push_nc, self.friction, self.velocity(t, dt), v_nc, mass_n, dt, F_nc)

    def pushed(self, F_nc):
        """`add` of the time and place that were `rub`'s."""
        F_nc += self.push_nc
        return self.energy

    def bind(self, body):
        self.V_n = body.V_n
        self.force, self.push_nc = np.zeros(3), np.zeros((len(body), 3))
        return self


class Indenter(_Rigid):
    """A rigid sphere, or a cylinder along an axis, that pushes nodes outward with the force density k (R − r)² inside
    its radius R.

    Parameters
    ----------
    radius : R. stiffness : k (force per volume and length²).
    center : (3,) at time 0, or a function of time; the centre at the time of the force counts. velocity : (3,)
        constant, added to a constant centre.
    axis : None for a sphere, "x", "y", "z" for a cylinder
    friction : Coulomb's coefficient μ (see `friction`)
    """

    def __init__(self, radius: float, stiffness: float, center, velocity=None, axis=None, friction=0.0):
        if not (radius > 0 and stiffness >= 0):
            raise AtcError("an indenter needs a positive radius and a stiffness that is not negative")
        self.radius, self.stiffness, self.axis = (
            float(radius),
            float(stiffness),
            -1 if axis is None else "xyz".index(axis),
        )
        super().__init__(center, velocity, friction, "the indenter's center")

    @property
    def center(self):
        """Its centre as a function of time."""
        return self.place

    def add(self, t, z, F_nc):
        c = np.asarray(self.center(t), float)
        return _sphere(z, self.V_n, c, self.axis, self.radius, self.stiffness, F_nc, self.force)


class Wall(_Rigid):
    """A rigid half space: nodes behind the plane through `point` with the outward `normal` are pushed back with the
    force density k·depth².

    point : (3,) or a function of time. velocity : (3,), added to a constant point. friction : Coulomb's coefficient μ.
    """

    def __init__(self, point, normal, stiffness: float, velocity=None, friction=0.0):
        self.normal = np.array(normal, float)
        if not np.linalg.norm(self.normal) > 0:
            raise AtcError("a wall needs a normal that is not zero")
        self.normal /= np.linalg.norm(self.normal)
        self.stiffness = float(stiffness)
        super().__init__(point, velocity, friction, "the wall's point")

    @property
    def point(self):
        """A point of its plane as a function of time."""
        return self.place

    def add(self, t, z, F_nc):
        return _wall(z, self.V_n, np.asarray(self.point(t), float), self.normal, self.stiffness, F_nc, self.force)


@njit(**JIT)
def _sphere(z, V, center, axis, radius, k, F, total):
    energy = 0.0
    total[:] = 0.0
    d = np.empty(3)
    for n in range(len(V)):
        r2 = 0.0
        for c in range(3):
            d[c] = (z[n, 3 + c] + z[n, c]) - center[c]
            if c == axis:
                d[c] = 0.0
            r2 += d[c] * d[c]
        if r2 < radius * radius:
            r = np.sqrt(r2)
            gap = radius - r
            if r > 0.0 and gap > 0.0:
                a = V[n] * k * gap * gap / r
                for c in range(3):
                    F[n, c] += a * d[c]
                    total[c] += a * d[c]
            energy += V[n] * k * gap**3 / 3.0
    return energy


@njit(**JIT)
def _wall(z, V, point, normal, k, F, total):
    energy = 0.0
    total[:] = 0.0
    for n in range(len(V)):
        depth = 0.0
        for c in range(3):
            depth -= ((z[n, 3 + c] + z[n, c]) - point[c]) * normal[c]
        if depth > 0.0:
            a = V[n] * k * depth * depth
            for c in range(3):
                F[n, c] += a * normal[c]
                total[c] += a * normal[c]
            energy += V[n] * k * depth**3 / 3.0
    return energy
