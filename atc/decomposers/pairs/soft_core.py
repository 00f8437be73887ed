"""Soft cores for free energies: interactions that fade with an activation λ and stay finite where atoms overlap."""

from __future__ import annotations

import numpy as np

from .input import mix_distance
from .loop import pair_law
from .morse import Morse
from .radial import ChargedStyle, RadialStyle, mix_lj6, mix_lj_distances, one_cutoff

_PLAIN = "dimensionless"
_LJ = (
    ("epsilon", "energy"), ("sigma", "length"), ("activation", _PLAIN), ("n", _PLAIN), ("alpha", _PLAIN),
    ("cutoff", "length"),
)  # fmt: skip


class LennardJonesSoft(RadialStyle):
    """U = λⁿ 4ε(1/D² − 1/D) − offset, D = α(1 − λ)² + (d/σ)⁶ (LAMMPS ``lj/cut/soft``; Beutler et al., Chem. Phys. Lett.
    222, 529).

    Numbers: epsilon, sigma, activation λ, n, alpha, cutoff; see `RadialStyle`.
    """

    name = "lj/cut/soft"
    numbers = _LJ
    power = 2.0
    factors = (4.0, 4.0)

    def columns(self, epsilon, sigma, activation, n, alpha, cutoff):
        e = activation**n * epsilon
        a, c = self.factors
        return a * e, c * e, alpha * (1 - activation) ** 2, sigma**-6.0, np.full_like(e, self.power)

    @pair_law
    def law(d2, a, c, core, per_sigma6, power):
        s = 1.0 / (core + d2 * d2 * d2 * per_sigma6)
        r = a * s * (s if power == 2.0 else np.sqrt(s))
        t = c * s
        return r - t, -(power * r - t) * s * 6.0 * d2 * d2 * per_sigma6


class Class2Soft(LennardJonesSoft):
    """U = λⁿ ε(2/D^{3/2} − 3/D) − offset, D = α(1 − λ)² + (d/σ)⁶ (LAMMPS ``lj/class2/soft``). Numbers as for
    `LennardJonesSoft`."""

    name = "lj/class2/soft"
    power = 1.5
    factors = (2.0, 3.0)


class CoulombSoft(ChargedStyle):
    """U = λⁿ C q_i q_j/√(α(1 − λ)² + d²) for d < cutoff (LAMMPS ``coul/cut/soft``).

    Numbers: activation λ, n, alpha (length²), cutoff; see `ChargedStyle`.
    """

    name = "coul/cut/soft"
    numbers = (("activation", _PLAIN), ("n", _PLAIN), ("alpha", {"length": 2}), ("cutoff", "length"))

    def columns(self, activation, n, alpha, cutoff):
        return activation**n, alpha * (1 - activation) ** 2

    @pair_law
    def law(d2, c, fade, core):
        s2 = 1.0 / (core + d2)
        u = fade * c * np.sqrt(s2)
        return u, -u * s2


class MorseSoft(RadialStyle):
    """Morse with a soft core: U = f {u(d) + s B e^{−3α(d − r₀)}}, u that of `Morse`, B = −⅔ D₀ e^{−2αr₀}(e^{αr₀} − 1)
    (LAMMPS ``morse/soft``).

    s = (1 − λ)/(1 − λ_f) and f = 1 for λ ≥ λ_f; s = 1 and f = (λ/λ_f)ⁿ below. LAMMPS does not shift it.
    Numbers: d0, alpha, r0, activation λ, n, threshold λ_f, cutoff; see `RadialStyle`.
    """

    name = "morse/soft"
    numbers = (*Morse.numbers[:3], ("activation", _PLAIN), ("n", _PLAIN), ("threshold", _PLAIN), Morse.numbers[3])
    shifts = False

    def columns(self, d0, alpha, r0, activation, n, threshold, cutoff):
        e = np.exp(alpha * r0)
        B = -2 * d0 * e**-2 * (e - 1) / 3
        above = activation >= threshold
        s = np.where(above, (1 - activation) / (1 - threshold), 1.0)
        fade = np.where(above, 1.0, (activation / threshold) ** n)
        return fade * d0, alpha, r0, fade * s * B

    @pair_law
    def law(d2, d0, alpha, r0, B):
        d = np.sqrt(d2)
        x = np.exp(-alpha * (d - r0))
        return d0 * (x * x - 2.0 * x) + B * x * x * x, -alpha * (2.0 * d0 * (x * x - x) + 3.0 * B * x * x * x) / d


def _same_activation(mix):
    """Mixing of (epsilon, sigma, λ, cutoffs): LAMMPS mixes only types with one λ."""

    def mixed(a, b, rule):
        if a[2] != b[2]:
            return (np.nan,) * len(a)
        e, s, *cutoffs = mix((*a[:2], *a[3:]), (*b[:2], *b[3:]), rule)
        return (e, s, a[2], *cutoffs)

    return mixed


mix_soft = _same_activation(mix_lj_distances)
mix_soft6 = _same_activation(mix_lj6)


def _mix_fading(a, b, rule):
    """(λ, cutoff): LAMMPS mixes only types with one λ."""
    return (a[0] if a[0] == b[0] else np.nan, mix_distance(a[1], b[1], rule))


one_cutoff(LennardJonesSoft, mix=mix_soft, line=("n", "alpha", "cutoff"))
one_cutoff(Class2Soft, mix=mix_soft6, line=("n", "alpha", "cutoff"))
one_cutoff(CoulombSoft, mix=_mix_fading, line=("n", "alpha", "cutoff"))
one_cutoff(MorseSoft, line=("n", "threshold", "cutoff"))
