"""A state of a peridynamic body as a frame with bonds, for the estimators that make fields of atoms: density, velocity,
stress, ... of both by the same code."""

from __future__ import annotations

import numpy as np

from ..bonds import Bonds
from ..contracts import Interactions
from ..errors import AtcError
from ..frame import Cell, Frame
from ..units import units as unit_system

_CHUNK = 1 << 16


def snapshot(sim, units="si", layer=None, planar=False):
    """The present state of a simulation as (frame, bonds) for `atc.fields`.

    Parameters
    ----------
    sim : Simulation
    units : the style whose length, energy and time the simulation's numbers are in; masses are then in energy·time²/
        length², moduli in energy/length³. So "si" is SI; "metal" is Å, eV, ps (and no g/mol); "lj" is any other
        consistent system. Results carry the style's labels.
    layer : in one and two dimensions the body is repeated every `layer` along the missing axes, with its share of mass
        and force, so that fields are those of
        a body that goes on for ever there; small against the kernel's radius (default a quarter of the spacing)
    planar : a body in two dimensions as a frame of a run in the plane (LAMMPS's ``dimension 2``) instead, with its
        whole mass and forces: fields are per area

    Returns
    -------
    frame : Frame, with the columns volume and damage (`extra`) and the forces on the nodes
    bonds : what takes the place of a potential: the forces in the intact bonds of this state; contact is not among them

    Examples
    --------
    >>> frame, bonds = pd.snapshot(sim)
    >>> atc.fields(frame, bonds, atc.kernel("quartic", 0.002), grid, ["density", "velocity", "peridynamic_stress"])
    >>> atc.fields(frame, bonds, kernel, grid, ["peridynamic_piola_stress"], reference=pd.reference_frame(sim))
    """
    u = unit_system(units)
    body = sim.body
    cell, share = _place(body, sim.cell, layer, planar)
    u = u.planar if planar else u
    frame = _frame(sim, u, cell, share, sim.positions_nc, f"peridynamics step {sim.state.step}")
    frame.velocities = np.array(sim.state.v_nc) * (u.factor("length") / u.factor("time"))
    frame.forces = np.array(sim.forces()) * (share * u.factor("energy") / u.factor("length"))
    frame.extra["damage"] = sim.damage()
    frame.step, frame.time = sim.state.step, u.to_internal("time", sim.state.time)
    return frame, SnapshotBonds(sim, u, share, frame)


def reference_frame(sim, units="si", layer=None, planar=False) -> Frame:
    """The undeformed body, for quantities that need a reference."""
    u = unit_system(units)
    cell, share = _place(sim.body, sim.body.cell, layer, planar)
    u = u.planar if planar else u
    return _frame(sim, u, cell, share, sim.body.X_nc, "peridynamics reference")


def _frame(sim, u, cell, share, x_nc, source) -> Frame:
    body = sim.body
    return Frame(
        u.to_internal("length", np.array(x_nc)),
        cell.scaled(u.factor("length")),
        u,
        types=body.material_n,
        masses=sim.mass_n * (share * u.factor("energy") * (u.factor("time") / u.factor("length")) ** 2),
        source=source,
        extra={"volume": body.V_n * share},
    )


def _place(body, cell, layer, planar):
    """The cell (reference or deformed), and the share of the thickness (cross-section) that one layer has."""
    d = body.dimension
    if planar:
        if d != 2:
            raise AtcError(f"planar: a run in the plane is one of a body in two dimensions, this one has {d}")
        return cell, 1.0
    if d == 3:
        return cell, 1.0
    h = 0.25 * body.spacing if layer is None else float(layer)
    if not h > 0:
        raise AtcError(f"layer must be a length greater than 0, got {layer!r}")
    vectors, origin, periodic = np.array(cell.vectors), np.array(cell.origin), np.array(cell.periodic)
    vectors[d:] = 0.0
    vectors[:, d:] = 0.0
    for a in range(d, 3):
        vectors[a, a], origin[a], periodic[a] = h, body.X_nc[0, a] - 0.5 * h, True
    return Cell(vectors, origin, periodic), h ** (3 - d) / body.thickness


class SnapshotBonds(Interactions):
    """The bonds of one state of a peridynamic body, in the place of a potential. Made by `snapshot`.

    Attributes
    ----------
    horizon, cutoff : the body's horizon and its longest bond (internal units). dimension : 1, 2 or 3. central : whether
        forces act along bonds
    """

    def __init__(self, sim, u, share, frame):
        self.units, self.dimension, self.body = u, sim.body.dimension, sim.body
        found = sim.bond_forces()
        self.i, self.j = found.i.astype(np.int32, copy=False), found.j.astype(np.int32, copy=False)
        self.r_bc = u.to_internal("length", found.r_bc)
        self.central = found.G_b is not None
        force = share * u.factor("energy") / u.factor("length")
        self.G_b = found.G_b * (force / u.factor("length")) if self.central else None
        self.F_bc = None if self.central else found.F_bc * force
        self.horizon = u.to_internal("length", sim.body.horizon)
        longest = float(np.sqrt(np.einsum("bc,bc->b", self.r_bc, self.r_bc).max())) if len(self.i) else 0.0
        self.cutoff = max(self.horizon, longest)
        self.name = ", ".join(sorted({m.name for m in sim.materials.values()}))
        self._energies = lambda: u.to_internal("energy", sim.strain_energy_n() * share)
        self._step, self._n = sim.state.step, len(frame)
        self.state = sim.state
        self._kept = None

    def keep_energies(self):
        """Compute the strain energies now, before the simulation goes on."""
        self._kept = self._energies()
        return self

    def describe(self) -> str:
        return (
            f"peridynamics, {self.name}, horizon {self.units.to_user('length', self.horizon):g}; strain energy half "
            "of each bond to each end, or the node's own"
        )

    def __len__(self):
        return len(self.i)

    def stream(self, frame, consume=None, *, threads=1, energies=False, forces=False, sources=False):
        """The bonds in chunks, as a potential gives them (see `atc.decomposers.base.Potential.stream`)."""
        from ..decomposers.base import Decomposition

        if len(frame) != self._n or frame.step != self._step:
            raise AtcError(
                f"{frame.source}: these bonds belong to step {self._step} of the simulation they were taken from, and "
                "to no other frame"
            )
        if sources:
            raise AtcError("heat flux and churning are not defined for peridynamic bonds: they have no temperature")
        if energies and self._kept is None and self.state.step != self._step:
            raise AtcError(
                f"the simulation has gone on to step {self.state.step}: take a new snapshot, or keep_energies() "
                "before it goes on"
            )
        n = len(self.i)
        chunks = [slice(a, min(a + _CHUNK, n)) for a in range(0, n, _CHUNK)]

        def chunk(part):
            r = self.r_bc[part]
            if self.central:
                return Bonds(self.i[part], self.j[part], r, self.G_b[part])
            F = self.F_bc[part]
            return Bonds(self.i[part], self.j[part], r, np.full(len(r), np.nan), F_bc=F)

        def lane(t):
            virial = np.zeros((3, 3))
            for part in chunks[t::threads]:
                bonds = chunk(part)
                virial += bonds.virial()
                if consume is not None:
                    consume(bonds, t)
            return virial

        if threads == 1:
            virials = [lane(0)]
        else:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(threads) as pool:
                virials = list(pool.map(lane, range(threads)))
        energies_n = (self._kept if self._kept is not None else self._energies()) if energies else None
        forces_nc = None
        if forces:
            forces_nc = np.zeros((self._n, 3))
            for part in chunks:
                F = chunk(part).forces()
                for c in range(3):
                    forces_nc[:, c] += np.bincount(self.i[part], F[:, c], self._n) - np.bincount(
                        self.j[part], F[:, c], self._n
                    )
        return Decomposition(
            energy=float(energies_n.sum()) if energies else np.nan,
            virial_cc=sum(virials),
            energies_n=energies_n,
            forces_nc=forces_nc,
            n_bonds=n,
        )
