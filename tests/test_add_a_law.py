"""A pair style and a peridynamic material of one's own, each a law in one file, come in through the public door and are
as good as those of the package."""

import numpy as np
import pytest

import atc
from atc import pd
from atc.decomposers.pairs.loop import pair_law
from atc.decomposers.pairs.radial import RadialStyle, mix_lj_distances, one_cutoff
from atc.decomposers.registry import PAIR_STYLES
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

# ---- a pair style: what CONTRIBUTING.md shows


class Cushion(RadialStyle):
    """U = ε (σ/d)⁸ − offset for d < cutoff. Numbers: epsilon, sigma, cutoff; see `RadialStyle`."""

    name = "cushion"
    numbers = (("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length"))

    def columns(self, epsilon, sigma, cutoff):
        return (epsilon * sigma**8,)

    @pair_law
    def law(d2, a):
        u = a / (d2 * d2 * d2 * d2)
        return u, -8.0 * u / d2


# ---- a bond-based material: what CONTRIBUTING.md shows


class Softening(pd.PMB):
    """Bonds that soften: f = c ω s (1 − s), until they break."""

    name = "softening"

    @pd.bond_law
    def law(s):
        return 1.0 - s, 1.0 - 2.0 / 3.0 * s


@pytest.fixture
def registered():
    one_cutoff(Cushion, mix=mix_lj_distances)
    yield
    # Other tests compare the list of styles with LAMMPS's.
    del PAIR_STYLES["cushion"]


def frame():
    rng = np.random.default_rng(3)
    x = np.stack(np.meshgrid(*[np.arange(4) * 2.0] * 3, indexing="ij"), -1).reshape(-1, 3) + rng.uniform(
        -0.3, 0.3, (64, 3)
    )
    return Frame(x, Cell([8.0] * 3), units("metal"), types=np.arange(64) % 2 + 1)


def test_a_pair_style_is_its_law(registered):
    """Beside a slow sum: numbers by type, mixing, cutoffs, the shift, per-atom energies, forces, virial; and as an
    object."""
    lines = (
        "pair_style cushion 3.5\npair_coeff 1 1 0.02 1.9\npair_coeff 2 2 0.03 2.1 3.0\npair_modify shift yes mix "
        "arithmetic"
    )
    f = frame()
    d = atc.potential(lines, units="metal").decompose(f)
    eps = {(1, 1): 0.02, (2, 2): 0.03, (1, 2): np.sqrt(0.02 * 0.03)}
    sigma, cut = {(1, 1): 1.9, (2, 2): 2.1, (1, 2): 2.0}, {(1, 1): 3.5, (2, 2): 3.0, (1, 2): 3.25}
    u = lambda p, r: eps[p] * (sigma[p] / r) ** 8  # noqa: E731
    energies, forces, virial = np.zeros(64), np.zeros((64, 3)), np.zeros((3, 3))
    for i in range(64):
        for j in range(64):
            p = tuple(sorted((int(f.types[i]), int(f.types[j]))))
            r = f.positions[i] - f.positions[j]
            r -= 8.0 * np.round(r / 8.0)
            r0 = np.linalg.norm(r)
            if i != j and r0 < cut[p]:
                energies[i] += 0.5 * (u(p, r0) - u(p, cut[p]))
                forces[i] += 8 * u(p, r0) * r / r0**2
                virial += 0.5 * -8 * u(p, r0) * np.outer(r, r) / r0**2
    internal = f.units.energy
    np.testing.assert_allclose(d.energies_n, energies * internal, rtol=1e-12)
    np.testing.assert_allclose(d.forces_nc, forces * internal, rtol=0, atol=1e-12 * np.abs(forces).max() * internal)
    np.testing.assert_allclose(d.virial_cc, virial * internal, rtol=0, atol=1e-12 * np.abs(virial).max() * internal)
    one = Cushion(0.02, 1.9, 3.5, units="metal", shift=True, n_types=2)
    same = atc.potential("pair_style cushion 3.5\npair_coeff * * 0.02 1.9\npair_modify shift yes", units="metal")
    assert atc.potential(one).decompose(f).energy == same.decompose(f).energy
    with pytest.raises(AtcError, match=r"line 2: pair_coeff of cushion takes epsilon sigma \[cutoff\]"):
        atc.potential("pair_style cushion 3.5\npair_coeff * * 0.02", units="metal")


def test_a_bond_based_material_is_its_law():
    """Its forces are minus the gradient of its energy, what its bonds say is what its nodes feel, and small stretches
    are PMB's."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (5.1, 4.1, 4.1)), 1.0, 2.01, 2.0)
    u = np.random.default_rng(1).uniform(-0.05, 0.05, body.X_nc.shape)
    run = lambda material, u, **more: pd.Simulation(body, material, displacements=u, threads=1, **more)  # noqa: E731
    sim = run(Softening(1.3), u)
    t, step = body.bonds, 1e-6
    eta = u[t.j_b] - u[t.i_b]
    xi = t.xi_bc(body.X_nc)
    r = np.linalg.norm(xi + eta, axis=1)
    s = (r - t.r0_b) / t.r0_b
    pull = (sim.model.W_b * s * (1 - s) / r)[:, None] * (xi + eta)
    F = np.zeros_like(u)
    np.add.at(F, t.i_b, pull)
    np.add.at(F, t.j_b, -pull)
    # 1e-12 of the largest: rounding of a few hundred terms
    np.testing.assert_allclose(sim.forces(), F, rtol=0, atol=1e-12 * np.abs(F).max())
    f = sim.bond_forces()
    of_bonds = np.zeros_like(u)
    np.add.at(of_bonds, f.i, f.F_bc)
    np.add.at(of_bonds, f.j, -f.F_bc)
    np.testing.assert_allclose(of_bonds, F, rtol=0, atol=1e-12 * np.abs(F).max())
    for n, c in ((0, 0), (37, 1), (80, 2)):
        up, down = u.copy(), u.copy()
        up[n, c] += step
        down[n, c] -= step
        slope = (run(Softening(1.3), up).energies().strain - run(Softening(1.3), down).energies().strain) / (2 * step)
        assert -slope == pytest.approx(F[n, c], abs=1e-7 * np.abs(F).max())
    small = [run(m, 1e-7 * u).forces() for m in (Softening(1.3), pd.PMB(1.3))]
    np.testing.assert_allclose(small[0], small[1], rtol=0, atol=1e-6 * np.abs(small[1]).max())
    broken = run(Softening(1.3), u, damage=pd.CriticalStretch(0.04))
    broken.step(5)
    e = broken.energies()
    assert broken.n_broken > 0 and e.dissipated_fracture > 0
    with pytest.raises(AtcError, match="softening: the energy of its bonds does not grow"):
        pd.CriticalStretch.from_energy(1.0, Softening(1.3), body)
    two = pd.Body(body.X_nc, body.V_n, 2.0, body.horizon, spacing=1.0, materials=np.arange(len(body)) % 2 + 1)
    with pytest.raises(AtcError, match="must share the law of their bonds"):
        pd.Simulation(two, {1: pd.PMB(1.3), 2: Softening(1.3)})
