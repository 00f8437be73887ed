"""The 1-4 pairs of dihedral styles charmm and charmmfsw with the charmm pair styles, against LAMMPS."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, sources_are_derivatives
from lammps_oracle import Config

import atc
from atc.errors import AtcError

COEFFS = "pair_coeff 1 1 0.1 3.0 0.2 2.5\npair_coeff 2 2 0.15 2.8\npair_coeff 3 3 0.2 2.6 0.1 2.4\n"
MODELS = {
    "charmm": "pair_style lj/charmm/coul/charmm 3.0 3.5\n" + COEFFS + "dihedral_style charmm",
    "implicit": "pair_style lj/charmm/coul/charmm/implicit 5.0 6.0 4.0 5.0\n" + COEFFS + "dihedral_style charmm",
    "charmmfsw": "pair_style lj/charmmfsw/coul/charmmfsh 3.0 5.0 4.0\n" + COEFFS + "dihedral_style charmmfsw",
    "charmm with the force switch": "pair_style lj/charmmfsw/coul/charmmfsh 3.0 5.0\n"
    + COEFFS
    + "dihedral_style charmm",
    "hybrid": "pair_style hybrid/overlay lj/charmm/coul/charmm 3.0 3.5 morse 4.0\n"
    + "".join(
        " ".join([*line.split()[:3], "lj/charmm/coul/charmm", *line.split()[3:]]) + "\n" for line in COEFFS.splitlines()
    )
    + "pair_coeff 1 2 lj/charmm/coul/charmm 0.12 2.9\npair_coeff 1 3 lj/charmm/coul/charmm 0.12 2.9 0.1 "
    "2.0\npair_coeff 2 3 lj/charmm/coul/charmm 0.12 2.9\n" + "pair_coeff 1 2 morse 0.1 1.5 3.0\ndihedral_style charmm",
}
WEIGHTS = "\ndihedral_coeff 1 0.3 3 0 0.5\ndihedral_coeff 2 0.2 2 180 1.0\ndihedral_coeff 3 0.1 1 0 0.0"


def chains(periodic=True, unit="real"):
    """Three chains of six atoms, one across the border of a box that is hardly larger."""
    rng = np.random.default_rng(4)
    steps = np.cumsum(
        np.tile([[1.2, 0.3, 0.5], [1.1, -0.4, -0.5]], (3, 1)) + rng.uniform(-0.25, 0.25, (3, 6, 3)), axis=1
    )
    x = steps + np.array([[1.0, 2.0, 2.0], [1.5, 5.5, 5.0], [6.0, 8.5, 8.0]])[:, None]
    if not periodic:
        x[2, :, 0] -= 4.0
    n = np.arange(18).reshape(3, 6)
    dihedrals = np.concatenate([n[:, k : k + 4] for k in range(3)])
    bonds = np.concatenate([n[:, k : k + 2] for k in range(5)])
    return Config(
        [11.0, 12, 12] if periodic else [14.0, 14, 14],
        x.reshape(-1, 3),
        np.arange(18) % 3 + 1,
        units=unit,
        charges=rng.uniform(-0.4, 0.4, 18),
        periodic=(periodic,) * 3,
        bonds=bonds,
        dihedrals=dihedrals,
        dihedral_types=np.arange(9) % 3 + 1,
    )


@pytest.mark.parametrize("model", MODELS)
def test_ends_of_torsions(model):
    lines = "special_bonds charmm\ndielectric 1.5\n" + MODELS[model] + WEIGHTS
    c = chains(periodic="switch" not in model, unit="metal" if model == "implicit" else "real")
    pot = atc.potential(lines, units=c.units)
    # LAMMPS gives the torsion a quarter to each of its four atoms and the pair half to each of its two, as atc does.
    d, _ = agrees_with_lammps(pot, lines + "\nbond_style zero\nbond_coeff *", c)
    without = atc.potential(lines.replace(" 0.5\n", " 0.0\n").replace(" 1.0\n", " 0.0\n"), units=c.units).decompose(
        c.frame()
    )
    assert np.abs(d.forces_nc - without.forces_nc).max() > 0.01 * np.abs(d.forces_nc).max()


def test_ends_of_torsions_and_energy_shares():
    lines = "special_bonds charmm\n" + MODELS["charmm"] + WEIGHTS
    c = chains(periodic=False)
    pot = atc.potential(lines, units="real")
    pot.terms = [t for t in pot.terms if not t.pairwise]
    assert len(pot.terms) == 2
    sources_are_derivatives(pot, c.frame())


@pytest.mark.parametrize(
    "lines, says",
    [
        ("pair_style lj/cut 9\npair_coeff * * 0.1 3\ndihedral_style charmm", "weight 0.5.*not supported without"),
        ("dihedral_style charmm", "weight 0.5.*not supported without"),
        (
            "pair_style lj/charmm/coul/charmm 8 9\npair_coeff * * 0.1 3\ndihedral_style charmmfsw",
            "needs pair_style lj/charmmfsw",
        ),
    ],
)
def test_ends_without_coefficients(lines, says):
    with pytest.raises(AtcError, match=says):
        atc.potential(lines + WEIGHTS, units="real")


def test_objects_do_not_leave_the_ends_out():
    with pytest.raises(AtcError, match="weight 0.5.*not supported here"):
        atc.potential(atc.decomposers.CharmmTorsion((0.1, 1, 0, 0.5))).decompose(
            Config([9, 9, 9], np.eye(4, 3), dihedrals=[[0, 1, 2, 3]]).frame()
        )
