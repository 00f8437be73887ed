"""polymorphic: LAMMPS's own files and made-up coarse tables of every kind, energy sources, what is refused."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from many_body_systems import DIAMOND, FCC, POTENTIALS, TILTS, crystal, lines_of

import atc

CASES = [
    ("GaN_sw.poly", "Ga N", 4.5, DIAMOND),
    ("GaN_tersoff.poly", "N Ga", 4.4, DIAMOND),
    ("CuTa_eam.poly", "Cu Ta", 3.8, FCC),
    ("FeCH_BOP_I.poly", "Fe C H", 3.6, DIAMOND),
    ("FeCH_BOP_II.poly", "H C Fe", 4.2, DIAMOND),
    ("TlBr_msw.poly", "Tl Br", 5.5, DIAMOND),
]


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("file,elements,a,basis", CASES)
def test_agrees_with_lammps(file, elements, a, basis, tilt):
    config = crystal(a, kinds=len(elements.split()), tilt=tilt, basis=basis, jitter=0.2)
    agrees_with_lammps(
        potential(lines_of("polymorphic", file, elements), config), lines_of("polymorphic", file, elements), config
    )


def made_up(path, eta, xmax, seed=1, cuts=(3.4, 3.0, 3.2), xi=(1.0, 0.5, 0.8)):
    """Two elements, waves for tables; five values a line, as LAMMPS's reader wants."""
    rng = np.random.default_rng(seed)
    out = [
        "# made up",
        f"2 {eta}",
        "1 10.0 Aa",
        "2 11.0 Bb",
        f"60 40 50 {xmax}",
        *(f"{c} {x}" for c, x in zip(cuts, xi, strict=True)),
    ]
    for points in [60] * (9 + (8 if eta == 3 else 3)) + [40] * 8 + [50] * 3:
        x, (a, b, c), k = np.linspace(0, 1, points), rng.uniform(-1, 1, 3), rng.uniform(0.5, 3, 2)
        v = a * np.cos(k[0] * x) + b * np.sin(k[1] * x) + c * x
        out += [" ".join(f"{y:.16g}" for y in v[i : i + 5]) for i in range(0, points, 5)]
    path.write_text("\n".join(out) + "\n")
    return lines_of("polymorphic", path, "Aa Bb")


@pytest.mark.parametrize("xmax", [0.3, 5.0])
@pytest.mark.parametrize("eta", [0, 1, 2, 3])
def test_coarse_tables_of_every_kind(tmp_path, eta, xmax):
    """Coarse, so that LAMMPS's interpolation shows; different cutoffs and ξ; arguments beyond the tables."""
    config = crystal(5.0, kinds=2, jitter=0.2)
    lines = made_up(tmp_path / "AB.poly", eta, xmax)
    agrees_with_lammps(potential(lines, config), lines, config)


@pytest.mark.parametrize("partition", [None, "center"])
@pytest.mark.parametrize("file,elements,a,basis", [CASES[1], CASES[2]])
def test_sources(file, elements, a, basis, partition):
    config = crystal(a, n=(1, 1, 1), kinds=2, basis=basis, jitter=0.15)
    pot = potential(lines_of("polymorphic", file, elements), config, partition=partition)
    # The interpolation jumps halfway between points, by third differences of tables of 2000: central differences over
    # 2e-5 Å see what falls into it.
    sources_are_derivatives(pot, config.frame(), atoms=range(0, len(config.positions), 3), tolerance=1e-4)


def test_types_left_out():
    config = crystal(4.5, kinds=3)
    lines = [
        "pair_style hybrid/overlay polymorphic lj/cut 4.0",
        f"pair_coeff * * polymorphic {POTENTIALS}/GaN_sw.poly Ga N NULL",
        "pair_coeff * 3 lj/cut 0.01 2.0",
    ]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)


def test_damaged_and_refused(tmp_path):
    path = tmp_path / "AB.poly"
    made_up(path, 0, 5.0)
    text = path.read_text()
    for old, new, message in (
        ("2 0\n", "x 0\n", "number of elements and eta"),
        ("60 40 50 5.0", "60 4 50 5.0", "at least 5"),
        ("3.4 1.0", "-3.4 1.0", "cutoff must be positive"),
        ("60 40 50 5.0", "60 40 900 5.0", "cut off"),
        ("1 10.0 Aa", "1 10.0", "an atomic number, a mass and a name"),
        ("# made up", "# UNITS: real", "does not convert"),
        (text.split()[-1], "nan", "not a finite number"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(atc.AtcError, match=message) as e:
            atc.potential(lines_of("polymorphic", path, "Aa Bb"), units="metal")
        assert str(path) in str(e.value) and "\n" not in str(e.value)
    path.write_text(text)
    with pytest.raises(atc.AtcError, match="has no element 'Cc': it has Aa, Bb"):
        atc.potential(lines_of("polymorphic", path, "Aa Cc"), units="metal")
