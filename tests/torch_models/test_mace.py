"""MACE models with random weights: energies, forces and virial are the model's own, and all laws hold."""

import copy
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from e3nn import o3
from energy_systems import diamond
from frames import argon
from mace import modules
from test_edge_model import current, near
from test_every_key import begin, noticed

import atc
from atc.analysis.check import check
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell


def made(
    layers=2,
    interaction="RealAgnosticResidualInteractionBlock",
    seed=0,
    kind="ScaleShiftMACE",
    dtype=torch.float64,
    **more,
):
    torch.manual_seed(seed)
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        options = {
            "r_max": 3.6,
            "num_bessel": 4,
            "num_polynomial_cutoff": 5,
            "max_ell": 2,
            "interaction_cls": modules.interaction_classes[interaction],
            "interaction_cls_first": modules.interaction_classes[more.pop("first", interaction)],
            "num_interactions": layers,
            "num_elements": 2,
            "hidden_irreps": o3.Irreps("4x0e + 4x1o"),
            "MLP_irreps": o3.Irreps("6x0e"),
            "atomic_energies": np.array([-3.0, 1.5]),
            "avg_num_neighbors": 8.0,
            "atomic_numbers": [6, 14],
            "correlation": 2,
            "gate": torch.nn.functional.silu,
            "radial_MLP": [8],
        } | more
        if kind == "ScaleShiftMACE":
            options = {"atomic_inter_scale": 0.7, "atomic_inter_shift": 0.1} | options
        return getattr(modules, kind)(**options)
    finally:
        torch.set_default_dtype(before)


SYMBOLS = ["Si", "C"]


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_laws(layers):
    """The model's own energy, forces and virial are compared on the first frame, and every tenth, of a potential."""
    frame, pot = diamond(5.2, 1), atc.mace(made(layers), SYMBOLS)
    d = pot.decompose(frame, sources=True)
    assert d.notes["energy_identity"] < 1e-12
    report = check([frame], pot, atc.kernel("gaussian", width=1.5), points=3)
    assert report.ok, str(report)
    assert (d.bonds.P_b is None) == (layers == 1)


@pytest.mark.parametrize(
    "interaction",
    [
        "RealAgnosticInteractionBlock",
        "RealAgnosticDensityInteractionBlock",
        "RealAgnosticDensityResidualInteractionBlock",
    ],
)
def test_other_blocks(interaction):
    pot = atc.mace(made(2, interaction, pair_repulsion=True, distance_transform="Agnesi", kind="MACE"), SYMBOLS)
    d = pot.decompose(diamond(5.2, 1), sources=True)
    assert d.notes["energy_identity"] < 1e-12


def test_batches():
    frame = argon(Cell([14.0, 15.0, 16.0]), n=(5, 5, 5), jitter=0.3)
    model = made(2)
    want = atc.mace(model, SYMBOLS).decompose(frame, sources=True)
    with pytest.warns(AtcWarning, match="does not fit into the memory at once, so it was not compared"):
        got = atc.mace(model, SYMBOLS, batch=40).decompose(frame, sources=True)
    near(got.forces_nc, want.forces_nc, 1e-12)
    near(current(got.bonds, frame.velocities), current(want.bonds, frame.velocities), 1e-11)


def test_central_stress_of_one_layer():
    frame, model = diamond(5.2, 1), made(1)
    d = atc.mace(model, SYMBOLS, stress="central").decompose(frame)
    near(d.forces_nc, atc.mace(model, SYMBOLS).decompose(frame).forces_nc, 1e-10)
    with pytest.raises(AtcError, match='stress="central" is for models of one hop'):
        atc.mace(made(2), SYMBOLS, stress="central")


def test_files_elements_and_energies_of_atoms(tmp_path):
    frame, model = diamond(5.2, 1), made(2, dtype=torch.float32)
    torch.save(model, tmp_path / "my.model")
    with pytest.warns(AtcWarning, match="reading a pickled model runs the code that is in it"):
        pot = atc.mace(tmp_path / "my.model", SYMBOLS)
    assert "MACE my.model, weights of float32 in float64" in pot.describe()
    want = pot.decompose(frame)
    with pytest.raises(AtcError, match="types 1, 2 are not named"):
        atc.mace(model).decompose(frame)
    named = atc.mace(model).decompose(frame.replace(type_names={1: "Si", 2: "C"}))
    np.testing.assert_array_equal(named.forces_nc, want.forces_nc)
    assert next(model.parameters()).dtype == torch.float32  # it is left as it was
    less = atc.mace(model, SYMBOLS, reference="isolated")
    shift = (want.energies_n - less.decompose(frame).energies_n) / frame.units.factor("energy")
    # E0 and what the shift and the readouts make of a single atom
    assert np.ptp(shift[frame.types == 1]) < 1e-12 and abs(shift[frame.types == 1][0] - shift[frame.types == 2][0]) > 1


def test_heads():
    model = made(
        1,
        heads=["pt", "mine"],
        atomic_energies=np.array([[-3.0, 1.5], [0.0, 0.5]]),
        atomic_inter_scale=np.array([0.7, 0.9]),
        atomic_inter_shift=np.array([0.1, 0.2]),
    )
    frame = diamond(5.2, 1)
    with pytest.raises(AtcError, match="has the heads pt, mine: say which one"):
        atc.mace(model, SYMBOLS)
    with pytest.raises(AtcError, match="no head 'yours'"):
        atc.mace(model, SYMBOLS, head="yours")
    a, b = (atc.mace(model, SYMBOLS, head=h).decompose(frame) for h in ("pt", "mine"))
    assert np.abs(a.forces_nc - b.forces_nc).max() > 1e-3 * np.abs(a.forces_nc).max()


def test_what_is_refused(tmp_path):
    from e3nn.util.jit import script

    model = made(1)
    scripted = script(copy.deepcopy(model))
    scripted.save(str(tmp_path / "compiled.model"))
    torch.save(model.state_dict(), tmp_path / "weights.model")
    (tmp_path / "text.model").write_text("nothing")
    torch.save({"a": torch.nn.Linear(1, 1)}, tmp_path / "other.model")
    for given, said in (
        (tmp_path / "compiled.model", "is a compiled model"),
        (scripted, "the model is compiled"),
        (tmp_path / "weights.model", "holds weights alone"),
        (tmp_path / "text.model", "not a file that torch.save made"),
        (tmp_path / "none.model", "no such file"),
        (tmp_path, "it is a directory"),
        (torch.nn.Linear(1, 1), "expected a MACE model, got Linear"),
        (42, "expected a MACE model, got int"),
    ):
        with pytest.raises(AtcError, match=said) as e:
            atc.mace(given, SYMBOLS)
        assert "\n" not in str(e.value)
    with pytest.raises(AtcError, match="expected a MACE model, got dict"), pytest.warns(AtcWarning):
        atc.mace(tmp_path / "other.model", SYMBOLS)

    class Charged(modules.ScaleShiftMACE):
        """A part that sees positions, as long-range charges do."""

        def forward(self, data, **options):
            out = super().forward(data, **options)
            x = data["positions"]
            extra = 0.01 * (x - x.mean(0)).square().sum(1)
            return out | {"node_energy": out["node_energy"] + extra}

    model = made(1)
    model.__class__ = Charged
    with pytest.raises(AtcError, match="depends on positions or the cell in other ways than through its edges"):
        atc.mace(model, SYMBOLS).decompose(diamond(5.2, 1))

    class Apart(modules.ScaleShiftMACE):
        """A part of its energy that is none of the atoms'."""

        def forward(self, data, **options):
            out = super().forward(data, **options)
            return out | {"forces": None if out["forces"] is None else 1.01 * out["forces"]}

    model = made(1)
    model.__class__ = Apart
    with pytest.raises(AtcError, match="forces from the edges differ from the model's own by"):
        atc.mace(model, SYMBOLS).decompose(diamond(5.2, 1))


def test_every_tenth_frame_is_compared_with_the_model_s_own_call():
    pot, frame, calls = atc.mace(made(1), SYMBOLS), diamond(5.2, 1), []
    (term,) = pot.terms
    own = term.own

    def counted(*a):
        calls.append(a)
        energy, forces, virial = own(*a)
        return energy, forces, virial + (1e-3 if len(calls) > 2 else 0.0)

    term.own = counted
    for _ in range(20):
        pot.decompose(frame)
    assert len(calls) == 2
    with pytest.raises(AtcError, match="virial from the edges differs from the model's own by"):
        pot.decompose(frame)


def test_scenes(tmp_path, monkeypatch):
    """[potential] mace, its keys; the output says how it was made; a run goes on only with the same model."""
    from atc.config.scene import Scene

    monkeypatch.chdir(tmp_path)
    frame, two = diamond(5.2, 1), {"heads": ["pt", "mine"], "atomic_energies": np.array([[-3.0, 1.5], [0.0, 0.5]])}
    two |= {"atomic_inter_scale": np.array([0.7, 0.9]), "atomic_inter_shift": np.array([0.1, 0.2])}
    for name, model in (("my.model", made(1, **two)), ("other.model", made(1, seed=1, **two))):
        torch.save(model, name)
    names = np.array(["Si", "C"])[frame.types - 1]
    rows = "".join(f"{s} {' '.join(f'{c:.17g}' for c in x)}\n" for s, x in zip(names, frame.positions, strict=True))
    lattice = " ".join(map(str, frame.cell.vectors.ravel()))
    head = f'{len(frame)}\nLattice="{lattice}" Properties=species:S:1:pos:R:3\n'
    (tmp_path / "run.xyz").write_text(4 * (head + rows))

    def scene(**more):
        table = {"mace": "my.model", "head": "mine"} | more
        fields = {"quantities": ["virial_stress_potential"]}
        return {"trajectory": {"file": "run.xyz"}, "potential": table, "fields": fields}

    with pytest.warns(AtcWarning, match="runs the code"):
        ds = Scene.load(scene(types=["C", "Si"], reference={"C": 1.0})).run()
    assert 'mace = "my.model"' in ds.scene and 'head = "mine"' in ds.scene and 'types = ["C", "Si"]' in ds.scene
    with pytest.warns(AtcWarning, match="runs the code"):
        for change in ({"mace": "other.model"}, {"head": "pt"}, {"stress": "central"}, {"reference": "isolated"}):
            begin(scene(), tmp_path / "out.zarr")
            noticed(scene(**change), tmp_path / "out.zarr")
        Path("my.model").write_bytes(Path("other.model").read_bytes())
        noticed(scene(), tmp_path / "out.zarr")
    for change, said in (
        ({"head": "yours"}, "no head 'yours'"),
        ({"nep": "nep.txt"}, "give nep or mace, not both"),
        ({"units": "metal"}, "learned models and those of KIM are in eV"),
        ({"mace": "none.model"}, "no such file"),
    ):
        with pytest.raises(AtcError, match=said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            Scene.load(scene(**change)).potential()
    with pytest.raises(AtcError, match="head.*goes with mace"):
        Scene.load({"trajectory": {"file": "run.xyz"}, "potential": {"nep": "n", "head": "x"}, "fields": {}})
