"""Embedded atom: a pair energy, and an energy of the density that an atom's neighbours make at its place (LAMMPS
``eam``, ``eam/alloy``, ``eam/fs``,
``eam/he``).

A frame is done in three stages, none of which holds a neighbour list: densities (each thread sums its own), embedding
energies and their slopes, then one bond a pair of neighbours.
"""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...frame import Frame
from ...units import Units
from ...units import units as system
from ..base import Accumulator, Term, Work
from ..registry import pair_style
from .eam_file import EAMTables, read_funcfl, read_setfl
from .elements import ElementMap, mapped_style, named_elements, require_known
from .neighbor_work import NO_D, shares
from .neighborhood import by_place, impossible, share_half


class EmbeddedAtom(Term):
    """U = Σ_i F_i(ρ_i) + Σ_pairs φ_ij(d), ρ_i = Σ_j ρ_ji(d_ij).

    A pair's G = [φ' + F_i' ρ_ji' + F_j' ρ_ij'] / d: one bond a pair, whatever the number of neighbours. An atom's share
    of the energy is its own embedding energy and half of its pair energies, as in LAMMPS; its sources follow:
    ∂U^(i)/∂x_j = −(F_i' ρ_ji' + ½φ') (x_i − x_j)/d.

    Between the points of the tables it is LAMMPS's cubic spline, so that energies and forces agree with LAMMPS to
    rounding; beyond the last density the embedding energy goes on linearly (such atoms are counted in the notes);
    distances at and beyond the cutoff do not count.

    Parameters
    ----------
    tables : EAMTables in `units`
    elements : the tables' element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom
        is the first element.
    units : unit style of the tables; the default has eV and Å
    name : LAMMPS's name of the style, for descriptions
    rest : the element of atom types beyond those of `elements`; default: they are an error

    Notes
    -----
    Source: Daw & Baskes, Phys. Rev. B 29, 6443 (1984); Finnis & Sinclair, Phil. Mag. A 50, 45 (1984). Files:
    `from_setfl`, `from_funcfl`.
    """

    sweeps = 2

    def __init__(
        self,
        tables: EAMTables,
        elements=None,
        *,
        units: str | Units = "metal",
        name: str = "eam/alloy",
        rest: str | None = None,
    ):
        self.units = system(units)
        self.name = name
        self.map = ElementMap(elements, tables.elements, f"pair_style {name}")
        keep = list(range(len(tables.elements)))
        if elements is not None:
            # Only what is needed, so that a file of sixteen elements costs no memory.
            used = named_elements(elements)
            keep = [tables.elements.index(e) for e in used]
            self.map = ElementMap(elements, used, f"pair_style {name}", rest)
        take_tables(self, tables, keep)

    @classmethod
    def from_setfl(
        cls,
        path,
        elements=None,
        *,
        units: str | Units = "metal",
        finnis_sinclair: bool = False,
        helium: bool = False,
        where: str = "",
    ) -> EmbeddedAtom:
        """From a setfl file (LAMMPS ``eam/alloy``), its Finnis-Sinclair variant (``eam/fs``), or that with negative
        densities (helium: ``eam/he``): ``EmbeddedAtom.from_setfl("AlCu.eam.alloy", ["Al"])``."""
        t = read_setfl(path, system(units).name, finnis_sinclair or helium, where, helium=helium)
        require_known(elements, t.elements, path, where)
        name = "eam/he" if helium else "eam/fs" if finnis_sinclair else "eam/alloy"
        return cls(t, elements, units=units, name=name).with_masses(t.elements, t.masses, where)

    @classmethod
    def from_funcfl(
        cls, paths, files_of_types=None, *, units: str | Units = "metal", rest: int | None = None, where: str = ""
    ) -> EmbeddedAtom:
        """From funcfl files (LAMMPS ``eam``). files_of_types : for each atom type from 1 the position of its file in
        `paths`, None: left out; default: every atom is of the first file. rest : the file of types beyond those;
        default: they are an error."""
        t = read_funcfl(paths, system(units).name, where)
        elements = None if files_of_types is None else [None if k is None else str(k) for k in files_of_types]
        made = cls(t, elements, units=units, name="eam", rest=None if rest is None else str(rest))
        return made.with_masses(t.elements, t.masses, where)

    def describe(self) -> str:
        what = self.name if self.name == "eam" else f"{self.name}{self.map.describe()}"
        return f"{what}, embedding energy to its own atom, pair energy shared half to each"

    def prepare(self, frame: Frame) -> Work:
        return _EAMWork(self, frame)


def take_tables(term, tables: EAMTables, keep) -> None:
    """Give a term with units the tables of the elements `keep`, as splines in internal units."""
    energy, length = term.units.energy, term.units.length
    block = np.ix_(keep, keep)
    term.per_dr, term.per_drho = 1.0 / (tables.dr * length), 1.0 / tables.drho
    term.cutoff = float(tables.cutoff * length)
    term.rho_first, term.rho_end = tables.rho_first, tables.rho_end
    term.F, term.rho = spline(tables.F_en[keep] * energy), spline(tables.rho_eer[block])
    term.zr = spline(tables.zr_eer[block] * (energy * length))


def spline(tables, last_slope: float | None = None) -> np.ndarray:
    """(..., n + 1, 4) coefficients of LAMMPS's cubic spline through (..., n) values (PairEAM::interpolate), rows
    counted from 1.

    Between point m and m + 1, at p = x/step + 1 − m: ((c0 p + c1) p + c2) p + c3. Slopes at the points are five-point
    differences, at the last point last_slope (per step), or the difference to the one before.
    """
    f = np.asarray(tables, float)
    n = f.shape[-1]
    s = np.zeros_like(f)
    s[..., 0] = f[..., 1] - f[..., 0]
    s[..., 1] = 0.5 * (f[..., 2] - f[..., 0])
    s[..., n - 2] = 0.5 * (f[..., n - 1] - f[..., n - 3])
    s[..., n - 1] = f[..., n - 1] - f[..., n - 2] if last_slope is None else last_slope
    s[..., 2 : n - 2] = ((f[..., : n - 4] - f[..., 4:]) + 8.0 * (f[..., 3 : n - 1] - f[..., 1 : n - 3])) / 12.0
    out = np.zeros((*f.shape[:-1], n + 1, 4))
    df = f[..., 1:] - f[..., :-1]
    out[..., 1:, 3] = f
    out[..., 1:, 2] = s
    out[..., 1:n, 1] = 3.0 * df - 2.0 * s[..., :-1] - s[..., 1:]
    out[..., 1:n, 0] = s[..., :-1] + s[..., 1:] - 2.0 * df
    return out


class _EAMWork(Work):
    def __init__(self, term: EmbeddedAtom, frame: Frame):
        self.term, self.frame = term, frame
        element_n, who = term.map.apply(frame)
        self.list, self.atom = by_place(frame, who, term.cutoff)
        self.element = element_n[self.atom]
        self.sums: dict[int, tuple[int, np.ndarray]] = {}
        self.stages = (self.list.n_chunks, 1, self.list.n_chunks)

    def run(self, stage, task, acc: Accumulator):
        return (self._densities, self._embed, self._bonds)[stage](task, acc)

    def _densities(self, task, acc):
        ws, term = acc.ws, self.term
        if id(acc) not in self.sums:
            self.sums[id(acc)] = task, np.zeros(len(self.atom))
        n = self.list.half(task, ws)
        _densities(ws.i, ws.j, ws.d2, n, self.element, term.rho, term.per_dr, self.sums[id(acc)][1])

    def _embed(self, task, acc):
        term = self.term
        # In the order of the threads' first tasks: the sum does not depend on which thread began first.
        rho = sum((r for _, r in sorted(self.sums.values(), key=lambda s: s[0])), np.zeros(len(self.atom)))
        self.sums = {}
        self.slope = np.empty(len(rho))
        energy, beyond = _embed(
            rho, self.element, term.F, term.per_drho, term.rho_first, term.rho_end, self.atom, self.slope, shares(acc)
        )
        acc.energy += energy
        acc.note("atoms with a density beyond the end of the EAM table", beyond)

    def _bonds(self, task, acc):
        ws, term = acc.ws, self.term
        n = self.list.half(task, ws)
        D = np.empty((n, 2, 3)) if acc.sources else NO_D
        pairs, per_dr = (ws.i, ws.j, ws.r, ws.d2), term.per_dr
        m, energy, bad = _bonds(
            pairs, n, self.element, term.rho, term.zr, per_dr, self.slope, self.atom, ws.G, D, shares(acc)
        )
        if bad >= 0:
            raise impossible(self.frame, self.atom[ws.i[bad]], self.atom[ws.j[bad]], ws.d2[bad] ** 0.5, "EAM")
        acc.energy += energy
        return Bonds(ws.i[:m], ws.j[:m], ws.r[:m], ws.G[:m], D[:m] if acc.sources else None)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _place(x, per_step, n):
    """Row and fraction of an argument in a spline of n points, as LAMMPS finds them for distances."""
    p = x * per_step + 1.0
    m = min(int(p), n - 1)
    return m, min(p - m, 1.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cubic(c, x, per_step):
    """A cubic at a place x between its points, and its slope."""
    return ((c[0] * x + c[1]) * x + c[2]) * x + c[3], ((3.0 * c[0] * x + 2.0 * c[1]) * x + c[2]) * per_step


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def embedding(F, rho, per_drho):
    """F(ρ) and F'(ρ) of an atom, the last cubic of the table beyond it held where it ends."""
    x = rho * per_drho + 1.0
    row = max(1, min(int(x), F.shape[0] - 2))
    return cubic(F[row], min(x - row, 1.0), per_drho)


@njit(cache=True, nogil=True, error_model="numpy")
def _densities(i, j, d2, n, element, spline, per_dr, rho):
    points = spline.shape[2] - 1
    for b in range(n):
        m, p = _place(np.sqrt(d2[b]), per_dr, points)
        ei, ej = element[i[b]], element[j[b]]
        rho[i[b]] += cubic(spline[ej, ei, m], p, per_dr)[0]
        rho[j[b]] += cubic(spline[ei, ej, m], p, per_dr)[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _embed(rho, element, spline, per_drho, rho_first, rho_end, atom, slope, energies):
    """F(ρ) of every atom and F'(ρ) into slope. Returns the energy and how many atoms are beyond the table."""
    points = spline.shape[1] - 1
    total = 0.0
    beyond = 0
    for s in range(len(rho)):
        p = (rho[s] - rho_first) * per_drho + 1.0
        # With negative densities LAMMPS's first row is the second, and the line goes on from its beginning.
        m = max(1 if rho_first == 0.0 else 2, min(int(p), points - 1))
        p = min(p - m, 1.0)
        below = rho_first != 0.0 and rho[s] < rho_first
        if below:
            p = -1.0
        u, f = cubic(spline[element[s], m], p, per_drho)
        if rho[s] > rho_end:
            u += f * (rho[s] - rho_end)
            beyond += 1
        if below:
            u += f * (rho[s] - rho_first)
            beyond += 1
        slope[s] = f
        total += u
        if len(energies) > 0:
            energies[atom[s]] += u
    return total, beyond


@njit(cache=True, nogil=True, error_model="numpy")
def _bonds(pairs, n, element, rho, zr, per_dr, slope, atom, G, D, energies):
    """Pair energies, G and sources, compacted in place to the frame's indices. Returns their number, the energy, the
    first bad pair (−1)."""
    i, j, r, d2 = pairs
    points = zr.shape[2] - 1
    sources = len(D) > 0
    total = 0.0
    m = 0
    for b in range(n):
        a, k = i[b], j[b]
        ea, ek = element[a], element[k]
        d = np.sqrt(d2[b])
        inv = 1.0 / d
        row, p = _place(d, per_dr, points)
        z, dz = cubic(zr[ea, ek, row], p, per_dr)
        u = z * inv
        du = (dz - u) * inv
        c = rho[ek, ea, row]
        at_a = slope[a] * ((3.0 * c[0] * p + 2.0 * c[1]) * p + c[2]) * per_dr
        c = rho[ea, ek, row]
        at_k = slope[k] * ((3.0 * c[0] * p + 2.0 * c[1]) * p + c[2]) * per_dr
        g = (du + at_a + at_k) * inv
        if not np.isfinite(g + u):
            return 0, 0.0, b
        total += u
        ia, ik = atom[a], atom[k]
        share_half(energies, ia, ik, u)
        keep = g != 0.0
        x, y, w = r[b, 0], r[b, 1], r[b, 2]
        if sources:
            h = -(at_a + 0.5 * du) * inv
            e = (at_k + 0.5 * du) * inv
            D[m, 0, 0], D[m, 0, 1], D[m, 0, 2] = h * x, h * y, h * w
            D[m, 1, 0], D[m, 1, 1], D[m, 1, 2] = e * x, e * y, e * w
            keep = keep or h != 0.0 or e != 0.0
        i[m], j[m] = ia, ik
        r[m, 0], r[m, 1], r[m, 2] = x, y, w
        G[m] = g
        m += 1 if keep else 0
    return m, total, -1


mapped_style("eam/alloy", ending=".eam.alloy", read=EmbeddedAtom.from_setfl)
mapped_style("eam/fs", ending=".eam.fs", read=EmbeddedAtom.from_setfl, finnis_sinclair=True)
mapped_style("eam/he", ending=".eam.he", read=EmbeddedAtom.from_setfl, helium=True)


@pair_style("eam")
def _funcfl(inp):
    inp.no_arguments()
    paths: list = []
    of_type: dict[int, int] = {}
    for line in inp.coeffs:
        if len(line.words) != 1:
            raise inp.wrong("pair_coeff of eam takes one funcfl file", line)
        mine = [a for a, b in line.covers(inp.n_types) if a == b]
        if not mine:
            raise inp.error(
                "pair_coeff of eam is given for a type with itself; other pairs follow from it: write 'pair_coeff 1 1 "
                "file'",
                line,
            )
        path = inp.path(line.words[0], line)
        if path not in paths:
            paths.append(path)
        of_type.update(dict.fromkeys(mine, paths.index(path)))
    files: list = [of_type.get(t) for t in range(1, inp.n_types + 1)]
    for t, f in enumerate(files, 1):
        if f is None and (inp.wanted is None or inp.wanted[t, t]):
            raise inp.error(f"pair_style eam: no pair_coeff for type {t}: add 'pair_coeff {t} {t} <funcfl file>'")
    # ``* *`` goes for types that no line names, too.
    open_lines = [line for line in inp.coeffs if all(t.hi is None for t in line.types)]
    rest = paths.index(inp.path(open_lines[-1].words[0])) if open_lines else None
    # Files that a later line replaced take no part in the common grid.
    active = [k for k in range(len(paths)) if k in files]
    files = [None if f is None else active.index(f) for f in files]
    rest = active.index(rest) if rest in active else None
    return EmbeddedAtom.from_funcfl([paths[k] for k in active], files, units=inp.units, rest=rest, where=inp.where)
