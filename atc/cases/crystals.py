"""Materials of a case that a crystal and its potential define, ``cauchy-born`` and ``linear``, and springs of
``linear`` by formulas of the bond.

A crystal's constants come in the units of its potential. A case with one is in SI, or in reduced units where the
potential's are.
"""

from __future__ import annotations

import re
import warnings

import numpy as np

from .. import pd
from ..config.checks import (
    INFLUENCE_EXPECTED,
    Key,
    either,
    influence,
    list_of,
    not_negative,
    positive,
    string,
    takes,
)
from ..config.formula import Formula
from ..config.schema import SCHEMA as SCENE
from ..errors import AtcError, AtcWarning
from ..pd.sampling import MODULI_REFUSE, MODULI_WARN, sampled_constants
from ..units import units as get
from ..upscaling.crystal import Crystal, axes_of, relax
from ..upscaling.elasticity import elastic_constants
from .schema import number_or_formula

_LETTERS = ("x", "y", "z", "r", "delta")


_component = number_or_formula(_LETTERS)
_CRYSTAL = {
    "potential": SCENE["potential"]["lammps"],
    "units": SCENE["potential"]["units"],
    "structure": SCENE["twin"]["structure"],
    "lattice_constant": Key(positive, "a length greater than 0 in the potential's units, e.g. 5.43"),
    "mass": Key(either(positive, list_of(positive)), "of an atom (of diamond's two) in the potential's units"),
    "orient": SCENE["twin"]["orient"],
}
KEYS = {
    "cauchy-born": {
        **_CRYSTAL,
        "stabilisation": Key(not_negative, "a number, 0 or more, e.g. 0.1"),
        "influence": Key(influence, INFLUENCE_EXPECTED),
    },
    "linear": {
        **_CRYSTAL,
        "micromodulus": Key(
            either(list_of(list_of(_component, 3), 3), takes({"type": "string"})(lambda v: _component(string(v)))),
            'formulas of x, y, z, r and delta: c of central springs, or three rows of C(xi), e.g. "1e9*(1 - r/delta)"',
        ),
    },
}
_NEEDED = ("potential", "structure", "lattice_constant", "mass")


def check(case) -> None:
    """Raise for what these materials lack, or what does not go with them."""
    body = case.data["body"]
    for path, m in case.tables_of("material"):
        model = m["model"]
        if model not in KEYS:
            continue
        if "micromodulus" in m:
            case.refuse(path, m, _CRYSTAL, "micromodulus is given: its formulas define the springs")
        elif missing := [key for key in _NEEDED if key not in m]:
            other = " (or micromodulus, formulas)" if model == "linear" else ""
            raise case.wrong(path, f"{model} needs {missing[0]}{other}")
        if body.get("dimension", 3) != 3:
            raise case.bad(("body", "dimension"), f"{model} is for bodies in three dimensions: leave it out")
        if model != "linear":
            continue
        if len(case.data["material"]) > 1:
            raise case.bad((*path, "model"), "a body of linear springs has one material")
        lattice = {k: v for k, v in body.items() if v}  # no jitter is none
        why = "linear springs are for the nodes of a lattice: give region and spacing"
        case.refuse(("body",), lattice, ("file", "jitter"), why)
        for section in ("contact", "damage"):
            if section in case.data:
                raise AtcError(f"{case.where(section)}: [{section}]: linear springs know none: leave it out")
        case.refuse(path, m, ("s00", "Gc"), "linear springs do not break: leave it out")


def has_density(m) -> bool:
    """Whether a material's table says its density."""
    return "density" in m or (m.get("model") in KEYS and "micromodulus" not in m)


def density(case, k):
    """Of the crystal, in the case's units; None for other materials."""
    m = case.data["material"][k]
    if m["model"] not in KEYS or "micromodulus" in m:
        return None
    crystal, _ = _crystal(case, k)
    return _outside(crystal.units).to_user("mass", crystal.density) * _outside(crystal.units).factor("length") ** 3


def made(case, k, body):
    """The material number k of a case for its body."""
    m = case.data["material"][k]
    if "micromodulus" in m:
        return _springs(case, k, body)
    crystal, model = _crystal(case, k)
    units = _outside(crystal.units)
    axes = _axes(case, k)
    return (_cauchy_born if m["model"] == "cauchy-born" else _linear)(case, k, body, crystal, model, axes, units)


def _outside(units):
    """The units of the case."""
    return units if units.reduced else get("si")


def _crystal(case, k):
    """(Crystal at rest, Potential) of a material, made once."""
    from .. import potential

    if k not in case.crystals:
        m, where = case.data["material"][k], case.where("material", str(k), "potential")
        text, units = m["potential"], m.get("units")
        if units is None and not re.search(r"^\s*units\s", text, re.MULTILINE):
            raise AtcError(f'{where}: [material] potential has no units: give units, e.g. units = "metal"')
        pot = potential(text + "\n", units=units, folder=case.folder, name=where)
        crystal = Crystal.cubic(m["structure"], m["lattice_constant"], m["mass"], pot.units)
        case.crystals[k] = relax(crystal, pot), pot
    return case.crystals[k]


def _axes(case, k):
    """(3, 3) rows: where the crystal's x, y, z point in the body."""
    path = ("material", str(k), "orient")
    return axes_of(
        case.data["material"][k].get("orient"),
        lambda why: case.bad(path, f"the crystal directions along x, y, z {why}"),
    )


class _InUnits:
    """A crystal's law in the units of the case."""

    def __init__(self, law, pressure):
        self.law, self.pressure = law, pressure
        self.moduli_vv = pressure * law.moduli_vv

    def __call__(self, H_ncc):
        W, P = self.law(H_ncc)
        return self.pressure * W, self.pressure * P


def _cauchy_born(case, k, body, crystal, model, axes, units):
    from ..upscaling.cauchy_born import CauchyBorn, CrystalLaw, StrainEnergy
    from .influence import influence_of

    exact = CauchyBorn(crystal, model)
    _require_stable(case, k, exact.moduli_vv)
    law = _InUnits(CrystalLaw(exact, StrainEnergy.fitted(exact), axes), units.to_user("pressure", 1.0))
    m = case.data["material"][k]
    given = {"stabilisation": m["stabilisation"]} if "stabilisation" in m else {}
    if "influence" in m:
        given["influence"] = influence_of(pd.Hyperelastic, m["influence"], body.horizon)
    material = pd.Hyperelastic(law, **given)
    if "region" in case.data["body"]:
        found = sampled_constants(material, body.spacing * np.eye(3), body.horizon, density(case, k))
        _judge(case, k, found, law.moduli_vv)
    return material


def _linear(case, k, body, crystal, model, axes, units):
    from ..upscaling.force_constants import force_constants
    from ..upscaling.node_kernel import NodeKernel, node_kernel, wave_constants

    turned = crystal.strained(axes.T - np.eye(3))
    C = elastic_constants(turned, model)
    _require_stable(case, k, C.C_vv)
    length = units.factor("length")
    try:
        kernel = node_kernel(
            force_constants(turned, model), C, body.spacing * length * np.eye(3), body.horizon * length
        )
    except AtcError as e:
        raise case.bad(("body", "horizon"), str(e).replace(" in [twin]", "")) from None
    _judge(case, k, wave_constants(kernel), C.C_vv)
    per_length2 = units.to_user("energy", 1.0) * length**2
    return pd.Linear(
        NodeKernel(
            kernel.step_cc / length,
            kernel.offsets_bc,
            kernel.springs_bcc * per_length2,
            units.to_user("mass", kernel.mass),
            kernel.volume / length**3,
        )
    )


class _Micromodulus:
    """C(ξ) by formulas."""

    def __init__(self, given, delta, complain):

        self.delta, self.complain, self.central = delta, complain, isinstance(given, str)
        self.formulas = [[Formula(str(c), _LETTERS) for c in row] for row in ([[given]] if self.central else given)]

    def __call__(self, xi_bc):
        r = np.linalg.norm(xi_bc, axis=1)
        values = dict(zip("xyz", xi_bc.T), r=r, delta=self.delta)
        parts = [[np.broadcast_to(f.finite(self.complain, **values), r.shape) for f in row] for row in self.formulas]
        if self.central:
            n = xi_bc / r[:, None]
            return parts[0][0][:, None, None] * n[:, :, None] * n[:, None, :]
        return np.moveaxis(np.array(parts), 2, 0)


def _springs(case, k, body):
    """Springs by formulas; their sums over nodes must be near the integrals."""
    law = _Micromodulus(
        case.data["material"][k]["micromodulus"],
        body.horizon,
        lambda why: case.bad(("material", str(k), "micromodulus"), why),
    )
    xi = body.bonds.xi_bc(body.X_nc)[:1000]
    C = law(xi)
    for other, why in ((C.swapaxes(1, 2), "C(xi) must be symmetric"), (law(-xi), "C(-xi) must be C(xi)")):
        if not np.abs(other - C).max(initial=0.0) <= 1e-10 * np.abs(C).max(initial=0.0):
            raise case.bad(("material", str(k), "micromodulus"), f"{why}, or the body would gain momentum or energy")
    n = np.arange(-int(body.horizon / body.spacing) - 1, int(body.horizon / body.spacing) + 2)
    xi = body.spacing * np.stack(np.meshgrid(n, n, n), axis=-1).reshape(-1, 3)
    r = np.linalg.norm(xi, axis=1)
    xi = xi[(r > 0) & (r <= body.horizon * (1 + 1e-10))]
    nodes = 0.5 * np.einsum("bik,bj,bl->ikjl", law(xi), xi, xi) * body.spacing**3
    x, w = _ball(body.horizon)
    whole = 0.5 * np.einsum("b,bik,bj,bl->ikjl", w, law(x), x, x)
    _judge(case, k, nodes, whole)
    return pd.Linear(law)


def _ball(delta):
    """Points and weights of the integral over a ball: Gauss in r and cos θ, even in φ."""
    a, wa = np.polynomial.legendre.leggauss(48)
    b, wb = np.polynomial.legendre.leggauss(16)
    phi = 2 * np.pi * (np.arange(32) + 0.5) / 32
    r, z, p = np.meshgrid(0.5 * delta * (a + 1), b, phi, indexing="ij")
    s = np.sqrt(1 - z**2)
    x = np.stack([r * s * np.cos(p), r * s * np.sin(p), r * z], axis=-1).reshape(-1, 3)
    w = (0.5 * delta * wa)[:, None, None] * wb[None, :, None] * (2 * np.pi / 32) * r**2
    return x, w.reshape(-1)


def _require_stable(case, k, C_vv):
    if not np.linalg.eigvalsh(C_vv).min() > 0:
        raise case.bad(("material", str(k), "structure"), "the crystal is unstable under this potential: check both")


def _judge(case, k, found, wanted):
    """Warn beyond 2 %, raise beyond 10 %."""
    off = float(np.abs(found - wanted).max() / np.abs(wanted).max())
    said = (
        f"{case.where('body', 'horizon')}: [body] horizon: the elastic constants that the nodes make of material "
        f"{k + 1} are up to {100 * off:.2g} % off its own"
    )
    if not off <= MODULI_REFUSE:
        raise AtcError(f"{said}: take a smaller spacing, or another horizon")
    if off > MODULI_WARN:
        warnings.warn(f"{said}; a smaller spacing comes closer", AtcWarning, stacklevel=5)
