"""Atoms of the groups of a LAMMPS script: those that LAMMPS itself has in them."""

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.config.scene import Scene
from atc.errors import AtcError

SCRIPT = """units lj
atom_style molecular
boundary p p p
read_data w.data
pair_style lj/cut 2.0
pair_coeff * * 1.0 1.0
region low block INF INF INF INF INF 2.1
region ball sphere 3 3 3 2.0 side out
region both intersect 2 low ball
group light type 1
group some id 3 5:40:7 90
group mol molecule 2:3
group low region low
group out region ball
group both region both
group rest subtract all light low
group more union some mol
group cut intersect low light more
group hot variable fast
variable fast atom vx>0
group moving dynamic all var fast every 1
fix n all nve
dump d all custom 5 run.dump id type x y z vx vy vz
dump_modify d sort id
run 5
"""
EXACT = ("light", "some", "mol", "low", "out", "both", "rest", "more", "cut")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("groups")
    rng = np.random.default_rng(0)
    x = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), -1).reshape(-1, 3) * 1.2 + 0.6
    x = x + rng.uniform(-0.1, 0.1, x.shape)
    rows = [f"{k + 1} {k % 4} {1 + k % 2} {a:.9f} {b:.9f} {c:.9f}" for k, (a, b, c) in enumerate(x)]
    (folder / "w.data").write_text(
        f"w\n\n{len(x)} atoms\n2 atom types\n0 6 xlo xhi\n0 6 ylo yhi\n0 6 zlo zhi\n\nMasses\n\n1 1.0\n2 2.0\n\n"
        "Atoms # molecular\n\n" + "\n".join(rows) + "\n"
    )
    text = SCRIPT.replace(
        "group hot variable fast\nvariable fast atom vx>0", "variable fast atom vx>0\ngroup hot variable fast"
    )
    (folder / "in.run").write_text(text)
    with lammps_session() as lmp:
        lmp.commands_string(
            text.replace("w.data", str(folder / "w.data")).replace("run.dump", str(folder / "run.dump"))
        )
        n = lmp.extract_global("nlocal")  # ghosts stand behind
        mask = lmp.numpy.extract_atom("mask").ravel()[:n][np.argsort(lmp.numpy.extract_atom("id").ravel()[:n])]
        inside = {name: mask >> k & 1 == 1 for k, name in enumerate(lmp.available_ids("group"))}
    return folder, inside


@pytest.mark.parametrize("name", EXACT)
def test_groups_are_those_of_lammps(ran, name):
    folder, inside = ran
    traj, pot = atc.read(folder / "run.dump", units="lj"), atc.potential(folder / "in.run")
    for frame in traj:
        chosen = atc.select(groups=name).settled(traj[0], traj, pot).of(frame)
        np.testing.assert_array_equal(chosen, inside[name])
    assert inside[name].any() and not inside[name].all()


def test_fields_of_a_group(ran):
    """Those of the same atoms by their ids; with other ways to pick, and inverted."""
    folder, inside = ran
    traj, pot = atc.read(folder / "run.dump", units="lj"), atc.potential(folder / "in.run")
    kern, grid = atc.kernel("quartic", 1.8), atc.Grid.regular(shape=3)

    def fields(chosen, **more):
        return atc.fields(traj, pot, kern, grid, ["stress", "number_density"], select=chosen, **more)

    ids = (np.flatnonzero(inside["low"]) + 1).tolist()
    for a, b in (
        ("group:low", atc.select(ids=ids)),
        (atc.select(groups=["low", "light"]), atc.select(ids=ids, types=1)),
        (atc.select(groups="low", invert=True), atc.select(ids=ids, invert=True)),
        (
            atc.select(groups="low", region="block 0 3 INF INF INF INF"),
            atc.select(ids=ids, region="block 0 3 INF INF INF INF"),
        ),
    ):
        one, other = fields(a, bonds="any"), fields(b, bonds="any")
        np.testing.assert_array_equal(one.stress, other.stress)
        np.testing.assert_array_equal(one.number_density, other.number_density)
    assert "groups low" in fields("group:low").attrs["selected_atoms"]
    scene = Scene.loads(fields("group:low").attrs["scene"])
    assert scene.data["select"] == {"groups": ["low"]}


def test_what_nobody_can_tell_is_refused_with_its_line(ran):
    folder, _ = ran
    traj, pot = atc.read(folder / "run.dump", units="lj"), atc.potential(folder / "in.run")
    for name, why in (
        ("hot", r"in\.run, line 2\d: group"),
        ("moving", "change as the run goes"),
        ("none", "no group 'none': it has all, light"),
    ):
        with pytest.raises(AtcError, match=why):
            atc.fields(
                traj,
                pot,
                atc.kernel("quartic", 1.8),
                atc.Grid.regular(shape=3),
                ["number_density"],
                select=f"group:{name}",
            )
    with pytest.raises(AtcError, match="only a LAMMPS script says"):
        atc.fields(
            traj, None, atc.kernel("quartic", 1.8), atc.Grid.regular(shape=3), ["number_density"], select="group:low"
        )
    made = (folder / "in.run").read_text()
    made = made.replace(
        "read_data w.data", "region b block 0 6 0 6 0 6\ncreate_box 2 b\nlattice sc 1.0\ncreate_atoms 1 box"
    )
    (folder / "in.made").write_text(made)
    with pytest.raises(AtcError, match="create_atoms makes atoms whose places are not known; select them by types"):
        atc.fields(traj, atc.potential(folder / "in.made"), atc.kernel("quartic", 1.8), atc.Grid.regular(shape=3),
                   ["number_density"], select="group:low")  # fmt: skip
