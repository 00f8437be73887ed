"""The table and the verdict of ``atc check``: what `atc.analysis.check.check` found out, in words."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import numpy as np

from ..estimators import balance
from ..terminal import tell

#: A law in closed form leaves rounding only: 1e-13 or so of the largest term, more where forces cancel.
EXACT = 1e-9
_NAMES = {"mass": "mass balance", "momentum": "momentum balance", "energy": "energy balance", "churning": "div z = 0"}


@dataclass
class Outcome:
    """One law by one way: residual, its limit, both relative to the law's largest term; `holds` is None where it cannot
    be decided."""

    residual: float
    limit: float
    holds: bool | None
    without: float | None = None
    rms: float = 0.0


@dataclass
class Findings:
    """Everything `atc.analysis.check.check` found out, for `report`."""

    source: str
    number: int
    frame: object
    kernel: str
    n_random: int
    n_points: int
    laws: dict
    closed: dict[str, Outcome]
    stencil: dict[str, Outcome]
    frames: Frames | None
    sources: tuple[float, float, int]
    apart: dict[str, float]
    jumps: list
    churns: bool
    forces_nc: np.ndarray
    notes: list[str]

    @property
    def ways(self) -> dict[str, dict[str, Outcome]]:
        """{way: {law: outcome}}."""
        out = {"chain rule": self.closed, "fields": self.stencil}
        return out | {"frames": self.frames.outcome} if self.frames else out

    def picked(self, holds) -> list[tuple[str, str, Outcome]]:
        """(law, way, outcome) of the outcomes whose `holds` is this."""
        return [
            (name, way, o)
            for name in self.laws
            for way, found in self.ways.items()
            if name in found and (o := found[name]).holds is holds
        ]

    @property
    def sources_hold(self) -> bool:
        # 1e-8: differences of energies over 1e-3 Å, see balance.energy_rates
        return self.sources[0] <= max(30 * self.sources[1], 1e-8)

    @property
    def fields_agree(self) -> bool:
        return all(v <= EXACT for v in self.apart.values())


@dataclass
class Frames:
    """The laws from differences between frames, by spacing; all relative to the largest term, internal units for
    times."""

    dt: list[float]
    residual: dict[str, list[float]] = field(default_factory=dict)
    slope: dict[str, list[float]] = field(default_factory=dict)
    outcome: dict[str, Outcome] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass
class Report:
    """What `check` found. `ok` is False if a law is broken; `lines` is the verdict, `data` everything as plain
    values."""

    title: str
    ok: bool
    verdict: list[str]
    rows: list[list[str]]
    notes: list[str]
    data: dict

    def json(self) -> str:
        return json.dumps(self.data | {"holds": self.ok, "verdict": self.verdict, "notes": self.notes}, indent=2)

    def print(self, console) -> None:
        widths = [max(len(cell) for cell in column) for column in zip(*self.rows, strict=True)]
        rows = ("  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths)).rstrip() for row in self.rows)
        tell(console, [self.title, *(f"  {row}" for row in rows), *self.verdict], self.notes)


def relative(a, b) -> float:
    """a/b; 0/0 is 0."""
    return float(a / b) if b > 0 else 0.0 if a == 0 else float("inf")


def number(v) -> str:
    """A residual in three digits."""
    return f"{v:.3g}"


def _e(v) -> str:
    return "0" if v == 0 else f"{v:.1e}"


def _percent(v: float) -> str:
    return f"{100 * v:.2g} %" if v >= 1e-4 else _e(v)


def report(f: Findings) -> Report:
    """Table, verdict, notes and plain values."""
    u = f.frame.units
    title = f"{f.source}, frame {f.number}, {len(f.frame)} atoms; kernel {f.kernel}; {f.n_random} random points"
    if f.n_points > f.n_random:
        title += f" and {f.n_points - f.n_random} points of the grid"
    forces = _forces(f.frame, f.forces_nc)
    data = {
        "frame": f.number,
        "atoms": len(f.frame),
        "points": {"random": f.n_random, "grid": f.n_points - f.n_random},
        "kernel": f.kernel,
        "laws": {name: _entry(f, name) for name in f.laws},
        "energy_sources": dict(zip(("error", "limit", "atoms_left_out"), f.sources, strict=True)),
        "fields_against_own_sums": f.apart,
        "cutoff_jumps": [
            {"style": j.name, "cutoff": u.to_user("length", j.cutoff), "energy": u.to_user("energy", j.energy),
             "force": u.to_user("force", j.force), "crossings_per_time": j.crossings * u.time} for j in f.jumps
        ],
        "forces_in_file": forces,
    }  # fmt: skip
    notes = f.notes + _cutoff_note(f.jumps, u)
    if f.sources[2]:
        notes.append(
            f"{f.sources[2]} atoms were left out of the test of the energy sources: pairs crossed the cutoff within it"
        )
    if forces is not None:
        notes.append(f"forces of the potential and forces in the file differ by {_percent(forces)} of the largest")
    ok = not f.picked(False) and f.sources_hold and f.fields_agree
    return Report(title, ok, _verdict(f), _table(f), notes, data)


def _entry(f: Findings, name: str) -> dict:
    """One law as plain values."""
    term, largest = f.laws[name].largest
    factor, label = _unit(f.frame.units, name)
    entry = {"largest_term": term, "largest": largest * factor, "units": label}
    entry |= {way.replace(" ", "_"): _plain(found[name]) for way, found in f.ways.items() if name in found}
    if f.frames and name in f.frames.outcome:
        entry["frames"] |= {
            "dt": [f.frame.units.to_user("time", t) for t in f.frames.dt],
            "residuals": [_finite(v) for v in f.frames.residual[name]],
            "order": f.frames.slope[name],
            "limits": {what: _finite(v) for what, v in f.frames.limits[name].items()},
        }
    return entry


def _table(f: Findings) -> list[list[str]]:
    rows = [["law", "largest term", *f.ways, *(["order in dt"] if f.frames else [])]]
    for name, x in f.laws.items():
        term, largest = x.largest
        factor, label = _unit(f.frame.units, name)
        row = [_NAMES[name], f"{term} {number(largest * factor)} {label}"]
        row += [_e(found[name].residual) if name in found else "" for found in f.ways.values()]
        if f.frames:
            row.append(", ".join(f"{s:.2f}" for s in f.frames.slope.get(name, [])))
        rows.append(row)
        if name == "energy":
            without = [_e(found[name].without) for found in f.ways.values()]
            rows.append(["  without churning", "", *without, *([""] if f.frames else [])])
    return rows


def _cutoff_note(jumps, u) -> list[str]:
    """What the worst jump at a cutoff does."""
    if not jumps:
        return []
    j = max(jumps, key=lambda j: abs(j.energy) * j.crossings)
    energy = abs(j.energy) > 1e-9 * abs(j.force) * j.cutoff
    if not energy:
        j = max(jumps, key=lambda j: abs(j.force) * j.crossings)
    what, value = ("energy", j.energy) if energy else ("force", j.force)
    return [
        f"{j.name} ends at its cutoff ({number(u.to_user('length', j.cutoff))} {u.label('length')}) with "
        f"{'an' if energy else 'a'} {what} of "
        f"{number(u.to_user(what, value))} {u.label(what)}: about {number(j.crossings * u.time)} pairs a "
        f"{u.label('time')} cross it, and the {what} jumps by that much"
    ]


def _unit(u, name) -> tuple[float, str]:
    """Factor from internal units and label of a law's terms."""
    above, below = balance.DIMENSIONS[name]
    if below is None:
        return u.to_user(above, 1.0), u.label(above)
    label = u.label(below)
    return u.to_user(above, 1.0) / u.to_user(below, 1.0), f"{u.label(above)}/{label}"


def _finite(v):
    """JSON knows no infinity."""
    return None if isinstance(v, float) and not np.isfinite(v) else v


def _plain(o: Outcome) -> dict:
    out = {"residual": o.residual, "limit": o.limit, "holds": o.holds}
    if o.without is not None:
        out["without_churning"] = o.without
    return {k: _finite(v) for k, v in out.items()}


def _forces(frame, forces_nc) -> float | None:
    """Largest difference between the potential's forces and those of the file, relative to the largest; None if the
    file has none."""
    if frame.forces is None:
        return None
    return relative(np.abs(forces_nc - frame.forces).max(), np.abs(frame.forces).max())


_WAYS = {
    "chain rule": "in closed form",
    "fields": "from the fields on stencils",
    "frames": "from differences between frames",
}
_SUSPECTS = {
    "chain rule": "forces, stress and energy sources do not belong to each other: an error of atc",
    "fields": "the deposited fields are not the sums they should be: an error of atc",
    "frames": "is the potential that of the run, the run free of thermostats, walls and other outside forces, and are "
    "units, masses and times right?",
}


def _verdict(f: Findings) -> list[str]:
    out = []
    broken = f.picked(False)
    bad = {name for name, _, _ in broken}
    for name in f.laws:
        if name in bad:
            continue
        sure = [o for o in (f.closed[name], f.stencil[name]) if o.holds]
        residual = max(o.residual for o in sure)
        text = f"{_NAMES[name]} holds to {_e(residual)} of its largest term"
        if name == "energy":
            without = max(o.without for o in sure)
            if not f.churns:
                text += "; there is no churning heat flux (as for every pair and embedded-atom potential)"
            elif without > 2 * residual:
                text += f"; without the churning heat flux it would be off by {_percent(without)}"
        out.append(text)
    out += _frames_verdict(f.frames, f.frame.units) if f.frames else []
    for name, way, o in broken:
        out.append(
            f"BROKEN: {_NAMES[name]} {_WAYS[way]}: off by {_percent(o.residual)} of its largest term, of which "
            f"{_e(o.limit)} can be explained"
        )
    out += [f"what to look at: {_SUSPECTS[way]}" for way in dict.fromkeys(way for _, way, _ in broken)]
    for name, way, o in f.picked(None):
        out.append(
            f"undecided: {_NAMES[name]} {_WAYS[way]}: off by {_percent(o.residual)}, but the test itself is only good "
            f"to {_percent(o.limit)}"
        )
    if not f.sources_hold:
        out.append(
            "BROKEN: the energy sources are not the derivatives of the atoms' energies: off by "
            f"{_percent(f.sources[0])} of the largest rate"
        )
    if not f.fields_agree:
        worst = max(f.apart, key=f.apart.get)
        out.append(
            f"BROKEN: the field {worst} differs from an independent sum by {_percent(f.apart[worst])} of the largest "
            "value"
        )
    return out


def _frames_verdict(frames: Frames, u) -> list[str]:
    held = [name for name, o in frames.outcome.items() if o.holds]
    if not held:
        return []
    worst = max(held, key=lambda name: frames.outcome[name].residual)
    o, limits = frames.outcome[worst], frames.limits[worst]
    spacings = ", ".join(number(u.to_user("time", t)) for t in frames.dt)
    text = (
        f"frames {spacings} {u.label('time')} apart: {', '.join(held)} hold{'s' * (len(held) == 1)} to "
        f"{_e(o.residual)} "
    )
    text += f"({worst}; limited to {_e(o.limit)} by the {max(limits, key=limits.get)})"
    slopes = [s[0] for name, s in frames.slope.items() if s and name in held]
    if slopes:
        low, high = f"{min(slopes):.2f}", f"{max(slopes):.2f}"
        text += f"; residuals fall with the spacing to the power {low}" + (f" to {high}" if low != high else "")
    return [text]
