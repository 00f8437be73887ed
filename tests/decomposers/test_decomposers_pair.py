"""Every pair style against LAMMPS itself: energy, per-atom energies, forces, the full virial; three kinds of boxes,
several types and units."""

import pickle

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps, thermal_lattice

import atc
import atc.decomposers as D
from atc.errors import AtcError
from atc.units import units

# The same arithmetic in another order: sums over ~1e4 terms of both signs. The task asks for 1e-10; what is seen is
# 1e-13.
RTOL = 1e-10

# Edge lengths in lattice spacings: ordinary, tilted, and so small that a cutoff of 2.4 spacings passes half (and once
# all) of an edge.
BOXES = {
    "orthogonal": (np.diag([6.0, 5, 5]), (6, 5, 5)),
    "triclinic": (np.array([[6.0, 0, 0], [2.1, 5, 0], [-1.7, 1.3, 5]]), (6, 5, 5)),
    "small": (np.array([[2.0, 0, 0], [0.6, 3, 0], [0.4, -0.5, 3]]), (2, 3, 3)),
}
# Spacing of the lattice in the unit style's length.
SPACING = {
    "lj": 1.12,
    "metal": 3.3,
    "real": 3.3,
    "electron": 6.2,
    "si": 3.3e-10,
    "nano": 0.33,
    "cgs": 3.3e-8,
    "micro": 3.3e-4,
}


def config(box, style, kinds=3, charges=True, seed=0, jitter=0.14):
    cell, counts = BOXES[box]
    a = SPACING[style]
    x, t = thermal_lattice(cell * a, counts, jitter=jitter, kinds=kinds, seed=seed)
    t[:kinds] = np.arange(1, kinds + 1)
    rng = np.random.default_rng(seed + 1)
    q = (
        rng.uniform(-1, 1, len(x)) * (units(style).to_user("charge", 1.0) if not units(style).reduced else 1.0)
        if charges
        else None
    )
    return Config(cell * a, x, t, units=style, charges=q, ntypes=kinds)


def agree(lines, c, potential=None, threads=1, before=(), rtol=RTOL, energy=True):
    r = run_lammps(lines, c, before=before)
    pot = atc.potential("\n".join([*before, lines]), units=c.units) if potential is None else potential
    f = c.frame()
    d = pot.decompose(f, threads=threads)
    u = f.units
    force = np.abs(r.forces_nc).max()
    scale = np.abs(r.energies_n).sum()
    assert force > 0 and scale > 0
    if energy:
        assert abs(u.to_user("energy", d.energy) - r.energy) <= rtol * scale
        np.testing.assert_allclose(
            u.to_user("energy", d.energies_n), r.energies_n, rtol=0, atol=rtol * np.abs(r.energies_n).max()
        )
    np.testing.assert_allclose(u.to_user("force", d.forces_nc), r.forces_nc, rtol=0, atol=rtol * force)
    np.testing.assert_allclose(
        u.to_user("pressure_volume", d.virial_cc), r.virial, rtol=0, atol=rtol * np.abs(r.virial).max()
    )
    # The streamed sums are those of the bonds that were handed out.
    np.testing.assert_allclose(d.bonds.virial(), d.virial_cc, rtol=0, atol=1e-12 * np.abs(d.virial_cc).max())
    return r, d


# Lines for `metal` or `real`-like lengths in Å, spacing 3.3.
STYLES = {
    "lj/cut": (
        "metal",
        "pair_style lj/cut 7.9\npair_coeff * * 0.01 3.0\npair_coeff 1 2 0.02 2.8 6.5\npair_coeff 3 3 0.015 3.3 7.0",
    ),
    "lj/cut mixed": (
        "real",
        "pair_style lj/cut 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.5\npair_coeff 3 3 0.15 3.3 "
        "7.0\npair_modify shift yes",
    ),
    "lj/cut arithmetic": (
        "metal",
        "pair_style lj/cut 7.9\npair_modify mix arithmetic\npair_coeff 1 1 0.02 3.0\npair_coeff 2 2 0.01 2.8 "
        "6.5\npair_coeff 3 3 0.015 3.3 7.0",
    ),
    "lj/cut sixthpower": (
        "electron",
        "pair_style lj/cut 15\npair_modify mix sixthpower shift yes\npair_coeff 1 1 0.0002 5.6\npair_coeff 2 2 0.0001 "
        "5.2 12.5\npair_coeff 3 3 0.00015 5.9 14",
    ),
    "lj/cut reduced": ("lj", "pair_style lj/cut 2.5\npair_coeff * * 1.0 1.0\npair_coeff 2 3* 0.7 1.05"),
    "lj/cut si": ("si", "pair_style lj/cut 7.9e-10\npair_coeff * * 1.6e-21 3.0e-10"),
    "lj/cut nano": ("nano", "pair_style lj/cut 0.79\npair_coeff * * 1.6 0.3"),
    "lj/smooth/linear": (
        "metal",
        "pair_style lj/smooth/linear 7.9\npair_coeff 1 1 0.02 3.0\npair_coeff 2 2 0.01 2.8 6.5\npair_coeff 3 3 0.015 "
        "3.3 7.0",
    ),
    "lj/expand": (
        "metal",
        "pair_style lj/expand 7.0\npair_coeff 1 1 0.02 2.6 0.3\npair_coeff 2 2 0.01 2.8 0.1 6.4\npair_coeff 3 3 0.015 "
        "3.3 -0.2\npair_modify shift yes mix arithmetic",
    ),
    "morse": (
        "metal",
        "pair_style morse 7.9\npair_coeff * * 0.3 1.4 3.1\npair_coeff 1 2 0.2 1.5 3.0 6.1\npair_modify shift yes",
    ),
    "buck": (
        "metal",
        "pair_style buck 7.9\npair_coeff * * 800.0 0.35 30.0\npair_coeff 1 3 900.0 0.34 25.0 6.4\npair_modify shift "
        "yes",
    ),
    "born": (
        "metal",
        "pair_style born 7.9\npair_coeff * * 0.2 0.32 2.3 20.0 30.0\npair_coeff 2 2 0.3 0.35 2.2 20.0 25.0 "
        "6.4\npair_modify shift yes",
    ),
    "yukawa": (
        "lj",
        "pair_style yukawa 1.7 2.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0\npair_modify "
        "shift yes",
    ),
    "soft": ("lj", "pair_style soft 1.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0"),
    "soft sixthpower": (
        "lj",
        "pair_style soft 1.6\npair_coeff 1 1 10.0\npair_coeff 2 2 8.0 2.2\npair_coeff 3 3 7.0\npair_modify mix "
        "sixthpower",
    ),
    "coul/cut": (
        "real",
        "dielectric 1.7\npair_style coul/cut 7.9\npair_coeff 1 1\npair_coeff 2 2 6.0\npair_coeff 3 3 7.0",
    ),
    "coul/cut electron": ("electron", "pair_style coul/cut 15\npair_coeff * *"),
    "coul/cut lj": ("lj", "pair_style coul/cut 2.6\npair_coeff * *"),
    "coul/dsf": ("metal", "pair_style coul/dsf 0.21 7.9\npair_coeff * *"),
    "coul/wolf": ("real", "pair_style coul/wolf 0.21 7.9\npair_coeff * *"),
    "coul/dsf electron": ("electron", "pair_style coul/dsf 0.1 15\npair_coeff * *"),
    "lj/cut/coul/cut": (
        "real",
        "pair_style lj/cut/coul/cut 6.5 7.9\npair_coeff 1 1 0.2 3.0\npair_coeff 2 2 0.1 2.8 6.0\npair_coeff 3 3 0.15 "
        "3.3 7.0 7.5\npair_modify shift yes",
    ),
    "lj/cut/coul/cut one": ("metal", "pair_style lj/cut/coul/cut 7.9\npair_coeff * * 0.01 3.0"),
    "lj/cut/coul/dsf": (
        "real",
        "pair_style lj/cut/coul/dsf 0.2 6.5 7.9\npair_coeff * * 0.2 3.0\npair_coeff 1 2 0.2 2.9 6.0",
    ),
    "zbl": ("metal", "pair_style zbl 5.0 7.9\npair_coeff 1 1 14 14\npair_coeff 2 2 6 6\npair_coeff 3 3 29.0 29.0"),
    "zbl real": ("real", "pair_style zbl 5.0 7.9\npair_coeff * * 14 14\npair_coeff 1 2 6 14"),
    "zbl electron": ("electron", "pair_style zbl 9.0 15\npair_coeff * * 14 14"),
    "zbl si": ("si", "pair_style zbl 5.0e-10 7.9e-10\npair_coeff * * 14 14"),
    "zbl cgs": ("cgs", "pair_style zbl 5.0e-8 7.9e-8\npair_coeff * * 14 14"),
    "zbl micro": ("micro", "pair_style zbl 5.0e-4 7.9e-4\npair_coeff * * 14 14"),
    "zbl nano": ("nano", "pair_style zbl 0.5 0.79\npair_coeff * * 14 14"),
    "coul/cut si": ("si", "pair_style coul/cut 7.9e-10\npair_coeff * *"),
    "coul/cut cgs": ("cgs", "pair_style coul/cut 7.9e-8\npair_coeff * *"),
    "coul/cut micro": ("micro", "pair_style coul/cut 7.9e-4\npair_coeff * *"),
    "coul/wolf nano": ("nano", "pair_style coul/wolf 2.1 0.79\npair_coeff * *"),
    "hybrid": (
        "metal",
        "pair_style hybrid lj/cut 7.9 morse 7.0 lj/cut 6.0\npair_coeff 1 1 lj/cut 1 0.02 3.0\npair_coeff 2 2 lj/cut 1 "
        "0.01 2.8\n"
        "pair_coeff 1 3 morse 0.2 1.5 3.0\npair_coeff 2 3 none\npair_coeff 3 3 lj/cut 2 0.02 3.1\npair_modify pair "
        "lj/cut 2 shift yes",
    ),
    "hybrid/overlay": (
        "metal",
        "pair_style hybrid/overlay lj/cut 7.9 coul/dsf 0.2 7.0 zbl 3.0 4.0\npair_coeff * * lj/cut 0.02 "
        "3.0\npair_coeff * * coul/dsf\n"
        "pair_coeff 1 2* zbl 14 6\npair_coeff 1 1 zbl 14 14\npair_modify shift yes",
    ),
    "hybrid/overlay self energies of some": (
        "metal",
        "pair_style hybrid/overlay lj/cut 7.9 coul/wolf 0.2 7.0\npair_coeff * * lj/cut 0.02 3.0\npair_coeff 1 1*2 "
        "coul/wolf\npair_coeff 2 2 coul/wolf",
    ),
    "lj/cut/omp": ("metal", "pair_style lj/cut 7.9\npair_coeff * * 0.01 3.0"),
}


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("style", STYLES)
def test_style(style, box):
    unit, lines = STYLES[style]
    agree(lines, config(box, unit, seed=len(style)), threads=2 if box == "triclinic" else 1)


# Tables
# ----------------------------------------------------------------------------------------------------------------------


def table_file(path, *, r=None, spacing="", fprime="", keyword="PAIR", n=200, lo=2.0, hi=8.0, tag="", scale=1.0):
    """An LJ-like table with two other sections around it, the way LAMMPS's tools write them."""
    if spacing:
        t = np.arange(n) / (n - 1)
        grid = lo + (hi - lo) * t if spacing == "R" else np.sqrt(lo**2 + (hi**2 - lo**2) * t)
        param = f"N {n} {spacing} {lo} {hi}"
    else:
        grid = np.geomspace(lo, hi, n) if r is None else r
        grid[-1] = hi
        param = f"N {n}"
    e = scale * 0.04 * ((3.0 / grid) ** 12 - (3.0 / grid) ** 6)
    f = scale * 0.04 * (12 * (3.0 / grid) ** 12 - 6 * (3.0 / grid) ** 6) / grid
    rows = "\n".join(f"{k + 1} {a:.15g} {b:.15g} {c:.15g}" for k, (a, b, c) in enumerate(zip(grid, e, f)))
    other = "\n".join(f"{k + 1} {0.5 * k + 1} {1.0 * k} {-2.0}" for k in range(3))
    path.write_text(
        f"# a table {tag}\n\nFIRST\nN 3\n\n{other}\n\n{keyword}   # the one\n{param}{fprime}\n\n{rows}\n\n# "
        f"more\nLAST\nN 3 R 1.0 2.0\n\n{other}\n"
    )


TABLES = {
    "free spacing": {},
    "R": {"spacing": "R"},
    "RSQ": {"spacing": "RSQ"},
    "FPRIME": {"fprime": " FPRIME -0.3 0.001"},
    "R FPRIME": {"spacing": "R", "fprime": " FPRIME -0.3 0.001"},
}


@pytest.mark.parametrize("style", ["linear 1000", "spline 300", "linear 200"])
@pytest.mark.parametrize("kind", TABLES)
def test_table(tmp_path, monkeypatch, kind, style):
    table_file(tmp_path / "one.table", **TABLES[kind])
    table_file(tmp_path / "two.table", keyword="B", n=50, scale=2.0)
    monkeypatch.chdir(tmp_path)
    # "linear 200" on RSQ with 200 points: LAMMPS then takes the file's values as they are.
    lines = (
        f"pair_style table {style}\npair_coeff * * one.table PAIR\npair_coeff 1 2 two.table B 6.9\npair_coeff 3 3 "
        "one.table PAIR 7.1"
    )
    agree(lines, config("orthogonal" if kind == "R" else "small", "metal", jitter=0.1, charges=False))


def test_table_of_arrays_is_lammpss(tmp_path, monkeypatch):
    table_file(tmp_path / "one.table")
    monkeypatch.chdir(tmp_path)
    from atc.decomposers.pairs.table import read_section

    s = read_section(tmp_path / "one.table", "PAIR")
    pot = atc.potential(D.Table(s.r, s.e, s.f, cutoff=7.3, points=700, units="metal", n_types=3))
    agree(
        "pair_style table spline 700\npair_coeff * * one.table PAIR 7.3",
        config("triclinic", "metal", jitter=0.1, charges=False),
        pot,
    )


def test_table_too_close_is_named(tmp_path, monkeypatch):
    table_file(tmp_path / "one.table", lo=3.2)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AtcError, match=r"smaller than the first distance of their table, 3\.2"):
        atc.potential("pair_style table linear 500\npair_coeff * * one.table PAIR", units="metal").decompose(
            config("small", "metal").frame()
        )


@pytest.mark.parametrize(
    "text, says",
    [
        ("# x\nB\nN 3\n\n1 1 1 1\n", "no section 'PAIR'; it has B"),
        ("PAIR\nN 3\n\n1 1.0 1 1\n2 x 1 1\n3 3 1 1\n", "t:5: .*line 2 of them"),
        ("PAIR\nN 3\n\n1 1.0 1 1\n2 0.5 1 1\n3 3 1 1\n", "increase"),
        ("PAIR\nN 3 BITMAP 1 2\n\n", "BITMAP"),
        # LAMMPS has it in tables of bonds and angles only.
        ("PAIR\nN 3 FP 1 2\n\n1 1.0 1 1\n2 2 1 1\n3 3 1 1\n", r"t:2: .*\[FPRIME <lo> <hi>\], got 'N 3 FP 1 2'"),
        ("PAIR\nN\n\n", "t:2: "),
        ("PAIR\n", "parameter line"),
    ],
)
def test_bad_tables(tmp_path, monkeypatch, text, says):
    (tmp_path / "t").write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AtcError, match=says):
        atc.potential("pair_style table linear 500\npair_coeff * * t PAIR", units="metal")


def test_table_units_tag(tmp_path, monkeypatch):
    """A table that says UNITS: real in a metal model is converted (atc and LAMMPS differ in the digits of kcal/mol:
    1e-6)."""
    table_file(tmp_path / "one.table", tag="UNITS: real", scale=23.060549)
    monkeypatch.chdir(tmp_path)
    agree(
        "pair_style table spline 400\npair_coeff * * one.table PAIR",
        config("small", "metal", jitter=0.1, charges=False),
        rtol=1e-6,
    )


# Objects
# ----------------------------------------------------------------------------------------------------------------------


def test_objects_are_the_lines():
    c = config("triclinic", "real")
    e = np.array([[0.2, 0.1, 0.15], [0.1, 0.3, 0.2], [0.15, 0.2, 0.25]])
    cut = np.array([[7.0, 0, 6.5], [0, 6.0, 6.0], [6.5, 6.0, 7.5]])
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    lines = "pair_style hybrid/overlay lj/cut 7.0\n" + "\n".join(
        f"pair_coeff {i + 1} {j + 1} " + (f"lj/cut {e[i, j]} 3.0 {cut[i, j]}" if cut[i, j] else "none")
        for i, j in pairs
    )
    agree(lines + "\npair_modify shift yes", c, atc.potential([D.LennardJones(e, 3.0, cut, units="real", shift=True)]))
    one = {"units": "real", "n_types": 3}
    for line, coeff, style in (
        ("lj/smooth/linear 7.5", "0.2 3.0", D.LennardJonesSmoothLinear(0.2, 3.0, 7.5, **one)),
        ("lj/expand 7.5", "0.2 3.0 0.2", D.LennardJonesExpand(0.2, 3.0, 0.2, 7.5, **one)),
        ("morse 7.5", "2.0 1.4 3.1", D.Morse(2.0, 1.4, 3.1, 7.5, **one)),
        ("buck 7.5", "8000 0.35 300", D.Buckingham(8000, 0.35, 300, 7.5, **one)),
        ("born 7.5", "2.0 0.32 2.3 200 300", D.Born(2.0, 0.32, 2.3, 200, 300, 7.5, **one)),
        ("yukawa 1.1 7.5", "90", D.Yukawa(90, 1.1, 7.5, **one)),
        ("soft 7.5", "3.0", D.Soft(3.0, 7.5, **one)),
        ("zbl 4.0 7.5", "14 14", D.ZBL([14, 14, 14], 4.0, 7.5, units="real")),
        ("coul/cut 7.5", "", D.CoulombCut(7.5, **one)),
        ("coul/dsf 0.2 7.5", "", D.CoulombDSF(0.2, 7.5, **one)),
        ("coul/wolf 0.2 7.5", "", D.CoulombWolf(0.2, 7.5, **one)),
    ):
        agree(f"pair_style {line}\npair_coeff * * {coeff}", c, atc.potential(style))


def test_quadratic_smoothing_vanishes_at_the_cutoff():
    pot = atc.potential(D.LennardJonesQuadratic(0.0104, 3.4, 8.5, units="metal"))
    A = None
    for d in (3.3, 5.0, 8.499999):
        f = atc.Frame(positions=[[0, 0, 0], [d, 0, 0]], cell=atc.Cell(np.eye(3) * 40.0), units=units("metal"))
        r = pot.decompose(f)
        u = 4 * 0.0104 * ((3.4 / d) ** 12 - (3.4 / d) ** 6)
        du = 4 * 0.0104 * (-12 * (3.4 / d) ** 12 + 6 * (3.4 / d) ** 6) / d
        A = -4 * 0.0104 * (-12 * (3.4 / 8.5) ** 12 + 6 * (3.4 / 8.5) ** 6) / 8.5 / 17.0
        B = -4 * 0.0104 * ((3.4 / 8.5) ** 12 - (3.4 / 8.5) ** 6) - A * 8.5**2
        np.testing.assert_allclose(r.energy, u + A * d * d + B, rtol=0, atol=1e-15)
        np.testing.assert_allclose(r.forces_nc[1, 0], -(du + 2 * A * d), rtol=1e-12, atol=1e-16)
    # 1e-6 inside the cutoff: |U| ~ U'' δ²/2, |F| ~ U'' δ with U'' ~ 1e-2 eV/Å².
    assert abs(r.energy) < 1e-13 and abs(r.forces_nc).max() < 1e-8 and A != 0


def _u(d):
    return 0.04 * ((3.0 / d) ** 12 - (3.0 / d) ** 6)


def _du(d):
    return -0.04 * (12 * (3.0 / d) ** 12 - 6 * (3.0 / d) ** 6) / d


def test_generic():
    c = config("small", "real")
    agree(
        "pair_style lj/cut 7.5\npair_coeff * * 0.01 3.0",
        c,
        atc.potential(D.Generic(_u, _du, 7.5, units="real", n_types=3)),
    )
    only = atc.potential([D.Generic(_u, _du, 7.5, units="real", types=[(1, 2), (3, 3)])])
    none = "\n".join(f"pair_coeff {p} none" for p in ("1 1", "2 2", "1 3", "2 3"))
    agree(
        f"pair_style hybrid lj/cut 7.5\npair_coeff 1 2 lj/cut 0.01 3.0\npair_coeff 3 3 lj/cut 0.01 3.0\n{none}", c, only
    )
    with pytest.raises(AtcError, match="derivative is not that of the energy"):
        D.Generic(_u, lambda d: 0.04 * (12 * (3.0 / d) ** 12 - 6 * (3.0 / d) ** 6) / d, 7.5, units="real")
    with pytest.raises(AtcError, match="undefined"):
        D.Generic(lambda d: undefined(d), _du, 7.5, units="real")  # noqa: F821


def test_potentials_can_be_sent_to_other_processes():
    c = config("small", "metal")
    f = c.frame()
    for p in (
        atc.potential(STYLES["hybrid/overlay"][1], units="metal"),
        atc.potential("pair_style lj/cut 7.9\npair_coeff * * 0.01 3.0\nspecial_bonds lj/coul 0 1 1", units="metal"),
        atc.potential(D.Morse(2.0, 1.4, 3.1, 7.5, units="metal", n_types=3)),
        atc.potential(D.Generic(_u, _du, 7.5, units="real", n_types=3)),
    ):
        q = pickle.loads(pickle.dumps(p))
        assert q.decompose(f).energy == p.decompose(f).energy


def test_frames_in_other_units():
    """A model in real units on a frame that came in metal units: the same physics."""
    lines = "pair_style lj/cut 7.9\npair_coeff * * {} 3.0"
    f = config("small", "metal").frame()
    kcal = units("real").to_internal("energy", 1.0)
    a = atc.potential(lines.format(0.2), units="real").decompose(f)
    b = atc.potential(lines.format(repr(0.2 * kcal)), units="metal").decompose(f)
    np.testing.assert_allclose(a.forces_nc, b.forces_nc, rtol=1e-13, atol=1e-15)
    with pytest.raises(AtcError, match="lj"):
        atc.potential("pair_style lj/cut 2.5\npair_coeff * * 1 1", units="lj").decompose(f)


def test_what_a_frame_may_lack():
    c = config("small", "metal", charges=False)
    with pytest.raises(AtcError, match="charges are missing"):
        atc.potential("pair_style coul/cut 5\npair_coeff * *", units="metal").decompose(c.frame())
    two = atc.potential("pair_style lj/cut 5\npair_coeff 1*2 1*2 1 3", units="metal")
    with pytest.raises(AtcError, match="type 3"):
        two.decompose(c.frame())
    f = c.frame()
    f.positions[1] = f.positions[0]
    with pytest.raises(AtcError, match="atoms 1 and 2 are at the same place"):
        atc.potential("pair_style lj/cut 5\npair_coeff * * 1 3", units="metal").decompose(f)


def test_soft_lets_atoms_coincide():
    f = atc.Frame(positions=[[1.0, 1, 1], [1, 1, 1]], cell=atc.Cell(np.eye(3) * 9.0), units=units("lj"))
    d = atc.potential("pair_style soft 2\npair_coeff * * 3", units="lj").decompose(f)
    assert d.energy == 6.0 and not d.forces_nc.any()


def test_threads_and_chunks_do_not_matter():
    x, t = thermal_lattice(np.diag([60.0, 60, 60]), (18, 18, 18), jitter=0.1, kinds=2)
    f = Config([60.0, 60, 60], x, t).frame()
    pot = atc.potential("pair_style lj/cut 7.0\npair_coeff * * 0.01 3.0\npair_coeff 1 2 0.02 3.0 5.0", units="metal")
    a, b = pot.decompose(f), pot.decompose(f, threads=3)
    assert a.n_bonds == b.n_bonds
    np.testing.assert_allclose(a.forces_nc, b.forces_nc, rtol=0, atol=1e-13 * np.abs(a.forces_nc).max())
    # Pairs beyond their own cutoff carry no force and are not handed out.
    assert (a.bonds.G_b != 0).all()


# Stillinger-Weber inside hybrid
# -----------------------------------------------------------------------------------------------------------

SI_SW = "Si Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"


@pytest.mark.parametrize("overlay", ["", "/overlay"])
@pytest.mark.parametrize("box", BOXES)
def test_sw_in_hybrid(tmp_path, monkeypatch, box, overlay):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Si.sw").write_text(SI_SW)
    lines = (
        f"pair_style hybrid{overlay} sw lj/cut 6.0 morse 5.0\npair_coeff * * sw Si.sw Si NULL Si\npair_coeff 2 2 "
        "lj/cut 0.01 3.0\n"
        "pair_coeff 1 2 morse 0.2 1.5 3.0\npair_coeff 2 3 lj/cut 0.02 2.9"
    )
    c = config(box, "metal", jitter=0.1)
    c.positions *= 0.8
    c.cell *= 0.8
    agree(lines, c, threads=2)


def test_hybrid_takes_no_pair_out_of_sw(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Si.sw").write_text(SI_SW)
    for elements, pair in (("Si Si", "1 2"), ("Si", "1 1"), ("Si NULL", "* *")):
        lines = (
            f"pair_style hybrid sw lj/cut 6.0\npair_coeff * * sw Si.sw {elements}\npair_coeff {pair} lj/cut 0.01 3.0"
        )
        with pytest.raises(AtcError, match="all pairs of the types that it maps"):
            atc.potential(lines, units="metal")


def test_sw_with_bonds_wants_plain_weights(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Si.sw").write_text(SI_SW)
    c = config("small", "metal", kinds=1, charges=False)
    f = Config(c.cell, c.positions, bonds=[[0, 1]], units="metal").frame()
    with pytest.raises(AtcError, match="many-body"):
        atc.potential("pair_style sw\npair_coeff * * Si.sw Si", units="metal").decompose(f)
    atc.potential("pair_style sw\npair_coeff * * Si.sw Si\nspecial_bonds lj/coul 1 1 1", units="metal").decompose(f)
