"""Torsions beyond a series in cos φ: style by style against LAMMPS, planes and lines, and what is not a function of
distances."""

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
    + [
        f"2 {c}"
        for c in (
            "mbt 0 0.1 0 1",
            "ebt 0 0.1 0 0.2 0 0 1 1",
            "at 0 0 1 1 0 0 90 100",
            "aat -1 110 100",
            "bb13 0.5 1 1.2",
        )
    ],
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
    np.testing.assert_allclose(
        u.to_user("energy", d.energies_n), res.energies_n, rtol=0, atol=1e-10 * np.abs(res.energies_n).max()
    )
    np.testing.assert_allclose(
        u.to_user("force", d.forces_nc), res.forces_nc, rtol=0, atol=1e-10 * np.abs(res.forces_nc).max()
    )
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
    sources_are_derivatives(
        potential("\n".join(lines_of("dihedral", style, TORSIONS[style])), config), config.frame(), tolerance=tolerance
    )


def torsion_tables(folder, odd=0.0):
    """Two sections, even in φ but for `odd`: one with forces that are not quite the derivative, unevenly spaced, and
    one without forces."""
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
    lines = [
        f"dihedral_style table {way}",
        "dihedral_coeff 1 @torsion.table WITH",
        "dihedral_coeff 2 @torsion.table PLAIN",
    ]
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
        AtcError,
        match=r"line 1: dihedral type 1 of style table: its table is not the same for phi and -phi .*mirror image",
    ):
        atc.potential(lines, units="real", folder=tmp_path)


@pytest.mark.parametrize("way", ["linear 90", "linear 55", "spline 55"])
def test_walk_through_the_planes_of_a_table(tmp_path, way):
    torsion_tables(tmp_path)
    pot = atc.potential(
        f"dihedral_style table {way}\ndihedral_coeff 1 torsion.table WITH", units="real", folder=tmp_path
    )
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


SMOOTH = {
    "class2": "dihedral_style class2\n" + "\n".join(f"dihedral_coeff 1 {c}" for c in ("1.1 0 0.7 180 0.4 0", *CROSS)),
    "spherical": "dihedral_style spherical\ndihedral_coeff 1 2 1.5 1 0 0.3 1 20 0.2 2 40 0.7 0.8 3 60 1 0 0 0 2 90 1",
    "quadratic": "dihedral_style quadratic\ndihedral_coeff 1 2 0",
    "cosine/shift/exp": "dihedral_style cosine/shift/exp\ndihedral_coeff 1 2 180 -1.5",
    "restricted": "dihedral_style cosine/squared/restricted\ndihedral_coeff 1 0.5 180",
}


@pytest.mark.parametrize(
    "name, plane",
    [(n, p) for n in SMOOTH for p in (0.0, np.pi) if (n, p) not in (("quadratic", np.pi), ("restricted", 0.0))],
)
def test_walk_through_planar_chains(name, plane):
    pot = atc.potential(SMOOTH[name], "metal")
    at = pot.decompose(one(chain(plane)), sources=True)
    assert not at.notes and np.isfinite(at.bonds.D_bdc).all()
    for o in 10.0 ** -np.arange(1, 16.0):
        up, down = (pot.decompose(one(chain(plane + s * o))) for s in (1, -1))
        assert np.abs(up.forces_nc - at.forces_nc).max() <= 400 * o + 1e-11
        assert abs(up.energy - at.energy) <= 100 * o * o + 1e-12
        np.testing.assert_allclose(up.forces_nc[:, 2], -down.forces_nc[:, 2], rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", SMOOTH)
def test_walk_through_collinear_chains(name):
    """Three atoms in a line: finite, and counted where cos φ is continued."""
    pot = atc.potential(SMOOTH[name], "metal")
    for sine in (0.0, 1e-9, 5e-4):
        d = pot.decompose(one(chain(2.0, np.pi - np.arcsin(sine))), sources=True)
        assert sum(d.notes.values()) == 1 and np.isfinite(d.forces_nc).all() and np.isfinite(d.bonds.D_bdc).all()


def test_poles_and_ridges():
    d = atc.potential(SMOOTH["quadratic"], "metal").decompose(one(chain(np.pi)))
    assert (
        d.energy == pytest.approx(2 * np.pi**2)
        and list(d.notes.values()) == [1]
        and "plane they do not prefer" in next(iter(d.notes))
    )
    # Beside the ridge the torque is that of the formula, 2 K φ, also as near as 1e-4: the force out of the plane on
    # atom 4.
    f = atc.potential(SMOOTH["quadratic"], "metal").decompose(one(chain(np.pi - 1e-4))).forces_nc[3]
    assert np.linalg.norm(f) == pytest.approx(2 * 2 * np.pi / (0.9 * np.sin(1.8)), rel=1e-3)
    with pytest.raises(AtcError, match="cosine/squared/restricted of the atoms 1, 2, 3, 4 has no finite energy"):
        atc.potential(SMOOTH["restricted"], "metal").decompose(one(chain(0.0)))


REFUSED = [
    ("quadratic\ndihedral_coeff 1 2 60", "60 degrees is neither 0 nor 180"),
    ("helix\ndihedral_coeff 1 1 2 0.5", "45 degrees is neither 0 nor 180: .*mirror image"),
    ("cosine/shift/exp\ndihedral_coeff 1 2 60 1", "60 degrees is neither"),
    ("cosine/shift/exp\ndihedral_coeff 1 2 0 1e-4", "below 0.001 LAMMPS's forces are not the derivative"),
    ("spherical\ndihedral_coeff 1 1 1.5 1 30 0.3 1 20 0.2 2 40 0.7", "30 degrees is neither"),
    ("spherical\ndihedral_coeff 1 1 1.5 1.5 0 0.3 1 20 0.2 2 40 0.7", "1.5 of phi is no whole number"),
    ("spherical\ndihedral_coeff 1 2 1.5 1 0 0.3", "line 2: dihedral_coeff of spherical: expected n and then"),
    ("table linear\ndihedral_coeff 1 x y", "takes linear or spline and a number of points"),
    ("table linear 50\ndihedral_coeff 1 torsion.table NONE", "has no section 'NONE'; it has WITH, PLAIN"),
    (
        "table linear 50\ndihedral_coeff 1 bad.table TURN",
        "must increase from line to line within less than a full turn",
    ),
    (
        "table linear 50\ndihedral_coeff 1 bad.table WORDS",
        r"bad.table:\d+: expected the parameters of a dihedral table",
    ),
    ("table linear 50\ndihedral_coeff 1 bad.table SHORT", r"needs 3 lines of index, phi, energy; line 3 of them"),
    ("table/cut linear 50\ndihedral_coeff 1 aat 1 90 80 torsion.table WITH", "the second angle must be larger"),
]


@pytest.mark.parametrize("lines, says", REFUSED)
def test_refused(tmp_path, lines, says):
    torsion_tables(tmp_path)
    (tmp_path / "bad.table").write_text(
        "TURN\nN 2\n\n1 0 0 0\n2 360 0 0\n\nWORDS\nN 2 FAST\n\nSHORT\nN 3 NOF\n\n1 0 0\n2 1 0\n"
    )
    with pytest.raises(AtcError, match=says) as e:
        atc.potential("dihedral_style " + lines, units="real", folder=tmp_path)
    assert "\n" not in str(e.value)


def test_types_of_one_hand_are_refused_only_where_a_frame_uses_them():
    config = chains(n=4, types=1)
    lines = ["dihedral_style quadratic", "dihedral_coeff 1 2 180", "dihedral_coeff 2 2 60"]
    pot = atc.potential("\n".join(lines), units="real")
    agrees_with_lammps(pot, [*ZERO, *lines[:2]], config)
    frame = config.frame()
    frame.topology.dihedral_types[1] = 2
    with pytest.raises(AtcError, match="dihedral type 2 of style quadratic: the phase 60 degrees is neither 0 nor 180"):
        pot.decompose(frame)
