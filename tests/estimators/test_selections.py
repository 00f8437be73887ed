"""Fields of some atoms, and of one species after the other: parts add up to the whole, bonds go by their ends, and both
are what plain sums give."""

from pathlib import Path

import numpy as np
import pytest
from frames import argon
from naive_fields import bond_sum, lj_bonds, site_sum

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.estimators.selections import Parts
from atc.planning.identity import identity
from atc.planning.job import prepare
from atc.planning.request import Request
from atc.units import units

LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"
KERNEL = atc.kernel("quartic", 5.0)
GRID = atc.Grid.regular(shape=(4, 3, 5))
#: All that adds up, whichever way it is formed.
ADDITIVE = [
    "number_density", "density", "momentum", "stress", "energy", "heat_flux", "smoothed_virial_stress", "energy_flux",
    "churning", "heat_current", "virial_stress", "column:c",
]  # fmt: skip


def frames(count=1, **more):
    out = []
    for k in range(count):
        f = argon(seed=k, temperature=120.0, **more)
        rng = np.random.default_rng(k)
        f.masses = np.where(np.arange(len(f)) % 3, 39.948, 83.8)  # the same atoms in every frame
        out.append(f.replace(types=np.where(f.masses < 50, 1, 2), molecules=np.arange(len(f)) // 5 + 1, step=k,
                             extra={"c": rng.normal(size=len(f))}, type_names={1: "Ar", 2: "Kr"}))  # fmt: skip
    return out


def computed(trajectory, quantities=ADDITIVE, pot=LJ, grid=GRID, tolerance=1e-12, **more):
    pot = atc.potential(pot, units="metal") if isinstance(pot, str) else pot
    return atc.fields(trajectory, pot, KERNEL, grid, quantities, tolerance=tolerance, **more)


def largest(a, b):
    a, b = np.asarray(a), np.asarray(b)
    assert np.array_equal(np.isnan(a), np.isnan(b))
    scale = np.nanmax(abs(b))
    return float(np.nanmax(abs(a - b)) / scale) if scale > 0 else float(np.nanmax(abs(a)))


@pytest.mark.parametrize("by", ["type", "molecule", "element"])
def test_parts_add_up_to_the_whole(by):
    f = frames()
    whole, parts = computed(f), computed(f, by=by)
    assert parts.stress.dims[:2] == ("frame", "species")
    assert list(parts.species.values) == {"type": ["Ar", "Kr"], "element": ["Ar", "Kr"]}.get(by, list("1234"))
    for name in whole:
        if name != "mask":
            # sums of the same terms in another order: some tens of roundings
            assert largest(parts[name].sum("species", skipna=False), whole[name]) < 1e-13, name
    assert parts.stress.attrs["of_species"] == "shares that add up"


def test_parts_of_a_selection_add_up_to_it_whichever_bonds_count():
    f = frames()
    for bonds in ("half", "both", "one", "any"):
        chosen = {"select": atc.select(ids="1:13"), "bonds": bonds}
        names = ["stress", "virial_stress", "heat_flux"]
        whole, parts = computed(f, names, **chosen), computed(f, names, by="type", **chosen)
        for name in names:
            assert largest(parts[name].sum("species", skipna=False), whole[name]) < 1e-13, (name, bonds)


def test_parts_add_up_with_triplets_and_in_averages_and_slabs():
    f = [g.replace(types=np.where(np.arange(len(g)) % 2, 1, 2)) for g in frames(4, n=(3, 3, 3))]
    folder = Path(__file__).parents[2] / "data/silicon_plate"
    pot = atc.potential("pair_style sw\npair_coeff * * Si.sw Si Si", units="metal", folder=folder)
    for more in ({"average": True}, {"average": 2, "grid": atc.Grid.slab("z", 6)}):
        whole, parts = (
            computed(f, ["stress", "heat_flux"], pot, **more),
            computed(f, ["stress", "heat_flux"], pot, by="type", **more),
        )
        for name in ("stress", "stress_kinetic", "heat_flux", "heat_flux_churning"):
            assert largest(parts[name].sum("species", skipna=False), whole[name]) < 1e-13, name
        assert parts.stress_stderr.shape == parts.stress.shape


def test_bonds_by_their_ends():
    f = frames()
    chosen = {"select": atc.select(types=1)}
    rest = {"select": atc.select(types=1, invert=True)}
    whole = computed(f, ["stress_potential", "virial_stress_potential"])
    both, one, half, every = (
        computed(f, ["stress_potential", "virial_stress_potential"], bonds=b, **chosen)
        for b in ("both", "one", "half", "any")
    )
    others = computed(f, ["stress_potential", "virial_stress_potential"], bonds="both", **rest)
    for name in ("stress_potential", "virial_stress_potential"):
        assert largest(both[name] + one[name] + others[name], whole[name]) < 1e-13
        assert largest(both[name] + 0.5 * one[name], half[name]) < 1e-13
        assert largest(every[name] + others[name], whole[name]) < 1e-13
    assert "half of each bond" in half.attrs["selected_bonds"]


def test_selected_fields_are_plain_sums():
    (f,) = frames()
    u, rng = units("metal"), np.random.default_rng(3)
    points = f.cell.cartesian(rng.random((6, 3)))
    ds = computed([f], ["density", "temperature", "stress"], grid=atc.Grid.points(points), select=atc.select(types=2))
    mine = f.types == 2
    bonds, _, _ = lj_bonds(f.positions, f.cell, u.to_internal("energy", 0.0104), 3.4, 5.0)
    c_b = 0.5 * (mine[bonds.i].astype(float) + mine[bonds.j])
    b_b9 = np.einsum("b,bi,bj->bij", c_b * bonds.G_b, bonds.r_bc, bonds.r_bc).reshape(-1, 9)
    want = bond_sum(points, f.positions[bonds.i], bonds.r_bc, b_b9, KERNEL, f.cell).reshape(-1, 3, 3)
    assert largest(ds.stress_potential[0].values, u.to_user("pressure", want)) < 1e-12
    m = f.masses[mine]
    sums = site_sum(points, f.positions[mine], np.c_[m, m[:, None] * f.velocities[mine]], KERNEL, f.cell)
    assert largest(ds.density[0].values, u.to_user("density", sums[:, 0])) < 1e-12
    P_gcc = []
    for g in range(len(points)):
        w_nc = f.velocities[mine] - sums[g, 1:] / sums[g, 0]
        P_n9 = m[:, None] * np.einsum("ni,nj->nij", w_nc, w_nc).reshape(-1, 9)
        P = site_sum(points[g : g + 1], f.positions[mine], P_n9, KERNEL, f.cell).reshape(3, 3)
        w_n = site_sum(points[g : g + 1], f.positions[mine], np.eye(len(m)), KERNEL, f.cell)[0]
        lost = w_n**2 @ m / (w_n @ m)
        P_gcc.append(P * w_n.sum() / (w_n.sum() - lost) if w_n.sum() - lost > 1e-9 * w_n.sum() else 0.0 * P)
    # where a second atom is barely in reach, n/(n − lost), a hundred here, comes to the rounding
    assert largest(ds.stress_kinetic[0].values, -u.to_user("pressure", np.array(P_gcc))) < 1e-11


def test_a_fast_part_loses_no_digits():
    (f,) = frames()
    fast = f.replace(velocities=f.velocities + 1e3 * (f.positions[:, :1] > 1.0) * np.array([1.0, 0.0, 0.0]))
    whole, parts = computed([fast], ["stress_kinetic"]), computed([fast], ["stress_kinetic"], by="type")
    assert largest(parts.stress_kinetic.sum("species", skipna=False), whole.stress_kinetic) < 1e-12


def test_approximate_sums_keep_their_tolerance():
    (f,) = frames(n=(4, 4, 4), cell=atc.Cell([15.0, 16.0, 17.0]))
    grid = atc.Grid.regular(spacing=0.8)
    exact = computed([f], ["stress"], grid=grid, by="type")
    near = computed([f], ["stress"], grid=grid, by="type", tolerance=1e-3, method="spectral")
    for s in range(2):
        assert largest(near.stress_potential[0, s], exact.stress_potential[0, s]) < 1e-3
    assert near.stress_potential.attrs["error_max"] < 1e-3


def test_which_atoms():
    (f,) = frames()
    x = f.cell.wrap(f.positions)[0]
    lo = f.cell.origin
    for given, want in (
        ({"types": [1]}, f.types == 1),
        ({"elements": "Kr"}, f.types == 2),
        ({"ids": ["3:6", 9, "15:"]}, np.isin(f.ids, [3, 4, 5, 6, 9, *range(15, len(f) + 1)])),
        ({"ids": "2:10:3"}, np.isin(f.ids, [2, 5, 8])),
        ({"molecules": [2]}, f.molecules == 2),
        ({"region": f"block INF {lo[0] + 4} INF INF INF INF"}, x[:, 0] <= lo[0] + 4),
        ({"region": "sphere 0 5 55 4 side out"}, np.linalg.norm(x - [0, 5, 55], axis=1) > 4),
        ({"types": 1, "region": f"block EDGE {lo[0] + 4} EDGE EDGE EDGE EDGE"}, (f.types == 1) & (x[:, 0] <= lo[0] + 4)),
        ({"types": 1, "invert": True}, f.types == 2),
    ):  # fmt: skip
        assert np.array_equal(atc.select(**given).of(f), want), given
    moved = f.replace(positions=f.positions + 30.0)
    kept = atc.select(region=f"block INF {lo[0] + 4} INF INF INF INF", fixed=True).settled(f)
    assert np.array_equal(kept.of(moved), x[:, 0] <= lo[0] + 4)


def test_words_of_mdanalysis():
    pytest.importorskip("MDAnalysis")
    (f,) = frames()
    lo = f.cell.origin
    assert np.array_equal(atc.select("type 2").of(f), f.types == 2)
    assert np.array_equal(atc.select("resid 1:2 and not name Kr").of(f), (f.molecules < 3) & (f.types == 1))
    assert np.array_equal(atc.select(f"prop x < {lo[0] + 3}").of(f), np.float32(f.positions[:, 0]) < lo[0] + 3)
    ds = computed([f], ["density"], select="type 2")
    assert largest(ds.density, computed([f], ["density"], select=atc.select(types=2)).density) == 0
    for words, said in (("tpye 2", "MDAnalysis says"), ("index", "MDAnalysis"), ("prop x <", "MDAnalysis")):
        with pytest.raises(AtcError, match=said):
            atc.select(words).of(f)


def test_a_universe_keeps_its_own_names():
    mda = pytest.importorskip("MDAnalysis")
    (f,) = frames()
    u = mda.Universe.empty(len(f), n_residues=2, atom_resindex=np.arange(len(f)) % 2, trajectory=True)
    u.add_TopologyAttr("resnames", ["SOL", "NA"])
    u.add_TopologyAttr("masses", f.masses)
    u.atoms.positions = f.positions
    u.dimensions = [9, 10, 11, 90, 90, 90]
    traj = atc.read(u)
    odd = np.arange(len(f)) % 2 == 1
    chosen = atc.select("resname NA").settled(traj[0], traj[0:1])
    assert np.array_equal(chosen.of(traj[0]), odd)


def test_the_run_is_another_one():
    f, pot = frames(), atc.potential(LJ, units="metal")

    def of(**more):
        return identity(prepare(Request(f, pot, KERNEL, GRID, ["stress"], **more)))

    ways = [{}, {"select": atc.select(types=1)}, {"select": atc.select(types=2)}, {"by": "type"},
            {"select": atc.select(types=1), "bonds": "both"}]  # fmt: skip
    made = [str(of(**w)) for w in ways]
    assert len({*made}) == len(made)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"select": atc.select(types=7)}, "no atom is types 7"),
        ({"select": 3}, "expected what atc.select gives"),
        ({"by": "colour"}, "expected one of 'type'"),
        ({"bonds": "both"}, "goes with select"),
        ({"select": atc.select(types=1), "bonds": "most"}, "expected one of 'half'"),
        ({"by": "type", "tiles": (2, 1, 1)}, "leave tiles out"),
        ({"by": "type", "quantities": ["virial_stress_per_atom"]}, "every atom's value"),
        ({"by": "type", "quantities": ["churning_divergence"]}, "not known of some atoms"),
        ({"by": "type", "quantities": ["peridynamic_stress_weighted_virial"]}, "weights all bonds"),
    ],
)
def test_what_cannot_be_is_said(more, said):
    quantities = more.pop("quantities", ["stress"]) if isinstance(more, dict) else None
    with pytest.raises(AtcError, match=said):
        computed(frames(), quantities, **more)


def test_charges_with_modes_have_no_ends():
    (f,) = frames()
    f = f.replace(charges=np.where(np.arange(len(f)) % 2, 1.0, -1.0))
    pot = "pair_style coul/long 4.0\npair_coeff * *\nkspace_style ewald 1e-4"
    with pytest.raises(AtcError, match="no sum over bonds with ends"):
        computed([f], ["stress"], pot, by="type")
    assert computed([f], ["stress_kinetic"], pot, by="type").sizes["species"] == 2


def test_an_atom_of_no_part_is_named():
    a, b = frames(2)
    b.types[3] = 5
    with pytest.raises(AtcError, match="atom 4 is of type 5, which the first frame does not have"):
        computed([a, b], ["density"], by="type")
    with pytest.raises(AtcError, match="have no names"):
        Parts.of_frame("element", a.replace(type_names={}), np.ones(len(a), bool))


def test_scenes_say_the_same(tmp_path):
    scene = {
        "trajectory": {"file": "x.dump"},
        "select": {"types": [1], "region": "block 0 10 INF INF INF INF", "by": "molecule", "bonds": "any"},
    }
    made = Scene.load(scene).selection()
    assert made == {"select": atc.select(types=[1], region="block 0 10 INF INF INF INF"), "by": "molecule",
                    "bonds": "any"}  # fmt: skip
    ds = computed(frames(), ["stress"], select=made["select"].__class__(types=(1,)), by="type", bonds="any")
    again = Scene.loads(ds.attrs["scene"])
    assert again.selection() == {"select": atc.select(types=[1]), "by": "type", "bonds": "any"}
    for key, value, said in (
        ("region", "blok 0 1", "region blok is not known"),
        ("ids", "a:b", "expected atom ids or spans"),
        ("types", ["O"], "expected atom types"),
        ("by", "mass", "known: type"),
    ):
        with pytest.raises(AtcError, match=said):
            Scene.load({"trajectory": {"file": "x.dump"}, "select": {key: value}})
    with pytest.raises(AtcError, match="whose ends"):
        Scene.load({"trajectory": {"file": "x.dump"}, "select": {"bonds": "both"}})
