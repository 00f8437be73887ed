"""A case from its first step to its last: output entry by entry, restarts that are bitwise the uninterrupted run,
ParaView's files on the way.

While a run goes on, ``OUT.partial`` holds the finished entries and ``restart.npz``, the state of the last entry or of a
moment since. The order is: state, then entry. A run that was killed between the two finds a state whose entry is
missing, and writes the entry from the state.
"""

from __future__ import annotations

import hashlib
import time
import zipfile
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..export.export import export_dataset
from ..export.vtk import write_nodes, write_series
from ..pd.state import State
from ..pd.statics import relax, solve_static
from ..planning.identity import RESULTS
from ..running.interruption import asked, whole
from ..running.opening import open_dataset
from ..running.output import Layout, Variable, explained
from ..running.store import Store
from ..running.whole import renamed
from ..units import units
from .fields import CaseFields
from .schema import TABLES

# Wall seconds between two saved states, beside those of the entries.
_SAVE_EVERY = 60.0

_ALONG = "positive along +x, +y, +z"
_DAMAGE = "share of the family, by volume, whose bonds are broken"
_INDICES = "component [i, j]: i the face normal, j the force component"
# name: (rank, dimension of its unit, long name, sign)
QUANTITIES = {
    "displacement": (1, "length", "displacement", _ALONG),
    "velocity": (1, "velocity", "velocity", _ALONG),
    "damage": (0, "dimensionless", f"damage: {_DAMAGE}", "0 whole, 1 without bonds"),
    "energy": (0, "energy", "strain energy of the node", "positive"),
    "force": (1, "force", "total force on the node: bonds, contact, indenters, walls, body forces", _ALONG),
    "temperature": (0, "temperature", "how far the temperature of the node has risen", "positive where hotter"),
    "stress": (2, "pressure", "peridynamic stress, nodal virial", f"tension positive; {_INDICES}"),
}
DEFAULT = ("displacement", "velocity", "damage", "energy", "force")
LEDGER = {
    "kinetic": "kinetic energy",
    "strain": "strain energy of the intact bonds",
    "contact": "energy in contacts",
    "indenter": "energy stored in the penetration of indenters and walls",
    "work_external": "work done by indenters, walls and body forces",
    "work_constraint": "work done by prescribed motions",
    "dissipated_fracture": "energy gone with broken bonds",
    "dissipated_damping": "energy gone by damping",
    "dissipated_material": "energy gone in materials that relax",
    "dissipated_friction": "energy gone where contacts slide",
    "total": "kinetic + strain + contact - work + dissipated: constant but for the integrator's error",
}


def run(case, out, *, threads: int = 0, progress=None, resume: bool = True):
    """Run a case into a file.

    Parameters
    ----------
    case : Case
    out : path ending in .zarr or .nc
        Written entry by entry to ``out.partial`` and renamed at the end. After a kill or Ctrl-C the same call goes on
        where it was, with bitwise the same result as an uninterrupted run. `resume=False` begins again.
    threads : 0 is all cores; the result does not depend on it
    progress : callable(done, total, rate), steps and steps per second

    Returns
    -------
    xarray.Dataset with dims frame, node, i, j: displacement, velocity, damage, energy, force at the nodes, and the
    energy ledger. What [fields] asks for is in a second output beside it, ``OUT-fields``.
    """
    case.check_places()
    request = _request(case)
    store = Store(out, request, resume)
    fields = None
    try:
        if "fields" in case.data:
            fields = CaseFields(case, out, request, resume, threads)
        if store.published and (fields is None or fields.store.published):
            if progress is not None:
                progress(case.data["run"]["steps"], case.data["run"]["steps"], 0.0)
            return _close(case, out, store, fields)
        if store.published:
            raise AtcError(
                f"{fields.path}: is not what the run before has left, though {out} is: begin again with --restart"
            )
        runner = _Run(case, store, fields)
        saved = runner.load()
        if saved is not None:
            state = State.from_arrays(saved)
        elif case.path("run", "restart") is not None:
            state = load_state(case.path("run", "restart"))
        else:
            state = None
        sim = case.simulation(threads, state)
        runner.go(sim, progress, sim.state.step if saved is None else int(saved["run.start"]))
        ds_attrs = {"": {"n_broken": int(sim.n_broken), "sources": Path(case.name).name}}
        restart = case.path("output", "restart")
        if restart is not None:
            with explained(restart, store.partial):
                save_arrays(restart, sim.state.to_arrays())
        # Both outputs stand under their names, and whatever goes with them is written, before anything of the
        # unfinished run is cleared away.
        if fields is not None:
            fields.publish()
        store.publish(ds_attrs)
        return _close(case, out, store, fields)
    finally:
        store.close()
        if fields is not None:
            fields.store.close()


def _close(case, out, store, fields):
    """The end of a run whose outputs stand under their names."""
    with explained(out):
        ds = open_dataset(out)
    if case.path("output", "extxyz") is not None:
        export_dataset(ds, case.path("output", "extxyz"))
    store.clear_away()
    if fields is not None:
        fields.store.clear_away()
    return ds


def _request(case) -> dict:
    """What an unfinished output must have been made from to be continued."""
    request = {"results": RESULTS, "case": case.to_toml()}
    # Files that are read count by what is in them.
    for section, key in (
        (s, k) for s, keys in TABLES.items() for k, spec in keys.items() if spec.path and s != "output"
    ):
        path = case.path(section, key) if isinstance(case.get(section, key), str) else None
        if path is not None and path.is_file():
            request[f"{section}.{key}"] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    for word in " ".join(m["potential"] for m in case.data["material"] if "potential" in m).split():
        path = case.folder / word
        if path.is_file():
            request[f"potential.{word}"] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return request


def save_arrays(path, arrays: dict) -> None:
    """An .npz written beside its name and renamed."""
    with renamed(Path(path)) as part, open(part, "wb") as f:
        np.savez(f, **arrays)


def load_state(path):
    """A `pd.State` from a restart file."""
    return State.from_arrays(_arrays(path, "{}: is not a restart file of atc pd ({})"))


def _arrays(path, complaint: str) -> dict:
    """What `save_arrays` wrote."""
    try:
        with np.load(path) as f:
            return {k: f[k] for k in f.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as e:
        raise AtcError(complaint.format(path, type(e).__name__)) from None


class _Run:
    def __init__(self, case, store, fields=None):
        self.case, self.store, self.fields = case, store, fields
        self.steps = case.data["run"]["steps"]
        self.every = min(case.get("output", "every", max(1, self.steps // 20)), self.steps)
        warm = ("temperature",) if any("conductivity" in m for m in case.data["material"]) else ()
        self.names = tuple(case.get("output", "quantities", DEFAULT + warm))
        self.file = store.partial / "restart.npz"
        self.vtk = case.path("output", "vtk")

    def load(self):
        """The arrays of the saved state of an interrupted run, or None."""
        why = "{}: the state of the interrupted run cannot be read ({}): begin again with --restart"
        return _arrays(self.file, why) if self.file.exists() else None

    def go(self, sim, progress, start):
        end = start + self.steps
        self.start = start
        self.marks = [*range(start, end, self.every), end]
        self.store.begin(self._layout(sim))
        if self.fields is not None:
            self.fields.prepare(sim, len(self.marks), self.store.done)
        if progress is not None:
            progress(sim.state.step - start, self.steps, 0.0)
        # A signal to stop is heard between steps, so that the state can be saved.
        with whole():
            self._loop(sim, progress, start, end)

    def _loop(self, sim, progress, start, end):
        began, first, saved = time.perf_counter(), sim.state.step, time.monotonic()
        while True:
            step = sim.state.step
            if self.store.done < len(self.marks) and step == self.marks[self.store.done]:
                self._save(sim)
                self._entry(sim)
                saved = time.monotonic()
            if step >= end:
                return
            # A few steps at a time, so that the progress moves and Ctrl-C is heard between steps.
            target = self.marks[self.store.done]
            chunk = min(target - step, self._chunk(began, step - first))
            self._step(sim, chunk)
            if progress is not None:
                rate = (sim.state.step - first) / max(time.perf_counter() - began, 1e-9)
                progress(sim.state.step - start, self.steps, rate)
            if asked() or time.monotonic() - saved > _SAVE_EVERY:
                self._save(sim)
                saved = time.monotonic()
            if asked():
                return

    def _advance(self, sim, n):
        """n steps in time, or n states of equilibrium."""
        run = self.case.data["run"]
        solver = run.get("solver", "verlet")
        if solver == "verlet":
            sim.step(n)
            return
        solve = relax if solver == "relax" else solve_static
        most = "max_steps" if solver == "relax" else "max_iterations"
        given = {name: run[key] for key, name in (("tolerance", "tolerance"), ("iterations", most)) if key in run}
        for _ in range(n):
            solve(sim, time=sim.state.time + sim.dt, **given)

    def _step(self, sim, n):
        """Some steps; a run that has blown up says so, whoever stumbles over it."""
        try:
            self._advance(sim, n)
            finite = np.isfinite(sim.state.v_nc).all()
        except (ValueError, OverflowError, MemoryError, AtcError):
            extent = float(np.ptp(sim.body.X_nc, axis=0).max()) + sim.body.horizon
            finite = bool((np.abs(sim.state.u_nc) < 1e4 * extent).all())
            if finite:
                raise
        if not finite:
            raise AtcError(
                f"the run has blown up at step {sim.state.step}: take a smaller time step than {sim.dt:.3g} (the "
                f"stable one is {sim.time_step_stable:.3g}), "
                "or softer indenters and walls"
            )

    @staticmethod
    def _chunk(began, done) -> int:
        """About a fifth of a second of steps."""
        elapsed = time.perf_counter() - began
        return 1 if done < 3 or elapsed <= 0 else max(1, int(0.2 * done / elapsed))

    def _save(self, sim):
        with explained(self.store.out, self.store.partial):
            save_arrays(self.file, {**sim.state.to_arrays(), "run.start": np.array(self.start)})

    def _entry(self, sim):
        values = node_values(sim, self.names)
        e = sim.energies()
        values.update({f"energy_{k}": np.array(getattr(e, k)) for k in LEDGER})
        values.update(step=np.array(sim.state.step), time=np.array(sim.state.time), n_broken=np.array(sim.n_broken))
        if self.vtk is not None:
            self._write_vtk(sim, values)
        if self.fields is not None:
            self.fields.add(sim, self.store.done)
        self.store.write(values, {"step": int(sim.state.step), "time": float(sim.state.time)})

    def _write_vtk(self, sim, values):

        with explained(self.vtk, self.store.partial):
            self.vtk.mkdir(parents=True, exist_ok=True)
            files = [self.vtk / f"{self.vtk.name}_{k:05d}.vtu" for k in range(self.store.done + 1)]
            arrays = {name: values[name] for name in self.names}
            arrays["material"] = sim.body.material_n
            arrays["volume"] = sim.body.V_n
            about = {"TIME": float(sim.state.time), "STEP": int(sim.state.step)}
            write_nodes(files[-1], sim.positions_nc, arrays, about, self.units())
            times = [n["time"] for n in self.store.journal] + [float(sim.state.time)]
            write_series(self.vtk / f"{self.vtk.name}.pvd", files, times)

    def units(self) -> dict:
        """{quantity: unit} of what is known at the nodes."""
        label = units("si").label
        return {**{q: label(QUANTITIES[q][1]) for q in self.names}, "volume": label("volume"), "material": "1"}

    def _layout(self, sim) -> Layout:
        from .. import __version__
        from .build import amounts

        u = units("si")
        body = sim.body
        letters = np.array(["x", "y", "z"])
        out: list[Variable] = []

        def static(name, dims, values, **attrs):
            values = np.asarray(values)
            out.append(Variable(name, dims, values.shape, values.dtype, attrs, static=values, coordinate=True))

        def of_node(name, values, units, long_name):
            static(name, ("node",), values, units=units, long_name=long_name)

        def moving(name, dims, shape, dtype=np.float64, coordinate=False, **attrs):
            out.append(Variable(name, dims, shape, np.dtype(dtype), attrs, coordinate=coordinate))

        n = len(body)
        static("frame", ("frame",), np.arange(len(self.marks)), long_name="number of the output")
        moving("step", (), (), np.int64, True, long_name="time step")
        moving("time", (), (), coordinate=True, units=u.label("time"), long_name="time")
        static("node", ("node",), np.arange(n), long_name="number of the node")
        static("i", ("i",), letters, long_name="direction of a vector; first index of a tensor")
        if any(QUANTITIES[q][0] == 2 for q in self.names):
            static("j", ("j",), letters, long_name="second index of a tensor")
        for k, a in enumerate("xyz"):
            of_node(f"position_{a}", body.X_nc[:, k], u.label("length"), f"{a} of the node in the undeformed body")
        of_node("volume", body.V_n, u.label("volume"), "volume of the node")
        of_node("density", body.rho_n, u.label("density"), "mass density of the undeformed body")
        of_node("material", body.material_n, "1", "material of the node")
        for q in self.names:
            rank, dimension, long_name, sign = QUANTITIES[q]
            dims = ("node", *("i", "j")[:rank])
            moving(q, dims, (n, *(3,) * rank), units=u.label(dimension), long_name=long_name, sign_convention=sign)
        for k, long_name in LEDGER.items():
            sign = "since the start of the run" if "_" in k else "positive"
            moving(f"energy_{k}", (), (), units=u.label("energy"), long_name=long_name, sign_convention=sign)
        count = {"units": "1", "long_name": "number of broken bonds", "sign_convention": "each bond once"}
        moving("n_broken", (), (), np.int64, **count)
        attrs = {
            "atc_version": __version__,
            "version": __version__,
            "kind": "peridynamics",
            "units": "si",
            "units_note": "numbers are those of the case, in whichever consistent units it is written; labels are "
            "those of SI",
            "horizon": body.horizon,
            "spacing": body.spacing,
            "dimension": body.dimension,
            "time_step": sim.dt,
            "stable_time_step": sim.time_step_stable,
            "materials": ", ".join(sorted({m.name for m in sim.materials.values()})),
            "bonds": len(body.bonds),
            **amounts(self.case, body),
            "quantities": ", ".join(self.names),
            "periodic": "".join("p" if p else "f" for p in body.cell.periodic),
            "case": self.case.to_toml(),
        }
        return Layout(out, len(self.marks), attrs)


def node_values(sim, names) -> dict[str, np.ndarray]:
    """The quantities `names` at the nodes, now."""
    makers = {
        "displacement": lambda: np.array(sim.state.u_nc),
        "velocity": lambda: np.array(sim.state.v_nc),
        "damage": sim.damage,
        "energy": sim.strain_energy_n,
        "temperature": lambda: np.array(sim.temperature_n),
        "force": lambda: np.array(sim.forces()),
        "stress": lambda: nodal_stress(sim),
    }
    return {name: makers[name]() for name in names}


def nodal_stress(sim) -> np.ndarray:
    """(n, 3, 3) ½ Σ_J (x_J − x_I)⊗F_IJ / V_I with current positions: the partial stress of each node (tension positive,
    [divergence, force])."""
    from ..estimators._numba import scatter_moment

    out = np.zeros((len(sim.body), 9))
    for f in sim.bond_force_parts():
        scatter_moment(f.i, f.j, f.r_bc, f.F_bc, out)
    return out.reshape(-1, 3, 3) / sim.body.V_n[:, None, None]
