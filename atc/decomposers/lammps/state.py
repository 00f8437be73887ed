"""What holds at one of a script's runs: the commands of its model and of its atoms, and the fixes that are there."""

from __future__ import annotations

from .fixes import class_of
from .script import Command


class State:
    """What holds at a run (or at the end of a script without one): a point in the lists of executed commands, which
    only grow.

    fixes : those that are there. where : file and line of the run, for messages. name : the command that runs
    timestep : the word of the last ``timestep`` line, None if there was none, "" where it is not known
    """

    def __init__(
        self, model: list, atoms: list, fixes: tuple, where: str = "", name: str = "", timestep: str | None = None
    ):
        self._model, self._atoms, self.fixes = model, atoms, fixes
        self.where, self.name, self.timestep = where, name, timestep
        self._n_model, self._n_atoms = len(model), len(atoms)

    @property
    def model(self) -> tuple[Command, ...]:
        """The commands of this class up to here, in order."""
        return tuple(self._model[: self._n_model])

    @property
    def atoms(self) -> tuple[Command, ...]:
        return tuple(self._atoms[: self._n_atoms])

    @property
    def key(self):
        """The same for states that hold the same lines of model commands."""
        return id(self._model), self._n_model, self.held

    @property
    def held(self) -> tuple[Command, ...]:
        """The fixes that hold distances or bodies, which are part of the model."""
        return tuple(c for c in self.fixes if class_of(c) == "constraint")

    def said(self) -> list:
        """The model without where its lines stand: of lines given twice the last, kind by kind; of data files also
        which styles they gave coefficients to."""
        out, styles = [], ()
        for c in self.model:
            styles = (*styles, c.name) if c.name.endswith("_style") and c.name not in styles else styles
            out.append((c.name, c.words, tuple(sorted(styles)) if c.name == "read_data" else ()))
        out += [("fix", c.words[1:], ()) for c in self.held]
        return sorted(dict.fromkeys(reversed(out)), key=lambda c: c[0] if c[0] == "pair_modify" else c[0].split("_")[0])

    def atoms_beyond(self, first: State) -> tuple[Command, ...]:
        """The commands that concern atoms on top of those of an earlier state, all if they do not begin with these."""
        if self._atoms is first._atoms:
            return tuple(self._atoms[first._n_atoms : self._n_atoms])
        a, b = ([c for c in s.atoms if c.name != "run"] for s in (first, self))
        same = [(c.name, c.words) for c in b[: len(a)]] == [(c.name, c.words) for c in a]
        return tuple(b[len(a) :] if same else b)
