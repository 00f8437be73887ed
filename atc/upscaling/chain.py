"""Chains in one dimension: nonlocal linear springs, Lennard-Jones, peridynamics at any resolution, the classical wave
equation.

All of them are nodes x_i = i Δx that interact with their M nearest neighbours on either side, written as force
densities (Seleson, Parks, Gunzburger, Lehoucq 2009, eqs. A.2 and 5.3), so one model holds at every resolution: at Δx =
a it *is* molecular dynamics, at MΔx = δ a quadrature of peridynamics, and with M fixed and Δx → 0 the wave equation.
`atc.upscaling.evolve.verlet` moves them in time.

Ends: ``periodic``, or ``clamped``, which holds everything outside the chain at its reference place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..errors import AtcError

BOUNDARIES = ("periodic", "clamped")


def positive(name: str, value, what: str = "a number greater than 0") -> float:
    """A finite number greater than 0, or an AtcError."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (number > 0 and math.isfinite(number)):
        raise AtcError(f"{name} = {value!r}: expected {what}")
    return number


def whole(name: str, value, least: int = 1) -> int:
    """A whole number of at least `least`, or an AtcError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise AtcError(f"{name} = {value!r}: expected a whole number, {least} or more")
    return int(value)


def check_boundary(boundary: str) -> str:
    """One of `BOUNDARIES`, or an AtcError."""
    if boundary not in BOUNDARIES:
        raise AtcError(f"boundary = {boundary!r}: expected one of {', '.join(BOUNDARIES)}")
    return boundary


@dataclass(frozen=True)
class Springs:
    """A chain of linear springs: ρ ü_i = Σ_q w_q (u_{i+q} − 2 u_i + u_{i−q}), q = 1 … M.

    Parameters
    ----------
    spacing : float
        Δx.
    weights : (M,) array
        w_q: stiffness of the spring to the q-th neighbour, per length of the chain and per length of the spacing (force
        density / displacement).
    density : float
        ρ, mass per length.
    name : str

    Notes
    -----
    `paper` makes the weights of the paper, 2K₁/(M(M+1)) / (q Δx²) (eq. A.2): the springs constants fall as 1/distance
    and the long-wave modulus Σ w_q (qΔx)² is K₁ for every M and Δx. Any other weights are as good a chain
    (`atc.upscaling.coarse`).
    """

    spacing: float
    weights: np.ndarray = field(repr=False)
    density: float = 1.0
    name: str = "springs"

    def __post_init__(self):
        object.__setattr__(self, "spacing", positive("spacing", self.spacing))
        object.__setattr__(self, "density", positive("density", self.density))
        weights = np.array(self.weights, dtype=float)
        if weights.ndim != 1 or not len(weights) or not np.isfinite(weights).all():
            raise AtcError("weights of a chain: expected a list of finite numbers, one for each neighbour distance")
        weights.setflags(write=False)
        object.__setattr__(self, "weights", weights)

    @classmethod
    def paper(
        cls, spacing: float, neighbors: int, modulus: float = 1.0, density: float = 1.0, name: str = "springs"
    ) -> Springs:
        """The paper's springs: K(M)/|qΔx| with K(M) = 2K₁/(M(M+1)) (eqs. 4.1, A.2)."""
        spacing, M = positive("spacing", spacing), whole("neighbors", neighbors)
        q = np.arange(1, M + 1)
        return cls(spacing, 2 * positive("modulus", modulus) / (M * (M + 1)) / (q * spacing**2), density, name)

    @classmethod
    def peridynamics(cls, horizon: float, spacing: float, modulus: float = 1.0, density: float = 1.0) -> Springs:
        """Peridynamics with the micromodulus c/|ε| inside `horizon`, by the paper's quadrature: `horizon` must be a
        multiple of `spacing`."""
        horizon, spacing = positive("horizon", horizon), positive("spacing", spacing)
        M = round(horizon / spacing)
        if M < 1 or abs(M * spacing - horizon) > 1e-9 * horizon:
            raise AtcError(
                f"horizon = {horizon:g}: not a multiple of spacing = {spacing:g}; the paper's quadrature needs one"
            )
        return cls.paper(spacing, M, modulus, density, name="peridynamics")

    @property
    def neighbors(self) -> int:
        return len(self.weights)

    @property
    def horizon(self) -> float:
        return self.neighbors * self.spacing

    def moment(self, p: int) -> float:
        """Σ_q w_q (qΔx)^p. The second one is the modulus, and ρ c² is the modulus."""
        return float((self.weights * (np.arange(1, self.neighbors + 1) * self.spacing) ** p).sum())

    @property
    def modulus(self) -> float:
        return self.moment(2)

    @property
    def sound_speed(self) -> float:
        """√(K/ρ): the speed of long waves."""
        return math.sqrt(max(self.modulus, 0.0) / self.density)

    def frequency_squared(self, k) -> np.ndarray:
        """ω²(k) = (4/ρ) Σ_q w_q sin²(k q Δx/2), any shape of `k`; negative where a chain with negative weights is
        unstable."""
        k = np.asarray(k, dtype=float)
        out = np.zeros(k.shape)
        for q, w in enumerate(self.weights, 1):
            out += w * np.sin(k * (0.5 * q * self.spacing)) ** 2
        return out * (4 / self.density)

    def frequency(self, k) -> np.ndarray:
        """ω(k) ≥ 0. `AtcError` if ω² < 0 somewhere."""
        squared = self.frequency_squared(k)
        size = max(float(np.max(squared, initial=0.0)), self.modulus / self.spacing**2 / self.density)
        return self.roots(squared, size)

    def roots(self, squared, size: float) -> np.ndarray:
        """√ω², or an AtcError where it is negative, by more than rounding of `size`."""
        if (squared < -1e-12 * size).any():
            why = "this chain is unstable (its weights are negative where they must not be)"
            raise AtcError(f"{self.name}: ω² = {squared.min():g} < 0: {why}")
        return np.sqrt(np.maximum(squared, 0.0))

    @cached_property
    def max_frequency(self) -> float:
        """The largest ω over all real k, to 1e-10 relative."""
        from scipy.optimize import minimize_scalar

        k = np.linspace(0, math.pi / self.spacing, 16 * self.neighbors + 2)
        squared = self.frequency_squared(k)
        best, step = int(np.argmax(squared)), k[1]
        how = {"bounds": (k[best] - step, k[best] + step), "method": "bounded", "options": {"xatol": 1e-12}}
        around = minimize_scalar(lambda p: -float(self.frequency_squared(p)), **how)
        return math.sqrt(max(float(squared[best]), -around.fun))

    @property
    def stable_time_step(self) -> float:
        """2/ω_max: velocity Verlet is stable below it, and not at or above it."""
        return 2 / self.max_frequency

    @property
    def sufficient_time_step(self) -> float:
        """The paper's sufficient limit √(ρ / Σ_q w_q) (eq. 4.12: 1 − cos replaced by 2 in every term), 20 to 30 % below
        the true one for many neighbours."""
        return math.sqrt(self.density / float(np.abs(self.weights).sum()))

    def time_step(self, safety: float = 0.85) -> float:
        """The time step of the paper's refinement path (eq. 4.13)."""
        return positive("safety", safety) * self.sufficient_time_step

    def potential_energy(self, u_n, boundary: str = "periodic") -> float:
        """½ Δx Σ_bonds w_q (u_{i+q} − u_i)², an energy (× cross-section)."""
        from ._chain_kernels import springs_energy

        u_n, periodic = np.ascontiguousarray(u_n, dtype=float), check_boundary(boundary) == "periodic"
        return springs_energy(u_n, self.weights, periodic) * self.spacing

    def acceleration(self, u_n, boundary: str = "periodic") -> np.ndarray:
        """ü of all nodes for the displacements `u_n`."""
        from ._chain_kernels import springs_force

        padded, out = _padded(u_n, self.neighbors, boundary)
        springs_force(padded, self.weights / self.density, out)
        return out


# Where the tangent modulus of the chain vanishes under homogeneous stretch F: (F⁻⁷ − F⁻¹³)' = 0 (a minimum at F = 1, so
# σ̄⁶ = ½; it does not depend on M).
LJ_SPINODAL = (13 / 7) ** (1 / 6)


@dataclass(frozen=True)
class LennardJones:
    """A chain of Lennard-Jones bonds at any resolution: ρ ü_i = −24 ε̄ Σ_j [2 (Δx σ̄)¹²/(Z₁₂ r_j¹³) − (Δx σ̄)⁶/(Z₆
    r_j⁷)], r_j = y_{i+j} − y_i (eq. 5.3).

    Z_s = Σ_{j≤M} j⁻ˢ. The stress of a homogeneous stretch F, 24 ε̄ (σ̄⁶ F⁻⁷ − 2 σ̄¹² F⁻¹³), depends on neither M nor
    Δx.

    Parameters
    ----------
    spacing, neighbors : Δx, M
    epsilon, sigma : float
        ε̄ and σ̄ of the paper. It gives no numbers; the defaults make the spacing the equilibrium one, σ̄ = 2^(−1/6),
        and the sound speed one, ε̄ = 1/72.
    density : float

    Notes
    -----
    A chain with σ̄ ≠ 2^(−1/6) is under stress at rest, and is refused: its ends would have to hold it. Under a stretch
    beyond the spinodal (13/7)^(1/6) = 1.1087 the tangent modulus is negative: bonds lose stiffness as they open, the
    chain breaks, no continuum has a unique solution there, and results depend on the resolution.
    """

    spacing: float
    neighbors: int
    epsilon: float = 1 / 72
    sigma: float = 2 ** (-1 / 6)
    density: float = 1.0
    name: str = "Lennard-Jones"

    def __post_init__(self):
        for key in ("spacing", "epsilon", "sigma", "density"):
            object.__setattr__(self, key, positive(key, getattr(self, key)))
        whole("neighbors", self.neighbors)
        if abs(2 * self.sigma**6 - 1) > 1e-9:
            raise AtcError(
                f"sigma = {self.sigma:g}: the spacing is the equilibrium one only for sigma = 2^(-1/6) = "
                f"{2 ** (-1 / 6):.9g}, in units of the spacing; "
                "with another the chain would be under stress at rest"
            )

    @cached_property
    def zeta(self) -> tuple[float, float]:
        """Z_M(12), Z_M(6)."""
        j = np.arange(1, self.neighbors + 1, dtype=float)
        return float((j**-12).sum()), float((j**-6).sum())

    @property
    def horizon(self) -> float:
        return self.neighbors * self.spacing

    @property
    def coefficients(self) -> tuple[float, float]:
        """A, B of the bond's energy density A/r¹² − B/r⁶: 4 ε̄ (Δx σ̄)¹²/Z₁₂, 4 ε̄ (Δx σ̄)⁶/Z₆."""
        z12, z6 = self.zeta
        s = self.spacing * self.sigma
        return 4 * self.epsilon * s**12 / z12, 4 * self.epsilon * s**6 / z6

    @property
    def modulus(self) -> float:
        """Of long waves about the reference: 72 ε̄ with σ̄⁶ = ½."""
        return 24 * self.epsilon * (26 * self.sigma**12 - 7 * self.sigma**6)

    @property
    def sound_speed(self) -> float:
        return math.sqrt(self.modulus / self.density)

    def stress(self, stretch) -> np.ndarray:
        """Stress (tension positive) of a homogeneous stretch F."""
        F = np.asarray(stretch, dtype=float)
        return 24 * self.epsilon * (self.sigma**6 * F**-7 - 2 * self.sigma**12 * F**-13)

    def linearised(self) -> Springs:
        """The springs of small displacements: w_q = the bond's second derivative at its reference length (negative for
        distant neighbours)."""
        A, B = self.coefficients
        r = np.arange(1, self.neighbors + 1) * self.spacing
        return Springs(self.spacing, 156 * A / r**14 - 42 * B / r**8, self.density, f"{self.name}, linearised")

    @property
    def stable_time_step(self) -> float:
        """2/ω_max of small displacements about the reference. Compression stiffens the bonds: stay well below it."""
        return self.linearised().stable_time_step

    def potential_energy(self, u_n, boundary: str = "periodic") -> float:
        """Δx Σ_bonds [A/r¹² − B/r⁶ − the same at rest]: zero in the reference configuration."""
        from ._chain_kernels import lj_energy

        u_n = np.ascontiguousarray(u_n, dtype=float)
        periodic = check_boundary(boundary) == "periodic"
        return lj_energy(u_n, self.spacing, self.neighbors, *self.coefficients, periodic) * self.spacing

    def acceleration(self, u_n, boundary: str = "periodic") -> np.ndarray:
        """ü of all nodes for the displacements `u_n`."""
        from ._chain_kernels import lj_force

        M = self.neighbors
        padded, out = _padded(u_n, M, boundary)
        work = np.empty(len(out) + M)
        lj_force(padded, self.spacing, M, *self.coefficients, 1 / self.density, out, work)
        return out


def need_nodes(n: int, M: int, boundary: str) -> None:
    """Raise AtcError where a chain of n nodes is too short for its range of M."""
    check_boundary(boundary)
    if n < 2 * M + 1:
        raise AtcError(f"a chain of {n} nodes with {M} neighbours on either side: expected at least {2 * M + 1} nodes")


def _padded(u_n, M: int, boundary: str) -> tuple[np.ndarray, np.ndarray]:
    """Displacements with M nodes more on either side, as the kernels take them, and an empty array for forces."""
    from ._chain_kernels import pad

    u_n = np.ascontiguousarray(u_n, dtype=float)
    n = len(u_n)
    need_nodes(n, M, boundary)
    padded = np.zeros(n + 2 * M)
    padded[M : M + n] = u_n
    pad(padded, M, boundary == "periodic")
    return padded, np.empty(n)


# --------------------------------------------------------------------------------------------------------------------
# Initial displacements.


def smoothstep(s, order: int = 10) -> np.ndarray:
    """The polynomial of degree 2·order + 1 that rises from 0 to 1 on [0, 1] with `order` vanishing derivatives at both
    ends; 0 and 1 outside."""
    from scipy.special import betainc

    # S_n(s) is the regularised incomplete beta function I_s(n+1, n+1): no cancelling binomial sum
    return betainc(order + 1, order + 1, np.clip(np.asarray(s, dtype=float), 0.0, 1.0))


def bump(x, center: float = 500.0, half_width: float = 10.0, amplitude: float = 1.0, order: int = 10) -> np.ndarray:
    """The paper's smooth bump: the smoothstep of degree 2·order + 1 on [center − half_width, center], mirrored behind
    it."""
    half_width = positive("half_width", half_width)
    return amplitude * smoothstep(1 - np.abs(np.asarray(x, dtype=float) - center) / half_width, order)


def square_pulse(x, center: float = 500.0, half_width: float = 10.0, amplitude: float = 1.0) -> np.ndarray:
    """`amplitude` within `half_width` of `center`, both ends included (to a rounding error in x), 0 elsewhere (eq.
    4.14)."""
    return np.where(np.abs(np.asarray(x, dtype=float) - center) <= half_width * (1 + 1e-12), float(amplitude), 0.0)
