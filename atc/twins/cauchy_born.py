"""The material ``cauchy-born`` of a twin: correspondence with the stress of the crystal under the run's potential."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from .. import pd
from ..upscaling.cauchy_born import CauchyBorn, CrystalLaw, StrainEnergy, cubic_of
from ..upscaling.free_energy import vibrational
from .material import TwinMaterial, hill, require_stable, sampled_constants

#: The horizon in distances of nodes: the three nearest shells of a cubic lattice. What a node sees of its strain is
#: exact for every family that spans space, so that a larger one would only blur it.
HORIZON = 1.8


@dataclass
class CauchyBornTwin(TwinMaterial):
    """The crystal itself at every node (internal units).

    material : pd.Hyperelastic. law : CrystalLaw
    bulk, shear : Hill averages. sampled_vv, wanted_vv : (6, 6) elastic constants of a periodic body of these nodes, and
        of the crystal
    """

    material: object
    law: CrystalLaw
    bulk: float
    shear: float
    sampled_vv: np.ndarray
    wanted_vv: np.ndarray
    temperature: float | None = None

    @property
    def crystal_vv(self) -> np.ndarray:
        return self.wanted_vv

    def lines(self, units) -> list[str]:
        """What it is, what it gets exactly and what not: for a person."""
        p = lambda v: f"{units.to_user('pressure', v):.5g}"  # noqa: E731
        c11, c12, c44 = cubic_of(self.law.exact.moduli_vv)
        quick = self.law.quick
        how = (
            "the potential itself at every node: its force jumps at the cutoff, so that no polynomial holds"
            if quick is None
            else f"a polynomial of degree {quick.degree} in Green's strain up to {quick.reach:g}, stress within "
            f"{quick.error:.1g} of the crystal's; beyond that the potential itself"
        )
        warm = self.law.warm
        thermal = []
        if warm is not None:
            thermal = [
                f"temperature: {self.temperature:g} {units.label('temperature')}, classical quasi-harmonic free energy "
                f"(polynomial within {100 * warm.error:.2g} %): free of stress at a stretch of "
                f"{self.law.free_stretch():.5f}, thermal stress at rest "
                f"{p(-warm(np.zeros((1, 6)))[1][0, :3].mean())} {units.label('pressure')}"
            ]
        return [
            f"material: cauchy-born (correspondence), the crystal under the run's potential: C11 {p(c11)}, C12 "
            f"{p(c12)}, C44 {p(c44)} {units.label('pressure')}, basis relaxed, finite strain",
            f"energy: {how}",
            *thermal,
            f"exact: every homogeneous deformation; elastic constants of the nodes within {self.error:.1g}",
            "not exact: dispersion of the crystal, surfaces (stress and stiffness of their own)",
        ]

    def after(self, simulation) -> list[str]:
        """What a run showed, for a person."""
        H = simulation.model.H_ncc.reshape(-1, 3, 3)
        least = self.law.ellipticity(H)
        lost = int((least <= 0).sum())
        lines = [f"stability: the softest plane wave of any node has {least.min():.3g} of its stiffness at rest"]
        if lost:
            lines[0] += f"; {lost} nodes are past the crystal's stability, where results depend on the spacing"
        return lines


def cauchy_born(crystal, model, axes, step_cc, horizon, temperature=None, influence=None) -> CauchyBornTwin:
    """The material of a relaxed crystal whose x, y, z are the rows of `axes` in the body; with a temperature (the
    user's unit) its vibrations are in it; influence as of `pd.Hyperelastic`."""
    exact = CauchyBorn(crystal, model)
    require_stable(crystal, np.linalg.eigvalsh(exact.moduli_vv).min() > 0)
    weighted = partial(pd.Hyperelastic, **({} if influence is None else {"influence": influence}))
    # The nodes' sums are those of any law: they are tried with the one that is at rest.
    law = CrystalLaw(exact, StrainEnergy.fitted(exact), axes)
    sampled, wanted = sampled_constants(weighted(law), step_cc, horizon, crystal.density), law.moduli_vv
    law = CrystalLaw(exact, law.quick, axes, None if temperature is None else vibrational(exact, model, temperature))
    return CauchyBornTwin(weighted(law), law, *hill(law.moduli_vv), sampled, wanted, temperature)
