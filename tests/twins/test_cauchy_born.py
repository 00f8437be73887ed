"""The crystal as a material: its energy against the potential's own, its constants, frame indifference, and bodies of it
whose answer is known."""

import numpy as np
import pytest
from crystals import crystal, elastic, model
from scipy.spatial.transform import Rotation

from atc import pd
from atc.errors import AtcError
from atc.twins.material import sampled_constants
from atc.upscaling.cauchy_born import CauchyBorn, CrystalLaw, StrainEnergy, cubic_of, size_of, strain_v
from atc.upscaling.crystal import evaluate
from atc.upscaling.deformed_crystals import DeformedCrystals
from atc.upscaling.free_energy import _mean_log, vibrational

RNG = np.random.default_rng(5)
ROTATION = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()


@pytest.fixture(scope="module")
def silicon():
    return CauchyBorn(crystal("silicon"), model("silicon"))


@pytest.fixture(scope="module")
def quick(silicon):
    return StrainEnergy.fitted(silicon, reaches=(0.045,))


@pytest.mark.parametrize("name", ["silicon", "argon"])
def test_copies_are_single_crystals(name):
    """Energy, forces and virial of many copies at once against cells evaluated one by one."""
    c, pot = crystal(name), model(name)
    F = np.eye(3) + 0.06 * RNG.normal(size=(5, 3, 3))
    u = 0.05 * RNG.normal(size=(5, len(c), 3))
    W, f, V = DeformedCrystals(c, pot)(F, u)
    for k in range(5):
        energy, forces, virial = evaluate(pot, c.strained(F[k] - np.eye(3), u[k]).frame())
        assert W[k] == pytest.approx(energy, rel=1e-12)
        assert f[k] == pytest.approx(forces, abs=1e-12)
        assert V[k] == pytest.approx(virial, abs=1e-12)


def test_stress_is_the_slope_of_the_relaxed_energy(silicon):
    """And its slope at rest are the elastic constants that `elastic_constants` finds on its own."""
    E, h = 0.02 * RNG.normal(size=(4, 6)), 1e-5
    W, S = silicon(E)
    for v in range(6):
        d = h * np.eye(6)[v]
        assert (silicon(E + d)[0] - silicon(E - d)[0]) / (2 * h) == pytest.approx(S[:, v], abs=1e-8)
    assert silicon.moduli_vv == pytest.approx(elastic("silicon").C_vv, abs=1e-9)
    assert cubic_of(silicon.moduli_vv) == pytest.approx(elastic("silicon").cubic, rel=1e-12)


def test_the_polynomial_is_as_near_as_it_says(silicon, quick):
    """At strains of another kind than those it was fitted to: uniaxial, shear, biaxial, along oblique axes."""
    t = 0.9 * quick.reach
    H = np.array(
        [np.diag([t, 0, 0]), np.diag([-t, 0, 0]), np.diag([t, t, 0]) / 2**0.5, [[0, t, 0], [0, 0, 0], [0] * 3]]
    )
    E = np.concatenate([strain_v(H), strain_v(0.9 * ROTATION @ H @ ROTATION.T)])
    E = E[size_of(E) <= quick.reach]
    W, S = silicon(E)
    w, s = quick(E)
    linear = np.linalg.norm(E @ silicon.moduli_vv, axis=1)
    assert (np.linalg.norm(s - S, axis=1) < 1e-4 * linear).all() and quick.error < 1e-4
    assert w == pytest.approx(W, rel=1e-4)
    assert np.abs(S - E @ silicon.moduli_vv).max() > 0.05 * np.abs(S).max()  # far from linear
    assert quick(1e-7 * np.eye(6))[1] / 1e-7 == pytest.approx(silicon.moduli_vv, abs=1e-6)


def test_forces_that_jump_at_the_cutoff_have_no_polynomial():
    assert StrainEnergy.fitted(CauchyBorn(crystal("argon"), model("argon")), reaches=(0.03,)) is None


def test_rotation_changes_nothing_but_the_direction(silicon, quick):
    law = CrystalLaw(silicon, quick)
    H = np.concatenate([0.01 * RNG.normal(size=(5, 3, 3)), 0.03 * RNG.normal(size=(3, 3, 3))])
    W, P = law(H)
    assert law.beyond > 0
    W_turned, P_turned = law(ROTATION @ (np.eye(3) + H) - np.eye(3))
    assert W_turned == pytest.approx(W, rel=1e-10)
    assert P_turned == pytest.approx(ROTATION @ P, abs=1e-10 * np.abs(P).max())


def test_a_turned_crystal_is_the_turned_crystal(silicon, quick):
    """The law along other axes against the potential on a cell that was turned itself."""
    turned = CauchyBorn(crystal("silicon").strained(ROTATION - np.eye(3)), model("silicon"))
    law, plain = CrystalLaw(silicon, quick, axes=ROTATION.T), CrystalLaw(turned)
    H = 0.01 * RNG.normal(size=(4, 3, 3))
    scale = np.abs(plain(H)[1]).max()
    assert law(H)[1] == pytest.approx(plain(H)[1], abs=1e-4 * scale)
    assert law.moduli_vv == pytest.approx(turned.moduli_vv, abs=1e-9)


@pytest.mark.parametrize("axes", [np.eye(3), ROTATION])
def test_nodes_have_the_constants_of_the_crystal(silicon, quick, axes):
    law = CrystalLaw(silicon, quick, axes)
    step = np.array([[5.4, 0, 0], [1.0, 5.0, 0], [0, 0.5, 5.6]])
    found = sampled_constants(pd.Hyperelastic(law), step, 9.5, 0.05)
    assert found == pytest.approx(law.moduli_vv, abs=1e-6)


def body(n=4):
    a = 5.43
    s = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    from atc.frame import Cell

    return pd.Body(s * a, a**3, 0.05, 1.8 * a, cell=Cell(np.eye(3) * n * a), spacing=a)


def test_a_strained_body_has_the_crystals_energy_and_stress(silicon, quick):
    H = np.array([[0.03, 0.01, 0.0], [0.0, -0.01, 0.02], [0.0, 0.0, 0.015]])
    law = CrystalLaw(silicon, quick)
    sim = pd.Simulation(body(), pd.Hyperelastic(law), strain=H)
    W, P = law(H[None])
    V = sim.body.V_n.sum()
    assert sim.energies().strain == pytest.approx(W[0] * V, rel=1e-12)
    f = sim.bond_forces()
    virial = -np.einsum("bi,bj->ij", f.r_bc, f.F_bc)
    assert virial == pytest.approx(P[0] @ (np.eye(3) + H).T * V, rel=1e-10, abs=1e-10)


def test_waves_of_finite_size_keep_energy_and_momentum(silicon, quick):
    b = body()
    u = 0.2 * np.sin(2 * np.pi * b.X_nc[:, [1, 2, 0]] / b.cell.vectors[0, 0])
    sim = pd.Simulation(b, pd.Hyperelastic(CrystalLaw(silicon, quick)), displacements=u, safety=0.1)
    before = sim.energies().strain
    sim.step(60)
    e = sim.energies()
    assert e.kinetic > 0.05 * before
    assert e.strain + e.kinetic == pytest.approx(before, rel=2e-3)
    momentum = (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)
    assert np.abs(momentum).max() < 1e-12 * (sim.mass_n * np.abs(sim.state.v_nc).max()).sum()


def test_a_crystal_torn_apart_is_said_to_be(silicon):
    H = 0.3 * np.random.default_rng(0).normal(size=(40, 3, 3))
    H = H[np.linalg.svd(np.eye(3) + H, compute_uv=False)[:, -1] > 0.3]
    with pytest.raises(AtcError, match="does not exist at the strain of"):
        CrystalLaw(silicon)(H)


def test_softening_before_the_crystal_fails(silicon):
    law = CrystalLaw(silicon)
    least = law.ellipticity(np.array([np.zeros((3, 3)), 0.08 * np.eye(3), 0.25 * np.eye(3)]), directions=20)
    assert least[0] == pytest.approx(1.0, rel=1e-6)
    assert least[2] < least[1] < 1.0


def test_vibrations_expand_the_crystal(silicon, quick):
    """The thermal stress against differences of the free energy itself, and its published size: 3 to 5e-6 per kelvin."""
    warm = vibrational(silicon, model("silicon"), 300.0)
    kT, h = 8.617333e-5 * 300.0, 1e-3
    d = np.array([h, h, h, 0, 0, 0])
    slope = (_mean_log(silicon, model("silicon"), d) - _mean_log(silicon, model("silicon"), -d)) / (2 * h)
    assert warm(np.zeros((1, 6)))[1][0, :3].sum() == pytest.approx(slope * kT / crystal("silicon").volume, rel=2e-3)
    assert 3e-6 < (CrystalLaw(silicon, quick, warm=warm).free_stretch() - 1) / 300 < 5e-6
    assert warm.error < 0.01
