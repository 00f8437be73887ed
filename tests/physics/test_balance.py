"""Laws that the fields obey identically, whatever the kernel and the potential (formulas.md §4)."""

import numpy as np
import pytest
from naive_fields import site_sum
from systems import silicon, system

import atc
from atc.deposit import make

# 10th-order central differences: f'(0) ≈ Σ c_k (f(kh) − f(−kh))/h, error h¹⁰ f⁽¹¹⁾/2772.
C10 = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260])


class Differences:
    """Divergences at a few random points, from fields computed on stencils around them."""

    def __init__(self, frame, h, count=3, seed=0):
        self.h, self.count = h, count
        self.centre = frame.cell.cartesian(np.random.default_rng(seed).random((count, 3)))
        k = np.arange(1, 6)
        steps = np.concatenate([[np.zeros(3)], *[[s * q * h * e for q in k for s in (1, -1)] for e in np.eye(3)]])
        self.grid = atc.Grid.points((self.centre[:, None] + steps).reshape(-1, 3))

    def split(self, values):
        """(points, direction, k, ±, ...) from a field on the stencils, and the field at the centres."""
        v = np.asarray(values).reshape(self.count, 31, *values.shape[1:])
        return v[:, 1:].reshape(self.count, 3, 5, 2, *values.shape[1:]), v[:, 0]

    def divergence(self, values):
        """∂_µ f[µ, ...]: the first index of the field is the direction."""
        v, _ = self.split(values)
        along = np.stack([v[:, m, :, :, m] for m in range(3)], axis=1)
        return np.einsum("k,gmk...->g...", C10 / self.h, along[:, :, :, 0] - along[:, :, :, 1])


def user_to_internal(ds, name, dimension, units):
    return units.to_internal(dimension, ds[name].values[0])


@pytest.mark.parametrize("name", ["lj", "sw", "nep"])
def test_mass_and_momentum_balance(name):
    """∂ρ/∂t + ∇·π = 0 and ∂π/∂t + ∇·(ρ v⊗v) = ∇·σ; time derivatives by the chain rule: ∂φ_j/∂t = −v_j·∇φ_j, m dv_j/dt =
    F_j."""
    frame, pot = system(name)
    kern = atc.kernel("gaussian", width=1.6)
    u, cell, x, m, v = frame.units, frame.cell, frame.positions, frame.masses, frame.velocities
    stencil = Differences(frame, h=0.16)
    names = ["density", "momentum", "velocity", "stress"]
    # the balance of one frame is that of the kinetic stress as it is
    ds = atc.fields(frame, pot, kern, stencil.grid, names, tolerance=1e-12, velocity="local")
    rho = user_to_internal(ds, "density", "density", u)
    pi = user_to_internal(ds, "momentum", "momentum", u)
    vel = user_to_internal(ds, "velocity", "velocity", u)
    sigma = user_to_internal(ds, "stress", "pressure", u)
    forces = pot.decompose(frame).forces_nc

    # −v_j·∇φ as a site sum: the gradient with respect to the point is minus that with respect to d = x_j − x
    class Rate:
        support = kern.support

        def phi(self, d):
            return np.einsum("...c,...c->...", v, kern.grad_phi(d))

    rho_t = site_sum(stencil.centre, x, m[:, None], Rate(), cell)[:, 0]
    pi_t = site_sum(stencil.centre, x, forces, kern, cell) + site_sum(stencil.centre, x, m[:, None] * v, Rate(), cell)
    # rounding of a field of size f differs by 1e-16 f/h; h¹⁰ f⁽¹¹⁾/2772 is (h/w)¹⁰ √10!/2772·f/w ~ 1e-10
    np.testing.assert_allclose(rho_t, -stencil.divergence(pi), rtol=0, atol=1e-9 * np.abs(rho_t).max())
    transport = stencil.divergence(rho[:, None, None] * vel[:, :, None] * vel[:, None, :])
    np.testing.assert_allclose(pi_t + transport, stencil.divergence(sigma), rtol=0, atol=1e-9 * np.abs(pi_t).max())


@pytest.mark.parametrize("name", ["lj", "sw", "nep"])
def test_divergence_of_the_potential_stress_is_the_force_density(name):
    """∇·σ_U = Σ F_j φ_j, from φ_j − φ_k = −∂_µ(x_jk^µ β)."""
    frame, pot = system(name, seed=3)
    kern = atc.kernel("gaussian", width=1.5)
    stencil = Differences(frame, h=0.15, seed=1)
    sigma = user_to_internal(
        atc.fields(frame, pot, kern, stencil.grid, ["stress_potential"], tolerance=1e-12),
        "stress_potential",
        "pressure",
        frame.units,
    )
    want = site_sum(stencil.centre, frame.positions, pot.decompose(frame).forces_nc, kern, frame.cell)
    np.testing.assert_allclose(stencil.divergence(sigma), want, rtol=0, atol=1e-9 * np.abs(want).max())


@pytest.mark.parametrize(
    "kern", [("quartic", 4.0), ("hardy", 3.0), ("step", 5.0), ("gaussian", 1.0)], ids=lambda k: k[0]
)
def test_flux_through_a_closed_surface_is_the_force_inside(kern):
    """The same law for kernels without derivatives: between two slabs' planes ∫(∂σ_zz/∂z) = force. Slab averages of
    σ_zν jump by the force."""
    frame, pot = system("lj", seed=4)
    kern = atc.kernel(kern[0], width=kern[1]) if kern[0] == "gaussian" else atc.kernel(*kern)
    bins = 7
    ds = atc.fields(frame, pot, kern, atc.Grid.slab("z", bins), ["stress_potential"], tolerance=1e-12)
    s = user_to_internal(ds, "stress_potential", "pressure", frame.units)
    n = np.linalg.inv(frame.cell.vectors)[:, 2] * frame.cell.heights[2]  # normal of the slabs
    traction = np.einsum("c,gcd->gd", n, s)
    area, height = frame.cell.volume / frame.cell.heights[2], frame.cell.heights[2]
    z = (np.arange(bins) + 0.5) / bins * height
    forces = pot.decompose(frame).forces_nc
    d = (frame.positions - frame.cell.origin) @ n
    marginal = kern.marginal(n)
    # force between plane 0 and plane g: each atom (and image) with the share of its kernel between them
    for g in range(1, bins):
        share = sum(
            marginal.cumulative(d + k * height - z[0]) - marginal.cumulative(d + k * height - z[g])
            for k in range(-3, 4)
        )
        want = share @ forces / area
        np.testing.assert_allclose(traction[g] - traction[0], want, rtol=0, atol=1e-12 * np.abs(traction).max())


@pytest.mark.parametrize("name", ["lj", "sw"])
@pytest.mark.parametrize("shape", [(18, 20, 22)])
def test_mean_over_a_resolved_grid_is_the_virial(name, shape):
    """∫σ_U dV = Σ G r⊗r; a mean over grid points is that integral once the Gaussian is resolved."""
    frame, pot = system(name, seed=5)
    kern = atc.kernel("gaussian", width=1.4)
    names = [
        "stress_potential",
        "virial_stress_potential",
        "smoothed_virial_stress",
        "virial_stress",
        "density",
        "momentum",
        "virial_stress_per_atom",
    ]
    ds = atc.fields(frame, pot, kern, atc.Grid.regular(shape=shape), names, tolerance=1e-12).isel(frame=0)

    def mean(q):
        return ds[q].values.reshape(-1, *ds[q].shape[3:]).mean(0)

    virial = ds.virial_stress_potential.values
    # the first alias of the Gaussian at spacing h is exp(−½ (2π w/h)²), h < 0.65: below rounding
    np.testing.assert_allclose(mean("stress_potential"), virial, rtol=0, atol=1e-10 * np.abs(virial).max())
    np.testing.assert_allclose(
        mean("smoothed_virial_stress"), ds.virial_stress, rtol=0, atol=1e-10 * np.abs(virial).max()
    )
    volume = frame.units.to_user("volume", frame.cell.volume)
    np.testing.assert_allclose(
        ds.virial_stress_per_atom.sum("atom") / volume, ds.virial_stress, rtol=0, atol=1e-12 * np.abs(virial).max()
    )
    np.testing.assert_allclose(
        mean("density"), frame.units.to_user("density", frame.masses.sum() / frame.cell.volume), rtol=1e-10
    )
    p = frame.units.to_user("momentum", frame.masses @ frame.velocities / frame.cell.volume)
    np.testing.assert_allclose(mean("momentum"), p, rtol=0, atol=1e-10 * np.abs(p).max())


# Radii that are even multiples of both heights' steps below.
KERNELS = ["step", "linear", "cubic", "quartic", "lucy", "hardy", "bspline", "box", "gaussian"]


def open_weights(n):
    """Weights of the n midpoints of equal parts of [0, 1] that integrate polynomials up to degree n − 1 exactly."""
    t = np.polynomial.legendre.legvander(2 * (np.arange(n) + 0.5) / n - 1, n - 1)
    return np.linalg.solve(t.T, np.r_[1.0, np.zeros(n - 1)])


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("what, step", [("lj", 0.5), ("sw", 0.7)])
def test_integral_of_the_stress_over_the_box_is_the_virial(what, step, name):
    """∫σ_U dV = Σ G r⊗r for every kernel, as an exact integral of β.

    The heights of all atoms are multiples of `step` and so are the kernel's radii: between two multiples the average
    over a cross-section is then a polynomial of degree ≤ 9 in z, which ten equally spaced slabs integrate exactly. x
    and y are arbitrary.
    """
    frame, pot = system(what, seed=6)
    if what == "sw":  # lattice planes 1.4 apart
        frame = silicon(seed=7, tilt=(1.5, -2.0, 3.0), shake=0.0).replace(masses=None, velocities=None)
        frame = frame.replace(
            positions=(frame.positions - frame.cell.origin) * (5.6 / 5.431),
            cell=atc.Cell(frame.cell.vectors * (5.6 / 5.431)),
        )
        rng = np.random.default_rng(2)
        frame.positions[:, :2] += rng.uniform(-0.25, 0.25, (len(frame), 2))
        frame.positions[::11, 2] += 0.7
    z0, height = frame.cell.origin[2], frame.cell.heights[2]
    frame.positions[:, 2] = z0 + np.rint((frame.positions[:, 2] - z0) / step) * step
    parts = round(height / step)
    R = {"lj": 4.0, "sw": 4.2}[what]
    kern = {
        "box": lambda: atc.kernel("box", size=[R, R, R]),
        "gaussian": lambda: atc.kernel("gaussian", width=1.2),
    }.get(name, lambda: atc.kernel(name, radius=R))()
    n = 10
    ds = atc.fields(
        frame,
        pot,
        kern,
        atc.Grid.slab("z", parts * n),
        ["stress_potential", "virial_stress_potential"],
        tolerance=1e-12,
    ).isel(frame=0)
    profile = ds.stress_potential.values.reshape(parts, n, 3, 3)
    mean = np.einsum("k,pkij->ij", open_weights(n), profile) / parts
    virial = ds.virial_stress_potential.values
    np.testing.assert_allclose(mean, virial, rtol=0, atol=1e-12 * np.abs(ds.stress_potential).values.max())
    assert ds.stress_potential.attrs["error_max"] < 1e-13


def test_forces_and_stress_come_from_the_same_bonds():
    """Two deposits of the same bonds, by hand and through `atc.fields`, are the same numbers."""
    frame, pot = system("sw", seed=8)
    kern = atc.kernel("quartic", radius=5.0)
    grid = atc.Grid.regular(shape=(4, 5, 6))
    ds = atc.fields(frame, pot, kern, grid, ["stress_potential"], threads=1)
    bonds = pot.decompose(frame).bonds
    deposit = make("direct", grid.bind(frame.units, frame.cell, frame.positions), kern, frame.cell, 0, 6)
    deposit.add_bond_stress(frame.positions, bonds.i, bonds.r_bc, bonds.G_b)
    want = frame.units.to_user("pressure", deposit.bond_sums())
    # the order of summation differs: rounding
    np.testing.assert_allclose(
        ds.stress_potential.values.reshape(-1, 9)[:, [0, 4, 8, 5, 2, 1]], want, rtol=0, atol=1e-13 * np.abs(want).max()
    )
