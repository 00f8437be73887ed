"""What flows through planes: momentum (the stress) and energy, by the bonds that cross them and the atoms that pass.

    σ_nj(plane) = Σ_bonds crossing sgn(r_n) G r_j / A − Σ_atoms passing sgn(u_n) m u_j / (A Δt)

u is an atom's velocity on its path over the interval Δt. The row of the normal, and what flows along it, is all that
passes through the plane: between two planes momentum changes by the difference of theirs and by forces from outside, in
every frame. Other rows are the same sums of G r_i r_j/|r_n|: plane averages over the bonds' lines (Irving & Kirkwood).

Source: Todd, Evans & Daivis, Phys. Rev. E 52 (1995) 1627; Irving & Kirkwood, J. Chem. Phys. 18 (1950) 817.
"""

from __future__ import annotations

from contextlib import nullcontext
from time import perf_counter

import numpy as np

from ..deposit.crossings import Crossings
from ..errors import AtcError
from ..grids.planes import BY_FRAMES, by_frames
from .atom_pass import AtomFactors
from .bond_pass import BondFactors, PerAtom
from .reference import cells_moved, same_atoms
from .results import FrameResult
from .settings import Settings
from .summed import BOND, SITE, by_name
from .sums import Sums
from .work import Work

#: What is a flux, or a sum of the same kind.
KNOWN = ("stress", "stress_kinetic", "stress_potential", "momentum", "energy_flux")
_ROW = (
    "the row of the normal, and what flows along it, is what passes through the plane; other components are averages "
    "over the plane along the lines of bonds and paths, which have no bounds where these lie flat in it"
)
#: What they are called on planes, and what there is to say of them.
ABOUT = {
    "stress": ("stress through planes", _ROW),
    "stress_kinetic": (
        "kinetic part of the stress through planes",
        "momentum carried by atoms that pass, in the frame of the simulation; " + _ROW,
    ),
    "stress_potential": ("potential part of the stress through planes", _ROW),
    "momentum": ("flux of mass through planes", "mass of the atoms that pass; " + _ROW),
    "energy_flux": ("flux of energy through planes", _ROW),
}


def require_countable(work: Work, pot, grid) -> None:
    """Raise AtcError for fields that do not flow through planes."""
    for q in work.quantities:
        if q.kind == "grid" and q.name not in KNOWN:
            raise AtcError(
                f"{q.name}: is not known on planes, which see what passes through them: {', '.join(KNOWN)}; take a "
                "slab profile for it"
            )
    if pot is not None and pot.fields and work.bond:
        raise AtcError(
            f"{', '.join(work.bond_users)}: long-range forces (kspace_style) are those of a field of all charges, no "
            "bonds that cross a plane: take a slab profile, or ask for stress_kinetic"
        )


def counted_how(grid, pot, units) -> str:
    """Over which time passages of atoms are counted, in words."""
    asked = grid._["interval"]
    if by_frames(grid):
        return "from the frame before to this one"
    step = _timestep(pot)
    time = asked if asked is not None else None if step is None else units.to_user("time", step)
    back = "back along the velocities"
    return "not needed" if time is None else " ".join(f"{time:g} {units.label('time')} {back}".split())


def fields_on_planes(frame, settings: Settings) -> FrameResult:
    """The fields of a frame on planes: `settings` name nothing else, and the frame has what they need
    (`requirements`)."""
    start, work, units, pot = perf_counter(), settings.work, frame.units, settings.pot
    path = Path.of(frame, settings.grid, pot, work)
    bound, chosen = settings.grid.bind(units, frame.cell, frame.positions), settings.chosen(frame)
    bond, per_atom, notes = _bonds_through(bound, frame, settings, work, chosen) if work.bond_users else ({}, None, {})
    done = perf_counter()
    site = {}
    if path is not None:
        factors = AtomFactors(path.frame, np.zeros(3), per_atom, pot, chosen)
        a_nk = factors.columns(work.site)
        crossings = Crossings(bound, frame.cell, a_nk.shape[1])  # of what atoms that came by d carry
        crossings.add_paths(crossings.places(frame.positions), path.d_nc, a_nk)
        site = by_name(work.site, SITE, crossings.sums())
    sums = Sums(site=site, bond=bond, boltzmann=units.boltzmann, dimension=frame.dimension, velocities="none")
    arrays = {}
    for q in work.quantities:
        x = units.to_user(q.dimension, q.form(sums))
        arrays[q.name] = x.reshape(*bound.shape, *x.shape[1:])
    seconds = {"bonds": done - start, "sites": perf_counter() - done, "total": perf_counter() - start}
    exact = {q.name: {"error_max": 0.0, "error_l2": 0.0} for q in work.quantities}
    return FrameResult(
        arrays, errors=exact, expected=dict.fromkeys(arrays, 0.0), bound=bound, seconds=seconds, notes=notes
    )


def _bonds_through(bound, frame, settings: Settings, work: Work, chosen) -> tuple[dict, PerAtom, dict]:
    """What the bonds of a frame pull, and do work, through the planes: sums by name, the energies of atoms where asked
    for, and notes as of a `Decomposition`."""
    threads, anchor = settings.threads, settings.anchor
    factors = BondFactors(work.bond, frame, np.zeros(3))
    crossings = Crossings(bound, frame.cell, factors.width, threads)
    s_n3 = crossings.places(frame.positions)

    def consume(bonds, thread):
        if chosen is not None:
            bonds = chosen.taken(bonds)[1]
        if len(bonds):
            crossings.add_between(s_n3, bonds.i, bonds.j, bonds.r_bc, factors.of(bonds), thread)

    sources = {"sources": True} if work.source_users else {}
    with nullcontext() if anchor is None else anchor.at(frame):
        found = settings.pot.stream(
            frame, consume if work.bond else None, threads=threads, energies=bool(work.energy_users), forces=False,
            **sources,
        )  # fmt: skip
    sums = by_name(work.bond, BOND, crossings.sums()) if work.bond else {}
    return sums, PerAtom(found.energies_n if work.energy_users else None), dict(found.notes)


class Path:
    """How atoms went to where they are: back along their velocities for an interval, or from the frame before.

    frame : the frame, with their velocities on the path
    d_nc : (n, 3) from where they were
    """

    def __init__(self, frame, u_nc, interval: float):
        self.frame, self.d_nc = frame.replace(velocities=u_nc), u_nc * interval

    @classmethod
    def of(cls, frame, grid, pot, work: Work) -> Path | None:
        """None where nothing asked needs it."""
        if not work.site:
            return None
        asked = grid._["interval"]
        if asked == BY_FRAMES:
            d_nc, interval = _since(frame, pot)
            return cls(frame, d_nc / interval, interval)
        step = _timestep(pot)
        if asked is None and step is None:
            raise AtcError(
                "planes: over which time passages of atoms are counted is not known: give interval in [grid], e.g. the "
                'time step of the run, or "frames"'
            )
        interval = step if asked is None else frame.units.to_internal("time", asked)
        u_nc = frame.velocities
        if frame.forces is not None:
            # In the middle of the step that led here, as velocity Verlet has it.
            m_n1 = frame.masses[:, None]
            u_nc = u_nc - 0.5 * interval * np.divide(frame.forces, m_n1, out=np.zeros_like(u_nc), where=m_n1 > 0)
        return cls(frame, u_nc, interval)


def _timestep(pot) -> float | None:
    """Of the run, where a script says it (internal)."""
    return pot.timestep if pot is not None and pot.terms else None


def _since(frame, pot) -> tuple[np.ndarray, float]:
    """How far atoms have moved since the frame before, (n, 3) through the faces of the cell too, and how long that
    took."""
    before = frame.before
    if before is None:
        raise AtcError(f'{frame.source}: interval = "frames": the frame before is not known: compute a trajectory')
    same_atoms(frame, before)
    if frame.cell != before.cell:
        raise AtcError(
            f'{frame.source}: the cell is not that of the frame before: interval = "frames" needs one that stays; give '
            "a time, which counts by velocities"
        )
    if frame.time is not None and before.time is not None:
        interval = frame.time - before.time
    elif frame.step is not None and before.step is not None and (step := _timestep(pot)) is not None:
        interval = (frame.step - before.step) * step
    else:
        raise AtcError(f"{frame.source}: the time since the frame before is not known: give timestep in [trajectory]")
    if not interval > 0:
        raise AtcError(f"{frame.source}: no time has passed since the frame before: take each moment once")
    moved = cells_moved(frame, before) @ frame.cell.vectors
    return frame.positions - before.positions - moved, float(interval)
