"""Scenes and cases as JSON Schema: what editors complete and check while a person writes. Made from what atc itself
checks by, key by key; rules between keys are atc's own."""

from __future__ import annotations

from ..config.checks import json_of
from ..config.schema import GRIDS
from ..config.schema import SCHEMA as SCENE
from .crystals import KEYS
from .schema import ARRAYS, REGION_JSON, TABLES


def _object(properties: dict) -> dict:
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _document(title: str, description: str, sections: dict) -> dict:
    draft = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": draft, "title": title, "description": description, **_object(sections)}


def _section(keys: dict) -> dict:
    return _object({k: {**json_of(key.check), "description": key.expected} for k, key in keys.items()})


def _known(section: dict, key: str, names) -> None:
    """Names that an editor can offer, where the check itself stands elsewhere."""
    description = section["properties"][key]["description"]
    names = {"anyOf": [{"enum": list(names)}, {"type": "string", "pattern": "^column:"}]} if key == "quantities" else {
        "enum": list(names)
    }  # fmt: skip
    one_or_more = {"anyOf": [names, {"type": "array", "items": names, "minItems": 1}]}
    section["properties"][key] = (one_or_more if key == "quantities" else names) | {"description": description}


def scene_schema() -> dict:
    """The schema of scenes (``atc fields SCENE``)."""
    from ..estimators.registry import QUANTITIES
    from ..kernels import known

    sections = {name: _section(keys) for name, keys in SCENE.items()}
    _known(sections["fields"], "quantities", QUANTITIES)
    _known(sections["kernel"], "name", known())
    sections["kernel"]["required"] = ["name"]
    grid = sections["grid"]
    grid["required"] = ["kind"]
    grid["allOf"] = [
        {"if": {"properties": {"kind": {"const": kind}}}, "then": _grid_rule(needs, may)}
        for kind, (needs, may) in GRIDS.items()
    ]
    what = "What atc is to compute: a TOML file for atc plan, fields, check, profile, ..."
    return _document("atc scene", what, sections)


def _grid_rule(needs, may) -> dict:
    options = [need if isinstance(need, tuple) else (need,) for need in needs]
    names = ["kind", *(k for option in options for k in option), *may]
    rule: dict = {"propertyNames": {"enum": names}}
    if options:
        rule["allOf"] = [{"oneOf": [{"required": [k]} for k in option]} for option in options]
    return rule


def case_schema() -> dict:
    """The schema of peridynamic cases (``atc pd CASE``)."""
    sections = {name: _section(keys) for name, keys in TABLES.items()}
    sections["regions"] = {"type": "object", "additionalProperties": {"$ref": "#/$defs/region"}}
    for name, keys in ARRAYS.items():
        one = _section(keys)
        if name == "material":  # a law's own constants: as the law names them
            one.pop("additionalProperties")
            for constants in KEYS.values():
                one["properties"] |= _section(constants)["properties"]
        sections[name] = {"anyOf": [one, {"type": "array", "items": one}]}
    what = "A peridynamic body and what happens to it: a TOML file for atc pd"
    return {**_document("atc pd case", what, sections), "$defs": {"region": REGION_JSON}}
