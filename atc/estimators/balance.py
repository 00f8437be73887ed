"""Residuals of the balance laws of mass, momentum and energy, and of ∇·z = 0, at points (formulas.md §4; R
4.0.78-4.0.116).

    ∂ρ/∂t + ∇·(ρ v) = 0,   ∂(ρ v)/∂t + ∇·(ρ v⊗v) = ∇·σ + b,   ∂ε/∂t + ∇·(ε v) = ∇·(σ·v − q) + p,   ∇·z = 0,

b = Σ F_ext φ and p = Σ F_ext·v φ what acts from outside, q = q_K + q_U + q_C with the churning heat flux q_C = z·v.
Three ways, each blind to what another one sees:

``chain_rule``   everything in closed form: ∂φ_j/∂t = −v_j·∇φ_j, dv_j/dt = F_j/m_j, dU^(j)/dt = Σ_k v_k·∂U^(j)/∂x_k, and
                 ∇·(r β) = φ_j − φ_i for every bond. Rounding only; tests that forces, stress and energy sources belong
                 to each other.
``divergences``  the fluxes as they are deposited, differentiated on small stencils; tests β, φ and the algebra of the
fields.
``frames``       rates as differences between frames; tests that the potential, the units and the time are those of the
run.

All of it is done in the frame of reference that moves with the drift of the atoms: the laws are the same there
(Galilei), and a drift far above the thermal speed costs no digits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..compiled import njit
from ..decomposers.constraints.virtual_sites import seen_by
from ..errors import AtcError
from .atom_pass import drift_velocity
from .tensors import full, outer6, quotient

LAWS = ("mass", "momentum", "energy", "churning")
#: What the residuals are: the unit of each law's terms is this dimension's divided by this one's.
DIMENSIONS = {
    "mass": ("density", "time"),
    "momentum": ("force_density", None),
    "energy": ("energy_density", "time"),
    "churning": ("force_density", None),
}


@dataclass
class Law:
    """One balance law at points.

    terms : {name: (g,) or (g, 3)}, what the law adds up, internal units
    residual : the law's left side minus its right
    without : the same without the churning heat flux (energy only)
    limit : (g,) error of the residual as far as the way of computing it knows it, or None
    """

    terms: dict[str, np.ndarray]
    residual: np.ndarray
    without: np.ndarray | None = None
    limit: np.ndarray | None = None

    @property
    def largest(self) -> tuple[str, float]:
        """The largest term and its size anywhere."""
        sizes = {name: float(size(t).max(initial=0.0)) for name, t in self.terms.items()}
        name = max(sizes, key=sizes.get)
        return name, sizes[name]


def size(a) -> np.ndarray:
    """(g,) Euclidean norms of numbers, vectors or tensors at points."""
    return np.sqrt((np.asarray(a).reshape(len(a), -1) ** 2).sum(1))


# ---- points


class Sites:
    """The atoms and images within reach of points: Σ a φ and its gradient as sparse matrices.

    x_gc are the points; sums are exact, over all periodic images.
    """

    def __init__(self, x_gc, x_nc, cell, kern, margin: float = 0.0):
        from scipy.sparse import csr_matrix

        reach = kern.support + margin
        s_n = cell.fractional(x_nc)
        s_n -= np.where(cell.periodic, np.floor(s_n), 0.0)
        point, atom, d = [], [], []
        counts = np.where(cell.periodic, np.floor(reach / cell.heights + 0.5), 0).astype(int)
        images = np.stack(np.meshgrid(*[np.arange(-c, c + 1) for c in counts], indexing="ij"), -1).reshape(-1, 3)
        for g, s_g in enumerate(cell.fractional(x_gc)):
            s = s_n - s_g
            s -= np.where(cell.periodic, np.rint(s), 0.0)
            for image in images:
                t = s + image
                near = np.flatnonzero((np.abs(t) * cell.heights <= reach).all(1))
                r = t[near] @ cell.vectors
                inside = (r * r).sum(1) <= reach * reach
                point.append(np.full(inside.sum(), g))
                atom.append(near[inside])
                d.append(r[inside])
        shape = (len(x_gc), len(x_nc))
        point, atom = np.concatenate(point or [[]]).astype(int), np.concatenate(atom or [[]]).astype(int)
        d = np.concatenate(d) if d else np.zeros((0, 3))
        phi, slope = kern.phi(d), kern.grad_phi(d)
        self.phi = csr_matrix((phi, (point, atom)), shape)
        # with respect to the point: minus that with respect to d = x_j − x
        self.gradient = [csr_matrix((-slope[:, c], (point, atom)), shape) for c in range(3)]
        self.kink_g = np.full(len(x_gc), np.inf)
        np.minimum.at(self.kink_g, point, kern.kink_distance(d))

    def sum(self, a_n) -> np.ndarray:
        """(g, ...) Σ a φ."""
        return (self.phi @ a_n.reshape(len(a_n), -1)).reshape(-1, *a_n.shape[1:])

    def grad(self, a_n) -> np.ndarray:
        """(g, 3, ...) ∂_µ Σ a φ."""
        flat = a_n.reshape(len(a_n), -1)
        return np.stack([(m @ flat).reshape(-1, *a_n.shape[1:]) for m in self.gradient], axis=1)

    def div(self, a_nc) -> np.ndarray:
        """(g, ...) ∂_µ Σ a^µ φ for a (n, 3, ...)."""
        return sum(
            (m @ a_nc[:, c].reshape(len(a_nc), -1)).reshape(-1, *a_nc.shape[2:]) for c, m in enumerate(self.gradient)
        )


#: Points with less than this share of the typical density are taken for empty.
_EMPTY = 0.05


def choose_points(frame, kern, count: int, rng, bound=None) -> tuple[np.ndarray, int]:
    """`count` random points where there is matter and, from `bound` (a grid in this frame), as many of its points.

    Points whose stencils would touch a kink of the kernel are not taken.

    Returns
    -------
    (g, 3) points, the random ones first, and how many of them are random.
    """
    clear = 5.0 * kern.difference_step
    typical = float(frame.masses.mean()) * len(frame) / frame.cell.volume
    first = Sites(
        frame.positions[rng.choice(len(frame), min(len(frame), 20), replace=False)], frame.positions, frame.cell, kern
    )
    typical = min(typical, float(np.median(first.sum(frame.masses))))  # the whole cell may be mostly empty

    def fit(x_gc, want):
        if not len(x_gc):
            return x_gc
        sites = Sites(x_gc, frame.positions, frame.cell, kern, margin=clear)
        good = (sites.kink_g > clear) & (sites.sum(frame.masses) > _EMPTY * typical)
        return x_gc[good][:want]

    found = []
    for _ in range(20):
        missing = count - sum(map(len, found))
        if missing <= 0:
            break
        u = rng.normal(size=(2 * missing + 4, 3))
        if frame.dimension == 2:
            u[:, 2] = 0.0
        u *= (0.5 * kern.radius * rng.random(len(u)) ** (1 / frame.dimension) / np.sqrt((u * u).sum(1)))[:, None]
        found.append(fit(frame.positions[rng.integers(len(frame), size=len(u))] + u, missing))
    n = sum(map(len, found))
    if bound is not None and bound.kind != "slab":
        some = (
            rng.permutation(len(bound))[: 8 * count] if len(bound) < 10**6 else rng.integers(len(bound), size=8 * count)
        )
        found.append(fit(bound.relative_points_gc[some] + frame.cell.origin, count))
    x_gc = np.concatenate(found) if found else np.zeros((0, 3))
    if not len(x_gc):
        raise AtcError(
            f"{frame.source}: found no point in the matter that keeps clear of the kernel's kinks: take another "
            "kernel or radius"
        )
    return x_gc, n


# ---- what the potential says


@dataclass
class Motion:
    """The atoms of a frame and their exact rates; velocities relative to the drift."""

    frame: object
    drift: np.ndarray
    v_nc: np.ndarray
    energies_n: np.ndarray  # U^(j)
    forces_nc: np.ndarray
    slope_nc: np.ndarray  # Σ_p ∂U^(p)/∂x_k, own shares by translation invariance
    share_rate_n: np.ndarray  # dU^(j)/dt
    flux_n: np.ndarray  # ∇·A = Σ flux_j φ_j
    torque_nc: np.ndarray  # ∇·M = Σ torque_j φ_j
    stiffness_n: np.ndarray  # √Σ |∂U/∂x|² over an atom's bonds: how strongly energies respond to its position
    notes: dict = field(default_factory=dict)
    outside_nc: np.ndarray | None = None  # forces from outside, where there are any

    @property
    def total_n(self) -> np.ndarray:
        """e_j = ½ m v² + U^(j)."""
        return 0.5 * self.frame.masses * (self.v_nc**2).sum(1) + self.energies_n


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(i, j, F, D, P, v, slope, rate, flux, torque, stiff):
    for b in range(len(F)):
        p, q = i[b], j[b]
        a = P[b] if len(P) else 0.0  # what messages carry from q to p
        rate[p] += a
        rate[q] -= a
        d2 = 0.0
        for c in range(3):
            Dp, Dq = D[b, 0, c], D[b, 1, c]  # ∂U^(p)/∂x_q, ∂U^(q)/∂x_p
            w = v[q, c] - v[p, c]
            rate[p] += w * Dp
            rate[q] -= w * Dq
            slope[q, c] += Dp - Dq
            slope[p, c] += Dq - Dp
            a += v[q, c] * Dp - v[p, c] * Dq
            # ∇·(r β) = φ_q − φ_p
            torque[q, c] += Dp - Dq
            torque[p, c] -= Dp - Dq
            d2 += F[b, c] ** 2
        flux[q] += a
        flux[p] -= a
        stiff[p] += d2
        stiff[q] += d2


@njit(cache=True, nogil=True, error_model="numpy")
def _bond_factors(i, j, r, F, D, P, v, out):
    """−r⊗F (9), A = (v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i + P) r (3), M = r⊗(∂U^(i)/∂x_j − ∂U^(j)/∂x_i) (9)."""
    for b in range(len(F)):
        a = P[b] if len(P) else 0.0
        for c in range(3):
            a += v[j[b], c] * D[b, 0, c] - v[i[b], c] * D[b, 1, c]
        for m in range(3):
            out[b, 9 + m] = a * r[b, m]
            for c in range(3):
                out[b, 3 * m + c] = -r[b, m] * F[b, c]
                out[b, 12 + 3 * m + c] = r[b, m] * (D[b, 0, c] - D[b, 1, c])


def motion(frame, pot, threads: int = 1, deposit=None) -> Motion:
    """One pass over the bonds of a frame: the atoms' rates, and into `deposit` (of 21 bond components) the bonds'
    factors."""
    fields = pot.fields
    n = len(frame)
    drift = drift_velocity(frame)
    v_nc = np.ascontiguousarray(frame.velocities - drift)
    parts = [[np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(n)] for _ in range(threads)]

    def consume(bonds, thread):
        F_bc = bonds.forces()
        _scatter(bonds.i, bonds.j, F_bc, bonds.D_bdc, bonds.powers(), v_nc, *parts[thread])
        if deposit is not None:
            b_bk = np.empty((len(bonds), 21))
            _bond_factors(bonds.i, bonds.j, bonds.r_bc, F_bc, bonds.D_bdc, bonds.powers(), v_nc, b_bk)
            deposit.add_bonds(frame.positions[bonds.i], bonds.r_bc, b_bk, thread=thread)

    d = pot.stream(frame, consume, threads=threads, energies=True, forces=True, sources=True)
    slope, rate, flux, torque, stiff = (sum(p[k] for p in parts) for k in range(5))
    for term in fields:
        seen = seen_by(term, frame)
        m = len(seen)
        _add_field(term, seen, v_nc[:m], slope[:m], rate[:m], flux[:m], torque[:m], stiff[:m])
    return Motion(frame, drift, v_nc, d.energies_n, d.forces_nc, slope, rate, flux, torque, np.sqrt(stiff), d.notes)


def _add_field(term, frame, v_nc, slope, rate, flux, torque, stiff) -> None:
    """The rates of a field's shares U^(j), such as ½ q_j Φ(x_j) + const; it churns nothing: ∇·z = 0."""
    smooth = term.modes(frame, term.threads)
    force_nc = smooth.forces_nc()
    power = np.einsum("nc,nc->n", v_nc, force_nc)
    share_rate = smooth.share_rates_n(v_nc)
    slope -= force_nc
    rate += share_rate
    flux -= share_rate + power
    torque -= force_nc
    stiff += (force_nc**2).sum(1)


#: What of a field's modes may be left out: far below what stencils tell apart.
FIELD_TOLERANCE = 1e-11


def field_bonds(frame, pot, kern, x_gc, threads: int = 1) -> np.ndarray | float:
    """(g, 21) what fields add to the bonds' sums of `motion` at points, mode by mode; velocities relative to the
    drift."""
    from ..grids import Grid
    from .field_pass import FieldSums

    terms = pot.fields
    if not terms:
        return 0.0
    u = frame.units
    bound = Grid.points(u.to_user("length", x_gc)).bind(u, frame.cell, frame.positions)
    sums = FieldSums(terms, ["stress", "power", "sources"], bound, kern, FIELD_TOLERANCE, threads)
    sums.add(frame, drift_velocity(frame))
    found = sums.at(np.arange(len(bound)))
    return np.concatenate([full(found["stress"]).reshape(-1, 9), found["power"], found["sources"]], axis=1)


# ---- the laws, in closed form


@dataclass
class Exact:
    """Sums at points with their exact rates and gradients, and what follows from them; axes g point, then µ, ν."""

    sites: Sites
    state: Motion
    bond_g21: np.ndarray

    def __post_init__(self):
        s, st = self.sites, self.state
        m, v, e = st.frame.masses, st.v_nc, st.total_n
        mv = m[:, None] * v
        self.rho, self.drho = s.sum(m), s.grad(m)
        self.pi, self.dpi = s.sum(mv), s.grad(mv)
        mvv = mv[:, :, None] * v[:, None, :]
        self.T, self.divT = s.sum(mvv), s.div(mvv)
        self.energy, self.denergy = s.sum(e), s.grad(e)
        ev = e[:, None] * v
        self.divJ = s.div(ev)
        self.v = self.pi / self.rho[:, None]
        self.gradv = (
            self.dpi / self.rho[:, None, None] - self.drho[:, :, None] * self.v[:, None, :] / self.rho[:, None, None]
        )
        # rates: each sum changes because its atoms' φ and its atoms' factors change
        self.rho_t = -s.div(mv)
        self.pi_t = s.sum(-st.slope_nc) - s.div(v[:, :, None] * mv[:, None, :])
        power = np.einsum("nc,nc->n", v, st.forces_nc)
        self.energy_t = s.sum(power + st.share_rate_n) - s.div(ev)
        # what acts from outside, and its power
        outside_nc = np.zeros_like(v) if st.outside_nc is None else st.outside_nc
        self.body, self.body_power = s.sum(outside_nc), s.sum(np.einsum("nc,nc->n", v, outside_nc))
        self.pi_t, self.energy_t = self.pi_t + self.body, self.energy_t + self.body_power
        self.S = self.bond_g21[:, :9].reshape(-1, 3, 3)
        self.z = self.S + self.bond_g21[:, 12:].reshape(-1, 3, 3)

    def laws(self) -> dict[str, Law]:
        """Every law with its terms. A term is the whole expression under one ∇· or ∂/∂t, as the laws are written
        above."""
        s, st, v = self.sites, self.state, self.v
        force = s.sum(st.forces_nc)  # ∇·σ_U
        div_z = force + s.sum(st.torque_nc)
        convection = np.einsum("g,gc->gc", np.einsum("gmm->g", self.dpi) - np.einsum("gm,gm->g", v, self.drho), v)
        convection += np.einsum("gm,gmc->gc", v, self.dpi)
        div_stress = force - self.divT + convection
        stress = self.S - self.T + self.pi[:, :, None] * v[:, None, :]
        work = np.einsum("gc,gc->g", div_stress, v) + np.einsum("gmn,gmn->g", stress, self.gradv)
        carried = self.energy * np.einsum("gmm->g", self.gradv) + np.einsum("gm,gm->g", v, self.denergy)
        div_A = s.sum(st.flux_n)
        # J + A is ε v − σ·v + q
        div_q = self.divJ + div_A - carried + work
        div_qC = np.einsum("gc,gc->g", div_z, v) + np.einsum("gmn,gmn->g", self.z, self.gradv)
        div_pi = np.einsum("gmm->g", self.dpi)
        residual = self.energy_t + carried - work + div_q - self.body_power
        acting = st.outside_nc is not None
        return {
            "mass": Law({"d(rho)/dt": self.rho_t, "div(rho v)": div_pi}, self.rho_t + div_pi),
            "momentum": Law(
                {"d(rho v)/dt": self.pi_t, "div(rho v v)": convection, "div(stress)": div_stress}
                | ({"body force": self.body} if acting else {}),
                self.pi_t + convection - div_stress - self.body,
            ),
            "energy": Law(
                {"d(e)/dt": self.energy_t, "div(e v)": carried, "div(stress.v)": work, "div(q)": div_q}
                | ({"power of body force": self.body_power} if acting else {}),
                residual,
                residual - div_qC,
            ),
            "churning": Law(
                {"div(stress_potential)": force, "div(z) - div(stress_potential)": s.sum(st.torque_nc)}, div_z
            ),
        }


# ---- the deposited fields on stencils

#: Steps of a stencil in units of h; pairs ±s along each axis.
_STEPS = (1.0, 2.0, 4.0)


def stencil(x_gc, h: float, dimension: int = 3) -> np.ndarray:
    """(g·19, 3): every point, then x ± h, ± 2h, ± 4h along each axis; in the plane, out of which nothing changes, the
    point itself for those along z."""
    steps = np.concatenate([np.zeros((1, 3)), *[[k * s * h * e for s in _STEPS for k in (1, -1)] for e in np.eye(3)]])
    steps[:, dimension:] = 0.0
    return (x_gc[:, None] + steps).reshape(-1, 3)


def divergence(values_g, h: float) -> tuple[np.ndarray, np.ndarray]:
    """∂_µ f[µ, ...] of sixth order from a field on stencils, and (g,) how far two results of fourth order differ:
    rounding and kinks."""
    v = np.asarray(values_g).reshape(-1, 19, *np.shape(values_g)[1:])
    pairs = v[:, 1:].reshape(len(v), 3, 3, 2, *v.shape[2:])
    slopes = []
    for k, s in enumerate(_STEPS):
        difference = pairs[:, :, k, 0] - pairs[:, :, k, 1]
        slopes.append(np.einsum("gmm...->g...", difference) / (2.0 * s * h))
    fourth = [(4.0 * slopes[0] - slopes[1]) / 3.0, (4.0 * slopes[1] - slopes[2]) / 3.0]
    return (16.0 * fourth[0] - fourth[1]) / 15.0, size(fourth[0] - fourth[1])


def deposit_at(x_gc, kern, cell, threads: int):
    """A direct deposit at scattered points for the 21 bond components of `motion`; 14 site components."""
    from ..deposit import exact_at

    return exact_at(x_gc, kern, cell, 14, 21, threads)


def deposited(state: Motion, deposit, field_g21=0.0) -> dict[str, np.ndarray]:
    """density, momentum, velocity, energy, stress, heat_flux, heat_flux_churning, churning at the deposit's points,
    relative to the drift. field_g21 : of `field_bonds`"""
    frame, v = state.frame, state.v_nc
    m, e = frame.masses[:, None], state.total_n[:, None]
    deposit.add_sites(frame.positions, np.concatenate([m, m * v, m * outer6(v), e, e * v], axis=1))
    site, bond = deposit.site_sums(), deposit.bond_sums() + field_g21
    rho, pi, T, eps, J = site[:, 0], site[:, 1:4], full(site[:, 4:10]), site[:, 10], site[:, 11:14]
    S, A, M = bond[:, :9].reshape(-1, 3, 3), bond[:, 9:12], bond[:, 12:].reshape(-1, 3, 3)
    v_g = quotient(pi, rho)
    kinetic = -(T - pi[:, :, None] * v_g[:, None, :])
    z = S + M
    churning = np.einsum("gmn,gn->gm", z, v_g)
    q = J - eps[:, None] * v_g + np.einsum("gmn,gn->gm", kinetic, v_g) + A - np.einsum("gmn,gn->gm", M, v_g) + churning
    return {
        "density": rho, "momentum": pi, "velocity": v_g, "energy": eps, "stress": S + kinetic, "heat_flux": q,
        "heat_flux_churning": churning, "churning": z, "bonds": bond,
    }  # fmt: skip


def from_fields(frame, pot, kern_user, x_gc, threads: int) -> dict[str, np.ndarray]:
    """The same fields as `atc.fields` writes them, as far as it knows them; internal units. `frame` has its drift taken
    off."""
    from ..grids import Grid
    from .driver import fields_of
    from .registry import QUANTITIES
    from .settings import Settings

    names = [
        n for n in ("density", "momentum", "velocity", "energy", "stress", "heat_flux", "churning") if n in QUANTITIES
    ]
    u = frame.units
    grid = Grid.points(u.to_user("length", x_gc))
    more = {"tolerance": FIELD_TOLERANCE} if pot.fields else {}
    result = fields_of([frame], Settings(tuple(names), pot, kern_user, grid, threads=threads, check_points=1, **more))
    if "heat_flux" in names:
        names.append("heat_flux_churning")
    return {n: u.to_internal(QUANTITIES[n].dimension, result.arrays[n]) for n in names}


def field_laws(exact_laws, exact: Exact, fields, h: float) -> dict[str, Law]:
    """The laws with exact rates and with the divergences of deposited fields on stencils of step h."""
    rho, v = fields["density"], fields["velocity"]
    stress, q, qC = fields["stress"], fields["heat_flux"], fields["heat_flux_churning"]
    momentum_flux = rho[:, None, None] * v[:, :, None] * v[:, None, :] - stress
    energy_flux = fields["energy"][:, None] * v - np.einsum("gmn,gn->gm", stress, v) + q
    out = {}
    for law, rate, flux in (
        ("mass", exact.rho_t, fields["momentum"]),
        ("momentum", exact.pi_t - exact.body, momentum_flux),
        ("energy", exact.energy_t - exact.body_power, energy_flux),
    ):
        div, limit = divergence(flux, h)
        out[law] = Law(exact_laws[law].terms, rate + div, limit=limit)
    div, limit = divergence(energy_flux - qC, h)
    out["energy"].without = exact.energy_t - exact.body_power + div
    div, limit = divergence(fields["churning"], h)
    out["churning"] = Law(exact_laws["churning"].terms, div, limit=limit)
    return out


# ---- energies along the motion


def energy_rates(frame, pot, state: Motion, threads: int = 1) -> tuple[float, float, int]:
    """dU^(j)/dt from the sources against differences of U^(j) with all atoms moved along their velocities.

    Returns
    -------
    largest difference over the largest rate; the largest difference between two step sizes of the differences (their
    own error), likewise; and the number of atoms left out because a pair crossed a jump of the potential meanwhile (two
    step sizes disagree by more than 1e-4).
    """
    speed = float(np.sqrt((state.v_nc**2).sum(1)).max(initial=0.0))
    scale = float(np.abs(state.share_rate_n).max(initial=0.0))
    if speed == 0.0 or scale == 0.0:
        return 0.0, 0.0, 0
    # An energy is good to 1e-15 or so, differences of it over 1e-3 Å (1e-3 σ) to 1e-12; h⁴ stays below that.
    tau = 1e-3 / speed

    def shares(t):
        return pot.stream(
            frame.replace(positions=frame.positions + t * state.v_nc), threads=threads, energies=True
        ).energies_n

    slopes = [(shares(s * tau) - shares(-s * tau)) / (2 * s * tau) for s in _STEPS]
    fourth = [(4 * slopes[0] - slopes[1]) / 3, (4 * slopes[1] - slopes[2]) / 3]
    unsure = np.abs(fourth[0] - fourth[1])
    keep = unsure < 1e-4 * scale
    difference = np.abs((16 * fourth[0] - fourth[1]) / 15 - state.share_rate_n)[keep]
    return float(difference.max(initial=0.0)) / scale, float(unsure[keep].max(initial=0.0)) / scale, int((~keep).sum())


# ---- differences between frames


def sums_of_frame(frame, pot, x_gc, kern, drift, shift, threads: int):
    """ρ, ρ v and ε of another frame at the points x + shift, with the drift of the middle frame taken off."""
    energies = pot.stream(frame, threads=threads, energies=True).energies_n
    sites = Sites(x_gc + shift, frame.positions, frame.cell, kern)
    v = frame.velocities - drift
    m = frame.masses
    e = 0.5 * m * (v * v).sum(1) + energies
    return {"mass": sites.sum(m), "momentum": sites.sum(m[:, None] * v), "energy": sites.sum(e)}


def frame_residuals(exact_laws, exact: Exact, before, after, dt: float) -> dict[str, Law]:
    """The laws with rates (after − before)/(2 dt) and the exact divergences of the frame in the middle."""
    rate_of = {
        "mass": ("d(rho)/dt", exact.rho_t),
        "momentum": ("d(rho v)/dt", exact.pi_t),
        "energy": ("d(e)/dt", exact.energy_t),
    }
    out = {}
    for law, (name, rate) in rate_of.items():
        exact_law = exact_laws[law]
        difference = (after[law] - before[law]) / (2.0 * dt)
        residual = exact_law.residual + (difference - rate)
        without = None if exact_law.without is None else exact_law.without + (difference - rate)
        out[law] = Law({**exact_law.terms, name: difference}, residual, without)
    return out
