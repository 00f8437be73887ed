"""The JSON Schemas of scenes and cases in docs/schema: current, and of one mind with atc's own checks."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from atc.cases.json_schema import case_schema, scene_schema
from atc.cli import app
from atc.config.scene import Scene
from atc.errors import AtcError

ROOT = Path(__file__).parents[2]
SCENE = jsonschema.Draft202012Validator(scene_schema())
CASE = jsonschema.Draft202012Validator(case_schema())
FILES = sorted((ROOT / "data").glob("*/*.toml"))
CASES = [f for f in FILES if "[body]" in f.read_text()]


@pytest.mark.parametrize("what, schema", [("scene", scene_schema), ("case", case_schema)])
def test_files_are_current(what, schema):
    printed = CliRunner().invoke(app, ["schema", what])
    assert printed.exit_code == 0 and json.loads(printed.output) == schema()
    jsonschema.Draft202012Validator.check_schema(schema())
    kept = (ROOT / "docs" / "schema" / f"{what}.json").read_text()
    assert kept == printed.output, f"atc schema {what} > docs/schema/{what}.json"


@pytest.mark.parametrize("file", FILES, ids=lambda f: f"{f.parent.name}/{f.name}")
def test_every_scene_and_case_of_the_data_is_valid(file):
    (CASE if file in CASES else SCENE).validate(tomllib.loads(file.read_text()))
    assert CASES and len(CASES) < len(FILES)


GOOD = """
[trajectory]
file = ["a.dump", "b.dump"]
masses = { 1 = 28.0 }
frames = "10:20:2"
units = "metal"
[kernel]
name = "quartic"
radius = 8.0
[grid]
kind = "regular"
spacing = [1.0, 2.0, 3.0]
[fields]
quantities = ["stress", "column:c_pe:mean"]
average = 10
tiles = [2, 2, 1]
"""


@pytest.mark.parametrize(
    "old, new",
    [
        ("radius = 8.0", "radius = -8.0"),
        ("radius = 8.0", 'radius = "8"'),
        ("radius = 8.0", "radios = 8.0"),
        ("[kernel]", "[kernels]"),
        ('name = "quartic"', 'name = "quart"'),
        ('name = "quartic"\n', ""),
        ('kind = "regular"', 'kind = "cubic"'),
        ('kind = "regular"', 'kind = "slab"'),
        ("spacing = [1.0, 2.0, 3.0]", "spacing = [1.0, 2.0, 0.0]"),
        ("spacing = [1.0, 2.0, 3.0]", ""),
        ("spacing = [1.0, 2.0, 3.0]", "spacing = 1.0\nshape = 4"),
        ("spacing = [1.0, 2.0, 3.0]", "spacing = 1.0\nbins = 4"),
        ('"stress", ', '"strain", '),
        ("average = 10", "average = 0"),
        ("tiles = [2, 2, 1]", "tiles = [2]"),
        ("{ 1 = 28.0 }", "{ 1 = 0.0 }"),
        ("{ 1 = 28.0 }", "{}"),
        ('units = "metal"', 'units = "metall"'),
        ('"10:20:2"', '"ten"'),
    ],
)
def test_what_atc_refuses_the_schema_refuses(old, new):
    assert old in GOOD
    Scene.loads(GOOD)
    SCENE.validate(tomllib.loads(GOOD))
    bad = GOOD.replace(old, new)
    with pytest.raises(AtcError):
        Scene.loads(bad)
    assert not SCENE.is_valid(tomllib.loads(bad))


@pytest.mark.parametrize(
    "old, new",
    [
        ('shape = "box"', 'shape = "cube"'),
        ("lo = [", "low = ["),
        (
            'displacement = ["free"',
            'displacement = ["fixed',
        ),
    ],
)
def test_cases(old, new, tmp_path):
    """Regions, histories and their tables."""
    text = (
        '[body]\nregion = { any = [{ shape = "box", lo = [0, 0, 0], hi = [4, 4, 4] }, { not = "hole" }] }\n'
        'spacing = 1.0\nhorizon = 2.01\ndensity = 1.0\n[regions]\nhole = { shape = "sphere", center = [2, 2, 2], '
        'radius = 1.0 }\n[[material]]\nmodel = "pmb"\nbulk = 1.0\n[[prescribed]]\nregion = "hole"\n'
        'displacement = ["free", "0.1*t", { times = [0.0, 1.0], values = [0.0, 0.5] }]\n[run]\nsteps = 4\n'
    )
    CASE.validate(tomllib.loads(text))
    if new.startswith("displacement"):
        bad = text.replace('["free", "0.1*t", {', '["free", {')
    else:
        bad = text.replace(old, new)
    assert bad != text and not CASE.is_valid(tomllib.loads(bad))


def test_regions_have_the_keys_of_their_shapes():
    case = {"regions": {"tip": {"shape": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0}}}
    assert CASE.is_valid(case)
    for wrong in ({"lo": [0, 0, 0]}, {"radius": -1.0}, {"center": [0.0, 0.0]}, {"center": 1.0}):
        assert not CASE.is_valid({"regions": {"tip": case["regions"]["tip"] | wrong}}), wrong
    box = {"shape": "box", "lo": [0, 0, float("-inf")], "hi": [1, 1, float("inf")]}
    assert CASE.is_valid({"regions": {"a": box, "b": {"not": "a"}, "c": {"any": ["a", box]}}})
    assert not CASE.is_valid({"regions": {"a": {"shape": "box", "lo": [0, 0, 0]}}})
