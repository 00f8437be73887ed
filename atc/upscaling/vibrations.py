"""Phonon frequencies of a crystal from a trajectory, along rays: of its waves' `amplitudes`, what `estimates` makes of
them, and lines and current spectra beside."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from ..errors import AtcError
from .amplitudes import amplitudes
from .crystal import Crystal
from .estimates import MIN_FRAMES, Estimate, by_ratio, by_spectrum, degenerate, spectra
from .force_constants import frequency_unit
from .lineshapes import Line, fit_line, spectral_energy_density
from .sites import commensurate, different, halved, star
from .zone import Segment, commensurate_on

#: A misfit of a line that is said: of hundreds of independent frequencies it is 1 to a tenth or so.
OTHER_SHAPE = 1.5


@dataclass
class Measured:
    """Frequencies of one trajectory along rays.

    Attributes (ω in internal units, branches ascending)
    ----------
    directions : the rays. ray_k : (k,) which ray each point is on. fraction_k, k_kc : its place.
    ratio_km, ratio_error_km, spectrum_km, spectrum_error_km : (k, 3n) ω and standard errors; NaN where it could not be
        had
    frequency_f : ω of the current spectra (internal), current_kcf : (k, 2, f) longitudinal and transverse current
        spectra; None without times
    sed_kf : spectral energy density, summed over the modes (`lineshapes.spectral_energy_density`), internal energy ×
        time; None without times
    lines_km : `lineshapes.Line` of each mode where they were asked for, in the order of the eigenvectors; else None
    temperature : mean, internal (the user's temperature unit). notes : what to know
    """

    crystal: Crystal
    directions: list
    ray_k: np.ndarray
    fraction_k: np.ndarray
    k_kc: np.ndarray
    ratio_km: np.ndarray
    ratio_error_km: np.ndarray
    spectrum_km: np.ndarray
    spectrum_error_km: np.ndarray
    frequency_f: np.ndarray | None
    current_kcf: np.ndarray | None
    temperature: float
    frames: int
    blocks: int
    dt: float | None
    source: str
    notes: list = field(default_factory=list)
    sed_kf: np.ndarray | None = None
    lines_km: list | None = None
    shape: str | None = None

    def line(self, name: str) -> np.ndarray:
        """(k, 3n) a number of every fitted line, by its name in `lineshapes.Line`."""
        return np.array([[getattr(x, name) for x in row] for row in self.lines_km])


def measure(
    traj,
    crystal: Crystal,
    directions,
    *,
    fc=None,
    blocks: int = 5,
    timestep: float | None = None,
    cubic: bool | None = None,
    lines: str | None = None,
) -> Measured:
    """ω(k) of a trajectory at every wave vector along `directions` that fits into its box.

    Parameters
    ----------
    traj : trajectory of `atc.read`, of a crystal that vibrates
    crystal : Crystal
    directions : list of (3,) rays, e.g. [1, 0, 0], or of `zone.Segment`
    fc : function Crystal → ForceConstants for the crystal at the run's own lattice constant, whose eigenvectors single
        out the modes; None: the run alone
    blocks : pieces that give the errors
    timestep : time of one step in the user's unit, if the frames have no times
    cubic : average over wave vectors that the cube's symmetry makes equivalent; default: if the crystal's conventional
        cell is a cube along the axes
    lines : "lorentzian" or "oscillator": fit the modes' lines (`lineshapes`)

    Returns
    -------
    Measured

    Raises
    ------
    AtcError if no wave vector fits, and what `amplitudes` refuses.
    """
    if cubic is None:
        edge = np.linalg.norm(crystal.conventional[0])
        cubic = bool(np.abs(crystal.conventional - edge * np.eye(3)).max() < 1e-6 * edge)
    plan = []

    def wave_vectors(sites):
        for r, d in enumerate(directions):
            fractions, ks = commensurate_on(sites, d) if isinstance(d, Segment) else commensurate(sites, d)
            for f, k in zip(fractions, ks):
                # Equivalent ones fit only if the box has the cube's symmetry too.
                members = star(k, cubic)
                turns = members @ sites.cell.T / (2 * np.pi)
                fits = np.abs(turns - np.rint(turns)).max(axis=1) < 1e-6
                plan.append((r, f, k, different(sites.crystal, members[fits])))
        if not plan:
            along = ", ".join(d.label if isinstance(d, Segment) else str(d) for d in directions)
            raise AtcError(
                f"no wave vector along {along} fits into the box of {sites.crystal.name}: take other directions or a "
                "longer box"
            )
        return np.concatenate([p[3] for p in plan])

    a = amplitudes(traj, crystal, wave_vectors, timestep=timestep)
    crystal, notes = a.sites.crystal, list(a.notes)
    for r, d in enumerate(directions):
        if not any(p[0] == r for p in plan):
            along = d.label if isinstance(d, Segment) else str(list(d))
            notes.append(f"no wave vector along {along} fits into the box (not commensurate): no measured points there")
    harmonic = fc(crystal) if fc is not None else None
    n3 = 3 * len(crystal)
    rows, currents, energies, shapes, frequency, at = [], [], [], [], None, 0
    for *_, k, members in plan:
        pick = slice(at, at + len(members))
        at += len(members)
        u, v = (x[:, pick].transpose(1, 0, 2) for x in (a.u_tkx, a.v_tkx))
        vectors = groups = None
        if harmonic is not None:
            omega, vectors = harmonic.frequencies(members, vectors=True)
            groups = degenerate(omega[0])
        elif cubic and len(members) > 1:
            vectors, groups = _vectors_by_symmetry(members, crystal)
        ratio = by_ratio(u, v, vectors, blocks, groups)
        if vectors is None:
            vectors = _own_vectors(u, v)
        spectrum = Estimate(np.full(n3, np.nan), np.full(n3, np.nan))
        if a.dt is not None and vectors is not None:
            spectrum = by_spectrum(np.einsum("sxm,stx->stm", vectors.conj(), v, optimize=True), a.dt, blocks, groups)
        for e in (ratio, spectrum):
            if e.why and e.why not in notes:
                notes.append(e.why)
        rows.append((*_ascending(ratio), *_ascending(spectrum)))
        if a.dt is not None and len(v[0]) // blocks >= MIN_FRAMES:
            frequency, power = spectra(_current(v, members, crystal), a.dt, blocks)
            currents.append(power.sum(axis=0)[:, :3] @ np.array([[1, 0, 0], [0, 1, 1.0]]).T)
            energies.append(spectral_energy_density(v, a.dt, blocks, taper=True, pad=4)[1])
        if lines is not None:
            shapes.append(_lines(v, a.dt, vectors, groups, lines, halved(crystal, k)))
            why = {x.why for x in shapes[-1] if x.why} - set(notes)
            notes += sorted(why)
    worst = max((x.misfit for row in shapes for x in row if np.isfinite(x.misfit)), default=0.0)
    if worst > OTHER_SHAPE:
        notes.append(
            f"some lines have another shape than fitted, with shoulders or satellites (misfit to {worst:.2g}): their "
            "widths are those of the nearest line of the shape, and their errors √misfit times as large"
        )
    data = [np.array(x) for x in zip(*rows)]
    if a.dt is not None and harmonic is not None:
        top = harmonic.frequencies(np.array([p[2] for p in plan])).max()
        if top > np.pi / a.dt:
            unit, factor = frequency_unit(crystal.units)
            notes.append(
                f"the frames are too far apart for spectra: frequencies above {factor * np.pi / a.dt:.3g} {unit} are "
                "folded down, the crystal goes up to "
                f"{factor * top:.3g}; the ratio of velocities and displacements does not mind"
            )
    ray_k, fraction_k, k_kc = (np.array([p[c] for p in plan]) for c in range(3))
    current = np.array(currents).transpose(0, 2, 1) if currents else None
    of_run = a.temperature, len(a.u_tkx), blocks, a.dt, a.source, notes
    of_lines = np.array(energies) if energies else None, shapes or None, lines
    return Measured(crystal, list(directions), ray_k, fraction_k, k_kc, *data, frequency, current, *of_run, *of_lines)


def _lines(v_stx, dt, vectors, groups, shape, real):
    """A `Line` for each mode of one wave vector; degenerate modes are fitted together."""
    modes = v_stx.shape[2]
    if dt is None or vectors is None:
        why = "no spectra" if dt is None else "what the modes are is not known: give a potential"
        return [Line(why=f"no linewidths: {why}")] * modes
    v = np.einsum("sxm,stx->mst", vectors.conj(), v_stx, optimize=True)
    groups = np.arange(modes) if groups is None else np.asarray(groups)
    fitted = {g: fit_line(v[groups == g].reshape(-1, v.shape[2]), dt, shape, real=real) for g in np.unique(groups)}
    return [fitted[g] for g in groups]


def _ascending(e: Estimate):
    order = np.argsort(np.nan_to_num(e.omega, nan=-np.inf))  # those that are too slow to be seen come first
    return e.omega[order], e.error[order]


def _vectors_by_symmetry(members, crystal):
    """Polarisations along [100], [110] and [111] of a cubic crystal with one atom a cell: those of any model of that
    symmetry, and which are degenerate. None elsewhere."""
    k = np.sort(np.abs(members[0])) / np.abs(members[0]).max()
    if len(crystal) > 1 or not any(np.allclose(k, ray, atol=1e-6) for ray in ((0, 0, 1), (0, 1, 1), (1, 1, 1))):
        return None, None
    bonds = np.array([m for m in product((-1, 0, 1), repeat=3) if np.abs(m).sum() == 2], float)
    # Springs along the face diagonals, at long waves: longitudinal above transverse, [001] and [1-10] of [110] apart.
    D = np.einsum("sb,bi,bj->sij", (members @ bonds.T) ** 2, bonds, bonds)
    values, vectors = np.linalg.eigh(D)
    return vectors.astype(complex), degenerate(values[0])


def _own_vectors(u, v):
    """(s, 3n, 3n) modes from the run itself: v†-normalised solutions of the generalised eigenproblem, None if there are
    too few frames."""
    from scipy.linalg import LinAlgError, eigh

    u = u - u.mean(axis=1, keepdims=True)
    out = []
    for a, b in zip(u, v):
        try:
            _, e = eigh(np.einsum("tx,ty->xy", b, b.conj()), np.einsum("tx,ty->xy", a, a.conj()))
        except LinAlgError:
            return None
        # Projectors on a mode are dual to the modes' shapes, which the eigenvectors are already.
        out.append(e / np.linalg.norm(e, axis=0))
    return np.array(out)


def _current(v_stx, members, crystal):
    """(s, t, 3) mass current along k and along two directions normal to it."""
    root = np.sqrt(crystal.masses)
    j = np.einsum("b,stbc->stc", root, v_stx.reshape(*v_stx.shape[:2], len(crystal), 3))
    out = []
    for k, a in zip(members, j):
        e = k / np.linalg.norm(k)
        side = np.cross(e, np.eye(3)[np.argmin(np.abs(e))])
        side /= np.linalg.norm(side)
        out.append(a @ np.array([e, side, np.cross(e, side)]).T)
    return np.array(out)
