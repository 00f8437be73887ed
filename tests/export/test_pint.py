"""Units as pint reads them: every label of every style, and outputs whose variables are pint's quantities."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.units import LAMMPS_STYLES, units
from atc.units.words import unit_of

pytestmark = pytest.mark.tools


def test_labels_are_pints():
    import pint

    registry = pint.UnitRegistry()
    base = ("m", "kg", "s", "K", "C")
    for style in (*LAMMPS_STYLES, "ase", "mdanalysis"):
        u = units(style)
        for text in set() if u.reduced else {*u.labels.values(), *u.planar.labels.values()}:
            mine, theirs = unit_of(text), registry.Quantity(1.0, text.replace("t_ase", "(angstrom*(amu/eV)**0.5)"))
            si = registry.Quantity(1.0, "*".join(f"{b}**{p}" for b, p in zip(base, mine.powers)))
            moles = theirs.dimensionality.get("[substance]", 0)  # here a mole is a number
            theirs = theirs * (registry.Quantity(1.0, "mol") / 6.02214076e23) ** -moles
            if "statC" in text:  # another dimension in pint
                assert theirs.units
                continue
            # pint's constants are CODATA's of another year
            assert theirs.to(si.units).magnitude == pytest.approx(mine.size, rel=1e-8), (style, text)


@pytest.mark.parametrize("style", ["metal", "lj"])
def test_quantified_outputs(style):
    f = argon(temperature=30.0) if style == "metal" else argon(style="lj")
    ds = atc.fields([f], None, atc.kernel("quartic", 5.0), atc.Grid.regular(shape=3), ["density", "velocity"])
    q = ds.atc.quantify()
    if style == "metal":
        rho = q.density.pint.to("kg/m^3").pint.dequantify()
        np.testing.assert_allclose(rho.values, ds.density.values * 1e3, rtol=1e-12)
        speed = q.velocity.pint.to("m/s").pint.dequantify()
        np.testing.assert_allclose(speed.values, ds.velocity.values * 100, rtol=1e-12)
    else:
        assert str(q.density.pint.units) == str(q.velocity.pint.units) == "dimensionless"
        np.testing.assert_array_equal(q.density.pint.magnitude, ds.density.values)
