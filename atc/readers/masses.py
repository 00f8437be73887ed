"""Masses by type, and the unit system that a reader is told."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..errors import AtcError
from ..units import Units
from ..units import units as unit_system


def check_units(given, own: Units, what: str) -> None:
    """AtcError where a `units` argument says others than there are; `what` there are, for the message."""
    if given is not None and unit_system(given).name != own.name:
        raise AtcError(f"{what} but the units argument says {unit_system(given).name!r}: leave it out")


class Masses:
    """Masses by type: ``{type or name: mass}`` or a list for types 1, 2, ..., in the user's units. Calling it gives one
    per atom.

    Strings of digits are type numbers (TOML keys are always strings).
    """

    def __init__(self, given, units: Units, what: str = "masses"):
        self.what = what
        if isinstance(given, (str, bytes)):
            raise AtcError(f"{what}: expected a list of masses by type, or {{type: mass}}, got {given!r}")
        if not hasattr(given, "items"):
            with suppress(TypeError):
                given = [given] if np.ndim(given) == 0 else list(given)
            given = dict(enumerate(given, 1))
        self.by_type, self.by_name = {}, {}
        for key, value in given.items():
            try:
                mass = float(value)
            except (TypeError, ValueError):
                raise AtcError(f"{what}: the mass of {key!r} is {value!r}, expected a number") from None
            if not (np.isfinite(mass) and mass > 0):
                raise AtcError(f"{what}: the mass of {key!r} is {value!r}, expected a positive number")
            mass = units.to_internal("mass", mass)
            if isinstance(key, str) and not key.strip().isdigit():
                self.by_name[key] = mass
            else:
                self.by_type[int(key)] = mass

    def __len__(self):
        return len(self.by_type) + len(self.by_name)

    def __call__(self, types, type_names, source: str) -> np.ndarray:
        if not len(types):
            return np.zeros(0)
        values, inverse = np.unique(types, return_inverse=True)
        out = np.empty(len(values))
        for k, t in enumerate(values.tolist()):
            name = type_names.get(t)
            if t in self.by_type:
                out[k] = self.by_type[t]
            elif name in self.by_name:
                out[k] = self.by_name[name]
            else:
                called = f"{t} ({name})" if name else str(t)
                have = ", ".join(map(str, [*self.by_type, *self.by_name]))
                raise AtcError(f"{source}: {self.what} has no mass for type {called}, only for {have}; add it")
        return out[inverse]
