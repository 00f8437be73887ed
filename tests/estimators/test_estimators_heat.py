"""Heat flux, churning and heat current: against brute force, against LAMMPS, against d/dt Σ e r, and through changes of
frame."""

import numpy as np
import pytest
from energy_systems import NAMES, SMOOTH, lammps_potentials, potential, system
from frames import argon
from lammps_oracle import Config, run_lammps, thermal_lattice
from naive_fields import BruteLJ, bond_sum, site_sum
from test_estimators_fields import _Spy

import atc
from atc.errors import AtcError, AtcWarning
from atc.estimators.registry import QUANTITIES
from atc.estimators.tensors import curl
from atc.estimators.work import Work
from atc.frame import Cell, Frame
from atc.units import units

FLUXES = ["heat_flux", "energy_flux", "churning", "churning_divergence", "churning_heat_source", "heat_current"]
KERN = ("quartic", 4.5)


def points_near(frame, n=6, seed=3):
    rng = np.random.default_rng(seed)
    return frame.positions[rng.permutation(len(frame))[:n] % len(frame)] + rng.uniform(
        -0.8, 0.8, (min(n, len(frame)), 3)
    )


def ordered(bonds):
    """Both ordered pairs (j, k) of every bond: starting points' atoms, x_jk, ∂U^(j)/∂x_k and the atoms k."""
    j, k = np.concatenate([bonds.i, bonds.j]), np.concatenate([bonds.j, bonds.i])
    x_jk = np.concatenate([bonds.r_bc, -bonds.r_bc])
    D = np.concatenate([bonds.D_bdc[:, 0], bonds.D_bdc[:, 1]])
    return j, k, x_jk, D


def naive(frame, kern, points, pot):
    """formulas.md §4 letter by letter, in the frame of the simulation; internal units."""
    x, v, m, cell = frame.positions, frame.velocities, frame.masses, frame.cell
    d = pot.decompose(frame, sources=True)
    b = d.bonds
    e = 0.5 * m * (v * v).sum(1) + d.energies_n

    def site(a):
        return site_sum(points, x, a.reshape(len(x), -1), kern, cell)

    rho, eps = site(m)[:, 0], site(e)[:, 0]
    v_g = site(m[:, None] * v) / rho[:, None]
    T = site(m[:, None, None] * v[:, :, None] * v[:, None, :]).reshape(-1, 3, 3)
    sigma_K = -(T - rho[:, None, None] * v_g[:, :, None] * v_g[:, None, :])
    J = site(e[:, None] * v)
    S = bond_sum(
        points, x[b.i], b.r_bc, np.einsum("b,bi,bj->bij", b.G_b, b.r_bc, b.r_bc).reshape(-1, 9), kern, cell
    ).reshape(-1, 3, 3)
    # the bond (j, k) and the bond (k, j) are the same line: both start at x_i of the unordered bond
    j, k, x_jk, D = ordered(b)
    start, line = np.tile(x[b.i], (2, 1)), np.tile(b.r_bc, (2, 1))
    A = bond_sum(points, start, line, (v[k] * D).sum(1)[:, None] * x_jk, kern, cell)
    M = bond_sum(points, start, line, (x_jk[:, :, None] * D[:, None, :]).reshape(-1, 9), kern, cell).reshape(-1, 3, 3)
    z = S + M
    # ∂φ(x_j − x)/∂x = −∇φ(d)
    slope = lambda a: np.stack([site_gradient(points, x, a.reshape(len(x), -1), kern, cell, c) for c in range(3)], 1)  # noqa: E731
    L = (slope(m[:, None] * v) - slope(m) * v_g[:, None, :]) / rho[:, None, None]
    out = {
        "heat_flux_kinetic": J - eps[:, None] * v_g + np.einsum("gij,gj->gi", sigma_K, v_g),
        "heat_flux_potential": A - np.einsum("gij,gj->gi", M, v_g),
        "heat_flux_churning": np.einsum("gij,gj->gi", z, v_g),
        "energy_flux": J + A,
        "churning": z,
        "churning_divergence": np.zeros_like(v_g),
        "churning_heat_source": np.einsum("gij,gij->g", z, L),
        "heat_current_convective": e @ v,
        "heat_current_potential": ((v[k] * D).sum(1)[:, None] * x_jk).sum(0),
    }
    out["heat_flux"] = out["heat_flux_kinetic"] + out["heat_flux_potential"] + out["heat_flux_churning"]
    out["heat_current"] = out["heat_current_convective"] + out["heat_current_potential"]
    # What the differences above are made of sets their rounding error.
    size = {
        "churning": np.abs(S).max(),
        "churning_divergence": np.abs(site(np.abs(d.forces_nc))).max() + np.abs(S).max(),
        "heat_flux_churning": np.abs(S).max() * np.abs(v_g).max(),
        "churning_heat_source": np.abs(S).max() * np.abs(L).max(),
        "heat_flux_kinetic": np.abs(J).max(),
        "heat_flux_potential": np.abs(A).max(),
        "heat_flux": np.abs(J).max() + np.abs(A).max(),
    }
    return out, size


def site_gradient(points, x, a, kern, cell, c):
    """∂/∂x_c of Σ a φ(x_j − x): from grad_phi of the kernel, summed by brute force."""

    class Component:
        support = kern.support

        @staticmethod
        def phi(d):
            return -kern.grad_phi(d)[..., c]

    return site_sum(points, x, a, Component, cell)


@pytest.mark.parametrize("name", ["lj", "sw", "eam", "tersoff", "dihedral opls", "5-body"])
def test_every_quantity_is_its_definition(name):
    frame, pot = system(name)
    kern, points = atc.kernel(*KERN), points_near(frame)
    ds = atc.fields(frame, pot, kern, atc.Grid.points(points), FLUXES, threads=2)
    want, size = naive(frame, kern, points, pot)
    assert set(want) | {"mask"} == set(ds.data_vars)
    for q, w in want.items():
        got = frame.units.to_internal(QUANTITIES[q].dimension, ds[q].values[0])
        # rounding of sums of a few hundred terms, on the scale of what is subtracted
        np.testing.assert_allclose(got, w, rtol=0, atol=5e-12 * size.get(q, np.abs(w).max()), err_msg=q)
        assert ds[q].attrs["units"] and ds[q].attrs["long_name"] and ds[q].attrs["sign_convention"]
        assert "depends on how" in ds[q].attrs["comment"] or q == "churning_divergence"
        if q != "heat_current" and QUANTITIES[q].kind == "grid":
            assert ds[q].attrs["error_max"] < 1e-9, q  # also where the field is 0 but for rounding
    z = np.abs(want["churning"]).max() / size["churning"]
    # D0 − D1 = −G r for every pair, whoever has the embedding energy
    assert (z < 1e-14) if name in ("lj", "eam") else (z > 1e-4), (name, z)
    assert pot.describe() == ds.attrs["decomposition"]


@pytest.mark.parametrize("name", NAMES)
def test_energy_flux_is_what_its_parts_say(name):
    """J + A = ε v − σ v + q, and the churning tensor has no divergence: the force follows from the energy sources at
    every atom."""
    frame, pot = system(name, seed=1)
    grid = atc.Grid.points(points_near(frame, 12))
    names = ["energy", "stress", "velocity", "momentum", *FLUXES, "density"]
    ds = atc.fields(frame, pot, atc.kernel(*KERN), grid, names, velocity="local").isel(frame=0)
    f = {q: frame.units.to_internal(QUANTITIES[q].dimension, ds[q].values) for q in ds.data_vars if q in QUANTITIES}
    v = f["velocity"]
    total = f["energy"][:, None] * v - np.einsum("gij,gj->gi", f["stress"], v) + f["heat_flux"]
    scale = (
        np.abs(f["energy_flux"]).max() + np.abs(f["heat_flux_potential"]).max() + np.abs(f["energy"][:, None] * v).max()
    )
    # rounding: sums of some hundred terms, and differences of them
    np.testing.assert_allclose(total, f["energy_flux"], rtol=0, atol=1e-12 * scale)
    forces = np.abs(pot.decompose(frame).forces_nc).max()
    assert np.abs(f["churning_divergence"]).max() < 1e-10 * forces * atc.kernel(*KERN).peak * len(frame)


def _finest(cell, h):
    return tuple(np.maximum(np.ceil(np.linalg.norm(cell.vectors, axis=1) / h), 1).astype(int))


@pytest.mark.parametrize("partition", ["equal", "center"])
def test_integrals_over_the_box(partition):
    """∫ energy_flux = heat_current; ∫ z = 0; and with a kernel far wider than the box ∫ q = heat_current of a box at
    rest."""
    frame, pot = system("sw", partition, seed=2)
    frame = frame.replace(velocities=frame.velocities - frame.masses @ frame.velocities / frame.masses.sum())
    # A Gaussian of width 1.2 on a grid of 0.6: the trapezoidal rule's error is exp(-2 π² (w/h)²) = 1e-34.
    grid = atc.Grid.regular(shape=_finest(frame.cell, 0.6))
    volume = frame.units.to_user("volume", frame.cell.volume)
    ds = atc.fields(
        frame,
        pot,
        atc.kernel("gaussian", width=1.2),
        grid,
        ["energy_flux", "heat_current", "churning", "stress_potential"],
        tolerance=1e-12,
    ).isel(frame=0)
    u = frame.units
    flux = ds.energy_flux.mean(("x", "y", "z")) * volume
    current = u.to_internal("energy_current", ds.heat_current.values)
    # 1e-10: the direct deposit cuts Gaussians at 1e-16 of their peak
    np.testing.assert_allclose(
        u.to_internal("energy_flux", flux.values) * u.factor("volume"),
        current,
        rtol=0,
        atol=1e-10 * np.abs(current).max(),
    )
    assert abs(ds.churning.mean(("x", "y", "z"))).max() < 1e-10 * abs(ds.churning).max()
    assert abs(ds.churning).max() > 0
    wide = atc.fields(
        frame,
        pot,
        atc.kernel("gaussian", width=12.0),
        atc.Grid.points(frame.positions[:2]),
        ["heat_flux"],
        tolerance=1e-12,
    ).isel(frame=0)
    # exp(-2 π² w²/a²) is 1e-42: at this width every field is its mean
    got = u.to_internal("energy_flux", wide.heat_flux.values) * frame.cell.volume
    np.testing.assert_allclose(got, np.tile(current, (2, 1)), rtol=0, atol=1e-9 * np.abs(current).max())


@pytest.mark.parametrize("name", ["sw", "tersoff", "angle harmonic", "dihedral opls", "4-body", "5-body"])
def test_what_depends_on_the_partition(name):
    """q and z do; σ, the total energy and the divergence of z do not; ∫ z stays 0 (tested above)."""
    frame, equal = system(name, "equal", seed=3)
    _, center = system(name, "center", seed=3)
    grid, kern = atc.Grid.points(points_near(frame)), atc.kernel(*KERN)
    names = ["stress_potential", "heat_flux", "churning", "churning_divergence"]
    a, b = (atc.fields(frame, pot, kern, grid, names) for pot in (equal, center))
    assert a.attrs["decomposition"] != b.attrs["decomposition"]
    np.testing.assert_allclose(
        a.stress_potential, b.stress_potential, rtol=0, atol=1e-12 * float(abs(a.stress_potential).max())
    )
    for q in ("heat_flux", "churning"):
        assert float(abs(a[q] - b[q]).max()) > 1e-3 * float(abs(a[q]).max()), q
    for ds in (a, b):
        z = frame.units.to_internal("energy_density", float(abs(ds.churning).max()))
        # force density against z over a length of the kernel
        assert frame.units.to_internal("force_density", float(abs(ds.churning_divergence).max())) < 1e-10 * z


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_a_drift_changes_nothing_but_zc(name):
    frame, pot = system(name, seed=4)
    c = 1e6 * 0.05 * np.array([1.0, -2.0, 0.5])
    # keep the rounding of the velocities themselves out of the comparison
    fast = frame.velocities + c
    frame, moving = frame.replace(velocities=fast - c), frame.replace(velocities=fast)
    kern, grid = atc.kernel(*KERN), atc.Grid.points(points_near(frame))
    names = ["heat_flux", "churning", "churning_heat_source", "velocity_gradient"]
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        a, b = (atc.fields(f, pot, kern, grid, names).isel(frame=0) for f in (frame, moving))
    for q in ("heat_flux_kinetic", "heat_flux_potential", "churning", "churning_heat_source", "velocity_gradient"):
        # promised: 1e-6
        scale = float(abs(a[q]).max()) if name != "lj" or "churning" not in q else 1.0
        np.testing.assert_allclose(b[q], a[q], rtol=0, atol=1e-6 * scale, err_msg=q)
    u = frame.units
    zc = np.einsum("gij,j->gi", u.to_internal("energy_density", a.churning.values), c)
    difference = u.to_internal("energy_flux", (b.heat_flux_churning - a.heat_flux_churning).values)
    if name == "lj":
        assert np.abs(difference).max() < 1e-6 * u.to_internal("energy_flux", float(abs(a.heat_flux).max()))
    else:
        np.testing.assert_allclose(difference, zc, rtol=0, atol=1e-9 * np.abs(zc).max())


def test_two_streams():
    """Two halves that fly apart: the third moment cancels like the cube of the speed, so shifts are needed much earlier
    than for the stress."""
    frame = argon(Cell([9.0, 10.0, 44.0]), n=(2, 3, 8), seed=9)
    upper = frame.positions[:, 2] > 22
    thermal = np.sqrt(frame.units.boltzmann * 80.0 / 39.948)
    kern = atc.kernel("quartic", radius=4.0)
    points = np.array([[3.0, 3.0, h] for h in (8.0, 11.0, 30.0, 35.0)])
    for speed in (50.0, 1e6):
        kick = np.where(upper[:, None], 1.0, -1.0) * speed * thermal * np.array([1.0, 0.3, -0.2])
        fast = frame.velocities + kick
        still, moving = frame.replace(velocities=fast - kick), frame.replace(velocities=fast)
        import warnings

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AtcWarning)
            a, b = (
                atc.fields(f, BruteLJ(), kern, atc.Grid.points(points), ["heat_flux_kinetic"]) for f in (still, moving)
            )
        np.testing.assert_allclose(
            b.heat_flux_kinetic, a.heat_flux_kinetic, rtol=0, atol=1e-6 * float(abs(a.heat_flux_kinetic).max())
        )


def test_rotation():
    """Everything turns with the atoms: vectors and both indices of z."""
    frame, pot = system("5-body", seed=5)
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    cell = Cell(frame.cell.vectors @ Q.T, frame.cell.origin @ Q.T, frame.cell.periodic)
    turned = frame.replace(positions=frame.positions @ Q.T, velocities=frame.velocities @ Q.T, cell=cell)
    points = points_near(frame)
    a, b = (
        atc.fields(f, pot, atc.kernel(*KERN), atc.Grid.points(p), [*FLUXES, "vorticity"]).isel(frame=0)
        for f, p in ((frame, points), (turned, points @ Q.T))
    )
    for q in ("heat_flux", "heat_flux_churning", "energy_flux", "heat_current", "vorticity"):
        np.testing.assert_allclose(
            b[q].values, a[q].values @ Q.T, rtol=0, atol=1e-11 * float(abs(a[q]).max()), err_msg=q
        )
    np.testing.assert_allclose(
        b.churning, np.einsum("ai,bj,gij->gab", Q, Q, a.churning), rtol=0, atol=1e-11 * float(abs(a.churning).max())
    )
    np.testing.assert_allclose(
        b.churning_heat_source, a.churning_heat_source, rtol=0, atol=1e-10 * float(abs(a.churning_heat_source).max())
    )


# --- heat current


def lammps_heat_flux(lines, config, stress="stress/atom"):
    """compute heat/flux: the current (not divided by the volume) and its convective part."""

    def extract(lmp):
        return np.array(lmp.numpy.extract_compute("flux", 0, 1))

    after = [
        "compute ke all ke/atom",
        "compute pe all pe/atom",
        f"compute s all {stress} NULL virial",
        "compute flux all heat/flux ke pe s",
        "thermo_style custom step c_flux[*] temp pe ke vol pxx pyy pzz pxy pxz pyz c__pv[*] evdwl ecoul ebond eangle "
        "edihed eimp c__rpe[*]",
        "thermo_modify lost error norm no flush no",
        "run 0 post no",
    ]
    flux = run_lammps(lines, config, after=after, extract=extract).extra["extract"]
    return flux[:3], flux[3:]


def hot_config(cell, counts, kinds=2, seed=0, style="metal", jitter=0.2, speed=3.0):
    cell = np.asarray(cell, float)
    x, t = thermal_lattice(cell, counts, jitter=jitter, kinds=kinds, seed=seed)
    v = speed * np.random.default_rng(seed).normal(size=x.shape) + speed * np.array([0.2, 0.1, -0.1])
    return Config(
        cell, x, types=t, masses={k + 1: 20.0 + 15 * k for k in range(kinds)}, velocities=v, units=style, ntypes=kinds
    )


TILTED = np.array([[11.0, 0, 0], [2.5, 12.0, 0], [-2.0, 3.0, 13.0]])


@pytest.mark.parametrize(
    "lines, style",
    [
        ("pair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3", "metal"),
        ("pair_style morse 6.0\npair_coeff * * 0.3 1.4 2.4", "metal"),
        ("pair_style lj/cut 6.0\npair_coeff * * 0.24 3.4", "real"),
    ],
)
def test_pair_potentials_agree_with_lammps(lines, style):
    config = hot_config(TILTED, (3, 3, 4), style=style, speed=3.0 if style == "metal" else 0.003)
    total, convective = lammps_heat_flux(lines, config)
    ds = atc.fields(config.frame(), atc.potential(lines, units=style), quantities=["heat_current"]).isel(frame=0)
    # LAMMPS's own sums; 1e-10 is promised
    np.testing.assert_allclose(ds.heat_current_convective, convective, rtol=0, atol=1e-10 * np.abs(convective).max())
    np.testing.assert_allclose(ds.heat_current, total, rtol=0, atol=1e-10 * np.abs(total).max())
    assert np.abs(total - convective).max() > 1e-3 * np.abs(total).max()
    assert ds.heat_current.attrs["units"] == ("eV*(angstrom/ps)" if style == "metal" else "kcal/mol*(angstrom/fs)")


def current(frame, pot):
    return atc.fields(frame, pot, quantities=["heat_current"]).heat_current.values[0]


@pytest.mark.parametrize(
    "name", [n for n in SMOOTH if n.split()[0] in ("lj", "morse", "atm", "3-body", "4-body", "5-body")]
)
def test_current_is_the_rate_of_the_energy_moment(name):
    """d/dt Σ e_j r_j of an isolated cluster by central differences along the exact motion; the error falls with the
    square of the step."""
    frame, pot = system(name, seed=6)
    rate_is_the_current(frame, pot)


def rate_is_the_current(frame, pot, steps=(2e-2, 1e-2), slope=True):
    u = frame.units
    want = u.to_internal("energy_current", current(frame, pot))

    def moment(t):
        # x and v along the trajectory to third order in t: the error of the central difference is then its own, of
        # second order
        d = pot.decompose(frame)
        a = d.forces_nc / frame.masses[:, None]
        f = lambda h: pot.decompose(frame.replace(positions=frame.positions + h * frame.velocities)).forces_nc  # noqa: E731
        jerk = (f(1e-4) - f(-1e-4)) / 2e-4 / frame.masses[:, None]
        x = frame.positions + t * frame.velocities + t**2 / 2 * a + t**3 / 6 * jerk
        v = frame.velocities + t * a + t**2 / 2 * jerk
        e = pot.decompose(frame.replace(positions=x)).energies_n + 0.5 * frame.masses * (v * v).sum(1)
        return e @ x

    errors = [np.abs((moment(h) - moment(-h)) / (2 * h) - want).max() for h in steps]
    assert errors[1] < 1e-3 * np.abs(want).max()
    if slope:
        assert abs(np.log(errors[0] / errors[1]) / np.log(steps[0] / steps[1]) - 2) < 0.1, errors
    return errors


def silicon_cluster(seed=0):
    """Silicon atoms of a piece of crystal, shaken, in open space."""
    a = 5.431
    s = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4 * a
    rng = np.random.default_rng(seed)
    x = s + rng.uniform(-0.1, 0.1, s.shape)
    return Frame(
        x,
        Cell([40.0] * 3, periodic=(False,) * 3),
        units("metal"),
        masses=np.full(8, 28.0855),
        velocities=0.05 * rng.normal(size=x.shape),
    )


@pytest.mark.parametrize("partition", ["equal", "center"])
def test_silicon_cluster(partition):
    """Stillinger-Weber, for which LAMMPS has no heat flux: with either partition the current is the rate of its own
    energy moment."""
    rate_is_the_current(silicon_cluster(), potential("sw", partition))


def test_embedded_atoms():
    """Embedding energies belong to their own atoms. LAMMPS gives each atom half of every pair's virial instead (its
    centroid/stress/atom too), which is the rate of the energy moment only where the slopes of the embedding functions
    are equal: its number is reproduced from our bonds, the rate is ours."""
    lines = f"pair_style eam/alloy\npair_coeff * * {lammps_potentials()}/Cu_mishin1.eam.alloy Cu Cu"
    pot = atc.potential(lines, units="metal")
    config = hot_config(np.diag([9.0, 9.5, 10.0]), (3, 4, 4), seed=3, jitter=0.1)
    # LAMMPS takes the mass from the potential's file.
    mass = float((lammps_potentials() / "Cu_mishin1.eam.alloy").read_text().splitlines()[5].split()[1])
    config.masses = {1: mass, 2: mass}
    frame = config.frame()
    total, convective = lammps_heat_flux(lines, config, "centroid/stress/atom")
    ds = atc.fields(frame, pot, quantities=["heat_current"]).isel(frame=0)
    np.testing.assert_allclose(ds.heat_current_convective, convective, rtol=0, atol=1e-10 * np.abs(convective).max())
    b = pot.decompose(frame).bonds
    halves = -0.5 * np.einsum("b,bc,bc,bd->d", b.G_b, b.r_bc, frame.velocities[b.i] + frame.velocities[b.j], b.r_bc)
    np.testing.assert_allclose(
        frame.units.to_user("energy_current", halves), total - convective, rtol=0, atol=1e-10 * np.abs(total).max()
    )
    difference = np.abs(ds.heat_current.values - total).max() / np.abs(total).max()
    assert 1e-4 < difference < 0.5, difference
    cluster = Frame(
        frame.positions[:14],
        Cell([60.0] * 3, periodic=(False,) * 3),
        frame.units,
        types=frame.types[:14],
        masses=frame.masses[:14],
        velocities=frame.velocities[:14],
    )
    # Splines have jumps in the third derivative, so the order of the error is not tested.
    rate_is_the_current(cluster, pot, steps=(4e-3, 2e-3), slope=False)


# --- work and masks


def test_only_what_is_needed_is_computed(monkeypatch):
    frame, grid, kern = argon(), atc.Grid.regular(shape=(2, 3, 2)), atc.kernel("quartic", radius=5.5)
    spy = _Spy(monkeypatch)
    gathers = []
    import atc.deposit.gradient as module

    real = module.gather
    monkeypatch.setattr(module, "gather", lambda *a: gathers.append(a[6]) or real(*a))

    def run(quantities, frame=frame):
        pot = BruteLJ()
        spy.made.clear()
        gathers.clear()
        atc.fields(frame, pot, kern, grid, quantities)
        # the first call tells unfinished outputs apart; main sum and check alike
        return [c["sources"] for c in pot.calls], sorted(set(spy.made)), gathers[:]

    assert run(["stress", "energy", "temperature"]) == (
        [False],
        [(0, 6), (14, 0)],
        [False, False],
    )  # no sources unless heat is asked for; φ² and the number of atoms, for what few of them lack of thermal motion
    assert run(["heat_flux"]) == ([True], [(0, 18), (17, 0)], [])
    assert run(["churning"], frame.replace(velocities=None, masses=None)) == ([True], [(0, 15)], [])
    assert run(["churning_divergence"], frame.replace(velocities=None, masses=None)) == ([True], [(4, 0)], [])
    assert run(["heat_flux_kinetic"]) == ([False], [(17, 0)], [])
    assert run(["heat_flux_potential"]) == ([True], [(0, 12), (4, 0)], [])
    assert run(["energy_flux"]) == ([True], [(0, 3), (3, 0)], [])
    assert run(["heat_current"]) == ([True], [], [])
    # mass and momentum come with their gradients
    assert run(["velocity_gradient"]) == ([], [], [True, True])
    assert run(["churning_heat_source"]) == ([True], [(0, 15)], [True, True])


def test_plan_says_so():
    frame, grid, kern = argon(), atc.Grid.regular(shape=(2, 3, 2)), atc.kernel("quartic", radius=5.5)
    heat = str(atc.running.run.plan(frame, BruteLJ(), kern, grid, ["heat_flux"]))
    assert "energy sources" in heat.split("what is left out")[0] and "18" not in heat.split("what is left out")[1]
    stress = str(atc.running.run.plan(frame, BruteLJ(), kern, grid, ["stress"]))
    assert "energy sources of the bonds: no heat flux" in stress and "gradient of the kernel" in stress
    gradient = str(atc.running.run.plan(frame, BruteLJ(), kern, grid, ["vorticity"]))
    assert "Σ a ∂φ/∂x" in gradient and "energy sources of the bonds" not in gradient
    assert Work.of(["heat_flux"]).source_users == ["heat_flux", "heat_flux_potential", "heat_flux_churning"]


def test_vacuum_is_masked_and_sums_stay_zero():
    frame = argon("slab", n=(2, 2, 1), jitter=0.1)
    z = frame.positions[:, 2].mean()
    points = np.array([[1.0, 1.0, z], [1.0, 1.0, z + 11.5]])
    ds = atc.fields(frame, BruteLJ(), atc.kernel("quartic", radius=4.0), atc.Grid.points(points), FLUXES).isel(frame=0)
    assert ds.mask.values.tolist() == [True, False]
    for q in ("heat_flux", "heat_flux_kinetic", "heat_flux_potential", "heat_flux_churning", "churning_heat_source"):
        assert np.isnan(ds[q].values[1]).all() and np.isfinite(ds[q].values[0]).all(), q
    for q in ("energy_flux", "churning", "churning_divergence"):
        assert (ds[q].values[1] == 0).all(), q


def test_grids_agree():
    """The same numbers on a lattice, at points and, averaged, in slabs; error measured at rounding level."""
    frame, pot = system("sw", seed=7)
    kern = atc.kernel("quartic", radius=4.5)
    names = [*FLUXES, "velocity_gradient"]
    box = atc.fields(frame, pot, kern, atc.Grid.regular(shape=(3, 4, 3)), names).isel(frame=0)
    i = np.indices((3, 4, 3)).reshape(3, -1).T
    xyz = frame.cell.cartesian((i + 0.5) / [3, 4, 3])
    at = atc.fields(frame, pot, kern, atc.Grid.points(xyz), names).isel(frame=0)
    for q in names:
        if q == "heat_current":
            continue
        n = box[q].values.reshape(at[q].shape)
        scale = np.abs(n).max() if q != "churning_divergence" else np.inf
        np.testing.assert_allclose(n, at[q].values, rtol=0, atol=min(1e-11 * scale, 1.0), err_msg=q)
        assert box[q].attrs["error_max"] < 1e-10
    slab = atc.fields(
        frame, pot, kern, atc.Grid.slab("z", 4), ["energy_flux", "churning", "energy", "heat_current"]
    ).isel(frame=0)
    # 4 bins of a periodic axis are not its mean: compare with the mean over a fine lattice of each plane instead
    fine = atc.fields(frame, pot, kern, atc.Grid.regular(shape=(12, 12, 4)), ["energy_flux", "churning"]).isel(frame=0)
    for q in ("energy_flux", "churning"):
        # 12 points a plane for a kernel of radius 4.5 whose second derivative has kinks: 1e-3
        np.testing.assert_allclose(
            fine[q].mean(("x", "y")), slab[q], rtol=0, atol=3e-3 * float(abs(slab[q]).max()), err_msg=q
        )


def test_curl():
    L = np.zeros((1, 3, 3))
    L[0, 0, 1], L[0, 1, 0] = 1.0, -1.0  # v = (−y, x, 0): ∂_x v_y = 1, ∂_y v_x = −1
    assert curl(L).tolist() == [[0.0, 0.0, 2.0]]


def test_discontinuous_kernels_are_refused():
    frame = argon()
    for kern in (atc.kernel("step", radius=5.0), atc.kernel("box", radius=5.0)):
        with pytest.raises(AtcError, match="jumps"):
            atc.fields(frame, BruteLJ(), kern, atc.Grid.regular(shape=2), ["churning_heat_source"])
