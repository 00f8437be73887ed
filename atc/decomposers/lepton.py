"""Formulas that users write in LAMMPS's lepton styles, with their derivatives: parsed here, never handed to ``eval``.

Numbers, + - * / ^, brackets, the functions of the Lepton library, ``zbl(zi, zj, r)``, and definitions behind
semicolons, as in ``4*eps*((sig/r)^12 - (sig/r)^6); eps = 0.01; sig = 3.4``.
"""

from __future__ import annotations

import ast

import numpy as np

from ..units import Units
from .pairs.input import fill
from .pairs.pairs import PairStyle
from .pairs.zbl import universal_screening
from .registry import StyleInput, pair_style

_LONGEST = 4000
_DEEPEST = 120
_ROOT_PI = np.sqrt(np.pi)


def _flat(x):
    return np.zeros_like(np.asarray(x, float))


def _erf(x):
    from scipy.special import erf  # a tenth of a second, for few

    return erf(x)


def _erfc(x):
    from scipy.special import erfc

    return erfc(x)


# name: (value, slope) as functions of the argument.
_ONE = {
    "sqrt": (np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "exp": (np.exp, np.exp),
    "log": (np.log, lambda x: 1 / x),
    "sin": (np.sin, np.cos),
    "cos": (np.cos, lambda x: -np.sin(x)),
    "tan": (np.tan, lambda x: 1 / np.cos(x) ** 2),
    "sec": (lambda x: 1 / np.cos(x), lambda x: np.tan(x) / np.cos(x)),
    "csc": (lambda x: 1 / np.sin(x), lambda x: -1 / (np.tan(x) * np.sin(x))),
    "cot": (lambda x: 1 / np.tan(x), lambda x: -1 / np.sin(x) ** 2),
    "asin": (np.arcsin, lambda x: 1 / np.sqrt(1 - x * x)),
    "acos": (np.arccos, lambda x: -1 / np.sqrt(1 - x * x)),
    "atan": (np.arctan, lambda x: 1 / (1 + x * x)),
    "sinh": (np.sinh, np.cosh),
    "cosh": (np.cosh, np.sinh),
    "tanh": (np.tanh, lambda x: 1 / np.cosh(x) ** 2),
    "erf": (_erf, lambda x: 2 / _ROOT_PI * np.exp(-x * x)),
    "erfc": (_erfc, lambda x: -2 / _ROOT_PI * np.exp(-x * x)),
    "step": (lambda x: np.where(np.asarray(x) >= 0, 1.0, 0.0), _flat),
    "delta": (lambda x: np.where(np.asarray(x) == 0, 1.0, 0.0), _flat),
    "square": (lambda x: x * x, lambda x: 2 * x),
    "cube": (lambda x: x * x * x, lambda x: 3 * x * x),
    "recip": (lambda x: 1 / x, lambda x: -1 / (x * x)),
    "abs": (np.abs, np.sign),
    "floor": (np.floor, _flat),
    "ceil": (np.ceil, _flat),
}
_MORE = {"atan2": 2, "min": 2, "max": 2, "select": 3, "zbl": 3}


class LeptonFormula:
    """An energy as a function of r and of other named variables, and its derivative with respect to r.

    Parameters
    ----------
    text : the formula, with definitions behind semicolons
    variables : names that it may use besides r and what it defines
    units : Units of r and of the energy, for ``zbl``

    Raises ValueError with what is wrong.
    """

    def __init__(self, text: str, variables=(), units: Units | None = None):
        self.text, self.units = text, units
        if len(text) > _LONGEST:
            raise ValueError(f"a formula of more than {_LONGEST} characters")
        first, *definitions = ["".join(part.split()) for part in text.split(";")]
        self.variables = ("r", *variables)
        self.definitions = {}
        for part in definitions:
            name, sign, body = part.partition("=")
            if part and (not sign or not name.isidentifier()):
                raise ValueError(f"expected a definition such as eps=0.01 behind the semicolon, got {part!r}")
            if part:
                tree = self._parse(body)
                early = self.definitions.keys() & {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
                if early:
                    # LAMMPS takes such a name for 0 without a word.
                    raise ValueError(
                        f"{name} uses {min(early)}, which is defined in front of it: Lepton wants definitions behind "
                        "their uses"
                    )
                self.definitions[name] = tree
        self.tree = self._parse(first)
        # Unknown names and circles show now.
        with np.errstate(all="ignore"):
            self(np.ones(1), **{name: np.ones(1) for name in variables})

    def _parse(self, text):
        try:
            return ast.parse(text.replace("^", "**"), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ValueError(f"{text!r} is no formula") from None

    def __call__(self, r, **others):
        """Energies and derivatives with respect to r, in the formula's own units."""
        r = np.asarray(r, float)
        known = {"r": (r, np.ones_like(r))} | {name: (v, 0.0) for name, v in others.items()}
        u, du = self._value(self.tree, known, 0)
        return np.broadcast_to(u, r.shape), np.broadcast_to(du, r.shape)

    def _value(self, node, known, depth):
        """(value, derivative) of a node."""
        if depth > _DEEPEST:
            raise ValueError("the formula is nested too deeply, or a definition uses itself")
        value = lambda n: self._value(n, known, depth + 1)  # noqa: E731
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            return float(node.value), 0.0
        if isinstance(node, ast.Name):
            if node.id not in known and node.id in self.definitions:
                known[node.id] = value(self.definitions[node.id])
            if node.id in known:
                return known[node.id]
            hint = ": LAMMPS variables are not known here, write the number" if node.id.startswith("v_") else ""
            raise ValueError(
                f"{node.id} is neither {' nor '.join(self.variables)} nor defined behind a semicolon{hint}"
            )
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            v, dv = value(node.operand)
            return (-v, -dv) if isinstance(node.op, ast.USub) else (v, dv)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return _BINARY[type(node.op)](*value(node.left), *value(node.right))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._function(node.func.id, [value(a) for a in node.args])
        raise ValueError(
            f"{ast.unparse(node)!r} is not understood: there are + - * / ^ and {', '.join([*_ONE, *_MORE])}"
        )

    def _function(self, name, arguments):
        if len(arguments) != (1 if name in _ONE else _MORE.get(name, -1)):
            known = (
                "is no function of Lepton"
                if name not in _ONE and name not in _MORE
                else f"takes {_MORE.get(name, 1)} argument(s), got {len(arguments)}"
            )
            raise ValueError(f"{name}() {known}")
        if name in _ONE:
            ((x, dx),) = arguments
            f, slope = _ONE[name]
            return f(x), slope(x) * dx
        (a, da), (b, db), *rest = arguments
        if name == "atan2":
            return np.arctan2(a, b), (b * da - a * db) / (a * a + b * b)
        if name in ("min", "max"):
            first = a < b if name == "min" else a >= b
            return np.where(first, a, b), np.where(first, da, db)
        if name == "select":
            return np.where(np.asarray(a) != 0, b, rest[0][0]), np.where(np.asarray(a) != 0, db, rest[0][1])
        if np.any(da) or np.any(db):
            raise ValueError("the nuclear charges in zbl(zi, zj, r) must be numbers")
        u, du = universal_screening(self.units, a, b, rest[0][0])
        return u, du * rest[0][1]


def _power(a, da, b, db):
    a, b = np.asarray(a, float), np.asarray(b, float)
    u = a**b
    # The logarithm only where the exponent varies: negative bases have none.
    return u, b * a ** (b - 1) * da + (u * np.log(a) * db if np.any(db) else 0.0)


_BINARY = {
    ast.Add: lambda a, da, b, db: (a + b, da + db),
    ast.Sub: lambda a, da, b, db: (a - b, da - db),
    ast.Mult: lambda a, da, b, db: (a * b, da * b + a * db),
    ast.Div: lambda a, da, b, db: (np.true_divide(a, b), np.true_divide(da * b - a * db, np.multiply(b, b))),
    ast.Pow: _power,
}


class Lepton(PairStyle):
    """U(d) as a formula by pair of types (LAMMPS ``lepton``, ``lepton/coul``).

    formulas : list of `LeptonFormula`; which : (n_types + 1, n_types + 1) index of each pair's, −1 for none; cutoff :
        same shape, internal units
    charged : whether they may name the charges qi and qj, of which qi qj/r is an energy in the unit style
    """

    name = "lepton"

    def __init__(
        self, formulas, which, cutoff, units: Units, *, shift: bool = False, charged: bool = False, dielectric=1.0
    ):
        self.formulas, self.which, self.units, self.needs_charges = formulas, which, units, charged
        self.weight = "coul" if charged else "lj"
        # As in LAMMPS, qi qj/r is an energy: each charge carries the root of the Coulomb constant.
        self.root = np.sqrt(units.coulomb / dielectric / (units.energy * units.length))
        self._set(cutoff, np.zeros_like(cutoff))
        if shift:
            for i, j in np.argwhere(cutoff > 0):
                at_end, _ = formulas[which[i, j]](np.array([cutoff[i, j] / units.length]))
                self.table[i, j, 1] = at_end[0] * units.energy

    def prepare(self, frame):
        return frame.charges * self.root if self.needs_charges else None

    def add(self, types, i, j, d2, weights, U, G, prepared):
        ti, tj = types[i], types[j]
        row = self.table[ti, tj]
        near = d2 < row[:, 0]
        which = self.which[ti, tj]
        for k, formula in enumerate(self.formulas):
            b = np.flatnonzero(near & (which == k))
            d = np.sqrt(d2[b])
            charges = {"qi": prepared[i[b]], "qj": prepared[j[b]]} if self.needs_charges else {}
            with np.errstate(all="ignore"):
                u, du = formula(d / self.units.length, **charges)
                w = weights[b] if len(weights) else 1.0
                U[b] += w * (u * self.units.energy - row[b, 1])
                G[b] += w * du * (self.units.energy / self.units.length) / d


def formula_word(inp, line, word: str, variables=()) -> LeptonFormula:
    """The formula of a coefficient line."""
    try:
        return LeptonFormula(word, variables, inp.units)
    except ValueError as e:
        raise inp.error(f"{inp.command}: the formula {word!r}: {e}", line) from None


@pair_style("lepton", "lepton/coul")
def _lepton_style(inp: StyleInput):
    charged = inp.name == "lepton/coul"
    if len(inp.args) > 1:
        raise inp.error(
            f"{inp.command} {' '.join(inp.args[1:])}: only a cutoff is supported, no keywords for long-range "
            "electrostatics"
        )
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    if charged and inp.modify.shift:
        raise inp.error(f"{inp.command}: pair_modify shift does not go with this style (LAMMPS refuses it too)")
    formulas = []

    def read(line):
        if not 1 <= len(line.words) <= 2:
            raise inp.wrong(
                f"pair_coeff of {inp.name} takes a formula (in quotes, or without blanks) and [cutoff]", line
            )
        (cut,) = inp.numbers(line.words[1:], [("cutoff", "length")], line, optional=1)
        formulas.append(formula_word(inp, line, line.words[0], ("qi", "qj") if charged else ()))
        return len(formulas), rc if cut is None else cut

    which, cutoff = fill(inp, inp.by_pair(read), 2)
    more = {"shift": inp.modify.shift, "charged": charged, "dielectric": inp.units.coulomb / inp.coulomb}
    return Lepton(formulas, which.astype(int) - 1, cutoff, inp.units, **more)
