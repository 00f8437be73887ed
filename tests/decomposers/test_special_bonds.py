"""special_bonds against LAMMPS: which pairs are left out or weighted, for chains, rings, branches, and bonds through
small boxes."""

import numpy as np
import pytest
from lammps_oracle import Config, thermal_lattice
from test_decomposers_pair import agree

import atc
from atc.decomposers.pairs.special_bonds import SpecialBonds
from atc.errors import AtcError
from atc.frame import Topology

LJ = "pair_style lj/cut 2.5\npair_coeff * * 1.0 1.0\nbond_style zero\nbond_coeff *"
COUL = "pair_style lj/cut/coul/cut 2.2 2.5\npair_coeff * * 1.0 1.0\nbond_style zero\nbond_coeff *"
DSF = "pair_style lj/cut/coul/dsf 0.3 2.2 2.5\npair_coeff * * 1.0 1.0\nbond_style zero\nbond_coeff *"


def molecules(box, angles=True):
    """Random bonds between neighbouring lattice points: chains, rings of 3 to 6, branches, doubled bonds."""
    cell = {
        "orthogonal": np.diag([6.6, 5.5, 5.5]),
        "triclinic": np.array([[6.6, 0, 0], [2.2, 5.5, 0], [-1.9, 1.2, 5.5]]),
        # Half of the shortest edge is less than the cutoff: images of bonded atoms count fully.
        "small": np.array([[4.4, 0, 0], [0.9, 3.3, 0], [0.5, -0.7, 3.3]]),
    }[box]
    counts = np.rint(np.diag(cell) / 1.1).astype(int)
    x, t = thermal_lattice(cell, counts, jitter=0.1, kinds=2, seed=4)
    t[:2] = 1, 2
    n = len(x)
    rng = np.random.default_rng(5)
    d = x[:, None] - x[None]
    d -= np.rint(d @ np.linalg.inv(cell)) @ cell
    d = np.sqrt((d**2).sum(-1))
    near = np.argwhere(np.triu(d < 1.75, 1))
    bonds = near[rng.random(len(near)) < 2.2 * n / 2 / len(near)]
    bonds = np.concatenate([bonds, bonds[:2, ::-1]])
    neighbours = [set(bonds[bonds[:, 0] == i, 1]) | set(bonds[bonds[:, 1] == i, 0]) for i in range(n)]
    a = [(i, j, k) for j in range(n) for i in neighbours[j] for k in neighbours[j] if i < k and rng.random() < 0.5]
    dih = [
        (i, j, k, l)
        for j in range(n)
        for k in neighbours[j]
        if j < k
        for i in neighbours[j] - {k}
        for l in neighbours[k] - {j}
        if i != l and rng.random() < 0.3
    ]
    # With "angle yes", LAMMPS (22 Jul 2025) enters atoms 2 and 4 of a dihedral in 4's list only, so that the weight
    # hangs on the order of atoms, unless an angle joins them too. Here one does, as in every complete topology.
    a += [d[1:] for d in dih]
    more = {"angles": np.array(a), "dihedrals": np.array(dih)} if angles else {}
    return Config(cell, x, t, units="lj", charges=rng.uniform(-1, 1, n), bonds=bonds, ntypes=2, **more)


SPECIAL = {
    "default": "",
    "fene": "special_bonds fene",
    "amber": "special_bonds amber",
    "charmm": "special_bonds charmm",
    "dreiding": "special_bonds dreiding",
    "weights": "special_bonds lj 0.1 0.7 0.4 coul 0.0 0.3 0.9",
    "each line starts from zero": "special_bonds lj 0.1 0.7 0.4\nspecial_bonds coul 0.0 0.3 0.9",
    "both": "special_bonds lj/coul 0.0 0.5 1.0",
    "all": "special_bonds lj/coul 1 1 1",
    "angle": "special_bonds lj/coul 0.0 0.3 0.6 angle yes",
    "dihedral": "special_bonds lj/coul 0.0 0.3 0.6 angle no dihedral yes",
    "angle and dihedral": "special_bonds lj/coul 0.2 0.0 0.6 angle yes dihedral yes",
}


@pytest.mark.parametrize("box", ["orthogonal", "triclinic", "small"])
@pytest.mark.parametrize("special", SPECIAL)
def test_lammps(special, box):
    lines = {"weights": COUL, "both": DSF, "default": DSF, "amber": COUL}.get(special, LJ)
    c = molecules(box)
    styles = "\nangle_style zero\nangle_coeff *\ndihedral_style zero\ndihedral_coeff *"
    # LAMMPS wants the weights before it reads the bonds, or rebuilds its lists: both ways are the same.
    agree(lines + styles, c, before=SPECIAL[special].splitlines())


def test_yukawa_and_zbl_take_lammpss_weights():
    c = molecules("orthogonal")
    styles = "\nbond_style zero\nbond_coeff *\nangle_style zero\nangle_coeff *\ndihedral_style zero\ndihedral_coeff *"
    for pair in (
        "pair_style yukawa 1.0 2.5\npair_coeff * * 3.0",
        "pair_style zbl 1.5 2.5\npair_coeff * * 2 2",
        "pair_style coul/wolf 0.3 2.4\npair_coeff * *",
        "pair_style hybrid/overlay lj/cut 2.2 coul/wolf 0.3 2.4\npair_coeff * * lj/cut 1 1\npair_coeff * * coul/wolf",
    ):
        agree(pair + styles, c, before=["special_bonds lj 0.0 0.25 0.5 coul 0.0 0.75 0.3"])


def naive(bonds, n):
    """How many bonds apart, by matrix powers."""
    a = np.zeros((n, n), bool)
    a[bonds[:, 0], bonds[:, 1]] = a[bonds[:, 1], bonds[:, 0]] = True
    level = np.zeros((n, n), int)
    walk = np.eye(n, dtype=bool)
    for k in (1, 2, 3):
        walk = (walk.astype(int) @ a.astype(int)) > 0
        level[(level == 0) & walk] = k
    np.fill_diagonal(level, 0)
    return level


def test_lists_are_breadth_first():
    rng = np.random.default_rng(3)
    for n, m in ((5, 4), (30, 40), (60, 70), (3, 3)):
        bonds = rng.integers(0, n, (m, 2))
        bonds = bonds[bonds[:, 0] != bonds[:, 1]]
        start, other, apart, _ = SpecialBonds().lists(Topology(bonds=bonds), n)
        level = np.zeros((n, n), int)
        for i in range(n):
            row = other[start[i] : start[i + 1]]
            assert len(set(row)) == len(row)
            level[i, row] = apart[start[i] : start[i + 1]]
        np.testing.assert_array_equal(level, naive(bonds, n))


def test_rotated_cell_has_the_same_special_pairs():
    c = molecules("small", angles=False)
    pot = atc.potential("special_bonds lj 0 0.5 0.5\n" + LJ, units="lj")
    f = c.frame()
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    from atc.frame import Cell

    g = f.replace(positions=f.positions @ q.T, cell=Cell(f.cell.vectors @ q.T, f.cell.origin @ q.T))
    a, b = pot.decompose(f), pot.decompose(g)
    assert a.n_bonds == b.n_bonds
    # Rounding of rotated coordinates, amplified by the d⁻¹³ of the closest pairs.
    np.testing.assert_allclose(a.forces_nc @ q.T, b.forces_nc, rtol=0, atol=1e-11 * np.abs(a.forces_nc).max())


def test_coincident_excluded_atoms_are_no_error():
    c = molecules("orthogonal", angles=False)
    i, j = c.bonds[0]
    c.positions[i] = c.positions[j]
    pot = atc.potential("special_bonds lj/coul 0 1 1\n" + LJ, units="lj")
    f = c.frame()
    assert np.isfinite(pot.decompose(f).energy)
    with pytest.raises(AtcError, match="same place"):
        atc.potential("special_bonds lj/coul 1 1 1\n" + LJ, units="lj").decompose(f)


def test_objects_take_special_bonds():
    from atc.decomposers import LennardJones

    c = molecules("triclinic", angles=False)
    pot = atc.potential(LennardJones(1.0, 1.0, 2.5, units="lj", n_types=2), special_bonds="lj/coul 0 0.5 1")
    agree(LJ, c, pot, before=["special_bonds lj/coul 0 0.5 1"])
    with pytest.raises(AtcError, match="three weights"):
        atc.potential(LennardJones(1.0, 1.0, 2.5, units="lj"), special_bonds="lj 0")


@pytest.mark.parametrize(
    "line, says",
    [
        ("special_bonds lj 0 1", "three weights"),
        ("special_bonds lj 0 1 2", "between 0 and 1"),
        ("special_bonds", "needs weights"),
        ("special_bonds one/five yes", "one/five is not supported"),
        ("special_bonds angle maybe", "yes or no"),
    ],
)
def test_bad_lines(line, says):
    with pytest.raises(AtcError, match=says) as e:
        atc.potential(f"{LJ}\n{line}", units="lj")
    assert "line 5" in str(e.value)
