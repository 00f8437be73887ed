"""The page of a run and its peridynamic twin: what was made of what, the material and what it gets, pictures, norms
against the run's own noise, warnings."""

from __future__ import annotations

from html import escape

import numpy as np

from ..errors import AtcError
from ..pictures.drawing import STYLE
from ..pictures.twins import at_nodes, drawn, histories, over_line, profiles, shown_frames
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
    rows = [("the twin's run", ds.attrs["cost"])] if ds.attrs.get("cost") else []
    frames = str(n)
    if "time" in ds.coords and np.isfinite(ds["time"].values).all():
        t = ds["time"].values
        frames = f"{n}, {t[0]:.5g} to {t[-1]:.5g} {_unit(ds, 'time')}"
    return [*rows, ("frames", frames)] + [(key, ds.attrs[key]) for key in ("kernel", "grid") if ds.attrs.get(key)]


def _short(ds) -> str:
    """The numbers that one asks for first."""
    rows = []
    moving = _each_frame(ds)
    stiff = np.abs(ds["elastic_crystal"].values).max() if "elastic_crystal" in ds else 0.0
    size = np.abs(ds["md_box_stress"].values.mean(0)).max()
    for k, c in enumerate("xyz"[: ds["md_displacement"].sizes.get("i", 3)]):
        md, pd = (ds[f"{s}_box_stress"].values[:, k, k] for s in ("md", "pd"))
        error = md.std(ddof=1) / len(md) ** 0.5 if len(md) > 1 and not moving else np.nan
        what = f"mean stress of the box, {c}{c} ({_unit(ds, 'md_box_stress')})"
        off = f"{pd.mean() - md.mean():+.3g}"
        if size > 1e-6 * stiff and size > 0:  # else rounding and what is of second order
            off += f", {100 * (pd.mean() - md.mean()) / size:+.2g} % of the largest"
        rows.append([what, f"{md.mean():.5g}", f"{pd.mean():.5g}", off, f"{error:.2g}" if error == error else ""])
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
            shown = (f"{v:.5g}" if abs(v) > 1e-9 * size else "0" for v in values)
            rows.append([f"C {VOIGT[a]},{VOIGT[b]}", *shown, _percent(off)])
    head = [f"({unit})", *(h for h, _ in columns), "last against crystal, %"]
    note = "" if "elastic_nodes" in ds else "<p>The nodes carry the atoms, and with them the crystal's constants.</p>"
    return [table(rows, head, "Elastic constants along the run's axes", numbers=range(1, len(head))), note]


def _each_frame(ds) -> bool:
    """Whether the fields of the run move, so that its frames are compared one by one."""
    return str(ds.attrs.get("norms", "")).startswith("of every frame")


def _pictures(ds) -> list[str]:
    import matplotlib as mpl

    out, n, moments = [], ds.sizes["frame"], shown_frames(ds)
    of = "the frame" if n == 1 else f"means of {n} frames"
    empty = "empty where there is no matter"
    if moments:
        line = (
            "Both along the line. On the grid the twin's fields are smoothed once more than the atoms', which short "
            "waves feel: compare those at the nodes"
        )
        nodes = "At the nodes: the run (smoothed once), the twin and the classical wave equation"
        fields = [
            (lambda: over_line(ds, ""), line),
            (lambda: drawn(ds, "", frames=moments), f"MD, PD and their difference, half-way and at the end; {empty}"),
            (lambda: at_nodes(ds), nodes),
        ]
    else:
        band = "the band is the MD's standard error"
        fields = [
            (lambda: drawn(ds, ""), f"MD, PD and their difference, {of}; {empty}"),
            (lambda: profiles(ds), f"Profiles of both, {of}, over the cross-section's matter; {band}"),
            (lambda: drawn(ds, "", frames=[-1]), "The same maps of the last frame" if n > 1 else ""),
        ]
    with mpl.rc_context(STYLE):
        for make, words in (*fields, (lambda: histories(ds), "Over time")):
            try:
                fig = make() if words else None
            except AtcError:  # grids that it is not of
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
    if _each_frame(ds):
        rows = [row[:7] for row in rows]
        of = "components, points and frames, each frame with its own"
        floor = "The run's thermal motion is in it; its own error needs several runs."
    else:
        head.append("difference in standard errors")
        of = "components and points of the means over the frames"
        floor = "Below one standard error of the MD no difference means anything; it takes the frames for independent."
    floor += (
        " Energy is counted from that of the crystal at rest: that of vibrations and of surfaces is in the MD's only."
    )
    return [
        table(rows, head[: len(rows[0])] if rows else head, numbers=range(2, 9)),
        f'<p class="sub">rms over {of}. {escape(words)}. {floor}</p>',
    ]


#: The norms in a dataset of `atc.twin`, as norm_NAME.
NORMS = ("points", "md_rms", "pd_rms", "difference_rms", "relative", "md_standard_error")
