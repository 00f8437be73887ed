"""TOML beyond `tomllib`: on which line a key stands, what was wrong in plain words, and writing values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import date, time

#: Bytes of the largest scene or case.
LONGEST = 1 << 24

# --------------------------------------------------------------------------------------------------------------------
# Where in the text a key stands.


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """Line numbers (from 1) of every table header and key of a TOML text, by dotted path: ``("kernel", "radius") → 7``.

    Tables of an array, ``[[wall]]``, are numbered: ``("wall", "0", "normal") → 12``.

    A scan, not a parser: it is only asked about texts that `tomllib` has already accepted.
    """
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    counts: dict[tuple[str, ...], int] = {}
    depth, quote, number, i, n = 0, "", 1, 0, len(text)
    line_start = True
    while i < n:
        c = text[i]
        if quote:  # inside a string, maybe one that runs over lines
            if c == "\\" and quote[0] == '"':
                number += text[i + 1 : i + 2] == "\n"
                i += 2
                continue
            if text.startswith(quote, i):
                i += len(quote)
                while (
                    len(quote) == 3 and text[i : i + 1] == quote[0]
                ):  # a multi-line string may end in up to two quotes of its own
                    i += 1
                quote = ""
                continue
        elif c == "#":
            i = text.find("\n", i)
            if i < 0:
                break
            continue
        elif line_start and depth == 0 and not c.isspace():
            end = text.find("\n", i)
            head = text[i : end if end >= 0 else n]
            if c == "[":
                table, _ = _dotted(head.strip("[ \t"))
                found.setdefault(table, number)
                if head.startswith("[["):
                    array, count = table, counts.get(table, 0)
                    counts[array], table = count + 1, (*array, str(count))
                    found[table] = number
                i = end if end >= 0 else n
                continue
            path, length = _dotted(head)
            for k in range(1, len(path) + 1):
                found.setdefault(table + path[:k], number)
            line_start = False
            i += length
            continue
        elif c in "\"'":
            quote = c * 3 if text.startswith(c * 3, i) else c
            i += len(quote)
            continue
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "\n":
            number += 1
            line_start = True
        i += 1
    return found


def _dotted(head: str) -> tuple[tuple[str, ...], int]:
    """The dotted key at the start of `head`, up to ``=`` or ``]``, and how many characters it takes with that."""
    parts, part, quote, length = [], "", "", 0
    for c in head:
        length += 1
        if quote:
            if c == quote:
                quote = ""
            else:
                part += c
        elif c in "\"'":
            quote = c
        elif c in "=]#":
            break
        elif c == ".":
            parts.append(part)
            part = ""
        elif not c.isspace():
            part += c
    return (*parts, part), length


# --------------------------------------------------------------------------------------------------------------------
# Writing TOML.


def _toml_string(s: str, over_lines: bool = False) -> str:
    escapes = {"\\": "\\\\", '"': '\\"', "\b": "\\b", "\t": "\\t", "\f": "\\f", "\r": "\\r"}
    escapes["\n"] = "\n" if over_lines else "\\n"
    out = "".join(escapes.get(c) or (f"\\u{ord(c):04X}" if ord(c) < 32 or ord(c) == 127 else c) for c in s)
    return f'"""\n{out}"""' if over_lines else f'"{out}"'


def toml_key(k: str) -> str:
    """A key as TOML writes it, in quotes where it needs them."""
    bare = k and all(c.isascii() and (c.isalnum() or c in "-_") for c in k)
    return k if bare else _toml_string(k)


def toml_value(v) -> str:
    """One value as TOML."""
    if isinstance(v, bool):
        return "true" if v else "false"
    if isinstance(v, (int, float)):
        return repr(v)
    if isinstance(v, str):
        return _toml_string(v, over_lines="\n" in v)
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(toml_value(x) for x in v) + "]"
    if isinstance(v, Mapping):
        return "{ " + ", ".join(f"{toml_key(str(k))} = {toml_value(x)}" for k, x in v.items()) + " }"
    if isinstance(v, (date, time)):  # a datetime is a date
        return v.isoformat()
    raise TypeError(f"{type(v).__name__} has no TOML form")


def toml_document(sections: Mapping[str, Mapping | list[Mapping]]) -> str:
    """Sections as TOML, of a list of tables one each; what stands at the key "#" as a comment."""
    out = []
    for name, given in sections.items():
        for table in given if isinstance(given, list) else [given]:
            lines = (f"# {v}" if k == "#" else f"{toml_key(k)} = {toml_value(v)}" for k, v in table.items())
            out += [f"[[{name}]]" if isinstance(given, list) else f"[{name}]", *lines, ""]
    return "\n".join(out)


def shown(value) -> str:
    """A value in a message: as TOML where it has such a form, in one line, not long."""
    try:
        text = toml_value(value)
    except TypeError:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def parse(text: str) -> dict:
    """`tomllib.loads`, whose only exception is `tomllib.TOMLDecodeError`."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError("brackets are nested too deeply") from None


def complaint(name: str, text: str, e: Exception) -> str:
    """tomllib's complaint with the line first, and what most often is the reason."""
    message = str(e)
    line = getattr(e, "lineno", None)
    if line is None and "(at line " in message:
        line = int(message.rpartition("(at line ")[2].split(",")[0])
    elif line is None and "(at end of document)" in message:
        line = text.count("\n") + 1
    reason = message.rpartition(" (at ")[0] or message
    source = text.split("\n")[line - 1].strip() if line and line <= text.count("\n") + 1 else ""
    value = source.partition("=")[2].strip()
    if reason == "Invalid value" and value[:1].isalpha():
        reason = f"invalid value {value[:40]}: text needs quotes"
    return f"{name}{f':{line}' if line else ''}: not valid TOML: {reason[:1].lower() + reason[1:]}"
