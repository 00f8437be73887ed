"""What stress and heat flux of learned models cost, over the model's own energies and forces.

    python benchmarks/edge_models.py [atoms] [threads]

Random weights, float64: times do not depend on them. Measured are MACE and NequIP, whichever is installed; without
either, a model of two layers of this file. Stress: neighbour list, energies, forces, stress of every bond. Flux: the
same with what every bond carries, and the identity of every atom checked. Times are those of all processors together.
"""

import sys
import time
from importlib.util import find_spec

import numpy as np

import atc
from atc.units import units


def liquid(n, density=0.05, seed=0):
    """About n atoms at a density of so many per cubic angstrom, none nearer than a lattice shaken by 0.3 Å."""
    rng = np.random.default_rng(seed)
    k = round(n ** (1 / 3))
    cell = atc.Cell([k * density ** (-1 / 3)] * 3)
    s = np.stack(np.meshgrid(*[(np.arange(k) + 0.5) / k] * 3, indexing="ij"), -1).reshape(-1, 3)
    x = cell.cartesian(s) + rng.uniform(-0.3, 0.3, s.shape)
    types = rng.integers(1, 3, len(x))
    return atc.Frame(
        x, cell, units("metal"), types=types, masses=np.full(len(x), 20.0), velocities=rng.normal(size=x.shape)
    )


def mace(layers):
    import mace  # noqa: F401  (before e3nn)
    import torch
    from e3nn import o3
    from mace import modules

    torch.manual_seed(0)
    block = modules.interaction_classes["RealAgnosticResidualInteractionBlock"]
    return modules.ScaleShiftMACE(
        r_max=5.0,
        num_bessel=8,
        num_polynomial_cutoff=5,
        max_ell=3,
        interaction_cls=block,
        interaction_cls_first=block,
        num_interactions=layers,
        num_elements=2,
        hidden_irreps=o3.Irreps("32x0e + 32x1o"),
        MLP_irreps=o3.Irreps("16x0e"),
        atomic_energies=np.zeros(2),
        avg_num_neighbors=26.0,
        atomic_numbers=[6, 14],
        correlation=3,
        gate=torch.nn.functional.silu,
        radial_MLP=[64, 64, 64],
        atomic_inter_scale=1.0,
        atomic_inter_shift=0.0,
    ).double()


def nequip(layers):
    from nequip.model import NequIPGNNModel
    from nequip.utils.global_state import set_global_state

    set_global_state()
    return NequIPGNNModel(
        seed=0,
        model_dtype="float64",
        r_max=5.0,
        type_names=["C", "Si"],
        num_layers=layers,
        l_max=2,
        num_features=32,
        radial_mlp_width=64,
        avg_num_neighbors=26.0,
    )


def models():
    """(name, potential) of what can be measured here."""
    if find_spec("mace"):
        for layers in (1, 2):
            yield f"MACE, {layers} layers, 32x0e+32x1o", atc.mace(mace(layers), ["C", "Si"])
    if find_spec("nequip"):
        for layers in (2, 4):
            yield f"NequIP, {layers} layers, 32, l = 2", atc.nequip(nequip(layers), ["C", "Si"])


def best(f, repeat=3):
    f()
    times = []
    for _ in range(repeat):
        start = time.process_time()
        f()
        times.append(time.process_time() - start)
    return min(times)


def main(n=1000, threads=1):
    import torch

    torch.set_num_threads(threads)
    torch.set_default_dtype(torch.float64)
    frame = liquid(n)
    for name, pot in models():
        term = pot.terms[0]
        x, cell = frame.positions / term.length, frame.cell.vectors / term.length
        species = term.map(frame)[0]
        own = best(lambda: term.own(x, cell, frame.cell.periodic, species, term))
        stress = best(lambda: pot.stream(frame, lambda bonds, thread: None, threads=threads, forces=True))
        flux = best(lambda: pot.stream(frame, lambda bonds, thread: None, threads=threads, forces=True, sources=True))
        print(
            f"{name}: {len(frame)} atoms, {threads} threads: the model's own energy, forces and virial {own:.2f} s; "
            f"stress {stress / own:.2f}, flux {flux / own:.2f} times that"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
