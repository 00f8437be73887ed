"""Energy release rate at which a crack goes on, over the fracture energy that was asked for.

    python benchmarks/energy_release.py [SPACINGS ...] [horizon] [anywhere]      a minute for 8 12 16 24

horizon : several horizons to a spacing. anywhere : bonds beside the plane may break too (minutes).


A strip, cut half through in its middle plane, has its edges pulled apart and held (Rivlin & Thomas 1953): ahead of the
crack strain is uniform, behind there is none, and whatever its length, a new unit of it releases G = 2h W,
W = ½ E ε²/(1 − ν²) in plane stress. The crack goes on quasi-statically, bond by bond: of a linear body the load is
found at which the next bond breaks, that bond is taken out, and so on.

The stiffness K is factorised once. A bond that is taken out changes the energy by ½ qᵀDq, q its extension and the sums
S of its two nodes: with G x = q of all bonds that may break, and F = G K⁻¹ Gᵀ, then q' = q − F D (1 + F D)⁻¹ q and
likewise F, of rank 3 a bond.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

from atc import pd

E, GC = 1.0, 1e-4


class Strip:
    """Half of the height is 1, of `half` spacings. kind : "pmb", "lps", or "energy" (`lps` that breaks by a critical
    energy). correction : the material's `surface_correction`; ratio : of the horizon to the spacing."""

    def __init__(self, half: int, kind: str, length: float = 4.0, ratio: float = 3.015, correction="energy", nu=0.25):
        self.dx, self.length, self.kind = 1.0 / half, length, kind
        dx, self.nu = self.dx, 1 / 3 if kind == "pmb" else nu
        grip = np.floor(ratio) * dx
        self.body = body = pd.Body.lattice(
            pd.Box((0, -1 - grip, 0), (length, 1 + grip, 0)), dx, ratio * dx, 1.0, dimension=2, thickness=1.0,
            offset=(0.5 * dx, 0.5 * dx, 0.0), warn=False,
            notches=[pd.Notch.line((-dx, 0.0), (0.5 * length, 0.0), as_damage=True)],
        )  # fmt: skip
        make = pd.PMB if kind == "pmb" else pd.LPS
        more = {} if kind == "pmb" else {"poisson": self.nu}
        material = make(youngs=E, surface_correction=correction, **more)
        damage = pd.CriticalEnergy(GC) if kind == "energy" else pd.CriticalStretch.from_energy(GC, material, body)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = pd.Simulation(body, material, damage=damage, threads=1)
        self.sim, t = sim, body.bonds
        self.model, self.s00 = sim.model, float(sim.model.rule.s00[0])
        self.i, self.j, self.r = t.i_b, t.j_b, t.r0_b
        y = body.X_nc[:, 1]
        self.held = np.abs(y) > 1.0
        # Held nodes go with the uniform strain of 1: then the strip ahead of the crack is strained uniformly.
        self.grip_nc = np.where(self.held, y, 0.0)[:, None] * [0.0, 1.0]
        self.across = (y[self.i] > 0) != (y[self.j] > 0)
        # Where bonds cross the plane, of others their middle.
        part = np.where(self.across, -y[self.i] / np.where(self.across, y[self.j] - y[self.i], 1.0), 0.5)
        self.x_b = (1 - part) * body.X_nc[self.i, 0] + part * body.X_nc[self.j, 0]
        self.u = t.xi_bc(body.X_nc)[:, :2] / self.r[:, None]
        self._at_rest()

    def _at_rest(self):
        """Places and extensions under a strain of 1 at the edges, with the bonds that are there from the start."""
        from scipy.sparse import csr_matrix, diags
        from scipy.sparse.linalg import splu

        n, b = len(self.body), len(self.r)
        rows = np.repeat(np.arange(b), 4)
        columns = np.stack([2 * self.i, 2 * self.i + 1, 2 * self.j, 2 * self.j + 1], 1).ravel()
        whole = np.array(self.sim.state.intact_b, float)
        self.stretch = csr_matrix((np.concatenate([-self.u, self.u], 1).ravel(), (rows, columns)), (b, 2 * n))
        m = self.model
        # Of each bond its own spring; of each node ½ h S² of the sum S = Σ w e of its bonds.
        if self.kind == "pmb":
            self.own, self.w, self.h = m.W_b / self.r, np.zeros(b), np.zeros(n)
        else:
            self.own, self.w, self.h = m.WB_b, m.W_b * self.r, m.h_n
        ends = csr_matrix((np.ones(2 * b), (np.concatenate([self.i, self.j]), np.tile(np.arange(b), 2))), (n, b))
        self.sums = (ends @ diags(self.w * whole) @ self.stretch).tocsr()
        A = self.stretch.T @ diags(self.own * whole) @ self.stretch
        if self.kind != "pmb":
            A = A + self.sums.T @ diags(self.h) @ self.sums
        A, self.free = A.tocsr(), np.repeat(~self.held, 2)
        self.lu = splu(A[self.free][:, self.free].tocsc())
        self.x0 = self.grip_nc.ravel().copy()
        self.x0[self.free] = -self.lu.solve(A[self.free][:, ~self.free] @ self.x0[~self.free])
        self.energy0 = 0.5 * float(self.x0 @ (A @ self.x0))
        self.whole = whole

    def watch(self, bonds):
        """The bonds that may break from now on: q has their extensions, and the sums of their nodes."""
        from scipy.sparse import vstack

        self.bonds = bonds
        self.nodes = np.unique(np.concatenate([self.i[bonds], self.j[bonds]]))
        G = vstack([self.stretch[bonds], *([] if self.kind == "pmb" else [self.sums[self.nodes]])]).tocsr()
        Gf = G[:, self.free]
        self.F, self.q = np.empty((G.shape[0],) * 2), G @ self.x0
        for k in range(0, G.shape[0], 256):
            self.F[:, k : k + 256] = Gf @ self.lu.solve(Gf[k : k + 256].T.toarray())
        self.energy = self.energy0
        self.ends = len(bonds) + np.searchsorted(self.nodes, np.stack([self.i[bonds], self.j[bonds]], 1))

    def take_out(self, which):
        """Break watched bonds, one after the other: q, F and the energy are then those without them."""
        for k in which:
            b = self.bonds[k]
            if self.kind == "pmb":
                at, D = np.array([k]), np.array([[-self.own[b]]])
            else:
                # ½ h (S − w e)² for ½ h S² at both ends.
                w, h = self.w[b], self.h[[self.i[b], self.j[b]]]
                at, D = np.array([k, *self.ends[k]]), np.zeros((3, 3))
                D[0, 0] = -self.own[b] + w**2 * h.sum()
                D[0, 1:] = D[1:, 0] = -w * h
            M = D @ np.linalg.inv(np.eye(len(at)) + self.F[np.ix_(at, at)] @ D)
            back = M @ self.q[at]
            self.energy += 0.5 * float(self.q[at] @ back)
            self.q -= self.F[:, at] @ back
            self.F -= self.F[:, at] @ (M @ self.F[at])
            for n in at[1:]:
                self.q[n] -= self.w[b] * self.q[k]
                self.F[n] -= self.w[b] * self.F[k]
                self.F[:, n] -= self.w[b] * self.F[:, k]

    def bond_state(self):
        """Extension and force of every watched bond under a strain of 1."""
        e = self.q[: len(self.bonds)]
        f = self.own[self.bonds] * e
        if self.kind != "pmb":
            hS = self.h[self.nodes] * self.q[len(self.bonds) :]
            f = f + self.w[self.bonds] * hS[self.ends - len(self.bonds)].sum(axis=1)
        return e.copy(), f


def release(
    half: int, kind: str, columns: int = 6, skip: int = 3, anywhere: bool = False, ahead=2.5, **options
) -> dict:
    """What it takes for the crack to go on from `skip` to `columns` columns, over Gc.

    largest, mean : G, over the bonds across the plane. spent : the energy that the body loses per area of the crack.
    cut : what the bonds of a straight cut cost. beside : bonds that break beside the plane for one that does across it,
    where they may (`anywhere`). closed form : G by what energy a straight crack has less that is longer by so many
    columns, over 2h W; the G of the others is that by the energy, so that the height of the grips does not count.
    """
    s = Strip(half, kind, **options)
    tip, delta = 0.5 * s.length, s.body.horizon
    y_b = 0.5 * (s.body.X_nc[s.i, 1] + s.body.X_nc[s.j, 1])
    zone = (s.across | (anywhere & (np.abs(y_b) < 1.01 * delta))) & (s.whole > 0)
    s.watch(np.flatnonzero(zone & (s.x_b > tip - delta) & (s.x_b < tip + columns * s.dx + ahead * delta)))
    r, x_b, across = s.r[s.bonds], s.x_b[s.bonds], s.across[s.bonds]
    worth = s.model.worth_b[s.bonds] if kind == "energy" else None
    start = s.F.copy(), s.q.copy(), s.energy
    U = []
    for a, b in ((-9, skip), (skip, columns)):
        behind = x_b < tip + (b - 1e-6) * s.dx
        s.take_out(np.flatnonzero(across & behind & (x_b > tip + (a - 1e-6) * s.dx)))
        U.append(s.energy)
    G1 = (U[0] - U[1]) / ((columns - skip) * s.dx)
    s.F, s.q, s.energy = start
    gone, left = np.zeros(len(r), bool), np.zeros(len(r))
    loads, off, spent, a_column = [], 0, 0.0, across.sum() / np.ptp(x_b[across]) * s.dx
    e, f = s.bond_state()
    while (done := (gone & across).sum() / a_column) < columns:
        open_ = ~gone & (e > 0)
        if worth is None:
            load = np.where(open_, s.s00 * r / np.where(open_, e, 1.0), np.inf)
        else:
            # ½ f e λ² is the work of a bond when the body is loaded as it is now, `left` what is left of before.
            open_ &= f * e > 0
            room = np.maximum(worth - left, 0.0) / np.where(open_, 0.5 * f * e, np.inf)
            load = np.where(open_, np.sqrt(room), np.inf)
        # Mirror images and equals break together.
        lam = load.min()
        first = load <= lam * (1 + 1e-9)
        if x_b[first].max() > x_b.max() - delta:
            raise RuntimeError("the crack has come to the end of the bonds that are watched")
        gone |= first
        before = e, f, s.energy
        s.take_out(np.flatnonzero(first))
        e, f = s.bond_state()
        if worth is not None:
            left += 0.5 * lam**2 * (before[1] * e - f * before[0]) * ~gone
        if done >= skip:
            loads += [lam] * int((first & across).sum())
            off += int((first & ~across).sum())
            spent += lam**2 * (before[2] - s.energy)
    cost = s.model.worth_b if kind == "energy" else 0.5 * s.own * (s.s00 * s.r) ** 2
    column = s.across & (np.abs(s.x_b - tip + 1e-6 * s.dx) < 1.5 * s.dx)
    G = G1 * np.array(loads) ** 2 / GC
    return {
        "largest": G.max(),
        "mean": G.mean(),
        "spent": spent * a_column / len(loads) / s.dx / GC,
        "cut": cost[column].sum() / (3 * s.dx) / GC,
        "beside": off / len(loads),
        "closed form": G1 * (1 - s.nu**2) / E,
    }


NAMES = (("pmb", "stretch, `pmb`"), ("lps", "stretch, `lps`"), ("energy", "energy, `lps`"))


def main(*words) -> None:
    cases = [(int(w), 3.015, 3) for w in words if w.isdigit()]
    if "horizon" in words:
        # Four horizons to half of the height.
        cases += [(4 * m, m + 0.015, m) for m in (2, 3, 4)]
    heads = ("spacings to half of the height", "to a horizon", "bonds break by", "largest G", "mean", "energy spent",
             "a straight cut's bonds", "broken beside the plane", "closed form")  # fmt: skip
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for half, ratio, skip in cases or [(half, 3.015, 3) for half in (8, 12, 16, 24)]:
        for kind, name in NAMES:
            v = release(half, kind, ratio=ratio, skip=skip, columns=skip + 3, anywhere="anywhere" in words)
            print(f"| {half} | {ratio} | {name} | " + " | ".join(f"{a:.3f}" for a in v.values()) + " |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
