"""What `twin` found: dataset, norms, what was said, pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..pictures.twins import movie, picture
from ..running.whole import write_dataset
from .body import TwinBody


@dataclass
class Twin:
    """What `twin` found.

    Attributes
    ----------
    dataset : xarray.Dataset in the trajectory's units: md_*, pd_* and difference_* of density, displacement, velocity
        and stress (frame, the grid's dimensions), md_box_stress and pd_box_stress; md_, pd_ (and classical_)
        node_displacement (frame, node, i); norm_*, elastic_*
    rows : the norms, one dict for each field and region
    lines : what was decided before the run
    body : TwinBody. material : what `twin_material` made. simulation : pd.Simulation after the run (internal units)
    cost : {"nodes", "steps" (of a static twin: evaluations of the forces), "material", "seconds"}: CPU seconds that
        making the material and running the nodes took
    """

    dataset: object
    rows: list
    lines: list
    body: TwinBody
    material: object
    simulation: object
    name: str = field(default="twin")
    cost: dict = field(default_factory=dict)

    def print(self, console) -> None:
        from rich.table import Table

        ds = self.dataset
        table = Table(box=None, padding=(0, 2, 0, 0))
        noise = any(np.isfinite(r["md_standard_error"]) for r in self.rows)
        keys = ["md_rms", "pd_rms", "difference_rms", "relative", *(["md_standard_error"] if noise else [])]
        heads = ["MD rms", "PD rms", "PD - MD rms", "relative", *(["MD std. error"] if noise else [])]
        for head in ("field", "where", "points", *heads):
            table.add_column(head, justify="left" if head in ("field", "where") else "right")
        for r in self.rows:
            units = ds[f"md_{r['field']}"].attrs.get("units", "")
            table.add_row(f"{r['field']} ({units})", r["where"], str(r["points"]), *(f"{r[k]:.4g}" for k in keys))
        console.print(table)
        console.print(f"(rms over points and components, {ds.attrs['norms']})")
        if "md_box_stress" in ds:
            md, pd = (ds[f"{s}_box_stress"].mean("frame").values for s in ("md", "pd"))
            for c, i in zip("xyz", range(self.body.body.dimension)):
                console.print(
                    f"mean stress of the box, {c}{c}: MD {md[i, i]:.5g}, PD {pd[i, i]:.5g} "
                    f"{ds['md_box_stress'].attrs.get('units', '')}"
                )
        console.print(f"the twin's run: {cost_line(self.cost)}")

    def save(self, path) -> None:
        """Write the dataset: .nc or .zarr."""
        write_dataset(self.dataset, path)

    def picture(self, path) -> Path:
        """MD, PD and difference of the displacement and the stress along the axis of the largest mean stress."""
        frames = self.dataset.sizes["frame"]
        return picture(self.dataset, path, f"{self.name}: means of {frames} frames")

    def movie(self, path) -> Path:
        """The same, and damage where bonds break, frame by frame: an animated GIF."""
        return movie(self.dataset, path, self.name)


def cost_line(c: dict) -> str:
    """What a twin cost, for a person."""
    return (
        f"{c['nodes']} nodes, {c['steps']} steps, {c['seconds']:.3g} CPU seconds; its material before that "
        f"{c['material']:.3g}"
    )
