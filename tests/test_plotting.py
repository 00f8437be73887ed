"""Pictures: what is drawn is where it should be, in the right colours, with the right labels."""

import numpy as np
import pytest

from atc import plotting
from atc.errors import AtcError

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
        np.testing.assert_allclose(plotting.component(s, name), want, atol=1e-10)
    for k in range(3):
        np.testing.assert_allclose(plotting.component(s, f"principal{k + 1}"), p[:, k], atol=1e-10)


def test_uniaxial_and_pure_shear():
    uniaxial = np.diag([3.0, 0, 0])
    assert plotting.component(uniaxial, "vonmises") == pytest.approx(3.0)
    assert plotting.component(uniaxial, "max_shear") == pytest.approx(1.5)
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 2.0
    assert plotting.component(shear, "vonmises") == pytest.approx(2.0 * np.sqrt(3))
    assert plotting.component(shear, "max_shear") == pytest.approx(2.0)


def test_components_by_name_and_undefined_points():
    s = np.arange(9.0).reshape(3, 3)
    assert [float(plotting.component(s, n)) for n in ("xx", "xy", "yx", "zz")] == [0, 1, 3, 8]
    v = np.array([[3.0, 0.0, 4.0]])
    assert plotting.component(v, "magnitude")[0] == 5.0
    assert plotting.component(v, "z")[0] == 4.0
    undefined = np.full((2, 3, 3), np.nan)
    undefined[1] = np.eye(3)
    for name in plotting.TENSOR_SCALARS:
        got = plotting.component(undefined, name)
        assert np.isnan(got[0]) and np.isfinite(got[1])
    with pytest.raises(AtcError, match="did you mean 'vonmises'"):
        plotting.component(s, "vonmisses")


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
    assert plotting.unit_text(unit) == drawn
