"""phonopy on the same footing: its displacements, symmetry, force constants and dynamical matrix, our forces."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..errors import AtcError
from .crystal import Crystal, forces
from .force_constants import THZ, ForceConstants, supercell_repeat
from .zone import GREEK


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


def write_phonopy(fc: ForceConstants, folder, segments=None, points: int = 51) -> list:
    """Write force constants as phonopy has them: `phonopy.yaml` and `FORCE_CONSTANTS`, which phonopy and Euphonic read,
    and `band.yaml` along a path.

    Parameters
    ----------
    fc : ForceConstants, in physical units
    folder : made if it is not there
    segments : list of `zone.Segment` for band.yaml; None: no band.yaml
    points : on each segment

    Returns
    -------
    list of Path. The supercell is so large that every k is exact. Types without a name are called after the element of
    their mass, to 0.01 amu, or else H, He, … in turn; masses are in the files whatever the names.
    """

    from phonopy.file_IO import write_FORCE_CONSTANTS

    crystal = fc.crystal
    if crystal.units.reduced:
        raise AtcError(
            f"{crystal.name}: phonopy's files are in eV, Å and amu, but this crystal is in reduced units (lj)"
        )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    named = replace(fc, crystal=replace(crystal, type_names=_elements(crystal) | dict(crystal.type_names)))
    phonon = phonopy_from(named, supercell_repeat(crystal, 2.0 * fc.reach * 1.0001))
    out = [folder / "phonopy.yaml", folder / "FORCE_CONSTANTS"]
    phonon.save(out[0], settings={"force_sets": False, "displacements": False, "force_constants": False})
    write_FORCE_CONSTANTS(phonon.force_constants, filename=out[1])
    if segments:
        t = np.linspace(0.0, 1.0, points)[:, None]
        q = [(s.k_ec[0] + t * (s.k_ec[1] - s.k_ec[0])) @ crystal.vectors.T / (2 * np.pi) for s in segments]
        joined = [a.ends[1] == b.ends[0] for a, b in pairwise(segments)] + [False]
        labels = [segments[0].ends[0]]
        for s, nxt, on in zip(segments, [*segments[1:], None], joined):
            labels += [s.ends[1]] if on or nxt is None else [s.ends[1], nxt.ends[0]]
        phonon.run_band_structure(
            q, path_connections=joined, labels=[_tex(x) for x in labels], with_group_velocities=True
        )
        out.append(folder / "band.yaml")
        phonon.write_yaml_band_structure(filename=out[-1])
    return out


def _elements(crystal) -> dict:
    """{type: symbol} of types whose mass is that of one element."""
    from phonopy.structure.atomic_data import get_atomic_data

    known = [(entry[1], entry[3]) for entry in get_atomic_data().atom_data if entry[3]]
    out = {}
    for t, m in zip(crystal.types.tolist(), crystal.masses):
        near = [symbol for symbol, mass in known if abs(mass - m) < 0.01]
        if len(near) == 1:
            out[t] = near[0]
    return out


def _tex(label: str) -> str:
    """As phonopy's plots write it: $\\Gamma$, $\\Sigma_0$; rays as they are."""
    if not label[:1].isalpha():
        return label
    words = {letter: f"\\{word.title()}" for word, letter in GREEK.items()}
    letter = words.get(label[:1], label[:1])
    return f"${letter}_{label[1:]}$" if label[1:] else f"${letter}$" if label in words else label


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
