"""The models of a crystal by their names, and how well each does.

The residual of a model is the relative error of ω at k = 0.1, 0.25, 0.5, 0.75 and 1 of the zone boundary on the
branches along [100], [110] and [111] (seven for a cubic crystal).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from .branches import FRACTIONS, branch_values, cubic_branches
from .elasticity import ElasticConstants
from .fitting import fit_coarse, fit_kernel, wave_vectors, zone_wave_vectors
from .force_constants import ForceConstants, signed_root
from .peridynamic_kernels import Classical, CoarseLattice, Lattice, MollifiedLattice


@dataclass
class Match:
    """A model against the crystal it stands for.

    Attributes
    ----------
    label : str
    branches : labels of the branches
    fractions : of the zone boundary (of the coarse zone for coarse lattices)
    error_bf : (branches, fractions) relative error of ω; 1 where ω is imaginary
    velocity_error_bf : error of the group velocity relative to the branch's speed of sound
    rms : over all of error_bf. band : over the whole zone, fifty fractions equally spaced
    min_omega2 : smallest ω² found outside the first zone's inscribed sphere up to |k| = 4 · 2π/a (lattices: in their
        zone), relative to the crystal's
        largest ω²; and where. stable : no ω² < 0 anywhere, long waves included
    omega_max : largest ω; stable time step 2/omega_max (internal units)
    """

    label: str
    branches: list[str]
    fractions: np.ndarray
    error_bf: np.ndarray
    velocity_error_bf: np.ndarray
    rms: float
    band: float
    min_omega2: float
    min_omega2_at: np.ndarray
    omega_max: float
    stable: bool
    model: object = None

    @property
    def stable_step(self) -> float:
        """2/ω_max, the limit of velocity Verlet, internal time."""
        return 2.0 / self.omega_max


def match(model, fc: ForceConstants, fractions=FRACTIONS) -> Match:
    """Residuals, group velocities, stability and the stable step of a model (see `Match`)."""
    factor, crystal, lattice = model.factor, fc.crystal, Lattice(fc)
    branches = cubic_branches(crystal, factor)
    error, verror = [], []
    for b in branches:
        true, v_true = branch_values(lattice, b, fractions, velocities=True)
        mine, v_mine = branch_values(model, b, fractions, velocities=True)
        slow = np.sqrt(branch_values(lattice, b, [1e-3])[0]) / (1e-3 * b.boundary)
        error.append(signed_root(mine) / np.sqrt(true) - 1.0)
        verror.append((v_mine - v_true) / slow)
    error, verror = np.array(error), np.array(verror)
    dense = np.linspace(0.02, 1.0, 50)
    every = [
        signed_root(branch_values(model, b, dense)) / np.sqrt(branch_values(lattice, b, dense)) - 1.0 for b in branches
    ]
    band = float(np.sqrt(np.mean(np.square(every))))
    g = 2 * np.pi / np.linalg.norm(crystal.conventional[0])
    periodic = isinstance(model, (Lattice, CoarseLattice))
    if periodic:
        k = np.vstack([zone_wave_vectors(crystal, factor, 16), *(b.k(np.linspace(0.02, 1, 50)) for b in branches)])
    else:
        # Other points than those the fit looked at, and closer.
        k = np.vstack([wave_vectors(4 * g, g / 13.7)])
    values = np.linalg.eigvalsh(model.dynamical_matrix(k))
    beyond = np.linalg.norm(k, axis=1) >= 0.999 * min(b.boundary for b in branches)
    low, high = values[beyond, 0].min(), values[:, -1].max()
    at = k[beyond][int(np.argmin(values[beyond, 0]))]
    limit = model.onsite_matrix()
    if limit is not None:
        ends = np.linalg.eigvalsh(limit)
        high = max(high, ends[-1])
        if ends[0] < low:
            low, at = ends[0], np.full(3, np.inf)
    top = np.linalg.eigvalsh(fc.dynamical_matrix(zone_wave_vectors(crystal, 1.0, 16))).max()
    return Match(
        model.label,
        [b.label for b in branches],
        np.array(fractions),
        error,
        verror,
        float(np.sqrt(np.mean(error**2))),
        band,
        float(low / top),
        at,
        float(np.sqrt(high)),
        bool(values[:, 0].min() > -1e-9 * top and low > -1e-9 * top),
        model,
    )


MODELS = ("classical", "isotropic", "cubic", "noncentral", "mollified", "coarse2", "coarse3", "lattice")


def make_model(
    name: str,
    fc: ForceConstants,
    elastic: ElasticConstants,
    *,
    horizon=None,
    knots: int = 12,
    width=None,
    order: int = 4,
):
    """One of `MODELS` for a crystal. horizon, width: internal length (width by default as wide as the zone allows)."""
    if name == "classical":
        return Classical(elastic)
    if name == "lattice":
        return Lattice(fc)
    if name == "mollified":
        return MollifiedLattice(fc, width, order) if width else MollifiedLattice.for_zone(fc, order)
    if name in ("coarse2", "coarse3"):
        if len(fc.crystal) > 1:
            raise AtcError(
                f"{name}: coarse lattices are for crystals with one atom in the primitive cell; {fc.crystal.name} has "
                f"{len(fc.crystal)}"
            )
        return fit_coarse(fc, int(name[-1]))
    return fit_kernel(fc, name, horizon=horizon, knots=knots)
