"""How finely the coordinates of a file are written: the step of their last digit."""

from __future__ import annotations

import numpy as np


def decimal_resolution(x, sample: int = 3000) -> tuple[float, str]:
    """Estimate the absolute resolution of binary coordinates from a sample: the distance of neighbouring numbers that
    could occur.

    The coarsest power of ten of which all sampled values are multiples (to rounding in the number type they came from),
    if there is one coarser than the spacing of that type; else the spacing itself at the largest value. The number type
    is float32 if every sampled value survives float32. Fewer than 30 values that are not 0 say nothing, nor do atoms on
    the sites of a perfect lattice: the spacing is reported.
    """
    x = np.asarray(x, dtype=np.float64).ravel()
    x = x[:: max(1, len(x) // sample)]
    x = x[np.isfinite(x) & (x != 0)]
    if not len(x):
        return 0.0, "no coordinates"
    with np.errstate(over="ignore"):
        single = bool((x == x.astype(np.float32)).all())
    kind = np.float32 if single else np.float64
    big = np.abs(x).max()
    spacing = float(np.spacing(kind(big)))
    name = "float32" if single else "float64"
    if len(x) >= 30:
        top = int(np.ceil(np.log10(big)))
        for e in range(top, int(np.floor(np.log10(spacing))), -1):
            step = 10.0**e
            if step <= 8 * spacing:
                break
            # Values a unit conversion has touched carry a few roundings of the type they had.
            off = np.abs(x - np.round(x / step) * step)
            if (off <= 4 * np.spacing(np.abs(x).astype(kind)).astype(np.float64)).all():
                return (spacing, name) if _on_few_sites(x, step) else (step, f"decimals ({name})")
    return spacing, name


def _on_few_sites(x, step) -> bool:
    """Whether multiples of `step` are so because atoms sit on a lattice: rounding leaves numbers that fill the
    multiples within their range as evenly as chance does, a lattice repeats few of them, or is as coarse as the step.

    Of N numbers thrown at M multiples, M (1 - exp(-N/M)) differ; a lattice has less than a fifth of it.
    """
    multiples = np.round(x / step)
    m = np.ptp(multiples) + 1
    if m < 4 * np.cbrt(len(x) / 3):  # atoms closer than four steps: no trajectory is so coarse
        return True
    return len(np.unique(multiples)) < 0.2 * m * -np.expm1(-len(x) / m)


def text_resolution(tokens) -> tuple[float, str]:
    """Estimate the absolute resolution of printed coordinates from a sample of their text, in the units they are
    printed in; 0 where it does not show.

    All with the same number of decimals: a fixed format, resolution 10^-decimals. Otherwise the largest number of
    significant digits in the sample is taken for the format's (``%g`` prints 6 and drops trailing zeros), and the
    resolution is that of the largest value. Atoms on the sites of a perfect lattice (2, 4, 6.5) end before the format
    does, if no number ends in a zero after the point, which a format that drops none would have written: fewer digits
    than ``%g`` has say nothing then.
    """
    digits, decimals, values, exponential, trimmed = 0, set(), [], False, True
    for token in tokens:
        t = token.lstrip("+-").lower()
        mantissa, _, exponent = t.partition("e")
        exponential |= bool(exponent)
        whole, _, fraction = mantissa.partition(".")
        if not (whole + fraction).isdigit():
            continue
        decimals.add(len(fraction) - (int(exponent) if exponent else 0))
        digits = max(digits, len((whole + fraction).lstrip("0")))
        trimmed &= not fraction.endswith("0")
        values.append(float(token))
    big = max(map(abs, values), default=0.0)
    if not big:
        return 0.0, "no coordinates"
    digits = min(digits, 17)
    fixed = len(decimals) == 1 and not exponential and max(decimals) > 0
    step = 10.0 ** -max(decimals) if fixed else 10.0 ** (np.floor(np.log10(big)) + 1 - digits)
    if trimmed and digits < _SHORTEST and _on_few_sites(np.array(values), step):
        return 0.0, "unknown: atoms on lattice sites, whose numbers are shorter than their format"
    return max(step, float(np.spacing(big))), f"{max(decimals)} decimals" if fixed else f"{digits} significant digits"


# Digits of the shortest format that drops zeros, %g.
_SHORTEST = 6


def text_resolution_of_frames(tokens_of, has) -> tuple[float, str]:
    """`text_resolution` of the first frame, or, where it does not show there (atoms start on a lattice), of a later one
    of the same file.

    tokens_of : frame number → sample of its coordinates as text
    has : frame number → whether there is such a frame
    """
    first = text_resolution(tokens_of(0))
    for k in (1, 3, 7, 15, 31):
        if first[0] or not has(k):
            break
        later = text_resolution(tokens_of(k))
        if later[0]:
            return later
    return first
