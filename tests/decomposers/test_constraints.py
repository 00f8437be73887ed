"""Constraint forces: fix shake, rattle and rigid against LAMMPS's own virial, the solvers against dense twins, the
choice of the source, refusals."""

import numpy as np
import pytest
from lammps_oracle import Config, lammps_session
from lammps_runs import water

import atc
from atc.config.scene import Scene
from atc.decomposers import AllBonds, Constraints, HeldPairs, HydrogenBonds, RigidMolecules, Shake
from atc.decomposers.constraints.rigid_bodies import bodies_of
from atc.decomposers.constraints.rules import hydrogen
from atc.decomposers.constraints.solvers import System, molecules_of
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

MODEL = """pair_style lj/cut/coul/cut 4.9
bond_style harmonic
angle_style harmonic
read_data w.data
pair_coeff 1 1 0.155 3.166
pair_coeff 1 2 0.0 1.0
pair_coeff 2 2 0.0 1.0
bond_coeff 1 450.0 0.9572
angle_coeff 1 55.0 104.52
"""
FIX = {
    "shake": "fix n all nve\nfix h all shake 1e-10 200 0 b 1 a 1\n",
    "rattle": "fix n all nve\nfix h all rattle 1e-10 200 0 b 1 a 1\n",
    "rigid": "fix h all rigid/small molecule\n",
}
COLUMNS = "id mol type q x y z vx vy vz fx fy fz"


class Run:
    """Twenty-seven rigid waters after 20 fs, in LAMMPS's units: W (3, 3) the virial, press, and what atc has of the
    run."""

    def __init__(self, folder, style, dt=1.0, steps=None, every=None, pair="lj/cut/coul/cut 4.9", before=""):
        folder.mkdir(exist_ok=True, parents=True)
        self.folder, steps = folder, steps or round(20 / dt)
        water(n=3).write_data(folder / "w.data")
        model = MODEL.replace("lj/cut/coul/cut 4.9", pair)
        head = f"units real\natom_style full\n{model.replace('w.data', str(folder / 'w.data'))}"
        with lammps_session() as lmp:
            # Molecules in their shape, and not on top of each other.
            for line in [*head.splitlines(), "minimize 0 1e-4 60 100", f"write_data {folder / 'w.data'} nocoeff"]:
                lmp.command(line)
        every = every or steps
        dump = (
            f"dump d all custom {every} run.dump {COLUMNS}\ndump_modify d sort id format float %.17g units yes time "
            "yes\n"
        )
        (folder / "in.run").write_text(
            f"units real\natom_style full\n{model}timestep {dt}\n{before}{FIX[style]}{dump}run {steps}\n"
        )
        script = (
            (folder / "in.run")
            .read_text()
            .replace("w.data", str(folder / "w.data"))
            .replace("run.dump", str(folder / "run.dump"))
        )
        with lammps_session() as lmp:
            before = [
                "compute pv all pressure NULL virial",
                "thermo_style custom step temp ke vol press pxx c_pv[*]",
                f"thermo {every}",
                "thermo_modify norm no",
            ]
            lines = script.splitlines()
            for line in [*lines[:-3], *before, *lines[-3:]]:
                lmp.command(line)
            p = np.array(lmp.numpy.extract_compute("pv", 0, 1))
            xx, yy, zz, xy, xz, yz = -p * lmp.get_thermo("vol") / lmp.extract_global("nktv2p")
            self.W = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            self.press, self.temp = lmp.get_thermo("press"), lmp.get_thermo("temp")
        self.pot = atc.potential(folder / "in.run")
        self.traj = atc.read(folder / "run.dump", units="real")
        self.frame = self.pot.complete(self.traj[-1])

    @property
    def drift(self):
        """Pressure of the motion of the whole, in which LAMMPS and the box's virial differ."""
        m, v = self.frame.masses, self.frame.velocities
        return self.frame.units.to_user(
            "pressure", m.sum() * ((m @ v / m.sum()) ** 2).sum() / (3 * self.frame.cell.volume)
        )

    def off(self, **changes):
        """(largest difference of virials over the constraints' largest, what was found)."""
        d = self.pot.constrained(self.pot.constraints.but(**changes)).stream(self.frame, forces=True)
        u = self.frame.units
        size = np.abs(u.to_user("energy", d.held.bonds.virial())).max()
        return float(np.abs(u.to_user("energy", d.virial_cc) - self.W).max() / size), d


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder, made = tmp_path_factory.mktemp("held"), {}

    def of(style, dt=1.0, **more):
        key = f"{style}{dt}{sorted(more.items())}".replace(" ", "")
        if key not in made:
            made[key] = Run(folder / str(len(made)), style, dt, **more)
        return made[key]

    return of


@pytest.mark.parametrize("style", ["shake", "rattle"])
def test_virial_from_forces_is_that_of_lammps(runs, style):
    r = runs(style)
    off, d = r.off()
    assert d.held.source == "forces" and d.held.count == 81 and d.held.molecules == 27
    assert off < 1e-12 and d.held.error < 1e-12
    np.testing.assert_allclose(d.forces_nc, r.frame.forces, atol=1e-12 * np.abs(r.frame.forces).max())


@pytest.mark.parametrize("style", ["shake", "rattle"])
def test_pressure_and_temperature_are_those_of_lammps(runs, style):
    r = runs(style)
    grid, kern = atc.Grid.regular(shape=(2, 2, 2)), atc.kernel("quartic", radius=4.0)
    ds = atc.fields(r.traj[-1], r.pot, kern, grid, ["virial_stress", "stress", "temperature"], forces="must agree")
    p = -np.trace(ds.virial_stress.values[0]) / 3
    # LAMMPS takes velocities as they are, the box that relative to its drift.
    u, m, v = r.frame.units, r.frame.masses, r.frame.velocities
    assert p + r.drift == pytest.approx(r.press, rel=1e-10)
    assert (
        ds.attrs["constraint_source"] == "forces"
        and "81 in 27 molecules (fix" in ds.attrs["constraints"]
        and ds.attrs["constraint_error"] < 1e-12
    )
    f = r.pot.constraints.degrees(r.frame)
    assert f.sum() == pytest.approx(3 * 81 - 81, rel=1e-12)
    assert float(m @ (v * v).sum(1)) / ((f.sum() - 3) * u.boltzmann) == pytest.approx(r.temp, rel=1e-6)
    wide = atc.kernel("quartic", radius=40.0)
    for velocity, taken in (("frame", 3), ("local", 0)):
        ds = atc.fields(r.traj[-1], r.pot, wide, grid, ["temperature"], velocity=velocity)
        thermal = float(m @ ((v - m @ v / m.sum()) ** 2).sum(1)) / ((f.sum() - taken) * u.boltzmann)
        assert ds.temperature.values.mean() == pytest.approx(thermal, rel=0.02)


def test_a_step_says_the_forces_of_shake_and_velocities_to_second_order(runs):
    """No forces in the frame. What the error says of itself is what it is."""
    errors = []
    for dt in (2.0, 1.0, 0.5):
        r = runs("shake", dt)
        off, d = r.off(source="step")
        assert off < 1e-9 and d.held.source == "step" and d.held.error < 1e-9
        off, d = r.off(source="velocities", timestep=None)
        assert 0.4 * off < d.held.error < 3 * off
        errors.append(off)
    assert errors[0] < 8e-3 and 3.3 < errors[0] / errors[1] < 4.7 and 3.3 < errors[1] / errors[2] < 4.7


def test_few_digits_are_said_in_the_error(runs):
    """Six digits, as LAMMPS writes them by default."""
    r = runs("shake")

    def rounded(a, unit):
        return np.array([float(f"{v / unit:.5e}") for v in a.ravel()]).reshape(a.shape) * unit

    u, f = r.frame.units, r.frame
    cut = f.replace(
        positions=rounded(f.positions, u.length),
        velocities=rounded(f.velocities, u.velocity),
        forces=rounded(f.forces, u.factor("force")),
    )
    exact = r.pot.stream(f).held.forces_nc
    for source in ("forces", "step"):
        found = r.pot.constrained(r.pot.constraints.but(source=source)).stream(cut).held
        off = np.sqrt(((found.forces_nc - exact) ** 2).mean() / (exact**2).mean())
        assert 0.1 * off < found.error < 10 * off and found.error < 1e-3


def test_rattle_needs_forces(runs):
    """Its virial differs at first order in the step from what velocities say: they are taken by name only."""
    r = runs("rattle")
    bare = r.frame.replace(forces=None)
    with pytest.raises(AtcError, match="fix rattle, .*in.run, line 14.*dump fx fy fz"):
        r.pot.stream(bare)
    off, d = r.off(source="velocities")
    assert d.held.source == "velocities" and off < 0.02


def test_rigid_bodies_move_as_newton_and_euler_say(runs):
    """The forces in the dump are those on the atoms of the bodies; LAMMPS's own virial differs at first order in the
    time step."""
    r = runs("rigid")
    off, d = r.off()
    assert d.held.source == "velocities" and d.held.error < 1e-12 and d.held.count == 81 and d.held.levers is None
    assert off < 0.05 and runs("rigid", 0.25).off()[0] < 0.35 * runs("rigid", 2.0).off()[0]
    free = r.pot.as_in_file(r.frame)
    np.testing.assert_allclose(
        free.stream(r.frame, forces=True).forces_nc, r.frame.forces, atol=1e-10 * np.abs(r.frame.forces).max()
    )
    # the same molecules, held by distances: other equations, the same forces
    pairs = np.concatenate([np.arange(81).reshape(-1, 3)[:, k] for k in ([0, 1], [0, 2], [1, 2])]) + 1
    other = free.constrained(Constraints([HeldPairs(tuple(map(tuple, pairs)))], source="velocities"))
    a, b = r.frame.replace(forces=None), r.frame
    free = free.stream(a, forces=True).forces_nc
    theirs = other.stream(a).held.forces_nc
    assert np.abs(free).max() > 0
    # the pairs release bonds and angles, whose forces bodies hold against: compare what all forces add up to
    all_pairs, all_bodies = (p.stream(f, forces=True).forces_nc for p, f in ((other, a), (r.pot, b)))
    np.testing.assert_allclose(all_pairs, all_bodies, atol=1e-9 * np.abs(all_bodies).max())
    assert theirs.shape == all_pairs.shape


# ---- what is held


MASSES = {1: 12.011, 2: 1.008, 3: 1.09, 4: 1.2}


def methyl(seed=1):
    """Molecules of a heavy atom with three or two light ones, and chains of heavy ones; bond and angle types by
    kind."""
    rng = np.random.default_rng(seed)
    x, t, mol, bonds, bond_types, angles, angle_types = [], [], [], [], [], [], []
    shape = np.array([[0, 0, 0], [1.09, 0, 0], [-0.36, 1.03, 0], [-0.36, -0.51, 0.89], [-1.5, 0, 0]])
    for k in range(8):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        n = 4 if k % 2 else 3
        first = len(x)
        x += list(np.array([5.0 * (k % 2), 5.0 * (k // 2 % 2), 5.0 * (k // 4)]) + 2.5 + shape[:n] @ q)
        t += [1] + [2 + k % 3] * (n - 1)
        mol += [k + 1] * n
        bonds += [(first, first + b) for b in range(1, n)]
        bond_types += [1 + k % 2] * (n - 1)
        angles += [(first + a, first, first + b) for a in range(1, n) for b in range(a + 1, n)]
        angle_types += [1] * len([1 for a in range(1, n) for b in range(a + 1, n)])
    v = rng.normal(0, 5e-3, (len(x), 3))
    return Config(
        np.full(3, 10.0),
        x,
        t,
        "real",
        MASSES,
        None,
        v,
        bonds=bonds,
        bond_types=bond_types,
        angles=angles,
        angle_types=angle_types,
        molecules=mol,
        ntypes=4,
        atom_style="molecular",
    )


@pytest.mark.parametrize(
    "words", ["b 1", "b 2 a 1", "b 1 2 a 1", "t 3", "t 2 4 a 1", "m 1.0", "m 1.0 1.2 a 1", "m 12.0", "b 1 t 3 m 1.3"]
)
def test_what_shake_holds(tmp_path, words):
    """The number of constraints is what LAMMPS takes off the degrees of freedom."""
    c = methyl()
    data = tmp_path / "c.data"
    c.write_data(data)
    lines = f"""units real
atom_style molecular
pair_style lj/cut 4.0
bond_style harmonic
angle_style harmonic
read_data {data}
pair_coeff * * 0.1 3.0
bond_coeff 1 340 1.09
bond_coeff 2 340 1.09
angle_coeff 1 35 109.5
group some id 1:25
fix n all nve
fix h some shake 1e-6 100 0 {words}
"""
    (tmp_path / "in.run").write_text(lines + "run 0\n")
    with lammps_session() as lmp:
        for line in [*lines.splitlines(), "thermo_style custom temp ke", "thermo_modify norm no", "run 0 post no"]:
            lmp.command(line)
        dof = 2 * lmp.get_thermo("ke") / lmp.get_thermo("temp") / lmp.extract_global("boltz")
    pot = atc.potential(tmp_path / "in.run")
    frame = pot.complete(c.frame().replace(given={}))
    held = pot.constraints.pairs(frame)
    assert len(held) == round(3 * len(frame) - 3 - dof)
    assert pot.constraints.taken(frame) == len(held)


def test_own_terms_are_off_and_weights_stay(runs):
    r = runs("shake")
    top = r.pot.constraints.released(r.frame).topology
    assert not top.bond_types.any() and not top.angle_types.any() and top.weighted is r.frame.topology
    angle = r.pot.constrained(Constraints([Shake((1,), (), where="x")])).constraints.released(r.frame).topology
    assert not angle.bond_types.any() and angle.angle_types.all()


# ---- solvers


def frame_of(x, m, v=None, L=60.0):
    u = units("real")
    return Frame(np.asarray(x, float), Cell(np.full(3, L)), u, masses=np.asarray(m, float), velocities=v)


def dense(x, m, pairs):
    """B (c, 3n) and M⁻¹ of one molecule."""
    B = np.zeros((len(pairs), 3 * len(x)))
    for b, (i, j) in enumerate(pairs):
        e = (x[i] - x[j]) / np.linalg.norm(x[i] - x[j])
        B[b, 3 * i : 3 * i + 3], B[b, 3 * j : 3 * j + 3] = e, -e
    return B, np.repeat(1 / np.asarray(m), 3)


@pytest.mark.parametrize(
    "pairs",
    [
        [(0, 1)],
        [(0, 1), (0, 2), (1, 2)],
        [(0, 1), (1, 2), (2, 3), (3, 4)],
        [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (3, 4)],
    ],
)
def test_solvers_against_dense_matrices(pairs):
    rng = np.random.default_rng(3)
    n = 5
    x, m, v, F = rng.normal(size=(n, 3)) * 2, rng.uniform(1, 16, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    r = np.array([x[i] - x[j] for i, j in pairs])
    (mol,) = molecules_of(pairs, n)
    s = System(mol, r, m)
    B, w = dense(x, m, pairs)
    B = B[mol.which_mc[0]]
    A = (B * w) @ B.T
    v2 = ((np.array([v[i] - v[j] for i, j in pairs]) ** 2).sum(1) / np.linalg.norm(r, axis=1))[mol.which_mc[0]]
    expected = np.linalg.solve(A, B @ (w * F.ravel()) + v2)
    a = mol.difference(mol.of(F / m[:, None]))
    vel = mol.difference(mol.of(v))
    np.testing.assert_allclose(s.by_motion(a, (vel**2).sum(2))[0], expected, rtol=1e-10)
    # the distances keep their second derivatives
    acc = (F.ravel() - B.T @ expected) * w
    np.testing.assert_allclose(B @ acc, -v2, atol=1e-10 * np.abs(v2).max())
    # forces that are those of constraints are found again, and a common acceleration does not enter
    D = -(B.T @ expected).reshape(n, 3) + m[:, None] * [1.0, 2.0, 3.0]
    np.testing.assert_allclose(s.by_forces(mol.difference(mol.of(D / m[:, None])))[0], expected, rtol=1e-9)
    # velocities of a temperature: drawn, and put on the constraints
    V = rng.normal(size=(200_000, 3 * n)) * np.sqrt(1.3 * w)
    V -= ((V @ B.T) @ np.linalg.inv(A)) @ (B * w)
    V = V.reshape(-1, n, 3)
    drawn = np.array([((V[:, i] - V[:, j]) ** 2).sum(1).mean() for i, j in np.array(pairs)[mol.which_mc[0]]])
    np.testing.assert_allclose(s.mean_squares(1.3)[0], drawn, rtol=0.02)
    f = frame_of(x, m)
    degrees = Constraints([HeldPairs(tuple((i + 1, j + 1) for i, j in pairs))]).degrees(f)
    assert degrees.sum() == pytest.approx(3 * n - len(pairs))
    np.testing.assert_allclose(degrees, m * (V**2).sum(2).mean(0) / 1.3, rtol=0.03)


SHAPES = {
    "pair": [[0, 0, 0], [1.1, 0, 0]],
    "water": [[0, 0, 0], [0.76, 0.59, 0], [-0.76, 0.59, 0]],
    "line": [[0, 0, 0], [1.16, 0, 0], [-1.16, 0, 0]],
    "square": [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]],
    "ring": [[np.cos(a), np.sin(a), 0] for a in np.arange(6) * np.pi / 3],
    "tetrahedron": [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
    "cluster": np.random.default_rng(5).normal(size=(9, 3)),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_and_the_bonds_that_carry_their_loads(shape):
    """Forces add up to m a − F of a rigid motion; levers where a plane or a line is loaded across; the stress over the
    body is symmetric."""
    rng = np.random.default_rng(4)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    x0 = np.asarray(SHAPES[shape], float) @ Q
    n = len(x0)
    x = np.concatenate([x0, x0 + [9.0, 3.0, 1.0]])
    m = np.tile(rng.uniform(1, 16, n), 2)
    turn = np.repeat(rng.normal(size=(2, 3)), n, axis=0)
    v = np.cross(turn, x) + 0.3
    F = rng.normal(size=x.shape)
    frame = frame_of(x, m, v).replace(molecules=np.repeat([7, 3], n))
    c = Constraints([RigidMolecules(where="test")]).settled(frame)
    found = c.found(frame, F)
    total = F + found.forces_nc
    # what holds them adds up to nothing, in force and torque
    for k in range(2):
        one = slice(k * n, (k + 1) * n)
        H = found.forces_nc[one]
        assert np.abs(H.sum(0)).max() < 1e-10 and np.abs(np.cross(x[one], H).sum(0)).max() < 1e-9
    # distances keep their second derivatives
    for i in range(n):
        for j in range(i):
            r, w, a = x[i] - x[j], v[i] - v[j], total[i] / m[i] - total[j] / m[j]
            assert r @ a + w @ w == pytest.approx(0, abs=1e-9)
    assert (found.levers is not None) == c.across == (shape in ("line", "square", "ring"))
    W = found.bonds.virial() + (found.levers.virial() if found.levers is not None else 0)
    np.testing.assert_allclose(W, -np.einsum("ni,nj->ij", x, found.forces_nc), atol=1e-9)
    np.testing.assert_allclose(W, W.T, atol=1e-9)
    free = {"pair": 5, "line": 5}.get(shape, 6)
    assert c.degrees(frame).sum() == pytest.approx(2 * free) and found.count == 6 * n - 2 * free and found.error < 1e-12
    mean = bodies_of(np.repeat([0, 1], n), frame, "")[0].holding(F, kT=1.3)
    I = bodies_of(np.repeat([0, 1], n), frame, "")[0]
    draws = []
    for _ in range(4000):
        p = rng.normal(size=(2, n, 3)) * np.sqrt(1.3 / m.reshape(2, n))[:, :, None]
        _, omega, _ = I.motion(p.reshape(-1, 3))
        draws.append(I.holding(F, omega))
    np.testing.assert_allclose(mean, np.mean(draws, axis=0), atol=0.15 * np.abs(mean).max())


def test_bodies_in_two_dimensions():
    """Triangles in the plane, as bodies and as held pairs."""
    rng = np.random.default_rng(6)
    x = np.concatenate([rng.normal(size=(3, 3)) + [0, 5 * k, 0] for k in range(4)]) * [1, 1, 0]
    m = rng.uniform(1, 9, 12)
    v, F = rng.normal(size=(2, 12, 3)) * [[[1, 1, 0]]]
    frame = frame_of(x, m, v).replace(molecules=np.repeat(np.arange(4), 3), units=units("real").planar)
    bodies = Constraints([RigidMolecules(where="test")]).settled(frame)
    for b in bodies.bodies(frame):  # a rigid motion of the same momenta
        V, omega, _ = b.motion(v)
        v[b.atoms_ma] = V[:, None] + np.cross(omega[:, None], b.x_mac)
    frame = frame.replace(velocities=v)
    pairs = Constraints(
        [HeldPairs(tuple((3 * k + i, 3 * k + j) for k in range(4) for i, j in ((1, 2), (1, 3), (2, 3))))]
    )
    a, b = bodies.found(frame, F), pairs.found(frame, F)
    np.testing.assert_allclose(a.forces_nc, b.forces_nc, atol=1e-9 * np.abs(b.forces_nc).max())
    np.testing.assert_allclose(bodies.degrees(frame), pairs.degrees(frame), rtol=1e-9)
    assert a.count == b.count == 12 and bodies.taken(frame) == 12
    mean = [c.but(source="temperature", temperature=1.0).found(frame, F).forces_nc for c in (bodies, pairs)]
    np.testing.assert_allclose(*mean, atol=1e-9 * np.abs(mean[0]).max())


OUTSIDE = {
    "none": "",
    "gravity": "fix g all gravity 0.01 vector 0 1 1\n",
    "field": "fix e all efield 0.1 0.0 -0.2\n",
    "push": "fix a all addforce 0.4 0.0 0.0\n",
}


@pytest.mark.parametrize("case", OUTSIDE)
def test_constraints_answer_forces_from_outside(runs, case):
    """What acts from outside is known before constraint forces are found: their virial stays LAMMPS's, the body force
    is the declared one."""
    r = runs("shake", before=OUTSIDE[case])
    off, d = r.off()
    assert off < 1e-8 and d.held.error < 1e-8  # LAMMPS's constant of a volt
    assert r.off(source="step")[0] < 1e-8
    F, said = r.pot.body_forces(r.frame, d.forces_nc)
    assert said.startswith("declared")
    np.testing.assert_allclose(d.forces_nc + F, r.frame.forces, atol=1e-8 * np.abs(r.frame.forces).max())


def test_a_flat_body_has_a_stress_and_says_that_it_is_not_symmetric():
    u = units("real")
    x = np.asarray(SHAPES["line"]) + [6.0, 6.0, 6.0]
    x = np.concatenate([x, x[:, [1, 0, 2]] + [0, 0, 3.1]])
    rng = np.random.default_rng(2)
    frame = Frame(
        x,
        Cell(np.full(3, 12.0)),
        u,
        masses=np.full(6, 10.0),
        velocities=np.zeros((6, 3)),
        molecules=np.repeat([1, 2], 3),
        types=np.tile([1, 2, 2], 2),
    )
    pot = atc.potential(
        "pair_style lj/cut 5.0\npair_coeff * * 0.2 3.0\nneigh_modify exclude molecule/intra all", units="real"
    )
    pot = pot.constrained(Constraints([RigidMolecules(where="test")]))
    frame = frame.replace(velocities=np.repeat(rng.normal(0, 1e-3, (2, 3)), 3, axis=0))
    grid, kern = atc.Grid.regular(shape=(24, 24, 24)), atc.kernel("quartic", radius=3.0)
    ds = atc.fields(frame, pot, kern, grid, ["stress_potential", "virial_stress_potential"], tolerance=1e-8)
    mean = ds.stress_potential.values[0].reshape(-1, 3, 3)
    np.testing.assert_allclose(mean.mean(0), ds.virial_stress_potential.values[0], atol=2e-4 * np.abs(mean).max())
    assert np.abs(mean - mean.swapaxes(1, 2)).max() > 1e-3 * np.abs(mean).max()
    with pytest.raises(AtcError, match="do not act along bonds"):
        atc.fields(frame, pot, kern, grid, ["heat_flux"])


# ---- scenes


SCENE = """[trajectory]
file = "run.dump"
topology = "w.data"
units = "real"
[potential]
lammps = '''
pair_style lj/cut/coul/cut 4.9
pair_coeff 1 1 0.155 3.166
pair_coeff 1 2 0.0 1.0
pair_coeff 2 2 0.0 1.0
bond_style none
angle_style none
'''
[fields]
quantities = ["virial_stress"]
"""


@pytest.mark.parametrize(
    "section",
    ['bonds = "hbonds"', 'bonds = "allbonds"', 'pairs = "pairs.txt"', 'molecules = true\nsource = "velocities"'],
)
def test_a_scene_says_what_is_held(runs, section):
    r = runs("shake")
    pairs = np.concatenate([np.arange(81).reshape(-1, 3)[:, k] for k in ([0, 1], [0, 2], [1, 2])]) + 1
    np.savetxt(r.folder / "pairs.txt", pairs, fmt="%d")
    (r.folder / "scene.toml").write_text(SCENE + f"[constraints]\n{section}\n")
    scene = Scene.load(r.folder / "scene.toml")
    scene.data["trajectory"]["frames"] = -1
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ds = scene.run()
    p = -np.trace(ds.virial_stress.values[0]) / 3
    # less of a rigid motion than of the velocities of SHAKE: 0.1 % of the constraints' 40,000 atm
    assert p + r.drift == pytest.approx(r.press, rel=2e-3 if "molecules" in section else 1e-10)
    assert ds.attrs["constraint_source"] == ("velocities" if "molecules" in section else "forces")
    assert "[constraints]" in ds.attrs["scene"]


def test_constraints_of_a_gromacs_run(monkeypatch):
    """MDAnalysis makes plain bonds of a .tpr's constraints and settles: what is held is told from them again, here of
    every bond of a protein and of rigid water, against the file's own lists."""
    import MDAnalysis
    from MDAnalysis.topology.tpr import obj
    from MDAnalysisTests.datafiles import TPR2024

    listed, process = {}, obj.InteractionKind.process

    def record(self, atoms):
        rows = list(process(self, atoms))
        listed.setdefault(self.name, []).append(rows)
        return iter(rows)

    monkeypatch.setattr(obj.InteractionKind, "process", record)
    universe = MDAnalysis.Universe(TPR2024)
    universe.load_new(np.random.default_rng(0).uniform(0, 50, (1, len(universe.atoms), 3)))
    frame = atc.read(universe)[0]
    code = lambda rows: {tuple(sorted(map(int, row))) for row in rows}  # noqa: E731
    water = universe.select_atoms("resname SOL").indices.reshape(-1, 3)
    (settle,) = listed["SETTLE"][0]  # of one molecule, as its constraints are
    sides = [(settle[a], settle[b]) for a, b in ((0, 1), (0, 2), (1, 2))]
    assert len(water) > 100
    want = code(listed["CONSTR"][0]) | code(molecule[list(side)] for molecule in water for side in sides)
    assert code(AllBonds().pairs(frame)) == want
    hydrogen = {int(i) for i in np.flatnonzero(universe.atoms.masses < 1.1)}
    assert code(HydrogenBonds().pairs(frame)) == {p for p in want if hydrogen & set(p)}


@pytest.mark.parametrize("known", [True, False], ids=["masses", "names"])
def test_hydrogen_by_the_names_of_force_fields(known):
    """HO, HS and HE1 are hydrogen in AMBER and CHARMM, and holmium, hassium and helium without their masses."""
    names = {1: "OH", 2: "HO", 3: "HE1", 4: "He", 5: "Hg", 6: "HC", 7: "DRUD"}
    masses = np.array([16.0, 1.008, 1.008, 4.0026, 200.6, 3.024, 0.4]) * units("real").mass
    frame = Frame(np.zeros((7, 3)), Cell(np.eye(3) * 10), units("real"), types=np.arange(1, 8), type_names=names)
    found = hydrogen(frame.replace(masses=masses if known else None), "here")
    np.testing.assert_array_equal(found, [False, known, known, False, False, True, False])


def test_leapfrog_velocities(runs):
    """Velocities half a step behind, as GROMACS writes them, and forces without those of constraints."""
    r = runs("shake")
    f = r.frame
    half = f.velocities - 0.5 * r.pot.constraints.timestep * f.forces / f.masses[:, None]
    exact = r.pot.stream(f).held.forces_nc
    for contained in (None, False):
        forces = None if contained is None else f.forces - exact
        c = r.pot.constraints.but(behind=0.5, contained=contained)
        found = r.pot.constrained(c).stream(f.replace(velocities=half, forces=forces)).held
        assert found.source == "step"
        np.testing.assert_allclose(found.forces_nc, exact, atol=1e-9 * np.abs(exact).max())
    auto = Constraints([HydrogenBonds(where="x")], timestep=r.pot.constraints.timestep, behind=0.5)
    found = r.pot.constrained(auto).stream(f.replace(velocities=half, forces=f.forces - exact)).held
    assert found.source == "step" and found.count == 81


def test_what_is_missing_is_named(runs):
    r = runs("shake")
    bare = r.frame.replace(forces=None, velocities=None)
    with pytest.raises(
        AtcError, match=r"fix shake, .*in.run, line 14\) are part of the stress.*dump fx fy fz \(best\), or vx vy vz"
    ):
        r.pot.stream(bare)
    c = r.pot.constraints.but(temperature=r.frame.units.to_internal("temperature", 300.0))
    assert r.pot.constrained(c).stream(bare).held.source == "temperature"
    with pytest.raises(AtcError, match="from step .* need velocities"):
        r.pot.constrained(r.pot.constraints.but(source="step")).stream(bare)
    with pytest.raises(AtcError, match="tiles: the forces of constraints: fix shake depend on all forces"):
        atc.fields(
            r.traj[-1],
            r.pot,
            atc.kernel("quartic", radius=4.0),
            atc.Grid.slab("z", bins=4),
            ["stress"],
            tiles=(2, 1, 1),
        )


def test_balance_laws_hold(runs):
    """In closed form, by the fields, and from differences between frames of the run."""
    from atc.analysis.check import check

    r = runs("shake", 0.5, steps=20, every=2, pair="lj/cut/coul/dsf 0.3 4.9")
    report = check(r.traj[1:], r.pot, atc.kernel("quartic", radius=4.0))
    assert report.ok, report.verdict
    assert report.data["laws"]["momentum"]["chain_rule"]["residual"] < 1e-12
    assert report.data["laws"]["momentum"]["frames"]["residual"] < 1e-2


@pytest.fixture(scope="module")
def ewald(runs):
    """Rigid water with its electrostatics summed over all images, as most people run it."""
    return runs("shake", pair="lj/cut/coul/long 4.9\nkspace_style ewald 1e-9\npair_modify table 0")


def test_shaken_water_with_ewald_sums(ewald):
    """What holds the molecules answers the forces of all images, too."""
    off, d = ewald.off()
    # LAMMPS's erfc is a polynomial, good to 1.5e-7; its sum over modes stops at 1e-9.
    assert d.held.source == "forces" and d.held.count == 81 and off < 1e-6
    np.testing.assert_allclose(d.forces_nc, ewald.frame.forces, atol=1e-6 * np.abs(ewald.frame.forces).max())
    grid, kern = atc.Grid.regular(shape=(2, 2, 2)), atc.kernel("quartic", radius=4.0)
    ds = atc.fields(ewald.traj[-1], ewald.pot, kern, grid, ["virial_stress", "stress"], tolerance=1e-4)
    p = -np.trace(ds.virial_stress.values[0]) / 3
    # The pressure is the mean of three components, each of them as near as above, and a small part of what holds the
    # molecules alone would give.
    u = ewald.frame.units
    size = u.to_user("pressure", np.abs(d.held.bonds.virial()).max() / ewald.frame.cell.volume)
    assert abs(p + ewald.drift - ewald.press) < 1e-6 * size and size > 3000
    # The mean over a periodic cell is the box's (of the part of forces: what moves with the field's own velocity is
    # not in the kinetic part).
    kern, grid = atc.kernel("gaussian", radius=6.0), atc.Grid.regular(shape=(12, 12, 12))
    fine = atc.fields(ewald.traj[-1], ewald.pot, kern, grid, ["stress"], tolerance=1e-5)
    box = u.to_user("pressure", d.virial_cc / ewald.frame.cell.volume)
    np.testing.assert_allclose(fine.stress_potential.values[0].mean((0, 1, 2)), box, atol=1e-5 * size)


def test_balance_laws_hold_with_ewald_sums(ewald):
    """Bonds, the smooth field and what holds the molecules together."""
    from atc.analysis.check import check

    report = check(ewald.traj[-1], ewald.pot, atc.kernel("gaussian", width=2.0), points=2)
    assert report.ok, report.verdict
    for law in ("momentum", "energy"):
        ways = report.data["laws"][law]
        assert ways["chain_rule"]["residual"] < 1e-10, (law, ways)
        assert ways["fields"]["residual"] < 1e-8, (law, ways)
