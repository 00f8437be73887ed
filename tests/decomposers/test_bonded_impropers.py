"""Impropers of a pyramid: style by style against LAMMPS, in the plane and upright, and what prefers one hand."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from lammps_oracle import Config, run_lammps
from test_decomposers_dihedral import CELLS, lines_of, one

import atc
from atc.errors import AtcError, AtcWarning

ZERO = ["pair_style zero 5.0 nocoeff", "pair_coeff * *"]
IMPROPERS = {
    "umbrella": ["1 3 0", "2 2 50", "3 1 80"],
    "fourier": ["1 3 0.2 0.5 -0.7", "2 2 1 -1 0 0", "3 1 0 0 1 1"],
    "inversion/harmonic": ["1 3 0", "2 2 40", "3 1 10"],
    "distance": ["1 3 2", "2 2 0", "3 0 1"],
    "distharm": ["1 3 0", "2 2 0", "3 0 1.5"],
    "sqdistharm": ["1 3 0.2", "2 2 0", "3 0 1"],
    "ring": ["1 3 110", "2 2 90", "3 1 70"],
    "class2": [
        "1 3 0",
        "2 2 0",
        "3 0 20",
        "1 aa 0.5 0.7 0.9 100 110 120",
        "2 aa 0 0 0 1 1 1",
        "3 aa 1 -2 0.3 90 100 130",
    ],
    "cossq": ["1 3 0", "2 2 50", "3 1 90"],
}
faulty = pytest.mark.filterwarnings("ignore:improper_style cossq:atc.errors.AtcWarning")


def pyramids(cell="tilted", n=12, types=3, seed=0, style="real"):
    """An apex (the first atom or the second) with three arms of about 1.2 Å, from flat to steep, across the faces of a
    small cell."""
    rng = np.random.default_rng(seed)
    x = []
    for _ in range(n):
        a = 2 * np.pi * (np.arange(3) + rng.uniform(-0.15, 0.15, 3)) / 3
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        arms = rng.uniform(1.0, 1.4, (3, 1)) * np.column_stack(
            [np.cos(a), np.sin(a), rng.uniform(-0.9, 0.9) + rng.uniform(-0.2, 0.2, 3)]
        )
        x.append(np.concatenate([np.zeros((1, 3)), arms]) @ q + rng.uniform(0, 10, 3))
    x = np.concatenate(x)
    c = CELLS[cell]
    s = np.floor(x @ np.linalg.inv(c))
    terms = np.arange(4 * n).reshape(n, 4)
    terms[::2] = terms[::2][:, [1, 0, 2, 3]]
    return Config(c, x - s @ c, units=style, impropers=terms, improper_types=rng.integers(1, types + 1, n))


@faulty
@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
@pytest.mark.parametrize("style", IMPROPERS)
def test_impropers_agree_with_lammps(style, cell):
    config = pyramids(cell)
    lines = lines_of("improper", style, IMPROPERS[style])
    agrees_with_lammps(potential("\n".join(lines), config), [*ZERO, *lines], config)


@pytest.mark.parametrize("style", IMPROPERS)
def test_sources_are_the_derivatives_of_the_shares(style):
    config = pyramids(n=4, seed=3)
    lines = lines_of(
        "improper",
        style,
        [c.replace("2 2 50", "2 2 0").replace("3 1 90", "3 1 0") if style == "cossq" else c for c in IMPROPERS[style]],
    )
    sources_are_derivatives(potential("\n".join(lines), config), config.frame())


def flat(height, arms=(1.1, 1.3, 0.9), turn=0.0):
    """Atom 1 at this height over the plane of three others, at about 120° from each other."""
    a = np.radians([0.0, 115.0, 230.0]) + turn
    return np.concatenate(
        [[[0, 0, height]], np.array(arms)[:, None] * np.column_stack([np.cos(a), np.sin(a), np.zeros(3)])]
    )


FLAT = {
    s: [c for c in IMPROPERS[s] if c[0] == "1"]
    for s in ("umbrella", "fourier", "inversion/harmonic", "distance", "distharm", "sqdistharm", "ring", "class2")
}


@pytest.mark.parametrize("style", FLAT)
def test_walk_through_the_plane(style):
    """From above to below the plane: finite, the mirror image's forces mirrored, smooth; the energy even in the
    height."""
    pot = atc.potential("\n".join(lines_of("improper", style, FLAT[style])), "metal")
    apex_first = style not in ("ring", "class2")

    def at(h):
        x = flat(h)
        return pot.decompose(one(x if apex_first else x[[1, 0, 2, 3]], "improper"), sources=True)

    plane = at(0.0)
    assert not plane.notes and np.isfinite(plane.bonds.D_bdc).all() and np.abs(plane.forces_nc[:, 2]).max() < 1e-14
    # ring, a sixth power, is the stiffest: 2000 eV/Å².
    for h in 10.0 ** -np.arange(1, 16.0):
        up, down = at(h), at(-h)
        assert up.energy == pytest.approx(down.energy, rel=1e-14, abs=1e-300)
        np.testing.assert_allclose(up.forces_nc, down.forces_nc * [1, 1, -1], rtol=0, atol=1e-13)
        assert np.abs(up.forces_nc - plane.forces_nc).max() <= 3000 * h + 1e-12
        assert abs(up.energy - plane.energy) <= 3000 * h * h + 1e-12


@pytest.mark.parametrize("h", [1e-3, 3e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("style", ["inversion/harmonic", "class2"])
@pytest.mark.parametrize("place", ["flat", "upright"])
def test_slopes_beside_planes_and_upright_arms(place, style, h):
    """Down to where rounding ends it the force is the slope of the energy, as in LAMMPS."""
    x = flat(h) if place == "flat" else np.array([[0.0, 0, 0], [1, 0, 0], [0.1, 1.2, 0], [h, 0.3 * h, 1.1]])
    lines = f"improper_style {style}\nimproper_coeff 1 10 {30 if style[0] == 'i' else 0}"
    if style == "class2":
        x, lines = x[[1, 0, 2, 3]], lines + "\nimproper_coeff 1 aa 1 2 3 120 110 115"
    config = Config(np.diag([12.0, 12, 12]), x + 5.0, units="real", impropers=[[0, 1, 2, 3]])
    theirs = run_lammps("\n".join([*ZERO, lines]), config).forces_nc
    frame = config.frame()
    d = atc.potential(lines, "real").decompose(frame)
    # Angles by their cosines: rounding is 1e-16/h² of them.
    tolerance = max(1e-9, 1e-16 / h**2)
    mine = frame.units.to_user("force", d.forces_nc)
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=tolerance * np.abs(theirs).max())
    assert not d.notes


def test_ridges_and_upright_arms():
    d = atc.potential("improper_style inversion/harmonic\nimproper_coeff 1 3 40", "metal").decompose(
        one(flat(0.0), "improper")
    )
    assert list(d.notes.values()) == [3] and np.isfinite(d.forces_nc).all()
    assert d.energy == pytest.approx(3 * np.radians(40) ** 2)
    # Atom 4's arm upright on the plane of the others.
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0.1, 1.2, 0], [0, 0, 1.1]])
    for lines in ("umbrella\nimproper_coeff 1 3 50", "fourier\nimproper_coeff 1 3 0.2 0.5 -0.7 0"):
        d = atc.potential("improper_style " + lines, "metal").decompose(one(x, "improper"))
        assert sum(d.notes.values()) == 1 and np.isfinite(d.forces_nc).all()
    with pytest.raises(AtcError, match="improper distance of the atoms 1, 2, 3, 4 has no finite energy"):
        atc.potential("improper_style distance\nimproper_coeff 1 3 1", "metal").decompose(
            one(np.array([[0.0, 0, 1], [0, 0, 0], [1, 0, 0], [2, 0, 0]]), "improper")
        )


REFUSED = [
    ("distharm\nimproper_coeff 1 3 0.2", "d0 is oriented and not 0: the pyramid and its mirror image differ"),
    ("class2\nimproper_coeff 1 3 20\nimproper_coeff 1 aa 0 0 0 1 1 1", "chi is oriented and chi0 not 0"),
    ("class2\nimproper_coeff 1 3 0", r"lacks coefficients: add improper_coeff 1 aa \(data file: AngleAngle Coeffs\)"),
    ("umbrella\nimproper_coeff 1 3 180", "omega0 must be 0 or an angle with a sine"),
    (
        "fourier\nimproper_coeff 1 3 0 1 0 2",
        "line 2: improper_coeff of fourier: expected K C0 C1 C2 and optionally 0 or 1",
    ),
]


@pytest.mark.parametrize("lines, says", REFUSED)
def test_refused(lines, says):
    with pytest.raises(AtcError, match=says) as e:
        atc.potential("improper_style " + lines, "metal")
    assert "\n" not in str(e.value)


def test_forces_that_are_no_derivative_are_said():
    with pytest.warns(AtcWarning, match="cossq with chi0 other than 0"):
        atc.potential("improper_style cossq\nimproper_coeff 1 3 50", "metal")


def test_an_oriented_improper_is_refused_only_where_a_frame_uses_it():
    config = pyramids(n=4, types=1)
    lines = ["improper_style distharm", "improper_coeff 1 3 0", "improper_coeff 2 3 0.2"]
    pot = atc.potential("\n".join(lines), units="real")
    agrees_with_lammps(pot, [*ZERO, *lines[:2]], config)
    frame = config.frame()
    frame.topology.improper_types[1] = 2
    with pytest.raises(AtcError, match="improper type 2 of style distharm: its distance d0 is oriented"):
        pot.decompose(frame)
