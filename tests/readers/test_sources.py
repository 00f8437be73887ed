"""Per-atom energies and their derivatives ∂U^(j)/∂x_k: right, complete, and the only things that a partition of the
energy changes."""

import numpy as np
import pytest
from decomposer_checks import source_matrix
from energy_systems import (
    LINES,
    NAMES,
    PARTITIONED,
    SMOOTH,
    TUPLES,
    RandomTerm,
    chains,
    cluster,
    diamond,
    potential,
    primitive,
    system,
)
from frames import argon

import atc
from atc.decomposers import HarmonicAngle, HybridTerm, LennardJones, StillingerWeber, Term
from atc.decomposers.many_body.stillinger_weber_kernels import sw_merge
from atc.frame import Cell
from atc.units import units

SI = {
    "epsilon": 2.1683,
    "sigma": 2.0951,
    "a": 1.80,
    "lam": 21.0,
    "gamma": 1.20,
    "costheta0": -1 / 3,
    "A": 7.049556277,
    "B": 0.6022245584,
    "p": 4.0,
    "q": 0.0,
}
EVERY = [*((n, None) for n in NAMES), *((n, "center") for n in PARTITIONED)]


def ids(values):
    return [f"{n} {p or ''}".strip() for n, p in values]


def rates(bonds, v, n):
    """dU^(j)/dt = Σ_k v_k·∂U^(j)/∂x_k; that of the atom itself is −Σ of the others', since nothing changes when all
    move together."""
    out = np.zeros(n)
    np.add.at(out, bonds.i, np.einsum("bc,bc->b", bonds.D_bdc[:, 0], v[bonds.j] - v[bonds.i]))
    np.add.at(out, bonds.j, np.einsum("bc,bc->b", bonds.D_bdc[:, 1], v[bonds.i] - v[bonds.j]))
    return out


@pytest.mark.parametrize("name,partition", EVERY, ids=ids(EVERY))
def test_shares_change_as_the_sources_say(name, partition):
    """Along random velocities, against central differences of the shares: they come closer with the square of the
    step."""
    frame, pot = system(name, partition)
    v = np.random.default_rng(3).normal(size=(len(frame), 3))
    d = pot.decompose(frame, sources=True)
    assert d.bonds.D_bdc.shape == (len(d.bonds), 2, 3)
    want = rates(d.bonds, v, len(frame))
    # what the rate of an atom's share is a sum of
    scale = np.abs(source_matrix(d.bonds, len(frame))).sum(axis=(1, 2)).max()

    def slope(h):
        up, down = (
            pot.stream(frame.replace(positions=frame.positions + s * h * v), energies=True).energies_n for s in (1, -1)
        )
        return (up - down) / (2 * h)

    if name in SMOOTH:
        # C² functions whose third derivatives are 1/Å³ and more: the difference is h² U'''/6, until rounding, 1e-16
        # U/h, is met
        h = np.array([4e-3, 2e-3, 1e-3])
        error = [np.abs(slope(s) - want).max() for s in h]
        assert error[-1] < 1e-4 * scale
        falls = np.log2(np.array(error[:-1]) / error[1:])
        assert np.all(np.abs(falls - 2.0) < 0.1) or max(error) < 1e-9 * scale, falls
    # Romberg's step takes h² away; left are h⁴ terms, (1e-4)⁴, jumps of U'' in splines and at cutoffs, h U'', and
    # rounding, 1e-16 U/h = 1e-12 U
    best = (4 * slope(1e-4) - slope(2e-4)) / 3
    np.testing.assert_allclose(best, want, rtol=0, atol=(1e-8 if name in SMOOTH else 1e-5) * scale)


@pytest.mark.parametrize("name,partition", EVERY, ids=ids(EVERY))
def test_sources_add_up_to_the_forces_and_cost_nothing_else(name, partition):
    """Σ_j ∂U^(j)/∂x_k = −F_k, since Σ U^(j) = U; asking for sources leaves energy, forces and virial alone; nothing is
    made unasked."""
    frame, pot = system(name, partition)
    plain, d = pot.decompose(frame), pot.decompose(frame, sources=True, threads=2)
    assert plain.bonds.D_bdc is None
    m = source_matrix(d.bonds, len(frame))
    # rounding of sums over an atom's bonds
    terms = np.abs(d.bonds.D_bdc).max()
    np.testing.assert_allclose(m.sum(axis=0), -d.forces_nc, rtol=0, atol=1e-12 * terms * len(d.bonds))
    np.testing.assert_allclose(d.energies_n, plain.energies_n, rtol=0, atol=1e-13 * np.abs(plain.energies_n).max())
    np.testing.assert_allclose(d.forces_nc, plain.forces_nc, rtol=0, atol=1e-12 * terms * len(d.bonds))
    np.testing.assert_allclose(
        d.virial_cc, plain.virial_cc, rtol=0, atol=1e-12 * np.abs(d.bonds.G_b) @ (d.bonds.r_bc**2).sum(1)
    )


@pytest.mark.parametrize("name,partition", EVERY, ids=ids(EVERY))
def test_churning_has_no_mean(name, partition):
    """∫ z dV = Σ G x⊗x + Σ x_jk ⊗ ∂U^(j)/∂x_k = 0 for every term and every partition: z is divergence-free, so ∫ z^{µν}
    = ∫ ∂_α(x^µ z^{αν}) = 0.

    This is the conjecture of R (behind 4.0.133): z vanishes in the virial limit, for any number of bodies."""
    frame, pot = system(name, partition)
    b = pot.decompose(frame, sources=True).bonds
    S, M = b.virial(), np.einsum("bm,bn->mn", b.r_bc, b.D_bdc[:, 0] - b.D_bdc[:, 1])
    assert np.abs(S).max() > 0
    # rounding
    np.testing.assert_allclose(
        S, -M, rtol=0, atol=1e-13 * np.linalg.norm(b.forces(), axis=1) @ np.linalg.norm(b.r_bc, axis=1)
    )


@pytest.mark.parametrize("name", PARTITIONED)
def test_partition_changes_shares_and_nothing_else(name):
    frame, equal = system(name)
    center = potential(name, "center")
    a, b = equal.decompose(frame, sources=True), center.decompose(frame, sources=True)
    assert np.array_equal(a.forces_nc, b.forces_nc) and np.array_equal(a.virial_cc, b.virial_cc)
    assert a.energy == b.energy
    total = np.abs(a.energies_n).sum()
    for d in (a, b):
        assert d.energies_n.sum() == pytest.approx(d.energy, rel=0, abs=1e-14 * total * len(frame))
    assert equal.describe() != center.describe()
    if name != "sw primitive":  # two atoms that are each other's mirror image have equal shares, however cut
        assert np.abs(a.energies_n - b.energies_n).max() > 1e-3 * total
    assert np.abs(source_matrix(a.bonds, len(frame)) - source_matrix(b.bonds, len(frame))).max() > 0
    # the default is "equal", and asking for it changes nothing
    again = potential(name, "equal")
    assert again.describe() == equal.describe()
    assert np.array_equal(again.decompose(frame).energies_n, a.energies_n)


def test_shares_of_one_triplet_and_one_angle():
    """With no two-body part what each atom has is a third of the energy, or the one at the middle has all."""
    x = np.array([[0, 0, 0], [2.3, 0.1, 0], [-1.7, 1.6, 0.3]])
    frame = atc.Frame(x, Cell([20.0] * 3, periodic=(0, 0, 0)), units("metal"))
    for partition, w in (
        ("equal", (1 / 3, 1 / 3, 1 / 3)),
        ("center", (1, 0, 0)),
        ("centre", (1, 0, 0)),
        ((0.5, 0.25, 0.25), (0.5, 0.25, 0.25)),
    ):
        term = StillingerWeber(**{**SI, "A": 0.0}, partition=partition)
        d = atc.potential(term).decompose(frame, sources=True)
        np.testing.assert_allclose(d.energies_n, np.multiply(w, d.energy), rtol=1e-14)
        np.testing.assert_allclose(source_matrix(d.bonds, 3), np.multiply.outer(w, -d.forces_nc), rtol=0, atol=1e-14)
        top = atc.frame.Topology(angles=[[1, 0, 2]], angle_types=[1])
        order = (w[1], w[0], w[2])
        given = partition if isinstance(partition, str) else order
        d = atc.potential(HarmonicAngle((1.0, 110.0), partition=given)).decompose(
            frame.replace(topology=top), sources=True
        )
        np.testing.assert_allclose(d.energies_n, np.multiply(w, d.energy), rtol=1e-14)
        np.testing.assert_allclose(source_matrix(d.bonds, 3), np.multiply.outer(w, -d.forces_nc), rtol=0, atol=1e-14)
    assert "to the atom at its center" in StillingerWeber(**SI, partition="center").describe()
    assert "a third to each" in StillingerWeber(**SI).describe()
    assert "0.5 : 0.25 : 0.25" in term.describe()


def moments(frame, bonds, times):
    """Σ over ordered pairs of x_jk ⊗ ∂U^(j)/∂x_k, and Σ G x⊗x, weighted with functions of the bond's middle that have
    `frame`'s periods (`times`: how often they are counted)."""
    mid = (frame.positions[bonds.i] - 0.5 * bonds.r_bc) @ frame.cell.inverse * times
    flow = np.einsum("bm,bn->bmn", bonds.r_bc, bonds.D_bdc[:, 0] - bonds.D_bdc[:, 1])
    wave = np.exp(2j * np.pi * mid @ np.array([[1, 0, 1], [0, 1, 2], [-1, 1, 0]]).T)
    return np.einsum("bw,bmn->wmn", wave, flow), np.einsum("bw,b,bm,bn->wmn", wave, bonds.G_b, bonds.r_bc, bonds.r_bc)


@pytest.mark.parametrize("partition", ["equal", "center"])
@pytest.mark.parametrize("name", ["sw primitive", "sw", "sw two elements"])
def test_images_of_an_atom_are_told_apart(name, partition):
    """In a cell smaller than the cutoff an atom meets its own images: bonds and sources run through the same images as
    in a cell 3³ times as large."""
    frame, pot = system(name, partition)
    small = pot.decompose(frame, sources=True).bonds
    if name == "sw primitive":
        assert (small.i == small.j).any()
    shifts = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3) @ frame.cell.vectors
    big = atc.Frame(
        (frame.positions + shifts[:, None]).reshape(-1, 3),
        Cell(3 * frame.cell.vectors, frame.cell.origin),
        frame.units,
        types=np.tile(frame.types, 27),
    )
    large = pot.decompose(big, sources=True).bonds
    assert not (large.i == large.j).any()
    for a, b in zip(moments(frame, small, 1), moments(big, large, 3), strict=True):
        # rounding of sums of a thousand bonds
        np.testing.assert_allclose(27 * a, b, rtol=0, atol=1e-11 * np.abs(b).max())
    # and the large one's sources are right
    v = np.random.default_rng(1).normal(size=(len(big), 3))
    h = 1e-4
    up, down = (pot.stream(big.replace(positions=big.positions + s * h * v), energies=True).energies_n for s in (1, -1))
    want = rates(large, v, len(big))
    # h² U'''/6
    np.testing.assert_allclose((up - down) / (2 * h), want, rtol=0, atol=1e-5 * np.abs(want).max())


def test_no_source_is_lost_with_a_bond_of_no_force():
    """A bond whose G is 0 may still carry energy from one atom to the other; without sources such bonds are dropped."""
    x, arm = np.array([[1.0, 2.0, 2.0, 1 / 3, 1.0, 0.0, 1.0, 0.0]]), np.zeros((1, 2, 2, 3))
    arm[0, 0, 0] = [0.5, -1.0, 2.0]
    i = np.zeros(1, np.int32)
    out = [np.empty(1, np.int32), np.empty(1, np.int32), np.empty((1, 3)), np.empty(1)]
    atom = np.zeros(1, np.int32)
    D = np.empty((1, 2, 3))
    assert sw_merge(0, 1, i, i, x, np.zeros(1), np.zeros((1, 2)), None, atom, *out, None) == 0
    assert sw_merge(0, 1, i, i, x, np.zeros(1), np.zeros((1, 2)), arm, atom, *out, D) == 1
    assert D[0].tolist() == [[0.5, -1.0, 2.0], [0.0, 0.0, 0.0]]
    # leaving out weak outer bonds goes with forces only
    frame = diamond()
    term = StillingerWeber(**SI)
    whole = atc.potential(term).decompose(frame, sources=True)
    term.prune = np.inf
    pruned = atc.potential(term)
    assert len(pruned.decompose(frame).bonds) < len(whole.bonds) == len(pruned.decompose(frame, sources=True).bonds)


def test_threebody_off_and_mixed_terms():
    """Two-body Stillinger-Weber, and pairs, bonds and angles beside each other: every bond has its sources."""
    frame = diamond()
    d = atc.potential(StillingerWeber(**SI, threebody=False)).decompose(frame, sources=True)
    np.testing.assert_allclose(d.bonds.D_bdc[:, 0], -0.5 * d.bonds.G_b[:, None] * d.bonds.r_bc, rtol=1e-15)
    frame = chains()
    pot = atc.potential(
        [LennardJones(0.01, 1.5, 4.0, n_types=2, units="metal"), HarmonicAngle({1: (1.0, 110.0), 2: (2.0, 100.0)})]
    )
    d = pot.decompose(frame, sources=True)
    assert len(d.bonds.D_bdc) == len(d.bonds) > 27
    np.testing.assert_allclose(
        source_matrix(d.bonds, len(frame)).sum(axis=0), -d.forces_nc, rtol=0, atol=1e-10 * np.abs(d.forces_nc).max()
    )


def test_every_chunk_of_a_stream_has_its_sources():
    frame, pot = system("sw")
    seen = []
    pot.stream(
        frame,
        lambda b, t: seen.append(b.D_bdc is not None and b.D_bdc.shape == (len(b), 2, 3)),
        sources=True,
        threads=2,
    )
    assert seen and all(seen)
    seen = []
    pot.stream(frame, lambda b, t: seen.append(b.D_bdc is None), threads=2)
    assert seen and all(seen)


def test_a_term_without_sources_says_so():
    class Mute(Term):
        def prepare(self, frame):
            class Work:
                stages = (1,)

                def run(self, stage, task, acc):
                    return atc.bonds.Bonds(np.zeros(1, np.int32), np.ones(1, np.int32), np.ones((1, 3)), np.ones(1))

            return Work()

        def describe(self):
            return "mute"

    frame = cluster()
    pot = atc.potential(Mute(), "metal")
    assert len(pot.decompose(frame).bonds) == 1
    with pytest.raises(NotImplementedError, match="mute"):
        pot.decompose(frame, sources=True)


# How a partition is chosen
# ---------------------------------------------------------------------------------------------------------------


def test_partition_by_word_and_by_term():
    lines = LINES["angle harmonic"] + "\n" + LINES["dihedral opls"]
    both = {
        p if isinstance(p, str) else "dict": atc.potential(lines, "metal", partition=p).describe()
        for p in ("equal", "center", {"dihedral": "inner"})
    }
    assert both["equal"] == atc.potential(lines, "metal").describe()
    assert "middle atom" in both["center"] and "two inner atoms" in both["center"]
    assert "a third" in both["dict"] and "two inner atoms" in both["dict"]
    numbers = atc.potential(lines, "metal", partition={"angle": (0.25, 0.5, 0.25)})
    assert "0.25 : 0.5 : 0.25" in numbers.describe()
    # what has one way only stays as it is
    assert atc.potential(LINES["lj"], "metal", partition="center").describe() == potential("lj").describe()


def test_objects_are_not_changed():
    term = StillingerWeber(**SI)
    center = atc.potential(term, partition="center")
    frame = diamond()
    assert "a third to each" in term.describe() and "at its center" in center.describe()
    assert atc.potential(center) is center
    back = atc.potential(center, partition="equal")
    assert "at its center" in center.describe()
    np.testing.assert_array_equal(back.decompose(frame).energies_n, atc.potential(term).decompose(frame).energies_n)
    # objects keep what they were made with, unless told otherwise
    made = StillingerWeber(**SI, partition="center")
    assert (
        "at its center" in atc.potential(made).describe()
        and "a third to each" in atc.potential(made, partition="equal").describe()
    )
    hybrid = HybridTerm([HarmonicAngle({1: (1.0, 110.0)}), HarmonicAngle({2: (1.0, 110.0)})])
    assert atc.potential(hybrid, partition="center").describe().count("middle atom") == 2
    assert "middle" not in hybrid.describe()


def test_partition_holds_for_types_that_lines_do_not_name():
    """``angle_coeff *`` is built anew for a frame with more types."""
    frame = chains()
    pot = atc.potential(LINES["angle cosine"], "metal", partition="center")
    by_type = atc.potential("angle_style cosine\nangle_coeff 1 1.5\nangle_coeff 2 1.5", "metal", partition="center")
    np.testing.assert_array_equal(pot.decompose(frame).energies_n, by_type.decompose(frame).energies_n)
    assert np.abs(pot.decompose(frame).energies_n[::5]).max() == 0  # the ends of the chains


@pytest.mark.parametrize(
    "lines,partition,says",
    [
        ("sw", "thirds", "'thirds': expected 'equal' or 'center'"),
        ("sw", 3, "must be 'equal' or 'center'"),
        ("sw", {"tersoff": "center"}, "no term 'tersoff'.* it has sw"),
        ("lj", {"sw": "center"}, "no term 'sw'.* none"),
        ("lj", {"": "center"}, "no term ''"),
        ("sw", {"sw": "inner"}, "sw: partition 'inner': expected one of 'equal', 'center'"),
        ("sw", {"sw": (0.5, 0.4, 0.1)}, "outer atoms of a triplet are equals"),
        ("sw", {"sw": (0.5, 0.4)}, "3 numbers that add up to 1"),
        ("angle charmm", {"angle": (0.5, 0.4, 0.2)}, "3 numbers that add up to 1"),
        ("dihedral opls", {"dihedral": "center"}, "'equal', 'inner'"),
    ],
)
def test_partitions_that_make_no_sense(lines, partition, says):
    with pytest.raises(atc.AtcError, match=says) as e:
        potential(lines).partitioned(partition)
    assert "\n" not in str(e.value)
    with pytest.raises(atc.AtcError, match=says):
        atc.potential(potential(lines), partition=partition)


def test_systems_are_what_they_say():
    """The tests above would show little if atoms were far apart, or the random terms of one body less."""
    assert (primitive().positions.shape, len(argon("tilted", n=(2, 3, 3)))) == ((2, 3), 18)
    for k in (3, 4, 5):
        term = RandomTerm(k, TUPLES)
        d = atc.potential(term, "metal").decompose(cluster())
        assert len(d.bonds) == len(TUPLES) * k * (k - 1) // 2
