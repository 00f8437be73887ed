"""What flows through planes: momentum (the stress) and energy, by the bonds that cross them and the atoms that pass.

    σ_nj(plane) = Σ_bonds crossing sgn(r_n) G r_j / A − Σ_atoms passing sgn(u_n) m u_j / (A Δt)

u is an atom's velocity on its path over the interval Δt. The row of the normal, and what flows along it, is all that
passes through the plane: between two planes momentum changes by the difference of theirs and by forces from outside, in
every frame. Other rows are the same sums of G r_i r_j/|r_n|: plane averages over the bonds' lines (Irving & Kirkwood).

Source: Todd, Evans & Daivis, Phys. Rev. E 52 (1995) 1627; Irving & Kirkwood, J. Chem. Phys. 18 (1950) 817.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from time import perf_counter

import numpy as np

from ..deposit.crossings import Crossings
from ..errors import AtcError
from .chosen import chosen_of
from .registry import BOND, SITE, Work
from .requirements import require
from .settings import FrameResult, Settings
from .sources import AtomFactors, PerAtom, bond_factors, cells_moved, same_atoms
from .sums import Sums

#: What is a flux, or a sum of the same kind.
KNOWN = ("stress", "stress_kinetic", "stress_potential", "momentum", "energy_flux")
BY_FRAMES = "frames"
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
    if asked == BY_FRAMES:
        return "from the frame before to this one"
    step = _timestep(pot)
    time = asked if asked is not None else None if step is None else units.to_user("time", step)
    back = "back along the velocities"
    return "not needed" if time is None else " ".join(f"{time:g} {units.label('time')} {back}".split())


def unneeded(work: Work, grid) -> tuple[str, ...]:
    """Attributes of frames that the quantities need elsewhere: velocities, where atoms are seen to move."""
    return ("velocities",) if grid._["interval"] == BY_FRAMES and "power_lab" not in work.bond else ()


def of_frame(frames, settings: Settings, index: int, fields_of) -> FrameResult:
    """The fields of a frame on planes; everything else asked by `fields_of` (`driver.fields_of`)."""
    (frame,) = frames
    more = {"velocity": "none", "churnless": settings.churnless, "kernel": False}
    work = Work.of(settings.names, settings.central, **more)
    own = tuple(q.name for q in work.quantities if q.kind == "grid")
    others = tuple(q.name for q in work.quantities if q.kind != "grid")
    result = _fields(frame, replace(settings, names=own), Work.of(own, settings.central, **more))
    if not others:
        return result
    beside = fields_of(frames, replace(settings, names=others, grid=None), index)
    return replace(
        beside,
        arrays={name: {**result.arrays, **beside.arrays}[name] for name in settings.names},
        errors={**beside.errors, **result.errors},
        expected={**beside.expected, **result.expected},
        bound=result.bound,
        seconds={key: result.seconds.get(key, 0.0) + s for key, s in beside.seconds.items()},
    )


def _fields(frame, settings: Settings, work: Work) -> FrameResult:
    start = perf_counter()
    grid, units = settings.grid, frame.units
    path = Path.of(frame, settings, work)
    require(frame if path is None else path.frame, settings, work)
    if "power_lab" in work.bond:
        frame.require("velocities", why="energy_flux")
    bound = grid.bind(units, frame.cell, frame.positions)
    chosen = chosen_of(frame, settings)
    bonds = _Bonds(frame, settings, work, bound, chosen)
    done = perf_counter()
    site = {}
    if path is not None:
        factors = AtomFactors(path.frame, np.zeros(3), bonds.per_atom, settings.pot, chosen)
        a_nk = factors.columns(work.site)
        crossings = Crossings(bound, frame.cell, a_nk.shape[1])
        crossings.add_paths(crossings.places(frame.positions), path.d_nc, a_nk)
        site = _by_name(work.site, SITE, crossings.sums())
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


def _by_name(names, sources, total_gk) -> dict:
    ends = np.cumsum([sources[name].width for name in names])
    return dict(zip(names, np.split(total_gk, ends[:-1], axis=1), strict=True))


class _Bonds:
    """What the bonds of a frame pull, and do work, through the planes.

    sums : by name. per_atom : energies, where asked for. notes : as of a `Decomposition`
    """

    def __init__(self, frame, settings: Settings, work: Work, bound, chosen):
        self.sums, self.per_atom, self.notes = {}, PerAtom(), {}
        if not work.bond_users:
            return
        widths = [BOND[name].width for name in work.bond]
        crossings = Crossings(bound, frame.cell, sum(widths), settings.threads)
        s_n3 = crossings.places(frame.positions)

        def consume(bonds, thread):
            if chosen is not None:
                bonds = chosen.taken(bonds)[1]
            if len(bonds):
                b_bk = bond_factors(work.bond, widths, bonds, frame.velocities, frame.velocities)
                crossings.add_between(s_n3, bonds.i, bonds.j, bonds.r_bc, b_bk, thread)

        sources = {"sources": True} if work.source_users else {}
        with nullcontext() if settings.anchor is None else settings.anchor.at(frame):
            found = settings.pot.stream(
                frame, consume if work.bond else None, threads=settings.threads, energies=bool(work.energy_users),
                forces=False, **sources,
            )  # fmt: skip
        if work.energy_users:
            self.per_atom = PerAtom(energies_n=found.energies_n)
        self.notes = dict(getattr(found, "notes", None) or {})
        if work.bond:
            self.sums = _by_name(work.bond, BOND, crossings.sums())


class Path:
    """How atoms went to where they are: back along their velocities for an interval, or from the frame before.

    frame : the frame, with their velocities on the path
    d_nc : (n, 3) from where they were
    """

    def __init__(self, frame, u_nc, interval: float):
        self.frame, self.d_nc = frame.replace(velocities=u_nc), u_nc * interval

    @classmethod
    def of(cls, frame, settings: Settings, work: Work) -> Path | None:
        """None where nothing asked needs it."""
        if not work.site:
            return None
        asked = settings.grid._["interval"]
        if asked == BY_FRAMES:
            d_nc, interval = _since(frame, settings.pot)
            return cls(frame, d_nc / interval, interval)
        frame.require("velocities", "masses", why=", ".join(q.name for q in work.quantities if q.site))
        step = _timestep(settings.pot)
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
