"""Crystals: published lattice and elastic constants, force constants against closed forms, phonopy and ASE, what is
refused."""

from itertools import product

import numpy as np
import pytest
from crystals import CUTOFF, EPSILON, MASS, SIGMA, constants, crystal, elastic, model, start

import atc
from atc.errors import AtcError
from atc.upscaling.crystal import Crystal, relax
from atc.upscaling.elasticity import elastic_constants
from atc.upscaling.force_constants import THZ, force_constants, nearest_images, signed_root
from atc.upscaling.phonopy_bridge import frequencies, phonopy_from, phonopy_of


def shells(a):
    """(b, 3) vectors of an fcc lattice within the cutoff."""
    n = np.array([m for m in product(range(-4, 5), repeat=3) if sum(m) % 2 == 0 and any(m)])
    r = 0.5 * a * n
    return r[np.linalg.norm(r, axis=1) < CUTOFF]


def slopes(r):
    """U'/r and U'' of Lennard-Jones, written out."""
    d = np.linalg.norm(r, axis=1)
    first = 4 * EPSILON * (-12 * SIGMA**12 / d**13 + 6 * SIGMA**6 / d**7)
    second = 4 * EPSILON * (156 * SIGMA**12 / d**14 - 42 * SIGMA**6 / d**8)
    return first / d, second


# ---- published numbers


def test_argon():
    c = crystal("argon")
    # The published numbers have six, four and six digits; the tolerance of each is half of its last one, or 1e-4.
    assert c.lattice_constant == pytest.approx(5.26865, rel=1e-6)
    C = elastic("argon").gpa()
    assert C[0, 0] == pytest.approx(4.142, rel=1.2e-4) and C[0, 1] == pytest.approx(2.358, rel=1.2e-4)
    assert C[3, 3] == pytest.approx(
        C[0, 1], rel=1e-8
    )  # Cauchy: central forces at zero pressure, every atom a centre of symmetry
    x = 2 * np.pi / c.lattice_constant * np.array([1, 0, 0])
    ta, ta2, la = constants("argon").frequencies(x)[0] * THZ
    assert (
        la == pytest.approx(1.99605, rel=3e-6)
        and ta == pytest.approx(1.36553, rel=3e-6)
        and ta2 == pytest.approx(ta, rel=1e-12)
    )


def test_silicon():
    assert crystal("silicon").lattice_constant == pytest.approx(5.43095, rel=1e-6)
    e = elastic("silicon")
    np.testing.assert_allclose(np.array(e.cubic) * 160.2176634, [151.4, 76.4, 56.4], rtol=2e-3)
    # Without inner relaxation C44 is nearly twice that (117 to 110 GPa are quoted for it): the term is not decoration.
    assert e.gpa("born_vv")[3, 3] > 1.9 * e.gpa()[3, 3]
    assert e.stable


def test_lattice_constant_is_where_the_pressure_vanishes():
    a = crystal("argon").lattice_constant
    r = shells(a)
    trace = (slopes(r)[0] * np.einsum("bc,bc->b", r, r)).sum()
    scale = np.abs(slopes(r)[0] * np.einsum("bc,bc->b", r, r)).sum()
    assert abs(trace) < 1e-12 * scale
    squeezed = relax(start("argon"), model("argon"), pressure=1000.0)  # bar
    assert squeezed.lattice_constant < a
    # Linear elasticity: −ΔV/V = p/K.
    K = (elastic("argon").cubic[0] + 2 * elastic("argon").cubic[1]) / 3
    p = squeezed.units.to_internal("pressure", 1000.0)
    assert 3 * np.log(a / squeezed.lattice_constant) == pytest.approx(p / K, rel=0.15)


def test_relax_finds_a_basis_and_a_cell():
    """Silicon from a cell that is sheared, stretched and has its basis displaced."""
    c = start("silicon").strained(
        [[0.02, 0.01, 0.0], [0.01, -0.01, 0.005], [0.0, 0.005, 0.01]], [[0, 0, 0], [0.1, -0.05, 0.07]]
    )
    found = relax(c, model("silicon"))
    assert found.volume == pytest.approx(crystal("silicon").volume, rel=1e-8)
    r = nearest_images((found.positions[1] - found.positions[0])[None], found.vectors)[0]
    assert np.linalg.norm(r) == pytest.approx(np.sqrt(3) / 4 * crystal("silicon").lattice_constant, rel=1e-8)


# ---- elastic constants


def test_born_term_is_the_bond_sum():
    """C_ijkl of a lattice of pairs: (1/2V) Σ (U'' − U'/r)/r² r_i r_j r_k r_l at zero pressure."""
    a = crystal("argon").lattice_constant
    r = shells(a)
    first, second = slopes(r)
    weight = (second - first) / np.einsum("bc,bc->b", r, r)
    C = 0.5 / (a**3 / 4) * np.einsum("b,bi,bj,bk,bl->ijkl", weight, r, r, r, r)
    # Sixth-order differences at strains of 1e-4: rounding of the virial, 1e-16 / 1e-4, times what cancels.
    np.testing.assert_allclose(elastic("argon").tensor, C, atol=1e-9 * C.max())


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_elastic_constants_are_the_long_wave_limit(name):
    rng = np.random.default_rng(5)
    k = rng.normal(size=(12, 3))
    k *= 1e-3 / np.linalg.norm(k, axis=1)[:, None]
    slow = constants(name).frequencies(k)[:, :3]
    classical = signed_root(np.linalg.eigvalsh(elastic(name).christoffel(k)))
    # The leading correction is (ka)²/24: 1e-6 here.
    np.testing.assert_allclose(slow, classical, rtol=3e-6)


def test_elastic_constants_follow_the_crystal_when_it_turns():
    angle = 0.4
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    c = crystal("silicon").strained(R - np.eye(3))
    turned = np.einsum("ai,bj,ck,dl,ijkl->abcd", R, R, R, R, elastic("silicon").tensor)
    mine = elastic_constants(c, model("silicon")).tensor
    np.testing.assert_allclose(mine, turned, atol=1e-7 * turned.max())


def test_elastic_constants_refuse_a_basis_that_is_not_at_rest():
    moved = crystal("silicon").strained(None, [[0, 0, 0], [0.05, 0, 0]])
    with pytest.raises(AtcError, match="not in equilibrium"):
        elastic_constants(moved, model("silicon"))


# ---- force constants


def test_analytic_force_constants():
    fc = constants("argon")
    assert fc.method == "analytic"
    r = shells(crystal("argon").lattice_constant)
    assert len(fc.i) == len(r)
    first, second = slopes(r)
    n = r / np.linalg.norm(r, axis=1)[:, None]
    phi = -(
        second[:, None, None] * n[:, :, None] * n[:, None, :]
        + first[:, None, None] * (np.eye(3) - n[:, :, None] * n[:, None, :])
    )
    mine = {tuple(np.round(x, 4) + 0.0): p for x, p in zip(fc.r_bc, fc.phi_bcc)}
    theirs = {tuple(np.round(x, 4) + 0.0): p for x, p in zip(r, phi)}
    assert mine.keys() == theirs.keys()
    # An eighth-order difference of G in ξ: 1e-16 over a relative step of 5e-4.
    for x, p in theirs.items():
        np.testing.assert_allclose(mine[x], p, atol=1e-11 * np.abs(phi).max())


def test_displacements_give_the_same():
    rng = np.random.default_rng(1)
    k = rng.uniform(-1, 1, (40, 3)) * 2
    fc = force_constants(crystal("argon"), model("argon"), method="displacements")
    assert fc.method == "displacements" and fc.defect < 1e-10
    np.testing.assert_allclose(fc.frequencies(k), constants("argon").frequencies(k), atol=1e-9)


@pytest.mark.parametrize("name, repeat", [("argon", (5, 5, 5)), ("silicon", (4, 4, 4))])
def test_phonopy(name, repeat):
    """phonopy's own displacements, symmetry and dynamical matrix; at random k, compared in ascending order since
    branches cross."""
    rng = np.random.default_rng(2)
    k = rng.uniform(-1, 1, (40, 3)) * 2 * np.pi / crystal(name).lattice_constant
    mine = constants(name).frequencies(k) * THZ
    theirs = frequencies(phonopy_of(crystal(name), model(name), repeat), crystal(name), k)
    assert np.abs(mine - theirs).max() < 1e-6  # THz; its displacements of 1e-4 Å leave 5e-8
    # With our force constants it is the same matrix: rounding of the square root.
    again = frequencies(phonopy_from(constants(name), repeat), crystal(name), k)
    assert np.abs(mine - again).max() < 1e-9


def test_two_masses_and_imaginary_frequencies():
    """Caesium-chloride structure under Lennard-Jones: two masses, two cutoffs, and unstable; phonopy agrees, imaginary
    ones included."""
    pot = atc.potential(
        "pair_style lj/cut 6\npair_coeff 1 1 0.010 3.2 6\npair_coeff 2 2 0.012 3.0 5\npair_coeff 1 2 0.02 3.3 5.5",
        units="metal",
    )
    c = Crystal(np.eye(3) * 4.1, [[0, 0, 0], [2.05, 2.05, 2.05]], [20.0, 130.0], "metal", [1, 2], name="CsCl")
    fc = force_constants(c, pot)
    k = np.random.default_rng(3).uniform(-1, 1, (20, 3)) * np.pi / 4.1
    mine = fc.frequencies(k) * THZ
    assert mine.min() < -0.1  # imaginary, reported as negative
    theirs = frequencies(phonopy_of(c, pot, (3, 3, 3)), c, k)
    assert np.abs(mine - theirs).max() < 1e-6
    np.testing.assert_allclose(
        force_constants(c, pot, method="displacements").frequencies(k), fc.frequencies(k), atol=1e-8
    )


def test_any_ase_calculator():
    """ASE's own Lennard-Jones: the same lattice constant, elastic constants and frequencies."""
    from ase import Atoms
    from ase.calculators.lj import LennardJones

    calc = LennardJones(epsilon=EPSILON, sigma=SIGMA, rc=CUTOFF, smooth=False)
    a = 5.3
    atoms = Atoms("Ar", cell=[[0, a / 2, a / 2], [a / 2, 0, a / 2], [a / 2, a / 2, 0]], pbc=True)
    atoms.set_masses([MASS])
    c = relax(Crystal.from_ase(atoms, conventional=np.eye(3) * a), calc)
    assert c.lattice_constant == pytest.approx(crystal("argon").lattice_constant, rel=1e-9)
    np.testing.assert_allclose(
        elastic_constants(c, calc).C_vv, elastic("argon").C_vv, atol=1e-8 * elastic("argon").C_vv.max()
    )
    k = np.random.default_rng(4).uniform(-1, 1, (10, 3))
    with pytest.raises(AtcError, match="reach"):
        force_constants(c, calc)
    fc = force_constants(c, calc, reach=CUTOFF)
    np.testing.assert_allclose(fc.frequencies(k), constants("argon").frequencies(k), atol=1e-8)
    with pytest.raises(AtcError, match="reach further"):
        force_constants(c, calc, reach=5.0)


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_group_velocities(name):
    fc = constants(name)
    rng = np.random.default_rng(6)
    k = rng.uniform(-1, 1, (6, 3)) * 0.8
    e = rng.normal(size=(6, 3))
    e /= np.linalg.norm(e, axis=1)[:, None]
    h = 1e-4
    slope = (fc.frequencies(k + h * e) - fc.frequencies(k - h * e)) / (2 * h)
    # The difference's own error, h² ω''' ~ 1e-8.
    np.testing.assert_allclose(fc.group_velocities(k, e), slope, atol=1e-6)


def test_degenerate_branches_have_their_own_velocities():
    """At X of diamond two branches meet and cross with opposite slopes."""
    fc = constants("silicon")
    x = np.array([[2 * np.pi / crystal("silicon").lattice_constant, 0, 0]])
    v = fc.group_velocities(x, np.array([1.0, 0, 0]))[0]
    assert v[2] == pytest.approx(-v[3], rel=1e-6) and abs(v[3]) > 0.01


def test_long_waves():
    """ω/k is constant down to wave lengths of 1e5 cells, where ω² is 1e-10 of the largest."""
    k = np.array([1e-3, 1e-4, 1e-5])[:, None] * np.array([1.0, 0, 0])
    speed = constants("argon").frequencies(k)[:, 2] / k[:, 0]
    np.testing.assert_allclose(speed, speed[0], rtol=3e-5)  # rounding: 1e-16/1e-10 in ω², half of it in ω, a few terms
    np.testing.assert_allclose(constants("argon").frequencies(np.zeros(3)), 0.0, atol=1e-7)


def test_zone_boundaries():
    g = 2 * np.pi / crystal("argon").lattice_constant
    for direction, length in (
        ((1, 0, 0), 1.0),
        ((1, 1, 0), 0.75 * 2**0.5),
        ((1, 1, 1), 0.5 * 3**0.5),
    ):  # X, K, L of fcc
        assert crystal("argon").zone_boundary(direction) == pytest.approx(length * g, rel=1e-12)


# ---- what is refused


def test_refused():
    with pytest.raises(AtcError, match="expected one of"):
        Crystal.cubic("hcp", 3.0, 1.0, "lj")
    with pytest.raises(AtcError, match="length greater than 0"):
        Crystal.cubic("fcc", -1, 1.0, "lj")
    with pytest.raises(AtcError, match="1 mass or 2"):
        Crystal.cubic("diamond", 5.4, [1.0, 2.0, 3.0], "metal")
    with pytest.raises(AtcError, match="pair styles only"):
        force_constants(crystal("silicon"), model("silicon"), method="analytic")
    with pytest.raises(AtcError, match="nearer to equilibrium"):
        relax(start("argon", 12.0), model("argon"))
    with pytest.raises(AtcError, match="GPa"):
        elastic_constants(
            Crystal.cubic("fcc", 1.6, 1.0, "lj"), atc.potential("pair_style lj/cut 2.5\npair_coeff 1 1 1 1", units="lj")
        ).gpa()
