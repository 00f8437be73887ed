"""Edge models against potentials that are known, and what every one of them must obey."""

import numpy as np
import pytest
import torch
from energy_systems import diamond
from frames import argon
from naive_fields import site_sum
from torch_toys import CUTOFF, Messages, lennard_jones, per_atom, stillinger_weber

import atc
from atc.analysis.check import check
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell

LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"


@pytest.fixture(scope="module")
def si_lines(tmp_path_factory):
    from energy_systems import SI

    path = tmp_path_factory.mktemp("sw") / "Si.sw"
    path.write_text("# UNITS: metal\n" + SI)
    return f"pair_style sw\npair_coeff * * {path} Si Si"


def toy(hops, **more):
    changes = {k: more.pop(k) for k in ("both_ends", "pooled", "seed") if k in more}
    return atc.edge_model(Messages(hops, **changes), cutoff=CUTOFF, hops=hops, units="metal", **more)


def summed(bonds, n):
    """What bonds add up to at each atom: forces, sources ∂U^(j)/∂x_k of it as j, and as k."""
    F, out, into = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    np.add.at(F, bonds.i, bonds.forces())
    np.add.at(F, bonds.j, -bonds.forces())
    for a, b, k in ((bonds.i, bonds.j, 0), (bonds.j, bonds.i, 1)):
        np.add.at(out, a, bonds.D_bdc[:, k])
        np.add.at(into, b, bonds.D_bdc[:, k])
    return F, out, into


def current(bonds, v):
    """∫A dV."""
    power = np.einsum("bc,bc->b", v[bonds.j], bonds.D_bdc[:, 0]) - np.einsum("bc,bc->b", v[bonds.i], bonds.D_bdc[:, 1])
    return (power + (bonds.P_b if bonds.P_b is not None else 0.0)) @ bonds.r_bc


def near(a, b, tolerance):
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * np.abs(b).max())


# --- known potentials


def test_lennard_jones_is_that_of_atc():
    frame = argon("tilted", n=(2, 3, 3))
    ours = atc.potential(LJ, units="metal").decompose(frame, sources=True)
    d = atc.edge_model(lennard_jones(), cutoff=5.0, units="metal").decompose(frame, sources=True)
    near(d.energies_n, ours.energies_n, 1e-13)
    near(d.virial_cc, ours.virial_cc, 1e-13)
    near(d.forces_nc, ours.forces_nc, 1e-13)
    assert len(d.bonds) == len(ours.bonds) and d.bonds.P_b is None
    near(current(d.bonds, frame.velocities), current(ours.bonds, frame.velocities), 1e-13)
    pot = atc.edge_model(lennard_jones(), cutoff=5.0, units="metal")
    args = atc.kernel("quartic", 4.0), atc.Grid.regular(shape=(3, 3, 3)), ["stress_potential", "heat_flux", "churning"]
    found = atc.fields(frame, pot, *args, tolerance=1e-12)
    want = atc.fields(frame, atc.potential(LJ, units="metal"), *args, tolerance=1e-12)
    for name in args[2][:2]:
        near(found[name].values, want[name].values, 1e-12)
    assert (found.churning.values == 0).all()


def test_stillinger_weber_is_that_of_atc_with_its_energies_at_the_centres(si_lines):
    """Energies, forces, virial; the edge stress is −M of atc's own triplets; the power along edges is the same."""
    frame = diamond(seed=2)
    ours = atc.potential(si_lines, units="metal", partition="center")
    want = ours.decompose(frame, sources=True)
    pot = atc.edge_model(stillinger_weber(), cutoff=1.80 * 2.0951, units="metal")
    d = pot.decompose(frame, sources=True)
    near(d.energies_n, want.energies_n, 1e-13)
    near(d.forces_nc, want.forces_nc, 1e-13)
    near(d.virial_cc, want.virial_cc, 1e-13)
    for a, b in zip(summed(d.bonds, 8), summed(want.bonds, 8), strict=True):
        near(a, b, 1e-13)
    near(current(d.bonds, frame.velocities), current(want.bonds, frame.velocities), 1e-13)
    x = frame.positions[:4] + 0.3
    kern = atc.kernel("quartic", 3.0)

    def M(b):
        """Of every bond that is there, whichever parts of it the two have."""
        return sum(
            np.einsum(
                "b,bm,bn->mn", kern.beta(frame.positions[b.i] + s - x[0], b.r_bc), b.r_bc, b.D_bdc[:, 0] - b.D_bdc[:, 1]
            )
            for s in np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), -1).reshape(-1, 3) @ frame.cell.vectors
        )

    near(M(d.bonds), M(want.bonds), 1e-12)
    S = atc.fields(frame, pot, kern, atc.Grid.points(x[:1]), ["stress_potential"], tolerance=1e-12)
    near(frame.units.to_internal("pressure", S.stress_potential.values[0, 0]), -M(want.bonds), 1e-11)


# --- laws


@pytest.mark.parametrize("hops", [1, 2, 3])
def test_forces_are_the_gradient_of_the_energy(hops):
    frame, pot = diamond(5.2, 1), toy(hops)
    d, h = pot.decompose(frame), 4e-3
    for k, c in ((0, 0), (5, 2)):
        U = [
            pot.decompose(frame.replace(positions=frame.positions + s * h * np.eye(24)[3 * k + c].reshape(8, 3))).energy
            for s in (-2, -1, 1, 2)
        ]
        slope = (U[0] - 8 * U[1] + 8 * U[2] - U[3]) / (12 * h)
        assert abs(slope + d.forces_nc[k, c]) < 1e-7 * np.abs(d.forces_nc).max()


@pytest.mark.parametrize("hops", [1, 2, 3])
def test_balance(hops):
    """Momentum, energy and churning, by atc check; energies along the motion; the identity is in the output."""
    frame, pot = diamond(5.2, 1), toy(hops)
    report = check([frame], pot, atc.kernel("gaussian", width=1.5), points=4)
    assert report.ok, str(report)
    assert report.data["energy_sources"]["error"] < 1e-9
    d = pot.decompose(frame, sources=True)
    assert d.notes["energy_identity"] < 1e-13
    assert np.abs(d.virial_cc - d.virial_cc.T).max() < 1e-14 * np.abs(d.bonds.r_bc).max() * np.abs(d.bonds.F_bc).sum()
    if hops > 1:
        assert (
            np.abs(d.bonds.P_b).max()
            > 1e-3 * np.abs(np.einsum("bc,bc->b", frame.velocities[d.bonds.j], d.bonds.F_bc)).max()
        )


def test_messages_carry_power_and_uniform_motion_carries_none():
    frame, pot = diamond(5.2, 1), toy(2)
    still = frame.replace(velocities=np.broadcast_to([0.1, -0.2, 0.3], (8, 3)).copy())
    d = pot.decompose(still, sources=True)
    size = np.abs(np.einsum("bc,bc->b", still.velocities[d.bonds.j], d.bonds.F_bc)).max()
    assert np.abs(d.bonds.P_b).max() < 1e-14 * size


@pytest.mark.parametrize("hops", [2, 3])
def test_energy_balance_without_what_messages_carry_does_not_hold(hops):
    frame, pot = diamond(5.2, 1), toy(hops)
    d = pot.decompose(frame, sources=True)
    w = np.einsum("nc,nc->n", frame.velocities, d.forces_nc) + rates(pot, frame)
    v, b = frame.velocities, d.bonds
    edge = np.einsum("bc,bc->b", v[b.j], b.D_bdc[:, 0]) - np.einsum("bc,bc->b", v[b.i], b.D_bdc[:, 1])
    for power, ok in ((edge + b.P_b, True), (edge, False)):
        got = np.zeros(8)
        np.add.at(got, b.i, power)
        np.add.at(got, b.j, -power)
        error = np.abs(got - w).max() / np.abs(w).max()
        assert error < 1e-8 if ok else error > 1e-2


def rates(pot, frame, tau=2e-3):
    """dU^(j)/dt by differences of sixth order."""

    def U(t):
        return pot.stream(frame.replace(positions=frame.positions + t * frame.velocities), energies=True).energies_n

    return sum(k * (U(s * tau) - U(-s * tau)) for s, k in ((1, 45), (2, -9), (3, 1))) / (60 * tau)


@pytest.mark.parametrize("hops", [1, 2])
def test_the_whole_current_is_the_unfolded_one(hops):
    """In a box far smaller than what atoms see: Σ_jk x_jk (v_k·∂U^(j)/∂x_k) of copies of it, from U^(j) of the middle
    one."""
    frame, pot = diamond(4.4, 3), toy(hops)
    have = current(pot.decompose(frame, sources=True).bonds, frame.velocities)
    reach = int(np.ceil(hops * CUTOFF / frame.cell.heights.min()))
    shifts = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    shifts = shifts[np.argsort(np.abs(shifts).sum(1), kind="stable")]  # the middle one first
    x = (shifts @ frame.cell.vectors)[:, None] + frame.positions
    v, types = np.tile(frame.velocities, (len(shifts), 1)), np.tile(frame.types, len(shifts))
    X = torch.tensor(x.reshape(-1, 3), requires_grad=True)
    d = torch.cdist(X.detach(), X.detach(), compute_mode="donot_use_mm_for_euclid_dist")
    c, n = torch.nonzero((d < CUTOFF) & (d > 0), as_tuple=True)
    U = Messages(hops)(X[n] - X[c], c, n, torch.tensor(types))
    unit = frame.units.factor("energy")
    want = np.zeros(3)
    for j in range(len(frame)):
        (h,) = torch.autograd.grad(U[j], X, retain_graph=True)
        # A = Σ_{k≠j} (v_k·h_jk) x_jk, x_jk = x_j − x_k
        want += np.einsum("k,kc->c", (v * h.numpy()).sum(1), X[j].detach().numpy() - X.detach().numpy())
    near(have, want * unit, 1e-12)


def test_planes_are_the_same_in_all_decompositions():
    """Averages over whole cross-sections of normal stress and normal heat flux do not depend on the choice."""
    frame = argon(Cell([9.0, 8.0, 12.0]), n=(3, 3, 4), jitter=0.3)
    edge, central = toy(1), toy(1, stress="central")
    ds = [
        atc.fields(
            frame,
            pot,
            atc.kernel("gaussian", width=1.2),
            atc.Grid.slab("z", 6),
            ["stress_potential", "heat_flux"],
            tolerance=1e-12,
        )
        for pot in (edge, central)
    ]
    a, b = (d.stress_potential.values[0] for d in ds)
    near(a[:, 2], b[:, 2], 1e-9)
    assert np.abs(a[:, 0, 0] - b[:, 0, 0]).max() > 1e-3 * np.abs(b).max()
    near(ds[0].heat_flux.values[0][:, 2], ds[1].heat_flux.values[0][:, 2], 1e-9)


def test_central_stars():
    """Forces along bonds, the same force density; balance with churning; no jump as a neighbour comes in."""
    frame = diamond(5.2, 1)
    edge, central = toy(1), toy(1, stress="central")
    a, b = edge.decompose(frame, sources=True), central.decompose(frame, sources=True)
    assert central.central and not edge.central and b.bonds.F_bc is None
    near(b.forces_nc, a.forces_nc, 1e-11)
    near(b.virial_cc, a.virial_cc, 1e-11)
    near(current(b.bonds, frame.velocities), current(a.bonds, frame.velocities), 1e-12)
    report = check([frame], central, atc.kernel("gaussian", width=1.5), points=3)
    assert report.ok, str(report)
    with pytest.raises(AtcError, match='stress="central" is for models of one hop'):
        toy(2, stress="central")


def test_no_jump_as_a_neighbour_comes_in():
    from atc.decomposers.learned.stars import tensions

    rng = np.random.default_rng(0)
    r = rng.normal(size=(9, 3))
    r *= (2.0 + 1.5 * rng.uniform(size=(9, 1))) / np.linalg.norm(r, axis=1, keepdims=True)

    def G(r):
        x = torch.tensor(r, requires_grad=True)
        U = Messages(1)(
            x,
            torch.zeros(len(x), dtype=torch.int64),
            torch.arange(1, len(x) + 1),
            torch.ones(len(x) + 1, dtype=torch.int64),
        )[0]
        (g,) = torch.autograd.grad(U, x)
        a, b, _, G = tensions(r, g.numpy(), CUTOFF)
        return {(int(p), int(q)): t for p, q, t in zip(a, b, G, strict=True)}

    without, just = G(r[:8]), G(np.concatenate([r[:8], r[8:] / np.linalg.norm(r[8]) * CUTOFF * (1 - 1e-9)]))
    size = max(abs(t) for t in without.values())
    assert max(abs(just[k] - t) for k, t in without.items()) < 1e-10 * size
    assert max(abs(t) for k, t in just.items() if k not in without) < 1e-10 * size


# --- batches, threads, units, types


@pytest.mark.parametrize("hops", [1, 2, 3])
def test_batches_and_threads_change_nothing(hops):
    frame = argon(Cell([17.0, 18.0, 19.0]), n=(6, 6, 6), jitter=0.3)
    want = toy(hops).decompose(frame, sources=True)
    got = toy(hops, batch=50).decompose(frame, sources=True, threads=2)
    near(got.energies_n, want.energies_n, 1e-14)
    near(got.forces_nc, want.forces_nc, 1e-13)
    near(current(got.bonds, frame.velocities), current(want.bonds, frame.velocities), 1e-12)
    assert got.notes["energy_identity"] < 1e-12


def test_frames_that_do_not_fit_are_taken_in_batches(monkeypatch):
    from atc.decomposers.learned import edge_model

    frame = argon(Cell([17.0, 18.0, 19.0]), n=(6, 6, 6), jitter=0.3)
    want = toy(2).decompose(frame, sources=True)
    parts = []
    evaluate = edge_model.EdgeModel.evaluate
    monkeypatch.setattr(edge_model, "_SMALL", 10)
    monkeypatch.setattr(edge_model, "free_memory", lambda device: 3e6)
    monkeypatch.setattr(
        edge_model.EdgeModel, "evaluate", lambda self, part, *a: parts.append(part) or evaluate(self, part, *a)
    )
    got = toy(2).decompose(frame, sources=True)
    assert len(parts) > 4 and all(len(p) < 2 * len(want.bonds) for p in parts)
    near(got.forces_nc, want.forces_nc, 1e-13)


def test_units_and_types():
    """Numbers, names, names of the trajectory; atoms left out; other units than the trajectory's are refused."""
    frame = argon("tilted", n=(2, 3, 3))
    model = Messages(2)

    def with_numbers(r, c, n, types):
        assert set(types.tolist()) <= {0, 2}
        return model(r, c, n, types)

    more = {"cutoff": CUTOFF, "hops": 2, "units": "metal"}
    want = atc.edge_model(with_numbers, types=[2, 0], **more).decompose(frame)
    named = atc.edge_model(with_numbers, species=["Ar", "Ne", "Kr"], types=["Kr", "Ar"], **more).decompose(frame)
    own = atc.edge_model(with_numbers, species=["Ar", "Ne", "Kr"], **more)
    np.testing.assert_array_equal(named.forces_nc, want.forces_nc)
    np.testing.assert_array_equal(own.decompose(frame.replace(type_names={1: "Kr", 2: "Ar"})).forces_nc, want.forces_nc)
    with pytest.raises(AtcError, match="types 1, 2 are not named: say the species of each type"):
        own.decompose(frame)
    some = atc.edge_model(with_numbers, types=[2, None], **more).decompose(frame).forces_nc
    assert (some[frame.types == 2] == 0).all() and np.abs(some).max() > 0
    lj = argon("tilted", n=(2, 3, 3), style="real")
    real = atc.edge_model(lennard_jones(0.0104 * 23.060549), cutoff=5.0, units="real").decompose(lj)
    metal = atc.edge_model(lennard_jones(), cutoff=5.0, units="metal").decompose(lj)
    near(real.forces_nc, metal.forces_nc, 1e-7)  # the factor above has 8 digits


def test_energies_of_atoms_alone():
    frame = argon("tilted", n=(2, 3, 3))
    more = {"cutoff": CUTOFF, "hops": 2, "units": "metal"}
    plain = atc.edge_model(Messages(2), types=[0, 1], **more).decompose(frame)
    alone = Messages(2)(
        torch.zeros(0, 3, dtype=torch.float64), *[torch.zeros(0, dtype=torch.int64)] * 2, torch.tensor([0, 1])
    )
    unit = frame.units.factor("energy")
    for reference in ("isolated", {0: float(alone[0]), 1: float(alone[1])}):
        pot = atc.edge_model(Messages(2), types=[0, 1], reference=reference, **more)
        d = pot.decompose(frame)
        near(d.energies_n, plain.energies_n - alone.numpy()[frame.types - 1] * unit, 1e-14)
        np.testing.assert_array_equal(d.forces_nc, plain.forces_nc)
        assert "energies of atoms less 0: " in pot.attributes["energy_reference"]


def test_what_the_output_says(tmp_path):
    frame = diamond(5.2, 1)
    ds = atc.fields(
        [frame],
        toy(2),
        atc.kernel("quartic", 4.0),
        atc.Grid.regular(shape=(2, 2, 2)),
        ["stress", "heat_flux"],
        out=tmp_path / "o.nc",
    )
    ds = atc.open_dataset(tmp_path / "o.nc")
    assert ds.attrs["energy_path"] == "edges of the model, layer by layer" and ds.attrs["precision"] == "float64"
    assert "edge gradient of the total energy, 2 hops" in ds.attrs["decomposition"]
    assert "own zero" in ds.attrs["energy_reference"]
    assert 0 <= ds.attrs["energy_identity"] < 1e-12
    s = ds.stress.values
    assert ds.stress.attrs["asymmetry"] == pytest.approx(np.abs(s - s.swapaxes(-1, -2)).max() / 2 / np.abs(s).max())
    assert ds.stress.attrs["asymmetry"] > 1e-4


# --- what must be refused


def test_messages_that_are_not_understood_are_refused():
    frame = diamond(5.2, 1)
    quantities = [["stress_potential"], ["heat_flux"]]
    for model, said in (
        (Messages(2, both_ends=True), "what edges carry differs from the change of the atoms' energies"),
        (Messages(2, pooled=True), "what edges carry differs"),
    ):
        pot = atc.edge_model(model, cutoff=CUTOFF, hops=2, units="metal")
        with pytest.raises(AtcError, match=said) as e:
            atc.fields(frame, pot, atc.kernel("quartic", 4.0), atc.Grid.regular(shape=(2, 2, 2)), quantities[1])
        assert "\n" not in str(e.value)
    big = argon(Cell([17.0, 18.0, 19.0]), n=(6, 6, 6), jitter=0.3)
    for model, hops in ((Messages(2, pooled=True), 2), (Messages(2), 1), (Messages(3), 2)):
        with pytest.raises(AtcError, match=f"it has more than hops={hops} layers"):
            atc.edge_model(model, cutoff=CUTOFF, hops=hops, units="metal").decompose(big)


def test_energies_that_are_no_function_of_edges_are_refused():
    frame = diamond(5.2, 1)
    model = Messages(1)

    def turned(r, c, n, types):
        return per_atom((r[:, 0] * r[:, 1]) ** 2, c, types)

    for energies, said in (
        (
            lambda r, c, n, t: model(r, c, n, t).detach(),
            "do not depend on the edges by torch's automatic differentiation",
        ),
        (lambda r, c, n, t: model(r, c, n, t).sum(), r"a tensor of shape \(8,\), one for each atom, got \(\)"),
        (lambda r, c, n, t: model(r, c, n, t).float(), "energies are float32 although the edges are float64"),
        (lambda r, c, n, t: 1 / 0 * r, "cannot be evaluated: ZeroDivisionError: division by zero"),
        (lambda r, c, n, t: model(r.float(), c, n, t), "cannot be evaluated: RuntimeError"),
        (lambda r, c, n, t: model(r, c, n, t) * float("nan"), "energy or forces of atom 1 are not finite"),
        (turned, "virial is not symmetric"),
    ):
        with pytest.raises(AtcError, match=said) as e:
            atc.edge_model(energies, cutoff=CUTOFF, units="metal").decompose(frame)
        assert "\n" not in str(e.value)


def test_arguments_that_make_no_sense():
    good = {"cutoff": CUTOFF, "hops": 1, "units": "metal"}
    for change, said in (
        ({"cutoff": -1.0}, "the cutoff must be a positive number"),
        ({"hops": 0}, "hops must be a whole number"),
        ({"stress": "virial"}, 'stress must be "edge" or "central"'),
        ({"types": "Si"}, "types must be a list"),
        ({"types": ["Si"]}, "without species= expected numbers"),
        ({"species": ["Si"], "types": ["C"]}, "no element 'C'"),
        ({"batch": 0}, "batch must be a number of atoms"),
        ({"device": "abacus"}, "torch has no device 'abacus'"),
        ({"precision": "float16"}, 'precision must be "float64" or "float32"'),
        ({"reference": "atoms"}, "reference must be"),
        ({"reference": "isolated"}, "needs species= or types="),
        ({"reference": {"Si": 1.0}, "species": ["C"]}, "no species 'Si'"),
    ):
        with pytest.raises(AtcError, match=said):
            atc.edge_model(Messages(1), **good | change)
    with pytest.raises(AtcError, match="energies must be a function"):
        atc.edge_model("model", **good)


def test_single_precision_is_warned_of():
    frame = argon("tilted", n=(2, 3, 3))
    with pytest.warns(AtcWarning, match="in float32 forces and fluxes are good to 6 digits"):
        pot = atc.edge_model(lennard_jones(), cutoff=5.0, units="metal", precision="float32")
    want = atc.potential(LJ, units="metal").decompose(frame)
    got = pot.decompose(frame, sources=True)
    near(got.forces_nc, want.forces_nc, 1e-5)
    assert 0 < got.notes["energy_identity"] < 1e-5 and pot.attributes["precision"] == "float32"


def test_a_function_that_cannot_be_sent_to_other_processes():
    frame = diamond(5.2, 1)
    pot = atc.edge_model(lambda *a: Messages(1)(*a), cutoff=CUTOFF, units="metal")
    with pytest.raises(AtcError, match="cannot be sent to other processes"):
        atc.fields([frame] * 4, pot, atc.kernel("quartic", 4.0), atc.Grid.regular(shape=(2, 2, 2)), workers=2)


def test_force_density():
    """∇·σ = Σ F φ for a model of three layers, on stencils."""
    frame, pot = diamond(5.2, 1), toy(3)
    kern = atc.kernel("gaussian", width=1.5)
    h, steps = 0.15, (1, 2, 4)
    x0 = np.array([2.0, 1.0, 13.0])
    points = np.concatenate([x0 + s * k * h * e for e in np.eye(3)[:, None] for k in steps for s in (1, -1)])
    s = atc.fields(
        frame, pot, kern, atc.Grid.points(points), ["stress_potential"], tolerance=1e-13
    ).stress_potential.values[0]
    s = frame.units.to_internal("pressure", s).reshape(3, 3, 2, 3, 3)
    slope = [sum((s[m, k, 0, m] - s[m, k, 1, m]) for m in range(3)) / (2 * steps[k] * h) for k in range(3)]
    fourth = [(4 * slope[0] - slope[1]) / 3, (4 * slope[1] - slope[2]) / 3]
    want = site_sum(x0[None], frame.positions, pot.decompose(frame).forces_nc, kern, frame.cell)[0]
    near((16 * fourth[0] - fourth[1]) / 15, want, 1e-5)


def test_every_way_to_get_there():
    """Tiles, other processes and means give what one frame here gives; the heat current is that of the bonds."""
    rng = np.random.default_rng(0)
    frame = argon(Cell([17.0, 18.0, 19.0]), n=(5, 5, 5), jitter=0.3)
    frames = [frame.replace(positions=frame.positions + s) for s in rng.normal(size=(2, 125, 3)) * 0.05]
    pot, kern = toy(2), atc.kernel("quartic", 4.0)
    grid = atc.Grid.regular(shape=(2, 2, 2))
    names = ["stress_potential", "heat_flux", "virial_stress_per_atom_potential", "smoothed_virial_stress_potential"]
    want = atc.fields(
        frames, pot, kern, grid, [*names, "piola_stress", "heat_current"], reference=frame, tolerance=1e-10
    )
    for more, extra in (
        ({"tiles": (2, 1, 1)}, []),
        ({"workers": 2}, ["heat_current"]),
        ({"threads": 2}, ["heat_current"]),
    ):
        got = atc.fields(frames, pot, kern, grid, names + extra, tolerance=1e-10, **more)
        for name in names + extra:
            near(got[name].values, want[name].values, 1e-8)
    d = pot.decompose(frames[0], sources=True)
    b, m = d.bonds, frame.masses
    energy = 0.5 * m * (frame.velocities**2).sum(1) + d.energies_n
    J = energy @ frame.velocities + current(b, frame.velocities)
    near(frame.units.to_internal("energy_current", want.heat_current.values[0]), J, 1e-10)
