"""Two-dimensional runs: kernels normalised in the plane, exact sums against slow twins, LAMMPS with ``dimension 2``,
balance laws, and what is refused."""

import itertools
import warnings

import numpy as np
import pytest
from lammps_oracle import lammps_session
from scipy.integrate import quad

import atc
from atc.deposit import make
from atc.deposit.gradient import gather
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame
from atc.planar import planar
from atc.units import units

TABLE = [(0.0, 1.0), (0.7, 0.9), (1.5, 0.2), (2.0, 0.0)]
KERNELS = {
    name: atc.kernel(name, 2.0, dimension=2)
    for name in ("step", "linear", "cubic", "quartic", "lucy", "hardy", "gaussian", "bspline")
}
KERNELS |= {
    "table": atc.kernel("piecewise-linear", table=TABLE, dimension=2),
    "table ending in a jump": atc.kernel("piecewise-linear", table=[*TABLE[:-1], (2.0, 0.1)], dimension=2),
    "box": atc.kernel("box", size=[3.0, 2.0], dimension=2),
}
LJ = units("lj").planar


def knots(kern):
    """Distances from a point at which φ or a derivative jumps, along one axis."""
    if kern.name == "box":
        return list(kern.size / 2)
    if kern.name == "bspline":
        return [1.0, 2.0]
    return list(getattr(kern, "radii", [kern.support]))


def integral(f, cuts):
    return sum(quad(f, a, b, epsabs=1e-13, epsrel=1e-12, limit=400)[0] for a, b in itertools.pairwise(cuts) if b > a)


# ---- kernels


@pytest.mark.parametrize("name", KERNELS)
def test_normalised_in_the_plane(name):
    kern = KERNELS[name]
    if kern.is_isotropic:
        total = 2 * np.pi * integral(lambda r: float(kern.phi(np.array([r, 0, 0]))) * r, [0, *sorted(knots(kern))])
    else:
        # Panel by panel between the knots, where φ is a polynomial.
        x, w = np.polynomial.legendre.leggauss(4)
        cuts = [np.array([-e, e]) for e in kern.size / 2] if name == "box" else [np.arange(-2.0, 3.0)] * 2
        at, weight = (
            [np.concatenate([f(a, b) for a, b in itertools.pairwise(c)]) for c in cuts]
            for f in (lambda a, b: a + 0.5 * (1 + x) * (b - a), lambda a, b: 0.5 * (b - a) * w)
        )
        xy = np.stack(np.meshgrid(*at, indexing="ij"), -1)
        total = float(weight[0] @ kern.phi(np.concatenate([xy, 0 * xy[..., :1]], -1)) @ weight[1])
    assert total == pytest.approx(1.0, rel=1e-12)
    assert kern.dimension == 2 and kern.scaled(2.0).dimension == 2
    assert float(kern.scaled(2.0).phi(np.zeros(3))) == pytest.approx(float(kern.phi(np.zeros(3))) / 4, rel=1e-14)


@pytest.mark.parametrize("name", KERNELS)
def test_bond_function_is_the_mean_along_the_bond(name):
    """By numerical quadrature between the places where the bond crosses a kink of φ."""
    kern = KERNELS[name]
    rng = np.random.default_rng(3)
    for _ in range(12):
        d, r = rng.uniform(-2.5, 2.5, 3) * [1, 1, 0], rng.uniform(-3, 3, 3) * [1, 1, 0]
        cuts = [0.0, 1.0]
        for k in knots(kern):
            if kern.is_isotropic:
                a, b, c = r @ r, -2 * d @ r, d @ d - k * k
                cuts += list(np.real(roots)) if np.isreal(roots := np.roots([a, b, c])).all() else []
            else:
                cuts += [(d[c] + s * k) / r[c] for c in range(2) for s in (-1, 0, 1)]
        if name in ("linear", "hardy", "table", "table ending in a jump"):
            cuts.append(d @ r / (r @ r))
        cuts = sorted(np.clip(cuts, 0, 1))
        assert float(kern.beta(d, r)) == pytest.approx(
            integral(lambda t, d=d, r=r: float(kern.phi(d - t * r)), cuts), abs=1e-11 * kern.peak
        )


@pytest.mark.parametrize("name", KERNELS)
def test_profile_is_the_integral_along_lines(name):
    kern = KERNELS[name]
    m = kern.marginal((1.0, 0.0, 0.0))
    for z in (0.0, 0.3, 0.77, 1.2, 1.9, 2.3):
        rims = [np.sqrt(k * k - z * z) for k in knots(kern) if k > z] if kern.is_isotropic else knots(kern)
        across = (
            2 * integral(lambda y, z=z: float(kern.phi(np.array([z, y, 0.0]))), [0.0, *sorted(rims)]) if rims else 0.0
        )
        assert float(m.phi(z)) == pytest.approx(across, abs=1e-8)
    assert float(m.cumulative(m.support)) == pytest.approx(1.0, rel=1e-13)
    z, h = np.linspace(-1.7, 1.7, 9) + 0.013, 1e-5
    assert np.abs(m.slope(z) - (m.phi(z + h) - m.phi(z - h)) / (2 * h)).max() < 1e-8
    for d, r in (
        (0.3, 0.9),
        (0.3, -2.0),
        (1.95, 0.3),
        (2.5, 5.0),
        (1e-4, 4e-4),
        (1.9999, 3e-4),
        (0.5, 1e-9),
        (0.0, 1e-3),
        (0.7, 2.1e-3),
        (0.4, 0.0),
    ):
        kinks = [*knots(kern), 0.0, *(-k for k in knots(kern))]
        cuts = sorted({0.0, 1.0, *np.clip([(d - k) / r for k in kinks], 0, 1)}) if r else [0.0, 1.0]
        mean = integral(lambda t, d=d, r=r: float(m.phi(d - t * r)), cuts)
        assert float(m.beta(d, r)) == pytest.approx(mean, abs=2e-12 * float(m.phi(0.0)))


@pytest.mark.parametrize(
    "name", ["step", "linear", "cubic", "quartic", "lucy", "hardy", "gaussian", "table", "bspline"]
)
def test_transform(name):
    """φ̂ along x is the transform of the profile."""
    kern = KERNELS[name]
    m = kern.marginal((1.0, 0.0, 0.0))
    for k in (0.0, 0.4, 2.9, 3.1, 7.0, 31.0):
        x, w = np.polynomial.legendre.leggauss(300)
        edges = [0.0, *sorted(knots(kern))]
        total = 0.0
        for a, b in itertools.pairwise(edges):
            # In the angle whose sine is z/b: no root at the rim.
            lo, hi = np.arcsin(a / b), np.pi / 2
            t = lo + 0.5 * (1 + x) * (hi - lo)
            z = b * np.sin(t)
            total += w @ (m.phi(z) * np.cos(k * z) * b * np.cos(t)) * (hi - lo)
        assert float(kern.hat(np.array([k, 0.0, 0.0]))) == pytest.approx(
            total, abs=2e-7 if name in ("linear", "hardy", "table") else 1e-11
        )


# ---- sums against slow twins


def sample(seed=0, n=40):
    rng = np.random.default_rng(seed)
    cell = Cell([[7.0, 0, 0], [1.3, 6.0, 0], [0, 0, 1]], [0.3, -0.2, -0.5], (True, True, False))
    x = cell.cartesian(np.c_[rng.uniform(-0.5, 1.5, (n, 2)), np.full(n, 0.5)])
    r = np.c_[rng.normal(size=(n, 2)), np.zeros(n)]
    r[:3] *= 1e-9
    return cell, x, r, rng.normal(size=(n, 2)), rng.normal(size=(n, 6))


def images(cell, reach):
    a, b = (int(np.ceil(reach / h)) + 2 for h in cell.heights[:2])
    return [i * cell.vectors[0] + j * cell.vectors[1] for i in range(-a, a + 1) for j in range(-b, b + 1)]


@pytest.mark.parametrize("where", ["regular", "points", "line"])
@pytest.mark.parametrize("name", KERNELS)
def test_direct_sums(name, where):
    kern = KERNELS[name]
    cell, x, r, a, b = sample()
    grid = {
        "regular": atc.Grid.regular(shape=(5, 4)),
        "points": atc.Grid.points(np.random.default_rng(1).uniform(0, 6, (9, 2))),
        "line": atc.Grid.line([0.1, 0.2], [5.0, 4.0], 7),
    }[where].bind(LJ, cell)
    dep = make("direct", grid, kern, cell, 2, 6)
    dep.add_sites(x, a)
    dep.add_bonds(x, r, b)
    points = grid.points_gc
    assert np.abs(points[:, 2]).max() == 0.0
    d = x[None] - points[:, None]
    sites = sum(kern.phi(d + s) @ a for s in images(cell, 8.0))
    bonds = sum(kern.beta(d + s, r[None]) @ b for s in images(cell, 8.0))
    assert np.abs(dep.site_sums() - sites).max() < 1e-13 * np.abs(sites).max()
    assert np.abs(dep.bond_sums() - bonds).max() < 1e-12 * np.abs(bonds).max()
    if name not in ("step", "box", "table ending in a jump"):
        values, slopes = gather(grid, kern, cell, x, a)
        want = -sum(np.einsum("gnc,nk->gkc", kern.grad_phi(d + s), a) for s in images(cell, 8.0))
        assert np.abs(values - sites).max() < 1e-13 * np.abs(sites).max()
        assert np.abs(slopes - want).max() < 1e-12 * np.abs(want).max()


@pytest.mark.parametrize("axis", "xy")
@pytest.mark.parametrize("name", [n for n in KERNELS if n not in ("box", "bspline")])
def test_slab_profiles(name, axis):
    """Averages along lines: a fine sum of the exact fields across, and images of the profile."""
    kern = KERNELS[name]
    cell, x, r, a, b = sample(2)
    k = "xy".index(axis)
    dep = make("direct", atc.Grid.slab(axis, 6).bind(LJ, cell), kern, cell, 2, 6)
    dep.add_sites(x, a)
    dep.add_bonds(x, r, b)
    height = cell.heights[k]
    normal = cell.inverse[:, k] * height
    m = kern.marginal(normal)
    for g in range(6):
        z = (x - cell.origin) @ normal - (g + 0.5) * height / 6
        sites = sum(m.phi(z + i * height) @ a for i in range(-5, 6)) / (cell.volume / height)
        bonds = sum(m.beta(z + i * height, r @ normal) @ b for i in range(-5, 6)) / (cell.volume / height)
        assert np.abs(dep.site_sums()[g] - sites).max() < 1e-13 * np.abs(dep.site_sums()).max()
        assert np.abs(dep.bond_sums()[g] - bonds).max() < 1e-11 * np.abs(dep.bond_sums()).max()


# ---- LAMMPS

SCRIPT = """units {units}
dimension 2
atom_style atomic
lattice hex {density}
region box prism 0 10 0 6 -0.1 0.1 {tilt} 0 0
create_box 2 box
create_atoms 1 box
set group all type/fraction 2 0.4 1234
mass 1 {m1}
mass 2 {m2}
velocity all create {T} 87287 loop geom
pair_style {style}
pair_coeff 1 1 {c11}
pair_coeff 2 2 {c22}
pair_coeff 1 2 {c12}
fix 1 all nve
fix 2 all enforce2d
timestep 0.004
compute s all stress/atom NULL
dump d all custom 20 run.dump id type x y z vx vy vz fx fy fz c_s[1] c_s[2] c_s[3] c_s[4] c_s[5] c_s[6]
dump_modify d sort id format float %.17g
run 120
write_data run.data
"""
RUNS = {
    "lj": {
        "units": "lj",
        "density": 0.75,
        "tilt": 0,
        "m1": 1.0,
        "m2": 1.7,
        "T": 1.2,
        "style": "lj/cut 2.5",
        "c11": "1.0 1.0",
        "c22": "0.8 1.1",
        "c12": "0.9 1.05",
    },
    "metal": {
        "units": "metal",
        "density": 3.9,
        "tilt": 2,
        "m1": 39.9,
        "m2": 83.8,
        "T": 90,
        "style": "lj/cut 9.0",
        "c11": "0.0104 3.4",
        "c22": "0.0140 3.65",
        "c12": "0.012 3.5",
    },
}


class Run:
    def __init__(self, folder, values):
        self.folder, self.units = folder, values["units"]
        self.script = folder / "in.run"
        self.script.write_text(SCRIPT.format(**values))
        text = (
            self.script.read_text()
            .replace("run.dump", str(folder / "run.dump"))
            .replace("run.data", str(folder / "run.data"))
        )
        with lammps_session() as lmp:
            lmp.commands_string(text)
            self.thermo = {
                k: lmp.get_thermo(k) for k in ("pe", "temp", "pxx", "pyy", "pzz", "pxy", "press", "density", "vol")
            }
            self.energy = self.thermo["pe"] * (lmp.get_natoms() if self.units == "lj" else 1)
        self.pot = atc.potential(self.script)
        self.traj = atc.read(folder / "run.dump", units=self.units, topology=folder / "run.data")
        self.radius = 2.5 if self.units == "lj" else 9.0


@pytest.fixture(scope="module", params=RUNS)
def run(request, tmp_path_factory):
    return Run(tmp_path_factory.mktemp(request.param), RUNS[request.param])


@pytest.fixture(scope="module")
def melt(tmp_path_factory):
    return Run(tmp_path_factory.mktemp("melt"), RUNS["lj"])


def test_against_lammps(run):
    frame, t = run.traj[-1], run.thermo
    d = run.pot.decompose(frame)
    assert frame.units.to_user("energy", d.energy) == pytest.approx(run.energy, rel=1e-13)
    assert np.abs(d.forces_nc - frame.forces).max() < 1e-12 * np.abs(frame.forces).max()
    quantities = ["stress", "density", "number_density", "virial_stress", "virial_stress_per_atom", "temperature"]
    ds = atc.fields(
        run.traj[-1:],
        run.pot,
        atc.kernel("gaussian", run.radius),
        atc.Grid.regular(shape=(60, 60)),
        quantities,
        tolerance=1e-12,
    )
    virial = ds.virial_stress.values[0]
    pressure = np.array([[t["pxx"], t["pxy"], 0], [t["pxy"], t["pyy"], 0], [0, 0, t["pzz"]]])
    assert np.abs(virial + pressure).max() < 1e-11 * np.abs(pressure).max()
    assert -np.trace(virial) / 2 == pytest.approx(t["press"], rel=1e-11)
    atom = np.stack([frame.extra[f"c_s[{k}]"] for k in range(1, 7)], 1)
    mine = ds.virial_stress_per_atom.values[0]
    mine = np.stack([mine[:, 0, 0], mine[:, 1, 1], mine[:, 2, 2], mine[:, 0, 1], mine[:, 0, 2], mine[:, 1, 2]], 1)
    assert np.abs(mine - atom).max() < 1e-11 * np.abs(atom).max()
    # ∫ over the area: the grid resolves the Gaussian to the last digit.
    assert float(ds.density.mean()) == pytest.approx(t["density"], rel=1e-11)
    assert float(ds.number_density.mean()) * t["vol"] == pytest.approx(len(frame), rel=1e-11)
    potential = ds.virial_stress_potential.values[0]
    assert np.abs(ds.stress_potential.values[0].mean((0, 1, 2)) - potential).max() < 1e-11 * np.abs(potential).max()
    assert dict(ds.sizes)["z"] == 1 and ds.attrs["dimension"] == 2 and ds.attrs["periodic"] == "pp"
    labels = {"lj": ("epsilon/sigma^2", "m/sigma^2"), "metal": ("bar*angstrom", "g/cm^3*angstrom")}[run.units]
    assert (ds.stress.attrs["units"], ds.density.attrs["units"]) == labels
    assert "two degrees of freedom" in ds.temperature.attrs["comment"]
    info = atc.read(run.folder / "run.dump", units=run.units, dimension=2).info()
    assert info["cell"]["volume"] == pytest.approx(t["vol"], rel=1e-12)


def test_temperature_has_two_degrees_of_freedom(run):
    """Of a kernel wider than the box the temperature is that of the whole: LAMMPS's, which takes two off all of
    them, as being unbiased does; as it is, it has them."""
    frame = run.traj[-1]
    wide = atc.kernel("gaussian", width=6 * float(frame.cell.heights[:2].max()))
    n = len(frame)
    for velocity, share in (("frame", 1.0), ("local", (n - 1) / n)):
        what = (frame, run.pot, wide, atc.Grid.points([[1.0, 2.0]]), ["temperature"])
        ds = atc.fields(*what, tolerance=1e-12, velocity=velocity)
        assert float(ds.temperature.values.item()) == pytest.approx(run.thermo["temp"] * share, rel=1e-6)


def test_slab_averages_the_layer(melt):
    kern = atc.kernel("quartic", 2.0)
    what = (melt.traj[-1:], melt.pot, kern)
    slab = atc.fields(*what, atc.Grid.slab("x", 10), ["stress_potential", "density", "heat_flux"], tolerance=1e-12)
    # Bin centres are grid points; the sum across converges as the kernel is resolved.
    layer = atc.fields(*what, atc.Grid.regular(shape=(10, 200)), ["stress_potential", "density"], tolerance=1e-12)
    for q in ("stress_potential", "density"):
        assert np.abs(slab[q].values[0] - layer[q].values[0].mean((1, 2))).max() < 1e-6 * np.abs(slab[q].values).max()
    with pytest.raises(AtcError, match="slab profile along axis z"):
        atc.fields(*what, atc.Grid.slab("z", 10), ["density"])


@pytest.mark.parametrize("name", ["gaussian", "lucy", "bspline"])
def test_spectral_keeps_its_tolerance(melt, name):
    kern, frame = atc.kernel(name, 3.0), melt.traj[-1:]
    for grid in (
        atc.Grid.regular(spacing=0.6),
        atc.Grid.points(np.random.default_rng(0).uniform(0, 9, (50, 2))),
        atc.Grid.plane(axis="z", shape=(9, 8)),
    ):
        q = ["stress_potential", "density"]
        exact = atc.fields(frame, melt.pot, kern, grid, q, tolerance=1e-12)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AtcWarning)  # that it was computed again more closely
            fast = atc.fields(frame, melt.pot, kern, grid, q, tolerance=1e-4, method="spectral")
        assert "spectral" in fast.attrs["method"]
        for n in q:
            assert np.abs(fast[n].values - exact[n].values).max() < 1e-4 * np.abs(exact[n].values).max()


def test_collapsed_bonds_are_the_same_bonds(melt):
    """Moments carried by atoms, against the exact sum."""
    frame = planar(melt.traj[-1])
    kern = atc.kernel("gaussian", 4.0, dimension=2)
    bonds = melt.pot.decompose(frame).bonds
    grid = atc.Grid.regular(shape=(8, 8)).bind(frame.units, frame.cell)
    exact = make("direct", grid, kern, frame.cell, 0, 6)
    exact.add_bond_stress(frame.positions, bonds.i, bonds.r_bc, bonds.G_b)
    for order in (2, 4):
        dep = make("spectral", grid, kern, frame.cell, 0, 6, tolerance=1e-6, order=order)
        dep.add_bond_stress(frame.positions, bonds.i, bonds.r_bc, bonds.G_b, j_b=bonds.j)
        assert np.abs(dep.bond_sums() - exact.bond_sums()).max() < 1e-6 * np.abs(exact.bond_sums()).max()


def test_balance_laws(melt, tmp_path):
    """In closed form to rounding; and of Stillinger-Weber triplets, which churn."""
    from atc.analysis.check import check

    report = check(melt.traj, melt.pot, atc.kernel("lucy", 2.5), atc.Grid.regular(spacing=1.0), points=8)
    assert report.ok
    # (name of the file's entry, coefficients as LAMMPS's sw files have them)
    entry = " ".join(["X", "X", "X", *map(str, (1.0, 1.0, 1.8, 21.0, 1.2, -0.5, 7.05, 0.602, 4.0, 0.0, 0.0))])
    (tmp_path / "x.sw").write_text(entry + "\n")
    sw = atc.potential("dimension 2\npair_style sw\npair_coeff * * x.sw X X", units="lj", folder=tmp_path)
    found = check(melt.traj, sw, atc.kernel("quartic", 2.5), points=8)
    assert found.ok
    laws = found.data["laws"]
    assert {"mass", "momentum", "energy", "churning"} <= set(laws)
    for law in laws.values():
        assert law["chain_rule"]["residual"] < 1e-11 and law["fields"]["holds"]
    # Without the churning heat flux the energy of triplets does not balance.
    assert laws["energy"]["chain_rule"]["without_churning"] > 1e-4


def test_rotated_in_the_plane(melt):
    """Cell, atoms and points turned together: scalars stay, vectors and tensors turn."""
    a = 0.7
    R = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    frame = planar(melt.traj[-1])
    cell = Cell(frame.cell.vectors @ R, frame.cell.origin @ R, frame.cell.periodic)
    turned = frame.replace(positions=frame.positions @ R, velocities=frame.velocities @ R, cell=cell)
    kern = atc.kernel("quartic", 2.0)
    q = ["density", "stress", "heat_flux", "temperature", "virial_stress"]
    one, two = (
        atc.fields(f, melt.pot, kern, atc.Grid.regular(shape=(6, 5)), q, tolerance=1e-12) for f in (frame, turned)
    )
    for n in ("density", "temperature"):
        assert np.abs(one[n].values - two[n].values).max() < 1e-11 * np.abs(one[n].values).max()
    assert np.abs(one.heat_flux.values @ R - two.heat_flux.values).max() < 1e-11 * np.abs(one.heat_flux.values).max()
    for n in ("stress", "virial_stress"):
        assert np.abs(R.T @ one[n].values @ R - two[n].values).max() < 1e-11 * np.abs(one[n].values).max()
        assert not one[n].values[..., 2, :].any() and not one[n].values[..., :, 2].any()


def test_every_quantity_and_tiles(melt):
    from atc.estimators.registry import QUANTITIES

    # what acts from outside is refused in tiles, see test_body_force
    names = [n for n in QUANTITIES if not n.endswith("nodal_virial") and not n.startswith("body_")]
    what = (melt.traj[-1:], melt.pot, atc.kernel("quartic", 2.0), atc.Grid.regular(shape=(5, 4)), names)
    whole = atc.fields(*what, reference=melt.traj[0], tolerance=1e-12)
    tiled = atc.fields(*what, reference=melt.traj[0], tolerance=1e-12, tiles=(2, 2))
    for n in names:
        a, b = whole[n].values, tiled[n].values
        assert np.isfinite(a).all() and np.abs(a - b).max() <= 1e-10 * max(np.abs(a).max(), 1e-3), n
    with pytest.raises(AtcError, match="two whole numbers"):
        atc.fields(*what, reference=melt.traj[0], tiles=(2, 2, 2))


def test_averages(melt):
    what = (melt.pot, atc.kernel("quartic", 2.0), atc.Grid.regular(shape=(5, 4)), ["stress", "temperature"])
    mean = atc.fields(melt.traj, *what, average=True, tolerance=1e-12)
    each = atc.fields(melt.traj, *what, tolerance=1e-12)
    assert np.abs(mean.stress.values[0] - each.stress.values.mean(0)).max() < 1e-12 * np.abs(mean.stress.values).max()
    assert each.stress.shape == (7, 5, 4, 1, 3, 3)


def test_conductivity(melt):
    """The heat current per area against sums by hand; W/K in SI."""
    frames = [planar(f) for f in melt.traj]
    currents = atc.heat_currents(melt.traj, melt.pot, dt=0.08)
    assert currents.units.dimension == 2 and currents.volume == pytest.approx(melt.thermo["vol"], rel=1e-12)
    f = frames[-1]
    v = f.velocities - f.masses @ f.velocities / f.masses.sum()
    d = melt.pot.decompose(f)
    J = ((0.5 * f.masses * (v * v).sum(1) + d.energies_n)[:, None] * v).sum(0)
    b = d.bonds
    # Σ over ordered pairs (v_k·∂U^(j)/∂x_k) x_jk, half of each pair's energy to either end.
    J += (-0.5 * b.G_b * ((v[b.i] + v[b.j]) * b.r_bc).sum(1)) @ b.r_bc
    assert np.abs(currents.J_tc[-1] - J).max() < 1e-12 * np.abs(J).max()
    assert currents.temperature == pytest.approx(
        np.mean(
            [
                (f.masses @ (g * g).sum(1)) / (2 * len(f) - 2)
                for f in frames
                for g in [f.velocities - f.masses @ f.velocities / f.masses.sum()]
            ]
        ),
        rel=1e-12,
    )
    rng = np.random.default_rng(0)
    noise = np.c_[rng.normal(size=(4000, 2)), np.zeros(4000)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        k = atc.conductivity(noise, dt=1.0, volume=10.0, temperature=2.0, units=units("metal").planar)
    assert set(k.components) == {"x", "y"} and k.si_units == "W/K" and k.units == "eV/(ps*K)"


def test_from_the_command_line(melt, tmp_path, capsys):
    """A scene from plan to picture; the key, the script and the argument say the same."""
    from atc.analysis.compare import compare
    from atc.config.scene import Scene
    from atc.pictures.plotting import plot

    scene = {
        "trajectory": {
            "file": str(melt.folder / "run.dump"),
            "units": "lj",
            "topology": str(melt.folder / "run.data"),
            "frames": "5:",
        },
        "potential": {"input": str(melt.script)},
        "kernel": {"name": "box", "size": [2.0, 1.5]},
        "grid": {"kind": "regular", "shape": [6, 5]},
        "fields": {"quantities": ["stress", "virial_stress", "smoothed_virial_stress", "velocity"], "tolerance": 1e-12},
    }
    ds = Scene.load(scene).run()
    assert "36 points" not in str(Scene.load(scene).plan()) and "30 grid points" in str(Scene.load(scene).plan())
    said = Scene.load({**scene, "trajectory": {**scene["trajectory"], "dimension": 2}}).run()
    assert np.array_equal(said.stress.values, ds.stress.values)
    rows = {r["name"] for r in compare(ds).rows if r["section"] == "box average"}
    assert rows == {"xx", "yy", "xy", "hydrostatic", "vonmises"}
    assert compare(ds).value("box average", "hydrostatic", "virial") == pytest.approx(
        float(np.trace(ds.virial_stress.values.mean(0))) / 2, rel=1e-12
    )
    for name in ("stress", "velocity"):  # xx, yy, xy; x, y and speed: a map each, with its colour bar
        axes = plot(ds, name).axes
        assert len(axes) == 3 and [len(ax.child_axes) for ax in axes] == [1, 1, 1]


# ---- what is refused


def flat(n=25, z=0.0, **more):
    x = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), -1).reshape(-1, 2)[:n]
    return Frame(
        np.c_[x, np.full(n, z)],
        Cell(np.diag([5.0, 5.0, 0.5]), [0, 0, z - 0.25]),
        units("lj"),
        masses=np.ones(n),
        **more,
    )


PAIR = "pair_style lj/cut 2.0\npair_coeff 1 1 1.0 1.0"


def test_atoms_off_the_plane_are_named():
    off = flat()
    off.positions[7, 2] = 0.1
    with pytest.raises(AtcError, match=r"atom 8 lies at z = 0\.1 sigma, others at 0 sigma"):
        atc.read(off, dimension=2)[0]
    v = np.zeros((25, 3))
    v[:, 0], v[3, 2] = 1.0, -0.2
    with pytest.raises(AtcError, match=r"atom 4 has the velocity vz = -0\.2"):
        planar(flat(velocities=v))
    tilted = Cell([[5.0, 0, 0.2], [0, 5.0, 0], [0, 0, 1.0]])
    with pytest.raises(AtcError, match="edge a of the cell has a z component"):
        planar(flat().replace(cell=tilted))


def test_a_plane_anywhere():
    """z = const need not be 0."""
    kern, grid = atc.kernel("quartic", 1.5), atc.Grid.regular(shape=(4, 4))
    pot = atc.potential("dimension 2\n" + PAIR, units="lj")
    a, b = (atc.fields(flat(z=z), pot, kern, grid, ["stress_potential", "density"]) for z in (0.0, 0.3))
    assert np.allclose(a.stress_potential, b.stress_potential, rtol=1e-12, atol=1e-13) and b.z.values == pytest.approx(
        [0.3], rel=1e-14
    )
    atc.fields(flat(z=0.3), pot, kern, atc.Grid.points([[1.0, 1.0, 0.3]]), ["density"])
    with pytest.raises(AtcError, match=r"grid point 1 lies at z = 0, off the plane z = 0\.3"):
        atc.fields(flat(z=0.3), pot, kern, atc.Grid.points([[1.0, 1.0, 0.3], [1.0, 1.0, 0.0]]), ["density"])


def test_contradictions():
    grid, kern = atc.Grid.regular(shape=4), atc.kernel("quartic", 1.5)
    two, three = (atc.potential(f"dimension {d}\n{PAIR}", units="lj") for d in (2, 3))
    silent = atc.potential(PAIR, units="lj")
    with pytest.raises(AtcError, match="two-dimensional run, but the potential says dimension 3"):
        atc.fields(atc.read(flat(), dimension=2), three, kern, grid, ["density"])
    with pytest.raises(AtcError, match="dimension = 3, but the potential says dimension 2"):
        atc.fields(atc.read(flat(), dimension=3)[:], two, kern, grid, ["density"])
    with pytest.raises(AtcError, match="expected 2"):
        atc.read(flat(), dimension=4)
    with pytest.raises(AtcError, match="opened as a two-dimensional run"):
        atc.read(atc.read(flat(), dimension=2), dimension=3)
    one = atc.fields(atc.read(flat(), dimension=2), silent, kern, grid, ["stress_potential"])
    other = atc.fields(flat(), two, kern, grid, ["stress_potential"])
    assert np.array_equal(one.stress_potential.values, other.stress_potential.values)
    # The box is thin and periodic along z: in three dimensions layers of it would act on each other.
    assert two.decompose(flat()).energy == pytest.approx(silent.decompose(planar(flat())).energy, rel=1e-14)
    assert abs(silent.decompose(flat()).energy) > 10 * abs(two.decompose(flat()).energy)


def test_three_dimensions_that_look_like_two_are_doubted():
    with pytest.warns(AtcWarning, match="if this is a two-dimensional run, say so"):
        atc.fields(flat(), None, atc.kernel("quartic", 1.5), atc.Grid.regular(shape=4), ["density"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atc.fields(
            atc.read(flat(), dimension=2), None, atc.kernel("quartic", 1.5), atc.Grid.regular(shape=4), ["density"]
        )


@pytest.mark.parametrize(
    ("make_grid", "says"),
    [
        (lambda: atc.Grid.regular(shape=(4, 4, 4)), "one layer: give two numbers"),
        (lambda: atc.Grid.plane(axis="x", shape=4), "a line or a slab"),
        (lambda: atc.Grid.plane(axis="z", position=0.1, shape=4), "only one"),
        (lambda: atc.Grid.plane([0, 0], [1, 0], [0, 1, 1], shape=4), "leave the plane"),
        (lambda: atc.Grid.line([0, 0, 0], [1, 1, 1], 4), "line end lies at z = 1, off the plane"),
        (lambda: atc.Grid.slab("z", 4), "no extent there"),
    ],
)
def test_grids_without_meaning(make_grid, says):
    with pytest.raises(AtcError, match=says):
        atc.fields(atc.read(flat(), dimension=2), None, atc.kernel("quartic", 1.5), make_grid(), ["density"])


@pytest.mark.parametrize(
    ("make_grid", "says"),
    [
        (lambda: atc.Grid.regular(shape=(4, 4)), "give three"),
        (lambda: atc.Grid.regular(spacing=(1.0, 1.0)), "one or three"),
        (lambda: atc.Grid.regular(vectors=[4.0, 4.0], shape=4), "grid vectors: two numbers"),
        (lambda: atc.Grid.points([[1, 2]]), "give x, y and z"),
        (lambda: atc.Grid.line([0, 0], [1, 1], 4), "give x, y and z"),
        (lambda: atc.Grid.plane([0, 0, 0], [1, 0], [0, 1], shape=4), "grid u: two numbers"),
    ],
)
def test_two_numbers_in_three_dimensions(make_grid, says):
    cell = Cell(np.diag([5.0, 5.0, 5.0]))
    with pytest.raises(AtcError, match=says):
        make_grid().bind(units("lj"), cell)


def test_kernels_without_meaning():
    what = (atc.read(flat(), dimension=2), None)
    grid = atc.Grid.regular(shape=4)
    with pytest.raises(AtcError, match="three edge lengths.*two-dimensional: give two"):
        atc.fields(*what, atc.kernel("box", size=[1.0, 2.0, 3.0]), grid, ["density"])
    with pytest.raises(AtcError, match="two edge lengths.*three dimensions"):
        atc.fields(flat(), None, KERNELS["box"], grid, ["density"])
    with pytest.raises(AtcError, match="made for two dimensions"):
        atc.fields(flat(), None, KERNELS["quartic"], grid, ["density"])
    with pytest.raises(AtcError, match="dimension must be 2 or 3"):
        atc.kernel("quartic", 1.0, dimension=1)
    ds = atc.fields(*what, atc.kernel("box", size=2.0), grid, ["number_density"])
    assert float(ds.number_density.mean()) == pytest.approx(1.0)


def test_units_are_lammps_own():
    metal, flat_ = units("metal"), units("metal").planar
    assert flat_.factor("pressure") == metal.factor("pressure") and flat_.factor("density") == metal.factor("density")
    si = units("si")
    assert si.planar.factor("pressure") == pytest.approx(si.factor("pressure") * 1e10)
    assert si.planar.to_user("conductivity", 1.0) == pytest.approx(si.factor("energy") ** -1 * si.factor("time"))
    assert si.planar.label("pressure") == "Pa*m" and units("lj").planar.label("number_density") == "1/sigma^2"
