"""Virtual sites of a System, as a rule of `virtual_sites`: means of atoms, and places in frames that atoms span.

A site at p(x_1, .., x_K) hands its force F on by virtual work, (∂p/∂x_k)ᵀ F to each atom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ..constraints.virtual_sites import Places
from ..images import Images
from .formulas import OPENMM, _number

#: Of complex steps, whose derivatives have no rounding of differences.
_STEP = 1e-30


@dataclass
class _Group:
    """Sites of one kind with K atoms each: site_m, atoms_mk, and the numbers of the kind, (m, ..)."""

    kind: str
    site_m: np.ndarray
    atoms_mk: np.ndarray
    numbers: np.ndarray

    def place(self, r_mkc):
        """(m, 3) of the sites, from the places of their atoms, both relative to the first atom."""
        w = self.numbers
        if self.kind == "average":
            return np.einsum("mk,mkc->mc", w, r_mkc)
        if self.kind == "plane":
            a, b = r_mkc[:, 1], r_mkc[:, 2]
            return w[:, :1] * a + w[:, 1:2] * b + w[:, 2:] * np.cross(a, b)
        k = r_mkc.shape[1]
        origin, x, y = (np.einsum("mk,mkc->mc", w[:, s * k : (s + 1) * k], r_mkc) for s in range(3))
        z = np.cross(x, y)
        # No absolute values: complex steps go through.
        x, z = (v / np.sqrt((v * v).sum(axis=1))[:, None] for v in (x, z))
        px, py, pz = (w[:, 3 * k + c : 3 * k + c + 1] for c in range(3))
        return origin + px * x + py * np.cross(z, x) + pz * z

    def weights(self):
        """(m, k) shares of the atoms in what a site has; they add up to 1."""
        w = self.numbers
        if self.kind == "plane":
            return np.stack([1.0 - w[:, 0] - w[:, 1], w[:, 0], w[:, 1]], axis=1)
        return w[:, : self.atoms_mk.shape[1]]

    def slopes(self, r_mkc):
        """(m, k, 3, 3) ∂p_b/∂x_ka, indices k, a, b; those of all atoms of a site add up to 1."""
        m, k, _ = r_mkc.shape
        out = np.zeros((m, k, 3, 3))
        for n in range(1, k):
            for a in range(3):
                z = r_mkc.astype(complex)
                z[:, n, a] += 1j * _STEP
                out[:, n, a] = self.place(z).imag / _STEP
        out[:, 0] = np.eye(3) - out[:, 1:].sum(axis=1)
        return out


@dataclass
class SystemSites:
    """All of a System; a rule of `virtual_sites.VirtualSites`."""

    groups: list

    @property
    def count(self) -> int:
        return sum(len(g.site_m) for g in self.groups)

    def describe(self) -> str:
        return f"{self.count} of the System"

    def _relative(self, frame, g):
        """(m, k, 3) places of a group's atoms relative to the first, by the closest images."""
        m, k = g.atoms_mk.shape
        r = np.empty((m * k, 3))
        first = np.repeat(g.atoms_mk[:, 0], k).astype(np.int32)
        Images(frame.cell).vectors_to(frame.positions, g.atoms_mk.ravel().astype(np.int32), first, r)
        return r.reshape(m, k, 3)

    def placed(self, frame):
        """The frame with its sites where they belong, moving with their atoms; forces on them, which OpenMM leaves
        there beside what it hands on, are taken off."""
        F = None if frame.forces is None else frame.forces.copy()
        x, v = frame.positions.copy(), None if frame.velocities is None else frame.velocities.copy()
        for g in self.groups:
            r = self._relative(frame, g)
            x[g.site_m] = x[g.atoms_mk[:, 0]] + g.place(r)
            if F is not None:
                F[g.site_m] = 0.0
            if v is not None:
                v[g.site_m] = np.einsum("mkab,mka->mb", g.slopes(r), v[g.atoms_mk])
        return frame.replace(positions=x, velocities=v, forces=F)

    def places(self, frame) -> Places:
        """The sites among the atoms of a frame, and how they follow their parents."""
        most = max(g.atoms_mk.shape[1] for g in self.groups)
        parts = []
        for g in self.groups:
            m, k = g.atoms_mk.shape
            # Atoms without a share make up the number.
            atoms = np.concatenate([g.atoms_mk, np.repeat(g.atoms_mk[:, :1], most - k, axis=1)], axis=1)
            weights, slopes = np.zeros((m, most)), np.zeros((m, most, 3, 3))
            weights[:, :k] = g.weights()
            slopes[:, :k] = g.slopes(self._relative(frame, g)).swapaxes(2, 3)
            parts.append((g.site_m, atoms, weights, slopes))
        site, atoms, weights, slopes = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Places(atoms, weights, atoms[:, 0], inside_s=site, jacobians_skcc=slopes)


def sites_of(system, name: str):
    """`SystemSites` of a System, None without. Raises AtcError for kinds that are not mapped, and sites of sites."""
    found: dict[tuple, list] = {}
    sites = [n for n in range(system.getNumParticles()) if system.isVirtualSite(n)]
    for n in sites:
        site = system.getVirtualSite(n)
        kind = type(site).__name__
        atoms = [site.getParticle(k) for k in range(site.getNumParticles())]
        if any(system.isVirtualSite(a) for a in atoms):
            raise AtcError(f"{name}: virtual site {n} belongs to another virtual site: not supported")
        if kind in ("TwoParticleAverageSite", "ThreeParticleAverageSite"):
            row = "average", [site.getWeight(k) for k in range(len(atoms))]
        elif kind == "OutOfPlaneSite":
            cross = site.getWeightCross() / OPENMM.length
            row = "plane", [site.getWeight12(), site.getWeight13(), cross]
        elif kind == "LocalCoordinatesSite":
            weights = [*site.getOriginWeights(), *site.getXWeights(), *site.getYWeights()]
            row = "local", [*weights, *(_number(c) * OPENMM.length for c in site.getLocalPosition())]
        else:
            raise AtcError(
                f"{name}: virtual site {n} is a {kind}, which is not supported: expected TwoParticleAverageSite, "
                "ThreeParticleAverageSite, OutOfPlaneSite, LocalCoordinatesSite"
            )
        found.setdefault((row[0], len(atoms)), []).append((n, atoms, row[1]))
    groups = [
        _Group(kind, *(np.array(column) for column in zip(*rows, strict=True))) for (kind, _), rows in found.items()
    ]
    return SystemSites(groups) if groups else None
