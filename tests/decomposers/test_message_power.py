"""Bonds that carry the power of messages (`Bonds.P_b`), with a model whose derivatives are written by hand."""

import numpy as np
from energy_systems import diamond

import atc
from atc.analysis.check import check
from atc.bonds import Bonds
from atc.decomposers.base import Term, Work, Worst
from atc.decomposers.many_body.neighborhood import Neighborhood

CUTOFF = 4.0


class TwoLayers(Term):
    """U^(j) = ½ s_j², s_j = Σ_n f(d_jn) ρ_n, ρ_n = Σ_k f(d_nk): what an atom gathers of its neighbours is what they
    gathered of theirs. The energy reaches two cutoffs.

    With c_j = ∂U/∂s_j = s_j and b_n = ∂U/∂ρ_n = Σ_j c_j f_jn, an edge e = (c → n) has ∂U/∂d = f′ (c_c ρ_n + b_c), and
    carries ∂U/∂ρ_e ρ̇_n = c_c f_e ρ̇_n besides.
    """

    cutoff, central, edges, depth = CUTOFF, False, True, 4.0
    attributes = {"energy_path": "edges of the model"}  # noqa: RUF012

    def describe(self):
        return "two layers of density"

    def prepare(self, frame):
        return TwoLayersWork(frame)


class TwoLayersWork(Work):
    def __init__(self, frame):
        self.frame, self.near = frame, Neighborhood(frame, None, CUTOFF, "message")
        self.stages = (self.near.chunks, 1)

    def run(self, stage, task, acc):
        near = self.near
        if stage == 0:
            return near.collect(task, acc.ws)
        near.join()
        i, j, r, d = near.atom[near.a], near.atom[near.b], near.r_pc, near.d_p
        n, f, slope = len(self.frame), (1 - (d / CUTOFF) ** 2) ** 4, -8 * d / CUTOFF**2 * (1 - (d / CUTOFF) ** 2) ** 3

        def gathered(x_n):
            return np.bincount(i, f * x_n[j], n) + np.bincount(j, f * x_n[i], n)

        rho = gathered(np.ones(n))
        s = gathered(rho)
        back = gathered(s)
        U = 0.5 * s**2
        acc.energy += float(U.sum())
        if acc.energies is not None:
            acc.energies += U
        out = -r / d[:, None]
        D = np.stack(
            [(slope * (s[i] * rho[j] + back[i]))[:, None] * out, -(slope * (s[j] * rho[i] + back[j]))[:, None] * out], 1
        )
        P = None
        if acc.sources:
            v = self.frame.velocities
            rate = slope * ((v[i] - v[j]) * r).sum(1) / d
            rho_t = np.bincount(i, rate, n) + np.bincount(j, rate, n)
            P = f * (s[i] * rho_t[j] - s[j] * rho_t[i])
            acc.measured("energy_identity", 1e-15)
        return Bonds(i, j, r, np.full(len(d), np.nan), D if acc.sources else None, D[:, 0] - D[:, 1], P)


def test_balance():
    frame, pot = diamond(5.2, 1), atc.potential(TwoLayers(), "metal")
    report = check([frame], pot, atc.kernel("gaussian", width=1.5), points=4)
    assert report.ok, str(report)
    assert report.data["energy_sources"]["error"] < 1e-8
    b = pot.decompose(frame, sources=True).bonds
    assert np.abs(b.P_b).max() > 0.01 * np.abs(np.einsum("bc,bc->b", frame.velocities[b.j], b.D_bdc[:, 0])).max()


def test_what_is_said_and_measured():
    frame, pot = diamond(5.2, 1), atc.potential(TwoLayers(), "metal")
    grid = atc.Grid.regular(shape=(2, 2, 2))
    ds = atc.fields([frame, frame], pot, atc.kernel("quartic", 4.0), grid, ["stress", "heat_flux", "churning"])
    assert ds.attrs["energy_identity"] == 1e-15 and ds.attrs["energy_path"] == "edges of the model"
    assert "notes" not in ds.attrs
    assert (ds.churning.values == 0).all()
    s = ds.stress.values
    assert ds.stress.attrs["asymmetry"] == np.abs(s - s.swapaxes(-1, -2)).max() / 2 / np.abs(s).max()
    lj = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.01 2.2", units="metal")
    assert "asymmetry" not in atc.fields(frame, lj, atc.kernel("quartic", 4.0), grid).stress.attrs


def test_the_worst_is_kept():
    assert 0 + Worst(2.0) + Worst(1.0) == 2.0 and Worst(1.0) + 3.0 == 3.0
    assert np.isnan(Worst("nan") + 1.0) and np.isnan(Worst(1.0) + float("nan"))


def test_bonds_of_both_kinds_together():
    """Cut out, copied and joined, they keep what they carry; those without carry nothing."""
    frame, pot = diamond(5.2, 1), atc.potential(TwoLayers(), "metal")
    b = pot.decompose(frame, sources=True).bonds
    plain = Bonds(b.i, b.j, b.r_bc, b.G_b, b.D_bdc, b.F_bc)
    both = Bonds.concatenate([b.taken(slice(0, 5)), plain.copy(), b.copy()])
    np.testing.assert_array_equal(both.P_b, np.concatenate([b.P_b[:5], np.zeros(len(b)), b.P_b]))
    assert len(plain.powers()) == 0 and plain.powers().dtype == float
