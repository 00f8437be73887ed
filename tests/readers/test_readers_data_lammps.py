"""LAMMPS data files as LAMMPS itself reads and writes them: atom styles, masses by shape, layout, molecule
templates."""

import gzip

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.decomposers.lammps.data_coeffs import data_file_commands
from atc.errors import AtcError, AtcWarning
from atc.readers.lammps.atom_styles import ATOM_STYLES, AtomStyle
from atc.readers.lammps.data import LammpsData
from atc.readers.lammps.molecule import read_molecule
from atc.units import units

HEAD = "t\n\n2 atoms\n2 atom types\n{more}0 9 xlo xhi\n0 9 ylo yhi\n-0.5 9 zlo zhi\n\n"
MASSES = "Masses\n\n1 1.5\n2 2.5\n\n"
SET = (
    "type 1 charge 0.25",
    "type 1 mol 7",
    "type 1 diameter 0.5",
    "type 1 density 3",
    "type 1 mass 4",
    "type 1 dpd/theta 0.77",
    "type 2 dpd/theta 0.5",
    "type 1 sph/rho 0.22",
    "type 1 rheo/rho 0.22",
    "type 1 shape 1 2 3",
    "type 1 quat 0 0 1 0",
    "type 1 dipole 1 2 3",
    "type 1 image 1 -2 3",
    "type 1 spin/atom 2.0 1 0 0",
)


def of_lammps(lmp):
    """What LAMMPS holds, sorted by id."""
    n = lmp.extract_global("nlocal")
    order = np.argsort(np.array(lmp.numpy.extract_atom("id")[:n]))
    arrays = {k: lmp.numpy.extract_atom(k) for k in ("id", "type", "x", "q", "rmass", "molecule", "v")}
    return {k: None if a is None else np.array(a)[:n][order] for k, a in arrays.items()}


def read_by_lammps(path, style, *before, units_="lj"):
    with lammps_session() as lmp:
        for line in (f"units {units_}", *before, f"atom_style {style}", f"read_data {path}"):
            lmp.command(line)
        return of_lammps(lmp)


def same(d: LammpsData, theirs, masses=True):
    d.use_units(units("lj"))
    np.testing.assert_array_equal(d.ids, theirs["id"])
    np.testing.assert_array_equal(d.types, theirs["type"])
    np.testing.assert_allclose(d.positions, theirs["x"], rtol=1e-14, atol=1e-14)
    assert (d.charges is None) == (theirs["q"] is None)
    if d.charges is not None:
        np.testing.assert_array_equal(d.charges, theirs["q"])
    if masses:
        assert (d.per_atom_mass is None) == (theirs["rmass"] is None)
        if d.per_atom_mass is not None:
            np.testing.assert_allclose(d.per_atom_mass, theirs["rmass"], rtol=1e-14)
    if "mol" in d.extra:
        np.testing.assert_array_equal(d.extra["mol"], theirs["molecule"])


STYLES = [s for s in ATOM_STYLES if s not in ("line", "mesont", "oxdna", "template", "wavepacket", "tdpd", "body")]
STYLES += [
    f"hybrid {s}"
    for s in (
        "charge sphere",
        "full sphere",
        "dipole full",
        "ellipsoid molecular",
        "electron sphere",
        "spin charge",
        "rheo bond",
        "bond ellipsoid oxdna",
        "dielectric dipole",
        "dipole dielectric",
        "dpd charge sphere",
        "amoeba sphere",
        "bpm/sphere full",
    )
]


@pytest.mark.parametrize("style", STYLES)
def test_what_lammps_writes(tmp_path, style):
    """Every atom style of the wheel, with values of its own in every column that `set` reaches; image flags and
    velocities too."""
    path = tmp_path / "w.data"
    bonds = {"angle", "bond", "full", "molecular", "amoeba", "dielectric", "bpm/sphere"} & set(style.split())
    with lammps_session() as lmp:
        lmp.commands_list(
            [
                "units lj",
                f"atom_style {style}",
                "region b block 0 6 0 6 0 6",
                "create_box 2 b" + " bond/types 1 extra/bond/per/atom 2" * bool(bonds),
                "create_atoms 1 single 2 2 2",
                "create_atoms 2 single 4 4.5 1",
            ]
        )
        n = 0
        for line in ("mass * 1.5", *(f"set {s}" for s in SET)):
            if "shape" in line and "ellipsoid" not in style:
                continue
            try:
                lmp.command(line)
                n += 1
            except Exception as e:
                assert "style" in str(e) or "Cannot" in str(e) or "not" in str(e), e
        assert n
        lmp.commands_list(["velocity all set 1 2 3 sum no units box", f"write_data {path}"])
    # Read again by LAMMPS: it writes the density of points of atom_style tri as if of balls of another size.
    theirs = read_by_lammps(path, style)
    given = None if not style.startswith("hybrid") else style
    if given is None:
        assert LammpsData(path).style.name == style
    d = LammpsData(path, atom_style=given)
    same(d, theirs, masses="peri" not in style)
    assert d.images.tolist()[0] == [1, -2, 3]
    np.testing.assert_array_equal(d.velocities, theirs["v"])
    if "peri" not in style and theirs["rmass"] is None:
        assert d.masses(d.types, {}, "") == pytest.approx([1.5, 1.5])
    columns = path.read_text().split("Atoms")[1].split("\n")[2].split()
    assert len(columns) == len(AtomStyle(style, "").columns()) + 3


ELLIPSOID = ("1 ellipsoids\n", "Ellipsoids\n\n1 1 2 3 1 0 0 0\n")
TRIANGLE = ("1 triangles\n", "Triangles\n\n1 0 0 1 2 0 1 1 3 1\n")
SHAPED = {
    "sphere": ("sphere", ["1 1 2.0 1.5 1 1 1", "2 2 0 2.5 2 2 2"], "", ""),
    "sphere, two-dimensional": ("sphere", ["1 1 2.0 1.5 1 1 0", "2 2 0 2.5 2 2 0"], "", ""),
    "bpm/sphere": ("bpm/sphere", ["1 5 1 2.0 1.5 1 1 1", "2 5 2 0 2.5 2 2 2"], "", ""),
    "ellipsoid": ("ellipsoid", ["1 1 1 1.5 1 1 1", "2 2 0 2.5 2 2 2"], *ELLIPSOID),
    "line, two-dimensional": (
        "line",
        ["1 5 1 1 1.5 1 1 0", "2 5 2 0 2.5 2 2 0"],
        "1 lines\n",
        "Lines\n\n1 0.4 0.2 1.6 1.8\n",
    ),
    "tri": ("tri", ["1 5 1 1 1.5 1 1 1", "2 5 2 0 2.5 2 2 2"], *TRIANGLE),
    "body": (
        "body nparticle 1 4",
        ["1 1 1 1.5 1 1 1", "2 2 0 2.5 2 2 2"],
        "1 bodies\n",
        "Bodies\n\n1 1 9\n1\n1 1 1 0 0 0\n0 0 0\n",
    ),
    "smd": ("smd", ["1 1 5 0.5 1.5 .3 .3 1 1 1 1 1 1", "2 2 5 0.5 2.5 .3 .3 2 2 2 2 2 2"], "", ""),
    "charge and sphere": ("hybrid charge sphere", ["1 1 1 1 1 0.3 2.0 1.5", "2 2 2 2 2 0.3 0 2.5"], "", MASSES),
    "full and ellipsoid": ("hybrid full ellipsoid", ["1 1 1 1 1 5 0.3 1 1.5", "2 2 2 2 2 5 0.3 0 2.5"], *ELLIPSOID),
    "sphere and ellipsoid": ("hybrid sphere ellipsoid", ["1 1 1 1 1 2.0 1.5 1", "2 2 2 2 2 2.0 2.5 0"], *ELLIPSOID),
    "ellipsoid and sphere": ("hybrid ellipsoid sphere", ["1 1 1 1 1 1 1.5 2.0", "2 2 2 2 2 0 2.5 2.0"], *ELLIPSOID),
    "sphere and peri": ("hybrid sphere peri", ["1 1 1 1 1 2.0 1.5 .5", "2 2 2 2 2 0 2.5 .5"], "", ""),
    "peri and sphere": ("hybrid peri sphere", ["1 1 1 1 1 .5 1.5 2.0", "2 2 2 2 2 .5 2.5 0"], "", ""),
    "two spheres": ("hybrid sphere bpm/sphere", ["1 1 1 1 1 2.0 1.5 7", "2 2 2 2 2 0 2.5 7"], "", ""),
}


@pytest.mark.parametrize("unit_style", ["lj", "real", "metal"])
@pytest.mark.parametrize("name", SHAPED)
def test_masses_of_shapes(tmp_path, name, unit_style):
    """Density times volume as they stand, in every unit style; positions of triangles and lines are the middles of
    their corners."""
    style, rows, more, after = SHAPED[name]
    path = tmp_path / "s.data"
    path.write_text(HEAD.format(more=more) + "Atoms\n\n" + "\n".join(rows) + "\n\n" + after)
    before = ["dimension 2"] if "two-dim" in name else []
    theirs = read_by_lammps(path, style, *before, units_=unit_style)
    same(LammpsData(path, atom_style=style), theirs)
    frame = atc.read(path, units=unit_style, atom_style=style)[0]
    np.testing.assert_allclose(frame.units.to_user("mass", frame.masses), theirs["rmass"], rtol=1e-14)


def test_shapes_that_do_not_go_with_their_flags(tmp_path):
    path = tmp_path / "s.data"
    style, rows, more, after = SHAPED["ellipsoid"]
    for damaged in (after.replace("1 1 2 3", "2 1 2 3"), "", after + "2 1 1 1 1 0 0 0\n" * 2):
        path.write_text(HEAD.format(more=more * bool(damaged)) + "Atoms\n\n" + "\n".join(rows) + "\n\n" + damaged)
        with pytest.raises(AtcError, match="section Ellipsoids has"):
            LammpsData(path, atom_style=style)


# Layout
# ----------------------------------------------------------------------------------------------------------------------

ATOMS = "Atoms\n\n1 1 1 1 1\n2 2 2 2 2\n"
LAYOUTS = {
    "plain": HEAD.format(more="") + MASSES + ATOMS,
    "indented, with tabs": HEAD.format(more="") + " Masses \n\n 1 1.5\n\t2 2.5\n\n\tAtoms  # atomic\n\n1 1 1 1 1\n2 2 "
    "2 2 2\n",
    "words behind the name": HEAD.format(more="") + MASSES + ATOMS.replace("Atoms\n", "Atoms\natom-ID atom-type x y z"),
    "comment behind the name": HEAD.format(more="") + MASSES + ATOMS.replace("Atoms\n", "Atoms\n# id type x y z"),
    "wrong hint": HEAD.format(more="") + MASSES + ATOMS.replace("Atoms", "Atoms # full"),
    "one line more at the end": HEAD.format(more="") + MASSES + ATOMS + "2 2 3 3 3\n",
    "no line end": (HEAD.format(more="") + MASSES + ATOMS).rstrip("\n"),
    "carriage returns": (HEAD.format(more="") + MASSES + ATOMS).replace("\n", "\r\n"),
    "header with more words": (HEAD.format(more="3 extra bond per atom\n").replace("2 atoms", "2  atoms hello"))
    + MASSES
    + ATOMS,
    "no z bounds": HEAD.format(more="").replace("-0.5 9 zlo zhi\n", "") + MASSES + "Atoms\n\n1 1 1 1 0\n2 2 2 2 0\n",
    "velocities in another order": HEAD.format(more="") + MASSES + ATOMS + "\nVelocities\n\n2 0 0 1\n1 1 1 1\n",
    "labels": HEAD.format(more="") + "Atom Type Labels\n\n1 O\n2 H\n\nMasses\n\nO 1.5\nH 2.5\n\nAtoms\n\n1 1 1 1 1\n2 "
    "H 2 2 2\n",
    "tilted": HEAD.format(more="1.5 0.5 -0.25 xy xz yz\n") + MASSES + ATOMS,
    "numbers": HEAD.format(more="") + MASSES + "Atoms\n\n+1 1 +1.5 1e0 .5\n2 2 2. 2.5E-1 2\n",
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.filterwarnings("ignore::atc.errors.AtcWarning")
def test_layouts_that_lammps_reads(tmp_path, name):
    path = tmp_path / "l.data"
    path.write_text(LAYOUTS[name], newline="")
    theirs = read_by_lammps(path, "atomic", *(["dimension 2"] if "z bounds" in name else []))
    d = LammpsData(path, atom_style="atomic")
    same(d, theirs)
    np.testing.assert_array_equal(d.velocities if d.velocities is not None else np.zeros((2, 3)), theirs["v"])
    assert d.masses(d.types, d.type_names, "").tolist() == [1.5, 2.5]
    if name == "no z bounds":
        assert d.box[1][2] == -0.5 and d.box[0][2, 2] == 1.0
    zipped = tmp_path / "l.data.gz"
    zipped.write_bytes(gzip.compress(path.read_bytes()))
    again = LammpsData(zipped, atom_style="atomic")
    again.use_units(units("lj"))
    np.testing.assert_array_equal(again.positions, d.positions)


def test_what_is_said_of_layouts(tmp_path):
    path = tmp_path / "l.data"
    path.write_text(LAYOUTS["wrong hint"])
    with pytest.warns(
        AtcWarning, match=r"l.data, line 16: the comment behind Atoms says 'full', but the run's atom style is 'atomic'"
    ):
        LammpsData(path, atom_style="atomic")
    path.write_text(LAYOUTS["one line more at the end"])
    with pytest.warns(
        AtcWarning, match=r"l.data, line 18: section Atoms has one line more than the 2 .* left out, as by LAMMPS"
    ):
        LammpsData(path)


HEADER = HEAD.format(more="")
REFUSED = {
    "unknown header": (HEAD.format(more="3 foos\n") + MASSES + ATOMS, r"line 5: '3 foos' is no header line of LAMMPS"),
    "misspelt header": (
        HEADER.replace("2 atom types", "2 atom type") + ATOMS,
        r"line 4: '2 atom type' is neither a header line nor the name",
    ),
    "two blanks in a name": (
        HEADER + "Pair  Coeffs\n\n1 1\n2 2\n\n" + ATOMS,
        r"section 'Pair  Coeffs': LAMMPS wants it written 'Pair Coeffs'",
    ),
    "small letters": (
        HEADER + "masses\n\n1 1\n2 2\n\n" + ATOMS,
        r"line 9: section 'masses': LAMMPS wants it written "
        r"'Masses'",
    ),
    "two lines more": (
        HEADER + ATOMS + "2 2 3 3 3\n3 2 3 3 3\n",
        r"line 13: section Atoms has 4 lines, its header "
        r"announces 2",
    ),
    "id zero": (HEADER + ATOMS.replace("2 2 2", "0 2 2"), r"line 12: atom id 0 in section Atoms: ids count from 1"),
    "id twice": (HEADER + ATOMS.replace("2 2 2", "1 2 2"), r"line 12: atom 1 is there twice in section Atoms"),
    "float for an image": (
        HEADER + "Atoms # atomic\n\n1 1 1 1 1 0 0 0.5\n2 2 2 2 2 0 0 0\n",
        r"line 11: column 'iz' of section Atoms holds '.*', expected an integer",
    ),
    "image flags in some lines": (
        HEADER + "Atoms # atomic\n\n1 1 1 1 1 0 0 0\n2 2 2 2 2\n",
        r"line 12: expected 8 columns",
    ),
    "numbers beyond 64 bits": (
        HEADER + ATOMS.replace("2 2 2", "99999999999999999999 2 2"),
        r"line 12: column 'id' of section Atoms holds '.*', expected an integer",
    ),
    "signs": (
        HEADER + ATOMS.replace("Atoms", "Atoms # atomic").replace("2 2 2 2 2", "2 2 --1 2 2"),
        r"line 12: column 'x' of section Atoms holds '--1', expected a number",
    ),
    "numbers too large": (
        HEADER + ATOMS.replace("2 2 2 2 2", "2 2 1e200 2 2"),
        r"line 12: column 'x' of section Atoms holds 1e\+200: no number",
    ),
    "box too large": (
        HEADER.replace("0 9 xlo", "0 1e300 xlo") + ATOMS,
        r"line 5: '0 1e300 xlo xhi' is no box of atoms",
    ),
    "count beyond the file": (
        HEADER.replace("2 atoms", "1000000000000 atoms") + ATOMS,
        r"line 12: section Atoms has 2 lines, its header announces 10{12}",
    ),
    "count of many digits": (
        HEADER.replace("2 atoms", "9" * 5000 + " atoms") + ATOMS,
        r"line 3: 9+\.\.\. atoms are more than any file holds",
    ),
    "mass of zero": (
        HEADER + MASSES.replace("2.5", "0") + ATOMS,
        r"line 12: the mass of 2 is '0', expected a "
        r"positive number",
    ),
    "bond type": (
        HEAD.format(more="1 bonds\n1 bond types\n") + "Atoms\n\n1 1 1 1 1 1\n2 1 2 2 2 2\n\nBonds\n\n1 2 1 2\n",
        r"line 18: bond type 2 in section Bonds: types "
        r"go from 1 to 1",
    ),
    "bond with itself": (
        HEAD.format(more="1 bonds\n1 bond types\n") + "Atoms\n\n1 1 1 1 1 1\n2 1 2 2 2 2\n\nBonds\n\n1 1 2 2\n",
        r"line 18: a bond of one atom with itself",
    ),
    "bond of an atom that is not there": (
        HEAD.format(more="1 bonds\n1 bond types\n") + "Atoms\n\n1 1 1 1 1 1\n2 1 2 2 2 2\n\nBonds\n\n1 1 2 7\n",
        r"bond 1 in section Bonds has atom 7, which is not in section Atoms",
    ),
    "no atoms": (HEADER.replace("2 atoms", "0 atoms") + MASSES, r"a data file without atoms is no trajectory"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path, name):
    text, message = REFUSED[name]
    path = tmp_path / "r.data"
    path.write_text(text)
    with pytest.raises(AtcError, match=message) as e:
        atc.read(path, units="lj")[0]
    assert "r.data" in str(e.value) and "\n" not in str(e.value) and len(str(e.value)) < 600


def test_sections_of_fixes(tmp_path):
    """A header line of a fix goes with a section of as many lines; what is not read is said."""
    path = tmp_path / "c.data"
    path.write_text(HEAD.format(more="1  crossterms\n") + MASSES + ATOMS + "\nCMAP\n\n1 1 8 10 12 18 20\n")
    d = LammpsData(path)
    assert [s.rows() for s in d.of_fixes.values()] == [[["1", "1", "8", "10", "12", "18", "20"]]]
    path.write_text(HEADER + MASSES + ATOMS + "\nMy-Masses\n\n1 5\n2 6\n")
    with pytest.warns(AtcWarning, match="section 'My-Masses' is none of LAMMPS's own"):
        LammpsData(path)


def test_old_columns_of_spins_are_noticed(tmp_path):
    path = tmp_path / "s.data"
    path.write_text(HEADER + "Atoms # spin\n\n1 1 2.2 0.0 1.0 3.0 1.0 0 0\n2 1 2.2 1.4 1.4 1.4 0 1.0 0\n")
    with pytest.raises(
        AtcError,
        match="line 11: the spin's direction is no unit vector.* id type sp x y z spx spy spz of an old LAMMPS",
    ):
        LammpsData(path)


# Atom styles that are given
# ------------------------------------------------------------------------------------------------------------------

FULL = HEAD.format(more="") + MASSES + "Atoms\n\n1 1 1 0.5 1 1 1\n2 1 2 0.5 2 2 2\n"


def test_atom_style_given(tmp_path):
    path = tmp_path / "f.data"
    path.write_text(FULL)
    with pytest.raises(
        AtcError,
        match=r"line 16: which atom style has these 7 columns is not certain .*full.*or give it: atom_style = \"full\"",
    ):
        atc.read(path, units="lj")
    assert atc.read(path, units="lj", atom_style="full")[0].charges.tolist() == [0.5, 0.5]
    assert (
        atc.read(path, units="lj", atom_style="hybrid full")[0].positions.tolist()
        != atc.read(path, units="lj", atom_style="full")[0].positions.tolist()
    )
    with pytest.raises(
        AtcError,
        match=r"line 16: atom style 'atomic' \(the atom_style given\) has the columns id type x y z .* the line has 7",
    ):
        atc.read(path, units="lj", atom_style="atomic")
    with pytest.raises(AtcError, match="'filled' is no atom style that atc knows, which are hybrid, "):
        atc.read(path, units="lj", atom_style="filled")
    with pytest.raises(AtcError, match="expected a LAMMPS atom style"):
        atc.read(path, units="lj", atom_style="")


def test_atom_style_of_a_topology_and_of_a_scene(tmp_path):
    (tmp_path / "f.data").write_text(FULL)
    dump = (
        "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n-0.5 9\nITEM: ATOMS id "
        "type x y z\n1 1 1 1 1\n2 2 2 2 2\n"
    )
    (tmp_path / "a.dump").write_text(dump.format(0))
    (tmp_path / "b.dump").write_text(dump.format(1))
    traj = atc.read(
        [tmp_path / "a.dump", tmp_path / "b.dump"], topology=tmp_path / "f.data", units="lj", atom_style="full"
    )
    assert [f.charges.tolist() for f in traj] == [[0.5, 0.5]] * 2
    from atc.config.scene import Scene

    text = (
        '[trajectory]\nfile = "{}"\n{}atom_style = "{}"\nunits = "lj"\n[kernel]\nname = "quartic"\nradius = '
        '2.0\n[grid]\nkind = "slab"\naxis = "x"\nbins = 3\n'
        '[fields]\nquantities = ["density"]\n'
    )
    path = tmp_path / "s.toml"
    for file, topology in (("a.dump", 'topology = "f.data"\n'), ("f.data", "")):
        path.write_text(text.format(file, topology, "full"))
        assert Scene.load(path).trajectory()[0].charges.tolist() == [0.5, 0.5]
    path.write_text(text.format("f.data", "", "filled"))
    with pytest.raises(AtcError, match=r"s.toml.*atom_style"):
        Scene.load(path).trajectory()


def test_words_of_atom_styles():
    for words, columns in (
        ("hybrid charge body nparticle 2 5 tdpd 2 full", "id type x y z q bodyflag mass tdpd_0 tdpd_1 mol"),
        ("hybrid template charge sphere 1", "id type x y z mol template_index template_atom diameter density"),
        ("tdpd 3", "id type x y z tdpd_0 tdpd_1 tdpd_2"),
        ("full/kk", "id mol type q x y z"),
        ("hybrid sphere smd", "id type x y z diameter density mol volume kradius x0 y0 z0"),
        ("meso", "id type rho esph cv x y z"),
    ):
        # 'template charge': the molecule template may be called like a style
        assert " ".join(AtomStyle(words, "").columns()) == columns
    for words in ("full charge", "hybrid full nonsense", ["full", 3]):
        with pytest.raises(AtcError):
            AtomStyle(words, "x")


def test_a_hybrid_without_names_does_not_guess_masses(tmp_path):
    """Sub-styles with masses of their own go before section Masses: where they cannot be excluded, no masses are taken
    from it."""
    path = tmp_path / "h.data"
    rows = HEADER + MASSES + "Atoms # hybrid\n\n1 1 1 1 1 0.3 2.0 1.5\n2 2 2 2 2 0.3 0 2.5\n\n"
    path.write_text(rows)
    with pytest.warns(AtcWarning, match="does not name its sub-styles"):
        assert atc.read(path, units="lj")[0].masses is None
    path.write_text(rows + "Velocities\n\n1 0 0 0\n2 0 0 0\n")
    with pytest.warns(AtcWarning, match="does not name its sub-styles"):
        assert atc.read(path, units="lj")[0].masses.tolist() == [1.5, 2.5]


# Templates
# ----------------------------------------------------------------------------------------------------------------------

MOLECULE = (
    "m\n\n3 atoms\n2 bonds\n1 angles\n\nCoords\n\n1 0 0 0\n2 1 0 0\n3 1 1 0\n\nTypes\n\n1 2\n2 1\n3 2\n\nBonds\n\n1 1 "
    "1 2\n2 3 2 3\n\nAngles\n\n1 1 1 2 3\n\n"
    "Special Bond Counts\n\n1 1 1 0\n2 2 0 0\n3 1 1 0\n\nSpecial Bonds\n\n1 2 3\n2 1 3\n3 2 1\n"
)
TEMPLATE = (
    "t\n\n5 atoms\n2 atom types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\nMasses\n\n1 1\n2 2\n\nAtoms # template\n\n4 "
    "1 1 1 2 1 1 1\n5 1 1 2 1 2 1 1\n6 1 1 3 2 2 2 1\n"
    "9 0 0 0 1 5 5 5\n10 2 0 0 2 6 5 5\n"
)


def test_template(tmp_path):
    """Types are the fifth column. Bonds are in the molecule file: with it they are known, without it nothing is
    computed that needs them."""
    (tmp_path / "t.data").write_text(TEMPLATE)
    (tmp_path / "m.txt").write_text(MOLECULE)
    frame = atc.read(tmp_path / "t.data", units="lj")[0]
    assert frame.types.tolist() == [2, 1, 2, 1, 2] and frame.masses.tolist() == [2, 1, 2, 1, 2]
    pot = atc.potential("pair_style lj/cut 2.5\npair_coeff * * 1 1", units="lj")
    with pytest.raises(
        AtcError, match=r"t.data: the bonds of atom_style template are in the molecule files of the run"
    ):
        pot.decompose(frame)
    with pytest.raises(AtcError, match="bonds of atom_style template"):
        atc.potential("bond_style harmonic\nbond_coeff * 1 1", units="lj").decompose(frame)
    pot = atc.potential(
        "pair_style lj/cut 2.5\npair_coeff * * 1 1\nspecial_bonds lj/coul 1 1 1\nbond_style none", units="lj"
    )
    assert np.isfinite(pot.decompose(frame).energy)
    molecule = read_molecule(tmp_path / "m.txt")
    assert molecule.types.tolist() == [2, 1, 2] and molecule.coords.shape == (3, 3)
    d = LammpsData(tmp_path / "t.data", molecules=[molecule.shifted(bond=1)])
    assert d.bonded["Bonds"][0].tolist() == [2, 4] and d.bonded["Bonds"][1].tolist() == [[4, 5], [5, 6]]
    assert d.bonded["Angles"][1].tolist() == [[4, 5, 6]] and not d.untold


@pytest.mark.parametrize(
    "old,new,message",
    [
        ("3 atoms", "4 atoms", r"section Coords has 3 lines, its header announces 4"),
        ("2 3 2 3", "2 3 2 4", r"line 22: expected a type from 1 and 2 different atoms from 1 to 3 in section Bonds"),
        ("3 1 1 0\n\nTypes", "2 1 1 0\n\nTypes", r"section Coords has not one line for each atom from 1 to 3"),
        ("3 2 1\n", "3 2\n", r"the special bonds of atom 3 are not those that the section Bonds makes"),
        ("Angles\n", "Angels\n", r"section 'Angels' is none of a LAMMPS molecule file"),
        ("3 2\n\nBonds", "3 H\n\nBonds", r"column 'type' of section Types holds 'H', expected an integer"),
        ("m\n", '{"application": "LAMMPS"}\n', "JSON"),
    ],
)
def test_molecule_files_that_make_no_sense(tmp_path, old, new, message):
    assert old in MOLECULE
    path = tmp_path / "m.txt"
    path.write_text(MOLECULE.replace(old, new, 1))
    with pytest.raises(AtcError, match=message) as e:
        read_molecule(path)
    assert "m.txt" in str(e.value)


# Coefficients
# ----------------------------------------------------------------------------------------------------------------------


def test_coefficients_of_cross_terms(tmp_path):
    path = tmp_path / "c.data.gz"
    text = HEADER + "BondBond Coeffs\n\n1 3.6 1 1\n\n PairIJ Coeffs\n\n1 1 0.1 3\n1 2 0.2 3\n2 2 0.3 3\n\n" + ATOMS
    path.write_bytes(gzip.compress(text.encode()))
    got = [(c.name, c.words) for c in data_file_commands(path, {"angle": "class2", "pair": "lj/cut"})]
    assert got == [
        ("angle_coeff", ("1", "bb", "3.6", "1", "1")),
        *(("pair_coeff", (a, b, e, "3")) for a, b, e in (("1", "1", "0.1"), ("1", "2", "0.2"), ("2", "2", "0.3"))),
    ]
    path.write_bytes(gzip.compress(text.replace("1 3.6 1 1", "1 class2 3.6 1 1\n2 skip").encode()))
    got = [(c.name, c.words) for c in data_file_commands(path, {"angle": "hybrid"})]
    assert got == [("angle_coeff", ("1", "class2", "bb", "3.6", "1", "1"))]


def test_long_sections_of_coefficients_are_read_to_their_end(tmp_path):
    """More than a megabyte of pairs of types."""
    n = 300
    rows = "".join(f"{i} {j} 0.1 {3 + 0.001 * i:.15f}\n" for i in range(1, n + 1) for j in range(i, n + 1))
    assert len(rows) > 1 << 20
    text = (
        f"t\n\n1 atoms\n{n} atom types\n\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\nPairIJ Coeffs\n\n{rows}\nAtoms # "
        "atomic\n\n1 1 1 1 1\n"
    )
    (tmp_path / "x.data").write_text(text)
    found = data_file_commands(tmp_path / "x.data", {"pair": "lj/cut"})
    assert len(found) == n * (n + 1) // 2 and found[-1].words[:2] == (str(n), str(n))
