"""How fast atc reads, next to pandas, ASE and MDAnalysis, on a LAMMPS text dump made for the purpose.

    python benchmarks/read.py [--atoms 100000] [--frames 20] [--peers]

Prints seconds (CPU and wall) and MB/s of text. atc's figure includes finding the frames, sorting by id and unit
conversion. ``--peers`` adds the three others; they are slow.
"""

from __future__ import annotations

import argparse
import gzip
import io
import shutil
import struct
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np


def write(path: Path, n: int, frames: int) -> None:
    """A dump as LAMMPS writes it: `%g`, atoms in no order, id type x y z vx vy vz."""
    rng = np.random.default_rng(1)
    length = 100.0
    text, binary = open(path, "w"), open(path.with_suffix(".bin"), "wb")
    with text, binary:
        for k in range(frames):
            order = rng.permutation(n)
            positions, velocities = rng.random((n, 3)) * length, rng.normal(size=(n, 3))
            text.write(
                f"ITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n{n}\nITEM: BOX BOUNDS pp pp pp\n" + 3 * f"0.0 {length}\n"
            )
            text.write("ITEM: ATOMS id type x y z vx vy vz\n")
            table = np.column_stack([order + 1, np.ones(n), positions, velocities])
            text.write(
                "\n".join(
                    f"{i:.0f} {t:.0f} {a:g} {b:g} {c:g} {u:g} {v:g} {w:g}" for i, t, a, b, c, u, v, w in table.tolist()
                )
                + "\n"
            )
            binary.write(struct.pack("<q10sii", -10, b"DUMPCUSTOM", 1, 2) + struct.pack("<qqi6i", k, n, 0, *[0] * 6))
            columns = b"id type x y z vx vy vz"
            binary.write(struct.pack("<6di", *[0.0, length] * 3, 8) + struct.pack("<ibi", 0, 0, len(columns)) + columns)
            binary.write(struct.pack("<ii", 1, 8 * n) + table.astype("<f8").tobytes())


def timed(label: str, size: float, run) -> None:
    wall, cpu = time.perf_counter(), time.process_time()
    frames = run()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(f"{label:34s} {frames:4d} frames  {wall:7.2f} s wall  {cpu:7.2f} s CPU  {size / 1e6 / wall:7.0f} MB/s")


def read_atc(path) -> int:
    import atc

    return sum(1 for _ in atc.read(path, units="metal"))


def skip_atc(path) -> int:
    import atc

    traj = atc.read(path, units="metal")
    assert traj[-1] is not None
    return len(traj)


def read_pandas(path) -> int:
    """The bare table with pandas' C parser: nothing sorted, converted or checked."""
    import pandas as pd

    n = 0
    with open(path, "rb") as f:
        while f.readline():
            f.readline()
            f.readline()
            atoms = int(f.readline())
            for _ in range(5):
                f.readline()
            body = b"".join(f.readline() for _ in range(atoms))
            pd.read_csv(io.BytesIO(body), sep=" ", header=None, engine="c")
            n += 1
    return n


def read_ase(path) -> int:
    from ase.io import iread

    return sum(1 for _ in iread(path, index=":", format="lammps-dump-text"))


def read_mdanalysis(path) -> int:
    import MDAnalysis

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(
            path, format="LAMMPSDUMP", atom_style="id type x y z", topology_format="LAMMPSDUMP"
        )
        return sum(1 for ts in universe.trajectory if ts.positions is not None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--atoms", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--peers", action="store_true", help="also pandas, ASE and MDAnalysis")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.dump"
        write(path, args.atoms, args.frames)
        small = Path(folder) / "warm.dump"
        write(small, 10, 2)
        zipped = path.with_suffix(".dump.gz")
        with open(path, "rb") as a, gzip.open(zipped, "wb", compresslevel=6) as b:
            shutil.copyfileobj(a, b)
        read_atc(small)  # compile, or load from the cache
        size = path.stat().st_size
        print(f"{args.atoms} atoms, {args.frames} frames, {size / 1e6:.0f} MB of text")
        timed("atc, text", size, lambda: read_atc(path))
        timed("atc, text, length and last frame", size, lambda: skip_atc(path))
        timed("atc, text .gz", size, lambda: read_atc(zipped))
        timed("atc, binary", size, lambda: read_atc(path.with_suffix(".bin")))
        if args.peers:
            timed("pandas, table only", size, lambda: read_pandas(path))
            timed("ASE", size, lambda: read_ase(path))
            timed("MDAnalysis", size, lambda: read_mdanalysis(path))


if __name__ == "__main__":
    main()
