"""Random neuroevolution potentials and atoms, and what calorine says of them: ``nep_calorine.npz`` beside.

``python tests/nep_oracle.py`` in an environment with calorine 4 writes that file anew; of NEP2 only calorine up to 2.3.1
knows: ``python tests/nep_oracle.py nep2_one nep2`` there.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

KEPT = Path(__file__).with_name("nep_calorine.npz")
_TWO = ("Si", "C")
_FLEXIBLE = [
    [0.9, 2.3, 0.2, 3.0, 0.5, 0.9, 0.3, 0.4, 0.03, 0.2],
    [1.0, 2.4, 0.1, 3.1, 0.4, 0.95, 0.2, 0.41, 0.04, 0.22],
    [1.1, 2.2, 0.3, 2.0, 0.6, 0.8, 0.1, 0.3, 0.02, 0.1],
]
CASES = {
    "nep2_one": {"token": "nep", "names": ("Si",), "l_max": (4,)},
    "nep2": {"token": "nep", "l_max": (4,)},
    "nep3": {"token": "nep3", "l_max": (4, 2, 1)},
    "nep3_zbl": {"token": "nep3_zbl", "l_max": (4, 2, 0), "zbl": (1.0, 2.0)},
    "one": {"names": ("Si",)},
    "two": {},
    "l1": {"l_max": (1, 0, 0)},
    "l8": {"l_max": (8, 0, 0)},
    "222": {"l_max": (4, 2, 0)},
    "1111": {"l_max": (4, 0, 1)},
    "112": {"l_max": (4, 0, 0, 1)},
    "123": {"l_max": (4, 0, 0, 0, 1)},
    "233": {"l_max": (4, 0, 0, 0, 0, 1)},
    "134": {"l_max": (4, 0, 0, 0, 0, 0, 1)},
    "all": {"l_max": (4, 2, 1, 1, 1, 1, 1), "names": ("Si", "C", "O")},
    "zbl": {"token": "nep4_zbl", "l_max": (4, 2, 1), "zbl": (1.0, 2.4)},
    "flexible": {"token": "nep4_zbl", "zbl": (0, 0), "flexible": _FLEXIBLE},
    "typewise": {"cutoffs": (6.0, 4.0, 5.0, 3.5)},
    "nep5": {"token": "nep5", "l_max": (4, 2, 1)},
}
_RADIAL, _ANGULAR, _NEURONS = (4, 6), (3, 5), 5


def write(
    path, seed=0, token="nep4", names=_TWO, cutoffs=(6.0, 4.0), l_max=(4, 0, 0), zbl=None, flexible=(), amplitude=1.0
):
    """A random ``nep.txt``. Legacy random states are the same in every version of numpy."""
    rng = np.random.RandomState(seed)
    t, two = len(names), token == "nep"
    n_radial, n_angular = _RADIAL[0] + 1, _ANGULAR[0] + 1
    descriptors = n_radial + n_angular * (l_max[0] + sum(k > 0 for k in l_max[1:]))
    numbers = []
    for _ in range(1 if token[:4] in ("nep", "nep3") else t):
        numbers += [*0.3 * rng.normal(size=descriptors * _NEURONS), *0.3 * rng.normal(size=_NEURONS)]
        numbers += [*0.5 * amplitude * rng.normal(size=_NEURONS + (token == "nep5"))]
    numbers.append(rng.normal())
    if two:
        numbers += [*0.6 * rng.normal(size=t * t * (n_radial + n_angular) * (t > 1))]
    else:
        k = n_radial * (_RADIAL[1] + 1) + n_angular * (_ANGULAR[1] + 1)
        numbers += [*0.6 * rng.normal(size=t * t * k)]
    numbers += [*rng.uniform(0.05, 0.5, descriptors), *np.ravel(flexible)]
    lines = [f"{token} {t} {' '.join(names)}", *([f"zbl {zbl[0]} {zbl[1]}"] if zbl is not None else [])]
    lines += [f"cutoff {' '.join(map(str, cutoffs))} 300 200", f"n_max {_RADIAL[0]} {_ANGULAR[0]}"]
    lines += [] if two else [f"basis_size {_RADIAL[1]} {_ANGULAR[1]}"]
    lines += [f"l_max {' '.join(map(str, l_max))}", f"ANN {_NEURONS} 0", *(f"{x:.15e}" for x in numbers)]
    Path(path).write_text("\n".join(lines) + "\n")


def atoms(kinds: int, seed=0, n=24, side=7.6, apart=1.5):
    """Positions, tilted cell (shorter than two cutoffs), species from 0."""
    rng = np.random.RandomState(seed + 100)
    cell = np.array([[side, 0, 0], [0.9, 1.05 * side, 0], [0, -0.6, 0.95 * side]])
    s = []
    while len(s) < n:
        new = rng.uniform(size=3)
        d = np.array(s).reshape(-1, 3) - new
        if not len(s) or np.linalg.norm((d - np.rint(d)) @ cell, axis=1).min() > apart:
            s.append(new)
    return np.array(s) @ cell, cell, rng.randint(0, kinds, n)


def calorine(path, x, cell, symbols):
    """(n,) energies, (n, 3) forces, (n, 9) virials."""
    import _nepy

    model = _nepy.NEPY(str(path), len(x), cell.T.ravel().tolist(), list(symbols), x.T.ravel().tolist(), [1.0] * len(x))
    U, F, W = model.get_potential_forces_and_virials()
    return np.array(U), np.array(F).reshape(3, -1).T, np.array(W).reshape(9, -1).T


if __name__ == "__main__":
    found = dict(np.load(KEPT)) if KEPT.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[1:] or [name for name in CASES if not name.startswith("nep2")]:
            path, kinds = Path(folder) / "nep.txt", CASES[name].get("names", _TWO)
            write(path, **CASES[name])
            x, cell, species = atoms(len(kinds))
            found[name] = np.column_stack(calorine(path, x, cell, [kinds[s] for s in species]))
    np.savez_compressed(KEPT, **found)
