"""LAMMPS input scripts: what atc reads from a script is what LAMMPS runs from it; what it cannot know is a one-line
error with file and line."""

import numpy as np
import pytest
from lammps_oracle import Config, lammps_session, run_lammps, thermal_lattice

import atc
from atc.decomposers.lammps.script import split_words
from atc.decomposers.lammps.variables import Unknown, Variables
from atc.errors import AtcError, AtcWarning

FORMULAS = [
    "1+2*3",
    "-2^2",
    "2^-1",
    "2^3^2",
    "8/4/2",
    "8-4-2",
    "-3+5",
    "2*-3",
    "!0+1",
    "!(1>2)",
    "1<2==1",
    "1||0&&0",
    "1|^1",
    "3%2+7.5%2",
    "sqrt(2)*PI",
    "exp(-1.5)+ln(3)+log(1000)",
    "abs(-2.5)-sign(-3)",
    "sin(1)*cos(2)+tan(0.3)",
    "asin(0.3)+acos(0.2)+atan(2)+atan2(1,-2)",
    "ceil(1.2)+floor(-1.2)+round(2.5)+round(-0.5)",
    "ternary(2>1,3,4)",
    "1e-3*2.5E2+.5",
    "(v_a+v_b)*2",
    "v_s*3",
    "v_a >= 2.5 && v_b != 1",
    "v_w[2]^2-v_w[1]*v_w[3]",
]


def test_arithmetic_is_lammpss():
    define = [
        "variable a equal 2.5",
        "variable b equal v_a^2-1",
        "variable s string 1.25",
        "variable w vector [0.5,-7.25,1e2]",
    ]
    mine = Variables()
    with lammps_session() as lmp:
        for line in define:
            lmp.command(line)
            mine.define(split_words(line, "test")[1:])
        for k, f in enumerate(FORMULAS):
            lmp.command(f"variable f{k} equal '{f}'")
            expected = lmp.extract_variable(f"f{k}")
            assert mine.evaluate(f) == pytest.approx(expected, rel=1e-15, abs=0), f


def test_substitution_is_lammpss():
    define = [
        "variable a equal 1/3",
        "variable n index 7 8 9",
        "variable name string 'two words'",
        "variable b equal ${a}*3",
        "variable c equal v_a*3",
        "variable n index 100",
        "variable s string here",
        "variable s string there",
        "variable f format a %6.3f",
    ]
    lines = [
        "print ${n}$n$(v_a*3:%.3f)",
        "print $(1/3)",
        "print ${a}",
        "print $b",
        "print ${c}_$c",
        "print ${s}",
        "print $(round(2.6):%.1e)",
        "print $((1+2)*(3+4))",
    ]
    mine = Variables()
    for line in define[:-1]:
        mine.define(split_words(mine.substitute(line), "test")[1:])
    with lammps_session() as lmp:
        for line in define:
            lmp.command(line)
        for line in lines:
            what = line.split(" ", 1)[1]
            lmp.command(f"variable out string {what}")
            assert mine.substitute(what) == lmp.extract_variable("out"), line
            lmp.command("variable out delete")


@pytest.mark.parametrize(
    "formula",
    [
        "1+",
        "pe*2",
        "c_1",
        "v_missing",
        "1 2",
        "sqrt(-1)",
        "1/0",
        "sqrt(1,2)",
        "f(1)",
        "(1",
        "v_loop",
        "v_w",
        "v_w[0]",
        "v_w[4]",
        "v_w[1",
        "v_loop[1]",
        "v_c[1]",
        "2 ? 3",
        "random(1,2,3)",
    ],
)
def test_what_cannot_be_evaluated(formula):
    v = Variables()
    v.define(["loop", "equal", "v_loop+1"])
    v.define(["w", "vector", "[1,2,3]"])
    v.define(["c", "vector", "c_pressure"])
    with pytest.raises(Unknown):
        v.evaluate(formula)


SCRIPT = """# everything that a script may hold
units metal
variable rc index 7.5
variable rc index 99.0
variable eps equal 0.01*2^1 # comment with a $dollar
variable sig equal "sqrt(9.0) + v_shift"
variable shift equal 0.1
variable pe equal pe      # known to LAMMPS only: never needed
variable file string 'more lines.txt'
boundary p p p
atom_style charge
read_data conf.data
pair_style hybrid/overlay &
    lj/cut ${rc} &
    coul/dsf $(0.1*2) 7.0
include "more lines.txt"
pair_modify pair lj/cut shift yes mix arithmetic
if "${rc} > 3" then "print 'large'" else "print small"
label loop
variable k loop 3
print "$k"
next k
jump SELF loop
neighbor 1.0 bin
run 0 post no
pair_coeff 1 1 lj/cut 9.9 9.9
clear
units metal
atom_style charge
read_data conf.data
pair_style hybrid/overlay lj/cut ${rc} coul/dsf $(0.1*2) 7.0
include "more lines.txt"
pair_modify pair lj/cut shift yes mix arithmetic
run 0 post no
"""
MORE = "pair_coeff 1 1 lj/cut ${eps} ${sig}\npair_coeff 2*3 2*3 lj/cut $(v_eps/2) 2.9 6.0\npair_coeff * * coul/dsf\n"


def test_script_is_what_lammps_runs(tmp_path, monkeypatch):
    x, t = thermal_lattice(np.array([[13.2, 0, 0], [3, 13.2, 0], [1, -2, 13.2]]), (4, 4, 4), kinds=3, seed=2)
    c = Config(
        np.array([[13.2, 0, 0], [3, 13.2, 0], [1, -2, 13.2]]),
        x,
        t,
        charges=np.random.default_rng(0).uniform(-1, 1, len(x)),
        ntypes=3,
    )
    c.write_data(tmp_path / "conf.data")
    (tmp_path / "in.model").write_text(SCRIPT)
    (tmp_path / "more lines.txt").write_text(MORE)
    pot = atc.potential(str(tmp_path / "in.model"))
    monkeypatch.chdir(tmp_path)
    with lammps_session() as lmp:
        lmp.file("in.model")
        energy = lmp.get_thermo("pe")
        ids = np.array(lmp.numpy.extract_atom("id")[: len(x)])
        forces = np.array(lmp.numpy.extract_atom("f")[: len(x)])[np.argsort(ids)]
    d = pot.decompose(c.frame())
    np.testing.assert_allclose(d.energy, energy, rtol=1e-12)
    np.testing.assert_allclose(d.forces_nc, forces, rtol=0, atol=1e-12 * np.abs(forces).max())
    assert (
        pot.units.name == "metal" and pot.data_file == tmp_path / "conf.data" and pot.masses == {1: 1.0, 2: 1.0, 3: 1.0}
    )


def test_coefficients_from_the_data_file(tmp_path, monkeypatch):
    x, t = thermal_lattice(np.diag([5.5] * 3), (5, 5, 5), kinds=3, seed=2)
    t[:3] = 1, 2, 3
    bonds = np.array([[k, k + 1] for k in range(0, 120, 3)])
    c = Config([5.5] * 3, x, t, units="lj", bonds=bonds, bond_types=1 + np.arange(len(bonds)) % 2, ntypes=3)
    c.write_data(tmp_path / "conf.data")
    text = (tmp_path / "conf.data").read_text()
    sections = (
        "\nAtom Type Labels\n\n1 A\n2 B\n3 C\n\nPair Coeffs # lj/cut\n\n1 1.0 1.0\n2 0.7 1.1\n3 0.9 0.9 2.2\n\nBond "
        "Coeffs\n\n1 30.0 1.1 # comment\n2 20.0 1.2\n"
    )
    head, body = text.split("Masses")
    (tmp_path / "conf.data").write_text(head + sections.lstrip("\n") + "\nMasses" + body)
    monkeypatch.chdir(tmp_path)
    script = (
        "units lj\natom_style bond\npair_style lj/cut 2.5\nbond_style harmonic\nspecial_bonds fene\nread_data "
        "conf.data\n"
        "pair_coeff A C 0.5 1.0\nbond_coeff 2 25.0 1.2\n"
    )
    (tmp_path / "in.script").write_text(script)
    with lammps_session() as lmp:
        lmp.file("in.script")
        lmp.command("thermo_modify norm no")
        lmp.command("run 0 post no")
        energy = lmp.get_thermo("pe")
    pot = atc.potential("in.script")
    assert pot.decompose(c.frame()).energy == pytest.approx(energy, rel=1e-12)
    # PairIJ Coeffs likewise, and nothing at all where the script says nocoeff.
    ij = "PairIJ Coeffs\n\n1 1 1.0 1.0\n1 2 1.0 1.1\n1 3 0.4 1\n2 2 .5 1\n2 3 1 1\n3 3 1 1\n"
    (tmp_path / "conf.data").write_text(head + ij + "\nBond Coeffs\n\n1 30.0 1.1\n2 20.0 1.2\n\nMasses" + body)
    (tmp_path / "in.script").write_text(script.split("pair_coeff")[0])
    with lammps_session() as lmp:
        lmp.file("in.script")
        lmp.command("thermo_modify norm no")
        lmp.command("run 0 post no")
        energy = lmp.get_thermo("pe")
    assert atc.potential("in.script").decompose(c.frame()).energy == pytest.approx(energy, rel=1e-12)
    (tmp_path / "in.script").write_text(script.split("pair_coeff")[0].replace("conf.data", "conf.data nocoeff"))
    with pytest.raises(AtcError, match="no pair_coeff"):
        atc.potential("in.script")


def test_labels():
    c = Config(
        [9.0] * 3,
        *thermal_lattice(np.diag([9.0] * 3), (3, 3, 3), kinds=2),
    )
    lines = (
        "labelmap atom 1 Ar 2 Kr\npair_style lj/cut 4.0\npair_coeff Ar Ar 0.01 3.0\npair_coeff Kr Kr 0.02 "
        "3.1\npair_coeff Kr Ar 0.03 3.0"
    )
    r = run_lammps(lines, c)
    assert atc.potential(lines, units="metal").decompose(c.frame()).energy == pytest.approx(r.energy, rel=1e-12)


def test_reversed_types_and_same_line_twice():
    """LAMMPS turns `pair_coeff 2 1` around; later lines override."""
    c = Config([9.0] * 3, *thermal_lattice(np.diag([9.0] * 3), (3, 3, 3), kinds=2))
    lines = (
        "pair_style lj/cut 4.0\npair_coeff * * 0.01 3.0\npair_coeff 2 1 0.03 3.0\npair_coeff *2 2* 0.02 "
        "2.9\npair_coeff 1 1 0.02 2.9 3.8"
    )
    r = run_lammps(lines, c)
    assert atc.potential(lines, units="metal").decompose(c.frame()).energy == pytest.approx(r.energy, rel=1e-12)


def test_pair_modify_holds_for_the_same_style_said_again():
    c = Config([9.0] * 3, *thermal_lattice(np.diag([9.0] * 3), (3, 3, 3), kinds=2))
    for lines in (
        "pair_style lj/cut 3.0\npair_modify shift yes\npair_style lj/cut 4.0\npair_coeff * * 0.02 2.9",
        "pair_style lj/cut 3.0\npair_modify shift yes\npair_style morse 4.0\npair_coeff * * 0.02 1.0 2.9",
        "pair_style lj/cut 3.0\npair_modify shift yes\npair_style morse 4.0\npair_style lj/cut 4.0\npair_coeff * * "
        "0.02 2.9",
    ):
        r = run_lammps(lines, c)
        assert atc.potential(lines, units="metal").decompose(c.frame()).energy == pytest.approx(r.energy, rel=1e-12), (
            lines
        )


def test_scripts_that_ship(tmp_path):
    from pathlib import Path

    data = Path(__file__).resolve().parents[2] / "data"
    for name, described in (("argon_slab", "lj/cut"), ("melt", "fene"), ("silicon_plate", "sw")):
        pot = atc.potential(str(data / name / f"in.{name}"))
        assert described in pot.describe()


def test_data_file_that_is_missing_matters_only_if_needed(tmp_path):
    (tmp_path / "in.a").write_text("units lj\npair_style lj/cut 2.5\nread_data gone.data\n")
    with pytest.raises(AtcError, match=r"line 2.*gone\.data that may hold them is not there"):
        atc.potential(tmp_path / "in.a")
    (tmp_path / "in.b").write_text(
        "units lj\npair_style lj/cut 2.5\nread_data gone.data\npair_coeff * * 1 1\nmass * 2.0\n"
    )
    pot = atc.potential(tmp_path / "in.b")
    assert pot.data_file == tmp_path / "gone.data" and pot.masses == {1: 2.0}


LJ = "pair_style lj/cut 5\npair_coeff 1 1 1 1\n"
BAD = {
    "unsupported style": (
        "units metal\npair_style reaxff NULL\npair_coeff * * ffield C",
        "line 2.*reaxff is not supported: it finds its charges",
    ),
    "long range": (f"units metal\n{LJ}kspace_style msm 1e-4", "line 4.*kspace_style msm"),
    "long-range pair style": (
        "units real\npair_style lj/cut/coul/msm 9\npair_coeff * * 1 1",
        "lj/cut/coul/msm is not supported",
    ),
    "units missing": (LJ, "add a 'units' line"),
    "units unknown": (f"units imperial\n{LJ}", "line 1.*imperial"),
    "units twice": (f"units metal\nunits real\n{LJ}", "line 2.*more than once"),
    "wrong number": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 one 1", "line 3.*epsilon.*'one'"),
    "too few": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 1", r"line 3.*takes epsilon sigma \[cutoff\]"),
    "too many": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 1 1 1 1", r"line 3.*takes epsilon sigma \[cutoff\]"),
    "not finite": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 nan 1", "line 3.*finite"),
    "negative cutoff": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 1 1 -2", "line 3.*negative"),
    "zero cutoff": ("units lj\npair_style coul/dsf 0.2 0\npair_coeff * *", "line 2.*positive"),
    "too many types": ("units lj\npair_style lj/cut 2.5\npair_coeff 100000 1 1 1", "line 3.*type 100000 is beyond"),
    "infinite formula": ("units lj\npair_style lj/cut 2.5\npair_coeff 1 1 $(1/0) 1", "line 3.*1/0"),
    "no cutoff": ("units lj\npair_style lj/cut\npair_coeff 1 1 1 1", "line 2.*takes cutoff"),
    "coefficient first": ("units lj\npair_coeff 1 1 1 1", "line 2.*before any pair_style"),
    "missing pair": (
        "units lj\npair_style morse 2.5\npair_coeff 1 1 1 1 1\npair_coeff 2 2 1 1 1",
        "types 1 and 2.*pair_coeff 1 2",
    ),
    "missing type": ("units lj\npair_style lj/cut 2.5\npair_coeff 2 2 1 1", "types 1 and 1"),
    "no mean": (
        "units lj\npair_style lj/cut 2.5\npair_coeff 1 1 1 1\npair_coeff 2 2 -1 1",
        "types 1 and 2 have no geometric mean",
    ),
    "no sixth-power mean": (
        "units lj\npair_style lj/cut 2.5\npair_modify mix sixthpower\npair_coeff 1 1 1 0\npair_coeff 2 2 1 0",
        "types 1 and 2 have no sixthpower mean",
    ),
    "no such type": ("units lj\npair_style lj/cut 2.5\npair_coeff 0 1 1 1", "line 3.*'0'"),
    "backward range": ("units lj\npair_style lj/cut 2.5\npair_coeff 3*2 1 1 1", "3\\*2"),
    "unknown label": ("units lj\npair_style lj/cut 2.5\npair_coeff Ar Ar 1 1", "'Ar'"),
    "unknown variable": ("units lj\npair_style lj/cut ${rc}\npair_coeff 1 1 1 1", "line 2.*rc is not defined"),
    "variable of the run": (
        "units lj\nvariable rc equal temp\npair_style lj/cut ${rc}\npair_coeff 1 1 1 1",
        "line 3.*'temp' is only known",
    ),
    "world variable": (
        "units lj\nvariable i world 3 4\npair_style lj/cut $i\npair_coeff 1 1 1 1",
        "line 3.*variable i is of style world",
    ),
    "environment": (
        "units lj\nvariable i getenv RC\npair_style lj/cut $i\npair_coeff 1 1 1 1",
        "line 3.*environment of the run",
    ),
    "stepped too far": (
        "units lj\nvariable i index 3\nnext i\npair_style lj/cut $i\npair_coeff 1 1 1 1",
        "line 4.*i is not defined",
    ),
    "loop over the model": (
        "units lj\nlabel a\npair_style lj/cut 2\npair_coeff 1 1 1 1\njump SELF a",
        "loop without end",
    ),
    "skipped model": (
        "units lj\njump SELF a\npair_style lj/cut 2\nlabel a\npair_coeff 1 1 1 1",
        "line 5.*before any pair_style",
    ),
    "unknown condition": (
        'units lj\npair_style lj/cut 2\nvariable t equal temp\nif "${t} > 2" then "pair_coeff 1 1 1 1"',
        "line 4.*pair_coeff.*condition.*'temp'",
    ),
    "unknown jump": (
        'units lj\nvariable t equal temp\nif "${t} > 2" then "jump SELF a"\npair_style lj/cut 2\npair_coeff 1 1 1 '
        "1\nlabel a",
        "line 3.*skips 'pair_style' .*line 4",
    ),
    "no label": (f"units lj\n{LJ}jump SELF a", "line 4.*label a"),
    "jump elsewhere": (f"units lj\n{LJ}jump other.in", "line 4.*another file"),
    "corotate": (
        f"units lj\n{LJ}fix 1 all filter/corotate b 1",
        "line 4: fix filter/corotate filters the fast motion.*part of the stress",
    ),
    "joints": (
        f"units lj\n{LJ}fix 1 all poems molecule",
        "line 4: fix poems moves atoms as rigid bodies that are joined",
    ),
    "shake": (f"units lj\n{LJ}fix 1 all shake 1e-4 20 0 1 1", "line 4: fix shake: expected b, a, t or m before '1'"),
    "shake mass": (f"units lj\n{LJ}fix 1 all shake 1e-4 20 0 m H", "line 4: fix shake: expected a mass, got 'H'"),
    "rigid": (
        f"units lj\n{LJ}fix 1 all rigid/nvt/omp custom i_body temp 1 1 1",
        "line 4: fix rigid/nvt custom: which atoms are a body is not known",
    ),
    "rigid torque": (
        f"units lj\n{LJ}fix 1 all rigid single torque * off off off",
        "line 4: fix rigid torque is not supported",
    ),
    "unknown fix": (f"units lj\n{LJ}fix 1 all magic 3", "line 4: fix magic is no fix of LAMMPS"),
    "restrain": (f"units lj\n{LJ}fix 1 all restrain bond 1 2 3 4 5", "line 4: fix restrain adds forces between atoms"),
    "spring": (f"units lj\n{LJ}fix 1 all spring couple b 100 0 0 0 0", "line 4: fix spring couples two groups"),
    "restart": (
        "units lj\npair_style lj/cut 2.5\npair_coeff 1 1 1 1\nread_restart r.1",
        "line 4: read_restart r.1.*binary file.*pair_style",
    ),
    "kim": ("kim init SW metal", "line 1: kim: .*archive of KIM"),
    "set": (f"units lj\n{LJ}set type 1 chrage 2", "line 4: set chrage"),
    "exclude": (f"units lj\n{LJ}neigh_modify exclude types 1 1", "line 4.*expected neigh_modify exclude type, group"),
    "include": (f"units lj\n{LJ}neigh_modify include", "line 4.*name of a group"),
    "every": (
        f"units lj\n{LJ}run 100 every 10 'pair_coeff 1 1 2 1'",
        "line 4.*'pair_coeff' is executed while LAMMPS runs",
    ),
    "model of another run": (
        f"units lj\n{LJ}run 10\npair_coeff 1 1 2 1\nrun 10",
        "line 5: pair_coeff 1 1 2 holds in run 2 .*line 6.*run = 2",
    ),
    "python": (f"units lj\n{LJ}python f input 1 SELF format p file f.py", "line 4: python f gets LAMMPS itself"),
    "include missing": (f"units lj\n{LJ}include nothing.in", "line 4.*nothing.in: no such file"),
    "quote": (f"units lj\n{LJ}pair_modify 'shift yes", "line 4.*quote"),
    "dimensions": (f"units lj\ndimension 4\n{LJ}", "line 2.*dimension 2 or 3"),
    "boundary": (f"units lj\nboundary p q p\n{LJ}", "line 2.*p, f, s, m"),
    "dielectric": (f"units lj\n{LJ}dielectric 0", "line 4.*positive"),
    "mix rule": (f"units lj\n{LJ}pair_modify mix mean", "line 4.*geometric, arithmetic"),
    "modify": (f"units lj\n{LJ}pair_modify special lj 0 0 0", "line 4.*special"),
    "modify what": (f"units lj\n{LJ}pair_modify sift yes", "line 4.*sift"),
    "style twice": (f"units lj\n{LJ}pair_style lj/cut 3", "line 4.*second time"),
    "hybrid without style": (
        "units lj\npair_style hybrid lj/cut 2 morse 2\npair_coeff 1 1 1 1\npair_coeff * * morse 1 1 1",
        "line 3.*1 is not a sub-style",
    ),
    "hybrid number": (
        "units lj\npair_style hybrid lj/cut 2 lj/cut 3\npair_coeff * * lj/cut 1 1\npair_coeff * * lj/cut 2 1 1",
        "line 3.*|lj/cut is used 2 times",
    ),
    "hybrid unused": (
        "units lj\npair_style hybrid lj/cut 2 morse 3\npair_coeff * * lj/cut 1 1",
        "morse has no pair_coeff",
    ),
    "hybrid gap": (
        "units lj\npair_style hybrid lj/cut 2 morse 3\npair_coeff 1 1 lj/cut 1 1\npair_coeff 2 2 morse 1 1 1",
        "no sub-style for types 1 and 2",
    ),
    "hybrid special": (
        "units lj\npair_style hybrid lj/cut 2\npair_coeff * * lj/cut 1 1\npair_modify pair lj/cut special lj 0.5 0 0",
        "cannot change the weight 0 of 1-2",
    ),
    "hybrid of the unknown": (
        "units lj\npair_style hybrid lj/cut 2 reaxff\npair_coeff * * lj/cut 1 1",
        "line 2.*reaxff",
    ),
    "born rho": ("units lj\npair_style born 2.5\npair_coeff 1 1 1 0 1 1 1", "line 3.*rho must be positive"),
    "zbl charges": ("units metal\npair_style zbl 3 4\npair_coeff 1 1 14 6", "line 3.*14 and 6"),
    "zbl cutoffs": ("units metal\npair_style zbl 4 3\npair_coeff 1 1 14 14", "0 < inner < outer"),
    "table style": ("units metal\npair_style table bitmap 12\npair_coeff 1 1 f k", "line 2.*linear N"),
    "table file": ("units metal\npair_style table linear 12\npair_coeff 1 1 f k", "line 3.*f: no such file"),
    "nothing": ("units metal\nmass 1 28", "no interactions found"),
    "bond style": ("units lj\nbond_style oxdna/fene\nbond_coeff 1 1 1 1", "line 2.*oxdna/fene is not supported"),
    "bond coefficients": ("units lj\nbond_style harmonic\nmass 1 1", "line 2.*no bond_coeff"),
    "adapt": (f"units lj\n{LJ}fix 1 all adapt 1 pair lj/cut epsilon 1 1 v_x", "line 4.*adapt"),
    "labelmap": (f"units lj\nlabelmap atom 1\n{LJ}", "line 2.*labelmap"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_lines_are_named(case, tmp_path):
    lines, says = BAD[case]
    with pytest.raises(AtcError, match=says) as e:
        atc.potential(lines)
    assert "\n" not in str(e.value) and str(e.value).startswith("potential")
    # The same in a file: the message starts with its name.
    path = tmp_path / "in.bad"
    path.write_text(lines)
    if case == "units missing":  # a script without units has LAMMPS's default, and says so
        pot = atc.potential(path)
        assert pot.units.name == "lj" and "no units line: lj" in pot.describe()
        return
    with pytest.raises(AtcError, match=says) as e:
        atc.potential(path)
    assert str(e.value).startswith(str(path))


def test_no_such_script(tmp_path):
    with pytest.raises(AtcError, match="no such file"):
        atc.potential("in.missing")
    with pytest.raises(AtcError, match="is empty"):
        atc.potential("", units="lj")
    with pytest.raises(AtcError, match="every cutoff is 0"):
        atc.potential("pair_style lj/cut 0\npair_coeff 1 1 1 1", units="lj")
    with pytest.raises(AtcError, match="is a folder"):
        atc.potential(str(tmp_path))
    with pytest.raises(AtcError, match="include"):
        (tmp_path / "in.self").write_text("units lj\ninclude in.self\n")
        atc.potential(tmp_path / "in.self")


def test_given_units_must_agree():
    with pytest.raises(AtcError, match="drop one"):
        atc.potential(f"units metal\n{LJ}", units="real")
    assert atc.potential(f"units metal\n{LJ}", units="metal").units.name == "metal"


def test_tail_corrections_are_noted():
    assert "tail corrections" in atc.potential(f"units lj\n{LJ}pair_modify tail yes").describe()
    assert "tail" not in atc.potential(f"units lj\n{LJ}pair_modify tail no").describe()


def test_what_else_may_be_given():
    pot = atc.potential(LJ, units="lj")
    assert atc.potential(pot) is pot
    for odd in (3.0, [pot.terms[0], "x"], []):
        with pytest.raises(AtcError, match="not from"):
            atc.potential(odd, units="lj")
    with pytest.raises(AtcError, match="special_bonds line"):
        atc.potential(LJ, units="lj", special_bonds="fene")


def test_words():
    assert split_words("a 'b c' \"d # e\" # f", "x") == ["a", "b c", "d # e"]
    assert split_words('print """one "two" three"""', "x") == ["print", 'one "two" three']


@pytest.mark.parametrize(
    "line, meant",
    [
        ("pair_coef 1 2 5.0 1.0", "pair_coeff"), ("special_bond lj 0 0 0", "special_bonds"), ("pair_modfy shift yes", "pair_modify"),
        ("pair_stile lj/cut 2.5", "pair_style"), ("scale 3.0", "correct it"),
    ],
)  # fmt: skip
def test_a_slip_in_a_command_is_no_other_model(line, meant, tmp_path):
    """LAMMPS stops at an unknown command; passing over it would compute another model in silence."""
    text = f"pair_style lj/cut 2.5\npair_coeff * * 1.0 1.0\n{line}\n"
    with pytest.raises(AtcError, match=f"line 3: '{line.split()[0]}' is not a LAMMPS command: .*{meant}"):
        atc.potential(text, units="lj")
    script = tmp_path / "in.run"
    script.write_text("units lj\n" + text)
    if meant == "correct it":  # a script has run: the word may come from a plugin
        with pytest.warns(AtcWarning, match="line 4: 'scale' is not a command of LAMMPS that atc knows"):
            atc.potential(script)
    else:
        with pytest.raises(AtcError, match=f"line 4: .*did you mean {meant}"):
            atc.potential(script)


def test_every_command_of_lammps_is_known():

    from atc.decomposers.lammps.commands import COMMANDS

    with lammps_session() as lmp:
        assert not set(lmp.available_styles("command")) - COMMANDS


def test_every_fix_of_lammps_has_a_class():
    from atc.decomposers.lammps.fixes import FIXES
    from atc.decomposers.pairs.hybrid import strip_suffix

    with lammps_session() as lmp:
        assert not {f for f in lmp.available_styles("fix") if strip_suffix(f) not in FIXES}


def test_docs_print_the_tables():
    from pathlib import Path

    from atc.decomposers.lammps.tables import tables

    text = (Path(__file__).resolve().parents[2] / "docs" / "lammps.md").read_text()
    assert tables() in text, "docs/lammps.md: run python -m atc.decomposers.lammps.tables"
