"""Pictures: what is drawn is where it should be, in the right colours, with the right labels."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.errors import AtcError
from atc.pictures import components, plotting
from atc.pictures.geometry import unit_text

xr = pytest.importorskip("xarray")


def random_tensors(shape, seed=0):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(*shape, 3, 3))
    return a + np.swapaxes(a, -1, -2)


# ---- components


def test_invariants_against_principal_values():
    s = random_tensors((50,))
    p = np.array([np.sort(np.linalg.eigvals(t).real)[::-1] for t in s])  # eigvals, not the eigvalsh of the program
    von_mises = np.sqrt(0.5 * ((p[:, 0] - p[:, 1]) ** 2 + (p[:, 1] - p[:, 2]) ** 2 + (p[:, 2] - p[:, 0]) ** 2))
    # 1e-10: eigenvalues of 3 x 3 matrices of order 1 to rounding, times a safety factor of 1e4
    for name, want in {
        "vonmises": von_mises,
        "hydrostatic": p.mean(1),
        "pressure": -p.mean(1),
        "max_shear": (p[:, 0] - p[:, 2]) / 2,
    }.items():
        np.testing.assert_allclose(components.component(s, name), want, atol=1e-10)
    for k in range(3):
        np.testing.assert_allclose(components.component(s, f"principal{k + 1}"), p[:, k], atol=1e-10)


def test_uniaxial_and_pure_shear():
    uniaxial = np.diag([3.0, 0, 0])
    assert components.component(uniaxial, "vonmises") == pytest.approx(3.0)
    assert components.component(uniaxial, "max_shear") == pytest.approx(1.5)
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 2.0
    assert components.component(shear, "vonmises") == pytest.approx(2.0 * np.sqrt(3))
    assert components.component(shear, "max_shear") == pytest.approx(2.0)


def test_components_by_name_and_undefined_points():
    s = np.arange(9.0).reshape(3, 3)
    assert [float(components.component(s, n)) for n in ("xx", "xy", "yx", "zz")] == [0, 1, 3, 8]
    v = np.array([[3.0, 0.0, 4.0]])
    assert components.component(v, "magnitude")[0] == 5.0
    assert components.component(v, "z")[0] == 4.0
    undefined = np.full((2, 3, 3), np.nan)
    undefined[1] = np.eye(3)
    for name in components.TENSOR_SCALARS:
        got = components.component(undefined, name)
        assert np.isnan(got[0]) and np.isfinite(got[1])
    with pytest.raises(AtcError, match="did you mean 'vonmises'"):
        components.component(s, "vonmisses")


# ---- units as text


@pytest.mark.parametrize(
    "unit, drawn",
    [
        ("angstrom", "Å"),
        ("g/cm^3", "g/cm$^{3}$"),
        ("eV/angstrom^3", "eV/Å$^{3}$"),
        ("bar", "bar"),
        ("1", ""),
        ("pg/(um*us^2)", "pg/(um·us$^{2}$)"),
    ],
)
def test_units(unit, drawn):
    assert unit_text(unit) == drawn


# ---- pictures: what matplotlib is told to draw, for fields that grids of the program carry


ORTHOGONAL = [[6.0, 0, 0], [0, 8.0, 0], [0, 0, 10.0]]
TILTED = [[6.0, 0, 0], [2.0, 8.0, 0], [1.0, 3.0, 10.0]]


def output(grid, cell=ORTHOGONAL, origin=(1.0, -2.0, 3.0), frames=2, **fields):
    """An output on a grid of atc: coordinates as `atc.fields` writes them, values given as functions of position and
    frame."""
    from atc.frame import Cell
    from atc.units import units

    u = units("metal")
    c = Cell(cell, origin)
    x_nc = np.random.default_rng(0).random((40, 3)) @ c.vectors + c.origin
    bound = grid.bind(u, c, x_nc)
    x = bound.points_gc.reshape(*bound.shape, 3)
    data = {}
    for name, (unit, f) in fields.items():
        values = np.stack([f(x, k) for k in range(frames)])
        data[name] = (("frame", *bound.dims, *("i", "j")[: values.ndim - x.ndim]), values, {"units": unit})
    coords = {n: v for n, v in bound.coords(u).items()}
    coords |= {
        "frame": np.arange(frames),
        "i": list("xyz"),
        "j": list("xyz"),
        "cell": (("frame", "edge", "i"), np.stack([c.vectors] * frames)),
    }
    coords["time"] = ("frame", 0.5 * np.arange(frames), {"units": "ps"})
    attrs = {
        "kernel": "quartic, radius 5",
        "radius": 5.0,
        "radius_units": "angstrom",
        "grid": grid.describe(),
        "periodic": "ppp",
    }
    return xr.Dataset(data, coords, attrs), bound


def linear(x, k):
    """A stress whose xx is x + 10 k, xy is y, yy is −z, zz is 0."""
    s = np.zeros((*x.shape[:-1], 3, 3))
    s[..., 0, 0] = x[..., 0] + 10 * k
    s[..., 0, 1] = s[..., 1, 0] = x[..., 1]
    s[..., 1, 1] = -x[..., 2]
    return s


def mesh_of(ax):
    """(n+1, m+1, 2) corners and (n, m) colours of the map in these axes."""
    mesh = ax.collections[0]
    return mesh.get_coordinates(), mesh.get_array().reshape(np.array(mesh.get_coordinates().shape[:2]) - 1), mesh


def centres(corners):
    return 0.25 * (corners[1:, 1:] + corners[:-1, 1:] + corners[1:, :-1] + corners[:-1, :-1])


@pytest.mark.parametrize("cell", [ORTHOGONAL, TILTED])
@pytest.mark.parametrize("slice, k, letters", [("z=0.5", 2, "xy"), ("y=0.1", 1, "xz"), ("x=0.9", 0, "yz")])
def test_a_slice_is_drawn_at_its_true_positions(cell, slice, k, letters):
    from atc import Grid

    ds, bound = output(Grid.regular(shape=(4, 6, 5)), cell, stress=("bar", linear))
    fig = plotting.plot(ds, "stress", component="xx", slice=slice)
    corners, values, _ = mesh_of(fig.axes[0])
    index = {2: 2, 1: 0, 0: 3}[k]  # of 5, 6, 4 points the ones at fractions 0.5, 1/12, 0.875
    x = np.take(bound.points_gc.reshape(4, 6, 5, 3), index, axis=k)
    np.testing.assert_allclose(values, x[..., 0] + 10, rtol=1e-12)  # frame -1 is the second
    u, v = ("xyz".index(c) for c in letters)
    ax = fig.axes[0]
    if ax.get_xlabel() == f"{letters[0]} (Å)":  # a plane normal to a Cartesian axis: the coordinates themselves
        assert ax.get_ylabel() == f"{letters[1]} (Å)"
        np.testing.assert_allclose(centres(corners), x[..., [u, v]], atol=1e-12)
    else:  # an oblique plane: distances within it are true
        assert cell is TILTED and "along" in ax.get_xlabel()
        a, b = centres(corners).reshape(-1, 2), x.reshape(-1, 3)
        distance = [np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (a, b)]
        np.testing.assert_allclose(distance[0], distance[1], atol=1e-12)
    assert ax.get_aspect() == 1.0


def test_colours_of_signed_and_positive_fields():
    from atc import Grid

    ds, _ = output(
        Grid.regular(shape=(4, 6, 5)), stress=("bar", linear), density=("g/cm^3", lambda x, k: 9 + x[..., 1])
    )
    mesh = mesh_of(plotting.plot(ds, "stress", component="yy", frame=0).axes[0])[2]
    assert mesh.norm.vmin == -mesh.norm.vmax == -np.abs(mesh.get_array()).max()
    assert mesh.cmap.name == "RdBu_r"
    for q, c in (("stress", "vonmises"), ("density", None)):
        mesh = mesh_of(plotting.plot(ds, q, component=c, frame=0).axes[0])[2]
        assert (mesh.norm.vmin, mesh.norm.vmax) == (mesh.get_array().min(), mesh.get_array().max())
        assert mesh.cmap.name != "RdBu_r"
    mesh = mesh_of(plotting.plot(ds, "stress", component="xx", limits=(-3, 5)).axes[0])[2]
    assert (mesh.norm.vmin, mesh.norm.vmax) == (-3, 5)
    mesh = mesh_of(plotting.plot(ds, "stress", component="xx", robust=True).axes[0])[2]
    assert mesh.norm.vmax == pytest.approx(np.percentile(np.abs(mesh.get_array().filled()), 98))


def test_rounding_does_not_look_like_a_field():
    """A component that is zero beside large ones keeps a pale map."""
    from atc import Grid

    ds, _ = output(Grid.regular(shape=(3, 3, 3)), stress=("bar", lambda x, k: linear(x, k) + 1e-12 * np.eye(3)))
    axes = [ax for ax in plotting.plot(ds, "stress").axes if "sigma" in ax.get_title()]
    assert [ax.get_title() for ax in axes] == [f"$\\sigma_{{{c}}}$ (bar)" for c in ("xx", "yy", "zz", "xy", "xz", "yz")]
    zz = mesh_of(axes[2])[2]
    assert zz.norm.vmax > 1e3 * np.abs(zz.get_array()).max()


def test_vacuum_is_grey():
    from atc import Grid

    def half(x, k):
        return np.where(x[..., 0] < 4, 300.0, np.nan)

    ds, _ = output(Grid.regular(shape=(4, 4, 4)), temperature=("K", half))
    _, values, mesh = mesh_of(plotting.plot(ds, "temperature").axes[0])
    np.testing.assert_array_equal(np.ma.getmaskarray(values)[:, 0], [False, False, True, True])
    assert mesh.cmap.get_bad()[:3] == pytest.approx([0.82] * 3, abs=0.005)


def test_titles_and_labels():
    from atc import Grid

    ds, _ = output(Grid.regular(shape=(4, 6, 2)), stress=("bar", linear))
    fig = plotting.plot(ds, "stress", component="vonmises", frame=1)
    # 2 points along z, at 1/4 and 3/4 of 10 Å from 3 Å: the thinnest axis is cut at the second
    assert (
        fig._suptitle.get_text().replace("\n", " ")
        == "Stress, quartic kernel, R = 5 Å, z = 10.5 Å, frame 1, t = 0.5 ps"
    )
    assert fig.axes[0].get_title() == r"von Mises $\sigma_{\mathrm{vM}}$ (bar)"
    assert "mean of 2 frames" in plotting.plot(ds, "stress", component="xx", frame="mean")._suptitle.get_text()


def test_mean_over_frames():
    from atc import Grid

    ds, bound = output(Grid.regular(shape=(4, 6, 5)), stress=("bar", linear))
    _, values, _ = mesh_of(plotting.plot(ds, "stress", component="xx", frame="mean", slice="z=0").axes[0])
    np.testing.assert_allclose(values, bound.points_gc.reshape(4, 6, 5, 3)[:, :, 0, 0] + 5)


def test_planes():
    from atc import Grid

    ds, bound = output(Grid.plane(axis="y", position=2.0, shape=(4, 5)), stress=("bar", linear))
    fig = plotting.plot(ds, "stress", component="yy")
    corners, values, _ = mesh_of(fig.axes[0])
    x = bound.points_gc.reshape(4, 5, 3)
    np.testing.assert_allclose(centres(corners), x[..., [0, 2]], atol=1e-12)
    np.testing.assert_allclose(values, -x[..., 2])
    ds, bound = output(Grid.plane(u=[6, 0, 6], v=[0, 8, 0], shape=(4, 5)), stress=("bar", linear))
    fig = plotting.plot(ds, "stress", component="xy")
    corners, values, _ = mesh_of(fig.axes[0])
    np.testing.assert_allclose(np.diff(centres(corners)[:, 0, 0]), np.sqrt(72) / 4)
    np.testing.assert_allclose(values, bound.points_gc.reshape(4, 5, 3)[..., 1])
    with pytest.raises(AtcError, match="nothing to slice"):
        plotting.plot(ds, "stress", slice="z=0.5")


def test_profiles_with_their_standard_errors():
    from atc import Grid

    ds, bound = output(Grid.slab("z", 8), frames=1, stress=("bar", linear), temperature=("K", lambda x, k: x[..., 2]))
    ds["stress_stderr"] = xr.full_like(ds["stress"], 0.5)
    ax = plotting.plot(ds, "stress", component="yy").axes[0]
    z = 3 + (np.arange(8) + 0.5) / 8 * 10
    np.testing.assert_allclose(ax.lines[0].get_xdata(), z)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), -z)
    band = ax.collections[0].get_paths()[0].vertices
    for s in z:
        np.testing.assert_allclose(np.unique(band[np.isclose(band[:, 0], s)][:, 1].round(9)), [-s - 0.5, -s + 0.5])
    assert ax.get_xlabel() == "z (Å)"
    assert (
        not plotting.plot(ds, "stress", component="vonmises").axes[0].collections
    )  # it has no standard error of its own
    several = plotting.plot(ds, "stress,temperature").axes
    assert [a.get_ylabel() for a in several] == [r"von Mises $\sigma_{\mathrm{vM}}$ (bar)", "temperature $T$ (K)"]
    texts = [t.get_text() for t in plotting.plot(ds, "stress", component="yy").axes[0].get_legend().get_texts()]
    assert texts == [r"$\sigma_{yy}$", "± std. error"]


def test_lines():
    from atc import Grid

    ds, bound = output(Grid.line([0, 0, 0], [3, 4, 0], 6), stress=("bar", linear))
    ax = plotting.plot(ds, "stress", component="xy").axes[0]
    np.testing.assert_allclose(ax.lines[0].get_xdata(), np.arange(6.0), atol=1e-12)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), bound.points_gc[:, 1])
    assert ax.get_xlabel() == "distance along the line (Å)"


@pytest.mark.parametrize("kind", ["points", "atoms"])
def test_scattered_points(kind):
    from atc import Grid

    grid = Grid.points(np.random.default_rng(1).random((30, 3)) * 5) if kind == "points" else Grid.atoms()
    ds, bound = output(grid, stress=("bar", lambda x, k: np.where(x[..., :1, None] > 4, np.nan, linear(x, k))))
    fig = plotting.plot(ds, "stress", component="xy")
    grey, drawn = fig.axes[0].collections[:2]
    x = bound.points_gc
    order = np.argsort(-np.ptp(x, axis=0), kind="stable")[:2]
    u, v = sorted(order)
    good = x[:, 0] <= 4
    shown = np.asarray(drawn.get_offsets())
    assert len(shown) == good.sum()
    assert len(grey.get_offsets()) == (~good).sum()
    # every point has the colour of its own value
    for p, value in zip(shown, drawn.get_array()):
        n = np.argmin(np.abs(x[:, [u, v]] - p).sum(1))
        assert value == pytest.approx(x[n, 1])


def test_overlaid_atoms_are_those_near_the_plane():
    from atc import Grid

    ds, bound = output(Grid.regular(shape=(4, 4, 4)), stress=("bar", linear))
    atoms = np.array([[2.0, 0.0, 3.5], [3.0, 1.0, 5.4], [4.0, 2.0, 9.0]])  # the first layer reaches from z = 3 to 5.5
    ax = plotting.plot(ds, "stress", component="xx", slice="z=0", atoms=atoms).axes[0]
    np.testing.assert_allclose(np.asarray(ax.collections[1].get_offsets()), atoms[:2, :2])


def test_a_single_point_along_an_axis():
    from atc import Grid

    for shape in ((1, 4, 4), (1, 1, 4), (1, 1, 1)):
        ds, _ = output(Grid.regular(shape=shape), stress=("bar", linear))
        plotting.plot(ds, "stress", component="xx")


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_equal_pictures_are_equal_files(tmp_path, suffix):
    from atc import Grid

    ds, _ = output(Grid.regular(shape=(4, 4, 4)), stress=("bar", linear))
    made = []
    for name in ("a", "b"):
        path = plotting.save(plotting.plot(ds, "stress", component="xx"), tmp_path / f"{name}.{suffix}")
        made.append(path.read_bytes())
    assert made[0] == made[1]
    assert len(list(tmp_path.iterdir())) == 2


def test_an_output_of_advect_has_its_picture_already():
    ds = xr.Dataset({"u": (("time", "x"), np.zeros((2, 4)))}, attrs={"equation": "u_t"})
    with pytest.raises(AtcError, match="atc advect, whose picture was written beside it"):
        plotting.plot(ds)


def test_names_as_in_papers():
    from atc.pictures.symbols import label

    assert label("stress", "xy", "GPa") == r"$\sigma_{xy}$ (GPa)"
    assert label("heat_flux", "z", "W/m$^{2}$") == "$q_{z}$ (W/m$^{2}$)"
    assert label("stress_kinetic", "xx", "bar") == r"$\sigma^{K}_{xx}$ (bar)"
    assert label("velocity", "magnitude", "m/s") == "velocity $|v|$ (m/s)"
    assert label("stress", "principal1", "bar") == r"first principal value $\sigma_{1}$ (bar)"
    assert label("column:c_pe", None, "eV") == "column:c pe (eV)" and label("mask", None, "") == "mask"


def test_singular_corners_do_not_take_all_colours():
    from atc import Grid

    ds, _ = output(Grid.plane(axis="z", position=2.0, shape=(20, 20)), stress=("bar", linear))
    ds["stress"][:, 0, 0] *= 1e4
    fig = plotting.plot(ds, "stress", component="xx")
    mesh = mesh_of(fig.axes[0])[2]
    usual = np.percentile(np.abs(mesh.get_array().filled()), 98)
    (bar,) = fig.axes[0].child_axes
    assert mesh.norm.vmax == pytest.approx(usual) and bar.get_position().height > 0
    assert mesh_of(plotting.plot(ds, "stress", component="xx", robust=False).axes[0])[2].norm.vmax > 100 * usual


def test_vectors_and_principal_stresses_over_a_map():
    from atc import Grid

    def shear(x, k):
        v = np.zeros(x.shape)
        v[..., 0] = x[..., 1]
        return v

    def uniaxial(x, k):
        s = np.zeros((*x.shape[:-1], 3, 3))
        s[..., 0, 0], s[..., 1, 1] = 100.0, -50.0
        return s

    ds, bound = output(Grid.regular(shape=(8, 8, 2)), frames=1, velocity=("m/s", shear), stress=("bar", uniaxial))
    fig = plotting.plot(ds, "stress", component="vonmises", arrows="velocity", principal="stress")
    quiver = next(c for c in fig.axes[0].collections if type(c).__name__ == "Quiver")
    assert np.allclose(quiver.V, 0.0) and len(quiver.U) == 64
    assert np.allclose(quiver.U / np.abs(quiver.U).max(), quiver.XY[:, 1] / np.abs(quiver.XY[:, 1]).max(), atol=0.06)
    red, blue = (c for c in fig.axes[0].collections if type(c).__name__ == "LineCollection")
    for lines, axis in ((red, 0), (blue, 1)):  # tension along x, compression along y
        d = np.array([s[1] - s[0] for s in lines.get_segments()])
        assert len(d) == 64 and np.allclose(d[:, 1 - axis], 0.0)
    length = [np.abs(np.diff(c.get_segments()[0], axis=0)).max() for c in (red, blue)]
    assert length[1] / length[0] == pytest.approx(0.5)
    assert "red tension" in fig._supxlabel.get_text() and "arrows: $v$" in fig._supxlabel.get_text().replace("\n", " ")
    assert plotting.plot(ds, "velocity", component="magnitude", streamlines="velocity").axes[0].patches
    for more, said in (({"arrows": "stress"}, "is no vector field"), ({"principal": "velocity"}, "is no tensor field"),
                       ({"arrows": "nothing"}, "it holds velocity")):  # fmt: skip
        with pytest.raises(AtcError, match=said):
            plotting.plot(ds, "stress", component="xx", **more)
    slab, _ = output(Grid.slab("z", 8), frames=1, velocity=("m/s", shear))
    with pytest.raises(AtcError, match="not over profiles"):
        plotting.plot(slab, "velocity", arrows="velocity")


def test_vector_graphics(tmp_path):
    from atc import Grid

    ds, _ = output(Grid.regular(shape=(6, 6, 2)), frames=1, stress=("bar", linear))
    for suffix, head in ((".pdf", b"%PDF"), (".svg", b"<?xml"), (".png", b"\x89PNG")):
        from atc.pictures.drawing import save

        assert save(plotting.plot(ds, "stress", component="xx"), tmp_path / f"a{suffix}").read_bytes().startswith(head)


def test_movies_have_one_scale(tmp_path, monkeypatch):
    from PIL import Image, ImageSequence

    from atc.pictures.movies import movie_path
    from atc.pictures.plotting import movie_file

    traj = [argon(seed=k, temperature=20.0 * (1 + 3 * k)).replace(step=k, time=float(k)) for k in range(3)]
    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    for grid, more in (
        (atc.Grid.regular(shape=(5, 4, 3)), {"component": "xx", "arrows": "velocity", "principal": "stress"}),
        (atc.Grid.slab("z", 7), {"component": "xx"}),
        (atc.Grid.points(np.random.default_rng(0).random((30, 3)) * 9), {}),
    ):
        ds = atc.fields(traj, pot, atc.kernel("quartic", 5.0), grid, ["stress", "velocity"])
        out = tmp_path / f"{grid.kind}.nc"
        ds.to_netcdf(out)
        path = movie_file(out, tmp_path / f"{grid.kind}.gif", "stress", rate=10, **more)
        with Image.open(path) as film:
            pages = [np.asarray(page.convert("RGB")).astype(int) for page in ImageSequence.Iterator(film)]
            assert film.info["duration"] == 100
        assert len(pages) == 3 and len({p.shape for p in pages}) == 1
        assert all(abs(p - pages[0]).max() > 50 for p in pages[1:])
        figs = [plotting.plot(ds, "stress", component="xx", frame=k, one_scale=True) for k in range(3)]
        if grid.kind == "slab":
            assert len({fig.axes[0].get_ylim() for fig in figs}) == 1
        else:
            scales = {fig.axes[0].collections[-1 if grid.kind == "points" else 0].get_clim() for fig in figs}
            assert len(scales) == 1
            top = float(abs(ds.stress.sel(i="x", j="x")).max())
            (scale,) = scales
            if grid.kind == "points":
                assert scale == pytest.approx((-top, top))
    one = ds.isel(frame=[0])
    one.to_netcdf(tmp_path / "one.nc")
    with pytest.raises(AtcError, match="one frame, which makes no movie"):
        movie_file(tmp_path / "one.nc", tmp_path / "one.gif")
    with pytest.raises(AtcError, match=r"end in \.gif or \.mp4"):
        movie_path(tmp_path / "a.avi")
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(AtcError, match="needs ffmpeg"):
        movie_path(tmp_path / "a.mp4")


def test_nothing_is_cut_off():
    """Wide, flat and many-panelled pictures with long titles: all labels are within the figure once it is fitted."""
    from atc.pictures.drawing import fitted

    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    f = argon(temperature=30.0)
    for shape in ((12, 6, 3), (6, 12, 3), (12, 2, 3)):
        L = 10.0 * np.array(shape) / max(shape)
        grid = atc.Grid.plane([0, 0, 2], [L[0], 0, 0], [0, L[1], 0], shape=shape[:2])
        ds = atc.fields([f], pot, atc.kernel("quartic", 5.0), grid, ["stress", "density"])
        for options in ({"quantity": "density"}, {"quantity": "stress"}, {"quantity": "stress", "component": "xx"}):
            fig = fitted(plotting.plot(ds, **options))
            box, size = fig.get_tightbbox(), fig.get_size_inches()
            assert (box.min > -0.03).all() and (box.max < size + 0.03).all(), (shape, options)
