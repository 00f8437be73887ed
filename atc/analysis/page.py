"""`atc report`: an output of `atc fields` or `atc twin` as one HTML page that a person reads, and prints: what was
computed from what, pictures, profiles, Hardy against virial, errors and their kinds, warnings, the scene.

The page holds everything it shows: no file, script or address is loaded with it. All text is escaped.
"""

from __future__ import annotations

import contextlib
from html import escape
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..pictures.comparison import compare_figure
from ..pictures.components import component
from ..pictures.drawing import figure, label_of
from ..pictures.geometry import fields_of, points_of_grid, rank, unit_text
from ..pictures.plotting import plot
from ..pictures.symbols import symbol
from ..running.opening import load, of_species
from ..running.whole import replacing
from ..units.words import in_units
from .compare import ACCURACY, compare
from .html import document, facts, figure_of, scene_of, table, warned_of

#: What is drawn, as far as it is there: field, component, what is drawn over it.
PICTURES = (
    ("stress", None, {}),
    ("stress_potential", None, {}),
    ("stress", "vonmises", {"principal": "stress"}),
    ("density", None, {}),
    ("number_density", None, {}),
    ("temperature", None, {}),
    ("velocity", "magnitude", {"arrows": "velocity"}),
    ("heat_flux", "magnitude", {"arrows": "heat_flux"}),
    ("energy", None, {}),
)
#: More pictures of other fields than these say little more.
_MOST = 8
_WHERE = "random points and around the strongest bonds"
_ERRORS = (
    ("error_max", "largest found", f"by the exact method at {_WHERE}, over the largest value"),
    ("error_l2", "rms found", "at the same points, over the rms of the field"),
    ("error_expected", "expected anywhere", "at the worst of all points, by those found"),
    ("input_error", "input", "how far the field moves when atoms move by what the digits of the file hide"),
)


def report(out, target=None, *, species=None, units=None, warned=(), title=None) -> Path:
    """Write the page of an output.

    Parameters
    ----------
    out : path of an output (.nc, .zarr), or a Dataset
    target : the page, .html; default beside the output
    species : which part, of fields that are taken apart; default: every one has its pictures
    units : to show it in, see `atc.fields`
    warned : what the run that made it warned of, sentences
    title : of the page; default the name of the output

    Returns
    -------
    Path of the page

    Raises
    ------
    AtcError : for what is no output of `atc.fields` or `atc.twin`, or a page that cannot be written
    """
    import xarray as xr

    name = "fields" if isinstance(out, xr.Dataset) else Path(out).name
    if target is None:
        if isinstance(out, xr.Dataset):
            raise AtcError("report: give the file to write")
        target = Path(out).with_suffix(".html")
    target = page_path(target)
    ds = load(out)
    if not {"quantities", "twin"} & {*ds.attrs}:
        raise AtcError(f"{name}: is no output of atc fields or atc twin: there is no report of it")
    ds = in_units(ds, units)
    if "twin" in ds.attrs:
        from .twin_page import twin_page

        text = twin_page(ds, title or str(ds.attrs.get("name", name)), warned)
    else:
        text = page(ds, title or name, species=species, warned=warned)
    with replacing(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def page_path(target) -> Path:
    """The path, if a page can stand there."""
    target = Path(target)
    if target.suffix.lower() not in (".html", ".htm"):
        raise AtcError(f"{target}: expected a name that ends in .html")
    if not target.parent.is_dir():
        raise AtcError(f"{target}: there is no directory {target.parent}: make it, or choose another place")
    return target


def page(ds, title: str, species=None, warned=()) -> str:
    """The HTML text."""
    parts = _parts(ds, species)
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="sub">Continuum fields by atc {escape(str(ds.attrs.get("atc_version", "")))}'
        + (f" from {escape(str(ds.attrs['sources']))}" if ds.attrs.get("sources") else "")
        + "</p>",
        "<h2>What was computed</h2>",
        _facts(ds),
    ]
    said = _warnings(ds, warned)
    body += warned_of(said)
    for label, part in parts:
        body += [f"<h2>Fields{f' of {escape(label)}' if label else ''}</h2>", *_pictures(part), *_profile(part)]
        body += _compared(part)
    return document(title, [*body, "<h2>Errors</h2>", _errors(ds), *scene_of(ds)])


def _parts(ds, species):

    if "species" not in ds.dims:
        return [("", of_species(ds, species))]
    names = [str(v) for v in ds["species"].values] if species is None else [str(species)]
    return [(n, of_species(ds, n)) for n in names]


# --- tables


def _facts(ds) -> str:

    a, rows = ds.attrs, []
    for key, what in (
        ("quantities", "fields"),
        ("decomposition", "potential"),
        ("kernel", "kernel"),
        ("grid", "grid"),
        ("selected_atoms", "atoms"),
        ("selected_bonds", "bonds"),
        ("thermal_motion", "thermal motion"),
        ("method_details", "method"),
        ("tolerance", "tolerance"),
        ("agrees_with_run", "forces of the run"),
        ("body_force_source", "forces from outside"),
    ):
        if a.get(key) not in (None, ""):
            rows.append((what, a[key]))
    n = ds.sizes.get("frame", 1)
    frames = f"{n} entr{'ies' if n > 1 else 'y'}"
    if "frames_averaged" in ds:
        frames = f"{int(ds['frames_averaged'].sum())} frames, averaged" + (f" in {n} windows" if n > 1 else "")
    if "time" in ds.coords and np.isfinite(ds["time"].values).any():
        t = ds["time"].values[np.isfinite(ds["time"].values)]
        unit = unit_text(str(ds["time"].attrs.get("units", "")))
        frames += f", from {t[0]:.5g} {unit}" if n == 1 else f", {t[0]:.5g} to {t[-1]:.5g} {unit}"
    rows.insert(1, ("frames", frames))
    shown = f"; shown in {a['output_units']}" if a.get("output_units") else ""
    rows.insert(2, ("units", f"{a.get('units', '')}{shown}"))
    return facts(rows)


def _warnings(ds, warned) -> list[str]:
    out = [str(w) for w in warned]
    for name, da in ds.data_vars.items():
        if da.attrs.get("tolerance_kept"):
            out.append(f"{name}: tolerance kept: {da.attrs['tolerance_kept']}")
    for key, what in (("notes", ""), ("refinements", "computed again more closely: ")):
        if ds.attrs.get(key):
            out.append(what + str(ds.attrs[key]))
    measured, given = ds.attrs.get("input_error"), ds.attrs.get("measured_error", 0.0)
    if measured is not None and float(measured) > max(float(given), 1e-6):
        out.append(
            f"the digits of the trajectory leave {float(measured):.1e} of the largest value in doubt, more than the "
            "method does"
        )
    for name in ds.data_vars:
        if str(name).endswith("_correlated") and bool(ds[name].values.any()):
            out.append("the standard errors are lower bounds where blocks of frames still correlate")
            break
    return list(dict.fromkeys(out))


def _errors(ds) -> str:
    rows = []
    for name, da in ds.data_vars.items():
        if not any(key in da.attrs for key, *_ in _ERRORS):
            continue
        row = [name, da.attrs.get("units", "")]
        row += [f"{float(da.attrs[key]):.1e}" if key in da.attrs else "" for key, *_ in _ERRORS]
        statistical = ""
        if f"{name}_stderr" in ds:
            size = float(np.nanmax(np.abs(da.values), initial=0.0))
            e = ds[f"{name}_stderr"].values
            e = e[np.isfinite(e)]
            if len(e) and size > 0:
                statistical = f"{float(np.sqrt((e**2).mean())) / size:.1e}"
        rows.append([*row, statistical])
    head = ["field", "unit", *(title for _, title, _ in _ERRORS), "statistical"]
    notes = [f"{title}: {what}" for _, title, what in _ERRORS]
    notes.append("statistical: rms standard error of the time average, over the largest value")
    return table(rows, head, numbers=range(2, len(head))) + f'<p class="sub">{escape("; ".join(notes))}.</p>'


# --- pictures


def _pictures(ds) -> list[str]:

    names, out, drawn = fields_of(ds), [], set()
    wanted = [p for p in PICTURES if p[0] in names and not (p[0] == "stress_potential" and "stress" in names)
              and not (p[0] == "number_density" and "density" in names)]  # fmt: skip
    known = {p[0] for p in PICTURES}
    others = [n for n in names if n not in known and not n.endswith(("_kinetic", "_potential", "_churning"))]
    wanted += [(n, {0: None, 1: "magnitude", 2: None}[rank(ds[n])], {}) for n in others
               if not n.startswith(("smoothed_virial", "column:"))][: max(0, _MOST - len(wanted))]  # fmt: skip
    wanted += [(n, None, {}) for n in others if n.startswith("column:")][:2]
    for name, comp, over in wanted:
        if (name, comp) in drawn:
            continue
        drawn.add((name, comp))
        try:
            fig = plot(ds, name, component=comp, **over)
        except AtcError:
            try:  # over maps only
                fig = plot(ds, name, component=comp)
            except AtcError:
                continue
        said = str(ds[name].attrs.get("long_name", name))
        out.append(figure_of(fig, f"{said[:1].upper()}{said[1:]}" + (f", {comp}" if comp else "")))
    return out or ["<p>There is no field on a grid to draw.</p>"]


def _profile(ds) -> list[str]:
    """Means over the cross-sections along the longest axis of a grid, of the first stress and the density."""
    names = fields_of(ds)
    name = next((n for n in ("stress", "stress_potential", *names) if n in names), None)
    if name is None:
        return []
    place = points_of_grid(ds, ds[name])
    if place.kind not in ("volume", "plane"):
        return []
    lengths = [np.linalg.norm(s) * n for s, n in zip(place.steps, place.x_gc.shape)]
    k = int(np.argmax(lengths))
    others = [d for d in place.dims if d != place.dims[k]]
    shown = [n for n in (name, "density", "number_density", "temperature") if n in names][:3]
    fig, axs = figure(len(shown), 4.2, 3.0)
    s, text = place.abscissa(k)
    for ax, n in zip(axs, shown):
        da = ds[n].mean("frame", skipna=True) if "frame" in ds[n].dims else ds[n]
        tensor = "j" in da.dims
        # Empty space counts as empty in a stress or density, but has no temperature.
        mean = da.mean(others, skipna=True) if n == "temperature" else da.fillna(0.0).mean(others)
        mean = mean.transpose(place.dims[k], ...).values
        for c in ("xx", "yy", "zz") if tensor else (None,):
            ax.plot(s, component(mean, c), label=None if c is None else symbol(n, c) or c)
        ax.set_xlabel(text)
        ax.set_ylabel(label_of(ds[n], None))
        ax.spines[["top", "right"]].set_visible(False)
        if tensor:
            ax.legend()
    words = f"Profiles along {place.dims[k]}: means over the cross-section, empty space counted as empty"
    return [figure_of(fig, words)]


def _compared(ds) -> list[str]:
    """Hardy's stress against the virial stress, where the output has both."""
    try:
        found = compare(ds)
    except AtcError:
        return []
    out = ["<h2>Hardy against virial</h2>"]
    with contextlib.suppress(AtcError):
        words = "Hardy's stress, the virial stress, and their difference in one scale"
        out.append(figure_of(compare_figure(found), words))
    for section, head, rows in found.tables():
        if section != ACCURACY:
            out.append(table(rows, head, section, numbers=range(1, len(head))))
    return out + [f"<p>{escape(n)}.</p>" for n in found.notes]
