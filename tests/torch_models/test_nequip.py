"""NequIP and Allegro models with random weights: energies, forces and virial are the model's own, and all laws hold."""

import numpy as np
import pytest
import torch
from allegro.model import AllegroModel
from energy_systems import diamond
from frames import argon
from nequip.model import NequIPGNNModel
from nequip.utils.global_state import set_global_state
from test_edge_model import current, near

import atc
from atc.analysis.check import check
from atc.errors import AtcError
from atc.frame import Cell

set_global_state()
SYMBOLS = ["Si", "C"]
COMMON = {
    "seed": 1,
    "model_dtype": "float64",
    "r_max": 3.6,
    "type_names": ["C", "Si"],
    "avg_num_neighbors": 8.0,
    "per_type_energy_scales": {"C": 0.7, "Si": 0.9},
    "per_type_energy_shifts": {"C": -3.0, "Si": 1.5},
}


def nequip(layers=2, **more):
    options = {"num_layers": layers, "l_max": 1, "num_features": 4, "radial_mlp_width": 8, "num_bessels": 4}
    return NequIPGNNModel(**COMMON | options | more)


def allegro(**more):
    embed = {
        "_target_": "allegro.nn.TwoBodyBesselScalarEmbed",
        "num_bessels": 4,
        "bessel_trainable": False,
        "polynomial_cutoff_p": 5,
    }
    options = {
        "l_max": 1,
        "radial_chemical_embed": embed,
        "num_layers": 2,
        "num_scalar_features": 8,
        "num_tensor_features": 4,
        "scalar_embed_mlp_hidden_layers_width": 8,
        "allegro_mlp_hidden_layers_width": 8,
        "readout_mlp_hidden_layers_width": 8,
    }
    return AllegroModel(**COMMON | options | more)


ZBL = {"_target_": "nequip.nn.pair_potential.ZBL", "chemical_species": ["C", "Si"], "units": "metal"}


@pytest.mark.parametrize(
    ("model", "hops"),
    [
        (lambda: nequip(1), 1),
        (lambda: nequip(2, pair_potential=ZBL), 2),
        (lambda: nequip(3, per_edge_type_cutoff={"C": 3.0, "Si": {"C": 3.2, "Si": 3.6}}), 3),
        (allegro, 1),
    ],
    ids=["one layer", "two layers", "three layers", "allegro"],
)
def test_laws(model, hops):
    """The model's own energy, forces and virial are compared on the first frame of every potential."""
    frame, pot = diamond(5.2, 1), atc.nequip(model(), SYMBOLS)
    assert pot.terms[0].hops == hops
    d = pot.decompose(frame, sources=True)
    assert d.notes["energy_identity"] < 1e-12
    report = check([frame], pot, atc.kernel("gaussian", width=1.5), points=3)
    assert report.ok, str(report)


def test_batches_and_central_stress():
    frame = argon(Cell([14.0, 15.0, 16.0]), n=(5, 5, 5), jitter=0.3)
    model = nequip(2)
    want = atc.nequip(model, SYMBOLS).decompose(frame, sources=True)
    with pytest.warns(match="does not fit into the memory at once"):
        got = atc.nequip(model, SYMBOLS, batch=40).decompose(frame, sources=True)
    near(got.forces_nc, want.forces_nc, 1e-12)
    near(current(got.bonds, frame.velocities), current(want.bonds, frame.velocities), 1e-11)
    model, frame = allegro(), diamond(5.2, 1)
    d = atc.nequip(model, SYMBOLS, stress="central").decompose(frame)
    near(d.forces_nc, atc.nequip(model, SYMBOLS).decompose(frame).forces_nc, 1e-9)


def test_single_precision_models_are_taken_to_double():
    """To the last digit: what they round by themselves is found."""
    frame = diamond(5.2, 1)
    for make in (nequip, allegro):
        model = make(model_dtype="float32")
        pot = atc.nequip(model, SYMBOLS)
        assert "weights of float32 in float64" in pot.describe()
        d = pot.decompose(frame, sources=True)
        assert d.notes["energy_identity"] < 1e-12
        assert next(model.parameters()).dtype == torch.float32


def test_names_and_energies_of_atoms():
    frame, model = diamond(5.2, 1), nequip(2)
    pot = atc.nequip(model)
    d = pot.decompose(frame.replace(type_names={1: "Si", 2: "C"}))
    np.testing.assert_array_equal(d.forces_nc, atc.nequip(model, SYMBOLS).decompose(frame).forces_nc)
    less = atc.nequip(model, SYMBOLS, reference="isolated").decompose(frame)
    unit = frame.units.factor("energy")
    assert np.ptp((d.energies_n - less.energies_n)[frame.types == 1]) < 1e-12 * unit
    assert np.abs(d.energies_n - less.energies_n).max() > unit


def test_what_is_refused(tmp_path):
    (tmp_path / "a.nequip.pth").write_text("")
    (tmp_path / "a.ckpt").write_text("nothing")
    (tmp_path / "a.txt").write_text("nothing")

    class Direct(torch.nn.Module):
        is_graph_model = True

        def __init__(self):
            super().__init__()
            self.weight = torch.nn.Parameter(torch.zeros(1))

    class Compiled(Direct):
        is_compile_graph_model = True

    for given, said in (
        (tmp_path / "a.nequip.pth", "is a compiled model"),
        (tmp_path / "a.txt", "expected a model of nequip"),
        (tmp_path / "none.ckpt", "no such file"),
        (Direct(), "its forces are not derivatives of an energy"),
        (Compiled(), "the model is compiled"),
        (torch.jit.script(torch.nn.Linear(1, 1)), "the model is compiled"),
        (torch.nn.Linear(1, 1), "expected a model of nequip, got Linear"),
    ):
        with pytest.raises(AtcError, match=said) as e:
            atc.nequip(given, SYMBOLS)
        assert "\n" not in str(e.value)
    with pytest.raises(AtcError, match="cannot be read as a model of nequip"), pytest.warns(match="runs the code"):
        atc.nequip(tmp_path / "a.ckpt", SYMBOLS)
    with pytest.raises(AtcError, match="more than hops=1 layers"):
        atc.nequip(nequip(2), SYMBOLS, hops=1).decompose(argon(Cell([14.0, 15.0, 16.0]), n=(5, 5, 5), jitter=0.3))
