"""What every many-body style must stand: no atoms, one atom, types left out, atoms at one place, small boxes, threads,
other processes."""

import pickle

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential
from many_body_systems import DIAMOND, FCC, POTENTIALS, crystal, lines_of

import atc
from atc.frame import Cell, Frame
from atc.units import units

#: lines for types 1 and 2, lattice constant, basis
STYLES = {
    "tersoff/mod": (lines_of("tersoff/mod", "Si.tersoff.mod", "Si {}"), 5.3, DIAMOND),
    "tersoff/zbl": (lines_of("tersoff/zbl", "SiC.tersoff.zbl", "Si {}"), 4.6, DIAMOND),
    "gw": (lines_of("gw", "SiC.gw", "Si {}"), 4.6, DIAMOND),
    "sw/mod": (lines_of("sw/mod maxdelta 0.2 0.3", "tmd.sw.mod", "Mo {}"), 5.0, DIAMOND),
    "vashishta": (lines_of("vashishta", "SiC.vashishta", "Si {}"), 4.6, DIAMOND),
    "vashishta/table": (lines_of("vashishta/table 1000 0.5", "SiC.vashishta", "Si {}"), 4.6, DIAMOND),
    "nb3b/screened": (lines_of("nb3b/screened", "PSiO.nb3b.screened", "O {}"), 5.0, DIAMOND),
    "edip/multi": (lines_of("edip/multi", "SiC.edip", "Si {}"), 4.8, DIAMOND),
    "eam/he": (lines_of("eam/he", "PdHHe.eam.he", "Pd {}"), 3.9, FCC),
    "eam/cd": (lines_of("eam/cd", "FeCr.cdeam", "Fe {}"), 3.4, FCC),
    "adp": (lines_of("adp", "AlCu.adp", "Al {}"), 4.0, FCC),
    "meam": (
        f"pair_style meam\npair_coeff * * {POTENTIALS}/library.meam Si C {POTENTIALS}/SiC.meam Si {{}}",
        4.6,
        DIAMOND,
    ),
    "polymorphic": (lines_of("polymorphic", "GaN_tersoff.poly", "Ga {}"), 4.6, DIAMOND),
    "eim": (f"pair_style eim\npair_coeff * * Na Cl {POTENTIALS}/ffield.eim Na {{}}", 5.8, DIAMOND),
    "meam/sw/spline": (lines_of("meam/sw/spline", "Si.b.meam.sw.spline", "Si {}"), 5.3, DIAMOND),
}
SECOND = {
    "polymorphic": "N",
    "tersoff/mod": "Si",
    "sw/mod": "S",
    "nb3b/screened": "Si",
    "eam/he": "H",
    "adp": "Cu",
    "eam/cd": "Cr",
    "eim": "Cl",
    "meam/sw/spline": "Si",
}


def two(name) -> str:
    return STYLES[name][0].format(SECOND.get(name, "C"))


# The published nb3b files have nothing between atoms of one element.
@pytest.mark.parametrize("name", [n for n in STYLES if n != "nb3b/screened"])
def test_nearly_nothing(name):
    """No atoms; one atom; two far apart; one that is left out. At one place: refused in one line."""
    pot = atc.potential(STYLES[name][0].format("NULL"), units="metal")
    for x, types in (
        ([], []),
        ([[1.0, 2, 3]], [1]),
        ([[1.0, 2, 3], [15.0, 2, 3]], [1, 1]),
        ([[1.0, 2, 3], [2.5, 2, 3]], [1, 2]),
    ):
        for periodic in (True, False):
            cell = Cell(np.eye(3) * 30, periodic=(periodic,) * 3)
            frame = Frame(np.reshape(x, (-1, 3)), cell, units("metal"), types=np.array(types, int))
            d = pot.decompose(frame, sources=True, threads=2)
            # Some potentials give an atom alone an energy.
            assert np.isfinite(d.energy) and d.n_bonds == 0 and not d.forces_nc.any()
    frame = Frame(np.zeros((2, 3)), Cell(np.eye(3) * 30), units("metal"))
    with pytest.raises(atc.AtcError, match="atoms 1 and 2 are at the same place") as e:
        pot.decompose(frame)
    assert "\n" not in str(e.value)
    with pytest.raises(atc.AtcError, match="type"):
        pot.decompose(Frame(np.zeros((1, 3)), Cell(np.eye(3) * 30), units("metal"), types=[3]))


@pytest.mark.parametrize("name", STYLES)
def test_small_box_threads_and_other_processes(name):
    """A box smaller than the cutoff, so that atoms meet their own images: LAMMPS; one and three threads; the same after
    a pickle."""
    _, a, basis = STYLES[name]
    config = crystal(a, n=(1, 1, 1), kinds=2, basis=basis, jitter=0.15, seed=1)
    lines = two(name).replace(" maxdelta 0.2 0.3", "")
    agrees_with_lammps(potential(lines, config), lines, config)
    frame = crystal(a, n=(3, 3, 4), kinds=2, basis=basis, jitter=0.15).frame()
    pot = atc.potential(two(name), units="metal")
    one, three = pot.decompose(frame, sources=True), pot.decompose(frame, threads=3, sources=True)
    other = pickle.loads(pickle.dumps(pot)).decompose(frame)
    size = np.abs(one.forces_nc).max()
    consistent_bonds(three, len(frame), 3)
    for d in (three, other):
        assert d.energy == pytest.approx(one.energy, rel=1e-13, abs=1e-13 * np.abs(one.energies_n).sum())
        np.testing.assert_allclose(d.forces_nc, one.forces_nc, rtol=0, atol=1e-11 * size)
    assert np.abs(one.bonds.D_bdc.sum(axis=0)).max() == pytest.approx(
        np.abs(three.bonds.D_bdc.sum(axis=0)).max(), abs=1e-9 * np.abs(one.bonds.D_bdc).sum()
    )


@pytest.mark.parametrize("name", STYLES)
def test_moved_turned_and_mirrored(name):
    """The energy does not change, the forces turn along."""
    _, a, basis = STYLES[name]
    x = crystal(a, n=(2, 1, 1), kinds=1, basis=basis, jitter=0.2).positions
    types = np.arange(len(x)) % 2 + 1
    cell = Cell(np.eye(3) * 60, np.full(3, -30.0), periodic=(False,) * 3)
    pot = atc.potential(two(name), units="metal")
    R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    R *= -np.sign(np.linalg.det(R))  # a reflection
    one = pot.decompose(Frame(x, cell, units("metal"), types=types))
    two_ = pot.decompose(Frame(x @ R.T + np.array([1.0, -2.0, 0.5]), cell, units("metal"), types=types))
    assert two_.energy == pytest.approx(one.energy, rel=1e-11, abs=1e-11 * np.abs(one.energies_n).sum())
    np.testing.assert_allclose(two_.forces_nc, one.forces_nc @ R.T, rtol=0, atol=1e-9 * np.abs(one.forces_nc).max())


FILES = {
    "tersoff/mod": "Si.tersoff.mod",
    "tersoff/zbl": "SiC.tersoff.zbl",
    "gw": "SiC.gw",
    "sw/mod": "tmd.sw.mod",
    "vashishta": "SiC.vashishta",
    "nb3b/screened": "PSiO.nb3b.screened",
    "edip/multi": "SiC.edip",
    "meam": "SiC.meam",
    "eim": "ffield.eim",
    "meam/sw/spline": "Si.b.meam.sw.spline",
}
JUNK = (
    "x",
    "-1",
    "0",
    "1e400",
    "nan",
    "-inf",
    "é",
    "1e308",
    "99999999999999999999",
    "=",
    "(1,2)",
    "&",
    "NULL",
    "'",
    "-5",
)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FILES)
def test_damage_anywhere(tmp_path, name):
    """Words replaced, lines lost or doubled, files cut off: one line of this package's own error, or a potential with a
    finite cutoff; nothing else."""
    rng = np.random.default_rng(len(name))
    text = (POTENTIALS / FILES[name]).read_text()
    path = tmp_path / FILES[name]
    lines = two(name).replace(str(POTENTIALS / FILES[name]), str(path))
    assert str(path) in lines
    for _ in range(40):
        rows = text.splitlines()
        k = int(rng.integers(len(rows)))
        kind = int(rng.integers(4))
        if kind == 0:
            rows = rows[:k]
        elif kind == 1:
            rows.insert(k, rows[int(rng.integers(len(rows)))])
        else:
            words = rows[k].split(" ")
            words[int(rng.integers(len(words)))] = JUNK[int(rng.integers(len(JUNK)))]
            rows[k] = " ".join(words)
        path.write_text("\n".join(rows) + "\n")
        try:
            assert np.isfinite(atc.potential(lines, units="metal").cutoff)
        except atc.AtcError as e:
            assert "\n" not in str(e)
