"""Numbers outside all reason: the likely sign of a wrong unit style or wrong masses."""

from __future__ import annotations

import numpy as np

from ..planar import thin

# amu/Å³ in g/cm³.
_GCC = 1.66053906660


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
