"""Profiles by species and electrostatics: charged sheets, whose field and potential are known in closed form, and
means of velocities by hand."""

import warnings

import numpy as np
import pytest

import atc
from atc.analysis.species_profile import field_and_potential
from atc.frame import Cell, Frame, Topology
from atc.readers.memory import FrameList
from atc.units import units

pytestmark = pytest.mark.filterwarnings("ignore::atc.AtcWarning")
L, A, R, BINS = 40.0, 100.0, 3.0, 160


def sheets(z, q, periodic=True, style="metal", **more):
    """A frame with charges q at heights z."""
    u = units(style)
    z = np.asarray(z, float)
    x = np.stack([np.arange(len(z)) % 10.0, np.arange(len(z)) * 0.7 % 10.0, z], axis=1)
    cell = Cell(np.diag([10.0, 10.0, L]) * u.length, periodic=(True, True, periodic))
    return Frame(
        positions=x * u.length, types=1 + (np.asarray(q) < 0), cell=cell, units=u,
        charges=np.asarray(q, float) * u.charge, masses=np.ones(len(z)), **more,
    )  # fmt: skip


def closed(z, at, q, coulomb, vacuum):
    """E and ψ of sheets of charge q smeared by the kernel, by quadrature of its cumulative profile; V and V/Å."""
    zz = np.linspace(0.0, L, 400_001)
    cumulative = atc.kernel("quartic", R).marginal().cumulative
    E = sum(4 * np.pi * coulomb * qk / A * cumulative(zz - zk) for zk, qk in zip(at, q))
    h = zz[1]
    psi = -np.concatenate([[0.0], np.cumsum(0.5 * h * (E[1:] + E[:-1]))])
    if not vacuum:
        mean = -psi[-1] / L
        E, psi = E - mean, psi + mean * zz
    return np.interp(z, zz, E), np.interp(z, zz, psi)


@pytest.mark.parametrize("boundary", ["vacuum", "periodic"])
@pytest.mark.parametrize("at, q", [((10.0, 30.0), (2.0, -2.0)), ((8.0, 15.0, 29.0, 33.0), (1.0, -3.0, 4.0, -2.0))])
def test_charged_sheets(at, q, boundary):
    mine = atc.profile(sheets(at, q), None, atc.kernel("quartic", R), atc.Grid.slab("z", BINS), boundary=boundary)
    E, psi = closed(mine.z, at, q, units("metal").coulomb, boundary == "vacuum")
    # a kernel with two continuous derivatives, 24 bins wide, seen by its Fourier series
    np.testing.assert_allclose(mine["electric_field"].values, E, rtol=0, atol=2e-5 * abs(E).max())
    np.testing.assert_allclose(mine["potential"].values, psi, rtol=0, atol=2e-5 * abs(psi).max())
    assert mine["potential"].units == "V" and mine["electric_field"].units == "V/angstrom"


def test_capacitor_in_volts():
    """σ/ε₀ between the plates, nothing outside, in SI: 2 e over 100 Å² by ε₀."""
    mine = atc.profile(
        sheets((10.0, 30.0), (2.0, -2.0)), None, atc.kernel("quartic", R), atc.Grid.slab("z", BINS), boundary="vacuum"
    )
    field = 2 * 1.602176634e-19 / 1e-18 / 8.8541878128e-12 * 1e-10
    assert mine["electric_field"].values[BINS // 2] == pytest.approx(field, rel=2e-5)
    assert abs(mine["electric_field"].values[:20]).max() < 1e-4 * field
    assert mine["potential"].values[-1] == pytest.approx(-20.0 * field, rel=2e-5)


def test_auto_is_vacuum_where_the_cell_is_open():
    kern, grid = atc.kernel("quartic", R), atc.Grid.slab("z", BINS)
    for periodic, same in ((True, "periodic"), (False, "vacuum")):
        frame = sheets((10.0, 30.0), (2.0, -2.0), periodic)
        auto, given = (atc.profile(frame, None, kern, grid, boundary=b) for b in ("auto", same))
        np.testing.assert_array_equal(auto["potential"].values, given["potential"].values)
        assert same in " ".join(auto.notes)


@pytest.mark.parametrize("style", ["real", "si", "nano", "electron"])
def test_volts_in_every_unit_style(style):
    u = units(style)
    frame = sheets((10.0, 30.0), (2.0, -2.0), style="metal").replace(units=u)
    mine = atc.profile(
        frame, None, atc.kernel("quartic", R / u.length), atc.Grid.slab("z", BINS), boundary="vacuum"
    )  # fmt: skip
    # the styles' Coulomb constants agree to 1e-5
    assert mine["potential"].values[-1] == pytest.approx(-20.0 * 4 * np.pi * 14.399645 * 2 / A, rel=3e-5)
    assert mine["electric_field"].values[BINS // 2] * mine.z[-1] / mine["potential"].values[-1] == pytest.approx(
        -mine.z[-1] / (20.0 / u.length), rel=1e-4
    )


def test_net_charge():
    frame, kern, grid = sheets((10.0, 30.0), (2.0, -1.0)), atc.kernel("quartic", R), atc.Grid.slab("z", BINS)
    with pytest.raises(atc.AtcError, match="net charge"):
        atc.profile(frame, None, kern, grid, boundary="vacuum")
    mine = atc.profile(frame, None, kern, grid, boundary="periodic")
    assert any("uniform background" in doubt for doubt in mine.warnings)
    assert abs(mine["electric_field"].values.mean()) < 1e-12


@pytest.mark.parametrize("bins", [32, 33])
def test_poisson_of_a_wave(bins):
    k, H = 2 * np.pi * 3 / 7.0, 7.0
    z = (np.arange(bins) + 0.5) * H / bins
    E, psi = field_and_potential(np.cos(k * z + 0.4)[None], np.array([H]), 2.0, False)
    np.testing.assert_allclose(E[0], 8 * np.pi / k * np.sin(k * z + 0.4), atol=1e-12)
    np.testing.assert_allclose(psi[0], 8 * np.pi / k**2 * (np.cos(k * z + 0.4) - np.cos(0.4)), atol=1e-12)


def test_species_by_hand():
    rng = np.random.default_rng(3)
    frames = []
    for step in range(3):
        z, q = rng.uniform(0, L, 12), np.where(np.arange(12) < 5, 1.0, -1.0)
        frames.append(sheets(z, q, velocities=rng.normal(size=(12, 3)), step=step, type_names={1: "Na", 2: "Cl"}))
    mine = atc.profile(frames, None, atc.kernel("quartic", R), atc.Grid.slab("z", 20))
    phi = atc.kernel("quartic", R).marginal().phi
    for kind, name in ((1, "Na"), (2, "Cl")):
        n, nv = np.zeros(20), np.zeros((20, 3))
        for f in frames:
            d = mine.z[:, None] - f.positions[None, f.types == kind, 2]
            w = phi(np.abs(d - L * np.rint(d / L))) / A
            n, nv = n + w.sum(1) / 3, nv + w @ f.velocities[f.types == kind] / 3
        np.testing.assert_allclose(mine[f"number_density_{name}"].values, n, rtol=1e-10, atol=1e-14)
        v = np.divide(nv, n[:, None], out=np.full_like(nv, np.nan), where=n[:, None] > 0)
        for c in range(3):
            got = mine[f"velocity_{'xyz'[c]}_{name}"].values
            np.testing.assert_allclose(got, frames[0].units.to_user("velocity", v[:, c]), rtol=1e-9)
    assert mine.dataset()["velocity_x_Na"].attrs["units"] == "angstrom/ps"


def test_species_that_come_later_are_refused():
    a, b = sheets((1.0, 2.0), (1.0, 1.0)), sheets((1.0, 2.0), (1.0, -1.0))
    with pytest.raises(atc.AtcError, match="same in every frame"):
        atc.profile([a, b], None, atc.kernel("quartic", R), atc.Grid.slab("z", 20))
    with pytest.raises(atc.AtcError, match="boundary"):
        atc.profile(a, None, atc.kernel("quartic", R), atc.Grid.slab("z", 20), boundary="open")


def dumbbells(**more):
    """Dipoles ±2 e over 1 Å: two at z = 10 (through the cell's side), at 0 and 60 degrees to z, one at z = 30 against
    it; an ion, and a molecule that is longer than half the cell."""
    turned = np.array([[0, 0, 1], [np.sqrt(0.75), 0, 0.5], [0, 0, -1]])
    middle = np.array([[9.9, 5.0, 10.0], [0.2, 2.0, 10.0], [5.0, 5.0, 30.0]])
    x = np.concatenate(
        [(middle + 0.5 * turned), (middle - 0.5 * turned), [[1.0, 1, 20], [1, 1, 1], [1, 1, 19], [1, 1, 37]]]
    )
    q = np.array([2.0] * 3 + [-2.0] * 3 + [1.0, -1.0, 1.0, -1.0])
    molecules = np.array([5, 7, 9, 5, 7, 9, 2, 4, 4, 4])
    cell = Cell(np.diag([10.0, 10.0, L]))
    frame = Frame(
        x % [10.0, 10.0, L], cell, units("metal"), types=np.ones(10, int), charges=q, masses=np.ones(10),
        molecules=molecules,
    )  # fmt: skip
    return frame.replace(**more)


def test_dipoles_of_molecules():
    kern, grid = atc.kernel("quartic", R), atc.Grid.slab("z", BINS)
    mine = atc.profile(dumbbells(), None, kern, grid)
    P, cosine, order = (mine[name].values for name in ("polarisation", "dipole_cosine", "dipole_order"))
    lower, dz = mine.z < 20, L / BINS
    # e/Å² times the cross-section is the dipole there, as far as 24 bins a kernel see
    assert P[lower].sum() * dz * A == pytest.approx(2 * (1 + 0.5), rel=2e-5)
    assert P[~lower].sum() * dz * A == pytest.approx(-2.0, rel=2e-5)
    at = [np.argmin(abs(mine.z - z)) for z in (10.0, 30.0)]
    np.testing.assert_allclose(cosine[at], [0.75, -1.0], rtol=1e-9)
    np.testing.assert_allclose(order[at], [0.5 * (1.0 - 0.125), 1.0], rtol=1e-9)
    assert np.isnan(cosine[BINS // 2]) and mine["polarisation"].units == "e/angstrom^2"
    assert any("longer than half the cell" in note for note in mine.notes)
    # The same from the bonds, where the file has no numbers of molecules.
    bonds = np.array([[0, 3], [1, 4], [2, 5], [7, 8], [8, 9]])
    bonded = dumbbells(molecules=None, topology=Topology(bonds=bonds, bond_types=np.ones(5, int)))
    again = atc.profile(bonded, None, kern, grid)
    np.testing.assert_array_equal(again["polarisation"].values, P)
    nothing = atc.profile(dumbbells(molecules=None), None, kern, grid)
    assert "polarisation" not in nothing.columns and "charge_density" in nothing.columns


def test_frames_are_read_once_and_notes_are_not_warned_of():
    class Counting(FrameList):
        def _frame(self, k):
            self.reads[k] += 1
            return super()._frame(k)

    frames = Counting([sheets((10.0, 30.0), (2.0, -2.0), velocities=np.ones((2, 3)))] * 17)
    frames.reads = np.zeros(17, int)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mine = atc.profile(frames, None, atc.kernel("quartic", R), atc.Grid.slab("z", BINS))
    # The first two are looked at when the way is chosen, too.
    assert (frames.reads[2:] == 1).all() and mine.frames == 17 and len(mine.notes) == 2 and not mine.warnings
    charged = sheets((10.0, 30.0), (2.0, -1.0))
    with pytest.warns(atc.AtcWarning, match="net charge"):
        mine = atc.profile(charged, None, atc.kernel("quartic", R), atc.Grid.slab("z", BINS))
    assert "net charge" in mine.json() and "net charge" in mine.dataset().attrs["warnings"]
