"""Springs from fluctuations: synthetic trembling with a known covariance, and argon that LAMMPS shakes, against the
lattice's own dynamical matrix and elastic constants."""

import warnings

import numpy as np
import pytest
from crystals import crystal, elastic, model
from lammps_oracle import lammps_session
from trembling import trembling

import atc
from atc.errors import AtcError
from atc.upscaling.fluctuations import fluctuations, operations, symmetrised
from atc.upscaling.force_constants import force_constants


@pytest.mark.parametrize("name, repeat", [("argon", (4, 4, 4)), ("silicon", (3, 3, 3))])
def test_samples_of_a_harmonic_crystal(name, repeat):
    """D(k) within its error bar of the lattice's, the basis at rest in its cell; the constants within theirs."""
    found = fluctuations(trembling(name, repeat, 200), crystal(name))
    from atc.upscaling.node_kernel import condensed

    want = condensed(force_constants(crystal(name), model(name)), found.k_kc)
    off = np.linalg.norm(found.D_kcc - want, axis=(1, 2)) / np.linalg.norm(want, axis=(1, 2))
    assert len(found.k_kc) == np.prod(repeat) - 1
    bar = np.sqrt((found.error_k**2).mean())
    assert np.sqrt((off**2).mean()) < 2 * bar and bar < 0.1
    if name == "silicon":
        assert found.elastic is None and found.fc is None
        return
    C, bars = found.elastic.C_vv, found.C_error_vv
    exact = elastic(name).C_vv
    # Shells beyond those that the supercell has whole are lost: that is in no error bar.
    assert (np.abs(C - exact) < 3 * bars + 0.03 * exact.max()).all() and bars.max() < 0.08 * exact.max()
    assert found.fc.dynamical_matrix(found.k_kc[:1])[0].real == pytest.approx(
        want[0], rel=0.25, abs=0.1 * want[0].max()
    )


def test_the_group_leaves_the_lattices_own_matrix_alone():
    frames = trembling("argon", (3, 3, 3), 31)
    found = fluctuations(frames, crystal("argon"))
    from atc.upscaling.sites import find_sites

    D = force_constants(crystal("argon"), model("argon")).dynamical_matrix(found.k_kc).real
    sites = find_sites(frames[0], crystal("argon"))
    assert symmetrised(D, found.k_kc, sites) == pytest.approx(D, abs=1e-9 * np.abs(D).max())
    assert len(np.unique(operations(crystal("argon")).round(6), axis=0)) == 48


def test_argon_of_lammps(tmp_path):
    """108 atoms at 5 K under a Langevin thermostat: within three error bars of the lattice at rest."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    with lammps_session() as lmp:
        for line in f"""units metal
lattice fcc {a:.15g}
region box block 0 3 0 3 0 3
create_box 1 box
create_atoms 1 box
mass 1 39.948
pair_style lj/cut 8.5
pair_coeff 1 1 0.0104 3.40
velocity all create 10 5 mom yes rot no dist gaussian
timestep 0.008
fix nve all nve
fix lan all langevin 5 5 1.0 77 zero yes
run 1500
reset_timestep 0 time 0.0
dump d all custom 60 {tmp_path}/still.dump id xu yu zu vx vy vz
dump_modify d sort id units yes time yes format line "%d %.6f %.6f %.6f %.5f %.5f %.5f"
run 12000""".splitlines():
            lmp.command(line)
    found = fluctuations(atc.read(tmp_path / "still.dump", masses=[39.948]), crystal("argon"))
    assert found.temperature == pytest.approx(5.0, rel=0.05) and found.frames == 201
    want = force_constants(crystal("argon"), model("argon")).dynamical_matrix(found.k_kc).real
    off = np.linalg.norm(found.D_kcc - want, axis=(1, 2)) / np.linalg.norm(want, axis=(1, 2))
    assert np.sqrt((off**2).mean()) < 2 * np.sqrt((found.error_k**2).mean()) < 0.16
    assert (np.abs(found.elastic.C_vv - elastic("argon").C_vv) < 3 * found.C_error_vv + 1e-9).all()


def test_what_is_no_equilibrium():
    frames = trembling("argon", (3, 3, 3), 31)
    with pytest.raises(AtcError, match="too few for fluctuations"):
        fluctuations(frames[:20], crystal("argon"))
    # One wave alone keeps all the energy.
    k = 2 * np.pi * np.linalg.inv(frames[0].cell.vectors).T[0]
    wave = np.cos(frames[0].positions @ k)[:, None] * [0, 1.0, 0]
    rng = np.random.default_rng(1)
    loud = [f.replace(velocities=f.velocities + 30 * np.abs(f.velocities).mean() * rng.normal() * wave) for f in frames]
    with pytest.warns(atc.AtcWarning, match="not shared their energy"):
        fluctuations(loud, crystal("argon"))
    with warnings.catch_warnings():
        warnings.simplefilter("error", atc.AtcWarning)
        fluctuations(frames, crystal("argon"))
