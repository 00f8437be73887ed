"""OpenMM's Custom forces: energies as formulas, with numbers for each particle, bond, angle or torsion, and tables."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, replace

import numpy as np

from ...errors import AtcError
from ...units import units
from ..bonded.lepton import LeptonAngle, LeptonBond, LeptonTorsion
from ..bonded.topology import SharedTerm
from ..lepton import LeptonFormula
from ..pairs.pairs import PairStyle

#: OpenMM's units: nm, kJ/mol, e, amu, ps.
OPENMM = replace(units("mdanalysis"), length=10.0 * units("mdanalysis").length)
#: Functions that make a formula another one at another distance.
_PIECES = {"step", "delta", "select", "min", "max", "abs", "floor", "ceil"}
#: How far a formula may be from A/r¹² − B/r⁶ to be it: rounding.
_SAME = 1e-12


class Table:
    """A tabulated function of OpenMM, with its derivative: Discrete1D and 2D, Continuous1D."""

    def __init__(self, function, where: str):
        kind = type(function).__name__
        p = function.getFunctionParameters()
        if kind == "Discrete1DFunction":
            self.values, self.spline = np.array(p[0], float)[:, None], None
        elif kind == "Discrete2DFunction":
            self.values, self.spline = np.array(p[2], float).reshape(p[1], p[0]).T, None
        elif kind == "Continuous1DFunction" and not function.getPeriodic():
            self.values = np.array(p[0], float)
            self.low, self.high = (_number(v) for v in p[1:3])
            self.spline = True
        else:
            raise AtcError(f"{where}: the table {kind} is not supported: expected Discrete1D, Discrete2D, Continuous1D")
        self.arguments = 2 if kind == "Discrete2DFunction" else 1

    def __call__(self, *arguments):
        """Value and slope of arguments (x, slope of x)."""
        if self.spline:
            from scipy.interpolate import CubicSpline

            x, dx = arguments[0]
            f = CubicSpline(np.linspace(self.low, self.high, len(self.values)), self.values, bc_type="natural")
            x = np.asarray(x, float)
            inside = (x >= self.low) & (x <= self.high)
            at = np.clip(x, self.low, self.high)
            return np.where(inside, f(at), 0.0), np.where(inside, f(at, 1), 0.0) * dx
        places = (np.rint(np.asarray(x, float)) for x, _ in arguments)
        index = [np.clip(x, 0, n - 1).astype(int) for x, n in zip(places, self.values.shape)]
        return self.values[tuple(index) if len(index) == 2 else (index[0], 0)], 0.0


def _number(value) -> float:
    """A number, or a Quantity of OpenMM in its own unit system (nm, ps, amu, kJ/mol, e, radian)."""
    u = getattr(value, "unit", None)
    if u is None:
        return float(value)
    known = _FACTORS.get(id(u))
    if known is None:
        from openmm import unit

        _FACTORS[id(u)] = known = u, float((1.0 * u).value_in_unit_system(unit.md_unit_system))
    return float(value._value) * known[1]


#: {id: (unit, its size)} of units that were met: there are many numbers, and few units.
_FACTORS: dict[int, tuple] = {}


class SystemFormula(LeptonFormula):
    """A formula of a Force.

    variables : names of its parameters. tables : {name: `Table`}. constants : {name: value} of global parameters
    of : the name of its own variable
    """

    def __init__(self, text, variables=(), tables=None, constants=None, of: str = "r"):
        self.tables = dict(tables or {})
        self.constants = dict(constants or {})
        if of != "r":
            # The language calls its variable r: an r of the Force's own makes room.
            text = re.sub(rf"\b{of}\b", "r", re.sub(r"\br\b", "r_own", text))
        super().__init__(text, (*variables, *self.constants))
        self.variables = tuple(v for v in self.variables if v not in self.constants)

    def __call__(self, r, **others):
        return super().__call__(r, **{**self.constants, **others})

    def _function(self, name, arguments):
        table = self.tables.get(name)
        if table is None:
            return super()._function(name, arguments)
        if len(arguments) != table.arguments:
            raise ValueError(f"{name}() takes {table.arguments} argument(s), got {len(arguments)}")
        return table(*arguments)

    @property
    def functions(self) -> set:
        trees = [self.tree, *self.definitions.values()]
        calls = (n.func for t in trees for n in ast.walk(t) if isinstance(n, ast.Call))
        return {f.id for f in calls if isinstance(f, ast.Name)}


def powers_of(formula: SystemFormula, pairs) -> tuple[np.ndarray, np.ndarray] | None:
    """(A, B), all (p,), if the formula is A/r¹² − B/r⁶ for every pair of types, in nm and kJ/mol; else None.

    pairs : {variable: (p,) values}
    """
    if formula.functions & _PIECES:
        return None
    r = np.linspace(0.1, 1.5, 41)
    with np.errstate(all="ignore"):
        U = formula(r[:, None] + 0.0 * next(iter(pairs.values()), np.zeros(1)), **pairs)[0]
        f = U * r[:, None] ** 12
        B = (f[0] - f[-1]) / (r[-1] ** 6 - r[0] ** 6)
        A = f[0] + B * r[0] ** 6
        s6 = r[:, None] ** -6
        off = np.abs(U - (A * s6 - B) * s6)
    return (A, B) if (off <= _SAME * (np.abs(A) * s6 + np.abs(B)) * s6).all() else None


class FormulaPairs(PairStyle):
    """U(d) by a formula of the distance and numbers of both atoms, switched off if `switch` is given.

    Parameters
    ----------
    formula : `SystemFormula` of r [nm] in kJ/mol, with variables name1, name2
    values : {name: (n_types + 1,)} numbers by type
    cutoff, switch : internal; switch None: the energy ends as it is
    """

    name = "formula"

    def __init__(self, formula, values, n_types, cutoff, switch=None):
        self.formula, self.values, self.switch, self.end = formula, values, switch, cutoff
        on = np.zeros((n_types + 1, n_types + 1))
        on[1:, 1:] = cutoff
        self._set(on)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        near = d2 < self.end**2
        if len(weights):
            near &= weights != 0.0
        b = np.flatnonzero(near)
        d = np.sqrt(d2[b])
        w = weights[b] if len(weights) else 1.0
        u, du = self.at(types[i[b]], types[j[b]], d)
        U[b] += w * u
        G[b] += w * du / d

    def at(self, ti, tj, d):
        """U and dU/dd, internal."""
        numbers = {f"{name}{k}": v[t] for name, v in self.values.items() for k, t in ((1, ti), (2, tj))}
        with np.errstate(all="ignore"):
            u, du = self.formula(d / OPENMM.length, **numbers)
            u, du = u * OPENMM.energy, du * (OPENMM.energy / OPENMM.length)
        if self.switch is not None:
            t = np.maximum((d - self.switch) / (self.end - self.switch), 0.0)
            s = 1.0 - t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
            ds = -30.0 * t**2 * (1.0 - t) ** 2 / (self.end - self.switch)
            u, du = s * u, s * du + ds * u
        return u, du


@dataclass(frozen=True)
class _Bound:
    """A formula of one variable, with the numbers of one type."""

    formula: SystemFormula
    numbers: dict

    def __call__(self, x):
        x = np.asarray(x, float)
        return self.formula(x, **{k: np.full(x.shape, v) for k, v in self.numbers.items()})


class _Formulas:
    """What bonds, angles and torsions by formula share.

    formula : `SystemFormula` in nm, radians, kJ/mol
    numbers : {name: (n_types,)} of its parameters, for types from 1
    """

    has_reference = False
    name = "formula"

    def __init__(self, formula, numbers, n_types):
        self.units, self.formula = OPENMM, formula
        self.numbers = {k: np.concatenate([[0.0], v]) for k, v in numbers.items()}
        bound = {t: _Bound(formula, {k: float(v[t]) for k, v in self.numbers.items()}) for t in range(1, n_types + 1)}
        self._set({t: (0.0, f) for t, f in bound.items()})
        if isinstance(self, SharedTerm):
            self.share("equal")

    def values(self, x, types, size):
        with np.errstate(all="ignore"):
            u, du = self.formula(x / size, **{k: v[types] for k, v in self.numbers.items()})
        return u * self.units.energy, du * (self.units.energy / size)


class FormulaBond(_Formulas, LeptonBond, style=False):
    """U(d) of bonds."""


class FormulaAngle(_Formulas, LeptonAngle, style=False):
    """U(θ) of angles; sin θ is clamped at 0.001."""


class FormulaTorsion(_Formulas, LeptonTorsion, style=False):
    """U(φ) of torsions, −π < φ ≤ π."""

    @staticmethod
    def mirrored(phi):
        return -phi


class FormulaLaw:
    """U(φ) and its slope, internal, of types with numbers, for `chiral.AcrossTorsion`."""

    def __init__(self, formula, numbers):
        self.formula, self.numbers = formula, numbers

    def __call__(self, phi, types):
        u, du = self.formula(phi, **{k: v[types] for k, v in self.numbers.items()})
        return u * OPENMM.energy, du * OPENMM.energy
