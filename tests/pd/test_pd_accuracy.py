"""The engine's waves in a periodic plate against exact solutions of the continuum models and of classical elasticity,
by the benchmark that tabulates them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from atc import pd

spec = importlib.util.spec_from_file_location(
    "pd_accuracy", Path(__file__).resolve().parents[2] / "benchmarks" / "pd_accuracy.py"
)
study = importlib.util.module_from_spec(spec)
spec.loader.exec_module(study)


def test_exact_solutions_are_those_of_the_integrals():
    """ρω² by quadrature over the horizon in the plane, bond by bond, for one wave; and the classical limit."""
    k, horizon = 7.0, 0.2
    x, w = np.polynomial.legendre.leggauss(80)
    r, wr = 0.5 * horizon * (x + 1), 0.5 * horizon * w
    phi = 2 * np.pi * np.arange(400) / 400
    r, phi = np.meshgrid(r, phi, indexing="ij")
    dA = wr[:, None] * r * (2 * np.pi / 400)
    n = np.stack([np.cos(phi), np.sin(phi)])
    phase = np.exp(1j * k * r * n[0]) - 1
    for key, (nu, omega) in {
        "pmb": (1 / 3, None),
        "lps": (0.2, 1 / r),
        "correspondence": (0.2, np.ones_like(r)),
    }.items():
        mu, lam = 1 / (2 * (1 + nu)), nu / (1 - nu**2)
        got = [float(m[0]) for m in study.moduli(key, np.array([k]), horizon)]
        for c, value in enumerate(got):
            e = n[c] * phase  # extension of a bond in the wave of unit amplitude along c
            if key == "pmb":
                want = 9 / (np.pi * horizon**3) * (0.5 * np.abs(e) ** 2 / r * dA).sum()
            else:
                m = (omega * r**2 * dA).sum()
                if key == "lps":
                    want = (
                        4 * (lam - mu) * abs((omega * r * e * dA).sum() / m) ** 2
                        + 8 * mu / m * (omega * np.abs(e) ** 2 * dA).sum()
                    )
                else:
                    gradient = (omega * phase * r * n * dA).sum(axis=(1, 2)) * 2 / m  # along x and y
                    rest = phase - r * (gradient[0] * n[0] + gradient[1] * n[1])
                    want = (lam + 2 * mu, mu)[c] * abs(gradient[0]) ** 2 + 0.1 * 8 * mu / m * (
                        omega * np.abs(rest) ** 2 * dA
                    ).sum()
            assert value == pytest.approx(want, rel=1e-10), (key, c)
        near = [float(m[0]) for m in study.moduli(key, np.array([k]), 1e-3)]
        np.testing.assert_allclose(near, [(lam + 2 * mu) * k**2, mu * k**2], rtol=2e-5)


@pytest.mark.parametrize(
    "name, make, m, n, within",
    [
        ("pmb", lambda: pd.PMB(youngs=1.0, surface_correction="energy"), 3, 80, 0.032),
        ("lps", lambda: pd.LPS(youngs=1.0, poisson=0.2), 3, 80, 0.022),
        ("correspondence", lambda: pd.Correspondence(youngs=1.0, poisson=0.2), 2, 80, 0.064),
    ],
)
def test_waves_approach_classical_elasticity(name, make, m, n, within):
    """Second order: half of δ and Δx, a quarter of the error. The bounds are a few per cent above what was measured."""
    errors = []
    for side in (n // 2, n):
        sim, steps = study.plate(m, make(), horizon=m / side)
        sim.step(steps)
        errors.append(
            study.difference(sim.state.u_nc / study.AMPLITUDE, study.exact(name, sim.body.X_nc, study.END, 0))
        )
    assert errors[1] < within and errors[0] > 3.5 * errors[1], errors


def test_table_and_picture(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(study, "TIMED", 0.0)
    study.main(str(tmp_path / "accuracy.png"), 2)
    text = capsys.readouterr().out
    assert text.count("|---") >= 5 and "| PMB corrected | 3 | 3.2 | 1600 |" in text
    assert (tmp_path / "accuracy.png").stat().st_size > 30_000
