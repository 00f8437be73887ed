"""Fields transform as they must: rotation, reflection, translation, permutation, re-imaging; and a sheared cell of the
same crystal."""

import numpy as np
import pytest
from systems import system

import atc
from atc.estimators.registry import QUANTITIES

# Quantities relative to a reference frame have their own tests; so have those that are zero but for rounding, as
# churning is for pairs, and what acts from outside, which a potential alone does not say.
_OWN_TESTS = (
    "piola_stress",
    "displacement",
    "displacement_gradient",
    "eshelby_stress",
    "churning",
    "churning_divergence",
    "churning_heat_source",
    "heat_flux_churning",
    "vorticity",
    "body_force",
    "body_power",
)
# Piola stresses need a reference, nodal virials a volume of each node.
NAMES = [
    q
    for q in QUANTITIES
    if q not in _OWN_TESTS and not q.startswith("peridynamic_piola") and not q.endswith("nodal_virial")
]
KERN = ("quartic", 4.5)
# Rounding of positions of size 30 Å is 4e-15 Å; the steep repulsion of hot pairs turns it into 1e-14..1e-13 of the
# largest stress.
TIGHT = 1e-12


def points_in(frame, count=6, seed=0):
    return frame.cell.cartesian(np.random.default_rng(seed).random((count, 3)))


def compute(frame, pot, points, names=NAMES):
    return atc.fields(frame, pot, atc.kernel(*KERN), atc.Grid.points(points), names, tolerance=1e-12, threads=2).isel(
        frame=0
    )


def assert_same(got, want, names=NAMES, Q=None, atoms=None):
    for q in names:
        a, b = got[q].values, want[q].values
        if Q is not None:
            rank = QUANTITIES[q].rank
            b = b @ Q.T if rank == 1 else Q @ b @ Q.T if rank == 2 else b
        if atoms is not None and QUANTITIES[q].kind == "atom":
            b = b[atoms]
        np.testing.assert_allclose(a, b, rtol=0, atol=TIGHT * np.abs(b).max(), err_msg=q)


def orthogonal(seed, reflect):
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    if (np.linalg.det(Q) < 0) != reflect:
        Q[:, 0] *= -1
    return Q


@pytest.mark.parametrize("reflect", [False, True], ids=["rotation", "reflection"])
@pytest.mark.parametrize("name", ["lj", "sw"])
def test_rotation_and_reflection(name, reflect):
    frame, pot = system(name, seed=1)
    points = points_in(frame)
    Q = orthogonal(3, reflect)
    cell = atc.Cell(frame.cell.vectors @ Q.T, frame.cell.origin @ Q.T, frame.cell.periodic)
    turned = frame.replace(positions=frame.positions @ Q.T, velocities=frame.velocities @ Q.T, cell=cell)
    assert_same(compute(turned, pot, points @ Q.T), compute(frame, pot, points), Q=Q)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_translation(name):
    frame, pot = system(name, seed=2)
    points, shift = points_in(frame), np.array([3.3, -17.1, 8.9])
    cell = atc.Cell(frame.cell.vectors, frame.cell.origin + shift, frame.cell.periodic)
    moved = frame.replace(positions=frame.positions + shift, cell=cell)
    want = compute(frame, pot, points)
    assert_same(compute(moved, pot, points + shift), want)
    # along periodic axes the cell's origin means nothing
    assert_same(compute(frame.replace(cell=cell), pot, points), want)
    assert_same(compute(frame.replace(positions=frame.positions + shift), pot, points + shift), want)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_permutation(name):
    frame, pot = system(name, seed=3)
    points = points_in(frame)
    p = np.random.default_rng(5).permutation(len(frame))
    mixed = frame.replace(
        positions=frame.positions[p], velocities=frame.velocities[p], masses=frame.masses[p], types=frame.types[p]
    )
    assert_same(compute(mixed, pot, points), compute(frame, pot, points), atoms=p)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_reimaging_of_atoms_and_points(name):
    frame, pot = system(name, seed=4)
    points = points_in(frame)
    rng = np.random.default_rng(6)
    want = compute(frame, pot, points)
    atoms = frame.replace(positions=frame.positions + rng.integers(-3, 4, (len(frame), 3)) @ frame.cell.vectors)
    assert_same(compute(atoms, pot, points), want)
    assert_same(compute(frame, pot, points + rng.integers(-3, 4, points.shape) @ frame.cell.vectors), want)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_another_cell_of_the_same_lattice(name):
    """a, b, c and a, b + a, c − 2a + b, left-handed too, describe the same infinite system."""
    frame, pot = system(name, seed=5)
    points = points_in(frame)
    want = compute(frame, pot, points)
    for M in (
        [[1, 0, 0], [1, 1, 0], [-2, 1, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ):
        other = frame.replace(cell=atc.Cell(np.array(M) @ frame.cell.vectors, frame.cell.origin, frame.cell.periodic))
        assert_same(compute(other, pot, points), want)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_a_doubled_box_has_the_same_fields(name):
    frame, pot = system(name, seed=6)
    points = points_in(frame)
    # The heat current is a sum over the box, not an average: it doubles.
    names = [q for q in NAMES if QUANTITIES[q].kind != "atom" and not q.startswith("heat_current")]
    twice = {k: np.concatenate([getattr(frame, k)] * 2) for k in ("velocities", "masses", "types")}
    double = frame.replace(
        positions=np.concatenate([frame.positions, frame.positions + frame.cell.vectors[1]]),
        cell=atc.Cell(frame.cell.vectors * [[1], [2], [1]], frame.cell.origin), ids=None, **twice,
    )  # fmt: skip
    assert_same(compute(double, pot, points, names), compute(frame, pot, points, names), names)


@pytest.mark.parametrize("name", ["lj", "sw"])
def test_galilean_invariance(name):
    """A change of the observer's velocity changes momentum, velocity and kinetic energy, and nothing else."""
    frame, pot = system(name, seed=7)
    points = points_in(frame)
    boost = np.array([0.3, -0.2, 0.1])
    a, b = compute(frame, pot, points), compute(frame.replace(velocities=frame.velocities + boost), pot, points)
    changed = {
        "momentum",
        "velocity",
        "energy_kinetic",
        "energy",
        "energy_flux",
        "heat_current",
        "heat_current_convective",
        "heat_current_potential",
    }
    if name == "sw":
        changed.add("heat_flux")  # its churning part z·v shifts by z·c, which has neither divergence nor box mean
    for q in NAMES:
        if q not in changed:
            # velocities ten times the thermal ones: their squares' rounding
            np.testing.assert_allclose(b[q], a[q], rtol=0, atol=1e-12 * float(np.abs(a[q]).max()), err_msg=q)
    want = a.velocity + frame.units.to_user("velocity", boost)
    np.testing.assert_allclose(b.velocity, want, rtol=0, atol=1e-13 * float(np.abs(want).max()))


@pytest.mark.parametrize("grid", ["regular", "plane", "line", "slab", "atoms"])
def test_every_grid_gives_the_same_field(grid):
    """The same points through another kind of grid, hence another summation."""
    frame, pot = system("lj", seed=8)
    names = ["density", "stress", "temperature", "smoothed_virial_stress"]
    c = frame.cell
    make = {
        "regular": lambda: atc.Grid.regular(shape=(3, 4, 5)),
        "plane": lambda: atc.Grid.plane(axis="y", position=4.0, shape=(4, 5)),
        "line": lambda: atc.Grid.line(c.cartesian([0.1, 0.2, 0.3]), c.cartesian([1.4, 0.7, 0.9]), 9),
        "slab": lambda: atc.Grid.slab("z", 3),
        "atoms": atc.Grid.atoms,
    }[grid]()
    kern = atc.kernel("gaussian", width=1.5)
    ds = atc.fields(frame, pot, kern, make, names, tolerance=1e-12).isel(frame=0)
    bound = make.bind(frame.units, c, frame.positions)
    assert ds.attrs["measured_error"] < 1e-12
    if grid == "slab":
        # average over the cross-section by a resolved mean over points; temperature and kinetic stress are not averages
        # of their point values
        n = 16
        s = np.stack(np.meshgrid(np.arange(n) / n, np.arange(n) / n, indexing="ij"), -1).reshape(-1, 2)
        for g, h in enumerate((np.arange(3) + 0.5) / 3):
            points = c.cartesian(np.column_stack([s, np.full(len(s), h)]))
            want = atc.fields(
                frame,
                pot,
                kern,
                atc.Grid.points(points),
                ["density", "stress_potential", "smoothed_virial_stress"],
                tolerance=1e-12,
            ).isel(frame=0)
            for q in ("density", "stress_potential", "smoothed_virial_stress"):
                scale = float(np.abs(ds[q]).max())
                np.testing.assert_allclose(ds[q][g], want[q].mean("point"), rtol=0, atol=1e-10 * scale, err_msg=q)
        return
    want = atc.fields(frame, pot, kern, atc.Grid.points(bound.points_gc), names, tolerance=1e-12).isel(frame=0)
    for q in names:
        a = ds[q].values.reshape(want[q].shape)
        np.testing.assert_allclose(a, want[q], rtol=0, atol=1e-12 * float(np.abs(want[q]).max()), err_msg=q)
