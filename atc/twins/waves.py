"""Waves of a twin's material on its nodes, from the forces of the engine itself: what runs is what is drawn."""

from __future__ import annotations

from copy import copy
from types import SimpleNamespace

import numpy as np

from .. import pd
from ..frame import Cell
from ..upscaling.branches import FRACTIONS, cubic_branches
from ..upscaling.force_constants import signed_root
from ..upscaling.matching import match
from ..upscaling.peridynamic_kernels import Periodic
from .choice import horizon_of, twin_material

#: The displacement of a node that forces are measured at, in distances of nodes.
_STEP = 1e-4


class NodeWaves(Periodic):
    """D(k) of a periodic body of nodes from the engine's forces when one of them is displaced (internal units).

    Parameters
    ----------
    material : a material of `atc.pd`. step_cc : (3, 3) rows: the lattice of nodes. horizon, density : of the body
    label : what to call it
    """

    def __init__(self, material, step_cc, horizon, density, label):

        heights = 1 / np.linalg.norm(np.linalg.inv(step_cc), axis=0)
        # State-based forces reach two horizons, and no node must be felt through two images.
        counts = 2 * np.ceil(2.0001 * horizon / heights).astype(int) + 1
        s = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
        volume = abs(np.linalg.det(step_cc))
        body = pd.Body(
            s @ step_cc, volume, density, horizon, cell=Cell(step_cc * counts[:, None]), spacing=volume ** (1 / 3),
            warn=False,
        )  # fmt: skip
        sim = pd.Simulation(body, material, threads=1)
        h = _STEP * np.linalg.norm(step_cc, axis=1).min()
        phi = np.zeros((len(body), 3, 3))
        for c in range(3):
            for sign in (1, -1):
                sim._z[:, :3] = 0.0
                sim._z[0, c] = sign * h
                sim._all_forces(damage=False)
                phi[:, :, c] -= sign * sim.forces() / (2 * h)
        used = np.abs(phi).max(axis=(1, 2)) > 1e-12 * np.abs(phi).max()
        centred = (s + counts // 2) % counts - counts // 2
        self.r_bc, self.phi_bcc = (centred @ step_cc)[used], phi[used] / (density * volume)
        self.step_cc, self.label = step_cc, label

    def dynamical_matrix(self, k_kc) -> np.ndarray:
        """(k, 3, 3)"""
        phase = np.exp(-1j * np.atleast_2d(k_kc) @ self.r_bc.T)
        D = np.tensordot(phase, self.phi_bcc, axes=1)
        return 0.5 * (D + D.conj().transpose(0, 2, 1))

    def radial_gradient(self, k_kc) -> np.ndarray:
        """(k, 3, 3) its derivative along k."""
        k = np.atleast_2d(k_kc)
        along = k @ self.r_bc.T / np.maximum(np.linalg.norm(k, axis=1), 1e-300)[:, None]
        D = np.tensordot(-1j * along * np.exp(-1j * k @ self.r_bc.T), self.phi_bcc, axes=1)
        return 0.5 * (D + D.conj().transpose(0, 2, 1))

    def carried(self, k_kc) -> np.ndarray:
        """(k,) which wave vectors lie in the nodes' own zone: others are those again."""
        G = 2 * np.pi * np.linalg.inv(self.step_cc).T
        n = np.array([m for m in np.ndindex(3, 3, 3) if m != (1, 1, 1)]) - 1
        k = np.atleast_2d(k_kc)
        return (2 * k @ (n @ G).T <= ((n @ G) ** 2).sum(axis=1) * (1 + 1e-9)).all(axis=1)


def add_twin(result, scene) -> NodeWaves:
    """Add the material of the scene's [twin] to a `Dispersion`, on nodes along the crystal's cube edges, as far as its
    nodes carry waves.

    Raises
    ------
    AtcError for scenes without [twin], and for `smoothed`, whose nodes carry atoms.
    """
    if "twin" not in scene.data:
        raise scene.need("twin", 'what to draw beside the lattice, e.g. material = "linear"')
    get = lambda key, default=None: scene.get("twin", key, default)  # noqa: E731
    kind = get("material", "isotropic")
    if kind == "smoothed" or get("nodes") == "atoms":
        raise scene.bad(
            ("dispersion", "twin"), "nodes that carry or are the atoms have the crystal's own waves: leave it out"
        )
    if result.fc is None:
        raise scene.wrong(("dispersion", "twin"), "twin needs a [potential]")
    crystal, u = result.crystal, result.crystal.units
    spacing = u.to_internal("length", get("spacing") or u.to_user("length", np.linalg.norm(crystal.conventional[0])))
    edges = crystal.conventional / np.linalg.norm(crystal.conventional, axis=1)[:, None]
    horizon = u.to_internal("length", get("horizon")) if get("horizon") else horizon_of(get) * spacing
    made = SimpleNamespace(step_cc=spacing * edges, body=SimpleNamespace(horizon=horizon), density=crystal.density)
    law = copy(scene.potential())
    law.setup = None
    breaking = ("fracture", "fracture_energy", "notches")
    whole = lambda key, default=None: None if key in breaking else get(key, default)  # noqa: E731
    material = twin_material(whole, crystal, law, np.eye(3), made, None, scene.equilibrium)
    waves = NodeWaves(
        material.material, made.step_cc, horizon, crystal.density,
        f"twin: {kind}, nodes {u.to_user('length', spacing):.4g} {u.label('length')} apart",
    )  # fmt: skip
    found = match(waves, result.fc)
    kept = [waves.carried(b.k(np.array(FRACTIONS))) for b in cubic_branches(crystal)]
    found.error_bf = np.where(kept, found.error_bf, np.nan)
    found.velocity_error_bf = np.where(kept, found.velocity_error_bf, np.nan)
    found.rms = float(np.sqrt(np.nanmean(found.error_bf**2)))
    found.band = np.nan
    result.matches.append(found)
    for ray in result.rays:
        values = signed_root(np.linalg.eigvalsh(waves.dynamical_matrix(ray.k_kc)))
        ray.models[waves.label] = np.where(waves.carried(ray.k_kc)[:, None], values, np.nan)
    result.notes.append(
        f"{waves.label}: from the engine's own forces, drawn as far as its nodes carry waves; errors stand only there"
    )
    return waves
