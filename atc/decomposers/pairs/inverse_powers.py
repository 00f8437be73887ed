"""Two inverse powers of the distance: Mie, n-m, Lennard-Jones 9-6, the 9-6 of class2 force fields, and the three forms
of SPICA."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .input import fill
from .loop import pair_law
from .radial import RadialStyle, mix_lj6, mix_lj_distances, one_cutoff

_PLAIN = "dimensionless"
_LJ = (("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length"))


class _Powers(RadialStyle):
    """U = a x^n − c x^m − offset, x = σ/d. Columns: σ, a, n, c, m."""

    @pair_law
    def law(d2, sigma, a, n, c, m):
        x = np.log(sigma / np.sqrt(d2))
        r = a * np.exp(n * x)
        s = c * np.exp(m * x)
        return r - s, -(n * r - m * s) / d2

    @pair_law
    def whole_law(d2, sigma, a, n, c, m):
        x = sigma / np.sqrt(d2)
        n, m = int(n), int(m)
        r = a * x**n
        s = c * x**m
        return r - s, -(n * r - m * s) / d2

    def chosen_law(self):
        # No powers of real numbers where whole ones do.
        whole = (self.table[..., 3] % 1 == 0).all() and (self.table[..., 5] % 1 == 0).all()
        return self.whole_law if whole else self.law


class Mie(_Powers):
    """U = C ε [(σ/d)^γr − (σ/d)^γa] − offset, C = γr/(γr − γa) (γr/γa)^{γa/(γr − γa)} (LAMMPS ``mie/cut``).

    Numbers: epsilon, sigma, gamma_rep, gamma_att, cutoff; see `RadialStyle`.
    """

    name = "mie/cut"
    numbers = (*_LJ[:2], ("gamma_rep", _PLAIN), ("gamma_att", _PLAIN), _LJ[2])

    def columns(self, epsilon, sigma, n, m, cutoff):
        a = epsilon * n / (n - m) * (n / m) ** (m / (n - m))
        return sigma, a, n, a, m


class NM(_Powers):
    """U = E₀/(n − m) [m (r₀/d)^n − n (r₀/d)^m] − offset (LAMMPS ``nm/cut``).

    Numbers: E0, r0, n, m, cutoff; see `RadialStyle`.
    """

    name = "nm/cut"
    numbers = (("E0", "energy"), ("r0", "length"), ("n", _PLAIN), ("m", _PLAIN), ("cutoff", "length"))

    def columns(self, E0, r0, n, m, cutoff):
        return r0, E0 * m / (n - m), n, E0 * n / (n - m), m


class LennardJones96(_Powers):
    """U = 4ε[(σ/d)⁹ − (σ/d)⁶] − offset (LAMMPS ``lj96/cut``). Numbers: epsilon, sigma, cutoff; see `RadialStyle`."""

    name = "lj96/cut"
    numbers = _LJ

    def columns(self, epsilon, sigma, cutoff):
        return sigma, 4 * epsilon, np.full_like(sigma, 9), 4 * epsilon, np.full_like(sigma, 6)


class Class2(_Powers):
    """U = ε[2 (σ/d)⁹ − 3 (σ/d)⁶] − offset, the minimum at σ (LAMMPS ``lj/class2``). Numbers: epsilon, sigma, cutoff;
    see `RadialStyle`."""

    name = "lj/class2"
    numbers = _LJ

    def columns(self, epsilon, sigma, cutoff):
        return sigma, 2 * epsilon, np.full_like(sigma, 9), 3 * epsilon, np.full_like(sigma, 6)


#: form: (n, m, prefactor that puts the minimum at −ε)
SPICA_FORMS = {
    "lj9_6": (9, 6, 27 / 4),
    "lj12_4": (12, 4, 1.5 * np.sqrt(3.0)),
    "lj12_6": (12, 6, 4.0),
    "lj12_5": (12, 5, 12 / 7 * 2.4 ** (5 / 7)),
}


class Spica(_Powers):
    """U = C ε[(σ/d)^n − (σ/d)^m] − offset with (n, m) 9-6, 12-4, 12-6 or 12-5 by pair of types (LAMMPS ``lj/spica``,
    ``lj/sdk``).

    Numbers: n, m, prefactor C, epsilon, sigma, cutoff; see `RadialStyle`.
    """

    name = "lj/spica"
    numbers = (("n", _PLAIN), ("m", _PLAIN), ("C", _PLAIN), *_LJ)

    def columns(self, n, m, C, epsilon, sigma, cutoff):
        return sigma, C * epsilon, n, C * epsilon, m


def _exponents(*numbers):
    n, m = numbers[2], numbers[3]
    return None if n > 0 and m > 0 and n != m else "the two exponents must be positive and different"


one_cutoff(Mie, mix=mix_lj_distances, check=_exponents)
one_cutoff(NM, check=_exponents)
one_cutoff(LennardJones96, mix=mix_lj_distances)
one_cutoff(Class2, mix=mix_lj6)


@pair_style("lj/spica", "lj/sdk")
def _spica_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])

    def read(line):
        form = line.words[0] if line.words else "nothing"
        if form not in SPICA_FORMS:
            raise inp.error(
                f"pair_coeff of {inp.name} takes one of {', '.join(SPICA_FORMS)} and epsilon sigma [cutoff], "
                f"got {form}",
                line,
            )
        e, s, cut = inp.numbers(line.words[1:], _LJ, line, optional=1)
        return (*SPICA_FORMS[form], e, s, rc if cut is None else cut)

    return Spica.internal(*fill(inp, inp.by_pair(read), 6), shift=inp.modify.shift)
