"""Which element an atom type is: the ``pair_coeff * * file El1 El2 NULL`` of potentials whose parameters come by
element."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..registry import StyleInput, pair_style

#: Symbols in the order of the nuclear charge, from 1.
SYMBOLS = tuple(
    "H He Li Be B C N O F Ne Na Mg Al Si P S Cl Ar K Ca Sc Ti V Cr Mn Fe Co Ni Cu Zn Ga Ge As Se Br Kr Rb Sr Y Zr Nb "
    "Mo Tc Ru Rh Pd Ag Cd In Sn Sb Te I Xe Cs Ba La Ce Pr Nd Pm Sm Eu Gd Tb Dy Ho Er Tm Yb Lu Hf Ta W Re Os Ir Pt Au "
    "Hg Tl Pb Bi Po At Rn Fr Ra Ac Th Pa U Np Pu Am Cm Bk Cf Es Fm Md No Lr Rf Db Sg Bh Hs Mt Ds Rg Cn Nh Fl Mc Lv Ts "
    "Og".split()
)


def whole_line(inp: StyleInput, wants: str, least: int = 0):
    """The one ``pair_coeff * *`` line, of `least` words or more, of a style without arguments; `wants` : how it should
    read.

    Raises
    ------
    AtcError for arguments, missing or several lines, types other than ``* *``, too few words.
    """
    if inp.args:
        raise inp.wrong(f"{inp.command} takes {wants}: expected no arguments")
    if not inp.coeffs:
        raise inp.error(f"{inp.command} has no pair_coeff line: give {wants}")
    if len(inp.coeffs) > 1:
        raise inp.error(f"{inp.command} takes one pair_coeff * * line: leave one of them", inp.coeffs[1])
    line = inp.coeffs[0]
    if any(t.lo != 1 or t.hi is not None for t in line.types):
        raise inp.error(f"{inp.command} takes {wants}: replace the types by * *", line)
    if len(line.words) < least:
        raise not_as_wanted(inp, wants, line)
    return line


def not_as_wanted(inp: StyleInput, wants: str, line):
    """The error for a line of too few words."""
    got = " ".join(line.words) or "nothing"
    return inp.error(
        f"{inp.command} wants {wants}: it takes a file and the element of each atom type, got {got} behind * *", line
    )


def of_each_type(inp: StyleInput, words, line) -> list[str | None]:
    """The element of each atom type that the last words of a line name, None for NULL.

    Raises
    ------
    AtcError for too few, none at all, and types that another style has to itself.
    """
    elements = [None if e == "NULL" else e for e in words]
    if len(elements) < inp.n_types:
        raise inp.error(
            f"{inp.command} needs one element (or NULL) for each of the {inp.n_types} atom types, found "
            f"{len(elements)}",
            line,
        )
    if not any(elements):
        raise inp.error(f"{inp.command}: every atom type is NULL: name the element of at least one type", line)
    if inp.wanted is not None:
        m = min(inp.n_types, len(elements))
        for a in range(1, m + 1):
            for b in range(a, m + 1):
                if elements[a - 1] and elements[b - 1] and not inp.wanted[a, b]:
                    raise inp.error(
                        f"{inp.command} must act on all pairs of the types that it maps, but {a} {b} is given to "
                        "another style alone: use hybrid/overlay, or NULL for one of them",
                        line,
                    )
    return elements


def require_among(inp: StyleInput, elements, names, which: str, line) -> None:
    """Raise AtcError for an element of an atom type that is not one of those that a line names before."""
    odd = next((e for e in elements if e is not None and e not in names), None)
    if odd is not None:
        raise inp.error(f"{inp.command}: {odd} is not among the elements {which} ({', '.join(names)})", line)


def mapped_line(inp: StyleInput, ending: str):
    """(path, elements, line) of the one ``pair_coeff * * <file> <element of each atom type>`` line of a style; AtcError
    as `whole_line`, `of_each_type`, and for a missing file."""
    line = whole_line(inp, f"pair_coeff * * <file{ending}> <element of each atom type>", 2)
    elements = of_each_type(inp, line.words[1:], line)
    return inp.path(line.words[0], line), elements, line


def mapped_style(*names: str, ending: str, read, **more) -> None:
    """Make pair styles known whose one line is ``pair_coeff * * file El1 El2 ...``, built by ``read(path, elements,
    units=, where=, **more)``."""

    def build(inp: StyleInput):
        path, elements, line = mapped_line(inp, ending)
        return read(path, elements, units=inp.units, where=line.where, **more)

    pair_style(*names, mapped=True)(build)


def named_elements(elements) -> list:
    """The elements that types are given, each once; without those left out."""
    return list(dict.fromkeys(e for e in elements or () if e not in (None, "NULL")))


def require_known(elements, names, path, where: str) -> None:
    """Raise AtcError, at the line `where` or the file, for elements that a file does not have."""
    odd = next((e for e in elements or () if e not in (None, "NULL", *names)), None)
    if odd is not None:
        raise AtcError(f"{where or path}: {path} has no element {odd!r}: it has {', '.join(names)}")


class ElementMap:
    """From atom types to the elements of a potential.

    names : the potential's elements in use. elements : the name of each atom type from 1, None for types left out; or
        None: every atom is names[0].
    rest : the name of types beyond those, None: they are an error
    """

    def __init__(self, elements, names, what: str, rest: str | None = None):
        self.names, self.what, self.rest = list(names), what, rest
        self.elements = None if elements is None else [None if e in (None, "NULL") else e for e in elements]
        if self.elements is not None:
            odd = next((e for e in self.elements if e is not None and e not in self.names), None)
            if odd is not None:
                raise AtcError(f"{what}: no element {odd!r}: it has {', '.join(self.names)}")
            # An entry 0 in front, since types count from 1.
            self.of_type = np.array([-1, *(-1 if e is None else self.names.index(e) for e in self.elements)])
            if (self.of_type < 0).all():
                raise AtcError(f"{what}: every atom type is NULL: name the element of at least one type")

    def masses(self, names, masses, where: str) -> tuple[str, dict[str, float]]:
        """`Term.file_masses` from those of elements, in the file's units. where : the line that names the file"""
        of = dict(zip(names, (float(m) for m in masses), strict=True))
        if self.elements is None:
            return where, {"*": of[self.names[0]]}
        out = {str(t): of[e] for t, e in enumerate(self.elements, 1) if e is not None}
        return where, out if self.rest is None else {**out, f"{len(self.elements) + 1}*": of[self.rest]}

    def describe(self) -> str:
        return "" if self.elements is None else " " + "-".join(dict.fromkeys(e for e in self.elements if e is not None))

    def apply(self, frame: Frame):
        """(n,) int32 element of each atom, −1 for those left out, and the int32 indices of the others (None: all)."""
        n = len(frame)
        if self.elements is None:
            return np.zeros(n, np.int32), None
        of_type = self.of_type
        top = int(frame.types.max()) if n else 0
        if top >= len(of_type) and self.rest is not None:
            of_type = np.concatenate([of_type, np.full(top + 1 - len(of_type), self.names.index(self.rest))])
        if top >= len(of_type):
            raise AtcError(
                f"{frame.source}: atoms of type {int(frame.types.max())} but {self.what} names the elements of types 1 "
                f"to {len(self.of_type) - 1}: name the others too, or NULL"
            )
        if n and frame.types.min() < 1:
            raise AtcError(f"{frame.source}: atom types must be 1 or larger, found {int(frame.types.min())}")
        element_n = of_type[frame.types].astype(np.int32)
        return element_n, None if (element_n >= 0).all() else np.flatnonzero(element_n >= 0).astype(np.int32)
