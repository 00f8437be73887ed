"""meam/spline, meam/sw/spline and eim: LAMMPS, energy sources, splines, what is refused."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from many_body_systems import DIAMOND, FCC, POTENTIALS, TILTS, crystal, lines_of

import atc
from atc.decomposers.many_body.embedded_ion import EmbeddedIon, read_eim
from atc.decomposers.many_body.spline_meam import Spline, _spline

CASES = [
    ("meam/spline", "Si_1.meam.spline", "Si", 5.43, DIAMOND),
    ("meam/spline", "Si_2.meam.spline", "Si", 4.6, DIAMOND),
    ("meam/spline", "Ti.meam.spline", "Ti", 4.1, FCC),
    ("meam/spline", "TiO.meam.spline", "Ti O", 3.8, FCC),
    ("meam/sw/spline", "Ti.meam.sw.spline", "Ti Ti", 4.1, FCC),
    ("meam/sw/spline", "Si.b.meam.sw.spline", "Si", 5.2, DIAMOND),
]


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("style,file,elements,a,basis", CASES)
def test_splines_agree_with_lammps(style, file, elements, a, basis, tilt):
    config = crystal(a, kinds=len(elements.split()), tilt=tilt, basis=basis, jitter=0.2)
    agrees_with_lammps(potential(lines_of(style, file, elements), config), lines_of(style, file, elements), config)


def test_order_that_lammps_does_not_follow():
    config = crystal(3.8, kinds=2, basis=FCC, jitter=0.2)
    lines = lines_of("meam/spline", "TiO.meam.spline", "O Ti")
    with pytest.warns(atc.errors.AtcWarning, match=r"in its order \(Ti O\), whatever the line says"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)


def test_sw_part_is_not_nothing(tmp_path):
    """The published meam/sw/spline files have empty F and G, or f and g: all seven functions, made up."""
    rng = np.random.default_rng(3)
    text = ["made up"]
    for lo, hi in ((1.5, 4.2), (1.5, 3.9), (-1, 1), (1.5, 4.0), (-5, 20), (1.5, 3.8), (-1, 0.9)):
        x, y = np.linspace(lo, hi, 6), rng.uniform(-1, 1, 6)
        if lo == 1.5:
            y[-1] = 0.0
        text += [
            "6",
            f"{rng.uniform(-2, 2)} {0.0 if lo == 1.5 else 0.4}",
            "1 0 1 0",
            *(f"{a:.16g} {b:.16g} 0" for a, b in zip(x, y, strict=True)),
        ]
    path = tmp_path / "X.meam.sw.spline"
    path.write_text("\n".join(text) + "\n")
    config = crystal(5.0, jitter=0.2)
    lines = lines_of("meam/sw/spline", path, "X")
    agrees_with_lammps(potential(lines, config), lines, config)
    config = crystal(5.0, n=(1, 1, 1), jitter=0.2)
    sources_are_derivatives(potential(lines, config), config.frame(), atoms=range(0, 8, 3), tolerance=1e-7)


@pytest.mark.parametrize("style,file,elements,a,basis", [CASES[0], CASES[3]])
def test_sources_of_splines(style, file, elements, a, basis):
    config = crystal(a, n=(1, 1, 1), kinds=len(elements.split()), basis=basis, jitter=0.15)
    pot = potential(lines_of(style, file, elements), config)
    assert "density and angles to their own atom" in pot.describe()
    sources_are_derivatives(pot, config.frame(), atoms=range(0, len(config.positions), 3), tolerance=1e-7)


def test_spline_through_knots_and_lines_beyond():
    s = Spline(np.array([1.0, 2.0, 4.0]), np.array([3.0, -1.0, 2.0]), 0.5, -0.25)
    rows = s.rows()
    for x, y in zip(s.x, s.y, strict=True):
        assert _spline(rows, x)[0] == pytest.approx(y, abs=1e-14)
        left, right = _spline(rows, x - 1e-9), _spline(rows, x + 1e-9)
        assert left[1] == pytest.approx(right[1], abs=1e-7)
    assert _spline(rows, 0.0) == pytest.approx((2.5, 0.5)) and _spline(rows, 6.0) == pytest.approx((1.5, -0.25))


REFUSED = [
    ("meam/spline", "TiO.meam.spline", "Ti NULL", "one atom type for each element of the file: write Ti O"),
    ("meam/spline", "Ti.meam.spline", "Ti Ti", "a file of one element for one atom type"),
    ("meam/sw/spline", "Ti.meam.sw.spline", "Ti Si", "the file is of one element"),
    ("meam/sw/spline", "Ti.meam.spline", "Ti", "cut off|expected"),
    ("meam/spline", "Ti.meam.sw.spline", "Ti", "more lines than"),
]


@pytest.mark.parametrize("style,file,elements,message", REFUSED)
def test_refused_splines(style, file, elements, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of(style, file, elements), units="metal")
    assert "\n" not in str(e.value)


DAMAGE = [
    ("-20 0", "-20 x", "slopes at the ends of phi"),
    ("2.05580176725", "1.0", "knots of phi must go up"),
    ("meam/spline 2 Ti O", "meam/spline 3 Ti O", "number of elements"),
    ("\n13\n", "\n1\n", "two knots or more"),
    ("spline3eq\n8\n0 0", "spline3eq\n9\n0 0", "cut off"),
    ("UNITS: metal", "UNITS: real", "LAMMPS does not convert"),
]


@pytest.mark.parametrize("old,new,message", DAMAGE)
def test_damaged_splines(tmp_path, old, new, message):
    path = tmp_path / "TiO.meam.spline"
    text = (POTENTIALS / "TiO.meam.spline").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of("meam/spline", path, "Ti O"), units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)


# Embedded ions
# ----------------------------------------------------------------------------------------------------------------------

ROCK_SALT = np.concatenate([FCC, FCC + np.array([0.5, 0, 0])])
FIELD = POTENTIALS / "ffield.eim"


def eim(names, elements=None, path=FIELD):
    return f"pair_style eim\npair_coeff * * {names} {path} {elements or names}"


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("names,a", [("Na Cl", 5.6), ("Li F", 4.0), ("Rb Br", 5.9), ("Cs Id K F", 5.0)])
def test_eim_agrees_with_lammps(names, a, tilt):
    config = crystal(a, n=(2, 1, 1), kinds=len(names.split()), tilt=tilt, basis=ROCK_SALT, jitter=0.3)
    agrees_with_lammps(potential(eim(names), config), eim(names), config)


@pytest.mark.parametrize("file, model", [("metal", "real"), ("real", "metal")])
def test_eim_energies_are_converted_as_lammps_does(tmp_path, file, model):
    path = tmp_path / "ffield.eim"
    path.write_text(FIELD.read_text().replace("UNITS: metal", f"UNITS: {file}"))
    config = crystal(5.6, n=(1, 1, 1), kinds=2, basis=ROCK_SALT, jitter=0.3)
    config.units = model
    with pytest.warns(atc.errors.AtcWarning, match=f"converted from {file} to {model} units, as LAMMPS does"):
        pot = potential(eim("Na Cl", path=path), config)
    agrees_with_lammps(pot, eim("Na Cl", path=path), config)


def test_eim_types_overlay_and_sources():
    config = crystal(5.5, n=(2, 1, 1), kinds=3, basis=ROCK_SALT, jitter=0.3)
    agrees_with_lammps(potential(eim("Na Cl", "Na Cl Cl"), config), eim("Na Cl", "Na Cl Cl"), config)
    lines = [
        "pair_style hybrid/overlay eim lj/cut 4.0",
        f"pair_coeff * * eim Na Cl {FIELD} Na NULL Cl",
        "pair_coeff * 2 lj/cut 0.01 2.0",
        "pair_coeff 2 3 lj/cut 0.01 2.0",
    ]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)
    config = crystal(5.5, n=(1, 1, 1), kinds=2, basis=ROCK_SALT, jitter=0.3)
    pot = potential(eim("Na Cl"), config)
    assert "½qσ to its own atom" in pot.describe()
    sources_are_derivatives(pot, config.frame(), atoms=range(0, 8, 3), tolerance=2e-6)


def test_eim_charges_of_a_perfect_crystal():
    """Every ion has the charge that its neighbours give it, and no force."""
    config = crystal(5.6, n=(3, 3, 3), basis=ROCK_SALT, jitter=0.0, tilt="orthogonal")
    frame = config.frame().replace(types=np.tile([1, 1, 1, 1, 2, 2, 2, 2], 27))
    d = atc.potential(EmbeddedIon.from_file(FIELD, ["Na", "Cl"], ["Na", "Cl"])).decompose(frame)
    assert np.abs(d.forces_nc).max() < 1e-12
    assert len(np.unique(np.round(d.energies_n, 9))) == 2


BAD = [
    ("pair_style eim\npair_coeff * * Na {} Na Cl", "Cl is not among the elements in front of the file"),
    ("pair_style eim\npair_coeff * * Na Xx {} Na Xx", "no pair: line for Na and Xx|no element: line for Xx"),
    ("pair_style eim\npair_coeff * * {} Na", "wants pair_coeff"),
    ("pair_style eim 3\npair_coeff * * Na {} Na", "expected no arguments"),
    ("pair_style eim\npair_coeff 1 1 Na {} Na", "replace the types by"),
]


@pytest.mark.parametrize("lines,message", BAD)
def test_refused_eim(lines, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines.format(FIELD), units="metal")
    assert "\n" not in str(e.value)


def test_damaged_eim(tmp_path):
    text = FIELD.read_text()
    for old, new, message in (
        ("global:", "golbal:", "expected global:, element: or pair:"),
        ("9.3000e-01", "x", "negativity must be a number"),
        ("pair:  Na  Cl", "pair:  Na  Xx", "no pair: line for Na and Cl"),
        ("UNITS: metal", "UNITS: lj", "only metal and real convert"),
    ):
        path = tmp_path / "ffield.eim"
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(atc.AtcError, match=message):
            read_eim(path, ["Na", "Cl"])
