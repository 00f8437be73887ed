"""The per-atom factors a_j of the site sums and the bond factors b that need more than r and G."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of
from ..errors import AtcError
from . import columns
from .tensors import outer6


def drift_velocity(frame, chosen_n=None) -> np.ndarray:
    """(3,) mass-mean velocity of the frame, or of the chosen atoms.

    Taken relative to one atom's velocity first, so that a drift large against the thermal velocity costs no digits of
    the mean.
    """
    some = slice(None) if chosen_n is None or chosen_n.all() else chosen_n
    m, v_nc = frame.masses[some], frame.velocities[some]
    if not len(m):
        return np.zeros(3)
    v0 = v_nc[0]
    total = m.sum()
    return v0 + (m @ (v_nc - v0)) / total if total > 0 else v0.copy()


@dataclass(frozen=True)
class PerAtom:
    """What the bonds leave for each atom, where somebody asks for it: its energy, the sums of `AtomSums`, the force on
    it."""

    energies_n: np.ndarray | None = None
    virial_n6: np.ndarray | None = None
    residual_n4: np.ndarray | None = None
    moment_n9: np.ndarray | None = None
    reference_moment_n9: np.ndarray | None = None
    forces_nc: np.ndarray | None = None  # between atoms


class AtomFactors:
    """The columns of the site sums, (n, width) each, made when asked for and kept; 0 for atoms that are not chosen (see
    `chosen`)."""

    def __init__(self, frame, drift, per_atom: PerAtom | None = None, pot=None, chosen=None):
        self.frame, self.drift, self.per_atom, self.pot = frame, drift, per_atom or PerAtom(), pot
        self.chosen = chosen
        self._kept: dict[str, np.ndarray] = {}

    @property
    def atoms(self):
        """The frame without virtual sites, which have energies and no numbers of their own."""
        return atoms_of(self.frame)

    @property
    def peculiar_nc(self) -> np.ndarray:
        """Velocities relative to the frame's drift."""
        if "peculiar" not in self._kept:
            self._kept["peculiar"] = self.frame.velocities - self.drift
        return self._kept["peculiar"]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._kept:
            inner = name.removeprefix("all_")
            a_nk = columns.factor(self.atoms, name) if columns.is_column(name) else getattr(self, f"_{inner}")()
            if len(a_nk) < len(self.frame):
                a_nk = self.frame.padded(a_nk)
            if self.chosen is not None:
                of = self.chosen.own_n if inner == name else self.chosen.chosen_n
                a_nk = np.where(of[:, None], a_nk, 0.0)
            self._kept[name] = a_nk
        return self._kept[name]

    @property
    def masses(self) -> np.ndarray:
        """(n,) those of the chosen atoms, 0 for others."""
        return self.frame.masses if self.chosen is None else np.where(self.chosen.own_n, self.frame.masses, 0.0)

    @property
    def some(self):
        """The atoms that count at all, an index."""
        if self.chosen is None or self.chosen.chosen_n.all():
            return slice(None)
        return np.flatnonzero(self.chosen.chosen_n)

    def columns(self, names) -> np.ndarray:
        """(n, k) the named factors side by side."""
        return np.ascontiguousarray(np.concatenate([self[name] for name in names], axis=1))

    def _one(self):
        return np.ones((len(self.atoms), 1))

    def _degrees(self):
        if self.pot is None:
            from ..decomposers.constraints.topology import degrees_of_topology

            free = degrees_of_topology(self.atoms)
            return self._one() if free is None else free[:, None] / self.frame.dimension
        constraints = self.pot.constraints
        if constraints is None:
            inside = self.pot.sites is not None
            return (self.atoms.masses > 0.0)[:, None].astype(float) if inside else self._one()
        return constraints.degrees(self.pot.complete(self.atoms))[:, None] / self.frame.dimension

    def _mass(self):
        return self.frame.masses[:, None].copy()

    def _momentum(self):
        return self.frame.masses[:, None] * self.peculiar_nc

    def _kinetic(self):
        return self.frame.masses[:, None] * outer6(self.peculiar_nc)

    def _kinetic_energy(self):
        return 0.5 * self["mass"] * np.einsum("nc,nc->n", self.frame.velocities, self.frame.velocities)[:, None]

    def _potential_energy(self):
        return self.per_atom.energies_n[:, None]

    def _atom_virial(self):
        return self.per_atom.virial_n6

    def _atom_moment(self):
        return self.per_atom.moment_n9

    def _kinetic_flux(self):
        v = self.peculiar_nc
        return 0.5 * self["mass"] * np.einsum("nc,nc->n", v, v)[:, None] * v

    def _potential_flux(self):
        return self.per_atom.energies_n[:, None] * self.peculiar_nc

    def _energy_current(self):
        return (self["kinetic_energy"] + self.per_atom.energies_n[:, None]) * self.frame.velocities

    def _outside_force(self):
        return self.pot.body_forces(self.atoms, self.per_atom.forces_nc[: len(self.atoms)])[0]

    def _outside_power(self):
        return np.einsum("nc,nc->n", self["outside_force"], self.frame.velocities)[:, None]

    def _source_residual(self):
        return self.per_atom.residual_n4


class OfAll:
    """The factors of the atoms of all parts, where there are several."""

    def __init__(self, factors: AtomFactors):
        self.factors, self.peculiar_nc = factors, factors.peculiar_nc

    def __getitem__(self, name: str) -> np.ndarray:
        return self.factors["all_" + name]


class AtomSums:
    """Per-atom sums gathered while bonds stream by, one buffer a thread.

    virial : (n, 6) ½ Σ G r⊗r, half of each bond to each end; energy, tension positive
    residual : (n, 4) the force on each atom minus the force that follows from the energy sources, what ∇·z is made of;
        and the size of the forces
    moment, reference_moment : (n, 9) −½ Σ r⊗F, half of each bond to each end, r between current or reference positions
    power : (3,) Σ (v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i) r over all bonds, v in the frame of the simulation
    """

    def __init__(
        self, frame, threads: int, virial=False, residual=False, power=False, moment=False, reference_moment=False
    ):
        n = len(frame)
        self.velocities = frame.velocities
        self._virial = [np.zeros((n, 6)) for _ in range(threads)] if virial else None
        self._residual = [np.zeros((n, 4)) for _ in range(threads)] if residual else None
        self._power = [np.zeros(3) for _ in range(threads)] if power else None
        self._moment = [np.zeros((n, 9)) for _ in range(threads)] if moment else None
        self._reference_moment = [np.zeros((n, 9)) for _ in range(threads)] if reference_moment else None

    @property
    def wanted(self) -> bool:
        return any(x is not None for x in (self._virial, self._residual, self._power, self._moment))

    def add(self, bonds, thread: int, R_bc=None) -> None:
        from . import _numba

        if self._moment is not None:
            _numba.scatter_moment(bonds.i, bonds.j, bonds.r_bc, bonds.forces(), self._moment[thread])
        if self._reference_moment is not None:
            _numba.scatter_moment(bonds.i, bonds.j, R_bc, bonds.forces(), self._reference_moment[thread])

        if self._virial is not None:
            _numba.scatter_virial(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, self._virial[thread])
        if self._residual is not None:
            _numba.scatter_residual(bonds.i, bonds.j, bonds.forces(), bonds.D_bdc, self._residual[thread])
        if self._power is not None:
            _numba.add_power(
                bonds.i, bonds.j, bonds.r_bc, bonds.D_bdc, bonds.powers(), self.velocities, self._power[thread]
            )

    virial_n6 = property(lambda self: _total(self._virial))
    residual_n4 = property(lambda self: _total(self._residual))
    power_c = property(lambda self: _total(self._power))
    moment_n9 = property(lambda self: _total(self._moment))
    reference_moment_n9 = property(lambda self: _total(self._reference_moment))


def _total(buffers):
    """The sum of the threads' buffers, in their order."""
    return None if buffers is None else sum(buffers[1:], buffers[0])


def bond_factors(names, widths, bonds, peculiar_nc, velocities_nc, size=False) -> np.ndarray:
    """(b, k) the named factors of Σ b β, side by side; |F| |r| too if `size`."""
    from ..deposit.direct import put_stress
    from . import _numba

    out = np.empty((len(bonds), sum(widths) + size))
    if not len(bonds):  # which need not have sources either
        return out
    if size:
        r2 = np.einsum("bc,bc->b", bonds.r_bc, bonds.r_bc)
        F_bc = bonds.F_bc
        out[:, -1] = np.abs(bonds.G_b) * r2 if F_bc is None else np.sqrt(r2 * np.einsum("bc,bc->b", F_bc, F_bc))
    at = 0
    for name, width in zip(names, widths):
        if name == "stress":
            put_stress(bonds.r_bc, bonds.G_b, at, out)
        elif name == "moment":
            _numba.put_moment(bonds.r_bc, bonds.forces(), at, out)
        elif name == "sources":
            _numba.put_sources(bonds.r_bc, bonds.D_bdc, at, out)
        else:
            v_nc = {"power": peculiar_nc, "power_lab": velocities_nc}[name]
            _numba.put_power(bonds.i, bonds.j, bonds.r_bc, bonds.D_bdc, bonds.powers(), v_nc, at, out)
        at += width
    return out


def same_atoms(frame, reference) -> None:
    """Raise unless both frames hold the same atoms and repeat along the same axes."""
    if not np.array_equal(frame.ids, reference.ids):
        raise AtcError(
            f"{frame.source}: its atom ids are not those of the reference frame ({reference.source}): what refers to "
            "a reference needs the same atoms in both"
        )
    if not np.array_equal(frame.cell.periodic, reference.cell.periodic):
        raise AtcError(f"{frame.source}: its periodic axes are not those of the reference frame ({reference.source})")


def cells_moved(frame, reference) -> np.ndarray:
    """(n, 3) whole cells by which each atom must be moved back to continue its reference position: x − moved @ vectors.

    By image flags where both frames have them, else by the rounded difference of fractional coordinates, which is right
    while no atom has moved more than half a cell relative to the deforming cell.
    """
    if frame.images is not None and reference.images is not None:
        moved = reference.images - frame.images
    else:
        moved = np.rint(frame.cell.fractional(frame.positions) - reference.cell.fractional(reference.positions))
    return np.where(frame.cell.periodic, moved, 0.0)


class ReferenceBonds:
    """Current bonds carried to the reference configuration, through the same periodic image.

    The image of a bond is n = round((x_i − x_j − r) H⁻¹) in the current cell H. Atoms that were re-wrapped since the
    reference differ from it by whole cells: by their image flags where both frames have them, else by the rounded
    difference of fractional coordinates (right while no atom has moved more than half a cell relative to the deforming
    cell).

    Source: first Piola-Kirchhoff as in formulas.md §4-5: the same bond sum with reference positions in β and in the
    first index.
    """

    def __init__(self, frame, reference):
        same_atoms(frame, reference)
        self.x_nc, self.X_nc = frame.positions, reference.positions
        self.inverse, self.H = frame.cell.inverse, reference.cell.vectors
        self.periodic = frame.cell.periodic
        # x_n − moved @ H is the atom unwrapped so that it continues its reference position.
        self.moved_nc = cells_moved(frame, reference)

    def of(self, index):
        """The same for particles that are (copies of) these atoms."""
        from copy import copy

        new = copy(self)
        new.x_nc, new.X_nc, new.moved_nc = self.x_nc[index], self.X_nc[index], self.moved_nc[index]
        return new

    def bonds(self, bonds):
        """(b, 3) reference positions of the ends i and (b, 3) reference bond vectors X_i − X_j through the bond's
        image."""
        i, j = bonds.i, bonds.j
        shift = np.rint((self.x_nc[i] - self.x_nc[j] - bonds.r_bc) @ self.inverse)
        shift -= self.moved_nc[i] - self.moved_nc[j]
        shift[:, ~self.periodic] = 0.0
        X_bc = self.X_nc[i]
        return X_bc, X_bc - self.X_nc[j] - shift @ self.H


def piola_factor(bonds, R_bc) -> np.ndarray:
    """(b, 9) −R⊗F, row-major: the first index belongs to the reference bond R, the second to the force −G r."""
    if bonds.F_bc is not None:
        return -(R_bc[:, :, None] * bonds.F_bc[:, None, :]).reshape(-1, 9)
    return (bonds.G_b[:, None, None] * R_bc[:, :, None] * bonds.r_bc[:, None, :]).reshape(-1, 9)
