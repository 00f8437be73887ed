"""NequIP and Allegro models: thin over `edge_model`."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from .edge_model import OfInputs
from .loading import eager, file_of, is_torchscript, own_copy, potential_of, warn_of_code
from .torch_here import first_line, require

_WAY_OUT = "give the .nequip.zip of nequip-package or the .ckpt of training, not what nequip-compile wrote"


class _Energies(OfInputs):
    def __init__(self, model, energy):
        # `energy` is the part of `model` that derivatives are taken of.
        self.model, self.energy = model, energy

    def __call__(self, at):
        from nequip.data import AtomicDataDict as keys

        edges = {keys.EDGE_VECTORS_KEY: at.r_ec, keys.EDGE_INDEX_KEY: _stacked(at.centre, at.neighbour)}
        out = self.energy({**edges, keys.ATOM_TYPE_KEY: at.types_n})
        return out[keys.PER_ATOM_ENERGY_KEY].reshape(-1).to(at.dtype)

    def own(self, x_nc, cell, periodic, species_n, term):
        """Energy, forces and virial from nequip's own list of neighbours, by its own derivatives."""
        import torch
        from nequip.data import AtomicDataDict as keys
        from nequip.data import compute_neighborlist_, from_dict

        before = torch.get_default_dtype()
        try:
            torch.set_default_dtype(getattr(torch, term.precision))
            data = from_dict(
                {
                    keys.POSITIONS_KEY: np.array(x_nc),
                    keys.CELL_KEY: np.array(cell, float),
                    keys.PBC_KEY: np.array(periodic, bool),
                    keys.ATOM_TYPE_KEY: np.array(species_n),
                }
            )
            data = compute_neighborlist_(data, term.cutoff / term.length)
            out = self.model({k: v.to(term.device) if isinstance(v, torch.Tensor) else v for k, v in data.items()})
        finally:
            torch.set_default_dtype(before)

        def numbers(key):
            return out[key].detach().cpu().numpy().astype(float) if key in out else None

        virial = numbers(keys.VIRIAL_KEY)
        virial = None if virial is None else -virial.reshape(3, 3)
        return float(numbers(keys.TOTAL_ENERGY_KEY).sum()), numbers(keys.FORCE_KEY), virial


def _stacked(centre, neighbour):
    import torch

    return torch.stack([centre, neighbour])


def nequip(
    model, types=None, *, hops=None, stress="edge", reference=None, batch=None, device="cpu", precision="float64"
):
    """A NequIP or Allegro model.

    Parameters
    ----------
    model : ``.nequip.zip`` of ``nequip-package`` or ``.ckpt`` of training (reading either runs the code that is in it:
        a warning says so), a model of `nequip.model.ModelFromPackage` and the like, or a `NequIPCalculator`. It is
        copied, to float64 unless `precision` says other.
    types : the model's name of each atom type from 1; None or "NULL" for types left out. Default: by the names that the
        trajectory has for its types.
    hops : layers of messages; of NequIP's and Allegro's own layers known (Allegro: 1)
    stress : "edge", or "central" for Allegro and models of one layer
    reference, batch, device, precision : see `atc.edge_model`

    Returns
    -------
    Potential, of lengths in Å and energies in eV, which is what the package's models are taken to be in

    Raises
    ------
    AtcError for files that hold no such model, compiled ones, models whose forces are not the derivatives of an energy
    """
    name = "nequip"
    require("nequip", "nequip", name)
    path, given = file_of(model), model
    if path is not None:
        name = path.name
        model = _loaded(path)
    elif hasattr(model, "calculate") and hasattr(model, "model"):
        model = model.model
    if hasattr(model, "modules"):
        eager(model, name, _WAY_OUT)
    if getattr(model, "is_compile_graph_model", False):
        raise AtcError(f"{name}: the model is compiled, so that what its edges carry cannot be seen: {_WAY_OUT}")
    if not getattr(model, "is_graph_model", False):
        raise AtcError(f"{name}: expected a model of nequip, got {type(model).__name__}")
    model, said = own_copy(model, precision, device, name)
    _in_precision(model, precision)
    if not any(type(m).__name__ == "ForceStressOutput" for m in model.modules()):
        raise AtcError(
            f"{name}: its forces are not derivatives of an energy (there is no ForceStressOutput in it), so that they "
            "have no stress and no heat flux: use a model with energies"
        )
    energy = next(m for m in model.modules() if type(m).__name__ == "ForceStressOutput").func
    metadata = model.metadata
    if hops is None:
        hops = _hops(model, name)
    energies = _Energies(model, energy)
    return potential_of(
        "nequip",
        "NequIP",
        given,
        energies,
        float(metadata["r_max"]),
        hops,
        species=metadata["type_names"].split(),
        types=types,
        stress=stress,
        reference=reference,
        batch=batch,
        device=device,
        precision=precision,
        own=energies.own,
        said=said,
    )


def _loaded(path):
    if path.suffix in (".pth", ".pt2", ".pt") or (is_torchscript(path) and not path.name.endswith(".nequip.zip")):
        raise AtcError(f"{path}: is a compiled model, in which what edges carry cannot be seen: {_WAY_OUT}")
    if path.suffix != ".ckpt" and not path.name.endswith(".nequip.zip"):
        raise AtcError(f"{path}: expected a model of nequip: {_WAY_OUT}")
    warn_of_code(path)
    import torch
    from nequip.model.saved_models import ModelFromCheckpoint, ModelFromPackage
    from nequip.utils.global_state import global_state_initialized, set_global_state

    before = torch.get_default_dtype()
    if not global_state_initialized():  # which it wants before a model is made
        set_global_state()
    try:
        made = (ModelFromCheckpoint if path.suffix == ".ckpt" else ModelFromPackage)(str(path))
    except Exception as e:
        raise AtcError(f"{path}: cannot be read as a model of nequip: {first_line(e)}") from None
    finally:
        torch.set_default_dtype(before)
    # One model, or several by their names.
    if getattr(made, "is_graph_model", False):
        return made
    if len(made) != 1:
        raise AtcError(f"{path}: holds the models {', '.join(made)}: give one of them, loaded by nequip")
    return next(iter(made.values()))


def _in_precision(model, precision: str) -> None:
    """Features are rounded to a precision that modules remember."""
    import torch

    for m in model.modules():
        for name in ("model_dtype", "_output_dtype"):
            try:
                if getattr(m, name, None) in (torch.float32, torch.float64):
                    setattr(m, name, getattr(torch, precision))
            except (AttributeError, RuntimeError):
                pass  # of a scripted part, whose constants stay


def _hops(model, name: str) -> int:
    kinds = [type(m).__name__ for m in model.modules()]
    layers = kinds.count("InteractionBlock") or kinds.count("ConvNetLayer")
    if layers:
        return layers
    if "Allegro_Module" in kinds:
        return 1
    raise AtcError(f"{name}: its layers are not those of NequIP or Allegro: say how many pass messages, hops=")
