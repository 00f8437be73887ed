"""Files of OpenMM, AMBER, CHARMM and GROMACS, by OpenMM's own readers."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path

from ...errors import AtcError

#: Words of a run for what OpenMM calls nonbonded methods.
METHODS = ("NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic", "Ewald", "PME", "LJPME")
#: What holds bonds in a run, and what OpenMM calls it.
HELD = {"none": None, "hbonds": "HBonds", "allbonds": "AllBonds", "hangles": "HAngles"}
#: How Lennard-Jones forces end: OpenMM's and GROMACS's switched energy, GROMACS's and CHARMM's switched force.
SWITCHES = ("potential-switch", "force-switch", "vfswitch")
#: nm in an Å
_NM = 0.1


@dataclass(frozen=True)
class Options:
    """What a file does not say of a run; only `switching` and `chiral` go with a System or its XML.

    parameters : CHARMM's parameter files (prm, rtf, str), for a psf
    method : one of `METHODS`. cutoff, switch : Å; switch is where Lennard-Jones forces begin to end
    switching : one of `SWITCHES`
    chiral : whether torsions that tell a molecule from its mirror image (phases, CMAP) are taken, see `chiral`
    constraints : one of `HELD`. rigid_water : whether water is rigid
    defines : names that GROMACS's preprocessor knows, or {name: what it stands for}. include : the folder of its force
        fields
    """

    parameters: tuple = ()
    method: str | None = None
    cutoff: float | None = None
    switch: float | None = None
    switching: str | None = None
    chiral: bool = False
    constraints: str | None = None
    rigid_water: bool | None = None
    defines: dict | tuple | None = None
    include: str | None = None

    @classmethod
    def of(cls, source, kind: str, options: dict) -> Options:
        """Checked. Raises AtcError for a word that is not known or does not go with the source."""
        known = [f.name for f in fields(cls)]
        given = {k: v for k, v in options.items() if v is not None and v != ()}
        for key in given:
            if key not in known:
                raise AtcError(f"{key}: not known of a System of OpenMM: expected one of {', '.join(known)}")
        for key, words in (("method", METHODS), ("constraints", HELD), ("switching", SWITCHES)):
            if key not in given:
                continue
            word = {str(w).lower(): w for w in words}.get(str(given[key]).lower())
            if word is None:
                raise AtcError(f"{key} {given[key]!r}: expected one of {', '.join(words)}")
            given[key] = word
        for key in ("cutoff", "switch"):
            value = given.get(key, 1.0)
            if not (isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf")):
                raise AtcError(f"{key} {value!r}: expected a length in Å")
        if isinstance(given.get("parameters"), str | os.PathLike):
            given["parameters"] = (given["parameters"],)
        for key in given:
            if key not in ("switching", "chiral") and kind == "openmm":
                raise AtcError(f"{key}: leave it out: {_name(source)} is a whole System, which says it itself")
        for key, of in (("parameters", "psf"), ("defines", "top"), ("include", "top")):
            if key in given and kind != of:
                raise AtcError(f"{key} goes with a {of} file, not with {_name(source)}")
        out = cls(**{**given, "parameters": tuple(given.get("parameters", ()))})
        if kind != "openmm":
            out._need(_name(source), kind)
        return out

    def _need(self, name, kind):
        if self.method is None:
            raise AtcError(
                f"{name}: the file does not say how the run summed its nonbonded forces: give method, one of "
                f"{', '.join(METHODS)}"
            )
        if self.method != "NoCutoff" and self.cutoff is None:
            raise AtcError(f"{name}: method {self.method} needs the cutoff of the run, in Å")
        if self.switch is not None and not (self.cutoff is not None and self.switch < self.cutoff):
            raise AtcError(f"{name}: switch {self.switch:g} must be less than the cutoff")
        if kind == "psf" and not self.parameters:
            raise AtcError(f"{name}: a psf needs parameters, its CHARMM files (prm, rtf, str)")


def kind_of(source) -> str:
    """ "openmm", "prmtop", "psf" or "top"."""
    if not isinstance(source, str | os.PathLike):
        return "openmm"
    path = Path(source)
    suffix = path.suffix.lower()
    if suffix in (".prmtop", ".parm7"):
        return "prmtop"
    if suffix == ".top":  # AMBER's have that name, too
        return "prmtop" if _head(path).lstrip().startswith("%VERSION") else "top"
    return {".psf": "psf", ".xml": "openmm"}[suffix]


def _head(path) -> str:
    try:
        with open(path, encoding="utf-8", errors="replace") as f:
            return f.read(4096)
    except OSError:
        return ""


def _name(source) -> str:
    return str(source) if isinstance(source, str | os.PathLike) else "the System of OpenMM"


def system_of(source, kind: str, options: Options):
    """(System, what to call it). Raises AtcError without OpenMM, for files that are not there or are not understood."""
    try:
        import openmm
    except ImportError:
        raise AtcError(f"{_name(source)}: reading it needs OpenMM: pip install openmm") from None
    name = _name(source)
    if not isinstance(source, str | os.PathLike):
        return source, name
    files = [Path(source), *map(Path, options.parameters)]
    for file in files:
        if not os.path.isfile(file):
            raise AtcError(f"{file}: no such file")
    try:
        if kind == "openmm":
            return _from_xml(openmm, Path(source), name), name
        return {"prmtop": _from_prmtop, "psf": _from_psf, "top": _from_top}[kind](str(source), options), name
    except AtcError:
        raise
    except Exception:
        raise AtcError(f"{name}: OpenMM's reader does not understand it: {_HINTS[kind]}") from None


#: What a file mostly lacks that a reader of OpenMM does not take.
_HINTS = {
    "openmm": "expected what openmm.XmlSerializer.serialize(system) writes, of a version that is not newer than the "
    "OpenMM here",
    "prmtop": "expected a whole parameter and topology file of AMBER 7 or newer",
    "psf": "expected a psf whose types and parameters are all in the files of parameters",
    "top": "expected a topology of GROMACS with all it includes (give include and defines as for grompp), every type "
    "and every molecule's parameters; what 'gmx grompp -pp' writes is whole",
}


def _from_xml(openmm, path, name):
    head = _head(path)
    if "<ForceField" in head:
        raise AtcError(
            f"{name}: a force field, not a System: make one with its createSystem, and write it with "
            "openmm.XmlSerializer.serialize(system)"
        )
    system = openmm.XmlSerializer.deserialize(path.read_text(encoding="utf-8"))
    if type(system).__name__ != "System":
        raise AtcError(f"{name}: holds a {type(system).__name__}, not a System of OpenMM")
    return system


def _arguments(options: Options) -> dict:
    """Of createSystem."""
    from openmm import app, unit

    out = {"nonbondedMethod": getattr(app, options.method), "removeCMMotion": False}
    if options.cutoff is not None:
        out["nonbondedCutoff"] = options.cutoff * _NM * unit.nanometer
    if options.switch is not None:
        out["switchDistance"] = options.switch * _NM * unit.nanometer
    held = HELD[options.constraints or "none"]
    if held is not None:
        out["constraints"] = getattr(app, held)
    if options.rigid_water is not None:
        out["rigidWater"] = options.rigid_water
    return out


def _box(options: Options):
    """Some periodic box, which readers ask for; each frame brings its own."""
    import openmm
    from openmm import unit

    edge = max(4.0 * (options.cutoff or 0.0) * _NM, 10.0)
    return tuple(openmm.Vec3(*(edge * (k == c) for c in range(3))) for k in range(3)) * unit.nanometer


def _periodic(options: Options) -> bool:
    return options.method in ("CutoffPeriodic", "Ewald", "PME", "LJPME")


def _from_prmtop(path, options):
    from openmm import app

    file = app.AmberPrmtopFile(path)
    if _periodic(options):
        file.topology.setPeriodicBoxVectors(_box(options))
    return file.createSystem(**_arguments(options))


def _from_psf(path, options):
    from openmm import app, unit

    file = app.CharmmPsfFile(path)
    if _periodic(options):
        edge = _box(options)[0][0].value_in_unit(unit.nanometer) * unit.nanometer
        file.setBox(edge, edge, edge)
    parameters = app.CharmmParameterSet(*map(str, options.parameters))
    return file.createSystem(parameters, **_arguments(options))


def _from_top(path, options):
    from openmm import app

    if _head(Path(path)).lstrip().startswith("%VERSION"):
        raise AtcError(f"{path}: a file of AMBER, not of GROMACS: give it as prmtop")
    more = {} if options.include is None else {"includeDir": str(options.include)}
    defines = options.defines if isinstance(options.defines, dict) else dict.fromkeys(options.defines or (), "")
    box = {"periodicBoxVectors": _box(options)} if _periodic(options) else {}
    file = app.GromacsTopFile(path, defines=defines, **box, **more)
    return file.createSystem(**_arguments(options))
