"""Units as words, against known conversions and the unit styles themselves."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.units import LAMMPS_STYLES, units
from atc.units.words import PRESETS, NotAUnit, converted, in_units, unit_of, wanted_units


@pytest.mark.parametrize(
    ("text", "other", "factor"),
    [
        ("bar", "GPa", 1e-4),
        ("eV/angstrom^3", "GPa", 160.2176634),
        ("atm", "bar", 1.01325),
        ("kcal/mol", "eV", 4184 / 6.02214076e23 / 1.602176634e-19),
        ("eV/(angstrom^2*ps)", "GW/m^2", 1.602176634e-19 / (1e-20 * 1e-12) / 1e9),
        ("angstrom/ps", "m/s", 100.0),
        ("g/cm^3", "kg/m^3", 1000.0),
        ("eV/(ps*angstrom*K)", "W/m/K", 1602.176634),
        ("g/mol*(angstrom/ps)/angstrom^3", "kg/(m^2*s)", 1e-3 / 6.02214076e23 * 100 / 1e-30),
        ("dyne/cm^2", "Pa", 0.1),
        ("kJ/(mol*angstrom^3)", "MPa", 1000 / 6.02214076e23 / 1e-30 / 1e6),
        ("N/m^3", "eV/angstrom^4", 1e-40 / 1.602176634e-19),
        ("fs", "ps", 1e-3),
    ],
)
def test_conversions(text, other, factor):
    got, label = converted(text, wanted_units(other))
    assert got == pytest.approx(factor, rel=1e-12) and label == other


def test_every_unit_of_every_style_is_understood():
    """And is what the style makes of it: sizes from the labels against the style's own factors, both in SI."""
    eV, amu = 1.602176634e-19, 1.66053906660e-27
    internal = {"length": 1e-10, "energy": eV, "mass": amu, "time": 1e-10 * (amu / eV) ** 0.5}
    for style in (*LAMMPS_STYLES, "ase", "mdanalysis"):
        u = units(style)
        if u.reduced:
            continue
        for dimension, text in {**u.labels, **{k + " planar": v for k, v in u.planar.labels.items()}}.items():
            got = unit_of(text)
            kind = dimension.removesuffix(" planar")
            if kind in internal and "planar" not in dimension:
                # LAMMPS's own constants differ from CODATA's in the seventh digit
                assert got.size == pytest.approx(u.factor(kind) * internal[kind], rel=3e-6), (style, dimension)
        assert unit_of(u.label("pressure")).powers == (-1, 1, -2, 0, 0)
        assert unit_of(u.label("conductivity")).powers == (1, 1, -3, -1, 0)
    with pytest.raises(NotAUnit):
        unit_of("epsilon/sigma^3")


def test_powers_of_what_is_wanted():
    nm = wanted_units("nm")
    assert converted("1/angstrom^3", nm) == (pytest.approx(1e3), "1/nm^3")
    assert converted("angstrom", nm) == (pytest.approx(0.1), "nm")
    assert converted("K", nm) == (1.0, "K") and converted("(c_pe)", nm) == (1.0, "(c_pe)")
    assert converted("1/ps", wanted_units("fs")) == (pytest.approx(1e-3), "1/fs")
    for text in PRESETS.values():
        wanted_units(text)


@pytest.mark.parametrize("text", ["GPA", "", "m//s", "W/", "(m", "m)", "^2", "eV/sigma", "1", "GPa, MPa", "5"])
def test_what_is_no_unit_is_said(text):
    with pytest.raises(AtcError, match="unit"):
        wanted_units(text)


def test_outputs_in_published_units(tmp_path):
    frames = [argon(seed=k, temperature=90.0).replace(step=k, time=float(k)) for k in range(3)]
    for f in frames:
        f.masses, f.types = np.full(len(f), 39.948), np.ones(len(f), int)
    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    args = (frames, pot, atc.kernel("quartic", 5.0), atc.Grid.regular(shape=3))
    names = ["stress", "heat_flux", "density", "number_density", "velocity"]
    plain = atc.fields(*args, names, average=True)
    ds = atc.fields(*args, names, average=True, output_units="nm-gpa", out=tmp_path / "a.nc")
    u = plain.stress.units, ds.stress.units
    assert u == ("bar", "GPa") and ds.x.units == "nm" and ds.heat_flux.units == "GW/m^2"
    for name, factor in (("stress", 1e-4), ("x", 0.1), ("number_density", 1e3), ("density", 1.0), ("cell", 0.1),
                         ("heat_flux", 16021.76634), ("velocity", 100.0), ("stress_stderr", 1e-4)):  # fmt: skip
        np.testing.assert_allclose(ds[name], plain[name] * factor, rtol=1e-13)
        np.testing.assert_allclose(in_units(plain, "nm-gpa")[name], ds[name], rtol=1e-13)
        assert in_units(plain, "nm-gpa")[name].attrs["units"] == ds[name].attrs["units"]
    assert ds.attrs["output_units"].startswith("GPa, nm") and ds.attrs["units"] == "metal"
    assert Scene.loads(ds.attrs["scene"]).get("output", "units") == "nm-gpa"
    with pytest.raises(AtcError, match="nothing in this output has the dimension"):
        atc.fields(*args, ["density"], output_units="V")
    lj = [f.replace(units=units("lj")) for f in frames]
    with pytest.raises(AtcError, match="nothing in this output has the dimension"):
        atc.fields(lj, None, args[2], args[3], ["density"], output_units="si")
