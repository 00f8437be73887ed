"""Pressure across a planar interface and its surface tension, by the mechanical route and from the box; with the
profiles of `species_profile` beside.

With n the normal, p = −σ: p_N(z) = n·p·n, p_T(z) = (tr p − p_N)/(d − 1), and γ = ∫ (p_N − p_T) dz over the cell, shared
among the interfaces in it (Kirkwood & Buff, J. Chem. Phys. 17, 338 (1949)). Hardy's stress averaged over cross-sections
integrates to the virial stress of the box, so that γ = L (P_N − P_T) of the box's pressure tensor is the same number;
mechanical equilibrium makes p_N the same everywhere.
"""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..estimators.tensors import quotient
from ..frame import Frame
from ..readers.memory import FrameList
from ..readers.planar import matched
from ..readers.trajectory import Trajectory
from ..units import units
from .profile_table import Profile, Value, series_mean
from .species_profile import BOUNDARIES, Seen, SpeciesSums, add_species

#: Root of the mean square of the deviations of p_N from its mean, in their standard errors, up to which it is called
#: constant. 1 is expected of independent frames and true errors; those of few blocks are too small by chance.
CONSTANT = 2.0
#: Frames below which there is not much of an error bar.
FEW = 16
#: A mean tangential velocity of so many standard errors (rms over the bins) is a flow.
_FLOW = 3.0

_QUANTITIES = ("stress_kinetic", "stress_potential", "density", "momentum", "virial_stress")


def profile(
    traj,
    pot=None,
    kern=None,
    grid=None,
    *,
    interfaces: int = 2,
    flow: bool = False,
    boundary: str = "auto",
    tolerance: float = 1e-5,
    method: str = "auto",
    threads: int | None = None,
    workers: int = 1,
    forces: str = "warn",
    log=None,
    progress=None,
) -> Profile:
    """Pressure normal and tangential to a planar interface, and surface tension, with error bars; density and velocity
    by species, charge density, electric field and potential.

    Parameters
    ----------
    traj : trajectory from `atc.read`, list of Frames, or what `atc.read` takes
    pot : potential from `atc.potential`; None: no pressure, only what needs no forces
    kern : kernel from `atc.kernel`
    grid : `atc.Grid.slab(axis, bins)`: the normal is that of the cell's faces that `axis` leaves
    interfaces : int
        How many interfaces the cell holds: γ is for each. A film, or two phases in a periodic cell, have 2; a bilayer
        taken as a whole is 1.
    flow : bool
        Whether kinetic pressure is relative to the mean velocity profile of all frames (a run that flows) instead of
        the mean velocity of each frame. Never relative to the velocity field of each frame: in a vapour, where that is
        made by few atoms, it would take a part of the pressure away.
    boundary : "periodic", "vacuum" or "auto"
        Of the electric field: no mean field in the cell (Ewald sums with a conductor around), or no field below the
        lower face. "auto": vacuum where the cell is open along the normal or the run has `kspace_modify slab`.
    tolerance, method, threads, workers, forces, log, progress : see `atc.fields`

    Returns
    -------
    Profile, in the trajectory's units. Columns: density, pressure_normal, pressure_tangential, tension_integral (∫ (p_N
    − p_T) dz from the first face to z, all interfaces). Numbers: surface_tension (from the profile), surface_tension_si
    (mN/m; 3-D runs with real units), surface_tension_box, surface_tension_difference (profile − box, with the error of
    the difference frame by frame), pressure_normal_mean, normal_deviation (rms over z of p_N − mean in its own standard
    errors; about 1 for a constant), normal_deviation_largest, moment_below and moment_above (∫ |ζ| (p_N − p_T) dζ, ζ
    from the centre of mass). Pressures are positive in compression. Of each species number_density_S and, with
    velocities, velocity_x_S, ... (<n v>/<n>); with charges charge_density, electric_field (along the normal) and
    potential (V; 0 at the lower face); where molecules and masses are known too polarisation (dipoles of neutral
    molecules along the normal, per volume), dipole_cosine and dipole_order (means of cos θ and (3 cos² θ − 1)/2, θ
    between a dipole and the normal).

    Raises
    ------
    AtcError
        when a kernel or the slab grid is missing, or `atc.fields` refuses.

    Notes
    -----
    γ and p_N do not depend on how the stress is localised; p_T(z) does, and with it the first moments (Schofield and
    Henderson, Proc. R. Soc. A 379, 231 (1982)): these are for comparison between runs treated alike.
    """
    how = {"tolerance": tolerance, "method": method, "threads": threads, "workers": workers, "forces": forces}
    result = _profile(traj, pot, kern, grid, interfaces, flow, boundary, **how, log=log, progress=progress)
    for doubt in result.warnings:
        warnings.warn(f"{result.source}: {doubt}", AtcWarning, stacklevel=2)
    return result


def profile_of_scene(
    scene, *, axis=None, bins=None, interfaces=2, flow=False, boundary="auto", jobs=1, progress=None
) -> Profile:
    """`profile` of a scene. `axis` and `bins` make the slab grid where the scene has another or none; what is
    doubtful is in the result, and no warning."""
    if axis not in (None, "x", "y", "z"):
        raise AtcError(f"--axis {axis}: expected x, y or z, the edge of the cell that leaves the interface")
    if bins is not None and bins < 1:
        raise AtcError(f"--bins {bins}: expected a whole number of at least 1, e.g. 200")
    if axis is not None or bins is not None:
        own = scene.data.get("grid", {})
        own = own if own.get("kind") == "slab" else {}
        table = {"kind": "slab", "axis": axis, "bins": bins}
        table = {k: own.get(k) if v is None else v for k, v in table.items()}
        if None in table.values():
            raise AtcError(f"{scene.name}: a profile needs both --axis and --bins where the scene has no slab grid")
        scene = scene.instead(scene.data | {"grid": own | table})
    if (scene.data.get("grid") or {}).get("kind") != "slab":
        raise scene.need("grid", 'a profile needs kind = "slab", axis and bins (or --axis z --bins 200)')
    if "kernel" not in scene.data:
        raise scene.need("kernel", 'a profile needs one, e.g. name = "quartic" and radius = 4.0')
    scene = _asking(scene)
    given = scene.arguments(jobs)
    for key in ("quantities", "average", "reference", "horizon", "tiles"):
        given.pop(key, None)
    return _profile(interfaces=interfaces, flow=flow, boundary=boundary, progress=progress, **given)


def _asking(scene):
    """The scene with the quantities of a profile, whatever it asks for itself."""
    fields = {**scene.data.get("fields", {}), "quantities": _asked("potential" in scene.data), "average": False}
    fields = {k: v for k, v in fields.items() if k not in ("horizon", "tiles")}
    return scene.instead(scene.data | {"fields": fields})


def _asked(potential: bool) -> list[str]:
    return list(_QUANTITIES) if potential else ["number_density"]


def _profile(traj, pot, kern, grid, interfaces, flow, boundary, *, progress=None, **how) -> Profile:
    from .. import fields, read

    if isinstance(interfaces, bool) or not isinstance(interfaces, int) or interfaces < 1:
        raise AtcError(f"interfaces={interfaces!r}: expected a whole number of at least 1")
    if boundary not in BOUNDARIES:
        raise AtcError(f"boundary={boundary!r}: expected one of {', '.join(BOUNDARIES)}")
    if grid is None or grid.kind != "slab":
        raise AtcError("a profile needs a slab grid: grid=atc.Grid.slab('z', bins=200)")
    if kern is None:
        raise AtcError("a profile needs kern: give atc.kernel('quartic', radius)")
    frames = [traj] if isinstance(traj, Frame) else traj
    frames = frames if isinstance(frames, (list, tuple, Trajectory)) else read(frames)
    frames, pot = matched(frames if isinstance(frames, Trajectory) else FrameList(frames), pot)
    sums = SpeciesSums(pot, kern, grid)
    frames = Seen(frames, sums)
    how = {**how, "velocity": "local"}  # it is taken back below
    ds = fields(frames, pot, kern, grid, _asked(pot is not None), average=False, progress=progress, **how).load()
    u = frames[0].units
    axis = "xyz"[grid._["axis"]]
    out = Profile(ds[axis].values, axis, u.label("length"), ds.sizes["frame"], str(ds.attrs.get("sources", "")))
    if pot is None:
        out.notes.append("without a potential there is no pressure: densities and velocities only")
    else:
        of = PressureFrames(ds, grid._["axis"], flow)
        _add_pressure(out, of)
        _add_tension(out, of, interfaces)
        _add_moments(out, of)
        _add_notes(out, of, interfaces, flow)
    frames.rest()
    add_species(out, sums, boundary)
    return out


class PressureFrames:
    """Pressure tensors of every frame along the normal; internal units.

    p_tzcc : (t, z, 3, 3); box_tcc : (t, 3, 3) of the whole cell; rho_tz, momentum_tzc; n_tc : unit normals; height_t :
    of the cell along them; velocity_zc : mean velocity profile <ρv>/<ρ> relative to the drift of each frame.
    """

    def __init__(self, ds, axis: int, flow: bool):
        u = units(ds.attrs["units"])
        self.axis = "xyz"[axis]
        self.units = u = u.planar if ds.attrs["dimension"] == 2 else u
        self.dimension = u.dimension
        self.frames, self.bins = ds["density"].shape

        def internal(name, dimension):
            return u.to_internal(dimension, ds[name].values)

        cell_tcc = internal("cell", "length")
        if cell_tcc.ndim == 2:
            cell_tcc = np.broadcast_to(cell_tcc, (self.frames, 3, 3))
        a, b = (k for k in range(3) if k != axis)
        area_tc = np.cross(cell_tcc[:, a], cell_tcc[:, b])
        self.n_tc = area_tc / np.linalg.norm(area_tc, axis=1)[:, None]
        self.height_t = np.abs(np.einsum("tc,tc->t", self.n_tc, cell_tcc[:, axis]))
        self.rho_tz = internal("density", "density")
        self.momentum_tzc = internal("momentum", "momentum")
        box = -internal("virial_stress", "pressure")
        # Where there is no mass nothing moves; bonds and long-range fields cross empty space all the same.
        kinetic = -np.nan_to_num(internal("stress_kinetic", "pressure"), nan=0.0)
        potential = -internal("stress_potential", "pressure")

        # Σ m v⊗v φ of the frame: its kinetic stress is relative to its own velocity field, which is taken back.
        v_tzc = quotient(self.momentum_tzc, self.rho_tz)
        drift_tc = self.momentum_tzc.sum(axis=1) / self.rho_tz.sum(axis=1)[:, None]
        momentum_tzc = self.momentum_tzc - self.rho_tz[:, :, None] * drift_tc[:, None]
        v_tzc = v_tzc - np.where(self.rho_tz[:, :, None] > 0, drift_tc[:, None], 0.0)
        kinetic = kinetic + _outer(momentum_tzc, v_tzc)
        self.relative_tzc = momentum_tzc
        self.velocity_zc = quotient(momentum_tzc.mean(axis=0), self.rho_tz.mean(axis=0))
        if flow:
            V = np.broadcast_to(self.velocity_zc, momentum_tzc.shape)
            kinetic = kinetic - _outer(momentum_tzc, V) - _outer(V, momentum_tzc)
            kinetic = kinetic + self.rho_tz[:, :, None, None] * _outer(V, V)
        self.normal_tz, self.tangential_tz = self._split(potential + kinetic)
        self.box_normal_t, self.box_tangential_t = self._split(box)
        self.anisotropy_tz = self.normal_tz - self.tangential_tz
        self.dz_t = self.height_t / self.bins

    def _split(self, p):
        """p_N and p_T of pressure tensors (t, ..., 3, 3)."""
        normal = np.einsum("tc,t...cd,td->t...", self.n_tc, p, self.n_tc)
        trace = np.einsum("...cc->...", p[..., : self.dimension, : self.dimension])
        return normal, (trace - normal) / (self.dimension - 1)


def _outer(a, b):
    return a[..., :, None] * b[..., None, :]


def _tension_unit(u):
    """(size in internal units, label) of pressure times length."""
    return u.factor("pressure") * u.factor("length"), f"{u.label('pressure')}*{u.label('length')}"


def _add_pressure(out, of) -> None:
    u = of.units
    p, label = u.factor("pressure"), u.label("pressure")
    out.add("density", of.rho_tz / u.factor("density"), u.label("density"), "density", "density")
    out.add("pressure_normal", of.normal_tz / p, label, "p_N", "pressure")
    out.add("pressure_tangential", of.tangential_tz / p, label, "p_T", "pressure")
    size, tension = _tension_unit(u)
    running = np.cumsum(of.anisotropy_tz, axis=1) - 0.5 * of.anisotropy_tz
    out.add("tension_integral", running * of.dz_t[:, None] / size, tension, "∫(p_N − p_T)dz", "∫(p_N − p_T)dz")


def _add_tension(out, of, interfaces) -> None:
    u = of.units
    size, label = _tension_unit(u)
    profile_t = of.anisotropy_tz.sum(axis=1) * of.dz_t / interfaces
    box_t = of.height_t * (of.box_normal_t - of.box_tangential_t) / interfaces
    each = " (each)" if interfaces > 1 else ""
    out.number("surface_tension", profile_t / size, label, f"surface tension, profile{each}")
    if not u.reduced and of.dimension == 3:
        si, _ = _tension_unit(units("si"))
        out.number("surface_tension_si", profile_t / si * 1e3, "mN/m", "")
    out.number("surface_tension_box", box_t / size, label, f"surface tension, box{each}")
    out.number("surface_tension_difference", (profile_t - box_t) / size, label, "profile − box")

    p = u.factor("pressure")
    out.number("pressure_normal_mean", of.normal_tz.mean(axis=1) / p, u.label("pressure"), "p_N, mean over z")
    mean, stderr, _ = series_mean(of.normal_tz - of.normal_tz.mean(axis=1)[:, None])
    scale = np.abs(of.normal_tz).max(initial=0.0)
    known = stderr > 1e-12 * scale
    z = mean[known] / stderr[known]
    rms = float(np.sqrt(np.mean(z**2))) if len(z) else np.nan
    out.numbers["normal_deviation"] = Value(rms, np.nan, "standard errors", "p_N − mean, rms over z")
    largest = float(np.abs(z).max()) if len(z) else np.nan
    out.numbers["normal_deviation_largest"] = Value(largest, np.nan, "standard errors", "p_N − mean, largest")


def _add_moments(out, of) -> None:
    """First moments of p_N − p_T about the centre of mass, of either side."""
    u = of.units
    centre = _centre(of.rho_tz.mean(axis=0))
    where = (np.arange(of.bins) + 0.5) / of.bins - centre
    where -= np.rint(where)
    size = u.factor("pressure") * u.factor("length") ** 2
    label = f"{u.label('pressure')}*{u.label('length')}^2"
    for name, side in (("below", where < 0), ("above", where > 0)):
        moment_t = (of.anisotropy_tz * np.abs(where) * side).sum(axis=1) * of.height_t * of.dz_t
        out.number(f"moment_{name}", moment_t / size, label, f"first moment, {name} the centre of mass")


def _centre(rho_z) -> float:
    """Centre of mass as a fraction of a periodic length: the phase of the first Fourier mode."""
    n = len(rho_z)
    mode = np.sum(rho_z * np.exp(2j * np.pi * (np.arange(n) + 0.5) / n))
    return float(np.angle(mode) / (2 * np.pi)) % 1.0


def crossings(rho_z) -> int:
    """How often a periodic density profile goes from below a quarter of its range to above three quarters or back."""
    low, high = rho_z.min(), rho_z.max()
    state = np.where(rho_z > low + 0.75 * (high - low), 1, np.where(rho_z < low + 0.25 * (high - low), -1, 0))
    state = state[state != 0]
    return int(np.count_nonzero(state != np.roll(state, 1)))


def _add_notes(out, of, interfaces, flow) -> None:
    if of.frames < FEW:
        out.warnings.append(
            f"{of.frames} frame{'s' * (of.frames != 1)}: error bars of fewer than {FEW} say little; give more frames"
        )
    rms = out.numbers["normal_deviation"].value
    if of.frames >= FEW and not rms <= CONSTANT:
        out.warnings.append(
            f"p_N is not constant across the cell: it deviates by {rms:.2g} standard errors (rms; up to {CONSTANT:g} "
            "may be chance): a run that is not in equilibrium, a force from outside, or not the potential of the run"
        )
    rho_z = of.rho_tz.mean(axis=0)
    found = crossings(rho_z)
    if np.ptp(rho_z) < 0.2 * rho_z.max():
        out.warnings.append(
            f"the density hardly changes along {of.axis}: if there are not {interfaces} interfaces, say how many"
        )
    elif found != interfaces:
        out.warnings.append(
            f"the density goes from one phase to another {found} times along {of.axis}, but the tension is shared "
            f"among {interfaces} interfaces: say how many there are"
        )
    moving = _flow(of)
    if moving > _FLOW and not flow and of.frames >= FEW:
        out.warnings.append(
            f"the layers move along the interface ({moving:.2g} standard errors, rms over z), and what they carry "
            "counts as tangential pressure: take the mean velocity profile off (flow)"
        )
    out.notes.append(
        "the first moments depend on how the stress is localised (its gauge), and so does p_T(z); surface tension and "
        "p_N do not"
    )


def _flow(of) -> float:
    """Mean momentum along the interface in its standard errors, rms over bins."""
    along = of.relative_tzc - np.einsum("tzc,tc->tz", of.relative_tzc, of.n_tc)[:, :, None] * of.n_tc[:, None]
    mean, stderr, _ = series_mean(along)
    known = stderr > 1e-9 * np.abs(along).max(initial=0.0)
    return float(np.sqrt(np.mean((mean[known] / stderr[known]) ** 2))) if known.any() else 0.0
