"""What GROMACS's run input (.tpr) says of constraints, which MDAnalysis's parser reads and makes plain bonds of.

The parser's functions are called, and what they return is looked at on its way: the lists of interactions of each kind
of molecule, and how many molecules of it there are.
"""

from __future__ import annotations

import threading
import warnings
from contextlib import contextmanager

import numpy as np

from ..frame import Held

#: Kinds of interactions that hold the distance of two atoms, and the three of rigid water.
_DISTANCES, _WATER = ("CONSTR", "CONSTRNC"), "SETTLE"
_ONE_AT_A_TIME = threading.Lock()


def constraints_of(path: str, n: int) -> Held:
    """The distances that a .tpr says are held, among its `n` atoms; `Held.unknown` where they cannot be read."""
    try:
        import MDAnalysis
        from MDAnalysis.topology.TPRParser import TPRParser

        with _seen() as (lists, blocks), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with TPRParser(path) as parser:
                parser.parse()
        return Held(_pairs(lists, blocks, n), path)
    except Exception:  # of another layout, or another MDAnalysis: both say many things
        try:
            version = f"MDAnalysis {MDAnalysis.__version__}"
        except Exception:
            version = "MDAnalysis"
    return Held(
        source=path,
        unknown=f"{path}: which distances the run holds cannot be told by this {version}: name them, [constraints] "
        'bonds = "hbonds" or "allbonds", or pairs (topology = false: none)',
    )


@contextmanager
def _seen():
    """Of what the parser reads in this thread: [{kind: its numbers}] of each kind of molecule, and [(which, how many,
    atoms in one)] of each block of molecules."""
    from MDAnalysis.topology.tpr import utils

    lists: list[dict] = []
    blocks: list[tuple[int, int, int]] = []
    here = threading.get_ident()
    do_ilists, do_molblock = utils.do_ilists, utils.do_molblock

    def ilists(*args, **kwargs):
        out = do_ilists(*args, **kwargs)
        if threading.get_ident() == here:
            lists.append({x.ik[0]: list(x.iatoms) for x in out if x.nr and x.ik[0] in (*_DISTANCES, _WATER)})
        return out

    def molblock(*args, **kwargs):
        out = do_molblock(*args, **kwargs)
        if threading.get_ident() == here:
            blocks.append((out.molb_type, out.molb_nmol, out.molb_natoms_mol))
        return out

    with _ONE_AT_A_TIME:
        utils.do_ilists, utils.do_molblock = ilists, molblock
        try:
            yield lists, blocks
        finally:
            utils.do_ilists, utils.do_molblock = do_ilists, do_molblock


def _pairs(lists, blocks, n) -> np.ndarray:
    """(c, 2) pairs of atoms of all molecules. Raises ValueError where the lists are not those of `n` atoms."""
    if not blocks or sum(many * size for _, many, size in blocks) != n:
        raise ValueError("molecules of other atoms")
    out, start = [np.zeros((0, 2), np.int64)], 0
    for which, many, size in blocks:
        pairs = _of_molecule(lists[which])
        if len(pairs) and not (0 <= pairs.min() and pairs.max() < size):
            raise ValueError("atoms that are not in the molecule")
        first = start + size * np.arange(many)
        out.append((first[:, None, None] + pairs).reshape(-1, 2))
        start += many * size
    return np.unique(np.sort(np.concatenate(out), axis=1), axis=0)


def _of_molecule(kinds) -> np.ndarray:
    """(c, 2) pairs of a kind of molecule. Rows are the number of the parameters, then the atoms; of water in files
    before GROMACS 4.6 the oxygen alone, whose hydrogens follow it."""
    out = [np.zeros((0, 2), np.int64)]
    for name in _DISTANCES:
        out.append(np.array(kinds.get(name, []), np.int64).reshape(-1, 3)[:, 1:])
    water = np.array(kinds.get(_WATER, []), np.int64)
    atoms = water[1] + np.arange(3)[None] if len(water) == 2 else water.reshape(-1, 4)[:, 1:]
    out += [atoms[:, [a, b]] for a, b in ((0, 1), (0, 2), (1, 2))]
    return np.concatenate(out)
