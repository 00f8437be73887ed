"""Measure the constants of the cost model on this machine: `atc bench --calibrate`.

Each constant is the time of the real code on a small piece of work, CPU seconds of one thread, the best of a few runs,
kernels compiled before. Where one run holds several (visits, rows and bonds) runs of different shape are solved for all
of them by non-negative least squares on relative residuals.
"""

from __future__ import annotations

import platform
from math import ceil, pi
from time import process_time

import numpy as np

from . import costs as model
from .costs import Costs

FCC = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])


def clock(f, repeat: int = 3) -> float:
    """Least CPU seconds of f(), after one run that compiles."""
    f()
    best = np.inf
    for _ in range(repeat):
        begin = process_time()
        f()
        best = min(best, process_time() - begin)
    return max(best, 1e-9)


def argon(n: int):
    """A hot fcc crystal of n³ cells as a Frame, its bonds, and its potential."""
    from ..decomposers import potential

    frame = crystal(FCC, 5.376, n, 0.25, 39.948)
    return frame, potential("units metal\npair_style lj/cut 8.5\npair_coeff 1 1 0.0104 3.4")


def silicon(n: int):
    """Hot diamond silicon of n³ cells as a Frame, and its Stillinger-Weber potential (Phys. Rev. B 31, 5262)."""
    from ..decomposers import StillingerWeber, potential

    frame = crystal(np.concatenate([FCC, FCC + 0.25]), 5.431, n, 0.1, 28.0855)
    sw = StillingerWeber(2.1683, 2.0951, 1.8, 21.0, 1.2, -1 / 3, 7.049556277, 0.6022245584, 4.0, 0.0)
    return frame, potential(sw, units="metal")


def crystal(basis, a, n, shake, mass, seed=0):
    """n³ cells of lattice constant a, shaken, atoms in random order as after a long run."""
    from ..frame import Cell, Frame
    from ..units import units

    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = (cells + basis).reshape(-1, 3) * a
    x = (x + rng.normal(0, shake, x.shape))[rng.permutation(len(x))] % (n * a)
    u = units("metal")
    v = rng.normal(0, np.sqrt(u.boltzmann * 300.0 / mass), x.shape)
    return Frame(x, Cell([n * a] * 3), u, masses=np.full(len(x), mass), velocities=v)


def solve(rows, seconds) -> np.ndarray:
    """Non-negative constants with rows @ constants ≈ seconds, relative residuals."""
    from scipy.optimize import nnls

    seconds = np.asarray(seconds, float)
    scaled = np.asarray(rows, float) / seconds[:, None]
    size = scaled.max(axis=0)
    return nnls(scaled / size, np.ones(len(seconds)))[0] / size


def calibrate(say=lambda text: None, cells: int = 16) -> Costs:
    """Measure every constant; about a minute. `say` is told what is being done."""
    costs = Costs()
    frame, pot = argon(cells)
    n, u = len(frame), frame.units
    bonds = pot.decompose(frame).bonds
    length = float(np.linalg.norm(bonds.r_bc, axis=1).mean())
    say("neighbours and forces")
    _forces(costs, frame, pot)
    say("direct deposit")
    _direct(costs, frame, bonds, length, u)
    say("spectral deposit")
    _spectral(costs, frame, bonds, u)
    say("scattered points and slabs")
    _points(costs, frame, bonds, length, u)
    say("the rest of a frame")
    _rest(costs, frame, pot, n)
    costs.machine = platform.machine() or "this machine"
    return costs


def _forces(costs, frame, pot):
    rows, seconds = [], []
    from ..decomposers import potential

    small = potential("units metal\npair_style lj/cut 4.5\npair_coeff 1 1 0.0104 3.4")
    for f, p in ((frame, pot), (frame, small), silicon(10)):
        load = model.load_of(p, f)
        rows.append([len(f), load.pairs, load.triplets])
        seconds.append(clock(lambda f=f, p=p: p.stream(f, None)))
    costs.list_atom, costs.pair, costs.triplet = solve(rows, seconds)


def _lattice_rows(bound, kern, items, length, components):
    R = kern.support
    many = model.visits(bound, kern, items, length)
    rows = items * (pi * R**2 + 0.5 * pi * R * length) / (bound.cell_volume / bound.spacing[0])
    return [items, rows, many, many * ceil(components / 4)]


def _direct(costs, frame, bonds, length, u):
    from ..deposit import make
    from ..grids import Grid
    from ..kernels import FAMILIES, NAMES, kernel

    def seconds(kern, bound, k, part):
        b_bk = np.ones((len(bonds), k))[part]
        x_bc, r_bc = frame.positions[bonds.i[part]], bonds.r_bc[part]

        def run():
            make("direct", bound, kern, frame.cell, 0, k).add_bonds(x_bc, r_bc, b_bk)

        return clock(run, 2)

    rows, times = [], []
    for spacing, radius, k, thin in (
        (2.5, 10.0, 6, 8),
        (2.5, 10.0, 1, 8),
        (4.0, 6.0, 6, 1),
        (4.0, 6.0, 13, 2),
        (1.5, 5.0, 6, 4),
        (6.0, 12.0, 6, 4),
    ):
        bound = Grid.regular(spacing=spacing).bind(u, frame.cell)
        kern = kernel("quartic", radius)
        part = slice(None, None, thin)
        items = len(bonds.G_b[part])
        rows.append(_lattice_rows(bound, kern, items, length, k))
        times.append(seconds(kern, bound, k, part))
    costs.bond, costs.row, even, costs.accumulate = (max(v, 1e-11) for v in solve(rows, times))
    costs.visit["even"] = even
    bound = Grid.regular(spacing=2.5).bind(u, frame.cell)
    done = {"even"}
    for name in NAMES:
        if "radius" not in FAMILIES[name].takes:
            continue
        kern = kernel(name, radius=7.0)
        family = kern.compiled.name
        if family in done:
            continue
        done.add(family)
        part = slice(None, None, 160 if kern.compiled.seconds > 1e-7 else 16)
        items, n_rows, many, vectors = _lattice_rows(bound, kern, len(bonds.G_b[part]), length, 6)
        rest = costs.bond * items + costs.row * n_rows + costs.accumulate * vectors
        costs.visit[family] = max((seconds(kern, bound, 6, part) - rest) / many, 0.2 * even)


# (tolerance, kernel, R, components, every how many-th bond) of spreading: narrow and wide windows, four and eight
# lanes, in both precisions.
_SPREADS = (
    (1e-2, "gaussian", 10.0, 6, 1),
    (1e-3, "gaussian", 10.0, 3, 1),
    (1e-4, "gaussian", 8.0, 6, 2),
    (1e-5, "gaussian", 10.0, 6, 2),
    (1e-5, "gaussian", 6.0, 4, 2),
    (1e-2, "quartic", 10.0, 6, 2),
    (2e-6, "gaussian", 10.0, 6, 2),
    (1e-6, "gaussian", 10.0, 3, 2),
    (1e-7, "gaussian", 8.0, 6, 4),
    (1e-8, "gaussian", 10.0, 6, 4),
    (1e-8, "gaussian", 10.0, 1, 4),
    (1e-9, "gaussian", 10.0, 6, 8),
)


def _spectral(costs, frame, bonds, u):
    from ..deposit import make
    from ..grids import Grid
    from ..kernels import kernel

    bound = Grid.regular(shape=32).bind(u, frame.cell)
    spread: dict[int, tuple[list, list]] = {4: ([], []), 8: ([], [])}
    finish: dict[int, list[float]] = {4: [], 8: []}
    for tolerance, name, radius, k, thin in _SPREADS:
        part = slice(None, None, thin)
        b_bk = np.ones((len(bonds), k))[part]
        x_bc, r_bc = frame.positions[bonds.i[part]], bonds.r_bc[part]
        last: dict = {}

        kern = kernel(name, radius)

        def add(kern=kern, k=k, tolerance=tolerance, x_bc=x_bc, r_bc=r_bc, b_bk=b_bk, last=last):
            last["deposit"] = d = make("spectral", bound, kern, frame.cell, 0, k, tolerance=tolerance)
            d.add_bonds(x_bc, r_bc, b_bk)

        seconds = clock(add, 2)
        d = last["deposit"]
        rows, times = spread[model.itemsize(d)]
        rows.append([d.points, d.points * model.window_registers(d, k)])
        times.append(seconds)
        finish[model.transform_itemsize(d)].append(clock(d.bond_sums, 2) / (np.prod(np.asarray(d.mesh, float)) * k))
    costs.spread_point, costs.spread_register = solve(*spread[8])
    costs.spread_point_single, costs.spread_register_single = solve(*spread[4])
    costs.mesh_node, costs.mesh_node_single = float(np.median(finish[8])), float(np.median(finish[4]))
    _moments(costs, frame, bonds, bound)


def _moments(costs, frame, bonds, bound):
    from ..deposit import make
    from ..deposit.moments import count
    from ..kernels import kernel

    rows, times, finished, finishes = [], [], [], []
    # Of equal strength: none of them becomes points.
    G_b = 1.0 / (bonds.r_bc**2).sum(1)
    for radius, tolerance, order in (
        (20.0, 1e-2, 2),
        (20.0, 1e-4, 3),
        (20.0, 1e-6, 4),
        (14.0, 1e-4, 4),
        (30.0, 1e-5, 3),
    ):
        last: dict = {}

        def add(radius=radius, tolerance=tolerance, order=order, last=last):
            d = last["deposit"] = make(
                "spectral", bound, kernel("gaussian", radius), frame.cell, 0, 6, tolerance=tolerance, order=order
            )
            d.add_bond_stress(frame.positions, bonds.i, bonds.r_bc, G_b, j_b=bonds.j)

        rows.append([len(bonds), len(bonds) * count(order)])
        times.append(clock(add, 2))
        d, many = last["deposit"], count(order)

        def both(add=add, last=last):
            add()
            last["deposit"].bond_sums()

        finishes.append(max(clock(both, 2) - times[-1], 1e-9))
        node = costs.mesh_node_single if model.transform_itemsize(d) == 4 else costs.mesh_node
        nodes = float(np.prod(np.asarray(d.mesh, float)))
        finished.append([len(frame), len(frame) * model.window_registers(d, 8 * ceil(many / 8)), nodes * many])
        finishes[-1] = max(finishes[-1] - node * nodes * many, 0.2 * finishes[-1])
    costs.moment_bond, costs.moment = solve(rows, times)
    costs.moment_atom, costs.moment_register, costs.moment_node = solve(finished, finishes)


def _points(costs, frame, bonds, length, u):
    from ..deposit import exact_at, make
    from ..grids import Grid
    from ..kernels import kernel

    rows, times = [], []
    rng = np.random.default_rng(0)
    for count, radius in ((20, 5.0), (100, 10.0), (1000, 5.0)):
        points = frame.cell.cartesian(rng.random((count, 3)))
        kern = kernel("quartic", radius)
        some = slice(None, len(bonds) // 4)

        def run(points=points, kern=kern, some=some):
            exact_at(points, kern, frame.cell, 0, 6).add_bond_stress(
                frame.positions, bonds.i[some], bonds.r_bc[some], bonds.G_b[some]
            )

        items = len(bonds.G_b[some])
        reached = items * count * (4 / 3 * pi * radius**3 + pi * radius**2 * length) / frame.cell.volume
        rows.append([items, reached])
        times.append(clock(run, 2))
    costs.point_bond, costs.point_visit = solve(rows, times)
    # One point, a small kernel: nearly all bonds are passed over.
    deposit = exact_at(frame.cell.cartesian(rng.random((1, 3))), kernel("quartic", 1.0), frame.cell, 0, 6)
    deposit.expect(0.5 * length)
    costs.filter_bond = clock(lambda: list(deposit.find(frame.positions, bonds.i, bonds.r_bc))) / len(bonds)
    slab = Grid.slab("z", 100).bind(u, frame.cell)

    def profile():
        make("direct", slab, kernel("quartic", 10.0), frame.cell, 0, 6).add_bond_stress(
            frame.positions, bonds.i, bonds.r_bc, bonds.G_b
        )

    costs.slab_bond = clock(profile, 2) / len(bonds)


def _rest(costs, frame, pot, n):
    import tempfile
    from pathlib import Path

    from .. import fields, kernel, read
    from ..deposit.gradient import gather
    from ..grids import Grid
    from ..kernels import kernel as make_kernel

    bound = Grid.regular(shape=24).bind(frame.units, frame.cell)
    R = 6.0
    seconds = clock(lambda: gather(bound, make_kernel("quartic", R), frame.cell, frame.positions, np.ones((n, 4))), 1)
    costs.gather_visit *= seconds / model.gather(costs, bound, make_kernel("quartic", R), n, 0.0, 4)
    # What is neither list nor deposit: the smallest frame, and one with many points.
    tiny, kern = argon(2)[0], kernel("quartic", radius=3.0)
    costs.frame = clock(lambda: fields(tiny, pot, kern, Grid.regular(shape=4), ["stress"], threads=1, tolerance=1e-12))
    big = Grid.regular(shape=64)
    spent = clock(lambda: fields(tiny, None, kern, big, ["stress_kinetic"], threads=1, tolerance=1e-12), 2)
    inner = big.bind(tiny.units, tiny.cell)
    deposit = model.direct(costs, inner, kern, len(tiny), 0.0, 10)
    costs.value = max(spent - costs.frame - deposit, 0.0) / (
        64**3 * (9 + 10)
    )  # components of the field and of the sums
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.dump"
        with open(path, "w") as f:
            f.write(f"ITEM: UNITS\nmetal\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{n}\n")
            f.write("ITEM: BOX BOUNDS pp pp pp\n" + "0 100\n" * 3 + "ITEM: ATOMS id type x y z vx vy vz\n")
            rows = np.c_[np.arange(1, n + 1), np.ones(n), frame.positions, frame.velocities]
            np.savetxt(f, rows, fmt="%d %d" + 6 * " %.10g")
        costs.read_atom = clock(lambda: read(path, masses=[40.0])[0]) / n
        values = np.random.default_rng(0).normal(size=(64, 64, 64, 9))
        import zarr

        def write():
            zarr.open_group(f"{folder}/w.zarr", mode="w", zarr_format=2).create_array(
                "a", shape=values.shape, chunks=values.shape, dtype="f8"
            )[...] = values

        costs.written_byte = clock(write) / values.nbytes
