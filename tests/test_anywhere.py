"""Runs anywhere: without a home, without rights to write the installed package, without a place for temporary files;
code that was kept is never the wrong one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: Permissions bind root, too, once these are gone.
POWERLESS = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.name == "posix" and os.geteuid() == 0 else []

COMMANDS = """
set -e
"$PYTHON" -m atc --help > help.txt
"$PYTHON" -m atc info plate/silicon_plate.dump.gz > info.txt
"$PYTHON" -m atc plan plate/scene.toml > plan.txt
"$PYTHON" -m atc fields plate/scene.toml --set "grid.shape=[24,24,4]" -b 0 -e 2 -o small.nc -q $JOBS
"""
MORE = """
"$PYTHON" -m atc plot small.nc -q stress -c vonmises -o small.png
"$PYTHON" -m atc pd case.toml -o pd.zarr -q
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder to work in, and the package in a folder that cannot be written."""
    from test_case import PLATE

    top = tmp_path_factory.mktemp("anywhere")
    site, work = top / "site", top / "work"
    shutil.copytree(ROOT / "atc", site / "atc", ignore=shutil.ignore_patterns("__pycache__"))
    for folder, _, _ in os.walk(site):
        os.chmod(folder, 0o555)
    work.mkdir()
    shutil.copytree(ROOT / "data" / "silicon_plate", work / "plate")
    (work / "case.toml").write_text(PLATE.replace("steps = 120", "steps = 20").replace("every = 25", "every = 10"))
    yield site, work
    for folder, _, _ in os.walk(site):
        os.chmod(folder, 0o755)


def environment(site, **more):
    return {
        "PATH": os.environ.get("PATH", os.defpath),
        "PYTHONPATH": str(site),
        "PYTHON": sys.executable,
        "PYTHONDONTWRITEBYTECODE": "1",
        **more,
    }


def everything(site, work, commands, wrap=(), **more):
    for made in ("small.nc", "small.png", "pd.zarr"):
        path = work / made
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    done = subprocess.run(
        [*wrap, *POWERLESS, "bash", "-c", commands],
        cwd=work,
        env=environment(site, **more),
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    assert (work / "small.nc").stat().st_size > 10_000
    return done.stderr.splitlines()


def test_without_home_or_rights(place):
    """One note a command that compiles; nothing else, and nothing from a library."""
    site, work = place
    said = everything(site, work, COMMANDS, HOME="/proc/nobody", XDG_CACHE_HOME="/proc/nobody", TMPDIR="/proc/nowhere")
    assert said and all("compiled code cannot be kept" in line and "NUMBA_CACHE_DIR" in line for line in said), said
    assert not list(site.rglob("*.nbi"))


def test_in_a_folder_of_your_choice_without_a_place_for_temporary_files(place, tmp_path):
    """All of the system read-only but two folders, where that can be arranged."""
    site, work = place
    cache = tmp_path / "cache"
    cache.mkdir()
    wrap = []
    if POWERLESS and subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode == 0:
        script = (
            'for d in /tmp /var/tmp /dev/shm; do mount --bind "$d" "$d" && mount -o remount,bind,ro "$d"; done; for d '
            'in "$1" "$2"; do mount --bind "$d" "$d" && mount -o remount,bind,rw "$d"; done; cd "$1"; shift 2; exec '
            '"$@"'
        )
        wrap = ["unshare", "-m", "bash", "-c", script, "-", str(work), str(cache)]
        # a check of the arrangement itself
        probe = subprocess.run([*wrap, "touch", "/tmp/atc-probe"], capture_output=True, text=True)
        assert probe.returncode and "Read-only" in probe.stderr
    said = everything(site, work, COMMANDS + MORE, wrap, HOME="/proc/nobody", NUMBA_CACHE_DIR=str(cache), JOBS="-j 2")
    assert (work / "small.png").stat().st_size > 1000 and (work / "pd.zarr").is_dir()
    # The case's short horizon alone: worker processes need no /dev/shm.
    assert all(line.startswith("warning: case.toml:4: [body] horizon") for line in said) and len(said) == 1, said
    assert list(cache.rglob("*.nbi"))


def test_two_processes_compile_at_once(place, tmp_path):
    site, work = place
    code = (
        "import numpy as np\nfrom atc.bonds import *\nimport atc\nf = atc.read('plate/silicon_plate.dump.gz', "
        "masses=[28.0855])[0]\np = atc.potential(open('plate/scene.toml').read().split('\"\"\"')[1], units='metal', "
        "folder='plate')\nprint(repr(p.stream(f, None, threads=1).energy))"
    )
    env = environment(site, HOME="/proc/nobody", NUMBA_CACHE_DIR=str(tmp_path))
    jobs = [
        subprocess.Popen(
            [sys.executable, "-c", code], cwd=work, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = [job.communicate(timeout=200) for job in jobs]
    assert [job.returncode for job in jobs] == [0, 0], said
    assert said[0] == said[1] and said[0][1] == "" and float(said[0][0]) < 0
    # half an entry, as a kill on a network file system leaves it
    for entry in [*tmp_path.rglob("*.nbi"), *tmp_path.rglob("*.nbc")]:
        entry.write_bytes(entry.read_bytes()[: entry.stat().st_size // 2])
    again = subprocess.run([sys.executable, "-c", code], cwd=work, env=env, capture_output=True, text=True, timeout=200)
    assert (again.stdout, again.stderr) == said[0]


MODULES = {
    "inner.py": "from atc.compiled import njit\nSCALE = 2.0\n@njit(cache=True)\ndef half(x):\n    return 0.5 * x\n",
    "outer.py": "from atc.compiled import njit\nfrom inner import SCALE, half\n@njit(cache=True)\ndef f(x):\n    "
    "return half(x) + SCALE\n",
}


@pytest.mark.parametrize("old, new, value", [("0.5 * x", "0.25 * x", 3.0), ("SCALE = 2.0", "SCALE = 5.0", 7.0)])
def test_code_that_was_kept_is_not_used_when_what_it_calls_has_changed(tmp_path, old, new, value):
    """numba's own cache would give 4.0 again: it looks at outer.py only."""
    for name, text in MODULES.items():
        (tmp_path / name).write_text(text)

    def value_now():
        done = subprocess.run(
            [sys.executable, "-c", "import outer; print(outer.f(4.0), sum(outer.f.stats.cache_hits.values()))"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"},
        )
        return done.stdout.split() or done.stderr

    assert value_now() == ["4.0", "0"]
    first = value_now()
    assert first[0] == "4.0"
    (tmp_path / "inner.py").write_text(MODULES["inner.py"].replace(old, new))
    assert value_now()[0] == str(value)


def test_kernels_are_compiled_through_one_door():
    """numba's own cache, where it is asked for by name, needs a folder and misses changes."""
    for file in (ROOT / "atc").rglob("*.py"):
        if file.name != "compiled.py" and "cache=True" in file.read_text():
            assert "from numba import njit" not in file.read_text() and "nb.njit" not in file.read_text(), file


def test_numba_is_as_before_once_it_has_compiled():
    """What is remembered of signatures is used while numba compiles and not after, and knows options and types apart."""
    import math

    from numba.core import types

    from atc.compiled import njit
    from atc.simd import greater, lesser

    @njit(error_model="numpy")
    def f(a, b):
        return a + b, lesser(a, b), greater(a, b), a // b

    @njit(error_model="python")
    def g(a, b):
        return a // b

    assert f(7, 2) == (9, 2, 7, 3) and f(7.5, 2.0) == (9.5, 2.0, 7.5, 3.0)
    assert f(-1, 2)[1:3] == (-1, 2) and not math.isfinite(f(1.0, 0.0)[3])
    with pytest.raises(ZeroDivisionError):
        g(1.0, 0.0)
    assert "get_call_type" not in vars(types.Function)
