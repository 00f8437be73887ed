"""XYZ of ASE, OVITO, i-PI and others: whose numbers are in which units, and what is never guessed."""

import warnings

import ase
import ase.io
import numpy as np
import pytest

import atc
from atc.errors import AtcError, AtcWarning
from atc.units import units

BOHR = 0.529177210903
LATTICE = 'Lattice="5 0 0 1 6 0 0 2 7"'
VECTORS = np.array([[5.0, 0, 0], [1, 6, 0], [0, 2, 7]])


@pytest.fixture
def save(tmp_path):
    def save(comment, rows, name="t.extxyz", frames=1):
        path = tmp_path / name
        path.write_text(
            "".join(
                f"{len(rows)}\n{comment.replace('<k>', str(k))}\n" + "".join(f"{r}\n" for r in rows)
                for k in range(frames)
            )
        )
        return path

    return save


@pytest.mark.parametrize("name", ["vel", "velo", "velocities", "velocity"])
def test_velocities_are_read_in_the_units_that_are_given(save, name):
    path = save(
        f"{LATTICE} Properties=species:S:1:pos:R:3:{name}:R:3 Time=2.5 Timestep=7",
        ["Ar 1 2 3 0.1 0.2 0.3", "Kr 2 3 4 -1 -2 -3"],
    )
    v = np.array([[0.1, 0.2, 0.3], [-1, -2, -3]])
    for style in ("metal", "real", "lj", "ase"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            f = atc.read(path, units=style, masses=[40, 80])[0]
        u = units(style)
        np.testing.assert_array_equal(f.velocities, v * u.velocity)
        np.testing.assert_array_equal(f.positions, np.array([[1, 2, 3], [2, 3, 4]]) * u.length)
        np.testing.assert_array_equal(f.cell.vectors, VECTORS * u.length)
        assert f.step == 7 and f.time == (None if style == "ase" else 2.5 * u.time)
        assert f.masses.tolist() == [40 * u.mass, 80 * u.mass]
    with pytest.warns(
        AtcWarning,
        match=rf"its column '{name}' holds velocities in units that the file does not say; they are left out: give "
        r"units=",
    ):
        f = atc.read(path)[0]
    assert f.velocities is None and f.units.name == "ase" and f.step == 7 and f.time is None
    np.testing.assert_array_equal(f.extra[name], v)
    np.testing.assert_allclose(f.masses, [39.948, 83.798], rtol=1e-4)
    assert atc.read(path, units="metal")[0].masses is None  # in a run's units, masses are the run's, not the elements'


@pytest.mark.parametrize("name", ["forces", "force", "frc"])
def test_forces_under_every_name(save, name):
    path = save(f"{LATTICE} Properties=species:S:1:pos:R:3:{name}:R:3", ["Ar 1 2 3 0.1 0.2 0.3"])
    assert atc.read(path)[0].forces.tolist() == [[0.1, 0.2, 0.3]]
    u = units("real")
    np.testing.assert_array_equal(
        atc.read(path, units="real")[0].forces, np.array([[0.1, 0.2, 0.3]]) * u.factor("force")
    )


def test_columns_of_ovito(save):
    """Its exporter writes identifiers, types, an origin; numbers are those of the run it was given."""
    rows = ["7 2 H 1 2 3 0.5 0.25 1.5", "3 1 O 2 3 4 -1 0.75 16"]
    path = save(
        f'{LATTICE} Origin="1 1 1" Properties=id:I:1:type:I:1:species:S:1:pos:R:3:charge:R:1:c_pe:R:1:mass:R:1 pbc="T '
        'F T" Timestep=100',
        rows,
    )
    f = atc.read(path, units="metal")[0]
    assert f.ids.tolist() == [3, 7] and f.types.tolist() == [1, 2] and f.type_names == {1: "O", 2: "H"}
    assert (
        f.charges.tolist() == [-1, 0.5] and f.masses.tolist() == [16, 1.5] and f.extra["c_pe"].tolist() == [0.75, 0.25]
    )
    assert f.cell.origin.tolist() == [1, 1, 1] and f.cell.periodic.tolist() == [True, False, True] and f.step == 100
    g = atc.read(path)[0]
    assert (
        g.units.name == "ase"
        and g.type_names == {1: "O", 2: "H"}
        and g.ids.tolist() == [3, 7]
        and g.masses.tolist() == [16, 1.5]
    )


def test_momenta_mean_what_ase_means(tmp_path):
    rng = np.random.default_rng(1)
    a = ase.Atoms("OH2", positions=rng.normal(size=(3, 3)), cell=[9, 9, 9], pbc=True)
    a.set_masses([16.5, 1.5, 2.5])
    a.set_momenta(rng.normal(size=(3, 3)))
    ase.io.write(tmp_path / "t.extxyz", a)
    f = atc.read(tmp_path / "t.extxyz")[0]
    np.testing.assert_allclose(f.velocities, a.get_velocities(), atol=1e-7)
    np.testing.assert_array_equal(f.masses, a.get_masses())
    g = atc.read(tmp_path / "t.extxyz", masses={"O": 1, "H": 2})[0]  # other masses do not change what the atoms did
    np.testing.assert_array_equal(g.velocities, f.velocities)
    assert g.masses.tolist() == [1, 2, 2] and not {"momenta", "masses"} & set(g.extra)


def test_against_ase_on_what_it_writes(tmp_path):
    rng = np.random.default_rng(2)
    for cell, pbc in (([5, 6, 7], True), (rng.normal(size=(3, 3)) + np.eye(3) * 6, [True, False, True]), (None, False)):
        a = ase.Atoms("SiCSiO", positions=rng.normal(size=(4, 3)), cell=cell, pbc=pbc)
        a.arrays["tags2"] = np.arange(4)
        a.arrays["pair"] = rng.normal(size=(4, 2))
        a.info = {"energy": 1.5, "note": "a b", "flag": True, "list": [1, 2, 3], "step": 12}
        ase.io.write(tmp_path / "t.extxyz", a)
        b = ase.io.read(tmp_path / "t.extxyz")
        f = atc.read(tmp_path / "t.extxyz")[0]
        np.testing.assert_array_equal(f.positions, b.positions)
        if cell is not None:
            np.testing.assert_array_equal(f.cell.vectors, b.cell.array)
        np.testing.assert_array_equal(f.cell.periodic, b.pbc)
        np.testing.assert_array_equal(f.masses, b.get_masses())
        np.testing.assert_array_equal(f.extra["tags2"], np.arange(4))
        np.testing.assert_array_equal(f.extra["pair"], b.arrays["pair"])
        assert [f.type_names[t] for t in f.types] == b.get_chemical_symbols() and f.step == 12


def test_atomic_numbers_names_that_are_no_elements_and_plain_files(save):
    f = atc.read(save(f"{LATTICE} Properties=Z:I:1:pos:R:3", ["14 1 2 3", "6 2 3 4"]))[0]
    assert f.type_names == {1: "Si", 2: "C"}
    f = atc.read(save(f"{LATTICE} Properties=species:S:1:pos:R:3", ["CT1 1 2 3", "HA 2 3 4"]))[0]
    assert f.type_names == {1: "CT1", 2: "HA"} and f.masses is None
    assert atc.read(save(f"{LATTICE} Properties=species:S:1:pos:R:3", ["CT1 1 2 3"]), masses={"CT1": 12})[
        0
    ].masses.tolist() == [12]
    f = atc.read(save("any words", ["O 0 0 0", "H 0 0 1 extra"[:7]], "t.xyz"))[0]
    assert not f.cell.periodic.any() and f.units.name == "ase"
    with pytest.raises(
        AtcError,
        match=r"t.xyz, frame 0, line 2: the first column holds numbers \(1, 2\), and nothing says whether they are "
        r"types",
    ):
        atc.read(save("any words", ["1 0 0 0", "2 0 0 1"], "t.xyz"))[0]
    with pytest.raises(AtcError, match="a topology goes with the unit style of a LAMMPS run"):
        atc.read(save("any words", ["O 0 0 0"], "t.xyz"), topology="x.data")


def ipi(a, b, c, alpha, beta, gamma, unit, cell_unit, step):
    return (
        f"# CELL(abcABC): {a:10.5f} {b:10.5f} {c:10.5f} {alpha:10.5f} {beta:10.5f} {gamma:10.5f}  Traj: "
        f"positions{{{unit}}} Step: {step:10d}  Bead: 0 cell{{{cell_unit}}}"
    )


@pytest.mark.parametrize("unit,factor", [("angstrom", 1.0), ("atomic_unit", BOHR)])
@pytest.mark.parametrize("cell_unit,cell_factor", [("angstrom", 1.0), ("atomic_unit", BOHR)])
def test_cell_of_ipi(save, unit, factor, cell_unit, cell_factor):
    rows = ["O 1.5 2.5 3.5", "H 2.5 3.5 4.5"]
    path = save(ipi(10, 11, 12, 90, 90, 60, unit, cell_unit, 42), rows, "run.pos_0.xyz")
    f = atc.read(path)[0]
    np.testing.assert_allclose(f.positions, np.array([[1.5, 2.5, 3.5], [2.5, 3.5, 4.5]]) * factor, rtol=1e-10)
    vectors = np.array([[10, 0, 0], [5.5, 11 * np.sqrt(0.75), 0], [0, 0, 12]])
    np.testing.assert_allclose(f.cell.vectors, vectors * cell_factor, rtol=1e-10, atol=1e-12)
    assert f.cell.periodic.all() and f.step == 42 and f.time is None and f.units.name == "ase"


def test_other_cells_of_ipi_and_what_is_refused(save):
    rows = ["O 1.5 2.5 3.5"]
    h = "# CELL(H): 10 1 2 0 11 3 0 0 12 Step: 0 positions{angstrom} cell{angstrom}"
    np.testing.assert_array_equal(atc.read(save(h, rows))[0].cell.vectors, [[10, 0, 0], [1, 11, 0], [2, 3, 12]])
    for comment, what in (
        (
            h.replace("positions{angstrom}", ""),
            r"line 2: the comment has i-PI's CELL\(H\) but not the unit of positions",
        ),
        (h.replace("positions{angstrom}", "velocities{angstrom}"), "i-PI wrote velocities here, not positions"),
        (h.replace("cell{angstrom}", "cell{parsec}"), "expected one of angstrom"),
        (h.replace("10 1 2 0", "10 1 2 1"), "not upper triangular"),
        (ipi(10, 11, 12, 90, 90, 190, "angstrom", "angstrom", 0), "is no cell"),
        (ipi(10, 11, 12, 10, 90, 170, "angstrom", "angstrom", 0), "make no cell"),
    ):
        with pytest.raises(AtcError, match=what):
            atc.read(save(comment, rows))[0]
    with pytest.warns(AtcWarning, match="did not name the unit of its cell: atomic_unit, i-PI's own, is taken"):
        f = atc.read(save(h.replace("cell{angstrom}", ""), rows))[0]  # as older versions of i-PI write it
    np.testing.assert_allclose(f.cell.vectors, np.array([[10, 0, 0], [1, 11, 0], [2, 3, 12]]) * BOHR, rtol=1e-12)
    assert f.positions.tolist() == [[1.5, 2.5, 3.5]]
    with pytest.raises(AtcError, match="gives the units of i-PI"):
        atc.read(save(h, rows), units="metal")


@pytest.mark.parametrize(
    "comment,what",
    [
        ('Lattice="5 0 0" Properties=species:S:1:pos:R:3', "zero length"),
        ('Lattice="5 0 0 0 5 0 0 0" Properties=species:S:1:pos:R:3', "Lattice=.*expected 9 or 3 numbers"),
        ('Lattice="5 0 0 0 nan 0 0 0 5" Properties=species:S:1:pos:R:3', "expected 9 or 3 numbers"),
        ("Lattice=[[5,0,0],[0,6,0]] Properties=species:S:1:pos:R:3", "expected 9 or 3 numbers"),
        (f"{LATTICE} Properties=species:S:1:pos:R", "expected name:type:columns"),
        (f"{LATTICE} Properties=species:S:1:pos:R:0", "expected name:type:columns"),
        (f"{LATTICE} Properties=species:S:1:pos:R:3:pos:R:3", "names 'pos' twice"),
        (f"{LATTICE} Properties=species:S:1:dis:R:3", "no positions among"),
        (f"{LATTICE} Properties=species:S:1:pos:S:3", "has no numbers for x: expected R"),
        (f"{LATTICE} Properties=type:S:1:pos:R:3", "has no numbers for type: expected R"),
        (f"{LATTICE} Properties=species:S:1:x:L:1:y:R:1:z:R:1", "has no numbers for x: expected R"),
        (f"{LATTICE} Properties=species:S:1:pos:R:3:mass:R:1", "expected 5 columns"),
        (f'{LATTICE} pbc="T T" Properties=species:S:1:pos:R:3', "expected three of T and F"),
        (f"{LATTICE} Timestep=1.5 Properties=species:S:1:pos:R:3", "the step '1.5' is no whole number"),
        (f"{LATTICE} Time=inf Properties=species:S:1:pos:R:3", "the time 'inf' is no number"),
        (f"{LATTICE} {LATTICE} Properties=species:S:1:pos:R:3", "Lattice is there twice"),
        ('pbc="T T T" Properties=species:S:1:pos:R:3', "there is no Lattice"),
        ('Lattice="5 0 0 0 5 0 5 5 0" Properties=species:S:1:pos:R:3', "zero volume"),
    ],
)
def test_what_contradicts_itself_is_named(save, comment, what):
    with pytest.raises(AtcError, match=what) as caught:
        atc.read(save(comment, ["Ar 1 2 3"]))[0]
    assert "\n" not in str(caught.value) and "t.extxyz" in str(caught.value)


def test_nested_brackets_are_one_value(save):
    f = atc.read(save("Lattice=[[5,0,0],[1,6,0],[0,2,7]] Properties=species:S:1:pos:R:3", ["Ar 1 2 3"]))[0]
    np.testing.assert_array_equal(f.cell.vectors, VECTORS)


def test_frames_are_found_by_counting_lines(save, tmp_path):
    path = save(f"{LATTICE} Properties=species:S:1:pos:R:3 Timestep=<k>", ["Ar 1 2 3", "Ar 2 3 4"], frames=9)
    traj = atc.read(path)
    assert [f.step for f in traj[::-2]] == [8, 6, 4, 2, 0] and len(traj) == 9
    text = path.read_text()
    for cut in range(1, 60):
        path.write_text(text[:-cut])
        with pytest.warns(
            AtcWarning, match=r"its last frame \(number 8, from line 33\) is not complete and is left out"
        ):
            assert len(atc.read(path)) == 8
    path.write_text(text.replace("Timestep=4", "Timestep=4 Time=0.0 Potential_energy=1", 1))
    with pytest.raises(AtcError, match="frame 4, line 18: a frame of another program than the first"):
        list(atc.read(path))


def test_a_crystal_without_its_box_is_not_silently_a_cluster(save):
    x = np.indices((10, 10, 10)).reshape(3, -1).T * 2.5
    ball = x[np.linalg.norm(x - x.mean(axis=0), axis=1) < 12]
    rows = [[f"Ar {a:g} {b:g} {c:g}" for a, b, c in some] for some in (x, ball)]
    with pytest.warns(AtcWarning, match="read as an open cluster"):
        assert not any(atc.read(save("Properties=species:S:1:pos:R:3", rows[0]))[0].cell.periodic)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atc.read(save('Properties=species:S:1:pos:R:3 pbc="F F F"', rows[0]))[0]
        atc.read(save("Properties=species:S:1:pos:R:3", rows[1]))[0]
