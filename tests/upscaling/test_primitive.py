"""Cells that are not primitive, whose bands are folded; and how far peridynamic models are from the lattice."""

from dataclasses import replace

import numpy as np
import pytest
from crystals import ARGON, crystal, model

import atc
from atc.errors import AtcError
from atc.upscaling.crystal import Crystal
from atc.upscaling.dispersion import dispersion
from atc.upscaling.primitive import folded, primitive, translations

CUBES = {  # structure: atoms of the cube that its primitive cells leave out
    "fcc": [[0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]],
    "bcc": [[0.5, 0.5, 0.5]],
}
TURN = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]


def cube(structure, a=5.3, types=None):
    base = np.array([[0.0, 0, 0], *CUBES["fcc" if structure == "diamond" else structure]])
    if structure == "diamond":
        base = np.concatenate([base, base + 0.25])
    return Crystal(np.eye(3) * a, base * a + 0.3, 39.948, "metal", types, name="cube")


@pytest.mark.parametrize("structure, cells, atoms", [("fcc", 4, 1), ("bcc", 2, 1), ("diamond", 4, 2)])
def test_a_cube_of_a_primitive_lattice(structure, cells, atoms):
    """In any orientation, with positions as files round them; what moved is another crystal."""
    made = cube(structure)
    rng = np.random.default_rng(0)
    made = replace(
        made, vectors=made.vectors @ TURN, positions=(made.positions + rng.uniform(-1e-5, 1e-5, (len(made), 3))) @ TURN
    )
    assert len(translations(made)) == cells
    small = primitive(made)
    assert len(small) == atoms and small.volume == pytest.approx(made.volume / cells, rel=1e-9)
    assert np.linalg.det(small.vectors) > 0
    # its vectors are the shortest of the lattice: those of the structure
    want = np.linalg.norm(Crystal.cubic(structure, 5.3, 39.948, "metal").vectors, axis=1)
    np.testing.assert_allclose(np.linalg.norm(small.vectors, axis=1), want, rtol=1e-12)
    moved = replace(made, positions=made.positions + rng.uniform(-0.05, 0.05, (len(made), 3)))
    assert len(translations(moved)) == 1 and primitive(moved) is moved and folded(moved) == ""
    words = f"cube holds {cells} primitive cells of {atoms} atom"
    assert words in folded(made) and "\n" not in folded(made)


def test_types_count_and_long_cells():
    assert len(translations(cube("diamond", types=[1] * 4 + [2] * 4))) == 4
    assert len(translations(cube("fcc", types=[1, 2, 2, 2]))) == 1
    assert len(translations(cube("fcc", types=[1, 1, 2, 2]))) == 2
    long = Crystal(np.diag([1.0, 1.0, 6.0]) @ TURN, np.arange(6)[:, None] * [0, 0, 1.0] @ TURN, 1.0, "lj")
    np.testing.assert_allclose(np.abs(primitive(long).vectors @ primitive(long).vectors.T), np.eye(3), atol=1e-12)


def test_bands_of_the_cube_are_those_of_the_primitive_cell_and_their_images(tmp_path):
    """In the notes, the printed rows, the attributes and the picture; `primitive = true` takes them away."""
    pot, one = model("argon"), crystal("argon")
    a = float(np.linalg.norm(one.conventional[0]))
    big = Crystal(np.eye(3) * a, np.array([[0, 0, 0], *CUBES["fcc"]]) * a, one.units.to_user("mass", one.masses[0]),
                  one.units, name="cube")  # fmt: skip
    big.masses[:] = one.masses[0]
    found, plain = (dispersion(c, pot, directions=[(1, 0, 0)], phonopy=False) for c in (big, one))
    assert plain.folded == "" and plain.notes == []
    assert "bands are folded: cube holds 4 primitive cells of 1 atom" in found.notes[0]
    assert found.dataset().attrs["folded"] == found.notes[0]
    assert "folded" in found.figure().get_suptitle().replace("\n", " ")
    k = found.rays[0].k_kc[1:]
    bands, at_k = found.rays[0].lattice_km[1:], plain.fc.frequencies(k)
    for row, own in zip(bands, at_k):
        assert np.abs(row[:, None] - own).min(axis=0).max() < 1e-6 * bands.max()
    rows = "".join(f"{n + 1} 1 39.948 {x:.9g} {y:.9g} {z:.9g}\n" for n, (x, y, z) in enumerate(big.positions))
    (tmp_path / "cell.dump").write_text(
        "ITEM: UNITS\nmetal\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n4\nITEM: BOX BOUNDS pp pp pp\n"
        + 3 * f"0 {a:.9g}\n"
        + f"ITEM: ATOMS id type mass x y z\n{rows}"
    )
    from atc.config.scene import Scene
    from atc.upscaling.dispersion import dispersion_of_scene

    scene = {
        "potential": {"lammps": ARGON, "units": "metal"},
        "dispersion": {"unit_cell": str(tmp_path / "cell.dump"), "primitive": True, "directions": [[1, 0, 0]],
                       "phonopy": False},
    }  # fmt: skip
    again = dispersion_of_scene(Scene.load(scene))
    assert again.folded == "" and len(again.crystal) == 1
    np.testing.assert_allclose(again.rays[0].lattice_km, plain.rays[0].lattice_km, atol=1e-6 * bands.max())
    scene["dispersion"] = {"structure": "fcc", "lattice_constant": 5.3, "masses": [39.948], "primitive": True}
    with pytest.raises(AtcError, match=r"\[dispersion\] primitive: of a unit_cell"):
        dispersion_of_scene(Scene.load(scene))


def test_differences_of_models_and_lattice():
    """ω of the classical model is c k: its difference is known; in the table, the dataset and a panel of the picture."""
    found = dispersion(crystal("argon"), model("argon"), directions=[(1, 0, 0)], models=["classical"], phonopy=False)
    ray, (name,) = found.rays[0], found.rays[0].models
    d = ray.difference(name)
    assert not np.isfinite(d[0]).any()
    np.testing.assert_allclose(d[1:], ray.models[name][1:] / ray.lattice_km[1:] - 1)
    # ω of the lattice bends down: by (π/2 − 1) or so at the boundary
    assert (np.diff(d[2:], axis=0) > 0).all() and 0.3 < d[-1].min() < d[-1].max() < 0.8
    np.testing.assert_array_equal(found.dataset()["model_difference"].values[0, 0], d)
    row = next(line for line in found.tables() if line.startswith(f"  {name}") and "[100]" in line)
    assert float(row.split()[-1]) == pytest.approx(100 * d[-1].max(), abs=0.01)
    top, low = found.figure().axes
    assert low.get_ylabel() == "PD − lattice (%)"
    drawn = np.array([line.get_ydata() for line in low.lines[1:]])
    np.testing.assert_allclose(drawn, 100 * d.T)
    assert low.get_ylim()[1] > np.nanmax(drawn)
    with atc.errors.heard() as warned:
        found.figure()
    assert not warned
