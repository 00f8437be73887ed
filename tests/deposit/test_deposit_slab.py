"""Slab profiles: the lateral average of the three-dimensional fields, in closed form."""

import numpy as np
import pytest
from test_deposit_direct import CELLS, KERNELS, METAL, close, sample

import atc
from atc.deposit import make
from atc.errors import AtcError
from atc.frame import Cell


def profile(bins, axis, kern, cell, x, i, r, a, b):
    dep = make("direct", atc.Grid.slab(axis, bins).bind(METAL, cell), kern, cell, a.shape[1], b.shape[1])
    dep.add_sites(x, a)
    dep.add_bonds(x[i], r, b)
    return dep


@pytest.mark.parametrize("box", CELLS)
@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("kind", ["quartic", "lucy", "hardy", "table", "gaussian", "step"])
def test_sum_over_images_of_the_marginal(kind, axis, box):
    """Against loops over images in one dimension with Kernel.marginal, which test_kernels checks by quadrature."""
    cell, kern = CELLS[box], KERNELS[kind][0]
    x, i, r, a, b = sample(cell, 3)
    dep = profile(7, axis, kern, cell, x, i, r, a, b)
    k = "xyz".index(axis)
    h = cell.heights[k]
    normal = cell.inverse[:, k] * h
    m = kern.marginal()
    sites, bonds = np.zeros((7, 2)), np.zeros((7, 6))
    for g in range(7):
        z = (x - cell.origin) @ normal - (g + 0.5) * h / 7
        for image in range(-8, 9) if cell.periodic[k] else [0]:
            sites[g] += m.phi(z + image * h) @ a
            bonds[g] += m.beta(z[i] + image * h, r @ normal) @ b
    area = cell.volume / h
    close(dep.site_sums(), sites / area)
    close(dep.bond_sums(), bonds / area)
    assert dep.visits > 0


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("box", ["orthogonal", "triclinic", "left-handed, rotated"])
def test_is_the_lateral_average_of_the_field(box, axis):
    """A Gaussian of w = 1 is resolved to rounding by a grid of spacing 0.6: the mean over planes of that grid is the
    average."""
    cell = CELLS[box]
    kern = atc.kernel("gaussian", width=1.0)
    x, i, r, a, b = sample(cell, 4)
    k = "xyz".index(axis)
    shape = [16, 16, 16]
    shape[k] = 3
    full = make("direct", atc.Grid.regular(shape=shape).bind(METAL, cell), kern, cell, 2, 6)
    full.add_sites(x, a)
    full.add_bonds(x[i], r, b)
    others = tuple(j for j in range(3) if j != k)
    dep = profile(3, axis, kern, cell, x, i, r, a, b)
    close(dep.site_sums(), full.site_sums().reshape(*shape, 2).mean(others))
    close(dep.bond_sums(), full.bond_sums().reshape(*shape, 6).mean(others))


@pytest.mark.parametrize("kind", KERNELS)
def test_integral_over_the_box(kind):
    """Σ over bins times their volume: exact up to how well 400 bins resolve the kernel."""
    cell, kern = CELLS["orthogonal"], KERNELS[kind][0]
    x, i, r, a, b = sample(cell, 5)
    dep = profile(400, "z", kern, cell, x, i, r, a, b)
    volume = cell.volume / 400
    # 1e-4: φ₁ of every kernel is at least continuous, so the midpoint rule of h = 0.02 errs by (h/R)²; only the box
    # jumps (h/R per atom).
    tolerance = 2e-2 if kind == "box" else 1e-4
    np.testing.assert_allclose(dep.site_sums().sum(0) * volume, a.sum(0), atol=tolerance * np.abs(a).sum())
    np.testing.assert_allclose(dep.bond_sums().sum(0) * volume, b.sum(0), atol=tolerance * np.abs(b).sum())


@pytest.mark.parametrize("kind", ["box", "bspline"])
def test_product_kernels_along_their_axes_only(kind):
    kern = KERNELS[kind][0]
    cell = CELLS["orthogonal"]
    x, i, r, a, b = sample(cell, 6)
    for axis in "xyz":
        k = "xyz".index(axis)
        dep = profile(5, axis, kern, cell, x, i, r, a, b)
        m = kern.marginal(np.eye(3)[k])
        want = np.zeros((5, 6))
        for g in range(5):
            d = x[i, k] - cell.origin[k] - (g + 0.5) * cell.heights[k] / 5
            for image in range(-5, 6):
                want[g] += m.beta(d + image * cell.heights[k], r[:, k]) @ b
        close(dep.bond_sums(), want / cell.volume * cell.heights[k])
    with pytest.raises(AtcError, match="isotropic"):
        make("slab", atc.Grid.slab("x", 4).bind(METAL, CELLS["triclinic"]), kern, CELLS["triclinic"], 1, 1)


def test_many_bins_and_a_far_box():
    cell = Cell([4.0, 4.0, 8.0])
    far = Cell([4.0, 4.0, 8.0], [2.0**20] * 3)
    x, i, r, a, b = sample(cell, 7)
    x = np.round(x * 64) / 64
    one = profile(1000, "z", KERNELS["lucy"][0], cell, x, i, r, a, b)
    two = profile(1000, "z", KERNELS["lucy"][0], far, x + 2.0**20, i, r, a, b)
    # 1e-13: z is a dot product with the normal, its terms in y and x are 0 times something large.
    close(two.bond_sums(), one.bond_sums(), 1e-13)
