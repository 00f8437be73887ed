"""Heat conduction in the bonds (Bobaru & Duangpanya 2010; Oterkus, Madenci & Agwai 2014):
ρ c ∂T/∂t = Σ_j h (T_j − T_i) V_j + q, with a micro-conductivity h = k d ω ν (1/m_i + 1/m_j) for which the conductivity
is k, m = Σ ω|ξ|² ν V of a node's family. Between two materials k is that of conductors in series. Broken bonds conduct
nothing.

Time goes by Runge, Kutta and Chebyshev's method of second order (Sommeijer, Shampine & Verwer 1998), explicit with as
many stages as the step needs, some √(Δt/Δt of Euler). Heat goes from node to node, so that it is conserved to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from .bonds import JIT
from .conditions import Condition
from .materials.force_model import harmonic
from .materials.influence import influence_function
from .surface import moment_factors


@dataclass(frozen=True)
class Conduction:
    """conductivity : k, power per length and temperature. specific_heat : c, energy per mass and temperature."""

    conductivity: float
    specific_heat: float

    def __post_init__(self):
        for name in ("conductivity", "specific_heat"):
            value = getattr(self, name)
            if not (np.isscalar(value) and np.isfinite(value) and value > 0):
                raise AtcError(f"conduction: {name} must be a number greater than 0, got {value!r}")


class _Thermal(Condition):
    def values(self, t):
        value = np.asarray(self.value(t) if callable(self.value) else self.value, float)
        if value.shape not in ((), (len(self.nodes),)) or not np.isfinite(value).all():
            raise AtcError(
                f"{type(self).__name__}: expected a finite number, or one for each of its {len(self.nodes)} nodes, at "
                f"time {t:g}"
            )
        return value


class FixedTemperature(_Thermal):
    """The temperature of the nodes of a region: a number, (m,) or a function of time. until : when it is let go."""

    def __init__(self, region=None, value=0.0, *, until=np.inf):
        super().__init__(region)
        self.value, self.until = value, float(until)


class HeatSource(_Thermal):
    """Power per volume on the nodes of a region, or with `total` one power shared out by volume: a number, (m,) or a
    function of time."""

    def __init__(self, region=None, density=None, *, total=None):
        super().__init__(region)
        if (density is None) == (total is None):
            raise AtcError("a heat source needs exactly one of density (power per volume) and total (power)")
        self.value, self.is_total = (density, False) if total is None else (total, True)

    def power(self, body, t):
        V = body.V_n[self.nodes]
        return self.values(t) * (V / V.sum() if self.is_total else V)


class HeatFlow:
    """Conduction in the bonds of a body.

    materials : {material: Conduction}. corrected : whether bonds are weighted so that nodes at surfaces, but for edges
        and corners, have the conductivity along every direction (`surface.moment_factors`)
    """

    def __init__(self, body, materials, conditions=(), influence="one", corrected=False):
        missing = set(np.unique(body.material_n).tolist()) - set(materials)
        if missing:
            raise AtcError(f"conduction: material {sorted(missing)[0]} of the body has no conductivity: give all")
        self.body, t = body, body.bonds
        ids = np.array(sorted(materials))
        at = np.searchsorted(ids, body.material_n)
        k_n, c_n = (
            np.array([getattr(materials[m], what) for m in ids.tolist()], float)[at]
            for what in ("conductivity", "specific_heat")
        )
        self.capacity_n = body.rho_n * body.V_n * c_n
        i, j = t.i_b, t.j_b
        w = body.V_n[i] * body.V_n[j] * body.nu_b()
        if influence != "one":
            w *= influence_function(influence)(t.r0_b, body.horizon)
        if corrected:
            w *= moment_factors(body, w)
        M = t.sums(w * t.r0_b**2)
        per = np.divide(body.V_n, M, out=np.zeros(len(body)), where=M > 0)
        self.C_b = body.dimension * harmonic(k_n[i], k_n[j]) * w * (per[i] + per[j])
        self.fixed = [c for c in conditions if isinstance(c, FixedTemperature)]
        self.sources = [c for c in conditions if isinstance(c, HeatSource)]
        self.fastest = float((2 * t.sums(self.C_b) / self.capacity_n).max())

    def flow_n(self, T_n, intact_b):
        """(n,) power that comes to each node through its bonds."""
        out = np.zeros(len(T_n))
        _flow(self.body.bonds.start_n, self.body.bonds.j_b, self.C_b, intact_b, T_n, out)
        return out

    def advance(self, T_n, t, dt, intact_b):
        """T_n := temperatures a time `dt` after t. Returns the heat that sources brought."""
        power = np.zeros(len(T_n))
        for s in self.sources:
            power[s.nodes] += s.power(self.body, t + 0.5 * dt)
        held = np.zeros(len(T_n), bool)
        now = [f for f in self.fixed if t + dt <= f.until]
        for f in now:
            held[f.nodes] = True
            T_n[f.nodes] = f.values(t + 0.5 * dt)

        def rate(T):
            out = (self.flow_n(T, intact_b) + power) / self.capacity_n
            out[held] = 0.0
            return out

        T_n[:] = _chebyshev(rate, T_n, dt, self.fastest)
        for f in now:
            T_n[f.nodes] = f.values(t + dt)
        return float(power[~held].sum()) * dt


def _chebyshev(rate, y, h, fastest):
    """One step of RKC2; `fastest` bounds the rates of decay."""
    # Damping ε = 1: of the fastest modes at most two thirds are left after a step.
    s = 1 + int(np.ceil(np.sqrt(1 + 1.8 * h * fastest)))
    w0 = 1 + 1 / (s * s)
    # Chebyshev's polynomials and their first two derivatives at w0.
    T, d, d2 = [1.0, w0], [0.0, 1.0], [0.0, 0.0]
    for _ in range(2, s + 1):
        T.append(2 * w0 * T[-1] - T[-2])
        d.append(2 * w0 * d[-1] - d[-2] + 2 * T[-2])
        d2.append(2 * w0 * d2[-1] - d2[-2] + 4 * d[-2])
    w1 = d[s] / d2[s]
    b = [0.0, 0.0] + [d2[k] / d[k] ** 2 for k in range(2, s + 1)]
    b[0] = b[1] = b[2]
    f0 = rate(y)
    before, last = y, y + b[1] * w1 * h * f0
    for k in range(2, s + 1):
        mu, nu, tilde = 2 * b[k] * w0 / b[k - 1], -b[k] / b[k - 2], 2 * b[k] * w1 / b[k - 1]
        gamma = -(1 - b[k - 1] * T[k - 1]) * tilde
        new = (1 - mu - nu) * y + mu * last + nu * before + h * (tilde * rate(last) + gamma * f0)
        before, last = last, new
    return last


@njit(**JIT)
def _flow(start, j, C, intact, T, out):
    for i in range(len(start) - 1):
        total = 0.0
        for b in range(start[i], start[i + 1]):
            if intact[b] != 0:
                q = C[b] * (T[j[b]] - T[i])
                total += q
                out[j[b]] -= q
        out[i] += total
