"""The material ``smoothed`` of a twin: the potential itself as a peridynamic force state.

Atoms stand where the nodes' displacements put them, x_k = X_k + Σ_J N_J(X_k) u_J; the energy is the potential's of all
of them, and the force on a node its exact gradient, F_J = Σ_k N_J(X_k) f_k. Σ_J N_J = 1, so that momentum is conserved
as the potential conserves it; N is linear-complete, so that homogeneous deformations are exact; with a node at every
atom N is the identity, and the body is the atoms. Atoms of a basis have inner displacements of their own,
Σ_J N_J(X_k) s_J, at rest at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from ..errors import AtcError
from ..frame import Cell, Frame
from ..pd.materials.base import Material
from ..pd.materials.force_model import ForceModel
from ..upscaling.elasticity import elastic_constants
from ..upscaling.force_constants import force_constants
from .material import TwinMaterial, hill
from .smoothing import with_images

#: Rounds that inner displacements have to come to rest, what is rest, in nearest neighbours' distances, and how many
#: rounds are remembered.
_ROUNDS, _AT_REST, _MEMORY = 60, 1e-9, 8
#: The share of an inner node's atoms that a node must have for inner displacements of its own.
_WHOLE = 0.95
#: The least eigenvalue of the moments of an atom's nodes, in squares of their distance, that still spans space.
_SPAN = 0.02


class Shape:
    """N_J(X_k) of the atoms of a frame on the nodes of a lattice, or on the atoms themselves.

    weights_kJ : sparse (atoms, nodes). shift_kc : (atoms, 3) Σ N T of the nodes' images that an atom sees
    """

    def __init__(self, reference, X_nc=None, step_cc=None):
        from scipy.sparse import csr_array, eye_array

        n = len(reference)
        if X_nc is None:
            self.weights_kJ, self.shift_kc = csr_array(eye_array(n)), np.zeros((n, 3))
            return
        from scipy.spatial import cKDTree

        inverse = np.linalg.inv(step_cc)
        x, cell = reference.positions, reference.cell
        wide = 2.0 * np.linalg.norm(np.abs(step_cc).sum(axis=0))
        nodes, of = with_images(Frame(X_nc, cell, reference.units), wide)
        image = nodes - X_nc[of]
        tree = cKDTree(nodes @ inverse)
        rows, columns, values, shift = [], [], [], np.zeros((n, 3))
        home, _ = cell.wrap(x)
        lift = x - home  # atoms outside the cell see the nodes of their own image
        for k in range(n):
            for width in (1.0, 1.5, 2.0):
                near = np.array(tree.query_ball_point(home[k] @ inverse, width * 3**0.5), int)
                d = (nodes[near] - home[k]) @ inverse
                w = np.prod(np.clip(1 - np.abs(d) / width, 0, None), axis=1)
                near, d, w = near[w > 1e-12], d[w > 1e-12], w[w > 1e-12]
                if not len(w):
                    continue
                N = _linear_complete(d, w)
                if N is not None:
                    break
            else:
                raise AtcError(
                    f"{reference.source}: atom {reference.ids[k]} has too few nodes around it that carry it: take a "
                    "smaller spacing in [twin]"
                )
            rows.append(np.full(len(near), k))
            columns.append(of[near])
            values.append(N)
            shift[k] = N @ (image[near] + lift[k])
        self.weights_kJ = csr_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n, len(X_nc))
        )
        self.shift_kc = shift


def _linear_complete(d, w):
    """Weights with Σ N = 1 and Σ N d = 0: those of the hats if they are, else moving least squares; None where the
    nodes do not span space."""
    N = w / w.sum()
    if abs(w.sum() - 1) < 1e-9 and np.abs(N @ d).max() < 1e-9:
        return N
    p = np.column_stack([np.ones(len(d)), d])
    M = p.T @ (w[:, None] * p)
    if len(w) < 4 or np.linalg.eigvalsh(M / w.sum())[0] < _SPAN:
        return None
    return w * (p @ np.linalg.solve(M, [1.0, 0, 0, 0]))


class Smoothed(Material):
    """Nodes that carry the atoms of a reference frame along, under the atoms' own potential (internal units).

    Parameters
    ----------
    model : Potential. reference : Frame. shape : Shape
    fc : ForceConstants of the crystal, for the stable step and inner displacements
    basis_k : (atoms,) which atom of the basis each is; all 0 for crystals of one atom a cell
    """

    name = "smoothed"
    by_numbers = False
    volume_correction = False

    def __init__(self, model, reference, shape, fc, basis_k):
        self.potential, self.reference, self.shape, self.fc, self.basis_k = model, reference, shape, fc, basis_k

    def lame(self, body):
        raise AtcError("smoothed: the atoms' own potential is no isotropic elastic law")

    def contact_micromodulus(self, body):
        raise AtcError("smoothed: atoms touch by their own potential: leave contact out")


class SmoothedModel(ForceModel):
    """Forces of the potential on the atoms that the nodes displace, taken back to the nodes."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        if self.rule.active or interfaces or len(materials) > 1:
            raise AtcError(
                "smoothed: a body of this material has no bonds to break and no interfaces: the potential breaks it"
            )
        self.N = self.first.shape.weights_kJ
        self.Nt = self.N.T.tocsr()
        fc = self.first.fc
        m = len(fc.crystal)
        kinds = self.first.basis_k
        self.inner_Jbc = np.zeros((self.n, m, 3))
        self.count_Jb = np.stack([self.Nt @ (kinds == b).astype(float) for b in range(m)], axis=1)
        phi = np.zeros((m, 3, m, 3))
        np.add.at(phi, (fc.i, slice(None), fc.j), fc.phi_bcc)
        for a, onsite in enumerate(fc.onsite_ncc):
            phi[a, :, a] += onsite
        values, modes = np.linalg.eigh(phi.reshape(3 * m, 3 * m))
        inside = values > 1e-7 * np.abs(values).max(initial=0.0)
        self.give_xx = (modes[:, inside] / values[inside]) @ modes[:, inside].T
        # At surfaces the crystal's inner displacements are none: those of nodes with fewer atoms than inside stay.
        self.whole_J = (self.count_Jb > _WHOLE * np.median(self.count_Jb)).all(axis=1)
        self.near = float(np.linalg.norm(fc.r_bc, axis=1).min())
        row = np.bincount(fc.i, np.linalg.norm(fc.phi_bcc, ord=2, axis=(1, 2)), m).max()
        self.stiff_n = row * (abs(self.N).T @ np.ones(self.N.shape[0])) * float(abs(self.N).sum(axis=1).max())

    @property
    def gradient_cc(self):
        """(3, 3) H of the cell, from what it does to the images of nodes."""
        T, HT = self.images[:, :3], self.images[:, 3:]
        return np.linalg.lstsq(T, HT, rcond=None)[0].T if T.any() else np.zeros((3, 3))

    def atoms(self, z):
        """The frame of the atoms where the nodes put them, in the deformed cell."""
        first, H = self.first, self.gradient_cc
        ref = first.reference
        x = ref.positions + self.N @ z[:, :3] + first.shape.shift_kc @ H.T
        if self.inner_Jbc.shape[1] > 1:
            for b in range(self.inner_Jbc.shape[1]):
                mine = first.basis_k == b
                x[mine] += (self.N @ self.inner_Jbc[:, b])[mine]
        F = np.eye(3) + H
        cell = ref.cell
        return ref.replace(
            positions=x, cell=Cell(cell.vectors @ F.T, cell.origin @ F.T, cell.periodic), velocities=None, forces=None
        )

    def evaluated(self, z, **options):
        """The potential at the atoms' places, inner displacements at rest."""
        m = self.inner_Jbc.shape[1]
        moves, changes, last = [], [], None
        for _ in range(_ROUNDS):
            found = self.first.potential.stream(self.atoms(z), forces=True, **options)
            if m == 1:
                return found
            pull = np.stack(
                [self.Nt @ np.where((self.first.basis_k == b)[:, None], found.forces_nc, 0.0) for b in range(m)], axis=1
            )
            pull = np.divide(pull, self.count_Jb[..., None], out=pull, where=self.count_Jb[..., None] > 0)
            step = (pull.reshape(self.n, -1) @ self.give_xx * self.whole_J[:, None]).ravel()
            if not np.abs(step).max() < 0.3 * self.near:
                break
            if np.abs(step).max() < _AT_REST * self.near:
                return found
            # Anderson's acceleration: nodes share atoms, so that steps of each one's own are not the whole way.
            go = step
            if last is not None:
                changes.append(step - last)
                D, M = (np.array(v[-_MEMORY:]).T for v in (changes, moves))
                gamma = np.linalg.lstsq(D, step, rcond=None)[0]
                go = step - (M + D) @ gamma
            moves.append(go)
            last = step
            self.inner_Jbc += go.reshape(self.inner_Jbc.shape)
        raise AtcError("smoothed: the inner displacements of the crystal's basis find no rest: the crystal has failed")

    def forces(self, z, intact_b, F_nc, smin_n, damage: bool):
        F_nc[:] = self.Nt @ self.evaluated(z).forces_nc
        return 0, 0.0, None

    def energy_n(self, z, intact_b):
        return self.Nt @ self.evaluated(z, energies=True).energies_n

    def bond_force_parts(self, z, intact_b):
        """The forces in the bonds of the atoms, for what asks how large they are."""
        found = []
        self.first.potential.stream(self.atoms(z), lambda bonds, _: found.append(bonds.forces().copy()))
        for F in found:
            yield SimpleNamespace(F_bc=F)

    def forces_of_bonds(self, z, intact_b, bonds):
        raise AtcError("smoothed: nodes have no bonds: take the fields of the atoms that they carry")

    def stiffness_n(self):
        return self.stiff_n


Smoothed.model = SmoothedModel


@dataclass
class SmoothedTwin(TwinMaterial):
    """The atoms' own potential on the nodes (internal units).

    material : Smoothed. C : ElasticConstants. bulk, shear : Hill averages
    """

    carries_atoms = True

    material: Smoothed
    C: object
    bulk: float
    shear: float
    atoms: bool

    @property
    def crystal_vv(self) -> np.ndarray:
        return self.C.C_vv

    def lines(self, units) -> list[str]:
        """What it is, what it gets exactly and what not: for a person."""
        n = len(self.material.fc.crystal)
        return [
            "material: smoothed, the run's own potential at the atoms' places as the nodes carry them, forces its "
            "exact gradient" + ("; inner displacements of the basis at rest" if n > 1 else ""),
            "exact: momentum, homogeneous deformations of any size"
            + ("; with a node at every atom it is molecular dynamics" if self.atoms and n == 1 else ""),
            "not exact: waves shorter than a few distances of nodes, surfaces (nodes carry whole layers of atoms, "
            "whose basis does not rearrange)",
        ]

    def frame(self, simulation):
        """The atoms that the nodes carry now, and their potential: what fields are made of."""
        model = simulation.model
        made = model.atoms(simulation._z)
        return made.replace(velocities=model.N @ simulation.state.v_nc), self.material.potential


def smoothed(crystal, model, axes, reference, made, atoms: bool) -> SmoothedTwin:
    """The material on the nodes of a `TwinBody`; their masses become those of the atoms that they carry."""
    turned = crystal.strained(axes.T - np.eye(3))
    C = elastic_constants(turned, model)
    shape = Shape(reference) if atoms else Shape(reference, made.body.X_nc, made.step_cc)
    mass = shape.weights_kJ.T @ reference.masses
    if not mass.min() > 0.02 * mass.max():
        raise AtcError(
            "smoothed: some nodes would carry hardly any atoms: take a larger spacing, or another kernel, in [twin]"
        )
    made.body.V_n = mass / made.body.rho_n
    fc = force_constants(turned, model)
    return SmoothedTwin(Smoothed(model, reference, shape, fc, basis_of(reference, turned)), C, *hill(C.C_vv), atoms)


def basis_of(reference, crystal) -> np.ndarray:
    """(atoms,) which atom of the crystal's basis each atom is, for basis atoms at different places of the cell.

    Raises AtcError where atoms are not at the crystal's places.
    """
    n = len(crystal)
    if n == 1:
        return np.zeros(len(reference), int)
    inverse, best = np.linalg.inv(crystal.vectors), None
    for first in range(n):
        # Atom 0 taken for this atom of the basis.
        d = (
            reference.positions[:, None] - reference.positions[0] - crystal.positions + crystal.positions[first]
        ) @ inverse
        off = np.linalg.norm((d - np.rint(d)) @ crystal.vectors, axis=2)
        found = np.argmin(off, axis=1), np.percentile(off.min(axis=1), 90)
        best = found if best is None or found[1] < best[1] else best
    if best[1] > 0.5:
        u = reference.units
        off = f"{u.to_user('length', best[1]):.2g} {u.label('length')}"
        raise AtcError(
            f"{reference.source}: its atoms are not at the places of {crystal.name} (a tenth of them is more than "
            f"{off} off): smoothed needs a reference that is this crystal, see orient"
        )
    return best[0]
