"""The tables of commands and fixes as docs/lammps.md prints them: ``python -m atc.decomposers.lammps.tables`` writes
them anew."""

from __future__ import annotations

from .commands import _CLASSES as COMMAND_CLASSES
from .fixes import _CLASSES as FIX_CLASSES

_COMMANDS = {
    "model": "understood", "atoms": "understood, or unknown with the reason", "control": "executed", "run": "a run",
    "fix": "see below", "harmless": "changes no force of a frame", "refused": "refused",
}  # fmt: skip
_FIXES = {
    "harmless": "changes no force of a frame",
    "outside": "a force from outside: noted, no part of the stress",
    "constraint": "forces between atoms, found for every frame (constraints.md)",
    "held": "refused",
    "model": "refused",
    "charges": "charges: only if the frames show them",
    "types": "types and charges: only if the frames show them",
    "atoms": "atoms: only if the frames show them and there are no bonds",
    "bonds": "bonds: only if a data file of that moment is named",
    "set": "properties: only if the frames show them",
}
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"


def _table(classes, words) -> list[str]:
    out = ["| | reason | names |", "|---|---|---|"]
    for kind, groups in classes.items():
        for k, (reason, names) in enumerate(groups):
            shown = " ".join(f"`{n}`" for n in sorted(names.split()))
            out.append(f"| {words[kind] if not k else ''} | {reason} | {shown} |")
    return out


def tables() -> str:
    """Both tables as Markdown."""
    lines = [
        BEGIN,
        "",
        "### Commands",
        "",
        *_table(COMMAND_CLASSES, _COMMANDS),
        "",
        "### Fixes",
        "",
        *_table(FIX_CLASSES, _FIXES),
        "",
        END,
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    from pathlib import Path

    path = Path("docs/lammps.md")
    text = path.read_text()
    path.write_text(text[: text.index(BEGIN)] + tables() + text[text.index(END) + len(END) :])
