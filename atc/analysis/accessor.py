"""`ds.atc` and `da.atc`: what one does with fields, at the xarray objects themselves.

Registered with `atc.fields` and `atc.open_dataset`; ``import atc.analysis.accessor`` does it for datasets that xarray
opened in a program without these.
"""

from __future__ import annotations

import xarray as xr

from ..errors import AtcError
from ..pictures import components

#: The order of ASE's six components.
VOIGT = ("xx", "yy", "zz", "yz", "xz", "xy")


def _scalar(da, name: str, dimension: int):
    """One scalar of a tensor or vector field; units and coordinates stay."""
    tail = [d for d in ("i", "j") if d in da.dims]
    if not tail:
        raise AtcError(f"{da.name or 'this field'}: it is a scalar, which has no component {name!r}")
    values = components.component(da.transpose(..., *tail).values, name, dimension, rank=len(tail))
    out = da.isel(dict.fromkeys(tail, 0), drop=True).copy(data=values)
    what = components.SYMBOL.get(name, name)
    out.attrs["long_name"] = f"{what} of the {da.attrs.get('long_name', da.name)}"
    if name in ("vonmises", "max_shear", "magnitude"):
        out.attrs["sign_convention"] = "never negative"
    elif name == "pressure":
        out.attrs["sign_convention"] = "compression positive"
    out.name = f"{da.name}_{name}" if da.name else name
    return out


class _Scalars:
    """The scalars of tensors and vectors, of a field that `_field(quantity)` finds."""

    def component(self, name: str, quantity: str | None = None):
        """One scalar of a field: ``"xx"`` … ``"zy"``, ``"hydrostatic"``, ``"pressure"``, ``"vonmises"``,
        ``"max_shear"``, ``"principal1"`` … ``"principal3"`` of a tensor, ``"x"``, ``"y"``, ``"z"``, ``"magnitude"`` of
        a vector.

        Parameters
        ----------
        name : which scalar
        quantity : at a dataset, which field (default the stress)

        Returns
        -------
        xarray.DataArray without the dimensions i and j, in the field's units

        Raises
        ------
        AtcError : for a scalar that the field does not have
        """
        da, dimension = self._field(quantity)
        return _scalar(da, name, dimension)

    def vonmises(self, quantity: str | None = None):
        """√(3/2 s:s), s the deviator of the tensor's symmetric part."""
        return self.component("vonmises", quantity)

    def hydrostatic(self, quantity: str | None = None):
        """tr σ/3 (in two dimensions tr σ/2): tension positive, as the stress."""
        return self.component("hydrostatic", quantity)

    def pressure(self, quantity: str | None = None):
        """−tr σ/3 (in two dimensions −tr σ/2): compression positive."""
        return self.component("pressure", quantity)

    def magnitude(self, quantity: str | None = None):
        """The length of a vector."""
        return self.component("magnitude", quantity)

    def voigt(self, quantity: str | None = None):
        """(…, voigt) the components xx, yy, zz, yz, xz, xy of the tensor's symmetric part, as ASE orders them; ASE's
        sign is that of the stresses here: tension positive."""
        da, dimension = self._field(quantity)
        values = [_scalar(0.5 * (da + da.transpose(..., "j", "i").values), c, dimension) for c in VOIGT]
        out = xr.concat(values, dim=xr.Variable("voigt", list(VOIGT))).transpose(..., "voigt")
        out.name = f"{da.name}_voigt" if da.name else "voigt"
        out.attrs = {**da.attrs, "long_name": f"{da.attrs.get('long_name', da.name)}, in Voigt's order"}
        return out

    def principal(self, quantity: str | None = None):
        """(…, principal) principal values of the tensor's symmetric part, the largest first; in two dimensions the two
        in the plane."""
        da, dimension = self._field(quantity)
        values = [_scalar(da, f"principal{k + 1}", dimension) for k in range(dimension)]
        out = xr.concat(values, dim=xr.Variable("principal", range(1, dimension + 1)))
        out = out.transpose(..., "principal")
        out.name = f"{da.name}_principal" if da.name else "principal"
        out.attrs["long_name"] = f"principal values of the {da.attrs.get('long_name', da.name)}, the largest first"
        return out


@xr.register_dataarray_accessor("atc")
class FieldAccessor(_Scalars):
    """`da.atc`: scalars of one field."""

    def __init__(self, da):
        self._da = da

    def plot(self, **options):
        """xarray's own picture, with the field's symbol on its axis or colour bar: ``ds.stress.sel(i="x",
        j="y").atc.plot()`` says σ_xy, where xarray alone can only name the field. options : those of `DataArray.plot`
        """
        from ..pictures.geometry import unit_text
        from ..pictures.symbols import label

        da = self._da
        comp = "".join(str(da.coords[d].values) for d in ("i", "j") if d in da.coords and da.coords[d].ndim == 0)
        axes = () if set(comp) <= set("xyz") else tuple(dict.fromkeys(comp))
        if axes:  # r, phi, z: along other axes
            where = {a: "xyz"[k] for k, a in enumerate(axes)}
            comp = "".join(where[str(da.coords[d].values)] for d in ("i", "j") if d in da.coords)
        named = da.copy(deep=False)
        named.attrs = {**da.attrs, "long_name": label(str(da.name), comp or None, "", axes)}
        if "units" in da.attrs:
            named.attrs["units"] = unit_text(str(da.attrs["units"]))
        return named.plot(**options)

    def _field(self, quantity=None):
        if quantity is not None:
            raise AtcError(f"{self._da.name or 'this array'} is one field: name a quantity at the dataset only")
        return self._da, int(self._da.attrs.get("dimension", 3))


@xr.register_dataset_accessor("atc")
class DatasetAccessor(_Scalars):
    """`ds.atc`: scalars, pictures and the comparison with the virial stress of an output of `atc.fields`."""

    def __init__(self, ds):
        self._ds = ds

    def _field(self, quantity=None):
        from ..pictures.plotting import pick

        if quantity in self._ds.data_vars:  # of the box and of atoms, too
            return self._ds[quantity], int(self._ds.attrs.get("dimension", 3))
        return self._ds[pick(self._ds, quantity)], int(self._ds.attrs.get("dimension", 3))

    def section_force(self, axis: str | None = None, quantity: str | None = None):
        """Forces through the cross-sections normal to an axis; see `atc.analysis.sections.section_force`."""
        from .sections import section_force

        return section_force(self._ds, axis, quantity)

    def section_stress(self, axis: str | None = None, quantity: str | None = None, bulk: float | None = None):
        """Net section stress: these forces over the area of matter; see `atc.analysis.sections.section_stress`."""
        from .sections import section_stress

        return section_stress(self._ds, axis, quantity, bulk)

    def in_units(self, units: str):
        """The dataset in other units where one of them is of a variable's dimension: ``"GPa, nm"``, or a preset."""
        from ..units.words import in_units

        return in_units(self._ds, units)

    def quantify(self, registry=None):
        """The dataset with pint's units (by pint-xarray): reduced units (lj) are dimensionless, ASE's time is
        Å √(amu/eV).

        Parameters
        ----------
        registry : pint.UnitRegistry, default pint-xarray's own

        Raises
        ------
        AtcError where pint-xarray is not installed.
        """
        try:
            import pint_xarray
        except ImportError:
            raise AtcError("quantities with units need pint-xarray: pip install pint-xarray") from None
        ds, given = self._ds, {}
        reduced = ds.attrs.get("units") == "lj"
        for name, v in ds.variables.items():
            text = v.attrs.get("units")
            if text is None or (name in ds.coords and name in ds.dims):
                continue
            given[name] = "dimensionless" if reduced else str(text).replace("t_ase", "(angstrom*(amu/eV)**0.5)")
        return ds.pint.quantify(given, unit_registry=registry or pint_xarray.unit_registry)

    def plot(self, quantity: str | None = None, **options):
        """A picture (matplotlib.figure.Figure), as `atc plot` draws it; see `atc.pictures.plotting.plot`."""
        from ..pictures.plotting import plot

        return plot(self._ds, quantity, **options)

    def plot_slice(self, quantity: str | None = None, slice: str = "z=0.5", **options):
        """A plane through a 3-D grid: ``slice="z=0.5"`` (fraction of the axis) or ``"z=12.5A"`` (distance)."""
        return self.plot(quantity, slice=slice, **options)

    def compare(self, *, frame=None):
        """Hardy's stress against the virial stress; see `atc.compare`."""
        from .compare import compare

        return compare(self._ds, frame=frame)
