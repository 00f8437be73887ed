"""What is said of systems of other codes, checked before OpenMM is asked for; these need no OpenMM."""

import sys

import pytest

import atc
from atc.decomposers.openmm import is_openmm
from atc.errors import AtcError


@pytest.mark.parametrize(
    "name, options, words",
    [
        ("x.prmtop", {}, "does not say how the run summed its nonbonded forces: give method, one of NoCutoff"),
        ("x.parm7", {"method": "pme"}, "method PME needs the cutoff"),
        ("x.prmtop", {"method": "P3M"}, "method 'P3M': expected one of NoCutoff, .*LJPME"),
        ("x.psf", {"method": "NoCutoff"}, "a psf needs parameters"),
        ("x.top", {"method": "PME", "cutoff": 8.0, "switch": 9.0}, "switch 9 must be less than the cutoff"),
        ("x.top", {"method": "PME", "cutoff": -1}, "cutoff -1: expected a length"),
        ("x.top", {"method": "NoCutoff", "parameters": "a.prm"}, "parameters goes with a psf file, not with .*x.top"),
        ("x.prmtop", {"method": "NoCutoff", "defines": ["A"]}, "defines goes with a top file"),
        (
            "x.prmtop",
            {"method": "NoCutoff", "constraints": "bonds"},
            "constraints 'bonds': expected one of none, hbonds",
        ),
        ("x.xml", {"cutoff": 9.0}, "cutoff: leave it out: .*x.xml is a whole System"),
        (
            "x.xml",
            {"switching": "shift"},
            "switching 'shift': expected one of potential-switch, force-switch, vfswitch",
        ),
        ("x.xml", {"nonsense": 1}, "nonsense: not known"),
    ],
)
def test_what_is_said_of_a_run(tmp_path, name, options, words):
    (tmp_path / name).write_text("")
    with pytest.raises(AtcError, match=words) as e:
        atc.potential(tmp_path / name, **options)
    assert "\n" not in str(e.value)


def test_without_openmm(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openmm", None)
    (tmp_path / "x.xml").write_text("<System/>")
    with pytest.raises(AtcError, match="x.xml: reading it needs OpenMM: pip install openmm"):
        atc.potential(tmp_path / "x.xml")


def test_which_sources_are_systems(tmp_path):
    assert is_openmm("a.prmtop") and is_openmm(tmp_path / "b.XML") and is_openmm("c.top")
    assert not is_openmm("in.run") and not is_openmm("pair_style sw\npair_coeff * * Si.top Si")
    with pytest.raises(AtcError, match="method goes with systems of OpenMM"):
        atc.potential("pair_style zero 1.0\npair_coeff * *", units="metal", method="PME")
    with pytest.raises(AtcError, match="units, special_bonds and run go with LAMMPS lines"):
        atc.potential("a.prmtop", units="real")


@pytest.mark.parametrize(
    "table, words",
    [
        ({"openmm": "s.xml", "prmtop": "x.prmtop"}, "give openmm or prmtop, not both"),
        ({"openmm": "s.xml", "cutoff": 9.0}, "cutoff.*goes with prmtop, psf, top: a System of OpenMM says it itself"),
        ({"prmtop": "x.prmtop", "parameters": "a.prm"}, "parameters.*goes with psf"),
        ({"prmtop": "x.prmtop", "method": "PPPM"}, "method"),
        ({"top": "x.top", "units": "real"}, "units.*the files of other codes say their units"),
        ({"lammps": "pair_style zero 1.0", "method": "PME"}, "method.*goes with prmtop, psf, top"),
    ],
)
def test_scenes(table, words):
    with pytest.raises(AtcError, match=words) as e:
        atc.Scene.load({"trajectory": {"file": "x.dcd"}, "potential": table})
    assert "\n" not in str(e.value)


def test_a_missing_file_of_a_scene():
    scene = atc.Scene.load({"trajectory": {"file": "x.dcd"}, "potential": {"openmm": "nowhere.xml"}})
    with pytest.raises(AtcError, match=r"\[potential\] .*nowhere.xml: (no such file|reading it needs OpenMM)"):
        scene.potential()
