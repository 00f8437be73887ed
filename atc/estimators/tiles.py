"""A frame cut into tiles, each small enough for one worker: every bond belongs to exactly one of them, so that their sums add up.

A tile holds its own atoms and, around them, copies of all others (periodic images too) that their bonds can depend on: r_c deep for pair potentials, 2 r_c for
many-body ones, whose force between two atoms depends on the neighbours of both. The potential sees it as an open cluster. A bond is the tile's if its end with
the lower index is one of the tile's own atoms; a bond of an atom with its own image, if that image lies in the positive direction. Where a bond's field
falls does not matter: each tile adds to the whole grid of the whole cell.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..bonds import Bonds
from ..decomposers.base import Decomposition
from ..errors import AtcError
from ..frame import Cell, Frame
from .accuracy import Check, checking_kernel
from .registry import BOND
from .sources import AtomSums, bond_factors
from .target import NearPoints, Target


@dataclass
class Tile:
    """frame : the tile's atoms as an open cluster; own_p : which are its own; index_p, image_pc : which atom of the whole frame, and which image."""

    frame: Frame
    own_p: np.ndarray
    index_p: np.ndarray
    image_pc: np.ndarray


@dataclass
class Task:
    """What a tile is to be asked for; picklable."""

    pot: object
    names: list[str]
    methods: dict
    bound: object
    kern: object
    cell: Cell
    threads: int
    index: int
    check_points: int
    tolerance: float
    drift: np.ndarray
    energies: bool
    sources: bool
    virial: bool
    residual: bool


def depth(pot) -> float:
    """How far around its own atoms a tile must know the others."""
    for term in pot.terms:
        while hasattr(term, "term"):
            term = term.term
        if not term.cutoff > 0:
            raise AtcError(f"tiles: {term.describe().split(',')[0]} is listed by topology, which is not cut into tiles: leave tiles out")
    pairwise = all(t.pairwise for t in pot.terms)
    return pot.cutoff * (1.0 if pairwise else 2.0) * (1 + 1e-9)


def check(frame, work, pot) -> None:
    """Raise for what is not computed in tiles."""
    whole = {"box_power", "atom_moment", "reference_atom_moment"}
    which = [q.name for q in work.quantities if {"piola", "moment"} & {*q.bond} or whole & {*q.whole} or q.point]
    if which:
        raise AtcError(f"tiles: {', '.join(which)} cannot be computed in tiles: leave tiles out")
    if not hasattr(pot, "terms") or not getattr(pot, "central", True):
        raise AtcError("tiles: only potentials of atoms are cut into tiles, not the bonds of a body: leave tiles out")
    if frame.topology:
        raise AtcError("tiles: a frame with bonded topology is not cut into tiles: leave tiles out")
    depth(pot)


def cut(frame, counts, halo: float):
    """The tiles of a frame, one after the other: counts along the cell's edges."""
    cell = frame.cell
    s = cell.fractional(frame.positions)
    s -= np.where(cell.periodic, np.floor(s), 0.0)
    low = np.where(cell.periodic, 0.0, s.min(0, initial=0.0))
    span = np.where(cell.periodic, 1.0, np.maximum(s.max(0, initial=1.0) - low, 1e-9))
    place = np.clip(np.floor((s - low) / span * counts), 0, np.array(counts) - 1).astype(int)
    home = cell.cartesian(s)
    h = halo / cell.heights
    for tile in np.ndindex(*counts):
        own = (place == tile).all(1)
        if not own.any():
            continue
        # The atoms' own extent, not the tile's: an atom on the border may have been put on either side.
        lo, hi = s[own].min(0) - h, s[own].max(0) + h
        ranges = [range(int(np.ceil(lo[a] - 1)), int(np.floor(hi[a])) + 1) if cell.periodic[a] else range(1) for a in range(3)]
        parts = []
        for image in itertools.product(*ranges):
            near = np.flatnonzero(((s + image >= lo) & (s + image <= hi)).all(1))
            if len(near):
                parts.append((near, np.tile(np.array(image, np.int32), (len(near), 1))))
        index = np.concatenate([p[0] for p in parts])
        image = np.concatenate([p[1] for p in parts])
        yield Tile(_cluster(frame, home, index, image), own[index] & ~image.any(1), index, image)


def _cluster(frame, home, index, image):
    """The chosen atoms and images as an open frame."""
    take = {
        name: None if getattr(frame, name) is None else getattr(frame, name)[index] for name in ("types", "masses", "velocities", "charges")
    }
    open_cell = Cell(frame.cell.vectors, frame.cell.origin, (False, False, False))
    return Frame(home[index] + image @ frame.cell.vectors, open_cell, frame.units, step=frame.step, source=frame.source, **take)


def tile_sums(tile: Tile, task: Task) -> dict:
    """The tile's share of every sum over bonds: on the grid, at the points of the check, of its own atoms, and the virial."""
    frame, threads = tile.frame, task.threads
    main = Target(task.methods, task.bound, task.kern, task.cell, threads)
    checker = Check(task.bound, task.kern, task.cell, threads, task.index, task.check_points)
    n_bond, size = sum(BOND[name].width for name in task.names), "stress" in task.names
    near = None
    if task.bound is not None and task.names:
        deposit, check = main.open(n_bond), None
        if task.bound.kind != "slab":
            reach = checker.target.summed_kern = checking_kernel(task.kern, task.methods, task.tolerance)
            points = task.bound.relative_points_of(checker.which)
            near = NearPoints(points, reach.support, max(task.pot.cutoff, 0.0), task.cell, frame.positions)
        check = checker.target.open(n_bond + size)
        checker.target.place(frame.positions)
    atoms = AtomSums(frame, threads, virial=task.virial, residual=task.residual)
    widths = [BOND[name].width for name in task.names]
    peculiar_nc = frame.velocities - task.drift if "power" in task.names else None
    virials = [np.zeros((3, 3)) for _ in range(threads)]
    counts = [0] * threads

    def consume(bonds, thread):
        # Atoms of the tile have all their bonds here, whoever owns these.
        atoms.add(bonds, thread)
        k = _owned(bonds.i, bonds.j, tile.index_p, tile.own_p, tile.image_pc)
        mine = Bonds(bonds.i[k], bonds.j[k], bonds.r_bc[k], bonds.G_b[k], None if bonds.D_bdc is None else bonds.D_bdc[k])
        if not len(mine):
            return
        virials[thread] += mine.virial()
        counts[thread] += len(mine)
        if not task.names:
            return
        deposit.add_bonds(
            frame.positions[mine.i], mine.r_bc, bond_factors(task.names, widths, mine, peculiar_nc, frame.velocities), thread=thread
        )
        few = mine if near is None else near.take(mine)
        if len(few):
            b_bk = bond_factors(task.names, widths, few, peculiar_nc, frame.velocities)
            if size:
                sizes = np.abs(few.G_b) * np.einsum("bc,bc->b", few.r_bc, few.r_bc)
                b_bk = np.concatenate([b_bk, sizes[:, None]], axis=1)
            check.add_bonds(frame.positions[few.i], few.r_bc, b_bk, thread=thread)

    more = {"sources": True} if task.sources else {}
    d = task.pot.stream(frame, consume, threads=threads, energies=task.energies, forces=False, **more)
    own = np.flatnonzero(tile.own_p)
    out = {"own": tile.index_p[own], "virial": sum(virials), "n_bonds": sum(counts)}
    if task.names:
        out["main"], out["check"] = deposit.bond_sums(), check.bond_sums()
    if task.energies:
        out["energies"] = d.energies_n[own]
    for name, values in (("atom_virial", atoms.virial_n6), ("residual", atoms.residual_n4)):
        if values is not None:
            out[name] = values[own]
    return out


@dataclass
class _Atoms:
    """What `AtomSums` of the whole frame would hold."""

    virial_n6: np.ndarray | None = None
    residual_n4: np.ndarray | None = None


def bond_pass(frame, settings, work, stage, factors, sums, index: int, run) -> tuple:
    """Like the pass over the bonds of a whole frame (`compute`), tile by tile.

    run : (tile_sums, iterable of tiles, Task) -> their results in order; where the tiles are computed is its affair
    """
    check(frame, work, settings.pot)
    task = Task(
        settings.pot, work.bond, stage.main.methods if stage else {}, stage.bound if stage else None, stage.main.kern if stage else None, frame.cell,
        settings.threads, index, settings.check_points, settings.tolerance, factors.drift, bool(work.energy_users), bool(work.source_users), bool(work.atom_virial),
        "source_residual" in work.site,
    )  # fmt: skip
    total, n = {"virial": np.zeros((3, 3)), "n_bonds": 0}, len(frame)
    atoms = _Atoms(np.zeros((n, 6)) if task.virial else None, np.zeros((n, 4)) if task.residual else None)
    energies = np.zeros(n) if task.energies else None
    for part in run(tile_sums, cut(frame, settings.tiles, depth(settings.pot)), task):
        for name in ("main", "check", "virial", "n_bonds"):
            if name in part:
                total[name] = total[name] + part[name] if name in total else part[name]
        for values, name in ((energies, "energies"), (atoms.virial_n6, "atom_virial"), (atoms.residual_n4, "residual")):
            if values is not None:
                values[part["own"]] = part[name]
    if work.bond:
        empty = np.zeros((len(stage.bound), work.n_bond)), np.zeros((len(stage.check.which), work.n_bond + ("stress" in work.bond)))
        for s, name, none in zip(sums, ("main", "check"), empty):
            at = 0
            values = total.get(name, none)
            for b in work.bond:
                s.bond[b] = values[:, at : at + BOND[b].width]
                at += BOND[b].width
        if "stress" in work.bond:
            for s in sums:
                s.size = float(total.get("check", empty[1])[:, -1].max(initial=0.0))
    if task.energies:
        factors.energies_n = energies
    factors.forget("atom_virial", "source_residual", "potential_energy", "potential_flux", "energy_current")
    factors.atom_virial_n6, factors.residual_n4 = atoms.virial_n6, atoms.residual_n4
    energy = float(energies.sum()) if task.energies else np.nan
    return Decomposition(energy, total["virial"], energies, n_bonds=total["n_bonds"]), atoms


@njit(cache=True, nogil=True, error_model="numpy")
def _owned(i, j, index, own, image):
    """The bonds that belong to this tile."""
    out = np.empty(len(i), np.int64)
    n = 0
    for b in range(len(i)):
        p, q = i[b], j[b]
        if index[p] != index[q]:
            mine = own[p] if index[p] < index[q] else own[q]
        else:
            # An atom and its own image, or two images: the one at home has the other on its positive side.
            if own[q]:
                p, q = q, p
            mine = own[p]
            if mine:
                positive = False
                for c in range(3):
                    if image[q, c] != 0:
                        positive = image[q, c] > 0
                        break
                mine = positive
        out[n] = b
        n += 1 if mine else 0
    return out[:n]
