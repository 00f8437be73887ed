"""Neuroevolution potentials: against calorine, as stored (`nep_oracle`), and what their bonds must obey."""

import numpy as np
import pytest
from nep_oracle import CASES, KEPT, atoms, write

from atc.decomposers.many_body.nep import nep
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

METAL = units("metal")


def made(folder, name, **changes):
    """A model of `CASES` and its atoms."""
    case = CASES[name] | changes
    names = case.get("names", ("Si", "C"))
    path = folder / "nep.txt"
    write(path, **case)
    x, cell, species = atoms(len(names))
    return nep(path, names), Frame(x, Cell(cell), METAL, types=species + 1)


@pytest.mark.parametrize("name", CASES)
def test_against_calorine(name, tmp_path):
    """Energies, forces and virials of atoms; a virial W_k is the sum of −r⊗∂U^(j)/∂r over edges j → k."""
    pot, frame = made(tmp_path, name)
    d = pot.decompose(frame, sources=True, threads=2)
    U, F, W = np.split(np.load(KEPT)[name], [1, 4], axis=1)
    b, energy = d.bonds, METAL.factor("energy")
    found = np.zeros((len(frame), 3, 3))
    np.add.at(found, b.j, b.r_bc[:, :, None] * b.D_bdc[:, 0, None, :])
    np.add.at(found, b.i, -b.r_bc[:, :, None] * b.D_bdc[:, 1, None, :])
    # calorine's constants of degrees above 4 have 12 digits
    loose = 100 if name == "l8" else 1
    for ours, theirs, tolerance in (
        (d.energies_n[:, None], U, 1e-13),
        (d.forces_nc, F, 1e-13),
        (found.reshape(-1, 9), W, 1e-13),
        (d.virial_cc.reshape(-1), -W.sum(0), 1e-12),
    ):
        np.testing.assert_allclose(ours / energy, theirs, rtol=0, atol=loose * tolerance * np.abs(theirs).max())
    assert abs(d.energy - d.energies_n.sum()) <= 1e-13 * np.abs(d.energies_n).sum()


@pytest.mark.parametrize("name", ["all", "zbl"])
def test_forces_are_the_gradient_of_the_energy(name, tmp_path):
    pot, frame = made(tmp_path, name)
    forces, h = pot.decompose(frame).forces_nc, 1e-3
    for k, c in ((0, 0), (7, 2)):
        U = []
        for step in (-2, -1, 1, 2):
            x = frame.positions.copy()
            x[k, c] += step * h
            U.append(pot.decompose(frame.replace(positions=x)).energy)
        slope = (U[0] - 8 * U[1] + 8 * U[2] - U[3]) / (12 * h)
        assert abs(slope + forces[k, c]) <= 1e-7 * np.abs(forces).max()


def test_bonds_are_edges(tmp_path):
    """Forces of bonds are what their sources say, not along them; sums on each star have no torque."""
    pot, frame = made(tmp_path, "all")
    assert not pot.central
    b = pot.decompose(frame, sources=True).bonds
    np.testing.assert_allclose(b.F_bc, b.D_bdc[:, 0] - b.D_bdc[:, 1], rtol=0, atol=0)
    across = np.cross(b.r_bc, b.F_bc)
    assert np.abs(across).max() > 0.01 * np.abs(b.F_bc).max()
    torque = np.zeros((len(frame), 3))
    np.add.at(torque, b.i, np.cross(-b.r_bc, b.D_bdc[:, 0]))
    np.add.at(torque, b.j, np.cross(b.r_bc, b.D_bdc[:, 1]))
    assert np.abs(torque).max() <= 1e-13 * np.abs(across).max() * 50


def test_types_by_name_or_map(tmp_path):
    pot, frame = made(tmp_path, "two")
    want = pot.decompose(frame).forces_nc
    named = nep(tmp_path / "nep.txt")
    swapped = frame.replace(types=3 - frame.types, type_names={1: "C", 2: "Si"})
    np.testing.assert_array_equal(named.decompose(swapped).forces_nc, want)
    with pytest.raises(AtcError, match="types 1, 2 are not named: say the element of each type"):
        named.decompose(frame)
    with pytest.raises(AtcError, match="types 2 are Ge"):
        named.decompose(frame.replace(type_names={1: "Si", 2: "Ge"}))
    with pytest.raises(AtcError, match="no element 'Ge'"):
        nep(tmp_path / "nep.txt", ["Si", "Ge"])
    some = nep(tmp_path / "nep.txt", ["Si", "NULL"]).decompose(frame).forces_nc
    assert (some[frame.types == 2] == 0).all() and np.abs(some).max() > 0


def line(number, text):
    def edit(lines):
        return [*lines[: number - 1], text, *lines[number:]]

    return edit


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (line(1, "nep4_dipole 2 Si C"), "line 1: 'nep4_dipole': only energies of atoms"),
        (line(1, "nep4_charge1 2 Si C"), "only energies of atoms from their neighbours give bonds, not charge1"),
        (line(1, "nep6 2 Si C"), "line 1: 'nep6': expected nep"),
        (line(1, "potential"), "is it the nep.txt of a model"),
        (line(1, "nep4 3 Si C"), "the number of types"),
        (line(2, "cutoff 4 6 300 200"), "line 2: expected 0 < angular cutoff <= radial cutoff"),
        (line(2, "cutoff 6 nan 300 200"), "line 2: expected numbers"),
        (line(3, "basis_size 6 5"), "line 3: expected a line n_max"),
        (line(5, "l_max 4"), "line 5: expected l_max <0 to 8> and 2 to 6 flags"),
        (line(5, "l_max 1 2 0"), "line 5: terms of four or five bodies need an l_max of 2"),
        (line(6, "ANN 5 5"), "line 6: a network of one hidden layer"),
        (line(9, "nan"), "not all parameters"),
        (lambda lines: lines[:-5], "the file is cut off"),
    ],
)
def test_files_that_are_refused(edit, said, tmp_path):
    path = tmp_path / "nep.txt"
    write(path, **CASES["two"])
    path.write_text("\n".join(edit(path.read_text().split("\n"))))
    with pytest.raises(AtcError) as e:
        nep(path)
    assert said in str(e.value) and "\n" not in str(e.value)


def test_missing_file(tmp_path):
    with pytest.raises(AtcError, match="cannot read the neuroevolution potential file .*No such file"):
        nep(tmp_path / "nep.txt")


def test_scenes(tmp_path, monkeypatch):
    """[potential] nep, with types or the names of the trajectory's own; the output says how it was made."""
    import atc
    from atc.config.scene import Scene

    monkeypatch.chdir(tmp_path)
    pot, frame = made(tmp_path, "two")
    rows = "".join(
        f"{('Si', 'C')[t - 1]} {x[0]:.17g} {x[1]:.17g} {x[2]:.17g}\n" for t, x in zip(frame.types, frame.positions)
    )
    lattice = " ".join(map(str, frame.cell.vectors.ravel()))
    head = f'{len(frame)}\nLattice="{lattice}" Properties=species:S:1:pos:R:3\n'
    (tmp_path / "run.xyz").write_text(head + rows)
    scene = {
        "trajectory": {"file": "run.xyz"},
        "potential": {"nep": "nep.txt"},
        "fields": {"quantities": ["virial_stress_potential"]},
    }
    ds = Scene.load(scene).run()
    want = pot.decompose(frame).virial_cc / METAL.factor("energy") / frame.cell.volume  # eV/Å³
    found = ds.virial_stress_potential.values[0]
    assert ds.virial_stress_potential.attrs["units"] == "eV/angstrom^3"
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-12 * np.abs(want).max())
    for wrong, said in (
        ({"lammps": "pair_style zero 3"}, "give lammps or nep, not both"),
        ({"units": "metal"}, "leave it out"),
        ({"types": ["Si", "Ge"]}, "no element 'Ge'"),
    ):
        with pytest.raises(AtcError) as e:
            Scene.load(scene | {"potential": scene["potential"] | wrong}).run()
        assert said in str(e.value) and "[potential]" in str(e.value), str(e.value)
    assert 'nep = "nep.txt"' in ds.attrs["scene"] and "edge gradient" in ds.attrs["decomposition"]
    assert atc.nep is nep


def test_fields(tmp_path):
    """Averages are those of the frames, per-atom virials add up to the box's, a pair term besides adds itself."""
    import atc

    pot, frame = made(tmp_path, "two")
    rng = np.random.default_rng(0)
    frames = [
        frame.replace(
            positions=frame.positions + 0.05 * rng.normal(size=frame.positions.shape),
            velocities=0.01 * rng.normal(size=frame.positions.shape),
            masses=np.full(len(frame), 28.0),
        )
        for _ in range(2)
    ]
    grid, kern = atc.Grid.regular(shape=(5, 5, 5)), atc.kernel("gaussian", width=1.6)
    names = ["stress_potential", "heat_flux_potential", "churning", "virial_stress_per_atom_potential"]

    def fields(traj, pot=pot, **more):
        return atc.fields(traj, pot, kern, grid, names, tolerance=1e-10, **more)

    each, mean = fields(frames), fields(frames, average=True)
    for name in ("stress_potential", "heat_flux_potential"):
        size = np.abs(each[name].values).max()
        np.testing.assert_allclose(mean[name].values, each[name].values.mean(0)[None], rtol=0, atol=1e-8 * size)
    S = each.stress_potential.values
    assert np.abs(S - np.swapaxes(S, -1, -2)).max() > 1e-3 * np.abs(S).max()
    assert (each.churning.values == 0).all() and (mean.churning.values == 0).all()
    box = pot.decompose(frames[0]).virial_cc
    atoms_ = METAL.to_internal("pressure_volume", each.virial_stress_per_atom_potential.values[0].sum(0))
    np.testing.assert_allclose(atoms_, box, rtol=0, atol=1e-12 * np.abs(box).max())

    pairs = atc.potential("pair_style lj/smooth/linear 5.0\npair_coeff * * 0.01 2.0", units="metal")
    both = fields(frames[:1], atc.potential([*pot.terms, *pairs.terms], "metal"))
    alone = fields(frames[:1], pairs)
    for name in names:
        want = each[name].values[:1] + alone[name].values
        np.testing.assert_allclose(both[name].values, want, rtol=0, atol=1e-8 * np.abs(want).max())


def test_energies_of_single_atoms(tmp_path):
    """What is subtracted changes energies, and nothing else; alone an atom of the model has what it says."""
    plain, frame = made(tmp_path, "two")
    path = tmp_path / "nep.txt"
    isolated, given = (nep(path, ("Si", "C"), reference=r) for r in ("isolated", {"C": -2.5}))
    a, b, c = (p.decompose(frame) for p in (plain, isolated, given))
    for other in (b, c):
        np.testing.assert_array_equal(other.forces_nc, a.forces_nc)
    box = Cell(50 * np.eye(3))
    alone = [plain.decompose(Frame(np.zeros((1, 3)), box, METAL, types=np.array([t]))).energy for t in (1, 2)]
    np.testing.assert_allclose(a.energies_n - b.energies_n, np.array(alone)[frame.types - 1], rtol=1e-12)
    want = np.where(frame.types == 2, METAL.to_internal("energy", -2.5), 0.0)
    np.testing.assert_allclose(a.energies_n - c.energies_n, want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert "less Si 0, C -2.5 eV" in given.attributes["energy_reference"]
    for wrong, said in (("alone", 'must be "isolated"'), ({"O": 1}, "no element 'O'"), ({"C": "x"}, "an energy for")):
        with pytest.raises(AtcError, match=said):
            nep(path, reference=wrong)


def test_stars_that_turn_are_refused(tmp_path, monkeypatch):
    """Gradients that are not those of an energy that only depends on the shape of a star."""
    from atc.decomposers.many_body.nep import NEP

    pot, frame = made(tmp_path, "two")
    honest = NEP.centres

    def bent(self, work, task, g_end, energies):
        U = honest(self, work, task, g_end, energies)
        g_end[:, :, 0] *= 1 + 1e-6
        return U

    pot.decompose(frame)
    monkeypatch.setattr(NEP, "centres", bent)
    with pytest.raises(AtcError, match="the energy of an atom changes when all is turned"):
        pot.decompose(frame)


def test_lammps_lines(tmp_path):
    """Both forms of the style that NEP_CPU adds to LAMMPS; other styles besides."""
    import atc

    pot, frame = made(tmp_path, "two")
    want = pot.decompose(frame)

    def lines(text, **more):
        return atc.potential(text.format(tmp_path), units="metal", **more)

    for text in (
        "pair_style nep\npair_coeff * * {}/nep.txt Si C",
        "pair_style nep {}/nep.txt\npair_coeff * *",
        "pair_style nep/cpu\npair_coeff * * {}/nep.txt Si C",
        "pair_style hybrid/overlay nep zero 5\npair_coeff * * nep {}/nep.txt Si C\npair_coeff * * zero",
    ):
        d = lines(text).decompose(frame)
        np.testing.assert_array_equal(d.forces_nc, want.forces_nc)
        np.testing.assert_array_equal(d.energies_n, want.energies_n)
    turned = lines("pair_style nep\npair_coeff * * {}/nep.txt C Si").decompose(frame.replace(types=3 - frame.types))
    np.testing.assert_array_equal(turned.forces_nc, want.forces_nc)
    for text, said in (
        ("pair_style nep\npair_coeff * * {}/other.txt Si C", "no such file"),
        ("pair_style nep\npair_coeff * * {}/nep.txt Si Ge", "no element 'Ge'"),
        ("pair_style nep {0}/nep.txt\npair_coeff * * {0}/nep.txt Si C", r"or the file behind pair_style nep"),
        ("units real\npair_style nep\npair_coeff * * {}/nep.txt Si C", "is for units metal, not real"),
    ):
        with pytest.raises(AtcError, match=said):
            atc.potential(text.format(tmp_path), units=None if text.startswith("units") else "metal")


def test_files_of_gpumd(tmp_path):
    """Its extended XYZ: velocities in Å/fs, masses of the elements."""
    import atc

    (tmp_path / "dump.xyz").write_text(
        '2\nTime=5 pbc="T T T" Lattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:vel:R:3:forces:R:3\n'
        "Si 0 0 0 0.01 0 0 0.5 0 0\nC 2 0 0 0 -0.02 0 -0.5 0 0\n"
    )
    frame = atc.read(tmp_path / "dump.xyz", units="gpumd")[0]
    metal, u = METAL, frame.units
    np.testing.assert_allclose(metal.to_user("velocity", frame.velocities)[:, :2], [[10, 0], [0, -20]], rtol=1e-6)
    np.testing.assert_allclose(u.to_user("force", frame.forces)[:, 0], [0.5, -0.5], rtol=1e-12)
    np.testing.assert_allclose(frame.masses, [28.085, 12.011], rtol=1e-3)
    assert u.to_user("time", frame.time) == pytest.approx(5.0, rel=1e-12)
    assert u.label("velocity") == "angstrom/fs" and frame.type_names == {1: "Si", 2: "C"}
