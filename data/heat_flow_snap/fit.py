"""Si.snapcoeff: a linear SNAP, 2J = 4, by least squares on energies and forces of Stillinger-Weber silicon in shaken
and strained crystals. Needs the file Si.sw that LAMMPS comes with (data/silicon_plate has it)."""

from pathlib import Path

import numpy as np

import atc
from atc.decomposers.many_body.snap import SNAP
from atc.decomposers.many_body.snap_file import read_snap
from atc.frame import Cell, Frame
from atc.units import units

HERE = Path(__file__).parent
METAL = units("metal")
FCC = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])


def crystal(rng, shaken, strained, a=5.431):
    cells = np.stack(np.meshgrid(*[range(2)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    s = (cells + np.concatenate([FCC, FCC + 0.25])).reshape(-1, 3) / 2
    cell = 2 * a * (np.eye(3) + strained * rng.normal(size=(3, 3)))
    return Frame(s @ cell + shaken * rng.normal(size=s.shape), Cell(cell), METAL, types=np.ones(64, int))


def write(coefficients):
    lines = ["# UNITS: metal", f"1 {len(coefficients)}", "Si 0.5 1.0", *(f"{c:.15g}" for c in coefficients)]
    (HERE / "Si.snapcoeff").write_text("\n".join(lines) + "\n")


def rows(frame, file, target):
    """Energy of an atom and forces by each coefficient, and the target's."""
    columns = [np.r_[1.0, np.zeros(3 * len(frame))]]
    for k in range(file.beta.shape[1]):
        file.constant[:], file.beta[:] = 0.0, np.arange(file.beta.shape[1]) == k
        d = atc.potential([SNAP(file, ["Si"])], "metal").decompose(frame)
        columns.append(np.r_[d.energy / len(frame), d.forces_nc.ravel()])
    d = target.decompose(frame)
    return np.array(columns).T, np.r_[d.energy / len(frame), d.forces_nc.ravel()]


def main():
    write(np.zeros(15))
    file = read_snap(HERE / "Si.snapcoeff", HERE / "Si.snapparam")
    target = atc.potential("pair_style sw\npair_coeff * * ../silicon_plate/Si.sw Si", units="metal", folder=HERE)
    rng = np.random.default_rng(0)
    shapes = [(j, s) for j in (0.03, 0.08, 0.12, 0.16, 0.2) for s in (0, 0.01, 0.02, 0.03) for _ in range(2)]
    A, b = zip(*(rows(crystal(rng, *shape), file, target) for shape in shapes))
    weight = np.r_[50.0, np.ones(3 * 64)]
    A = np.concatenate([weight[:, None] * a for a in A])
    write(np.linalg.lstsq(A, np.concatenate([weight * x for x in b]), rcond=1e-12)[0])


if __name__ == "__main__":
    main()
