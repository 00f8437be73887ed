"""The rooms stand on floors: a room imports from floors below its own and from nowhere else, inside functions too; no
two files import each other in a circle; and what has a public name says what it is."""

import ast
import graphlib
import importlib
from pathlib import Path

import pytest

import atc

ROOT = Path(atc.__file__).parent

#: From the ground up. A name is a room, or one file where that stands on another floor than its room.
FLOORS = [
    {"errors", "terminal"},
    {"contracts", "units", "compiled", "running.sealed"},
    {"frame", "simd"},
    {"bonds", "grids", "planar"},
    {"kernels", "neighbors", "config.words"},
    {"config.toml", "config.formula"},
    {"readers", "deposit"},
    # Of the decomposers first what several kinds of potentials need, then these, then what reads whole models.
    {"decomposers.images", "decomposers.atom_columns", "decomposers.autodiff", "decomposers.long_range.split"}
    | {"decomposers.numbering", "decomposers.bond_sums"}
    | {"decomposers.bonded.unsupported", "decomposers.many_body.neighborhood", "decomposers.many_body.parameter_file"},
    {"decomposers.constraints", "decomposers.recording", "decomposers.pairs.unsupported", "decomposers.table_file"}
    | {"decomposers.many_body.stillinger_weber_kernels"},
    {"decomposers.base", "decomposers.outside"},
    {"decomposers.potentials", "decomposers.registry", "decomposers.many_body.neighbor_work"},
    {"decomposers.bonded.cluster"},
    {"decomposers.bonded.topology", "decomposers.many_body.elements"},
    {"decomposers.pairs", "decomposers.many_body"},
    {"decomposers.lepton", "decomposers.long_range", "decomposers.learned"},
    {"decomposers.bonded", "decomposers.pairs.lj_long"},
    {"decomposers.pairs.one_four", "decomposers.pairs.coulomb_long"},
    {"decomposers.pairs.tip4p", "decomposers.long_range.kspace"},
    {"decomposers.lammps", "decomposers.openmm"},
    {"decomposers"},
    {"estimators", "pd"},
    {"agreement"},
    {"planning"},
    {"running"},
    {"pictures"},
    {"export", "advection", "upscaling"},
    {"config"},
    {"cases"},
    {"agreement.verify", "analysis", "twins"},
    {"cli"},
]
#: Files of the room "planning" that lie outside it: its public door.
PLANNING = {"plan"}


def modules():
    out = {}
    for path in sorted(ROOT.rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        out[name.removesuffix(".__init__")] = path
    return out


MODULES = modules()


def room(name):
    """(floor, room) of a module, by the longest name on the floors."""
    parts = name.split(".")
    if parts[0] in PLANNING:
        parts[0] = "planning"
    for k in range(len(parts), 0, -1):
        here = ".".join(parts[:k])
        for floor, names in enumerate(FLOORS):
            if here in names:
                return floor, here
    return None


def imports(name, path):
    """[(module, line)] of everything of this package that a file imports, but for annotations only."""
    tree = ast.parse(path.read_text())
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for_types = {
        id(inner)
        for n in ast.walk(tree)
        if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test)
        for inner in ast.walk(n)
    }
    out = []
    for n in ast.walk(tree):
        if id(n) in for_types:
            continue
        if isinstance(n, ast.Import):
            out += [(a.name[4:], n.lineno) for a in n.names if a.name.startswith("atc.")]
        elif isinstance(n, ast.ImportFrom):
            base = (n.module or "").split(".") if n.module else []
            if n.level:
                base = package[: len(package) - n.level + 1] + base
            elif base[:1] == ["atc"]:
                base = base[1:]
            else:
                continue
            for a in n.names:
                inner = ".".join([*base, a.name])
                found = inner if inner in MODULES else ".".join(base)
                if found and found != name:  # the package itself: its version, and public calls
                    out.append((found, n.lineno))
    return out


IMPORTS = {name: imports(name, path) for name, path in MODULES.items()}


def test_every_file_stands_on_a_floor():
    assert [m for m in MODULES if m not in ("__init__", "__main__") and room(m) is None] == []


def test_imports_go_down():
    up = []
    for name, found in IMPORTS.items():
        if name in ("__init__", "__main__"):
            continue
        floor, here = room(name)
        for other, line in found:
            there = room(other)
            if there[1] != here and there[0] >= floor:
                up.append(f"{name}:{line} imports {other}, which is not below it")
    assert up == []


def test_what_is_imported_is_there():
    """Inside functions too, where nobody would notice until they are called."""
    missing = []
    for name, path in MODULES.items():
        package = "atc." + name if path.name == "__init__.py" else "atc." + name.rpartition(".")[0]
        for n in ast.walk(ast.parse(path.read_text())):
            if isinstance(n, ast.ImportFrom) and n.level:
                module = importlib.import_module("." * n.level + (n.module or ""), package.strip("."))
                missing += [
                    f"{name}:{n.lineno} {a.name}"
                    for a in n.names
                    if not hasattr(module, a.name) and f"{module.__name__}.{a.name}"[4:] not in MODULES
                ]
    assert missing == []


def test_no_circles():
    """File by file, imports inside functions counted. A room's own `__init__` is its door, not one of its files."""
    graph = {name: {other for other, _ in found} for name, found in IMPORTS.items()}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as e:
        pytest.fail(" -> ".join(reversed(e.args[1])))


def test_the_ground_is_small():
    """At most a dozen files lie in the package's own folder."""
    flat = [m for m in MODULES if "." not in m and MODULES[m].name not in ("__init__.py", "__main__.py")]
    assert len(flat) <= 12, flat


def undocumented(path):
    tree = ast.parse(path.read_text())
    if ast.get_docstring(tree) is None and path.stat().st_size:
        yield "the file"
    for n in tree.body:
        if isinstance(n, ast.ClassDef | ast.FunctionDef) and not n.name.startswith("_"):
            # What is registered for a name of its own has that for a title.
            if ast.get_docstring(n) is None and not n.decorator_list:
                yield n.name


def test_public_names_have_docstrings():
    found = [f"{name}: {what}" for name, path in MODULES.items() for what in undocumented(path)]
    assert found == []
