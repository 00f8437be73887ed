"""Every class that stands for one of the contracts has all its members, and takes what the contract says."""

import importlib
import inspect

import pytest

import atc
from atc import contracts
from atc.errors import AtcError
from atc.frame import Cell, Frame

KEPT = {
    contracts.FrameSource: ["readers.trajectory:Trajectory"],
    contracts.Interactions: ["decomposers.potentials:Potential", "pd.fields:SnapshotBonds"],
    contracts.Kernel: ["kernels.base:Kernel"],
    contracts.Grid: ["grids:Grid"],
    contracts.BoundGrid: ["grids:BoundGrid"],
    contracts.Deposit: [
        "deposit.direct:LatticeDeposit",
        "deposit.direct:PointsDeposit",
        "deposit.direct:SlabDeposit",
        "deposit.spectral:SpectralDeposit",
    ],
    contracts.BondSprings: ["twins.linear:LatticeSprings"],
    contracts.Micromodulus: [
        "upscaling.peridynamic_kernels:FittedKernel",
        "upscaling.peridynamic_kernels:MollifiedLattice",
    ],
    contracts.PDLaw: [
        "pd.materials.pmb:PMB",
        "pd.materials.lps:LPS",
        "pd.materials.correspondence:Correspondence",
        "pd.materials.bond_associated:BondAssociated",
    ],
}
PAIRS = [(protocol, name) for protocol, names in KEPT.items() for name in names]


@pytest.mark.parametrize("protocol, name", PAIRS, ids=[n for _, n in PAIRS])
def test_members(protocol, name):
    module, _, kind = name.partition(":")
    kind = getattr(importlib.import_module(f"atc.{module}"), kind)
    # Data members may be set when an object is made.
    methods = {
        k: v
        for k, v in vars(protocol).items()
        if (inspect.isfunction(v) or isinstance(v, property)) and not k.startswith("_")
    }
    assert methods, "a contract that asks for nothing"
    for member, said in methods.items():
        has = inspect.getattr_static(kind, member, None)
        if isinstance(said, property):
            assert has is not None or member in inspect.getsource(kind), f"{kind.__name__} has no {member}"
            continue
        assert callable(has) or isinstance(has, classmethod | staticmethod), f"{kind.__name__} has no {member}()"
        asked = list(inspect.signature(said).parameters.values())[1:]
        takes = list(inspect.signature(has).parameters.values())[1:]
        names = {p.name for p in takes}
        assert [p.name for p in asked if p.name not in names] == [], f"{kind.__name__}.{member} takes other arguments"
        more = [p.name for p in takes if p.name not in {a.name for a in asked}]
        needed = [p for p in takes if p.name in more and p.default is p.empty and p.kind is p.POSITIONAL_OR_KEYWORD]
        assert needed == [], f"{kind.__name__}.{member} needs more arguments"


def test_every_contract_is_held_by_something():
    assert {p.__name__ for p in KEPT} == set(contracts.__all__)


def test_what_says_nothing_is_answered_for():
    """A model that only has what it must."""

    class Free(contracts.Interactions):
        units, cutoff = atc.units.units("metal"), 5.0

    free, frame = Free(), Frame([[0.0, 0, 0]], Cell([5.0] * 3), atc.units.units("metal"))
    assert free.central and not free.pairwise and free.local is free and free.settled(frame) is free
    assert free.complete(frame) is frame and not free.terms and free.constraints is None


def test_what_is_no_model_is_refused_in_one_line():
    frame = Frame([[0.0, 0, 0]], Cell([5.0] * 3), atc.units.units("metal"))

    class Stranger:
        def stream(self, *_, **__): ...

    with pytest.raises(AtcError, match=r"pot is a Stranger: expected what atc\.potential"):
        atc.fields(frame, Stranger(), atc.kernel("quartic", 2.0), atc.Grid.points([[0, 0, 0]]), ["stress"])
