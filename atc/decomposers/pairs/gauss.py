"""Gaussian wells and hills, and the soft logarithm of a Gaussian."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .coulomb import wanted_pairs
from .input import mix_distance, mix_energy, pair_values
from .loop import pair_law
from .radial import RadialStyle, mix_lj_distances, one_cutoff

_PER_AREA = {"length": -2}


class Gauss(RadialStyle):
    """U = −A e^{−B d²} for d < cutoff (LAMMPS ``gauss``). Numbers: A, B, cutoff; see `RadialStyle`."""

    name = "gauss"
    numbers = (("A", "energy"), ("B", _PER_AREA), ("cutoff", "length"))

    @pair_law
    def law(d2, A, B):
        u = -A * np.exp(-B * d2)
        return u, -2.0 * B * u


class BornGauss(RadialStyle):
    """U = A₀ e^{−αd} − A₁ e^{−β(d − r₀)²} − offset (LAMMPS ``born/gauss``). Numbers: A0, alpha, A1, beta, r0, cutoff;
    see `RadialStyle`."""

    name = "born/gauss"
    numbers = (
        ("A0", "energy"), ("alpha", {"length": -1}), ("A1", "energy"), ("beta", _PER_AREA), ("r0", "length"),
        ("cutoff", "length"),
    )  # fmt: skip

    @pair_law
    def law(d2, A0, alpha, A1, beta, r0):
        d = np.sqrt(d2)
        t = d - r0
        e = A0 * np.exp(-alpha * d) if A0 != 0.0 else 0.0
        g = A1 * np.exp(-beta * t * t)
        return e - g, -(e * alpha - 2.0 * beta * t * g) / d


class GaussCut(BornGauss):
    """U = H/(σ_h √(2π)) e^{−(d − r_mh)²/(2σ_h²)} − offset (LAMMPS ``gauss/cut``). Numbers: H, r_mh, sigma_h, cutoff;
    see `RadialStyle`."""

    name = "gauss/cut"
    numbers = (("H", {"energy": 1, "length": 1}), ("r_mh", "length"), ("sigma_h", "length"), ("cutoff", "length"))

    def columns(self, H, r_mh, sigma_h, cutoff):
        return np.zeros_like(H), np.zeros_like(H), -H / (np.sqrt(2 * np.pi) * sigma_h), 0.5 / sigma_h**2, r_mh


class UhlenbeckFord(RadialStyle):
    """U = −ε ln[1 − e^{−(d/σ)²}] − offset (LAMMPS ``ufm``). Numbers: epsilon, sigma, cutoff; see `RadialStyle`."""

    name = "ufm"
    numbers = (("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length"))

    def columns(self, epsilon, sigma, cutoff):
        return epsilon, sigma**-2.0

    @pair_law
    def law(d2, epsilon, per_area):
        x = np.exp(-d2 * per_area)
        return -(epsilon * np.log(1.0 - x)), -2.0 * epsilon * per_area * x / (1.0 - x)


def _mix_gauss(a, b, rule):
    """A like an energy, its sign apart; 1/√B like a distance."""
    s_a, s_b = a[1] ** -0.5, b[1] ** -0.5
    sign = min(np.sign(a[0]), np.sign(b[0]))
    return (
        sign * mix_energy(abs(a[0]), abs(b[0]), s_a, s_b, rule),
        mix_distance(s_a, s_b, rule) ** -2.0,
        mix_distance(a[2], b[2], rule),
    )


def _mix_gauss_cut(a, b, rule):
    # A hill if one of them is one.
    sign = max(np.sign(a[0]), np.sign(b[0]))
    return (
        sign * mix_energy(abs(a[0]), abs(b[0]), a[2], b[2], rule),
        *(mix_distance(x, y, rule) for x, y in zip(a[1:], b[1:], strict=True)),
    )


one_cutoff(Gauss, mix=_mix_gauss)
one_cutoff(GaussCut, mix=_mix_gauss_cut, check=lambda *v: None if v[2] > 0 else "sigma_h must be positive")


@pair_style("born/gauss")
def _born_gauss_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [BornGauss.numbers[-1]])
    *numbers, cutoff = pair_values(inp, BornGauss.numbers, optional=1, defaults=[rc])
    on = wanted_pairs(inp)
    if (cutoff[on] != rc).any():
        # LAMMPS (22 Jul 2025) reads them and goes on with the global one; measured, not documented.
        inp.note(
            "pair_style born/gauss: cutoffs on pair_coeff lines are without effect, as in LAMMPS: the one of the "
            "pair_style line holds"
        )
    return BornGauss.internal(*numbers, np.where(on, rc, 0.0), shift=inp.modify.shift)


one_cutoff(UhlenbeckFord, mix=mix_lj_distances, check=lambda *v: None if v[1] > 0 else "sigma must be positive")
