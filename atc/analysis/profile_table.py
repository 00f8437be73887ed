"""Profiles along a normal with their error bars, and numbers found from them: how they are kept, printed, written and
drawn."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..estimators.tensors import quotient
from ..pictures.drawing import STYLE, figure, save, titled
from ..pictures.geometry import unit_text, with_unit
from ..running.whole import write_dataset
from ..terminal import tell
from .green_kubo import _pm

#: Rows of the table on the terminal; the files have all bins.
_ROWS = 20


@dataclass
class Column:
    """A profile. values, stderr : (z,) mean over the frames and its standard error by block averaging; correlated :
    where the blocks still correlate, so that stderr is a lower bound; group : what shares a panel, part : what shares a
    table."""

    values: np.ndarray
    stderr: np.ndarray
    units: str
    label: str
    group: str
    correlated: np.ndarray | None = None
    part: str = "pressure"


@dataclass
class Value:
    """A number with its standard error (NaN where there is none)."""

    value: float
    stderr: float
    units: str
    label: str
    correlated: bool = False

    def __str__(self):
        shown = f"{self.value:.4g}" if np.isnan(self.stderr) else _pm(self.value, self.stderr)
        return f"{shown} {self.units}".strip() + (" (error: a lower bound)" if self.correlated else "")


def series_mean(x_t):
    """(mean, standard error, correlated) of a series of arrays, by block averages over the frames."""
    from ..estimators.statistics import BlockAverage

    average = BlockAverage()
    for x in x_t:
        average.add(x)
    return average.result()


def series_quotient(f_tz, n_tz):
    """The same of Σ f/Σ n, frames weighted by n; NaN where n is always 0."""
    from ..estimators.statistics import BlockAverage

    average = BlockAverage()
    for f_z, n_z in zip(f_tz, n_tz):
        average.add(quotient(f_z, n_z), n_z)
    mean, stderr, correlated = average.result()
    never = ~(n_tz > 0).any(axis=0)
    mean[never] = stderr[never] = np.nan
    return mean, stderr, correlated


@dataclass
class Profile:
    """Profiles along the normal of an interface, and numbers from them, in the trajectory's units.

    Attributes
    ----------
    z : (z,) where, along the normal of the cell's faces; axis : "x", "y" or "z", the edge that leaves them
    columns : {name: Column}
    numbers : {name: Value}
    frames : how many there were
    notes : what the numbers are, where that could be taken for something else
    warnings : what makes them doubtful
    """

    z: np.ndarray
    axis: str
    length_units: str
    frames: int
    source: str = ""
    columns: dict[str, Column] = field(default_factory=dict)
    numbers: dict[str, Value] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def __getitem__(self, name):
        return self.columns[name] if name in self.columns else self.numbers[name]

    def add(self, name, x_tz, units, label, group, part="pressure") -> None:
        """A profile from that of every frame."""
        mean, stderr, correlated = series_mean(x_tz)
        self.columns[name] = Column(mean, stderr, units, label, group, correlated, part)

    def number(self, name, x_t, units, label) -> None:
        """A number from that of every frame."""
        (mean,), (stderr,), (correlated,) = series_mean(np.reshape(x_t, (-1, 1)))
        self.numbers[name] = Value(float(mean), float(stderr), units, label, bool(correlated) and len(x_t) > 1)

    # ---- text

    def print(self, console) -> None:
        """The numbers, every few bins of the profiles, and what to know of them."""
        from rich import box
        from rich.table import Table

        width = max((len(v.label) for v in self.numbers.values()), default=0)
        numbers = [f"  {v.label:<{width}}  {v}" for v in self.numbers.values()]
        tell(console, [f"{self.source}: {self.frames} frame{'s' * (self.frames != 1)}", *numbers])
        every = -(-len(self.z) // _ROWS)
        parts: dict[str, list[Column]] = {}
        for c in self.columns.values():
            parts.setdefault(c.part, []).append(c)
        for columns in parts.values():
            table = Table(box=box.SIMPLE)
            table.add_column(f"{self.axis} ({self.length_units})", justify="right")
            for c in columns:
                table.add_column(f"{c.label} ({c.units})", justify="right", overflow="fold")
            for k in range(0, len(self.z), every):
                table.add_row(f"{self.z[k]:.4g}", *(_pm(c.values[k], c.stderr[k]) for c in columns))
            console.print(table)
        said = [f"every {every}th of {len(self.z)} bins; all of them with --csv, --json or -o"] if every > 1 else []
        tell(console, said + [f"warning: {warning}" for warning in self.warnings], self.notes)

    def csv(self) -> str:
        """The profiles: z, and value and standard error of each; units in the first line."""
        names = [f"{self.axis} ({self.length_units})"]
        data = [self.z]
        for name, c in self.columns.items():
            names += [f"{name} ({c.units})", f"{name}_stderr"]
            data += [c.values, c.stderr]
        rows = [",".join(f"{x:.10g}" for x in row) for row in np.column_stack(data)]
        return "\n".join([",".join(names), *rows]) + "\n"

    def json(self) -> str:
        """Everything, numbers unrounded; null for an error that is not known."""

        def plain(x):
            x = np.asarray(x)
            return x.tolist() if x.dtype.kind == "b" else np.where(np.isfinite(x), x, None).tolist()

        def entry(thing):
            return {k: v if isinstance(v, str) else plain(v) for k, v in thing.__dict__.items() if v is not None}

        whole = {
            "source": self.source,
            "frames": self.frames,
            "axis": self.axis,
            "units": self.length_units,
            "z": plain(self.z),
            "numbers": {k: entry(v) for k, v in self.numbers.items()},
            "columns": {k: entry(v) for k, v in self.columns.items()},
            "notes": self.notes,
            "warnings": self.warnings,
        }
        return json.dumps(whole, indent=2, ensure_ascii=False)

    # ---- files

    def dataset(self):
        """An xarray.Dataset: each profile X(z) with X_stderr and X_correlated; numbers without dimension."""
        import xarray as xr

        data = {}
        for name, c in self.columns.items():
            about = {"units": c.units, "long_name": c.label}
            data[name] = (self.axis, c.values, about)
            data[f"{name}_stderr"] = (self.axis, c.stderr, {**about, "long_name": f"standard error of {c.label}"})
            if c.correlated is not None:
                data[f"{name}_correlated"] = (self.axis, c.correlated.astype(np.int8))
        for name, v in self.numbers.items():
            about = {"units": v.units, "long_name": v.label}
            data[name] = ((), v.value, about)
            data[f"{name}_stderr"] = ((), v.stderr, {**about, "long_name": f"standard error of {v.label}"})
        attrs = {"source": self.source, "frames": self.frames, "notes": "; ".join(self.notes)}
        attrs["warnings"] = "; ".join(self.warnings)
        return xr.Dataset(data, {self.axis: (self.axis, self.z, {"units": self.length_units})}, attrs)

    def save(self, path) -> None:
        """Write the dataset: .nc or .zarr."""
        write_dataset(self.dataset(), path)

    def picture(self, path) -> Path:
        """Draw the profiles; returns the path."""
        return save(self.figure(), path)

    def figure(self):
        """A matplotlib Figure: a panel for each kind of profile, bands of one standard error."""
        import matplotlib as mpl

        groups: dict[tuple[str, str], list[Column]] = {}
        for c in self.columns.values():
            groups.setdefault((c.group, c.units), []).append(c)
        tension = self.numbers.get("surface_tension_si") or self.numbers.get("surface_tension")
        with mpl.rc_context(STYLE):
            fig, panels = figure(len(groups), 5.2, 2.3, columns=1 if len(groups) < 4 else 2)
            for axes, ((group, units), columns) in zip(panels, groups.items()):
                for k, c in enumerate(columns):
                    axes.fill_between(
                        self.z, c.values - c.stderr, c.values + c.stderr, alpha=0.3, linewidth=0, color=f"C{k}"
                    )
                    axes.plot(self.z, c.values, color=f"C{k}", label=_raised(c.label))
                axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
                unit = unit_text(units)
                axes.set_ylabel(f"{_raised(group)}\n({unit})" if unit else _raised(group))
                axes.set_xlabel(with_unit(self.axis, self.length_units))
                axes.set_xlim(self.z.min(), self.z.max())
                axes.spines[["top", "right"]].set_visible(False)
                if len(columns) > 1:
                    axes.legend()
            titled(fig, f"surface tension {tension}" if tension else self.source)
        return fig


def _raised(label: str) -> str:
    """As mathematics where a label has symbols with subscripts: p_N, v_x."""
    return re.sub(r"\b([^\W\d_])_(\w+)", r"$\1_{\2}$", label)
