"""From a checked case to the objects of the engine."""

from __future__ import annotations

from functools import reduce

import numpy as np

from .. import pd
from ..config.formula import Formula
from ..errors import AtcError
from ..frame import Cell
from ..pd.regions import _Combined
from . import crystals
from . import damage as case_damage
from .bodies import read_nodes
from .materials import made, models, sampled_well

#: How far, in per cent, the volume of a lattice may be from its region's before it is said; samples are as exact.
_SAME_VOLUME = 0.5


def simulation(case, threads: int = 0, state=None):
    """The `atc.pd.Simulation` that a case describes."""
    body = make_body(case)
    _require_bonds(case, body)
    materials, names = {}, {}

    for k, m in enumerate(case.data["material"]):
        number = m.get("id", k + 1)
        names[number] = k
        try:
            if m["model"] in crystals.KEYS:
                materials[number] = crystals.made(case, k, body)
            else:
                materials[number] = made(models()[m["model"]], m, body.horizon)
        except AtcError as e:
            raise case.wrong(("material", str(k)), e) from None
    present = np.unique(body.material_n).tolist()
    for number in present:
        if number not in materials:
            why = f"the nodes have material {number}, which no [[material]] has as its id: {sorted(materials)}"
            raise AtcError(f"{case.where('material')}: {why}")
    case_damage.require_one_model(case, materials)
    materials = {n: materials[n] for n in present}
    for n, material in materials.items():
        sampled_well(case, names[n], material, body)

    stiffness = case_damage.stiffness(case, materials)
    damage = case_damage.rules(case, materials, body, stiffness)
    no_fail = [region_of(case, r) for r in case.get("damage", "no_fail", [])]
    for k, r in enumerate(no_fail):
        _require_nodes(case, body, r, ("damage", "no_fail"), f"its region number {k + 1}")

    contact = pd.Contact(**case.data["contact"]) if "contact" in case.data else None
    indenters, walls = [], []
    for path, t in case.tables_of("indenter"):
        at = history(case, (*path, "center"), t["center"])
        further = t.get("velocity"), t.get("axis"), t.get("friction", 0.0)
        indenters.append(pd.Indenter(t["radius"], t["stiffness"], at, *further))
    for path, t in case.tables_of("wall"):
        at = history(case, (*path, "point"), t["point"])
        walls.append(pd.Wall(at, t["normal"], t["stiffness"], t.get("velocity"), t.get("friction", 0.0)))
    conditions = []
    for path, t in case.tables_of("prescribed", "body_force"):
        region, X = _placed(case, body, path, t)
        given = {word: history(case, (*path, word), v, X) for word, v in t.items() if word != "region"}
        conditions.append((pd.Prescribed if path[0] == "prescribed" else pd.BodyForce)(region, **given))
    conditions += heat_conditions(case, body)
    options = {k: v for k, v in case.data["body"].items() if k in ("strain", "temperature")}
    if conducting := conduction(case, materials, names):
        options["conduction"] = conducting
    if isinstance(rise := options.get("temperature"), str):
        law = _Law([rise], body.X_nc, lambda why: case.bad(("body", "temperature"), why))
        options["temperature"] = np.broadcast_to(law(0.0)[..., 0], (len(body),))
    if state is None:
        for path, t in case.tables_of("initial"):
            region, X = _placed(case, body, path, t)
            for word, option in (("velocity", "velocities"), ("displacement", "displacements")):
                if word in t:
                    value = history(case, (*path, word), t[word], X)
                    start = options.setdefault(option, np.zeros((len(body), 3)))
                    start[body.nodes(region)] = value(0.0) if callable(value) else value
    run = case.data["run"]
    in_motion = run.get("solver", "verlet") == "verlet"
    for key in ("dt", "safety", "damping", "lammps_compat"):
        if key in run and (in_motion or key != "dt"):
            options[key] = run[key]
    try:
        sim = pd.Simulation(
            body,
            materials,
            damage=damage,
            no_fail=no_fail or None,
            contact=contact,
            indenter=indenters,
            walls=walls,
            conditions=conditions,
            interfaces=stiffness or None,
            state=state,
            threads=threads,
            **options,
        )
    except AtcError as e:
        raise AtcError(str(e) if case.name in str(e) else f"{case.name}: {e}") from None
    if not in_motion:
        # The time between two states of equilibrium, which no stability limits: loads and prescribed displacements are
        # functions of it.
        sim.dt = float(run.get("dt", 1.0))
    return sim


def conduction(case, materials, names) -> dict:
    """{material: `pd.Conduction`} of the materials that are there; empty where none conducts."""
    tables = {number: case.data["material"][names[number]] for number in materials}
    keys = ("conductivity", "specific_heat")
    if not any(key in t for t in tables.values() for key in keys):
        return {}
    for number, t in tables.items():
        for key in keys:
            if key not in t:
                why = "heat is conducted in this case, and every material needs conductivity and specific_heat"
                raise case.wrong(("material", str(names[number])), f"needs {key}: {why}")
    return {number: pd.Conduction(*(t[key] for key in keys)) for number, t in tables.items()}


def heat_conditions(case, body) -> list:
    """What [[temperature]] and [[heat_source]] say, for the engine."""

    def value(path, word, table, X):
        law = _Law([table[word]], X, lambda why: case.bad((*path, word), why))
        return lambda time: law(time)[..., 0]

    out = []
    for path, t in case.tables_of("temperature", "heat_source"):
        if not any("conductivity" in m for m in case.data["material"]):
            raise case.wrong(path, "needs a body that conducts: give [[material]] conductivity and specific_heat")
        region, X = _placed(case, body, path, t)
        if path[0] == "temperature":
            out.append(pd.FixedTemperature(region, value(path, "value", t, X), until=t.get("until", np.inf)))
        else:
            word = "density" if "density" in t else "total"
            out.append(pd.HeatSource(region, **{word: value(path, word, t, X)}))
    return out


def make_body(case):
    """The body of a case, with its notches and the material of each node."""
    b = case.data["body"]
    notches = []
    for k, t in enumerate(case.data.get("notch", [])):
        make, words = (pd.Notch.line, ("start", "end")) if "start" in t else (pd.Notch, ("origin", "a", "b"))
        try:
            notches.append(make(*(t[w] for w in words), as_damage=t.get("as_damage", False)))
        except AtcError as e:
            raise case.wrong(("notch", str(k)), e) from None
    cell = Cell(b["cell"], b.get("origin", (0.0, 0.0, 0.0)), b["periodic"]) if "cell" in b else None
    options = {k: b[k] for k in ("dimension", "plane", "thickness") if k in b}
    options |= {"notches": notches, "cell": cell, "unbonded": case_damage.unbonded(case)}
    try:
        if "region" in b:
            region = region_of(case, b["region"])
            if cell is not None and cell.periodic.any() and not b.get("cut"):
                region = region & _inside_once(cell)
            more = {k: b[k] for k in ("offset", "jitter", "seed", "cut") if k in b}
            body = pd.Body.lattice(region, b["spacing"], b["horizon"], b.get("density", 1.0), **options, **more)
        else:
            nodes = read_nodes(case.path("body", "file"), b, lambda why: case.bad(("body", "file"), why))
            case.sets = nodes.sets
            if cell is None and nodes.cell is not None:
                options["cell"] = nodes.cell
            more = {} if "spacing" not in b else {"spacing": b["spacing"]}
            body = pd.Body(
                nodes.x_nc, nodes.volume_n, nodes.density_n, b["horizon"], materials=nodes.material_n, **options, **more
            )
    except AtcError as e:
        raise AtcError(str(e) if case.name in str(e) else f"{case.where('body')}: [body] {e}") from None
    material_n, rho_n = np.array(body.material_n), np.array(body.rho_n)
    # A lattice is made of the first material where no region says otherwise; later ones go over earlier ones.
    if "region" in b:
        material_n[:] = case.data["material"][0].get("id", 1)
    for k, m in enumerate(case.data["material"]):
        number = m.get("id", k + 1)
        if "region" in m:
            inside = body.nodes(region_of(case, m["region"]))
            if not len(inside):
                raise case.bad(("material", str(k), "region"), "no node of the body lies in it")
            material_n[inside] = number
        elif "region" in b and k:
            why = "needs region, where it is: only the first of several may be everywhere else"
            raise case.wrong(("material", str(k)), why)
    for k, m in enumerate(case.data["material"]):
        rho = m["density"] if "density" in m else crystals.density(case, k)
        if rho is not None:
            rho_n[material_n == m.get("id", k + 1)] = rho
    body.material_n, body.rho_n = material_n.astype(np.int32), rho_n
    return body


def amounts(case, body) -> dict:
    """{"volume", "mass", "region_volume"}: what the nodes of a body add up to, and what its region has; this only of a
    lattice whose cells the region does not cut."""
    from ..pd.cells import volume_of

    found = {"volume": float(body.V_n.sum()), "mass": float((body.rho_n * body.V_n).sum())}
    b = case.data["body"]
    if "region" in b and not b.get("cut"):
        d = body.dimension
        size = volume_of(region_of(case, b["region"]), body.X_nc, d, body.cell)
        found["region_volume"] = size * (body.thickness if d < 3 else 1.0)
    return found


def said_amounts(found) -> str:
    """`amounts` for a person."""
    said = f"volume {found['volume']:.5g}, mass {found['mass']:.5g}"
    region = found.get("region_volume", 0.0)
    off = 100 * (found["volume"] / region - 1) if region > 0 else 0.0
    if abs(off) > _SAME_VOLUME:
        said += (
            f"; that is {abs(off):.3g} % {'more' if off > 0 else 'less'} than the {region:.5g} of the region: nodes "
            "have whole cells; [body] cut = true gives them the region's"
        )
    return said


def region_of(case, region):
    """A `pd.Region` from its name or description; None for the whole body."""
    if region is None:
        return None
    if isinstance(region, str):
        return region_of(case, case.data["regions"][region])
    if "any" in region:
        return reduce(lambda a, b: a | b, (region_of(case, r) for r in region["any"]))
    if "all" in region:
        return reduce(lambda a, b: a & b, (region_of(case, r) for r in region["all"]))
    if "not" in region:
        return ~region_of(case, region["not"])
    if region["shape"] == "set":
        sets = case.sets
        if region["name"] not in sets:
            why = f"expected a set of the mesh in [body] file; known: {', '.join(sets) or 'none'}"
            raise AtcError(f"{case.name}: there is no set {region['name']!r}: {why}")
        return pd.Nodes(sets[region["name"]])
    if region["shape"] == "box":
        return pd.Box(region["lo"], region["hi"])
    if region["shape"] == "sphere":
        return pd.Sphere(region["center"], region["radius"])
    return pd.Cylinder(region["axis"], region["center"], region["radius"], region["lo"], region["hi"])


def _inside_once(cell):
    """The points of a periodic cell, each of those on opposite faces once."""

    def contains(x):
        s = cell.fractional(x)
        return np.where(cell.periodic, (s > -1e-9) & (s < 1 - 1e-9), True).all(axis=1)

    return _Combined(contains, np.full(3, -np.inf), np.full(3, np.inf))


def history(case, path, value, X_nc=None):
    """What the engine takes for three components or a table of them: "free" is None, and formulas are functions of time
    at the nodes X_nc."""
    number = lambda c: np.nan if c == "free" else c  # noqa: E731
    if isinstance(value, dict):
        return np.array(value["times"], float), np.array([[number(c) for c in row] for row in value["values"]], float)
    if not isinstance(value, list):
        return value
    if any(isinstance(c, dict) or (isinstance(c, str) and c != "free") for c in value):
        return _Law(value, X_nc, lambda why: case.bad(path, why))
    return [None if c == "free" else c for c in value]


class _Law:
    """t → (3,) or (m, 3): numbers, tables of time, and formulas of t and the nodes' reference positions."""

    def __init__(self, components, X_nc, complain):

        self.place = {} if X_nc is None else dict(zip("xyz", X_nc.T, strict=True))
        self.complain = complain
        self.parts = []
        for c in components:
            if isinstance(c, dict):
                self.parts.append((np.array(c["times"], float), np.array(c["values"], float)))
            elif isinstance(c, str) and c != "free":
                formula = Formula(c, ("t", *self.place))
                # What stands still is computed once.
                self.parts.append(formula if "t" in formula.uses else formula.finite(complain, t=0.0, **self.place))
            else:
                self.parts.append(np.nan if c == "free" else float(c))

    def __call__(self, t):
        def at(p):
            if callable(p):
                return p.finite(self.complain, t=t, **self.place)
            return np.interp(t, *p) if isinstance(p, tuple) else p

        values = [at(p) for p in self.parts]
        return np.stack(np.broadcast_arrays(*values), axis=-1)


def _placed(case, body, path, table):
    """The region of a table, and (m, 3) where its nodes are."""
    region = region_of(case, table.get("region"))
    _require_nodes(case, body, region, (*path, "region"))
    return region, body.X_nc[body.nodes(region)]


def _require_nodes(case, body, region, path, what="it"):
    if region is not None and not len(body.nodes(region)):
        raise case.bad(path, f"no node of the body lies in {what}")


def _require_bonds(case, body):
    """Something must hold the body together (or push it apart), and every notch cut something."""
    if not len(body.bonds) and "contact" not in case.data:
        why = f"no node has another one within {body.horizon:g}, so that nothing holds the body together"
        raise case.bad(("body", "horizon"), f"{why}: take about three spacings (of {body.spacing:g})")
    for k, cut in enumerate(body.cuts):
        if not cut and len(body.bonds):
            raise case.wrong(("notch", str(k)), "crosses no bond of the body: check its place and its length")
