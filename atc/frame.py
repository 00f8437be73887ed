"""One snapshot of particles: `Cell`, `Topology` and `Frame`, all float64 and in internal units (see `atc.units`)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .errors import AtcError
from .units import Units


class Cell:
    """The simulation box: three edge vectors (rows), an origin, and which of the axes repeat.

    Any non-degenerate vectors are allowed: rotated, tilted beyond LAMMPS's limits, left-handed.

    Parameters
    ----------
    vectors : (3, 3) array
        Rows are the edge vectors a, b, c. A zero row is allowed on an open axis; `completed` gives it an extent.
    origin : (3,) array
        The corner at fractional coordinates (0, 0, 0).
    periodic : (3,) bools
    """

    def __init__(self, vectors, origin=(0.0, 0.0, 0.0), periodic=(True, True, True)):
        v = np.array(vectors, dtype=np.float64)
        if v.shape == (3,):
            v = np.diag(v)
        if v.shape != (3, 3):
            raise AtcError(f"a cell needs three lengths or three edge vectors, got an array of shape {v.shape}")
        self.vectors = v
        self.origin = np.array(origin, dtype=np.float64)
        self.periodic = np.array(np.broadcast_to(periodic, (3,)), dtype=bool)
        if not (np.isfinite(v).all() and np.isfinite(self.origin).all()):
            raise AtcError("the cell holds numbers that are not finite")
        lengths = np.linalg.norm(v, axis=1)
        if (self.periodic & (lengths == 0)).any():
            raise AtcError(
                "a periodic axis of the cell has zero length: give the cell vectors, or declare the axis open"
            )
        if (lengths > 0).all() and abs(np.linalg.det(v)) <= 1e-14 * lengths.prod():
            raise AtcError("the cell has zero volume: its edge vectors are linearly dependent")
        for a in (self.vectors, self.origin, self.periodic):
            a.setflags(write=False)

    @classmethod
    def from_lammps(cls, lo, hi, tilt=(0.0, 0.0, 0.0), periodic=(True, True, True)) -> Cell:
        """From LAMMPS's *true* box bounds (xlo.. as in a data file, not a dump's bounding box) and tilts (xy, xz,
        yz)."""
        lo = np.asarray(lo, float)
        lx, ly, lz = np.asarray(hi, float) - lo
        xy, xz, yz = tilt
        return cls([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]], lo, periodic)

    @cached_property
    def complete(self) -> bool:
        """Whether all three edge vectors have a length."""
        return bool((np.linalg.norm(self.vectors, axis=1) > 0).all())

    def completed(self, positions, margin: float = 0.0) -> Cell:
        """This cell with its zero rows replaced by directions normal to the others, as long as the atoms' extent plus
        `margin`."""
        if self.complete:
            return self
        v = self.vectors.copy()
        have = [k for k in range(3) if np.linalg.norm(v[k]) > 0]
        basis = [v[k] / np.linalg.norm(v[k]) for k in have]
        origin = self.origin.copy()
        x = np.asarray(positions)
        for k in range(3):
            if k in have:
                continue
            candidates = np.eye(3)[[k, (k + 1) % 3, (k + 2) % 3]]
            for e in candidates:
                for q in basis:
                    e = e - (e @ q) / (q @ q) * q
                # Two non-orthogonal rows: project on their normal instead.
                if len(basis) == 2:
                    n = np.cross(basis[0], basis[1])
                    e = n * np.sign(n @ np.eye(3)[k] or 1.0)
                if np.linalg.norm(e) > 1e-8:
                    e = e / np.linalg.norm(e)
                    break
            s = x @ e if len(x) else np.zeros(1)
            length = s.max() - s.min() + 2 * margin
            v[k] = e * (length if length > 0 else 1.0)
            origin = origin + e * (s.min() - margin - origin @ e)
            basis.append(e)
        return Cell(v, origin, self.periodic)

    @cached_property
    def volume(self) -> float:
        return float(abs(np.linalg.det(self.vectors)))

    @cached_property
    def inverse(self) -> np.ndarray:
        """Matrix M with fractional = (x − origin) @ M."""
        return np.linalg.inv(self.vectors)

    @cached_property
    def heights(self) -> np.ndarray:
        """(3,) distances between opposite faces: the thickness of the cell along each axis."""
        return 1.0 / np.linalg.norm(self.inverse, axis=0)

    @cached_property
    def orthogonal(self) -> bool:
        """Whether the edge vectors lie along x, y, z."""
        return bool(np.count_nonzero(self.vectors - np.diag(np.diag(self.vectors))) == 0)

    def fractional(self, x) -> np.ndarray:
        return (np.asarray(x) - self.origin) @ self.inverse

    def cartesian(self, s) -> np.ndarray:
        return np.asarray(s) @ self.vectors + self.origin

    def wrap(self, x):
        """Positions moved into the cell along its periodic axes, and the (n, 3) integers n with x = wrapped + n @
        vectors."""
        s = self.fractional(x)
        n = np.where(self.periodic, np.floor(s), 0.0)
        return np.asarray(x) - n @ self.vectors, n.astype(np.int64)

    def scaled(self, factor: float) -> Cell:
        return self if factor == 1.0 else Cell(self.vectors * factor, self.origin * factor, self.periodic)

    def __eq__(self, other):
        return isinstance(other, Cell) and all(
            np.array_equal(a, b)
            for a, b in ((self.vectors, other.vectors), (self.origin, other.origin), (self.periodic, other.periodic))
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self):
        p = "".join("p" if b else "f" for b in self.periodic)
        return f"Cell({self.vectors.tolist()}, origin={self.origin.tolist()}, periodic={p!r})"


@dataclass(frozen=True, eq=False)
class Held:
    """Distances that a run holds, as the file of its topology says (GROMACS's .tpr).

    pairs_c2 : (c, 2) atoms by index. source : the file. unknown : why they are not known, in one line, else ""
    """

    pairs_c2: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    source: str = ""
    unknown: str = ""


@dataclass(repr=False)
class Topology:
    """Bonded terms by atom *index* into the frame they belong to. Types are LAMMPS's, from 1.

    ``bonds`` (m, 2), ``angles`` (m, 3; the middle atom is the apex), ``dihedrals`` (m, 4), ``impropers`` (m, 4), each
    with ``*_types`` (m,).
    ``weighted``: the terms that say which atoms are one, two, three bonds apart, where they are not these (LAMMPS's
    ``delete_bonds`` switches bonds off and leaves the weights of pairs as they were), or None.
    """

    bonds: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    bond_types: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    angle_types: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    dihedrals: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.int64))
    dihedral_types: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    impropers: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.int64))
    improper_types: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    weighted: Topology | None = None
    held: Held | None = None  # what its file says of constraints; None: nothing
    untold: str = ""  # why it is not known which atoms are bonded: an error where that is needed
    #: of a tile, who is one, two, three bonds apart in the whole frame (see `estimators.tile_cuts`); no field: what is
    #: made of the lists above does not have it
    special = None

    def __bool__(self):
        return any(len(a) for a in (self.bonds, self.angles, self.dihedrals, self.impropers)) or bool(self.weighted)

    def __repr__(self):
        kinds = ("bonds", "angles", "dihedrals", "impropers")
        return f"Topology({', '.join(f'{len(getattr(self, k))} {k}' for k in kinds)})"


@dataclass
class Frame:
    """One snapshot, in internal units, atoms sorted by id.

    Attributes
    ----------
    positions : (n, 3) float64. As the source gives them; not necessarily inside the cell.
    cell : Cell
    types : (n,) int, from 1 (LAMMPS's types; for ASE and MDAnalysis the species in order of first appearance or atomic
        number, see `type_names`)
    ids : (n,) int, ascending
    masses : (n,) or None. velocities, forces : (n, 3) or None. charges : (n,) or None.
    images : (n, 3) int or None: how often each atom left the cell through each face; unwrapped = wrapped position +
        images @ cell vectors.
        Only set when `positions` are wrapped ones.
    step : int or None. time : float or None (internal time units).
    topology : Topology or None
    units : the user's unit system, in which results are reported
    source : what to call this frame in messages, e.g. ``"run.dump frame 3"``
    type_names : {type: name} where the source knows names
    extra : {column: (n,) or (n, k) array} per-atom columns that atc does not interpret, as read (not converted)
    molecules : (n,) int or None, LAMMPS's molecule numbers
    groups : (n,) int or None, bits that say in which groups of a LAMMPS script an atom is (those that leave out pairs)
    given : {attribute: file} for "types", "charges", "masses", "topology" that are not the source's own but from a data
        file beside it; "assumed" for
        types and "boundary" that nothing says, "order" for "ids" that are places in the file; "none" for a "cell" that
        there is none of, "declared" for what the user said
    before : Frame or None, the one of the trajectory before this, where what happens in between is asked for
    """

    positions: np.ndarray
    cell: Cell
    units: Units
    types: np.ndarray | None = None
    ids: np.ndarray | None = None
    masses: np.ndarray | None = None
    velocities: np.ndarray | None = None
    forces: np.ndarray | None = None
    charges: np.ndarray | None = None
    images: np.ndarray | None = None
    step: int | None = None
    time: float | None = None
    topology: Topology | None = None
    source: str = "frame"
    type_names: dict = field(default_factory=dict)
    extra: dict = field(default_factory=dict)
    molecules: np.ndarray | None = None
    groups: np.ndarray | None = None
    given: dict = field(default_factory=dict)
    before: Frame | None = None

    def __post_init__(self):
        self.positions = np.ascontiguousarray(self.positions, dtype=np.float64)
        if self.positions.ndim != 2 or self.positions.shape[1] != 3:
            raise AtcError(f"{self.source}: positions must have shape (n, 3), got {self.positions.shape}")
        n = len(self.positions)
        self.types = np.ones(n, np.int64) if self.types is None else np.ascontiguousarray(self.types, dtype=np.int64)
        if self.ids is None:
            self.ids, self.given = np.arange(1, n + 1), {**self.given, "ids": "order"}
        self.ids = np.ascontiguousarray(self.ids, dtype=np.int64)
        for name, width in (("masses", None), ("charges", None), ("velocities", 3), ("forces", 3)):
            a = getattr(self, name)
            if a is None:
                continue
            a = np.ascontiguousarray(a, dtype=np.float64)
            want = (n,) if width is None else (n, width)
            if a.shape != want:
                raise AtcError(f"{self.source}: {name} must have shape {want}, got {a.shape}")
            setattr(self, name, a)
        for name in ("positions", "velocities", "forces", "masses", "charges"):
            a = getattr(self, name)
            if a is not None and not np.isfinite(a).all():
                bad = int(np.flatnonzero(~np.isfinite(a.reshape(n, -1)).all(axis=1))[0])
                raise AtcError(
                    f"{self.source}: atom {self.ids[bad]} has {name} that are not finite numbers; the run that wrote "
                    "it has probably blown up"
                )
        if not self.cell.complete:
            if not self.cell.vectors.any():
                self.given = {**self.given, "cell": "none"}
            self.cell = self.cell.completed(self.positions)

    def __len__(self):
        return len(self.positions)

    def _repr_html_(self):
        """For notebooks."""
        from .terminal import html_table

        u = self.units
        lengths = " x ".join(f"{u.to_user('length', v):.6g}" for v in np.linalg.norm(self.cell.vectors, axis=1))
        names = ("velocities", "forces", "masses", "charges", "molecules", "topology")
        rows = [
            ("atoms", len(self)),
            ("units", u.name),
            ("cell", f"{lengths} {u.label('length')}, {''.join('p' if p else 'f' for p in self.cell.periodic)}"),
            ("holds", ", ".join(["positions", *(n for n in names if getattr(self, n) is not None), *self.extra])),
        ]
        if self.step is not None:
            rows.append(("step", self.step))
        if self.time is not None:
            rows.append(("time", f"{u.to_user('time', self.time):g} {u.label('time')}"))
        return html_table(f"Frame {self.source}", rows)

    @property
    def dimension(self) -> int:
        """3, or 2 for a frame of a two-dimensional run (see `atc.planar`)."""
        return self.units.dimension

    @property
    def held(self) -> Held | None:
        """What the file of its topology says of constraints; None: nothing."""
        return None if self.topology is None else self.topology.held

    def replace(self, **changes) -> Frame:
        """A copy with some attributes changed (the arrays not named are shared)."""
        return replace(self, **changes)

    def require(self, *names: str, why: str) -> None:
        """Raise unless the named attributes are there: ``frame.require("masses", "velocities", why="temperature")``."""
        hints = {
            "velocities": "dump vx vy vz too, or ask only for quantities without velocities",
            "masses": "give a LAMMPS data file as topology, or masses",
            "charges": "dump q too, or give a data file with charges as topology",
        }
        for name in names:
            if getattr(self, name) is None:
                needs = "need" if "," in why else "needs"
                raise AtcError(
                    f"{self.source}: {name} are missing but {why} {needs} them: "
                    f"{hints.get(name, 'add them to the trajectory')}"
                )
