"""Embedded-atom tables as LAMMPS reads them: DYNAMO funcfl (``eam``), setfl (``eam/alloy``) and Finnis-Sinclair setfl
(``eam/fs``)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ...errors import AtcError, AtcWarning
from ...readers.lammps.sections import number_of, shortened, whole_of
from ...readers.whole import whole_text
from .parameter_file import energy_conversion, same_units, word_lines

_LARGE = 1e50  # no number of a potential is as large
# LAMMPS's eV·Å in Hartree·Bohr, three digits, for the effective charges of funcfl files.
_HARTREE_BOHR = 27.2 * 0.529


@dataclass
class EAMTables:
    """Tables at evenly spaced arguments, the first at 0, in the units of the model they are for.

    elements : names. masses : (m,). cutoff : for every pair.
    F_en : (m, n_rho) embedding energy at densities k·drho; rho_eer : (m, m, n_r) [source, host] density that a source
        element makes at a host element at distances k·dr; zr_eer : (m, m, n_r) r·φ(r), symmetric.
    rho_end : the density from which on the embedding energy is continued linearly. rho_first : the density of the first
        point of F.
    u_eer, w_eer : (m, m, n_r) dipole and quadrupole functions of ``adp``, or None. mixing : coefficients of h(x) of
        ``eam/cd``, the constant first, or None
    """

    elements: list[str]
    masses: np.ndarray
    drho: float
    dr: float
    cutoff: float
    F_en: np.ndarray
    rho_eer: np.ndarray
    zr_eer: np.ndarray
    rho_end: float
    rho_first: float = 0.0
    u_eer: np.ndarray | None = None
    w_eer: np.ndarray | None = None
    mixing: np.ndarray | None = None


class _Lines:
    """The lines of a potential file behind its free text, comments removed."""

    def __init__(self, path, header: int, where: str):
        self.text = whole_text(path, "EAM", where)
        self.path = path
        self._said = False
        self.lines = word_lines(self.text, header)
        self.last = len(self.text.splitlines())
        self.p = 0

    def words(self, least: int, what: str) -> tuple[list[str], str]:
        """The next line that is not empty, with at least so many words."""
        if self.p >= len(self.lines):
            raise AtcError(f"{self.path}: ends at line {self.last} where {what} should follow: the file is cut off")
        number, words = self.lines[self.p]
        self.p += 1
        if len(words) < least:
            raise AtcError(f"{self.path}:{number}: expected {what}, got {shortened(' '.join(words))!r}")
        return words, f"{self.path}:{number}"

    def numbers(self, n: int, what: str) -> np.ndarray:
        """The next n numbers, however many to a line."""
        out: list[str] = []
        first = self.lines[self.p][0] if self.p < len(self.lines) else self.last
        while len(out) < n:
            if self.p >= len(self.lines):
                raise AtcError(
                    f"{self.path}: ends after {len(out)} of the {n} numbers of {what} (from line {first}): the file "
                    "is cut off"
                )
            out += self.lines[self.p][1]
            self.p += 1
        if len(out) > n:
            number = self.lines[self.p - 1][0]
            complaint = f"{what} has {len(out)} numbers where its table (from line {first}) should have {n}"
            if None in map(number_of, out):
                raise AtcError(f"{self.path}:{number}: {complaint}")  # another line of the format
            self.surplus(complaint, number)
            out = out[:n]
        try:
            a = np.array(out, dtype=np.float64)
        except ValueError:
            bad = next(w for w in out if number_of(w) is None)
            raise AtcError(f"{self.path}: {shortened(bad)!r} in {what} (from line {first}) is not a number") from None
        if not np.isfinite(a).all():
            raise AtcError(f"{self.path}: {what} (from line {first}) holds numbers that are not finite")
        if not (np.abs(a) < _LARGE).all():
            raise AtcError(
                f"{self.path}: {what} (from line {first}) holds {a[np.argmax(np.abs(a))]:g}, which is no number of a "
                "potential"
            )
        return a

    def surplus(self, what: str, line: int) -> None:
        """Say once that the file has more values than its tables take."""
        if not self._said:
            warnings.warn(
                f"{self.path}:{line}: {what}: those behind are left out, as by LAMMPS; is the file damaged?",
                AtcWarning,
                stacklevel=5,
            )
        self._said = True

    def room_for(self, count: int, at: str) -> None:
        """Refuse tables that a file of this length cannot hold, before memory is taken for them."""
        if count > len(self.text):
            raise AtcError(
                f"{at}: tables of {count} numbers in a file of {len(self.text)} characters: the file is cut off or "
                "its counts are wrong"
            )

    def end(self, limit: int, complaint: str) -> None:
        """What follows the last table: LAMMPS does not look at it; a whole table more is another format."""
        if self.p >= len(self.lines):
            return
        number = self.lines[self.p][0]
        if sum(len(w) for _, w in self.lines[self.p :]) >= limit:
            raise AtcError(f"{self.path}:{number}: {complaint}")
        self.surplus("lines behind the last table", number)


def _grid(words, where):
    """nrho drho nr dr cutoff"""
    (nrho, nr), (drho, dr, cut) = map(whole_of, words[:3:2]), map(number_of, (words[1], words[3], words[4]))
    if None in (nrho, drho, nr, dr, cut):
        raise AtcError(f"{where}: expected nrho drho nr dr cutoff, got {shortened(' '.join(words))!r}")
    # LAMMPS's spline takes differences over five points.
    if nrho < 5 or nr < 5 or not all(1 / _LARGE < v < _LARGE for v in (drho, dr, cut)):
        raise AtcError(
            f"{where}: nrho and nr must be at least 5, drho, dr and the cutoff positive, got {' '.join(words[:5])!r}"
        )
    return nrho, drho, nr, dr, cut


def _mass(words, where):
    mass = number_of(words[1])
    if mass is None:
        raise AtcError(f"{where}: expected the atomic number and the mass, got {shortened(' '.join(words))!r}")
    return mass


def read_setfl(
    path,
    units_name: str,
    finnis_sinclair: bool = False,
    where: str = "",
    *,
    helium: bool = False,
    angular: bool = False,
    mixing: bool = False,
) -> EAMTables:
    """A setfl file: embedding energies and densities by element (Finnis-Sinclair: densities by pair of elements), r·φ
    by pair.

    helium : LAMMPS's ``eam/he``: the fifth line ends with the density of the last point of F, and the first may be
        negative
    angular : LAMMPS's ``adp``: dipole and quadrupole functions by pair follow
    mixing : LAMMPS's ``eam/cd``: a comment and a polynomial of the concentration follow

    units_name : unit style the result is wanted in; the file's ``UNITS:`` tag is converted between metal and real as
        LAMMPS means
        to (its setfl readers leave out the last entry of each table)
    where : file and line that named this file, for messages

    Raises
    ------
    AtcError for a missing, malformed or truncated file.
    """
    f = _Lines(path, 3, where)
    if angular:
        same_units(f.text, units_name, path, "adp")
    factor = energy_conversion(f.text, units_name, path)
    words, at = f.words(2, "the number of elements and their names")
    m = whole_of(words[0])
    if m is None or m < 1:
        raise AtcError(f"{at}: expected the number of elements and their names, got {shortened(' '.join(words))!r}")
    if len(words) != m + 1:
        raise AtcError(f"{at}: {m} elements but {len(words) - 1} names")
    elements = words[1:]
    words, at = f.words(6 if helium else 5, "nrho drho nr dr cutoff" + (" rhomax" if helium else ""))
    nrho, drho, nr, dr, cut = _grid(words, at)
    rho_end = (nrho - 1) * drho
    if helium:
        if number_of(words[5]) is None:
            raise AtcError(f"{at}: expected the largest density rhomax at the end, got {words[5]!r}")
        rho_end = float(words[5])
    f.room_for(m * (nrho + nr) + m * (m - 1) * nr // 2, at)
    masses, F = np.zeros(m), np.zeros((m, nrho))
    rho, zr = np.zeros((m, m, nr)), np.zeros((m, m, nr))
    for a, e in enumerate(elements):
        masses[a] = _mass(*f.words(2, f"the atomic number and mass of {e}"))
        F[a] = f.numbers(nrho, f"the embedding energy of {e}") * factor
        if finnis_sinclair:
            for b in range(m):
                rho[a, b] = f.numbers(nr, f"the density of {e} at {elements[b]}")
        else:
            rho[a, :] = f.numbers(nr, f"the density of {e}")
    for a in range(m):
        for b in range(a + 1):
            zr[a, b] = zr[b, a] = f.numbers(nr, f"the pair energy of {elements[a]} and {elements[b]}") * factor
    more: list = [None, None]
    for k, what in enumerate(("dipole", "quadrupole") if angular else ()):
        more[k] = np.zeros((m, m, nr))
        for a in range(m):
            for b in range(a + 1):
                more[k][a, b] = more[k][b, a] = f.numbers(nr, f"the {what} function of {elements[a]} and {elements[b]}")
    h = _polynomial(f) if mixing else None
    hint = "; is it a Finnis-Sinclair file (eam/fs)?" if not finnis_sinclair and m > 1 else ""
    f.end(nr, f"more lines than {'eam/fs' if finnis_sinclair else 'eam/alloy'} files of {m} elements have{hint}")
    rho_first = rho_end - (nrho - 1) * drho if helium else 0.0
    return EAMTables(elements, masses, drho, dr, cut, F, rho, zr, rho_end, rho_first, *more, h)


def _polynomial(f: _Lines) -> np.ndarray:
    """The last line: degree and coefficients; a comment may stand in front of it."""
    if len(f.lines) - f.p == 2:
        f.p += 1
    words, at = f.words(2, "the degree and the coefficients of h(x)")
    if not words[0].isdigit() or len(words) < int(words[0]) + 2 or None in map(number_of, words):
        raise AtcError(f"{at}: expected the degree and the coefficients of h(x), got {' '.join(words)!r}")
    return np.array([float(w) for w in words[1 : int(words[0]) + 2]])


def read_funcfl(paths, units_name: str, where: str = "") -> EAMTables:
    """Single-element funcfl files brought onto one grid as LAMMPS does (four-point interpolation; φ from the product of
    effective charges).

    The elements are named 0, 1, .. in the order of `paths`. See `read_setfl` for the rest.
    """
    files = []
    for path in paths:
        f = _Lines(path, 1, where)
        factor = energy_conversion(f.text, units_name, path)
        mass = _mass(*f.words(2, "the atomic number and mass"))
        nrho, drho, nr, dr, cut = _grid(*f.words(5, "nrho drho nr dr cutoff"))
        F = f.numbers(nrho, "the embedding energy") * factor
        z = f.numbers(nr, "the effective charge") * np.sqrt(factor)
        rho = f.numbers(nr, "the density")
        f.end(nr, "more lines than a funcfl file has; is it a setfl file (eam/alloy)?")
        files.append((mass, drho, dr, cut, F, z, rho))
    drho, dr = max(f[1] for f in files), max(f[2] for f in files)
    rmax = max((len(f[5]) - 1) * f[2] for f in files)
    rho_end = max((len(f[4]) - 1) * f[1] for f in files)
    nr, nrho = int(rmax / dr + 0.5), int(rho_end / drho + 0.5)
    m = len(files)
    r, d = np.arange(nr) * dr, np.arange(nrho) * drho
    F, rho, zr = np.zeros((m, nrho)), np.zeros((m, m, nr)), np.zeros((m, m, nr))
    z = [_four_points(r, f[2], f[5]) for f in files]
    for a, f in enumerate(files):
        F[a] = _four_points(d, f[1], f[4])
        rho[a, :] = _four_points(r, f[2], f[6])
        for b in range(m):
            zr[a, b] = _HARTREE_BOHR * z[max(a, b)] * z[min(a, b)]
    names, masses, cutoff = [str(k) for k in range(m)], np.array([f[0] for f in files]), max(f[3] for f in files)
    return EAMTables(names, masses, drho, dr, cutoff, F, rho, zr, rho_end)


def _four_points(x, step, table):
    """Cubic Lagrange interpolation through four points of a table that starts at 0 (LAMMPS PairEAM::file2array)."""
    p = x / step + 1.0
    k = np.clip(p.astype(np.int64), 2, len(table) - 2)
    p = np.minimum(p - k, 2.0)
    return (
        -p * (p - 1.0) * (p - 2.0) / 6.0 * table[k - 2]
        + 0.5 * (p * p - 1.0) * (p - 2.0) * table[k - 1]
        - 0.5 * p * (p + 1.0) * (p - 2.0) * table[k]
        + p * (p * p - 1.0) / 6.0 * table[k + 1]
    )
