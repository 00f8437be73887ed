"""Exported models: through TorchScript and a file, lists of neighbours as they ask for them."""

from typing import Dict, List, Optional  # noqa: UP035  (TorchScript)

import numpy as np
import pytest
import torch
from energy_systems import diamond
from metatensor.torch import Labels, TensorBlock, TensorMap
from metatomic.torch import AtomisticModel, ModelCapabilities, ModelMetadata, ModelOutput, NeighborListOptions, System
from test_edge_model import near
from torch_toys import per_atom

import atc
from atc.analysis.check import check
from atc.errors import AtcError, AtcWarning

CUTOFF = 3.6


class Toy(torch.nn.Module):
    """U = tanh(Σ f) + |Σ f r|²/10, of one or two layers; a part that sees positions."""

    def __init__(self, full: bool = True, hops: int = 1, positions: bool = False):
        super().__init__()
        self.full, self.hops, self.positions = full, hops, positions
        self.wanted = NeighborListOptions(cutoff=CUTOFF, full_list=full, strict=True)

    def requested_neighbor_lists(self) -> List[NeighborListOptions]:  # noqa: UP006
        return [self.wanted]

    def forward(
        self,
        systems: List[System],  # noqa: UP006
        outputs: Dict[str, ModelOutput],  # noqa: UP006
        selected_atoms: Optional[Labels] = None,  # noqa: UP045
    ) -> Dict[str, TensorMap]:  # noqa: UP006
        system = systems[0]
        n = len(system.types)
        block = system.get_neighbor_list(self.wanted)
        r = block.values.reshape(-1, 3)
        c = block.samples.column("first_atom").to(torch.int64)
        k = block.samples.column("second_atom").to(torch.int64)
        if not self.full:
            c, k, r = torch.cat([c, k]), torch.cat([k, c]), torch.cat([r, -r])
        z = system.types.to(r.dtype)
        f = (1 - (r * r).sum(1) / 3.6**2).clamp(min=0.0) ** 4 * z[k] / 10
        s = torch.zeros(n, dtype=r.dtype).index_add(0, c, f)
        v = torch.zeros(n, 3, dtype=r.dtype).index_add(0, c, f[:, None] * r)
        if self.hops == 2:
            s = s + torch.zeros(n, dtype=r.dtype).index_add(0, c, f * torch.tanh(s[k]))
        U = torch.tanh(s) + (v * v).sum(1) / 10
        if self.positions:
            U = U + 0.01 * (system.positions - system.positions.mean(0)).square().sum(1)
        samples = Labels(["system", "atom"], torch.stack([torch.zeros(n), torch.arange(n)], 1).to(torch.int32))
        energy = TensorBlock(U[:, None], samples, [], Labels(["energy"], torch.zeros(1, 1, dtype=torch.int32)))
        return {"energy": TensorMap(Labels(["_"], torch.zeros(1, 1, dtype=torch.int32)), [energy])}


def exported(toy, **more):
    options = {
        "outputs": {"energy": ModelOutput(unit="eV", sample_kind="atom")},
        "atomic_types": [6, 14],
        "interaction_range": toy.hops * CUTOFF,
        "length_unit": "angstrom",
        "supported_devices": ["cpu"],
        "dtype": "float64",
    }
    return AtomisticModel(toy.eval(), ModelMetadata(), ModelCapabilities(**options | more))


def same(hops):
    """The same energies as an edge model."""

    def energies(r, c, n, types):
        f = (
            (1 - (r * r).sum(1) / CUTOFF**2).clamp(min=0.0) ** 4
            * torch.tensor([6.0, 14.0], dtype=r.dtype)[types][n]
            / 10
        )
        s, v = per_atom(f, c, types), per_atom(f[:, None] * r, c, types)
        if hops == 2:
            s = s + per_atom(f * torch.tanh(s[n]), c, types)
        return torch.tanh(s) + (v * v).sum(1) / 10

    return atc.edge_model(energies, cutoff=CUTOFF, hops=hops, units="metal", types=[1, 0])


SYMBOLS = ["Si", "C"]


@pytest.mark.parametrize("hops", [1, 2])
@pytest.mark.parametrize("full", [True, False])
def test_stress(hops, full, tmp_path):
    frame, path = diamond(5.2, 1), tmp_path / "model.pt"
    exported(Toy(full, hops)).save(str(path))
    pot = atc.metatomic(path, SYMBOLS)
    d, want = pot.decompose(frame), same(hops).decompose(frame)
    near(d.energies_n, want.energies_n, 1e-14)
    near(d.forces_nc, want.forces_nc, 1e-13)
    near(d.virial_cc, want.virial_cc, 1e-13)
    assert pot.terms[0].hops == hops + (not full) and "metatomic model.pt" in pot.describe()
    if full and hops == 1:
        assert check([frame], pot, atc.kernel("gaussian", width=1.5), points=3).ok
    else:
        with pytest.raises(AtcError, match="what edges carry differs from the change of the atoms' energies"):
            pot.decompose(frame, sources=True)


def test_open_faces_and_models_in_memory():
    frame = diamond(5.2, 1)
    frame = frame.replace(cell=atc.Cell(frame.cell.vectors, frame.cell.origin, periodic=(True, False, True)))
    d = atc.metatomic(exported(Toy()), SYMBOLS).decompose(frame, sources=True)
    near(d.forces_nc, same(1).decompose(frame).forces_nc, 1e-13)
    assert d.notes["energy_identity"] < 1e-13


def test_what_is_refused(tmp_path):
    frame = diamond(5.2, 1)
    with pytest.raises(AtcError, match="depends on positions or the cell in other ways"):
        atc.metatomic(exported(Toy(positions=True)), SYMBOLS).decompose(frame)
    (tmp_path / "text.pt").write_text("nothing")
    whole = {"energy": ModelOutput(unit="eV", sample_kind="system")}
    other = {"charge": ModelOutput(unit="e", sample_kind="atom")}
    for given, said in (
        (tmp_path / "none.pt", "no such file"),
        (tmp_path / "text.pt", "cannot be read as a model exported by metatomic"),
        (torch.nn.Linear(1, 1), "expected a model exported by metatomic"),
        (exported(Toy(), outputs=whole), "the energy of all atoms together, none of each"),
        (exported(Toy(), outputs=other), "but no energy"),
        (exported(Toy(), interaction_range=float(np.inf)), "reach over any distance"),
    ):
        with pytest.raises(AtcError, match=said) as e:
            atc.metatomic(given, SYMBOLS)
        assert "\n" not in str(e.value)
    single = exported(Toy(), dtype="float32")
    with pytest.raises(AtcError, match="the model is exported in float32"):
        atc.metatomic(single, SYMBOLS, precision="float64")
    with pytest.warns(AtcWarning, match="in float32 forces and fluxes are good to 6 digits"):
        d = atc.metatomic(single, SYMBOLS).decompose(frame)
    near(d.forces_nc, same(1).decompose(frame).forces_nc, 1e-5)
