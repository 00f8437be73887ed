"""Whether a trajectory, and the log file beside it, agree with the potential of a scene: the alarm of `atc info`, `atc
plan` and `atc fields`, and `atc verify`."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, field

from ..errors import AtcError, AtcWarning
from ..readers.trajectory import Trajectory, resolution_of
from .forces import MODES, SEVERAL, ForceCheck, compare_forces, follows_from
from .thermo import ThermoCheck, compare_thermo

#: How many frames are looked at for one whose step is in the log.
_LOOK = 10


@dataclass
class FrameCheck:
    """What was compared on one frame; None where there was nothing to compare."""

    frame: int
    step: int | None
    forces: ForceCheck | None = None
    thermo: ThermoCheck | None = None
    energy: float = float("nan")

    @property
    def agrees(self) -> bool | None:
        found = [c.agrees for c in (self.forces, self.thermo) if c is not None]
        return all(found) if found else None


@dataclass
class RunCheck:
    """Whether model and run agree, by frames. `why` says why nothing could be compared, `notes` what could not."""

    frames: list[FrameCheck] = field(default_factory=list)
    why: str = ""
    notes: list[str] = field(default_factory=list)
    units: object = None

    @property
    def agrees(self) -> bool | None:
        """True, False, or None: not known."""
        found = [c.agrees for c in self.frames if c.agrees is not None]
        return all(found) if found else None

    @property
    def text(self) -> str:
        """For the attribute `agrees_with_run`."""
        parts = [str(c) for f in self.frames for c in (f.forces, f.thermo) if c is not None]
        if not parts:
            return f"not known: {self.why}"
        wrong = [p for p in parts if p.startswith("no:")]
        return "; ".join((wrong or parts) + ([] if wrong else self.notes))

    @property
    def complaints(self) -> list[str]:
        """One sentence for each frame's forces or log that differ; of the same kind only the first."""
        out = []
        for kind in ("forces", "thermo"):
            bad = [c for f in self.frames if (c := getattr(f, kind)) is not None and not c.agrees]
            if bad:
                out.append(str(bad[0])[len("no: ") :])
        return out

    def json(self) -> str:
        frames = [_plain(f, self.units) for f in self.frames]
        out = {"agrees": self.agrees, "agrees_with_run": self.text, "notes": self.notes, "frames": frames}
        return json.dumps(out, indent=2)

    def print(self, console) -> None:
        """Model and run side by side, frame by frame."""
        for f in self.frames:
            console.print(f"frame {f.frame}" + ("" if f.step is None else f", step {f.step}"), soft_wrap=True)
            rows = [("", "model", "run", "difference", "digits explain", "")]
            lines = [] if f.thermo is None else f.thermo.lines
            if not any(x.name == "energy" for x in lines):
                energy = _g(self.units.to_user("energy", f.energy))
                rows.append((f"energy ({self.units.label('energy')})", energy, "-", "", "", ""))
            for x in lines:
                sign = "yes" if x.agrees else "no" if x.counts else "(no)"
                name = f"{x.name} ({x.units})" if x.units else x.name
                rows.append((name, _g(x.model), _g(x.run), f"{x.difference:.3g}", f"{x.allowed:.2g}", sign))
            if f.forces is not None:
                c = f.forces
                rms = self.units.to_user("force", c.rms)
                share = self.units.to_user("force", c.rms_difference)
                sign, name = "yes" if c.agrees else "no", f"forces, rms ({self.units.label('force')})"
                rows.append((name, "", f"{rms:.6g}", f"{share:.3g}", f"{c.explained * rms:.2g}", sign))
            widths = [max(len(r[k]) for r in rows) for k in range(6)]
            for r in rows:
                row = "  " + r[0].ljust(widths[0]) + "".join("  " + r[k].rjust(widths[k]) for k in range(1, 6))
                console.print(row.rstrip(), soft_wrap=True)
            if f.forces is not None and f.forces.coulomb is not None:
                text = f.forces.coulomb.describe(self.units)
                console.print(f"  note: explained are digits and {text}", soft_wrap=True)
            for c in (f.forces, f.thermo):
                if c is not None and not c.agrees:
                    console.print(f"  {c}", soft_wrap=True)
                elif isinstance(c, ThermoCheck):
                    for note in c.notes:
                        console.print(f"  note: {note}", soft_wrap=True)
        for note in self.notes:
            console.print(f"note: {note}", soft_wrap=True)
        words = {True: "model and run agree", False: "model and run do NOT agree", None: f"not known: {self.why}"}
        console.print(words[self.agrees], soft_wrap=True)


def _g(x) -> str:
    return f"{x:.10g}"


def _plain(f: FrameCheck, units) -> dict:
    out = {
        "frame": f.frame, "step": f.step, "agrees": f.agrees, "energy": units.to_user("energy", f.energy),
        "energy_units": units.label("energy"),
    }  # fmt: skip
    if f.forces is not None:
        c = f.forces
        out["forces"] = {
            "agrees": c.agrees, "rms_share": c.share, "explained_share": c.explained,
            "rms": units.to_user("force", c.rms), "units": units.label("force"), "atoms": c.atoms,
            "atoms_differ": c.differ, "worst_atoms": list(c.worst), "looks_like": c.looks, "explained_by": c.because,
            "outside": list(c.outside),
        }  # fmt: skip
    if f.thermo is not None:
        out["log"] = {
            "agrees": f.thermo.agrees, "source": f.thermo.source, "numbers": [x.plain() for x in f.thermo.lines],
            "notes": f.thermo.notes, "causes": list(f.thermo.causes),
        }  # fmt: skip
    return out


def read_log(log, units):
    """A `LammpsLog` from a path, a list of paths or None."""
    from ..readers.lammps.log import LammpsLog

    if log is None or isinstance(log, LammpsLog):
        return log
    found = LammpsLog(log, units)
    if found.units.reduced != units.reduced:
        raise AtcError(
            f"{found.source}: is in {found.units.name!r} units, the trajectory in {units.name!r}: it is not the log "
            "of this run"
        )
    return found


def examine(frames, pot, *, which=None, log=None, threads: int = 1, first=None, forces: bool = True) -> RunCheck:
    """Compare frames of a trajectory with a potential.

    Parameters
    ----------
    frames : trajectory or list of Frames
    pot : Potential
    which : numbers of the frames to look at; default: the first, and one from the middle of `SEVERAL` and more
    log : path of a LAMMPS log file, a list of them, or `LammpsLog`
    first : the first frame, where it has been read already
    forces : whether to look at the trajectory's forces

    Raises
    ------
    AtcError for a log that cannot be read, and what the potential refuses.
    """
    total = len(frames)
    if which is None:
        which = [0] + [total // 2] * (total >= SEVERAL)
    first = frames[0] if first is None else first
    out = RunCheck(units=first.units)
    log = read_log(log, first.units)
    if log is not None:
        out.notes += [f"{log.name}: {note}" for note in log.notes]
    looked: dict[int, FrameCheck] = {}

    def look(k, forces):
        frame = first if k == 0 else frames[k]
        resolution = resolution_of(frames, frame)
        check = looked[k] = FrameCheck(k, frame.step)
        if forces and frame.forces is not None:
            check.forces = compare_forces(frame, pot, k, resolution=resolution, threads=threads)
            check.energy = check.forces.energy
        if log is not None:
            how = {"resolution": resolution, "threads": threads}
            check.thermo = compare_thermo(frame, pot, log, k, known=check.forces, **how)
            if check.thermo is not None:
                check.energy = check.thermo.energy
        if check.agrees is not None:
            out.frames.append(check)
        return check.thermo is not None

    given = sorted(set(which))
    seen_log = [look(k, forces) for k in given]
    if log is not None and not any(seen_log):
        # logs are often written less often than dumps
        if not any(look(k, False) for k in range(min(total, _LOOK)) if k not in looked):
            steps = log.steps
            out.notes.append(
                f"the log {log.name} has none of the steps of the frames that were looked at (frame {given[0]}: step "
                f"{looked[given[0]].step}; log: steps {steps[0]} to {steps[-1]})"
            )
    seen_forces, seen_log = (any(getattr(f, kind) is not None for f in out.frames) for kind in ("forces", "thermo"))
    reasons = []
    if not forces:
        reasons.append("the forces of the trajectory were ignored")
    elif not seen_forces:
        reasons.append("the trajectory has no forces")
    if log is not None and not seen_log:
        reasons.append("no step is in both trajectory and log")
    out.why = " and ".join(reasons)
    if reasons and seen_log and not seen_forces:
        out.notes.append(reasons[0])
    return out


def alarm(
    frames, pot, *, mode: str = "warn", log=None, threads: int = 1, first=None, needed: bool = True, what: str = ""
) -> RunCheck:
    """`examine` as `atc.fields` uses it: complaints are warnings, or an error where forces ``must agree``.

    needed : whether anything that is computed depends on the potential
    """
    if mode not in MODES:
        raise AtcError(f"forces={mode!r}: expected one of {', '.join(map(repr, MODES))}")
    if not needed:
        return RunCheck(why="nothing that was asked for depends on the potential")
    if not follows_from(pot):
        return RunCheck(why="the forces do not come from a potential between atoms")
    if mode == "ignore" and log is None:
        return RunCheck(why='the forces of the trajectory were ignored (forces = "ignore")')
    found = examine(frames, pot, log=log, threads=threads, first=first, forces=mode != "ignore")
    source = what or (frames.source if isinstance(frames, Trajectory) else "")
    if mode == "must agree" and found.agrees is not True:
        words = "; ".join(found.complaints) or found.text
        raise AtcError(f'{source + ": " if source else ""}forces = "must agree", but {words}')
    for sentence in found.complaints:
        text = f"{source + ': ' if source else ''}the run does not agree with the potential: {sentence}"
        warnings.warn(text, AtcWarning, stacklevel=3)
    return found


def verify_scene(scene, frames: str | None = None, threads: int = 1) -> RunCheck:
    """Model and run of a scene on the frames that a text such as ``0,10,-1``, ``0:100:20`` or ``all`` names; default:
    the first, the middle and the last.

    Raises `AtcError` where there is nothing to compare: neither forces in the trajectory nor a log file.
    """
    pot = scene.potential()
    if pot is None:
        give = 'give lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file"'
        raise scene.need("potential", f"there is nothing to verify: {give}")
    traj, log = scene.trajectory(), scene.log()
    which = _selected(frames, len(traj))
    first = traj[0]
    pot.check_topology(first)
    found = examine(traj, pot, which=which, log=log, threads=threads, first=first)
    if found.agrees is None:
        dump = "dump fx fy fz too" if "no forces" in found.why else ""
        beside = 'name its log file: log = "log.lammps" in [trajectory]'
        if log is not None:
            beside = "choose frames whose steps are in the log"
        raise AtcError(
            f"{scene.name}: nothing to compare with: {'; '.join([found.why, *found.notes])}: "
            f"{' or '.join(x for x in (dump, beside) if x)}"
        )
    return found


def _selected(text: str | None, total: int) -> list[int]:
    from ..config.words import frame_slice

    if text is None:
        return sorted({0, total // 2, total - 1})
    if text.strip() == "all":
        return list(range(total))
    out = []
    try:
        for part in text.split(","):
            out += range(total)[frame_slice(part.strip())]
    except (ValueError, TypeError):
        raise AtcError(
            f"--frames {text}: expected numbers of frames such as 0,10,-1, a slice such as 0:100:20, or all"
        ) from None
    if not out:
        raise AtcError(f"--frames {text}: selects none of {total} frames, numbered from 0")
    return sorted(set(out))
