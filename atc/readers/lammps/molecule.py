"""LAMMPS molecule files (the ``molecule`` command, native text format), and the bonded terms of atoms of atom_style
template."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ...errors import AtcError
from .sections import SectionedFile, shortened, whole_of

BONDED = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
_PER_ATOM = {"Coords": 3, "Types": 1, "Molecules": 1, "Charges": 1, "Diameters": 1, "Dipoles": 3, "Masses": 1}
_OTHER = (
    "Fragments", "Special Bond Counts", "Special Bonds", "Shake Flags", "Shake Atoms", "Shake Bond Types",
    "Body Integers", "Body Doubles",
)  # fmt: skip
_COUNT = re.compile(r"^\s*(\d+)\s+(atoms|bonds|angles|dihedrals|impropers|fragments)(?:\s|$)", re.ASCII)
_NUMBERS = re.compile(r"^\s*\S.*\s(mass|com|inertia|body)(?:\s|$)")


@dataclass
class LammpsMolecule:
    """What a molecule file says of n atoms, in the file's own units.

    Attributes
    ----------
    types : (n,) atom types or None. coords : (n, 3) or None. charges, masses, diameters : (n,) or None. molecules :
        (n,) or None
    bonded : {"Bonds": (types (m,), members (m, 2) from 1), "Angles": ..., "Dihedrals": ..., "Impropers": ...}
    labels : words that stand for types, by kind, as they were given for reading
    """

    source: str
    n: int
    types: np.ndarray | None = None
    coords: np.ndarray | None = None
    charges: np.ndarray | None = None
    masses: np.ndarray | None = None
    diameters: np.ndarray | None = None
    molecules: np.ndarray | None = None
    bonded: dict = field(default_factory=dict)

    def shifted(self, atom=0, bond=0, angle=0, dihedral=0, improper=0) -> LammpsMolecule:
        """The molecule with offsets added to its types, as the keywords ``offset``, ``toff``, ``boff``, ... of the
        ``molecule`` command do."""
        more = dict(zip(BONDED, (bond, angle, dihedral, improper), strict=True))
        bonded = {name: (types + more[name], members) for name, (types, members) in self.bonded.items()}
        types = None if self.types is None else self.types + atom
        return LammpsMolecule(
            self.source, self.n, types, self.coords, self.charges, self.masses, self.diameters, self.molecules, bonded
        )


def read_molecule(path, labels=None) -> LammpsMolecule:
    """Read a molecule file.

    Parameters
    ----------
    path : str or Path, plain or compressed
    labels : {"Atom": {label: type}, "Bond": ..., ...} for files whose types are labels

    Raises
    ------
    AtcError, with file and line, for anything that LAMMPS would not read, and for lists of special neighbours that are
    not those of the bonds.
    """
    labels = labels or {}
    f = SectionedFile(
        path,
        {*BONDED, *_PER_ATOM, *_OTHER},
        lambda line: bool(_COUNT.match(line) or _NUMBERS.match(line)),
        "molecule file",
    )
    if f.title.lstrip().startswith(("{", "[")):
        raise AtcError(f"{path}: molecule files in JSON are not read: write it in LAMMPS's text format")
    if f.others:
        raise AtcError(f"{path}: section {shortened(f.others[0])!r} is none of a LAMMPS molecule file")
    counts = {}
    for number, line in f.header:
        if m := _COUNT.match(line):
            counts[m.group(2)] = whole_of(m.group(1))
            if counts[m.group(2)] is None:
                raise AtcError(
                    f"{path}, line {number}: {shortened(m.group(1))} {m.group(2)} are more than any file holds"
                )
    n = counts.get("atoms", 0)
    if n < 1:
        raise AtcError(f"{path}: the header has no '<n> atoms' line; is it a LAMMPS molecule file?")
    out = LammpsMolecule(str(path), n)
    for name, width in _PER_ATOM.items():
        if name in f.places:
            _per_atom(out, f.section(name), width, n, labels.get("Atom"))
    for name, width in BONDED.items():
        _bonded(out, f, name, width, counts.get(name.lower(), 0), labels.get(name[:-1]))
    if "Special Bonds" in f.places or "Special Bond Counts" in f.places:
        _check_special(out, f)
    return out


def _per_atom(out, s, width, n, labels):
    s.require(n)
    whole = {"id", "molecule"}
    columns = ["id", *({"Types": ["type"], "Molecules": ["molecule"]}.get(s.name) or [f"v{k}" for k in range(width)])]
    table = s.table(columns, whole, labels)
    order = _from_one(table["id"], n, s)
    value = np.stack([table[c] for c in columns[1:]], axis=1)[order]
    attribute = {
        "Coords": "coords", "Types": "types", "Molecules": "molecules", "Charges": "charges", "Masses": "masses",
        "Diameters": "diameters",
    }  # fmt: skip
    if s.name == "Types" and value.min() < 1:
        raise AtcError(f"{s.source}: section Types: types count from 1, got {value.min()}")
    if s.name in attribute:
        setattr(out, attribute[s.name], value if width > 1 else value[:, 0])


def _from_one(ids, n, s):
    order = np.argsort(ids, kind="stable")
    if not np.array_equal(ids[order], np.arange(1, n + 1)):
        raise AtcError(f"{s.source}, line {s.line}: section {s.name} has not one line for each atom from 1 to {n}")
    return order


def _bonded(out, f, name, width, expected, labels):
    found = f.bonded(name, width, expected, labels)
    if found is None:
        return
    s, types, members = found
    wrong = (members < 1).any(axis=1) | (members > out.n).any(axis=1) | (types < 1)
    wrong |= (np.diff(np.sort(members, axis=1), axis=1) == 0).any(axis=1)
    if wrong.any():
        k = int(wrong.argmax())
        raise AtcError(
            f"{s.where(k)}: expected a type from 1 and {width} different atoms from 1 to {out.n} in section {name}"
        )
    out.bonded[name] = (types, members)


def _check_special(out, f):
    """Lists of neighbours that a molecule file gives itself must be those that its bonds make: weights of others are
    not known to the potential."""
    if not {"Special Bonds", "Special Bond Counts"} <= f.places.keys():
        raise AtcError(f"{out.source}: sections Special Bond Counts and Special Bonds go together: one is missing")
    rows, counts = f.section("Special Bonds"), f.section("Special Bond Counts")
    near = {a: set() for a in range(1, out.n + 1)}
    for a, b in out.bonded.get("Bonds", (None, np.zeros((0, 2), int)))[1].tolist():
        near[a].add(b)
        near[b].add(a)
    said = {}
    for s in (rows, counts):
        for k, words in enumerate(s.rows()):
            values = [whole_of(w) for w in words]
            if None in values or not 1 <= values[0] <= out.n:
                raise AtcError(
                    f"{s.where(k)}: expected integers in section {s.name}, got {shortened(' '.join(words))!r}"
                )
            said.setdefault(values[0], {})[s.name] = (values[1:], s.where(k))
    for a, parts in said.items():
        if len(parts) < 2 or len(parts["Special Bond Counts"][0]) != 3:
            raise AtcError(
                f"{out.source}: sections Special Bond Counts (id n12 n13 n14) and Special Bonds do not go together "
                f"for atom {a}"
            )
        members, where = parts["Special Bonds"]
        n12, n13, n14 = parts["Special Bond Counts"][0]
        shells, seen = [{a}], {a}
        for _ in range(3):
            shells.append({c for b in shells[-1] for c in near[b]} - seen)
            seen |= shells[-1]
        cut = (0, n12, n12 + n13, n12 + n13 + n14)
        other = any(set(members[cut[k] : cut[k + 1]]) != shells[k + 1] for k in range(3))
        if other or min(n12, n13, n14) < 0 or cut[3] != len(members):
            raise AtcError(
                f"{where}: the special bonds of atom {a} are not those that the section Bonds makes: such lists are "
                "not supported"
            )


def bonded_of_templates(atoms: dict, molecules, source: str) -> dict:
    """{section: (types, ids)} of atoms of atom_style template: numbers within a molecule follow each other as in the
    molecule.

    atoms : columns of section Atoms, with template_index and template_atom (from 1; 0 for atoms of no template)

    Raises
    ------
    AtcError for atoms that the molecules do not have.
    """
    ids, index, atom = atoms["id"], atoms["template_index"], atoms["template_atom"]
    if ((index > 0) != (atom > 0)).any() or (len(index) and index.max() > len(molecules)):
        raise AtcError(
            f"{source}: atoms of template molecule {index.max(initial=0)}, but {len(molecules)} molecules are known"
        )
    out = {name: ([], []) for name in BONDED}
    there = np.sort(ids)
    for k, molecule in enumerate(molecules, 1):
        mine = index == k
        if mine.any() and atom[mine].max() > molecule.n:
            raise AtcError(
                f"{source}: template atom {atom[mine].max()} of {molecule.source}, which has {molecule.n} atoms"
            )
        for name, (types, members) in molecule.bonded.items():
            for t, m in zip(types.tolist(), members, strict=True):
                first = ids[mine & (atom == m[0])]
                out[name][0].append(np.full(len(first), t))
                out[name][1].append(first[:, None] - m[0] + m)
    bonded = {}
    for name, (types, members) in out.items():
        if not types:
            continue
        bonded[name] = (np.concatenate(types), np.concatenate(members))
        at = np.minimum(np.searchsorted(there, bonded[name][1]), len(there) - 1)
        gone = there[at] != bonded[name][1]
        if gone.any():
            raise AtcError(f"{source}: atom {bonded[name][1][gone][0]} of a template molecule is not in section Atoms")
    return bonded
