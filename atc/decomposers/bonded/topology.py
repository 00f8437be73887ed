"""What bonded terms share: which types have coefficients, and from their lines to the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ...readers.lammps.data import COEFFS
from ...units import Units
from ...units import units as system
from ..base import Accumulator, Term, Work
from ..pairs.unsupported import reason
from ..registry import STYLES, TypeRange, factor
from .cluster import ClusterTerm, weights_of

#: Dimensions of coefficients, as `registry.factor` takes them.
energy, length, plain, degrees = "energy", "length", 1.0, np.pi / 180.0
per_length, energy_per_length = {"length": -1}, {"energy": 1, "length": -1}
per_length2, per_length3, per_length4 = ({"energy": 1, "length": -n} for n in (2, 3, 4))


class MirrorError(ValueError):
    """Coefficients that are understood, of a term that is not a function of distances: refused where a frame uses
    them."""


class BondedTerm(ClusterTerm):
    """Bonded interactions of one style, with coefficients by type.

    Parameters
    ----------
    coeffs : {type: numbers}, the numbers of LAMMPS's coefficient line in its order (`wants`) and in `units`; angles in
        degrees. For types that differ in nothing a bare tuple is type 1.
    units : unit style of the numbers; the default has eV and Å

    Attributes
    ----------
    covered : types with coefficients
    others : types that other styles take care of (hybrid). A type of the topology that nobody covers is an error.
    refused : {type: why} of types whose coefficients are understood and have no forces along distances: an error only
        where a frame uses them

    Terms of type 0 and below are switched off in LAMMPS (a broken ``quartic`` bond, ``delete_bonds``): they contribute
    nothing.
    """

    kind = ""
    name = ""
    #: (what, dimension) of each number of a coefficient line
    wants: tuple[tuple[str, str | dict | float], ...] = ()
    #: what rows of the table are filled up with to the longest one, again and again
    filling: tuple[float, ...] = (0.0,)
    others: frozenset = frozenset()
    refused: Mapping[int, str] = MappingProxyType({})

    def __init_subclass__(cls, style: bool = True):
        """Make a class with a kind and a name known as LAMMPS's `style`, built from its coefficient lines by its
        `build`."""
        if style and cls.kind and cls.name:
            STYLES[cls.kind].setdefault(cls.name, cls.build)

    def __init__(self, coeffs: Mapping | Sequence, *, units: str | Units = "metal"):
        self.units = system(units)
        self._set(self.internal(coeffs if isinstance(coeffs, Mapping) else {1: coeffs}))

    def internal(self, coeffs: Mapping) -> dict[int, Sequence]:
        """{type: numbers in internal units} of those in the user's."""
        out = {}
        for t, v in coeffs.items():
            v = np.atleast_1d(v).astype(float)
            if len(v) != len(self.wants):
                names = ", ".join(w for w, _ in self.wants)
                raise AtcError(
                    f"{self.kind} style {self.name}: type {t} needs {names or 'no numbers'}, got {len(v)} numbers"
                )
            out[int(t)] = tuple(x * factor(self.units, d) for x, (_, d) in zip(v, self.wants, strict=True))
        return out

    @classmethod
    def read(cls, inp, line) -> Sequence:
        """The numbers of a coefficient line, internal units."""
        return inp.numbers(line.words, cls.wants, line)

    @classmethod
    def build(cls, inp):
        """From the lines of a `StyleInput`."""
        inp.no_arguments()
        return cls._from_input(inp.by_type(lambda line: cls.read(inp, line)), inp)

    @classmethod
    def _from_input(cls, values: Mapping, inp):
        """From a `StyleInput`, values in internal units."""
        self = cls.__new__(cls)
        self.units = inp.units
        self._set(values, inp.where)
        return self

    def row(self, *numbers) -> Sequence[float]:
        """The row of `table` that the numbers of a type make (internal units). Raises ValueError with what is wrong
        with them, or `MirrorError`."""
        return numbers

    def _set(self, values: Mapping, where: str = ""):
        """Keep the numbers of each type."""
        self.covered = frozenset(values)
        rows, refused = {}, {}
        for t, numbers in values.items():
            try:
                rows[t] = self.row(*numbers)
            except MirrorError as e:
                refused[t] = str(e)
            except ValueError as e:
                raise AtcError(f"{where or self.name}: {self.kind} type {t} of style {self.name}: {e}") from None
        self.keep_refusals(refused, where)
        self.keep(rows)

    def keep(self, rows: Mapping) -> None:
        """Make the `table` (largest type + 1, longest row) of {type: row}."""
        self.table = filled(rows, self.filling)

    def columns(self, types) -> np.ndarray:
        """The numbers of terms of these types: a row of the result for each column of the table."""
        return self.table.T.take(types, axis=1)

    def keep_refusals(self, refused: Mapping[int, str], where: str = ""):
        """Remember types without forces along distances; if there are no others, the style can compute nothing and that
        is an error at once."""
        self.refused = dict(refused)
        if refused and set(refused) == set(self.covered):
            raise AtcError(f"{where or self.name}: {self._why(min(refused))}")

    def _why(self, t: int) -> str:
        return f"{self.kind} type {t} of style {self.name}: {self.refused[t]}"

    def describe(self) -> str:
        return f"{self.kind} {self.name}"

    def terms_of(self, frame: Frame):
        """(m, k) atom indices and (m,) types of this style's terms in a frame.

        Raises
        ------
        AtcError without topology, for types without coefficients, or for atoms that are not in the frame.
        """
        kind, top = self.kind, frame.topology
        if top is not None and top.untold:
            raise AtcError(top.untold)
        if top is None:
            raise AtcError(
                f"{frame.source}: {kind}_style {self.name} needs to know the {kind}s: give a LAMMPS data file with a "
                f"{kind.capitalize()}s section as topology"
            )
        atoms, types = np.asarray(getattr(top, f"{kind}s")), np.asarray(getattr(top, f"{kind}_types"))
        on = types > 0
        if not on.all():
            atoms, types = atoms[on], types[on]
        used = set(np.unique(types).tolist())
        missing = sorted(used - self.covered - self.others)
        if missing:
            raise AtcError(
                f"{frame.source}: {kind} type {missing[0]} is in the topology but has no coefficients in {kind}_style "
                f"{self.name}: add a {kind}_coeff {missing[0]} line"
            )
        if not self.refused.keys().isdisjoint(used):
            raise AtcError(f"{frame.source}: {self._why(min(used & self.refused.keys()))}")
        if len(atoms) and (atoms.min() < 0 or atoms.max() >= len(frame)):
            raise AtcError(
                f"{frame.source}: the topology has {kind}s of atoms that are not in this frame ({len(frame)} atoms): "
                "dump all atoms"
            )
        if self.others:
            mine = np.isin(types, list(self.covered))
            atoms, types = atoms[mine], types[mine]
        return np.ascontiguousarray(atoms, dtype=np.int32), np.ascontiguousarray(types, dtype=np.int32)


class SharedTerm(BondedTerm):
    """One of three and more atoms, whose energy may be shared among them in several ways.

    partition : "equal", one of `shares`, or a number for each atom in the order of the topology, which add up to 1.
        Stress and total energy do not depend on it; heat flux and churning do.
    """

    #: {word: (fractions of the atoms, what to say of them)}
    shares: Mapping[str, tuple] = MappingProxyType({})

    def __init__(self, coeffs, *, units: str | Units = "metal", partition="equal"):
        super().__init__(coeffs, units=units)
        self.share(partition)

    @classmethod
    def _from_input(cls, values, inp):
        self = super()._from_input(values, inp)
        self.share("equal")
        return self

    @property
    def part_name(self) -> str:
        return self.kind

    def share(self, partition):
        self.weights, self.shared = weights_of(partition, self.bodies, self.shares, f"{self.kind} {self.name}")

    def describe(self) -> str:
        return f"{self.kind} {self.name}, {self.shared}"


class RowTerm:
    """For terms whose coefficient lines have no fixed length. The class in front of a `BondedTerm`."""

    @classmethod
    def scaled(cls, numbers: Sequence[float], u: Units) -> Sequence[float]:
        """The numbers of one coefficient line in internal units. Raises ValueError with what is wrong."""
        raise NotImplementedError

    def internal(self, coeffs):
        try:
            return {int(t): self.scaled([float(x) for x in np.atleast_1d(v)], self.units) for t, v in coeffs.items()}
        except ValueError as e:
            raise AtcError(f"{self.kind} style {self.name}: {e}") from None

    @classmethod
    def read(cls, inp, line):
        try:
            return cls.scaled([inp.number(w, 1.0, "a coefficient", line) for w in line.words], inp.units)
        except ValueError as e:
            raise inp.error(f"{inp.kind}_coeff of {inp.name}: {e}", line) from None


class Idle:
    """For styles ``zero``, which exert no force; they only make neighbours for special_bonds. The class in front of a
    `BondedTerm`."""

    name = "zero"
    #: the size that a line may give, which other commands ask for
    at_rest: tuple = ()

    @classmethod
    def build(cls, inp):
        if inp.args not in ((), ("nocoeff",)):
            raise inp.wrong(f"{inp.command} takes nothing or nocoeff")
        return cls._from_input(inp.by_type(lambda line: cls.read(inp, line)), inp)

    @classmethod
    def read(cls, inp, line):
        if not inp.args:  # with nocoeff LAMMPS does not look at them
            inp.numbers(line.words, cls.at_rest, line, optional=len(cls.at_rest))
        return ()

    def describe(self):
        return f"{self.kind} zero"

    def prepare(self, frame):
        self.terms_of(frame)
        return Work()


class CrossTerms:
    """For class2 styles, whose coefficients come in parts: the main ones, and cross terms behind a word of their own.

    The class in front of a `BondedTerm`. In a data file each part is a section; every type needs all of them, as in
    LAMMPS.
    """

    main: tuple[tuple[str, str | dict | float], ...]
    crosses: Mapping[str, tuple[tuple[str, str | dict | float], ...]]

    @property
    def wants(self):
        return tuple(w for part in (self.main, *self.crosses.values()) for w in part)

    @classmethod
    def build(cls, inp):
        inp.no_arguments()
        parts = {"": cls.main, **cls.crosses}
        got: dict[int, dict[str, list]] = {}
        for line in inp.coeffs:
            word = line.words[0] if line.words and line.words[0] in cls.crosses else ""
            numbers = inp.numbers(line.words[1 if word else 0 :], parts[word], line)
            for (t,) in line.covers(inp.n_types):
                got.setdefault(t, {})[word] = numbers
        for t, has in got.items():
            missing = [p for p in parts if p not in has]
            if missing:
                what = " and ".join(
                    f"{inp.kind}_coeff {t} {p}".strip() + f" (data file: {SECTIONS[inp.kind, p]})" for p in missing
                )
                raise inp.error(f"{inp.kind} type {t} of style {inp.name} lacks coefficients: add {what}")
        return cls._from_input({t: [x for p in parts for x in has[p]] for t, has in got.items()}, inp)


#: the sections of data files, by kind and the word of a class2 cross term ("": the kind's own)
SECTIONS = {key: name for name, key in COEFFS.items()}


def filled(rows: Mapping[int, Sequence[float]], filling=(0.0,)) -> np.ndarray:
    """(largest type + 1, longest row): each row by its type, filled up with `filling` over and over (from the second
    number on, if it has several)."""
    width = max((len(r) for r in rows.values()), default=1)
    lead = width % len(filling)
    table = np.tile(
        np.concatenate([np.zeros(lead), np.tile(filling, width // len(filling))]), (max(rows, default=0) + 1, 1)
    )
    for t, r in rows.items():
        table[t, : len(r)] = r
    return table


def whole(v: float, what: str, least: int | None = None) -> int:
    """v as a whole number. Raises ValueError with what is wrong."""
    if not np.isfinite(v) or v != int(v) or (least is not None and v < least):
        raise ValueError(f"{what} must be a whole number{'' if least is None else f' from {least}'}, got {v:g}")
    return int(v)


class HybridTerm(Term):
    """Several styles of one kind side by side (LAMMPS ``bond_style hybrid``), each with types of its own.

    terms : BondedTerms of one kind. silent : types that are meant to have no interaction (LAMMPS's ``none``).
    """

    def __init__(self, terms: Sequence[BondedTerm], silent=()):
        self.terms = list(terms)
        for t in self.terms:
            t.others = frozenset(silent).union(*(o.covered for o in self.terms if o is not t))
        self.units = self.terms[0].units

    @property
    def pairwise(self) -> bool:
        return all(t.pairwise for t in self.terms)

    @property
    def part_name(self) -> str:
        return next((t.part_name for t in self.terms if t.part_name), "")

    def describe(self) -> str:
        return "; ".join(t.describe() for t in self.terms)

    def partitioned(self, partition, word=False):
        new = copy(self)
        new.terms = [t.partitioned(partition, word) for t in self.terms]
        return new

    def leaves(self, frame: Frame) -> list[Term]:
        return [leaf for t in self.terms for leaf in t.leaves(frame)]

    def prepare(self, frame: Frame) -> Work:
        return HybridWork([t.prepare(frame) for t in self.terms])


class HybridWork(Work):
    """The works of the sub-styles, one after the other."""

    def __init__(self, works):
        self.tasks = [(w, k) for w in works for k in range(w.stages[0])]
        self.stages = (len(self.tasks),)

    def run(self, stage, task, acc: Accumulator):
        work, k = self.tasks[task]
        return work.run(0, k, acc)


def _build_hybrid(inp):
    """``bond_style hybrid harmonic table linear 1000`` and ``bond_coeff 1 harmonic 80 1.2`` lines."""
    known = STYLES[inp.kind]
    args: dict[str, list[str]] = {}
    for word in inp.args:
        if word in known and word != "hybrid":
            if word in args:
                raise inp.error(f"{inp.command} names {word} twice: name each style once")
            args[word] = []
        elif why := reason(inp.kind, word):
            raise inp.error(f"{inp.command}: {inp.kind}_style {word} is not supported: {why}")
        elif not args:
            raise inp.error(f"{inp.command}: {word} is not supported: expected {', '.join(sorted(known))}")
        else:
            args[list(args)[-1]].append(word)
    lines: dict[str, list] = {name: [] for name in args}
    silent: set[int] = set()
    last: dict[int, str] = {}
    for line in inp.coeffs:
        name = line.words[0] if line.words else ""
        if name not in args and name not in ("none", "skip"):
            raise inp.error(
                f"{inp.kind}_coeff of hybrid: expected one of {', '.join([*args, 'none'])} after the type, got "
                f"{name!r}",
                line,
            )
        if name == "skip":
            # A row of a class2 section for a type of another style: nothing is said about it.
            continue
        for (t,) in line.covers(inp.n_types):
            last[t] = name
        if name in args:
            lines[name].append(replace(line, words=line.words[1:]))
    terms = []
    for name, more in args.items():
        # A type given twice belongs to the style that names it last.
        mine = [
            replace(x, types=(TypeRange(t, t),))
            for x in lines[name]
            for (t,) in x.covers(inp.n_types)
            if last[t] == name
        ]
        if mine:
            terms.append(known[name](inp.replace(name=name, args=tuple(more), coeffs=tuple(mine))))
    silent = {t for t, name in last.items() if name not in args}
    if not terms:
        raise inp.error(f"{inp.command} has no {inp.kind}_coeff lines for any of its styles: add them")
    return HybridTerm(terms, silent)


for _kind in ("bond", "angle", "dihedral", "improper"):
    STYLES[_kind]["hybrid"] = _build_hybrid
