"""What a scene may hold: its sections and keys, what values they take, which kinds of grid there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from .words import frame_slice, guess

# --------------------------------------------------------------------------------------------------------------------
# Checks of single values: each returns the value in its normal form, or raises ValueError (with a text: why not).


def described(check, json):
    """A check that says what it takes as JSON Schema (for editors), too: `json`, or a function that gives it."""
    check.json = json
    return check


def json_of(check) -> dict:
    """What a check takes, as JSON Schema; {} (anything) of those that do not say."""
    json = getattr(check, "json", {})
    return json() if callable(json) else dict(json)


def _string(v):
    if not isinstance(v, str) or not v.strip():
        raise ValueError
    return v


def _influence(v):
    """The name of an influence function, or its formula."""
    from ..pd.materials.influence import INFLUENCE
    from .formula import INFLUENCE_LETTERS, Formula

    if _string(v) in INFLUENCE:
        return v
    if v.isidentifier() and v not in INFLUENCE_LETTERS:
        raise ValueError(f"{guess(v, INFLUENCE)}known: {', '.join(INFLUENCE)}")
    Formula(v, INFLUENCE_LETTERS)
    return v


described(_influence, {"type": "string", "pattern": r"\S"})
#: How a bond's weight depends on it.
INFLUENCE_EXPECTED = (
    "'one', 'inverse', 'linear', 'quadratic', 'gaussian', or a formula of r and delta, or of x, y, z too, e.g. "
    "'exp(-(2*r/delta)**2)'"
)


def _boolean(v):
    if not isinstance(v, bool):
        raise ValueError
    return v


def _a_number(types, good=lambda v: True, why="", **json):
    """A check of a finite number of these types that is `good`; `why`: what it must be."""

    def checked(v):
        if isinstance(v, bool) or not isinstance(v, types) or v != v or v in (float("inf"), float("-inf")):
            raise ValueError
        if not good(v):
            raise ValueError(why)
        return v

    return described(checked, {"type": "integer" if types is int else "number", **json})


_REAL = (int, float)
_number = _a_number(_REAL)
_not_negative = _a_number(_REAL, lambda v: v >= 0, "it must not be negative", minimum=0)
_positive = _a_number(_REAL, lambda v: v > 0, "it must be greater than 0", exclusiveMinimum=0)
_part = _a_number(_REAL, lambda v: 0 < v <= 1, "it must be greater than 0, at most 1", exclusiveMinimum=0, maximum=1)
_tolerance = _a_number(
    _REAL,
    lambda v: 0 < v < 1,
    "it must lie between 0 and 1 (1e-12 means the exact sum)",
    exclusiveMinimum=0,
    exclusiveMaximum=1,
)
_integer = _a_number(int)
_count = _a_number(int, lambda v: v >= 1, "it must be at least 1, or there is nothing to compute", minimum=1)
_seed = _a_number(int, lambda v: v >= 0, "it must not be negative", minimum=0)


def _list_of(check, length=None):
    def checked(v):
        if not isinstance(v, list) or (length is not None and len(v) != length) or not v:
            raise ValueError
        return [check(x) for x in v]

    sizes = {"minItems": length, "maxItems": length} if length is not None else {"minItems": 1}
    return described(checked, lambda: {"type": "array", "items": json_of(check), **sizes})


def _either(*checks):
    def checked(v):
        reason = ""
        for check in checks:
            try:
                return check(v)
            except ValueError as e:
                reason = reason or str(e)
        raise ValueError(reason)

    return described(checked, lambda: {"anyOf": [json_of(check) for check in checks]})


def _choice(choices: Callable[[], list[str]] | list[str]):
    def checked(v):
        if not isinstance(v, str):
            raise ValueError
        known = choices() if callable(choices) else choices
        if v not in known:
            raise ValueError(f"{guess(v, known)}known: {', '.join(known)}")
        return v

    return described(checked, lambda: {"enum": list(choices() if callable(choices) else choices)})


def _choice_of(module: str, *names: str):
    """One of the words that these collections in a module of atc hold; it is imported when it is asked."""

    def known():
        found = import_module(f"atc.{module}")
        return [word for name in names for word in getattr(found, name)]

    return _choice(known)


def _dimension(v):
    if isinstance(v, bool) or v not in (2, 3) or not isinstance(v, int):
        raise ValueError
    return v


def _axis(v):
    if isinstance(v, str) and v.lower() in ("x", "y", "z", "a", "b", "c"):
        return v.lower()
    if isinstance(v, int) and not isinstance(v, bool) and v in (0, 1, 2):
        return v
    raise ValueError


def _frames(v):
    """A slice string, a table {begin, end, step} or one index, kept as written once it is known to be well formed."""
    frame_slice(v)
    return v


def _table_of(check, fewest: int = 0):
    """A table with so many keys at least, of any name."""

    def checked(v):
        if not isinstance(v, dict) or len(v) < fewest:
            raise ValueError
        return {str(k): check(x) for k, x in v.items()}

    sizes = {"minProperties": fewest} if fewest else {}
    return described(checked, lambda: {"type": "object", "additionalProperties": json_of(check), **sizes})


def _partition(v):
    if isinstance(v, dict) and v:
        return {str(k): w if isinstance(w, list) else _string(w) for k, w in v.items()}
    return _string(v)


def _atom_style(v):
    from ..errors import AtcError
    from ..readers.lammps.atom_styles import AtomStyle

    try:
        return AtomStyle(_string(v), "").given
    except AtcError:
        raise ValueError from None


def _output_units(v):
    from ..errors import AtcError
    from ..units.words import wanted_units

    try:
        wanted_units(_string(v))
    except AtcError as e:
        raise ValueError(str(e)) from None
    return v


# --------------------------------------------------------------------------------------------------------------------
# What a scene may hold.


for _check, _json in (
    (_string, {"type": "string", "pattern": r"\S"}),
    (_boolean, {"type": "boolean"}),
    (_dimension, {"enum": [2, 3]}),
    (_axis, {"enum": [*"xyzabcXYZABC", 0, 1, 2]}),
    (_atom_style, {"type": "string", "pattern": r"\S"}),
    (_partition, {"anyOf": [{"type": "string"}, {"type": "object", "minProperties": 1}]}),
):
    described(_check, _json)
_SLICE = {k: {"type": "integer"} for k in ("begin", "end", "step")}
described(
    _frames,
    {
        "anyOf": [
            {"type": "integer"},
            {"type": "string", "pattern": r"^\s*-?\d*\s*(:\s*-?\d*\s*){0,2}$"},
            {"type": "object", "properties": _SLICE, "additionalProperties": False},
        ]
    },
)


@dataclass(frozen=True)
class Key:
    check: Callable[[Any], Any]
    expected: str
    path: bool = False  # a file name (when it is a string), relative to the scene


_UNITS = Key(_choice_of("units", "_SYSTEMS"), 'a unit style, e.g. "metal"')
_TIMESTEP = Key(_positive, "the time of one step in the trajectory's units, e.g. 0.001")
_YES = Key(_boolean, "true or false")
_STRINGS = _either(_string, _list_of(_string))
_VECTOR3 = _list_of(_number, 3)
_LENGTH3 = _either(_positive, _list_of(_positive, 3), _list_of(_positive, 2))
_VECTOR = _either(_VECTOR3, _list_of(_number, 2))  # two numbers in two dimensions

SCHEMA: dict[str, dict[str, Key]] = {
    "trajectory": {
        "file": Key(
            _STRINGS,
            'a file name, a pattern or a list of names, e.g. "run.dump", "dump.*" or ["a.dump", "b.dump"]',
            path=True,
        ),
        "topology": Key(_string, 'the name of a LAMMPS data file, e.g. "run.data"', path=True),
        "atom_style": Key(_atom_style, 'the atom_style of the LAMMPS run, e.g. "full" or "hybrid sphere molecular"'),
        "units": _UNITS,
        "masses": Key(
            _either(_list_of(_positive), _table_of(_positive, 1)),
            "a mass for each type, e.g. { 1 = 28.0855 } or [28.0855]",
        ),
        "cell": Key(
            _either(_list_of(_positive, 3), _list_of(_VECTOR3, 3), _list_of(_list_of(_number, 2), 3)),
            "the cell of files that have none: three lengths, edge vectors or pairs [lo, hi], e.g. [20.0, 20.0, 40.0]",
        ),
        "pbc": Key(
            _either(_string, _boolean, _list_of(_boolean, 3)),
            'which axes repeat, where the file does not say it, e.g. "ppf" or [true, true, false]',
        ),
        "timestep": Key(
            _positive, "the time of one step in the trajectory's units, for files with steps and no times, e.g. 0.001"
        ),
        "dimension": Key(_dimension, "2 (a run in the plane, LAMMPS's dimension 2) or 3"),
        "frames": Key(_frames, 'frames counted from 0, e.g. "100:500:5", { begin = 100, end = 500, step = 5 } or -1'),
        "reference": Key(
            _either(_integer, _string),
            'the index of the reference frame, or the file that holds it, e.g. 0 or "start.data"',
            path=True,
        ),
        "forces": Key(
            _choice_of("agreement.forces", "MODES"),
            'what to do where the run\'s forces are not the potential\'s: "warn", "must agree" or "ignore"',
        ),
        "log": Key(
            _STRINGS,
            'the LAMMPS log file of the run, or a list of them, e.g. "log.lammps"',
            path=True,
        ),
    },
    "potential": {
        "lammps": Key(_string, "LAMMPS lines, e.g. '''pair_style sw\\npair_coeff * * Si.sw Si'''"),
        "input": Key(_string, 'the name of a LAMMPS input script, e.g. "in.run"', path=True),
        "nep": Key(_string, 'the file of a neuroevolution potential, e.g. "nep.txt"', path=True),
        "mace": Key(_string, 'the file of a MACE model, e.g. "my.model"', path=True),
        "nequip": Key(_string, 'the file of a NequIP or Allegro model, e.g. "my.nequip.zip"', path=True),
        "kim": Key(_string, 'a model of the KIM archive, e.g. "SW_StillingerWeber_1985_Si__MO_405512056662_005"'),
        "metatomic": Key(_string, 'the file of a model exported by metatomic, e.g. "model.pt"', path=True),
        "openmm": Key(_string, 'the XML file of a System of OpenMM, e.g. "system.xml"', path=True),
        "prmtop": Key(_string, 'a parameter and topology file of AMBER, e.g. "complex.prmtop"', path=True),
        "psf": Key(_string, 'a structure file of CHARMM or NAMD, e.g. "step5.psf", with parameters', path=True),
        "top": Key(_string, 'a topology of GROMACS, e.g. "topol.top"', path=True),
        "parameters": Key(
            _STRINGS,
            'the CHARMM files of a psf, e.g. ["par_all36_prot.prm", "top_all36_prot.rtf"]',
            path=True,
        ),
        "method": Key(
            _choice(["NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic", "Ewald", "PME", "LJPME"]),
            'how the run summed nonbonded forces, e.g. "PME"',
        ),
        "cutoff": Key(_positive, "the cutoff of the run in angstrom, e.g. 9.0"),
        "switch": Key(_positive, "where Lennard-Jones forces begin to end, in angstrom, e.g. 8.0"),
        "switching": Key(
            _choice(["potential-switch", "force-switch", "vfswitch"]),
            'how Lennard-Jones forces end: "potential-switch", "force-switch" (GROMACS) or "vfswitch" (CHARMM)',
        ),
        "chiral": Key(
            _boolean, "whether torsions that tell a molecule from its mirror image are taken, by forces across bonds"
        ),
        "constraints": Key(
            _choice(["none", "hbonds", "allbonds", "hangles"]), 'which bonds the run held, e.g. "hbonds"'
        ),
        "rigid_water": Key(_boolean, "whether the run held water rigid: true or false"),
        "defines": Key(_list_of(_string), 'names that GROMACS\'s preprocessor knows, e.g. ["POSRES"]'),
        "include": Key(_string, "the folder of GROMACS's force fields", path=True),
        "head": Key(_string, 'which head of a MACE model, e.g. "Default"'),
        "stress": Key(
            _choice(["edge", "central"]), 'how a learned model of one hop gives its stress: "edge" or "central"'
        ),
        "reference": Key(
            _either(_choice(["isolated"]), _table_of(_number, 1)),
            'the energies of single atoms to subtract: "isolated" (the model says) or, by element, { Si = -163.2 }',
        ),
        "device": Key(_string, 'where torch computes, e.g. "cpu" or "cuda"'),
        "types": Key(_list_of(_string), 'the element of each atom type in the potential\'s names, e.g. ["Te", "Pb"]'),
        "units": _UNITS,
        "run": Key(_count, "the number of the script's run that the frames belong to, counted from 1, e.g. 2"),
        "partition": Key(
            _partition,
            'how energy is shared among atoms: "equal", "center", or by kind of term, e.g. { "angle" = "center" }',
        ),
        "alpha": Key(
            _positive, "a number greater than 0, 1 over a length: where long-range Coulomb is split, e.g. 0.3"
        ),
    },
    "constraints": {
        "bonds": Key(
            _choice(["hbonds", "allbonds"]), '"hbonds": all bonds of hydrogen are held, "allbonds": all bonds'
        ),
        "rigid_water": Key(_boolean, "whether the angle of water molecules is held, too: true or false"),
        "molecules": Key(
            _either(_boolean, _list_of(_integer)),
            "true (every molecule is a rigid body) or the numbers of those that are, e.g. [1, 2]",
        ),
        "pairs": Key(
            _either(_string, _list_of(_list_of(_count, 2))),
            "pairs of atom ids whose distance is held, e.g. [[1, 2], [1, 3]], or a file of two columns",
            path=True,
        ),
        "topology": Key(_boolean, "whether a .tpr topology says what is held, where nothing else does: true or false"),
        "source": Key(
            _choice_of("decomposers.constraints.held", "SOURCES"),
            'what constraint forces are found from, e.g. "forces"',
        ),
        "temperature": Key(
            _positive, "a temperature greater than 0, for constraint forces that are right on average only"
        ),
        "timestep": Key(_positive, "the time of one step of the run in the trajectory's units, e.g. 2.0"),
        "leapfrog": Key(_boolean, "whether velocities are half a step behind positions (GROMACS's md): true or false"),
        "in_forces": Key(
            _boolean, "whether the trajectory's forces contain those of constraints (LAMMPS: true; GROMACS: false)"
        ),
    },
    "kernel": {
        "name": Key(_string, 'the name of a kernel, e.g. "quartic"'),
        "radius": Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 8.0"),
        "width": Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 3.0"),
        "size": Key(
            _LENGTH3, "one or three lengths greater than 0 (one or two in two dimensions), e.g. [5.0, 5.0, 5.0]"
        ),
        "table": Key(
            _either(_string, _list_of(_list_of(_number))),
            "a file of r and phi(r) in two columns, or the pairs [[r, phi], ...]",
            path=True,
        ),
    },
    "grid": {
        "kind": Key(_choice(lambda: list(GRIDS)), 'the kind of grid, e.g. "regular"'),
        "shape": Key(_either(_count, _list_of(_count)), "how many points along each axis, e.g. [40, 40, 20]"),
        "spacing": Key(
            _either(_positive, _list_of(_positive)), "the distance between points, greater than 0, e.g. 2.0"
        ),
        "at": Key(_choice(["centers", "corners"]), '"centers" or "corners"'),
        "padding": Key(
            _either(_choice(["auto"]), _number),
            'how far the grid reaches beyond open faces of the cell: a length, or "auto" for the reach of the kernel',
        ),
        "origin": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "vectors": Key(
            _list_of(_either(_positive, _VECTOR)),
            "edge vectors, e.g. [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.0, 20.0]]",
        ),
        "axis": Key(_axis, 'an axis of the cell, e.g. "z"'),
        "position": Key(_number, "a distance from the cell's face along axis, e.g. 12.5"),
        "u": Key(_VECTOR, "an edge vector, e.g. [40.0, 0.0, 0.0]"),
        "v": Key(_VECTOR, "an edge vector, e.g. [0.0, 40.0, 0.0]"),
        "start": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "end": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 50.0]"),
        "n": Key(_count, "a number of points, e.g. 100"),
        "bins": Key(_count, "a number of bins, e.g. 100"),
        "means": Key(_boolean, "true (values of bins are means over their width) or false (at their centres)"),
        "positions": Key(_list_of(_number), "coordinates of planes along axis, ascending, e.g. [10.0, 12.5, 15.0]"),
        "patches": Key(_list_of(_count, 2), "into how many parts each plane is cut along the two edges, e.g. [4, 4]"),
        "interval": Key(
            _either(_choice(["frames"]), _positive),
            'the time over which passages through planes are counted, e.g. 0.001, or "frames": from frame to frame',
        ),
        "follow": Key(
            _choice(["mass", "+x", "-x", "+y", "-y", "+z", "-z"]),
            'what the grid moves with: "mass", the centre of mass of the atoms, or of those selected; "+z", "-x", ...: '
            "the interface on this side of the denser phase",
        ),
        "center": Key(_VECTOR3, "a point, e.g. [20.0, 20.0, 10.0]"),
        "radius": Key(_positive, "a length greater than 0, e.g. 15.0"),
        "inner": Key(_not_negative, "a length, the radius where the grid begins, e.g. 5.0"),
        "length": Key(_positive, "a length greater than 0, along the axis, e.g. 40.0"),
        "points": Key(
            _either(_string, _list_of(_VECTOR)),
            "points [[x, y, z], ...] ([x, y] in two dimensions), or a file of three (two) columns",
            path=True,
        ),
    },
    "select": {
        "atoms": Key(_string, 'a selection of MDAnalysis, e.g. "type 1 2" or "name OW and prop z < 20"'),
        "types": Key(_either(_count, _list_of(_count)), "atom types, e.g. [1, 2]"),
        "elements": Key(_STRINGS, 'names of types in the trajectory, e.g. ["O", "H"]'),
        "ids": Key(_either(_count, _string, _list_of(_either(_count, _string))), 'atom ids or spans, e.g. "1:100"'),
        "molecules": Key(_either(_integer, _list_of(_integer)), "molecule numbers, e.g. [1, 2]"),
        "groups": Key(_STRINGS, 'groups of the script of [potential], e.g. "wall"'),
        "region": Key(_string, 'words of a LAMMPS region, e.g. "block 0 10 INF INF 0 5"'),
        "invert": Key(_boolean, "true (all atoms but these) or false"),
        "fixed": Key(_boolean, "true (those that the first frame has of these) or false (each frame is asked anew)"),
        "by": Key(
            _choice_of("estimators.selections", "BY"), 'what fields are taken apart by: "type", "element" or "molecule"'
        ),
        "bonds": Key(_choice_of("estimators.selections", "BONDS"), 'which bonds count: "half", "both", "one" or "any"'),
    },
    "fields": {
        "quantities": Key(
            _either(_list_of(_string), lambda v: [_string(v)]), 'a list of quantities, e.g. ["stress", "density"]'
        ),
        "column_units": Key(
            _table_of(_string),
            'the units of columns of the dump, e.g. { c_pe = "eV" }: for quantities such as column:c_pe',
        ),
        "tolerance": Key(_tolerance, "the error allowed relative to the field's maximum, e.g. 1e-5"),
        "method": Key(_string, 'how to sum, e.g. "auto"'),
        "horizon": Key(
            _positive, "a length greater than 0 in the trajectory's units, e.g. 6.0: how far weighted virials see"
        ),
        "tiles": Key(
            _either(_list_of(_count, 3), _list_of(_count, 2)), "numbers of tiles along the cell's edges, e.g. [2, 2, 1]"
        ),
        "velocity": Key(
            _choice_of("planning.request", "VELOCITIES"),
            'what thermal motion is relative to: "frame" (default), "local", "average" or "none"',
        ),
        "average": Key(
            _either(_boolean, _count),
            "true (one time average with standard error), false, or the number of frames in a window",
        ),
    },
    "check": {
        "points": Key(_count, "a number of random points, e.g. 20"),
        "seed": Key(_seed, "a whole number, 0 or more"),
        "timestep": _TIMESTEP,
    },
    "dispersion": {
        "structure": Key(_choice_of("upscaling.crystal", "STRUCTURES"), 'a cubic structure, e.g. "fcc"'),
        "lattice_constant": Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 5.3"),
        "keep_lattice_constant": Key(
            _boolean, "true (compute at lattice_constant) or false (relax, or take the trajectory's)"
        ),
        "unit_cell": Key(_string, 'a file with one unit cell, e.g. "cell.data"', path=True),
        "primitive": Key(_boolean, "true (the primitive cell of unit_cell) or false (its bands folded)"),
        "masses": Key(_list_of(_positive), "a mass for each atom of the basis, e.g. [39.948]"),
        "directions": Key(_list_of(_VECTOR3), "directions, e.g. [[1, 0, 0], [1, 1, 1]]"),
        "path": Key(_string, 'a path through the zone: "auto", "seekpath" or names of its points, e.g. "Γ-X-W-K-Γ-L"'),
        "models": Key(
            _list_of(_choice_of("upscaling.matching", "MODELS")), 'peridynamic models, e.g. ["classical", "cubic"]'
        ),
        "horizon": Key(_positive, "a length greater than 0, e.g. 8.5"),
        "knots": Key(_count, "a number of knots, e.g. 12"),
        "width": Key(_positive, "a length greater than 0, e.g. 0.5"),
        "order": Key(_seed, "a whole number, 0 or more"),
        "reach": Key(_positive, "a length greater than 0, e.g. 8.5"),
        "phonopy": _YES,
        "twin": _YES,
        "blocks": Key(_count, "a number of blocks, e.g. 5"),
        "linewidths": Key(_choice(["lorentzian", "oscillator"]), '"lorentzian" or "oscillator"'),
        "structure_factors": _YES,
        "timestep": _TIMESTEP,
    },
    "twin": {
        "structure": Key(
            _choice_of("upscaling.crystal", "STRUCTURES", "PLANAR_STRUCTURES"),
            'a cubic structure, e.g. "fcc"; in the plane "hexagonal"',
        ),
        "lattice_constant": Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 5.3"),
        "material": Key(
            _choice(["isotropic", "cauchy-born", "linear", "coarsened", "smoothed", "measured"]),
            '"isotropic", "cauchy-born", "linear", "coarsened", "smoothed" or "measured"',
        ),
        "equilibrium": Key(
            _string, 'the trajectory of the perfect crystal in equilibrium, e.g. "still.dump"', path=True
        ),
        "nodes": Key(_choice(["lattice", "atoms"]), '"lattice" or "atoms"'),
        "orient": Key(
            _list_of(_VECTOR3, 3),
            "the crystal directions along the run's x, y, z, e.g. [[1, 1, 0], [-1, 1, 0], [0, 0, 1]]",
        ),
        "reference_stress": _YES,
        "model": Key(_choice(["lps", "pmb"]), '"lps" or "pmb"'),
        "influence": Key(_influence, INFLUENCE_EXPECTED),
        "fracture": _YES,
        "fracture_energy": Key(_positive, "an energy per area (in the plane: per length), greater than 0, e.g. 0.17"),
        "notches": Key(
            _list_of(_list_of(_list_of(_number))),
            "cuts: [[x, y], [x, y]] from one end to the other in the plane, a corner and two edges [x, y, z] in space",
        ),
        "crack_direction": Key(_VECTOR3, "the direction that the crack runs in, e.g. [1, 0, 0]"),
        "crack_normal": Key(_VECTOR3, "the normal of the crack's plane, e.g. [0, 1, 0]"),
        "temperature": Key(_positive, "a temperature greater than 0, e.g. 300.0"),
        "spacing": Key(_positive, "a length greater than 0, e.g. 5.0"),
        "horizon": Key(_positive, "a length greater than 0, e.g. 15.0"),
        "motion": Key(_choice(["dynamic", "static"]), '"dynamic" or "static"'),
        "safety": Key(_part, "steps in parts of the stable one, greater than 0 and at most 1, e.g. 0.2"),
        "grips": Key(
            _list_of(_list_of(_VECTOR3, 2)),
            "boxes [[x, y, z], [x, y, z]] between two corners, e.g. [[[0, 0, 0], [10, 99, 99]]]",
        ),
        "grip_types": Key(_list_of(_count), "atom types, e.g. [2, 3]"),
        "indenter_centre": Key(_VECTOR3, "three lengths, where the first frame has it"),
        "indenter_velocity": Key(_VECTOR3, "three velocities, e.g. [0, 0, -0.1]"),
        "indenter_radius": Key(_positive, "a length greater than 0, e.g. 20.0"),
        "indenter_stiffness": Key(_positive, "K of fix indent, force/length² on an atom, greater than 0"),
        "timestep": _TIMESTEP,
    },
    "output": {
        "file": Key(_string, 'the file to write, e.g. "out.zarr" or "out.nc"', path=True),
        "units": Key(
            _output_units, 'units of the result, e.g. "GPa, nm, W/(m*K)", or a preset: "metal-gpa", "nm-gpa", "si"'
        ),
    },
}

# kind of grid → (keys it needs, alternatives within a tuple; keys it may have)
GRIDS: dict[str, tuple[list, list]] = {
    "regular": ([("shape", "spacing")], ["at", "origin", "vectors", "padding", "follow"]),
    "plane": ([("axis", "u"), ("shape", "spacing")], ["position", "origin", "v", "at", "padding", "follow"]),
    "line": (["start", "end", "n"], ["follow"]),
    "slab": (["axis", "bins"], ["means", "padding", "follow"]),
    "planes": (["axis", ("n", "positions")], ["at", "patches", "interval"]),
    "cylindrical": (["radius", "shape"], ["center", "axis", "inner", "length", "follow"]),
    "spherical": (["radius", "shape"], ["center", "axis", "inner", "follow"]),
    "points": (["points"], ["follow"]),
    "atoms": ([], []),
}
