"""Pair styles that are a formula of one distance, each against LAMMPS itself: energy, per-atom energies, forces, the
full virial."""

import pickle

import numpy as np
import pytest
from lammps_oracle import Config, lammps_session, run_lammps
from test_decomposers_pair import BOXES, agree, config

import atc
import atc.decomposers as D
from atc.errors import AtcError

# One entry is a form of lines: coefficients by type, mixed, with cutoffs of their own, shifted. Spacing of atoms: 1.12
# in lj, 3.3 Å in metal and real.
STYLES = {
    "lj/smooth": (
        "lj",
        "pair_style lj/smooth 2.0 2.6\npair_coeff * * 1.0 1.0\npair_coeff 1 2 1.1 0.9 1.8 2.3\npair_coeff 3 3 0.7 1.1 "
        "2.1 2.5",
    ),
    "lj/smooth mixed": (
        "real",
        "pair_style lj/smooth 6.0 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 5.5 6.5\npair_coeff 3 3 0.15 "
        "3.3 5.0 7.0\n"
        "pair_modify shift yes mix arithmetic",
    ),
    "lj/cubic": (
        "lj",
        "pair_style lj/cubic\npair_coeff 1 1 1.0 0.9\npair_coeff 2 2 1.2 0.85\npair_coeff 3 3 0.8 0.95\npair_coeff 1 "
        "2 0.5 1.1",
    ),
    "lj/sf": (
        "lj",
        "pair_style lj/sf 2.5\npair_coeff 1 1 1.0 1.0\npair_coeff 2 2 0.7 1.05 2.2\npair_coeff 3 3 0.7 0.9",
    ),
    "lj/relres": (
        "lj",
        "pair_style lj/relres 1.5 1.7 2.2 2.6\npair_coeff 1 1 1.0 1.0 1.5 1.1\npair_coeff 2 2 0.7 1.05 0 0 1.4 1.5 "
        "2.0 2.3\npair_coeff 3 3 0.9 0.95 1 1\n"
        "pair_coeff 1 3 0.5 1.0 0.7 1.0 1.6 1.6 2.5 2.5",
    ),
    "lj/relres shifted": (
        "metal",
        "pair_style lj/relres 4.5 5.2 6.5 7.9\npair_coeff 1 1 0.01 3.0 0.02 3.2\npair_coeff 2 2 0.02 2.8 0 "
        "0\npair_coeff 3 3 0.01 3.1 0.01 3.1 4.0 4.5 5.5 6.5\n"
        "pair_coeff 1 3 0.01 3.0 0.02 3.0 4.0 4.0 6.5 6.5\npair_modify shift yes",
    ),
    "lj/gromacs": (
        "real",
        "pair_style lj/gromacs 6.0 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 5.5 6.5\npair_coeff 3 3 0.15 "
        "3.3\npair_modify mix sixthpower",
    ),
    "lj/gromacs/coul/gromacs": (
        "real",
        "dielectric 2.5\npair_style lj/gromacs/coul/gromacs 6.0 7.9 0.0 7.0\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 "
        "0.1 2.8\npair_coeff 3 3 0.15 3.3",
    ),
    "lj/gromacs/coul/gromacs one": (
        "metal",
        "pair_style lj/gromacs/coul/gromacs 5.0 7.5\npair_coeff * * 0.01 3.0\npair_coeff 1 2 0.02 2.9",
    ),
    "lj/charmm/coul/charmm": (
        "real",
        "dielectric 1.5\npair_style lj/charmm/coul/charmm 6.0 7.9 5.0 7.0\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 "
        "2.8 0.2 2.5\npair_coeff 3 3 0.15 3.3",
    ),
    "lj/charmm/coul/charmm geometric": (
        "metal",
        "pair_style lj/charmm/coul/charmm 5.0 7.5\npair_modify mix geometric\npair_coeff 1 1 0.02 3.0\npair_coeff 2 2 "
        "0.01 2.8\npair_coeff 3 3 0.015 3.3",
    ),
    "lj/charmm/coul/charmm/implicit": (
        "real",
        "pair_style lj/charmm/coul/charmm/implicit 6.0 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 0.2 "
        "2.5\npair_coeff 3 3 0.15 3.3",
    ),
    "lj/charmm/coul/charmm/implicit nano": (
        "nano",
        "pair_style lj/charmm/coul/charmm/implicit 0.6 0.79\npair_coeff * * 1.6 0.3",
    ),
    "lj/charmmfsw/coul/charmmfsh": (
        "real",
        "dielectric 1.5\npair_style lj/charmmfsw/coul/charmmfsh 6.0 7.9 7.0\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 "
        "0.1 2.8 0.2 2.5\npair_coeff 3 3 0.15 3.3",
    ),
    "lj/charmmfsw/coul/charmmfsh one": (
        "metal",
        "pair_style lj/charmmfsw/coul/charmmfsh 6.0 7.9\npair_coeff * * 0.01 3.0\npair_coeff 1 2 0.02 2.9",
    ),
    "lj/class2": (
        "real",
        "pair_style lj/class2 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.5\npair_coeff 3 3 0.15 3.3 "
        "7.0\npair_modify shift yes mix arithmetic",
    ),
    "lj/class2/coul/cut": (
        "real",
        "pair_style lj/class2/coul/cut 7.0 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.5\npair_coeff 3 3 "
        "0.15 3.3 7.0 6.0\npair_modify shift yes",
    ),
    "lj96/cut": (
        "lj",
        "pair_style lj96/cut 2.5\npair_coeff 1 1 1 1\npair_coeff 2 2 0.7 1.05 2.2\npair_coeff 3 3 0.7 "
        "0.9\npair_modify mix sixthpower shift yes",
    ),
    "mie/cut": (
        "real",
        "pair_style mie/cut 7.9\npair_coeff 1 1 0.2 3.0 14.2 6.6\npair_coeff 2 2 0.1 2.8 12 6 6.5\npair_coeff 3 3 "
        "0.15 3.3 10 5.5\n"
        "pair_modify shift yes mix arithmetic",
    ),
    "mie/cut whole": (
        "lj",
        "pair_style mie/cut 2.5\npair_coeff * * 1.0 1.0 14 7\npair_coeff 2 2 0.9 1.0 8 6\npair_coeff 1 3 0.9 1.0 12 6 "
        "2.1",
    ),
    "nm/cut": (
        "real",
        "pair_style nm/cut 7.9\npair_coeff * * 0.2 3.4 9.0 6.5\npair_coeff 1 2 0.1 3.0 8 7 6.5\npair_modify shift yes",
    ),
    "nm/cut/coul/cut": (
        "real",
        "pair_style nm/cut/coul/cut 7.0 7.9\npair_coeff * * 0.2 3.4 9.0 6.0\npair_coeff 1 2 0.1 3.0 8 7 "
        "6.5\npair_coeff 3 3 0.2 3 9 7 6 5\npair_modify shift yes",
    ),
    "lj/spica": (
        "real",
        "pair_style lj/spica 7.9\npair_coeff * * lj12_4 0.2 3.0\npair_coeff 1 2 lj9_6 0.1 2.8 6.5\npair_coeff 3 3 "
        "lj12_6 0.15 3.3 7.0\npair_modify shift yes",
    ),
    "lj/spica 12-5": (
        "real",
        "pair_style lj/spica 7.9\npair_coeff * * lj12_5 0.2 3.0\npair_coeff 1 2 lj12_6 0.1 2.8 6.5\npair_modify shift "
        "yes",
    ),
    "lj/sdk": ("real", "pair_style lj/sdk 7.9\npair_coeff * * lj9_6 0.2 3.0"),
    "lj/mdf": (
        "real",
        "pair_style lj/mdf 6.0 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 5.5 6.5\npair_coeff 3 3 0.15 "
        "3.3\npair_modify mix arithmetic",
    ),
    "lennard/mdf": ("lj", "pair_style lennard/mdf 2.0 2.6\npair_coeff * * 4.0 4.0\npair_coeff 1 2 5.0 4.1 1.8 2.3"),
    "buck/mdf": (
        "metal",
        "pair_style buck/mdf 6.0 7.9\npair_coeff * * 800.0 0.35 30.0\npair_coeff 1 3 900.0 0.34 25.0 5.0 6.4",
    ),
    "lj/cut/coul/debye": (
        "real",
        "dielectric 1.7\npair_style lj/cut/coul/debye 0.3 6.5 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 "
        "6.0\npair_coeff 3 3 0.15 3.3 7.0 7.5\n"
        "pair_modify shift yes",
    ),
    "coul/debye": (
        "real",
        "dielectric 1.7\npair_style coul/debye 0.3 7.9\npair_coeff 1 1\npair_coeff 2 2 6.0\npair_coeff 3 3 7.0",
    ),
    "lj/cut/coul/wolf": (
        "real",
        "pair_style lj/cut/coul/wolf 0.2 6.5 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.0\npair_coeff 3 3 "
        "0.15 3.3\npair_modify shift yes",
    ),
    "buck/coul/cut": (
        "metal",
        "dielectric 1.7\npair_style buck/coul/cut 6.9 7.9\npair_coeff * * 800.0 0.35 30.0\npair_coeff 1 3 900.0 0.34 "
        "25.0 6.4\n"
        "pair_coeff 1 1 900.0 0.34 25.0 6.4 5.5\npair_modify shift yes",
    ),
    "born/coul/dsf": (
        "metal",
        "pair_style born/coul/dsf 0.2 6.9 7.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0\npair_coeff 2 2 0.3 0.35 2.2 "
        "20.0 25.0 6.4\npair_modify shift yes",
    ),
    "born/coul/wolf": (
        "metal",
        "pair_style born/coul/wolf 0.2 6.9 7.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0\npair_coeff 2 2 0.3 0.35 2.2 "
        "20.0 25.0 6.4\npair_modify shift yes",
    ),
    "born/coul/dsf/cs": ("metal", "pair_style born/coul/dsf/cs 0.2 6.9 7.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0"),
    "born/coul/wolf/cs": ("metal", "pair_style born/coul/wolf/cs 0.2 6.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0"),
    "coul/wolf/cs": ("real", "pair_style coul/wolf/cs 0.21 7.9\npair_coeff * *"),
    "coul/cut/global": ("real", "pair_style coul/cut/global 7.9\npair_coeff * *"),
    "coul/slater/cut": (
        "real",
        "dielectric 1.7\npair_style coul/slater/cut 1.5 7.9\npair_coeff 1 1\npair_coeff 2 2 6.0\npair_coeff 3 3 7.0",
    ),
    "coul/diel": ("real", "pair_style coul/diel 7.9\npair_coeff * * 78 3.4 0.9\npair_coeff 1 2 70 3.0 0.8"),
    "born/gauss": (
        "metal",
        "pair_style born/gauss 7.9\npair_coeff * * 80.0 2.1 0.3 0.7 3.1\npair_coeff 1 2 90.0 2.0 0.2 0.8 3.0 "
        "6.5\npair_modify shift yes",
    ),
    "born/gauss cutoff 0": (
        "metal",
        "pair_style hybrid/overlay born/gauss 7.0 lj/cut 6.0\npair_coeff 1 1 born/gauss 80.0 2.1 0.3 0.7 3.1 0\n"
        "pair_coeff 2 3 born/gauss 90.0 2.0 0.2 0.8 3.0\npair_coeff * * lj/cut 0.01 3.0",
    ),
    # LAMMPS's constant is CHARMM's for all of them.
    "lj/charmmfsw/coul/charmmfsh beside others": (
        "real",
        "dielectric 1.3\npair_style hybrid/overlay lj/charmmfsw/coul/charmmfsh 6.0 7.9 coul/cut 6.0 coul/dsf 0.2 5.0\n"
        "pair_coeff 1 * lj/charmmfsw/coul/charmmfsh 0.2 3.0\npair_coeff 2 2* coul/cut\npair_coeff 3 3 coul/dsf",
    ),
    "gauss": (
        "lj",
        "pair_style gauss 2.6\npair_coeff 1 1 1.0 0.9\npair_coeff 2 2 -0.8 1.1 2.2\npair_coeff 3 3 0.7 0.8",
    ),
    "gauss arithmetic": (
        "lj",
        "pair_style gauss 2.6\npair_coeff 1 1 1.0 0.9\npair_coeff 2 2 0.8 1.1 2.2\npair_coeff 3 3 0.7 "
        "0.8\npair_modify mix arithmetic",
    ),
    "gauss/cut": (
        "lj",
        "pair_style gauss/cut 2.6\npair_coeff 1 1 0.3 1.4 0.2\npair_coeff 2 2 0.4 1.3 0.3 2.2\npair_coeff 3 3 0.3 1.5 "
        "0.25\npair_modify shift yes",
    ),
    "gauss/cut arithmetic": (
        "lj",
        "pair_style gauss/cut 2.6\npair_coeff 1 1 -0.3 1.4 0.2\npair_coeff 2 2 0.4 1.3 0.3 2.2\npair_coeff 3 3 0.3 "
        "1.5 0.25\npair_modify mix arithmetic",
    ),
    "ufm": (
        "lj",
        "pair_style ufm 2.6\npair_coeff 1 1 1.0 0.9\npair_coeff 2 2 0.8 1.1 2.2\npair_coeff 3 3 0.7 0.8\npair_modify "
        "shift yes mix arithmetic",
    ),
    "morse/smooth/linear": (
        "metal",
        "pair_style morse/smooth/linear 7.9\npair_coeff * * 0.3 1.4 3.1\npair_coeff 1 2 0.2 1.5 3.0 6.1",
    ),
    "morse/soft": (
        "lj",
        "pair_style morse/soft 4 0.9 2.6\npair_coeff * * 1.0 2.1 1.1 0.95\npair_coeff 1 2 1.2 2.0 1.1 0.4\npair_coeff "
        "3 3 1.2 2.0 1.1 0.9 2.1\npair_modify shift yes",
    ),
    "pedone": (
        "metal",
        "pair_style pedone 7.9\npair_coeff * * 0.03 1.9 2.7 22.0\npair_coeff 1 2 0.04 2.0 2.5 1.0 6.1\npair_modify "
        "shift yes",
    ),
    "momb": (
        "metal",
        "pair_style momb 7.9 0.75 20\npair_coeff * * 0.3 1.4 3.1 10.3 2.4\npair_coeff 1 2 0.0 1.0 1.0 12.3 2.8",
    ),
    "beck": (
        "metal",
        "pair_style beck 7.9\npair_coeff * * 399.67 0.9 0.675 2.39 0.0003746\npair_coeff 1 2 399.67 0.8 0.675 2.2 "
        "0.0003746 6.5",
    ),
    "beck nano": ("nano", "pair_style beck 0.79\npair_coeff * * 39967 0.00009 0.0675 23.9 37.46"),
    "lj/pirani": (
        "metal",
        "pair_style lj/pirani 7.9\npair_coeff * * 4.0 9.0 6.0 3.4 0.01\npair_coeff 1 2 4.0 7.0 4.0 3.1 0.02 "
        "6.5\npair_modify shift yes",
    ),
    "wf/cut": (
        "lj",
        "pair_style wf/cut 2.5\npair_coeff * * 1.0 1.0 1 1\npair_coeff 1 2 1.1 0.9 2 1 2.0\npair_coeff 3 3 1.0 1.05 1 "
        "3 1.8",
    ),
    "cosine/squared": (
        "lj",
        "pair_style cosine/squared 2.5\npair_coeff * * 1.0 1.1\npair_coeff 1 2 1.1 1.2 2.0\npair_coeff 3 3 1.0 1.05 "
        "wca\npair_coeff 2 2 1.0 1.2 1.2 wca\n"
        "pair_coeff 2 3 0.8 1.3 1.9 wca",
    ),
    "colloid": (
        "lj",
        "pair_style colloid 4.0\npair_coeff 1 1 39.5 0.3 0.5 0.5\npair_coeff 1 2 75.0 0.3 0.0 0.4 3.0\npair_coeff 2 2 "
        "144.0 1.0 0.0 0.0 2.5\n"
        "pair_coeff 3 3 30.0 0.3 0.4 0.4\npair_coeff 1 3 35 0.3 0.5 0.4\npair_coeff 2 3 75.0 0.3 0.5 0.0 "
        "3.0\npair_modify shift yes",
    ),
    "colloid arithmetic": (
        "lj",
        "pair_style colloid 3.0\npair_coeff 1 1 39.5 0.3 0.5 0.5\npair_coeff 2 2 144.0 0.4 0.6 0.6 2.5\npair_coeff 3 "
        "3 30.0 0.3 0.4 0.4\npair_modify mix arithmetic",
    ),
    "harmonic/cut mixed": (
        "lj",
        "pair_style harmonic/cut\npair_coeff 1 1 1.0 1.5\npair_coeff 2 2 2.3 1.9\npair_coeff 3 3 0.7 1.3\npair_modify "
        "mix sixthpower",
    ),
    "harmonic/cut geometric": (
        "lj",
        "pair_style harmonic/cut\npair_coeff 1 1 1.0 1.5\npair_coeff 2 2 2.3 1.9\npair_coeff 3 3 0.7 1.3",
    ),
    "harmonic/cut": ("lj", "pair_style harmonic/cut\npair_coeff * * 1.0 1.5\npair_coeff 1 2 2.0 2.2"),
    "lj/cut/soft": (
        "real",
        "pair_style lj/cut/soft 2.0 0.5 7.9\npair_coeff * * 0.2 3.0 0.7\npair_coeff 1 2 0.1 2.8 1.0 6.5\npair_modify "
        "shift yes",
    ),
    "lj/cut/soft mixed": (
        "lj",
        "pair_style lj/cut/soft 1 0.5 2.5\npair_coeff 1 1 1 1 0.5\npair_coeff 2 2 0.7 1.05 0.5 2.2\npair_coeff 3 3 "
        "0.7 0.9 0.5",
    ),
    "lj/class2/soft": (
        "real",
        "pair_style lj/class2/soft 2.0 0.5 7.9\npair_coeff 1 1 0.2 3.0 0.7\npair_coeff 2 2 0.1 2.8 0.7 "
        "6.5\npair_coeff 3 3 0.1 3.1 0.7\npair_modify shift yes",
    ),
    "coul/cut/soft": (
        "real",
        "dielectric 1.7\npair_style coul/cut/soft 2.0 10.0 7.9\npair_coeff 1 1 0.7\npair_coeff 2 2 0.7 "
        "6.5\npair_coeff 3 3 0.7\npair_coeff 1 3 0.2",
    ),
    "lj/cut/coul/cut/soft": (
        "real",
        "pair_style lj/cut/coul/cut/soft 2.0 0.5 10.0 7.0 7.9\npair_coeff 1 1 0.2 3.0 0.7\npair_coeff 2 2 0.1 2.8 0.7 "
        "6.5\npair_coeff 3 3 0.1 3.1 0.7 6.5 6.0\n"
        "pair_modify shift yes",
    ),
    "lj/class2/coul/cut/soft": (
        "real",
        "pair_style lj/class2/coul/cut/soft 2.0 0.5 10.0 7.0 7.9\npair_coeff 1 1 0.2 3.0 0.7\npair_coeff 2 2 0.1 2.8 "
        "0.7 6.5\npair_coeff 3 3 0.1 3.1 0.7",
    ),
}


@pytest.mark.parametrize("style", STYLES)
def test_style(style):
    unit, lines = STYLES[style]
    box = list(BOXES)[len(style) % 3]
    agree(lines, config(box, unit, seed=len(style)), threads=2 if box == "triclinic" else 1)


def molecule(unit, seed=0, periodic=(True, False, False)):
    """Chains of five atoms in a box with open sides."""
    c = config("orthogonal", unit, seed=seed)
    i = np.arange(len(c.positions) - 1)
    bonds = np.stack([i, i + 1], axis=1)[i % 5 != 4]
    inside = np.clip(c.positions, 1e-6, np.diag(c.cell) - 1e-6)
    return Config(c.cell, inside, c.types, units=unit, charges=c.charges, ntypes=3, bonds=bonds, periodic=periodic)


WEIGHTS = "special_bonds lj 0.1 0.3 0.6 coul 0.2 0.4 0.7"
BONDS = "\nbond_style zero\nbond_coeff *"


@pytest.mark.parametrize("style", [s for s in STYLES if " " not in s])
def test_weights_of_bonded_neighbours(style):
    unit, lines = STYLES[style]
    c = molecule(unit, seed=len(style))
    pot = atc.potential(f"{WEIGHTS}\n{lines}", units=unit)
    # LAMMPS weights the force of lj/smooth/linear (lj/sf) and not its energy, which would not be the force's any more.
    agree(lines + BONDS, c, pot, before=[WEIGHTS], energy=style != "lj/sf")


@pytest.mark.parametrize("weights", ["coul 0.2 0.4 1.0", "coul 0.0 0.5 1.0 lj 0.1 0.1 0.1"])
def test_excluded_pairs_of_a_full_sum(weights):
    # LAMMPS does not look at this style's cutoff, only at its neighbour list: the outer ones of the chain, which lie
    # between, are not weighted here.
    lines = (
        "dielectric 2.0\npair_style hybrid/overlay lj/cut 6.5 coul/exclude 7.9\npair_coeff * * lj/cut 0.2 "
        "3.0\npair_coeff * * coul/exclude"
    )
    pot = atc.potential(f"special_bonds {weights}\n{lines}", units="real")
    agree(lines + BONDS, molecule("real"), pot, before=[f"special_bonds {weights}"])


OVERLAY = (
    "pair_style hybrid/overlay lj/charmm/coul/charmm 5.0 7.0 gauss/cut 6.0 lj/class2/coul/cut 5.0 6.0 born/coul/dsf "
    "0.2 6.0\n"
    "pair_coeff 1 1 lj/charmm/coul/charmm 0.2 3.0\npair_coeff 2 2 lj/charmm/coul/charmm 0.1 2.8\npair_coeff 1 2 "
    "gauss/cut 0.3 3.4 0.4\n"
    "pair_coeff 1 2 lj/charmm/coul/charmm 0.1 3.0\npair_coeff 3 3 lj/class2/coul/cut 0.1 3.0\npair_coeff 1 3 "
    "lj/class2/coul/cut 0.1 3.0\n"
    "pair_coeff 2 3 born/coul/dsf 0.2 0.32 2.3 20.0 30.0\npair_modify pair gauss/cut shift yes"
)


def test_overlay():
    agree(OVERLAY, config("triclinic", "real"))
    agree(OVERLAY + BONDS, molecule("real"), atc.potential(f"{WEIGHTS}\n{OVERLAY}", units="real"), before=[WEIGHTS])


@pytest.mark.parametrize(
    "style, pair, pairij",
    [
        ("lj/charmm/coul/charmm 5.0 7.0", ["0.2 3.0 0.1 2.9", "0.1 2.8 0.1 2.7", "0.15 3.3 0.1 3.1"], None),
        ("lj/class2/coul/cut 5.0 7.0", ["0.2 3.0", "0.1 2.8", "0.15 3.3"], None),
        ("nm/cut 7.0", None, "0.2 3.4 9.0 6.5"),
        ("buck/coul/cut 7.0", None, "800.0 0.35 30.0"),
    ],
)
def test_coefficients_of_a_data_file(tmp_path, style, pair, pairij):
    c = config("orthogonal", "real", seed=3)
    data = tmp_path / "config.data"
    c.write_data(data)
    section = "\nPair Coeffs\n\n" + "\n".join(f"{k} {w}" for k, w in enumerate(pair, 1)) if pair else ""
    if pairij:
        section = "\nPairIJ Coeffs\n\n" + "\n".join(f"{i} {j} {pairij}" for i in (1, 2, 3) for j in range(i, 4))
    data.write_text(data.read_text() + section + "\n")
    script = tmp_path / "in.run"
    script.write_text(f"units real\natom_style charge\npair_style {style}\nread_data config.data\nrun 0\n")
    lines = [f"pair_style {style}"]
    lines += [f"pair_coeff {k} {k} {w}" for k, w in enumerate(pair, 1)] if pair else [f"pair_coeff * * {pairij}"]
    agree("\n".join(lines), c, atc.potential(script))


DPD = {
    "dpd": ("pair_style dpd 0.0 1.9 348\npair_coeff * * 25.0 4.5\npair_coeff 1 2 30.0 4.5 1.5", ""),
    "dpd/ext": (
        "pair_style dpd/ext 0.0 1.9 348\npair_coeff * * 25.0 4.5 4.5 0.5 0.5\npair_coeff 1 2 30.0 4.5 4.5 0.5 0.5 1.5",
        "",
    ),
    "dpd/tstat": (
        "pair_style hybrid/overlay lj/cut 2.5 dpd/tstat 0.0 0.0 1.9 348\npair_coeff * * lj/cut 1.0 1.0\npair_coeff * "
        "* dpd/tstat 4.5\n"
        "pair_coeff 1 2 dpd/tstat 4.5 1.5",
        "hybrid",
    ),
    "dpd/ext/tstat": (
        "pair_style hybrid/overlay lj/cut 2.5 dpd/ext/tstat 0.0 0.0 1.9 348\npair_coeff * * lj/cut 1.0 "
        "1.0\npair_coeff * * dpd/ext/tstat 4.5 4.5 0.5 0.5",
        "hybrid",
    ),
}


@pytest.mark.parametrize(
    "lines, says",
    [
        # LAMMPS refuses them too; they were taken for lines of no pair, and for the numbers that Python sees in them.
        ("lj/cut 2.5\npair_coeff * * 1 1\npair_coeff 2*3 1 1 2", r"line 3: pair_coeff 2\*3 1 sets no pair of types"),
        ("lj/cut 2.5\npair_coeff * * 1 1\npair_coeff 3 *2 1 2", r"line 3: .*write pair_coeff \*2 3"),
        ("lj/cut 2.5\npair_coeff * * 1 1_0", "line 2: .*expected a number for sigma, got '1_0'"),
        ("lj/cut 2.5\npair_coeff * * 1 ٣", "line 2: .*expected a number for sigma"),
        ("lj/cut 2.5\npair_coeff * * 1 nan", "line 2: .*sigma must be a finite number, got 'nan'"),
        ("lj/cut 2.5\npair_coeff * * 1 1\nspecial_bonds lj 0 0_1 1", "line 3: .*three weights"),
        ("colloid 3\npair_coeff * * 30 0.3 0.4 0.5", "line 2: .*d1 and d2 must be equal for a type with itself"),
    ],
)
def test_lines_that_lammps_refuses(lines, says):
    c = config("orthogonal", "lj")
    with pytest.raises(AtcError, match=says) as e:
        atc.potential(f"pair_style {lines}", units="lj")
    assert "\n" not in str(e.value)
    with pytest.raises(Exception):  # noqa: B017 (LAMMPS's own)
        run_lammps(f"pair_style {lines}", c)


@pytest.mark.parametrize("style", DPD)
def test_dpd_without_friction_and_noise(style):
    """Atoms at rest at no temperature feel the conservative force alone."""
    lines, _ = DPD[style]
    pot = atc.potential(lines, units="lj")
    agree(lines, config("triclinic", "lj"), pot, before=["comm_modify vel yes"])
    assert f"{style}: friction and noise" in pot.describe()


@pytest.mark.parametrize(
    "lines, says",
    [
        ("mie/cut 7.9\npair_coeff * * 1 1 6 6", "line 2.*exponents must be positive and different"),
        ("lj/smooth 7.9 7.0\npair_coeff * * 1 1", "line 1.*inner cutoff must be positive and less"),
        ("lj/smooth 6.0 7.0\npair_coeff * * 1 1 6.0", "line 2.*all or none of inner cutoff"),
        ("lj/gromacs/coul/gromacs 6 7 5\npair_coeff * * 1 1", "two or four cutoffs"),
        ("lj/charmm/coul/charmm 6 7\npair_coeff * * 1 1 0.5", r"epsilon sigma \[epsilon_14 sigma_14\]"),
        ("lj/charmm/coul/charmm 7 6\npair_coeff * * 1 1", "LJ inner cutoff"),
        ("lj/spica 7\npair_coeff * * lj8_4 1 1", "lj9_6, lj12_4, lj12_6"),
        ("lj/relres 4 3 5 6\npair_coeff * * 1 1 1 1", "not decrease"),
        ("lj/cut/soft 2 0.5 7\npair_coeff 1 1 1 1 0.5\npair_coeff 2 2 1 1 0.6", "types 1 and 2"),
        ("cosine/squared 3\npair_coeff * * 1 3", "larger than sigma"),
        ("wf/cut 3\npair_coeff * * 1 1 1.5 1", "whole numbers"),
        ("nm/cut 7\npair_coeff 1 1 1 1 9 6\npair_coeff 2 2 1 1 9 6", "nm/cut does not mix"),
        ("harmonic/cut 3\npair_coeff * * 1 1", "takes no numbers"),
        ("buck/coul/cut 7\npair_coeff * * 1 0 1", "rho must be positive"),
        ("beck 7\npair_coeff * * 1 1", "A B a alpha beta"),
        ("lj/mdf 5 6\npair_coeff * * 1 nan", "finite"),
    ],
)
def test_what_is_not_understood(lines, says):
    with pytest.raises(AtcError, match=says):
        atc.potential(f"pair_style {lines}", units="metal").decompose(config("small", "metal", kinds=2).frame())


def test_every_style_of_lammps_is_supported_or_has_a_reason():
    from atc.decomposers.pairs.hybrid import strip_suffix
    from atc.decomposers.pairs.unsupported import reason
    from atc.decomposers.registry import PAIR_STYLES

    with lammps_session() as lmp:
        names = {strip_suffix(name) for name in lmp.available_styles("pair")}
    assert len(names) > 200
    atc.potential("pair_style lj/cut 1\npair_coeff * * 1 1", units="lj")  # registers all styles
    known = set(PAIR_STYLES) | {"hybrid", "hybrid/overlay", "hybrid/scaled", "none"}
    assert sorted(n for n in names if n not in known and not reason("pair", n)) == []


@pytest.mark.parametrize(
    "style, why",
    [
        ("lj/cut/coul/long/soft 9", "its long-range part is not done yet"),
        ("gayberne 1 1 1 4", "orientation"),
        ("granular", "history"),
        ("tip4p/long/soft 1 2 1 1 1 0.5 10 0.1 9", "virtual site"),
    ],
)
def test_why_not(style, why):
    with pytest.raises(AtcError, match=f"line 1: pair_style .* is not supported: .*{why}"):
        atc.potential(f"pair_style {style}\npair_coeff * * 1 1", units="real")
    with pytest.raises(AtcError, match=f"line 1: .* sub-style of hybrid/overlay is not supported: .*{why}"):
        atc.potential(f"pair_style hybrid/overlay {style} lj/cut 9\npair_coeff * * lj/cut 1 1", units="real")


SCALED = (
    "pair_style hybrid/scaled 0.7 lj/cut/coul/cut 7.0 -0.4 morse 6.5 1.0 coul/wolf 0.2 6.0 0.5 coul/wolf 0.3 "
    "6.0\npair_coeff * * lj/cut/coul/cut 0.2 3.0\n"
    "pair_coeff 1 2* morse 2.0 1.4 3.1\npair_coeff * * coul/wolf 1\npair_coeff * * coul/wolf 2"
)


def test_scaled():
    agree(SCALED, config("small", "real"))
    agree(SCALED + BONDS, molecule("real"), atc.potential(f"{WEIGHTS}\n{SCALED}", units="real"), before=[WEIGHTS])
    for line, says in (
        ("v_one lj/cut 7", "v_one may change"),
        ("lj/cut 7", "needs a factor"),
        ("0.5 gayberne 1 1 1 4", "orientation"),
    ):
        with pytest.raises(AtcError, match=says):
            atc.potential(f"pair_style hybrid/scaled {line}\npair_coeff * * lj/cut 1 1", units="lj")


LEPTON = {
    "lepton": 'pair_style lepton 7.9\npair_coeff * * "4.0*eps*((sig/r)^12 - (sig/r)^6);eps=0.2; sig=3.0"\npair_coeff '
    '1 2 "k*(r-r0)^2*step(r0-r); k=20; r0=2*a; a=1.7" 6.5\n'
    'pair_coeff 3 3 "(1.0-switch)*zbl(6,7,r)-switch*4.0*eps*((sig/r)^6);switch=0.5*(tanh(1.5*(r-sig))+1.0);eps=0.05;sig=3.207" 7.0\npair_modify shift yes',
    "lepton/coul": 'dielectric 1.7\npair_style lepton/coul 7.9\npair_coeff * * "qi*qj/r*erfc(alpha*r); '
    'alpha=0.3"\npair_coeff 1 2 "lj+coul; lj=0.8*((3/r)^12-(3/r)^6); coul=0.9*qi*qj/r" 6.5',
    "functions": "pair_style lepton 7.9\npair_coeff * * "
    "sqrt(r)+exp(-r)*log(r)+sin(r)*cos(r/3)+0.1*tan(r/9)+atan(r)+sinh(r/5)-cosh(r/6)+erf(r/3)+square(r/4)-cube(r/9)+recip(r)"
    "\npair_coeff 1 2 asin(r/9)-acos(r/10)+sec(r/7)+0.1*csc(r/3)-0.2*cot(r/4)+atan2(r,3)+min(r,4)*max(r,5)+abs(4-r)+floor(r)*r+ceil(r)+select(step(r-5),r^2,2^-r)"
    "\npair_coeff 2 2 -r^2^0.5+r/2/3-(1-r)^3+delta(r)",
}


@pytest.mark.parametrize("name", LEPTON)
def test_formulas(name):
    agree(LEPTON[name], config("orthogonal", "real", seed=5))
    agree(
        LEPTON[name] + BONDS,
        molecule("real"),
        atc.potential(f"{WEIGHTS}\n{LEPTON[name]}", units="real"),
        before=[WEIGHTS],
    )


@pytest.mark.parametrize(
    "line, says",
    [
        ("__import__('os')", "not understood|no function"),
        ("eps*r", "eps is neither r nor defined"),
        ("v_a*r", "v_a is neither.*write the number"),
        ("r*(", "is no formula"),
        ("a*r;a=a", "uses itself"),
        ("sqrt(r,2)", "takes 1 argument"),
        ("zbl(r,6,r)", "must be numbers"),
        ("r.real", "not understood"),
        ("(" * 300 + "r" + ")" * 300, "is no formula|nested"),
        ("+".join(["r"] * 400), "nested"),
    ],
)
def test_formulas_that_are_none(line, says):
    with pytest.raises(AtcError, match=f"(?s)line 2.*{says}"):
        atc.potential(f'pair_style lepton 5\npair_coeff * * "{line}"', units="real")


PAIRS = (
    "# numbers\n1 9 lj126 0.2 3.0\n3 30 morse 1.0 1.2 3.0 # stiff\n\n4 5 harmonic 5.0 1.2 6.0\n5 4 harmonic 4.0 "
    "3.0\n7 60 quartic 0.1 3.0 0.3 0.4 30.0\n2 3 lj126 1 3 0.5\n"
)


def test_listed_pairs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pairs.txt").write_text(PAIRS)
    lines = (
        "pair_style hybrid/overlay lj/cut 7.0 list pairs.txt 9.0 nocheck\npair_coeff * * lj/cut 0.2 3.0\npair_coeff * "
        "* list"
    )
    c = config("orthogonal", "real")
    c.cell = np.diag([40.0, 40, 40])  # LAMMPS finds listed atoms among its ghosts only
    agree(lines, c)
    agree(lines + BONDS, molecule("real"), atc.potential(f"{WEIGHTS}\n{lines}", units="real"), before=[WEIGHTS])
    with pytest.raises(AtcError, match="names atom 30, which is not in this frame"):
        atc.potential(lines, units="real").decompose(config("small", "real").frame())
    for row, says in (
        ("1 2 fene 1 1", "line 1: expected two atom numbers"),
        ("1 1 lj126 1 1", "with itself"),
        ("1 2 lj126 1", "line 1.*takes epsilon sigma"),
    ):
        (tmp_path / "pairs.txt").write_text(row)
        with pytest.raises(AtcError, match=says):
            atc.potential(lines, units="real")


OBJECTS = {
    "mie/cut 7.5": ("0.2 3.0 14 6", lambda one: D.Mie(0.2, 3.0, 14, 6, 7.5, **one)),
    "lj/smooth 6.0 7.5": (
        "0.2 3.0",
        lambda one: D.LennardJonesSmooth(epsilon=0.2, sigma=3.0, inner=6.0, cutoff=7.5, **one),
    ),
    "lj/gromacs 6.0 7.5": ("0.2 3.0", lambda one: D.LennardJonesGromacs(0.2, 3.0, 6.0, cutoff=7.5, **one)),
    "gauss/cut 7.5": ("0.9 3.0 0.5", lambda one: D.GaussCut(0.9, 3.0, 0.5, np.full((3, 3), 7.5), **one)),
    "coul/debye 0.3 7.5": ("", lambda one: D.CoulombDebye(0.3, 7.5, **one)),
}


@pytest.mark.parametrize("line", OBJECTS)
def test_objects_are_the_lines(line):
    coeff, make = OBJECTS[line]
    pot = pickle.loads(pickle.dumps(atc.potential(make({"units": "real", "n_types": 3}))))
    agree(f"pair_style {line}\npair_coeff * * {coeff}", config("triclinic", "real"), pot)


def test_objects_say_what_they_take():
    for wrong in ((1, 2), (1, 2, 3, 4, 5, 6)):
        with pytest.raises(AtcError, match="Mie takes epsilon, sigma, gamma_rep, gamma_att, cutoff"):
            D.Mie(*wrong, units="real")
    with pytest.raises(AtcError, match="cutoff must be positive"):
        D.Mie(1, 1, 12, 6, 0, units="real")
