"""Sums with the kernel's gradient, velocity gradients, displacements and Eshelby's stress: brute force, differences of
fields, known deformations."""

import itertools

import numpy as np
import pytest
from energy_systems import system
from frames import CELLS, argon
from naive_fields import BruteLJ, images, site_sum

import atc
from atc.deposit.gradient import gather
from atc.errors import AtcError
from atc.estimators.registry import QUANTITIES
from atc.frame import Cell, Frame
from atc.units import units

SMOOTH_KERNELS = [
    ("linear", 4.5),
    ("cubic", 4.5),
    ("quartic", 4.5),
    ("lucy", 5.0),
    ("hardy", 5.0),
    ("gaussian", 2.4),
    ("bspline", 4.0),
]
RATES = ["velocity_gradient", "strain_rate", "vorticity"]


def gradient_by_brute_force(points, x, a, kern, cell):
    """(g, k, 3) Σ a ∂φ/∂x, ∂/∂x φ(x_j − x) = −∇φ(d)."""
    points, x = cell.wrap(points)[0], cell.wrap(x)[0]
    out = 0.0
    for shift in images(cell, kern.support):
        d = x[None] + shift - points[:, None]
        out = out - np.einsum("gnc,nk->gkc", kern.grad_phi(d), a)
    return out


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("name, radius", SMOOTH_KERNELS)
def test_sums_by_brute_force(cell, name, radius):
    frame = argon(cell, seed=1)
    frame.positions += 3 * frame.cell.periodic @ frame.cell.vectors
    kern = atc.kernel(name, radius=radius)
    rng = np.random.default_rng(2)
    points = frame.positions[:8] + rng.uniform(-3, 3, (8, 3))
    a = rng.normal(size=(len(frame), 2))
    bound = atc.Grid.points(points).bind(frame.units, frame.cell)
    for threads in (1, 2):
        values, gradients = gather(bound, kern, frame.cell, frame.positions, a, None, True, threads)
        # rounding of sums of a few hundred terms
        want = site_sum(points, frame.positions, a, kern, frame.cell)
        np.testing.assert_allclose(values, want, rtol=0, atol=1e-13 * max(np.abs(want).max(), kern.peak))
        want = gradient_by_brute_force(points, frame.positions, a, kern, frame.cell)
        np.testing.assert_allclose(gradients, want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert gather(bound, kern, frame.cell, frame.positions, a, None, False)[1] is None


def test_at_an_atom_and_outside():
    """At the position of the only atom φ is at its peak and ∂φ/∂x is 0 by symmetry; out of reach both are 0."""
    cell = Cell([30.0] * 3, periodic=(False,) * 3)
    x = np.array([[15.0, 15, 15]])
    for name, radius in SMOOTH_KERNELS:
        kern = atc.kernel(name, radius=radius)
        bound = atc.Grid.points([x[0], x[0] + [14.9, 0, 0], x[0] + [-40, 0, 0]]).bind(units("metal"), cell)
        values, gradients = gather(bound, kern, cell, x, np.ones((1, 1)))
        assert abs(values[0, 0] / kern.peak - 1) < 1e-14 and not values[2].any(), name
        if kern.support < 14.9:
            assert not values[1].any()
        assert np.isfinite(gradients).all() and not gradients[[0, 2]].any()


def test_first_moments():
    """The three extra factors are w (x_j − x) through the image that is summed."""
    frame = argon("tilted", seed=3)
    kern, w = atc.kernel("quartic", radius=6.0), np.random.default_rng(0).random(len(frame))
    points = frame.positions[:5] + 0.7
    bound = atc.Grid.points(points).bind(frame.units, frame.cell)
    values, gradients = gather(bound, kern, frame.cell, frame.positions, np.zeros((len(frame), 0)), w, True)
    p, x = frame.cell.wrap(points)[0], frame.cell.wrap(frame.positions)[0]
    first, slope = 0.0, 0.0
    for shift in images(frame.cell, kern.support):
        d = x[None] + shift - p[:, None]
        first = first + np.einsum("n,gnc,gn->gc", w, d, kern.phi(d))
        slope = slope - np.einsum("n,gnk,gnc->gkc", w, d, kern.grad_phi(d))
    np.testing.assert_allclose(values, first, rtol=0, atol=1e-13 * np.abs(first).max())
    np.testing.assert_allclose(gradients, slope, rtol=0, atol=1e-13 * np.abs(slope).max())


@pytest.mark.parametrize("name, radius", [*SMOOTH_KERNELS, ("step", 4.0)])
def test_slope_of_marginals(name, radius):
    """Of isotropic kernels dφ₁/dz = −2π z φ(|z|), from φ₁ = 2π ∫_|z|^∞ φ ρ dρ; of any, the central difference of φ₁."""
    kern = atc.kernel(name, radius=radius)
    m = kern.marginal()
    z = np.linspace(-radius, radius, 41)[1:-1] + 0.013
    if kern.is_isotropic:
        d = z[:, None] * [0.0, 0.0, 1.0]
        np.testing.assert_allclose(m.slope(z), -2 * np.pi * z * kern.phi(d), rtol=0, atol=1e-13 * m.phi(0.0))
    h = 1e-5
    # central differences: h² φ₁'''/6, and a kink of φ₁' within h of no point
    np.testing.assert_allclose(m.slope(z), (m.phi(z + h) - m.phi(z - h)) / (2 * h), rtol=0, atol=1e-8 * m.phi(0.0))


@pytest.mark.parametrize("cell", ["tilted", "orthogonal"])
@pytest.mark.parametrize("name, radius", [("quartic", 4.5), ("gaussian", 3.0), ("bspline", 4.0)])
def test_derivatives_of_fields(cell, name, radius):
    """∂_i of velocity and displacement by central differences of the fields themselves."""
    frame = argon(cell, seed=4)
    reference = frame.replace(
        positions=frame.positions + np.random.default_rng(1).uniform(-0.3, 0.3, frame.positions.shape)
    )
    reference = reference.replace(
        cell=Cell(frame.cell.vectors @ DEFORM, frame.cell.origin, frame.cell.periodic),
        positions=reference.positions @ DEFORM,
    )
    kern, points, h = atc.kernel(name, radius=radius), frame.positions[:5] + 0.6, 1e-3
    stencil = np.concatenate([points, *(points + s * h * np.eye(3)[c] for c in range(3) for s in (1, -1))])
    names = ["velocity", "displacement", "velocity_gradient", "displacement_gradient"]
    ds = atc.fields(frame, None, kern, atc.Grid.points(stencil), names, reference=reference).isel(frame=0)
    n = len(points)
    for of in ("velocity", "displacement"):
        f = ds[of].values.reshape(7, n, 3)
        want = np.stack(
            [(f[1 + 2 * c] - f[2 + 2 * c]) / (2 * h) for c in range(3)], axis=1
        )  # [g, i derivative, j component]
        # h² f'''/6 with f''' of order f/(radius/5)³
        np.testing.assert_allclose(
            ds[f"{of}_gradient"].values[:n], want, rtol=0, atol=1e-5 * np.abs(want).max(), err_msg=of
        )


DEFORM = np.array([[1.03, 0.02, 0.0], [-0.01, 0.98, 0.03], [0.02, 0.0, 1.01]])


def test_parts_of_the_velocity_gradient():
    frame = argon("tilted", seed=5)
    ds = atc.fields(frame, None, atc.kernel("quartic", radius=5.0), atc.Grid.regular(shape=(3, 2, 4)), RATES).isel(
        frame=0
    )
    L = ds.velocity_gradient.values
    np.testing.assert_allclose(ds.strain_rate, (L + L.swapaxes(-1, -2)) / 2, rtol=0, atol=1e-15 * np.abs(L).max())
    eps = np.zeros((3, 3, 3))
    for p in itertools.permutations(range(3)):
        eps[p] = np.linalg.det(np.eye(3)[list(p)])
    np.testing.assert_allclose(ds.vorticity, np.einsum("ijk,...jk->...i", eps, L), rtol=0, atol=1e-15 * np.abs(L).max())
    assert ds.vorticity.attrs["units"] == "1/ps" and ds.velocity_gradient.attrs["error_max"] < 1e-12


def crystal(n=9, a=2.0, seed=None):
    """A simple cubic crystal in open space."""
    x = np.stack(np.meshgrid(*[np.arange(n) * a] * 3, indexing="ij"), -1).reshape(-1, 3)
    return Frame(
        x,
        Cell([n * a] * 3, periodic=(False,) * 3),
        units("metal"),
        masses=np.full(len(x), 30.0),
        velocities=np.zeros_like(x),
    )


def test_homogeneous_flow():
    """v = L x in a crystal: L, its symmetric part and twice its rotation."""
    frame = crystal()
    L = 1e-2 * np.array([[0.1, 0.3, 0.0], [-0.2, 0.05, 0.4], [0.1, 0.0, -0.15]])  # [i, j] = ∂v_i/∂x_j
    frame = frame.replace(velocities=frame.positions @ L.T + [0.1, 0.2, 0.3])
    middle = frame.positions.mean(0) + [0.3, -0.2, 0.5]
    kern = atc.kernel(
        "bspline", radius=4.0
    )  # knots as far apart as atoms: a partition of unity that reproduces linear functions
    ds = atc.fields(frame, None, kern, atc.Grid.points([middle]), RATES, tolerance=1e-5).isel(frame=0)
    to = frame.units.to_user("rate", 1.0)
    got = ds.velocity_gradient.values[0] / to
    # rounding
    np.testing.assert_allclose(got, L.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ds.strain_rate.values[0] / to, (L + L.T) / 2, rtol=0, atol=1e-12)
    rotation = np.array([L[2, 1] - L[1, 2], L[0, 2] - L[2, 0], L[1, 0] - L[0, 1]])
    np.testing.assert_allclose(ds.vorticity.values[0] / to, rotation, rtol=0, atol=1e-12)


def test_rigid_rotation_turns_with_twice_its_rate():
    frame, w = crystal(), 1e-2 * np.array([0.1, -0.2, 0.3])
    frame = frame.replace(velocities=np.cross(w, frame.positions))
    ds = atc.fields(
        frame,
        None,
        atc.kernel("bspline", radius=4.0),
        atc.Grid.points([frame.positions.mean(0)]),
        ["vorticity", "strain_rate"],
    ).isel(frame=0)
    np.testing.assert_allclose(ds.vorticity.values[0] / frame.units.to_user("rate", 1.0), 2 * w, rtol=0, atol=1e-12)
    assert np.abs(ds.strain_rate).max() < 1e-12


def test_on_slabs():
    """The gradient of slab averages: along the normal only, the derivative of the profile."""
    frame = argon("tilted", seed=6)
    kern = atc.kernel("quartic", radius=4.5)
    n = 4000  # bins: neighbours are 11/4000 apart
    ds = atc.fields(frame, None, kern, atc.Grid.slab("z", n), ["velocity", "velocity_gradient"]).isel(frame=0)
    h = frame.cell.heights[2] / n
    at = slice(1, -1)
    want = (ds.velocity.values[2:] - ds.velocity.values[:-2]) / (2 * h)
    normal = frame.cell.inverse[:, 2] * frame.cell.heights[2]
    L = ds.velocity_gradient.values[at]
    # h² f'''/6, f''' ~ f/(radius/5)³
    np.testing.assert_allclose(np.einsum("i,gij->gj", normal, L), want, rtol=0, atol=1e-4 * np.abs(want).max())
    across = np.eye(3) - np.outer(normal, normal)
    assert np.abs(np.einsum("ik,gkj->gij", across, L)).max() < 1e-12 * np.abs(L).max()
    assert ds.velocity_gradient.attrs["error_max"] < 1e-11


# --- displacements


def pair(cell="tilted", seed=7, deform=DEFORM, shake=0.3):
    """A reference, and the same atoms shaken in a deformed cell that also moved."""
    reference = argon(cell, seed=seed)
    H = np.where(reference.cell.periodic[:, None], reference.cell.vectors @ deform, reference.cell.vectors)
    new = Cell(H, reference.cell.origin + [0.4, -0.3, 0.2], reference.cell.periodic)
    F = np.linalg.inv(reference.cell.vectors) @ H
    x = (reference.positions - reference.cell.origin) @ F + reference.cell.origin
    x = x + np.random.default_rng(seed).uniform(-shake, shake, x.shape)
    return reference, reference.replace(positions=x, cell=new)


def displaced_by_brute_force(frame, reference, kern, points, over="positions"):
    """Σ m (x_j − X_j) φ / Σ m φ over all images, each with its own displacement; the frames' atoms are in the same
    images."""
    x, X, m = frame.positions, reference.positions, frame.masses
    top, bottom = 0.0, 0.0
    reach = range(-4, 5)
    for n in itertools.product(*(reach if p else (0,) for p in frame.cell.periodic)):
        x_n, X_n = x + np.array(n) @ frame.cell.vectors, X + np.array(n) @ reference.cell.vectors
        phi = kern.phi((x_n if over == "positions" else X_n)[None] - points[:, None])
        top = top + np.einsum("n,gn,nc->gc", m, phi, x_n - X_n)
        bottom = bottom + phi @ m
    return top / bottom[:, None]


@pytest.mark.parametrize("cell", CELLS)
def test_displacement_by_brute_force(cell):
    reference, frame = pair(cell)
    kern, points = atc.kernel("quartic", radius=6.0), frame.positions[:6] + 0.5
    ds = atc.fields(frame, None, kern, atc.Grid.points(points), ["displacement"], reference=reference)
    want = displaced_by_brute_force(frame, reference, kern, points)
    np.testing.assert_allclose(ds.displacement.values[0], want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert ds.displacement.attrs["units"] == "angstrom" and ds.displacement.attrs["error_max"] < 1e-12


@pytest.mark.parametrize("flags", [False, True])
def test_rewrapped_atoms_change_nothing(flags):
    reference, frame = pair(seed=8)
    kern, points = atc.kernel("quartic", radius=5.0), frame.positions[:6] + 0.5
    names = ["displacement", "displacement_gradient", "eshelby_stress"]
    rng = np.random.default_rng(0)

    def rewrap(f, n):
        return f.replace(positions=f.positions + n @ f.cell.vectors, images=-n if flags else None)

    def fields(f, r):
        return atc.fields(f, BruteLJ(), kern, atc.Grid.points(points), names, reference=r)

    n = rng.integers(-2, 3, (2, len(frame), 3))
    # Without image flags an atom's own image is not known: its displacement is the one nearest to the deforming cell's.
    a, b = fields(frame, reference), fields(rewrap(frame, n[0]), rewrap(reference, n[1]))
    for q in names:
        np.testing.assert_allclose(b[q], a[q], rtol=0, atol=1e-11 * float(abs(a[q]).max()), err_msg=q)


def test_homogeneous_deformation():
    """x = F X in a periodic crystal: u = (1 − F⁻¹) x, which is not periodic, and its gradient is the same
    everywhere."""
    a, n = 2.0, 4
    x = np.stack(np.meshgrid(*[(np.arange(n) + 0.25) * a] * 3, indexing="ij"), -1).reshape(-1, 3)
    reference = Frame(x, Cell([n * a] * 3), units("metal"), masses=np.full(len(x), 30.0))
    frame = reference.replace(positions=x @ DEFORM, cell=Cell(reference.cell.vectors @ DEFORM))
    kern = atc.kernel("gaussian", width=2.4)  # ripple of the crystal: exp(−2π² w²/a²) = 5e-13
    points = frame.cell.cartesian([[0.05, 0.5, 0.97], [0.4, 0.3, 0.2], [-0.6, 1.5, 0.1]])
    ds = atc.fields(
        frame, None, kern, atc.Grid.points(points), ["displacement", "displacement_gradient"], reference=reference
    ).isel(frame=0)
    h = np.eye(3) - np.linalg.inv(DEFORM)
    np.testing.assert_allclose(ds.displacement, points @ h, rtol=0, atol=1e-10)
    np.testing.assert_allclose(ds.displacement_gradient, np.tile(h, (3, 1, 1)), rtol=0, atol=1e-10)
    assert ds.displacement_gradient.attrs["units"] == "1"


def test_slabs_of_a_deformed_cell_are_refused():
    reference, frame = pair()
    with pytest.raises(AtcError, match="slab"):
        atc.fields(
            frame, None, atc.kernel("quartic", radius=5.0), atc.Grid.slab("z", 5), ["displacement"], reference=reference
        )
    same = frame.replace(cell=reference.cell, positions=reference.positions + 0.1)
    ds = atc.fields(
        same, None, atc.kernel("quartic", radius=5.0), atc.Grid.slab("z", 5), ["displacement"], reference=reference
    )
    np.testing.assert_allclose(ds.displacement, 0.1, rtol=1e-10)


def test_what_is_missing():
    reference, frame = pair()
    with pytest.raises(AtcError, match="reference"):
        atc.fields(frame, None, atc.kernel("quartic", radius=5.0), atc.Grid.regular(shape=2), ["displacement"])
    with pytest.raises(AtcError, match="ids"):
        atc.fields(frame, None, atc.kernel("quartic", radius=5.0), atc.Grid.regular(shape=2), ["displacement"],
                   reference=reference.replace(ids=reference.ids + 1))  # fmt: skip
    with pytest.raises(AtcError, match="jumps"):
        atc.fields(frame, None, atc.kernel("step", radius=5.0), atc.Grid.regular(shape=2), ["strain_rate"])
    table = atc.kernel("piecewise-linear", table=[(0, 1), (4, 0.5)])
    with pytest.raises(AtcError, match="jumps"):
        atc.fields(frame, None, table, atc.Grid.regular(shape=2), ["strain_rate"])


def test_vacuum_is_masked():
    frame = argon("slab", n=(2, 2, 1), jitter=0.1)
    z = frame.positions[:, 2].mean()
    points = np.array([[1.0, 1.0, z], [1.0, 1.0, z + 11.5]])
    names = [*RATES, "displacement", "displacement_gradient", "eshelby_stress"]
    ds = atc.fields(
        frame, BruteLJ(), atc.kernel("quartic", radius=4.0), atc.Grid.points(points), names, reference=frame
    ).isel(frame=0)
    for q in names:
        assert np.isnan(ds[q].values[1]).all() and np.isfinite(ds[q].values[0]).all(), q
    assert float(abs(ds.displacement[0]).max()) == 0 and float(abs(ds.eshelby_stress[0]).max()) == 0


def test_time_average_is_weighted_by_mass():
    frames = [argon("orthogonal", seed=s) for s in (1, 2, 3)]
    frames = [f.replace(masses=frames[0].masses, types=frames[0].types) for f in frames]
    kern, grid = atc.kernel("quartic", radius=4.5), atc.Grid.regular(shape=(2, 2, 2))
    single = atc.fields(frames, None, kern, grid, ["velocity_gradient", "density"])
    mean = atc.fields(frames, None, kern, grid, ["velocity_gradient"], average=True)
    want = (single.velocity_gradient * single.density).sum("frame") / single.density.sum("frame")
    np.testing.assert_allclose(
        mean.velocity_gradient.values[0],
        want.transpose("x", "y", "z", "i", "j"),
        rtol=0,
        atol=1e-12 * float(abs(want).max()),
    )


# --- Eshelby


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_eshelby_by_brute_force(name):
    """W I − P (Grad u)ᵀ from its own definition: W and u summed over reference positions, Grad u by central
    differences."""
    reference, pot = system(name, seed=9)
    H = reference.cell.vectors @ DEFORM
    F = np.linalg.inv(reference.cell.vectors) @ H
    x = (reference.positions - reference.cell.origin) @ F + reference.cell.origin
    frame = reference.replace(
        positions=x + np.random.default_rng(9).uniform(-0.1, 0.1, x.shape), cell=Cell(H, reference.cell.origin)
    )
    kern, points, h = atc.kernel("quartic", radius=4.5), reference.positions[:5] + 0.5, 1e-3
    ds = atc.fields(
        frame, pot, kern, atc.Grid.points(points), ["piola_stress", "eshelby_stress"], reference=reference
    ).isel(frame=0)
    u = frame.units
    W = site_sum(
        points,
        reference.positions,
        (pot.decompose(frame).energies_n - pot.decompose(reference).energies_n)[:, None],
        kern,
        reference.cell,
    )[:, 0]
    P = u.to_internal("pressure", ds.piola_stress.values)
    step = [
        [displaced_by_brute_force(frame, reference, kern, points + s * h * e, "reference") for s in (1, -1)]
        for e in np.eye(3)
    ]
    grad = np.stack([(a - b) / (2 * h) for a, b in step], axis=1)  # [g, j, k] = ∂_j u_k
    want = W[:, None, None] * np.eye(3) - P @ grad.swapaxes(1, 2)
    got = u.to_internal("pressure", ds.eshelby_stress.values)
    # h² u'''/6
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-5 * np.abs(want).max())
    assert "reference" in ds.eshelby_stress.attrs["comment"] and QUANTITIES["eshelby_stress"].dimension == "pressure"


def test_eshelby_of_a_homogeneous_deformation():
    """W = (E − E₀)/V₀ and P = dW/dF of the crystal: the energy-momentum tensor from energies of the box alone."""
    a, n = 4.0, 3
    x = np.stack(np.meshgrid(*[np.arange(n) * a] * 3, indexing="ij"), -1).reshape(-1, 3)
    reference = Frame(x, Cell([n * a] * 3), units("metal"), masses=np.full(len(x), 39.948))
    pot = BruteLJ(cutoff=5.0)

    def W(F):
        moved = reference.replace(positions=x @ F, cell=Cell(reference.cell.vectors @ F))
        return (pot.stream(moved).energy - pot.stream(reference).energy) / reference.cell.volume

    F = np.array([[1.02, 0.01, 0.0], [0.0, 0.99, 0.02], [0.01, 0.0, 1.01]])  # [i, k] = ∂x_k/∂X_i
    h = 1e-5
    P = np.array(
        [[(W(F + h * np.outer(e, f)) - W(F - h * np.outer(e, f))) / (2 * h) for f in np.eye(3)] for e in np.eye(3)]
    )
    want = W(F) * np.eye(3) - P @ (F - np.eye(3)).T
    frame = reference.replace(positions=x @ F, cell=Cell(reference.cell.vectors @ F))
    points = [[0.1, 3.0, 5.0], [6.0, 6.5, 7.0]]
    ds = atc.fields(
        frame, pot, atc.kernel("gaussian", width=4.8), atc.Grid.points(points), ["eshelby_stress"], reference=reference
    ).isel(frame=0)
    got = frame.units.to_internal("pressure", ds.eshelby_stress.values)
    # central differences of the energy: h² W''' and 1e-16 W/h
    np.testing.assert_allclose(got, np.tile(want, (2, 1, 1)), rtol=0, atol=1e-7 * np.abs(want).max())
