"""LAMMPS's PERI package, live, on the nodes of an `atc.pd.Body`: what the peridynamics tests compare with."""

from __future__ import annotations

import os
import tempfile

import numpy as np
from lammps_oracle import lammps_session


def setup_lines(body, pair, *, skin=None, dt, indent=None, box=None, newton="on"):
    """The input up to the first run. `pair` = (style, lines of coefficients); positions come from a data file next to
    this."""
    periodic = body.cell.periodic
    boundary = " ".join("p" if p else "f" for p in periodic)
    skin = 2.0 * body.spacing if skin is None else skin
    lines = [
        "units si",
        f"newton {newton}",
        f"boundary {boundary}",
        "atom_style peri",
        "atom_modify map array sort 0 0",
        f"neighbor {skin:.17g} bin",
        "neigh_modify delay 0 every 1 check yes",
        f"lattice sc {body.spacing:.17g}",
        "read_data DATA",
        f"pair_style {pair[0]}",
        *(f"pair_coeff {line}" for line in pair[1].split("\n")),
        "fix F1 all nve",
        "compute C1 all damage/atom",
        f"timestep {dt:.17g}",
        "thermo_modify lost error flush no",
    ]
    if indent is not None:
        radius, k, center, velocity = indent
        for axis, c, v in zip("xyz", center, velocity, strict=True):
            lines.append(f'variable {axis}c equal "{c:.17g} + step*dt*{v:.17g}"')
        lines.append(f"fix F2 all indent {k:.17g} sphere v_xc v_yc v_zc {radius:.17g} units box")
    return lines


def write_data(body, path, box):
    n = len(body)
    lo, hi = box
    with open(path, "w") as f:
        f.write(f"peri\n\n{n} atoms\n{body.material_n.max()} atom types\n\n")
        for axis, a, b in zip("xyz", lo, hi, strict=True):
            f.write(f"{a:.17g} {b:.17g} {axis}lo {axis}hi\n")
        f.write("\nAtoms # peri\n\n")
        for k in range(n):
            x = body.X_nc[k]
            f.write(
                f"{k + 1} {body.material_n[k]} {body.V_n[k]:.17g} {body.rho_n[k]:.17g} {x[0]:.17g} {x[1]:.17g} "
                f"{x[2]:.17g}\n"
            )


def box_of(body, margin):
    """Simulation box: the cell along periodic axes, the nodes and a margin along open ones."""
    lo, hi = body.X_nc.min(axis=0) - margin, body.X_nc.max(axis=0) + margin
    for k in range(3):
        if body.cell.periodic[k]:
            lo[k] = body.cell.origin[k]
            hi[k] = lo[k] + body.cell.vectors[k, k]
    return lo, hi


def run_peri(body, pair, steps, *, dt, velocities=None, indent=None, skin=None, margin=None, cmdargs=()):
    """Run LAMMPS to each step in `steps`; returns a list of dicts x, v, f (force density), damage, per node in the
    body's order, pe and ke."""
    margin = 40 * body.spacing if margin is None else margin
    out = []
    with tempfile.TemporaryDirectory() as tmp, lammps_session(*cmdargs) as lmp:
        data = os.path.join(tmp, "peri.data")
        write_data(body, data, box_of(body, margin))
        for line in setup_lines(body, pair, skin=skin, dt=dt, indent=indent):
            lmp.command(line.replace("DATA", data))
        if velocities is not None:
            v = np.ascontiguousarray(np.broadcast_to(velocities, body.X_nc.shape)).ravel()
            lmp.scatter_atoms("v", 1, 3, (lmp_doubles(v)))
        lmp.command("compute CD all reduce sum c_C1")
        lmp.command("thermo_style custom step pe ke c_CD")
        # Bonds are made at the end of this. LAMMPS leaves s0 uninitialised for LPS: it is meant to be infinite.
        lmp.command("run 0 post no")
        lmp.numpy.extract_atom("s0")[:] = np.finfo(float).max
        done = 0
        for target in steps:
            lmp.command(f"run {target - done} post no pre no")
            done = target
            order = np.argsort(np.array(lmp.numpy.extract_atom("id")[: len(body)]))
            x = np.array(lmp.numpy.extract_atom("x"))[order]
            image = np.array(lmp.numpy.extract_atom("image"))[order]
            unwrapped = x + decode_images(image) * (box_of(body, margin)[1] - box_of(body, margin)[0])
            out.append(
                dict(
                    x=unwrapped,
                    v=np.array(lmp.numpy.extract_atom("v"))[order],
                    f=np.array(lmp.numpy.extract_atom("f"))[order],
                    damage=np.array(lmp.numpy.extract_compute("C1", 1, 1))[order],
                    pe=lmp.get_thermo("pe"),
                    ke=lmp.get_thermo("ke"),
                )
            )
    return out


def decode_images(image):
    """LAMMPS's packed image flags (10 bits each) as (n, 3) integers."""
    image = np.asarray(image).astype(np.int64)
    return np.stack([(image & 1023) - 512, ((image >> 10) & 1023) - 512, ((image >> 20) & 1023) - 512], axis=1)


def lmp_doubles(a):
    import ctypes

    return (ctypes.c_double * len(a))(*a)
