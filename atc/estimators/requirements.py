"""Whether a frame has what the quantities asked need: said before anything is computed."""

from __future__ import annotations

from ..errors import AtcError
from ..grids.planes import through_planes
from ..units import require_compatible
from .columns import is_column
from .columns import values as column_values
from .field_pass import require_fields
from .peridynamic import horizon_of, node_volumes
from .registry import hidden
from .settings import Settings
from .work import Work


def require(frame, settings: Settings, work: Work) -> None:
    """Raise AtcError for the first thing that is missing: an attribute of the atoms, a potential, a kernel, a grid, a
    reference."""
    pot, kern, grid = settings.pot, settings.kern, settings.grid
    for attribute, users in work.attributes.items():
        users = [name for name in users if not hidden(name)]
        if is_column(attribute):
            column_values(frame, attribute.removeprefix("column:"), ", ".join(users))
        else:
            frame.require(attribute, why=", ".join(users))
    if work.bond_users and pot is None:
        raise AtcError(
            f"no potential was given but {_need(work.bond_users)} one: give the pair_style/pair_coeff lines of the run"
        )
    if work.bond_users and pot.sites is not None:
        require_with_sites(settings, work)
    if work.bond_users and not pot.central:
        require_directed(pot, work)
    for users, given, word in ((work.kernel_users, kern, "kernel"), (work.grid_users, grid, "grid")):
        if users and given is None:
            raise AtcError(f"no {word} was given but {_need(users)} one")
    if work.reference_users and settings.reference is None:
        raise AtcError(f"no reference frame was given but {_need(work.reference_users)} one: pass reference=")
    if any(q.kind == "box" for q in work.quantities) and not frame.cell.volume > 0:
        raise AtcError(f"{frame.source}: the cell has no volume, so the virial stress of the box is not defined")
    # What other rooms know of.
    if work.bond_users:
        require_compatible(pot.units, frame.units, "the potential", frame.source)
        require_fields(pot.fields, kern, frame.units, settings.tolerance, work)
    if work.horizon_users:
        horizon_of(settings.horizon, pot, grid, frame.units, work.horizon_users)
    if "atom_volume" in work.whole:
        node_volumes(frame)
    if work.gradient_users and kern is not None:
        from ..deposit.gradient import require_differentiable

        require_differentiable(kern, ", ".join(work.gradient_users))


def require_directed(pot, work: Work) -> None:
    """Raise for what is not known of forces that do not act along their bonds."""
    if (users := work.symmetric_users) and not (pot.churnless and not pot.fields):
        raise AtcError(
            f"{', '.join(users)}: the forces of {pot.describe()} do not act along bonds: ask for "
            "peridynamic_stress_nodal_virial"
        )
    # Forces across the bonds of a rigid body belong to no energy of an atom, those of a body's bonds to none that is
    # known.
    unknown = pot.constraints is not None and pot.constraints.across
    if work.source_users and (unknown or not pot.terms):
        raise AtcError(
            f"{', '.join(work.source_users)}: the forces of {pot.describe()} do not act along bonds, and which atom's "
            "energy they belong to is not known: ask for the stress"
        )


def require_with_sites(settings: Settings, work: Work) -> None:
    """Raise for what is not known where forces act on virtual sites, too."""
    what = f"virtual sites ({settings.pot.sites.rule.describe()})"
    if settings.tiles is not None:
        raise AtcError(f"tiles: not with {what}: a tile does not have all forces on a molecule: leave tiles out")
    if through_planes(settings.grid):
        raise AtcError(
            f"{', '.join(work.bond_users)}: not counted on planes where forces act on {what}, which no atom carries "
            "across: take a slab profile, or ask for stress_kinetic"
        )
    if work.symmetric_users:
        raise AtcError(
            f"{', '.join(work.symmetric_users)}: not known of single atoms where forces act on {what}: what hands them "
            "on is symmetric over a molecule only: ask for stress and virial_stress"
        )
    if work.reference_users or work.horizon_users:
        names = [q.name for q in work.quantities if q.point or any(s.reference for s in q.sources())]
        raise AtcError(f"{', '.join(names)}: not supported with {what}, which a reference frame does not have")
    if settings.selection is not None or settings.parts is not None:
        raise AtcError(
            f"{'by' if settings.parts is not None else 'select'}: {', '.join(work.bond_users)}: not known of some "
            f"atoms where forces act on {what}: ask for the kinetic parts, or leave the selection out"
        )


def _need(users) -> str:
    return f"{', '.join(users)} need{'s' * (len(users) == 1)}"
