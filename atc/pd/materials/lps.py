"""Linear peridynamic solid (Silling et al. 2007; R 3.0.3-3.0.4): ordinary and state-based, any Poisson's ratio.

In d dimensions the strain energy density is ½ a (S/m)² + ½ (b/m) Σ ω e² νV with S = Σ ω|ξ| e νV, m = Σ ω|ξ|² νV, a =
d²(λ − μ), b = d(d+2) μ, which is ½λ tr²ε + μ ε:ε in a uniform strain. In 3-D θ = 3S/m, a = 3(3K − 5G) and b = 15G. m
belongs to the reference family, S to the intact bonds. Sums carry V_i too: W = ω ν V_i V_j, so that a bond's two ends
get exactly opposite forces.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ...compiled import njit, specialise, tag_of
from ...errors import AtcError
from ..blocks import node_rows
from ..bonds import JIT
from ..lanes import INLINE, C, gather, gather_positions
from ..surface import moment_factors
from .base import Isotropic
from .force_model import ForceModel, along_bonds, deformed
from .influence import critical_work, influence_function
from .rows import eights, lengthened, note


class LPS(Isotropic):
    """Ordinary state-based linear solid.

    Parameters
    ----------
    bulk, shear : K and G; or youngs, poisson. Three-dimensional constants.
    influence : ω(|ξ|, δ): "inverse" (1/|ξ|) by default, a name of `INFLUENCE` or a function
    volume_correction : the share ν of volumes near the horizon
    surface_correction : None, or "energy": bonds are weighted so that nodes, at surfaces too (but not at edges and
        corners) and in any cloud, have the classical dilatation and energy in every uniform strain
        (`surface.moment_factors`)
    expansion : linear thermal expansion α: where the temperature has risen by ΔT (`Simulation(temperature=)`) bonds
        are at rest, and break, by what they are longer than (1 + αΔT)|ξ|, ΔT the mean of their ends
    """

    name = "lps"
    elastic = True

    def __init__(
        self,
        bulk=None,
        shear=None,
        *,
        youngs=None,
        poisson=None,
        influence="inverse",
        volume_correction=True,
        surface_correction=None,
        expansion=0.0,
    ):
        super().__init__(bulk, shear, youngs=youngs, poisson=poisson)
        self.expansion = float(expansion)
        if not np.isfinite(self.expansion):
            raise AtcError(f"{self.name}: expansion must be a finite number, got {expansion!r}")
        self.influence, self.volume_correction = influence, bool(volume_correction)
        self.surface_correction = surface_correction
        if surface_correction not in (None, "energy"):
            raise AtcError(f'surface_correction must be None or "energy", got {surface_correction!r}')


class Elastic(LPS):
    """Isotropic elasticity by Young's modulus and Poisson's ratio, in the ordinary state-based model; meant for bodies
    that do not break."""

    name = "elastic"

    def __init__(
        self,
        youngs,
        poisson,
        *,
        influence="inverse",
        volume_correction=True,
        surface_correction=None,
        expansion=0.0,
    ):
        super().__init__(
            youngs=youngs,
            poisson=poisson,
            influence=influence,
            volume_correction=volume_correction,
            surface_correction=surface_correction,
            expansion=expansion,
        )


class StateModel(ForceModel):
    """LPS forces. Nodes of different materials each use their own constants: the force state of an interface node is
    that of its material.

    Where bonds break by energy `history` (of the state) has of each bond work_b, and pull_b and reach_b, its force and
    extension of the last step.
    """

    counts_work = True

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        t = self.table
        d = body.dimension
        lam_n, mu_n = self.lame_n()
        self.a_n, self.b_n = d**2 * (lam_n - mu_n), d * (d + 2) * mu_n
        self.W_b = self.weights()
        if self.first.surface_correction is not None:
            if lammps_compat:
                raise AtcError("surface_correction: LAMMPS has none, so that lammps_compat cannot be had with it")
            self.W_b *= moment_factors(body, self.W_b)
        r2 = t.r0_b**2
        if lammps_compat and len(t.image_b):
            # LAMMPS leaves out the images here: |X_j − X_i| across the box.
            r2 = ((body.X_nc[t.j_b] - body.X_nc[t.i_b]) ** 2).sum(axis=1)
            omega = influence_function(self.first.influence)
            r2 *= omega(np.sqrt(r2), body.horizon) / omega(t.r0_b, body.horizon)
        self.M_n = t.sums(self.W_b * r2)
        # The bonds of an interface count by its factor; m is that of the family as if they were whole.
        factor = self.interface_factor(interfaces)
        if factor is not None:
            self.W_b *= factor
        self.B_n = np.divide(self.b_n * body.V_n, self.M_n, out=np.zeros(self.n), where=self.M_n > 0)
        self.WB_b = self.W_b * (self.B_n[t.i_b] + self.B_n[t.j_b])
        # A = a S/m²; h turns the sum with volumes into it.
        self.h_n = np.divide(self.a_n * body.V_n, self.M_n**2, out=np.zeros(self.n), where=self.M_n > 0)
        self.S_n = np.zeros(self.n)
        self.scalar_buf = np.empty(len(self.buf))
        self.e_b = np.zeros(len(t))
        self.y_nk = node_rows(self.n)
        # Σ W |ξ| of the extensions at rest (`rest_b`) over each node's intact bonds.
        self.rest_S_n = None
        self._rest_of = None, -1
        self.history = None
        if self.rule.Gc is not None:
            self.remembers = True
            self.worth_b = self.per_bond(critical_work(self.rule.Gc, body, self.first.volume_correction)) * (
                body.V_n[t.i_b] * body.V_n[t.j_b]
            )
            if self.first.volume_correction:
                self.worth_b *= body.nu_b()

    def remember(self, history):
        """Go on from a state's history; an empty one begins."""
        if self.rule.Gc is not None and "work_b" not in history:
            history.update({k: np.zeros(len(self.table)) for k in ("work_b", "pull_b", "reach_b")})
        self.history = history

    def pull(self, rows, gather, law, z, data, F_nc, smin_n, damage):
        gone = super().pull(rows, gather, law, z, data, F_nc, smin_n, damage)
        if self.rule.Gc is None:
            return gone
        H, walked = self.history, rows.walked
        kept = [H[k][walked] for k in ("work_b", "pull_b", "reach_b")]
        slack = data[4] if len(data) > 4 else np.zeros(len(rows.j_b))
        gone = _overworked(
            rows.start_n, rows.j_b, rows.intact_b, *data[:4], slack, self.y_nk, *kept, self.worth_b[walked], damage
        )
        for k, value in zip(("work_b", "pull_b", "reach_b"), kept, strict=True):
            H[k][walked] = value
        return gone

    def heat(self, rise_n):
        """Bonds at rest are those at temperatures that have risen by `rise_n` (n,)."""
        if self.rule.Gc is not None:
            raise AtcError("temperature: bonds that are at rest expanded break by a critical stretch, not by an energy")
        t = self.table
        # Held to its plane, a plate expands by more.
        held = self.body.dimension == 2 and self.body.plane == "strain"
        more = lambda m: 1 + (3 * m.bulk - 2 * m.shear) / (2 * (3 * m.bulk + m.shear)) if held else 1.0  # noqa: E731
        alpha = self.per_node(lambda m: m.expansion * more(m)) * rise_n
        self.rest_b = 0.5 * (alpha[t.i_b] + alpha[t.j_b]) * t.r0_b
        self.rest_S_n, self._rest_of, self._standing = None, (None, -1), None

    def beyond_rest(self, e, which):
        """Extensions less those at rest of bonds `which`."""
        return e if self.rest_b is None else e - self.rest_b[which]

    def _rest_sums(self, intact_b):
        now = intact_b, int(np.count_nonzero(intact_b))
        if self._rest_of[0] is not intact_b or self._rest_of[1] != now[1]:
            self._rest_of = now
            self.rest_S_n = self.table.sums(np.where(intact_b != 0, self.W_b * self.table.r0_b * self.rest_b, 0.0))
        return self.rest_S_n

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        warm = () if self.rest_b is None else (self.rest_b,)
        t = self.standing(intact_b, self.table.r0_b, self.W_b, self.WB_b, *warm)
        r0, W, WB, *rest = t.columns
        self.extend(z, t, r0, W)
        data = (r0, W, WB, self.e_b, *rest)
        if rest:
            self.S_n -= self._rest_sums(intact_b)
            self.y_nk[:, 3] = self.h_n * self.S_n
            self.y_nk[:, 7] = -self.y_nk[:, 3]
        law = row_of(_beyond_rest if rest else _extension)
        return self.walk(z, t, gather_positions, law, data, F_nc, smin_n, damage, self.y_nk)

    def extend(self, z, t, r0, W):
        """Extensions of the bonds `t` into e_b, S into S_n; current positions and A into y_nk."""
        bl, buf = self.blocks, self.scalar_buf
        self.over_blocks(_extensions, t, z, r0, W, self.guard, t.intact_b, self.e_b, buf)
        self.crew.nodes(_gather_up, self.n, bl.lo, bl.hi, bl.offset, buf, z, self.h_n, self.S_n, self.y_nk)

    def lost(self, z, which):
        """The energy that left with bonds `which`: their own shares, and what their nodes' dilatations were worth (S_n
        is still that before)."""
        i, j, _, _, e, _ = deformed(self, z, which)
        e = self.beyond_rest(e, which)
        W, r0 = self.W_b[which], self.table.r0_b[which]
        own = float((0.5 * self.WB_b[which] * e**2).sum())
        dS = self.at_ends(i, j, W * r0 * e)
        return own + float((0.5 * self.h_n * (self.S_n**2 - (self.S_n - dS) ** 2)).sum())

    def dilatation_n(self, z, intact_b):
        """(n,) θ, less that at rest."""
        S = np.zeros(self.n)
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            e = self.beyond_rest(e, b)
            S += self.at_ends(i, j, self.W_b[b] * self.table.r0_b[b] * e * (intact_b[b] != 0))
        return self.body.dimension * np.divide(S, self.M_n, out=np.zeros(self.n), where=self.M_n > 0), S

    def energy_n(self, z, intact_b):
        theta, S = self.dilatation_n(z, intact_b)
        # LAMMPS counts the deviatoric extension half.
        less = theta / self.body.dimension if self.lammps_compat else np.zeros(self.n)
        sums = np.zeros(self.n)
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            e = self.beyond_rest(e, b)
            W, r0 = self.W_b[b] * (intact_b[b] != 0), self.table.r0_b[b]
            sums += self.at_ends(i, j, W * (e - less[i] * r0) ** 2, W * (e - less[j] * r0) ** 2)
        if not self.lammps_compat:
            return 0.5 * self.h_n * S**2 + 0.5 * self.B_n * sums
        K = self.per_node(lambda m: m.bulk)
        return 0.5 * K * theta**2 * self.body.V_n + 0.25 * self.B_n * sums

    def refresh(self, z, intact_b):
        self.S_n[:] = self.dilatation_n(z, intact_b)[1]

    def forces_of_bonds(self, z, intact_b, whole):
        i, j, eta, xi, e, r = deformed(self, z, whole)
        A = self.h_n * (self.S_n if intact_b is None else self.dilatation_n(z, intact_b)[1])
        own = self.WB_b[whole] * self.beyond_rest(e, whole)
        pull = self.W_b[whole] * (A[i] + A[j]) * self.table.r0_b[whole] + own
        return along_bonds(i, j, eta, xi, pull, r, whole)

    def stiffness_n(self):
        t = self.table
        n, h = self.n, np.maximum(self.h_n, 0.0)
        rest = self.at_rest()
        k, G, own_nc, across = np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(n)
        for b in self.parts():
            i, j, _, xi, _, _ = deformed(self, rest, b)
            W, r0 = self.W_b[b], t.r0_b[b]
            k += self.at_ends(i, j, self.WB_b[b])
            G += self.at_ends(i, j, W * r0)
            for c in range(3):
                own_nc[:, c] += self.at_ends(i, j, W * xi[:, c], -W * xi[:, c])
        # ∂S_i/∂u_i is a vector sum, zero inside; each |∂S_i/∂u_j| is Wr0.
        own = np.sqrt((own_nc**2).sum(axis=1))
        all_of = h * (G + own)
        for b in self.parts():
            i, j = t.rows_of(b), t.j_b[b]
            pull = self.W_b[b] * t.r0_b[b]
            across += self.at_ends(j, i, pull * all_of[i], pull * all_of[j])
        return k + 0.5 * (own * all_of + across)


LPS.model = StateModel


@njit(**INLINE)
def _row_extension(m, b0, w, r0, W, guard, intact, e):
    """Extensions of m bonds into e, W |ξ| e into column 0 of w."""
    for k in range(m):
        b = np.uint64(b0) + np.uint64(k)
        L = r0[b]
        q, r = lengthened(k, w, L)
        q /= r + L
        # Extensions up to `guard` count as none.
        q = q if abs(q) > guard else 0.0
        e[b] = q
        w[k] = W[b] * L * q if intact[b] != 0 else 0.0


@njit(**JIT)
def _extensions(first, last, edges, lo, hi, offset, start, j, image, images, z, r0, W, guard, intact, e, buf):
    """Extensions of blocks first..last, and Σ W |ξ| e into their buffers."""
    w = np.empty(8 * C)
    node = np.empty(C + 8, np.int32)
    for block in range(first, last):
        f = buf[offset[block] : offset[block + 1]]
        f[:] = 0.0
        base = lo[block]
        # The last row of a block must not write into the next one's, which another thread may be at.
        end = start[edges[block + 1]]
        for i in range(edges[block], edges[block + 1]):
            total = 0.0
            for b0 in range(start[i], start[i + 1], C):
                m = min(C, start[i + 1] - b0)
                gather(b0, m, i, j, image, images, z, node, w)
                full = min((m + 7) & ~7, end - b0)
                _row_extension(full, b0, w, r0, W, guard, intact, e)
                # Bond by bond, so that bonds without extension change nothing wherever they stand.
                for k in range(m):
                    f[np.uint64(j[b0 + k] - base)] += w[k]
                    total += w[k]
            f[i - base] += total


@njit(**JIT)
def _gather_up(a, b, lo, hi, offset, buf, z, h, S, y):
    """S[n] = Σ over blocks, in their order; and what the force sum reads of a node, side by side: current position, A =
    a S/m²; then once more with −A, for what is subtracted from the other end's."""
    S[a:b] = 0.0
    for k in range(len(lo)):
        shift = offset[k] - lo[k]
        for n in range(max(a, lo[k]), min(b, hi[k])):
            S[n] += buf[n + shift]
    for n in range(a, b):
        y[n, 0] = z[n, 0] + z[n, 3]
        y[n, 1] = z[n, 1] + z[n, 4]
        y[n, 2] = z[n, 2] + z[n, 5]
        y[n, 3] = h[n] * S[n]
        for c in range(3):
            y[n, 4 + c] = y[n, c]
        y[n, 7] = -y[n, 3]


# What of a bond's extension pulls, and what does not for all that; the numbers of each bond are in `data`.


@njit(**INLINE)
def _extension(data, b):
    return data[3][b], 0.0


@njit(**INLINE)
def _beyond_rest(data, b):
    """Of bonds that are at rest at an extension of their own."""
    return data[3][b] - data[4][b], 0.0


@njit(**INLINE)
def less_slack(data, b):
    """Of bonds in which dashpots, or plastic flow, have let go."""
    return data[3][b], data[4][b]


# Replaced in each copy, see `row_of`.
PULLS = None


@cache
def row_of(pulls):
    """`_row` with what of a bond's extension pulls in it, for `rows.force_loop`."""
    return specialise(_row, tag_of(pulls), INLINE, PULLS=pulls)


def _row(m, b0, i, node, w, v, intact, data):
    """Extensions are known."""
    r0, W, WB, e = data[:4]
    for k in range(eights(m, b0, intact)):
        b = np.uint64(b0) + np.uint64(k)
        L = r0[b]
        x, slack = PULLS(data, b)
        r = L + e[b]
        D = r * L
        D = 1.0 / D if D > 0.0 else 0.0
        s = x * D * r if r > 0.0 else -1.0
        whole = intact[b] != 0
        K = (W[b] * w[3 * C + k] * L + WB[b] * x - slack) * D * L
        K = K if whole else 0.0
        w[k] *= K
        w[C + k] *= K
        w[2 * C + k] *= K
        note(k, w, s, whole)


@njit(**JIT)
def _overworked(start, j, intact, r0, W, WB, e, slack, y, work, pull, reach, worth, damage):
    """Add what the forces have done to each bond since the last step, with the mean of both. The bonds, in their order,
    that this has broken (with `damage`)."""
    gone = np.empty(len(j), np.int64)
    n = 0
    for i in range(len(start) - 1):
        for b in range(start[i], start[i + 1]):
            if intact[b] != 0:
                f = W[b] * (y[i, 3] + y[j[b], 3]) * r0[b] + WB[b] * e[b] - slack[b]
                work[b] += 0.5 * (f + pull[b]) * (e[b] - reach[b])
                pull[b] = f
                reach[b] = e[b]
                if damage and intact[b] == 1 and work[b] > worth[b] and e[b] > 0.0:
                    intact[b] = 0
                    gone[n] = b
                    n += 1
    return gone[:n].copy()
