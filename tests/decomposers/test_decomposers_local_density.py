"""local/density: LAMMPS with several potentials and filters of types, energy sources, what is refused."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from many_body_systems import TILTS, crystal

import atc
from atc.decomposers.many_body.local_density import _indicator
from atc.frame import Cell, Frame
from atc.units import units

BLOCKS = [(2.5, 5.0, "1", "1 2", 0.5, 14), (0.0, 4.0, "2 1", "1", 0.0, 9), (3.0, 4.5, "3", "3 1", 0, 8)]


@pytest.fixture
def table(tmp_path):
    rng = np.random.default_rng(0)
    out = ["# three potentials", "", "3 30", ""]
    for r1, r2, central, near, low, high in BLOCKS:
        out += [f"{r1} {r2}", central, near, f"{low} {high} 0.1", *(f"{x:.16g}" for x in rng.uniform(-1, 1, 30)), ""]
    path = tmp_path / "three.table"
    path.write_text("\n".join(out) + "\n")
    return path


def lines_of(path):
    return f"pair_style local/density\npair_coeff * * {path}"


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("style", ["metal", "real", "lj"])
def test_agrees_with_lammps(table, style, tilt):
    config = crystal(5.0, kinds=3, tilt=tilt, style=style)
    # Random tables: slopes of 10 per unit of density where a smooth one has 1.
    agrees_with_lammps(potential(lines_of(table), config), lines_of(table), config)


def test_overlay_types_beyond_the_file_and_sources(table):
    config = crystal(5.0, kinds=4)
    lines = [
        "pair_style hybrid/overlay lj/cut 4.0 local/density",
        "pair_coeff * * lj/cut 0.01 2.0",
        f"pair_coeff * * local/density {table}",
    ]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)
    config = crystal(5.0, n=(1, 1, 1), kinds=3)
    pot = potential(lines_of(table), config)
    assert "to the atom whose neighbours are counted" in pot.describe()
    sources_are_derivatives(pot, config.frame(), atoms=range(0, 8, 3), tolerance=1e-7)


def test_indicator_and_an_atom_alone(table):
    row = np.array([2.5**2, 5.0**2])
    assert _indicator(2.5, row) == (1.0, 0.0) and _indicator(5.0, row) == (0.0, 0.0)
    for d in (2.6, 3.7, 4.9):
        (up, _), (down, _), (_, g) = _indicator(d + 1e-6, row), _indicator(d - 1e-6, row), _indicator(d, row)
        assert (up - down) / 2e-6 == pytest.approx(g * d, abs=1e-9)
    # F below its table is its first value, for an atom without neighbours too.
    d = atc.potential(lines_of(table), units="metal").decompose(
        Frame(np.zeros((1, 3)), Cell(np.eye(3) * 30), units("metal"), types=[1])
    )
    first = [float(line) for line in table.read_text().splitlines() if line.count(" ") == 0 and "." in line]
    assert d.energy == pytest.approx(first[0] + first[30], rel=1e-14)


DAMAGE = [
    ("3 30", "4 30", "cut off"),
    ("3 30", "x", "number of potentials"),
    ("2.5 5.0", "5.5 5.0", "0 <= R1 < R2"),
    ("0.5 14 0.1", "14 0.5 0.1", "rho_max must be larger"),
    ("2 1\n", "a 1\n", "central types of potential 2"),
]


@pytest.mark.parametrize("old,new,message", DAMAGE)
def test_damaged(table, old, new, message):
    text = table.read_text()
    assert old in text
    table.write_text(text.replace(old, new, 1))
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines_of(table), units="metal")
    assert str(table) in str(e.value) and "\n" not in str(e.value)


def test_refused(table):
    for lines, message in (
        (f"pair_style local/density 3\npair_coeff * * {table}", "expected no arguments"),
        (f"pair_style local/density\npair_coeff 1 1 {table}", "takes"),
        (f"pair_style local/density\npair_coeff * * {table} Si", "takes"),
    ):
        with pytest.raises(atc.AtcError, match=message):
            atc.potential(lines, units="metal")
