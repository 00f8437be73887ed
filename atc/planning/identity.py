"""What makes a run that goes on the same run: every input that changes a number, as plain values, and each frame's own
content.

The identity of a request is kept beside an unfinished output, the digests of its frames in the journal of what is done.
A run is continued only where both are what they were; what differs is named. The number of frames is no part of it: a
trajectory may have grown.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping

import numpy as np

#: Raised whenever a change of the package changes numbers (beyond rounding): outputs begun before are not continued.
RESULTS = 9

#: What a frame's digest is made of, in this order.
PARTS = (
    "cell", "positions", "types", "ids", "masses", "velocities", "charges", "bonds", "step or time", "forces",
    "other columns",
)  # fmt: skip
#: Attributes of potentials that say where something came from, or how to make more of it, and not what it is.
#: (What a script says of atoms is in the frames' digests.)
_NOT_CONTENT = frozenset("where folder file text data_file grow build source setup outside remarks learned".split())


def identity(job) -> dict:
    """What the numbers of a `Request` depend on beside the frames, as plain values by the names that people know."""
    work = job.work
    pot = job.request.pot if work.bond_users else None
    reference = job.request.reference if work.reference_users else None
    return {
        "results": RESULTS,
        "quantities": [q.name for q in work.quantities],
        **({"column units": job.request.column_units} if job.request.column_units else {}),
        **({"atoms": digest(job.request.select.plain())} if job.request.select is not None else {}),
        **({"output units": str(job.request.output_units)} if job.request.output_units else {}),
        **({"parts": f"{job.parts.by} {' '.join(job.parts.labels)}"} if job.parts is not None else {}),
        **({"bonds": job.request.bonds} if job.request.bonds != "half" else {}),
        "trajectory": frame_digest(job.first),
        "potential": f"{_in_words(pot)}; {digest(pot)}" if pot is not None else None,
        "potential on the first frame": _evaluated(job) if pot is not None else None,
        "kernel": _kernel(job.request.kern) if work.kernel_users else None,
        "grid": digest(job.request.grid, everything=True) if work.grid_users else None,
        **({"velocity": job.request.velocity} if any(q.thermal for q in work.quantities) else {}),
        "method": job.request.method,
        "tolerance": float(job.request.tolerance),
        "tiles": list(job.request.tiles) if job.request.tiles else None,
        "average": int(job.request.average) if job.request.average is not True else True,
        "group": job.group() if job.group() > 1 else None,
        "horizon": None if job.request.horizon is None else float(job.request.horizon),
        "units": job.first.units.name,
        "dimension": job.first.dimension,
        "reference": None if reference is None else frame_digest(reference),
    }


def _kernel(kern) -> list[str]:
    short = all(isinstance(v, (int, float, str)) for v in kern.parameters.values())
    said = [f"{k} {v!r}" for k, v in kern.parameters.items()] if short else [digest(kern.parameters)]
    return [kern.name, *said]


def _in_words(pot) -> str:
    # Remarks name files and lines, which may be others with the same model in them.
    return "; ".join(t.describe() for t in pot.terms) or pot.describe()


def _evaluated(job) -> str:
    """What the potential says about the first frame: the last word on those whose numbers lie where `digest` does not
    look."""
    d = job.request.pot.stream(job.first, None, threads=job.request.threads)
    # 10 digits: the order of summation, hence the number of threads, must not matter.
    return f"energy {d.energy:.9e}, virial {np.trace(d.virial_cc):.9e}"


def digest(thing, everything: bool = False) -> str:
    """A digest of the numbers and words in an object of this package: of its public attributes, the same wherever it
    was made from and however often it was used, or of `everything` in objects that only hold what they were given."""
    h = hashlib.sha256()
    seen: dict[int, object] = {}  # held, so that no other object gets the number of one that is gone

    def walk(x, name):
        if x is None or isinstance(x, (str, bytes, bool, int, float, complex, np.generic)):
            h.update(f"|{name}={x!r}".encode())
        elif isinstance(x, np.ndarray) and x.dtype.kind != "O":
            h.update(f"|{name}:{x.dtype.str}{x.shape}".encode() + np.ascontiguousarray(x).tobytes())
        elif id(x) in seen:
            return
        elif isinstance(x, Mapping):
            seen[id(x)] = x
            for k in sorted(x, key=repr):
                walk(x[k], f"{name}[{k!r}]")
        elif isinstance(x, (list, tuple, np.ndarray)):
            seen[id(x)] = x
            for k, y in enumerate(x):
                walk(y, f"{name}[{k}]")
        elif isinstance(x, (set, frozenset)):
            walk(sorted(x, key=repr), name)
        elif type(x).__module__.split(".")[0] == __name__.split(".")[0]:
            seen[id(x)] = x
            h.update(f"|{name}:{type(x).__qualname__}".encode())
            for k in sorted(attributes(x)):
                if everything or not (k.startswith("_") or k in _NOT_CONTENT):
                    walk(getattr(x, k), f"{name}.{k}")
        elif callable(x):
            h.update(f"|{name}:{getattr(x, '__qualname__', '')}".encode())
            if getattr(x, "__name__", "") == "<lambda>":
                h.update(x.__code__.co_code + repr(x.__code__.co_consts).encode())

    def attributes(x):
        own = list(getattr(x, "__dict__", ()))
        return own + [s for c in type(x).__mro__ for s in getattr(c, "__slots__", ()) if hasattr(x, s)]

    walk(thing, "")
    return h.hexdigest()[:24]


def frame_digest(frame) -> str:
    """A frame's numbers, a short digest for each of `PARTS`."""
    t = frame.topology
    kinds = () if t is None else ("bond", "angle", "dihedral", "improper")
    bonds = [getattr(t, k + s) for k in kinds for s in ("s", "_types")]
    return " ".join(
        _short(*part)
        for part in (
            (frame.cell.vectors, frame.cell.origin, frame.cell.periodic),
            (frame.positions, frame.images),
            (frame.types,),
            (frame.ids,),
            (frame.masses,),
            (frame.velocities,),
            (frame.charges,),
            bonds,
            (frame.step, frame.time),
            (frame.forces,),  # which say what constraints and forces from outside do
            [v for k in sorted(frame.extra) for v in (k, frame.extra[k])],
        )
    )


def _short(*values) -> str:
    h = hashlib.blake2b(digest_size=6)
    for v in values:
        h.update(b"-" if v is None else np.ascontiguousarray(v).tobytes() + b"|")
    return h.hexdigest()


def changed_parts(then: str, now: str) -> str:
    """Which of `PARTS` differ between two digests of a frame."""
    a, b = then.split(), now.split()
    return ", ".join(p for p, x, y in zip(PARTS, a, b, strict=False) if x != y) or "its content"


def differences(then: Mapping, now: Mapping) -> str:
    """What differs between two identities, in words; "" where nothing does. Their numbers of frames are left to the
    caller."""
    out = []
    for key in sorted({*then, *now} - {"frames"}):
        a, b = then.get(key), now.get(key)
        if a == b:
            continue
        if key == "trajectory" and a and b:
            out.append(f"trajectory: {changed_parts(a, b)} of the first frame")
        elif key == "potential on the first frame":
            if then.get("trajectory") == now.get("trajectory") and then.get("potential") == now.get("potential"):
                out.append("potential")
        elif key == "results":
            out.append("version: this version of atc gives other numbers")
        elif key == "case" and isinstance(a, str) and isinstance(b, str):
            out += [f"case: {line}" for line in _toml_differences(a, b)]
        elif _is_short(a) and _is_short(b):
            out.append(f"{key}: {_said(a)} then, {_said(b)} now")
        else:
            out.append(key)
    return "; ".join(out)


def _is_short(v) -> bool:
    if isinstance(v, str):
        return len(v) < 20 and " " not in v
    return isinstance(v, (int, float, type(None), list))


def _said(v) -> str:
    return "none" if v is None else ", ".join(map(str, v)) if isinstance(v, list) else str(v)


def _toml_differences(a: str, b: str) -> list[str]:
    """The keys of two TOML texts that differ, with their values."""

    def flat(x, name, out):
        if isinstance(x, dict):
            for k, v in x.items():
                flat(v, f"{name}.{k}" if name else k, out)
        elif isinstance(x, list) and x and isinstance(x[0], dict):
            for k, v in enumerate(x):
                flat(v, f"{name}[{k}]", out)
        else:
            out[name] = x
        return out

    try:
        then, now = flat(tomllib.loads(a), "", {}), flat(tomllib.loads(b), "", {})
    except tomllib.TOMLDecodeError:
        return ["text"]
    changed = [k for k in dict.fromkeys([*then, *now]) if then.get(k) != now.get(k)]
    return [f"{k}: {_said(then.get(k))} then, {_said(now.get(k))} now" for k in changed]
