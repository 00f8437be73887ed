"""Gradients of energies by the vectors of edges, and what messages carry along edges as atoms move.

With g_e = ∂U/∂r_e the stress is Σ r_e ⊗ g_e β_e. In a model of several layers an edge carries besides g_e·v_n, the
power of its own gradient, that of the features x_e^l of its neighbour, which each layer l gathers over it:

    I_e = g_e·v_n + a_e,   a_e = Σ_l ⟨∂U/∂x_e^l, ẋ_e^l⟩

ẋ the rate along the motion. What a node's features hold is handed on along edges layer by layer, so that the sum over
layers telescopes to v_j·F_j + dU^(j)/dt = Σ_{c=j} I_e − Σ_{n=j} I_e at every atom, whatever the depth. Two further
backward passes: s(u) = ∂⟨(x, U), u⟩/∂r, then ∂⟨s, v_n − v_c⟩/∂u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.overrides import TorchFunctionMode

_INDEXED = {torch.Tensor.__getitem__: (0, 1), torch.index_select: (0, 2), torch.Tensor.index_select: (0, 2)}
_EMBEDDING = torch.nn.functional.embedding


class Gathers(TorchFunctionMode):
    """Inside, remembers every tensor of features that was gathered from the edges' neighbours."""

    def __init__(self, neighbour):
        super().__init__()
        self.neighbour, self.found = neighbour, []

    def __torch_function__(self, func, types, args=(), kwargs=None):
        out = func(*args, **(kwargs or {}))
        if isinstance(out, torch.Tensor) and out.requires_grad and self._gathers(func, args, kwargs or {}):
            self.found.append(out)
        return out

    def _gathers(self, func, args, kwargs) -> bool:
        if func in _INDEXED:
            at = _INDEXED[func][1]
            index = args[at] if len(args) > at else kwargs.get("index")
            if func is not torch.Tensor.__getitem__ and (args[1] if len(args) > 1 else kwargs.get("dim")) != 0:
                return False
            index = index[0] if isinstance(index, tuple) and index else index
        elif func is _EMBEDDING:
            index = args[0] if args else kwargs.get("input")
        else:
            return False
        n = self.neighbour
        return (
            isinstance(index, torch.Tensor)
            and index.shape == n.shape
            and index.dtype in (torch.int64, torch.int32)
            and (index.data_ptr() == n.data_ptr() or bool(torch.equal(index.to(n), n)))
        )


@dataclass
class Rates:
    """What edges carry.

    a_e : (e,) power of messages, from neighbour to centre; share_n : (m,) dU^(j)/dt of the counted atoms, else 0;
    gathers : how many times features were gathered
    """

    a_e: np.ndarray
    share_n: np.ndarray
    gathers: int


@dataclass
class Gradient:
    """energy_n : (m,), 0 where not counted. g_ec : (e, 3) ∂U/∂r. left : the largest force on atoms that is none of the
    edges', over the largest of those, for models that were given positions besides; rates : `Rates` or None"""

    energy_n: np.ndarray
    g_ec: np.ndarray
    left: float
    rates: Rates | None


class NoGradient(Exception):
    """The energies do not follow from the edges by automatic differentiation; the message says how they fail."""


class Inputs:
    """A part of a frame as tensors.

    r_ec requires its gradient; centre, neighbour, types_n; counted: whose energies are of interest. Only with a
    `place`: x_nc and cell, which require their gradients too, periodic.
    """

    def __init__(self, part, types_n, dtype, device, place=None):
        def tensor(a, dtype=None):
            return torch.as_tensor(np.ascontiguousarray(a), dtype=dtype, device=device)

        self.dtype, self.device = dtype, device
        self.centre, self.neighbour = tensor(part.centre), tensor(part.neighbour)
        self.types_n = tensor(types_n[part.atoms])
        self.r_ec = tensor(part.r_ec, dtype).requires_grad_()
        self.x_nc = self.cell = None
        if place is not None:
            self.x_nc = tensor(place.x_nc[part.atoms], dtype).requires_grad_()
            self.cell = tensor(place.cell, dtype).requires_grad_()
            self.periodic = [bool(p) for p in place.periodic]
        self.counted = tensor(part.counted)

    def __len__(self):
        return len(self.types_n)


def gradient(energies, at: Inputs, velocities_nc=None) -> Gradient:
    """Energies of atoms and their gradient; with velocities (of the part's atoms) also what messages carry.

    Parameters
    ----------
    energies : `edge_model.OfInputs`

    Raises
    ------
    NoGradient
    """
    with torch.enable_grad(), Gathers(at.neighbour) as gathers:
        U_n = energies(at)
    if not isinstance(U_n, torch.Tensor) or U_n.shape != (len(at),):
        shape = tuple(U_n.shape) if isinstance(U_n, torch.Tensor) else type(U_n).__name__
        raise NoGradient(f"energies must be a tensor of shape ({len(at)},), one for each atom, got {shape}")
    if U_n.dtype != at.dtype:
        raise NoGradient(
            f"energies are {str(U_n.dtype).removeprefix('torch.')} although the edges are "
            f"{str(at.dtype).removeprefix('torch.')}: convert the model, e.g. model.double()"
        )
    counted = at.counted
    energy_n = torch.where(counted, U_n.detach(), torch.zeros_like(U_n.detach())).cpu().numpy()
    if not len(at.r_ec):
        rates = Rates(np.zeros(0), np.zeros(len(at)), 0) if velocities_nc is not None else None
        return Gradient(energy_n, np.zeros((0, 3)), 0.0, rates)
    if not U_n.requires_grad:
        raise NoGradient(
            "energies do not depend on the edges by torch's automatic differentiation (detached, or no_grad)"
        )
    moving = velocities_nc is not None
    x = gathers.found if moving else []
    others = [at.x_nc, at.cell] if at.x_nc is not None else []
    leaves = [at.r_ec, *others, *x]
    total = U_n[counted].sum()
    slopes = list(torch.autograd.grad(total, leaves, retain_graph=moving, allow_unused=True))
    g = slopes.pop(0)
    if g is None:
        raise NoGradient("energies do not depend on the vectors of the edges")
    left = _left(at, g, *slopes[: len(others)], energies.vectors_of_positions) if others else 0.0
    del slopes[: len(others)]
    g_ec = g.detach().cpu().numpy().astype(np.float64)
    if not moving:
        return Gradient(energy_n.astype(np.float64), g_ec, left, None)

    w = torch.as_tensor(velocities_nc, dtype=at.dtype, device=at.device)
    w_ec = w.index_select(0, at.neighbour) - w.index_select(0, at.centre)
    # Features that the energies in question do not depend on carry nothing.
    used = [(f, s) for f, s in zip(x, slopes, strict=True) if s is not None]
    outs = [*(f for f, _ in used), U_n]
    u = [torch.zeros_like(o, requires_grad=True) for o in outs]
    (s,) = torch.autograd.grad(outs, at.r_ec, grad_outputs=u, create_graph=True)
    rates = torch.autograd.grad((s * w_ec).sum(), u, allow_unused=True)
    a = torch.zeros(len(at.r_ec), dtype=at.dtype, device=at.device)
    for (_, slope), rate in zip(used, rates, strict=False):
        if rate is not None:
            a += (slope * rate).reshape(len(a), -1).sum(1)
    share = rates[-1] if rates[-1] is not None else torch.zeros_like(U_n)
    share = torch.where(counted, share, torch.zeros_like(share))
    return Gradient(
        energy_n.astype(np.float64),
        g_ec,
        left,
        Rates(a.detach().cpu().numpy().astype(np.float64), share.detach().cpu().numpy().astype(np.float64), len(x)),
    )


def _left(at: Inputs, g, on_x, on_cell, vectors_of_positions: bool) -> float:
    """What pulls at positions and the cell besides the edges, over the largest force and virial of these."""
    # Vectors that were made of positions pull at their ends; nothing else may.
    through = torch.zeros_like(at.x_nc).index_add_(0, at.neighbour, g).index_add_(0, at.centre, -g)
    left = 0.0
    if on_x is not None:
        largest = float(through.abs().max())
        more = on_x - through if vectors_of_positions else on_x
        left = float(more.abs().max()) / largest if largest else 0.0
    if on_cell is not None:
        size = float((at.r_ec.detach().abs().T @ g.abs()).max())
        left = max(left, float((at.cell.detach().T @ on_cell).abs().max()) / size if size else 0.0)
    return left


class SavedBytes:
    """Inside, counts the memory that is kept for backward passes, parameters apart."""

    def __enter__(self):
        self.bytes, seen = 0, set()

        def pack(t):
            if not isinstance(t, torch.nn.Parameter):
                s = t.untyped_storage()
                if s.data_ptr() not in seen:
                    seen.add(s.data_ptr())
                    self.bytes += s.nbytes()
            return t

        self._hooks = torch.autograd.graph.saved_tensors_hooks(pack, lambda t: t)
        self._hooks.__enter__()
        return self

    def __exit__(self, *args):
        return self._hooks.__exit__(*args)
