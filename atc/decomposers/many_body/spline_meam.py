"""Embedded atom with angular densities given by splines (LAMMPS ``meam/spline``), and with an angular energy beside
them (``meam/sw/spline``)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ...errors import AtcError, AtcWarning
from ...units import Units
from ...units import units as system
from ..registry import pair_style
from .centred import Centred
from .elements import ElementMap, mapped_line, named_elements
from .neighbor_work import law
from .neighborhood import around
from .parameter_file import Rows, read_parameter_file, same_units


@dataclass
class Spline:
    """A cubic spline through (x, y) with slopes d0 and d1 at its ends, linear beyond."""

    x: np.ndarray
    y: np.ndarray
    d0: float
    d1: float

    def steep(self) -> bool:
        """Whether a slope between knots is beyond what numbers hold."""
        with np.errstate(all="ignore"):
            return not np.isfinite(np.diff(self.y) / np.diff(self.x) ** 3).all()

    def rows(self, length: float = 1.0, value: float = 1.0) -> np.ndarray:
        """(knots, 5): where each piece begins and its polynomial in what is beyond that, highest power first; the
        argument and the value in other units.

        The first row is the line below the first knot, the last the line above the last.
        """
        from scipy.interpolate import CubicSpline

        c = CubicSpline(self.x, self.y, bc_type=((1, self.d0), (1, self.d1))).c
        out = np.zeros((len(self.x) + 1, 5))
        out[0] = self.x[0], 0.0, 0.0, self.d0, self.y[0]
        out[1:-1, 0], out[1:-1, 1:] = self.x[:-1], c.T
        out[-1] = self.x[-1], 0.0, 0.0, self.d1, self.y[-1]
        out[:, 0] *= length
        out[:, 1:] *= value / length ** np.arange(3, -1, -1)
        return out


@dataclass
class SplineMEAMFunctions:
    """names (None: any one); phi, g : one for each pair of elements in the order 11, 12, .., 22, ..; rho, U, f : one
    for each element; F, G : of ``meam/sw/spline``."""

    names: list[str] | None
    phi: list[Spline]
    rho: list[Spline]
    U: list[Spline]
    f: list[Spline]
    g: list[Spline]
    F: Spline | None = None
    G: Spline | None = None


def read_spline_meam(
    path, units_name: str = "metal", stillinger_weber: bool = False, where: str = ""
) -> SplineMEAMFunctions:
    """A ``.meam.spline`` file (of one element, or with a line ``meam/spline N names``), or a ``.meam.sw.spline`` file.

    Raises
    ------
    AtcError for a missing or malformed file.
    """
    text = read_parameter_file(path, "spline MEAM", where)
    same_units(text, units_name, path, "spline MEAM")
    # The first line is a comment.
    lines = [(k, w) for k, line in enumerate(text.splitlines()[1:], 2) if (w := line.split())]
    rows = Rows(path, lines)
    row = rows.values

    def spline(what):
        headed = rows.place < len(lines) and lines[rows.place][1][0] == "spline3eq"
        rows.place += headed
        (count,), at = row(f"the number of knots of {what}", (float,))
        if count != int(count) or count < 2:
            raise AtcError(f"{at}: {what} must have two knots or more, got {count:g}")
        (d0, d1), _ = row(f"the slopes at the ends of {what}", (float, float))
        if not headed:
            row(f"a line that is not used, of {what}", (float,))
        xy = np.array([row(f"a knot (x, y) of {what}", (float, float))[0] for _ in range(int(count))])
        if not (np.diff(xy[:, 0]) > 0).all():
            raise AtcError(f"{at}: the knots of {what} must go up")
        out = Spline(xy[:, 0], xy[:, 1], d0, d1)
        if out.steep():
            raise AtcError(f"{at}: the values of {what} are too large, or its knots too close")
        return out

    names = None
    if lines and lines[0][1][0] == "meam/spline":
        number, words = lines[0]
        rows.place = 1
        if len(words) < 3 or not words[1].isdigit() or len(words) != 2 + int(words[1]):
            raise AtcError(
                f"{path}:{number}: expected meam/spline, the number of elements and their names, got "
                f"{' '.join(words)!r}"
            )
        names = words[2:]
    m = 1 if names is None else len(names)
    pairs = m * (m + 1) // 2
    phi = [spline("phi") for _ in range(pairs)]
    F, G = (spline("F"), spline("G")) if stillinger_weber else (None, None)
    parts = [[spline(what) for _ in range(n)] for what, n in (("rho", m), ("U", m), ("f", m), ("g", pairs))]
    if rows.place < len(lines):
        raise AtcError(
            f"{path}:{lines[rows.place][0]}: more lines than the functions of {m} element{'s' if m > 1 else ''} take"
        )
    return SplineMEAMFunctions(names, phi, *parts, F, G)


class SplineMEAM(Centred):
    """U = Σ_pairs φ(d) + Σ_i [U_i(n_i) − U_i(0)], n_i = Σ_j ρ_j(d_ij) + Σ_{j<k} f_j(d_ij) f_k(d_ik) g_jk(cos θ_jik),
    all cubic splines; with F and G also Σ_i Σ_{j<k} F(d_ij) F(d_ik) G(cos θ_jik).

    G follows from arms and cosines, cos θ = (ξ_ij + ξ_ik − ξ_jk)/(d_ij d_ik). The energies of an atom's density and
    angles belong to it, half of φ to each end, as in LAMMPS.

    Parameters
    ----------
    functions : SplineMEAMFunctions in `units`
    elements : the element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom is the
        first element.
    units : the default has eV and Å

    Notes
    -----
    Source: Lenosky et al., Modell. Simul. Mater. Sci. Eng. 8, 825 (2000); Zhang & Trinkle, Comput. Mater. Sci. 124, 204
    (2016); Nicklas, Fellinger & Park.
    """

    def __init__(self, functions: SplineMEAMFunctions, elements=None, *, units: str | Units = "metal"):
        self.units = u = system(units)
        fs = functions
        self.style = "meam/spline" if fs.F is None else "meam/sw/spline"
        used = named_elements(elements)
        names = fs.names or used[:1] or ["X"]
        if fs.names is None and len(used) > 1:
            raise AtcError(f"pair_style {self.style}: the file is of one element, got {' '.join(used)}")
        self.map = ElementMap(elements, names, f"pair_style {self.style}")
        energy, length = u.energy, u.length
        zero = [_value(U.rows(), 0.0) for U in fs.U]
        lifted = [Spline(U.x, U.y - z, U.d0, U.d1) for U, z in zip(fs.U, zero, strict=True)]
        self.rho, self.f = _stack([s.rows(length) for s in fs.rho]), _stack([s.rows(length) for s in fs.f])
        self.U, self.g = _stack([s.rows(1.0, energy) for s in lifted]), _stack([s.rows() for s in fs.g])
        self.F = _stack([fs.F.rows(length)] if fs.F else [])
        self.G = _stack([fs.G.rows(1.0, energy)] if fs.G else [])
        m = len(names)
        self.index = np.zeros((m, m), np.int64)
        self.index[np.triu_indices(m)] = np.arange(m * (m + 1) // 2)
        self.index = np.maximum(self.index, self.index.T)
        self.of_pair = _stack([s.rows(length, energy) for s in fs.phi]), self.index
        radial = [*fs.phi, *fs.rho, *fs.f, *([fs.F] if fs.F else [])]
        self.cutoff = float(max(s.x[-1] for s in radial) * length)

    @classmethod
    def from_file(
        cls, path, elements=None, *, units: str | Units = "metal", stillinger_weber: bool = False, where: str = ""
    ) -> SplineMEAM:
        """From a LAMMPS file: ``SplineMEAM.from_file("Ti.meam.spline", ["Ti"])``. where : the line that names it, for
        messages."""
        return cls(read_spline_meam(path, system(units).name, stillinger_weber, where), elements, units=units)

    def describe(self) -> str:
        return (
            f"{self.style}{self.map.describe()}, energies of density and angles to their own atom, pair energy shared "
            "half to each; outer bonds apart"
        )

    @law
    def pair(ea, eb, d, phi, index):
        u, du = _spline(phi[index[ea, eb]], d)
        return u, du / d

    def centres(self, s0, s1, most, near, *out):
        splines = self.rho, self.U, self.f, self.g, self.F, self.G
        return _centres(s0, s1, most, near, self.index, splines, *out)


def _stack(rows: list[np.ndarray]) -> np.ndarray:
    """(functions, knots + 1, 5), filled up with rows that begin at infinity."""
    n = max((len(r) for r in rows), default=0)
    out = np.full((len(rows), n, 5), np.inf)
    for k, r in enumerate(rows):
        out[k, : len(r)] = r
    return out


def _value(rows, x) -> float:
    return float(_spline.py_func(rows, x)[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _spline(rows, x):
    """Value and slope."""
    k = 0
    if x >= rows[0, 0]:
        lo, hi = 1, rows.shape[0]
        while hi - lo > 1:
            mid = (lo + hi) // 2
            if rows[mid, 0] <= x:
                lo = mid
            else:
                hi = mid
        k = lo
    c = rows[k]
    y = x - c[0]
    return ((c[1] * y + c[2]) * y + c[3]) * y + c[4], (3.0 * c[1] * y + 2.0 * c[2]) * y + c[3]


@njit(cache=True, nogil=True, error_model="numpy")
def _centres(s0, s1, most, near, index, splines, G_end, S_end, out, energies):
    start, pair, end, _, _, _, _, element, atom = near
    rho, U, f, g, F, G = splines
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(S_end) > 0
    angles = len(F) > 0
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    fv, df, drho, Fv, dF = np.empty(most), np.empty(most), np.empty(most), np.zeros(most), np.zeros(most)
    G_arm, grad = np.empty(most), np.empty((most, 3))
    total = 0.0
    n = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        density = 0.0
        energy = 0.0
        for e in range(k):
            ee = element[who[e]]
            value, drho[e] = _spline(rho[ee], dist[e])
            density += value
            fv[e], df[e] = _spline(f[ee], dist[e])
            if angles:
                Fv[e], dF[e] = _spline(F[0], dist[e])
            G_arm[e] = 0.0
            for c in range(3):
                grad[e, c] = 0.0
        for e in range(k):
            for h in range(e + 1, k):
                if fv[e] * fv[h] == 0.0:
                    continue
                cos = (arm[e, 0] * arm[h, 0] + arm[e, 1] * arm[h, 1] + arm[e, 2] * arm[h, 2]) / (dist[e] * dist[h])
                density += fv[e] * fv[h] * _spline(g[index[element[who[e]], element[who[h]]]], cos)[0]
        value, dU = _spline(U[element[s]], density)
        energy += value
        for e in range(k):
            G_arm[e] += dU * drho[e] / dist[e]
            for h in range(e + 1, k):
                by_cos = by_e = by_h = 0.0
                v = 1.0 / (dist[e] * dist[h])
                cos = (arm[e, 0] * arm[h, 0] + arm[e, 1] * arm[h, 1] + arm[e, 2] * arm[h, 2]) * v
                # Slopes at the cutoff need not be 0 where the other factor is not.
                if fv[e] != 0.0 or fv[h] != 0.0:
                    value, slope = _spline(g[index[element[who[e]], element[who[h]]]], cos)
                    by_cos = dU * fv[e] * fv[h] * slope
                    by_e, by_h = dU * df[e] * fv[h] * value, dU * fv[e] * df[h] * value
                if angles and (Fv[e] != 0.0 or Fv[h] != 0.0):
                    value, slope = _spline(G[0], cos)
                    energy += Fv[e] * Fv[h] * value
                    by_cos += Fv[e] * Fv[h] * slope
                    by_e += dF[e] * Fv[h] * value
                    by_h += Fv[e] * dF[h] * value
                G_arm[e] += by_e / dist[e] + by_cos * (v - cos / (dist[e] * dist[e]))
                G_arm[h] += by_h / dist[h] + by_cos * (v - cos / (dist[h] * dist[h]))
                if by_cos == 0.0:
                    continue
                out_i[n], out_j[n], out_G[n] = atom[who[e]], atom[who[h]], -by_cos * v
                for c in range(3):
                    out_r[n, c] = arm[h, c] - arm[e, c]
                    grad[e, c] += out_G[n] * out_r[n, c]
                    grad[h, c] -= out_G[n] * out_r[n, c]
                n += 1
        total += energy
        if len(energies) > 0:
            energies[atom[s]] += energy
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            G_end[p, side] = G_arm[e]
            if sources:
                for c in range(3):
                    S_end[p, side, 0, c] = grad[e, c] - G_arm[e] * arm[e, c]
    return n, total


@pair_style("meam/spline", "meam/sw/spline", mapped=True)
def _meam_spline(inp):
    stillinger_weber = inp.name == "meam/sw/spline"
    ending = ".meam.sw.spline" if stillinger_weber else ".meam.spline"
    path, elements, line = mapped_line(inp, ending)
    functions = read_spline_meam(path, inp.units.name, stillinger_weber, line.where)
    if not stillinger_weber and functions.names is not None and elements != functions.names:
        names = " ".join(functions.names)
        if sorted(map(str, elements)) != sorted(functions.names):
            raise inp.error(
                f"{inp.command}: LAMMPS wants one atom type for each element of the file: write {names}", line
            )
        warnings.warn(
            f"{line.where}: LAMMPS's meam/spline gives the atom types the elements of the file in its order "
            f"({names}), whatever the line says, and so does this",
            AtcWarning,
            stacklevel=2,
        )
        elements = functions.names
    if not stillinger_weber and functions.names is None and len(elements) != 1:
        raise inp.error(
            f"{inp.command}: LAMMPS takes a file of one element for one atom type, got {' '.join(line.words[1:])}", line
        )
    return SplineMEAM(functions, elements, units=inp.units)
