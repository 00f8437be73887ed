"""What a run's own Coulomb sum leaves open, in the comparison of model and run: LAMMPS's erfc, its table of it, and the
accuracy that it was asked for."""

import numpy as np
import pytest
from lammps_oracle import lammps_session, run_lammps
from lammps_runs import water
from typer.testing import CliRunner

import atc
from atc.agreement.forces import compare_forces
from atc.agreement.real_space import POLYNOMIAL, coulomb_doubt, relative_error
from atc.decomposers.long_range.kspace import coulomb_of

MODEL = """pair_style lj/cut/coul/long 4.9
bond_style harmonic
angle_style harmonic
{data}pair_coeff 1 1 0.155 3.166
pair_coeff 1 2 0.0 1.0
pair_coeff 2 2 0.0 1.0
bond_coeff 1 450.0 0.9572
angle_coeff 1 55.0 104.52
kspace_style {kspace}
pair_modify table {bits}
"""


def ran(kspace, bits):
    config = water(n=3)
    lines = MODEL.format(data="", kspace=kspace, bits=bits)
    theirs = run_lammps(lines, config)
    frame = config.frame()
    frame = frame.replace(forces=frame.units.to_internal("force", theirs.forces_nc))
    return frame, atc.potential("units real\n" + lines), theirs


@pytest.mark.parametrize("bits", [0, 8, 12, 16])
@pytest.mark.parametrize("kspace", ["ewald 1e-10", "ewald 1e-5", "pppm 1e-4"])
def test_a_run_is_as_good_as_it_can_be(kspace, bits):
    """The differences are within what is said of them; with a tight sum, what is said is not far above them."""
    frame, pot, theirs = ran(kspace, bits)
    found, u = compare_forces(frame, pot), frame.units
    assert found.agrees and found.needs_coulomb, found
    assert "the accuracy of the run's Coulomb sum" in str(found)
    doubt = found.coulomb
    force = found.rms_difference / np.sqrt((doubt.force_n**2).mean())
    energy = abs(found.energy - u.to_internal("energy", theirs.energy)) / doubt.energy
    virial = np.abs(found.virial_cc - u.to_internal("pressure_volume", theirs.virial)) / doubt.virial_cc
    assert force < 1.5 and energy < 1 and (virial < 1).all(), (force, energy, virial)
    if kspace == "ewald 1e-10":
        assert force > 0.005


def test_a_table_is_as_good_as_its_bits():
    pot = ran("ewald 1e-10", 12)[1]
    (style,) = coulomb_of(pot.terms)
    errors = []
    for style.run_table in (0, 8, 10, 12):
        errors.append(relative_error(style, pot.units.length))
    assert errors[0] == POLYNOMIAL and errors[1] > errors[2] > errors[3] > POLYNOMIAL
    # two more bits, a quarter of the step
    assert (errors[1] - POLYNOMIAL) / (errors[2] - POLYNOMIAL) == pytest.approx(16)


def test_wrong_charges_are_seen_beyond_it():
    """An error of the charges by 1e-5 is more than erfc leaves open."""
    frame, pot, _ = ran("ewald 1e-10", 0)
    assert compare_forces(frame, pot).agrees
    wrong = compare_forces(frame.replace(charges=frame.charges * (1 + 1e-5)), pot)
    assert not wrong.agrees and wrong.differ > 0


def test_potentials_without_one_have_no_doubt():
    frame = water(n=3).frame()
    assert (
        coulomb_doubt(frame, atc.potential("units real\npair_style lj/cut/coul/cut 4.9\npair_coeff * * 0.1 3.0"))
        is None
    )


@pytest.mark.parametrize("kspace", ["ewald 1e-9", "pppm 1e-4"])
def test_verify_says_so(tmp_path, kspace):
    """Forces, energy and pressure of shaken water, script, dump and log as the run left them."""
    water(n=3).write_data(tmp_path / "w.data")
    fix = "fix n all nve\nfix h all shake 1e-10 200 0 b 1 a 1\n"
    model = MODEL.format(data="read_data w.data\n", kspace=kspace, bits=0)
    thermo = "thermo_style custom step temp pe ke press pxx pyy pzz pxy pxz pyz vol\nthermo_modify format float %.15g\n"
    dump = (
        "dump d all custom 5 run.dump id mol type q x y z vx vy vz fx fy fz\ndump_modify d sort id format float %.17g\n"
    )
    head = "units real\natom_style full\n"
    text = head + model + "timestep 0.2\n" + fix + thermo + "thermo 5\n" + dump + "run 10\n"
    (tmp_path / "in.run").write_text(text)
    with lammps_session(log=tmp_path / "log.lammps") as lmp:
        for line in (
            text.replace("w.data", f"{tmp_path}/w.data").replace("run.dump", f"{tmp_path}/run.dump").splitlines()
        ):
            lmp.command(line)
    (tmp_path / "scene.toml").write_text(
        '[trajectory]\nfile = "run.dump"\nunits = "real"\nlog = "log.lammps"\n[potential]\ninput = "in.run"\n'
        '[grid]\nkind = "regular"\nshape = [2, 2, 2]\n[kernel]\nname = "quartic"\nradius = 4.0\n[fields]\nquantities = ["stress"]\n[output]\nfile = "out.nc"\n'
    )
    from atc.cli.root import app

    result = CliRunner().invoke(app, ["verify", str(tmp_path / "scene.toml")])
    assert result.exit_code == 0, result.output
    assert "note: explained are digits and the accuracy of the run's Coulomb sum" in result.output
    assert "erfc is good to 1.5e-07 of a pair's" in result.output
