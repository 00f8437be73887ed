"""The two sums every field is made of: Σ_j a_j φ(x − x_j) over atoms and Σ b β(x) over bonds (formulas: R
4.0.91-4.0.116).

    dep = make("direct", bound_grid, kernel, cell, n_site, n_bond, threads=2)
    dep.add_sites(x_nc, a_nk, thread=0)
    dep.add_bond_stress(x_nc, i_b, r_bc, G_b, thread=1)
    sums_gk = dep.bond_sums()

All lengths are internal; the kernel must be in internal units (`Kernel.scaled`).
"""

from __future__ import annotations

from ..errors import AtcError

METHODS = ("direct", "spectral", "slab")


def make(method, bound_grid, kernel, cell, n_site, n_bond, threads=1, tolerance=1e-5, gradients=False, order=None):
    """A deposit: an object that takes sites and bonds in pieces and gives their sums on the grid.

    Parameters
    ----------
    method : "direct" (exact; on a slab grid the closed slab average), "spectral" (smooth kernels, at a cost that does
        not depend on their
        radius) or "slab"
    bound_grid : BoundGrid
    kernel : Kernel, internal units
    cell : Cell of the frame. Its periodic axes repeat; atoms may lie anywhere.
    n_site, n_bond : numbers of components of a and of b
    threads : number of independent buffers. ``add_*`` with different ``thread`` may run at the same time; the sums are
        taken in
        the order of the buffers, so that the result depends only on which piece went to which buffer.
    tolerance : of the spectral method, relative to the largest value of the field
    gradients : whether gradients will be asked for too (``site_gradients``, ``bond_gradients``), to the same tolerance:
        the spectral method only; the others'
        are in `atc.deposit.gradient`

    order : of the moments in which the spectral method gathers the bonds of `add_bond_stress` at their atoms, where
        their other ends are given; None: each
        bond becomes points. How many bonds are gathered follows from the tolerance; only the speed depends on the order

    Sums are linear in what has been added: all frames of an averaging window that share a cell may be added before the
    sums are taken, once.
    """
    if method not in METHODS:
        raise AtcError(f"unknown deposit method {method!r}: expected one of {', '.join(METHODS)}")
    if method == "spectral":
        from .collapse import spectral_deposit

        return spectral_deposit(bound_grid, kernel, cell, n_site, n_bond, threads, tolerance, gradients, order)
    if gradients:
        raise AtcError(
            f"deposit method {method!r} gives no gradients: use method 'spectral', or atc.deposit.gradient.gather"
        )
    from . import direct

    if bound_grid.kind == "slab":
        return direct.SlabDeposit(bound_grid, kernel, cell, n_site, n_bond, threads)
    if method == "slab":
        raise AtcError(f"deposit method 'slab' needs a slab grid, not {bound_grid.kind!r}: use 'direct'")
    if bound_grid.is_lattice:
        return direct.LatticeDeposit(bound_grid, kernel, cell, n_site, n_bond, threads)
    return direct.PointsDeposit(bound_grid, kernel, cell, n_site, n_bond, threads)


def exact_at(points, kernel, cell, n_site, n_bond, threads=1):
    """The exact deposit at a few points (g, 3), internal units: what every other method's error is measured against."""
    import numpy as np

    from ..grids import BoundGrid

    xyz = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    return make("direct", BoundGrid("points", cell, ("point",), xyz=xyz), kernel, cell, n_site, n_bond, threads)
