"""Bonds and angles of mesoscopic carbon nanotubes (LAMMPS ``mesocnt``), with coefficients of one's own."""

from __future__ import annotations

import numpy as np

from .angle import SMALL, AngleStyle
from .bond import HarmonicBond
from .topology import degrees, energy


def _custom(inp, line, at: int):
    """The words behind ``custom``."""
    if line.words[at : at + 1] == ("C",):
        raise inp.error(
            f"{inp.kind}_coeff of mesocnt: coefficients that LAMMPS makes from the chirality of a tube are not "
            "supported: give them with custom",
            line,
        )
    if line.words[at : at + 1] != ("custom",):
        raise inp.wrong(f"{inp.kind}_coeff of mesocnt: expected custom", line)
    return line.words[at + 1 :]


class MesoBond(HarmonicBond):
    """U = K (d − r0)² (LAMMPS ``mesocnt`` with ``custom``). Coefficients K [energy/length²], r0 [length]."""

    name = "mesocnt"

    @classmethod
    def read(cls, inp, line):
        return inp.numbers(_custom(inp, line, 0), cls.wants, line)


class MesoAngle(AngleStyle):
    """U = K x², x = 180° − θ, and from the buckling angle x_b on K x_b² + K_b (x − x_b) (LAMMPS ``mesocnt``,
    ``harmonic|buckling custom``).

    Coefficients K [energy/rad²], K_b [energy/rad], x_b [degrees]. For ``harmonic`` x_b is infinite.
    """

    name = "mesocnt"
    wants = (("K", energy), ("K_b", energy), ("x_b", degrees))

    @classmethod
    def read(cls, inp, line):
        mode = line.words[0] if line.words else ""
        if mode not in ("harmonic", "buckling"):
            raise inp.error(f"angle_coeff of mesocnt: expected harmonic or buckling, got {mode or 'nothing'}", line)
        numbers = inp.numbers(_custom(inp, line, 1), cls.wants if mode == "buckling" else cls.wants[:1], line)
        return numbers if mode == "buckling" else (numbers[0], 0.0, np.inf)

    def curve(self, a, K, K_b, x_b):
        x = np.pi - a.theta
        buckled = x > x_b
        near = np.where(buckled, x_b, x)
        U = K * near * near + np.where(buckled, K_b * (x - near), 0.0)
        # dU/dcos θ = U'(x)/sin θ; x/sin θ has a limit at 180°.
        ratio = a.deviation_over_sine(-x, np.full(len(x), np.pi))
        return U, np.where(buckled, K_b / np.maximum(a.sin, SMALL), -2.0 * K * ratio)
