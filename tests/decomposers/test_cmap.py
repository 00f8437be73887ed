"""Correction maps: read, told from their mirror images as LAMMPS does, and refused for that reason."""

import numpy as np
import pytest
from energy_systems import lammps_potentials
from lammps_oracle import lammps_session

from atc.decomposers.bonded.cmap import check_fix_cmap, handedness, read_crossterms, read_maps
from atc.errors import AtcError


def peptide(path, x):
    """Five atoms in a chain with one crossterm of map 1 (alanine's)."""
    rows = [f"{k + 1} 1 1 0 {a[0]:.17g} {a[1]:.17g} {a[2]:.17g}" for k, a in enumerate(x)]
    path.write_text(
        "five atoms\n\n5 atoms\n1 atom types\n1 crossterms\n\n-20 20 xlo xhi\n-20 20 ylo yhi\n-20 20 zlo "
        "zhi\n\nMasses\n\n1 12\n\n"
        "Atoms # full\n\n" + "\n".join(rows) + "\n\nCMAP\n\n1 1 1 2 3 4 5\n"
    )


def energy_of_lammps(data, maps):
    with lammps_session() as lmp:
        for line in (
            "units real",
            "atom_style full",
            "atom_modify map array",
            f"fix c all cmap {maps}",
            f"read_data {data} fix c crossterm CMAP",
            "pair_style zero 8",
            "pair_coeff * *",
            "thermo_style custom pe f_c",
            "run 0 post no",
        ):
            lmp.command(line)
        return lmp.get_thermo("pe")


@pytest.mark.parametrize("name", ["charmm22.cmap", "charmm36.cmap"])
def test_maps_of_charmm_prefer_one_hand(tmp_path, name):
    file = lammps_potentials() / name
    maps = read_maps(file)
    assert maps.shape == (6, 24, 24) and all(handedness(m) > 2.8 for m in maps)
    x = np.cumsum([[0, 0, 0], [0.2, 1.4, 0.3], [1.2, 0.1, 0.7], [-0.3, 0.4, 1.3], [0.4, -1.3, 0.2]], axis=0)
    peptide(tmp_path / "one.data", x)
    peptide(tmp_path / "mirror.data", x * [1, 1, -1])
    one, mirror = (energy_of_lammps(tmp_path / f"{n}.data", file) for n in ("one", "mirror"))
    assert abs(one - mirror) > 0.1
    types, ids = read_crossterms(tmp_path / "one.data")
    assert types.tolist() == [1] and ids.tolist() == [[1, 2, 3, 4, 5]]
    with pytest.raises(
        AtcError,
        match=r"in.x, line 3: fix cmap: 1 crossterms use map 1: .*mirror image by up to .*not a function of distances",
    ) as e:
        check_fix_cmap([name], lammps_potentials(), "in.x, line 3", types)
    assert "\n" not in str(e.value)
    # Without crossterms the fix does nothing.
    check_fix_cmap([name], lammps_potentials(), "in.x, line 3", types[:0])


def test_maps_without_energy_and_malformed_files(tmp_path):
    (tmp_path / "maps").write_text("# none\n" + "0.0 " * 576 + "\n" + "1.0 " * 576)
    check_fix_cmap(["maps"], tmp_path, "in.x", [1, 1])
    for types, words, says in (
        ([2], ["maps"], "map 2: maps that are the same for the mirror image are not done yet"),
        ([3], ["maps"], "type 3, but .*maps has 2 correction maps"),
        ([1], [], "takes the file of its maps, got nothing"),
        ([1], ["missing"], "cannot read the correction maps"),
        ([1], ["words"], "words:1: expected the energies of a correction map, got 'x'"),
        ([1], ["short"], "24 x 24 finite numbers each, this file has 3 numbers"),
    ):
        (tmp_path / "words").write_text("1 2 x\n")
        (tmp_path / "short").write_text("1 2 3\n")
        with pytest.raises(AtcError, match=says):
            check_fix_cmap(words, tmp_path, "in.x", types)
    (tmp_path / "d").write_text("d\n\nCMAP\n\n1 5 1 2 3\n")
    with pytest.raises(AtcError, match="d:5: a row of section CMAP has an index, a type and five atom ids"):
        read_crossterms(tmp_path / "d")
    assert len(read_crossterms(tmp_path / "maps")[0]) == 0


SCRIPT = """units real
atom_style full
atom_modify map array
fix c all cmap maps
read_data one.data fix c crossterm CMAP
pair_style lj/cut 8
pair_coeff 1 1 0.1 3.0
"""


def test_scripts_with_maps(tmp_path):
    """A map without energy is nothing; another is refused for its mirror image, with the line of the fix."""
    import atc

    peptide(tmp_path / "one.data", np.random.default_rng(3).uniform(-2, 2, (5, 3)))
    (tmp_path / "in.run").write_text(SCRIPT)
    (tmp_path / "maps").write_text("0.0 " * 576)
    assert atc.potential(tmp_path / "in.run").cutoff == 8.0
    (tmp_path / "maps").write_text(" ".join(map(str, range(576))))
    with pytest.raises(AtcError, match=r"line 4: fix cmap: 1 crossterms use map 1: .*mirror image by up to"):
        atc.potential(tmp_path / "in.run")
    # pasted lines do not say which crossterms there are
    with pytest.raises(AtcError, match="fix cmap adds energies of two torsions that differ from those of the mirror"):
        atc.potential("units real\nfix c all cmap maps\npair_style lj/cut 8\npair_coeff 1 1 0.1 3.0")
