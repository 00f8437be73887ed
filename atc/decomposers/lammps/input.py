"""A model from LAMMPS lines or a LAMMPS input script: styles and coefficients become the terms of a `Potential`."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from ...errors import AtcError
from ...units import Units
from ..outside import OutsideForces
from ..potentials import Potential
from ..registry import (
    TypeRange,
)
from .assemble import assemble
from .constraint_fixes import constraints_of, groups_of, needs_molecules
from .interpreter import Interpreter
from .model import BONDED, Model, Style, gather, type_range
from .outside_fixes import acting, outside_of
from .runs import check_spins_push, choose_run, sort_fixes
from .script import Command, is_text, one_line, read_text, short
from .setup import Setup
from .state import State

__all__ = ["potential_from_lammps"]


def potential_from_lammps(
    source: str | Path, units_=None, folder=None, name=None, run=None, trajectory=()
) -> Potential:
    """The `Potential` of LAMMPS lines, or of the LAMMPS input script at a path. See `atc.potential`.

    trajectory : paths of the frames that are to be computed: where the model changes from run to run, the script's
        ``dump`` lines may say which run it is
    """
    with one_line():
        return _potential(source, units_, folder, name, run, trajectory)


def _potential(source, units_, folder, name, run, trajectory) -> Potential:
    script = isinstance(source, Path) or not is_text(source)
    if script:
        if not str(source).strip():
            raise AtcError(
                "the potential is empty: expected LAMMPS lines such as pair_style and pair_coeff, or the name of an "
                "input script"
            )
        path = Path(source).expanduser()
        if not os.path.exists(path):
            raise AtcError(
                f"{source}: no such file, nor LAMMPS lines (which start with a command such as pair_style or units)"
            )
        text, name, folder = read_text(path), str(source), path.parent
    else:
        path = None
        text, name, folder = source, name or "potential", Path.cwd() if folder is None else Path(folder)
    script_run = Interpreter(folder, script, path)
    script_run.execute(text, name)
    choice = choose_run(script_run, run, name, trajectory)
    model = gather(choice.state, name, folder, units_, script)
    if "pair" not in model.styles:
        sort_fixes(choice, folder)  # a fix may be why there is no pair style
    if script and "pair" not in model.styles and model.restart is None and not any(k in model.styles for k in BONDED):
        _check_free(model, script_run, choice.state, name)
    pot = assemble(model, name)
    pot.outside, changing = sort_fixes(choice, folder)
    if script and any(s.magnetic for t in pot.terms for s in t.styles):
        check_spins_push(choice, name)
    # LAMMPS's default is 3, so a whole script says it in any case.
    pot.dimension, pot.dimension_said = model.dimension or 3, model.dimension is not None or script
    pot.atom_style = " ".join(model.atom_style)
    named = model.exclusions.groups if model.exclusions else ()
    from_outside = acting(choice.fixes)
    pot.moved = tuple(dict.fromkeys(c.words[1] for c in choice.fixes if c.words[2] == "move" and not c.unknown))
    needed = {*named, *groups_of(choice.fixes)}
    if_known = dict.fromkeys(c.words[1] for c in from_outside if c.words[1] != "all" and c.words[1] not in needed)
    groups = (*named, *(g for g in dict.fromkeys((*groups_of(choice.fixes), *if_known)) if g not in named))
    if script or from_outside:
        lattice = any(c.name == "lattice" for c in choice.state.atoms)
        pot.acting = outside_of(choice.fixes, groups, model.units, lattice)
        if not choice.steady:
            pot.acting = OutsideForces(
                (), tuple(f"fix {c.words[2]} ({short(c.where)}), not in all of the runs" for c in from_outside)
            )
    if choice.minimizes and (c := next((c for c in choice.state.held if c.words[2] in ("shake", "rattle")), None)):
        raise c.error(
            f"fix {c.words[2]} holds bonds by springs of its own while LAMMPS minimizes, which are not "
            "supported: name another run"
        )
    timestep = _timestep(choice.timestep, model.units)
    pot.constraints = constraints_of(choice.fixes, groups, partial(type_range, model), model.units.mass, timestep)
    if script and not any(c.words[2:3] == ("dt/reset",) for c in choice.fixes):
        pot.timestep = timestep
    if script and not any(c.name == "units" for c in choice.state.model) and units_ is None:
        pot.remarks = (*pot.remarks, f"{Path(name).name} has no units line: lj, as in LAMMPS")
    pot.remarks = (*pot.remarks, *(f"forces from outside are no part of the stress: {o}" for o in pot.outside))
    concerned = [c for c in choice.state.atoms if c.name not in ("mass", "labelmap", "run")]
    heavy = _masses_of_files(model, pot.terms)
    if script or concerned or changing or groups or heavy:
        pot.setup = Setup(
            name,
            folder,
            model.units.name,
            pot.dimension,
            _atom_style(model),
            (*choice.state.atoms, *heavy),
            choice.later,
            changing,
            tuple(script_run.written_data),
            _needs(pot, model, choice.fixes),
            groups,
            script_run.may_lose,
            script_run.columns,
            frozenset(if_known),
        )
        pot.remarks = (*pot.remarks, *pot.setup.remarks())
    if script:
        pot.file = path.name
    else:
        pot.text = text.strip() + "\n"
    return pot


def _masses_of_files(model: Model, terms) -> list[Command]:
    """The mass lines of a script with those that its potential files stand for (embedded atoms, MEAM, EIM), in the
    order in which they hold; none where no file says masses."""
    of_line = {t.inner.file_masses[0]: t.inner.file_masses[1] for t in terms if t.inner.file_masses[1]}
    pair = model.styles.get("pair")
    out = []
    for c in model.heavy if of_line else ():
        if c.name == "mass":
            out.append(c)
            continue
        said, own = of_line.get(c.where), True
        if said is None and pair is not None and "eam" in (pair.name, *c.words[2:3]):  # one file a type, one term
            said, own = of_line.get(pair.where, {}), False
        for word, mass in (said or {}).items():
            if own or all(_covers(type_range(model, "atom", w, c.where), word) for w in c.words[:2]):
                out.append(Command("mass", (word, repr(mass)), c.where))
    return out


def _covers(span: TypeRange, word: str) -> bool:
    """Whether a range of types has the one, or all that are open above, that a word names."""
    first = int(word.rstrip("*") or 1)
    return span.lo <= first and (span.hi is None or (first <= span.hi and not word.endswith("*")))


def _atom_style(model: Model) -> tuple[str, ...]:
    """The words of ``atom_style``; LAMMPS's default, or what the styles of a restarted run need."""
    if model.atom_style or model.restart is None:
        return model.atom_style or ("atomic",)
    return ("full",) if any(k in model.styles for k in BONDED) else ("atomic",)


#: LAMMPS's time step where a script has no ``timestep`` line, in its units.
_TIMESTEPS = {
    "lj": 0.005, "real": 1.0, "metal": 0.001, "si": 1e-8, "cgs": 1e-8, "electron": 0.001, "micro": 2.0, "nano": 0.00045,
}  # fmt: skip


def _timestep(word: str | None, u: Units) -> float | None:
    """The time step of a run (internal), None where it is not known."""
    word = str(_TIMESTEPS.get(u.name, "")) if word is None else word
    try:
        return float(u.to_internal("time", float(word)))
    except ValueError:
        return None


def _needs(pot: Potential, model: Model, fixes=()) -> frozenset:
    """What the terms need to know of atoms besides their places and types."""
    styles = [s for t in pot.terms for s in (t, *t.styles)]
    out = {"charges"} if any(s.needs_charges for s in styles) else set()
    if model.exclusions and (model.exclusions.same or model.exclusions.different):
        out.add("molecules")
    if needs_molecules(fixes):
        out.add("molecules")
    return frozenset(out)


def _check_free(model: Model, script_run: Interpreter, state: State, name: str) -> None:
    """Particles without forces between them, as LAMMPS runs them; AtcError for a script that makes no atoms, or runs
    nothing."""
    atoms = any(c.name in ("create_atoms", "read_data", "read_dump") for c in state.atoms)
    if atoms and script_run.runs:
        model.styles["pair"] = Style("pair", "zero", ("0.0",), name)
        model.notes.append("there is no pair_style and no bonded style: no forces between atoms, as in LAMMPS")
    elif script_run.runs or state.atoms:
        what = "no run" if atoms else "no atoms (no create_atoms, read_data)"
        raise AtcError(
            f"{name}: no interactions found: expected pair_style or bond_style lines with their coefficients; the "
            f"script has {what} either"
        )
