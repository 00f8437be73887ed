"""The springs of a crystal from how it trembles: D(k) = kT ⟨u_k u_k*⟩⁻¹ of an equilibrium run (the first way of the
report), with error bars from blocks.

u_k are mass-weighted displacements of the cells' centres of mass from their mean places, so that what a basis does
within its cell is at rest, as in long waves. The covariance is averaged over the crystal's point group before it is
inverted. Springs are fitted to all commensurate D(k), on the shells that the supercell has whole. At a temperature
they are effective ones: D(k) holds anharmonic softening as it is.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ..errors import AtcError, AtcWarning
from ..pd.voigt import BASIS, of_springs
from .amplitudes import amplitudes
from .crystal import Crystal
from .elasticity import ElasticConstants
from .estimates import jackknife
from .force_constants import ForceConstants, nearest_images

#: A run must have so many frames for each of the three components of a wave.
_LEAST = 10
#: By how much (rms) the waves may differ in mean kinetic energy before the run counts as no equilibrium.
_EQUAL = 0.25


@dataclass
class Fluctuations:
    """What `fluctuations` found, internal units.

    crystal : of one atom a cell, that has the mass of the cell. fc : its ForceConstants; these, and the constants, only
        of crystals of one atom a cell
    k_kc, D_kcc, error_k : commensurate wave vectors, D there, and its relative standard error (of ω², largest branch)
    elastic : ElasticConstants of long waves. C_error_vv : their standard errors
    temperature : kinetic, of the run. frames, blocks : how many
    """

    crystal: Crystal
    fc: ForceConstants | None
    k_kc: np.ndarray
    D_kcc: np.ndarray
    error_k: np.ndarray
    elastic: ElasticConstants | None
    C_error_vv: np.ndarray | None
    temperature: float
    frames: int
    blocks: int
    source: str


def fluctuations(traj, crystal: Crystal, blocks: int = 5) -> Fluctuations:
    """Springs and elastic constants of a perfect crystal from a run in equilibrium.

    Parameters
    ----------
    traj : frames with velocities and masses of a whole number of cells, periodic, in the crystal's orientation
    crystal : Crystal of a cubic structure; its lattice constant need only be near
    blocks : of frames, for the error bars

    Raises
    ------
    AtcError for frames that are no such crystal, or too few of them.
    """
    a = amplitudes(traj, crystal, _inner)
    sites, frames = a.sites, len(a.u_tkx)
    if frames < _LEAST * 3:
        raise AtcError(f"{a.source}: {frames} frames are too few for fluctuations: give at least {_LEAST * 3}")
    share = np.sqrt(sites.crystal.masses / sites.crystal.masses.sum())
    u_tkc = np.tensordot(a.u_tkx.reshape(frames, len(a.k_kc), len(share), 3), share, axes=([2], [0]))
    # About each atom's mean place: what is at rest in a wave does not tremble.
    u_tkc = u_tkc - u_tkc.mean(axis=0)
    parts = np.array_split(np.arange(frames), blocks)
    S_skcc = np.stack([np.einsum("tki,tkj->kij", u_tkc[p], u_tkc[p].conj()).real for p in parts])
    S_skcc = np.stack([symmetrised(S, a.k_kc, sites) for S in S_skcc])
    counts = np.array([len(p) for p in parts])
    kT = sites.crystal.units.boltzmann * a.temperature
    one = Crystal(
        sites.crystal.vectors, np.zeros((1, 3)), sites.crystal.masses.sum(), sites.crystal.units,
        conventional=sites.crystal.conventional, name=sites.crystal.name,
    )  # fmt: skip

    def D_of(which):
        n = counts[which].sum()
        # The mean place is one of the numbers that the frames have been spent on.
        return kT * np.linalg.inv(S_skcc[which].sum(axis=0) / (n - n / frames))

    v_tkc = np.tensordot(a.v_tkx.reshape(frames, len(a.k_kc), len(share), 3), share, axes=([2], [0]))
    kinetic = (np.abs(v_tkc) ** 2).mean(axis=(0, 2)) / kT
    spread = float(np.sqrt(np.mean((kinetic - 1) ** 2)))
    D, D_error = jackknife(D_of, blocks)
    R, weight = _vectors(sites)
    shell = _shells(R)
    allowed = patterns(R, operations(sites.crystal), shell)

    def springs(which, most):
        return _springs(D_of(which), a.k_kc, R, weight, one.masses[0], [x for s, x in allowed if s <= most])

    # Shells that the supercell has whole: what reaches further folds into them.
    images = np.array([m for m in product((-2, -1, 0, 1, 2), repeat=3) if any(m)]) @ sites.cell
    inside = np.linalg.norm(R, axis=1) <= 0.5 * np.linalg.norm(images, axis=1).min() * (1 + 1e-6)
    last = int(shell[inside].max(initial=0))
    last = max(last, 1)  # the nearest alone have no shear constants of their own in every structure
    S = springs(np.arange(blocks), last)
    keep = shell <= last
    C, C_error = jackknife(lambda w: long_waves(R, weight, springs(w, last), one.volume), blocks)
    S = S[keep]
    r, w = R[keep], weight[keep]
    phi = -(w[:, None, None] * S)
    zero = np.zeros(2 * len(r), int)
    fc = ForceConstants(one, zero, zero, np.vstack([r, -r]), np.concatenate([phi, phi]),
                        float(np.linalg.norm(r, axis=1).max()), "fluctuations")  # fmt: skip
    if spread > _EQUAL:
        warnings.warn(
            f"{a.source}: the kinetic energies of the crystal's waves differ by {100 * spread:.0f} % (rms): they have "
            "not shared their energy, and springs from fluctuations err as much: take a longer run, or a thermostat "
            "that touches every atom (fix langevin)",
            AtcWarning,
            stacklevel=2,
        )
    relative = np.linalg.norm(D_error, axis=(1, 2)) / np.linalg.norm(D, axis=(1, 2))
    if len(sites.crystal) > 1:  # stiffness with a basis at rest within reaches far: no springs of a few shells have it
        fc = elastic = C_error = None
    else:
        elastic = ElasticConstants(C, C, np.zeros(6), one)
        misfit = np.linalg.norm(fc.dynamical_matrix(a.k_kc).real - D, axis=(1, 2)) / np.linalg.norm(D, axis=(1, 2))
        misfit, bar = (float(np.sqrt((v**2).mean())) for v in (misfit, relative))
        if not misfit < max(3 * bar, 0.02):
            raise AtcError(
                f"{a.source}: springs on the shells that the box has whole miss what was measured by "
                f"{100 * misfit:.2g} %, its error is {100 * bar:.2g} %: forces reach further: take a larger box"
            )
    return Fluctuations(one, fc, a.k_kc, D, relative, elastic, C_error, a.temperature, frames, blocks, a.source)


def _inner(sites) -> np.ndarray:
    """(k, 3) all commensurate wave vectors of the first zone but 0."""
    reciprocal = 2 * np.pi * np.linalg.inv(sites.cell).T
    most = np.abs(sites.counts).sum(axis=0).max()
    # Every coset of the crystal's reciprocal lattice once: fractions m of the supercell's that differ modulo counts.
    m = np.array(list(product(range(-most, most + 1), repeat=3)))
    own = np.round(np.mod(m @ np.linalg.inv(sites.counts).T + 1e-9, 1.0), 6)
    _, first = np.unique(own, axis=0, return_index=True)
    k = m[first] @ reciprocal
    k = nearest_images(k, 2 * np.pi * np.linalg.inv(sites.crystal.vectors).T)
    return k[np.linalg.norm(k, axis=1) > 1e-9]


def operations(crystal: Crystal) -> np.ndarray:
    """(48, 3, 3) rotations and reflections of the cube of a crystal, along its own axes."""
    cube = crystal.conventional / np.linalg.norm(crystal.conventional, axis=1)[:, None]
    out = []
    for p in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            P = np.zeros((3, 3))
            P[np.arange(3), p] = signs
            out.append((np.linalg.inv(cube) @ P @ cube).T)
    out = np.array(out)
    if np.abs(out @ out.transpose(0, 2, 1) - np.eye(3)).max() > 1e-3:
        raise AtcError(f"{crystal.name}: fluctuations are averaged over the group of a cube, which this crystal lacks")
    return out


def symmetrised(S_kcc, k_kc, sites) -> np.ndarray:
    """(k, 3, 3) mean of g⁻¹ S(g k) g over those operations of the cube that the supercell has."""
    from scipy.spatial import cKDTree

    reciprocal = 2 * np.pi * np.linalg.inv(sites.crystal.vectors).T
    short = np.linalg.norm(k_kc, axis=1).min()
    fold = lambda k: np.round(np.mod(k @ np.linalg.inv(reciprocal) + 1e-6, 1.0), 9)  # noqa: E731
    tree = cKDTree(fold(k_kc), boxsize=1.0 + 1e-12)
    near = 0.1 * short / np.linalg.norm(reciprocal, axis=1).max()
    total, count = np.zeros_like(S_kcc), np.zeros(len(k_kc))
    for g in operations(sites.crystal):
        d, at = tree.query(fold(k_kc @ g.T) % (1.0 + 1e-12))
        there = d < near
        total[there] += g.T @ S_kcc[at[there]] @ g
        count += there
    return total / count[:, None, None]


def _vectors(sites):
    """(p, 3) lattice vectors within the supercell, one of each pair ±R, and the weight of each: 1 over how many images
    are equally near."""
    most = np.abs(sites.counts).sum(axis=0).max()
    m = np.array(list(product(range(-most, most + 1), repeat=3)))
    R = m @ sites.crystal.vectors
    d = np.linalg.norm(R, axis=1)
    near = np.linalg.norm(nearest_images(R, sites.cell), axis=1)
    inside = (d > 1e-6) & (d < near * (1 + 1e-6))
    R, m = R[inside], m[inside]
    own = np.round(np.mod(m @ np.linalg.inv(sites.counts) + 1e-9, 1.0), 6)
    _, back, count = np.unique(own, axis=0, return_inverse=True, return_counts=True)
    half = [tuple(v) > (0, 0, 0) for v in m]
    return R[half], (1.0 / count[back.ravel()])[half]


def _shells(R) -> np.ndarray:
    """(p,) number of the shell, by distance."""
    d = np.linalg.norm(R, axis=1)
    order = np.argsort(d, kind="stable")
    out = np.empty(len(d), int)
    out[order] = np.concatenate([[0], np.cumsum(np.diff(d[order]) > 1e-4 * d.max())])
    return out


def patterns(R, group, shell) -> list[tuple[int, np.ndarray]]:
    """[(shell, (p, 3, 3))]: what springs on all vectors the group allows, one independent pattern after the other."""
    from scipy.spatial import cKDTree

    both = np.vstack([R, -R])
    tree, out, left = cKDTree(both), [], np.ones(len(R), bool)
    tiny = 1e-3 * np.linalg.norm(R, axis=1).min()
    while left.any():
        first = int(np.flatnonzero(left)[0])
        d, at = tree.query(R[first] @ group.transpose(0, 2, 1))
        if d.max() > tiny:  # the supercell lacks some of the group: each vector by itself
            orbit, moved = np.array([first]), [np.eye(3)[None]]
        else:
            at %= len(R)
            orbit = np.unique(at)
            moved = [group[at == o] for o in orbit]
        found = []
        for b in BASIS:
            x = np.zeros((len(R), 3, 3))
            for o, g in zip(orbit, moved):
                x[o] = (g @ b @ g.transpose(0, 2, 1)).mean(axis=0)
            found.append(x)
        rows = np.array(found).reshape(6, -1)
        U, size, _ = np.linalg.svd(rows @ rows.T)
        for k in np.flatnonzero(size > 1e-9 * size.max()):
            out.append((int(shell[first]), np.tensordot(U[:, k], np.array(found), axes=1)))
        left[orbit] = False
    return out


def _springs(D_kcc, k_kc, R, weight, mass, allowed) -> np.ndarray:
    """(p, 3, 3) springs S with m D(k) = Σ 2 w (1 − cos k·R) S of the allowed patterns, least squares of the relative
    error of D."""
    inverse = np.linalg.inv(np.linalg.cholesky(D_kcc))
    phase = 2 * weight * (1 - np.cos(k_kc @ R.T)) / mass
    A = []
    for x in allowed:
        used = np.flatnonzero(np.abs(x).max(axis=(1, 2)) > 0)
        made = np.tensordot(phase[:, used], x[used], axes=1)
        A.append((inverse @ made @ inverse.swapaxes(1, 2)).ravel())
    b = np.broadcast_to(np.eye(3), (len(k_kc), 3, 3)).ravel()
    c = np.linalg.lstsq(np.array(A).T, b, rcond=1e-10)[0]
    return np.tensordot(c, np.array(allowed), axes=1)


def long_waves(R, weight, S, volume) -> np.ndarray:
    """(6, 6) constants whose acoustic tensor is that of the springs (Born and Huang)."""
    return of_springs(weight[:, None, None] * S, R) / volume
