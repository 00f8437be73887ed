"""Profiles against time, and means over axes of the grid."""

import numpy as np
import pytest
from frames import argon
from test_plotting import linear, mesh_of, output

import atc
from atc.errors import AtcError
from atc.pictures import plotting
from atc.pictures.geometry import over_axes
from atc.units import units


@pytest.fixture(scope="module")
def waves():
    """Velocity of slabs, a wave that travels: v_z = sin(2π(z/L − t/T)); the cell grows."""
    frames = []
    for k in range(12):
        cell = atc.Cell([9.0, 10.0, 11.0 * (1 + 0.02 * k)], [0.0, 0.0, 2.0])
        f = argon(cell, n=(4, 4, 8), jitter=0.05, temperature=0.0)
        s = cell.fractional(f.positions)[:, 2]
        v = np.zeros_like(f.positions)
        v[:, 2] = np.sin(2 * np.pi * (s - k / 12))
        frames.append(f.replace(velocities=v, time=units("metal").to_internal("time", 0.5 * k), step=100 * k))
    with pytest.warns(atc.AtcWarning):
        return atc.fields(frames, None, atc.kernel("quartic", 3.0), atc.Grid.slab("z", 20), ["velocity"], threads=1)


def test_a_travelling_wave(waves):
    fig = plotting.plot(waves, "velocity", component="z,magnitude", frame="all")
    assert len([a for a in fig.axes if a.get_xlabel()]) == 2
    ax = fig.axes[0]
    corners, values, mesh = mesh_of(ax)
    assert values.shape == (12, 20)
    np.testing.assert_allclose(values, waves.velocity.sel(i="z"))
    assert (mesh.get_cmap().name, fig.axes[1].collections[0].get_cmap().name) == ("RdBu_r", "viridis")
    assert ax.get_xlabel() == "z (Å)" and ax.get_ylabel() == "t (ps)"
    t, z = corners[..., 1], corners[..., 0]
    np.testing.assert_allclose(t[:, 0], np.arange(13) * 0.5 - 0.25)
    # the cell grows, and the bins with it: edges between two frames are between theirs
    np.testing.assert_allclose(z[:, 0], 2.0, atol=1e-9)
    heights = 11.0 * (1 + 0.02 * np.arange(12))
    np.testing.assert_allclose(z[1:-1, -1] - 2.0, 0.5 * (heights[1:] + heights[:-1]))
    assert "12 frames" in fig._suptitle.get_text() and "quartic" in fig._suptitle.get_text()


def test_without_times(waves, tmp_path):
    steps = waves.assign_coords(time=("frame", np.full(12, np.nan)))
    assert plotting.plot(steps, frame="all").axes[0].get_ylabel() == "step"
    nothing = steps.assign_coords(step=("frame", np.full(12, -1)))
    assert plotting.plot(nothing, frame="all").axes[0].get_ylabel() == "frame"
    waves.to_netcdf(tmp_path / "a.nc")
    assert plotting.plot_file(tmp_path / "a.nc", frame="all").name == "a-t-velocity.png"


def test_means_over_axes():
    ds, bound = output(atc.Grid.regular(shape=(4, 6, 5)), stress=("bar", linear), temperature=("K", half))
    x = bound.points_gc.reshape(4, 6, 5, 3)
    _, values, _ = mesh_of(plotting.plot(ds, "stress", component="xx", frame="mean", mean="y").axes[0])
    np.testing.assert_allclose(values, x[:, 0, :, 0] + 5)
    profile = plotting.plot(ds, "stress", component="xx", frame=0, mean="y,z").axes[0].lines[0]
    np.testing.assert_allclose(profile.get_xdata(), x[:, 0, 0, 0])
    # temperature: of where it is known; stress: nothing counts as nothing
    mean = over_axes(ds, "x,y")
    np.testing.assert_allclose(mean.temperature, 300.0)
    gaps = ds.assign(stress=ds.stress.where(ds.x < 4))
    np.testing.assert_allclose(over_axes(gaps, "x").stress, gaps.stress.fillna(0).mean("x"))
    _, values, _ = mesh_of(plotting.plot(ds, "stress", component="xx", frame="all", mean="y,z").axes[0])
    np.testing.assert_allclose(values, over_axes(ds, "y,z").stress[..., 0, 0])
    # an average stays one
    average = ds.isel(frame=[0]).assign(frames_averaged=("frame", [7]))
    assert "average of 7 frames" in plotting.plot(average, "stress", mean="y,z")._suptitle.get_text()
    # the title of a profile against time says what the means are over
    assert "mean over y,z" in plotting.plot(ds, "stress", frame="all", mean="y,z")._suptitle.get_text()
    for axes in ("w", "x,y,z", ""):
        with pytest.raises(AtcError, match="some, not all"):
            plotting.plot(ds, "stress", mean=axes)


def test_titles_keep_values_whole():
    """A value does not part from its name or its unit where a title is broken, and one frame is no frames."""
    ds, _ = output(atc.Grid.regular(shape=(2, 2, 2)), stress=("bar", linear))
    for digits in range(1, 12):
        named = ds.assign(stress=ds.stress.assign_attrs(long_name="s" * 3 * digits))
        lines = plotting.plot(named, "stress", component="xx", frame=1)._suptitle.get_text().split("\n")
        assert any("t = " in line and "ps" in line.partition("t = ")[2] for line in lines), lines
    one = ds.isel(frame=[0]).assign(frames_averaged=("frame", [1]))
    assert plotting.plot(one, "stress")._suptitle.get_text().endswith("average of 1 frame")


def test_an_axis_of_one_point_keeps_its_name():
    """A grid of one layer has no direction along z to go by; its axis is z all the same, over its one coordinate."""
    ds, bound = output(atc.Grid.regular(shape=(4, 6, 1)), stress=("bar", linear))
    z = bound.points_gc[0, 2]
    ax = plotting.plot(ds, "stress", component="xx", frame=0, mean="y").axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (Å)", "z (Å)")
    assert np.mean(ax.get_ylim()) == pytest.approx(z)
    ax = plotting.plot(ds, "stress", component="xx", frame="all", mean="x,y").axes[0]
    assert ax.get_xlabel() == "z (Å)" and np.mean(ax.get_xlim()) == pytest.approx(z)


def half(x, k):
    return np.where(x[..., 0] < 4, 300.0, np.nan)


def test_refusals(waves):
    ds, _ = output(atc.Grid.regular(shape=(4, 6, 5)), stress=("bar", linear))
    for how, words in (
        ({}, "--mean x,y"),
        ({"mean": "x"}, "--mean x,y"),
        ({"mean": "x,y", "slice": "z=0.5"}, "no slices"),
    ):
        with pytest.raises(AtcError, match=words):
            plotting.plot(ds, "stress", frame="all", **how)
    with pytest.raises(AtcError, match="one frame only"):
        plotting.plot(waves.isel(frame=[0]), frame="all")
    with pytest.raises(AtcError, match="mean or all"):
        plotting.plot(waves, frame="last")
