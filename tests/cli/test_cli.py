"""The command line, from end to end: every command, every kind of bad input (status 2 and one line), kill and
continue."""

import json
import os
import signal
import subprocess
import sys
import time

import held
import numpy as np
import pytest
from typer.testing import CliRunner

from atc.cli import app

SCENE = """\
[trajectory]
file = "run.dump"
units = "metal"
masses = { 1 = 39.948 }

[potential]
lammps = \"\"\"
pair_style lj/cut 7.0
pair_coeff 1 1 0.0104 3.4
\"\"\"

[kernel]
name = "quartic"
radius = 5.0

[grid]
kind = "regular"
shape = [4, 5, 6]

[fields]
quantities = ["stress", "virial_stress", "smoothed_virial_stress", "density", "velocity", "temperature"]

[output]
file = "out.nc"
"""


def write_dump(path, frames=3, cells=3, velocities=True, seed=1):
    """Argon, fcc and rattled: `frames` snapshots as LAMMPS writes them, every digit kept."""
    rng = np.random.default_rng(seed)
    a = 5.4
    base = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    shifts = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x0 = ((base + shifts) * a).reshape(-1, 3)
    with open(path, "w") as f:
        for k in range(frames):
            x = (x0 + rng.normal(0, 0.15, x0.shape)) % (cells * a)
            v = rng.normal(0, 1.3, x0.shape)
            f.write(
                f"ITEM: TIMESTEP\n{100 * k}\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS pp pp pp\n"
                + f"0 {cells * a}\n" * 3
            )
            f.write("ITEM: ATOMS id type x y z" + (" vx vy vz" if velocities else "") + "\n")
            for n, (p, w) in enumerate(zip(x, v), 1):
                f.write(f"{n} 1 " + " ".join(repr(float(c)) for c in (*p, *(w if velocities else ()))) + "\n")


@pytest.fixture
def case(tmp_path, monkeypatch):
    """A directory with a small trajectory and its scene, made the current one."""
    write_dump(tmp_path / "run.dump")
    (tmp_path / "scene.toml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*args):
    return CliRunner().invoke(app, [str(a) for a in args], prog_name="atc")


def ok(*args):
    result = run(*args)
    assert result.exit_code == 0, result.output
    return result


def refused(*args, status=2) -> str:
    """The one line on stderr of a command that refuses."""
    result = run(*args)
    assert result.exit_code == status, (result.exit_code, result.output)
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert result.stdout == ""
    assert lines[0].startswith("error: ")
    assert "Traceback" not in result.output
    return lines[0]


# ---- starting up

HEAVY = ("numba", "xarray", "scipy", "matplotlib", "pandas", "MDAnalysis", "ase", "zarr", "h5netcdf", "rich", "numpy")


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["fields", "--help"], ["plot", "--help"]])
def test_help_imports_nothing_heavy(args):
    """Modules are counted, not seconds: `atc --help` must be instant on any machine."""
    code = (
        "import sys\nfrom atc.cli import main\ntry:\n    main()\nexcept SystemExit as e:\n    print(repr(e.code), "
        "*sorted({m.partition('.')[0] for m in sys.modules}))"
    )
    out = subprocess.run([sys.executable, "-c", code, *args], capture_output=True, text=True, check=True).stdout
    status, *modules = out.splitlines()[-1].split()
    assert status in ("0", "None")
    assert "typer" in modules
    assert not set(HEAVY) & set(modules)


def test_import_is_light():
    code = "import atc, sys; print(*{m.partition('.')[0] for m in sys.modules})"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not set(HEAVY) & set(modules)


def test_help_names_every_command():
    text = ok("--help").output
    for command in ("info", "plan", "fields", "compare", "plot"):
        assert f"\n  {command} " in text


# ---- the main path


def test_from_scene_to_picture(case):
    text = ok("info", "run.dump", "--units", "metal", "--masses", "39.948").output
    for word in ("metal", "108", "16.2 x 16.2 x 16.2 angstrom", "periodic in x, y, z", "step 0 to 200", "velocities"):
        assert word in text, text
    text = ok("plan", "scene.toml").output
    assert "3 frames of 108 atoms" in text
    text = ok("fields", "scene.toml").output
    assert "out.nc" in text
    import xarray as xr

    with xr.open_dataset("out.nc", engine="h5netcdf") as ds:
        assert ds.sizes["frame"] == 3
        assert ds["stress"].shape == (3, 4, 5, 6, 3, 3)
        assert np.isfinite(ds["stress"].values).all()
        assert ds["stress"].attrs["units"] == "bar"
        assert 'name = "quartic"' in ds.attrs["scene"]
        assert str(case) not in json.dumps(ds.attrs, default=str)
    text = ok("compare", "out.nc").output
    assert "Hardy" in text and "virial" in text
    assert (case / "out-compare.png").read_bytes()[:4] == b"\x89PNG"
    text = ok("plot", "out.nc", "-q", "stress", "-c", "vonmises", "--frame", "mean", "-o", "p.png").output
    assert text.strip() == "p.png"
    assert (case / "p.png").read_bytes()[:4] == b"\x89PNG"
    ok("plot", "out.nc", "--overlay", "scene.toml", "-c", "xx", "-o", "q.png")
    assert (case / "q.png").read_bytes() != (case / "p.png").read_bytes()
    line = refused("plot", "out.nc", "--overlay", "gone.toml")
    assert "gone.toml" in line


def test_flags_override_the_scene(case):
    import xarray as xr

    ok(
        "fields",
        "scene.toml",
        "-o",
        "a.nc",
        "--set",
        "grid.shape=[2,2,2]",
        "--set",
        "fields.quantities=density",
        "-b",
        "1",
        "--step",
        "1",
        "-q",
    )
    with xr.open_dataset("a.nc", engine="h5netcdf") as ds:
        assert ds.density.shape == (2, 2, 2, 2)
        assert "stress" not in ds
        # 108 atoms of 39.948 in (16.2 Å)³; the 2 × 2 × 2 points see a quartic kernel that they do not resolve, hence 10
        # %
        assert float(ds.density.mean()) == pytest.approx(108 * 39.948 / 16.2**3 / 0.602214, rel=0.1)


def test_quiet_says_nothing(case):
    result = ok("fields", "scene.toml", "-o", "a.zarr", "-q", "--set", "fields.quantities=density")
    assert result.output == ""


def test_info_json(case):
    data = json.loads(ok("info", "run.dump", "--units", "metal", "--json").output)
    assert data["frames"] == 3
    assert data["types"]["1"]["count"] == 108
    assert any("no masses" in n for n in data["notes"])


def test_info_says_what_is_missing_and_how_coarse_it_is(case):
    write_dump(case / "still.dump", velocities=False)
    text = ok("info", "still.dump", "--units", "metal").output
    assert "no velocities" in text and "temperature" in text
    rounded = [
        " ".join([*w[:2], *(f"{float(c):.2f}" for c in w[2:])]) if len(w := line.split()) == 5 else line
        for line in (case / "still.dump").read_text().splitlines()
    ]
    (case / "coarse.dump").write_text("\n".join(rounded) + "\n")
    text = ok("info", "coarse.dump", "--units", "metal").output
    assert "2 decimals" in text
    assert "about 2 %" in text  # the measured 1.5 to 2 % at 0.01 Å


def test_compare_as_json_and_csv(case):
    ok("fields", "scene.toml", "-q")
    data = json.loads(ok("compare", "out.nc", "--json").output)
    assert data["units"] == "bar"
    assert {r["name"] for r in data["rows"]} >= {"xx", "yz", "hydrostatic", "vonmises"}
    lines = ok("compare", "out.nc", "--csv").output.splitlines()
    assert lines[0].startswith("section,name,")
    assert len(lines) == len(data["rows"]) + 1


def test_compare_radii(case):
    text = ok("compare", "scene.toml", "--radii", "4,7", "-e", "1").output
    assert "kernel radius" in text
    assert (case / "scene-compare.png").exists()


# ---- bad input: one line, status 2


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("radius = 5.0", "raduis = 5.0", ["scene.toml:14", "raduis", "did you mean 'radius'"]),
        ("radius = 5.0", "radius = -5.0", ["scene.toml:14", "greater than 0"]),
        ('"run.dump"', '"gone.dump"', ["scene.toml:2", "gone.dump"]),
        ('units = "metal"', 'units = "metall"', ["scene.toml:3", "did you mean 'metal'"]),
        ('units = "metal"\n', "", ["run.dump", "units"]),
        ("masses = { 1 = 39.948 }", "masses = { 2 = 39.948 }", ["run.dump", "mass", "type 1"]),
        ("masses = { 1 = 39.948 }\n", "", ["run.dump", "masses"]),
        ("lj/cut 7.0", "lj/cutt 7.0", ["scene.toml", "lj/cutt"]),
        ("pair_coeff 1 1 0.0104 3.4", "pair_coeff 2 2 0.0104 3.4", ["scene.toml", "pair_coeff"]),
        ("shape = [4, 5, 6]", "shape = [4, 5]", ["scene.toml:18", "shape"]),
        ("shape = [4, 5, 6]", "shape = [4, 0, 6]", ["scene.toml:18", "shape"]),
        ('"density"', '"densty"', ["scene.toml:21", "did you mean 'density'"]),
        ("[kernel]", "[kernel", ["scene.toml:12", "TOML"]),
        ('units = "metal"', 'units = "metal"\nframes = "5:9"', ["scene.toml:4", "frames", "3 complete frames"]),
        ('"out.nc"', '"out.vtk"', ["scene.toml:24", ".zarr", ".nc"]),
        ('"out.nc"', '"nowhere/out.nc"', ["nowhere"]),
        ("[output]", "method = \"magic\"\n[output]", ["scene.toml:23", "magic"]),
    ],
)  # fmt: skip
def test_bad_scenes(case, old, new, words):
    assert SCENE.count(old) == 1
    (case / "scene.toml").write_text(SCENE.replace(old, new))
    before = sorted(p.name for p in case.iterdir())
    line = refused("fields", "scene.toml")
    for word in words:
        assert word in line
    assert sorted(p.name for p in case.iterdir()) == before  # nothing half-written


def test_missing_velocities(case):
    write_dump(case / "run.dump", velocities=False)
    line = refused("fields", "scene.toml")
    assert "run.dump" in line and "velocities" in line
    assert not (case / "out.nc").exists()
    ok("fields", "scene.toml", "-q", "--set", "fields.quantities=stress_potential")


@pytest.mark.parametrize(
    "args, words",
    [
        (["fields"], ["SCENE"]),
        (["fields", "gone.toml"], ["gone.toml", "no such"]),
        (["fields", "run.dump"], ["run.dump:1", "TOML"]),
        (["fields", "scene.toml", "--set", "kernel.radius=zero"], ["--set kernel.radius=zero"]),
        (["fields", "scene.toml", "-b", "many"], ["-b", "integer"]),
        (["fields", "scene.toml", "-b", "7"], ["-b 7", "3 complete frames"]),
        (["fields", "scene.toml", "--step", "0"], ["--step 0", "at least 1"]),
        (["fields", "scene.toml", "-j", "-2"], ["-j"]),
        (["fields", "scene.toml", "-o", "x.txt"], ["x.txt", ".zarr", ".nc"]),
        (["fields", "scene.toml", "--radius", "4"], ["--radius"]),
        (["frobnicate"], ["frobnicate"]),
        (["info", "gone.dump"], ["gone.dump"]),
        (["info", "run.dump"], ["run.dump", "units"]),
        (["info", "run.dump", "--units", "metall"], ["metall"]),
        (["info", "run.dump", "--units", "metal", "--masses", "heavy"], ["--masses heavy"]),
        (["plan", "gone.toml"], ["gone.toml"]),
        (["compare", "gone.nc"], ["gone.nc"]),
        (["compare", "scene.toml"], ["--radii"]),
        (["compare", "scene.toml", "--radii", "0"], ["--radii 0"]),
        (["plot", "gone.zarr"], ["gone.zarr"]),
        (["plot", "scene.toml"], ["scene.toml", ".zarr", ".nc"]),
    ],
)
def test_bad_commands(case, args, words):
    line = refused(*args)
    for word in words:
        assert word in line


@pytest.mark.parametrize(
    "args, words",
    [
        (["-q", "strss"], ["strss", "did you mean 'stress'"]),
        (["-q", "virial_stress"], ["virial_stress", "box"]),
        (["-c", "xz2"], ["xz2"]),
        (["-q", "density", "-c", "xx"], ["density", "scalar"]),
        (["--frame", "5"], ["frame 5", "3 frames"]),
        (["--frame", "last"], ["last"]),
        (["--slice", "w=0.5"], ["'w'"]),
        (["--slice", "z=1.5"], ["fraction"]),
        (["--slice", "z"], ["z=0.5"]),
        (["--axis", "z", "--index", "6"], ["index 6", "6 points"]),
        (["--limits", "3,1"], ["--limits"]),
        (["-o", "p.bmp"], [".png"]),
        (["-o", "gone/p.png"], ["gone"]),
    ],
)
def test_bad_pictures(case, args, words):
    import xarray as xr

    axis = {n: (n, np.arange(k) + 0.5) for n, k in zip("xyz", (4, 5, 6))}
    made = fake_output(axis)
    assert isinstance(made, xr.Dataset)
    made.to_netcdf("out.nc", engine="h5netcdf")
    line = refused("plot", "out.nc", *args)
    for word in words:
        assert word in line
    assert sorted(p.name for p in case.iterdir()) == ["out.nc", "run.dump", "scene.toml"]


def test_a_damaged_output(case):
    (case / "broken.nc").write_bytes(b"this is not HDF5" * 100)
    assert "broken.nc" in refused("plot", "broken.nc")
    (case / "empty.zarr").mkdir()
    assert "empty.zarr" in refused("compare", "empty.zarr")


def test_unwritable_output_is_noticed_before_computing(case):
    (case / "plain").write_text("a file, not a directory")
    line = refused("fields", "scene.toml", "-o", "plain/out.nc", "--set", "trajectory.file=gone.dump")
    assert "plain" in line and "gone.dump" not in line


def test_existing_output_is_kept(case):
    ok("fields", "scene.toml", "-q", "--set", "fields.quantities=density")
    before = (case / "out.nc").read_bytes()
    line = refused("fields", "scene.toml")
    assert "out.nc" in line and "--overwrite" in line
    assert (case / "out.nc").read_bytes() == before
    ok("fields", "scene.toml", "-q", "--overwrite", "--set", "fields.quantities=number_density")
    assert (case / "out.nc").read_bytes() != before


def test_warnings_are_one_line(case):
    """The last, incomplete frame of a running simulation is left out with a warning."""
    text = (case / "run.dump").read_text()
    (case / "run.dump").write_text(text[: len(text) - 2000])
    result = ok("fields", "scene.toml", "-q", "--set", "fields.quantities=density")
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("warning: ") and "run.dump" in lines[0]


def test_unforeseen_errors_are_one_line_and_admit_it(case, monkeypatch):
    from atc.config import scene

    def broken(*a, **k):
        raise RuntimeError("the moon\nis made of cheese")

    monkeypatch.setattr(scene.Scene, "load", broken)
    line = refused("fields", "scene.toml", status=1)
    assert "RuntimeError" in line and "the moon is made of cheese" in line and "ATC_DEBUG=1" in line
    monkeypatch.setenv("ATC_DEBUG", "1")
    result = run("fields", "scene.toml")
    assert isinstance(result.exception, RuntimeError)


# ---- interrupting


def atc(*args, hold=None, **kw):
    """A process of a command, that waits for a signal after `hold` entries of its output."""
    env = dict(os.environ, PYTHONUNBUFFERED="1", PYTHONPATH=os.pathsep.join(filter(None, sys.path)))
    program = ["-m", "atc"] if hold is None else [held.__file__, hold]
    return subprocess.Popen(
        [sys.executable, *map(str, (*program, *args))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=env,
        **kw,
    )


def finished_frames(out) -> int:
    journal = out.with_name(out.name + ".partial") / "journal.jsonl"
    return len(journal.read_text().splitlines()) if journal.exists() else 0


def interrupt_midway(case, out, sig):
    """Start `atc fields`, and send it `sig` when some frames, not all, are complete."""
    process = atc("fields", "scene.toml", "-o", out.name, cwd=case, hold=3)
    deadline = time.monotonic() + 120
    while finished_frames(out) < 3:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(sig)
    stdout, stderr = process.communicate(timeout=60)
    assert not out.exists()
    assert finished_frames(out) == 3
    return process.returncode, stderr


def tree(path):
    if path.is_file():
        return path.read_bytes()
    return {str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("sig", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_continues_and_gives_the_same_file(case, sig):
    write_dump(case / "run.dump", frames=40)
    (case / "scene.toml").write_text(SCENE.replace("[4, 5, 6]", "[12, 12, 12]"))
    ok("fields", "scene.toml", "-o", "whole.zarr", "-q")
    out = case / "killed.zarr"
    status, stderr = interrupt_midway(case, out, sig)
    if sig == signal.SIGINT:
        assert status == 130
        assert len(stderr.splitlines()) == 1 and "same command continues" in stderr
    done = finished_frames(out)
    result = ok("fields", "scene.toml", "-o", "killed.zarr")
    assert f"{done} of 40 frames were there" in result.output.replace("entries", "frames")
    assert tree(out) == tree(case / "whole.zarr")
    assert not out.with_name("killed.zarr.partial").exists()


def test_nothing_on_stderr_when_piped(case):
    process = atc("fields", "scene.toml", cwd=case)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 0
    assert stderr == ""
    assert "\r" not in stdout and "\x1b" not in stdout
    assert "out.nc" in stdout


def test_a_closed_pipe_is_no_error(case):
    ok("fields", "scene.toml", "-q")
    command = f"{sys.executable} -m atc compare out.nc | head -n 1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=case, capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr == ""


def fake_output(coords):
    """A dataset in the shape of an output, without running anything."""
    import xarray as xr

    shape = [len(v[1]) for v in coords.values()]
    rng = np.random.default_rng(0)
    stress = rng.normal(size=(3, *shape, 3, 3))
    stress += np.swapaxes(stress, -1, -2)
    dims = ("frame", *coords)
    ij = {"i": list("xyz"), "j": list("xyz"), "frame": np.arange(3)}
    return xr.Dataset(
        {
            "stress": ((*dims, "i", "j"), stress, {"units": "bar"}),
            "density": (dims, rng.random((3, *shape)), {"units": "g/cm^3"}),
            "virial_stress": (("frame", "i", "j"), stress.mean((1, 2, 3)), {"units": "bar"}),
        },
        coords={**{k: (v[0], v[1], {"units": "angstrom"}) for k, v in coords.items()}, **ij},
    )
