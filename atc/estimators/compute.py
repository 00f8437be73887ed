"""One frame in, arrays out: one pass over the bonds and one over the atoms give every quantity asked."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from ..errors import AtcError
from ..units import require_compatible
from .accuracy import Check, kernel_internal
from .kinematics import Displacement
from .peridynamic import horizon_of, node_volumes, weighted_virials
from .registry import BOND, GATHER, SITE, Work
from .sources import AtomFactors, AtomSums, ReferenceBonds, bond_factors, drift_velocity, piola_factor
from .sums import Sums, kinetic_flux, outer6, quotient, thermal


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
    horizon: float | None = None  # the user's unit of length; None: the potential's

    @property
    def central(self) -> bool:
        """Whether the potential's forces act along bonds."""
        return getattr(self.pot, "central", True)

    def reference_energies(self) -> np.ndarray:
        """(n,) potential energies of the atoms in the reference frame, computed once."""
        if not hasattr(self, "_reference_energies"):
            self._reference_energies = self.pot.stream(self.reference, None, threads=self.threads, energies=True, forces=False).energies_n
        return self._reference_energies


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

    @property
    def points_gc(self) -> np.ndarray:
        """(g, 3) where the points are, in the frame's own coordinates."""
        return self.bound.points_gc if self.origin is None else self.bound.points_gc + self.origin

    def gather(self, x_nc, a_nk, w_n, gradient):
        """Σ a φ and Σ a ∂φ/∂x, see `atc.deposit.gradient`."""
        from ..deposit.gradient import gather

        return gather(self.bound, self.kern, self.cell, self.place(x_nc), a_nk, w_n, gradient, self.threads)


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
    work = Work.of(settings.names, settings.central)
    require(frame, settings, work)
    start = perf_counter()
    kern = kernel_internal(settings.kern, frame.units) if work.kernel_users else None
    on_reference = set(work.on_reference)
    stage = Stage(frame, kern, settings, index) if set(work.grid_users) - on_reference else None
    reference = Stage(settings.reference, kern, settings, index) if on_reference else None

    drift = drift_velocity(frame) if "velocities" in work.attributes else np.zeros(3)
    # The sums on the grid, and those at the points of the check.
    sums = [Sums(drift=drift, volume=frame.cell.volume, boltzmann=frame.units.boltzmann) for _ in range(2)]
    factors = AtomFactors(frame, drift)
    decomposition, atoms = _bond_pass(frame, settings, work, stage, reference, factors, sums) if work.bond_users else (None, None)
    bonds_done = perf_counter()
    if work.site:
        _site_pass(frame, work, stage, factors, sums)
    if work.gather:
        _gather_pass(frame, settings, work, stage, factors, sums)
    if work.reference_gather:
        _reference_gather_pass(frame, settings, work, reference, factors, sums)
    for name in work.whole:
        sums[0].whole[name] = _whole(name, factors, decomposition, atoms, frame)
    sites_done = perf_counter()

    main, at_points = sums
    arrays, errors, weights = {}, {}, {}
    for q in work.quantities:
        values = q.form(main)
        arrays[q.name] = frame.units.to_user(q.dimension, values)
        if q.kind == "grid":
            here = reference if q.name in on_reference else stage
            # Points that are never defined are NaN in both.
            errors[q.name] = here.check.errors(np.nan_to_num(values), np.nan_to_num(q.form(at_points)), q.scale(main))
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


def _bond_pass(frame, settings, work, stage, reference, factors, sums):
    """One pass over the bonds for every sum over them; returns the potential's word on the frame and the per-atom sums."""
    x_nc, threads = frame.positions, settings.threads
    deposits = [t.open(n_bond=work.n_bond) for t in stage.targets] if work.bond else []
    reference_deposits = [t.open(n_bond=work.n_reference_bond) for t in reference.targets] if work.reference_bond else []
    carried = bool(work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole)
    to_reference = ReferenceBonds(frame, settings.reference) if carried else None
    atoms = AtomSums(
        frame, threads, virial=work.atom_virial, residual="source_residual" in work.site, power="box_power" in work.whole,
        moment=bool({"atom_moment", "reference_atom_moment"} & {*work.whole}), reference_moment="reference_atom_moment" in work.whole,
    )  # fmt: skip
    weighted = weighted_virials(frame, settings, work, stage, reference) if work.horizon_users else None
    widths = [BOND[name].width for name in work.bond]
    peculiar_nc = factors.peculiar_nc if "power" in work.bond else None  # before threads ask for it

    def consume(bonds, thread):
        if work.bond == ["stress"]:
            for deposit in deposits:
                deposit.add_bond_stress(x_nc, bonds.i, bonds.r_bc, bonds.G_b, thread=thread)
        elif deposits:
            b_bk = bond_factors(work.bond, widths, bonds, peculiar_nc, frame.velocities)
            x_bc = x_nc[bonds.i]
            for deposit in deposits:
                deposit.add_bonds(x_bc, bonds.r_bc, b_bk, thread=thread)
        if to_reference is not None:
            X_bc, R_bc = to_reference.bonds(bonds)
            if reference_deposits:
                P_b9 = piola_factor(bonds, R_bc)
            for deposit in reference_deposits:
                deposit.add_bonds(X_bc, R_bc, P_b9, thread=thread)
        else:
            X_bc = R_bc = None
        if weighted is not None:
            weighted.add(x_nc, bonds, X_bc, R_bc, thread)
        atoms.add(bonds, thread, R_bc)

    wanted = deposits or to_reference is not None or weighted is not None or atoms.wanted
    # Potentials of other makers need not know about sources as long as nobody asks for them.
    more = {"sources": True} if work.source_users else {}
    decomposition = settings.pot.stream(
        frame, consume if wanted else None, threads=threads, energies=bool(work.energy_users), forces=False, **more
    )
    for k, s in enumerate(sums):
        if deposits:
            s.bond.update(_columns(work.bond, BOND, deposits[k].bond_sums()))
        if reference_deposits:
            s.bond.update(_columns(work.reference_bond, BOND, reference_deposits[k].bond_sums()))
        if weighted is not None:
            s.point.update(weighted.sums(k))
    if work.energy_users:
        factors.energies_n = decomposition.energies_n
    factors.atom_virial_n6, factors.residual_n4 = atoms.virial_n6, atoms.residual_n4
    return decomposition, atoms


def _columns(names, sources, total_gk) -> dict[str, np.ndarray]:
    """Sums side by side, taken apart by name."""
    ends = np.cumsum([sources[name].width for name in names])
    return dict(zip(names, np.split(total_gk, ends[:-1], axis=1), strict=True))


def _site_pass(frame, work, stage, factors, sums):
    """One pass over the atoms for every sum over them."""
    a_nk = factors.columns(work.site)
    for target, s in zip(stage.targets, sums):
        s.site.update(_columns(work.site, SITE, target.sites(frame.positions, a_nk)))
        if "kinetic" in work.site and "momentum" in work.site:
            local_shifts(s, target, frame.positions, factors, flux="kinetic_flux" in work.site)


def _gather_pass(frame, settings, work, stage, factors, sums):
    """The sums that need the kernel's gradient, or displacements."""
    gradient = any(q.gradient for q in work.quantities if not q.on_reference)
    plain = [name for name in work.gather if name not in ("mass", "displacement")]
    extra = factors.columns(plain) if plain else np.zeros((len(frame), 0))
    displacement = Displacement(frame, settings.reference, False) if "displacement" in work.gather else None
    names = ["mass", "displacement", *plain] if displacement else ["mass", *plain]
    for target, s in zip(stage.targets, sums):
        if displacement is not None:
            values, gradients = displacement.gather(target, frame.positions, frame.masses, extra, gradient)
        else:
            a_nk = np.concatenate([frame.masses[:, None], extra], axis=1)
            values, gradients = target.gather(frame.positions, a_nk, None, gradient)
        s.gathered.update(_columns(names, GATHER, values))
        if gradients is not None:
            s.gradient.update(_columns(names, GATHER, gradients))


def _reference_gather_pass(frame, settings, work, stage, factors, sums):
    """The same over reference positions."""
    displacement = Displacement(frame, settings.reference, True)
    energy_n1 = (factors.energies_n - settings.reference_energies())[:, None]
    names = ["reference_mass", "reference_displacement", "reference_energy"]
    for target, s in zip(stage.targets, sums):
        values, gradients = displacement.gather(target, settings.reference.positions, frame.masses, energy_n1, True)
        s.gathered.update(_columns(names, GATHER, values))
        s.gradient.update(_columns(names, GATHER, gradients))


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
        if not settings.central and work.symmetric_users:
            raise AtcError(
                f"{', '.join(work.symmetric_users)}: the forces of {settings.pot.describe()} do not act along bonds: ask for peridynamic_stress_nodal_virial"
            )
    for users, name, word in ((work.kernel_users, "kern", "kernel"), (work.grid_users, "grid", "grid")):
        if users and getattr(settings, name) is None:
            raise AtcError(f"no {word} was given but {', '.join(users)} need one")
    if work.horizon_users:
        horizon_of(settings, frame.units, work.horizon_users)
    if "atom_volume" in work.whole:
        node_volumes(frame)
    if work.gradient_users and settings.kern is not None:
        from ..deposit.gradient import require_differentiable

        require_differentiable(settings.kern, ", ".join(work.gradient_users))
    if work.reference_users and settings.reference is None:
        raise AtcError(f"no reference frame was given but {', '.join(work.reference_users)} need one: pass reference=")
    if any(q.kind == "box" for q in work.quantities) and not frame.cell.volume > 0:
        raise AtcError(f"{frame.source}: the cell has no volume, so the virial stress of the box is not defined")


def _whole(name, factors, decomposition, atoms, frame):
    if name == "box_virial":
        return decomposition.virial_cc.reshape(9)
    if name == "atom_virial":
        return atoms.virial_n6
    if name in ("atom_moment", "reference_atom_moment"):
        return atoms.moment_n9 if name == "atom_moment" else atoms.reference_moment_n9
    if name == "atom_volume":
        return node_volumes(frame)
    if name == "box_power":
        return atoms.power_c
    if name == "box_convection":
        return factors["energy_current"].sum(0)
    kinetic_n6 = factors["kinetic"]
    return kinetic_n6 if name == "atom_kinetic" else kinetic_n6.sum(0)


# Rounding error a point may have in T − ρ v⊗v, relative to its thermal part: far below the 1e-6 that is promised.
_SHIFT_TOLERANCE = 1e-9
_MAX_SHIFTS = 16


def local_shifts(sums: Sums, target: Target, x_nc, factors, flux: bool = False) -> None:
    """T − ρ v⊗v (and Σ ½ m w² w φ, if `flux`) where different regions move at very different speeds, without cancellation.

    The expressions do not change when one velocity is subtracted from all atoms; their rounding errors are about ε ρ |v(x) − c|² and
    ε ρ |v(x) − c|³ for the subtracted c. The frame's mean is enough for a uniform drift. Where it is not, more passes over the atoms take
    further c, each the velocity of the point that is worst off, and every point keeps the one nearest to its own velocity.

    Sets `thermal_shifted` and `kinetic_flux_shifted`, unless the frame's mean was enough everywhere.
    """
    best = sums.thermal_of_drift
    best_flux = sums.kinetic_flux_of_drift if flux else None
    rho = sums.rho
    v_gc = sums.peculiar
    have = np.linalg.norm(v_gc, axis=1)
    eps = 64 * np.finfo(float).eps
    # How many thermal speeds away from c a point may be.
    limit = (_SHIFT_TOLERANCE / eps) ** (1 / 3 if flux else 1 / 2)
    done = False
    for _ in range(_MAX_SHIFTS):
        heat = quotient(best[:, :3].sum(1), rho)
        # A point with one atom has no thermal part at all: measure it against what is typical of the points that certainly have one.
        certain = heat[heat > eps * have**2]
        scale = np.sqrt(np.maximum(heat, np.median(certain) if len(certain) else 0.0))
        error = np.where(sums.defined, have - limit * scale, 0.0)
        worst = int(np.argmax(error)) if len(error) else 0
        if not len(error) or not error[worst] > 0:
            break
        c = v_gc[worst].copy()
        w_nc = factors.peculiar_nc - c
        m = factors["mass"]
        columns = [m, m * w_nc, m * outer6(w_nc)]
        if flux:
            columns.append(0.5 * m * np.einsum("nc,nc->n", w_nc, w_nc)[:, None] * w_nc)
        total = target.sites(x_nc, np.ascontiguousarray(np.concatenate(columns, axis=1)))
        u_gc = quotient(total[:, 1:4], total[:, 0])
        distance = np.linalg.norm(u_gc, axis=1)
        nearer = sums.defined & (distance < have)
        if not nearer.any():
            break
        if not done:
            done, best = True, best.copy()
            best_flux = best_flux.copy() if flux else None
        shifted = thermal(total[:, :1], total[:, 1:4], total[:, 4:10])
        best[nearer] = shifted[nearer]
        if flux:
            best_flux[nearer] = kinetic_flux(total[:, 0], u_gc, shifted, total[:, 10:])[nearer]
        have = np.where(nearer, distance, have)
    if done:
        sums.thermal_shifted, sums.kinetic_flux_shifted = best, best_flux
