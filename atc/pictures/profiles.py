"""Curves of fields beside each other along the axes of their grid."""

from __future__ import annotations

import numpy as np

from .drawing import STYLE, figure, titled
from .geometry import with_unit


def profiles_figure(curves, title: str):
    """A panel for each field and axis: means over the other axes.

    curves : [(name, {label: xarray.DataArray})], arrays of one field on the same points
    """
    import matplotlib as mpl

    panels = [(name, arrays, d) for name, arrays in curves for d in _axes(next(iter(arrays.values())))]
    with mpl.rc_context(STYLE):
        fig, axs = figure(len(panels), 3.6, 2.8)
        for (_, arrays, dim), ax in zip(panels, axs):
            for k, (label, da) in enumerate(arrays.items()):
                x = da[dim].values if dim in da.coords else np.arange(da.sizes[dim])
                y = da.mean([d for d in da.dims if d != dim]).values
                line, marker = "-" if k == 0 else (0, (4, 2)), "o" if len(x) < 3 else ""
                ax.plot(x, y, color=f"C{k}", ls=line, marker=marker, label=label)
            ax.set_xlabel(with_unit(dim, da[dim].attrs.get("units") if dim in da.coords else ""))
            ax.set_ylabel(with_unit(da.attrs.get("long_name", ""), da.attrs.get("units")))
            ax.spines[["top", "right"]].set_visible(False)
        axs[0].legend()
        titled(fig, title)
    return fig


def _axes(da):
    """The dimensions with more than one point; the first, if there is none."""
    return [d for d in da.dims if da.sizes[d] > 1] or list(da.dims[:1])
