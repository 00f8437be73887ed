"""Fields made of gradients by the modes of one mesh: against the exact sum at every point, where they are used, and
what is done where they would not do."""

import numpy as np
import pytest
from test_only_what_is_needed import Counter
from test_promise import liquid, quiet, shipped, worst  # noqa: F401  (fixtures)

import atc
import atc.deposit
import atc.deposit.gradient as gradient_module
from atc.errors import AtcError
from atc.frame import Cell
from atc.plan import Request, plan, prepare
from atc.planning import method_choice

GRID = atc.Grid.regular(shape=12)
RATES = ["velocity_gradient", "strain_rate", "vorticity"]


@pytest.fixture(autouse=True)
def choosing_costs_nothing(monkeypatch):
    """Or the exact sum would be taken at once in frames as small as these."""
    monkeypatch.setattr(method_choice, "SEARCH", (0.0, 0.0))


# What of a kernel's gradient the modes can hold: one with a kink decays slowly.
KERNELS = [("gaussian", 8.0, 1e-3), ("gaussian", 8.0, 1e-5), ("gaussian", 8.0, 1e-7), ("lucy", 14.0, 1e-2),
           ("quartic", 16.0, 3e-2), ("bspline", 14.0, 1e-2), ("cubic", 16.0, 3e-2)]  # fmt: skip


@pytest.mark.parametrize("name, radius, tolerance", KERNELS)
@pytest.mark.parametrize("where", ["lattice", "points"])
def test_gradients_keep_the_tolerance_at_every_point(liquid, name, radius, tolerance, where):  # noqa: F811
    frame, kern = liquid[0], atc.kernel(name, radius=radius)
    grid = (
        GRID if where == "lattice" else atc.Grid.points(frame.cell.cartesian(np.random.default_rng(1).random((300, 3))))
    )
    ds = quiet(frame, None, kern, grid, RATES, tolerance, method="spectral")
    exact = quiet(frame, None, kern, grid, RATES, 1e-12)
    assert ds.attrs["method"] == "spectral" and exact.attrs["method"] == "direct"
    for q in RATES:
        assert worst(ds, exact, q) <= tolerance
        # what is reported was found at 100 of the points
        assert 0.2 * worst(ds, exact, q) <= ds[q].attrs["error_max"] <= tolerance


def moved(frame, seed=0):
    """The same atoms, displaced by waves as long as the box and a little shaken."""
    rng = np.random.default_rng(seed)
    s = frame.cell.fractional(frame.positions)
    wave = np.stack([np.sin(2 * np.pi * s[:, (c + 1) % 3]) for c in range(3)], axis=1)
    return frame.replace(positions=frame.positions + 0.5 * wave + rng.normal(0, 0.05, frame.positions.shape))


def test_displacements_and_eshelbys_stress(liquid):  # noqa: F811
    reference, pot = liquid
    frame, kern = moved(reference), atc.kernel("gaussian", radius=8.0)
    what = ["displacement", "displacement_gradient", "eshelby_stress", "piola_stress"]
    ds = quiet(frame, pot, kern, GRID, what, 1e-5, reference=reference)
    exact = quiet(frame, pot, kern, GRID, what, 1e-12, reference=reference)
    assert "sums over atoms for gradients: spectral" in ds.attrs["method_details"]
    assert "sums over atoms of the reference frame for gradients: spectral" in ds.attrs["method_details"]
    for q in what:
        assert 0 < worst(ds, exact, q) <= 1e-5 and ds[q].attrs["error_max"] <= 1e-5


def test_a_displacement_of_all_together_has_no_gradient(liquid):  # noqa: F811
    reference, kern = liquid[0], atc.kernel("gaussian", radius=8.0)
    frame = reference.replace(
        positions=reference.positions + [3.0, -2.0, 1.0], velocities=np.full((len(reference), 3), [3.0, 2.0, -1.0])
    )
    what = ["displacement", "displacement_gradient", "velocity_gradient", "strain_rate"]
    ds = quiet(frame, None, kern, GRID, what, 1e-3, reference=reference)
    assert ds.attrs["method"] == "spectral" and "refinements" not in ds.attrs
    np.testing.assert_allclose(ds.displacement, np.broadcast_to([3.0, -2.0, 1.0], ds.displacement.shape), rtol=1e-12)
    for q in what[1:]:
        # rounding of 3 Å, or Å/ps, over 8 Å
        assert (
            float(abs(ds[q]).max()) < 1e-13
            and ds[q].attrs["error_max"] < 1e-12
            and "terms" in ds[q].attrs["error_relative_to"]
        )


def test_a_deformed_cell_takes_the_exact_sum(liquid):  # noqa: F811
    """Its displacement grows along the images: what the first moments carry has no modes."""
    reference, kern = liquid[0], atc.kernel("gaussian", radius=8.0)
    F = np.diag([1.02, 0.99, 1.0])
    frame = reference.replace(positions=reference.positions @ F, cell=Cell(reference.cell.vectors @ F))
    what = ["displacement", "displacement_gradient"]
    ds = quiet(frame, None, kern, GRID, what, 1e-4, reference=reference)
    exact = quiet(frame, None, kern, GRID, what, 1e-12, reference=reference)
    for q in what:
        # the mass alone may still come from modes
        assert worst(ds, exact, q) <= 1e-12


@pytest.mark.parametrize("method", ["auto", "spectral"])
def test_empty_space_is_left_to_the_exact_sum(liquid, method, monkeypatch):  # noqa: F811
    monkeypatch.setattr(method_choice, "WORTH", 1e3)  # "auto" prefers modes here, though the frame is small
    frame = liquid[0]
    L = frame.cell.vectors[0, 0]
    low = frame.positions[:, 2] < 0.5 * L
    half = frame.replace(
        positions=frame.positions[low],
        velocities=frame.velocities[low],
        masses=frame.masses[low],
        types=None,
        ids=None,
        cell=Cell([L, L, 3 * L]),
    )
    grid, kern = atc.Grid.regular(shape=(8, 8, 24)), atc.kernel("gaussian", radius=8.0)
    ds, exact = quiet(half, None, kern, grid, RATES, 1e-4, method=method), quiet(half, None, kern, grid, RATES, 1e-12)
    np.testing.assert_array_equal(ds.mask, exact.mask)
    assert not ds.mask.all() and "nearly empty space" in ds.attrs["refinements"]
    for q in RATES:
        assert worst(ds, exact, q) <= 1e-12


def test_one_transform_gives_the_sums_and_their_gradients(liquid, monkeypatch):  # noqa: F811
    frame, kern = liquid[0], atc.kernel("gaussian", radius=8.0)
    gathers = Counter(monkeypatch, gradient_module, "gather", lambda bound, *a: len(bound))
    made = Counter(
        monkeypatch,
        atc.deposit,
        "make",
        lambda method, bound, kern, cell, n_site, n_bond, *_, **__: (method, n_site, n_bond),
    )
    quiet(frame, None, kern, GRID, ["velocity_gradient", "density", "velocity"], 1e-4)
    # mass and momentum once, with their gradients; exactly only at the points of the check
    assert made.calls == [("spectral", 4, 0), ("direct", 4, 0)] and gathers.calls == [100]
    made.calls.clear()
    quiet(frame, None, kern, GRID, ["velocity_gradient", "temperature"], 1e-4)
    assert sorted(c for c in made.calls if c[0] == "spectral") == [
        ("spectral", 1, 0),
        ("spectral", 4, 0),
        ("spectral", 12, 0),
    ]


def test_a_gradient_too_wrong_is_computed_again(liquid):  # noqa: F811
    frame, kern = liquid[0], atc.kernel("gaussian", radius=8.0)
    from atc.estimators.driver import fields_of
    from atc.estimators.methods import Method

    request = prepare(Request(frame, None, kern, GRID, RATES, 1e-6, threads=1))
    request.methods = {"gather": Method("spectral", 1e-3, "test", (1e-4, 1e-7))}
    result = fields_of([frame], request.settings())
    assert result.methods["gather"].tolerance == 1e-7 and "sums over atoms for gradients spectral to 1e-07" in str(
        result.refined[0]
    )
    assert max(e["error_max"] for e in result.errors.values()) <= 1e-6


def test_the_plan_says_so(liquid):  # noqa: F811
    frame, kern = liquid[0], atc.kernel("gaussian", radius=8.0)
    p = plan(frame, None, kern, GRID, RATES, 1e-4, threads=1)
    text = str(p)
    assert "one pass over the atoms, on the modes of one mesh: Σ a φ and Σ a ∂φ/∂x for a = m, m v" in text
    assert "sums over atoms for gradients: spectral to 0.0001" in text and "those with gradients have the same" in text
    assert 0 < p.parts["gradients"] < 0.5
    text = str(plan(frame, None, atc.kernel("linear", 6.0), GRID, RATES, 1e-4, threads=1))
    assert "one pass over the points" in text and "direct" in text.split("method")[1]
    text = str(plan(frame, None, kern, GRID, ["velocity_gradient", "temperature"], 1e-4, threads=1))
    assert (
        "one pass over the atoms: Σ a φ for a = m, m v, f/d, m v⊗v, 1: 12 components; Σ m φ²" in text
        and "those with gradients" not in text
    )


@pytest.mark.parametrize("name", ["linear", "hardy"])
def test_kernels_whose_gradient_jumps_have_no_modes_for_it(liquid, name):  # noqa: F811
    kern = atc.kernel(name, radius=10.0)
    with pytest.raises(AtcError, match=f"{name}.*decay too slowly.*use method 'direct'"):
        atc.fields(liquid[0], None, kern, GRID, RATES, 1e-2, method="spectral")
    ds = quiet(liquid[0], None, kern, GRID, RATES, 1e-2)
    assert ds.attrs["method"] == "direct" and ds.attrs["measured_error"] < 1e-12
