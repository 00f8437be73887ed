"""What vibrations add to the energy of a strained crystal: the classical quasi-harmonic free energy.

F_vib(E) = kT ⟨½ ln det D(k; E)⟩ over the zone, D the dynamical matrix at the strain E, the basis at rest: its slope is
the thermal stress, from which thermal expansion and the softening of the elastic constants follow. Internal units.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import AtcError
from .cauchy_born import CauchyBorn, StrainEnergy, size_of, stretches
from .force_constants import force_constants

#: Points of the zone along each reciprocal vector, half a step off its centre.
_MESH = 8
_SAMPLES, _REACH, _DEGREE = 48, 0.05, 3


def vibrational(exact: CauchyBorn, model, temperature: float) -> StrainEnergy:
    """F_vib per reference volume as a polynomial of the third degree in Green's strain; `error` is the largest error of
    the energy at strains it was not fitted to, relative to the largest F_vib(E) − F_vib(0).

    Parameters
    ----------
    temperature : in the user's unit

    Raises
    ------
    AtcError where the crystal has unstable modes at rest.
    """
    crystal = exact.crystal
    rng = np.random.default_rng(20240611)
    E = rng.normal(size=(_SAMPLES, 6)) * np.array([1.0, 1, 1, 2**0.5, 2**0.5, 2**0.5])
    E *= (_REACH * np.linspace(0.2, 1, _SAMPLES) / size_of(E))[:, None]
    rest = _mean_log(exact, model, np.zeros(6))
    if not np.isfinite(rest):
        raise AtcError(f"{crystal.name}: the crystal has unstable modes at rest: temperature needs a stable one")
    found = np.array([_mean_log(exact, model, e) for e in E]) - rest
    good = np.isfinite(found)
    E, found = E[good], found[good]
    kT = crystal.units.boltzmann * crystal.units.to_internal("temperature", temperature)
    made = StrainEnergy(_DEGREE)
    columns = _values(made, E)
    if len(E) < 2 * columns.shape[1]:
        raise AtcError(f"{crystal.name}: most small strains make the crystal unstable: no thermal stress can be had")
    held = np.arange(len(E)) % 4 == 0
    test = np.linalg.lstsq(columns[~held], found[~held], rcond=None)[0]
    made.error = float(np.abs(columns[held] @ test - found[held]).max() / np.abs(found).max())
    made.reach = _REACH
    made.set(np.linalg.lstsq(columns, found, rcond=None)[0] * kT / crystal.volume)
    return made


def _values(made: StrainEnergy, E_nv) -> np.ndarray:
    """(n, orbits) the sum of every orbit."""
    out = []
    for k in range(len(made.orbits)):
        one = StrainEnergy(made.degree)
        one.set(np.eye(len(made.orbits))[k])
        out.append(one(E_nv)[0])
    return np.array(out).T


def _mean_log(exact: CauchyBorn, model, E_v) -> float:
    """⟨½ ln det D(k)⟩ of the crystal at a strain; NaN where a mode is unstable."""
    crystal = exact.crystal
    U = stretches(E_v[None])[0]
    made = crystal.strained(U - np.eye(3), exact.basis(E_v[None])[0])
    s = (np.array(list(product(range(_MESH), repeat=3))) + 0.5) / _MESH
    s = s[s[:, 0] < 0.5]  # the other half are these in reverse
    values = np.linalg.eigvalsh(force_constants(made, model).dynamical_matrix(s @ made.reciprocal))
    return 0.5 * float(np.log(values).sum(axis=1).mean()) if values.min() > 0 else np.nan
