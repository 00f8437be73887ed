"""What is going to be done, for people: which passes, sums and terms, by which method, at what cost (`costs`)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from ..estimators.methods import details
from ..estimators.registry import hidden
from ..estimators.summed import BOND
from ..estimators.work import Work
from .job import Job, prepare
from .request import Request
from .sanity import sanity

_TERMS = {
    "one": "1",
    "degrees": "f/d",
    "mass": "m",
    "momentum": "m v",
    "kinetic": "m v⊗v",
    "kinetic_energy": "½ m v²",
    "potential_energy": "U",
    "atom_virial": "½ Σ G r⊗r",
    "atom_moment": "−½ Σ r⊗F",
    "stress": "G r⊗r",
    "piola": "G R⊗r, between reference positions",
    "moment": "−r⊗F",
    "weighted": "−½ |r| (e_i − e_j)⊗F around each point",
    "weighted_normalised": "−½ |r| (e_i − e_j)⊗F around each point over its mean",
    "reference_weighted": "−½ |R| (E_i − E_j)⊗F around each point, between reference positions",
    "reference_weighted_normalised": "−½ |R| (E_i − E_j)⊗F around each point over its mean, between reference "
    "positions",
    "kinetic_flux": "½ m v² v",
    "outside_force": "F from outside",
    "outside_power": "F·v from outside",
    "potential_flux": "U v",
    "energy_current": "(½ m v² + U) v",
    "source_residual": "what the energy sources leave of the force",
    "power": "(v_k·∂U_j/∂x_k) x_jk",
    "power_lab": "(v_k·∂U_j/∂x_k) x_jk",
    "sources": "x_jk⊗∂U_j/∂x_k",
    "displacement": "m u",
    "reference_mass": "m",
    "reference_displacement": "m u",
    "reference_energy": "U − U of the reference",
}


@dataclass
class Plan:
    """What will be done, what will not, and what it will cost. ``str(plan)`` is for people.

    Attributes
    ----------
    passes : lines saying what runs
    left_out : (what, why) pairs
    method, reason : how the sums are taken, and why so
    atoms, frames, points : sizes (points is 0 without a grid)
    bonds, visits : predicted number of bonds and of bond-point visits a frame
    cpu_seconds, wall_seconds : predicted, a frame; total_seconds: the whole run
    memory : predicted peak in bytes, a process
    error : predicted error relative to the largest value of each field
    parts : CPU seconds a frame of each part of the work
    measured : whether the cost model was measured on this machine (`atc bench --calibrate`)
    agreement : whether the forces of the trajectory are those of the potential
    """

    passes: list[str]
    left_out: list[tuple[str, str]]
    method: str
    reason: str
    atoms: int
    frames: int
    points: int
    bonds: float
    visits: float
    cpu_seconds: float
    wall_seconds: float
    total_seconds: float
    memory: float
    output_bytes: float
    error: float
    tolerance: float
    workers: int
    threads: int
    quantities: list[str] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    measured: bool = False
    agreement: str = ""

    def _repr_html_(self):
        """For notebooks."""
        from html import escape

        return f"<pre>{escape(str(self))}</pre>"

    def __str__(self):
        def count(x):
            return f"{x:.3g}" if x >= 1e6 else f"{x:,.0f}"

        lines = [
            f"{', '.join(self.quantities)}",
            f"{self.frames} frame{'s' * (self.frames != 1)} of {count(self.atoms)} atoms"
            + (f", {count(self.points)} grid points" if self.points else ""),
            "",
            "what runs",
            *(f"  {p}" for p in self.passes),
            "what is left out",
            *(f"  {what}: {why}" for what, why in self.left_out),
        ]
        if self.points:
            lines.append("method  " + self.reason.replace("; sums over", "\n        sums over"))
        threads = f"{self.threads} thread{'s' * (self.threads != 1)}"
        parallel = f"{self.workers} processes of {threads}" if self.workers > 1 else threads
        lines += [
            f"time    about {_duration(self.wall_seconds)} a frame, {_duration(self.total_seconds)} in all "
            f"({parallel}; first use adds compilation)",
            "        "
            + ", ".join(f"{what} {_duration(s)}" for what, s in self.parts.items() if s > 0.005 * self.cpu_seconds)
            + " of CPU a frame"
            + ("" if self.measured else "; atc bench --calibrate fits these to this machine"),
            f"memory  about {_bytes(self.memory)}, output {_bytes(self.output_bytes)}",
            f"error   about {self.error:.0e} of the largest value of each field (tolerance {self.tolerance:g}); "
            "measured at random points when it runs",
        ]
        if self.agreement:
            lines.append(f"run     agrees with the potential? {self.agreement}")
        return "\n".join(lines)


def plan(*args, **kwargs) -> Plan:
    """What `atc.fields` would do with the same arguments. Nothing is computed but the forces of a frame or two, where
    the trajectory has them to compare.

    Takes a `Request`, a `Job`, or the arguments of `atc.fields` up to `workers`.
    """
    ready = len(args) == 1 and not kwargs and isinstance(args[0], (Request, Job))
    job = prepare(args[0] if ready else Request(*args, **kwargs))
    sanity(job)
    work, frame, threads = job.work, job.first, job.threads
    if work.grid_users and (job.request.grid is None or (job.request.kern is None and work.kernel_users)):
        raise AtcError(f"{', '.join(work.grid_users)} need a {'kernel and a ' * bool(work.kernel_users)}grid")
    if work.bond_users and job.request.pot is None:
        raise AtcError(
            f"{', '.join(work.bond_users)} need a potential: give the pair_style/pair_coeff lines of the run"
        )
    from .predict import predict

    p = predict(job)
    size = {"grid": p.points, "box": 1, "atom": len(frame)}
    # One species or molecule after the other: each with its own sums.
    parts = len(job.parts.labels) if job.parts is not None else 1
    entry = parts * sum(8.0 * 3**q.rank * size[q.kind] for q in work.quantities if not hidden(q.name))
    # A sum of squares and a block that waits for its partner at each length, means and errors.
    levels = 1 if job.request.average is False else 4 + 2 * (1 + int(np.log2(job.window / job.group())))
    memory = p.memory + (entry * levels if job.request.average is not False else 0.0)
    written = entry * job.costs.written_byte * (1.0 if job.request.average is False else 2.0 / job.window)
    parallel, serial = parts * p.parallel, parts * p.serial
    wall = parallel / threads + serial + written
    return Plan(
        passes=_passes(work, job),
        left_out=_left_out(work),
        method=job.method_used,
        reason=details(job.methods) or "counted: exact" * (not work.kernel),
        atoms=len(frame),
        frames=job.n_frames,
        points=p.points,
        bonds=job.load.bonds,
        visits=p.visits,
        cpu_seconds=parallel + serial + written,
        wall_seconds=wall,
        total_seconds=wall * job.n_frames / job.request.workers,
        memory=memory,
        output_bytes=entry * job.entries * (2 if job.request.average is not False else 1),
        error=max(
            [1e-13, *(min(0.3 * m.tolerance, 0.5 * job.request.tolerance) for m in job.methods.values() if not m.exact)]
        ),
        tolerance=job.request.tolerance,
        workers=job.request.workers,
        threads=threads,
        quantities=[q.name for q in work.quantities if not hidden(q.name)],
        parts=p.parts,
        measured=job.costs.machine != "shipped",
        agreement=job.alarm().text,
    )


def _passes(work: Work, job: Job) -> list[str]:
    out = []
    if work.bond_users and (pot := job.request.pot) is not None:
        beta = "β" if work.kernel else "over |r_n| of those that cross the planes"
        made = [f"Σ {_TERMS[b]} {beta}, {BOND[b].width} components" for b in work.bond + work.reference_bond]
        made += [f"Σ {_TERMS[p]}, 9 components" for p in work.point + work.reference_point]
        made += ["moment of the forces on each atom"] * any("atom_moment" in name for name in work.whole)
        made += ["virial of each atom"] * work.atom_virial + ["virial of the box"] * ("box_virial" in work.whole)
        made += ["potential energy of each atom"] * bool(work.energy_users)
        made += ["energy sources"] * bool(work.source_users) + ["heat current of the box"] * ("box_power" in work.whole)
        cutoff = job.first.units.to_user("length", pot.cutoff)
        out.append(
            f"one pass over the bonds (neighbours within {cutoff:g} {job.first.units.label('length')}): "
            f"{'; '.join(made)}"
        )
    if (pot := job.request.pot) is not None and (sums := job.field_sums()) is not None:
        frame = pot.complete(job.first)
        for n, term in enumerate(sums.terms):
            on = sums.layout(n, frame)
            what = "Coulomb" if term.prefix == "coulomb" else "dispersion"
            out.append(f"long-range {what} by its modes: {on.describe()}, {on.transforms} transforms")
    if work.summed_site:
        terms, components = ", ".join(_TERMS.get(s) or s.removeprefix("column:") for s in work.site), work.n_site
        unbiased = "; Σ m φ², what few atoms lack of thermal motion" if work.squares else ""
        wide = f"{components} component{'s' * (components != 1)}{unbiased}"
        what = "Σ a φ" if work.kernel else "Σ a over |d_n| of the paths d that cross the planes,"
        out.append(f"one pass over the atoms: {what} for a = {terms}: {wide}")
    for key, gather, where in (
        ("gather", work.gather, ""),
        ("reference_gather", work.reference_gather, ", over reference positions"),
    ):
        if gather:
            terms = ", ".join(_TERMS[s] for s in gather)
            over = "points" if key not in job.methods or job.methods[key].exact else "atoms, on the modes of one mesh"
            out.append(f"one pass over the {over}: Σ a φ{' and Σ a ∂φ/∂x' * work.slopes(key)} for a = {terms}{where}")
    if {"box_kinetic", "atom_kinetic"} & {*work.whole}:
        out.append("m v⊗v of the atoms, without a kernel")
    if job.request.average is not False:
        out.append(
            f"time average over {'all' if job.window >= job.n_frames else job.window} frames with its standard error "
            "by block averaging"
        )
        if job.group() > 1:
            over = " and over ".join({"site": "atoms", "bond": "bonds"}[key] for key in sorted(job.added_up))
            out.append(
                f"sums over {over}: the frames of a window are added up {job.group()} at a time before the sums are "
                "finished, and compared with exact ones"
            )
    return out


def _left_out(work: Work) -> list[tuple[str, str]]:
    bonds = bool(work.bond_users)
    rows = (
        (not bonds, "neighbour search, forces, bonds", "nothing asked needs the potential"),
        (
            bonds and not (work.bond or work.reference_bond),
            "bond function",
            "no field asked is a sum over bonds at grid points",
        ),
        (bonds and not work.atom_virial, "virial of each atom", "no per-atom or smoothed virial was asked for"),
        (bonds and not work.energy_users, "potential energies of the atoms", "no energy was asked for"),
        (bonds and not work.source_users, "energy sources of the bonds", "no heat flux or churning was asked for"),
        ("velocities" not in work.attributes, "velocities", "nothing asked depends on them"),
        (
            not work.summed_site and work.grid_users,
            "sums over atoms",
            "nothing asked needs them" if not work.site else "those with gradients have the same",
        ),
        (work.kernel_users and not work.gradient_users, "gradient of the kernel", "no gradient was asked for"),
        (not work.grid_users, "kernel and grid", "no field was asked for"),
        (not work.reference_users, "reference frame", "nothing asked refers to one"),
    )
    return [(what, why) for left_out, what, why in rows if left_out]


def _duration(s: float) -> str:
    if s < 1:
        return f"{1000 * s:.0f} ms"
    return f"{s:.2g} s" if s < 100 else f"{s / 60:.1f} min" if s < 6000 else f"{s / 3600:.1f} h"


def _bytes(b: float) -> str:
    return f"{b / 1e3:.0f} kB" if b < 1e6 else f"{b / 1e6:.0f} MB" if b < 1e9 else f"{b / 1e9:.1f} GB"
