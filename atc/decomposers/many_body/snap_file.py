"""The two files of a SNAP potential: coefficients by element, and what the bispectrum is made with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...readers.lammps.sections import shortened
from ...readers.whole import whole_text
from .elements import require_known
from .parameter_file import number, same_units, word_lines
from .snap_tables import triples

#: Keys of the parameter file and their defaults (None: required), by what their values are.
_NUMBERS = {"rcutfac": None, "rfac0": 0.99363, "rmin0": 0.0}
_FLAGS = {
    "switchflag": 1, "bzeroflag": 1, "quadraticflag": 0, "chemflag": 0, "bnormflag": 0, "wselfallflag": 0,
    "switchinnerflag": 0,
}  # fmt: skip
#: Of the KOKKOS package: how work is cut into pieces.
_IGNORED = ("chunksize", "parallelthresh")
#: Above which the list of products alone takes gigabytes.
_MOST = 20
#: Of the largest: files are printed with so many digits.
_ALIKE = 1e-7


@dataclass
class SNAPFile:
    """What the files say, lengths and energies in their units. t elements, k components.

    Attributes
    ----------
    names : (t,) elements
    radius, share : (t,) R and w; r_c = rcutfac (R + R)
    constant : (t,) the energy of B = 0. beta : (t, k). alpha : (t, k, k), symmetric, or (t, 0, 0)
    top : twojmax. inner, half : (t,) middle and half width of the inner switch
    rcutfac, rfac0, rmin0 and the flags as in the file
    """

    names: tuple[str, ...]
    radius: np.ndarray
    share: np.ndarray
    constant: np.ndarray
    beta: np.ndarray
    alpha: np.ndarray
    top: int
    rcutfac: float
    rfac0: float
    rmin0: float
    flags: dict = field(default_factory=dict)
    inner: np.ndarray | None = None
    half: np.ndarray | None = None


def read_snap(coefficients, parameters, elements=None, units_name: str = "metal", where: str = "") -> SNAPFile:
    """Read ``*.snapcoeff`` and ``*.snapparam``.

    Parameters
    ----------
    elements : those in use, in the order in which the ``pair_coeff`` line first names them. It is this order, not that
        of the coefficient file, that the labels of components and the lists of the inner switch count them by. Default:
        all, in the file's order.
    units_name : the model's. where : the line that named the files, for messages

    Raises
    ------
    AtcError that names file and line: missing files and keys, numbers that are none, counts that do not fit twojmax,
    other units than the model's, elements that are not there.
    """
    names, radius, share, rows = _coefficients(coefficients, units_name, where)
    values, lists = _parameters(parameters, units_name, where)
    flags = {key: values[key] for key in _FLAGS}
    if elements is not None:
        require_known(elements, names, coefficients, where)
        if flags["chemflag"] and len(elements) < len(names):
            raise AtcError(
                f"{where or coefficients}: with chemflag every element of {coefficients} ({', '.join(names)}) must be "
                "one of the atom types"
            )
        order = [names.index(e) for e in elements]
        names, radius, share, rows = tuple(elements), radius[order], share[order], rows[order]
    t, k = len(names), len(triples(values["twojmax"]))
    k *= t**3 if flags["chemflag"] else 1
    wants = 1 + k + (k * (k + 1) // 2 if flags["quadraticflag"] else 0)
    if rows.shape[1] != wants:
        raise AtcError(
            f"{coefficients}: {rows.shape[1]} coefficients of each element, where {Path(parameters).name} (twojmax "
            f"{values['twojmax']}, quadraticflag {flags['quadraticflag']}, chemflag {flags['chemflag']}) wants {wants}"
        )
    beta = np.ascontiguousarray(rows[:, 1 : 1 + k])
    alpha = np.zeros((t, 0, 0))
    if flags["quadraticflag"]:
        alpha = np.zeros((t, k, k))
        i, j = np.triu_indices(k)
        alpha[:, i, j] = alpha[:, j, i] = rows[:, 1 + k :]
    if flags["chemflag"]:
        _require_alike(beta, alpha, values["twojmax"], t, coefficients)
    inner = half = np.zeros(t)
    if flags["switchinnerflag"]:
        for key in ("sinner", "dinner"):
            if len(lists.get(key, ())) != t:
                raise AtcError(
                    f"{parameters}: switchinnerflag 1 needs {key} and a number for each of the {t} elements in use"
                )
        inner, half = np.array(lists["sinner"]), np.array(lists["dinner"])
        if not (half > 0).all():
            raise AtcError(f"{parameters}: dinner must be positive")
    elif lists:
        raise AtcError(f"{parameters}: {next(iter(lists))} goes with switchinnerflag 1")
    rc = values["rcutfac"] * 2 * radius.min()
    if not 0 <= values["rmin0"] < rc:
        raise AtcError(f"{parameters}: expected rmin0 of 0 or more and below the cutoff {rc:g}")
    return SNAPFile(
        names,
        radius,
        share,
        rows[:, 0],
        beta,
        alpha,
        values["twojmax"],
        values["rcutfac"],
        values["rfac0"],
        values["rmin0"],
        flags,
        inner,
        half,
    )


def _require_alike(beta, alpha, top, t, path):
    """Some components are the same product of densities (in B_1½½, that of two elements is either first), and LAMMPS's
    forces take the coefficient of one of them for all: they are the gradient of its energy where those are alike."""
    places: dict[tuple, list] = {}
    for at, (label, (k, n)) in enumerate((c, kn) for c in np.ndindex(t, t, t) for kn in enumerate(triples(top))):
        places.setdefault((k, *sorted(zip(n, label))), []).append(at)
    same = list(places.values())
    columns = [beta[:, :, None]]
    if alpha.size:
        columns.append(np.stack([alpha[:, :, at].sum(-1) for at in same], axis=-1))
    for c in columns:
        apart = max(np.ptp(c[:, at], axis=1).max() for at in same)
        if apart > _ALIKE * np.abs(c).max():
            raise AtcError(
                f"{path}: with chemflag, coefficients of the same product of densities differ from one another by up "
                f"to {apart:.2g}: LAMMPS's forces are not the gradient of such an energy; give each the mean of them"
            )


def _lines(path, what, units_name, where):
    """(line number, words) of all lines that say something."""
    text = whole_text(path, what, where)
    same_units(text, units_name, path, "SNAP")
    return word_lines(text)


def _coefficients(path, units_name, where):
    lines = _lines(path, "SNAP coefficient", units_name, where)

    def line(k, wants, count):
        if k >= len(lines):
            raise AtcError(f"{path}: the file ends where {wants} is expected")
        at, words = lines[k]
        if len(words) != count:
            raise AtcError(f"{path}:{at}: expected {wants}, got {shortened(' '.join(words))!r}")
        return at, words

    at, words = line(0, "the numbers of elements and of coefficients", 2)
    if not all(w.isdigit() and int(w) > 0 for w in words):
        raise AtcError(f"{path}:{at}: expected the numbers of elements and of coefficients, got {' '.join(words)!r}")
    t, count = map(int, words)
    names, radius, share, rows = [], [], [], []
    for e in range(t):
        k = 1 + e * (count + 1)
        at, words = line(k, "an element, its radius and its weight", 3)
        names.append(words[0])
        radius.append(number(words[1], "the radius", f"{path}:{at}", positive=True))
        share.append(number(words[2], "the weight", f"{path}:{at}"))
        row = (line(k + 1 + m, f"a coefficient of {words[0]}", 1) for m in range(count))
        rows.append([number(word, "a coefficient", f"{path}:{at}") for at, (word,) in row])
    if len(lines) > 1 + t * (count + 1):
        raise AtcError(
            f"{path}:{lines[1 + t * (count + 1)][0]}: more lines than {t} elements with {count} coefficients have"
        )
    if len(set(names)) < t:
        raise AtcError(f"{path}: an element occurs twice among {', '.join(names)}")
    return tuple(names), np.array(radius), np.array(share), np.array(rows)


def _parameters(path, units_name, where):
    values: dict = {}
    lists: dict = {}
    for at, words in _lines(path, "SNAP parameter", units_name, where):
        key = words[0]
        if key in _IGNORED:
            continue
        if key in ("sinner", "dinner"):
            lists[key] = [number(w, key, f"{path}:{at}") for w in words[1:]]
            continue
        if key not in _NUMBERS and key not in _FLAGS and key != "twojmax":
            known = ", ".join(["twojmax", *_NUMBERS, *_FLAGS, "sinner", "dinner"])
            raise AtcError(f"{path}:{at}: unknown key {shortened(key)!r}: expected one of {known}")
        if len(words) != 2:
            raise AtcError(f"{path}:{at}: expected one value behind {key}, got {shortened(' '.join(words[1:]))!r}")
        if key in _NUMBERS:
            values[key] = number(words[1], key, f"{path}:{at}", positive=key != "rmin0")
        elif key == "twojmax":
            if not words[1].isdigit() or int(words[1]) > _MOST:
                raise AtcError(f"{path}:{at}: expected a whole number from 0 to {_MOST} for twojmax, got {words[1]!r}")
            values[key] = int(words[1])
        elif words[1] not in ("0", "1"):
            raise AtcError(f"{path}:{at}: expected 0 or 1 for {key}, got {shortened(words[1])!r}")
        else:
            values[key] = int(words[1])
    for key in ("rcutfac", "twojmax"):
        if key not in values:
            raise AtcError(f"{path}: {key} is missing")
    return {**_NUMBERS, **_FLAGS, **values}, lists
