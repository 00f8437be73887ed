"""Every fix of LAMMPS (22 Jul 2025, and what older manuals list besides) and what it means to the forces between atoms
at a frame.

harmless    moves atoms, changes velocities or the box, or measures: what a frame shows is all there is to know outside
a force on atoms from outside (walls, fields, friction and noise, tethers): forces between atoms, hence stress, are what
they are constraint  holds distances or bodies rigid by forces between atoms, which are part of the stress: found for
every frame (`constraints`) held        the same in a way that is not supported
model       adds forces between atoms, or changes which forces act while LAMMPS runs
charges, types, atoms, bonds
            changes these while LAMMPS runs: right where the frames themselves show them, see `REACH`
"""

from __future__ import annotations

#: class → ((reason, fixes), ...)
_CLASSES = {
    "harmless": (
        (
            "moves atoms, and the box: the frames show where they are",
            "nve nve/asphere nve/asphere/noforce nve/awpmd nve/body nve/bpm/sphere nve/dot nve/eff nve/limit nve/line "
            "nve/noforce nve/sphere nve/spin nve/tri nvk nvt nvt/asphere nvt/body nvt/eff nvt/sllod nvt/sllod/eff "
            "nvt/sphere nvt/uef npt npt/asphere npt/body npt/cauchy npt/eff npt/sphere npt/uef nph nph/asphere "
            "nph/body nph/eff nph/sphere nphug bocs msst qbmsst tgnpt/drude tgnvt/drude drude/transform/direct "
            "drude/transform/inverse press/berendsen press/langevin box/relax deform deform/pressure move meso/move "
            "python/move recenter enforce2d ipi pimd pimd/langevin pimd/langevin/bosonic pimd/nvt pimd/nvt/bosonic hmc "
            "tfmc brownian brownian/asphere brownian/sphere mvv/dpd mvv/edpd mvv/tdpd dpd/energy eos/cv eos/table "
            "eos/table/rx sph sph/stationary meso meso/stationary smd/integrate_tlsph smd/integrate_ulsph "
            "smd/move_tri_surf smd/adjust_dt wall/reflect wall/reflect/stochastic wall/piston wall/flow",
        ),
        (
            "changes velocities, not forces",
            "temp/berendsen temp/csld temp/csvr temp/rescale temp/rescale/eff ehex heat thermal/conductivity viscosity "
            "momentum momentum/chunk lb/momentum oneway smd/setvel ffl gld gle gjf",
        ),
        (
            "follows temperatures or concentrations of atoms, on which no supported force depends",
            "add/heat heat/flow edpd/source tdpd/source",
        ),
        (
            "turns spins, which the frames must show where forces depend on them",
            "precession/spin setforce/spin langevin/spin",
        ),
        (
            "measures or writes",
            "ave/atom ave/chunk ave/correlate ave/correlate/long ave/grid ave/histo ave/histo/weight ave/moments "
            "ave/spatial ave/spatial/sphere ave/time vector print store/force store/state phonon pair pair/tracker "
            "saed/vtk numdiff numdiff/virial nonaffine/displacement mscg reax/c/bonds reax/c/species reaxff/bonds "
            "reaxff/species widom",
        ),
        ("steers the run, not the forces", "halt dt/reset balance controller tune/kspace gpu omp intel"),
        ("holds numbers of atoms that no supported force uses", "property/atom"),
    ),
    "outside": (
        (
            "a wall",
            "wall/body/polygon wall/body/polyhedron wall/colloid wall/ees wall/gran wall/gran/region wall/harmonic "
            "wall/lepton wall/lj1043 wall/lj126 wall/lj93 "
            "wall/morse wall/region wall/region/ees wall/srd wall/table smd/wall_surface indent",
        ),
        (
            "a force from outside",
            "addforce addtorque gravity efield efield/lepton efield/tip4p accelerate/cos flow/gauss propel/self drag "
            "imd lb/fluid lb/pc lb/viscous srd",
        ),
        (
            "replaces the forces that move the atoms, after they are computed",
            "setforce aveforce lineforce planeforce freeze manifoldforce grem pafi neb neb/spin tmd",
        ),
        (
            "friction or noise",
            "langevin langevin/drude langevin/eff nve/dotc/langevin viscous viscous/sphere damping/cundall "
            "electron/stopping electron/stopping/fit ttm ttm/grid ttm/mod qtb shardlow",
        ),
        ("tethers atoms to places", "spring/self spring smd"),
    ),
    "constraint": (
        ("holds bonds and angles rigid", "shake rattle"),
        (
            "moves atoms as rigid bodies",
            "rigid rigid/nph rigid/nph/small rigid/npt rigid/npt/small rigid/nve rigid/nve/small rigid/nvt "
            "rigid/nvt/small rigid/small",
        ),
    ),
    "held": (
        ("filters the fast motion of bonds", "filter/corotate"),
        ("moves atoms as rigid bodies that are joined, or immersed", "poems rigid/meso lb/rigid/pc/sphere"),
        ("holds atoms on a surface", "nve/manifold/rattle nvt/manifold/rattle"),
    ),
    "model": (
        ("changes coefficients while LAMMPS runs", "adapt adapt/fep alchemy ti/spring"),
        (
            "adds forces between atoms that follow from collective variables",
            "colvars plumed spring/chunk spring/rg rhok restrain hyper/global hyper/local orient/bcc orient/eco "
            "orient/fcc",
        ),
        (
            "adds energies of two torsions that differ from those of the mirror image, so that they are no function of "
            "distances and have no forces along bonds",
            "cmap",
        ),
        ("adds coupled torsions of the AMOEBA force field", "amoeba/bitorsion amoeba/pitorsion"),
        ("takes forces from another program", "external client/md mdi/engine mdi/qm mdi/qmmm qmmm latte python/invoke"),
        (
            "carries electric forces between atoms over a mesh, unless it only measures or couples heat or momentum",
            "atc",
        ),
        ("makes Drude particles, whose special bonds are those of their cores", "drude"),
        (
            "solves for a fluid of particles with numbers of its own",
            "rheo rheo/oxidation rheo/pressure rheo/thermal rheo/viscosity smd/mpm rx",
        ),
    ),
    "charges": (
        (
            "sets charges while LAMMPS runs",
            "acks2/reax acks2/reaxff qeq/comb qeq/ctip qeq/dynamic qeq/fire qeq/point qeq/reax qeq/reaxff "
            "qeq/rel/reaxff qeq/shielded qeq/slater qtpie/reaxff "
            "electrode/conp electrode/conq electrode/thermo polarize/bem/gmres polarize/bem/icc polarize/functional",
        ),
    ),
    "types": (("changes types (and charges) of atoms while LAMMPS runs", "atom/swap mol/swap neighbor/swap sgcmc"),),
    "atoms": (
        ("adds or removes atoms while LAMMPS runs", "append/atoms deposit evaporate gcmc pour"),
        ("adds, removes and charges atoms while LAMMPS runs", "charge/regulation"),
    ),
    "bonds": (
        ("makes or breaks bonds while LAMMPS runs", "bond/break bond/create bond/create/angle bond/react bond/swap"),
    ),
    "set": (("sets properties of atoms while LAMMPS runs", "set"),),
}

#: class → which properties of atoms are, from then on, only what the frames show
REACH = {
    "charges": ("charges",), "types": ("types", "charges"), "atoms": ("atoms", "charges", "bonds"),
    "bonds": ("bonds", "types", "charges"), "set": ("types", "charges", "molecules", "masses"),
}  # fmt: skip

#: fix → (class, reason)
FIXES = {
    name: (kind, reason) for kind, groups in _CLASSES.items() for reason, names in groups for name in names.split()
}


_MESH = "outside", "couples atoms to a mesh of finite elements: thermostats, and forces on atoms at its edge"
#: Physics of ``fix atc`` (words behind the style) that leave the forces between atoms what they are. The others, with
#: electric fields or concentrations on the mesh, carry forces from charge to charge, or exchange atoms.
_ATC = {
    **dict.fromkeys(("hardy", "field"), ("harmless", "measures or writes")),
    **dict.fromkeys(("thermal", "two_temperature", "elastic", "thermo_elastic", "shear"), _MESH),
}


def classify(style: str, args) -> tuple[str, str] | None:
    """Class and reason of a fix, None if no LAMMPS has it. `args`: the words behind the style, on which a few
    depend."""
    found = FIXES.get(style)
    if found is None:
        return None
    if style in ("spring", "smd") and "couple" in args:
        return "model", "couples two groups of atoms by a spring"
    if style == "atc" and args:
        return _ATC.get(args[0], found)
    return found


def class_of(c) -> str:
    """The class of a ``fix`` command, a `script.Command`; "" of one that no LAMMPS has."""
    return (classify(c.words[2], c.words[3:]) or ("",))[0]
