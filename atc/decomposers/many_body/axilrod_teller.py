"""Axilrod-Teller-Muto: the triple-dipole energy of three atoms (LAMMPS ``pair_style atm``)."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ...units import Units
from ...units import units as system
from ..registry import pair_style
from .neighbor_work import NeighborTerm, NeighborWork

# Distances that are equal to the cutoff on paper (crystals) count, whatever their rounding.
_HAIR = 1e-12


class _ATMWork(NeighborWork):
    own = ("_bonds",)

    def _bonds(self, task, acc):
        term = self.term
        return self.of_pairs(task, acc, _triple_dipoles, term.nu, term.cutoff**2, term.product2)


class AxilrodTeller(NeighborTerm):
    """U = Σ_triples ν (1 + 3 cos γ1 cos γ2 cos γ3)/(d12 d13 d23)³ over triples with all d ≤ cutoff and d12 d13 d23 ≤
    cutoff_triple³.

    In squared distances u, v, w it is ν [Q^(−3/2) + ⅜ (u+v−w)(u+w−v)(v+w−u) Q^(−5/2)], Q = uvw: no angle is formed,
    collinear and coincident directions are ordinary. A third of a triple's energy goes to each of its atoms. All
    triples of a pair are summed into one bond. The energy is cut off without smoothing, as in LAMMPS: it jumps where a
    triple enters.

    Parameters
    ----------
    nu : energy·length⁹ in `units`: a number for all types, or a symmetric (n, n, n) array for types 1..n
    cutoff, cutoff_triple : lengths in `units`
    units : the default has eV and Å

    Notes
    -----
    Source: Axilrod & Teller, J. Chem. Phys. 11, 299 (1943); Muto (1943).
    """

    work = _ATMWork
    word = "triple-dipole"
    bodies = 3

    def __init__(self, nu, cutoff: float, cutoff_triple: float, *, units: str | Units = "metal"):
        self.units = u = system(units)
        factor = u.energy * u.length**9
        nu = np.asarray(nu, float) * factor
        for what, v in (("cutoff", cutoff), ("cutoff_triple", cutoff_triple)):
            if not (np.isfinite(v) and v > 0):
                raise AtcError(f"pair_style atm: the {what} must be a positive number, got {v}")
        if not np.isfinite(nu).all():
            raise AtcError("pair_style atm: nu must be finite")
        self.cutoff = float(u.to_internal("length", cutoff)) * (1 + _HAIR)
        self.product2 = float(u.to_internal("length", cutoff_triple)) ** 6 * (1 + _HAIR)
        self.uniform = nu.ndim == 0
        if self.uniform:
            self.nu = nu.reshape(1, 1, 1)
        else:
            if (
                nu.ndim != 3
                or len(set(nu.shape)) != 1
                or not all(np.array_equal(nu, nu.transpose(p)) for p in permutations(range(3)))
            ):
                raise AtcError(f"pair_style atm: nu by type must be a symmetric (n, n, n) array, got shape {nu.shape}")
            self.nu = np.zeros((nu.shape[0] + 1,) * 3)
            self.nu[1:, 1:, 1:] = nu

    def describe(self) -> str:
        return "atm, triple energy shared a third to each of its atoms; one bond a pair"

    def kinds(self, frame: Frame):
        if not self.uniform and len(frame):
            top, low = int(frame.types.max()), int(frame.types.min())
            if top >= len(self.nu) or low < 1:
                raise AtcError(
                    f"{frame.source}: atoms of type {top if low >= 1 else low} but pair_style atm knows types 1 to "
                    f"{len(self.nu) - 1}: add a pair_coeff line"
                )
        return np.zeros(len(frame), np.int32) if self.uniform else frame.types.astype(np.int32), None


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _derivative(nu, u, v, w, P, Q15, Q25):
    """2 ∂U/∂u = G of the distance √u, up to the terms that the caller has: P the product of three, Q15 = Q^(−3/2), Q25
    = Q^(−5/2)."""
    x, y, z = u + v - w, u + w - v, v + w - u
    return 2.0 * nu * (-1.5 * Q15 / u + 0.375 * Q25 * (y * z + x * z - x * y - 2.5 * P / u))


@njit(cache=True, nogil=True, error_model="numpy")
def _triple_dipoles(p0, p1, near, nu, cut2, product2, out, energies):
    """Bonds of the pairs p0..p1. A triple is met from each of its three pairs, which take a third of its energy
    each."""
    start, pair, end, a, b, r, d, types, atom = near
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(out_D) > 0
    shared = len(energies) > 0
    total = 0.0
    m = 0
    for p in range(p0, p1):
        s, t = a[p], b[p]
        x, y, z = r[p, 0], r[p, 1], r[p, 2]
        u = d[p] * d[p]
        g = 0.0
        sx = sy = sz = tx = ty = tz = 0.0
        for q in range(start[s], start[s + 1]):
            pk = pair[q]
            # In a small cell an atom is its own neighbour: the pair p then stands twice in its list, and only this end
            # of it is the pair itself.
            if pk == p and end[q] == 0:
                continue
            if end[q] == 0:
                k, sign = b[pk], 1.0
            else:
                k, sign = a[pk], -1.0
            # x_s − x_k and x_t − x_k through the images that s sees.
            kx, ky, kz = sign * r[pk, 0], sign * r[pk, 1], sign * r[pk, 2]
            ex, ey, ez = kx - x, ky - y, kz - z
            w = ex * ex + ey * ey + ez * ez
            v = d[pk] * d[pk]
            if w > cut2 or u * v * w > product2:
                continue
            strength = nu[types[s], types[t], types[k]]
            if strength == 0.0:
                continue
            Q = u * v * w
            Q15 = 1.0 / (Q * np.sqrt(Q))
            Q25 = Q15 / Q
            P = (u + v - w) * (u + w - v) * (v + w - u)
            e = strength * (Q15 + 0.375 * P * Q25)
            G_st = _derivative(strength, u, v, w, P, Q15, Q25)
            total += e / 3.0
            g += G_st
            if shared:
                # Each atom of the triple is an end of two of its pairs.
                energies[atom[s]] += e / 6.0
                energies[atom[t]] += e / 6.0
            if sources:
                G_sk = _derivative(strength, v, u, w, P, Q15, Q25)
                G_tk = _derivative(strength, w, u, v, P, Q15, Q25)
                sx += G_st * x + G_sk * kx
                sy += G_st * y + G_sk * ky
                sz += G_st * z + G_sk * kz
                tx += -G_st * x + G_tk * ex
                ty += -G_st * y + G_tk * ey
                tz += -G_st * z + G_tk * ez
        keep = g != 0.0
        out_i[m], out_j[m], out_G[m] = atom[s], atom[t], g
        out_r[m, 0], out_r[m, 1], out_r[m, 2] = x, y, z
        if sources:
            # ∂U^(s)/∂x_t is a third of what the triples' energies change with x_t.
            out_D[m, 0, 0], out_D[m, 0, 1], out_D[m, 0, 2] = tx / 3.0, ty / 3.0, tz / 3.0
            out_D[m, 1, 0], out_D[m, 1, 1], out_D[m, 1, 2] = sx / 3.0, sy / 3.0, sz / 3.0
            keep = keep or sx != 0.0 or sy != 0.0 or sz != 0.0 or tx != 0.0 or ty != 0.0 or tz != 0.0
        m += 1 if keep else 0
    return m, total, -1


@pair_style("atm")
def _atm(inp):
    if len(inp.args) != 2:
        raise inp.wrong("pair_style atm takes two cutoffs, of distances and of the cube root of their product")
    cutoff, triple = (inp.number(w, 1.0, "a cutoff") for w in inp.args)
    if not inp.coeffs:
        raise inp.error("pair_style atm has no pair_coeff line: add 'pair_coeff * * * <nu>'")
    n = inp.n_types
    lines = []
    for line in inp.coeffs:
        if len(line.words) != 2:
            raise inp.error(
                f"pair_coeff of atm takes three types and nu, got {' '.join(line.words) or 'nothing'} behind the "
                "first two",
                line,
            )
        lines.append((_types(inp, line), inp.number(line.words[1], 1.0, "nu", line), line))
        n = max(n, *lines[-1][0]) if lines[-1][0][1] is not None else n
    everything = all(t.lo == 1 and t.hi is None for t in lines[-1][2].types) and lines[-1][0] == (1, None)
    if everything and (inp.wanted is None or inp.wanted[1:, 1:].all()):
        return AxilrodTeller(lines[-1][1], cutoff, triple, units=inp.units)
    nu = np.zeros((n, n, n))
    for (lo, hi), value, line in lines:
        triples = [(i, j, k) for i, j in line.covers(n) for k in range(max(lo, j), (n if hi is None else hi) + 1)]
        if not triples:
            raise inp.error("pair_coeff of atm: give the three types in ascending order", line)
        for t in triples:
            for i, j, k in set(permutations(t)):
                nu[i - 1, j - 1, k - 1] = value
    # A pair is given by the first two types of some line, as LAMMPS counts; triples that no line names have no energy.
    given = {pair for _, _, line in lines for pair in line.covers(n)}
    for i in range(1, n + 1):
        for j in range(i, n + 1):
            known = inp.wanted is not None and j < len(inp.wanted)
            if (i, j) not in given and (inp.wanted is None or (known and inp.wanted[i, j])):
                raise inp.error(f"pair_style atm: no pair_coeff for types {i} and {j}: add 'pair_coeff {i} {j} * <nu>'")
            if known and not inp.wanted[i, j] and (nu[i - 1, j - 1] != 0.0).any():
                raise inp.error(
                    f"pair_style atm: types {i} and {j} belong to another sub-style but have a nu: use hybrid/overlay"
                )
    return AxilrodTeller(nu, cutoff, triple, units=inp.units)


def _types(inp, line):
    """(lo, hi) of the third type: 2, *, 2*, *3 or 1*3; hi None is open."""
    word = inp.labels.get("atom", {}).get(line.words[0], line.words[0])
    lo, star, hi = str(word).partition("*")
    try:
        return (int(lo), int(lo)) if not star else (int(lo or 1), int(hi) if hi else None)
    except ValueError:
        raise inp.error(
            f"pair_coeff of atm: expected a third type such as 1, * or 2*4, got {line.words[0]!r}", line
        ) from None
