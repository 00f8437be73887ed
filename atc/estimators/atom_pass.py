"""The passes over the atoms of one frame, from plain data to sums: Σ a φ, and with the kernel's gradient Σ a ∂φ/∂x."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of, only_atoms
from .bond_pass import PerAtom
from .deposits import Deposits
from .peridynamic import node_volumes
from .place import Place
from .reference import Displacement
from .summed import ALL, GATHER, SITE, by_name
from .sums import Sums
from .tensors import kinetic_flux, kinetic_flux_about, outer6, quotient, thermal, within_thermal
from .work import Work

# Rounding error a point may have in T − ρ v⊗v, relative to its thermal part: far below the 1e-6 that is promised.
_SHIFT_TOLERANCE = 1e-9
_MAX_SHIFTS = 16


def drift_velocity(frame, chosen_n=None) -> np.ndarray:
    """(3,) mass-mean velocity of the frame, or of the chosen atoms.

    Taken relative to one atom's velocity first, so that a drift large against the thermal velocity costs no digits of
    the mean.
    """
    some = slice(None) if chosen_n is None or chosen_n.all() else chosen_n
    m, v_nc = frame.masses[some], frame.velocities[some]
    if not len(m):
        return np.zeros(3)
    v0 = v_nc[0]
    total = m.sum()
    return v0 + (m @ (v_nc - v0)) / total if total > 0 else v0.copy()


class AtomFactors:
    """The columns of the site sums, (n, width) each, made when asked for and kept; 0 for atoms that are not chosen (see
    `chosen`)."""

    def __init__(self, frame, drift, per_atom: PerAtom | None = None, pot=None, chosen=None):
        self.frame, self.drift, self.per_atom, self.pot = frame, drift, per_atom or PerAtom(), pot
        self.chosen = chosen
        self._kept: dict[str, np.ndarray] = {}

    @property
    def atoms(self):
        """The frame without virtual sites, which have energies and no numbers of their own."""
        return atoms_of(self.frame)

    @property
    def peculiar_nc(self) -> np.ndarray:
        """Velocities relative to the frame's drift."""
        if "peculiar" not in self._kept:
            self._kept["peculiar"] = self.frame.velocities - self.drift
        return self._kept["peculiar"]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._kept:
            a_nk = SITE[name].of(self)
            if len(a_nk) < len(self.frame):
                a_nk = self.frame.padded(a_nk)
            if self.chosen is not None:
                of = self.chosen.chosen_n if name.startswith(ALL) else self.chosen.own_n
                a_nk = np.where(of[:, None], a_nk, 0.0)
            self._kept[name] = a_nk
        return self._kept[name]

    @property
    def masses(self) -> np.ndarray:
        """(n,) those of the chosen atoms, 0 for others."""
        return self.frame.masses if self.chosen is None else np.where(self.chosen.own_n, self.frame.masses, 0.0)

    @property
    def some(self):
        """The atoms that count at all, an index."""
        if self.chosen is None or self.chosen.chosen_n.all():
            return slice(None)
        return np.flatnonzero(self.chosen.chosen_n)

    @property
    def volumes(self) -> np.ndarray:
        """(n,) of the nodes of a body."""
        return node_volumes(self.frame)

    def only_atoms(self, a_nk) -> np.ndarray:
        """The rows of the atoms themselves, with what their virtual sites have."""
        return only_atoms(self.frame, a_nk)

    def columns(self, names) -> np.ndarray:
        """(n, k) the named factors side by side."""
        return np.ascontiguousarray(np.concatenate([self[name] for name in names], axis=1))


class OfAll:
    """The factors of the atoms of all parts, where there are several."""

    def __init__(self, factors: AtomFactors):
        self.factors, self.peculiar_nc = factors, factors.peculiar_nc

    def __getitem__(self, name: str) -> np.ndarray:
        return self.factors[ALL + name]


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


def local_shifts(sums: Sums, deposits: Deposits, x_nc, factors, flux: bool = False):
    """T − ρ v⊗v (and Σ ½ m w² w φ, if `flux`) where different regions move at very different speeds, without
    cancellation.

    The expressions do not change when one velocity is subtracted from all atoms; their rounding errors are about ε ρ
    |v(x) − c|² and ε ρ |v(x) − c|³ for the subtracted c. The frame's mean is enough for a uniform drift. Where it is
    not, more passes over the atoms take further c, each the velocity of the point that is worst off, and every point
    keeps the one nearest to its own velocity.

    Returns
    -------
    (g, 6) and (g, 3) or None; None, None where the frame's mean was enough everywhere.
    """
    best = sums.thermal_of_drift
    best_flux = sums.kinetic_flux_of_drift if flux else None
    rho = sums.rho
    v_gc = sums.stream
    eps = 64 * np.finfo(float).eps
    # How many thermal speeds away from c a point may be.
    limit = (_SHIFT_TOLERANCE / eps) ** (1 / 3 if flux else 1 / 2)
    if within_thermal(rho, v_gc, best, 0.99 * limit):
        return None, None
    have = np.linalg.norm(v_gc, axis=1)
    done = False
    for _ in range(_MAX_SHIFTS):
        heat = quotient(best[:, :3].sum(1), rho)
        # A point with one atom has no thermal part at all: measure it against what is typical of the points that
        # certainly have one.
        certain = heat[heat > eps * have**2]
        scale = np.sqrt(np.maximum(heat, np.median(certain) if len(certain) else 0.0))
        error = np.where(sums.defined, have - limit * scale, 0.0)
        worst = int(np.argmax(error)) if len(error) else 0
        if not len(error) or not error[worst] > 0:
            break
        c = v_gc[worst].copy()
        w_nc = factors.peculiar_nc - c
        m = factors["mass"]
        columns = [m, m * w_nc, m * outer6(w_nc)]
        if sums.of_part:
            M = factors["all_mass"]
            columns += [M, M * w_nc]
        if flux:
            columns.append(0.5 * m * np.einsum("nc,nc->n", w_nc, w_nc)[:, None] * w_nc)
        total = deposits.sites(x_nc, np.ascontiguousarray(np.concatenate(columns, axis=1)))
        about = ()
        if sums.of_part:
            u_gc = quotient(total[:, 11:14], total[:, 10])
            about, total = (u_gc,), np.delete(total, slice(10, 14), axis=1)
        else:
            u_gc = quotient(total[:, 1:4], total[:, 0])
        distance = np.linalg.norm(u_gc, axis=1)
        nearer = sums.defined & (distance < have)
        if not nearer.any():
            break
        if not done:
            done, best = True, best.copy()
            best_flux = best_flux.copy() if flux else None
        shifted = thermal(total[:, :1], total[:, 1:4], total[:, 4:10], *about)
        best[nearer] = shifted[nearer]
        if flux:
            if sums.of_part:
                flux_gc = kinetic_flux_about(total[:, :1], total[:, 1:4], total[:, 4:10], total[:, 10:], u_gc)
            else:
                flux_gc = kinetic_flux(total[:, 0], u_gc, shifted, total[:, 10:])
            best_flux[nearer] = flux_gc[nearer]
        have = np.where(nearer, distance, have)
    return (best, best_flux) if done else (None, None)


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
