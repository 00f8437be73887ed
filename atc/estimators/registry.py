"""The quantities atc knows, by name; others are registered from outside."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from . import columns
from .quantities import QUANTITIES as _ALL
from .quantities.columns import of_column
from .quantities.quantity import MEAN, Quantity
from .summed import AndColumns

QUANTITIES: dict[str, Quantity] = AndColumns({q.name: q for q in _ALL}, of_column)

#: Fields that only time averages of other fields need: no output has them.
QUANTITIES.hidden = {
    "_number": Quantity("_number", "number_density", "number density", lambda s: s.site["one"][:, 0], site=("one",)),
    "_degrees": Quantity(
        "_degrees", "number_density", "degrees of freedom", lambda s: s.site["degrees"][:, 0], site=("degrees",)
    ),
    "_paired": Quantity(
        "_paired",
        "number_density",
        "number density where an atom is not alone in reach",
        lambda s: np.where(s.alone, 0.0, s.all_number),
        site=("one", *MEAN, "kinetic"),
        masked=True,
    ),
}


def hidden(name: str) -> bool:
    """Whether a quantity is for time averages of others only."""
    return name in QUANTITIES.hidden


def register(quantity: Quantity) -> Quantity:
    """Make a quantity of sums that there are known by its name, to `atc.fields` and to scenes.

    Raises
    ------
    AtcError
        If the name is taken, or a sum that it names is not one of `SITE`, `BOND`, `WHOLE`, `GATHER`, `POINT`.
    """
    if quantity.name in QUANTITIES:
        raise AtcError(f"quantity {quantity.name!r} is known already: give it another name")
    try:
        quantity.sources()
    except KeyError as e:
        raise AtcError(f"quantity {quantity.name!r}: there are no sums called {e.args[0]!r}") from None
    QUANTITIES[quantity.name] = quantity
    return quantity


def expand(names) -> list[Quantity]:
    """The quantities called `names`, each whole followed by its parts, without repetition, in the order asked."""
    if isinstance(names, str):
        names = [names]
    out: dict[str, Quantity] = {}
    for name in names:
        if name not in QUANTITIES and not columns.is_column(name) and not hidden(name):
            from difflib import get_close_matches

            close = get_close_matches(str(name), QUANTITIES, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise AtcError(f"unknown quantity {name!r}{hint}: expected some of {', '.join(QUANTITIES)}")
        for n in (name, *QUANTITIES[name].parts):
            out.setdefault(n, QUANTITIES[n])
    if not out:
        raise AtcError(f"no quantities were asked for: name at least one of {', '.join(QUANTITIES)}")
    return list(out.values())
