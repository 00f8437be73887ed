"""Keys of a scene or case that are set by flags (``--set kernel.radius=10``) or from Python."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

from ..errors import AtcError
from .toml import parse
from .words import unknown


def overridden(overrides, document):
    """((section, key), value, flag) of each override of a document."""
    if isinstance(overrides, Mapping):
        for dotted, value in overrides.items():
            yield _setting_path(dotted, dotted, document), value, dotted
        return
    for text in overrides or ():
        dotted, eq, value = text.partition("=")
        flag = f"--set {text}"
        if not eq:
            raise AtcError(f"{flag}: expected SECTION.KEY=VALUE, e.g. --set {document.example}")
        path = _setting_path(dotted.strip(), flag, document)
        yield path, _typed(path[1], value.strip()), flag


def _setting_path(dotted: str, flag: str, document) -> tuple[str, str]:
    tables = document.tables
    section, dot, key = dotted.partition(".")
    if section in document.arrays:
        why = f"there may be several [[{section}]]: edit the {document.what}"
        raise AtcError(f"{flag}: expected SECTION.KEY=VALUE with a section of which there is one; {why}")
    if not dot:
        homes = [s for s in tables if dotted in tables[s]]
        hint = f"did you mean {homes[0]}.{dotted}? " if homes else ""
        raise AtcError(
            f"{flag}: expected SECTION.KEY=VALUE, e.g. {document.example}; {hint}got only {dotted!r} before the ="
        )
    if section not in tables:
        raise AtcError(f"{flag}: {unknown(f'section {section!r}', section, tables)}")
    if key not in tables[section] and tables[section]:  # names of regions are anybody's
        raise AtcError(f"{flag}: {unknown(f'key {key!r} in [{section}]', key, tables[section])}")
    return section, key


def _typed(key: str, text: str):
    """The value a flag means: TOML where it is TOML, else the bare word; ``a,b`` where a list is wanted."""
    try:
        return parse(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        pass
    if key == "quantities":
        return [w.strip() for w in text.split(",") if w.strip()]
    if "," in text and not text.startswith("["):
        try:
            return parse(f"v = [{text}]")["v"]
        except tomllib.TOMLDecodeError:
            pass
    return text
