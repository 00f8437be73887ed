"""Fields of the columns that a trajectory carries, against plain sums over atoms."""

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.running.opening import load

KERNEL = atc.kernel("quartic", 6.0)
NAMES = ["column:c_pe", "column:c_pe:mean", "column:c_pe:mass_mean", "column:c_st[1]", "column:q", "density"]


def frame(seed=0, style="metal", **extra):
    f = argon("tilted", seed=seed, style=style)
    rng = np.random.default_rng(seed + 100)
    n = len(f)
    return f.replace(
        charges=rng.normal(size=n),
        extra={"c_pe": rng.normal(-1, 1, n), "c_st[1]": rng.normal(0, 1e4, n), "v": rng.normal(size=(n, 2)), **extra},
    )


def naive(f, points, a_n):
    """Σ a φ over every image that may matter, in the user's units."""
    kern, u = KERNEL, f.units
    x, H = u.to_user("length", f.positions), u.to_user("length", f.cell.vectors)
    out = np.zeros(len(points))
    for k in np.ndindex(5, 5, 5):
        d = x + (np.array(k) - 2) @ H - points[:, None, :]
        out += kern.phi(d.reshape(-1, 3)).reshape(len(points), -1) @ a_n
    return out


@pytest.mark.parametrize("style", ["metal", "nano"])
def test_columns_against_plain_sums(style):
    f = frame(style=style)
    u = f.units
    kern = atc.kernel("quartic", 6.0 if style == "metal" else 0.6)
    points = u.to_user("length", f.cell.cartesian(np.random.default_rng(5).random((7, 3))))
    ds = atc.fields([f], None, kern, atc.Grid.points(points), NAMES, column_units={"c_pe": "eV"})
    global KERNEL
    kept, KERNEL = KERNEL, kern
    try:
        one, mass = naive(f, points, np.ones(len(f))), naive(f, points, f.masses)
        pe, st = f.extra["c_pe"], f.extra["c_st[1]"]
        want = {
            "column:c_pe": naive(f, points, pe),
            "column:c_pe:mean": naive(f, points, pe) / one,
            "column:c_pe:mass_mean": naive(f, points, pe * f.masses) / mass,
            "column:c_st[1]": naive(f, points, st),
            "column:q": naive(f, points, u.to_user("charge", f.charges)),
        }
    finally:
        KERNEL = kept
    for name, values in want.items():
        np.testing.assert_allclose(ds[name][0], values, rtol=1e-10, atol=1e-12 * np.abs(values).max(), err_msg=name)
        assert ds[name].attrs["measured_error"] < 1e-10
    length = u.label("length")
    assert ds["column:c_pe"].attrs["units"] == f"eV/{u.label('volume')}" and length in u.label("volume")
    assert ds["column:c_pe:mean"].attrs["units"] == "eV"
    assert ds["column:c_st[1]"].attrs["units"] == f"(c_st[1])/{u.label('volume')}"
    assert ds["column:q"].attrs["units"] == f"{u.label('charge')}/{u.label('volume')}"


def test_on_regular_grids_within_the_tolerance_and_in_averages():
    frames = [frame(seed=k) for k in range(4)]
    grid, kern = atc.Grid.regular(shape=(12, 12, 12)), atc.kernel("gaussian", width=2.5)
    exact = atc.fields(frames, None, kern, grid, NAMES, method="direct", average=True)
    fast = atc.fields(frames, None, kern, grid, NAMES, method="spectral", tolerance=1e-6, average=True)
    for name in NAMES:
        a, b = exact[name].values, fast[name].values
        assert np.abs(a - b).max() <= 1e-6 * np.abs(a).max(), name
    each = atc.fields(frames, None, kern, grid, [*NAMES, "number_density"], method="direct")
    np.testing.assert_allclose(exact["column:c_pe"][0], each["column:c_pe"].mean("frame"), rtol=1e-9, atol=1e-15)
    n = each.number_density
    np.testing.assert_allclose(
        exact["column:c_pe:mean"][0], (n * each["column:c_pe:mean"]).sum("frame") / n.sum("frame"), rtol=1e-9
    )
    assert "column:c_pe_stderr" in exact
    # the integral over the cell is the sum over the atoms
    volume = frames[0].units.to_user("volume", frames[0].cell.volume)
    total = float(each["column:c_pe"][0].mean()) * volume
    assert total == pytest.approx(frames[0].extra["c_pe"].sum(), rel=1e-3)


def test_long_windows_are_added_up():
    frames = [frame(seed=k) for k in range(70)]
    grid = atc.Grid.points([[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]])
    names = ["column:c_pe", "column:c_pe:mean"]
    one = atc.fields(frames, None, KERNEL, grid, [*names, "number_density"], average=True)
    each = atc.fields(frames, None, KERNEL, grid, [*names, "number_density"])
    np.testing.assert_allclose(one["column:c_pe"][0], each["column:c_pe"].mean("frame"), rtol=1e-9)
    n = each.number_density
    np.testing.assert_allclose(
        one["column:c_pe:mean"][0], (n * each["column:c_pe:mean"]).sum("frame") / n.sum("frame"), rtol=1e-9
    )


def test_smoothed_virial_of_a_dump():
    """Per-atom virials in a dump, as LAMMPS's compute stress/atom writes them, make the smoothed virial."""
    f = argon("tilted", seed=2)
    atoms = atc.fields([f], BruteLJ(), quantities=["virial_stress_per_atom_potential"])
    s = atoms.virial_stress_per_atom_potential[0].values
    columns = {
        f"c_st[{k + 1}]": s[:, i, j] for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
    }
    f = f.replace(extra=columns)
    unit = atoms.virial_stress_per_atom_potential.attrs["units"]
    names = ["smoothed_virial_stress_potential", *(f"column:{c}" for c in columns)]
    ds = atc.fields([f], BruteLJ(), KERNEL, atc.Grid.slab("z", 9), names, column_units=dict.fromkeys(columns, unit))
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        name = f"column:c_st[{k + 1}]"
        want = ds.smoothed_virial_stress_potential[0, :, i, j].values
        np.testing.assert_allclose(ds[name][0], want, atol=1e-11 * np.abs(want).max())
        assert ds[name].attrs["units"] == ds.smoothed_virial_stress_potential.attrs["units"]


def test_what_is_wrong_is_said():
    f = frame(words=np.array(["a"] * len(frame())), bad=np.where(np.arange(len(frame())) == 3, np.nan, 1.0))
    grid = atc.Grid.points([[1.0, 2.0, 3.0]])
    for name, words in (
        ("column:c_ke", "no column 'c_ke' for column:c_ke; it has bad, c_pe"),
        ("column:v", r"has 2 components: ask for one, column:v\[1\]"),
        ("column:v[3]", "no column"),
        ("column:words", "words, not numbers"),
        ("column:bad", "atom 4 is nan"),
        ("column:c_pe:median", "expected column:c_pe:density or"),
        ("column:", "expected the name of a column"),
        ("collumn:c_pe", "unknown quantity"),
    ):
        with pytest.raises(AtcError, match=words) as e:
            atc.fields([f], None, KERNEL, grid, [name])
        assert "\n" not in str(e.value)
    with pytest.raises(AtcError, match="masses are missing but column:c_pe:mass_mean"):
        atc.fields([f.replace(masses=None)], None, KERNEL, grid, ["column:c_pe:mass_mean"])
    assert np.isfinite(atc.fields([f.replace(masses=None)], None, KERNEL, grid, ["column:c_pe", "column:v[2]"])["column:v[2]"]).all()  # fmt: skip


def test_scene_to_file(tmp_path):
    f = frame()
    x = f.positions
    rows = "".join(
        f"{k + 1} 1 {x[k, 0]!r} {x[k, 1]!r} {x[k, 2]!r} {f.extra['c_pe'][k]!r} {f.extra['c_st[1]'][k]!r}\n".replace(
            "np.float64(", ""
        ).replace(")", "")
        for k in range(len(f))
    )
    (tmp_path / "run.dump").write_text(
        f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{len(f)}\nITEM: BOX BOUNDS pp pp pp\n" + "-30 70\n" * 3
        + "ITEM: ATOMS id type x y z c_pe c_st[1]\n" + rows
    )  # fmt: skip
    (tmp_path / "scene.toml").write_text(
        '[trajectory]\nfile = "run.dump"\nunits = "metal"\n[kernel]\nname = "quartic"\nradius = 6.0\n'
        '[grid]\nkind = "points"\npoints = [[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]]\n[fields]\n'
        'quantities = ["column:c_pe", "column:c_st[1]"]\n'
        'column_units = { c_pe = "eV", "c_st[1]" = "bar*angstrom^3" }\n'
    )
    assert "c_pe" in str(Scene.load(tmp_path / "scene.toml").plan())
    for name in ("out.zarr", "out.nc"):
        scene = Scene.load(tmp_path / "scene.toml")
        scene.write(tmp_path / name)
        ds = load(tmp_path / name)
        assert ds["column:c_pe"].attrs["units"] == "eV/angstrom^3" and ds["column:c_st[1]"].attrs["units"] == "bar"
        d = x - np.array([5.0, 6.0, 7.0])
        want = KERNEL.phi(d) @ f.extra["c_pe"]
        assert float(ds["column:c_pe"][0, 1]) == pytest.approx(want, rel=1e-9)
