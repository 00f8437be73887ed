"""MACE models (mace-torch): thin over `edge_model`."""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcError
from ..many_body.elements import SYMBOLS
from .edge_model import OfInputs
from .loading import eager, file_of, is_torchscript, own_copy, potential_of, unpickled
from .torch_here import require

_WAY_OUT = "give the eager model, the .model file that training wrote, without enable_cueq, enable_oeq or compile_mode"
#: Models that are no sum of atoms' energies of edges, and why.
_OTHERS = {
    "AtomicDipolesMACE": "it has no energy, only dipoles",
    "AtomicDielectricMACE": "it has no energy, only dipoles and polarizabilities",
    "EnergyDipolesMACE": "it is trained for dipoles besides, which atc knows nothing of",
    "PolarMACE": "it has long-range charges, whose energy is none of edges",
    "MACELES": "it has long-range charges, whose energy is none of edges",
}


class _Energies(OfInputs):
    positions = vectors_of_positions = True

    def __init__(self, model, head: int):
        self.model, self.head = model, head
        self.n_kinds = len(model.atomic_numbers)

    def data(self, x_nc, centre, neighbour, shifts, types_n, cell=None):
        import torch

        zeros = torch.zeros(len(types_n), dtype=torch.int64, device=x_nc.device)
        hot = torch.nn.functional.one_hot(types_n, self.n_kinds).to(x_nc.dtype)
        return {
            "positions": x_nc,
            # of messages: from the neighbour to the centre, who is the receiver
            "edge_index": torch.stack([neighbour, centre]),
            "shifts": shifts,
            "unit_shifts": torch.zeros_like(shifts),
            "cell": torch.zeros(3, 3, dtype=x_nc.dtype, device=x_nc.device) if cell is None else cell,
            "node_attrs": hot,
            "batch": zeros,
            "ptr": torch.tensor([0, len(types_n)], device=x_nc.device),
            "head": torch.tensor([self.head], device=x_nc.device),
        }

    def __call__(self, at):
        x = at.x_nc
        # MACE makes x_receiver − x_sender + shift of them, which is −r.
        apart = (x.index_select(0, at.centre) - x.index_select(0, at.neighbour)).detach()
        data = self.data(x, at.centre, at.neighbour, -at.r_ec - apart, at.types_n)
        return self.model(data, training=False, compute_force=False)["node_energy"].to(at.dtype)

    def own(self, x_nc, cell, periodic, species_n, term):
        """Energy, forces and virial from MACE's own list of neighbours, by its own derivatives."""
        import torch
        from mace.data import get_neighborhood

        dtype = getattr(torch, term.precision)
        before = torch.get_default_dtype()
        try:
            torch.set_default_dtype(dtype)
            pbc = tuple(bool(p) for p in periodic)
            index, shifts, unit, cell = get_neighborhood(
                np.array(x_nc), term.cutoff / term.length, pbc, np.array(cell, float)
            )

            def tensor(a, kind=dtype):
                return torch.as_tensor(np.ascontiguousarray(a), dtype=kind, device=term.device)

            data = self.data(
                tensor(x_nc),
                tensor(index[1], torch.int64),
                tensor(index[0], torch.int64),
                tensor(shifts),
                tensor(species_n, torch.int64),
                tensor(cell),
            )
            data["unit_shifts"] = tensor(unit)
            out = self.model(data, training=False, compute_force=True, compute_virials=True)
        finally:
            torch.set_default_dtype(before)
        numbers = {k: out[k].detach().cpu().numpy().astype(float) for k in ("energy", "forces", "virials")}
        return float(numbers["energy"].sum()), numbers["forces"], -numbers["virials"].reshape(3, 3)


def mace(model, types=None, *, head=None, stress="edge", reference=None, batch=None, device="cpu", precision="float64"):
    """A MACE model.

    Parameters
    ----------
    model : the ``.model`` file that training wrote (reading it runs the code that is in it: a warning says so), a
        `mace.modules.MACE`, or a `MACECalculator` of one model. It is copied, to float64 unless `precision` says other.
    types : the element of each atom type from 1, e.g. ``["O", "H"]``; None or "NULL" for types left out. Default: by
        the names that the trajectory has for its types.
    head : which one, of models with several
    stress : "edge", or "central" for models of one layer
    reference : "isolated" to subtract the energies of single atoms (E0), which matter to the heat flux of mixtures; or
        {element: energy}
    batch, device, precision : see `atc.edge_model`

    Returns
    -------
    Potential, of lengths in Å and energies in eV

    Raises
    ------
    AtcError for files that hold no such model, compiled or fused ones, models with long-range parts or without energies
    """
    name = "mace"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its e3nn, about how its own files are read
        modules = require("mace.modules", "mace-torch", name)
    path = file_of(model)
    given = model
    if path is not None:
        name = path.name
        if is_torchscript(path):
            raise AtcError(f"{path}: is a compiled model, in which what edges carry cannot be seen: {_WAY_OUT}")
        model = unpickled(path, "a MACE model")
    elif hasattr(model, "models"):
        if len(model.models) != 1:
            raise AtcError(f"{name}: a committee of {len(model.models)} models has no one energy: give one of them")
        model = model.models[0]
    kind = type(model).__name__
    if kind in _OTHERS:
        raise AtcError(f"{name}: {kind}: {_OTHERS[kind]}")
    if hasattr(model, "modules"):
        eager(model, name, _WAY_OUT)
    if not isinstance(model, modules.MACE):
        raise AtcError(f"{name}: expected a MACE model, got {kind}")
    if hasattr(model, "joint_embedding"):
        said = ", ".join(model.embedding_specs)
        raise AtcError(f"{name}: the model wants to know {said} besides elements and edges, which atc cannot tell it")
    heads = list(getattr(model, "heads", None) or ["Default"])
    if head is None and len(heads) > 1:
        raise AtcError(f"{name}: the model has the heads {', '.join(heads)}: say which one, head={heads[-1]!r}, say")
    if head is not None and head not in heads:
        raise AtcError(f"{name}: the model has no head {head!r}: it has {', '.join(heads)}")
    model, said = own_copy(model, precision, device, name)
    energies = _Energies(model, heads.index(head) if head is not None else 0)
    return potential_of(
        "mace",
        "MACE",
        given,
        energies,
        float(model.r_max),
        int(model.num_interactions),
        species=[SYMBOLS[int(z) - 1] for z in model.atomic_numbers],
        types=types,
        stress=stress,
        reference=reference,
        batch=batch,
        device=device,
        precision=precision,
        own=energies.own,
        said=(*said, *([f"head {head}"] if head is not None else [])),
        told={"head": head},
    )
