"""Molecular-dynamics trajectories to continuum fields.

Array names carry their axes, as in matscipy: suffix n atom, b bond, t triplet, g grid point, c Cartesian direction:
``x_nc``, ``G_b``, ``r_bc``, ``stress_gcc``. Inside, everything is in one unit system (`atc.units`).

The public calls are loaded when first used, so that ``import atc`` stays instant.
"""

from __future__ import annotations

__version__ = "0.10.1"

_LAZY = {
    "read": "atc.readers",
    "read_grid": "atc.readers.lammps.grid",
    "potential": "atc.decomposers",
    "nep": "atc.decomposers.many_body.nep",
    "calculator": "atc.analysis.calculator",
    "kim": "atc.decomposers.many_body.kim",
    "edge_model": "atc.decomposers.learned.edge_model",
    "mace": "atc.decomposers.learned.mace",
    "nequip": "atc.decomposers.learned.nequip",
    "metatomic": "atc.decomposers.learned.metatomic",
    "kernel": "atc.kernels",
    "Grid": "atc.grids",
    "fields": "atc.running.run",
    "Live": "atc.running.live",
    "Scene": "atc.config.scene",
    "select": "atc.estimators.selections",
    "open_dataset": "atc.running.opening",
    "compare": "atc.analysis.compare",
    "compare_with_lammps": "atc.analysis.against_lammps",
    "report": "atc.analysis.page",
    "conductivity": "atc.analysis.green_kubo",
    "profile": "atc.analysis.interface",
    "heat_currents": "atc.analysis.heat_currents",
    "verify": "atc.agreement.verify",
    "twin": "atc.twins.run",
    "Crystal": "atc.upscaling.crystal",
    "dispersion": "atc.upscaling.dispersion",
    "elastic_constants": "atc.upscaling.elasticity",
    "Frame": "atc.frame",
    "Cell": "atc.frame",
    "Topology": "atc.frame",
    "AtcError": "atc.errors",
    "AtcWarning": "atc.errors",
}

# What hands out datasets brings `ds.atc` with it, which needs xarray loaded.
_WITH_ACCESSOR = {"fields", "open_dataset", "Live"}

__all__ = [*_LAZY, "__version__"]


def __getattr__(name):
    if name in _LAZY:
        from importlib import import_module

        value = getattr(import_module(_LAZY[name]), name)
        if name in _WITH_ACCESSOR:
            import_module("atc.analysis.accessor")
        globals()[name] = value
        return value
    raise AttributeError(f"module 'atc' has no attribute {name!r}")


def __dir__():
    return sorted(__all__)
