"""What forces of all materials share: the kinds of bonds, weights, the walk through the rows, what broke."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ..blocks import Blocks, Crew, collect, node_rows
from ..damage import DamageRule
from ..standing import Standing
from .influence import influence_function, of_vector, sampled_influence
from .rows import force_loop

AT_ONCE = 1 << 20


@dataclass
class BondForces:
    """The force in every intact bond of a state: what the stress estimators read. Same conventions as
    `atc.bonds.Bonds`, plus vectors.

    Attributes
    ----------
    i, j : (b,) int32, each unordered bond once
    r_bc : (b, 3) y_i − y_j, current positions, through the bond's image
    R_bc : (b, 3) X_i − X_j, reference positions, through the same image
    F_bc : (b, 3) force on i from j (force density × V_i V_j); the force on j is −F
    G_b : (b,) with F = −G r, or None where forces do not act along the bond (correspondence)
    bond_b : (b,) index of each bond in `body.bonds`
    """

    i: np.ndarray
    j: np.ndarray
    r_bc: np.ndarray
    R_bc: np.ndarray
    F_bc: np.ndarray
    G_b: np.ndarray | None
    bond_b: np.ndarray

    def __len__(self):
        return len(self.i)

    def add(self, pull_b) -> None:
        """Forces `pull_b` more along the deformed bonds, pulling their ends together."""
        r = np.sqrt(np.einsum("bc,bc->b", self.r_bc, self.r_bc))
        self.G_b = self.G_b + np.divide(pull_b, r, out=np.zeros(len(r)), where=r > 0)
        self.F_bc = -self.G_b[:, None] * self.r_bc

    def bonds(self):
        """As `atc.bonds.Bonds`; raises AtcError for forces that are not central."""
        from ...bonds import Bonds

        if self.G_b is None:
            raise AtcError(
                "the forces of this material do not act along its bonds: use the estimators that take force vectors"
            )
        return Bonds(self.i, self.j, self.r_bc, self.G_b)


class ForceModel:
    """The bond forces of a body made of one or several materials of one class.

    Subclasses set up per-bond arrays and fill ``F`` in `forces`. `z` is (n, 8) from `node_rows`: displacement and
    reference position of every node, side by side, and two columns for the model's own use.
    """

    def __init__(self, body, materials: dict, crew: Crew, rules=None, lammps_compat=False):
        self.body, self.crew, self.materials, self.lammps_compat = body, crew, materials, lammps_compat
        # LAMMPS takes extensions below 2.2e-16 for none, in whatever unit of length: a strain of 2e-13 in bonds of a
        # millimetre.
        self.guard = 2.2204e-16 if lammps_compat else 0.0
        self.table = body.bonds
        self.n = len(body)
        self.blocks = Blocks(self.table, self.n)
        ids = sorted(materials)
        index = {m: k for k, m in enumerate(ids)}
        missing = set(np.unique(body.material_n).tolist()) - set(ids)
        if missing:
            raise AtcError(
                f"the body's nodes are made of material {sorted(missing)[0]}, which has no definition: materials "
                f"given are {ids}"
            )
        self.ids = ids
        self.first = materials[ids[0]]
        m = len(ids)
        self.kinds = {(a, b): index[a] * m + index[b] if m > 1 else 0 for a in ids for b in ids if index[a] <= index[b]}
        if m > 1:
            where = np.searchsorted(ids, body.material_n).astype(np.int64)
            a, b = where[self.table.i_b], where[self.table.j_b]
            self.kind_b = (np.minimum(a, b) * m + np.maximum(a, b)).astype(np.uint8 if m <= 16 else np.uint16)
            self.n_kinds = m * m
        else:
            self.kind_b = np.zeros(0, np.uint8)
            self.n_kinds = 1
        self.rule = DamageRule(rules, ids, self.kinds, self.n_kinds)
        if self.rule.Gc is not None and not self.counts_work:
            raise AtcError(
                f"damage: {self.first.name} breaks by a critical stretch: a critical energy is for lps, elastic, "
                "viscoelastic and plastic"
            )
        # Translations of the images, and what a strain of the cell adds to them.
        self.images = np.zeros((len(self.table.images_tc), 6))
        self.images[:, :3] = self.table.images_tc
        # Force and smallest stretch of a node.
        self.buf = self.blocks.buffer(4)
        self.largest_smin = -np.inf
        self.gone_b = np.empty(len(self.table), np.int32)
        self._standing = None

    def weights(self):
        """(b,) ω ν V_i V_j."""
        t, body, first = self.table, self.body, self.first
        same = {(m.influence, m.volume_correction, m.surface_correction) for m in self.materials.values()}
        if len(same) > 1:
            raise AtcError(
                f"{first.name}: the materials of one body must share influence function, volume correction and "
                "surface correction"
            )
        W = body.V_n[t.i_b]
        W *= body.V_n[t.j_b]
        if of_vector(first.influence) and first.directed:
            W *= sampled_influence(first.influence, t.xi_bc(body.X_nc))
        elif first.influence != "one":
            W *= influence_function(first.influence)(t.r0_b, body.horizon)
        if first.volume_correction:
            W *= body.nu_b()
        return W

    def refuse_interfaces(self, interfaces):
        """Raise where bonds get what they do from their nodes' families."""
        if interfaces:
            raise AtcError(
                f"{self.first.name}: bonds of this material have no stiffness of their own that an interface could "
                "change; take pmb or lps, let the interface break, or leave it unbonded"
            )

    def interface_factor(self, interfaces):
        """(b,) how stiff bonds are relative to the default, or None where nothing says so. `interfaces` : {(a, b):
        factor}, or None."""
        if not interfaces:
            return None
        for pair in interfaces:
            for a in pair:
                if a not in self.ids:
                    raise AtcError(f"interfaces: there is no material {a!r} in this body; its materials are {self.ids}")
        for pair, factor in interfaces.items():
            if not (np.isscalar(factor) and np.isfinite(factor) and factor > 0):
                raise AtcError(
                    f"the interface of materials {pair[0]} and {pair[1]} needs a stiffness factor greater than 0, got "
                    f"{factor!r}"
                )
        return self.per_bond(self.pair_values(lambda a, b: interfaces.get((a, b), interfaces.get((b, a), 1.0))))

    def parts(self):
        """The numbers of all bonds, a million at a time: sums over them in numpy hold no more than that."""
        for a in range(0, len(self.table), AT_ONCE):
            yield np.arange(a, min(len(self.table), a + AT_ONCE))

    def per_node(self, of_material):
        """(n,) of_material(material) for each node's material."""
        values = np.array([of_material(self.materials[m]) for m in self.ids], float)
        return values[np.searchsorted(self.ids, self.body.material_n)]

    def lame_n(self):
        """(n,) λ and (n,) μ that act in the body's dimension, of each node's material."""
        lam, mu = zip(*(self.materials[m].lame(self.body) for m in self.ids))
        which = np.searchsorted(self.ids, self.body.material_n)
        return np.array(lam, float)[which], np.array(mu, float)[which]

    def at_rest(self):
        """(n, 8) rows of nodes that are where they are made."""
        rest = node_rows(self.n)
        rest[:, 3:6] = self.body.X_nc
        return rest

    def at_ends(self, i, j, at_i, at_j=None):
        """(n,) sums over bonds of what each gives to its two ends, to both alike without `at_j`."""
        return np.bincount(i, at_i, self.n) + np.bincount(j, at_i if at_j is None else at_j, self.n)

    def per_bond(self, values_by_kind):
        """(b,) from one value a kind; a scalar where there is only one."""
        values = np.asarray(values_by_kind, float)
        return values[self.kind_b] if len(self.kind_b) else values[0]

    def pair_values(self, of_pair):
        """(kinds,) of_pair(material a, material b) in the order of the kinds."""
        out = np.zeros(self.n_kinds)
        for (a, b), k in self.kinds.items():
            out[k] = of_pair(a, b)
        return out

    @property
    def s_low(self):
        """No bond with a stretch up to this can break: a quick test for whole rows."""
        if self.largest_smin == -np.inf:
            return np.inf
        worst = max(self.largest_smin, 0.0)
        return float(np.min(self.rule.s00 - self.rule.alpha * worst))

    def resume(self, smin_n):
        """Take up a state's smallest stretches (after a restart)."""
        finite = smin_n[smin_n < np.inf]
        self.largest_smin = float(finite.max()) if len(finite) else -np.inf

    def pull(self, rows, gather, law, z, data, F_nc, smin_n, damage):
        """F_nc := forces of the bonds in `rows` (a `Standing`), as `law` says (see `rows.force_loop`). Returns the
        numbers in `rows` of those that broke."""
        bl = self.blocks
        gone_k = np.zeros(bl.count, np.int64)
        blocks = bl.edges, bl.lo, bl.offset
        bonds = rows.start_n, rows.j_b, rows.image_b, rows.intact_b, rows.kind_b
        rule = self.rule.s00, self.rule.alpha, smin_n, self.s_low, damage
        out = self.buf, self.gone_b, gone_k
        self.crew.run(force_loop(gather, law), bl.count, blocks, bonds, self.images, z, data, rule, *out)
        largest = self.crew.nodes(collect, self.n, bl.lo, bl.hi, bl.offset, self.buf, F_nc, smin_n, damage)
        if damage:
            self.largest_smin = max(largest)
        # A block lists its broken bonds from its first bond on.
        first = rows.start_n[bl.edges[:-1]]
        parts = [
            first[k] + self.gone_b[first[k] : first[k] + gone_k[k]].astype(np.int64) for k in np.flatnonzero(gone_k)
        ]
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)

    def over_blocks(self, kernel, rows, z, *more):
        """Run a kernel over the bonds in `rows` (a `Standing`, or the table), block by block."""
        bl = self.blocks
        bonds = rows.start_n, rows.j_b, rows.image_b
        self.crew.run(kernel, bl.count, bl.edges, bl.lo, bl.hi, bl.offset, *bonds, self.images, z, *more)

    def walk(self, z, rows, gather, law, data, F_nc, smin_n, damage, seen=None):
        """What `forces` returns, by a law of `rows.force_loop` that sees `seen` of the nodes, by default z."""
        gone = self.pull(rows, gather, law, z if seen is None else seen, data, F_nc, smin_n, damage)
        return self.account(z, rows.broke(gone))

    # To be given by subclasses.
    def forces(self, z, intact_b, F_nc, smin_n, damage: bool):
        """F_nc := bond forces. With `damage`, smin_n is renewed and bonds break. Returns (number broken, energy lost
        with them, and None or their last pull (i, j, F_bc))."""
        raise NotImplementedError

    def energy_n(self, z, intact_b):
        """(n,) strain energy of each node (half of each bond, or the node's own)."""
        raise NotImplementedError

    def forces_of_bonds(self, z, intact_b, bonds) -> BondForces:
        """The forces in the numbered bonds; intact_b None means in the state of the last call of `forces`."""
        raise NotImplementedError

    def bond_force_parts(self, z, intact_b):
        """What `bond_forces` gives, a million bonds at a time."""
        self.refresh(z, intact_b)
        for b in self.parts():
            yield self.forces_of_bonds(z, None, b[intact_b[b] != 0])

    #: Whether bonds can break by the work done on them.
    counts_work = False

    #: Whether forces depend on the past: then `remember` takes the state's history up and `advance` tells the step that
    #: the next forces are for; `taken` is what that step dissipated.
    remembers = False
    taken = 0.0

    #: (b,) extensions of bonds at rest; None without a temperature.
    rest_b = None

    def remember(self, history):
        """Go on from a state's history."""

    def advance(self, dt):
        """The next forces are those a time `dt` later."""

    def heat(self, rise_n):
        """Take up that temperatures have risen by `rise_n` (n,)."""
        raise AtcError(f"temperature: {self.first.name} has no thermal expansion: take lps or elastic, with expansion")

    def refresh(self, z, intact_b):
        """Bring what nodes know of their families to this state, for `forces_of_bonds` with intact_b None. Bonds that
        are on their own need nothing."""

    def lost(self, z, which) -> float:
        """The energy that left with the bonds `which`, just broken."""
        raise NotImplementedError

    def bond_forces(self, z, intact_b) -> BondForces:
        """The forces in all intact bonds."""
        return self.forces_of_bonds(z, intact_b, np.flatnonzero(intact_b))

    def standing(self, intact_b, *columns) -> Standing:
        """What the kernels are to walk in this state; `columns` are (b,) arrays that go with the bonds."""
        if self._standing is None:
            self._standing = Standing(self.table, self.crew, self.kind_b, *columns)
        self._standing.follow(intact_b)
        return self._standing

    def account(self, z, which):
        """What `forces` returns for the bonds that broke: their number, the energy lost, and their last pull (i, j,
        F_bc)."""
        if not len(which):
            return 0, 0.0, None
        f = self.forces_of_bonds(z, None, which)
        return len(which), self.lost(z, which), (f.i, f.j, f.F_bc)

    def stiffness_n(self):
        """(n,) a bound on the row sums of the stiffness matrix: ω_max² ≤ max 2 stiffness/(ρV)... see
        `Simulation.stable_step`."""
        raise NotImplementedError

    def contact_constant(self):
        """(kinds,) the PMB constant c that contact multiplies by 15."""
        c = {m: self.materials[m].contact_micromodulus(self.body) for m in self.ids}
        return self.pair_values(lambda a, b: harmonic(c[a], c[b]))


def along_bonds(i, j, eta, xi, pull_b, length_b, which) -> BondForces:
    """Forces along the deformed bonds `which`. `length_b` turns the pull into G = pull/length; 0 of bonds without
    extent."""
    G = np.divide(pull_b, length_b, out=np.zeros(len(length_b)), where=length_b > 0)
    y = xi + eta
    return BondForces(i, j, -y, -xi, G[:, None] * y, G, which)


def harmonic(a, b):
    """Springs in series."""
    return 2.0 * a * b / (a + b)


def deformed(model, z, bonds=None):
    """i, j, η, ξ, e and |ξ+η| of every bond (or those numbered): the plain numpy version of what the kernels do."""
    t, body = model.table, model.body
    b = slice(None) if bonds is None else bonds
    i, j = t.i_b if bonds is None else t.rows_of(bonds), t.j_b[b]
    xi = body.X_nc[j] - body.X_nc[i]
    if len(t.image_b):
        xi += t.images_tc[t.image_b[b]]
    eta = z[j, :3] - z[i, :3]
    if len(t.image_b):
        eta += model.images[t.image_b[b], 3:]
    q = np.einsum("bc,bc->b", eta, 2 * xi + eta)
    r0 = t.r0_b[b]
    r = np.sqrt(np.maximum(r0 * r0 + q, 0.0))
    return i, j, eta, xi, q / (r + r0), r
