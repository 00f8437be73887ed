"""Force constants of a crystal, and the dynamical matrix D(k), its frequencies and group velocities, from them.

Pair potentials: Φ = −(G 1 + G' r⊗r) for the two ends of a bond, G' = dG/dξ. Anything else: displaced atoms in a
supercell so large that no image is ambiguous, central differences of sixth order. Internal units throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..decomposers.pairs.pairs import Pairs
from ..errors import AtcError
from ..neighbors.cell_list import neighbor_list
from .crystal import STENCIL, Crystal, forces, of_atc

#: Frequencies in THz per internal angular frequency: 1/(2π) of the time in which amu Å²/t² is 1 eV, in ps (CODATA
#: 2018).
THZ = 1.0 / (2 * np.pi * 0.01018050571075936)

# Central difference of eighth order.
_STENCIL8 = ((1, 0.8), (2, -0.2), (3, 4.0 / 105.0), (4, -1.0 / 280.0))


def frequency_unit(units) -> tuple[str, float]:
    """What frequencies ω/2π are reported in, and its size: user's = factor · internal ω. THz, or 1/tau for reduced
    units."""
    return ("1/tau", 1 / (2 * np.pi)) if units.reduced else ("THz", THZ)


@dataclass
class ForceConstants:
    """Second derivatives of the energy: Φ of every pair of atoms that feel each other, one end in the home cell.

    Attributes
    ----------
    crystal : Crystal
    i, j : (b,) basis atoms; every ordered pair is there, so each bond occurs from both ends
    r_bc : (b, 3) from atom i to atom j
    phi_bcc : (b, 3, 3) ∂²U/∂u_i∂u_j (minus the spring constant: negative for a stable bond along it)
    reach : the largest |r| that was looked at
    method : "analytic" or "displacements"
    defect : how far the force constants were from translational invariance and symmetry before these were imposed,
        relative to the largest
    """

    crystal: Crystal
    i: np.ndarray
    j: np.ndarray
    r_bc: np.ndarray
    phi_bcc: np.ndarray
    reach: float
    method: str
    defect: float = 0.0

    @property
    def onsite_ncc(self) -> np.ndarray:
        """(n, 3, 3) Φ of each atom with itself: minus the sum over its bonds, so that translations cost nothing."""
        out = np.zeros((len(self.crystal), 3, 3))
        np.add.at(out, self.i, -self.phi_bcc)
        return out

    def dynamical_matrix(self, k_kc) -> np.ndarray:
        """(k, 3n, 3n) Hermitian: Σ Φ exp(i k·r)/√(m m'), r between the atoms themselves (not their cells). Eigenvalues
        ω²."""
        return _D(self, np.atleast_2d(np.asarray(k_kc, float)))

    def onsite_matrix(self) -> np.ndarray:
        """(3n, 3n) D of bonds that average to nothing: what D(k) tends to when the bonds are smeared out (see
        `lattice_kernel`)."""
        n = len(self.crystal)
        out = np.zeros((3 * n, 3 * n))
        for a, phi in enumerate(self.onsite_ncc):
            out[3 * a : 3 * a + 3, 3 * a : 3 * a + 3] = phi / self.crystal.masses[a]
        return 0.5 * (out + out.T)

    def gradient(self, k_kc, e_c) -> np.ndarray:
        """(k, 3n, 3n) derivative of D along the unit vector(s) e (3,) or (k, 3)."""
        return _D(self, np.atleast_2d(np.asarray(k_kc, float)), np.asarray(e_c, float))

    def frequencies(self, k_kc, vectors: bool = False):
        """(k, 3n) angular frequencies in ascending order, imaginary ones (ω² < 0) as negative numbers; with `vectors`
        the eigenvectors too."""
        values, modes = np.linalg.eigh(self.dynamical_matrix(k_kc))
        omega = signed_root(values)
        return (omega, modes) if vectors else omega

    def group_velocities(self, k_kc, e_c) -> np.ndarray:
        """(k, 3n) dω/d|k| along e, branches as in `frequencies`; NaN where ω is 0 or imaginary. Degenerate branches are
        resolved within themselves."""
        k = np.atleast_2d(k_kc)
        return group_velocities(self.dynamical_matrix(k), self.gradient(k, e_c))

    def folded(self, repeat) -> np.ndarray:
        """(n, atoms, 3, 3) force constants of a `repeat` supercell (`Crystal.supercell` order): what phonopy calls
        compact force constants."""
        crystal, n = self.crystal, len(self.crystal)
        repeat = np.array(repeat)
        between = self.r_bc - crystal.positions[self.j] + crystal.positions[self.i]
        shift = np.rint(between @ np.linalg.inv(crystal.vectors)).astype(int)
        cell = np.ravel_multi_index((shift % repeat).T, repeat)
        out = np.zeros((n, n * int(repeat.prod()), 3, 3))
        np.add.at(out, (self.i, cell * n + self.j), self.phi_bcc)
        out[np.arange(n), np.arange(n)] += self.onsite_ncc
        return out


def signed_root(values):
    """√x, and −√−x for negative x: an imaginary frequency shown as a negative one."""
    return np.sign(values) * np.sqrt(np.abs(values))


def group_velocities(D, dD) -> np.ndarray:
    """(k, m) dω/dk of D's branches by Hellmann and Feynman; degenerate branches are separated by dD within their own
    space."""
    values, modes = np.linalg.eigh(D)
    out = np.full(values.shape, np.nan)
    for p in range(len(values)):
        top = np.abs(values[p]).max() or 1.0
        start = 0
        for end in range(1, values.shape[1] + 1):
            if end < values.shape[1] and values[p, end] - values[p, end - 1] < 1e-9 * top:
                continue
            e = modes[p][:, start:end]
            slope = np.linalg.eigvalsh(e.conj().T @ dD[p] @ e)
            ok = values[p, start:end] > 1e-10 * top
            out[p, start:end][ok] = slope[ok] / (2 * np.sqrt(values[p, start:end][ok]))
            start = end
    return out


def _D(fc: ForceConstants, k_kc, e=None):
    crystal, n = fc.crystal, len(fc.crystal)
    out = np.zeros((len(k_kc), n, 3, n, 3), complex)
    weight = fc.phi_bcc / np.sqrt(crystal.masses[fc.i] * crystal.masses[fc.j])[:, None, None]
    phase = np.exp(1j * (k_kc @ fc.r_bc.T))
    if e is not None:
        phase = phase * 1j * (np.broadcast_to(e, k_kc.shape) @ fc.r_bc.T)
    for a in range(n):
        for b in range(n):
            which = np.flatnonzero((fc.i == a) & (fc.j == b))
            out[:, a, :, b, :] = np.tensordot(phase[:, which], weight[which], axes=1)
    if e is None:
        onsite = fc.onsite_ncc / crystal.masses[:, None, None]
        for a in range(n):
            out[:, a, :, a, :] += onsite[a]
    D = out.reshape(len(k_kc), 3 * n, 3 * n)
    return 0.5 * (D + D.conj().transpose(0, 2, 1))


def force_constants(
    crystal: Crystal, model, *, reach: float | None = None, method: str = "auto", step: float = 1e-3
) -> ForceConstants:
    """Force constants of a crystal under a potential of `atc.potential` or an ASE calculator.

    Parameters
    ----------
    crystal : Crystal
        Atoms at rest; otherwise the harmonic expansion has a linear term, and the result is that of the point given.
    model : Potential or ASE calculator
    reach : float, optional
        How far two atoms feel each other, in the user's unit of length. Default: the cutoff for pair potentials, twice
        that otherwise (two neighbours of a third atom). An ASE calculator needs it said.
    method : "auto", "analytic" (pair potentials only) or "displacements"
    step : displacement of the differences, in internal length; sixth order, so that 1e-3 Å leaves rounding only

    Returns
    -------
    ForceConstants, exactly symmetric and translation invariant; `defect` says how much had to be mended (rounding).

    Raises
    ------
    AtcError for a model whose reach is not known, or whose forces reach further than was said.
    """
    if method not in ("auto", "analytic", "displacements"):
        raise AtcError(f"method {method!r}: expected auto, analytic or displacements")
    pairs = _pair_terms(model)
    if method == "analytic" and pairs is None:
        raise AtcError("analytic force constants are for potentials of pair styles only: use method='displacements'")
    if pairs is not None and method != "displacements":
        return _analytic(crystal, model, pairs)
    if reach is None:
        if not of_atc(model):
            raise AtcError(f"{type(model).__name__}: say how far its forces reach with reach=, e.g. twice its cutoff")
        reach = model.cutoff * (1.0 if pairs is not None else 2.0)
        if reach <= 0:
            raise AtcError("the potential has bonded terms only, so its reach is not known: say it with reach=")
    else:
        reach = crystal.units.to_internal("length", float(reach))
    return _displacements(crystal, model, reach, step)


def _pair_terms(model):
    """The pair terms of a potential that is nothing but pair terms, or None."""
    terms = model.terms if of_atc(model) else ()
    return terms if terms and all(isinstance(t, Pairs) for t in terms) else None


def _analytic(crystal: Crystal, model, terms) -> ForceConstants:
    frame = crystal.frame()
    i, j, r, _ = neighbor_list(frame.positions, frame.cell, model.cutoff, half=False)
    d2 = np.einsum("bc,bc->b", r, r)
    G, Gp = np.zeros(len(i)), np.zeros(len(i))
    types = frame.types.astype(np.int32)
    for term in terms:
        work = term.prepare(frame)  # checks types and charges
        for s, prepared in zip(work.term.styles, work.prepared, strict=True):
            cut2 = s.table[types[i], types[j], 0]
            inside = np.flatnonzero(d2 < cut2)
            if not len(inside):
                continue

            def g(x, inside=inside, s=s, prepared=prepared):
                U, G = np.zeros(len(inside)), np.zeros(len(inside))
                s.add(types, i[inside], j[inside], np.ascontiguousarray(x), np.zeros(0), U, G, prepared)
                return G

            x = d2[inside]
            # The difference stays on this side of the cutoff, where G may have a step.
            h = np.minimum(5e-4 * x, (cut2[inside] - x) / 4.5)
            G[inside] += g(x)
            # ξ is half of the squared distance.
            Gp[inside] += 2.0 * sum(w * (g(x + m * h) - g(x - m * h)) for m, w in _STENCIL8) / h
    phi = -(G[:, None, None] * np.eye(3) + Gp[:, None, None] * r[:, :, None] * r[:, None, :])
    return ForceConstants(crystal, i.astype(int), j.astype(int), -r, phi, float(model.cutoff), "analytic")


def _displacements(crystal: Crystal, model, reach: float, step: float) -> ForceConstants:
    repeat = supercell_repeat(crystal, 2.0 * reach * 1.0001)
    frame, basis = crystal.supercell(repeat)
    x0, n = frame.positions, len(crystal)
    if len(frame) > 40000:
        raise AtcError(
            f"{crystal.name}: a reach of {reach:.3g} takes a supercell of {len(frame)} atoms: say a smaller one with "
            "reach="
        )
    parts, outside, largest = [], 0.0, 0.0
    for a in range(n):
        rows = np.zeros((len(frame), 3, 3))  # [atom, force component, displacement component]
        for c in range(3):
            for m, w in STENCIL:
                for sign in (1, -1):
                    x = x0.copy()
                    x[a, c] += sign * m * step
                    rows[:, :, c] += sign * w / step * forces(model, frame.replace(positions=x))
        phi = -rows
        r = nearest_images(x0 - x0[a], frame.cell.vectors)
        d = np.linalg.norm(r, axis=1)
        largest = max(largest, np.abs(phi).max())
        outside = max(outside, np.abs(phi[d > reach * 1.0001]).max(initial=0.0))
        keep = (d <= reach * 1.0001) & (np.abs(phi).max(axis=(1, 2)) > 0)
        parts.append((np.full(keep.sum(), a), np.flatnonzero(keep), r[keep], phi[keep].transpose(0, 2, 1)))
    if outside > 1e-7 * largest:
        raise AtcError(
            f"{crystal.name}: the forces reach further than {crystal.units.to_user('length', reach):.4g} "
            f"{crystal.units.label('length')} "
            f"(force constants of {outside / largest:.1e} of the largest beyond it): say a larger reach"
        )
    i, atom, r, phi = (np.concatenate(p) for p in zip(*parts))
    j = basis[atom]
    return _mended(crystal, i, j, r, phi, reach, largest)


def _mended(crystal, i, j, r, phi, reach, largest) -> ForceConstants:
    """Impose Φ_ij(r) = Φ_ji(−r)ᵀ and translational invariance; report how much that changed."""
    itself = np.linalg.norm(r, axis=1) < 1e-6
    onsite = np.zeros((len(crystal), 3, 3))
    np.add.at(onsite, i[itself], phi[itself])
    i, j, r, phi = i[~itself], j[~itself], r[~itself], phi[~itself]
    from scipy.spatial import cKDTree

    tag = 100.0 * reach  # keeps pairs of different atoms of the basis apart
    key = np.column_stack([r, i * tag, j * tag])
    distance, back = cKDTree(key).query(np.column_stack([-r, j * tag, i * tag]))
    # A pair whose mirror image was exactly 0 and therefore left out has nothing to be averaged with but 0.
    other = np.where((distance < 1e-4)[:, None, None], phi[back].transpose(0, 2, 1), 0.0)
    defect = np.abs(phi - other).max(initial=0.0)
    fc = ForceConstants(crystal, i, j, r, 0.5 * (phi + other), reach, "displacements")
    fc.defect = float(max(defect, np.abs(fc.onsite_ncc - onsite).max()) / largest)
    return fc


def supercell_repeat(crystal: Crystal, shortest: float) -> np.ndarray:
    """Repetitions along the primitive vectors so that no lattice vector of the supercell is shorter than `shortest`."""
    heights = 1.0 / np.linalg.norm(np.linalg.inv(crystal.vectors), axis=0)
    repeat = np.maximum(1, np.ceil(0.5 * shortest / heights)).astype(int)
    near = np.array([m for m in np.ndindex(7, 7, 7) if m != (3, 3, 3)]) - 3
    while np.linalg.norm(near @ (crystal.vectors * repeat[:, None]), axis=1).min() < shortest:
        # Lengthen the direction that is the shortest now.
        lengths = np.linalg.norm(crystal.vectors, axis=1) * repeat
        repeat[np.argmin(lengths)] += 1
    return repeat


def nearest_images(r, vectors):
    """The shortest image of each vector of r (n, 3) under the lattice `vectors` (rows), also for skewed cells."""
    s = r @ np.linalg.inv(vectors)
    base = (s - np.floor(s)) @ vectors
    best, d2 = base.copy(), np.full(len(r), np.inf)
    for m in np.ndindex(4, 4, 4):
        x = base + (np.array(m) - 2) @ vectors
        l2 = np.einsum("bc,bc->b", x, x)
        closer = l2 < d2
        best[closer], d2[closer] = x[closer], l2[closer]
    return best
