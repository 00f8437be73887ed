"""`atc report` of a twin: what was made of what, its constants and norms, with the pictures in the page."""

import re

import numpy as np
import pytest
import xarray as xr
from test_page import Reader
from typer.testing import CliRunner

import atc
from atc.cli import app

NAMES = ("displacement", "stress", "energy")


@pytest.fixture(scope="module")
def ds(tmp_path_factory):
    """A cube of argon, strained in two frames; its twin is the isotropic solid."""
    from crystals import ARGON, crystal

    c, n = crystal("argon"), 4
    a = float(np.linalg.norm(c.conventional[0]))
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    X = ((cells + np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])) * a).reshape(-1, 3) + 0.1
    path = tmp_path_factory.mktemp("twin") / "run.dump"
    with open(path, "w") as f:
        for k, strain in enumerate((0.0, 1e-3, 2e-3)):
            f.write(f"ITEM: UNITS\nmetal\nITEM: TIME\n{k}\nITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n{len(X)}\n")
            f.write(f"ITEM: BOX BOUNDS pp pp pp\n0 {n * a * (1 + strain):.15g}\n" + 2 * f"0 {n * a:.15g}\n")
            f.write("ITEM: ATOMS id type x y z vx vy vz\n")
            x = X * [1 + strain, 1, 1]
            np.savetxt(
                f, np.column_stack([np.arange(1, len(X) + 1), np.ones(len(X)), x, 0 * x]), "%d %d" + 6 * " %.15g"
            )
    given = {
        "trajectory": {"file": str(path), "reference": 0, "frames": "1:", "masses": [39.948]},
        "potential": {"lammps": ARGON},
        "kernel": {"name": "quartic", "radius": 9.0},
        "grid": {"kind": "regular", "shape": [4, 4, 3]},
        "twin": {"structure": "fcc", "lattice_constant": 5.3, "motion": "static", "horizon": 12.0},
    }
    with pytest.warns(atc.AtcWarning, match="elastic constants miss"):
        return atc.twin(given).dataset


def test_the_page_of_a_twin(ds, tmp_path):
    out = tmp_path / "twin.nc"
    from atc.running.whole import write_dataset

    write_dataset(ds, out)
    done = CliRunner().invoke(app, ["report", str(out)])
    assert done.exit_code == 0, done.output
    page = Reader((tmp_path / "twin.html").read_text())
    words = " ".join(page.texts)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert len(page.images) == 4  # maps, profiles, the last frame, histories
    for said in ("nodes of 256 atoms", "isotropic (lps)", "the bulk modulus", "not exact", "the cell's history",
                 "stable step", "Hill averages", "elastic constants miss", "The scene"):  # fmt: skip
        assert said in words, said
    # The constants of the crystal, of the isotropic solid and of its nodes, as the dataset has them.
    at = {k: ds[f"elastic_{k}"].sel(voigt_1="xx", voigt_2="xx").item() for k in ("crystal", "material", "nodes")}
    assert at["crystal"] < at["nodes"] and len(set(at.values())) == 3
    for value in at.values():
        assert f"{value:.5g}" in words
    for name in NAMES:
        off = float(ds["norm_difference_rms"].sel(norm_field=name, norm_where="matter"))
        both = [ds[f"{s}_{name}"].mean("frame").values for s in ("md", "pd")]
        assert off == pytest.approx(np.sqrt(np.mean((both[1] - both[0]) ** 2)), rel=1e-9)
        assert f"{off:.4g}" in words
    with xr.open_dataset(out) as kept:
        assert "elastic constants miss" in kept.attrs["warnings"]


def test_in_other_units(ds, tmp_path):
    """Numbers and maps follow; what counts as matter does not change."""
    page = Reader(atc.report(ds, tmp_path / "a.html", units="GPa, kg/m^3", title="<b>").read_text())
    words = " ".join(page.texts)
    value = 1e-4 * ds["elastic_crystal"].sel(voigt_1="xx", voigt_2="xx").item()
    assert f"{value:.5g}" in words and "(GPa)" in words and len(page.images) == 4
    assert "<b>" in words and not re.search(r"https?://", words)


def test_grids_without_maps(ds, tmp_path):
    """Of single points there is no map: the histories stand alone."""
    one = ds.isel(z=0, y=0, x=slice(0, 2)) if {"x", "y", "z"} <= {*ds.dims} else ds
    lines = Reader(atc.report(one, tmp_path / "b.html").read_text())
    assert 1 <= len(lines.images) < 4
    alone = Reader(atc.report(ds.isel(frame=[0]), tmp_path / "c.html").read_text())
    assert "one frame" in " ".join(alone.texts) and len(alone.images) == 2
