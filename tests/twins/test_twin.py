"""`atc twin`: bodies against counted volumes, conditions against exact maps, moduli against the crystal's, and runs whose
answer is known in closed form, homogeneous deformations."""

import warnings

import numpy as np
import pytest
import xarray as xr
from crystals import ARGON, DATA, crystal, elastic
from PIL import Image
from typer.testing import CliRunner

import atc
from atc.cli import app
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.twins.body import body_of
from atc.twins.conditions import displacement, gradient, held_open, mapped, smoothed_displacement
from atc.twins.material import hill, isotropic_vv

REPEAT = 5


def block(strain=None, u=None, time=0.0):
    """An argon crystal of 5 x 5 x 5 cubes, strained, in metal units."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    cells = np.stack(np.meshgrid(*[np.arange(REPEAT)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    X = ((cells + np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])) * a).reshape(-1, 3) + 0.1
    F = np.eye(3) if strain is None else np.eye(3) + strain
    x = (X + (0 if u is None else u(X))) @ F.T
    units = crystal("argon").units
    cell = Cell(np.eye(3) * a * REPEAT @ F.T)
    return Frame(
        x,
        cell,
        units,
        masses=np.full(len(X), crystal("argon").masses[0]),
        velocities=np.zeros_like(X),
        time=time,
        source="argon",
    )


def write(path, frames):
    """A dump with 15 digits."""
    with open(path, "w") as f:
        for k, frame in enumerate(frames):
            u = frame.units
            L, v = np.diag(frame.cell.vectors), u.to_user("velocity", frame.velocities)
            f.write(f"ITEM: UNITS\nmetal\nITEM: TIME\n{u.to_user('time', frame.time):.15g}\nITEM: TIMESTEP\n{k}\n")
            f.write(f"ITEM: NUMBER OF ATOMS\n{len(frame)}\nITEM: BOX BOUNDS pp pp pp\n")
            f.writelines(f"0 {length:.17g}\n" for length in L)
            f.write("ITEM: ATOMS id type x y z vx vy vz\n")
            np.savetxt(f, np.column_stack([frame.ids, frame.types, frame.positions, v]), "%d %d" + 6 * " %.15g")


def scene(path, frames, **settings):
    write(path, frames)
    return {
        "trajectory": {"file": str(path), "reference": 0, "frames": "1:", "masses": [39.948]},
        "potential": {"lammps": ARGON},
        "kernel": {"name": "quartic", "radius": 12.0},
        "grid": {"kind": "regular", "shape": [4, 3, 3]},
        "twin": {"structure": "fcc", "lattice_constant": 5.3, **settings},
    }


def twin_of(*args, **settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        return atc.twin(scene(*args, **settings))


def test_hill_averages():
    """Of an isotropic solid its own; of copper the published 54.6 (Voigt), 40.0 (Reuss) and their mean."""
    assert hill(isotropic_vv(3.0, 2.0)) == pytest.approx((3.0, 2.0), rel=1e-14)
    C = np.diag([168.4 - 121.4] * 3 + [75.4] * 3)
    C[:3, :3] += 121.4
    K, G = hill(C)
    assert pytest.approx((168.4 + 2 * 121.4) / 3, rel=1e-12) == K
    voigt = (168.4 - 121.4 + 3 * 75.4) / 5
    reuss = 5 / (4 / (168.4 - 121.4) + 3 / 75.4)
    assert pytest.approx((voigt + reuss) / 2, rel=1e-12) == G


def test_body_of_a_full_crystal():
    """Every lattice point is a node, volume and mass are the crystal's."""
    frame = block()
    kernel = atc.kernel("quartic", 8.0)
    made = body_of(frame, kernel, crystal("argon").density, 5.3, None)
    body = made.body
    assert len(body) == REPEAT**3
    assert body.V_n.sum() == pytest.approx(frame.cell.volume, rel=1e-12)
    assert (body.rho_n * body.V_n).sum() == pytest.approx(frame.masses.sum(), rel=1e-12)
    assert made.density == pytest.approx(crystal("argon").density, rel=1e-9)


def test_body_with_a_surface_and_a_hole():
    """Half of a periodic cell with a round hole through it: the volume of the nodes is that of the solid."""
    frame = block()
    L = frame.cell.vectors[0, 0]
    wide = Cell(np.diag([2 * L, L, L]), periodic=(False, True, True))
    inside = np.hypot(frame.positions[:, 0] - L / 2, frame.positions[:, 1] - L / 2) > 5.0
    solid = frame.replace(
        **{n: getattr(frame, n)[inside] for n in ("positions", "velocities", "masses", "types", "ids")}, cell=wide
    )
    kernel = atc.kernel("quartic", 7.0)
    body = body_of(solid, kernel, crystal("argon").density, 2.65, 8.0).body
    want = solid.masses.sum() / crystal("argon").density
    assert body.V_n.sum() == pytest.approx(want, rel=0.04)
    assert (body.rho_n * body.V_n).sum() == pytest.approx(solid.masses.sum(), rel=1e-12)
    r = np.hypot(body.X_nc[:, 0] - L / 2, body.X_nc[:, 1] - L / 2)
    assert r.min() > 3.0
    assert -2.65 < body.X_nc[:, 0].min() and body.X_nc[:, 0].max() < L + 2.65


def test_linear_displacements_are_smoothed_exactly():
    """Through periodic faces, in a sheared cell, with atoms wrapped back into it."""
    H = np.array([[0.02, 0.01, 0.0], [0.0, -0.01, 0.03], [0.0, 0.0, 0.015]])
    reference, moved = block(), block(H)
    wrapped = moved.replace(positions=moved.cell.wrap(moved.positions - 3.0)[0])
    shift = wrapped.replace(positions=wrapped.positions)
    made = body_of(reference, atc.kernel("quartic", 8.0), crystal("argon").density, 5.3, None)
    X = made.body.X_nc
    assert displacement(moved, reference) == pytest.approx(reference.positions @ H.T, abs=1e-12)
    assert displacement(shift, reference) == pytest.approx(reference.positions @ H.T - 3.0, abs=1e-12)
    assert smoothed_displacement(shift, reference, made.smoothing, X) == pytest.approx(X @ H.T - 3.0, abs=1e-12)
    assert gradient(reference.cell, moved.cell) == pytest.approx(np.eye(3) + H, abs=1e-14)
    assert mapped(X, reference.cell, moved.cell) == pytest.approx(X @ (np.eye(3) + H).T, abs=1e-12)


def test_a_box_drawn_around_open_axes_is_no_deformation():
    cell, wider = (Cell(np.diag([x, 20.0, 20.0]), (-x / 2, 0, 0), (False, True, True)) for x in (30.0, 50.0))
    assert held_open(wider, cell) == cell
    with pytest.raises(AtcError, match="periodic along the same axes"):
        held_open(Cell(np.diag([30.0, 20.0, 20.0])), cell)


def test_uniform_dilatation_is_that_of_the_crystal(tmp_path):
    """σ = 3Kε in MD and PD: equal to second order in the strain; displacements agree as far as the kernel sees lattices."""
    strain = 1e-5
    found = twin_of(tmp_path / "run.dump", [block(), block(strain * np.eye(3), time=1.0)], motion="static")
    ds, K = found.dataset, found.material.bulk
    want = crystal("argon").units.to_user("pressure", 3 * K * strain)
    md, pd = (ds[f"{s}_box_stress"].values[0] for s in ("md", "pd"))
    assert pd == pytest.approx(want * np.eye(3), abs=1e-4 * want)
    assert md == pytest.approx(pd, abs=1e-3 * want)
    u_md, u_pd = (ds[f"{s}_displacement"].values[0] for s in ("md", "pd"))
    assert np.ptp(u_md) > 0.5 * strain * 15
    assert u_pd == pytest.approx(u_md, abs=0.05 * np.abs(u_md).max())
    assert K == pytest.approx((elastic("argon").cubic[0] + 2 * elastic("argon").cubic[1]) / 3, rel=1e-9)
    at = ds["md_stress"].values[0, ..., 0, 0], ds["pd_stress"].values[0, ..., 0, 0]
    assert at[0].mean() == pytest.approx(at[1].mean(), rel=1e-2)


def test_uniaxial_strain_misses_the_crystal_by_its_anisotropy(tmp_path):
    """σ_xx: MD C11 ε, PD that of the isotropic solid as its nodes sample it; nothing in between."""
    strain = 1e-5
    found = twin_of(
        tmp_path / "run.dump", [block(), block(np.diag([strain, 0, 0]), time=1.0)], motion="static", spacing=2.65
    )
    u, ds = crystal("argon").units, found.dataset
    md, pd = (u.to_internal("pressure", ds[f"{s}_box_stress"].values[0, 0, 0]) / strain for s in ("md", "pd"))
    assert md == pytest.approx(elastic("argon").cubic[0], rel=1e-3)
    assert pd == pytest.approx(found.material.sampled_vv[0, 0], rel=1e-3)
    assert found.material.error < 0.1


def test_the_crystal_as_material_has_the_crystals_stress(tmp_path):
    """A perfect crystal far from linear, in MD and as a twin: equal box stresses, stretched by 3, -0.5 and 1 %."""
    H = np.array([[0.03, 0.0, 0.0], [0.0, -0.005, 0.0], [0.0, 0.0, 0.01]])
    found = twin_of(tmp_path / "run.dump", [block(), block(H, time=1.0)], motion="static", material="cauchy-born")
    ds = found.dataset
    md, pd = (ds[f"{s}_box_stress"].values[0] for s in ("md", "pd"))
    assert pd == pytest.approx(md, abs=1e-6 * np.abs(md).max())
    # The energy is the crystal's, from that at rest on: of the same sign and size as half of stress times strain.
    stored = [ds[f"{s}_energy"].values[0] for s in ("md", "pd")]
    assert stored[1].mean() == pytest.approx(stored[0].mean(), rel=1e-3) and stored[1].mean() > 0
    linear = crystal("argon").units.to_user("pressure", elastic("argon").C_vv[0, :3] @ H.diagonal())
    assert abs(md[0, 0] / linear - 1) > 0.05
    assert any("the softest plane wave" in line for line in found.lines)


def test_the_potential_itself_on_the_atoms_is_the_run(tmp_path):
    """Atoms pushed about a little: the twin stands where the atoms were, with their stress."""
    push = lambda X: 0.05 * np.random.default_rng(0).normal(size=X.shape)  # noqa: E731
    frames = [block(), block(u=push, time=1.0)]
    found = twin_of(tmp_path / "run.dump", frames, motion="dynamic", material="smoothed", nodes="atoms")
    ds = found.dataset
    for name in ("displacement", "stress", "box_stress"):
        md, pd = (ds[f"{s}_{name}"].values for s in ("md", "pd"))
        assert pd == pytest.approx(md, abs=1e-8 * np.abs(md).max())


def test_springs_carry_a_small_strain(tmp_path):
    strain = 1e-5
    frames = [block(), block(np.diag([strain, 0, 0]), time=1.0)]
    found = twin_of(tmp_path / "run.dump", frames, motion="static", material="linear", horizon=13.3)
    md, pd = (found.dataset[f"{s}_box_stress"].values[0, 0, 0] for s in ("md", "pd"))
    assert pd == pytest.approx(md, rel=1e-3)
    assert found.material.error < 1e-9 and any("of the nodes' zone boundary" in line for line in found.lines)


def test_a_growing_box_takes_the_nodes_along(tmp_path):
    """Between frames the cell moves on the straight way, and the twin ends in the state of the affine map."""
    frames = [block(), block(time=0.0), block(2e-4 * np.eye(3), time=400.0)]
    found = twin_of(tmp_path / "run.dump", frames, motion="dynamic")
    sim = found.simulation
    X = sim.body.X_nc
    assert sim.state.u_nc == pytest.approx(2e-4 * X, abs=1e-9)
    assert np.abs(sim.state.v_nc).max() < 1e-9
    assert sim.state.time == pytest.approx(400.0, rel=1e-12) and sim.state.step > 3
    md, pd = (found.dataset[f"{s}_box_stress"].values[1, 0, 0] for s in ("md", "pd"))
    assert pd == pytest.approx(md, rel=0.01)


def test_grips_follow_their_atoms(tmp_path):
    """Nodes in a held box have the smoothed displacement of the atoms, the others do not."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    push = lambda X: np.where(X[:, :1] < 1.5 * a, [0.02, 0.0, 0.0], 0.0)  # noqa: E731
    frames = [block(), block(time=0.0), block(u=push, time=300.0)]
    box = [[[0.0, 0.0, 0.0], [a, 99.0, 99.0]]]
    found = twin_of(tmp_path / "run.dump", frames, motion="dynamic", grips=box)
    sim = found.simulation
    held = sim.body.X_nc[:, 0] <= a
    want = smoothed_displacement(frames[2], frames[0], found.body.smoothing, sim.body.X_nc)
    assert held.any() and not held.all()
    assert sim.state.u_nc[held] == pytest.approx(want[held], abs=1e-9)
    assert np.abs(sim.state.u_nc[~held] - want[~held]).max() > 1e-4


def test_plate_command(tmp_path):
    """The shipped plate from the command line, two of its frames: dataset, table, picture; the known excess of an
    isotropic solid (silicon is softer along [100] than on average)."""
    out, png = tmp_path / "twin.nc", tmp_path / "twin.png"
    done = CliRunner().invoke(
        app,
        ["twin", str(DATA / "silicon_plate" / "twin.toml"), "-o", str(out), "--picture", str(png), "--step", "19"]
        + ["--movie", str(tmp_path / "twin.gif")]
        + ["--set", "grid.shape=[15, 16, 2]"],
    )
    assert done.exit_code == 0, done.output
    for words in ("material: isotropic (lps)", "not exact: anisotropy", "left out: temperature", "interior"):
        assert words in done.output
    assert png.stat().st_size > 10_000
    with Image.open(tmp_path / "twin.gif") as gif:
        assert gif.n_frames == 2 and gif.size[0] > 600
    with xr.open_dataset(out) as ds:
        md, pd = (ds[f"{s}_box_stress"].mean("frame").values[0, 0] for s in ("md", "pd"))
        assert 1.2 < pd / md < 1.35
        assert {"md_stress", "pd_stress", "difference_stress", "md_displacement"} <= set(ds.data_vars)
        assert ds.attrs["displacement_interior_relative"] < 0.1


@pytest.mark.parametrize(
    "section, key, value, words",
    [
        ("twin", "structure", None, "needs structure and lattice_constant"),
        ("twin", "temperature", 20.0, "only material"),
        ("twin", "grips", [[[900, 0, 0], [901, 1, 1]]], "no node of the twin lies in box 1 of grips"),
        ("twin", "grip_types", [7], "no node of the twin is made of atoms of type 7"),
        ("twin", "horizon", 5.4, "less than 1.5 times"),
        ("twin", "orient", [[1, 1, 0], [1, 1, 1], [0, 0, 1]], "normal to each other"),
        ("grid", "kind", "atoms", "not atoms"),
        ("kernel", None, None, "a twin needs it"),
    ],
)
def test_refusals(tmp_path, section, key, value, words):
    given = scene(tmp_path / "run.dump", [block(), block(time=1.0)])
    if key is None:
        del given[section]
    elif value is None:
        del given[section][key]
    elif key == "kind":
        given[section] = {key: value}
    else:
        given[section][key] = value
    with pytest.raises(AtcError, match=words), warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        atc.twin(given)


def test_a_loaded_reference_is_warned_about(tmp_path):
    given = scene(tmp_path / "run.dump", [block(0.01 * np.eye(3)), block(0.01 * np.eye(3), time=1.0)], motion="static")
    with pytest.warns(atc.AtcWarning, match="not free of stress"):
        atc.twin(given)


def test_the_stress_of_the_reference_is_added(tmp_path):
    """A reference under tension: with its own stress the twin has that of the run, in the box and on the grid."""
    stretch = 0.002 * np.eye(3)
    frames = [block(stretch), block(stretch, time=1.0)]
    given = scene(tmp_path / "run.dump", frames, motion="static", reference_stress=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        ds = atc.twin(given).dataset
    for name in ("box_stress", "stress"):
        md, pd = (ds[f"{s}_{name}"].values for s in ("md", "pd"))
        assert md[0].reshape(-1, 3, 3)[0, 0, 0] > 100 and pd == pytest.approx(md, abs=1e-6 * np.abs(md).max())


def test_the_plate_at_300_kelvin(tmp_path):
    """The shipped prediction, two of the frames: the mean stress within 3 % of the run's, the others with its faces'."""
    from atc.config.scene import Scene

    made = Scene.load(
        DATA / "silicon_plate" / "twin_300K.toml", {"trajectory.frames": "::19", "grid.shape": [15, 16, 2]}
    )
    ds = atc.twin(made).dataset
    md, pd = (ds[f"{s}_box_stress"].mean("frame").values for s in ("md", "pd"))
    assert pd[0, 0] == pytest.approx(md[0, 0], rel=0.03)
    assert pd[2, 2] == pytest.approx(md[2, 2], abs=0.02 * md[0, 0]) and pd[1, 1] == pytest.approx(
        0, abs=0.005 * md[0, 0]
    )
    assert pd[0, 2] == pytest.approx(md[0, 2], abs=0.01 * md[0, 0]) and pd[0, 2] < -500
    assert ds.attrs["displacement_interior_relative"] < 0.06
