"""Constraints: distances and bodies that a run holds by forces between atoms. A constraint is a central bond of unknown
G, found for every frame.

Constraint forces are part of the stress, as large as half of it in rigid water. No trajectory holds them; what it holds
says them: the forces of the run, or velocities, by the equations of `constraint_solvers` and `rigid_bodies`. The forces
of everything else must be whole.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ...frame import Frame
from ..images import Images
from ..numbering import pair_codes
from .rigid_bodies import bodies_of
from .rules import Rule
from .solvers import System, molecules_of

#: What constraint forces can be found from, best first.
SOURCES = ("forces", "step", "velocities", "temperature")
#: Forces of a run that differ from the model's by less than this part do not contain those of constraints.
NOTHING = 1e-3


@dataclass
class Found:
    """Constraint forces of one frame.

    bonds : Bonds, central; levers : Bonds with forces across, or None
    source : one of `SOURCES`. error : how far the forces are off, relative to their rms, as far as the frame tells
        (NaN: it does not)
    count : independent constraints. molecules : that have some
    forces_nc : the constraint forces
    """

    bonds: Bonds
    levers: Bonds | None
    source: str
    error: float
    count: int
    molecules: int
    forces_nc: np.ndarray = field(repr=False, default=None)


class Constraints:
    """What a run holds fixed, and what to find the forces from that do it.

    Parameters
    ----------
    rules : `constraint_rules.Rule`s; each names pairs of atoms or bodies
    source : one of "forces", "step", "velocities", "temperature", or "auto", the best that the frames have (temperature
        only where it is given, and nothing else
        is there)
    temperature : internal units
    timestep : of the run, internal time; None: not known
    behind : by how many steps the velocities of the frames are behind their positions (0.5 for leap-frog programs such
        as GROMACS)
    contained : whether the forces in the frames contain those of the constraints; None: as the rules say, or as the
        forces look

    Raises AtcError where a frame has none of the sources, naming what to dump.
    """

    def __init__(self, rules, *, source="auto", temperature=None, timestep=None, behind=0.0, contained=None):
        self.rules: tuple[Rule, ...] = tuple(rules)
        if source != "auto" and source not in SOURCES:
            raise AtcError(f"constraints: source {source!r}: expected auto, {', '.join(SOURCES)}")
        self.source, self.temperature, self.timestep = source, temperature, timestep
        self.behind, self.contained = float(behind), contained

        #: Whether nobody said so: a reader's default.
        self.assumed = False
        #: Whether bodies carry loads across the plane or line they lie in.
        self.across = False
        self._last = None

    def settled(self, frame: Frame) -> Constraints:
        """The same for frames like this one, which is asked for what is needed."""
        self.require(frame)
        return self.but(across=any(b.thin for b in self.bodies(frame)))

    def in_file(self) -> Constraints | None:
        """What of these constraints the forces of a file contain, found from them."""
        rules = tuple(r for r in self.rules if not r.bodies)
        if not rules or self._said() is False:
            return None
        if rules == self.rules and self.source in ("auto", "forces"):
            return self
        return self.but(rules=rules, source="forces", across=False)

    def but(self, **changes) -> Constraints:
        """The same with some attributes changed."""
        new = copy(self)
        new._last = None
        for name, value in changes.items():
            setattr(new, name, value)
        return new

    def describe(self) -> str:
        return f"constraints: {self.holds}"

    @property
    def holds(self) -> str:
        """What is held, in words."""
        return ", ".join(dict.fromkeys(r.describe() for r in self.rules))

    def attributes(self, found: Found) -> dict:
        """For an output: what is held, and how its forces were found."""
        text = f"{found.count} in {found.molecules} molecules ({self.holds})"
        out = {"constraints": text, "constraint_source": found.source}
        if np.isfinite(found.error):
            out["constraint_error"] = found.error
        return out

    @property
    def where(self) -> str:
        return self.rules[0].where or "constraints"

    # --- what is held

    def pairs(self, frame: Frame) -> np.ndarray:
        """(c, 2) atoms whose distances are held, each pair once."""
        return self._kept(frame)[0]

    def _kept(self, frame: Frame):
        """Pairs, molecules and the topology of a frame without what is held: the same for frames of the same atoms and
        bonds."""
        known = (frame.topology, frame.types, frame.masses, frame.groups, frame.ids, frame.molecules)
        last = self._last
        if last is not None and all(
            a is b or (isinstance(a, np.ndarray) and np.array_equal(a, b)) for a, b in zip(known, last[0], strict=True)
        ):
            return last[1]
        n = len(frame)
        pairs = np.stack(np.divmod(self._held(frame), max(n, 1)), 1)
        self._last = known, (pairs, molecules_of(pairs, n), self._released(frame))
        return self._last[1]

    def _held(self, frame: Frame, releases=(True, False)) -> np.ndarray:
        """`pair_codes` of the distances that rules hold, each once."""
        found = [r.pairs(frame) for r in self.rules if not r.bodies and r.releases in releases]
        return np.unique(pair_codes(np.concatenate([np.zeros((0, 2), np.int64), *found]), len(frame)))

    def __getstate__(self):
        return {**self.__dict__, "_last": None}

    def bodies(self, frame: Frame):
        """`rigid_bodies.Bodies`, of every rule."""
        return [b for r in self.rules if r.bodies for b in bodies_of(r.labels(frame), frame, r.where or r.describe())]

    def released(self, frame: Frame) -> Frame:
        """The frame without the bonds and angles that are held instead of having energies; who is bonded to whom stays
        known."""
        top = self._kept(frame)[2]
        return frame if top is frame.topology else frame.replace(topology=top)

    def _released(self, frame: Frame):
        top = frame.topology
        if top is None or top.untold or not any(r.releases for r in self.rules):
            return top
        n = len(frame)
        label = np.full(n, -1, np.int64)
        for r in self.rules:
            if r.releases and r.bodies:
                label = np.where(label < 0, r.labels(frame), label)
        code = self._held(frame, (True,))

        def off(atoms, ends):
            rigid = (label[atoms[:, ends[0]]] >= 0) & (label[atoms[:, ends[0]]] == label[atoms[:, ends[1]]])
            return rigid | np.isin(pair_codes(atoms[:, list(ends)], n), code)

        bonds = off(top.bonds, (0, 1))
        angles = off(top.angles, (0, 1)) & off(top.angles, (1, 2)) & off(top.angles, (0, 2))
        if not (bonds.any() or angles.any()):
            return top
        new = replace(
            top, bond_types=np.where(bonds, 0, top.bond_types), angle_types=np.where(angles, 0, top.angle_types)
        )
        new.weighted = top if top.weighted is None else top.weighted
        new.special = top.special
        return new

    def degrees(self, frame: Frame) -> np.ndarray:
        """(n,) degrees of freedom of each atom: those whose mean kinetic energy it has. Their sum is d N minus the
        number of constraints."""
        out = np.full(len(frame), float(frame.dimension))
        frame.require("masses", why="degrees of freedom of constrained atoms")
        out[frame.masses == 0.0] = 0.0  # virtual sites
        for system in self._systems(frame)[0]:
            np.subtract.at(out, system.molecules.atoms_ma, system.taken_ma())
        for b in self.bodies(frame):
            out[b.atoms_ma] = b.degrees_ma()
        return out

    def taken(self, frame: Frame) -> int:
        """How many degrees of freedom the constraints take of a frame."""
        return round(frame.dimension * len(frame) - float(self.degrees(frame).sum()))

    def _systems(self, frame):
        pairs, molecules, _ = self._kept(frame)
        i, j = (np.ascontiguousarray(pairs[:, k], dtype=np.int32) for k in (0, 1))
        r = np.empty((len(pairs), 3))
        Images(frame.cell).vectors_to(frame.positions, i, j, r)
        return [System(m, r, frame.masses) for m in molecules], pairs, r

    # --- what from

    def source_for(self, frame: Frame, of_bodies: bool = False, without: bool = False) -> str:
        """The source for a frame. `of_bodies`: for rigid bodies; `without`: whether the frame's forces do not contain
        those of constraints.

        Raises AtcError where there is none.
        """
        forces_only = any(r.forces_only for r in self.rules) and not of_bodies
        have = {
            "forces": frame.forces is not None and not of_bodies and not without,
            "step": frame.velocities is not None and self.timestep is not None and not of_bodies,
            "velocities": frame.velocities is not None,
            "temperature": self.temperature is not None,
        }
        if self.source != "auto":
            source = "velocities" if of_bodies and self.source in ("forces", "step") else self.source
            if have[source]:
                return source
            needs = {
                "forces": "the forces of the run (dump fx fy fz too)"
                if not without
                else "forces that contain those of the constraints",
                "step": "velocities (dump vx vy vz too)"
                if frame.velocities is None
                else "the time step: timestep in [constraints]",
                "velocities": "velocities (dump vx vy vz too)",
                "temperature": "the temperature: temperature in [constraints]",
            }[source]
            raise AtcError(f"{frame.source}: constraint forces from {source} ({self.where}) need {needs}")
        usable = SOURCES if not forces_only else ("forces", "temperature")
        for source in usable:
            if have[source]:
                return source
        dump = "fx fy fz" if forces_only else "vx vy vz" if of_bodies or without else "fx fy fz (best), or vx vy vz,"
        more = (
            ', or take the velocities by name: source = "velocities" in [constraints]'
            if forces_only and frame.velocities is not None
            else ""
        )
        raise AtcError(
            f"{frame.source}: the forces that hold atoms ({self.holds}, {self.where}) are part of the stress, and the "
            f"frame does not say them: dump {dump} too, or give the temperature for their mean: temperature in "
            f"[constraints]{more}"
        )

    def require(self, frame: Frame) -> None:
        """Raise AtcError where a frame says nothing of the constraint forces."""
        frame.require("masses", why="the forces of constraints")
        if any(not r.bodies for r in self.rules):
            self.source_for(frame, without=self._said() is False)
        if any(r.bodies for r in self.rules):
            self.source_for(frame, of_bodies=True)

    def _said(self):
        """Whether forces contain those of constraints, as far as it was said."""
        if self.contained is not None:
            return self.contained
        said = {r.contained for r in self.rules if not r.bodies}
        return said.pop() if len(said) == 1 else None

    # --- the forces

    def found(self, frame: Frame, model_nc, outside_nc=None) -> Found:
        """The constraint forces of a frame.

        Parameters
        ----------
        frame : Frame with the run's forces, or velocities
        model_nc : (n, 3) forces of everything else between atoms. outside_nc : of known forces from outside, or None
        """
        frame.require("masses", why="the forces of constraints")
        acting = model_nc if outside_nc is None else model_nc + outside_nc
        parts, levers, sources = [], [], []
        errors, count, many = [], 0, 0
        total = np.zeros_like(acting)
        systems, pairs, r_c3 = self._systems(frame)
        if len(pairs):
            without = self._without(frame, acting, systems)
            source = self.source_for(frame, without=without)
            lam = np.zeros(len(pairs))
            left = _Left()
            for s in systems:
                lam[s.molecules.which_mc] = self._solve(s, source, frame, acting, left)
                count, many = count + int(s.rank_m.sum()), many + len(s.rank_m)
            length = np.sqrt((r_c3**2).sum(1))
            bonds = Bonds(pairs[:, 0].astype(np.int32), pairs[:, 1].astype(np.int32), r_c3, lam / length)
            parts.append(bonds)
            sources.append(source)
            errors.append(left.error(lam))
        bodies = self.bodies(frame)
        if bodies:
            source = self.source_for(frame, of_bodies=True)
            off = []
            for b in bodies:
                omega = None
                if source == "velocities":
                    _, omega, relative = b.motion(frame.velocities)
                    off.append(relative)
                central, across = b.carried(b.holding(acting, omega, None if omega is not None else self._kT(frame)))
                i, j, r, G = central
                parts.append(Bonds(i.astype(np.int32), j.astype(np.int32), r, -G))
                if across is not None:
                    i, j, r, F = across
                    levers.append(Bonds(i.astype(np.int32), j.astype(np.int32), r, np.zeros(len(i)), F_bc=F))
                count += b.atoms_ma.size * frame.dimension - round(b.degrees_ma().sum())
                many += len(b.atoms_ma)
            sources.append(source)
            # Centripetal forces are quadratic in velocities.
            errors.append(2.0 * max(off) if off else float("nan"))
        bonds = Bonds.concatenate(parts)
        for part in (bonds, *levers):
            F = part.forces()
            np.add.at(total, part.i, F)
            np.subtract.at(total, part.j, F)
        source = ", ".join(dict.fromkeys(sources)) or "forces"
        error = float(np.max(errors)) if errors else 0.0
        return Found(bonds, Bonds.concatenate(levers) if levers else None, source, error, count, many, total)

    def _kT(self, frame):
        return frame.units.boltzmann * self.temperature

    def _without(self, frame, acting, systems) -> bool:
        """Whether the forces of a frame do not contain those of the constraints."""
        said = self._said()
        if frame.forces is None or said is not None:
            return said is False
        atoms = np.unique(np.concatenate([s.molecules.atoms_ma.ravel() for s in systems]))
        D, F = (frame.forces - acting)[atoms], frame.forces[atoms]
        return bool(np.sqrt((D**2).sum()) <= NOTHING * np.sqrt((F**2).sum()))

    def _solve(self, s: System, source, frame, acting, left: _Left):
        mol = s.molecules
        w = s.inverse_mass_ma[:, :, None]
        if source == "forces":
            D = mol.of(frame.forces - acting)
            lam = s.by_forces(mol.difference(D * w))
            left.forces(s, D, lam, frame.dimension)
            return lam
        a = mol.difference(mol.of(acting) * w)
        if source == "temperature":
            return s.by_motion(a, s.mean_squares(self._kT(frame), frame.dimension))
        v = mol.difference(mol.of(frame.velocities))
        if source == "step":
            lam = s.by_step(a, v, self.timestep, self.behind)
        else:
            lam = s.by_motion(a, np.einsum("mbx,mbx->mb", v, v))
        left.velocities(s, a, v, lam, self.timestep if source == "step" else None, self.behind)
        return lam


class _Left:
    """What a solution leaves of the equations that it was not made of: its error."""

    def __init__(self):
        self.square, self.free = 0.0, 0  # of what is left, and over how many numbers
        self.kind = ""
        self.rows: list[tuple] = []

    def forces(self, s, D, lam, dimension):
        """Of the forces: components perpendicular to the constraints."""
        mol, m = s.molecules, np.arange(len(D))[:, None]
        left = D.copy()
        f = lam[:, :, None] * s.e_mcx
        for end, sign in ((0, 1.0), (1, -1.0)):
            np.add.at(left, (m, mol.ends_mc2[:, :, end]), sign * f)
        self.kind = "forces"
        self.square += float((left**2).sum())
        self.free += dimension * D.shape[0] * D.shape[1] - int(s.rank_m.sum())

    def velocities(self, s, a, v, lam, dt, behind):
        """Of velocities: r·v = −½ Δt² v·a, which says the time step where it is not known, and the digits of the
        velocities."""
        self.kind = "velocities"
        acc = a + s.accelerations(lam)
        if dt is not None:
            v = v + behind * dt * acc
        along, va, a2 = (np.einsum("mbx,mbx->mb", *two) for two in ((s.e_mcx, v), (v, acc), (acc, acc)))
        self.rows.append((s, along, va / s.length_mc, v, a2, dt))

    def error(self, lam_c) -> float:
        size = float(np.sqrt((lam_c**2).mean())) if len(lam_c) else 0.0
        if not size > 0:
            return 0.0 if not self.square else float("nan")
        if self.kind == "forces":
            # Both ends of every constraint.
            return float(np.sqrt(self.square / max(self.free, 1)) / size)
        if self.kind == "velocities":
            along, va = (np.concatenate([row[k].ravel() for row in self.rows]) for k in (1, 2))
            dt = self.rows[0][5]
            if dt is None:
                dt2 = max(-2.0 * float((along * va).sum()) / max(float((va**2).sum()), 1e-300), 0.0)
            else:
                dt2 = dt * dt
            off = float(
                np.sqrt(((along + 0.5 * dt2 * va) ** 2).mean())
            )  # velocities that nothing explains, along one direction of three
            change = []
            for s, _, _, v, a2, _ in self.rows:
                by_digits = 2.0 * off * np.sqrt((v**2).sum(2)) / s.length_mc
                by_step = 0.25 * dt2 * a2 / s.length_mc if dt is None else 0.0 * a2
                digits = (np.abs(s.inverse_mcc) @ np.sqrt(by_digits**2)[:, :, None])[:, :, 0]
                change.append((digits**2 + s.solve(by_step) ** 2).ravel())
            return float(np.sqrt(np.concatenate(change).mean()) / size)
        return float("nan")
