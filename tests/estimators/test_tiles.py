"""Frames in tiles: every quantity of every kind of potential adds up to that of the whole frame."""

import pickle

import numpy as np
import pytest
from energy_systems import NAMES, RandomTerm, chains, hot, system
from test_special_bonds import DSF, LJ, SPECIAL, molecules

import atc
from atc.contracts import Interactions
from atc.decomposers.base import Term
from atc.errors import AtcError
from atc.estimators.driver import fields_of
from atc.estimators.tile_cuts import Cut
from atc.frame import Cell, Frame, Topology
from atc.plan import Request, prepare

KERN = atc.kernel("quartic", radius=3.0)
GRID = atc.Grid.regular(shape=(4, 5, 3))
WHAT = [
    "stress",
    "heat_flux",
    "energy_flux",
    "energy",
    "churning",
    "churning_divergence",
    "smoothed_virial_stress",
    "virial_stress",
    "virial_stress_per_atom",
    "heat_current",
]
REFERRING = [
    "piola_stress",
    "eshelby_stress",
    "displacement_gradient",
    "peridynamic_stress",
    "peridynamic_stress_weighted_virial",
    "peridynamic_piola_stress_weighted_virial_normalised",
    "peridynamic_stress_nodal_virial",
    "peridynamic_piola_stress_nodal_virial",
]


def both(tiles, frame, *arguments, **more):
    return (atc.fields(frame, *arguments, tolerance=1e-12, tiles=t, **more) for t in (None, tiles))


def same(whole, parts, among=()):
    """To 1e-12 of the largest value: sums in another order; of what it is the difference of, where that is larger."""
    compared = 0
    for name in whole.data_vars:
        x, y = parts[name].values, whole[name].values
        if name == "mask" or x.dtype.kind not in "fi":
            np.testing.assert_array_equal(x, y)
            continue
        alike = (n for n in among if n in whole and whole[n].attrs["units"] == whole[name].attrs["units"])
        size = max(np.nanmax(np.abs(whole[n].values), initial=0.0) for n in (name, *alike))
        if name == "churning_divergence":
            continue  # 0 always
        if name in ("churning", "heat_flux_churning") and not y.any():
            continue
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * size, err_msg=name)
        compared += 1
    assert compared >= 3


@pytest.mark.parametrize("name", NAMES)
def test_every_potential_adds_up(name):
    """Boxes hardly larger than a cutoff, tilted, some of their atoms within reach of their own images; bonds, angles
    and torsions across the tiles and the faces."""
    frame, pot = system(name)
    for tiles, partition in (((2, 1, 3), None), ((2, 2, 2), "center")):
        p = pot if partition is None or name in ("lj", "eam") else pot.partitioned("center")
        whole, parts = both(tiles, frame, p, KERN, GRID, WHAT, threads=2)
        same(whole, parts, among=["stress", "energy", "heat_flux_potential", "energy_flux", "stress_potential"])
        # rounding of forces, over 3 Å, that add up to nothing
        assert float(abs(parts.churning_divergence).max()) <= 1e-10 * max(
            float(abs(whole.stress_potential).max()), float(abs(whole.energy).max())
        )


@pytest.mark.parametrize("name", ["lj", "sw", "eam", "hybrid", "dihedral opls", "4-body"])
def test_what_refers_to_a_reference_adds_up(name):
    reference, pot = system(name)
    rng = np.random.default_rng(2)
    F = np.eye(3) + 0.02 * rng.normal(size=(3, 3))
    cell = (
        Cell(reference.cell.vectors @ F, reference.cell.origin, reference.cell.periodic)
        if reference.cell.periodic.all()
        else reference.cell
    )
    x = reference.positions @ F if reference.cell.periodic.all() else reference.positions
    shift = rng.integers(-2, 3, x.shape) * reference.cell.periodic
    volume = {"volume": rng.uniform(8, 12, len(x))}
    images = {"images": -shift}
    frame = reference.replace(
        positions=x + rng.uniform(-0.05, 0.05, x.shape) + shift @ cell.vectors, cell=cell, extra=volume, **images
    )
    reference = reference.replace(extra=volume, images=np.zeros_like(shift))
    whole, parts = both((2, 1, 2), frame, pot, KERN, GRID, REFERRING, reference=reference, horizon=6.0, threads=1)
    same(whole, parts)


@pytest.mark.parametrize("name", ["hybrid", "dihedral opls"])
def test_tiles_of_an_approximate_sum(name):
    """By the modes, with the check: the same error is found, at the same points."""
    frame, pot = system(name)
    kern = atc.kernel("gaussian", radius=3.0)
    arguments = (frame, pot, kern, GRID, ["stress", "heat_flux"], 1e-4)
    whole, parts = (atc.fields(*arguments, method="spectral", threads=1, tiles=t) for t in (None, (2, 2, 1)))
    for q in ("stress_potential", "heat_flux_potential"):
        assert float(abs(whole[q] - parts[q]).max()) <= 2e-4 * float(abs(whole[q]).max())
        assert parts[q].attrs["error_max"] <= 1e-4


@pytest.mark.parametrize("special", ["default", "fene", "amber", "dreiding"])
@pytest.mark.parametrize("box", ["orthogonal", "triclinic", "small"])
def test_special_pairs_are_the_same(box, special):
    """Chains, rings and branches: weights of pairs one, two and three bonds apart, none for the other images of bonded
    atoms."""
    config = molecules(box)
    top = Topology(
        bonds=config.bonds,
        bond_types=np.ones(len(config.bonds), int),
        angles=config.angles,
        angle_types=np.ones(len(config.angles), int),
        dihedrals=config.dihedrals,
        dihedral_types=np.ones(len(config.dihedrals), int),
    )
    x = config.positions
    frame = Frame(
        x,
        Cell(config.cell),
        atc.units.units("lj"),
        types=config.types,
        charges=config.charges,
        masses=np.ones(len(x)),
        topology=top,
        velocities=np.random.default_rng(0).normal(size=x.shape),
    )
    for style in (LJ, DSF):
        more = "\nangle_style none\ndihedral_style none\n"
        pot = atc.potential(f"{style}{more}{SPECIAL[special]}", units="lj")
        whole, parts = both(
            (2, 2, 1),
            frame,
            pot,
            atc.kernel("quartic", radius=1.5),
            GRID,
            ["stress", "energy", "heat_current", "virial_stress"],
            threads=1,
        )
        same(whole, parts, among=["stress", "energy"])


def test_copies_of_listed_terms_are_no_more_than_needed():
    """Every atom has each of its terms once; the copies that are nobody's own beyond that are none."""
    frame, pot = system("dihedral opls")
    atoms = np.zeros(len(frame), int)
    total = 0
    for tile in Cut(frame, (2, 2, 2), pot).tiles():
        (tuples, types) = tile.listed[0]
        total += len(types)
        mine = tile.own_p[tuples]
        assert mine.any(1).all()
        np.add.at(atoms, tile.index_p[tuples[mine]], 1)
        # a copy is as it is in the whole frame: bonds of 1.2 to 1.6
        d = np.linalg.norm(np.diff(tile.frame.positions[tuples], axis=1), axis=2)
        assert (d > 1.15).all() and (d < 1.65).all()
    np.testing.assert_array_equal(atoms, np.bincount(frame.topology.dihedrals.reshape(-1), minlength=len(frame)))
    assert len(frame.topology.dihedrals) < total


@pytest.mark.parametrize("name", ["hybrid", "sw"])
def test_tiles_and_tasks_can_be_sent(name):
    """What workers get is all they need."""
    reference, pot = system(name)
    frame = reference.replace(positions=reference.positions + 0.01)
    request = prepare(
        Request(
            frame,
            pot,
            KERN,
            GRID,
            ["stress", "piola_stress", "heat_current"],
            1e-12,
            reference=reference,
            tiles=(2, 2, 1),
            threads=1,
        )
    )

    def elsewhere(f, tiles, task):
        sent = pickle.dumps(task)
        for tile in tiles:
            yield pickle.loads(pickle.dumps(f(pickle.loads(pickle.dumps(tile)), pickle.loads(sent))))

    here, there = (fields_of([frame], request.settings(), run_tiles=run) for run in (None, elsewhere))
    for q, x in here.arrays.items():
        np.testing.assert_array_equal(x, there.arrays[q])


def test_an_empty_frame_and_empty_tiles():
    frame, pot = system("bond harmonic")
    none = frame.replace(
        positions=np.zeros((0, 3)),
        types=None,
        ids=None,
        masses=np.zeros(0),
        velocities=np.zeros((0, 3)),
        topology=Topology(),
    )
    whole, parts = (
        atc.fields(none, pot, KERN, GRID, ["stress_potential", "energy_potential"], tiles=t) for t in (None, (2, 2, 2))
    )
    assert not whole.stress_potential.values.any() and not parts.stress_potential.values.any()
    # all in one corner
    corner = hot(
        np.array([[0.5, 0.5, 0.5], [1.8, 0.6, 0.4]]),
        Cell([20.0] * 3),
        0,
        topology=Topology(bonds=np.array([[0, 1]]), bond_types=np.array([1])),
    )
    whole, parts = both((3, 3, 3), corner, pot, KERN, GRID, ["stress", "energy", "virial_stress"], threads=1)
    same(whole, parts)


def test_notes_and_errors_are_those_of_the_whole_frame():
    _, pot = system("bond fene")
    x = np.array([[1.0, 1, 1], [19.5, 1, 1], [5.0, 1, 1], [6.0, 9, 9]])
    far = hot(x, Cell([20.0] * 3), 0, topology=Topology(bonds=np.array([[0, 1], [2, 3]]), bond_types=np.array([1, 1])))
    with pytest.raises(AtcError) as whole:
        atc.fields(far, pot, KERN, GRID, ["stress"])
    with pytest.raises(AtcError) as parts:
        atc.fields(far, pot, KERN, GRID, ["stress"], tiles=(2, 2, 2))
    assert str(parts.value) == str(whole.value)


class Outsider(RandomTerm):
    """A term of another maker that neither lists its atoms nor has a cutoff."""

    terms_of = Term.terms_of  # as of whoever says nothing


def test_what_tiles_cannot_do():
    frame, pot = chains(), atc.potential(Outsider(4), "metal")
    with pytest.raises(AtcError, match="tiles: random 4-body does not say which atoms it acts on: leave tiles out"):
        atc.fields(frame, pot, KERN, GRID, ["stress_potential"], tiles=(2, 1, 1))

    class Bodies(Interactions):
        units, cutoff, central = atc.units.units("metal"), 5.0, True

        def describe(self):
            return "a body"

        def stream(self, frame, *a, **more):
            from atc.decomposers.base import Decomposition

            return Decomposition(0.0, np.zeros((3, 3)))

    with pytest.raises(AtcError, match="tiles: only potentials made of atc's terms"):
        atc.fields(frame, Bodies(), KERN, GRID, ["stress_potential"], tiles=(2, 1, 1))
