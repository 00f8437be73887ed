"""Over maps: vector fields as arrows or streamlines, principal values of tensors as crosses, and what grey means."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .drawing import at_frame, wrapped
from .geometry import fields_of, grid_dims, rank, unit_text
from .symbols import symbol

#: Arrows or crosses along the longer side.
_ALONG = 26


class Overlays:
    """What is drawn over each map of a picture.

    Parameters
    ----------
    ds : output; place : Layout of the plane or the points; selection : what cuts it from the output
    arrows, streamlines : names of vector fields; principal : name of a tensor field; or None
    one_scale : lengths as for all frames

    Raises
    ------
    AtcError for fields that are not there, or of another kind.
    """

    def __init__(self, ds, place, selection, frame, dimension, arrows=None, streamlines=None, principal=None,
                 one_scale=False):  # fmt: skip
        self.place, self.notes, self.one_scale = place, [], one_scale
        self.arrows = self._vectors(ds, arrows, 1, selection, frame)
        self.lines = self._vectors(ds, streamlines, 1, selection, frame)
        self.crosses = self._vectors(ds, principal, 2, selection, frame)
        if self.lines is not None and place.kind != "plane":
            raise AtcError(f"streamlines need a plane of a grid: this output is on {place.kind}: take arrows")

    def _vectors(self, ds, name, order, selection, frame):
        if name is None:
            return None
        if name not in ds or name not in fields_of(ds) or rank(ds[name]) != order:
            what = "vector" if order == 1 else "tensor"
            have = [n for n in fields_of(ds) if rank(ds[n]) == order]
            raise AtcError(f"{name}: is no {what} field of this output: it holds {', '.join(have) or 'none'}")
        da, _ = at_frame(ds, name, frame)
        da = da.transpose(*grid_dims(da), ...).isel(selection)
        every = ds[name].transpose(..., *da.dims).isel(selection) if self.one_scale else da
        return name, unit_text(da.attrs.get("units", "")), da.values, every.values

    def __bool__(self):
        return any(x is not None for x in (self.arrows, self.lines, self.crosses))

    def draw(self, ax, drawn_as) -> None:
        """Over one map; drawn_as : what `Layout.flat` gives"""
        flat, _, basis, _ = drawn_as
        self.notes = []
        if not self:
            return
        if self.place.kind == "plane":
            middle = 0.25 * (flat[1:, 1:] + flat[:-1, 1:] + flat[1:, :-1] + flat[:-1, :-1])
        else:
            middle = flat
        if self.arrows is not None:
            self._draw_arrows(ax, middle, basis)
        if self.lines is not None:
            self._draw_lines(ax, middle, basis)
        if self.crosses is not None:
            self._draw_crosses(ax, middle, basis)

    def _thinned(self, middle, values):
        """Some of the points, evenly, and the values there."""
        if self.place.kind == "plane":
            every = max(1, -(-max(middle.shape[:2]) // _ALONG))
            part = (slice(every // 2, None, every),) * 2
            return middle[part].reshape(-1, 2), values[part].reshape(-1, *values.shape[2:])
        every = max(1, len(middle) // _ALONG**2)
        return middle[::every], values[::every]

    def _draw_arrows(self, ax, middle, basis):
        name, unit, v, every = self.arrows
        at, v = self._thinned(middle, v @ basis[:2].T)
        size = np.linalg.norm(v, axis=-1)
        good = np.isfinite(size)
        if not good.any() or not size[good].max() > 0:
            return
        # Arrows of the usual size reach the next one; those of singular places are cut to it.
        usual = np.linalg.norm(every @ basis[:2].T, axis=-1) if self.one_scale else size
        usual = max(np.nanpercentile(usual, 95), 1e-300)
        v = v / np.maximum(size, usual)[:, None]
        step = np.sqrt(np.prod(np.ptp(at, axis=0)) / max(len(at), 1))
        ax.quiver(*at[good].T, *v[good].T, angles="xy", scale_units="xy", scale=1.0 / (0.95 * step), pivot="mid",
                  width=0.0035, color="w", edgecolor="k", linewidth=0.5)  # fmt: skip
        self.notes.append(f"arrows: {symbol(name) or name}, the longest {usual:.3g} {unit}".strip())

    def _draw_lines(self, ax, middle, basis):
        name, _, v, _ = self.lines
        x, y = middle[:, 0, 0], middle[0, :, 1]
        straight = np.allclose(middle[..., 0], x[:, None]) and np.allclose(middle[..., 1], y[None, :])
        if not straight or min(len(x), len(y)) < 2:
            raise AtcError("streamlines need a plane along Cartesian axes: take arrows")
        w = np.ma.masked_invalid(v @ basis[:2].T)
        # matplotlib wants evenly spaced coordinates to the last digit
        x, y = np.linspace(x[0], x[-1], len(x)), np.linspace(y[0], y[-1], len(y))
        size = np.sqrt((w**2).sum(-1)).T
        width = 0.4 + 1.2 * (size / (size.max() or 1.0)).filled(0.0)
        ax.streamplot(x, y, w[..., 0].T, w[..., 1].T, color="k", linewidth=width, density=1.1, arrowsize=0.7)
        self.notes.append(f"lines: along {symbol(name) or name}, thicker where it is larger")

    def _draw_crosses(self, ax, middle, basis):
        from matplotlib.collections import LineCollection
        from matplotlib.patheffects import withStroke

        name, unit, s, every = self.crosses
        turned = lambda s: np.einsum("ai,...ij,bj->...ab", basis[:2], 0.5 * (s + np.swapaxes(s, -1, -2)), basis[:2])  # noqa: E731
        in_plane = turned(s)
        at, t = self._thinned(middle, in_plane)
        good = np.isfinite(t).all(axis=(-1, -2))
        at, t = at[good], t[good]
        if not len(at):
            return
        values, vectors = np.linalg.eigh(t)
        usual = values
        if self.one_scale:
            t = turned(every)
            usual = np.linalg.eigvalsh(t[np.isfinite(t).all(axis=(-1, -2))])
        usual = max(np.percentile(np.abs(usual), 97), 1e-300)
        step = np.sqrt(np.prod(np.ptp(at, axis=0)) / max(len(at), 1))
        for sign, colour in ((1, "#b2182b"), (-1, "#2166ac")):
            segments = []
            for k in range(2):
                mine = np.sign(values[:, k]) == sign
                half = 0.48 * step * np.minimum(np.abs(values[mine, k]) / usual, 1.0)[:, None] * vectors[mine, :, k]
                segments += list(np.stack([at[mine] - half, at[mine] + half], axis=1))
            halo = [withStroke(linewidth=2.4, foreground="w")]
            ax.add_collection(LineCollection(segments, colors=colour, linewidths=1.2, path_effects=halo))
        letter = symbol(name, "principal1") or name
        self.notes.append(
            f"crosses: principal values in the plane ({letter}, ...), red tension, blue compression, the longest "
            f"{usual:.3g} {unit}".strip()
        )


def legend(fig, grey: bool, over=None) -> None:
    """Below a picture of maps: what grey stands for, and what is drawn over them."""
    said = (["grey: no atoms in reach"] if grey else []) + (list(over.notes) if over else [])
    if said:
        fig.supxlabel(wrapped(fig, "; ".join(said), 8), fontsize=8, color="0.25")
