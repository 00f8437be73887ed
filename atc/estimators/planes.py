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
from .reference import cells_moved, same_atoms
from .results import FrameResult
from .sources import AtomFactors, BondFactors, PerAtom
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


def of_frame(frame, grid, names, pot, chosen, threads: int, anchor=None) -> FrameResult:
    """The fields of a frame on planes.

    Parameters
    ----------
    frame : Frame, which has what they need (`requirements`)
    grid : the planes
    names : of quantities, of `KNOWN`
    pot : potential, or None
    chosen : `chosen.Chosen`, or None
    anchor : a list of neighbours kept for many frames, or None
    """
    start, work, units = perf_counter(), Work.on(grid, names, pot), frame.units
    path = Path.of(frame, grid, pot, work)
    bound = grid.bind(units, frame.cell, frame.positions)
    bonds = _Bonds(frame, pot, work, bound, chosen, threads, anchor)
    done = perf_counter()
    site = {}
    if path is not None:
        factors = AtomFactors(path.frame, np.zeros(3), bonds.per_atom, pot, chosen)
        site = by_name(work.site, SITE, paths_through(bound, frame, path.d_nc, factors.columns(work.site)))
    sums = Sums(
        site=site, bond=bonds.sums, boltzmann=units.boltzmann, dimension=frame.dimension, velocities="none"
    )  # fmt: skip
    arrays = {}
    for q in work.quantities:
        x = units.to_user(q.dimension, q.form(sums))
        arrays[q.name] = x.reshape(*bound.shape, *x.shape[1:])
    seconds = {"bonds": done - start, "sites": perf_counter() - done, "total": perf_counter() - start}
    exact = {q.name: {"error_max": 0.0, "error_l2": 0.0} for q in work.quantities}
    return FrameResult(
        arrays, errors=exact, expected=dict.fromkeys(arrays, 0.0), bound=bound, seconds=seconds, notes=bonds.notes
    )


def paths_through(bound, frame, d_nc, a_nk) -> np.ndarray:
    """(g, k) what atoms that came by d carry through the planes."""
    crossings = Crossings(bound, frame.cell, a_nk.shape[1])
    crossings.add_paths(crossings.places(frame.positions), d_nc, a_nk)
    return crossings.sums()


class _Bonds:
    """What the bonds of a frame pull, and do work, through the planes.

    sums : by name. per_atom : energies, where asked for. notes : as of a `Decomposition`
    """

    def __init__(self, frame, pot, work: Work, bound, chosen, threads: int, anchor):
        self.sums, self.per_atom, self.notes = {}, PerAtom(), {}
        if not work.bond_users:
            return
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
            found = pot.stream(
                frame, consume if work.bond else None, threads=threads, energies=bool(work.energy_users),
                forces=False, **sources,
            )  # fmt: skip
        if work.energy_users:
            self.per_atom = PerAtom(energies_n=found.energies_n)
        self.notes = dict(getattr(found, "notes", None) or {})
        if work.bond:
            self.sums = by_name(work.bond, BOND, crossings.sums())


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
