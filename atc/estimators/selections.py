"""Some of the atoms: by type, element, number, molecule, region, or MDAnalysis's words; and the parts they are told
apart by.

What is said of atoms in several ways holds for those of which all of it is true.
"""

from __future__ import annotations

import re
import warnings
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ..errors import AtcError

#: What tells parts apart.
BY = ("type", "element", "molecule")
#: Which bonds belong to the field of some atoms: each by half of it for every end among them ("half"), those with both
#: ends among them, with one end only, or with any.
BONDS = ("half", "both", "one", "any")
#: More parts than these are hardly meant: each is a field of its own.
MOST_PARTS = 1000
_SPAN = re.compile(r"(\d+)?(?::(\d+)?(?::(\d+))?)?$")


@dataclass(frozen=True)
class Selection:
    """Which atoms; made by `select`.

    ids : (first, last, step) of atom ids, both included; last None: no end
    region : words of LAMMPS's ``region`` in the trajectory's units of length; words : a selection of MDAnalysis
    groups : names of groups of the script of the potential; members : the ids of their atoms, as `settled` has found
        them
    invert : all atoms but these. fixed : those that the first frame has, told by their ids in the others
    known : the ids that `settled` has found, or None
    """

    types: tuple[int, ...] = ()
    elements: tuple[str, ...] = ()
    ids: tuple[tuple[int, int | None, int], ...] = ()
    molecules: tuple[int, ...] = ()
    groups: tuple[str, ...] = ()
    region: str = ""
    words: str = ""
    invert: bool = False
    fixed: bool = False
    known: tuple[int, ...] | None = None
    members: tuple[int, ...] | None = None
    universe: object = None

    def describe(self) -> str:
        """In words."""
        said = [f"{name} {', '.join(map(str, v))}" for name, v in _listed(self) if v]
        said += [f"region {self.region}"] * bool(self.region) + [f"MDAnalysis: {self.words}"] * bool(self.words)
        text = " and ".join(said) or "all atoms"
        return ("not (" + text + ")" if self.invert else text) + (" in the first frame" if self.fixed else "")

    def plain(self) -> dict:
        """As TOML and `identity` have it."""
        out = {name: list(v) for name, v in _listed(self) if v}
        out |= {k: v for k, v in (("region", self.region), ("atoms", self.words)) if v}
        return out | {k: True for k in ("invert", "fixed") if getattr(self, k)}

    def settled(self, first, frames=None, pot=None) -> Selection:
        """Ready for the frames of a trajectory that begins with `first`: what is fixed is found there, MDAnalysis's own
        names are at hand where it has read them, and groups are those of the script of `pot`. AtcError for what no
        frame could satisfy."""
        ready = self
        if self.groups:
            setup = None if pot is None else getattr(pot, "setup", None)
            if setup is None:
                raise AtcError(
                    f"{first.source}: select groups: only a LAMMPS script says who is in a group: name it as input of "
                    "[potential]"
                )
            inside = setup.in_groups(self.groups, first)
            ready = replace(ready, members=tuple(first.ids[inside].tolist()))
        if self.words:
            while frames is not None and not hasattr(frames, "_atoms"):
                frames = getattr(frames, "base", None)
            if frames is not None:
                import MDAnalysis

                with _silent():
                    ready = replace(ready, universe=MDAnalysis.Merge(frames._atoms))
        chosen = ready.of(first)
        if not chosen.any():
            raise AtcError(f"{first.source}: select: no atom is {self.describe()}")
        if not self.fixed:
            return ready
        return replace(ready, universe=None, known=tuple(first.ids[chosen].tolist()))

    def of(self, frame) -> np.ndarray:
        """(n,) bool: which atoms of a frame. AtcError for what the frame does not say, or cannot be understood."""
        if self.known is not None:
            return np.isin(frame.ids, self.known)
        chosen = np.ones(len(frame), bool)
        if self.types:
            chosen &= np.isin(frame.types, self.types)
        if self.elements:
            chosen &= np.isin(names_of(frame, "select elements"), self.elements)
        if self.molecules:
            chosen &= np.isin(_molecules(frame, "select molecules"), self.molecules)
        if self.groups:
            if self.members is None:
                raise AtcError("select groups: who is in a group is found by atc.fields, from the script of the run")
            chosen &= np.isin(frame.ids, self.members)
        if self.ids:
            if (
                frame.given.get("ids") == "order"
                and len(frame)
                and not np.array_equal(frame.ids, np.arange(1, len(frame) + 1))
            ):
                raise AtcError(f"{frame.source}: select ids: its atoms have no ids")
            inside = np.zeros(len(frame), bool)
            for lo, hi, step in self.ids:
                inside |= (frame.ids >= lo) & ((frame.ids - lo) % step == 0) & (hi is None or frame.ids <= (hi or 0))
            chosen &= inside
        if self.region:
            chosen &= _in_region(self.region, frame)
        if self.words:
            chosen &= self._by_words(frame)
        return ~chosen if self.invert else chosen

    def _by_words(self, frame) -> np.ndarray:
        try:
            import MDAnalysis
        except ImportError:
            raise AtcError("select: MDAnalysis's selections need MDAnalysis: pip install MDAnalysis") from None
        with _silent():
            universe = self.universe if self.universe is not None else _universe(frame)
            universe.atoms.positions = frame.units.to_user("length", frame.positions)
            universe.dimensions = _box(frame)
            try:
                found = universe.select_atoms(self.words)
            except (MDAnalysis.exceptions.SelectionError, MDAnalysis.exceptions.NoDataError) as e:
                raise AtcError(f"select {self.words!r}: MDAnalysis says: {' '.join(str(e).split())}") from None
            except Exception as e:
                raise AtcError(
                    f"select {self.words!r}: MDAnalysis cannot make sense of it ({type(e).__name__})"
                ) from None
        chosen = np.zeros(len(frame), bool)
        chosen[found.ix] = True
        return chosen


def _listed(selection: Selection):
    spans = tuple(
        str(lo) if hi == lo else f"{lo}:{'' if hi is None else hi}" + (f":{step}" if step > 1 else "")
        for lo, hi, step in selection.ids
    )
    return (
        ("types", selection.types),
        ("elements", selection.elements),
        ("ids", spans),
        ("molecules", selection.molecules),
        ("groups", selection.groups),
    )


def select(
    atoms=None, *, types=None, elements=None, ids=None, molecules=None, groups=None, region=None, invert=False,
    fixed=False,
) -> Selection:  # fmt: skip
    """Some of the atoms, for ``atc.fields(..., select=...)``: those of which everything said is true.

    Parameters
    ----------
    atoms : str
        A selection of MDAnalysis, e.g. ``"type 1 2"``, ``"name OW and prop z < 20"``, ``"around 5 type 2"``; of the
        Universe where the trajectory is one, else with the types (names, if the source has them), ids, molecules
        (``resid``), masses and charges of the frames. ``"group:wall"``: short for ``groups="wall"``
    types : ints. elements : chemical symbols or names that the source gives the types. molecules : ints
    groups : names of groups of the LAMMPS script that the potential comes from; atoms of several are in all of them
    ids : ints, or spans ``"1:100"``, ``"200:"``, ``"1:100:2"``: first, last (included) and step
    region : str
        Words of a LAMMPS ``region`` without its name: ``"block 0 10 INF INF 0 5"``, ``"sphere 20 20 20 8"``,
        ``"cylinder z 10 10 5 INF INF side out"``; lengths in the trajectory's units, EDGE the face of the cell
    invert : all atoms but these
    fixed : the atoms that the first frame has of these, also in all others; else each frame is asked anew

    Raises
    ------
    AtcError for what cannot be understood.
    """
    if isinstance(atoms, Selection):
        return atoms
    if atoms is not None and not (isinstance(atoms, str) and atoms.strip()):
        raise AtcError(f'select: atoms {atoms!r}: expected words of MDAnalysis, e.g. "type 1 2"')
    if atoms is not None and atoms.strip().startswith("group:"):
        if groups is not None:
            raise AtcError(f"select: atoms {atoms!r} and groups: say groups once")
        atoms, groups = None, [w.strip() for w in atoms.strip().removeprefix("group:").split(",")]
    made = Selection(
        types=_numbers("types", types),
        elements=_words("elements", elements),
        ids=_spans(ids),
        molecules=_numbers("molecules", molecules),
        groups=_words("groups", groups),
        region="" if region is None else _region_words(region),
        words=(atoms or "").strip(),
        invert=bool(invert),
        fixed=bool(fixed),
    )
    if not (made.types or made.elements or made.ids or made.molecules or made.groups or made.region or made.words):
        raise AtcError("select: say which atoms: types, elements, ids, molecules, groups, region or MDAnalysis's words")
    return made


def selection(given) -> Selection | None:
    """What `atc.fields` is given as `select`."""
    if given is None or isinstance(given, Selection):
        return given
    if isinstance(given, dict):
        try:
            return select(**given)
        except TypeError:
            known = "atoms, types, elements, ids, molecules, groups, region, invert, fixed"
            raise AtcError(f"select {given!r}: expected some of {known}") from None
    if isinstance(given, str):
        return select(given)
    raise AtcError(f"select {given!r}: expected what atc.select gives, or words of MDAnalysis")


def _many(value) -> list:
    return [value] if isinstance(value, (str, int, np.integer)) else list(value)


def _numbers(what, given) -> tuple[int, ...]:
    if given is None:
        return ()
    try:
        values = _many(given)
        if not values or not all(isinstance(v, (int, np.integer)) and not isinstance(v, bool) for v in values):
            raise TypeError
    except TypeError:
        raise AtcError(f"select: {what} {given!r}: expected whole numbers, e.g. [1, 2]") from None
    return tuple(int(v) for v in values)


def _words(what, given) -> tuple[str, ...]:
    if given is None:
        return ()
    values = _many(given) if isinstance(given, (str, list, tuple)) else []
    if not values or not all(isinstance(v, str) and v for v in values):
        raise AtcError(f'select: {what} {given!r}: expected names, e.g. ["O", "H"]')
    return tuple(values)


def _spans(given) -> tuple:
    if given is None:
        return ()
    out = []
    try:
        for v in _many(given):
            if isinstance(v, (int, np.integer)) and not isinstance(v, bool) and v > 0:
                out.append((int(v), int(v), 1))
                continue
            found = _SPAN.match(v.replace(" ", "")) if isinstance(v, str) and v.strip() else None
            lo, hi, step = found.groups() if found else (None, None, None)
            if found is None or (lo is None and ":" not in v):
                raise TypeError
            lo, step = int(lo or 1), int(step or 1)
            if step < 1:
                raise TypeError
            out.append((lo, int(hi) if hi else None if ":" in v else lo, step))
        if not out:
            raise TypeError
    except TypeError:
        raise AtcError(
            f'select: ids {given!r}: expected atom ids or spans, e.g. [1, 2, "100:200"] or "1:100:2"'
        ) from None
    return tuple(out)


def _region(words: str, box):
    from ..decomposers.lammps.regions import Trouble, parse_region

    try:
        w = words.split()
        return parse_region([*w, "units", "box"], (1.0, 1.0, 1.0), box, {})
    except Trouble as e:
        raise AtcError(f"select: region {words!r}: {e}") from None


def _region_words(words) -> str:
    if not isinstance(words, str) or not words.split():
        raise AtcError(f'select: region {words!r}: expected words of a LAMMPS region, e.g. "block 0 10 INF INF 0 5"')
    words = " ".join(words.split())
    if words.split()[0] in ("union", "intersect"):
        raise AtcError(f"select: region {words!r}: regions of regions have names, which there are none of here")
    region = _region(words, (np.zeros(3), np.ones(3)))
    if region.moves:
        raise AtcError(f"select: region {words!r}: {region.moves}")
    return words


def _in_region(words: str, frame) -> np.ndarray:
    cell, u = frame.cell, frame.units
    x_nc = u.to_user("length", cell.wrap(frame.positions)[0])
    lo = u.to_user("length", cell.origin)
    hi = lo + np.diag(u.to_user("length", cell.vectors))
    if "EDGE" in words.split() and np.count_nonzero(cell.vectors - np.diag(np.diag(cell.vectors))):
        raise AtcError(f"{frame.source}: select: region {words!r}: the cell is tilted: give numbers in place of EDGE")
    return _region(words, (lo, hi)).holds(x_nc)


def _molecules(frame, what) -> np.ndarray:
    if frame.molecules is None:
        raise AtcError(f"{frame.source}: {what}: its atoms have no molecule numbers: dump mol, or name a data file")
    return frame.molecules


def names_of(frame, what) -> np.ndarray:
    """(n,) the names of the atoms' types. AtcError where the source has none."""
    kinds, at = np.unique(frame.types, return_inverse=True)
    missing = [str(t) for t in kinds if t not in frame.type_names]
    if missing:
        raise AtcError(
            f"{frame.source}: {what}: type{'s' * (len(missing) > 1)} {', '.join(missing)} have no names: use types, or "
            "dump element"
        )
    return np.array([str(frame.type_names[t]) for t in kinds.tolist()])[at] if len(kinds) else np.zeros(0, "U1")


@contextmanager
def _silent():
    """MDAnalysis warns of every attribute that it cannot guess."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _universe(frame):
    """A Universe with what a frame says of its atoms."""
    import MDAnalysis

    n, u = len(frame), frame.units
    molecules = frame.molecules if frame.molecules is not None else np.ones(n, np.int64)
    kinds, residue = np.unique(molecules, return_inverse=True)
    universe = MDAnalysis.Universe.empty(n, len(kinds), atom_resindex=residue, trajectory=True)
    names = np.array([str(frame.type_names.get(t, t)) for t in frame.types.tolist()])
    universe.add_TopologyAttr("types", np.array([str(t) for t in frame.types.tolist()]))
    universe.add_TopologyAttr("names", names)
    if frame.type_names:
        universe.add_TopologyAttr("elements", names)
    universe.add_TopologyAttr("ids", frame.ids)
    universe.add_TopologyAttr("resids", kinds)
    if frame.masses is not None:
        universe.add_TopologyAttr("masses", u.to_user("mass", frame.masses))
    if frame.charges is not None:
        universe.add_TopologyAttr("charges", u.to_user("charge", frame.charges))
    return universe


def _box(frame):
    from MDAnalysis.lib.mdamath import triclinic_box

    if not frame.cell.periodic.any():
        return None
    return triclinic_box(*frame.units.to_user("length", frame.cell.vectors))


# --- parts


@dataclass(frozen=True)
class Parts:
    """The species, or molecules, that fields are taken apart by, as the first frame has them.

    labels : their names, in order. keys : what of an atom tells its part: type or molecule numbers, or type names
    """

    by: str
    labels: tuple[str, ...]
    keys: tuple

    @classmethod
    def of_frame(cls, by: str, frame, chosen) -> Parts:
        """Those of the chosen atoms of a frame. AtcError where it does not tell them apart."""
        keys = np.unique(_keys(by, frame)[chosen]).tolist()
        if len(keys) > MOST_PARTS:
            raise AtcError(
                f"by = {by!r}: {len(keys)} parts, each a field of its own: select some, {MOST_PARTS} at most"
            )
        labels = [str(k) for k in keys]
        if by == "type" and all(k in frame.type_names for k in keys):
            names = [str(frame.type_names[k]) for k in keys]
            labels = names if len({*names}) == len(names) else labels
        return cls(by, tuple(labels), tuple(keys))

    def index_of(self, frame, chosen) -> np.ndarray:
        """(n,) which part each atom is of, −1 for those that are not chosen. AtcError for an atom of none."""
        keys, at = np.unique(_keys(self.by, frame), return_inverse=True)
        known = {k: n for n, k in enumerate(self.keys)}
        part_n = np.array([known.get(k, -1) for k in keys.tolist()], np.int64)[at]
        strange = chosen & (part_n < 0)
        if strange.any():
            a = int(np.flatnonzero(strange)[0])
            raise AtcError(
                f"{frame.source}: atom {frame.ids[a]} is of {self.by} {_keys(self.by, frame)[a]}, which the first "
                "frame does not have: select those that it has, or begin with a frame that has all of them"
            )
        return np.where(chosen, part_n, -1)


def _keys(by, frame) -> np.ndarray:
    if by == "element":
        return names_of(frame, 'by = "element"')
    return _molecules(frame, 'by = "molecule"') if by == "molecule" else frame.types
