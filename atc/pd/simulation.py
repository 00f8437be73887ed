"""A run: a body, its materials, what acts on it, and the state that velocity Verlet carries on."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..frame import Cell
from .blocks import Crew
from .conditions import BodyForce, Prescribed
from .conduction import Conduction, FixedTemperature, HeatFlow, HeatSource
from .contact import Contact, ContactSearch
from .damage import damage_n
from .integrate import chunks, drift, kick, kick_drift, kick_end, kinetic, power, total
from .materials.base import Material
from .materials.force_model import BondForces
from .state import Energies, State, no_bonds


def _as_list(x) -> list:
    return [] if x is None else list(x) if isinstance(x, (list, tuple)) else [x]


class Simulation:
    """Peridynamic body under loads.

    Parameters
    ----------
    body : Body
    materials : a material, or {material number: material}
    damage : None (bonds never break), a CriticalStretch, a CriticalEnergy (ordinary state-based bodies), or {material
        or (a, b): one of these}
    no_fail : region or list of regions: bonds with an end in one of them never break
    contact : None or False (none), True, or a `Contact`
    indenter, walls : one or several `Indenter`, `Wall`
    conditions : `Prescribed` and `BodyForce` objects
    damping : rate γ of a force density −γ ρ v (1/time)
    interfaces : {(a, b): factor}, how stiff the bonds between two materials are relative to the default, which is
        springs in series (PMB) or
        half of each side (LPS); for PMB also {(a, b): PMB}. For interfaces without bonds see `Body(unbonded=)`.
    dt : time step; None takes `safety` times the stable step
    state : a `State` to go on from (bitwise); or `velocities`, `displacements` : (n, 3) or (3,) to start with
    strain : (3, 3) displacement gradient H of a periodic body: nodes start at u = H X and images are moved by H too
    temperature : how far the temperature has risen from that of the reference, a number or (n,): bodies of LPS or
        Elastic with `expansion` are at rest expanded; `heat` changes it between steps or equilibria
    conduction : a `Conduction`, or {material: one}: heat flows in the bonds from step to step (and from equilibrium to
        equilibrium), between `FixedTemperature` and `HeatSource` conditions; `temperature` is how it starts
    threads : 0 is all cores. Results do not depend on it.
    lammps_compat : reproduce LAMMPS's faults (extensions below 2.2e-16 are none, the weighted volume of periodic LPS
        bodies without images, its
        LPS energy)

    Attributes: ``state``, ``dt``, ``body``, ``n_broken``, ``cell`` (the body's, deformed by `strain`).
    """

    def __init__(
        self,
        body,
        materials,
        *,
        damage=None,
        no_fail=None,
        contact=None,
        indenter=None,
        walls=None,
        conditions=(),
        damping=0.0,
        interfaces=None,
        dt=None,
        safety=0.7,
        state=None,
        velocities=None,
        displacements=None,
        strain=None,
        temperature=None,
        conduction=None,
        threads=0,
        lammps_compat=False,
    ):
        if isinstance(materials, Material):
            materials = {m: materials for m in np.unique(body.material_n).tolist()}
        classes = {m.model for m in materials.values()}
        if len(classes) != 1:
            raise AtcError(
                "the materials of one body must be of one class: "
                + ", ".join(sorted({m.name for m in materials.values()}))
            )
        self.body, self.materials = body, materials
        n = len(body)
        self.crew = Crew(threads if n > 4096 else 1)
        self.model = classes.pop()(body, materials, self.crew, damage, lammps_compat, interfaces)
        self.damages = self.model.rule.active
        self.mass_n = body.rho_n * body.V_n
        self.damping = float(damping)
        if self.damping < 0:
            raise AtcError(f"damping must be zero or positive, got {damping!r}")
        self._choose_step(dt, safety)
        contact = Contact() if contact is True else contact
        self.contact = None
        if contact:
            ids = np.array(self.model.ids)
            index = np.searchsorted(ids, body.material_n).astype(np.int64) if len(ids) > 1 else np.zeros(n, np.int64)
            self.contact = ContactSearch(body, contact, self.model.contact_constant(), (index, len(ids)), self.crew)
        self.rigid = [r.bind(body) for r in _as_list(indenter) + _as_list(walls)]
        self._sort([c.bind(body) for c in _as_list(conditions)], conduction)
        self.frictional = any(r.friction for r in self.rigid) or bool(contact and contact.friction)
        self._z = self.model.at_rest()
        self._deform(strain)
        self._warm_n = None
        if temperature is not None and self.heat_flow is None:
            self._warm(temperature)
        fresh = state is None
        state = State.rest(body) if fresh else state.copy()
        if strain is not None and fresh:
            state.u_nc[:] = body.X_nc @ np.array(strain, float).T
        for name, value, out in (("velocities", velocities, state.v_nc), ("displacements", displacements, state.u_nc)):
            if value is not None:
                if not fresh:
                    raise AtcError(f"{name} cannot be given together with a state")
                value = np.asarray(value, float)
                if value.shape not in ((3,), (n, 3)):
                    raise AtcError(f"{name} must have shape (3,) or ({n}, 3), got {value.shape}")
                out += value
        self._take(state)
        if self.heat_flow is not None:
            self._start_heat(0.0 if temperature is None else temperature)
        if fresh:
            self._never_breaking(_as_list(no_fail))
            self._impose_start()
        self.n_broken = int(np.count_nonzero(self.state.intact_b == 0))
        energies = self._all_forces(damage=False) if fresh else self._stored_energies()
        self._contact_energy, self._rigid_energy = energies

    # ---- how a run is set up

    def _choose_step(self, dt, safety):
        """The time step; warns of one that is not surely stable, and of bodies without the bonds that were meant."""
        body = self.body
        self.time_step_stable = self.stable_step()
        self.dt = float(safety * self.time_step_stable if dt is None else dt)
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise AtcError(
                f"the time step must be a positive number, got {dt!r}" if dt is not None
                else "this body has no bonds that could tell a stable time step: give dt, or a larger horizon"
            )  # fmt: skip
        said = []
        if not len(body.bonds):
            said.append(
                "no node of the body has another one within its horizon: nothing holds it together; take a larger "
                "horizon"
            )
        else:
            if self.dt > self.time_step_stable * (1 + 1e-9):
                said.append(
                    f"the time step {self.dt:g} is {self.dt / self.time_step_stable:.3g} times the step that is surely "
                    f"stable ({self.time_step_stable:g}): the run may blow up; take a smaller dt, or leave it out"
                )
            said += [
                f"notch {k + 1} crosses no bond of the body: check its place and its length"
                for k, crossed in enumerate(body.cuts)
                if not crossed
            ]
        for text in said:
            warnings.warn(text, AtcWarning, stacklevel=3)

    def _sort(self, conditions, conduction):
        """Bound conditions into those of motion, of force and of heat."""
        thermal = [c for c in conditions if isinstance(c, (FixedTemperature, HeatSource))]
        self.heat_flow = None
        if conduction is not None:
            if isinstance(conduction, Conduction):
                conduction = {m: conduction for m in self.model.ids}
            corrected = next(iter(self.materials.values())).surface_correction is not None
            self.heat_flow = HeatFlow(self.body, conduction, thermal, corrected=corrected)
        elif thermal:
            raise AtcError(f"{type(thermal[0]).__name__}: this body conducts no heat: give conduction")
        others = [c for c in conditions if c not in thermal]
        for c in others:
            if not isinstance(c, (Prescribed, BodyForce)):
                raise AtcError(f"conditions must be Prescribed or BodyForce objects, got {type(c).__name__}")
        self.prescribed = [c for c in others if isinstance(c, Prescribed)]
        self.external = [c for c in others if isinstance(c, BodyForce)] + self.rigid

    def _deform(self, strain):
        """The cell and its images by the displacement gradient `strain`."""
        self.cell, self.strained = self.body.cell, False
        if strain is None:
            return
        strain = np.array(strain, float)
        if strain.shape != (3, 3):
            raise AtcError(f"strain must be a (3, 3) displacement gradient, got shape {strain.shape}")
        self.model.images[:, 3:] = self.model.images[:, :3] @ strain.T
        F = np.eye(3) + strain
        self.cell = Cell(self.cell.vectors @ F.T, self.cell.origin @ F.T, self.cell.periodic)
        self.strained = bool(strain.any())
        if self.contact is not None:
            self.contact.strain = strain

    def _never_breaking(self, regions):
        """Bonds with an end in one of the regions never break."""
        if not regions:
            return
        t, inside = self.body.bonds, np.zeros(len(self.body), bool)
        for region in regions:
            inside[self.body.nodes(region)] = True
        safe = inside[t.i_b] | inside[t.j_b]
        self.state.intact_b[safe & (self.state.intact_b == 1)] = 2

    # ---- state

    def _take(self, state):
        n, b = len(self.body), len(self.body.bonds)
        if state.u_nc.shape != (n, 3) or state.intact_b.shape != (b,):
            raise AtcError(
                f"the state has {len(state.u_nc)} nodes and {len(state.intact_b)} bonds, the body {n} and {b}: it "
                "belongs to another body"
            )
        self._z[:, :3] = state.u_nc
        if "temperature_n" in state.history and self.heat_flow is None:
            raise AtcError(
                "the state has temperatures, of a run that conducted heat, and this one conducts none: give conduction "
                "(conductivity and specific_heat), or the state of a run without"
            )
        # From here on the displacement lives in z alone, and the state's is a view of it.
        state.u_nc = self._z[:, :3]
        self.state = state
        self.model.resume(state.smin_n)
        self.model.remember(state.history)
        if self.frictional and "friction_nc" not in state.history:
            state.history.update(friction_nc=np.zeros((n, 3)), friction_power=np.zeros(1))

    @property
    def positions_nc(self) -> np.ndarray:
        """(n, 3) current positions."""
        return self._z[:, 3:6] + self._z[:, :3]

    def damage(self) -> np.ndarray:
        """(n,) share of each node's family (by volume) whose bonds are broken."""
        return damage_n(self.body, self.state.intact_b)

    def bond_forces(self) -> BondForces:
        """The force in every intact bond now (contact is not among them)."""
        return self.model.bond_forces(self._z, self.state.intact_b)

    def bond_force_parts(self):
        """`bond_forces` in parts of at most a million bonds, for sums over bodies whose bonds would not fit into memory
        at once."""
        return self.model.bond_force_parts(self._z, self.state.intact_b)

    def forces(self) -> np.ndarray:
        """(n, 3) total force on each node now (bonds, contact, external), volumes included: F = force density × V."""
        return self.state.F_nc

    def energies(self) -> Energies:
        """The energy ledger now."""
        n = len(self.body)
        return Energies(
            kinetic=total(kinetic, self.crew, n, self.mass_n, self.state.v_nc),
            strain=float(self.model.energy_n(self._z, self.state.intact_b).sum()),
            contact=self._contact_energy,
            indenter=self._rigid_energy,
            **self.state.ledger,
        )

    def strain_energy_n(self) -> np.ndarray:
        """(n,) strain energy of each node."""
        return self.model.energy_n(self._z, self.state.intact_b)

    def heat(self, temperature) -> None:
        """The temperature has risen by this much, a number or (n,), from that of the reference; the forces are those of
        now. What strain energy that brings is heat's, and stands in no ledger."""
        if self.heat_flow is None:
            self._warm(temperature)
        else:
            self.state.history["temperature_n"][:] = self._rise(temperature)
            self._expand()
        self._contact_energy, self._rigid_energy = self._all_forces(damage=False)

    def _start_heat(self, temperature):
        H = self.state.history
        if "temperature_n" not in H:
            H.update(temperature_n=self._rise(temperature).copy(), heat_brought=np.zeros(1))
            for f in self.heat_flow.fixed:
                if self.state.time < f.until:
                    H["temperature_n"][f.nodes] = f.values(self.state.time)
        self._expand()

    @property
    def temperature_n(self):
        """(n,) how far temperatures have risen."""
        warm = self.state.history.get("temperature_n") if self.heat_flow is not None else self._warm_n
        return np.zeros(len(self.body)) if warm is None else warm

    def heat_power(self, region=None) -> float:
        """The power that now flows through bonds to the nodes of a region."""
        if self.heat_flow is None:
            raise AtcError("heat_power: this body conducts no heat: give conduction")
        flow = self.heat_flow.flow_n(self.temperature_n, self.state.intact_b)
        return float(flow[self.body.nodes(region)].sum())

    def _conduct(self, t, dt):
        """Temperatures a time `dt` after t, and bodies expanded by them."""
        H = self.state.history
        H["heat_brought"][0] += self.heat_flow.advance(H["temperature_n"], t, dt, self.state.intact_b)
        if not np.isfinite(H["temperature_n"]).all():
            raise AtcError("the temperatures are no longer finite numbers: check the heat sources")
        self._expand()

    def _expand(self):
        if any(m.expansion for m in self.materials.values()):
            self._warm(self.temperature_n)

    def _warm(self, temperature):
        self._warm_n = self._rise(temperature)
        self.model.heat(self._warm_n)

    def _rise(self, temperature):
        rise = np.asarray(temperature, float)
        if rise.shape not in ((), (len(self.body),)) or not np.isfinite(rise).all():
            raise AtcError(
                f"temperature must be a finite number, or one for each of the {len(self.body)} nodes, got shape "
                f"{rise.shape}"
            )
        return np.broadcast_to(rise, (len(self.body),))

    # ---- forces

    def _all_forces(self, damage: bool):
        """F of the present displacements into the state; returns the energies in contact and in indenters."""
        s = self.state
        broken, lost, pull = self.model.forces(self._z, s.intact_b, s.F_nc, s.smin_n, damage)
        if broken:
            self.n_broken += broken
            s.ledger["dissipated_fracture"] += lost
            s.pending = dict(zip(("i", "j", "F_bc"), pull, strict=True))
        rubbed = None
        if self.frictional:
            rubbed = s.v_nc, self.mass_n, self.dt, s.history["friction_nc"]
            rubbed[3][:] = 0.0
            s.history["friction_power"][0] = sum(e.rub(s.time, self._z, *rubbed) for e in self.rigid if e.friction)
        in_contact = self.contact.add(self._z, s.F_nc, rubbed) if self.contact is not None else 0.0
        if rubbed is not None:
            s.F_nc += rubbed[3]
        in_rigid = 0.0
        if self.external:
            s.external_nc[:] = 0.0
            for e in self.external:
                rubs = rubbed is not None and e in self.rigid and e.friction
                in_rigid += e.pushed(s.external_nc) if rubs else e.add(s.time, self._z, s.external_nc)
            s.F_nc += s.external_nc
        return in_contact, in_rigid

    def _stored_energies(self):
        scratch = np.zeros_like(self.state.F_nc)
        in_contact = self.contact.add(self._z, scratch) if self.contact is not None else 0.0
        return in_contact, sum(e.add(self.state.time, self._z, scratch) for e in self.external)

    def _impose_start(self):
        s = self.state
        for p in self.prescribed:
            if s.time >= p.until:
                continue
            value = p.at(s.time)
            free = np.isnan(value)
            if p.is_velocity:
                s.v_nc[p.nodes] = np.where(free, s.v_nc[p.nodes], value)
            else:
                self._z[p.nodes, :3] = np.where(free, self._z[p.nodes, :3], value)

    # ---- stepping

    def step(self, n: int = 1, callback=None) -> State:
        """Advance by `n` steps of velocity Verlet and return the state. `callback(self)` is called after every step."""
        for _ in range(n):
            self._step()
            if callback is not None:
                callback(self)
        return self.state

    run = step

    def _step(self):
        s, dt, half = self.state, self.dt, 0.5 * self.dt
        n = len(self.body)
        m = chunks(n)
        if not self.prescribed and not self.damping:
            self.crew.run(kick_drift, m, half, dt, s.F_nc, self.mass_n, s.v_nc, self._z, grain=4)
            held = ()
        else:
            start = [s.v_nc[p.nodes].copy() for p in self.prescribed]
            before = [s.F_nc[p.nodes].copy() for p in self.prescribed]
            self.crew.run(kick, m, half, self.damping, s.F_nc, self.mass_n, s.v_nc, grain=4)
            held = [self._hold(p, s.time + half, s.time + dt) for p in self.prescribed]
            self.crew.run(drift, m, dt, s.v_nc, self._z, grain=4)
        if len(s.pending["i"]):
            # Bonds that broke at the end of the last step have pulled once more, in the half kick of this one.
            p = s.pending
            s.ledger["dissipated_fracture"] += half * float(
                np.einsum("bc,bc->", p["F_bc"], s.v_nc[p["j"]] - s.v_nc[p["i"]])
            )
            s.pending = no_bonds()
        if self.external:
            s.ledger["work_external"] += half * total(power, self.crew, n, s.external_nc, s.v_nc)
        self._count_friction()
        if self.damping:
            # The friction's work with the mid-step velocity: exact to the order of the integrator.
            s.ledger["dissipated_damping"] += (
                self.damping * dt * 2 * total(kinetic, self.crew, n, self._free_mass(held), s.v_nc)
            )
        middle = [s.v_nc[p.nodes].copy() for p in self.prescribed] if held else ()
        s.step += 1
        s.time = s.time + dt
        if self.heat_flow is not None:
            self._conduct(s.time - dt, dt)
        self.model.advance(dt)
        self._contact_energy, self._rigid_energy = self._all_forces(self.damages)
        s.ledger["dissipated_material"] += self.model.taken
        self._count_friction()
        if self.external:
            s.ledger["work_external"] += half * total(power, self.crew, n, s.external_nc, s.v_nc)
        if self.damping:
            self.crew.run(kick_end, m, half, self.damping, s.F_nc, self.mass_n, s.v_nc, grain=4)
        else:
            self.crew.run(kick, m, half, 0.0, s.F_nc, self.mass_n, s.v_nc, grain=4)
        for k, p in enumerate(self.prescribed):
            fixed = held[k]
            if fixed is None:
                continue
            if p.is_velocity:
                end = np.where(fixed, p.at(s.time), s.v_nc[p.nodes])
            else:
                end = np.where(fixed, middle[k], s.v_nc[p.nodes])
            s.v_nc[p.nodes] = end
            kinetic_change = 0.5 * self.mass_n[p.nodes, None] * (end**2 - start[k] ** 2)
            by_forces = half * middle[k] * (before[k] + s.F_nc[p.nodes])
            s.ledger["work_constraint"] += float((kinetic_change - by_forces)[fixed].sum())

    def _count_friction(self):
        """What friction takes in half a step: its power on both sides of every contact."""
        if not self.frictional:
            return
        s, half = self.state, 0.5 * self.dt
        brought = half * float(s.history["friction_power"][0])
        s.ledger["work_external"] += brought
        s.ledger["dissipated_friction"] += brought - half * total(
            power, self.crew, len(self.body), s.history["friction_nc"], s.v_nc
        )

    def _hold(self, p, t_half, t_end):
        """Set the velocities of the drift on prescribed nodes; returns which components are held (m, 3), or None when
        none is any more."""
        s = self.state
        if t_end > p.until:
            return None
        if p.is_velocity:
            value = p.at(t_half)
        else:
            value = (p.at(t_end) - self._z[p.nodes, :3]) / self.dt
        fixed = ~np.isnan(value)
        s.v_nc[p.nodes] = np.where(fixed, value, s.v_nc[p.nodes])
        return fixed

    def _free_mass(self, held):
        if not held:
            return self.mass_n
        mass = self.mass_n.copy()
        for p, fixed in zip(self.prescribed, held, strict=True):
            if fixed is not None:
                mass[p.nodes[fixed.all(axis=1)]] = 0.0
        return mass

    # ---- stability

    def stable_step(self) -> float:
        """Δt = √(2 ρV/Σ|K_ij|), smallest over the nodes (Silling & Askari 2005): below Verlet's own limit 2/ω_max,
        which Gershgorin bounds."""
        k = self.model.stiffness_n()
        with np.errstate(divide="ignore"):
            return float(np.sqrt(2.0 * self.mass_n / k).min())
