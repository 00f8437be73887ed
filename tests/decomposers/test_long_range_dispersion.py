"""Long-range dispersion: the smooth part against sums over images and over pairs of modes, and models against LAMMPS."""

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps

import atc
from atc.decomposers.long_range.dispersion import (
    DispersionSplit,
    LongRangeDispersion,
    SmoothDispersion,
    divided_difference,
)
from atc.decomposers.long_range.transform import Direct, wave_vectors
from atc.errors import AtcError
from atc.estimators.driver import fields_of
from atc.estimators.settings import Settings
from atc.frame import Cell, Frame
from atc.units import units

SIX = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
TRICLINIC = np.array([[9.0, 0, 0], [1.3, 10.0, 0], [-0.7, 2.0, 11.0]])
COEFFS = "pair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 3.4\n"


def model(mix="geometric", kspace="ewald/disp 1e-10", coulomb="off"):
    return (
        f"pair_style lj/long/coul/long long {coulomb} 6.0\npair_modify mix {mix}\n{COEFFS}kspace_style {kspace}\n"
        "kspace_modify gewald/disp 0.8 gewald 0.8\n"
    )


def config(n=4, seed=3, charges=False, **more):
    """A loose lattice of two kinds, shaken."""
    rng = np.random.default_rng(seed)
    s = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) / n
    cell = np.array([[15.0, 0, 0], [1.0, 15.5, 0], [0.7, -1.2, 16.0]])
    types = rng.permutation(np.arange(len(s)) % 2) + 1
    q = np.where(types == 1, 0.4, -0.4) if charges else None
    return Config(
        cell=cell, positions=s @ cell + rng.uniform(-0.35, 0.35, s.shape), types=types, units="real", charges=q,
        masses={1: 20.0, 2: 30.0}, **more,
    )  # fmt: skip


def test_modes_are_those_of_the_smooth_part():
    """V is the Fourier transform of what is no bond, by quadrature; its slope is its derivative."""
    split = DispersionSplit(0.7, 5.0)
    r = np.linspace(1e-3, 60.0, 400_001)
    b2 = (0.7 * r) ** 2
    smooth = np.where(b2 > 0.05, -np.expm1(-b2) + -np.exp(-b2) * (b2 + 0.5 * b2**2), b2**3 / 6 - b2**4 / 8 + b2**5 / 20)
    smooth /= r**6
    k = np.array([0.3, 1.0, 2.5])
    tail = 4 * np.pi / 3 / 60.0**3
    V, slope = split.modes(k)
    for ki, Vi in zip(k, V):
        f = 4 * np.pi * r**2 * smooth * np.sinc(ki * r / np.pi)
        assert Vi == pytest.approx(-np.sum(0.5 * (f[1:] + f[:-1])) * (r[1] - r[0]), abs=0.2 * tail)
    h = 1e-5
    np.testing.assert_allclose((split.modes(k + h)[0] - split.modes(k - h)[0]) / (4 * h * k), slope, rtol=1e-6)
    assert split.modes(np.zeros(1))[0][0] == pytest.approx(-(np.pi**1.5) * 0.7**3 / 3)


def test_divided_difference_is_a_sum_of_few_products():
    split = DispersionSplit(0.7, 5.0)
    k = np.linspace(0.0, 9.0, 60)
    V = split.modes(k)[0]
    apart = k[:, None] ** 2 - k**2
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(apart == 0, split.modes(k)[1], (V[:, None] - V) / apart)
    counts = []
    for tolerance in (1e-4, 1e-8):
        parts = divided_difference(split, 9.0, tolerance)
        got = sum(value * np.outer(f(k), f(k)) for value, f in parts)
        assert (k[:, None] * k * np.abs(got - exact)).max() < 3 * tolerance * abs(V[0])
        counts.append(len(parts))
    assert counts[0] < counts[1] <= 20


def test_divergence_is_the_force_density_and_the_mean_is_the_virial():
    rng = np.random.default_rng(2)
    frame = Frame(
        rng.uniform(0.05, 0.95, (8, 3)) @ TRICLINIC, Cell(TRICLINIC), units("metal"), types=np.tile([1, 2], 4)
    )
    C6 = np.array([[0, 0, 0], [0, 3.0, 1.0], [0, 1.0, 2.0]])
    term = LongRangeDispersion(DispersionSplit(0.6, 5.0, 1e-12), C6)
    from atc.estimators.field_pass import Layout

    on = Layout(TRICLINIC, np.zeros(3), np.array([5, 5, 5]), 1e-10, 1, 1.0, False, (0, 0, 0), 0)
    products = term.products(frame, on, 1)
    sigma = products.stress()
    full = sigma[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    smooth = SmoothDispersion(term, frame)
    Q = np.stack([np.broadcast_to(k, sigma.shape[1:]) for k in wave_vectors(products.q_index, products.vectors)])
    force = Direct(TRICLINIC, np.zeros(3), (5, 5, 5)).modes(frame.positions, smooth.forces_nc())
    difference = np.einsum("iabc,ijabc->jabc", 1j * Q, full) - force
    assert np.abs(difference).max() < 1e-7 * np.abs(force).max()
    np.testing.assert_allclose(
        sigma[:, 0, 0, 0].real, smooth.virial_cc[SIX], rtol=0, atol=1e-9 * np.abs(smooth.virial_cc).max()
    )
    # The energy current: its divergence, its mean, and of atoms that all move alike.
    v = rng.normal(size=(8, 3))
    A = products.current(v)
    source = smooth.share_rates_n(v) + np.einsum("nc,nc->n", v, smooth.forces_nc())
    want = Direct(TRICLINIC, np.zeros(3), (5, 5, 5)).modes(frame.positions, source[:, None])[0]
    assert np.abs(np.einsum("aijk,aijk->ijk", 1j * Q, A) + want).max() < 1e-7 * np.abs(want).max()
    w = smooth.virials_n6()
    mean = -np.einsum("nij,nj->i", w[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]], v)
    np.testing.assert_allclose(A[:, 0, 0, 0].real, mean, rtol=0, atol=1e-9 * np.abs(mean).max())
    alike = products.current(np.tile(v[0], (8, 1)))
    assert np.abs(alike + np.einsum("abijk,b->aijk", full, v[0])).max() < 1e-9 * np.abs(alike).max()
    np.testing.assert_allclose(w.sum(0), smooth.virial_cc[SIX], rtol=1e-9)
    ends = [SmoothDispersion(term, frame.replace(positions=frame.positions + s * 1e-4 * v)) for s in (1, -1)]
    rates = (ends[0].energies_n() - ends[1].energies_n()) / 2e-4
    np.testing.assert_allclose(smooth.share_rates_n(v), rates, rtol=0, atol=1e-6 * np.abs(rates).max())
    assert smooth.energies_n().sum() == pytest.approx(smooth.energy, rel=1e-10)
    h = 1e-4  # Å
    step = np.zeros((8, 3))
    step[3, 1] = h
    energy = [SmoothDispersion(term, frame.replace(positions=frame.positions + s * step)).energy for s in (1, -1)]
    assert smooth.forces_nc()[3, 1] == pytest.approx(-(energy[0] - energy[1]) / (2 * h), rel=1e-5)


def test_forces_against_a_sum_over_images():
    """Bonds and modes together are −C/r⁶ of all images, here of those up to 45 Å; r⁻¹² ends at 6 Å."""
    frame = config().frame()
    d = atc.potential("units real\n" + model(mix="arithmetic")).stream(frame, forces=True)
    eps, sigma = np.array([0.2, 0.1]), np.array([3.0, 3.4])
    t, x, n = frame.types - 1, frame.positions, np.arange(-4, 5)
    e, s6 = np.sqrt(eps[t][:, None] * eps[t]), (0.5 * (sigma[t][:, None] + sigma[t])) ** 6
    want = np.zeros_like(x)
    for image in np.stack(np.meshgrid(n, n, n, indexing="ij"), -1).reshape(-1, 3) @ frame.cell.vectors:
        r = x[:, None] - x - image
        r2 = (r**2).sum(-1)
        r2[r2 < 1e-9] = np.inf
        r2[r2 > 45.0**2] = np.inf
        size = -24.0 * e * s6 / r2**4 + np.where(r2 < 36.0, 48.0 * e * s6**2 / r2**7, 0.0)
        want += (size[:, :, None] * r).sum(1)
    got = frame.units.to_user("energy", d.forces_nc)
    assert np.abs(got - want).max() < 2e-4 * np.abs(want).max()


@pytest.mark.parametrize("mix, coulomb", [("geometric", "off"), ("arithmetic", "long")])
def test_against_lammps(mix, coulomb):
    system = config(charges=coulomb == "long")
    lines = model(mix, coulomb=coulomb)
    res = run_lammps(lines, system)
    frame = system.frame()
    d = atc.potential("units real\n" + lines).stream(frame, forces=True)
    u = frame.units
    scale = np.abs(res.forces_nc).max()
    assert np.abs(u.to_user("force", d.forces_nc) - res.forces_nc).max() < 1e-6 * scale
    assert u.to_user("energy", d.energy) == pytest.approx(res.energy, rel=1e-6)


def test_lines_for_all_types_and_hybrids_are_the_same_model():
    """``* *`` covers as many types as a frame has; the flags of the style are no sub-styles."""
    import pickle

    system = config(charges=True)
    v = np.random.default_rng(7).normal(size=system.positions.shape)
    frame = system.frame().replace(velocities=v)
    kspace = "kspace_style ewald/disp 1e-10\nkspace_modify gewald/disp 0.8 gewald 0.8\n"
    style = "lj/long/coul/long long long 6.0"
    each = "pair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.2 3.0\n"
    star = f"pair_style {style}\npair_coeff * * 0.2 3.0\n{kspace}"
    hybrid = (
        f"pair_style hybrid/overlay {style} zero 6.0\npair_coeff * * lj/long/coul/long 0.2 3.0\npair_coeff * * zero\n"
    )
    lines = [f"pair_style {style}\n{each}{kspace}", star, hybrid + kspace]
    pots = [atc.potential("units real\n" + text) for text in lines]
    want, *others = (pickle.loads(pickle.dumps(pot)).stream(frame, forces=True) for pot in pots)
    for d in others:
        assert d.energy == pytest.approx(want.energy, rel=1e-12)
        assert np.abs(d.forces_nc - want.forces_nc).max() < 1e-12 * np.abs(want.forces_nc).max()
    theirs, u = run_lammps(star, system), frame.units
    assert np.abs(u.to_user("force", want.forces_nc) - theirs.forces_nc).max() < 1e-6 * np.abs(theirs.forces_nc).max()
    names, grid = ["stress_potential", "energy_flux"], atc.Grid.points(frame.positions[:3])
    kern = atc.kernel("gaussian", width=1.5)
    a, b = (fields_of([frame], Settings(tuple(names), pot, kern, grid, tolerance=1e-5)).arrays for pot in pots[:2])
    for name in names:
        assert np.abs(a[name] - b[name]).max() < 1e-9 * np.abs(a[name]).max(), name
    # A line that says less than the frame needs still does.
    one = atc.potential(f"units real\npair_style {style}\npair_coeff 1 1 0.2 3.0\n{kspace}")
    with pytest.raises(AtcError, match="atoms of type 2; .* no pair_coeff for types 1 and 2"):
        one.stream(frame)


def test_fields_keep_the_tolerance():
    frame, pot = config().frame(), atc.potential("units real\n" + model())
    kern, grid = atc.kernel("gaussian", width=1.5), atc.Grid.regular(shape=(6, 6, 6))
    names = ("stress_potential",)
    rough, fine = (
        fields_of([frame], Settings(names, pot, kern, grid, tolerance=t, check_points=40)) for t in (1e-4, 1e-8)
    )
    a, b = (r.arrays["stress_potential"] for r in (rough, fine))
    assert np.abs(a - b).max() < 1e-4 * np.abs(b).max()
    assert 0 < rough.errors["stress_potential"]["error_max"] < 1e-4
    assert 0 < fine.errors["stress_potential"]["error_max"] < 1e-7
    attrs = atc.fields(frame, pot, kern, grid, ["stress_potential"], 1e-4).attrs
    assert (
        attrs["dispersion_alpha"] == pytest.approx(pot.fields[0].split.alpha) and "dispersion" in attrs["decomposition"]
    )
    assert "coulomb_alpha" not in attrs


@pytest.mark.parametrize(
    "lines, message",
    [
        (model(kspace="pppm 1e-4"), "needs ewald/disp or pppm/disp"),
        (model().replace("pair_modify", "pair_modify shift yes\npair_modify"), "pair_modify shift yes has no meaning"),
        (model() + "kspace_modify slab 3.0\n", "slab with long-range dispersion"),
        (model().replace(COEFFS, COEFFS + "pair_coeff 1 2 0.3 3.0\n"), "is not the geometric mean"),
        (model().split("kspace_style")[0], "add the kspace_style line of the run"),
    ],
)
def test_refused_in_one_line(lines, message):
    with pytest.raises(AtcError, match=message):
        atc.potential("units real\n" + lines)


def test_open_cells_are_refused():
    pot, frame = atc.potential("units real\n" + model()), config().frame()
    with pytest.raises(AtcError, match="periodic along x, y and z"):
        pot.stream(frame.replace(cell=Cell(frame.cell.vectors, frame.cell.origin, (True, True, False))))
