"""The page of a run and its peridynamic twin: what was made of what, the material and what it gets, pictures, norms
against the run's own noise, warnings."""

from __future__ import annotations

from html import escape

import numpy as np

from ..errors import AtcError
from ..pictures.drawing import STYLE
from ..pictures.twins import drawn, histories, profiles
from .accessor import VOIGT
from .html import document, facts, figure_of, scene_of, table, warned_of

_WHERE = {
    "matter": "both have at least half of the crystal's density",
    "interior": "both have 95 % of it",
    "deep": "no node within the kernel's radius feels a surface",
}
#: The lines of a twin that are of its material, by how they begin.
_MATERIAL = ("material", "exact", "not exact", "energy", "temperature", "fracture", "the nodes' elastic", "stable step")


def twin_page(ds, title: str, warned=()) -> str:
    """The HTML text for a dataset of `atc.twin`."""
    lines = [line for line in str(ds.attrs["twin"]).splitlines() if line]
    of_material = [line for line in lines if line.startswith(_MATERIAL)]
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="sub">A molecular-dynamics run and its peridynamic twin, by atc '
        f"{escape(str(ds.attrs.get('atc_version', '')))}</p>",
        "<h2>In short</h2>",
        _short(ds),
        *warned_of(_warnings(ds, warned)),
        "<h2>Body and conditions</h2>",
        facts([_split(line) for line in lines if line not in of_material] + _run(ds)),
        "<h2>Material</h2>",
        facts([_split(line) for line in of_material]),
        *_constants(ds),
        "<h2>Side by side</h2>",
        *_pictures(ds),
        "<h2>How far apart</h2>",
        *_norms(ds),
        *scene_of(ds),
    ]
    return document(title, body)


def _split(line) -> tuple[str, str]:
    head, colon, rest = line.partition(": ")
    return (head, rest) if colon else ("", line)


def _unit(ds, name) -> str:
    return _plain(str(ds[name].attrs.get("units", "")))


def _plain(units: str) -> str:
    return "" if units == "1" else units.replace("angstrom", "Å").replace("^2", "²").replace("^3", "³")


def _run(ds) -> list:
    n = ds.sizes["frame"]
    rows = [("frames", str(n))]
    if "time" in ds.coords and np.isfinite(ds["time"].values).all():
        t = ds["time"].values
        rows = [("frames", f"{n}, {t[0]:.5g} to {t[-1]:.5g} {_unit(ds, 'time')}")]
    return rows + [(key, ds.attrs[key]) for key in ("kernel", "grid") if ds.attrs.get(key)]


def _short(ds) -> str:
    """The numbers that one asks for first."""
    rows = []
    for k, c in enumerate("xyz"):
        md, pd = (ds[f"{s}_box_stress"].values[:, k, k] for s in ("md", "pd"))
        size = max(np.abs(ds["md_box_stress"].values.mean(0)).max(), 1e-300)
        error = md.std(ddof=1) / len(md) ** 0.5 if len(md) > 1 else np.nan
        what = f"mean stress of the box, {c}{c} ({_unit(ds, 'md_box_stress')})"
        off = f"{100 * (pd.mean() - md.mean()) / size:+.2g} % of the largest"
        rows.append([what, f"{md.mean():.5g}", f"{pd.mean():.5g}", off, f"{error:.2g}"])
    for name, what in (
        ("damage_of_body", "bonds lost at the end, share"),
        ("crack_tip", "crack's tip at the end"),
        ("crack_area", "cracked area at the end"),
    ):
        if f"md_{name}" in ds:
            md, pd = (float(ds[f"{s}_{name}"].values[-1]) for s in ("md", "pd"))
            unit = _unit(ds, f"md_{name}")
            rows.append([what + (f" ({unit})" if unit else ""), f"{md:.4g}", f"{pd:.4g}", "", ""])
    if "pd_dissipated_energy" in ds:
        unit = _unit(ds, "pd_dissipated_energy")
        lost = f"{float(ds['pd_dissipated_energy'][-1]):.4g}"
        rows.append([f"energy that went with broken bonds ({unit})", "", lost, "", ""])
    return table(rows, ["", "MD", "PD", "PD - MD", "MD's standard error"], numbers=(1, 2, 3, 4))


def _warnings(ds, warned) -> list[str]:
    said = [*map(str, warned), *str(ds.attrs.get("warnings", "")).splitlines()]
    if ds.sizes["frame"] == 1:
        said.append("there is one frame: the run's own noise is not known, and no difference can be held against it")
    return list(dict.fromkeys(s for s in said if s))


def _percent(value) -> str:
    return "" if not np.isfinite(value) else "0" if abs(value) < 5e-4 else f"{value:+.2g}"


def _constants(ds) -> list[str]:
    """Elastic constants of the crystal, of the material, and of its nodes."""
    if "elastic_crystal" not in ds:
        return []
    unit = _unit(ds, "elastic_crystal")
    columns = [("crystal", ds["elastic_crystal"].values)]
    for name, head in (("elastic_material", "material"), ("elastic_nodes", "its nodes")):
        if name in ds:
            columns.append((head, ds[name].values))
    size = max(np.abs(v).max() for _, v in columns)
    rows = []
    for a in range(6):
        for b in range(a, 6):
            values = [v[a, b] for _, v in columns]
            if max(map(abs, values)) < 1e-6 * size:
                continue
            off = 100 * (values[-1] / values[0] - 1) if abs(values[0]) > 1e-6 * size else np.nan
            rows.append([f"C {VOIGT[a]},{VOIGT[b]}", *(f"{v:.5g}" for v in values), _percent(off)])
    head = [f"({unit})", *(h for h, _ in columns), "last against crystal, %"]
    note = "" if "elastic_nodes" in ds else "<p>The nodes carry the atoms, and with them the crystal's constants.</p>"
    return [table(rows, head, "Elastic constants along the run's axes", numbers=range(1, len(head))), note]


def _pictures(ds) -> list[str]:
    import matplotlib as mpl

    out, n = [], ds.sizes["frame"]
    of = "the frame" if n == 1 else f"means of {n} frames"
    with mpl.rc_context(STYLE):
        for make, words in (
            (lambda: drawn(ds, ""), f"MD, PD and their difference, {of}; empty where there is no matter"),
            (lambda: profiles(ds), f"Profiles of both, {of}, over the cross-section's matter; the band is the MD's "
             "standard error"),
            (lambda: drawn(ds.isel(frame=[-1]), ""), "The same maps of the last frame" if n > 1 else ""),
            (lambda: histories(ds), "Over time"),
        ):  # fmt: skip
            try:
                fig = make() if words else None
            except AtcError:  # grids that no map is of
                continue
            if fig is not None:
                out.append(figure_of(fig, words))
    return out or ["<p>There is no field on a grid to draw.</p>"]


def _norms(ds) -> list[str]:
    if "norm_points" not in ds:
        return []
    rows = []
    for field in ds["norm_field"].values:
        for where in ds["norm_where"].values:
            at = {k: float(ds[f"norm_{k}"].sel(norm_field=field, norm_where=where)) for k in NORMS}
            if not at["points"] > 0:
                continue
            unit = _unit(ds, f"md_{field}")
            noise = at["difference_rms"] / at["md_standard_error"] if at["md_standard_error"] > 0 else np.nan
            rows.append(
                [field + (f" ({unit})" if unit else ""), where, f"{at['points']:.0f}"]
                + [f"{at[k]:.4g}" for k in ("md_rms", "pd_rms", "difference_rms")]
                + [f"{100 * at['relative']:.3g}" if np.isfinite(at["relative"]) else ""]
                + [f"{at['md_standard_error']:.3g}" if np.isfinite(at["md_standard_error"]) else ""]
                + [f"{noise:.3g}" if np.isfinite(noise) else ""]
            )
    head = ["field", "where", "points", "MD rms", "PD rms", "PD − MD rms", "of MD, %", "MD's standard error"]
    words = "; ".join(f"{k}: {v}" for k, v in _WHERE.items())
    return [
        table(rows, [*head, "difference in standard errors"], numbers=range(2, 9)),
        f'<p class="sub">rms over components and points of the means over the frames. {escape(words)}. Below one '
        "standard error of the MD no difference means anything; it takes the frames for independent.</p>",
    ]


#: The norms in a dataset of `atc.twin`, as norm_NAME.
NORMS = ("points", "md_rms", "pd_rms", "difference_rms", "relative", "md_standard_error")
