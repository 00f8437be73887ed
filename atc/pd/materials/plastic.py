"""Perfectly plastic ordinary state-based solid (J. A. Mitchell, Sandia report SAND2011-3166).

A node's deviatoric force state is that of the extensions e less those that have flowed, t^d = (b/m) ω x, with x the
deviator of e − p. It yields where ½‖t^d‖² would exceed ψ₀, and flows along t^d: x returns to the yield surface along
itself, by a share that is one number a node. With the norm ‖t‖² = ∫ t²/ω dV this holds for every influence function
(Mitchell's, of ω = 1), and the yield surface is one of elastic energy: the deviatoric one, ½ (b/m) ∫ ω x² dV, is at
most σ_Y²/6μ, von Mises' in every uniform strain. A bond keeps what has flowed from each of its ends.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..bonds import JIT
from ..lanes import gather_positions
from .force_model import ForceModel, deformed
from .lps import LPS, StateModel, less_slack, row_of


class Plastic(LPS):
    """LPS that flows at the yield stress.

    Parameters
    ----------
    bulk, shear : K and G; or youngs, poisson
    yield_stress : σ_Y > 0, of a bar in tension; in shear σ_Y/√3
    influence, volume_correction, surface_correction : as of `LPS`

    Three dimensions, and plane strain, where the shear in the plane alone makes yield (von Mises' once the flow leaves
    the elastic strain behind). What flow takes is `dissipated_material` in the ledger; the state's history has
    `strain_n`, the equivalent plastic strain of each node. Static solvers refuse it: what is at rest depends on its
    history.
    """

    name = "plastic"
    elastic = False

    def __init__(
        self,
        bulk=None,
        shear=None,
        *,
        youngs=None,
        poisson=None,
        yield_stress=None,
        influence="inverse",
        volume_correction=True,
        surface_correction=None,
    ):
        super().__init__(
            bulk,
            shear,
            youngs=youngs,
            poisson=poisson,
            influence=influence,
            volume_correction=volume_correction,
            surface_correction=surface_correction,
        )
        if yield_stress is None:
            raise AtcError("plastic: it needs yield_stress, the stress at which a bar of it flows in tension")
        if not yield_stress > 0:
            raise AtcError(f"{self.name}: yield_stress must be a stress greater than 0, got {yield_stress!r}")
        self.yield_stress = float(yield_stress)


class PlasticModel(StateModel):
    """`StateModel` and what has flowed. `history` (of the state): extension_b of the last step; plastic_i_b and
    plastic_j_b, p from a bond's two ends; strain_n."""

    remembers = True

    def __init__(self, body, materials, *args, **options):
        if body.dimension == 1 or (body.dimension == 2 and body.plane == "stress"):
            what = "bars" if body.dimension == 1 else "plates in plane stress"
            raise AtcError(
                f'plastic: {what} get thinner as they flow, which their nodes cannot: take plane = "strain" or three '
                "dimensions"
            )
        super().__init__(body, materials, *args, **options)
        # ½ B Σ W x² of a node at yield.
        self.limit_n = self.per_node(lambda m: m.yield_stress**2 / (6 * m.shear)) * body.V_n
        self.shear_n = self.per_node(lambda m: m.shear)
        self._flowing = False

    def remember(self, history):
        """Go on from a state's history; an empty one begins."""
        super().remember(history)
        if "plastic_i_b" not in history:
            b = len(self.table)
            history.update({k: np.zeros(b) for k in ("extension_b", "plastic_i_b", "plastic_j_b")})
            history["strain_n"] = np.zeros(self.n)

    def advance(self, dt):
        """The next forces are those of a step, in which nodes may flow."""
        self._flowing = True

    heat = ForceModel.heat

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        t, H = self.standing(intact_b, self.table.r0_b, self.W_b, self.WB_b), self.history
        r0, W, WB = t.columns
        self.extend(z, t, r0, W)
        walked = t.walked
        e = self.e_b[: len(t.j_b)]
        p_i, p_j = H["plastic_i_b"][walked], H["plastic_j_b"][walked]
        self.taken = 0.0
        if self._flowing and self._flow(t, e, H["extension_b"][walked], p_i, p_j):
            H["plastic_i_b"][walked], H["plastic_j_b"][walked] = p_i, p_j
        self._flowing = False
        H["extension_b"][walked] = e
        i = np.repeat(np.arange(self.n, dtype=np.int32), np.diff(t.start_n))
        slack = W * (self.B_n[i] * p_i + self.B_n[t.j_b] * p_j)
        data = (r0, W, WB, self.e_b, slack)
        return self.walk(z, t, gather_positions, row_of(less_slack), data, F_nc, smin_n, damage, self.y_nk)

    def _flow(self, t, e, before, p_i, p_j):
        """Return nodes to their yield surfaces: changes p_i, p_j. Whether any has flowed."""
        r0, W, _ = t.columns
        rows = t.start_n, t.j_b, t.intact_b, r0, W, e
        c_n, trial_n = _trial(*rows, p_i, p_j, self.n)
        trial_n *= 0.5 * self.B_n
        over = trial_n > self.limit_n
        if not over.any():
            return False
        keep = np.sqrt(np.divide(self.limit_n, trial_n, out=np.ones(self.n), where=over))
        work_n, flown_n = _yielding(*rows, before, p_i, p_j, c_n, keep)
        self.taken = float((self.B_n * work_n).sum())
        # √(2/3 ε:ε) of the flow: ½ B Σ W Δp² is μ ε:ε V.
        self.history["strain_n"] += np.sqrt(self.B_n * flown_n / (3 * self.shear_n * self.body.V_n))
        return True

    def _flowed(self, e, i, j, b):
        """½ W of bonds b times B (p² − 2 e p) of each of their ends: what flow adds to their energies B e²."""
        W = 0.5 * self.W_b[b]
        p_i, p_j = self.history["plastic_i_b"][b], self.history["plastic_j_b"][b]
        return W * self.B_n[i] * p_i * (p_i - 2 * e), W * self.B_n[j] * p_j * (p_j - 2 * e)

    def energy_n(self, z, intact_b):
        out = super().energy_n(z, intact_b)
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            out += self.at_ends(i, j, *(at * (intact_b[b] != 0) for at in self._flowed(e, i, j, b)))
        return out

    def lost(self, z, which):
        i, j, _, _, e, _ = deformed(self, z, which)
        return super().lost(z, which) + float(sum(a.sum() for a in self._flowed(e, i, j, which)))

    def forces_of_bonds(self, z, intact_b, whole):
        out, H = super().forces_of_bonds(z, intact_b, whole), self.history
        flowed = self.B_n[out.i] * H["plastic_i_b"][whole] + self.B_n[out.j] * H["plastic_j_b"][whole]
        out.add(-self.W_b[whole] * flowed)
        return out


Plastic.model = PlasticModel


@njit(**JIT)
def _trial(start, j, intact, r0, W, e, p_i, p_j, n):
    """c, for which x = e − p − c|ξ| has no dilatation; and Σ W x², of each node's intact bonds."""
    c, M, Q = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        for b in range(start[i], start[i + 1]):
            if intact[b] != 0:
                k, w = j[b], W[b] * r0[b]
                c[i] += w * (e[b] - p_i[b])
                c[k] += w * (e[b] - p_j[b])
                M[i] += w * r0[b]
                M[k] += w * r0[b]
    for i in range(n):
        c[i] = c[i] / M[i] if M[i] > 0.0 else 0.0
    for i in range(n):
        for b in range(start[i], start[i + 1]):
            if intact[b] != 0:
                k = j[b]
                x = e[b] - p_i[b] - c[i] * r0[b]
                y = e[b] - p_j[b] - c[k] * r0[b]
                Q[i] += W[b] * x * x
                Q[k] += W[b] * y * y
    return c, Q


@njit(**JIT)
def _yielding(start, j, intact, r0, W, e, before, p_i, p_j, c, keep):
    """p += (1 − keep) x where nodes yield. Σ W (what pulled, the mean of before and after) Δp, and Σ W Δp²."""
    n = len(keep)
    work, flown = np.zeros(n), np.zeros(n)
    for i in range(n):
        for b in range(start[i], start[i + 1]):
            k = j[b]
            if intact[b] != 0 and (keep[i] < 1.0 or keep[k] < 1.0):
                middle = 0.5 * (e[b] + before[b])
                dp = (1.0 - keep[i]) * (e[b] - p_i[b] - c[i] * r0[b])
                work[i] += W[b] * (middle - p_i[b] - 0.5 * dp) * dp
                flown[i] += W[b] * dp * dp
                p_i[b] += dp
                dp = (1.0 - keep[k]) * (e[b] - p_j[b] - c[k] * r0[b])
                work[k] += W[b] * (middle - p_j[b] - 0.5 * dp) * dp
                flown[k] += W[b] * dp * dp
                p_j[b] += dp
    return work, flown
