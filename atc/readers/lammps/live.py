"""The state of a running LAMMPS (the object of its Python library) as a Frame."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Cell, Frame, Topology
from ...units import units as unit_system

_TERMS = (("bonds", 2), ("angles", 3), ("dihedrals", 4), ("impropers", 4))


class LammpsState:
    """Reads frames from a serial ``lammps.lammps`` object: what ``dump custom`` would write at that moment, at full
    precision.

    Bonded terms are read once: they must not change while it runs.
    """

    def __init__(self, lmp):
        if lmp.extract_setting("world_size") > 1:
            raise AtcError(
                f"LAMMPS runs on {lmp.extract_setting('world_size')} MPI processes, each of which has its own atoms "
                "only: run it on one (with threads), or write a dump"
            )
        if not lmp.extract_setting("box_exist"):
            raise AtcError("LAMMPS has no box yet: give it the commands that make its atoms first")
        self.lmp = lmp
        self.units = unit_system(lmp.extract_global("units"))
        self._topology, self._known = None, False

    def frame(self, kick: bool = False) -> Frame:
        """The atoms now.

        kick : velocities are half a step behind, as they are while forces are computed: complete them by the second
            half of velocity Verlet, v + Δt f/2m
        """
        lmp, u, n = self.lmp, self.units, self.lmp.extract_setting("nlocal")
        lo, hi, xy, yz, xz, periodic, _ = lmp.extract_box()
        length = u.factor("length")
        atom = lambda name: lmp.numpy.extract_atom(name)  # noqa: E731
        ids = np.array(atom("id")[:n], np.int64)
        order = np.argsort(ids, kind="stable")
        per_atom = lambda name, kind=float: np.array(atom(name)[:n], kind)[order]  # noqa: E731
        types = per_atom("type", np.int64)
        masses = per_atom("rmass") if lmp.extract_setting("rmass_flag") else np.array(atom("mass"), float)[types]
        masses = masses * u.factor("mass")
        x, v, f = (per_atom(name) for name in ("x", "v", "f"))
        v, f = v * u.factor("velocity"), f * u.factor("force")
        dt = float(lmp.extract_global("dt")) * u.factor("time")
        if kick:
            v = v + 0.5 * dt * f / masses[:, None]
        step = int(lmp.extract_global("ntimestep"))
        elapsed = (step - int(lmp.extract_global("atimestep"))) * dt
        frame = Frame(
            positions=x * length,
            cell=Cell.from_lammps(np.array(lo) * length, np.array(hi) * length, np.array((xy, xz, yz)) * length,
                                  np.array(periodic, bool)),
            units=u, types=types, ids=ids[order], masses=masses, velocities=v, forces=f,
            charges=per_atom("q") * u.factor("charge") if lmp.extract_setting("q_flag") else None,
            molecules=per_atom("molecule", np.int64) if lmp.extract_setting("molecule_flag") else None,
            step=step, time=float(lmp.extract_global("atime")) * u.factor("time") + elapsed,
            topology=self._terms(ids[order]), source=f"LAMMPS step {step}",
        )  # fmt: skip
        if lmp.extract_setting("dimension") == 2:
            from ...planar import planar

            return planar(frame)
        return frame

    def _terms(self, ids):
        if self._known:
            return self._topology
        self._known = True
        if not self.lmp.extract_setting("molecule_flag"):
            return None
        out = {}
        for name, width in _TERMS:
            rows = np.array(getattr(self.lmp.numpy, f"gather_{name}")(), np.int64).reshape(-1, width + 1)
            if len(rows):
                out[name] = np.searchsorted(ids, rows[:, 1:])
                out[f"{name[:-1]}_types"] = rows[:, 0].copy()
        self._topology = Topology(**out) if out else None
        return self._topology
