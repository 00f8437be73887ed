"""sw/mod, vashishta, nb3b/harmonic, nb3b/screened and EDIP: LAMMPS, energy sources, smoothness, refused input."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, source_matrix, sources_are_derivatives
from many_body_systems import POTENTIALS, TILTS, crystal, lines_of

import atc
from atc.frame import Cell, Frame
from atc.units import units

CASES = [
    ("sw/mod", "tmd.sw.mod", "Mo S", 5.0),
    ("sw/mod", "tmd.sw.mod", "W Se Te", 4.0),
    ("vashishta", "InP.vashishta", "In P", 5.83),
    ("vashishta", "SiC.vashishta", "C Si", 4.36),
    ("vashishta", "SiO.1990.vashishta", "Si O", 4.6),
    ("vashishta", "SiO.1994.vashishta", "O Si", 4.6),
    ("vashishta", "SiO.1997.vashishta", "Si O O", 3.6),
    ("nb3b/harmonic", "MOH.nb3b.harmonic", "M O H", 3.4),
    ("nb3b/screened", "PSiO.nb3b.screened", "P Si O", 5.0),
    ("edip/multi", "Si.edip", "Si", 5.43),
    ("edip/multi", "Si.edip", "Si", 4.2),
    ("edip/multi", "SiC.edip", "Si C", 4.6),
    ("edip/multi", "SiC.edip", "C Si", 3.6),
]


@pytest.mark.filterwarnings("ignore:.*converted from real to metal")
@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("style,file,elements,a", CASES)
def test_agrees_with_lammps(style, file, elements, a, tilt):
    lines = lines_of(style, file, elements)
    config = crystal(a, kinds=len(elements.split()), tilt=tilt)
    d, _ = agrees_with_lammps(potential(lines, config), lines, config)
    assert (d.energies_n != 0).sum() > 2


@pytest.mark.filterwarnings("ignore:.*converted from")
@pytest.mark.parametrize("style,file,elements,a", [CASES[k] for k in (0, 2, 7, 8)])
def test_real_units(style, file, elements, a):
    lines = lines_of(style, file, elements)
    config = crystal(a, kinds=len(elements.split()), style="real")
    agrees_with_lammps(potential(lines, config), lines, config)


def test_triplets_with_different_arms(tmp_path):
    """Cutoffs, screening lengths and strengths that differ by which end is the centre; angles of one neighbour's
    element too."""
    path = tmp_path / "AB.nb3b.screened"
    rows = ["A A A 3.0 100 1.5 3.1", "A B B 4.0 90 1.2 3.4", "A A B 2.0 120 9 9", "A B A 2.0 120 9 9"]
    rows += ["B B B 1.0 170 0.9 2.9", "B A A 5.0 80 2.0 2.6", "B A B 6.0 10 9 9", "B B A 6.0 10 9 9"]
    path.write_text("# UNITS: metal\n" + "\n".join(rows) + "\n")
    config = crystal(5.2, kinds=2)
    agrees_with_lammps(
        potential(lines_of("nb3b/screened", path, "A B"), config), lines_of("nb3b/screened", path, "A B"), config
    )
    path.write_text("\n".join(" ".join(w for k, w in enumerate(r.split()) if k != 5) for r in rows) + "\n")
    agrees_with_lammps(
        potential(lines_of("nb3b/harmonic", path, "A B"), config), lines_of("nb3b/harmonic", path, "A B"), config
    )


def test_straight_triplet_is_clamped_and_counted(tmp_path):
    path = tmp_path / "A.nb3b.harmonic"
    path.write_text("A A A 3.0 109.5 2.5\n")
    frame = Frame(np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]]), Cell(np.eye(3) * 30), units("metal"))
    d = atc.potential(lines_of("nb3b/harmonic", path, "A"), units="metal").decompose(frame)
    assert d.energy == pytest.approx(3.0 * np.radians(70.5) ** 2, rel=1e-14)
    assert d.notes == {"angles clamped near 0 or 180 degrees": 1} and np.isfinite(d.forces_nc).all()


@pytest.mark.filterwarnings("ignore:.*converted from real to metal")
@pytest.mark.parametrize("partition", [None, "center"])
@pytest.mark.parametrize("style,file,elements,a", [CASES[k] for k in (2, 8, 9, 11)])
def test_sources(style, file, elements, a, partition):
    config = crystal(a, n=(1, 1, 1), kinds=len(elements.split()), jitter=0.2)
    pot = potential(lines_of(style, file, elements), config, partition=partition)
    sources_are_derivatives(pot, config.frame(), atoms=range(0, 8, 3), tolerance=1e-7)


def test_forces_of_sw_mod_in_its_switch():
    """LAMMPS's forces there are not the derivative of its energy: said in the notes, and the sources still add up to
    the forces."""
    config = crystal(5.0, kinds=2)
    d = potential(lines_of("sw/mod", "tmd.sw.mod", "Mo S"), config).decompose(config.frame(), sources=True)
    assert any("not the derivative of its energy" in note and count > 0 for note, count in d.notes.items())
    np.testing.assert_allclose(
        source_matrix(d.bonds, len(config.positions)).sum(axis=0),
        -d.forces_nc,
        rtol=0,
        atol=1e-12 * np.abs(d.forces_nc).max(),
    )


def test_maxdelta_of_sw_mod(tmp_path):
    """A trimer on both sides of δ1 and δ2 (this LAMMPS refuses the keyword that its manual has): the closed form."""
    path = tmp_path / "A.sw"
    path.write_text("A A A 1.0 2.0951 1.80 21.0 1.20 -0.333333333333 0.0 0.6 4.0 0.0 0.0\n")
    for lines, d1, d2 in (
        (lines_of("sw/mod", path, "A"), 0.25, 0.35),
        (lines_of("sw/mod maxdelta 0.1 0.5", path, "A"), 0.1, 0.5),
    ):
        pot = atc.potential(lines, units="metal")
        for delta in (0.05, 0.2, 0.3, 0.34, 0.45, 0.6):
            cos = delta - 0.333333333333
            x = 3.2 * np.array([[0, 0, 0], [1, 0, 0], [cos, np.sqrt(1 - cos**2), 0]])
            d = pot.decompose(Frame(x, Cell(np.eye(3) * 30), units("metal")))
            g = 1.0 if delta < d1 else 0.0 if delta > d2 else 0.5 + 0.5 * np.cos(np.pi * (delta - d1) / (d2 - d1))
            assert d.energy == pytest.approx(
                21.0 * (g * delta) ** 2 * np.exp(1.2 * 2.0951 / (3.2 - 1.8 * 2.0951)) ** 2, rel=1e-12, abs=1e-300
            )
    with pytest.raises(atc.AtcError, match="0 <= delta1 < delta2"):
        atc.potential(lines_of("sw/mod maxdelta 0.5 0.1", path, "A"), units="metal")


def test_vashishta_ends_smoothly():
    """Energy and force of a pair go to 0 at r_c; those of a triplet, with all derivatives, at r0."""
    pot = atc.potential(lines_of("vashishta", "InP.vashishta", "In P"), units="metal")
    cell = Cell(np.eye(3) * 40, periodic=(False,) * 3)

    def at(d, more=()):
        return pot.decompose(
            Frame(np.array([[0.0, 0, 0], [d, 0, 0], *more]), cell, units("metal"), types=[1, 2, 2][: 2 + len(more)]),
            sources=True,
        )

    near, edge = at(6.0 - 1e-6), at(6.0)
    assert abs(near.energy) < 1e-11 and np.abs(near.forces_nc).max() < 1e-6
    assert edge.energy == 0.0 and edge.n_bonds == 0
    third = [[0.1, 2.5, 0.0]]
    a, b = at(3.55 - 1e-9, third), at(3.55, third)
    assert a.energy == pytest.approx(b.energy, abs=1e-8)
    for o in (a, b):
        consistent_bonds(o, 3)
    with pytest.raises(atc.AtcError, match="atoms 1 and 2 are at the same place"):
        at(0.0)


def test_edip_of_one_element_warns_of_lammps_tables():
    config = crystal(5.43)
    lines = lines_of("edip", "Si.edip", "Si")
    with pytest.warns(atc.errors.AtcWarning, match="looks its functions up in tables"):
        pot = potential(lines, config)
    # What the warning says.
    agrees_with_lammps(pot, lines, config, tolerance=1e-6)
    with pytest.raises(atc.AtcError, match="write edip/multi"):
        atc.potential(lines_of("edip", "SiC.edip", "Si C"), units="metal")


@pytest.mark.parametrize("points,inner", [(500, 0.2), (60, 3.0)])
def test_vashishta_table(tmp_path, points, inner):
    """LAMMPS's interpolation, coarse enough to be seen; pairs with different cutoffs."""
    path = tmp_path / "InP.vashishta"
    path.write_text((POTENTIALS / "InP.vashishta").read_text().replace("270.105  6.0", "270.105  5.0"))
    config = crystal(5.8, kinds=2)
    lines = lines_of(f"vashishta/table {points} {inner}", path, "In P")
    d, _ = agrees_with_lammps(potential(lines, config), lines, config)
    exact = potential(lines_of("vashishta", path, "In P"), config).decompose(config.frame())
    assert 1e-9 < abs(d.energy / exact.energy - 1) < 0.1
    for args, message in (
        ("500", "takes the number of points"),
        ("1 0.2", "two points or more"),
        ("50 7.0", "inner cutoff between 0 and"),
    ):
        with pytest.raises(atc.AtcError, match=message):
            atc.potential(lines_of(f"vashishta/table {args}", path, "In P"), units="metal")


def test_hybrid_overlay():
    config = crystal(4.8, kinds=2)
    lines = ["pair_style hybrid/overlay vashishta lj/cut 4.0 edip/multi"]
    lines += [
        f"pair_coeff * * vashishta {POTENTIALS}/InP.vashishta In P",
        f"pair_coeff * * edip/multi {POTENTIALS}/Si.edip Si NULL",
    ]
    lines += ["pair_coeff 2 2 lj/cut 0.02 2.1"]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)


def test_edip_files_are_not_converted():
    with pytest.raises(atc.AtcError, match="LAMMPS does not convert EDIP files"):
        atc.potential(lines_of("edip/multi", "SiC.edip", "Si C"), units="real")


DAMAGE = [
    ("vashishta", "InP.vashishta", "0.0  6.0  0.0  0.0", "0.0  -6.0  0.0  0.0", "In P", "rc must not be negative"),
    ("vashishta", "InP.vashishta", "4847.09", "4800.0", "In P", "different two-body terms"),
    ("vashishta", "InP.vashishta", "P   In  In", "P   In  Q", "In P", "no entry for P In In"),
    ("vashishta", "SiC.vashishta", "UNITS: metal", "UNITS: electron", "Si C", "only metal and real convert"),
    ("edip/multi", "Si.edip", "3.1213820", "nan", "Si", "a must be a finite number"),
    ("edip/multi", "Si.edip", "3.1213820", "2.1", "Si", "cutoffA must be larger than cutoffC"),
    ("edip/multi", "SiC.edip", "0.510944", "0.4", "Si C", "different lambda, eta"),
    ("nb3b/screened", "PSiO.nb3b.screened", "60.0", "60.0 x", "P Si O", "found 8 words"),
    ("sw/mod", "tmd.sw.mod", "67.883", "-67.883", "Mo S", "lam must not be negative"),
]


@pytest.mark.parametrize("style,file,old,new,elements,message", DAMAGE)
def test_damaged_files(tmp_path, style, file, old, new, elements, message):
    path = tmp_path / file
    text = (POTENTIALS / file).read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of(style, path, elements), units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)
