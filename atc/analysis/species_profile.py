"""Profiles by species along a normal, and electrostatics from the charges: density, velocity, charge density, field,
potential.

Averages over cross-sections of area A, φ₁ the kernel's profile: number density n_s = Σ_{j∈s} φ₁(z − z_j)/A, charge
density ρ_q = Σ q_j φ₁(z − z_j)/A; Poisson's equation ε₀ dE/dz = ρ_q, E = −dψ/dz with ε₀ = 1/(4π C), C the Coulomb
constant of the units.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .profile_table import Column, Profile

BOUNDARIES = ("auto", "periodic", "vacuum")
#: Charge of the cell, over the sum of the absolute charges, that digits of a file leave.
NEUTRAL = 1e-6


def add_species(out: Profile, frames, pot, kern, grid, boundary: str = "auto") -> None:
    """Add the profiles of species, and those of the charges where the frames have any.

    Parameters
    ----------
    out : Profile, with z
    frames : trajectory or list of Frames; pot : potential or None: what it knows of the atoms is used
    boundary : "periodic" (no mean field in the cell: Ewald sums with a conductor around), "vacuum" (no field outside of
        the lower face), or "auto": vacuum where the cell is open along the normal or the run has `kspace_modify slab`

    Raises
    ------
    AtcError for another boundary, and for vacuum around a cell that is not neutral.
    """
    if boundary not in BOUNDARIES:
        raise AtcError(f"boundary={boundary!r}: expected one of {', '.join(BOUNDARIES)}")
    sums = _Sums(frames, pot, kern, grid)
    u = sums.units
    each = u.label("number_density")
    for s, name in enumerate(sums.names):
        n_tz = sums.number_tzs[:, :, s]
        label = f"n {name}"
        out.add(f"number_density_{name}", n_tz / u.factor("number_density"), each, label, "number density", "species")
    if sums.charge_tz is not None:
        _add_charges(out, sums, boundary)
    if sums.flow_tzsc is not None:
        _add_velocities(out, sums)


class _Sums:
    """What is summed over the atoms, frame by frame; internal units. number_tzs, flow_tzsc (Σ v φ₁/A by species) and
    charge_tz; None for what the frames do not have."""

    def __init__(self, frames, pot, kern, grid):
        from ..deposit import make
        from ..estimators.accuracy.random_points import kernel_internal

        number, flow, charge, heights = [], [], [], []
        kinds = None
        for frame in frames:
            frame = frame if pot is None else pot.complete(frame)
            if kinds is None:
                kinds, self.units, kern = np.unique(frame.types), frame.units, kernel_internal(kern, frame.units)
                self.names = _species_names(frame, kinds)
                moving, charged = frame.velocities is not None, frame.charges is not None and frame.charges.any()
                self.slab = pot is not None and any(term.slab is not None for term in pot.fields)
            if not np.isin(frame.types, kinds).all() or (charged and frame.charges is None):
                raise AtcError(f"{frame.source}: has species or lacks charges that the first frame has: profiles by "
                               "species need the same in every frame")  # fmt: skip
            bound = grid.bind(frame.units, frame.cell, frame.positions)
            one_ns = (frame.types[:, None] == kinds).astype(float)
            a_nk = [one_ns]
            if charged:
                a_nk.append(frame.charges[:, None])
            if moving:
                frame.require("velocities", why="profiles of velocity")
                a_nk.append((one_ns[:, :, None] * frame.velocities[:, None, :]).reshape(len(frame), -1))
            a_nk = np.concatenate(a_nk, axis=1)
            deposit = make("slab", bound, kern, bound.cell, a_nk.shape[1], 1)
            deposit.add_sites(frame.positions, a_nk)
            sums_zk = deposit.site_sums()
            s = len(kinds)
            number.append(sums_zk[:, :s])
            if charged:
                charge.append(sums_zk[:, s])
                total, size = frame.charges.sum(), np.abs(frame.charges).sum()
            if moving:
                flow.append(sums_zk[:, s + charged :].reshape(-1, s, 3))
            heights.append(bound.cell.heights[bound.axis])
            self.periodic = bool(bound.cell.periodic[bound.axis])
        self.number_tzs, self.height_t = np.array(number), np.array(heights)
        self.flow_tzsc = np.array(flow) if flow else None
        self.charge_tz = np.array(charge) if charge else None
        self.net = float(total / size) if charge else 0.0


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


def _add_charges(out, sums, boundary) -> None:
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
        out.notes.append(
            "the cell has a net charge: field and potential are those with a uniform background against it"
        )
    E_tz, psi_tz = field_and_potential(sums.charge_tz, sums.height_t, u.coulomb, vacuum)
    length, charge = u.label("length"), u.label("charge")
    out.add(
        "charge_density", sums.charge_tz / (u.factor("charge") / u.factor("length") ** 3), f"{charge}/{length}^3",
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


def _add_velocities(out, sums) -> None:
    """Mean velocities <n v>/<n>; NaN where a species never is."""
    from ..estimators.statistics import BlockAverage
    from ..estimators.tensors import quotient

    u = sums.units
    for s, name in enumerate(sums.names):
        average = BlockAverage()
        n_tz, flow_tzc = sums.number_tzs[:, :, s], sums.flow_tzsc[:, :, s]
        for n_z, flow_zc in zip(n_tz, flow_tzc):
            average.add(quotient(flow_zc, n_z), n_z)
        mean, stderr, correlated = average.result()
        never = ~(n_tz > 0).any(axis=0)
        mean[never] = stderr[never] = np.nan
        for c, direction in enumerate("xyz"[: u.dimension]):
            out.columns[f"velocity_{direction}_{name}"] = Column(
                u.to_user("velocity", mean[:, c]), u.to_user("velocity", stderr[:, c]), u.label("velocity"),
                f"v_{direction} {name}", f"v_{direction}", correlated[:, c], "velocities",
            )  # fmt: skip
