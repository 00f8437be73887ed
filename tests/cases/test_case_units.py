"""Units of everything that a peridynamic run writes, wherever it goes: a force is in N, not in J/m."""

import re

import ase.io
import pytest

from atc.cases.case import Case
from atc.cases.run import LEDGER, QUANTITIES
from atc.export.export import export
from atc.units import units

# What a physicist expects.
UNITS = {
    "displacement": "m",
    "velocity": "m/s",
    "damage": "1",
    "energy": "J",
    "force": "N",
    "stress": "Pa",
    "temperature": "K",
    "volume": "m^3",
    "density": "kg/m^3",
    "time": "s",
    "material": "1",
    "n_broken": "1",
    "position_x": "m",
    "position_y": "m",
    "position_z": "m",
    **{f"energy_{k}": "J" for k in LEDGER},
}
FIELDS = {
    "density": "kg/m^3",
    "velocity": "m/s",
    "displacement": "m",
    "peridynamic_stress": "Pa",
    "peridynamic_piola_stress": "Pa",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of a few steps with every quantity, its folder and dataset."""
    folder = tmp_path_factory.mktemp("units")
    out = {}
    for suffix in ("nc", "zarr"):
        case = Case.load(
            {
                "body": {
                    "region": {"shape": "box", "lo": [0, 0, 0], "hi": [0.009, 0.004, 0]},
                    "spacing": 1e-3,
                    "horizon": 3.015e-3,
                    "density": 2440.0,
                    "dimension": 2,
                },
                "material": {"model": "pmb", "youngs": 72e9},
                "damage": {"s00": 1.0},
                "initial": {"velocity": ["100*x", 0, 0]},
                "run": {"steps": 2},
                "output": {
                    "quantities": list(QUANTITIES),
                    "vtk": str(folder / f"vtk-{suffix}"),
                    "extxyz": str(folder / f"{suffix}.xyz"),
                },
                "kernel": {"name": "quartic", "radius": 0.003},
                "grid": {"kind": "line", "start": [0.002, 0.002, 0], "end": [0.007, 0.002, 0], "n": 3},
                "fields": {"quantities": list(FIELDS)},
            }
        )
        out[suffix] = case.run(folder / f"out.{suffix}", threads=1)
    return folder, out


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_every_variable_says_its_unit(run, suffix):
    ds = run[1][suffix]
    assert set(QUANTITIES) <= set(ds.variables) and {f"energy_{k}" for k in LEDGER} <= set(ds.variables)
    for name, v in ds.variables.items():
        if name in ("frame", "step", "node", "i", "j"):
            assert "units" not in v.attrs  # numbers of things
        else:
            assert v.attrs["units"] == UNITS[name], name


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_fields_of_the_run_too(run, suffix):
    from atc.running.opening import open_dataset

    fields = open_dataset(run[0] / f"out-fields.{suffix}")
    for name, unit in FIELDS.items():
        assert fields[name].attrs["units"] == unit, name


def labels_of(path):
    """{array: unit} of a VTK file, by its XML."""
    head = path.read_bytes().split(b"<AppendedData")[0].decode()
    found = re.findall(
        r'<DataArray [^>]*Name="(\w+)"[^>]*?(?:/>|>\s*<InformationKey name="UNITS_LABEL" '
        r'location="vtkDataArray">([^<]*)</InformationKey></DataArray>)',
        head,
    )
    return dict(found)


def test_vtk_labels(run):
    folder, out = run
    series = labels_of(folder / "vtk-nc" / "vtk-nc_00001.vtu")
    exported = labels_of(export(folder / "out.nc", folder / "one.vtu"))
    for found in (series, exported):
        assert set(found) >= {*QUANTITIES, "volume", "material"}
        for name in (*QUANTITIES, "volume", "material"):
            assert found[name] == UNITS[name], name
    fields = labels_of(export(folder / "out-fields.nc", folder / "fields.vts"))
    for name in ("density", "velocity", "displacement", "peridynamic_stress"):
        assert fields[name] == FIELDS[name]


def test_meshio_reads_labelled_files(run):
    import meshio

    mesh = meshio.read(run[0] / "vtk-nc" / "vtk-nc_00001.vtu")
    assert set(mesh.point_data) == {*QUANTITIES, "volume", "material"}


def test_extxyz_says_its_units(run):
    frames = ase.io.read(run[0] / "nc.xyz", index=":")
    labels = dict(w.split("=") for w in frames[0].info["Units"].split())
    assert labels.pop("pos") == "m"
    # energy and stress are columns local_energy, local_stress: ASE keeps the names for itself
    for name in (*QUANTITIES, "volume", "material"):
        assert labels.pop(f"local_{name}" if name in ("energy", "stress") else name) == UNITS[name]
    assert not labels


def test_labels_are_consistent():
    """Force is energy a length; in SI and cgs it has a name of its own."""
    assert (
        units("si").label("force") == "N"
        and units("si").label("force_density") == "N/m^3"
        and units("si").label("energy_density") == "J/m^3"
    )
    assert units("cgs").label("force") == "dyne" and units("cgs").label("force_density") == "dyne/cm^3"
    assert units("metal").label("force") == "eV/angstrom" and units("metal").label("force_density") == "eV/angstrom^4"
