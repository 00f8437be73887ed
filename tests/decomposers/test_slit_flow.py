"""Water driven through a slit between walls of atoms: what the shear stress and the force on the water have to do with
each other, in one frame and on average."""

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.units import units

SCRIPT = """units real
boundary p p f
atom_style full
read_data slit.data
pair_style lj/cut/coul/long 8.0
pair_coeff * * 0.0 1.0
pair_coeff 1 1 0.1553 3.166
pair_coeff 1 3 0.6 2.9
bond_style harmonic
bond_coeff 1 450.0 1.0
angle_style harmonic
angle_coeff 1 55.0 109.47
kspace_style pppm 1e-4
kspace_modify slab 3.0
group walls type 3
group water type 1 2
neigh_modify delay 0 every 1
fix shake water shake 1e-6 100 0 b 1 a 1
fix push water gravity 2.4e-3 vector 1 0 0
fix hold walls setforce 0.0 0.0 0.0
compute across water temp/partial 0 1 1
fix nvt water nvt temp 300.0 300.0 100.0
fix_modify nvt temp across
velocity water create 300.0 4711 mom yes rot no dist gaussian
timestep 0.5
run 1500
timestep 2.0
run EQUIL
reset_timestep 0 time 0.0
dump d all custom EVERY slit.dump id mol type q x y z vx vy vz fx fy fz
dump_modify d sort id format float %.9g units yes time yes
run STEPS
"""


def slit(folder, n, equil, every, steps):
    """n³ molecules (SPC/E) between two walls of (n + 1)² atoms; the potential and the trajectory of the run."""
    rng, a = np.random.default_rng(4), 3.1
    half = np.deg2rad(109.47) / 2
    shape = np.array([[0, 0, 0], [np.sin(half), np.cos(half), 0], [-np.sin(half), np.cos(half), 0]])
    L = n * a
    place = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) * a
    turn = np.linalg.qr(rng.normal(size=(n**3, 3, 3)))[0]
    turn *= np.linalg.det(turn)[:, None, None]
    x = place[:, None] + shape @ turn
    grid = (np.stack(np.meshgrid(*[np.arange(n + 1)] * 2, indexing="ij"), -1).reshape(-1, 2) + 0.5) * L / (n + 1)
    walls = np.concatenate([np.c_[grid, np.full(len(grid), z)] for z in (-1.6, L + 1.6)])
    m = n**3
    lines = ["water between walls", "", f"{3 * m + len(walls)} atoms", f"{2 * m} bonds", f"{m} angles"]
    lines += ["3 atom types", "1 bond types", "1 angle types", "", f"0 {L} xlo xhi", f"0 {L} ylo yhi"]
    lines += [f"-2.0 {L + 2.0} zlo zhi", "", "Masses", "", "1 15.9994", "2 1.008", "3 40.0", "", "Atoms # full", ""]
    for k in range(m):
        for j, (t, q) in enumerate(((1, -0.8476), (2, 0.4238), (2, 0.4238))):
            lines.append(f"{3 * k + j + 1} {k + 1} {t} {q} " + " ".join(f"{v:.8f}" for v in x[k, j]))
    for j, p in enumerate(walls):
        lines.append(f"{3 * m + j + 1} {m + 1} 3 0.0 " + " ".join(f"{v:.8f}" for v in p))
    lines += ["", "Bonds", ""] + [f"{2 * k + j + 1} 1 {3 * k + 1} {3 * k + 2 + j}" for k in range(m) for j in (0, 1)]
    lines += ["", "Angles", ""] + [f"{k + 1} 1 {3 * k + 2} {3 * k + 1} {3 * k + 3}" for k in range(m)]
    (folder / "slit.data").write_text("\n".join(lines) + "\n")
    text = SCRIPT.replace("EQUIL", str(equil)).replace("EVERY", str(every)).replace("STEPS", str(steps))
    (folder / "in.slit").write_text(text)
    with lammps_session() as lmp:
        for line in text.replace("slit.d", str(folder / "slit.d")).splitlines():
            lmp.command(line)
    return atc.potential(folder / "in.slit"), atc.read(folder / "slit.dump", units="real")


def test_momentum_and_energy_are_balanced_in_a_slit(tmp_path):
    """Everything at once, at a point of one frame: bonds, the field of the charges and of the slab's correction, what
    holds the molecules, what drives them, what holds the walls."""
    from atc.analysis.check import check

    pot, traj = slit(tmp_path, 3, 0, 10, 10)
    frame = traj[-1]
    assert pot.acting.known and not pot.acting.others
    report = check(frame, pot, atc.kernel("gaussian", width=1.5), points=1)
    assert report.ok, report.verdict
    for law in ("momentum", "energy"):
        ways = report.data["laws"][law]
        assert ways["chain_rule"]["residual"] < 1e-11 and ways["fields"]["residual"] < 1e-7, (law, ways)


def flow(pot, traj, kernel):
    """z, and of every frame σ_zx, the body force along x, density and velocity; user's units."""
    names = ["stress", "body_force", "density", "velocity"]
    ds = atc.fields(traj, pot, kernel, atc.Grid.slab("z", 90), names, tolerance=1e-3)
    z = ds.z.values
    return z, ds.stress.values[:, :, 2, 0], ds.body_force.values[:, :, 0], ds.density.values, ds.velocity.values[..., 0]


def of_blocks(a_t, blocks=10):
    """Mean and its standard error from blocks of frames."""
    parts = np.array([b.mean(0) for b in np.array_split(a_t, blocks)])
    return parts.mean(0), parts.std(0, ddof=1) / np.sqrt(blocks)


@pytest.mark.slow
def test_shear_stress_of_a_steady_flow(tmp_path):
    """Poiseuille flow: dσ_zx/dz = −b_x at every height within the error bars of the run, and not without b."""
    pot, traj = slit(tmp_path, 6, 2500, 75, 30000)
    z, s, b, rho, v = flow(pot, traj[20:], atc.kernel("gaussian", radius=4.0))
    inside = (z > 1.0) & (z < 17.6)
    u = units("real")
    b = b * u.to_user("pressure", u.to_internal("force_density", 1.0))  # per Å
    step = z[1] - z[0]
    slope = (s[:, 2:] - s[:, :-2]) / (2 * step) + b[:, 1:-1]
    mean, error = of_blocks(slope[:, inside[1:-1]])
    size = np.abs(of_blocks(b)[0][inside]).mean()
    print("residual", np.sqrt((mean**2).mean()), "error", np.sqrt((error**2).mean()), "b", size)
    assert np.abs(mean / error).max() < 5.0 and np.sqrt(((mean / error) ** 2).mean()) < 2.0
    assert np.sqrt((error**2).mean()) < 0.5 * size
    # Of the whole width at once: the force is there, and the shear stress is what answers it.
    (whole,), (error,) = of_blocks(slope[:, inside[1:-1]].mean(1)[:, None])
    assert abs(whole) < 4.0 * error and size > 6.0 * error
    middle = len(z) // 2
    work = np.cumsum(b, axis=1) * step
    total, error = of_blocks((s - s[:, [middle]] + work - work[:, [middle]])[:, inside])
    assert np.abs(total[error > 0] / error[error > 0]).max() < 5.0
    assert np.ptp(of_blocks(s)[0][inside]) > 5 * error.max()
    profile = of_blocks(v)[0][inside]
    assert profile[len(profile) // 2] > 1.2 * max(profile[0], profile[-1])
