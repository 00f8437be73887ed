"""Which units a LAMMPS file is in: from the argument and from what files say, which must agree."""

from __future__ import annotations

from ...errors import AtcError, located
from ...units import units as unit_system


def settle_units(given, declared, source):
    """The unit system from the argument and what files declare: they must agree, and there must be one."""
    system = None if given is None else unit_system(given)
    by = "the units argument"
    for name, file in declared:
        with located(file):
            here = unit_system(name)
        if system is not None and here.name != system.name:
            raise AtcError(
                f"{file} says its units are {here.name!r} but {by} says {system.name!r}: correct the one that is wrong"
            )
        system, by = here, str(file)
    if system is None:
        raise AtcError(
            f"{source}: its units are not in the file; give the unit style of the LAMMPS run, e.g. units='metal' (in "
            "a scene in [trajectory], to atc info as --units metal), or write it with 'dump_modify ID units yes'"
        )
    return system
