"""Potentials of edges (NEP, SNAP): the heat current against the motion of energy, and Green and Kubo on a run of their
own."""

import json

import energy_systems
import numpy as np
import pytest
from nep_oracle import write

import atc
from atc.frame import Cell, Frame
from atc.units import units

METAL = units("metal")
_FCC = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
DIAMOND = np.concatenate([_FCC, _FCC + 0.25])


@pytest.mark.parametrize("name", ["nep", "snap"])
def test_heat_current_is_the_motion_of_energy(name):
    """In a drop all by itself J = d/dt Σ x_j e_j; the rates of the atoms' energies by differences of sixth order."""
    frame, pot = energy_systems.system(name)
    rng = np.random.default_rng(0)
    m = np.where(frame.types == 1, 28.0, 12.0)
    v = 0.05 * rng.normal(size=frame.positions.shape)
    v -= m @ v / m.sum()
    x = frame.positions - frame.positions.mean(0) + 50.0
    drop = Frame(x, Cell(100 * np.eye(3)), METAL, types=frame.types, velocities=v, masses=m)
    d, h = pot.decompose(drop), 2e-3

    def at(step):
        return pot.decompose(drop.replace(positions=x + step * h * v)).energies_n

    rate = sum(w * (at(k) - at(-k)) for k, w in ((1, 0.75), (2, -0.15), (3, 1 / 60))) / h
    e = 0.5 * m * (v**2).sum(1) + d.energies_n
    power = (v * d.forces_nc).sum(1) + rate
    # Energy is conserved: the origin does not matter.
    assert abs(power.sum()) < 1e-9 * np.abs(power).sum()
    want = v.T @ e + (x - 50.0).T @ power
    got = atc.heat_currents([drop], pot, dt=1.0).J_tc[0]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-8 * np.abs((x - 50.0) * power[:, None]).max())


@pytest.mark.filterwarnings("ignore:.*mean heat current.*is not 0")  # of so short a run
def test_conductivity_of_a_run(tmp_path):
    """Velocity Verlet with a small model's forces, written as GPUMD does, and `atc conductivity` of that file; the
    current is also Σ W_k v_k, with W_k the edges that end at k, as calorine's virials are (Fan et al. 2015)."""
    from typer.testing import CliRunner

    from atc.cli import app

    write(tmp_path / "nep.txt", names=("Si",), cutoffs=(4.5, 4.0), amplitude=0.1)
    pot = atc.nep(tmp_path / "nep.txt")
    a, dt, rng = 5.43, 1.0 / METAL.to_user("time", 1.0) * 1e-3, np.random.default_rng(1)
    x = ((np.stack(np.meshgrid(*[[0, 1]] * 3), -1).reshape(-1, 1, 3) + DIAMOND) * a).reshape(-1, 3)
    m = np.full(len(x), 28.085)
    v = rng.normal(size=x.shape) * np.sqrt(METAL.boltzmann * 600 / m[:, None])
    v -= v.mean(0)
    frame = Frame(x, Cell(2 * a * np.eye(3)), METAL, types=np.ones(len(x), int), velocities=v, masses=m)
    lines, energies, currents = [], [], []
    d = pot.decompose(frame, sources=True)
    for step in range(240):
        if step % 2 == 0:
            fs = units("gpumd").to_user("velocity", frame.velocities)
            head = f'Time={step}.0 pbc="T T T" Lattice="{2 * a} 0 0 0 {2 * a} 0 0 0 {2 * a}"'
            lines += [str(len(x)), f"{head} Properties=species:S:1:pos:R:3:vel:R:3"]
            lines += ["Si " + " ".join(f"{c:.15g}" for c in (*p, *w)) for p, w in zip(frame.positions, fs)]
            kinetic = 0.5 * m * (frame.velocities**2).sum(1)
            energies.append(d.energy + kinetic.sum())
            b = d.bonds
            W = np.zeros((len(x), 3, 3))
            np.add.at(W, b.j, b.r_bc[:, :, None] * b.D_bdc[:, 0, None, :])
            np.add.at(W, b.i, -b.r_bc[:, :, None] * b.D_bdc[:, 1, None, :])
            w = frame.velocities
            currents.append(w.T @ (kinetic + d.energies_n) + np.einsum("nij,nj->i", W, w))
        half = frame.velocities + 0.5 * dt * d.forces_nc / m[:, None]
        frame = frame.replace(positions=frame.positions + dt * half)
        d = pot.decompose(frame, sources=True)
        frame = frame.replace(velocities=half + 0.5 * dt * d.forces_nc / m[:, None])
    # of the kinetic energy of the atoms at 600 K
    assert np.ptp(energies) < 2e-3 * 1.5 * len(x) * METAL.boltzmann * 600
    (tmp_path / "dump.xyz").write_text("\n".join(lines) + "\n")
    frames = atc.read(tmp_path / "dump.xyz", units="gpumd")
    found = atc.heat_currents(frames, atc.nep(tmp_path / "nep.txt"))
    currents = np.array(currents)
    np.testing.assert_allclose(found.J_tc, currents, rtol=0, atol=1e-9 * np.abs(currents).max())
    (tmp_path / "scene.toml").write_text(
        f'[trajectory]\nfile = "{tmp_path}/dump.xyz"\nunits = "gpumd"\n[potential]\nnep = "{tmp_path}/nep.txt"\n'
    )
    done = CliRunner().invoke(
        app,
        ["conductivity", str(tmp_path / "scene.toml"), "--segments", "3", "--plateau", "20,30", "--json"],
    )
    assert done.exit_code == 0, done.output
    said = json.loads(done.output)
    theirs = atc.conductivity(found, segments=3, plateau=(20.0, 30.0))
    assert said["samples"] == 120 and said["atoms"] == 64
    assert said["value"] == pytest.approx(theirs.value, rel=1e-9) and np.isfinite(said["stderr"])
