"""Masses that potential files say: those that LAMMPS has behind the same lines, whichever of mass and pair_coeff comes
last."""

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

SCRIPT = """units metal
boundary p p p
region b block 0 10 0 10 0 10
create_box {n} b
pair_style {style}
{lines}
"""
STYLES = {
    "one funcfl": ("eam", ["pair_coeff * * Cu_u3.eam"], 2),
    "two funcfl": ("eam", ["pair_coeff 1 1 Cu_u3.eam", "pair_coeff 2 2 Ni_u3.eam"], 2),
    "open": ("eam", ["pair_coeff * * Cu_u3.eam", "pair_coeff 2 2 Ni_u3.eam"], 3),
    "setfl": ("eam/alloy", ["pair_coeff * * CuNi.eam.alloy Ni Cu"], 2),
    "fs": ("eam/fs", ["pair_coeff * * Al_mm.eam.fs Al"], 1),
    "he": ("eam/he", ["pair_coeff * * PdHHe.eam.he Pd H He"], 3),
    "eim": ("eim", ["pair_coeff * * Na Cl ffield.eim Na Cl"], 2),
    "adp": ("adp", ["pair_coeff * * AlCu.adp Al Cu"], 2),
    "meam": ("meam", ["pair_coeff * * library.meam Si C SiC.meam Si C"], 2),
    "hybrid": ("hybrid/overlay eam/alloy lj/cut 3.0", ["pair_coeff * * eam/alloy CuNi.eam.alloy Ni Cu",
                                                       "pair_coeff 1 2 lj/cut 1 1"], 2),
}  # fmt: skip


@pytest.mark.parametrize("order", ["c", "acb", "cab", "bca"])
@pytest.mark.parametrize("case", STYLES)
def test_masses_are_those_of_lammps(tmp_path, monkeypatch, case, order):
    import lammps

    folder = f"{lammps.__path__[0]}/share/lammps/potentials"
    style, coeff, n = STYLES[case]
    monkeypatch.chdir(folder)
    lines = {"a": ["mass * 7.0"], "b": ["mass 1 5.0"], "c": coeff}
    text = SCRIPT.format(style=style, n=n, lines="\n".join(line for o in order for line in lines[o]))
    with lammps_session() as lmp:
        lmp.commands_string(text)
        want = np.array(lmp.numpy.extract_atom("mass")).ravel()[1 : n + 1]
    for word in " ".join(coeff).split():
        if "." in word and not word[0].isdigit():
            (tmp_path / word).symlink_to(f"{folder}/{word}")
    (tmp_path / "in.run").write_text(text + "create_atoms 1 single 1 1 1\nrun 0\n")
    frame = Frame(
        np.arange(3.0 * n).reshape(n, 3),
        Cell([10.0, 10.0, 10.0]),
        units("metal"),
        types=np.arange(1, n + 1),
        ids=np.arange(1, n + 1),
    )
    got = atc.potential(tmp_path / "in.run").complete(frame).masses
    np.testing.assert_allclose(frame.units.to_user("mass", got), want, rtol=1e-14)


def test_frames_that_do_not_number_their_atoms_get_the_masses_of_types(tmp_path):
    """By type, where no atom has a mass of its own; with one type in the box its number need not be in the file."""
    script = ("units metal\natom_style {style}\nregion b block 0 9 0 9 0 9\ncreate_box {n} b\ncreate_atoms 1 box\n{more}"
              "mass 1 39.948\npair_style lj/cut 4.0\npair_coeff * * 0.01 3.4\nrun 0\n")  # fmt: skip
    bare = Frame(np.eye(3) * 2.0, Cell([9.0, 9.0, 9.0]), units("metal"), given={"ids": "order", "types": "assumed"})

    def completed(frame, n=1, style="atomic", more=""):
        (tmp_path / "in.run").write_text(script.format(n=n, style=style, more=more))
        return atc.potential(tmp_path / "in.run").complete(frame)

    assert np.allclose(completed(bare).masses, bare.units.to_internal("mass", 39.948))
    typed = bare.replace(types=np.array([1, 2, 1]), given={"ids": "order"})
    two = completed(typed, 2, more="mass 2 20.0\n")
    assert np.allclose(bare.units.to_user("mass", two.masses), [39.948, 20.0, 39.948])
    assert completed(typed, 2).masses is None  # type 2 has none
    with pytest.raises(AtcError, match="does not number its atoms, so that create_atoms"):
        completed(bare, 2)
    own = completed(bare, style="sphere", more="set type 1 mass 3.0\n")
    assert own.masses is None  # of single atoms
