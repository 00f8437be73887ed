"""NonbondedForce and CustomNonbondedForce of OpenMM as pair styles, long-range sums and exceptions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...errors import AtcError
from ..atom_columns import KIND
from ..long_range.dispersion import DispersionSplit, LongRangeDispersion
from ..long_range.ewald import LongRangeCoulomb
from ..long_range.kspace import RunAccuracy
from ..long_range.split import ACCURACY, Split
from ..pairs.coulomb import CoulombCut
from ..pairs.coulomb_long import CoulombLong
from ..pairs.lj_long import LennardJonesLong
from ..pairs.pairs import MAX_TYPES, Pairs
from .atoms import ExcludedPairs
from .bonded import formula_of
from .formulas import OPENMM, FormulaPairs, _number, powers_of
from .load import METHODS
from .pairs import SWITCHED, Exceptions, LennardJonesPowers, ReactionField

#: nm: the cutoff of a model without one; larger than any system without a box.
ENDLESS = 1000.0
#: Charges are known to this, e: a cell whose charge is less than as much on each particle is neutral.
DIGIT = 1e-6
_MODES = ("Ewald", "PME", "LJPME")
#: Gauss-Legendre nodes of integrals over distances, exact for powers.
_NODES = 48
_PERIODIC = ("CutoffPeriodic", "Ewald", "PME", "LJPME")
#: Coulomb's constant as OpenMM has it (CODATA 2018), 138.935... kJ/mol nm/e²; internal
_C = 138.93545764438198 * OPENMM.energy * OPENMM.length


@dataclass
class Nonbonded:
    """What of a System acts between pairs.

    terms : of the potential. kinds : (n,) row of the pair tables of each particle, from 1. charges : (n,) e
    exclusions : (m, 2). periodic : whether it is. remarks : what else there is to say
    tail : coefficient of the dispersion correction, an energy times a volume (internal)
    """

    terms: list = field(default_factory=list)
    kinds: np.ndarray | None = None
    charges: np.ndarray | None = None
    exclusions: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    periodic: bool | None = None
    remarks: list = field(default_factory=list)
    tail: float = 0.0


def nonbonded(forces, n: int, name: str, switching: str | None = None) -> Nonbonded:
    """The pair interactions of a System's NonbondedForce and CustomNonbondedForces.

    Raises AtcError for what is not mapped.
    """
    plain = [f for f in forces if type(f).__name__ == "NonbondedForce"]
    custom = [f for f in forces if type(f).__name__ == "CustomNonbondedForce"]
    out = Nonbonded(charges=np.zeros(n), kinds=np.ones(n, np.int64))
    if not plain and not custom:
        return out
    if len(plain) > 1:
        raise AtcError(f"{name}: {len(plain)} NonbondedForces: expected one")
    lj = np.zeros((n, 2))
    pairs, rows = np.zeros((0, 2), np.int64), np.zeros((0, 3))
    if plain:
        _refuse_parts(plain[0], name)
        values = np.array([[_number(v) for v in plain[0].getParticleParameters(k)] for k in range(n)]).reshape(n, 3)
        out.charges, lj = values[:, 0], values[:, 1:]
        lj[lj[:, 1] == 0.0] = (1.0, 0.0)  # without energy no diameter
        pairs, rows = _exceptions(plain[0])
    else:
        pairs = _exclusions(custom[0])
        rows = np.zeros((len(pairs), 3))
    mine = _codes(pairs, n)
    for f in custom:
        if f.getNumInteractionGroups():
            raise AtcError(f"{name}: CustomNonbondedForce: interaction groups are not supported")
        if not np.array_equal(_codes(_exclusions(f), n), mine):
            raise AtcError(f"{name}: CustomNonbondedForce: its exclusions are not those of the other nonbonded forces")
    formulas = [formula_of(f, name, "r", "Particle", ("1", "2")) for f in custom]
    more = [np.array([f.getParticleParameters(k) for k in range(n)], float).reshape(n, -1) for f in custom]
    table, kinds = np.unique(np.concatenate([lj, *more], axis=1), axis=0, return_inverse=True)
    if len(table) > MAX_TYPES:
        raise AtcError(f"{name}: {len(table)} kinds of particles by their pair parameters: supported are {MAX_TYPES}")
    out.kinds, out.exclusions = kinds.reshape(-1) + 1, pairs
    if plain and METHODS[plain[0].getNonbondedMethod()] in _MODES:
        out.charges, said = _neutral(out.charges)
        out.remarks += said
    make = _Maker(name, table, np.bincount(out.kinds - 1, minlength=len(table)), out.charges, switching)
    styles, reach = [], np.inf
    if plain:
        styles, fields, reach = make.plain(plain[0])
        out.terms += fields
    at = 2
    for f, (formula, names) in zip(custom, formulas):
        styles.append(make.by_formula(f, formula, names, table[:, at : at + len(names)]))
        at += len(names)
    out.periodic = make.periodic
    out.tail = make.tail
    styles = [s for s in styles if s is not None]
    if styles:
        special = ExcludedPairs() if len(pairs) else None
        out.terms.insert(0, Pairs(styles, len(table), special, kinds=KIND))
    keep = np.ones(len(pairs), bool) if np.isfinite(reach) else rows.any(axis=1)
    if keep.any():
        out.terms.append(Exceptions(pairs[keep], rows[keep], reach))
    return out


def _neutral(charges):
    """Charges that add up to nothing, where what they add up to is the last digit of a file, and a word about it."""
    total = float(charges.sum())
    if not 0.0 < abs(total) <= DIGIT * len(charges):
        return charges, []
    text = f"the charges add up to {total:.3g} e, which is taken off all of them evenly"
    return charges - total / len(charges), [text] if abs(total) > 1e-9 * len(charges) else []


def _refuse_parts(force, name):
    if force.getNumParticleParameterOffsets() or force.getNumExceptionParameterOffsets():
        raise AtcError(
            f"{name}: NonbondedForce: parameter offsets (charges that depend on a global parameter) are not supported"
        )
    if not force.getIncludeDirectSpace():
        raise AtcError(f"{name}: NonbondedForce without its direct space is no model of its own: not supported")


def _codes(pairs, n):
    p = np.sort(np.asarray(pairs, np.int64).reshape(-1, 2), axis=1)
    return np.unique(p[:, 0] * n + p[:, 1])


def _exclusions(force):
    return np.array([force.getExclusionParticles(k) for k in range(force.getNumExclusions())], np.int64).reshape(-1, 2)


def _exceptions(force):
    """(m, 2) pairs and (m, 3) C q q′, A, B of them, internal."""
    rows = [force.getExceptionParameters(k) for k in range(force.getNumExceptions())]
    if not rows:
        return np.zeros((0, 2), np.int64), np.zeros((0, 3))
    qq, s, e = np.array([[_number(v) for v in r[2:]] for r in rows]).T
    s, e = s * OPENMM.length, e * OPENMM.energy
    return np.array([r[:2] for r in rows], np.int64), np.stack([_C * qq, 4 * e * s**12, 4 * e * s**6], axis=1)


class _Maker:
    """Styles for the rows of one table.

    table : (t, 2 + ..) sigma, epsilon and more of each row, nm and kJ/mol. count : (t,) particles of each
    """

    def __init__(self, name, table, count, charges, switching):
        self.name, self.count, self.charges, self.switching = name, count, charges, switching
        self.n_types, self.periodic, self.tail = len(table), None, 0.0
        sigma, epsilon = table[:, 0] * OPENMM.length, table[:, 1] * OPENMM.energy
        s = self._full(0.5 * (sigma[:, None] + sigma))
        e = self._full(np.sqrt(epsilon[:, None] * epsilon))
        self.A, self.B = 4 * e * s**12, 4 * e * s**6
        root = 2.0 * np.sqrt(epsilon) * sigma**3
        self.geometric = self._full(root[:, None] * root)
        self.e, self.s = e, s

    def _full(self, values):
        """Of types from 1."""
        out = np.zeros((self.n_types + 1, self.n_types + 1))
        out[1:, 1:] = values
        return out

    def _says(self, periodic: bool, what: str):
        if self.periodic not in (None, periodic):
            raise AtcError(f"{self.name}: {what} is {'' if periodic else 'not '}periodic, unlike the other Forces")
        self.periodic = periodic

    def plain(self, force):
        """(pair styles, field terms, how far excluded pairs may be apart) of the NonbondedForce."""
        method = METHODS[force.getNonbondedMethod()]
        self._says(method in _PERIODIC, "NonbondedForce")
        rc = _number(force.getCutoffDistance()) * OPENMM.length
        if method == "NoCutoff":
            rc = ENDLESS * OPENMM.length
        cut = self._full(np.full((self.n_types, self.n_types), rc))
        styles, fields, reach = [], [], np.inf
        if self.B.any():
            lj, modes = self._lj(force, method, cut, rc)
            styles += lj
            fields += modes
            reach = rc if modes else reach
        if self.charges.any():
            if method == "NoCutoff":
                style = CoulombCut.internal(cut)
                style.constant = _C
            elif method.startswith("Cutoff"):
                eps = force.getReactionFieldDielectric()
                k = (eps - 1.0) / ((2.0 * eps + 1.0) * rc**3)
                style = ReactionField.internal(np.full_like(cut, k), np.full_like(cut, 1.0 / rc + k * rc * rc), cut)
                style.constant = _C
            else:
                split = Split.of(rc, _C, ACCURACY)
                style, reach = CoulombLong(cut > 0, split), rc
                style.run_table = 0
                fields.insert(0, LongRangeCoulomb(split, run=self._accuracy(force, method)))
            styles.append(style)
        return styles, fields, reach

    def _accuracy(self, force, method):
        """Of the run: OpenMM's tolerance is relative to the forces, here those of two rms charges at 1 Å."""
        tolerance = _number(force.getEwaldErrorTolerance())
        return RunAccuracy(method, tolerance, tolerance * _C * float((self.charges**2).mean()))

    def _lj(self, force, method, cut, rc):
        switch = force.getUseSwitchingFunction() and method != "NoCutoff"
        rs = _number(force.getSwitchingDistance()) * OPENMM.length
        if method == "LJPME":
            split = DispersionSplit.of(rc)
            near = LennardJonesPowers.internal(self.A, self.B - self.geometric, cut, shift=True)
            far = LennardJonesLong(np.zeros_like(cut), self.geometric, cut, split)
            return [near, far], [LongRangeDispersion(split, self.geometric, kinds=KIND)]
        style = self._ended(self.A, self.B, cut, rs if switch else None)
        if force.getUseDispersionCorrection() and method in _PERIODIC and self._as_openmm:
            self._add_tail(self._lennard_jones, rc, rs if switch else None)
        return [style], []

    def _ended(self, A, B, cut, switch):
        """A/r¹² − B/r⁶ as it ends at the cutoff."""
        if switch is None:
            if not self._as_openmm:
                raise AtcError(
                    f"{self.name}: switching {self.switching!r} needs switch, where it begins (the System has none)"
                )
            return LennardJonesPowers.internal(A, B, cut)
        return SWITCHED[self.switching or "potential-switch"].internal(A, B, np.full_like(cut, switch), cut)

    @property
    def _as_openmm(self) -> bool:
        return self.switching in (None, "potential-switch")

    def _lennard_jones(self, r):
        """(t, t) energies at a distance."""
        return (self.A / r**12 - self.B / r**6)[1:, 1:]

    def _add_tail(self, energy, rc, switch):
        """2π N² ∫ r² <U − what is left of it> dr, the mean over all pairs of particles as OpenMM counts them (each with
        itself, too): the dispersion correction times the volume. energy : function r → (t, t)"""
        t, w = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * (1.0 + t)
        value = sum(0.5 * wk / rc * energy(rc / x) * (rc / x) ** 4 for x, wk in zip(half, w))  # x = r_c/r
        if switch is not None:
            span = rc - switch
            for x, wk in zip(half, w):
                r = switch + span * x
                value = value + 0.5 * wk * span * energy(r) * r * r * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        n = self.count.sum()
        pairs = self.count[:, None] * self.count / 2.0 + np.diag(self.count / 2.0)
        self.tail += 2.0 * np.pi * n * n * float((pairs * value).sum()) / (0.5 * n * (n + 1))

    def by_formula(self, force, formula, names, values):
        """The style of a CustomNonbondedForce."""
        method = ("NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic")[force.getNonbondedMethod()]
        self._says(method == "CutoffPeriodic", "CustomNonbondedForce")
        rc = (ENDLESS if method == "NoCutoff" else _number(force.getCutoffDistance())) * OPENMM.length
        switch = None
        if force.getUseSwitchingFunction() and method != "NoCutoff":
            switch = _number(force.getSwitchingDistance()) * OPENMM.length
        i, j = (a.ravel() for a in np.indices((self.n_types, self.n_types)))
        pairs = {f"{n}{k}": values[at, c] for c, n in enumerate(names) for k, at in ((1, i), (2, j))}
        by_row = {n: np.concatenate([[0.0], values[:, c]]) for c, n in enumerate(names)}
        style = FormulaPairs(formula, by_row, self.n_types, rc, switch)
        if force.getUseLongRangeCorrection() and self._as_openmm and method == "CutoffPeriodic":
            bare = FormulaPairs(formula, by_row, self.n_types, rc)
            self._add_tail(
                lambda r: bare.at(i + 1, j + 1, np.full(i.shape, r))[0].reshape(self.n_types, -1), rc, switch
            )
        powers = powers_of(formula, pairs)
        if powers is None:
            if switch is not None and not self._as_openmm:
                raise AtcError(
                    f"{self.name}: switching {self.switching!r} goes with Lennard-Jones, not with the formula "
                    f"{force.getEnergyFunction()!r}"
                )
            return style
        factor = OPENMM.energy * OPENMM.length**12, OPENMM.energy * OPENMM.length**6
        A, B = (self._full(p.reshape(self.n_types, -1) * f) for p, f in zip(powers, factor))
        if not (A.any() or B.any()):
            return None
        cut = self._full(np.full((self.n_types, self.n_types), rc))
        return self._ended(A, B, cut, switch)
