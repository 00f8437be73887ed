"""`read`: one call for every source of frames."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from ..errors import AtcError

# Suffixes of formats that MDAnalysis reads with its units; everything else that is not LAMMPS's goes to ASE.
_MDANALYSIS = frozenset(
    ".trr .xtc .dcd .nc .ncdf .netcdf .h5md .tng .gro .pdb .pdbqt .pqr .crd .inpcrd .rst7 .restrt .mdcrd .trj .trz "
    ".gsd .dms .txyz .arc .mol2 .coor .namdbin".split()
)
_TOPOLOGIES = (".psf", ".top", ".itp", ".prmtop", ".parm7", ".tpr")
_LAMMPS_NAMES = (".lammpstrj", ".dump", ".lammpsdump")


def read(
    source,
    topology=None,
    units=None,
    masses=None,
    dimension=None,
    atom_style=None,
    *,
    cell=None,
    pbc=None,
    timestep=None,
):
    """A lazy, sliceable trajectory of `Frame`s.

    Parameters
    ----------
    source
        The path of a file of LAMMPS: dump (text, binary, yaml, netcdf, cfg, dcd, extxyz; plain, .gz, .bz2, .xz, .zst)
        or data file; of anything
        ``ase.io.iread`` or MDAnalysis reads; a pattern (``dump.*``, in the order of the numbers in the names) or a list
        of paths, which are joined; or ase.Atoms, a list of them, an MDAnalysis Universe or AtomGroup, a Frame, a list
        of Frames, a trajectory. What a file is, is told from its content where it is LAMMPS's, from its name otherwise;
        what is no trajectory is told too. ``imd://host:port`` is a running simulation that streams its frames (IMDv3,
        through MDAnalysis and imdclient): iterate over it, once, or give it to `atc.fields`.
    topology
        For LAMMPS: the path of a data file, which gives bonded terms, and masses, charges and types where the dump has
        none. For MDAnalysis: the path of a topology, or a Universe.
    units : str
        A LAMMPS unit style (lj, real, metal, si, cgs, electron, micro, nano). Needed for LAMMPS files that do not say
        it; sources of ASE and MDAnalysis have their own ("ase", "mdanalysis"). Extended XYZ is in ASE's units unless a
        style is given here, which all its numbers are then in. A contradiction between the argument and the file is an
        error.
    masses
        ``{type or name: mass}`` or a list for types 1, 2, ..., in the trajectory's units; goes before all other masses.
    dimension : 2 or 3
        2: a run in the plane z = const (LAMMPS's ``dimension 2``); fields are per area then, pressures forces per
        length. Not given: what the potential says, else 3.
    atom_style : str
        The ``atom_style`` line of the LAMMPS run, e.g. "full" or "hybrid sphere molecular": what the columns of its
        data file (the source, or the topology) are. Needed where the file does not say it behind ``Atoms`` and the
        number of columns leaves several possibilities.

    cell : three lengths, three edge vectors, or three pairs lo, hi
        The cell of frames whose file has none (plain XYZ), the same for all of them.
    pbc : str or bools
        Which axes repeat, e.g. "ppf", where the file does not say it; with `cell` all do if it is not given.
    timestep : float
        The time of one step, for frames with a step and no time.

    Returns
    -------
    atc.readers.trajectory.Trajectory
        ``len``, iteration, ``[k]`` and slices; frames in internal units.

    Raises
    ------
    AtcError
        Unknown units, contradictions, a file that is damaged or not a trajectory.
    """
    boxed = cell is not None
    if pbc is not None and not boxed:
        from .declared import periodic_of

        boxed = not any(periodic_of(pbc))  # an open cluster, on purpose
    trajectory = _read(source, topology, units, masses, atom_style, boxed)
    if not (cell is None and pbc is None and timestep is None):
        from .declared import Declared

        trajectory = Declared(trajectory, cell, pbc, timestep)
    if dimension is None:
        return trajectory
    from .planar import in_dimension

    return in_dimension(trajectory, dimension)


def _read(source, topology=None, units=None, masses=None, atom_style=None, boxed=False):
    """`boxed`: whether the cell is known from elsewhere."""
    from functools import partial

    from ..frame import Frame

    if atom_style is not None:
        from .lammps.atom_styles import AtomStyle, StyledFile

        AtomStyle(atom_style, "atom_style")
        if isinstance(topology, (str, os.PathLike)) and not isinstance(topology, StyledFile):
            topology = StyledFile(topology, atom_style)
    if isinstance(source, str) and source.startswith("imd://"):
        from .mdanalysis import MDAnalysisTrajectory

        return MDAnalysisTrajectory(source, topology, units, masses)
    if isinstance(source, (str, os.PathLike)):
        from .chain import Chain, matching

        files = matching(source)
        if files is None or len(files) == 1:
            return _path(Path(source) if files is None else files[0], topology, units, masses, atom_style, boxed)
        return Chain(partial(_read, boxed=boxed), files, topology, units, masses, atom_style)
    if isinstance(source, (list, tuple)) and source and all(isinstance(s, (str, os.PathLike)) for s in source):
        from .chain import Chain, matching

        files = [file for s in source for file in matching(s) or [s]]
        return Chain(partial(_read, boxed=boxed), files, topology, units, masses, atom_style)
    from .trajectory import Trajectory

    if isinstance(source, Trajectory):
        if topology is not None:
            raise AtcError("a trajectory that is open already has its topology: give it when reading the file")
        if units is None and masses is None:
            return source
        from .memory import Adapted

        return Adapted(source, units, masses)
    kind = type(source).__module__.split(".")[0]
    if kind == "MDAnalysis" or (hasattr(source, "trajectory") and hasattr(source, "atoms")):
        from .mdanalysis import MDAnalysisTrajectory

        return MDAnalysisTrajectory(source, topology, units, masses)
    items = source if isinstance(source, (list, tuple)) else [source]
    first = items[0] if items else None
    if isinstance(first, Frame):
        from .memory import FrameList

        if topology is not None:
            raise AtcError("frames carry their topology themselves: leave the topology argument out")
        return FrameList(items, units, masses)
    if _is_atoms(first):
        from .ase import AtomsList

        if topology is not None:
            raise AtcError("ase.Atoms have no bonded terms: the topology argument is for LAMMPS and MDAnalysis sources")
        return AtomsList(items, units, masses)
    raise AtcError(
        f"cannot read a trajectory from {type(source).__name__}{' (empty)' if items == [] else ''}: expected a path, "
        "ase.Atoms, an MDAnalysis Universe, a Frame, or a list of Atoms or Frames"
    )


def _is_atoms(x) -> bool:
    return type(x).__module__.split(".")[0] == "ase" or all(
        hasattr(x, a) for a in ("get_positions", "get_cell", "get_pbc", "numbers")
    )


#: Formats of LAMMPS's that a file's first bytes tell, in this order: the module, its function that knows them (by the
#: bytes and the path), its class.
_TOLD = (
    ("dump", "looks_like_dump", "LammpsDump"),
    ("yaml", "looks_like_yaml_dump", "LammpsYamlDump"),
    ("binary", "looks_binary", "LammpsBinaryDump"),
    ("dcd", "written_by_lammps", "LammpsDcd"),
    ("data_trajectory", "looks_like_data", "LammpsDataTrajectory"),
    ("cfg", "looks_like_lammps_cfg", "LammpsCfg"),
    ("netcdf", "netcdf_by_lammps", "LammpsNetcdf"),
)

#: Readers of one's own, by the suffix of their files.
OPENERS: dict[str, Callable] = {}


def register(suffix: str, opener: Callable) -> None:
    """Have files whose names end in `suffix` (".mine") opened by ``opener(path, topology, units, masses)``, a
    `Trajectory`."""
    if not suffix.startswith("."):
        raise AtcError(f"suffix {suffix!r}: expected the end of a file's name, such as '.mine'")
    OPENERS[suffix.lower()] = opener


def _path(path: Path, topology, units, masses, atom_style=None, boxed=False):
    from ._bytes import head_of, require_file
    from .sniff import by_its_name, is_text, not_a_trajectory, shown

    if path.suffix.lower() in OPENERS:
        require_file(path)
        return OPENERS[path.suffix.lower()](path, topology, units, masses)
    if path.suffix == ".zarr" and path.is_dir():
        raise AtcError(
            f"{path} is an output of atc or another Zarr store, not a trajectory: atc info, atc plot and atc compare "
            "read outputs"
        )
    head = head_of(path)
    if not head.strip():
        raise AtcError(
            f"{path} is empty"
            if not path.stat().st_size
            else f"{path} holds nothing but blanks, or nothing that can be decompressed yet"
        )
    what = not_a_trajectory(head) or (_hdf5(path) if head.startswith(b"\x89HDF\r\n") else None)
    if what is not None:
        raise AtcError(f"{path} is {what}")
    for name, knows, reader in _TOLD:
        module = import_module(f".lammps.{name}", __package__)
        if getattr(module, knows)(head, path):
            more = [atom_style] if name == "data_trajectory" else []
            return getattr(module, reader)(path, topology, units, masses, *more)
    suffixes = [s.lower() for s in path.suffixes]
    last = next((s for s in reversed(suffixes) if s not in (".gz", ".bz2", ".xz", ".zst")), "")
    if any(s in _LAMMPS_NAMES for s in suffixes) or ".bin" in suffixes[-2:]:
        raise AtcError(
            f"{path}: not a LAMMPS dump: a text dump starts with 'ITEM:', a binary one with its magic string, this "
            f"with {shown(head)}"
        )
    if last in _TOPOLOGIES:
        raise AtcError(f"{path} holds a topology but no positions: give the trajectory's path, and this as topology=")
    if last in _MDANALYSIS:
        from .mdanalysis import MDAnalysisTrajectory

        return MDAnalysisTrajectory(path, topology, units, masses)
    from .xyz import ExtendedXyz, looks_like_xyz

    if is_text(head) and looks_like_xyz(head, last):
        return ExtendedXyz(path, topology, units, masses, boxed)
    what = by_its_name(path.name) if is_text(head) else None
    if what is not None:
        raise AtcError(f"{path} is {what}")
    if topology is not None:
        raise AtcError(
            f"{path}: a topology goes with LAMMPS dumps and the formats of MDAnalysis "
            f"({' '.join(sorted(_MDANALYSIS))}); this is read by ASE"
        )
    from .ase import open_ase

    return open_ase(path, units, masses)


def _hdf5(path: Path) -> str | None:
    """What an HDF5 file is, if it is none that MDAnalysis reads by its name."""
    import h5py

    from ..running.sealed import require_sound

    try:
        require_sound(path)
        with h5py.File(path, "r") as f:
            attrs = {str(name): str(f.attrs.get(name)) for name in list(f.attrs)[:64]}
            groups = set(f)
    except Exception:  # whatever HDF5 stumbles over
        return "an HDF5 file that is damaged or cut off"
    if "atc_version" in attrs:
        return "an output of atc, not a trajectory: atc info, atc plot and atc compare read it"
    if attrs.get("Conventions") == "AMBER":
        return "a NetCDF-4 trajectory, of which only the classic versions are read: convert it (nccopy -k cdf5 OLD NEW)"
    if "h5md" in groups:
        return None if path.suffix.lower() == ".h5md" else "an H5MD trajectory by another name: call it .h5md"
    return "an HDF5 or NetCDF-4 file of no trajectory that atc knows; give a dump, H5MD (.h5md), .extxyz, .traj, ..."
