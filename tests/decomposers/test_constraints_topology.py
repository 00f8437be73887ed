"""Constraints that a GROMACS run input says: which distances, against the run's own motion; taken without a word, and
not against one."""

import warnings

import MDAnalysis
import numpy as np
import pytest
from MDAnalysisTests import datafiles as D

import atc
from atc.config.scene import Scene
from atc.decomposers import Constraints, HeldPairs, RigidMolecules
from atc.decomposers.constraints.topology import TopologyConstraints
from atc.errors import AtcError, AtcWarning
from atc.readers.gromacs_tpr import constraints_of


def distances(frame, pairs):
    """Vectors between pairs, to the closest image of an orthogonal box."""
    r = frame.positions[pairs[:, 0]] - frame.positions[pairs[:, 1]]
    s = r @ frame.cell.inverse
    return (s - np.round(s)) @ frame.cell.vectors


def along(frame, pairs):
    """The rms relative velocity along pairs, over that in any direction."""
    r, v = distances(frame, pairs), frame.velocities[pairs[:, 0]] - frame.velocities[pairs[:, 1]]
    e = r / np.linalg.norm(r, axis=1)[:, None]
    return np.sqrt(((e * v).sum(1) ** 2).mean() / ((v**2).sum(1) / 3).mean())


@pytest.fixture(scope="module")
def toxin():
    """A protein in water, run by GROMACS with constraints = h-bonds and SETTLE; with velocities."""
    return atc.read(D.H5MD_xvf, topology=D.TPR_xvf)


def test_what_is_held_does_not_move(toxin):
    """Lengths of the distances that are held stay as they are, those of other bonds do not; of water all three sides
    are held."""
    a, b = toxin[0], toxin[-1]
    top = a.topology
    held = top.held.pairs_c2
    assert top.held.source == D.TPR_xvf and not top.held.unknown
    code = lambda p: np.unique(np.sort(p, axis=1) @ [len(a), 1])  # noqa: E731
    other = top.bonds[~np.isin(np.sort(top.bonds, axis=1) @ [len(a), 1], code(held))]
    change = lambda p: np.abs(  # noqa: E731
        np.linalg.norm(distances(a, p), axis=1) - np.linalg.norm(distances(b, p), axis=1)
    )
    # positions of single precision in a box of 60 Å, and LINCS to a part in 10,000
    assert change(held).max() < 1e-3 and np.median(change(other)) > 1e-2
    # nor does it move: velocities along what is held, relative to those across
    share = [along(a, p) for p in (held, other)]
    assert share[0] < 0.1 and share[1] == pytest.approx(1.0, abs=0.2)  # half a step behind the positions
    # and they are every bond of hydrogen, and one distance more of each water
    light = a.masses < 1.5 * a.units.mass
    bonds_of_h = top.bonds[light[top.bonds].any(1)]
    water = int((np.bincount(held.ravel(), minlength=len(a))[light] == 2).sum() / 2)
    assert len(other) == 491 and water > 4000
    assert np.isin(code(bonds_of_h), code(held)).all() and len(held) == len(code(bonds_of_h)) + water


def test_temperature_counts_what_is_held(toxin):
    """Without any potential; the mean over the box by m v² over 3N less the number of constraints."""
    frame = toxin[0]
    grid, kern = atc.Grid.slab("z", bins=2, means=True), None
    ds = atc.fields(frame, None, kern, grid, ["temperature"], velocity="none")
    kinetic = (frame.masses * (frame.velocities**2).sum(1)).sum()
    free = 3 * int((frame.masses > 0).sum()) - len(frame.topology.held.pairs_c2)  # the water has massless sites
    want = kinetic / free / frame.units.boltzmann
    # bins of as many degrees of freedom to a part in 100, whose temperatures differ by as much; the run was at 300 K
    assert want == pytest.approx(300.0, abs=3.0)
    assert float(ds.temperature.mean()) == pytest.approx(frame.units.to_user("temperature", want), rel=1e-3)
    assert f"{len(frame.topology.held.pairs_c2)} distances" in ds.attrs["constraints"]
    assert "cobrotoxin.tpr" in ds.attrs["constraints"]


@pytest.mark.parametrize("file", [D.TPR2024_bonded, D.TPR510_bonded])
def test_both_kinds_of_constraints(file):
    held = constraints_of(file, 14)
    assert held.pairs_c2.tolist() == [[10, 11], [11, 12]] and not held.unknown  # one of each, in the file's topology


def test_water_of_old_files():
    """Which name the oxygen of a SETTLE alone; newer ones of the same system name three atoms."""
    old, new = (constraints_of(f, 2263).pairs_c2 for f in (D.TPR455, D.TPR2024))
    np.testing.assert_array_equal(old, new)
    assert len(new) == 2287


MODEL = "pair_style lj/cut 4.0\npair_coeff * * 0.1 2.0\n" + "".join(
    f"{kind}_style none\n" for kind in ("bond", "angle", "dihedral", "improper")
)
SCENE = """
[trajectory]
file = "run.trr"
topology = "{tpr}"
[potential]
units = "mdanalysis"
lammps = '''
{model}'''
[kernel]
name = "gaussian"
width = 3.0
[grid]
kind = "regular"
shape = [2, 2, 2]
[fields]
quantities = ["stress", "virial_stress"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Fourteen atoms anywhere in a box, of GROMACS's run input with two constraints."""
    folder = tmp_path_factory.mktemp("tpr")
    rng = np.random.default_rng(3)
    u = MDAnalysis.Universe(D.TPR2024_bonded)
    u.load_new(np.zeros((1, 14, 3)))
    sites = np.stack(np.meshgrid(*[np.arange(3)] * 3), -1).reshape(-1, 3)[:14]
    with MDAnalysis.Writer(str(folder / "run.trr"), n_atoms=14) as w:
        ts = u.trajectory.ts
        ts.positions = 3.0 * sites + rng.uniform(-0.3, 0.3, (14, 3))
        ts.velocities, ts.dimensions = rng.normal(size=(14, 3)), [12, 12, 12, 90, 90, 90]
        w.write(u.atoms)
    return folder


def run(folder, more=""):
    """(dataset, warnings) of a scene."""
    (folder / "scene.toml").write_text(SCENE.format(tpr=D.TPR2024_bonded, model=MODEL) + more)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        ds = Scene.load(folder / "scene.toml").run()
    return ds, [str(w.message) for w in seen if issubclass(w.category, AtcWarning) and "distances" in str(w.message)]


def test_they_are_taken_without_a_key(folder):
    """The same numbers as by naming the pairs; and none of them where that is said."""
    ds, said = run(folder)
    assert not said and ds.attrs["constraints"].startswith("2 in 1 molecules (2 distances held by the run input")
    named, said = run(folder, "[constraints]\npairs = [[11, 12], [12, 13]]\nin_forces = false\n")
    assert not said and ds.attrs["constraint_source"] == named.attrs["constraint_source"] == "velocities"
    np.testing.assert_array_equal(ds.virial_stress, named.virial_stress)
    np.testing.assert_array_equal(ds.stress, named.stress)
    none, said = run(folder, "[constraints]\ntopology = false\n")
    assert not said and "constraints" not in none.attrs
    assert np.abs(none.virial_stress - ds.virial_stress).max() > 1e-3 * np.abs(ds.virial_stress).max()


def test_what_they_are_found_from_needs_no_names(folder):
    ds, said = run(folder, "[constraints]\ntimestep = 0.001\nleapfrog = true\n")
    assert not said and ds.attrs["constraint_source"] == "step" and "2 distances" in ds.attrs["constraints"]


def test_what_the_scene_says_wins(folder):
    ds, said = run(folder, "[constraints]\npairs = [[11, 12], [1, 2]]\n")
    assert len(said) == 1 and "\n" not in said[0]
    assert "the run holds 2 distances, of which 1 are not held by" in said[0] and "holds 1 others" in said[0]
    assert "2 pairs of atoms" in ds.attrs["constraints"]
    with pytest.raises(AtcError, match="topology.*bonds, molecules and pairs say it, too"):
        run(folder, "[constraints]\ntopology = true\npairs = [[11, 12]]\n")


def test_where_they_cannot_be_read(folder, monkeypatch):
    """By an MDAnalysis whose parser does not work that way: one line says what to name, once it matters."""
    from MDAnalysis.topology.tpr import utils

    old = utils.do_molblock
    monkeypatch.setattr(utils, "do_molblock", lambda data: old(data)._replace(molb_nmol=1, molb_natoms_mol=13))
    assert "cannot be told by this MDAnalysis" in constraints_of(D.TPR2024_bonded, 14).unknown
    monkeypatch.setattr(utils, "do_molblock", old)
    monkeypatch.setattr("atc.readers.gromacs_tpr._pairs", lambda *_: 1 / 0)
    ds, said = run(folder)
    assert "constraints" not in ds.attrs and len(said) == 1 and "\n" not in said[0]
    assert 'bonds = "hbonds" or "allbonds", or pairs' in said[0]
    assert not run(folder, "[constraints]\npairs = [[11, 12], [12, 13]]\n")[1]
    assert not run(folder, "[constraints]\ntopology = false\n")[1]
    with pytest.raises(AtcError, match="cannot be told by this MDAnalysis"):
        run(folder, "[constraints]\ntimestep = 0.001\n")


def test_in_python(folder):
    """Potentials take them by `settled`; `constrained` says otherwise."""
    frame = atc.read(folder / "run.trr", topology=D.TPR2024_bonded)[0]
    pot = atc.potential(MODEL, units="mdanalysis")
    (rule,) = pot.settled(frame).constraints.rules
    assert isinstance(rule, TopologyConstraints) and pot.decompose(frame).held.count == 2
    assert pot.constrained(None).decompose(frame).held is None
    # A choice of atoms has those between them.
    atoms = MDAnalysis.Universe(D.TPR2024_bonded).load_new(str(folder / "run.trr")).atoms
    assert atc.read(atoms)[0].topology.held.pairs_c2.tolist() == [[10, 11], [11, 12]]
    # Held bonds have no energies, whatever style is given.
    stiff = atc.potential(
        MODEL.replace("bond_style none", "bond_style harmonic\nbond_coeff * 50.0 1.0"), units="mdanalysis"
    )
    kept = stiff.constrained(None).decompose(frame).energy - stiff.decompose(frame).energy
    r = np.linalg.norm(distances(frame, np.array([[10, 11], [11, 12]])), axis=1) / frame.units.length
    assert frame.units.to_user("energy", kept) == pytest.approx(50.0 * ((r - 1.0) ** 2).sum(), rel=1e-9)
    with pytest.raises(AtcError, match="all atoms are needed"):
        rule.pairs(
            frame.replace(
                **{k: getattr(frame, k)[:5] for k in ("positions", "types", "ids", "masses", "velocities", "charges")},
                topology=None,
            )
        )


def test_what_a_reader_assumed_gives_way(folder):
    """Water that OpenMM's readers hold where nobody said so: what the file says, if it has that too."""
    frame = atc.read(folder / "run.trr", topology=D.TPR2024_bonded)[0]
    for ids, assumed, count, warned in (
        (((11, 12),), True, 2, 0),
        (((11, 12),), False, 1, 1),
        (((1, 2), (11, 12), (12, 13)), True, 3, 1),
        (((12, 11), (12, 13)), False, 2, 0),
    ):
        pot = atc.potential(MODEL, units="mdanalysis").constrained(Constraints([HeldPairs(ids, "it")]))
        pot.constraints.assumed = assumed
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            pot = pot.settled(frame)
        assert len(pot.constraints.pairs(frame)) == count and len(seen) == warned
    # A rigid molecule holds all distances in it.
    frame = frame.replace(molecules=np.ones(14, int))
    pot = atc.potential(MODEL, units="mdanalysis").constrained(Constraints([RigidMolecules(style="molecules")]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pot.held_by_topology(frame)


def test_a_frame_that_does_not_say_them(folder):
    """No velocities, no forces: a stress without them is refused, as with any constraints; a density is not."""
    frame = atc.read(folder / "run.trr", topology=D.TPR2024_bonded)[0].replace(velocities=None)
    pot = atc.potential(MODEL, units="mdanalysis")
    kern, grid = atc.kernel("gaussian", width=3.0), atc.Grid.regular(shape=(2, 2, 2))
    with pytest.raises(AtcError, match=r"2 distances held by the run input, .*dummy_2024.tpr\) are part of the stress"):
        atc.fields(frame, pot, kern, grid, ["virial_stress"])
    assert np.isfinite(atc.fields(frame, pot, kern, grid, ["density"]).density).all()
