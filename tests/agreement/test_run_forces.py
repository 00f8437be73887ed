"""The run's forces beside the potential's: what LAMMPS wrote after everything that a script can do, and whether the
difference is seen and named."""

import warnings

import numpy as np
import pytest
from lammps_runs import ARGON, SALT, WATER, argon, run, salt, water

import atc
from atc.agreement.forces import _within, compare_forces, printed_error
from atc.agreement.thermo import Line
from atc.errors import AtcError, AtcWarning
from atc.readers.trajectory import resolution_of

NVE = "fix 1 all nve\ntimestep 0.5\nrun 5"
RIGID = WATER + "\nspecial_bonds lj/coul 0 0 0"
NEUTRAL = "pair_style lj/cut 8.0\npair_coeff 1 1 0.3 2.6\npair_coeff 2 2 0.2 3.4\npair_coeff 1 2 0.25 3.0"
NO_CHARGES = "id type x y z vx vy vz fx fy fz"


def compared(folder, config, model, script, mine=None, *, topology=True, units=None, **options):
    """The second frame of a run beside a potential (by default that of the run)."""
    dump, _ = run(folder, config, model, script, log=False, **options)
    traj = atc.read(dump, topology=folder / "run.data" if topology else None)
    frame = traj[1]
    return compare_forces(
        frame, atc.potential(mine or model, units=units or config.units), 1, resolution=resolution_of(traj, frame)
    )


@pytest.mark.parametrize("fmt", ["%.15g", "%.9g", "%g", "%.4f", "%.4g"])
def test_digits_explain_what_they_hide(tmp_path, fmt):
    """The right potential agrees however few digits were written; the share says how much they hide."""
    found = compared(tmp_path, argon(), ARGON, NVE, fmt=fmt)
    assert found.agrees and found.differ == 0 and not found.looks and "yes" in str(found)
    low, high = {
        "%.15g": (0, 1e-11),
        "%.9g": (1e-9, 1e-6),
        "%g": (1e-6, 1e-3),
        "%.4f": (1e-6, 2e-3),
        "%.4g": (1e-4, 0.1),
    }[fmt]
    assert low <= found.share < high


@pytest.mark.parametrize("fmt, sigma", [("%.15g", 3.4000001), ("%.9g", 3.40001), ("%g", 3.41)])
def test_a_coefficient_beyond_the_digits(tmp_path, fmt, sigma):
    """A coefficient that is wrong by more than the digits hide is seen."""
    found = compared(tmp_path, argon(), ARGON, NVE, ARGON.replace("0.238 3.4", f"0.238 {sigma}"), fmt=fmt)
    assert not found.agrees and found.share > found.explained and "everything: forces between atoms" in found.looks
    assert len(found.worst) == 5 and set(found.worst) <= set(range(1, 217))


FROM_OUTSIDE = {
    "fix 2 all gravity 0.001 vector 0 0 -1": "proportional to mass, acceleration [0, 0, ",
    "fix 2 all gravity 0.001 vector 1 0 -1": "fix gravity",
    "fix 2 all addforce 0.1 0 0": "the same force [0.1, 0, 0] kcal/mol/angstrom on each atom (all atoms)",
    "group g type 2\nfix 2 g addforce 0 0.1 0": "on each atom (the atoms of type 2)",
    "fix 2 all setforce NULL NULL 0.0": "forces along z set to 0 (all atoms)",
    "fix 2 all planeforce 1 0 0": "forces along x set to 0",
    "group g id 1:40\nfix 2 g setforce 0 0 0": "atoms without force (atoms 1 to 40)",
    "group g id 1:40\nfix 2 g setforce 0.2 NULL NULL": "forces along x set to one value (atoms 1 to 40)",
    "fix 2 all viscous 5.0": "proportional to velocity, against it (all atoms): friction",
    "fix 2 all viscous 5.0 scale 2 2.0": "friction (fix viscous, drag)",
    "fix 2 all langevin 120 120 100.0 4711": "a thermostat with noise (fix langevin)",
    "group g type 1\nfix 2 g langevin 120 120 1000.0 4711": "(the atoms of type 1): a thermostat with noise",
    "group g id 1:40\nfix 2 g spring tether 10 3 3 3 0": "force on their centre of mass (fix spring",
    "group g id 1:40\nfix 2 g spring/self 10.0": "atoms 1 to 40, and the differences do not add up to zero: forces "
    "from outside",
    "neigh_modify exclude type 1 2": "everything: forces between atoms",
    "group g id 1:40\nneigh_modify exclude group g g": "atoms 1 to 40: forces between atoms",
}


@pytest.mark.parametrize("script", FROM_OUTSIDE)
@pytest.mark.parametrize("fmt", ["%.15g", "%g"])
def test_what_a_script_adds(tmp_path, script, fmt):
    """What fixes add to the forces is named for what it is, with all digits and with LAMMPS's six."""
    found = compared(tmp_path, argon(), ARGON, script + "\n" + NVE, fmt=fmt)
    expected = FROM_OUTSIDE[script]
    if fmt == "%g" and "spring/self" in script:  # five steps on, an atom is where its velocity took it
        expected = "(atoms 1 to 40): friction (fix viscous, drag), or springs to where the atoms just were"
    assert not found.agrees and expected in found.looks, found.looks


def test_walls_act_along_one_axis(tmp_path):
    config = argon(periodic=(True, True, False))
    wall = compared(tmp_path, config, ARGON, "fix 2 all wall/lj93 zlo EDGE 0.3 3.0 7.5\n" + NVE)
    assert not wall.agrees and "forces along z only" in wall.looks and "with z from" in wall.looks and wall.differ < 216


def test_an_electric_field(tmp_path):
    found = compared(tmp_path, argon(charges=True), ARGON, "fix 2 all efield 0.1 0.0 0.05\n" + NVE)
    assert "proportional to charge, [2.306, 0, 1.153] kcal/mol/angstrom for each unit of charge" in found.looks


CONSTRAINED = {
    "fix 2 all shake 1e-8 100 0 b 1 a 1": "constraint forces along bonds of fixed length (bond type 1)",
    "fix 2 all shake 1e-4 100 0 b 1": "constraint forces along bonds of fixed length (bond type 1)",
    "fix 2 all rattle 1e-8 100 0 b 1 a 1": "constraint forces along bonds of fixed length (bond type 1)",
    "group g id 1:60\ndelete_bonds g bond 1": "forces along bonds (types 1)",
    "group g id 1:60\ndelete_bonds g angle 1": "forces within bonded triples",
}


@pytest.mark.parametrize("script", CONSTRAINED)
def test_molecules(tmp_path, script):
    script_of_run = NVE.replace("fix 1 all nve\n", "") if "rattle" in script else NVE
    nve = "fix 1 all nve\n" if "rattle" in script else ""
    found = compared(tmp_path, water(), RIGID, nve + script + "\n" + script_of_run)
    assert not found.agrees and CONSTRAINED[script] in found.looks, found.looks


@pytest.mark.parametrize(
    "old, new, looks",
    [("450.0", "440.0", "forces along bonds (types 1)"), ("1 55.0", "1 50.0", "forces within bonded triples")],
)
def test_bonded_coefficients(tmp_path, old, new, looks):
    found = compared(tmp_path, water(), RIGID, NVE, RIGID.replace(old, new))
    assert not found.agrees and looks in found.looks


def test_molecules_without_their_bonds(tmp_path):
    """Only the column mol says which atoms belong together."""
    pair = "\n".join(WATER.splitlines()[:3])
    found = compared(tmp_path, water(), RIGID, NVE, pair, topology=False, columns="id mol type x y z fx fy fz")
    assert not found.agrees and "forces within molecules (they add up to zero in each)" in found.looks


@pytest.mark.parametrize(
    "script, mine, looks",
    [
        ("set type 1*2 charge 0.0", SALT, "charges that were 0 in it"),
        ("set type 1 charge 0.9\nset type 2 charge -0.9", SALT, "Coulomb forces of other charges, all 0.9 times these"),
        ("set type 1 charge 0.9", SALT, "Coulomb forces of other charges: 0.9 times these on type 1"),
        ("", NEUTRAL, "Coulomb forces that the potential does not have"),
    ],
)
def test_charges(tmp_path, script, mine, looks):
    found = compared(tmp_path, salt(), SALT, script + "\n" + NVE, mine, columns=NO_CHARGES)
    assert not found.agrees and looks in found.looks, found.looks


@pytest.mark.parametrize("mine", [SALT, SALT.replace("dsf 0.2", "cut")])
def test_distant_charges(tmp_path, mine):
    model = NEUTRAL.replace("lj/cut", "lj/cut/coul/long") + "\nkspace_style ewald 1e-6"
    found = compared(tmp_path, salt(), model, NVE, mine)
    assert not found.agrees and "Coulomb forces from beyond the cutoff (kspace_style)" in found.looks


def test_units_are_named(tmp_path):
    """Coefficients in kcal/mol read as eV, and a trajectory of metal units read as real: one factor, and which units it
    fits."""
    found = compared(tmp_path, argon(), ARGON, NVE, units="metal")
    assert (
        not found.agrees
        and "0.0433641 times" in found.looks
        and "coefficients in 'real' units read as 'metal'" in found.looks
    )
    twice = compared(tmp_path, argon(), ARGON, NVE, ARGON.replace("0.238", "0.476").replace("0.3 ", "0.6 "))
    assert "one factor for all: the run's forces are 0.5 times" in twice.looks and "energy scale" in twice.looks


def test_a_trajectory_in_other_units(tmp_path):
    dump, _ = run(
        tmp_path, argon(units="metal"), ARGON.replace("0.238", "0.0103"), NVE.replace("0.5", "0.001"), log=False
    )
    text = dump.read_text().replace("ITEM: UNITS\nmetal", "ITEM: UNITS\nreal")
    dump.write_text(text)
    frame = atc.read(dump, topology=tmp_path / "run.data")[1]
    found = compare_forces(frame, atc.potential(ARGON.replace("0.238", "0.0103"), units="metal"), 1)
    assert not found.agrees and "a trajectory in 'metal' units read as 'real'" in found.looks


def test_a_pair_at_its_cutoff(tmp_path):
    """Whether a pair beyond or within its cutoff by less than the last digit acts is no difference; the same pair a
    little nearer is."""
    config = argon()
    dump, _ = run(tmp_path, config, ARGON.replace("8.0", "6.0"), "fix 1 all nve\nrun 0", log=False)
    frame = atc.read(dump, topology=tmp_path / "run.data")[0]
    ends = "pair_style lj/cut 6.0\npair_coeff * * 0.238 3.4\npair_coeff 2 2 0.3 3.3\npair_coeff 1 2 0.238 3.4 {}"
    i, j = 0, int(np.flatnonzero(frame.types != frame.types[0])[0])
    r = frame.positions[i] - frame.positions[j]
    r -= np.rint(r / 21.0) * 21.0
    d = float(np.linalg.norm(r))
    inside, beyond = (atc.potential(ends.format(f"{d + s:.12f}"), units="real") for s in (1e-5, -1e-5))
    run_forces = inside.stream(frame, None, forces=True).forces_nc
    as_run = frame.replace(forces=np.array([[float(f"{c:.9e}") for c in f] for f in run_forces]))
    near = compare_forces(as_run, beyond, resolution=1e-5)
    assert near.agrees, str(near)
    far = compare_forces(as_run, atc.potential(ends.format(f"{d - 0.02:.12f}"), units="real"), resolution=1e-7)
    assert not far.agrees


@pytest.mark.parametrize("form", ["{:.6g}", "{:.3f}", "{:.15g}", "single"])
@pytest.mark.parametrize("unit", [1.0, 0.0433641])
def test_printed_digits_are_told(form, unit):
    """What was lost in print is within the estimate, and not far below it."""
    x = np.random.default_rng(0).normal(0, 3, (400, 3))
    seen = (
        x.astype(np.float32).astype(float)
        if form == "single"
        else np.array([[float(form.format(c)) for c in r] for r in x])
    )
    error, estimate = np.linalg.norm(seen - x, axis=1) * unit, printed_error(seen * unit, unit)
    assert (error <= estimate * 1.0001 + 1e-15).all() and np.sqrt((error**2).mean()) > 0.1 * np.sqrt(
        (estimate**2).mean()
    )


def test_nan_never_agrees():
    assert _within(np.array([0.0, 1e-9]), np.array([1e-8, 1e-8]))[0]
    assert not _within(np.array([0.0, np.nan]), np.array([1e-8, 1e-8]))[0]
    assert not _within(np.array([0.0, 1.0]), np.array([1e-8, np.nan]))[0]
    assert not Line("energy", "eV", np.nan, 1.0, 1e9).agrees and Line("energy", "eV", 1.0, 1.0, 0.0).agrees


# --- fields, plan, info


SCENE = """\
[trajectory]
file = "run.dump"
topology = "run.data"
[potential]
units = "real"
lammps = '''
{model}
'''
[kernel]
name = "quartic"
radius = 8.0
[grid]
kind = "regular"
shape = [3, 3, 3]
[fields]
quantities = ["{quantity}"]
[output]
file = "out.nc"
"""


@pytest.fixture(scope="module")
def argon_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("argon")
    run(
        folder,
        argon(),
        ARGON,
        "thermo_style custom step temp pe press pxx\nthermo 1\nfix 1 all nve\ntimestep 1.0\nrun 7",
        every=1,
    )
    return folder


def scene(folder, model=ARGON, quantity="stress", **trajectory):
    from atc.config.scene import Scene

    path = folder / "scene.toml"
    path.write_text(SCENE.format(model=model, quantity=quantity))
    return Scene.load(path, {f"trajectory.{k}": v for k, v in trajectory.items()})


WRONG = ARGON.replace("0.238 3.4", "0.238 3.45")


def test_agreement_is_an_attribute(argon_run, tmp_path):
    """Of the first frame and one from the middle; no warning where they agree."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", AtcWarning)
        ds = scene(argon_run).run(tmp_path / "out.nc")
        text = ds.attrs["agrees_with_run"]
        assert "forces of frame 0: yes, rms difference" in text and "forces of frame 4: yes" in text
        assert scene(argon_run, log="run.log").run().attrs["agrees_with_run"].count("energy and pressure of frame") == 2
        assert "depends on the potential" in scene(argon_run, quantity="density").run().attrs["agrees_with_run"]
        ignored = scene(argon_run, WRONG, forces="ignore").run().attrs["agrees_with_run"]
        assert ignored.startswith("not known") and "ignored" in ignored


def test_a_wrong_potential_is_a_warning_everywhere(argon_run):
    from atc.analysis.info import describe_scene

    made = scene(argon_run, WRONG, log="run.log")
    for act in (made.plan, made.run, lambda: describe_scene(made)):
        with pytest.warns(AtcWarning) as caught:
            found = act()
        said = [str(w.message) for w in caught if "does not agree with the potential" in str(w.message)]
        assert len(said) == 2 and "forces of frame 0 differ" in said[0] and "step 0 of run.log" in said[1], said
        text = getattr(found, "agreement", None) or getattr(found, "attrs", getattr(found, "data", {})).get(
            "agrees_with_run"
        )
        assert text.startswith("no: forces of frame 0 differ from the potential's by ")
    assert "run     agrees with the potential? no: " in str(made_plan(made))


def made_plan(made):
    with pytest.warns(AtcWarning):
        return made.plan()


def test_must_agree_is_an_error_before_anything_is_computed(argon_run, tmp_path, monkeypatch):
    from atc.running import first_frames, parallel

    for where in (first_frames, parallel):
        monkeypatch.setattr(where, "fields_of", lambda *a, **k: pytest.fail("computed"))
    with pytest.raises(AtcError, match='forces = "must agree", but forces of frame 0 differ') as e:
        scene(argon_run, WRONG, forces="must agree").write(tmp_path / "out.nc")
    assert "\n" not in str(e.value) and not list(tmp_path.iterdir())


def test_must_agree_needs_something_to_agree_with(tmp_path):
    run(tmp_path, argon(), ARGON, NVE, columns="id type x y z vx vy vz")
    with pytest.raises(AtcError, match="the trajectory has no forces"):
        scene(tmp_path, forces="must agree").run()
    assert "not known: the trajectory has no forces" in scene(tmp_path).run().attrs["agrees_with_run"]
    assert (
        "energy and pressure of frame 0 (step 0 of run.log): yes"
        in scene(tmp_path, log="run.log").run().attrs["agrees_with_run"]
    )


def test_what_the_script_says_of_forces_from_outside_is_named(argon_run):
    traj = atc.read(argon_run / "run.dump", topology=argon_run / "run.data")
    pot = atc.potential(WRONG, units="real")
    pot.outside = ("fix wall/lj93 on group all (in.run, line 12)",)
    assert "fix wall/lj93 on group all (in.run, line 12)" in str(compare_forces(traj[0], pot))


def test_a_run_that_goes_on_does_not_compare_again(argon_run, tmp_path, monkeypatch):
    import atc.agreement.forces
    import atc.agreement.run_check

    out = tmp_path / "out.nc"
    made = scene(argon_run)
    calls = []

    def stop(done, total, rate):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made.write(out, progress=stop)
    monkeypatch.setattr(atc.agreement.run_check, "compare_forces", lambda *a, **k: calls.append(1))
    assert "forces of frame 4: yes" in made.write(out)["agrees_with_run"] and not calls


def test_the_python_call_says_whether_digits_explain(argon_run):
    traj = atc.read(argon_run / "run.dump", topology=argon_run / "run.data")[:2]
    good, bad = (atc.verify(traj, atc.potential(m, units="real")) for m in (ARGON, WRONG))
    assert (
        all(f.agrees for f in good.frames)
        and good.force_error < 1e-11
        and "explained by the file's digits" in str(good)
    )
    assert not any(f.agrees for f in bad.frames) and "it looks like everything" in str(bad) and bad.force_error > 1e-3
