"""Twins of runs in the plane: homogeneous deformations in closed form, cuts whose tip, area and energy are known."""

import warnings

import numpy as np
import pytest
import xarray as xr

import atc
from atc import pd
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.twins.body import body_of
from atc.twins.crack import Crack, add_crack
from atc.twins.damage import NearestBonds
from atc.twins.material import isotropic
from atc.upscaling.crystal import Crystal, relax

#: Springs of nearest neighbours, so that constants are closed forms: k = 2 alpha^2, 2 gamma = two bonds a length.
ALPHA = 7.0
MORSE = f"units lj\ndimension 2\npair_style morse 1.5\npair_coeff * * 1.0 {ALPHA} 1.0"
C11 = 3 * 3**0.5 / 4 * 2 * ALPHA**2
NX, NY = 24, 12


def sheet(strain=None, time=0.0, periodic=(True, True), u=None):
    """A triangular crystal of 24 x 24 rows, strained (2 x 2) and displaced."""
    row = np.arange(NX) + 0.25
    X = np.array([(x + 0.5 * (k % 2), (k + 0.5) * 3**0.5 / 2) for k in range(2 * NY) for x in row])
    F = np.eye(2) if strain is None else np.eye(2) + strain
    x = np.zeros((len(X), 3))
    x[:, :2] = X @ F.T + (0.0 if u is None else u(X))
    cell = np.diag([NX, NY * 3**0.5, 1.0])
    cell[:2, :2] = cell[:2, :2] @ F.T
    return Frame(
        x,
        Cell(cell, (0, 0, -0.5), (*periodic, False)),
        atc.units.units("lj").planar,
        masses=np.ones(len(x)),
        velocities=np.zeros_like(x),
        time=time,
        source="sheet",
    )


def write(path, frames):
    with open(path, "w") as f:
        for k, frame in enumerate(frames):
            L, b = np.diag(frame.cell.vectors), "".join(" pp" if p else " ff" for p in frame.cell.periodic[:2])
            f.write(f"ITEM: UNITS\nlj\nITEM: TIME\n{frame.time:.15g}\nITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n")
            f.write(f"{len(frame)}\nITEM: BOX BOUNDS{b} pp\n0 {L[0]:.17g}\n0 {L[1]:.17g}\n-0.5 0.5\n")
            f.write("ITEM: ATOMS id type x y z vx vy vz\n")
            rows = np.column_stack([frame.ids, frame.types, frame.positions, frame.velocities])
            np.savetxt(f, rows, "%d %d" + 6 * " %.15g")


def twin_of(path, frames, **settings):
    write(path, frames)
    scene = {
        "trajectory": {"file": str(path), "reference": 0, "frames": "1:", "masses": [1.0], "dimension": 2},
        "potential": {"lammps": MORSE},
        "kernel": {"name": "quartic", "radius": 3.0},
        "grid": {"kind": "regular", "shape": [12, 10]},
        "twin": {"structure": "hexagonal", "lattice_constant": 1.02, "spacing": 1.0, **settings},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        return atc.twin(scene)


def test_a_strained_sheet(tmp_path):
    """Both have the stress C eps in box and field, within what nodes sample (1 %) and the crystal's nonlinearity."""
    e = 1e-4
    found = twin_of(tmp_path / "run.dump", [sheet(), sheet(np.diag([0.0, e]))], motion="static")
    ds = found.dataset
    want = np.zeros((3, 3))
    want[0, 0], want[1, 1] = C11 / 3 * e, C11 * e
    # 1.5 alpha: the relative slope of a Morse bond's stiffness.
    for side, rel in (("md", 1.5 * ALPHA * e * 2), ("pd", 0.01)):
        assert ds[f"{side}_box_stress"].values[0] == pytest.approx(want, abs=rel * C11 * e)
        s = ds[f"{side}_stress"].values[0]
        assert s == pytest.approx(np.broadcast_to(want, s.shape), abs=0.01 * C11 * e)
        # A kernel of three neighbours' distances ripples by half a per cent.
        assert ds[f"{side}_density"].values == pytest.approx(2 / 3**0.5 / (1 + e), rel=0.01)
    assert ds["md_box_stress"].attrs["units"] == ds["pd_box_stress"].attrs["units"] == "epsilon/sigma^2"
    assert found.body.body.dimension == 2 and found.body.body.plane == "strain"
    assert ds["pd_displacement"].values == pytest.approx(ds["md_displacement"].values, abs=1e-3 * e * NY * 3**0.5)


def test_influence(tmp_path):
    """Of the isotropic law; lengths in the run's units. Small strains are exact, but for what nodes sample (2 %)."""
    e = 1e-4
    frames = [sheet(), sheet(np.diag([0.0, e]))]
    said = {"influence": "exp(-r/2)", "orient": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}
    found = twin_of(tmp_path / "run.dump", frames, motion="static", **said)
    law = found.material.material.influence
    assert law(np.array([2.0]), 3.0) == pytest.approx(np.exp(-1.0))
    assert found.dataset["pd_box_stress"].values[0][1, 1] == pytest.approx(C11 * e, rel=0.02)


def test_influence_of_other_materials():
    from atc.pd.materials.influence import of_vector
    from atc.twins.choice import _influence
    from atc.units import units

    settings = {"material": "cauchy-born", "influence": "1 + x^2"}
    law = _influence(lambda key, default=None: settings.get(key, default), units("si"), 5.0)
    # metres in the formula, angstroms in the engine
    assert of_vector(law) and law(np.array([[1e10, 0, 0]])) == pytest.approx([2.0], rel=1e-12)
    settings["material"] = "linear"
    with pytest.raises(AtcError, match="influence: the springs of linear are the crystal's"):
        _influence(lambda key, default=None: settings.get(key, default), units("si"), 5.0)


@pytest.fixture(scope="module")
def strip():
    """(Crack, its simulation, Gc) of a sheet open on all sides, whose upper half is lifted: y = the middle parts."""
    pot = atc.potential(MORSE)
    crystal = relax(Crystal.planar("hexagonal", 1.0, 1.0, "lj"), pot)
    reference, kernel = sheet(periodic=(False, False)), atc.kernel("quartic", 2.5).planar()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        made = body_of(reference, kernel, crystal.density, 0.75, None)
    material, Gc = isotropic(crystal, pot, "lps", made.step_cc, made.body.horizon).material, 2.0
    X = made.body.X_nc
    up = X[:, 1:2] > MIDDLE
    lift = pd.Prescribed(np.ones(len(X), bool), displacement=lambda t: np.where(up, [0.0, t, 0.0], 0.0))
    damage = pd.CriticalStretch.from_energy(Gc, material, made.body)
    sim = pd.Simulation(made.body, material, damage=damage, conditions=[lift])
    bonds = NearestBonds(reference, crystal)
    along, normal = np.eye(3)[:2]
    return Crack(made, reference, kernel, bonds, sim, along, normal), sim, Gc


MIDDLE = NY * 3**0.5 / 2 + 0.01


def cut(crack, end):
    """Lose all bonds of both across y = MIDDLE where x < end."""
    notch = pd.Notch.line((-9.0, MIDDLE), (end, MIDDLE))
    t, X = crack.sim.body.bonds, crack.sim.body.X_nc
    crack.sim.state.intact_b[:] = ~notch.crosses(X[t.i_b], t.xi_bc(X))
    gone = notch.crosses(crack.bonds.reference.positions[crack.bonds.i], -crack.bonds.r_bc)
    crack.bonds.gone = lambda frame: gone
    return crack.measure(None)


def test_a_cut_that_grows(strip):
    """Tip and speed of a cut whose end moves at 2; its length. The tip within half a distance of neighbours."""
    crack = strip[0]
    before = crack.sim.state.intact_b.copy()
    times = np.arange(6.0)
    ends = 5.0 + 2.0 * times
    found = [cut(crack, end) for end in ends]
    crack.sim.state.intact_b[:] = before
    data = xr.Dataset()
    add_crack(data, crack.bonds.reference.units, times, found)
    for side in ("md", "pd"):
        assert data[f"{side}_crack_tip"].values == pytest.approx(ends, abs=0.6)
        assert data[f"{side}_crack_speed"].values.mean() == pytest.approx(2.0, rel=0.05)
        assert data[f"{side}_crack_area"].values == pytest.approx(ends, abs=0.7)
        assert data[f"{side}_crack_area"].attrs["units"] == "sigma"


def test_parting_a_body_costs_gc(strip):
    """Halves lifted apart slowly: every bond across breaks at its critical stretch, all together cost Gc by length (the
    nodes sample that within 8 %), and the parted length is the body's."""
    crack, sim, Gc = strip
    sim.dt = 1e-3
    for _ in range(40):
        sim.step(20)
    (_, _), (tip, area) = crack.measure(crack.bonds.reference)
    assert area == pytest.approx(NX, rel=0.03)
    assert sim.energies().dissipated_fracture == pytest.approx(Gc * NX, rel=0.08)
    assert tip > NX - 1.0


def test_notches(tmp_path):
    """A cut that the potential's script makes, not the atoms' places, is in both from the start; a Gc of one's own."""
    frames = [sheet(), sheet(), sheet(time=0.05)]
    more = {"fracture": True, "crack_direction": [1, 0, 0], "crack_normal": [0, 1, 0]}
    found = twin_of(tmp_path / "run.dump", frames, notches=[[[-1, MIDDLE], [9.5, MIDDLE]]], fracture_energy=1.5, **more)
    ds, s = found.dataset, found.material
    assert s.damage.s00 == pytest.approx((1.5 / s.material.fracture_energy(found.body.body, 1.0)) ** 0.5, rel=1e-12)
    assert "Gc = 1.5 epsilon/sigma, as given; 2 gamma(01) = 2 epsilon/sigma" in "\n".join(found.lines)
    for side in ("md", "pd"):
        assert ds[f"{side}_crack_tip"].values == pytest.approx(9.5, abs=0.6)
        assert ds[f"{side}_crack_area"].values == pytest.approx(9.5, abs=0.7)
    assert ds["pd_dissipated_energy"].values == pytest.approx(0.0, abs=1e-12)
    # The horizon of equal strength: strength goes with its root.
    own = s.damage.s00 * C11
    assert s.nodes_strength == pytest.approx(own, rel=1e-6)
    assert f"a horizon of {s.horizon * (own / s.strength.stress) ** 2:.3g} sigma" in "\n".join(found.lines)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"structure": "fcc"}, "a run in the plane has one of hexagonal, not fcc"),
        ({"material": "linear"}, 'is of material = "isotropic"'),
        ({"notches": [[[0, 0], [1, 1]]]}, "goes with fracture = true"),
        ({"fracture_energy": 1.0}, "goes with fracture = true"),
        ({"fracture": True, "notches": [[[0, 0, 0], [1, 1, 0]]]}, r"each is \[\[x, y\], \[x, y\]\]"),
        ({"fracture": True, "notches": [[[0, 0], [1]]]}, r"each is \[\[x, y\], \[x, y\]\]"),
        ({"fracture": True, "notches": [[[90, 90], [99, 99]]]}, "crosses no bond"),
        ({"fracture": True, "notches": [[[4, 9], [4, 9]]]}, r"notches: a notch needs a length: .* \[4.0, 9.0\] to"),
        ({"orient": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}, "orient: .* a run in the plane keeps the crystal's z"),
        ({"orient": [[0, 1, 0], [1, 0, 0], [0, 0, 1]]}, "orient: .* right-handed"),
        ({"influence": "1 + x^2"}, r"\[twin\] influence: .*lps anisotropic"),
    ],
)
def test_what_does_not_go_together(tmp_path, wrong, words):
    with pytest.raises(AtcError, match=words):
        twin_of(tmp_path / "run.dump", [sheet(), sheet()], **wrong)


def test_only_plates_are_planar():
    """A snapshot as of a run in the plane is of a body in two dimensions, with its whole mass."""
    x = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    law = pd.LPS(bulk=1.0, shear=0.6)
    sim = pd.Simulation(pd.Body(x, 1.0, 3.0, 2.1, dimension=2, plane="strain", warn=False), law)
    frame, bonds = pd.snapshot(sim, "lj", planar=True)
    assert frame.dimension == bonds.dimension == 2 and frame.masses.sum() == pytest.approx(3.0 * len(x))
    assert pd.reference_frame(sim, "lj", planar=True).dimension == 2
    with pytest.raises(AtcError, match="one of a body in two dimensions, this one has 3"):
        pd.snapshot(pd.Simulation(pd.Body(x, 1.0, 3.0, 2.1, warn=False), law), "lj", planar=True)


def test_cuts_lose_as_many_bonds_at_a_face_as_inside():
    """Of the periodic sheet: two bonds for each unit of length between two rows, wherever these are."""
    crystal, reference = Crystal.planar("hexagonal", 1.0, 1.0, "lj"), sheet()
    for row in (1, 12, 2 * NY - 1, 2 * NY - 1e-6):
        y = row * 3**0.5 / 2
        notch = pd.Notch.line((4.1, y), (14.1, y), as_damage=True)
        assert NearestBonds(reference, crystal, [notch]).cut.sum() == 20
