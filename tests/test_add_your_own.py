"""What CONTRIBUTING.md shows: a quantity, a grid, a reader and a verb of one's own come in through the public door.

A pair style and a peridynamic law: test_add_a_law.py; a kernel: kernels/test_families.py.
"""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from frames import argon
from typer.testing import CliRunner

import atc
from atc import readers
from atc.cli import app
from atc.errors import AtcError
from atc.estimators.registry import QUANTITIES, Quantity, register
from atc.estimators.summed import SITE, Source
from atc.frame import Cell, Frame
from atc.grids import BoundGrid, Grid
from atc.readers.trajectory import Trajectory
from atc.units import units

METAL = units("metal")
LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"
KERN = atc.kernel("quartic", radius=4.0)

# ---- a quantity of sums that there are

SPEED = Quantity(
    "speed",
    "velocity",
    "magnitude of the mass-averaged velocity",
    lambda s: np.linalg.norm(s.velocity, axis=1),
    site=("mass", "momentum"),
    masked=True,
    weight="mass",
    sign="positive",
)


@pytest.fixture
def speed():
    yield register(SPEED)
    del QUANTITIES["speed"]


def test_a_quantity(speed):
    """Formed from its sums, with its units; the only sums that are taken."""
    frame, grid = argon(), atc.Grid.regular(shape=4)
    ds = atc.fields(frame, None, KERN, grid, ["speed", "velocity"])
    np.testing.assert_allclose(ds.speed, np.sqrt((ds.velocity**2).sum("i")), rtol=1e-14)
    assert ds.speed.attrs["units"] == ds.velocity.attrs["units"] and ds.speed.attrs["long_name"] == SPEED.long_name
    assert set(atc.fields(frame, None, KERN, grid, ["speed"]).data_vars) == {"speed", "mask"}
    with pytest.raises(AtcError, match="'speed' is known already"):
        register(SPEED)
    with pytest.raises(AtcError, match="no sums called 'colour'"):
        register(Quantity("hue", "velocity", "hue", SPEED.form, site=("colour",)))


# ---- a quantity with a source of its own

SPIN = Source(3, ("masses", "velocities"), of=lambda atoms: np.cross(atoms.frame.positions, atoms["momentum"]))


@pytest.fixture
def spin():
    SITE["spin"] = SPIN
    yield register(
        Quantity(
            "spin",
            "momentum",
            "angular momentum about the origin, over length",
            lambda s: s.site["spin"],
            rank=1,
            site=("spin",),
        )
    )
    del QUANTITIES["spin"], SITE["spin"]


def test_a_quantity_with_a_source_of_its_own(spin):
    """Against the plain sum over atoms and images; what it needs of a frame is asked for in one line."""
    frame, points = argon(), [[1.0, 4.0, 52.0], [4.0, 8.0, 58.0]]
    ds = atc.fields(frame, None, KERN, atc.Grid.points(points), ["spin"])
    m_n, v_nc = frame.masses, frame.velocities
    v_nc = v_nc - m_n @ v_nc / m_n.sum()
    spin_nc = np.cross(frame.positions, m_n[:, None] * v_nc)
    images = np.stack(np.meshgrid(*3 * [[-1, 0, 1]], indexing="ij"), -1).reshape(-1, 3) @ frame.cell.vectors
    for p, x_c in enumerate(points):
        d_mnc = frame.positions - x_c + images[:, None]
        exact = METAL.to_user("momentum", KERN.phi(d_mnc).sum(0) @ spin_nc)
        np.testing.assert_allclose(ds["spin"][0, p], exact, rtol=1e-12)
    with pytest.raises(AtcError, match="spin"):
        atc.fields(frame.replace(velocities=None), None, KERN, atc.Grid.points(points), ["spin"])


# ---- a grid


class Diagonal(Grid):
    """n points along the diagonal of each frame's cell."""

    def __init__(self, n):
        super().__init__("points", {"n": int(n)})

    follows_cell, follows_atoms = True, False

    def describe(self):
        return f"{self._['n']} points along the cell's diagonal"

    def fixed(self, units, cell, positions=None):
        return self

    def require_dimension(self, dimension):
        if dimension != 3:
            raise AtcError("a diagonal of the cell needs three dimensions")

    def bind(self, units, cell, positions=None):
        s = (np.arange(self._["n"]) + 0.5) / self._["n"]
        return BoundGrid("points", cell, ("point",), xyz=cell.cartesian(np.repeat(s[:, None], 3, axis=1)))


def test_a_grid():
    """In cells that differ: at each frame's diagonal what `Grid.points` gives there."""
    frames = [argon(), argon(Cell([10.0, 10.5, 12.0]), seed=2)]
    pot = atc.potential(LJ, units="metal")
    ds = atc.fields(frames, pot, KERN, Diagonal(5), ["stress", "density"], tolerance=1e-12)
    for k, frame in enumerate(frames):
        xyz = METAL.to_user("length", Diagonal(5).bind(METAL, frame.cell).points_gc)
        one = atc.fields(frame, pot, KERN, atc.Grid.points(xyz), ["stress", "density"], tolerance=1e-12)
        for name in ("stress", "density"):
            want = one[name].values[0]
            np.testing.assert_allclose(ds[name].values[k], want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert "diagonal" in ds.attrs["grid"]


# ---- a reader


class Lines(Trajectory):
    """A frame a line of JSON: {"cell": [a, b, c], "x": [[x, y, z], ...]}."""

    def __init__(self, path, topology=None, units_=None, masses=None):
        super().__init__()
        self.path, self.source, self.units = path, str(path), units(units_ or "metal")
        self.lines = path.read_text().splitlines()

    def __len__(self):
        return len(self.lines)

    def _frame(self, k):
        said, u = json.loads(self.lines[k]), self.units
        x_nc = u.to_internal("length", np.array(said["x"]))
        cell = Cell(u.to_internal("length", np.array(said["cell"])))
        return Frame(x_nc, cell, u, step=k, source=f"{self.source} frame {k}")


@pytest.fixture
def lines():
    readers.register(".lines", Lines)
    yield
    del readers.OPENERS[".lines"]


def test_a_reader(lines, tmp_path):
    """`atc.read`, slices, a scene and `atc info` open the new files."""
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 9, (3, 20, 3))
    path = tmp_path / "run.lines"
    path.write_text("\n".join(json.dumps({"cell": [9.0, 9.0, 9.0], "x": f.tolist()}) for f in x))
    traj = atc.read(path)
    assert len(traj) == 3 and len(traj[1:]) == 2
    np.testing.assert_allclose(METAL.to_user("length", traj[1:][0].positions), x[1], rtol=1e-14)
    ds = atc.fields(traj, None, KERN, atc.Grid.regular(shape=4), ["number_density"])
    assert ds.sizes["frame"] == 3 and float(ds.number_density.mean()) == pytest.approx(20 / 9**3, rel=0.05)
    result = CliRunner().invoke(app, ["info", str(path), "--json"], prog_name="atc")
    assert result.exit_code == 0 and json.loads(result.stdout)["frames"] == 3, result.output
    with pytest.raises(AtcError, match="such as '.mine'"):
        readers.register("lines", Lines)
    with pytest.raises(AtcError, match="gone.lines"):
        atc.read(tmp_path / "gone.lines")


# ---- a verb


@pytest.fixture
def verb():
    before = list(app.registered_commands)

    @app.command()
    def count(file: str) -> None:
        """How many frames a trajectory has."""
        print(len(atc.read(file, units="metal")))

    yield
    app.registered_commands[:] = before


def test_a_verb(verb, tmp_path):
    """With its help; a mistake is one line and exit status 2."""
    dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\n"
    (tmp_path / "a.dump").write_text(dump + "ITEM: ATOMS id x y z\n1 0 0 0\n")
    run = lambda *words: CliRunner().invoke(app, [*map(str, words)], prog_name="atc")  # noqa: E731
    assert "How many frames" in run("--help").stdout
    done = run("count", tmp_path / "a.dump")
    assert done.stdout.strip() == "1", done.output
    gone = run("count", tmp_path / "gone.dump")
    assert gone.exit_code == 2 and gone.stderr.count("\n") == 1 and "gone.dump" in gone.stderr


# ---- the texts

ROOT = Path(__file__).parent.parent


def test_examples_are_those_of_the_tests():
    """Line by line: what CONTRIBUTING.md shows is what is tried here and in the other two files."""
    tests = "\n".join((ROOT / "tests" / f"{name}.py").read_text() for name in ("test_add_a_law", "test_add_your_own"))
    there = {line.strip() for line in tests.split("\n")}
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(), re.DOTALL)
    assert len(blocks) >= 5
    lines = [line.strip() for b in blocks for line in b.split("\n") if line.strip() not in ("", "...")]
    assert [x for x in lines if x not in there and not any(t.endswith(x) for t in there)] == []


def test_links_lead_somewhere():
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "architecture.md", ROOT / "docs" / "formulas.md"):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_the_citation_is_of_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text() and version == atc.__version__
