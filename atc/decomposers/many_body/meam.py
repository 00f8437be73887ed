"""The modified embedded-atom method with screening (LAMMPS ``pair_style meam``)."""

from __future__ import annotations

import numpy as np

from ...units import Units
from ...units import units as system
from ..registry import pair_style
from . import meam_reference
from .elements import ElementMap, of_each_type, require_among, whole_line
from .embedded_atom import spline
from .meam_file import MEAMParameters, library_elements, read_meam
from .meam_kernels import densities, merge, screenings
from .neighbor_work import NO_S, OUTER_PER_TASK, NeighborTerm, NeighborWork
from .parameter_file import read_parameter_file


class _MEAMWork(NeighborWork):
    own = ("_screen", "_centres", "_merge")

    def joined(self, acc):
        near = self.near
        pairs = len(near.a)
        self.partial = np.zeros(near.chunks, np.int64)
        self.S, self.dUdS, self.G_end = np.zeros(pairs), np.zeros((pairs, 2)), np.zeros((pairs, 2))
        self.S_end = np.zeros((pairs, 2, 2, 3)) if acc.sources else NO_S
        self.runs, self.most, self.room = near.runs(OUTER_PER_TASK)
        self.stages = (near.chunks, 1, near.chunks, len(self.runs) - 1, near.chunks)

    def _screen(self, task, acc):
        term = self.term
        self.partial[task] = screenings(*self.pairs(task), self.lists, term.ending[0], term.screen, self.S)

    def _centres(self, task, acc):
        term, ends = self.term, (self.G_end, self.S_end, self.dUdS)
        law = term.ending, self.S, term.of_element, *term.choices
        return self.of_runs(task, acc, densities, *law, ends, fill=np.zeros)

    def _merge(self, task, acc):
        term, ends = self.term, (self.G_end, self.S_end, self.dUdS)
        law = term.ending, term.screen, (term.phi, term.per_dr), self.S
        return self.of_pairs(task, acc, merge, *law, ends, more=2 * int(self.partial[task]))


class MEAM(NeighborTerm):
    """U = Σ_i F_i(ρ̄_i) + Σ_pairs S_ij f_c φ_ij(d_ij), F = A E_c ρ̄ ln ρ̄, ρ̄ = ρ0 G(Γ)/ρ_bkgd, Γ = Σ_k t̄_k R_k/ρ0²,
    ρ0 = Σ_j p0_j, p_k,j = S_ij f_c ρ_k(d_ij), R_1 = Σ_jk p1 p1 cos θ_jk, R_2 = Σ_jk p2 p2 (cos² θ_jk − 1/3), R_3 = Σ_jk
    p3 p3 (cos³ θ_jk − 3/5 cos θ_jk), ρ_k = ρ0 exp(−β_k (d/r_e − 1)).

    Screening is a function of distances: S_ij = Π_k f_c((C − C_min)/(C_max − C_min)), C = 1 + 2 (X + Y − 1)/(1 − (X −
    Y)²), X = d_ik²/d_ij², Y = d_jk²/d_ij²; so is the rest through cos θ_jk = (ξ_ij + ξ_ik − ξ_jk)/(d_ij d_ik). A pair
    i–j has one bond with the pair force, what both ends' densities give, and ∂S/∂ξ_ij; an atom k that screens it
    partially adds bonds i–k and j–k; the angular densities add bonds between an atom's neighbours. The many distances
    around an atom are not independent: G is that of the formulas as written here.

    F belongs to its own atom, half of a pair's energy to each end, as in LAMMPS. φ is LAMMPS's table of 1000 points
    with its spline, made from the reference structures (`meam_reference`), so that energies and forces
    agree with LAMMPS to rounding.

    Parameters
    ----------
    parameters : MEAMParameters in `units`
    elements : its element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom is the
        first element.
    units : the default has eV and Å

    Notes
    -----
    Source: Baskes, Phys. Rev. B 46, 2727 (1992); Lee & Baskes, Phys. Rev. B 62, 8564 (2000); Gullet, Wagner & Slepoy,
    SAND2003-8782 (2003). Reference structures: fcc, bcc, hcp, dia, sc, dim, and between elements b1, b2, dia, l12, dim.
    Files: `from_files`.
    """

    work = _MEAMWork
    style, word = "meam", "MEAM"
    bodies = 3

    def __init__(self, parameters: MEAMParameters, elements=None, *, units: str | Units = "metal"):
        self.units = u = system(units)
        p = parameters
        self.map = ElementMap(elements, p.names, "pair_style meam")
        energy, length = u.energy, u.length
        m = len(p.names)
        phi, step = meam_reference.tables(p)
        self.phi, self.per_dr = spline(phi * energy), 1.0 / (step * length)
        self.ending = rc, _ = float(p.rc * length), float(p.delr * length)
        beta, t, rho0 = (np.ascontiguousarray(x, float) for x in (p.beta_ek, p.t_ek, p.rho0_e))
        re, Ec = np.ascontiguousarray(np.diag(p.re) * length), np.diag(p.Ec)
        background = np.array([meam_reference.background(p, e) for e in range(m)])
        self.of_element = beta, t, rho0, re, p.A_e * Ec * energy, background, p.ibar.astype(np.int64)
        self.choices = int(p.ialloy), bool(p.emb_lin_neg), float(p.gsmooth_factor)
        # Where C = C_max, an ellipse around the pair, no point is farther from an end than this (squared, over d_ij²).
        C = max(float(p.Cmax.max()), 2.0)
        bound = 0.25 * C * C / (C - 1.0)
        self.screen = p.Cmin, p.Cmax, bound
        self.cutoff = rc * bound**0.5

    @classmethod
    def from_files(
        cls, library, names, parameters=None, elements=None, *, units: str | Units = "metal", where: str = ""
    ) -> MEAM:
        """From LAMMPS's files, as its pair_coeff line names them: ``MEAM.from_files("library.meam", ["Si", "C"],
        "SiC.meam", ["Si", "C"])``.

        names : the elements to take from the library, in the order that the indices of the parameter file count. where
            : the line, for messages
        """
        p = read_meam(library, names, parameters, system(units).name, where)
        return cls(p, elements, units=units).with_masses(p.names, p.mass_e, where)

    def describe(self) -> str:
        return (
            f"meam{self.map.describe()}, embedding energy to its own atom, pair energy shared half to each; bonds to "
            "screening atoms and outer bonds apart"
        )


# meam/c is what older versions of LAMMPS call it.
@pair_style("meam", "meam/c", mapped=True)
def _meam(inp):
    wants = "pair_coeff * * <library> <its elements> <parameter file or NULL> <element of each atom type>"
    line = whole_line(inp, wants, 4)
    library = inp.path(line.words[0], line)
    known = library_elements(read_parameter_file(library, "MEAM library", line.where), library)
    count = next((k for k, w in enumerate(line.words[1:]) if w not in known or w == "NULL"), None)
    if not count:
        raise inp.error(
            f"{inp.command} wants {wants}: found no {'parameter file' if count is None else 'elements of the library'}",
            line,
        )
    names, file, elements = line.words[1 : 1 + count], line.words[1 + count], line.words[2 + count :]
    elements = of_each_type(inp, elements, line)
    require_among(inp, elements, names, "taken from the library", line)
    parameters = None if file == "NULL" else inp.path(file, line)
    return MEAM.from_files(library, names, parameters, elements, units=inp.units, where=line.where)
