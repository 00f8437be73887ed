"""What holds a case's materials together and when it breaks: ``[damage]``, the strengths in ``[[material]]``, and
``[[interface]]``."""

from __future__ import annotations

import numpy as np

from ..config.words import guess
from ..pd.damage import CriticalEnergy, CriticalStretch


def _number(case, k) -> int:
    return case.data["material"][k].get("id", k + 1)


def between(case, k) -> tuple[int, int]:
    """The numbers of the two materials of interface `k`."""
    materials = case.data["material"]
    names = {m["name"]: _number(case, n) for n, m in enumerate(materials) if "name" in m}
    numbers = {_number(case, n) for n in range(len(materials))}
    out = []
    for m in case.data["interface"][k]["between"]:
        if m in names:
            out.append(names[m])
        elif m in numbers:
            out.append(m)
        else:
            known = [repr(n) for n in names] + [str(n) for n in sorted(numbers)]
            why = f"there is no material {m!r}: {guess(str(m), names)}known: {', '.join(known)}"
            raise case.bad(("interface", str(k), "between"), why)
    if out[0] == out[1]:
        raise case.bad(("interface", str(k), "between"), f"these are names of one material, number {out[0]}")
    return min(out), max(out)


def check(case, one_of):
    """Raise for what contradicts itself; returns the path of the first place that says when bonds break, or None."""
    breaking = None
    for path, t in case.tables_of("material", "interface"):
        one_of(path, t, "s00", "Gc", least=0)
        strength = [key for key in ("s00", "Gc") if key in t]
        if strength and t.get("breaks") is False:
            raise case.bad((*path, strength[0]), "breaks = false: bonds that never break have no strength")
        if strength:
            breaking = breaking or (*path, strength[0])
    names = [m["name"] for m in case.data["material"] if "name" in m]
    if len(set(names)) < len(names):
        raise case.need("material", f"two materials have the same name: {', '.join(names)}")
    pairs = {}
    for k, (path, t) in enumerate(case.tables_of("interface")):
        one_of(path, t, "between")
        pair = between(case, k)
        if pair in pairs:
            raise case.bad((*path, "between"), f"these two have an interface already, number {pairs[pair] + 1}")
        pairs[pair] = k
        useless = [key for key in t if key not in ("between", "bonded")]
        if t.get("bonded", True) is False and useless:
            raise case.bad((*path, useless[0]), "bonded = false: there are no bonds that it could say anything about")
        if t.get("bonded", True) and not useless:
            raise case.wrong(path, "says nothing: give bonded = false, stiffness, s00, Gc or breaks = false")
    damage = case.data.get("damage")
    if damage is not None:
        one_of(("damage",), damage, "s00", "Gc", least=0 if breaking else 1)
        if damage.get("criterion") == "energy":
            for path, t in [(("damage",), damage), *case.tables_of("material", "interface")]:
                case.refuse(path, t, ("s00", "alpha"), '[damage] criterion = "energy" takes Gc alone')
        breaking = ("damage",)
    for path, t in case.tables_of("material", "interface") if not breaking else ():
        case.refuse(path, t, ("alpha", "breaks"), "nothing in this case breaks: give s00 or Gc, here or in [damage]")
    return breaking


def unbonded(case) -> list[tuple[int, int]]:
    """The pairs of materials without bonds between them."""
    return [between(case, k) for k, t in enumerate(case.data.get("interface", [])) if not t.get("bonded", True)]


def stiffness(case, materials) -> dict:
    """{(a, b): factor} of the interfaces between materials that are there."""
    out = {}
    for k, t in enumerate(case.data.get("interface", [])):
        pair = between(case, k)
        for m in pair:
            if m not in materials:
                raise case.bad(("interface", str(k), "between"), f"no node of the body is made of material {m}")
        if "stiffness" in t:
            if any(materials[m].name in ("correspondence", "bond-associated") for m in pair):
                why = "bonds of correspondence materials have no stiffness of their own: "
                why += "take pmb or lps, or bonded = false, s00 or Gc"
                raise case.bad(("interface", str(k), "stiffness"), why)
            out[pair] = float(t["stiffness"])
    return out


def rules(case, materials, body, factors):
    """When bonds break, as `pd.Simulation` takes it: None, one `CriticalStretch` or `CriticalEnergy`, or
    {material or (a, b): it}.

    A material's own strength goes before that of [damage]; an interface's before that of its weaker side.
    """
    general = case.data.get("damage", {})
    out = {}
    tables = [(_number(case, k), t) for k, t in enumerate(case.data["material"])]
    tables += [(between(case, k), t) for k, t in enumerate(case.data.get("interface", []))]
    for of, t in tables:
        pair = of if isinstance(of, tuple) else None
        if any(m not in materials for m in pair or (of,)) or not t.get("bonded", True):
            continue
        if t.get("breaks") is False:
            if pair:
                out[of] = CriticalStretch(np.inf)
            continue
        own = "s00" in t or "Gc" in t
        if pair and not own:
            continue
        strength = t if own else general
        alpha = t.get("alpha", general.get("alpha", 0.0))
        if "s00" in strength:
            out[of] = CriticalStretch(strength["s00"], alpha)
        elif "Gc" in strength and general.get("criterion") == "energy":
            out[of] = CriticalEnergy(strength["Gc"])
        elif "Gc" in strength and pair:
            a, b = (materials[m] for m in pair)
            out[of] = CriticalStretch.from_energy(
                strength["Gc"], a, body, alpha, other=b, interface=factors.get(pair, 1.0)
            )
        elif "Gc" in strength:
            out[of] = CriticalStretch.from_energy(strength["Gc"], materials[of], body, alpha)
    if not out:
        return None
    # One rule for everything is simpler than many that agree.
    if len(set(out.values())) == 1 and all(m in out for m in materials):
        return next(iter(out.values()))
    return out


def require_one_model(case, materials: dict) -> None:
    """Materials of one body share the model, and how their bonds are weighted: name the line of the one that does
    not."""
    first = None
    for k in range(len(case.data["material"])):
        m = materials[_number(case, k)]
        first = m if first is None else first
        if m.model is not first.model:
            why = "the materials of one body must be of one model (elastic and lps are)"
            raise case.wrong(("material", str(k)), f"{m.name} beside {first.name}: {why}")
        for key in ("influence", "volume_correction", "surface_correction"):
            if getattr(m, key) != getattr(first, key):
                why = f"{key} is not that of the first material: bonds between them need one and the same"
                raise case.wrong(("material", str(k)), why)
