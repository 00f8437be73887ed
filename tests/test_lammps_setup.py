"""What a LAMMPS script makes of its atoms before the run (set, group, delete_bonds, boundary, exclusions ...): script, data file and dump against LAMMPS."""

import numpy as np
import pytest
from lammps_oracle import Config, thermal_lattice
from script_runs import agree, run_script

import atc


def charged(folder, n=4, seed=1):
    """Ions without charges yet, two types."""
    x, t = thermal_lattice(np.diag([3.0 * n] * 3), (n, n, n), kinds=2, seed=seed)
    t[:2] = 1, 2
    Config([3.0 * n] * 3, x, t, units="real", charges=np.zeros(len(x)), masses={1: 20.0, 2: 10.0}, ntypes=2).write_data(folder / "q.data")


def polymers(folder, seed=2):
    """Chains of four with bonds, angles and dihedrals of two types, molecule numbers, charges."""
    x, t = thermal_lattice(np.diag([5.5, 5.5, 11.0]), (4, 4, 8), jitter=0.05, kinds=2, seed=seed)
    t[:2] = 1, 2
    n = len(x)
    rng = np.random.default_rng(seed)
    chain = np.arange(n).reshape(-1, 4)
    bonds = np.concatenate([chain[:, k : k + 2] for k in range(3)])
    angles = np.concatenate([chain[:, k : k + 3] for k in range(2)])
    Config(
        [5.5, 5.5, 11.0], x, t, units="lj", charges=rng.uniform(-1, 1, n), bonds=bonds, bond_types=rng.integers(1, 3, len(bonds)), angles=angles,
        angle_types=rng.integers(1, 3, len(angles)), dihedrals=chain, dihedral_types=rng.integers(1, 3, len(chain)), molecules=1 + np.arange(n) // 4, ntypes=2,
    ).write_data(folder / "p.data")  # fmt: skip


IONS = "units real\natom_style charge\nread_data q.data\npair_style lj/cut/coul/cut 5.0\npair_coeff 1 1 0.1 3.1\npair_coeff 2 2 0.05 2.0\n"
CHAINS = (
    "units lj\natom_style full\npair_style lj/cut/coul/cut 1.6 2.0\nbond_style harmonic\nangle_style harmonic\ndihedral_style harmonic\nread_data p.data\n"
    "pair_coeff * * 1.0 1.0\nbond_coeff 1 30 1.3\nbond_coeff 2 40 1.2\nangle_coeff 1 5 110\nangle_coeff 2 6 100\ndihedral_coeff 1 1.0 1 2\n"
    "dihedral_coeff 2 0.5 -1 1\nspecial_bonds lj 0.0 0.3 0.6 coul 0.1 0.5 0.7\n"
)
SETS = {
    "type": "set type 1 charge -1.0\nset type 2 charge 1.0",
    "atom": "set atom * charge 0.5\nset atom 1*20 charge -1.0\nset atom 64 charge 2",
    "group by type": "group a type 1\nset group a charge -0.7\ngroup b subtract all a\nset group b charge 0.3",
    "group by id": "group a id 1:10 20 30:60:3\ngroup b id <= 5\ngroup c intersect a b\ngroup d union c b\nset group a charge 0.4\nset group d charge -0.8",
    "logical": "group a id <> 7 19\ngroup b id != 3\ngroup c type > 1\nset group b charge 0.2\nset group c charge 0.1\nset group a charge -1",
    "block": "region r block 2 7 INF 6 EDGE 9 units box\nset region r charge 1.0",
    "lattice units": "lattice fcc 2.5\nregion r block 0 2 1 3 0 INF\nset region r charge 1.0",
    "sphere": "region r sphere 6 6 6 4.0 side out units box\nset region r charge -0.9\nregion q sphere 6 6 6 3 units box\nset region q charge 1.3",
    "cylinder": "region r cylinder y 5 6 3.5 1 9 units box\ngroup g region r\nset group g charge 0.6",
    "cone": "region r cone z 5 6 1 5 0 12 units box\nset region r charge 0.6",
    "prism": "region r prism 0 6 0 7 0 8 1 2 -1 units box\nset region r charge 0.6",
    "plane": "region r plane 6 6 6 1 2 -1 units box\nset region r charge 0.6",
    "union": "region a block 0 4 0 12 0 12 units box\nregion b sphere 8 8 8 3 units box\nregion u union 2 a b side out\nregion i intersect 2 a b\nset region u charge 1",
    "moved": "region a block 0 4 0 12 0 12 units box\ndisplace_atoms all move 5 0 0 units box\nset region a charge 1\ndisplace_atoms all move -5 0 0 units box",
    "later types": "set atom 1*30 type 2\nset type 2 charge 1\nset type 1 charge -1\nset atom 5 type 1",
    "variables": "variable q equal 0.25*2\nset type 1 charge ${q}\nset type 2 charge -$(v_q*2)",
    "in a loop": "label l\nvariable t loop 2\nset type $t charge $(v_t-1.5)\nnext t\njump SELF l",
    "conditional": "variable w index on\nif '${w} == on' then 'set type 1 charge 1' 'set type 2 charge -1' else 'set type 1 charge 9'",
    "removed": "set atom * charge 0.3\ndelete_atoms group all compress no\nread_data q.data add merge\nset atom * charge 0.6",
}


@pytest.mark.parametrize("case", SETS)
def test_charges_set_in_the_script(case, tmp_path):
    charged(tmp_path)
    frame, pot = agree(tmp_path, IONS + SETS[case] + "\n")
    assert np.abs(frame.charges).max() > 0
    # A dump with charges shows them itself.
    run_script(tmp_path, IONS + SETS[case] + "\n", columns="id type q x y z fx fy fz")
    own = atc.read(tmp_path / "run.dump", units="real")[0]
    np.testing.assert_allclose(own.charges, frame.charges, rtol=0, atol=1e-15)
    assert pot.complete(own) is not None and (pot.complete(own).charges == own.charges).all()


BONDS = {
    "all bonds": "delete_bonds all bond 1*",
    "one type": "delete_bonds all bond 1",
    "angles": "delete_bonds all angle 2",
    "dihedrals": "delete_bonds all dihedral 1*",
    "multi": "group g id 1:10\ndelete_bonds g multi",
    "any": "group g id 1:9\ndelete_bonds g multi any",
    "atom": "delete_bonds all atom 1",
    "stats": "delete_bonds all stats",
    "undo": "delete_bonds all bond 1\ngroup g id 1:30\ndelete_bonds g bond 1 undo",
    "remove": "delete_bonds all bond 1 remove",
    "remove special": "delete_bonds all bond 1 remove special",
    "special": "delete_bonds all bond 1 special",
    "no angles without bonds": "delete_bonds all multi remove special",
    "set types": "set atom * bond 2\ngroup g id 1:20\nset group g angle 1\nset group g dihedral 2",
    "region": "region r block 0 3 0 9 0 9 units box\ngroup g region r\ngroup g include molecule\ndelete_bonds g multi",
    "create": "create_bonds single/bond 1 4 5\ncreate_bonds single/angle 2 3 4 5",
    "delete atoms": "group g id 1 2 7\ndelete_atoms group g bond yes",
    "delete molecules": "region r block 0 1.5 0 1.5 0 9 units box\ndelete_atoms region r mol yes bond yes",
    "molecules": "set mol 3*5 charge 0.25\ngroup m molecule 2 4:6\nset group m charge -0.5\nset atom 1 mol 9",
}


@pytest.mark.parametrize("case", BONDS)
def test_bonds_switched_in_the_script(case, tmp_path):
    polymers(tmp_path)
    text = CHAINS.replace("read_data p.data", "read_data p.data extra/bond/per/atom 4 extra/angle/per/atom 4 extra/special/per/atom 20")
    frame, pot = agree(tmp_path, text + "pair_modify shift no\n" + BONDS[case] + "\n")


EXCLUDE = {
    "type": "neigh_modify exclude type 1 2",
    "type twice": "neigh_modify exclude type 2 2 exclude type 1 1 delay 0",
    "group": "group a id 1:20\ngroup b type 2\nneigh_modify exclude group a b",
    "same group": "group a id 1:40\nneigh_modify exclude group a a check yes",
    "later members": "group a id 1:10\nneigh_modify exclude group a a\ngroup a id 1:40",
    "molecule/intra": "neigh_modify exclude molecule/intra all",
    "molecule/inter": "group a id 1:30\nneigh_modify exclude molecule/inter a",
    "none": "neigh_modify exclude type 1 1\nneigh_modify exclude none\nneigh_modify exclude type 2 2",
}


@pytest.mark.parametrize("case", EXCLUDE)
def test_excluded_pairs(case, tmp_path):
    polymers(tmp_path)
    agree(tmp_path, CHAINS + EXCLUDE[case] + "\n")
    if case == "same group":  # the same sums in tiles
        pot = atc.potential(tmp_path / "in.run")
        traj = atc.read(tmp_path / "run.dump", units="lj")
        ask = (traj, pot, atc.kernel("quartic", radius=1.5), atc.Grid.regular(shape=(2, 2, 2)), ["stress_potential"])
        whole, tiles = atc.fields(*ask, tolerance=1e-12), atc.fields(*ask, tolerance=1e-12, tiles=(2, 1, 1))
        np.testing.assert_allclose(
            whole.stress_potential, tiles.stress_potential, rtol=0, atol=1e-11 * np.abs(whole.stress_potential).max()
        )
