"""LAMMPS data files: atom styles, type labels, boxes, and what is wrong with them."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import atc
from atc.errors import AtcError
from atc.readers.lammps.atom_styles import ATOM_STYLES
from atc.readers.lammps.data import LammpsData
from atc.units import units

HEAD = "title\n\n{n} atoms\n2 atom types\n{more}\n-1 9 xlo xhi\n-2 8 ylo yhi\n-3 7 zlo zhi\n\n"
MASSES = "Masses\n\n1 28.0\n2 12.0\n\n"


def text(rows, style="", more="", masses=MASSES, after=""):
    return HEAD.format(n=len(rows), more=more) + masses + f"Atoms{style}\n\n" + "\n".join(rows) + "\n\n" + after


@pytest.fixture
def save(tmp_path):
    def save(content, name="t.data"):
        path = tmp_path / name
        path.write_text(content)
        return path

    return save


VALUES = {
    "id": [7, 3],
    "mol": [4, 5],
    "type": [2, 1],
    "q": [0.5, -1.25],
    "x": [1.5, 2.5],
    "y": [-1.0, 0.25],
    "z": [3.0, 1e-3],
    "ix": [0, -1],
    "iy": [2, 0],
    "iz": [0, 1],
    "mass": [3.5, 4.5],
    "diameter": [2.0, 0.0],
    "density": [1.5, 2.5],
    "bodyflag": [0, 0],
    "ellipsoidflag": [0, 0],
    "lineflag": [0, 0],
    "triangleflag": [0, 0],
}


@pytest.mark.parametrize("images", [False, True])
@pytest.mark.parametrize("style", ATOM_STYLES)
def test_every_atom_style_named_in_the_comment(save, style, images):
    columns = ATOM_STYLES[style].split() + ["ix", "iy", "iz"] * images
    # Columns atc does not know get a number that would be noticed anywhere else.
    rows = [" ".join(str(VALUES.get(c, [77, 88])[k]) for c in columns) for k in range(2)]
    f = atc.read(save(text(rows, f" # {style}" + " 0" * (style == "tdpd"))), units="metal")[0]
    assert f.ids.tolist() == [3, 7] and f.types.tolist() == [1, 2]
    assert f.positions.tolist() == [[2.5, 0.25, 1e-3], [1.5, -1.0, 3.0]]
    assert (f.charges is not None) == ("q" in columns)
    if f.charges is not None:
        assert f.charges.tolist() == [-1.25, 0.5]
    assert (f.images.tolist() if images else f.images) == ([[-1, 0, 1], [0, 2, 0]] if images else None)
    if "mass" in columns:
        assert f.masses.tolist() == [4.5, 3.5]
    elif "diameter" in columns:
        # The mass of a ball, its density as it stands; of a point particle the density column is the mass.
        np.testing.assert_allclose(f.masses, [2.5, 1.5 * np.pi / 6 * 8], rtol=1e-15)
    elif style == "peri":
        assert f.masses is None  # LAMMPS moves its particles by their density
    elif "density" in columns:
        np.testing.assert_allclose(
            f.masses, np.array([2.5, 1.5]) * (1 if style == "ellipsoid" else np.pi / 6), rtol=1e-15
        )
    else:
        assert f.masses.tolist() == [28, 12]
    assert f.cell.vectors.tolist() == np.diag([10.0, 10, 10]).tolist() and f.cell.origin.tolist() == [-1, -2, -3]


@pytest.mark.parametrize(
    "row,more,style",
    [
        ("1 1 0.5 1.0 2.0", "", "atomic"),
        ("1 1 0.5 1.0 2.0 0 0 -1", "", "atomic"),
        ("1 1 -0.5 0.5 1.0 2.0", "", "charge"),
        ("1 1 1 0.5 1.0 2.0", "1 bonds\n1 bond types", "molecular"),
        ("1 1 1 -0.5 0.5 1.0 2.0", "1 bonds\n1 bond types", "full"),
    ],
)
def test_style_from_the_number_of_columns(save, row, more, style):
    rows = [row, "2 " + row[2:]]
    after = "Bonds\n\n1 1 1 2\n" if more else ""
    f = atc.read(save(text(rows, more=more, after=after)), units="metal")[0]
    assert f.positions[0].tolist() == [0.5, 1.0, 2.0]
    assert (f.charges is not None) == (style in ("charge", "full"))
    if more:
        assert f.topology.bonds.tolist() == [[0, 1]]


def test_a_style_that_is_not_certain_is_asked_for(save):
    path = save(text(["1 1 1 0.5 1.0 2.0"]))
    with pytest.raises(
        AtcError,
        match=r"t.data, line 17: which atom style has these 6 columns is not certain .*charge.*write the style .* "
        r"'Atoms # full'",
    ):
        atc.read(path, units="metal")
    with pytest.raises(AtcError, match=r"line 17: which atom style .* \(possible: none\)"):
        atc.read(save(text(["1 1 1"])), units="metal")
    with pytest.raises(AtcError, match=r"line 17: atom style 'full' has the columns .* the line has 5"):
        atc.read(save(text(["1 1 1 2 3"], " # full")), units="metal")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.integers(1, 3), *[st.floats(-1e4, 1e4)] * 7), min_size=1, max_size=12),
    st.integers(0, 2**32),
    st.tuples(*[st.floats(-5, 5, allow_subnormal=False)] * 3),
    st.sampled_from(["lj", "real", "si", "nano"]),
    st.booleans(),
)
def test_round_trip(tmp_path, atoms, seed, tilt, style, labels):
    n = len(atoms)
    ids = np.random.default_rng(seed).permutation(3 * n)[:n] + 1
    names = {1: "Si", 2: "c3", 3: "O-w"}
    label = (lambda t: names[t]) if labels else str
    out = [
        f"LAMMPS data file, units = {style}",
        "",
        f"{n} atoms",
        "3 atom types",
        "0 10 xlo xhi",
        "1 11 ylo yhi",
        "2 12.5 zlo zhi",
    ]
    out += [" ".join(f"{t:.17g}" for t in tilt) + " xy xz yz", ""]
    if labels:
        out += ["Atom Type Labels", "", *(f"{t} {name}" for t, name in names.items()), ""]
    out += [
        "Masses",
        "",
        *(f"{label(t)} {t + 0.5} # {t}" for t in (3, 1, 2)),
        "",
        "Pair Coeffs # lj/cut",
        "",
        "1 1 1",
        "2 2 2",
        "3 3 3",
        "",
    ]
    out += [
        "Atoms # charge",
        "",
        *(
            f"{i} {label(t)} " + " ".join(f"{v:.17g}" for v in (q, x, y, z))
            for i, (t, q, x, y, z, *_) in zip(ids, atoms)
        ),
        "",
    ]
    backwards = list(zip(ids, atoms))[::-1]
    out += ["Velocities", "", *(f"{i} " + " ".join(f"{v:.17g}" for v in a[5:]) for i, a in backwards)]
    path = tmp_path / "h.data"
    path.write_text("\n".join(out) + "\n" * (seed % 2))
    u = units(style)
    f = atc.read(path)[0]
    order = np.argsort(ids)
    a = np.array(atoms, float)[order]
    assert f.units is u
    np.testing.assert_array_equal(f.ids, ids[order])
    np.testing.assert_array_equal(f.types, a[:, 0])
    np.testing.assert_array_equal(f.charges, a[:, 1] * u.charge)
    np.testing.assert_array_equal(f.positions, a[:, 2:5] * u.length)
    np.testing.assert_array_equal(f.velocities, a[:, 5:] * u.velocity)
    np.testing.assert_array_equal(f.masses, (a[:, 0] + 0.5) * u.mass)
    np.testing.assert_array_equal(
        f.cell.vectors, np.array([[10, 0, 0], [tilt[0], 10, 0], [tilt[1], tilt[2], 10.5]]) * u.length
    )
    assert f.type_names == (names if labels else {})


GOOD = text(["1 1 0.5 1.0 2.0", "2 2 1.5 1.0 2.0"], " # atomic", after="Velocities\n\n1 0 0 0\n2 0 0 1\n")


@pytest.mark.parametrize(
    "old,new,message",
    [
        ("2 2 1.5 1.0 2.0", "2 2 1.5 1.0", r"line 18: expected 5 columns \(id type x y z\) of section Atoms, got 4"),
        (
            "2 2 1.5 1.0 2.0",
            "2 2 1.5 nan 2.0",
            r"line 18: column 'y' of section Atoms holds 'nan'",
        ),
        ("2 2 1.5 1.0 2.0", "2 2 1.5 a 2.0", r"line 18: column 'y' of section Atoms holds 'a', expected a number"),
        ("2 2 1.5 1.0 2.0", "1 2 1.5 1.0 2.0", r"atom 1 is there twice in section Atoms"),
        ("2 2 1.5 1.0 2.0", "2 0 1.5 1.0 2.0", r"atom 2 has type 0; types count from 1"),
        (
            "2 2 1.5 1.0 2.0",
            "2 Si 1.5 1.0 2.0",
            r"line 18: column 'type' of section Atoms holds 'Si', expected an integer",
        ),
        (
            "2 2 1.5 1.0 2.0\n",
            "",
            r"line 17: section Atoms has 1 lines, its header announces 2; the file is cut off or damaged",
        ),
        ("2 0 0 1\n", "", r"section Velocities has 1 lines, its header announces 2"),
        ("2 0 0 1", "3 0 0 1", r"sections Atoms and Velocities hold different atoms"),
        ("-2 8 ylo yhi\n", "", r"the header has no complete box"),
        ("-2 8 ylo yhi", "8 8 ylo yhi", r"the box bounds .* enclose no volume"),
        ("-2 8 ylo yhi", "a 8 ylo yhi", r"line 7: expected numbers in 'a 8 ylo yhi'"),
        ("2 atoms", "", r"the header has no '<n> atoms' line"),
        ("2 12.0\n", "2 -12.0\n", r"the mass of 2 is '-12.0', expected a positive number"),
        ("2 12.0\n", "", r"section Masses has 1 lines, its header announces 2"),
        ("2 atom types", "2 atom types\n1 bonds", r"the header announces 1 bonds but there is no section 'Bonds'"),
    ],
)
def test_damage_is_named(save, old, new, message):
    assert old in GOOD
    with pytest.raises(AtcError, match=r"t\.data.*" + message) as caught:
        atc.read(save(GOOD.replace(old, new, 1)), units="metal")[0]
    assert "\n" not in str(caught.value)


def test_units_and_topology_arguments(save):
    path = save(GOOD)
    with pytest.raises(AtcError, match=r"t.data: its units are not in the file"):
        atc.read(path)
    with pytest.raises(AtcError, match="its own topology"):
        atc.read(path, topology=path, units="metal")
    said = save("x, units = real\n" + GOOD.split("\n", 1)[1], "u.data")
    assert atc.read(said).units.name == "real"
    with pytest.raises(AtcError, match=r"u.data says its units are 'real' but the units argument says 'metal'"):
        atc.read(said, units="metal")
    assert atc.read(path, units="metal", masses=[1, 2])[0].masses.tolist() == [1, 2]
    with pytest.raises(AtcError, match="no 'Atoms' section"):
        LammpsData(save("hello\n\n3 atoms\n", "n.data"))
    dump = save(
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\nITEM: ATOMS id type x "
        "y z\n1 3 1 1 1\n",
        "d.dump",
    )
    with pytest.raises(
        AtcError, match=r"d.dump frame 0: section Masses of .*t.data has no mass for type 3, only for 1, 2"
    ):
        atc.read(dump, topology=path, units="metal")[0]
    with pytest.raises(AtcError, match="expected the path of a LAMMPS data file, got int"):
        atc.read(dump, topology=5, units="metal")


def test_third_party_files():
    """Data files that MDAnalysis's tests collected: written by several programs, read here and by MDAnalysis."""
    import MDAnalysis
    from MDAnalysisTests import datafiles as D

    for path in (D.LAMMPSdata, D.LAMMPScnt, D.LAMMPSdata2, D.LAMMPSdata_PairIJ, D.LAMMPShyd):
        u = MDAnalysis.Universe(path, format="DATA", topology_format="DATA")
        f = atc.read(path, units="real")[0]
        order = np.argsort(u.atoms.ids)
        np.testing.assert_array_equal(f.ids, np.sort(u.atoms.ids))
        np.testing.assert_allclose(f.positions, u.atoms.positions[order], rtol=1e-6, atol=1e-6)  # MDAnalysis: float32
        np.testing.assert_allclose(f.masses, u.atoms.masses[order])
        rank = np.argsort(order)
        for name in ("bonds", "angles", "dihedrals", "impropers"):
            theirs = getattr(u, name).indices if hasattr(u, name) else np.zeros((0, 2), int)
            ours = getattr(f.topology, name)
            if len(theirs):
                # MDAnalysis drops repeated terms and turns each to ascending ends.
                mine = {min(tuple(t), tuple(t[::-1])) for t in ours.tolist()}
                assert mine == {min(tuple(t), tuple(t[::-1])) for t in rank[theirs].tolist()}
