"""One frame in, arrays out: one pass over the bonds and one over the atoms give every quantity asked."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from ..errors import AtcError
from ..units import require_compatible
from .accuracy import Check, kernel_internal
from .registry import BOND, SITE, Work
from .sources import AtomFactors, AtomVirial, ReferenceBonds, drift_velocity, piola_factor
from .sums import Sums, outer6, quotient, thermal


@dataclass
class Settings:
    """What a worker needs to know to turn a frame into fields; picklable."""

    names: tuple[str, ...]
    pot: object = None
    kern: object = None
    grid: object = None
    method: str = "direct"
    tolerance: float = 1e-5
    reference: object = None
    threads: int = 1
    check_points: int = 100


@dataclass
class FrameResult:
    """The fields of one frame, in the user's units; masked quantities hold 0 where `mask` is False."""

    arrays: dict[str, np.ndarray]
    mask: np.ndarray | None = None
    weights: dict[str, np.ndarray] = field(default_factory=dict)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    bound: object = None
    seconds: dict[str, float] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)


class Target:
    """Points at which sums are wanted, with one method to get them; `origin` is subtracted from all positions first."""

    def __init__(self, method, bound, kern, cell, threads, origin=None):
        self.method, self.bound, self.kern, self.cell, self.threads = method, bound, kern, cell, threads
        self.origin = None if origin is None or not np.any(origin) else origin
        self._moved: tuple = (None, None)

    def place(self, x_nc) -> np.ndarray:
        """Positions relative to `origin`; the last ones are remembered."""
        if self.origin is None:
            return x_nc
        if self._moved[0] is not x_nc:
            self._moved = (x_nc, x_nc - self.origin)
        return self._moved[1]

    def open(self, n_site=0, n_bond=0):
        """An empty deposit for this many components."""
        from ..deposit import make

        deposit = make(self.method, self.bound, self.kern, self.cell, n_site, n_bond, threads=self.threads)
        return deposit if self.origin is None else _Placed(deposit, self)

    def sites(self, x_nc, a_nk) -> np.ndarray:
        """(g, k) Σ a φ over all atoms."""
        x_nc = self.place(x_nc)
        from ..deposit import make

        deposit = make(self.method, self.bound, self.kern, self.cell, a_nk.shape[1], 0, threads=self.threads)
        if self.threads == 1 or len(x_nc) < 2 * self.threads:
            deposit.add_sites(x_nc, a_nk, thread=0)
        else:
            from concurrent.futures import ThreadPoolExecutor

            cuts = np.linspace(0, len(x_nc), self.threads + 1).astype(int)
            with ThreadPoolExecutor(self.threads) as pool:
                jobs = [pool.submit(deposit.add_sites, x_nc[a:b], a_nk[a:b], thread=t) for t, (a, b) in enumerate(itertools.pairwise(cuts))]
                for job in jobs:
                    job.result()
        return deposit.site_sums()


class _Placed:
    """A deposit that gets its positions relative to another origin."""

    def __init__(self, deposit, target):
        self.deposit, self.target = deposit, target
        self.bond_sums = deposit.bond_sums

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0):
        self.deposit.add_bond_stress(self.target.place(x_nc), i_b, r_bc, G_b, thread=thread)

    def add_bonds(self, x_bc, r_bc, b_bk, thread=0):
        self.deposit.add_bonds(x_bc - self.target.origin, r_bc, b_bk, thread=thread)


class Stage:
    """One configuration of the atoms (current or reference) with the grid in it: the main sums and those of the error check."""

    def __init__(self, frame, kern, settings, index):
        self.bound = settings.grid.bind(frame.units, frame.cell, frame.positions)
        self.check = Check(self.bound, kern, frame.cell, settings.threads, index, settings.check_points)
        self.targets = [Target(settings.method, self.bound, kern, frame.cell, settings.threads), self.check.target]
        self.check.target.place(frame.positions)  # before threads ask for it


def frame_fields(frame, settings: Settings, index: int = 0) -> FrameResult:
    """All quantities of `settings` on one frame.

    Parameters
    ----------
    frame : Frame
    settings : Settings
    index : int
        Number of the frame: the random points of the error check depend on nothing else.

    Returns
    -------
    FrameResult, in the frame's own units.

    Raises
    ------
    AtcError
        if the frame lacks what a quantity needs (masses, velocities), or there is no potential, kernel, grid or reference for it.
    """
    work = Work.of(settings.names)
    require(frame, settings, work)
    start = perf_counter()
    kern = kernel_internal(settings.kern, frame.units) if work.grid_users else None
    on_reference = {q.name for q in work.quantities if any(BOND[b].reference for b in q.bond)}
    stage = Stage(frame, kern, settings, index) if set(work.grid_users) - on_reference else None
    reference = Stage(settings.reference, kern, settings, index) if on_reference else None

    drift = drift_velocity(frame) if "velocities" in work.attributes else np.zeros(3)
    # The sums on the grid, and those at the points of the check.
    sums = [Sums(drift=drift, volume=frame.cell.volume, boltzmann=frame.units.boltzmann) for _ in range(2)]
    decomposition, virial_n6 = _bond_pass(frame, settings, work, stage, reference, sums) if work.bond_users else (None, None)
    bonds_done = perf_counter()
    factors = AtomFactors(frame, drift, decomposition.energies_n if work.energy_users else None, virial_n6)
    if work.site:
        _site_pass(frame, work, stage, factors, sums)
    for name in work.whole:
        sums[0].whole[name] = _whole(name, factors, decomposition, virial_n6)
    sites_done = perf_counter()

    main, at_points = sums
    arrays, errors, weights = {}, {}, {}
    for q in work.quantities:
        values = q.form(main)
        arrays[q.name] = frame.units.to_user(q.dimension, values)
        if q.kind == "grid":
            here = reference if q.name in on_reference else stage
            errors[q.name] = here.check.errors(values, q.form(at_points))
            arrays[q.name] = arrays[q.name].reshape(*here.bound.shape, *values.shape[1:])
            if q.weight is not None:
                weights[q.name] = main.site[q.weight][:, 0].reshape(here.bound.shape)
    here = stage or reference
    return FrameResult(
        arrays,
        mask=main.defined.reshape(stage.bound.shape) if work.masked else None,
        weights=weights,
        errors=errors,
        bound=here.bound if here else None,
        seconds={"bonds": bonds_done - start, "sites": sites_done - bonds_done, "total": perf_counter() - start},
        notes=dict(getattr(decomposition, "notes", None) or {}),
    )


def _bond_pass(frame, settings, work, stage, reference, sums):
    """One pass over the bonds for every sum over them; returns the potential's word on the frame and the per-atom virial."""
    x_nc, threads = frame.positions, settings.threads
    deposits = [t.open(n_bond=work.n_bond) for t in stage.targets] if work.bond else []
    reference_deposits = [t.open(n_bond=work.n_reference_bond) for t in reference.targets] if reference else []
    to_reference = ReferenceBonds(frame, settings.reference) if reference else None
    virial = AtomVirial(len(frame), threads) if work.atom_virial else None

    def consume(bonds, thread):
        for deposit in deposits:
            deposit.add_bond_stress(x_nc, bonds.i, bonds.r_bc, bonds.G_b, thread=thread)
        if to_reference is not None:
            X_bc, R_bc = to_reference.bonds(bonds)
            P_b9 = piola_factor(bonds, R_bc)
            for deposit in reference_deposits:
                deposit.add_bonds(X_bc, R_bc, P_b9, thread=thread)
        if virial is not None:
            virial.add(bonds, thread)

    wanted = deposits or to_reference is not None or virial is not None
    decomposition = settings.pot.stream(frame, consume if wanted else None, threads=threads, energies=bool(work.energy_users), forces=False)
    for k, s in enumerate(sums):
        if deposits:
            s.bond["stress"] = deposits[k].bond_sums()
        if reference_deposits:
            s.bond["piola"] = reference_deposits[k].bond_sums()
    return decomposition, virial.total() if virial is not None else None


def _site_pass(frame, work, stage, factors, sums):
    """One pass over the atoms for every sum over them."""
    a_nk = factors.columns(work.site)
    for target, s in zip(stage.targets, sums):
        total = target.sites(frame.positions, a_nk)
        at = 0
        for name in work.site:
            s.site[name] = total[:, at : at + SITE[name].width]
            at += SITE[name].width
        if "kinetic" in work.site and "momentum" in work.site:
            s.thermal_shifted = local_shifts(s, target, frame.positions, factors)


def require(frame, settings, work):
    """Say what is missing before anything is computed."""
    for attribute, users in work.attributes.items():
        frame.require(attribute, why=", ".join(users))
    if work.bond_users:
        if settings.pot is None:
            raise AtcError(
                f"no potential was given but {', '.join(work.bond_users)} need one: give the pair_style/pair_coeff lines of the run"
            )
        require_compatible(settings.pot.units, frame.units, "the potential", frame.source)
    if work.grid_users:
        for name in ("kern", "grid"):
            if getattr(settings, name) is None:
                word = {"kern": "kernel", "grid": "grid"}[name]
                raise AtcError(f"no {word} was given but {', '.join(work.grid_users)} need one")
    if work.reference_users and settings.reference is None:
        raise AtcError(f"no reference frame was given but {', '.join(work.reference_users)} need one: pass reference=")
    if any(q.kind == "box" for q in work.quantities) and not frame.cell.volume > 0:
        raise AtcError(f"{frame.source}: the cell has no volume, so the virial stress of the box is not defined")


def _whole(name, factors, decomposition, virial_n6):
    if name == "box_virial":
        return decomposition.virial_cc.reshape(9)
    if name == "atom_virial":
        return virial_n6
    kinetic_n6 = factors["kinetic"]
    return kinetic_n6 if name == "atom_kinetic" else kinetic_n6.sum(0)


# Rounding error a point may have in T − ρ v⊗v, relative to its thermal part: far below the 1e-6 that is promised.
_SHIFT_TOLERANCE = 1e-9
_MAX_SHIFTS = 16


def local_shifts(sums: Sums, target: Target, x_nc, factors) -> np.ndarray | None:
    """T − ρ v⊗v where different regions move at very different speeds, without cancellation.

    The expression does not change when one velocity is subtracted from all atoms; its rounding error is about ε ρ |v(x) − c|² for
    the subtracted c. The frame's mean is enough for a uniform drift. Where it is not, more passes over the atoms take further c,
    each the velocity of the point that is worst off, and every point keeps the one nearest to its own velocity.

    Returns (g, 6), or None if the frame's mean was enough everywhere.
    """
    best = sums.thermal_of_drift
    rho = sums.rho
    v_gc = sums.peculiar
    have = np.linalg.norm(v_gc, axis=1)
    eps = 64 * np.finfo(float).eps
    done = None
    for _ in range(_MAX_SHIFTS):
        heat = quotient(best[:, :3].sum(1), rho)
        # A point with one atom has no thermal part at all: measure it against what is typical of the points that certainly have one.
        certain = heat[heat > eps * have**2]
        scale = np.maximum(heat, np.median(certain) if len(certain) else 0.0)
        error = np.where(sums.defined, eps * have**2 - _SHIFT_TOLERANCE * scale, 0.0)
        worst = int(np.argmax(error)) if len(error) else 0
        if not len(error) or not error[worst] > 0:
            break
        c = v_gc[worst].copy()
        w_nc = factors.peculiar_nc - c
        m = factors["mass"]
        total = target.sites(x_nc, np.ascontiguousarray(np.concatenate([m, m * w_nc, m * outer6(w_nc)], axis=1)))
        u_gc = quotient(total[:, 1:4], total[:, 0])
        distance = np.linalg.norm(u_gc, axis=1)
        nearer = sums.defined & (distance < have)
        if not nearer.any():
            break
        if done is None:
            done = best = best.copy()
        best[nearer] = thermal(total[:, :1], total[:, 1:4], total[:, 4:])[nearer]
        have = np.where(nearer, distance, have)
    return done
