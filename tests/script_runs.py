"""A LAMMPS script run by LAMMPS, and what atc makes of what a user has: the script, the files it reads, a dump."""

import os
from dataclasses import dataclass

import numpy as np
from lammps_oracle import lammps_session

import atc

COLUMNS = "id type x y z fx fy fz"


@dataclass
class Ran:
    energy: float
    virial: (
        np.ndarray
    )  # (3, 3) Σ G r⊗r in energy units of the script: minus the virial pressure times the volume, over nktv2p
    forces: np.ndarray
    ids: np.ndarray


def run_script(folder, text, *, after="", columns=COLUMNS, dump="run.dump", name="in.run", cmdargs=()):
    """Write the script, run it in LAMMPS with `run 0` and one dump frame behind it; what LAMMPS computed, in its units.

    after : lines that only LAMMPS gets (they may leave out what the script has behind them)
    """
    (folder / name).write_text(text)
    here = os.getcwd()
    os.chdir(folder)
    try:
        with lammps_session(*cmdargs) as lmp:
            lmp.file(name)
            for line in after.splitlines():
                lmp.command(line)
            for line in (
                "compute _pv all pressure NULL virial",
                "thermo_style custom step pe vol c__pv[*]",
                "thermo_modify norm no lost ignore",
                f"dump _d all custom 1 {dump} {columns}",
                "dump_modify _d sort id format float %.17g",
                "run 0 post no",
            ):
                lmp.command(line)
            p = np.array(lmp.numpy.extract_compute("_pv", 0, 1))
            volume = lmp.get_thermo("vol")
            n = lmp.extract_global("nlocal")
            ids = np.array(lmp.numpy.extract_atom("id")[:n])
            f = np.array(lmp.numpy.extract_atom("f")[:n])[np.argsort(ids)]
            xx, yy, zz, xy, xz, yz = -p * volume / lmp.extract_global("nktv2p")
            return Ran(lmp.get_thermo("pe"), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), f, np.sort(ids))
    finally:
        os.chdir(here)


def compare(folder, ran, *, dump="run.dump", name="in.run", tol=1e-10, **read):
    """Energy, forces and virial of atc, from script and dump alone, beside LAMMPS's. Returns the frame and the
    potential."""
    pot = atc.potential(folder / name)
    traj = atc.read(folder / dump, units=pot.units.name, **read)
    frame = pot.complete(traj[-1])
    d = pot.stream(frame, forces=True)
    u = pot.units
    scale = max(abs(ran.energy), np.abs(ran.virial).max(), 1e-3)
    assert u.to_user("energy", d.energy) == __import__("pytest").approx(ran.energy, rel=tol, abs=tol * scale)
    np.testing.assert_allclose(
        u.to_user("force", d.forces_nc), ran.forces, rtol=0, atol=tol * max(np.abs(ran.forces).max(), 1e-3)
    )
    np.testing.assert_allclose(u.to_user("energy", d.virial_cc), ran.virial, rtol=0, atol=tol * scale)
    return frame, pot


def agree(folder, text, *, after="", columns=COLUMNS, cmdargs=(), tol=1e-10, **read):
    """`run_script` and `compare`."""
    return compare(folder, run_script(folder, text, after=after, columns=columns, cmdargs=cmdargs), tol=tol, **read)
