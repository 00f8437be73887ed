"""Keys of a scene that are set by flags (``--set kernel.radius=10``) or from Python."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

from ..errors import AtcError
from .schema import SCHEMA
from .toml import parse
from .words import unknown


def overridden(overrides):
    """((section, key), value, flag) of each override."""
    if not overrides:
        return
    if isinstance(overrides, Mapping):
        for dotted, value in overrides.items():
            yield _setting_path(dotted, dotted), value, dotted
        return
    for text in overrides:
        dotted, eq, value = text.partition("=")
        flag = f"--set {text}"
        if not eq:
            raise AtcError(f"{flag}: expected SECTION.KEY=VALUE, e.g. --set kernel.radius=10")
        section, key = path = _setting_path(dotted.strip(), flag)
        yield path, _typed(section, key, value.strip()), flag


def _setting_path(dotted: str, flag: str) -> tuple[str, str]:
    section, dot, key = dotted.partition(".")
    if not dot:
        homes = [s for s in SCHEMA if dotted in SCHEMA[s]]
        hint = f"did you mean {homes[0]}.{dotted}? " if homes else ""
        raise AtcError(
            f"{flag}: expected SECTION.KEY=VALUE, e.g. kernel.radius=10; {hint}got only {dotted!r} before the ="
        )
    if section not in SCHEMA:
        raise AtcError(f"{flag}: {unknown(f'section {section!r}', section, SCHEMA)}")
    if key not in SCHEMA[section]:
        raise AtcError(f"{flag}: {unknown(f'key {key!r} in [{section}]', key, SCHEMA[section])}")
    return section, key


def _typed(section: str, key: str, text: str):
    """The value a flag means: TOML where it is TOML, else the bare word; ``a,b`` where a list is wanted."""
    try:
        return parse(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        pass
    if (section, key) == ("fields", "quantities"):
        return [w.strip() for w in text.split(",") if w.strip()]
    if "," in text and not text.startswith("["):
        try:
            return parse(f"v = [{text}]")["v"]
        except tomllib.TOMLDecodeError:
            pass
    return text
