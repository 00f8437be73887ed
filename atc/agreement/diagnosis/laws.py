"""Laws for all atoms that differ: a factor, a set value, one force for each atom, friction, noise."""

from __future__ import annotations

import numpy as np

from ...units import LAMMPS_STYLES, units
from .case import Case, norm, which


def no_forces(c: Case) -> str:
    """All forces of the one or the other are 0."""
    if not c.frame.forces.any():
        return "forces that were never computed: all that the file holds are 0"
    if not c.model_nc.any():
        return "a potential that does not act on these atoms: its forces are all 0"
    return ""


def factor(c: Case) -> str:
    """F_run = k F_model: wrong units of one of them, or an energy scale."""
    F, f = c.frame.forces, c.model_nc
    k = float((F * f).sum() / (f * f).sum())
    left = norm((F - k * f)[c.odd])
    if abs(k) < 1e-12 or left > 0.01 * norm(F[c.odd]) or not c.holds(left):
        return ""
    text = f"one factor for all: the run's forces are {k:.6g} times the potential's"
    fits = _unit_factors(c, k)
    return f"{text}: {fits}" if fits else f"{text}: an energy scale (epsilon) or its units"


def _unit_factors(c: Case, k: float) -> str:
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


def held(c: Case) -> str:
    """Forces that were set: 0, or the same numbers on all atoms that differ."""
    F = c.frame.forces[c.odd]
    if len(F) < 2:
        return ""
    zero = [k for k in range(3) if not F[:, k].any()]
    touched = [k for k in range(3) if norm(c.D_nc[c.odd][:, k]) > 3.0 * norm(c.noise[c.odd]) / np.sqrt(3.0)]
    if len(zero) == 3:
        return (
            f"atoms without force ({which(c)}): fix setforce 0 0 0, fix freeze, or left out of the integration and "
            "of their neighbours' lists"
        )
    if touched and set(touched) <= set(zero):
        return f"forces along {_axes(touched)} set to 0 ({which(c)}): fix setforce, planeforce, lineforce or enforce2d"
    one_value = touched and all(np.ptp(F[:, k]) <= 1e-5 * np.abs(F[:, k]).max() for k in touched)
    if one_value and np.ptp(c.model_nc[c.odd][:, touched]) > 0:
        return f"forces along {_axes(touched)} set to one value ({which(c)}): fix setforce or aveforce"
    return ""


def per_atom(c: Case) -> str:
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
        return f"the same force {value} {f.units.label('force')} on each atom ({which(c)}): fix addforce{more}"
    if "mass" in weights:
        g, rest = left(weights["mass"])
        if c.holds(rest):
            value = _vector(f.units.to_user("velocity", g) * f.units.time)
            unit = f"{f.units.label('length')}/{f.units.label('time')}^2"
            what = ", or a force on their centre of mass (fix spring, addforce, smd)" if c.same.any() else ""
            return f"forces proportional to mass, acceleration {value} {unit} ({which(c)}): fix gravity{what}"
    if "charge" in weights:
        E, rest = left(weights["charge"])
        if c.holds(rest):
            value = _vector(E * f.units.charge / f.units.factor("force"))
            return (
                f"forces proportional to charge, {value} {f.units.label('force')} for each unit of charge "
                f"({which(c)}): fix efield, an electric field"
            )
    return ""


def friction(c: Case) -> str:
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
            f"forces proportional to velocity, {sign} it ({which(c, drag_n)}): friction (fix viscous, drag), or "
            "springs to where the atoms just were (fix spring/self)"
        )
    return ""


def random_forces(c: Case) -> str:
    """Independent numbers on each atom, as thermostats with noise add: LAMMPS draws them from a flat distribution,
    whose kurtosis is 9/5."""
    D, types = c.D_nc[c.odd], c.frame.types[c.odd]
    between = abs(float((D * c.model_nc[c.odd]).sum())) > 0.3 * c.size * norm(c.model_nc[c.odd])
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
        return f"random forces of one size on each atom{slow} ({which(c)}): a thermostat with noise (fix langevin)"
    return ""


def one_coordinate(c: Case) -> str:
    """Differences along one Cartesian axis only."""
    D = c.D_nc[c.odd]
    noise = norm(c.noise[c.odd]) / np.sqrt(3.0)
    touched = [k for k in range(3) if norm(D[:, k]) > max(3.0 * noise, 1e-3 * c.size)]
    if len(touched) != 1 or len(D) < 3:
        return ""
    k, x = touched[0], c.frame.positions[:, touched[0]]
    u = c.frame.units
    inside, edge = x[~c.odd], x[c.odd]
    where = which(c)
    near = ""
    narrow = (edge.max() - edge.min()) < 0.5 * np.ptp(x)
    if len(inside) and (edge.max() < inside.min() or edge.min() > inside.max() or narrow):
        a, b = (float(u.to_user("length", s)) for s in (edge.min(), edge.max()))
        near = f", with {'xyz'[k]} from {a:.4g} to {b:.4g} {u.label('length')}"
    return (
        f"forces along {'xyz'[k]} only, on {where}{near}: a wall, gravity, a spring or another force from outside "
        f"along {'xyz'[k]}"
    )


def _vector(a) -> str:
    a = np.where(np.abs(a) < 5e-4 * np.abs(a).max(), 0.0, a)  # what the digits of a file leave
    return f"[{', '.join(f'{v:.4g}' for v in a)}]"


def _axes(which) -> str:
    return " and ".join("xyz"[k] for k in which)
