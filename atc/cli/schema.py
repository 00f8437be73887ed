"""``atc schema``: scenes and cases as JSON Schema, for editors."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class What(StrEnum):
    """Which of the two kinds of TOML file."""

    scene = "scene"
    case = "case"


def schema(what: Annotated[What, typer.Argument(help="Of scenes, or of peridynamic cases.")] = What.scene) -> None:
    """Scenes (or cases of atc pd) as JSON Schema: editors complete and check with it (for taplo and VS Code: a first
    line "#:schema FILE" in the TOML file)."""
    import json

    from ..cases.json_schema import case_schema, scene_schema

    print(json.dumps(scene_schema() if what is What.scene else case_schema(), indent=1))
