"""Systems of OpenMM as potentials: by OpenMM's readers also those of AMBER, CHARMM and GROMACS.

Each Force of a System becomes terms of this package; one that has no counterpart is refused by its name. OpenMM is
needed for reading only, and by no frame.
"""

from __future__ import annotations

import os
from pathlib import Path

#: Endings of files that OpenMM's readers open.
SUFFIXES = (".xml", ".prmtop", ".parm7", ".psf", ".top")


def is_openmm(source) -> bool:
    """Whether a source of `atc.potential` is a System of OpenMM, or a file that one is made from."""
    if isinstance(source, str | os.PathLike):
        text = os.fspath(source)
        return isinstance(text, str) and "\n" not in text and Path(text).suffix.lower() in SUFFIXES
    return type(source).__name__ == "System" and type(source).__module__.split(".")[0] == "openmm"


def potential_from_openmm(source, kind: str | None = None, **options):
    """A System, or a file, as a `Potential`; options as of `load.Options`.

    kind : what the file is, "openmm" (XML), "prmtop", "psf" or "top"; default: by its ending
    """
    from .load import Options, kind_of, system_of
    from .system import potential_of

    kind = kind_of(source) if kind is None else kind
    made = Options.of(source, kind, options)
    system, name = system_of(source, kind, made)
    pot = potential_of(system, name, made.switching, made.chiral)
    if pot.constraints is not None and kind != "openmm":
        # Readers hold water rigid unless told otherwise; a run input that says what was held knows better.
        pot.constraints.assumed = made.constraints is None and made.rigid_water is None
    return pot
