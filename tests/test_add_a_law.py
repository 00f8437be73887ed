"""A pair style, a bonded style, a many-body style and a peridynamic material of one's own, each a law in one file, come
in through the public door and are as good as those of the package."""

import numpy as np
import pytest

import atc
from atc import pd
from atc.analysis.check import check
from atc.cases.build import simulation
from atc.cases.case import Case
from atc.decomposers.bonded.bond import BondStyle
from atc.decomposers.many_body.neighbor_work import NeighborTerm, NeighborWork
from atc.decomposers.pairs.loop import pair_law
from atc.decomposers.pairs.radial import RadialStyle, mix_lj_distances, one_cutoff
from atc.decomposers.registry import PAIR_STYLES, STYLES, pair_style
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame, Topology
from atc.pd import materials
from atc.units import units
from atc.units import units as system

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


# ---- a many-body style: what CONTRIBUTING.md shows


class RootWork(NeighborWork):
    own = ("bonds",)

    def joined(self, acc):
        near, term = self.near, self.term
        rho_p = (term.cutoff - near.d_p) ** 2
        rho = np.bincount(near.a, rho_p, len(near.atom)) + np.bincount(near.b, rho_p, len(near.atom))
        energy = -term.A * np.sqrt(rho)
        self.slope = np.divide(0.5 * energy, rho, out=np.zeros_like(rho), where=rho > 0)
        acc.energy += energy.sum()
        if acc.energies is not None:
            acc.energies[near.atom] += energy

    def bonds(self, task, acc):
        return self.of_pairs(task, acc, root_bonds, self.slope, self.term.cutoff)


def root_bonds(p0, p1, lists, slope, cutoff, out, energies):
    _, _, _, a, b, r, d, _, atom = lists
    a, b, r, d = a[p0:p1], b[p0:p1], r[p0:p1], d[p0:p1]
    i, j, x, G, D = (o[: len(a)] for o in out)
    per_d = -2.0 * (cutoff - d) / d
    i[:], j[:], x[:], G[:] = atom[a], atom[b], r, (slope[a] + slope[b]) * per_d
    if len(D):
        D[:, 0], D[:, 1] = -(slope[a] * per_d)[:, None] * r, (slope[b] * per_d)[:, None] * r
    return len(a), 0.0, -1


class SquareRoot(NeighborTerm):
    """U = −A Σ_i √ρ_i, ρ_i = Σ_j (r_c − d_ij)²: Finnis and Sinclair's embedding."""

    style, work = "root", RootWork

    def __init__(self, A, cutoff, *, units="metal"):
        u = self.units = system(units)
        self.A, self.cutoff = A * u.factor("energy") / u.factor("length"), cutoff * u.factor("length")

    def describe(self):
        return "root, each atom's energy its own"

    def kinds(self, frame):
        return np.zeros(len(frame), np.int32), None


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

    @pair_style("root")
    def _root(inp):
        (line,) = inp.coeffs
        A, cutoff = inp.numbers(line.words, [("A", 1.0), ("cutoff", 1.0)], line)
        return SquareRoot(A, cutoff, units=inp.units)

    # ---- a bonded style: what CONTRIBUTING.md shows

    class Sixth(BondStyle):
        """U = K (d − r0)⁶. Coefficients K [energy/length⁶], r0 [length]."""

        name = "sixth"
        wants = (("K", {"energy": 1, "length": -6}), ("r0", "length"))

        def curve(self, d, K, r0):
            x = d - r0
            return K * x**6, 6.0 * K * x**5

    yield
    # Other tests compare the list of styles with LAMMPS's.
    del PAIR_STYLES["cushion"], PAIR_STYLES["root"], STYLES["bond"]["sixth"]


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


def test_a_bonded_style_is_its_curve(registered):
    """Energy and forces beside plain sums; a wrong line is one line."""
    f, pairs = frame(), np.array([[0, 1], [5, 9], [3, 0]])
    f = f.replace(topology=Topology(bonds=pairs, bond_types=np.array([1, 1, 2])))
    d = atc.potential("bond_style sixth\nbond_coeff 1 0.4 1.7\nbond_coeff 2 0.3 1.8", units="metal").decompose(f)
    energy, forces = 0.0, np.zeros((64, 3))
    for (i, j), K, r0 in zip(pairs, (0.4, 0.4, 0.3), (1.7, 1.7, 1.8), strict=True):
        r = f.positions[i] - f.positions[j]
        r -= 8.0 * np.round(r / 8.0)
        length = np.linalg.norm(r)
        energy += K * (length - r0) ** 6
        F = -6 * K * (length - r0) ** 5 * r / length
        forces[i] += F
        forces[j] -= F
    np.testing.assert_allclose(d.energy, energy * f.units.energy, rtol=1e-12)
    np.testing.assert_allclose(d.forces_nc, forces * f.units.energy, rtol=0, atol=1e-12 * abs(d.forces_nc).max())
    with pytest.raises(AtcError, match="line 2: bond_coeff of sixth takes K r0"):
        atc.potential("bond_style sixth\nbond_coeff 1 0.4", units="metal")


def test_a_many_body_style_is_its_stages(registered):
    """Energies of its atoms beside plain sums, forces beside differences of the energy, on one thread and on two; its
    energy sources by the balance of energy."""
    f = frame()
    pot = atc.potential("pair_style root\npair_coeff * * 0.7 3.5", units="metal")
    d = pot.decompose(f)
    r = f.positions[:, None] - f.positions
    lengths = np.linalg.norm(r - 8.0 * np.round(r / 8.0), axis=2) + 8.0 * np.eye(64)
    own = -0.7 * np.sqrt(np.where(lengths < 3.5, (3.5 - lengths) ** 2, 0.0).sum(1)) * f.units.energy
    np.testing.assert_allclose(d.energies_n, own, rtol=1e-12)
    assert d.energy == pytest.approx(own.sum(), rel=1e-12)
    largest, step = abs(d.forces_nc).max(), 1e-5
    np.testing.assert_allclose(pot.decompose(f, threads=2).forces_nc, d.forces_nc, rtol=0, atol=1e-13 * largest)
    for n, c in ((0, 0), (21, 1), (63, 2)):
        moved = [f.positions.copy(), f.positions.copy()]
        moved[0][n, c] += step
        moved[1][n, c] -= step
        up, down = (pot.decompose(f.replace(positions=x)).energy for x in moved)
        # central differences: step² times the third derivative, and the energy's rounding over the step
        assert -(up - down) / (2 * step) == pytest.approx(d.forces_nc[n, c], abs=1e-7 * largest)
    moving = f.replace(masses=np.ones(64), velocities=np.random.default_rng(4).normal(size=(64, 3)))
    assert check(moving, pot, atc.kernel("quartic", 3.0), points=3, threads=1).ok


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


def test_a_case_takes_a_bond_based_material_as_it_takes_pmb(monkeypatch):
    """What holds for bonds that know nothing of one another goes by the class, not by the name: at three spacings a
    warning, and one modulus is all."""
    monkeypatch.setattr(materials, "Softening", Softening, raising=False)
    plate = {"shape": "box", "lo": [0, 0, 0], "hi": [8.1, 8.1, 1]}
    case = {
        "body": {"region": plate, "spacing": 1.0, "horizon": 3.015, "density": 1.0, "dimension": 2},
        "material": [{"model": "softening", "bulk": 1.0}],
        "run": {"steps": 2},
    }
    with pytest.warns(AtcWarning, match="sample softening so coarsely"):
        sim = simulation(Case.load(case), threads=1)
    assert {type(m) for m in sim.materials.values()} == {Softening}
    case["material"][0]["poisson"] = 0.2
    with pytest.raises(AtcError, match="bonds of softening fix Poisson's ratio"):
        Case.load(case)
