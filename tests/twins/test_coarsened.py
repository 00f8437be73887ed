"""Silling's coarsening as a twin's material: forces on single atoms at rest, against LAMMPS; forces of a script on some
of the atoms arrive at the nodes whole."""

import os
import warnings

import numpy as np
import pytest
from crystals import ARGON, crystal
from lammps_oracle import lammps_session
from test_linear import supercell

import atc
from atc.errors import AtcError, AtcWarning
from atc.twins.body import body_of
from atc.twins.conditions import displacement
from atc.twins.linear import kept_place

#: eV/Å on either of two atoms.
PULL = 0.002
REPEAT = (8, 4, 4)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A periodic block of argon under forces along x on two atoms half its length apart, at rest by LAMMPS."""
    folder = tmp_path_factory.mktemp("load")
    frame = supercell("argon", REPEAT)
    L, n = np.diag(frame.cell.vectors), len(frame)
    one = int(np.argmin(np.linalg.norm(frame.positions - 0.5 * L, axis=1)))
    d = frame.positions - frame.positions[one] - [0.5 * L[0], 0, 0]
    two = int(np.argmin(np.linalg.norm(d - L * np.rint(d / L), axis=1)))
    with open(folder / "block.data", "w") as f:
        f.write(f"block\n\n{n} atoms\n1 atom types\n" + "".join(f"0 {e:.15g} {c}lo {c}hi\n" for c, e in zip("xyz", L)))
        f.write("\nMasses\n\n1 39.948\n\nAtoms # atomic\n\n")
        np.savetxt(f, np.column_stack([np.arange(1, n + 1), np.ones(n), frame.positions]), "%d %d" + 3 * " %.15g")
    script = f"""units metal
boundary p p p
read_data block.data
{ARGON}
group one id {one + 1}
group two id {two + 1}
group x type 1
fix pull one addforce {PULL} 0 0
fix back two addforce -{PULL} 0 0
fix plane x planeforce 0 0 1
fix integrate all nve
dump d all custom 1 run.dump id type x y z vx vy vz
dump_modify d sort id units yes time yes format float %.15g
"""
    (folder / "in.load").write_text(script.replace("fix plane x planeforce 0 0 1\n", ""))
    (folder / "in.plane").write_text(script)
    here = os.getcwd()
    os.chdir(folder)
    try:
        with lammps_session() as lmp:
            commands = (folder / "in.load").read_text().split("dump d")
            lmp.commands_string(commands[0] + "min_style fire\nminimize 0 1e-10 5000 20000\n")
            lmp.commands_string("reset_timestep 0 time 0\ndump d" + commands[1] + "run 0\n")
        (folder / "one.txt").write_text(f"{one} {two}")
    finally:
        os.chdir(here)
    return folder


def nearest(cell, d):
    """Differences of places by their nearest images, in a rectangular cell."""
    L = np.diag(cell.vectors)
    return d - L * np.rint(d / L)


def scene(run, script="in.load", **settings):
    return {
        "trajectory": {"file": str(run / "run.dump"), "reference": str(run / "block.data"), "masses": [39.948]},
        "potential": {"input": str(run / script)},
        "kernel": {"name": "quartic", "radius": 6.0},
        "grid": {"kind": "regular", "shape": [8, 4, 4]},
        "twin": {"structure": "fcc", "lattice_constant": 5.3, "motion": "static", **settings},
    }


def twin(given):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        return atc.twin(given)


def test_atoms_that_are_pulled(run):
    """Nodes are atoms, as far as these keep; where forces act they move as the atoms do within 1 %, elsewhere within 5 %
    (rms, of what the horizon cuts off); springs fitted to ω are a third off at the loads."""
    found = twin(scene(run, material="coarsened"))
    body, ref = found.body.body, supercell("argon", REPEAT)
    now = atc.read(run / "run.dump")[0]
    u = displacement(now, ref)
    u -= u.mean(axis=0)
    which = [int(np.argmin(np.linalg.norm(nearest(ref.cell, X - ref.positions), axis=1))) for X in body.X_nc]
    assert np.abs(nearest(ref.cell, body.X_nc - ref.positions[which])).max() < 1e-9
    mine, right = found.simulation.state.u_nc, u[which]
    mine = mine - mine.mean(axis=0)
    loaded = np.isin(which, np.loadtxt(run / "one.txt", int))
    assert loaded.sum() == 2
    assert mine[loaded] == pytest.approx(right[loaded], abs=0.01 * np.abs(right).max())
    rest = lambda v: np.linalg.norm((v - right)[~loaded]) / np.linalg.norm(right[~loaded])  # noqa: E731
    assert rest(mine) < 0.05
    text = "\n".join(found.lines)
    assert "nodes for 4 cells each" in text and "1.4 % of the springs that the horizon cuts off" in text
    other = twin(scene(run, material="linear"))
    top = other.simulation.state.u_nc
    assert np.abs(top - top.mean(axis=0)).max() < 0.67 * np.abs(right).max()


def test_forces_on_some_atoms_arrive_whole(run):
    """No node has half of its mass from a single atom; the forces on nodes add up to those on the atoms all the same."""
    found = twin(scene(run, material="isotropic"))
    sim = found.simulation
    total = []
    for law in sim.rigid:
        F = np.zeros_like(sim.positions_nc)
        law.add(0.0, sim._z, F)
        total.append(F.sum(axis=0))
    force = crystal("argon").units.to_internal("force", PULL)
    assert np.array(total) == pytest.approx(np.array([[force, 0, 0], [-force, 0, 0]]), rel=1e-9, abs=1e-12)


def test_a_plane_that_atoms_keep_to(run):
    """fix planeforce normal to an axis: that component follows the atoms."""
    found = twin(scene(run, "in.plane", material="linear"))
    line = next(line for line in found.lines if "planeforce" in line)
    assert f"held at the smoothed displacement of its atoms ({len(found.body.body)} nodes)" in line
    md, pd = (found.dataset[f"{s}_node_displacement"].values[0] for s in ("md", "pd"))
    assert pd[:, 2] == pytest.approx(md[:, 2], abs=1e-12)
    assert np.abs(pd[:, 0] - md[:, 0]).max() > 1e-6


def test_who_is_lost_is_said(run):
    script = (run / "in.plane").read_text().replace("fix plane x planeforce 0 0 1", "fix still one setforce 0 0 0")
    (run / "in.still").write_text(script)
    with pytest.warns(AtcWarning, match="setforce of group one: no node has half of its mass from these 1 atoms"):
        atc.twin(scene(run, "in.still"))


def test_what_it_is_not_for(run):
    with pytest.raises(AtcError, match=r"steps from node to node .* % off its lattice vectors: take a spacing"):
        twin(scene(run, material="coarsened", spacing=4.0))
    given = scene(run, material="coarsened", motion="dynamic")
    with pytest.warns(AtcWarning, match="coarsened springs are those of rest: waves of theirs are too slow"):
        atc.twin(given)


def test_nodes_of_a_basis_are_centres_of_its_cells():
    c, frame = crystal("silicon"), supercell("silicon", (2, 2, 2))
    through = kept_place(frame, c, np.eye(3))
    kernel = atc.kernel("quartic", 6.0)
    made = body_of(frame, kernel, c.density, c.lattice_constant, None, 1.8, through=through)
    d = np.sort(np.linalg.norm(nearest(frame.cell, made.body.X_nc[:, None] - frame.positions), axis=2), axis=1)
    assert len(made.body) == 8 and d[:, :2] == pytest.approx(np.full((8, 2), 3**0.5 / 8 * 5.431), abs=1e-2)
