"""A LAMMPS that runs in another process streams its frames (IMDv3) through MDAnalysis: fields as from its dump.

Runs in the environment of ``make test-tools``, which has imdclient.
"""

import socket
import subprocess
import sys
import time

import numpy as np
import pytest

import atc
from atc.errors import AtcError

pytestmark = pytest.mark.tools

RUN = """
units real
atom_style atomic
lattice fcc 5.4
region box block 0 4 0 3 0 3
create_box 1 box
create_atoms 1 box
mass 1 39.948
velocity all create 120 87287
pair_style lj/cut 8.5
pair_coeff * * 0.238 3.4
timestep 2.0
fix 1 all nve
write_data run.data
fix i all imd {port} version 3 unwrap off trate 10 time on box on coordinates on velocities on forces on nowait off
dump d all custom 10 x.dump id type x y z vx vy vz fx fy fz
dump_modify d format float %.17g sort id time yes
run 60
"""
LJ = "pair_style lj/cut 8.5\npair_coeff * * 0.238 3.4"


@pytest.fixture
def simulation(tmp_path):
    """A run that waits for somebody to listen; its folder and port."""
    with socket.socket() as s:
        s.bind(("localhost", 0))
        port = s.getsockname()[1]
    code = (
        f"import sys; sys.path[:0] = {sys.path!r}\nfrom lammps_oracle import lammps_session\n"
        f"with lammps_session() as lmp:\n    lmp.commands_string({RUN.format(port=port)!r})\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path)
    for _ in range(300):
        # Whether somebody listens, without connecting: the run takes the first who does for its listener.
        listening = any(f":{port:04X} " in line and " 0A " in line for line in open("/proc/net/tcp"))
        if listening or process.poll() is not None:
            break
        time.sleep(0.1)
    assert listening
    yield tmp_path, port
    try:
        process.wait(20)
    finally:
        process.kill()
    assert process.returncode == 0


def asked():
    return dict(pot=atc.potential(LJ, units="real"), kern=atc.kernel("quartic", 6.0), grid=atc.Grid.slab("x", 4),
                quantities=["stress", "velocity", "density"], tolerance=1e-12, average=True)  # fmt: skip


def same_as_dump(ds, folder):
    traj = atc.read(folder / "x.dump", units="real", masses={1: 39.948})[1:]
    want = atc.fields(traj, **asked())
    assert int(ds.frames_averaged[0]) == 6 and int(ds.step[0]) == 10
    for name in ("stress", "velocity", "density"):  # float32
        np.testing.assert_allclose(ds[name], want[name], atol=2e-5 * float(np.abs(want[name]).max()))


def test_fields_of_a_stream(simulation):
    folder, port = simulation
    traj = atc.read(f"imd://localhost:{port}", topology=folder / "run.data", units="real", masses={1: 39.948})
    for use in (lambda: len(traj), lambda: traj[0]):
        with pytest.raises(AtcError, match="is a stream"):
            use()
    ds = atc.fields(traj, **asked(), forces="must agree")
    same_as_dump(ds, folder)


def test_scene_with_a_stream(simulation):
    from typer.testing import CliRunner

    from atc.cli import app

    folder, port = simulation
    (folder / "s.toml").write_text(
        f'[trajectory]\nfile = "imd://localhost:{port}"\ntopology = "run.data"\nunits = "real"\n'
        f'masses = {{ 1 = 39.948 }}\n[potential]\nlammps = """\n{LJ}\n"""\n[kernel]\nname = "quartic"\nradius = 6.0\n'
        '[grid]\nkind = "slab"\naxis = "x"\nbins = 4\n[fields]\nquantities = ["stress", "velocity", "density"]\n'
        "tolerance = 1e-12\naverage = true\n"
    )
    result = CliRunner().invoke(app, ["fields", str(folder / "s.toml"), "-o", str(folder / "out.nc")])
    assert result.exit_code == 0, result.output
    ds = atc.open_dataset(folder / "out.nc")
    assert "localhost" not in ds.attrs["scene"]
    same_as_dump(ds, folder)


def test_wrong_units_are_noticed(simulation):
    """LAMMPS sends its own units, MDAnalysis takes them for kJ/mol: the forces say so."""
    folder, port = simulation
    traj = atc.read(f"imd://localhost:{port}", topology=folder / "run.data", masses={1: 39.948})
    with pytest.warns(UserWarning, match="does not agree with the potential"):
        atc.fields(traj, **asked())


def test_nobody_answers(tmp_path):
    import MDAnalysis as mda

    universe = mda.Universe.empty(4, trajectory=False)
    with pytest.raises(AtcError, match="no simulation of 4 atoms answers there by IMDv3: start it first"):
        atc.read("imd://localhost:1", topology=universe)
    with pytest.raises(AtcError, match="give topology="):
        atc.read("imd://localhost:1")
