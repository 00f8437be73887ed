"""What a peridynamics case may hold: its sections and keys and what values they take. The checks are those of scenes
(`atc.config.schema`)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from ..config.checks import (
    Key,
    boolean,
    choice,
    count,
    either,
    integer,
    json_of,
    list_of,
    list_or_one,
    not_negative,
    number,
    one_of_numbers,
    positive,
    seed,
    string,
    takes,
)
from ..config.schema import SCHEMA as SCENE


@takes({"type": "number"})
def _bound(v):
    """A number, also inf and -inf: an open side."""
    if isinstance(v, bool) or not isinstance(v, (int, float)) or v != v:
        raise ValueError
    return v


_V3 = list_of(number, 3)
_CORNER = list_of(_bound, 3)
#: Of each shape its keys and what checks them.
SHAPES: dict[str, dict[str, Any]] = {
    "box": {"lo": _CORNER, "hi": _CORNER},
    "cylinder": {
        "axis": choice(["x", "y", "z"]),
        "center": list_of(number, 2),
        "radius": positive,
        "lo": _bound,
        "hi": _bound,
    },
    "sphere": {"center": _V3, "radius": positive},
    "set": {"name": string},
}
#: Where a cylinder ends that does not say it.
_ENDLESS = {"lo": float("-inf"), "hi": float("inf")}


def _needed(shape) -> list[str]:
    return [k for k in SHAPES[shape] if shape != "cylinder" or k not in _ENDLESS]


def _table(row, what):
    """A table {times, values}."""

    @takes(lambda: _json_table(json_of(row)))
    def checked(v):
        if set(v) != {"times", "values"}:
            raise ValueError("a table has the keys times and values")
        times, values = list_of(number)(v["times"]), list_of(row)(v["values"])
        if len(times) != len(values) or any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"a table needs increasing times and one {what} for each")
        return {"times": times, "values": values}

    return checked


def _json_table(row) -> dict:
    return {
        "type": "object",
        "properties": {
            "times": {"type": "array", "items": {"type": "number"}},
            "values": {"type": "array", "items": row},
        },
        "required": ["times", "values"],
        "additionalProperties": False,
    }


def _history(variables, free=False):
    """Three components, each a number, a formula of `variables`, a table of numbers, or maybe "free"; or one table of
    rows of three."""
    words = ("free",) if free else ()
    if "t" not in variables:
        return _or_table(list_of(_or_table(number_or_formula(variables, words)), 3))
    one = either(number, takes({"const": "free"})(lambda v: _one_of(words, v))) if free else number
    component = _or_table(number_or_formula(variables, words), _table(one, "value"), _json_table(json_of(one)))
    return _or_table(list_of(component, 3), _table(list_of(one, 3), "row of three values"))


def _one_of(words, v):
    if v not in words:
        raise ValueError
    return v


def _or_table(check, table=None, json=None):
    """What `check` takes, or what `table` does, a table over time; `json` : what editors are told of it."""

    @takes(lambda: {"anyOf": [json_of(check), *([json or json_of(table)] if table else [])]})
    def checked(v):
        return table(v) if table is not None and isinstance(v, dict) else check(v)

    return checked


def number_or_formula(variables, words=()):
    """A number, a formula of `variables`, or one of some words."""

    @takes({"type": ["number", "string"]})
    def checked(v):
        if not isinstance(v, str):
            return number(v)
        if v not in words:
            from ..config.formula import Formula

            Formula(v, variables, words)
        return v

    return checked


def _scalar(variables):
    """A number, a formula of `variables`, or a table of numbers over time."""
    return _or_table(number_or_formula(variables), _table(number, "value"))


@takes({"$ref": "#/$defs/region"})
def _region(v):
    """A region's name, or its description."""
    if isinstance(v, str):
        return string(v)
    return _shape_or_combination(v)


def _shape_or_combination(v):
    if not isinstance(v, dict):
        raise ValueError
    if set(v) & {"any", "all", "not"}:
        if len(v) != 1:
            raise ValueError("any, all and not stand alone")
        ((word, inner),) = v.items()
        return {word: _region(inner) if word == "not" else list_of(_region)(inner)}
    shape = v.get("shape")
    if shape not in SHAPES:
        raise ValueError(f"shape must be one of {', '.join(SHAPES)}")
    for key in v:
        if key != "shape" and key not in SHAPES[shape]:
            raise ValueError(f"a {shape} has no {key!r}; its keys: {', '.join(SHAPES[shape])}")
    if any(key not in v for key in _needed(shape)):
        raise ValueError(f"a {shape} needs {', '.join(_needed(shape))}")
    given = {**_ENDLESS, **v} if shape == "cylinder" else v
    return {"shape": shape, **{key: check(given[key]) for key, check in SHAPES[shape].items()}}


@takes({"type": "array", "items": {"type": ["string", "integer"]}, "minItems": 2, "maxItems": 2})
def _two_materials(v):
    named = isinstance(v, list) and all(isinstance(m, (str, int)) and not isinstance(m, bool) for m in v)
    if not named or len(v) != 2:
        raise ValueError
    if v[0] == v[1]:
        raise ValueError("an interface is between two different materials")
    return v


#: Regions hold regions: a definition of the schema that refers to itself.
REGION_JSON = {
    "anyOf": [
        {"type": "string", "pattern": r"\S"},
        *(
            {
                "type": "object",
                "properties": {"shape": {"const": shape}, **{key: json_of(check) for key, check in keys.items()}},
                "required": ["shape", *_needed(shape)],
                "additionalProperties": False,
            }
            for shape, keys in SHAPES.items()
        ),
        *(
            {"type": "object", "properties": {word: of}, "required": [word], "additionalProperties": False}
            for word, of in (
                *((w, {"type": "array", "items": {"$ref": "#/$defs/region"}, "minItems": 1}) for w in ("any", "all")),
                ("not", {"$ref": "#/$defs/region"}),
            )
        ),
    ]
}

_REGION = Key(_region, 'the name of a region, or { shape = "box", lo = [...], hi = [...] }')
_TABLE = "or { times = [...], values = [[...], ...] }"
_MOTION = Key(
    _history(("t", "x", "y", "z"), free=True), f'three of numbers, formulas of t, x, y, z and "free", {_TABLE}'
)
_PATH = Key(_history(("t",)), f"a point, three numbers or formulas of t, {_TABLE}")
_START = Key(_history(("x", "y", "z")), "three numbers or formulas of x, y, z")
_POINT = Key(_V3, "a point, e.g. [0.0, 0.0, 0.0]")
_FRICTION = Key(not_negative, "Coulomb's coefficient, a number, 0 or more, e.g. 0.3")
# When bonds break: of a material, and of an interface.
_STRENGTH = {
    "s00": Key(positive, "a critical stretch, e.g. 0.0005"),
    "Gc": Key(positive, "a fracture energy per area, greater than 0"),
    "alpha": Key(not_negative, "a number, 0 or more, e.g. 0.25"),
    "breaks": Key(boolean, "true or false"),
}


# Sections of one table.
TABLES: dict[str, dict[str, Key]] = {
    "body": {
        "region": _REGION,
        "file": Key(
            string,
            'a file of nodes: .csv, .extxyz, a LAMMPS data file (atom_style peri), or a mesh, e.g. "plate.vtu"',
            path=True,
        ),
        "spacing": Key(positive, "the distance between nodes, greater than 0"),
        "horizon": Key(positive, "a length greater than 0, e.g. 0.0015001"),
        "density": Key(positive, "a mass per volume greater than 0"),
        "volume": Key(positive, "the volume of each node, greater than 0"),
        "dimension": Key(one_of_numbers(1, 2, 3), "1, 2 or 3"),
        "plane": Key(choice(["stress", "strain"]), '"stress" or "strain"'),
        "thickness": Key(positive, "a length greater than 0 (in one dimension the cross-section)"),
        "offset": _POINT,
        "jitter": Key(not_negative, "the largest random displacement in spacings, e.g. 0.1"),
        "seed": Key(seed, "a whole number, 0 or more"),
        "cut": Key(boolean, "true or false"),
        "cell": Key(list_of(either(positive, _V3), 3), "three lengths or edge vectors of a periodic cell"),
        "origin": _POINT,
        "strain": Key(list_of(_V3, 3), "the displacement gradient of a periodic cell, three rows of three numbers"),
        "temperature": Key(
            number_or_formula(("x", "y", "z")),
            "how far it has risen, a number or a formula of x, y, z, e.g. '100*x/0.01'",
        ),
        "periodic": Key(list_of(boolean, 3), "three of true and false, e.g. [true, true, false]"),
    },
    "regions": {},
    "damage": {
        **{k: _STRENGTH[k] for k in ("s00", "Gc", "alpha")},
        "criterion": Key(choice(["stretch", "energy"]), '"stretch" or "energy", what breaks a bond'),
        "no_fail": Key(list_or_one(_region), "regions whose bonds never break"),
    },
    "contact": {
        "strength": Key(not_negative, "the multiple of the micromodulus, e.g. 15"),
        "own": Key(positive, "a share of a pair's reference distance, e.g. 0.9"),
        "reach": Key(positive, "a multiple of the sum of the radii, e.g. 1.35"),
        "skin": Key(positive, "how much further the list of pairs looks, in spacings, e.g. 0.75"),
        "friction": _FRICTION,
    },
    "run": {
        "steps": Key(count, "a number of steps, e.g. 2000"),
        "dt": Key(positive, "a time step greater than 0"),
        "safety": Key(positive, "the time step as a part of the stable one, e.g. 0.8"),
        "damping": Key(not_negative, "a rate, 0 or more"),
        "solver": Key(
            choice(["verlet", "relax", "static"]), '"verlet" (motion), "relax" or "static" (equilibrium at every step)'
        ),
        "tolerance": Key(positive, "the force left over relative to the largest one, e.g. 1e-8"),
        "iterations": Key(count, "the most iterations of one equilibrium, e.g. 50000"),
        "lammps_compat": Key(boolean, "true or false"),
        "restart": Key(string, "the restart file of an earlier run", path=True),
    },
    "output": {
        "file": Key(string, 'the file to write, e.g. "out.zarr" or "out.nc"', path=True),
        "every": Key(count, "steps between two outputs, e.g. 100"),
        "quantities": Key(list_of(string), 'a list, e.g. ["displacement", "damage"]'),
        "vtk": Key(string, 'a folder for ParaView\'s files, e.g. "disk-vtk"', path=True),
        "extxyz": Key(string, 'a file for frames, e.g. "disk.extxyz"', path=True),
        "restart": Key(string, 'a file for the state at the end, e.g. "end.npz"', path=True),
    },
    "kernel": SCENE["kernel"],
    "grid": SCENE["grid"],
    "fields": {k: SCENE["fields"][k] for k in ("quantities", "tolerance", "method", "horizon")},
}

# Sections of which there may be several, [[wall]] ... [[wall]] ...
ARRAYS: dict[str, dict[str, Key]] = {
    "material": {
        "model": Key(string, 'e.g. "pmb"'),
        "name": Key(string, 'a name for [[interface]], e.g. "glass"'),
        "id": Key(integer, "a whole number"),
        "region": _REGION,
        "conductivity": Key(positive, "power per length and temperature, greater than 0"),
        "specific_heat": Key(positive, "energy per mass and temperature, greater than 0"),
        **_STRENGTH,
    },
    "interface": {
        "between": Key(_two_materials, 'two materials by name or id, e.g. ["glass", "steel"]'),
        "bonded": Key(boolean, "true or false"),
        "stiffness": Key(positive, "how stiff its bonds are relative to the default, greater than 0, e.g. 0.1"),
        **_STRENGTH,
    },
    "notch": {
        "start": Key(list_of(number, 2), "the start of the line, [x, y]"),
        "end": Key(list_of(number, 2), "the end of the line, [x, y]"),
        "origin": _POINT,
        "a": Key(_V3, "an edge of the cut, e.g. [0.05, 0.0, 0.0]"),
        "b": Key(_V3, "the other edge of the cut, e.g. [0.0, 0.0, 0.01]"),
        "as_damage": Key(boolean, "true or false"),
    },
    "indenter": {
        "radius": Key(positive, "a length greater than 0"),
        "stiffness": Key(positive, "a force per volume and length squared"),
        "center": _PATH,
        "velocity": Key(_V3, "three numbers"),
        "axis": Key(choice(["x", "y", "z"]), '"x", "y" or "z" for a cylinder'),
        "friction": _FRICTION,
    },
    "wall": {
        "point": _PATH,
        "normal": _POINT,
        "stiffness": Key(positive, "a force per volume and length squared"),
        "velocity": Key(_V3, "three numbers"),
        "friction": _FRICTION,
    },
    "initial": {
        "region": _REGION,
        "velocity": _START,
        "displacement": _START,
    },
    "prescribed": {
        "region": _REGION,
        "velocity": _MOTION,
        "displacement": _MOTION,
        "until": Key(positive, "a time greater than 0"),
    },
    "temperature": {
        "region": _REGION,
        "value": Key(
            _scalar(("t", "x", "y", "z")), "a number, a formula of t, x, y, z, or a table of times and values"
        ),
        "until": Key(positive, "a time greater than 0"),
    },
    "heat_source": {
        "region": _REGION,
        "density": Key(_scalar(("t", "x", "y", "z")), "power per volume, a number, a formula or a table"),
        "total": Key(_scalar(("t",)), "one power shared out by volume, a number, a formula of t or a table"),
    },
    "body_force": {
        "region": _REGION,
        "density": Key(
            _history(("t", "x", "y", "z")), f"force per volume, three numbers or formulas of t, x, y, z, {_TABLE}"
        ),
        "total": Key(_history(("t",)), f"one force shared out by volume, three numbers or formulas of t, {_TABLE}"),
    },
}
