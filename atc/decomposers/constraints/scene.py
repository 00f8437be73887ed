"""The [constraints] section of a scene: constraints that no script says, and what all of them are found from."""

from __future__ import annotations

from collections.abc import Mapping

from ...units import Units
from .held import Constraints
from .rules import AllBonds, HeldPairs, HydrogenBonds, RigidMolecules


def constrained(pot, table: Mapping, units: Units, where: str):
    """A potential with what a scene says of constraints.

    Parameters
    ----------
    pot : Potential, which may have constraints of its script
    table : checked keys of [constraints]; pairs as a list
    units : of the trajectory, in which temperature and time step are
    where : the section, for messages
    """
    rules = list(pot.constraints.rules) if pot.constraints is not None else []
    if "pairs" in table:
        rules.append(HeldPairs(tuple((int(i), int(j)) for i, j in table["pairs"]), where))
    if "bonds" in table:
        rule = AllBonds if table["bonds"] == AllBonds.word else HydrogenBonds
        rules.append(rule(table.get("rigid_water", True), where))
    if table.get("molecules"):
        chosen = table["molecules"]
        rules.append(RigidMolecules(None if chosen is True else tuple(chosen), style="molecules", where=where))
        if pot.setup is not None:
            pot.setup.needs |= {"molecules"}
    changes = {
        "source": table.get("source"),
        "temperature": units.to_internal("temperature", table["temperature"]) if "temperature" in table else None,
        "timestep": units.to_internal("time", table["timestep"]) if "timestep" in table else None,
        "behind": (0.5 if table["leapfrog"] else 0.0) if "leapfrog" in table else None,
        "contained": table["in_forces"] if "in_forces" in table else None,
    }
    base = pot.constraints if pot.constraints is not None else Constraints(())
    return pot.constrained(base.but(rules=tuple(rules), **{k: v for k, v in changes.items() if v is not None}))
