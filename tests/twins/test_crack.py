"""The crack in a run and its twin: where a body was cut by hand, the tip and the area are known."""

import warnings

import numpy as np
import pytest
from crystals import crystal
from test_twin import block, scene, twin_of

import atc
from atc import pd
from atc.frame import Cell, Frame
from atc.twins.body import body_of
from atc.twins.crack import Crack, unit_vector
from atc.twins.damage import NearestBonds

A = float(np.linalg.norm(crystal("argon").conventional[0]))
COUNTS = (10, 8, 3)


def strip():
    """Argon, 10 x 8 x 3 cubes, open along x and y."""
    cells = np.stack(np.meshgrid(*map(np.arange, COUNTS), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    X = ((cells + np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])) * A).reshape(-1, 3) + 0.1
    cell = Cell(np.diag(np.array(COUNTS) * A), periodic=(False, False, True))
    return Frame(X, cell, crystal("argon").units, masses=np.full(len(X), crystal("argon").masses[0]), source="strip")


@pytest.fixture(scope="module")
def followed():
    reference, kernel = strip(), atc.kernel("quartic", 7.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        made = body_of(reference, kernel, crystal("argon").density, A, None)
        sim = pd.Simulation(made.body, pd.LPS(bulk=1.0, shear=0.6), damage=pd.CriticalStretch(0.1))
    bonds = NearestBonds(reference, crystal("argon"))
    return Crack(made, reference, kernel, bonds, sim, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))


MIDDLE = 3.9 * A


def cut(crack, end, middle=MIDDLE):
    """Break all bonds of both that cross the plane y = middle where x < end; returns what `measure` finds."""

    def crossed(x_bc, xi_bc):
        share = np.divide(middle - x_bc[:, 1], xi_bc[:, 1], out=np.full(len(xi_bc), -1.0), where=xi_bc[:, 1] != 0)
        return (share > 0) & (share < 1) & (x_bc[:, 0] + share * xi_bc[:, 0] < end)

    sim, bonds = crack.sim, crack.bonds
    t, X = sim.body.bonds, sim.body.X_nc
    sim.state.intact_b[:] = ~crossed(X[t.i_b], t.xi_bc(X))
    gone = crossed(bonds.reference.positions[bonds.i], -bonds.r_bc)
    bonds.gone = lambda frame: gone
    return crack.measure(None)


def test_nothing_broken_has_no_tip(followed):
    (md, area_md), (pd_, area_pd) = cut(followed, -9.0)
    assert np.isnan(md) and np.isnan(pd_) and area_md == area_pd == 0.0


@pytest.mark.parametrize("end", [3.2 * A, 5.6 * A, 7.4 * A])
def test_a_straight_cut(followed, end):
    """The tip of both is found within 0.6 distances of nodes, the area within a tenth."""
    (md, area_md), (pd_, area_pd) = cut(followed, end)
    assert md == pytest.approx(end, abs=0.6 * A) and pd_ == pytest.approx(end, abs=0.6 * A)
    want = end * COUNTS[2] * A
    assert area_md == pytest.approx(want, rel=0.06) and area_pd == pytest.approx(want, rel=0.06)


def test_a_cut_of_known_area_in_silicon():
    """Along (111), between double layers and within one: MD and PD have the same area, that of the cut."""
    c = crystal("silicon")
    a = float(np.linalg.norm(c.conventional[0]))
    axes = np.array([[2.0, -1, -1], [1, 1, 1], [0, -1, 1]]) / np.sqrt([[6], [3], [2]])
    edges = a * np.array([1.5, 3, 0.5]) ** 0.5 * [5, 4, 2]
    fcc = np.stack(np.meshgrid(*[np.arange(-24, 25)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fcc = 0.5 * a * fcc[fcc.sum(axis=1) % 2 == 0]
    X = np.concatenate([fcc, fcc + a / 4]) @ axes.T + 1e-6
    X = X[((X >= 0) & (X < edges)).all(axis=1)]
    assert len(X) == 5 * 4 * 2 * 12
    cell = Cell(np.diag(edges), periodic=(False, False, True))
    reference = Frame(X, cell, c.units, masses=np.full(len(X), c.masses[0]), source="silicon")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        made = body_of(reference, atc.kernel("quartic", 6.0), c.density, 4.0, None)
        sim = pd.Simulation(made.body, pd.LPS(bulk=1.0, shear=0.6), damage=pd.CriticalStretch(0.1))
    bonds = NearestBonds(reference, c)
    run = axes.T  # rows: where the crystal's axes point in the run
    crack = Crack(made, reference, atc.kernel("quartic", 6.0), bonds, sim, np.eye(3)[0], np.eye(3)[1], run)
    end, b = 0.55 * edges[0], 3**0.5 / 4 * a
    layers = np.unique(X[:, 1].round(6))
    low = layers[np.searchsorted(layers, 0.5 * edges[1]) :][:3]
    gaps = np.diff(low)
    assert sorted(gaps) == pytest.approx([b / 3, b], rel=1e-5)
    for k in range(2):
        (_, md), (_, pd_) = cut(crack, end, low[k] + 0.4 * gaps[k])
        want = end * edges[2]
        # Bonds end in steps of 3.3 angstrom along the way of 18; the nodes' faces are rounded by the kernel.
        assert md == pytest.approx(want, rel=0.1) and pd_ == pytest.approx(want, rel=0.1)
        (_, md), (_, pd_) = cut(crack, 99.0, low[k] + 0.4 * gaps[k])
        # Of sixty bonds within a double layer the open faces have two less.
        assert md == pytest.approx(edges[0] * edges[2], rel=0.04)
        assert pd_ == pytest.approx(edges[0] * edges[2], rel=0.06)


@pytest.mark.parametrize("name", ["argon", "silicon"])
@pytest.mark.parametrize("normal", [(1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 0), (0.3, 0.5, 0.81)])
def test_cuts_of_a_crystal_at_any_height(name, normal):
    """Bonds that a plane cuts, found by hand in a block, have its area together: exactly where the bonds that are cut
    lie between the same layers; else in the mean over heights. Counted alike, silicon's between double layers would
    have 1/1.5 of it, those within them twice as much."""
    c = crystal(name)
    block, _ = c.supercell((4, 4, 4))
    bonds = NearestBonds(block, c)
    n = np.array(normal) / np.linalg.norm(normal)
    area_b = bonds.area_b(n, np.eye(3))
    s = block.positions[bonds.i] @ n, (block.positions[bonds.i] - bonds.r_bc) @ n
    # Periodic along all axes: a plane and its images, an area of volume over length by each unit of height.
    total = (area_b * np.abs(s[0] - s[1])).sum()
    assert total == pytest.approx(abs(np.linalg.det(block.cell.vectors)), rel=1e-3)
    if name == "silicon" and normal == (1, 1, 1):
        b = 3**0.5 / 4 * np.linalg.norm(c.conventional[0])
        row = c.volume / (4 / 3 * b)  # of an atom in its layer
        far = np.abs(s[0] - s[1]) > 0.5 * b
        assert far.sum() * 3 == (~far).sum()
        assert area_b[far] == pytest.approx(row, rel=1e-4) and area_b[~far] == pytest.approx(row / 3, rel=1e-4)


def test_the_crystal_is_turned():
    """Axes given as of the run: the same areas as with the normal turned back."""
    c = crystal("silicon")
    block, _ = c.supercell((3, 3, 3))
    bonds = NearestBonds(block, c)
    axes = np.array([[2, -1, -1], [1, 1, 1], [0, -1, 1]]) / np.sqrt([[6], [3], [2]])
    run = axes.T  # rows: where the crystal's x, y, z point in a run whose axes lie along these directions
    before = bonds.area_b(axes[1], np.eye(3))
    bonds.r_bc = bonds.r_bc @ run
    assert bonds.area_b(np.array([0, 1.0, 0]), run) == pytest.approx(before, rel=1e-9)


def test_damage_elsewhere_does_not_move_the_tip(followed):
    """A node all of whose bonds are gone, far ahead: the tip stays with the crack."""
    before = cut(followed, 4.0 * A)[1]
    sim = followed.sim
    far = np.argmin(np.linalg.norm(sim.body.X_nc - [8.5 * A, 1.5 * A, 1.5 * A], axis=1))
    sim.state.intact_b[(sim.body.bonds.i_b == far) | (sim.body.bonds.j_b == far)] = 0
    after = followed.measure(None)[1]
    assert after[0] == before[0] and after[1] > before[1]


def test_in_the_dataset(tmp_path):
    """Torn in two between grips: both sides lose the area of the cross-section, and the twin the energy for it."""
    pull = lambda d: lambda X: np.where(X[:, :1] > 2.4 * A, [d, 0.0, 0.0], 0.0)  # noqa: E731
    frames = [block(), *(block(u=pull(d), time=500.0 * k) for k, d in enumerate((0.0, 1.0, 2.0, 3.0)))]
    boxes = [[[-9, -9, -9], [1.2 * A, 99, 99]], [[3.2 * A, -9, -9], [4.4 * A, 99, 99]]]
    more = {"crack_direction": [0, 1, 0], "crack_normal": [2, 0, 0]}
    found = twin_of(tmp_path / "run.dump", frames, grips=boxes, fracture=True, spacing=2.65, **more)
    ds = found.dataset
    assert ds["md_crack_area"].values[0] == ds["pd_crack_area"].values[0] == 0.0
    # One plane parts; that between the pulled end and the image of the held one is pressed together.
    L = 5 * A
    assert ds["md_crack_area"].values[-1] == pytest.approx(L**2, rel=1e-6)
    assert ds["pd_dissipated_energy"].values[-1] > 0 and ds["pd_dissipated_energy"].attrs["units"] == "eV"
    assert (np.diff(ds["pd_dissipated_energy"].values) >= 0).all()
    assert any("crack, MD: from frame" in line for line in found.lines)
    for wrong, words in (
        ({"crack_direction": [1, 0, 0]}, "needs crack_normal"),
        ({"crack_normal": [1, 0, 0]}, "needs crack_direction"),
        ({"crack_direction": [1, 0, 0], "crack_normal": [1, 1, 0]}, "must be normal"),
        ({**more, "fracture": False}, "where bonds break"),
    ):
        with pytest.raises(atc.AtcError, match=words), warnings.catch_warnings():
            warnings.simplefilter("ignore", atc.AtcWarning)
            atc.twin(scene(tmp_path / "run.dump", frames[:2], **{"fracture": True, **wrong}))
    with pytest.raises(atc.AtcError, match="not 0"):
        unit_vector([0, 0, 0], "crack_direction")
