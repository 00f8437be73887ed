"""Thermal conductivity from the fluctuations of the heat current in equilibrium (Green-Kubo).

κ_c = 1/(V k_B T²) ∫_0^∞ ⟨J_c(0) J_c(t)⟩ dt, with J the heat current of the box (quantity ``heat_current``): heat flux
times volume.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError, AtcWarning
from ..estimators.cepstrum import zero_frequency
from ..estimators.correlation import Plateau, mean_and_error, running_integral, segment_integrals
from ..estimators.correlation import plateau as find_plateau
from ..pictures.drawing import save
from ..running.output import plain
from ..terminal import tell
from ..units import Units, units
from .heat_currents import HeatCurrents, heat_currents, positive

# A mean current of more than so many standard errors is no fluctuation: one in 16000, were the error known exactly.
_CURRENT = 4.0
#: Green-Kubo and cepstral values that differ by more combined standard errors are two different numbers.
_OPINIONS = 4.0
# Numerical error of the integral (from frames too far apart) that is worth a word.
_COARSE = 0.05
MIN_SAMPLES = 20  # per segment


@dataclass
class Conductivity:
    """Thermal conductivity with its error; every number in `units`, times in `time_units`.

    Attributes
    ----------
    value, stderr : mean of the three directions, and its error: standard error from the independent segments, and the
        last change of the integral
        before the plateau, added as squares
    components : {"x": (value, stderr), ...}: κ_xx, κ_yy, κ_zz over the same plateau. They differ in a crystal that is
        not cubic, or by chance.
    si, si_stderr : value and stderr in W/(m K) (two dimensions: W/K, `si_units`); None for reduced units
    plateau : (begin, end), lags over which the running integral is averaged
    converged : whether the integral had stopped to change
    time, correlation, correlation_stderr, integral, integral_stderr : (lags,) lag, ⟨J(0)·J(t)⟩/⟨J·J⟩ and the running
        integral as a conductivity
    samples, segments, dt, temperature, volume, atoms : what it was computed from
    cepstral, cepstral_stderr, cepstral_si, cepstral_si_stderr : a second opinion, from the logarithm of the current's
        power spectrum (`atc.estimators.cepstrum`): no plateau is chosen, and the directions are taken for equivalent
    cepstral_coefficients : how many coefficients of the cepstrum it took
    notes : what a reader should know before using the number
    """

    value: float
    stderr: float
    components: dict
    units: str
    si: float | None
    si_stderr: float | None
    plateau: tuple
    converged: bool
    time: np.ndarray
    time_units: str
    correlation: np.ndarray
    correlation_stderr: np.ndarray
    integral: np.ndarray
    integral_stderr: np.ndarray
    samples: int
    segments: int
    dt: float
    temperature: float
    temperature_units: str
    volume: float
    volume_units: str
    atoms: int | None = None
    source: str = ""
    notes: list = field(default_factory=list)
    si_units: str = "W/(m K)"
    cepstral: float = float("nan")
    cepstral_stderr: float = float("nan")
    cepstral_si: float | None = None
    cepstral_si_stderr: float | None = None
    cepstral_coefficients: int = 0

    def rows(self) -> list[tuple[str, str]]:
        """(what, text) to print."""
        t = self.time_units
        out = [("conductivity", f"{_pm(self.value, self.stderr)} {self.units}")]
        if self.si is not None and self.units != self.si_units:
            out.append(("", f"{_pm(self.si, self.si_stderr)} {self.si_units}"))
        each = ", ".join(f"{c} {_pm(*pair)}" for c, pair in self.components.items())
        out.append(("by direction", f"{each} {self.units}"))
        if np.isfinite(self.cepstral):
            text = f"{_pm(self.cepstral, self.cepstral_stderr)} {self.units}"
            if self.cepstral_si is not None and self.units != self.si_units:
                text += f" = {_pm(self.cepstral_si, self.cepstral_si_stderr)} {self.si_units}"
            out.append(("cepstral", f"{text} ({self.cepstral_coefficients} coefficients)"))
        still = "" if self.converged else " (the integral still changes)"
        atoms = f"{self.atoms} atoms, " if self.atoms else ""
        state = f"{self.temperature:.5g} {self.temperature_units}, {self.volume:.6g} {self.volume_units}"
        currents = f"{self.samples} currents, {self.dt:.4g} {t} apart, in {self.segments} independent segments"
        out.append(("plateau", f"{self.plateau[0]:.4g} to {self.plateau[1]:.4g} {t}{still}"))
        return [*out, ("from", f"{atoms}{state}; {currents}")]

    def print(self, console) -> None:
        """The numbers, and what to know about them."""
        tell(console, [self.source, *(f"  {key:<12}  {text}" for key, text in self.rows())], self.notes)

    def json(self) -> str:
        """Everything as JSON, numbers unrounded."""
        return json.dumps(self.__dict__, indent=2, default=plain)

    def picture(self, path) -> Path:
        """Draw the correlation function and its integral; returns the path."""
        return save(self.figure(), path)

    def figure(self):
        """A matplotlib Figure: autocorrelation above, running integral with the plateau below, bands of one standard
        error."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 6.0), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        # Behind twice the plateau there is only noise to see.
        shown = self.time <= max(2.0 * self.plateau[1], self.time[min(4, len(self.time) - 1)])
        t = self.time[shown]
        panels = (
            (above, self.correlation[shown], self.correlation_stderr[shown], "⟨J(0)·J(t)⟩ / ⟨J·J⟩"),
            (below, self.integral[shown], self.integral_stderr[shown], f"running integral ({self.units})"),
        )
        for axes, y, e, label in panels:
            axes.fill_between(t, y - e, y + e, alpha=0.3, linewidth=0, color="C0")
            axes.plot(t, y, color="C0")
            axes.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
            axes.set_ylabel(label)
        bars = {"yerr": [self.stderr], "xerr": [[np.ptp(self.plateau) / 2]] * 2, "capsize": 3, "zorder": 3}
        label = f"{_pm(self.value, self.stderr)} {self.units}"
        below.errorbar([np.mean(self.plateau)], [self.value], **bars, color="C3", label=label)
        below.legend(frameon=False)
        below.set_xlabel(f"t ({self.time_units})")
        figure.suptitle("Heat current: autocorrelation and Green-Kubo integral")
        return figure


SI, SI_PLANE = "W/(m K)", "W/K"


def _pm(value, error) -> str:
    """0.291 ± 0.012: the error with two digits, the value to the same place; – where there is no value."""
    if np.isnan(value):
        return "–"
    largest = max(abs(value), error)
    if not 1e-13 * largest < error < np.inf or largest < 1e-300:  # nothing to round by, or too small to be scaled
        return f"{value:.4g} ± {error:.2g}"
    digits, power = (int(np.floor(np.log10(x))) for x in (error, largest))
    digits = 1 - digits
    if -6 < digits < 7 or power == 0:
        return f"{value:.{max(digits, 0)}f} ± {error:.{max(digits, 0)}f}"
    return f"({_pm(value / 10.0**power, error / 10.0**power)})e{power:+d}"


def conductivity(
    source,
    pot=None,
    *,
    segments: int = 10,
    plateau=None,
    longest: float | None = None,
    dt: float | None = None,
    volume: float | None = None,
    temperature: float | None = None,
    units: str | Units | None = None,
    threads: int | None = None,
    progress=None,
) -> Conductivity:
    """Thermal conductivity by Green and Kubo: κ = 1/(V k_B T²) ∫ ⟨J(0) J(t)⟩ dt, with an error bar.

    Parameters
    ----------
    source : trajectory from `atc.read`, any iterable of Frames, `HeatCurrents`, or a (t, 3) array of heat currents
        (heat flux times volume)
        An equilibrium run (constant energy, no thermostat, no flow), frames equally spaced and close enough to resolve
        the vibrations.
    pot : potential from `atc.potential`; for frames
    segments : int
        The run is cut into so many equal parts; each gives an integral of its own, and their scatter the error. They
        must be much longer than the plateau's lag; integrals go up to half a segment.
    plateau : (begin, end), optional
        Lags over which the running integral is averaged, in the user's unit of time; default: found
        (`atc.estimators.correlation.plateau`).
    longest : the longest lag to look at, in the user's unit of time
    dt : time between samples in the user's unit; for an array, or frames without times
    volume, temperature, units : for an array: in the user's units, and which these are; for frames they override what
        the frames say
    threads, progress : see `heat_currents`

    Returns
    -------
    Conductivity, in the user's units (energy/(time·length·temperature)) and, unless these are reduced, in W/(m K).

    Raises
    ------
    AtcError
        for a series too short to cut into segments, and what `heat_currents` refuses.

    Notes
    -----
    The mean of J is not taken off: in equilibrium it is 0. Where it is not, within errors, the result says so. Elements
    or species that diffuse among each other need partial enthalpies taken off the current, which this does not do.
    """
    result = _analysed(
        _currents(source, pot, dt, volume, temperature, units, threads, progress), segments, plateau, longest
    )
    for note in result.notes:
        warnings.warn(f"{result.source}: {note}", AtcWarning, stacklevel=2)
    return result


def _analysed(currents: HeatCurrents, segments, plateau, longest) -> Conductivity:

    u = currents.units
    J = currents.J_tc[:, : u.dimension]
    if not isinstance(segments, int) or isinstance(segments, bool) or segments < 2:
        raise AtcError(f"segments={segments!r}: expected a whole number of at least 2, or there is no error to be had")
    length = len(J) // segments
    if length < MIN_SAMPLES:
        raise AtcError(
            f"{currents.source}: {len(J)} heat currents in {segments} segments leave {length} in each, but it takes "
            f"{MIN_SAMPLES} at the very least: "
            "give more frames or fewer segments"
        )
    lags = None
    if longest is not None:
        lags = round(positive(longest, "longest", u) / currents.dt) + 1
        if lags < 5:
            raise AtcError(
                f"longest={longest:g}: is less than four times the distance between samples, "
                f"{u.to_user('time', currents.dt):g}"
            )
    runs = segment_integrals(J, currents.dt, segments, lags)
    # From the integral of ⟨JJ⟩ to a conductivity in the user's units.
    scale = 1.0 / (currents.volume * u.boltzmann * currents.temperature**2) / u.factor("conductivity")
    integral_mlk = runs.integral_mlk * scale
    integral_ml = integral_mlk.mean(axis=2)
    where = find_plateau(integral_ml) if plateau is None else _given_plateau(plateau, runs, u)
    value, stderr = where.value(integral_ml)
    components = {c: where.value(integral_mlk[:, :, k]) for k, c in enumerate("xyz"[: u.dimension])}
    c0 = runs.acf_mlk[:, 0].mean()
    if not c0 > 0:
        raise AtcError(f"{currents.source}: its heat currents are all 0: are the velocities there?")
    integral, integral_stderr = mean_and_error(integral_ml)
    correlation, correlation_stderr = runs.mean(runs.acf_mlk / c0)

    notes = list(currents.notes)
    if not where.found:
        notes.append(
            "the integral had not converged at the longest lag: the value is that of the longest lags and may be too "
            "small; take a longer run "
            "or fewer segments"
        )
    moving = _flowing(J, runs, where, components, scale)
    if moving:
        notes.append(
            f"the mean heat current along {', '.join(moving)} is not 0: this is not a run in equilibrium (heat or "
            "atoms flow), and Green-Kubo does not hold"
        )
    # The trapezoidal rule's error is a third of its change from the doubled step.
    every_other = (
        running_integral(runs.acf_mlk.mean(axis=(0, 2))[: where.begin + 1 : 2, None], 2 * runs.dt)[-1, 0] * scale
    )
    coarse = abs(every_other - integral[where.begin - where.begin % 2]) / 3.0
    if where.begin >= 2 and coarse > max(stderr, _COARSE * abs(value)):
        notes.append(
            f"the frames are too far apart to resolve the current: the integral is off by about {coarse:.2g} "
            f"{_label(u)}; write them more often"
        )
    to_si = None if u.reduced else u.factor("conductivity") / _si(u.dimension).factor("conductivity")
    cepstrum = zero_frequency(J, currents.dt)
    cepstral, cepstral_stderr = cepstrum.integral * scale, cepstrum.stderr * scale
    if where.found and not moving and abs(cepstral - value) > _OPINIONS * np.hypot(stderr, cepstral_stderr):
        notes.append(
            f"cepstral analysis gives {_pm(cepstral, cepstral_stderr)} {_label(u)}, which the errors do not explain: "
            "the integral may have another plateau (look at the picture), or the directions differ"
        )
    return Conductivity(
        value=value,
        stderr=stderr,
        components=components,
        units=_label(u),
        si=None if to_si is None else value * to_si,
        si_stderr=None if to_si is None else stderr * to_si,
        si_units=SI if u.dimension == 3 else SI_PLANE,
        plateau=tuple(float(u.to_user("time", runs.dt * l)) for l in (where.begin, where.end)),
        converged=where.found,
        time=u.to_user("time", runs.time),
        time_units=u.label("time"),
        correlation=correlation,
        correlation_stderr=correlation_stderr,
        integral=integral,
        integral_stderr=integral_stderr,
        samples=len(J),
        segments=segments,
        dt=float(u.to_user("time", currents.dt)),
        temperature=float(u.to_user("temperature", currents.temperature)),
        temperature_units=u.label("temperature"),
        volume=float(u.to_user("volume", currents.volume)),
        volume_units=u.label("volume"),
        atoms=currents.atoms,
        source=currents.source,
        notes=notes,
        cepstral=cepstral,
        cepstral_stderr=cepstral_stderr,
        cepstral_si=None if to_si is None else cepstral * to_si,
        cepstral_si_stderr=None if to_si is None else cepstral_stderr * to_si,
        cepstral_coefficients=cepstrum.coefficients,
    )


def _flowing(J_tc, runs, where, components, scale) -> list[str]:
    """Directions along which the mean current is no fluctuation: that of a run of length T has the variance 2/T ∫ ⟨J(0)
    J(t)⟩ dt."""
    length, middle = len(J_tc) * runs.dt, 0.5 * (where.begin + where.end) * runs.dt
    out = []
    for c, mean, samples in zip("xyz", J_tc.mean(axis=0), J_tc.T):
        # A constant current adds its square to every ⟨J(0) J(t)⟩. Never less than what uncorrelated samples would give.
        variance = 2.0 / length * max(components[c][0] / scale - mean**2 * middle, 0.5 * runs.dt * samples.var())
        if mean**2 > _CURRENT**2 * variance:
            out.append(c)
    return out


def conductivity_of_scene(
    scene, *, segments=10, plateau=None, longest=None, dt=None, jobs: int = 1, progress=None
) -> Conductivity:
    """`conductivity` of the trajectory and potential of a scene; `jobs` threads within a frame (0: all processors). The
    notes are not warned of."""
    from ..planning.job import cores

    threads = cores(jobs)
    pot = scene.potential()
    if pot is None:
        need = 'the heat current needs one: lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file"'
        raise scene.need("potential", need)
    currents = heat_currents(scene.trajectory(), pot, dt=dt, threads=threads, progress=progress)
    return _analysed(currents, segments, plateau, longest)


def _si(dimension) -> Units:
    return units("si").planar if dimension == 2 else units("si")


def _label(u: Units) -> str:
    return u.label("conductivity")


def _given_plateau(given, runs, u):

    try:
        begin, end = (float(t) for t in given)
    except (TypeError, ValueError):
        raise AtcError(f"plateau={given!r}: expected two times, begin and end ({u.label('time')})") from None
    lags = [round(u.to_internal("time", t) / runs.dt) for t in (begin, end)]
    if not 0 < lags[0] <= lags[1] < runs.lags:
        last = u.to_user("time", runs.time[-1])
        raise AtcError(
            f"plateau={begin:g},{end:g}: expected 0 < begin <= end <= {last:.6g} {u.label('time')}, the longest lag: "
            "give fewer segments, or a longer run"
        )
    return Plateau(lags[0], lags[1], 0.0, True)


def _currents(source, pot, dt, volume, temperature, units_, threads, progress) -> HeatCurrents:
    if isinstance(source, HeatCurrents):
        return source
    if isinstance(source, (str, Path)):
        raise AtcError(
            f"{source}: give frames, not a file name: atc.conductivity(atc.read({str(source)!r}), potential)"
        )
    listed = isinstance(source, (list, tuple)) and len(source) and np.ndim(source[0]) == 1
    if isinstance(source, np.ndarray) or listed:
        given = {"dt": dt, "volume": volume, "temperature": temperature, "units": units_}
        missing = [name for name, value in given.items() if value is None]
        if missing:
            raise AtcError(
                f"heat currents as an array need {', '.join(missing)}: give them as keywords, in the units of the array"
            )
        u = units(units_)
        J = np.asarray(source, dtype=np.float64)
        if J.ndim != 2 or J.shape[1] != 3 or not np.isfinite(J).all():
            raise AtcError(f"heat currents: expected an array of shape (times, 3) of finite numbers, got {J.shape}")
        return HeatCurrents(
            u.to_internal("energy_current", J), positive(dt, "dt", u), positive(volume, "volume", u, "volume"),
            positive(temperature, "temperature", u, "temperature"), u,
        )  # fmt: skip
    if pot is None:
        raise AtcError(
            "no potential was given, but the heat current needs one: give the pair_style/pair_coeff lines of the run"
        )
    out = heat_currents(source, pot, dt=dt, threads=threads, progress=progress)
    if units_ is not None and units(units_).name != out.units.name:
        raise AtcError(f"{out.source}: is in {out.units.name!r} units, not {units(units_).name!r}: leave units out")
    if volume is not None:
        out.volume = positive(volume, "volume", out.units, "volume")
    if temperature is not None:
        out.temperature = positive(temperature, "temperature", out.units, "temperature")
    return out
