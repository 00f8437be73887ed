"""Torsions and impropers: LAMMPS, energy sources, planar and collinear chains, phases that are refused."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, sources_are_derivatives
from lammps_oracle import Config

import atc
from atc.decomposers.bonded.dihedral import (
    COLLINEAR,
    FourierTorsion,
    HarmonicTorsion,
    MultiHarmonicTorsion,
    NHarmonicTorsion,
    OPLSTorsion,
)
from atc.decomposers.bonded.improper import CvffImproper, HarmonicImproper
from atc.frame import Cell, Frame, Topology
from atc.units import units

CELLS = {"orthogonal": np.diag([9.0, 10.0, 11.0]), "tilted": np.array([[9.0, 0, 0], [4.1, 10.0, 0], [-3.9, 4.5, 11.0]])}


def chains(cell="tilted", n=6, types=1, kind="dihedrals", seed=0, style="real"):
    """Chains of four atoms across the faces of a small cell, with bonds of 0.6-2 Å and no angle near 180°."""
    rng = np.random.default_rng(seed)
    x = []
    for _ in range(n):
        while True:
            steps = rng.normal(size=(3, 3))
            steps *= (rng.uniform(0.6, 2.0, 3) / np.linalg.norm(steps, axis=1))[:, None]
            sines = [
                np.linalg.norm(np.cross(steps[k], steps[k + 1]))
                / np.linalg.norm(steps[k])
                / np.linalg.norm(steps[k + 1])
                for k in (0, 1)
            ]
            if min(sines) > 0.3:
                break
        x.append(np.concatenate([[np.zeros(3)], np.cumsum(steps, axis=0)]) + rng.uniform(0, 10, 3))
    x = np.concatenate(x)
    c = CELLS[cell]
    s = np.floor(x @ np.linalg.inv(c))
    terms = np.arange(4 * n).reshape(n, 4)
    return Config(c, x - s @ c, units=style, **{kind: terms, kind[:-1] + "_types": rng.integers(1, types + 1, n)})


DIHEDRALS = {
    "harmonic": ["1 1.3 1 3", "2 0.7 -1 2", "3 2.0 -1 0"],
    "charmm": ["1 1.3 3 0 0.0", "2 0.7 2 180 0.0", "3 0.4 5 -180 0.0"],
    "opls": ["1 1.3 -0.4 0.8 0.25", "2 0 1.5 0.3 0", "3 0.1 0.2 0.3 -0.4"],
    "multi/harmonic": ["1 1.1 -2.3 0.7 1.9 0.4", "2 0.2 0 1 0 0", "3 1 2 3 4 5"],
    "nharmonic": ["1 3 1.1 -2.3 0.7", "2 1 0.5", "3 7 1 2 3 4 5 -3 0.5"],
    "fourier": ["1 2 1.1 1 0 0.4 3 180", "2 1 0.5 4 180", "3 3 0.1 1 0 0.2 2 180 0.3 6 0"],
}
IMPROPERS = {"harmonic": ["1 2.1 0.0", "2 1.3 35.26", "3 0.8 180.0"], "cvff": ["1 1.3 1 3", "2 0.7 -1 2", "3 0.5 1 1"]}


def lines_of(kind, style, coeffs):
    return [f"{kind}_style {style}", *(f"{kind}_coeff {c}" for c in coeffs)]


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("style", DIHEDRALS)
def test_dihedrals_agree_with_lammps(style, cell):
    config = chains(cell, n=12, types=3)
    lines = lines_of("dihedral", style, DIHEDRALS[style])
    d, _ = agrees_with_lammps(
        potential("\n".join(lines), config), ["pair_style zero 5.0 nocoeff", "pair_coeff * *", *lines], config
    )
    # Torsions of U = constant (type 2 of nharmonic, type 3 of harmonic) have no bonds; all others have six.
    assert d.n_bonds <= 6 * 12


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("style", IMPROPERS)
def test_impropers_agree_with_lammps(style, cell):
    config = chains(cell, n=12, types=3, kind="impropers")
    lines = lines_of("improper", style, IMPROPERS[style])
    agrees_with_lammps(
        potential("\n".join(lines), config), ["pair_style zero 5.0 nocoeff", "pair_coeff * *", *lines], config
    )


def test_hybrid_styles_agree_with_lammps():
    config = chains(n=12, types=4, seed=9)
    lines = [
        "dihedral_style hybrid opls harmonic nharmonic",
        "dihedral_coeff 1 opls 1.3 -0.4 0.8 0.25",
        "dihedral_coeff 2*3 harmonic 0.7 -1 2",
    ]
    lines += ["dihedral_coeff 4 nharmonic 3 1.1 -2.3 0.7"]
    agrees_with_lammps(
        potential("\n".join(lines), config), ["pair_style zero 5.0 nocoeff", "pair_coeff * *", *lines], config
    )


@pytest.mark.parametrize("kind,style", [*(("dihedral", s) for s in DIHEDRALS), *(("improper", s) for s in IMPROPERS)])
def test_sources_are_the_derivatives_of_the_shares(kind, style):
    config = chains(n=3, types=3, kind=kind + "s", seed=3)
    coeffs = IMPROPERS[style] if kind == "improper" else DIHEDRALS[style]
    sources_are_derivatives(potential("\n".join(lines_of(kind, style, coeffs)), config), config.frame())


@pytest.mark.parametrize("partition", ["equal", "inner", (0.1, 0.2, 0.3, 0.4)])
def test_partitions_change_shares_and_nothing_else(partition):
    frame = chains(n=3, seed=5).frame()
    term = OPLSTorsion((1.3, -0.4, 0.8, 0.25), units="real", partition=partition)
    pot = atc.potential(term)
    d = sources_are_derivatives(pot, frame)
    equal = atc.potential(OPLSTorsion((1.3, -0.4, 0.8, 0.25), units="real")).decompose(frame, sources=True)
    np.testing.assert_array_equal(d.forces_nc, equal.forces_nc)
    w = {"equal": [0.25] * 4, "inner": [0, 0.5, 0.5, 0]}.get(partition, partition)
    per_term = equal.energies_n.reshape(-1, 4).sum(axis=1)
    np.testing.assert_allclose(d.energies_n.reshape(-1, 4), np.outer(per_term, w), rtol=1e-12)
    assert ("1/4" in term.describe()) == (partition == "equal")


def test_g_is_the_derivative_by_each_squared_distance():
    """G of the six distances against the derivative of cos φ as a function of the distances alone, mpmath, 50
    digits."""
    mp = pytest.importorskip("mpmath")
    mp.mp.dps = 50
    rng = np.random.default_rng(2)
    x = rng.normal(size=(4, 3))
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    xi = [mp.mpf(float(((x[p] - x[q]) ** 2).sum())) / 2 for p, q in pairs]

    def energy(*xi):
        d12, d13, d14, d23, d24, d34 = (2 * v for v in xi)
        b12, b23 = (d13 - d12 - d23) / 2, (d24 - d23 - d34) / 2
        b13 = (d14 - d12 - d23 - d34) / 2 - b12 - b23
        cos = (b12 * b23 - b13 * d23) / mp.sqrt((d12 * d23 - b12**2) * (d23 * d34 - b23**2))
        return 3 * (1 + mp.cos(3 * mp.acos(cos)))

    frame = Frame(
        x,
        Cell(np.eye(3) * 50, periodic=(False,) * 3),
        units("metal"),
        topology=Topology(dihedrals=np.array([[0, 1, 2, 3]]), dihedral_types=np.array([1])),
    )
    d = atc.potential(HarmonicTorsion((3.0, 1, 3))).decompose(frame)
    assert [tuple(p) for p in zip(d.bonds.i.tolist(), d.bonds.j.tolist(), strict=True)] == pairs
    want = [float(mp.diff(energy, tuple(xi), tuple(int(k == e) for k in range(6)))) for e in range(6)]
    # Rounding of a dozen products, and of the coordinates' squares.
    np.testing.assert_allclose(d.bonds.G_b, want, rtol=1e-12)


TERMS = {
    "opls": (OPLSTorsion((1.3, -0.4, 0.8, 0.25)), "dihedral"),
    "harmonic": (HarmonicTorsion((1.0, -1, 2)), "dihedral"),
    "multi": (MultiHarmonicTorsion((1, 2, 3, 4, 5)), "dihedral"),
    "improper at 0": (HarmonicImproper((2.0, 0.0)), "improper"),
    "improper at 180": (HarmonicImproper((2.0, 180.0)), "improper"),
    "cvff": (CvffImproper((1.0, 1, 2)), "improper"),
}


def one(x, kind="dihedral"):
    return Frame(
        x, Cell(np.eye(3) * 50, periodic=(False,) * 3), units("metal"),
        topology=Topology(**{kind + "s": np.array([[0, 1, 2, 3]]), kind + "_types": np.array([1])}),
    )  # fmt: skip


def chain(phi, theta1=2.0, theta2=1.8, b=(1.1, 1.4, 0.9)):
    """Four atoms with bond angles θ1, θ2 and torsion φ."""
    return np.array(
        [
            [b[0] * np.cos(theta1), b[0] * np.sin(theta1), 0],
            [0, 0, 0],
            [b[1], 0, 0],
            [b[1] - b[2] * np.cos(theta2), b[2] * np.sin(theta2) * np.cos(phi), b[2] * np.sin(theta2) * np.sin(phi)],
        ]
    )


# An improper has a ridge at the plane it does not prefer: see the test of kinks.
@pytest.mark.parametrize(
    "name,plane",
    [(n, p) for n in TERMS for p in (0.0, np.pi) if (n, p) not in (("improper at 0", np.pi), ("improper at 180", 0.0))],
)
def test_walk_through_planar_chains(name, plane):
    """Energy and forces through φ = 0 and π: finite, the energy the closed form, the forces its derivative, and smooth
    where the term is."""
    term, kind = TERMS[name]
    pot = atc.potential(term)
    offsets = np.concatenate([[0.0], *(s * 10.0 ** -np.arange(1, 16, 1.0) for s in (1, -1))])
    answers = {o: pot.decompose(one(chain(plane + o), kind), sources=True) for o in offsets}
    at = answers[0.0]
    assert not at.notes
    for o, d in answers.items():
        assert np.isfinite(d.forces_nc).all() and np.isfinite(d.bonds.D_bdc).all()
        consistent_bonds(d, 4)
        # |dF/dφ| is at most about n² K / b ~ 100 for these terms.
        assert np.abs(d.forces_nc - at.forces_nc).max() <= 200 * abs(o) + 1e-12
        assert abs(d.energy - at.energy) <= 50 * o * o + 1e-13
        # A planar chain's force out of the plane is odd in the offset.
        np.testing.assert_allclose(d.forces_nc[:, 2], -answers[-o].forces_nc[:, 2] if o else 0.0, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", TERMS)
def test_walk_through_collinear_chains(name):
    """Atoms 1, 2, 3 through a line: finite and continuous, forces the derivative of the energy everywhere, and
    counted."""
    term, kind = TERMS[name]
    pot = atc.potential(term)
    for phi in (0.4, 2.0):
        for sine in [0.0, 1e-15, 1e-9, 1e-5, 0.5 * COLLINEAR, 0.999 * COLLINEAR]:
            d = pot.decompose(one(chain(phi, np.pi - np.arcsin(sine)), kind), sources=True)
            assert sum(d.notes.values()) == 1 and "line" in next(iter(d.notes)), d.notes
            assert np.isfinite(d.forces_nc).all() and np.isfinite(d.bonds.D_bdc).all()
            # Largest possible: U' ~ 40 times 1.5/ε of the continued cosine, over the shortest bond.
            assert np.abs(d.forces_nc).max() < 40 * 2 / COLLINEAR / 0.9
        assert not pot.decompose(one(chain(phi, np.pi - np.arcsin(1.001 * COLLINEAR)), kind)).notes
        # Across the edge of the continuation, where 1/sin θ hands over, force and energy are continuous: a step of 1e-7
        # of the sine.
        near = [pot.decompose(one(chain(phi, np.pi - COLLINEAR * (1 + s * 1e-7)), kind)) for s in (1, -1)]
        big = np.abs(near[0].forces_nc).max()
        assert abs(near[0].energy - near[1].energy) < 1e-5
        np.testing.assert_allclose(near[0].forces_nc, near[1].forces_nc, rtol=0, atol=1e-5 * big)
        # Forces are the derivative of the continued energy inside: central differences, steps small against ε.
        for sine in (0.3 * COLLINEAR, 0.0, 0.8 * COLLINEAR):
            x = chain(phi, np.pi - np.arcsin(sine))
            f = pot.decompose(one(x, kind)).forces_nc
            h = 1e-7
            for k, c in ((0, 1), (0, 2), (1, 1), (3, 2)):
                e = []
                for s in (1, -1):
                    y = x.copy()
                    y[k, c] += s * h
                    e.append(pot.decompose(one(y, kind)).energy)
                # Rounding 1e-15/1e-7 and the third derivative, 1/ε³ h² = 1e-5 relative to the force 1/ε.
                assert abs(-(e[0] - e[1]) / (2 * h) - f[k, c]) < 1e-4 * max(np.abs(f).max(), 1.0)


def test_all_four_atoms_on_a_line_and_two_at_one_place():
    pot = atc.potential(HarmonicTorsion((1.0, 1, 3)))
    d = pot.decompose(one(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])), sources=True)
    # cos φ = 0 there: U = K (1 + cos 3φ) = K.
    assert d.energy == pytest.approx(1.0, abs=1e-15) and np.abs(d.forces_nc).max() == 0.0
    with pytest.raises(atc.AtcError, match="dihedral harmonic of the atoms 1, 2, 3, 4 has no finite energy"):
        pot.decompose(one(np.array([[0.0, 0, 0], [0, 0, 0], [2, 0, 0], [3, 1, 0]])))


@pytest.mark.parametrize("chi0", [0.0, 35.26, 180.0])
def test_improper_is_the_same_for_the_mirror_image_and_kinked_only_where_it_must(chi0):
    pot = atc.potential(HarmonicImproper((2.0, chi0)))
    for chi in (0.3, 1.0, 2.5):
        a, b = (pot.decompose(one(chain(s * chi), "improper")) for s in (1, -1))
        assert a.energy == pytest.approx(2.0 * (chi - np.radians(chi0)) ** 2, rel=1e-12)
        assert a.energy == pytest.approx(b.energy, rel=1e-14)
        np.testing.assert_allclose(a.forces_nc, b.forces_nc * [1, 1, -1], rtol=0, atol=1e-12)
    for plane in (0.0, np.pi):
        smooth = np.radians(chi0) == plane
        for o in (0.0, 1e-12, 1e-6, 5e-4):
            d = pot.decompose(one(chain(plane - o), "improper"))
            assert bool(d.notes) != smooth
            assert np.isfinite(d.forces_nc).all() and np.abs(d.forces_nc).max() < 100
            assert d.energy == pytest.approx(2.0 * (plane - np.radians(chi0)) ** 2, abs=0.02)
        up, down = (pot.decompose(one(chain(plane + s * 0.01), "improper")).forces_nc[:, 2] for s in (1, -1))
        jump = np.abs(up - down).max()
        assert jump < 0.3 if smooth else jump > 1.0


REFUSED = [
    ("dihedral_style charmm\ndihedral_coeff 1 1.0 3 90 0.0", "line 2|dihedral type 1.*neither 0 nor 180.*mirror image"),
    ("dihedral_style charmm\ndihedral_coeff 1 1.0 3 0 0.5", "weight 0.5.*not supported"),
    ("dihedral_style charmm\ndihedral_coeff 1 1.0 2.5 0 0.0", "n must be a whole number"),
    ("dihedral_style harmonic\ndihedral_coeff 1 1.0 2 3", "d must be 1 or -1"),
    ("dihedral_style fourier\ndihedral_coeff 1 2 1.0 3 0 0.5 1 60", "60 degrees is neither 0 nor 180"),
    ("dihedral_style fourier\ndihedral_coeff 1 2 1.0 3 0", "2 terms need 6 numbers"),
    ("dihedral_style nharmonic\ndihedral_coeff 1 3 1.0 3", "takes n and then n coefficients"),
    ("dihedral_style opls\ndihedral_coeff 1 1.0 2", "K1 K2 K3 K4"),
    (
        "dihedral_style klass2\ndihedral_coeff 1 1.0 2",
        "klass2 is not .*: did you mean 'class2'\\? expected one of charmm",
    ),
]


@pytest.mark.parametrize("lines,message", REFUSED)
def test_refused(lines, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines, units="real")
    assert "\n" not in str(e.value)


def test_frames_without_topology_or_coefficients():
    config = chains(n=2, types=1)
    frame = config.frame()
    pot = potential("dihedral_style harmonic\ndihedral_coeff 1 1.0 1 3", config)
    with pytest.raises(atc.AtcError, match="topology"):
        pot.decompose(frame.replace(topology=None))
    frame.topology.dihedral_types[1] = 2
    with pytest.raises(atc.AtcError, match="dihedral type 2"):
        pot.decompose(frame)
    with pytest.raises(atc.AtcError, match="add up to 1"):
        OPLSTorsion((1, 2, 3, 4), partition=(0.5, 0.5, 0.5, 0.5))
    with pytest.raises(atc.AtcError, match="expected one of 'equal', 'inner'"):
        OPLSTorsion((1, 2, 3, 4), partition="outer")


def test_objects_are_what_the_lines_say():
    config = chains(n=6, types=1)
    frame = config.frame()
    for term, line in (
        (NHarmonicTorsion((1.0, 2.0, 3.0), units="real"), "nharmonic\ndihedral_coeff 1 3 1.0 2.0 3.0"),
        (FourierTorsion((2, 1.0, 3, 180, 0.5, 1, 0), units="real"), "fourier\ndihedral_coeff * 2 1.0 3 180 0.5 1 0"),
        (OPLSTorsion({1: (1, 2, 3, 4)}, units="real"), "opls\ndihedral_coeff 1 1 2 3 4"),
    ):
        a, b = atc.potential(term).decompose(frame), potential("dihedral_style " + line, config).decompose(frame)
        assert a.energy == b.energy and a.energy != 0
        np.testing.assert_array_equal(a.forces_nc, b.forces_nc)
