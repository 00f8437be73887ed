"""Models from files and objects: what they are is looked at before anything is run, and said."""

from __future__ import annotations

import copy
import os
import warnings
import zipfile
from pathlib import Path

from ...errors import AtcError, AtcWarning
from .torch_here import device_of, first_line

#: Modules of kernels that do gather and sum in one, where nothing can be seen.
_FUSED = ("cuequivariance", "openequivariance")


def file_of(model) -> Path | None:
    """The file, if a model is given by one. Raises AtcError where there is none."""
    if not isinstance(model, (str, Path)):
        return None
    path = Path(model)
    if not os.path.isfile(path):
        raise AtcError(f"{path}: cannot read it: {'it is a directory' if path.is_dir() else 'no such file'}")
    return path


def warn_of_code(path) -> None:
    """Before a file is read that is a program as much as it is data."""
    warnings.warn(
        f"{path}: reading a pickled model runs the code that is in it: use files that you trust only",
        AtcWarning,
        stacklevel=4,
    )


def is_torchscript(path) -> bool:
    """Whether a file holds a compiled model: told by its parts, without running anything."""
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as z:
        return any(name.split("/", 1)[-1].startswith("code/") for name in z.namelist())


def unpickled(path: Path, what: str):
    """The model in a file that `torch.save` made: weights alone if that is all there is, else whatever it holds, after
    a warning. Weights alone are no model, which is told without running anything."""
    import torch

    if not (zipfile.is_zipfile(path) or path.open("rb").read(2)[:1] == b"\x80"):
        raise AtcError(f"{path}: not a file that torch.save made: expected {what}")
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:
        found = None  # more than weights
    if found is not None:
        raise AtcError(f"{path}: holds weights alone, from which no model can be made: expected {what}")
    warn_of_code(path)
    try:
        return torch.load(path, map_location="cpu", weights_only=False)
    except Exception as e:
        raise AtcError(f"{path}: cannot be read as {what}: {first_line(e)}") from None


def eager(model, name: str, way_out: str):
    """Refuse what is compiled or fused: what is gathered in it cannot be seen."""
    import torch

    if isinstance(model, torch.jit.ScriptModule) or hasattr(model, "_orig_mod"):
        raise AtcError(f"{name}: the model is compiled, so that what its edges carry cannot be seen: {way_out}")
    fused = {k for m in model.modules() for k in _FUSED if k in type(m).__module__ or hasattr(m, f"_{k}")}
    fused |= {"fused convolution" for m in model.modules() if hasattr(m, "conv_fusion")}
    if fused:
        raise AtcError(
            f"{name}: the model has kernels of {', '.join(sorted(fused))}, where what edges carry cannot be seen: "
            f"{way_out}"
        )


def own_copy(model, precision: str, device: str, name: str):
    """A copy for evaluation on a device in this precision (of a word that is none, `EdgeModel` complains), its weights
    fixed; and a word if they had less of it."""
    import torch

    dtype = torch.float32 if precision == "float32" else torch.float64
    kinds = {p.dtype for p in model.parameters() if p.is_floating_point()}
    model = copy.deepcopy(model).to(device=device_of(device, name), dtype=dtype).eval()
    for p in model.parameters():
        p.requires_grad_(False)
    said = ()
    if dtype is torch.float64 and torch.float32 in kinds:
        said = ("weights of float32 in float64",)
    return model, said


def potential_of(maker: str, title: str, given, energies, cutoff, hops, *, told=None, **asked):
    """The potential of a package's model, in Å and eV, with how it was made if that was of a file.

    Parameters
    ----------
    maker : the function that makes it, as scenes call it; title : what to call the model
    given : what it was made of, a file or an object
    energies, cutoff, hops, asked : of the `EdgeModel`
    told : {key of scenes: value} that only this maker has
    """
    from ..potentials import Potential
    from .edge_model import EdgeModel

    file = Path(given).name if isinstance(given, (str, Path)) else None
    term = EdgeModel(energies, cutoff, hops, units="metal", name=f"{title} {file}" if file else title, **asked)
    pot = Potential([term], "metal")
    if file:
        pot.learned = (maker, file, {**(told or {}), **_asked(term, asked["reference"])})
    return pot


def _asked(term, reference) -> dict:
    """What a maker was asked, by the keys of scenes; None where it is what it would be anyway."""
    device = str(term.device)
    return {
        "types": term.types,
        "stress": None if term.stress == "edge" else term.stress,
        "reference": reference,
        "device": None if device == "cpu" else device,
    }
