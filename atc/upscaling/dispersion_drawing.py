"""The picture of a dispersion: bands along rays, or along a path with the names of its points."""

from __future__ import annotations

from textwrap import wrap

import numpy as np

from .force_constants import frequency_unit

#: Of the models, in the order they are named.
_STYLES = ("--", "-.", ":", (0, (5, 1)))


def figure(found):
    """A matplotlib Figure of a `dispersion_result.Dispersion`."""
    from matplotlib.figure import Figure

    unit, factor = frequency_unit(found.crystal.units)
    rays = found.rays
    on_path = rays[0].ends is not None
    if on_path:
        width = max(6.0, 1.3 * len(rays) + 2.0)
        shares = {"width_ratios": [ray.boundary for ray in rays]}
    else:
        width, shares = 4.0 * len(rays) + 1.2, {}
    compared = [name for name in rays[0].models if rays[0].lattice_km is not None]
    picture = Figure(figsize=(width, 7.0 if compared else 5.2), layout="constrained")
    if on_path:
        picture.get_layout_engine().set(w_pad=0.0, wspace=0.0, rect=(0.012, 0.0, 0.976, 1.0))
    rows = {"nrows": 2, "height_ratios": [3, 1]} if compared else {}
    every = picture.subplots(**rows, ncols=len(rays), sharey="row", squeeze=False, **shares)
    panels = every[0]
    for a, (axes, ray) in enumerate(zip(every[1], rays) if compared else ()):
        _differences(axes, ray)
        if on_path:
            _ends(axes, rays, a)
        else:
            axes.set_xlabel(f"k along {ray.label} / zone boundary")
    if compared:
        every[1, 0].set_ylabel("PD − lattice (%)")
        _limit(every[1, 0], rays)
    top = 0.0
    for a, (axes, ray) in enumerate(zip(panels, rays)):
        top = max(top, _bands(axes, ray, factor), _measured(axes, found, a, factor))
        axes.axhline(0.0, color="0.7", linewidth=0.8, zorder=0)
        if on_path:
            _ends(axes, rays, a)
        else:
            axes.set_xlabel(f"k along {ray.label} / zone boundary")
    low = min((factor * ray.lattice_km.min() for ray in rays if ray.lattice_km is not None), default=0.0)
    panels[0].set_ylim(min(1.1 * low, 0.0), 1.15 * top or None)
    panels[0].set_ylabel(f"frequency ({unit})")
    for a, axes in enumerate(panels if on_path else ()):
        _energy(axes, found, a, factor)
    handles = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    picture.legend(handles.values(), handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    title = f"{found.crystal.name}, a = {found.crystal.lattice_constant:.5g} {found.crystal.units.label('length')}"
    if found.measured is not None:
        title += f"; trajectory at {found.measured.temperature:.3g} {found.crystal.units.label('temperature')}"
    if found.folded:
        title += "\n" + "\n".join(wrap(found.folded, int(12 * width)))
    picture.suptitle(title)
    return picture


def _bands(axes, ray, factor) -> float:
    """Lattice, phonopy and models of one ray; the highest frequency."""
    top = 0.0
    if ray.lattice_km is not None:
        axes.plot(ray.fractions, factor * ray.lattice_km, color="black", linewidth=1.6, label="lattice")
        top = factor * ray.lattice_km.max()
    if ray.phonopy_km is not None:
        axes.plot(ray.fractions[::3], factor * ray.phonopy_km[::3], ".", color="0.5", markersize=4, label="phonopy")
    for m, (name, values) in enumerate(ray.models.items()):
        style = {"color": f"C{m}", "linewidth": 1.0, "linestyle": _STYLES[m % 4]}
        axes.plot(ray.fractions, factor * values, **style, label=name)
    return top


def _differences(axes, ray) -> None:
    """How far each model is from the lattice, every branch, in per cent."""
    axes.axhline(0.0, color="black", linewidth=1.0)
    for m, name in enumerate(ray.models):
        axes.plot(ray.fractions, 100 * ray.difference(name), color=f"C{m}", linewidth=1.0, linestyle=_STYLES[m % 4])


def _limit(axes, rays) -> None:
    """What is drawn of the differences: all of them, but no more than 100 % either way."""
    worst = max((np.nanmax(np.abs(r.difference(n)), initial=0.0) for r in rays for n in r.models), default=0.0)
    top = min(105.0 * max(float(worst), 1e-3), 100.0)
    axes.set_ylim(-top, top)


def _measured(axes, found, a, factor) -> float:
    """Points of the trajectory on ray number a, and the widths of its lines as bars of their own; the highest."""
    r, top = found.measured, 0.0
    if r is None:
        return top
    here = r.ray_k == a
    for kind, marker, color in (("ratio", "o", "C3"), ("spectrum", "x", "C0")):
        y, e = (factor * getattr(r, f"{kind}{s}_km")[here] for s in ("", "_error"))
        x = np.repeat(r.fraction_k[here], y.shape[1])
        label = {"ratio": "trajectory: velocities/displacements", "spectrum": "trajectory: spectra"}[kind]
        how = {"markersize": 5, "markerfacecolor": "none", "capsize": 2, "linewidth": 0.9, "zorder": 3}
        axes.errorbar(x, y.ravel(), yerr=e.ravel(), fmt=marker, color=color, label=label, **how)
        top = max(top, np.nanmax(y, initial=0.0))
    if r.lines_km is not None and here.any():
        rows = [(r.fraction_k[p], x) for p in np.flatnonzero(here) for x in r.lines_km[p] if np.isfinite(x.gamma)]
        if rows:
            at, low, high = np.array([(f, x.omega - 0.5 * x.gamma, x.omega + 0.5 * x.gamma) for f, x in rows]).T
            axes.vlines(at, factor * low, factor * high, color="C1", linewidth=4, alpha=0.6, label="full width γ/2π")
    return top


def _energy(axes, found, a, factor) -> None:
    """The spectral energy density of the wave vectors on ray number a, as shades between them."""
    r = found.measured
    if r is None or r.sed_kf is None or (r.ray_k == a).sum() < 2:
        return
    x, sed = r.fraction_k[r.ray_k == a], r.sed_kf[r.ray_k == a]
    between = 0.5 * (x[1:] + x[:-1])
    edges = np.concatenate([[max(x[0] - (between[0] - x[0]), 0.0)], between, [min(2 * x[-1] - between[-1], 1.0)]])
    f = factor * r.frequency_f
    shade = np.log10(np.maximum(sed, 1e-6 * sed.max()))
    rows = np.concatenate([f - 0.5 * f[1], [f[-1] + 0.5 * f[1]]])
    axes.pcolormesh(edges, rows, shade.T, cmap="Greys", vmin=shade.max() - 2.5, vmax=shade.max() + 1, zorder=-1)


def _ends(axes, rays, a) -> None:
    """The names of a piece's two points; both where two pieces do not meet."""
    first, last = rays[a].ends
    if a > 0 and rays[a - 1].ends[1] != first:
        first = f"{rays[a - 1].ends[1]}|{first}"
    final = a == len(rays) - 1
    axes.set_xticks([0.0, 1.0] if final else [0.0], [first, last] if final else [first])
    axes.set_xlim(0.0, 1.0)
    if a > 0:
        axes.tick_params(axis="y", left=False)
