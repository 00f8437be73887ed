"""The quantities atc knows: what each needs, and how it is formed from site and bond sums.

One entry a quantity. `form` gets a `sums.Sums` and returns the field in internal units: (g, ...) for kind ``grid``,
(...) for ``box``, (n, ...) for ``atom``. Where there is no mass it returns 0 (the limit of the sums); the mask is
applied afterwards (`masked`), so that time averages count empty space as empty. `weight` names the site sum that turns
an intensive quotient back into a sum: a time average of a quotient is <weight·X>/<weight>.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from ..errors import AtcError
from . import columns
from .sums import Sums, curl, full

STRESS_SIGN = (
    "Cauchy stress, tension positive (the opposite of a pressure); component [i, j]: i the face normal (divergence "
    "direction), j the force component"
)


@dataclass(frozen=True)
class Source:
    """A factor that is summed: its number of components and what it cannot do without."""

    width: int
    frame: tuple[str, ...] = ()
    bonds: bool = False  # needs the pass over the bonds
    energies: bool = False  # needs per-atom potential energies
    forces: bool = False  # needs the forces between atoms
    sources: bool = False  # needs the bonds' directed energy sources
    reference: bool = False  # needs the reference frame
    on_reference: bool = False  # is summed over reference positions, on the grid of the reference frame


#: Before the name of a sum over atoms, in fields of parts: the sum over the atoms of all parts.
ALL = "all_"


class _AndColumns(dict):
    """A table that knows the columns of a trajectory too, beside the names that it is listed by."""

    def __init__(self, known, make):
        super().__init__(known)
        self.hidden = {}
        self._make = cache(make)

    def __missing__(self, name):
        if name in self.hidden:
            return self.hidden[name]
        if not columns.is_column(name):
            raise KeyError(name)
        return self._make(name)


# Factors a_j of Σ a_j φ(x − x_j). v is relative to the mass-mean velocity of the frame (see sums.Sums), but for
# kinetic_energy and energy_current. J of formulas.md §4 is energy_current; for the heat flux it is taken apart into
# kinetic_flux and potential_flux.
SITE = _AndColumns(
    {
        "one": Source(1),
        "degrees": Source(1),  # of freedom of an atom, over those of a free one
        "mass": Source(1, ("masses",)),
        "momentum": Source(3, ("masses", "velocities")),
        "kinetic": Source(6, ("masses", "velocities")),
        "kinetic_energy": Source(1, ("masses", "velocities")),
        "potential_energy": Source(1, bonds=True, energies=True),
        "atom_virial": Source(6, bonds=True),
        "atom_moment": Source(9, bonds=True),  # the same of forces that do not act along bonds
        "kinetic_flux": Source(3, ("masses", "velocities")),
        "potential_flux": Source(3, ("velocities",), bonds=True, energies=True),
        "energy_current": Source(3, ("masses", "velocities"), bonds=True, energies=True),
        "outside_force": Source(3, bonds=True, forces=True),
        "outside_power": Source(1, ("velocities",), bonds=True, forces=True),
        "source_residual": Source(4, bonds=True, sources=True),  # the last: the forces it is left over from
    },
    lambda name: columns.source(name, Source),
)
for _name in ("one", "mass", "momentum", "kinetic"):
    SITE[ALL + _name] = SITE[_name]

# Factors b of Σ b β(x), each bond once.
BOND = {
    "stress": Source(6, bonds=True),
    "power": Source(3, ("velocities",), bonds=True, sources=True),  # A of formulas.md §4
    "power_lab": Source(3, ("velocities",), bonds=True, sources=True),  # the same in the frame of the simulation
    "sources": Source(9, bonds=True, sources=True),  # M
    "piola": Source(9, bonds=True, reference=True, on_reference=True),
    "moment": Source(9, bonds=True),  # what "stress" becomes where forces do not act along bonds: −r⊗F, as `general`
}

# Sums over the bonds around a point with weights that are no bond function: see peridynamic.py.
POINT = {
    "weighted": Source(9, bonds=True),
    "weighted_normalised": Source(9, bonds=True),
    "reference_weighted": Source(9, bonds=True, reference=True, on_reference=True),
    "reference_weighted_normalised": Source(9, bonds=True, reference=True, on_reference=True),
}

# Factors of Σ a φ and, for quantities that say so, Σ a ∂φ/∂x, from the sum that knows the kernel's gradient.
GATHER = {
    "mass": Source(1, ("masses",)),
    "momentum": Source(3, ("masses", "velocities")),
    "displacement": Source(3, ("masses",), reference=True),
    "reference_mass": Source(1, ("masses",), reference=True, on_reference=True),
    "reference_displacement": Source(3, ("masses",), reference=True, on_reference=True),
    "reference_energy": Source(1, bonds=True, energies=True, reference=True, on_reference=True),
}

# Factors of the same name in both.
_ALIKE = {"mass", "momentum"}

# Sums without any kernel: over the whole frame, or per atom.
WHOLE = {
    "box_kinetic": Source(6, ("masses", "velocities")),
    "box_virial": Source(9, bonds=True),
    "atom_kinetic": Source(6, ("masses", "velocities")),
    "atom_virial": Source(6, bonds=True),
    "atom_moment": Source(9, bonds=True),
    "reference_atom_moment": Source(9, bonds=True, reference=True),
    "atom_volume": Source(1),
    "box_convection": Source(3, ("masses", "velocities"), bonds=True, energies=True),
    "box_power": Source(3, ("velocities",), bonds=True, sources=True),
}


@dataclass(frozen=True)
class Quantity:
    """One field atc can compute; see the module for `form` and `weight`."""

    name: str
    dimension: str
    long_name: str
    form: Callable[[Sums], np.ndarray]
    rank: int = 0
    kind: str = "grid"
    site: tuple[str, ...] = ()
    bond: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    gather: tuple[str, ...] = ()
    point: tuple[str, ...] = ()
    gradient: bool = False  # whether the gathered sums are wanted with ∂φ/∂x
    parts: tuple[str, ...] = ()
    masked: bool = False
    weight: str | None = None
    # Whether the field, times its weight, is linear in its sums, with velocities taken from the same drift in all
    # frames: then it is formed once from the mean sums of several frames. What is relative to the velocity field, or
    # the drift, of each frame is not. Wholes are the sums of their parts.
    linear: bool = False
    sign: str = "plain sum, no sign convention"
    comment: str = ""
    # The size of what the field is the difference of: a field that is 0 but for rounding has its error measured against
    # this.
    scale: Callable[[Sums], float] = lambda s: 0.0

    def sources(self):
        """Everything this quantity sums, as `Source`s."""
        found = ((SITE, self.site), (BOND, self.bond), (WHOLE, self.whole), (GATHER, self.gather), (POINT, self.point))
        return [kind[name] for kind, names in found for name in names]

    @property
    def thermal(self) -> bool:
        """Whether it is made of velocities relative to the local one, squared."""
        return self.masked and "kinetic" in self.site and "kinetic_flux" not in self.site

    @property
    def relative(self) -> bool:
        """Whether velocities in it are those relative to the local velocity."""
        return "kinetic" in self.site or "kinetic_flux" in self.site or (self.masked and self.weight is None)

    @property
    def on_reference(self) -> bool:
        """Whether its grid is that of the reference frame."""
        return any(s.on_reference for s in self.sources())

    @property
    def symmetric_if_central(self) -> bool:
        """Whether it is a stress of forces on the grid, symmetric as long as they act along bonds."""
        return self.sign == STRESS_SIGN and self.kind == "grid" and any(s.bonds for s in self.sources())

    @property
    def kernel(self) -> bool:
        """Whether it needs a kernel."""
        return self.kind == "grid" and not self.point


_MEAN = ("mass", "momentum")
_VIRIAL_SIGN = "tension positive (as LAMMPS's stress/atom, the opposite of its pressure); component [i, j], symmetric"


def _stress(parts_form):
    return {"dimension": "pressure", "rank": 2, "sign": STRESS_SIGN, "form": parts_form}


# The energy that a flux carries depends on how it is shared among the atoms.
_SHARED = (
    "depends on how the energy of a term is shared among its atoms (see decomposition); the divergence of the total "
    "does not"
)
_FLUX_SIGN = "positive in the direction energy flows"
_CHURNING_SIGN = (
    "that of stress_potential; component [i, j]: i the divergence direction, j is contracted with the velocity in "
    "heat_flux_churning; not symmetric"
)
_THERMAL = (*_MEAN, "kinetic", "kinetic_flux", "potential_energy", "potential_flux")
_GRADIENT_SIGN = "component [i, j]: i the direction of the derivative, j the component of the vector"


def _atom_virial(sums) -> np.ndarray:
    """(…, 3, 3) from six components, or nine where forces do not act along bonds."""
    return full(sums["atom_virial"]) if "atom_virial" in sums else sums["atom_moment"].reshape(-1, 3, 3)


def _largest(a) -> float:
    return float(np.abs(a).max(initial=0.0))


def _flux(long_name, form, **more):
    return {"dimension": "energy_flux", "rank": 1, "sign": _FLUX_SIGN, "long_name": long_name, "form": form, **more}


def _kinematic(dimension, long_name, form, rank, sign=_GRADIENT_SIGN, gradient=True, comment="", scale=lambda s: 0.0):
    return {
        "dimension": dimension,
        "rank": rank,
        "masked": True,
        "weight": "mass",
        "gradient": gradient,
        "long_name": long_name,
        "form": form,
        "sign": sign,
        "comment": comment,
        "scale": scale,
    }


def _slope(s, mean_gc) -> float:
    """What the gradient of a mean is the difference of: ∂ρ times the mean, over ρ."""
    rho = _largest(s.gathered["mass"])
    return _largest(s.gradient["mass"]) * _largest(mean_gc) / rho if rho > 0 else 0.0


def _velocity_slope(s) -> float:
    return _slope(s, s.velocity)


def _velocity_slopes(s) -> float:
    return max(_velocity_slope(s), _largest(s.velocity_gradient))


_NODAL = (
    "half of each bond to each end, by the volume of the node; volumes from the column volume of the frame, those of "
    "the undeformed body for a peridynamic one"
)


def _peridynamic() -> list[Quantity]:
    """The peridynamic stresses (formulas: Lehoucq & Silling 2008; W eq. 7), Cauchy's and the first Piola-Kirchhoff."""
    out = []
    piola = (
        "tension positive; component [i, j]: i the reference direction (face normal and divergence with respect to "
        "reference positions), "
        "j the component of the current force; not symmetric"
    )
    for name, prefix, sign, what in (
        ("peridynamic_stress", "", STRESS_SIGN, "peridynamic stress"),
        ("peridynamic_piola_stress", "reference_", piola, "first Piola-Kirchhoff peridynamic stress"),
    ):
        common = {"dimension": "pressure", "rank": 2, "sign": sign}
        where = "grid points are points of the reference frame; " if prefix else ""
        bond = "piola" if prefix else "stress"
        form = (lambda s: s.bond["piola"].reshape(-1, 3, 3)) if prefix else (lambda s: s.potential_stress)
        out.append(
            Quantity(
                name,
                long_name=what,
                bond=(bond,),
                form=form,
                linear=not prefix,
                comment=where
                + "of Lehoucq and Silling, smoothed with the kernel: the potential part of Hardy's stress "
                "over all bonds; its divergence is the "
                "force density",
                **common,
            )
        )
        for variant, word in (("weighted", "weighted virial"), ("weighted_normalised", "normalised weighted virial")):
            source = prefix + variant
            out.append(
                Quantity(
                    name + "_" + variant.replace("weighted", "weighted_virial"),
                    long_name=f"{what}, {word}",
                    point=(source,),
                    form=lambda s, source=source: s.point[source].reshape(-1, 3, 3),
                    comment=where
                    + (
                        "bonds with both ends within the horizon of the point, each weighted with ½ |r| (e_i "
                        "- e_j), e from the point to the end"
                        + (", over its mean weight" if "normalised" in variant else "")
                        + ", by the volume of the horizon; no kernel"
                    ),
                    **common,
                )
            )
        moment = prefix + "atom_moment"
        out.append(
            Quantity(
                name + "_nodal_virial",
                long_name=f"{what}, nodal virial",
                kind="atom",
                whole=(moment, "atom_volume"),
                form=lambda s, moment=moment: s.whole[moment].reshape(-1, 3, 3) / s.whole["atom_volume"][:, None, None],
                comment=_NODAL,
                **common,
            )
        )
    return out


_VELOCITY = {"site": _MEAN, "gather": ("mass", "momentum")}
_DISPLACEMENT = {"site": ("mass",), "gather": ("mass", "displacement")}
_BY_KERNEL = "from the gradient of the kernel, no finite differences"

_ALL = [
    Quantity(
        "number_density",
        "number_density",
        "number density",
        lambda s: s.site["one"][:, 0],
        site=("one",),
        sign="positive",
        linear=True,
    ),
    Quantity("density", "density", "mass density", lambda s: s.rho, site=("mass",), sign="positive", linear=True),
    Quantity(
        "momentum",
        "momentum",
        "momentum density",
        lambda s: s.momentum,
        rank=1,
        site=_MEAN,
        sign="positive along +x, +y, +z",
        linear=True,
    ),
    Quantity(
        "velocity",
        "velocity",
        "mass-averaged velocity",
        lambda s: s.velocity,
        rank=1,
        site=_MEAN,
        masked=True,
        weight="mass",
        sign="positive along +x, +y, +z",
        scale=lambda s: _largest(s.drift),
        linear=True,
    ),
    Quantity(
        "temperature",
        "temperature",
        "kinetic temperature relative to the local velocity",
        lambda s: s.temperature,
        site=("degrees", *_MEAN, "kinetic"),
        masked=True,
        weight="degrees",
        sign="positive",
        comment="-trace(stress_kinetic)/(3 n k_B): three degrees of freedom per atom; where the potential has "
        "constraints those that they leave each atom: the ones whose mean kinetic energy it has",
    ),
    Quantity(
        "stress_kinetic",
        site=(*_MEAN, "kinetic"),
        masked=True,
        long_name="kinetic part of Hardy's stress",
        comment="relative to the local mass-averaged velocity",
        **_stress(lambda s: -full(s.kinetic_pressure)),
    ),
    Quantity(
        "stress_potential",
        bond=("stress",),
        linear=True,
        long_name="potential part of Hardy's stress",
        scale=lambda s: s.size,
        **_stress(lambda s: s.potential_stress),
    ),
    Quantity(
        "stress",
        site=(*_MEAN, "kinetic"),
        bond=("stress",),
        parts=("stress_kinetic", "stress_potential"),
        masked=True,
        scale=lambda s: s.size,
        long_name="Hardy's stress",
        **_stress(lambda s: s.potential_stress - full(s.kinetic_pressure)),
    ),
    Quantity(
        "virial_stress_kinetic",
        "pressure",
        "kinetic part of the virial stress of the box",
        lambda s: -full(s.whole["box_kinetic"]) / s.volume,
        rank=2,
        kind="box",
        whole=("box_kinetic",),
        sign=_VIRIAL_SIGN,
        comment="velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_potential",
        "pressure",
        "potential part of the virial stress of the box",
        lambda s: s.whole["box_virial"].reshape(3, 3) / s.volume,
        rank=2,
        kind="box",
        whole=("box_virial",),
        sign=_VIRIAL_SIGN,
    ),
    Quantity(
        "virial_stress",
        "pressure",
        "virial stress of the box",
        lambda s: (s.whole["box_virial"].reshape(3, 3) - full(s.whole["box_kinetic"])) / s.volume,
        rank=2,
        kind="box",
        whole=("box_kinetic", "box_virial"),
        parts=("virial_stress_kinetic", "virial_stress_potential"),
        sign=_VIRIAL_SIGN,
        comment="velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_per_atom_kinetic",
        "pressure_volume",
        "kinetic part of the per-atom virial",
        lambda s: -full(s.whole["atom_kinetic"]),
        rank=2,
        kind="atom",
        whole=("atom_kinetic",),
        sign=_VIRIAL_SIGN,
        comment="stress times volume; velocities relative to the mean of the frame",
    ),
    Quantity(
        "virial_stress_per_atom_potential",
        "pressure_volume",
        "potential part of the per-atom virial",
        lambda s: _atom_virial(s.whole),
        rank=2,
        kind="atom",
        whole=("atom_virial",),
        sign=_VIRIAL_SIGN,
        comment="stress times volume; half of each bond to each end",
    ),
    Quantity(
        "virial_stress_per_atom",
        "pressure_volume",
        "per-atom virial",
        lambda s: _atom_virial(s.whole) - full(s.whole["atom_kinetic"]),
        rank=2,
        kind="atom",
        whole=("atom_kinetic", "atom_virial"),
        parts=("virial_stress_per_atom_kinetic", "virial_stress_per_atom_potential"),
        sign=_VIRIAL_SIGN,
        comment="stress times volume; half of each bond to each end; velocities relative to the mean of the frame",
    ),
    Quantity(
        "smoothed_virial_stress_kinetic",
        "pressure",
        "kinetic part of the per-atom virial smoothed with the kernel",
        lambda s: -full(s.site["kinetic"]),
        rank=2,
        site=("kinetic",),
        sign=STRESS_SIGN,
        comment="velocities relative to the mean of the frame, not to the local one",
    ),
    Quantity(
        "smoothed_virial_stress_potential",
        "pressure",
        "potential part of the per-atom virial smoothed with the kernel",
        lambda s: _atom_virial(s.site),
        rank=2,
        site=("atom_virial",),
        sign=STRESS_SIGN,
        linear=True,
    ),
    Quantity(
        "smoothed_virial_stress",
        "pressure",
        "per-atom virial smoothed with the kernel",
        lambda s: _atom_virial(s.site) - full(s.site["kinetic"]),
        rank=2,
        site=("kinetic", "atom_virial"),
        parts=("smoothed_virial_stress_kinetic", "smoothed_virial_stress_potential"),
        sign=STRESS_SIGN,
        comment="per-atom virials, half of each bond to each end, smoothed with the kernel; not Hardy's stress. For "
        "pair potentials what a smoothing "
        "of LAMMPS's stress/atom gives; LAMMPS shares many-body terms in another way (equal sums over the box)",
    ),
    Quantity(
        "energy_kinetic",
        "energy_density",
        "kinetic energy density",
        lambda s: s.site["kinetic_energy"][:, 0],
        site=("kinetic_energy",),
        sign="positive",
        linear=True,
        comment="in the frame of the simulation, streaming motion included",
    ),
    Quantity(
        "energy_potential",
        "energy_density",
        "potential energy density",
        lambda s: s.site["potential_energy"][:, 0],
        site=("potential_energy",),
        linear=True,
        sign="the potential's own zero",
        comment="each K-body term shared equally by its K atoms, unless the potential documents another share",
    ),
    Quantity(
        "energy",
        "energy_density",
        "energy density",
        lambda s: s.site["kinetic_energy"][:, 0] + s.site["potential_energy"][:, 0],
        site=("kinetic_energy", "potential_energy"),
        parts=("energy_kinetic", "energy_potential"),
        sign="the potential's own zero",
    ),
    Quantity(
        "piola_stress",
        "pressure",
        "potential part of the first Piola-Kirchhoff stress",
        lambda s: s.bond["piola"].reshape(-1, 3, 3),
        rank=2,
        bond=("piola",),
        sign="tension positive; component [i, j]: i the reference direction (face normal and divergence with respect "
        "to reference positions), "
        "j the component of the current force; not symmetric",
        comment="grid points are points of the reference frame; the bond function runs between reference positions; "
        "no kinetic part",
    ),
    Quantity(
        "heat_flux_kinetic",
        site=_THERMAL,
        masked=True,
        **_flux(
            "kinetic part of the heat flux",
            lambda s: s.heat_flux_kinetic,
            comment="energy carried by atoms relative to the local velocity: J - e v + stress_kinetic v; " + _SHARED,
        ),
    ),
    Quantity(
        "heat_flux_potential",
        site=_MEAN,
        bond=("power", "sources"),
        masked=True,
        **_flux(
            "potential part of the heat flux",
            lambda s: s.heat_flux_potential,
            comment="A - M v: work of the bonds relative to the local velocity; " + _SHARED,
        ),
    ),
    Quantity(
        "heat_flux_churning",
        site=_MEAN,
        bond=("stress", "sources"),
        masked=True,
        scale=lambda s: _largest(s.potential_stress) * _largest(s.velocity),
        **_flux(
            "churning part of the heat flux",
            lambda s: s.heat_flux_churning,
            comment="churning tensor times velocity, in the frame of the simulation: a uniform drift c adds z c, "
            "which has no divergence and no mean over "
            "a periodic box; 0 for pair potentials and embedded atoms; " + _SHARED,
        ),
    ),
    Quantity(
        "heat_flux",
        site=_THERMAL,
        bond=("power", "sources", "stress"),
        masked=True,
        parts=("heat_flux_kinetic", "heat_flux_potential", "heat_flux_churning"),
        **_flux(
            "heat flux",
            lambda s: s.heat_flux_kinetic + s.heat_flux_potential + s.heat_flux_churning,
            comment="q in d(energy)/dt + div(energy v) = div(stress v - q); " + _SHARED,
        ),
    ),
    Quantity(
        "energy_flux",
        site=("energy_current",),
        bond=("power_lab",),
        linear=True,
        **_flux(
            "flux of energy through points at rest",
            lambda s: s.site["energy_current"] + s.bond["power_lab"],
            comment="J + A = energy v - stress v + heat_flux (the stress relative to the local velocity as it is), in "
            "the frame of the simulation: d(energy)/dt = "
            "-div(energy_flux); its integral over the box is "
            "heat_current; " + _SHARED,
        ),
    ),
    Quantity(
        "churning",
        "energy_density",
        "churning tensor",
        lambda s: s.churning,
        rank=2,
        bond=("stress", "sources"),
        sign=_CHURNING_SIGN,
        linear=True,
        scale=lambda s: _largest(s.potential_stress),
        comment="z = S + M: what the potential stress and the energy sources of the bonds leave of each other; has no "
        "divergence and no mean over a periodic "
        "box; 0 for pair potentials and embedded atoms; " + _SHARED,
    ),
    Quantity(
        "churning_divergence",
        "force_density",
        "divergence of the churning tensor",
        lambda s: s.site["source_residual"][:, :3],
        rank=1,
        site=("source_residual",),
        linear=True,
        scale=lambda s: _largest(s.site["source_residual"][:, 3]),
        sign="component j: sum over i of d churning[i, j]/dx_i",
        comment="0 up to rounding: in closed form the force on each atom minus the force that follows from the energy "
        "sources, so this checks the decomposition",
    ),
    Quantity(
        "churning_heat_source",
        "power_density",
        "churning heat source",
        lambda s: np.einsum("gij,gij->g", s.churning, s.velocity_gradient),
        masked=True,
        bond=("stress", "sources"),
        gradient=True,
        **_VELOCITY,
        scale=lambda s: _largest(s.potential_stress) * _largest(s.velocity_gradient),
        sign="positive where the churning part of the heat flux diverges: it takes energy away there",
        comment="z : grad v = div(heat_flux_churning), since z has no divergence; " + _SHARED,
    ),
    Quantity(
        "heat_current_convective",
        "energy_current",
        "convective part of the heat current of the box",
        lambda s: s.whole["box_convection"],
        rank=1,
        kind="box",
        whole=("box_convection",),
        sign=_FLUX_SIGN,
        comment="sum of e_j v_j; velocities in the frame of the simulation; " + _SHARED,
    ),
    Quantity(
        "heat_current_potential",
        "energy_current",
        "potential part of the heat current of the box",
        lambda s: s.whole["box_power"],
        rank=1,
        kind="box",
        whole=("box_power",),
        sign=_FLUX_SIGN,
        comment="sum over ordered pairs of (v_k . dU_j/dx_k) x_jk; velocities "
        "in the frame of the simulation; " + _SHARED,
    ),
    Quantity(
        "heat_current",
        "energy_current",
        "heat current of the box",
        lambda s: s.whole["box_convection"] + s.whole["box_power"],
        rank=1,
        kind="box",
        whole=("box_convection", "box_power"),
        parts=("heat_current_convective", "heat_current_potential"),
        sign=_FLUX_SIGN,
        comment="rate of change of the sum of e_j x_j, heat flux times volume; velocities in the frame of the "
        "simulation, so that a box with momentum "
        "carries its energy along: remove the momentum before a Green-Kubo integral; " + _SHARED,
    ),
    Quantity(
        "body_force",
        "force_density",
        "force density from outside",
        lambda s: s.site["outside_force"],
        rank=1,
        site=("outside_force",),
        linear=True,
        sign="positive along +x, +y, +z; d(momentum)/dt + div(density velocity velocity) = div(stress) + body_force",
        comment="walls, fields, friction and whatever else acts on atoms from outside: see body_force_source",
    ),
    Quantity(
        "body_power",
        "power_density",
        "power density of the forces from outside",
        lambda s: s.site["outside_power"][:, 0],
        site=("outside_power",),
        linear=True,
        sign="positive where energy is put in",
        comment="sum of force times velocity of the atoms, in the frame of the simulation",
    ),
    Quantity(
        "velocity_gradient",
        **_VELOCITY,
        **_kinematic(
            "rate", "velocity gradient", lambda s: s.velocity_gradient, 2, comment=_BY_KERNEL, scale=_velocity_slope
        ),
    ),
    Quantity(
        "strain_rate",
        **_VELOCITY,
        **_kinematic(
            "rate",
            "rate of strain",
            lambda s: 0.5 * (s.velocity_gradient + s.velocity_gradient.swapaxes(1, 2)),
            2,
            sign="positive where material lengthens; symmetric part of the velocity gradient",
            comment=_BY_KERNEL,
            scale=_velocity_slopes,
        ),
    ),
    Quantity(
        "vorticity",
        **_VELOCITY,
        **_kinematic(
            "rate",
            "vorticity",
            lambda s: curl(s.velocity_gradient),
            1,
            sign="curl of the velocity, right-handed: twice the rotation rate",
            comment=_BY_KERNEL,
            scale=_velocity_slopes,
        ),
    ),
    Quantity(
        "displacement",
        **_DISPLACEMENT,
        **_kinematic(
            "length",
            "displacement since the reference frame",
            lambda s: s.displacement,
            1,
            sign="positive along +x, +y, +z",
            gradient=False,
            comment="mass-weighted mean of x_j - X_j over the atoms that are near the point now (current positions)",
        ),
    ),
    Quantity(
        "displacement_gradient",
        **_DISPLACEMENT,
        **_kinematic(
            "dimensionless",
            "gradient of the displacement",
            lambda s: s.displacement_gradient,
            2,
            comment="with respect to current positions; the inverse of the deformation gradient is I minus "
            "it; " + _BY_KERNEL,
            scale=lambda s: _slope(s, s.displacement),
        ),
    ),
    Quantity(
        "eshelby_stress",
        "pressure",
        "Eshelby's energy-momentum stress",
        lambda s: s.eshelby,
        rank=2,
        bond=("piola",),
        gradient=True,
        gather=("reference_mass", "reference_displacement", "reference_energy"),
        sign="W I - P (Grad u)^T; component [i, j]: i the reference direction of the divergence (face normal), j the "
        "component of the configurational force",
        comment="grid points are points of the reference frame, and all sums run over reference positions: W the "
        "potential energy density relative to the "
        "reference frame, P piola_stress, u the mass-weighted displacement; no kinetic or entropic part; NaN where "
        "there is no mass",
    ),
    *_peridynamic(),
]

QUANTITIES: dict[str, Quantity] = _AndColumns({q.name: q for q in _ALL}, lambda name: columns.quantity(name, Quantity))


#: Fields that only time averages of other fields need: no output has them.
QUANTITIES.hidden = {
    "_number": Quantity("_number", "number_density", "number density", lambda s: s.site["one"][:, 0], site=("one",)),
    "_degrees": Quantity(
        "_degrees", "number_density", "degrees of freedom", lambda s: s.site["degrees"][:, 0], site=("degrees",)
    ),
    "_paired": Quantity(
        "_paired",
        "number_density",
        "number density where an atom is not alone in reach",
        lambda s: np.where(s.alone, 0.0, s.all_number),
        site=("one", *_MEAN, "kinetic"),
        masked=True,
    ),
}


def hidden(name: str) -> bool:
    """Whether a quantity is for time averages of others only."""
    return name in QUANTITIES.hidden


def register(quantity: Quantity) -> Quantity:
    """Make a quantity of sums that there are known by its name, to `atc.fields` and to scenes.

    Raises
    ------
    AtcError
        If the name is taken, or a sum that it names is not one of `SITE`, `BOND`, `WHOLE`, `GATHER`, `POINT`.
    """
    if quantity.name in QUANTITIES:
        raise AtcError(f"quantity {quantity.name!r} is known already: give it another name")
    try:
        quantity.sources()
    except KeyError as e:
        raise AtcError(f"quantity {quantity.name!r}: there are no sums called {e.args[0]!r}") from None
    QUANTITIES[quantity.name] = quantity
    return quantity


def expand(names) -> list[Quantity]:
    """The quantities called `names`, each whole followed by its parts, without repetition, in the order asked."""
    if isinstance(names, str):
        names = [names]
    out: dict[str, Quantity] = {}
    for name in names:
        if name not in QUANTITIES and not columns.is_column(name) and not hidden(name):
            from difflib import get_close_matches

            close = get_close_matches(str(name), QUANTITIES, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise AtcError(f"unknown quantity {name!r}{hint}: expected some of {', '.join(QUANTITIES)}")
        for n in (name, *QUANTITIES[name].parts):
            out.setdefault(n, QUANTITIES[n])
    if not out:
        raise AtcError(f"no quantities were asked for: name at least one of {', '.join(QUANTITIES)}")
    return list(out.values())


@dataclass
class Work:
    """The least work that gives a set of quantities: which sums, over what, and which passes. Nothing else is
    computed."""

    quantities: list[Quantity]
    site: list[str] = field(default_factory=list)
    bond: list[str] = field(default_factory=list)
    reference_bond: list[str] = field(default_factory=list)
    whole: list[str] = field(default_factory=list)
    gather: list[str] = field(default_factory=list)
    reference_gather: list[str] = field(default_factory=list)
    point: list[str] = field(default_factory=list)
    reference_point: list[str] = field(default_factory=list)
    squares: list[str] = field(default_factory=list)  # factors whose sums with φ² are wanted too
    attributes: dict[str, list[str]] = field(default_factory=dict)  # frame attribute -> the quantities that need it
    kernel: bool = True  # whether sums on the grid are taken with one

    @classmethod
    def of(
        cls, names, central: bool = True, parts: bool = False, velocity: str = "local", churnless: bool = False,
        kernel: bool = True,
    ) -> Work:  # fmt: skip
        """The work behind the quantities called `names` (wholes are expanded). `central`: whether forces act along
        bonds. `parts`: of one species after the other; what is relative to the local velocity is to that of all.
        `velocity`: what thermal motion is relative to, see `settings`. `churnless`: whether M = −S in every bond: it
        need not be summed up then (`sums.churn_nothing`). `kernel`: False on planes, where crossings are counted."""
        work = cls(expand(names), kernel=kernel)
        for q in work.quantities:
            for have, asked in ((work.site, q.site), (work.whole, q.whole)):
                have.extend(s for s in asked if s not in have)
            for kind, names, here, there in (
                (BOND, q.bond, work.bond, work.reference_bond),
                (GATHER, q.gather, work.gather, work.reference_gather),
                (POINT, q.point, work.point, work.reference_point),
            ):
                for name in names:
                    have = there if kind[name].on_reference else here
                    if name not in have:
                        have.append(name)
            for source in q.sources():
                for a in source.frame:
                    users = work.attributes.setdefault(a, [])
                    if q.name not in users:
                        users.append(q.name)
        if parts and any(q.relative for q in work.quantities):
            work.site += [ALL + "mass", ALL + "momentum"]
        if velocity == "frame" and any(q.thermal for q in work.quantities):
            work.squares = ["mass", ALL + "mass"] if parts else ["mass"]
            more = ["one", ALL + "one", ALL + "kinetic"] if parts else ["one"]
            work.site += [name for name in more if name not in work.site]
        if churnless:
            work.bond = list(dict.fromkeys("stress" if name == "sources" else name for name in work.bond))
        if not central:
            work.bond = ["moment" if name == "stress" else name for name in work.bond]
            work.site, work.whole = (
                ["atom_moment" if name == "atom_virial" else name for name in sums] for sums in (work.site, work.whole)
            )
        return work

    def _any(self, what):
        return [q.name for q in self.quantities if any(getattr(s, what) for s in q.sources())]

    @property
    def bond_users(self) -> list[str]:
        """Quantities that need the potential and the pass over the bonds."""
        return self._any("bonds")

    @property
    def energy_users(self) -> list[str]:
        return self._any("energies")

    @property
    def force_users(self) -> list[str]:
        """Quantities that need the forces between atoms."""
        return self._any("forces")

    @property
    def source_users(self) -> list[str]:
        """Quantities that need the energy sources of the bonds."""
        return self._any("sources")

    @property
    def gradient_users(self) -> list[str]:
        """Quantities that need the gradient of the kernel."""
        return [q.name for q in self.quantities if q.gradient]

    @property
    def on_reference(self) -> list[str]:
        """Quantities on the grid of the reference frame."""
        return [q.name for q in self.quantities if q.on_reference]

    @property
    def reference_users(self) -> list[str]:
        return self._any("reference")

    @property
    def grid_users(self) -> list[str]:
        """Quantities that live on the grid."""
        return [q.name for q in self.quantities if q.kind == "grid"]

    @property
    def kernel_users(self) -> list[str]:
        return [q.name for q in self.quantities if q.kernel and self.kernel]

    @property
    def horizon_users(self) -> list[str]:
        """Quantities that need a horizon."""
        return [q.name for q in self.quantities if q.point]

    @property
    def symmetric_users(self) -> list[str]:
        """Quantities that only know forces along bonds."""
        return [q.name for q in self.quantities if {"atom_virial"} & {*q.site, *q.whole}]

    @property
    def masked(self) -> bool:
        return any(q.masked for q in self.quantities)

    @property
    def atom_moment(self) -> bool:
        return "atom_moment" in self.site or bool({"atom_moment", "reference_atom_moment"} & {*self.whole})

    @property
    def atom_virial(self) -> bool:
        return "atom_virial" in self.site or "atom_virial" in self.whole

    @property
    def beyond_bonds(self) -> bool:
        """Whether more of the potential is wanted than its bonds: energies, forces, virials of atoms or of the box."""
        wholes = {"box_virial", "box_power"} & {*self.whole}
        return bool(self.energy_users or self.force_users or self.atom_virial or self.atom_moment or wholes)

    @property
    def summed_site(self) -> list[str]:
        """Those of `site` that need a sum of their own: none where the sums with gradients have them all."""
        return [] if {*self.site} <= {*self.gather} & _ALIKE else self.site

    @property
    def n_site(self) -> int:
        return sum(SITE[s].width for s in self.summed_site)

    @property
    def n_bond(self) -> int:
        return sum(BOND[b].width for b in self.bond)

    @property
    def n_reference_bond(self) -> int:
        return sum(BOND[b].width for b in self.reference_bond)

    @property
    def n_gather(self) -> int:
        return sum(GATHER[g].width for g in self.gather)

    @property
    def n_reference_gather(self) -> int:
        return sum(GATHER[g].width for g in self.reference_gather)

    def slopes(self, key: str) -> bool:
        """Whether the sums of "gather" or "reference_gather" are wanted with ∂φ/∂x."""
        return any(q.gradient for q in self.quantities if q.gather and q.on_reference == (key == "reference_gather"))
