"""Scenes: what is accepted, what is refused and how, and that a resolved scene can be read back."""

import contextlib
import copy
import datetime
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atc.config.scene import Scene
from atc.config.schema import SCHEMA
from atc.config.toml import key_lines, toml_value
from atc.config.words import frame_slice
from atc.errors import AtcError

GOOD = """\
# a scene
[trajectory]
file = "run.dump"          # relative to the scene
masses = { 1 = 28.0855 }
frames = "10:50:5"

[potential]
lammps = \"\"\"
pair_style sw
# radius = 3 is not a key here
pair_coeff * * Si.sw Si
\"\"\"

[kernel]
name = "quartic"
radius = 8.0

[grid]
kind = "regular"
shape = [
  4,
  5, 6
]

[fields]
quantities = ["stress", "density"]
tolerance = 1e-6

[output]
file = "out.zarr"
"""


def refused(text, **kw) -> str:
    with pytest.raises(AtcError) as e:
        Scene.loads(text, name="scene.toml", **kw)
    message = str(e.value)
    assert "\n" not in message
    return message


def test_a_good_scene():
    s = Scene.loads(GOOD, name="scene.toml")
    assert s.get("kernel", "radius") == 8.0
    assert s.get("fields", "quantities") == ["stress", "density"]
    assert frame_slice(s.get("trajectory", "frames")) == slice(10, 50, 5)
    assert s.where("kernel", "radius") == "scene.toml:16"
    assert s.where("fields", "tolerance") == "scene.toml:27"


# (what to replace, by what, the line that must be named, words that must appear)
BAD = {
    "misspelt key": ("radius = 8.0", "raduis = 8.0", 16, ["raduis", "[kernel]", "did you mean 'radius'"]),
    "misspelt section": ("[kernel]", "[kernal]", 14, ["kernal", "did you mean 'kernel'"]),
    "misspelt quantity": ('"density"]', '"densty"]', 26, ["densty", "did you mean 'density'"]),
    "misspelt kernel": ('"quartic"', '"quartik"', 15, ["quartik", "did you mean 'quartic'"]),
    "misspelt grid": ('"regular"', '"reglar"', 19, ["reglar", "did you mean 'regular'"]),
    "unknown units": ("[potential]", 'units = "metall"\n[potential]', 7, ["metall", "did you mean 'metal'"]),
    "radius zero": ("radius = 8.0", "radius = 0", 16, ["radius", "greater than 0"]),
    "radius negative": ("radius = 8.0", "radius = -8.0", 16, ["radius", "greater than 0", "-8.0"]),
    "radius is text": ("radius = 8.0", 'radius = "8"', 16, ["radius", '"8"']),
    "radius is a truth": ("radius = 8.0", "radius = true", 16, ["radius", "true"]),
    "radius infinite": ("radius = 8.0", "radius = inf", 16, ["radius"]),
    "empty grid": ("  5, 6", "  0, 6", 20, ["shape", "at least 1"]),
    "grid without points": ("shape = [\n  4,\n  5, 6\n]", "shape = []", 20, ["shape"]),
    "foreign grid key": ('kind = "regular"', 'kind = "regular"\nbins = 4', 20, ["bins", "regular grid"]),
    "both": ('kind = "regular"', 'kind = "regular"\nspacing = 2', 20, ["shape or spacing", "not both"]),
    "tolerance": ("1e-6", "0", 27, ["tolerance", "between 0 and 1"]),
    "quantities are numbers": ('["stress", "density"]', "[1]", 26, ["quantities", "[1]"]),
    "no quantities": ('["stress", "density"]', "[]", 26, ["quantities"]),
    "frames": ('"10:50:5"', '"ten"', 5, ["frames", '"ten"']),
    "frames backwards": ('"10:50:5"', '"10:50:-5"', 5, ["frames", "step"]),
    "frames with a wrong key": ('"10:50:5"', "{ start = 3 }", 5, ["start", "begin"]),
    "negative mass": ("28.0855 }", "-1 }", 4, ["masses", "greater than 0"]),
    "text without quotes": ('"quartic"', "quartic", 15, ["TOML", "quotes"]),
    "twice the same key": ("radius = 8.0", "radius = 8.0\nradius = 9.0", 17, ["TOML"]),
    "unclosed string": ('"out.zarr"', '"out.zarr', 30, ["TOML"]),
    "two potentials": ("[potential]", '[potential]\ninput = "in.run"', 8, ["lammps or input", "not both"]),
    "no such key after a multi-line value": (
        "[fields]",
        "[fields]\nquantity = 3",
        26,
        ["quantity", "did you mean 'quantities'"],
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_values_name_the_line(case):
    old, new, line, words = BAD[case]
    assert GOOD.count(old) == 1
    message = refused(GOOD.replace(old, new))
    assert message.startswith(f"scene.toml:{line}: "), message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    "section, words",
    [
        ("trajectory", ["[trajectory]", "file"]),
        ("potential", ["[potential]", "stress", "lammps"]),
        ("kernel", ["[kernel]", "radius"]),
        ("grid", ["[grid]", "kind"]),
        ("fields", ["[fields]", "quantities"]),
    ],
)
def test_missing_sections(section, words):
    start = GOOD.index(f"[{section}]")
    end = GOOD.find("\n[", start)
    text = GOOD[:start] + (GOOD[end + 1 :] if end > 0 else "")
    with pytest.raises(AtcError) as e:
        Scene.loads(text, name="scene.toml").require_complete()
    assert str(e.value).startswith("scene.toml: no ")
    for word in words:
        assert word in str(e.value)


@pytest.mark.parametrize(
    "old, new, line, word",
    [
        ('file = "run.dump"          # relative to the scene', "", 2, "file"),
        ('kind = "regular"', "", 18, "kind"),
        ('name = "quartic"', "", 14, "name"),
    ],
)
def test_missing_keys_name_their_section(old, new, line, word):
    message = refused(GOOD.replace(old, new))
    assert message.startswith(f"scene.toml:{line}: ")
    assert word in message


def test_piola_needs_a_reference():
    scene = Scene.loads(GOOD.replace('["stress", "density"]', '["piola_stress"]'), name="scene.toml")
    with pytest.raises(AtcError, match=r"scene.toml:2: .*piola_stress.*reference"):
        scene.require_complete()


def test_a_scene_that_needs_little():
    """The mass density needs no potential, the virial of the box neither kernel nor grid."""
    Scene.load(
        {
            "trajectory": {"file": "a.dump"},
            "kernel": {"name": "quartic", "radius": 3},
            "grid": {"kind": "atoms"},
            "fields": {"quantities": ["density"]},
        }
    ).require_complete()
    Scene.load(
        {"trajectory": {"file": "a.dump"}, "potential": {"input": "in.a"}, "fields": {"quantities": ["virial_stress"]}}
    ).require_complete()


# ---- overrides


@pytest.mark.parametrize(
    "setting, section, key, value",
    [
        ("kernel.radius=10", "kernel", "radius", 10),
        ("kernel.radius = 1e1", "kernel", "radius", 10.0),
        ("kernel.name=lucy", "kernel", "name", "lucy"),
        ('kernel.name="lucy"', "kernel", "name", "lucy"),
        ("grid.shape=[7, 8, 9]", "grid", "shape", [7, 8, 9]),
        ("grid.shape=7,8,9", "grid", "shape", [7, 8, 9]),
        ("fields.quantities=stress", "fields", "quantities", ["stress"]),
        ("fields.quantities=stress,temperature", "fields", "quantities", ["stress", "temperature"]),
        ("trajectory.frames=3:9", "trajectory", "frames", "3:9"),
        ("trajectory.frames=-1", "trajectory", "frames", -1),
        ("trajectory.masses={1=5.0}", "trajectory", "masses", {"1": 5.0}),
        ("fields.average=true", "fields", "average", True),
        ("output.file=b.nc", "output", "file", "b.nc"),
    ],
)
def test_overrides(setting, section, key, value):
    scene = Scene.loads(GOOD, overrides=[setting])
    assert scene.get(section, key) == value
    assert type(scene.get(section, key)) is type(value)


@pytest.mark.parametrize(
    "setting, words",
    [
        ("kernel.raduis=10", ["raduis", "did you mean 'radius'"]),
        ("kernle.radius=10", ["kernle", "did you mean 'kernel'"]),
        ("kernel.radius", ["SECTION.KEY=VALUE"]),
        ("radius=10", ["SECTION.KEY=VALUE", "kernel.radius"]),
        ("kernel.radius=-1", ["greater than 0"]),
        ("kernel.radius=wide", ["wide"]),
        ("fields.quantities=pressure_of_work", ["pressure_of_work"]),
    ],
)
def test_bad_overrides_name_the_flag(setting, words):
    message = refused(GOOD, overrides=[setting])
    assert message.startswith(f"--set {setting}: ")
    for word in words:
        assert word in message


def test_an_override_does_not_touch_the_scene_it_came_from():
    scene = Scene.loads(GOOD)
    other = Scene.load(scene, {"kernel.radius": 3.0, "fields.quantities": ["density"]})
    assert (scene.get("kernel", "radius"), other.get("kernel", "radius")) == (8.0, 3.0)
    assert scene.get("fields", "quantities") == ["stress", "density"]
    with pytest.raises(AtcError):
        scene.set("kernel", "radius", -1)
    assert scene.get("kernel", "radius") == 8.0


# ---- frames


@pytest.mark.parametrize(
    "value, expected",
    [
        ("100:500:5", slice(100, 500, 5)),
        ("::10", slice(None, None, 10)),
        ("-5:", slice(-5, None, None)),
        (7, slice(7, 8, 1)),
        (-1, slice(-1, None, 1)),
        (-2, slice(-2, -1, 1)),
        ({"begin": 3}, slice(3, None, None)),
        ({"begin": 3, "end": 9, "step": 2}, slice(3, 9, 2)),
    ],
)
def test_frame_slices(value, expected):
    assert frame_slice(value) == expected


# ---- round trip

words = st.text(st.characters(codec="utf-8"), min_size=1).filter(lambda s: s.strip())
names = st.text(st.characters(codec="utf-8", exclude_characters="/~\x00"), min_size=1).filter(
    lambda s: s.strip() and s not in (".", "..")
)
lengths = st.floats(min_value=1e-6, max_value=1e6)
numbers = st.floats(allow_nan=False, allow_infinity=False)
counts = st.integers(1, 10**6)
vector = st.lists(numbers, min_size=3, max_size=3)


@st.composite
def scenes(draw):
    def some(**keys):
        return {k: draw(v) for k, v in keys.items() if draw(st.booleans())}

    data = {
        "trajectory": {"file": draw(names)}
        | some(
            topology=names,
            units=st.sampled_from(["lj", "metal", "real"]),
            masses=st.dictionaries(words, lengths, min_size=1) | st.lists(lengths, min_size=1),
            frames=st.sampled_from(["1:2:3", -1, {"begin": 1, "step": 2}]),
            reference=st.integers() | names,
        )
    }
    data |= some(
        potential=st.one_of(
            st.fixed_dictionaries({"lammps": words}, optional={"units": st.just("real")}),
            st.fixed_dictionaries({"input": names}),
        ),
        kernel=st.fixed_dictionaries({"name": st.just("quartic"), "radius": lengths | counts}),
        grid=st.one_of(
            st.fixed_dictionaries(
                {"kind": st.just("regular"), "shape": st.lists(counts, min_size=3, max_size=3)},
                optional={"origin": vector},
            ),
            st.fixed_dictionaries({"kind": st.just("points"), "points": st.lists(vector, min_size=1)}),
            st.just({"kind": "atoms"}),
        ),
        fields=st.fixed_dictionaries(
            {},
            optional={"quantities": st.just(["density"]), "tolerance": st.floats(1e-15, 0.5), "average": st.booleans()},
        ),
        output=st.fixed_dictionaries({"file": names}),
    )
    return data


@settings(max_examples=200, deadline=None)
@given(scenes())
def test_round_trip(data):
    scene = Scene.load(data)
    text = scene.to_toml()
    again = Scene.loads(text)
    assert again.to_toml() == text
    # numbers survive to the last bit; names only lose what Path normalises ("./a" is "a")
    for section, table in scene.data.items():
        for key, value in table.items():
            if not SCHEMA[section][key].path or not isinstance(value, str):
                assert again.data[section][key] == value
    # every key is where the scanner says it is
    lines = text.split("\n")
    for path, line in key_lines(text).items():
        if len(path) == 2:
            assert lines[line - 1].startswith(f"{path[1]} = "), (path, line)
    assert {p for p in key_lines(text) if len(p) == 2} == {(s, k) for s, t in tomllib.loads(text).items() for k in t}


@settings(max_examples=200, deadline=None)
@given(
    st.recursive(
        st.text() | st.booleans() | st.integers() | numbers,
        lambda c: st.lists(c, max_size=3) | st.dictionaries(st.text(), c, max_size=3),
        max_leaves=8,
    )
)
def test_values_survive_toml(value):
    assert tomllib.loads(f"v = {toml_value(value)}\n")["v"] == value


def test_no_names_of_people_or_places(tmp_path):
    """Absolute paths lose what lies outside the scene's folder."""
    path = tmp_path / "scene.toml"
    path.write_text(
        GOOD.replace('"run.dump"', f'"{tmp_path}/sub/run.dump"').replace(
            'file = "out.zarr"', 'file = "/somewhere/else/out.zarr"'
        )
    )
    text = Scene.load(path).to_toml()
    assert 'file = "sub/run.dump"' in text
    assert 'file = "out.zarr"' in text
    assert str(tmp_path) not in text


@pytest.mark.parametrize("content, word", [(None, "no such"), (b"\xff\xfe\x00", "text file")])
def test_unreadable_scene(tmp_path, content, word):
    path = tmp_path / "s.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(AtcError, match=word):
        Scene.load(path)
    (tmp_path / "run.dump").write_text("ITEM: TIMESTEP\n0\n")
    with pytest.raises(AtcError, match=r"run\.dump:1: .*TOML.*atc init writes a scene"):
        Scene.load(tmp_path / "run.dump")
    with pytest.raises(AtcError, match="directory"):
        Scene.load(tmp_path)


def test_every_key_is_documented():
    from pathlib import Path

    from atc.config.schema import SCHEMA

    text = (Path(__file__).resolve().parents[2] / "docs" / "scene.md").read_text()
    for section, keys in SCHEMA.items():
        _, found, rest = text.partition(f"## [{section}]\n")
        assert found, f"docs/scene.md has no section [{section}]"
        here = rest.partition("\n## [")[0]
        missing = [key for key in keys if f"`{key}`" not in here]
        assert not missing, f"docs/scene.md does not explain [{section}] {', '.join(missing)}"


def test_partition_of_the_energy(tmp_path):
    scene = {
        "trajectory": {"file": "x.dump"},
        "potential": {
            "lammps": "pair_style lj/cut 5\npair_coeff 1 1 0.01 3.4",
            "units": "metal",
            "partition": "center",
        },
    }
    assert Scene.load(scene).potential().describe()
    scene["potential"]["partition"] = {"sw": "center"}
    with pytest.raises(AtcError, match=r"\[potential\] partition: .*no term 'sw'"):
        Scene.load(scene).potential()
    scene["potential"]["partition"] = 3
    with pytest.raises(AtcError, match="how energy is shared"):
        Scene.load(scene)


@pytest.mark.parametrize("of", ["scene", "case"])
def test_values_of_any_kind_are_taken_or_refused(of):
    """What TOML can hold under any key: its check says no by ValueError or TypeError, as `check_value` expects."""
    from atc.cases.schema import ARRAYS, TABLES

    kinds = (float("nan"), -1, 2**70, True, "", "x", [], [[]], {}, {"a": {}}, [{"a": 1}], {"a": "b"}, [1, "x"])
    kinds += (datetime.date(2026, 1, 1), {"kind": 1}, [None], ["x"], {"": ""}, 1e308, "9" * 5000)
    for keys in (SCHEMA if of == "scene" else TABLES | ARRAYS).values():
        for spec in keys.values():
            for value in kinds:
                with contextlib.suppress(ValueError, TypeError, AtcError):
                    spec.check(copy.deepcopy(value))
