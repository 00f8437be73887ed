"""LAMMPS bond, angle, dihedral and improper styles that are known and not supported, with the reason: what a user is
told."""

from __future__ import annotations

_HISTORY = (
    "its forces depend on the bonds of a reference state, on damage and on rates, not on positions alone; for "
    "peridynamics see atc pd"
)
_BODIES = "its forces act on the orientations of nucleotides, which are no function of the distances between atoms"
_AMOEBA = "it belongs to the AMOEBA force field, whose multipoles and induced dipoles positions alone do not give"

REASONS = {
    "bond": {
        "bpm/rotational": _HISTORY,
        "bpm/spring": _HISTORY,
        "bpm/spring/plastic": _HISTORY,
        "rheo/shell": _HISTORY,
        "harmonic/restrain": "each bond is held at the length it had when the run began, which neither the script nor "
        "a frame says: use bond_style harmonic with those lengths",
        "oxdna/fene": _BODIES,
        "oxdna2/fene": _BODIES,
        "oxrna2/fene": _BODIES,
    },
    "angle": {
        "amoeba": _AMOEBA,
        "cosine/buck6d": "it adds the pair interaction of pair_style buck6d between its outer atoms, which is not "
        "supported",
        "dipole": "it holds the direction of an atom's dipole, which is no function of the distances between atoms",
    },
    "dihedral": {},
    "improper": {"amoeba": _AMOEBA},
}
