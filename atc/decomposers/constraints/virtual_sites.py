"""Virtual sites: massless points that follow atoms, and whose force these atoms take.

A site at x_s = x_s(x_1, …, x_K) hands its force on by virtual work, F_k = J_kᵀ F_s with J_k = ∂x_s/∂x_k (w_k 1 where it
is a mean of its parents, Σ w_k = 1). As bonds: from the site to every parent a lever with the force J_kᵀ F_s on the
parent and its opposite on the site, which is then free of force. These levers add up to nothing in the box (Σ w_k x_k =
x_s), momentum is balanced at every point, and no force along them is needed. Their stress −Σ J_kᵀ F_s ⊗ (x_k − x_s) β
is symmetric over the molecule only.

A site's energy stays with the site. A lever has none; it carries the power J_kᵀ F_s·v_k from the site to the parent
(D = (0, −F): the energy of the site depends on where the parent is), so that energy is balanced at every point, too.

How it is used: a model with sites has `Potential.sites`, whose `carriers(frame)` is the frame with the sites as
massless particles behind its atoms (`FrameWithSites`; or among them, where the trajectory has them). Terms with
`on_sites` see that frame, others its `atoms`; `Potential.stream` hands the forces on. A rule says which sites there
are: `tip4p.TIP4P`; another one is an object with ``places(frame)``, giving `Places`, and ``describe()``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ...frame import Frame


@dataclass
class Places:
    """The sites of a frame: s of them, each with k parents.

    parents_sk : indices of atoms. weights_sk : of the mean that the site is, Σ = 1
    host_s : the atom whose molecule, groups, image flags and bonded neighbours are the site's, too
    inside_s : the sites' own indices where they are among the frame's atoms; None: they come behind them
    charged_by : whether a site takes the charge of its host (TIP4P)
    jacobians_skcc : (s, k, 3, 3) ∂x_s,a/∂x_k,b of sites that are no means (they are then where the frame has them);
        None: the weights
    """

    parents_sk: np.ndarray
    weights_sk: np.ndarray
    host_s: np.ndarray
    inside_s: np.ndarray | None = None
    charged_by: bool = False
    jacobians_skcc: np.ndarray | None = None

    def __len__(self):
        return len(self.parents_sk)


@dataclass(repr=False)
class FrameWithSites(Frame):
    """A frame whose last particles (or some of them, see `Places`) are virtual sites: massless, at rest in no way of
    their own. `plain` : the frame that it was made from."""

    plain: Frame | None = None
    places: Places | None = None

    @property
    def n_atoms(self) -> int:
        return len(self.plain)

    @cached_property
    def atoms(self) -> Frame:
        """The frame without what is behind its atoms."""
        n, plain = self.n_atoms, self.plain
        same = self.positions is self.__dict__.get("_own_positions")
        v = self.velocities
        return plain if same else plain.replace(positions=self.positions[:n], velocities=None if v is None else v[:n])

    @property
    def index_s(self) -> np.ndarray:
        inside = self.places.inside_s
        return np.arange(self.n_atoms, len(self)) if inside is None else inside

    def weighed(self, a_s, parents=None) -> np.ndarray:
        """(s, k, ...) a site's numbers times its parents' weights."""
        w = self.places.weights_sk
        return w.reshape(*w.shape, *(1,) * (a_s.ndim - 1)) * a_s[:, None]

    def folded(self, a_n) -> np.ndarray:
        """(n_atoms, ...) numbers of atoms and sites, those of sites shared among their parents by weight."""
        a_n = np.asarray(a_n)
        out = a_n[: self.n_atoms].copy()
        sites = a_n[self.index_s]
        if self.places.inside_s is not None:
            out[self.places.inside_s] = 0.0
        np.add.at(out, self.places.parents_sk, self.weighed(sites))
        return out

    def padded(self, a_n) -> np.ndarray:
        """Numbers of atoms, 0 for the sites behind them."""
        a_n = np.asarray(a_n)
        return np.concatenate([a_n, np.zeros((len(self) - len(a_n), *a_n.shape[1:]), a_n.dtype)])

    def levers(self, F_sc, sources: bool = False) -> Bonds:
        """The bonds that hand the forces on the sites to their parents."""
        p = self.places
        some = np.flatnonzero((F_sc != 0.0).any(1))
        i = np.ascontiguousarray(p.parents_sk[some].ravel(), np.int32)
        j = np.ascontiguousarray(np.repeat(self.index_s[some], p.parents_sk.shape[1]), np.int32)
        if p.jacobians_skcc is None:
            F = (p.weights_sk[some, :, None] * F_sc[some, None]).reshape(-1, 3)
        else:
            F = np.einsum("skab,sa->skb", p.jacobians_skcc[some], F_sc[some]).reshape(-1, 3)
        bonds = Bonds(i, j, _nearest(self.positions[i] - self.positions[j], self.cell), np.zeros(len(i)), F_bc=F)
        if sources:
            bonds.D_bdc = np.stack([np.zeros_like(F), -F], axis=1)
        return bonds


def seen_by(term, frame: Frame) -> Frame:
    """What a term sees of a frame: the sites if it acts on them, else the atoms."""
    return frame.atoms if isinstance(frame, FrameWithSites) and not term.on_sites else frame


def atoms_of(frame: Frame) -> Frame:
    """The frame without sites behind its atoms."""
    return frame.atoms if isinstance(frame, FrameWithSites) else frame


def only_atoms(frame: Frame, a_n):
    """Numbers of the particles of a frame as those of its atoms: sites' are shared among their parents."""
    return frame.folded(a_n) if isinstance(frame, FrameWithSites) and a_n is not None else a_n


class VirtualSites:
    """The virtual sites of a model, by rules.

    rules : objects with ``places(frame)`` → `Places`, and ``describe()``; one for now
    """

    def __init__(self, rule):
        self.rule = rule

    def describe(self) -> str:
        return f"virtual sites: {self.rule.describe()}, their forces handed to their parents by levers"

    def carriers(self, frame: Frame) -> FrameWithSites:
        """The frame with its sites; itself if it has them."""
        if isinstance(frame, FrameWithSites):
            return frame
        if frame.dimension == 2:
            raise AtcError(f"{frame.source}: virtual sites in a two-dimensional run are not supported")
        places = self.rule.places(frame)
        if places.inside_s is None:
            new = _behind(frame, places)
        else:
            known = {name: getattr(frame, name) for name in frame.__dataclass_fields__}
            new = FrameWithSites(**known, plain=frame, places=places)
        new.__dict__["_own_positions"] = new.positions
        return new


def _behind(frame: Frame, p: Places) -> FrameWithSites:
    s, host = len(p), p.host_s
    r_skc = _nearest(frame.positions[p.parents_sk] - frame.positions[host][:, None], frame.cell)
    q, v = frame.charges, frame.velocities
    taken = np.zeros(s)
    if p.charged_by and q is not None:
        taken, q = q[host], q.copy()
        q[host] = 0.0
    known = {name: getattr(frame, name) for name in frame.__dataclass_fields__}
    known |= {"charges": q, "extra": {}, "before": None, "plain": frame, "places": p}
    sites = {name: known[name][host] for name in ("types", "images", "molecules", "groups") if known[name] is not None}
    sites |= {
        "positions": frame.positions[host] + np.einsum("sk,skc->sc", p.weights_sk, r_skc),
        "ids": int(frame.ids.max(initial=0)) + 1 + np.arange(s),
        "masses": np.zeros(s),
        "velocities": None if v is None else np.einsum("sk,skc->sc", p.weights_sk, v[p.parents_sk]),
        "forces": np.zeros((s, 3)),
        "charges": taken,
    }
    behind = {name: np.concatenate([known[name], a]) for name, a in sites.items() if known[name] is not None}
    return FrameWithSites(**known | behind)


def _nearest(r, cell):
    """Vectors of a molecule through their closest image: right as long as they are shorter than half the cell."""
    return r - np.where(cell.periodic, np.rint(r @ cell.inverse), 0.0) @ cell.vectors
