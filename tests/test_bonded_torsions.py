"""Torsions beyond a series in cos φ: style by style against LAMMPS, planes and lines, and what is not a function of distances."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, sources_are_derivatives
from lammps_oracle import run_lammps
from test_decomposers_dihedral import chain, chains, lines_of, one

import atc
from atc.errors import AtcError

ZERO = ["pair_style zero 5.0 nocoeff", "pair_coeff * *"]
CROSS = (
    "mbt 0.1 0.2 0.3 1.3",
    "ebt 0.3 0.2 0.1 0.15 0.25 0.35 1.0 0.8",
    "at 0.5 0.4 0.3 0.2 0.1 0.6 100 110",
    "aat 0.8 100 110",
    "bb13 0.9 1.0 0.8",
)
TORSIONS = {
    "class2": ["1 1.1 0 0.7 180 0.4 0", "2 1.1 180 0 50 0.4 -180", "3 0.5 0 -0.3 0 0.2 180"]
    + [f"{t} {c}" for t in (1, 3) for c in CROSS]
    + [f"2 {c}" for c in ("mbt 0 0.1 0 1", "ebt 0 0.1 0 0.2 0 0 1 1", "at 0 0 1 1 0 0 90 100", "aat -1 110 100", "bb13 0.5 1 1.2")],
    "spherical": [
        "1 1 1.5 2 90 0.3 1 20 0.2 3 40 0.7",
        "2 2 1.5 1 0 0.3 1 20 0.2 2.5 40 0.7 0.8 3 60 1 0 0 0 2 90 1",
        "3 1 -1 0 0 0.5 2 90 1 1 0 1",
    ],
    "quadratic": ["1 1.3 0", "2 0.7 180", "3 2.0 -180"],
    "helix": ["1 1.3 0.4 0", "2 0.3 1.4 0.0", "3 1 2 0"],
    "cosine/shift/exp": ["1 1.3 0 2", "2 0.7 180 -1.5", "3 2.0 180 0"],
    "cosine/squared/restricted": ["1 1.3 60", "2 0.7 180", "3 2.0 0"],
}


@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
@pytest.mark.parametrize("style", [s for s in TORSIONS if s != "spherical"])
def test_torsions_agree_with_lammps(style, cell):
    config = chains(cell, n=12, types=3)
    lines = lines_of("dihedral", style, TORSIONS[style])
    agrees_with_lammps(potential("\n".join(lines), config), [*ZERO, *lines], config)


def test_spherical_agrees_with_lammps_but_for_its_pressure():
    """LAMMPS tallies another virial for this style than its forces have: ours is that of the forces."""
    config = chains("tilted", n=12, types=3)
    lines = lines_of("dihedral", "spherical", TORSIONS["spherical"])
    res = run_lammps([*ZERO, *lines], config)
    d = potential("\n".join(lines), config).decompose(config.frame())
    u = config.frame().units
    np.testing.assert_allclose(u.to_user("energy", d.energies_n), res.energies_n, rtol=0, atol=1e-10 * np.abs(res.energies_n).max())
    np.testing.assert_allclose(u.to_user("force", d.forces_nc), res.forces_nc, rtol=0, atol=1e-10 * np.abs(res.forces_nc).max())
    x = config.positions.reshape(-1, 4, 3)
    step = np.diff(x, axis=1)
    step -= np.round(step @ np.linalg.inv(config.cell)) @ config.cell
    x = np.concatenate([np.zeros((len(x), 1, 3)), np.cumsum(step, axis=1)], axis=1)
    virial = -np.einsum("tka,tkb->ab", x, u.to_internal("force", res.forces_nc).reshape(-1, 4, 3))
    np.testing.assert_allclose(d.virial_cc, virial, rtol=0, atol=1e-10 * np.abs(virial).max())
    theirs = u.to_internal("pressure_volume", res.virial)
    assert np.abs(theirs - virial).max() > 0.1 * np.abs(virial).max()
    consistent_bonds(d, len(config.positions))


@pytest.mark.parametrize("style", TORSIONS)
def test_sources_are_the_derivatives_of_the_shares(style):
    config = chains(n=3, types=3, seed=3)
    # The restricted style has a pole in the planes: third derivatives of 1e9 beside values of 1.
    tolerance = 3e-6 if style == "cosine/squared/restricted" else 3e-8
    sources_are_derivatives(potential("\n".join(lines_of("dihedral", style, TORSIONS[style])), config), config.frame(), tolerance=tolerance)


def torsion_tables(folder, odd=0.0):
    """Two sections, even in φ but for `odd`: one with forces that are not quite the derivative, unevenly spaced, and one without forces."""
    out = ["# torsions UNITS: real", ""]
    turn = 2 * np.pi / 24
    for name, words, bend in (("WITH", "N 24 DEGREES", 0.3), ("PLAIN", "NOF RADIANS N 24", 0.0)):
        phi = -np.pi + turn * np.arange(1, 25)
        phi = phi + bend * turn * np.sin(2 * phi)
        e = 1.3 * np.cos(phi) + 0.4 * np.cos(2 * phi) - 0.3 * np.cos(3 * phi) + odd * np.sin(phi)
        f = 1.3 * np.sin(phi) + 0.8 * np.sin(2 * phi) - 0.95 * np.sin(3 * phi)
        size = 1.0 if "RADIANS" in words else np.pi / 180
        rows = [
            f"{k + 1} {a / size:.17g} {b:.17g}" + ("" if "NOF" in words else f" {c * size:.17g}")
            for k, (a, b, c) in enumerate(zip(phi, e, f, strict=True))
        ]
        out += [name, words, "", *rows, ""]
    (folder / "torsion.table").write_text("\n".join(out))


@pytest.mark.parametrize("way", ["linear 90", "linear 55", "spline 90", "spline 55"])
def test_tables_agree_with_lammps(tmp_path, way):
    torsion_tables(tmp_path)
    config = chains("tilted", n=12, types=2)
    lines = [f"dihedral_style table {way}", "dihedral_coeff 1 @torsion.table WITH", "dihedral_coeff 2 @torsion.table PLAIN"]
    cut = [
        f"dihedral_style table/cut {way}",
        "dihedral_coeff 1 aat 1.2 60 150 @torsion.table WITH",
        "dihedral_coeff 2 aat 1 100 120 @torsion.table PLAIN",
    ]
    for script in (lines, cut):
        pot = atc.potential("\n".join(script).replace("@", ""), units="real", folder=tmp_path)
        agrees_with_lammps(pot, [*ZERO, *(line.replace("@", f"{tmp_path}/") for line in script)], config)


def test_tables_that_prefer_one_hand_are_refused_where_they_are_used(tmp_path):
    torsion_tables(tmp_path, odd=1e-3)
    lines = "dihedral_style table spline 90\ndihedral_coeff 1 torsion.table WITH\n"
    with pytest.raises(
        AtcError, match=r"line 1: dihedral type 1 of style table: its table is not the same for phi and -phi .*mirror image"
    ):
        atc.potential(lines, units="real", folder=tmp_path)


@pytest.mark.parametrize("way", ["linear 90", "linear 55", "spline 55"])
def test_walk_through_the_planes_of_a_table(tmp_path, way):
    torsion_tables(tmp_path)
    pot = atc.potential(f"dihedral_style table {way}\ndihedral_coeff 1 torsion.table WITH", units="real", folder=tmp_path)
    for plane in (0.0, np.pi):
        at = pot.decompose(one(chain(plane)))
        for o in 10.0 ** -np.arange(1, 16.0):
            up, down = (pot.decompose(one(chain(plane + s * o))) for s in (1, -1))
            assert not up.notes and np.isfinite(up.forces_nc).all()
            # A few kcal/mol: |dF/dφ| below 10 eV/Å.
            assert np.abs(up.forces_nc - at.forces_nc).max() < 10 * o + 1e-13
            np.testing.assert_allclose(up.forces_nc[:, 2], -down.forces_nc[:, 2], rtol=0, atol=1e-13)
            # The out-of-plane force by angle keeps its value down to the plane.
            if 1e-11 < o < 5e-3:
                np.testing.assert_allclose(
                    up.forces_nc[3, 2] / o, pot.decompose(one(chain(plane + 1e-3))).forces_nc[3, 2] / 1e-3, rtol=1e-4
                )
