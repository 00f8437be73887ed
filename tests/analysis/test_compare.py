"""Hardy against virial: the numbers of the table, from fields whose differences are known in closed form."""

import json

import numpy as np
import pytest

from atc.analysis.compare import ACCURACY, PROFILES, compare
from atc.analysis.comparison import POINTWISE, side_by_side
from atc.errors import AtcError

xr = pytest.importorskip("xarray")
CELL = np.array([[8.0, 0, 0], [2.0, 10.0, 0], [0, 1.0, 12.0]])


def output(shape=(4, 5, 6), frames=1, hardy=None, smoothed=None, virial=None, cell=CELL, **attrs):
    """An output of atc.fields on a grid of cell centres, made by hand. Fields are functions of fractional coordinates
    (…, 3) and the frame."""
    s = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n for n in shape], indexing="ij"), -1)
    x = s @ cell
    dims = ("x", "y", "z")
    data = {}
    for name, f in (("stress", hardy), ("smoothed_virial_stress", smoothed)):
        if f is not None:
            data[name] = (
                ("frame", *dims, "i", "j"),
                np.stack([f(s, k) for k in range(frames)]),
                {"units": "bar", "measured_error": 2e-9},
            )
    if virial is not None:
        data["virial_stress"] = (("frame", "i", "j"), np.stack([virial(k) for k in range(frames)]), {"units": "bar"})
    coords = {f"position_{c}": (dims, x[..., k], {"units": "angstrom"}) for k, c in enumerate("xyz")}
    coords |= {
        "cell": (("frame", "edge", "i"), np.stack([cell] * frames)),
        "i": list("xyz"),
        "j": list("xyz"),
        "frame": np.arange(frames),
    }
    return xr.Dataset(
        data,
        coords,
        {"kernel": "quartic, radius 4", "radius": 4.0, "radius_units": "angstrom", "periodic": "ppp", **attrs},
    )


A = np.array([[1.0, 0.5, 0], [0.5, 2.0, 0.25], [0, 0.25, -4.0]])


def wave(s, axis=0):
    """cos 2πs along one axis: mean 0 and mean square 1/2 on equally spaced points."""
    return np.cos(2 * np.pi * s[..., axis])[..., None, None]


def test_box_average_and_pointwise_difference_in_closed_form():
    ds = output(
        hardy=lambda s, k: A + 3 * wave(s) * np.eye(3),
        smoothed=lambda s, k: A + 1 * wave(s) * np.eye(3),
        virial=lambda k: A + 0.01 * np.eye(3),
    )
    r = compare(ds)
    # rounding: 1e-12 of numbers of order 1
    for c, want in {"xx": 1.0, "yy": 2.0, "zz": -4.0, "xy": 0.5, "xz": 0.0, "yz": 0.25, "hydrostatic": -1 / 3}.items():
        assert r.value("box average", c, "hardy") == pytest.approx(want, abs=1e-12)
        diagonal = c in ("xx", "yy", "zz", "hydrostatic")
        assert r.value("box average", c) == pytest.approx(-0.01 if diagonal else 0.0, abs=1e-12)
        # the difference is 2 cos on the diagonal; 4 points along x sit at cos = ±1/√2, so rms = max = √2
        assert r.value(POINTWISE, c, "rms") == pytest.approx(np.sqrt(2) if diagonal else 0.0, abs=1e-12)
        assert r.value(POINTWISE, c, "max") == pytest.approx(np.sqrt(2) if diagonal else 0.0, abs=1e-12)
    largest = 4 + 3 / np.sqrt(2)
    assert r.value(POINTWISE, "xx", "relative max") == pytest.approx(np.sqrt(2) / largest, rel=1e-12)
    assert r.value("box average", "xx", "relative") == pytest.approx(0.01 / 3.99, rel=1e-9)
    assert r.value(POINTWISE, "vonmises", "max") == pytest.approx(
        0.0, abs=1e-12
    )  # a hydrostatic difference has no deviator
    assert r.value(ACCURACY, "stress", "measured max") == 2e-9


def test_profiles_average_over_the_other_axes():
    ds = output(
        hardy=lambda s, k: A + 3 * wave(s, 2) * np.eye(3) + wave(s, 0) * A,
        smoothed=lambda s, k: A + 0 * wave(s),
        virial=None,
    )
    r = compare(ds)
    along_z = r.data["profile_z_hardy"].values
    s = (np.arange(6) + 0.5) / 6
    np.testing.assert_allclose(along_z, A + 3 * np.cos(2 * np.pi * s)[:, None, None] * np.eye(3), atol=1e-12)
    # cos² at 6 equally spaced points has mean 1/2
    assert r.value(PROFILES, "along z: hydrostatic", "rms") == pytest.approx(3 / np.sqrt(2), rel=1e-12)
    assert r.value(PROFILES, "along y: any component", "max") == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(
        r.data["profile_z_position"].values[1] - r.data["profile_z_position"].values[0], np.linalg.norm(CELL[2]) / 6
    )


def test_empty_space_counts_as_empty():
    """Hardy's stress is undefined (NaN) in a vacuum; the box average of its sums is not."""

    def half(s, k):
        return np.where(s[..., 0, None, None] < 0.5, 2 * A, np.nan)

    r = compare(
        output(hardy=half, smoothed=lambda s, k: np.where(s[..., 0, None, None] < 0.5, 2 * A, 0.0), virial=lambda k: A)
    )
    for c in ("xx", "yz", "vonmises"):
        assert r.value("box average", c) == pytest.approx(0.0, abs=1e-12)
        assert r.value(POINTWISE, c, "max") == pytest.approx(0.0, abs=1e-12)


def test_frames_average_and_give_a_standard_error():
    rng = np.random.default_rng(3)
    noise = rng.normal(size=64)
    ds = output(
        (2, 2, 2),
        64,
        hardy=lambda s, k: A + 0 * wave(s) + noise[k] * np.eye(3),
        smoothed=lambda s, k: A + 0 * wave(s),
        virial=lambda k: A,
    )
    r = compare(ds)
    assert r.value("box average", "xx") == pytest.approx(noise.mean(), abs=1e-12)
    # white noise: block averaging of 64 numbers scatters by some 20 % about σ/√n (Flyvbjerg & Petersen); 2 is beyond
    # five times that
    naive = noise.std(ddof=1) / 8
    assert naive / 2 < r.value("box average", "xx", "stderr_difference") < 2 * naive
    assert r.value("box average", "xx", "sigmas") == pytest.approx(
        abs(noise.mean()) / r.value("box average", "xx", "stderr_difference")
    )
    one = compare(ds, frame=5)
    assert one.value("box average", "xx") == pytest.approx(noise[5], abs=1e-12)
    with pytest.raises(AtcError, match="64 frames"):
        compare(ds, frame=64)


def test_a_time_average_is_held_against_its_standard_errors():
    ds = output(hardy=lambda s, k: A + 0.3 + 0 * wave(s), smoothed=lambda s, k: A + 0 * wave(s), virial=lambda k: A)
    ds["stress_stderr"] = xr.full_like(ds["stress"], 0.1)
    ds["virial_stress_stderr"] = xr.full_like(ds["virial_stress"], 0.05)
    ds["frames_averaged"] = ("frame", [40])
    r = compare(ds)
    assert "average of 40 frames" in r.title
    assert r.value("box average", "xy", "sigmas") == pytest.approx(6.0)
    assert r.value(POINTWISE, "xy", "rms in std. errors") == pytest.approx(3.0)


def test_a_grid_that_does_not_fill_the_cell_has_no_box_average():
    ds = output(hardy=lambda s, k: A + 0 * wave(s), smoothed=lambda s, k: A + 0 * wave(s), virial=lambda k: A)
    r = compare(ds.assign_coords(cell=ds.cell * 2))
    assert not any(row["section"].startswith("box") for row in r.rows)
    assert any("does not fill" in n for n in r.notes)


def test_an_open_cell_is_compared_with_a_caveat():
    ds = output(
        hardy=lambda s, k: A + 0 * wave(s), smoothed=lambda s, k: A + 0 * wave(s), virial=lambda k: A, periodic="pfp"
    )
    r = compare(ds)
    assert r.value("box average", "xx") == pytest.approx(0.0, abs=1e-12)
    assert any("open along y" in n for n in r.notes)


@pytest.mark.parametrize("have, words", [((), "no Hardy stress"), (("stress",), "no virial stress")])
def test_nothing_to_compare(have, words):
    ds = output(hardy=lambda s, k: A + 0 * wave(s), virial=lambda k: A)
    keep = [n for n in ds.data_vars if n in have]
    with pytest.raises(AtcError, match=words):
        compare(ds[keep])


def test_as_json_csv_and_picture(tmp_path):
    r = compare(
        output(hardy=lambda s, k: A + 3 * wave(s) * A, smoothed=lambda s, k: A + wave(s) * A, virial=lambda k: A)
    )
    data = json.loads(r.json())
    assert data["rows"] == r.rows
    assert data["kernel"] == "quartic, radius 4"
    lines = r.csv().splitlines()
    assert len(lines) == len(r.rows) + 1
    head, first = lines[0].split(","), lines[1].split(",")
    assert float(first[head.index("hardy")]) == r.rows[0]["hardy"]
    r.picture(tmp_path / "a.png")
    again = (tmp_path / "a.png").read_bytes()
    r.picture(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == again
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_side_by_side(tmp_path):
    results = [
        compare(
            output(
                hardy=lambda s, k, f=f: A + f * wave(s) * np.eye(3),
                smoothed=lambda s, k: A + 0 * wave(s),
                virial=lambda k: A,
            )
        )
        for f in (1.0, 2.0)
    ]
    r = side_by_side(results, labels=["one", "two"])
    assert [row["name"] for row in r.rows] == ["one", "two"]
    for row, f in zip(r.rows, (1.0, 2.0)):
        assert row["relative rms, hydrostatic"] == pytest.approx(f / np.sqrt(2) / (4 + f / np.sqrt(2)))
    r.picture(tmp_path / "t.png")
    with pytest.raises(AtcError, match="different units"):
        results[0].units = "atm"
        side_by_side(results)


@pytest.mark.parametrize("shape, said", [(4, True), (12, False)])
def test_what_a_coarse_grid_does_to_the_box_average_is_said(shape, said):
    """The integral is the virial; the mean over points is only as good as the grid (the Gaussian on 12 points an edge
    leaves 1e-10)."""
    from frames import argon

    import atc

    pot = atc.potential("pair_style lj/cut 6\npair_coeff * * 0.0104 3.405", units="metal")
    ds = atc.fields(
        argon(),
        pot,
        atc.kernel("gaussian", width=1.9),
        atc.Grid.regular(shape=shape),
        ["stress", "virial_stress"],
        tolerance=1e-12,
    )
    r = compare(ds)
    assert any("grid's quadrature" in n for n in r.notes) == said


def test_stress_of_the_run_as_a_third_curve():
    """LAMMPS's stress/atom, smoothed, is our smoothed virial; in its units, whatever they are called, with its sign."""
    from frames import argon

    import atc

    f = argon(n=(3, 3, 3))
    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    kern, grid = atc.kernel("quartic", 5.0), atc.Grid.regular(shape=(4, 4, 4))
    own = atc.fields([f], pot, kern, grid, ["virial_stress_per_atom"], tolerance=1e-12)
    s_n = own.virial_stress_per_atom.values[0]  # bar Å³
    six = np.stack([s_n[:, a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], 1)
    names = ["stress", "virial_stress", "smoothed_virial_stress", *(f"column:c_st[{k}]" for k in range(1, 7))]
    named = {f"c_st[{k}]": "bar*angstrom^3" for k in range(1, 7)}
    ds = atc.fields([f.replace(extra={"c_st": six})], pot, kern, grid, names, column_units=named, tolerance=1e-12)
    found = atc.compare(ds)
    row = [r for r in found.rows if r["section"] == "pointwise, c_st - smoothed virial"]
    assert len(row) == 8 and max(r["relative max"] for r in row) < 1e-12
    assert not [n for n in found.notes if "opposite" in n]
    assert "profile_x_column" in found.data and found.attrs["column"] == "c_st"
    in_gpa = atc.compare(ds, units="GPa")
    assert max(r["relative max"] for r in in_gpa.rows if r["section"] == row[0]["section"]) < 1e-12
    from atc.pictures.comparison import compare_figure

    fig = compare_figure(found)
    assert "dotted: c_st" in fig.legends[0].get_title().get_text()
    assert any("c_st of the run" in ax.get_title() for ax in fig.axes)
    pressed = atc.fields([f.replace(extra={"c_st": -six})], pot, kern, grid, names, column_units=named)
    assert [n for n in atc.compare(pressed).notes if "it is a pressure" in n]
    nameless = atc.fields([f.replace(extra={"c_st": six})], pot, kern, grid, names)
    assert [n for n in atc.compare(nameless).notes if "column_units" in n]
