"""MEAM: LAMMPS's own files, every keyword and form, energy sources, screening, what is refused."""

import re

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, sources_are_derivatives
from many_body_systems import DIAMOND, FCC, POTENTIALS, TILTS, crystal

import atc
from atc.decomposers.many_body import meam_reference
from atc.decomposers.many_body.meam import MEAM
from atc.decomposers.many_body.meam_file import library_elements, read_meam
from atc.frame import Cell, Frame
from atc.units import units

LIBRARY, LIBRARY_2NN = POTENTIALS / "library.meam", POTENTIALS / "library_2nn.meam"
SEVEN, FIVE = "Mo Co Ni V Fe Al Cr", "AlS SiS MgS CuS FeS"


def lines_of(names, parameters="NULL", library=LIBRARY, elements=None):
    return f"pair_style meam\npair_coeff * * {library} {names} {parameters} {elements or names}"


# Library, elements, parameter file, lattice constant, basis.
CASES = {
    "fcc": (LIBRARY, "Cu", "Cu.meam", 3.62, FCC),
    "dense fcc, G = exp": (LIBRARY, "Ni", "Ni.meam", 3.0, FCC),
    "diamond": (LIBRARY, "Si", "NULL", 5.43, DIAMOND),
    "dense diamond": (LIBRARY, "Si97", "NULL", 4.6, DIAMOND),
    "hcp": (LIBRARY, "Mg", "NULL", 4.2, FCC),
    "bcc, second neighbours": (LIBRARY, "WL", "WL.meam", 3.9, FCC),
    "simple cubic, second neighbours": (LIBRARY, "Bi", "Bi.meam", 4.7, FCC),
    "zincblende": (LIBRARY, "Si C", "SiC.meam", 4.4, DIAMOND),
    "rock salt": (LIBRARY, FIVE, "AlSiMgCuFe.meam", 4.2, FCC),
    "dense rock salt": (LIBRARY, FIVE, "AlSiMgCuFe.meam", 3.5, FCC),
    "B2 and L12": (LIBRARY_2NN, SEVEN, "MoCoNiVFeAlCr_2nn.meam", 3.9, FCC),
    "dense B2 and L12": (LIBRARY_2NN, SEVEN, "MoCoNiVFeAlCr_2nn.meam", 3.2, FCC),
}


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("name", CASES)
def test_agrees_with_lammps(name, tilt):
    library, names, file, a, basis = CASES[name]
    config = crystal(a, kinds=len(names.split()), tilt=tilt, basis=basis, jitter=0.2)
    lines = lines_of(names, "NULL" if file == "NULL" else POTENTIALS / file, library)
    agrees_with_lammps(potential(lines, config), lines, config)


def test_pair_energies_of_every_element_and_pair():
    """Dimers of all elements of the library: 1–1 energies are sums of one pair energy and two embedding energies."""
    from lammps_oracle import Config

    known = library_elements(LIBRARY.read_text(), LIBRARY)
    names = [n for n in known if n not in ("Vac", "zz")]
    rng = np.random.default_rng(0)
    for name in names[::5]:
        config = Config(np.diag([30.0, 20, 20]), np.array([[5.0, 5, 5], [5 + rng.uniform(0.7, 3.3), 5, 5]]))
        agrees_with_lammps(potential(lines_of(name), config), lines_of(name), config)
    p = read_meam(LIBRARY_2NN, SEVEN.split(), POTENTIALS / "MoCoNiVFeAlCr_2nn.meam")
    # The energy of the reference structure, put together again: b2 of Mo and Al.
    a, b, r = 0, 5, 2.7
    E = meam_reference.rose(p, a, b, r)
    F = [
        float(meam_reference.embedding(p, e, meam_reference._site(p, "b2", e, o, True, np.array([r]), True))[0])
        for e, o in ((a, b), (b, a))
    ]
    second = [
        meam_reference.screening(p, "b2", e, o)
        * float(meam_reference.pair_energy(p, e, e, [r * 2 / 3**0.5], core=False)[0])
        for e, o in ((a, b), (b, a))
    ]
    assert 2 * E == pytest.approx(
        sum(F) + 8 * float(meam_reference.pair_energy(p, a, b, [r])[0]) + 3 * sum(second), rel=1e-13
    )


SETTINGS = [
    "ialloy = 0",
    "ialloy = 1",
    "ialloy = 2",
    "emb_lin_neg = 0",
    "bkgd_dyn = 0",
    "augt1 = 1",
    "gsmooth_factor = 2.0",
    "delr = 0.9",
    "rho0(1) = 1.7",
    "rc = 3.6",
    "erose_form = 0\nattrac(1,2) = 0.2\nrepuls(1,2) = 0.1",
    "erose_form = 1\nattrac(1,2) = 0.2\nrepuls(1,2) = 0.1",
    "zbl(2,1) = 1",
    "nn2(2,1) = 0",
    "erose_form = 2\nattrac(2,2) = 0.2\nrepuls(2,2) = 0.1",
    "Ec(1,2) = 5.1",
    "delta(1,2) = 0.3\nEc(1,2) = 0",
    "alpha(1,2) = 0",
    "re(1,2) = 2.4\nCmax(1,1,2) = 4.0",
    "lattce(1,2) = 'dim'",
    "lattce(1,2) = 'bcc'",
    "lattce(1,2) = 'hcp'\nCmin(1,1,2) = 0.3",
    "lattce(1,2) = 'l12'",
]


@pytest.mark.filterwarnings("ignore:.*LAMMPS does not use")
@pytest.mark.parametrize("setting", SETTINGS)
def test_every_setting(tmp_path, setting):
    path = tmp_path / "two.meam"
    source = "MoCoNiVFeAlCr_2nn.meam"
    head = [
        line for line in (POTENTIALS / source).read_text().splitlines() if not re.search(r"\(\d*,?[3-7]|,[3-7]", line)
    ]
    path.write_text("\n".join(head) + f"\n{setting}  # for a test\n")
    lines = lines_of("Mo Co", path, LIBRARY_2NN)
    config = crystal(3.7, kinds=2, basis=FCC, jitter=0.3)
    agrees_with_lammps(potential(lines, config), lines, config)


@pytest.mark.parametrize("ibar", [0, 1, 3, 4, -5])
def test_forms_of_g(tmp_path, ibar):
    """Γ on both sides of −1, where G is smoothed, folded over or regular."""
    library, path = tmp_path / "library.meam", tmp_path / "two.meam"
    library.write_text(
        f"'Q' 'dia' 4. 14 28 4.87 4.4 5.5 5.5 5.5 5.431 4.63 1. 1.0 3.0 5.0 -3.0 1.3 {ibar}\n"
        f"'R' 'fcc' 12 13 28 4.6 2.4 3.5 2.5 1.5 4.1 3.63 1.1 1.0 -3.0 2.0 4.0 0.7 {ibar}\n"
    )
    path.write_text("lattce(1,2)='b1'\nnn2(2,2)=1\nCmin(2,2,2)=0.4\nrc=4.5\n")
    config = crystal(4.5, kinds=2, jitter=0.3)
    agrees_with_lammps(potential(lines_of("Q R", path, library), config), lines_of("Q R", path, library), config)


@pytest.mark.parametrize("name", ["zincblende", "B2 and L12", "simple cubic, second neighbours"])
def test_sources(name):
    library, names, file, a, basis = CASES[name]
    config = crystal(a, n=(1, 1, 1), kinds=len(names.split()), basis=basis, jitter=0.15)
    pot = potential(lines_of(names, POTENTIALS / file, library), config)
    assert "embedding energy to its own atom" in pot.describe()
    # The spline's second derivative jumps at the points of the table, f_c's third at its ends: central differences to
    # 1e-6.
    sources_are_derivatives(pot, config.frame(), atoms=range(0, len(config.positions), 2), tolerance=2e-6)


def test_screening_of_three_atoms():
    """S_12 of a third atom that moves across the ellipses of C_min and C_max: energy and forces are continuous, and far
    away it does nothing."""
    pot = atc.potential(MEAM.from_files(LIBRARY, ["Cu"]))
    cell = Cell(np.eye(3) * 40, periodic=(False,) * 3)

    def at(y, x=1.8):
        return pot.decompose(Frame(np.array([[0.0, 0, 0], [3.6, 0, 0], [x, y, 0]]), cell, units("metal")), sources=True)

    half = 1.8
    for C in (2.0, 2.8):
        # X = Y = (half² + y²)/d², C = 1 + 2 (2X − 1).
        y = np.sqrt((C + 1) / 4 * (2 * half) ** 2 - half**2)
        a, b = at(y - 1e-7), at(y + 1e-7)
        # Between them the energy changes by the force on the third atom times 2e-7, and that by U'' times it.
        assert a.energy == pytest.approx(b.energy + 2e-7 * b.forces_nc[2, 1], rel=1e-9)
        np.testing.assert_allclose(a.forces_nc, b.forces_nc, rtol=0, atol=1e-5 * np.abs(a.forces_nc).max())
        for d in (a, b):
            consistent_bonds(d, 3)
    inside, outside = at(1.0), at(3.4)
    bonds = {tuple(sorted(p)) for p in zip(inside.bonds.i, inside.bonds.j, strict=True)}
    assert (0, 1) in bonds  # outer bond of the densities at atom 3
    far = at(30.0)
    pair = pot.decompose(Frame(np.array([[0.0, 0, 0], [3.6, 0, 0]]), cell, units("metal")))
    assert far.energy == pytest.approx(pair.energy, rel=1e-14) and outside.n_bonds >= 3


def test_hybrid_overlay_null_and_threads():
    config = crystal(3.7, kinds=3, basis=FCC)
    lines = ["pair_style hybrid/overlay meam lj/cut 4.0", f"pair_coeff * * meam {LIBRARY} Cu Ni NULL NULL Ni Cu"]
    lines += ["pair_coeff 1 * lj/cut 0.01 2.0"]
    with pytest.warns(atc.errors.AtcWarning, match="is taken to be fcc"):
        pot = potential("\n".join(lines), config)
    agrees_with_lammps(pot, lines, config)
    config = crystal(3.52, n=(6, 6, 6), basis=FCC, jitter=0.1)
    agrees_with_lammps(potential(lines_of("Ni"), config), lines_of("Ni"), config, threads=3)


def test_perfect_crystal_has_the_energy_of_its_reference_structure():
    config = crystal(4.05, n=(3, 3, 3), basis=FCC, jitter=0.0, tilt="orthogonal")
    d = atc.potential(MEAM.from_files(LIBRARY, ["Al"])).decompose(config.frame())
    # E_c of the library, first neighbours only.
    assert d.energy / len(config.positions) == pytest.approx(-3.58, abs=2e-3)
    assert np.abs(d.forces_nc).max() < 1e-12


def test_indices_that_lammps_does_not_use(tmp_path):
    path = tmp_path / "SiC.meam"
    path.write_text((POTENTIALS / "SiC.meam").read_text() + "\nEc(2,1) = 5.0\n")
    with pytest.warns(atc.errors.AtcWarning, match=r"SiC.meam:\d+: LAMMPS does not use Ec\(2,1\) = 5.0"):
        a = atc.potential(lines_of("Si C", path), units="metal")
    b = atc.potential(lines_of("Si C", POTENTIALS / "SiC.meam"), units="metal")
    c = atc.potential(lines_of("Si C", POTENTIALS / "SiC.meam").replace("style meam", "style meam/c"), units="metal")
    frame = crystal(4.4, kinds=2).frame()
    assert a.decompose(frame).energy == b.decompose(frame).energy == c.decompose(frame).energy


DAMAGE = [
    ("rc = 4.0", "rc = x", "rc must be a number"),
    ("rc = 4.0", "rcc = 4.0", "unknown or unsupported MEAM keyword 'rcc'"),
    ("rc = 4.0", "rc 4.0", "expected keyword = value"),
    ("rc = 4.0", "rc = 0", "rc and delr must be positive"),
    ("rc = 4.0", "mixture_ref_t = 1", "demonstrably incorrect"),
    ("rc = 4.0", "ialloy = 3", "ialloy must be one of 0, 1, 2"),
    ("rc = 4.0", "rc(1) = 4", "rc has no indices"),
    ("'dia'", "'c11'", "reference structure 'c11' is not supported"),
    ("rho0(2)", "rho0(3)", "element numbers between 1 and 2"),
    ("Cmax(1,2,1) = 4.0", "Cmax(1,2,1) = 1.0", "must be larger than Cmin"),
    ("Cmax(1,2,1) = 4.0", "Cmax(1,2,1) = 40.0", "depends on the skin of its neighbour list"),
    ("Cmax(1,2,1)", "Cmax(1,2)", "takes 3 element numbers"),
]


@pytest.mark.parametrize("old,new,message", DAMAGE)
def test_damaged_parameter_files(tmp_path, old, new, message):
    path = tmp_path / "SiC.meam"
    text = (POTENTIALS / "SiC.meam").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of("Si C", path), units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)


REFUSED = [
    ("Si Q", "NULL", "Si", "is not among|parameter file|no such file"),
    ("Vac", "NULL", "Vac", "t0 must be 1"),
    ("zz", "NULL", "zz", "'zzz' is not supported"),
    ("Si C", "NULL", "Si Cu", "Cu is not among the elements taken"),
    ("Si", "nowhere.meam", "Si", "no such file"),
    ("Si", "", "", "wants|found no"),
]


@pytest.mark.parametrize("names,file,elements,message", REFUSED)
def test_refused(names, file, elements, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(f"pair_style meam\npair_coeff * * {LIBRARY} {names} {file} {elements}", units="metal")
    assert "\n" not in str(e.value)


def test_damaged_library(tmp_path):
    path = tmp_path / "library.meam"
    for text, message in (
        ("'Si' 'dia' 4. 14", "has 4 of 19 words"),
        ("'Si' 'dia' 4. 14 28 x 1 1 1 1 5.4 4 1 1 1 1 1 1 0", "alpha must be a number"),
        ("'Si' 'dia' 4. 14 28 4 1 1 1 1 5.4 4 1 1 1 1 1 1 2", "ibar must be one of"),
        ("'Si' 'fcc' 4. 14 28 4 1 1 1 1 5.4 4 1 1 1 1 1 1 0", "another number of"),
        ("# UNITS: real\n'Si' 'dia' 4. 14 28 4 1 1 1 1 5.4 4 1 1 1 1 1 1 0", "LAMMPS does not convert MEAM"),
    ):
        path.write_text(text + "\n")
        with pytest.raises(atc.AtcError, match=message):
            atc.potential(lines_of("Si", "NULL", path), units="metal")
