"""Viscoelastic ordinary state-based solid: a share of the shear stiffness relaxes (J. A. Mitchell, Sandia report
SAND2011-8064; LAMMPS's `peri/ves`).

The deviatoric extension e^d_i = e − θ_i|ξ|/d of a bond drives a dashpot, ė^db = (e^d − e^db)/τ, and its force state is
t = t_LPS − λ b/m ω e^db: springs of (1 − λ)G beside Maxwell elements of λG. As the dashpot is linear, its extension is
that of a bond (of e) less that of the ends' dilatations: one number a bond and one a node are kept.
"""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ..lanes import gather_positions
from .force_model import ForceModel, deformed
from .lps import LPS, StateModel, less_slack, row_of


class Viscoelastic(LPS):
    """LPS whose shear stiffness falls from G to (1 − `fraction`) G in the relaxation time `time`.

    Parameters
    ----------
    bulk, shear : K and G, of a sudden load; or youngs, poisson
    fraction : λ, between 0 and 1
    time : τ > 0
    influence, volume_correction, surface_correction : as of `LPS`

    Within a step extensions change evenly, for which the dashpot is exact. What it takes is `dissipated_material` in
    the ledger. Static solvers refuse it: what is at rest depends on its history.
    """

    name = "viscoelastic"
    elastic = False

    def __init__(
        self,
        bulk=None,
        shear=None,
        *,
        youngs=None,
        poisson=None,
        fraction=0.5,
        time=1.0,
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
        if not 0 <= fraction <= 1:
            raise AtcError(f"{self.name}: fraction is the share of G that relaxes, between 0 and 1, got {fraction!r}")
        if not (time > 0 and np.isfinite(time)):
            raise AtcError(f"{self.name}: time must be a relaxation time greater than 0, got {time!r}")
        self.fraction, self.time = float(fraction), float(time)


class ViscousModel(StateModel):
    """`StateModel` and its dashpots. `history` (of the state): extension_b, back_b, dilatation_n, back_n, of the last
    step."""

    remembers = True

    def __init__(self, body, materials, *args, **options):
        super().__init__(body, materials, *args, **options)
        times = {materials[m].time for m in self.ids}
        if len(times) > 1:
            raise AtcError(
                f"viscoelastic: the materials of one body must share the relaxation time, got {sorted(times)}"
            )
        self.time = times.pop()
        t = self.table
        self.soft_n = self.per_node(lambda m: m.fraction) * self.B_n
        self.soft_b = self.W_b * (self.soft_n[t.i_b] + self.soft_n[t.j_b])
        self._step = None

    def remember(self, history):
        """Go on from a state's history; an empty one begins."""
        super().remember(history)
        if "back_b" not in history:
            b, n = len(self.table), self.n
            history.update(extension_b=np.zeros(b), back_b=np.zeros(b), dilatation_n=np.zeros(n), back_n=np.zeros(n))

    def advance(self, dt):
        """The next forces are those a time `dt` later."""
        self._step = dt

    heat = ForceModel.heat

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        t, H = self.standing(intact_b, self.table.r0_b, self.W_b, self.WB_b, self.soft_b), self.history
        r0, W, WB, soft = t.columns
        self.extend(z, t, r0, W)
        d = self.body.dimension
        theta = d * np.divide(self.S_n, self.M_n, out=np.zeros(self.n), where=self.M_n > 0)
        walked = t.walked
        e = self.e_b[: len(t.j_b)]
        back = H["back_b"][walked]
        if self._step is not None:
            decay = np.exp(-self._step / self.time)
            even = 1.0 - (1.0 - decay) * self.time / self._step
            before, theta0, back_n = H["extension_b"][walked], H["dilatation_n"], H["back_n"]
            new = decay * back + (1 - decay) * before + even * (e - before)
            new_n = decay * back_n + (1 - decay) * theta0 + even * (theta - theta0)
            # What the dashpots took: their force times how far they went, the mean of before and after.
            pull, turn = 0.5 * (e + before - new - back), 0.5 * (theta + theta0 - new_n - back_n)
            taken = float((soft * pull * (new - back))[t.intact_b != 0].sum())
            self.taken = taken - float((self.soft_n * self.M_n * turn * (new_n - back_n)).sum()) / d**2
            back = new
            H["back_b"][walked], H["back_n"][:] = back, new_n
            self._step = None
        else:
            self.taken = 0.0
        H["extension_b"][walked], H["dilatation_n"][:] = e, theta
        self.y_nk[:, 3] += self.soft_n * H["back_n"] / d
        self.y_nk[:, 7] = -self.y_nk[:, 3]
        slack = soft * back
        data = (r0, W, WB, self.e_b, slack)
        return self.walk(z, t, gather_positions, row_of(less_slack), data, F_nc, smin_n, damage, self.y_nk)

    def _dashpots(self, e, theta, i, b):
        """Σ over one end i of bonds b: e^db² − 2 e^d e^db, what dashpots add to e^d²."""
        d, r0 = self.body.dimension, self.table.r0_b[b]
        own = self.history["back_b"][b] - self.history["back_n"][i] * r0 / d
        return own * (own - 2 * (e - theta[i] * r0 / d))

    def energy_n(self, z, intact_b):
        out = super().energy_n(z, intact_b)
        theta = self.dilatation_n(z, intact_b)[0]
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            W = 0.5 * self.W_b[b] * (intact_b[b] != 0)
            out += self.soft_n * np.bincount(i, W * self._dashpots(e, theta, i, b), self.n)
            out += self.soft_n * np.bincount(j, W * self._dashpots(e, theta, j, b), self.n)
        return out

    def lost(self, z, which):
        i, j, _, _, e, _ = deformed(self, z, which)
        theta = self.history["dilatation_n"]
        W = 0.5 * self.W_b[which]
        more = W * (self.soft_n[i] * self._dashpots(e, theta, i, which))
        more += W * (self.soft_n[j] * self._dashpots(e, theta, j, which))
        return super().lost(z, which) + float(more.sum())

    def forces_of_bonds(self, z, intact_b, whole):
        out = super().forces_of_bonds(z, intact_b, whole)
        d, H = self.body.dimension, self.history
        A = self.soft_n * H["back_n"] / d
        turned = self.W_b[whole] * (A[out.i] + A[out.j]) * self.table.r0_b[whole]
        out.add(turned - self.soft_b[whole] * H["back_b"][whole])
        return out


Viscoelastic.model = ViscousModel
