"""What every decomposer must fulfil, shared by their tests: agreement with LAMMPS, and sources that are the derivatives
of the energy shares."""

import numpy as np
from lammps_oracle import run_lammps

import atc

# LAMMPS and atc sum the same terms in another order; its printed constants and unit factors agree to a few 1e-16,
# differences grow with cancellation.
LAMMPS_TOLERANCE = 1e-10


def potential(lines, config, **more):
    return atc.potential(lines, units=config.units, name="test", **more)


def agrees_with_lammps(pot, lines, config, *, shares=True, tolerance=LAMMPS_TOLERANCE, before=(), threads=2):
    """Energy, forces, full virial and (shares) per-atom energies against a live LAMMPS; returns both answers."""
    res = run_lammps(lines, config, before=before)
    frame = config.frame()
    d = pot.decompose(frame, threads=threads)
    u = frame.units
    scale = np.abs(res.energies_n).sum() + abs(res.energy)
    assert abs(u.to_user("energy", d.energy) - res.energy) <= tolerance * scale, (
        u.to_user("energy", d.energy),
        res.energy,
    )
    forces = u.to_user("force", d.forces_nc)
    np.testing.assert_allclose(forces, res.forces_nc, rtol=0, atol=tolerance * np.abs(res.forces_nc).max())
    mine = u.to_user("pressure", d.virial_cc / frame.cell.volume) * res.volume
    np.testing.assert_allclose(
        mine, res.virial, rtol=0, atol=tolerance * max(np.abs(res.virial).max(), np.abs(res.stress_n).max())
    )
    if shares:
        np.testing.assert_allclose(
            u.to_user("energy", d.energies_n), res.energies_n, rtol=0, atol=tolerance * np.abs(res.energies_n).max()
        )
    np.testing.assert_allclose(d.energies_n.sum(), d.energy, rtol=1e-12, atol=1e-12 * np.abs(d.energies_n).sum())
    consistent_bonds(d, len(frame), threads)
    return d, res


def consistent_bonds(d, n, threads=1):
    """Forces and virial are what the bonds say, and nothing else."""
    b = d.bonds
    forces = np.zeros((n, 3))
    f = -b.G_b[:, None] * b.r_bc
    np.add.at(forces, b.i, f)
    np.add.at(forces, b.j, -f)
    # Rounding of sums over bonds.
    scale = max(np.abs(f).max(initial=0.0), 1e-300)
    np.testing.assert_allclose(d.forces_nc, forces, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(d.virial_cc, b.virial(), rtol=0, atol=1e-11 * (np.abs(b.G_b) @ (b.r_bc**2).sum(axis=1)))


def source_matrix(bonds, n):
    """(n, n, 3): ∂U^(p)/∂x_k with all images of k moving, the diagonal from translation invariance."""
    m = np.zeros((n, n, 3))
    np.add.at(m, (bonds.i, bonds.j), bonds.D_bdc[:, 0])
    np.add.at(m, (bonds.j, bonds.i), bonds.D_bdc[:, 1])
    m[np.arange(n), np.arange(n)] = 0.0
    m[np.arange(n), np.arange(n)] = -m.sum(axis=1)
    return m


def sources_are_derivatives(pot, frame, *, h=1e-5, tolerance=3e-8, atoms=None):
    """D against central differences of every atom's energy share, and Σ_p ∂U^(p)/∂x_k = −F_k exactly.

    tolerance : relative to the largest source; central differences with h = 1e-5 Å of energies of order 1 are good to
        1e-11/h + h² U'''.
    """
    n = len(frame)
    d = pot.decompose(frame, sources=True)
    assert d.bonds.D_bdc is not None and d.bonds.D_bdc.shape == (len(d.bonds), 2, 3)
    m = source_matrix(d.bonds, n)
    scale = np.abs(m).max()
    assert scale > 0
    np.testing.assert_allclose(m.sum(axis=0), -d.forces_nc, rtol=0, atol=1e-11 * max(scale, np.abs(d.forces_nc).max()))
    for k in range(n) if atoms is None else atoms:
        for c in range(3):
            e = []
            for sign in (1, -1):
                x = frame.positions.copy()
                x[k, c] += sign * h
                e.append(pot.stream(frame.replace(positions=x), energies=True).energies_n)
            np.testing.assert_allclose(m[:, k, c], (e[0] - e[1]) / (2 * h), rtol=0, atol=tolerance * scale)
    # Asking for sources must not change anything else.
    plain = pot.decompose(frame)
    np.testing.assert_allclose(plain.forces_nc, d.forces_nc, rtol=0, atol=1e-12 * max(np.abs(d.forces_nc).max(), scale))
    np.testing.assert_allclose(plain.virial_cc, d.virial_cc, rtol=0, atol=1e-12 * max(np.abs(d.virial_cc).max(), scale))
    return d
