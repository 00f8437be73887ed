"""The angular-dependent potential: embedded atom with dipoles and quadrupoles of the neighbourhood (LAMMPS ``pair_style
adp``)."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ...units import units as system
from .centred import Centred
from .eam_file import EAMTables, read_setfl
from .elements import ElementMap, mapped_style, named_elements, require_known
from .embedded_atom import _place, cubic, embedding, spline, take_tables
from .neighbor_work import law
from .neighborhood import around


class AngularDependent(Centred):
    """U = Σ_i [F_i(ρ_i) + ½ μ_i² + ½ Σ_st (λ_i^st)² − ν_i²/6] + Σ_pairs φ(d), μ_i = Σ_j u(d_ij) r_ij, λ_i = Σ_j w(d_ij)
    r_ij r_ij, ν_i = tr λ_i.

    Dipole and quadrupole are functions of distances, since r_ij · r_ik = c_jk = ξ_ij + ξ_ik − ξ_jk (and c_jj = 2 ξ_ij):
    μ_i² = Σ_jk u_j u_k c_jk, Σ_st (λ_i^st)² = Σ_jk w_j w_k c_jk², ν_i = Σ_j w_j d_ij². With m = Σ_k u_k, q = Σ_k w_k
    r_ik, the parts of G are

    - for the arm i–j: [F' ρ' + u' μ·r_ij + w' r_ij·λ·r_ij]/d + u_j m + 2 w_j q·r_ij − ν/3 (w' d + 2 w_j);
    - for the outer distance j–k: −u_j u_k − 2 w_j w_k c_jk.

    The many neighbours' distances are not independent: this is G of the formulas as written. Everything of U_i belongs
    to atom i, half of φ to each end, as in LAMMPS. Tables as in `EmbeddedAtom`, with LAMMPS's splines.

    Parameters
    ----------
    tables : EAMTables with u_eer and w_eer, in `units`
    elements : the tables' element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom
        is the first element.
    units : unit style of the tables; the default has eV and Å

    Notes
    -----
    Source: Mishin, Mehl & Papaconstantopoulos, Acta Mater. 53, 4029 (2005).
    """

    style = "adp"

    def __init__(self, tables: EAMTables, elements=None, *, units: str | Units = "metal"):
        self.units = u = system(units)
        if tables.u_eer is None or tables.w_eer is None:
            raise AtcError("adp: the tables have no dipole and quadrupole functions")
        used = tables.elements if elements is None else named_elements(elements)
        keep = [tables.elements.index(e) for e in used]
        self.map = ElementMap(elements, used, "pair_style adp")
        take_tables(self, tables, keep)
        self.of_pair = self.zr, self.per_dr
        energy, length, block = u.energy, u.length, np.ix_(keep, keep)
        self.u = spline(tables.u_eer[block] * (energy**0.5 / length))
        self.w = spline(tables.w_eer[block] * (energy**0.5 / length**2))

    @classmethod
    def from_file(cls, path, elements=None, *, units: str | Units = "metal", where: str = "") -> AngularDependent:
        """From an extended setfl file: ``AngularDependent.from_file("AlCu.adp", ["Al", "Cu"])``. where : the line that
        names it, for messages."""
        t = read_setfl(path, system(units).name, False, where, angular=True)
        require_known(elements, t.elements, path, where)
        return cls(t, elements, units=units).with_masses(t.elements, t.masses, where)

    def describe(self) -> str:
        return (
            f"adp{self.map.describe()}, embedding, dipole and quadrupole energy to their own atom, pair energy shared "
            "half to each; outer bonds apart"
        )

    @law
    def pair(ea, eb, d, zr, per_dr):
        m, x = _place(d, per_dr, zr.shape[2] - 1)
        z, dz = cubic(zr[ea, eb, m], x, per_dr)
        u = z / d
        return u, (dz - u) / (d * d)

    def centres(self, s0, s1, most, near, *out):
        tables = self.F, self.rho, self.u, self.w
        return _centres(s0, s1, most, near, tables, self.per_drho, self.rho_end, self.per_dr, *out)


@njit(cache=True, nogil=True, error_model="numpy")
def _centres(s0, s1, most, near, tables, per_drho, rho_end, per_dr, G_end, S_end, out, energies):
    start, pair, end, _, _, _, _, element, atom = near
    F, rho_table, u_table, w_table = tables
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(S_end) > 0
    shared = len(energies) > 0
    points = u_table.shape[2] - 1
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    u, du, w, dw, drho = np.empty(most), np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    mu, q, lam, v = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    total = 0.0
    n = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        es = element[s]
        rho = 0.0
        m = 0.0
        mu[:] = 0.0
        q[:] = 0.0
        lam[:] = 0.0
        for e in range(k):
            row, x = _place(dist[e], per_dr, points)
            ee = element[who[e]]
            value, drho[e] = cubic(rho_table[ee, es, row], x, per_dr)
            rho += value
            u[e], du[e] = cubic(u_table[es, ee, row], x, per_dr)
            w[e], dw[e] = cubic(w_table[es, ee, row], x, per_dr)
            m += u[e]
            for c in range(3):
                mu[c] += u[e] * arm[e, c]
                q[c] += w[e] * arm[e, c]
                for g in range(3):
                    lam[c, g] += w[e] * arm[e, c] * arm[e, g]
        U, slope = embedding(F[es], rho, per_drho)
        if rho > rho_end:
            U += slope * (rho - rho_end)
        nu = lam[0, 0] + lam[1, 1] + lam[2, 2]
        U += 0.5 * (mu * mu).sum() + 0.5 * (lam * lam).sum() - nu * nu / 6.0
        total += U
        if shared:
            energies[atom[s]] += U
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            along = qr = rlr = 0.0
            for c in range(3):
                v[c] = lam[c, 0] * arm[e, 0] + lam[c, 1] * arm[e, 1] + lam[c, 2] * arm[e, 2]
                along += mu[c] * arm[e, c]
                qr += q[c] * arm[e, c]
                rlr += v[c] * arm[e, c]
            radial = (slope * drho[e] + du[e] * along + dw[e] * rlr) / dist[e] - nu / 3.0 * (
                dw[e] * dist[e] + 2.0 * w[e]
            )
            G_end[p, side] = radial + u[e] * m + 2.0 * w[e] * qr
            if sources:
                for c in range(3):
                    S_end[p, side, 0, c] = -radial * arm[e, c] - u[e] * mu[c] - 2.0 * w[e] * v[c]
                    S_end[p, side, 1, c] = 0.0
            for f in range(e + 1, k):
                dot = arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]
                g = -u[e] * u[f] - 2.0 * w[e] * w[f] * dot
                if g != 0.0:
                    out_i[n], out_j[n], out_G[n] = atom[who[e]], atom[who[f]], g
                    for c in range(3):
                        out_r[n, c] = arm[f, c] - arm[e, c]
                    n += 1
    return n, total


mapped_style("adp", ending=".adp", read=AngularDependent.from_file)
