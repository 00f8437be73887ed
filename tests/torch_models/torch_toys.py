"""Energies of atoms as functions of edges, small enough to be seen through: with known forms, and with random weights."""

import numpy as np
import torch

CUTOFF = 4.2


def lennard_jones(epsilon=0.0104, sigma=3.4):
    def energies(r, c, n, types):
        s6 = (sigma**2 / (r * r).sum(1)) ** 3
        return per_atom(2.0 * epsilon * (s6 * s6 - s6), c, types)

    return energies


def stillinger_weber(types_of=None):
    """Silicon, half of each pair to each atom, triplets to their centre."""
    eps, sigma, a, lam, gamma, A, B = 2.1683, 2.0951, 1.80, 21.0, 1.20, 7.049556277, 0.6022245584

    def energies(r, c, n, types):
        d = r.norm(dim=1)
        inside = d < a * sigma
        tail = torch.where(inside, torch.exp(sigma / torch.where(inside, d - a * sigma, -1.0)), 0.0)
        pair = A * eps * (B * (sigma / d) ** 4 - 1.0) * tail
        e, f = triplets(c)
        cos = (r[e] * r[f]).sum(1) / (d[e] * d[f])
        both = inside[e] & inside[f]
        damp = torch.exp(
            torch.where(both, gamma * sigma / torch.where(both, d[e] - a * sigma, -1.0), -700.0)
            + torch.where(both, gamma * sigma / torch.where(both, d[f] - a * sigma, -1.0), 0.0)
        )
        return per_atom(0.5 * pair, c, types) + per_atom(lam * eps * (cos + 0.333333333333) ** 2 * damp, c[e], types)

    return energies


def triplets(c):
    """Pairs of edges (e < f) with the same centre; edges are ordered by centre."""
    count = torch.bincount(c)
    start = torch.cumsum(count, 0) - count
    e, f = [], []
    for s, k in zip(start.tolist(), count.tolist(), strict=True):
        a, b = np.triu_indices(k, 1)
        e.append(a + s)
        f.append(b + s)
    return torch.as_tensor(np.concatenate(e)), torch.as_tensor(np.concatenate(f))


def per_atom(x_e, c, types):
    return torch.zeros(len(types), *x_e.shape[1:], dtype=x_e.dtype, device=x_e.device).index_add(0, c, x_e)


class Messages:
    """Scalars and vectors of random weights over `hops` layers.

    both_ends : the last messages are added at the neighbour too. pooled : features see the mean over all atoms
    """

    def __init__(self, hops=1, channels=5, seed=0, both_ends=False, pooled=False, kinds=3):
        rng = np.random.default_rng(seed)
        self.hops, self.channels, self.both_ends, self.pooled = hops, channels, both_ends, pooled
        k = channels
        self.w = [torch.tensor(rng.normal(size=(7, k)) / 2) for _ in range(2 * hops)]
        self.mix = [torch.tensor(rng.normal(size=(k, k)) / np.sqrt(k)) for _ in range(3 * hops)]
        self.kind = torch.tensor(rng.normal(size=(kinds, k)))
        self.read = torch.tensor(rng.normal(size=k))

    def __call__(self, r, c, n, types):
        d = r.norm(dim=1, keepdim=True)
        unit = r / d
        # Four derivatives vanish at the cutoff.
        fc = torch.clamp(1.0 - (d / CUTOFF) ** 2, min=0.0) ** 5
        basis = torch.cat([torch.cos(k * np.pi * d / CUTOFF) for k in range(7)], 1) * fc
        s = self.kind[types % len(self.kind)]
        v = torch.zeros(len(types), self.channels, 3, dtype=r.dtype)
        for layer in range(self.hops):
            f, g = basis @ self.w[2 * layer], basis @ self.w[2 * layer + 1]
            sn, vn = s[n], v.index_select(0, n)
            # vectors of neighbours along the edge, their scalars, and the scalars as vectors along the edge
            scalar = f * torch.tanh(sn @ self.mix[3 * layer]) + g * (vn * unit[:, None, :]).sum(2)
            vector = (g * sn)[:, :, None] * unit[:, None, :] + f[:, :, None] * vn
            new = per_atom(scalar, c, types)
            if self.both_ends and layer == self.hops - 1:
                new = new + per_atom(0.3 * scalar, n, types)
            v = v + per_atom(vector, c, types)
            s = torch.tanh(s @ self.mix[3 * layer + 1] + new + (v * v).sum(2) @ self.mix[3 * layer + 2] * 0.1)
            if self.pooled:
                s = s + 0.5 * s.mean(0, keepdim=True)
        return s @ self.read
