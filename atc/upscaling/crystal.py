"""Perfect crystals: unit cells, their strained and repeated copies, and zero-pressure lattice constants by Newton's
method.

Everything is in internal units (`atc.units`). A *model* of the interactions is a potential of `atc.potential` or any
ASE calculator.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from ..errors import AtcError
from ..frame import Cell, Frame
from ..pd.voigt import to_voigt, unit_strain
from ..units import Units, units
from ..units import units as get

#: Conventional cubic cells: fractional positions of the basis and primitive vectors in units of the lattice constant.
STRUCTURES = {
    "sc": ([[0, 0, 0]], np.eye(3)),
    "bcc": ([[0, 0, 0]], [[-0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, -0.5]]),
    "fcc": ([[0, 0, 0]], [[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]]),
    "diamond": ([[0, 0, 0], [0.25, 0.25, 0.25]], [[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]]),
}

#: Crystals of runs in the plane: the same, with one unit of length along z, which does not repeat.
PLANAR_STRUCTURES = {"hexagonal": ([[0, 0, 0]], [[1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0], [0.0, 0.0, 1.0]])}

#: Weights of the central difference of sixth order, (f(h) − f(−h)) w1 + ...
STENCIL = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))


@dataclass
class Crystal:
    """A perfect crystal in internal units.

    Attributes
    ----------
    vectors : (3, 3) rows: the primitive vectors
    positions : (n, 3) of the atoms of the cell
    masses : (n,)
    types : (n,) from 1
    units : the user's unit system
    conventional : (3, 3) rows: the cell that directions such as [1, 1, 0] refer to; default: `vectors`
    name : what to call it in messages
    type_names : {type: chemical symbol}, for ASE calculators
    """

    vectors: np.ndarray
    positions: np.ndarray
    masses: np.ndarray
    units: Units
    types: np.ndarray | None = None
    conventional: np.ndarray | None = None
    name: str = "crystal"
    type_names: dict = field(default_factory=dict)

    def __post_init__(self):
        self.vectors = np.array(self.vectors, float)
        self.positions = np.array(self.positions, float).reshape(-1, 3)
        self.masses = np.broadcast_to(np.array(self.masses, float), (len(self.positions),)).copy()
        self.types = np.ones(len(self.positions), np.int64) if self.types is None else np.array(self.types, np.int64)
        self.conventional = self.vectors.copy() if self.conventional is None else np.array(self.conventional, float)
        self.units = units(self.units)
        if not (np.isfinite(self.masses).all() and (self.masses > 0).all()):
            raise AtcError(f"{self.name}: every atom of a crystal needs a positive mass")
        Cell(self.vectors)  # says what is wrong with degenerate vectors

    @classmethod
    def cubic(
        cls, structure: str, lattice_constant: float, masses, units: str | Units, *, types=None, symbols=None
    ) -> Crystal:
        """One of the `STRUCTURES` sc, bcc, fcc, diamond, cube edges along x, y, z.

        Parameters
        ----------
        lattice_constant, masses : in the units `units`; one mass, or one for each atom of the basis (diamond has two:
            zincblende)
        types : one for each atom of the basis; default: 1, or 1, 2 where the masses differ
        symbols : chemical symbols of the basis; only ASE calculators need them
        """
        u = get(units)
        if structure not in STRUCTURES:
            raise AtcError(f"structure {structure!r}: expected one of {', '.join(STRUCTURES)}")
        a = _length(lattice_constant, u)
        basis, vectors = (np.array(v, float) for v in STRUCTURES[structure])
        masses = u.to_internal("mass", np.atleast_1d(np.array(masses, float)))
        if len(masses) not in (1, len(basis)):
            raise AtcError(f"{structure}: expected 1 mass or {len(basis)}, got {len(masses)}")
        masses = np.broadcast_to(masses, (len(basis),))
        if types is None:
            two = len(basis) == 2 and masses[0] != masses[1]
            types = np.arange(1, 3) if two else np.ones(len(basis), int)
        names = {}
        if symbols is not None:
            symbols = [symbols] * len(basis) if isinstance(symbols, str) else list(symbols)
            names = dict(zip(np.asarray(types).tolist(), symbols))
        return cls(vectors * a, basis * a, masses, u, types, np.eye(3) * a, structure, names)

    @classmethod
    def planar(cls, structure: str, lattice_constant: float, mass: float, units: str | Units) -> Crystal:
        """One of the `PLANAR_STRUCTURES`: "hexagonal", the triangular lattice, with close-packed rows along x; the unit
        system becomes that of a run in the plane.

        Parameters
        ----------
        lattice_constant, mass : in the units `units`
        """
        u = get(units).planar
        if structure not in PLANAR_STRUCTURES:
            known = ", ".join(PLANAR_STRUCTURES)
            raise AtcError(f"structure {structure!r}: a run in the plane has one of {known}, none of three dimensions")
        a = _length(lattice_constant, u)
        basis, vectors = (np.array(v, float) * [a, a, 1.0] for v in PLANAR_STRUCTURES[structure])
        return cls(vectors, basis, u.to_internal("mass", mass), u, name=structure)

    @classmethod
    def from_frame(cls, frame: Frame, conventional=None, name: str | None = None) -> Crystal:
        """The whole frame as one unit cell; it must be periodic and have masses."""
        if not frame.cell.periodic.all():
            raise AtcError(f"{frame.source}: a crystal is periodic along all axes")
        frame.require("masses", why="the dynamics of a crystal")
        x, name = frame.positions - frame.cell.origin, name or frame.source
        what = frame.masses, frame.units, frame.types, conventional, name, dict(frame.type_names)
        return cls(frame.cell.vectors, x, *what)

    @classmethod
    def from_ase(cls, atoms, conventional=None) -> Crystal:
        """An `ase.Atoms` as a unit cell, in ASE's units."""
        symbols = atoms.get_chemical_symbols()
        kinds = list(dict.fromkeys(symbols))
        return cls(
            np.array(atoms.cell),
            atoms.get_positions(),
            atoms.get_masses(),
            units("ase"),
            [kinds.index(s) + 1 for s in symbols],
            conventional,
            atoms.get_chemical_formula(),
            {k + 1: s for k, s in enumerate(kinds)},
        )

    def __len__(self):
        return len(self.positions)

    @property
    def dimension(self) -> int:
        """3, or 2 for a crystal in the plane, whose volume is an area."""
        return self.units.dimension

    @property
    def strains(self) -> tuple:
        """Which of Voigt's components a strain of it can have."""
        return (0, 1, 5) if self.dimension == 2 else tuple(range(6))

    @cached_property
    def volume(self) -> float:
        return float(abs(np.linalg.det(self.vectors)))

    @property
    def density(self) -> float:
        """Mass per volume, internal units."""
        return float(self.masses.sum() / self.volume)

    @property
    def lattice_constant(self) -> float:
        """Edge length of the conventional cell along its first vector, in the user's units."""
        return float(self.units.to_user("length", np.linalg.norm(self.conventional[0])))

    @property
    def reciprocal(self) -> np.ndarray:
        """Rows: reciprocal vectors of the primitive cell, with the factor 2π."""
        return 2 * np.pi * np.linalg.inv(self.vectors).T

    def frame(self) -> Frame:
        """The unit cell as a periodic frame."""
        return self.copies(self.positions, self.cell)

    @property
    def cell(self) -> Cell:
        """Of the unit cell, open along z in two dimensions."""
        return Cell(self.vectors, periodic=np.arange(3) < self.dimension)

    def copies(self, x_nc, cell: Cell, source: str | None = None) -> Frame:
        """A frame of some copies of the unit cell's atoms, one cell after the other, at positions x_nc."""
        count = len(x_nc) // len(self)
        return Frame(
            x_nc,
            cell,
            self.units,
            types=np.tile(self.types, count),
            masses=np.tile(self.masses, count),
            source=source or self.name,
            type_names=dict(self.type_names),
        )

    def strained(self, strain=None, displacements=None) -> Crystal:
        """Under a homogeneous deformation x → (1 + strain) x, and basis atoms displaced by `displacements` (n, 3) on
        top."""
        F = np.eye(3) if strain is None else np.eye(3) + np.asarray(strain)
        moved = 0.0 if displacements is None else np.asarray(displacements)
        return replace(
            self,
            vectors=self.vectors @ F.T,
            positions=self.positions @ F.T + moved,
            conventional=self.conventional @ F.T,
            masses=self.masses.copy(),
        )

    def with_lattice_constant(self, a: float) -> Crystal:
        """Scaled so that `lattice_constant` is a (the user's units)."""
        return self.strained((a / self.lattice_constant - 1.0) * np.diag(np.arange(3) < self.dimension).astype(float))

    def lattice_points(self, repeat) -> np.ndarray:
        """(m, 3) integers: the cells of a repeat × repeat × repeat block."""
        return np.array(list(product(*(range(r) for r in repeat))))

    def supercell(self, repeat) -> tuple[Frame, np.ndarray]:
        """`repeat` cells along each primitive vector, and which basis atom each atom is; atoms of one cell stay
        together, the first cell comes first."""
        cells = self.lattice_points(repeat)
        n = len(self)
        x = (cells @ self.vectors)[:, None, :] + self.positions[None]
        cell = Cell(self.vectors * np.array(repeat)[:, None], periodic=np.arange(3) < self.dimension)
        frame = self.copies(x.reshape(-1, 3), cell)
        return frame, np.tile(np.arange(n), len(cells))

    def direction(self, direction) -> np.ndarray:
        """Unit vector along [u, v, w] of the conventional cell's reciprocal axes (for cubic crystals the cube's)."""
        v = np.asarray(direction, float) @ np.linalg.inv(self.conventional).T
        return v / np.linalg.norm(v)

    def zone_boundary(self, direction) -> float:
        """|k| where the ray along `direction` leaves the first Brillouin zone of the primitive lattice."""
        e = self.direction(direction)
        n = np.array([m for m in product(range(-3, 4), repeat=3) if any(m)])
        G = n @ self.reciprocal
        along = G @ e
        ahead = along > 1e-9 * np.linalg.norm(G, axis=1)
        return float((0.5 * (G[ahead] ** 2).sum(axis=1) / along[ahead]).min())


def _length(lattice_constant, u) -> float:
    a = float(u.to_internal("length", lattice_constant))
    if not (np.isfinite(a) and a > 0):
        raise AtcError(f"lattice_constant = {lattice_constant}: expected a length greater than 0")
    return a


def of_atc(model) -> bool:
    """Whether a model is a potential of atc, `contracts.Interactions`; any other is an ASE calculator."""
    return hasattr(model, "stream")


def evaluate(model, frame: Frame) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, forces (n, 3) and virial Σ G r⊗r (3, 3; tension positive) of a frame, by a potential of atc or an ASE
    calculator; internal units."""
    if of_atc(model):
        d = model.stream(frame, forces=True)
        return d.energy, d.forces_nc, d.virial_cc
    atoms = _ase_atoms(frame, model)
    try:
        stress = atoms.get_stress(voigt=False)
    except NotImplementedError:
        raise AtcError(
            f"{type(model).__name__}: this ASE calculator gives no stress, which lattice and elastic constants need"
        ) from None
    return atoms.get_potential_energy(), atoms.get_forces(), stress * frame.cell.volume


def forces(model, frame: Frame) -> np.ndarray:
    """(n, 3) forces only; internal units."""
    if of_atc(model):
        return model.stream(frame, forces=True).forces_nc
    return _ase_atoms(frame, model).get_forces()


def _ase_atoms(frame: Frame, model):
    from ase import Atoms

    if frame.units.reduced:
        raise AtcError(
            f"{frame.source}: an ASE calculator works in eV and angstrom, but this crystal is in reduced units (lj)"
        )
    missing = [t for t in np.unique(frame.types).tolist() if t not in frame.type_names]
    if missing:
        raise AtcError(f"{frame.source}: an ASE calculator needs chemical symbols: give symbols= for type {missing[0]}")
    symbols = [frame.type_names[t] for t in frame.types.tolist()]
    how = {"cell": frame.cell.vectors, "pbc": True, "masses": frame.masses, "calculator": model}
    return Atoms(symbols, frame.positions, **how)


def axes_of(directions, complain) -> np.ndarray:
    """(3, 3) rows: where the crystal's x, y, z point, from the crystal directions along the three axes of a body; None:
    along these. complain(why) makes the error for directions that are not normal to each other and right-handed."""
    if directions is None:
        return np.eye(3)
    O = np.array(directions, float)
    length = np.linalg.norm(O, axis=1)
    unit = O / np.where(length > 0, length, 1.0)[:, None]
    if not np.allclose(unit @ unit.T, np.eye(3), atol=1e-9) or np.linalg.det(unit) < 0:
        raise complain("must be normal to each other and right-handed, e.g. [[1, 1, 0], [-1, 1, 0], [0, 0, 1]]")
    return unit.T


@dataclass
class Response:
    """First derivatives of a crystal's stress and forces.

    stress_v : (6,) Cauchy stress, tension positive. forces_nc : (n, 3).
    born_vv : (6, 6) ∂σ/∂ε with the basis moving along. lambda_xv : (3n, 6) ∂F/∂ε. phi_xx : (3n, 3n) −∂F/∂u, the
        sublattices displaced as wholes.
    stress_xv : (3n, 6) ∂σ/∂u.
    """

    stress_v: np.ndarray
    forces_nc: np.ndarray
    born_vv: np.ndarray
    lambda_xv: np.ndarray
    phi_xx: np.ndarray
    stress_xv: np.ndarray


def response(crystal: Crystal, model, step: float = 1e-4) -> Response:
    """Central differences of sixth order; `step` is a strain, and a displacement in units of the cell's shortest
    vector."""
    n = len(crystal)
    h = step * np.linalg.norm(crystal.vectors, axis=1).min()

    def at(strain=None, u=None):
        c = crystal.strained(strain, u)
        _, f, virial = evaluate(model, c.frame())
        return to_voigt(virial) / c.volume, f.reshape(-1)

    stress, f = at()
    born, lam = np.zeros((6, 6)), np.zeros((3 * n, 6))
    for v in crystal.strains:
        for m, w in STENCIL:
            (sp, fp), (sm, fm) = at(m * step * unit_strain(v)), at(-m * step * unit_strain(v))
            born[:, v] += w / step * (sp - sm)
            lam[:, v] += w / step * (fp - fm)
    phi, sx = np.zeros((3 * n, 3 * n)), np.zeros((3 * n, 6))
    if n > 1:  # a lone atom of a cell cannot move against itself
        for x in range(3 * n):
            u = np.zeros(3 * n)
            for m, w in STENCIL:
                u[x] = m * h
                (sp, fp), (sm, fm) = at(u=u.reshape(n, 3)), at(u=-u.reshape(n, 3))
                phi[x] -= w / h * (fp - fm)
                sx[x] += w / h * (sp - sm)
    return Response(stress, f.reshape(n, 3), born, lam, 0.5 * (phi + phi.T), sx)


def relax(crystal: Crystal, model, pressure: float = 0.0, *, tolerance: float = 1e-10, shape: bool = True) -> Crystal:
    """The crystal at a given pressure (user's units): cell and basis by Newton's method on stress and forces.

    Parameters
    ----------
    tolerance : of the strain and of displacements relative to the cell
    shape : False keeps the cell's shape and only changes its volume

    Raises
    ------
    AtcError if Newton's method does not converge: the crystal is unstable under this model, or the start is too far
    away.

    Notes
    -----
    The stress is that of the forces. For a potential cut without a shift it is not the derivative of the energy at the
    (measure zero) strains at which a shell crosses the cutoff; LAMMPS's pressure is the same.
    """
    target = -crystal.units.to_internal("pressure", pressure) * np.array([1.0, 1, 1, 0, 0, 0])
    n = len(crystal)
    size = np.linalg.norm(crystal.vectors, axis=1).min()
    for _ in range(40):
        r = response(crystal, model)
        residual = np.concatenate([target - r.stress_v, r.forces_nc.reshape(-1)])
        if not np.isfinite(residual).all() or not r.born_vv.any():
            break  # nothing holds it together
        full = np.block([[r.born_vv, r.stress_xv.T], [-r.lambda_xv, r.phi_xx]])
        if not shape:
            iso = np.zeros((6 + 3 * n, 1 + 3 * n))
            iso[:3, 0] = 1.0
            iso[6:, 1:] = np.eye(3 * n)
            step = iso @ np.linalg.lstsq(iso.T @ full @ iso, iso.T @ residual, rcond=1e-9)[0]
        else:
            # Rigid translations of the basis cost nothing: the shortest step.
            step = np.linalg.lstsq(full, residual, rcond=1e-9)[0]
        strain, u = step[:6], step[6:].reshape(n, 3)
        largest = max(np.abs(strain).max(), np.abs(u).max() / size)
        scale = min(1.0, 0.03 / largest) if largest > 0 else 1.0
        crystal = crystal.strained(scale * sum(strain[v] * unit_strain(v) for v in range(6)), scale * u)
        if largest < tolerance:
            return crystal
    last = f"last lattice constant {crystal.lattice_constant:.6g} {crystal.units.label('length')}"
    raise AtcError(
        f"{crystal.name}: no cell with zero residual stress was found near the start: give a lattice constant nearer "
        f"to equilibrium, or check the potential ({last})"
    )
