"""Random small scenes: what an output says of its error, and what it promised, against the exact sum at every point.

`python tests/random_scenes.py [COUNT] [FIRST]` tries so many and prints the summary that stands in docs/reliability.md.
"""

from __future__ import annotations

import dataclasses
import re
import sys
import warnings
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))

import energy_systems

import atc
from atc.deposit import spectral
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame
from atc.planar import planar
from atc.planning import method_choice
from atc.planning.costs import Costs
from atc.units import units

#: An error reported is at least this part of the true one, ...
SAFETY = 5.0
#: ... or the true one is below so much of the tolerance: what the check itself may leave out, see `accuracy.BEYOND`.
FLOOR = 0.05
# What sums in another order may differ by.
ROUNDING = 1e-12

#: Quantities that are asked for together: (names, whether they need a potential, masses and velocities, a reference).
QUANTITIES = {
    "stress": ("stress", "virial_stress"),
    "stress_potential": ("stress_potential",),
    "density": ("density", "number_density", "momentum"),
    "temperature": ("temperature", "velocity", "density"),
    "energy": ("energy", "energy_flux"),
    "heat": ("heat_flux", "churning", "stress"),
    "churning": ("churning_divergence", "churning_heat_source"),
    "smoothed": ("smoothed_virial_stress",),
    "gradients": ("velocity_gradient", "strain_rate", "vorticity", "temperature"),
    "displacement": ("displacement", "displacement_gradient", "density"),
    "piola": ("piola_stress", "eshelby_stress"),
    "peridynamic": ("peridynamic_stress", "peridynamic_piola_stress"),
}
_REFERENCE = ("displacement", "piola", "peridynamic")
_NO_POTENTIAL = ("density", "temperature", "gradients", "displacement")
_MANY = (
    "sw",
    "sw two elements",
    "sw primitive",
    "eam",
    "tersoff",
    "hybrid",
    "dihedral opls",
    "3-body",
    "4-body",
    "morse cluster",
    "atm",
)
_SMOOTH = ("gaussian", "quartic", "lucy", "cubic", "bspline")
_ROUGH = ("linear", "hardy", "step", "box", "piecewise-linear")
FCC = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])


@dataclass
class Scene:
    """One of them, the same for one seed; `about` in words."""

    seed: int
    frames: list
    pot: object
    kern: object
    grid: object
    group: str
    tolerance: float
    method: str
    reference: object = None
    average: bool = False
    tiles: tuple | None = None
    about: dict = field(default_factory=dict)

    @classmethod
    def of(cls, seed: int) -> Scene:
        rng = np.random.default_rng([20261128, seed])
        flat = bool(rng.random() < 0.1)
        group = str(rng.choice([*QUANTITIES]))
        many = not flat and group not in _NO_POTENTIAL and rng.random() < 0.3
        if many:
            name = str(rng.choice(_MANY))
            frame, pot = energy_systems.system(name, seed=int(rng.integers(1000)))
            atoms, size = name, 5.0
        else:
            frame, atoms = _atoms(rng, flat)
            reach = rng.uniform(3.8, 7.0)
            soft = rng.random() < 0.5
            styles = "lj/smooth/linear" if soft else "lj/cut"
            pot = _lj(styles, round(float(reach), 1), 2 if flat else 3)
            size = 7.0
        frame = _moving(frame, rng)
        if flat:
            frame = planar(frame)
        kind = str(rng.choice(_SMOOTH if rng.random() < 0.85 else _ROUGH, p=None))
        if rng.random() < 0.4:
            kind = "gaussian"
        kern = _kernel(kind, float(size * rng.uniform(0.35, 1.6)), rng)
        grid, grid_kind = _grid(frame, rng)
        # Kernels whose modes decay slowly need large meshes.
        least = (
            7.0 if kind == "gaussian" else 2.5 if group in ("gradients", "displacement", "churning", "piola") else 4.0
        )
        average = bool(
            not many
            and rng.random() < 0.03
            and group in ("stress", "stress_potential", "density", "temperature", "energy")
        )
        frames = [frame]
        if average:
            frames = [_shaken(frame, rng, 0.02) for _ in range(64)]
        tiles = tuple(int(n) for n in rng.integers(1, 3, 3)) if rng.random() < 0.06 and not flat else None
        return cls(
            seed,
            frames,
            None if group in _NO_POTENTIAL and rng.random() < 0.5 else pot,
            kern,
            grid,
            group,
            float(10 ** -rng.uniform(2, least)),
            str(rng.choice(["spectral", "auto"], p=[0.6, 0.4])),
            _shaken(frame, rng, 0.1) if group in _REFERENCE else None,
            average,
            tiles,
            {
                "atoms": atoms,
                "kernel": kind,
                "grid": grid_kind,
                "cell": _word(frame.cell),
                "dimension": frame.dimension,
            },
        )

    def run(self, exactly=False, **more):
        """(dataset, what was said)"""
        how = {"tolerance": 1e-12} if exactly else {"tolerance": self.tolerance, "method": self.method}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            ds = atc.fields(
                self.frames,
                self.pot,
                self.kern,
                self.grid,
                QUANTITIES[self.group],
                reference=self.reference,
                average=self.average,
                tiles=self.tiles,
                threads=1,
                **how,
                **more,
            )
        return ds, [str(w.message) for w in said if issubclass(w.category, AtcWarning)]


def _lj(style, cutoff, dimension):
    key = style, cutoff, dimension
    if key not in _known:
        lines = f"pair_style {style} {cutoff}\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3"
        _known[key] = atc.potential(lines if dimension == 3 else f"dimension 2\n{lines}", units="metal")
    return _known[key]


_known: dict = {}


def _atoms(rng, flat):
    """A frame of argon-like atoms, and what it is."""
    kind = str(
        rng.choice(
            ["crystal", "perfect", "hot", "gas", "cluster", "wire", "layer", "drop and gas", "two", "one"],
            p=[0.12, 0.05, 0.25, 0.12, 0.14, 0.08, 0.08, 0.08, 0.05, 0.03],
        )
    )
    a = rng.uniform(5.0, 5.6)
    n = rng.integers(2, 4, 3) if not flat else np.array([*rng.integers(3, 6, 2), 1])
    basis = FCC if not flat else np.array([[0, 0, 0], [0.5, 0.5, 0]])
    steps = np.stack(np.meshgrid(*[np.arange(k) for k in n], indexing="ij"), -1).reshape(-1, 1, 3)
    s = (steps + basis).reshape(-1, 3) / n
    edges = n * (a if not flat else 1.25 * a)
    vectors = np.diag(edges.astype(float))
    if flat:
        vectors[2, 2] = 5.0
    tilt = rng.choice([0.0, 0.2, 0.8])
    lower = np.tril(rng.uniform(-tilt, tilt, (3, 3)), -1)
    if flat:
        lower[2] = 0.0
    vectors = vectors + lower * edges[:, None].max()
    periodic = [bool(p) for p in rng.random(3) < 0.75]
    if flat:
        periodic[2] = True
    origin = rng.choice([0.0, 1.0, 1e4]) * rng.normal(size=3)
    shake = {"crystal": 0.05, "perfect": 0.0}.get(kind, rng.uniform(0.1, 0.35))
    if kind == "gas":
        vectors = vectors * (np.array([2.5, 2.5, 1.0])[:, None] if flat else 2.0)
        s = s[rng.random(len(s)) < 0.5] if len(s) > 8 else s
    elif kind in ("cluster", "wire", "layer", "drop and gas"):
        # Condensed in a part of a larger cell.
        wide = {"cluster": (1, 1, 1), "wire": (0, 1, 1), "layer": (0, 0, 1), "drop and gas": (1, 1, 1)}[kind]
        grow = np.array([1.0 + w * rng.uniform(1.0, 2.5) for w in wide])
        if flat:
            grow[2] = 1.0
        vectors, s = vectors * grow[:, None], s / grow
        if kind == "drop and gas":
            s = np.concatenate([s, rng.random((6, 3))])
    elif kind in ("two", "one"):
        s = s[:1]
    cell = Cell(vectors, origin, periodic)
    x = cell.cartesian(s) + rng.normal(0, shake, (len(s), 3))
    if kind == "two":
        d = rng.normal(size=3) * [1, 1, 0 if flat else 1]
        x = np.concatenate([x, x + rng.uniform(2.2, 4.5) * d / np.linalg.norm(d)])
    elif kind == "drop and gas" and len(x) > 6:
        near = np.linalg.norm(x[-6:, None] - x[None, :-6], axis=2).min(1) < 2.8
        x = np.concatenate([x[:-6], x[-6:][~near]])
    if flat:
        x[:, 2] = cell.origin[2]
    if not all(periodic):  # inside the cell along open axes, with room
        f = cell.fractional(x)
        f[:, ~cell.periodic] -= np.floor(f[:, ~cell.periodic])
        x = cell.cartesian(f)
        if flat:
            x[:, 2] = cell.origin[2]
    masses = rng.choice([39.948, 83.8, 131.3][: rng.integers(1, 4)], len(x))
    return Frame(
        x, cell, units("metal"), types=np.where(masses < 50, 1, 2), masses=masses, velocities=np.zeros_like(x)
    ), kind


def _moving(frame, rng):
    """Thermal velocities, with a drift, a shear, or none at all."""
    flat = not frame.positions[:, 2].std() > 1e-9 and len(frame) > 1
    v = rng.normal(size=frame.positions.shape) * np.sqrt(frame.units.boltzmann * 90.0 / frame.masses)[:, None]
    thermal = np.sqrt(frame.units.boltzmann * 90.0 / frame.masses.mean())
    how = rng.choice(["thermal", "drift", "fast", "shear", "rest"], p=[0.4, 0.25, 0.1, 0.2, 0.05])
    if how == "drift":
        v += thermal * rng.normal(size=3)
    elif how == "fast":
        v += 1e4 * thermal * rng.normal(size=3)
    elif how == "shear":
        v[:, 0] += 5.0 * thermal * np.sin(2 * np.pi * frame.cell.fractional(frame.positions)[:, 1])
    elif how == "rest":
        v *= 0.0
    if flat or len(frame) <= 2:
        v[:, 2] = 0.0
    return frame.replace(velocities=v)


def _shaken(frame, rng, by):
    d = rng.normal(0, by, frame.positions.shape)
    if frame.dimension == 2:
        d[:, 2] = 0.0
    return frame.replace(positions=frame.positions + d)


def _kernel(kind, radius, rng):
    if kind == "piecewise-linear":
        return atc.kernel(kind, table=[(0.0, 1.0), (0.3 * radius, 0.9), (0.7 * radius, 0.2), (radius, 0.0)])
    return atc.kernel(kind, radius)


def _grid(frame, rng):
    kind = str(
        rng.choice(
            ["regular", "region", "plane", "line", "slab", "points", "atoms"],
            p=[0.45, 0.1, 0.12, 0.08, 0.1, 0.08, 0.07],
        )
    )
    flat, cell = frame.dimension == 2, frame.cell
    G = atc.Grid
    if flat and kind in ("plane", "slab"):
        kind = "regular"
    origin, v = cell.origin, cell.vectors
    if kind == "regular":
        shape = [int(n) for n in rng.integers(1, 11, 3)]
        return G.regular(shape=shape[:2] if flat else shape, at=str(rng.choice(["centers", "corners"]))), kind
    if kind == "region":
        part = rng.uniform(0.2, 0.8)
        shape = [int(n) for n in rng.integers(2, 8, 3)]
        if flat:
            return G.regular(vectors=(v * part)[:2, :2], shape=shape[:2], origin=origin[:2]), kind
        return G.regular(vectors=v * part, shape=shape, origin=origin + 0.1 * v.sum(0)), kind
    if kind == "plane":
        return G.plane(axis=str(rng.choice(list("xyz"))), shape=[int(n) for n in rng.integers(3, 20, 2)]), kind
    if kind == "line":
        ends = [cell.cartesian(rng.random(3))[: 2 if flat else 3] for _ in range(2)]
        return G.line(*ends, int(rng.integers(2, 60))), kind
    if kind == "slab":
        return G.slab(str(rng.choice(list("xyz"))), int(rng.integers(1, 30))), kind
    if kind == "points":
        return G.points(cell.cartesian(rng.random((int(rng.integers(1, 200)), 3)))[:, : 2 if flat else 3]), kind
    return G.atoms(), kind


def _word(cell):
    shape = "orthogonal" if cell.orthogonal else "tilted"
    return f"{shape}, {'periodic' if cell.periodic.all() else 'open' if not cell.periodic.any() else 'part open'}"


# --- what is found


@dataclass
class Found:
    """One field of one scene. true, reported : errors relative to its largest value; told : whether the output says
    that the tolerance was not kept"""

    seed: int
    name: str
    method: str
    true: float
    reported: float
    tolerance: float
    told: bool
    about: dict
    expected: float = 0.0
    floor: float = 0.0
    mask: bool = True  # as the exact sum's

    @property
    def spectral(self) -> bool:
        return "spectral" in self.method

    @property
    def kept(self) -> bool:
        return self.true <= self.tolerance + self.floor

    @property
    def lost(self) -> bool:
        """An error of the field's own size says that nothing is left of it: how much larger the error is, is not
        promised."""
        return self.reported >= 0.99 and self.told

    @property
    def honest(self) -> bool:
        return self.true <= SAFETY * self.reported + FLOOR * self.tolerance + self.floor or self.lost


@contextmanager
def spectral_preferred():
    """Costs at which the exact sum is hardly ever chosen, though the frames are small."""
    slow = dataclasses.replace(Costs(), bond=1e-4, row=1e-5, gather_visit=1e-4, point_visit=1e-4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Costs, "load", classmethod(lambda cls: slow))
        patch.setattr(Costs, "visit_of", lambda self, compiled: 1e-5)
        patch.setattr(method_choice, "CHEAP", 0.0)
        patch.setattr(method_choice, "SEARCH", (0.0, 0.0))
        patch.setattr(method_choice, "WATCH", (0.0, 0.0, 0.0))
        # Seconds a mesh are for larger frames.
        patch.setattr(method_choice, "MOST_MEMORY", 3e7)
        patch.setattr(spectral, "LARGEST", 3e7)
        yield


def compared(scene: Scene) -> list[Found] | str:
    """Every field of a scene against the exact sum; or what the scene is refused for."""
    try:
        ds, said = scene.run()
    except AtcError as e:
        return str(e)
    exact, _ = scene.run(exactly=True)
    out = []
    for name in ds.data_vars:
        attrs = ds[name].attrs
        if "error_max" not in attrs:
            continue
        a, b = ds[name].values, exact[name].values
        mask = bool(np.array_equal(np.isnan(a), np.isnan(b)))
        a, b = np.nan_to_num(a), np.nan_to_num(b)
        largest = float(np.abs(b).max(initial=0.0)) or float(np.abs(a).max(initial=0.0))
        difference = float(np.abs(a - b).max(initial=0.0))
        own = exact[name].attrs
        if "error_relative_to" in own or "error_relative_to" in attrs:
            continue  # a field of rounding
        true = difference / largest if largest > 0 else (0.0 if difference == 0 else np.inf)
        told = "tolerance_kept" in attrs and any("tolerance" in s for s in said)
        out.append(
            Found(
                scene.seed,
                name,
                ds.attrs["method"],
                true,
                float(attrs["error_max"]),
                scene.tolerance,
                told,
                {
                    **scene.about,
                    "method": scene.method,
                    "average": scene.average,
                    "tiles": scene.tiles is not None,
                    "group": scene.group,
                },
                float(attrs["error_expected"]),
                ROUNDING + 3 * float(own["error_max"]),
                mask,
            )
        )
    return out


@dataclass
class Summary:
    found: list = field(default_factory=list)
    refused: Counter = field(default_factory=Counter)
    scenes: int = 0

    def add(self, found) -> None:
        self.scenes += 1
        if isinstance(found, str):
            self.refused[re.sub(r"\d+ x \d+ x \d+|tolerance \S+|kernel '[\w-]+'", "..", found.split(": use")[0])] += 1
        else:
            self.found += found

    @property
    def approximate(self):
        return [f for f in self.found if f.spectral]

    @property
    def broken(self):
        """What must not be: a tolerance not kept and not told, an error reported too small, another mask."""
        return [f for f in self.found if not f.mask or not f.honest or not (f.kept or f.told)]

    def __str__(self):
        some = self.approximate
        unkept = [f for f in self.found if not f.kept]
        lines = [
            f"{self.scenes} scenes, {sum(self.refused.values())} refused, {len(self.found)} fields, {len(some)} of "
            "them with approximate sums",
            f"tolerance not kept: {sum(f.about['method'] == 'auto' for f in unkept)} of "
            f"{sum(f.about['method'] == 'auto' for f in some)} by the planned method, "
            f"{sum(f.about['method'] != 'auto' for f in unkept)} of {sum(f.about['method'] != 'auto' for f in some)} "
            f"by the forced one; not told: {sum(not f.told for f in unkept)}",
            f"other mask than the exact sum's: {sum(not f.mask for f in self.found)}; reported too small: "
            f"{sum(not f.honest for f in self.found)}; "
            f"of fields of which nothing was left: {sum(f.lost for f in self.found)}",
        ]
        for what, of in (
            ("reported error", "reported"),
            ("expected error", "expected"),
            ("tolerance, where kept", "tolerance"),
        ):
            ratio = [
                f.true / getattr(f, of)
                for f in some
                if f.true > FLOOR * f.tolerance + f.floor and not f.lost and (f.kept or of != "tolerance")
            ]
            if ratio:
                q = np.percentile(ratio, [50, 90, 99, 100])
                lines.append(
                    f"true error over the {what} ({len(ratio)} fields): median {q[0]:.2f}, 90 % {q[1]:.2f}, 99 % "
                    f"{q[2]:.2f}, largest {q[3]:.2f}"
                )
        lines += [f"  refused: {why} ({n})" for why, n in self.refused.most_common()]
        for key in ("atoms", "kernel", "grid", "cell", "dimension", "group", "method", "average", "tiles"):
            count = Counter(f.about[key] for f in some)
            lines.append(f"  {key}: " + ", ".join(f"{k} {n}" for k, n in count.most_common()))
        return "\n".join(lines)


def tried(seeds, say=lambda text: None) -> Summary:
    """All scenes of some seeds."""
    summary = Summary()
    with spectral_preferred():
        for seed in seeds:
            known = len(summary.broken)
            summary.add(compared(Scene.of(seed)))
            for f in summary.broken[known:]:
                say(str(f))
    return summary


if __name__ == "__main__":
    count, first = (int(a) for a in (*sys.argv[1:], *("1000", "0")[len(sys.argv) - 1 :]))
    print(tried(range(first, first + count), lambda text: print(text, flush=True)))
