"""What is kept of every frame of a twin beside the run: fields, places of nodes, damage, the crack, pushes."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcWarning
from ..frame import Frame
from .comparison import fields_of_nodes
from .conditions import smoothed_displacement
from .crack import add_crack, crack_lines, crack_of
from .damage import NearestBonds, add_damage, on_grid
from .outside import add_indenters, indenters


class Record:
    """Takes down frame after frame of a simulation and the run.

    Attributes
    ----------
    fields : a dataset a frame, of the nodes. names : what is compared; damage is added where bonds are watched
    md_nodes, pd_nodes : (n, 3) a frame, smoothed displacements of the atoms, displacements of the nodes
    """

    def __init__(self, scene, get, given, made, crystal, material, sim, frames, times, forces, names):
        self.given, self.material, self.sim = given, material, sim
        self.frames, self.times, self.names = frames, times, names
        reference, u = given.reference, given.traj.units
        self.kernel = given.kern.scaled(u.factor("length"))
        self.bonds = NearestBonds(reference, crystal, made.body.notches) if get("fracture") else None
        # Nodes that carry atoms lose what bonds these lose.
        self.carried = (lambda: material.frame(sim)[0]) if material.carries_atoms else None
        self.crack = crack_of(scene, get, made, reference, self.kernel, self.bonds, sim, self.carried)
        self.indenting = indenters(forces)
        self.md_nodes = [smoothed_displacement(f, reference, made.smoothing, made.body.X_nc) for f in frames]
        self.at_rest = None
        if get("reference_stress"):
            from .. import fields as fields_of

            stresses = ["stress_potential", "virial_stress_potential"]
            self.at_rest = fields_of([reference], given.pot, given.kern, given.grid, stresses, forces="ignore")
        self.fields, self.pd_nodes, self.tips, self.spent = [], [], [], []
        self.damage, self.broken, self.push = ([], []), [], ([], [])

    def take(self, k) -> None:
        """Frame `k`, to which the simulation has come."""
        frame, sim = self.frames[k], self.sim
        self.pd_nodes.append(sim.state.u_nc.copy())
        if self.indenting:
            self.push[0].append(-sum(law.on_atoms(frame, self.times[k]) for law in self.indenting))
            self.push[1].append(-sum(law.force for law in self.indenting))
        with warnings.catch_warnings():
            if k:  # what is wrong with the grid has been said of the first
                warnings.simplefilter("ignore", AtcWarning)
            self.fields.append(self._fields())
        if self.bonds is not None:
            self._take_damage(frame)
        if self.crack is not None:
            self.tips.append(self.crack.measure(frame))

    def _fields(self):
        g = self.given
        found = fields_of_nodes(self.sim, self.material, g.traj.units, g.kern, g.grid, self.names, g.reference)
        if self.at_rest is not None:
            found["peridynamic_stress"].values += np.nan_to_num(self.at_rest["stress_potential"].values)
            found["virial_stress_potential"].values += self.at_rest["virial_stress_potential"].values
        return found

    def _take_damage(self, frame):
        sim, u = self.sim, self.given.traj.units
        points = self.given.grid.bind(u, frame.cell).points_gc
        mine = self.carried() if self.carried else Frame(sim.positions_nc, sim.cell, u, masses=sim.mass_n)
        lost = self.bonds.lost(frame), self.bonds.lost(mine) if self.carried else sim.damage()
        for kept, atoms, share in zip(self.damage, (frame, mine), lost):
            kept.append(on_grid(atoms, self.kernel, points, share))
        self.broken.append([d.mean() for d in lost])
        self.spent.append(sim.energies().dissipated_fracture)

    def add_to(self, data) -> list[str]:
        """Damage, crack and pushes into the dataset; what is to be said of the run, for a person."""
        u = self.given.traj.units
        if self.bonds is not None:
            add_damage(data, *self.damage, self.broken, self.carried is not None)
            if not self.carried:
                attrs = {"units": u.label("energy"), "long_name": "energy that went with broken bonds, PD"}
                data["pd_dissipated_energy"] = ("frame", u.to_user("energy", np.array(self.spent)), attrs)
            self.names.append("damage")
        said = list(self.material.after(self.sim))
        if self.crack is not None:
            add_crack(data, u, self.times, self.tips)
            said += crack_lines(data)
        if self.indenting:
            said += add_indenters(data, u, *self.push)
        if any(f.velocities is None for f in self.frames):
            said.append("stress of the MD: the frames have no velocities, so that its kinetic part is not in it")
        return said
