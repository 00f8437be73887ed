"""MEAM's pair energies: what is left of a reference structure's energy when the embedding energies are taken off."""

from __future__ import annotations

import numpy as np

from .meam_file import MEAMParameters

# Points of LAMMPS's tables of pair energies, the last at 1.1 times the cutoff.
_POINTS = 1000
#: First neighbours; ratio of the second neighbours' distance; how many; how many atoms screen one of them, the place of
#: those over the square of the distance.
_STRUCTURES = {
    "fcc": (12, 2.0**0.5, 6, 4), "hcp": (12, 2.0**0.5, 6, 4), "bcc": (8, 2.0 / 3.0**0.5, 6, 4),
    "dia": (4, (8.0 / 3.0) ** 0.5, 12, 1), "b1": (6, 2.0**0.5, 12, 2), "b2": (8, 2.0 / 3.0**0.5, 6, 4),
    "l12": (12, 2.0**0.5, 6, 4), "dim": (1, 1.0, 0, 0), "sc": (6, 2.0**0.5, 12, 2),
}  # fmt: skip
#: Structures in which second neighbours are pairs of one element.
_ALLOYS = ("b1", "b2", "dia", "l12")
#: Σ_jk over first neighbours of cos, cos² − 1/3, cos³ − 3/5 cos.
_SHAPES = {"dia": (0.0, 0.0, 32.0 / 9.0), "hcp": (0.0, 0.0, 1.0 / 3.0), "dim": (1.0, 2.0 / 3.0, 0.4)}
# Universal screening of two nuclei, with the constants of LAMMPS's MEAM.
_ZBL_C = np.array([0.028171, 0.28022, 0.50986, 0.18175])
_ZBL_D = np.array([0.20162, 0.40290, 0.94229, 3.1998])


def smooth(x):
    """f_c: 1 from x = 1 on, 0 up to x = 0, [1 − (1 − x)⁴]² between."""
    x = np.clip(x, 0.0, 1.0)
    return (1.0 - (1.0 - x) ** 4) ** 2


def g_of(gamma, ibar, gsmooth=99.0):
    """G(Γ)."""
    gamma = np.asarray(gamma, float)
    if ibar in (0, 4):
        switch = -gsmooth / (gsmooth + 1.0)
        with np.errstate(all="ignore"):
            low = np.sqrt(1.0 / (gsmooth + 1.0) * (switch / gamma) ** gsmooth)
        return np.where(gamma < switch, low, np.sqrt(np.maximum(1.0 + gamma, 0.0)))
    if ibar == 1:
        return np.exp(0.5 * gamma)
    if ibar == 3:
        return 2.0 / (1.0 + np.exp(-np.maximum(gamma, -700.0)))
    return np.where(1.0 + gamma < 0.0, -1.0, 1.0) * np.sqrt(np.abs(1.0 + gamma))


def screening(p: MEAMParameters, lattice: str, a: int, b: int, majority: bool = False) -> float:
    """S of a second neighbour (both of element a) that atoms of element b screen; of the majority in l12, half of them
    are of element a."""
    _, ratio, _, count = _STRUCTURES[lattice]
    if count == 0:
        return 0.0
    # The screening atoms are first neighbours of both: C = 1 + 2 (2 q − q²)/q², q = ratio².
    C = 4.0 / ratio**2 - 1.0
    own, other = (float(smooth((C - p.Cmin[a, a, e]) / (p.Cmax[a, a, e] - p.Cmin[a, a, e]))) for e in (a, b))
    return own**2 * other**2 if lattice == "l12" and majority else other**count


def background(p: MEAMParameters, e: int) -> float:
    """The density that an element's density is compared with."""
    lattice = p.lattice[e][e]
    if p.bkgd_dyn:
        return p.rho0_e[e] * p.Z[e]
    G = 1.0
    if p.ibar[e] > 0:
        gamma = np.dot(p.t_ek[e, 1:], _SHAPES.get(lattice, (0.0, 0.0, 0.0))) / p.Z[e] ** 2
        G = float(g_of(gamma, p.ibar[e], p.gsmooth_factor))
    rho0 = p.rho0_e[e] * p.Z[e]
    if p.nn2[e, e]:
        _, ratio, count, _ = _STRUCTURES[lattice]
        rho0 += count * screening(p, lattice, e, e) * p.rho0_e[e] * np.exp(-p.beta_ek[e, 0] * (ratio - 1.0))
    return rho0 * G


def embedding(p: MEAMParameters, e: int, rhobar):
    """The embedding energy F(ρ̄)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        F = p.A_e[e] * p.Ec[e, e] * rhobar * np.log(rhobar)
    return np.where(rhobar > 0.0, F, -p.A_e[e] * p.Ec[e, e] * rhobar if p.emb_lin_neg else 0.0)


def rose(p: MEAMParameters, a: int, b: int, r):
    """Energy per atom of the reference structure at nearest-neighbour distance r."""
    s = p.alpha[a, b] * (r / p.re[a, b] - 1.0)
    a3 = np.where(s >= 0.0, p.attrac[a, b], p.repuls[a, b])
    with np.errstate(divide="ignore"):
        cubic = [a3 / (r / p.re[a, b]), -p.attrac[a, b] + p.repuls[a, b] / r, a3][p.erose_form]
    return -p.Ec[a, b] * (1.0 + s + cubic * s**3) * np.exp(-s)


def zbl(p: MEAMParameters, a: int, b: int, r):
    """The screened repulsion of two nuclei at distance r."""
    za, zb = p.number[a], p.number[b]
    x = r / (0.4685 / (za**0.23 + zb**0.23))
    return 14.3997 * za * zb / r * (_ZBL_C[:, None] * np.exp(-_ZBL_D[:, None] * x)).sum(axis=0)


def _density(p, e, k, r):
    return p.rho0_e[e] * np.exp(-p.beta_ek[e, k] * (r / p.re[e, e] - 1.0))


def _site(p, lattice, own, other, majority, r, nn2):
    """ρ̄ at an atom of element `own` in the reference structure of it and `other`; majority : in l12 it is the element
    with three atoms of four."""
    Z, ratio, second, _ = _STRUCTURES[lattice]
    near = {other: Z}
    if lattice == "l12" and majority and own != other:
        near = {own: 8, other: 4}
    rho0 = sum(n * _density(p, e, 0, r) for e, n in near.items())
    T = sum(n * _density(p, e, 0, r) * p.t_ek[e, 1:, None] for e, n in near.items())
    norm = sum(n * _density(p, e, 0, r) * (p.t_ek[e, 1:, None] ** 2 if p.ialloy == 1 else 1.0) for e, n in near.items())
    t = (
        np.broadcast_to(p.t_ek[own, 1:, None], T.shape)
        if p.ialloy == 2
        else np.divide(T, norm, out=np.zeros_like(T), where=norm != 0.0)
    )

    def rho(e, k):
        return _density(p, e, k, r) * (p.t_ek[e, k] if p.ialloy == 1 else 1.0)

    shapes = _SHAPES.get(lattice, (0.0, 0.0, 0.0))
    R = [s * rho(other, k) ** 2 for k, s in enumerate(shapes, 1)]
    if len(near) == 2:
        # Four neighbours in a plane, eight out of it.
        R[1] = 8.0 / 3.0 * (rho(own, 2) - rho(other, 2)) ** 2
    if nn2:
        rho0 = rho0 + second * screening(p, lattice, own, other, majority) * _density(p, own, 0, r * ratio)
    # Far away the squares of densities underflow.
    gamma = np.divide(sum(t[k] * R[k] for k in range(3)), rho0**2, out=np.zeros_like(rho0), where=rho0 > 1e-150)
    return rho0 * g_of(gamma, p.ibar[own], p.gsmooth_factor) / background(p, own)


def _reference(p, a, b, r):
    """The pair energy without second neighbours' pairs and without ZBL."""
    lattice = p.lattice[a][b]
    nn2 = bool(p.nn2[a, b])
    E = rose(p, a, b, r)
    Fa = embedding(p, a, _site(p, lattice, a, b, True, r, nn2))
    Fb = embedding(p, b, _site(p, lattice, b, a, False, r, nn2))
    if lattice == "l12":
        return E / 3.0 - Fa / 4.0 - Fb / 12.0 - pair_energy(p, a, a, r, core=False)
    return (2.0 * E - Fa - Fb) / _STRUCTURES[lattice][0]


def pair_energy(p: MEAMParameters, a: int, b: int, r, core: bool = True):
    """φ(r), r an array, without cutoff and screening; core : with what a ZBL core changes."""
    r = np.asarray(r, float)
    lattice = p.lattice[a][b]
    Z, ratio, second, _ = _STRUCTURES[lattice]
    phi = _reference(p, a, b, r)
    if p.nn2[a, b]:
        if a == b or lattice not in _ALLOYS:
            # Structures that are one element's: LAMMPS takes second neighbours of two elements for pairs of both.
            S = screening(p, lattice, a, b)
            for n in range(1, 11):
                phi = phi + (-second * S / Z) ** n * _reference(p, a, b, r * ratio**n)
        else:
            parts = (
                ((a, b, 0.75), (b, a, 0.25))
                if lattice == "l12"
                else ((a, b, 0.5 * second / Z), (b, a, 0.5 * second / Z))
            )
            for e, other, share in parts:
                phi = phi - share * screening(p, lattice, e, other, e == a) * pair_energy(
                    p, e, e, r * ratio, core=False
                )
    if core and p.zbl[a, b]:
        s = p.alpha[a, b] * (r / p.re[a, b] - 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            nuclei = zbl(p, a, b, r)
        frac = smooth(1.0 - (s + 1.0) / (-3.0 + 1.0))
        phi = np.where(s <= -3.0, nuclei, np.where(s < -1.0, frac * phi + (1.0 - frac) * nuclei, phi))
    return phi


def tables(p: MEAMParameters) -> tuple[np.ndarray, float]:
    """(m, m, points) pair energies at distances k·step, as LAMMPS tabulates them, and the step."""
    m = len(p.names)
    step = 1.1 * p.rc / _POINTS
    r = np.arange(_POINTS) * step
    r[0] = 1e-2 * step
    out = np.zeros((m, m, _POINTS))
    for a in range(m):
        for b in range(a, m):
            out[a, b] = out[b, a] = pair_energy(p, a, b, r)
    return out, step
