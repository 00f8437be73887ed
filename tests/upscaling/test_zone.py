"""Named points of the zone and paths through it, structure factors, and what phonopy reads."""

import json

import numpy as np
import pytest
from crystals import ARGON, DATA, constants, crystal
from scipy.spatial.transform import Rotation
from test_upscaling_vibrations import vibrating
from typer.testing import CliRunner

from atc.cli import app
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units
from atc.upscaling.crystal import Crystal
from atc.upscaling.phonopy_bridge import _tex, write_phonopy
from atc.upscaling.structure_factors import structure_factors, wave_vectors
from atc.upscaling.vibrations import measure
from atc.upscaling.zone import bravais, outside_zone, plain, special_points, zone_path

BODY = np.array([[-0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, -0.5]])
HEXAGON = np.array([[1.0, 0, 0], [-0.5, 0.75**0.5, 0], [0, 0, 1.63]])
CELLS = {
    "cP": np.eye(3),
    "cI": BODY,
    "cF": np.array([[0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]),
    "hP": HEXAGON,
    "tP": np.diag([1, 1, 1.3]),
    "tI1": BODY @ np.diag([1, 1, 0.7]),
    "tI2": BODY @ np.diag([1, 1, 1.6]),
}


@pytest.mark.parametrize("lattice", CELLS)
def test_lattice_and_points_whatever_the_cell(lattice):
    """Any primitive cell in any orientation: the same lattice, points with the same symmetry: each corner of the zone is
    as near to as many lattice points of the reciprocal lattice as in the first cell."""
    first = Crystal(4.1 * CELLS[lattice], [[0, 0, 0]], 1.0, "metal")
    turn = Rotation.random(random_state=3).as_matrix()
    mixed = np.array([[1, 1, 0], [0, 1, 0], [1, 0, 1]]) @ first.vectors @ turn.T
    second = Crystal(mixed, [[0, 0, 0]], 1.0, "metal")
    assert bravais(first)[0] == bravais(second)[0] == lattice
    a, b = special_points(first)[1], special_points(second)[1]
    assert list(a) == list(b) and len(a) >= 4

    def around(c, k):
        G = np.stack(np.meshgrid(*3 * [np.arange(-4, 5)], indexing="ij"), -1).reshape(-1, 3) @ c.reciprocal
        return np.sort(np.linalg.norm(G - k, axis=1))[:8]

    for name in a:
        np.testing.assert_allclose(around(first, a[name]), around(second, b[name]), atol=1e-9)
    path = zone_path(second)
    assert path[0].ends[0] == "Γ" and all(s.length > 0 for s in path)


def test_points_of_the_cubic_lattices():
    """2π/a times the coordinates of every textbook."""
    textbook = {
        "fcc": {"X": (1, 0, 0), "L": (0.5, 0.5, 0.5), "W": (1, 0.5, 0), "K": (0.75, 0.75, 0), "U": (1, 0.25, 0.25)},
        "bcc": {"H": (1, 0, 0), "N": (0.5, 0.5, 0), "P": (0.5, 0.5, 0.5)},
        "sc": {"X": (0.5, 0, 0), "M": (0.5, 0.5, 0), "R": (0.5, 0.5, 0.5)},
    }
    for structure, points in textbook.items():
        c = Crystal.cubic(structure, 3.0, 1.0, "metal")
        found = special_points(c)[1]
        for name, k in points.items():
            np.testing.assert_allclose(np.sort(np.abs(found[name] * 3.0 / (2 * np.pi))), np.sort(k), atol=1e-9)
        # All lie on the zone's surface, but for Γ: neither outside nor so that a longer one is inside.
        rest = np.array([k for name, k in found.items() if name != "Γ"])
        assert not outside_zone(c, rest).any() and outside_zone(c, 1.001 * rest).all()
    assert [s.label for s in zone_path(crystal("argon"))] == ["Γ–X", "X–W", "W–K", "K–Γ", "Γ–L"]
    # X and W, W and K are next to each other: the path's pieces are straight lines on the zone's faces.
    for s in zone_path(crystal("argon")):
        assert not outside_zone(crystal("argon"), np.linspace(*s.k_ec, 7)).any()


def test_paths_that_are_none():
    c = crystal("argon")
    assert [s.ends for s in zone_path(c, "G-X|GAMMA–L")] == [("Γ", "X"), ("Γ", "L")]
    with pytest.raises(AtcError, match="face-centred cubic lattice has no point 'M': expected names of Γ, X"):
        zone_path(c, "Γ-M")
    with pytest.raises(AtcError, match="'X' is no line"):
        zone_path(c, "Γ-L|X")
    with pytest.raises(AtcError, match="is none of simple cubic.*seekpath"):
        zone_path(Crystal(np.array([[3.0, 0, 0], [0.4, 4, 0], [0.3, 0.2, 5]]), [[0, 0, 0]], 1.0, "metal", name="odd"))


def test_measured_along_a_path():
    """Waves of a made run at every wave vector of the path that fits into its box, X and W with their degeneracies."""
    c = crystal("argon")
    frames = vibrating(c, (4, 4, 4), frames=160, dt=0.15, scale=0.004)
    r = measure(frames, c, zone_path(c), fc=lambda c: constants("argon"), blocks=4, lines="lorentzian")
    exact = constants("argon").frequencies(r.k_kc)
    np.testing.assert_allclose(r.ratio_km, exact, rtol=5e-3)
    ends = {(int(s), round(float(f), 6)) for s, f in zip(r.ray_k, r.fraction_k)}
    assert {(0, 0.5), (0, 1.0), (1, 0.0), (4, 1.0)} <= ends and (0, 0.0) not in ends
    # Undamped: no width, and said.
    assert all(np.isnan(x.gamma) for row in r.lines_km for x in row)
    assert any("longer than the run" in n for n in r.notes)
    got = np.array([[x.omega for x in row] for row in r.lines_km])
    np.testing.assert_allclose(got, exact, atol=0.5 * 2 * np.pi / (160 * r.dt))
    # The spectral energy density integrates to half of the modes' ⟨|v|²⟩ (made alike for all modes: a half of 3 a²·2).
    assert r.sed_kf.shape == (len(r.k_kc), len(r.frequency_f)) and (r.sed_kf >= 0).all()


def liquid(n=30, frames=24, dt=4.0):
    rng = np.random.default_rng(0)
    u = units("metal")
    edges = np.array([8.0, 9.0, 10.0])
    x = rng.uniform(0, 1, (n, 3)) * edges
    v = rng.normal(size=(n, 3)) * 2e-3  # Å/fs
    types = np.where(np.arange(n) < 20, 1, 2)
    out = []
    for k in range(frames):
        t = dt * k
        now = x + v * t + 0.2 * np.sin(0.02 * t + np.arange(n))[:, None]
        speed = v + 0.004 * np.cos(0.02 * t + np.arange(n))[:, None]
        out.append(Frame(now, Cell(edges), u, velocities=speed * float(u.to_internal("velocity", 1e3)), types=types,
                         masses=np.ones(n), type_names={1: "Al", 2: "Ni"}, time=float(u.to_internal("time", 1e-3 * t)),
                         step=k))  # fmt: skip
    return out


def test_structure_factors_by_their_definitions():
    """Sums over all pairs of frames and atoms, written out."""
    frames = liquid()
    q = wave_vectors(frames[0].cell, 1.3)
    assert (np.diff(np.linalg.norm(q, axis=1)) > -1e-12).all() and len(q) > 10
    ds = structure_factors(frames, q, lags=7)
    fs = float(frames[0].units.to_user("velocity", 1.0)) * 1e-3
    kinds = frames[0].types
    n = {a: np.array([np.exp(1j * q @ f.positions[kinds == a].T).sum(axis=1) for f in frames]) for a in (1, 2)}
    j = {a: np.array([np.exp(1j * q @ f.positions[kinds == a].T) @ f.velocities[kinds == a] * fs for f in frames])
         for a in (1, 2)}  # fmt: skip
    e = q / np.linalg.norm(q, axis=1)[:, None]
    for lag in (0, 1, 7):
        early, late = slice(0, len(frames) - lag), slice(lag, None)
        total = n[1] + n[2]
        np.testing.assert_allclose(
            ds["Fqt"][:, lag], (total[early] * total[late].conj()).real.mean(axis=0) / 30, atol=1e-12
        )
        both = n[1][early] * n[2][late].conj() + n[2][early] * n[1][late].conj()
        np.testing.assert_allclose(ds["Fqt_Al_Ni"][:, lag], both.real.mean(axis=0) / 30, atol=1e-12)
        flow = j[1] + j[2]
        along = np.einsum("tqc,qc->tq", flow, e)
        np.testing.assert_allclose(
            ds["Clqt"][:, lag], (along[early] * along[late].conj()).real.mean(axis=0) / 30, atol=1e-15
        )
        side = np.cross(e, np.cross(flow, e))
        np.testing.assert_allclose(
            ds["Ctqt"][:, lag], 0.5 * (side[early] * side[late].conj()).real.sum(-1).mean(axis=0) / 30, atol=1e-15
        )
    np.testing.assert_allclose(ds["Sq"], ds["Fqt"][:, 0], rtol=1e-12)
    np.testing.assert_allclose(ds["Sq_Al_Al"] + ds["Sq_Al_Ni"] + ds["Sq_Ni_Ni"], ds["Sq"], rtol=1e-12)
    t, w = ds["time"].values, ds["omega"].values
    np.testing.assert_allclose(t, 4.0 * np.arange(8), rtol=1e-12)
    cosines = np.cos(np.outer(t, w)) * np.where(t > 0, 2.0, 1.0)[:, None]
    np.testing.assert_allclose(ds["Sqw"], 4.0 * ds["Fqt"].values @ cosines, atol=1e-9)
    assert ds["Clqt"].attrs["units"] == "angstrom^2/fs^2" and ds["Clqw"].attrs["units"] == "angstrom^2/fs"


def test_structure_factors_that_cannot_be():
    frames = liquid(frames=6)
    q = wave_vectors(frames[0].cell, 1.0)
    with pytest.raises(AtcError, match="does not fit into the box: expected integer combinations"):
        structure_factors(frames, q + 0.01)
    with pytest.raises(AtcError, match="the box is not that of the first frame"):
        structure_factors([frames[0], frames[1].replace(cell=Cell([8.1, 9.0, 10.0]))], q)
    with pytest.raises(AtcError, match="no times"):
        structure_factors([f.replace(time=None, step=None) for f in frames], q)
    with pytest.raises(AtcError, match="lags = 6 of 6 frames"):
        structure_factors(frames, q, lags=6)
    assert "Sqw" not in structure_factors([f.replace(time=None, step=None) for f in frames], q, lags=0)
    few = wave_vectors(frames[0].cell, 6.0, most=100)
    assert len(few) == 100


def test_phonopy_reads_what_is_written(tmp_path):
    import phonopy
    import yaml

    fc = constants("silicon")
    segments = zone_path(fc.crystal)
    write_phonopy(fc, tmp_path / "files", segments)
    phonon = phonopy.load(
        tmp_path / "files" / "phonopy.yaml",
        force_constants_filename=tmp_path / "files" / "FORCE_CONSTANTS",
        produce_fc=False,
        log_level=0,
    )
    k = np.array([[0.31, -0.2, 0.4], [0.9, 0.3, 0.1]])
    there = phonon.run_qpoints(k @ fc.crystal.vectors.T / (2 * np.pi)).frequencies
    # Its unit of frequency is CODATA 2014's, 1.3e-7 from ours.
    np.testing.assert_allclose(there, fc.frequencies(k) * 15.633302, rtol=5e-7)
    with open(tmp_path / "files" / "band.yaml") as f:
        band = yaml.safe_load(f)
    assert [x for pair in band["labels"] for x in pair][:3] == ["$\\Gamma$", "X", "X"] and band["npath"] == 5
    assert band["points"][0]["symbol"] == "Si"
    x = [m["frequency"] for m in band["phonon"][50]["band"]]
    np.testing.assert_allclose(x, fc.frequencies(segments[0].k_ec[1])[0] * 15.633302, rtol=5e-7)


def test_names_as_plots_write_them():
    assert [_tex(x) for x in ("Γ", "X", "Z0", "Σ0", "[100]")] == ["$\\Gamma$", "X", "$Z_0$", "$\\Sigma_0$", "[100]"]
    assert [plain(x) for x in ("GAMMA", "SIGMA_0", "H_2", "X")] == ["Γ", "Σ0", "H2", "X"]


def test_a_scene_with_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = lambda *args: CliRunner().invoke(app, ["dispersion", *map(str, args)])  # noqa: E731
    done = run(
        DATA / "argon_crystal" / "scene.toml", "--json", "--picture", "p.png", "-o", "o.nc", "--phonopy", "files",
        *("--set", 'dispersion.path="Γ-X-W|Γ-L"'), *("--set", 'dispersion.linewidths="oscillator"'),
        *("--set", "dispersion.structure_factors=true"), *("--set", 'dispersion.models=["classical", "coarse2"]'),
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    out = json.loads(done.stdout)
    assert [r["ends"] for r in out["rays"]] == [["Γ", "X"], ["X", "W"], ["Γ", "L"]]
    assert out["phonopy_difference"] < 1e-6
    assert out["rays"][0]["lattice"][-1] == pytest.approx([1.36553, 1.36553, 1.99605], abs=1e-5)
    assert out["rays"][2]["lattice"][-1] == pytest.approx([0.908168, 0.908168, 1.993237], abs=1e-5)
    coarse = np.array(out["rays"][0]["coarse lattice, 2a"], float)
    assert np.isnan(coarse[:, 0]).sum() == 30 and all(
        x is None for row in out["rays"][1]["coarse lattice, 2a"] for x in row
    )
    import xarray as xr

    with xr.open_dataset("o.nc", engine="h5netcdf") as ds:
        assert {"spectral_energy_density", "line_gamma", "lifetime", "structure_Sqw", "structure_Ctqw"} <= set(ds)
        assert list(ds["ray"].values) == ["Γ–X", "X–W", "Γ–L"]
        # At 1 K, S(q) at small q is kT over the stiffness of longitudinal waves, far below 1.
        assert 0 < float(ds["structure_Sq"].min()) < 0.01
    assert (tmp_path / "p.png").stat().st_size > 30000 and (tmp_path / "files" / "band.yaml").exists()
    # Rounding at Γ is no imaginary frequency, and the beginning of a piece is not at -0.
    words = run(DATA / "argon_crystal" / "scene.toml", "--set", 'dispersion.path="W-K-Γ"',
                "--set", 'dispersion.models=["classical"]').output  # fmt: skip
    assert "0, 0, 0 THz" in words and "0i" not in words.split("measured")[0] and "–K -0" not in words
    done = run(DATA / "argon_crystal" / "scene.toml", "--set", 'dispersion.path="Γ-Q"')
    assert done.exit_code != 0
    with open("scene.toml", "w") as f:
        f.write(
            f'[potential]\nunits = "lj"\nlammps = """\n{ARGON}\n"""\n'
            '[dispersion]\nstructure = "fcc"\nlattice_constant = 1.5\nmasses = [1.0]\nlinewidths = "lorentzian"\n'
        )
    done = run("scene.toml")
    assert done.exit_code != 0
