"""Bonds, angles and torsions whose energy is a formula, style by style against LAMMPS; where they have no energy;
objects and lines."""

import pickle

import numpy as np
import pytest
from bonded_systems import CELLS, NO_BOND, agrees, melt
from decomposer_checks import potential, sources_are_derivatives
from lammps_oracle import Config, run_lammps

import atc
from atc.decomposers import Class2Angle, Class2Bond, CrossAngle, GaussianBond
from atc.decomposers.images import Images
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame, Topology
from atc.units import units

BONDS = {
    "class2": "1 1.1 30 -20 10\nbond_coeff 2 0.9 50 -30 7",
    "gromos": "1 30 1.1\nbond_coeff 2 20 0.95",
    "nonlinear": "1 30 1.1 0.7\nbond_coeff 2 20 0.95 0.9",
    "harmonic/shift": "1 10 1.0 1.3\nbond_coeff 2 7 0.9 1.8",
    "harmonic/shift/cut": "1 10 1.0 1.3\nbond_coeff 2 7 0.9 1.02",
    "mm3": "1 30 1.1\nbond_coeff 2 20 0.95",
    "fene/nm": "1 30 1.5 1.3 1.1 12 6\nbond_coeff 2 20 1.6 0.8 0.95 9 6.5",
    "gaussian": "1 1.3 2 1.0 0.1 1.0 0.5 0.2 1.3\nbond_coeff 2 0.7 1 0.3 0.4 1.0",
}


def bonds(style):
    return f"bond_style {style}\nbond_coeff {BONDS[style]}\n"


@pytest.mark.parametrize("style", BONDS)
@pytest.mark.parametrize("cell", CELLS)
def test_bonds_equal_lammps(style, cell):
    agrees(melt(cell), bonds(style))


@pytest.mark.parametrize("style", BONDS)
def test_bonds_in_other_units(style):
    """Every coefficient's unit: real has kcal/mol, nano other lengths."""
    agrees(melt(unit_style="real"), bonds(style))
    agrees(melt(unit_style="nano"), bonds(style))


@pytest.mark.parametrize("cell", CELLS)
def test_nanotubes_with_coefficients_of_their_own(cell):
    lines = "bond_style mesocnt\nbond_coeff 1 custom 3 1.1\nbond_coeff 2 custom 2 0.9\n"
    lines += "angle_style mesocnt\nangle_coeff 1 buckling custom 3 2 60\nangle_coeff 2 harmonic custom 1.5\n"
    agrees(melt(cell, unit_style="metal"), lines)
    for wrong, says in (
        ("bond_style mesocnt\nbond_coeff 1 C 10 10 20", "chirality"),
        ("angle_style mesocnt\nangle_coeff 1 custom 3", "harmonic or buckling"),
    ):
        with pytest.raises(AtcError, match=f"line 2: .*{says}"):
            atc.potential(wrong, "metal")


PAIRS = "pair_style lj/cut 1.3\npair_modify shift yes\npair_coeff * * 1.0 0.9\n"
QUARTIC = "bond_style quartic\nbond_coeff 1 1200 -0.55 0.25 1.3 34.6878\nbond_coeff 2 1100 -0.5 0.2 1.04 30\n"


@pytest.mark.parametrize("cell", CELLS)
def test_quartic_bonds_take_the_pair_interaction_away_until_they_break(cell):
    config = melt(cell)
    config.atom_style = "angle"
    d = agrees(config, QUARTIC, pair="special_bonds lj/coul 1 1 1\n" + PAIRS)
    frame, r = config.frame(), np.empty((len(config.bonds), 3))
    Images(frame.cell).vectors_to(frame.positions, *frame.topology.bonds.T.astype(np.int32).copy(), r)
    lengths = np.sqrt((r**2).sum(axis=1))
    broken = np.count_nonzero(lengths > np.where(config.bond_types == 1, 1.3, 1.04))
    assert broken > 10 and [n for what, n in d.notes.items() if "broken" in what] == [broken]
    with pytest.raises(AtcError, match="quartic needs 'special_bonds lj/coul 1 1 1'"):
        atc.potential(PAIRS + QUARTIC, "lj")
    # Weights of charges do not matter without any.
    agrees(config, QUARTIC, pair="special_bonds lj 1 1 1\n" + PAIRS)


def test_special_bonds_of_their_own_weigh_the_pair_interaction():
    """Pairs two bonds apart are listed as bonds of type 2: 0.7 of their Lennard-Jones, 0.3 of their Coulomb interaction
    (LAMMPS's order)."""
    config = melt()
    far = config.angles[:, [0, 2]]
    config.bonds = np.concatenate([config.bonds, far])
    config.bond_types = np.concatenate([np.ones(len(config.bond_types), int), np.full(len(far), 2)])
    config.charges = np.random.default_rng(3).uniform(-1, 1, len(config.positions))
    config.atom_style = "full"
    pair = "special_bonds lj/coul 0 1 1\npair_style lj/cut/coul/cut 2.5\npair_coeff * * 1.0 0.3\n"
    lines = "bond_style hybrid harmonic special\nbond_coeff 1 harmonic 30 1.0\nbond_coeff 2 special 0.3 0.7\n"
    with pytest.warns(AtcWarning, match="first weight to the Coulomb"):
        agrees(config, lines, pair=pair)
    with pytest.raises(AtcError, match="weights of 1-2 neighbours to be 0"):
        atc.potential(pair.replace("0 1 1", "1 1 1") + lines, "lj")
    with pytest.raises(AtcError, match="there is none"):
        atc.potential(lines, "lj")


ANGLES = {
    "quartic": "1 100 3 -2 1\nangle_coeff 2 180 2 1 -0.5",
    "mm3": "1 3 100\nangle_coeff 2 2 170",
    "fourier": "1 3 0.2 0.5 -0.7\nangle_coeff 2 2 1 -1 0.3",
    "fourier/simple": "1 3 0.5 3\nangle_coeff 2 2 -0.4 2.5",
    "cosine/periodic": "1 3 1 4\nangle_coeff 2 2 -1 3",
    "cosine/squared/restricted": "1 3 100\nangle_coeff 2 0.2 180",
    "mwlc": "1 25 1 10 1.3\nangle_coeff 2 3 1 0.5 0.7",
    "cosine/shift": "1 3 100\nangle_coeff 2 2 180",
    "cosine/shift/exp": "1 3 100 2\nangle_coeff 2 2 120 -0.0005",
    "gaussian": "1 1.3 2 1.0 0.4 100 0.5 0.9 130\nangle_coeff 2 0.7 1 0.3 0.8 150",
    "class2": "1 100 3 -2 1\nangle_coeff 1 bb 2 1.1 0.9\nangle_coeff 1 ba 0.7 0.4 1.1 0.9\n"
    "angle_coeff 2 110 2 0.3 0.1\nangle_coeff 2 ba 0.2 0.5 1.0 0.95\nangle_coeff * bb -1 0.9 1.05",
    "class2/p6": "* 100 3 -2 1 0.5 -0.3\nangle_coeff * bb 2 1.1 0.9\nangle_coeff * ba 0.7 0.4 1.1 0.9",
    "cross": "1 2 0.7 0.4 1.1 0.9 100\nangle_coeff 2 1 -0.2 0.5 1.0 0.9 120",
}


def angles(style):
    return f"angle_style {style}\nangle_coeff {ANGLES[style]}\n"


FAULTY = pytest.mark.filterwarnings("ignore:angle_style fourier/simple:atc.errors.AtcWarning")


@FAULTY
@pytest.mark.parametrize("style", ANGLES)
@pytest.mark.parametrize("cell", CELLS)
def test_angles_equal_lammps(style, cell):
    agrees(melt(cell), NO_BOND + angles(style))


@FAULTY
@pytest.mark.parametrize("style", ANGLES)
def test_angles_in_other_units(style):
    # Temperatures at which LAMMPS's own exponentials do not underflow.
    lines = (
        angles(style)
        .replace(" 1.3 2 1.0", " 300 2 1.0")
        .replace("1 25 1 10 1.3", "1 25 1 10 900")
        .replace("0.5 0.7", "0.5 250")
    )
    agrees(melt(unit_style="real"), NO_BOND + lines)
    agrees(melt(unit_style="nano"), NO_BOND + lines)


def bent(angles, arms=(1.0, 1.2), style="lj"):
    """Angles of these sizes (radians), far from each other, all of type 1."""
    n = len(angles)
    x = np.zeros((n, 3, 3))
    x[:, 0, 0] = arms[0]
    x[:, 2] = arms[1] * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
    x += np.arange(n)[:, None, None] * [6.0, 0, 0] + 5.0
    return Config(
        np.diag([6.0 * n + 10, 20, 20]),
        x.reshape(-1, 3),
        units=style,
        angles=np.arange(3 * n).reshape(n, 3),
        angle_types=np.ones(n, int),
    )


@FAULTY
@pytest.mark.parametrize("style", [s for s in ANGLES if s != "cosine/shift/exp"])
def test_angles_near_0_and_180_degrees(style):
    """Down to where sines are clamped (below 0.001), as LAMMPS clamps them, angle by angle; at 1e-8 and exactly in
    line: finite."""
    lines = "\n".join(
        [
            f"angle_style {style}",
            *(f"angle_coeff {c}" for c in ANGLES[style].replace("angle_coeff ", "").split("\n") if c[0] in "1*"),
        ]
    )
    sines = np.array([1e-2, 2e-3] if style == "cosine/squared/restricted" else [1e-2, 2e-3, 5e-4, 1e-5])
    config = bent(np.concatenate([sines, np.pi - sines]))
    d = potential(lines, config).decompose(config.frame())
    res = run_lammps("pair_style zero 5.0\npair_coeff * *\n" + lines, config)
    for mine, theirs in ((d.forces_nc, res.forces_nc), (d.energies_n[:, None], res.energies_n[:, None])):
        for a, b in zip(mine.reshape(-1, 3 * mine.shape[1]), theirs.reshape(-1, 3 * mine.shape[1]), strict=True):
            # An arccos of a number near 1 loses digits in LAMMPS; its energy of cosine/shift has the clamped sine.
            loose = 2e-3 if style == "cosine/shift" and mine.shape[1] == 1 else 1e-9
            np.testing.assert_allclose(a, b, rtol=0, atol=loose * np.abs(b).max() + 1e-14)
    line = bent(np.array([np.pi - 1e-8, np.pi])).frame()
    pot = potential(lines, config)
    if style == "cosine/squared/restricted":
        with pytest.raises(
            AtcError,
            match=r"the angle 4, 5, 6 \(type 1, style cosine/squared/restricted\) is 180 degrees, where its energy is "
            r"not a finite",
        ):
            pot.decompose(line)
    else:
        d = pot.decompose(line, sources=True)
        assert np.isfinite(d.forces_nc).all() and np.isfinite(d.bonds.D_bdc).all()


def test_polynomial_angles_are_smooth_at_their_own_end():
    """θ0 = 180°: (θ − θ0)/sin θ has its limit; nothing is clamped and the force is the energy's derivative."""
    for lines in (
        "quartic\nangle_coeff 1 180 2 1 -0.5",
        "class2\nangle_coeff 1 180 2 1 0\nangle_coeff 1 bb 0 1 1\nangle_coeff 1 ba 0 0 1 1",
        "cosine/shift\nangle_coeff 1 2 180",
    ):
        pot = atc.potential("angle_style " + lines, "lj")
        for s in (1e-2, 1.001e-3, 0.999e-3, 1e-5, 1e-9, 0.0):
            d = pot.decompose(bent(np.array([np.pi - s])).frame())
            assert not d.notes
            # U ≈ ½ k s²: the transverse force on the outer atom is k s/arm.
            k = 1.0 if "shift" in lines else 4.0
            assert d.forces_nc[2, 1] == pytest.approx(-k * s / 1.2, rel=0.05, abs=1e-15)


# LAMMPS's forces of mm3 and fourier/simple are not the derivatives of their energies.
@pytest.mark.parametrize(
    "lines", [*(bonds(s) for s in BONDS), *(angles(s) for s in ANGLES if s not in ("mm3", "fourier/simple"))]
)
def test_sources_are_the_derivatives_of_the_shares(lines):
    config = melt("triclinic", n_chains=2, length=5, seed=4)
    sources_are_derivatives(potential(lines, config), config.frame())


@pytest.mark.parametrize(
    "lines, says",
    [
        (
            "bond_style nonlinear\nbond_coeff 1 30 1.1 0.3",
            r"atoms 1 and 2 \(type 1, style nonlinear\) is 1.5 sigma long, 1.333 of its maximum extension",
        ),
        (
            "bond_style fene/nm\nbond_coeff 1 30 1.5 1 1 12 6",
            r"1.5 sigma long, 1 of the length at which it has infinite energy",
        ),
    ],
)
def test_bonds_without_an_energy(lines, says):
    frame = Frame(
        [[0, 0, 0], [1.5, 0, 0]],
        Cell([20.0, 20, 20]),
        units("lj"),
        topology=Topology(bonds=np.array([[0, 1]]), bond_types=np.array([1])),
    )
    with pytest.raises(AtcError, match=says):
        atc.potential(lines, "lj").decompose(frame)


@pytest.mark.parametrize(
    "lines, says",
    [
        ("bond_style nonlinear\nbond_coeff 1 30 1.1 0", "lambda must be positive"),
        ("bond_style harmonic/shift\nbond_coeff 1 30 1.1 1.1", "r0 and r_c must differ"),
        ("bond_style fene/nm\nbond_coeff 1 30 1.5 1 1 6 6", "n and m must differ"),
        ("bond_style gaussian\nbond_coeff 1 300 2 1 1 1", "line 2: bond_coeff of gaussian: expected T n and then A w "
                                                          "r for each of the n terms, got 5 numbers"),
        ("bond_style gaussian\nbond_coeff 1 300 1.5 1 1 1", "line 2: .*the number of terms must be a whole number"),
        ("bond_style gaussian\nbond_coeff 1 300 1 1 -1 1", "every width w positive"),
        ("bond_style special\nbond_coeff 1 2 0", "between 0 and 1"),
        ("angle_style cosine/periodic\nangle_coeff 1 3 2 1", "B must be 1 or -1"),
        ("angle_style cosine/periodic\nangle_coeff 1 3 1 0.5", "n must be a whole number"),
        ("angle_style mwlc\nangle_coeff 1 3 1 1 0", "T must be positive"),
        ("angle_style fourier\nangle_coeff 1 3 1", "line 2: angle_coeff of fourier takes K C0 C1 C2"),
    ],
)  # fmt: skip
def test_coefficients_that_make_no_sense(lines, says):
    with pytest.raises(AtcError, match=says) as e:
        atc.potential("pair_style lj/cut 2.5\npair_coeff * * 1 1\n" * ("special" in lines) + lines, "lj")
    assert "\n" not in str(e.value)


def test_forces_that_are_no_derivative_are_said():
    with pytest.warns(
        AtcWarning, match="fourier/simple with n = 3: LAMMPS computes forces that are not the derivative"
    ):
        atc.potential("angle_style fourier/simple\nangle_coeff 1 3 1 3", "lj")


def test_terms_of_type_0_and_below_are_off():
    """Broken bonds have type 0, terms that delete_bonds has switched off a negative one."""
    config = melt()
    frame = config.frame()
    pot = atc.potential(bonds("class2") + angles("quartic"), "lj")
    on = np.arange(len(config.bonds)) % 3 > 0
    angle_on = np.arange(len(config.angles)) % 2 > 0
    top = frame.topology
    off = Topology(
        bonds=top.bonds, bond_types=np.where(on, top.bond_types, -top.bond_types * (np.arange(len(on)) % 2)),
        angles=top.angles, angle_types=np.where(angle_on, top.angle_types, -top.angle_types),
    )  # fmt: skip
    without = Topology(
        bonds=top.bonds[on],
        bond_types=top.bond_types[on],
        angles=top.angles[angle_on],
        angle_types=top.angle_types[angle_on],
    )
    a, b = (pot.decompose(frame.replace(topology=t)) for t in (off, without))
    assert a.energy == b.energy and np.array_equal(a.forces_nc, b.forces_nc)


def test_objects_are_what_the_lines_say():
    frame = melt(kinds=1, unit_style="real").frame()
    for term, lines in (
        (
            GaussianBond((300, 2, 1.0, 0.1, 1.0, 0.5, 0.2, 1.3), units="real"),
            "bond_style gaussian\nbond_coeff 1 300 2 1.0 0.1 1.0 0.5 0.2 1.3",
        ),
        (Class2Bond((1.1, 30, -20, 10), units="real"), "bond_style class2\nbond_coeff 1 1.1 30 -20 10"),
        (
            CrossAngle((2, 0.7, 0.4, 1.1, 0.9, 100), units="real"),
            "angle_style cross\nangle_coeff 1 2 0.7 0.4 1.1 0.9 100",
        ),
        (
            Class2Angle((100, 3, -2, 1, 2, 1.1, 0.9, 0.7, 0.4, 1.1, 0.9), units="real"),
            "angle_style class2\nangle_coeff 1 100 3 -2 1\nangle_coeff 1 bb 2 1.1 0.9\nangle_coeff 1 ba 0.7 0.4 1.1 "
            "0.9",
        ),
    ):
        a, b = atc.potential(term).decompose(frame), atc.potential(lines, "real").decompose(frame)
        assert a.energy == b.energy != 0 and np.array_equal(a.forces_nc, b.forces_nc)
        assert pickle.loads(pickle.dumps(atc.potential(term))).decompose(frame).energy == a.energy
    with pytest.raises(AtcError, match="bond style gaussian: expected T n"):
        GaussianBond((300, 2))
