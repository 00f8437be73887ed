"""Profiles by species along a normal, and electrostatics from the charges: density, velocity, charge density, field,
potential, dipoles.

Averages over cross-sections of area A, φ₁ the kernel's profile: number density n_s = Σ_{j∈s} φ₁(z − z_j)/A, charge
density ρ_q = Σ q_j φ₁(z − z_j)/A; Poisson's equation ε₀ dE/dz = ρ_q, E = −dψ/dz with ε₀ = 1/(4π C), C the Coulomb
constant of the units.
"""

from __future__ import annotations

import numpy as np

from ..deposit import make
from ..errors import AtcError
from ..readers.trajectory import Over
from .dipoles import add_dipoles, dipoles_of, labels_of
from .profile_table import Column, Profile, series_quotient

BOUNDARIES = ("auto", "periodic", "vacuum")
#: Charge of the cell, over the sum of the absolute charges, that digits of a file leave.
NEUTRAL = 1e-6


class Seen(Over):
    """Another trajectory, each of whose frames is added to `sums` when it is first read."""

    def __init__(self, base, sums: SpeciesSums):
        super().__init__(base)
        self.sums = sums

    def _frame(self, k):
        frame = self.base[k]
        self.sums.add(k, frame)
        return frame

    def rest(self) -> None:
        """Add what nobody has read here: other processes may have."""
        for k in range(len(self)):
            if k not in self.sums:
                self._frame(k)


def add_species(out: Profile, sums: SpeciesSums, boundary: str = "auto") -> None:
    """Add the profiles of species, and those of the charges and molecules where the frames have any.

    Parameters
    ----------
    out : Profile, with z
    boundary : "periodic" (no mean field in the cell: Ewald sums with a conductor around), "vacuum" (no field outside of
        the lower face), or "auto": vacuum where the cell is open along the normal or the run has `kspace_modify slab`

    Raises
    ------
    AtcError for another boundary, and for vacuum around a cell that is not neutral.
    """
    if boundary not in BOUNDARIES:
        raise AtcError(f"boundary={boundary!r}: expected one of {', '.join(BOUNDARIES)}")
    u = sums.units
    each = u.label("number_density")
    number_tzs, charge_tz, flow_tzsc, dipole_tzk = sums.arrays()
    for s, name in enumerate(sums.names):
        n_tz = number_tzs[:, :, s]
        label = f"n {name}"
        out.add(f"number_density_{name}", n_tz / u.factor("number_density"), each, label, "number density", "species")
    if charge_tz is not None:
        _add_charges(out, sums, charge_tz, boundary)
    if dipole_tzk is not None:
        add_dipoles(out, dipole_tzk, u)
        if sums.too_long:
            out.notes.append(
                f"dipoles: molecules that are longer than half the cell are left out ({sums.too_long} in all frames)"
            )
    if flow_tzsc is not None:
        _add_velocities(out, sums.names, u, number_tzs, flow_tzsc)


class SpeciesSums:
    """What is summed over atoms and molecules, frame by frame; internal units. Columns are 1 of each species, q where
    there are charges, and v of each species where there are velocities."""

    def __init__(self, pot, kern, grid):
        self.pot, self.kern, self.grid = pot, kern, grid
        self.kinds = None
        self.found: dict[int, tuple] = {}  # of each frame: sums (z, k), (z, 4) of molecules or None, height
        self.too_long = 0

    def __contains__(self, k: int) -> bool:
        return k in self.found

    def _begin(self, frame) -> None:
        from ..estimators.accuracy.random_points import kernel_internal

        self.kinds, self.units = np.unique(frame.types), frame.units
        self.kern = kernel_internal(self.kern, frame.units)
        self.names = _species_names(frame, self.kinds)
        self.moving = frame.velocities is not None
        self.charged = frame.charges is not None and bool(frame.charges.any())
        self.polar = self.charged and frame.dimension == 3 and frame.masses is not None
        self.polar = self.polar and labels_of(frame) is not None
        self.slab = self.pot is not None and any(term.slab is not None for term in self.pot.fields)
        self.net = frame.charges.sum() / np.abs(frame.charges).sum() if self.charged else 0.0

    def add(self, k: int, frame) -> None:
        """The frame of number `k`, if it is not there already."""
        if k in self.found:
            return
        frame = frame if self.pot is None else self.pot.complete(frame)
        if self.kinds is None:
            self._begin(frame)
        if not np.isin(frame.types, self.kinds).all() or (self.charged and frame.charges is None):
            raise AtcError(
                f"{frame.source}: has species or lacks charges that the first frame has: profiles by species need the "
                "same in every frame"
            )
        bound = self.grid.bind(frame.units, frame.cell, frame.positions)
        one_ns = (frame.types[:, None] == self.kinds).astype(float)
        a_nk = [one_ns]
        if self.charged:
            a_nk.append(np.zeros((len(frame), 1)))
        if self.moving:
            frame.require("velocities", why="profiles of velocity")
            a_nk.append((one_ns[:, :, None] * frame.velocities[:, None, :]).reshape(len(frame), -1))
        a_nk, carriers = np.concatenate(a_nk, axis=1), self._carriers(frame)
        if len(carriers) > len(frame):
            a_nk = carriers.padded(a_nk)
        if self.charged:
            a_nk[:, len(self.kinds)] = carriers.charges
        sums_zk = self._sum(bound, carriers.positions, a_nk)
        polar_zk = None
        if self.polar:
            if labels_of(frame) is None:
                raise AtcError(f"{frame.source}: does not say which atoms are molecules, as the first frame does")
            frame.require("masses", why="dipoles of molecules")
            x_mc, along, cosine, long = dipoles_of(carriers, bound.axis)
            self.too_long += long
            a_mk = np.stack([np.ones(len(along)), along, cosine, 1.5 * cosine**2 - 0.5], axis=1)
            polar_zk = self._sum(bound, x_mc, a_mk)
        self.periodic = bool(bound.cell.periodic[bound.axis])
        self.found[k] = sums_zk, polar_zk, bound.cell.heights[bound.axis]

    def _carriers(self, frame):
        """What the charges sit on: the atoms, and virtual sites if the potential has any, each in its molecule."""
        carriers = frame if self.pot is None else self.pot.carriers(frame)
        labels = labels_of(frame) if len(carriers) > len(frame) else None
        if labels is None:
            return carriers
        return carriers.replace(molecules=np.concatenate([labels, labels[carriers.places.host_s]]))

    def _sum(self, bound, x_nc, a_nk):

        deposit = make("slab", bound, self.kern, bound.cell, a_nk.shape[1], 1)
        if len(x_nc):
            deposit.add_sites(np.ascontiguousarray(x_nc), a_nk)
        return deposit.site_sums()

    def arrays(self):
        """number_tzs, charge_tz, flow_tzsc (Σ v φ₁/A by species), dipole_tzk; None for what the frames do not have."""
        s, frames = len(self.kinds), sorted(self.found)
        sums_tzk = np.array([self.found[k][0] for k in frames])
        charge_tz = sums_tzk[:, :, s] if self.charged else None
        flow = sums_tzk[:, :, s + self.charged :]
        flow_tzsc = flow.reshape(*flow.shape[:2], s, 3) if self.moving else None
        polar = np.array([self.found[k][1] for k in frames]) if self.polar else None
        return sums_tzk[:, :, :s], charge_tz, flow_tzsc, polar if polar is not None and polar.any() else None

    @property
    def height_t(self):
        return np.array([self.found[k][2] for k in sorted(self.found)])


def _species_names(frame, kinds) -> list[str]:
    """Names that the source knows, where they tell species apart; else type1, type2 ..."""
    names = [str(frame.type_names.get(int(k), f"type{k}")) for k in kinds]
    return names if len({*names}) == len(names) else [f"type{k}" for k in kinds]


def field_and_potential(charge_tz, height_t, coulomb, vacuum: bool):
    """E (t, z) along the normal and the potential ψ (t, z), 0 at the lower face, of charge densities (t, z) at the
    middles of equal bins; by Fourier series, exact for what the bins resolve. The mean charge is left out (a uniform
    background)."""
    bins = charge_tz.shape[1]
    k = np.arange(1, (bins - 1) // 2 + 1)
    q_tk = 2j * np.pi * k / np.reshape(height_t, (-1, 1))
    rho_tk = np.fft.rfft(charge_tz, axis=1)[:, 1 : len(k) + 1] / bins
    E_tk = 4 * np.pi * coulomb * rho_tk / q_tk
    psi_tk = -E_tk / q_tk
    # The first point is half a bin above the face.
    at_face = np.exp(-2j * np.pi * k * 0.5 / bins)

    def values(f_tk):
        modes = np.zeros((len(f_tk), bins // 2 + 1), complex)
        modes[:, 1 : len(k) + 1] = f_tk
        return np.fft.irfft(modes * bins, n=bins, axis=1), 2.0 * (f_tk * at_face).real.sum(axis=1)[:, None]

    E_tz, E_face = values(E_tk)
    psi_tz, psi_face = values(psi_tk)
    psi_tz = psi_tz - psi_face
    if vacuum:
        x = (np.arange(bins) + 0.5) / bins * np.reshape(height_t, (-1, 1))
        E_tz, psi_tz = E_tz - E_face, psi_tz + E_face * x
    return E_tz, psi_tz


def _add_charges(out, sums, charge_tz, boundary) -> None:
    u = sums.units
    if u.dimension == 2:
        out.notes.append("electric field and potential are left out: a run in the plane has no layers of charge")
        return
    vacuum = boundary == "vacuum" or (boundary == "auto" and (sums.slab or not sums.periodic))
    if abs(sums.net) > NEUTRAL:
        if vacuum:
            raise AtcError(
                f"{out.source}: the cell has a net charge ({sums.net:.1e} of all its charges): with vacuum around it "
                "the field has no meaning in a periodic layer; boundary = 'periodic' takes a uniform background off"
            )
        out.warnings.append(
            "the cell has a net charge: field and potential are those with a uniform background against it"
        )
    E_tz, psi_tz = field_and_potential(charge_tz, sums.height_t, u.coulomb, vacuum)
    length, charge = u.label("length"), u.label("charge")
    out.add(
        "charge_density", charge_tz / (u.factor("charge") / u.factor("length") ** 3), f"{charge}/{length}^3",
        "charge density", "charge density", "charges",
    )  # fmt: skip
    # Internal energy per charge is the volt: eV/e.
    volt, name = (
        (1.0, "V") if not u.reduced else (u.factor("energy") / u.factor("charge"), f"{u.label('energy')}/{charge}")
    )
    out.add("electric_field", E_tz * u.factor("length") / volt, f"{name}/{length}", "E", "electric field", "charges")
    out.add("potential", psi_tz / volt, name, "ψ", "potential", "charges")
    out.notes.append(
        "electric field and potential: "
        + ("no field below the lower face (vacuum)" if vacuum else "no mean field in the cell (periodic)")
        + ", the potential is 0 at the lower face"
    )


def _add_velocities(out, names, u, number_tzs, flow_tzsc) -> None:
    """Mean velocities <n v>/<n>; NaN where a species never is."""

    for s, name in enumerate(names):
        mean, stderr, correlated = series_quotient(flow_tzsc[:, :, s], number_tzs[:, :, s])
        for c, direction in enumerate("xyz"[: u.dimension]):
            out.columns[f"velocity_{direction}_{name}"] = Column(
                u.to_user("velocity", mean[:, c]), u.to_user("velocity", stderr[:, c]), u.label("velocity"),
                f"v_{direction} {name}", f"v_{direction}", correlated[:, c], "velocities",
            )  # fmt: skip
