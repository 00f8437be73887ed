"""A potential beside ASE's calculators and the forces of a file."""

import numpy as np
import pytest
from ase.build import bulk
from ase.calculators.emt import EMT
from ase.calculators.lj import LennardJones
from ase.calculators.morse import MorsePotential

import atc
from atc.errors import AtcError


def hot(symbol="Ar", a=5.3, n=3, seed=0, tilt=0.0):
    atoms = bulk(symbol, "fcc", a, cubic=True) * (n, n, n)
    cell = atoms.cell.array.copy()
    cell[1, 0] += tilt
    atoms.set_cell(cell, scale_atoms=True)
    atoms.rattle(0.2, seed=seed)
    return atoms


LJ = "pair_style lj/cut 8.5\npair_modify shift yes\npair_coeff * * 0.0104 3.405"


@pytest.mark.parametrize("tilt", [0.0, 4.0])
def test_lennard_jones_of_ase(tilt):
    frames = [hot(seed=k, tilt=tilt) for k in range(3)]
    found = atc.verify(frames, atc.potential(LJ, units="metal"), LennardJones(sigma=3.405, epsilon=0.0104, rc=8.5))
    assert found.force_error < 1e-12 and found.stress_error < 1e-12 and found.energy_error < 1e-10
    for f in found.frames:
        assert f.energy == pytest.approx(f.energy_other, rel=1e-12) and f.force_max > 0
    assert "LennardJones" in str(found) and "eV" in str(found)


def test_a_wrong_coefficient_shows():
    wrong = atc.potential(LJ.replace("3.405", "3.409"), units="metal")
    found = atc.verify(hot(), wrong, LennardJones(sigma=3.405, epsilon=0.0104, rc=8.5))
    assert 1e-3 < found.force_error < 0.2 and found.stress_error > 1e-3 and np.isnan(found.energy_error)
    assert found.frames[0].worst_atom in range(1, 109)


def test_lammps_units_and_symbols(tmp_path):
    """A frame in LAMMPS's real units: the comparison is in kcal/mol, and the species must be told."""
    from atc.frame import Frame
    from atc.units import units

    a = hot()
    frame = Frame(a.positions, atc.Cell(a.cell.array), units("real"), masses=a.get_masses(), source="run.dump frame 0")
    kcal = units("real").to_user("energy", 0.0104)
    pot = atc.potential(LJ.replace("0.0104", f"{kcal:.17g}"), units="real")
    calc = LennardJones(sigma=3.405, epsilon=0.0104, rc=8.5)
    with pytest.raises(AtcError, match="symbol of type 1"):
        atc.verify(frame, pot, calc)
    found = atc.verify(frame, pot, calc, symbols={1: "Ar"})
    assert found.force_error < 1e-12 and found.units["energy"] == "kcal/mol"
    assert found.frames[0].energy == pytest.approx(
        units("real").to_user("energy", found.frames[0].energy_other * units("real").factor("energy")), rel=1e-12
    )


def test_the_files_own_forces():
    a = hot()
    a.calc = LennardJones(sigma=3.405, epsilon=0.0104, rc=8.5)
    a.get_forces()
    pot = atc.potential(LJ, units="metal")
    found = atc.verify(a, pot)
    assert found.force_error < 1e-12 and found.frames[0].energy_other is None and "own forces" in found.against
    a.calc = None
    with pytest.raises(AtcError, match="forces are missing"):
        atc.verify(a, pot)


def test_morse():
    """Another style, in a box smaller than twice the cutoff: ASE takes all images, as we do."""
    a = hot("Cu", 3.61, 2)
    # Its cutoffs are in units of r0, and its smoothing between them must be narrow for LAMMPS's sharp cutoff.
    calc = MorsePotential(epsilon=0.35, r0=2.87, rho0=3.9, rcut1=7.0 / 2.87, rcut2=(7.0 + 1e-9) / 2.87)
    pot = atc.potential(f"pair_style morse 7.0\npair_coeff * * 0.35 {3.9 / 2.87:.17g} 2.87", units="metal")
    assert atc.verify(a, pot, calc).force_error < 1e-11


def test_a_calculator_that_fails_is_named():
    with pytest.raises(AtcError, match="EMT failed"):
        atc.verify(hot(), atc.potential(LJ, units="metal"), EMT())
