"""Energy, pressure tensor and temperature of a model beside those that a LAMMPS log file has for the same step.

P = (Σ m v⊗v − Σ G r⊗r)/V with the velocities as they are, as LAMMPS does; T = Σ m v²/(f k_B) with f = 3N − 3 degrees of
freedom (2N − 2 in the plane) less those that constraints take.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .forces import CANCELLATION, ROUNDING
from .real_space import coulomb_doubt

#: Moved copies of a frame that say how far energy and virial are in doubt, and how many times their largest change is
#: allowed.
COPIES, BEYOND = 2, 3.0
_TENSOR = {"pxx": (0, 0), "pyy": (1, 1), "pzz": (2, 2), "pxy": (0, 1), "pxz": (0, 2), "pyz": (1, 2)}


@dataclass
class Line:
    """One number of model and run, in the units of the log. allowed : what digits explain of a difference. counts :
    whether it decides."""

    name: str
    units: str
    model: float
    run: float
    allowed: float
    counts: bool = True

    @property
    def difference(self) -> float:
        return self.model - self.run

    @property
    def agrees(self) -> bool:
        return abs(self.difference) <= self.allowed  # NaN does not

    def plain(self) -> dict:
        said = {key: getattr(self, key) for key in ("name", "units", "model", "run", "difference")}
        return {**said, "explained_by_digits": self.allowed, "agrees": bool(self.agrees)}


@dataclass
class ThermoCheck:
    """A step of the log beside a frame. lines : the numbers. notes : what is to be known of them. causes : what else
    the run's numbers contain.
    energy : of the potential (internal)."""

    frame: int
    step: int
    source: str
    lines: list[Line] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    causes: tuple[str, ...] = ()
    energy: float = float("nan")

    @property
    def wrong(self) -> list[Line]:
        return [x for x in self.lines if x.counts and not x.agrees]

    @property
    def agrees(self) -> bool:
        return not self.wrong

    def line(self, name: str) -> Line | None:
        return next((x for x in self.lines if x.name == name), None)

    def __str__(self):
        pressure = self.line("pressure") or self.line("pressure xx")
        what = "energy and pressure" if pressure else "energy" if self.line("energy") else "state"
        where = f"of frame {self.frame} (step {self.step} of {self.source})"
        if self.agrees:
            return f"{what} {where}: yes, to the digits of the log"
        text = f"no: {where[3:]}: " + ", ".join(
            f"{x.name} {x.model:.8g} here, {x.run:.8g} in the run ({x.units})" for x in self.wrong[:3]
        )
        return text + "".join(f"; {n}" for n in self.notes)


def compare_thermo(
    frame, pot, log, number: int = 0, *, known=None, resolution: float = 0.0, threads: int = 1
) -> ThermoCheck | None:
    """A frame beside what the log says of its step; None where it says nothing.

    Parameters
    ----------
    frame : Frame with a step
    pot : Potential
    log : LammpsLog
    number : what to call the frame
    known : ForceCheck of this frame, whose energy and virial need not be computed again
    resolution : step of the last digit of the positions (internal length)
    """
    rows = log.at(frame.step) if frame.step is not None else []
    if not rows:
        return None
    if known is not None:
        energy, virial = known.energy, known.virial_cc
    else:
        d = pot.stream(frame, None, threads=threads)
        energy, virial = d.energy, d.virial_cc
    coulomb = known.coulomb if known is not None else coulomb_doubt(pot.complete(frame), pot, threads)
    base = (0.0, np.zeros((3, 3))) if coulomb is None else (coulomb.energy, coulomb.virial_cc)
    doubt = None
    best = None
    for row in rows:
        check = _compare(frame, pot, log, row, number, energy, virial, base)
        if not check.agrees:
            if doubt is None:
                e, w = _doubt(frame, pot, energy, virial, resolution, threads)
                doubt = base[0] + e, base[1] + w
            check = _compare(frame, pot, log, row, number, energy, virial, doubt)
        if best is None or len(check.wrong) < len(best.wrong):
            best = check
        if check.agrees:
            break
    if coulomb is not None and known is None:
        best.notes.append(f"explained are digits and {coulomb.describe(log.units)}")
    if best.wrong:
        best.notes += _explanations(frame, best, known)
    return best


def _doubt(frame, pot, energy, virial, dx, threads):
    """How far energy and virial move when atoms move by what rounding hides."""
    rng = np.random.default_rng(13)
    e, w = 0.0, np.zeros((3, 3))
    for _ in range(COPIES):
        moved = frame.positions + rng.uniform(-0.5, 0.5, frame.positions.shape) * dx
        d = pot.stream(frame.replace(positions=moved), None, threads=threads)
        e, w = max(e, abs(d.energy - energy)), np.maximum(w, np.abs(d.virial_cc - virial))
    return BEYOND * e, BEYOND * np.maximum(w, w.max())


def _compare(frame, pot, log, row, number, energy, virial, doubt) -> ThermoCheck:
    n, dimension = len(frame), frame.dimension
    u = frame.units if frame.units.name == log.units.name else log.units
    out = ThermoCheck(number, row.step, log.name, causes=row.causes, energy=energy)
    have, last = row.values, row.digits
    per = n if row.normalised else 1
    of_temperature = any(cause.startswith("temperature of") for cause in row.causes)
    of_pressure = any(cause.startswith("pressure of") for cause in row.causes)

    def add(name, dimension, model, said, doubt=0.0, scale=0.0, counts=True, times=1):
        value, digit = (have[said], last[said]) if isinstance(said, str) else said
        factor = u.factor(dimension)
        allowed = 0.5 * digit * 1.001 + (doubt + ROUNDING * scale) / factor / times
        model = float(model) / factor / times
        out.lines.append(Line(name, u.label(dimension), model, float(value), float(allowed), counts))

    run = _potential_energy(have, last)
    if run is not None:
        *said, what = run
        scale = abs(energy) + 1e-4 * CANCELLATION / ROUNDING * n
        add("energy", "energy", energy, said, doubt[0], scale, times=per)
        if what:
            out.notes.append(what)
        if per > 1:
            out.notes.append(
                "energies in the log are per atom"
                + (", LAMMPS's default in lj units (its thermo_modify is not in the log)" if log.assumed_norm else "")
            )
    kinetic, source = None, ""
    if frame.velocities is not None and frame.masses is not None:
        v, m = frame.velocities, frame.masses
        kinetic = np.einsum("n,nc,nd->cd", m, v, v)
        from .forces import printed_error

        dv = printed_error(v, u.velocity) if n else np.zeros(0)
        speed = np.sqrt((v * v).sum(1))
        k_doubt = float(3.0 * np.sqrt(((m * speed * dv) ** 2).sum())) if n else 0.0
        total = float(np.trace(kinetic))
        free = dimension * (n - 1) - _held(frame, pot)
        if "kinetic" in have:
            half = 0.5 * total
            add("kinetic energy", "energy", half, "kinetic", k_doubt, half, counts=not of_temperature, times=per)
        if "temperature" in have and free > 0:
            k_B, counts = frame.units.boltzmann, "kinetic" not in have and not of_temperature
            T = total / (free * k_B)
            add("temperature", "temperature", T, "temperature", 2 * k_doubt / (free * k_B), T, counts=counts)
            _degrees_of_freedom(out, total, k_B, free, have["temperature"])
    elif "temperature" in have and n > 1:
        per_kelvin = (dimension * (n - 1) - _held(frame, pot)) * frame.units.boltzmann
        total = per_kelvin * have["temperature"]
        source = (
            "the kinetic part of its pressure is that of the log's temperature, since the frame has no velocities or "
            "no masses"
        )
        k_doubt = per_kelvin * last["temperature"]
    else:
        total = None
    V = frame.cell.volume
    if total is not None and V > 0:
        part = total if kinetic is None else float(np.trace(kinetic))
        p = (part - float(np.trace(virial))) / (dimension * V)
        size = (abs(part) + float(np.abs(np.diag(virial)).sum())) / (dimension * V)
        if "pressure" in have:
            unsure = (float(np.trace(doubt[1])) + 2 * k_doubt) / (dimension * V)
            add("pressure", "pressure", p, "pressure", unsure, size, not of_pressure)
            if source:
                out.notes.append(source)
        if kinetic is not None:
            P = (kinetic - virial) / V
            for key, (a, b) in _TENSOR.items():
                if key in have and max(a, b) < dimension:
                    unsure = (doubt[1][a, b] + 2 * k_doubt) / V
                    add(f"pressure {key[1:]}", "pressure", P[a, b], key, unsure, size, not of_pressure)
    if "volume" in have and V > 0:
        add("volume", "volume", V, "volume", 1e-5 * V)
    if "atoms" in have and have["atoms"] != n:
        out.lines.append(Line("atoms", "", float(n), float(have["atoms"]), 0.0))
    return out


def _held(frame, pot) -> int:
    """Degrees of freedom that constraints take."""
    constraints = pot.constraints
    return 0 if constraints is None or frame.masses is None else constraints.taken(pot.complete(frame))


def _potential_energy(have, last):
    """(value, last digit, note) of the potential energy without tail corrections, from whatever columns there are;
    None."""
    if "potential" in have:
        value, digit = have["potential"], last["potential"]
    elif "pair" in have and "molecular" in have:
        value, digit = have["pair"] + have["molecular"], last["pair"] + last["molecular"]
    elif "total" in have and "kinetic" in have:
        value, digit = have["total"] - have["kinetic"], last["total"] + last["kinetic"]
    else:
        return None
    if have.get("tail"):
        note = "the tail correction E_tail of the run is taken off its energy"
        return value - have["tail"], digit + last["tail"], note
    return value, digit, ""


def _degrees_of_freedom(out, total, k_B, free, temperature) -> None:
    """Where temperatures differ but the kinetic energy fits a whole number of degrees of freedom."""
    line = out.lines[-1]
    if line.agrees or not temperature > 0:
        return
    theirs = total / (k_B * temperature)
    off = max(line.allowed / abs(temperature) * theirs, 1e-6 * theirs)
    if abs(theirs - round(theirs)) < min(off + 1e-9, 0.2) and round(theirs) != free:
        line.counts = False
        fewer = free - round(theirs)
        constraints = "constraints (shake, rattle, rigid) or compute_modify"
        others = "compute_modify extra/dof, or another count of the momentum"
        out.notes.append(
            f"the run counts {round(theirs)} degrees of freedom, {abs(fewer)} {'fewer' if fewer > 0 else 'more'} than "
            f"{free}: {constraints if fewer > 0 else others}"
        )


def _explanations(frame, check: ThermoCheck, forces) -> list[str]:
    """What differences look like."""
    out = []
    n = len(frame)
    energy = check.line("energy")
    if energy is not None and not energy.agrees and n > 1 and energy.run:
        ratio = energy.model / energy.run
        for factor, why in (
            (n, "the log's energies are per atom (thermo_modify norm yes)"),
            (1.0 / n, "the log's energies are totals (thermo_modify norm no)"),
        ):
            if abs(ratio / factor - 1.0) < 1e-4:
                out.append(f"{why}, which the log does not say")
    agree = forces is not None and forces.agrees
    diagonal = [check.line(f"pressure {c}") for c in ("xx", "yy", "zz")]
    others = [check.line(f"pressure {c}") for c in ("xy", "xz", "yz")]
    if all(x is not None and not x.agrees for x in diagonal) and all(x is None or x.agrees for x in others):
        d = np.array([x.difference for x in diagonal])
        if np.ptp(d) <= 2 * max(x.allowed for x in diagonal):
            out.append(
                f"the run's pressure differs by the same {-d.mean():.6g} {diagonal[0].units} along x, y and z: a tail "
                "correction (pair_modify tail yes), which is in no field"
            )
    if agree and check.wrong:
        out.append(
            "the forces agree: what differs is in energy or virial only (tail corrections, fixes with energy or "
            "virial, rigid bodies, shifts)"
        )
    if check.causes:
        out.append(f"the log says that the run's numbers contain or depend on: {', '.join(check.causes)}")
    return out
