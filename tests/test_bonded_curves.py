"""Bonds, angles and torsions whose energy is a formula, style by style against LAMMPS; where they have no energy; objects and lines."""

import numpy as np
import pytest
from bonded_systems import CELLS, NO_BOND, agrees, melt
from decomposer_checks import sources_are_derivatives

import atc
from atc.errors import AtcError

BONDS = {
    "class2": "1 1.1 30 -20 10\nbond_coeff 2 0.9 50 -30 7",
    "gromos": "1 30 1.1\nbond_coeff 2 20 0.95",
    "nonlinear": "1 30 1.1 0.7\nbond_coeff 2 20 0.95 0.9",
    "harmonic/shift": "1 10 1.0 1.3\nbond_coeff 2 7 0.9 1.8",
    "harmonic/shift/cut": "1 10 1.0 1.3\nbond_coeff 2 7 0.9 1.02",
    "mm3": "1 30 1.1\nbond_coeff 2 20 0.95",
    "fene/nm": "1 30 1.5 1.3 1.1 12 6\nbond_coeff 2 20 1.6 0.8 0.95 9 6.5",
    "gaussian": "1 1.3 2 1.0 0.1 1.0 0.5 0.2 1.3\nbond_coeff 2 0.7 1 0.3 0.4 1.0",
}


def bonds(style):
    return f"bond_style {style}\nbond_coeff {BONDS[style]}\n"


@pytest.mark.parametrize("style", BONDS)
@pytest.mark.parametrize("cell", CELLS)
def test_bonds_equal_lammps(style, cell):
    agrees(melt(cell), bonds(style))


@pytest.mark.parametrize("style", BONDS)
def test_bonds_in_other_units(style):
    """Every coefficient's unit: real has kcal/mol, nano other lengths."""
    agrees(melt(unit_style="real"), bonds(style))
    agrees(melt(unit_style="nano"), bonds(style))
