"""Models of the KIM archive (openkim.org): their energies' derivatives by distances are bonds.

∂U/∂r of every pair of atoms gives the central decomposition at once, whatever the model is made of. The energy sources
are had one atom after the other: with atom j alone contributing, the derivatives are those of its own energy.
"""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ...frame import Cell, Frame
from ...units import units as system
from ..base import Term, Work
from ..potentials import Potential
from .elements import ElementMap
from .kim_api import Model
from .neighborhood import Neighborhood


class KIM(Term):
    """A portable model of KIM.

    Parameters
    ----------
    name : e.g. "SW_StillingerWeber_1985_Si__MO_405512056662_006"
    elements : the element of each atom type from 1, None or "NULL" for types left out; None: by the names that frames
        have for their types

    Notes
    -----
    Source: Tadmor, Elliott, Sethna, Miller & Becker, JOM 63, 17 (2011).
    """

    #: A bond may join two neighbours of an atom.
    depth = 1.5

    def __init__(self, name: str, elements=None):
        self.name, self.model = name, Model(name)
        self.elements = None if elements is None else [None if e in (None, "NULL") else str(e) for e in elements]
        for e in self.elements or ():
            if e is not None:
                self.model.code(e)
        u = system("metal")
        self.length, self.energy = float(u.length), float(u.energy)
        self.cutoff = 2 * self.model.influence * self.length

    def describe(self) -> str:
        return (
            f"kim {self.name}, derivatives of the energy by the model's own distances, energy shared as the model "
            "shares it"
        )

    def prepare(self, frame: Frame) -> Work:
        return KIMWork(self, frame)

    def map(self, frame: Frame) -> ElementMap:
        """The element of each type."""
        if self.elements is not None:
            names = list(dict.fromkeys(e for e in self.elements if e is not None))
            return ElementMap(self.elements, names, self.name)
        present = [int(t) for t in np.unique(frame.types)]
        names = [frame.type_names.get(t) for t in present]
        if None in names:
            raise AtcError(
                f"{frame.source}: {self.name}: the trajectory does not name its types: say the element of each, "
                'types=["Si"] or the like'
            )
        of = [frame.type_names.get(t) for t in range(1, max(present, default=0) + 1)]
        return ElementMap(of, list(dict.fromkeys(names)), self.name)


class KIMWork(Work):
    """All of a frame at once, or one atom after the other where energy sources are wanted."""

    def __init__(self, term: KIM, frame: Frame):
        self.term, self.frame = term, frame
        mapped = term.map(frame)
        element, who = mapped.apply(frame)
        self.who = np.arange(len(frame)) if who is None else who
        codes = np.array([term.model.code(e) for e in mapped.names])
        self.code_n = codes[element[self.who]].astype(np.int32)
        self.stages = (1,)

    def run(self, stage, task, acc):
        x, image = self._around()
        lists = [self._neighbors(x, cutoff) for cutoff in self.term.model.cutoffs]
        n = len(self.who)
        if not n:
            return None
        if not acc.sources:
            contributing = (np.arange(len(x)) < n).astype(np.int32)
            return self._bonds(*self._evaluate(x, image, contributing, lists), image, acc, None)
        parts = []
        near = self._neighbors(x, self.term.model.influence)
        for j in range(n):
            # Atom j and what its energy depends on.
            some = np.concatenate([[j], near[1][near[0][j] : near[0][j + 1]]])
            cluster, alone = np.ascontiguousarray(x[some]), np.zeros(len(some), np.int32)
            alone[0] = 1
            lists = [self._neighbors(cluster, cutoff) for cutoff in self.term.model.cutoffs]
            parts.append(self._bonds(*self._evaluate(cluster, image[some], alone, lists), image[some], acc, cluster))
        return Bonds.concatenate(parts)

    def _around(self):
        """(p, 3) Å the atoms and their images within reach, and which atom each is."""
        cell = self.frame.cell
        s = cell.fractional(self.frame.positions[self.who])
        s -= np.where(cell.periodic, np.floor(s), 0.0)
        reach = np.where(cell.periodic, self.term.model.influence * self.term.length / cell.heights, 0.0)
        count = np.ceil(reach).astype(int)
        parts, image = [s], [np.arange(len(s))]
        for shift in np.ndindex(*(2 * count + 1)):
            by = np.array(shift) - count
            if by.any():
                near = ((s + by > -reach) & (s + by < 1 + reach) | ~cell.periodic).all(1)
                parts.append(s[near] + by)
                image.append(np.flatnonzero(near))
        x = cell.cartesian(np.concatenate(parts)) / self.term.length
        return np.ascontiguousarray(x), np.concatenate(image)

    def _neighbors(self, x, cutoff):
        """(start, neighbours) of all particles, full lists."""
        from ...neighbors.cell_list import Workspace

        low = x.min(0) - 1.0
        box = Cell(np.diag(x.max(0) - low + 1.0), origin=low, periodic=(False, False, False))
        cluster = Frame(x, box, system("metal"), types=np.ones(len(x), int), source=self.frame.source)
        near, ws = Neighborhood(cluster, None, cutoff, "KIM"), Workspace()
        for task in range(near.chunks):
            near.collect(task, ws)
        near.join()
        a, b = near.atom[near.a], near.atom[near.b]
        centre, other = np.concatenate([a, b]), np.concatenate([b, a])
        order = np.argsort(centre, kind="stable")
        start = np.searchsorted(centre[order], np.arange(len(x) + 1)).astype(np.int32)
        return start, np.ascontiguousarray(other[order], np.int32)

    def _evaluate(self, x, image, contributing, lists):
        code = np.ascontiguousarray(self.code_n[image])
        found = self.term.model.evaluate(x, code, contributing, lists)
        if found is None or not np.isfinite(found[0]) or not np.isfinite(found[5]).all():
            raise AtcError(f"{self.frame.source}: kim: {self.term.name} cannot be evaluated for this frame")
        return found

    def _bonds(self, energy, energies_p, i, j, r_bc, G_b, image, acc, cluster):
        """Bonds in internal units; with `cluster`, positions of which the first is the atom whose energy it is, the
        sources too."""
        term, n = self.term, len(self.who)
        acc.energy += energy * term.energy
        if acc.energies is not None:
            if cluster is not None:
                acc.energies[self.who[image[0]]] += energy * term.energy
            elif term.model.shares:
                acc.energies[self.who] += energies_p[:n] * term.energy
            else:
                raise AtcError(f"kim: {term.name} does not share its energy among atoms")
        D = None
        if cluster is not None:
            # ∂U/∂x of the others, each on a bond of its own to the atom.
            slope = np.zeros(cluster.shape)
            np.add.at(slope, i, G_b[:, None] * r_bc)
            np.add.at(slope, j, -G_b[:, None] * r_bc)
            k = 1 + np.flatnonzero(slope[1:].any(axis=1))
            D = np.zeros((len(G_b) + len(k), 2, 3))
            D[len(G_b) :, 0] = slope[k] * (term.energy / term.length)
            i, j = np.concatenate([i, np.zeros(len(k), int)]), np.concatenate([j, k])
            r_bc = np.concatenate([r_bc, cluster[0] - cluster[k]])
            G_b = np.concatenate([G_b, np.zeros(len(k))])
        which = self.who[image]
        return Bonds(
            which[i].astype(np.int32),
            which[j].astype(np.int32),
            np.ascontiguousarray(r_bc * term.length),
            G_b * (term.energy / term.length**2),
            D,
        )


def kim(name: str, types=None) -> Potential:
    """A portable model of the KIM archive, by its name.

    Stress and forces come from the model's own derivatives by distances, at once for any model that offers them; the
    heat flux needs one evaluation an atom. Needs the KIM API (Debian: libkim-api-dev, openkim-models).

    Parameters
    ----------
    name : e.g. "SW_StillingerWeber_1985_Si__MO_405512056662_006"
    types : the element of each atom type from 1; default: the names that the trajectory has for its types

    Returns
    -------
    Potential, of lengths in Å and energies in eV

    Raises
    ------
    AtcError without the KIM API, for models that are not there, offer no such derivatives, or lack an element.
    """
    term = KIM(name, types)
    pot = Potential([term], "metal")
    pot.learned = "kim", name, {"types": term.elements}
    return pot
