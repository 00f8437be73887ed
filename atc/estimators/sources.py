"""The values that are summed, of one frame: of its atoms, gathered while its bonds stream by, and of its bonds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of, only_atoms
from .peridynamic import node_volumes
from .summed import ALL, BOND, SITE


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
            a_nk = SITE[name].of(self)
            if len(a_nk) < len(self.frame):
                a_nk = self.frame.padded(a_nk)
            if self.chosen is not None:
                of = self.chosen.chosen_n if name.startswith(ALL) else self.chosen.own_n
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

    @property
    def volumes(self) -> np.ndarray:
        """(n,) of the nodes of a body."""
        return node_volumes(self.frame)

    def only_atoms(self, a_nk) -> np.ndarray:
        """The rows of the atoms themselves, with what their virtual sites have."""
        return only_atoms(self.frame, a_nk)

    def columns(self, names) -> np.ndarray:
        """(n, k) the named factors side by side."""
        return np.ascontiguousarray(np.concatenate([self[name] for name in names], axis=1))


class OfAll:
    """The factors of the atoms of all parts, where there are several."""

    def __init__(self, factors: AtomFactors):
        self.factors, self.peculiar_nc = factors, factors.peculiar_nc

    def __getitem__(self, name: str) -> np.ndarray:
        return self.factors[ALL + name]


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


class BondFactors:
    """The factors of Σ b β for the bonds of a frame, side by side.

    names : of `summed.BOND`
    drift : what velocities in "power" are relative to
    """

    def __init__(self, names, frame, drift):
        self.names, self.velocities = names, frame.velocities
        self.widths = [BOND[name].width for name in names]
        self.peculiar_nc = frame.velocities - drift if "power" in names else None

    @property
    def width(self) -> int:
        return sum(self.widths)

    @property
    def sources(self) -> bool:
        """Whether they are made of the bonds' energy sources."""
        return any(BOND[name].sources for name in self.names)

    def of(self, bonds, size: bool = False) -> np.ndarray:
        """(b, k); |F| |r| too if `size`."""
        out = np.empty((len(bonds), self.width + size))
        if not len(bonds):  # which need not have sources either
            return out
        if size:
            r2 = np.einsum("bc,bc->b", bonds.r_bc, bonds.r_bc)
            F_bc = bonds.F_bc
            out[:, -1] = np.abs(bonds.G_b) * r2 if F_bc is None else np.sqrt(r2 * np.einsum("bc,bc->b", F_bc, F_bc))
        at = 0
        for name, width in zip(self.names, self.widths):
            BOND[name].of(self, bonds, at, out)
            at += width
        return out

    def add_near(self, deposit, x_nc, bonds, thread: int, size: bool = False) -> None:
        """Into a deposit at a few points those of the bonds that are near one."""
        for found in deposit.find(x_nc, bonds.i, bonds.r_bc, thread):
            deposit.add_found(found, self.of(bonds.taken(found.bonds), size), thread)
