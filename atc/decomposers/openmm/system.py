"""A System of OpenMM as a `Potential`."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...units import units
from ..constraints.held import Constraints
from ..constraints.virtual_sites import VirtualSites
from ..potentials import Potential
from .atoms import Particles, SystemConstraints
from .bonded import BONDED, global_parameters
from .formulas import _number
from .nonbonded import nonbonded
from .sites import sites_of

#: Forces without energy: they steer a run.
_STEERING = {
    "CMMotionRemover": "removal of the centre's motion", "AndersenThermostat": "a thermostat",
    "MonteCarloBarostat": "a barostat", "MonteCarloAnisotropicBarostat": "a barostat",
    "MonteCarloMembraneBarostat": "a barostat", "MonteCarloFlexibleBarostat": "a barostat",
}  # fmt: skip
#: Why some others are refused.
_REFUSED = {
    "GBSAOBCForce": "implicit solvent has forces that no pair of atoms has",
    "CustomGBForce": "implicit solvent has forces that no pair of atoms has",
    "AmoebaMultipoleForce": "multipoles have torques, and induced dipoles depend on all atoms",
    "HippoNonbondedForce": "multipoles have torques, and induced dipoles depend on all atoms",
    "DrudeForce": "Drude particles are not supported",
    "GayBerneForce": "ellipsoids have torques",
    "CustomExternalForce": "it acts from outside: leave it out of the System, and it is part of body_force where the "
    "trajectory has forces",
}


def potential_of(system, name: str, switching: str | None = None, chiral: bool = False) -> Potential:
    """The potential of a System; options as of `load.Options`.

    Raises AtcError for Forces, virtual sites and forms that are not mapped, by their names.
    """
    u, n = units("mdanalysis"), system.getNumParticles()
    forces = [system.getForce(k) for k in range(system.getNumForces())]
    pairs = nonbonded(forces, n, name, switching)
    terms, remarks = list(pairs.terms), list(pairs.remarks)
    for force in forces:
        kind = type(force).__name__
        remarks += _defaults(force, kind)
        if kind in BONDED:
            terms += BONDED[kind](force, name, chiral)
        elif kind in _STEERING:
            remarks.append(f"{kind} ({_STEERING[kind]}) is no part of the model")
        elif kind not in ("NonbondedForce", "CustomNonbondedForce"):
            why = _REFUSED.get(kind, f"supported are NonbondedForce, CustomNonbondedForce, {', '.join(BONDED)}")
            raise AtcError(f"{name}: {kind} is not supported: {why}")
    periodic = pairs.periodic if pairs.periodic is not None else system.usesPeriodicBoundaryConditions()
    pot = Potential(terms, u)
    masses = np.array([_number(system.getParticleMass(k)) for k in range(n)]) * u.mass
    pot.setup = Particles(
        name, masses, pairs.charges * u.charge, pairs.kinds, pairs.exclusions, periodic, sites_of(system, name)
    )
    if pot.setup.sites is not None:
        pot.sites = VirtualSites(pot.setup.sites)
    pot.remarks = (*pot.setup.remarks(), *remarks, *_tail_remark(pairs.tail, u))
    pot.constraints = _constraints(system, name, masses)
    return pot


def _defaults(force, kind):
    """A word about global parameters, which a run may have changed."""
    if kind == "NonbondedForce" or not hasattr(force, "getNumGlobalParameters") or not force.getNumGlobalParameters():
        return []
    names = (f"{name} = {value:g}" for name, value in global_parameters(force).items())
    return [f"{kind} with the default {', '.join(names)}"]


def _tail_remark(tail, u):
    if not tail:
        return ()
    c = tail / u.energy / u.length**3
    return (
        f"the System's dispersion correction is in no field: energy {c:.9g}/V kJ/mol and pressure {c:.9g}/V^2 "
        "kJ/mol/angstrom^3 of a cell of V angstrom^3",
    )


def _constraints(system, name, masses):
    count = system.getNumConstraints()
    if not count:
        return None
    pairs = np.array([system.getConstraintParameters(k)[:2] for k in range(count)], np.int64)
    if not (masses[pairs] > 0).all():
        k = int(np.argmin((masses[pairs] > 0).all(axis=1)))
        raise AtcError(f"{name}: constraint {k} holds particle {pairs[k][masses[pairs[k]] == 0][0]}, which has no mass")
    return Constraints([SystemConstraints(pairs_c2=pairs, where=name)])
