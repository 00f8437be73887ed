"""Fields of models with long-range Coulomb: the smooth part in every kind of grid, in averages, groups, tiles and
balances."""

import numpy as np
import pytest
from test_long_range import LJ, SIX, TRICLINIC, Naive, eight_ions, ions, salt_potential

import atc
from atc.decomposers.long_range import ewald
from atc.decomposers.long_range.kspace import converged, for_tolerance
from atc.decomposers.long_range.split import Split
from atc.errors import AtcError
from atc.estimators.driver import fields_of
from atc.estimators.field_pass import FieldSums
from atc.estimators.settings import Settings
from atc.grids import Grid

GAUSS = atc.kernel("gaussian", width=1.2)
LINES = "pair_style lj/cut/coul/long 4.5 5.0\n" + LJ + "kspace_style pppm 1e-4\n"
POINTS = np.random.default_rng(5).uniform(1, 9, (12, 3))


def settings(names, pot, grid, tolerance=1e-6, kern=GAUSS, **more):
    return Settings(tuple(names), pot, kern, grid, tolerance=tolerance, **more)


def test_the_smooth_part_against_the_sum_over_modes():
    """Every Q of the smoothed stress and energy current as a double sum over modes, then summed up at points."""
    frame, pot = eight_ions(), salt_potential(5.0, 1e-12)
    (term,) = pot.fields
    term = ewald.LongRangeCoulomb(Split.of(5.0, term.split.constant, 1e-4))
    kern = atc.kernel("gaussian", width=3.5)
    bound = Grid.points(POINTS).bind(frame.units, frame.cell, frame.positions)
    sums = FieldSums([term], ["stress", "power_lab", "sources"], bound, kern, 1e-9, 1)
    sums.add(frame, np.zeros(3))
    got = sums.on_grid()
    naive = Naive(term, frame, (7, 7, 8))
    total = np.zeros((12, 9))
    V = frame.cell.volume
    for Q in np.ndindex(5, 5, 5):
        Q = np.array(Q) - 2
        if tuple(Q) < (0, 0, 0):  # the other half of a real field
            continue
        k = Q @ naive.b.T
        phase = np.exp(1j * (POINTS - frame.cell.origin) @ k) * np.exp(-0.5 * (k @ k) * 3.5**2) / V * (1 + Q.any())
        sigma, A = naive.at(Q)
        total += (phase[:, None] * np.concatenate([sigma, A])).real
    assert np.abs(got["stress"] - total[:, :6]).max() < 2e-6 * np.abs(total[:, :6]).max()
    assert np.abs(got["power_lab"] - total[:, 6:]).max() < 2e-6 * np.abs(total[:, 6:]).max()
    full = got["stress"][:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    np.testing.assert_array_equal(got["sources"], -full.reshape(-1, 9))


GRIDS = {
    "regular": Grid.regular(shape=(4, 5, 6)),
    "region": Grid.regular(vectors=(5, 6, 7), origin=(1, 0, 2), shape=(3, 3, 4)),
    "plane": Grid.plane(axis="y", shape=(4, 5)),
    "tilted": Grid.plane((1, 1, 1), (4, 1, 0), (0, 3, 2), shape=(3, 4)),
    "line": Grid.line((0, 0, 0), (5, 4, 3), 5),
    "atoms": Grid.atoms(),
}


@pytest.mark.parametrize("name", GRIDS)
def test_grids_agree_with_points(name):
    frame = ions().frame()
    pot = atc.potential("units real\n" + LINES)
    bound = GRIDS[name].bind(frame.units, frame.cell, frame.positions)
    here = FieldSums(pot.fields, ["stress"], bound, GAUSS, 1e-7, 1)
    here.add(frame, np.zeros(3))
    a = here.on_grid()["stress"]
    b = here.at(np.arange(len(bound)))["stress"]
    assert np.abs(a - b).max() < 1e-7 * np.abs(b).max()


@pytest.mark.parametrize(
    "kern",
    [GAUSS, atc.kernel("lucy", 4.0), atc.kernel("quartic", 4.0), atc.kernel("bspline", 4.0)],
    ids=lambda k: k.name,
)
def test_the_error_found_keeps_the_tolerance(kern):
    frame = ions().frame()
    pot = atc.potential("units real\n" + LINES)
    result = fields_of([frame], settings(["stress"], pot, Grid.regular(shape=(5, 5, 5)), 1e-4, kern))
    assert result.errors["stress_potential"]["error_max"] < 1e-4
    assert 0 < result.errors["stress_potential"]["error_max"]


@pytest.mark.parametrize("name", ["step", "box"])
def test_kernels_that_jump_have_their_price(name):
    """Loose tolerances that they can keep; tighter ones are refused with how far the modes go."""
    frame, pot, kern = ions().frame(), atc.potential("units real\n" + LINES), atc.kernel(name, 4.0)
    rough, fine = (
        fields_of([frame], settings(["stress_potential"], pot, Grid.points(POINTS), t, kern)) for t in (0.1, 0.05)
    )
    a, b = (r.arrays["stress_potential"] for r in (rough, fine))
    assert 0 < np.abs(a - b).max() < 0.1 * np.abs(b).max()
    assert 0 < rough.errors["stress_potential"]["error_max"] < 0.1
    with pytest.raises(AtcError, match=f"kernel '{name}' decay too slowly .* over its radius"):
        fields_of([frame], settings(["stress_potential"], pot, Grid.points(POINTS), 1e-6, kern))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_the_split_keeps_the_tolerance_and_the_error_found_knows(tolerance):
    """Bonds end and modes are cut as the tolerance allows; alpha, and so the field, is the same for all of them."""
    frame, pot = ions().frame(), atc.potential("units real\n" + LINES)
    grid = Grid.points(POINTS)
    reference = converged(pot, 1e-12)
    want = fields_of([frame], settings(["stress_potential"], reference, grid, 1e-9, check_points=1))
    want = want.arrays["stress_potential"]
    mine = for_tolerance(pot, tolerance, exactly=False)
    assert mine.fields[0].split.alpha == pot.fields[0].split.alpha == reference.fields[0].split.alpha
    assert (mine.fields[0].split.cutoff < 5.0) == (tolerance > 1e-4)
    result = fields_of([frame], settings(["stress_potential"], mine, grid, tolerance))
    error = np.abs(result.arrays["stress_potential"] - want).max() / np.abs(want).max()
    assert error < tolerance
    # All points are those of the check; a split that is rougher than it may be is noticed.
    assert result.errors["stress_potential"]["error_max"] == pytest.approx(error, rel=0.5)
    rough = converged(pot, 1e3 * mine.fields[0].split.accuracy)
    result = fields_of([frame], settings(["stress_potential"], rough, grid, tolerance))
    assert result.errors["stress_potential"]["error_max"] > tolerance
    # Sums over the box have no tolerance.
    assert for_tolerance(pot, 1e-3, exactly=True).fields[0].split.cutoff == pytest.approx(5.0)


def test_what_depends_on_alpha():
    """Energy, forces, virial, the mean and the divergence of the stress do not; its values do."""
    frame = ions().frame()
    pots = [atc.potential("units real\n" + LINES, alpha=alpha) for alpha in (None, 1.1)]
    assert pots[1].fields[0].split.alpha == pytest.approx(1.1) and pots[0].fields[0].split.alpha < 0.82
    a, b = (pot.stream(frame, forces=True) for pot in pots)
    assert a.energy == pytest.approx(b.energy, rel=1e-7)
    assert np.abs(a.forces_nc - b.forces_nc).max() < 1e-6 * np.abs(a.forces_nc).max()
    assert np.abs(a.virial_cc - b.virial_cc).max() < 1e-6 * np.abs(a.virial_cc).max()
    grid = Grid.regular(shape=(20, 20, 20))
    a, b = (
        fields_of([frame], settings(["stress_potential"], pot, grid, 1e-7, check_points=1)).arrays["stress_potential"]
        for pot in pots
    )
    gauge = np.fft.fftn(b - a, axes=(0, 1, 2)) / np.abs(a).max() / 20**3
    n = np.stack(np.meshgrid(*[np.fft.fftfreq(20, 1 / 20)] * 3, indexing="ij"), -1)
    Q = n @ (2 * np.pi * np.linalg.inv(frame.cell.vectors)).T
    inside = np.abs(n).max(-1) < 10
    assert np.abs(b - a).max() > 1e-3 * np.abs(a).max()
    assert np.abs(gauge[0, 0, 0]).max() < 1e-6
    slope = np.abs(np.einsum("abci,abcij->abcj", Q, gauge)[inside]).max()
    assert slope < 1e-4 * np.abs(np.linalg.norm(Q, axis=-1)[..., None, None] * gauge)[inside].max()
    with pytest.raises(AtcError, match="alpha: the potential has no long-range Coulomb"):
        atc.potential("units real\npair_style lj/cut 4.5\n" + LJ, alpha=0.3)
    with pytest.raises(AtcError, match="alpha -1: expected a positive number"):
        atc.potential("units real\n" + LINES, alpha=-1)


def test_plan_and_output_say_what_the_modes_are_taken_on():
    from atc.planning.report import plan

    frame, pot = ions().frame(), atc.potential("units real\n" + LINES)
    asked = frame, pot, GAUSS, Grid.regular(shape=(3, 3, 3)), ["stress_potential"], 1e-4
    p = plan(*asked)
    (line,) = (line for line in p.passes if "long-range" in line)
    assert p.parts["long-range fields"] > 0 and "long-range fields" in str(p)
    # Energies and forces of the smooth part are neither wanted nor paid.
    assert "energy and forces of the long-range part" not in p.parts
    assert "energy and forces of the long-range part" in plan(*asked[:4], ["stress", "energy"], 1e-4).parts
    attrs = atc.fields(*asked).attrs
    assert attrs["coulomb_alpha"] == pytest.approx(pot.fields[0].split.alpha)
    assert attrs["coulomb_cutoff"] < 5.0 and attrs["coulomb_precision"] == "single"
    mesh, nodes = " x ".join(map(str, attrs["coulomb_mesh"])), attrs["coulomb_nodes"]
    assert f"mesh {mesh}, {nodes} nodes, single precision, {9 + 14 * nodes} transforms" in line
    assert 0 < attrs["measured_error"] < 1e-4


def test_the_mean_of_a_fine_grid_is_the_virial_and_slabs_are_means_of_planes():
    frame = ions().frame()
    pot = atc.potential("units real\n" + LINES)
    names = ["stress_potential", "virial_stress_potential"]
    out = fields_of([frame], settings(names, pot, Grid.regular(shape=(24, 24, 24)), 1e-8, check_points=5)).arrays
    virial = out["virial_stress_potential"]
    assert np.abs(out["stress_potential"].mean((0, 1, 2)) - virial).max() < 1e-8 * np.abs(virial).max()
    slab = fields_of([frame], settings(names, pot, Grid.slab("z", 24), 1e-8)).arrays["stress_potential"]
    assert np.abs(slab - out["stress_potential"].mean((0, 1))).max() < 1e-7 * np.abs(slab).max()


def test_divergence_of_the_stress_is_the_force_density():
    """∇·σ = Σ F_j φ(x − x_j), bonds and field together, by differences."""
    frame = ions().frame()
    pot = atc.potential("units real\n" + LINES)
    h, x = 2e-3, POINTS[:4]
    steps = np.concatenate([x + s * h * e for e in np.eye(3) for s in (1, -1, 2, -2)])
    s = fields_of([frame], settings(["stress_potential"], pot, Grid.points(steps), 1e-10)).arrays["stress_potential"]
    s = s.reshape(3, 4, 4, 3, 3)
    div = sum((8 * (s[a, 0] - s[a, 1]) - (s[a, 2] - s[a, 3]))[:, a] for a in range(3)) / (12 * h)
    forces = pot.stream(frame, forces=True).forces_nc
    d = frame.positions[None] - x[:, None]
    d -= np.rint(d @ frame.cell.inverse) @ frame.cell.vectors
    images = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3) @ frame.cell.vectors
    phi = sum(GAUSS.phi(d + image) for image in images)
    want = phi @ forces * frame.units.to_user("pressure", 1.0)
    # A stress of 1e-10 by steps of 2e-3.
    assert np.abs(div - want).max() < 1e-6 * np.abs(want).max()


def test_groups_tiles_and_wholes():
    frame = ions().frame()
    rng = np.random.default_rng(0)
    pot = atc.potential("units real\n" + LINES)
    names = [
        "stress",
        "virial_stress",
        "virial_stress_per_atom",
        "energy",
        "heat_flux",
        "heat_current",
        "smoothed_virial_stress",
    ]
    grid = Grid.regular(shape=(3, 4, 4))
    one = fields_of([frame], settings(names, pot, grid))
    np.testing.assert_allclose(
        one.arrays["virial_stress_per_atom_potential"].sum(0) / frame.cell.volume * 1.0,
        one.arrays["virial_stress_potential"] * frame.units.factor("pressure") / frame.units.factor("pressure_volume"),
        rtol=0,
        atol=1e-7 * np.abs(one.arrays["virial_stress_potential"]).max(),
    )
    tiled = fields_of([frame], settings(names, pot, grid, tiles=(2, 1, 2)))
    for name, values in one.arrays.items():
        assert np.abs(values - tiled.arrays[name]).max() <= 3e-6 * np.abs(values).max(), name
    frames = [frame, frame.replace(positions=frame.positions + rng.uniform(-0.1, 0.1, frame.positions.shape))]
    some = ["stress_potential", "virial_stress", "energy_flux"]
    together = fields_of(frames, settings(some, pot, grid))
    apart = [fields_of([f], settings(some, pot, grid)).arrays for f in frames]
    for name, values in together.arrays.items():
        want = 0.5 * (apart[0][name] + apart[1][name])
        assert np.abs(values - want).max() < 3e-6 * np.abs(want).max(), name


def test_a_drift_carries_the_energy_along():
    """Heat flux and stress do not see a drift; the energy current of charges that all move alike is −σ·v."""
    frame = ions().frame()
    pot = atc.potential("units real\n" + LINES)
    fast = frame.replace(velocities=frame.velocities + [3.0, -2.0, 1.0])
    grid = Grid.points(POINTS[:5])
    a, b = (fields_of([f], settings(["heat_flux", "stress"], pot, grid, 1e-8)).arrays for f in (frame, fast))
    for name in ("heat_flux", "stress"):
        assert np.abs(a[name] - b[name]).max() < 1e-6 * np.abs(a[name]).max()
    v = np.array([1.0, -2.0, 0.5])
    bound = grid.bind(frame.units, frame.cell, frame.positions)
    sums = FieldSums(pot.fields, ["stress", "power_lab"], bound, GAUSS, 1e-9, 1)
    sums.add(frame.replace(velocities=np.tile(v, (len(frame), 1))), np.zeros(3))
    got = sums.on_grid()
    sigma = got["stress"][:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    assert np.abs(got["power_lab"] + sigma @ v).max() < 1e-8 * np.abs(got["power_lab"]).max()


def test_refused_with_the_reason():
    frame = eight_ions()
    pot = salt_potential(4.0, 1e-8)
    grid = Grid.points(POINTS[:2])
    for name, message in (
        ("piola_stress", "no bonds that could be drawn"),
        ("peridynamic_stress", "no bonds that could be weighted"),
    ):
        with pytest.raises(AtcError, match=message):
            fields_of([frame], settings([name], pot, grid, reference=frame))
    for kern in (atc.kernel("step", 4.0), atc.kernel("box", 4.0)):
        with pytest.raises(AtcError, match=f"kernel '{kern.name}'"):
            fields_of([frame], settings(["stress_potential"], pot, grid, kern=kern))


def test_virial_and_triclinic_names():
    """Symmetric components in the order of the package."""
    frame, pot = eight_ions(TRICLINIC), salt_potential(4.0, 1e-10)
    d = pot.stream(frame)
    out = fields_of([frame], settings(["virial_stress_potential"], pot, Grid.points(POINTS[:2]))).arrays[
        "virial_stress_potential"
    ]
    np.testing.assert_allclose(
        out[SIX], d.virial_cc[SIX] / frame.cell.volume / frame.units.factor("pressure"), rtol=1e-12
    )


def test_balances_close_with_a_field():
    """In closed form and by stencils on the deposited fields; a share of the field left out breaks both."""
    from atc.estimators import balance

    frame, pot = eight_ions(TRICLINIC, drift=0.5), salt_potential(5.0, 1e-11)
    kern = GAUSS.scaled(1.0)
    x_gc, h = POINTS[:3] + frame.cell.origin, kern.difference_step
    steps = balance.stencil(x_gc, h)
    deposit = balance.deposit_at(steps, kern, frame.cell, 1)
    state = balance.motion(frame, pot, 1, deposit)
    share = balance.field_bonds(frame, pot, kern, steps)
    fields = balance.deposited(state, deposit, share)
    exact = balance.Exact(balance.Sites(x_gc, frame.positions, frame.cell, kern), state, fields.pop("bonds")[::19])
    laws = exact.laws()
    scale = {name: law.largest[1] for name, law in laws.items()}
    by_stencils = balance.field_laws(laws, exact, fields, h)
    for name in balance.LAWS:
        assert np.abs(laws[name].residual).max() < 1e-10 * scale[name], name
        assert np.abs(by_stencils[name].residual).max() < 1e-7 * scale[name], name
    apart, _, left_out = balance.energy_rates(frame, pot, state)
    assert apart < 1e-8 and left_out == 0
    without = balance.field_laws(laws, exact, balance.deposited(state, deposit), h)
    for name in ("momentum", "energy"):
        assert not np.abs(without[name].residual).max() < 1e-2 * scale[name], name


def test_energy_current_of_the_slab_correction():
    """Its divergence is what shares and forces say at every mode; charges that all move alike have −σ·v; its mean is
    that of the atoms' virials; a film that stands elsewhere has the same."""
    from atc.decomposers.long_range.transform import Direct, wave_vectors
    from atc.estimators.field_pass import Layout

    pot = converged(atc.potential("units real\n" + LINES + "kspace_modify slab 3.0\n"), 1e-12)
    frame, (term,) = ions(slab=True, triclinic=False).frame(), pot.fields
    vectors, origin = term.box(frame)
    on = Layout(vectors, origin, np.array([3, 3, 6]), 1e-11, 12, 1.0, False, (0, 0, 0), 0)

    def at(frame, v_nc):
        products = term.products(frame, on, 1)
        Q = np.stack([np.broadcast_to(k, (7, 7, 7)) for k in wave_vectors(products.q_index, vectors)])
        return Q, products.current(v_nc), products.stress()[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]

    v = frame.velocities
    Q, A, sigma = at(frame, v)
    smooth = term.modes(frame)
    source = smooth.share_rates_n(v) + np.einsum("nc,nc->n", v, smooth.forces_nc())
    want = Direct(vectors, origin, (3, 3, 6)).modes(frame.positions, source[:, None])[0]
    assert np.abs(np.einsum("aijk,aijk->ijk", 1j * Q, A) + want).max() < 1e-9 * np.abs(want).max()
    mean = -np.einsum("nij,nj->i", smooth.virials_n6()[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]], v)
    np.testing.assert_allclose(A[:, 0, 0, 0].real, mean, rtol=0, atol=1e-9 * np.abs(A).max())
    c = np.array([0.3, -0.2, 0.4])
    _, alike, _ = at(frame, np.tile(c, (len(v), 1)))
    assert np.abs(alike + np.einsum("abijk,b->aijk", sigma, c)).max() < 1e-9 * np.abs(alike).max()
    h = 0.7
    _, moved, _ = at(frame.replace(positions=frame.positions + [0, 0, h]), v)
    assert np.abs(moved * np.exp(1j * h * Q[2]) - A).max() < 1e-9 * np.abs(A).max()
    # Rates of the shares are their derivatives.
    dt = 1e-4 / np.abs(v).max()
    ends = [term.modes(frame.replace(positions=frame.positions + s * dt * v)).energies_n() for s in (1, -1)]
    rates = (ends[0] - ends[1]) / (2 * dt)
    np.testing.assert_allclose(smooth.share_rates_n(v), rates, rtol=0, atol=1e-6 * np.abs(rates).max())


def test_check_of_a_film():
    """With the slab correction's field: laws to rounding, from the fields as they are written."""
    from atc.analysis.check import check

    pot = atc.potential("units real\n" + LINES + "kspace_modify slab 3.0\n")
    report = check([ions(slab=True, triclinic=False).frame()], pot, GAUSS, points=1)
    assert report.ok, report.verdict
    for law in ("momentum", "energy"):
        ways = report.data["laws"][law]
        assert ways["chain_rule"]["residual"] < 1e-12 and ways["fields"]["residual"] < 1e-8, (law, ways)


def test_check_of_a_model_with_a_field():
    """Bonds and field of a triclinic salt, from the fields as they are written."""
    from atc.analysis.check import check

    frame, pot = ions().frame(), atc.potential("units real\n" + LINES)
    report = check([frame], pot, GAUSS, points=2)
    assert report.ok and "momentum balance holds to" in report.verdict[1], report.verdict
    with pytest.raises(AtcError, match="kernel 'lucy': balance laws with long-range Coulomb"):
        check([frame], pot, atc.kernel("lucy", 4.0))


def test_the_runs_accuracy_is_allowed():
    """Forces of a run may differ by what its mesh was asked for."""
    from atc.agreement.forces import compare_forces

    frame, pot = ions().frame(), atc.potential("units real\n" + LINES)
    assert "asked for forces to 0.0332" in pot.describe()
    forces = pot.stream(frame, forces=True).forces_nc
    noise = np.random.default_rng(0).normal(size=forces.shape) * pot.fields[0].run.force
    assert compare_forces(frame.replace(forces=forces + 0.3 * noise), pot).agrees
    assert not compare_forces(frame.replace(forces=forces + 10 * noise), pot, diagnose=False).agrees
