"""Exchange between magnetic spins: at given spins a function of the distance, so that its forces are central."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import units as get_units
from ..atom_columns import SPIN, atom_columns
from ..registry import StyleInput, pair_style
from .input import fill
from .pairs import PairStyle

_J = (("a", "energy"), ("b", {}), ("d", "length"))
#: How far from 1 the length of a spin may be: the digits of a dump.
_UNIT = 1e-3


class SpinExchange(PairStyle):
    """U = −J(r) (s_i·s_j − o) − K(r) ((s_i·s_j)² − o) for r < cutoff, J and K of the form 4a x (1 − b x) e^{−x}, x =
    (r/d)² (LAMMPS ``spin/exchange`` with K = 0, ``spin/exchange/biquadratic``; Tranchida et al., J. Comput. Phys. 372
    (2018) 406).

    s are the unit vectors of the atoms' spins, columns spx spy spz of the frames. They have equations of motion of
    their own; the forces on atoms are those at given spins, as in LAMMPS.

    Parameters
    ----------
    a, b, d, a2, b2, d2, cutoff : floats, or symmetric (n, n) arrays for types 1..n; a, a2 in units of energy; cutoff 0
        = no interaction
    offset : whether o = 1, so that aligned spins have neither energy nor force; else 0
    units : unit style of these numbers
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "spin/exchange"
    weight = None
    magnetic = True
    numbers = (*_J, *((n + "2", u) for n, u in _J), ("offset", {}), ("cutoff", "length"))

    def __init__(
        self, a, b, d, cutoff, *, a2=0.0, b2=0.0, d2=1.0, offset: bool = False, units, n_types: int | None = None
    ):
        get_units(units)
        self._take((a, b, d, a2, b2, d2, float(offset), cutoff), units, n_types, False)

    def fill(self, a, b, d, a2, b2, d2, offset, cutoff, shift=False):
        with np.errstate(all="ignore"):
            self._set(cutoff, a, b, 1.0 / d**2, a2, b2, 1.0 / d2**2, offset)

    def prepare(self, frame):
        s_nc = atom_columns(frame, SPIN, "a pair style of spins")
        size = np.linalg.norm(s_nc, axis=1)
        off = (np.abs(size - 1.0) > _UNIT) & (size != 0.0)
        if off.any():
            raise AtcError(
                f"{frame.source}: the spin of atom {frame.ids[off][0]} has the length {size[off][0]:.4g}: expected the "
                "unit vector spx spy spz of compute property/atom (its size is the column sp)"
            )
        return s_nc

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _spin_exchange(types, i, j, d2, self.table, prepared, U, G)


@pair_style("spin/exchange", "spin/exchange/biquadratic")
def _exchange(inp: StyleInput):
    word = inp.name.rpartition("/")[2]
    wants = _J if word == "exchange" else SpinExchange.numbers[:6]
    inp.numbers(inp.args, [("cutoff", "length")])
    offset = 0.0

    def read(line):
        nonlocal offset
        words = list(line.words)
        if len(words) > 2 and words[-2] == "offset":
            if words[-1] not in ("yes", "on", "true", "no", "off", "false"):
                raise inp.error(f"{inp.command}: offset: expected yes or no, got {words[-1]}", line)
            # LAMMPS keeps one for all types: the one that is said last.
            offset = float(words[-1] in ("yes", "on", "true"))
            words = words[:-2]
        if words[:1] != [word]:
            raise inp.error(
                f"pair_coeff of {inp.name}: expected the word {word}, got {words[0] if words else 'nothing'}", line
            )
        cutoff, *values = inp.numbers(words[1:], [("cutoff", "length"), *wants], line)
        if not all(d > 0 for d in values[2::3]):
            raise inp.error(f"{inp.command}: d must be positive, got {' '.join(words[1:])}", line)
        values = values if len(values) == 6 else [*values, 0.0, 0.0, 1.0]
        return (*values, cutoff)

    given = {pair: (*values[:-1], offset, values[-1]) for pair, values in inp.by_pair(read).items()}
    style = SpinExchange.internal(*fill(inp, given, len(SpinExchange.numbers)))
    style.name = inp.name
    inp.note("forces of spins are those at the spins that the frames show")
    return style


@njit(cache=True, nogil=True, error_model="numpy")
def _f(x, a, b):
    """4a x (1 − b x) e^{−x} and its derivative."""
    e = 4.0 * a * np.exp(-x)
    return e * x * (1.0 - b * x), e * (1.0 - 2.0 * b * x - x * (1.0 - b * x))


@njit(cache=True, nogil=True, error_model="numpy")
def _spin_exchange(types, i, j, d2, table, s, U, G):
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            k, m = i[b], j[b]
            dot = s[k, 0] * s[m, 0] + s[k, 1] * s[m, 1] + s[k, 2] * s[m, 2]
            J, dJ = _f(d2[b] * p[3], p[1], p[2])
            K, dK = _f(d2[b] * p[6], p[4], p[5])
            lin, quad = dot - p[7], dot * dot - p[7]
            U[b] -= J * lin + K * quad
            # dx/dr = 2 r/d²
            G[b] -= 2.0 * (dJ * p[3] * lin + dK * p[6] * quad)
