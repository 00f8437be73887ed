"""Files of neuroevolution potentials, ``nep.txt``: six or seven lines of sizes, then numbers, one a line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...readers.whole import whole_text

#: Angular terms of more than three bodies in the order of the file's ``l_max`` line, by the degrees that they couple.
MANY = ((2, 2, 2), (1, 1, 1, 1), (1, 1, 2), (1, 2, 3), (2, 3, 3), (1, 3, 4))
_MOST_L = 8
_ORDER = ("cutoff", "n_max", "basis_size", "l_max", "ANN")


@dataclass
class NEPFile:
    """What a file says: lengths in Å, energies in eV. t types, k basis functions, n radial functions, d descriptors, h
    neurons.

    Attributes
    ----------
    version : 2 to 5. names : (t,) elements
    rc_radial, rc_angular : (t, t) cutoffs of pairs
    l_max : the largest degree of the three-body terms. many : those of `MANY` that there are
    w0_thd, b0_th, w1_th, b1_t : the network of each type; U = w1·tanh(w0 q − b0) − b1
    c_radial, c_angular : (t, t, n, k), the first type the centre's
    scale_d : what descriptors are multiplied by
    zbl : None, or (inner, outer) of the universal screening function, or (t, t, 10): inner, outer, and four pairs of a
        factor and an inverse length
    """

    version: int
    names: tuple[str, ...]
    rc_radial: np.ndarray
    rc_angular: np.ndarray
    l_max: int
    many: tuple
    w0_thd: np.ndarray
    b0_th: np.ndarray
    w1_th: np.ndarray
    b1_t: np.ndarray
    c_radial: np.ndarray
    c_angular: np.ndarray
    scale_d: np.ndarray
    zbl: tuple | np.ndarray | None


class _Lines:
    """The header, line by line, with messages that say where."""

    def __init__(self, path):
        self.path = Path(path)
        self.lines = whole_text(path, "neuroevolution potential").split("\n")
        self.at = -1

    def bad(self, what: str) -> AtcError:
        return AtcError(f"{self.path}: line {self.at + 1}: {what}")

    def words(self, first: str = "") -> list[str]:
        self.at += 1
        words = self.lines[self.at].split() if self.at < len(self.lines) else []
        if not words or (first and words[0] != first):
            raise self.bad(
                f"expected {f'a line {first} ...' if first else 'nep4 <number of types> <elements>'}, got "
                f"{' '.join(words)[:60] or 'nothing'!r}"
            )
        return words

    def numbers(self, first: str, kind=int, at_least=0) -> list:
        words = self.words(first)[1:]
        try:
            values = [kind(w) for w in words]
        except ValueError:
            values = []
        if not values or not all(np.isfinite(v) and v >= at_least for v in values):
            what = "whole numbers" if kind is int else "numbers"
            raise self.bad(f"expected {what} of at least {at_least} behind {first}, got {' '.join(words)!r}")
        return values


def read_nep(path) -> NEPFile:
    """Read a ``nep.txt``.

    Raises
    ------
    AtcError that names file and line for models that are no potentials (dipole, polarizability, temperature), that have
    charges or dispersion besides, or two hidden layers; for numbers missing or too many.
    """
    f = _Lines(path)
    head = f.words()
    token, _, more = head[0].partition("_")
    if not token.startswith("nep"):
        raise f.bad(
            f"{head[0]!r}: expected nep, nep3, nep4 or nep5, with _zbl behind or not: is it the nep.txt of a model?"
        )
    if token not in ("nep", "nep3", "nep4", "nep5"):
        raise f.bad(f"{head[0]!r}: expected nep (the second version), nep3, nep4 or nep5")
    if more not in ("", "zbl"):
        raise f.bad(
            f"{head[0]!r}: only energies of atoms from their neighbours give bonds, not {more.replace('zbl_', '')}: "
            "use a model that is a plain potential"
        )
    version = int(token[3:] or 2)
    if len(head) < 3 or not head[1].isdigit() or int(head[1]) != len(head) - 2 or len({*head[2:]}) < len(head) - 2:
        raise f.bad(f"expected the number of types and as many different elements behind {head[0]}")
    names = tuple(head[2:])
    t = len(names)
    zbl = _zbl_line(f) if more else None
    rc_radial, rc_angular = _cutoffs(f, t)
    n_radial, n_angular = (n + 1 for n in _two(f, "n_max"))
    # Version 2 has no linear combinations: g_n = c_n f_n.
    k_radial, k_angular = (k + 1 for k in _two(f, "basis_size")) if version > 2 else (1, 1)
    l_max, many = _degrees(f, version)
    layers = f.numbers("ANN")
    if not layers[0] or any(layers[1:]) or len(layers) > 2:
        raise f.bad(f"a network of one hidden layer is expected, ANN <neurons> 0, got {' '.join(map(str, layers))}")
    h, d = layers[0], n_radial + n_angular * (l_max + len(many))
    own = t if version > 3 else 1
    weighted = version > 2 or t > 1  # else all c_n are 1
    sizes = {
        "network": own * ((d + 2) * h + (version == 5)) + 1,
        "radial": t * t * n_radial * k_radial * weighted,
        "angular": t * t * n_angular * k_angular * weighted,
        "scale": d,
        "zbl": 10 * t * (t + 1) // 2 if zbl == (0.0, 0.0) else 0,
    }
    network, radial, angular, scale, flexible = np.split(_values(f, sizes), np.cumsum([*sizes.values()])[:-1])
    w0, b0, w1, b1 = _network(network, own, h, d, version)
    repeat = t // own
    return NEPFile(
        version,
        names,
        rc_radial,
        rc_angular,
        l_max,
        many,
        *(np.repeat(a, repeat, axis=0) for a in (w0, b0, w1, b1)),
        *(
            _types_first(c if weighted else np.ones(n), n, k, t, version == 2)
            for c, n, k in ((radial, n_radial, k_radial), (angular, n_angular, k_angular))
        ),
        scale,
        _flexible(flexible, t, f) if len(flexible) else zbl,
    )


def _two(f, name):
    values = f.numbers(name)
    if len(values) != 2 or max(values) > 50:
        raise f.bad(f"expected {name} <radial> <angular>, two whole numbers up to 50")
    return values


def _zbl_line(f):
    values = f.numbers("zbl", float)
    if len(values) == 3:
        raise f.bad(
            "a third number (cutoffs from atomic radii, use_typewise_cutoff_zbl) is not supported: train without it"
        )
    if len(values) != 2 or not (values[0] < values[1] or values == [0.0, 0.0]):
        raise f.bad("expected zbl <inner> <outer> with inner < outer, or zbl 0 0")
    return tuple(values)


def _cutoffs(f, t):
    """Cutoffs of pairs: the mean of those of their types. The last two numbers are sizes of neighbour lists."""
    values = f.numbers("cutoff", float)
    if len(values) not in (2, 4, 2 * t + 2):
        raise f.bad(f"expected cutoff <radial> <angular> (once or for each of the {t} types) <two sizes of lists>")
    pairs = np.array(values[: 2 if len(values) < 2 * t + 2 or t == 1 else 2 * t]).reshape(-1, 2)
    if not (pairs > 0).all() or (pairs[:, 1] > pairs[:, 0]).any():
        raise f.bad("expected 0 < angular cutoff <= radial cutoff")
    each = np.broadcast_to(pairs, (t, 2)) if len(pairs) == 1 else pairs
    return tuple(0.5 * (c[:, None] + c[None, :]) for c in each.T)


def _degrees(f, version):
    values = f.numbers("l_max")
    flags = values[1:]
    known = not flags if version == 2 else 2 <= len(flags) <= len(MANY)
    if values[0] > _MOST_L or not known or max(flags[:1], default=0) > 2 or max(flags[1:], default=0) > 1:
        wants = "" if version == 2 else f" and 2 to {len(MANY)} flags of four- and five-body terms"
        raise f.bad(f"expected l_max <0 to {_MOST_L}>{wants}, got {' '.join(map(str, values))}")
    many = tuple(degrees for degrees, flag in zip(MANY, flags) if flag)
    if any(max(degrees) > values[0] for degrees in many):
        raise f.bad(f"terms of four or five bodies need an l_max of {max(max(m) for m in many)}, got {values[0]}")
    return values[0], many


def _values(f, sizes):
    words = [w for line in f.lines[f.at + 1 :] for w in line.split()]
    total = sum(sizes.values())
    if len(words) != total:
        raise AtcError(
            f"{f.path}: expected {total} numbers behind line {f.at + 1} "
            f"({', '.join(f'{n} {what}' for what, n in sizes.items() if n)}), found {len(words)}: the file is cut off, "
            "or its header is another model's"
        )
    try:
        values = np.array(words, float)
    except ValueError:
        values = np.array([np.nan])
    if not np.isfinite(values).all():
        raise AtcError(f"{f.path}: not all parameters behind line {f.at + 1} are finite numbers")
    return values


def _network(values, own, h, d, version):
    block = (d + 2) * h + (version == 5)
    each = values[:-1].reshape(own, block)
    w0, b0, w1 = np.split(each[:, : (d + 2) * h], [d * h, (d + 1) * h], axis=1)
    b1 = np.full(own, values[-1]) + (each[:, -1] if version == 5 else 0.0)
    return w0.reshape(own, h, d), b0, w1, b1


def _types_first(values, n, k, t, diagonal):
    c = values.reshape(n, k, t, t).transpose(2, 3, 0, 1)
    return np.ascontiguousarray(c * np.eye(n) if diagonal else c)


def _flexible(values, t, f):
    out = np.zeros((t, t, 10))
    i, j = np.triu_indices(t)
    out[i, j] = out[j, i] = values.reshape(-1, 10)
    if not (out[..., 0] < out[..., 1]).all():
        raise AtcError(f"{f.path}: ZBL numbers of a pair: expected its inner cutoff below its outer one")
    return out
