"""What can be summed: of atoms, of bonds, with the kernel's gradient, around a point, over the whole frame. A source is
one entry here, with the function that gives its values; quantities name those that they are made of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from . import columns
from .tensors import outer6


@dataclass(frozen=True)
class Source:
    """A factor that is summed: its number of components, what it cannot do without, and what it is.

    of : of atoms, (n, width) from their `atom_pass.AtomFactors`; over the whole frame, from these and the
        `bond_pass.BondPass`; of bonds, what puts (b, width) into an array: of `bond_pass.BondFactors`, the bonds, the
        first column and the array. None where a pass of its own knows it
    """

    width: int
    frame: tuple[str, ...] = ()
    bonds: bool = False  # needs the pass over the bonds
    energies: bool = False  # needs per-atom potential energies
    forces: bool = False  # needs the forces between atoms
    sources: bool = False  # needs the bonds' directed energy sources
    reference: bool = False  # needs the reference frame
    on_reference: bool = False  # is summed over reference positions, on the grid of the reference frame
    of: Callable | None = None


class AndColumns(dict):
    """A table that knows the columns of a trajectory too, beside the names that it is listed by.

    make : what gives the entry of a column by its name
    """

    def __init__(self, known, make):
        super().__init__(known)
        self.hidden: dict = {}
        self._make = cache(make)

    def __missing__(self, name):
        if name in self.hidden:
            return self.hidden[name]
        if not columns.is_column(name):
            raise KeyError(name)
        return self._make(name)


#: Before the name of a sum over atoms, in fields of parts: the sum over the atoms of all parts.
ALL = "all_"


# --- over atoms


def _of_column(name: str) -> Source:
    needed = (name.removesuffix("*mass"), *(["masses"] if name.endswith("*mass") else []))
    return Source(1, needed, of=lambda a: columns.factor(a.atoms, name))


def _one(a):
    return np.ones((len(a.atoms), 1))


def _degrees(a):
    """Degrees of freedom of each atom, over those of a free one."""
    if a.pot is None:
        from ..decomposers.constraints.topology import degrees_of_topology

        free = degrees_of_topology(a.atoms)
        return _one(a) if free is None else free[:, None] / a.frame.dimension
    constraints = a.pot.constraints
    if constraints is None:
        inside = a.pot.sites is not None
        return (a.atoms.masses > 0.0)[:, None].astype(float) if inside else _one(a)
    return constraints.degrees(a.pot.complete(a.atoms))[:, None] / a.frame.dimension


def _kinetic_energy(a):
    return 0.5 * a["mass"] * np.einsum("nc,nc->n", a.frame.velocities, a.frame.velocities)[:, None]


def _kinetic_flux(a):
    v = a.peculiar_nc
    return 0.5 * a["mass"] * np.einsum("nc,nc->n", v, v)[:, None] * v


def _energy_current(a):
    return (a["kinetic_energy"] + a.per_atom.energies_n[:, None]) * a.frame.velocities


# Factors a_j of Σ a_j φ(x − x_j). v is relative to the mass-mean velocity of the frame (see sums.Sums), but for
# kinetic_energy and energy_current. J of formulas.md §4 is energy_current; for the heat flux it is taken apart into
# kinetic_flux and potential_flux.
_MOVING = ("masses", "velocities")
SITE = AndColumns(
    {
        "one": Source(1, of=_one),
        "degrees": Source(1, of=_degrees),
        "mass": Source(1, ("masses",), of=lambda a: a.frame.masses[:, None].copy()),
        "momentum": Source(3, _MOVING, of=lambda a: a.frame.masses[:, None] * a.peculiar_nc),
        "kinetic": Source(6, _MOVING, of=lambda a: a.frame.masses[:, None] * outer6(a.peculiar_nc)),
        "kinetic_energy": Source(1, _MOVING, of=_kinetic_energy),
        "potential_energy": Source(1, bonds=True, energies=True, of=lambda a: a.per_atom.energies_n[:, None]),
        "atom_virial": Source(6, bonds=True, of=lambda a: a.per_atom.virial_n6),
        # The same of forces that do not act along bonds.
        "atom_moment": Source(9, bonds=True, of=lambda a: a.per_atom.moment_n9),
        "kinetic_flux": Source(3, _MOVING, of=_kinetic_flux),
        "potential_flux": Source(
            3, ("velocities",), bonds=True, energies=True, of=lambda a: a.per_atom.energies_n[:, None] * a.peculiar_nc
        ),
        "energy_current": Source(3, _MOVING, bonds=True, energies=True, of=_energy_current),
        "outside_force": Source(
            3, bonds=True, forces=True, of=lambda a: a.pot.body_forces(a.atoms, a.per_atom.forces_nc[: len(a.atoms)])[0]
        ),
        "outside_power": Source(
            1,
            ("velocities",),
            bonds=True,
            forces=True,
            of=lambda a: np.einsum("nc,nc->n", a["outside_force"], a.frame.velocities)[:, None],
        ),
        # The last: the forces it is left over from.
        "source_residual": Source(4, bonds=True, sources=True, of=lambda a: a.per_atom.residual_n4),
    },
    _of_column,
)
for _name in ("one", "mass", "momentum", "kinetic"):
    SITE[ALL + _name] = SITE[_name]


# --- over bonds


def _put_stress(f, bonds, at, out):
    from ..deposit.direct import put_stress

    put_stress(bonds.r_bc, bonds.G_b, at, out)


def _put_moment(f, bonds, at, out):
    from ._numba import put_moment

    put_moment(bonds.r_bc, bonds.forces(), at, out)


def _put_sources(f, bonds, at, out):
    from ._numba import put_sources

    put_sources(bonds.r_bc, bonds.D_bdc, at, out)


def _put_power(v_nc, bonds, at, out):
    from ._numba import put_power

    put_power(bonds.i, bonds.j, bonds.r_bc, bonds.D_bdc, bonds.powers(), v_nc, at, out)


# Factors b of Σ b β(x), each bond once.
BOND = {
    "stress": Source(6, bonds=True, of=_put_stress),
    # A of formulas.md §4, and the same in the frame of the simulation.
    "power": Source(
        3, ("velocities",), bonds=True, sources=True, of=lambda f, *bonds: _put_power(f.peculiar_nc, *bonds)
    ),
    "power_lab": Source(
        3, ("velocities",), bonds=True, sources=True, of=lambda f, *bonds: _put_power(f.velocities, *bonds)
    ),
    "sources": Source(9, bonds=True, sources=True, of=_put_sources),  # M
    "piola": Source(9, bonds=True, reference=True, on_reference=True),
    # What "stress" becomes where forces do not act along bonds: −r⊗F, as `general`.
    "moment": Source(9, bonds=True, of=_put_moment),
}

# --- over the bonds around a point, with weights that are no bond function: see peridynamic.py
POINT = {
    "weighted": Source(9, bonds=True),
    "weighted_normalised": Source(9, bonds=True),
    "reference_weighted": Source(9, bonds=True, reference=True, on_reference=True),
    "reference_weighted_normalised": Source(9, bonds=True, reference=True, on_reference=True),
}

# --- factors of Σ a φ and, for quantities that say so, Σ a ∂φ/∂x, from the sum that knows the kernel's gradient
GATHER = {
    "mass": Source(1, ("masses",)),
    "momentum": Source(3, ("masses", "velocities")),
    "displacement": Source(3, ("masses",), reference=True),
    "reference_mass": Source(1, ("masses",), reference=True, on_reference=True),
    "reference_displacement": Source(3, ("masses",), reference=True, on_reference=True),
    "reference_energy": Source(1, bonds=True, energies=True, reference=True, on_reference=True),
}
#: Factors of the same name in `SITE` and `GATHER`.
ALIKE = {"mass", "momentum"}

# --- without any kernel: over the whole frame, or of each atom
WHOLE = {
    "box_kinetic": Source(6, _MOVING, of=lambda a, bonds: a.only_atoms(a["kinetic"]).sum(0)),
    "box_virial": Source(9, bonds=True, of=lambda a, bonds: bonds.totals.virial_cc.reshape(9)),
    "atom_kinetic": Source(6, _MOVING, of=lambda a, bonds: a.only_atoms(a["kinetic"])),
    "atom_virial": Source(6, bonds=True, of=lambda a, bonds: a.only_atoms(bonds.per_atom.virial_n6)),
    "atom_moment": Source(9, bonds=True, of=lambda a, bonds: a.only_atoms(bonds.per_atom.moment_n9)),
    "reference_atom_moment": Source(
        9, bonds=True, reference=True, of=lambda a, bonds: a.only_atoms(bonds.per_atom.reference_moment_n9)
    ),
    "atom_volume": Source(1, of=lambda a, bonds: a.volumes),
    "box_convection": Source(3, _MOVING, bonds=True, energies=True, of=lambda a, bonds: a["energy_current"].sum(0)),
    "box_power": Source(3, ("velocities",), bonds=True, sources=True, of=lambda a, bonds: bonds.totals.power_c),
}


def by_name(names, sources, total_gk) -> dict[str, np.ndarray]:
    """Sums side by side, (g, k), taken apart: (g, width) by name. sources : the table that the names are in"""
    ends = np.cumsum([sources[name].width for name in names])
    return dict(zip(names, np.split(total_gk, ends[:-1], axis=1), strict=True)) if names else {}
