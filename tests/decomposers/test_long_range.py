"""Long-range Coulomb: the smooth part of Ewald's sum against sums over pairs of modes, closed forms and LAMMPS."""

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps

import atc
from atc.decomposers.long_range import ewald, stress, transform
from atc.decomposers.long_range.kspace import converged
from atc.decomposers.long_range.split import Split
from atc.decomposers.long_range.transform import Direct, Transform
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

SIX = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
TRICLINIC = np.array([[9.0, 0, 0], [1.3, 10.0, 0], [-0.7, 2.0, 11.0]])


def eight_ions(vectors=TRICLINIC, seed=2, velocities=None, periodic=(True, True, True), drift=0.0):
    rng = np.random.default_rng(seed)
    q = np.tile([1.0, -1.0], 4) * rng.uniform(0.5, 1.0, 8)
    x = rng.uniform(0.05, 0.95, (8, 3)) @ vectors + [1.0, 2.0, 3.0]
    v = rng.normal(size=(8, 3)) + drift
    return Frame(
        x,
        Cell(vectors, [1.0, 2.0, 3.0], periodic),
        units("metal"),
        charges=q - q.mean(),
        masses=np.ones(8),
        velocities=v,
    )


def kernel_of_modes(a, b, c, s):
    """K_µν for wave vectors (m, 3), as it is written in the package's docstring."""
    x, y, Q2 = (a * a).sum(1), (b * b).sum(1), ((a + b) ** 2).sum(1)
    V = lambda k2: np.where(k2 > 1e-20, c * np.exp(-s * k2) / np.where(k2 > 1e-20, k2, 1.0), 0.0)  # noqa: E731
    same = np.abs(x - y) <= 1e-9 * (x + y)
    slope = np.where(x > 1e-20, -V(x) * (s + 1.0 / np.where(x > 1e-20, x, 1.0)), 0.0)
    D = np.where(same, slope, (V(y) - V(x)) / np.where(same, 1.0, y - x))
    one, ab = np.eye(3), a[:, :, None] * b[:, None, :]
    return (0.5 * (V(x) + V(y)) + 0.5 * D * Q2)[:, None, None] * one - D[:, None, None] * (ab + ab.swapaxes(1, 2))


class Naive:
    """Stress and energy current at one Q as sums over all pairs of modes."""

    def __init__(self, term, frame, largest):
        n = [np.arange(-m, m + 1) for m in largest]
        self.b = 2 * np.pi * np.linalg.inv(frame.cell.vectors)
        self.k = np.stack(np.meshgrid(*n, indexing="ij"), -1).reshape(-1, 3) @ self.b.T
        self.term, self.frame = term, frame
        self.rho, self.J = self.modes(self.k)

    def modes(self, k):
        f = self.frame
        phase = np.exp(-1j * ((f.positions - f.cell.origin) @ k.T))
        return f.charges @ phase, (f.charges[:, None] * f.velocities).T @ phase

    def at(self, Q):
        split = self.term.split
        other = np.array(Q) @ self.b.T - self.k
        K = kernel_of_modes(self.k, other, 4 * np.pi * split.constant, split.s)
        rho = self.modes(other)[0]
        V = self.frame.cell.volume
        sigma = -np.einsum("m,m,mij->ij", self.rho, rho, K) / (2 * V)
        return sigma[SIX], np.einsum("m,jm,mij->i", rho, self.J, K) / (2 * V)


def test_modes_by_the_spreading_window():
    """Each window does what its width says, both ways; `Direct` is the definition."""
    rng = np.random.default_rng(1)
    x, a = rng.uniform(-5, 15, (60, 3)), rng.normal(size=(60, 5))
    direct = Direct(TRICLINIC, (1, 2, 3), (5, 6, 4))
    F = direct.modes(x, a)
    k = np.array([3, 6, 2]) @ (2 * np.pi * np.linalg.inv(TRICLINIC)).T
    np.testing.assert_allclose(F[:, 3, 6, 2], a.T @ np.exp(-1j * (x - [1, 2, 3]) @ k), rtol=0, atol=1e-12)
    back = direct.at(list(F), x)
    for accuracy in (1e-6, 1e-12):
        fast = Transform(TRICLINIC, (1, 2, 3), (5, 6, 4), accuracy)
        assert np.abs(fast.modes(x, a) - F).max() < 10 * accuracy * np.abs(F).max()
        assert np.abs(fast.at(list(F), x) - back).max() < 10 * accuracy * np.abs(back).max()


def test_large_meshes_are_taken_by_planes(monkeypatch):
    """Of the mesh there are never more planes at a time than its parts have; sums stay what they are."""
    rng = np.random.default_rng(1)
    x, a = rng.uniform(-5, 15, (60, 3)), rng.normal(size=(60, 2))
    x[0] = [1.0 - 1e-18, 2.0, 3.0]
    direct = Direct(TRICLINIC, (1, 2, 3), (20, 3, 4))
    F, frame = direct.modes(x, a), eight_ions()
    term = ewald.LongRangeCoulomb(Split(0.35, 5.0, 14.4, 1e-13))
    whole = stress.Products(term, frame, (3, 3, 4), 1e-6, 4)
    for part in (1.0, 2.0**12):
        monkeypatch.setattr(transform, "PART", part)
        monkeypatch.setattr(stress, "PART", part)
        fast = Transform(TRICLINIC, (1, 2, 3), (20, 3, 4), 1e-9)
        assert len(fast._parts((x - [1, 2, 3]) @ fast.to_mesh)) > 1
        assert np.abs(fast.modes(x, a) - F).max() < 1e-8 * np.abs(F).max()
        back = direct.at(list(F), x)
        assert np.abs(fast.at(list(F), x) - back).max() < 1e-8 * np.abs(back).max()
        some = stress.Products(term, frame, (3, 3, 4), 1e-6, 4)
        for got, want in (
            (some.stress(), whole.stress()),
            (some.current(frame.velocities), whole.current(frame.velocities)),
        ):
            assert np.abs(got - want).max() < 1e-12 * np.abs(want).max()


@pytest.mark.parametrize("vectors", [np.diag([9.0, 10.0, 11.0]), TRICLINIC], ids=["orthogonal", "triclinic"])
def test_products_of_fields_are_the_sum_over_modes(vectors):
    frame = eight_ions(vectors)
    term = ewald.LongRangeCoulomb(Split(0.35, 5.0, 14.4, 1e-13))
    errors = []
    points = [(0, 0, 0), (1, 0, 0), (0, 2, 1), (3, -1, 2), (-3, 3, 4)]
    for nodes in (4, 8, 16):
        products = stress.Products(term, frame, (3, 3, 4), 1e-13, nodes)
        naive = Naive(term, frame, [len(i) // 2 for i in products.index[:2]] + [products.index[2][-1]])
        sigma, A = products.stress(), products.current(frame.velocities)
        want = [naive.at(Q) for Q in points]
        scale = [max(np.abs(w[k]).max() for w in want) for k in range(2)]
        errors.append(
            [
                max(np.abs(got[:, *Q] - w[k]).max() for Q, w in zip(points, want)) / scale[k]
                for k, got in enumerate((sigma, A))
            ]
        )
    errors = np.array(errors)
    # Gauss and Legendre's rule: a few digits with each node.
    assert (errors[1] < 0.02 * errors[0]).all() and (errors[2] < 1e-12).all(), errors
    # Q = 0: Ewald's virial, and −Σ S_j v_j with the per-atom virials.
    smooth = ewald.Smooth(term, frame)
    np.testing.assert_allclose(
        sigma[:, 0, 0, 0], smooth.virial_cc[SIX], rtol=0, atol=1e-12 * np.abs(smooth.virial_cc).max()
    )
    w = smooth.virials_n6()
    np.testing.assert_allclose(w.sum(0), smooth.virial_cc[SIX], rtol=0, atol=1e-11)
    full = w[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    np.testing.assert_allclose(A[:, 0, 0, 0].real, -np.einsum("nij,nj->i", full, frame.velocities), rtol=0, atol=1e-11)


def test_divergence_is_the_force_density_at_every_mode():
    """iQ·σ(Q) = Σ F_j e^{−iQ·x_j}: the mesh of products confuses no modes."""
    frame = eight_ions()
    term = ewald.LongRangeCoulomb(Split(0.8, 5.0, 14.4, 1e-12))
    products = stress.Products(term, frame, (6, 6, 6), 1e-11, 12)
    sigma = products.stress()
    full = sigma[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    from atc.decomposers.long_range.transform import wave_vectors

    Q = np.stack([np.broadcast_to(k, sigma.shape[1:]) for k in wave_vectors(products.q_index, products.vectors)])
    force = Direct(frame.cell.vectors, frame.cell.origin, (6, 6, 6)).modes(
        frame.positions, ewald.Smooth(term, frame).forces_nc()
    )
    difference = np.einsum("iabc,ijabc->jabc", 1j * Q, full) - force
    assert np.abs(difference).max() < 1e-9 * np.abs(force).max()
    # Smoothed, the error falls with the nodes of the integral like that of a spectral method; Maxwell's tensor of the
    # smeared charges alone, without the integral, is wrong altogether.
    errors, hat = [], np.exp(-0.5 * 0.9**2 * (Q**2).sum(0))
    for nodes in (1, 2, 4, 6, 8):
        products = stress.Products(term, frame, (6, 6, 6), 1e-11, nodes)
        if nodes == 1:
            products.rule = []
        full = products.stress()[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
        off = hat * (np.einsum("iabc,ijabc->jabc", 1j * Q, full) - force)
        errors.append(np.abs(off).max() / np.abs(hat * force).max())
    assert errors[0] > 0.5 and (np.array(errors[1:]) < [2e-2, 1e-5, 1e-8, 1e-11]).all(), errors


def test_forces_virial_and_shares_are_derivatives():
    """Forces and the virial are derivatives of the energy, which the atoms' shares add up to."""
    frame = eight_ions()
    term = ewald.LongRangeCoulomb(Split(0.6, 5.0, 14.4, 1e-12))
    smooth = ewald.Smooth(term, frame)
    energy = lambda f: ewald.Smooth(term, f).energy  # noqa: E731
    h = 1e-4
    for k, c in ((0, 0), (5, 2)):
        d = np.zeros((8, 3))
        d[k, c] = h
        slope = (
            energy(frame.replace(positions=frame.positions + d)) - energy(frame.replace(positions=frame.positions - d))
        ) / (2 * h)
        assert smooth.forces_nc()[k, c] == pytest.approx(-slope, rel=1e-6)
    for a, b in ((0, 0), (1, 1), (2, 1)):
        strain = np.zeros((3, 3))
        strain[b, a] = h

        def strained(sign, strain=strain):
            e = np.eye(3) + sign * strain
            return energy(
                frame.replace(positions=frame.positions @ e, cell=Cell(frame.cell.vectors @ e, frame.cell.origin @ e))
            )

        assert smooth.virial_cc[a, b] == pytest.approx((strained(1) - strained(-1)) / (2 * h), rel=1e-6)
    assert smooth.energies_n().sum() == pytest.approx(smooth.energy, rel=1e-11)
    direct = ewald.Smooth(term, frame, direct=True)
    np.testing.assert_allclose(smooth.forces_nc(), direct.forces_nc(), rtol=0, atol=1e-11)
    v = frame.velocities
    shares = [ewald.Smooth(term, frame.replace(positions=frame.positions + t * v)).energies_n() for t in (1e-4, -1e-4)]
    rate = 0.5 * frame.charges * (smooth.potential_rate_n(v) - np.einsum("nc,nc->n", smooth.field_nc(), v))
    np.testing.assert_allclose(rate, (shares[0] - shares[1]) / 2e-4, rtol=0, atol=1e-6 * np.abs(rate).max())


def rock_salt(a=5.64, n=1):
    s = np.stack(np.meshgrid(*[np.arange(2 * n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    q = np.where(s.sum(1) % 2 == 0, 1.0, -1.0)
    return Frame(0.5 * a * s, Cell(np.diag([n * a] * 3)), units("metal"), charges=q, masses=np.ones(len(q)))


MADELUNG = 1.7475645946331822  # per pair of ions and nearest distance


def salt_potential(cutoff=5.0, accuracy=1e-13):
    pot = atc.potential(f"units metal\npair_style coul/long {cutoff}\npair_coeff * *\nkspace_style ewald 1e-6")
    return converged(pot, accuracy)


def test_madelung_constant_of_rock_salt_and_its_pressure():
    frame, pot = rock_salt(), salt_potential()
    C, a = frame.units.coulomb, 5.64
    for cutoff in (4.0, 8.0):
        d = salt_potential(cutoff).stream(frame, energies=True, forces=True)
        assert d.energy == pytest.approx(-4 * MADELUNG * C / (0.5 * a), rel=1e-12)
        np.testing.assert_allclose(d.energies_n, d.energy / 8, rtol=1e-11)
        # 1/r: the trace of the virial is minus the energy; by strain, and by symmetry a third of it for each axis.
        np.testing.assert_allclose(d.virial_cc, -d.energy / 3 * np.eye(3), rtol=0, atol=1e-11 * abs(d.energy))
        assert np.abs(d.forces_nc).max() < 1e-10
    h = 1e-4
    bent = [pot.stream(rock_salt(a * (1 + e))).energy for e in (h, -h)]
    assert np.trace(d.virial_cc) == pytest.approx((bent[0] - bent[1]) / (2 * h), rel=1e-7)


def test_energies_do_not_depend_on_the_split():
    frame = eight_ions()
    results = [salt_potential(r).stream(frame, forces=True, energies=True) for r in (3.0, 6.0)]
    assert results[0].energy == pytest.approx(results[1].energy, rel=1e-11)
    np.testing.assert_allclose(results[0].forces_nc, results[1].forces_nc, rtol=0, atol=1e-10)
    np.testing.assert_allclose(results[0].virial_cc, results[1].virial_cc, rtol=0, atol=1e-10)
    np.testing.assert_allclose(results[0].energies_n, results[1].energies_n, rtol=0, atol=1e-10)


def of_straight_bonds(frame, Q, end):
    """(3, 3) a mode of the stress of charges whose whole forces, fading to zero at a distance, act along bonds."""
    x, q, cell = frame.positions - frame.cell.origin, frame.charges, frame.cell.vectors
    n = int(np.ceil(end / np.linalg.svd(cell)[1].min())) + 1
    images = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3) @ cell
    sigma = np.zeros((3, 3), complex)
    for i, j in np.ndindex(len(q), len(q)):
        r = x[i] - x[j] + images
        d2 = (r * r).sum(1)
        r, d2 = (a[(d2 > 1e-9) & (d2 < end**2)] for a in (r, d2))
        force = q[i] * q[j] * d2**-1.5 * (1 - d2 / end**2) ** 2
        line = np.exp(-1j * (x[j] @ Q + 0.5 * (r @ Q))) * np.sinc(r @ Q / (2 * np.pi))
        sigma -= np.einsum("b,bi,bj->ij", force * line, r, r)
    return frame.units.coulomb * sigma / (2 * frame.cell.volume)


def test_bonds_alone_have_no_limit():
    """Whole forces that are cut off ever farther out: the divergence settles at that of Ewald's sum, what is across Q
    grows with the distance R like −(C/2V²) ρ(Q/2)² (2π²/Q) (8/15) R, 8/15 being the mean of how the force fades."""
    frame = eight_ions(np.diag([9.0, 10.0, 11.0]))
    Q = 2 * np.pi * np.array([0, 0, 2 / 11.0])
    x, C, V = frame.positions - frame.cell.origin, frame.units.coulomb, frame.cell.volume
    near, far, farther = (of_straight_bonds(frame, Q, end) for end in (30.0, 60.0, 120.0))
    slope = -C / (2 * V**2) * (frame.charges @ np.exp(-0.5j * (x @ Q))) ** 2 * 2 * np.pi**2 / Q[2] * 8 / 15
    for a in (0, 1):
        assert abs((farther - far)[a, a] / 60.0 / slope - 1) < 0.05
    force = salt_potential(5.0, 1e-12).stream(frame, forces=True).forces_nc
    want = np.exp(-1j * (x @ Q)) @ force / V
    off = [np.abs(1j * Q @ sigma - want).max() / np.abs(want).max() for sigma in (near, far, farther)]
    assert off[1] < 0.3 * off[0] and off[2] < 0.3 * off[1] and off[2] < 1e-3, off


# ---- LAMMPS


def ions(triclinic=True, bonded=False, slab=False, n=4, style="real"):
    """64 ions of two types near a lattice, some of them bonded in rows of four."""
    rng = np.random.default_rng(3)
    L = 11.0
    v = np.array([[L, 0, 0], [1.5 * triclinic, L + 1, 0], [-1.1 * triclinic, 1.7 * triclinic, L + 2]])
    s = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    x = (s + 0.5) / n @ v + rng.uniform(-0.3, 0.3, (n**3, 3))
    kind = s.sum(1) % 2
    q = np.where(kind == 0, 1.0, -1.0) * rng.uniform(0.5, 1.0, n**3)
    more = {"bonds": np.array([[i, i + 1] for i in range(n**3 - 1) if (i + 1) % n])} if bonded else {}
    v_nc = 0.01 * rng.normal(size=(n**3, 3))
    return Config(
        v, x, kind + 1, style, {1: 20.0, 2: 30.0}, q - q.mean(), v_nc, periodic=(True, True, not slab), **more
    )  # fmt: skip


BONDED = "special_bonds lj/coul 0.0 0.5 0.7\nbond_style zero nocoeff\nbond_coeff *\n"
LJ = "pair_coeff 1 1 0.1 2.5\npair_coeff 2 2 0.12 2.3\n"
# LAMMPS's erfc is a polynomial good to 1.5e-7; its table of it is not better.
ERFC = 1e-6


def compare(lines, config, rtol=ERFC, extra="pair_modify table 0\n"):
    pot = converged(atc.potential(f"units {config.units}\n{lines}"), 1e-12)
    frame = config.frame()
    u = frame.units
    mine, theirs = pot.stream(frame, energies=True, forces=True), run_lammps(lines + extra, config)
    forces = u.to_internal("force", theirs.forces_nc)
    assert mine.energy == pytest.approx(u.to_internal("energy", theirs.energy), rel=5 * rtol)
    np.testing.assert_allclose(mine.forces_nc, forces, rtol=0, atol=rtol * np.abs(forces).max())
    virial = u.to_internal("pressure_volume", theirs.virial)
    np.testing.assert_allclose(mine.virial_cc, virial, rtol=0, atol=rtol * np.abs(virial).max())
    shares = u.to_internal("energy", theirs.energies_n)
    np.testing.assert_allclose(mine.energies_n, shares, rtol=0, atol=rtol * np.abs(shares).max())
    return pot, frame, mine, theirs


def exact_sum(term, frame):
    """(energy, forces, virial) of the smooth part, mode by mode in extended precision."""
    real = np.longdouble
    v, q = frame.cell.vectors.astype(real), frame.charges.astype(real)
    x = frame.positions.astype(real) - frame.cell.origin
    normals = np.stack([np.cross(v[a - 2], v[a - 1]) for a in range(3)])
    volume, pi = v[0] @ normals[0], 4 * np.arctan(real(1))
    alpha, C = real(term.split.alpha), real(term.split.constant)
    s, b = 1 / (4 * alpha**2), 2 * pi * normals / volume
    m = np.ceil(2 * 6.4 * float(alpha) * np.linalg.norm(frame.cell.vectors, axis=1) / (2 * np.pi)).astype(int)
    n = np.stack(np.meshgrid(*[np.arange(-k, k + 1) for k in m], indexing="ij"), -1).reshape(-1, 3)
    k = n[len(n) // 2 + 1 :].astype(real) @ b  # of every mode and its opposite the one
    k = k[s * (k * k).sum(1) < 40]
    k2 = (k * k).sum(1)
    V = 8 * pi * C * np.exp(-s * k2) / k2 / volume
    co, si = np.cos(x @ k.T), np.sin(x @ k.T)
    power = V * ((q @ co) ** 2 + (q @ si) ** 2)
    forces = q[:, None] * ((V * (si * (q @ co) - co * (q @ si))) @ k)
    # The strain derivative of a mode's energy.
    virial = ((power * (s + 1 / k2))[:, None] * k).T @ k - 0.5 * power.sum() * np.eye(3, dtype=real)
    return 0.5 * power.sum() - alpha * C / np.sqrt(pi) * (q * q).sum(), forces, virial


@pytest.mark.parametrize("bonded", [False, True], ids=["ions", "bonded"])
def test_coulomb_against_lammps(bonded):
    lines = (
        (BONDED if bonded else "")
        + "dielectric 1.3\npair_style lj/cut/coul/long 4.5 5.0\n"
        + LJ
        + "kspace_style ewald 1e-12\n"
    )
    config = ions(bonded=bonded)
    pot, frame, *_ = compare(lines, config)
    # The smooth part alone, with the same alpha: no erfc in it. What is left is rounding.
    (term,) = converged(pot, 1e-16).fields
    alone = (
        lines.replace("ewald 1e-12", "ewald 1e-16")
        + f"kspace_modify gewald {term.split.alpha:.17g}\npair_modify compute no\n"
    )
    theirs, u = run_lammps(alone, config), frame.units
    mine = ewald.Smooth(term, frame, direct=True)
    forces = u.to_internal("force", theirs.forces_nc)
    np.testing.assert_allclose(mine.forces_nc(), forces, rtol=0, atol=5e-14 * np.abs(forces).max())
    assert mine.energy == pytest.approx(u.to_internal("energy", theirs.energy), rel=1e-13)
    virial = u.to_internal("pressure_volume", theirs.virial)
    np.testing.assert_allclose(mine.virial_cc, virial, rtol=0, atol=1.5e-13 * np.abs(virial).max())
    w = u.to_internal("pressure_volume", theirs.stress_n)[:, [0, 1, 2, 5, 4, 3]]
    np.testing.assert_allclose(mine.virials_n6(), w, rtol=0, atol=6e-14 * np.abs(w).max())
    if np.finfo(np.longdouble).eps > 1e-18:
        return
    # What rounding leaves of forces, energy and virial: 3e-15, 4e-16 and 1e-15 here, 7e-15, 1.5e-14 and 2.5e-14 of
    # LAMMPS's.
    energy, exact, stress = exact_sum(term, frame)
    assert np.abs(mine.forces_nc() - exact).max() < 5e-15 * np.abs(exact).max()
    assert abs(mine.energy - energy) < 2e-15 * abs(energy)
    assert np.abs(mine.virial_cc - stress).max() < 5e-15 * np.abs(stress).max()
    assert np.abs(forces - exact).max() < 3e-14 * np.abs(exact).max()
    fast = ewald.Smooth(term, frame)
    assert np.abs(fast.forces_nc() - exact).max() < 1e-12 * np.abs(exact).max()


STYLES = {
    "coul/long": "pair_style coul/long 5.0\npair_coeff * *",
    "buck": "pair_style buck/coul/long 4.5 5.0\npair_coeff * * 1000.0 0.3 20.0",
    "born": "pair_style born/coul/long 4.5 5.0\npair_coeff * * 0.3 0.32 2.3 10.0 3.0",
    "class2": "pair_style lj/class2/coul/long 4.5 5.0\n" + LJ,
    "nm": "pair_style nm/cut/coul/long 4.5 5.0\npair_coeff * * 0.1 2.6 11.0 7.0",
    "charmm": "pair_style lj/charmm/coul/long 3.5 4.5 5.0\n" + LJ,
    "charmmfsw": "pair_style lj/charmmfsw/coul/long 3.5 4.5 5.0\n" + LJ,
    "lj/long": "pair_style lj/long/coul/long cut long 4.5 5.0\n" + LJ,
    "hybrid": "pair_style hybrid lj/cut/coul/long 4.5 5.0 buck/coul/long 4.0 5.0\npair_coeff 1 1 lj/cut/coul/long 0.1 "
    "2.5\n"
    "pair_coeff 2 2 buck/coul/long 1000.0 0.3 20.0\npair_coeff 1 2 lj/cut/coul/long 0.1 2.4",
    "overlay": "pair_style hybrid/overlay lj/cut 4.5 coul/long 5.0\npair_coeff 1 1 lj/cut 0.1 2.5\npair_coeff 2 2 "
    "lj/cut 0.1 2.5\npair_coeff 1 2 lj/cut 0.1 2.4\n"
    "pair_coeff * * coul/long",
}


@pytest.mark.parametrize("name", STYLES)
def test_styles_against_lammps(name):
    solver = "ewald/disp" if name == "lj/long" else "ewald"
    compare(STYLES[name] + f"\nkspace_style {solver} 1e-10\n", ions())


def test_pppm_is_the_same_sum():
    """LAMMPS's mesh to its own accuracy."""
    lines = "pair_style lj/cut/coul/long 4.5 5.0\n" + LJ + "kspace_style pppm 1e-6\n"
    compare(lines, ions(triclinic=False), rtol=3e-5)


def test_slab_correction():
    """Forces and energy are LAMMPS's; its pressure leaves the correction's own energy out, which is part of the strain
    derivative."""
    lines = "pair_style coul/long 5.0\npair_coeff * *\nkspace_style ewald 1e-12\nkspace_modify slab 3.0\n"
    config = ions(triclinic=False, slab=True)
    pot = converged(atc.potential(f"units real\n{lines}"), 1e-12)
    frame = config.frame()
    u = frame.units
    mine, theirs = pot.stream(frame, energies=True, forces=True), run_lammps(lines + "pair_modify table 0\n", config)
    forces, shares = u.to_internal("force", theirs.forces_nc), u.to_internal("energy", theirs.energies_n)
    np.testing.assert_allclose(mine.forces_nc, forces, rtol=0, atol=ERFC * np.abs(forces).max())
    np.testing.assert_allclose(mine.energies_n, shares, rtol=0, atol=ERFC * np.abs(shares).max())
    smooth = pot.fields[0].modes(frame)
    assert smooth.slab_energy > 1e-4 * abs(mine.energy)

    def energy(a, e):
        stretch = np.eye(3)
        stretch[a, a] += e
        cell = Cell(frame.cell.vectors @ stretch, frame.cell.origin @ stretch, frame.cell.periodic)
        return pot.stream(frame.replace(positions=frame.positions @ stretch, cell=cell)).energy

    h = 1e-4
    for a in range(3):
        # The bonds end at a cutoff, where erfc is 1e-12.
        assert mine.virial_cc[a, a] == pytest.approx((energy(a, h) - energy(a, -h)) / (2 * h), rel=1e-6)
    left_out = mine.virial_cc - u.to_internal("pressure_volume", theirs.virial)
    np.testing.assert_allclose(np.diag(left_out), smooth.slab_energy * np.array([-1, -1, 1]), rtol=1e-3)
    w = smooth.virials_n6()
    np.testing.assert_allclose(w.sum(0), smooth.virial_cc[SIX], rtol=0, atol=1e-10)


REFUSED = {
    "msm": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style msm 1e-4",
        "line 4: kspace_style msm is not supported",
    ),
    "scafacos": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style scafacos p3m 1e-4",
        "kspace_style scafacos is not supported",
    ),
    "tip4p": ("pair_style coul/long 5\npair_coeff * *\nkspace_style pppm/tip4p 1e-4", "only with them"),
    "zero": ("pair_style coul/long 5\npair_coeff * *\nkspace_style zero 1e-4", "kspace_style zero is not supported"),
    "no kspace": ("pair_style coul/long 5\npair_coeff * *", "add the kspace_style line"),
    "no pair": (
        "pair_style coul/cut 5\npair_coeff * *\nkspace_style pppm 1e-4",
        "without a pair style that belongs to it",
    ),
    "accuracy": ("pair_style coul/long 5\npair_coeff * *\nkspace_style pppm", "needs its accuracy"),
    "nozforce": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\nkspace_modify slab nozforce",
        "nozforce is not supported",
    ),
    "compute": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\nkspace_modify compute no",
        "kspace_modify compute no",
    ),
    "wire": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\nkspace_modify wire 3.0",
        "kspace_modify wire is not supported",
    ),
    "dispersion": (
        "pair_style lj/long/coul/long long long 5\npair_coeff * * 1 1\nkspace_style pppm 1e-4",
        "needs ewald/disp or pppm/disp",
    ),
    "exclude": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\nneigh_modify exclude type 1 1",
        "neigh_modify exclude",
    ),
    "include": (
        "pair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\ngroup g type 1\nneigh_modify include g",
        "neigh_modify include is not supported with long-range",
    ),
    "cutoffs": (
        "pair_style hybrid/overlay coul/long 5 lj/cut/coul/long 4 4\npair_coeff * * coul/long\npair_coeff * * "
        "lj/cut/coul/long 1 1\nkspace_style pppm 1e-4",
        "cutoffs of the sub-styles differ",
    ),
    "twice": (
        "pair_style hybrid/overlay coul/long 5 lj/cut/coul/long 5\npair_coeff * * coul/long\npair_coeff * * "
        "lj/cut/coul/long 1 1\nkspace_style pppm 1e-4",
        "counted 2 times",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_by_name(name):
    lines, message = REFUSED[name]
    with pytest.raises(AtcError, match=message):
        atc.potential("units metal\n" + lines)


def test_frames_that_are_refused():
    pot, frame = salt_potential(), eight_ions()
    with pytest.raises(AtcError, match="not neutral"):
        pot.stream(frame.replace(charges=frame.charges + 0.01))
    with pytest.raises(AtcError, match="axis z of the cell is open"):
        pot.stream(frame.replace(cell=Cell(TRICLINIC, (1, 2, 3), (True, True, False))))
    some = atc.potential(
        "units metal\npair_style hybrid lj/cut 4 lj/cut/coul/long 4 5\npair_coeff 1 1 lj/cut 1 1\npair_coeff 2 2 "
        "lj/cut/coul/long 1 1\n"
        "pair_coeff 1 2 lj/cut/coul/long 1 1\nkspace_style pppm 1e-4"
    )
    with pytest.raises(AtcError, match="atoms of types 1 and 1 have charges"):
        some.stream(frame.replace(types=np.tile([1, 2], 4)))


def test_what_the_run_was_asked_for():
    pot = atc.potential(
        "units real\npair_style coul/long 5\npair_coeff * *\nkspace_style pppm 1e-4\nkspace_modify mesh 8 8 8 order 5 "
        "gewald 0.3"
    )
    run = pot.fields[0].run
    assert run.accuracy == 1e-4 and "0.0332" in run.describe(pot.units)
