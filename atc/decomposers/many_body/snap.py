"""Spectral neighbour analysis potentials (SNAP): energies of atoms as polynomials of the bispectrum of their neighbours
(LAMMPS ``pair_style snap``). How a frame is done is in `edges`.
"""

from __future__ import annotations

import numpy as np

from ...units import units as get_units
from ..registry import factor, pair_style
from .edges import Edges
from .elements import ElementMap, mapped_line
from .snap_file import SNAPFile, read_snap
from .snap_kernels import centres
from .snap_tables import FACTORS, mirrored, products, rows, triples


class SNAP(Edges):
    """U = Σ_j [β0 + β·B + ½ Bᵀ α B], B the bispectrum of the neighbours of atom j.

    A neighbour at distance d in the direction n is the rotation by 2 θ about n, θ = rfac0 π (d − rmin0)/(r_c − rmin0),
    with the weight w f_c(d), f_c = ½ (1 + cos π (d − rmin0)/(r_c − rmin0)); u^j = U^j(0) + Σ w f_c U^j, and
    B_j1j2j = Σ (u^j_mm')* ⟨j1 m1 j2 m2|j m⟩⟨j1 m1' j2 m2'|j m'⟩ u^j1_m1m1' u^j2_m2m2'. With ``chemflag`` every element
    has a density of its own.

    Forces do not act along bonds, see `atc.decomposers.many_body.nep.NEP`.

    Parameters
    ----------
    file : SNAPFile
    elements : the file's name of each atom type from 1, None or "NULL" for types left out; None: its first, of all
    units : of the file
    where : what the file is called in messages

    Notes
    -----
    Source: Thompson, Swiler, Trott, Foiles & Tucker, J. Comput. Phys. 285, 316 (2015); Wood & Thompson, J. Chem. Phys.
    148, 241721 (2018), quadratic; Cusentino, Wood & Thompson, J. Phys. Chem. A 124, 5456 (2020), ``chemflag``.
    """

    style, part_name = "snap", "snap"
    reference = "the file's own zero: its first coefficient of each element is in the energy of every atom"

    def __init__(self, file: SNAPFile, elements=None, units="metal", where: str = "snap"):
        self.model, self.where = file, where
        self.elements = ElementMap(elements, file.names, where)
        u = get_units(units)
        self.length, self.energy = factor(u, "length"), factor(u, "energy")
        used = [e for e in self.elements.elements or file.names[:1] if e is not None]
        self.cutoff = 2 * file.rcutfac * max(file.radius[file.names.index(e)] for e in used) * self.length
        flags, t = file.flags, len(file.names)
        self.channels = t if flags["chemflag"] else 1
        self.table = products(file.top, self.channels > 1, bool(flags["bnormflag"]))
        # B of an atom without neighbours: u^j = 1, so 2j + 1 if it is in all three densities.
        alone = np.array([1.0 if flags["bnormflag"] else n + 1.0 for _, _, n in triples(file.top)])
        inside = np.ones((t, self.channels))
        if self.channels > 1 and not flags["wselfallflag"]:
            inside = np.eye(t)
        B0 = np.einsum("ta,tb,tc,k->tabck", inside, inside, inside, alone).reshape(t, -1)
        self.B0 = B0 if flags["bzeroflag"] else np.zeros_like(B0)
        self.constant = file.constant.copy()
        if not flags["quadraticflag"]:
            self.constant -= (file.beta * self.B0).sum(1)
        self.params = np.array([file.rmin0, flags["switchflag"], flags["switchinnerflag"]], float)

    def describe(self) -> str:
        names = self.elements.describe() or f" {self.model.names[0]}"
        form = "quadratic" if self.model.flags["quadraticflag"] else "linear"
        chemical = ", a density for each element" if self.channels > 1 else ""
        return (
            f"snap{names} ({form}, 2J = {self.model.top}{chemical}), edge gradient of the energy of each atom, one "
            "hop, energy to the atom whose neighbours it has; one merged bond a pair"
        )

    def map(self, frame) -> ElementMap:
        return self.elements

    def centres(self, work, task, g_end, energies) -> float:
        file, tables = self.model, (rows(self.model.top), mirrored(self.model.top), self.table)
        wide = bool(file.flags["wselfallflag"])
        density = file.radius, file.share, file.inner, file.half, file.rcutfac, file.rfac0, self.params, wide
        expansion, units = (self.constant, file.beta, file.alpha, self.B0), (self.length, self.energy)
        around = *work.atoms(task), work.near.most(task)[0], work.lists
        return centres(*around, density, *tables, FACTORS, self.channels, expansion, units, g_end, energies)


@pair_style("snap", mapped=True)
def _snap(inp):
    wants = "pair_coeff * * <coefficients> <parameters> <element of each atom type>"
    if inp.coeffs and len(inp.coeffs[0].words) < 3:
        raise inp.error(f"{inp.command} wants {wants}, got {' '.join(inp.coeffs[0].words) or 'nothing'}", inp.coeffs[0])
    first = [line.__class__(line.types, (line.words[0], *line.words[2:]), line.where) for line in inp.coeffs]
    coefficients, elements, line = mapped_line(inp.replace(coeffs=tuple(first)), ".snapcoeff> <file.snapparam")
    parameters = inp.path(inp.coeffs[0].words[1], line)
    used = tuple(dict.fromkeys(e for e in elements if e is not None))
    file = read_snap(coefficients, parameters, used, inp.units.name, line.where)
    return SNAP(file, elements, inp.units, coefficients.name)
