"""Every bond, angle, dihedral and improper style that LAMMPS has is supported or has a reason; coefficients from data
files; what objects say."""

import numpy as np
import pytest
from bonded_systems import melt
from decomposer_checks import LAMMPS_TOLERANCE
from lammps_oracle import lammps_session, run_lammps
from test_bonded_impropers import IMPROPERS, pyramids
from test_bonded_torsions import TORSIONS
from test_decomposers_dihedral import chains

import atc
from atc.decomposers import registry
from atc.decomposers.bonded.topology import SECTIONS
from atc.decomposers.bonded.unsupported import REASONS
from atc.decomposers.pairs.hybrid import strip_suffix
from atc.decomposers.pairs.unsupported import reason
from atc.errors import AtcError

KINDS = ("bond", "angle", "dihedral", "improper")


def test_every_style_is_supported_or_has_a_reason():
    atc.potential("bond_style harmonic\nbond_coeff 1 1 1", units="lj")
    with lammps_session() as lmp:
        theirs = {
            kind: {strip_suffix(s) for s in lmp.available_styles(kind)} - {"hybrid", "none", ""} for kind in KINDS
        }
    for kind in KINDS:
        known = set(registry.STYLES[kind]) - {"hybrid"}
        assert len(theirs[kind]) > 8
        assert known | set(REASONS[kind]) | {"zero"} >= theirs[kind], (kind, theirs[kind] - known - set(REASONS[kind]))
        assert not known & set(REASONS[kind])
        for name, why in REASONS[kind].items():
            assert reason(kind, name) == why and "\n" not in why and len(why) > 40


def test_the_reason_reaches_the_user():
    with pytest.raises(
        AtcError, match="line 1: .*angle_style dipole is not supported: it holds the direction of an atom's dipole"
    ):
        atc.potential("angle_style hybrid harmonic dipole\nangle_coeff 1 harmonic 1 1", "lj")


def data_file(config, path, sections):
    """The data file of a Config, with coefficient sections."""
    config.write_data(path)
    path.write_text(
        path.read_text() + "".join(f"\n{name}\n\n" + "\n".join(rows) + "\n" for name, rows in sections.items())
    )


def agrees_from_data_file(tmp_path, config, head, sections):
    """The script's lines read the coefficients from a data file, in LAMMPS and here."""
    path = tmp_path / "coeffs.data"
    data_file(config, path, sections)
    reach = 5.0
    lines = [f"units {config.units}", f"atom_style {config.atom_style}", *head]
    with lammps_session() as lmp:
        for line in (
            *lines[:2],
            "atom_modify map array sort 0 0",
            "box tilt large",
            f"pair_style zero {reach} nocoeff",
            *head,
            f"read_data {path}",
            "pair_coeff * *",
            "compute p all pressure NULL virial",
            "thermo_style custom pe c_p[*]",
            "thermo_modify norm no",
            "run 0 post no",
        ):
            lmp.command(line)
        n = lmp.extract_global("nlocal")
        order = np.argsort(np.array(lmp.numpy.extract_atom("id")[:n]))
        energy, forces = lmp.get_thermo("pe"), np.array(lmp.numpy.extract_atom("f"))[:n][order]
    script = "\n".join([*lines, "read_data coeffs.data"])
    frame = config.frame()
    d = atc.potential(script, folder=tmp_path).decompose(frame)
    u = frame.units
    np.testing.assert_allclose(u.to_user("energy", d.energy), energy, rtol=1e-10)
    np.testing.assert_allclose(
        u.to_user("force", d.forces_nc), forces, rtol=0, atol=LAMMPS_TOLERANCE * np.abs(forces).max()
    )


def rows_of(kind, style, coeffs, hybrid=None):
    """{section: rows} of the lines of a style; for hybrid with the style's name, and `hybrid` = {type: other style's
    row}."""
    words = sorted({w for k, w in SECTIONS if k == kind and w}, key=len, reverse=True)
    out = {}
    for line in coeffs:
        first, *rest = line.split()
        word = rest[0] if rest[0] in words else ""
        row = rest[1:] if word else rest
        out.setdefault(SECTIONS[kind, word], []).append(
            " ".join([first, *([style] if hybrid is not None else []), *row])
        )
    for section, rows in out.items() if hybrid is not None else ():
        rows += [f"{t} {row if section == SECTIONS[kind, ''] else 'skip'}" for t, row in hybrid.items()]
    return {s: sorted(r, key=lambda row: int(row.split()[0])) for s, r in out.items()}


CLASS2 = {
    "angle": [
        "1 100 3 -2 1",
        "2 110 2 0.3 0.1",
        "1 bb 2 1.1 0.9",
        "2 bb -1 0.9 1.05",
        "1 ba 0.7 0.4 1.1 0.9",
        "2 ba 0.2 0.5 1.0 0.95",
    ],
    "dihedral": [c for c in TORSIONS["class2"] if c[0] in "13"],
    "improper": IMPROPERS["class2"],
}


@pytest.mark.parametrize("hybrid", [False, True])
def test_class2_sections_of_a_data_file(tmp_path, hybrid):
    angle = melt()
    agrees_from_data_file(
        tmp_path,
        angle,
        ["bond_style zero", f"angle_style {'hybrid class2 cosine' if hybrid else 'class2'}"],
        {
            "Bond Coeffs": ["1", "2"],
            **rows_of(
                "angle",
                "class2",
                [c for c in CLASS2["angle"] if not hybrid or c[0] == "1"],
                {2: "cosine 2.5"} if hybrid else None,
            ),
        },
    )
    for kind, config, other in (
        ("dihedral", chains(n=12, types=3), "opls 1.3 -0.4 0.8 0.25"),
        ("improper", pyramids(), "cvff 1.3 1 3"),
    ):
        coeffs = [c for c in CLASS2[kind] if c[0] != "2"]
        if not hybrid:
            coeffs += [c.replace("3", "2", 1) for c in coeffs if c[0] == "3"]
        style = f"hybrid class2 {other.split()[0]}" if hybrid else "class2"
        agrees_from_data_file(
            tmp_path, config, [f"{kind}_style {style}"], rows_of(kind, "class2", coeffs, {2: other} if hybrid else None)
        )


def test_a_class2_type_needs_all_its_parts(tmp_path):
    lines = "angle_style class2\nangle_coeff 1 100 3 -2 1\nangle_coeff 1 bb 2 1 1\n"
    with pytest.raises(
        AtcError,
        match=r"line 1: angle type 1 of style class2 lacks coefficients: add angle_coeff 1 ba \(data file: BondAngle "
        r"Coeffs\)",
    ):
        atc.potential(lines, "lj")
    with pytest.raises(AtcError, match="line 3: .*M r1 r2, got 2 1"):
        atc.potential(lines.replace("2 1 1", "2 1"), "lj")


ZEROS = {
    "bond": "harmonic 3 1",
    "angle": "harmonic 3 100",
    "dihedral": "harmonic 1.5 1 2",
    "improper": "harmonic 2 10",
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "lines",
    ["hybrid harmonic zero\n{0}_coeff * {1}\n{0}_coeff 2 zero", "hybrid zero nocoeff harmonic\n{0}_coeff 1 {1}"],
)
def test_zero_among_others(kind, lines):
    config = {"dihedral": lambda: chains(n=12, types=2), "improper": pyramids}.get(kind, melt)()
    kinds = getattr(config, f"{kind}_types")
    kinds[kinds > 2] = 2
    lines = f"{kind}_style " + lines.format(kind, ZEROS[kind]) + "\n"
    if "nocoeff" in lines:
        lines += f"{kind}_coeff 2 zero of no matter\n"
    others = "".join(f"{k}_style zero\n{k}_coeff *\n" for k in KINDS if k != kind and len(getattr(config, f"{k}s")))
    reach = 5.0 if config.units == "real" else 3.0
    res = run_lammps(f"pair_style zero {reach}\npair_coeff * *\n{others}{lines}", config)
    d = atc.potential(others + lines, config.units).decompose(config.frame())
    u = config.frame().units
    np.testing.assert_allclose(u.to_user("energy", d.energy), res.energy, rtol=1e-10)
    np.testing.assert_allclose(
        u.to_user("force", d.forces_nc), res.forces_nc, rtol=0, atol=1e-10 * np.abs(res.forces_nc).max()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_lines_of_zero_are_read(kind):
    """They were not looked at."""
    size = "r0" if kind == "bond" else "theta0"
    takes = rf"\[{size}\]" if kind in ("bond", "angle") else "no numbers"
    for lines, says in (
        (f"zero\n{kind}_coeff 1 1 2", f"line 4: {kind}_coeff of zero takes {takes}, got 1 2"),
        (f"zero\n{kind}_coeff 0", "line 4: the types '0' are no range"),
        (f"zero\n{kind}_coeff x", "line 4: expected a type"),
        (f"zero full\n{kind}_coeff 1", f"line 3: {kind}_style zero takes nothing or nocoeff, got full"),
    ):
        with pytest.raises(AtcError, match=says):
            atc.potential(f"pair_style lj/cut 2\npair_coeff * * 1 1\n{kind}_style {lines}", "lj")
    atc.potential(f"pair_style lj/cut 2\npair_coeff * * 1 1\n{kind}_style zero nocoeff\n{kind}_coeff 1 x y", "lj")
