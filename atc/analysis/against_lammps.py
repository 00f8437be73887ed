"""Fields of atc beside what LAMMPS itself averaged in the run: columns of ``dump grid`` (``fix ave/grid``) and
``fix ave/chunk`` files on the same points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..pictures.components import TENSOR, TENSOR_SCALARS, VECTOR, component
from ..pictures.drawing import require_frame, save
from ..pictures.geometry import fields_of, points_of_grid, rank
from ..pictures.profiles import profiles_figure
from ..running.opening import load
from .compare import sizes
from .comparison import Comparison

#: Which field a column of LAMMPS is, where its name says it.
ALIKE = {
    "density/mass": "density",
    "density/number": "number_density",
    "temp": "temperature",
    **{f"v{c}": f"velocity_{c}" for c in "xyz"},
}
#: What to know of columns that are alike and yet not the same.
_REMARKS = {
    "temp": "temp of LAMMPS holds the mean velocity of each bin (unless its bias takes it out); temperature here is "
    "relative to the velocity field",
    "vx": "vx, vy, vz of LAMMPS are means over atoms, velocity is one over mass: the same where all masses are equal",
}
#: Means over other axes of these are weighted by a density.
_WEIGHTS = {"temperature": "number_density", "velocity": "density"}


class AgainstLammps(Comparison):
    """Rows for each pair: means, and differences in rms and at most, also relative to the largest value of the field of
    atc. `data`: ``<field>`` and ``<field>_lammps`` on the points compared."""

    def picture(self, path) -> Path:
        """Profiles of both; returns the path."""
        pairs = [(n, n.removesuffix("_lammps")) for n in self.data.data_vars if n.endswith("_lammps")]
        curves = [(name, {"atc": self.data[name], "LAMMPS": self.data[theirs]}) for theirs, name in pairs]
        return save(profiles_figure(curves, self.title), path)


def compare_with_lammps(ds, file, columns=None, *, frame=None, units=None) -> AgainstLammps:
    """Fields of an output beside those of LAMMPS.

    Parameters
    ----------
    ds : xarray.Dataset, or the path of an output of `atc.fields`, on a regular grid or a slab whose points are the
        centres of LAMMPS's cells or bins
    file : what ``dump grid`` or ``fix ave/chunk`` wrote, see `atc.read_grid`; in the units of the output
    columns : {field: column}, or list of "field = column"
        Which field a column of LAMMPS is: ``{"stress_xx": "f_1:grid:data[2]"}``; also a product, of columns and
        numbers: ``"smoothed_virial_stress_xx = c_st[1] * density/number"`` (a mean over atoms times how many there are
        in a volume). Fields of vectors and tensors with their component behind them. Known by their names:
        density/mass, density/number, temp, vx, vy, vz, and the columns of `atc export`.
    frame : index of one entry of the output; default all that both have
    units : unit style of the file; default that of the output

    Returns
    -------
    AgainstLammps : means over the steps that both have; where one of the two is averaged over time and steps cannot be
        matched, over all entries

    Raises
    ------
    AtcError : where nothing can be compared: other points, other units, no column that is a field of the output
    """
    import xarray as xr

    from ..readers.lammps.grid import read_grid

    name = "output" if isinstance(ds, xr.Dataset) else str(ds)
    ds = load(ds)
    own = str(ds.attrs.get("units", ""))
    theirs = read_grid(file, units=units)
    said = theirs.attrs.get("units")
    if said is not None and own and said != own:
        raise AtcError(f"{file} is in {said!r} units and {name} in {own!r}: compute both in the same")
    pairs = _pairs(ds, theirs, columns, name, file)
    first = pairs[0][0]
    place = points_of_grid(ds, ds[first].isel(frame=0) if "frame" in ds[first].dims else ds[first])
    if place.kind not in ("volume", "slab"):
        raise AtcError(f"{name}: is on a {place.kind}: LAMMPS's cells and bins go with a regular grid or a slab")
    axes = _axes(ds, place, theirs, name, file)
    which, there, steps = _entries(ds, theirs, frame, [p[2] for p in pairs])
    title = f"{Path(file).name} of LAMMPS against {Path(name).name}{steps}"
    out = AgainstLammps([], xr.Dataset(), "", title, place=place)
    section = f"LAMMPS ({theirs.attrs['kind']}) - atc"
    data = {}
    for field, comp, expression in pairs:
        ours = _mean_of_ours(ds, field, comp, which, place.dims, axes, name)
        lammps = np.mean([_value(theirs, expression, k) for k in there], axis=0)
        lammps = lammps.reshape(ours.shape)  # axes of one cell apart, in this order
        good = np.isfinite(ours) & np.isfinite(lammps)
        label = field if comp is None else f"{field}_{comp}"
        if not good.any():
            out.notes.append(f"{label}: there is no point where both are defined")
            continue
        d = (lammps - ours)[good]
        scale = float(np.abs(ours[good]).max()) or 1.0
        row = {"section": section, "name": f"{label} = {' * '.join(map(str, expression))}"}
        row["unit"] = ds[field].attrs.get("units", "")
        row |= {"mean, atc": float(ours[good].mean()), "mean, LAMMPS": float(lammps[good].mean())}
        out.rows.append({**row, **sizes(d, scale)})
        dims = [place.dims[k] for k in axes]
        coords = {d: ds[d] for d in dims if d in ds.coords}
        attrs = {"units": ds[field].attrs.get("units", ""), "long_name": label.replace("_", " ")}
        data[label] = xr.DataArray(ours, coords, dims, attrs=attrs)
        data[f"{label}_lammps"] = xr.DataArray(lammps, coords, dims, attrs=attrs)
        for column, remark in _REMARKS.items():
            if any(str(e)[:1] + "x" == column or e == column for e in expression if isinstance(e, str) and e in ALIKE):
                out.notes += [remark] * (remark not in out.notes)
    if not out.rows:
        raise AtcError(f"{file}: no point where a field of both is defined")
    out.data = xr.Dataset(data)
    return out


# --- what belongs to what


def _pairs(ds, theirs, columns, name, file):
    """[(field, component or None, factors)] that are to be compared."""
    if columns is None:
        asked = {ALIKE.get(c, c): c for c in theirs.data_vars}
        pairs = [(_field(ds, key), (c,)) for key, c in asked.items()]
        pairs = [(*field, c) for field, c in pairs if field is not None]
        if not pairs:
            raise AtcError(
                f"{file}: which fields of {name} ({_known(ds)}) its columns ({', '.join(map(str, theirs.data_vars))}) "
                "are is not in their names: say it, e.g. --column 'density = f_1:grid:data[1]'"
            )
        return pairs
    if not isinstance(columns, Mapping):
        texts, columns = list(columns), {}
        for text in texts:
            key, eq, expression = text.partition("=")
            if not eq or not key.strip() or not expression.strip():
                raise AtcError(f"--column {text!r}: expected FIELD = COLUMN, e.g. 'density = f_1:grid:data[1]'")
            columns[key.strip()] = expression
    pairs = []
    for key, expression in columns.items():
        field = _field(ds, key)
        if field is None:
            raise AtcError(
                f"{key}: not a field of {name} (components behind it, e.g. stress_xx): it holds {_known(ds)}"
            )
        pairs.append((*field, _factors(theirs, str(expression), file)))
    return pairs


def _known(ds) -> str:

    return ", ".join(fields_of(ds)) or "none on a grid"


def _field(ds, key):
    """(name, component) of a field of the output: ``density``, ``stress_xx``; None if it has no such."""
    fields = fields_of(ds)
    if key in fields and rank(ds[key]) == 0:
        return key, None
    for name in fields:
        comp = key.removeprefix(f"{name}_")
        if comp != key and comp in {0: (), 1: VECTOR, 2: TENSOR + TENSOR_SCALARS}[rank(ds[name])]:
            return name, comp
    return None


def _factors(theirs, text, file) -> tuple:
    """The columns and numbers of a product."""
    out = []
    for word in (w.strip() for w in text.split("*")):
        if word in theirs:
            out.append(word)
            continue
        try:
            out.append(float(word))
        except ValueError:
            raise AtcError(f"{file}: has no column {word!r}: it has {', '.join(map(str, theirs.data_vars))}") from None
    return tuple(out)


def _value(theirs, factors, k) -> np.ndarray:
    out = 1.0
    for f in factors:
        out = out * (theirs[f].values[k] if isinstance(f, str) else f)
    return np.asarray(out)


# --- where and when


def _axes(ds, place, theirs, name, file) -> list[int]:
    """Along which of the output's dimensions LAMMPS's lie, told by where their points are."""
    shape = tuple(ds.sizes[d] for d in place.dims)
    if theirs.attrs["kind"] == "dump grid":
        other = tuple(theirs.sizes[d] for d in "xyz")
        if all(f"position_{d}" in theirs for d in "xyz"):
            x = np.stack([theirs[f"position_{d}"].values for d in "xyz"], -1)
            if (
                place.kind != "volume"
                or shape != other
                or not _same(place.x_gc.reshape(-1, 3), x.reshape(-1, 3), place)
            ):
                raise AtcError(_elsewhere(name, shape, file, other))
            return [0, 1, 2]
        centres = {d: theirs[d].values for d in "xyz" if theirs.sizes[d] > 1}
        found = [place.dims.index(d) if d in place.dims else None for d in centres]
        if None in found or any(not _along(place, k, c) for k, c in zip(found, centres.values(), strict=True)):
            raise AtcError(_elsewhere(name, shape, file, other))
        return found
    if "chunk" in theirs.dims:
        raise AtcError(
            f"{file}: its chunks are not bins in space (they have no coordinates): nothing to lay beside a field"
        )
    bins = [d for d in theirs.dims if str(d).startswith("bin")]
    found = []
    for d in bins:
        fits = [k for k in range(len(shape)) if k not in found and _along(place, k, theirs[d].values)]
        if not fits:
            raise AtcError(_elsewhere(name, shape, file, tuple(theirs.sizes[d] for d in bins)))
        if len(fits) > 1 and len(bins) < len(shape):
            raise AtcError(
                f"{file}: its bins fit along {' and '.join(place.dims[k] for k in fits)} of {name}, and it does not "
                "say along which they lie: compute the output on a slab along it"
            )
        found.append(fits[0])
    return found


def _along(place, k, centres) -> bool:
    """Whether the points along dimension k are those centres, as far as six digits tell; or, of a grid over the whole
    cell, those fractions of it (``units reduced``)."""
    n = place.x_gc.shape[k]
    if n != len(centres):
        return False
    if place.tiles and np.abs(centres - (np.arange(n) + 0.5) / n).max() <= 1e-5:
        return True
    index = tuple(slice(None) if a == k else 0 for a in range(place.x_gc.ndim - 1))
    own = place.x_gc[index][:, "xyz".index(place.dims[k])]
    width = abs(own[1] - own[0]) if len(own) > 1 else 1.0
    return bool(np.abs(own - centres).max() <= 1e-3 * width + 1e-5 * np.abs(own).max())


def _same(a, b, place) -> bool:
    return bool(np.abs(a - b).max() <= 1e-3 * np.linalg.norm(place.steps, axis=1).max())


def _elsewhere(name, shape, file, other) -> str:
    return (
        f"{name} has {' x '.join(map(str, shape))} points, and they are not the centres of the "
        f'{" x ".join(map(str, other))} cells of {file}: compute it on these ([grid] shape, or kind = "slab" with as '
        "many bins)"
    )


def _entries(ds, theirs, frame, expressions):
    """Which entries of both are averaged, and what to say of it."""
    n = ds.sizes.get("frame", 1)
    ours = list(range(n)) if frame is None else [require_frame(ds, frame) % n]
    # A fix that has not averaged yet gives nothing but zeros.
    there = [k for k in range(theirs.sizes["frame"]) if any(np.any(_value(theirs, e, k)) for e in expressions)]
    if not there:
        raise AtcError(f"{theirs.attrs['source']}: all its numbers are 0: LAMMPS had not averaged anything yet")
    steps = [int(s) for s in np.atleast_1d(ds["step"].values)] if "step" in ds else [-1] * n
    at = {int(theirs.step[k]): k for k in there}
    if "frames_averaged" in ds and frame is None:
        return ours, there, f": means over all {len(ours)} and {len(there)} entries"
    both = [(k, at[steps[k]]) for k in ours if steps[k] in at]
    if not both:
        raise AtcError(
            f"no step is in both: the output has {_range([steps[k] for k in ours])}, {theirs.attrs['source']} "
            f"{_range(list(at))}"
        )
    mine, others = (list(k) for k in zip(*both, strict=True))
    return mine, others, f": {len(both)} step{'s' * (len(both) != 1)} that both have"


def _range(steps) -> str:
    return f"{steps[0]}" if len(steps) == 1 else f"{min(steps)} to {max(steps)}"


def _mean_of_ours(ds, field, comp, which, dims, axes, name):
    """The mean over entries, and over the axes that LAMMPS did not resolve."""
    tail = ["i", "j"][: rank(ds[field])]
    others = tuple(k for k in range(len(dims)) if k not in axes)
    weight = _WEIGHTS.get(field) if others else None
    if weight is not None and weight not in ds:
        raise AtcError(f"{name}: the mean of {field} over {dims[others[0]]} needs {weight}: add it to the quantities")
    total = 0.0
    for k in which:
        pick = {"frame": k} if "frame" in ds[field].dims else {}
        x = ds[field].isel(pick).transpose(*dims, *tail).values
        x = component(x, comp, int(ds.attrs.get("dimension", 3)), rank=len(tail))
        if others:
            w = ds[weight].isel(pick).transpose(*dims).values if weight else np.ones(x.shape)
            w = np.where(np.isfinite(x), w, 0.0)
            with np.errstate(invalid="ignore"):
                x = (np.nan_to_num(x) * w).sum(others) / w.sum(others)
        total = total + x
    out = total / len(which)
    kept = [k for k in range(len(dims)) if k in axes]
    return np.transpose(out, [kept.index(k) for k in axes])
