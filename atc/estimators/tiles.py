"""A frame computed tile by tile, each small enough for one worker: every bond belongs to exactly one of them, so that
their sums add up.

How a frame is cut is in `cutting`. The potential sees a tile as an open cluster. A bond is the tile's if its end with
the lower index is one of the tile's own atoms; a bond of an atom with its own image, if that image lies in the positive
direction. Where a bond's field falls does not matter: each tile adds to the whole grid of the whole cell. Sums per atom
are complete in the tile that owns the atom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..decomposers.base import Decomposition
from ..errors import AtcError
from ..frame import Cell
from .accuracy.random_points import Check, checking_kernel
from .deposits import Target
from .peridynamic import WeightedVirials, horizon_of
from .registry import BOND, Work
from .sources import AtomSums, ReferenceBonds, bond_factors, piola_factor
from .tile_cuts import Cut, Tile, owned


@dataclass
class Place:
    """Where sums are wanted: the grid, and the points of the error check in it; see `compute.Stage`."""

    bound: object
    kern: object
    cell: Cell


@dataclass
class Task:
    """What a tile is to be asked for; picklable."""

    pot: object
    quantities: tuple[str, ...]
    methods: dict
    here: Place | None
    reference: Place | None
    threads: int
    index: int
    check_points: int
    tolerance: float
    drift: np.ndarray
    horizon: float | None


class _Spot:
    """A place, ready for the bonds of one tile; has what `compute.Stage` has."""

    def __init__(self, place, task, n_bond, key="bond", size=False):
        self.bound, self.main = place.bound, Target(task.methods, place.bound, place.kern, place.cell, task.threads)
        checker = Check(place.bound, place.kern, place.cell, task.threads, task.index, task.check_points)
        self.targets = self.main, checker.target
        self.deposit = self.check = None
        if not n_bond:
            return
        self.deposit = self.main.open(n_bond, key)
        if place.bound.kind != "slab":
            checker.target.summed_kern = checking_kernel(place.kern, task.methods, task.tolerance)
        self.check = checker.target.open(n_bond + size, length=max(task.pot.cutoff, 0.0))

    def sums(self):
        return self.deposit.bond_sums(), self.check.bond_sums()


def refuse(frame, work, pot) -> None:
    """Raise for what is not computed in tiles."""
    if not hasattr(pot, "terms") or not getattr(pot, "central", True):
        raise AtcError(
            "tiles: only potentials made of atc's terms are cut into tiles, not the bonds of a body: leave tiles out"
        )


def tile_sums(tile: Tile, task: Task) -> dict:
    """The tile's share of every sum over bonds: on the grid, at the points of the check, of its own atoms, and the
    virial."""
    frame, threads, work = tile.frame, task.threads, Work.of(task.quantities)
    names, whole = work.bond, {*work.whole}
    size = "stress" in names
    here = reference = weighted = None
    if task.here is not None:
        here = _Spot(task.here, task, work.n_bond, size=size)
    if task.reference is not None:
        reference = _Spot(task.reference, task, work.n_reference_bond, "reference_bond")
    if work.horizon_users:
        weighted = WeightedVirials(
            [task.here and task.here.cell, task.reference and task.reference.cell],
            task.pot,
            threads,
            work,
            here,
            reference,
            task.horizon,
        )
    moment = bool({"atom_moment", "reference_atom_moment"} & whole)
    residual, reference_moment = "source_residual" in work.site, "reference_atom_moment" in whole
    atoms = AtomSums(
        frame, threads, virial=work.atom_virial, residual=residual, moment=moment, reference_moment=reference_moment
    )
    # Not a sum of one atom: of the bonds that are this tile's.
    power = AtomSums(frame, threads, power="box_power" in whole)
    widths = [BOND[name].width for name in names]
    peculiar_nc = frame.velocities - task.drift if "power" in names else None
    virials = [np.zeros((3, 3)) for _ in range(threads)]
    counts = [0] * threads

    def consume(bonds, thread):
        if tile.reference is not None:
            X_bc, R_bc = tile.reference.bonds(bonds)
        else:
            X_bc = R_bc = None
        # Atoms of the tile have all their bonds here, whoever owns these.
        atoms.add(bonds, thread, R_bc)
        k = owned(bonds.i, bonds.j, tile.index_p, tile.own_p, tile.image_pc)
        mine = bonds.taken(k)
        if not len(mine):
            return
        if R_bc is not None:
            X_bc, R_bc = X_bc[k], R_bc[k]
        virials[thread] += mine.virial()
        counts[thread] += len(mine)
        power.add(mine, thread)
        if names:
            if names == ["stress"]:
                here.deposit.add_bond_stress(frame.positions, mine.i, mine.r_bc, mine.G_b, thread=thread, j_b=mine.j)
            else:
                b_bk = bond_factors(names, widths, mine, peculiar_nc, frame.velocities)
                here.deposit.add_bonds(frame.positions[mine.i], mine.r_bc, b_bk, thread=thread)
            for found in here.check.find(frame.positions, mine.i, mine.r_bc, thread):
                few = mine.taken(found.bonds)
                here.check.add_found(
                    found, bond_factors(names, widths, few, peculiar_nc, frame.velocities, size=size), thread
                )
        if work.reference_bond:
            P_b9 = piola_factor(mine, R_bc)
            reference.deposit.add_bonds(X_bc, R_bc, P_b9, thread=thread)
            for found in reference.check.find(tile.reference.X_nc, mine.i, R_bc, thread):
                reference.check.add_found(found, P_b9[found.bonds], thread)
        if weighted is not None:
            weighted.add(frame.positions, mine, X_bc, R_bc, thread)

    more = {"sources": True} if work.source_users else {}
    d = tile.potential(task.pot).stream(
        frame, consume, threads=threads, energies=bool(work.energy_users), forces=False, **more
    )
    own = np.flatnonzero(tile.own_p)
    out = {
        "own": tile.index_p[own],
        "sum": {"virial": sum(virials), "n_bonds": sum(counts)},
        "atoms": {},
        "notes": d.notes,
    }
    if names:
        out["sum"]["main"], out["sum"]["check"] = here.sums()
    if work.reference_bond:
        out["sum"]["reference main"], out["sum"]["reference check"] = reference.sums()
    if weighted is not None:
        for k in range(2):
            out["sum"].update({(name, k): values for name, values in weighted.sums(k).items()})
    if power.power_c is not None:
        out["sum"]["power"] = power.power_c
    of_atoms = (
        ("energies_n", d.energies_n),
        *((name, getattr(atoms, name)) for name in ("virial_n6", "residual_n4", "moment_n9", "reference_moment_n9")),
    )
    out["atoms"] = {name: values[own] for name, values in of_atoms if values is not None}
    return out


@dataclass
class _Atoms:
    """What `AtomSums` of the whole frame would hold."""

    virial_n6: np.ndarray | None = None
    residual_n4: np.ndarray | None = None
    moment_n9: np.ndarray | None = None
    reference_moment_n9: np.ndarray | None = None
    power_c: np.ndarray | None = None


def bond_pass(frame, settings, work, stage, reference, factors, sums, index: int, run) -> tuple:
    """Like the pass over the bonds of a whole frame (`compute`), tile by tile.

    run : (tile_sums, iterable of tiles, Task) -> their results in order; where the tiles are computed is its affair
    """
    refuse(frame, work, settings.pot)
    carried = bool(work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole)
    to_reference = ReferenceBonds(frame, settings.reference) if carried else None
    cut = Cut(frame, settings.tiles, settings.pot, to_reference)
    places = [
        Place(s.bound, s.main.kern, at.cell) if s is not None and needed else None
        for s, at, needed in (
            (stage, frame, work.bond or work.point),
            (reference, settings.reference, work.reference_bond or work.reference_point),
        )
    ]
    horizon = horizon_of(settings, frame.units, work.horizon_users) if work.horizon_users else None
    methods = (stage or reference).main.methods if stage or reference else {}
    task = Task(
        cut.pot,
        tuple(q.name for q in work.quantities),
        methods,
        *places,
        settings.threads,
        index,
        settings.check_points,
        settings.tolerance,
        factors.drift,
        horizon,
    )
    total: dict = {}
    of_atoms: dict = {}
    notes: dict = {}
    for part in run(tile_sums, cut.tiles(), task):
        for name, values in part["sum"].items():
            total[name] = total[name] + values if name in total else values
        for name, values in part["atoms"].items():
            if name not in of_atoms:
                of_atoms[name] = np.zeros((len(frame), *values.shape[1:]))
            of_atoms[name][part["own"]] = values
        # What neighbouring tiles both looked at is counted by both.
        for what, count in part["notes"].items():
            notes[what] = notes.get(what, 0) + count
    if not total:
        # No atoms, no tiles: the sums of a frame without bonds.
        part = tile_sums(next(Cut(frame, (1, 1, 1), settings.pot, to_reference).tiles(empty=True)), task)
        total, of_atoms = part["sum"], part["atoms"]
    size = "stress" in work.bond
    for k, (s, name) in enumerate(zip(sums, ("main", "check"))):
        if work.bond:
            s.bond.update(_columns(work.bond, total[name]))
        if work.reference_bond:
            s.bond.update(_columns(work.reference_bond, total[f"reference {name}"]))
        s.point.update({point: total[point, k] for point in work.point + work.reference_point})
        if size:
            s.size = float(total["check"][:, -1].max(initial=0.0))
    energies = of_atoms.pop("energies_n", None)
    atoms = _Atoms(**of_atoms, power_c=total.get("power"))
    if work.energy_users:
        factors.energies_n = energies
    factors.forget("atom_virial", "source_residual", "potential_energy", "potential_flux", "energy_current")
    factors.atom_virial_n6, factors.residual_n4 = atoms.virial_n6, atoms.residual_n4
    energy = float(energies.sum()) if work.energy_users else np.nan
    return Decomposition(energy, total["virial"], energies, n_bonds=total["n_bonds"], notes=notes), atoms


def _columns(names, total_gk) -> dict[str, np.ndarray]:
    out, at = {}, 0
    for name in names:
        out[name] = total_gk[:, at : at + BOND[name].width]
        at += BOND[name].width
    return out
