"""ASE's users: the stress in ASE's sign, order and units is ASE's own; a calculator is refused with what to do."""

import numpy as np
import pytest
from ase.build import bulk
from ase.calculators.lj import LennardJones

import atc
from atc.errors import AtcError


@pytest.fixture(scope="module")
def atoms():
    atoms = bulk("Ar", "fcc", 5.0, cubic=True) * (3, 3, 3)
    atoms.set_cell(atoms.cell @ [[1, 0, 0], [0.03, 1, 0], [0, 0.02, 0.98]], scale_atoms=True)
    atoms.rattle(0.1, seed=2)
    atoms.calc = LennardJones(sigma=3.4, epsilon=0.0104, rc=6.5, smooth=False)
    atoms.get_forces()  # which are compared, once they are there
    return atoms


def test_stress_is_ases(atoms):
    pot = atc.potential("pair_style lj/cut 6.5\npair_coeff * * 0.0104 3.4", units="metal")
    ds = atc.fields(atoms, pot, quantities=["virial_stress_potential"], forces="must agree")
    found = ds.atc.voigt("virial_stress_potential")
    assert found.dims == ("frame", "voigt") and found.attrs["units"] == "eV/angstrom^3"
    assert found.voigt.values.tolist() == ["xx", "yy", "zz", "yz", "xz", "xy"]
    want = atoms.get_stress()
    np.testing.assert_allclose(found[0], want, rtol=1e-10, atol=1e-12 * np.abs(want).max())
    assert want[:3].max() < 0 and found[0, 0] < 0  # compressed


def test_a_calculator_is_no_potential(atoms):
    with pytest.raises(AtcError, match=r"LennardJones: a calculator of ASE gives the force on each atom.*atc.mace"):
        atc.potential(atoms.calc)
