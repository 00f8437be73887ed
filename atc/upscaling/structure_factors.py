"""Structure factors S(q), S(q, ω), longitudinal and transverse currents of a run, in dynasor's definitions and units.

With n(q) = Σ exp(iq·r) and j(q) = Σ v exp(iq·r) over the atoms of a kind, N all atoms:
S_ab(q) = ⟨n_a n_b*⟩/N, F_ab(q, t) = ⟨n_a(t₀) n_b*(t₀ + t)⟩/N, C_L the same of j·q̂, C_T half of that of what is normal
to q; pairs of different kinds hold both orders, so that all partial ones add up to the total. Spectra are
∫ F exp(−iωt) dt over both signs of t (E. Fransson et al., Adv. Theory Simul. 4, 2000240 (2021)).
"""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np

from ..errors import AtcError
from ..readers.times import Clock
from ..units import units
from .sites import of_one_run

_CHUNK = 2_000_000


def wave_vectors(cell, largest: float, most: int = 2000, seed: int = 0) -> np.ndarray:
    """(q, 3) wave vectors that fit into a periodic cell, one of each ±q, by length.

    cell : Cell. largest : |q| of the largest, in 1/length as the cell. most : more than these are thinned out at
    random, evenly over |q|.
    """
    b = 2 * np.pi * np.linalg.inv(cell.vectors).T
    reach = np.ceil(largest * np.linalg.norm(cell.vectors, axis=1) / (2 * np.pi)).astype(int)
    if np.prod(2.0 * reach + 1) > 5e7:
        raise AtcError(f"q up to {largest:g} makes {np.prod(2.0 * reach + 1):.0e} wave vectors of this cell: say less")
    n = np.array([m for m in product(*(range(-k, k + 1) for k in reach)) if m > (0, 0, 0)]).reshape(-1, 3)
    q = n @ b
    size = np.linalg.norm(q, axis=1)
    q, size = q[size <= largest * (1 + 1e-9)], size[size <= largest * (1 + 1e-9)]
    if len(q) > most:
        # As many of each shell: the chance of staying falls as the shell grows.
        rng = np.random.default_rng(seed)
        q = q[rng.choice(len(q), most, replace=False, p=size**-2 / (size**-2).sum())]
        size = np.linalg.norm(q, axis=1)
    return q[np.argsort(size, kind="stable")]


def structure_factors(
    traj, q_qc, *, lags: int | None = None, timestep: float | None = None, currents: bool | None = None, blocks: int = 5
):
    """Static and dynamic structure factors and currents at wave vectors of a run, of a crystal or a liquid.

    Parameters
    ----------
    traj : trajectory of `atc.read`, its cell periodic and constant
    q_qc : (q, 3) wave vectors that fit into the cell, in rad over the user's unit of length (`wave_vectors`)
    lags : time differences, in frames, for F(q, t) and the spectra; default: a quarter of the run; 0: S(q) only
    timestep : time of one step in the user's unit, for dumps that give steps only
    currents : whether C_L and C_T too; default: where there are velocities
    blocks : pieces of the run whose spread gives the standard error of S(q)

    Returns
    -------
    xarray.Dataset over q, time and omega: `Sq` with `Sq_error`, `Fqt`, `Sqw`, `Clqt`, `Ctqt`, `Clqw`, `Ctqw` and those
    of pairs of kinds, `Sq_A_B` and so on where there is more than one kind. Units are dynasor's: rad/Å, fs, rad/fs,
    Å²/fs² (σ and τ in reduced units).

    Raises
    ------
    AtcError for wave vectors that do not fit into the cell, a cell that changes, frames that are not equally spaced in
    time.
    """
    import xarray as xr

    first, frames = of_one_run(traj)
    u = first.units
    if not first.cell.periodic.all():
        raise AtcError(f"{first.source}: structure factors need a box that is periodic along all axes")
    q = np.asarray(q_qc, float).reshape(-1, 3) / float(u.to_internal("length", 1.0))
    turns = q @ first.cell.vectors.T / (2 * np.pi)
    bad = np.flatnonzero(np.abs(turns - np.rint(turns)).max(axis=1, initial=0.0) > 1e-5)
    if len(bad) or not np.isfinite(q).all() or not len(q):
        said = f"q = {np.asarray(q_qc).reshape(-1, 3)[bad[0]].tolist()} does not fit" if len(bad) else "no q fits"
        raise AtcError(
            f"{first.source}: {said} into the box: expected integer combinations of 2π over its edges, e.g. of "
            "atc.upscaling.structure_factors.wave_vectors"
        )
    currents = first.velocities is not None if currents is None else currents
    if currents:
        first.require("velocities", why="currents")
    types = np.unique(first.types) if first.types is not None else np.array([1])
    kinds = [first.type_names.get(int(t), str(t)) for t in types]
    clock = Clock("structure factors of a run", gaps=False)
    n_t, j_t = [], []
    for frame in frames:
        if np.abs(frame.cell.vectors - first.cell.vectors).max() > 1e-6 * np.abs(first.cell.vectors).max():
            why = "structure factors are of runs in a constant box"
            raise AtcError(f"{frame.source}: the box is not that of the first frame: {why}")
        if clock.follows(frame):
            n, j = _transform(frame, q, types, currents)
            n_t.append(n)
            j_t.append(j)
    n_tkq = np.array(n_t)
    atoms, frames = len(first), len(n_tkq)
    dt = None
    lags = (frames - 1) // 4 if lags is None else int(lags)
    if lags:
        if lags >= frames:
            raise AtcError(f"{first.source}: lags = {lags} of {frames} frames: expected fewer than there are frames")
        dt = clock.spacing(None if timestep is None else u.to_internal("time", timestep))
        if dt is None:
            raise AtcError(f"{first.source}: the frames have no times: say the time of a step with timestep=")
        if clock.gap:
            raise AtcError(f"{first.source}: the frames are not equally spaced in time: {clock.gap}; or say lags=0")
    # Femtoseconds of the internal unit of time, √(amu Å²/eV).
    fs = 1.0 if u.reduced else 1e3 * float(units("metal").to_user("time", 1.0))
    dt = None if dt is None else float(dt) * fs
    length, time = ("sigma", "tau") if u.reduced else ("angstrom", "fs")
    pairs = list(combinations_with_replacement(range(len(types)), 2))
    data = {"q_points": (("q", "c"), q, {"units": f"rad/{length}"})}
    coords = {"c": ["x", "y", "z"], "q_length": ("q", np.linalg.norm(q, axis=1), {"units": f"rad/{length}"})}
    if lags:
        coords["time"] = ("time", dt * np.arange(lags + 1), {"units": time})
        omega = 2 * np.pi * np.arange(lags + 1) / ((2 * lags + 1) * dt)
        coords["omega"] = ("omega", omega, {"units": f"rad/{time}", "long_name": "angular frequency"})

    def add(name, what, values, units, dims):
        data[name] = (dims, values, {"units": units, "long_name": what})

    def correlated(kind, what, series, factor, units):
        """F and its spectrum, of pairs and the total; series (t, kind, q, components)."""
        total = 0.0
        for a, b in pairs:
            both = (1.0 if a == b else 2.0) * factor / atoms
            part = both * _correlation(series[:, a], series[:, b], lags)
            total = total + part
            if len(types) > 1:
                put(kind, what, part, units, f"_{kinds[a]}_{kinds[b]}")
        put(kind, what, total, units, "")

    def put(kind, what, f_qt, units, pair):
        add(kind[0] + pair, f"{what} in time", f_qt, units, ("q", "time"))
        mirrored = np.concatenate([f_qt, f_qt[:, :0:-1]], axis=1)
        power = dt * np.fft.rfft(mirrored, axis=1).real
        unit = f"{time}" if units == "1" else units.replace("^2/" + time + "^2", f"^2/{time}")
        add(kind[1] + pair, f"{what}, spectrum", power, unit, ("q", "omega"))

    total = np.einsum("tkq->tq", n_tkq)
    per_frame = np.abs(total) ** 2 / atoms
    add("Sq", "static structure factor", per_frame.mean(axis=0), "1", ("q",))
    if frames >= 2 * blocks and blocks > 1:
        parts = np.array([x.mean(axis=0) for x in np.array_split(per_frame, blocks)])
        add("Sq_error", "standard error of Sq", parts.std(axis=0, ddof=1) / np.sqrt(blocks), "1", ("q",))
    for a, b in pairs if len(types) > 1 else ():
        both = 1.0 if a == b else 2.0
        value = both * (n_tkq[:, a] * n_tkq[:, b].conj()).real.mean(axis=0) / atoms
        add(f"Sq_{kinds[a]}_{kinds[b]}", "partial static structure factor", value, "1", ("q",))
    if lags:
        correlated(("Fqt", "Sqw"), "coherent structure factor", n_tkq[..., None], 1.0, "1")
        if currents:
            j = np.array(j_t) / fs
            size = np.linalg.norm(q, axis=1)
            e = np.divide(q, size[:, None], out=np.zeros_like(q), where=size[:, None] > 0)
            along = np.einsum("tkqc,qc->tkq", j, e)
            across = j - along[..., None] * e
            unit = f"{length}^2/{time}^2"
            correlated(("Clqt", "Clqw"), "longitudinal current", along[..., None], 1.0, unit)
            correlated(("Ctqt", "Ctqw"), "transverse current", across, 0.5, unit)
    attrs = {"frames": frames, "atoms": atoms, "kinds": ", ".join(kinds), "definitions": "those of dynasor"}
    return xr.Dataset(data, coords, attrs)


def _transform(frame, q, types, currents):
    """n (kind, q) and j (kind, q, 3) of a frame."""
    n = np.zeros((len(types), len(q)), complex)
    j = np.zeros((len(types), len(q), 3), complex) if currents else None
    if currents:
        frame.require("velocities", why="currents")
    x = frame.positions - frame.cell.origin
    per = max(1, _CHUNK // len(q))
    for a, t in enumerate(types):
        which = np.arange(len(frame)) if len(types) == 1 else np.flatnonzero(frame.types == t)
        for start in range(0, len(which), per):
            part = which[start : start + per]
            phase = np.exp(1j * (q @ x[part].T))
            n[a] += phase.sum(axis=1)
            if currents:
                j[a] += phase @ frame.velocities[part]
    return n, j


def _correlation(a_tqx, b_tqx, lags: int):
    """(q, lags + 1) Re⟨a(t₀) b*(t₀ + t)⟩ symmetrised in a, b, summed over x; each lag over all times that have it."""
    frames = len(a_tqx)
    size = 1 << int(np.ceil(np.log2(2 * frames)))
    out = np.zeros((a_tqx.shape[1], lags + 1))
    for x in range(a_tqx.shape[2]):
        A, B = (np.fft.fft(s[..., x], n=size, axis=0) for s in (a_tqx, b_tqx))
        c = np.fft.ifft(A * B.conj(), axis=0)
        # c[-t] is Σ a(t₀) b*(t₀ + t), c[t] the same with a and b exchanged (and conjugated).
        forward, backward = c[-np.arange(lags + 1)].real, c[: lags + 1].real
        out += 0.5 * (forward + backward).T
    return out / (frames - np.arange(lags + 1))
