"""Sections of LAMMPS's table files (pairs, bonds, angles, dihedrals): a line with the keyword, a line of parameters
with ``N n``, and n rows of numbers behind an index. Blank lines and # comments anywhere."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..readers.lammps.sections import number_of, shortened
from ..readers.whole import whole_text
from .many_body.parameter_file import units_tag, word_lines

_LARGE = 1e100  # no energy or force of a table is as large


def read_table(path, keyword: str, kind: str, known: dict, columns, where: str = "") -> tuple[dict, np.ndarray]:
    """The parameters {word: its numbers}, and the (n, columns) rows of a section.

    known : {parameter: the names of what follows it}
    columns : function of the parameters, the names of the columns behind the index
    where : the line that names the file

    ``UNITS``, the unit style that the file's first line says (or None), is among the parameters. Raises AtcError for a
    missing file or section, and for a malformed line.
    """
    at = f"{where}: " if where else ""
    text = whole_text(path, f"{kind} table", where)
    lines = word_lines(text)
    start = next((p for p, (_, w) in enumerate(lines) if w[0] == keyword), None)
    if start is None:
        names = [w[0] for _, w in lines if number_of(w[0]) is None and w[0] != "N"]
        raise AtcError(f"{at}{path} has no section {keyword!r}; it has {shortened(', '.join(names)) or 'none'}")
    if start + 1 == len(lines):
        raise AtcError(
            f"{path}:{lines[start][0]}: the section {keyword!r} is empty: expected a parameter line N <number of lines>"
        )
    number, words = lines[start + 1]
    given = _parameters(words, {"N": ("n",), **known})
    if given is None:
        form = " ".join(f"[{' '.join([key, *(f'<{v}>' for v in more)])}]" for key, more in known.items())
        raise AtcError(
            f"{path}:{number}: expected the parameters of a {kind} table, N <n> {form}, got "
            f"{shortened(' '.join(words))!r}"
        )
    (n,), names = given.get("N", (0,)), columns(given)
    if n < 2 or n != int(n):
        raise AtcError(f"{path}:{number}: a {kind} table needs N <number of lines> of at least 2")
    rows, data = lines[start + 2 :], []
    for k in range(int(n)):
        number, words = rows[k] if k < len(rows) else (lines[-1][0], [])
        row = [number_of(w) for w in words[: len(names) + 1]]
        if len(row) <= len(names) or None in row or not max(map(abs, row)) < _LARGE:
            raise AtcError(
                f"{path}:{number}: the section {keyword!r} needs {int(n)} lines of index, {', '.join(names)}; line "
                f"{k + 1} of them is missing or malformed"
            )
        data.append(row[1:])
    return {**given, "UNITS": units_tag(text)}, np.array(data)


def _parameters(words, known) -> dict | None:
    """{parameter: what follows it} of a line; numbers but for names of files. None where something is wrong."""
    given, p = {}, 0
    while p < len(words):
        more = known.get(words[p])
        if more is None or p + len(more) >= len(words):
            return None
        values = words[p + 1 : p + 1 + len(more)]
        given[words[p]] = values if "file" in more else tuple(number_of(w) for w in values)
        if None in given[words[p]] or ("file" not in more and not all(abs(v) < _LARGE for v in given[words[p]])):
            return None
        p += 1 + len(more)
    return given


def same_units(units: str | None, wanted: str | None, path, where: str = "") -> None:
    """Raise AtcError where a table says other units than the model's."""
    if None not in (units, wanted) and units != wanted:
        raise AtcError(
            f"{where + ': ' if where else ''}{path} is in {units!r} units (its UNITS: tag) and the model in "
            f"{wanted!r}: use a table in the model's units"
        )


def spline_through(x, y, slope0: float, slope1: float):
    """The cubic spline through points with given slopes at its ends."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(x, y, bc_type=((1, slope0), (1, slope1)))
