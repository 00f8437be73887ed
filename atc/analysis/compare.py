"""Hardy's stress against the virial stress: box averages, profiles, pointwise differences, and how they change with the
kernel.

The mean of Hardy's stress over a box *is* the virial stress (its potential part exactly, as far as the grid resolves
the kernel; its kinetic part up to the local mean velocity, which Hardy takes out point by point and the virial only as
a whole). Point by point the two differ: a per-atom virial smoothed with the kernel puts half of every bond to each end
instead of along the bond.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..config.scene import Scene
from ..errors import AtcError
from ..pictures.components import component
from ..pictures.drawing import kernel_title, require_frame
from ..pictures.geometry import points_of_grid
from ..running.opening import load, of_species
from ..running.output import plain
from ..units.words import NotAUnit, in_units, unit_of
from .comparison import POINTWISE, RELATIVE, SIX, Comparison, side_by_side

SHOWN = (*SIX, "hydrostatic", "vonmises")


def _shown(dimension, names=SHOWN):
    """Those of some components that say anything: in two dimensions those without z."""
    return tuple(c for c in names if dimension == 3 or "z" not in c)


STRESSES = ("stress", "stress_potential")
PROFILES = "profiles (means over the other axes), Hardy - smoothed virial"
ACCURACY = "accuracy of the numbers, relative to the largest value of each field"


def compare(ds, *, frame=None, species=None, units=None) -> Comparison:
    """Compare Hardy's stress with the virial stress in an output of `atc.fields`.

    Parameters
    ----------
    ds : xarray.Dataset, or the path of an output; it must hold ``stress`` or ``stress_potential``, and
        ``virial_stress`` (for box averages)
        or ``smoothed_virial_stress`` (for profiles and pointwise differences), or both
    frame : index of one entry of the output; default: the mean over all, where a frame without mass at a point counts
        as zero stress there
    species : which of the species, or molecules, that the fields are taken apart by
    units : to compare in, e.g. ``"GPa, nm"`` or a preset, see `atc.fields`

    Returns
    -------
    Comparison

    Raises
    ------
    AtcError : when there is nothing to compare

    Notes
    -----
    Entries are read one at a time. With several, the standard error of a box average's difference is that of its
    series, by block averaging (`atc.estimators.statistics`); with a single time average, differences are held against
    the standard errors it carries.
    """
    import xarray as xr

    name = "output" if isinstance(ds, xr.Dataset) else str(ds)
    ds = in_units(of_species(load(ds), species), units)
    hardy_name = next((n for n in STRESSES if n in ds), None)
    if hardy_name is None:
        raise AtcError(
            f"{name}: holds no Hardy stress to compare: compute quantities stress, virial_stress and "
            "smoothed_virial_stress"
        )
    part = hardy_name.removeprefix("stress")
    if "virial_stress" + part not in ds and "smoothed_virial_stress" + part not in ds:
        raise AtcError(
            f"{name}: holds no virial stress to compare with: compute virial_stress (box average) or "
            "smoothed_virial_stress (pointwise) too"
        )
    place = points_of_grid(ds, ds[hardy_name])
    entries, when = _entries(ds, frame)
    title = ", ".join(t for t in (Path(name).name, kernel_title(ds, str), when) if t)
    units, dimension = ds[hardy_name].attrs.get("units", ""), int(ds.attrs.get("dimension", 3))
    out = Comparison([], xr.Dataset(), units, title, place=place, dimension=dimension)
    for k in ("kernel", "radius", "radius_units", "method", "tolerance", "measured_error"):
        if k in ds.attrs:
            v = ds.attrs[k]
            out.attrs[k] = plain(v) if isinstance(v, (np.generic, np.ndarray)) else v
    wanted = [n for n in _NEEDED if n in ds]
    mean, boxes = _means(ds, wanted, entries, place)
    hardy = mean[hardy_name]
    scale = float(np.nanmax(np.abs(hardy), initial=0.0)) or 1.0
    single = entries[0] if len(entries) == 1 else None
    _box_averages(out, ds, boxes, place, single)
    column = _column_stress(out, ds, entries, place)
    _pointwise(out, ds, mean, hardy_name, place, single, scale, column)
    _accuracy(out, ds)
    return out


_NEEDED = [kind + stress for kind in ("", "virial_", "smoothed_virial_") for stress in STRESSES]


def _entries(ds, frame):
    """Which entries are averaged, and what to call that."""
    n = ds.sizes.get("frame", 1)
    averaged = "frames_averaged" in ds
    if frame is not None:
        require_frame(ds, frame)
        return [frame % n], f"entry {frame % n}" if averaged else f"frame {frame % n}"
    if averaged:
        return list(range(n)), f"average of {int(ds['frames_averaged'].sum())} frames"
    return list(range(n)), "" if n == 1 else f"mean of {n} frames"


def _means(ds, names, entries, place):
    """Mean fields ({name: array}, NaN where never defined) and the series of box means ({name: [(3, 3), ...]})."""
    total, defined, boxes = {}, {}, {n: [] for n in names}
    for k in entries:
        for n in names:
            da = ds[n].isel(frame=k) if "frame" in ds[n].dims else ds[n]
            box = not any(d in da.dims for d in place.dims)
            x = da.transpose("i", "j").values if box else da.transpose(*place.dims, "i", "j").values
            good = np.isfinite(x)
            # where there is nothing the sums are 0: undefined points count as empty, not as absent
            x = np.where(good, x, 0.0)
            boxes[n].append(x if box else x.reshape(-1, 3, 3).mean(axis=0))
            total[n] = x if n not in total else total[n] + x
            defined[n] = good if n not in defined else defined[n] | good
    return {n: np.where(defined[n], total[n] / len(entries), np.nan) for n in names}, boxes


def _box_averages(out, ds, boxes, place, single):
    from ..estimators.statistics import BlockAverage

    for suffix in ("", "_potential"):
        if f"virial_stress{suffix}" not in boxes or f"stress{suffix}" not in boxes:
            continue
        if not place.tiles:
            out.notes.append(
                f"the {place.kind} does not fill the cell: its mean is not a box average and is not compared with the "
                "virial of the box"
            )
            return
        is_open = [axis for axis, p in zip("xyz", ds.attrs.get("periodic", "ppp")) if p != "p"]
        if is_open and not suffix:
            out.notes.append(
                f"the cell is open along {', '.join(is_open)}: what the kernel carries beyond its faces there is "
                "missing from Hardy's box average"
            )
        hardy, virial = (np.array(boxes[n + suffix]) for n in ("stress", "virial_stress"))
        section = "box average" + (", potential part" if suffix else "")
        h, v = hardy.mean(0), virial.mean(0)
        size = float(np.abs(v).max()) or 1.0
        error, label = None, None
        if len(hardy) > 1:
            series = BlockAverage()
            for d in hardy - virial:
                series.add(d)
            _, error, correlated = series.result()
            label = "stderr_difference"
            if correlated.any() and not suffix:
                out.notes.append(
                    f"{len(hardy)} entries are too few, or too correlated, to tell: the standard errors are lower "
                    "bounds"
                )
        elif single is not None and f"virial_stress{suffix}_stderr" in ds:
            e = ds[f"virial_stress{suffix}_stderr"]
            error, label = (e.isel(frame=single) if "frame" in e.dims else e).values, "stderr_virial"
        for c in _shown(out.dimension):
            a, b = float(component(h, c, out.dimension)), float(component(v, c, out.dimension))
            row = {"section": section, "name": c, "hardy": a, "virial": b, "difference": a - b}
            row["relative"] = abs(a - b) / size
            if error is not None and c in SIX:
                e = float(component(error, c))
                row[label] = e if np.isfinite(e) else None
                row["sigmas"] = abs(a - b) / e if e > 0 else None
            out.rows.append(row)
        # A slab profile is integrated in closed form across, so that only its bins are left to sum over.
        if suffix and not is_open and float(np.abs(h - v).max()) > 1e-9 * size:
            out.notes.append(
                "over a periodic box the integral of Hardy's potential stress is the virial exactly; the mean over "
                "grid points differs from it by "
                f"{float(np.abs(h - v).max()) / size:.1e}, which is the grid's quadrature: it falls as the grid "
                "resolves the kernel"
            )
    if {"box average", "box average, potential part"} <= {r["section"] for r in out.rows}:
        out.notes.append(
            "the kinetic parts differ by definition: Hardy's takes out the velocity at each point, the virial's the "
            "mean velocity of the frame"
        )


def _column_stress(out, ds, entries, place):
    """(name, (…, 3, 3) array): the smoothed stress/atom that the run wrote itself, six columns of the dump as
    densities, in the units of the stress; None where there is none, or it is not known what it is in.

    A density of stress times volume is a stress: no volume of an atom is needed. LAMMPS's stress/atom is tension
    positive, components xx, yy, zz, xy, xz, yz.
    """
    bases = {m.group(1) for n in ds.data_vars if (m := re.fullmatch(r"column:(.+)\[1\]", str(n)))}
    for base in sorted(bases):
        names = [f"column:{base}[{k}]" for k in range(1, 7)]
        if not all(n in ds for n in names):
            continue
        text = str(ds[names[0]].attrs.get("units", ""))
        try:
            have, want = unit_of(text), unit_of(out.units)
            factor = have.size / want.size if have.powers == want.powers else None
        except NotAUnit:
            factor = 1.0 if text == out.units else None
        if factor is None:
            out.notes.append(
                f"{base} is in {text}, which is no stress: if it is stress/atom, say so, e.g. column_units = "
                f'{{ "{base}[1]" = "{out.units}*angstrom^3", ... }} in [fields], and it is compared, too'
            )
            continue
        x = []
        for n in names:
            da = ds[n].isel(frame=entries).mean("frame") if "frame" in ds[n].dims else ds[n]
            x.append(factor * da.transpose(*place.dims).values)
        tensor = np.stack(x, -1)[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*x[0].shape, 3, 3)
        return base, tensor
    return None


def _pointwise(out, ds, mean, hardy_name, place, single, scale, column=None):

    part = hardy_name.removeprefix("stress")
    name = "smoothed_virial_stress" + part
    if name not in mean:
        out.notes.append(
            f"no {name} in this output: profiles and pointwise differences need it; add it to the scene's quantities"
        )
        return
    h, v = mean[hardy_name], mean[name]
    dims = (*place.dims, "i", "j")
    out.data["hardy"], out.data["virial"] = (dims, h, {"units": out.units}), (dims, v, {"units": out.units})
    if column is not None:
        out.attrs["column"] = column[0]
        out.data["column"] = (dims, column[1], {"units": out.units, "long_name": f"smoothed {column[0]}"})
        _of_column(out, column, h, v, scale)
    what = {"units": out.units, "long_name": "Hardy's stress minus the smoothed per-atom virial"}
    out.data["difference"] = (dims, h - v, what)
    error = None
    if single is not None and f"{hardy_name}_stderr" in ds:
        error = ds[f"{hardy_name}_stderr"]
        error = (error.isel(frame=single) if "frame" in error.dims else error).transpose(*dims).values
    for c, d, good in _differences(out, h, v):
        row = {"section": POINTWISE, "name": c, **sizes(d[good], scale)}
        if error is not None and c in SIX:
            e = component(error, c)
            ok = good & (e > 0)
            if ok.any():
                row["rms in std. errors"] = float(np.sqrt(((d[ok] / e[ok]) ** 2).mean()))
        out.rows.append(row)
    _profiles(out, h, v, place, scale, None if column is None else column[1])


def _differences(out, a, b):
    """(component, its difference, where that is known) of two fields of stress, as far as something is."""
    for c in _shown(out.dimension):
        d = component(a, c, out.dimension) - component(b, c, out.dimension)
        if (good := np.isfinite(d)).any():
            yield c, d, good


def sizes(d, scale, rms=None) -> dict:
    """Columns of a table: rms and largest value of differences d, and both relative to `scale`."""
    rms, largest = float(np.sqrt((d**2).mean())) if rms is None else rms, float(np.abs(d).max())
    return {"rms": rms, "max": largest, "relative rms": rms / scale, "relative max": largest / scale}


def _of_column(out, column, hardy, virial, scale) -> None:
    """How the run's own smoothed stress differs from both; the sign trap is told."""
    name, tensor = column
    for title, other in ((f"pointwise, {name} - smoothed virial", virial), (f"pointwise, {name} - Hardy", hardy)):
        for c, d, good in _differences(out, tensor, other):
            out.rows.append({"section": title, "name": c, **sizes(d[good], scale)})
    good = np.isfinite(virial)
    a, b = tensor[good], virial[good]
    if a.size and float(a @ b) < -0.5 * float(np.linalg.norm(a) * np.linalg.norm(b)):
        out.notes.append(
            f"{name} has the opposite sign of the stress: it is a pressure (compression positive), where stress/atom "
            "of LAMMPS is tension positive"
        )


def _profiles(out, hardy, virial, place, scale, column=None):
    """Means over the other axes, empty space counted as empty, so that a profile times the area is a force."""
    if place.kind not in ("volume", "plane", "line", "slab", "planes"):
        return
    for k, dim in enumerate(place.dims):
        if hardy.shape[k] < 2:
            continue
        others = tuple(m for m in range(len(place.dims)) if m != k)
        a, b = (np.nan_to_num(x).mean(axis=others) for x in (hardy, virial))
        attrs = {"units": out.units}
        out.data[f"profile_{dim}_hardy"] = ((dim, "i", "j"), a, attrs)
        out.data[f"profile_{dim}_virial"] = ((dim, "i", "j"), b, attrs)
        if column is not None:
            out.data[f"profile_{dim}_column"] = ((dim, "i", "j"), np.nan_to_num(column).mean(axis=others), attrs)
        s, text = place.abscissa(k)
        out.data[f"profile_{dim}_position"] = ((dim,), s, {"units": place.unit, "label": text})
        for c in ("hydrostatic", "vonmises", "any component"):
            d = a - b if c == "any component" else component(a, c, out.dimension) - component(b, c, out.dimension)
            rms = float(np.sqrt((d * d).reshape(len(d), -1).mean(axis=0).max()))
            out.rows.append({"section": PROFILES, "name": f"along {dim}: {c}", **sizes(d, scale, rms)})


def _accuracy(out, ds):
    """The errors the output carries: relative to the largest value of each field, measured at random points by the
    exact method."""
    for name in ds.data_vars:
        attrs = ds[name].attrs
        if "measured_error" in attrs:
            row = {"section": ACCURACY, "name": name, "measured max": float(attrs["measured_error"])}
            if "error_l2" in attrs:
                row["measured rms"] = float(attrs["error_l2"])
            out.rows.append(row)


def compare_radii(scene, radii, *, jobs: int = 1, progress=None) -> Comparison:
    """The comparison as a function of the kernel radius: the scene's stress is computed once for each radius.

    Parameters
    ----------
    scene : Scene or the path of one. Its quantities are replaced by the stresses to compare.
    radii : lengths in the trajectory's unit style (for a Gaussian, its width)
    jobs, progress : as for `atc.fields`

    Returns
    -------
    Comparison with one row a radius; `data` holds the numbers along a ``radius`` dimension
    """
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    size = "width" if scene.get("kernel", "width") is not None and scene.get("kernel", "radius") is None else "radius"
    asked = scene.get("fields", "quantities") or []
    whole = {"stress", "virial_stress", "smoothed_virial_stress", "stress_kinetic"}
    part = "" if not asked or whole & {*asked} else "_potential"
    quantities = [kind + part for kind in ("stress", "virial_stress", "smoothed_virial_stress")]
    results = []
    for radius in radii:
        one = Scene.load(scene, {f"kernel.{size}": float(radius), "fields.quantities": quantities})
        results.append(compare(one.run(None, jobs=jobs, progress=progress)))
    labels = [f"{radius:g}" for radius in radii]
    section = f"by kernel {size}, {RELATIVE}"
    out = side_by_side(results, labels, section, coordinate=("radius", np.asarray(radii, float)))
    out.title = f"{Path(scene.name).name}, {scene.get('kernel', 'name')} kernel, {len(labels)} values of its {size}"
    return out
