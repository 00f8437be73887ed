"""The passes over the atoms of one frame, from plain data to sums: Σ a φ, and with the kernel's gradient Σ a ∂φ/∂x."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .deposits import Deposits
from .place import Place
from .reference import Displacement
from .shifts import local_shifts
from .sources import AtomFactors, OfAll
from .summed import GATHER, SITE, by_name
from .sums import Sums
from .work import Work


def atom_pass(
    sums: Sums, frame, work: Work, deposits: Deposits, factors: AtomFactors, squares_within: float = 0.0
) -> Sums:
    """`sums` with those over the atoms, at one set of points: one pass for all of them; further ones for sums of φ²,
    and where regions move at very different speeds.

    squares_within : what sums of φ² may lack, see `deposits.SQUARES`
    """
    names, x_nc = work.site, frame.positions
    unshifted = {"thermal_shifted": None, "kinetic_flux_shifted": None, "thermal_all_shifted": None}
    sums = replace(sums, site=_over_atoms(deposits.sites, names, x_nc, factors), **unshifted)
    if work.squares:
        # They say by how much thermal motion is corrected: a share 1/N = Σ φ²/n² of it, n the number density.
        below = squares_within * sums.all_number.min(initial=np.inf) if squares_within else 0.0
        sums.squared = _over_atoms(deposits.squares, work.squares, x_nc, factors, below)
    if "kinetic" in names and "momentum" in names:
        found = local_shifts(sums, deposits, x_nc, factors, flux="kinetic_flux" in names)
        sums.thermal_shifted, sums.kinetic_flux_shifted = found
        if "all_kinetic" in names:
            sums.thermal_all_shifted = local_shifts(sums.of_all, deposits, x_nc, OfAll(factors))[0]
    if sums.squared:
        sums.count_freedom()
    return sums


def _over_atoms(take, names, x_nc, factors: AtomFactors, *more) -> dict[str, np.ndarray]:
    """What `take` of some `Deposits` gives of the named factors."""
    some = factors.some
    return by_name(names, SITE, take(x_nc[some], np.ascontiguousarray(factors.columns(names)[some]), *more))


def add_atoms(deposits: Deposits, deposit, frame, names, factors: AtomFactors) -> None:
    """The named factors of a frame's atoms into a deposit of several frames."""
    x_nc, a_nk, some = deposits.place(frame.positions), factors.columns(names), factors.some
    deposits.add_sites(deposit, x_nc[some], np.ascontiguousarray(a_nk[some]))


def gather_pass(frame, reference, work: Work, place: Place, factors: AtomFactors) -> list[dict]:
    """The sums that need the kernel's gradient, or displacements from a reference: "gathered" and "gradient" of the
    grid and of the points of the check."""
    plain = [name for name in work.gather if name not in ("mass", "displacement")]
    extra = factors.columns(plain) if plain else np.zeros((len(frame), 0))
    displacement, m_n = None, factors.masses
    if "displacement" in work.gather:
        displacement = Displacement(frame.replace(masses=m_n), reference, False)
    names = ["mass", "displacement", *plain] if displacement else ["mass", *plain]
    out = []
    for deposits in place.both:
        if displacement is not None:
            found = displacement.gather(deposits, frame.positions, m_n, extra, work.slopes("gather"))
        else:
            a_nk = np.concatenate([m_n[:, None], extra], axis=1)
            found = deposits.gather(frame.positions, a_nk, None, work.slopes("gather"))
        out.append(_gathered(names, *found))
    return out


def reference_gather_pass(frame, reference, energies_n, place: Place, factors: AtomFactors) -> list[dict]:
    """The same over reference positions. energies_n : of the atoms in the reference"""
    displacement = Displacement(frame, reference, True)
    energy_n1 = (factors.per_atom.energies_n - energies_n)[:, None]
    names = ["reference_mass", "reference_displacement", "reference_energy"]
    return [
        _gathered(
            names,
            *displacement.gather(deposits, reference.positions, frame.masses, energy_n1, True, "reference_gather"),
        )
        for deposits in place.both
    ]


def _gathered(names, values, gradients) -> dict:
    return {
        "gathered": by_name(names, GATHER, values),
        "gradient": {} if gradients is None else by_name(names, GATHER, gradients),
    }
