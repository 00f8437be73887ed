"""LAMMPS's ``kspace_style`` and ``kspace_modify``: what they say of the model, and of the run's own accuracy."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from .ewald import LongRangeCoulomb
from .split import ACCURACY, accuracy_for

#: They all compute the sum that is computed here, to their own accuracy.
STYLES = frozenset("ewald ewald/disp pppm pppm/cg pppm/stagger pppm/disp pppm/tip4p pppm/disp/tip4p".split())
_REFUSED = {
    "msm": "multilevel summation is another sum, of a Coulomb interaction that ends at a distance",
    "scafacos": "what it computes depends on another library",
    "dipole": "point dipoles have torques, which no straight bond has",
    "dielectric": "each atom has a dielectric constant of its own, which frames do not carry",
    "electrode": "the charges of electrodes follow from potentials",
    "zero": "its pair style keeps the bonds of a split whose other part is left out",
}
#: keyword: how many values it has. Those that steer how the run computed the sum, not which.
_HARMLESS = {
    "collective": 1, "cutoff/adjust": 1, "diff": 1, "disp/auto": 1, "fftbench": 1, "force/disp/real": 1,
    "force/disp/kspace": 1, "gewald": 1, "gewald/disp": 1, "kmax/ewald": 3, "kmax/ewald/disp": 3, "mesh": 3,
    "mesh/disp": 3, "minorder": 1, "mix/disp": 1, "order": 1, "order/disp": 1, "overlap": 1, "pressure/scalar": 1,
    "splittol": 1, "eigtol": 1,
}  # fmt: skip


@dataclass(frozen=True)
class RunAccuracy:
    """How well the run computed its Coulomb forces, by its own estimate.

    style, accuracy : words of the kspace_style line, the accuracy relative to the force of two unit charges at unit
        distance
    force : that accuracy as a force, internal units
    """

    style: str
    accuracy: float
    force: float

    def describe(self, units) -> str:
        return (
            f"the run's own {self.style} was asked for forces to {units.to_user('force', self.force):.3g} "
            f"{units.label('force')} (accuracy {self.accuracy:g})"
        )


@dataclass
class Kspace:
    """The lines of one script."""

    style: object  # Command
    modify: tuple = ()

    def asked(self, units) -> tuple[float | None, RunAccuracy]:
        """How many times as high as the frame's cell the run's is, and its accuracy."""
        c = self.style
        name = c.words[0]
        try:
            accuracy = float(c.words[1])
        except (IndexError, ValueError):
            raise c.error(
                f"kspace_style {name} needs its accuracy, a number such as 1e-4, got "
                f"{' '.join(c.words[1:]) or 'nothing'}"
            ) from None
        slab, force = self._modified(units)
        # LAMMPS: the force between two unit charges at distance 1 of the run's unit.
        unit = units.coulomb * units.charge**2 / units.length**2
        return slab, RunAccuracy(name, accuracy, accuracy * unit if force is None else force)

    def _modified(self, units):
        slab = force = None
        for c in self.modify:
            words = list(c.words)
            while words:
                key = words.pop(0)
                if key in _HARMLESS:
                    n = _HARMLESS[key]
                    if len(words) < n:
                        raise c.error(f"kspace_modify {key} needs {n} value{'s' * (n > 1)}")
                    del words[:n]
                    continue
                value = words.pop(0) if words else ""
                if key == "slab":
                    slab = self._slab(c, value)
                elif key == "force":
                    force = units.to_internal("force", self._number(c, key, value))
                    force = None if force < 0 else force
                elif key == "compute" and value in ("yes", "on", "true"):
                    continue
                elif key == "compute":
                    raise c.error(
                        f"kspace_modify compute {value}: without the smooth part the forces depend on the "
                        "run's own alpha, which its lines do not say"
                    )
                else:
                    raise c.error(
                        f"kspace_modify {key} is not supported: expected slab, force, {', '.join(sorted(_HARMLESS))}"
                    )
        return slab, force

    def _number(self, c, key, value) -> float:
        try:
            return float(value)
        except ValueError:
            raise c.error(f"kspace_modify {key}: expected a number, got {value or 'nothing'}") from None

    def _slab(self, c, value):
        if value == "nozforce":
            raise c.error(
                "kspace_modify slab nozforce is not supported: without its forces along z the sum has no energy"
            )
        factor = self._number(c, "slab", value)
        if factor == 1.0:
            return None
        if not factor > 1.0:
            raise c.error(
                f"kspace_modify slab: the cell must be higher than the frame's, got {value} (3.0 is what "
                "the manual recommends)"
            )
        return factor


def check_style(c) -> None:
    """Raise AtcError unless the sum of a kspace_style line is one that is computed here. A name without its accelerator
    suffix."""
    from ..pairs.hybrid import strip_suffix

    name = strip_suffix(c.words[0]) if c.words else ""
    if name in STYLES:
        return
    why = next((why for word, why in _REFUSED.items() if word in name.split("/")), None)
    raise c.error(
        f"kspace_style {name or 'nothing'} is not supported: {why or 'expected one of ' + ', '.join(sorted(STYLES))}"
    )


def coulomb_of(terms):
    """[CoulombLong] of the pair terms."""
    from ..pairs.coulomb_long import CoulombLong

    return [s for t in terms for s in t.styles if isinstance(s, CoulombLong)]


def dispersion_of(terms):
    """[LennardJonesLong] of the pair terms."""
    from ..pairs.lj_long import LennardJonesLong

    return [s for t in terms for s in t.styles if isinstance(s, LennardJonesLong)]


@dataclass
class _GrownC6:
    """C6 for more types. A class, so that a potential can be sent to other processes."""

    grow: object

    def __call__(self, n_types: int):
        from ..pairs.lj_long import LennardJonesLong

        return next(s.C for s in self.grow(n_types) if isinstance(s, LennardJonesLong))


def _dispersion(kspace: Kspace, terms, units, where: str):
    """The smooth part of long-range dispersion."""
    from ..pairs.hybrid import strip_suffix
    from .dispersion import LongRangeDispersion

    styles = dispersion_of(terms)
    name = strip_suffix(kspace.style.words[0])
    if "disp" not in name.split("/"):
        raise AtcError(
            f"{kspace.style.where}: kspace_style {name} has no dispersion: {styles[0].name} needs ewald/disp or "
            "pppm/disp"
        )
    if len(styles) > 1 or styles[0].factor != 1.0:
        raise AtcError(
            f"{where}: long-range dispersion is in more than one sub-style, or has a factor: keep one of them"
        )
    slab, run = kspace.asked(units)
    if slab is not None:
        raise AtcError(f"{where}: kspace_modify slab with long-range dispersion is not supported")
    grow = next(t.grow for t in terms if styles[0] in t.styles)
    return LongRangeDispersion(styles[0].split, styles[0].C, run, grow=grow and _GrownC6(grow))


def kspace_term(kspace: Kspace | None, terms, units, where: str):
    """The smooth part that belongs to the pair styles of a model, [] if it has no long-range Coulomb."""
    styles, dispersive = coulomb_of(terms), dispersion_of(terms)
    if not styles and not dispersive and kspace is None:
        return []
    if kspace is None:
        raise AtcError(
            f"{where}: {(styles or dispersive)[0].name} is only the near part of a long-range sum: add the "
            "kspace_style line of the run (or use coul/cut, coul/dsf)"
        )
    found = [_dispersion(kspace, terms, units, where)] if dispersive else []
    if not styles and dispersive:
        return found
    if not styles:
        c = kspace.style
        raise c.error(
            f"kspace_style {' '.join(c.words)} without a pair style that belongs to it (such as "
            "lj/cut/coul/long): leave it out, or give the pair style"
        )
    split = styles[0].split
    if any(s.split.cutoff != split.cutoff or s.split.constant != split.constant for s in styles):
        raise AtcError(
            f"{where}: the Coulomb cutoffs of the sub-styles differ: one for all of them, as LAMMPS wants it"
        )
    if len({s.factor for s in styles}) > 1:
        raise AtcError(f"{where}: a long-range style with a factor is not supported")
    covered = sum(s.on.astype(int) for s in styles)
    if (covered[1:, 1:] > 1).any():
        i, j = np.argwhere(covered[1:, 1:] > 1)[0] + 1
        raise AtcError(
            f"{where}: the Coulomb bonds of types {i} and {j} are counted {covered[i, j]} times by the sub-styles: "
            "keep one of them"
        )
    term = LongRangeCoulomb(split, *kspace.asked(units))
    term.covered = covered > 0
    term.on_sites = any(s.water is not None for s in styles)
    if term.on_sites and not all(s.water is not None for s in styles):
        raise AtcError(
            f"{where}: some of the long-range sub-styles have the charges of TIP4P water on virtual sites, others on "
            "its oxygens: tip4p/long for all of them"
        )
    if term.on_sites != ("tip4p" in kspace.style.words[0].split("/")):
        raise AtcError(
            f"{kspace.style.where}: kspace_style {kspace.style.words[0]} with pair_style {styles[0].name}: as in "
            "LAMMPS, pppm/tip4p (or pppm/disp/tip4p) goes with tip4p pair styles, and only with them"
        )
    return [term, *found]


def for_tolerance(pot, tolerance: float, exactly: bool):
    """The same potential with bonds and modes of its long-range Coulomb that suffice for fields of a tolerance, α as it
    was; exactly : and no less than by default, for sums over the box and over atoms, which have no tolerance."""
    accuracy = accuracy_for(tolerance)
    return converged(pot, min(accuracy, ACCURACY) if exactly else accuracy)


def finer(pot):
    """The same potential with what measures the error of its split: α as it was, the rest a hundred times more
    accurate; None for one without long-range Coulomb."""
    splits = [s.split for t in pot.terms for s in t.styles if s.split is not None]
    return converged(pot, max(0.01 * splits[0].accuracy, 1e-15)) if splits else None


def with_alpha(pot, alpha):
    """The same potential with its long-range Coulomb split at another α, 1 over the potential's unit of length."""
    if not pot.fields:
        raise AtcError(
            "alpha: the potential has no long-range Coulomb (kspace_style) that could be split: leave it out"
        )
    if not (isinstance(alpha, (int, float)) and not isinstance(alpha, bool) and 0.0 < alpha < np.inf):
        raise AtcError(
            f"alpha {alpha!r}: expected a positive number, 1 over a length, such as 3 over the Coulomb cutoff"
        )
    return converged(pot, ACCURACY, 1.0 / pot.units.to_internal("length", 1.0 / alpha))


def converged(pot, accuracy: float, alpha: float | None = None):
    """The same potential with the bonds and modes of its long-range Coulomb for another accuracy, or α; itself if it
    has none."""
    from ..pairs.pairs import Pairs

    if not pot.fields and not any(s.split is not None for t in pot.terms for s in t.styles):
        return pot
    new = copy(pot)
    new.terms = []
    for t in pot.terms:
        if t.field:
            t = t.at(accuracy, alpha)
        elif isinstance(t, Pairs) and any(s.split is not None for s in t.styles):
            own = [s.split.alpha for s in coulomb_of([t])] if alpha is None else [alpha]
            grown = t.grow and _Grown(t.grow, accuracy, own[0] if own else None)
            t = type(t)(_split(t.styles, accuracy, alpha), t.n_types, t.special, grown, t.exclusions, t.kinds)
        new.terms.append(t)
    return new


def _split(styles, accuracy, alpha):
    return [s if s.split is None else s.at(accuracy, alpha) for s in styles]


@dataclass
class _Grown:
    """Styles for more types, split like the others. A class, so that a potential can be sent to other processes."""

    grow: object
    accuracy: float
    alpha: float | None

    def __call__(self, n_types: int):
        return _split(self.grow(n_types), self.accuracy, self.alpha)
