"""First Piola-Kirchhoff stress: against brute force, against Cauchy's where they must agree, and through
re-wrapping."""

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ, bond_sum

import atc
from atc.errors import AtcError
from atc.frame import Cell

KERN = ("quartic", 5.0)


def deformed(reference, F, seed=1, shake=0.1):
    """The reference deformed homogeneously (x' = x F^T) and shaken, atoms in their own images."""
    rng = np.random.default_rng(seed)
    cell = reference.cell
    new = Cell(cell.vectors @ F.T, cell.origin @ F.T, cell.periodic)
    return reference.replace(
        positions=reference.positions @ F.T + rng.uniform(-shake, shake, reference.positions.shape), cell=new
    )


F = np.array([[1.06, 0.04, 0.0], [-0.03, 0.97, 0.05], [0.02, 0.0, 1.01]])


def piola(frame, reference, points, pot=None):
    return atc.fields(
        frame, pot or BruteLJ(), atc.kernel(*KERN), atc.Grid.points(points), ["piola_stress"], reference=reference
    )


@pytest.mark.parametrize("cell", ["orthogonal", "tilted", "slab", "open"])
def test_definition_by_brute_force(cell):
    reference = argon(cell, seed=4)
    frame = deformed(reference, F)
    points = reference.positions[:6] + 0.7
    pot = BruteLJ()
    bonds, _, _ = pot.evaluate(frame)
    # atoms are in their own images: the shift of the current bond is the shift of the reference bond
    shift = np.rint(
        (frame.positions[bonds.i] - frame.positions[bonds.j] - bonds.r_bc) @ np.linalg.inv(frame.cell.vectors)
    )
    R = reference.positions[bonds.i] - reference.positions[bonds.j] - shift @ reference.cell.vectors
    b = np.einsum("b,bi,bj->bij", bonds.G_b, R, bonds.r_bc).reshape(-1, 9)
    want = bond_sum(points, reference.positions[bonds.i], R, b, atc.kernel(*KERN), reference.cell).reshape(-1, 3, 3)
    ds = piola(frame, reference, points)
    got = frame.units.to_internal("pressure", ds.piola_stress.values[0])
    # rounding of sums of a few hundred terms
    np.testing.assert_allclose(got, want, rtol=0, atol=2e-12 * np.abs(want).max())
    assert np.abs(got - got.swapaxes(1, 2)).max() > 1e-3 * np.abs(got).max()  # nine components, not six
    assert "reference" in ds.piola_stress.attrs["sign_convention"] and ds.piola_stress.attrs["error_max"] < 1e-13


def test_reference_is_the_current_frame():
    frame = argon("tilted", seed=5)
    points = frame.positions[:5] + 0.3
    ds = atc.fields(
        frame,
        BruteLJ(),
        atc.kernel(*KERN),
        atc.Grid.points(points),
        ["piola_stress", "stress_potential"],
        reference=frame,
    )
    np.testing.assert_allclose(
        ds.piola_stress, ds.stress_potential, rtol=0, atol=1e-12 * float(abs(ds.stress_potential).max())
    )


@pytest.mark.parametrize("flags", [False, True])
def test_rewrapped_atoms_change_nothing(flags):
    reference = argon("tilted", seed=6)
    frame = deformed(reference, F)
    points = reference.positions[:6] + 0.7
    want = piola(frame, reference, points).piola_stress.values
    rng = np.random.default_rng(0)

    def rewrap(f):
        n = rng.integers(-2, 3, f.positions.shape)
        return f.replace(positions=f.positions + n @ f.cell.vectors, images=-n if flags else None)

    got = piola(rewrap(frame), rewrap(reference), points).piola_stress.values
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.abs(want).max())


def test_image_flags_follow_atoms_that_travelled_far():
    """Three atoms have moved more than half a cell: only image flags can know, and with them the bond through the right
    image is found."""
    reference = argon("orthogonal", seed=7).replace(images=np.zeros((18, 3), int))
    frame = deformed(reference, np.eye(3))
    far = frame.positions.copy()
    far[[1, 5, 9]] += [2.0, 0, 0] @ frame.cell.vectors
    far[[1, 5, 9]] += 0.05
    wrapped, n = frame.cell.wrap(far)
    points = reference.positions[:6] + 0.7
    ds = piola(frame.replace(positions=wrapped, images=n), reference, points)
    bonds, _, _ = BruteLJ().evaluate(frame.replace(positions=far))
    shift = np.rint((far[bonds.i] - far[bonds.j] - bonds.r_bc) @ np.linalg.inv(frame.cell.vectors))
    R = reference.positions[bonds.i] - reference.positions[bonds.j] - shift @ reference.cell.vectors
    b = np.einsum("b,bi,bj->bij", bonds.G_b, R, bonds.r_bc).reshape(-1, 9)
    want = bond_sum(points, reference.positions[bonds.i], R, b, atc.kernel(*KERN), reference.cell).reshape(-1, 3, 3)
    got = frame.units.to_internal("pressure", ds.piola_stress.values[0])
    np.testing.assert_allclose(got, want, rtol=0, atol=2e-12 * np.abs(want).max())


def test_box_integral_is_the_pulled_back_virial():
    """∫P dV₀ = Σ G R⊗r, and for x = F X exactly that is F⁻¹ Σ G r⊗r: P = J F⁻¹ σ in the mean, here over a
    Gaussian-resolved grid."""
    reference = argon("tilted", seed=8)
    frame = deformed(reference, F, shake=0.0)
    pot = BruteLJ()
    ds = atc.fields(
        frame,
        pot,
        atc.kernel("gaussian", width=1.6),
        atc.Grid.regular(shape=(16, 18, 20)),
        ["piola_stress", "virial_stress_potential"],
        tolerance=1e-12,
        reference=reference,
    )
    mean = ds.piola_stress.values[0].reshape(-1, 9).mean(0).reshape(3, 3)
    want = np.linalg.det(F) * np.linalg.inv(F) @ ds.virial_stress_potential.values[0]
    # spacing/width < 0.4: the grid's aliasing error exp(−2π²/0.4²) is below rounding
    np.testing.assert_allclose(mean, want, rtol=0, atol=1e-10 * np.abs(want).max())


def test_divergence_is_the_force_density_of_the_reference():
    """∂P[µν]/∂X_µ = Σ_j F_j φ(X − X_j): the force balance that defines it, by a 10th-order difference of the field."""
    reference = argon("tilted", seed=9)
    frame = deformed(reference, F)
    pot, kern = BruteLJ(), atc.kernel("gaussian", width=1.5)
    bonds, forces, _ = pot.evaluate(frame)
    h = 0.15
    c = np.array([5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260]) / h
    centre = reference.cell.cartesian([[0.3, 0.4, 0.6], [0.8, 0.1, 0.2]])
    steps = np.arange(1, 6) * h
    points = [p + s * k * e for p in centre for e in np.eye(3) for k in steps for s in (1, -1)]
    ds = atc.fields(
        frame, pot, kern, atc.Grid.points(np.array(points)), ["piola_stress"], tolerance=1e-12, reference=reference
    )
    P = frame.units.to_internal("pressure", ds.piola_stress.values[0]).reshape(2, 3, 5, 2, 3, 3)
    divergence = np.einsum("k,pmkmn->pn", c, P[:, :, :, 0] - P[:, :, :, 1])
    from naive_fields import site_sum

    want = site_sum(centre, reference.positions, forces, kern, reference.cell)
    # (h/w)^10/2772 of the 10th-order formula, times derivatives: below 1e-10
    np.testing.assert_allclose(divergence, want, rtol=0, atol=1e-9 * np.abs(want).max())


def test_other_atoms_in_the_reference_are_an_error():
    reference = argon(seed=1)
    frame = deformed(reference, F)
    with pytest.raises(AtcError, match="ids"):
        piola(frame.replace(ids=frame.ids + 1), reference, reference.positions[:2])
    with pytest.raises(AtcError, match="ids"):
        piola(frame, argon(n=(2, 2, 2)), reference.positions[:2])
