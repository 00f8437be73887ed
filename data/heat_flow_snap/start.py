"""Heat from a hot slab to a cold one in silicon, by velocity Verlet with the forces of a SNAP potential by atc itself:
flux.csv, profile.csv and some frames. About six minutes on one core.

In each step the velocities of two slabs, relative to their means, are scaled so that a power of 6 eV/ps goes into one
and out of the other (Hafskjold, Ikeshoji & Ratkje, Mol. Phys. 80, 1389 (1993)).
"""

import gzip
from pathlib import Path

import numpy as np

import atc
from atc.deposit import make
from atc.estimators.accuracy.random_points import kernel_internal
from atc.frame import Cell, Frame
from atc.units import units

HERE = Path(__file__).parent
METAL = units("metal")
FCC = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
ACROSS, ALONG, A = 2, 18, 5.431 * 1.005
STEP, STEPS, FIRST, EVERY, KEPT = 0.002, 24000, 4000, 50, 40
POWER, BINS = 6.0, 36
HEIGHT, AREA = ALONG * A, (ACROSS * A) ** 2
MASS = 28.0855
POT = atc.potential("pair_style snap\npair_coeff * * Si.snapcoeff Si.snapparam Si", units="metal", folder=HERE)


def crystal():
    counts = np.meshgrid(range(ACROSS), range(ACROSS), range(ALONG), indexing="ij")
    x = (np.stack(counts, -1).reshape(-1, 1, 3) + np.concatenate([FCC, FCC + 0.25])).reshape(-1, 3) * A
    v = np.random.default_rng(7).normal(size=x.shape) * np.sqrt(METAL.boltzmann * 2000 / MASS)
    cell = Cell(np.diag([ACROSS * A, ACROSS * A, HEIGHT]))
    ones = np.ones(len(x))
    return Frame(x, cell, METAL, types=ones.astype(int), velocities=v - v.mean(0), masses=MASS * ones)


def run():
    """Positions and velocities (Å, Å/ps), four decimals, every 0.1 ps from 8 ps on."""
    frame, dt = crystal(), METAL.to_internal("time", STEP)
    x, v, cell, n = frame.positions, frame.velocities, frame.cell, len(frame)
    heat = METAL.to_internal("energy", POWER) * STEP
    forces = POT.stream(frame, forces=True).forces_nc
    out = []
    for step in range(STEPS + 1):
        if step >= FIRST and (step - FIRST) % EVERY == 0:
            out.append((np.round(x, 4), np.round(METAL.to_user("velocity", v), 4)))
        half = v + 0.5 * dt * forces / MASS
        x = x + dt * half
        forces = POT.stream(frame.replace(positions=x), forces=True).forces_nc
        v = half + 0.5 * dt * forces / MASS
        if step < 2000:
            v *= np.sqrt(1 + 0.01 * (3 * n * METAL.boltzmann * 1000 / (MASS * (v**2).sum()) - 1))
        z = x[:, 2] % cell.vectors[2, 2]
        for low, sign in ((0.0, 1.0), (HEIGHT / 2, -1.0)):
            there = (z >= low) & (z < low + 2 * A)
            mean = v[there].mean(0)
            own = v[there] - mean
            v[there] = mean + own * np.sqrt(1 + sign * heat / (0.5 * MASS * (own**2).sum()))
    return frame, out


def half_half(frame, kern, grid):
    """(bins,) what virials shared half and half give: Σ (e v − W v) φ, component z (LAMMPS's compute heat/flux)."""
    d, v = POT.decompose(frame), frame.velocities
    b, W = d.bonds, np.zeros((len(frame), 3, 3))
    share = -0.5 * b.r_bc[:, :, None] * b.F_bc[:, None, :]
    np.add.at(W, b.i, share)
    np.add.at(W, b.j, share)
    J = (0.5 * MASS * (v**2).sum(1) + d.energies_n) * v[:, 2] - np.einsum("nj,nj->n", W[:, 2], v)
    deposit = make(
        "slab", grid.bind(METAL, frame.cell, frame.positions), kernel_internal(kern, METAL), frame.cell, 1, 1
    )
    deposit.add_sites(frame.positions, J[:, None])
    return METAL.to_user("energy_flux", deposit.site_sums()[:, 0])


def main():
    frame, states = run()
    frames = [frame.replace(positions=x, velocities=METAL.to_internal("velocity", v)) for x, v in states]
    kern, grid = atc.kernel("quartic", 6.0), atc.Grid.slab("z", BINS)
    ds = atc.fields(frames, POT, kern, grid, ["heat_flux", "energy_flux", "temperature"])
    z, T = ds.z.values, ds.temperature.values
    q, e = ds.heat_flux.values[:, :, 2], ds.energy_flux.values[:, :, 2]
    h = np.array([half_half(f, kern, grid) for f in frames])
    up = (z > 2 * A + 6) & (z < HEIGHT / 2 - 6)
    down = (z > HEIGHT / 2 + 2 * A + 6) & (z < HEIGHT - 6)
    times = STEP * (FIRST + EVERY * np.arange(len(frames)))
    free = [(a[:, up].mean(1) - a[:, down].mean(1)) / 2 for a in (q, e, h)]
    save("flux.csv", "time,heat_flux,energy_flux,half_half", np.column_stack([times, *free]), "%.1f" + 3 * ",%.6f")
    names, columns = ["z", "temperature"], [z, T.mean(0)]
    for name, a in (("heat_flux", q), ("energy_flux", e), ("half_half", h)):
        blocks = a[: len(a) // 10 * 10].reshape(10, -1, BINS).mean(1)
        names += [name, f"{name}_stderr"]
        columns += [a.mean(0), blocks.std(0, ddof=1) / np.sqrt(10)]
    save("profile.csv", ",".join(names), np.column_stack(columns), "%.3f,%.1f" + 6 * ",%.6f")
    bounds = "".join(f"0 {c:.6f}\n" for c in np.diag(frame.cell.vectors))
    with gzip.GzipFile(HERE / "heat_flow_snap.dump.gz", "wb", mtime=0) as out:
        for k in range(0, len(states), KEPT):
            head = f"ITEM: UNITS\nmetal\nITEM: TIME\n{times[k]:.1f}\nITEM: TIMESTEP\n{FIRST + EVERY * k}\n"
            head += f"ITEM: NUMBER OF ATOMS\n{len(frame)}\nITEM: BOX BOUNDS pp pp pp\n{bounds}"
            rows = (f"{n} 1 " + " ".join(f"{c:.4f}" for c in (*x, *v)) for n, (x, v) in enumerate(zip(*states[k]), 1))
            out.write((head + "ITEM: ATOMS id type xu yu zu vx vy vz\n" + "\n".join(rows) + "\n").encode())


def save(name, head, table, form):
    np.savetxt(HERE / name, table, fmt=form, header=head, comments="")


if __name__ == "__main__":
    main()
