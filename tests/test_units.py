"""Every LAMMPS unit style against a running LAMMPS: its constants, and what it makes of a small gas."""

import numpy as np
import pytest
from lammps_oracle import Config, lammps_session, run_lammps

from atc.errors import AtcError
from atc.units import LAMMPS_STYLES, require_compatible, units

# A few multiplications and a square root of float64 numbers: 2^-52 each.
ROUNDING = 2e-15


@pytest.fixture(scope="module", params=LAMMPS_STYLES)
def style(request):
    """(unit system, LAMMPS's constants)."""
    with lammps_session() as lmp:
        lmp.commands_string(f"units {request.param}\nregion b block 0 10 0 10 0 10\ncreate_box 1 b\nmass 1 1")
        constants = {k: lmp.extract_global(k) for k in ("boltz", "mvv2e", "nktv2p", "mv2d", "qqr2e")}
    return units(request.param), constants


def test_constants_are_those_of_lammps(style):
    u, c = style
    assert u.boltzmann / u.energy == pytest.approx(c["boltz"], rel=ROUNDING, abs=0)
    assert u.mass * u.velocity**2 / u.energy == pytest.approx(c["mvv2e"], rel=ROUNDING, abs=0)
    assert u.energy / u.length**3 / u.pressure == pytest.approx(c["nktv2p"], rel=ROUNDING, abs=0)
    assert u.mass / u.length**3 / u.density == pytest.approx(c["mv2d"], rel=ROUNDING, abs=0)
    assert u.coulomb * u.charge**2 / (u.energy * u.length) == pytest.approx(c["qqr2e"], rel=ROUNDING, abs=0)


def test_a_gas_has_lammps_s_energies_temperature_pressure_and_density(style):
    """Kinetic energy, temperature, virial pressure, density and the Coulomb energy of two charges, through
    `to_internal` and `to_user`."""
    u, _ = style
    rng = np.random.default_rng(3)
    # Sizes around 1 in every style's own units: what matters are the factors between them.
    cell, n = np.array([20.0, 22.0, 24.0]), 2
    x = np.array([[5.0, 5.0, 5.0], [7.0, 6.0, 4.5]])
    config = Config(
        cell=cell,
        positions=x,
        velocities=rng.normal(size=(n, 3)),
        charges=[1.5, -0.7],
        masses={1: 3.25},
        units=u.name,
        periodic=(0, 0, 0),
    )
    res = run_lammps(
        "pair_style coul/cut 8\npair_coeff * *", config, after=("thermo_modify norm no", "run 0 post no"), skin=2.0
    )
    f = config.frame()
    kinetic = 0.5 * (f.masses[:, None] * f.velocities**2).sum()
    r = np.linalg.norm(f.positions[0] - f.positions[1])
    coulomb = u.coulomb * f.charges[0] * f.charges[1] / r
    assert u.to_user("energy", kinetic) == pytest.approx(
        res.kinetic, rel=1e-14, abs=0
    )  # a dozen operations, in another order
    assert u.to_user("energy", coulomb) == pytest.approx(res.energy, rel=1e-14, abs=0)
    # LAMMPS subtracts three degrees of freedom.
    assert 2 * kinetic / ((3 * n - 3) * u.boltzmann) == pytest.approx(res.temperature, rel=1e-14, abs=0)
    pv = (2 * kinetic + coulomb) / 3  # the virial of 1/r is its energy
    assert u.to_user("pressure", pv / f.cell.volume) == pytest.approx(res.pressure[:3].mean(), rel=1e-13, abs=0)
    assert u.to_user("volume", f.cell.volume) == pytest.approx(
        res.volume, rel=1e-13, abs=0
    )  # a determinant, rounded a dozen times


def test_mass_density_is_lammps_s(style):
    u, _ = style
    with lammps_session() as lmp:
        lmp.commands_string(
            f"units {u.name}\nregion b block 0 3 0 4 0 5\ncreate_box 1 b\nmass 1 7.5\ncreate_atoms 1 single 1 1 "
            "1\ncreate_atoms 1 single 2 2 2\n"
            "pair_style zero 1.0\npair_coeff * *\nthermo_style custom step density\nrun 0 post no"
        )
        theirs = lmp.get_thermo("density")
    mine = u.to_user("density", 2 * u.to_internal("mass", 7.5) / u.to_internal("volume", 60.0))
    assert mine == pytest.approx(theirs, rel=1e-14, abs=0)  # a handful of operations


# One physical state in the units of each style, from the SI: lengths in m, velocities in m/s, pressures in Pa, ...
# (LAMMPS manual, units).
SI = {
    "real": dict(
        length=1e-10,
        velocity=1e5,
        pressure=101325.0,
        density=1e3,
        time=1e-15,
        mass=1.66053906660e-27,
        energy=4184 / 6.02214076e23,
    ),
    "metal": dict(
        length=1e-10,
        velocity=1e2,
        pressure=1e5,
        density=1e3,
        time=1e-12,
        mass=1.66053906660e-27,
        energy=1.602176634e-19,
    ),
    "si": dict(length=1.0, velocity=1.0, pressure=1.0, density=1.0, time=1.0, mass=1.0, energy=1.0, charge=1.0),
    "cgs": dict(
        length=1e-2,
        velocity=1e-2,
        pressure=0.1,
        density=1e3,
        time=1.0,
        mass=1e-3,
        energy=1e-7,
        charge=3.3356409519815e-10,
    ),
    "electron": dict(
        length=5.29177210903e-11, pressure=1.0, time=1e-15, mass=1.66053906660e-27, energy=4.3597447222071e-18
    ),
    "micro": dict(
        length=1e-6, velocity=1.0, pressure=1e3, density=1e3, time=1e-6, mass=1e-15, energy=1e-15, charge=1e-12
    ),
    "nano": dict(
        length=1e-9,
        velocity=1.0,
        pressure=1e6,
        density=1e6,
        time=1e-9,
        mass=1e-21,
        energy=1e-21,
        charge=1.602176634e-19,
    ),
    "ase": dict(length=1e-10, pressure=1.602176634e11, mass=1.66053906660e-27, energy=1.602176634e-19),
    "gpumd": dict(
        length=1e-10, velocity=1e5, pressure=1.602176634e11, time=1e-15, mass=1.66053906660e-27, energy=1.602176634e-19
    ),
    "mdanalysis": dict(length=1e-10, velocity=1e2, time=1e-12, mass=1.66053906660e-27, energy=1e3 / 6.02214076e23),
}


@pytest.mark.parametrize("name,dimension", [(name, dimension) for name, sizes in SI.items() for dimension in sizes])
def test_sizes_of_units_against_the_si(name, dimension):
    # LAMMPS's constants are CODATA 2006 or older and rounded to about seven digits (nktv2p of `electron` to
    # 2.94210108e13).
    ratio = units(name).to_internal(dimension, 1.0) / units("si").to_internal(dimension, 1.0)
    assert ratio == pytest.approx(SI[name][dimension], rel=3e-6, abs=0)


@pytest.mark.parametrize("name", [*LAMMPS_STYLES, "ase", "gpumd", "mdanalysis"])
def test_there_and_back_and_labels(name):
    u = units(name)
    value = np.array([1.7, -2.5e3])
    from atc.units import _DIMENSIONS

    for dimension in _DIMENSIONS:
        np.testing.assert_allclose(u.to_user(dimension, u.to_internal(dimension, value)), value, rtol=5e-16)
        assert u.label(dimension)
        if name == "lj":
            assert u.to_internal(dimension, 1.0) == 1.0
    # length / time is the velocity unit, mass velocity² the unit in which mvv2e energies come out
    assert u.length / u.time == pytest.approx(u.velocity, rel=ROUNDING, abs=0)


def test_ase_constants_are_ase_s():
    import ase.units

    u = units("ase")
    assert u.boltzmann == pytest.approx(ase.units.kB, rel=ROUNDING, abs=0)
    assert u.coulomb == pytest.approx(
        ase.units.Hartree * ase.units.Bohr, rel=1e-12, abs=0
    )  # given to 17 digits in atc.units
    assert u.time == 1.0
    # ASE's fs in its own time unit, against the SI; its amu is CODATA 2014.
    assert units("real").time == pytest.approx(ase.units.fs, rel=1e-6)


def test_unknown_units_and_mixing_reduced_with_physical():
    with pytest.raises(AtcError, match=r"unknown units 'metall': expected one of lj, real, metal"):
        units("metall")
    with pytest.raises(AtcError, match="unknown units None"):
        units(None)
    require_compatible(units("metal"), units("real"), "a", "b")
    with pytest.raises(AtcError, match="cannot be mixed"):
        require_compatible(units("lj"), units("real"), "the trajectory", "the potential")
