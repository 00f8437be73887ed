"""Stillinger-Weber: a two-body term and a three-body term that prefers one bond angle (LAMMPS ``pair_style sw``).

A frame is done in four stages, so that each pair of neighbours becomes *one* bond that carries the two-body force and
everything that the triplets at both of its ends add to it:

0. pairs: the half neighbour list, with what depends on one distance only (one square root and at most three
  exponentials a pair);
1. join: which pairs meet at which atom;
2. triplets: around each atom, G of the two arms into slots of their own (one for each end of a pair: no two threads
  meet), and the outer
   distances b–c as bonds of their own;
3. merge: two-body + both slots, one bond a pair.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ...frame import Frame
from ...units import Units
from ...units import units as system
from ..bond_sums import two_body_sources
from ..registry import pair_style
from .elements import mapped_line
from .entries import OfTriplets
from .neighbor_work import TripletWork, shares
from .stillinger_weber_file import SWEntry
from .stillinger_weber_kernels import SQUARE, SWITCHED, sw_pairs
from .twin_entries import agree, both, require_alike


class _SWWork(TripletWork):
    def __init__(self, term: StillingerWeber, frame: Frame):
        super().__init__(term, frame)
        if not term.threebody:
            self.stages = self.stages[:1]

    def pairs(self, task, acc):
        ws, term = acc.ws, self.term
        n = self.list.half(task, ws)
        rec = np.empty((n, 8))
        m, energy, bad = sw_pairs(
            ws.i, ws.j, ws.r, ws.d2, n, self.element, term.pair, term.same_ends, self.atom, rec, ws.G, shares(acc)
        )
        self.require_finite(bad, ws)
        acc.energy += energy
        if term.threebody:
            self.parts[task] = ws.i[:m].copy(), ws.j[:m].copy(), rec[:m], ws.G[:m].copy()
            return None
        bonds = Bonds(self.atom[ws.i[:m]], self.atom[ws.j[:m]], np.ascontiguousarray(rec[:m, :3]), ws.G[:m])
        if acc.sources:
            bonds.D_bdc = two_body_sources(bonds)
        return bonds


class StillingerWeber(OfTriplets):
    """U = Σ_pairs A ε [B (σ/d)^p − (σ/d)^q] exp(σ/(d − aσ)) + Σ_triplets λ ε (cos θ − cos θ0)² exp(γσ/(d_ab − aσ))
    exp(γσ/(d_ac − aσ)).

    Both sums are over distances below aσ (below LAMMPS's shortened cutoff for ``tol`` > 0), where every derivative
    vanishes; at and beyond it the terms are exactly 0. Half of a pair's energy goes to each end, a third of a triplet's
    to each of its atoms (`partition`).

    G of a triplet around a, with h the two exponentials and δ = cos θ − cos θ0 (never divided by: δ = 0 is the perfect
    crystal): G_bc = −2 λε h_b h_c δ / (d_ab d_ac), G_ab = 2 λε h_b h_c δ (1/(d_ab d_ac) − cos θ/d_ab²) − λε h_b h_c δ²
    γσ/(d_ab (d_ab − aσ)²).

    Parameters
    ----------
    epsilon, sigma, a, lam (λ), gamma, costheta0, A, B, p, q, tol : floats, the numbers of a line of LAMMPS's file, for
    one element;
        epsilon (energy) and sigma (length) in `units`
    units : unit style of epsilon and sigma; the default has eV and Å
    elements : which atom types take part, from type 1: e.g. ``["Si", None]`` leaves out type 2. Default: atoms of every
        type are this element.
    threebody : False leaves out the triplets (LAMMPS's ``threebody off``)
    partition : how a triplet's energy is shared among its atoms: "equal" (a third each, as LAMMPS), "center" (all to
        the atom at the centre), or
        the centre's share and that of each of the other two, which with it add up to 1: (0.5, 0.25, 0.25). Stress and
        total energy do not depend on it; heat flux and churning do.

    Raises
    ------
    AtcError for parameters that make no sense.

    Notes
    -----
    Several elements: `from_file`, `from_entries`. Source: Stillinger & Weber, Phys. Rev. B 31, 5262 (1985); R
    4.0.150-4.0.155 corrected.
    """

    work = _SWWork
    part_name = "sw"
    #: The style's name, the angular function, and its numbers besides cos θ0.
    style, word = "sw", "Stillinger-Weber"
    entry = SWEntry
    angular = SQUARE
    deltas = (0.0, 0.0)

    def __init__(
        self,
        epsilon,
        sigma,
        a,
        lam,
        gamma,
        costheta0,
        A,
        B,
        p,
        q,
        tol=0.0,
        *,
        units: str | Units = "metal",
        elements=None,
        threebody=True,
        partition="equal",
    ):
        entry = SWEntry(*(float(v) for v in (epsilon, sigma, a, lam, gamma, costheta0, A, B, p, q, tol)))
        name = next((e for e in elements or () if e is not None), "X")
        if elements is not None and len({e for e in elements if e is not None}) > 1:
            raise AtcError(
                f"{entry.where}: one set of numbers is one element, got {elements}: use StillingerWeber.from_entries "
                "for several"
            )
        self._build({(name, name, name): entry}, elements, units, threebody, partition)

    @classmethod
    def from_entries(
        cls, entries: dict, elements, *, units: str | Units = "metal", threebody: bool = True, partition="equal"
    ) -> StillingerWeber:
        """Several elements, see `OfEntries.from_entries`."""
        self = cls.__new__(cls)
        self._build(entries, elements, units, threebody, partition)
        return self

    def _build(self, entries, elements, units_, threebody, partition):
        self.share(partition)
        u = system(units_)
        entries, names = self.take(entries, elements, u)
        self.elements, self.names = elements, names
        self.threebody = bool(threebody)
        self.bodies = 3 if threebody else 2
        #: outer bonds with |G| at or below this are left out (unless energy sources are wanted). 0 drops what is
        #: exactly zero and nothing else.
        self.prune = 0.0
        m = len(names)
        self.pair = np.zeros((m, m, 8))
        self.triplet = np.zeros((m, m, m, 4))
        for (ia, a), (ib, b) in product(enumerate(names), repeat=2):
            e = entries[a, b, b]
            sigma, energy = e.sigma * u.length, e.epsilon * u.energy
            cut = e.a * sigma
            with np.errstate(over="ignore", invalid="ignore"):
                powers = np.power(sigma, [e.p, e.q])
                U2 = e.A * energy * e.B * powers[0], e.A * energy * powers[1], e.p, e.q
                self.pair[ia, ib] = _list_cutoff(e, sigma), cut, sigma, *U2, e.gamma * sigma
            if not np.isfinite(self.pair[ia, ib, 3:]).all():
                raise AtcError(
                    f"{e.where}: the entry {a} {b} {b} gives no finite energy: A, B, epsilon or the powers p and q of "
                    "sigma are too large"
                )
            if not 0 < self.pair[ia, ib, 0] < np.inf:
                raise AtcError(
                    f"{e.where}: a·sigma must be a positive length in the entry {a} {b} {b} (its cutoff), got {e.a} · "
                    f"{e.sigma}"
                )
            for ic, c in enumerate(names):
                t = entries[a, b, c]
                strength = t.lam * (t.epsilon * u.energy) if threebody else 0.0
                self.triplet[ia, ib, ic] = strength, t.costheta0, *self.deltas
        self._symmetric(entries)
        self.same_ends = bool((self.pair[..., 7] == self.pair[..., 7].T).all())
        self.cutoff = float(self.pair[..., 0].max())

    def _symmetric(self, entries):
        """Where LAMMPS would take one of two entries by the numbering of the atoms, they must say the same."""
        names, unit = self.names, self.units.label("energy")
        for (i, a), (j, b) in combinations(enumerate(names), 2):
            twins = entries, (a, b, b), (b, a, a)
            what = f"{both(*twins)}: the two-body terms of {a} and {b} in both entries"
            alike = agree(self.pair[i, j, :7], self.pair[j, i, :7], what, self._two_body, unit)
            what = "two-body terms or cutoffs for the same pair, of which LAMMPS takes one by the atoms' numbers"
            require_alike(*twins, alike, what)
        for (i, a), ((j, b), (k, c)) in product(enumerate(names), combinations(enumerate(names), 2)):
            twins = entries, (a, b, c), (a, c, b)
            x, y = self.triplet[i, j, k], self.triplet[i, k, j]
            what = f"{both(*twins)}: lambda*epsilon or costheta0 of {b}-{a}-{c} in both entries"
            alike = agree(x, y, what)
            what = (
                "lambda*epsilon or costheta0 for the same triplet, of which LAMMPS takes one by the order of its list"
            )
            require_alike(*twins, alike, what)
            self.triplet[i, j, k] = self.triplet[i, k, j] = 0.5 * (x + y)
        mean = 0.5 * (self.pair + self.pair.transpose(1, 0, 2))
        self.pair[..., :7] = mean[..., :7]

    def _two_body(self, row):
        """The two-body energy in the user's unit at distances from σ to the cutoff."""
        _, cut, sigma, repulsive, attractive, p, q = row[:7]
        d = np.linspace(sigma, cut, 200, endpoint=False)
        return self.units.to_user("energy", (repulsive * d**-p - attractive * d**-q) * np.exp(sigma / (d - cut)))

    def describe(self) -> str:
        what = f"{self.style} {'-'.join(str(n) for n in self.names)}" if self.elements is not None else self.style
        if not self.threebody:
            return f"{what} without three-body term, pair energy shared half to each atom"
        return (
            f"{what}, pair energy shared half to each atom, triplet energy {self.shared}; one merged bond a pair, "
            "outer b-c bonds apart"
        )


def _list_cutoff(e: SWEntry, sigma: float) -> float:
    """The distance from which on LAMMPS leaves a pair out: aσ, or less by what makes exp(σ/(d − aσ)) smaller than
    tol."""
    cut = e.a * sigma
    if e.tol > 0:
        cut += (e.gamma if e.gamma < 1.0 else 1.0) * sigma / np.log(min(e.tol, 0.01))
    return cut


class StillingerWeberMod(StillingerWeber):
    """`StillingerWeber` with [g_C(δ) δ]² for δ² = (cos θ − cos θ0)², g_C = 1 up to |δ| = δ1, 0 from δ2 on, ½ + ½ cos(π
    (|δ| − δ1)/(δ2 − δ1)) between, so that sheets of atoms with two kinds of angles hold together (LAMMPS ``sw/mod``).

    Between δ1 and δ2 LAMMPS's forces have 2 g_C δ where the derivative of the energy is 2 g_C δ (g_C + δ g_C'): its
    runs do not conserve energy while a triplet passes there. Forces and stress are those of the run, energies too; the
    balance of energy is broken by as much as the run broke it, and a note counts such triplets.

    Parameters
    ----------
    As `StillingerWeber`; δ1 and δ2 are 0.25 and 0.35 unless `switch` says otherwise (``pair_style sw/mod maxdelta``).

    Notes
    -----
    Source: Jiang, Acta Mech. Solida Sin. 32, 17 (2019).
    """

    style = "sw/mod"
    angular = SWITCHED
    deltas = (0.25, 0.35)

    def switch(self, first: float, last: float) -> None:
        """From now on with these δ1 and δ2."""
        self.deltas = first, last
        self.triplet[..., 2:] = self.deltas


@pair_style("sw", mapped=True)
def _sw(inp):
    args = list(inp.args)
    threebody = True
    while args:
        if args[0] != "threebody" or len(args) < 2 or args[1] not in ("on", "off", "yes", "no", "true", "false"):
            raise inp.error(f"pair_style sw: expected nothing or threebody on|off, got {' '.join(args)!r}")
        threebody = args[1] in ("on", "yes", "true")
        args = args[2:]
    return _from_line(inp, StillingerWeber, threebody=threebody)


@pair_style("sw/mod", mapped=True)
def _sw_mod(inp):
    term = _from_line(inp, StillingerWeberMod)
    if inp.args:
        if len(inp.args) != 3 or inp.args[0] != "maxdelta":
            raise inp.error(
                f"pair_style sw/mod: expected nothing or maxdelta and two numbers, got {' '.join(inp.args)!r}"
            )
        deltas = tuple(inp.number(w, 1.0, "maxdelta") for w in inp.args[1:])
        if not 0 <= deltas[0] < deltas[1]:
            raise inp.error(f"pair_style sw/mod: maxdelta takes 0 <= delta1 < delta2, got {' '.join(inp.args[1:])}")
        term.switch(*deltas)
    return term


def _from_line(inp, kind, **more):
    """The potential of the one ``pair_coeff * *`` line."""
    path, elements, line = mapped_line(inp.replace(args=()), ".sw")
    return kind.from_file(path, elements, units=inp.units, where=line.where, **more)
