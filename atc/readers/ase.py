"""ASE: Atoms in memory, and every file format that ``ase.io.iread`` reads."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..errors import AtcError, located
from ..frame import Cell, Frame
from ..units import units as unit_system
from .masses import Masses, check_units
from .trajectory import Trajectory
from .xyz import ExtendedXyz, need_ase


class _AseTrajectory(Trajectory):
    """What all ASE sources share: from Atoms to a Frame. Types count the species from 1 in order of first
    appearance."""

    def __init__(self, source, units, masses):
        super().__init__()
        self.source = source
        self.units = unit_system("ase")
        check_units(units, self.units, f"{source}: ASE's units are eV, Å, amu ('ase'),")
        self._masses = None if masses is None else Masses(masses, self.units)

    def _atoms(self, k):
        raise NotImplementedError

    def _species(self, k):
        return self._atoms(k).get_chemical_symbols()

    def _frame(self, k):
        atoms = self._atoms(k)
        where = f"{self.source} frame {k}"
        if not len(atoms):
            raise AtcError(f"{where}: holds no atoms")
        with located(where):
            cell = Cell(np.asarray(atoms.cell, float), periodic=atoms.pbc)
        types = self._types_from_names(atoms.get_chemical_symbols(), k)
        names = self.type_names
        masses = self._masses(types, names, where) if self._masses is not None else atoms.get_masses()
        velocities = forces = None
        if atoms.has("momenta"):
            # With the Atoms' own masses: momenta are p = m v of the run that wrote them. ("velocities" in atoms.arrays
            # is not ASE's own name and its units are unknown: it stays in extra.)
            velocities = atoms.get_momenta() / atoms.get_masses()[:, None]
        if atoms.calc is not None and "forces" in getattr(atoms.calc, "results", {}):
            # Only what is stored and belongs to these positions: nothing is calculated.
            forces = atoms.calc.get_property("forces", atoms, allow_calculation=False)
        charges = atoms.get_initial_charges() if atoms.has("initial_charges") else None
        own = {"numbers", "positions", "momenta", "masses", "initial_charges"}
        extra = {name: np.asarray(a) for name, a in atoms.arrays.items() if name not in own}
        return Frame(
            positions=atoms.get_positions(),
            cell=cell,
            units=self.units,
            types=types,
            masses=masses,
            velocities=velocities,
            forces=forces,
            charges=charges,
            source=where,
            type_names=names,
            extra=extra,
        )


class AtomsList(_AseTrajectory):
    """A trajectory of ase.Atoms in memory."""

    def __init__(self, items, units=None, masses=None):
        super().__init__("ase.Atoms", units, masses)
        for k, a in enumerate(items):
            if not all(hasattr(a, name) for name in ("arrays", "cell", "pbc")):
                raise AtcError(f"item {k} of the list is a {type(a).__name__}, expected ase.Atoms like the first")
        self._items = list(items)

    def __len__(self):
        return len(self._items)

    def _atoms(self, k):
        return self._items[k]


class _FromFile(_AseTrajectory):
    def __init__(self, path, units, masses):
        super().__init__(str(path), units, masses)
        self.path = Path(path)

    def _fail(self, k):
        return AtcError(
            f"{self.source} frame {k}: cannot be read as a file of {self._form}, which ASE takes it for: damaged, cut "
            "off, or something else"
        )

    _form = "ASE's own format (.traj)"

    def _frame(self, k):
        try:
            return super()._frame(k)
        except AtcError:
            raise
        except Exception:  # what was read is no possible set of Atoms
            raise self._fail(k) from None


class AseTrajFile(_FromFile):
    """ASE's own .traj: frames by number."""

    def __init__(self, path, units=None, masses=None):
        super().__init__(path, units, masses)
        self._file = None
        self._n = len(self._open())
        if not self._n:
            raise AtcError(f"{path} holds no frame")

    def _open(self):
        from ase.io.trajectory import TrajectoryReader

        if self._file is None:
            try:
                self._file = TrajectoryReader(str(self.path))
            except Exception:
                raise self._fail(0) from None
        return self._file

    def __len__(self):
        return self._n

    def _atoms(self, k):
        with self._guard:
            try:
                return self._open()[k]
            except AtcError:
                raise
            except Exception:
                raise self._fail(k) from None

    def close(self):
        if self._file is not None:
            self._file.close()
            self._file = None

    def __getstate__(self):
        return {**super().__getstate__(), "_file": None}


class AseFile(_FromFile):
    """Any other format, through ``ase.io.iread``: forward frame by frame; going back starts again."""

    def __init__(self, path, units=None, masses=None, form=None, described=None):
        super().__init__(path, units, masses)
        self._n = None
        self._format = form
        self._form = f"format {form!r}" + (f" ({described})" if described else "")
        self._restart()
        if not self._has(0):
            raise AtcError(f"{path} holds no frame")

    def _restart(self):
        self._iterator, self._at, self._last = None, -1, None

    def _advance(self) -> bool:
        if self._iterator is None:
            from ase.io import iread

            self._iterator = iread(str(self.path), index=":", format=self._format)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._last = next(self._iterator)
            if not all(hasattr(self._last, name) for name in ("arrays", "cell", "pbc")):
                raise TypeError
        except StopIteration:
            self._n = self._at + 1
            return False
        except Exception:
            raise self._fail(self._at + 1) from None
        self._at += 1
        return True

    def _has(self, k):
        with self._guard:
            if self._n is None:
                while self._at < k and self._advance():
                    pass
            return self._n is None or k < self._n

    def __len__(self):
        with self._guard:
            while self._n is None and self._advance():
                pass
            return self._n

    def _atoms(self, k):
        with self._guard:
            if k < self._at or self._iterator is None:
                self._restart()
            while self._at < k:
                if not self._advance():
                    raise IndexError(k)
            return self._last

    def __getstate__(self):
        return {**super().__getstate__(), "_iterator": None, "_at": -1, "_last": None}


def open_ase(path, units=None, masses=None):
    """The reader for a file of one of ASE's formats. A LAMMPS dump is never given to ASE, which would guess its
    units."""
    need_ase(path)
    from ase.io.formats import UnknownFileTypeError, filetype, ioformats

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            form = filetype(str(path))
    except UnknownFileTypeError:
        form = None
    except Exception:  # whatever a guess by one of a hundred formats stumbles over
        form = None
    if form not in ioformats:
        raise AtcError(
            f"{path}: neither LAMMPS, nor a format that MDAnalysis or ASE knows; give a dump, a data file, .extxyz, "
            ".traj, .trr, ..."
        )
    if form.startswith("lammps"):
        raise AtcError(
            f"{path}: looks like a LAMMPS file ({form}) but is not one that atc reads: a text dump starts with "
            "'ITEM:', a data file names '<n> atoms' and its box"
        )
    if form == "traj":
        return AseTrajFile(path, units, masses)
    if form in ("extxyz", "xyz"):
        return ExtendedXyz(path, None, units, masses)
    return AseFile(path, units, masses, form, str(getattr(ioformats[form], "description", "") or ""))


__all__ = ["AseFile", "AseTrajFile", "AtomsList", "ExtendedXyz", "need_ase", "open_ase"]
