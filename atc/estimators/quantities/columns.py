"""Quantities of the columns of a trajectory, made when they are asked for: see `..columns`."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ..columns import PREFIX, split
from ..tensors import quotient
from .quantity import Quantity


def of_column(name: str) -> Quantity:
    """The quantity of a name like ``column:c_pe:mean``."""
    column, way = split(name)
    if "*mass" in column:
        raise AtcError(f"quantity {name!r}: a mean by mass is {PREFIX}{column.replace('*mass', '')}:mass_mean")
    common = {"sign": "that of the column", "linear": True}
    plain, by_mass = f"{PREFIX}{column}", f"{PREFIX}{column}*mass"
    if way == "density":
        return Quantity(
            name,
            "number_density",
            f"density of {column}",
            lambda s: s.site[plain][:, 0],
            site=(plain,),
            comment="sum of a phi, a the values of the column as the trajectory has them",
            **common,
        )
    source, weight, over = (plain, "one", "number") if way == "mean" else (by_mass, "mass", "mass")
    return Quantity(
        name,
        "dimensionless",
        f"mean of {column}" + " by mass" * (way == "mass_mean"),
        lambda s: np.where(s.defined, quotient(s.site[source][:, 0], s.site[weight][:, 0]), 0.0),
        site=(*dict.fromkeys((weight, "mass")), source),
        masked=True,
        weight=weight,
        comment=f"sum of a phi over the {over} density, a the values of the column as the trajectory has them",
        **common,
    )
