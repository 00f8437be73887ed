"""Bonds, angles and torsions whose energy is a formula, style by style against LAMMPS; where they have no energy; objects and lines."""

import numpy as np
import pytest
from bonded_systems import CELLS, NO_BOND, agrees, melt

import atc
from atc.errors import AtcError, AtcWarning

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


@pytest.mark.parametrize("cell", CELLS)
def test_nanotubes_with_coefficients_of_their_own(cell):
    lines = "bond_style mesocnt\nbond_coeff 1 custom 3 1.1\nbond_coeff 2 custom 2 0.9\n"
    lines += "angle_style mesocnt\nangle_coeff 1 buckling custom 3 2 60\nangle_coeff 2 harmonic custom 1.5\n"
    agrees(melt(cell, unit_style="metal"), lines)
    for wrong, says in (
        ("bond_style mesocnt\nbond_coeff 1 C 10 10 20", "chirality"),
        ("angle_style mesocnt\nangle_coeff 1 custom 3", "harmonic or buckling"),
    ):
        with pytest.raises(AtcError, match=f"line 2: .*{says}"):
            atc.potential(wrong, "metal")


PAIRS = "pair_style lj/cut 1.3\npair_modify shift yes\npair_coeff * * 1.0 0.9\n"
QUARTIC = "bond_style quartic\nbond_coeff 1 1200 -0.55 0.25 1.3 34.6878\nbond_coeff 2 1100 -0.5 0.2 1.04 30\n"


@pytest.mark.parametrize("cell", CELLS)
def test_quartic_bonds_take_the_pair_interaction_away_until_they_break(cell):
    config = melt(cell)
    config.atom_style = "angle"
    d = agrees(config, QUARTIC, pair="special_bonds lj/coul 1 1 1\n" + PAIRS)
    lengths = np.sqrt((d.bonds.r_bc[-len(config.bonds) :] ** 2).sum(axis=1))
    broken = np.count_nonzero(lengths > np.where(config.bond_types == 1, 1.3, 1.04))
    assert broken > 10 and [n for what, n in d.notes.items() if "broken" in what] == [broken]
    with pytest.raises(AtcError, match="quartic needs 'special_bonds lj/coul 1 1 1'"):
        atc.potential(PAIRS + QUARTIC, "lj")


def test_special_bonds_of_their_own_weigh_the_pair_interaction():
    """Pairs two bonds apart are listed as bonds of type 2: 0.7 of their Lennard-Jones, 0.3 of their Coulomb interaction (LAMMPS's order)."""
    config = melt()
    far = config.angles[:, [0, 2]]
    config.bonds = np.concatenate([config.bonds, far])
    config.bond_types = np.concatenate([np.ones(len(config.bond_types), int), np.full(len(far), 2)])
    config.charges = np.random.default_rng(3).uniform(-1, 1, len(config.positions))
    config.atom_style = "full"
    pair = "special_bonds lj/coul 0 1 1\npair_style lj/cut/coul/cut 2.5\npair_coeff * * 1.0 0.3\n"
    lines = "bond_style hybrid harmonic special\nbond_coeff 1 harmonic 30 1.0\nbond_coeff 2 special 0.3 0.7\n"
    with pytest.warns(AtcWarning, match="first weight to the Coulomb"):
        agrees(config, lines, pair=pair)
    with pytest.raises(AtcError, match="weights of 1-2 neighbours to be 0"):
        atc.potential(pair.replace("0 1 1", "1 1 1") + lines, "lj")
    with pytest.raises(AtcError, match="there is none"):
        atc.potential(lines, "lj")


ANGLES = {
    "quartic": "1 100 3 -2 1\nangle_coeff 2 180 2 1 -0.5",
    "mm3": "1 3 100\nangle_coeff 2 2 170",
    "fourier": "1 3 0.2 0.5 -0.7\nangle_coeff 2 2 1 -1 0.3",
    "fourier/simple": "1 3 0.5 3\nangle_coeff 2 2 -0.4 2.5",
    "cosine/periodic": "1 3 1 4\nangle_coeff 2 2 -1 3",
    "cosine/squared/restricted": "1 3 100\nangle_coeff 2 0.2 180",
    "mwlc": "1 25 1 10 1.3\nangle_coeff 2 3 1 0.5 0.7",
    "cosine/shift": "1 3 100\nangle_coeff 2 2 180",
    "cosine/shift/exp": "1 3 100 2\nangle_coeff 2 2 120 -0.0005",
    "gaussian": "1 1.3 2 1.0 0.4 100 0.5 0.9 130\nangle_coeff 2 0.7 1 0.3 0.8 150",
    "class2": "1 100 3 -2 1\nangle_coeff 1 bb 2 1.1 0.9\nangle_coeff 1 ba 0.7 0.4 1.1 0.9\n"
    "angle_coeff 2 110 2 0.3 0.1\nangle_coeff 2 ba 0.2 0.5 1.0 0.95\nangle_coeff * bb -1 0.9 1.05",
    "class2/p6": "* 100 3 -2 1 0.5 -0.3\nangle_coeff * bb 2 1.1 0.9\nangle_coeff * ba 0.7 0.4 1.1 0.9",
    "cross": "1 2 0.7 0.4 1.1 0.9 100\nangle_coeff 2 1 -0.2 0.5 1.0 0.9 120",
}


def angles(style):
    return f"angle_style {style}\nangle_coeff {ANGLES[style]}\n"


FAULTY = pytest.mark.filterwarnings("ignore:angle_style fourier/simple:atc.errors.AtcWarning")


@FAULTY
@pytest.mark.parametrize("style", ANGLES)
@pytest.mark.parametrize("cell", CELLS)
def test_angles_equal_lammps(style, cell):
    agrees(melt(cell), NO_BOND + angles(style))


@FAULTY
@pytest.mark.parametrize("style", ANGLES)
def test_angles_in_other_units(style):
    # Temperatures at which LAMMPS's own exponentials do not underflow.
    lines = angles(style).replace(" 1.3 2 1.0", " 300 2 1.0").replace("1 25 1 10 1.3", "1 25 1 10 900").replace("0.5 0.7", "0.5 250")
    agrees(melt(unit_style="real"), NO_BOND + lines)
    agrees(melt(unit_style="nano"), NO_BOND + lines)
