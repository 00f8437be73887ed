"""A pair interaction given as two functions of the distance."""

from __future__ import annotations

import re

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import units as get_units
from .pairs import PairStyle


class Generic(PairStyle):
    """U(d) for d < cutoff from the user's own functions.

    Parameters
    ----------
    energy, derivative : functions of one float, the distance, giving U and dU/dd. Plain functions are compiled with
        numba (so they may only
        use what numba understands: arithmetic, ``math``, numpy scalars functions); already compiled ones are taken as
        they are.
    cutoff : float
    units : unit style of the functions' argument and values
    types : iterable of pairs (i, j) of types that it acts on; default all pairs of `n_types` types
    n_types : default 1, or the largest in `types`
    name : what to call it in the output

    Raises
    ------
    AtcError if the functions cannot be compiled, are not finite just inside the cutoff, or the derivative is not that
    of the energy there.
    """

    _kernel = None  # compiled when first used

    def __init__(
        self, energy, derivative, cutoff, *, units, types=None, n_types: int | None = None, name: str = "generic"
    ):
        u = get_units(units)
        if not (np.isfinite(cutoff) and cutoff > 0):
            raise AtcError(f"Generic: the cutoff must be a positive number, got {cutoff}")
        self.units, self.name = u, name
        pairs = None if types is None else [tuple(p) for p in types]
        n = n_types or (1 if pairs is None else max(max(p) for p in pairs))
        cut = np.zeros((n + 1, n + 1))
        if pairs is None:
            cut[1:, 1:] = u.to_internal("length", cutoff)
        else:
            for i, j in pairs:
                cut[i, j] = cut[j, i] = u.to_internal("length", cutoff)
        self._set(cut)
        f, g = (h if hasattr(h, "py_func") else njit(nogil=True, error_model="numpy")(h) for h in (energy, derivative))
        self._functions = (f, g)
        self._check(f, g, cutoff)

    def _check(self, f, g, cutoff):
        try:
            d = np.array([0.75, 0.9, 0.99]) * cutoff
            h = 1e-5 * cutoff
            slope = np.array([(f(x + h) - f(x - h)) / (2 * h) for x in d])
            given = np.array([g(x) for x in d])
        except Exception as e:
            raise AtcError(f"Generic: the functions cannot be evaluated or compiled: {_reason(e)}") from None
        # A central difference with h = 1e-5 of the cutoff is good to about 1e-10 of U/cutoff by truncation and
        # rounding; 1e-4 finds wrong formulas.
        scale = np.abs(slope).max() + np.abs(given).max() + np.array([abs(f(x)) for x in d]).max() / cutoff
        if not np.isfinite(scale) or (np.abs(slope - given) > 1e-4 * scale).any():
            raise AtcError(
                f"Generic: the derivative is not that of the energy: at distance {d[0]:.6g} it says {given[0]:.6g}, "
                f"differences say {slope[0]:.6g}"
            )

    def add(self, types, i, j, d2, weights, U, G, prepared):
        if self._kernel is None:
            self._kernel = _kernel(*self._functions)
        self._kernel(types, i, j, d2, weights, self.table, self.units.length, self.units.energy, U, G)

    def __getstate__(self):
        return {k: v for k, v in self.__dict__.items() if k != "_kernel"}


def _reason(e: Exception) -> str:
    """The telling line of a numba error (its first lines only name the compiler's stage)."""
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line).strip() for line in str(e).splitlines()]
    lines = [line for line in lines if line and not line.startswith(("Failed in", "File ", "During", "def ", "<"))]
    return lines[0] if lines else type(e).__name__


def _kernel(f, g):
    @njit(nogil=True, error_model="numpy")
    def run(types, i, j, d2, weights, table, length, energy, U, G):
        weighted = len(weights) > 0
        for b in range(len(d2)):
            if d2[b] < table[types[i[b]], types[j[b]], 0]:
                w = weights[b] if weighted else 1.0
                d = np.sqrt(d2[b])
                U[b] += w * energy * f(d / length)
                G[b] += w * energy / length * g(d / length) / d

    return run
