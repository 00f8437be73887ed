"""A LAMMPS data file as a trajectory."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..masses import Masses
from ..trajectory import Trajectory
from .data import LammpsData
from .data_header import looks_like_data
from .units import settle_units

__all__ = ["LammpsDataTrajectory", "looks_like_data"]


class LammpsDataTrajectory(Trajectory):
    """A data file as a trajectory of one frame. The file does not know its boundaries: periodic, as LAMMPS's
    default."""

    def __init__(self, path, topology=None, units=None, masses=None, atom_style=None):
        super().__init__()
        if topology is not None:
            raise AtcError(f"{path} is a LAMMPS data file and its own topology: leave the topology argument out")
        self.source = str(path)
        data = LammpsData(path, atom_style)
        self.units = settle_units(units, [(data.unit_style, self.source)] if data.unit_style else [], self.source)
        data.use_units(self.units)
        if data.cell is None:
            raise AtcError(f"{path}: the header has no complete box (xlo xhi, ylo yhi, zlo zhi)")
        if not len(data.ids):
            raise AtcError(f"{path}: a data file without atoms is no trajectory")
        self._data = data
        self._masses = None if masses is None else Masses(masses, self.units)

    @property
    def type_names(self):
        return self._data.type_names

    def __len__(self):
        return 1

    def _frame(self, k):
        d = self._data
        masses = None
        if self._masses is not None:
            masses = self._masses(d.types, d.type_names, self.source)
        elif d.has_masses:
            masses = d.masses_of(d.types, d.type_names, np.arange(len(d.ids)), d.ids, self.source)
        # What a LAMMPS script says of these atoms goes before what the file says.
        given = dict.fromkeys(("types", "charges", "topology") + ("masses",) * (self._masses is None), self.source)
        return Frame(
            positions=d.positions.copy(),
            cell=d.cell,
            units=self.units,
            types=d.types,
            ids=d.ids,
            masses=masses,
            velocities=d.velocities,
            charges=d.charges,
            images=d.images,
            topology=d.topology_for(d.ids, self.source),
            source=self.source,
            type_names=d.type_names,
            extra=dict(d.extra),
            molecules=d.extra.get("mol"),
            given={**given, "boundary": "assumed"},
        )
