"""atc inside xarray and MDAnalysis: the same numbers, under the names that are used there."""

import warnings

import numpy as np
import pytest

import atc
from atc.errors import AtcError
from atc.pictures.components import component


def crystal(frames=3, seed=0):
    """Argon in MDAnalysis's units, a shaken crystal of a few frames, and its Universe."""
    import MDAnalysis

    rng = np.random.default_rng(seed)
    s = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3) * 3.8
    x = s + 0.15 * rng.standard_normal((frames, len(s), 3))
    u = MDAnalysis.Universe.empty(len(s), trajectory=True)
    u.add_TopologyAttr("types", ["1"] * len(s))
    u.add_TopologyAttr("masses", [39.948] * len(s))
    v = rng.standard_normal(x.shape)
    u.load_new(x, dimensions=np.tile([15.2, 15.2, 15.2, 90, 90, 90], (frames, 1)), velocities=v, dt=2.0)
    return u


@pytest.fixture(scope="module")
def parts():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        u = crystal()
        pot = atc.potential("units real\npair_style lj/cut 7.0\npair_coeff * * 0.238 3.405")
        kern, grid = atc.kernel("lucy", radius=4.0), atc.Grid.regular(shape=(3, 3, 3))
        ds = atc.fields(atc.read(u), pot, kern, grid, ["stress", "density", "virial_stress"])
    return u, pot, kern, grid, ds


@pytest.mark.parametrize("name", ["vonmises", "hydrostatic", "pressure"])
def test_scalars_of_a_dataset_and_of_a_field(parts, name):
    ds = parts[-1]
    here = getattr(ds.atc, name)()
    np.testing.assert_array_equal(here.values, component(ds.stress.values, name))
    np.testing.assert_array_equal(getattr(ds.stress.atc, name)().values, here.values)
    assert here.attrs["units"] == ds.stress.attrs["units"]
    assert not {"i", "j"} & set(here.dims) and set(here.dims) | {"i", "j"} == set(ds.stress.dims)


def test_principal_values_make_the_invariants(parts):
    s = parts[-1].stress
    p = s.atc.principal()
    assert p.dims[-1] == "principal" and (np.diff(p.values, axis=-1) <= 0).all()
    size = np.abs(p.values).max()
    np.testing.assert_allclose(p.sum("principal"), np.einsum("...ii", s.values), atol=1e-13 * size)
    np.testing.assert_allclose((p**2).sum("principal"), (s.values**2).sum((-1, -2)), atol=1e-13 * size**2)


def test_a_transposed_field_is_the_same(parts):
    s = parts[-1].stress
    turned = s.transpose("i", "j", ...)
    np.testing.assert_array_equal(turned.atc.vonmises().transpose(*s.dims[:-2]), s.atc.vonmises())


def test_two_dimensions_have_two_principal_values(parts):
    s = parts[-1].stress.copy()
    s.attrs["dimension"] = 2
    assert s.atc.principal().sizes["principal"] == 2
    np.testing.assert_allclose(s.atc.hydrostatic(), (s[..., 0, 0] + s[..., 1, 1] + s[..., 2, 2]) / 2)


def test_what_a_field_does_not_have_is_named(parts):
    ds = parts[-1]
    with pytest.raises(AtcError, match="density: it is a scalar"):
        ds.density.atc.vonmises()
    with pytest.raises(AtcError, match="did you mean 'vonmises'"):
        ds.stress.atc.component("vonmise")
    with pytest.raises(AtcError, match="one field"):
        ds.stress.atc.vonmises("density")


def test_pictures_and_the_comparison_from_a_dataset(parts):
    ds = parts[-1]
    assert ds.atc.plot_slice("stress", "z=0.5", component="xx").axes
    assert "virial" in str(ds.atc.compare()).lower()


@pytest.mark.parametrize("which", [{}, {"start": 1}, {"stop": -1, "step": 2}, {"frames": [2, 0]}])
def test_an_analysis_of_mdanalysis(parts, which):
    from MDAnalysis.analysis.base import AnalysisBase

    from atc.analysis import Fields

    u, pot, kern, grid, ds = parts
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = Fields(u.atoms, pot, kern, grid, ["stress", "density"]).run(**which)
    numbers = np.arange(3)[which["frames"] if "frames" in which else slice(*map(which.get, ("start", "stop", "step")))]
    assert isinstance(found, AnalysisBase) and found.n_frames == len(numbers)
    np.testing.assert_array_equal(found.frames, numbers)
    np.testing.assert_array_equal(found.times, 2.0 * numbers)
    np.testing.assert_array_equal(found.results.stress, ds.stress.values[numbers])
    assert found.results.units["stress"] == ds.stress.attrs["units"]


def test_backends(parts):
    from atc.analysis import Fields

    u, pot, kern, grid, ds = parts
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        both = Fields(u.atoms, pot, kern, grid, verbose=True).run(backend="multiprocessing", n_workers=2)
    # Another number of threads within a frame: sums in another order. Where few atoms are in reach the kinetic part
    # grows by 1/(1 - 1/N), and what is rounded with it.
    for name, close in (("stress_potential", 1e-14), ("stress", 1e-12)):
        want = ds[name].values
        np.testing.assert_allclose(both.results[name], want, rtol=0, atol=close * abs(want).max())
    with pytest.raises(AtcError, match="cluster"):
        Fields(u.atoms, pot, kern, grid).run(backend="dask")
    with pytest.raises(AtcError, match="expected one of serial"):
        Fields(u.atoms, pot, kern, grid).run(backend="cuda")


def test_what_pictures_of_xarray_say(parts):
    """Titles name the component and the frame, not the cell; the accessor's picture has the component's symbol."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    ds = parts[-1]
    one = ds.stress.sel(i="x", j="y").isel(frame=0, z=0)
    try:
        plane = one.plot()
        assert plane.axes.get_title().startswith("i = x, j = y, frame = 0") and "cell" not in plane.axes.get_title()
        plt.close("all")
        plane = one.atc.plot()
        (bar,) = [a for a in plane.axes.figure.axes if a is not plane.axes]
        assert bar.get_ylabel() == "$\\sigma_{xy}$ [kJ/(mol·Å$^{3}$)]"
    finally:
        plt.close("all")
