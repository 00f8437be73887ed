"""Prototype microelastic brittle material (Silling 2000; R 3.0.5-3.0.7): every bond a spring of its own.

Pairwise force F_ij = c s ν V_i V_j along the deformed bond, s = (|ξ+η| − |ξ|)/|ξ|. The extension is computed from
displacements, e = η·(2ξ+η)/(|ξ+η|+|ξ|), so that a body at rest is exactly at rest wherever it is.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ...compiled import njit, specialise, tag_of
from ...errors import AtcError
from ..bonds import JIT
from ..lanes import INLINE, C, gather
from ..surface import surface_factors
from .base import Material
from .force_model import ForceModel, along_bonds, deformed, harmonic
from .influence import MEAN_COS, bond_based_shear, micromodulus, moment
from .rows import eights, lengthened, note

# Compiled into the loop, and called from Python.
CALLED = dict(INLINE, no_cpython_wrapper=False)


def bond_law(law):
    """Decorator of a bond's law, a function of its stretch s = (|ξ+η| − |ξ|)/|ξ| that numba can compile.

    It returns (a, b), the force c ω a s and the energy ½ c ω b s² |ξ| of the bond, c the micromodulus: a = b = 1 is a
    spring. b s² is twice the integral of a s, and a(0) = b(0) = 1 where c is to be the stiffness of small stretches.
    """
    return staticmethod(njit(**CALLED)(law))


@njit(**CALLED)
def linear(s):
    """A spring."""
    return 1.0, 1.0


class PMB(Material):
    """Prototype microelastic brittle: bond-based, so its Poisson's ratio is 1/4 (plane stress 1/3).

    Parameters
    ----------
    bulk : bulk modulus K; or youngs : Young's modulus E; or c : the micromodulus itself (force per volume² at unit
        stretch; LAMMPS's `c`).
        In 3-D c = 18K/(πδ⁴); in general c ∫ω|ξ| dV = 2d(d+2) μ with the shear modulus μ of the dimension.
    influence : ω(|ξ|, δ), "one" by default, a name of `INFLUENCE` or a function; f = c ω s
    volume_correction, surface_correction : see `Material`

    Attributes
    ----------
    law : what the bond's force and energy are beside those of a spring, `linear`; a subclass with another one is
        another bond-based material, see `bond_law`
    stiffening : the largest slope of s·a(s), on which the stable time step depends: 1 for a law that only softens
    """

    name = "pmb"
    elastic = True
    law = staticmethod(linear)
    stiffening = 1.0

    @property
    def springs(self):
        return self.law is linear

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

    def lame(self, body):
        d = body.dimension
        if self.c is None:
            mu = bond_based_shear(body, self.youngs, self.bulk)
        else:
            mu = self.c * moment(self.influence, body, 1) / (2 * d * (d + 2))
        return mu, mu

    def micromodulus(self, body):
        """c in this body: force per volume² at unit stretch (before ω)."""
        return float(self.c) if self.c is not None else micromodulus(body, self.lame(body)[1], self.influence)

    contact_micromodulus = micromodulus

    def interface_energy(self, other, body, interface=1.0):
        if isinstance(interface, PMB):
            c = interface.micromodulus(body)
        else:
            c = interface * harmonic(self.micromodulus(body), other.micromodulus(body))
        return c / self.micromodulus(body) * self.fracture_energy(body, 1.0)

    def fracture_energy(self, body, s0):
        """Energy per area to stretch all bonds across a plane to s0: 9/5 K δ s0² in 3-D."""
        # Bonds of length r across a plane, per area: (solid angle mean of |cos|)/2 · r each way; each costs ½ c ω s0²
        # r.
        crossing = moment(self.influence, body, 2) * MEAN_COS[body.dimension] / 2
        return 0.5 * self.micromodulus(body) * self.law(s0)[1] * s0**2 * crossing


class BondModel(ForceModel):
    """Springs between nodes: PMB, for one or several materials (between two, the springs in series: 2 c_a c_b/(c_a +
    c_b), or an interface's own)."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        self.law = self.first.law
        if any(m.law is not self.law for m in materials.values()):
            raise AtcError(f"{self.first.name}: the materials of one body must share the law of their bonds")
        c = {m: materials[m].micromodulus(body) for m in self.ids}
        self.c_k = self.pair_values(lambda a, b: harmonic(c[a], c[b]))
        self.W_b = self.weights() * self.per_bond(self.c_k)
        if self.first.surface_correction is not None:
            self.W_b *= surface_factors(body, self.W_b, materials)
        # After the surface correction, which would make up for a weak interface.
        factors = dict(interfaces or {})
        for pair, own in factors.items():
            if isinstance(own, PMB):
                factors[pair] = own.micromodulus(body) / harmonic(*(c.get(m, 1.0) for m in pair))
        factor = self.interface_factor(factors)
        if factor is not None:
            self.W_b *= factor

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        rows = self.standing(intact_b, self.table.r0_b, self.W_b)
        data = (*rows.columns, self.guard)
        return self.walk(z, rows, gather, _law_of_rows(self.law), data, F_nc, smin_n, damage)

    def lost(self, z, which):
        e = deformed(self, z, which)[4]
        return float((0.5 * self.W_b[which] / self.table.r0_b[which] * self._law(e, which)[1] * e**2).sum())

    def _law(self, e, which):
        """The law's two factors at extensions e of the numbered bonds."""
        if self.law is linear:
            return 1.0, 1.0
        s = e / self.table.r0_b[which]
        a, b = np.empty_like(s), np.empty_like(s)
        specialise(_factors, tag_of(self.law), JIT, LAW=self.law)(s, a, b)
        return a, b

    def energy_n(self, z, intact_b):
        energy = np.zeros(self.n)
        for b in self.parts():
            i, j, _, _, e, _ = deformed(self, z, b)
            half = 0.25 * self.W_b[b] * self._law(e, b)[1] * e**2 / self.table.r0_b[b] * (intact_b[b] != 0)
            energy += self.at_ends(i, j, half)
        return energy

    def forces_of_bonds(self, z, intact_b, whole):
        i, j, eta, xi, e, r = deformed(self, z, whole)
        pull = self.W_b[whole] * self._law(e, whole)[0] * e
        return along_bonds(i, j, eta, xi, pull, r * self.table.r0_b[whole], whole)

    def stiffness_n(self):
        return self.table.sums(self.first.stiffening * self.W_b / self.table.r0_b)

    def contact_constant(self):
        return self.c_k


PMB.model = BondModel


# Replaced in each copy, see `_law_of_rows`.
LAW = None


@cache
def _law_of_rows(law):
    """`_row` with a bond's law in it, for `rows.force_loop`."""
    return specialise(_row, tag_of(law), INLINE, LAW=law)


def _factors(s, a, b):
    for k in range(len(s)):
        a[k], b[k] = LAW(s[k])


def _row(m, b0, i, node, w, v, intact, data):
    r0, W, guard = data
    for k in range(eights(m, b0, intact)):
        # Unsigned: no test for negative indices, so that loads are whole vectors.
        b = np.uint64(b0) + np.uint64(k)
        L = r0[b]
        q, r = lengthened(k, w, L)
        # Extensions up to `guard` count as none.
        q = q if abs(q) > guard * (r + L) else 0.0
        D = r * (r + L) * L
        D = q / D if D > 0.0 else 0.0
        s = D * r if r > 0.0 else -1.0
        whole = intact[b] != 0
        K = W[b] * D * LAW(s)[0] if whole else 0.0
        w[k] = K * (w[3 * C + k] + w[k])
        w[C + k] = K * (w[4 * C + k] + w[C + k])
        w[2 * C + k] = K * (w[5 * C + k] + w[2 * C + k])
        note(k, w, s, whole)
