"""A linear bond-based peridynamic body on a lattice of nodes: a kernel sampled bond by bond, stepped by velocity
Verlet, and wave packets in it.

m ü_i = Σ_j S(ξ_ij) (u_j − u_i), S(ξ) = C(ξ) V² for a continuous kernel, the spring constants themselves for lattices.
Internal units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import pd
from ..contracts import Micromodulus
from ..errors import AtcError
from ..frame import Cell
from ..pd.sampling import check_moduli, dynamical_matrix, long_waves
from .force_constants import signed_root
from .peridynamic_kernels import CoarseLattice, Lattice, _unit


@dataclass
class Stencil:
    """The bonds of a node of a lattice.

    Attributes
    ----------
    vectors : (3, 3) rows: the lattice of nodes. offsets : (b, 3) ints, where the bonds go. springs : (b, 3, 3)
        energy/length². mass : of a node.
    """

    vectors: np.ndarray
    offsets: np.ndarray
    springs: np.ndarray
    mass: float
    label: str = "stencil"

    @classmethod
    def of_kernel(cls, model, spacing: float, *, check: bool = True) -> Stencil:
        """A continuous kernel of one displacement field on a simple cubic lattice: the midpoint rule, bond by bond.

        Its dispersion is that of the sum, not of the integral; the difference falls with the spacing. `check`: the
        nodes' moduli are compared with the kernel's own (see `sampled_moduli`); they are warned about beyond 2 % and
        refused beyond 10 %. `check=False` is for looking at how the sum converges.
        """
        if not isinstance(model, Micromodulus) or model.fields > 1:
            raise AtcError(f"{model.label}: expected a continuous kernel with one displacement field")
        m = int(np.floor(model.horizon / spacing * (1 + 1e-12)))
        n = np.stack(np.meshgrid(*(np.arange(-m, m + 1),) * 3, indexing="ij"), -1).reshape(-1, 3)
        xi = n * spacing
        r = np.linalg.norm(xi, axis=1)
        near = (r > 0) & (r <= model.horizon)
        n, xi = n[near], xi[near]
        parts = np.array_split(xi, max(1, len(xi) // 4000))
        springs = np.concatenate([model.kernel(part) for part in parts]) * spacing**6
        on = np.abs(springs).max(axis=(1, 2)) > 0
        made = cls(np.eye(3) * spacing, n[on], springs[on], model.crystal.density * spacing**3, model.label)
        if check:
            check_moduli(made.dynamical_matrix, model, spacing)
        return made

    @classmethod
    def of_lattice(cls, model) -> Stencil:
        """A `Lattice` with one atom a cell, or a `CoarseLattice`: nodes and bonds as they are."""
        if isinstance(model, Lattice) and len(model.crystal) == 1:
            r, springs, vectors, mass = model.fc.r_bc, -model.fc.phi_bcc, model.crystal.vectors, model.crystal.masses[0]
        elif isinstance(model, CoarseLattice):
            (r, springs), vectors, mass = model.springs(), model.crystal.vectors * model.factor, model.basis.mass
        else:
            raise AtcError(f"{model.label}: expected a lattice with one node a cell")
        return cls(vectors, np.rint(r @ np.linalg.inv(vectors)).astype(int), springs, float(mass), model.label)

    def dynamical_matrix(self, k_kc) -> np.ndarray:
        """(k, 3, 3) exact for an infinite body of these nodes."""
        return dynamical_matrix(k_kc, self.offsets @ self.vectors, self.springs, self.mass)

    def radial_gradient(self, k_kc) -> np.ndarray:
        k = np.atleast_2d(np.asarray(k_kc, float))
        r = self.offsets @ self.vectors
        return np.tensordot(np.sin(k @ r.T) * (_unit(k) @ r.T), self.springs, axes=1) / self.mass


class LinearBody:
    """A block of nodes with the bonds of a stencil, its state, and velocity Verlet.

    Parameters
    ----------
    stencil : Stencil
    repeat : nodes along each lattice vector
    periodic : along each; open sides simply lose the bonds that lead outside
    dt : time step; default 0.2 of the stable one, 2/ω_max

    Attributes
    ----------
    positions : (n, 3) reference positions. u, v : (n, 3) displacements and velocities (set them, then `run`).
    """

    def __init__(self, stencil: Stencil, repeat, periodic=(True, True, True), dt: float | None = None):
        from scipy.sparse import bsr_matrix, coo_matrix

        self.stencil, self.repeat = stencil, tuple(int(r) for r in repeat)
        index = np.stack(np.meshgrid(*(np.arange(r) for r in self.repeat), indexing="ij"), -1).reshape(-1, 3)
        self.positions = index @ stencil.vectors
        n = len(index)
        periodic = np.broadcast_to(periodic, (3,))
        size = np.array(self.repeat)
        # Bonds that lead to the same node of a periodic block are added up first: few are left in a thin bar.
        wrapped = np.where(periodic, stencil.offsets % size, stencil.offsets)
        offsets, same = np.unique(wrapped, axis=0, return_inverse=True)
        springs = np.zeros((len(offsets), 3, 3))
        np.add.at(springs, same.ravel(), stencil.springs)
        itself = (offsets == 0).all(axis=1)  # a node and its own image: no relative displacement
        offsets, springs = offsets[~itself], springs[~itself]
        if n * len(offsets) > 5e7:
            raise AtcError(
                f"a body of {n} nodes with {len(offsets)} bonds each takes too much memory: take fewer nodes or a "
                "wider spacing"
            )
        there = (index[:, None, :] + offsets[None]).reshape(-1, 3)
        inside = (((there >= 0) & (there < size)) | periodic).all(axis=1)
        row = np.repeat(np.arange(n), len(offsets))[inside]
        column = np.ravel_multi_index((there[inside] % size).T, self.repeat)
        which = np.tile(np.arange(len(offsets)), n)[inside]
        blocks = {
            (a, b): coo_matrix((springs[which, a, b], (row, column)), shape=(n, n)).tocsr() for a, b in np.ndindex(3, 3)
        }
        pattern = sum(abs(m) for m in blocks.values()).tocsr()
        pattern.sort_indices()
        r, c = pattern.nonzero()
        data = np.empty((len(r), 3, 3))
        for (a, b), m in blocks.items():
            data[:, a, b] = np.asarray(m[r, c]).ravel()
        order = np.lexsort((c, r))
        self._S = bsr_matrix((data[order], c[order], np.searchsorted(r[order], np.arange(n + 1))), shape=(3 * n, 3 * n))
        self._onsite = np.zeros((n, 3, 3))
        np.add.at(self._onsite, r, data)
        self.u, self.v = np.zeros((n, 3)), np.zeros((n, 3))
        self.omega_max = self._largest()
        self.dt = 0.4 / self.omega_max if dt is None else float(dt)
        self.time = 0.0

    def forces(self) -> np.ndarray:
        """(n, 3)"""
        return (self._S @ self.u.ravel()).reshape(-1, 3) - np.einsum("nij,nj->ni", self._onsite, self.u)

    def _largest(self) -> float:
        """The largest ω of the body, by Lanczos."""
        from scipy.sparse.linalg import LinearOperator, eigsh

        n = len(self.positions)

        def pull(u):
            return np.einsum("nij,nj->ni", self._onsite, u.reshape(n, 3)).ravel() - self._S @ u.ravel()

        start = np.random.default_rng(0).normal(size=3 * n)
        how = {"k": 1, "which": "LA", "v0": start, "tol": 1e-3, "return_eigenvectors": False}
        top = eigsh(LinearOperator((3 * n, 3 * n), pull, dtype=float), **how)[0]
        return float(np.sqrt(top / self.stencil.mass))

    def energies(self) -> np.ndarray:
        """(n,) kinetic energy, and half of every bond's energy to each of its ends."""
        # ½·½ Σ_j (u_j − u_i)·S·(u_j − u_i) over i's bonds
        S2 = np.einsum("ni,nij,nj->n", self.u, self._onsite, self.u)
        cross = np.einsum("ni,ni->n", self.u, (self._S @ self.u.ravel()).reshape(-1, 3))
        other = self._quadratic_of_neighbours()
        return 0.5 * self.stencil.mass * (self.v**2).sum(axis=1) + 0.25 * (S2 - 2 * cross + other)

    def _quadratic_of_neighbours(self):
        """(n,) Σ_j u_j·S_ij·u_j."""
        S = self._S
        out = np.einsum("bi,bij,bj->b", self.u[S.indices], S.data, self.u[S.indices])
        return np.add.reduceat(np.append(out, 0.0), S.indptr[:-1]) * (np.diff(S.indptr) > 0)

    def run(self, steps: int) -> None:
        """`steps` steps of velocity Verlet."""
        m, f = self.stencil.mass, self.forces()
        for _ in range(steps):
            self.v += 0.5 * self.dt / m * f
            self.u += self.dt * self.v
            f = self.forces()
            self.v += 0.5 * self.dt / m * f
        self.time += steps * self.dt


class PeridynamicBody:
    """The same nodes as a body of the peridynamics engine (`atc.pd`, material `Linear`), periodic, with `LinearBody`'s
    attributes.

    Parameters
    ----------
    model : the continuous kernel; its horizon is the body's, its kernel the micromodulus
    stencil : `Stencil.of_kernel` of it; repeat : nodes along each axis. dt : default 0.4 of the engine's own stable
        step
    """

    def __init__(self, model, stencil: Stencil, repeat, dt: float | None = None):

        index = np.stack(np.meshgrid(*(np.arange(r) for r in repeat), indexing="ij"), -1).reshape(-1, 3)
        volume = abs(np.linalg.det(stencil.vectors))
        x, cell = index @ stencil.vectors, Cell(stencil.vectors * np.array(repeat)[:, None])
        body = pd.Body(x, volume, model.crystal.density, model.horizon, cell=cell, warn=False)
        self.simulation = sim = pd.Simulation(body, pd.Linear(model.kernel), dt=dt, safety=0.4)
        self.stencil, self.positions, self.dt = stencil, body.X_nc, sim.dt
        self.u, self.v = sim.state.u_nc, sim.state.v_nc
        self.time, self._fresh = 0.0, True

    def energies(self) -> np.ndarray:
        """(n,) kinetic and strain energy of each node."""
        return 0.5 * self.stencil.mass * (self.v**2).sum(axis=1) + self.simulation.strain_energy_n()

    def run(self, steps: int) -> None:
        sim = self.simulation
        if self._fresh:  # displacements were set from outside: the forces that go with them
            sim._all_forces(damage=False)
            self._fresh = False
        sim.step(steps)
        self.time += steps * self.dt


@dataclass
class Packet:
    """A wave packet's journey: internal units.

    k : |k|. omega, group : predicted by the stencil, the group velocity with Verlet's own (known) dispersion at this
        time step; model_group : by the kernel it samples (None for lattices). measured : from the centroid of the
        energy.
    travelled : how far. energy_drift : largest relative change of the energy.
    """

    k: float
    omega: float
    group: float
    model_group: float | None
    measured: float
    travelled: float
    energy_drift: float


def wave_packet(
    stencil: Stencil,
    k: float,
    polarisation=(1, 0, 0),
    *,
    model=None,
    periods: float = 40.0,
    waves: float = 16.0,
    cross=(1, 1),
    dt=None,
    make_body=None,
) -> Packet:
    """Send a packet of waves along the lattice's first vector and time it.

    The start only knows k and ω: u = p A(x) cos kx, v = p A(x) ω sin kx with a Gaussian A; how fast its energy moves is
    what the body makes of it.

    Parameters
    ----------
    stencil : Stencil; its first vector is the direction, normal to the other two
    k : |k|. polarisation : (3,), an eigenvector of D(k)
    model : the continuous kernel that the stencil samples, for its prediction
    periods : length of the run in periods of the wave. waves : wave lengths in the packet (± 3 standard deviations are
        6 · waves / 6)
    cross : nodes across the periodic bar
    dt : time step; default the body's
    make_body : called as ``make_body(stencil, repeat, dt=dt)``: what the packet travels in, with `LinearBody`'s
        attributes; default `LinearBody`.
        `PeridynamicBody` takes the peridynamics engine.

    Raises
    ------
    AtcError if the wave is unstable in this body (ω² < 0).
    """
    e = stencil.vectors[0] / np.linalg.norm(stencil.vectors[0])
    if np.abs(stencil.vectors[1:] @ e).max() > 1e-9:
        raise AtcError("a wave packet needs nodes in rows: the lattice's first vector must be normal to the other two")
    p = np.array(polarisation, float) / np.linalg.norm(polarisation)
    spacing = np.linalg.norm(stencil.vectors[0])

    def prediction(m):
        value = float(np.real(p @ m.dynamical_matrix(k * e[None])[0] @ p))
        if value <= 0:
            raise AtcError(f"{stencil.label}: the wave of k = {k:.4g} is unstable (ω² = {value:.3g})")
        return np.sqrt(value), float(np.real(p @ m.radial_gradient(k * e[None])[0] @ p)) / (2 * np.sqrt(value))

    omega, spatial = prediction(stencil)
    width = waves * 2 * np.pi / k / 6.0
    duration = periods * 2 * np.pi / omega
    length = 12 * width + abs(spatial) * duration
    body = (make_body or LinearBody)(stencil, (int(np.ceil(length / spacing)), *cross), dt=dt)
    # Verlet's own dispersion: sin(ω' Δt/2) = ω Δt/2.
    group = spatial / np.sqrt(1 - (0.5 * omega * body.dt) ** 2)
    x = body.positions @ e
    start = 6 * width if spatial >= 0 else length - 6 * width
    envelope = np.exp(-0.5 * ((x - start) / width) ** 2)
    body.u[:] = (envelope * np.cos(k * (x - start)))[:, None] * p
    body.v[:] = (envelope * omega * np.sin(k * (x - start)))[:, None] * p
    energy = body.energies()
    first, total = float(x @ energy / energy.sum()), energy.sum()
    legs, times, drift = [first], [0.0], 0.0
    steps = max(1, round(duration / body.dt / 8))
    for _ in range(8):
        body.run(steps)
        energy = body.energies()
        legs.append(float(x @ energy / energy.sum()))
        times.append(body.time)
        drift = max(drift, abs(energy.sum() / total - 1))
    speed = np.polyfit(times, legs, 1)[0]
    of_model = None if model is None else prediction(model)[1]
    return Packet(k, omega, group, of_model, float(speed), legs[-1] - first, float(drift))


def sampled_moduli(stencil: Stencil, model) -> np.ndarray:
    """(3 directions, 3) stiffness ρω²/k² of long waves along [100], [110], [111] in the nodes' sum over that in the
    kernel's integral, branches ascending; 1 is exact. NaN where the kernel has none."""
    return long_waves(stencil.dynamical_matrix, model)


def discretisation_error(stencil: Stencil, model, k_kc) -> np.ndarray:
    """(k, 3) relative difference of ω of the nodes' sum and of the kernel's integral, branches ascending."""
    a, b = (signed_root(np.linalg.eigvalsh(m.dynamical_matrix(k_kc))) for m in (stencil, model))
    return a / b - 1
