"""phonopy on the same footing: its displacements, symmetry, force constants and dynamical matrix, our forces."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .crystal import Crystal, forces
from .force_constants import THZ, ForceConstants


def phonopy_of(crystal: Crystal, model, repeat, *, distance: float = 1e-4):
    """A `phonopy.Phonopy` with force constants from displaced supercells, whose forces are those of `model`.

    Parameters
    ----------
    crystal : Crystal (at rest)
    model : potential of `atc.potential`, or an ASE calculator
    repeat : three ints, the supercell in primitive vectors. At k that are commensurate with it the result is exact; at
        others only if no lattice
        vector of the supercell is shorter than twice the reach of the forces.
    distance : displacement in internal length; plus and minus are both taken, so that the error is of second order
        (1e-9 at 1e-4 Å)

    Returns
    -------
    phonopy.Phonopy with `force_constants`; frequencies in THz for physical units (ω/2π in reduced ones).
    """
    phonon = _phonopy(crystal, repeat)
    phonon.generate_displacements(distance=distance, is_plusminus=True, is_diagonal=False)
    plain, _ = crystal.supercell(repeat)
    out = []
    for displaced in phonon.supercells_with_displacements:
        x = np.array(displaced.positions)
        order = _match(x, plain)
        f = np.empty_like(x)
        f[order] = forces(model, plain.replace(positions=x[order]))
        out.append(f)
    phonon.forces = out
    phonon.produce_force_constants()
    return phonon


def phonopy_from(fc: ForceConstants, repeat):
    """A `phonopy.Phonopy` that works with given force constants, folded into a supercell."""
    phonon = _phonopy(fc.crystal, repeat)
    plain, basis = fc.crystal.supercell(repeat)
    order = _match(np.array(phonon.supercell.positions), plain)  # phonopy's atom order[s] is our atom s
    compact = fc.folded(repeat)
    n, m = len(fc.crystal), len(plain)
    cells = fc.crystal.lattice_points(repeat)
    full = np.empty((m, m, 3, 3))
    index = {tuple(c): k for k, c in enumerate(cells)}
    for a in range(m):
        home = cells[a // n]
        for k, c in enumerate(cells):
            there = index[tuple((home + c) % np.array(repeat))]
            full[order[a], order[there * n : there * n + n]] = compact[a % n, k * n : k * n + n]
    phonon.force_constants = full
    return phonon


def frequencies(phonon, crystal: Crystal, k_kc) -> np.ndarray:
    """(k, 3n) THz (or 1/tau), ascending, imaginary ones negative, of wave vectors in Cartesian coordinates."""
    q = np.atleast_2d(k_kc) @ crystal.vectors.T / (2 * np.pi)
    return np.array(phonon.run_qpoints(q).frequencies)


def _phonopy(crystal, repeat):
    try:
        from phonopy import Phonopy
        from phonopy.structure.atoms import PhonopyAtoms
    except ImportError:
        raise AtcError('phonopy is not installed: pip install "atc[crystal]"') from None
    # Symbols only tell species apart here: masses are given.
    stand_in = ("H", "He", "Li", "Be", "B", "C", "N", "O", "F", "Ne")
    symbols = [crystal.type_names.get(t) or stand_in[(t - 1) % len(stand_in)] for t in crystal.types.tolist()]
    cell = PhonopyAtoms(symbols=symbols, cell=crystal.vectors, positions=crystal.positions, masses=crystal.masses)
    # phonopy's factor turns √(eV/amu)/Å into THz; reduced units get ω/2π.
    factor = 1 / (2 * np.pi) if crystal.units.reduced else THZ
    phonon = Phonopy(cell, supercell_matrix=np.diag(repeat), primitive_matrix=np.eye(3), log_level=0)
    phonon.unit_conversion_factor = factor
    return phonon


def _match(x, frame) -> np.ndarray:
    """For each atom of `frame` the index in `x` of the atom that sits there (up to images and displacements)."""
    from scipy.spatial import cKDTree

    inv = np.linalg.inv(frame.cell.vectors)
    wrap = lambda y: np.mod(y @ inv + 0.25 / len(frame), 1.0)  # noqa: E731
    a, b = wrap(x), wrap(frame.positions)
    distance, index = cKDTree(np.mod(a, 1.0), boxsize=1.0).query(np.mod(b, 1.0))
    if len(np.unique(index)) != len(frame):
        raise AtcError("phonopy's supercell and ours do not hold the same atoms")
    return index
