"""What a script does to atoms from outside, done to the nodes: a Lennard-Jones slab that LAMMPS indents, and its twin."""

import os
import warnings

import numpy as np
import pytest
from crystals import ARGON, crystal
from lammps_oracle import lammps_session
from test_linear import supercell

import atc

SCRIPT = f"""units metal
boundary p p f
read_data slab.data
{ARGON}
region low block INF INF INF INF INF 3.3
group low region low
region side block INF 4.0 INF INF 3.3 6.5
group side region side
fix hold low setforce 0 0 0
fix drive side move linear 0 0.3 0
group rest subtract all side
fix integrate rest nve
fix push all indent 0.05 sphere 8.0 8.0 24.5 12.0
fix noise all viscous 1e-9
timestep 0.002
dump d all custom 25 run.dump id type x y z vx vy vz
dump_modify d sort id units yes time yes format float %.15g
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Three cubes square and high, argon at rest, run by LAMMPS for 0.2 ps."""
    folder = tmp_path_factory.mktemp("indent")
    frame = supercell("argon", (3, 3, 3))
    L, n = frame.cell.vectors[0, 0], len(frame)
    with open(folder / "slab.data", "w") as f:
        f.write(f"slab\n\n{n} atoms\n1 atom types\n0 {L:.15g} xlo xhi\n0 {L:.15g} ylo yhi\n-3 {L + 9:.15g} zlo zhi\n\n")
        f.write("Masses\n\n1 39.948\n\nAtoms # atomic\n\n")
        np.savetxt(f, np.column_stack([np.arange(1, n + 1), np.ones(n), frame.positions + 0.3]), "%d %d" + 3 * " %.15g")
    (folder / "in.indent").write_text(SCRIPT + "run 100\n")
    here = os.getcwd()
    os.chdir(folder)
    try:
        with lammps_session() as lmp:
            lmp.file("in.indent")
            push = [lmp.extract_fix("push", 0, 1, i) for i in range(3)]
            (folder / "push.txt").write_text(" ".join(f"{p:.15g}" for p in push))
    finally:
        os.chdir(here)
    return folder


def scene(run, **settings):
    return {
        "trajectory": {"file": str(run / "run.dump"), "reference": 0, "masses": [39.948]},
        "potential": {"input": str(run / "in.indent")},
        "kernel": {"name": "quartic", "radius": 9.0},
        "grid": {"kind": "regular", "shape": [3, 3, 4]},
        "twin": {"structure": "fcc", "lattice_constant": 5.3, **settings},
    }


def twin(*args, **settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        return atc.twin(scene(*args, **settings))


def test_the_indented_slab(run):
    """A node at every atom: the twin goes where LAMMPS's atoms go; held and driven atoms, and the indenter, from the
    script."""
    found = twin(run, material="smoothed", nodes="atoms")
    text = "\n".join(found.lines)
    for words in (
        "fix setforce of group low: held",
        "fix move of group side",
        "fix indent of group all",
        "fix viscous",
    ):
        assert words in text
    traj = atc.read(run / "run.dump")
    first, last = traj[0], traj[len(traj) - 1]
    moved = last.positions - first.positions
    L = np.diag(first.cell.vectors)[:2]
    moved[:, :2] -= L * np.rint(moved[:, :2] / L)
    u = found.simulation.state.u_nc
    low = first.positions[:, 2] < 3.3
    side = (first.positions[:, 0] < 4.0) & ~low & (first.positions[:, 2] < 6.5)
    assert np.abs(moved[low]).max() < 1e-12 and moved[side, 1] == pytest.approx(0.3 * 0.2, rel=1e-9)
    assert moved[:, 2].min() < -0.05
    # The twin takes a longer step of its own.
    assert u == pytest.approx(moved, abs=1e-2 * np.abs(moved).max())


def test_an_indenter_of_ones_own(run):
    """The same sphere by [twin] beside the script's: twice the force on the surface."""
    own = {"indenter_centre": [8.0, 8.0, 24.5], "indenter_radius": 12.0, "indenter_stiffness": 0.05}
    given = scene(run, material="smoothed", nodes="atoms", **own)
    given["trajectory"]["frames"] = ":1"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        sim = atc.twin(given).simulation
    first, second = (law.force for law in sim.rigid)
    assert first == pytest.approx(second, rel=1e-12) and first[2] < -0.01
    with pytest.raises(atc.AtcError, match="needs indenter_stiffness too"):
        twin(run, indenter_centre=[0, 0, 0], indenter_radius=1.0)
    assert crystal("argon").lattice_constant > 5.2


def test_the_force_on_the_indenter(run):
    """Over time, of the atoms as LAMMPS has it; of nodes a lattice constant apart, whose outermost lie below the atoms'
    surface, by the places of the atoms that they carry: within a third of the MD's."""
    found = twin(run, material="isotropic")
    ds = found.dataset
    md, pd = ds["md_indenter_force"].values, ds["pd_indenter_force"].values
    assert md[-1] == pytest.approx(np.loadtxt(run / "push.txt"), rel=1e-6, abs=1e-9)
    assert md.shape == pd.shape == (5, 3) and pd[0, 2] == pytest.approx(md[0, 2], rel=0.1)
    assert np.sqrt(((pd - md) ** 2).sum() / (md**2).sum()) < 1 / 3
    sim = found.simulation
    assert len(sim.body) < 40 and "indenters: force rms" in found.lines[-1]
    # What the nodes feel is what the indenter does.
    F = np.zeros_like(sim.positions_nc)
    sim.rigid[0].add(0.0, sim._z, F)
    assert F.sum(axis=0) == pytest.approx(-pd[-1], rel=1e-9, abs=1e-12)


def test_whom_the_script_does_not_tell(run, tmp_path):
    """Atoms that create_atoms makes, in groups by region: masses come from the script; who is held is asked for, and
    given by grips."""
    words = SCRIPT.replace("read_data slab.data", "lattice fcc 5.27\nregion box block 0 3 0 3 0 3\ncreate_box 1 box\n"
                           "create_atoms 1 box\nmass 1 39.948")  # fmt: skip
    lines = [line for line in words.splitlines() if "fix push" not in line]
    (tmp_path / "in.made").write_text("\n".join(lines) + "\nrun 100\n")
    given = scene(run, motion="static")
    given["trajectory"].pop("masses")
    given["potential"] = {"input": str(tmp_path / "in.made")}
    with pytest.raises(
        atc.AtcError, match=r"places are not known; name who is held by grips or grip_types in \[twin\]"
    ):
        atc.twin(given)
    given["twin"]["grips"] = [[[-9, -9, -9], [99, 99, 3.3]]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        found = atc.twin(given)
    text = "\n".join(found.lines)
    assert "held or moved by fix move of group side, fix setforce of group low: the nodes of grips" in text
    assert "nodes are held at the smoothed displacement" in text
