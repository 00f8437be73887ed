"""Systems of OpenMM, AMBER, CHARMM and GROMACS: energies and forces are OpenMM's own (Reference platform, in double
precision), by Force and by file.

Runs in the environment of ``make test-tools``, which has OpenMM. Without long-range sums only rounding is left.
OpenMM's Ewald sum is asked for 1e-9; its PME interpolates.
"""

import pickle

import numpy as np
import openmm_systems as om
import pytest

import atc
from atc.errors import AtcError

pytestmark = pytest.mark.tools
ENERGY, FORCE, EWALD = 1e-11, 1e-12, 3e-7


def tail_of(pot):
    """The coefficient of the dispersion correction that a potential states, kJ/mol Å³."""
    text = next((r for r in pot.remarks if "dispersion correction" in r), "energy 0/V")
    return float(text.partition("energy ")[2].partition("/V")[0])


@pytest.mark.parametrize(
    "method, settings, limit",
    [
        ("NoCutoff", {}, FORCE),
        ("CutoffNonPeriodic", {}, FORCE),
        ("CutoffPeriodic", {}, FORCE),
        (
            "CutoffPeriodic",
            {"ReactionFieldDielectric": 1.0, "UseSwitchingFunction": True, "SwitchingDistance": 0.6},
            FORCE,
        ),
        ("Ewald", {"EwaldErrorTolerance": 1e-9}, EWALD),
        ("PME", {"PMEParameters": (5.0, 150, 150, 150), "UseSwitchingFunction": True, "SwitchingDistance": 0.6}, EWALD),
        ("LJPME", {"PMEParameters": (5.0, 150, 150, 150), "LJPMEParameters": (5.0, 150, 150, 150)}, EWALD),
    ],
)
def test_nonbonded(method, settings, limit):
    """Every method, in a triclinic box, of unlike particles, with exclusions and exceptions."""
    plain = {k: v for k, v in settings.items() if not k.endswith("Parameters")}
    edges = om.BOX if method != "Ewald" else np.diag(np.diag(om.BOX))
    system, x = om.ions(method, box=edges, **plain)
    for name, values in settings.items():
        if name.endswith("Parameters"):
            getattr(om.nonbonded(system), f"set{name}")(*values)
    box = None if method in ("NoCutoff", "CutoffNonPeriodic") else edges
    pot = atc.potential(system)
    volume = np.linalg.det(edges) * om.NM**3
    dE, dF = om.differences(pot, system, x, box, tail_of(pot) / volume)
    E, _ = om.answer(system, x, box)
    assert dF <= limit, dF
    # the dispersion correction, which the remark states to 9 digits, is part of OpenMM's energy
    assert abs(dE) <= abs(E) * (ENERGY if limit == FORCE else 3e-7), (dE, E)
    assert (tail_of(pot) != 0.0) == (method in ("CutoffPeriodic", "Ewald", "PME"))


def test_a_cell_is_neutral_to_the_digits_of_its_charges():
    system, x = om.ions("Ewald", box=np.diag(np.diag(om.BOX)), EwaldErrorTolerance=1e-9, UseDispersionCorrection=False)
    force = om.nonbonded(system)
    for k in range(len(x)):
        q, s, e = force.getParticleParameters(k)
        force.setParticleParameters(k, q._value + 7e-7, s, e)
    pot = atc.potential(system)
    assert "charges add up to 8.4e-05 e" in pot.describe()
    assert om.differences(pot, system, x, np.diag(np.diag(om.BOX)))[1] <= 5e-6
    force.setParticleParameters(0, 1.0, 0.2, 0.3)
    with pytest.raises(AtcError, match="the cell has a charge of 0.2"):
        atc.potential(system).stream(om.frame_of(x, np.diag(np.diag(om.BOX))))


def test_a_protein_by_force():
    """AMBER ff14SB: bonds, angles, torsions, nonbonded with 1-4 pairs, each alone and all together."""
    import openmm
    from openmm import app

    topology, x = om.villin()
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    system = field.createSystem(topology, nonbondedMethod=app.NoCutoff, removeCMMotion=False)
    total = 0.0
    for k in range(system.getNumForces()):
        one = openmm.XmlSerializer.clone(system)
        for other in reversed(range(system.getNumForces())):
            if other != k:
                one.removeForce(other)
        pot = atc.potential(one)
        dE, dF = om.differences(pot, one, x)
        E, _ = om.answer(one, x)
        assert dF <= FORCE and abs(dE) <= ENERGY * abs(E), (type(one.getForce(0)).__name__, dE, dF)
        total += E
    dE, dF = om.differences(atc.potential(system), system, x)
    assert dF <= FORCE and abs(dE) <= ENERGY * abs(total)
    # constrained: the same energy without the constrained bonds, and the pairs of the System
    system = field.createSystem(topology, nonbondedMethod=app.NoCutoff, constraints=app.HBonds)
    pot = atc.potential(system)
    assert om.differences(pot, system, x)[1] <= FORCE
    pairs = pot.constraints.pairs(pot.complete(om.frame_of(x)))
    assert len(pairs) == system.getNumConstraints() > 200
    assert "CMMotionRemover" in pot.describe()


def test_chiral_force_fields():
    """CHARMM36 with correction maps and phases, by forces across bonds."""
    import openmm
    from openmm import app, unit

    topology, x = om.villin()
    m = app.Modeller(topology, x * unit.nanometer)
    m.delete([r for r in m.topology.residues() if r.name == "Cl"])
    x = om.positions(m.positions)
    system = app.ForceField("charmm36.xml").createSystem(m.topology, nonbondedMethod=app.NoCutoff)
    kinds = {type(f).__name__ for f in system.getForces()}
    assert {"CMAPTorsionForce", "CustomTorsionForce", "CustomNonbondedForce", "CustomBondForce"} <= kinds
    pot = atc.potential(system, chiral=True)
    dE, dF = om.differences(pot, system, x)
    assert dF <= FORCE and abs(dE) <= 1e-7 and not pot.central
    assert any(t.name == "correction map (CMAP)" for t in pot.terms if hasattr(t, "name"))
    # phases and formulas of any kind, alone
    torsions, formula = (
        openmm.PeriodicTorsionForce(),
        openmm.CustomTorsionForce("k*(1 + cos(3*theta + 0.3)) + sin(theta)"),
    )
    formula.addPerTorsionParameter("k")
    for k in range(0, 200, 3):
        torsions.addTorsion(k, k + 1, k + 4, k + 6, k % 4 + 1, 0.4 * (k % 5), 1.0 + k % 3)
        formula.addTorsion(k, k + 2, k + 3, k + 6, [float(k % 3)])
    for force in (torsions, formula):
        one = _with(force, len(x))
        dE, dF = om.differences(atc.potential(one, chiral=True), one, x)
        assert dF <= FORCE and abs(dE) <= 1e-8, (type(force), dE, dF)


@pytest.mark.parametrize("model, xml", [("spce", "spce.xml"), ("tip4pew", "tip4pew.xml"), ("tip5p", "tip5p.xml")])
def test_water(model, xml):
    """Three, four and five sites, of which the last one or two are virtual."""
    from openmm import app, unit

    topology, x = om.water(model, xml)
    box = 1.75 * np.eye(3)
    system = app.ForceField(xml).createSystem(
        topology, nonbondedMethod=app.Ewald, nonbondedCutoff=0.8 * unit.nanometer, ewaldErrorTolerance=1e-9
    )
    x = om.placed(system, x + np.random.default_rng(0).normal(0.0, 0.005, x.shape), box)
    pot = atc.potential(system)
    tail = tail_of(pot) / (17.5**3)
    dE, dF = om.differences(pot, system, x, box, tail)
    assert dF <= EWALD and abs(dE) <= 1e-3
    frame = pot.complete(om.frame_of(x, box))
    np.testing.assert_allclose(frame.positions, om.NM * x, atol=1e-12)
    assert (pot.sites is not None) == (model != "spce") and pot.central == (model == "spce")


def test_every_kind_of_virtual_site():
    """Forces are OpenMM's, and none is left on a site; the virial is symmetric, and −Σ x⊗F."""
    import openmm

    rng = np.random.default_rng(5)
    x, system, force = rng.uniform(0.0, 1.2, (14, 3)), openmm.System(), openmm.NonbondedForce()
    for k in range(14):
        system.addParticle(0.0 if k in (3, 8, 13) else 12.0)
        force.addParticle(rng.normal(), 0.2, 0.1)
    system.addForce(force)
    weights = [0.2, 0.3, 0.4, 0.1], [-1, 0.5, 0.5, 0], [0, -1, 0.3, 0.7]
    system.setVirtualSite(3, openmm.LocalCoordinatesSite([0, 1, 2, 4], *weights, openmm.Vec3(0.03, -0.02, 0.05)))
    system.setVirtualSite(8, openmm.OutOfPlaneSite(5, 6, 7, 0.3, 0.2, -2.1))
    system.setVirtualSite(13, openmm.TwoParticleAverageSite(11, 12, 0.3, 0.7))
    x = om.placed(system, x)
    pot = atc.potential(system)
    dE, dF = om.differences(pot, system, x)
    assert abs(dE) <= 1e-5 and dF <= FORCE
    frame = pot.complete(om.frame_of(x, velocities=rng.normal(size=x.shape), forces=rng.normal(size=x.shape)))
    d = pot.stream(frame, forces=True)
    assert np.abs(d.forces_nc[[3, 8, 13]]).max() <= 1e-13 * np.abs(d.forces_nc).max()
    size = np.abs(d.virial_cc).max()
    assert np.abs(d.virial_cc - d.virial_cc.T).max() <= 1e-12 * size
    np.testing.assert_allclose(d.virial_cc, -frame.positions.T @ d.forces_nc, atol=1e-12 * size)
    # sites move with their atoms: a difference of places is their velocity
    h = 1e-6
    later = pot.setup.sites.placed(frame.replace(positions=frame.positions + h * frame.velocities))
    earlier = pot.setup.sites.placed(frame.replace(positions=frame.positions - h * frame.velocities))
    rate = (later.positions - earlier.positions) / (2 * h)
    np.testing.assert_allclose(rate, frame.velocities, atol=1e-7 * np.abs(rate).max())
    assert not frame.forces[[3, 8, 13]].any()


@pytest.mark.parametrize("formula, is_lj", [("", True), ("+ 0.3*exp(-6*r)*step(0.7 - r) + f(r)", False)])
def test_custom_nonbonded(formula, is_lj):
    """CHARMM's water: Lennard-Jones from tables, switched, with the long-range correction; and a formula that is not
    Lennard-Jones."""
    from openmm import app, unit

    topology, x = om.water()
    box = 1.75 * np.eye(3)
    field = app.ForceField("charmm36.xml", "charmm36/water.xml")
    more = dict(nonbondedCutoff=0.8 * unit.nanometer, switchDistance=0.6 * unit.nanometer)
    system = field.createSystem(topology, nonbondedMethod=app.CutoffPeriodic, **more)
    custom = next(f for f in system.getForces() if type(f).__name__ == "CustomNonbondedForce")
    custom.setEnergyFunction(custom.getEnergyFunction().rstrip("; ") + formula)
    custom.setUseLongRangeCorrection(is_lj)
    if not is_lj:
        import openmm

        custom.addTabulatedFunction("f", openmm.Continuous1DFunction([0.3, 0.1, -0.2, 0.1, 0.05, -0.1], 0.0, 1.0))
    x = x + np.random.default_rng(0).normal(0.0, 0.005, x.shape)
    pot = atc.potential(system)
    dE, dF = om.differences(pot, system, x, box, tail_of(pot) / 17.5**3)
    # OpenMM integrates the correction to 1e-7 or so
    assert dF <= FORCE and abs(dE) <= 1e-3 and (tail_of(pot) < 0) == is_lj
    assert any("A/r^12" in s.name for s in pot.terms[0].styles) == is_lj


def test_custom_bonded():
    """Formulas of bonds, angles and torsions with parameters and global ones; RB torsions."""
    import openmm

    topology, x = om.villin()
    x = x[:60]
    system = openmm.System()
    for _ in x:
        system.addParticle(12.0)
    rng = np.random.default_rng(3)
    bonds = openmm.CustomBondForce("D*(1 - exp(-a*(r - r0)))^2")
    bonds.addPerBondParameter("D")
    bonds.addPerBondParameter("r0")
    bonds.addGlobalParameter("a", 3.0)
    angles = openmm.CustomAngleForce("0.5*k*(cos(theta) - c)^2; c = cos(theta0)")
    angles.addPerAngleParameter("k")
    angles.addPerAngleParameter("theta0")
    torsions = openmm.CustomTorsionForce(
        "k*min(dtheta, 2*pi - dtheta)^2; dtheta = abs(theta - theta0); pi = 3.1415926535"
    )
    torsions.addPerTorsionParameter("k")
    torsions.addPerTorsionParameter("theta0")
    rb = openmm.RBTorsionForce()
    for k in range(50):
        bonds.addBond(k, k + 1, [float(k % 3 + 1), 0.2])
        angles.addAngle(k, k + 1, k + 2, [float(k % 4), 1.9])
        torsions.addTorsion(k, k + 2, k + 5, k + 7, [float(k % 2), 0.0])
        rb.addTorsion(k, k + 1, k + 3, k + 6, *(float(c) for c in rng.normal(size=6)))
    for f in (bonds, angles, torsions, rb):
        system.addForce(f)
    pot = atc.potential(system)
    dE, dF = om.differences(pot, system, x)
    assert abs(dE) <= 1e-8 and dF <= FORCE
    assert "CustomBondForce with the default a = 3" in pot.describe()


# --- files


def _write(folder):
    for name, text in (
        ("rule2.top", om.top(2)), ("rule3.top", om.top(3)), ("rule1.top", om.top(1)), ("a.psf", om.psf()),
        ("a.prm", om.PRM), ("a.prmtop", om.prmtop()),
    ):  # fmt: skip
        (folder / name).write_text(text)


def _system(path, method, switch=True):
    from openmm import app, unit

    more = dict(nonbondedMethod=getattr(app, method))
    box = om.CHAIN_BOX * unit.nanometer if method != "NoCutoff" else None
    if box is not None:
        more |= dict(nonbondedCutoff=0.8 * unit.nanometer)
        more |= dict(switchDistance=0.65 * unit.nanometer) if switch else {}
    if path.suffix == ".top":
        return app.GromacsTopFile(str(path), periodicBoxVectors=box).createSystem(**more)
    if path.suffix == ".psf":
        file = app.CharmmPsfFile(str(path))
        if box is not None:
            file.setBox(*[1.8 * unit.nanometer] * 3)
        return file.createSystem(app.CharmmParameterSet(str(path.with_suffix(".prm"))), **more)
    file = app.AmberPrmtopFile(str(path))
    file.topology.setPeriodicBoxVectors(box)
    return file.createSystem(**more)


@pytest.mark.parametrize("method", ["NoCutoff", "CutoffPeriodic"])
@pytest.mark.parametrize("name", ["rule1.top", "rule2.top", "rule3.top", "a.psf", "a.prmtop"])
def test_files(tmp_path, name, method):
    """GROMACS with all mixing rules, NBFIX, pairs and Urey-Bradley; CHARMM with 1-4 numbers of their own, NBFIX,
    Urey-Bradley and impropers; AMBER with scaled 1-4 pairs and its phase of 3.141594."""
    _write(tmp_path)
    path = tmp_path / name
    options = {"method": method} | ({"cutoff": 8.0, "switch": 6.5} if method != "NoCutoff" else {})
    options |= {"parameters": path.with_suffix(".prm")} if name == "a.psf" else {}
    pot = atc.potential(path, **options)
    system = _system(path, method)
    box = om.CHAIN_BOX if method != "NoCutoff" else None
    dE, dF = om.differences(pot, system, om.CHAINS, box, tail_of(pot) / 18.0**3)
    # the phase of AMBER's torsion is taken for π, from which its file is 1e-6 away
    limit = 1e-8 if name == "a.prmtop" else FORCE
    assert dF <= limit and abs(dE) <= 1e-5, (dE, dF)


def test_one_four_pairs_of_amber(tmp_path):
    """Scaled by the file's own SCEE and SCNB, from its numbers alone."""
    _write(tmp_path)
    pot = atc.potential(tmp_path / "a.prmtop", method="NoCutoff")
    term = next(t for t in pot.terms if type(t).__name__ == "Exceptions")
    z, a, b = term.numbers[0]
    kcal, r = 4.184 * om.U.energy, 2 * 2.19
    assert a == pytest.approx(kcal * 0.19 * r**12 / 2.0, rel=1e-7)
    assert b == pytest.approx(kcal * 2 * 0.19 * r**6 / 2.0, rel=1e-7)
    assert z == pytest.approx(om.U.coulomb * 0.2**2 / 1.2, rel=1e-6)
    assert len(term.numbers) == 2


@pytest.mark.parametrize(
    "switching, formula",
    [
        # GROMACS's manual, eqs. for force switching of r^-12 and r^-6
        (
            "force-switch",
            "a*(F(r,12)) - b*(F(r,6))",
        ),
        # Steinbach & Brooks, as CHARMM-GUI writes it for OpenMM
        (
            "vfswitch",
            "step(r - s)*(a*(k12*(r^-6 - c^-6)^2) - b*(k6*(r^-3 - c^-3)^2))"
            " + (1 - step(r - s))*(a*(r^-12 - (s*c)^-6) - b*(r^-6 - (s*c)^-3));"
            " k12 = c^6/(c^6 - s^6); k6 = c^3/(c^3 - s^3)",
        ),
    ],
)
def test_force_switches(switching, formula):
    """Lennard-Jones as GROMACS's and CHARMM's own programs end it, against its formula in a CustomNonbondedForce."""
    import openmm

    system, x = om.ions("CutoffPeriodic", UseSwitchingFunction=True, SwitchingDistance=0.6)
    pot = atc.potential(system, switching=switching)
    force = om.nonbonded(system)
    if switching == "force-switch":
        parts = []
        for p in (12, 6):
            A = f"(-({p}*(({p}+4)*c - ({p}+1)*s)/(c^({p}+2)*(c - s)^2)))"
            B = f"({p}*(({p}+3)*c - ({p}+1)*s)/(c^({p}+2)*(c - s)^3))"
            C = f"(c^-{p} - {A}/3*(c - s)^3 - {B}/4*(c - s)^4)"
            parts.append(f"(r^-{p} - step(r - s)*({A}/3*(r - s)^3 + {B}/4*(r - s)^4) - {C})")
        formula = f"a*{parts[0]} - b*{parts[1]}"
    formula += "; a = 4*e*sig^12; b = 4*e*sig^6; e = sqrt(e1*e2); sig = 0.5*(sig1 + sig2)"
    custom = openmm.CustomNonbondedForce(formula.replace(";", "; ", 1))
    custom.addPerParticleParameter("sig")
    custom.addPerParticleParameter("e")
    custom.addGlobalParameter("s", 0.6)
    custom.addGlobalParameter("c", 0.85)
    custom.setNonbondedMethod(custom.CutoffPeriodic)
    custom.setCutoffDistance(0.85)
    for k in range(force.getNumParticles()):
        q, s, e = force.getParticleParameters(k)
        custom.addParticle([s, e])
        force.setParticleParameters(k, q, s, 0.0)
    for k in range(force.getNumExceptions()):
        custom.addExclusion(*force.getExceptionParameters(k)[:2])
    system.addForce(custom)
    dE, dF = om.differences(pot, system, x, om.BOX)
    assert abs(dE) <= 1e-6 and dF <= FORCE
    # and the formula itself, as OpenMM would run it
    assert om.differences(atc.potential(system), system, x, om.BOX)[1] <= FORCE


# --- trajectories and fields


def _trajectories(folder, system, topology, x, box, formats):
    """Two frames of each format with velocities and forces, written by MDAnalysis."""
    import MDAnalysis
    from openmm import app, unit

    with open(folder / "run.pdb", "w") as f:
        app.PDBFile.writeFile(topology, x * unit.nanometer, f)
    u = MDAnalysis.Universe(str(folder / "run.pdb"))
    rng = np.random.default_rng(2)
    v, (_, F) = rng.normal(size=x.shape), om.answer(system, x, box)
    for name in formats:
        with MDAnalysis.Writer(str(folder / name), n_atoms=len(x), velocities=True, forces=True) as w:
            for k in range(2):
                ts = u.trajectory.ts
                ts.has_velocities = ts.has_forces = True
                ts.positions, ts.velocities, ts.forces = om.NM * x, v, F
                ts.dimensions, ts.time = [*np.diag(om.NM * box), 90, 90, 90], 0.01 * (k + 1)
                w.write(u.atoms)
    return v, F


@pytest.mark.filterwarnings("ignore")
def test_trajectories(tmp_path):
    """TRR and XTC (nm), NetCDF and DCD (Å): the same places, velocities and forces, which are those of the System."""
    import openmm
    from openmm import app, unit

    topology, x = om.water()
    box = 1.75 * np.eye(3)
    system = app.ForceField("tip3p.xml").createSystem(
        topology, nonbondedMethod=app.PME, nonbondedCutoff=0.8 * unit.nanometer, rigidWater=False
    )
    (tmp_path / "system.xml").write_text(openmm.XmlSerializer.serialize(system))
    v, F = _trajectories(tmp_path, system, topology, x, box, ["run.trr", "run.nc", "run.xtc", "run.dcd"])
    pot = atc.potential(tmp_path / "system.xml")
    for name, places in (("run.trr", 1e-5), ("run.nc", 1e-5), ("run.dcd", 1e-5), ("run.xtc", 6e-3)):
        frame = pot.complete(atc.read(tmp_path / name, topology=tmp_path / "run.pdb")[1])
        np.testing.assert_allclose(frame.positions, om.NM * x, atol=places)
        np.testing.assert_allclose(np.diag(frame.cell.vectors), 17.5, rtol=1e-6)
        assert frame.charges is not None and frame.masses.sum() == pytest.approx(18.01528 * len(x) / 3, rel=1e-3)
        if name in ("run.trr", "run.nc"):
            np.testing.assert_allclose(frame.velocities / om.U.velocity, v, atol=1e-5)
            np.testing.assert_allclose(frame.forces / om.U.factor("force"), F, atol=1e-4 * np.abs(F).max())
    scene = {
        "trajectory": {
            "file": str(tmp_path / "run.trr"),
            "topology": str(tmp_path / "run.pdb"),
            "forces": "must agree",
        },
        "potential": {"openmm": str(tmp_path / "system.xml")},
        "kernel": {"name": "gaussian", "width": 3.0},
        "grid": {"kind": "regular", "shape": [2, 2, 2]},
        "fields": {"quantities": ["stress", "virial_stress"], "tolerance": 1e-3},
    }
    ds = atc.Scene.load(scene).run()
    # OpenMM's PME of 5e-4 is within what it asks for
    assert "frame 0: yes" in str(ds.attrs["agrees_with_run"]), ds.attrs["agrees_with_run"]
    assert "dispersion correction is in no field" in ds.attrs["decomposition"]
    virial = ds["virial_stress_potential"].values[0]
    d = pot.stream(pot.complete(atc.read(tmp_path / "run.trr", topology=tmp_path / "run.pdb")[0]))
    np.testing.assert_allclose(virial * om.U.factor("pressure"), d.virial_cc / 17.5**3, rtol=1e-4, atol=1e-7)


@pytest.mark.filterwarnings("ignore")
def test_balance_laws():
    """Mass, momentum and energy are balanced with virtual sites, constraints and long-range Coulomb together."""
    from openmm import app, unit

    from atc.analysis.check import check
    from atc.decomposers import Constraints

    topology, x = om.water("tip4pew", "tip4pew.xml")
    box = 1.75 * np.eye(3)
    system = app.ForceField("tip4pew.xml").createSystem(
        topology, nonbondedMethod=app.PME, nonbondedCutoff=0.8 * unit.nanometer
    )
    x = om.placed(system, x, box)
    pot = atc.potential(system)
    assert isinstance(pot.constraints, Constraints)
    rng = np.random.default_rng(4)
    masses = pot.setup.masses
    v = rng.normal(size=x.shape) / np.sqrt(np.where(masses > 0, masses, 1.0))[:, None]
    frame = om.frame_of(x, box, velocities=0.15 * v)
    report = check(frame, pot, atc.kernel("gaussian", width=2.5), points=3)
    laws = report.data["laws"]
    assert report.ok, report
    assert max(laws[k]["fields"]["residual"] for k in ("mass", "momentum", "energy")) < 1e-9, laws


def test_in_tiles_and_other_processes():
    """Tiles and pickled potentials give the same: lists of a System are known to both."""
    system, x = om.ions("CutoffPeriodic")
    pot = atc.potential(system)
    frame = om.frame_of(x, om.BOX, velocities=np.zeros_like(x))
    kern, grid = atc.kernel("quartic", 8.0), atc.Grid.regular(shape=(3, 3, 3))
    whole = atc.fields(frame, pot, kern, grid, ["stress_potential"], method="direct")
    tiled = atc.fields(frame, pot, kern, grid, ["stress_potential"], tiles=(2, 1, 1), method="direct")
    size = float(np.abs(whole.stress_potential).max())
    np.testing.assert_allclose(tiled.stress_potential, whole.stress_potential, atol=1e-11 * size)
    again = pickle.loads(pickle.dumps(pot)).stream(frame)
    assert again.energy == pot.stream(frame).energy


# --- refused


def _with(force, n=8):
    import openmm

    system = openmm.System()
    for _ in range(n):
        system.addParticle(12.0)
    system.addForce(force)
    return system


def _refusals():
    import openmm

    yield "GBSAOBCForce", openmm.GBSAOBCForce()
    yield "CustomGBForce", openmm.CustomGBForce()
    yield "CustomExternalForce", openmm.CustomExternalForce("x^2")
    yield "DrudeForce", openmm.DrudeForce()
    yield "GayBerneForce", openmm.GayBerneForce()
    yield "CustomHbondForce", openmm.CustomHbondForce("1")
    chiral = openmm.PeriodicTorsionForce()
    chiral.addTorsion(0, 1, 2, 3, 1, 1.0, 2.0)
    yield "PeriodicTorsionForce: torsion 0 of particles 0 1 2 3 has the phase 57.2958", chiral
    chiral = openmm.CustomTorsionForce("k*(theta - 0.5)^2")
    chiral.addPerTorsionParameter("k")
    chiral.addTorsion(0, 1, 2, 3, [1.0])
    yield "CustomTorsionForce.*not the same for phi and -phi", chiral
    cmap = openmm.CMAPTorsionForce()
    cmap.addMap(24, np.random.default_rng(0).normal(size=576))
    cmap.addTorsion(0, 0, 1, 2, 3, 1, 2, 3, 4)
    yield "CMAPTorsionForce: 1 torsion pairs use map 0: its energy.*mirror image", cmap
    groups = openmm.CustomNonbondedForce("1/r")
    for _ in range(8):
        groups.addParticle([])
    groups.addInteractionGroup([0, 1], [2, 3])
    yield "interaction groups", groups
    offsets = openmm.NonbondedForce()
    for _ in range(8):
        offsets.addParticle(0, 1, 0)
    offsets.addGlobalParameter("scale", 1.0)
    offsets.addParticleParameterOffset("scale", 0, 1, 0, 0)
    yield "parameter offsets", offsets
    half = openmm.NonbondedForce()
    half.setIncludeDirectSpace(False)
    for _ in range(8):
        half.addParticle(0, 1, 0)
    yield "without its direct space", half
    odd = openmm.CustomBondForce("k*gamma(r)")
    odd.addPerBondParameter("k")
    odd.addBond(0, 1, [1.0])
    yield "CustomBondForce: the formula", odd


def test_what_is_not_mapped_is_refused_by_name():
    for words, force in _refusals():
        with pytest.raises(AtcError, match=words) as e:
            atc.potential(_with(force))
        assert "\n" not in str(e.value)


def test_maps_without_energy_and_empty_forces_are_nothing():
    import openmm

    cmap = openmm.CMAPTorsionForce()
    cmap.addMap(24, np.zeros(576))
    cmap.addTorsion(0, 0, 1, 2, 3, 1, 2, 3, 4)
    system = _with(cmap)
    system.addForce(openmm.CustomTorsionForce("theta"))
    bonds = openmm.HarmonicBondForce()
    bonds.addBond(0, 1, 0.1, 100.0)
    system.addForce(bonds)
    assert len(atc.potential(system).terms) == 1


def test_wrong_trajectories_and_files(tmp_path):
    import openmm

    system, x = om.ions("CutoffPeriodic")
    pot = atc.potential(system)
    with pytest.raises(AtcError, match="has 119 atoms, the System of OpenMM has 120"):
        pot.stream(om.frame_of(x[1:], om.BOX))
    with pytest.raises(AtcError, match="has no box"):
        pot.stream(om.frame_of(x))
    heavy = np.where(np.arange(len(x)) == 5, 1.0, 20.0)
    with pytest.raises(AtcError, match="atom 6 has the mass 1 there, and 22 in"):
        pot.stream(om.frame_of(x, om.BOX, masses=heavy))
    (tmp_path / "state.xml").write_text(openmm.XmlSerializer.serialize(openmm.VerletIntegrator(1.0)))
    (tmp_path / "ff.xml").write_text("<ForceField></ForceField>")
    (tmp_path / "bad.xml").write_text("<System>")
    (tmp_path / "bad.top").write_text("[ atoms ]\nnonsense\n")
    for name, words, more in (
        ("state.xml", "holds a VerletIntegrator", {}),
        ("ff.xml", "a force field, not a System", {}),
        ("bad.xml", "does not understand it: expected what openmm.XmlSerializer", {}),
        ("bad.top", "does not understand it: .*all it includes", {"method": "NoCutoff"}),
    ):
        with pytest.raises(AtcError, match=words) as e:
            atc.potential(tmp_path / name, **more)
        assert "\n" not in str(e.value) and name in str(e.value)
    _write(tmp_path)
    (tmp_path / "amber.top").write_text(om.prmtop())
    with pytest.raises(AtcError, match="a file of AMBER, not of GROMACS: give it as prmtop"):
        atc.Scene.load(
            {"trajectory": {"file": "x"}, "potential": {"top": str(tmp_path / "amber.top"), "method": "NoCutoff"}}
        ).potential()
    assert len(atc.potential(tmp_path / "amber.top", method="NoCutoff").terms) == 5


def test_every_key_of_a_scene_counts(tmp_path):
    """What [potential] says of a run makes another model, or is refused."""
    from atc.planning.identity import digest

    _write(tmp_path)
    (tmp_path / "defines.top").write_text(
        om.top(2)
        .replace("112.0 480\n", "ANGLE\n")
        .replace(
            "[ defaults ]",
            "#ifdef STIFF\n#define ANGLE 112.0 500\n#else\n#define ANGLE 112.0 480\n#endif\n[ defaults ]",
        )
    )
    (tmp_path / "inc").mkdir()
    (tmp_path / "inc" / "all.itp").write_text(om.top(2))
    (tmp_path / "inc.top").write_text('#include "all.itp"\n')
    (tmp_path / "soft.prm").write_text(om.PRM.replace("300.0", "290.0"))

    def model(**keys):
        scene = atc.Scene.load({"trajectory": {"file": str(tmp_path / "x.dcd")}, "potential": keys})
        object.__setattr__(scene, "folder", tmp_path)
        pot = scene.potential()
        held = None if pot.constraints is None else pot.constraints.rules[0].pairs_c2
        return digest([pot.terms, pot.setup.exclusions, held, pot.setup.masses])

    top = {"top": "rule2.top", "method": "CutoffPeriodic", "cutoff": 8.0, "switch": 6.0}
    base = model(**top)
    assert base == model(**top)
    for change in (
        {"top": "rule3.top"}, {"method": "PME"}, {"cutoff": 8.5}, {"switch": 6.5}, {"switching": "force-switch"},
        {"constraints": "allbonds"},
    ):  # fmt: skip
        assert model(**{**top, **change}) != base, change
    (tmp_path / "phase.top").write_text(om.top(2).replace("9 180 1.5 2", "9 60 1.5 2"))
    with pytest.raises(AtcError, match="chiral = true"):
        model(top="phase.top", method="NoCutoff")
    assert model(top="phase.top", method="NoCutoff", chiral=True) != model(
        top="rule2.top", method="NoCutoff", chiral=True
    )
    psf = {"psf": "a.psf", "method": "NoCutoff", "parameters": "a.prm"}
    assert model(**psf) != model(**{**psf, "parameters": ["soft.prm"]})
    prm = {"prmtop": "a.prmtop", "method": "NoCutoff"}
    assert model(**prm) != model(**prm, constraints="hangles")
    stiff = {"top": "defines.top", "method": "NoCutoff"}
    assert model(**stiff) != model(**stiff, defines=["STIFF"])
    assert model(top="inc.top", method="NoCutoff", include="inc") == model(top="rule2.top", method="NoCutoff")


def test_rigid_water_of_a_topology(tmp_path):
    """Held or not, as the run says."""
    water = om.TOP.partition("[ moleculetype ]")[0].format(
        rule=2, **{k: "0.3 0.5" for k in ("ch3", "ch2", "na", "cl", "nacl")}
    )
    water += (
        "[ moleculetype ]\nSOL 2\n[ atoms ]\n1 CH3 1 SOL OW 1 -0.8 16.0\n2 CH2 1 SOL HW1 1 0.4 1.0\n3 CH2 1 SOL HW2 1 0.4 1.0\n"
        "[ settles ]\n1 1 0.1 0.1633\n[ exclusions ]\n1 2 3\n2 1 3\n3 1 2\n[ system ]\nx\n[ molecules ]\nSOL 2\n"
    )
    (tmp_path / "w.top").write_text(water)
    assert atc.potential(tmp_path / "w.top", method="NoCutoff").constraints is not None


def test_a_prmtop_is_the_topology_of_its_trajectory(tmp_path):
    """AMBER: nothing but the parameters and the trajectory are named."""
    import MDAnalysis

    _write(tmp_path)
    u = MDAnalysis.Universe.empty(10, trajectory=True)
    u.atoms.positions = om.NM * om.CHAINS
    u.dimensions = [18, 18, 18, 90, 90, 90]
    with MDAnalysis.Writer(str(tmp_path / "run.dcd"), n_atoms=10) as w:
        w.write(u.atoms)
    scene = atc.Scene.load(
        {
            "trajectory": {"file": str(tmp_path / "run.dcd")},
            "potential": {"prmtop": str(tmp_path / "a.prmtop"), "method": "CutoffPeriodic", "cutoff": 8.0},
            "kernel": {"name": "quartic", "radius": 9.0},
            "grid": {"kind": "regular", "shape": [2, 2, 2]},
            "fields": {"quantities": ["stress_potential", "density"]},
        }
    )
    ds = scene.run()
    assert float(ds.density.mean()) > 0 and np.isfinite(ds.stress_potential).all()


@pytest.mark.filterwarnings("ignore")
def test_the_example_of_the_page(tmp_path, monkeypatch):
    """docs/other_codes.md, its run and its scene; constraint forces are as good as it says."""
    import re
    from pathlib import Path

    page = (Path(__file__).parents[2] / "docs" / "other_codes.md").read_text()
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"^```python\n(import MDAnalysis.*?)^```", page, re.M | re.S)[1], {})
    (tmp_path / "scene.toml").write_text(re.search(r"^```toml\n(\[trajectory\].*?)^```", page, re.M | re.S)[1])
    ds = atc.Scene.load(tmp_path / "scene.toml", ["grid.shape=[2, 2, 2]", "trajectory.frames=1"]).run()
    assert ds.attrs["constraint_source"] == "step" and ds.attrs["constraint_error"] < 3e-6
    assert np.isfinite(ds.stress).all() and 0.9 < float(ds.density.mean()) / 0.602 < 1.1
    # the kinetic energy of rotation and translation alone: six degrees of freedom a molecule
    assert 150 < float(ds.temperature.mean()) < 450
