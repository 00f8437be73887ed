"""Potentials that end at their cutoff by themselves: Wang-Frenkel, the squared cosine, the harmonic repulsion, and the
conservative force of DPD."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .input import fill, pair_values
from .loop import pair_law
from .radial import RadialStyle, mix_lj_distances, one_cutoff

_PLAIN = "dimensionless"
#: Closer than this LAMMPS counts no energy of a DPD pair.
_COINCIDENT = 1e-10


class WangFrenkel(RadialStyle):
    """U = ε α [(σ/d)^{2μ} − 1][(r_c/d)^{2μ} − 1]^{2ν}, with α such that the minimum is −ε (LAMMPS ``wf/cut``; Wang et
    al., PCCP 22, 10624).

    Numbers: epsilon, sigma, nu, mu (whole numbers), cutoff; see `RadialStyle`.
    """

    name = "wf/cut"
    numbers = (("epsilon", "energy"), ("sigma", "length"), ("nu", _PLAIN), ("mu", _PLAIN), ("cutoff", "length"))

    def columns(self, epsilon, sigma, nu, mu, cutoff):
        x = (cutoff / sigma) ** (2 * mu)
        alpha = 2 * nu * x * ((1 + 2 * nu) / (2 * nu * (x - 1))) ** (2 * nu + 1)
        return epsilon * alpha, sigma**2, cutoff**2, mu, 2 * nu

    @pair_law
    def law(d2, k, sigma2, cut2, mu, nu2):
        mu, nu2 = int(mu), int(nu2)
        s = 1.0 / d2
        x = (sigma2 * s) ** mu
        y = (cut2 * s) ** mu
        z = (y - 1.0) ** (nu2 - 1)
        return k * (x - 1.0) * z * (y - 1.0), -2.0 * mu * k * z * (x * (y - 1.0) + nu2 * y * (x - 1.0)) * s


class CosineSquared(RadialStyle):
    """U = −ε for d < σ and −ε cos²[π(d − σ)/(2(r_c − σ))] up to the cutoff r_c (LAMMPS ``cosine/squared``).

    With wca = 1, the Weeks-Chandler-Andersen repulsion ε[(σ/d)¹² − 2(σ/d)⁶ + 1] is added for d < σ, and r_c = σ leaves
    that alone. Numbers: epsilon, sigma, wca (0 or 1), cutoff; see `RadialStyle`.
    """

    name = "cosine/squared"
    numbers = (("epsilon", "energy"), ("sigma", "length"), ("wca", _PLAIN), ("cutoff", "length"))
    shifts = False

    def columns(self, epsilon, sigma, wca, cutoff):
        attracts = cutoff > sigma
        return (
            np.where(attracts, epsilon, 0.0),
            sigma,
            np.where(attracts, np.pi / (2 * (cutoff - sigma)), 0.0),
            wca * epsilon,
        )

    @pair_law
    def law(d2, epsilon, sigma, k, wca):
        if d2 < sigma * sigma:
            if wca == 0.0:
                return -epsilon, 0.0
            s2 = sigma * sigma / d2
            s6 = s2 * s2 * s2
            return wca * (s6 * s6 - 2.0 * s6 + 1.0) - epsilon, -12.0 * wca * (s6 * s6 - s6) / d2
        d = np.sqrt(d2)
        c = np.cos(k * (d - sigma))
        return -epsilon * c * c, epsilon * k * np.sin(2.0 * k * (d - sigma)) / d


class HarmonicCut(RadialStyle):
    """U = k (r_c − d)² for d < r_c (LAMMPS ``harmonic/cut``). Numbers: k, cutoff; see `RadialStyle`."""

    name = "harmonic/cut"
    numbers = (("k", {"energy": 1, "length": -2}), ("cutoff", "length"))
    shifts = False

    def columns(self, k, cutoff):
        return k, cutoff

    @pair_law
    def law(d2, k, cutoff):
        d = np.sqrt(d2)
        t = cutoff - d
        # Coincident atoms feel no force: the direction is undefined.
        return k * t * t, -2.0 * k * t / d if d > 0.0 else 0.0


class DPD(HarmonicCut):
    """U = ½ A r_c (1 − d/r_c)² for d < r_c: the conservative force of dissipative particle dynamics (LAMMPS ``dpd``,
    ``dpd/ext``).

    Numbers: A, cutoff; see `RadialStyle`.
    """

    name = "dpd"
    numbers = (("A", {"energy": 1, "length": -1}), ("cutoff", "length"))
    shifts = False

    def columns(self, A, cutoff):
        return 0.5 * A / cutoff, cutoff

    @pair_law
    def law(d2, k, cutoff):
        d = np.sqrt(d2)
        t = cutoff - d
        # Coincident atoms feel no force, and LAMMPS counts no energy of theirs.
        return k * t * t if d >= _COINCIDENT else 0.0, -2.0 * k * t / d if d > 0.0 else 0.0


def _whole(*numbers):
    _, sigma, nu, mu, cutoff = numbers
    if not (nu % 1 == 0 and mu % 1 == 0 and nu > 0 and mu > 0):
        return "nu and mu must be whole numbers from 1"
    return None


one_cutoff(WangFrenkel, check=_whole)


@pair_style("cosine/squared")
def _cosine_squared_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])

    def read(line):
        wca = line.words[-1:] == ("wca",)
        words = line.words[:-1] if wca else line.words
        e, s, cut = inp.numbers(words, [CosineSquared.numbers[k] for k in (0, 1, 3)], line, optional=1)
        cut = rc if cut is None else cut
        if cut < s or (cut == s and not wca):
            raise inp.wrong(f"{inp.command}: the cutoff must be larger than sigma (or equal with wca)", line)
        return e, s, float(wca), cut

    return CosineSquared.internal(*fill(inp, inp.by_pair(read), 4))


@pair_style("harmonic/cut")
def _harmonic_cut_style(inp: StyleInput):
    inp.numbers(inp.args, [])
    return HarmonicCut.internal(*pair_values(inp, HarmonicCut.numbers, mix=mix_lj_distances))


# Style: numbers in front of the cutoff on the pair_style line, and numbers of a pair_coeff line in front of its cutoff;
# A where there is one.
_DPD = {
    "dpd": (1, ("A", "gamma")),
    "dpd/ext": (1, ("A", "gamma", "gamma_perpendicular", "s", "s_perpendicular")),
    "dpd/tstat": (2, ("gamma",)),
    "dpd/ext/tstat": (2, ("gamma", "gamma_perpendicular", "s", "s_perpendicular")),
    "dpd/fdt": (1, ("A", "sigma")),
    "dpd/fdt/energy": (0, ("A", "sigma", "kappa")),
}


@pair_style(*_DPD)
def _dpd_style(inp: StyleInput):
    temperatures, names = _DPD[inp.name]
    wants = [("temperature", _PLAIN)] * temperatures + [("cutoff", "length"), ("seed", _PLAIN)]
    rc = inp.numbers(inp.args, wants)[-2]
    inp.note(
        f"pair_style {inp.name}: friction and noise are a thermostat's, no functions of positions: they are not in "
        "forces and stress"
    )
    numbers = [(n, {"energy": 1, "length": -1} if n == "A" else _PLAIN) for n in names] + [("cutoff", "length")]
    arrays = pair_values(inp, numbers, optional=1, defaults=[rc])
    return DPD.internal(arrays[0], arrays[-1]) if "A" in names else []
