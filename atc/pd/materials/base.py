"""What all materials share: elastic constants in 1, 2 and 3 dimensions, influence functions, the kinds of bonds, and
the force model's interface."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ..blocks import Blocks, Crew, collect
from ..bonds import HORIZON_SLACK
from ..damage import DamageRule
from ..standing import Standing
from .rows import force_loop

AT_ONCE = 1 << 20

INFLUENCE = {
    "one": lambda r, delta: np.ones_like(r),
    "inverse": lambda r, delta: 1.0 / r,
    "linear": lambda r, delta: np.clip(1.0 - r / delta, 0.0, None),
    "quadratic": lambda r, delta: np.clip(1.0 - (r / delta) ** 2, 0.0, None),
    "gaussian": lambda r, delta: np.exp(-((2.0 * r / delta) ** 2)),
}


def influence_function(which):
    """ω(|ξ|, δ) by name, or the user's own vectorised function of both."""
    if of_vector(which):
        raise AtcError(
            "influence: a function of the bond's vector, one argument, has no values by length alone, and makes all "
            "but correspondence and bond-associated materials anisotropic: give those one of (|xi|, horizon)"
        )
    if callable(which):
        return which
    if which not in INFLUENCE:
        raise AtcError(
            f"influence function {which!r} is not known: use one of {', '.join(INFLUENCE)}, or a function of (|xi|, "
            "horizon)"
        )
    return INFLUENCE[which]


def of_vector(influence) -> bool:
    """Whether an influence function is one of ξ, with its direction: it takes one argument."""
    if not callable(influence):
        return False
    try:
        parameters = list(inspect.signature(influence).parameters.values())
    except ValueError:
        return False
    return len(parameters) == 1 and parameters[0].kind in (
        inspect.Parameter.POSITIONAL_ONLY,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
    )


def sampled_influence(influence, xi_bc):
    """(b,) ω of bond vectors; refused where ω(ξ) is negative, or not ω(−ξ)."""
    ahead, back = (np.asarray(influence(xi), float) for xi in (xi_bc, -xi_bc))
    for w in (ahead, back):
        if w.shape != (len(xi_bc),):
            raise AtcError(
                f"influence: it gave shape {w.shape} for {len(xi_bc)} bond vectors, expected ({len(xi_bc)},)"
            )
        if not (np.isfinite(w) & (w >= 0)).all():
            raise AtcError("influence: it must be a number, 0 or more, of every bond vector")
    if not np.abs(ahead - back).max(initial=0.0) <= 1e-10 * ahead.max(initial=0.0):
        raise AtcError(
            "influence: it must be even, that of xi and -xi the same, or the two ends of a bond weigh it differently"
        )
    return 0.5 * (ahead + back)


def sphere_measure(dimension: int, thickness: float):
    """Surface of the unit sphere in this dimension × thickness (2-D) or cross-section (1-D): dV = this · r^(d−1) dr."""
    return {1: 2.0 * thickness, 2: 2.0 * np.pi * thickness, 3: 4.0 * np.pi}[dimension]


def moment(influence, body, power: int):
    """∫ω|ξ|^power dV over the horizon."""
    d, delta, surface = body.dimension, body.horizon, sphere_measure(body.dimension, body.thickness)
    if influence == "one":
        return surface * delta ** (d + power) / (d + power)
    from scipy.integrate import quad

    if of_vector(influence):
        raise AtcError(
            "influence: with one of the bond's direction an energy per area depends on the plane: give a critical "
            "stretch, s00, instead of Gc"
        )
    omega = influence_function(influence)
    return surface * quad(lambda r: float(omega(np.array([r]), delta)[0]) * r ** (d - 1 + power), 0, delta)[0]


#: Mean of |cos| over all directions, by dimension: of a bond of length r, |cos| r crosses a plane.
MEAN_COS = {1: 1.0, 2: 2 / np.pi, 3: 0.5}


def critical_work(Gc, body, volume_correction=True):
    """w_c of a bond, per volumes of its ends (and their share ν, with `volume_correction`), with which all bonds across
    a plane together cost Gc per area: of a lattice, the plane where its sum is least, which a crack takes."""
    if body.step_cc is None:
        # Every direction counts a bond twice.
        return Gc / (0.5 * moment("one", body, 1) * MEAN_COS[body.dimension])
    return Gc / least_cut(body, volume_correction)


def least_cut(body, volume_correction=True) -> float:
    """Σ ν V_i V_j over the bonds that a plane between the nodes of a body's lattice crosses, per area; of the plane
    that crosses least."""
    d, step = body.dimension, body.step_cc[: body.dimension, : body.dimension]
    reach = np.ceil(body.horizon * np.linalg.norm(np.linalg.inv(step), axis=0)).astype(int)
    n = np.stack(np.meshgrid(*(np.arange(-k, k + 1) for k in reach), indexing="ij"), axis=-1).reshape(-1, d)
    xi = n @ step
    r = np.linalg.norm(xi, axis=1)
    # Of ±ξ one.
    inside = (r > 0) & (r <= body.horizon * (1 + HORIZON_SLACK)) & (np.arange(len(r)) > len(r) // 2)
    xi, r = xi[inside], r[inside]
    V = abs(np.linalg.det(step)) * (body.thickness if d < 3 else 1.0)
    weight = V * (body.share(r) if volume_correction else np.ones(len(r)))
    # The sum over |ξ·n| is least for an n normal to bonds: to short ones, whose planes cross few.
    short = xi[np.argsort(r, kind="stable")[:13]]
    if d == 1:
        normals = np.ones((1, 1))
    elif d == 2:
        normals = short[:, ::-1] * [1.0, -1.0]
    else:
        normals = np.cross(short[:, None], short[None]).reshape(-1, 3)
    size = np.linalg.norm(normals, axis=1)
    normals = normals[size > 1e-9 * size.max()] / size[size > 1e-9 * size.max(), None]
    return float((np.abs(normals @ xi.T) @ weight).min())


def bond_based_shear(body, youngs=None, bulk=None):
    """μ (= λ) of a bond-based body, whose Poisson's ratio is 1/4 (plane stress 1/3), from Young's or the bulk
    modulus."""
    poisson = 1 / 3 if body.dimension == 2 and body.plane == "stress" else 1 / 4
    E = youngs if youngs is not None else 3 * bulk * (1 - 2 * poisson)
    return E / 3 if body.dimension == 1 else E / (2 * (1 + poisson))


def micromodulus(body, shear, influence="one"):
    """c of a bond-based body: W = ¼ c ∫ω|ξ| (tr² + 2ε:ε)/(d(d+2)) is that of λ = μ."""
    d = body.dimension
    return 2 * d * (d + 2) * shear / moment(influence, body, 1)


class Material:
    """Base of the materials. `volume_correction`: the share ν of volumes near the horizon. `surface_correction`: None
    or "energy"."""

    name = "material"
    by_numbers = True  # whether constants alone define it
    springs = True  # whether the energy of a bond grows like the square of its stretch
    directed = False  # whether its influence function may be one of the bond's vector
    volume_correction = True
    surface_correction = None
    influence = "one"

    def lame(self, body):
        """(λ, μ) that act in the body's dimension; in 1-D λ = μ = E/3, so that λ + 2μ is Young's modulus."""
        raise NotImplementedError

    def interface_energy(self, other, body, interface=1.0):
        """Energy per area to stretch all bonds across the plane between this material and another to 1: each end of a
        bond has its half.

        `interface` : the stiffness of the bonds relative to the default.
        """
        return interface * 0.5 * (self.fracture_energy(body, 1.0) + other.fracture_energy(body, 1.0))

    def uniaxial(self, body):
        """The modulus of a thin bar (in plane strain: of a strip) of this body, pulled along one axis and free along
        the others."""
        lam, mu = self.lame(body)
        if body.dimension == 1:
            return lam + 2 * mu
        if body.dimension == 2:
            return 4 * mu * (lam + mu) / (lam + 2 * mu)
        return mu * (3 * lam + 2 * mu) / (lam + mu)

    def poisson(self, body):
        """Contraction over extension of a bar of this body pulled along one axis."""
        lam, mu = self.lame(body)
        return {1: 0.0, 2: lam / (lam + 2 * mu), 3: lam / (2 * (lam + mu))}[body.dimension]


class Isotropic(Material):
    """Two elastic constants: any two of bulk and shear modulus, Young's modulus and Poisson's ratio, always the
    three-dimensional ones.

    In a plate λ is that of plane stress or plane strain.
    """

    def __init__(self, bulk=None, shear=None, *, youngs=None, poisson=None):
        given = {k: v for k, v in dict(bulk=bulk, shear=shear, youngs=youngs, poisson=poisson).items() if v is not None}
        if set(given) == {"youngs", "poisson"}:
            bulk, shear = youngs / (3 * (1 - 2 * poisson)), youngs / (2 * (1 + poisson))
        elif set(given) != {"bulk", "shear"}:
            raise AtcError(
                f"{self.name}: give bulk and shear, or youngs and poisson; got {', '.join(given) or 'nothing'}"
            )
        if not (bulk > 0 and shear > 0 and np.isfinite(bulk + shear)):
            raise AtcError(
                f"{self.name}: bulk and shear modulus must be positive, got bulk {bulk:g} and shear {shear:g}"
            )
        self.bulk, self.shear = float(bulk), float(shear)

    def lame(self, body):
        K, G = self.bulk, self.shear
        lam = K - 2.0 * G / 3.0
        if body.dimension == 1:
            E = 9.0 * K * G / (3.0 * K + G)
            return E / 3.0, E / 3.0
        if body.dimension == 2 and body.plane == "stress":
            lam = 2.0 * lam * G / (lam + 2.0 * G)
        return lam, G

    def contact_micromodulus(self, body):
        """c of the bond-based material of this bulk modulus: 18K/(πδ⁴) in 3-D. Contact takes 15 times that."""
        return micromodulus(body, bond_based_shear(body, bulk=self.bulk))

    def fracture_energy(self, body, s0):
        """Energy per area to stretch all bonds across a plane to s0, their shares in b alone: (9/5) K δ s0² for ω =
        1/|ξ| and K = 5G/3.

        For correspondence an estimate, since there a bond has no energy of its own.
        """
        d = body.dimension
        # Both ends' energies ½ (b/m) ω e² of each bond, with half the crossing volume |cos| r (every direction counts a
        # bond twice).
        b_over_m = d * (d + 2) * self.lame(body)[1] / moment(self.influence, body, 2)
        return 0.5 * b_over_m * s0**2 * moment(self.influence, body, 3) * MEAN_COS[d]


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
