"""Peridynamic stresses: against W's sum term by term, against Hardy's stress, and in homogeneous deformation where the
answer is known."""

import itertools

import numpy as np
import pytest
from frames import CELLS, argon
from naive_fields import BruteLJ, bond_sum, images, site_sum
from scipy.integrate import quad

import atc
from atc.bonds import Bonds
from atc.contracts import Interactions
from atc.errors import AtcError
from atc.estimators.peridynamic import mean_weight
from atc.frame import Cell, Frame
from atc.units import units

VARIANTS = ["peridynamic_stress_weighted_virial", "peridynamic_stress_weighted_virial_normalised"]
HORIZON = 5.0
# Rounding of sums of a few hundred terms.
ROUNDING = 3e-12


class Skew(BruteLJ):
    """Lennard-Jones bonds with forces turned off the bond: momentum is conserved, angular momentum is not."""

    central = False

    def evaluate(self, frame):
        bonds, _, e = super().evaluate(frame)
        A = np.random.default_rng(8).normal(size=(3, 3))
        F = -bonds.G_b[:, None] * (bonds.r_bc @ (np.eye(3) + 0.3 * A))
        forces = np.zeros((len(frame), 3))
        np.add.at(forces, bonds.i, F)
        np.add.at(forces, bonds.j, -F)
        return Bonds(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, F_bc=F), forces, e

    def stream(self, frame, consume=None, *, threads=1, energies=False, forces=False, sources=False):
        from atc.decomposers.base import Decomposition

        bonds, F_nc, e_n = self.evaluate(frame)
        if consume is not None:
            half = len(bonds) // 2
            for k, part in enumerate((slice(0, half), slice(half, None))):
                chunk = Bonds(bonds.i[part], bonds.j[part], bonds.r_bc[part], bonds.G_b[part], F_bc=bonds.F_bc[part])
                consume(chunk, k % threads)
        return Decomposition(
            float(e_n.sum()), bonds.virial(), e_n if energies else None, F_nc if forces else None, n_bonds=len(bonds)
        )


class Springs(Interactions):
    """Bonds of given ends with the force c (|r|/|ξ| − 1) along r on a lattice deformed by F from rest: PMB without
    volume correction."""

    def __init__(self, offsets, scale, F, horizon, dimension=3):
        self.offsets, self.scale, self.F = offsets, scale, F
        self.cutoff, self.dimension, self.units = horizon, dimension, units("lj")

    def describe(self):
        return "springs"

    def stream(self, frame, consume=None, **_):
        from atc.decomposers.base import Decomposition

        n = len(frame)
        virial = np.zeros((3, 3))
        for xi in self.offsets:
            r = self.F @ xi
            G = self.scale * (np.linalg.norm(r) / np.linalg.norm(xi) - 1) / np.linalg.norm(r)
            every = np.arange(n, dtype=np.int32)
            bonds = Bonds(every, every, np.tile(r, (n, 1)), np.full(n, G))
            virial += bonds.virial()
            if consume is not None:
                consume(bonds, 0)
        return Decomposition(0.0, virial)


def weighted_twin(points, frame, bonds, horizon, normalised=False, X=None, R=None, cell=None):
    """W eq. 7 by ordered pairs, over the horizon's volume; every image of every bond, one point at a time."""
    cell = cell or frame.cell
    x = frame.positions[bonds.i] if X is None else X
    r = bonds.r_bc if R is None else R
    F = bonds.forces()
    out = np.zeros((len(points), 3, 3))
    x = x - cell.wrap(x)[1] @ cell.vectors
    for g, p in enumerate(cell.wrap(points)[0]):
        for shift in images(cell, horizon + np.linalg.norm(r, axis=1).max()):
            for b in range(len(r)):
                I, J = x[b] + shift, x[b] + shift - r[b]
                a, c = np.linalg.norm(I - p), np.linalg.norm(J - p)
                if a > horizon * (1 + 1e-10) or c > horizon * (1 + 1e-10):
                    continue
                d = np.linalg.norm(r[b])
                over = mean_weight(d / horizon) if normalised else 1.0
                for end, length, force in ((I, a, F[b]), (J, c, -F[b])):
                    if length > 1e-9 * horizon:
                        out[g] -= 0.5 * d * np.outer((end - p) / length, force) / over
    return out / (4 / 3 * np.pi * horizon**3)


def internal(ds, name):
    return atc.units.units(ds.attrs["units"]).to_internal("pressure", ds[name].values[0]).reshape(-1, 3, 3)


# --- the mean weight


@pytest.mark.parametrize("s", [0.02, 0.4, 0.93, 1.0, 1.2, 1.9])
def test_mean_weight_is_the_integral_over_the_lens(s):
    """In Cartesian terms: slices of the lens normal to the bond, I at 0 and J at −s on the z axis."""

    def ends(z, rho):  # ½(ê_I − ê_J)·x̂ at height z, distance rho from the axis
        return 0.5 * (-z / np.hypot(z, rho) + (z + s) / np.hypot(z + s, rho))

    def width(z):
        return np.sqrt(max(min(1 - z * z, 1 - (z + s) ** 2), 0.0))

    options = {"epsabs": 1e-13, "epsrel": 1e-11, "limit": 400}

    def integrate(f, points):
        points = sorted({p for p in points if -1 < p < 1 - s} | {-1.0, 1.0 - s})
        return sum(quad(f, a, b, **options)[0] for a, b in itertools.pairwise(points))

    # ∫ ends 2πρ dρ and ∫ ends dρ have primitives: √(z² + ρ²) and asinh
    def disc(z):
        w = width(z)
        return np.pi * (-z * (np.hypot(z, w) - abs(z)) + (z + s) * (np.hypot(z + s, w) - abs(z + s)))

    def chord(z):
        w = width(z)
        near = [np.sign(a) * abs(a) * np.arcsinh(w / abs(a)) if a else 0.0 for a in (-z, z + s)]
        return sum(near)

    kinks = (-s, -0.5 * s, 0.0)
    assert mean_weight(s) == pytest.approx(integrate(disc, kinks) / (4 / 3 * np.pi), rel=1e-9)
    assert mean_weight(s, 2) == pytest.approx(integrate(chord, kinks) / np.pi, rel=1e-8)
    assert mean_weight(s, 1) == pytest.approx(integrate(lambda z: ends(z, 0.0), kinks) / 2, rel=1e-9)
    assert ends(-0.3 * s, 0.0) == 1.0  # on the bond the weight is the bond


def test_mean_weight_beyond_reach_is_zero():
    for dimension in (1, 2, 3):
        assert np.all(mean_weight([2.0, 2.5, 100.0], dimension) == 0)
        assert mean_weight(0.0, dimension) == 0


# --- Lehoucq and Silling


@pytest.mark.parametrize("cell", CELLS)
def test_lehoucq_silling_is_hardys(cell):
    frame = argon(cell, seed=2)
    points = frame.positions[:5] + 0.4
    ds = atc.fields(
        frame,
        BruteLJ(),
        atc.kernel("quartic", 5.0),
        atc.Grid.points(points),
        ["peridynamic_stress", "stress_potential"],
    )
    assert np.array_equal(ds.peridynamic_stress, ds.stress_potential) and float(abs(ds.peridynamic_stress).max()) > 0
    assert (
        ds.peridynamic_stress.attrs["units"] == "bar"
        and "face normal" in ds.peridynamic_stress.attrs["sign_convention"]
    )
    # the shape W gives it: −½ over ordered pairs of F_IJ⊗x_IJ, force first
    bonds, _, _ = BruteLJ().evaluate(frame)
    F = bonds.forces()
    x = frame.positions[bonds.i]
    both = [(x, bonds.r_bc, F), (x - bonds.r_bc, -bonds.r_bc, -F)]
    want = sum(
        bond_sum(
            points, a, r, -0.5 * np.einsum("bk,bi->bik", f, r).reshape(-1, 9), atc.kernel("quartic", 5.0), frame.cell
        )
        for a, r, f in both
    ).reshape(-1, 3, 3)
    np.testing.assert_allclose(internal(ds, "peridynamic_stress"), want, rtol=0, atol=ROUNDING * np.abs(want).max())


def test_divergence_of_noncentral_forces_is_their_density():
    """∂ς[µν]/∂x_µ = Σ_j F_j φ(x − x_j), by a 10th-order difference of the field: the first index is the divergence's,
    also when ς is not symmetric."""
    frame, pot, kern = argon("tilted", seed=9), Skew(), atc.kernel("gaussian", width=1.5)
    _, forces, _ = pot.evaluate(frame)
    h = 0.15
    c = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260]) / h
    centre = frame.cell.cartesian([[0.3, 0.4, 0.6], [0.8, 0.1, 0.2]])
    steps = np.arange(1, 6) * h
    points = [p + s * k * e for p in centre for e in np.eye(3) for k in steps for s in (1, -1)]
    names = ["peridynamic_stress", "stress", "peridynamic_piola_stress"]
    ds = atc.fields(frame, pot, kern, atc.Grid.points(np.array(points)), names, tolerance=1e-12, reference=frame)
    field = internal(ds, "peridynamic_stress")
    assert np.abs(field - field.swapaxes(1, 2)).max() > 0.05 * np.abs(field).max()
    s = field.reshape(2, 3, 5, 2, 3, 3)
    divergence = np.einsum("k,pmkmn->pn", c, s[:, :, :, 0] - s[:, :, :, 1])
    want = site_sum(centre, frame.positions, forces, kern, frame.cell)
    # (h/w)^10/2772 of the 10th-order formula, times derivatives: below 1e-10
    np.testing.assert_allclose(divergence, want, rtol=0, atol=1e-9 * np.abs(want).max())
    # the same bonds behind Hardy's stress, and behind the reference stress of an undeformed body
    np.testing.assert_allclose(internal(ds, "stress_potential"), field, rtol=0, atol=0)
    np.testing.assert_allclose(
        internal(ds, "peridynamic_piola_stress"), field, rtol=0, atol=ROUNDING * np.abs(field).max()
    )


def test_quantities_that_know_central_forces_only_refuse_others():
    with pytest.raises(AtcError, match="do not act along bonds"):
        atc.fields(argon(), Skew(), quantities=["virial_stress_per_atom"])


# --- W's sum


@pytest.mark.parametrize("pot", [BruteLJ(), Skew()], ids=["central", "skew"])
@pytest.mark.parametrize("cell", CELLS)
def test_weighted_virial_is_ws_sum(cell, pot):
    frame = argon(cell, seed=3, n=(2, 2, 2))
    frame.positions += 2 * frame.cell.periodic @ frame.cell.vectors  # not inside the cell
    points = np.concatenate([frame.positions[:2] + 0.6, frame.positions[2:4], frame.positions[:1] - [40.0, 0, 0]])
    ds = atc.fields(frame, pot, grid=atc.Grid.points(points), quantities=VARIANTS, horizon=HORIZON, threads=2)
    bonds, _, _ = pot.evaluate(frame)
    for name, normalised in zip(VARIANTS, (False, True)):
        want = weighted_twin(points, frame, bonds, HORIZON, normalised)
        np.testing.assert_allclose(internal(ds, name), want, rtol=0, atol=ROUNDING * np.abs(want).max())
        assert ds[name].attrs["error_max"] < 1e-12
    assert ds.attrs["horizon"] == HORIZON and ds.attrs["horizon_units"] == "angstrom" and "kernel" not in ds.attrs


def test_weighted_virial_on_the_atoms_and_on_a_regular_grid():
    """At a node its own end has no direction; the points of a grid are its points, whatever their order."""
    frame, pot = argon("tilted", seed=4, n=(2, 2, 2)), BruteLJ()
    bonds, _, _ = pot.evaluate(frame)
    ds = atc.fields(frame, pot, grid=atc.Grid.atoms(), quantities=VARIANTS[:1], horizon=HORIZON)
    want = weighted_twin(frame.positions, frame, bonds, HORIZON)
    np.testing.assert_allclose(internal(ds, VARIANTS[0]), want, rtol=0, atol=ROUNDING * np.abs(want).max())
    ds = atc.fields(frame, pot, grid=atc.Grid.regular(shape=(2, 3, 4)), quantities=VARIANTS[:1])
    points = atc.Grid.regular(shape=(2, 3, 4)).bind(frame.units, frame.cell).points_gc
    want = weighted_twin(points, frame, bonds, pot.cutoff)  # the potential's reach, if no horizon is given
    np.testing.assert_allclose(internal(ds, VARIANTS[0]), want, rtol=0, atol=ROUNDING * np.abs(want).max())
    assert ds.attrs["horizon"] == pot.cutoff


@pytest.mark.parametrize("pot", [BruteLJ(), Skew()], ids=["central", "skew"])
def test_reference_tensors(pot):
    reference = argon("tilted", seed=6, n=(2, 2, 2))
    F = np.array([[1.06, 0.04, 0.0], [-0.03, 0.97, 0.05], [0.02, 0.0, 1.01]])
    rng = np.random.default_rng(1)
    moved = reference.positions @ F.T + rng.uniform(-0.1, 0.1, reference.positions.shape)
    frame = reference.replace(positions=moved, cell=Cell(reference.cell.vectors @ F.T, reference.cell.origin @ F.T))
    volume = rng.uniform(30, 40, len(frame))
    frame.extra = {"volume": volume}
    points = reference.positions[:4] + 0.7
    names = [
        "peridynamic_piola_stress",
        *(v.replace("stress", "piola_stress", 1) for v in VARIANTS),
        "peridynamic_piola_stress_nodal_virial",
    ]
    kern = atc.kernel("quartic", 5.0)
    ds = atc.fields(
        frame,
        pot,
        kern,
        atc.Grid.points(points),
        [*names, "peridynamic_stress_nodal_virial"],
        reference=reference,
        horizon=6.0,
    )
    bonds, _, _ = pot.evaluate(frame)
    shift = np.rint((frame.positions[bonds.i] - frame.positions[bonds.j] - bonds.r_bc) @ frame.cell.inverse)
    X = reference.positions[bonds.i]
    R = X - reference.positions[bonds.j] - shift @ reference.cell.vectors
    b = -np.einsum("bi,bk->bik", R, bonds.forces())
    want = {names[0]: bond_sum(points, X, R, b.reshape(-1, 9), kern, reference.cell).reshape(-1, 3, 3)}
    for name, normalised in zip(names[1:3], (False, True)):
        want[name] = weighted_twin(points, frame, bonds, 6.0, normalised, X, R, reference.cell)
    for name, r in ((names[3], R), ("peridynamic_stress_nodal_virial", bonds.r_bc)):
        want[name] = np.zeros((len(frame), 3, 3))
        for end in (bonds.i, bonds.j):
            np.add.at(want[name], end, -0.5 * np.einsum("bi,bk->bik", r, bonds.forces()) / volume[end, None, None])
    for name, w in want.items():
        np.testing.assert_allclose(internal(ds, name), w, rtol=0, atol=ROUNDING * np.abs(w).max(), err_msg=name)
        assert np.abs(w - w.swapaxes(1, 2)).max() > 1e-3 * np.abs(w).max() or "nodal" in name
    assert ds[names[1]].dims == ("frame", "point", "i", "j") and ds[names[3]].dims == ("frame", "atom", "i", "j")


def test_nodal_virial_is_the_per_atom_virial_by_volume():
    frame = argon("slab", seed=5)
    frame.extra = {"volume": np.linspace(20.0, 40.0, len(frame))}
    ds = atc.fields(
        frame, BruteLJ(), quantities=["peridynamic_stress_nodal_virial", "virial_stress_per_atom_potential"]
    )
    want = ds.virial_stress_per_atom_potential.values[0] / frame.extra["volume"][:, None, None]
    np.testing.assert_allclose(ds.peridynamic_stress_nodal_virial[0], want, rtol=0, atol=1e-13 * np.abs(want).max())


def test_rotation_and_translation():
    """A rotated, translated body has the rotated stress: no variant knows where it is."""
    frame, pot = argon("open", seed=11), Skew()
    a, b = 0.7, -0.4
    Q = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]]
    )
    far = np.array([300.0, -20.0, 5.0])
    moved = frame.replace(
        positions=frame.positions @ Q.T + far, cell=Cell(frame.cell.vectors @ Q.T, frame.cell.origin + far, [False] * 3)
    )

    class Turned(Skew):
        def evaluate(self, frame):
            bonds, forces, e = Skew.evaluate(self, frame.replace(positions=(frame.positions - far) @ Q))
            return Bonds(bonds.i, bonds.j, bonds.r_bc @ Q.T, bonds.G_b, F_bc=bonds.F_bc @ Q.T), forces @ Q.T, e

    points = frame.positions[:4] + 0.5
    names = ["peridynamic_stress", *VARIANTS]
    kern = atc.kernel("quartic", 5.0)
    here = atc.fields(frame, pot, kern, atc.Grid.points(points), names, horizon=HORIZON)
    there = atc.fields(moved, Turned(), kern, atc.Grid.points(points @ Q.T + far), names, horizon=HORIZON)
    for name in names:
        want = Q @ internal(here, name) @ Q.T
        # coordinates of 300 cost two digits
        np.testing.assert_allclose(internal(there, name), want, rtol=0, atol=1e-11 * np.abs(want).max(), err_msg=name)


# --- homogeneous deformation


def lattice(m, F, dimension=3):
    """A cubic lattice of spacing 1 with all bonds up to m spacings, deformed by F, one node a cell. The cell holds one
    node, so every node is the same."""
    reach = np.arange(-m, m + 1)
    axes = [reach if k < dimension else [0] for k in range(3)]
    xi = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(float)
    length = np.linalg.norm(xi, axis=1)
    first = (xi[:, 0] > 0) | ((xi[:, 0] == 0) & ((xi[:, 1] > 0) | ((xi[:, 1] == 0) & (xi[:, 2] > 0))))
    xi = xi[first & (length <= m + 1e-9)]
    periodic = [k < dimension for k in range(3)]
    frame = Frame(np.zeros((1, 3)), Cell(np.eye(3) @ F.T, periodic=periodic), units("lj"), masses=np.ones(1))
    return frame, Springs(xi, 1.0, F, m * max(1.0, np.linalg.norm(F, 2)), dimension)


@pytest.mark.parametrize("m, low, high", [(2, 0.18, 0.28), (3, 0.18, 0.24), (4, 0.18, 0.22)])
def test_homogeneous_deformation(m, low, high):
    """W's claim that its sum is the exact stress does not hold: it gives about a fifth. Divided by the mean weight of
    each bond it is right in the mean."""
    F = np.eye(3) + 1e-3 * np.diag([1.0, -0.25, 0.5])
    frame, pot = lattice(m, F)
    classical = pot.stream(frame).virial_cc / frame.cell.volume
    n = 24
    ds = atc.fields(frame, pot, grid=atc.Grid.regular(shape=(n, n, n)), quantities=VARIANTS, horizon=float(m) * 1.002)
    verbatim, normalised = (ds[v].values[0].reshape(-1, 3, 3) for v in VARIANTS)
    ratio = verbatim.mean(0).diagonal() / classical.diagonal()
    assert (low < ratio).all() and (ratio < high).all()
    # The mean over n³ points of a field with jumps where an end enters the horizon: as good as the lattice of points
    # samples balls (n^-3/2).
    np.testing.assert_allclose(normalised.mean(0), classical, rtol=0, atol=4e-3 * np.abs(classical).max())
    # Without weights, what is left of the plain virial of the bonds inside: about 0.42.
    lens = [1 - 0.75 * s + s**3 / 16 for s in np.linalg.norm(pot.offsets @ F.T, axis=1) / (m * 1.002)]
    parts = [w * np.outer(F @ xi, F @ xi) * (np.linalg.norm(F @ xi) / np.linalg.norm(xi) - 1) / np.linalg.norm(F @ xi)
             for w, xi in zip(lens, pot.offsets)]  # fmt: skip
    assert 0.35 < sum(parts)[0, 0] / frame.cell.volume / classical[0, 0] < 0.56
    # At the nodes, as W would have it evaluated: a value of its own, and no better.
    at_node = atc.fields(frame, pot, grid=atc.Grid.atoms(), quantities=VARIANTS[:1], horizon=float(m) * 1.002)[
        VARIANTS[0]
    ].values.reshape(3, 3)
    assert 0.15 < at_node[0, 0] / classical[0, 0] < 0.30


@pytest.mark.parametrize("dimension", [1, 2])
def test_homogeneous_deformation_in_fewer_dimensions(dimension):
    F = np.eye(3) + 1e-3 * np.diag([1.0, 0.5, 0.0][:dimension] + [0.0] * (3 - dimension))
    frame, pot = lattice(3, F, dimension)
    classical = pot.stream(frame).virial_cc / frame.cell.volume
    shape = (200, 200 if dimension == 2 else 1, 1)
    ds = atc.fields(frame, pot, grid=atc.Grid.regular(shape=shape), quantities=VARIANTS, horizon=3.006)
    normalised = ds[VARIANTS[1]].values[0].reshape(-1, 3, 3).mean(0)
    # jumps again, sampled at 200 points an axis
    np.testing.assert_allclose(
        normalised, classical, rtol=0, atol=2e-2 / (1 + 4 * (dimension == 2)) * np.abs(classical).max()
    )


# --- what cannot be done says so


def test_messages():
    frame, pot = argon("orthogonal"), BruteLJ()
    grid = atc.Grid.points([[1.0, 2.0, 3.0]])
    with pytest.raises(AtcError, match="points, not to bins"):
        atc.fields(frame, pot, grid=atc.Grid.slab("z", 4), quantities=VARIANTS)
    with pytest.raises(AtcError, match="greater than 0"):
        atc.fields(frame, pot, grid=grid, quantities=VARIANTS, horizon=-2.0)
    with pytest.raises(AtcError, match="larger horizon"):
        atc.fields(frame, pot, grid=grid, quantities=VARIANTS, horizon=1.8)
    with pytest.raises(AtcError, match="column 'volume'"):
        atc.fields(frame, pot, quantities=["peridynamic_stress_nodal_virial"])
    with pytest.raises(AtcError, match="no kernel"):
        atc.fields(frame, pot, grid=grid, quantities=["peridynamic_stress"])


def test_plan_and_scene(tmp_path):
    from atc.config.scene import Scene

    text = """[trajectory]
file = "melt.dump"
units = "lj"
masses = { 1 = 1.0 }
[potential]
lammps = '''pair_style lj/cut 2.5
pair_coeff 1 1 1.0 1.0 2.5'''
[grid]
kind = "regular"
shape = [3, 3, 3]
[fields]
quantities = ["peridynamic_stress_weighted_virial"]
horizon = 2.0
"""
    rng = np.random.default_rng(0)
    s = (np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) * 1.1 + rng.uniform(
        -0.05, 0.05, (125, 3)
    )
    lines = [
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n125\nITEM: BOX BOUNDS pp pp pp\n"
        + "0 5.5\n" * 3
        + "ITEM: ATOMS id type x y z"
    ]
    lines += [f"{k + 1} 1 {p[0]:.12g} {p[1]:.12g} {p[2]:.12g}" for k, p in enumerate(s)]
    (tmp_path / "melt.dump").write_text("\n".join(lines) + "\n")
    (tmp_path / "scene.toml").write_text(text)
    scene = Scene.load(tmp_path / "scene.toml")
    ds = scene.run()
    assert ds.attrs["horizon"] == 2.0 and np.isfinite(ds.peridynamic_stress_weighted_virial).all()
    assert "around each point" in str(scene.plan())
    with pytest.raises(AtcError, match=r"scene.toml:13: \[fields\] horizon"):
        (tmp_path / "scene.toml").write_text(text.replace("2.0\n", '"far"\n'))
        Scene.load(tmp_path / "scene.toml")
