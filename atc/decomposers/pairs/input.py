"""From ``pair_coeff`` lines to one number for every pair of types: ranges, later lines over earlier ones, LAMMPS's
mixing."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput

MIX_RULES = ("geometric", "arithmetic", "sixthpower")


def mix_energy(e_i, e_j, s_i, s_j, how: str) -> float:
    """ε of unlike types (LAMMPS Pair::mix_energy)."""
    if how == "sixthpower":
        s_i, s_j = np.float64(s_i), np.float64(s_j)
        return 2.0 * np.sqrt(e_i * e_j) * s_i**3 * s_j**3 / (s_i**6 + s_j**6)
    return float(np.sqrt(e_i * e_j))


def mix_distance(s_i, s_j, how: str) -> float:
    """σ or a cutoff of unlike types (LAMMPS Pair::mix_distance)."""
    if how == "geometric":
        return float(np.sqrt(s_i * s_j))
    if how == "arithmetic":
        return 0.5 * (s_i + s_j)
    return float((0.5 * (s_i**6 + s_j**6)) ** (1.0 / 6.0))


def pair_values(inp: StyleInput, wants, *, optional: int = 0, defaults=(), mix=None) -> list[np.ndarray]:
    """Symmetric (n_types + 1, n_types + 1) arrays, one for each of `wants` = [(what, dimension), ...], internal units.

    Parameters
    ----------
    optional : how many of the last numbers a line may leave out; `defaults` are their values
    mix : function (numbers of i, numbers of j, rule) → numbers, for pairs without a line of their own; None: such pairs
        are an error

    Pairs that are not wanted hold zeros. The last array is always the cutoff, by this project's convention, so that 0
    there means no interaction.
    """
    k = len(wants) - optional

    def read(line):
        values = inp.numbers(line.words, wants, line, optional)
        return (*values[:k], *(d if v is None else v for v, d in zip(values[k:], defaults, strict=True)))

    return fill(inp, inp.by_pair(read), len(wants), mix)


def one_cutoff_each(inp: StyleInput, cutoff: float, own: bool = True) -> np.ndarray:
    """(n + 1, n + 1) cutoffs of a style whose lines say nothing but, if they may say their `own`, the cutoff."""
    mix = lambda a, b, rule: (mix_distance(a[0], b[0], rule) if own else cutoff,)  # noqa: E731
    for line in inp.coeffs if not own else ():
        inp.numbers(line.words, [], line)
    return pair_values(inp, [("cutoff", "length")], optional=1, defaults=[cutoff], mix=mix)[0]


def fill(inp: StyleInput, given: dict, width: int, mix=None) -> list[np.ndarray]:
    """The arrays of `pair_values` from {(i, j): numbers}, i ≤ j, with mixing."""
    n = inp.n_types
    out = np.zeros((width, n + 1, n + 1))
    rule = inp.modify.mix or "geometric"
    for i in range(1, n + 1):
        for j in range(i, n + 1):
            if inp.wanted is not None and not inp.wanted[i, j]:
                continue
            values = given.get((i, j))
            if values is None and mix is not None and (i, i) in given and (j, j) in given:
                with np.errstate(invalid="ignore", divide="ignore"):
                    values = mix(given[i, i], given[j, j], rule)
                if not np.isfinite(values).all():
                    raise inp.error(
                        f"{inp.command}: the coefficients of types {i} and {j} have no {rule} mean (negative or "
                        f"zero); add 'pair_coeff {i} {j} ...'"
                    )
            if values is None:
                how = f", and types {i} and {j} cannot be mixed since one of them has none with itself"
                how = "" if i == j else how if mix else f", and {inp.name} does not mix"
                raise inp.error(
                    f"{inp.command}: no pair_coeff for types {i} and {j}{how}; add 'pair_coeff {i} {j} ...'"
                )
            out[:, i, j] = out[:, j, i] = values
    return list(out)


def named(inp: StyleInput) -> np.ndarray:
    """(n + 1, n + 1): 1 for the pairs of types that coefficient lines without numbers name: all, as soon as each type
    is named with itself."""
    given = inp.by_pair(lambda line: (*inp.numbers(line.words, [], line), 1.0))
    return fill(inp, given, 1, mix=lambda a, b, rule: (1.0,))[0]


def as_matrix(value, n_types: int, factor: float = 1.0) -> np.ndarray:
    """A number, or an (n, n) array for types 1..n, as an (n_types + 1, n_types + 1) table in internal units."""
    a = np.asarray(value, float) * factor
    out = np.zeros((n_types + 1, n_types + 1))
    if a.ndim == 0:
        out[1:, 1:] = a
    else:
        out[1:, 1:] = a
        if not np.array_equal(a, a.T):
            from ...errors import AtcError

            raise AtcError(
                "pair coefficients given as a matrix must be symmetric: the value for types (i, j) is that for (j, i)"
            )
    return out
