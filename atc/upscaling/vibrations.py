"""Phonon frequencies of a crystal from a trajectory: by the ratio of velocities to displacements, and by spectra of
currents.

A mode of wave vector k has u_k = Σ √m u exp(−ik·R) over the ideal sites R. Harmonic motion obeys ⟨|v_k|²⟩ = ω² ⟨|u_k|²⟩
whatever its amplitude, so no spectrum and no equipartition is needed; where eigenvectors are not known, ω² are the
eigenvalues of ⟨v v†⟩ against ⟨u u†⟩. Time averages are tapered by a Hann window in each block, which removes the error
of cutting a period; blocks give the error bars (jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from ..errors import AtcError
from ..readers.times import Clock
from .crystal import Crystal
from .force_constants import frequency_unit, signed_root
from .lineshapes import Line, fit_line, spectral_energy_density
from .sites import Sites, commensurate, different, find_sites, halved, of_one_run, shortest_contact, star
from .zone import Segment, commensurate_on

#: Fewer frames than this in a block make no spectrum; fewer cycles than this no frequency.
MIN_FRAMES, MIN_CYCLES = 16, 3.0
#: A misfit of a line that is said: of hundreds of independent frequencies it is 1 to a tenth or so.
OTHER_SHAPE = 1.5


@dataclass
class Amplitudes:
    """Mass-weighted amplitudes of the waves of a run.

    k_kc : (k, 3) wave vectors. u_tkx, v_tkx : (frames, k, 3n) complex; displacements from the ideal sites and
        velocities. dt : internal, or None.
    """

    sites: Sites
    k_kc: np.ndarray
    u_tkx: np.ndarray
    v_tkx: np.ndarray
    dt: float | None
    temperature: float
    source: str
    notes: list = field(default_factory=list)


def amplitudes(traj, crystal: Crystal, wave_vectors, *, timestep: float | None = None) -> Amplitudes:
    """Project a trajectory on waves, frame by frame.

    Parameters
    ----------
    traj : frames with velocities and masses; the box may breathe (displacements are then taken relative to it)
    crystal : Crystal
    wave_vectors : function Sites → (k, 3) wave vectors
    timestep : time of one step in the user's unit, for dumps that give steps only

    Raises
    ------
    AtcError for missing velocities or masses, atoms that leave their sites, a box that does not fit, steps or times
    that repeat or go back.
    """
    first, frames = of_one_run(traj)
    first.require("velocities", "masses", why="the dispersion from a trajectory")
    sites = find_sites(first, crystal)
    crystal = sites.crystal
    if np.abs(first.masses - crystal.masses[sites.basis]).max() > 1e-6 * crystal.masses.max():
        raise AtcError(
            f"{first.source}: the masses of the atoms differ from those of {crystal.name}: give the same in both"
        )
    k = np.asarray(wave_vectors(sites), float).reshape(-1, 3)
    n = len(crystal)
    order = np.argsort(sites.basis, kind="stable")
    phase = np.exp(-1j * (k @ sites.sites[order].T)).reshape(len(k), n, -1) / np.sqrt(sites.cells)
    root = np.sqrt(first.masses)[:, None]
    nearest = shortest_contact(sites)
    u_all, v_all, kinetic, cells = [], [], [], []
    clock = Clock("a dispersion from a run", gaps=False)
    inv0 = np.linalg.inv(sites.cell)
    drift = np.zeros(3)

    def project(a):
        a = (root * a)[order].reshape(n, -1, 3)
        return np.einsum("kbm,bmc->kbc", phase, a, optimize=True).reshape(len(k), 3 * n)

    for frame in frames:
        frame.require("velocities", why="the dispersion from a trajectory")
        if not clock.follows(frame):
            continue
        x = (frame.positions - frame.cell.origin) @ frame.cell.inverse @ sites.cell
        # The crystal may drift as a whole, through the box if it likes: it is looked for where it was the frame before.
        u = x - sites.sites - drift
        s = u @ inv0
        u = (s - np.rint(s)) @ sites.cell
        moved = u.mean(axis=0)
        u -= moved
        drift = drift + moved
        far = np.sqrt((u**2).sum(axis=1))
        if far.max() > 0.5 * nearest:
            bad, u = int(np.argmax(far)), frame.units
            away = f"{u.to_user('length', far[bad]):.3g} {u.label('length')}"
            why = "the crystal has melted or atoms have changed places; take earlier frames"
            raise AtcError(f"{frame.source}: atom {frame.ids[bad]} is {away} from its site: {why}")
        v = frame.velocities - np.average(frame.velocities, axis=0, weights=frame.masses)
        u_all.append(project(u))
        v_all.append(project(v))
        kinetic.append((frame.masses[:, None] * v**2).sum() / (3 * (len(frame) - 1) * frame.units.boltzmann))
        cells.append(frame.cell.vectors)
    notes = list(clock.notes)
    swing = np.abs(np.array(cells) - sites.cell).max() / np.abs(sites.cell).max()
    if swing > 1e-6:
        notes.append(
            f"the box changes by up to {100 * swing:.2g} % during the run: wave vectors are those of the first frame"
        )
    dt, why = _interval(clock, timestep, first.units)
    if dt is None:
        notes.append(f"no spectra: {why}")
    return Amplitudes(sites, k, np.array(u_all), np.array(v_all), dt, float(np.mean(kinetic)), first.source, notes)


def _interval(clock: Clock, timestep, units):
    """(time between frames, "") or (None, why not)."""
    if clock.count < 2:
        return None, "there is one frame only"
    dt = clock.spacing(None if timestep is None else units.to_internal("time", timestep))
    if dt is None:
        return None, "the frames have no times; say the time of a step with timestep in [dispersion]"
    if clock.gap:
        return None, f"the frames are not equally spaced in time: {clock.gap}"
    return float(dt), ""


# --------------------------------------------------------------------------------------------------------------------
# Frequencies.


@dataclass
class Estimate:
    """Frequencies (internal ω) with standard errors, ascending, at one wave vector; NaN where none could be had. `why`
    says why not."""

    omega: np.ndarray
    error: np.ndarray
    why: str = ""


def _windows(frames: int, blocks: int):
    """Slices of equal blocks, and the Hann weights of one."""
    length = frames // blocks
    weights = np.hanning(length + 2)[1:-1] if length else np.zeros(0)
    return [slice(b * length, (b + 1) * length) for b in range(blocks)], weights


def by_ratio(u_stx, v_stx, vectors_sxm=None, blocks: int = 5, groups=None) -> Estimate:
    """ω of each mode from √(⟨|v|²⟩/⟨|u|²⟩), over equivalent wave vectors s.

    Parameters
    ----------
    u_stx, v_stx : (s, t, 3n) complex amplitudes
    vectors_sxm : (s, 3n, 3n) eigenvectors (columns) to project on, e.g. of the harmonic crystal; None: the generalised
        eigenproblem
        ⟨v v†⟩ e = ω² ⟨u u†⟩ e
    blocks : pieces of the run; their jackknife gives the error
    groups : (3n,) ints: modes of one number are degenerate and looked at together, each with the weight of its energy;
        with `vectors_sxm` only
    """
    modes, frames = u_stx.shape[2], u_stx.shape[1]
    parts, w = _windows(frames, blocks)
    need = max(4, 0 if vectors_sxm is not None else modes)
    if blocks < 2 or len(w) < need:
        empty = np.full(modes, np.nan)
        return Estimate(empty, empty, f"{frames} frames in {blocks} blocks are too few: {need} a block at least")
    u = u_stx - u_stx.mean(axis=1, keepdims=True)
    if vectors_sxm is not None:
        um, vm = (np.einsum("sxm,stx->stm", vectors_sxm.conj(), a, optimize=True) for a in (u, v_stx))
        U = _pooled(np.array([np.einsum("t,stm->m", w, np.abs(um[:, p]) ** 2) for p in parts]), groups)
        V = _pooled(np.array([np.einsum("t,stm->m", w, np.abs(vm[:, p]) ** 2) for p in parts]), groups)
        return Estimate(*jackknife(lambda which: np.sqrt(V[which].sum(axis=0) / U[which].sum(axis=0)), blocks))
    from scipy.linalg import eigh

    U, V = (
        np.array([np.einsum("t,stx,sty->sxy", w, a[:, p], a[:, p].conj(), optimize=True) for p in parts])
        for a in (u, v_stx)
    )

    def solve(which):
        return np.mean(
            [signed_root(eigh(b, a, eigvals_only=True)) for a, b in zip(U[which].sum(axis=0), V[which].sum(axis=0))],
            axis=0,
        )

    return Estimate(*jackknife(solve, blocks))


def _pooled(x, groups):
    """Sums over the groups of the last axis, given back to each member."""
    if groups is None:
        return x
    same = np.asarray(groups)[:, None] == np.asarray(groups)[None, :]
    return x @ same.astype(float)


def degenerate(values) -> np.ndarray:
    """Group numbers of ascending values that are equal to 1e-6 of the largest."""
    return np.concatenate([[0], np.cumsum(np.diff(values) > 1e-6 * np.abs(values).max())])


def jackknife(statistic, blocks: int):
    """Value and standard error of ``statistic(indices of blocks)``, leaving out one block at a time."""
    everything = np.arange(blocks)
    value = statistic(everything)
    without = np.array([statistic(np.delete(everything, b)) for b in range(blocks)])
    return value, np.sqrt((blocks - 1) / blocks * ((without - without.mean(axis=0)) ** 2).sum(axis=0))


def spectra(v_stm, dt: float, blocks: int = 5, pad: int = 4):
    """Power spectra of complex series, blocks tapered by a Hann window, +ω and −ω added.

    Parameters
    ----------
    v_stm : (s, t, m). Returns ω (f,) and power (blocks, f, m), summed over s.
    """
    parts, w = _windows(v_stm.shape[1], blocks)
    n = pad * len(w)
    out = []
    for p in parts:
        f = np.abs(np.fft.fft(v_stm[:, p] * w[None, :, None], n=n, axis=1)) ** 2
        half = n // 2 + 1
        folded = f[:, :half].copy()
        folded[:, 1:half] += f[:, ::-1][:, : half - 1]
        out.append(folded.sum(axis=0))
    return 2 * np.pi * np.arange(n // 2 + 1) / (n * dt), np.array(out)


def by_spectrum(v_stm, dt: float, blocks: int = 5, groups=None) -> Estimate:
    """ω of the highest peak of each mode's spectrum, by a parabola through the logarithm of the peak's three highest
    points (for a Hann window good to a hundredth of the block's resolution)."""
    modes, frames = v_stm.shape[2], v_stm.shape[1]
    empty = np.full(modes, np.nan)
    length = frames // blocks
    if blocks < 2 or length < MIN_FRAMES:
        why = f"{frames} frames in {blocks} blocks are too few for a spectrum: {MIN_FRAMES} a block at least"
        return Estimate(empty, empty, why)
    omega, power = spectra(v_stm, dt, blocks)
    power = _pooled(power, groups)

    def peaks(which):
        P = power[which].sum(axis=0)
        at = np.clip(np.argmax(P[1:-1], axis=0) + 1, 1, len(P) - 2)
        m = np.arange(modes)
        a, b, c = (np.log(np.maximum(P[at + d, m], 1e-300)) for d in (-1, 0, 1))
        curve = a - 2 * b + c
        return (at + np.where(curve < 0, 0.5 * (a - c) / np.where(curve < 0, curve, 1.0), 0.0)) * omega[1]

    value, error = jackknife(peaks, blocks)
    slow = value * length * dt < 2 * np.pi * MIN_CYCLES
    why = f"a block holds fewer than {MIN_CYCLES:g} periods of the slowest modes" if slow.any() else ""
    return Estimate(np.where(slow, np.nan, value), np.where(slow, np.nan, error), why)


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
