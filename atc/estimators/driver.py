"""One frame in, arrays out: one pass over the bonds and one over the atoms give every quantity asked."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from ..errors import AtcError
from ..units import require_compatible
from .accuracy.random_points import Check, checking_kernel, extent_of, kernel_internal, without_nan
from .accuracy.strongest_bonds import HotPoints, Strongest, put_right
from .deposits import Target
from .kinematics import Displacement
from .methods import DEPOSITS, EXACT, NAMES, Method, Refinement, deposits_of
from .peridynamic import horizon_of, node_volumes, weighted_virials
from .registry import BOND, GATHER, SITE, Work
from .shifts import local_shifts
from .sources import AtomFactors, AtomSums, ReferenceBonds, bond_factors, drift_velocity, piola_factor
from .sums import Sums, full


@dataclass
class Settings:
    """What a worker needs to know to turn a frame into fields; picklable. Deposits that `methods` does not name are
    summed exactly."""

    names: tuple[str, ...]
    pot: object = None
    kern: object = None
    grid: object = None
    methods: dict[str, Method] = field(default_factory=dict)
    tolerance: float = 1e-5
    reference: object = None
    threads: int = 1
    check_points: int = 100
    horizon: float | None = None  # the user's unit of length; None: the potential's
    tiles: tuple[int, int, int] | None = None
    anchor: object = None  # see `atc.verlet`

    @property
    def central(self) -> bool:
        """Whether the potential's forces act along bonds."""
        return getattr(self.pot, "central", True)

    def reference_energies(self) -> np.ndarray:
        """(n,) potential energies of the atoms in the reference frame, computed once."""
        if not hasattr(self, "_reference_energies"):
            self._reference_energies = self.pot.stream(
                self.reference, None, threads=self.threads, energies=True, forces=False
            ).energies_n
        return self._reference_energies


@dataclass
class FrameResult:
    """The fields of one frame, in the user's units; masked quantities hold 0 where `mask` is False.

    expected : of each field, its largest error anywhere as far as the points of the check tell: at least what was found
        there"""

    arrays: dict[str, np.ndarray]
    mask: np.ndarray | None = None
    weights: dict[str, np.ndarray] = field(default_factory=dict)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    bound: object = None
    seconds: dict[str, float] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)
    methods: dict[str, Method] = field(default_factory=dict)
    refined: list[Refinement] = field(default_factory=list)
    expected: dict[str, float] = field(default_factory=dict)
    # See `groups`: of how many frames these are the means, and how far those are from them.
    frames: int = 1
    within: dict[str, float] = field(default_factory=dict)


class Stage:
    """One configuration of the atoms (current or reference) with the grid in it: the main sums and those of the error
    check."""

    def __init__(self, frame, kern, settings, index):
        self.bound = settings.grid.bind(frame.units, frame.cell, frame.positions)
        self.check = Check(self.bound, kern, frame.cell, settings.threads, index, settings.check_points)
        self.main = Target(settings.methods, self.bound, kern, frame.cell, settings.threads)
        self.check.target.place(frame.positions)  # before threads ask for it
        self._kern, self._tolerance = kern, settings.tolerance
        # See `hot`: set where the strongest bonds are to be summed exactly; what they make; and whether they are still
        # to be found.
        self.strongest = self.strong_g = None
        self.seeking = False
        self.use(settings.methods)

    def use(self, methods, again=False) -> None:
        """From now on sum by these methods. `again`: they follow others that left too large an error, part of which may
        have been the check's own."""
        self.main.methods = methods
        self.reach = self._kern
        if again:
            self.check.target.summed_kern = self._kern
        elif self.bound.kind != "slab" and self._kern is not None:
            self.reach = self.check.target.summed_kern = checking_kernel(self._kern, methods, self._tolerance)

    def at(self, frame) -> None:
        """From now on for this frame, whose cell and grid are the same."""
        self.check.target.place(frame.positions)

    @property
    def targets(self):
        return self.main, self.check.target


def frame_fields(frame, settings: Settings, index: int = 0, run_tiles=None) -> FrameResult:
    """All quantities of `settings` on one frame, computed again by tighter methods as long as an error found is larger
    than allowed.

    Parameters
    ----------
    frame : Frame
    settings : Settings
    index : int
        Number of the frame: the random points of the error check depend on nothing else.
    run_tiles : callable
        With `settings.tiles`: how tiles are computed (see `tiles.bond_pass`). Default: one after the other, here.

    Returns
    -------
    FrameResult, in the frame's own units; `methods` are those used in the end, `refined` says what was computed again
    and why.

    Raises
    ------
    AtcError
        if the frame lacks what a quantity needs (masses, velocities), or there is no potential, kernel, grid or
        reference for it.
    """
    work = Work.of(settings.names, settings.central)
    require(frame, settings, work)
    goal = SAFE * settings.tolerance
    start = perf_counter()
    job = _FrameJob(frame, settings, work, index, run_tiles)
    methods, refined = dict(settings.methods), []
    todo = set(DEPOSITS)
    while True:
        job.compute(methods, todo)
        result = job.result()
        tighter = job.tightened(methods, result, goal)
        if not tighter:
            break
        for key, (method, why) in tighter.items():
            methods[key] = method
            refined.append(why.then(f"{NAMES[key]} {method}"))
        todo = set(tighter)
    result.methods, result.refined, result.expected = methods, refined, job.expected
    result.seconds["total"] = perf_counter() - start
    return result


#: What of the tolerance may be found, at random points and around the strongest bonds. All of it may be what normally
#: distributed errors reach at as many points as there are: an estimate on the large side, since errors of neighbouring
#: points are alike.
SAFE = 0.65
# Where the density is below this fraction of its largest value, quotients by it need the exact sums.
_THIN = 0.02
# The sums that fields are quotients of: deposit, and where its density is.
_QUOTIENTS = (
    ("site", "site", "mass"),
    ("gather", "gathered", "mass"),
    ("reference_gather", "gathered", "reference_mass"),
)


class _FrameJob:
    """One frame with the sums it has so far; single deposits can be computed again by another method."""

    def __init__(self, frame, settings, work, index, run_tiles=None):
        self.frame, self.settings, self.work, self.index = frame, settings, work, index
        self.run_tiles = run_tiles or (lambda f, tiles, task: (f(tile, task) for tile in tiles))
        kern = kernel_internal(settings.kern, frame.units) if work.kernel_users else None
        self.on_reference = set(work.on_reference)
        self.stage = Stage(frame, kern, settings, index) if set(work.grid_users) - self.on_reference else None
        self.reference = Stage(settings.reference, kern, settings, index) if self.on_reference else None
        self.drift = drift_velocity(frame) if "velocities" in work.attributes else np.zeros(3)
        self.factors = AtomFactors(frame, self.drift)
        self.sums: list[Sums] = []
        self.decomposition = self.atoms = None
        self.strongest = self.hot = self.hot_sums = None
        self.expected: dict[str, float] = {}
        self.seconds = {"bonds": 0.0, "sites": 0.0}

    def compute(self, methods, todo) -> None:
        """The sums of the deposits in `todo`; everything else is kept."""
        frame, work = self.frame, self.work
        for stage in (self.stage, self.reference):
            if stage is not None:
                stage.use(methods, again=bool(self.sums))
        # The sums on the grid, and those at the points of the check. Made anew, since they remember what was formed
        # from them.
        fresh = [
            Sums(drift=self.drift, volume=frame.cell.volume, boltzmann=frame.units.boltzmann, dimension=frame.dimension)
            for _ in range(2)
        ]
        for new, old in zip(fresh, self.sums):
            for name in ("site", "bond", "whole", "point", "gathered", "gradient"):
                setattr(new, name, getattr(old, name))
            new.thermal_shifted, new.kinetic_flux_shifted, new.size = (
                old.thermal_shifted,
                old.kinetic_flux_shifted,
                old.size,
            )
        first, self.sums = not self.sums, fresh
        start = perf_counter()
        if work.bond_users and (first or todo & {"bond", "reference_bond"}):
            watch = self._watched(methods)
            if self.stage is not None:
                self.stage.seeking = watch and self.strongest is None
                if self.stage.seeking:
                    self.strongest = Strongest(frame.positions, self.settings.threads)
                self.stage.strongest = self.strongest if watch else None
            if self.settings.tiles is None:
                anchor = self.settings.anchor
                with nullcontext() if anchor is None else anchor.at(frame):
                    self.decomposition, self.atoms = _bond_pass(
                        frame, self.settings, work, self.stage, self.reference, self.factors, fresh
                    )
            else:
                from .tiles import bond_pass

                self.decomposition, self.atoms = bond_pass(
                    frame,
                    self.settings,
                    work,
                    self.stage,
                    self.reference,
                    self.factors,
                    fresh,
                    self.index,
                    self.run_tiles,
                )
            if getattr(self.settings.pot, "pairwise", False):
                # Pairs churn nothing: z = S + M is 0 for them identically, not only as far as two approximate sums
                # cancel.
                for s in fresh:
                    if {"stress", "sources"} <= s.bond.keys():
                        s.bond["sources"] = -full(s.bond["stress"]).reshape(-1, 9)
            self.hot = None
            if watch:
                self._add_hot()
        bonds_done = perf_counter()
        if work.summed_site and (first or "site" in todo):
            for s in fresh:
                s.thermal_shifted = s.kinetic_flux_shifted = None
            _site_pass(frame, work, self.stage, self.factors, fresh)
        if work.gather and (first or "gather" in todo):
            _gather_pass(frame, self.settings, work, self.stage, self.factors, fresh)
            if work.site and not work.summed_site:
                fresh[0].site.update({name: fresh[0].gathered[name] for name in work.site})
                # The check keeps to a path of its own.
                fresh[1].site.update(
                    _columns(
                        work.site, SITE, self.stage.check.target.sites(frame.positions, self.factors.columns(work.site))
                    )
                )
        if work.reference_gather and (first or "reference_gather" in todo):
            _reference_gather_pass(frame, self.settings, work, self.reference, self.factors, fresh)
        for name in work.whole:
            fresh[0].whole[name] = _whole(name, self.factors, self.decomposition, self.atoms, frame)
        self.seconds["bonds"] += bonds_done - start
        self.seconds["sites"] += perf_counter() - bonds_done

    def _watched(self, methods) -> bool:
        """Whether points around the strongest bonds are to be looked at: where sums over bonds are approximate."""
        lattice = self.stage is not None and self.stage.bound.kind != "slab"
        return lattice and self.settings.tiles is None and watched(self.work, self.settings, methods)

    def _add_hot(self) -> None:
        """The exact sums at the points around the strongest bonds."""
        frame, work, stage = self.frame, self.work, self.stage
        hot = HotPoints(frame, self.settings, stage, self.strongest, stage.strong_g, self.index)
        if not len(hot):
            return
        sums = Sums(
            drift=self.drift, volume=frame.cell.volume, boltzmann=frame.units.boltzmann, dimension=frame.dimension
        )
        sums.bond.update(_columns(work.bond, BOND, hot.bond_sums(work.bond, self.drift)))
        if getattr(self.settings.pot, "pairwise", False) and {"stress", "sources"} <= sums.bond.keys():
            sums.bond["sources"] = -full(sums.bond["stress"]).reshape(-1, 9)
        if work.site:
            add_sites(frame, work, [(hot.check.target, sums)], self.factors)
        self.hot, self.hot_sums = hot, sums

    def result(self) -> FrameResult:
        frame, work = self.frame, self.work
        main, at_points = self.sums
        self._clear_thin(main)
        arrays, errors, weights = {}, {}, {}
        for q in work.quantities:
            values = q.form(main)
            arrays[q.name] = frame.units.to_user(q.dimension, values)
            if q.kind == "grid":
                here = self.reference if q.name in self.on_reference else self.stage
                # Points that are never defined are NaN in both.
                wanted, known = without_nan(q.form(at_points)), without_nan(values)
                extent = extent_of(known)
                errors[q.name] = found = here.check.errors(known, wanted, q.scale(main), extent)
                if self.hot is not None and q in checkable(work):
                    more = self.hot.check.errors(known, without_nan(q.form(self.hot_sums)), q.scale(main), extent)
                    for key in ("error_max", "error_of_fluctuation"):
                        found[key] = max(found[key], more[key])
                self.expected[q.name] = max(
                    found["error_max"], SAFE * here.check.expected(known, wanted, q.scale(main), extent)
                )
                arrays[q.name] = arrays[q.name].reshape(*here.bound.shape, *values.shape[1:])
                if q.weight is not None:
                    weights[q.name] = main.site[q.weight][:, 0].reshape(here.bound.shape)
        here = self.stage or self.reference
        return FrameResult(
            arrays,
            mask=main.defined.reshape(self.stage.bound.shape) if work.masked else None,
            weights=weights,
            errors=errors,
            bound=here.bound if here else None,
            seconds=dict(self.seconds),
            notes=dict(getattr(self.decomposition, "notes", None) or {}),
        )

    def _clear_thin(self, main) -> None:
        if self.stage or self.reference:
            clear_thin(main, (self.stage or self.reference).main.methods)

    def tightened(self, methods, result, goal) -> dict:
        return tightened(
            self.work,
            methods,
            thin_sums(self.sums[0], self.work),
            self.expected if self.settings.check_points else {},
            goal,
        )


def watched(work, settings, methods) -> bool:
    """Whether there are approximate sums over bonds, and fields of them, that are to be looked at around the strongest
    bonds."""
    return bool(not methods.get("bond", EXACT).exact and work.bond and settings.check_points and checkable(work))


def clear_thin(main, methods) -> None:
    """What an approximate sum leaves where there is no mass is no mass."""
    for key, of, name in _QUOTIENTS:
        method, rho = methods.get(key), getattr(main, of).get(name)
        if method is not None and not method.exact and rho is not None:
            rho[rho < 4 * method.tolerance * rho.max(initial=0.0)] = 0.0


def thin_sums(main, work) -> set[str]:
    """The deposits whose sums are small somewhere though fields are quotients by them."""
    found = {key: getattr(main, of).get(name) for key, of, name in _QUOTIENTS if key != "site" or work.masked}
    return {
        key for key, rho in found.items() if rho is not None and rho.min(initial=np.inf) < _THIN * rho.max(initial=0.0)
    }


def tightened(work, methods, thin, expected, goal) -> dict:
    """{deposit: (its next method, a Refinement)} for every approximate deposit that a field with too large an error is
    made of.

    thin : see `thin_sums`; expected : the error of each field
    """
    loose = {key for key, m in methods.items() if not m.exact}
    out = {}
    for key, _, _ in _QUOTIENTS:
        if key in loose & thin and not methods[key].forced:
            why = "nearly empty space, where fields are quotients of small sums"
            out[key] = methods[key].exactly(why), Refinement(why)
    if not loose:
        return out
    for q in work.quantities:
        error = expected.get(q.name, 0.0)
        if error <= goal:
            continue
        for key in deposits_of(q, work):
            if key not in loose:
                continue
            method = methods[key].tightened(error, goal)
            if method != methods[key] and (
                key not in out or method.exact or not 0 < out[key][0].tolerance <= method.tolerance
            ):
                if key not in out or not out[key][0].exact:
                    out[key] = method, Refinement(f"{q.name} above {goal:.1e}", error)
    return out


def _bond_pass(frame, settings, work, stage, reference, factors, sums, kept=None):
    """One pass over the bonds for every sum over them; returns the potential's word on the frame and the per-atom sums.

    kept : a deposit of several frames that the bonds are added to; its sums are not taken here, nor are the strongest
        bonds taken out of it
    """
    x_nc, threads = frame.positions, settings.threads
    deposit = None if not work.bond else stage.main.open(work.n_bond) if kept is None else kept
    reference_deposit = reference.main.open(work.n_reference_bond, "reference_bond") if work.reference_bond else None
    # The error check takes only the bonds near its points, and one more sum: how large the terms of the stress are.
    size = bool({"stress", "moment"} & {*work.bond})
    length = max(settings.pot.cutoff, 0.0)
    check = stage.check.target.open(work.n_bond + size, length=length) if work.bond else None
    reference_check = reference.check.target.open(work.n_reference_bond, length=length) if work.reference_bond else None
    carried = bool(work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole)
    to_reference = ReferenceBonds(frame, settings.reference) if carried else None
    atoms = AtomSums(
        frame,
        threads,
        virial=work.atom_virial,
        residual="source_residual" in work.site,
        power="box_power" in work.whole,
        moment=bool({"atom_moment", "reference_atom_moment"} & {*work.whole}),
        reference_moment="reference_atom_moment" in work.whole,
    )
    weighted = weighted_virials(frame, settings, work, stage, reference) if work.horizon_users else None
    widths = [BOND[name].width for name in work.bond]
    peculiar_nc = factors.peculiar_nc if "power" in work.bond else None  # before threads ask for it

    def consume(bonds, thread):
        if deposit is not None:
            if work.bond == ["stress"]:
                deposit.add_bond_stress(x_nc, bonds.i, bonds.r_bc, bonds.G_b, thread=thread, j_b=bonds.j)
            else:
                b_bk = bond_factors(work.bond, widths, bonds, peculiar_nc, frame.velocities)
                deposit.add_bonds(x_nc[bonds.i], bonds.r_bc, b_bk, thread=thread)
            if stage.seeking:
                stage.strongest.add(bonds, thread)
            for found in check.find(x_nc, bonds.i, bonds.r_bc, thread):
                few = bonds.taken(found.bonds)
                check.add_found(
                    found, bond_factors(work.bond, widths, few, peculiar_nc, frame.velocities, size=size), thread
                )
        if to_reference is not None:
            X_bc, R_bc = to_reference.bonds(bonds)
            if reference_deposit is not None:
                P_b9 = piola_factor(bonds, R_bc)
                reference_deposit.add_bonds(X_bc, R_bc, P_b9, thread=thread)
                for found in reference_check.find(settings.reference.positions, bonds.i, R_bc, thread):
                    reference_check.add_found(found, P_b9[found.bonds], thread)
        else:
            X_bc = R_bc = None
        if weighted is not None:
            weighted.add(x_nc, bonds, X_bc, R_bc, thread)
        atoms.add(bonds, thread, R_bc)

    wanted = deposit is not None or to_reference is not None or weighted is not None or atoms.wanted
    # Potentials of other makers need not know about sources as long as nobody asks for them.
    more = {"sources": True} if work.source_users else {}
    decomposition = settings.pot.stream(
        frame, consume if wanted else None, threads=threads, energies=bool(work.energy_users), forces=False, **more
    )
    if deposit is not None:
        exact = 0.0
        if stage.strongest is not None and kept is None:
            strong = stage.strongest.sort_out()
            b_bk = bond_factors(work.bond, widths, strong, peculiar_nc, frame.velocities)
            exact = put_right(deposit, stage, x_nc, strong, b_bk)
            stage.strong_g = np.abs(exact[:, : BOND[work.bond[0]].width]).max(1)
        if kept is None:
            sums[0].bond.update(_columns(work.bond, BOND, deposit.bond_sums() + exact))
        at_points = check.bond_sums()
        sums[1].bond.update(_columns(work.bond, BOND, at_points[:, : work.n_bond]))
        if size:
            for s in sums:
                s.size = float(at_points[:, -1].max(initial=0.0))
    if reference_deposit is not None:
        for s, d in zip(sums, (reference_deposit, reference_check)):
            s.bond.update(_columns(work.reference_bond, BOND, d.bond_sums()))
    if weighted is not None:
        for k, s in enumerate(sums):
            s.point.update(weighted.sums(k))
    if work.energy_users:
        factors.energies_n = decomposition.energies_n
    factors.forget("atom_virial", "source_residual", "potential_energy", "potential_flux", "energy_current")
    factors.atom_virial_n6, factors.residual_n4 = atoms.virial_n6, atoms.residual_n4
    return decomposition, atoms


def _columns(names, sources, total_gk) -> dict[str, np.ndarray]:
    """Sums side by side, taken apart by name."""
    ends = np.cumsum([sources[name].width for name in names])
    return dict(zip(names, np.split(total_gk, ends[:-1], axis=1), strict=True))


def checkable(work) -> list:
    """The fields that points around the strongest bonds can be computed for: those of sums over bonds and atoms
    alone."""
    return [
        q
        for q in work.quantities
        if q.kind == "grid" and q.bond and not (q.on_reference or q.gather or q.gradient or q.point or q.whole)
    ]


def _site_pass(frame, work, stage, factors, sums):
    """One pass over the atoms for every sum over them."""
    add_sites(frame, work, zip(stage.targets, sums), factors)


def add_sites(frame, work, targets, factors):
    """The sums over atoms at some targets: (Target, Sums) pairs."""
    a_nk = factors.columns(work.site)
    for target, s in targets:
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
        values, gradients = displacement.gather(
            target, settings.reference.positions, frame.masses, energy_n1, True, "reference_gather"
        )
        s.gathered.update(_columns(names, GATHER, values))
        s.gradient.update(_columns(names, GATHER, gradients))


def require(frame, settings, work):
    """Say what is missing before anything is computed."""
    for attribute, users in work.attributes.items():
        frame.require(attribute, why=", ".join(users))
    if work.bond_users:
        if settings.pot is None:
            raise AtcError(
                f"no potential was given but {_need(work.bond_users)} one: give the pair_style/pair_coeff lines of "
                "the run"
            )
        require_compatible(settings.pot.units, frame.units, "the potential", frame.source)
        if not settings.central and work.symmetric_users:
            raise AtcError(
                f"{', '.join(work.symmetric_users)}: the forces of {settings.pot.describe()} do not act along bonds: "
                "ask for peridynamic_stress_nodal_virial"
            )
    for users, name, word in ((work.kernel_users, "kern", "kernel"), (work.grid_users, "grid", "grid")):
        if users and getattr(settings, name) is None:
            raise AtcError(f"no {word} was given but {_need(users)} one")
    if work.horizon_users:
        horizon_of(settings, frame.units, work.horizon_users)
    if "atom_volume" in work.whole:
        node_volumes(frame)
    if work.gradient_users and settings.kern is not None:
        from ..deposit.gradient import require_differentiable

        require_differentiable(settings.kern, ", ".join(work.gradient_users))
    if work.reference_users and settings.reference is None:
        raise AtcError(f"no reference frame was given but {_need(work.reference_users)} one: pass reference=")
    if any(q.kind == "box" for q in work.quantities) and not frame.cell.volume > 0:
        raise AtcError(f"{frame.source}: the cell has no volume, so the virial stress of the box is not defined")


def _need(users) -> str:
    return f"{', '.join(users)} need{'s' * (len(users) == 1)}"


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
