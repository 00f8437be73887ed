"""Relatives of Tersoff's potential: Kumagai's modification, ZBL cores, Gao-Weber (LAMMPS ``tersoff/mod``,
``tersoff/mod/c``, ``tersoff/zbl``, ``gw``, ``gw/zbl``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...errors import AtcError
from ..registry import pair_style
from .entries import Entry
from .tersoff import TWO, Tersoff, bond_order_style, row
from .tersoff_file import TersoffEntry
from .tersoff_kernels import GAO_WEBER, KUMAGAI, MURTY, SINE, TERSOFF

#: LAMMPS's permittivity of the vacuum for these styles, e²/(energy · Å).
_VACUUM = {"metal": 0.00552635, "real": 0.00552635 * 0.043365121}


@dataclass(frozen=True)
class TersoffModEntry(Entry):
    """One entry of a ``.tersoff.mod`` file: see `TersoffMod`. `beta` is the power of d_ij − d_ik, `beta_ters` is 1."""

    beta: float
    alpha: float
    h: float
    eta: float
    beta_ters: float
    lam2: float
    B: float
    R: float
    D: float
    lam1: float
    A: float
    n: float
    c1: float
    c2: float
    c3: float
    c4: float
    c5: float
    where: str = "the Tersoff/MOD parameters"

    what: ClassVar[str] = "Tersoff/MOD"
    signed: ClassVar[tuple] = ("beta", "alpha", "h", "beta_ters", "c1", "c2", "c3", "c4", "c5", "c0")
    energies: ClassVar[tuple] = ("A", "B")

    def check(self) -> str | None:
        if wrong := super().check():
            return wrong
        if self.beta not in (1.0, 3.0):
            return f"beta must be 1 or 3, got {self.beta:g}"
        if self.beta_ters != 1.0:
            return f"beta_ters must be 1, got {self.beta_ters:g}"
        if self.D > self.R:
            return f"D must not exceed R, got R {self.R:g} and D {self.D:g}"
        return None


@dataclass(frozen=True)
class TersoffModCEntry(TersoffModEntry):
    """`TersoffModEntry` with c0."""

    c0: float = 0.0
    energies: ClassVar[tuple] = ("A", "B", "c0")


class TersoffMod(Tersoff):
    """U = ½ Σ_{i≠j} f_C [A exp(−λ1 d) + c0 − b_ij B exp(−λ2 d)], b = (1 + ζ^η)^(−1/2n), ζ_ij = Σ_k f_C(d_ik) g(cos θ)
    exp[α (d_ij − d_ik)^β], g = c1 + c2 x/(c3 + x) · (1 + c4 exp(−c5 x)), x = (h − cos θ)²; f_C = ½ − 9/16 sin(π (r −
    R)/2D) − 1/16 sin(3π (r − R)/2D) between R − D and R + D.

    Everything else as `Tersoff`. Entries: `TersoffModEntry`; c0 is 0 in ``tersoff/mod``.

    Notes
    -----
    Source: Kumagai, Izumi, Hara & Sakai, Comp. Mat. Sci. 39, 457 (2007); Murty & Atwater, Phys. Rev. B 51, 4889 (1995).
    """

    style = "tersoff/mod"
    entry = TersoffModEntry
    form = (MURTY, KUMAGAI, KUMAGAI)

    def around(self, e):
        L = self.units.length
        return np.array([e.R * L, e.D * L, e.alpha / L, e.beta, 0.0, e.c2, e.c3, e.h, e.c1, e.c4, e.c5])

    def between(self, e):
        E, L = self.units.energy, self.units.length
        return row(TWO, e.R * L, e.D * L, e.A * E, e.lam1 / L, e.B * E, e.lam2 / L, e.eta, e.n)


class TersoffModC(TersoffMod):
    """`TersoffMod` with its c0 (LAMMPS ``tersoff/mod/c``)."""

    style = "tersoff/mod/c"
    entry = TersoffModCEntry

    def between(self, e):
        out = super().between(e)
        out[12] = e.c0 * self.units.energy
        return out


@dataclass(frozen=True)
class TersoffZBLEntry(TersoffEntry):
    """One entry of a ``.tersoff.zbl`` or ``.gw.zbl`` file: `TersoffEntry` and the core of `TersoffZBL`."""

    Zi: float = 0.0
    Zj: float = 0.0
    ZBLcut: float = 0.0
    ZBLexpscale: float = 0.0


class TersoffZBL(Tersoff):
    """V_ij = (1 − f_F) V_ZBL + f_F V_Tersoff, f_F = 1/(1 + exp(−A_F (d − r_C))), V_ZBL = Z_i Z_j e²/(4πε0 d) φ(d/a), a
    = 0.8854 · 0.529 Å/(Z_i^0.23 + Z_j^0.23), φ = 0.1818 e^−3.2x + 0.5099 e^−0.9423x + 0.2802 e^−0.4029x + 0.02817
    e^−0.2016x; everything else as `Tersoff`. Entries: `TersoffZBLEntry`.

    Notes
    -----
    Source: Devanathan, Diaz de la Rubia & Weber, J. Nucl. Mater. 253, 47 (1998); Ziegler, Biersack & Littmark (1985).
    LAMMPS's constants.
    """

    style = "tersoff/zbl"
    entry = TersoffZBLEntry

    def between(self, e):
        u = self.units
        if u.name not in _VACUUM:
            raise AtcError(
                f"pair_style {self.style}: LAMMPS knows the ZBL core in metal and real units only, got {u.name}: "
                "convert the model"
            )
        out = super().between(e)
        a = 0.8854 * u.to_internal("length", 0.529) / (e.Zi**0.23 + e.Zj**0.23)
        strength = e.Zi * e.Zj / (4.0 * np.pi * _VACUUM[u.name]) * u.energy * u.length
        out[13:] = strength, a, e.ZBLcut * u.length, e.ZBLexpscale / u.length
        return out


class _GaoWeberOrder:
    form = (SINE, TERSOFF, GAO_WEBER)

    def between(self, e):
        if not e.beta > 0:
            raise AtcError(f"{e.where}: beta must be positive, b = [beta (1 + zeta)]^(-n), got {e.beta:g}")
        return super().between(e)


class GaoWeber(_GaoWeberOrder, Tersoff):
    """`Tersoff` with b = [β (1 + ζ)]^(−n) (LAMMPS ``gw``), β = 1 in the paper.

    Notes
    -----
    Source: Gao & Weber, Nucl. Instr. Meth. B 191, 504 (2002).
    """

    style = "gw"


class GaoWeberZBL(_GaoWeberOrder, TersoffZBL):
    """`GaoWeber` with the ZBL core of `TersoffZBL` (LAMMPS ``gw/zbl``)."""

    style = "gw/zbl"


for _kind, _ending in (
    (TersoffMod, ".tersoff.mod"),
    (TersoffModC, ".tersoff.modc"),
    (TersoffZBL, ".tersoff.zbl"),
    (GaoWeber, ".gw"),
    (GaoWeberZBL, ".gw.zbl"),
):
    pair_style(_kind.style, mapped=True)(lambda inp, kind=_kind, ending=_ending: bond_order_style(inp, kind, ending))
