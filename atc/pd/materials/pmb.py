"""Prototype microelastic brittle material (Silling 2000; R 3.0.5-3.0.7): every bond a spring of its own.

Pairwise force F_ij = c s ν V_i V_j along the deformed bond, s = (|ξ+η| − |ξ|)/|ξ|. The extension is computed from
displacements, e = η·(2ξ+η)/(|ξ+η|+|ξ|), so that a body at rest is exactly at rest wherever it is.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..bonds import JIT
from ..lanes import INLINE, C, gather
from .base import BondForces, ForceModel, Material, deformed, harmonic, influence_function, sphere_measure
from .rows import close_row, open_block, settle


class PMB(Material):
    """Prototype microelastic brittle: bond-based, so its Poisson's ratio is 1/4 (plane stress 1/3).

    Parameters
    ----------
    bulk : bulk modulus K; or youngs : Young's modulus E; or c : the micromodulus itself (force per volume² at unit
        stretch; LAMMPS's `c`).
        In 3-D c = 18K/(πδ⁴); in general c ∫ω|ξ| dV = 2d(d+2) μ with the shear modulus μ of the dimension.
    influence : ω(|ξ|, δ), "one" by default, a name of `INFLUENCE` or a function; f = c ω s
    volume_correction, surface_correction : see `Material`
    """

    name = "pmb"

    def __init__(
        self, bulk=None, *, youngs=None, c=None, influence="one", volume_correction=True, surface_correction=None
    ):
        if sum(v is not None for v in (bulk, youngs, c)) != 1:
            raise AtcError("PMB needs exactly one of bulk (modulus), youngs (modulus) and c (micromodulus)")
        value = next(v for v in (bulk, youngs, c) if v is not None)
        if not (np.isfinite(value) and value > 0):
            raise AtcError(f"PMB: the modulus must be a positive number, got {value!r}")
        self.bulk, self.youngs, self.c = bulk, youngs, c
        self.influence = influence
        self.volume_correction, self.surface_correction = bool(volume_correction), surface_correction

    def _first_moment(self, body):
        """∫ω|ξ| dV over the horizon."""
        from scipy.integrate import quad

        d, delta = body.dimension, body.horizon
        surface = sphere_measure(d, body.thickness)
        if self.influence == "one":
            return surface * delta ** (d + 1) / (d + 1)
        omega = influence_function(self.influence)
        return surface * quad(lambda r: float(omega(np.array([r]), delta)[0]) * r**d, 0, delta)[0]

    def lame(self, body):
        d = body.dimension
        if self.c is not None:
            mu = self.c * self._first_moment(body) / (2 * d * (d + 2))
        else:
            poisson = 1 / 3 if d == 2 and body.plane == "stress" else 1 / 4
            E = self.youngs if self.youngs is not None else 3 * self.bulk * (1 - 2 * poisson)
            mu = E / 3 if d == 1 else E / (2 * (1 + poisson))
        return mu, mu

    def micromodulus(self, body):
        """c in this body: force per volume² at unit stretch (before ω)."""
        if self.c is not None:
            return float(self.c)
        d = body.dimension
        # W = ¼ c ∫ω|ξ| (tr² + 2ε:ε)/(d(d+2)) is that of λ = μ.
        return 2 * d * (d + 2) * self.lame(body)[1] / self._first_moment(body)

    contact_micromodulus = micromodulus

    def interface_energy(self, other, body, interface=1.0):
        c = (
            interface.micromodulus(body)
            if isinstance(interface, PMB)
            else interface * harmonic(self.micromodulus(body), other.micromodulus(body))
        )
        return c / self.micromodulus(body) * self.fracture_energy(body, 1.0)

    def fracture_energy(self, body, s0):
        """Energy per area to stretch all bonds across a plane to s0: 9/5 K δ s0² in 3-D."""
        from scipy.integrate import quad

        d, delta, c = body.dimension, body.horizon, self.micromodulus(body)
        omega = influence_function(self.influence)
        # Bonds of length r across a plane, per area: (solid angle mean of |cos|)/2 · r each way; each costs ½ c ω s0²
        # r.
        mean_cos = {1: 1.0, 2: 2 / np.pi, 3: 0.5}[d]
        moment = quad(lambda r: float(omega(np.array([r]), delta)[0]) * r ** (d + 1), 0, delta)[0] * sphere_measure(
            d, body.thickness
        )
        return 0.5 * c * s0**2 * moment * mean_cos / 2

    @staticmethod
    def model(*args, **options):
        return BondModel(*args, **options)


class BondModel(ForceModel):
    """Springs between nodes: PMB, for one or several materials (between two, the springs in series: 2 c_a c_b/(c_a +
    c_b), or an interface's own)."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        c = {m: materials[m].micromodulus(body) for m in self.ids}
        self.c_k = self.pair_values(lambda a, b: harmonic(c[a], c[b]))
        self.W_b = self.weights() * self.per_bond(self.c_k)
        if self.first.surface_correction is not None:
            from ..surface import surface_factors

            self.W_b *= surface_factors(body, self.W_b, materials)
        # After the surface correction, which would make up for a weak interface.
        factor = self.interface_factor(
            {
                p: own.micromodulus(body) / harmonic(*(c.get(m, 1.0) for m in p)) if isinstance(own, PMB) else own
                for p, own in (interfaces or {}).items()
            }
        )
        if factor is not None:
            self.W_b *= factor

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        t, bl = self.standing(intact_b, self.table.r0_b, self.W_b), self.blocks
        gone = np.zeros(bl.count, np.int64)
        self.crew.run(
            _forces,
            bl.count,
            bl.edges,
            bl.lo,
            bl.offset,
            t.start_n,
            t.j_b,
            t.image_b,
            self.images,
            z,
            *t.columns,
            self.guard,
            t.intact_b,
            t.kind_b,
            self.rule.s00,
            self.rule.alpha,
            smin_n,
            self.s_low,
            damage,
            self.buf,
            self.gone_b,
            gone,
        )
        self.collect(F_nc, smin_n, damage)
        return self.account(z, t.broke(self.listed(gone, t.start_n)))

    def lost(self, z, which):
        e = deformed(self, z, which)[4]
        return float((0.5 * self.W_b[which] / self.table.r0_b[which] * e**2).sum())

    def energy_n(self, z, intact_b):
        energy = np.zeros(self.n)
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            half = 0.25 * self.W_b[b] * e**2 / self.table.r0_b[b] * (intact_b[b] != 0)
            energy += np.bincount(i, half, self.n) + np.bincount(j, half, self.n)
        return energy

    def forces_of_bonds(self, z, intact_b, whole):
        i, j, eta, xi, e, r = deformed(self, z, whole)
        G = np.divide(self.W_b[whole] * e, r * self.table.r0_b[whole], out=np.zeros(len(whole)), where=r > 0)
        y = xi + eta
        return BondForces(i, j, -y, -xi, G[:, None] * y, G, whole)

    def stiffness_n(self):
        k = self.W_b / self.table.r0_b
        return self.table.sums(k)

    def contact_constant(self):
        return self.c_k


@njit(**INLINE)
def _row(m, b0, w, r0, W, intact, guard):
    """Forces of m bonds into columns 0-2 of w, stretches into column 6 (+∞ if broken) and 7 (−∞ if broken)."""
    for k in range(m):
        # Unsigned: no test for negative indices, so that loads are whole vectors.
        b = np.uint64(b0) + np.uint64(k)
        ex = w[k]
        ey = w[C + k]
        ez = w[2 * C + k]
        x = w[3 * C + k]
        y = w[4 * C + k]
        z = w[5 * C + k]
        q = ex * (x + x + ex) + ey * (y + y + ey) + ez * (z + z + ez)
        L = r0[b]
        r2 = L * L + q
        r = np.sqrt(r2 if r2 > 0.0 else 0.0)
        # Extensions up to `guard` count as none.
        q = q if abs(q) > guard * (r + L) else 0.0
        D = r * (r + L) * L
        D = q / D if D > 0.0 else 0.0
        s = D * r if r > 0.0 else -1.0
        whole = intact[b] != 0
        K = W[b] * D if whole else 0.0
        w[k] = K * (x + ex)
        w[C + k] = K * (y + ey)
        w[2 * C + k] = K * (z + ez)
        w[6 * C + k] = s if whole else np.inf
        w[7 * C + k] = s if whole else -np.inf


@njit(**JIT)
def _forces(
    first,
    last,
    edges,
    lo,
    offset,
    start,
    j,
    image,
    images,
    z,
    r0,
    W,
    guard,
    intact,
    kind,
    s00,
    alpha,
    smin,
    s_low,
    damage,
    buf,
    gone_b,
    gone_k,
):
    """Blocks first..last: forces and smallest stretches into their buffers. Broken bonds are listed in gone_b, block by
    block from the block's first bond on, gone_k of them."""
    w = np.empty(8 * C)
    node = np.empty(C + 8, np.int32)
    own = np.array([0.0, 0.0, 0.0, np.inf])
    for block in range(first, last):
        f = buf[offset[block] : offset[block + 1]]
        open_block(f)
        base = lo[block]
        b_first = start[edges[block]]
        gone = 0
        for i in range(edges[block], edges[block + 1]):
            for b0 in range(start[i], start[i + 1], C):
                m = min(C, start[i + 1] - b0)
                gather(b0, m, i, j, image, images, z, node, w)
                # Whole vectors of eight: lanes beyond the row have no displacement, and pull nothing.
                _row(min((m + 7) & ~7, len(r0) - b0), b0, w, r0, W, intact, guard)
                gone = settle(
                    m,
                    b0,
                    i,
                    base,
                    j,
                    node,
                    w,
                    f,
                    own,
                    intact,
                    kind,
                    s00,
                    alpha,
                    smin,
                    s_low,
                    damage,
                    b_first,
                    gone_b,
                    gone,
                )
            close_row(f[i - base], own)
        gone_k[block] = gone
