"""MEAM's two files as LAMMPS reads them: the library of elements, and the parameter file that sets what elements have
between them."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...errors import AtcError, AtcWarning
from ...readers.lammps.sections import number_of
from .elements import require_known
from .parameter_file import entries_of, number, numbers, read_parameter_file, same_units

LATTICES = ("fcc", "bcc", "hcp", "dia", "sc", "dim", "b1", "b2", "l12")
_LIBRARY = tuple("z ielement atwt alpha b0 b1 b2 b3 alat esub asub t0 t1 t2 t3 rozero ibar".split())
_WORDS = 2 + len(_LIBRARY)
# LAMMPS's default skin in Å: its screening looks at the neighbours within rc and this.
_SKIN = 2.0
_FORMS = (-5, 0, 1, 3, 4)
_NAMES_OF_SCALARS = tuple("rc delr gsmooth_factor augt1 ialloy mixture_ref_t erose_form emb_lin_neg bkgd_dyn".split())
_INDICES = {"rho0": 1, "Cmin": 3, "Cmax": 3} | dict.fromkeys(
    ("Ec", "delta", "alpha", "re", "lattce", "nn2", "attrac", "repuls", "zbl"), 2
)
_LINE = re.compile(r"^(\w+)\s*(?:\(([^()]*)\))?\s*=\s*(.*)$")
#: Nearest-neighbour distance over lattice constant.
_NEAREST = {
    "fcc": 0.5**0.5, "bcc": 0.75**0.5, "dia": 0.1875**0.5, "hcp": 1.0, "dim": 1.0, "sc": 1.0, "b1": 0.5,
    "b2": 0.75**0.5,
}  # fmt: skip


@dataclass
class MEAMParameters:
    """What a MEAM potential is made of, for elements in the order in which the library's were named; in the file's
    units.

    names, Z (neighbours in the reference structure), number (atomic), ibar : by element. beta_ek (m, 4), t_ek (m, 4; t0
    = 1, t1 with its augmentation), rho0_e, A_e.
    lattice, Ec, alpha, re, attrac, repuls, nn2, zbl : (m, m) by pair, symmetric. Cmin, Cmax : (m, m, m), the pair's two
        elements first, symmetric in those.
    """

    names: list[str]
    Z: np.ndarray
    number: np.ndarray
    ibar: np.ndarray
    beta_ek: np.ndarray
    t_ek: np.ndarray
    rho0_e: np.ndarray
    A_e: np.ndarray
    lattice: list[list[str]]
    Ec: np.ndarray
    alpha: np.ndarray
    re: np.ndarray
    attrac: np.ndarray
    repuls: np.ndarray
    nn2: np.ndarray
    zbl: np.ndarray
    Cmin: np.ndarray
    Cmax: np.ndarray
    rc: float = 4.0
    delr: float = 0.1
    gsmooth_factor: float = 99.0
    ialloy: int = 0
    erose_form: int = 0
    emb_lin_neg: int = 0
    bkgd_dyn: int = 0
    mass_e: np.ndarray | None = None


def library_elements(text: str, path) -> dict[str, tuple[str, list[str]]]:
    """{element: (where, its 18 other words)} of a library file, of several entries for an element the first."""
    out: dict[str, tuple[str, list[str]]] = {}
    for at, words in entries_of(text, path, _WORDS, "MEAM library", f"elt lat {' '.join(_LIBRARY)}"):
        name, *more = (w.strip("'\"") for w in words)
        out.setdefault(name, (at, more))
    return out


def read_meam(library, names, parameters=None, units_name: str = "metal", where: str = "") -> MEAMParameters:
    """A MEAM potential from LAMMPS's two files.

    Parameters
    ----------
    library : path. names : the elements to take from it, in the order that the indices of the parameter file count.
    parameters : path of the parameter file, or None
    units_name : a ``UNITS:`` tag that differs is refused, as in LAMMPS
    where : file and line that named these, for messages

    Raises
    ------
    AtcError for missing or malformed files, unknown keywords, what is not supported (see `meam.MEAM`).
    """
    text = read_parameter_file(library, "MEAM library", where)
    same_units(text, units_name, library, "MEAM")
    known = library_elements(text, library)
    rows, lat = [], []
    require_known(names, known, library, where)
    for name in names:
        at, (lattice, *words) = known[name]
        lat.append(_lattice(lattice, at))
        rows.append(numbers(words, _LIBRARY, at))
    v = dict(zip(_LIBRARY, np.array(rows).T, strict=True))
    m = len(names)
    for e, name in enumerate(names):
        at = known[name][0]
        if lat[e] not in _NEAREST or lat[e] in ("b1", "b2"):
            raise AtcError(
                f"{at}: the reference structure {lat[e]} of an element is not supported: expected fcc, bcc, hcp, dia, "
                "sc or dim"
            )
        if v["t0"][e] != 1.0:
            raise AtcError(f"{at}: t0 must be 1, got {v['t0'][e]:g}")
        if v["ibar"][e] not in _FORMS:
            raise AtcError(f"{at}: ibar must be one of {', '.join(map(str, _FORMS))}, got {v['ibar'][e]:g}")
        if v["z"][e] != {"fcc": 12, "bcc": 8, "hcp": 12, "dia": 4, "sc": 6, "dim": 1}[lat[e]]:
            raise AtcError(f"{at}: z is {v['z'][e]:g}, but atoms of {lat[e]} have another number of neighbours")
    own: dict[str, dict] = {k: {} for k in _INDICES}
    scalars = {
        "rc": 4.0, "delr": 0.1, "gsmooth_factor": 99.0, "augt1": 1, "ialloy": 0, "mixture_ref_t": 0, "erose_form": 0,
        "emb_lin_neg": 0, "bkgd_dyn": 0,
    }  # fmt: skip
    if parameters is not None:
        _read_settings(parameters, m, own, scalars, units_name, where)
    source = parameters or library
    t = np.stack([v["t0"], v["t1"] + (0.6 * v["t3"] if scalars.pop("augt1") else 0.0), v["t2"], v["t3"]], axis=1)
    if scalars.pop("mixture_ref_t"):
        raise AtcError(
            f"{source}: mixture_ref_t = 1 is not supported: LAMMPS's manual calls its results demonstrably incorrect; "
            "leave it out"
        )
    rho0 = v["rozero"].copy()
    for (e,), value in own["rho0"].items():
        rho0[e] = value

    def pairs(key, default):
        a = np.full((m, m), default, float)
        for (i, j), value in own[key].items():
            a[i, j] = a[j, i] = value
        return a

    lattice = [["" if i != j else lat[i] for j in range(m)] for i in range(m)]
    for (i, j), value in own["lattce"].items():
        lattice[i][j] = lattice[j][i] = value
    Ec, alpha, re = pairs("Ec", 0.0), pairs("alpha", 0.0), pairs("re", 0.0)
    delta = pairs("delta", 0.0)
    for e in range(m):
        if lattice[e][e] not in _NEAREST or lattice[e][e] in ("b1", "b2"):
            raise AtcError(f"{source}: lattce({e + 1},{e + 1}) = {lattice[e][e]!r} is not a structure of one element")
        Ec[e, e] = own["Ec"].get((e, e), v["esub"][e])
        alpha[e, e] = own["alpha"].get((e, e), v["alpha"][e])
        re[e, e] = own["re"].get((e, e), v["alat"][e] * _NEAREST[lattice[e][e]])
    for i, j in product(range(m), repeat=2):
        if i >= j:
            continue
        if not lattice[i][j]:
            lattice[i][j] = lattice[j][i] = "fcc"
            warnings.warn(
                f"{source}: no lattce({i + 1},{j + 1}): the reference structure of {names[i]} and {names[j]} is taken "
                "to be fcc, as LAMMPS does",
                AtcWarning,
                stacklevel=4,
            )
        if Ec[i, j] == 0.0:
            w = 0.75 if lattice[i][j] == "l12" else 0.5
            Ec[i, j] = Ec[j, i] = w * Ec[i, i] + (1 - w) * Ec[j, j] - delta[i, j]
        if alpha[i, j] == 0.0:
            alpha[i, j] = alpha[j, i] = 0.5 * (alpha[i, i] + alpha[j, j])
        if re[i, j] == 0.0:
            re[i, j] = re[j, i] = 0.5 * (re[i, i] + re[j, j])
    Cmin, Cmax = np.full((m, m, m), 2.0), np.full((m, m, m), 2.8)
    for C, key in ((Cmin, "Cmin"), (Cmax, "Cmax")):
        for (i, j, k), value in own[key].items():
            C[i, j, k] = C[j, i, k] = value
    if not (Cmax > Cmin).all():
        i, j, k = (int(x) + 1 for x in np.argwhere(~(Cmax > Cmin))[0])
        raise AtcError(f"{source}: Cmax({i},{j},{k}) must be larger than Cmin({i},{j},{k})")
    if not (scalars["rc"] > 0 and scalars["delr"] > 0):
        raise AtcError(f"{source}: rc and delr must be positive, got {scalars['rc']:g} and {scalars['delr']:g}")
    C = max(float(Cmax.max()), 2.0)
    if scalars["rc"] * 0.5 * C / (C - 1.0) ** 0.5 > scalars["rc"] + _SKIN:
        raise AtcError(
            f"{source}: with Cmax {C:g} atoms screen from so far away that LAMMPS's own result depends on the skin of "
            "its neighbour list: make it smaller"
        )
    return MEAMParameters(
        list(names),
        v["z"],
        v["ielement"],
        v["ibar"].astype(int),
        np.stack([v["b0"], v["b1"], v["b2"], v["b3"]], axis=1),
        t,
        rho0,
        v["asub"],
        lattice,
        Ec,
        alpha,
        re,
        pairs("attrac", 0.0),
        pairs("repuls", 0.0),
        pairs("nn2", 0).astype(bool),
        pairs("zbl", 1).astype(bool),
        Cmin,
        Cmax,
        mass_e=v["atwt"],
        **scalars,
    )


def _lattice(word, at) -> str:
    word = word.lower()
    if word not in LATTICES:
        raise AtcError(
            f"{at}: the reference structure {word!r} is not supported: expected one of {', '.join(LATTICES)}"
        )
    return word


def _read_settings(path, m, own, scalars, units_name, where):
    text = read_parameter_file(path, "MEAM parameter", where)
    same_units(text, units_name, path, "MEAM")
    # What is given for (J, I), J > I, LAMMPS reads and never uses, but for nn2 and zbl.
    ignored: dict[tuple, tuple[str, str, str]] = {}
    for k, line in enumerate(text.splitlines(), 1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        at = f"{path}:{k}"
        match = _LINE.match(line)
        if not match or not match[3].split():
            raise AtcError(
                f"{at}: expected keyword = value or keyword(I,J) = value in a MEAM parameter file, got {line!r}"
            )
        key, index, value = match[1], match[2], match[3].split()[0].strip("'\"")
        if key in _NAMES_OF_SCALARS:
            if index is not None:
                raise AtcError(f"{at}: {key} has no indices, got {line!r}")
            scalars[key] = number(value, key, at) if isinstance(scalars[key], float) else _choice(key, value, at)
            continue
        if key not in _INDICES:
            raise AtcError(
                f"{at}: unknown or unsupported MEAM keyword {key!r}: expected one of "
                f"{', '.join((*_NAMES_OF_SCALARS, *_INDICES))}"
            )
        words = (index or "").split(",")
        if len(words) != _INDICES[key] or not all(w.strip().isdigit() and 1 <= int(w) <= m for w in words):
            raise AtcError(f"{at}: {key} takes {_INDICES[key]} element numbers between 1 and {m}, got {line!r}")
        i = tuple(int(w) - 1 for w in words)
        if len(i) > 1 and i[0] > i[1]:
            swapped = (i[1], i[0], *i[2:])
            if key in ("nn2", "zbl"):
                i = swapped
            else:
                ignored[key, swapped] = at, index, value
                continue
        if key == "lattce":
            own[key][i] = _lattice(value, at)
        elif key in ("nn2", "zbl"):
            own[key][i] = _choice(key, value, at)
        else:
            own[key][i] = number(value, key, at)
    for (key, i), (at, index, value) in ignored.items():
        used = own[key].get(i)
        if str(used) != value and (used is None or number_of(value) != used):
            pair = ",".join(str(k + 1) for k in i)
            warnings.warn(
                f"{at}: LAMMPS does not use {key}({index}) = {value} but {key}({pair}), and so does this",
                AtcWarning,
                stacklevel=5,
            )


def _choice(key, value, at) -> int:
    choices = {"ialloy": (0, 1, 2), "erose_form": (0, 1, 2)}.get(key, (0, 1))
    v = number(value, key, at)
    if v not in choices:
        raise AtcError(f"{at}: {key} must be one of {', '.join(map(str, choices))}, got {value}")
    return int(v)
