"""Tabulated torsions: LAMMPS's cyclic table files and its two-step interpolation (file → N even points → linear or
spline).

A torsion is a function of distances only if its table has the same energy at φ and −φ (and opposite forces): others are
refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ...units import units as system
from ..table_file import read_table, same_units
from .dihedral import _MIRROR, CurveTorsion
from .dihedral_chain import Chain, CoupledTorsion
from .table import table_options

#: how far from even a table may be, relative to the range of its values
_EVEN = 1e-10
#: below this sine, force/sin φ is the force's slope at the plane
_PLANE = 1e-5


@dataclass
class TorsionSection:
    """One section of a table file: angles (radians), energies, forces −dE/dφ per radian or None (NOF), in the file's
    energy unit."""

    phi: np.ndarray
    energy: np.ndarray
    force: np.ndarray | None


def read_torsion_section(path, keyword: str, where: str = "", units_name: str | None = None) -> TorsionSection:
    """The section `keyword` of a LAMMPS dihedral table file.

    Format: a line with the keyword; a line ``N n [NOF] [DEGREES|RADIANS] [CHECKU file] [CHECKF file]`` in any order; n
    lines ``index φ energy [force]``. Angles are in degrees and forces per degree unless RADIANS is said.

    Raises
    ------
    AtcError for a missing file or section, other units, a malformed line, or angles that do not increase within less
    than a turn.
    """
    known = {"NOF": (), "DEGREES": (), "RADIANS": (), "CHECKU": ("file",), "CHECKF": ("file",)}
    given, data = read_table(
        path, keyword, "dihedral", known, lambda given: ("phi", "energy", "force")[: 3 - ("NOF" in given)], where
    )
    same_units(given["UNITS"], units_name, path, where)
    with_force, size = "NOF" not in given, 1.0 if "RADIANS" in given else np.pi / 180.0
    phi = data[:, 0] * size
    if (np.diff(phi) <= 0).any() or not phi[-1] - phi[0] < 2.0 * np.pi * (1.0 - 1e-12):
        raise AtcError(
            f"{path}: the angles of section {keyword!r} must increase from line to line within less than a full turn"
        )
    return TorsionSection(phi, data[:, 1], data[:, 2] / size if with_force else None)


class _Curve:
    """U(φ) and −U'(φ) on 0 ≤ φ ≤ π as LAMMPS interpolates them, made even in φ exactly. `uneven`: how far the table was
    from it."""

    def __init__(self, s: TorsionSection, points: int, spline: bool, unit: float):
        self.spline, n = spline, points
        grid = 2.0 * np.pi * np.arange(n) / n
        e = _cyclic(s.phi, s.energy * unit, spline)(grid)
        if s.force is not None:
            f = _cyclic(s.phi, s.force * unit, spline)(grid)
        elif spline:
            # As LAMMPS: the derivative of the very spline that gives the energy.
            f = None
        else:
            f = -(np.roll(e, -1) - np.roll(e, 1)) * n / (4.0 * np.pi)
        mirror = -np.arange(n) % n
        self.uneven = np.abs(e - e[mirror]).max() / max(np.ptp(e), 1e-300) if np.ptp(e) > 0 else 0.0
        e = 0.5 * (e + e[mirror])
        self.energy = _cyclic(grid, e, spline)
        if f is None:
            self.force = self._minus_slope
        else:
            self.uneven = max(self.uneven, np.abs(f + f[mirror]).max() / np.abs(f).max() if f.any() else 0.0)
            self.force = _cyclic(grid, 0.5 * (f - f[mirror]), spline)
        # Within the cell at the plane, where the force goes through 0.
        h = 1e-3 / n
        self.at_planes = self.force(np.array([h]))[0] / h, -self.force(np.array([np.pi - h]))[0] / h

    def _minus_slope(self, phi):
        return -self.energy(phi, 1)

    def __call__(self, cos, sin):
        """U and −U'/sin φ."""
        phi = np.arctan2(sin, cos)
        near = sin < _PLANE
        # dφ → sin φ near 180°: the slope of the force is by π − φ there.
        plane = np.where(cos > 0, self.at_planes[0], -self.at_planes[1])
        return self.energy(phi), np.where(near, plane, self.force(phi) / np.where(near, 1.0, sin))


class _Linear:
    """Piecewise linear and cyclic. A class, so that a potential can be sent to other processes."""

    def __init__(self, x, y):
        self.first, self.x, self.y = x[0], np.append(x, x[0] + 2.0 * np.pi), np.append(y, y[0])

    def __call__(self, phi):
        return np.interp((phi - self.first) % (2.0 * np.pi) + self.first, self.x, self.y)


def _cyclic(x, y, spline: bool):
    if not spline:
        return _Linear(x, y)
    from scipy.interpolate import CubicSpline

    # Periodic: arguments may lie anywhere.
    return CubicSpline(np.append(x, x[0] + 2.0 * np.pi), np.append(y, y[0]), bc_type="periodic")


class _Tabulated:
    """What both table styles share: curves by type.

    sections : {type: TorsionSection}
    points, spline : N and the way of LAMMPS's ``table linear|spline N``
    units : unit style of the energies
    """

    kind = "dihedral"

    def _take(self, sections, points, spline, units, where=""):
        self.units = system(units)
        self.covered = frozenset(sections)
        curves = {id(s): _Curve(s, points, spline, self.units.energy) for s in sections.values()}
        self.curves = {t: curves[id(s)] for t, s in sections.items()}
        uneven = {t: c.uneven for t, c in self.curves.items() if not c.uneven <= _EVEN}
        why = "its table is not the same for phi and -phi (by {:.2g} of its range): " + _MIRROR
        self.keep_refusals({t: why.format(by) for t, by in uneven.items()}, where)

    def _lookup(self, cos, sin, types):
        """U and dU/dcos φ."""
        U, slope = np.empty(len(cos)), np.empty(len(cos))
        for t in np.unique(types):
            mine = types == t
            U[mine], slope[mine] = self.curves[int(t)](cos[mine], sin[mine])
        return U, slope


class TableTorsion(_Tabulated, CurveTorsion):
    """U(φ) and −U'(φ) interpolated in a LAMMPS dihedral table (``dihedral_style table linear|spline N``).

    Parameters
    ----------
    sections : {type: TorsionSection}, see `read_torsion_section`
    points, spline : N, and whether the way is spline
    units : unit style of the tables' energies
    partition : see `FourAtoms`
    """

    name = "table"

    def __init__(self, sections, *, points: int, spline: bool = False, units="metal", partition="equal", where=""):
        self._take(sections, points, spline, units, where)
        self.share(partition)

    @classmethod
    def build(cls, inp):
        way = _way(inp)
        return cls(_sections(inp, 0, "")[0], **way)

    def curve(self, cos, sin, types, acc):
        return self._lookup(cos, sin, types)


class TableCutTorsion(_Tabulated, CoupledTorsion):
    """f(θ1) f(θ2) U(φ) with f = K up to θ_a and K [1 − (θ − θ_a)²/(θ_b − θ_a)²] beyond (LAMMPS ``table/cut``).

    As LAMMPS computes (22 Jul 2025, measured), f goes on below 0 beyond θ_b, where its manual has it end.

    Parameters
    ----------
    cuts : {type: (K, θ_a, θ_b)}, angles in degrees. The others as for `TableTorsion`.
    """

    name = "table/cut"

    def __init__(
        self, sections, cuts, *, points: int, spline: bool = False, units="metal", partition="equal", where=""
    ):
        self._take(sections, points, spline, units, where)
        self.cuts = np.zeros((max(cuts, default=0) + 1, 3))
        for t, (K, a, b) in cuts.items():
            self.cuts[t] = K, np.radians(a), np.radians(b)
        self.share(partition)

    @classmethod
    def build(cls, inp):
        way = _way(inp)
        sections, fronts = _sections(inp, 4, "aat, K, two angles, ")
        cuts = {}
        for t, (words, line) in fronts.items():
            if words[0] != "aat":
                raise inp.error(f"dihedral_coeff of table/cut starts with aat, got {words[0]}", line)
            cuts[t] = tuple(
                inp.number(w, 1.0, what, line) for w, what in zip(words[1:], ("K", "angle1", "angle2"), strict=True)
            )
            if not 0.0 <= cuts[t][1] < cuts[t][2]:
                raise inp.error("dihedral_coeff of table/cut: the second angle must be larger than the first", line)
        return cls(sections, cuts, **way)

    def curve(self, chain: Chain, types):
        K, a, b = self.cuts[types].T
        u, slope = self._lookup(chain.cos, chain.sin, types)
        t1, t2, dt1, dt2 = chain.angles()

        def cut(t):
            x = np.maximum(t - a, 0.0) / (b - a)
            return K * (1.0 - x * x), -2.0 * K * x / (b - a)

        (f, df), (g, dg) = cut(t1), cut(t2)
        partial = np.zeros((len(u), 6))
        partial[:, 3], partial[:, 4], partial[:, 5] = df * g * u * dt1, f * dg * u * dt2, f * g * slope
        return f * g * u, partial


def _way(inp):
    points, spline = table_options(inp, 3)
    return {"points": points, "spline": spline, "units": inp.units, "where": inp.where}


def _sections(inp, lead: int, what: str):
    """({type: section}, {type: the words in front}) of lines ``[lead words] file keyword``."""
    sections, fronts, read = {}, {}, {}
    for line in inp.coeffs:
        if len(line.words) != lead + 2:
            raise inp.wrong(f"dihedral_coeff of {inp.name} takes {what}a file and a section's keyword", line)
        key = line.words[lead:]
        if key not in read:
            read[key] = read_torsion_section(inp.path(key[0], line), key[1], line.where, inp.units.name)
        for (t,) in line.covers(inp.n_types):
            sections[t], fronts[t] = read[key], (line.words[:lead], line)
    return sections, fronts
