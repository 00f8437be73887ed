"""What fields (long-range Coulomb) add to the sums of a frame: by their modes, beside the sums over atoms and bonds."""

from __future__ import annotations

from ..errors import AtcError


def require_fields(frame, settings, work) -> None:
    """Raise AtcError for what fields are not made for."""
    fields = getattr(settings.pot, "fields", ())
    if fields:
        raise AtcError(f"{fields[0].describe().split(':')[0]}: fields on grids are not supported yet")
