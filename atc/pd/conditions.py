"""What is done to a body from outside on regions: prescribed velocities and displacements, body forces; each a function
of time."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


def as_function(value, name):
    """A function t → (3,) or (m, 3) array from a number triple (None entries: left free), an array, a table (times,
    values) or a function."""
    if callable(value):
        return value
    if isinstance(value, tuple) and len(value) == 2 and np.ndim(value[0]) == 1 and np.ndim(value[1]) == 2:
        times, table = np.asarray(value[0], float), np.asarray(value[1], float)
        if len(times) != len(table) or (np.diff(times) <= 0).any():
            raise AtcError(f"{name}: a table needs increasing times and one row of three values for each")
        return lambda t: np.array([np.interp(t, times, table[:, c]) for c in range(3)])
    try:
        a = (
            np.array([np.nan if c is None else c for c in value], float)
            if np.ndim(value) == 1
            else np.asarray(value, float)
        )
    except (TypeError, ValueError):
        raise AtcError(
            f"{name} must be three numbers (None for a free component), an array, a table (times, values) or a "
            "function of time"
        ) from None
    if a.shape[-1:] != (3,):
        raise AtcError(f"{name} must have three components, got shape {a.shape}")
    return lambda t: a


class Condition:
    """Base of the conditions. `region` is a Region, a mask, node numbers, a function of positions, or None for all
    nodes."""

    def __init__(self, region=None):
        self.region = region

    def bind(self, body):
        self.nodes = np.ascontiguousarray(body.nodes(self.region), dtype=np.int64)
        if not len(self.nodes):
            raise AtcError(f"{type(self).__name__}: no node of the body lies in its region")
        return self


class Prescribed(Condition):
    """Velocity or displacement of the nodes of a region as a function of time.

    velocity, displacement : (3,) with None (or NaN) for free components; (m, 3) for the m nodes; a table (times (k,),
        values (k, 3)); or a
        function t → (3,) or (m, 3). Exactly one of the two.
    until : time after which the nodes are free again
    """

    def __init__(self, region=None, *, velocity=None, displacement=None, until=np.inf):
        super().__init__(region)
        if (velocity is None) == (displacement is None):
            raise AtcError("a prescribed motion needs exactly one of velocity and displacement")
        self.is_velocity = velocity is not None
        self.value = as_function(
            velocity if self.is_velocity else displacement, "velocity" if self.is_velocity else "displacement"
        )
        self.until = float(until)

    def at(self, t):
        """(m, 3) values at time t; NaN where free."""
        return np.broadcast_to(np.asarray(self.value(t), float), (len(self.nodes), 3))


class BodyForce(Condition):
    """A force density (force per volume) on the nodes of a region: (3,), (m, 3), a table or a function of time; or,
    with `total`, one force shared out by volume."""

    def __init__(self, region=None, density=None, *, total=None):
        super().__init__(region)
        if (density is None) == (total is None):
            raise AtcError("a body force needs exactly one of density (force per volume) and total (force)")
        self.is_total = total is not None
        self.value = as_function(total if self.is_total else density, "body force")

    def bind(self, body):
        super().bind(body)
        V = body.V_n[self.nodes]
        self.weight_n = (V / V.sum() if self.is_total else V)[:, None]
        return self

    def add(self, t, z, F_nc):
        """Add the forces at time t; returns 0 (a body force has no energy of its own)."""
        F_nc[self.nodes] += self.weight_n * np.asarray(self.value(t), float)
        return 0.0
