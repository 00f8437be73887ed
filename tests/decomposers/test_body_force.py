"""Forces from outside: the laws of LAMMPS's fixes against LAMMPS, and the momentum balance of a slit flow that they
close."""

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.analysis.check import check
from atc.errors import AtcError

BASE = """units lj
atom_style charge
boundary p p f
read_data w.data
pair_style lj/smooth/linear 2.0
pair_coeff * * 1.0 1.0
neighbor 0.4 bin
neigh_modify every 1 delay 0
timestep 0.002
"""


def data(folder, seed=1, charges=True):
    rng = np.random.default_rng(seed)
    n, L = (5, 5, 5), np.array([6.0, 6.0, 7.5])
    x = (np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), -1).reshape(-1, 3) + 0.5) / n * (
        L - [0, 0, 1.4]
    ) + [0, 0, 0.7]
    x += rng.uniform(-0.05, 0.05, x.shape)
    v = rng.normal(0, 1, x.shape)
    t = 1 + np.arange(len(x)) % 2
    q = np.where(t == 1, 0.5, -0.3) if charges else np.zeros(len(x))
    rows = [f"{k + 1} {t[k]} {q[k]:.17g} " + " ".join(f"{c:.17g}" for c in x[k]) for k in range(len(x))]
    rows_v = [f"{k + 1} " + " ".join(f"{c:.17g}" for c in v[k]) for k in range(len(x))]
    text = (
        f"slit\n\n{len(x)} atoms\n2 atom types\n0 {L[0]} xlo xhi\n0 {L[1]} ylo yhi\n0 {L[2]} zlo zhi\n\nMasses\n\n1 "
        "1.0\n2 2.5\n\nAtoms # charge\n\n"
    )
    (folder / "w.data").write_text(text + "\n".join(rows) + "\n\nVelocities\n\n" + "\n".join(rows_v) + "\n")


def lammps(folder, fixes, steps=0, every=1, extract=None):
    """Run the script in its folder; what `extract` takes of LAMMPS at the end."""
    dump = (
        f"dump d all custom {every} run.dump id type q x y z vx vy vz fx fy fz\ndump_modify d sort id format float "
        "%.17g units yes time yes\n"
    )
    text = BASE + "group half type 1\n" + fixes + "fix n all nve\n" + dump + f"run {steps}\n"
    (folder / "in.run").write_text(text)
    text = text.replace("w.data", str(folder / "w.data")).replace("run.dump", str(folder / "run.dump"))
    with lammps_session() as lmp:
        for line in text.splitlines():
            lmp.command(line)
        return None if extract is None else extract(lmp)


WALL = "fix w all wall/lj93 zlo EDGE 1.0 1.0 2.5 zhi EDGE 0.8 0.9 2.0\n"
LAWS = {
    "addforce": "fix a half addforce 0.3 -0.2 0.1\n",
    "setforce": "fix a half setforce 0.3 NULL 0.0\n",
    "aveforce": "fix a half aveforce 0.3 NULL 0.0\n",
    "gravity": "fix a all gravity 0.7 vector 1 2 0.5\n",
    "chute": "fix a half gravity 0.7 chute 24.0\n",
    "spherical": "fix a half gravity 0.7 spherical 30.0 60.0\n",
    "efield": "fix a all efield 0.4 0.0 -0.3\n",
    "lj93": WALL,
    "lj126": "fix w half wall/lj126 zlo 0.0 1.0 1.0 2.5 units box\n",
    "lj1043": "fix w all wall/lj1043 zlo EDGE 1.0 1.0 2.5\n",
    "wall harmonic": "fix w all wall/harmonic zhi 7.2 3.0 1.0 1.5 units box\n",
    "morse": "fix w all wall/morse zlo EDGE 1.0 2.0 0.9 2.0\n",
    "viscous": "fix a all viscous 0.4 scale 2 3.0\n",
    "sphere": "fix a all indent 10.0 sphere 0.5 3.0 3.0 2.5 units box\n",
    "cylinder in": "fix a half indent 10.0 cylinder z 3.0 3.0 1.5 side in units box\n",
    "plane": "fix a all indent 10.0 plane z 3.0 lo units box\n",
    "plane hi": "fix a all indent 10.0 plane x 3.0 hi units box\n",
    "planeforce": "fix a half planeforce 1 0 1\n",
    "lineforce": "fix a half lineforce 1 0 1\n",
    "several": "fix a all addforce 0.3 0 0\nfix s half setforce NULL 0.0 NULL\n" + WALL,
}


@pytest.mark.parametrize("case", LAWS)
def test_laws_are_those_of_lammps(tmp_path, case):
    """The forces of the dump are those between atoms and those of the laws."""
    data(tmp_path)
    lammps(tmp_path, LAWS[case])
    pot = atc.potential(tmp_path / "in.run")
    frame = pot.complete(atc.read(tmp_path / "run.dump", units="lj")[0])
    inner = pot.stream(frame, forces=True).forces_nc
    assert pot.acting.known and pot.acting.laws
    outside, said = pot.body_forces(frame, inner)
    assert said.startswith("declared: fix")
    assert np.abs(outside).max() > 1e-3
    np.testing.assert_allclose(inner + outside, frame.forces, atol=1e-11 * np.abs(frame.forces).max())
    ds = atc.fields(
        frame,
        pot,
        atc.kernel("quartic", radius=2.0),
        atc.Grid.regular(shape=(4, 4, 6)),
        ["body_force", "body_power"],
        forces="must agree",
    )
    assert ds.attrs["agrees_with_run"].startswith("forces of frame 0: yes") and ds.attrs["body_force_source"] == said


def test_what_walls_say_themselves(tmp_path):
    data(tmp_path)
    on_walls = lammps(
        tmp_path, WALL, steps=10, every=10, extract=lambda lmp: [lmp.extract_fix("w", 0, 1, k, 0) for k in (0, 1)]
    )
    pot = atc.potential(tmp_path / "in.run")
    frame = atc.read(tmp_path / "run.dump", units="lj")[-1]
    F = pot.body_forces(frame, pot.stream(frame, forces=True).forces_nc)[0]
    assert -F[:, 2].sum() == pytest.approx(sum(on_walls), abs=1e-10 * np.abs(F).sum())
    low = frame.positions[:, 2] < 3.75
    assert [-F[low, 2].sum(), -F[~low, 2].sum()] == pytest.approx(on_walls, rel=1e-10)


@pytest.mark.parametrize("thermostat", ["", "fix t all langevin 1.0 1.0 0.5 4711\n"])
def test_slit_flow_balances(tmp_path, thermostat):
    """Poiseuille: walls and a force along x. The stress alone does not balance, with the body force it does, at every
    point; measured with a thermostat."""
    data(tmp_path)
    lammps(tmp_path, WALL + "fix g all addforce 0.5 0 0\n" + thermostat, steps=60, every=2)
    pot = atc.potential(tmp_path / "in.run")
    traj = atc.read(tmp_path / "run.dump", units="lj")[10:19]
    kern = atc.kernel("quartic", radius=1.5)
    report = check(traj, pot, kern)
    laws = report.data["laws"]
    assert report.ok, report.verdict
    assert any(("measured" if thermostat else "declared") in note for note in report.notes)
    for name in ("momentum", "energy"):
        assert laws[name]["chain_rule"]["residual"] < 1e-11
        if not thermostat:  # noise does not stay the same from frame to frame
            assert laws[name]["frames"]["holds"] and laws[name]["frames"]["residual"] < 5e-3
    if not thermostat:
        pot.acting = None
        assert not check(traj, pot, kern).ok
    # the field is the sum
    frame = traj[4]
    pot = atc.potential(tmp_path / "in.run")
    points = frame.positions[:20] + 0.1
    ds = atc.fields(frame, pot, kern, atc.Grid.points(points), ["body_force", "body_power"])
    F = pot.body_forces(frame, pot.stream(frame, forces=True).forces_nc)[0]
    d = points[:, None] - frame.positions
    d -= np.rint(d / frame.cell.vectors.diagonal() * [1, 1, 0]) * frame.cell.vectors.diagonal()
    phi = kern.phi(d)
    np.testing.assert_allclose(ds.body_force.values[0], phi @ F, atol=1e-10 * np.abs(phi @ F).max())
    np.testing.assert_allclose(ds.body_power.values[0], phi @ (F * frame.velocities).sum(1), atol=1e-9)
    assert ds.attrs["body_force_source"].startswith("measured" if thermostat else "declared: fix wall/lj93")
    mean = atc.fields(traj, pot, kern, atc.Grid.slab("z", bins=8), ["body_force"], average=True)
    assert mean.body_force.values.shape[-2:] == (8, 3)


def test_what_is_not_known_needs_forces(tmp_path):
    data(tmp_path)
    lammps(tmp_path, "variable a equal 0.1*step\nfix a all addforce v_a 0 0\n")
    pot = atc.potential(tmp_path / "in.run")
    frame = atc.read(tmp_path / "run.dump", units="lj")[0]
    with pytest.raises(
        AtcError, match=r"body_force: .*fix addforce \(in.run, line 12\), whose forces are not known: dump fx fy fz too"
    ):
        pot.body_forces(frame.replace(forces=None), np.zeros((125, 3)))
    lines = atc.potential("pair_style lj/cut 2.0\npair_coeff * * 1 1", units="lj")
    with pytest.raises(AtcError, match="nothing says which there are: dump fx fy fz too"):
        lines.body_forces(frame.replace(forces=None), np.zeros((125, 3)))
    with pytest.raises(AtcError, match="tiles: body_force"):
        atc.fields(
            frame, pot, atc.kernel("quartic", radius=2.0), atc.Grid.slab("z", bins=4), ["body_force"], tiles=(2, 1, 1)
        )


def test_forces_that_are_set_tell_their_group(tmp_path):
    """Atoms that create_atoms made: a group by region is not known from the script, but from the forces of the run."""
    script = """units lj
boundary p p s
lattice fcc 0.85
region box block 0 3 0 3 0 4
create_box 1 box
create_atoms 1 box
mass 1 1.0
pair_style lj/smooth/linear 2.0
pair_coeff * * 1.0 1.0
region low block INF INF INF INF INF 0.9
group low region low
velocity all create 1.0 4711
fix n all nve
fix hold low {fix}
dump d all custom 4 run.dump id type x y z vx vy vz{forces}
dump_modify d sort id format float %.17g
run 8
"""
    grid, kern = atc.Grid.regular(shape=(3, 3, 4)), atc.kernel("quartic", radius=1.8)

    def fields(fix, forces=" fx fy fz", names=("stress", "body_force")):
        text = script.format(fix=fix, forces=forces)
        (tmp_path / "in.run").write_text(text)
        with lammps_session() as lmp:
            lmp.commands_string(text.replace("run.dump", str(tmp_path / "run.dump")))
        pot = atc.potential(tmp_path / "in.run")
        return atc.fields(atc.read(tmp_path / "run.dump", units="lj"), pot, kern, grid, list(names))

    ds = fields("setforce 0.0 NULL 0.5", forces="", names=["stress"])  # the group plays no part in it
    assert np.isfinite(ds.stress).all()
    with pytest.raises(AtcError, match="who is in group low is not known"):
        fields("setforce 0.0 NULL 0.5", forces="")
    ds = fields("setforce 0.0 NULL 0.5")
    assert ds.attrs["body_force_source"] == "declared: fix setforce"
    assert ds.attrs["agrees_with_run"].startswith("forces of frame 0: yes")
    ds = fields("addforce 0.3 0.0 0.0")  # nothing tells: it is measured
    assert ds.attrs["body_force_source"].startswith("measured") and "addforce" in ds.attrs["body_force_source"]
    assert float(ds.body_force[0, ..., 0].max()) > 0.1
