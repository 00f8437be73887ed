"""One frame of a learned model, in stages: the half neighbour list; its directed edges; energies and gradients, all at
once or in batches of atoms with what is around them; one bond a pair (or, for central forces, the bonds of each atom's
star)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ...frame import Frame
from ..base import Accumulator, Work
from ..many_body.neighborhood import Neighborhood
from .graph import Edges, Place
from .guards import COMPARE_EVERY, GUARD, against_own, identity, symmetric

if TYPE_CHECKING:
    from .edge_model import EdgeModel


class EdgeWork(Work):
    """An `EdgeModel` on one frame."""

    def __init__(self, term: EdgeModel, frame: Frame):
        self.term, self.frame = term, frame
        species_n, who = term.map(frame)
        self.near = near = Neighborhood(frame, who, term.cutoff, term.name)
        self.species = species_n[near.atom]
        self.stages = (near.chunks, 1, 1, near.chunks)

    def run(self, stage, task, acc: Accumulator):
        last = self._stars if self.term.central else self._merge
        return (self._collect, self._join, self._evaluate, last)[stage](task, acc)

    def _collect(self, task, acc):
        self.near.collect(task, acc.ws)

    def _join(self, task, acc):
        near = self.near
        near.join()
        self.edges = Edges.of(near.a, near.b, near.r_pc / self.term.length, len(near.atom))

    def _evaluate(self, task, acc):
        term, frame, edges, near = self.term, self.frame, self.edges, self.near
        n = edges.n
        cell = frame.cell
        place = Place(frame.positions[near.atom] / term.length, cell.vectors / term.length, cell.periodic)
        moving = acc.sources and frame.velocities is not None
        v_nc = frame.velocities[near.atom] / term.length if moving else None
        source = frame.source
        compare = term.own is not None and term._evaluated % COMPARE_EVERY == 0
        term._evaluated += 1
        batch = term.look(edges, self.species, place, source, moving) if n else None
        parts = [edges.whole()]
        if batch is not None:
            parts = (edges.around(np.arange(k, min(n, k + batch)), term.hops) for k in range(0, n, batch))
        energy_n, share_n = np.zeros(n), np.zeros(n)
        self.g_ec, self.a_e = np.zeros((len(edges), 3)), np.zeros(len(edges)) if moving else None
        for part in parts:
            found = term.evaluate(part, self.species, place, None if v_nc is None else v_nc[part.atoms], source)
            if not found.left <= GUARD[term.precision]:
                raise AtcError(
                    f"{source}: {term.name}: the energy depends on positions or the cell in other ways than through "
                    f"its edges ({found.left:.1e} of the largest force: long-range charges, dispersion, lists of its "
                    "own): such a part cannot be given by edges; use the model without it"
                )
            energy_n[part.atoms] += found.energy_n
            self.g_ec[part.edges] += found.g_ec
            if moving:
                self.a_e[part.edges] += found.rates.a_e
                share_n[part.atoms] += found.rates.share_n
        if not (np.isfinite(energy_n).all() and np.isfinite(self.g_ec).all()):
            bad = ~np.isfinite(energy_n)
            np.logical_or.at(bad, edges.centre, ~np.isfinite(self.g_ec).all(1))
            raise AtcError(
                f"{source}: {term.name}: energy or forces of atom {frame.ids[near.atom[bad]].min()} are not "
                "finite numbers"
            )
        symmetric(term, edges, self.g_ec, source)
        if moving:
            error = identity(term, edges, self.g_ec, self.a_e, share_n, v_nc, source)
            acc.measured("energy_identity", error)
        if compare:
            against_own(term, edges, self.g_ec, energy_n, self.species, place, source, batch)
        if term.reference is not None:
            for number, value in term.reference.items():
                energy_n[self.species == number] -= value
        acc.energy += float(energy_n.sum()) * term.energy
        if acc.energies is not None:
            acc.energies[near.atom] += energy_n * term.energy
        self.g_ec *= term.energy / term.length
        if moving:
            self.a_e *= term.energy

    def _merge(self, task, acc):
        near, edges = self.near, self.edges
        p = slice(near.edges[task], near.edges[task + 1])
        there, back = edges.there[p], edges.back[p]
        D = np.stack([self.g_ec[there], self.g_ec[back]], axis=1)
        P = self.a_e[there] - self.a_e[back] if self.a_e is not None and self.term.hops > 1 else None
        i, j, none = near.atom[near.a[p]], near.atom[near.b[p]], np.full(len(there), np.nan)  # not along the bond
        return Bonds(i, j, near.r_pc[p], none, D if acc.sources else None, D[:, 0] - D[:, 1], P)

    def _stars(self, task, acc):
        from .stars import Torque, tensions

        near, edges, term = self.near, self.edges, self.term
        found = []
        for s in range(near.first[task], near.first[task + 1]):
            e = slice(edges.start[s], edges.start[s + 1])
            g = self.g_ec[e]
            if not len(g) or not g.any():
                continue
            try:
                a, b, r, G = tensions(edges.r_ec[e] * term.length, g, term.cutoff)
            except Torque:
                raise AtcError(
                    f"{self.frame.source}: {term.name}: the energy of atom {self.frame.ids[near.atom[s]]} has forces "
                    "with a torque, so it changes when all is turned, and no central forces are equal to them"
                ) from None
            who = np.concatenate([[s], edges.neighbour[e]])
            D = None
            if acc.sources:
                D = np.zeros((len(G), 2, 3))
                D[: len(g), 0] = g  # pairs of the centre come first
            found.append(Bonds(near.atom[who[a]], near.atom[who[b]], r, G, D))
        return Bonds.concatenate(found) if found else None
