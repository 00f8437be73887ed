"""The embedded-ion method: charges that flow between an atom and its neighbours, and what they cost (LAMMPS
``pair_style eim``)."""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ...units import units as system
from ..registry import pair_style
from .elements import ElementMap, not_as_wanted, of_each_type, require_among, whole_line
from .embedded_atom import _place, cubic, spline
from .neighbor_work import OUTER_PER_TASK, NeighborTerm, NeighborWork, shares
from .neighborhood import around, between_sharing_neighbors, share_half
from .parameter_file import energy_conversion, numbers, read_parameter_file, word_lines

# LAMMPS's tables: so many points from 0 to the largest cutoff.
_POINTS = 5000
_PAIR = tuple("rc_phi rc_phi2 Eb re alpha beta rc_eta A_eta rs_eta rc_psi A_psi zeta rs_psi p".split())


@dataclass
class EIMParameters:
    """names; chi_e (electronegativities), mass_e; pair : {(a, b): {number: value}} for a ≤ b; bounds : of the argument
    of erfc in the cutoff function."""

    names: list[str]
    chi_e: np.ndarray
    pair: dict
    bounds: tuple[float, float]
    mass_e: np.ndarray


def read_eim(path, names, units_name: str = "metal", where: str = "") -> EIMParameters:
    """The numbers of some elements from an EIM file (``global:``, ``element:`` and ``pair:`` lines, & continues a
    line).

    Raises
    ------
    AtcError for a missing or malformed file, missing elements or pairs, units that cannot be converted.
    """
    text = read_parameter_file(path, "EIM", where)
    factor = energy_conversion(text, units_name, path)
    bounds, chi, mass, pairs = None, {}, {}, {}
    words: list[str] = []
    first = 0
    for k, new in word_lines(text):
        first = first if words else k
        words += [w for w in new if w != "&"]
        if new[-1] == "&":
            continue
        at, kind, rest, words = f"{path}:{first}", words[0], words[1:], []
        if kind == "global:":
            bounds = tuple(numbers(rest, ("division", "rbig", "rsmall"), at)[1:])
        elif kind == "element:" and rest and rest[0] in names:
            v = numbers(rest[1:], ("number", "mass", "negativity", "ra", "ri", "Ec", "q0"), at)
            mass[rest[0]], chi[rest[0]] = v[1:3]
        elif kind == "pair:" and len(rest) > 1 and rest[0] in names and rest[1] in names:
            v = dict(zip(_PAIR, numbers(rest[2:], _PAIR, at), strict=True))
            if v["p"] not in (1, 2) or v["beta"] == v["alpha"] or not v["re"] > 0:
                raise AtcError(f"{at}: p must be 1 or 2, alpha and beta different, r_e positive")
            v |= {key: v[key] * factor for key in ("Eb", "A_psi")}
            pairs[tuple(sorted((names.index(rest[0]), names.index(rest[1]))))] = v
        elif kind not in ("element:", "pair:"):
            raise AtcError(f"{at}: expected global:, element: or pair: in an EIM file, got {kind!r}")
    if bounds is None:
        raise AtcError(f"{path}: no global: line")
    for a, name in enumerate(names):
        if name not in chi:
            raise AtcError(f"{where or path}: {path} has no element: line for {name}")
        for b in range(a, len(names)):
            if (a, b) not in pairs:
                raise AtcError(
                    f"{path}: no pair: line for {name} and {names[b]}, which {where or 'the list of elements'} needs"
                )
    of = lambda what: np.array([what[n] for n in names])  # noqa: E731
    return EIMParameters(list(names), of(chi), pairs, bounds, of(mass))


class _EIMWork(NeighborWork):
    own = ("_charges", "_potentials", "_merge", "_outer")

    def joined(self, acc):
        n, near = len(self.near.atom), self.near
        self.q, self.sigma, self.grad = np.zeros(n), np.zeros(n), np.zeros((n if acc.sources else 0, 3))
        self.runs, self.most, self.room = near.runs(OUTER_PER_TASK)
        self.stages = (*self.stages[:-1], len(self.runs) - 1 if acc.sources else 0)

    def _charges(self, task, acc):
        _charges(*self.atoms(task), self.lists, self.term.eta, self.term.per_dr, self.q, self.grad)

    def _potentials(self, task, acc):
        t = self.term
        acc.energy += _potentials(*self.atoms(task), self.lists, t.psi, t.per_dr, self.q, self.sigma, shares(acc))

    def _merge(self, task, acc):
        t = self.term
        return self.of_pairs(task, acc, _pairs, t.phi, t.eta, t.psi, t.per_dr, self.q, self.sigma, self.grad)

    def _outer(self, task, acc):
        t = self.term
        return self.of_runs(task, acc, _outer, t.eta, t.psi, t.per_dr, self.q)


class EmbeddedIon(NeighborTerm):
    """U = Σ_pairs φ(d) + ½ Σ_i q_i σ_i, q_i = Σ_j η_ji(d), σ_i = Σ_j q_j ψ_ij(d).

    φ = E_b/(β − α) [β e^(−α x) − α e^(−β x)] f_c, x = (d − r_e)/r_e (p = 1), or with powers (r_e/d)^α, (r_e/d)^β (p =
    2); η_ji = A_η (χ_j − χ_i) f_c; ψ = A_ψ e^(−ζ d) f_c; f_c = [erfc(x) − erfc(x_s)]/[erfc(x_b) − erfc(x_s)], x from
    x_b at r_s to x_s at r_c (as LAMMPS, it goes on below r_s).

    A pair's G = [φ' + q_i q_j ψ' + σ_i η_ji' + σ_j η_ij']/d: one bond a pair. Atom i has ½ q_i σ_i and half of its pair
    energies, as in LAMMPS; since q_j depends on all neighbours of j, bonds between neighbours of an atom carry energy
    sources, though no force.

    Between the points of LAMMPS's tables it is LAMMPS's cubic spline, so that energies and forces agree with LAMMPS to
    rounding.

    Parameters
    ----------
    parameters : EIMParameters in `units`
    elements : its element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom is the
        first element.
    units : the default has eV and Å

    Notes
    -----
    Source: Zhou & Doty, Phys. Rev. B 78, 224307 (2008).
    """

    work = _EIMWork
    sweeps = 2
    style, word = "eim", "EIM"
    # A bond of i and j has σ_j, which has the charges of j's neighbours, which have their neighbours.
    depth = 3.0

    def __init__(self, parameters: EIMParameters, elements=None, *, units: str | Units = "metal"):
        self.units = u = system(units)
        p = parameters
        self.map = ElementMap(elements, p.names, "pair_style eim")
        m = len(p.names)
        cutoff = max(v[k] for v in p.pair.values() for k in ("rc_phi", "rc_phi2", "rc_eta", "rc_psi"))
        if not cutoff > 0:
            raise AtcError("pair_style eim: every cutoff is 0")
        step = cutoff / (_POINTS - 1.0)
        r = np.arange(_POINTS) * step
        # At 0 the powers are infinite: what a distance below a few steps would get is of no use anyway.
        r[0] = 0.1 * step
        phi, eta, psi = np.zeros((m, m, _POINTS)), np.zeros((m, m, _POINTS)), np.zeros((m, m, _POINTS))
        x_b, x_s = p.bounds
        span = erfc(x_b) - erfc(x_s)
        for (a, b), v in p.pair.items():

            def cut(inner, outer):
                if not outer > inner:
                    return np.zeros(_POINTS)
                x = (r - inner) / (outer - inner) * (x_s - x_b) + x_b
                return np.where(r < outer, (np.array([erfc(y) for y in x]) - erfc(x_s)) / span, 0.0)

            e, al, be = v["Eb"] / (v["beta"] - v["alpha"]), v["alpha"], v["beta"]
            with np.errstate(over="ignore"):
                if v["p"] == 1:
                    x = r / v["re"] - 1.0
                    f, g = np.exp(-al * x), np.exp(-be * x)
                else:
                    f, g = (v["re"] / r) ** al, (v["re"] / r) ** be
            phi[a, b] = phi[b, a] = e * be * f * cut(v["re"], v["rc_phi"]) - e * al * g * cut(v["re"], v["rc_phi2"])
            flow = v["A_eta"] * (p.chi_e[b] - p.chi_e[a]) * cut(v["rs_eta"], v["rc_eta"])
            # [i, j]: η_ji, what j gives to i.
            eta[a, b], eta[b, a] = flow, -flow
            psi[a, b] = psi[b, a] = v["A_psi"] * np.exp(-v["zeta"] * r) * cut(v["rs_psi"], v["rc_psi"])
        energy, length = u.energy, u.length
        self.cutoff = float(cutoff * length)
        self.per_dr = 1.0 / (step * length)
        self.phi, self.eta, self.psi = (spline(t, 0.0) for t in (phi * energy, eta, psi * energy))
        for (a, b), v in p.pair.items():
            # Row 0 of LAMMPS's splines is not used.
            for t in (self.phi, self.eta, self.psi):
                t[a, b, 0, 0] = t[b, a, 0, 0] = max(v[k] for k in ("rc_phi", "rc_phi2", "rc_eta", "rc_psi")) * length

    @classmethod
    def from_file(cls, path, names, elements=None, *, units: str | Units = "metal", where: str = "") -> EmbeddedIon:
        """From a LAMMPS file: ``EmbeddedIon.from_file("ffield.eim", ["Na", "Cl"], ["Na", "Cl"])``. where : the line
        that names it, for messages."""
        p = read_eim(path, list(names), system(units).name, where)
        return cls(p, elements, units=units).with_masses(p.names, p.mass_e, where)

    def describe(self) -> str:
        return f"eim{self.map.describe()}, energy ½qσ to its own atom, pair energy shared half to each"


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(table, d, per_dr):
    """Value and slope of a table at a distance; table[0, 0] is the distance from which on LAMMPS leaves the pair out
    (the spline swings over)."""
    if d >= table[0, 0]:
        return 0.0, 0.0
    m, x = _place(d, per_dr, table.shape[0] - 1)
    return cubic(table[m], x, per_dr)


@njit(cache=True, nogil=True, error_model="numpy")
def _charges(s0, s1, near, eta, per_dr, q, grad):
    """q of the atoms s0..s1, and Σ_k ∂q/∂x_k where wanted."""
    start, pair, end, a, b, r, d, element, _ = near
    for s in range(s0, s1):
        for e in range(start[s], start[s + 1]):
            p = pair[e]
            k, sign = (b[p], 1.0) if end[e] == 0 else (a[p], -1.0)
            value, slope = _at(eta[element[s], element[k]], d[p], per_dr)
            q[s] += value
            if len(grad) > 0:
                for c in range(3):
                    grad[s, c] -= slope / d[p] * sign * r[p, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _potentials(s0, s1, near, psi, per_dr, q, sigma, energies):
    start, pair, end, a, b, _, d, element, atom = near
    total = 0.0
    for s in range(s0, s1):
        for e in range(start[s], start[s + 1]):
            p = pair[e]
            k = b[p] if end[e] == 0 else a[p]
            sigma[s] += q[k] * _at(psi[element[s], element[k]], d[p], per_dr)[0]
        total += 0.5 * q[s] * sigma[s]
        if len(energies) > 0:
            energies[atom[s]] += 0.5 * q[s] * sigma[s]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs(p0, p1, near, phi, eta, psi, per_dr, q, sigma, grad, out, energies):
    _, _, _, a, b, r, d, element, atom = near
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(out_D) > 0
    total = 0.0
    m = 0
    for p in range(p0, p1):
        i, j = a[p], b[p]
        ei, ej = element[i], element[j]
        u, du = _at(phi[ei, ej], d[p], per_dr)
        at_i = sigma[i] * _at(eta[ei, ej], d[p], per_dr)[1]
        at_j = sigma[j] * _at(eta[ej, ei], d[p], per_dr)[1]
        w, dw = _at(psi[ei, ej], d[p], per_dr)
        field = q[i] * q[j] * dw
        g = (du + field + at_i + at_j) / d[p]
        if not np.isfinite(g + u):
            return 0, 0.0, p
        total += u
        share_half(energies, atom[i], atom[j], u)
        keep = g != 0.0
        out_i[m], out_j[m], out_G[m] = atom[i], atom[j], g
        for c in range(3):
            out_r[m, c] = r[p, c]
            if sources:
                out_D[m, 0, c] = -0.5 * (du + field + at_i) / d[p] * r[p, c] - 0.5 * q[i] * w * grad[j, c]
                out_D[m, 1, c] = 0.5 * (du + field + at_j) / d[p] * r[p, c] - 0.5 * q[j] * w * grad[i, c]
                keep = keep or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
        m += 1 if keep else 0
    return m, total, -1


@njit(cache=True, nogil=True, error_model="numpy")
def _outer(s0, s1, most, near, eta, psi, per_dr, q, out, energies):
    """Between neighbours e, f of an atom s: ∂U^(e)/∂x_f = ½ q_e ψ_es ∂q_s/∂x_f, and the same with e and f exchanged."""
    element = near[7]
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    share, slope = np.empty(most), np.empty(most)
    m = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        for e in range(k):
            ee = element[who[e]]
            share[e] = 0.5 * q[who[e]] * _at(psi[ee, element[s]], dist[e], per_dr)[0]
            slope[e] = -_at(eta[element[s], ee], dist[e], per_dr)[1] / dist[e]
        m = between_sharing_neighbors(k, near, who, arm, share, slope, out, m)
    return m, 0.0


@pair_style("eim", mapped=True)
def _eim(inp):
    wants = "pair_coeff * * <elements> <file.eim> <element of each atom type>"
    line = whole_line(inp, wants, 3)
    file = next((k for k, w in enumerate(line.words) if k > 0 and ("." in w or "/" in w)), None)
    if file is None or file + 1 == len(line.words):
        raise not_as_wanted(inp, wants, line)
    names = list(dict.fromkeys(line.words[:file]))
    elements = of_each_type(inp, line.words[file + 1 :], line)
    require_among(inp, elements, names, "in front of the file", line)
    return EmbeddedIon.from_file(inp.path(line.words[file], line), names, elements, units=inp.units, where=line.where)
