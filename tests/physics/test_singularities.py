"""Where formulas divide zero by zero: straight angles, the perfect crystal, pairs at the cutoff. Everything stays
finite, continuous and exact."""

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps

import atc
from atc.decomposers import (
    CharmmAngle,
    CosineAngle,
    CosineDeltaAngle,
    CosineSquaredAngle,
    HarmonicAngle,
    HarmonicBond,
    StillingerWeber,
)
from atc.frame import Cell, Frame, Topology
from atc.units import units

SI = {
    "epsilon": 2.1683, "sigma": 2.0951, "a": 1.80, "lam": 21.0, "gamma": 1.20, "costheta0": -1.0 / 3.0,
    "A": 7.049556277, "B": 0.6022245584, "p": 4.0, "q": 0.0,
}  # fmt: skip
CUT = SI["a"] * SI["sigma"]
OPEN = (False, False, False)
DIAMOND = np.array(
    [
        [0, 0, 0],
        [0, 0.5, 0.5],
        [0.5, 0, 0.5],
        [0.5, 0.5, 0],
        [0.25, 0.25, 0.25],
        [0.25, 0.75, 0.75],
        [0.75, 0.25, 0.75],
        [0.75, 0.75, 0.25],
    ]
)
REGULAR = {  # U' vanishes at the angle, or U is a polynomial in cos θ: no clamp, and the exact force
    "cosine": CosineAngle((2.0,)),
    "cosine/squared": CosineSquaredAngle((2.0, 110.0)),
    "cosine/delta 180": CosineDeltaAngle((2.0, 180.0)),
    "cosine/delta 0": CosineDeltaAngle((2.0, 0.0)),
}
CLAMPED = {
    "harmonic": HarmonicAngle((2.0, 110.0)),
    "charmm": CharmmAngle((2.0, 110.0, 3.0, 1.5)),
    "cosine/delta": CosineDeltaAngle((2.0, 110.0)),
}


def bent(alpha, d=(1.1, 1.3), turn=True):
    """Three atoms whose angle differs from 180° by alpha."""
    x = np.array([[d[0], 0, 0], [0, 0, 0], [-d[1] * np.cos(alpha), d[1] * np.sin(alpha), 0]])
    if turn:
        q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
        x = x @ q + 0.3
    return x


def evaluate(term, x):
    top = Topology(angles=np.array([[0, 1, 2]]), angle_types=np.array([1]))
    frame = Frame(x, Cell([30.0, 30, 30], (-15, -15, -15), OPEN), units("metal"), topology=top)
    d = atc.potential(term, "metal").decompose(frame)
    assert np.isfinite(d.bonds.G_b).all() and np.isfinite(d.forces_nc).all() and np.isfinite(d.virial_cc).all()
    return d


@pytest.mark.parametrize("style", [*REGULAR, *CLAMPED, "harmonic 180", "harmonic 0"])
@pytest.mark.parametrize("fold", [False, True], ids=["180", "0"])
def test_straight_angles_exert_no_force(style, fold):
    """At exactly 0 and 180° the force on every atom is zero by symmetry, whatever the style says about U'; nothing is
    infinite."""
    term = {**REGULAR, **CLAMPED, "harmonic 180": HarmonicAngle((2.0, 180.0)), "harmonic 0": HarmonicAngle((2.0, 0.0))}[
        style
    ]
    x = bent(0.0)
    if fold:
        x[2] = x[1] + (x[0] - x[1]) * 1.3 / 1.1
    d = evaluate(term, x)
    force = d.forces_nc.copy()
    if style == "charmm":
        # What is left is the Urey-Bradley spring between the outer atoms.
        r = x[0] - x[2]
        u = 2 * 3.0 * (np.linalg.norm(r) - 1.5) / np.linalg.norm(r) * r
        force[0] += u
        force[2] -= u
    # G of the arms is up to U'/0.001 ~ 1e4 here; the forces are what cancellation leaves of it: 1e-16 · 1e4 · a few.
    assert abs(force).max() < 1e-11
    assert np.isfinite(d.energy)


@pytest.mark.parametrize("style", REGULAR)
@pytest.mark.parametrize("alpha", [1e-9, 1e-6, 1e-3, 0.1])
def test_cosine_styles_are_exact_near_180(style, alpha):
    """|force| = |U'(θ)|/d on the outer atoms, to rounding, down to 1e-9 radians; no angle is clamped."""
    d = evaluate(REGULAR[style], bent(alpha))
    c0 = np.cos(np.radians(110.0))
    slope = {  # U'(θ) at θ = π − alpha, written with sin α to have all digits
        "cosine": -2.0 * np.sin(alpha),
        "cosine/squared": -4.0 * (-np.cos(alpha) - c0) * np.sin(alpha),
        "cosine/delta 180": -2.0 * np.sin(alpha),
        "cosine/delta 0": 2.0 * np.sin(alpha),
    }[style]
    # The force is the small difference of bonds' forces of order one: absolute 1e-15.
    np.testing.assert_allclose(np.linalg.norm(d.forces_nc[0]), abs(slope) / 1.1, rtol=1e-9, atol=4e-15)
    np.testing.assert_allclose(np.linalg.norm(d.forces_nc[2]), abs(slope) / 1.3, rtol=1e-9, atol=4e-15)
    assert not d.notes


@pytest.mark.parametrize("alpha", [0.0, 1e-9, 1e-5, 0.9999e-3, 1.0001e-3, 0.05])
@pytest.mark.parametrize("make", [HarmonicAngle, lambda c: CharmmAngle((*c, 0.0, 0.0))], ids=["harmonic", "charmm"])
def test_harmonic_with_180_takes_the_limit(make, alpha):
    """K (θ − π)²: U'/sin θ → −2K, so that G is continuous through θ = 180° and the force is 2Kα/d. LAMMPS clamps and
    loses it below 0.001."""
    d = evaluate(make((2.0, 180.0)), bent(alpha))
    assert not d.notes
    np.testing.assert_allclose(np.linalg.norm(d.forces_nc[0]), 4.0 * alpha / 1.1, rtol=1e-9, atol=4e-15)
    np.testing.assert_allclose(d.energy, 2.0 * alpha**2, rtol=1e-6, atol=1e-30)
    outer = d.bonds.G_b[1] * 1.1 * 1.3
    # G of the outer distance is −U_c/(d d) with U_c = 2K α/sin α.
    np.testing.assert_allclose(outer, -4.0 * (alpha / np.sin(alpha) if alpha else 1.0), rtol=1e-12)


@pytest.mark.parametrize("style", CLAMPED)
def test_clamped_angles_are_counted_and_equal_lammps(style):
    """Where the force really jumps (θ0 ≠ 180°) it is LAMMPS's: sin θ not below 0.001. The count is in the notes."""
    alpha = 4e-4
    d = evaluate(CLAMPED[style], bent(alpha))
    assert sum(d.notes.values()) == 1 and "0.001" in next(iter(d.notes))
    coeff = {
        "harmonic": "harmonic\nangle_coeff 1 2.0 110.0",
        "charmm": "charmm\nangle_coeff 1 2.0 110.0 3.0 1.5",
        "cosine/delta": "cosine/delta\nangle_coeff 1 2.0 110.0",
    }[style]
    config = Config(
        np.diag([30.0, 30, 30]), bent(alpha) + 15, angles=[[0, 1, 2]], bonds=[[0, 1], [1, 2]], masses={1: 1.0}
    )
    res = run_lammps(f"pair_style zero 5\npair_coeff * *\nbond_style zero\nbond_coeff *\nangle_style {coeff}\n", config)
    # LAMMPS has sin from √(1 − cos²) and the angle from acos: 1e-16/4e-4 of an angle, a relative 1e-9 here.
    np.testing.assert_allclose(d.forces_nc, res.forces_nc, rtol=0, atol=1e-8 * abs(res.forces_nc).max())
    assert not evaluate(CLAMPED[style], bent(0.01)).notes


def test_bond_of_no_length():
    """A harmonic bond of length 0 has no direction: no force, as in LAMMPS, and nothing infinite."""
    top = Topology(bonds=np.array([[0, 1]]), bond_types=np.array([1]))
    frame = Frame(np.zeros((2, 3)), Cell([9.0, 9, 9]), units("metal"), topology=top)
    d = atc.potential(HarmonicBond((3.0, 1.0)), "metal").decompose(frame)
    assert d.energy == 3.0 and (d.forces_nc == 0).all() and np.isfinite(d.bonds.G_b).all()


def test_perfect_diamond_crystal():
    """cos θ = cos θ0 in every triplet: the published formula divides 0 by 0 there. Here: no triplet energy, no force,
    finite G, zero pressure."""
    # −4.336573 eV an atom at a = 5.43095 Å is the published cohesive energy; two-body only, so that U = 2 · u(2.3517).
    a = 5.43095
    corners = np.stack(np.meshgrid(*([np.arange(2)] * 3), indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corners + DIAMOND) * a).reshape(-1, 3)
    frame = Frame(x, Cell(np.full(3, 2 * a)), units("metal"))
    d = atc.potential(StillingerWeber(**SI), "metal").decompose(frame)
    two = atc.potential(StillingerWeber(**SI, threebody=False), "metal").decompose(frame)
    assert np.isfinite(d.bonds.G_b).all()
    np.testing.assert_allclose(d.energy, two.energy, rtol=1e-14)
    np.testing.assert_allclose(
        d.energies_n, -2 * SI["epsilon"], rtol=1e-7
    )  # ε is fitted: U = −2ε at the minimum, to the digits of A and B
    assert abs(d.forces_nc).max() < 1e-13
    # 1 eV/Å³ is 160 GPa: the lattice constant's five digits leave some MPa.
    assert abs(np.trace(d.virial_cc)) / 3 / frame.cell.volume * 1.602e5 < 20


def test_crystal_is_a_regular_point():
    """Through the perfect crystal the force is the energy's derivative, by central differences along a random
    direction."""
    a = 5.43095
    x = (DIAMOND * a).reshape(-1, 3)
    way = np.random.default_rng(3).normal(size=x.shape)
    pot = atc.potential(StillingerWeber(**SI), "metal")

    def at(h):
        d = pot.decompose(Frame(x + h * way, Cell(np.full(3, a)), units("metal")))
        return d.energy, -(d.forces_nc * way).sum()

    h = 1e-3
    slope = (8 * (at(h)[0] - at(-h)[0]) - (at(2 * h)[0] - at(-2 * h)[0])) / (12 * h)
    curvature = (at(h)[1] - at(-h)[1]) / (2 * h)
    # Fourth-order differences: h⁴ · U⁗ ~ 1e-12 · 1e4, rounding of the energy 1e-14 · 35/h ~ 1e-9 at worst.
    assert abs(slope - at(0)[1]) < 1e-6 * curvature
    assert curvature > 0


@pytest.mark.parametrize("gap", [0.0, 1e-14, 1e-8, 1e-3, 2e-3, 1e-2])
def test_stillinger_weber_at_its_cutoff(gap):
    """exp(σ/(d − aσ)) goes to 0 with all derivatives: nothing infinite just below aσ, exactly nothing at and beyond
    it."""
    pot = atc.potential(StillingerWeber(**SI), "metal")
    cell = Cell([40.0, 40, 40], (-20, -20, -20), OPEN)
    below = np.array([[CUT - gap, 0, 0], [0, 0, 0], [0, 0, 2.4]])
    d = pot.decompose(Frame(below, cell, units("metal")))
    alone = pot.decompose(Frame(below[1:], cell, units("metal")))
    assert np.isfinite(d.bonds.G_b).all()
    if gap <= 2e-3:
        # exp(−2.1/0.002) underflows: the third atom is not there at all, and leaves no bond.
        assert d.energy == alone.energy and d.n_bonds == 1
        assert (d.forces_nc[0] == 0).all()
    else:
        # 1e-2 from the cutoff: exp(−209) ~ 1e-91, there but negligible.
        assert 0 < np.linalg.norm(d.forces_nc[0]) < 1e-80
        assert d.n_bonds == 3


def test_stillinger_weber_is_smooth_across_its_cutoff():
    """Energy and force as a function of one distance, through aσ: no step larger than its slope allows."""
    pot = atc.potential(StillingerWeber(**SI), "metal")
    cell = Cell([40.0, 40, 40], (-20, -20, -20), OPEN)
    s = np.linspace(CUT - 0.6, CUT + 0.1, 141)
    e, f = [], []
    for d in s:
        x = pot.decompose(Frame([[d, 0, 0], [0, 0, 0], [0.7, 0, 2.3]], cell, units("metal")))
        e.append(x.energy)
        f.append(x.forces_nc[0, 0])
    e, f = np.array(e), np.array(f)
    # −dU/dx by trapezoid: the force integrates to the energy (h² f''/12 · 0.6 Å).
    np.testing.assert_allclose(-np.cumsum(0.5 * (f[1:] + f[:-1])) * (s[1] - s[0]), e[1:] - e[0], atol=2e-4)
    beyond = s >= CUT
    assert (f[beyond] == 0).all() and (e[beyond] == e[-1]).all() and beyond.sum() > 15
    assert abs(f[~beyond][-1]) < 1e-8


@pytest.mark.parametrize("d, counts", [(2.5, False), (np.nextafter(2.5, 0), True), (np.nextafter(2.5, 3), False)])
def test_pairs_at_the_cutoff(d, counts):
    """A pair exactly at r_c does not interact (LAMMPS's rsq < cutsq), one rounding step below it does."""
    pot = atc.potential("pair_style lj/cut 2.5\npair_coeff 1 1 1.0 1.0\n", "lj")
    for x in ([[d, 0, 0], [0, 0, 0]], [[0, d, 0], [0, 0, 0]], [[0, 0, 0], [0, 0, d]]):
        out = pot.decompose(Frame(x, Cell([9.0, 9, 9]), units("lj")))
        assert (out.n_bonds == 1 and out.energy < 0) == counts
        assert out.n_bonds == int(counts)
