"""Fracture of the twin from the crystal's surface energy, and damage of both sides: a crystal that is torn in two."""

import numpy as np
import pytest
from crystals import crystal, elastic, model
from test_twin import block, scene, twin_of

import atc
from atc.errors import AtcError
from atc.twins.damage import NearestBonds
from atc.upscaling.surfaces import cleavage


def test_bonds_across_a_gap_are_lost():
    """A layer moved away by more than its bonds are long: atoms at the gap lose four of twelve, others none."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    whole = block()
    open_ = whole.replace(cell=atc.frame.Cell(whole.cell.vectors, periodic=(False, True, True)))
    up = open_.positions[:, 0] > 2.4 * a
    bonds = NearestBonds(open_, crystal("argon"))
    assert bonds.longest == pytest.approx(0.5 * (1 / 2**0.5 + 1) * a, rel=1e-6)
    assert np.bincount(bonds.count_n).nonzero()[0].tolist() == [8, 12]
    assert not bonds.lost(open_).any()
    lost = bonds.lost(open_.replace(positions=open_.positions + np.where(up[:, None], [3.0, 0, 0], 0)))
    x = np.round((open_.positions[:, 0] - 0.1) / a, 6)
    assert lost[(x == 2.0) | (x == 2.5)] == pytest.approx(4 / 12)
    assert not lost[(x < 2.0) | (x > 2.5)].any()


def test_a_crystal_torn_in_two(tmp_path):
    """Both ends driven apart in MD and twin: bonds of both break, at the stretch that the surface energy gives."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    pull = lambda d: lambda X: np.where(X[:, :1] > 2.4 * a, [d, 0.0, 0.0], 0.0)  # noqa: E731
    frames = [block(), *(block(u=pull(d), time=500.0 * k) for k, d in enumerate((0.0, 1.0, 2.0, 3.0)))]
    boxes = [[[-9, -9, -9], [1.2 * a, 99, 99]], [[3.2 * a, -9, -9], [4.4 * a, 99, 99]]]
    found = twin_of(tmp_path / "run.dump", frames, grips=boxes, fracture=True, spacing=2.65)
    gamma = cleavage(crystal("argon"), model("argon")).energy
    K = (elastic("argon").cubic[0] + 2 * elastic("argon").cubic[1]) / 3
    s00 = found.material.damage.s00
    assert found.material.material.fracture_energy(found.body.body, s00) == pytest.approx(2 * gamma, rel=1e-9)
    assert s00 == pytest.approx(np.sqrt(gamma / K / found.body.body.horizon), rel=0.6)
    ds = found.dataset
    for side in ("md", "pd"):
        share = ds[f"{side}_damage_of_body"].values
        assert share[0] == 0.0 and share[-1] > 0.01 and (np.diff(share) >= 0).all()
        assert np.nanmax(ds[f"{side}_damage"].values[-1]) > 0.05
    assert any("fracture: Gc = 2 gamma(111)" in line for line in found.lines)


def test_fracture_is_for_moving_isotropic_twins(tmp_path):
    frames = [block(), block(time=1.0)]
    for settings, words in (
        ({"motion": "static"}, "bonds break in dynamic twins only"),
        ({"material": "cauchy-born"}, 'only the bonds of material = "isotropic" break'),
        ({"material": "smoothed", "motion": "static"}, "bonds break in dynamic twins only"),
        ({"material": "smoothed", "fracture_energy": 1.0}, "parts as the potential has it"),
    ):
        with pytest.raises(AtcError, match=words):
            atc.twin(scene(tmp_path / "run.dump", frames, fracture=True, **settings))


def test_atoms_that_are_carried_part_as_the_potential_has_it(tmp_path):
    """With a node at every atom the twin loses the bonds that the atoms would: those of a block torn in two, on the
    same measure as the MD's; and the line on what is left out does not name fracture."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    pull = lambda d: lambda X: np.where(X[:, :1] > 2.4 * a, [d, 0.0, 0.0], 0.0)  # noqa: E731
    frames = [block(), *(block(u=pull(d), time=500.0 * k) for k, d in enumerate((0.0, 1.5, 3.0, 4.5)))]
    boxes = [[[-9, -9, -9], [2.4 * a, 99, 99]], [[2.4 * a, -9, -9], [99, 99, 99]]]
    more = {"crack_direction": [0, 1, 0], "crack_normal": [1, 0, 0], "material": "smoothed", "nodes": "atoms"}
    found = twin_of(tmp_path / "run.dump", frames, grips=boxes, fracture=True, **more)
    ds = found.dataset
    area = ds["pd_crack_area"].values
    # All atoms are held where the run has them, so that both lose the same bonds: those of one plane.
    assert area == pytest.approx(ds["md_crack_area"].values, rel=1e-9)
    assert area[0] == 0.0 and area[-1] == pytest.approx((5 * a) ** 2, rel=1e-6)
    assert ds["pd_damage_of_body"].values == pytest.approx(ds["md_damage_of_body"].values, rel=1e-9)
    assert "pd_dissipated_energy" not in ds
    assert "nearest-neighbour" in ds["pd_damage"].attrs["long_name"]
    assert not any(line.startswith("left out") and "fracture" in line for line in found.lines)
