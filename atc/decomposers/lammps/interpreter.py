"""A LAMMPS input script executed without running it: which commands LAMMPS gets to, with which words, before each of
its runs.

Variables, conditions, loops and included files are followed as LAMMPS follows them. What only the run knows
(thermodynamic output, the environment) is kept as unknown, and refused only where a line needs it that matters.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ...errors import AtcError
from ..atom_columns import named_columns
from ..pairs.hybrid import strip_suffix
from .commands import CLASSES, check_known
from .control import Control, Quit
from .fixes import classify
from .script import Command, Line, logical_lines, read_text, split_words
from .state import State
from .variables import Unknown, Variables

#: Commands that are executed before a script is given up.
MOST = 50000
_DEEPEST = 20
#: Restart files whose models are kept in mind.
_RESTARTS = 20


@dataclass
class _File:
    """A script being executed: its lines, and where its labels are."""

    path: Path | None
    lines: list[Line]
    labels: dict[str, int] = field(default_factory=dict)

    def __post_init__(self):
        for k, line in enumerate(self.lines):
            words = line.text.split()
            if words[0] == "label" and len(words) > 1:
                self.labels.setdefault(words[1], k)


class Interpreter(Control):
    """Executes LAMMPS lines.

    Parameters
    ----------
    folder : where files are looked up
    script : whether the lines are a whole script, which may hold commands that atc does not know

    Attributes
    ----------
    runs : list of State, one for each command that runs
    state : State, at the end
    written : [(file name of a dump, number of the first run it is written in, of the first one it is not, or None)]
    written_data : names of the data files that are written
    may_lose : the line that lets LAMMPS go on where atoms are lost, or ""
    columns : {column of a dump: property of atoms}, as its computes name them
    """

    def __init__(self, folder: Path, script: bool = False, path: Path | None = None):
        self.folder, self.script, self.path = folder, script, path
        self.variables = Variables(self._read_values)
        self.runs: list[State] = []
        self.model: list[Command] = []
        self.atoms: list[Command] = []
        self.fixes: dict[str, Command] = {}
        self.dumps: dict[str, tuple[str, int]] = {}
        self.written: list[tuple[str, int, int | None]] = []
        self.written_data: list[str] = []
        self.columns: dict[str, str] = {}
        self._files: dict[Path, _File] = {}
        self._skip_jump = False
        self._executed = self._depth = 0
        self.may_lose = ""
        self.timestep: str | None = None
        self.verlet = True
        self._fixes: tuple[Command, ...] = ()
        self._restarts: dict[str, tuple[list, list]] = {}
        self._restored: set[str] = set()

    # Files
    # ------------------------------------------------------------------------------------------------------------------

    def execute(self, text: str, name: str) -> None:
        """Execute a whole script."""
        try:
            self._file(_File(self.path, logical_lines(text, name)))
        except Quit:
            pass
        for file, first in self.dumps.values():
            self.written.append((file, first, None))

    def _find(self, name: str) -> Path:
        return self.folder / Path(name).expanduser()

    def _load(self, name: str, where: str) -> _File:
        path = self._find(name)
        if path not in self._files:
            self._files[path] = _File(path, logical_lines(read_text(path, where), str(path)))
        return self._files[path]

    def _read_values(self, name: str) -> str:
        try:
            return read_text(self._find(name))
        except AtcError as e:
            raise Unknown(str(e)) from None

    def _file(self, file: _File) -> None:
        """Execute the lines of a file, and of those it jumps to."""
        if self._depth >= _DEEPEST:
            raise AtcError(f"{file.path}: includes are nested more than {_DEEPEST} deep; does a file include itself?")
        self._depth += 1
        p = 0
        while p < len(file.lines):
            line = file.lines[p]
            target = self._line(line, file, p)
            if target is not None:
                file, p = target
            else:
                p += 1
        self._depth -= 1

    # Lines
    # ------------------------------------------------------------------------------------------------------------------

    def _line(self, line: Line, file: _File, p: int):
        """Execute one line; the file and line to go on with if it jumps."""
        self._executed += 1
        if self._executed > MOST:
            raise line.error(f"more than {MOST} commands are executed up to here: is this a loop without end?")
        name = line.head
        if name.startswith("$") or name[0] in "\"'":
            words = self._words(line)
            name = words[0] if words else ""
            if not name:
                return None
        kind = CLASSES.get(name, (None, ""))[0]
        if kind is None:
            check_known(name, line.where, self.script)
        elif kind == "model":
            words, why = self._known_words(line)
            self._take(Command(name, tuple(words[1:]), line.where, why))
        elif kind == "atoms":
            self._take_atoms(name, line)
        elif kind == "fix":
            self._fix(name, line)
        elif kind == "run":
            self._run(name, line)
        elif kind == "refused":
            self._refuse(name, line)
        elif kind == "control":
            return getattr(self, f"_{name}")(line, file, p)
        elif name == "thermo_modify":
            words, _ = self._known_words(line)
            if "lost" in words and words[words.index("lost") + 1 :][:1] in (["ignore"], ["warn"]):
                self.may_lose = line.where
        elif name == "compute":
            self._compute(line)
        elif name == "timestep":
            words, why = self._known_words(line)
            self.timestep = "" if why or len(words) < 2 else words[1]
        elif name == "run_style":
            self.verlet = self._known_words(line)[0][1:2] == ["verlet"]
        elif name in ("dump", "undump", "write_data", "write_restart"):
            self._dump(name, line)
        return None

    def _words(self, line: Line) -> list[str]:
        words, why = self._known_words(line)
        if why:
            raise line.error(why)
        return words

    def _known_words(self, line: Line) -> tuple[list[str], str | None]:
        """The words, with variables as they stand and the reason where these are not known."""
        try:
            return split_words(self.variables.substitute(line.text), line.where), None
        except Unknown as e:
            return split_words(line.text, line.where), str(e)

    def _take(self, c: Command) -> None:
        if c.name == "clear":
            self.model, self.atoms = [], []
            self.timestep, self.verlet = None, True
            self._restored = set()
            self._set_fixes({})
            return
        kind, _, what = c.name.partition("_")
        if what == "style" and kind in self._restored:
            # Said again behind a restart file: its coefficients must be too; what pair_modify said of the same style
            # stays.
            old = [m for m in self.model if m.name.startswith(f"{kind}_")]
            same = any(m.name == c.name and m.words[:1] == c.words[:1] for m in old)
            kept = [m for m in old if same and m.name == "pair_modify"]
            self.model = [*(m for m in self.model if m not in old), c, *kept]
            self._restored.discard(kind)
            return
        self.model.append(c)
        if c.name in ("read_data", "mass", "labelmap"):
            self.atoms.append(c)

    def _take_atoms(self, name: str, line: Line) -> None:
        words, why = self._known_words(line)
        c = Command(name, tuple(words[1:]), line.where, why)
        if name == "neigh_modify":
            if not {"exclude", "include"} & set(c.words):
                return
            self.model.append(c)
        self.atoms.append(c)

    def _refuse(self, name: str, line: Line) -> None:
        reason = CLASSES[name][1]
        if name == "read_restart":
            # What the restart brings goes before the lines above it; those behind it may say all of it again.
            words, why = self._known_words(line)
            if not why and len(words) > 1 and self._restore(words[1]):
                return
            self.model = [c for c in self.model if c.name in ("units", "dimension", "atom_style")]
            self.atoms = []
            for target in (self.model, self.atoms):
                target.append(Command(name, tuple(words[1:]), line.where, why))
            return
        raise line.error(f"{name}: {reason}, which is not supported: write the lines of the model that holds")

    def _restore(self, file: str) -> bool:
        """Go on from a restart file that this script wrote, if it did."""
        if file not in self._restarts:
            return False
        model, atoms = self._restarts[file]
        self.model = [c for c in model if c.name != "neigh_modify"]
        self.atoms = [c for c in atoms if c.name not in ("region", "lattice", "neigh_modify")]
        self._restored = {
            c.name.partition("_")[0] for c in model if c.name.endswith("_style") and c.name != "atom_style"
        }
        return True

    def _fix(self, name: str, line: Line) -> None:
        words, why = self._known_words(line)
        if name == "unfix":
            if why:
                raise line.error(f"{why}")
            self._set_fixes({k: c for k, c in self.fixes.items() if k != (words[1] if len(words) > 1 else "")})
            return
        if len(words) < 4:
            raise line.error(f"fix needs a name, a group and a style, got {' '.join(words[1:]) or 'nothing'}")
        style = strip_suffix(words[3])
        if "$" in words[3] or "$" in words[1]:
            raise line.error(f"{why}")
        if classify(style, words[4:]) is None:
            raise line.error(
                f"fix {words[3]} is no fix of LAMMPS that atc knows, so whether it changes forces is "
                "not known: leave it out if it does not"
            )
        c = Command("fix", (words[1], words[2], style, *words[4:]), line.where, why)
        self._set_fixes({**self.fixes, words[1]: c})

    def _set_fixes(self, fixes) -> None:
        self.fixes, self._fixes = fixes, tuple(fixes.values())

    def _run(self, name: str, line: Line) -> None:
        words, _ = self._known_words(line)
        if name == "run" and "every" in words:
            for text in words[words.index("every") + 2 :]:
                self._harmless_or_refuse(text, line.where, "is executed while LAMMPS runs")
        self.runs.append(self._state(line.where, name))
        if not (self.atoms and self.atoms[-1].name == "run"):
            self.atoms.append(Command("run", (), line.where))

    def _state(self, where: str = "", name: str = "") -> State:
        known = self.verlet and not any(c.words[2] == "dt/reset" for c in self._fixes)
        return State(self.model, self.atoms, self._fixes, where, name, self.timestep if known else "")

    @property
    def state(self) -> State:
        return self._state()

    def _dump(self, name: str, line: Line) -> None:
        words, why = self._known_words(line)
        many = name == "write_restart" and len(self._restarts) > _RESTARTS
        if len(words) < 2 or many or (why and name != "write_data"):
            return
        if name == "write_restart":
            self._restarts[words[1]] = list(self.model), list(self.atoms)
        elif name == "write_data":
            self.written_data.append(Path(words[1]).name)
        elif name == "dump" and len(words) > 5:
            self.dumps[words[1]] = (words[5], len(self.runs))
        elif words[1] in self.dumps:
            file, first = self.dumps.pop(words[1])
            self.written.append((file, first, len(self.runs)))

    def _compute(self, line: Line) -> None:
        words, why = self._known_words(line)
        for column, name in named_columns(words[1:]).items() if not why else ():
            # A name with two meanings has none.
            self.columns[column] = name if self.columns.get(column, name) == name else ""
