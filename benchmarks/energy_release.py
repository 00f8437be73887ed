"""Energy release rate at which a crack goes on, over the fracture energy that was asked for.

    python benchmarks/energy_release.py [SPACINGS ...]      a minute for 8 12 16

A strip, cut half through in its middle plane, has its edges pulled apart and held (Rivlin & Thomas 1953): ahead of the
crack strain is uniform, behind there is none, and whatever its length, a new unit of it releases G = 2h W,
W = ½ E ε²/(1 − ν²) in plane stress. The crack goes on quasi-statically, bond by bond: of a linear body the load is
found at which the next bond across the middle plane breaks, that bond is taken out, and so on.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

from atc import pd

E, GC = 1.0, 1e-4


class Strip:
    """Half of the height is 1, of `half` spacings. kind : "pmb", "lps", or "energy" (`lps` that breaks by a critical
    energy)."""

    def __init__(self, half: int, kind: str, length: float = 4.0, ratio: float = 3.015):
        self.dx, self.length, self.kind = 1.0 / half, length, kind
        dx, self.nu = self.dx, 1 / 3 if kind == "pmb" else 0.25
        grip = 3 * dx
        self.body = body = pd.Body.lattice(
            pd.Box((0, -1 - grip, 0), (length, 1 + grip, 0)), dx, ratio * dx, 1.0, dimension=2, thickness=1.0,
            offset=(0.5 * dx, 0.5 * dx, 0.0), warn=False,
            notches=[pd.Notch.line((-dx, 0.0), (0.5 * length, 0.0), as_damage=True)],
        )  # fmt: skip
        make = pd.PMB if kind == "pmb" else pd.LPS
        more = {} if kind == "pmb" else {"poisson": self.nu}
        material = make(youngs=E, surface_correction="energy", **more)
        damage = pd.CriticalEnergy(GC) if kind == "energy" else pd.CriticalStretch.from_energy(GC, material, body)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = pd.Simulation(body, material, damage=damage, threads=1)
        self.sim, t = sim, body.bonds
        self.s00 = float(sim.model.rule.s00[0])
        self.i, self.j, self.r = t.i_b, t.j_b, t.r0_b
        y = body.X_nc[:, 1]
        self.held = np.abs(y) > 1.0
        # Held nodes go with the uniform strain of 1: then the strip ahead of the crack is strained uniformly.
        self.grip_nc = np.where(self.held, y, 0.0)[:, None] * [0.0, 1.0]
        self.across = (y[self.i] > 0) != (y[self.j] > 0)
        self.x_b = 0.5 * (body.X_nc[self.i, 0] + body.X_nc[self.j, 0])
        self.u = t.xi_bc(body.X_nc)[:, :2] / self.r[:, None]

    def solve(self, whole):
        """Extension and force of every bond under a strain of 1 at the edges, and the energy of the body."""
        from scipy.sparse import csr_matrix, diags
        from scipy.sparse.linalg import spsolve

        n, b = len(self.body), len(self.r)
        rows = np.repeat(np.arange(b), 4)
        columns = np.stack([2 * self.i, 2 * self.i + 1, 2 * self.j, 2 * self.j + 1], 1).ravel()
        stretch = csr_matrix((np.concatenate([-self.u, self.u], 1).ravel(), (rows, columns)), (b, 2 * n))
        own, spread = self.stiffness(whole)
        A = stretch.T @ diags(own) @ stretch
        if spread is not None:
            w, h = spread
            ends = csr_matrix((np.ones(2 * b), (np.concatenate([self.i, self.j]), np.tile(np.arange(b), 2))), (n, b))
            S = ends @ diags(w) @ stretch
            A = A + S.T @ diags(h) @ S
        free = np.repeat(~self.held, 2)
        x = self.grip_nc.ravel().copy()
        A = A.tocsr()
        x[free] = spsolve(A[free][:, free].tocsc(), -(A[free][:, ~free] @ x[~free]))
        e = stretch @ x
        f = own * e
        if spread is not None:
            q = h * (S @ x)
            f = f + w * (q[self.i] + q[self.j])
        return e, f, 0.5 * float(x @ (A @ x))

    def stiffness(self, whole):
        """Spring constants of the bonds, and what dilatations add: weights of extensions and of their squared sums."""
        m = self.sim.model
        if self.kind == "pmb":
            return whole * m.W_b / self.r, None
        return whole * m.WB_b, (whole * m.W_b * self.r, m.h_n)


def release(half: int, kind: str, columns: int = 4):
    """Largest G that the crack needs while it goes on by some columns, and its mean over the bonds, over Gc."""
    s = Strip(half, kind)
    whole = np.array(s.sim.state.intact_b, float)
    worth = s.sim.model.worth_b if kind == "energy" else None
    left = np.zeros(len(s.r))
    tip = 0.5 * s.length
    needed = []
    for _ in range(10_000):
        e, f, _ = s.solve(whole)
        candidate = s.across & (whole > 0) & (e > 0)
        if worth is None:
            load = np.where(candidate, s.s00 * s.r / np.where(candidate, e, 1.0), np.inf)
        else:
            # ½ f e λ² is the work of a bond when the body is loaded as it is now, `left` what is left of before.
            room = np.maximum(worth - left, 0.0) / np.where(candidate & (f * e > 0), 0.5 * f * e, np.inf)
            load = np.where(candidate & (f * e > 0), np.sqrt(room), np.inf)
        # Mirror images and equals break together.
        first = load <= load.min() * (1 + 1e-9)
        needed.append((float(load.min()), s.x_b[first].max()))
        done = s.x_b[s.across & (whole > 0)].min()
        if done > tip + columns * s.dx:
            break
        before = e, f
        whole[first] = 0.0
        if worth is not None:
            e, f, _ = s.solve(whole)
            left += 0.5 * load.min() ** 2 * (before[1] * e - f * before[0]) * (whole > 0)
    G1 = E / (1 - s.nu**2)
    # The first column belongs to the notch's own tip.
    loads = np.array([a for a, _ in needed[len(needed) // 3 :]])
    return G1 * loads.max() ** 2 / GC, G1 * (loads**2).mean() / GC


def main(spacings) -> None:
    print("| spacings to half of the height | bonds break by | largest G needed / Gc | mean |\n|---|---|---|---|")
    for half in spacings:
        for kind, words in (("pmb", "stretch, `pmb`"), ("lps", "stretch, `lps`"), ("energy", "energy, `lps`")):
            print(f"| {half} | {words} | " + " | ".join(f"{v:.3f}" for v in release(half, kind)) + " |", flush=True)


if __name__ == "__main__":
    main([int(a) for a in sys.argv[1:]] or [8, 12, 16])
