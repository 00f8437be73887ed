"""The electron force field: nuclei and electrons that are spheres of charge with sizes of their own (LAMMPS
``eff/cut``).

At given sizes every term is a function of one distance. The sizes move on their own, so that the frames must show them
(columns spin and eradius).
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..atom_columns import ELECTRON, atom_columns
from ..registry import StyleInput, pair_style
from .input import one_cutoff_each
from .pairs import PairStyle

# Su & Goddard, Phys. Rev. Lett. 99 (2007) 185003: ρ, and the scales of distances and sizes in the Pauli term.
_RHO, _SCALE_R, _SCALE_S = -0.2, 1.125, 0.9
_TWO_OVER_SQRT_PI = 2.0 / math.sqrt(math.pi)
# ħ²/m_e in units of energy·length², with LAMMPS's digits (measured: the kinetic energy of one electron is 3/2 of it
# over s²).
_HBAR2_OVER_M = {"electron": 1.0, "real": 175.7204421962007}
_NUCLEUS, _CORE = 0, 2


class ElectronForceField(PairStyle):
    """Coulomb energies of points and spheres, C q_i q_j erf(√2 r/a)/r with a² = s_i² + s_j², and the Pauli energy of
    electrons, all times a taper 1 − 35x⁴ + 84x⁵ − 70x⁶ + 20x⁷, x = r/cutoff; each electron has the kinetic energy
    3ħ²/(2 m s²) (Su & Goddard 2007, Jaramillo-Botero et al. 2011).

    Forces are the derivatives of this energy. LAMMPS's are too, except between particles closer than 1e-6 length units,
    whose force (below 1e-6 energy units per length) has the opposite sign there.

    The column spin says what a particle is: 0 a nucleus of charge q, ±1 an electron, 2 a nucleus with two core
    electrons of a fixed size.

    Parameters
    ----------
    cutoff : (n_types + 1, n_types + 1) internal lengths; constant : C, internal; hbar2_m : ħ²/m_e, internal
    """

    name = "eff/cut"
    weight = None
    needs_charges = True
    numbers = (("cutoff", "length"),)

    def __init__(self, cutoff, constant: float, hbar2_m: float, limit: bool = False):
        self._set(np.asarray(cutoff, float))
        self.constant, self.hbar2_m, self.limit = constant, hbar2_m, limit

    def prepare(self, frame):
        spin, size = atom_columns(frame, ELECTRON, "pair_style eff/cut").T
        known = np.isin(spin, (0, 1, -1, 2))
        if not known.all():
            what = (
                "a pseudo-core (effective core potentials are not supported)"
                if spin[~known][0] == 3
                else f"spin {spin[~known][0]:g}"
            )
            raise AtcError(
                f"{frame.source}: atom {frame.ids[~known][0]} is {what}: expected spin 0 (nucleus), 1, -1 (electrons) "
                "or 2 (fixed core)"
            )
        size = size * frame.units.length
        bad = (spin != _NUCLEUS) & ~(size > 0)
        if bad.any():
            raise AtcError(
                f"{frame.source}: electron {frame.ids[bad][0]} has the size {size[bad][0]:g} (eradius): it must be "
                "positive"
            )
        half = 0.5 * float(np.linalg.norm(frame.cell.vectors, axis=1).min())
        if self.limit and (np.abs(spin) == 1).any() and size[np.abs(spin) == 1].max() > half:
            raise AtcError(
                f"{frame.source}: an electron is larger than half the box, where limit/eradius holds it back: that "
                "energy is not supported"
            )
        return spin.astype(np.int64), np.ascontiguousarray(np.where(spin == _NUCLEUS, 0.0, size)), frame.charges

    def self_energy(self, frame):
        spin, size, q = self.prepare(frame)
        some = np.where(spin == _NUCLEUS, 1.0, size)
        kinetic = 1.5 * self.hbar2_m / some**2
        # The core's electrons with their nucleus, and with each other.
        held = self.constant * _TWO_OVER_SQRT_PI * (1.0 - 2.0 * math.sqrt(2.0) * q) / some
        return np.where(spin == _NUCLEUS, 0.0, np.where(spin == _CORE, 2.0 * kinetic + held, kinetic))

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _eff(types, i, j, d2, self.table, self.constant, self.hbar2_m, *prepared, U, G)


@pair_style("eff/cut")
def _eff_style(inp: StyleInput):
    if inp.units.name not in _HBAR2_OVER_M:
        raise inp.error(f"pair_style eff/cut goes with units electron or real, not {inp.units.name}")
    (rc,) = inp.numbers(inp.args[:1], [("cutoff", "length")])
    more = inp.args[1:]
    if "ecp" in more:
        raise inp.error(
            "pair_style eff/cut ... ecp: effective core potentials are not supported: all-electron and fixed-core "
            "models are"
        )
    odd = [w for w in more if w not in ("limit/eradius", "pressure/evirials")]
    if odd:
        raise inp.error(f"pair_style eff/cut: expected a cutoff, limit/eradius and pressure/evirials, got {odd[0]}")
    if "pressure/evirials" in more:
        inp.note(
            "pressure/evirials: what the sizes of electrons add to LAMMPS's pressure is no force between atoms and "
            "not in the stress"
        )
    cutoff = one_cutoff_each(inp, rc)
    inp.note("forces of electrons are those at the sizes that the frames show")
    hbar2_m = _HBAR2_OVER_M[inp.units.name] * inp.units.factor("energy") * inp.units.length**2
    return ElectronForceField(cutoff, inp.coulomb, hbar2_m, "limit/eradius" in more)


@njit(cache=True, nogil=True, error_model="numpy")
def _sphere(r, a):
    """erf(√2 r/a)/r and its derivative over r; a = 0: points."""
    if a == 0.0:
        return 1.0 / r, -1.0 / (r * r * r)
    k = math.sqrt(2.0) / a
    z = k * r
    z2 = z * z
    if z < 1e-2:
        return (
            _TWO_OVER_SQRT_PI * k * (1.0 - z2 * (1.0 / 3.0 - z2 * (0.1 - z2 / 42.0))),
            _TWO_OVER_SQRT_PI * k * k * k * (-2.0 / 3.0 + z2 * (0.4 - z2 / 7.0)),
        )
    u = math.erf(z) / r
    return u, (_TWO_OVER_SQRT_PI * k * math.exp(-z2) - u) / (r * r)


@njit(cache=True, nogil=True, error_model="numpy")
def _pauli(r, s, t, same):
    """The Pauli energy of two electrons in units of ħ²/m_e, and its derivative over r."""
    r, s, t = _SCALE_R * r, _SCALE_S * s, _SCALE_S * t
    a = s * s + t * t
    dT = 1.5 * (1.0 / (s * s) + 1.0 / (t * t)) - 2.0 * (3.0 * a - 2.0 * r * r) / (a * a)
    S2 = (2.0 * s * t / a) ** 3 * math.exp(-2.0 * r * r / a)
    up = (1.0 + S2) * (1.0 + S2)
    P, dP = -_RHO * S2 / (1.0 + S2), -_RHO / up
    if same:
        P, dP = S2 / (1.0 - S2) + (1.0 - _RHO) * S2 / (1.0 + S2), 1.0 / ((1.0 - S2) * (1.0 - S2)) + (1.0 - _RHO) / up
    # dS²/dr = −4 r S²/a, dΔT/dr = 8 r/a², r here the scaled one
    return P * dT, _SCALE_R * _SCALE_R * (P * 8.0 / (a * a) - dP * 4.0 * S2 / a * dT)


@njit(cache=True, nogil=True, error_model="numpy")
def _eff(types, i, j, d2, table, C, hbar2_m, spin, size, q, U, G):
    for b in range(len(d2)):
        m, n = i[b], j[b]
        rc2 = table[types[m], types[n], 0]
        if d2[b] >= rc2:
            continue
        r = math.sqrt(d2[b])
        u = g = 0.0
        # Each particle is a point of charge (a nucleus) and ν electrons of its size.
        zm, zn = (q[m] if spin[m] != 1 and spin[m] != -1 else 0.0), (q[n] if spin[n] != 1 and spin[n] != -1 else 0.0)
        vm, vn = abs(spin[m]), abs(spin[n])
        both = math.sqrt(size[m] * size[m] + size[n] * size[n])
        for z, a in ((zm * zn, 0.0), (-zm * vn, size[n]), (-zn * vm, size[m]), (float(vm * vn), both)):
            if z != 0.0:
                x, dx = _sphere(r, a)
                u += C * z * x
                g += C * z * dx
        if vm > 0 and vn > 0:
            # Of the electrons of two cores one pair of each spin each way: half of them have the same.
            alike = 0.0 if vm == 1 and vn == 1 and spin[m] != spin[n] else 1.0 if vm == 1 and vn == 1 else 0.5 * vm * vn
            for number, same in ((alike, True), (vm * vn - alike, False)):
                if number > 0.0:
                    x, dx = _pauli(r, size[m], size[n], same)
                    u += hbar2_m * number * x
                    g += hbar2_m * number * dx
        y = r / math.sqrt(rc2)
        y2 = y * y
        f = 1.0 + y2 * y2 * (-35.0 + y * (84.0 + y * (-70.0 + 20.0 * y)))
        # f'/r
        df = y2 * (-140.0 + y * (420.0 + y * (-420.0 + 140.0 * y))) / rc2
        U[b] += f * u
        G[b] += f * g + df * u
