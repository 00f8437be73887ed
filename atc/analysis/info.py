"""What is in a trajectory, how precise it is, and what can be computed from it."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..readers.plausible import doubts, stress_error
from ..running.opening import Damaged, damage, load, open_dataset
from ..terminal import tell

_WORTH_A_WARNING = 1e-3

# What cannot be computed without a per-atom quantity.
_NEEDED_FOR = {
    "velocities": "temperature, kinetic stress, velocity and momentum cannot be computed (stress_potential can); dump "
    "vx vy vz too",
    "masses": "density, momentum, velocity, temperature and kinetic stress cannot be computed; give --masses or a "
    "LAMMPS data file as --topology",
}


@dataclass
class Report:
    """`rows`: (what, text) to print; `data`: the same as plain values; `notes`: what is missing or imprecise, and what
    follows from it."""

    title: str
    rows: list[tuple[str, str]]
    notes: list[str]
    data: dict = field(default_factory=dict)

    def json(self) -> str:
        return json.dumps(self.data | {"notes": self.notes}, indent=2, default=str)

    def print(self, console) -> None:
        width = max(len(k) for k, _ in self.rows)
        tell(console, [self.title, *(f"  {key:<{width}}  {text}" for key, text in self.rows)], self.notes)


def _g(v) -> str:
    return f"{v:.6g}"


def describe(source, topology=None, units=None, masses=None, dimension=None, atom_style=None) -> Report:
    """Look into a trajectory without computing anything: its first and last frame are read, the rest is only counted.

    Parameters are those of `atc.read`. Raises `AtcError` for what `atc.read` refuses, and for a source without a
    complete frame.
    """
    from .. import read

    return _describe(
        read(source, topology=topology, units=units, masses=masses, dimension=dimension, atom_style=atom_style), source
    )


def describe_scene(scene, threads: int = 1) -> Report:
    """The same of a scene's trajectory, and whether the run's forces (and its log, if the scene names one) are those of
    the scene's potential."""
    from ..agreement.run_check import alarm

    trajectory = scene.trajectory()
    report = _describe(trajectory, trajectory.source)
    pot = scene.potential()
    if pot is None:
        return report
    pot.check_topology(trajectory[0])
    found = alarm(trajectory, pot, mode=scene.get("trajectory", "forces", "warn"), log=scene.log(), threads=threads)
    report.rows.append(("potential", pot.describe()))
    report.rows.append(("agrees with run", found.text))
    report.data["agrees_with_run"] = found.text
    return report


def _describe(trajectory, source) -> Report:
    data = trajectory.info()
    if not data["frames"]:
        raise AtcError(f"{source}: holds no complete frame")
    first = trajectory[0]
    u = trajectory.units
    labels = f"length {u.label('length')}, time {u.label('time')}, stress {u.label('pressure')}"
    rows, notes = [("units", f"{u.name} ({labels})")], []
    text = str(data["frames"])
    for name, unit in (("time", " " + u.label("time")), ("step", "")):
        if data[name] is not None:
            a, b = data[name]
            span = _g(a) if a == b else f"{_g(a)} to {_g(b)}" if name == "time" else f"{a} to {b}"
            text += f", {name} {span}{unit}"
    rows.append(("frames", text))
    a, b = data["atoms"]
    rows.append(("atoms", str(a) if a == b else f"{a} in the first frame, {b} in the last"))
    for kind, what in data["types"].items():
        mass = {None: "no mass", "various": "various masses"}.get(what["mass"])
        mass = mass or f"mass {_g(what['mass'])} {u.label('mass')}"
        rows.append((f"type {kind}" + (f" ({what['name']})" if what["name"] else ""), f"{what['count']} atoms, {mass}"))
    rows.append(("cell", _cell(data["cell"], u)))
    if u.dimension == 2:
        rows.append(("dimension", "2: fields are per area, pressures are forces per length"))
    text = ", ".join(data["quantities"])
    rows.append(("per atom", text + (f"; not used: {', '.join(data['extra'])}" if data["extra"] else "")))
    if data["topology"]:
        rows.append(("topology", ", ".join(f"{n} {k}" for k, n in data["topology"].items() if n)))
    text = _state(first, data)
    if text:
        rows.append(("state", text))
    if not data["ids"]:
        notes.append(
            "the source does not number its atoms: they are taken in file order, which must be the same in every frame"
        )
    notes += trajectory.assumed
    notes += doubts(first)
    for name, consequence in _NEEDED_FOR.items():
        if name not in data["quantities"]:
            notes.append(f"no {name}: {consequence}")
    resolution = data["coordinate_resolution"]
    if data["coordinate_resolution_from"].startswith("unknown"):
        rows.append(("precision", f"of coordinates {data['coordinate_resolution_from']}"))
    if resolution > 0:
        error = stress_error(resolution, u)
        data["stress_error_from_resolution"] = error
        where = f"1.5 {u.label('length')}" if u.reduced else f"{_g(u.to_user('length', 5.0))} {u.label('length')}"
        text = f"coordinates resolved to {resolution:.1g} {u.label('length')} ({data['coordinate_resolution_from']})"
        consequence = f"a stress error of about {100 * error:.1g} % at a kernel radius of {where}"
        rows.append(("precision", f"{text}: {consequence}" if error > 1e-6 else text))
        if error > _WORTH_A_WARNING:
            notes.append(
                f"coarse coordinates mean {consequence}: in LAMMPS write them with dump_modify format float %.10g"
            )
    return Report(trajectory.source if isinstance(source, list) else f"{source}", rows, notes, data)


def _cell(c, u) -> str:
    v = np.array(c["vectors"])
    lengths = np.array(c["lengths"])
    d = u.dimension
    text = " x ".join(_g(s) for s in lengths[:d]) + f" {u.label('length')}"
    if d == 3 and np.count_nonzero(v - np.diag(np.diag(v))):
        e = v / lengths[:, None]
        angles = np.degrees(np.arccos(np.clip([e[1] @ e[2], e[0] @ e[2], e[0] @ e[1]], -1, 1)))
        text += f", triclinic: alpha, beta, gamma = {', '.join(_g(a) for a in angles)} degrees"
    elif d == 2 and (v[0, 1] or v[1, 0]):
        text += (
            f", gamma = {_g(np.degrees(np.arccos(np.clip(v[0] @ v[1] / (lengths[0] * lengths[1]), -1, 1))))} degrees"
        )
    if any(c["origin"][:d]):
        text += f", origin {', '.join(_g(s) for s in c['origin'][:d])}"
    periodic = [axis for axis, p in zip("xyz"[:d], c["periodic"]) if p]
    text += f", periodic in {', '.join(periodic)}" if periodic else ", open on every side"
    return text + ("; it changes with time" if c["changes"] else "")


def _state(frame, data) -> str:
    """Density and temperature: the numbers that show at a glance whether units and masses are right."""
    if frame.masses is None or not frame.cell.volume or not len(frame):
        return ""
    u = frame.units
    data["density"] = float(u.to_user("density", frame.masses.sum() / frame.cell.volume))
    text = f"density {_g(data['density'])} {u.label('density')} (atoms over the whole cell)"
    if frame.velocities is not None and len(frame) > 1:
        v = frame.velocities - frame.masses @ frame.velocities / frame.masses.sum()
        data["temperature"] = float(
            frame.masses @ (v * v).sum(axis=1) / (frame.dimension * (len(frame) - 1) * u.boltzmann)
        )
        text += f", temperature {_g(data['temperature'])} {u.label('temperature')}"
    return text + ", first frame"


def is_output(source) -> bool:
    """Whether a file is an output of atc, by its name and what it says of itself."""
    path = Path(str(source))
    if path.suffix not in (".nc", ".zarr") or not os.path.exists(path):
        return False

    try:
        with open_dataset(path) as ds:
            return "atc_version" in ds.attrs
    except Damaged:
        raise
    except (AtcError, OSError):
        return False


def describe_output(path) -> Report:
    """What an output of atc holds: its fields, their units and errors, and how it was made."""
    why = damage(path)
    if why:
        raise Damaged(why)
    with load(path) as ds:
        of = f" from {ds.attrs['sources']}" if ds.attrs.get("sources") else ""
        rows = [("made by", f"atc {ds.attrs['atc_version']}{of}")]
        rows += [
            (key, str(ds.attrs[key]))
            for key in ("units", "grid", "kernel", "method", "tolerance", "refinements")
            if ds.attrs.get(key)
        ]
        rows.append(("checksums", "every chunk is what was written"))
        rows.append(("sizes", ", ".join(f"{name} {n}" for name, n in ds.sizes.items())))
        fields = {}
        for name, da in ds.data_vars.items():
            if name.endswith(("_stderr", "_correlated")):
                continue
            attrs = da.attrs
            error = attrs.get("error_max")
            more = "" if error is None else f", error {float(error):.1e}"
            more += ", with standard error" * (f"{name}_stderr" in ds)
            text = f"{attrs.get('long_name', '')} [{attrs.get('units', '')}] over {', '.join(da.dims)}{more}"
            rows.append((name, text))
            plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in attrs.items()}
            fields[name] = {"dims": list(da.dims), **plain}
        data = {"attributes": {k: str(v) for k, v in ds.attrs.items()}, "sizes": dict(ds.sizes), "fields": fields}
        notes = [
            "atc plot draws it, atc compare sets it beside the virial stress, atc export writes VTK and extended XYZ"
        ] * ("quantities" in ds.attrs)
    return Report(f"{path}: an output of atc", rows, notes, data)
