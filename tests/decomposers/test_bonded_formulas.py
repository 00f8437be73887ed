"""Bonded styles of the user's own formulas, and the angle that takes its repulsion from a pair style, against
LAMMPS."""

import numpy as np
import pytest
from bonded_systems import CELLS, NO_BOND, agrees, melt
from decomposer_checks import agrees_with_lammps, sources_are_derivatives
from test_decomposers_dihedral import chain, chains, one

import atc
from atc.decomposers import LeptonAngle, LeptonBond, LeptonTorsion
from atc.errors import AtcError

BOND = 'bond_style lepton\nbond_coeff 1 1.1 "k*r^2 + k3*r^3; k3=-4*k; k=30"\nbond_coeff 2 0.9 "5*(1-exp(-2*r))^2 + 3"\n'
ANGLE = 'angle_style lepton\nangle_coeff 1 110 "k*theta^2; k=3"\nangle_coeff 2 120 "2*cos(theta) + 0.3*theta^4"\n'
TORSION = [
    'dihedral_coeff 1 "k*(1 + d*cos(n*phi)); k=1.3; d=-1; n=2"',
    'dihedral_coeff 2 "0.7*cos(phi)+0.3*(phi-3.141592653589793)^2"',
]
ZERO = ["pair_style zero 5.0 nocoeff", "pair_coeff * *"]


@pytest.mark.parametrize("cell", CELLS)
def test_formulas_agree_with_lammps(cell):
    agrees(melt(cell), BOND + ANGLE)
    agrees(melt(cell, unit_style="nano"), BOND + ANGLE)


@pytest.mark.parametrize("word", ["auto_offset", "no_offset"])
def test_energies_at_the_references(word):
    lines = BOND.replace("lepton\n", f"lepton {word}\n", 1) + ANGLE.replace("lepton\n", f"lepton {word}\n", 1)
    d = agrees(melt(), lines)
    same = d.energy == atc.potential(BOND + ANGLE, "lj").decompose(melt().frame()).energy
    assert same == (word == "auto_offset")


def test_torsion_formulas_agree_with_lammps():
    config = chains("tilted", n=12, types=2)
    lines = ["dihedral_style lepton", *TORSION]
    pot = atc.potential("\n".join(lines), units="real")
    agrees_with_lammps(pot, [*ZERO, *lines], config)
    sources_are_derivatives(pot, config.frame())
    at = pot.decompose(one(chain(0.0)))
    for o in 10.0 ** -np.arange(1, 16.0):
        up, down = (
            atc.potential(lines[0] + "\n" + TORSION[0], units="real").decompose(one(chain(s * o))) for s in (1, -1)
        )
        assert np.abs(up.forces_nc - at.forces_nc).max() <= 10 * o + 1e-12
        np.testing.assert_allclose(up.forces_nc[:, 2], -down.forces_nc[:, 2], rtol=0, atol=1e-12)


def test_formulas_that_are_refused():
    with pytest.raises(AtcError, match="line 1: bond_style lepton takes auto_offset or no_offset, got offset"):
        atc.potential('bond_style lepton offset\nbond_coeff 1 1.1 "r"', "real")
    with pytest.raises(AtcError, match="line 1: dihedral_style lepton takes no arguments, got no_offset"):
        atc.potential('dihedral_style lepton no_offset\ndihedral_coeff 1 "cos(phi)"', "real")
    with pytest.raises(
        AtcError, match="dihedral type 1 of style lepton: its formula is not the same for phi and -phi: .*mirror image"
    ):
        atc.potential('dihedral_style lepton\ndihedral_coeff 1 "3*(phi-1)^2"', "real")
    with pytest.raises(AtcError, match="line 2: bond_style lepton: the formula 'k\\*r': k is neither r nor defined"):
        atc.potential('bond_style lepton\nbond_coeff 1 1.1 "k*r"', "real")
    with pytest.raises(AtcError, match="k3 uses k, which is defined in front of it"):
        atc.potential('bond_style lepton\nbond_coeff 1 1.1 "k*r^2 + k3*r^3; k=30; k3=-4*k"', "real")
    with pytest.raises(
        AtcError, match="line 2: bond_coeff of lepton takes the reference length and a formula in quotes"
    ):
        atc.potential('bond_style lepton\nbond_coeff 1 "r^2"', "real")
    with pytest.raises(AtcError, match=r"style lepton\) is .* long, where its formula has no finite value"):
        atc.potential('bond_style lepton\nbond_coeff * 1.0 "log(r)"', "lj").decompose(melt().frame())


def test_objects_are_what_the_lines_say():
    frame = melt().frame()
    for term, lines in (
        (
            LeptonBond({1: (1.1, "30*r^2"), 2: (0.9, "r^4")}, units="lj"),
            "bond_style lepton\nbond_coeff 1 1.1 30*r^2\nbond_coeff 2 0.9 r^4",
        ),
        (
            LeptonAngle({1: (110, "3*theta^2"), 2: (90, "theta^4")}, units="lj"),
            "angle_style lepton\nangle_coeff 1 110 3*theta^2\nangle_coeff 2 90 theta^4",
        ),
    ):
        assert atc.potential(term).decompose(frame).energy == atc.potential(lines, "lj").decompose(frame).energy != 0
    assert LeptonTorsion({1: "cos(phi)"}, units="lj").describe().startswith("dihedral lepton")


@pytest.mark.parametrize("name, other", [("spica", "lj12_6"), ("sdk", "lj12_6"), ("spica", "lj12_5")])
def test_spica_angles_repel_at_their_ends(name, other):
    config = melt(unit_style="real", scale=2.0)
    config.types = np.arange(len(config.positions)) % 2 + 1
    config.masses, config.ntypes = {1: 1.0, 2: 1.0}, 2
    pair = (
        f"special_bonds lj/coul 0 0 1\npair_style lj/{name} 6.0\npair_coeff 1 1 lj9_6 0.4 3.9\npair_coeff 1 2 lj12_4 "
        f"0.3 4.1\npair_coeff 2 2 {other} 0.2 3.6\n"
    )
    agrees(
        config,
        f"bond_style zero\nbond_coeff *\nangle_style {name}\nangle_coeff 1 30 110\nangle_coeff 2 20 180\n",
        pair=pair,
    )
    with pytest.raises(AtcError, match="repulsion of pair_style lj/spica"):
        atc.potential(NO_BOND + f"angle_style {name}\nangle_coeff * 30 110", "real")
