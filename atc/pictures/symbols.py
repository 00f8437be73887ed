"""What fields are called in papers: σ_xx, ρ, T, q, in matplotlib's mathematics."""

from __future__ import annotations

from .components import SYMBOL, TENSOR

#: {field: (letter, superscript)}
LETTERS = {
    "stress": (r"\sigma", ""),
    "stress_kinetic": (r"\sigma", "K"),
    "stress_potential": (r"\sigma", "U"),
    "virial_stress": (r"\sigma", r"\mathrm{vir}"),
    "smoothed_virial_stress": (r"\sigma", r"\mathrm{vir}"),
    "smoothed_virial_stress_kinetic": (r"\sigma", r"\mathrm{vir},K"),
    "smoothed_virial_stress_potential": (r"\sigma", r"\mathrm{vir},U"),
    "peridynamic_stress": (r"\nu", ""),
    "piola_stress": ("P", ""),
    "eshelby_stress": (r"\Sigma", ""),
    "density": (r"\rho", ""),
    "number_density": ("n", ""),
    "momentum": (r"\pi", ""),
    "velocity": ("v", ""),
    "temperature": ("T", ""),
    "energy": ("e", ""),
    "energy_kinetic": ("e", "K"),
    "energy_potential": ("e", "U"),
    "heat_flux": ("q", ""),
    "heat_flux_kinetic": ("q", "K"),
    "heat_flux_potential": ("q", "U"),
    "heat_flux_churning": ("q", "C"),
    "energy_flux": ("J", ""),
    "churning": ("z", ""),
    "velocity_gradient": (r"\partial v", ""),
    "strain_rate": ("D", ""),
    "vorticity": (r"\omega", ""),
    "displacement": ("u", ""),
    "displacement_gradient": (r"\partial u", ""),
    "body_force": ("b", ""),
}
_SUBSCRIPTS = {
    "hydrostatic": r"\mathrm{m}",
    "vonmises": r"\mathrm{vM}",
    "principal1": "1",
    "principal2": "2",
    "principal3": "3",
}
#: Scalars that stand for the field: their words say enough.
_ALONE = ("vonmises", "hydrostatic", "pressure", "max_shear", "principal1", "principal2", "principal3")


_GREEK = {"phi": r"\phi", "theta": r"\theta"}


def in_axes(comp: str, axes) -> str:
    """A component as it is called along other axes than x, y, z: xy is r phi along (r, phi, z)."""
    letters = [_GREEK.get(axes["xyz".index(c)], axes["xyz".index(c)]) for c in comp]
    return " ".join(letters) if any(w.startswith("\\") for w in letters) else "".join(letters)


def symbol(name: str, comp: str | None = None, axes=()) -> str | None:
    """The field's letter with its component, as mathematics; None for fields that have none. axes : what components
    are along, if not x, y, z"""
    if name not in LETTERS:
        return None
    letter, above = LETTERS[name]
    sup = f"^{{{above}}}" if above else ""
    if comp is None:
        return f"${letter}{sup}$"
    if comp in TENSOR or comp in ("x", "y", "z"):
        return f"${letter}{sup}_{{{in_axes(comp, axes) if axes else comp}}}$"
    if comp == "magnitude":
        return f"$|{letter}{sup}|$"
    if comp == "pressure" and letter == r"\sigma":
        return f"$p{sup}$"
    if comp == "max_shear" and letter == r"\sigma":
        return rf"$\tau{sup}_{{\mathrm{{max}}}}$"
    return f"${letter}{sup}_{{{_SUBSCRIPTS[comp]}}}$" if comp in _SUBSCRIPTS else None


def label(name: str, comp: str | None, unit: str, axes=()) -> str:
    """Of an axis, a panel or a colour bar: symbol and unit; words where the symbol alone would say too little."""
    found, words = symbol(name, comp, axes), name.replace("_", " ")
    component = comp is not None and (comp in TENSOR or comp in ("x", "y", "z"))
    if found is None and component:
        text = f"{words}$_{{{in_axes(comp, axes) if axes else comp}}}$"
    elif found is None:
        text = words if comp is None else f"{words}, {SYMBOL[comp]}"
    elif component:
        text = found
    elif comp in _ALONE:
        of = "" if LETTERS[name][0] == r"\sigma" else f" of {words}"
        text = f"{SYMBOL[comp]}{of} {found}"
    else:
        text = f"{words} {found}"
    return f"{text} ({unit})" if unit else text
