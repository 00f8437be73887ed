"""Cylindrical and spherical grids: points, local axes, and fields whose components are known."""

import numpy as np
import pytest
from frames import argon
from naive_fields import bond_sum, lj_bonds

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.grids.curved import in_local_axes
from atc.units import units

U = units("metal")
LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"
KERNEL = atc.kernel("quartic", 4.0)


def bound(grid, cell=None):
    cell = cell or atc.Cell([20.0, 22.0, 24.0], [1.0, 2.0, 3.0])
    return grid.fixed(U, cell).bind(U, cell)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_points_and_axes_of_cylinders(axis):
    k = "xyz".index(axis)
    b = bound(atc.Grid.cylindrical(6.0, (3, 8, 4), axis=axis, inner=3.0))
    assert b.shape == (3, 8, 4) and b.dims == ("r", "phi", "z")
    x = b.points_gc.reshape(3, 8, 4, 3) - np.array([11.0, 13.0, 15.0])
    across = np.delete(x, k, axis=-1)
    assert np.allclose(np.linalg.norm(across, axis=-1), np.array([3.5, 4.5, 5.5])[:, None, None])
    assert np.allclose(x[0, 0, :, k], ((np.arange(4) + 0.5) / 4 - 0.5) * [20.0, 22.0, 24.0][k])
    e = b.basis_gcc
    assert np.allclose(e @ e.swapaxes(1, 2), np.eye(3)) and np.allclose(np.linalg.det(e), 1.0)
    assert np.allclose(e[:, 2], np.eye(3)[k])
    flat = x.reshape(-1, 3) - np.outer(x.reshape(-1, 3)[:, k], np.eye(3)[k])
    assert np.allclose(np.einsum("gc,gc->g", e[:, 0], flat), np.linalg.norm(flat, axis=1))


def test_points_and_axes_of_spheres():
    b = bound(atc.Grid.spherical(5.0, (2, 40, 30), center=[10.0, 10.0, 10.0]))
    x = b.points_gc - 10.0
    e, r = b.basis_gcc, np.linalg.norm(x, axis=1)
    assert np.allclose(np.unique(r.round(9)), [1.25, 3.75])
    assert np.allclose(e[:, 0], x / r[:, None]) and np.allclose(e @ e.swapaxes(1, 2), np.eye(3))
    assert np.allclose(np.linalg.det(e), 1.0) and (e[:, 1, 2] <= 1e-12).all()  # theta grows downwards
    # plain means over the angles are means over the sphere: <n n> = 1/3, to the midpoint rule's (Δ cos θ)²
    n = (x / r[:, None]).reshape(2, -1, 3)[0]
    assert np.allclose(n.T @ n / len(n), np.eye(3) / 3, atol=1e-3)


@pytest.mark.parametrize("kind", ["cylindrical", "spherical"])
def test_uniform_tensors_are_exact(kind):
    """A pressure is one in all axes; a tensor turns as it should; von Mises does not change."""
    b = bound(getattr(atc.Grid, kind)(5.0, (2, 7, 5)))
    rng = np.random.default_rng(0)
    s = rng.normal(size=(3, 3))
    local = in_local_axes(np.broadcast_to(s, (len(b), 3, 3)), b.basis_gcc, 2)
    for g in range(0, len(b), 11):
        e = b.basis_gcc[g]
        assert np.allclose(local[g], e @ s @ e.T, rtol=0, atol=1e-15 * 10)
    assert np.allclose(in_local_axes(np.broadcast_to(np.eye(3), (len(b), 3, 3)), b.basis_gcc, 2), np.eye(3), atol=1e-15)
    v = rng.normal(size=3)
    assert np.allclose(np.linalg.norm(in_local_axes(np.broadcast_to(v, (len(b), 3)), b.basis_gcc, 1), axis=1),
                       np.linalg.norm(v))  # fmt: skip


@pytest.mark.parametrize("kind", ["cylindrical", "spherical"])
def test_fields_are_those_at_the_points_in_local_axes(kind):
    f = argon(temperature=90.0)
    grid = getattr(atc.Grid, kind)(4.0, (2, 3, 4), center=[1.0, 6.0, 55.0])
    pot = atc.potential(LJ, units="metal")
    names = ["stress", "velocity", "density", "heat_flux"]
    ds = atc.fields([f], pot, KERNEL, grid, names, tolerance=1e-12)
    axes = {"cylindrical": ["r", "phi", "z"], "spherical": ["r", "theta", "phi"]}[kind]
    assert ds.stress.dims == ("frame", *axes, "i", "j") and ds.i.values.tolist() == axes
    b = grid.fixed(U, f.cell).bind(U, f.cell)
    plain = atc.fields([f], pot, KERNEL, atc.Grid.points(b.points_gc), names, tolerance=1e-12)
    for name, rank in (("stress", 2), ("velocity", 1), ("heat_flux", 1), ("density", 0)):
        want = in_local_axes(plain[name].values[0], b.basis_gcc, rank)
        got = ds[name].values[0].reshape(want.shape)
        assert np.nanmax(abs(got - want)) < 1e-12 * np.nanmax(abs(want)), name
    # against the definition
    bonds, _, _ = lj_bonds(f.positions, f.cell, U.to_internal("energy", 0.0104), 3.4, 5.0)
    b_b9 = np.einsum("b,bi,bj->bij", bonds.G_b, bonds.r_bc, bonds.r_bc).reshape(-1, 9)
    S = bond_sum(b.points_gc, f.positions[bonds.i], bonds.r_bc, b_b9, KERNEL, f.cell).reshape(-1, 3, 3)
    got = ds.stress_potential.values[0].reshape(-1, 3, 3)
    assert abs(got - U.to_user("pressure", in_local_axes(S, b.basis_gcc, 2))).max() < 1e-11 * abs(got).max()
    assert np.allclose(ds.cell.values[0], f.cell.vectors) and ds.cell.dims == ("frame", "edge", "cartesian")
    again = Scene.loads(ds.attrs["scene"]).grid()
    assert again.kind == kind and np.allclose(again.fixed(U, f.cell).bind(U, f.cell).points_gc, b.points_gc)


def test_averages_pictures_and_what_does_not_go(tmp_path):
    frames = [argon(seed=k, temperature=90.0) for k in range(4)]
    pot = atc.potential(LJ, units="metal")
    grid = atc.Grid.cylindrical(4.0, (5, 6, 3))
    ds = atc.fields(frames, pot, KERNEL, grid, ["stress", "velocity", "density"], average=True)
    each = atc.fields(frames, pot, KERNEL, grid, ["stress_potential"])
    assert (
        abs(ds.stress_potential[0] - each.stress_potential.mean("frame")).max()
        < 1e-9 * abs(each.stress_potential).max()
    )
    ax = ds.atc.plot("stress").axes[0]
    labels = [t.get_text() for t in ax.get_legend().get_texts()]
    assert ax.get_xlabel() == "r (Å)" and r"$\sigma_{rr}$" in labels and r"$\sigma_{\phi \phi}$" in labels
    mean = ds.stress.mean(["phi", "z"])[0]
    line = next(a for a, t in zip(ax.lines, labels) if t == r"$\sigma_{\phi \phi}$")
    assert np.allclose(line.get_ydata(), mean[:, 1, 1])
    assert "average of 4 frames" in ax.figure._suptitle.get_text()
    (one,) = ds.atc.plot("stress", component="rphi").axes
    assert np.allclose(one.lines[0].get_ydata(), mean[:, 0, 1])
    with pytest.raises(AtcError, match="a scene of its own"):
        atc.fields(frames, pot, KERNEL, grid, ["stress", "virial_stress"])
    assert atc.fields(frames, pot, KERNEL, grid, ["virial_stress"]).i.values.tolist() == ["x", "y", "z"]
    with pytest.raises(AtcError, match="cylindrical"):
        atc.fields(frames, pot, KERNEL, grid, ["stress_potential", "smoothed_virial_stress_potential"]).atc.compare()
    from atc.export.export import export

    with pytest.raises(AtcError, match="cylindrical"):
        export(ds, tmp_path / "a.pvd")
    for more, said in (({"radius": 3.0, "inner": 4.0}, "inner < radius"), ({"radius": -1.0}, "inner < radius"),
                       ({"radius": 3.0, "length": 0.0}, "greater than 0")):  # fmt: skip
        with pytest.raises(AtcError, match=said):
            atc.Grid.cylindrical(shape=3, **more)
