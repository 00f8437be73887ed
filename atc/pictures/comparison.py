"""Pictures of `atc compare`: Hardy's stress beside the virial's, and the trend of their difference over several
results."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .components import SYMBOL, component
from .drawing import STYLE, colours, draw_map, figure, titled
from .geometry import PROFILES, cut, with_unit
from .symbols import symbol


def compare_figure(result):
    """The picture of a `Comparison`: profiles of both stresses and their difference, or the trend over several
    results."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        several = "radius" in result.data.dims or "output" in result.data.dims
        return (_trend if several else _against)(result)


def _trend(result):
    dim = "radius" if "radius" in result.data.dims else "output"
    fig, (ax,) = figure(1, 5.2, 3.4)
    x = result.data[dim].values
    at = x if dim == "radius" else np.arange(len(x))
    styles = {"rms": ("-", "o"), "max": ("--", "s")}
    for k, c in enumerate(("hydrostatic", "vonmises")):
        for how, (line, marker) in styles.items():
            name = f"relative_{how}_{c}"
            if name in result.data:
                values, label = 100 * result.data[name].values, f"{SYMBOL[c]}, {how}"
                ax.plot(at, values, line, marker=marker, ms=4, color=f"C{k}", label=label)
    if dim == "radius":
        ax.set_xlabel(with_unit("kernel radius", result.attrs.get("radius_units")))
        ax.set_xlim(0, at.max() * 1.05)
    else:
        ax.set_xticks(at, [str(v).split(",")[0] for v in x], rotation=20, ha="right")
    ax.set_ylabel("Hardy - smoothed virial\n(% of the largest component)")
    ax.set_ylim(bottom=0)
    ax.legend()
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(result.title or "Hardy and virial stress")
    return fig


def _against(result):
    """Box averages, for each axis the profiles of Hardy (full lines), smoothed virial (dashed) and of the run's own
    stress/atom (dotted), and maps of both stresses and their difference in one scale."""
    data, place = result.data, result.place
    axes = [n.removeprefix("profile_").removesuffix("_hardy") for n in data.data_vars if n.endswith("_hardy")]
    boxes = [r for r in result.rows if r["section"].startswith("box average")]
    boxes = [r for r in boxes if r["section"] == "box average"] or boxes
    maps, where = [], ""
    if "difference" in data and place.kind not in PROFILES:
        selection = {}
        if place.kind == "volume":
            place, selection, where = cut(place)
        maps = [(w, c) for c in ("hydrostatic", "vonmises") for w in ("hardy", "virial", "column") if w in data]
        maps += [("difference", c) for c in ("hydrostatic", "vonmises")]
        shown = {}
        for w, c in maps:
            if w == "difference":  # of the scalars, not the scalar of the difference
                shown[w, c] = shown["hardy", c] - shown["virial", c]
            else:
                shown[w, c] = component(data[w].isel(selection).values, c, result.dimension)
                shown[w, c] = np.where(np.isfinite(shown["hardy", c]), shown[w, c], np.nan)
        maps.sort(key=lambda m: ("hydrostatic", "vonmises").index(m[1]))
        maps = [m for m in maps if np.isfinite(shown[m]).any()]
    panels = bool(boxes) + len(axes) + len(maps)
    if not panels:
        raise AtcError("there is nothing to draw: neither box averages nor pointwise differences could be compared")
    # The maps of one scalar side by side, in rows of their own.
    columns = max(3, sum(c == maps[0][1] for _, c in maps)) if maps else 3
    curves = bool(boxes) + len(axes)
    blank = -curves % columns if maps else 0
    fig, axs = figure(panels + blank, 3.9, 2.9, columns)
    for ax in axs[curves : curves + blank]:
        ax.remove()
    axs = axs[:curves] + axs[curves + blank :]
    units = with_unit("", result.units)
    if boxes:
        ax = axs.pop(0)
        at = np.arange(len(boxes))
        errors = [r.get("stderr_virial") or 0 for r in boxes]
        ax.bar(at - 0.2, [r["hardy"] for r in boxes], 0.4, label="Hardy", color="C0")
        errors = errors if any(errors) else None
        ax.bar(at + 0.2, [r["virial"] for r in boxes], 0.4, label="virial", color="C1", yerr=errors)
        short = {"hydrostatic": "mean", "vonmises": "Mises"}
        ax.set_xticks(at, [short.get(r["name"], r["name"]) for r in boxes], fontsize=8)
        ax.axhline(0, color="0.4", lw=0.6)
        ax.set_title(f"average over the box{units}")
        ax.legend()
    for dim in axes:
        ax = axs.pop(0)
        x = data[f"profile_{dim}_position"]
        for c, colour in zip(("hydrostatic", "xx", "yy", "zz", "vonmises"), ("k", "C0", "C1", "C2", "C3")):
            if c == "zz" and result.dimension == 2:
                continue
            h, v = (component(data[f"profile_{dim}_{w}"].values, c, result.dimension) for w in ("hardy", "virial"))
            ax.plot(x.values, h, color=colour, label=symbol("stress", c))
            ax.plot(x.values, v, color=colour, ls=(0, (3, 2)), lw=1.0)
            if f"profile_{dim}_column" in data:
                own = component(data[f"profile_{dim}_column"].values, c, result.dimension)
                ax.plot(x.values, own, color=colour, ls=":", lw=1.6)
        ax.set_xlabel(x.attrs.get("label", dim))
        ax.set_ylabel(f"stress{units}")
        ax.set_title("mean over the other axes" if len(axes) > 1 else "profile")
        ax.set_xlim(x.values.min(), x.values.max())
        lines = ax.get_legend_handles_labels()
    for ax in fig.axes:
        ax.spines[["top", "right"]].set_visible(False)
    words = {
        "hardy": "Hardy",
        "virial": "smoothed virial",
        "column": f"smoothed {result.attrs.get('column', '')} of the run",
        "difference": "Hardy - smoothed virial",
    }
    for w, c in maps:
        # One scale for all of one scalar: what is large is seen to be large.
        together = np.concatenate([np.ravel(shown[m]) for m in maps if m[1] == c and m[0] != "difference"])
        signed = c == "hydrostatic" or w == "difference"
        _, low, high, _ = colours("", "hydrostatic", together, None, None)
        scale = (low, high) if signed else (0.0, high)
        painted = colours("", "hydrostatic" if signed else c, shown[w, c], scale, False)
        title = f"{words[w]}, {symbol('stress', c)}{units}"
        second = [where] if where else []
        if w == "difference":
            second.append(f"largest {np.nanmax(np.abs(shown[w, c])):.2g}")
        draw_map(fig, axs.pop(0), place, place.flat(), shown[w, c], *painted, "\n".join([title, ", ".join(second)]))
    if axes:
        own = f", dotted: {result.attrs['column']} of the run" if "column" in result.attrs else ""
        said = f"profiles: full Hardy, dashed smoothed virial{own}"
        fig.legend(*lines, loc="outside lower center", ncols=5, title=said, title_fontsize=8)
    titled(fig, result.title.replace("angstrom", "Å"))
    return fig
