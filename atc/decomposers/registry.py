"""Which LAMMPS styles are understood, and what a style's builder is given.

A style registers a *builder* under its LAMMPS name::

    @pair_style("morse")
    def _morse(inp: StyleInput): ...      # returns PairStyle or Term, or a list of them

Bonded styles are the `build` of their classes, see `bonded.topology.BondedTerm`.

Builders convert to internal units themselves (`StyleInput.number`) and complain with the line's own file and number
(`StyleInput.error`). They are called again with a larger `n_types` when a frame has more types than the lines name
(``*`` covers every type).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import prod
from pathlib import Path

import numpy as np

from ..config.words import guess
from ..errors import AtcError
from ..readers.lammps.sections import number_of, shortened
from ..units import Units

STYLES: dict[str, dict[str, Callable]] = {kind: {} for kind in ("pair", "bond", "angle", "dihedral", "improper")}
PAIR_STYLES = STYLES["pair"]
#: CHARMM's own Coulomb constant in kcal/mol Å/e², which LAMMPS takes in units real for whole models with its
#: force-shifted styles.
CHARMM_CONSTANT = 332.0716
#: Pair styles whose one ``pair_coeff * *`` line maps atom types to elements (NULL: not this style's).
MAPPED_STYLES: set[str] = set()


def mapped_elements(style: str, words) -> tuple[str, ...]:
    """The words of such a line that name the element of each atom type: those behind its file; for meam behind library,
    its elements and parameter file; for eim behind its elements and file; for snap behind both files."""
    if style == "snap":
        return tuple(words[2:])
    if style not in ("meam", "meam/c", "eim"):
        return tuple(words[1:])
    # Names of elements have neither dots nor slashes.
    least = 0 if style == "eim" else 1
    file = next(
        (k for k, w in enumerate(words) if k > least and ("." in w or "/" in w or (style != "eim" and w == "NULL"))),
        len(words),
    )
    return tuple(words[file + 1 :])


def factor(units: Units, dimension: str | dict | float) -> float:
    """Internal size of a user's unit: `dimension` as in `atc.units`, or powers of them, {"energy": 1, "length": 6}, or
    the factor itself."""
    if isinstance(dimension, int | float):
        return float(dimension)
    if isinstance(dimension, str):
        return units.factor(dimension)
    return prod((units.factor(name) ** power for name, power in dimension.items()), start=1.0)


def pair_style(*names: str, mapped: bool = False):
    """Decorator of the builder of pair styles. mapped : whether their one line maps atom types to elements"""

    def keep(builder):
        PAIR_STYLES.update(dict.fromkeys(names, builder))
        MAPPED_STYLES.update(names if mapped else ())
        return builder

    return keep


@dataclass(frozen=True)
class TypeRange:
    """Types lo..hi inclusive; hi None is open (``2*``)."""

    lo: int
    hi: int | None

    def __call__(self, n_types: int) -> range:
        return range(self.lo, (n_types if self.hi is None else min(self.hi, n_types)) + 1)


@dataclass(frozen=True)
class CoeffLine:
    """One coefficient line: ``types`` its one (bonded) or two (pair) ranges, ``words`` what follows them (for hybrid,
    without the sub-style's name)."""

    types: tuple[TypeRange, ...]
    words: tuple[str, ...]
    where: str

    def covers(self, n_types: int):
        """The types (bonded), or pairs of types i ≤ j (pair), that this line sets, as LAMMPS loops over them."""
        if len(self.types) == 1:
            return [(i,) for i in self.types[0](n_types)]
        a, b = (t(n_types) for t in self.types)
        return [(i, j) for i in a for j in b if j >= i]


@dataclass(frozen=True)
class Modify:
    """``pair_modify``."""

    shift: bool = False
    mix: str | None = None
    tail: bool = False
    compute: bool = True
    #: 2 to this many entries has the run's table of long-range Coulomb
    table: int = 12
    #: ((lj, coul or lj/coul, three weights), ...) in place of those of special_bonds
    special: tuple = ()


@dataclass(frozen=True)
class StyleInput:
    """What a builder gets.

    Attributes
    ----------
    kind : "pair", "bond", "angle", ...
    name : the style's LAMMPS name
    args : words behind the name on the ``*_style`` line
    coeffs : list of CoeffLine in the order given: later lines override earlier ones
    n_types : how many types (of atoms for pairs, of bonds for bonds ...) to make tables for
    units : Units of every number; ``inp.units.to_internal("energy", v)``
    folder : where relative file names are looked up
    where : file and line of the ``*_style`` line, for messages
    modify : Modify
    dielectric : LAMMPS's ``dielectric`` constant
    charmm : whether a style of the model has CHARMM's Coulomb constant in place of LAMMPS's, which then holds for all
    wanted : (n_types + 1, n_types + 1) bool: pairs of types this style acts on. Others stay without interaction; a
        wanted pair that is neither
        given nor can be mixed is an error. All True except under hybrid.
    labels : {kind: {label: type}} from ``labelmap``
    masses : {type: mass} in user units as far as the lines say
    notes : what the user should know about the model, see `note`
    pairs : for bonded styles, the `Pairs` term of the model (None: no interaction that is a sum over pairs)
    """

    kind: str
    name: str
    args: tuple[str, ...]
    coeffs: tuple[CoeffLine, ...]
    n_types: int
    units: Units
    folder: Path
    where: str
    modify: Modify = Modify()
    dielectric: float = 1.0
    charmm: bool = False
    wanted: np.ndarray | None = None
    labels: dict = field(default_factory=dict)
    masses: dict = field(default_factory=dict)
    pairs: object = None
    notes: list = field(default_factory=list)

    @property
    def pair_styles(self) -> Sequence:
        """The pair styles of the model's `pairs`."""
        return () if self.pairs is None else self.pairs.styles

    @property
    def pair_weights(self):
        """The special_bonds of the model's `pairs`, None where there are no pairs or no weights."""
        return None if self.pairs is None else self.pairs.special

    def note(self, text: str) -> None:
        """Say something about the model that is no error: it becomes one of the potential's remarks."""
        if text not in self.notes:
            self.notes.append(text)

    def replace(self, **changes) -> StyleInput:
        return replace(self, **changes)

    @property
    def coulomb(self) -> float:
        """Coulomb constant over the dielectric constant, internal units."""
        u = self.units
        constant = CHARMM_CONSTANT * u.energy * u.length / u.factor("charge") ** 2 if self.charmm else u.coulomb
        return constant / self.dielectric

    @property
    def command(self) -> str:
        return f"{self.kind}_style {self.name}"

    def error(self, message: str, line: CoeffLine | None = None) -> AtcError:
        """An AtcError that names the file and line; use as ``raise inp.error("...", line)``."""
        return AtcError(f"{line.where if line is not None else self.where}: {message}")

    def wrong(self, message: str, line: CoeffLine | None = None) -> AtcError:
        """`error` that ends in what is there: the words of the line, or the arguments of the style."""
        return self.error(f"{message}, got {' '.join(self.args if line is None else line.words) or 'nothing'}", line)

    def require(self, complaint: str | None, line: CoeffLine | None = None) -> None:
        """Raise `wrong` if there is a complaint."""
        if complaint:
            raise self.wrong(f"{self.command}: {complaint}", line)

    def no_arguments(self) -> None:
        if self.args:
            raise self.wrong(f"{self.command} takes no arguments")

    def by_pair(self, read: Callable[[CoeffLine], object]) -> dict:
        """{types: what `read` makes of the coefficient line that covers them}; of several lines the last holds."""
        out: dict = {}
        for line in self.coeffs:
            value = read(line)
            out.update(dict.fromkeys(line.covers(self.n_types), value))
        return out

    def by_type(self, read: Callable[[CoeffLine], object]) -> dict:
        """As `by_pair` for bonded styles, whose lines are for single types."""
        return {t: value for (t,), value in self.by_pair(read).items()}

    def number(self, word: str, dimension: str | dict, what: str, line: CoeffLine | None = None) -> float:
        """A number in internal units; `dimension` as in `factor`."""
        v = number_of(word)
        if v is None:
            odd = word.lower().lstrip("+-") in ("nan", "inf", "infinity")
            wanted = f"{what} must be a finite number" if odd else f"expected a number for {what}"
            raise self.error(f"{self.command}: {wanted}, got {word!r}", line)
        if v < 0 and what.endswith("cutoff"):
            raise self.error(f"{self.command}: the {what} must not be negative, got {word}", line)
        return v * factor(self.units, dimension)

    def numbers(self, words, wants, line: CoeffLine | None = None, optional: int = 0) -> list[float | None]:
        """Exactly the numbers `wants` = [(what, dimension), ...], the last `optional` of which may be missing
        (None)."""
        words = list(words)
        least = len(wants) - optional
        if not least <= len(words) <= len(wants):
            names = " ".join(w if k < least else f"[{w}]" for k, (w, _) in enumerate(wants))
            subject = f"{self.kind}_coeff of {self.name}" if line is not None else self.command
            raise self.error(f"{subject} takes {names or 'no numbers'}, got {' '.join(words) or 'nothing'}", line)
        out: list[float | None] = [
            self.number(word, d, what, line) for word, (what, d) in zip(words, wants, strict=False)
        ]
        return out + [None] * (len(wants) - len(out))

    def path(self, name: str, line: CoeffLine | None = None) -> Path:
        """A file named on a line: relative to the script's folder, or by its last name in the folders of the
        environment variable LAMMPS_POTENTIALS."""
        p = Path(name).expanduser()
        p = p if p.is_absolute() else self.folder / p
        try:
            there, other = p.is_file(), p.exists()
        except (OSError, ValueError):  # no possible name of a file
            there = other = False
        if not there and not other:
            for folder in filter(None, os.environ.get("LAMMPS_POTENTIALS", "").split(os.pathsep)):
                shared = Path(folder) / p.name
                if p.name and len(p.name) < 256 and shared.is_file():
                    self.note(f"{p.name} is read from {folder} (LAMMPS_POTENTIALS)")
                    return shared
        if not there:
            raise self.error(
                f"{shortened(name)}: {'no file, but a directory, a pipe or a device' if other else 'no such file'} "
                f"(looked for {shortened(str(p), 200)})",
                line,
            )
        return p


def supported(kind: str) -> str:
    """The names of the styles of a kind, for messages."""
    names = sorted(set(STYLES[kind]) - {"hybrid", "zero"}) + (
        ["hybrid", "hybrid/overlay", "hybrid/scaled", "none"] if kind == "pair" else ["zero", "none"]
    )
    return ", ".join(names)


def refusal(kind: str, name: str) -> str:
    """What to tell of a style that is not supported: why, if that is known, or which ones are, the nearest first."""
    from .pairs.unsupported import reason

    why = reason(kind, name) or f"{guess(name, STYLES[kind])}expected one of {supported(kind)}"
    return f"{kind}_style {name} is not supported: {why}"
