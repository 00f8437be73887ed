"""What a dispersion found: words, tables, JSON, dataset and picture."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..terminal import tell
from .branches import is_cubic
from .crystal import Crystal
from .elasticity import GPA, ElasticConstants
from .force_constants import ForceConstants, frequency_unit
from .matching import Match
from .vibrations import Measured


@dataclass
class Ray:
    """Frequencies along one direction from Γ, or along a piece of a path through the zone (ω in internal units,
    ascending; imaginary ones negative).

    direction : of the conventional cell, and boundary, |k| of the zone boundary there; of a piece of a path a unit
        vector and its length. ends : the names of its two points, of a piece of a path
    """

    direction: tuple
    boundary: float
    fractions: np.ndarray
    k_kc: np.ndarray
    lattice_km: np.ndarray | None = None
    velocity_km: np.ndarray | None = None
    phonopy_km: np.ndarray | None = None
    models: dict = field(default_factory=dict)
    ends: tuple[str, str] | None = None

    @property
    def moving(self) -> np.ndarray:
        """Where k is not 0."""
        return np.linalg.norm(self.k_kc, axis=1) > 1e-9 * self.boundary

    def difference(self, name) -> np.ndarray:
        """(k, b) ω of a model over that of the lattice, minus 1, branch by branch in ascending order: of a model with
        fewer branches of the lowest. Not a number where the lattice does not vibrate."""
        model = self.models[name]
        lattice = self.lattice_km[:, : model.shape[1]]
        moving = lattice > 1e-6 * self.lattice_km.max()
        return np.divide(model, lattice, out=np.full(model.shape, np.nan), where=moving) - 1.0

    @property
    def label(self) -> str:
        if self.ends is not None:
            return "–".join(self.ends)
        return "[" + "".join(f"{d:g}" for d in self.direction) + "]"


#: Of a fitted line: name in `lineshapes.Line`, what it is, and what kind of number.
LINE_COLUMNS = (
    ("omega", "frequency of the line", "frequency"),
    ("omega_error", "its standard error", "frequency"),
    ("gamma", "γ/2π, full width at half maximum of the line", "frequency"),
    ("gamma_error", "its standard error", "frequency"),
    ("power", "⟨|v|²⟩ of the mode, kT if it is classical", "energy"),
    ("misfit", "mean square of data over fit less 1, over what it should be", "1"),
)


@dataclass
class Dispersion:
    """What `dispersion` found. Internal units; `table`, `json`, `dataset` and `picture` are in the user's.

    folded : what to say where the crystal's cell is not primitive
    crystal : at the lattice constant everything refers to. stress : pressure there (compression positive, user's unit),
        None without a potential.
    """

    crystal: Crystal
    rays: list[Ray]
    fc: ForceConstants | None = None
    elastic: ElasticConstants | None = None
    pressure: float | None = None
    relaxed: Crystal | None = None
    matches: list[Match] = field(default_factory=list)
    measured: Measured | None = None
    structure_factors: object = None
    phonopy_difference: float | None = None
    potential: str = ""
    notes: list = field(default_factory=list)
    scene: str = ""
    folded: str = ""

    # ---- words

    def rows(self) -> list[tuple[str, str]]:
        """(what, text) to print."""
        u = self.crystal.units
        length = u.label("length")
        unit, factor = frequency_unit(u)
        out = [("crystal", f"{self.crystal.name}, lattice constant {self.crystal.lattice_constant:.7g} {length}")]
        if self.pressure is not None:
            at_zero = ""
            if self.relaxed is not None:
                at_zero = f"; {self.relaxed.lattice_constant:.7g} {length} at zero pressure"
            out.append(("pressure", f"{self.pressure:.4g} {u.label('pressure')}{at_zero}"))
        if self.fc is not None:
            how = {
                "analytic": "second derivatives of the pair potential",
                "displacements": "displaced atoms, sixth order",
            }[self.fc.method]
            reach = f"{u.to_user('length', self.fc.reach):.4g} {length}"
            out.append(("force constants", f"{len(self.fc.i)} bonds up to {reach}; {how}"))
        if self.elastic is not None:
            scale, name = (1.0 / u.pressure, u.label("pressure")) if u.reduced else (GPA, "GPa")
            c = self.elastic.C_vv * scale
            if is_cubic(self.elastic, 1e-5):
                c11, c12, c44 = (x * scale for x in self.elastic.cubic)
                born = self.elastic.born_vv[3, 3] * scale
                more = f" (C44 {born:.4g} if the basis could not relax)" if abs(born / c44 - 1) > 1e-6 else ""
                out.append(("elastic constants", f"C11 {c11:.4f}, C12 {c12:.4f}, C44 {c44:.4f} {name}{more}"))
            else:
                rows = [" ".join(f"{x:10.4f}" for x in row) for row in c]
                out += [("elastic constants", f"{rows[0]}  {name}"), *(("", row) for row in rows[1:])]
        for ray in self.rays:
            if ray.lattice_km is not None:
                # At Γ what rounding leaves of 0 is no imaginary frequency.
                shown = np.where(
                    np.abs(ray.lattice_km[-1]) < 1e-6 * np.abs(ray.lattice_km).max(), 0.0, ray.lattice_km[-1]
                )
                ends = ", ".join(f"{x:.6g}" if x >= 0 else f"{-x:.6g}i" for x in factor * shown)
                out.append((f"{ray.label} boundary" if ray.ends is None else ray.ends[1], f"{ends} {unit}"))
        if self.phonopy_difference is not None:
            out.append(("phonopy", f"agrees to {factor * self.phonopy_difference:.1e} {unit}"))
        return out

    def tables(self) -> list[str]:
        """Text tables: models and measured points."""
        u = self.crystal.units
        unit, factor = frequency_unit(u)
        lines = []
        if self.matches:
            lines.append("relative error of ω (%), rms over the branches, at fractions of the zone boundary:")
            head = "".join(f"{f:>9g}" for f in self.matches[0].fractions)
            lines.append(f"  {'model':<26}{head}{'all':>9}{'zone':>9}{'min ω²':>10}{'stable step':>14}")
            for m in self.matches:
                cells = "".join(f"{100 * x:9.3f}" for x in np.sqrt((m.error_bf**2).mean(axis=0)))
                step = u.to_user("time", m.stable_step)
                low = f"{m.min_omega2:10.2e}" if m.stable else f"{m.min_omega2:9.1e}!"
                lines.append(
                    f"  {m.label:<26}{cells}{100 * m.rms:9.3f}{100 * m.band:9.3f}{low}{step:11.4g} {u.label('time')}"
                )
            lines.append(
                "  (zone: rms over the whole zone; min ω²: smallest beyond the first zone up to 4·2π/a, of the "
                "crystal's largest; ! marks an unstable model; steps are 2/ω_max)"
            )
        lines += self._differences()
        r = self.measured
        if r is not None:
            temperature = f"{r.temperature:.4g} {u.label('temperature')}"
            lines.append(
                f"measured in {r.source.rsplit(' frame ', 1)[0]}: {r.frames} frames, {temperature}, errors from "
                f"{r.blocks} blocks; {unit}:"
            )
            lines.append(f"  {'k':<14}{'harmonic':>10}{'ratio':>20}{'spectrum':>20}")
            harmonic = self.fc.frequencies(r.k_kc) if self.fc is not None else np.full(r.ratio_km.shape, np.nan)
            for p in range(len(r.k_kc)):
                for m in range(r.ratio_km.shape[1]):
                    place = f"{self.rays[r.ray_k[p]].label} {round(r.fraction_k[p], 9) + 0.0:.4g}" if m == 0 else ""
                    lines.append(
                        f"  {place:<14}{_number(factor * harmonic[p, m]):>10}"
                        f"{_pm(factor * r.ratio_km[p, m], factor * r.ratio_error_km[p, m]):>20}"
                        f"{_pm(factor * r.spectrum_km[p, m], factor * r.spectrum_error_km[p, m]):>20}"
                    )
            if r.lines_km is not None:
                lines += self._line_table(unit, factor)
        return lines

    def _differences(self) -> list[str]:
        """PD beside the lattice along the rays: the largest difference of all branches, with its sign."""
        names = list(self.rays[0].models) if self.rays else []
        if not names:
            return []
        on_path = self.rays[0].ends is not None
        places = (0.0, 0.25, 0.5, 0.75, 1.0) if on_path else (0.25, 0.5, 0.75, 1.0)
        what = "pieces of the path" if on_path else "the zone boundary"
        head = "".join(f"{f:>9g}" for f in places)
        out = [
            f"PD less lattice, ω (%): the largest of the branches, at fractions of {what} (–: no wave of the model):",
            f"  {'model':<26}{'along':<10}{head}",
        ]
        for name in names:
            for ray in self.rays:
                d = 100 * ray.difference(name)[[int(np.argmin(np.abs(ray.fractions - f))) for f in places]]
                worst = [row[np.nanargmax(np.abs(row))] if np.isfinite(row).any() else np.nan for row in d]
                cells = "".join(f"{x:+9.2f}" if np.isfinite(x) else f"{'–':>9}" for x in worst)
                out.append(f"  {name:<26}{ray.label:<10}{cells}")
        return out

    def _line_table(self, unit, factor) -> list[str]:
        r, time = self.measured, self.crystal.units
        name = {"lorentzian": "Lorentzian lines", "oscillator": "damped oscillators"}[r.shape]
        out = [
            f"linewidths: {name}; γ/2π, full width at half maximum in {unit}, 1/γ, lifetime of the energy, in "
            f"{time.label('time')}:",
            f"  {'k':<14}{'frequency':>20}{'γ/2π':>20}{'1/γ':>20}{'misfit':>8}",
        ]
        for p, row in enumerate(r.lines_km):
            for m, x in enumerate(row):
                place = f"{self.rays[r.ray_k[p]].label} {round(r.fraction_k[p], 9) + 0.0:.4g}" if m == 0 else ""
                life = time.to_user("time", 1.0 / x.gamma)
                out.append(
                    f"  {place:<14}{_pm(factor * x.omega, factor * x.omega_error):>20}"
                    f"{_pm(factor * x.gamma, factor * x.gamma_error):>20}"
                    f"{_pm(life, life * x.gamma_error / x.gamma):>20}"
                    f"{'' if not np.isfinite(x.misfit) else f'{x.misfit:.2f}':>8}"
                )
        return out

    def print(self, console) -> None:
        tell(console, [*(f"{key:<18}  {text}" for key, text in self.rows()), *self.tables()], self.notes)

    def json(self) -> str:
        """Everything as JSON: frequencies in THz (1/tau in reduced units), lengths in the user's unit, elastic
        constants in the user's pressure unit."""
        u, (unit, factor) = self.crystal.units, frequency_unit(self.crystal.units)

        def clean(x):
            if isinstance(x, (list, tuple, np.ndarray)):
                return [clean(v) for v in x]
            return None if x is None or not np.isfinite(x) else float(x)

        out = {
            "crystal": self.crystal.name,
            "lattice_constant": self.crystal.lattice_constant,
            "length_unit": u.label("length"),
            "frequency_unit": unit,
            "pressure": self.pressure,
            "pressure_unit": u.label("pressure"),
            "relaxed_lattice_constant": self.relaxed.lattice_constant if self.relaxed is not None else None,
            "elastic_constants": clean(self.elastic.to_user()) if self.elastic is not None else None,
            "phonopy_difference": clean(factor * self.phonopy_difference)
            if self.phonopy_difference is not None
            else None,
            "potential": self.potential,
            "notes": self.notes,
            "rays": [
                {"direction": clean(ray.direction), "fractions": clean(ray.fractions)}
                | ({} if ray.ends is None else {"ends": list(ray.ends)})
                | ({"lattice": clean(factor * ray.lattice_km)} if ray.lattice_km is not None else {})
                | {name: clean(factor * x) for name, x in ray.models.items()}
                for ray in self.rays
            ],
            "models": [
                {
                    "label": m.label,
                    "branches": m.branches,
                    "fractions": clean(m.fractions),
                    "relative_error": clean(m.error_bf),
                    "rms": m.rms,
                    "rms_zone": m.band,
                    "velocity_error": clean(m.velocity_error_bf),
                    "min_omega2": m.min_omega2,
                    "stable": m.stable,
                    "stable_step": float(u.to_user("time", m.stable_step)),
                    "time_unit": u.label("time"),
                }
                for m in self.matches
            ],
        }
        r = self.measured
        if r is not None:
            out["measured"] = {
                "direction": [clean(self.rays[p].direction) for p in r.ray_k],
                "fraction": clean(r.fraction_k),
                "ratio": clean(factor * r.ratio_km),
                "ratio_error": clean(factor * r.ratio_error_km),
                "spectrum": clean(factor * r.spectrum_km),
                "spectrum_error": clean(factor * r.spectrum_error_km),
                "temperature": r.temperature,
                "frames": r.frames,
                "blocks": r.blocks,
            }
            if self.rays[0].ends is not None:
                out["measured"]["on"] = [self.rays[p].label for p in r.ray_k]
            if r.lines_km is not None:
                out["measured"]["shape"] = r.shape
                for name, *_ in LINE_COLUMNS:
                    size = 1.0 if name in ("misfit", "power") else factor
                    out["measured"][f"line_{name}"] = clean(size * r.line(name))
        return json.dumps(out, indent=2)

    # ---- data

    def dataset(self):
        """An `xarray.Dataset`: curves over (ray, point, branch), measured points over (k, branch), residuals over
        (model, residual_branch, fraction)."""
        import xarray as xr

        from .. import __version__

        u, (unit, factor) = self.crystal.units, frequency_unit(self.crystal.units)
        modes = 3 * len(self.crystal)
        hz = {"units": unit, "long_name": "frequency ω/2π; imaginary ones negative"}
        per_length = {"units": f"1/{u.label('length')}"}
        k_user = 1.0 / u.to_user("length", 1.0)
        data, coords = {}, {"branch": np.arange(modes), "c": ["x", "y", "z"], "ray": [r.label for r in self.rays]}
        stack = lambda get: np.stack([get(r) for r in self.rays])  # noqa: E731

        def put(name, dims, values, units, what):
            data[name] = (dims, values, {"units": units, "long_name": what})

        about = {"units": "1", "long_name": "|k| over the zone boundary's"}
        coords["fraction"] = ("point", self.rays[0].fractions, about)
        data["wave_vector"] = (("ray", "point", "c"), stack(lambda r: r.k_kc) * k_user, per_length)
        if self.fc is not None:
            data["frequency"] = (("ray", "point", "branch"), factor * stack(lambda r: r.lattice_km), hz)
            slope = u.to_user("velocity", stack(lambda r: r.velocity_km))
            put("group_velocity", ("ray", "point", "branch"), slope, u.label("velocity"), "dω/d|k| along the ray")
        if all(r.phonopy_km is not None for r in self.rays):
            data["frequency_phonopy"] = (("ray", "point", "branch"), factor * stack(lambda r: r.phonopy_km), hz)
        names = list(self.rays[0].models)
        if names:
            coords["model"] = names
            curves = np.full((len(names), len(self.rays), len(self.rays[0].fractions), modes), np.nan)
            for a, name in enumerate(names):
                values = stack(lambda r, name=name: r.models[name])
                curves[a, ..., : values.shape[-1]] = factor * values
            data["frequency_model"] = (("model", "ray", "point", "branch"), curves, hz)
            off = np.full(curves.shape, np.nan)
            for a, name in enumerate(names):
                values = stack(lambda r, name=name: r.difference(name))
                off[a, ..., : values.shape[-1]] = values
            what = "ω of the model over ω of the lattice, minus 1, branch by branch"
            put("model_difference", ("model", "ray", "point", "branch"), off, "1", what)
        if self.matches:
            coords["residual_branch"] = self.matches[0].branches
            coords["residual_fraction"] = self.matches[0].fractions
            get = lambda name: np.array([getattr(m, name) for m in self.matches])  # noqa: E731
            dims = ("model", "residual_branch", "residual_fraction")
            put("relative_error", dims, get("error_bf"), "1", "ω of the model over ω of the crystal, minus 1")
            put("velocity_error", dims, get("velocity_error_bf"), "1", "error of dω/dk over the speed of sound")
            put("rms_error", "model", get("rms"), "1", "rms of relative_error over branches and fractions")
            put("rms_error_zone", "model", get("band"), "1", "the same over the whole zone")
            what = "smallest ω² beyond the zone over the crystal's largest"
            put("min_omega2", "model", get("min_omega2"), "1", what)
            put("stable_step", "model", u.to_user("time", get("stable_step")), u.label("time"), "2/ω_max")
        if self.elastic is not None:
            coords["voigt_1"] = coords["voigt_2"] = ["xx", "yy", "zz", "yz", "xz", "xy"]
            both, label = ("voigt_1", "voigt_2"), u.label("pressure")
            put("elastic_constants", both, self.elastic.to_user(), label, "C, basis relaxed")
            put("elastic_constants_born", both, self.elastic.to_user("born_vv"), label, "C, basis clamped")
        r = self.measured
        if r is not None:
            data["measured_wave_vector"] = (("k", "c"), r.k_kc * k_user, per_length)
            data["measured_ray"] = ("k", r.ray_k)
            data["measured_fraction"] = ("k", r.fraction_k, {"units": "1"})
            for name, label in (
                ("ratio", "from the ratio of velocities and displacements"),
                ("ratio_error", "its standard error"),
                ("spectrum", "peak of the velocity spectrum"),
                ("spectrum_error", "its standard error"),
            ):
                put(f"measured_{name}", ("k", "branch"), factor * getattr(r, f"{name}_km"), unit, label)
            if r.current_kcf is not None:
                coords["spectrum_frequency"] = ("frequency_bin", factor * r.frequency_f, {"units": unit})
                coords["polarisation"] = ["longitudinal", "transverse"]
                dims = ("k", "polarisation", "frequency_bin")
                put("current_spectrum", dims, r.current_kcf, "arbitrary", "power of the mass current")
            if r.sed_kf is not None:
                energy = u.to_user("energy", 1.0) * u.to_user("time", 1.0)
                what = "energy per angular frequency; its integral over ω is ½kT a mode"
                label = f"{u.label('energy')}*{u.label('time')}"
                put("spectral_energy_density", ("k", "frequency_bin"), energy * r.sed_kf, label, what)
            for name, what, kind in LINE_COLUMNS if r.lines_km is not None else ():
                unit_here = unit if kind == "frequency" else "1" if kind == "1" else u.label("energy")
                size = factor if kind == "frequency" else 1.0 if kind == "1" else u.to_user("energy", 1.0)
                put(f"line_{name}", ("k", "branch"), size * r.line(name), unit_here, what)
            if r.lines_km is not None:
                gamma, error = r.line("gamma"), r.line("gamma_error")
                life = u.to_user("time", 1.0 / gamma)
                put("lifetime", ("k", "branch"), life, u.label("time"), "1/γ, of the mode's energy")
                put("lifetime_error", ("k", "branch"), life * error / gamma, u.label("time"), "its error")
        if self.structure_factors is not None:
            s = self.structure_factors
            data |= {f"structure_{name}": (v.dims, v.values, v.attrs) for name, v in s.data_vars.items()}
            coords |= {name: (v.dims, v.values, v.attrs) for name, v in s.coords.items() if name != "c"}
        attrs = {
            "atc_version": __version__,
            "crystal": self.crystal.name,
            "lattice_constant": self.crystal.lattice_constant,
            "length_unit": u.label("length"),
            "potential": self.potential,
            "notes": "; ".join(self.notes),
            "folded": self.folded,
            "scene": self.scene,
        }
        if self.pressure is not None:
            attrs["pressure"] = self.pressure
        if self.phonopy_difference is not None:
            attrs["phonopy_difference"] = float(factor * self.phonopy_difference)
        if r is not None:
            attrs |= {
                "source": Path(r.source.split(" frame ")[0]).name,
                "temperature": r.temperature,
                "frames": r.frames,
                "blocks": r.blocks,
            }
        return xr.Dataset(data, coords, attrs)

    def save(self, path) -> None:
        """Write the dataset: .nc or .zarr."""
        from ..running.whole import write_dataset

        write_dataset(self.dataset(), path)

    def write_phonopy(self, folder) -> list:
        """Write phonopy.yaml, FORCE_CONSTANTS and, along a path or rays, band.yaml; see `phonopy_bridge`."""
        from .phonopy_bridge import write_phonopy
        from .zone import Segment

        if self.fc is None:
            raise AtcError("phonopy's files hold force constants, which a potential gives: give a [potential]")
        ends = lambda ray: ray.ends if ray.ends is not None else ("Γ", ray.label)  # noqa: E731
        return write_phonopy(self.fc, folder, [Segment(ends(ray), ray.k_kc[[0, -1]]) for ray in self.rays])

    # ---- picture

    def figure(self):
        """A matplotlib Figure: a panel for each direction or piece of the path; lattice, phonopy, models, measured
        points with error bars, and behind them the spectral energy density of the run; below, how far the models are
        from the lattice, in per cent."""
        from .dispersion_drawing import figure

        return figure(self)

    def picture(self, path) -> Path:
        """Draw `figure` into a file; returns the path."""
        from ..pictures.drawing import save

        return save(self.figure(), path)


def _number(x) -> str:
    return "" if not np.isfinite(x) else f"{x:.4f}" if x >= 0 else f"{-x:.4f}i"


def _pm(x, e) -> str:
    return "–" if not np.isfinite(x) else f"{x:.4f} ± {e:.4f}" if np.isfinite(e) else f"{x:.4f}"
