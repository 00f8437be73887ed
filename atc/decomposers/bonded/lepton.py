"""Bonds, angles and torsions whose energy is a formula that the user writes (LAMMPS ``lepton``); see
`atc.decomposers.lepton` for the language."""

from __future__ import annotations

import re

import numpy as np

from ...errors import AtcError
from ...units import units as system
from ..lepton import LeptonFormula
from ..registry import angle_style, bond_style, dihedral_style
from .angle import AngleStyle, over_sine
from .bond import BondStyle
from .dihedral import _MIRROR
from .dihedral_curves import CurveTorsion
from .topology import first_true

#: how far from even in φ a torsion's formula may be, relative to the range of its values
_EVEN = 1e-10
#: the least sine that a torsion's slope is divided by: below it the ratio keeps its value
_PLANE = 1e-5


def formula_of(text: str, variable: str, units) -> LeptonFormula:
    """The formula of one variable of any name. Raises ValueError with what is wrong."""
    if variable != "r":
        # The language calls its variable r: an r of the user's own makes room.
        text = re.sub(rf"\b{variable}\b", "r", re.sub(r"\br\b", "r_own", text))
    return LeptonFormula(text, (), units)


class _Formulas:
    """What the three share: {type: (reference, formula)}; the energy is 0 at the reference where there is one.

    coeffs : {type: (reference, text)}, or {type: text} of torsions; references in LAMMPS's units (length, degrees)
    units, partition : as for other styles
    """

    name = "lepton"
    variable = "r"
    has_reference = True

    def __init__(self, coeffs, *, units="metal", partition="equal"):
        self.units = system(units)
        rows = {}
        for t, c in coeffs.items():
            reference, text = c if self.has_reference else (0.0, c)
            try:
                rows[int(t)] = (float(reference) * self.size(), formula_of(text, self.variable, self.units))
            except ValueError as e:
                raise AtcError(f"{self.kind} style lepton: the formula {text!r}: {e}") from None
        self._set(rows)
        if hasattr(self, "weights"):
            self.share(partition)

    def size(self) -> float:
        """The internal size of a reference's unit."""
        return np.pi / 180.0

    def _set(self, values, where=""):
        self.covered = frozenset(values)
        self.formulas = dict(values)

    def values(self, x, types, size: float):
        """U and dU/dx, all (m,), of coordinates x; `size` is the internal size of the formula's own unit of x."""
        U, slope = np.empty(len(x)), np.empty(len(x))
        with np.errstate(all="ignore"):
            for t in np.unique(types):
                mine = types == t
                reference, formula = self.formulas[int(t)]
                u, du = formula((x[mine] - reference) / size)
                U[mine] = u - (formula(np.zeros(1))[0][0] if self.has_reference else 0.0)
                slope[mine] = du
        return U * self.units.energy, slope * (self.units.energy / size)

    @classmethod
    def _build(cls, inp):
        inp.no_arguments()
        self = cls.__new__(cls)
        self.units = inp.units
        lead = 1 if cls.has_reference else 0

        def read(line):
            if len(line.words) != 1 + lead:
                what = f"the reference {'length' if inp.kind == 'bond' else 'angle'} and " if lead else ""
                raise inp.wrong(f"{inp.kind}_coeff of lepton takes {what}a formula in quotes", line)
            reference = inp.number(line.words[0], 1.0, "the reference", line) * self.size() if lead else 0.0
            try:
                return reference, formula_of(line.words[lead], cls.variable, inp.units)
            except ValueError as e:
                raise inp.error(f"{inp.command}: the formula {line.words[lead]!r}: {e}", line) from None

        self._set(inp.by_type(read), inp.where)
        return self


class LeptonBond(_Formulas, BondStyle):
    """U(d − r0) − U(0) as a formula of r (LAMMPS ``lepton``). coeffs: {type: (r0 [length], text)}."""

    def size(self):
        return self.units.length

    def add(self, types, d, U, G):
        U[:], slope = self.values(d, types, self.units.length)
        np.divide(slope, d, out=G, where=d > 0)
        return first_true(~np.isfinite(U + slope)), 0

    def refuse(self, t, d):
        return "where its formula has no finite value"


class LeptonAngle(_Formulas, AngleStyle):
    """U(θ − θ0) − U(0) as a formula of theta in radians (LAMMPS ``lepton``). coeffs: {type: (θ0 [degrees], text)}. sin
    θ is clamped at 0.001."""

    variable = "theta"

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        U[:], slope = self.values(np.arctan2(sin, cos), types, 1.0)
        U_c[:], clamped = over_sine(-slope, sin)
        return clamped


class LeptonTorsion(_Formulas, CurveTorsion):
    """U(φ) as a formula of phi in radians, 0 ≤ φ < 2π (LAMMPS ``lepton``). coeffs: {type: text}.

    Formulas that are not the same for φ and 2π − φ tell a chain from its mirror image: refused. In a plane where the
    formula has a slope the sine is clamped at 1e-5.
    """

    variable = "phi"
    has_reference = False

    @staticmethod
    def mirrored(phi):
        """The torsion angle of the mirror image."""
        return 2.0 * np.pi - phi

    def _set(self, values, where=""):
        super()._set(values, where)
        phi = np.concatenate([np.linspace(0.0, np.pi, 361)[1:-1], np.random.default_rng(0).uniform(0.0, np.pi, 200)])
        refused = {}
        with np.errstate(all="ignore"):
            for t, (_, formula) in values.items():
                (u, du), (v, dv) = formula(phi), formula(self.mirrored(phi))
                far = np.abs(u - v).max() > _EVEN * max(np.ptp(u), 1e-12 * np.abs(u).max(initial=0.0))
                if far or np.abs(du + dv).max() > 1e-8 * np.abs(du).max(initial=0.0):
                    refused[t] = f"its formula is not the same for phi and -phi: {_MIRROR}"
        self.keep_refusals(refused, where)

    def curve(self, cos, sin, types):
        phi = np.arctan2(sin, cos)
        U, _ = self.values(phi, types, 1.0)
        inside = np.clip(phi, _PLANE, np.pi - _PLANE)
        _, slope = self.values(inside, types, 1.0)
        return U, -slope / np.sin(inside)


for _register, _style in ((bond_style, LeptonBond), (angle_style, LeptonAngle), (dihedral_style, LeptonTorsion)):
    _register("lepton")(_style._build)
