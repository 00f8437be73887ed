"""The energy equation, ∂ε/∂t + ∇·(ε v) = ∇·(σ·v − q), and the churning tensor, from bonds and sources alone
(formulas.md §4).

Nothing here uses the estimators: fields and their exact derivatives are sums written out over atoms, bonds and images,
with φ, ∇φ and β of the kernel. No derivative is differenced: ∂φ_j/∂t = −v_j·∇φ_j, and a bond sum is differentiated by
∂_µ(x_jk^µ β_jk) = φ_k − φ_j.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from energy_systems import LINES, TUPLES, RandomTerm, cluster, potential, system
from naive_fields import bond_sum, site_sum

import atc
from atc.frame import Cell

#: one of each kind of potential, and every partition that goes with it
SYSTEMS = [
    ("lj", None),
    ("morse cluster", None),
    ("bond morse", None),
    ("sw", "equal"),
    ("sw", "center"),
    ("sw two elements", {"sw": (0.6, 0.2, 0.2)}),
    ("sw primitive", "equal"),
    ("angle harmonic", "equal"),
    ("angle charmm", "center"),
    ("hybrid", "equal"),
    ("dihedral opls", "equal"),
    ("dihedral opls", "center"),
    ("improper harmonic", "equal"),
    ("eam", "equal"),
    ("tersoff", "equal"),
    ("tersoff", "center"),
    ("atm", "equal"),
    ("tersoff/mod", "center"),
    ("tersoff/zbl", "equal"),
    ("vashishta", "equal"),
    ("edip", "equal"),
    ("edip", "center"),
    ("adp", "equal"),
    ("meam", "equal"),
    ("meam/spline", "equal"),
    ("eim", "equal"),
    ("eam/cd", "equal"),
    ("3-body", "equal"),
    ("4-body", "equal"),
    ("4-body", "center"),
    ("5-body", "equal"),
    ("5-body", "center"),
    ("nep", None),
    ("snap", None),
]
NAMES = [f"{n} {p or ''}".strip() for n, p in SYSTEMS]


def get(name, partition):
    frame, pot = system(name)
    return frame, pot if partition is None else pot.partitioned(partition)


def points_near(frame, count=3, seed=0):
    rng = np.random.default_rng(seed)
    return frame.positions[rng.choice(len(frame), count, replace=count > len(frame))] + rng.uniform(
        -0.8, 0.8, (count, 3)
    )


class _Sums:
    """Site and bond sums at points, with their gradients and rates, over all images."""

    def __init__(self, frame, bonds, kern, points):
        self.frame, self.bonds, self.kern, self.points = frame, bonds, kern, points

    def _site(self, a_nk, weight):
        return site_sum(
            self.points,
            self.frame.positions,
            a_nk,
            SimpleNamespace(support=self.kern.support, phi=weight),
            self.frame.cell,
        )

    def site(self, a_nk):
        return self._site(a_nk, self.kern.phi)

    def site_gradient(self, a_nk):
        """(g, 3, k): ∇ with respect to the point, which is minus that with respect to d = x_j − x."""
        return np.stack([self._site(a_nk, lambda d, c=c: -self.kern.grad_phi(d)[..., c]) for c in range(3)], axis=1)

    def site_rate(self, a_nk):
        """Σ a_j ∂φ_j/∂t."""
        v = self.frame.velocities
        return self._site(a_nk, lambda d: np.einsum("...c,...c->...", v, self.kern.grad_phi(d)))

    def bond(self, b_bk):
        b = self.bonds
        return bond_sum(self.points, self.frame.positions[b.i], b.r_bc, b_bk, self.kern, self.frame.cell)

    def bond_divergence(self, b_bk):
        """∂_µ Σ r^µ b β = Σ b (φ_j − φ_i)."""
        b, kern = self.bonds, self.kern
        ends = SimpleNamespace(support=kern.support, beta=lambda d, r: kern.phi(d - r) - kern.phi(d))
        return bond_sum(self.points, self.frame.positions[b.i], b.r_bc, b_bk, ends, self.frame.cell)


def energy_equation(frame, pot, kern, points):
    """Every term of the energy equation, (g,), by name; and z, its divergence, σ_U, the rate of the energy density,
    ∇·q."""
    d = pot.decompose(frame, sources=True)
    b, n = d.bonds, len(frame)
    s = _Sums(frame, b, kern, points)
    g = len(points)
    m, v, F = frame.masses, frame.velocities, d.forces_nc
    e = 0.5 * m * (v**2).sum(1) + d.energies_n
    D0, D1 = b.D_bdc[:, 0], b.D_bdc[:, 1]
    e_t = np.einsum("nc,nc->n", v, F)
    np.add.at(e_t, b.i, np.einsum("bc,bc->b", D0, v[b.j] - v[b.i]))
    np.add.at(e_t, b.j, np.einsum("bc,bc->b", D1, v[b.i] - v[b.j]))
    # columns: ρ, π, ε, T, J
    columns = np.column_stack(
        [m, m[:, None] * v, e, (m[:, None, None] * v[:, :, None] * v[:, None]).reshape(n, 9), e[:, None] * v]
    )
    cut = [1, 4, 5, 14]
    rho, pi, eps, T, J = np.split(s.site(columns), cut, axis=1)
    d_rho, d_pi, d_eps, d_T, d_J = np.split(s.site_gradient(columns), cut, axis=2)
    rho, eps, d_rho, d_eps = rho[:, 0], eps[:, 0], d_rho[..., 0], d_eps[..., 0]
    div_T = np.einsum("gmmn->gn", d_T.reshape(g, 3, 3, 3))
    # ordered pairs j, k: x_jk = r with D0 for j = i, and −r with D1 for j = j
    strength = np.column_stack(
        [-b.forces(), D0 - D1, np.einsum("bc,bc->b", v[b.j], D0) - np.einsum("bc,bc->b", v[b.i], D1)]
    )
    tensors = s.bond((b.r_bc[:, :, None] * strength[:, None, :6]).reshape(-1, 18)).reshape(g, 3, 6)
    S, M = tensors[..., :3], tensors[..., 3:6]
    div_S, div_M, div_A = np.split(s.bond_divergence(strength), [3, 6], axis=1)
    u = pi / rho[:, None]
    du = (d_pi - d_rho[:, :, None] * u[:, None]) / rho[:, None, None]  # ∂_µ v^ν
    div_u = np.einsum("gmm->g", du)
    sK = -(T.reshape(g, 3, 3) - rho[:, None, None] * u[:, :, None] * u[:, None])
    div_sK = -(div_T - np.einsum("gmm->g", d_pi)[:, None] * u - np.einsum("gm,gmn->gn", pi, du))
    z, div_z = S + M, div_S + div_M

    def flow(t, div_t):
        """∇·(t·v) of a tensor."""
        return np.einsum("gn,gn->g", div_t, u) + np.einsum("gmn,gmn->g", t, du)

    transport = np.einsum("gm,gm->g", d_eps, u) + eps * div_u
    q_kinetic = np.einsum("gmm->g", d_J) - transport + flow(sK, div_sK)
    q_potential = div_A[:, 0] - flow(M, div_M)
    q_churning = flow(z, div_z)
    rate = s.site(e_t[:, None])[:, 0] + s.site_rate(e[:, None])[:, 0]
    return SimpleNamespace(
        rate=rate,
        transport=transport,
        work=flow(sK, div_sK) + flow(S, div_S),
        q_kinetic=q_kinetic,
        q_potential=q_potential,
        q_churning=q_churning,
        z=z,
        div_z=div_z,
        parts_of_div_z=np.abs(div_S).max() + np.abs(div_M).max(),
        S=S,
        virial=d.virial_cc,
        div_q=q_kinetic + q_potential + q_churning,
        largest=max(
            np.abs(t).max()
            for t in (rate, transport, flow(sK, div_sK), flow(S, div_S), q_kinetic, q_potential, q_churning)
        ),
    )


def residual(t):
    return t.rate + t.transport - t.work + t.div_q


KERNELS = {
    "quartic": atc.kernel("quartic", 4.0),
    "gaussian": atc.kernel("gaussian", width=1.0),
    "lucy": atc.kernel("lucy", 3.5),
}


@pytest.mark.parametrize("name,partition", SYSTEMS, ids=NAMES)
def test_energy_is_balanced(name, partition):
    """To rounding, for every potential and partition; and the churning tensor has no divergence."""
    frame, pot = get(name, partition)
    kern = list(KERNELS.values())[len(name) % 3]
    t = energy_equation(frame, pot, kern, points_near(frame))
    # sums of some thousand terms larger than their sum: 1e-16 · 1e4
    np.testing.assert_allclose(residual(t), 0.0, rtol=0, atol=1e-11 * t.largest)
    np.testing.assert_allclose(t.div_z, 0.0, rtol=0, atol=1e-11 * t.parts_of_div_z)
    assert t.largest > 0


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("partition", ["equal", "center"])
def test_without_churning_silicon_does_not_balance(kernel, partition):
    """The term that the usual heat flux lacks is no rounding."""
    frame, pot = get("sw", partition)
    t = energy_equation(frame, pot, KERNELS[kernel], points_near(frame, 6))
    assert np.abs(residual(t)).max() < 1e-11 * t.largest
    assert np.abs(residual(t) - t.q_churning).max() > 1e-3 * t.largest


@pytest.mark.parametrize("name", ["lj", "bond morse", "eam", "nep", "snap"])
def test_pairs_do_not_churn(name):
    """R 4.0.118: z is 0 at every point when half of a two-body energy belongs to each end. The same holds for embedding
    energies that belong to their own atom: their sources lie along the bonds and add up to −G x in each of them."""
    frame, pot = system(name)
    t = energy_equation(frame, pot, KERNELS["quartic"], points_near(frame))
    np.testing.assert_allclose(t.z, 0.0, rtol=0, atol=1e-14 * np.abs(t.S).max())


@pytest.mark.parametrize("name", ["sw", "angle harmonic", "dihedral opls", "tersoff", "5-body"])
def test_what_a_partition_changes(name):
    """Energy density, heat flux and churning depend on the partition; stress does not, and neither does what the energy
    equation says of all of them: ∂ε/∂t + ∇·(ε v + q), which is the stress power. ∇·q alone changes by the rate of the
    energy density that was moved."""
    frame, pot = system(name)
    points, kern = points_near(frame), KERNELS["quartic"]
    a, b = energy_equation(frame, pot, kern, points), energy_equation(frame, pot.partitioned("center"), kern, points)
    assert np.array_equal(a.S, b.S) and np.array_equal(a.virial, b.virial)
    assert np.abs(a.z - b.z).max() > 1e-3 * np.abs(a.z).max()
    np.testing.assert_allclose(a.work, b.work, rtol=1e-12)
    scale = max(a.largest, b.largest)
    together = [t.rate + t.transport + t.div_q for t in (a, b)]
    np.testing.assert_allclose(together[0], together[1], rtol=0, atol=1e-11 * scale)
    moved = (b.rate + b.transport) - (a.rate + a.transport)
    assert np.abs(moved).max() > 1e-4 * scale
    np.testing.assert_allclose(b.div_q - a.div_q, -moved, rtol=0, atol=1e-11 * scale)


# The churning tensor
# ---------------------------------------------------------------------------------------------------------------------


def churning(bonds, x, kern, point):
    """z and σ_U at a point, from the definition (R 4.0.116)."""
    beta = kern.beta(x[bonds.i] - point, bonds.r_bc)
    S = np.einsum("b,b,bm,bn->mn", beta, bonds.G_b, bonds.r_bc, bonds.r_bc)
    return S + np.einsum("b,bm,bn->mn", beta, bonds.r_bc, bonds.D_bdc[:, 0] - bonds.D_bdc[:, 1]), S


def one_term(bodies, partition="equal", seed=0):
    frame = cluster(seed=seed)
    return frame, atc.potential(RandomTerm(bodies, TUPLES[:1], seed, partition), "metal").decompose(
        frame, sources=True
    ).bonds


@pytest.mark.parametrize("seed", range(3))
def test_z_of_three_atoms_is_the_published_one(seed):
    """R 4.0.133, with a, b, c the atoms of the term (a sum over unordered pairs, as the bonds here)."""
    frame, bonds = one_term(3, seed=seed)
    G = {(int(i), int(j)): g for i, j, g in zip(bonds.i, bonds.j, bonds.G_b, strict=True)}
    assert set(G) == {(0, 1), (0, 2), (1, 2)}
    xa, xb, xc = frame.positions[:3]
    for kern in KERNELS.values():
        for point in points_near(frame, 3, seed):
            beta = lambda p, q: kern.beta(p - point, p - q)  # noqa: B023, E731
            ab, ac, bc = beta(xa, xb), beta(xa, xc), beta(xb, xc)
            x_ab, x_ac = xa - xb, xa - xc
            want = (
                np.outer(x_ab, x_ab) * (G[0, 1] - G[1, 2]) * (ab - bc)
                + np.outer(x_ac, x_ac) * (G[0, 2] - G[1, 2]) * (ac - bc)
                + np.outer(x_ab, x_ac) * (G[1, 2] - G[0, 2]) * (ab - bc)
                + np.outer(x_ac, x_ab) * (G[1, 2] - G[0, 1]) * (ac - bc)
            ) / 3
            z, S = churning(bonds, frame.positions, kern, point)
            np.testing.assert_allclose(z, want, rtol=0, atol=1e-13 * np.abs(S).max())
            assert np.abs(z).max() > 1e-6 * np.abs(S).max() or np.abs(S).max() == 0


@pytest.mark.parametrize("partition", ["equal", "center"])
@pytest.mark.parametrize("bodies", [3, 4, 5, 6])
def test_churning_vanishes_in_the_virial_limit(bodies, partition):
    """|z|/|σ_U| of one term under a kernel of width w. Its mean is 0 (whatever K and the shares), its first moment is
    not: seen from near the term, where ∇φ ~ d/w², the ratio falls as w⁻²; seen from a fixed fraction of w away, as
    w⁻¹."""
    if bodies == 6:
        frame = cluster()
        p = atc.potential(
            RandomTerm(6, [(0, 1, 2, 3, 4, 5)], partition="equal" if partition == "equal" else "first"), "metal"
        )
        bonds = p.decompose(frame, sources=True).bonds
    else:
        frame, bonds = one_term(bodies, "first" if partition == "center" else partition)
    middle = frame.positions[np.unique(bonds.i)].mean(axis=0)
    w = 15.0 * 2.0 ** np.arange(5)
    for offset, slope in (
        (lambda w: np.array([0.9, -0.4, 0.6]), -2.0),
        (lambda w: w * np.array([0.5, -0.3, 0.7]), -1.0),
    ):
        ratio = []
        for width in w:
            z, S = churning(bonds, frame.positions, atc.kernel("gaussian", width=width), middle + offset(width))
            ratio.append(np.linalg.norm(z) / np.linalg.norm(S))
        falls = np.diff(np.log2(ratio))
        # the next order is (size of the term / w) smaller: 3 / 120 at the widest
        assert falls[-1] == pytest.approx(slope, abs=0.05), falls


def test_churning_is_not_symmetric():
    """It couples to vorticity, too (R, behind 4.0.133)."""
    frame, pot = system("sw")
    t = energy_equation(frame, pot, KERNELS["quartic"], points_near(frame))
    assert np.abs(t.z - t.z.transpose(0, 2, 1)).max() > 0.1 * np.abs(t.z).max()


@pytest.mark.parametrize(
    "name,partition",
    [("sw", "equal"), ("sw", "center"), ("angle charmm", "equal"), ("tersoff", "equal"), ("4-body", "equal")],
)
def test_energy_of_a_cluster_flows_as_its_atoms_move(name, partition):
    """∫ (ε v + q − σ·v) dV of an isolated cluster is d/dt Σ x_j e_j: by central differences along the motion, with
    slope 2 in the time step."""
    frame, pot = get(name, partition)
    frame = frame.replace(cell=Cell(frame.cell.vectors, frame.cell.origin, periodic=(False,) * 3))
    d = pot.decompose(frame, sources=True)
    b, v, x, m = d.bonds, frame.velocities, frame.positions, frame.masses
    e = 0.5 * m * (v**2).sum(1) + d.energies_n
    # Σ J + Σ A: the bond's β has integral 1
    flux = e @ v + np.einsum(
        "b,bm->m", np.einsum("bc,bc->b", v[b.j], b.D_bdc[:, 0]) - np.einsum("bc,bc->b", v[b.i], b.D_bdc[:, 1]), b.r_bc
    )
    acceleration = d.forces_nc / m[:, None]

    def moment(t):
        y = x + t * v + 0.5 * t * t * acceleration
        w = v + t * acceleration
        return (0.5 * m * (w**2).sum(1) + pot.stream(frame.replace(positions=y), energies=True).energies_n) @ y

    steps = np.array([8e-3, 4e-3, 2e-3])
    error = np.array([np.abs((moment(h) - moment(-h)) / (2 * h) - flux).max() for h in steps])
    np.testing.assert_allclose(np.log2(error[:-1] / error[1:]), 2.0, atol=0.1)
    assert error[-1] < 2e-3 * np.abs(flux).max()


def test_the_systems_are_those_of_the_sources():
    assert {n for n, _ in SYSTEMS} <= {*LINES, "3-body", "4-body", "5-body", "nep"}
    assert potential("sw") is potential("sw")
