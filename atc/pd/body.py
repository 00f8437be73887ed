"""A body: nodes with volumes and densities, their families, and what cuts them."""

from __future__ import annotations

import warnings
from functools import cached_property

import numpy as np

from ..errors import AtcError, AtcWarning
from ..frame import Cell
from .bonds import Families, Notch, families
from .cells import cut_cells, require_fit
from .regions import Region, nodes_of

#: How far volumes of nodes may add up to more than the periodic cell that they fill.
_ROUNDING = 2e-3


class Body:
    """Nodes of a peridynamic body in their reference configuration.

    Any one consistent system of units (SI, say): nothing here converts.

    Parameters
    ----------
    positions : (n, 3) reference positions X (also in one and two dimensions: the other coordinates are constant)
    volumes : (n,) or a number; in 2-D area × thickness, in 1-D length × cross-section
    density : (n,) or a number, mass per volume
    horizon : δ. Families are |ξ| ≤ δ (1 + 1e-10); a horizon that some bond meets to rounding is warned about.
    cell : atc.Cell or None. Periodic along its periodic axes; None is a free body.
    dimension : 3, 2 or 1. plane : "stress" or "strain", for dimension 2.
    thickness : of the plate in 2-D, cross-section in 1-D; what volumes were multiplied with.
    spacing : node diameter, for the volume correction ν and for contact; default the mean of V^(1/d)
    materials : (n,) int or a number, which material each node is made of (default 1)
    notches : `Notch` objects that cut bonds
    unbonded : pairs (a, b) of materials between which there are no bonds
    crowded : whether volumes may add up to more than the periodic cell has, as those of atoms of a compressed crystal
    """

    def __init__(
        self,
        positions,
        volumes,
        density,
        horizon,
        *,
        cell=None,
        dimension=3,
        plane="stress",
        thickness=1.0,
        spacing=None,
        materials=1,
        notches=(),
        unbonded=(),
        crowded=False,
        warn=True,
    ):
        X = np.ascontiguousarray(positions, dtype=np.float64)
        if X.ndim != 2 or X.shape[1] != 3 or not len(X):
            raise AtcError(f"a body needs positions of shape (n, 3) with at least one node, got {X.shape}")
        if not np.isfinite(X).all():
            raise AtcError(
                f"node {int(np.flatnonzero(~np.isfinite(X).all(axis=1))[0])} of the body has a position that is not a "
                "finite number"
            )
        if dimension not in (1, 2, 3):
            raise AtcError(f"the dimension of a body must be 1, 2 or 3, got {dimension!r}")
        if plane not in ("stress", "strain"):
            raise AtcError(f'plane must be "stress" or "strain", got {plane!r}')
        for axis in range(dimension, 3):
            if np.ptp(X[:, axis]) != 0:
                raise AtcError(
                    f"a body of dimension {dimension} must have constant {'xyz'[axis]}, but its nodes spread over "
                    f"{np.ptp(X[:, axis]):g}"
                )
        if not (np.isfinite(horizon) and horizon > 0):
            raise AtcError(f"the horizon must be a positive length, got {horizon!r}")
        n = len(X)
        self.X_nc = X
        self.V_n = _per_node(volumes, n, "volumes")
        self.rho_n = _per_node(density, n, "density")
        for name, a in (("volumes", self.V_n), ("density", self.rho_n)):
            if not (np.isfinite(a) & (a > 0)).all():
                raise AtcError(
                    f"{name} must be positive everywhere; node {int(np.flatnonzero(~(a > 0))[0])} has "
                    f"{a[~(a > 0)][0]!r}"
                )
        self.horizon, self.dimension, self.plane, self.thickness = (
            float(horizon),
            int(dimension),
            plane,
            float(thickness),
        )
        #: (3, 3) rows: from one node to the next, where they are a lattice's.
        self.step_cc = None
        self.material_n = np.ascontiguousarray(np.broadcast_to(np.asarray(materials, np.int32), (n,)))
        if cell is None:
            cell = Cell(np.zeros((3, 3)), periodic=False)
        if any(cell.periodic[dimension:]):
            raise AtcError(f"a body of dimension {dimension} cannot be periodic along {'xyz'[dimension:]}")
        self.cell = cell.completed(X, margin=self.horizon)
        if not crowded:
            self._require_room()
        sizes = (self.V_n / (self.thickness if dimension < 3 else 1.0)) ** (1 / dimension)
        self.spacing = float(sizes.mean() if spacing is None else spacing)
        # Node radii, for contact: half the spacing of a lattice.
        self.radius_n = (
            np.full(n, 0.5 * self.spacing)
            if spacing is not None or np.ptp(sizes) <= 1e-9 * sizes.mean()
            else 0.5 * sizes
        )
        self.notches = [notches] if isinstance(notches, Notch) else list(notches)
        self.unbonded = list(unbonded)
        self._warn = warn

    def _require_room(self):
        """No more matter than a cell that is periodic along all axes has room for, but for the rounding of volumes."""
        d = self.dimension
        if not self.cell.periodic[:d].all():
            return
        edges = self.cell.vectors[:d]
        room = float(np.sqrt(np.linalg.det(edges @ edges.T))) * (self.thickness if d < 3 else 1.0)
        if self.V_n.sum() > room * (1 + _ROUNDING):
            raise AtcError(
                f"the nodes' volumes add up to {self.V_n.sum():.6g}, {100 * (self.V_n.sum() / room - 1):.3g} % more "
                f"than the {room:.6g} of the periodic cell: give the volumes that the nodes have in it"
            )

    @cached_property
    def bonds(self) -> Families:
        """The families, as a half bond table (made when first used, and with it ``cuts``: how many bonds each notch
        crosses)."""
        table = families(self.X_nc, self.cell, self.horizon)
        if table.on_horizon and self._warn:
            warnings.warn(
                f"the horizon {self.horizon:g} is an exact bond length: those bonds are counted in, but other "
                "programs may miss them by rounding;"
                " take it a little larger",
                AtcWarning,
                stacklevel=3,
            )
        kept = np.ones(len(table), bool)
        self.cuts = []
        for notch in self.notches:
            crossed = self._crossed(table, notch)
            self.cuts.append(int(np.count_nonzero(crossed)))
            if not notch.as_damage:
                kept &= ~crossed
        if not kept.all():
            table = table.keep(kept)
        for a, b in self.unbonded:
            i, j = self.material_n[table.i_b], self.material_n[table.j_b]
            table = table.keep(~(((i == a) & (j == b)) | ((i == b) & (j == a))))
        return table

    def precracked(self) -> np.ndarray:
        """(b,) bonds that are broken from the start: those across a notch with ``as_damage``."""
        broken = np.zeros(len(self.bonds), bool)
        for notch in self.notches:
            if notch.as_damage:
                broken |= self._crossed(self.bonds, notch)
        return broken

    def _crossed(self, table, notch):
        crossed = np.empty(len(table), bool)
        i = table.i_b
        for a in range(0, len(table), 1 << 20):
            part = slice(a, a + (1 << 20))
            x = self.X_nc[i[part]]
            xi = self.X_nc[table.j_b[part]] - x
            if not len(table.image_b):
                crossed[part] = notch.crosses(x, xi)
                continue
            images = table.images_tc[table.image_b[part]]
            whole = np.rint(images @ np.linalg.inv(self.cell.vectors))
            crossed[part] = notch.crosses_periodic(x, xi + images, whole, self.cell.vectors)
        return crossed

    def nu_b(self) -> np.ndarray:
        """(b,) share of a node's volume that its partner sees: 1 inside, falling to ½ at the horizon over half a
        spacing (R, nodal volume scaling)."""
        return self.share(self.bonds.r0_b)

    def share(self, r0) -> np.ndarray:
        """ν of bonds of these lengths."""
        r = 0.5 * self.spacing
        nu = np.where(np.abs(r0 - self.horizon) <= r, -r0 / (2 * r) + (1.0 + (self.horizon - r) / (2 * r)), 1.0)
        return np.clip(nu, 0.0, 1.0, out=nu)

    @cached_property
    def family_volume_n(self) -> np.ndarray:
        """(n,) ΣV_j over the reference family (no ν): the denominator of damage."""
        b = self.bonds
        return b.sums(self.V_n[b.j_b], self.V_n[b.i_b])

    def nodes(self, region) -> np.ndarray:
        """Node numbers inside a region (also a mask, numbers, a function of positions, None for all)."""
        return nodes_of(region, self.X_nc)

    def __len__(self):
        return len(self.X_nc)

    def __repr__(self):
        return f"Body({len(self)} nodes, {self.dimension}-D, horizon {self.horizon:g}, spacing {self.spacing:g})"

    @classmethod
    def lattice(
        cls,
        region: Region,
        spacing: float,
        horizon: float,
        density,
        *,
        dimension=3,
        thickness=None,
        offset=(0.0, 0.0, 0.0),
        jitter=0.0,
        seed=0,
        cut=False,
        **options,
    ):
        """A simple cubic (square, chain) lattice inside a region: nodes at offset + integers × spacing, points on the
        region's surface included.

        Parameters
        ----------
        region : Region with finite bounds along the body's dimensions
        spacing : Δx. Volumes are Δx^d (× thickness; default Δx).
        jitter : largest random displacement of a node along each axis, in spacings (with `seed`)
        cut : whether the region's surface cuts the cells of its nodes: a node then has the volume of the part inside,
            and lies in its middle; parts of less than half a cell belong to the neighbour that has most. The body has
            the region's volume, and curved surfaces no stairs. Of a periodic body what of the region lies in the cell
            counts.
        The rest as for `Body`. x runs fastest, z slowest: the order of LAMMPS's create_atoms. Without `cut` the body
        has as many volumes Δx^d as nodes, whatever the region's. A lattice that goes on through the faces of a periodic
        cell must have whole spacings along its edges.
        """
        if not (np.isfinite(spacing) and spacing > 0):
            raise AtcError(f"the spacing of a lattice must be a positive length, got {spacing!r}")
        offset = np.asarray(offset, float)
        lo, hi = (np.array(b, float) for b in region.bounds)
        lo[dimension:] = hi[dimension:] = offset[dimension:]
        if not (np.isfinite(lo).all() and np.isfinite(hi).all()):
            raise AtcError("a lattice needs a bounded region: give its lower and upper bounds")
        # Cells that the surface cuts may have their middle outside.
        more = 0.5 if cut else 0.0
        first = np.ceil((lo - offset) / spacing - more - 1e-6).astype(int)
        last = np.floor((hi - offset) / spacing + more + 1e-6).astype(int)
        first[dimension:] = last[dimension:] = 0
        z, y, x = np.meshgrid(*(np.arange(first[k], last[k] + 1) for k in (2, 1, 0)), indexing="ij")
        points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1) * spacing + offset
        share = 1.0
        if cut:
            points, share = cut_cells(points, region, spacing, dimension, options.get("cell"))
        else:
            points = points[region.contains(points)]
        if not len(points):
            raise AtcError(
                "no lattice point lies inside the region: use a smaller spacing, or move the lattice by an offset"
            )
        if options.get("cell") is not None:
            require_fit(points, options["cell"].completed(points, margin=horizon), spacing, horizon, dimension)
        if jitter:
            points[:, :dimension] += (
                np.random.default_rng(seed).uniform(-jitter, jitter, (len(points), dimension)) * spacing
            )
        thickness = (spacing ** (3 - dimension)) if thickness is None else thickness
        volume = spacing**dimension * (thickness if dimension < 3 else 1.0)
        body = cls(
            points,
            volume * share,
            density,
            horizon,
            dimension=dimension,
            thickness=thickness,
            spacing=spacing,
            **options,
        )
        body.step_cc = None if jitter else np.eye(3) * spacing
        return body


def _per_node(value, n, name):
    a = np.asarray(value, dtype=np.float64)
    if a.ndim == 0:
        return np.full(n, float(a))
    if a.shape != (n,):
        raise AtcError(f"{name} must be one number or one for each of the {n} nodes, got shape {a.shape}")
    return np.ascontiguousarray(a)
