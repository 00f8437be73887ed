"""Bonded Forces of OpenMM as bonds, angles and torsions of this package."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ..bonded.angle import HarmonicAngle
from ..bonded.bond import HarmonicBond
from ..bonded.chiral import AcrossTorsion, CorrectionMaps, CosineLaw
from ..bonded.cmap import handedness
from ..bonded.dihedral import _MIRROR, HarmonicTorsion, NHarmonicTorsion
from .atoms import listed
from .formulas import OPENMM, FormulaAngle, FormulaBond, FormulaLaw, FormulaTorsion, SystemFormula, Table, _number

#: Phases this near 0 or π (radians) are meant to be that: files of AMBER have 3.141594.
PHASE = 1e-5
_WITH = ": with chiral = true it is taken, by forces across bonds, and the stress is symmetric over a molecule only"


def _types(rows):
    """Types from 1 of parameter rows (m, k), and the row of each type."""
    values, types = np.unique(np.asarray(rows, float), axis=0, return_inverse=True)
    return types.reshape(-1) + 1, values


def _harmonic(rows, make):
    """½k(x − x0)² of rows (atoms .., x0, k). make : {type: (½k, x0)} → term"""
    numbers = np.array([[_number(r[-1]), _number(r[-2])] for r in rows]).reshape(-1, 2)
    on = numbers[:, 0] != 0.0
    if not on.any():
        return []
    types, values = _types(numbers[on])
    term = make({t: (0.5 * k, x0) for t, (k, x0) in enumerate(values, 1)})
    return [listed(term, np.array([r[:-2] for r in rows])[on], types)]


def harmonic_bonds(force, name, chiral=False):
    """½k(r − r0)²"""
    rows = [force.getBondParameters(k) for k in range(force.getNumBonds())]
    return _harmonic(rows, lambda numbers: HarmonicBond(numbers, units=OPENMM))


def harmonic_angles(force, name, chiral=False):
    """½k(θ − θ0)²"""
    rows = [force.getAngleParameters(k) for k in range(force.getNumAngles())]
    in_degrees = lambda numbers: {t: (k, np.degrees(theta)) for t, (k, theta) in numbers.items()}  # noqa: E731
    return _harmonic(rows, lambda numbers: HarmonicAngle(in_degrees(numbers), units=OPENMM))


def periodic_torsions(force, name, chiral=False):
    """k[1 + cos(nφ − φ0)], φ0 = 0 or 180°; others only as `chiral`."""
    atoms, numbers, others = [], [], []
    for k in range(force.getNumTorsions()):
        *four, n, phase, K = force.getTorsionParameters(k)
        phase, K = _number(phase) % (2 * np.pi), _number(K)
        if K == 0.0:
            continue
        off = min(phase, 2 * np.pi - phase), abs(phase - np.pi)
        if min(off) > PHASE and chiral:
            others.append((four, (K * OPENMM.energy, n, phase)))
            continue
        if min(off) > PHASE:
            raise AtcError(
                f"{name}: PeriodicTorsionForce: torsion {k} of particles {' '.join(map(str, four))} has the phase "
                f"{np.degrees(phase):.6g} degrees, neither 0 nor 180: {_MIRROR}{_WITH}"
            )
        atoms.append(four)
        numbers.append((K, 1.0 if off[0] <= PHASE else -1.0, n))
    out = []
    if atoms:
        types, values = _types(numbers)
        out.append(listed(HarmonicTorsion(dict(enumerate(map(tuple, values), 1)), units=OPENMM), atoms, types))
    if others:
        types, values = _types([row for _, row in others])
        law = CosineLaw(np.concatenate([np.zeros((1, 3)), values]))
        out.append(listed(AcrossTorsion(law, "chiral torsion"), [four for four, _ in others], types))
    return out


def rb_torsions(force, name, chiral=False):
    """Σ C_n cosⁿ(φ − 180°): the powers of −cos φ."""
    rows = [force.getTorsionParameters(k) for k in range(force.getNumTorsions())]
    numbers = np.array([[_number(c) * (-1) ** n for n, c in enumerate(r[4:])] for r in rows]).reshape(len(rows), -1)
    on = numbers.any(axis=1)
    if not on.any():
        return []
    types, values = _types(numbers[on])
    term = NHarmonicTorsion(dict(enumerate(values, 1)), units=OPENMM)
    return [listed(term, np.array([r[:4] for r in rows])[on], types)]


def correction_maps(force, name, chiral=False):
    """U(φ, ψ), as `chiral` only; nothing where no map in use has energy."""
    rows = [force.getTorsionParameters(k) for k in range(force.getNumTorsions())]
    maps = {}
    for t in sorted({r[0] for r in rows}):
        size, energy = force.getMapParameters(t)
        # OpenMM's first angle runs fastest.
        maps[t] = np.array([_number(e) for e in energy]).reshape(size, size).T
    rows = [r for r in rows if maps[r[0]].any()]
    if not rows:
        return []
    if not chiral:
        t = rows[0][0]
        count, differs = sum(r[0] == t for r in rows), handedness(maps[t])
        why = (
            f"its energy over (phi, psi) differs from that of the mirror image by up to {differs:.4g} kJ/mol, so it is "
            "not a function of distances and has no forces along bonds"
        )
        if differs <= 1e-10 * np.ptp(maps[t]):
            why = "maps that are the same for the mirror image are not done yet"
        raise AtcError(f"{name}: CMAPTorsionForce: {count} torsion pairs use map {t}: {why}{_WITH}")
    for r in rows:
        if list(r[2:5]) != list(r[5:8]):
            raise AtcError(
                f"{name}: CMAPTorsionForce: torsions of particles {r[1:5]} and {r[5:9]} do not follow each other"
            )
    used = sorted({r[0] for r in rows})
    term = CorrectionMaps([maps[t] * OPENMM.energy for t in used])
    return [listed(term, [[*r[1:5], r[8]] for r in rows], [used.index(r[0]) + 1 for r in rows])]


def global_parameters(force) -> dict[str, float]:
    """{name: default} of a Custom force."""
    return {
        force.getGlobalParameterName(k): _number(force.getGlobalParameterDefaultValue(k))
        for k in range(force.getNumGlobalParameters())
    }


def formula_of(force, name, variable: str, per: str, suffixes=("",)):
    """(`SystemFormula`, names of the parameters) of a Custom force; `per`: what has them ("Bond", "Particle" ..)."""
    kind = type(force).__name__
    count = getattr(force, f"getNumPer{per}Parameters")()
    names = [getattr(force, f"getPer{per}ParameterName")(k) for k in range(count)]
    constants = global_parameters(force)
    tables = {}
    if hasattr(force, "getNumTabulatedFunctions"):
        tables = {
            force.getTabulatedFunctionName(k): Table(force.getTabulatedFunction(k), f"{name}: {kind}")
            for k in range(force.getNumTabulatedFunctions())
        }
    text = force.getEnergyFunction()
    try:
        return SystemFormula(text, [n + s for n in names for s in suffixes], tables, constants, of=variable), names
    except ValueError as e:
        raise AtcError(f"{name}: {kind}: the formula {text!r}: {e}") from None


def _custom(force, name, cls, variable, per, width):
    """The term of a Custom force by formula; `per`: what it is of ("Bond", "Angle", "Torsion"), with so many atoms."""
    if not getattr(force, f"getNum{per}s")():
        return []
    formula, types, values, names, atoms = _parts(force, name, variable, per, width)
    try:
        term = cls(formula, {n: values[:, k] for k, n in enumerate(names)}, len(values))
    except AtcError as e:
        raise AtcError(f"{name}: {type(force).__name__}: {force.getEnergyFunction()!r}: {e}") from None
    if term.refused and set(term.refused) & set(np.unique(types)):
        t = min(term.refused)
        raise AtcError(f"{name}: {type(force).__name__}: {force.getEnergyFunction()!r}: {term.refused[t]}")
    return [listed(term, atoms, types)]


def _parts(force, name, variable, per, width):
    """The formula of a Custom force, types and their numbers with names, and the atoms of its terms."""
    formula, names = formula_of(force, name, variable, per)
    rows = [getattr(force, f"get{per}Parameters")(k) for k in range(getattr(force, f"getNum{per}s")())]
    types, values = _types(np.array([[_number(v) for v in r[width]] for r in rows]).reshape(len(rows), -1))
    return formula, types, values, names, [r[:width] for r in rows]


def custom_bonds(force, name, chiral=False):
    """By formula."""
    return _custom(force, name, FormulaBond, "r", "Bond", 2)


def custom_angles(force, name, chiral=False):
    """By formula."""
    return _custom(force, name, FormulaAngle, "theta", "Angle", 3)


def custom_torsions(force, name, chiral=False):
    """By formula; those that are not the same for φ and −φ only as `chiral`."""
    try:
        return _custom(force, name, FormulaTorsion, "theta", "Torsion", 4)
    except AtcError as e:
        if "phi and -phi" not in str(e):
            raise
        if not chiral:
            raise AtcError(f"{e}{_WITH}") from None
    formula, types, values, names, atoms = _parts(force, name, "theta", "Torsion", 4)
    law = FormulaLaw(formula, {n: np.concatenate([[0.0], values[:, k]]) for k, n in enumerate(names)})
    return [listed(AcrossTorsion(law, "chiral torsion by formula"), atoms, types)]


#: Names of Forces and what makes terms of them.
BONDED = {
    "HarmonicBondForce": harmonic_bonds, "HarmonicAngleForce": harmonic_angles,
    "PeriodicTorsionForce": periodic_torsions, "RBTorsionForce": rb_torsions, "CMAPTorsionForce": correction_maps,
    "CustomBondForce": custom_bonds, "CustomAngleForce": custom_angles, "CustomTorsionForce": custom_torsions,
}  # fmt: skip
