"""Every quantity against its definition summed by brute force; what is asked is all that is computed."""

import warnings

import numpy as np
import pytest
from frames import CELLS, argon
from naive_fields import BruteLJ, bond_sum, site_sum

import atc
from atc.errors import AtcError, AtcWarning
from atc.estimators.deposits import Deposits
from atc.estimators.registry import QUANTITIES
from atc.estimators.tensors import full, outer6
from atc.estimators.work import Work

# The others are in test_estimators_piola, _heat and _kinematics.
ALL = [
    "number_density",
    "density",
    "momentum",
    "velocity",
    "temperature",
    *(
        f"{q}{part}"
        for q in ("stress", "virial_stress", "virial_stress_per_atom", "smoothed_virial_stress", "energy")
        for part in ("", "_kinetic", "_potential")
    ),
]


def naive(frame, kern, points, pot):
    """All fields at the points, internal units, straight from formulas.md §4."""
    x, v, m, cell = frame.positions, frame.velocities, frame.masses, frame.cell
    bonds, _, e = pot.evaluate(frame)
    G, r = bonds.G_b, bonds.r_bc

    def site(a):
        return site_sum(points, x, a.reshape(len(x), -1), kern, cell)

    rho = site(m)[:, 0]
    n = site(np.ones(len(x)))[:, 0]
    v_g = site(m[:, None] * v) / rho[:, None]
    # definition, not T − ρ v⊗v: every atom relative to every point's velocity
    thermal = np.array(
        [site_sum(points[g : g + 1], x, m[:, None] * outer6(v - v_g[g]), kern, cell)[0] for g in range(len(points))]
    )
    # what the velocity of few atoms takes of their thermal motion, every atom with the sum over its images
    lost = site(np.eye(len(x))) ** 2 @ m / rho
    thermal *= (n / (n - lost))[:, None]
    S = bond_sum(points, x[bonds.i], r, np.einsum("b,bi,bj->bij", G, r, r).reshape(-1, 9), kern, cell).reshape(-1, 3, 3)
    w = np.zeros((len(x), 3, 3))
    for b in range(len(G)):
        w[bonds.i[b]] += 0.5 * G[b] * np.outer(r[b], r[b])
        w[bonds.j[b]] += 0.5 * G[b] * np.outer(r[b], r[b])
    u = v - (m @ v) / m.sum()
    k = np.einsum("n,ni,nj->nij", m, u, u)
    out = {
        "number_density": n,
        "density": rho,
        "momentum": site(m[:, None] * v),
        "velocity": v_g,
        "temperature": thermal[:, :3].sum(1) / (3 * n * frame.units.boltzmann),
        "stress_kinetic": -full(thermal),
        "stress_potential": S,
        "virial_stress_kinetic": -k.sum(0) / cell.volume,
        "virial_stress_potential": np.einsum("b,bi,bj->ij", G, r, r) / cell.volume,
        "virial_stress_per_atom_kinetic": -k,
        "virial_stress_per_atom_potential": w,
        "smoothed_virial_stress_kinetic": -site(k).reshape(-1, 3, 3),
        "smoothed_virial_stress_potential": site(w).reshape(-1, 3, 3),
        "energy_kinetic": site(0.5 * m * (v * v).sum(1))[:, 0],
        "energy_potential": site(e)[:, 0],
    }
    for whole in ("stress", "virial_stress", "virial_stress_per_atom", "smoothed_virial_stress", "energy"):
        out[whole] = out[f"{whole}_kinetic"] + out[f"{whole}_potential"]
    return out


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("name, radius", [("quartic", 4.5), ("hardy", 5.0)])
def test_every_quantity_is_its_definition(cell, name, radius):
    frame = argon(cell, seed=3)
    frame.positions += 2 * frame.cell.periodic @ frame.cell.vectors  # not inside the cell
    pot, kern = BruteLJ(), atc.kernel(name, radius=radius)
    rng = np.random.default_rng(5)
    points = frame.cell.cartesian(rng.uniform(0.1, 0.9, (7, 3)))
    if not frame.cell.periodic.all():
        points = frame.positions[:7] + rng.uniform(-1, 1, (7, 3))
    ds = atc.fields(frame, pot, kern, atc.Grid.points(points), ALL, threads=2)
    expected = naive(frame, kern, points, pot)
    assert set(ALL) <= set(ds.data_vars) and set(expected) == set(ALL)
    for q in ALL:
        want = frame.units.to_user(QUANTITIES[q].dimension, expected[q])
        got = ds[q].values[0]
        assert got.dtype == np.float64
        # rounding of sums of a few hundred terms
        np.testing.assert_allclose(got, want, rtol=0, atol=2e-12 * np.abs(want).max(), err_msg=q)
        assert ds[q].dims == (
            "frame",
            *{"grid": ("point",), "box": (), "atom": ("atom",)}[QUANTITIES[q].kind],
            *("i", "j")[: QUANTITIES[q].rank],
        )
        for attribute in ("units", "long_name", "sign_convention"):
            assert ds[q].attrs[attribute]
        if QUANTITIES[q].kind == "grid":
            assert ds[q].attrs["error_max"] < 1e-13
    assert ds.mask.values.all()
    assert ds["i"].values.tolist() == ["x", "y", "z"] == ds["j"].values.tolist()


def test_attributes_of_the_dataset():
    frame = argon(source="/home/somebody/run.dump frame 3")
    ds = atc.fields(
        frame,
        BruteLJ(),
        atc.kernel("quartic", radius=5.6),
        atc.Grid.regular(shape=(3, 2, 2)),
        ["stress"],
        scene="[kernel]\nname='quartic'\n",
    )
    for name in (
        "version",
        "kernel",
        "radius",
        "decomposition",
        "method",
        "tolerance",
        "measured_error",
        "scene",
        "sources",
        "units",
    ):
        assert name in ds.attrs, name
    assert ds.attrs["radius"] == 5.6 and ds.attrs["sources"] == "run.dump" and ds.attrs["method"] == "direct"
    assert "somebody" not in str(ds.attrs) + str([v.attrs for v in ds.variables.values()])
    assert ds.stress.attrs["units"] == "bar"


def test_a_whole_gives_its_parts_and_a_part_comes_alone():
    frame, grid, kern = argon(), atc.Grid.regular(shape=(2, 3, 2)), atc.kernel("quartic", radius=5.5)
    ds = atc.fields(frame, BruteLJ(), kern, grid, "stress")
    assert list(ds.data_vars) == ["stress", "stress_kinetic", "stress_potential", "mask"]
    np.testing.assert_allclose(
        ds.stress, ds.stress_kinetic + ds.stress_potential, atol=1e-12 * float(abs(ds.stress).max())
    )
    for part in ("stress_kinetic", "stress_potential"):
        alone = atc.fields(frame, BruteLJ(), kern, grid, [part])
        assert [v for v in alone.data_vars if v != "mask"] == [part]
        assert np.array_equal(alone[part], ds[part])


class _Spy:
    """Records what is deposited."""

    def __init__(self, monkeypatch):
        import atc.deposit

        self.made, self.checked, real = [], [], atc.deposit.make

        def make(method, bound, kern, cell, n_site, n_bond, **more):
            # The check at random points has one sum more: how large the terms of the stress are.
            (self.checked if bound.kind == "points" else self.made).append((n_site, n_bond))
            return real(method, bound, kern, cell, n_site, n_bond, **more)

        monkeypatch.setattr(atc.deposit, "make", make)


def test_only_what_is_needed_is_computed(monkeypatch):
    frame, grid, kern = argon(), atc.Grid.regular(shape=(2, 3, 2)), atc.kernel("quartic", radius=5.5)
    spy = _Spy(monkeypatch)

    def run(quantities, frame=frame):
        pot = BruteLJ()
        spy.made.clear()
        atc.fields(frame, pot, kern, grid, quantities)
        return pot.calls, sorted(set(spy.made))

    assert run(["density"]) == ([], [(1, 0)])  # no neighbour search, no bonds, one component
    assert run(["velocity", "density", "momentum"]) == ([], [(4, 0)])
    calls, made = run(["stress_potential"], frame.replace(velocities=None, masses=None))
    assert len(calls) == 1 and not calls[0]["energies"] and not calls[0]["forces"] and made == [(0, 6)]
    calls, made = run(["stress", "temperature", "density"])
    assert len(calls) == 1 and made == [(0, 6), (12, 0)]  # one pass each for everything
    calls, made = run(["virial_stress"])
    assert len(calls) == 1 and made == []  # no grid sums at all
    calls, made = run(["energy_potential"])
    assert len(calls) == 1 and calls[0]["energies"] and made == [(1, 0)]
    calls, made = run(["smoothed_virial_stress_potential"])
    assert len(calls) == 1 and made == [(6, 0)]
    assert run(["virial_stress_per_atom_kinetic"]) == ([], [])


def test_work_names_its_users():
    work = Work.of(["stress", "density"])
    assert work.attributes["velocities"] == ["stress", "stress_kinetic"]
    assert work.bond_users == ["stress", "stress_potential"]
    assert "density" in work.attributes["masses"] and not work.energy_users and not work.reference_users


@pytest.mark.parametrize(
    "remove, quantities, words",
    [
        ({"velocities": None}, ["temperature"], ("velocities", "temperature")),
        ({"velocities": None}, ["stress"], ("velocities", "stress")),
        ({"masses": None}, ["density"], ("masses", "density")),
    ],
)
def test_what_is_missing_is_named(remove, quantities, words):
    frame = argon().replace(**remove)
    with pytest.raises(AtcError) as e:
        atc.fields(frame, BruteLJ(), atc.kernel("quartic", radius=5.6), atc.Grid.regular(shape=(2, 2, 2)), quantities)
    for word in words:
        assert word in str(e.value)
    assert "\n" not in str(e.value)


def test_missing_arguments_and_unknown_names():
    frame, grid, kern = argon(), atc.Grid.regular(shape=(2, 2, 2)), atc.kernel("quartic", radius=5.5)
    for call, words in [
        (lambda: atc.fields(frame, None, kern, grid, ["stress"]), ["potential", "stress"]),
        (lambda: atc.fields(frame, BruteLJ(), None, grid, ["density"]), ["kernel", "density"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, None, ["density"]), ["grid", "density"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["piola_stress"]), ["reference"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["densty"]), ["densty", "did you mean 'density'"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, []), ["quantities"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["density"], method="magic"), ["magic", "direct"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["density"], 0.0), ["tolerance"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["density"], average=0), ["average"]),
        (lambda: atc.fields(frame, BruteLJ(), kern, grid, ["density"], workers=0), ["workers"]),
        (lambda: atc.fields(frame, BruteLJ(units="lj"), kern, grid, ["stress"]), ["lj", "metal"]),
        (lambda: atc.fields([], BruteLJ(), kern, grid, ["density"]), []),
    ]:
        with pytest.raises(AtcError) as e:
            call()
        for word in words:
            assert word in str(e.value)


def test_units_only_relabel():
    """The same physical system in two unit styles: internal numbers agree to the constants' rounding, results to the
    factors."""
    frame = argon()
    other = frame.replace(units=atc.units.units("nano"))
    kern = atc.kernel("quartic", radius=5.5)
    points = frame.cell.cartesian(np.random.default_rng(0).random((4, 3)))
    a = atc.fields(frame, BruteLJ(), kern, atc.Grid.points(points), ALL)
    b = atc.fields(other, BruteLJ(), atc.kernel("quartic", radius=0.55), atc.Grid.points(points / 10), ALL)
    for q in ALL:
        d = QUANTITIES[q].dimension
        x, y = frame.units.to_internal(d, a[q].values), other.units.to_internal(d, b[q].values)
        if q == "temperature":  # each style has its own Boltzmann constant
            x, y = x * frame.units.boltzmann, y * other.units.boltzmann
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * np.abs(x).max(), err_msg=q)
    assert b.stress.attrs["units"] == "ag/(nm*ns^2)" and b.number_density.attrs["units"] == "1/nm^3"


def test_vacuum_is_masked_and_sums_stay_zero():
    frame = argon("slab", n=(2, 2, 1), jitter=0.1)
    z = frame.positions[:, 2].mean()
    points = np.array([[1.0, 1.0, z], [1.0, 1.0, z + 11.5]])
    ds = atc.fields(frame, BruteLJ(), atc.kernel("quartic", radius=4.0), atc.Grid.points(points), ALL).isel(frame=0)
    assert ds.mask.values.tolist() == [True, False]
    for q in ("velocity", "temperature", "stress_kinetic", "stress"):
        assert np.isnan(ds[q].values[1]).all() and np.isfinite(ds[q].values[0]).all()
    for q in ("density", "number_density", "momentum", "energy", "stress_potential", "smoothed_virial_stress"):
        assert (ds[q].values[1] == 0).all()


def test_no_atoms_and_one_atom():
    kern, grid = atc.kernel("quartic", radius=4.0), atc.Grid.regular(shape=(3, 3, 3))
    one = argon(n=(1, 1, 1))
    ds = atc.fields(one, BruteLJ(cutoff=4.0), kern, grid, ALL).isel(frame=0)
    inside = ds.mask.values
    assert 0 < inside.sum() < inside.size
    # nothing can be said of the thermal motion of one atom: it has none about its own velocity, but for 1e-12 of m v²
    scale = float(one.masses[0] * (one.velocities[0] ** 2).sum() / one.units.boltzmann)
    assert np.isnan(ds.temperature).all()
    local = atc.fields(one, None, kern, grid, ["temperature", "stress_kinetic"], velocity="local").isel(frame=0)
    assert np.abs(local.temperature.values[inside]).max() < 1e-12 * scale
    assert np.array_equal(ds.stress_kinetic.values[inside], local.stress_kinetic.values[inside])
    np.testing.assert_allclose(
        ds.velocity.values[inside],
        np.broadcast_to(one.units.to_user("velocity", one.velocities[0]), (inside.sum(), 3)),
        rtol=1e-13,
    )
    none = one.replace(
        positions=np.zeros((0, 3)), velocities=np.zeros((0, 3)), masses=np.zeros(0), types=None, ids=None
    )
    ds = atc.fields(none, BruteLJ(cutoff=4.0), kern, grid, ["density", "stress", "temperature"]).isel(frame=0)
    assert (
        (ds.density == 0).all()
        and (ds.stress_potential == 0).all()
        and not ds.mask.any()
        and np.isnan(ds.temperature).all()
    )


def test_uniform_drift_of_a_million_thermal_speeds():
    frame = argon(seed=8)
    kern, grid = atc.kernel("quartic", radius=5.5), atc.Grid.regular(shape=(3, 3, 3))
    thermal = np.sqrt(frame.units.boltzmann * 80.0 / 39.948)
    fast = frame.replace(velocities=frame.velocities + 1e6 * thermal * np.array([1.0, -2.0, 0.5]))
    names = ["stress", "temperature", "virial_stress", "virial_stress_per_atom", "smoothed_virial_stress"]
    a, b = (atc.fields(f, BruteLJ(), kern, grid, names) for f in (frame, fast))
    for q in names:
        np.testing.assert_allclose(b[q], a[q], rtol=0, atol=1e-6 * float(abs(a[q]).max()), err_msg=q)
    assert np.abs(b.temperature / a.temperature - 1).max() < 1e-6


def test_two_streams_at_a_million_thermal_speeds(monkeypatch):
    """One velocity shift is not enough: the two halves fly apart at 1e6 thermal speeds each, 1e12 in the kinetic
    energy."""
    frame = argon(atc.Cell([9.0, 10.0, 44.0]), n=(2, 3, 8), seed=9)
    z = frame.positions[:, 2]
    upper = z > 22
    thermal = np.sqrt(frame.units.boltzmann * 80.0 / 39.948)
    kick = np.where(upper[:, None], 1.0, -1.0) * 1e6 * thermal * np.array([1.0, 0.3, -0.2])
    # keep the rounding of the velocities themselves out of the comparison
    fast = frame.velocities + kick
    frame = frame.replace(velocities=fast - kick)
    moving = frame.replace(velocities=fast)
    kern = atc.kernel("quartic", radius=4.0)
    points = np.array([[3.0, 3.0, h] for h in (8.0, 11.0, 30.0, 35.0)])
    passes = []
    real = Deposits.sites
    monkeypatch.setattr(Deposits, "sites", lambda self, x, a: passes.append(1) or real(self, x, a))
    a = atc.fields(frame, None, kern, atc.Grid.points(points), ["stress_kinetic", "temperature"])
    quiet = len(passes)
    with pytest.warns(AtcWarning, match="temperature"):
        b = atc.fields(moving, None, kern, atc.Grid.points(points), ["stress_kinetic", "temperature"])
    assert quiet == 2 and len(passes) - quiet > 2  # the extra passes come only where they are needed
    for q in ("temperature", "stress_kinetic"):
        np.testing.assert_allclose(b[q], a[q], rtol=0, atol=1e-6 * float(abs(a[q]).max()), err_msg=q)


def test_unreasonable_input_is_a_warning_that_names_the_cause():
    frame = argon(seed=2)
    kern, grid = atc.kernel("quartic", radius=5.5), atc.Grid.regular(shape=(3, 3, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atc.fields(frame, None, kern, grid, ["temperature"])
    hot = frame.replace(velocities=frame.velocities * 100)  # Å/fs read as Å/ps would be 1000
    with pytest.warns(AtcWarning, match="units"):
        atc.fields(hot, None, kern, grid, ["temperature"])
    with pytest.warns(AtcWarning, match="density"):
        atc.fields(frame.replace(masses=frame.masses * 1000), None, kern, grid, ["density"])
    with pytest.warns(AtcWarning, match="kernel"):
        atc.fields(frame, None, atc.kernel("quartic", radius=2.0), grid, ["density"])


def test_measured_error_sees_an_error(monkeypatch):
    """Spoil the main sum by 1e-7: the measured error must say 1e-7."""
    frame, kern, grid = argon(), atc.kernel("quartic", radius=5.5), atc.Grid.regular(shape=(6, 6, 6))
    good = atc.fields(frame, BruteLJ(), kern, grid, ["density", "stress_potential"])
    assert good.attrs["measured_error"] < 1e-13
    real = Deposits.sites
    spoiled = lambda self, x, a: real(self, x, a) * (1 + 1e-7 * (self.bound.dims != ("point",)))  # noqa: E731
    monkeypatch.setattr(Deposits, "sites", spoiled)
    bad = atc.fields(frame, BruteLJ(), kern, grid, ["density", "stress_potential"])
    assert 0.5e-7 < bad.density.attrs["error_max"] <= 1.01e-7
    assert abs(bad.density.attrs["error_l2"] / 1e-7 - 1) < 0.2
    assert bad.density.attrs["error_of_fluctuation"] > bad.density.attrs["error_max"]
    assert bad.attrs["measured_error"] == bad.density.attrs["error_max"]
    with pytest.warns(AtcWarning, match="tolerance"):
        atc.fields(frame, BruteLJ(), kern, grid, ["density"], 1e-9)
