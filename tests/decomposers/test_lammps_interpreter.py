"""LAMMPS scripts executed: loops, conditions, jumps, several runs; and scripts that mean ill."""

import os
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lammps_oracle import lammps_session, thermal_lattice
from script_runs import run_script

import atc
from atc.decomposers.lammps.conditions import holds
from atc.decomposers.lammps.interpreter import Interpreter
from atc.decomposers.lammps.script import logical_lines, split_words
from atc.decomposers.lammps.variables import Unknown
from atc.errors import AtcError, AtcWarning

CONDITIONS = [
    "1 < 2",
    "2 <= 1",
    "1.5e1 == 15",
    "-3 < -2",
    "!0",
    "!(1 > 2)",
    "1 && 0 || 1",
    "0 |^ 1",
    "abc == abc",
    "abc != abd",
    "lj/cut == lj/cut",
    "(1 > 2) || (3 == 3)",
    "1 == 1 && 2 > 3",
    ".5 > 0",
    "1 > 2 == 0",
]


def test_conditions_are_lammpss():
    with lammps_session() as lmp:
        for c in CONDITIONS:
            lmp.command(f'if "{c}" then "variable r string yes" else "variable r string no"')
            assert holds(c) == (lmp.extract_variable("r") == "yes"), c


@pytest.mark.parametrize("inside", ["print x", "variable k string a", "pair_coeff 1 1 2.0 1.0"])
def test_conditions_between_lines_that_a_jump_may_skip(inside):
    """Conditions are looked into where it is not known whether LAMMPS gets to them."""
    text = (
        f'variable k string 3.0\npair_style lj/cut 2.5\npair_coeff * * 1.0 1.0\nif "$(pe) > 0" then "jump SELF on"\n'
        f'if "1 > 2" then "{inside}" else "print y"\nlabel on\npair_coeff 1 1 $k 1.0\n'
    )
    why = {
        "variable k string a": r"line 7: variable k depends on a condition \(.*line 4\)",
        "pair_coeff 1 1 2.0 1.0": r"line 4: whether this jump skips 'if' \(.*line 5\)",
    }.get(inside)
    if why is None:
        assert atc.potential(text, units="lj").terms[0].styles[0].table[1, 1, 0] == 2.5**2
        return
    with pytest.raises(AtcError, match=why):
        atc.potential(text, units="lj")


@pytest.mark.parametrize(
    "c", ["", "1 <", "abc", "1 == abc", "(1", "1)", "abc && abd", "abc < abd", "!abc", "1 ? 2", "((((" * 40]
)
def test_conditions_that_lammps_does_not_know(c):
    with pytest.raises(Unknown):
        holds(c)


#: What is printed is what LAMMPS prints.
SCRIPTS = {
    "loop": "variable i loop 2 4\nlabel a\nvariable out string ${out}_$i\nnext i\njump SELF a\nvariable out string "
    "${out}!",
    "padded": "variable i loop 8 11 pad\nlabel a\nvariable out string ${out}_$i\nnext i\njump SELF a",
    "own name": "variable i index x y z\nlabel a\nvariable out string ${out}_$i\nnext i\njump in.run a",
    "double loop": (
        "label a\nvariable i loop 3\nlabel b\nvariable j loop 3\nvariable out string ${out}_$i$j\nif '$j >= $i' then "
        "'jump SELF c'\nnext j\njump SELF b\nlabel c\n"
        "variable j delete\nnext i\njump in.run a\nvariable out string ${out}_end"
    ),
    "else": "variable k equal 3\nif '${k} < 2' then 'variable out string a' elif '${k} == 3' 'variable out string b' "
    "'variable out string ${out}c' else 'variable out string d'",
    "continued": "variable k equal 1+ &\n  2 # a comment\nif \"${k} == 3\" then &\n   'variable out string ${k}' "
    "&\nelse &\n   'variable out string no'",
    "include": "include more.in\nvariable out string ${out}_${there}\ninclude more.in\nvariable out string "
    "${out}_${there}",
    "jump to another file": "jump more.in there\nvariable out string no",
    "formats": "variable x equal 1/3\nvariable y format x %8.3f\nvariable out string ${y}|$(v_x*3:%.2f)|$(1e10)",
    "quotes": 'variable out string "a # b"',
    "triple": 'variable out string """a "b" c"""',
    "file": "variable v file values.txt\nlabel a\nvariable out string '${out}_$v'\nnext v\njump SELF a",
    "first definition": "variable v index 1\nvariable v index 2\nvariable w string 1\nvariable w string 2\nvariable "
    "out string $v$w",
    "commented out": "# variable out string x &\nvariable out string y\n",
    "names": "variable n index 2\nvariable out string $n${n}$(v_n)",
}


@pytest.mark.parametrize("case", SCRIPTS)
def test_control_is_lammpss(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "more.in").write_text(
        "variable there index 1 2 3\nnext there\nvariable out string ${out}+\nlabel there\nvariable out string "
        "${out}jumped\n"
    )
    (tmp_path / "values.txt").write_text("# values\n1.5 x\n\n2.5 # y\nlast\n")
    text = "variable out string ''\n" + SCRIPTS[case] + "\n"
    text = text.replace("''\n", "start\n", 1)
    (tmp_path / "in.run").write_text(text)
    with lammps_session() as lmp:
        lmp.file("in.run")
        expected = lmp.extract_variable("out")
    mine = Interpreter(tmp_path, True, tmp_path / "in.run")
    mine.execute(text, "in.run")
    assert mine.variables.text("out") == expected


LJ = (
    "units lj\natom_style atomic\nlattice fcc 0.8442\nregion b block 0 3 0 3 0 3\ncreate_box 2 b\ncreate_atoms 1 "
    "box\nmass * 1\ndisplace_atoms all random 0.1 0.1 0.1 4\n"
)


def test_a_model_in_loops_and_conditions(tmp_path):
    text = LJ + (
        "variable style index lj/cut\npair_style ${style} 2.5\nlabel a\nvariable i loop 2\nlabel b\nvariable j loop 2\n"
        "if '$i <= $j' then 'pair_coeff $i $j $(v_i+v_j*0.5) 1.0'\nnext j\njump SELF b\nnext i\njump SELF a\nset atom "
        "1*30 type 2\n"
    )
    ran = run_script(tmp_path, text)
    pot = atc.potential(tmp_path / "in.run")
    d = pot.stream(atc.read(tmp_path / "run.dump", units="lj")[0], forces=True)
    assert d.energy == pytest.approx(ran.energy, rel=1e-10)
    np.testing.assert_allclose(d.forces_nc, ran.forces, rtol=0, atol=1e-10 * np.abs(ran.forces).max())


RUNS = LJ + (
    "pair_style soft 1.0\npair_coeff * * 5.0\ndump 1 all custom 10 soft.dump id type x y z\nminimize 1e-4 1e-4 5 "
    "5\nundump 1\n"
    "pair_style lj/cut 2.5\npair_coeff * * 1 1\ndump 2 all custom 10 lj.*.dump id type x y z\nrun 0\nfix 1 all "
    "wall/reflect zhi EDGE\nrun 0\n"
)


def test_the_run_that_the_frames_belong_to(tmp_path):
    (tmp_path / "in.run").write_text(RUNS)
    script = tmp_path / "in.run"
    with pytest.raises(
        AtcError,
        match=r"line 14: pair_style lj/cut 2.5 holds in run 2 \(.*line 17\), not in run 1 \(.*line 12\).*run = 2",
    ):
        atc.potential(script)
    assert "soft" in atc.potential(script, run=1).describe()
    assert "lj/cut" in atc.potential(script, run=2).describe() and "lj/cut" in atc.potential(script, run=3).describe()
    assert "soft" in atc.potential(script, trajectory=["out/soft.dump"]).describe()
    assert "lj/cut" in atc.potential(script, trajectory=["out/lj.0.dump", "out/lj.10.dump"]).describe()
    for files in (["other.dump"], ["out/lj.0.dump", "soft.dump"]):
        with pytest.raises(AtcError, match="holds in run 2"):
            atc.potential(script, trajectory=files)
    for run in (0, 4, -1, 1.0, True):
        with pytest.raises(AtcError, match="the script has 3 runs: expected a number from 1 to 3"):
            atc.potential(script, run=run)


def test_a_restart_file_that_the_script_wrote(tmp_path):
    """It holds what the script had said: styles that are said again, with their coefficients, go on from there."""
    pair = (
        "pair_style lj/cut 2.5\npair_coeff 1 1 1 1\npair_coeff 1 2 0.5 1\npair_coeff 2 2 2 1\npair_modify shift yes\n"
    )
    text = LJ + pair + "set atom 1*30 type 2\nwrite_restart r.equil\nrun 0\nclear\nread_restart r.equil\n"
    for again in ("", pair, "pair_style lj/cut 2.5\npair_coeff 1 1 1 1\npair_coeff 1 2 0.5 1\npair_coeff 2 2 2 1\n"):
        ran = run_script(tmp_path, text + again + "run 0\n")
        d = atc.potential(tmp_path / "in.run").stream(atc.read(tmp_path / "run.dump", units="lj")[0])
        assert d.energy == pytest.approx(ran.energy, rel=1e-10)
    ran = run_script(tmp_path, text + "pair_style morse 2.0\npair_coeff * * 1 2 1\nrun 0\n")
    with pytest.raises(AtcError, match="holds in run 2"):
        atc.potential(tmp_path / "in.run")
    assert atc.potential(tmp_path / "in.run", run=2).stream(
        atc.read(tmp_path / "run.dump", units="lj")[0]
    ).energy == pytest.approx(ran.energy, rel=1e-10)


def test_what_only_some_runs_have(tmp_path):
    script = tmp_path / "in.run"
    base = LJ + "pair_style lj/cut 2.5\npair_coeff * * 1 1\n"
    script.write_text(base + "run 0\nfix 1 all shake 0.1 10 0 b 1\nrun 0\nunfix 1\nrun 0\n")
    with pytest.raises(AtcError, match="line 12: fix shake"):
        atc.potential(script)
    assert atc.potential(script, run=1).outside == () == atc.potential(script, run=3).outside
    script.write_text(
        base
        + "fix w all wall/lj93 zlo EDGE 1 1 2.5\nfix g all gravity 1 vector 0 0 -1\nfix n all nve\nunfix g\nrun 10\n"
    )
    pot = atc.potential(script)
    assert pot.outside == ("fix wall/lj93 on group all (in.run, line 11)",) and "forces from outside" in pot.describe()
    script.write_text(base + "fix 1 all shake 0.1 10 0 b 1\nunfix 1\nfix 1 all nve\nrun 0\n")
    assert atc.potential(script).outside == ()


def test_a_long_loop_that_changes_nothing_is_cut_short(tmp_path):
    script = tmp_path / "in.run"
    body = (
        "variable t equal temp\nlabel a\nvariable i loop 1000000\nrun 100\nvariable s equal ${t}\nnext i\njump SELF a\n"
    )
    script.write_text(LJ + "pair_style lj/cut 2.5\npair_coeff * * 1 1\n" + body)
    begin = time.perf_counter()
    assert "lj/cut" in atc.potential(script).describe()
    assert time.perf_counter() - begin < 10
    script.write_text(
        LJ + "pair_style lj/cut 2.5\npair_coeff * * 1 1\n" + body.replace("run 100", "pair_coeff 1 1 $i 1.0")
    )
    with pytest.raises(AtcError, match="loop without end|runs with models of their own"):
        atc.potential(script)


BOMB = "\n".join(f"variable v{k + 1} equal v_v{k}+v_v{k}" for k in range(40))
HOSTILE = {
    "endless jump": "label a\njump SELF a",
    "endless include": "include in.run",
    "device": "include /dev/zero",
    "folder": "include .",
    "binary": "include binary.in",
    "chain of variables": f"variable v0 equal 1\n{BOMB}\npair_style lj/cut ${{v40}}\npair_coeff 1 1 1 1",
    "growing string": "variable s string "
    + "x" * 50
    + "\n"
    + "variable s string ${s}${s}\n" * 40
    + "pair_style lj/cut ${s}",
    "brackets": "pair_style lj/cut $(" + "(" * 5000 + "1" + ")" * 5000 + ")",
    "minus signs": "pair_style lj/cut $(" + "-" * 50000 + "1)",
    "condition": "if '" + "(" * 5000 + "1' then 'pair_style lj/cut 2'",
    "itself": "variable a equal v_a\npair_style lj/cut ${a}",
    "nested if": "if '1 == 1' then \"if '1 == 1' then 'include in.run'\"",
    "format": "pair_style lj/cut $(1:%s%n)",
    "wide format": "pair_style lj/cut $(1:%999999999.3f)",
    "loop of loops": "label a\nvariable i loop 99999999\nlabel b\nvariable j loop 99999999\nnext j\njump SELF b\nnext "
    "i\njump SELF a\npair_style lj/cut 2\npair_coeff 1 1 $(1/0) 1",
    "long name": "include " + "x" * 5000,
    "nul": "include a\0b",
}


@pytest.mark.parametrize("case", HOSTILE)
def test_scripts_that_mean_ill_end_soon(case, tmp_path):
    (tmp_path / "binary.in").write_bytes(bytes(range(256)) * 10)
    script = tmp_path / "in.run"
    script.write_text("units lj\n" + HOSTILE[case] + "\n")
    begin = time.perf_counter()
    with pytest.raises(AtcError) as e:
        atc.potential(script)
    assert time.perf_counter() - begin < 10
    assert "\n" not in str(e.value) and len(str(e.value)) < 1500


def test_a_fifo_is_no_script(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for text in ("include pipe", "variable v file pipe\npair_style lj/cut $v"):
        (tmp_path / "in.run").write_text("units lj\n" + text)
        with pytest.raises(AtcError, match="no ordinary file"):
            atc.potential(tmp_path / "in.run")


def test_time_grows_with_the_size(tmp_path):
    """Twice the lines, about twice the time: nothing looks at all lines for each line."""
    times = []
    for n in (4000, 16000):
        lines = ["units lj", "pair_style lj/cut 2.5", "pair_coeff * * 1 1"]
        lines += [
            f"if '{k} > {n}' then 'jump SELF l{k}'\nlabel l{k}\nvariable x{k} equal {k} &\n + 1\nregion r{k} block 0 "
            f"{k} 0 1 0 1"
            for k in range(n // 4)
        ]
        (tmp_path / "in.run").write_text("\n".join(lines) + "\nrun 1\n")
        begin = time.perf_counter()
        atc.potential(tmp_path / "in.run")
        times.append(time.perf_counter() - begin)
    assert times[1] < 12 * times[0] + 1.0  # linear would be 4 times; the machine is noisy


WORDS = st.sampled_from(
    "units lj metal pair_style lj/cut 2.5 pair_coeff * 1 1*2 variable x index loop equal string v_x ${x} $x $(v_x*2) "
    "if then else elif jump SELF label a next "
    "include set type charge group region block sphere delete_bonds all multi fix 1 nve shake run 100 every read_data "
    "boundary p f change_box neigh_modify exclude "
    'type special_bonds hybrid & # \' " """ ( ) < == -1 1e400 nan 0 clear replicate create_atoms lattice fcc mass'.split()
)


@settings(
    max_examples=int(os.environ.get("ATC_FUZZ", "60")),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(st.lists(WORDS, min_size=1, max_size=9).map(" ".join), min_size=1, max_size=12).map("\n".join))
@pytest.mark.filterwarnings("ignore::atc.errors.AtcWarning")
def test_any_words(tmp_path, text):
    (tmp_path / "in.run").write_text(text)
    try:
        pot = atc.potential(tmp_path / "in.run")
        x, t = thermal_lattice(np.diag([9.0] * 3), (3, 3, 3))
        from atc.frame import Cell, Frame

        pot.complete(Frame(x, Cell(np.diag([9.0] * 3)), pot.units, types=t, ids=np.arange(1, 28)))
    except AtcError as e:
        assert "\n" not in str(e)


def test_words_of_a_line():
    lines = logical_lines('a 1 & # c\nb\n"""x\n# y &\nz""" w\n  # only & \n more\n\nend &', "f")
    assert [k.text.split() for k in lines] == [["a", "1", "&"], ["b"], ['"""x', "#", "y", 'z"""', "w"], ["end"]]
    assert [k.where for k in lines] == ["f, line 1", "f, line 2", "f, line 3", "f, line 9"]
    assert split_words('"""x\ny""" w', "f") == ["x\ny", "w"]
    with pytest.raises(AtcError, match="quote"):
        split_words("print 'a", "f")


def test_an_unknown_command_of_a_script_is_a_warning(tmp_path):
    (tmp_path / "in.run").write_text("units lj\npair_style lj/cut 2.5\npair_coeff * * 1 1\nbrew coffee\n")
    with pytest.warns(AtcWarning, match="line 4: 'brew'"):
        atc.potential(tmp_path / "in.run")


def test_names_that_no_file_can_have(tmp_path):
    """Longer than the system allows: as a file that is not there, wherever a script names one."""
    name = "x" * 5000
    for line in (f"jump {name} a", f"include {name}", f"if '1 == 1' then 'jump {name}'", f"pair_coeff * * {name} Ar"):
        with pytest.raises(AtcError, match="x{40}"):
            atc.potential(f"units metal\npair_style eam/alloy\n{line}\n")
