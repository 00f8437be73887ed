"""The materials ``linear``, ``measured`` and ``coarsened`` of a twin: springs between nodes that carry the crystal's
small waves, or its answer to loads at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .. import pd
from ..errors import AtcError
from ..upscaling.cauchy_born import cubic_of
from ..upscaling.coarsening import CoarsenedKernel, coarsen
from ..upscaling.elasticity import elastic_constants
from ..upscaling.fluctuations import fluctuations
from ..upscaling.force_constants import force_constants
from ..upscaling.node_kernel import FRACTIONS, node_kernel, wave_constants
from .material import TwinMaterial, hill, require_stable

#: How far bonds may be from the crystal's, in parts of the nearest neighbours' distance; how far nodes' steps may be
#: from the relaxed crystal's lattice vectors for its coarsening, in parts of the step.
_OFF, _STRAIN = 0.15, 0.02


@dataclass
class LinearTwin(TwinMaterial):
    """Harmonic crystal on the nodes (internal units).

    material : pd.Linear. C : ElasticConstants. bulk, shear : Hill averages
    kernel : NodeKernel, CoarsenedKernel, or `LatticeSprings` where the nodes are the atoms
    sampled_vv, wanted_vv : (6, 6) elastic constants of the nodes and of the crystal
    found : Fluctuations, where they are measured ones
    """

    material: object
    C: object
    bulk: float
    shear: float
    kernel: object
    sampled_vv: np.ndarray
    wanted_vv: np.ndarray
    found: object = None

    @property
    def crystal_vv(self) -> np.ndarray:
        return self.C.C_vv

    @property
    def coarsened(self) -> bool:
        return isinstance(self.kernel, CoarsenedKernel)

    def lines(self, units) -> list[str]:
        """What it is, what it gets exactly and what not: for a person."""
        p = lambda v: f"{units.to_user('pressure', v):.5g}"  # noqa: E731
        c11, c12, c44 = cubic_of(self.wanted_vv)
        kind = "linear, springs of the crystal's dispersion"
        if self.coarsened:
            kind = f"coarsened, springs of nodes for {self.kernel.cells} cells each, all else at rest given them"
        out = self._measured(units) or [
            f"material: {kind}: C11 {p(c11)}, C12 {p(c12)}, C44 {p(c44)} {units.label('pressure')}"
        ]
        if isinstance(self.kernel, LatticeSprings):
            out.append("exact: every small motion of the atoms (the force constants themselves)")
        else:
            errors = ", ".join(f"{100 * e:.2g} % at {f:g}" for e, f in zip(self.kernel.error_f, FRACTIONS))
            out.append(f"exact: elastic constants of waves (nodes within {self.error:.1g}); stable over the whole zone")
            if self.coarsened:
                out.append(
                    "nearly exact: what forces on single nodes do at rest, but for the "
                    f"{100 * self.kernel.beyond:.2g} % of the springs that the horizon cuts off (fitted to make up)"
                )
            out.append(f"not exact: ω of the worst branch off by at most {errors} of the nodes' zone boundary")
        out.append(
            "not exact: finite strains and rotations, surfaces (springs that pull across their bond resist a rotation "
            "there): meant for waves in periodic bodies"
        )
        return out

    def _measured(self, units) -> list[str]:
        f = self.found
        if f is None:
            return []
        C, e = (units.to_user("pressure", np.array(cubic_of(v))) for v in (f.elastic.C_vv, f.C_error_vv))
        constants = ", ".join(f"{n} {c:.4g} ± {s:.1g}" for n, c, s in zip(("C11", "C12", "C44"), C, e))
        rms = 100 * np.sqrt((f.error_k**2).mean())
        return [
            f"material: measured, springs from the fluctuations of {f.source.rsplit(' frame ', 1)[0]}: {f.frames} "
            f"frames, {f.temperature:.4g} {units.label('temperature')}, {len(f.k_kc)} waves, ω² within {rms:.2g} %",
            f"energy: {constants} {units.label('pressure')}, errors from {f.blocks} blocks",
        ]


def linear(crystal, model, axes, made, atoms: bool) -> LinearTwin:
    """Springs of a relaxed crystal on the nodes of a `TwinBody`, or on the atoms themselves."""
    return on_nodes(*_springs_of(crystal, model, axes), made, atoms)


def coarsened(crystal, model, axes, made) -> LinearTwin:
    """Silling's coarsening of a relaxed crystal to the nodes of a `TwinBody` (see `upscaling.coarsening`).

    The springs are those of nodes on the crystal's own lattice; the run's cell may strain it a little.
    """
    fc, C = _springs_of(crystal, model, axes)
    step, turned = made.step_cc, fc.crystal
    own = np.rint(step @ np.linalg.inv(turned.vectors)) @ turned.vectors
    size, wanted = np.linalg.norm(own, axis=1), np.linalg.norm(step, axis=1)
    off = np.linalg.norm(step - own, axis=1) / wanted
    if not (off <= _STRAIN).all():
        u = turned.units
        length = ", ".join(f"{u.to_user('length', d):.5g}" for d in wanted)
        a = u.to_user("length", np.linalg.norm(turned.conventional[0]))
        raise AtcError(
            "[twin] material: coarsened keeps cells of the crystal as nodes, but the steps from node to node "
            f"({length} {u.label('length')}) are up to {100 * off.max():.2g} % off its lattice vectors: take a spacing "
            f"that divides the run's cell in multiples of the lattice constant ({a:.5g}), and the run's orient"
        )
    kernel = coarsen(fc, C, own, made.body.horizon * size.max() / wanted.max())
    kernel = replace(kernel, step_cc=step, volume=abs(np.linalg.det(step)))
    return LinearTwin(pd.Linear(kernel), C, *hill(C.C_vv), kernel, wave_constants(kernel), C.C_vv)


def kept_place(reference, crystal, axes) -> np.ndarray:
    """(3,) where a cell of the crystal near the middle of a reference has its centre of mass: a node of `coarsened`."""
    from .smoothed import basis_of

    turned = crystal.strained(axes.T - np.eye(3))
    centre = turned.masses @ turned.positions / turned.masses.sum()
    k = int(np.argmin(np.linalg.norm(reference.positions - reference.cell.cartesian(np.full((1, 3), 0.5)), axis=1)))
    return reference.positions[k] - (turned.positions[basis_of(reference, turned)[k]] - centre)


def _springs_of(crystal, model, axes):
    """Force constants and elastic constants of a relaxed crystal turned to its axes."""
    turned = crystal.strained(axes.T - np.eye(3))
    fc, C = force_constants(turned, model), elastic_constants(turned, model)
    require_stable(crystal, C.stable)
    return fc, C


def measured(crystal, axes, made, traj) -> LinearTwin:
    """Springs from the fluctuations of a run of the perfect crystal in equilibrium (see `upscaling.fluctuations`)."""
    found = fluctuations(traj, crystal.strained(axes.T - np.eye(3)))
    if found.elastic is None:
        raise AtcError(f'{crystal.name}: material = "measured" is for crystals of one atom a cell: take "linear"')
    if not found.elastic.stable:
        raise AtcError(
            f"{found.source}: the elastic constants of its fluctuations are not those of a stable crystal: the run is "
            "too short, or no equilibrium"
        )
    out = on_nodes(found.fc, found.elastic, made, atoms=False)
    out.found = found
    return out


def on_nodes(fc, C, made, atoms: bool) -> LinearTwin:
    """The springs of force constants on the nodes of a `TwinBody`."""
    if atoms:
        kernel = LatticeSprings(fc)
        material = pd.Linear(kernel)
        sampled = C.C_vv
    else:
        kernel = node_kernel(fc, C, made.step_cc, made.body.horizon)
        material = pd.Linear(kernel)
        sampled = wave_constants(kernel)
    return LinearTwin(material, C, *hill(C.C_vv), kernel, sampled, C.C_vv)


class LatticeSprings:
    """Force constants of a crystal of one atom a cell on the bonds of a body whose nodes are its atoms.

    Parameters
    ----------
    fc : ForceConstants
    """

    def __init__(self, fc):
        if len(fc.crystal) > 1:
            raise AtcError(
                f'{fc.crystal.name}: nodes = "atoms" with linear is for crystals of one atom a cell: force constants '
                "of others turn their bonds, which no spring between two nodes does; leave nodes out"
            )
        self.fc = fc

    def springs(self, body) -> np.ndarray:
        """(b, 3, 3) of every bond; 0 of those that the crystal does not have."""
        from scipy.spatial import cKDTree

        fc, t = self.fc, body.bonds
        near = np.linalg.norm(fc.r_bc, axis=1).min()
        d, which = cKDTree(fc.r_bc).query(t.xi_bc(body.X_nc))
        off = t.sums(np.minimum(d, near)) / np.maximum(t.sums(np.ones(len(t))), 1) / near
        if not (off < _OFF).all():
            k = int(np.argmax(off))
            raise AtcError(
                f"atom {k + 1} of the reference is not at a place of the crystal (its bonds are {off[k]:.2g} of the "
                'nearest neighbours\' distance off): nodes = "atoms" with linear needs a reference that is the crystal '
                "of structure, lattice_constant and orient"
            )
        return np.where((d < _OFF * near)[:, None, None], -fc.phi_bcc[which], 0.0)
