"""Linewidths of Lennard-Jones argon: of LAMMPS runs by `atc dispersion`'s fits, beside third-order lattice dynamics by
phono3py with the same potential at the same lattice constants.

    python benchmarks/linewidths.py FOLDER [NAME ...]      needs lammps and phono3py; minutes a run on a quiet machine

Runs are classical, and so is the theory here: in the classical limit a third-order width is proportional to T, and
phono3py's at 10,000 K times T/10,000 K is that limit (n + 1/2 = kT/ħω to 1e-5). Dumps in FOLDER are not made again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import atc
from atc.frame import Cell
from atc.upscaling.crystal import Crystal, forces
from atc.upscaling.force_constants import force_constants
from atc.upscaling.vibrations import measure

LJ = "pair_style lj/cut 8.5\npair_coeff 1 1 0.0104 3.40"
MASS = 39.948
RAYS = ((1, 0, 0), (1, 1, 0), (1, 1, 1))
#: Runs of 6³ cells: (K, lattice constant in Å, ns, seed). The classical crystal has no pressure at 5.315 Å and 20 K.
RUNS = {
    "5K": (5, 5.315, 1.8, 66),
    "20K": (20, 5.315, 2.0, 11),
    "20K_again": (20, 5.315, 2.0, 22),
    "60K": (60, 5.436, 1.0, 33),
}
CELLS, STEP, EVERY = 6, 0.016, 12  # ps, steps between frames


def crystal_at(a) -> Crystal:
    return Crystal.cubic("fcc", a, MASS, "metal", symbols="Ar")


def run(file, temperature, a, length, seed) -> None:
    """A LAMMPS run at constant energy after 32 ps of Langevin's thermostat, written as a binary dump."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data"))
    from make import load_lammps

    lmp = load_lammps()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    lmp.commands_string(
        f"units metal\natom_style atomic\nlattice fcc {a}\nregion b block 0 {CELLS} 0 {CELLS} 0 {CELLS}\n"
        f"create_box 1 b\ncreate_atoms 1 box\nmass 1 {MASS}\n{LJ}\nneighbor 0.8 bin\nneigh_modify delay 0 every 5\n"
        f"timestep {STEP}\nvelocity all create {2 * temperature} {seed} mom yes dist gaussian\n"
        f"fix 1 all langevin {temperature} {temperature} 1.0 {seed + 1} zero yes\nfix 2 all nve\nrun 2000\n"
        f"unfix 1\nvelocity all zero linear\nrun 500\nreset_timestep 0\n"
        f"dump d all custom {EVERY} {file} id x y z vx vy vz\ndump_modify d sort id time yes units yes\n"
        f"run {round(1000 * length / STEP)}"
    )
    lmp.close()


def third_order(a, k_kc, mesh=24, temperature=1e4):
    """γ/T and ω (k, 3) of modes, internal, in the classical limit, from phono3py's third-order widths.

    Force constants are central differences of atc's forces: third ones in 108 atoms, second ones in 256, whose edge is
    longer than twice the cutoff.
    """
    from phono3py import Phono3py
    from phonopy.structure.atoms import PhonopyAtoms

    crystal = crystal_at(a)
    potential = atc.potential(LJ, units="metal")
    cube = PhonopyAtoms(["Ar"] * 4, cell=a * np.eye(3), masses=[MASS] * 4,
                        scaled_positions=[[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])  # fmt: skip
    found = Phono3py(cube, supercell_matrix=[3, 3, 3], phonon_supercell_matrix=[4, 4, 4], primitive_matrix="F")
    found.generate_displacements(distance=0.01, is_plusminus=True)
    found.generate_fc2_displacements(distance=1e-3, is_plusminus=True)
    plain = crystal.supercell((1, 1, 1))[0]

    def pull(cell):
        n = len(cell)
        frame = plain.replace(
            positions=np.array(cell.positions), cell=Cell(cell.cell), types=np.ones(n, int), masses=np.full(n, MASS),
            ids=np.arange(1, n + 1),
        )  # fmt: skip
        return forces(potential, frame)

    rest = [pull(s) for s in (found.supercell, found.phonon_supercell)]
    found.forces = np.array([pull(s) - rest[0] for s in found.supercells_with_displacements])
    found.phonon_forces = np.array([pull(s) - rest[1] for s in found.phonon_supercells_with_displacements])
    found.produce_fc3(symmetrize_fc3r=True)
    found.produce_fc2()
    found.symmetrize_fc2()
    found.mesh_numbers = [mesh] * 3
    found.init_phph_interaction()
    q = k_kc @ np.array(found.primitive.cell).T / (2 * np.pi) * mesh
    whole = np.rint(q).astype(int)
    if np.abs(q - whole).max() > 1e-6:
        raise SystemExit(f"mesh {mesh} does not hold all wave vectors")
    grid = found.grid
    found.run_thermal_conductivity(temperatures=[temperature], grid_points=_points(grid, whole))
    result = found.thermal_conductivity
    half = np.array(result.gamma)[0, 0]  # (grid point, band), THz: half of the full width
    omega = np.array(result.frequencies)
    unit = 2 * np.pi * float(crystal.units.to_user("time", 1.0))  # THz in 1/(internal time)
    return 2 * half * unit / temperature, omega * unit


def _points(grid, address):
    """Numbers of the grid points at integer addresses."""
    from phonopy.phonon.grid import get_grid_point_from_address

    return [int(grid.grg2bzg[get_grid_point_from_address(x, grid.D_diag)]) for x in address]


def main(folder, names) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    potential = atc.potential(LJ, units="metal")
    for name in names or RUNS:
        temperature, a, length, seed = RUNS[name]
        file = folder / f"{name}.bin"
        if not file.exists():
            run(file, temperature, a, length, seed)
        frames = atc.read(file, masses=[MASS])
        found = measure(
            frames, crystal_at(a), RAYS, fc=lambda c: force_constants(c, potential), lines="lorentzian"
        )  # fmt: skip
        rate, omega = third_order(a, found.k_kc)
        GHz = 1e3 / float(frames.units.to_user("time", 1.0)) / (2 * np.pi)
        print(f"{name}: {found.temperature:.2f} K, {found.frames} frames; γ/2π in GHz, (2π/a), harmonic THz")
        for k, lines, theory, harmonic in zip(found.k_kc, found.lines_km, rate * found.temperature, omega):
            for m, line in enumerate(lines):
                if m and abs(harmonic[m] - harmonic[m - 1]) < 1e-6 * harmonic[m]:
                    continue
                print(
                    f"  {np.round(k * a / (2 * np.pi), 3)!s:24} {GHz * harmonic[m] / 1e3:8.4f}  third order "
                    f"{GHz * theory[m]:7.2f}  run {GHz * line.gamma:7.2f} ± {GHz * line.gamma_error:.2f}  misfit "
                    f"{line.misfit:.2f}"
                )


if __name__ == "__main__":
    if len(sys.argv) < 2:
        print(__doc__)
        raise SystemExit
    main(Path(sys.argv[1]), sys.argv[2:])
