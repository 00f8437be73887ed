"""Section 4 of "Peridynamics as an upscaling of molecular dynamics" (2009), computed again: nonlocal linear springs."""

from __future__ import annotations

from .report import Report
from .springs_coarse import coarse
from .springs_pulse import square
from .springs_series import series, stability
from .springs_waves import dispersion, local_nonlocal


def springs_report(folder, progress=lambda text: None) -> Report:
    """Every figure and table of section 4 into `folder`: report.html, pictures, numbers.json, springs.nc. About half a
    minute."""
    report = Report("Nonlocal linear springs: molecular dynamics, peridynamics, the wave equation", folder)
    report.numbers["reduced units"] = "modulus K1 = 1, density 1, so sound speed 1"
    for what, section in (
        ("series", series),
        ("stability (Fig. 4.2)", stability),
        ("simulations (Figs. 4.3, 4.4, Table 4.1)", dispersion),
        ("local and nonlocal (Fig. 4.5)", local_nonlocal),
        ("square pulse (Fig. 4.6)", square),
        ("better coarse models", coarse),
    ):
        progress(what)
        section(report)
    report.write()
    return report
