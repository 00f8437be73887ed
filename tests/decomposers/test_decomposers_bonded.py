"""Bonds and angles of the topology against LAMMPS, style by style, and what goes wrong with them."""

import pickle

import numpy as np
import pytest
from bonded_systems import CELLS, NO_BOND, agrees, chains, melt
from lammps_oracle import Config

import atc
from atc.decomposers import (
    CharmmAngle,
    CosineAngle,
    FeneBond,
    HarmonicAngle,
    HarmonicBond,
    HybridTerm,
    MorseBond,
    TableBond,
    read_tables,
)
from atc.errors import AtcError
from atc.frame import Cell, Frame, Topology
from atc.units import units

BONDS = {
    "harmonic": "bond_style harmonic\nbond_coeff 1 80 1.1\nbond_coeff 2 50 .9\n",
    "morse": "bond_style morse\nbond_coeff 1 80 1.1 1.0\nbond_coeff 2 50 .9 1.2\n",
    "fene": "bond_style fene\nbond_coeff 1 30 1.5 1 1\nbond_coeff 2 20 1.6 0.8 0.9\n",
    "fene without repulsion": "bond_style fene\nbond_coeff * 30 1.5 0 1\n",
    "fene/expand": "bond_style fene/expand\nbond_coeff 1 30 1.5 1 1 0.1\nbond_coeff 2 30 1.5 1 .9 -0.1\n",
    "hybrid": "bond_style hybrid harmonic fene\nbond_coeff 1 fene 30 1.5 1 1\nbond_coeff 2 harmonic 30 1.1\n",
    "wild card": "bond_style harmonic\nbond_coeff * 80 1.1\nbond_coeff 2 60 1.0\n",
}
ANGLES = {
    "harmonic": "angle_style harmonic\nangle_coeff 1 30 109.5\nangle_coeff 2 20 180\n",
    "cosine": "angle_style cosine\nangle_coeff 1 3.\nangle_coeff 2 -1.5\n",
    "cosine/squared": "angle_style cosine/squared\nangle_coeff 1 3. 100\nangle_coeff 2 2 10\n",
    "cosine/delta": "angle_style cosine/delta\nangle_coeff 1 3. 100\nangle_coeff 2 2 170\n",
    "charmm": "angle_style charmm\nangle_coeff 1 3. 100 10 1.5\nangle_coeff 2 2 110 0 0\n",
    "hybrid": "angle_style hybrid harmonic cosine\nangle_coeff 1 harmonic 30 100\nangle_coeff 2 cosine 4\n",
}


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("style", BONDS)
def test_bonds_equal_lammps(style, cell):
    agrees(melt(cell), BONDS[style])


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("style", ANGLES)
def test_angles_equal_lammps(style, cell):
    d = agrees(melt(cell), NO_BOND + ANGLES[style])
    assert d.n_bonds == 3 * 8 * 9 and not d.notes


@pytest.mark.parametrize(
    "unit_style, lines",
    [
        ("real", "bond_style harmonic\nbond_coeff * 300 1.5\nangle_style charmm\nangle_coeff * 60 109.5 11 2.5\n"),
        ("metal", "bond_style morse\nbond_coeff * 3.1 2.1 1.5\nangle_style cosine/delta\nangle_coeff * 1.1 115\n"),
        (
            "electron",
            "bond_style fene\nbond_coeff * 0.05 2.3 0.01 1.4\nangle_style cosine/squared\nangle_coeff * 0.1 120\n",
        ),
        (
            "nano",
            "bond_style fene/expand\nbond_coeff * 90 2.4 1.1 1.4 .05\nangle_style harmonic\nangle_coeff * 90 120\n",
        ),
    ],
)
def test_other_units(unit_style, lines):
    agrees(melt(unit_style=unit_style, scale=1.5, spread=0.05), lines, reach=4.5)


def table_files(folder):
    """A bond and an angle table whose forces are not quite the derivative of their energies, unevenly spaced, with and
    without FP."""
    out = ["# tables UNITS: lj", ""]
    for name, fp in (("ONE", "N 41 FP -700.0 90.0 EQ 1.02"), ("TWO", "N 23")):
        n = int(fp.split()[1])
        r = 0.6 + 0.9 * np.linspace(0, 1, n) ** 1.3
        out += (
            [name, fp, ""]
            + [
                f"{k + 1} {a:.15g} {40 * (a - 1) ** 2 + np.sin(9 * a):.15g} {-80 * (a - 1) - 8.9 * np.cos(9 * a):.15g}"
                for k, a in enumerate(r)
            ]
            + [""]
        )
    (folder / "bond.table").write_text("\n".join(out))
    out = ["# angles"]
    for name, fp in (("A1", "N 37 FP 0.002 -0.003 EQ 120.0"), ("A2", "N 61")):
        n = int(fp.split()[1])
        t = np.linspace(0, 180, n)
        c = np.pi / 180
        out += ["", name, fp, ""] + [
            f"{k + 1} {a:.15g} {9 * np.cos(2 * c * a) + a / 90:.15g} {18 * c * np.sin(2 * c * a) - 1.1 / 90:.15g}"
            for k, a in enumerate(t)
        ]
    (folder / "angle.table").write_text("\n".join(out) + "\n")


@pytest.mark.parametrize("how", ["linear 31", "linear 1000", "spline 29", "spline 400"])
def test_tables_equal_lammps(tmp_path, how):
    table_files(tmp_path)
    lines = f"bond_style table {how}\nbond_coeff 1 @bond.table ONE\nbond_coeff 2 @bond.table TWO\n"
    agrees(
        melt(),
        lines + f"angle_style table {how}\nangle_coeff 1 @angle.table A1\nangle_coeff 2 @angle.table A2\n",
        folder=tmp_path,
    )
    d = agrees(
        melt("triclinic"),
        f"bond_style hybrid table {how} harmonic\nbond_coeff 1 harmonic 60 1.1\nbond_coeff 2 table @bond.table ONE\n",
        folder=tmp_path,
    )
    assert d.n_bonds == 80


def test_table_in_real_units(tmp_path):
    table_files(tmp_path)
    text = (tmp_path / "bond.table").read_text()
    (tmp_path / "bond.table").write_text(text.replace("UNITS: lj", "UNITS: real"))
    config = melt(unit_style="real", spread=0.1)
    lines = (
        "bond_style table spline 200\nbond_coeff * @bond.table ONE\nangle_style table linear 200\nangle_coeff * "
        "@angle.table A2\n"
    )
    agrees(config, lines, folder=tmp_path)
    # LAMMPS refuses a file that names other units, and so do we.
    (tmp_path / "bond.table").write_text(text.replace("UNITS: lj", "UNITS: metal"))
    with pytest.raises(AtcError, match=r"line 2: .*bond.table is in 'metal' units .*the model in 'real'"):
        atc.potential(lines.replace("@", ""), "real", folder=tmp_path)


def test_bead_spring_melt(tmp_path):
    """Kremer-Grest: FENE + shifted, cut-off Lennard-Jones + bending, all pairs counted but bonded ones as special_bonds
    says."""
    rng = np.random.default_rng(7)
    cell = np.diag([8.4, 8.9, 9.3])
    # Self-avoiding: a snake through a jittered lattice, cut into chains.
    n = np.array([8, 8, 8])
    path = []
    for i in range(8):
        for j in range(8) if i % 2 == 0 else range(7, -1, -1):
            path += [(i, j, k) for k in (range(8) if (i * 8 + j) % 2 == 0 else range(7, -1, -1))]
    x = (np.array(path) + 0.5) / n @ cell + rng.uniform(-0.08, 0.08, (512, 3))
    m = np.arange(512).reshape(32, 16)
    config = Config(
        cell,
        x,
        units="lj",
        bonds=np.stack([m[:, :-1], m[:, 1:]], -1).reshape(-1, 2),
        angles=np.stack([m[:, :-2], m[:, 1:-1], m[:, 2:]], -1).reshape(-1, 3),
        molecules=np.repeat(np.arange(32), 16) + 1,
    )
    pair = "special_bonds fene\npair_style lj/cut 1.122462048309373\npair_modify shift yes\npair_coeff * * 1.0 1.0\n"
    d = agrees(
        config, "bond_style fene\nbond_coeff * 30.0 1.5 1.0 1.0\nangle_style cosine\nangle_coeff * 1.5\n", pair=pair
    )
    assert d.n_bonds > 480 + 3 * 448


def test_shares_and_bonds_of_one_bond_and_one_angle():
    """By hand: a bond of 1.2 and a right angle."""
    top = Topology(
        bonds=np.array([[0, 1]]), bond_types=np.array([1]), angles=np.array([[0, 1, 2]]), angle_types=np.array([1])
    )
    frame = Frame([[1.2, 0, 0], [0, 0, 0], [0, 0.5, 0]], Cell([9.0, 9, 9]), units("metal"), topology=top)
    d = atc.potential(HarmonicBond((3.0, 1.0)), "metal").decompose(frame)
    np.testing.assert_allclose(d.energies_n, [0.06, 0.06, 0])
    np.testing.assert_allclose(d.bonds.G_b, 2 * 3.0 * 0.2 / 1.2)
    np.testing.assert_allclose(d.forces_nc[0], [-1.2, 0, 0], atol=1e-15)
    d = atc.potential(CosineAngle([2.0]), "metal").decompose(frame)
    np.testing.assert_allclose(d.energies_n, 2.0 / 3)
    # U = 2 (1 + cos θ): torque 2 closes... opens the angle; force 2/d on each outer atom, away from the other one.
    np.testing.assert_allclose(d.forces_nc[0], [0, -2.0 / 1.2, 0], atol=1e-15)
    np.testing.assert_allclose(d.forces_nc[2], [-2.0 / 0.5, 0, 0], atol=1e-15)
    assert [(i, j) for i, j in zip(d.bonds.i, d.bonds.j, strict=True)] == [(0, 1), (0, 2), (1, 2)]
    np.testing.assert_allclose(d.bonds.r_bc, [[1.2, 0, 0], [1.2, -0.5, 0], [0, -0.5, 0]])


def test_objects_equal_lines():
    config = melt(unit_style="real", scale=1.5, spread=0.05)
    frame = config.frame()
    lines = (
        "bond_style hybrid harmonic fene\nbond_coeff 1 harmonic 300 1.5\nbond_coeff 2 fene 30 2.3 1 1.4\nangle_style "
        "charmm\nangle_coeff * 60 109.5 11 2.5\n"
    )
    objects = [
        HybridTerm([HarmonicBond({1: (300, 1.5)}, units="real"), FeneBond({2: (30, 2.3, 1, 1.4)}, units="real")]),
        CharmmAngle({1: (60, 109.5, 11, 2.5), 2: (60, 109.5, 11, 2.5)}, units="real"),
    ]
    a, b = atc.potential(lines, "real").decompose(frame), atc.potential(objects).decompose(frame)
    assert a.energy == b.energy and np.array_equal(a.forces_nc, b.forces_nc)
    assert "half" in atc.potential(objects).describe() and "third" in atc.potential(objects).describe()
    c = pickle.loads(pickle.dumps(atc.potential(lines, "real"))).decompose(frame)
    assert c.energy == a.energy


def test_table_objects(tmp_path):
    table_files(tmp_path)
    frame = melt().frame()
    tables = read_tables(
        {1: (tmp_path / "bond.table", "ONE"), 2: (tmp_path / "bond.table", "TWO")}, "bond", points=100, units="lj"
    )
    lines = "bond_style table linear 100\nbond_coeff 1 bond.table ONE\nbond_coeff 2 bond.table TWO\n"
    a = atc.potential(lines, "lj", folder=tmp_path).decompose(frame)
    assert atc.potential(TableBond(tables)).decompose(frame).energy == a.energy


@pytest.mark.parametrize("cell", CELLS)
def test_any_image_of_the_atoms_will_do(cell):
    """Wrapped, unwrapped or scattered over images: bonds go to the closest one. LAMMPS is given wrapped atoms by
    read_data already."""
    config = melt(cell)
    lines = BONDS["harmonic"] + ANGLES["cosine/squared"]
    frame = config.frame()
    pot = atc.potential(lines, "lj")
    d = pot.decompose(frame)
    shifts = np.random.default_rng(1).integers(-4, 5, frame.positions.shape)
    e = pot.decompose(frame.replace(positions=frame.positions + shifts @ frame.cell.vectors))
    np.testing.assert_allclose(e.energy, d.energy, rtol=1e-11)  # positions 5 cells away carry fewer digits
    np.testing.assert_allclose(e.forces_nc, d.forces_nc, rtol=0, atol=1e-10 * abs(d.forces_nc).max())


def test_closest_image_in_a_strongly_tilted_cell():
    """Tilts beyond what LAMMPS allows, and a left-handed, rotated cell: rounding fractions is not enough. Oracle: try
    every image."""
    rng = np.random.default_rng(9)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    for vectors in (
        np.array([[3.0, 0, 0], [8.0, 2.5, 0], [-7.0, 9.0, 2.8]]),
        np.array([[3.0, 0, 0], [1.4, 2.5, 0], [-1.3, 1.2, -2.8]]) @ q,
    ):
        cell = Cell(vectors, periodic=(True, True, False))
        x = rng.uniform(-3, 3, (60, 3)) @ vectors
        top = Topology(bonds=np.arange(60).reshape(30, 2), bond_types=np.ones(30, int))
        d = atc.potential(HarmonicBond((1.0, 0.5)), "metal").decompose(Frame(x, cell, units("metal"), topology=top))
        n = (
            np.stack(np.meshgrid(np.arange(-100, 101), np.arange(-100, 101), [0], indexing="ij"), -1).reshape(-1, 3)
            @ vectors
        )
        for b in range(30):
            every = np.linalg.norm(x[2 * b] - x[2 * b + 1] + n, axis=1)
            np.testing.assert_allclose(np.linalg.norm(d.bonds.r_bc[b]), every.min(), rtol=1e-12)


def test_threads_and_chunks():
    """More bonds than one task holds: the same sums."""
    x, bonds, angles, _ = chains(CELLS["orthogonal"] * 10, n_chains=1800, length=12)
    top = Topology(
        bonds=bonds, bond_types=np.ones(len(bonds), int), angles=angles, angle_types=np.ones(len(angles), int)
    )
    frame = Frame(x, Cell(CELLS["orthogonal"] * 10), units("lj"), topology=top)
    pot = atc.potential([HarmonicBond((3.0, 1.0), units="lj"), HarmonicAngle((3.0, 110.0), units="lj")])
    a, b = pot.decompose(frame), pot.decompose(frame, threads=2)
    np.testing.assert_allclose(b.energy, a.energy, rtol=1e-13)
    np.testing.assert_allclose(b.forces_nc, a.forces_nc, rtol=0, atol=1e-12 * abs(a.forces_nc).max())
    r = x[bonds[:, 0]] - x[bonds[:, 1]]  # unwrapped chains
    stretch = np.linalg.norm(r, axis=1) - 1
    c = np.einsum(
        "tc,tc->t", u := _unit(x[angles[:, 0]] - x[angles[:, 1]]), w := _unit(x[angles[:, 2]] - x[angles[:, 1]])
    )
    assert u.shape == w.shape
    np.testing.assert_allclose(
        a.energy, 3 * (stretch**2).sum() + 3 * ((np.arccos(c) - np.radians(110)) ** 2).sum(), rtol=1e-12
    )
    assert a.n_bonds == len(bonds) + 3 * len(angles)


def _unit(r):
    return r / np.linalg.norm(r, axis=1, keepdims=True)


def _frame(positions, cell=(20.0, 20, 20), bonds=((0, 1),), angles=(), ids=None):
    top = Topology(
        bonds=np.array(bonds, int).reshape(-1, 2), bond_types=np.ones(len(bonds), int),
        angles=np.array(angles, int).reshape(-1, 3), angle_types=np.ones(len(angles), int),
    )  # fmt: skip
    return Frame(positions, Cell(cell), units("lj"), topology=top, ids=ids, source="run.dump frame 3")


def test_overstretched_fene():
    fene = atc.potential(FeneBond((30, 1.5, 1, 1), units="lj"))
    with pytest.raises(
        AtcError,
        match=r"run.dump frame 3: the bond between atoms 12 and 40 \(type 1, style fene\) is 1.5 sigma long.*broken",
    ):
        fene.decompose(_frame([[0, 0, 0], [1.5, 0, 0]], ids=[12, 40]))
    with pytest.raises(AtcError, match=r"same place"):
        fene.decompose(_frame([[0, 0, 0], [0, 0, 0]]))
    # Between 0.949 R0 and R0 LAMMPS caps the force; here the formula holds, and the count says so.
    d = fene.decompose(_frame([[0, 0, 0], [1.49, 0, 0]]))
    np.testing.assert_allclose(d.energy, -0.5 * 30 * 2.25 * np.log(1 - (1.49 / 1.5) ** 2), rtol=1e-13)
    assert list(d.notes.values()) == [1] and "FENE" in next(iter(d.notes))


def test_what_is_missing_is_said(tmp_path):
    pot = atc.potential(HarmonicBond((30, 1.5), units="lj"))
    frame = _frame([[0, 0, 0], [1, 0, 0]])
    with pytest.raises(
        AtcError, match=r"run.dump frame 3: bond_style harmonic needs to know the bonds: give a LAMMPS data file"
    ):
        pot.decompose(frame.replace(topology=None))
    frame.topology.bond_types[0] = 3
    with pytest.raises(AtcError, match=r"bond type 3 is in the topology but has no coefficients.*bond_coeff 3"):
        pot.decompose(frame)
    with pytest.raises(AtcError, match="bond type 3"):
        atc.potential(
            HybridTerm([HarmonicBond({1: (30, 1.5)}, units="lj"), MorseBond({2: (30, 1, 1.5)}, units="lj")])
        ).decompose(frame)
    with pytest.raises(AtcError, match="atoms that are not in this frame"):
        pot.decompose(_frame([[0, 0, 0], [1, 0, 0]], bonds=((0, 2),)))
    with pytest.raises(AtcError, match=r"needs K, r0, got 1 numbers"):
        HarmonicBond((30,))
    with pytest.raises(AtcError, match=r"R0 must be positive"):
        FeneBond((30, 0, 1, 1))
    with pytest.raises(AtcError, match=r"two atoms of the angle 1, 2, 3 are at the same place"):
        atc.potential(CosineAngle((2,), units="lj")).decompose(
            _frame([[0, 0, 0], [0, 0, 0], [1, 1, 1]], angles=((0, 1, 2),))
        )
    table_files(tmp_path)
    table = atc.potential("bond_style table linear 100\nbond_coeff 1 bond.table ONE\n", "lj", folder=tmp_path)
    with pytest.raises(
        AtcError,
        match=r"atoms 1 and 2 \(type 1, style table\) is 1.7 sigma long, outside its table, which runs from 0.6 to 1.5",
    ):
        table.decompose(_frame([[0, 0, 0], [1.7, 0, 0]]))
    # No bonds at all is no error.
    assert pot.decompose(_frame([[0, 0, 0], [1, 0, 0]], bonds=())).energy == 0


@pytest.mark.parametrize(
    "lines, says",
    [
        ("bond_style harmonic\nbond_coeff 1 30\n", r"line 2: bond_coeff of harmonic takes K r0, got 30"),
        ("bond_style harmonic 3\nbond_coeff 1 30 1\n", r"line 1: bond_style harmonic takes no arguments, got 3"),
        ("bond_style harmonic\nbond_coeff 1 30 big\n", r"line 2: .*expected a number for r0, got 'big'"),
        (
            "bond_style table cubic 100\nbond_coeff 1 bond.table ONE\n",
            r"line 1: .*takes linear or spline and a number of points",
        ),
        (
            "bond_style table linear 100\nbond_coeff 1 bond.table THREE\n",
            r"line 2: .*bond.table has no section 'THREE'; it has ONE, TWO",
        ),
        (
            "bond_style table linear 100\nbond_coeff 1 bad.table ONE\n",
            r"bad.table:2: expected the parameters of a bond table.*'N 3 FAST'",
        ),
        (
            "bond_style table linear 100\nbond_coeff 1 bad.table TWO\n",
            r"bad.table:\d+: the section 'TWO' needs 3 lines.*line 3",
        ),
        ("bond_style table linear 100\nbond_coeff 1 bad.table DOWN\n", r"must increase"),
        (
            "angle_style table linear 100\nangle_coeff 1 bond.table ONE\n",
            r"line 2: an angle table must run from 0 to 180 degrees, this one from 0.6 to 1.5",
        ),
        (
            "bond_style hybrid harmonic\nbond_coeff 1 fene 30 1.5 1 1\n",
            r"line 2: .*expected one of harmonic, none after the type, got 'fene'",
        ),
        ("bond_style hybrid harmonic harmonic\nbond_coeff 1 harmonic 30 1.5\n", r"line 1: .*names harmonic twice"),
        (
            "bond_style quintic\nbond_coeff 1 1\n",
            r"line 1: bond_style quintic is not supported: did you mean 'quartic'\? expected one of class2, fene, "
            "fene/expand,",
        ),
    ],
)
def test_lines_that_make_no_sense(tmp_path, lines, says):
    table_files(tmp_path)
    (tmp_path / "bad.table").write_text(
        "ONE\nN 3 FAST\n\nDOWN\nN 2\n\n1 2.0 0 0\n2 1.0 0 0\n\nTWO\nN 3\n\n1 1.0 0 0\n2 1.1 0 0\n3 1.2 0\n"
    )
    with pytest.raises(AtcError, match=says) as e:
        atc.potential(lines, "lj", folder=tmp_path)
    assert "\n" not in str(e.value)
