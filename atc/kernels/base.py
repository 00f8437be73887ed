"""What a kernel is to everything else: a localisation function φ, its bond function β, and what sums, meshes and checks
need to know of them.

Nothing outside this package asks for a kernel's name or class: a family says here what it is, in one file of its own,
and `register` makes it known by name. `Kernel` is the contract; what it answers by itself is what a family may leave
out. φ is a function of the distance, or a product of functions of x, y and z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, sqrt
from typing import Protocol

import numpy as np

from ..compiled import specialise
from ..errors import AtcError
from ..simd import JIT_FMA
from . import lanes
from .profile import TINY, CompiledProfile


@dataclass(frozen=True)
class Compiled:
    """A family in machine code: the functions that the loops over bonds, points and atoms are specialised with
    (`compiled.specialise`).

    A kernel brings its numbers along in `Kernel.pieces`: rows m with a cut-off R_m, the largest first, and coefficients
    c_mk, whatever the family makes of them.

    Parameters
    ----------
    name : of the loops' copies, and of the cost of one β: one name for one set of functions
    constants : (length, R, c_mk, m, r_bc, frame_bcc, b, k)
        Once a bond and piece: fills the array k with what β needs. `length` is |r| of bond b, the rows of frame_bcc[b]
        are the directions of D, Y, M
    beta : (D, Y, M, k) -> vec4
        β of one piece at four points, from the address of k. A point is given relative to the bond, in units of its
        length: D along the bond from x_i, and (Y, M) across it
    pairs : (D, p², |r|², R², c_at, series_at, bond_at, r_at, k) -> vec4
        β of four (bond, point) pairs, each of a bond of its own: D along the bond, p² squared across it, in units of
        its length; or, if `cartesian`, the three components of d = x_i − x in their place. c_at: address of the piece's
        coefficients; bond_at, r_at: of the bonds' numbers and of all bond vectors
    value : (d0, d1, d2, |d|², R_m, c_mk, g) -> φ(d)
        All pieces; the gradient ∂φ/∂d goes into g
    cartesian : whether `pairs` gets d
    series : (R_m, c_mk) -> the numbers at series_at
    seconds : of one β on a lattice, on the machine that the cost model was measured on
    """

    name: str
    constants: Callable
    beta: Callable
    pairs: Callable
    value: Callable
    cartesian: bool = False
    series: Callable = lambda radii_m, coef_mk: np.zeros(1)
    seconds: float = 1e-8

    @classmethod
    def pointwise(cls, name: str, mean, value, seconds: float = 1e-7) -> Compiled:
        """Of a family that is no function of the distance and whose β is computed one point at a time.

        mean : (d0, d1, d2, r0, r1, r2, c_at, room_at) -> β, compiled with `simd.JIT_FMA`: d = x_i − x, the bond vector
            r, the address of the kernel's (only)
            row of coefficients, and that of 30 numbers of room
        """
        beta, pairs = (specialise(f, name, JIT_FMA, MEAN=mean) for f in (lanes.point_by_point, lanes.pair_by_pair))
        return cls(name, lanes.cartesian_constants, beta, pairs, value, cartesian=True, seconds=seconds)


class Profile(Protocol):
    """φ₁(z): a kernel integrated over the planes (in two dimensions: lines) at distance z from its middle. ∫φ₁ dz = 1;
    what slab profiles are made of.

    pieces : (R_m, c_mk), the largest R first, what the compiled functions take
    """

    compiled: CompiledProfile

    @property
    def support(self) -> float:
        """The largest |z| at which φ₁ is not 0."""

    @property
    def pieces(self) -> tuple[np.ndarray, np.ndarray]: ...

    def phi(self, z) -> np.ndarray:
        """φ₁(z)"""

    def slope(self, z) -> np.ndarray:
        """dφ₁/dz; 0 where it jumps"""

    def cumulative(self, z) -> np.ndarray:
        """∫ φ₁ from −∞ to z"""

    @property
    def bin_pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """The pieces as the compiled integrals take them: of means over bins."""

    def second(self, z) -> np.ndarray:
        """∫₀^z ∫₀^z φ₁: what means over bins are made of."""

    def beta(self, d, r) -> np.ndarray:
        """The mean of φ₁(d − t r) over t in [0, 1], for numbers d = z_i − z and r."""


class Kernel:
    """A localisation function φ ≥ 0, ∫φ = 1. Lengths are in whatever unit it was made in; `scaled` converts.

    Abstract: `name`, `compiled`, `pieces`, `radius`, `support`, `parameters`, `scaled` and `phi`. A family without
    `planar`, `grad_phi`, `marginal` or `hat` is refused where those are needed (two dimensions; checks; slab profiles;
    the spectral method), in one line. `beta` is what the compiled functions are tested against.
    """

    name: str
    #: φ is a function of |d|. If not, it is a product of functions of x, y and z (or has no `last_mode`), and has
    #: profiles along those axes only.
    is_isotropic: bool = True
    #: 2: normalised in the plane, ∫φ dA = 1; the plane is z = const, and every d and r has the z component 0.
    dimension: int = 3
    #: The loops' functions.
    compiled: Compiled

    # --- smoothness, which meshes, time steps and stencils follow from
    #: φ has derivatives of every order (to rounding): it has no rim, and its modes fall faster than any power.
    analytic: bool = False
    #: φ itself jumps somewhere: it has no gradient, and no rate sees an atom come or go.
    jumps: bool = False
    #: The first derivatives of φ are continuous.
    smooth: bool = True
    #: Up to which κ φ̂(κ/scale) is looked at, along the direction in which it decays most slowly; None: too slowly for
    #: the spectral method.
    last_mode: float | None = None
    #: Steps, in 1/radius, of a table that the transform of an isotropic kernel is read off with cubics; None: as
    #: quickly computed.
    hat_step: float | None = None

    # --- what it is
    @property
    def radius(self) -> float:
        """Where φ ends, or as good as: what the user calls its size."""
        raise NotImplementedError

    @property
    def scale(self) -> float:
        """The length over which φ changes: the radius, of a kernel with several the smallest."""
        return self.radius

    @property
    def support(self) -> float:
        """The largest distance at which φ is not 0."""
        raise NotImplementedError

    @property
    def parameters(self) -> dict:
        """The keyword arguments of `kernel` that make this kernel."""
        raise NotImplementedError

    @property
    def pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """(m,) cut-offs, the largest first, and (m, k) coefficients with the normalisation included, for the functions
        of `compiled`."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Kernel:
        """The same kernel with its lengths multiplied by `factor`."""
        raise NotImplementedError

    def planar(self) -> Kernel:
        """The same kernel in two dimensions, with ∫φ dA = 1."""
        raise AtcError(f"kernel {self.name!r} is not made for two dimensions")

    def in_dimension(self, dimension: int) -> Kernel:
        """The same kernel for runs in so many dimensions; AtcError for one made for two dimensions in three."""
        if dimension == 2:
            return self if self.dimension == 2 else self.planar()
        if self.dimension == 2:
            raise AtcError(
                f"kernel {self.name!r} was made for two dimensions, but the run has three: leave its dimension out"
            )
        return self

    # --- its functions, of numpy arrays
    def phi(self, d) -> np.ndarray:
        """φ(d) for vectors d (..., 3)."""
        raise NotImplementedError

    def grad_phi(self, d) -> np.ndarray:
        """∂φ/∂d (..., 3) for vectors d (..., 3); 0 where φ has a kink or a jump."""
        raise AtcError(f"the gradient of kernel {self.name!r} is not known: use quartic, lucy or gaussian")

    def beta(self, d, r) -> np.ndarray:
        """The bond function: the mean of φ(d − t r) over t in [0, 1], for d = x_i − x and r (..., 3), broadcast."""
        raise NotImplementedError

    def marginal(self, normal=(0.0, 0.0, 1.0)) -> Profile:
        """φ integrated over the planes normal to `normal`, as a function of the distance along it."""
        raise AtcError(
            f"kernel {self.name!r} has no profile integrated over planes: use a grid of points instead of slabs"
        )

    def hat(self, k) -> np.ndarray:
        """φ̂(k) = ∫ φ(x) exp(−i k·x) dx for wave vectors (..., 3): real, 1 at k = 0. In two dimensions k has no z
        component."""
        raise AtcError(f"kernel {self.name!r} has no transform for the spectral method: use method 'direct'")

    def hat_along(self, kappa) -> np.ndarray:
        """φ̂ at |k| = κ/scale along the direction in which it decays most slowly."""
        kappa = np.asarray(kappa, float)
        return self.hat(np.stack([kappa / self.scale, np.zeros_like(kappa), np.zeros_like(kappa)], -1))

    def squared(self) -> tuple[float, Kernel] | None:
        """c and a kernel ψ with φ² = c ψ, if there is one; sums of φ² are otherwise taken point by point."""
        return None

    # --- for checks
    @property
    def peak(self) -> float:
        """φ at 0, the scale against which errors of β are measured."""
        return float(self.phi(np.zeros(3)))

    def kink_distance(self, d) -> np.ndarray:
        """How far vectors d (..., 3) are from the places where φ or its first derivatives have kinks or jumps."""
        return np.full(np.shape(d)[:-1], np.inf)

    @property
    def difference_step(self) -> float:
        """The step of difference stencils: small against φ, so that they seldom meet a kink of it. Rounding of a field
        grows by radius/step in its derivative."""
        return 1e-4 * self.radius

    def cut(self, beyond: float) -> Kernel:
        """The kernel without its outermost part, of at most so much of its integral, if that makes sums quicker."""
        return self

    def above(self, value: float) -> Kernel:
        """The kernel without the part far out that is below a value, if that makes sums quicker."""
        return self

    # --- words
    def describe(self) -> str:
        """One line: name and lengths."""
        return f"{self.name}, " + ", ".join(
            f"{k} {v:.12g}" if np.isscalar(v) else f"{k} {v}" for k, v in self.parameters.items()
        )

    def __repr__(self):
        return f"<kernel {self.describe()}>"

    def _repr_html_(self):
        """For notebooks."""
        from ..terminal import html_table

        rows = [(k, f"{v:.12g}" if np.isscalar(v) else v) for k, v in self.parameters.items()]
        return html_table(f"kernel {self.name}", [*rows, ("reaches", f"{self.support:.6g}")])

    @cached_property
    def _key(self) -> tuple:
        return self.name, self.dimension, str(self.parameters)

    def __eq__(self, other):
        return self is other or (isinstance(other, Kernel) and self._key == other._key)

    def __hash__(self):
        return hash(self._key)


class Family(Protocol):
    """How users name a kernel and what they give it: what `register` takes. A class of kernels is one, with `of` as a
    class method.

    name, aliases : what may be written
    takes : which of radius, width, size and table it may be given, one at a time
    """

    name: str
    aliases: tuple[str, ...]
    takes: tuple[str, ...]

    def of(self, dimension: int | None = None, **given) -> Kernel:
        """The kernel from the one thing given. dimension : what the user says, or None. AtcError for what it cannot be
        made of."""


# --- what families share


def positive(what: str, value, name: str) -> float:
    """A length that a user gave."""
    try:
        v = float(value)
    except (TypeError, ValueError):
        raise AtcError(f"kernel {name!r}: {what} must be a number, got {value!r}") from None
    if not (isfinite(v) and v > 0):
        raise AtcError(f"kernel {name!r}: {what} must be positive and finite, got {value!r}")
    return v


def edges(size, dimension: int | None, name: str) -> np.ndarray:
    """(3,) edge lengths that a user gave as one or three numbers; (2,) of two, with dimension=2."""
    wanted = 2 if dimension == 2 and np.shape(size) == (2,) else 3
    try:
        given = np.array(np.broadcast_to(np.asarray(size, dtype=float), (wanted,)))
    except (ValueError, TypeError):
        raise AtcError(
            f"kernel {name!r}: size must be three edge lengths (two with dimension=2), got {size!r}"
        ) from None
    return np.array([positive("size", e, name) for e in given])


class Edged(Kernel):
    """A product kernel with a length along each axis.

    size : (3,) or (2,); given : how many numbers the user gave
    """

    is_isotropic = False

    def __init__(self, size, given=None):
        self.size = np.asarray(size, float)
        self.dimension = len(self.size)
        self._given = self.dimension if given is None else given

    @property
    def parameters(self):
        return {"size": self.size.tolist()}

    @property
    def normalisation(self) -> float:
        return 1.0 / float(self.size.prod())

    def scaled(self, factor):
        return self if factor == 1.0 else type(self)(self.size * factor, self._given)

    def planar(self):
        if self._given == 3:
            raise AtcError(
                f"kernel {self.name!r}: size has three edge lengths, {self.size.tolist()}, but the run is "
                "two-dimensional: give two"
            )
        return type(self)(self.size[:2], self._given)

    def in_dimension(self, dimension):
        if dimension == 3 and self.dimension == 2:
            raise AtcError(
                f"kernel {self.name!r}: size has two edge lengths, {self.size.tolist()}, but the run has three "
                "dimensions: give three"
            )
        return super().in_dimension(dimension)


def along_axis(kern: Kernel, normal) -> int:
    """Which axis a direction is along; AtcError if none: profiles of product kernels."""
    n = np.abs(np.asarray(normal, float))
    a = int(n.argmax())
    if n[a] < (1.0 - 1e-12) * sqrt((n**2).sum()):
        raise AtcError(
            f"kernel {kern.name!r} is a product along x, y, z: a profile along a tilted axis needs an isotropic "
            "kernel (quartic, lucy, gaussian, ...)"
        )
    return a


def along(d, r, R):
    """Bond geometry in units of the bond's length: p² and the foot of the perpendicular, D, along the bond from x_i,
    and |r|."""
    d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
    length = np.sqrt((r * r).sum(-1))
    short = length < TINY * R
    length = np.where(short, TINY * R, length)
    n = np.where(short[..., None], np.array([1.0, 0.0, 0.0]), r / length[..., None])
    s = (d * n).sum(-1)
    perpendicular = d - s[..., None] * n
    return (perpendicular**2).sum(-1) / length**2, s / length, length
