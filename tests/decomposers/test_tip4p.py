"""Four-point water: charges on virtual sites, against LAMMPS's tip4p styles, LAMMPS with the sites as atoms, and the
balance laws."""

from dataclasses import replace

import numpy as np
import pytest
from lammps_oracle import Config, lammps_session, run_lammps, voigt_to_tensor
from lammps_runs import water

import atc
from atc.decomposers.constraints.virtual_sites import FrameWithSites, Places, VirtualSites
from atc.decomposers.long_range.kspace import converged
from atc.errors import AtcError

LJ = "pair_coeff * * 0.0 1.0\npair_coeff 1 1 0.155 3.166\n"
BONDS = (
    "bond_style harmonic\nbond_coeff 1 450.0 0.9572\nangle_style harmonic\nangle_coeff 1 55.0 104.52\n"
    "special_bonds lj/coul 0.0 0.0 0.5\n"
)
SITE = "1 2 1 1 0.15"
LONG = f"pair_style lj/cut/tip4p/long {SITE} 4.5 4.2\n{LJ}{BONDS}kspace_style pppm/tip4p 1e-5\n"
OVERLAY = (
    f"pair_style hybrid/overlay lj/cut 4.5 tip4p/CUT {SITE} 4.2\npair_coeff * * lj/cut 0.0 1.0\n"
    "pair_coeff 1 1 lj/cut 0.155 3.166\npair_coeff * * tip4p/CUT\n"
)
GAUSS = atc.kernel("gaussian", width=2.0)


@pytest.fixture(scope="module")
def box():
    """27 molecules, a little off their equilibrium."""
    return water(n=3)


@pytest.fixture(scope="module")
def long():
    return atc.potential("units real\n" + LONG)


def compare(lines, config, rtol, extra="", shares=True):
    pot = converged(atc.potential("units real\n" + lines), 1e-12)
    frame, theirs = config.frame(), run_lammps(lines + extra, config)
    u, mine = frame.units, pot.stream(frame, energies=True, forces=True)
    forces = u.to_internal("force", theirs.forces_nc)
    np.testing.assert_allclose(mine.forces_nc, forces, rtol=0, atol=rtol * np.abs(forces).max())
    virial = u.to_internal("pressure_volume", theirs.virial)
    np.testing.assert_allclose(mine.virial_cc, virial, rtol=0, atol=3 * rtol * np.abs(virial).max())
    theirs_n = u.to_internal("energy", theirs.energies_n)
    assert mine.energy == pytest.approx(u.to_internal("energy", theirs.energy), abs=rtol * np.abs(theirs_n).sum())
    np.testing.assert_allclose(mine.energies_n.sum(), mine.energy, rtol=1e-12)
    if shares:
        np.testing.assert_allclose(mine.energies_n, theirs_n, rtol=0, atol=rtol * np.abs(theirs_n).max())
    return pot, mine, theirs


@pytest.mark.parametrize("name", ["lj/cut/tip4p/cut", "overlay"])
def test_cut_styles_against_lammps(name, box):
    """With a charge whose molecule reaches through the box's faces; the hydrogens have weights between themselves."""
    pair = f"pair_style {name} {SITE} 4.5 4.2\n{LJ}" if name != "overlay" else OVERLAY.replace("CUT", "cut")
    bonds = BONDS.replace("0.0 0.0 0.5", "0.2 0.4 0.5")
    pot, *_ = compare("dielectric 1.2\n" + pair + bonds, box, 1e-12)
    assert not pot.central and "OH1 + OH2" in pot.describe()


@pytest.mark.parametrize("name", ["lj/cut", "overlay", "lj/long"])
def test_long_styles_against_lammps(name, box):
    """LAMMPS has a mesh for them, no Ewald sum: it is as good as it can be made."""
    solver = "kspace_style pppm/tip4p 1e-8\nkspace_modify order 7\n"
    pair = {
        "lj/cut": f"pair_style lj/cut/tip4p/long {SITE} 4.5 4.2\n{LJ}",
        "overlay": OVERLAY.replace("CUT", "long"),
        "lj/long": f"pair_style lj/long/tip4p/long cut long {SITE} 4.5 4.2\n{LJ}",
    }[name]
    if name == "lj/long":
        pair = pair.replace("cut long", "long long").replace("* * 0.0", "2 2 0.0")
        solver = (
            "kspace_style pppm/disp/tip4p 1e-5\nkspace_modify gewald 0.8 mesh 48 48 48 order 7\n"
            "kspace_modify gewald/disp 0.9 mesh/disp 48 48 48 order/disp 7\n"
        )
    # Its energies of atoms have the mesh's share of a site with the oxygen; its mesh for dispersion is a rougher one.
    compare(pair + BONDS + solver, box, 1e-4 if name == "lj/long" else 1e-5, "pair_modify table 0\n", shares=False)


def four_points(box):
    """The same molecules with their fourth points as atoms of type 3, bonded to the oxygens."""
    a = 0.15 / (0.9572 * np.cos(np.radians(0.5 * 104.52)))
    x = box.positions.reshape(-1, 3, 3)
    site = x[:, 0] + 0.5 * a * (x[:, 1] + x[:, 2] - 2 * x[:, 0])
    m = 4 * np.arange(len(x))
    bonds = np.concatenate([np.stack([m, m + k], 1) for k in (1, 2, 3)])
    return Config(
        box.cell, np.concatenate([x, site[:, None]], 1).reshape(-1, 3), np.tile([1, 2, 2, 3], len(x)), "real",
        {1: 15.9994, 2: 1.008, 3: 1.0}, np.tile([0.0, 0.41, 0.41, -0.82], len(x)), bonds=bonds,
        bond_types=np.repeat([1, 1, 2], len(x)), angles=np.stack([m + 1, m, m + 2], 1), atom_style="full",
    ), a  # fmt: skip


def test_against_lammps_with_the_sites_as_atoms(box, long):
    """Ewald's sum over four points, to LAMMPS's erfc; the forces on the fourth handed on here by hand."""
    config, a = four_points(box)
    pair = "pair_style lj/cut/coul/long 4.5 4.2\n" + LJ.replace("1 1 0.155", "3 3 0.0 1.0\npair_coeff 1 1 0.155")
    bonds = BONDS.replace("450.0 0.9572", "450.0 0.9572\nbond_coeff 2 0.0 0.15")
    theirs = run_lammps(pair + bonds + "kspace_style ewald 1e-12\npair_modify table 0\n", config)
    f = theirs.forces_nc.reshape(-1, 4, 3)
    forces = f[:, :3] + np.array([1 - a, 0.5 * a, 0.5 * a])[:, None] * f[:, 3:]
    frame = box.frame()
    mine = converged(long, 1e-12).stream(frame, forces=True)
    u = frame.units
    # 1.5e-7 of the bare force of a site and a hydrogen of its molecule, which are left out.
    atol = 2 * 1.5e-7 * 332.0 * 0.82 * 0.41 / 0.8**2
    np.testing.assert_allclose(u.to_user("force", mine.forces_nc), forces.reshape(-1, 3), rtol=0, atol=atol)
    virial = u.to_internal("pressure_volume", theirs.virial)
    # All of the virial is that of charges at their places: levers have none. The same of the bare energies within the
    # molecules, if all of it adds up.
    atol = u.to_internal("energy", 1.5e-7 * 27 * 332.0 * 0.41 * (2 * 0.82 / 0.8 + 0.41 / 1.5))
    np.testing.assert_allclose(mine.virial_cc, virial, rtol=0, atol=atol)
    np.testing.assert_allclose(mine.forces_nc.sum(0), 0.0, atol=1e-11 * np.abs(mine.forces_nc).max())


def test_levers_hand_on_all_of_the_force_and_no_virial(box, long):
    frame = long.carriers(box.frame())
    assert isinstance(frame, FrameWithSites) and len(frame) == 4 * 27 and frame.charges[:81][::3].max() == 0.0
    F = np.random.default_rng(0).normal(size=(27, 3))
    levers = frame.levers(F, sources=True)
    assert np.abs(levers.virial()).max() < 1e-13
    v = np.random.default_rng(1).normal(size=(len(frame), 3))
    moving = frame.folded(np.zeros(len(frame)))  # sites move with their parents
    assert not moving.any()
    v[81:] = np.einsum("sk,skc->sc", frame.places.weights_sk, v[:81].reshape(27, 3, 3))
    power = -np.einsum("bc,bc->b", levers.D_bdc[:, 1], v[levers.i])
    np.testing.assert_allclose(power.reshape(27, 3).sum(1), np.einsum("sc,sc->s", F, v[81:]), atol=1e-13)


@pytest.mark.parametrize("kind", ["cut", "long"])
def test_balance_laws_hold_to_rounding(kind, box, long):
    from atc.analysis.check import check

    cut = f"units real\npair_style lj/cut/tip4p/cut {SITE} 4.5 4.2\n{LJ}{BONDS}"
    report = check(box.frame(), long if kind == "long" else atc.potential(cut), GAUSS, points=2)
    assert report.ok, report.verdict
    for law in ("momentum", "energy"):
        ways = report.data["laws"][law]
        assert ways["chain_rule"]["residual"] < 1e-13 and ways["fields"]["residual"] < 1e-9, (law, ways)


def test_fields_mean_what_the_box_has(box, long):
    names = ["stress_potential", "virial_stress", "energy", "number_density", "energy_flux", "heat_current"]
    frame = box.frame()
    ds = atc.fields(frame, long, GAUSS, atc.Grid.regular(shape=(12, 12, 12)), names, tolerance=1e-4)
    u, mean = frame.units, ds.stress_potential.values[0].mean((0, 1, 2))
    virial = ds.virial_stress_potential.values[0]
    np.testing.assert_allclose(mean, virial, atol=1e-4 * np.abs(ds.stress_potential.values).max())
    # Sites are no atoms.
    assert ds.number_density.values.mean() * frame.cell.volume == pytest.approx(81, rel=1e-4)
    total = long.stream(frame).energy
    volume = u.to_user("volume", frame.cell.volume)
    np.testing.assert_allclose(
        ds.energy_potential.values.mean() * volume * u.to_internal("energy_density", 1.0) * u.factor("volume"),
        total,
        rtol=1e-3,
    )
    flux = ds.energy_flux.values[0].mean((0, 1, 2))
    assert np.isfinite(flux).all() and np.isfinite(ds.heat_current.values).all()


def test_shaken_water_by_its_script(tmp_path, box):
    """Types, distance, bonds and angles of the script; what holds the molecules; LAMMPS's pressure."""
    box.write_data(tmp_path / "w.data")
    head = f"units real\natom_style full\npair_style lj/cut/tip4p/long {SITE} 4.9 4.9\n"
    model = BONDS.replace("bond_style harmonic\nbond_coeff", "bond_style zero\nread_data w.data\nbond_coeff").replace(
        "1 450.0 0.9572", "1 0.9572"
    )
    solver = f"{LJ}kspace_style pppm/tip4p 1e-7\nkspace_modify order 7\npair_modify table 0\n"
    text = (
        head + model + solver + "timestep 0.5\nfix n all nve\nfix h all shake 1e-12 200 0 b 1 a 1\n"
        "dump d all custom 10 run.dump id mol type q x y z vx vy vz fx fy fz\n"
        "dump_modify d sort id format float %.17g units yes time yes\nrun 10\n"
    )
    (tmp_path / "in.run").write_text(text)
    lines = text.replace("w.data", str(tmp_path / "w.data")).replace("run.dump", str(tmp_path / "run.dump"))
    with lammps_session() as lmp:
        for line in lines.splitlines()[:-1]:
            lmp.command(line)
        lmp.command("thermo_style custom step press pxx pyy pzz pxy pxz pyz")
        lmp.command("compute pv all pressure NULL virial")
        lmp.command("thermo_style custom step press c_pv[*]")
        lmp.command("run 10")
        p6 = np.array(lmp.numpy.extract_compute("pv", 0, 1))
    pot, traj = atc.potential(tmp_path / "in.run"), atc.read(tmp_path / "run.dump", units="real")
    ds = atc.fields(traj[-1], pot, None, None, ["virial_stress_potential"])
    found = ds.virial_stress_potential.values[0]
    # atm: 1.5e-7, LAMMPS's erfc, of 14,000 that hold the molecules and of the bare Coulomb energies within them (9 times
    # as many), if all of it adds up.
    np.testing.assert_allclose(found, -voigt_to_tensor(p6), rtol=0, atol=1e-6 * 14000.0 * 9)
    assert ds.attrs["constraint_source"] == "forces" and ds.attrs["constraint_error"] < 1e-5
    assert "virtual sites" in ds.attrs["decomposition"]
    from atc.agreement.forces import compare_forces
    from atc.analysis.check import check

    assert compare_forces(traj[-1], pot).agrees
    report = check(traj, pot, GAUSS, points=1)
    assert report.ok, report.verdict
    for law in ("momentum", "energy"):
        assert report.data["laws"][law]["fields"]["residual"] < 1e-9, report.data["laws"]


def test_what_is_refused_is_named(box, long):
    def model(lines):
        return atc.potential("units real\n" + lines)

    for lines, message in (
        (LONG.replace("pppm/tip4p", "pppm"), "line 10: kspace_style pppm with pair_style coul/long: .* pppm/tip4p"),
        (LONG.replace(f"{SITE} 4.5 4.2", SITE), "takes otype htype btype atype qdist and one or two cutoffs"),
        (LONG.replace(SITE, "1 2 5 1 0.15"), "no bond_coeff of bond type 5"),
        (LONG.replace("angle_style harmonic", "angle_style fourier").replace("55.0 104.52", "55 1 1 1"), "at rest"),
        (LONG.replace(SITE, "1 2 1 1 -0.1"), "qdist must not be negative"),
    ):
        with pytest.raises(AtcError, match=message):
            model(lines)
    frame = box.frame()
    with pytest.raises(AtcError, match="atom 1 is the oxygen .* atoms 2 and 3 are not its hydrogens"):
        long.stream(frame.replace(types=np.ones(81, int)))
    grid = atc.Grid.points([[1.0, 1, 1]])
    cut = model(f"pair_style lj/cut/tip4p/cut {SITE} 4.5 4.2\n{LJ}{BONDS}")
    for more, message in (
        ({"quantities": ["virial_stress_per_atom"]}, "not known of single atoms"),
        ({"quantities": ["stress"], "tiles": (1, 1, 2)}, "tiles: not with virtual sites"),
        ({"quantities": ["stress"], "pot": cut, "grid": atc.Grid.planes("z", n=3)}, "not counted on planes"),
        ({"quantities": ["piola_stress"], "reference": frame}, "a field has no bonds|reference frame does not have"),
    ):
        asked = {"pot": long, "kern": GAUSS, "grid": grid} | more
        with pytest.raises(AtcError, match=message):
            atc.fields(frame, **asked)


def test_charges_and_dipoles_are_those_of_the_sites(box, long):
    """Profiles of charge and polarisation against those of a frame with the sites as atoms."""
    from atc.analysis.species_profile import SpeciesSums

    config, _ = four_points(box)
    config.masses[3] = 1e-9
    grid, found = atc.Grid.slab("z", 12), []
    molecules = np.repeat(np.arange(27) + 1, 4)
    for frame, pot in ((box.frame(), long), (config.frame().replace(molecules=molecules), None)):
        sums = SpeciesSums(pot, atc.kernel("gaussian", width=1.5), grid)
        sums.add(0, frame.replace(charges=np.where(frame.types == 3, -0.82, frame.charges)))
        _, charge, _, polar = sums.arrays()
        found.append((charge, polar))
    (charge, polar), (want_charge, want_polar) = found
    np.testing.assert_allclose(charge, want_charge, rtol=0, atol=1e-9 * np.abs(want_charge).max())
    np.testing.assert_allclose(polar, want_polar, rtol=0, atol=1e-7 * np.abs(want_polar).max())


class _Inside:
    """Sites that the trajectory has: every fourth atom."""

    def __init__(self, w):
        self.w = w

    def describe(self):
        return "every fourth atom"

    def places(self, frame):
        m = 4 * np.arange(len(frame) // 4)
        return Places(m[:, None] + [0, 1, 2], np.tile(self.w, (len(m), 1)), m, inside_s=m + 3)


def test_sites_that_the_frame_has(box, long):
    """As other programs write them: massless atoms among the others."""
    config, a = four_points(box)
    lines = "pair_style lj/cut/coul/long 4.5 4.2\n" + LJ + BONDS + "bond_coeff 2 0.0 0.15\nkspace_style ewald 1e-5\n"
    pot = atc.potential("units real\n" + lines.replace("pair_coeff 1 1", "pair_coeff 3 3 0 1\npair_coeff 1 1"))
    pot.sites = VirtualSites(_Inside([1 - a, 0.5 * a, 0.5 * a]))
    frame = config.frame()
    frame = frame.replace(masses=np.where(frame.types == 3, 0.0, frame.masses))
    d, want = pot.stream(frame, forces=True), long.stream(box.frame(), forces=True)
    forces = d.forces_nc.reshape(-1, 4, 3)
    size = np.abs(want.forces_nc).max()
    assert np.abs(forces[:, 3]).max() < 1e-12 * size
    np.testing.assert_allclose(forces[:, :3].reshape(-1, 3), want.forces_nc, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(d.virial_cc, want.virial_cc, rtol=0, atol=1e-6 * np.abs(want.virial_cc).max())
    # The same by derivatives instead of weights.
    rule = pot.sites.rule
    places = rule.places(frame)
    jacobians = places.weights_sk[:, :, None, None] * np.eye(3)
    rule.places = lambda frame: replace(places, jacobians_skcc=jacobians)
    again = pot.stream(frame, forces=True)
    np.testing.assert_allclose(again.forces_nc, d.forces_nc, rtol=0, atol=1e-14 * size)
