"""Influence functions from their names and formulas, for the materials that take them."""

from __future__ import annotations

from ..errors import AtcError


def influence_of(cls, said, horizon, unit=1.0):
    """A material's influence function from its name or formula; one of the bond's direction for `cls` that take it.
    unit : of the formula's lengths."""
    from ..config.formula import influence
    from ..pd.materials.influence import INFLUENCE, of_vector

    if said in INFLUENCE:
        return said
    found = influence(said, horizon, unit)
    if of_vector(found) and not cls.directed:
        raise AtcError(
            f"influence: a formula of x, y, z would make {cls.name} anisotropic: give one of r and delta, or take "
            "correspondence, bond-associated or cauchy-born"
        )
    return found
