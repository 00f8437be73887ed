"""Units as words: what ``"eV/(angstrom^2*ps)"`` and ``"GW/m^2"`` are, and results in the units that people publish.

A unit is a factor to SI base units and the powers of metre, kilogram, second, kelvin and coulomb. ``/mol`` is a number:
an energy per mole is one of a molecule, as in LAMMPS. Constants: CODATA 2018.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from ..errors import AtcError

_E, _NA, _AMU = 1.602176634e-19, 6.02214076e23, 1.66053906660e-27
_M, _KG, _S, _K, _C = ((0,) * k + (1,) + (0,) * (4 - k) for k in range(5))
_PRESSURE, _ENERGY, _FORCE, _POWER = (-1, 1, -2, 0, 0), (2, 1, -2, 0, 0), (1, 1, -2, 0, 0), (2, 1, -3, 0, 0)
_NONE = (0, 0, 0, 0, 0)

#: name: (size in SI, powers of m, kg, s, K, C, whether it takes prefixes)
_UNITS = {
    "1": (1.0, _NONE, False),
    "m": (1.0, _M, True),
    "angstrom": (1e-10, _M, False),
    "Å": (1e-10, _M, False),
    "bohr": (0.529177210903e-10, _M, False),
    "g": (1e-3, _KG, True),
    "amu": (_AMU, _KG, False),
    "u": (_AMU, _KG, False),
    "Da": (_AMU, _KG, False),
    "s": (1.0, _S, True),
    "t_ase": (1e-10 * (_AMU / _E) ** 0.5, _S, False),
    "K": (1.0, _K, True),
    "C": (1.0, _C, True),
    "e": (_E, _C, False),
    "statC": (3.33564095198152e-10, _C, False),
    "mol": (_NA, _NONE, False),
    "J": (1.0, _ENERGY, True),
    "eV": (_E, _ENERGY, True),
    "erg": (1e-7, _ENERGY, False),
    "cal": (4.184, _ENERGY, True),
    "hartree": (27.211386245988 * _E, _ENERGY, False),
    "kB": (1.380649e-23, (2, 1, -2, -1, 0), False),
    "N": (1.0, _FORCE, True),
    "dyne": (1e-5, _FORCE, False),
    "Pa": (1.0, _PRESSURE, True),
    "bar": (1e5, _PRESSURE, True),
    "atm": (101325.0, _PRESSURE, False),
    "W": (1.0, _POWER, True),
    "V": (1.0, (2, 1, -2, 0, -1), True),
}
_PREFIXES = {"a": 1e-18, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2,
             "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}  # fmt: skip
#: What a word alone stands for in `[output] units`.
PRESETS = {
    "metal-gpa": "GPa, angstrom, ps, m/s, GW/m^2, W/(m*K)",
    "nm-gpa": "GPa, nm, ps, m/s, GW/m^2, W/(m*K)",
    "si": "Pa, m, s, kg, K, m/s, kg/m^3, kg/(m^2*s), J, W/m^2, W/m^3, N/m^3, 1/m^3, 1/s, W/(m*K), W*m, C",
}
_TOKEN = re.compile(r"\s*(\*|·|/|\(|\)|\^\s*[-+]?\d+|\*\*\s*[-+]?\d+|[A-Za-zÅµ_][A-Za-zÅµ_]*\d*|\d+)")


@dataclass(frozen=True)
class Unit:
    """size in SI and powers of m, kg, s, K, C; text: how it is written."""

    size: float
    powers: tuple[int, ...]
    text: str = ""

    def times(self, other: Unit, sign: int = 1) -> Unit:
        powers = tuple(a + sign * b for a, b in zip(self.powers, other.powers))
        return Unit(self.size * other.size**sign, powers)

    def power(self, n: int) -> Unit:
        return Unit(self.size**n, tuple(n * a for a in self.powers))


class NotAUnit(ValueError):
    """Words that are no unit."""


@cache
def unit_of(text: str) -> Unit:
    """The unit that a text means. NotAUnit for what is none (those of lj, and words)."""
    tokens, at = [], 0
    stripped = text.strip()
    while at < len(stripped):
        found = _TOKEN.match(stripped, at)
        if found is None:
            raise NotAUnit(text)
        tokens.append(found.group(1))
        at = found.end()
    if not tokens:
        raise NotAUnit(text)
    unit, rest = _product(tokens, text)
    if rest:
        raise NotAUnit(text)
    return Unit(unit.size, unit.powers, stripped)


def _product(tokens, text):
    total, sign, expects = Unit(1.0, _NONE), 1, True
    while tokens and tokens[0] != ")":
        word, tokens = tokens[0], tokens[1:]
        if word in ("*", "·", "/"):
            if expects:
                raise NotAUnit(text)
            sign, expects = (-1 if word == "/" else 1), True
            continue
        if word == "(":
            one, tokens = _product(tokens, text)
            if not tokens:
                raise NotAUnit(text)
            tokens = tokens[1:]
        elif word[0] in "^":
            raise NotAUnit(text)
        else:
            one = _named(word, text)
        if tokens and (tokens[0][0] == "^" or tokens[0].startswith("**")):
            one, tokens = one.power(int(tokens[0].lstrip("^*"))), tokens[1:]
        total, sign, expects = total.times(one, sign), 1, False
    if expects:
        raise NotAUnit(text)
    return total, tokens


def _named(word, text) -> Unit:
    if word in _UNITS:
        size, powers, _ = _UNITS[word]
        return Unit(size, powers)
    inner = _UNITS.get(word[1:])
    if word[:1] in _PREFIXES and inner is not None and inner[2]:
        return Unit(_PREFIXES[word[0]] * inner[0], inner[1])
    trailing = re.fullmatch(r"([^\d]+)(\d)", word)  # m2 for m^2
    if trailing:
        return _named(trailing.group(1), text).power(int(trailing.group(2)))
    raise NotAUnit(text)


def wanted_units(given) -> tuple[Unit, ...]:
    """What ``[output] units`` says: a text of units with commas between, a list, or the name of a preset.

    Raises
    ------
    AtcError for a word that is no unit, and for two units of one thing.
    """
    words = given.split(",") if isinstance(given, str) else list(given)
    if len(words) == 1 and str(words[0]).strip().lower() in PRESETS:
        words = PRESETS[str(words[0]).strip().lower()].split(",")
    out: dict[tuple, Unit] = {}
    for word in words:
        try:
            unit = unit_of(str(word))
        except NotAUnit:
            raise AtcError(
                f"units {str(word).strip()!r}: is no unit: expected e.g. GPa, W/(m*K), nm, m/s, separated by commas, "
                f"or one of {', '.join(PRESETS)}"
            ) from None
        if unit.powers == _NONE:
            raise AtcError(f"units {unit.text!r}: has no dimension")
        if unit.powers in out:
            raise AtcError(f"units: {out[unit.powers].text} and {unit.text} are units of the same thing: give one")
        out[unit.powers] = unit
    return tuple(out.values())


def converted(text: str, wanted: tuple[Unit, ...]) -> tuple[float, str]:
    """The factor and the new unit of values that are in the unit `text`; 1 and `text` where nothing wanted is of that
    dimension. A power of a wanted unit will do: 1/angstrom^3 becomes 1/nm^3 where nm is wanted."""
    try:
        have = unit_of(text)
    except NotAUnit:
        return 1.0, text
    if have.powers == _NONE:
        return 1.0, text
    for unit in wanted:
        if unit.powers == have.powers:
            return have.size / unit.size, unit.text
    for unit in wanted:
        n = _multiple(have.powers, unit.powers)
        if n is not None:
            plain = bool(re.fullmatch(r"[A-Za-zÅµ_]+", unit.text))
            base = unit.text if plain else f"({unit.text})"
            new = f"{base}^{n}" if n > 1 else f"1/{base}" if n == -1 else f"1/{base}^{-n}"
            return have.size / unit.size**n, new
    return 1.0, text


def _multiple(a, b) -> int | None:
    """The whole number n with a = n b, if there is one."""
    ratios = {Fraction(x, y) for x, y in zip(a, b) if y}
    if len(ratios) != 1 or any(x for x, y in zip(a, b) if not y):
        return None
    (n,) = ratios
    return int(n) if n.denominator == 1 and n else None


def in_units(ds, given):
    """A dataset with its variables and coordinates in other units, where something given is of their dimension.

    Parameters
    ----------
    ds : xarray.Dataset whose variables say their ``units``
    given : units with commas between, a list, or a preset (see `PRESETS`); None: as it is

    Raises
    ------
    AtcError for what is no unit, and where nothing in the dataset is of the dimension of one of them.
    """
    if given is None:
        return ds
    wanted = wanted_units(given)
    require_used(wanted, [v.attrs.get("units", "") for v in ds.variables.values()], str(given))
    data: dict = {}
    coords: dict = {}
    for name, v in ds.variables.items():
        factor, text = converted(str(v.attrs.get("units", "")), wanted)
        if factor == 1.0 and text == v.attrs.get("units", ""):
            continue
        new = v.copy(data=v.values * factor)
        new.attrs["units"] = text
        (coords if name in ds.coords else data)[name] = new
    out = ds.assign_coords(coords).assign(data)
    out.attrs = {**ds.attrs, "output_units": ", ".join(u.text for u in wanted)}
    return out


def require_used(wanted, have, given: str) -> None:
    """AtcError where no value could be in any of the units that are wanted."""
    if not any(converted(str(text), wanted) != (1.0, text) or _is(text, wanted) for text in have):
        raise AtcError(
            f"units {given!r}: nothing in this output has the dimension of one of them: it is in "
            f"{', '.join(dict.fromkeys(str(t) for t in have if t and t != '1'))}"
        )


def _is(text, wanted) -> bool:
    try:
        have = unit_of(str(text))
    except NotAUnit:
        return False
    return any(_multiple(have.powers, unit.powers) is not None for unit in wanted if have.powers != _NONE)
