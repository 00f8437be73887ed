"""Forces that depend on more of the atoms than places, types and charges (spins, sizes of electrons), each against
LAMMPS: energy, forces, virial."""

import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError

SPINS = """units metal
atom_style spin
atom_modify map array
lattice bcc 2.8665
region b prism 0 3 0 3 0 3 0.4 0.2 0.1
create_box 2 b
create_atoms 1 box
set group all type/ratio 2 0.4 551
mass * 55.845
displace_atoms all random 0.2 0.2 0.2 887
set group all spin/random 31 2.2
pair_style hybrid/overlay lj/cut 3.9 {style} 3.9
pair_coeff * * lj/cut 0.1 2.3
{coeffs}
timestep 0.0001
fix move all nve/spin lattice moving
compute own all property/atom sp spx spy spz
run 0
"""
EXCHANGE = """pair_coeff * * spin/exchange exchange 3.4 0.02726 0.2171 1.841
pair_coeff 1 2 spin/exchange exchange 3.7 0.05 -0.1 1.6 offset yes"""
BIQUADRATIC = """pair_coeff * * spin/exchange/biquadratic biquadratic 3.4 0.02726 0.2171 1.841 0.03 0.1 1.7 offset yes
pair_coeff 2 2 spin/exchange/biquadratic biquadratic 3.9 0.05 0.1 1.7 -0.02 0.2 1.5"""

ELECTRONS = """units {units}
atom_style electron
atom_modify map array
comm_modify vel yes
region b block 0 {L} 0 {L} 0 {L}
create_box 3 b
create_atoms 1 random 6 811 b
create_atoms 2 random 9 917 b
create_atoms 3 random 4 511 b
mass * 1.0
set type 1 charge 3.0 spin/electron 0
set type 2 charge 0.0 spin/electron 1
set atom 9*12 spin/electron -1
set type 3 charge 4.0 spin/electron 2
set type 2 radius/electron {a}
set atom 9 radius/electron {c}
set type 3 radius/electron {c}
set atom 18 radius/electron {a}
pair_style eff/cut {rc}
pair_coeff * *
compute own all property/atom spin eradius
timestep 1e-6
run 0
"""
SCALE = {"electron": 1.0, "real": 0.529}


def electrons(units):
    s = SCALE[units]
    return ELECTRONS.format(units=units, L=9.0 * s, a=1.1 * s, c=0.7 * s, rc=4.4 * s)


def run(tmp_path, text, columns):
    """LAMMPS runs the script; its energy, forces, virial tensor and dump."""
    script = tmp_path / "in.run"
    script.write_text(text)
    with lammps_session() as lmp:
        lmp.file(str(script))
        lmp.command("compute p all pressure NULL pair")
        lmp.command("thermo_style custom step pe vol c_p[*]")
        lmp.command("run 0 post no")
        lmp.command(
            f"write_dump all custom {tmp_path}/run.dump id type x y z fx fy fz {columns} modify sort id units yes "
            "format float %.17g"
        )
        p = np.array(lmp.numpy.extract_compute("p", 0, 1))
        return script, lmp.get_thermo("pe"), p * lmp.get_thermo("vol")


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (SPINS.format(style="spin/exchange", coeffs=EXCHANGE), "c_own[2] c_own[3] c_own[4]"),
        (SPINS.format(style="spin/exchange/biquadratic", coeffs=BIQUADRATIC), "c_own[2] c_own[3] c_own[4]"),
        (electrons("electron"), "q c_own[1] c_own[2]"),
        (electrons("real"), "q c_own[1] c_own[2]"),
    ],
    ids=["exchange", "biquadratic", "eff electron", "eff real"],
)
def test_against_lammps(tmp_path, text, columns):
    script, energy, virial = run(tmp_path, text, columns)
    frame = atc.read(tmp_path / "run.dump")[0]
    pot = atc.potential(script)
    mine = pot.stream(frame, forces=True, energies=True)
    u = frame.units
    forces = frame.forces
    assert np.abs(mine.forces_nc - forces).max() < 1e-10 * np.abs(forces).max()
    assert u.to_user("energy", mine.energy) == pytest.approx(energy, rel=1e-10)
    assert mine.energies_n.sum() == pytest.approx(mine.energy, rel=1e-12)
    # LAMMPS's pressure is nktv2p W/V with W = −Σ G r⊗r
    mine_p = -u.to_user("pressure", mine.virial_cc / frame.cell.volume) * u.to_user("volume", frame.cell.volume)
    got = mine_p[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    assert np.abs(got - virial).max() < 1e-10 * np.abs(virial).max()


def test_frames_must_show_what_moves(tmp_path):
    text = electrons("electron")
    script, *_ = run(tmp_path, text, "q")
    frame = atc.read(tmp_path / "run.dump")[0]
    with pytest.raises(AtcError, match=r"run.dump.*columns spin eradius are missing.*compute name all property/atom"):
        atc.potential(script).stream(frame)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            ("lattice moving", "lattice frozen"),
            r"in.run, line 17: fix nve/spin lattice frozen: LAMMPS then computes no forces of spins",
        ),
        (("fix move all nve/spin lattice moving", "fix move all nve"), "only with fix nve/spin ... lattice moving"),
        (("offset yes", "offset perhaps"), "line 15: .*offset: expected yes or no, got perhaps"),
        (("exchange 3.7", "biquadratic 3.7"), "line 15: .*expected the word exchange"),
    ],
)
def test_runs_without_forces_of_spins(tmp_path, change, what):
    script = tmp_path / "in.run"
    script.write_text(SPINS.format(style="spin/exchange", coeffs=EXCHANGE).replace(*change))
    with pytest.raises(AtcError, match=what):
        atc.potential(script)


def test_effective_cores_are_refused(tmp_path):
    script = tmp_path / "in.run"
    script.write_text(electrons("electron").replace("eff/cut 4.4", "eff/cut 4.4 ecp 3 C"))
    with pytest.raises(AtcError, match=r"in.run, line \d+: .*effective core potentials are not supported"):
        atc.potential(script)
