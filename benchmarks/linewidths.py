"""Linewidths of Lennard-Jones argon: of LAMMPS runs by `atc dispersion`'s fits, beside lattice dynamics by phono3py
with the same potential at the same lattice constants.

    python benchmarks/linewidths.py FOLDER [NAME ...]   needs lammps, phono3py, symfc

Two minutes a run on one core, beside LAMMPS's two.

Three theories, all classical and of third order in the displacements:

bare: the golden rule of the infinite crystal with the potential's own force constants. Widths are proportional to T:
    phono3py's at 10,000 K times T/10,000 K are this limit (n + 1/2 = kT/ħω to 1e-5).
effective: the same with force constants fitted to forces and displacements at T (TDEP: O. Hellman, I. A. Abrikosov,
    PRB 88, 144301 (2013)).
coupled: effective ones, and waves decay into waves that are as broad as they come out themselves, in the run's own box:
    c̈ + ω²c + ∫M(t − s)ċ(s)ds = 0, M_λ = Σ A c'c'' (mode-coupling theory: A. Castellano, J. P. A. Batista and
    M. J. Verstraete, JCP 159, 234501 (2023)). ω² = kT/⟨|u|²⟩. Its spectra are fitted as those of the run are.

Runs and snapshots that are in FOLDER are not made again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import atc
from atc.frame import Cell
from atc.upscaling.crystal import Crystal, forces
from atc.upscaling.force_constants import force_constants
from atc.upscaling.lineshapes import expected_periodogram, fit_line
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


def lammps():
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data"))
    from make import load_lammps

    return load_lammps()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])


def run(file, temperature, a, length, seed) -> None:
    """A LAMMPS run at constant energy after 32 ps of Langevin's thermostat, written as a binary dump."""
    lmp = lammps()
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


def pull(a, x_snc) -> np.ndarray:
    """(s, n, 3) atc's forces on atoms at x in a cubic box of whole cells."""
    potential = atc.potential(LJ, units="metal")
    n = x_snc.shape[1]
    edge = a * round((n / 4) ** (1 / 3))
    plain = crystal_at(a).supercell((1, 1, 1))[0].replace(
        cell=Cell(edge * np.eye(3)), types=np.ones(n, int), masses=np.full(n, MASS), ids=np.arange(1, n + 1),
        positions=x_snc[0],
    )  # fmt: skip
    return np.array([forces(potential, plain.replace(positions=x)) for x in x_snc])


def snapshots(file, a, temperature, x_nc, count=200):
    """Displacements from x and forces (s, n, 3), 4.8 ps apart, under Langevin's thermostat."""
    if not file.exists():
        n, edge = len(x_nc), a * round((len(x_nc) / 4) ** (1 / 3))
        lmp = lammps()
        lmp.commands_string(
            f"units metal\natom_style atomic\natom_modify map yes\nregion b block 0 {edge} 0 {edge} 0 {edge}\n"
            "create_box 1 b"
        )
        lmp.create_atoms(n, list(range(1, n + 1)), [1] * n, np.ascontiguousarray(x_nc).ravel().tolist())
        lmp.commands_string(
            f"mass 1 {MASS}\n{LJ}\nneighbor 0.8 bin\nneigh_modify delay 0 every 5\ntimestep {STEP}\n"
            f"velocity all create {2 * temperature} 5 mom yes dist gaussian\nfix 1 all nve\n"
            f"fix 2 all langevin {temperature} {temperature} 1.0 6 zero yes\nrun 2000"
        )
        u_snc = []
        for _ in range(count):
            lmp.command("run 300")
            u = np.array(lmp.gather_atoms("x", 1, 3)).reshape(n, 3) - x_nc
            u -= edge * np.rint(u / edge)
            u_snc.append(u - u.mean(axis=0))
        lmp.close()
        np.savez(file, u=u_snc, f=pull(a, x_nc + np.array(u_snc)))
    with np.load(file) as data:
        return data["u"], data["f"]


def lattice(a, temperature=None, folder=None):
    """Phono3py with second force constants of 256 atoms, whose edge is longer than twice the cutoff, and third ones of
    108: central differences of atc's forces, or fitted to snapshots at a temperature. The second ones are then fitted
    without third ones beside them: they are kT⟨u u⟩⁻¹, the stiffness that holds ⟨|u|²⟩."""
    from phono3py import Phono3py
    from phonopy.structure.atoms import PhonopyAtoms

    cube = PhonopyAtoms(["Ar"] * 4, cell=a * np.eye(3), masses=[MASS] * 4,
                        scaled_positions=[[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])  # fmt: skip
    found = Phono3py(
        cube, supercell_matrix=[3, 3, 3], phonon_supercell_matrix=[4, 4, 4], primitive_matrix="F", cutoff_frequency=1e-2
    )
    if temperature is None:
        found.generate_displacements(distance=0.01, is_plusminus=True)
        found.generate_fc2_displacements(distance=1e-3, is_plusminus=True)
        at = lambda cells: np.array([c.positions for c in cells])  # noqa: E731
        rest = [pull(a, at([c]))[0] for c in (found.supercell, found.phonon_supercell)]
        found.forces = pull(a, at(found.supercells_with_displacements)) - rest[0]
        found.phonon_forces = pull(a, at(found.phonon_supercells_with_displacements)) - rest[1]
        found.produce_fc3()
        found.symmetrize_fc3()
        found.produce_fc2()
        found.symmetrize_fc2()
        return found
    small, large = (
        dict(
            zip(
                ("displacements", "forces"),
                snapshots(folder / f"{a}_{temperature:.4g}K_{len(c)}.npz", a, temperature, c.positions),
            )
        )
        for c in (found.supercell, found.phonon_supercell)
    )
    found.phonon_dataset, found.dataset = large, small
    found.produce_fc2(fc_calculator="symfc")
    found.produce_fc3(fc_calculator="symfc", fc_calculator_options="|cutoff=6.0")  # second neighbours
    return found


def golden_rule(found, k_kc, mesh=24, temperature=1e4):
    """γ/T and ω/2π (k, 3) of modes, ps⁻¹/K and THz, in the classical limit, from phono3py's third-order widths."""
    found.mesh_numbers = [mesh] * 3
    found.init_phph_interaction()
    q = k_kc @ np.array(found.primitive.cell).T / (2 * np.pi) * mesh
    whole = np.rint(q).astype(int)
    if np.abs(q - whole).max() > 1e-6:
        raise SystemExit(f"mesh {mesh} does not hold all wave vectors")
    found.run_thermal_conductivity(temperatures=[temperature], grid_points=_points(found.grid, whole))
    result = found.thermal_conductivity
    half = np.array(result.gamma)[0, 0]  # (grid point, band), THz: half of the full width
    return 2 * np.pi * 2 * half / temperature, np.array(result.frequencies)


def _points(grid, address):
    """Numbers of the grid points at integer addresses."""
    from phonopy.phonon.grid import get_grid_point_from_address

    return [int(grid.grg2bzg[get_grid_point_from_address(x, grid.D_diag)]) for x in address]


def strengths(found, k_kc, a):
    """Which irreducible wave vector of the run's box each k is; ω/2π (n, 3) of all of these, and A_λλ'λ''/T in
    rad²/ps²/K, λ = (n, branch), of M = Σ A c'c'': the golden rule's half width is (π/8) Σ A δ(ω ± ω' ± ω''), four
    signs."""
    from phonopy.phonon.grid import get_ir_grid_points
    from phonopy.physical_units import get_physical_units

    mesh = 2 * CELLS  # of the primitive cell: holds the box's waves, and as many again
    found.mesh_numbers = [mesh] * 3
    found.init_phph_interaction()
    found.run_phonon_solver()
    pair, grid = found.phph_interaction, found.grid
    cell = np.array(found.primitive.cell)
    turns = np.array(grid.addresses) / mesh @ np.linalg.inv(cell).T * CELLS * a
    inside = np.abs(turns - np.rint(turns)).max(axis=1) < 1e-6
    to_bz = np.array(grid.grg2bzg)
    own, _, irreducible = get_ir_grid_points(grid)
    own = [g for g in own if inside[to_bz[g]]]
    number = np.full(len(irreducible), -1)
    number[own] = np.arange(len(own))
    number = number[irreducible][np.array(grid.bzg2grg)]
    wanted = number[_points(grid, np.rint(k_kc @ cell.T / (2 * np.pi) * mesh).astype(int))]
    f_kb = np.array(found.get_phonon_data()[0])
    units = get_physical_units()
    h, kB = 2 * np.pi * units.Hbar * 1e12, units.KB  # eV ps, eV/K
    A = np.zeros((len(own), 3, len(own), 3, len(own), 3))
    for n, g in enumerate(own):
        pair.set_grid_point(to_bz[g])
        pair.run()
        triplets, weights = (np.array(x) for x in pair.get_triplets_at_q()[:2])
        f, f1, f2 = (f_kb[t] for t in triplets.T)
        safe1, safe2 = np.maximum(f1, 1e-2), np.maximum(f2, 1e-2)  # resting crystal: no strength, but 0/0
        x = np.array(pair.interaction_strength) * (weights[:, None] * f)[..., None, None]
        x *= 1 / safe1[:, None, :, None] / safe2[:, None, None, :]
        i, j = (number[t] for t in triplets.T[1:])
        for t in np.flatnonzero(i >= 0):
            A[n, :, i[t], :, j[t], :] += x[t]
    # phono3py: half width/2π = 18π/h² Σ |Φ|² (kT/h) f/(f'f'') δ(f ± f' ± f''), a sum over its whole mesh.
    A *= 32 * np.pi * 18 * np.pi / h**2 * kB / h / inside[to_bz].mean()
    size = 3 * len(own)
    A = A.reshape(size, size, size)
    return wanted, f_kb[to_bz[own]], 0.5 * (A + A.transpose(0, 2, 1))


def coupled(f_kb, A, dt=0.06, n=16384, tolerance=2e-3):
    """(λ, t) velocity correlations of modes that decay into each other; dt in ps, A in rad²/ps²."""
    f = f_kb.ravel()
    moves = f > 1e-2
    w0 = 2 * np.pi * f[:, None]
    w = 2 * np.pi * np.fft.rfftfreq(2 * n, dt)
    t = dt * np.arange(n)
    same = np.abs(f_kb[:, :, None] - f_kb[:, None]) < 1e-5 * f.max()  # degenerate: which is which is arbitrary
    same = same / same.sum(axis=2, keepdims=True)
    size = len(f)
    c = np.cos(w0 * t) * np.exp(-0.06 * t) * moves[:, None]
    for _ in range(60):
        M = np.empty((size, n))
        for part in np.array_split(np.arange(n), 64):
            x = c[:, part]
            M[:, part] = np.einsum("lit,it->lt", (A.reshape(-1, size) @ x).reshape(size, size, -1), x)
        M = np.einsum("kab,kbt->kat", same, M.reshape(-1, 3, n)).reshape(size, n)
        M[:, 0] *= 0.5  # trapezium
        M_w = np.conj(np.fft.rfft(M, 2 * n, axis=1)) * dt
        with np.errstate(divide="ignore", invalid="ignore"):
            S = np.where(moves[:, None], 2 * (1 / (-1j * w + w0**2 / (-1j * w) + M_w)).real, 0.0)
            u = w0**2 * S / w**2
        S[:, 0] = 0.0
        u[:, 0] = np.where(moves, 2 * M_w[:, 0].real / np.maximum(w0[:, 0], 1e-2) ** 2, 0.0)
        new = np.fft.irfft(u, axis=1)[:, :n] / dt
        change = np.abs(new - c).max()
        c = 0.5 * (c + new)
        if change < tolerance:
            return np.fft.irfft(S, axis=1)[:, :n] / dt
    raise SystemExit(f"modes that decay into each other did not settle: correlations still change by {change:.2g}")


def fitted(c_t, dt=0.06):
    """γ (1/ps) of a velocity correlation by the fit that the run's lines have: of a series with just this spectrum."""
    S = np.maximum(expected_periodogram(c_t, dt), 1e-12)
    return fit_line(np.fft.ifft(np.sqrt(np.concatenate([S, S[-2:0:-1]]) * len(c_t) / dt)), dt).gamma


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
        effective = lattice(a, found.temperature, folder)
        bare_rate, harmonic = golden_rule(lattice(a), found.k_kc)
        number, f_kb, A = strengths(effective, found.k_kc, a)
        c = coupled(f_kb, A * found.temperature)
        effective_rate, _ = golden_rule(effective, found.k_kc)
        GHz = 1e3 / (2 * np.pi)
        internal = GHz / float(frames.units.to_user("time", 1.0))
        print(f"{name}: {found.temperature:.2f} K, {found.frames} frames; γ/2π in GHz, (2π/a), harmonic THz")
        rows = []
        for k, i, lines, *rates, f in zip(found.k_kc, number, found.lines_km, bare_rate, effective_rate, harmonic):
            for m, line in enumerate(lines):
                if m and abs(f[m] - f[m - 1]) < 1e-6 * f[m]:
                    continue
                golden = [GHz * found.temperature * r[m] for r in rates]
                rows.append((*golden, GHz * fitted(c[3 * i + m]), internal * line.gamma, internal * line.gamma_error))
                print(
                    "  {!s:24} {:8.4f}  bare {:7.2f}  effective {:7.2f}  coupled {:7.2f}  run {:7.2f} ± {:.2f}".format(
                        np.round(k * a / (2 * np.pi), 3) + 0.0, f[m], *rows[-1]
                    ),
                    f" misfit {line.misfit:.2f}",
                )
        *theories, measured, error = np.array([r for r in rows if np.isfinite(r).all()]).T
        for label, theory in zip(("bare", "effective", "coupled"), theories):
            ratio = np.log(measured / theory)
            print(
                f"  {label}: run/theory {np.exp(np.median(ratio)):.2f} (median), {np.exp(ratio.min()):.2f} to "
                f"{np.exp(ratio.max()):.2f}, scatter of the logarithm {ratio.std():.2f}; "
                f"{(np.abs(measured - theory) < 2 * error).sum()} of {len(ratio)} within two errors"
            )


if __name__ == "__main__":
    if len(sys.argv) < 2:
        print(__doc__)
        raise SystemExit
    main(Path(sys.argv[1]), sys.argv[2:])
