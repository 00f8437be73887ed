"""Fields while a run goes on: the same as from its trajectory, wherever frames come from."""

import numpy as np
import pytest
from frames import argon
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError

LJ = "pair_style lj/cut 8.5\npair_coeff * * 0.0104 3.4\npair_coeff 2 2 0.02 3.6"
NAMES = ["density", "velocity", "stress", "temperature", "virial_stress"]


@pytest.fixture(scope="module")
def frames():
    """Positions that drift, velocities of their own, steps and times."""
    out = []
    for k in range(12):
        f = argon(seed=1, jitter=0.3)
        rng = np.random.default_rng(k)
        out.append(f.replace(positions=f.positions + rng.normal(0, 0.1, f.positions.shape),
                             velocities=f.velocities + rng.normal(0, 0.02, f.positions.shape),
                             step=100 * k, time=1.0 * k, source=f"argon frame {k}"))  # fmt: skip
    return out


@pytest.fixture(scope="module")
def asked():
    return dict(pot=atc.potential(LJ, units="metal"), kern=atc.kernel("quartic", 6.0), grid=atc.Grid.slab("z", 5),
                quantities=NAMES, tolerance=1e-12)  # fmt: skip


def same(a, b, rtol=1e-11):
    assert set(a.data_vars) == set(b.data_vars) and dict(a.sizes) == dict(b.sizes)
    for name in a.data_vars:
        x, y = a[name].values, b[name].values
        if x.dtype.kind == "f":
            scale = float(np.nanmax(np.abs(y), initial=0.0)) or 1.0
            np.testing.assert_allclose(x, y, rtol=0, atol=rtol * scale, err_msg=name)
        else:
            np.testing.assert_array_equal(x, y, err_msg=name)
    for name in a.coords:
        np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=name)


@pytest.mark.parametrize("average", [True, False, 5])
def test_as_from_the_trajectory(frames, asked, average):
    """At the end and in between: what is not full yet is finished, and goes on."""
    live = atc.Live(**asked, average=average)
    for k, f in enumerate(frames):
        live.add(f)
        if k in (0, 1, 6, 11):
            same(live.result(), atc.fields(frames[: k + 1], **asked, average=average))
    assert live.n == 12 and live.seconds > 0


def test_frames_that_are_added_up(asked):
    """With the number of frames known they go together by the same groups as in `atc.fields`."""
    rng = np.random.default_rng(5)
    one = argon(seed=3, n=(1, 2, 2))
    many = [one.replace(positions=one.positions + rng.normal(0, 0.1, one.positions.shape)) for _ in range(70)]
    few = {**asked, "quantities": ["stress_potential", "density"], "grid": atc.Grid.regular(shape=16),
           "method": "spectral", "tolerance": 1e-4}  # fmt: skip
    live = atc.Live(**few, frames=70)
    for f in many:
        live.add(f)
    assert live._job.together == 4
    want = atc.fields(many, **few, average=True)
    same(live.result(), want)
    window = atc.Live(**few, average=35)
    for f in many:
        window.add(f)
    same(window.result(), atc.fields(many, **few, average=35))


@pytest.mark.parametrize("average", [True, 5])
def test_an_average_goes_on(frames, asked, average, tmp_path):
    kept = tmp_path / "average.npz"
    first = atc.Live(**asked, average=average, keep=kept)
    for f in frames[:7]:
        first.add(f)
    first.save()
    second = atc.Live(**asked, average=average, keep=kept)
    assert second.n == 7
    with pytest.raises(AtcError, match="add one frame of the run that goes on"):
        second.result()
    for f in frames[7:]:
        second.add(f)
    same(second.result(), atc.fields(frames, **asked, average=average))
    for change, words in (
        ({"grid": atc.Grid.slab("z", 6)}, "grid"),
        ({"quantities": ["density"]}, "quantities"),
        ({"kern": atc.kernel("quartic", 6.5)}, "kernel"),
        ({"tolerance": 1e-6}, "tolerance: 1e-12 then, 1e-06 now"),
    ):
        other = atc.Live(**{**asked, **change}, average=average, keep=kept)
        with pytest.raises(AtcError, match=f"was averaged with something else .*{words}"):
            other.add(frames[0])
    kept.write_bytes(kept.read_bytes()[:-100])
    with pytest.raises(AtcError, match="damaged"):
        atc.Live(**asked, average=average, keep=kept)


def test_where_there_were_atoms_is_kept_too(frames, tmp_path):
    """A mean goes on where atoms have left: what it is known of is not only where they are afterwards."""
    squeezed = [f.replace(positions=f.positions * [1.0, 1.0, 0.5]) for f in frames[:4]]
    up = [0.0, 0.0, 0.5 * frames[0].cell.heights[2]]
    halves = squeezed[:2] + [f.replace(positions=f.positions + up) for f in squeezed[2:]]
    some = dict(kern=atc.kernel("quartic", 3.0), grid=atc.Grid.slab("z", 12), quantities=["temperature", "velocity"])
    want = atc.fields(halves, **some, average=True)
    live = atc.Live(**some, average=True, keep=tmp_path / "average.npz")
    for half in halves[:2]:
        live.add(half)
    live.save()
    again = atc.Live(**some, average=True, keep=tmp_path / "average.npz")
    for half in halves[2:]:
        again.add(half)
    assert np.isfinite(want.temperature).all()
    same(again.result(), want)


def test_generators(frames, asked):
    same(atc.fields((f for f in frames), **asked, average=True), atc.fields(frames, **asked, average=True))
    same(atc.fields(iter(frames), **asked), atc.fields(frames, **asked))
    for more, words in (({"tiles": (2, 1, 1)}, "tiles: frames that come one by one"), ({"workers": 2}, "workers")):
        with pytest.raises(AtcError, match=words):
            atc.fields(iter(frames), **asked, **more)
    with pytest.raises(AtcError, match="no frame yet"):
        atc.fields(iter([]), **asked)


def test_generator_to_a_file(frames, asked, tmp_path):
    ds = atc.fields(iter(frames), **asked, average=True, out=tmp_path / "out.nc")
    same(atc.open_dataset(tmp_path / "out.nc"), ds)


def test_messages(frames, asked):
    live = atc.Live(**asked)
    with pytest.raises(AtcError, match="velocities are missing"):
        live.add(frames[0].replace(velocities=None))
    assert live.n == 0
    live.add(frames[0])
    with pytest.raises(AtcError, match=r"'real' units \(3-D\), the first frame in 'metal'"):
        live.add(argon(style="real"))
    for arguments, words in (
        ({"reference": 0}, "have no numbers yet"),
        ({"frames": 0}, "frames 0: expected"),
        ({"average": 0}, "average 0"),
        ({"keep": "no/such/place.npz"}, "no directory"),
    ):
        with pytest.raises(AtcError, match=words):
            atc.Live(**asked, **arguments)


def test_scene_says_the_same(frames, asked, tmp_path):
    (tmp_path / "s.toml").write_text(
        f'[trajectory]\nfile = "not-there.dump"\nunits = "metal"\n[potential]\nlammps = """\n{LJ}\n"""\n'
        '[kernel]\nname = "quartic"\nradius = 6.0\n[grid]\nkind = "slab"\naxis = "z"\nbins = 5\n[fields]\n'
        f"quantities = {NAMES!r}\ntolerance = 1e-12\n"
    )
    live = atc.Scene.load(tmp_path / "s.toml").live(average=True)
    for f in frames[:3]:
        live.add(f)
    found = live.result()
    same(found, atc.fields(frames[:3], **asked, average=True))
    assert "not-there.dump" in found.attrs["scene"]


# --- where frames come from

MELT = """
units metal
atom_style atomic
lattice fcc 5.4
region box prism 0 4 0 3 0 3 0.5 0 0
create_box 1 box
create_atoms 1 box
mass 1 39.948
velocity all create 120 87287
pair_style lj/cut 8.5
pair_coeff * * 0.0104 3.4
timestep 0.004
"""


def from_lammps(asked, more, tmp_path, drive, fix="fix 1 all nve"):
    """The result of `drive(live, lmp)` on 60 steps, and that of the dump of the same run."""
    live = atc.Live(**asked, **more)
    with lammps_session() as lmp:
        lmp.commands_string(MELT + fix)
        drive(live, lmp)
        found = live.result()
    dump = tmp_path / "x.dump"
    with lammps_session() as lmp:
        lmp.commands_string(
            MELT + fix + f"\ndump d all custom 20 {dump} id type x y z vx vy vz fx fy fz\n"
            "dump_modify d format float %.17g sort id time yes\nrun 60"
        )
    traj = atc.read(dump, units="metal", masses={1: 39.948})[1:]
    return found, atc.fields(traj, **asked, **more)


@pytest.fixture(scope="module")
def melt_asked(asked):
    return {**asked, "pot": atc.potential("pair_style lj/cut 8.5\npair_coeff * * 0.0104 3.4", units="metal"),
            "forces": "must agree"}  # fmt: skip


@pytest.mark.parametrize(
    "fix", ["fix 1 all nve", "fix 1 all nvt temp 120 60 0.1", "fix 1 all npt temp 90 90 0.1 iso 0 0 1"]
)
def test_lammps_run(melt_asked, tmp_path, fix):
    """As from its dump, to the digits of the dump; a ramp goes on over the pieces, and the box changes."""
    ds, want = from_lammps(melt_asked, {"average": False}, tmp_path, lambda live, lmp: live.run(lmp, 60, every=20), fix)
    np.testing.assert_array_equal(ds.step, [20, 40, 60])
    np.testing.assert_allclose(ds.time, want.time, rtol=1e-12)
    for name in NAMES:
        np.testing.assert_allclose(ds[name], want[name], rtol=1e-9, atol=1e-9 * float(np.abs(want[name]).max()))


def test_lammps_callback(melt_asked, tmp_path):
    """Through fix external, over two runs; without a thermostat velocities are those of the step."""

    def drive(live, lmp):
        live.attach(lmp, every=20)
        lmp.commands_string("run 40\nrun 25")

    ds, want = from_lammps(melt_asked, {"average": False}, tmp_path, drive)
    np.testing.assert_array_equal(ds.step, [20, 40, 60])
    for name in NAMES:
        np.testing.assert_allclose(ds[name], want[name], rtol=1e-9, atol=1e-9 * float(np.abs(want[name]).max()))


def test_what_goes_wrong_within_a_callback_is_raised(melt_asked):
    other = atc.potential("pair_style lj/cut 8.5\npair_coeff * * 0.0204 3.4", units="metal")
    live = atc.Live(**{**melt_asked, "pot": other})
    with lammps_session() as lmp:
        lmp.commands_string(MELT + "fix 1 all nve")
        live.attach(lmp, every=10)
        lmp.command("run 40")
        assert lmp.extract_global("ntimestep") < 40
    with pytest.raises(AtcError, match="must agree"):
        live.result()


def test_lammps_molecules(tmp_path):
    """Bonded terms, charges and types come along: energies are LAMMPS's own."""
    commands = """
units real
atom_style full
region b block 0 20 0 20 0 20
create_box 2 b bond/types 1 angle/types 1 extra/bond/per/atom 2 extra/angle/per/atom 2 extra/special/per/atom 4
create_atoms 2 single 1 1 1
create_atoms 1 single 2 1.2 1
create_atoms 2 single 19 1.5 1.3
mass 1 16.0
mass 2 1.0
set type 1 charge -0.8
set type 2 charge 0.4
bond_style harmonic
bond_coeff 1 450 0.96
angle_style harmonic
angle_coeff 1 55 104.5
create_bonds single/bond 1 2 1
create_bonds single/bond 1 2 3
create_bonds single/angle 1 1 2 3
pair_style lj/cut/coul/cut 8.0
pair_coeff * * 0.1 3.0
special_bonds lj/coul 0 0 0.5
velocity all create 100 4242
timestep 0.1
fix 1 all nve
"""
    lines = [
        c
        for c in commands.split("\n")
        if c.split() and c.split()[0].split("_")[0] in ("pair", "bond", "angle", "special")
    ]
    pot = atc.potential("\n".join(lines), units="real")
    live = atc.Live(pot, atc.kernel("quartic", 4.0), atc.Grid.regular(shape=2), ["energy"], forces="must agree")
    with lammps_session() as lmp:
        lmp.commands_string(commands)
        live.run(lmp, 30, every=10)
        frame = live._job.frames[len(live._arrived) - 1]
        pe = lmp.get_thermo("pe")
    assert len(frame.topology.bonds) == 2 and sorted(frame.charges.tolist())[0] < 0
    assert pot.decompose(frame).energy == pytest.approx(frame.units.to_internal("energy", pe), rel=1e-12)
    assert live.n == 3


def test_ase_observer(tmp_path):
    from ase.build import bulk
    from ase.calculators.lj import LennardJones
    from ase.io.trajectory import Trajectory
    from ase.md.velocitydistribution import MaxwellBoltzmannDistribution
    from ase.md.verlet import VelocityVerlet

    atoms = bulk("Ar", "fcc", 5.4, cubic=True) * (3, 3, 3)
    atoms.calc = LennardJones(sigma=3.4, epsilon=0.0104, rc=7.0, smooth=False)
    MaxwellBoltzmannDistribution(atoms, temperature_K=60, rng=np.random.default_rng(1))
    pot = atc.potential("pair_style lj/cut 7.0\npair_coeff * * 0.0104 3.4", units="metal")
    asked = dict(pot=pot, kern=atc.kernel("quartic", 6.0), grid=atc.Grid.slab("x", 4), quantities=["stress", "velocity"],
                 tolerance=1e-12, forces="must agree")  # fmt: skip
    live = atc.Live(**asked, average=False)
    dyn = VelocityVerlet(atoms, 4.0)
    dyn.attach(live.observer(atoms, dyn), interval=5)
    with Trajectory(tmp_path / "a.traj", "w", atoms) as file:
        dyn.attach(file.write, interval=5)
        dyn.run(15)
    found, want = live.result(), atc.fields(tmp_path / "a.traj", **asked)
    np.testing.assert_array_equal(found.step, [0, 5, 10, 15])
    np.testing.assert_allclose(found.time, [0, 20, 40, 60], rtol=1e-12)
    for name in ("stress", "velocity"):
        np.testing.assert_allclose(found[name], want[name], rtol=1e-9, atol=1e-11)
    assert found.stress.attrs["units"] == "eV/angstrom^3"
