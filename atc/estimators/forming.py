"""The fields, formed once from the sums of a run of frames, and the errors that are to be expected of them."""

from __future__ import annotations

from dataclasses import replace

from ..grids.curved import in_local_axes
from .accuracy.random_points import ZERO, extent_of, ratio, without_nan
from .accuracy.strongest_bonds import PointsAround, error_of
from .atom_pass import atom_pass
from .bond_pass import named_bond_sums
from .place import Place
from .quantities.quantity import Quantity
from .results import FrameResult, MeanFields, count
from .runs import Run, RunBonds, RunSums
from .tightening import SAFE


def form(run: Run, sums: RunSums) -> FrameResult:
    """The fields, and which errors are to be expected."""
    work, units, n = run.work, run.frames[0].units, len(run.frames)
    values = {q.name: q.form(sums.grid) for q in run.once} | {q.name: sums.fields.mean(q.name) for q in run.each}
    for q in work.quantities:
        if q.kind == "box" and q.name in sums.boxes.sums:
            values[q.name] = sums.boxes.mean(q.name)
    for q in work.quantities:
        if q.name not in values:
            values[q.name] = sum(values[name] for name in q.parts)
    scales, extents, errors, expected = {}, {}, {}, {}
    for q in work.quantities:
        if q.kind == "grid":
            check = place_of(q, sums).check
            # Points that are never defined are NaN in both.
            known, wanted = without_nan(values[q.name]), without_nan(sums.exactly.of(q))
            scales[q.name], extents[q.name] = q.scale(sums.grid), extent_of(known)
            errors[q.name] = found = check.errors(known, wanted, scales[q.name], extents[q.name])
            likely = check.expected(known, wanted, scales[q.name], extents[q.name])
            expected[q.name] = max(found["error_max"], SAFE * likely)
            found["error_expected"] = max(found["error_max"], likely)
    for name, more in errors_around(run, sums, values, scales, extents, expected).items():
        for key, value in more.items():
            errors[name][key] = max(errors[name][key], value)
        expected[name] = max(expected[name], errors[name]["error_max"])
        errors[name]["error_expected"] = max(errors[name]["error_expected"], errors[name]["error_max"])
    arrays, weights, within, notes = {}, {}, {}, {}
    for q in work.quantities:
        arrays[q.name] = x = units.to_user(q.dimension, values[q.name])
        if run.several:
            means = sums.exactly if q.kind == "grid" else sums.boxes
            within[q.name] = means.within(q) * float(units.to_user(q.dimension, 1.0)) ** 2
        if q.kind == "grid":
            shape = place_of(q, sums).bound.shape
            basis = place_of(q, sums).bound.basis_gcc
            if basis is not None:
                arrays[q.name] = x = in_local_axes(x, basis, q.rank)
            arrays[q.name] = x.reshape(*shape, *x.shape[1:])
            if q.weight is not None:
                w = sums.grid.site[q.weight][:, 0] if q in run.once else sums.fields.weight(q.name)
                weights[q.name] = w.reshape(shape)
    for one in sums.bonds.each:
        count(notes, one.notes)
    place = sums.here or sums.reference
    return FrameResult(
        arrays,
        mask=None if sums.mask is None else sums.mask.reshape(sums.here.bound.shape),
        common=None
        if sums.anywhere is None or run.settings.part is None
        else sums.anywhere.reshape(sums.here.bound.shape),
        weights=weights,
        errors=errors,
        bound=place.bound if place else None,
        seconds=dict(sums.seconds),
        notes=notes,
        expected=expected,
        frames=n,
        within=within,
    )


def place_of(q: Quantity, sums: RunSums) -> Place:
    """Where the sums of a quantity are: on the reference, or on the frame."""
    return sums.reference if q.on_reference else sums.here


def errors_around(run: Run, sums: RunSums, values, scales, extents, expected) -> dict[str, dict[str, float]]:
    """The errors that the strongest bonds make: of several frames alone, if those at random points leave room for them,
    or else all errors at the points around these bonds."""
    bonds, quantities = sums.bonds, run.work.checkable
    if bonds.strong_g is None:
        return {}
    if run.several and all(q.rank == 2 for q in quantities):  # in the units of the bonds' own sum
        strongest, error = bonds.strongest.all, bonds.left
        few = strongest.watched(run.frames[0].cell)
        if len(few[0]):
            error += float(error_of(sums.here, few, strongest).max(initial=0.0))
        sizes = {q.name: extents[q.name].largest for q in quantities}
        n = len(run.frames)
        alone = {
            name: ratio(error / n, scales[name] if size <= ZERO * scales[name] else size)
            for name, size in sizes.items()
        }
        if all(expected[name] + alone[name] <= run.goal for name in alone):
            return {name: {"error_max": value} for name, value in alone.items()}
    around = look_around(run, sums.here, bonds)
    if around is None:
        return {}
    points, means = around
    found = {
        q.name: points.check.errors(
            without_nan(values[q.name]), without_nan(means.of(q)), scales[q.name], extents[q.name]
        )
        for q in quantities
    }
    return {name: {key: errors[key] for key in ("error_max", "error_of_fluctuation")} for name, errors in found.items()}


def look_around(run: Run, here: Place, bonds: RunBonds) -> tuple[PointsAround, MeanFields] | None:
    """The fields at the points around the strongest bonds, exactly; None where there are no such points."""
    work, settings = run.work, run.settings
    points = PointsAround(run.frames[0], here, bonds.strongest.all, bonds.strong_g)
    if not len(points):
        return None
    quantities = work.checkable
    if run.several:
        quantities = [q for q in work.elements if q in quantities or any(q.name in whole.parts for whole in quantities)]
    means = MeanFields()
    for k, frame in enumerate(run.frames):
        bond_gk = points.bond_sums(
            frame, settings.pot, work, run.drifts[k], run.chosen[k], settings.anchor, bonds.each[k].kept
        )
        if bonds.fields is not None:
            bond_gk = bond_gk + bonds.fields.at(k, points.which)
        sums = replace(run.no_sums(k), bond=named_bond_sums(work, bond_gk))
        if work.site:
            sums = atom_pass(sums, frame, work, points.check.deposits, run.factors(k, bonds.each[k].per_atom))
        means.add(quantities, sums)
    return points, means
