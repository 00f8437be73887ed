"""Everything that changes in a run: a restart from a `State` is bitwise the uninterrupted run."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from ..errors import AtcError

LEDGER = (
    "work_external",
    "work_constraint",
    "dissipated_fracture",
    "dissipated_damping",
    "dissipated_material",
    "dissipated_friction",
)


@dataclass
class Energies:
    """The energy ledger of one instant. ``total`` is what must be conserved: kinetic + strain + contact − work + what
    was dissipated, since the start.

    kinetic, strain, contact : of the state. indenter : stored in the penetration of indenters and walls (their moving
        does work).
    work_external : done by indenters, walls and body forces; work_constraint : done by prescribed motions
    dissipated_fracture, dissipated_damping, dissipated_material, dissipated_friction : gone with broken bonds, by
        damping, in materials that relax, and where contacts slide
    """

    kinetic: float
    strain: float
    contact: float
    indenter: float
    work_external: float
    work_constraint: float
    dissipated_fracture: float
    dissipated_damping: float
    dissipated_material: float = 0.0
    dissipated_friction: float = 0.0

    @property
    def total(self) -> float:
        """Constant from the start of a run up to the integrator's error, O(Δt²); O(Δt) while bonds of state-based
        bodies break."""
        return (
            self.kinetic + self.strain + self.contact - self.work_external - self.work_constraint
            + self.dissipated_fracture + self.dissipated_damping + self.dissipated_material + self.dissipated_friction
        )  # fmt: skip


def no_bonds():
    """Columns of an empty set of bonds."""
    return {"i": np.zeros(0, np.int32), "j": np.zeros(0, np.int32), "F_bc": np.zeros((0, 3))}


@dataclass
class State:
    """One instant of a run.

    Attributes
    ----------
    u_nc, v_nc : (n, 3) displacement and velocity
    F_nc : (n, 3) total force (force density × volume) at this instant, external forces included
    external_nc : (n, 3) the part of F that indenters, walls and body forces exert
    smin_n : (n,) smallest stretch of each node's intact bonds at this instant: −inf before the first step, +inf without
        bonds. s0 follows from it.
    intact_b : (b,) uint8 over `body.bonds`: 0 broken, 1 whole, 2 whole and never breaks
    step : int. time : float.
    ledger : sums since the start: work_external, work_constraint, dissipated_fracture, dissipated_damping,
        dissipated_material, dissipated_friction (energy each)
    history : what a material with a memory keeps of the past, by name, and the forces of friction; empty otherwise
    pending : i, j, F_bc of bonds that broke in this very step: they pull until the next half kick, and the ledger
        counts that too
    """

    u_nc: np.ndarray
    v_nc: np.ndarray
    F_nc: np.ndarray
    external_nc: np.ndarray
    smin_n: np.ndarray
    intact_b: np.ndarray
    step: int = 0
    time: float = 0.0
    ledger: dict = field(default_factory=lambda: dict.fromkeys(LEDGER, 0.0))
    pending: dict = field(default_factory=no_bonds)
    history: dict = field(default_factory=dict)

    @classmethod
    def rest(cls, body) -> State:
        n = len(body)
        z = np.zeros
        intact = np.ones(len(body.bonds), np.uint8)
        if any(notch.as_damage for notch in body.notches):
            intact[body.precracked()] = 0
        return cls(z((n, 3)), z((n, 3)), z((n, 3)), z((n, 3)), np.full(n, -np.inf), intact)

    def copy(self) -> State:
        return State.from_arrays(self.to_arrays())

    def to_arrays(self) -> dict:
        """A flat {name: array} with everything in it (copies), for any file format."""
        out = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("ledger", "pending", "history"):
                out.update({f"{f.name}.{k}": np.array(v) for k, v in value.items()})
            else:
                out[f.name] = np.array(value)
        return out

    @classmethod
    def from_arrays(cls, arrays) -> State:
        """The inverse of `to_arrays`; raises AtcError for a missing array."""
        values = {}
        for f in fields(cls):
            if f.name in ("ledger", "pending", "history"):
                values[f.name] = {
                    k[len(f.name) + 1 :]: np.array(v) for k, v in arrays.items() if k.startswith(f.name + ".")
                }
                continue
            if f.name not in arrays:
                raise AtcError(f"the restart has no {f.name!r}: it is not a state of this program, or it is damaged")
            values[f.name] = np.array(arrays[f.name])
        values["step"], values["time"] = int(values["step"]), float(values["time"])
        values["ledger"] = {k: float(values["ledger"].get(k, 0.0)) for k in LEDGER}
        return cls(**values)
