"""What the keys of a scene must say together."""

from __future__ import annotations

from .potentials import LEARNED, RUN, SYSTEMS
from .schema import GRIDS, SCHEMA
from .words import unknown


def check(scene) -> None:
    """Raise for what is no value of its key, and for keys that do not go together."""
    for section, table in scene.data.items():
        scene.check_table((section,), table, SCHEMA[section])
    unneeded = "dispersion" in scene.data and "trajectory" not in scene.data
    if "file" not in scene.data.get("trajectory", {}) and not unneeded:
        raise scene.need("trajectory", 'it needs file, the trajectory to read, e.g. file = "run.dump"')
    _check_grid(scene)
    _check_potential(scene)
    _check_trajectory(scene)
    scene.selection()
    from ..estimators.columns import split
    from ..estimators.registry import QUANTITIES

    for q in scene.get("fields", "quantities", []):
        if q.startswith("column:"):
            with scene.value_of("fields", "quantities"):
                split(q)
        elif q not in QUANTITIES:
            raise scene.bad(("fields", "quantities"), unknown(repr(q), q, QUANTITIES))
    _check_kernel(scene)


def _check_kernel(scene):
    if "kernel" not in scene.data:
        return
    from ..kernels import known

    name = scene.get("kernel", "name")
    if name is None:
        raise scene.need("kernel", f"[kernel] needs name, one of {', '.join(known())}")
    if name not in known():
        raise scene.bad(("kernel", "name"), unknown(repr(name), name, known()))
    if not isinstance(scene.get("kernel", "table"), str):  # a table in a file is looked at when it is used
        scene.kernel()


def _check_trajectory(scene):
    from ..readers.declared import cell_of, periodic_of

    for key, check in (("cell", lambda v: cell_of(v, 1.0)), ("pbc", periodic_of)):
        if scene.get("trajectory", key) is not None:
            with scene.value_of("trajectory", key):
                check(scene.get("trajectory", key))


def _check_potential(scene):
    if "potential" not in scene.data:
        return
    table = scene.data["potential"]
    given = [k for k in ("lammps", "input", *LEARNED, *SYSTEMS) if k in table]
    if not given:
        raise scene.need(
            "potential",
            '[potential] needs lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file" (a LAMMPS input '
            'script) or a learned model: nep = "nep.txt", mace = "my.model", nequip = "my.nequip.zip", or a system '
            'of another code: openmm = "system.xml", prmtop = "x.prmtop", psf = "x.psf", top = "topol.top"',
        )
    if len(given) > 1:
        many = "both" if len(given) == 2 else "all"
        raise scene.bad(("potential", given[1]), f"give {' or '.join(given)}, not {many}")
    makers = LEARNED | SYSTEMS
    for key in {k: None for keys in makers.values() for k in keys}:
        if key in table and key not in makers.get(given[0], ()):
            why = ": LAMMPS lines name their elements themselves" if key == "types" else ""
            if key in RUN and given[0] == "openmm":
                why = ": a System of OpenMM says it itself"
            of = [k for k, keys in makers.items() if key in keys]
            raise scene.bad(("potential", key), f"goes with {', '.join(of)}{why}")
    if "units" in table and given[0] in LEARNED:
        raise scene.bad(("potential", "units"), "leave it out: learned models and those of KIM are in eV and Å")
    if "units" in table and given[0] in SYSTEMS:
        raise scene.bad(("potential", "units"), "leave it out: the files of other codes say their units")
    if "run" in scene.data["potential"] and given != ["input"]:
        raise scene.bad(("potential", "run"), "goes with input, the script whose run it is")


def _check_grid(scene):
    if "grid" not in scene.data:
        return
    table = scene.data["grid"]
    kind = table.get("kind")
    if kind is None:
        raise scene.need("grid", f"[grid] needs kind, one of {', '.join(GRIDS)}")
    needs, may = GRIDS[kind]
    allowed = ["kind", *may]
    for need in needs:
        options = need if isinstance(need, tuple) else (need,)
        allowed += options
        given = [k for k in options if k in table]
        if not given:
            examples = " or ".join(f"{k} ({SCHEMA['grid'][k].expected})" for k in options)
            raise scene.need("grid", f"a {kind} grid needs {examples}")
        if len(given) > 1:
            raise scene.bad(("grid", given[1]), f"give {' or '.join(options)}, not both")
    for key in table:
        if key not in allowed:
            raise scene.bad(("grid", key), f"does not belong to a {kind} grid; its keys: {', '.join(allowed)}")
    if not isinstance(table.get("points"), str):  # points in a file are looked at when they are used
        scene.grid()


def require_complete(scene):
    """What the quantities asked for need must be there."""
    from ..estimators.work import Work

    quantities = scene.get("fields", "quantities")
    if quantities is None:
        raise scene.need("fields", 'it needs quantities, what to compute, e.g. quantities = ["stress", "density"]')
    work = Work.of(quantities, kernel=scene.get("grid", "kind") != "planes")
    if work.bond_users and "potential" not in scene.data:
        raise scene.need(
            "potential",
            f'{work.bond_users[0]} needs one: lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file"',
        )
    if work.kernel_users and "kernel" not in scene.data and not scene.get("grid", "means"):
        raise scene.need("kernel", f'{work.kernel_users[0]} needs one, e.g. name = "quartic" and radius = 8.0')
    if work.grid_users and "grid" not in scene.data:
        raise scene.need("grid", f'{work.grid_users[0]} needs one, e.g. kind = "regular" and spacing = 2.0')
    if work.reference_users and scene.get("trajectory", "reference") is None:
        raise scene.need(
            "trajectory",
            f"{work.reference_users[0]} needs reference, the index of the reference frame or the file that holds "
            "it, e.g. reference = 0",
        )
