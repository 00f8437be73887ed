"""Models exported by metatomic: thin over `edge_model`."""

from __future__ import annotations

import math
import warnings

from ...errors import AtcError
from ..many_body.elements import SYMBOLS
from .edge_model import OfInputs
from .loading import file_of, potential_of
from .torch_here import device_of, first_line, require


class _Energies(OfInputs):
    positions = True

    def __init__(self, model, numbers, options, lists):
        self.model, self.numbers, self.options, self.lists = model, numbers, options, lists

    def __call__(self, at):
        import torch
        from metatensor.torch import Labels, TensorBlock
        from metatomic.torch import System

        periodic = torch.tensor(at.periodic, device=at.device)
        # Axes that do not repeat have no vectors, as metatomic wants it.
        cell = torch.where(periodic[:, None], at.cell, torch.zeros_like(at.cell))
        types = torch.tensor(self.numbers, device=at.device)[at.types_n].to(torch.int32)
        system = System(types=types, positions=at.x_nc, cell=cell, pbc=periodic)
        with torch.no_grad():
            d = at.r_ec.norm(dim=1)
            x, c, n = at.x_nc, at.centre, at.neighbour
            shift = torch.round((at.r_ec - (x[n] - x[c])) @ torch.linalg.inv(at.cell)) * periodic
            # One of the two directions of a pair: the first sign that is not 0 decides between an atom and its images.
            s = shift @ torch.tensor([1e12, 1e6, 1.0], dtype=shift.dtype, device=at.device)
            upper = (c < n) | ((c == n) & (s > 0))
        properties = Labels(["distance"], torch.zeros(1, 1, dtype=torch.int32, device=at.device))
        xyz = [Labels(["xyz"], torch.arange(3, dtype=torch.int32, device=at.device)[:, None])]
        names = ["first_atom", "second_atom", "cell_shift_a", "cell_shift_b", "cell_shift_c"]
        for wanted, cutoff in self.lists:
            keep = d <= cutoff if wanted.full_list else (d <= cutoff) & upper
            samples = torch.cat([c[keep, None], n[keep, None], shift[keep].to(torch.int64)], 1).to(torch.int32)
            block = TensorBlock(
                values=at.r_ec[keep][:, :, None],
                samples=Labels(names, samples, assume_unique=True),
                components=xyz,
                properties=properties,
            )
            system.add_neighbor_list(wanted, block)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = self.model([system], self.options, check_consistency=False)["energy"].block()
        order = found.samples.column("atom").to(torch.int64)
        U = torch.zeros(len(at), dtype=found.values.dtype, device=at.device)
        return U.index_add(0, order, found.values.reshape(-1))


def metatomic(
    model, types=None, *, extensions=None, stress="edge", reference=None, batch=None, device="cpu", precision=None
):
    """A model that was exported by metatomic (metatrain's PET, SOAP-BPNN and others).

    What is gathered inside of an exported model cannot be seen: its stress is exact whatever its layers, its heat flux
    is there for models of one layer only (others are found out by the identity of every atom, and refused).

    Parameters
    ----------
    model : the exported file, ``model.pt``, or a `metatomic.torch.AtomisticModel`
    types : the element of each atom type from 1; None or "NULL" for types left out. Default: by the names that the
        trajectory has for its types.
    extensions : the folder of the model's compiled extensions, if it has some
    precision : default: the model's own
    stress, reference, batch, device : see `atc.edge_model`

    Returns
    -------
    Potential, of lengths in Å and energies in eV

    Raises
    ------
    AtcError for files that hold no such model, models without energies of atoms, with long-range parts, or that use
    positions or the cell beside lists of neighbours
    """
    name = "metatomic"
    package = require("metatomic.torch", "metatomic-torch", name)
    path, given = file_of(model), model
    if path is not None:
        name = path.name
        try:
            model = package.load_atomistic_model(str(path), extensions)
        except Exception as e:
            raise AtcError(f"{path}: cannot be read as a model exported by metatomic: {first_line(e)}") from None
    elif not package.is_atomistic_model(model):
        raise AtcError(f"{name}: expected a model exported by metatomic, or its file, got {type(model).__name__}")
    capabilities = model.capabilities()
    if "energy" not in capabilities.outputs:
        raise AtcError(f"{name}: the model gives {', '.join(capabilities.outputs) or 'nothing'}, but no energy")
    if capabilities.outputs["energy"].sample_kind != "atom":
        raise AtcError(f"{name}: the model gives the energy of all atoms together, none of each: no stress of edges")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about names of inputs
        inputs = list(model.requested_inputs())
    if inputs:
        raise AtcError(
            f"{name}: the model wants to know {', '.join(inputs)} besides elements and edges, which atc cannot tell it"
        )
    to = package.unit_conversion_factor(capabilities.length_unit or "angstrom", "angstrom")
    lists = [(w, w.cutoff * to) for w in model.requested_neighbor_lists()]
    if not lists:
        raise AtcError(f"{name}: the model asks for no list of neighbours: there are no edges that it depends on")
    cutoff, reach = max(c for _, c in lists), capabilities.interaction_range * to
    if not math.isfinite(reach):
        raise AtcError(
            f"{name}: the model says that its energies reach over any distance (long-range charges or the like), which "
            "no edges give"
        )
    own = capabilities.dtype if precision is None else precision
    if own != capabilities.dtype:
        raise AtcError(f"{name}: the model is exported in {capabilities.dtype}: leave precision out, or export it anew")
    # Of a list of half of the pairs an atom's energy depends on edges that start at its neighbours.
    hops = max(1, math.ceil(reach / cutoff - 1e-9)) + any(not w.full_list for w, _ in lists)
    where = device_of(device, name)
    model = model.to(where)
    output = package.ModelOutput(unit="eV", sample_kind="atom")
    options = package.ModelEvaluationOptions(length_unit="angstrom", outputs={"energy": output})
    return potential_of(
        "metatomic",
        "metatomic",
        given,
        _Energies(model, list(capabilities.atomic_types), options, lists),
        cutoff,
        hops,
        species=[SYMBOLS[z - 1] if 1 <= z <= len(SYMBOLS) else str(z) for z in capabilities.atomic_types],
        types=types,
        stress=stress,
        reference=reference,
        batch=batch,
        device=device,
        precision=own,
    )
