"""Averages over planes from a calculator's forces and energies alone: they are those of every decomposition."""

import energy_systems
import numpy as np
import pytest

import atc
from atc.errors import AtcError
from atc.frame import Cell
from atc.units import units

pytest.importorskip("ase")
ASE = units("ase")


class Black:
    """A potential of atc that says no more than calculators do."""

    def __init__(self, pot, frame, bend=None):
        self.pot, self.frame, self.bend = pot, frame, bend or (lambda name, value: value)

    def get_property(self, name, atoms=None, allow_calculation=True):
        frame = self.frame.replace(positions=atoms.positions)
        d = self.pot.decompose(frame)
        W = d.virial_cc / frame.cell.volume
        found = {
            "energy": d.energy,
            "free_energy": d.energy,
            "energies": d.energies_n,
            "forces": d.forces_nc,
            "stress": 0.5 * (W + W.T)[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
        }
        return self.bend(name, found[name])

    def get_potential_energy(self, atoms=None, force_consistent=False):
        return self.get_property("energy", atoms)

    def get_potential_energies(self, atoms=None):
        return self.get_property("energies", atoms)

    def get_forces(self, atoms=None):
        return self.get_property("forces", atoms)

    def get_stress(self, atoms=None):
        return self.get_property("stress", atoms)


def system(name, open_axis=None, seed=0):
    frame, pot = energy_systems.system(name)
    rng = np.random.default_rng(seed)
    vectors, periodic = frame.cell.vectors.copy(), [True] * 3
    x = frame.positions
    if open_axis is not None:
        periodic[open_axis] = False
        vectors[open_axis] *= 3
        x = frame.cell.wrap(x)[0] - frame.cell.origin + vectors[open_axis] / 3
    m = np.where(frame.types == 1, 28.0, 12.0)
    v = 0.05 * rng.normal(size=x.shape) + [0.01, -0.02, 0.03]
    names = {1: "Si", 2: "C"}
    return frame.replace(positions=x, cell=Cell(vectors, periodic=periodic), velocities=v, masses=m, units=ASE,
                         type_names=names), pot  # fmt: skip


GRID = {axis: atc.Grid.slab("abc"[axis], 13) for axis in (0, 2)}
KERNEL = atc.kernel("quartic", 3.0)


def normal_of(frame, axis):
    return np.linalg.inv(frame.cell.vectors)[:, axis] * frame.cell.heights[axis]


@pytest.mark.parametrize("name", ["lj", "sw", "nep", "snap"])
@pytest.mark.parametrize("axis", [0, 2])
def test_normal_stress(name, axis):
    """Central or not, with whatever bonds: the row n·σ of the averages over planes that `atc.fields` has."""
    frame, pot = system(name)
    ds = atc.calculator(Black(pot, frame)).plane_profiles([frame], KERNEL, GRID[axis])
    # of one frame, with the kinetic part as it is
    fields = atc.fields([frame], pot, KERNEL, GRID[axis], ["stress"], velocity="local")
    for part in ("_potential", "_kinetic", ""):
        want = np.einsum("i,tsij->tsj", normal_of(frame, axis), fields[f"stress{part}"].values)
        np.testing.assert_allclose(
            ds[f"stress_normal{part}"].values, want, rtol=0, atol=1e-11 * np.abs(want).max(), err_msg=part
        )
    assert ds.stress_normal.attrs["units"] == "eV/angstrom^3"


@pytest.mark.parametrize("name", ["lj", "sw", "nep", "snap"])
def test_normal_heat_flux(name):
    """Out of an open slab no energy flows; in a periodic cell it is said where."""
    frame, pot = system(name, open_axis=2)
    black = atc.calculator(Black(pot, frame))
    got = black.plane_profiles([frame], KERNEL, GRID[2], heat=True).heat_flux_normal.values
    fields = atc.fields([frame], pot, KERNEL, GRID[2], ["heat_flux"])
    want = fields.heat_flux.values @ normal_of(frame, 2)
    # differences along the motion, 2e-3 Å; smooth cutoffs have kinks of higher derivatives
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-7 * np.nanmax(np.abs(want)))
    closed = frame.replace(cell=Cell(frame.cell.vectors))
    again = atc.calculator(Black(pot, closed))
    with pytest.raises(AtcError, match="known but for a constant"):
        again.plane_profiles([closed], KERNEL, GRID[2], heat=True)
    z = 0.02 * closed.cell.heights[2]
    got = again.plane_profiles([closed], KERNEL, GRID[2], heat=True, zero=z).heat_flux_normal.values
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-7 * np.nanmax(np.abs(want)))


@pytest.mark.parametrize(
    ("wrong", "heat", "said"),
    [
        ({"forces": lambda F: F + 1e-3}, False, "forces do not add up to 0"),
        ({"forces": lambda F: F * np.nan}, False, "its forces are not all finite"),
        ({"forces": lambda F: 1.1 * F}, True, "does not change by the power of its forces"),
        ({"energies": lambda U: U + 1.0}, True, "do not add up to its energy"),
        ({"forces": lambda F: 1 / 0}, False, "cannot be evaluated: ZeroDivisionError"),
    ],
)
def test_what_is_refused(wrong, heat, said):
    frame, pot = system("lj", open_axis=2)
    black = atc.calculator(Black(pot, frame, lambda name, value: wrong.get(name, lambda x: x)(value)))
    with pytest.raises(AtcError, match=said) as e:
        black.plane_profiles([frame], KERNEL, GRID[2], heat=heat)
    assert "\n" not in str(e.value)


def test_nothing_that_is_not_unique():
    frame, pot = system("lj")
    black = atc.calculator(Black(pot, frame), name="a model")
    with pytest.raises(AtcError, match="a model: forces alone do not determine stress"):
        atc.fields([frame], black, KERNEL, atc.Grid.slab("z", 5), ["stress"])
    with pytest.raises(AtcError, match="only averages over whole planes"):
        black.plane_profiles([frame], KERNEL, atc.Grid.regular(shape=(3, 3, 3)))
    with pytest.raises(AtcError, match="expected a calculator of ASE"):
        atc.calculator("model")
