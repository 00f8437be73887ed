"""Forces on atoms from outside: walls, fields, friction, forces that are set. No part of the stress; the body force of
the momentum balance.

A law gives the force that it adds to atoms on which `F_nc` acts already, so that laws that replace forces (``fix
setforce``) fit in: F_ext is what they put in the place of the others less these. Laws follow LAMMPS's manual; walls act
towards the inside of the box.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from ..frame import Frame
from .constraints.rules import Group


@dataclass(frozen=True)
class Law:
    """group : whose atoms. name : what to call it. where : what said so"""

    group: Group = field(default_factory=Group)
    name: str = ""
    where: str = ""

    def force(self, frame: Frame, F_nc, inside) -> np.ndarray:
        """(n, 3) what it adds to F_nc on the atoms `inside`."""
        raise NotImplementedError

    def told(self, frame: Frame) -> bool:
        """Whether it is known on whom it acts."""
        return self.group.told(frame)

    def inside(self, frame: Frame) -> np.ndarray:
        """(n,) bool, on whom it acts. AtcError where this is not known."""
        return self.group.inside(frame, self.where)


@dataclass(frozen=True)
class Constant(Law):
    """The same force on every atom, times its mass (gravity) or its charge (an electric field) with `per`."""

    vector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    per: str = ""

    def force(self, frame, F_nc, inside):
        f = np.array(self.vector)
        if self.per:
            frame.require(self.per, why=f"{self.where}: fix {self.name}")
            return getattr(frame, self.per)[:, None] * f
        return np.broadcast_to(f, F_nc.shape)


@dataclass(frozen=True)
class Put(Law):
    """Forces replaced by a value (None: left as they are); with `mean` by the mean of the group, plus the value."""

    values: tuple[float | None, ...] = (None, None, None)
    mean: bool = False

    def told(self, frame):
        return super().told(frame) or (frame.forces is not None and not self.mean)

    def inside(self, frame):
        """Where nothing else tells who is in the group: those on whom the run has just these forces."""
        if super().told(frame) or not self.told(frame):
            return super().inside(frame)
        F, put = frame.forces, np.array([np.nan if v is None else v for v in self.values])
        return (np.isnan(put) | (np.abs(F - put) <= 1e-6 * np.abs(put))).all(axis=1)

    def force(self, frame, F_nc, inside):
        out = np.zeros_like(F_nc)
        for c, value in enumerate(self.values):
            if value is not None:
                out[:, c] = (F_nc[inside, c].mean() if self.mean and inside.any() else 0.0) + value - F_nc[:, c]
        return out


@dataclass(frozen=True)
class Along(Law):
    """Only the force along a line stays, or with `plane` only that in the plane normal to it."""

    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    plane: bool = False

    def force(self, frame, F_nc, inside):
        e = np.array(self.direction) / np.linalg.norm(self.direction)
        along = (F_nc @ e)[:, None] * e
        return -along if self.plane else along - F_nc


@dataclass(frozen=True)
class Friction(Law):
    """−γ v; γ by type, times `scale`."""

    gamma: float = 0.0
    scale: tuple[tuple[int, float], ...] = ()

    def force(self, frame, F_nc, inside):
        frame.require("velocities", why=f"{self.where}: fix {self.name}")
        g = np.full(len(frame), self.gamma)
        for t, s in self.scale:
            g[frame.types == t] *= s
        return -g[:, None] * frame.velocities


#: −dU/dr of walls at distances r, by style, from their coefficients.
WALLS = {
    "wall/lj93": lambda r, e, s: e * (1.2 * s**9 / r**10 - 3.0 * s**3 / r**4),
    "wall/lj126": lambda r, e, s: 24.0 * e * (2.0 * s**12 / r**13 - s**6 / r**7),
    "wall/lj1043": lambda r, e, s: (
        2.0
        * np.pi
        * e
        * (4.0 * s**10 / r**11 - 4.0 * s**4 / r**5 - np.sqrt(2.0) * s**3 / (r + 0.61 / np.sqrt(2.0) * s) ** 4)
    ),
    "wall/harmonic": lambda r, e, rc: 2.0 * e * (rc - r),
    "wall/morse": lambda r, d, a, r0: 2.0 * d * a * (np.exp(-2.0 * a * (r - r0)) - np.exp(-a * (r - r0))),
}


@dataclass(frozen=True)
class Wall(Law):
    """A flat wall normal to an axis: side −1 the lower one, +1 the upper. at : its place, None: the face of the box.
    numbers : see `WALLS`; cutoff."""

    axis: int = 2
    side: int = -1
    at: float | None = None
    numbers: tuple[float, ...] = ()
    cutoff: float = 0.0

    def force(self, frame, F_nc, inside):
        cell = frame.cell
        if self.at is None and not cell.orthogonal:
            raise AtcError(
                f"{self.where}: fix {self.name} at the faces of a box that is not rectangular is not supported"
            )
        face = cell.origin[self.axis] + (cell.vectors[self.axis, self.axis] if self.side > 0 else 0.0)
        r = -self.side * (frame.positions[:, self.axis] - (face if self.at is None else self.at))
        near = inside & (r < self.cutoff)
        if (r[near] <= 0).any():
            bad = frame.ids[near][r[near] <= 0][0]
            raise AtcError(f"{frame.source}: atom {bad} is on or behind the wall of fix {self.name} ({self.where})")
        out = np.zeros_like(F_nc)
        out[near, self.axis] = -self.side * WALLS[self.name](r[near], *self.numbers)
        return out


@dataclass(frozen=True)
class Indenter(Law):
    """±K (R − r)² from a sphere, a cylinder along an axis, or a plane: outwards, or with `inward` on atoms outside of
    it, inwards."""

    shape: str = "sphere"
    axis: int = 2
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.0
    stiffness: float = 0.0
    inward: bool = False  # of a plane: on the side of larger coordinates

    def force(self, frame, F_nc, inside):
        d = frame.positions - np.array(self.centre)
        if self.shape == "plane":
            depth = d[:, self.axis] if self.inward else -d[:, self.axis]
            out = np.zeros_like(F_nc)
            out[:, self.axis] = (-1.0 if self.inward else 1.0) * self.stiffness * np.maximum(depth, 0.0) ** 2
            return out
        s = np.where(frame.cell.periodic, np.rint(d @ frame.cell.inverse), 0.0)
        d = d - s @ frame.cell.vectors
        if self.shape == "cylinder":
            d[:, self.axis] = 0.0
        r = np.linalg.norm(d, axis=1)
        depth = r - self.radius if self.inward else self.radius - r
        size = (-1.0 if self.inward else 1.0) * self.stiffness * np.maximum(depth, 0.0) ** 2
        return (size / np.where(r > 0, r, 1.0))[:, None] * d


@dataclass(frozen=True)
class OutsideForces:
    """All forces from outside that act in a run.

    laws : those that are understood, in the order in which they act. others : texts of those that are not
    """

    laws: tuple[Law, ...] = ()
    others: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether the laws are all there is."""
        return not self.others

    def told(self, frame: Frame) -> bool:
        """Whether the laws are all there is, and it is known on which atoms of a frame they act."""
        return self.known and all(law.told(frame) for law in self.laws)

    def of(self, frame: Frame, inner_nc) -> np.ndarray:
        """(n, 3) the forces of the laws on atoms on which the forces `inner_nc` between atoms act."""
        F = np.array(inner_nc)
        for law in self.laws:
            inside = law.inside(frame)
            F += np.where(inside[:, None], law.force(frame, F, inside), 0.0)
        return F - inner_nc

    def describe(self) -> str:
        return ", ".join([*(f"fix {law.name}" for law in self.laws), *self.others]) or "none"
