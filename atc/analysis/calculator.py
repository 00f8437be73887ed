"""What forces and energies of atoms alone say of stress and heat flux, for models that give nothing else: averages over
planes.

A field of stress is not determined by forces. Its average over whole cross-sections of area A is, in the components
along the normal n (s the distance along it): ∂σ_nν/∂s = Σ F_ν δ(s − s_k)/A, and the mean over the cell is the virial's.
Likewise ∂A_n/∂s = −Σ w_k δ(s − s_k)/A with w = v·F + dU^(k)/dt for the potential part of the energy current, up to a
constant that only a plane without atoms gives. Every stress and heat flux of the same energies has these averages.
"""

from __future__ import annotations

import numpy as np

from ..contracts import Interactions
from ..deposit import make
from ..errors import AtcError
from ..units import units

#: Forces that do not add up to 0, energies of atoms that are not those of the whole, of the sum of their sizes.
_ROUNDING = 1e-6
#: What the energy changes by along the motion against the power of the forces, of the largest power of an atom.
_GRADIENT = 1e-3
#: How far (Å) the fastest atom moves for the rate of the energies.
_STEP = 2e-3


class Calculator(Interactions):
    """A calculator of ASE; see `calculator`."""

    terms: tuple = ()
    central, churnless = False, False
    cutoff = 0.0

    def __init__(self, calc, name: str | None = None):

        if not (hasattr(calc, "get_property") or hasattr(calc, "get_forces")):
            raise AtcError(
                f"calculator: expected a calculator of ASE (with get_forces), got {type(calc).__name__}: give "
                "MACECalculator(...), CPUNEP(...) or the like"
            )
        self.calc, self.name, self.units = calc, name or type(calc).__name__, units("ase")

    def describe(self) -> str:
        return f"{self.name} (a calculator of ASE: forces and energies of atoms, no bonds)"

    def stream(self, frame, consume=None, **more):
        raise AtcError(
            f"{self.name}: forces alone do not determine stress or heat flux at a point: ask for the averages over "
            "planes, atc.calculator(...).plane_profiles(...), or give the model itself (atc.nep, atc.mace, atc.nequip, "
            "atc.metatomic, atc.edge_model)"
        )

    def plane_profiles(self, traj, kernel, grid, heat: bool = False, zero: float | None = None):
        """Normal stress, and normal heat flux, averaged over whole cross-sections.

        Parameters
        ----------
        traj : what `atc.read` takes, or a trajectory; with names of elements
        kernel : from `atc.kernel`. grid : `atc.Grid.slab`
        heat : whether the heat flux too: needs velocities, masses, energies of atoms, and four more evaluations a frame
        zero : along a periodic axis, where no energy flows by the potential: the place of a plane in vacuum (distance
            along the normal from the cell's face, in the trajectory's unit). Open axes need none.

        Returns
        -------
        xarray.Dataset, dims frame, the grid's, j: ``stress_normal_potential``, ``stress_normal_kinetic`` and their sum
        ``stress_normal`` (n·σ; tension positive; the kinetic parts where there are velocities and masses),
        ``heat_flux_normal`` (n·q; NaN where there is no mass), in the trajectory's units: the rows of `atc.fields` on
        the same grid

        Raises
        ------
        AtcError for calculators that fail, whose forces do not add up to zero or are not the gradient of the energies;
        for a heat flux whose constant is not known.
        """
        import xarray as xr

        from ..estimators.accuracy.random_points import kernel_internal
        from ..planning.job import as_frames

        if grid is None or grid.kind != "slab":
            raise AtcError("plane_profiles: only averages over whole planes are known: give atc.Grid.slab(axis, bins)")
        rows, at, u = [], [], None
        for frame in as_frames(traj):
            u = frame.units
            if u.reduced:
                raise AtcError(f"{frame.source}: {self.name}: reduced units (lj) have no Å and eV")
            bound = grid.bind(u, frame.cell, frame.positions)
            at.append(bound.coords(u))
            rows.append(self._profiles(frame, kernel_internal(kernel, u), bound, heat, zero))
        if not rows:
            raise AtcError("plane_profiles: the trajectory has no frames")
        data, dim = {}, bound.dims[0]
        for key in rows[0]:
            flux = key == "heat_flux_normal"
            unit, sign = ("energy_flux", "heat along the normal") if flux else ("pressure", "tension positive")
            values = u.to_user(unit, np.array([row[key] for row in rows]))
            dims = ("frame", dim) if flux else ("frame", dim, "j")
            data[key] = (dims, values, {"units": u.label(unit), "sign_convention": sign})
        attrs = {"decomposition": f"none: averages over planes of {self.describe()}", "kernel": kernel.describe()}
        return xr.Dataset(data, coords={**at[0], "j": list("xyz")}, attrs=attrs)

    # --- one frame, in ASE's units, which are the internal ones

    def _profiles(self, frame, kern, bound, heat, zero):

        cell, axis, here = bound.cell, bound.axis, f"{frame.source}: {self.name}"
        height, volume = cell.heights[axis], cell.volume
        normal = cell.inverse[:, axis] * height
        # Distances along the normal, and the atoms in the cell.
        s_n = (frame.positions - cell.origin) @ cell.inverse[:, axis]
        periodic = bool(cell.periodic[axis])
        away = np.floor(s_n) if periodic else np.zeros(len(s_n))
        s_n, x_nc = (s_n - away) * height, frame.positions - away[:, None] * cell.vectors[axis]
        asked = ["forces"] + ["stress"] * periodic + ["energies", "energy"] * heat
        at = self._evaluate(frame, frame.positions, asked, here)
        F = at["forces"]
        if not (np.abs(F.sum(0)) <= _ROUNDING * max(np.abs(F).sum(0).max(), 1e-300)).all():
            raise AtcError(
                f"{here}: its forces do not add up to 0, so they are not the gradient of an energy: no stress balances "
                "them (models that give forces directly cannot be used)"
            )
        moving = frame.velocities is not None and frame.masses is not None
        if heat and not moving:
            frame.require("velocities", why="heat_flux_normal")
            frame.require("masses", why="heat_flux_normal")
        m, v = (frame.masses, frame.velocities) if moving else (np.zeros(len(F)), np.zeros(F.shape))
        e, power = self._power(frame, at, here) if heat else np.zeros((2, len(F)))
        # Averages over planes are the same for every set of bonds with these forces and powers: the simplest one is a
        # chain through the atoms, in their order along the normal.
        order = np.argsort(s_n, kind="stable")
        r_b = np.diff(s_n[order])  # of each bond from an atom back to the one before
        b_bk = np.concatenate(
            [r_b[:, None] * np.cumsum(F[order], axis=0)[:-1], -(r_b * np.cumsum(power[order])[:-1])[:, None]], axis=1
        )
        deposit = make("slab", bound, kern, cell, 12, 4)
        kinetic = m[:, None] * (v @ normal)[:, None] * v
        a_nk = np.concatenate(
            [m[:, None], m[:, None] * v, kinetic, (e * (v @ normal))[:, None], e[:, None], np.zeros((len(F), 3))],
            axis=1,
        )
        deposit.add_sites(x_nc, a_nk)
        deposit.add_bonds(x_nc[order][1:], r_b[:, None] * normal, b_bk)
        sites, bonds = deposit.site_sums(), deposit.bond_sums()
        stress, current = bonds[:, :3], bonds[:, 3]
        if periodic:
            # Over the whole cell the mean is the virial's, n·W/V.
            stress = stress + normal @ _full(at["stress"]) - b_bk[:, :3].sum(0) / volume
        out = {"stress_normal_potential": stress}
        if not moving:
            return out
        rho, pi = sites[:, :1], sites[:, 1:4]
        flow = np.divide(pi, rho, out=np.zeros_like(pi), where=rho > 0)
        out["stress_normal_kinetic"] = (pi @ normal)[:, None] * flow - sites[:, 4:7]
        out["stress_normal"] = stress + out["stress_normal_kinetic"]
        if heat:
            current = current - self._constant(s_n, power, volume / height, height, periodic, zero, frame, here)
            J, density = sites[:, 7] + current, sites[:, 8]
            q = J - density * (flow @ normal) + (out["stress_normal"] * flow).sum(1)
            out["heat_flux_normal"] = np.where(rho[:, 0] > 0, q, np.nan)
        return out

    def _power(self, frame, at, here):
        """Energies of the atoms, and v·F + dU/dt of each, by differences of fourth order along the motion."""
        U, v = at["energies"], frame.velocities
        if not np.abs(U.sum() - at["energy"]) <= _ROUNDING * np.abs(U).sum():
            raise AtcError(f"{here}: the energies of its atoms do not add up to its energy: no heat flux")
        fastest = np.linalg.norm(v, axis=1).max(initial=0.0)
        if not fastest > 0:
            return U, np.zeros(len(U))
        h = _STEP / fastest
        moved = {k: self._evaluate(frame, frame.positions + k * h * v, ["energies"], here)["energies"] for k in _ORDER}
        rate = sum(weight * moved[k] for k, weight in _ORDER.items()) / h
        power = (v * at["forces"]).sum(1)
        size = max(np.abs(power).max(), np.abs(rate).max())
        if not abs((rate + power).sum()) <= _GRADIENT * size:
            raise AtcError(
                f"{here}: its energy does not change by the power of its forces ({rate.sum():.3g} and "
                f"{-power.sum():.3g}): they are not its gradient, or the energy is not precise enough (float32?)"
            )
        return U + 0.5 * frame.masses * (v**2).sum(1), power + rate - (rate + power).mean()

    def _constant(self, s_n, power, area, height, periodic, zero, frame, here):
        """What the current of the chain is at the plane where there is none."""
        if not periodic:
            return 0.0
        if zero is None:
            raise AtcError(
                f"{here}: along a periodic axis the heat flux through planes is known but for a constant: say where "
                "there is vacuum, zero=<distance along the normal>, or leave heat out"
            )
        at = float(frame.units.to_internal("length", zero)) % height
        return -power[s_n < at].sum() / area

    def _evaluate(self, frame, x_nc, asked, here) -> dict:
        from ase import Atoms

        names = [frame.type_names.get(int(t)) for t in frame.types]
        if None in names:
            raise AtcError(f"{here}: the trajectory does not name the elements of its types")
        try:
            atoms = Atoms(names, positions=x_nc, cell=frame.cell.vectors, pbc=frame.cell.periodic)
            atoms.calc = self.calc
            found = {
                "forces": atoms.get_forces,
                "stress": lambda: atoms.get_stress(voigt=True),
                "energies": atoms.get_potential_energies,
                "energy": atoms.get_potential_energy,
            }
            out = {key: np.array(found[key](), float) for key in asked}
        except Exception as e:  # of whatever calculator it is
            first = (str(e).splitlines() or [""])[0][:200]
            raise AtcError(f"{here} cannot be evaluated: {type(e).__name__}: {first}") from None
        for key, value in out.items():
            if not np.isfinite(value).all():
                raise AtcError(f"{here}: its {key} are not all finite numbers")
        return out


#: Steps and weights of a first difference of fourth order.
_ORDER = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}


def _full(voigt):
    xx, yy, zz, yz, xz, xy = voigt
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def calculator(calc, name: str | None = None) -> Calculator:
    """What can be said of stress and heat flux with a calculator of ASE, whatever model is behind it: averages over
    planes, which are the same for every stress with these forces and energies.

    Parameters
    ----------
    calc : with forces, stress (for periodic axes), and, for heat, energies of atoms
    name : for messages and the output

    Examples
    --------
    >>> planes, kern = atc.Grid.slab("z", 50), atc.kernel("quartic", 8.0)
    >>> ds = atc.calculator(calc).plane_profiles("run.traj", kern, planes)          # doctest: +SKIP
    """
    return Calculator(calc, name)
