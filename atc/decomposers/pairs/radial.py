"""Pair styles that are one formula of the distance: what their classes and their LAMMPS builders share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...errors import AtcError
from ...units import units as get_units
from ..registry import StyleInput, factor, pair_style
from .input import fill, mix_distance, mix_energy, pair_values
from .loop import charged_loop, one_type_loop, pair_loop
from .pairs import ONES, PairStyle

CUTOFF, COULOMB_CUTOFF = ("cutoff", "length"), ("Coulomb cutoff", "length")


class LawStyle(PairStyle):
    """A style whose numbers make the coefficients of a `law` that is compiled into a loop over pairs."""

    #: the ``@pair_law`` function of d² and the coefficients
    law: Callable

    def columns(self, *numbers) -> tuple:
        """The law's coefficients from arrays of `numbers`, internal units. Entries of pairs without interaction do not
        matter."""
        return numbers[:-1]

    def in_order(self, values, named) -> list:
        """The numbers given by place and by name, in the order of `numbers`."""
        names = [name for name, _ in self.numbers]
        given = dict(zip(names, values, strict=False)) | named
        if len(values) > len(names) or sorted(given) != sorted(names):
            raise AtcError(
                f"{type(self).__name__} takes {', '.join(names)}; got "
                f"{', '.join(map(str, [*values, *named])) or 'nothing'}"
            )
        return [given[name] for name in names]


class RadialStyle(LawStyle):
    """A formula U(d) of a few numbers for each pair of types.

    Subclasses say which numbers (`numbers`, the cutoff last) and what the `law` is; it is compiled into the one loop
    over pairs (`pair_loop`). The law's coefficients are the numbers without the cutoff unless `columns` makes others of
    them. With `shift` the energy at the cutoff is taken off.

    Parameters
    ----------
    values : the `numbers` in their order or by name, each a float for all pairs of types or a symmetric (n, n) array
        for types 1..n; cutoff 0 =
        no interaction
    units : unit style of these numbers
    shift : whether the energy at the cutoff is taken off (``pair_modify shift yes``), for styles that know it
    n_types : number of types that single numbers stand for (default 1)
    """

    # law : (d², *coefficients) → U, U'/d
    #: whether the law is so cheap, and finite beyond the cutoff, that for one type computing all pairs is faster than
    #: asking which are within
    simd = False
    #: whether ``pair_modify shift`` means something for it
    shifts = True

    def __init__(self, *values, units, shift: bool = False, n_types: int | None = None, **named):
        self._take(self.in_order(values, named), units, n_types, shift)

    @classmethod
    def of(cls, inp: StyleInput, *arrays):
        """From (n_types + 1, n_types + 1) arrays of `numbers`, internal units, as the lines say."""
        return cls.internal(*arrays, shift=inp.modify.shift)

    def chosen_law(self) -> Callable:
        """The law, for styles that have several."""
        return type(self).law

    def reach(self, *numbers):
        """The cutoff: the last number unless a style says otherwise."""
        return numbers[-1]

    def fill(self, *numbers, shift):
        with np.errstate(all="ignore"):
            columns = self.columns(*numbers)
            self._set(self.reach(*numbers), *columns, np.zeros_like(numbers[0]))
        if shift and self.shifts:
            self.table[..., -1] = self.at_cutoff()

    def at_cutoff(self) -> np.ndarray:
        """(n_types + 1, n_types + 1) energies at the cutoff, from the law itself."""
        n = len(self.table)
        open_end = self.table.copy()
        open_end[..., 0] = np.where(self.table[..., 0] > 0, np.inf, 0.0)
        i, j = (a.ravel().astype(np.int32) for a in np.indices((n, n)))
        U, G = np.zeros(n * n), np.zeros(n * n)
        self._loop()(np.arange(n, dtype=np.int32), i, j, self.table[..., 0].ravel().copy(), ONES, open_end, U, G)
        return U.reshape(n, n)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        if self.simd and self.n_types == 1 and len(weights) == 0:
            one_type_loop(self.chosen_law(), self.table.shape[-1])(d2, self.table[1, 1], U, G)
        else:
            self._loop()(types, i, j, d2, weights, self.table, U, G)

    def _loop(self):
        return pair_loop(self.chosen_law(), self.table.shape[-1])


class ChargedStyle(LawStyle):
    """C q_i q_j times a function of the distance, C the Coulomb constant of the unit style over the dielectric
    constant.

    As `RadialStyle`, without a shift; the law also gets C q_i q_j. With `keeps_excluded`, bonded neighbours lose a
    share of the bare Coulomb energy and not of the law's.

    Parameters
    ----------
    values : the `numbers` in their order or by name, each a float for all pairs of types or a symmetric (n, n) array
        for types 1..n; cutoff 0 =
        no interaction
    units : unit style of these numbers and of C
    dielectric : ε
    n_types : number of types that single numbers stand for (default 1)
    """

    # law : (d², C q_i q_j, *coefficients) → U, U'/d
    weight = "coul"
    needs_charges = True

    def __init__(self, *values, units, dielectric: float = 1.0, n_types: int | None = None, **named):
        self._take(self.in_order(values, named), units, n_types, False)
        self.constant = get_units(units).coulomb / dielectric

    @classmethod
    def of(cls, inp: StyleInput, *arrays):
        """From (n_types + 1, n_types + 1) arrays of `numbers`, internal units, with the constant of the lines'
        units."""
        style = cls.internal(*arrays)
        style.constant = inp.coulomb
        return style

    def fill(self, *numbers, shift):
        with np.errstate(all="ignore"):
            self._set(numbers[-1], *self.columns(*numbers))

    def prepare(self, frame):
        return frame.charges

    def add(self, types, i, j, d2, weights, U, G, prepared):
        loop = charged_loop(type(self).law, self.table.shape[-1], self.keeps_excluded)
        loop(types, i, j, d2, weights, self.table, self.constant, prepared, U, G)


# What LAMMPS's lines look like
# --------------------------------------------------------------------------------------------------------------


def mix_lj_distances(a, b, rule):
    """epsilon and sigma mixed as energies and distances, all numbers behind them as distances."""
    more = tuple(mix_distance(x, y, rule) for x, y in zip(a[1:], b[1:], strict=True))
    return (mix_energy(a[0], b[0], a[1], b[1], rule), *more)


def mix_lj(a, b, rule):
    """LAMMPS's mixing of (epsilon, sigma, ..., cutoff): what lies between sigma and the cutoff is averaged."""
    e, s, *_, cutoff = mix_lj_distances((*a[:2], a[-1]), (*b[:2], b[-1]), rule)
    return (e, s, *(0.5 * (x + y) for x, y in zip(a[2:-1], b[2:-1], strict=True)), cutoff)


def mix_lj6(a, b, rule):
    """As `mix_lj` where epsilon and sigma are always mixed by the sixth power (LAMMPS's class2 styles); cutoffs follow
    the rule."""
    more = tuple(mix_distance(x, y, rule) for x, y in zip(a[2:], b[2:], strict=True))
    return (*mix_lj_distances(a[:2], b[:2], "sixthpower"), *more)


def mix_prefactor(a, b, rule):
    """(prefactor, cutoff): the prefactor's mean is geometric, as there is no sigma, also under sixthpower."""
    return mix_energy(a[0], b[0], 1.0, 1.0, rule), mix_distance(a[1], b[1], rule)


def one_cutoff(cls, *, mix=None, check=None, names=(), line=("cutoff",), constants=None):
    """Register a style of the form ``pair_style NAME cutoff`` and ``pair_coeff i j numbers [cutoff]``.

    check : function (numbers of a line, internal units) → what is wrong with them, or None
    names : LAMMPS names, default the class's own
    line : the numbers of the pair_style line, where some are the same for all pairs of types
    constants : {number: value} of those that no line says
    """

    def build(inp: StyleInput):
        dimensions = dict(cls.numbers)
        given = dict(zip(line, inp.numbers(inp.args, [(w, dimensions[w]) for w in line]), strict=True))
        rc = given.pop("cutoff")
        given |= {name: value * factor(inp.units, dimensions[name]) for name, value in (constants or {}).items()}
        own = [number for number in cls.numbers if number[0] not in given]
        arrays = short_values(inp, own, rc, mix, check)
        of = dict(zip((name for name, _ in own), arrays, strict=True))
        return cls.of(inp, *(of[n] if n in of else np.full_like(arrays[0], given[n]) for n, _ in cls.numbers))

    pair_style(*(names or (cls.name,)))(build)
    return build


def short_values(inp: StyleInput, wants, cutoff, mix=None, check=None) -> list[np.ndarray]:
    """`pair_values` of lines ``pair_coeff i j numbers [cutoff]``, whose numbers `check` may object to."""
    check_lines(inp, wants, check)
    return pair_values(inp, wants, optional=1, defaults=[cutoff], mix=mix)


def both_cutoffs(inp: StyleInput, words, front=()) -> list[float]:
    """The numbers of a line ``<front> cutoff [cutoff_coul]``; one cutoff is for both parts."""
    *front, rc, rcoul = inp.numbers(words, [*front, CUTOFF, COULOMB_CUTOFF], optional=1)
    return [*front, rc, rc if rcoul is None else rcoul]


def four_cutoffs(inp: StyleInput) -> list[float]:
    """inner and outer cutoffs of Lennard-Jones, and of Coulomb (those of Lennard-Jones if it has none)."""
    names = ("inner LJ cutoff", "outer LJ cutoff", "inner Coulomb cutoff", "outer Coulomb cutoff")
    if len(inp.args) == 3:
        raise inp.wrong(f"{inp.command} takes two or four cutoffs")
    inner, outer, *coulomb = inp.numbers(inp.args, [(n, "length") for n in names], optional=2)
    inp.require(inner_below_outer(inner, outer, "LJ "))
    return [inner, outer, *((inner, outer) if coulomb[0] is None else coulomb)]


def check_lines(inp: StyleInput, wants, check, optional: int = 1) -> None:
    """Complain of coefficient lines whose numbers `check` objects to."""
    if check is None:
        return
    for line in inp.coeffs:
        inp.require(check(*inp.numbers(line.words, wants, line, optional)), line)


def several_cutoffs(inp: StyleInput, wants, defaults, mix=None, check=None) -> list[np.ndarray]:
    """As `pair_values`, where a line gives the last ``len(defaults)`` numbers all or not at all."""
    least = len(wants) - len(defaults)

    def read(line):
        if least < len(line.words) < len(wants):
            raise inp.wrong(
                f"pair_coeff of {inp.name} takes {' '.join(w for w, _ in wants[:least])}, and then all or none of "
                f"{' '.join(w for w, _ in wants[least:])}",
                line,
            )
        values = inp.numbers(line.words, wants, line, optional=len(defaults))
        values = (*values[:least], *(d if v is None else v for v, d in zip(values[least:], defaults, strict=True)))
        inp.require(check(*values) if check is not None else None, line)
        return values

    return fill(inp, inp.by_pair(read), len(wants), mix)


def inner_below_outer(inner: float, outer: float, what: str = "") -> str | None:
    """What is wrong with a switching range, None if nothing."""
    if not 0 < inner < outer:
        return f"the {what}inner cutoff must be positive and less than the outer one"
    return None


def inner_outer(cls, *, mix=None):
    """Register a style of the form ``pair_style NAME inner outer`` and ``pair_coeff i j numbers [inner outer]``."""

    def build(inp: StyleInput):
        cutoffs = inp.numbers(inp.args, [("inner cutoff", "length"), ("outer cutoff", "length")])
        inp.require(inner_below_outer(*cutoffs))
        arrays = several_cutoffs(inp, cls.numbers, cutoffs, mix, check=lambda *v: inner_below_outer(*v[-2:]))
        return cls.of(inp, *arrays)

    pair_style(cls.name)(build)
