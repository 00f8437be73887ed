"""Bonds, angles and torsions whose energy is a formula that the user writes (LAMMPS ``lepton``); see
`atc.decomposers.lepton` for the language."""

from __future__ import annotations

import re

import numpy as np

from ...errors import AtcError
from ..lepton import LeptonFormula
from .angle import AngleStyle
from .bond import BondStyle
from .dihedral import _MIRROR, CurveTorsion
from .topology import MirrorError

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
    """What the three share: {type: (reference, formula)}; the energy is 0 at the reference where there is one
    (unless LAMMPS's line says no_offset).

    coeffs : {type: (reference, text)}, or {type: text} of torsions; references in LAMMPS's units (length, degrees)
    units, partition : as for other styles
    """

    name = "lepton"
    variable = "r"
    has_reference = True
    #: whether the energy at the reference is taken off (LAMMPS's auto_offset)
    offset = True

    @classmethod
    def build(cls, inp):
        if inp.args not in ((), *(((word,) for word in ("auto_offset", "no_offset")) if cls.has_reference else ())):
            raise inp.wrong(
                f"{inp.command} takes {'auto_offset or no_offset' if cls.has_reference else 'no arguments'}"
            )
        self = cls._from_input(inp.by_type(lambda line: cls.read(inp, line)), inp)
        self.offset = inp.args != ("no_offset",)
        return self

    @classmethod
    def size(cls, u) -> float:
        """The internal size of a reference's unit."""
        return np.pi / 180.0

    def internal(self, coeffs):
        rows = {}
        for t, c in coeffs.items():
            reference, text = c if self.has_reference else (0.0, c)
            try:
                rows[int(t)] = float(reference) * self.size(self.units), formula_of(text, self.variable, self.units)
            except ValueError as e:
                raise AtcError(f"{self.kind} style lepton: the formula {text!r}: {e}") from None
        return rows

    @classmethod
    def read(cls, inp, line):
        *references, text = line.words or ("",)
        if not line.words or len(references) != cls.has_reference:
            what = f"the reference {'length' if inp.kind == 'bond' else 'angle'} and " if cls.has_reference else ""
            raise inp.wrong(f"{inp.kind}_coeff of lepton takes {what}a formula in quotes", line)
        reference = sum(inp.number(w, 1.0, "the reference", line) * cls.size(inp.units) for w in references)
        try:
            return reference, formula_of(text, cls.variable, inp.units)
        except ValueError as e:
            raise inp.error(f"{inp.command}: the formula {text!r}: {e}", line) from None

    def keep(self, rows):
        self.formulas = rows

    def values(self, x, types, size: float):
        """U and dU/dx, all (m,), of coordinates x; `size` is the internal size of the formula's own unit of x."""
        U, slope = np.empty(len(x)), np.empty(len(x))
        with np.errstate(all="ignore"):
            for t in np.unique(types):
                mine = types == t
                reference, formula = self.formulas[int(t)]
                u, du = formula((x[mine] - reference) / size)
                U[mine] = u - (formula(np.zeros(1))[0][0] if self.has_reference and self.offset else 0.0)
                slope[mine] = du
        return U * self.units.energy, slope * (self.units.energy / size)


class LeptonBond(_Formulas, BondStyle):
    """U(d − r0) − U(0) as a formula of r (LAMMPS ``lepton``). coeffs: {type: (r0 [length], text)}."""

    @classmethod
    def size(cls, u):
        return u.length

    def energies(self, types, d):
        return self.values(d, types, self.units.length)

    def refuse(self, t, d):
        return "where its formula has no finite value"


class LeptonAngle(_Formulas, AngleStyle):
    """U(θ − θ0) − U(0) as a formula of theta in radians (LAMMPS ``lepton``). coeffs: {type: (θ0 [degrees], text)}. sin
    θ is clamped at 0.001."""

    variable = "theta"

    def energies(self, types, a):
        U, slope = self.values(a.theta, types, 1.0)
        return U, a.over_sine(-slope)


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

    def row(self, reference, formula):
        phi = np.concatenate([np.linspace(0.0, np.pi, 361)[1:-1], np.random.default_rng(0).uniform(0.0, np.pi, 200)])
        with np.errstate(all="ignore"):
            (u, du), (v, dv) = formula(phi), formula(self.mirrored(phi))
            far = np.abs(u - v).max() > _EVEN * max(np.ptp(u), 1e-12 * np.abs(u).max(initial=0.0))
            if far or np.abs(du + dv).max() > 1e-8 * np.abs(du).max(initial=0.0):
                raise MirrorError(f"its formula is not the same for phi and -phi: {_MIRROR}")
        return reference, formula

    def curve(self, cos, sin, types, acc):
        phi = np.arctan2(sin, cos)
        U, _ = self.values(phi, types, 1.0)
        inside = np.clip(phi, _PLANE, np.pi - _PLANE)
        _, slope = self.values(inside, types, 1.0)
        return U, -slope / np.sin(inside)
