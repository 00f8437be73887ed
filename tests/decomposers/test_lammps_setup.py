"""What a LAMMPS script makes of its atoms before the run (set, group, delete_bonds, boundary, exclusions ...): script,
data file and dump against LAMMPS."""

import numpy as np
import pytest
from lammps_oracle import Config, thermal_lattice
from script_runs import agree, compare, run_script

import atc
from atc.errors import AtcError


def charged(folder, n=4, seed=1):
    """Ions without charges yet, two types."""
    x, t = thermal_lattice(np.diag([3.0 * n] * 3), (n, n, n), kinds=2, seed=seed)
    t[:2] = 1, 2
    Config([3.0 * n] * 3, x, t, units="real", charges=np.zeros(len(x)), masses={1: 20.0, 2: 10.0}, ntypes=2).write_data(
        folder / "q.data"
    )


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
        [5.5, 5.5, 11.0],
        x,
        t,
        units="lj",
        charges=rng.uniform(-1, 1, n),
        bonds=bonds,
        bond_types=rng.integers(1, 3, len(bonds)),
        angles=angles,
        angle_types=rng.integers(1, 3, len(angles)),
        dihedrals=chain,
        dihedral_types=rng.integers(1, 3, len(chain)),
        molecules=1 + np.arange(n) // 4,
        ntypes=2,
    ).write_data(folder / "p.data")


IONS = (
    "units real\natom_style charge\nread_data q.data\npair_style lj/cut/coul/cut 5.0\npair_coeff 1 1 0.1 "
    "3.1\npair_coeff 2 2 0.05 2.0\n"
)
CHAINS = (
    "units lj\natom_style full\npair_style lj/cut/coul/cut 1.6 2.0\nbond_style harmonic\nangle_style "
    "harmonic\ndihedral_style harmonic\nread_data p.data\n"
    "pair_coeff * * 1.0 1.0\nbond_coeff 1 30 1.3\nbond_coeff 2 40 1.2\nangle_coeff 1 5 110\nangle_coeff 2 6 "
    "100\ndihedral_coeff 1 1.0 1 2\n"
    "dihedral_coeff 2 0.5 -1 1\nspecial_bonds lj 0.0 0.3 0.6 coul 0.1 0.5 0.7\n"
)
SETS = {
    "type": "set type 1 charge -1.0\nset type 2 charge 1.0",
    "atom": "set atom * charge 0.5\nset atom 1*20 charge -1.0\nset atom 64 charge 2",
    "group by type": "group a type 1\nset group a charge -0.7\ngroup b subtract all a\nset group b charge 0.3",
    "group by id": "group a id 1:10 20 30:60:3\ngroup b id <= 5\ngroup c intersect a b\ngroup d union c b\nset group "
    "a charge 0.4\nset group d charge -0.8",
    "logical": "group a id <> 7 19\ngroup b id != 3\ngroup c type > 1\nset group b charge 0.2\nset group c charge "
    "0.1\nset group a charge -1",
    "block": "region r block 2 7 INF 6 EDGE 9 units box\nset region r charge 1.0",
    "lattice units": "lattice fcc 2.5\nregion r block 0 2 1 3 0 INF\nset region r charge 1.0",
    "sphere": "region r sphere 6 6 6 4.0 side out units box\nset region r charge -0.9\nregion q sphere 6 6 6 3 units "
    "box\nset region q charge 1.3",
    "cylinder": "region r cylinder y 5 6 3.5 1 9 units box\ngroup g region r\nset group g charge 0.6",
    "cone": "region r cone z 5 6 1 5 0 12 units box\nset region r charge 0.6",
    "prism": "region r prism 0 6 0 7 0 8 1 2 -1 units box\nset region r charge 0.6",
    "plane": "region r plane 6 6 6 1 2 -1 units box\nset region r charge 0.6",
    "union": "region a block 0 4 0 12 0 12 units box\nregion b sphere 8 8 8 3 units box\nregion u union 2 a b side "
    "out\nregion i intersect 2 a b\nset region u charge 1",
    "moved": "region a block 0 4 0 12 0 12 units box\ndisplace_atoms all move 5 0 0 units box\nset region a charge "
    "1\ndisplace_atoms all move -5 0 0 units box",
    "later types": "set atom 1*30 type 2\nset type 2 charge 1\nset type 1 charge -1\nset atom 5 type 1",
    "variables": "variable q equal 0.25*2\nset type 1 charge ${q}\nset type 2 charge -$(v_q*2)",
    "in a loop": "label l\nvariable t loop 2\nset type $t charge $(v_t-1.5)\nnext t\njump SELF l",
    "conditional": "variable w index on\nif '${w} == on' then 'set type 1 charge 1' 'set type 2 charge -1' else 'set "
    "type 1 charge 9'",
    "removed": "set atom * charge 0.3\ndelete_atoms group all compress no\nread_data q.data add merge\nset atom * "
    "charge 0.6",
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
    "delete whole molecules": "group g id 1 2 7\ndelete_atoms group g mol yes",
    "delete molecules somewhere": "displace_atoms all random 0.1 0.1 0.1 7\nregion r sphere 2 2 2 1.6 units box\n"
    "delete_atoms region r mol yes\ndelete_bonds all bond 1",
    "delete switched molecules": "delete_bonds all bond 1\ngroup g id 1 2 7\ndelete_atoms group g mol yes",
    "delete molecules": "region r block 0 1.5 0 1.5 0 9 units box\ndelete_atoms region r mol yes bond yes",
    "molecules": "set mol 3*5 charge 0.25\ngroup m molecule 2 4:6\nset group m charge -0.5\nset atom 1 mol 9",
}


@pytest.mark.parametrize("case", BONDS)
def test_bonds_switched_in_the_script(case, tmp_path):
    polymers(tmp_path)
    text = CHAINS.replace(
        "read_data p.data", "read_data p.data extra/bond/per/atom 4 extra/angle/per/atom 4 extra/special/per/atom 20"
    )
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


@pytest.mark.parametrize(
    "more",
    ["", " exclude group b b exclude type 1 2", "\ngroup c id 20:45\nfix f c setforce NULL NULL NULL"],
    ids=["include", "and exclude", "and a fix of another group"],
)
def test_pairs_of_a_group_only(more, tmp_path):
    """LAMMPS never sets the forces of atoms outside the group to 0 before it adds to them: they are not compared."""
    polymers(tmp_path)
    text = f"group a id 1:60:2\natom_modify first a\ngroup b id 30:50\nneigh_modify include a{more}\n"
    ran = run_script(tmp_path, CHAINS + text)
    pot = atc.potential(tmp_path / "in.run")
    frame = pot.complete(atc.read(tmp_path / "run.dump", units="lj")[0])
    d, inside = pot.stream(frame, forces=True), np.isin(frame.ids, range(1, 61, 2))
    assert d.energy == pytest.approx(ran.energy, rel=1e-12)
    np.testing.assert_allclose(d.virial_cc, ran.virial, rtol=0, atol=1e-12 * np.abs(ran.virial).max())
    np.testing.assert_allclose(d.forces_nc[inside], ran.forces[inside], rtol=0, atol=1e-12 * np.abs(ran.forces).max())


# What a user gives besides the script, and what it must not contradict
# -------------------------------------------------------------------


def test_the_scripts_own_data_file_as_trajectory_has_its_charges(tmp_path):
    charged(tmp_path)
    ran = run_script(tmp_path, IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\n")
    pot = atc.potential(tmp_path / "in.run")
    d = pot.stream(atc.read(tmp_path / "q.data", units="real")[0], forces=True)
    assert pot.units.to_user("energy", d.energy) == pytest.approx(ran.energy, rel=1e-10)


def test_a_scene_needs_script_and_dump_only(tmp_path):
    """Units, bonds, charges, masses come from the script and the data file that it reads."""
    polymers(tmp_path)
    ran = run_script(
        tmp_path,
        CHAINS.replace("units lj\n", "units lj\nboundary p p p\n") + "set type 1 charge 0.5\ndelete_bonds all bond 1\n",
    )
    scene = {
        "trajectory": {"file": str(tmp_path / "run.dump")},
        "potential": {"input": str(tmp_path / "in.run")},
        "kernel": {"name": "quartic", "radius": 1.5},
        "grid": {"kind": "slab", "axis": "z", "bins": 3},
        "fields": {"quantities": ["stress_potential", "density"]},
    }
    from atc.config.scene import Scene

    ds = Scene.load(scene).run()
    assert np.isfinite(ds.stress_potential).all() and float(ds.density.mean()) == pytest.approx(
        128 / (5.5 * 5.5 * 11.0), rel=0.1
    )
    traj, pot = Scene.load(scene).trajectory(), Scene.load(scene).potential()
    assert traj.units.name == "lj" and (traj[0].masses == 1).all() and len(traj[0].topology.weighted.bonds) == 96
    pot.setup = None
    assert pot.stream(traj[0]).energy == pytest.approx(ran.energy, rel=1e-10)


def test_open_boundaries_of_a_data_file_are_the_scripts(tmp_path):
    charged(tmp_path)
    frame, pot = agree(tmp_path, "boundary p f s\n" + IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\n")
    own = pot.complete(atc.read(tmp_path / "q.data", units="real")[0])
    assert own.cell.periodic.tolist() == [True, False, False] == frame.cell.periodic.tolist()
    d = pot.stream(atc.read(tmp_path / "q.data", units="real")[0])
    assert d.energy == pytest.approx(pot.stream(frame).energy, rel=1e-10)
    run_script(tmp_path, IONS + "change_box all boundary p p f\n")
    assert atc.potential(tmp_path / "in.run").complete(
        atc.read(tmp_path / "q.data", units="real")[0]
    ).cell.periodic.tolist() == [
        True,
        True,
        False,
    ]


def test_a_named_data_file_must_not_contradict_the_script(tmp_path):
    charged(tmp_path)
    text = IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\nwrite_data after.data\n"
    ran = run_script(tmp_path, text)
    compare(tmp_path, ran, topology=tmp_path / "after.data")
    compare(tmp_path, ran, topology=tmp_path / "q.data")
    other = (tmp_path / "after.data").read_text().replace(" -1 ", " -2 ")
    (tmp_path / "other.data").write_text(other)
    with pytest.raises(
        AtcError, match=r"other\.data gives atom \d+ the charge -2, .*in\.run the charge -1 \(set, .*line 7\)"
    ):
        compare(tmp_path, ran, topology=tmp_path / "other.data")


def test_bonds_of_a_named_data_file_must_not_contradict_the_script(tmp_path):
    polymers(tmp_path)
    ran = run_script(tmp_path, CHAINS + "delete_bonds all bond 1 remove special\nwrite_data after.data\n")
    compare(tmp_path, ran, topology=tmp_path / "after.data")
    compare(tmp_path, ran, topology=tmp_path / "p.data")
    text = (tmp_path / "p.data").read_text()
    (tmp_path / "copy.data").write_text(text)
    with pytest.raises(AtcError, match=r"copy\.data and .*in\.run \(with delete_bonds, .*\) have different bonds"):
        compare(tmp_path, ran, topology=tmp_path / "copy.data")


def test_the_data_file_may_have_moved(tmp_path):
    charged(tmp_path)
    ran = run_script(tmp_path, IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\n")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "q.data").rename(tmp_path / "elsewhere" / "q.data")
    compare(tmp_path, ran, topology=tmp_path / "elsewhere" / "q.data")
    with pytest.raises(
        AtcError,
        match=r"charges of atoms are needed and not known: .*q\.data, which .*in\.run reads, is not there: dump q too",
    ):
        compare(tmp_path, ran)


def test_a_dump_of_some_atoms_only(tmp_path):
    charged(tmp_path)
    run_script(
        tmp_path,
        IONS
        + "set type 1 charge -1.0\nset type 2 charge 1.0\ngroup g id 1:60\ndump 1 g custom 1 some.dump id type x y "
        "z\nrun 0\n",
    )
    pot = atc.potential(tmp_path / "in.run")
    with pytest.raises(AtcError, match="60 of the 64 atoms .* atom 61 is missing"):
        pot.stream(atc.read(tmp_path / "some.dump", units="real")[0])


def test_a_frame_without_numbers(tmp_path):
    charged(tmp_path)
    run_script(tmp_path, IONS + "set type 1 charge -1.0\n", columns="type x y z fx fy fz")
    pot = atc.potential(tmp_path / "in.run")
    with (
        pytest.warns(UserWarning, match="no 'id' column"),
        pytest.raises(AtcError, match=r"does not number its atoms, so that set \(.*line 7\)"),
    ):
        pot.stream(atc.read(tmp_path / "run.dump", units="real")[0])


CREATED = (
    "units metal\natom_style charge\nlattice rocksalt\n".replace("lattice rocksalt", "lattice fcc 5.6")
    + "region box block 0 3 0 3 0 3\ncreate_box 2 box\ncreate_atoms 1 box\nlattice fcc 5.6 origin 0.5 0.0 "
    "0.0\ncreate_atoms 2 box\n"
    "mass 1 23\nmass 2 35.5\npair_style lj/cut/coul/cut 4.0 6.0\npair_coeff * * 0.01 2.5\ndisplace_atoms all random "
    "0.1 0.1 0.1 493\n"
)


def test_created_atoms_have_charges_by_type(tmp_path):
    frame, pot = agree(tmp_path, CREATED + "set type 1 charge 0.5\nset type 2 charge -0.5\n")
    assert frame.masses is not None and set(np.round(frame.masses, 6)) == {23.0, 35.5}
    agree(
        tmp_path,
        CREATED
        + "group a type 1\nset group a charge 0.5\ngroup b id 5:20\nset group b charge -0.25\nneigh_modify exclude "
        "group a b\n",
    )
    agree(tmp_path, CREATED + "set atom 10*30 type 2\nset type 1 charge 0.4\nset atom 7 charge 2\n")


UNKNOWN = {
    "region": (
        "region r block 0 1 0 1 0 1\nset region r charge 1\n",
        "charges of atoms are needed and not known: .*create_atoms makes atoms whose places",
    ),
    "random": ("set type 1 charge 1\nset type 1 type/fraction 2 0.5 48\nset type 2 charge -1\nset atom 3 type 1", None),
    "types before": ("set type 1 charge 1\nset atom 3 type 2", "charges.*do not show the types they had"),
    "loop over values": ("variable q atom x*0.1\nset type 1 charge v_q", "value of every atom is not known"),
    "between": ("set type 1 charge 1\ncreate_atoms 1 single 0.3 0.3 0.3", "not told apart|made later"),
    "after a run": ("run 0\nset type 1 charge 1\nrun 0", "comes after a run.*run = N"),
    "excluded": (
        "set type 1 charge 1\nregion r block 0 1 0 1 0 1\ngroup g region r\nneigh_modify exclude group g g",
        "who is in group g.*create_atoms",
    ),
    "qeq": ("set type 1 charge 1\nfix 1 all qeq/point 1 10 1e-6 100 coul/slater", "fix qeq/point sets charges"),
}


@pytest.mark.parametrize("case", [c for c in UNKNOWN if UNKNOWN[c][1]])
def test_what_cannot_be_known_of_created_atoms(case, tmp_path):
    lines, says = UNKNOWN[case]
    text = CREATED + lines + "\n"
    if case == "qeq":
        run_script(tmp_path, CREATED)
        (tmp_path / "in.run").write_text(text)
    else:
        run_script(tmp_path, text)
    with pytest.raises(AtcError, match=says) as e:
        pot = atc.potential(tmp_path / "in.run")
        pot.stream(atc.read(tmp_path / "run.dump", units="metal")[0])
    assert "\n" not in str(e.value)
    if case in ("region", "between", "types before", "loop over values"):  # a dump with charges knows them
        agree(tmp_path, text, columns="id type q x y z fx fy fz")


def test_new_numbers_keep_what_belongs_to_the_type(tmp_path):
    """delete_atoms renumbers atoms of atomic systems: charges by type are still known, others are not."""
    charged(tmp_path)
    delete = "region r block 0 4 0 4 0 INF units box\ndelete_atoms region r\n"
    agree(tmp_path, IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\n" + delete)
    agree(tmp_path, IONS + delete + "set type 1 charge -1.0\nset type 2 charge 1.0\n")
    agree(tmp_path, IONS + "delete_atoms overlap 2.9 all all\nset type 1 charge -1.0\nset type 2 charge 1.0\n")
    run_script(tmp_path, IONS + "set atom 1*30 charge -1.0\n" + delete)
    with pytest.raises(AtcError, match="delete_atoms gives atoms new numbers"):
        atc.potential(tmp_path / "in.run").stream(atc.read(tmp_path / "run.dump", units="real")[0])
    agree(tmp_path, IONS + "set atom 1*30 charge -1.0\n" + delete.replace("region r\n", "region r compress no\n"))


def test_replicated_atoms(tmp_path):
    polymers(tmp_path)
    text = CHAINS.replace("read_data p.data\n", "boundary p p p\nread_data p.data\ngroup g id 1:20\nreplicate 2 1 2\n")
    text += (
        "region r block 3 9 2 5 6 INF units box\nset region r charge 0.7\nset group g charge -0.2\ndelete_bonds all "
        "bond 2 remove special\n"
    )
    frame, _ = agree(tmp_path, text)
    assert len(frame) == 512
    agree(
        tmp_path,
        text + "write_data out.data nocoeff\nclear\n" + text.replace("p.data", "out.data").replace("2 1 2", "1 2 1"),
    )


def test_several_data_files(tmp_path):
    polymers(tmp_path)
    text = CHAINS.replace(
        "read_data p.data\n",
        "read_data p.data extra/atom/types 1 extra/bond/types 1 group first\n"
        "read_data p.data add append shift 0 0 11.0 offset 1 1 0 0 0 group second nocoeff\n",
    )
    text = text.replace("bond_coeff 2 40 1.2", "bond_coeff 2*3 40 1.2")
    frame, pot = agree(tmp_path, text + "mass 3 2.0\nset group second charge 0.25\n")
    assert len(frame) == 256 and len(frame.topology.bonds) == 192 and frame.types.max() == 3


def test_coefficients_of_several_data_files(tmp_path):
    """Types are offset in coefficients too; a compressed file holds them as any other."""
    import gzip

    polymers(tmp_path)
    head, body = (tmp_path / "p.data").read_text().split("Masses")
    coeffs = (
        "Pair Coeffs\n\n1 1.0 1.0\n2 0.5 1.1\n\nBond Coeffs\n\n1 30 1.3\n2 40 1.2\n\nAngle Coeffs\n\n1 5 110\n2 6 "
        "100\n\nDihedral Coeffs\n\n1 1.0 1 2\n2 0.5 -1 1\n\n"
    )
    (tmp_path / "p.data").write_text(head + coeffs + "Masses" + body)
    with gzip.open(tmp_path / "c.data.gz", "wt") as f:
        f.write(head + coeffs.replace("1 30 1.3", "1 35 1.25") + "Masses" + body)
    extra = " ".join(f"extra/{k}/types 2" for k in ("atom", "bond", "angle", "dihedral"))
    text = "".join(line + "\n" for line in CHAINS.splitlines() if "_coeff" not in line)
    text = text.replace(
        "read_data p.data", f"read_data p.data {extra}\nread_data c.data.gz add append shift 0 0 11.0 offset 2 2 2 2 0"
    )
    frame, _ = agree(tmp_path, text)
    assert frame.types.max() == 4 and len(frame) == 256


def test_a_data_file_behind_a_condition(tmp_path):
    charged(tmp_path)
    text = IONS.replace(
        "read_data q.data",
        'variable n index 0\nvariable f index q.data\nif "${n} == 0" then "read_data $f" else "read_restart r.1"',
    )
    agree(tmp_path, text + "set type 1 charge -1.0\nset type 2 charge 1.0\n")


def test_types_that_the_frames_do_not_show(tmp_path):
    charged(tmp_path)
    text = IONS + "set type 1 charge 0.5\n"
    with pytest.warns(UserWarning, match="no 'type' or 'element' column"):
        agree(tmp_path, text, columns="id x y z fx fy fz")
    # Elements in the order of their names or places are no types.
    run_script(
        tmp_path,
        text + "dump e all custom 1 e.dump id element x y z fx fy fz\ndump_modify e element B A sort id format float "
        "%.17g\nrun 0\n",
    )
    frame = atc.potential(tmp_path / "in.run").complete(atc.read(tmp_path / "e.dump", units="real")[0])
    assert (frame.types == atc.read(tmp_path / "q.data", units="real")[0].types).all()
    run_script(tmp_path, CREATED, columns="id x y z fx fy fz")
    with (
        pytest.warns(UserWarning, match="no 'type'"),
        pytest.raises(AtcError, match="types of atoms are (needed and )?not known.*dump type too"),
    ):
        atc.potential(tmp_path / "in.run").complete(atc.read(tmp_path / "run.dump", units="metal")[0])


HYBRID = CHAINS.replace(
    "pair_style lj/cut/coul/cut 1.6 2.0", "pair_style hybrid/overlay lj/cut 1.6 coul/cut 2.0 morse 1.8"
).replace(
    "pair_coeff * * 1.0 1.0", "pair_coeff * * lj/cut 1.0 1.0\npair_coeff * * coul/cut\npair_coeff * * morse 0.3 2.0 1.1"
)
MODIFIES = {
    "special": "pair_modify pair lj/cut special lj 0.5 0.25 0.125",
    "both": "pair_modify pair lj/cut special lj/coul 0.5 0.25 0.125\npair_modify pair coul/cut special coul 0.0 1.0 "
    "0.3 special lj 0.2 0.2 0.2",
    "compute": "pair_modify pair morse compute no",
    "compute yes": "pair_modify pair morse compute no\npair_modify pair morse compute yes shift yes",
}


@pytest.mark.parametrize("case", MODIFIES)
def test_sub_styles_with_weights_of_their_own(case, tmp_path):
    polymers(tmp_path)
    agree(tmp_path, HYBRID.replace("special_bonds lj 0.0", "special_bonds lj 0.001") + MODIFIES[case] + "\n")


def test_without_any_pair_forces(tmp_path):
    charged(tmp_path)
    text = "units real\natom_style charge\nread_data q.data\npair_style zero 5.0\npair_coeff * *\n"
    frame, pot = agree(tmp_path, text)
    ds = atc.fields(
        atc.read(tmp_path / "run.dump", units="real"),
        pot,
        atc.kernel("quartic", radius=5.0),
        atc.Grid.slab("z", bins=4),
        ["density", "stress_potential"],
    )
    assert float(ds.density.min()) > 0 and float(abs(ds.stress_potential).max()) == 0.0
    tiles = atc.fields(
        frame, pot, atc.kernel("quartic", radius=5.0), atc.Grid.regular(shape=(2, 2, 2)), ["density"], tiles=(2, 1, 1)
    )
    assert np.isfinite(tiles.density).all()
    assert "no interactions" in atc.potential("pair_style zero 5.0\npair_coeff * *", units="real").describe()
    # Bonds alone, of a style without forces.
    polymers(tmp_path)
    zero = "bond_style zero\nbond_coeff *\nangle_style zero\nangle_coeff *\ndihedral_style zero\ndihedral_coeff *\n"
    agree(tmp_path, "units lj\natom_style full\nread_data p.data\npair_style zero 2.0\npair_coeff * *\n" + zero)


def test_many_body_styles_leave_no_pairs_out(tmp_path):
    (tmp_path / "Si.sw").write_text(
        "Si Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"
    )
    (tmp_path / "in.run").write_text(
        "units metal\npair_style sw\npair_coeff * * Si.sw Si Si\nneigh_modify exclude type 1 2\n"
    )
    with pytest.raises(AtcError, match="line 4: neigh_modify exclude is not supported with pair_style sw"):
        atc.potential(tmp_path / "in.run")


def test_masses_that_the_script_gives(tmp_path):
    charged(tmp_path)
    text = IONS.replace("read_data q.data\n", "read_data q.data\nmass 1 25.0\n")
    run_script(tmp_path, text)
    pot = atc.potential(tmp_path / "in.run")
    for frame in (atc.read(tmp_path / "run.dump", units="real")[0], atc.read(tmp_path / "q.data", units="real")[0]):
        full = pot.complete(frame)
        assert set(full.masses[full.types == 1]) == {25.0} and set(full.masses[full.types == 2]) == {10.0}
    own = atc.read(tmp_path / "run.dump", units="real", masses={1: 7.0, 2: 8.0})[0]  # the user's word goes first
    assert set(pot.complete(own).masses) == {7.0, 8.0}


LATE = {
    "excluded": ("neigh_modify exclude type 1 1", "line 8: neigh_modify exclude type 1 holds in run 2"),
    "charges": ("set type 1 charge 0.5", "charges.*comes after a run"),
    "numbers": ("delete_atoms overlap 0.1 all all", "delete_atoms gives atoms new numbers after a run"),
    "boundary": ("change_box all boundary p p f", "boundaries are not known.*comes after a run"),
}


@pytest.mark.parametrize("case", LATE)
def test_what_comes_between_runs(case, tmp_path):
    charged(tmp_path)
    line, says = LATE[case]
    (tmp_path / "in.run").write_text(IONS + "run 0\n" + line + "\nrun 0\n")
    frame = atc.read(tmp_path / "q.data", units="real")[0]
    with pytest.raises(AtcError, match=says):
        atc.potential(tmp_path / "in.run").stream(frame)
    assert np.isfinite(atc.potential(tmp_path / "in.run", run=1).stream(frame).energy)


def test_a_group_that_changes_between_runs(tmp_path):
    polymers(tmp_path)
    ran = run_script(tmp_path, CHAINS + "group g id 1:20\nneigh_modify exclude group g g\nrun 0\ngroup g id 21:40\n")
    with pytest.raises(AtcError, match="who is in group g.*comes after a run"):
        run_script(tmp_path, (tmp_path / "in.run").read_text() + "run 0\n")
        compare(tmp_path, ran)


def test_atoms_that_may_be_lost(tmp_path):
    charged(tmp_path)
    text = IONS + "set type 1 charge -1.0\nset type 2 charge 1.0\ngroup g id 1:60\n"
    run_script(tmp_path, text + "thermo_modify lost ignore\ndump 1 g custom 1 some.dump id type x y z\nrun 0\n")
    assert np.isfinite(
        atc.potential(tmp_path / "in.run").stream(atc.read(tmp_path / "some.dump", units="real")[0]).energy
    )


def test_atoms_that_a_fix_brings(tmp_path):
    """Their charges are known from the frames only."""
    charged(tmp_path)
    text = (
        IONS
        + "set type 1 charge -1.0\nset type 2 charge 1.0\nregion r block EDGE EDGE EDGE EDGE EDGE EDGE units box\nfix "
        "d all deposit 3 2 1 493 region r near 1.0\n"
    )
    text += "fix n all nve\ntimestep 0.01\nrun 5\n"
    run_script(tmp_path, text)
    with pytest.raises(AtcError, match="charges of atoms are needed and not known.*fix deposit adds or removes atoms"):
        atc.potential(tmp_path / "in.run").stream(atc.read(tmp_path / "run.dump", units="real")[0])
    agree(tmp_path, text, columns="id type q x y z fx fy fz")


def test_bonds_of_template_molecules(tmp_path):
    """atom_style template: the bonds are in the molecule file that the script names; without it they are not known, and
    that is said."""
    from test_readers_data_lammps import MOLECULE, TEMPLATE

    (tmp_path / "t.data").write_text(TEMPLATE)
    script = (
        "units lj\nmolecule m m.txt\natom_style template m\npair_style lj/cut 2.5\npair_modify mix "
        "arithmetic\nbond_style harmonic\nangle_style harmonic\nread_data t.data\n"
    )
    script += "pair_coeff * * 1 1\nbond_coeff * 100 1\nangle_coeff * 10 100\nrun 0\n"
    (tmp_path / "in.run").write_text(script)
    pot = atc.potential(tmp_path / "in.run")
    frame = atc.read(tmp_path / "t.data", units="lj")[0].replace(topology=None)
    with pytest.raises(AtcError, match="t.data: the bonds of atom_style template are in the molecule files"):
        pot.complete(frame)
    (tmp_path / "m.txt").write_text(MOLECULE)
    whole = atc.potential(tmp_path / "in.run").complete(frame)
    assert len(whole.topology.bonds) > 0 and whole.topology.bonds.max() < len(frame)
