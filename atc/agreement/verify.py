"""Is this the potential of the run? Energies, forces and virial stress of a potential beside those of the trajectory or
of an ASE calculator."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from ..errors import AtcError


@dataclass
class FrameComparison:
    """One frame, in the user's units. The other side is the trajectory's own forces, or a calculator's; None where it
    has no such number.

    energy, energy_other : potential energies. force_max : largest |F| of the other side; force_error, force_rms :
        largest difference of a force, and its root mean square. stress_error : largest difference of a component of the
        virial stress (potential part); stress_max : its largest component.
    agrees : whether the digits of the trajectory explain the differences of its own forces (None for a calculator);
        looks : what they look like where not; because : what explains them where so.
    """

    frame: int
    energy: float
    energy_other: float | None
    force_max: float | None
    force_error: float | None
    force_rms: float | None
    worst_atom: int | None
    stress_max: float | None = None
    stress_error: float | None = None
    agrees: bool | None = None
    looks: str = ""
    because: str = "the file's digits"


@dataclass
class Verification:
    """What `verify` found. `force_error` is the largest difference of a force over all frames, relative to the largest
    force of its frame."""

    against: str
    units: dict
    frames: list[FrameComparison] = field(default_factory=list)

    @property
    def force_error(self) -> float:
        return self._largest("force")

    @property
    def stress_error(self) -> float:
        return self._largest("stress")

    def _largest(self, kind: str) -> float:
        pairs = [(getattr(f, f"{kind}_error"), getattr(f, f"{kind}_max")) for f in self.frames]
        return max((_ratio(*pair) for pair in pairs if pair[0] is not None), default=float("nan"))

    @property
    def energy_error(self) -> float:
        """Largest difference of the energies' changes between frames, over the largest change: a constant offset does
        not count. NaN for one frame."""
        pairs = np.array([(f.energy, f.energy_other) for f in self.frames if f.energy_other is not None])
        if len(pairs) < 2:
            return float("nan")
        change = pairs - pairs[0]
        return _ratio(float(np.abs(change[:, 0] - change[:, 1]).max()), float(np.abs(change[:, 1]).max()))

    def json(self) -> str:
        return json.dumps(
            {"against": self.against, "units": self.units, "frames": [asdict(f) for f in self.frames]}, indent=2
        )

    def __str__(self):
        e, f, p = (self.units[k] for k in ("energy", "force", "stress"))
        lines = [f"against {self.against}"]
        for c in self.frames:
            line = f"frame {c.frame}: energy {c.energy:.10g} {e}"
            if c.energy_other is not None:
                line += f" against {c.energy_other:.10g}"
            if c.force_error is not None:
                line += (
                    f"; forces differ by up to {c.force_error:.3g} of {c.force_max:.3g} {f} "
                    f"({_ratio(c.force_error, c.force_max):.1e}, atom {c.worst_atom})"
                )
            if c.stress_error is not None:
                line += f"; virial stress by {c.stress_error:.3g} of {c.stress_max:.3g} {p}"
            if c.agrees is not None:
                looks = f": it looks like {c.looks}" if c.looks else ""
                line += f", explained by {c.because}" if c.agrees else f", more than the file's digits explain{looks}"
            lines.append(line)
        return "\n".join(lines)


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else 0.0 if a == 0 else float("inf")


def to_atoms(frame, symbols=None):
    """A frame as `ase.Atoms`: Å, amu, the cell's corner at 0.

    Parameters
    ----------
    frame : Frame
    symbols : {type: chemical symbol} or a list for types 1, 2, ...; default: the frame's own type names, where they are
        symbols
    """
    try:
        from ase import Atoms
        from ase.data import chemical_symbols
    except ImportError:
        raise AtcError("an ASE calculator needs ASE: pip install ase") from None
    if frame.units.reduced:
        raise AtcError(f"{frame.source}: reduced (lj) units have no lengths in angstrom for ASE")
    if symbols is None:
        names = frame.type_names
    else:
        names = dict(symbols) if isinstance(symbols, Mapping) else dict(enumerate(symbols, 1))
    types = np.unique(frame.types).tolist()
    odd = next((t for t in types if names.get(t) not in chemical_symbols[1:]), None)
    if odd is not None:
        raise AtcError(
            f"{frame.source}: ASE needs the chemical symbol of type {odd}: give symbols={{{odd}: 'Ar'}} (or whatever "
            "it is)"
        )
    atoms = Atoms(
        [names[t] for t in frame.types.tolist()],
        positions=frame.positions - frame.cell.origin,
        cell=frame.cell.vectors,
        pbc=frame.cell.periodic,
        masses=frame.masses,
    )
    if frame.velocities is not None:
        atoms.set_velocities(frame.velocities)
    return atoms


def verify(traj, pot, calculator=None, *, symbols=None, threads: int = 1) -> Verification:
    """Energies, forces and virial stress of a potential, frame by frame, beside independent ones.

    Parameters
    ----------
    traj : trajectory, Frame, or anything `atc.read` takes; a slice of it (``traj[::100]``) is usually enough
    pot : potential from `atc.potential`
    calculator : ASE calculator; None: the forces that the trajectory itself holds
    symbols : {type: chemical symbol}, for trajectories that do not know their species
    threads : threads within a frame

    Returns
    -------
    Verification, numbers in the trajectory's units. Stress: the potential part, tension positive.

    Raises
    ------
    AtcError
        without calculator, where the trajectory has no forces; where the calculator fails.
    """
    from ..planning.job import as_frames
    from ..readers.planar import matched

    if not hasattr(pot, "stream"):
        raise AtcError(f"pot is a {type(pot).__name__}: expected what atc.potential('pair_style ...') gives")
    frames, pot = matched(as_frames(traj, pot), pot)
    if not len(frames):
        raise AtcError("the trajectory has no frames: nothing to verify")
    pot = pot.held_by_topology(frames[0])
    u = frames[0].units
    against = "the trajectory's own forces" if calculator is None else f"the ASE calculator {type(calculator).__name__}"
    out = Verification(against, {"energy": u.label("energy"), "force": u.label("force"), "stress": u.label("pressure")})
    for k, frame in enumerate(frames):
        if calculator is None:
            out.frames.append(_of_trajectory(frame, pot, k, frames, u, threads))
            continue
        mine = pot.stream(frame, None, threads=threads, forces=True)
        energy, forces, stress = _of_calculator(calculator, frame, symbols)
        difference = np.linalg.norm(mine.forces_nc - forces, axis=1)
        worst = int(difference.argmax()) if len(frame) else None
        c = FrameComparison(
            k,
            u.to_user("energy", mine.energy),
            u.to_user("energy", energy),
            u.to_user("force", float(np.linalg.norm(forces, axis=1).max(initial=0.0))),
            u.to_user("force", float(difference.max(initial=0.0))),
            u.to_user("force", float(np.sqrt((difference**2).mean()))) if len(frame) else 0.0,
            None if worst is None else int(frame.ids[worst]),
        )
        if stress is not None and frame.cell.periodic[: frame.dimension].all():
            c.stress_max = u.to_user("pressure", float(np.abs(stress).max()))
            c.stress_error = u.to_user("pressure", float(np.abs(mine.virial_cc / frame.cell.volume - stress).max()))
        out.frames.append(c)
    return out


def _of_trajectory(frame, pot, k, frames, u, threads) -> FrameComparison:
    from ..readers.trajectory import resolution_of
    from .forces import compare_forces

    frame.require("forces", why="a comparison without calculator")
    c = compare_forces(frame, pot, k, resolution=resolution_of(frames, frame), threads=threads)
    force = (u.to_user("force", f) for f in (c.largest_force, c.largest, c.rms_difference))
    worst = c.worst[0] if c.worst else None
    return FrameComparison(
        k, u.to_user("energy", c.energy), None, *force, worst, agrees=c.agrees, looks=c.looks, because=c.because
    )


def _of_calculator(calculator, frame, symbols):
    """Energy, forces and stress (3, 3) or None. ASE's units are the internal ones: eV, Å, amu."""
    atoms = to_atoms(frame, symbols)
    atoms.calc = calculator
    try:
        energy, forces = float(atoms.get_potential_energy()), np.array(atoms.get_forces())
    except Exception as e:
        raise AtcError(
            f"{frame.source}: the ASE calculator {type(calculator).__name__} failed: "
            f"{' '.join(str(e).split()) or type(e).__name__}"
        ) from e
    try:
        stress = atoms.get_stress(voigt=False)
    except Exception:  # many calculators have none, and each says so in its own way
        stress = None
    return energy, forces, stress
