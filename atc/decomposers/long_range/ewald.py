"""The smooth part of Ewald's sum as a term of a potential: energy, forces and virials by its modes, and the correction
for slabs.

It has no bonds. What it adds to fields on a grid is in `stress`.
"""

from __future__ import annotations

from copy import copy
from math import pi, sqrt

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..base import Accumulator, Term, Work
from .sheet import Sheet
from .split import Split
from .transform import Direct, Transform, largest_of, twice, wave_vectors

# A cell whose charge is less than this (elementary charges) is neutral: LAMMPS's limit.
NEUTRAL = 1e-5
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


class LongRangeCoulomb(Term):
    """(1/2V) Σ_k (4πC/k²) e^{−k²/4α²} |ρ(k)|² − (αC/√π) Σ q²; its bonds C q_i q_j erfc(αd)/d are those of
    `CoulombLong`.

    The energy is shared as U^(j) = ½ q_j Φ(x_j) − (αC/√π) q_j², half of every pair to each end.

    Parameters
    ----------
    split : Split
    slab : float or None
        The cell is this many times as high along z as the frame's, which is open there, and the field of the dipole
        M_z, −4πC M_z/V, is added (Yeh & Berkowitz, J. Chem. Phys. 111 (1999) 3155): LAMMPS's ``kspace_modify slab``.
        Its energy 2πC M_z²/V is part of the strain derivative here.
    run : what the script asked for, see `RunAccuracy`, or None

    Notes
    -----
    Fields depend on α by a part whose divergence and integral are 0.
    """

    pairwise = True
    needs_charges = True
    #: no bonds, but modes: see `atc.estimators.field_pass`
    field = True
    #: what its attributes are called
    prefix = "coulomb"
    #: what of the tolerance its modes may take, over the usual
    share = 1.0

    def __init__(self, split: Split, slab: float | None = None, run=None):
        self.split, self.slab, self.run = split, slab, run
        self.threads, self._kept = 1, None
        #: (n_types + 1, n_types + 1) bool, the pairs of types with bonds; None: all
        self.covered = None
        #: whether some of the charges sit on virtual sites
        self.on_sites = False

    def __getstate__(self):
        return {**self.__dict__, "_kept": None}

    def use_threads(self, count: int) -> None:
        self.threads = count

    def describe(self) -> str:
        text = (
            f"Coulomb: straight bonds (erfc, alpha = {self.split.alpha:.6g}/angstrom, cutoff {self.split.cutoff:.6g} "
            "angstrom) and Maxwell's field of the smooth part"
        )
        return text + (f", slab correction in a cell {self.slab:g} times as high" if self.slab else "")

    def at(self, accuracy: float, alpha: float | None = None) -> LongRangeCoulomb:
        """The same with another accuracy, or α."""
        new = copy(self)
        new.split, new._kept = self.split.at(accuracy, alpha), None
        return new

    # --- the frame
    def check(self, frame: Frame) -> None:
        """Raise AtcError for frames that Ewald's sum is not made for."""
        frame.require("charges", why="long-range Coulomb")
        if frame.dimension == 2:
            raise AtcError(
                f"{frame.source}: long-range Coulomb of a two-dimensional run is not supported: use a cutoff style "
                "such as coul/dsf"
            )
        periodic = frame.cell.periodic
        if self.slab is None and not periodic.all():
            raise AtcError(
                f"{frame.source}: axis {'xyz'[int(np.argmin(periodic))]} of the cell is open, and kspace_style needs "
                "all three to be periodic: with boundary p p f add 'kspace_modify slab 3.0', as LAMMPS does"
            )
        if self.slab is not None:
            if not (periodic[:2].all() and not periodic[2]):
                raise AtcError(
                    f"{frame.source}: kspace_modify slab needs boundary p p f, but the cell is periodic along "
                    f"{''.join(a for a, p in zip('xyz', periodic) if p) or 'no axis'}"
                )
            v = frame.cell.vectors
            if np.abs([v[2, 0], v[2, 1], v[0, 2], v[1, 2]]).max() > 1e-12 * np.abs(v).max():
                raise AtcError(
                    f"{frame.source}: kspace_modify slab needs the cell's third edge along z and the others normal to "
                    "it"
                )
        self._check_types(frame)
        total = float(frame.charges.sum())
        if not abs(total) <= NEUTRAL:
            raise AtcError(
                f"{frame.source}: the cell has a charge of {total:.6g}, and Ewald sums of cells that are not neutral "
                "are not supported: their pressure is that of a background that no atom carries"
            )

    def _check_types(self, frame: Frame) -> None:
        """Charges whose bonds are left out would feel only the smooth part, which depends on the run's own α."""
        if self.covered is None or self.covered[1:, 1:].all():
            return
        charged = np.unique(frame.types[frame.charges != 0.0])
        for i in charged:
            for j in charged:
                if not (max(i, j) < len(self.covered) and self.covered[i, j]):
                    raise AtcError(
                        f"{frame.source}: atoms of types {min(i, j)} and {max(i, j)} have charges, but no long-range "
                        "pair style (…/coul/long) acts between these types: "
                        "what kspace_style alone makes of them depends on the run's own alpha"
                    )

    def box(self, frame: Frame):
        """(edge vectors, origin) of the periodic box of the modes."""
        vectors = np.array(frame.cell.vectors)
        if self.slab is not None:
            vectors[2] *= self.slab
        return vectors, frame.cell.origin

    def bare_field(self, frame: Frame) -> float:
        """E₀ = −4πC M_z/V, the field along z of the slab correction."""
        if self.slab is None:
            return 0.0
        volume = abs(float(np.linalg.det(self.box(frame)[0])))
        return -4 * pi * self.split.constant * float(frame.charges @ frame.positions[:, 2]) / volume

    def modes(self, frame: Frame, threads: int = 1):
        """`Smooth` of a frame; the last one is remembered."""
        if self._kept is None or self._kept[0] is not frame.positions or self._kept[1] is not frame.charges:
            self._kept = frame.positions, frame.charges, Smooth(self, frame, threads)
        return self._kept[2]

    def nodes(self, tolerance: float, wave: float, hat) -> int:
        """Of the integrals, see `nodes_for`."""
        from .stress import nodes_for

        return nodes_for(self.split, tolerance, wave, hat)

    def transforms(self, kinds, nodes: int) -> int:
        """How many transforms `Products` makes for some kinds of sums."""
        each = {"stress": (9, 14), "power": (10, 31), "power_lab": (10, 31)}
        return sum(each[k][0] + each[k][1] * nodes for k in kinds)

    def products(self, frame, layout, threads: int):
        """`Products` of a frame on a `field_pass.Layout`."""
        from .stress import Products

        return Products(
            self, frame, layout.largest, layout.tolerance, layout.nodes, threads, layout.wide, layout.single
        )

    def prepare(self, frame: Frame) -> Work:
        self.check(frame)
        return SmoothWork(self, frame)


class SmoothWork(Work):
    """The energy, virial and forces of a smooth part, by its modes."""

    stages = (1,)

    def __init__(self, term, frame):
        self.term, self.frame = term, frame

    def run(self, stage, task, acc: Accumulator):
        smooth = self.term.modes(self.frame, self.term.threads)
        acc.energy += smooth.energy
        acc.virial += smooth.virial_cc
        if acc.forces is not None:
            acc.forces[: len(self.frame)] += smooth.forces_nc()
        if acc.energies is not None:
            acc.energies[: len(self.frame)] += smooth.energies_n()
        return None


class Smooth:
    """The smooth part of one frame, by modes up to the term's accuracy.

    direct : sums term by term instead of by fast transforms
    """

    def __init__(self, term, frame: Frame, threads: int = 1, direct: bool = False, transform=None):
        split = self.split = term.split
        self.frame, self.E0 = frame, term.bare_field(frame)
        self.vectors, self.origin = term.box(frame)
        self.volume = abs(float(np.linalg.det(self.vectors)))
        if transform is None:
            largest = largest_of(split.largest_wave(), self.vectors)
            make = (lambda *a: Direct(*a[:3])) if direct else Transform
            transform = make(self.vectors, self.origin, largest, 0.1 * split.accuracy, threads)
        self.transform = transform
        self.k_c = wave_vectors(self.transform.index, self.vectors)
        self.q_n, self.x_nc = self.charges(frame), frame.positions
        self.rho = self.transform.modes(self.x_nc, self.q_n[:, None])[0]
        self.sheet = Sheet(self.q_n, self.x_nc[:, 2], split.constant, self.volume) if term.slab is not None else None

    # --- what is Coulomb's
    def charges(self, frame):
        return frame.charges

    def potentials(self):
        """V and dV/dk² of every mode."""
        k2 = self.k2
        with np.errstate(divide="ignore"):
            inverse_k2 = np.where(k2 > 0, 1.0 / k2, 0.0)
        V = 4 * pi * self.split.constant * inverse_k2 * np.exp(-self.split.s * k2)
        return V, -V * (self.split.s + inverse_k2)

    # They are not kept: a frame is remembered by its charges' modes alone.
    @property
    def k2(self):
        return sum(k * k for k in self.k_c)

    @property
    def V(self):
        return self.potentials()[0]

    @property
    def own_n(self):
        """The energy of every charge with itself, which the modes have."""
        return self.split.alpha * self.split.constant / sqrt(pi) * self.q_n**2

    @property
    def slab_energy(self) -> float:
        """2πC M_z²/V."""
        return 0.0 if self.sheet is None else self.sheet.energy

    @property
    def energy(self) -> float:
        modes = float((twice(self.transform.index) * self.V * np.abs(self.rho) ** 2).sum()) / (2 * self.volume)
        return modes - float(self.own_n.sum()) + self.slab_energy

    def _shapes(self):
        """V δ + 2 dV/dk² k⊗k, minus twice what a mode adds to the virial, of each of `_PAIRS`."""
        V, slope = self.potentials()
        for a, b in _PAIRS:
            out = 2.0 * slope * self.k_c[a] * self.k_c[b]
            yield out + V if a == b else out

    @property
    def virial_cc(self) -> np.ndarray:
        """Σ −r⊗F, tension positive: the strain derivative of the energy."""
        power = twice(self.transform.index) * np.abs(self.rho) ** 2
        out = np.empty((3, 3))
        for (a, b), shape in zip(_PAIRS, self._shapes()):
            out[a, b] = out[b, a] = -float((power * shape).sum()) / (2 * self.volume)
        return out + self.slab_energy * np.diag([-1.0, -1.0, 1.0])

    def potential_n(self) -> np.ndarray:
        """Φ at the charges, their own included; without the slab's."""
        return self.transform.at([self.V * self.rho / self.volume], self.x_nc)[:, 0]

    def energies_n(self) -> np.ndarray:
        """The atoms' shares."""
        q = self.q_n
        out = 0.5 * q * self.potential_n() - self.own_n
        return out if self.sheet is None else out + self.sheet.energies_n()

    def field_nc(self) -> np.ndarray:
        """E = −∇Φ at the charges, with the slab's."""
        F = self.V * self.rho / self.volume
        out = self.transform.at((-1j * k * F for k in self.k_c), self.x_nc)
        out[:, 2] += self.E0
        return out

    def forces_nc(self) -> np.ndarray:
        return self.q_n[:, None] * self.field_nc()

    def virials_n6(self) -> np.ndarray:
        """(n, 6) the atoms' shares of `virial_cc`: xx, yy, zz, yz, xz, xy."""
        F = self.rho / self.volume
        out = -0.5 * self.q_n[:, None] * self.transform.at((shape * F for shape in self._shapes()), self.x_nc)
        return out if self.sheet is None else out + self.sheet.virials_n6()

    def potential_rate_n(self, v_nc) -> np.ndarray:
        """∂Φ/∂t at fixed places, at the charges, for charges that move with v."""
        J = self.transform.modes(self.x_nc, self.q_n[:, None] * v_nc)
        rate = sum(-1j * k * j for k, j in zip(self.k_c, J))
        out = self.transform.at([self.V * rate / self.volume], self.x_nc)[:, 0]
        return out if self.sheet is None else out + self.sheet.potential_rate_n(v_nc)

    def share_rates_n(self, v_nc) -> np.ndarray:
        """dU^(j)/dt of the atoms' shares."""
        power = np.einsum("nc,nc->n", v_nc, self.forces_nc())
        return 0.5 * (self.q_n * self.potential_rate_n(v_nc) - power)
