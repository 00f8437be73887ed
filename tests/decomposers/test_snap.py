"""SNAP: every file that LAMMPS comes with and every key against LAMMPS, a naive bispectrum, what is refused."""

import numpy as np
import pytest
from energy_systems import lammps_potentials
from lammps_oracle import Config, run_lammps

import atc
from atc.decomposers.many_body.snap_file import read_snap
from atc.decomposers.many_body.snap_tables import clebsch_gordan, mirrored, offset, products, rows, triples
from atc.errors import AtcError
from atc.units import units

POTENTIALS = lammps_potentials()
#: elements, lattice and its constant in Å, of every potential there is
SHIPPED = {
    "Ta06A": ("Ta", "bcc", 3.3),
    "W_2940_2017_2": ("W", "bcc", 3.16),
    "WBe_Wood_PRB2019": ("W Be", "bcc", 3.1),
    "InP_JCPA2020": ("In P", "diamond", 5.8),
    "Mo_Chen_PRM2017": ("Mo", "bcc", 3.15),
    "C_SNAP_2021.10.15.quadratic": ("C", "diamond", 3.57),
    **{
        f"{element}_Zuo_JPCA2020{form}": (element, lattice, a)
        for element, lattice, a in (
            ("Si", "diamond", 5.43),
            ("Ge", "diamond", 5.7),
            ("Cu", "fcc", 3.6),
            ("Ni", "fcc", 3.5),
            ("Li", "bcc", 3.5),
            ("Mo", "bcc", 3.15),
        )
        for form in ("", ".quadratic")
    },
}
_FCC = [[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]
_BASIS = {"bcc": [[0, 0, 0], [0.5, 0.5, 0.5]], "fcc": _FCC, "diamond": [*_FCC, *(np.array(_FCC) + 0.25)]}


def crystal(lattice, a, kinds=1, cells=2):
    """A tilted, shaken piece, mostly smaller than two cutoffs."""
    rng = np.random.RandomState(0)
    places = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    s = (places + np.array(_BASIS[lattice])).reshape(-1, 3) / cells
    cell = a * cells * np.array([[1, 0, 0], [0.1, 1.03, 0], [-0.05, 0.07, 0.98]])
    x = s @ cell + 0.025 * a * rng.normal(size=s.shape)
    return Config(cell=cell, positions=x, types=rng.randint(1, kinds + 1, len(x)), ntypes=kinds)


def agrees(lines, config, tolerance=1e-12):
    """Energies of atoms, forces and virial, of the largest; returns the potential."""
    want = run_lammps(lines, config)
    frame, pot = config.frame(), atc.potential(lines, units="metal")
    u, d = frame.units, pot.decompose(frame, threads=2, sources=True)
    assert abs(u.to_user("energy", d.energy) - want.energy) <= 1e-12 * np.abs(want.energies_n).sum()
    for ours, theirs, size in (
        (u.to_user("energy", d.energies_n), want.energies_n, want.energies_n),
        (u.to_user("force", d.forces_nc), want.forces_nc, want.forces_nc),
        (u.to_user("pressure", d.virial_cc / frame.cell.volume) * want.volume, want.virial, want.stress_n),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * np.abs(size).max())
    b = d.bonds
    if "hybrid" not in lines:
        np.testing.assert_allclose(b.F_bc, b.D_bdc[:, 0] - b.D_bdc[:, 1], rtol=0, atol=0)
        assert np.abs(np.cross(b.r_bc, b.F_bc)).max() > 0.01 * np.abs(b.F_bc).max()
    return pot


def _script(name, elements):
    """The lines that come with the files, or those for them alone."""
    path = POTENTIALS / f"{name}.snap"
    if not path.exists():
        return f"pair_style snap\npair_coeff * * {POTENTIALS}/{name}.snapcoeff {POTENTIALS}/{name}.snapparam {elements}"
    text = "\n".join(line.partition("#")[0] for line in path.read_text().replace("&\n", " ").split("\n"))
    for ending in (".snapcoeff", ".snapparam"):
        text = text.replace(f"{name}{ending}", f"{POTENTIALS}/{name}{ending}")
    return "\n".join(line for line in text.split("\n") if line.strip())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_files(name):
    elements, lattice, a = SHIPPED[name]
    # The forces of LAMMPS are the gradient of its energy if coefficients are alike that ought to be: those of InP are,
    # to ten digits.
    tolerance = 1e-8 if name.startswith("InP") else 1e-12
    agrees(_script(name, elements), crystal(lattice, a, len(elements.split())), tolerance)


def test_no_file_is_left_out():
    there = {p.name.removesuffix(".snapcoeff") for p in POTENTIALS.glob("*.snapcoeff")}
    assert there == set(SHIPPED)


def write(folder, keys, names=("In", "P"), seed=0):
    """Random coefficients, alike where the two densities that they multiply may be exchanged."""
    keys = {"rcutfac": 1.0, "twojmax": 4, **keys}
    rng, T, t = np.random.default_rng(seed), triples(keys["twojmax"]), len(names)
    chemical = keys.get("chemflag")
    labels = list(np.ndindex(t, t, t)) if chemical else [(0, 0, 0)]
    known: dict = {}
    lines = []
    for e, name in enumerate(names):
        row = [
            known.setdefault((e, k, *sorted(zip(n, label))), rng.normal(scale=0.02))
            for label in labels
            for k, n in enumerate(T)
        ]
        if keys.get("quadraticflag"):
            row += list(rng.normal(scale=1e-4, size=len(row) * (len(row) + 1) // 2))
        lines += [f"{name} {2.0 + 0.3 * e} {1.0 - 0.3 * e}", repr(0.5 + e), *(repr(float(x)) for x in row)]
    head = [f"{t} {len(row) + 1}"]
    (folder / "x.snapcoeff").write_text("\n".join(["# UNITS: metal", *head, *lines]) + "\n")
    (folder / "x.snapparam").write_text("\n".join(f"{k} {v}" for k, v in keys.items()) + "\n")
    return f"pair_style snap\npair_coeff * * {folder}/x.snapcoeff {folder}/x.snapparam {' '.join(names)}"


@pytest.mark.parametrize(
    "keys",
    [
        {"twojmax": 5, "rfac0": 0.8},
        {"switchflag": 0},
        {"rmin0": 1.0},
        {"rmin0": 2.6},
        {"bnormflag": 1, "bzeroflag": 0, "quadraticflag": 1},
        {"quadraticflag": 1},
        {"switchinnerflag": 1, "sinner": "2.2 2.5", "dinner": "0.4 0.5"},
        {"chemflag": 1, "bnormflag": 1},
        {"chemflag": 1, "wselfallflag": 1},
        {"chemflag": 1, "wselfallflag": 1, "bzeroflag": 0, "bnormflag": 1, "chunksize": 100},
    ],
    ids=lambda keys: " ".join(f"{k} {v}" for k, v in keys.items()),
)
def test_keys(keys, tmp_path):
    """rmin0 2.6: some neighbours are nearer."""
    agrees(write(tmp_path, keys), crystal("diamond", 5.6, 2))


@pytest.mark.parametrize("keys", [{"chemflag": 1}, {"switchinnerflag": 1, "sinner": "2.2 2.7", "dinner": "0.4 0.5"}])
def test_the_order_is_that_of_the_line(keys, tmp_path):
    """Labels of components, and the numbers of the inner switch."""
    lines = write(tmp_path, {"twojmax": 2, **keys})
    agrees(lines.replace("In P", "P In"), crystal("diamond", 5.6, 2))


def test_types_left_out(tmp_path):
    lines = write(tmp_path, {}).removesuffix("In P") + "NULL P"
    agrees("\n".join(["pair_style hybrid/overlay snap zero 4.0", "pair_coeff * * zero",
                      lines.split("\n")[1].replace("* * ", "* * snap ")]), crystal("diamond", 5.6, 2))  # fmt: skip


def test_other_units(tmp_path):
    """The file's own tag decides whether it may be used."""
    lines = write(tmp_path, {})
    with pytest.raises(AtcError, match=r"'metal' units and the model in 'real'"):
        atc.potential(lines, units="real")
    path = tmp_path / "x.snapcoeff"
    path.write_text(path.read_text().replace("UNITS: metal", ""))
    frame = crystal("diamond", 5.6, 2).frame()
    a, b = (atc.potential(lines, units=u) for u in ("metal", "real"))
    kcal = units("real").factor("energy") / units("metal").factor("energy")
    np.testing.assert_allclose(b.decompose(frame).energies_n, kcal * a.decompose(frame).energies_n, rtol=1e-12)


def test_against_the_definition():
    """B as its sum over all m, of a density of four rotations; derivatives of Σ beta B by differences."""
    top, rng = 5, np.random.default_rng(0)
    table, step = products(top, False, False), rows(top)

    def rotation():
        v = rng.normal(size=4)
        v /= np.linalg.norm(v)
        a, b = complex(*v[:2]), complex(*v[2:])
        u = np.zeros(offset(top + 1), complex)
        u[0] = 1
        for o, f, n, middle in zip(step.out, step.from_, step.n, step.middle):
            for l in range(n + 1):
                p, q = (u[f + l] if l < n else 0) * step.p[o + l], (u[f + l - 1] if l else 0) * step.q[o + l]
                u[o + l] = b * p + a * q if middle else np.conj(a) * p - np.conj(b) * q
        to, of, sign = mirrored(top)
        u[to] = sign * np.conj(u[of])
        for n in range(top + 1):
            M = u[offset(n) : offset(n + 1)].reshape(n + 1, n + 1)
            np.testing.assert_allclose(M @ M.conj().T, np.eye(n + 1), rtol=0, atol=1e-13)
        return u

    def definition(u):
        found = []
        for n1, n2, n in triples(top):
            u1, u2, u3 = (u[offset(m) : offset(m + 1)].reshape(m + 1, m + 1) for m in (n1, n2, n))
            G, s, total = clebsch_gordan(n1, n2, n), (n1 + n2 - n) // 2, 0
            for k, l, k1, l1 in np.ndindex(n + 1, n + 1, n1 + 1, n1 + 1):
                if 0 <= k + s - k1 <= n2 and 0 <= l + s - l1 <= n2:
                    H = G[k1, k] * G[l1, l]
                    total += np.conj(u3[k, l]) * H * u1[k1, l1] * u2[k + s - k1, l + s - l1]
            found.append(total)
        found = np.array(found)
        assert np.abs(found.imag).max() < 1e-13 * np.abs(found).max()
        return found.real

    u, du = (sum(rng.normal() * rotation() for _ in range(4)) for _ in range(2))
    Z = np.array([table.C[i:j] @ (u[table.a[i:j]] * u[table.b[i:j]]) for i, j in zip(table.first, table.first[1:])])
    B = np.bincount(table.component, table.own * (np.conj(u[table.out]) * Z).real)
    want = definition(u)
    np.testing.assert_allclose(B, want, rtol=0, atol=1e-13 * np.abs(want).max())
    beta, h = rng.normal(size=len(B)), 1e-4
    slope = (table.weight * beta[table.component] * (np.conj(du[table.out]) * Z).real).sum()
    # of third degree: the error of the difference is h² times the cube's coefficient
    numeric = (beta @ (definition(u + h * du) - definition(u - h * du))) / (2 * h)
    assert abs(slope - numeric) < 1e-6 * abs(slope)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("param", "twojmax 4", "", "twojmax is missing"),
        ("param", "twojmax 4", "twojmax 5", "15 coefficients of each element"),
        ("param", "twojmax 4", "twojmax 99", "a whole number from 0 to 20"),
        ("param", "rcutfac 1.0", "rcutfac nan", "x.snapparam:1: rcutfac must be a positive number"),
        ("param", "rcutfac 1.0", "rcutfac 1.0 2", "x.snapparam:1: expected one value behind rcutfac"),
        ("param", "rcutfac 1.0", "rcutfac 1.0\nrmin0 9", "below the cutoff"),
        ("param", "rcutfac 1.0", "rcutfac 1.0\ndiagonalstyle 3", "x.snapparam:2: unknown key 'diagonalstyle'"),
        ("param", "rcutfac 1.0", "rcutfac 1.0\nswitchflag 2", "expected 0 or 1 for switchflag"),
        ("param", "rcutfac 1.0", "rcutfac 1.0\nswitchinnerflag 1", "switchinnerflag 1 needs sinner"),
        ("param", "rcutfac 1.0", "rcutfac 1.0\nsinner 1 1", "sinner goes with switchinnerflag 1"),
        ("coeff", "2 15", "2", "x.snapcoeff:2: expected the numbers of elements"),
        ("coeff", "2 15", "2 16", "x.snapcoeff:19: expected a coefficient of In, got 'P 2.3 0.7'"),
        ("coeff", "2 15", "1 15", "x.snapcoeff:19: more lines than"),
        ("coeff", "P 2.3 0.7", "P 2.3", "expected an element, its radius and its weight"),
        ("coeff", "P 2.3 0.7", "In 2.3 0.7", "an element occurs twice"),
        ("coeff", "P 2.3 0.7", "P -2.3 0.7", "the radius must be a positive number"),
        ("coeff", "0.5\n", "half\n", "x.snapcoeff:4: a coefficient must be a number, got 'half'"),
    ],
)
def test_files_that_are_refused(file, old, new, said, tmp_path):
    lines = write(tmp_path, {})
    path = tmp_path / f"x.snap{file}"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(AtcError) as e:
        atc.potential(lines, units="metal")
    assert said in str(e.value) and "\n" not in str(e.value)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("pair_style snap\npair_coeff * * {0}/x.snapcoeff In P", r"got .* behind|no such file"),
        ("pair_style snap\npair_coeff * * {0}/x.snapcoeff", "wants pair_coeff"),
        ("pair_style snap\npair_coeff 1 1 {0}/x.snapcoeff {0}/x.snapparam In", r"replace the types by \* \*"),
        ("pair_style snap\npair_coeff * * {0}/x.snapcoeff {0}/x.snapparam In P Ga", "has no element 'Ga'"),
        ("pair_style snap\npair_coeff * * {0}/x.snapcoeff {0}/x.snapparam In In", "with chemflag every element"),
        ("pair_style snap 5\npair_coeff * * {0}/x.snapcoeff {0}/x.snapparam In P", "expected no arguments, got 5"),
    ],
)
def test_lines_that_are_refused(lines, said, tmp_path):
    write(tmp_path, {"chemflag": 1, "twojmax": 2})
    with pytest.raises(AtcError, match=said):
        atc.potential(lines.format(tmp_path), units="metal")


def test_forces_that_lammps_would_not_have(tmp_path):
    """With a density for each element LAMMPS's forces are only the gradient of the energy if coefficients agree."""
    lines = write(tmp_path, {"chemflag": 1, "twojmax": 2})
    path = tmp_path / "x.snapcoeff"
    text = path.read_text().split("\n")
    # (1 0 1) of In In P and of P In In
    n = len(triples(2))
    text[4 + 1 * n + triples(2).index((1, 0, 1))] = "0.5"
    path.write_text("\n".join(text))
    with pytest.raises(AtcError, match="differ from one another"):
        atc.potential(lines, units="metal")


def test_shapes_of_what_is_read():
    file = read_snap(POTENTIALS / "InP_JCPA2020.snapcoeff", POTENTIALS / "InP_JCPA2020.snapparam")
    assert file.names == ("In", "P") and file.beta.shape == (2, 240) and file.alpha.shape == (2, 0, 0)
