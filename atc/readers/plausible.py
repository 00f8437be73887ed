"""Numbers outside all reason: the likely sign of a wrong unit style or wrong masses."""

from __future__ import annotations

import numpy as np

from ..planar import thin

# Measured on Lennard-Jones argon: coordinates rounded to 0.01 Å give 1.5 to 2 % stress error at a kernel radius of 5 Å.
# Rounding errors are independent and small, so the stress error is linear in the rounding step.
_STRESS_ERROR_PER_ANGSTROM = 2e-2 / 0.01
# In reduced units σ plays the part of argon's 3.4 Å.
_ANGSTROM_PER_SIGMA = 3.4
# amu/Å³ in g/cm³.
_GCC = 1.66053906660


def stress_error(resolution: float, units) -> float:
    """Relative stress error to expect at a kernel radius of 5 Å (1.5 σ) from coordinates resolved to `resolution` (in
    `units`)."""
    angstrom = resolution * _ANGSTROM_PER_SIGMA if units.reduced else units.to_internal("length", resolution)
    return angstrom * _STRESS_ERROR_PER_ANGSTROM


def doubts(frame, temperature: bool = True) -> list[str]:
    """What is hard to believe about a frame's temperature and density, a sentence each. Reduced units have no such
    limits.

    temperature : whether velocities matter
    """
    u, out = frame.units, []
    if thin(frame):
        out.append(
            "all atoms have the same z, in a box hardly thicker than an atom: if this is a two-dimensional run, say "
            "so (dimension 2 in the LAMMPS lines, "
            "[trajectory] dimension = 2, or atc.read(..., dimension=2)); it is taken as a three-dimensional one"
        )
    # Nodes with a volume of their own are pieces of a continuum: they have no temperature.
    if u.reduced or len(frame) < 2 or frame.masses is None or "volume" in frame.extra:
        return out
    if temperature and frame.velocities is not None:
        w = frame.velocities - frame.masses @ frame.velocities / frame.masses.sum()
        T = float(frame.masses @ np.einsum("nc,nc->n", w, w)) / (float(frame.dimension) * len(frame) * u.boltzmann)
        if T > 1e5 or 0 < T < 1e-3:
            out.append(
                f"the atoms have a temperature of {T:.3g} K: velocities or masses are probably not in {u.name!r} units"
            )
    if frame.cell.volume > 0 and frame.dimension == 3:
        density = frame.masses.sum() / frame.cell.volume * _GCC
        if density > 30:
            out.append(
                f"the box has a mean density of {density:.3g} g/cm^3: lengths or masses are probably not in "
                f"{u.name!r} units"
            )
    return out
