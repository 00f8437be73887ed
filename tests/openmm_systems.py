"""Small systems for OpenMM, and OpenMM's own answers about them."""

from functools import cache

import numpy as np

from atc.frame import Cell, Frame
from atc.units import units

U = units("mdanalysis")
NM = 10.0


def answer(system, x_nm, box_nm=None, groups=-1):
    """(energy [kJ/mol], (n, 3) forces [kJ/mol/Å]) by OpenMM's Reference platform, in double precision; the forces on
    virtual sites, which OpenMM leaves there, are taken off."""
    import openmm
    from openmm import unit

    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("Reference"))
    if box_nm is not None:
        context.setPeriodicBoxVectors(*np.asarray(box_nm, float))
    context.setPositions(x_nm)
    state = context.getState(getForces=True, getEnergy=True, groups=groups)
    F = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.angstrom)
    live = np.array([not system.isVirtualSite(k) for k in range(len(x_nm))])
    return state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), F * live[:, None]


def placed(system, x_nm, box_nm=None):
    """Positions with virtual sites where they belong."""
    import openmm
    from openmm import unit

    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("Reference"))
    if box_nm is not None:
        context.setPeriodicBoxVectors(*np.asarray(box_nm, float))
    context.setPositions(x_nm)
    context.computeVirtualSites()
    return context.getState(getPositions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def frame_of(x_nm, box_nm=None, **more):
    cell = Cell(np.zeros((3, 3)), periodic=False) if box_nm is None else Cell(np.asarray(box_nm, float) * NM)
    return Frame(np.asarray(x_nm) * NM, cell, U, source="a frame", **more)


def differences(pot, system, x_nm, box_nm=None, tail=0.0):
    """(energy, largest force) of a potential less OpenMM's, the energy in kJ/mol, the force relative to the largest.

    tail : the dispersion correction, which OpenMM's energy has
    """
    E, F = answer(system, x_nm, box_nm)
    d = pot.constrained(None).stream(frame_of(x_nm, box_nm), forces=True)
    f = d.forces_nc / U.factor("force")
    return d.energy / U.energy + tail - E, np.abs(f - F).max() / np.abs(F).max()


def nonbonded(system):
    return next(f for f in system.getForces() if type(f).__name__ == "NonbondedForce")


def positions(quantity):
    from openmm import unit

    return np.array([[*p] for p in quantity.value_in_unit(unit.nanometer)])


BOX = np.array([[2.0, 0.0, 0.0], [0.3, 2.1, 0.0], [-0.4, 0.2, 1.9]])


def ions(method, seed=0, box=BOX, **settings):
    """Ions and uncharged atoms of three kinds in a box, some pairs excluded and some with numbers of their
    own. Returns the System and positions (nm)."""
    import openmm

    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), -1).reshape(-1, 3)[:120]
    x = (grid + 0.5 + rng.uniform(-0.12, 0.12, grid.shape)) / 5 @ box
    system, force = openmm.System(), openmm.NonbondedForce()
    system.setDefaultPeriodicBoxVectors(*box)
    for k in range(len(x)):
        q, s, e = ((0.8, 0.22, 0.3), (-0.8, 0.30, 0.9), (0.0, 0.26, 0.5))[k % 3]
        system.addParticle(20.0 + k % 3)
        force.addParticle(q, s, e)
    # Neighbours along the last edge, none through the face: OpenMM takes them where they are.
    for k in (k for k in range(0, len(x), 3) if k % 5 < 4):
        force.addException(k, k + 1, *((0.0, 1.0, 0.0) if k % 2 else (0.2, 0.25, 0.4)))
    force.setNonbondedMethod(getattr(force, method))
    force.setCutoffDistance(0.85)
    for name, value in settings.items():
        getattr(force, f"set{name}")(value)
    system.addForce(force)
    return system, x


@cache
def villin():
    """(topology, positions nm) of OpenMM's own test protein, shaken, without water."""
    from pathlib import Path

    from openmm import app

    pdb = app.PDBFile(str(Path(app.__file__).parent / "data" / "test.pdb"))
    m = app.Modeller(pdb.topology, pdb.positions)
    m.deleteWater()
    x = positions(m.positions)
    return m.topology, x + np.random.default_rng(1).normal(0.0, 0.004, x.shape)


@cache
def water(model="tip3p", xml="tip3p.xml", edge=1.75):
    """(topology, positions nm) of a small box of water."""
    import openmm
    from openmm import app, unit

    m = app.Modeller(app.Topology(), [] * unit.nanometer)
    m.addSolvent(app.ForceField(xml), model=model, boxSize=openmm.Vec3(edge, edge, edge) * unit.nanometer)
    return m.topology, positions(m.positions)


# --- files

#: two butanes of united atoms, a sodium and a chloride; x in nm
CHAIN = np.array([[0.0, 0.0, 0.0], [0.15, 0.02, 0.01], [0.21, 0.16, 0.02], [0.35, 0.17, 0.11]])
CHAINS = np.concatenate([CHAIN + 0.3, CHAIN[:, [1, 2, 0]] + [0.9, 0.4, 0.7], [[1.1, 0.2, 0.3], [0.5, 1.2, 0.9]]])
CHAIN_BOX = 1.8 * np.eye(3)

TOP = """
[ defaults ]
1 {rule} yes 0.5 0.8333
[ atomtypes ]
CH3 6 15.035 0.0 A {ch3}
CH2 6 14.027 0.0 A {ch2}
Na 11 22.99 0.0 A {na}
Cl 17 35.45 0.0 A {cl}
[ nonbond_params ]
Na Cl 1 {nacl}
[ moleculetype ]
BUT 3
[ atoms ]
1 CH3 1 BUT C1 1 -0.2 15.035
2 CH2 1 BUT C2 2  0.2 14.027
3 CH2 1 BUT C3 3  0.2 14.027
4 CH3 1 BUT C4 4 -0.2 15.035
[ bonds ]
1 2 1 0.153 250000
2 3 1 0.154 220000
3 4 1 0.153 250000
[ pairs ]
1 4 1
[ angles ]
1 2 3 1 112.0 480
2 3 4 5 112.0 480 0.255 9000
[ dihedrals ]
1 2 3 4 3 9.279 12.156 -13.12 -3.06 26.24 -31.5
1 2 3 4 9 180 1.5 2
[ moleculetype ]
NA 1
[ atoms ]
1 Na 1 NA NA 1 1.0 22.99
[ moleculetype ]
CL 1
[ atoms ]
1 Cl 1 CL CL 1 -1.0 35.45
[ system ]
test
[ molecules ]
BUT 2
NA 1
CL 1
"""


def top(rule=2):
    """A topology of GROMACS with sigma and epsilon (rule 2, 3) or their powers (1)."""
    kinds = dict(ch3=(0.39, 0.8), ch2=(0.38, 0.5), na=(0.24, 0.36), cl=(0.44, 0.42), nacl=(0.31, 0.5))
    if rule == 1:
        kinds = {k: (4 * e * s**6, 4 * e * s**12) for k, (s, e) in kinds.items()}
    return TOP.format(rule=rule, **{k: f"{a!r} {b!r}" for k, (a, b) in kinds.items()})


PRM = """* test
*
ATOMS
MASS 1 CH3 15.035
MASS 2 CH2 14.027
MASS 3 SOD 22.99
MASS 4 CLA 35.45

BONDS
CH3 CH2 300.0 1.53
CH2 CH2 260.0 1.54

ANGLES
CH3 CH2 CH2 58.0 112.0 10.0 2.55

DIHEDRALS
CH3 CH2 CH2 CH3 0.15 3 0.0
CH3 CH2 CH2 CH3 0.3 2 180.0

IMPROPERS
CH3 CH2 CH2 CH3 4.0 0 0.0

NONBONDED nbxmod 5 atom cdiel fshift vatom vdistance vfswitch cutnb 14.0 ctofnb 12.0 ctonnb 10.0 eps 1.0 e14fac 1.0 wmin 1.5
CH3 0.0 -0.19 2.19 0.0 -0.05 2.0
CH2 0.0 -0.12 2.13 0.0 -0.04 1.9
SOD 0.0 -0.047 1.41
CLA 0.0 -0.15 2.27

NBFIX
SOD CLA -0.084 3.731

END
"""


def psf():
    names = ["CH3", "CH2", "CH2", "CH3"]
    rows, charge, mass = (
        [],
        dict(CH3=-0.2, CH2=0.2, SOD=1.0, CLA=-1.0),
        dict(CH3=15.035, CH2=14.027, SOD=22.99, CLA=35.45),
    )
    for m in range(2):
        rows += [(m + 1, "BUT", f"C{k + 1}", n) for k, n in enumerate(names)]
    rows += [(3, "SOD", "SOD", "SOD"), (4, "CLA", "CLA", "CLA")]
    atoms = "".join(
        f"{k:8d} SYS  {r:<4d} {res:<4s} {a:<4s} {t:<4s} {charge[t]:10.6f} {mass[t]:13.4f} {0:11d}\n"
        for k, (r, res, a, t) in enumerate(rows, 1)
    )

    def section(title, *tuples):
        every = [w + 4 * m for m in range(2) for t in tuples for w in t]
        width = 8 if len(tuples[0]) != 3 else 9 if tuples else 8
        lines = [every[k : k + width] for k in range(0, len(every), width)]
        return (
            f"{2 * len(tuples):8d} {title}\n"
            + "".join("".join(f"{w:8d}" for w in line) + "\n" for line in lines)
            + "\n"
        )

    return (
        "PSF\n\n       1 !NTITLE\n REMARKS test\n\n"
        + f"{len(rows):8d} !NATOM\n{atoms}\n"
        + section("!NBOND: bonds", (1, 2), (2, 3), (3, 4))
        + section("!NTHETA: angles", (1, 2, 3), (2, 3, 4))
        + section("!NPHI: dihedrals", (1, 2, 3, 4))
        + section("!NIMPHI: impropers", (1, 2, 3, 4))
        + "       0 !NDON: donors\n\n\n       0 !NACC: acceptors\n\n\n       0 !NNB\n\n"
        + "".join(f"{0:8d}" for _ in rows)
        + "\n\n       1       0 !NGRP\n       0       0       0\n\n"
    )


def prmtop():
    """The same in AMBER's form, with a 1-4 pair scaled by SCEE and SCNB of its own."""
    kinds = dict(CH3=(2.19, 0.19), CH2=(2.13, 0.12), Na=(1.41, 0.047), Cl=(2.27, 0.15))
    types = list(kinds)
    atoms = ["CH3", "CH2", "CH2", "CH3"] * 2 + ["Na", "Cl"]
    charge, mass = dict(CH3=-0.2, CH2=0.2, Na=1.0, Cl=-1.0), dict(CH3=15.035, CH2=14.027, Na=22.99, Cl=35.45)
    index, A, B = np.zeros((4, 4), int), [], []
    for i in range(4):
        for j in range(i + 1):
            r, e = kinds[types[i]][0] + kinds[types[j]][0], np.sqrt(kinds[types[i]][1] * kinds[types[j]][1])
            A.append(e * r**12)
            B.append(2 * e * r**6)
            index[i, j] = index[j, i] = len(A)
    bonds = [(3 * (4 * m + a), 3 * (4 * m + b), t) for m in range(2) for a, b, t in ((0, 1, 1), (1, 2, 2), (2, 3, 1))]
    angles = [(3 * 4 * m + 3 * a, 3 * 4 * m + 3 * a + 3, 3 * 4 * m + 3 * a + 6, 1) for m in range(2) for a in range(2)]
    # The second torsion of the same atoms has no 1-4 pair: its third atom is negative.
    torsions = [(12 * m, 12 * m + 3, s * (12 * m + 6), 12 * m + 9, t) for m in range(2) for s, t in ((1, 1), (-1, 2))]
    # atom 0 of a chain cannot be negative: the third is never 0
    excluded = [[b + 1 for b in range(4 * (a // 4) + 4) if b > a] if a < 8 else [] for a in range(10)]
    pointers = [10, 4, 0, 6, 0, 4, 0, 4, 0, 0, sum(max(len(e), 1) for e in excluded), 4, 6, 4, 4, 2, 1, 2, 4, 0]
    pointers += [0] * 7 + [0, 4, 0, 0]
    sections = [
        ("TITLE", "20a4", ["test"]),
        ("POINTERS", "10I8", pointers),
        ("ATOM_NAME", "20a4", [*(f"C{k % 4 + 1}" for k in range(8)), "Na", "Cl"]),
        ("CHARGE", "5E16.8", [18.2223 * charge[a] for a in atoms]),
        ("ATOMIC_NUMBER", "10I8", [6] * 8 + [11, 17]),
        ("MASS", "5E16.8", [mass[a] for a in atoms]),
        ("ATOM_TYPE_INDEX", "10I8", [types.index(a) + 1 for a in atoms]),
        ("NUMBER_EXCLUDED_ATOMS", "10I8", [max(len(e), 1) for e in excluded]),
        ("NONBONDED_PARM_INDEX", "10I8", index.ravel().tolist()),
        ("RESIDUE_LABEL", "20a4", ["BUT", "BUT", "NA", "CL"]),
        ("RESIDUE_POINTER", "10I8", [1, 5, 9, 10]),
        ("BOND_FORCE_CONSTANT", "5E16.8", [300.0, 260.0]),
        ("BOND_EQUIL_VALUE", "5E16.8", [1.53, 1.54]),
        ("ANGLE_FORCE_CONSTANT", "5E16.8", [58.0]),
        ("ANGLE_EQUIL_VALUE", "5E16.8", [np.radians(112.0)]),
        ("DIHEDRAL_FORCE_CONSTANT", "5E16.8", [0.15, 0.3]),
        ("DIHEDRAL_PERIODICITY", "5E16.8", [3.0, 2.0]),
        ("DIHEDRAL_PHASE", "5E16.8", [0.0, 3.141594]),
        ("SCEE_SCALE_FACTOR", "5E16.8", [1.2, 1.2]),
        ("SCNB_SCALE_FACTOR", "5E16.8", [2.0, 2.0]),
        ("SOLTY", "5E16.8", [0.0] * 4),
        ("LENNARD_JONES_ACOEF", "5E16.8", A),
        ("LENNARD_JONES_BCOEF", "5E16.8", B),
        ("BONDS_INC_HYDROGEN", "10I8", []),
        ("BONDS_WITHOUT_HYDROGEN", "10I8", [w for b in bonds for w in b]),
        ("ANGLES_INC_HYDROGEN", "10I8", []),
        ("ANGLES_WITHOUT_HYDROGEN", "10I8", [w for b in angles for w in b]),
        ("DIHEDRALS_INC_HYDROGEN", "10I8", []),
        ("DIHEDRALS_WITHOUT_HYDROGEN", "10I8", [w for b in torsions for w in b]),
        ("EXCLUDED_ATOMS_LIST", "10I8", [w for e in excluded for w in (e or [0])]),
        *((f"HBOND_{c}", "5E16.8", []) for c in ("ACOEF", "BCOEF")),
        ("HBCUT", "5E16.8", []),
        ("AMBER_ATOM_TYPE", "20a4", atoms),
        ("TREE_CHAIN_CLASSIFICATION", "20a4", ["M"] * 10),
    ]
    out = ["%VERSION  VERSION_STAMP = V0001.000  DATE = 01/01/00  00:00:00"]
    for name, form, values in sections:
        many, kind = (int(w) for w in form[: -len(form.lstrip("0123456789"))].split()), form.lstrip("0123456789")
        per = next(many)
        words = [f"{v:<4s}" if kind == "a4" else f"{v:8d}" if kind == "I8" else f"{v:16.8E}" for v in values]
        out += [f"%FLAG {name}", f"%FORMAT({form})"]
        out += ["".join(words[k : k + per]) for k in range(0, len(words), per)] or [""]
    return "\n".join(out) + "\n"
