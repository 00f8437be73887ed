"""What every family of kernels must keep, and a new one that is a single file."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

import atc
from atc.compiled import njit
from atc.deposit import make
from atc.deposit.gradient import gather
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.kernels import FAMILIES, Compiled, Kernel, known, register
from atc.simd import JIT, JIT_FMA, peek
from atc.units import units

TABLE = [(0.0, 2.0), (0.7, 2.5), (1.1, 1.0), (2.0, 0.0)]
GIVEN = {"piecewise-linear": {"table": TABLE}, "box": {"size": [1.5, 2.0, 3.0]}, "trilinear": {"size": [1.5, 2.0, 1.1]}}
FLAT = {"box": {"size": [1.5, 2.0]}, "trilinear": {"size": [1.5, 2.0]}}
EVERY = [(name, dimension) for name in FAMILIES for dimension in (2, 3)]
METAL = units("metal")


def made(name, dimension):
    given = (FLAT if dimension == 2 else GIVEN).get(name, GIVEN.get(name, {"radius": 2.0}))
    return atc.kernel(name, dimension=dimension, **given)


@pytest.mark.parametrize("name, dimension", EVERY)
def test_profile_integrates_to_one_and_its_transform_is_that_of_phi(name, dimension):
    """φ̂ along x is the cosine transform of φ integrated over the planes x = const: normalisation, plane integral and
    transform by one another."""
    kern = made(name, dimension)
    m = kern.marginal((1.0, 0.0, 0.0))
    radii = getattr(m, "radii", [])
    cuts = sorted({0.0, m.support, *radii, *np.linspace(0, m.support, 12)})
    total = [2 * quad(lambda z: float(m.phi(z)), a, b, epsabs=1e-14)[0] for a, b in itertools.pairwise(cuts)]
    # 1e-10: planar profiles have a root at the rim, which quadrature meets at its ends.
    assert sum(total) == pytest.approx(1.0, abs=1e-10)
    for k in (0.4, 1.3, 4.0):
        want = sum(
            2 * quad(lambda z, k=k: math.cos(k * z) * float(m.phi(z)), a, b, epsabs=1e-14)[0]
            for a, b in itertools.pairwise(cuts)
        )
        assert float(kern.hat(np.array([k, 0.0, 0.0]))) == pytest.approx(want, abs=1e-10)


@pytest.mark.parametrize("name, dimension", EVERY)
def test_compiled_functions_are_those_of_numpy(name, dimension):
    """β on a lattice and at points, and φ with its gradient, as compiled, against `Kernel.beta`, `phi` and
    `grad_phi`."""
    kern = made(name, dimension)
    flat = np.array([1.0, 1.0, 3 - dimension == 0])
    cell = Cell([40.0, 40.0, 40.0], [-20.0, -20.0, -20.0], (False, False, False))
    rng = np.random.default_rng(3)
    x_nc, r_bc = rng.normal(size=(30, 3)) * flat, rng.normal(size=(30, 3)) * 1.5 * flat
    r_bc[:3] = [[0, 0, 0], [1.0, 0, 0], [1e-12, 0, 0]]
    xyz = rng.normal(size=(20, 3)) * 0.8 * flat
    want = kern.beta(x_nc[:, None] - xyz, r_bc[:, None]).sum(0)
    for grid in (
        atc.Grid.points(xyz),
        atc.Grid.regular([[3, 0, 0], [0, 3, 0], [0, 0, 3]], shape=(3, 3, 1), origin=[-1.5, -1.5, -1.5]),
    ):
        bound = grid.bind(METAL, cell)
        dep = make("direct", bound, kern, cell, 1, 1)
        dep.add_bonds(x_nc, r_bc, np.ones((30, 1)))
        g_gc = bound.relative_points_gc + cell.origin
        want = kern.beta(x_nc[:, None] - g_gc, r_bc[:, None]).sum(0)
        # 1e-12 of the largest β there can be; β of a jump goes as the root of the distance from it.
        assert np.abs(dep.bond_sums()[:, 0] - want).max() <= 1e-12 * len(r_bc) * kern.peak
    values, slopes = gather(bound, kern, cell, x_nc, np.ones((30, 1)))
    d = x_nc[:, None] - g_gc
    assert np.abs(values[:, 0] - kern.phi(d).sum(0)).max() <= 1e-13 * len(x_nc) * kern.peak
    if not kern.jumps:
        assert np.abs(slopes[:, 0] + kern.grad_phi(d).sum(0)).max() <= 1e-12 * len(x_nc) * kern.peak / kern.scale


@pytest.mark.parametrize("name, dimension", EVERY)
def test_smoothness_is_what_is_said(name, dimension):
    """Along a ray off the axes: φ moves by steps if it jumps, its slope if it is not smooth."""
    kern = made(name, dimension)
    t = np.linspace(1e-7, 1.2 * kern.support, 20001)
    d = t[:, None] * np.array([0.8, 0.6, 0.0])
    h = t[1] - t[0]
    step = np.abs(np.diff(kern.phi(d))).max() / kern.peak
    slope = kern.grad_phi(d) @ np.array([0.8, 0.6, 0.0])
    through = kern.grad_phi(np.array([[1e-9, 1e-9, 0.0], [-1e-9, -1e-9, 0.0]]))
    kink = max(np.abs(np.diff(slope)).max(), np.abs(through[0] - through[1]).max()) * kern.scale / kern.peak
    assert (step > 100 * h / kern.scale) == kern.jumps
    if not kern.jumps:
        assert (kink > 0.05) == (not kern.smooth)


def argon(seed=0, n=4, spacing=3.7):
    rng = np.random.default_rng(seed)
    s = np.stack(np.meshgrid(*[np.arange(n) + 0.5] * 3, indexing="ij"), -1).reshape(-1, 3)
    m = np.full(len(s), 39.948)
    v = rng.normal(size=s.shape) * np.sqrt(METAL.boltzmann * 80 / m)[:, None]
    return Frame(
        spacing * s + rng.uniform(-0.3, 0.3, s.shape),
        Cell([n * spacing] * 3),
        METAL,
        types=np.ones(len(s), int),
        masses=m,
        velocities=v,
    )


LJ = "pair_style lj/cut 6.0\npair_coeff 1 1 0.0103 3.4"


def test_the_hat_obeys_the_balance_laws():
    from atc.analysis.check import check

    report = check(
        argon(), atc.potential(LJ, units="metal"), atc.kernel("hat", size=[4.0, 5.0, 6.0]), points=4, threads=1
    )
    assert report.ok, report


def test_the_hat_is_the_shape_function_of_elements():
    """On the nodes of a periodic mesh Σ V_I φ_I = 1 everywhere: an atom is shared out among the nodes of its element,
    and nothing else."""
    frame = argon()
    ds = atc.fields(
        frame,
        None,
        atc.kernel("trilinear", size=3.7),
        atc.Grid.regular(spacing=3.7, at="corners"),
        ["density"],
        tolerance=1e-12,
    )
    mean = frame.masses.sum() / frame.cell.volume / METAL.factor("density")
    assert float(ds.density.mean()) == pytest.approx(mean, rel=1e-12)


def test_the_hat_by_its_modes():
    cell, rng = Cell([9.0, 10.0, 11.0]), np.random.default_rng(1)
    x_nc, i_b = cell.cartesian(rng.random((60, 3))), rng.integers(0, 60, 300).astype(np.int32)
    r_bc, G_b = rng.normal(size=(300, 3)) * 1.5, rng.normal(size=300)
    sums = []
    for method in ("direct", "spectral"):
        bound = atc.Grid.regular(shape=(4, 3, 5)).bind(METAL, cell)
        dep = make(method, bound, atc.kernel("trilinear", size=[6.0, 5.0, 7.0]), cell, 0, 6, tolerance=1e-2)
        dep.add_bond_stress(x_nc, i_b, r_bc, G_b)
        sums.append(dep.bond_sums())
    assert np.abs(sums[1] - sums[0]).max() <= 1e-2 * np.abs(sums[0]).max()


# --- a family of one file


@njit(**JIT_FMA)
def _parabolas_mean(d0, d1, d2, r0, r1, r2, c_at, room_at):
    """c0 Π (1 − d_a²/R²), R = c1: along a bond a polynomial of degree 6 where it is inside the cube, four Gauss points
    are exact."""
    R, lo, hi = peek(c_at, 1), 0.0, 1.0
    for a in range(3):
        d, r = (d0, r0) if a == 0 else (d1, r1) if a == 1 else (d2, r2)
        if abs(r) > 1e-30 * R:
            lo, hi = max(lo, min((d - R) / r, (d + R) / r)), min(hi, max((d - R) / r, (d + R) / r))
        elif abs(d) >= R:
            hi = 0.0
    total = 0.0
    if hi > lo:
        for q in range(4):
            t = lo + X[q] * (hi - lo)
            u, v, w = (d0 - t * r0) / R, (d1 - t * r1) / R, (d2 - t * r2) / R
            total += W[q] * (hi - lo) * (1.0 - u * u) * (1.0 - v * v) * (1.0 - w * w)
    return peek(c_at, 0) * total


X, W = (tuple(map(float, a)) for a in (lambda x, w: (0.5 * (x + 1), 0.5 * w))(*np.polynomial.legendre.leggauss(4)))


@njit(**JIT)
def _parabolas_value(d0, d1, d2, r2, radii, coef, g):
    R = coef[0, 1]
    f0, f1, f2 = max(1.0 - (d0 / R) ** 2, 0.0), max(1.0 - (d1 / R) ** 2, 0.0), max(1.0 - (d2 / R) ** 2, 0.0)
    c = -2.0 * coef[0, 0] / (R * R)
    g[0], g[1], g[2] = c * d0 * f1 * f2, c * d1 * f0 * f2, c * d2 * f0 * f1
    return coef[0, 0] * f0 * f1 * f2


class Parabolas(Kernel):
    """Π (1 − d_a²/R²)·3/4R over x, y, z."""

    name, aliases, takes = "parabolas", ("product of parabolas",), ("radius",)
    is_isotropic, smooth = False, False

    def __init__(self, R):
        self.R = R

    @classmethod
    def of(cls, dimension=None, *, radius):
        return cls(float(radius))

    radius = property(lambda self: self.R)
    parameters = property(lambda self: {"radius": self.R})
    support = property(lambda self: math.sqrt(3.0) * self.R)
    pieces = property(lambda self: (np.array([self.support]), np.array([[(0.75 / self.R) ** 3, self.R]])))
    compiled = property(lambda self: PARABOLAS)

    def scaled(self, factor):
        return Parabolas(self.R * factor)

    def phi(self, d):
        return (0.75 / self.R) ** 3 * np.maximum(1 - (np.asarray(d) / self.R) ** 2, 0).prod(-1)


PARABOLAS = Compiled.pointwise("parabolas", _parabolas_mean, _parabolas_value)


@pytest.fixture
def parabolas():
    yield register(Parabolas)
    del FAMILIES["parabolas"]


def test_a_family_of_one_file(parabolas):
    """Known by name, in sums of all kinds, exact; refused where it has not said what would be needed."""
    assert "parabolas" in known()
    kern, frame, pot = atc.kernel("product of parabolas", radius=4.0), argon(), atc.potential(LJ, units="metal")
    grid = atc.Grid.regular(shape=6)
    ds = atc.fields(frame, pot, kern, grid, ["stress", "density"], tolerance=1e-12)
    xyz = grid.bind(METAL, frame.cell, frame.positions).points_gc
    rho = np.zeros(len(xyz))
    for image in itertools.product((-1, 0, 1), repeat=3):
        rho += kern.phi(frame.positions[:, None] + image @ frame.cell.vectors - xyz).T @ frame.masses
    # 1e-12: sums of some hundred terms in another order.
    np.testing.assert_allclose(ds.density.values.ravel(), METAL.to_user("density", rho), rtol=1e-12)
    # Its integral over the box is the virial, whatever the kernel; 6 points an edge resolve φ to this.
    box = atc.fields(frame, pot, kern, grid, ["virial_stress_potential"]).virial_stress_potential.values.squeeze()
    mean = ds.stress_potential.values.squeeze().mean((0, 1, 2))
    assert np.abs(mean - box).max() < 0.05 * np.abs(box).max()
    # A bond alone against quadrature.
    cell, d, r = Cell([60.0] * 3), np.array([0.3, -1.0, 2.0]), np.array([3.0, 1.0, -5.0])
    dep = make("direct", atc.Grid.points([[30.0, 30.0, 30.0]]).bind(METAL, cell), kern, cell, 0, 1)
    dep.add_bonds(np.array([d + 30.0]), r[None], np.ones((1, 1)))
    cuts = sorted(np.clip([0, 1, *((d - 4) / r), *((d + 4) / r)], 0, 1))
    want = sum(
        quad(lambda t: float(kern.phi(d - t * r)), a, b, epsabs=1e-16)[0] for a, b in itertools.pairwise(cuts) if b > a
    )
    assert float(dep.bond_sums()[0, 0]) == pytest.approx(want, rel=1e-12)
    with pytest.raises(AtcError, match="no profile"):
        atc.fields(frame, pot, kern, atc.Grid.slab("z", 4), ["stress"])
    with pytest.raises(AtcError, match="not made for it.*use method 'direct'"):
        atc.fields(frame, pot, kern, grid, ["stress"], method="spectral")


def test_names_that_are_taken():
    class Other(Parabolas):
        name, aliases = "mine", ("cell",)

    with pytest.raises(AtcError, match="'cell' is known already"):
        register(Other)
    assert "mine" not in FAMILIES
