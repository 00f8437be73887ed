"""Tables of users, linear in between: a sum of cones, each cut off where it is 0 (`radial`)."""

from __future__ import annotations

from math import pi

import numpy as np

from ..errors import AtcError
from .radial import Radial


class Table:
    """φ through (r, value) pairs, up to a common factor; constant before the first, 0 after the last."""

    name, aliases, takes = "piecewise-linear", ("piecewise_linear",), ("table",)

    def of(self, dimension=None, *, table) -> Radial:
        try:
            t = np.array(table, dtype=float)
        except (ValueError, TypeError):
            raise AtcError("kernel 'piecewise-linear': table must be a list of (r, value) pairs") from None
        if t.ndim != 2 or t.shape[1] != 2 or len(t) < 1:
            raise AtcError(f"kernel 'piecewise-linear': table must be a list of (r, value) pairs, got shape {t.shape}")
        if not np.isfinite(t).all() or (t < 0).any():
            raise AtcError("kernel 'piecewise-linear': table holds numbers that are negative or not finite")
        r, v = t.T
        if (np.diff(r) <= 0).any():
            raise AtcError("kernel 'piecewise-linear': the distances of the table must increase")
        if r[0] > 0:
            r, v = np.concatenate([[0.0], r]), np.concatenate([v[:1], v])
        if len(r) < 2 or not (v[1:] + v[:-1]).any():
            raise AtcError("kernel 'piecewise-linear': the table is zero everywhere")
        # Line m (between r_m and r_m+1) as offset + slope·ρ; a piece is the difference of neighbouring lines, cut at
        # the node between them.
        slope = np.append(np.diff(v) / np.diff(r), 0.0)
        offset = np.append(v[:-1] - slope[:-1] * r[:-1], 0.0)
        radii, coef_mk = r[1:], np.zeros((len(r) - 1, 5))
        coef_mk[:, 0] = offset[:-1] - offset[1:]
        coef_mk[:, 1] = (slope[:-1] - slope[1:]) * radii
        # A continuous node is a pure cone: make its value at the cut exactly 0.
        inner = np.arange(len(radii)) < len(radii) - 1
        continuous = inner | (v[-1] == 0)
        coef_mk[continuous, 0] = -coef_mk[continuous, 1]
        keep = np.abs(coef_mk).max(axis=1) > 1e-15 * np.abs(coef_mk).max()
        radii, coef_mk = radii[keep], coef_mk[keep]
        integral = 4 * pi * (radii**3 * (coef_mk / (np.arange(5) + 3.0)).sum(axis=1)).sum()
        return Radial("piecewise-linear", radii, coef_mk, 1.0 / integral, table=t)
