"""What a difference between the forces of a run and those of a potential looks like: where it probably comes from.

Every test asks whether D_i = F_i(run) − F_i(model) follows one law, D = g m_i, D = q_i E, D = −γ v_i, Σ λ_b e_b along
bonds ..., to within what the digits hide. The first law that holds is named; where none does, it is said which atoms
differ and whether the differences add up to zero, as those of forces between atoms must.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import AtcError
from ..frame import Frame
from ..units import LAMMPS_STYLES, units

#: A law holds when what it leaves is below this share of the difference, or what the digits explain.
UNEXPLAINED = 0.02
#: Bonds of one type whose lengths differ by less than this part are held fixed: shake leaves 1e-4 and less, heat a few
#: per cent.
RIGID = 2e-3
#: Charges are varied only in frames up to this size, molecules fitted only up to so many bonds.
MOST_ATOMS, MOST_BONDS = 20_000, 30_000


@dataclass
class _Case:
    """What the tests look at. D_nc : F_run − F_model. odd : (n,) atoms that differ. noise : (n,) what the digits
    explain of |D|."""

    frame: Frame
    pot: object
    model_nc: np.ndarray
    noise: np.ndarray
    odd: np.ndarray
    threads: int

    @cached_property
    def D_nc(self):
        return self.frame.forces - self.model_nc

    @cached_property
    def size(self):
        return _norm(self.D_nc[self.odd])

    @cached_property
    def same(self):
        """(n,) atoms that certainly do not differ: a difference as large as those of the others would have been seen in
        spite of the digits."""
        return ~self.odd & (8.0 * self.noise < self.size / np.sqrt(self.odd.sum()))

    def holds(self, left, over=None, share: float = UNEXPLAINED) -> bool:
        """Whether what a law leaves of D on the atoms that differ is nothing."""
        noise = _norm(self.noise[self.odd][:, None]) if over is None else over
        return _norm(left) <= max(3.0 * noise, share * self.size)


def _norm(a) -> float:
    return float(np.sqrt((np.asarray(a) ** 2).sum()))


def looks_like(frame, pot, model_nc, noise, odd, threads: int = 1) -> str:
    """In words, what makes the forces of a frame differ from `model_nc` on the atoms `odd`; "" where there is nothing
    to say.

    Parameters
    ----------
    frame : Frame with forces. pot : Potential that gave model_nc (n, 3)
    noise : (n,) size of a difference that the digits of the file explain
    odd : (n,) bool
    """
    if not odd.any():
        return ""
    case = _Case(frame, pot, model_nc, noise, odd, threads)
    for test in (_no_forces, _factor, _held, _rigid, _per_atom, _friction, _noise, _one_coordinate, _bonded, _charges):
        found = test(case)
        if found:
            return found
    return _rest(case)


# --- laws for all atoms


def _no_forces(c: _Case) -> str:
    if not c.frame.forces.any():
        return "forces that were never computed: all that the file holds are 0"
    if not c.model_nc.any():
        return "a potential that does not act on these atoms: its forces are all 0"
    return ""


def _factor(c: _Case) -> str:
    """F_run = k F_model: wrong units of one of them, or an energy scale."""
    F, f = c.frame.forces, c.model_nc
    k = float((F * f).sum() / (f * f).sum())
    left = _norm((F - k * f)[c.odd])
    if abs(k) < 1e-12 or left > 0.01 * _norm(F[c.odd]) or not c.holds(left):
        return ""
    text = f"one factor for all: the run's forces are {k:.6g} times the potential's"
    fits = _unit_factors(c, k)
    return f"{text}: {fits}" if fits else f"{text}: an energy scale (epsilon) or its units"


def _unit_factors(c: _Case, k: float) -> str:
    """Which pair of unit styles with the same length has forces in the ratio k, that of the trajectory or of the
    potential being taken for another."""
    said, given, out = c.frame.units, c.pot.units, []
    for other in (units(name) for name in (*LAMMPS_STYLES, "ase", "gpumd", "mdanalysis")):
        # coefficients written in `other` but read as the potential's units; or forces of the file in `other` read as
        # the trajectory's
        if other.length == given.length and other.name != given.name and not other.reduced and not given.reduced:
            if abs(other.energy / given.energy / k - 1.0) < 1e-3:
                out.append(f"coefficients in {other.name!r} units read as {given.name!r} units")
        if other.length == said.length and other.name != said.name and not other.reduced and not said.reduced:
            if abs(said.energy / other.energy / k - 1.0) < 1e-3:
                out.append(f"a trajectory in {other.name!r} units read as {said.name!r} units")
    return " or ".join(out)


def _held(c: _Case) -> str:
    """Forces that were set: 0, or the same numbers on all atoms that differ."""
    F = c.frame.forces[c.odd]
    if len(F) < 2:
        return ""
    zero = [k for k in range(3) if not F[:, k].any()]
    touched = [k for k in range(3) if _norm(c.D_nc[c.odd][:, k]) > 3.0 * _norm(c.noise[c.odd]) / np.sqrt(3.0)]
    if len(zero) == 3:
        return (
            f"atoms without force ({_which(c)}): fix setforce 0 0 0, fix freeze, or left out of the integration and "
            "of their neighbours' lists"
        )
    if touched and set(touched) <= set(zero):
        return f"forces along {_axes(touched)} set to 0 ({_which(c)}): fix setforce, planeforce, lineforce or enforce2d"
    one_value = touched and all(np.ptp(F[:, k]) <= 1e-5 * np.abs(F[:, k]).max() for k in touched)
    if one_value and np.ptp(c.model_nc[c.odd][:, touched]) > 0:
        return f"forces along {_axes(touched)} set to one value ({_which(c)}): fix setforce or aveforce"
    return ""


def _per_atom(c: _Case) -> str:
    """D_i = w_i g with one vector g for all atoms that differ, w = 1, the mass or the charge."""
    D, f = c.D_nc[c.odd], c.frame
    if len(D) < 3:
        return ""

    def left(w):
        g = (w[:, None] * D).sum(0) / (w @ w)
        return g, D - w[:, None] * g

    weights = {"mass": f.masses, "charge": f.charges}
    weights = {name: w[c.odd] for name, w in weights.items() if w is not None and w[c.odd].any()}
    g, rest = left(np.ones(len(D)))
    if c.holds(rest):
        equal = [name for name, w in weights.items() if np.ptp(w) <= 1e-9 * np.abs(w).max()]
        alike = " (mass and charge are the same for all of them: gravity or an electric field would look the same)"
        more = alike if equal else ""
        value = _vector(f.units.to_user("force", g))
        return f"the same force {value} {f.units.label('force')} on each atom ({_which(c)}): fix addforce{more}"
    if "mass" in weights:
        g, rest = left(weights["mass"])
        if c.holds(rest):
            value = _vector(f.units.to_user("velocity", g) * f.units.time)
            unit = f"{f.units.label('length')}/{f.units.label('time')}^2"
            what = ", or a force on their centre of mass (fix spring, addforce, smd)" if c.same.any() else ""
            return f"forces proportional to mass, acceleration {value} {unit} ({_which(c)}): fix gravity{what}"
    if "charge" in weights:
        E, rest = left(weights["charge"])
        if c.holds(rest):
            value = _vector(E * f.units.charge / f.units.factor("force"))
            return (
                f"forces proportional to charge, {value} {f.units.label('force')} for each unit of charge "
                f"({_which(c)}): fix efield, an electric field"
            )
    return ""


def _friction(c: _Case) -> str:
    """D_i = −γ v_i, with γ that of all atoms, of their types, or proportional to mass."""
    f = c.frame
    if f.velocities is None or not f.velocities[c.odd].any() or c.odd.sum() < 3:
        return ""
    D, v, types = c.D_nc[c.odd], f.velocities[c.odd], f.types[c.odd]
    left, drag_n = D.copy(), np.zeros(len(f))
    for t in np.unique(types):
        of = types == t
        gamma = (D[of] * v[of]).sum() / max((v[of] ** 2).sum(), 1e-300)
        left[of] -= gamma * v[of]
        drag_n[f.types == t] = np.abs(gamma) * np.linalg.norm(f.velocities[f.types == t], axis=1)
    if c.holds(left):
        sign = "against" if (D * v).sum() < 0 else "along"
        return (
            f"forces proportional to velocity, {sign} it ({_which(c, drag_n)}): friction (fix viscous, drag), or "
            "springs to where the atoms just were (fix spring/self)"
        )
    return ""


def _noise(c: _Case) -> str:
    """Independent numbers on each atom, as thermostats with noise add: LAMMPS draws them from a flat distribution,
    whose kurtosis is 9/5."""
    D, types = c.D_nc[c.odd], c.frame.types[c.odd]
    between = abs(float((D * c.model_nc[c.odd]).sum())) > 0.3 * c.size * _norm(c.model_nc[c.odd])
    if D.size < 120 or between:
        return ""
    z = D.copy()
    for t in np.unique(types):
        z[types == t] /= max(np.sqrt((D[types == t] ** 2).mean()), 1e-300)
    kurtosis, spread = float((z**4).mean()), 5.0 * 0.9 / np.sqrt(D.size)
    if abs(kurtosis - 1.8) < max(spread, 0.12):
        slow = ""
        if c.frame.velocities is not None and (D * c.frame.velocities[c.odd]).sum() < 0:
            slow = ", with friction"
        return f"random forces of one size on each atom{slow} ({_which(c)}): a thermostat with noise (fix langevin)"
    return ""


def _one_coordinate(c: _Case) -> str:
    """Differences along one Cartesian axis only."""
    D = c.D_nc[c.odd]
    noise = _norm(c.noise[c.odd]) / np.sqrt(3.0)
    touched = [k for k in range(3) if _norm(D[:, k]) > max(3.0 * noise, 1e-3 * c.size)]
    if len(touched) != 1 or len(D) < 3:
        return ""
    k, x = touched[0], c.frame.positions[:, touched[0]]
    u = c.frame.units
    inside, edge = x[~c.odd], x[c.odd]
    where = _which(c)
    near = ""
    narrow = (edge.max() - edge.min()) < 0.5 * np.ptp(x)
    if len(inside) and (edge.max() < inside.min() or edge.min() > inside.max() or narrow):
        a, b = (float(u.to_user("length", s)) for s in (edge.min(), edge.max()))
        near = f", with {'xyz'[k]} from {a:.4g} to {b:.4g} {u.label('length')}"
    return (
        f"forces along {'xyz'[k]} only, on {where}{near}: a wall, gravity, a spring or another force from outside "
        f"along {'xyz'[k]}"
    )


# --- bonds


def _rigid(c: _Case) -> str:
    """Constraint forces: sums of forces along the bonds (and the third sides of angles) of molecules whose bonds do not
    change their lengths."""
    lines = _molecule_lines(c)
    if lines is None:
        return ""
    ends, kinds, lengths, e_bc = lines
    bonds = kinds > 0
    fixed = [t for t in np.unique(kinds[bonds]) if (kinds == t).sum() > 1 and _spread(lengths[kinds == t]) < RIGID]
    if not fixed:
        return ""
    thirds = [t for t in np.unique(kinds[~bonds]) if _spread(lengths[kinds == t]) < RIGID]
    held = np.isin(kinds, [*fixed, *thirds])
    if _left_along(c, ends[held], e_bc[held]):
        names = ", ".join(map(str, fixed))
        return (
            f"constraint forces along bonds of fixed length (bond type {names}): fix shake, rattle or rigid "
            "molecules, which the potential does not have"
        )
    return ""


def _bonded(c: _Case) -> str:
    """Forces within molecules: along bonds, or along bonds and the third sides of angles."""
    lines = _molecule_lines(c)
    if lines is None:
        return _within_molecules(c)
    ends, kinds, _, e_bc = lines
    bonds = kinds > 0
    if _left_along(c, ends[bonds], e_bc[bonds]):
        found = np.unique(kinds[bonds & (c.odd[ends[:, 0]] & c.odd[ends[:, 1]])])
        return (
            f"forces along bonds (types {', '.join(map(str, found))}): bond coefficients, or bonds that were switched "
            "off or broken"
        )
    if _left_along(c, ends, e_bc):
        return "forces within bonded triples: angle or bond coefficients, or angles that were switched off"
    return _within_molecules(c)


def _molecule_lines(c: _Case):
    """Bonds and 1-3 pairs of the atoms that differ: ends (b, 2), kind (bond type, or minus an angle type), length, unit
    vector; None without bonds."""
    t = c.frame.topology
    if t is None or not len(t.bonds):
        return None
    bonds, kinds = t.bonds, t.bond_types
    thirds = t.angles[:, [0, 2]] if len(t.angles) else np.zeros((0, 2), np.int64)
    ends = np.concatenate([bonds, thirds])
    kinds = np.concatenate([kinds, -t.angle_types]) if len(thirds) else kinds.copy()
    here = c.odd[ends].any(axis=1)
    ends, kinds = ends[here], kinds[here]
    if not len(ends) or len(ends) > MOST_BONDS:
        return None
    r = _nearest(c.frame, c.frame.positions[ends[:, 0]] - c.frame.positions[ends[:, 1]])
    lengths = np.linalg.norm(r, axis=1)
    return ends, kinds, lengths, r / np.maximum(lengths, 1e-300)[:, None]


def _spread(a) -> float:
    return float(np.ptp(a) / a.mean()) if len(a) > 1 else 0.0


def _nearest(frame, r):
    s = np.where(frame.cell.periodic, np.rint(r @ frame.cell.inverse), 0.0)
    return r - s @ frame.cell.vectors


def _left_along(c: _Case, ends, e_bc) -> bool:
    """Whether D = Σ_b λ_b (e_b on the one end, −e_b on the other) for some λ."""
    if not len(ends):
        return False
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import lsmr

    b = np.repeat(np.arange(len(ends)), 3)
    rows = [(3 * ends[:, side, None] + np.arange(3)).ravel() for side in (0, 1)]
    values = np.concatenate([e_bc.ravel(), -e_bc.ravel()])
    A = coo_array((values, (np.concatenate(rows), np.tile(b, 2))), shape=(3 * len(c.frame), len(ends))).tocsr()
    D = np.where(c.odd[:, None], c.D_nc, 0.0).ravel()
    solution = lsmr(A, D, atol=1e-10, btol=1e-10, maxiter=400)[0]
    return c.holds(D - A @ solution)


def _within_molecules(c: _Case) -> str:
    """Differences that add up to zero in every molecule, though not on its atoms."""
    mol = c.frame.extra.get("mol")
    if mol is None or np.ndim(mol) != 1 or c.frame.topology is not None:
        return ""
    number = np.unique(np.asarray(mol).astype(np.int64), return_inverse=True)[1]
    many = np.bincount(number)
    if len(many) < 2 or many.max() < 2 or many.max() > 0.5 * len(mol):
        return ""
    sums = np.stack([np.bincount(number, weights=c.D_nc[:, k]) for k in range(3)], axis=1)
    if c.holds(sums):
        return (
            "forces within molecules (they add up to zero in each): bonded terms or constraints that the potential "
            "does not have"
        )
    return ""


# --- charges


def _charges(c: _Case) -> str:
    """Coulomb forces that are missing, of other charges, or of distant charges."""
    q, n = c.frame.charges, len(c.frame)
    if q is None or not q.any() or n > MOST_ATOMS:
        return ""
    coulomb = _coulomb_forces(c, q)
    if coulomb is None:
        return ""
    if not coulomb.any():
        from .. import potential

        reach = c.frame.units.to_user("length", 12.0 if not c.frame.units.reduced else 3.5)
        damping = c.frame.units.length * 0.15 if not c.frame.units.reduced else 0.5
        sums = potential(
            f"pair_style coul/dsf {damping:.12g} {reach:.12g}\npair_coeff * *",
            units=c.frame.units.name if c.frame.units.name in LAMMPS_STYLES else "metal",
        )
        try:
            theirs = sums.stream(c.frame, None, threads=c.threads, forces=True).forces_nc
        except AtcError:
            return ""
        match = float((theirs * c.D_nc).sum()) / max(_norm(theirs) * _norm(c.D_nc), 1e-300)
        return "Coulomb forces that the potential does not have" if match > 0.8 else ""
    groups = _charge_groups(c.frame)
    found = _other_charges(c, q, coulomb, groups)
    return found or _distant_charges(c, q)


def _coulomb_forces(c: _Case, q):
    """What of the potential's forces depends on charges `q`."""
    frames = c.frame.replace(charges=q), c.frame.replace(charges=np.zeros(len(q)))
    try:
        with_q, without = (c.pot.stream(f, None, threads=c.threads, forces=True).forces_nc for f in frames)
    except AtcError:
        return None
    return with_q - without


def _charge_groups(frame) -> list[np.ndarray]:
    """Atoms of one type, up to four groups of them that bear charges; [] for more."""
    kinds = np.unique(frame.types[frame.charges != 0])
    return [frame.types == t for t in kinds] if len(kinds) <= 4 else []


def _other_charges(c: _Case, q, coulomb, groups) -> str:
    """D = Σ_ab λ_ab F_ab, F_ab the Coulomb forces between two groups: charges of the run are other multiples of these,
    1 + λ_ab = s_a s_b."""
    k = float((coulomb * c.D_nc).sum() / (coulomb**2).sum())
    if c.holds((c.D_nc - k * coulomb)[c.odd]) and k > -1.0 - 1e-9:
        if abs(k + 1.0) < 1e-6:
            return "Coulomb forces that the run did not have: charges that were 0 in it"
        return (
            f"Coulomb forces of other charges, all {np.sqrt(max(1.0 + k, 0.0)):.4g} times these (or another "
            "dielectric constant)"
        )
    if not 2 <= len(groups):
        return ""
    alone = [_coulomb_forces(c, np.where(g, q, 0.0)) for g in groups]
    parts = {(a, a): alone[a] for a in range(len(groups))}
    for a in range(len(groups)):
        for b in range(a + 1, len(groups)):
            both = _coulomb_forces(c, np.where(groups[a] | groups[b], q, 0.0))
            if both is None or alone[a] is None or alone[b] is None:
                return ""
            parts[a, b] = both - alone[a] - alone[b]
    keys = [key for key in parts if parts[key] is not None and parts[key].any()]
    M = np.stack([parts[key].ravel() for key in keys], axis=1)
    lam = np.linalg.lstsq(M, c.D_nc.ravel(), rcond=None)[0]
    left = c.D_nc - (M @ lam).reshape(-1, 3)
    if not c.holds(left):
        return ""
    scale = {}
    for (a, b), value in zip(keys, lam, strict=True):
        if a == b and 1.0 + value > 0:
            scale[a] = np.sqrt(1.0 + value)
    types = [int(c.frame.types[g][0]) for g in groups]
    said = ", ".join(f"{s:.4g} times these on type {types[a]}" for a, s in scale.items() if abs(s - 1.0) > 1e-3)
    return f"Coulomb forces of other charges{': ' + said if said else ''}"


def _distant_charges(c: _Case, q) -> str:
    """Long-range Coulomb: a field E_i = D_i/q_i that hardly differs between near atoms, on charged atoms only."""
    from ..neighbors.cell_list import neighbor_list

    charged = q != 0
    if (c.odd & ~charged).sum() > 0.01 * c.odd.sum():
        return ""
    E = np.where(charged[:, None], c.D_nc / np.where(charged, q, 1.0)[:, None], 0.0)
    near = (c.frame.cell.volume / max(charged.sum(), 1)) ** (1.0 / 3.0)
    at = np.flatnonzero(charged)
    i, j, _, _ = neighbor_list(c.frame.positions[at], c.frame.cell, near)
    if len(i) < 20:
        return ""
    i, j = at[i], at[j]
    alike = float((E[i] * E[j]).sum()) / max(float(0.5 * ((E[i] ** 2).sum() + (E[j] ** 2).sum())), 1e-300)
    if alike > 0.6:
        return (
            "a smooth electric field on charged atoms: Coulomb forces from beyond the cutoff (kspace_style), or of "
            "other long-range terms"
        )
    return ""


# --- where nothing else fits


def _rest(c: _Case) -> str:
    """Which atoms, and whether the differences add up to zero."""
    D = c.D_nc
    total = np.linalg.norm(D.sum(axis=0))
    random = _norm(D)
    noise = 3.0 * _norm(c.noise) + 1e-9 * random
    where = _which(c)
    of = "everything" if c.odd.mean() > 0.9 or not c.same.any() else where
    if total <= noise:
        why = (
            "forces between atoms that the potential has not, or has otherwise: wrong or missing coefficients, "
            "styles, exclusions or units"
        )
        return f"{of}: {why}"
    return (
        f"{of}, and the differences do not add up to zero: forces from outside (a fix that adds forces), or wrong "
        "forces together with them"
    )


def _which(c: _Case, law_n=None) -> str:
    """The atoms that differ, as types, a range of ids, or their number. law_n : (n,) size of the force that a law would
    have on each atom."""
    ids, types = c.frame.ids, c.frame.types
    same = c.same if law_n is None else ~c.odd & (8.0 * c.noise < law_n)
    if not same.any():
        return "all atoms"
    theirs, others = set(np.unique(types[c.odd]).tolist()), set(np.unique(types[same]).tolist())
    if not theirs & others:
        return f"the atoms of type {', '.join(map(str, sorted(theirs)))}"
    at = np.flatnonzero(c.odd)
    if len(at) == 1:
        return f"atom {ids[at[0]]}"
    if not same[at[0] : at[-1] + 1].any():
        return f"atoms {ids[at[0]]} to {ids[at[-1]]}"
    only = f", all of type {next(iter(theirs))}" if len(theirs) == 1 else ""
    return f"{len(at)} of {len(ids)} atoms{only}"


def _vector(a) -> str:
    a = np.where(np.abs(a) < 5e-4 * np.abs(a).max(), 0.0, a)  # what the digits of a file leave
    return f"[{', '.join(f'{v:.4g}' for v in a)}]"


def _axes(which) -> str:
    return " and ".join("xyz"[k] for k in which)
