"""Stress: Hardy's, the virial of the box and of the atoms, the virial smoothed with the kernel."""

from __future__ import annotations

import numpy as np

from ..tensors import full
from .quantity import MEAN, STRESS_SIGN, Quantity

_VIRIAL_SIGN = "tension positive (as LAMMPS's stress/atom, the opposite of its pressure); component [i, j], symmetric"


def _stress(parts_form):
    return {"dimension": "pressure", "rank": 2, "sign": STRESS_SIGN, "form": parts_form}


def _atom_virial(sums) -> np.ndarray:
    """(…, 3, 3) from six components, or nine where forces do not act along bonds."""
    return full(sums["atom_virial"]) if "atom_virial" in sums else sums["atom_moment"].reshape(-1, 3, 3)


QUANTITIES = [
    Quantity(
        "stress_kinetic",
        site=(*MEAN, "kinetic"),
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
        site=(*MEAN, "kinetic"),
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
]
