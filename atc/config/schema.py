"""What a scene may hold: its sections and keys, what values they take, which kinds of grid there are."""

from __future__ import annotations

from .checks import (
    INFLUENCE_EXPECTED,
    Key,
    atom_style,
    axis,
    boolean,
    choice,
    choice_of,
    count,
    either,
    frames,
    influence,
    integer,
    list_of,
    list_or_one,
    not_negative,
    number,
    one_of_numbers,
    output_units,
    part,
    partition,
    positive,
    seed,
    string,
    table_of,
    tolerance,
)

_UNITS = Key(choice_of("units", "_SYSTEMS"), 'a unit style, e.g. "metal"')
_TIMESTEP = Key(positive, "the time of one step in the trajectory's units, e.g. 0.001")
_YES = Key(boolean, "true or false")
_STRINGS = either(string, list_of(string))
_VECTOR3 = list_of(number, 3)
_LENGTH3 = either(positive, list_of(positive, 3), list_of(positive, 2))
_VECTOR = either(_VECTOR3, list_of(number, 2))  # two numbers in two dimensions

SCHEMA: dict[str, dict[str, Key]] = {
    "trajectory": {
        "file": Key(
            _STRINGS,
            'a file name, a pattern or a list of names, e.g. "run.dump", "dump.*" or ["a.dump", "b.dump"]',
            path=True,
        ),
        "topology": Key(string, 'the name of a LAMMPS data file, e.g. "run.data"', path=True),
        "atom_style": Key(atom_style, 'the atom_style of the LAMMPS run, e.g. "full" or "hybrid sphere molecular"'),
        "units": _UNITS,
        "masses": Key(
            either(list_of(positive), table_of(positive, 1)),
            "a mass for each type, e.g. { 1 = 28.0855 } or [28.0855]",
        ),
        "cell": Key(
            either(list_of(positive, 3), list_of(_VECTOR3, 3), list_of(list_of(number, 2), 3)),
            "the cell of files that have none: three lengths, edge vectors or pairs [lo, hi], e.g. [20.0, 20.0, 40.0]",
        ),
        "pbc": Key(
            either(string, boolean, list_of(boolean, 3)),
            'which axes repeat, where the file does not say it, e.g. "ppf" or [true, true, false]',
        ),
        "timestep": Key(
            positive, "the time of one step in the trajectory's units, for files with steps and no times, e.g. 0.001"
        ),
        "dimension": Key(one_of_numbers(2, 3), "2 (a run in the plane, LAMMPS's dimension 2) or 3"),
        "frames": Key(frames, 'frames counted from 0, e.g. "100:500:5", { begin = 100, end = 500, step = 5 } or -1'),
        "reference": Key(
            either(integer, string),
            'the index of the reference frame, or the file that holds it, e.g. 0 or "start.data"',
            path=True,
        ),
        "forces": Key(
            choice_of("agreement.forces", "MODES"),
            'what to do where the run\'s forces are not the potential\'s: "warn", "must agree" or "ignore"',
        ),
        "log": Key(
            _STRINGS,
            'the LAMMPS log file of the run, or a list of them, e.g. "log.lammps"',
            path=True,
        ),
    },
    "potential": {
        "lammps": Key(string, "LAMMPS lines, e.g. '''pair_style sw\\npair_coeff * * Si.sw Si'''"),
        "input": Key(string, 'the name of a LAMMPS input script, e.g. "in.run"', path=True),
        "nep": Key(string, 'the file of a neuroevolution potential, e.g. "nep.txt"', path=True),
        "mace": Key(string, 'the file of a MACE model, e.g. "my.model"', path=True),
        "nequip": Key(string, 'the file of a NequIP or Allegro model, e.g. "my.nequip.zip"', path=True),
        "kim": Key(string, 'a model of the KIM archive, e.g. "SW_StillingerWeber_1985_Si__MO_405512056662_005"'),
        "metatomic": Key(string, 'the file of a model exported by metatomic, e.g. "model.pt"', path=True),
        "openmm": Key(string, 'the XML file of a System of OpenMM, e.g. "system.xml"', path=True),
        "prmtop": Key(string, 'a parameter and topology file of AMBER, e.g. "complex.prmtop"', path=True),
        "psf": Key(string, 'a structure file of CHARMM or NAMD, e.g. "step5.psf", with parameters', path=True),
        "top": Key(string, 'a topology of GROMACS, e.g. "topol.top"', path=True),
        "parameters": Key(
            _STRINGS,
            'the CHARMM files of a psf, e.g. ["par_all36_prot.prm", "top_all36_prot.rtf"]',
            path=True,
        ),
        "method": Key(
            choice(["NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic", "Ewald", "PME", "LJPME"]),
            'how the run summed nonbonded forces, e.g. "PME"',
        ),
        "cutoff": Key(positive, "the cutoff of the run in angstrom, e.g. 9.0"),
        "switch": Key(positive, "where Lennard-Jones forces begin to end, in angstrom, e.g. 8.0"),
        "switching": Key(
            choice(["potential-switch", "force-switch", "vfswitch"]),
            'how Lennard-Jones forces end: "potential-switch", "force-switch" (GROMACS) or "vfswitch" (CHARMM)',
        ),
        "chiral": Key(
            boolean, "whether torsions that tell a molecule from its mirror image are taken, by forces across bonds"
        ),
        "constraints": Key(
            choice(["none", "hbonds", "allbonds", "hangles"]), 'which bonds the run held, e.g. "hbonds"'
        ),
        "rigid_water": Key(boolean, "whether the run held water rigid: true or false"),
        "defines": Key(list_of(string), 'names that GROMACS\'s preprocessor knows, e.g. ["POSRES"]'),
        "include": Key(string, "the folder of GROMACS's force fields", path=True),
        "head": Key(string, 'which head of a MACE model, e.g. "Default"'),
        "stress": Key(
            choice(["edge", "central"]), 'how a learned model of one hop gives its stress: "edge" or "central"'
        ),
        "reference": Key(
            either(choice(["isolated"]), table_of(number, 1)),
            'the energies of single atoms to subtract: "isolated" (the model says) or, by element, { Si = -163.2 }',
        ),
        "device": Key(string, 'where torch computes, e.g. "cpu" or "cuda"'),
        "types": Key(list_of(string), 'the element of each atom type in the potential\'s names, e.g. ["Te", "Pb"]'),
        "units": _UNITS,
        "run": Key(count, "the number of the script's run that the frames belong to, counted from 1, e.g. 2"),
        "partition": Key(
            partition,
            'how energy is shared among atoms: "equal", "center", or by kind of term, e.g. { "angle" = "center" }',
        ),
        "alpha": Key(positive, "a number greater than 0, 1 over a length: where long-range Coulomb is split, e.g. 0.3"),
    },
    "constraints": {
        "bonds": Key(choice(["hbonds", "allbonds"]), '"hbonds": all bonds of hydrogen are held, "allbonds": all bonds'),
        "rigid_water": Key(boolean, "whether the angle of water molecules is held, too: true or false"),
        "molecules": Key(
            either(boolean, list_of(integer)),
            "true (every molecule is a rigid body) or the numbers of those that are, e.g. [1, 2]",
        ),
        "pairs": Key(
            either(string, list_of(list_of(count, 2))),
            "pairs of atom ids whose distance is held, e.g. [[1, 2], [1, 3]], or a file of two columns",
            path=True,
        ),
        "topology": Key(boolean, "whether a .tpr topology says what is held, where nothing else does: true or false"),
        "source": Key(
            choice_of("decomposers.constraints.held", "SOURCES"),
            'what constraint forces are found from, e.g. "forces"',
        ),
        "temperature": Key(
            positive, "a temperature greater than 0, for constraint forces that are right on average only"
        ),
        "timestep": Key(positive, "the time of one step of the run in the trajectory's units, e.g. 2.0"),
        "leapfrog": Key(boolean, "whether velocities are half a step behind positions (GROMACS's md): true or false"),
        "in_forces": Key(
            boolean, "whether the trajectory's forces contain those of constraints (LAMMPS: true; GROMACS: false)"
        ),
    },
    "kernel": {
        "name": Key(string, 'the name of a kernel, e.g. "quartic"'),
        "radius": Key(positive, "a length greater than 0 in the trajectory's units, e.g. 8.0"),
        "width": Key(positive, "a length greater than 0 in the trajectory's units, e.g. 3.0"),
        "size": Key(
            _LENGTH3, "one or three lengths greater than 0 (one or two in two dimensions), e.g. [5.0, 5.0, 5.0]"
        ),
        "table": Key(
            either(string, list_of(list_of(number))),
            "a file of r and phi(r) in two columns, or the pairs [[r, phi], ...]",
            path=True,
        ),
    },
    "grid": {
        "kind": Key(choice(lambda: list(GRIDS)), 'the kind of grid, e.g. "regular"'),
        "shape": Key(either(count, list_of(count)), "how many points along each axis, e.g. [40, 40, 20]"),
        "spacing": Key(either(positive, list_of(positive)), "the distance between points, greater than 0, e.g. 2.0"),
        "at": Key(choice(["centers", "corners"]), '"centers" or "corners"'),
        "padding": Key(
            either(choice(["auto"]), number),
            'how far the grid reaches beyond open faces of the cell: a length, or "auto" for the reach of the kernel',
        ),
        "origin": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "vectors": Key(
            list_of(either(positive, _VECTOR)),
            "edge vectors, e.g. [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.0, 20.0]]",
        ),
        "axis": Key(axis, 'an axis of the cell, e.g. "z"'),
        "position": Key(number, "a distance from the cell's face along axis, e.g. 12.5"),
        "u": Key(_VECTOR, "an edge vector, e.g. [40.0, 0.0, 0.0]"),
        "v": Key(_VECTOR, "an edge vector, e.g. [0.0, 40.0, 0.0]"),
        "start": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "end": Key(_VECTOR, "a point, e.g. [0.0, 0.0, 50.0]"),
        "n": Key(count, "a number of points, e.g. 100"),
        "bins": Key(count, "a number of bins, e.g. 100"),
        "means": Key(boolean, "true (values of bins are means over their width) or false (at their centres)"),
        "positions": Key(list_of(number), "coordinates of planes along axis, ascending, e.g. [10.0, 12.5, 15.0]"),
        "patches": Key(list_of(count, 2), "into how many parts each plane is cut along the two edges, e.g. [4, 4]"),
        "interval": Key(
            either(choice(["frames"]), positive),
            'the time over which passages through planes are counted, e.g. 0.001, or "frames": from frame to frame',
        ),
        "follow": Key(
            choice(["mass", "+x", "-x", "+y", "-y", "+z", "-z"]),
            'what the grid moves with: "mass", the centre of mass of the atoms, or of those selected; "+z", "-x", ...: '
            "the interface on this side of the denser phase",
        ),
        "center": Key(_VECTOR3, "a point, e.g. [20.0, 20.0, 10.0]"),
        "radius": Key(positive, "a length greater than 0, e.g. 15.0"),
        "inner": Key(not_negative, "a length, the radius where the grid begins, e.g. 5.0"),
        "length": Key(positive, "a length greater than 0, along the axis, e.g. 40.0"),
        "points": Key(
            either(string, list_of(_VECTOR)),
            "points [[x, y, z], ...] ([x, y] in two dimensions), or a file of three (two) columns",
            path=True,
        ),
    },
    "select": {
        "atoms": Key(string, 'a selection of MDAnalysis, e.g. "type 1 2" or "name OW and prop z < 20"'),
        "types": Key(either(count, list_of(count)), "atom types, e.g. [1, 2]"),
        "elements": Key(_STRINGS, 'names of types in the trajectory, e.g. ["O", "H"]'),
        "ids": Key(either(count, string, list_of(either(count, string))), 'atom ids or spans, e.g. "1:100"'),
        "molecules": Key(either(integer, list_of(integer)), "molecule numbers, e.g. [1, 2]"),
        "groups": Key(_STRINGS, 'groups of the script of [potential], e.g. "wall"'),
        "region": Key(string, 'words of a LAMMPS region, e.g. "block 0 10 INF INF 0 5"'),
        "invert": Key(boolean, "true (all atoms but these) or false"),
        "fixed": Key(boolean, "true (those that the first frame has of these) or false (each frame is asked anew)"),
        "by": Key(
            choice_of("estimators.selections", "BY"), 'what fields are taken apart by: "type", "element" or "molecule"'
        ),
        "bonds": Key(choice_of("estimators.selections", "BONDS"), 'which bonds count: "half", "both", "one" or "any"'),
    },
    "fields": {
        "quantities": Key(list_or_one(string), 'a list of quantities, e.g. ["stress", "density"]'),
        "column_units": Key(
            table_of(string),
            'the units of columns of the dump, e.g. { c_pe = "eV" }: for quantities such as column:c_pe',
        ),
        "tolerance": Key(tolerance, "the error allowed relative to the field's maximum, e.g. 1e-5"),
        "method": Key(string, 'how to sum, e.g. "auto"'),
        "horizon": Key(
            positive, "a length greater than 0 in the trajectory's units, e.g. 6.0: how far weighted virials see"
        ),
        "tiles": Key(
            either(list_of(count, 3), list_of(count, 2)), "numbers of tiles along the cell's edges, e.g. [2, 2, 1]"
        ),
        "velocity": Key(
            choice_of("planning.request", "VELOCITIES"),
            'what thermal motion is relative to: "frame" (default), "local", "average" or "none"',
        ),
        "average": Key(
            either(boolean, count),
            "true (one time average with standard error), false, or the number of frames in a window",
        ),
    },
    "check": {
        "points": Key(count, "a number of random points, e.g. 20"),
        "seed": Key(seed, "a whole number, 0 or more"),
        "timestep": _TIMESTEP,
    },
    "dispersion": {
        "structure": Key(choice_of("upscaling.crystal", "STRUCTURES"), 'a cubic structure, e.g. "fcc"'),
        "lattice_constant": Key(positive, "a length greater than 0 in the trajectory's units, e.g. 5.3"),
        "keep_lattice_constant": Key(
            boolean, "true (compute at lattice_constant) or false (relax, or take the trajectory's)"
        ),
        "unit_cell": Key(string, 'a file with one unit cell, e.g. "cell.data"', path=True),
        "primitive": Key(boolean, "true (the primitive cell of unit_cell) or false (its bands folded)"),
        "masses": Key(list_of(positive), "a mass for each atom of the basis, e.g. [39.948]"),
        "directions": Key(list_of(_VECTOR3), "directions, e.g. [[1, 0, 0], [1, 1, 1]]"),
        "path": Key(string, 'a path through the zone: "auto", "seekpath" or names of its points, e.g. "Γ-X-W-K-Γ-L"'),
        "models": Key(
            list_of(choice_of("upscaling.matching", "MODELS")), 'peridynamic models, e.g. ["classical", "cubic"]'
        ),
        "horizon": Key(positive, "a length greater than 0, e.g. 8.5"),
        "knots": Key(count, "a number of knots, e.g. 12"),
        "width": Key(positive, "a length greater than 0, e.g. 0.5"),
        "order": Key(seed, "a whole number, 0 or more"),
        "reach": Key(positive, "a length greater than 0, e.g. 8.5"),
        "phonopy": _YES,
        "twin": _YES,
        "blocks": Key(count, "a number of blocks, e.g. 5"),
        "linewidths": Key(choice(["lorentzian", "oscillator"]), '"lorentzian" or "oscillator"'),
        "structure_factors": _YES,
        "timestep": _TIMESTEP,
    },
    "twin": {
        "structure": Key(
            choice_of("upscaling.crystal", "STRUCTURES", "PLANAR_STRUCTURES"),
            'a cubic structure, e.g. "fcc"; in the plane "hexagonal"',
        ),
        "lattice_constant": Key(positive, "a length greater than 0 in the trajectory's units, e.g. 5.3"),
        "material": Key(
            choice(["isotropic", "cauchy-born", "linear", "coarsened", "smoothed", "measured"]),
            '"isotropic", "cauchy-born", "linear", "coarsened", "smoothed" or "measured"',
        ),
        "equilibrium": Key(
            string, 'the trajectory of the perfect crystal in equilibrium, e.g. "still.dump"', path=True
        ),
        "nodes": Key(choice(["lattice", "atoms"]), '"lattice" or "atoms"'),
        "orient": Key(
            list_of(_VECTOR3, 3),
            "the crystal directions along the run's x, y, z, e.g. [[1, 1, 0], [-1, 1, 0], [0, 0, 1]]",
        ),
        "reference_stress": _YES,
        "model": Key(choice(["lps", "pmb"]), '"lps" or "pmb"'),
        "influence": Key(influence, INFLUENCE_EXPECTED),
        "fracture": _YES,
        "fracture_energy": Key(positive, "an energy per area (in the plane: per length), greater than 0, e.g. 0.17"),
        "notches": Key(
            list_of(list_of(list_of(number))),
            "cuts: [[x, y], [x, y]] from one end to the other in the plane, a corner and two edges [x, y, z] in space",
        ),
        "crack_direction": Key(_VECTOR3, "the direction that the crack runs in, e.g. [1, 0, 0]"),
        "crack_normal": Key(_VECTOR3, "the normal of the crack's plane, e.g. [0, 1, 0]"),
        "temperature": Key(positive, "a temperature greater than 0, e.g. 300.0"),
        "spacing": Key(positive, "a length greater than 0, e.g. 5.0"),
        "horizon": Key(positive, "a length greater than 0, e.g. 15.0"),
        "motion": Key(choice(["dynamic", "static"]), '"dynamic" or "static"'),
        "safety": Key(part, "steps in parts of the stable one, greater than 0 and at most 1, e.g. 0.2"),
        "grips": Key(
            list_of(list_of(_VECTOR3, 2)),
            "boxes [[x, y, z], [x, y, z]] between two corners, e.g. [[[0, 0, 0], [10, 99, 99]]]",
        ),
        "grip_types": Key(list_of(count), "atom types, e.g. [2, 3]"),
        "indenter_centre": Key(_VECTOR3, "three lengths, where the first frame has it"),
        "indenter_velocity": Key(_VECTOR3, "three velocities, e.g. [0, 0, -0.1]"),
        "indenter_radius": Key(positive, "a length greater than 0, e.g. 20.0"),
        "indenter_stiffness": Key(positive, "K of fix indent, force/length² on an atom, greater than 0"),
        "timestep": _TIMESTEP,
    },
    "output": {
        "file": Key(string, 'the file to write, e.g. "out.zarr" or "out.nc"', path=True),
        "units": Key(
            output_units, 'units of the result, e.g. "GPa, nm, W/(m*K)", or a preset: "metal-gpa", "nm-gpa", "si"'
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
