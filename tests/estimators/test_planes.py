"""Planes: fluxes equal to LAMMPS's method of planes, and balanced by what happens between the planes."""

from itertools import pairwise

import energy_systems
import numpy as np
import pytest
from frames import argon
from lammps_oracle import Config, lammps_session, run_lammps
from systems import system
from test_constraints import Run

import atc
from atc.errors import AtcError
from atc.units import units

U = units("metal")
LJ = "pair_style lj/cut 6.5\npair_coeff * * 0.0104 3.4"
POT = atc.potential(LJ, units="metal")
DT = U.to_internal("time", 0.002)


def fields(frames, pot, grid, names=("stress", "momentum"), **more):
    return atc.fields(frames, pot, None, grid, list(names), threads=1, **more)


@pytest.fixture(scope="module")
def run():
    """Argon at 300 K in LAMMPS: frames of consecutive steps, and what its computes said of them, in its units."""
    steps, planes, single, frames = [], [], [], []
    with lammps_session() as lmp:
        lmp.commands_string(f"""
            units metal
            atom_modify map array sort 0 0
            boundary p p p
            lattice fcc 5.4 origin 0.13 0.17 0.21
            region b block -1 2 -2 2 0 3
            create_box 1 b
            create_atoms 1 box
            mass 1 39.948
            {LJ}
            displace_atoms all random 0.15 0.15 0.15 7
            velocity all create 300.0 3
            fix 1 all nve
            timestep 0.002
            neigh_modify every 1 delay 0 check yes
            compute p all stress/mop/profile y lower 0.61 kin conf total
            compute q all stress/mop z 7.3 kin conf total
            fix a all ave/time 1 1 1 c_p[*] mode vector
            thermo_style custom step temp c_q[1]
            run 20""")
        box = lmp.extract_box()
        for _ in range(8):
            lmp.command("run 1")
            n = lmp.get_natoms()
            order = np.argsort(lmp.numpy.extract_atom("id")[:n])
            steps.append([np.array(lmp.numpy.extract_atom(name))[:n][order] for name in ("x", "v", "f", "image")])
            planes.append(np.array(lmp.numpy.extract_compute("p", 0, 2)))
            single.append(np.array(lmp.numpy.extract_compute("q", 0, 1)))
    lo, hi = np.array(box[0]), np.array(box[1])
    for k, (x, v, f, _) in enumerate(steps):
        frames.append(
            atc.Frame(
                U.to_internal("length", x),
                atc.Cell(U.to_internal("length", np.diag(hi - lo)), U.to_internal("length", lo)),
                U,
                masses=np.full(len(x), U.to_internal("mass", 39.948)),
                velocities=U.to_internal("velocity", v),
                forces=U.to_internal("force", f),
                time=k * DT,
                source=f"step {k}",
            )
        )
    return frames, np.array(planes), np.array(single)


def test_the_same_as_lammps(run):
    """Of each frame, and of their mean: LAMMPS has pressures, the opposite of ours."""
    frames, planes, single = run
    grid = atc.Grid.planes("y", planes[0, :, 0], interval=0.002)
    ds = fields(frames, POT, grid)
    assert np.allclose(ds.y, planes[0, :, 0]) and planes[0, 0, 0] < -10.0
    assert (planes[:, :, 1:4] != 0).any(axis=(1, 2)).all()  # atoms pass in every step
    for name, at in (("stress_kinetic", 1), ("stress_potential", 4), ("stress", 7)):
        want = -planes[:, :, at : at + 3]
        assert np.abs(ds[name].sel(i="y") - want).max() < 1e-12 * np.abs(want).max()
        mean = fields(frames, POT, grid, average=True)[name].sel(i="y")[0]
        assert np.abs(mean - want.mean(0)).max() < 1e-12 * np.abs(want).max()
    one = fields(frames, POT, atc.Grid.planes("z", [7.3], interval=0.002))
    assert np.allclose(one.stress_potential.sel(i="z")[:, 0], -single[:, 3:6], rtol=1e-12)


def test_bonded_terms_as_lammps(tmp_path):
    """Angles too: whatever its decomposition, a term's force on what is above the plane is what it is."""
    rng = np.random.default_rng(0)
    x, bonds, angles = [], [], []
    for _ in range(8):
        k, p = len(x), rng.uniform(0, 12.0, 3)
        for _ in range(4):
            x.append(p)
            s = rng.normal(size=3)
            p = p + 1.4 * s / np.linalg.norm(s)
        bonds += [(k, k + 1), (k + 1, k + 2), (k + 2, k + 3)]
        angles += [(k, k + 1, k + 2), (k + 1, k + 2, k + 3)]
    config = Config(
        cell=np.diag([12.0] * 3), positions=np.array(x) % 12.0, units="real", masses={1: 12.0}, bonds=np.array(bonds),
        bond_types=np.ones(len(bonds), int), angles=np.array(angles), angle_types=np.ones(len(angles), int),
    )  # fmt: skip
    lines = (
        "pair_style lj/cut 5.0\npair_coeff 1 1 0.0001 2.0\nspecial_bonds lj 0 0 0\nbond_style harmonic\n"
        "bond_coeff 1 300 1.5\nangle_style harmonic\nangle_coeff 1 60 109\n"
    )
    z = 5.3
    keys = "step temp pe ke vol pxx pyy pzz pxy pxz pyz evdwl ecoul ebond eangle edihed eimp c__pv[*] c__rpe[*] c_p[1]"
    more = ["compute p all stress/mop z 5.3 conf", f"thermo_style custom {keys}", "run 0 post no"]
    take = lambda lmp: np.array(lmp.numpy.extract_compute("p", 0, 1))  # noqa: E731
    found = run_lammps(lines, config, after=more, extract=take).extra["extract"]
    ds = fields([config.frame()], atc.potential(lines, units="real"), atc.Grid.planes("z", [z]), ["stress_potential"])
    assert np.abs(ds.stress_potential.sel(i="z")[0, 0] + found).max() < 1e-10 * np.abs(found).max() > 0


def test_momentum_from_frame_to_frame(run):
    """What is between two planes gains the momentum that flows in: of a velocity-Verlet run to rounding, the forces of
    a step being the means of those at its ends and atoms carrying m Δx/Δt."""
    frames, *_ = run
    z = np.linspace(-10.3, 10.4, 31)
    ds = fields(frames, POT, atc.Grid.planes("y", z, interval="frames"))
    assert ds.sizes["frame"] == len(frames) - 1
    every = fields(frames, POT, atc.Grid.planes("y", z, interval=0.002))
    conf, kin = every.stress_potential.sel(i="y").values, ds.stress_kinetic.sel(i="y").values
    area = np.prod(np.diag(frames[0].cell.vectors)[[0, 2]])

    def inside(f, lo, hi):
        y = f.cell.wrap(f.positions)[0][:, 1]
        return (y >= lo) & (y < hi)

    crossed = 0
    for a, b, p0, p1, k1 in zip(frames, frames[1:], conf, conf[1:], kin):
        flux = U.to_internal("pressure", 0.5 * (p0 + p1) + k1)
        for m in range(len(z) - 1):
            in_a, in_b = (inside(f, z[m], z[m + 1]) for f in (a, b))
            crossed += (in_a != in_b).sum()
            momentum = [(f.masses[:, None] * f.velocities)[i].sum(0) for f, i in ((a, in_a), (b, in_b))]
            gain = (momentum[1] - momentum[0]) / DT
            assert np.abs(gain - (flux[m + 1] - flux[m]) * area).max() < 1e-9 * np.abs(flux).max() * area
    assert crossed > 20
    # A step along the velocities of velocity Verlet is the step from frame to frame.
    np.testing.assert_allclose(every.stress_kinetic[1:], ds.stress_kinetic, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(every.momentum[1:], ds.momentum, rtol=1e-6, atol=1e-9)


def test_longer_intervals_and_images(run):
    """Between stored frames: the mass that went through is what the sides of the planes have gained, also through the
    faces of the cell and with image flags."""
    frames, *_ = run
    a, b = frames[0], frames[-1]
    b = b.replace(time=a.time + 1.0)
    z = np.linspace(-10.7, 10.3, 41)
    area = np.prod(np.diag(a.cell.vectors)[[0, 2]])
    ds = fields([a, b], None, atc.Grid.planes("y", z, interval="frames"), ["momentum"])
    flux = U.to_internal("momentum", ds.momentum.sel(i="y").values[0]) * area
    gain = []
    for lo, hi in pairwise(z):
        mass = [f.masses[((y := f.cell.wrap(f.positions)[0][:, 1]) >= lo) & (y < hi)].sum() for f in (a, b)]
        gain.append(mass[1] - mass[0])
    assert np.allclose(flux[:-1] - flux[1:], gain, atol=1e-9) and np.abs(flux).max() > 1
    # The same path told by images.
    n = np.zeros((len(a), 3), int)
    n[:5, 1] = 3
    there = b.replace(positions=b.positions, images=n), a.replace(images=n)
    again = fields(there[::-1], None, atc.Grid.planes("y", z, interval="frames"), ["momentum"])
    assert np.array_equal(again.momentum, ds.momentum)
    n = n.copy()
    n[7, 1] = 1  # once around the cell
    far = fields([there[1], b.replace(images=n)], None, atc.Grid.planes("y", z, interval="frames"), ["momentum"])
    more = U.to_internal("momentum", (far.momentum - ds.momentum).sel(i="y").values) * area
    assert np.allclose(more, a.masses[7])


@pytest.mark.parametrize("name, axis", [("lj", "z"), ("sw", "x"), ("nep", "y")])
def test_forces_between_planes(name, axis):
    """In tilted cells, of pairs, triplets and forces that do not act along bonds: what is between two planes is pulled
    by the difference of their forces."""
    frame, pot = system(name)
    k = "xyz".index(axis)
    n = 7
    ds = fields([frame], pot, atc.Grid.planes(axis, n=n, interval=0.001), ["stress_potential"])
    cell = frame.cell
    normal = cell.inverse[:, k] * cell.heights[k]
    force = np.einsum("pij,i->pj", U.to_internal("pressure", ds.stress_potential.values[0]), normal)
    force *= cell.volume / cell.heights[k]
    F_nc = pot.decompose(frame).forces_nc
    s = cell.fractional(frame.positions)[:, k]
    layer = np.floor((s - np.floor(s)) * n - 0.5) % n
    assert len(set(layer)) > 2
    for m in range(n):
        want = F_nc[layer == m].sum(0)
        assert np.abs(force[(m + 1) % n] - force[m] - want).max() < 1e-10 * np.abs(F_nc).max()


def test_forces_of_constraints(tmp_path):
    """Rigid water, held by rattle: LAMMPS's own forces of the run, those of the constraints among them, are what the
    planes differ by."""
    r = Run(tmp_path / "water", "rattle")
    frame, n = r.frame, 9
    ds = atc.fields(r.traj[-1], r.pot, None, atc.Grid.planes("x", n=n), ["stress"], threads=1)
    assert "fs back" in ds.attrs["passages_counted"]  # the script's time step
    height = frame.cell.heights[0]
    force = frame.units.to_internal("pressure", ds.stress_potential.sel(i="x").values[0]) * frame.cell.volume / height
    layer = np.floor(frame.cell.fractional(frame.positions)[:, 0] % 1.0 * n - 0.5) % n
    for m in range(n):
        want = frame.forces[layer == m].sum(0)
        assert np.abs(force[(m + 1) % n] - force[m] - want).max() < 1e-10 * np.abs(frame.forces).max()


def test_mean_over_planes_is_the_virial():
    """Averages over where the planes are: all components of the virial stress and of m v⊗v, in a tilted cell."""
    frame, pot = system("sw")
    ds = fields([frame], pot, atc.Grid.planes("z", n=40_000, interval=0.05), ["stress", "momentum"])
    want = atc.fields([frame], pot, quantities=["virial_stress"], threads=1)
    kinetic = -np.einsum("n,ni,nj->ij", frame.masses, frame.velocities, frame.velocities) / frame.cell.volume
    # sums over points: each line is seen by count ± 1 planes
    scale = np.abs(want.virial_stress_potential).max()
    assert np.abs(ds.stress_potential[0].mean("z") - want.virial_stress_potential[0]).max() < 2e-3 * scale
    found = U.to_internal("pressure", ds.stress_kinetic[0].mean("z").values)
    assert np.abs(found - kinetic).max() < 2e-2 * np.abs(kinetic).max()
    momentum = U.to_internal("momentum", ds.momentum[0].mean("z").values)
    want = frame.masses @ frame.velocities / frame.cell.volume
    assert np.abs(momentum - want).max() < 2e-2 * np.abs(frame.masses[:, None] * frame.velocities).sum(0).max() / (
        frame.cell.volume
    )


@pytest.mark.parametrize("name", ["sw", "nep", "eam"])
def test_energy_between_planes(name):
    """d/dt of the energy of the atoms between two planes, by finite differences, is what flows in through them."""
    frame, pot = system(name) if name != "eam" else energy_systems.system("eam")
    n = 5
    ds = fields([frame], pot, atc.Grid.planes("y", n=n, interval=1e-9), ["energy_flux"])
    cell = frame.cell
    normal = cell.inverse[:, 1] * cell.heights[1]
    flux = U.to_internal("energy_flux", ds.energy_flux.values[0]) @ normal * cell.volume / cell.heights[1]
    h = 1e-4
    F_nc = pot.decompose(frame).forces_nc
    U_n = [
        pot.decompose(frame.replace(positions=frame.positions + t * h * frame.velocities)).energies_n for t in (-1, 1)
    ]
    rate = np.einsum("nc,nc->n", F_nc, frame.velocities) + (U_n[1] - U_n[0]) / (2 * h)
    s = cell.fractional(frame.positions)[:, 1]
    layer = np.floor((s - np.floor(s)) * n - 0.5) % n
    for m in range(n):
        assert abs(flux[m] - flux[(m + 1) % n] - rate[layer == m].sum()) < 1e-6 * np.abs(rate).max()
    assert np.abs(flux).max() > 1e-2 * np.abs(rate).max()


def test_two_dimensions():
    """Lines across the plane of the atoms: stress times their length is the force."""
    u = units("metal").planar
    rng = np.random.default_rng(1)
    s = np.stack(np.meshgrid(np.arange(4), np.arange(4), indexing="ij"), -1).reshape(-1, 2)
    x = np.zeros((16, 3))
    x[:, :2] = 3.8 * (s + 0.5) + rng.uniform(-0.3, 0.3, s.shape)
    v = 0.01 * rng.normal(size=x.shape) * [1, 1, 0]
    frame = atc.Frame(
        x, atc.Cell([15.2, 15.2, 1.0], [0, 0, -0.5], (True, True, False)), u, masses=np.full(16, 39.948), velocities=v
    )
    pot = atc.potential("dimension 2\npair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4", units="metal")
    n = 5
    ds = fields([frame], pot, atc.Grid.planes("x", n=n, interval=0.01), ["stress", "virial_stress"])
    F_nc = pot.decompose(frame).forces_nc
    force = u.to_internal("pressure", ds.stress_potential.sel(i="x").values[0]) * 15.2
    layer = np.floor(frame.cell.wrap(x)[0][:, 0] / 15.2 * n - 0.5) % n
    for m in range(n):
        assert np.allclose(force[(m + 1) % n] - force[m], F_nc[layer == m].sum(0), atol=1e-10 * np.abs(F_nc).max())
    many = fields([frame], pot, atc.Grid.planes("x", n=20_000, interval=0.01), ["stress_potential"])
    want = ds.virial_stress_potential[0]
    assert np.abs(many.stress_potential[0].mean("x") - want).max() < 2e-3 * np.abs(want).max()
    with pytest.raises(AtcError, match="two-dimensional run are lines"):
        fields([frame], pot, atc.Grid.planes("z", n=3, interval=0.01))


def test_patches():
    """Their forces add up to those of the plane; each has the bonds that cross it."""
    frame = argon("tilted", n=(3, 3, 3))
    pot = atc.potential("pair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4", units="metal")
    whole = fields([frame], pot, atc.Grid.planes("z", n=4, interval=0.1), ["stress", "energy_flux"])
    parts = fields([frame], pot, atc.Grid.planes("z", n=4, interval=0.1, patches=[2, 3]), ["stress", "energy_flux"])
    assert parts.stress.dims == ("frame", "z", "x", "y", "i", "j")
    for name in ("stress", "stress_kinetic", "energy_flux"):
        assert np.allclose(parts[name].mean(["x", "y"]), whole[name], rtol=0, atol=1e-12 * np.abs(whole[name]).max())
    b, cell = pot.decompose(frame).bonds, frame.cell
    want = np.zeros((2, 3, 3))
    start, run = cell.fractional(frame.positions[b.i]), b.r_bc @ cell.inverse
    for image in range(-3, 4):
        t = (start[:, 2] + image - 0.375) / run[:, 2]
        for q in np.flatnonzero((t > 0) & (t < 1)):
            at = (start[q] - t[q] * run[q]) % 1.0
            force = b.G_b[q] * b.r_bc[q] * np.sign(run[q, 2])
            want[int(at[0] * 2), int(at[1] * 3)] += force
    want /= cell.volume / cell.heights[2] / 6
    found = np.einsum("xyij,i->xyj", parts.stress_potential.values[0, 1], cell.inverse[:, 2] * cell.heights[2])
    assert np.allclose(U.to_internal("pressure", found), want, rtol=0, atol=1e-12 * np.abs(want).max())


def test_crystals_with_atoms_on_the_planes():
    """Atoms on a plane, but for rounding, are above it: bonds within their layer do not cross."""
    a = 5.4
    s = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    corner = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corner + s) / 3).reshape(-1, 3) * 3 * a
    rng = np.random.default_rng(0)
    frame = atc.Frame(x + rng.uniform(-1e-13, 1e-13, x.shape), atc.Cell([3 * a] * 3), U, masses=np.full(len(x), 39.9))
    ds = fields([frame], POT, atc.Grid.planes("z", n=6, at="corners"), ["stress_potential"])
    between = fields([frame], POT, atc.Grid.planes("z", n=6), ["stress_potential", "virial_stress_potential"])
    assert np.allclose(ds.stress_potential.sel(i="z", j="z"), between.stress_potential.sel(i="z", j="z"), rtol=1e-9)
    assert np.allclose(between.stress_potential.sel(i="z", j="z"), between.virial_stress_potential[0, 2, 2], rtol=1e-9)


def test_some_atoms_add_up():
    frame = argon("tilted", n=(3, 3, 3))
    pot = atc.potential("pair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4", units="metal")
    grid = atc.Grid.planes("x", n=6, interval=0.1)
    names = ["stress", "energy_flux", "momentum"]
    whole, apart = fields([frame], pot, grid, names), fields([frame], pot, grid, names, by="type")
    for name in names:
        assert np.allclose(apart[name].sum("species"), whole[name], rtol=0, atol=1e-12 * np.abs(whole[name]).max())
    one = fields([frame], pot, grid, names, select=atc.select(types=1))
    assert np.allclose(one.stress_kinetic, apart.stress_kinetic.sel(species="1"))


def test_a_scene(run, tmp_path, monkeypatch):
    """From a dump and a script, over processes, into a file; with the section's force and a picture."""
    from typer.testing import CliRunner

    from atc.cli import app

    frames, *_ = run
    monkeypatch.chdir(tmp_path)
    with open("run.dump", "w") as dump:
        for k, f in enumerate(frames[:4]):
            lo, hi = f.cell.origin, f.cell.origin + np.diag(f.cell.vectors)
            print(f"ITEM: UNITS\nmetal\nITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n{len(f)}", file=dump)
            print("ITEM: BOX BOUNDS pp pp pp", file=dump)
            for a, b in zip(lo, hi):
                print(f"{a:.17g} {b:.17g}", file=dump)
            print("ITEM: ATOMS id type x y z vx vy vz", file=dump)
            v = U.to_user("velocity", f.velocities)
            for m, (x, y) in enumerate(zip(f.positions, v)):
                print(m + 1, 1, *(f"{c:.17g}" for c in (*x, *y)), file=dump)
    text = f'''
[trajectory]
file = "run.dump"
masses = [39.948]
timestep = 0.002
[potential]
lammps = """
{LJ}
"""
[grid]
kind = "planes"
axis = "y"
n = 6
[fields]
quantities = ["stress", "energy_flux"]
'''
    (tmp_path / "scene.toml").write_text(text)
    cli = CliRunner()
    shown = cli.invoke(app, ["plan", "scene.toml"])
    assert shown.exit_code == 0, shown.output
    assert "planes" in shown.output
    done = cli.invoke(app, ["fields", "scene.toml", "-o", "out.nc", "--quiet"])
    assert done.exit_code == 0, done.output
    import xarray as xr

    with xr.open_dataset("out.nc") as ds:
        ds.load()
    want = fields([f.replace(forces=None) for f in frames[:4]], POT, atc.Grid.planes("y", n=6, interval=0.002))
    assert np.allclose(ds.stress, want.stress, rtol=1e-9, atol=1e-6)
    force = ds.atc.section_force()
    area = np.prod(np.diag(frames[0].cell.vectors)[[0, 2]])
    inner = U.to_internal("pressure", want.stress.sel(i="y").values) * area
    assert np.allclose(U.to_internal("force", force.values), inner, atol=1e-9 * np.abs(inner).max())
    # Without a time step, neither is done.
    (tmp_path / "less.toml").write_text(text.replace("timestep = 0.002\n", ""))
    for verb in (["plan", "less.toml"], ["fields", "less.toml", "-o", "less.nc"]):
        done = cli.invoke(app, verb)
        assert done.exit_code != 0 and "give interval in [grid]" in done.output
    # From frame to frame, by processes or not.
    (tmp_path / "frames.toml").write_text(text.replace("n = 6", 'n = 6\ninterval = "frames"'))
    for more in (["-o", "1.nc"], ["-o", "2.nc", "-j", "2"]):
        assert cli.invoke(app, ["fields", "frames.toml", "--quiet", *more]).exit_code == 0
    with xr.open_dataset("1.nc") as one, xr.open_dataset("2.nc") as two:
        assert one.sizes["frame"] == 3 and np.array_equal(one.step, [1, 2, 3])
        assert np.allclose(one.stress, two.stress, rtol=1e-12)
        assert np.allclose(one.stress_potential, want.stress_potential[1:], rtol=1e-9, atol=1e-6)
    drawn = cli.invoke(app, ["plot", "out.nc", "-q", "stress", "-o", "out.png"])
    assert drawn.exit_code == 0, drawn.output


def test_refusals():
    frame = argon(n=(3, 3, 3))
    planes = atc.Grid.planes
    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    for grid, names, more, words in (
        (planes("z", n=3, interval=0.1), ["density"], {}, "density: is not known on planes"),
        (planes("z", n=3, interval=0.1), ["stress"], {"velocity": "local"}, "velocity 'local'"),
        (planes("z", n=3, interval=0.1), ["stress"], {"tiles": (1, 1, 2)}, "tiles"),
        (planes("z", n=3), ["stress"], {}, "give interval"),
        (planes("z", n=3, interval="frames"), ["stress"], {}, "one frame only"),
    ):
        with pytest.raises(AtcError, match=words):
            fields([frame], pot, grid, names, **more)
    for how, words in (
        ({}, "either their positions or n"),
        ({"n": 3, "positions": [1.0]}, "either their positions or n"),
        ({"positions": [2.0, 1.0]}, "ascending"),
        ({"n": 3, "interval": -1.0}, "greater than 0"),
        ({"n": 3, "interval": "steps"}, '"frames"'),
        ({"n": 3, "patches": [2, 2, 2]}, "2 whole numbers"),
    ):
        with pytest.raises(AtcError, match=words):
            planes("z", **how)
    with pytest.raises(AtcError, match="at rest"):
        planes("z", n=3).following("mass")
    frames = [frame.replace(time=0.0), frame.replace(time=1.0, cell=atc.Cell([9.1, 10.0, 11.0], frame.cell.origin))]
    with pytest.raises(AtcError, match="the cell is not that of the frame before"):
        fields(frames, pot, planes("z", n=3, interval="frames"))
    with pytest.raises(AtcError, match="no time has passed"):
        fields([frames[0], frames[0]], pot, planes("z", n=3, interval="frames"))
    salt = "pair_style lj/cut/coul/long 4.0\npair_coeff * * 0.0104 3.4\nkspace_style ewald 1e-4"
    charged = frame.replace(charges=np.resize([1.0, -1.0], len(frame)) - (len(frame) % 2) / len(frame))
    with pytest.raises(AtcError, match="long-range forces"):
        fields([charged], atc.potential(salt, units="metal"), planes("z", n=3, interval=0.1))
    assert fields([charged], atc.potential(salt, units="metal"), planes("z", n=3, interval=0.1), ["stress_kinetic"])
