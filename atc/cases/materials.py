"""Which materials there are and which constants each takes: from the engine's own classes, so that a new one needs no
word here."""

from __future__ import annotations

import inspect

from ..config.schema import INFLUENCE_EXPECTED, Key, _boolean, _influence, _not_negative, _number, _positive
from ..config.words import guess
from ..errors import AtcError
from .influence import influence_of

_DENSITY = Key(_positive, "a mass per volume greater than 0")


def _correction(v):
    if v is not False and v != "energy":
        raise ValueError
    return v


def made(cls, table, horizon):
    """The material that the constants in `table` define, of a body of this horizon."""
    given = {p: table[p] for p in parameters(cls) if p in table}
    if "influence" in given:
        given["influence"] = influence_of(cls, given["influence"], horizon)
    if given.get("surface_correction") is False:
        del given["surface_correction"]
    return cls(**given)


def models() -> dict:
    """{name: class} of the engine's materials that numbers define: a function of the bond has no place in a file."""
    from ..pd import materials
    from ..pd.materials.base import Material

    classes = [v for v in vars(materials).values() if inspect.isclass(v) and issubclass(v, Material)]
    return {c.name.lower().replace(" ", "_"): c for c in classes if c is not Material and c.by_numbers}


def parameters(cls) -> list[str]:
    """The names of what a material's class takes."""
    return [p for p in inspect.signature(cls.__init__).parameters if p != "self"]


def _value(name):
    if name in ("volume_correction",):
        return Key(_boolean, "true or false")
    if name == "influence":
        return Key(_influence, INFLUENCE_EXPECTED)
    if name == "surface_correction":
        return Key(_correction, '"energy", or false')
    if name == "stabilisation":
        return Key(_not_negative, "a number, 0 or more, e.g. 0.1")
    if name in ("poisson",):
        return Key(_number, "a number, e.g. 0.25")
    if name == "fraction":
        return Key(_not_negative, "a share between 0 and 1, e.g. 0.5")
    if name == "expansion":
        return Key(_number, "a strain per temperature, e.g. 2.6e-6")
    return Key(_number if name.startswith("lam") else _positive, "a number greater than 0")


def sampled_well(case, k, material, body) -> None:
    """Hold the elastic constants that the lattice of a case makes of an isotropic material to those of its moduli: a
    warning beyond 2 %, an error beyond 10 %. Of bond-based ones only a warning, since 14 % is what the horizon of
    three spacings, which everybody takes, comes to."""
    import warnings

    from ..errors import AtcWarning
    from ..pd.sampling import MODULI_REFUSE, MODULI_WARN, lattice_error

    table = case.data["material"][k]
    if "region" not in case.data["body"] or table["model"] not in models() or "c" in table or not len(body.bonds):
        return
    off = lattice_error(material, body)
    if off <= MODULI_WARN:
        return
    said = (
        f"{case.where('body', 'horizon')}: [body] horizon: {body.horizon / body.spacing:.4g} spacings sample "
        f"{table['model']} so coarsely that elastic constants are up to {100 * off:.2g} % off those of its moduli"
    )
    advice = 'a larger horizon in spacings, surface_correction = "energy"'
    if not off <= MODULI_REFUSE and table["model"] != "pmb":
        raise AtcError(f"{said}: take {advice}, correspondence or bond-associated")
    warnings.warn(f"{said}; more accurate are {advice}, correspondence or bond-associated", AtcWarning, stacklevel=4)


def keys_of(model, complain) -> dict[str, Key]:
    """The keys of a material of this model, apart from what every material has. `complain(why)` makes the error for an
    unknown model."""
    from .crystals import KEYS

    known = models()
    if isinstance(model, str) and model in KEYS:
        return {"density": _DENSITY, **KEYS[model]}
    if not isinstance(model, str) or model not in known:
        names = [*known, *KEYS]
        raise complain(f"unknown {model!r}: {guess(str(model), names)}known: {', '.join(names)}")
    return {"density": _DENSITY, **{p: _value(p) for p in parameters(known[model])}}
