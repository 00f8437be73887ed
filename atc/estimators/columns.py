"""Fields of what a trajectory carries for each atom: any column as density, mean or mass-weighted mean.

``column:c_pe`` is the density Σ a φ of the column c_pe, ``column:c_pe:mean`` its mean Σ a φ/Σ φ, and
``column:c_pe:mass_mean`` its mean by mass Σ m a φ/Σ m φ. Values are as the file has them, in whatever unit it wrote;
columns that frames know by a meaning (q, mass, vx, fx ...) are in the trajectory's.
"""

from __future__ import annotations

import re

import numpy as np

from ..errors import AtcError

PREFIX = "column:"
#: How the atoms' values make a field.
WAYS = ("density", "mean", "mass_mean")
# Columns that frames have under another name: the attribute, the component, the dimension.
_KNOWN = {
    "q": ("charges", None, "charge"),
    "mass": ("masses", None, "mass"),
    **{f"v{a}": ("velocities", k, "velocity") for k, a in enumerate("xyz")},
    **{f"f{a}": ("forces", k, "force") for k, a in enumerate("xyz")},
}
_INDEXED = re.compile(r"(.+)\[(\d+)\]")


def is_column(name) -> bool:
    """Whether a quantity, or a sum of one, is of a column of the trajectory."""
    return isinstance(name, str) and name.startswith(PREFIX)


def split(name: str) -> tuple[str, str]:
    """The column and the way of ``column:<column>[:<way>]``.

    Raises
    ------
    AtcError : if there is no column, or no such way
    """
    column, _, way = name[len(PREFIX) :].partition(":")
    way = way or "density"
    if not column.strip():
        raise AtcError(f"quantity {name!r}: expected the name of a column of the dump, e.g. column:c_pe")
    if way not in WAYS:
        raise AtcError(f"quantity {name!r}: expected {' or '.join(f'{PREFIX}{column}:{w}' for w in WAYS)}")
    return column, way


def values(frame, column: str, why: str = "") -> np.ndarray:
    """(n,) the column's number of every atom, as the trajectory has it (user's units).

    Raises
    ------
    AtcError : if the frame has no such column, or it holds anything but finite numbers
    """
    why = why or f"{PREFIX}{column}"
    a = frame.extra.get(column)
    if a is None and (indexed := _INDEXED.fullmatch(column)) and indexed.group(1) in frame.extra:
        all_nk = np.asarray(frame.extra[indexed.group(1)])
        k = int(indexed.group(2))
        if all_nk.ndim == 2 and 1 <= k <= all_nk.shape[1]:
            a = all_nk[:, k - 1]
    if a is None and column in _KNOWN:
        attribute, component, dimension = _KNOWN[column]
        known = getattr(frame, attribute)
        if known is not None:
            a = frame.units.to_user(dimension, known if component is None else known[:, component])
    if a is None:
        have = ", ".join([*sorted(map(str, frame.extra)), *(c for c, (at, *_) in _KNOWN.items() if _has(frame, at))])
        raise AtcError(f"{frame.source}: there is no column {column!r} for {why}; it has {have or 'none'}")
    a = np.asarray(a)
    if a.ndim == 2 and a.shape[1] > 1:
        raise AtcError(
            f"{frame.source}: {column!r} has {a.shape[1]} components: ask for one, {PREFIX}{column}[1] to "
            f"{PREFIX}{column}[{a.shape[1]}]"
        )
    if a.dtype.kind not in "fiub":
        raise AtcError(f"{frame.source}: column {column!r} holds words, not numbers: there is no field of it")
    a = a.reshape(len(frame)).astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(a))
    if len(bad):
        raise AtcError(
            f"{frame.source}: column {column!r} of atom {frame.ids[bad[0]]} is {a[bad[0]]}, no finite number"
        )
    return a


def _has(frame, attribute) -> bool:
    return getattr(frame, attribute) is not None


def factor(frame, name: str) -> np.ndarray:
    """(n, 1) the factor of a site sum: ``column:c_pe``, or ``column:c_pe*mass``."""
    column, times, _ = name[len(PREFIX) :].partition("*mass")
    a_n1 = values(frame, column)[:, None]
    return a_n1 * frame.masses[:, None] if times else a_n1


def unit_of(column: str, units, given: dict | None = None) -> str:
    """What the column's values are measured in: what was given, what its meaning says, else words."""
    if given and column in given:
        return str(given[column])
    if column in _KNOWN:
        return units.label(_KNOWN[column][2])
    return f"({column})"


def label(name: str, units, given: dict | None = None) -> str:
    """The unit of the field called `name`."""
    column, way = split(name)
    unit = unit_of(column, units, given)
    if way != "density":
        return unit
    volume = units.label("volume")
    # What is a pressure times a volume for each atom (LAMMPS's stress/atom) is a pressure as a density.
    if unit.endswith(f"*{volume}"):
        return unit[: -len(volume) - 1]
    return f"{unit}/{volume}" if unit not in ("1", "") else units.label("number_density")
