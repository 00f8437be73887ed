"""Models of the KIM archive, where its API and Debian's collection of models are installed: against atc's own
Stillinger-Weber, derivatives by differences, balances."""

import energy_systems
import numpy as np
import pytest

import atc
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

METAL = units("metal")
SW = "SW_StillingerWeber_1985_Si__MO_405512056662_005"
EAM = "EAM_Dynamo_AdamsFoilesWolfer_1989Universal6_Cu__MO_145873824897_000"
_FCC = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])


def model(name, *types):
    try:
        return atc.kim(name, types or None)
    except AtcError as e:
        if "not installed" in str(e) or "no portable model" in str(e):
            pytest.skip(f"apt install libkim-api-dev openkim-models: {e}")
        raise


def crystal(basis, a, mass, seed=0):
    rng = np.random.default_rng(seed)
    cell = a * np.array([[1, 0, 0], [0.1, 1.02, 0], [0, -0.05, 0.98]])
    x = basis @ cell + 0.04 * a * rng.normal(size=basis.shape)
    v = 2.0 * rng.normal(size=x.shape) / mass**0.5
    return Frame(
        x, Cell(cell), METAL, types=np.ones(len(x), int), velocities=v - v.mean(0),
        masses=np.full(len(x), mass), type_names={1: "Si"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def silicon():
    return crystal(np.concatenate([_FCC, _FCC + 0.25]), 5.43, 28.0)


def test_stillinger_weber(silicon):
    """The same but for ε, whose last digits differ: energies of atoms, forces, virial, heat current."""
    pot = model(SW)
    own, frame = energy_systems.potential("sw", "center"), silicon
    a, b = pot.decompose(frame), own.decompose(frame)
    ratio = a.energy / b.energy
    assert abs(ratio - 1) < 1e-4
    for ours, theirs in ((a.energies_n, b.energies_n), (a.forces_nc, b.forces_nc), (a.virial_cc, b.virial_cc)):
        np.testing.assert_allclose(ours, ratio * theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())
    apart = pot.decompose(frame, sources=True)
    np.testing.assert_allclose(apart.forces_nc, a.forces_nc, rtol=0, atol=1e-12 * np.abs(a.forces_nc).max())
    np.testing.assert_allclose(apart.energies_n, a.energies_n, rtol=1e-12)
    J = [atc.heat_currents([frame], p, dt=1.0).J_tc[0] for p in (pot, own)]
    kinetic = frame.velocities.T @ (0.5 * frame.masses * (frame.velocities**2).sum(1))
    np.testing.assert_allclose(J[0] - kinetic, ratio * (J[1] - kinetic), rtol=0, atol=1e-11 * np.abs(J[1]).max())
    named = model(SW, "Si")
    np.testing.assert_array_equal(named.decompose(frame).forces_nc, a.forces_nc)


def test_balances():
    """Momentum and energy, churning included, of embedded atoms."""
    from atc.analysis.check import check

    frame = crystal(_FCC, 3.6, 63.5)
    pot = model(EAM, "Cu")
    report = check(frame, pot, atc.kernel("gaussian", width=1.6), atc.Grid.regular(shape=(3, 3, 3)), points=4)
    assert report.ok, report.verdict
    energy = report.data["laws"]["energy"]
    assert energy["chain_rule"]["residual"] < 1e-12 and energy["fields"]["residual"] < 1e-9


def test_what_is_refused(silicon, monkeypatch):
    model(SW)
    for make, said in (
        (lambda: atc.kim("LJ_of_nobody"), "no portable model 'LJ_of_nobody' is installed"),
        (lambda: atc.kim(SW, ["Ge"]), "has no element 'Ge'"),
        (lambda: atc.kim(SW).decompose(silicon.replace(type_names={})), "does not name its types"),
        (lambda: atc.kim(SW).decompose(silicon.replace(type_names={1: "C"})), "has no element 'C'"),
    ):
        with pytest.raises(AtcError, match=said):
            make()


def test_without_the_api(monkeypatch):
    import ctypes

    from atc.decomposers.many_body import kim_api

    def none(name):
        raise OSError

    kim_api.shared_object.cache_clear()
    monkeypatch.setattr(ctypes, "CDLL", none)
    with pytest.raises(AtcError, match="the KIM API is not installed: e.g. apt install"):
        atc.kim(SW)
    kim_api.shared_object.cache_clear()


def test_scenes(silicon, tmp_path, monkeypatch):
    """[potential] kim, which the output's own scene has too."""
    from atc.config.scene import Scene

    model(SW)
    monkeypatch.chdir(tmp_path)
    rows = "".join("Si {:.17g} {:.17g} {:.17g}\n".format(*x) for x in silicon.positions)
    lattice = " ".join(map(str, silicon.cell.vectors.ravel()))
    head = f'{len(silicon)}\nLattice="{lattice}" Properties=species:S:1:pos:R:3\n'
    (tmp_path / "run.xyz").write_text(head + rows)
    scene = {
        "trajectory": {"file": "run.xyz"},
        "potential": {"kim": SW},
        "fields": {"quantities": ["virial_stress_potential"]},
    }
    ds = Scene.load(scene).run()
    want = model(SW).decompose(silicon).virial_cc / METAL.factor("energy") / silicon.cell.volume
    np.testing.assert_allclose(ds.virial_stress_potential.values[0], want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert f'kim = "{SW}"' in ds.attrs["scene"]
    with pytest.raises(AtcError, match=r"\[potential\] .*no element 'Ge'"):
        Scene.load(scene | {"potential": {"kim": SW, "types": ["Ge"]}}).run()
