"""What the rooms may ask of each other: the contracts between them, as protocols.

Whoever brings a thing of their own (a model of forces, a source of frames, a kernel, a grid, a way to take the sums, a
peridynamic law) gives it these members, and nothing else is ever asked for. The classes of this package inherit from
what is said here or are held against it by a test. Members with a value or a body are what a thing that says nothing
answers; those without must be given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from .errors import AtcError

if TYPE_CHECKING:
    from .bonds import Bonds
    from .frame import Cell, Frame
    from .units import Units

__all__ = [
    "BondSprings", "BoundGrid", "Deposit", "FrameSource", "Grid", "Interactions", "Kernel", "Micromodulus", "PDLaw",
]  # fmt: skip


class FrameSource(Protocol):
    """Where frames come from: a lazy sequence. `atc.readers.trajectory.Trajectory` is the class to inherit from, with
    ``__len__`` and ``_frame(k)`` of one's own."""

    #: of the user; the frames themselves are in internal units
    units: Units
    #: what messages call it, usually a path
    source: str
    #: what the reader takes for granted because the format cannot say it: sentences
    assumed: tuple[str, ...]
    #: 2 or 3 where whoever opened it said so
    dimension: int | None

    def __len__(self) -> int: ...

    def __getitem__(self, key: Any) -> Any:
        """Frame number `key`, or for a slice another source."""

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None:
        """Nothing is read afterwards."""


class Interactions(Protocol):
    """A model of the forces: what a potential is to everything behind it. Inherit from it to bring one's own; `stream`,
    `describe`, `units` and `cutoff` are all it must say.

    Lengths, energies and forces are internal (see `atc.units`).
    """

    #: the unit style its numbers were given in
    units: Units
    #: how far apart two atoms with a bond may be; 0 where topology alone says which bonds there are
    cutoff: float
    #: `Term`s it is the sum of, which say more (tiles, forecasts); none: only `stream` is known of it
    terms: Sequence[Any] = ()
    #: whether every force acts along its bond
    central: bool = True
    #: whether every bond is a term of two atoms, half of it each one's: then there is no churning
    pairwise: bool = False
    #: whether stress and energy sources of every bond cancel exactly, as for pairs and for edges of the energies
    churnless: bool = False
    #: of bodies whose nodes have one (peridynamics), else None
    horizon: float | None = None
    dimension: int = 3
    #: (terms) what of it has no bonds but modes of a field
    fields: Sequence[Any] = ()
    #: distances and bodies that are held (`Constraints`), or None
    constraints: Any = None
    #: points besides the atoms that forces act on (`VirtualSites`), or None
    sites: Any = None
    #: forces from outside whose laws are known (`OutsideForces`), or None
    acting: Any = None
    #: attributes of the output that say what it is, besides ``decomposition``, which is `describe`
    attributes: Mapping[str, Any] = {}
    #: forces from outside, in words
    outside: tuple[str, ...] = ()
    #: groups of a script that ``fix move`` moves
    moved: tuple[str, ...] = ()
    #: what the script says of the atoms, see `complete`
    setup: Any = None
    #: {type: mass} as far as it says
    masses: Mapping[int, float] = {}
    #: LAMMPS lines, or the script, that it was made from
    text: str | None = None
    file: str | None = None
    #: of a learned model that was made from a file: what made it (``nep``, ``mace`` ...), the file's name, and what it
    #: was told besides
    learned: tuple[str, str, Mapping[str, Any]] | None = None

    @property
    def needs_forces(self) -> bool:
        """Whether some of its bonds depend on all other forces: constraints, and what virtual sites hand on."""
        return self.constraints is not None or self.sites is not None

    @property
    def local(self) -> Interactions:
        """What of it is bonds: itself without its fields."""
        return self

    def describe(self) -> str:
        """One line for the output: what it is, and how it shares the energy among the atoms."""
        raise NotImplementedError

    def stream(
        self,
        frame: Frame,
        consume: Callable[[Bonds, int], None] | None = None,
        *,
        threads: int = 1,
        energies: bool = False,
        forces: bool = False,
        sources: bool = False,
    ) -> Any:
        """Hand all bonds of a frame to ``consume(bonds, thread)``, chunk by chunk.

        Parameters
        ----------
        consume : called from threads 0..threads−1; the arrays may be reused after it returns
        energies, forces : whether the `Decomposition` that is returned shall have the atoms' energies and forces
        sources : whether bonds shall carry their directed energy sources ``D_bdc``

        Returns
        -------
        `atc.decomposers.base.Decomposition`
        """
        raise NotImplementedError

    def check_topology(self, frame: Frame) -> None:
        """Raise AtcError if the frame has bonded terms that the model says nothing of."""

    def complete(self, frame: Frame) -> Frame:
        """The frame with what the model knows of its atoms (charges, masses, topology) and the frame does not."""
        return frame

    def carriers(self, frame: Frame) -> Frame:
        """The frame that the bonds' indices refer to: more particles than the frame's own where there are virtual
        sites."""
        return frame

    def held_by_topology(self, frame: Frame) -> Interactions:
        """The model with the constraints that a frame's topology says, where nothing else says any."""
        return self

    def settled(self, frame: Frame) -> Interactions:
        """The model for a trajectory that begins with this frame."""
        return self

    def as_in_file(self, frame: Frame) -> Interactions:
        """The model with just the forces that the file of a run has."""
        return self

    def body_forces(self, frame: Frame, inner_nc: np.ndarray) -> tuple[np.ndarray, str]:
        """Forces from outside on the atoms of a frame, (n, 3), and where they are from, in words; `inner_nc` are those
        between atoms. AtcError where they are not known."""
        if frame.forces is None:
            raise AtcError(f"{frame.source}: body_force: nothing says which forces act from outside: dump fx fy fz too")
        return frame.forces - inner_nc, "measured: the forces of the run less those of the potential"


class Kernel(Protocol):
    """A localisation function φ ≥ 0 with ∫φ = 1, and its bond function β(x) = ∫₀¹ φ(x_i − s r − x) ds. The class to
    inherit from is `atc.kernels.base.Kernel`: one file a family."""

    name: str
    dimension: int

    @property
    def radius(self) -> float:
        """What the user calls its size."""

    @property
    def support(self) -> float:
        """The distance beyond which φ = 0."""

    @property
    def pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """(R_m, c_mk): what its compiled functions take."""

    def scaled(self, factor: float) -> Kernel:
        """The same kernel with every length multiplied by `factor`."""

    def planar(self) -> Kernel:
        """The same function of the distance, normalised in the plane."""

    def in_dimension(self, dimension: int) -> Kernel:
        """The same kernel for runs in 2 or 3 dimensions; AtcError for one that is made for the plane, in 3."""

    def phi(self, d: np.ndarray) -> np.ndarray:
        """φ at (..., 3) vectors d, 1/volume."""

    def grad_phi(self, d: np.ndarray) -> np.ndarray:
        """∂φ/∂d, (..., 3)"""

    def beta(self, d: np.ndarray, r: np.ndarray) -> np.ndarray:
        """The mean of φ over the segment from d to d − r."""

    def hat(self, k: np.ndarray) -> np.ndarray:
        """∫ φ exp(−i k·d) dV at (..., 3) wave vectors, real."""

    def marginal(self, normal: Sequence[float] = (0.0, 0.0, 1.0)) -> Any:
        """φ integrated over the planes normal to `normal`: a `Profile`."""

    def describe(self) -> str: ...


class BoundGrid(Protocol):
    """A grid in one frame: positions in internal units."""

    kind: str
    dims: tuple[str, ...]

    def __len__(self) -> int: ...

    @property
    def shape(self) -> tuple[int, ...]: ...

    @property
    def points_gc(self) -> np.ndarray:
        """(g, 3)"""

    @property
    def is_lattice(self) -> bool:
        """Whether the points are origin + i·steps: the sums then run over rows of them."""

    def coords(self, units: Units) -> dict:
        """Coordinates of the output, in the user's units."""


class Grid(Protocol):
    """Where fields are wanted, as the user says it: in the user's units, perhaps relative to a cell that changes."""

    kind: str
    #: how far it reaches beyond open faces of the cell, in the user's unit; "auto": as far as the kernel; None: not
    padding: float | str | None = None
    #: whether it ends at the faces of the cell (or, with padding, beyond the open ones)
    over_cell: bool = False
    #: whether values are means over the width of bins
    bin_means: bool = False
    #: whether it is planes, on which sums are counted that need no kernel
    counts_crossings: bool = False
    #: what vectors and tensors are components along, if not x, y, z
    local_axes: tuple[str, ...] = ()
    #: what it moves with since the first frame: "mass", "+z" ...
    follows: str | None = None

    @property
    def follows_cell(self) -> bool:
        """Whether its points move with the cell."""

    @property
    def follows_atoms(self) -> bool:
        """Whether its points are the atoms."""

    def describe(self) -> str: ...

    def require_dimension(self, dimension: int) -> None:
        """Raise AtcError where it cannot be one of a run in 2 or 3 dimensions."""

    def fixed(self, units: Units, cell: Cell, positions: np.ndarray | None = None) -> Grid:
        """The grid with what it takes from the first frame."""

    def bind(self, units: Units, cell: Cell, positions: np.ndarray | None = None) -> BoundGrid:
        """The points of one frame."""


class Deposit(Protocol):
    """The two sums every field is made of, on the points of one grid: Σ a φ over atoms and Σ b β over bonds. What is
    added on different threads goes into buffers of their own; the sums are linear in what was added."""

    @property
    def visits(self) -> int:
        """How many pairs of a point with an atom or bond were evaluated."""

    def add_sites(self, x_nc: np.ndarray, a_nk: np.ndarray, thread: int = 0) -> None:
        """Add Σ_j a_j φ(x − x_j), all periodic images."""

    def add_bonds(self, x_bc: np.ndarray, r_bc: np.ndarray, b_bk: np.ndarray, thread: int = 0) -> None:
        """Add Σ_b b β(x); bond b runs from x_b to x_b − r_b."""

    def add_bond_stress(
        self,
        x_nc: np.ndarray,
        i_b: np.ndarray,
        r_bc: np.ndarray,
        G_b: np.ndarray,
        thread: int = 0,
        j_b: np.ndarray | None = None,
    ) -> None:
        """Add Σ_b G r⊗r β(x), components xx, yy, zz, yz, xz, xy."""

    def site_sums(self) -> np.ndarray:
        """(g, n_site), points in the grid's order"""

    def bond_sums(self) -> np.ndarray:
        """(g, n_bond)"""


class PDLaw(Protocol):
    """A peridynamic material: constants, and what damage, contact and balance need to know of them. Classes to inherit
    from: `atc.pd.PMB` for a law of single bonds (its `law` is all there is to write), `atc.pd.materials.base.Isotropic`
    with a `ForceModel` for others."""

    name: str

    def lame(self, body: Any) -> tuple[float, float]:
        """(λ, μ) that act in the body's dimension."""

    def fracture_energy(self, body: Any, s0: float) -> float:
        """Energy per area to stretch all bonds across a plane to s0."""

    def contact_micromodulus(self, body: Any) -> float:
        """c of the bond-based material of this bulk modulus, which contact is a multiple of."""

    def uniaxial(self, body: Any) -> float:
        """The modulus of a thin bar."""

    def poisson(self, body: Any) -> float:
        """Contraction over extension of that bar."""


@runtime_checkable
class BondSprings(Protocol):
    """Springs of a body, bond by bond: what `atc.pd.Linear` may be made of."""

    def springs(self, body: Any) -> np.ndarray:
        """(b, 3, 3) the spring constant of every bond of ``body.bonds``."""


@runtime_checkable
class Micromodulus(Protocol):
    """A continuous kernel with its waves: what `atc.pd.Linear` may be made of, and nodes are held to."""

    def kernel(self, xi_bc: np.ndarray) -> np.ndarray:
        """(b, 3, 3) C(ξ), energy/length² per volume squared."""

    def dynamical_matrix(self, k_kc: np.ndarray) -> np.ndarray:
        """(k, 3, 3) D of plane waves."""
