"""Random [potential] sections: every style that there is with arguments that it may or may not take, damaged scripts,
values of the wrong kind. One line of the package's own, soon.

Seconds here; ``ATC_FUZZ=20000 pytest -m slow tests/config/test_fuzz_potential.py`` tries so many.
"""

import os
import random
import re
import signal
import warnings
from contextlib import contextmanager

import nep_oracle
import pytest

from atc.config.scene import Scene
from atc.decomposers.registry import STYLES
from atc.errors import AtcError, AtcWarning

SEED = int(os.environ.get("ATC_SEED", "1"))
#: Seconds that a try may take, kernels that are compiled for it included.
SOON = 60
ODD = [
    *("nan", "inf", "-inf", "1e999", "-1", "0", "1_0", "1e-400", "9" * 30, "2147483648", "0x10", "1.5.2", "1e12", "3*"),
    *("*", "*2*", "2*1", "0*", "1*99999999", "NULL", "none", "hybrid", "&", "$x", "${x}", "$(1/0)", "v_x", '"', "'"),
    *("#", "..", "/", "/dev/zero", ".", "nowhere", "x" * 300, "\x1b[2J", "é", "\u202e", "long", "yes", "no", "all"),
    *("${x", "$(", "$(2.5)", "$(sqrt(-1))", "$(1e308*10)", "if", "lj/cut", "coul/long", "A", "A-B", "run.dump"),
]
NUMBERS = ["0.5", "1.0", "2", "3", "4.0", "8", "0.1", "-1", "12", "100", "1", "1", "180", "0.0"]
SCRIPT = """units real
atom_style full
variable x index 0.2 0.3
variable i loop 3
boundary p p p
label again
next i
if "${i} < 3" then "jump SELF again"
pair_style hybrid/overlay lj/cut 4.0 coul/cut 4.5
read_data w.data extra/atom/types 1
pair_coeff * * lj/cut $x 3.0
pair_coeff 2 2 lj/cut $(v_x/2) 1.0 3.5
pair_coeff * * coul/cut
bond_style harmonic
bond_coeff 1 450 1.0
angle_style harmonic
angle_coeff * 55 104.5
special_bonds lj/coul 0 0 0.5
pair_modify pair lj/cut shift yes
group h type 2
region r sphere 3 3 3 2
set group h charge 0.4
set type 1 charge -0.8
delete_bonds all bond 1
neigh_modify exclude group h h
fix 1 all nve
fix 2 h spring/self 1.0
run 10
"""
DATA = """water

6 atoms
2 atom types
4 bonds
1 bond types
2 angles
1 angle types

0 9 xlo xhi
0 9 ylo yhi
0 9 zlo zhi

Masses

1 15.999
2 1.008

Atoms # full

1 1 1 -0.8 1 1 1
2 1 2 0.4 2 1 1
3 1 2 0.4 1 2 1
4 2 1 -0.8 5 5 5
5 2 2 0.4 6 5 5
6 2 2 0.4 5 6 5

Bonds

1 1 1 2
2 1 1 3
3 1 4 5
4 1 4 6

Angles

1 1 2 1 3
2 1 5 4 6
"""
DUMP = """ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
6
ITEM: BOX BOUNDS pp pp pp
0 9
0 9
0 9
ITEM: ATOMS id mol type q x y z
1 1 1 -0.8 1 1 1
2 1 2 0.4 2 1 1
3 1 2 0.4 1 2 1
4 2 1 -0.8 5 5 5
5 2 2 0.4 6 5 5
6 2 2 0.4 5 6 5
"""
SCENE = """[trajectory]
file = "run.dump"
units = "real"
topology = "w.data"
[potential]
{}
[kernel]
name = "quartic"
radius = 4.0
[grid]
kind = "regular"
shape = [2, 2, 2]
[fields]
quantities = ["stress"]
[output]
file = "out.nc"
"""
VALUES = [
    *("1", "-1", "0", "nan", "inf", "true", "[]", "{}", '""', '"x"', '"."', '"/dev/null"', '"in.run"', '"run.dump"'),
    *('"w.data"', '"real"', '"lj"', '"equal"', '"center"', "[1, 2]", "1e300", "2026-01-01", '{ angle = "center" }'),
    *("{ angle = [0.5, 0.5] }", '{ lj = "equal" }', "{ angle = [nan, 0, 1] }", "'''\n'''", "99999999999999999999"),
]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    (folder / "w.data").write_text(DATA)
    (folder / "run.dump").write_text(DUMP)
    (folder / "in.run").write_text(SCRIPT)
    return folder


@contextmanager
def soon():
    """A hang is an error."""

    def stop(*_):
        raise TimeoutError(f"not done within {SOON} s")

    old = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SOON)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)


def attempt(folder, potential, evaluate=True) -> str:
    """What comes of a scene with this [potential] section: "none", "made", "computed" or "refused"."""
    with soon(), warnings.catch_warnings():
        warnings.simplefilter("error")  # of others: nothing that a user should see
        warnings.simplefilter("ignore", AtcWarning)
        try:
            scene = Scene.loads(SCENE.format(potential), folder=folder)
            pot = scene.potential()
            if pot is None:
                return "none"
            if evaluate:
                pot.stream(scene.trajectory()[0], forces=True)
                return "computed"
            return "made"
        except AtcError as e:
            text = str(e)
            # one line, of a length that somebody may read, and not another's words
            assert len(text.splitlines()) == 1 and len(text) < 3000, (potential, text)
            assert not re.search(r"Traceback|object has no attribute|NoneType|<class|<built-in", text), (
                potential,
                text,
            )
            return "refused"


def argument(rng, odd=0.12) -> str:
    return rng.choice(ODD) if rng.random() < odd else rng.choice(NUMBERS)


def random_style(rng) -> str:
    """LAMMPS lines of any style with numbers, some of them odd."""
    kind = rng.choice([*STYLES, "pair", "pair", "pair"])
    name = rng.choice(sorted(STYLES[kind]))
    odd = rng.choice([0.0, 0.0, 0.05, 0.2])
    words = [argument(rng, odd) for _ in range(rng.choice([0, 1, 1, 2, 3, 4]))]
    lines = ["units real", f"{kind}_style {name} {' '.join(words)}"]
    for _ in range(rng.choice([0, 1, 1, 1, 1, 2])):
        types = [rng.choice(["*", "*", "*", "1", "1*2"]) for _ in range(2 if kind == "pair" else 1)]
        values = [argument(rng, odd) for _ in range(rng.randrange(9))]
        lines.append(" ".join([f"{kind}_coeff", *types, *values]))
    if "long" in name and rng.random() < 0.8:
        lines.append(f"kspace_style ewald {rng.choice(['1e-4', argument(rng)])}")
    if rng.random() < 0.4:
        more = ["pair_modify shift yes", "pair_modify mix arithmetic", "pair_modify table", "special_bonds lj/coul 0 0"]
        lines.append(f"{rng.choice(more)} {argument(rng)} {argument(rng)}")
    return "\n".join(lines)


def damaged(rng, text: str) -> str:
    lines = text.splitlines()
    for _ in range(rng.choice([1, 1, 2, 4])):
        k = rng.randrange(len(lines))
        how, words = rng.randrange(6), lines[k].split(" ")
        if how == 0:
            del lines[k]
        elif how == 1:
            lines.insert(rng.randrange(len(lines)), lines[k])
        elif how == 2:
            words[rng.randrange(len(words))] = argument(rng)
            lines[k] = " ".join(words)
        elif how == 3:
            words.insert(rng.randrange(len(words) + 1), argument(rng))
            lines[k] = " ".join(words)
        elif how == 4:
            lines[k] = " ".join(words[: rng.randrange(len(words))])
        else:
            at = rng.randrange(len(lines[k]) + 1)
            lines[k] = (
                lines[k][:at] + rng.choice(["\t", "*", "-", "\x00", '"', "$", "{", "(", "9", "&"]) + lines[k][at:]
            )
    return "\n".join(lines)


def quoted(text: str) -> str:
    """As a TOML string."""
    return 'lammps = "' + "".join(c if c.isprintable() and c not in '\\"' else f"\\u{ord(c):04x}" for c in text) + '"'


def random_section(rng) -> str:
    """Keys with any values."""
    rows = [rng.choice(["input = 'in.run'", quoted("pair_style lj/cut 3\npair_coeff * * 1 1"), ""])]
    for key in rng.sample(["lammps", "input", "units", "run", "partition", "what", "folder"], rng.randrange(1, 4)):
        if not rows[0].startswith(f"{key} "):
            rows.append(f"{key} = {rng.choice(VALUES)}")
    return "\n".join(rows)


NEP = [
    {"names": ("O", "H")},
    {"names": ("O", "H"), "token": "nep", "l_max": (4,)},
    {"names": ("O", "H"), "token": "nep5_zbl", "zbl": (0.7, 1.4), "l_max": (4, 2, 1)},
]


def damaged_model(rng, folder) -> str:
    """A neuroevolution potential whose header or numbers are not what they were; its section."""
    path = folder / "bad.nep"
    nep_oracle.write(path, seed=rng.randrange(9), **rng.choice(NEP))
    lines = path.read_text().splitlines()
    head = 8 if rng.random() < 0.8 else len(lines)
    path.write_text(
        damaged(rng, "\n".join(lines[:head])) + "\n" + "\n".join(lines[head:]), "utf-8", errors="surrogateescape"
    )
    return 'nep = "bad.nep"\n' + rng.choice(["", 'types = ["O", "H"]', f"types = {rng.choice(VALUES)}"])


def tries(folder, kind, count, evaluate) -> dict:
    made = {}
    for number in range(count):
        rng = random.Random(f"{SEED} {kind} {number}")
        if kind == "styles":
            section = quoted(random_style(rng))
        elif kind == "lines":
            section = quoted(damaged(rng, SCRIPT))
        elif kind == "script":
            (folder / "in.bad").write_text(damaged(rng, SCRIPT), encoding="utf-8", errors="surrogateescape")
            section = 'input = "in.bad"'
        elif kind == "model":
            section = damaged_model(rng, folder)
        else:
            section = random_section(rng)
        try:
            done = attempt(folder, section, evaluate)
        except AssertionError:
            raise
        except Exception as e:
            raise AssertionError(f"{kind} {number}: {type(e).__name__}: {e}: {section}") from e
        made[done] = made.get(done, 0) + 1
    return made


KINDS = {"styles": 250, "lines": 60, "script": 60, "section": 80, "model": 60}


@pytest.mark.parametrize("kind", KINDS)
def test_random_potentials(place, kind):
    made = tries(place, kind, KINDS[kind], evaluate=kind != "styles")
    # neither all refused nor all let pass: both sides are tried
    assert made.get("refused") and made.get("made" if kind == "styles" else "computed"), made


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_random_potentials(place, kind):
    tries(place, kind, int(os.environ.get("ATC_FUZZ", "2000")), evaluate=True)
