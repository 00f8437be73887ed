"""MDAnalysis: a Universe or AtomGroup, or the formats it reads (TRR, XTC, DCD, NetCDF, H5MD, TNG, GRO, PDB, ...)."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace

import numpy as np

from ..errors import AtcError, located
from ..frame import Cell, Frame, Topology
from ..units import units as unit_system
from .masses import Masses, check_units
from .trajectory import Trajectory, warn

# Readers of formats whose files do not say their units: MDAnalysis takes them as they are.
_UNITLESS = {"LAMMPSDUMP": "a LAMMPS dump", "DATA": "a LAMMPS data file", "LAMMPS": "a LAMMPS dcd"}
_TERMS = (("bonds", 2), ("angles", 3), ("dihedrals", 4), ("impropers", 4))


class MDAnalysisTrajectory(Trajectory):
    """Frames through MDAnalysis, in its units: Å, ps, kJ/mol, kJ/(mol Å), amu.

    Parameters
    ----------
    source : Universe, AtomGroup, or the path of a trajectory, or ``imd://host:port`` of a simulation that streams.
    topology : path of a topology, or a Universe, for a trajectory given as a path.
    units : only ``"mdanalysis"``; of streams the style that their numbers are in. IMDv3 asks for Å, ps and kJ/mol, and
        MDAnalysis takes them for that; LAMMPS's ``fix imd`` sends its own: ``units="real"`` or what it runs in.
    masses : as for `atc.read`. Without it the Universe's, if it knows all of them.

    Notes
    -----
    Coordinates, boxes and velocities of MDAnalysis are float32. A box makes all axes periodic; no box is an open cell.
    Formats without velocities or forces leave them None. LAMMPS's own files are refused: MDAnalysis does not know their
    units, atc's readers do. Types are the Universe's: numbers if they are numbers, otherwise counted from 1 in order of
    first appearance; `type_names` has the names.
    """

    def __init__(self, source, topology=None, units=None, masses=None):
        super().__init__()
        self.units = unit_system("mdanalysis")
        path = isinstance(source, (str, os.PathLike))
        self.source = os.fspath(source) if path else "MDAnalysis Universe"
        streamed = path and self.source.startswith("imd://")
        if not streamed and not (not path and is_stream(getattr(source.universe, "trajectory", None))):
            self._require_own_units(units)
        elif units is not None:
            self.units = unit_system(units)
        if streamed:
            source = _connected(self.source, topology, units)
        elif path:
            source = _universe(self.source, topology)
        elif topology is not None:
            raise AtcError("a Universe has its topology already: leave the topology argument out")
        self._atoms = source.atoms
        if not len(self._atoms):
            raise AtcError(f"{self.source}: holds no atoms")
        if not path and not hasattr(self._atoms.universe, "trajectory"):
            raise AtcError("the Universe has no trajectory: load coordinates first")
        u = self._atoms.universe
        reader = u.trajectory
        names = {str(f).upper() for f in ([reader.format] if isinstance(reader.format, str) else reader.format)}
        if hasattr(reader, "readers"):  # several files one after the other
            names |= {str(r.format).upper() for r in reader.readers if isinstance(r.format, str)}
        for name in names & set(_UNITLESS):
            raise AtcError(
                f"{self.source}: it reads {_UNITLESS[name]}, whose units MDAnalysis does not know; give atc.read the "
                "path of a LAMMPS dump and units= instead"
            )
        for file in [reader.filename] if not hasattr(reader, "readers") else [r.filename for r in reader.readers]:
            _not_of_lammps(file, path)
        if getattr(reader, "convert_units", True) is False and any(getattr(reader, "units", {}).values()):
            raise AtcError(
                f"{self.source}: the Universe was made with convert_units=False; atc needs MDAnalysis's own units: "
                "make it without"
            )
        if not path and getattr(reader, "filename", None):
            self.source = str(reader.filename)
        self._length, self._cut = None, False
        self._masses = None if masses is None else Masses(masses, self.units)
        self._own_masses = self._universe_masses()
        self._types, self._type_names = self._universe_types()
        self._topology = self._universe_topology()

    def _require_own_units(self, units) -> None:
        if units is not None and unit_system(units).reduced:
            raise AtcError(
                f"{self.source}: this format is in nm or Å, and a run in lj units has none: dump it as custom or dcd, "
                "whose units are those of the run"
            )
        check_units(units, self.units, f"{self.source}: MDAnalysis's units are Å, ps, kJ/mol ('mdanalysis'),")

    # What does not change from frame to frame
    # --------------------------------------------------------------------------------------------

    def _universe_masses(self):
        if self._masses is not None or not hasattr(self._atoms, "masses"):
            return None
        m = np.asarray(self._atoms.masses, float)
        declared = any(
            a.attrname == "masses" and not getattr(a, "is_guessed", False) for a in self._atoms.universe._topology.attrs
        )
        # Virtual sites have no mass, and their file says so.
        if (m > 0).all() or (declared and (m >= 0).all() and (m > 0).any()):
            return m * self.units.mass
        if (m > 0).any():
            bad = int(np.flatnonzero(~(m > 0))[0])
            warn(
                f"{self.source}: atom {bad + 1} and {int((~(m > 0)).sum()) - 1} others have no mass in MDAnalysis; no "
                f"masses are used, give masses={{type: mass}}"
            )
        return None

    def _universe_types(self):
        if not hasattr(self._atoms, "types"):
            return np.ones(len(self._atoms), np.int64), {}
        names = [str(t) for t in self._atoms.types]
        unique = list(dict.fromkeys(names))
        if all(t.isdigit() and int(t) > 0 for t in unique):
            return np.array([int(t) for t in names], np.int64), {}
        number = {t: k for k, t in enumerate(unique, 1)}
        return np.array([number[t] for t in names], np.int64), {k: t for t, k in number.items()}

    def _universe_topology(self):
        place = {int(ix): k for k, ix in enumerate(self._atoms.ix)}
        out = {}
        for name, width in _TERMS:
            group = getattr(self._atoms.universe, name, None)
            if group is None or not len(group):
                continue
            rows = [[place.get(int(a)) for a in row] for row in group.indices]
            inside = [k for k, row in enumerate(rows) if None not in row]
            cut = sum(1 for row in rows if None in row and any(a is not None for a in row))
            if cut:
                raise AtcError(f"{self.source}: {cut} {name} lead out of the chosen atoms; choose whole molecules")
            kinds = getattr(group, "_bondtypes", None)
            kinds = [None] * len(rows) if kinds is None else kinds
            numbers = {}
            own = [str(kinds[k]) for k in inside]
            types = [int(t) if t.isdigit() else numbers.setdefault(t, len(numbers) + 1) for t in own]
            out[name] = np.array([rows[k] for k in inside], np.int64).reshape(-1, width)
            out[f"{name[:-1]}_types"] = np.array(types, np.int64)
        held = self._universe_constraints(place)
        return Topology(**out, held=held) if out or (held is not None and held.unknown) else None

    def _universe_constraints(self, place):
        """The constraints of a GROMACS run input, whose kind the Universe has lost; None of other topologies."""
        file = self._atoms.universe.filename
        if not isinstance(file, (str, os.PathLike)) or not os.fspath(file).lower().endswith(".tpr"):
            return None
        from .gromacs_tpr import constraints_of

        held = constraints_of(os.fspath(file), len(self._atoms.universe.atoms))
        if len(place) == len(self._atoms.universe.atoms) and all(k == ix for ix, k in place.items()):
            return held
        # Bonds, which constraints are to MDAnalysis, lead out of no choice of atoms.
        rows = [[place[i], place[j]] for i, j in held.pairs_c2.tolist() if i in place and j in place]
        return replace(held, pairs_c2=np.array(rows, np.int64).reshape(-1, 2))

    @property
    def type_names(self):
        return dict(self._type_names)

    # Frames
    # ------------------------------------------------------------------------------------------------------------------

    @property
    def streamed(self) -> bool:
        """Whether its frames come from a running simulation, once, without an end that is known."""
        return is_stream(self._atoms.universe.trajectory)

    def __iter__(self):
        if not self.streamed:
            yield from super().__iter__()
            return
        for _ in self._atoms.universe.trajectory:
            yield self.current()

    def __getitem__(self, key):
        self._require_numbered("whose frames come once, one after the other")
        return super().__getitem__(key)

    def _require_numbered(self, why: str) -> None:
        if self.streamed:
            raise AtcError(f"{self.source}: is a stream, {why}: iterate over it, or give it to atc.fields or atc.Live")

    def __len__(self):
        self._require_numbered("which has no length")
        if self._length is None:
            with self._guard, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                n = len(self._atoms.universe.trajectory)
                # A file still being written ends within a frame: headers are counted, numbers are not.
                try:
                    if n > 1:
                        self._atoms.universe.trajectory[n - 1]
                except Exception:
                    n -= 1
                    self._cut = True
                self._length = n
                self._cut |= self._rest_of_dcd()
            if self._cut:
                warn(f"{self.source}: its last frame (number {n}) is not complete and is left out")
        return self._length

    def _rest_of_dcd(self) -> bool:
        """Whether a DCD goes on behind its last whole frame: MDAnalysis says nothing of it."""
        from .lammps.dcd import rest_behind_frames

        reader = self._atoms.universe.trajectory
        name = getattr(reader, "filename", None)
        return reader.format == "DCD" and isinstance(name, (str, os.PathLike)) and rest_behind_frames(name)

    def _frame(self, k):
        where = f"{self.source} frame {k}"
        with self._guard:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    self._atoms.universe.trajectory[k]
            except Exception:
                raise AtcError(
                    f"{where}: MDAnalysis cannot read it: the file is damaged or cut off there, or has changed since "
                    "it was opened"
                ) from None
            return self.current(where)

    def current(self, where: str | None = None) -> Frame:
        """The frame that the Universe is at."""
        u, atoms = self.units, self._atoms
        with self._guard:
            ts = atoms.universe.trajectory.ts
            where = where or f"{self.source} frame {ts.frame}"
            x = np.array(atoms.positions, dtype=np.float64)
            v = np.array(atoms.velocities, dtype=np.float64) * u.velocity if ts.has_velocities else None
            f = np.array(atoms.forces, dtype=np.float64) * u.factor("force") if ts.has_forces else None
            box = None if ts.dimensions is None else np.array(ts.dimensions, dtype=np.float64)
            time = None if "time" not in ts.data and "dt" not in ts.data else float(ts.time)
            step = ts.data.get("step")
        cell = self._cell(box, x, where)
        masses = self._masses(self._types, self._type_names, where) if self._masses is not None else self._own_masses
        charges = np.asarray(atoms.charges, float) * u.charge if hasattr(atoms, "charges") else None
        return Frame(
            positions=x * u.length,
            cell=cell,
            units=u,
            types=self._types,
            masses=masses,
            velocities=v,
            forces=f,
            charges=charges,
            step=None if step is None else int(step),
            time=None if time is None else time * u.time,
            topology=self._topology,
            source=where,
            type_names=self.type_names,
            given={"boundary": "assumed"},
        )

    def _cell(self, box, x, where) -> Cell:
        if box is None or not box[:3].any():
            return Cell(np.zeros((3, 3)), periodic=(False, False, False))
        from MDAnalysis.lib.mdamath import triclinic_vectors

        if not np.isfinite(box).all():
            raise AtcError(f"{where}: the box {box.tolist()} holds numbers that are not finite")
        if not (box[:3] > 0).all():
            if (box[3:] != 90.0).any() or (box[:3] < 0).any():
                raise AtcError(f"{where}: the box {box.tolist()} is none")
            return Cell(np.diag(box[:3]) * self.units.length, periodic=box[:3] > 0)
        vectors = triclinic_vectors(box, dtype=np.float64)
        if not vectors.any():
            raise AtcError(f"{where}: lengths and angles {box.tolist()} make no box")
        with located(where):
            return Cell(vectors * self.units.length)


def is_stream(reader) -> bool:
    """Whether a reader of MDAnalysis gives the frames of a running simulation (IMDv3)."""
    return any(c.__name__ == "StreamReaderBase" for c in type(reader).__mro__)


def _not_of_lammps(file, by_path: bool) -> None:
    """A DCD of LAMMPS in a Universe has its lengths and times in the units of the run, which MDAnalysis takes for Å and
    CHARMM's."""
    from .lammps.dcd import written_by_lammps

    if not isinstance(file, (str, os.PathLike)) or by_path:
        return
    try:
        with open(file, "rb") as f:
            head = f.read(4096)
    except (OSError, ValueError):
        return
    if written_by_lammps(head):
        raise AtcError(
            f"{os.fspath(file)}: a DCD that LAMMPS wrote, whose units MDAnalysis does not know; give atc.read its "
            "path, units= and, as topology=, the run's data file"
        )


def _connected(address, topology, units):
    """The Universe of a simulation that streams its frames (IMDv3). A data file of LAMMPS is read by atc's own reader,
    which knows all atom styles."""
    try:
        import imdclient  # noqa: F401
        import MDAnalysis  # noqa: F401
    except ImportError as e:
        raise AtcError(f"{address}: streams need the package {e.name}: pip install MDAnalysis imdclient") from None
    if topology is None:
        raise AtcError(f"{address}: a stream does not say what its atoms are: give topology=")
    if not hasattr(topology, "atoms"):
        topology = _universe_of_data(topology, units) or _universe(os.fspath(topology), None)
    try:
        topology.load_new(address)
    except Exception:
        raise AtcError(
            f"{address}: no simulation of {len(topology.atoms)} atoms answers there by IMDv3: start it first, and have "
            "it wait (LAMMPS: fix imd ... version 3 ... nowait off; GROMACS: mdrun -imdwait)"
        ) from None
    return topology


def _universe_of_data(path, units):
    """A Universe without coordinates from a LAMMPS data file; None for other files."""
    from MDAnalysis import Universe
    from MDAnalysis.core import topologyattrs

    from ._bytes import head_of
    from .lammps.data_trajectory import LammpsDataTrajectory, looks_like_data

    if not looks_like_data(head_of(path)):
        return None
    # Without units it is Å and amu that count, which those of "real" are.
    frame = LammpsDataTrajectory(path, None, units or "real", None, getattr(path, "atom_style", None))[0]
    universe = Universe.empty(len(frame), trajectory=False)
    universe.add_TopologyAttr("types", [str(t) for t in frame.types])
    if frame.masses is not None:
        universe.add_TopologyAttr("masses", frame.units.to_user("mass", frame.masses))
    if frame.charges is not None:
        universe.add_TopologyAttr("charges", frame.units.to_user("charge", frame.charges))
    for name, _ in _TERMS if frame.topology else ():
        terms, types = getattr(frame.topology, name), getattr(frame.topology, f"{name[:-1]}_types")
        if len(terms):
            attr = getattr(topologyattrs, name.capitalize())
            universe.add_TopologyAttr(attr([tuple(t) for t in terms.tolist()], types=[str(t) for t in types]))
    return universe


def _universe(path, topology):
    try:
        import MDAnalysis
    except ImportError:
        raise AtcError(f"{path}: reading it needs MDAnalysis: pip install MDAnalysis") from None
    with warnings.catch_warnings():
        # MDAnalysis warns of every attribute it cannot guess; what matters here is said by `require`.
        warnings.simplefilter("ignore")
        try:
            if topology is None:
                return MDAnalysis.Universe(path)
            if hasattr(topology, "trajectory"):
                universe = topology.copy()
                universe.load_new(path)
                return universe
            return MDAnalysis.Universe(os.fspath(topology), path)
        except ImportError as e:
            need = f" ({e.name})" if getattr(e, "name", None) else ""
            raise AtcError(f"{path}: MDAnalysis needs another package to read it{need}: install it") from None
        except Exception:
            raise AtcError(f"{path}: MDAnalysis cannot open it{_why(MDAnalysis, path, topology)}") from None


def _why(MDAnalysis, path, topology) -> str:
    """What can be said of a file or a pair of files that make no Universe: the exceptions of its hundred readers are
    for their developers."""

    def count(of):
        try:
            return of()
        except Exception:
            return None

    from MDAnalysis.coordinates.core import get_reader_for

    here = count(lambda: get_reader_for(path).parse_n_atoms(path))
    if topology is None:
        unnumbered = str(path).lower().endswith((".mdcrd", ".trj", ".crdbox", ".trz"))
        why = "its format does not say how many atoms there are: give topology="
        return f": {why}" if unnumbered else ": it is damaged, cut off, or not what its name says"
    if hasattr(topology, "atoms"):
        name, other = "the topology", len(topology.atoms)
    else:
        name = os.fspath(topology)
        if not os.path.exists(name):
            return f": there is no topology {name}"
        other = count(lambda: len(MDAnalysis.Universe(name).atoms))
    if here is not None and other is not None and here != other:
        return f": it holds {here} atoms, {name} {other}"
    if other is None:
        return f": the topology {name} cannot be read: damaged, or not what its name says"
    return f" with {name}: it is damaged, cut off, not what its name says, or of other atoms"
