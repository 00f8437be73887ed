"""Speed of the one-dimensional engines: neighbour updates a second, against plain numpy, and where the convolution
takes over. CPU time of one core."""

import time

import numpy as np

from atc.advection.equation import advect
from atc.advection.kernel import Kernel
from atc.upscaling import evolve
from atc.upscaling.chain import LennardJones, Springs, bump
from atc.upscaling.evolve import verlet


def cpu(call, repeat=3):
    best = np.inf
    for _ in range(repeat):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def numpy_step(u, v, a, w, dt):
    """One step of velocity Verlet of a periodic chain, as one writes it in numpy."""
    v = v + 0.5 * dt * a
    u = u + dt * v
    a = sum(wq * (np.roll(u, -q) + np.roll(u, q) - 2 * u) for q, wq in enumerate(w, 1))
    return u, v + 0.5 * dt * a, a


def main():
    for n, M, steps in ((4001, 20, 400), (100_001, 20, 40)):
        model = Springs.paper(1.0, M)
        u0 = bump(np.arange(n), n / 2, n / 10)
        dt = model.time_step()
        verlet(model, u0, dt=dt, steps=1)
        ours = cpu(lambda: verlet(model, u0, dt=dt, steps=steps, every=steps))

        def plain():
            u, v, a = u0, np.zeros(n), np.zeros(n)
            for _ in range(steps):
                u, v, a = numpy_step(u, v, a, model.weights, dt)

        theirs = cpu(plain)
        print(
            f"springs        {n:7d} nodes, {M:3d} neighbours: {n * M * steps / ours / 1e9:5.2f} G updates/s, "
            f"{theirs / ours:5.1f} times numpy"
        )
    lj = LennardJones(1.0, 4)
    u0 = bump(np.arange(1001.0), half_width=100, amplitude=2)
    verlet(lj, u0, dt=0.1, steps=1)
    print(
        "Lennard-Jones     1001 nodes,   4 neighbours: "
        f"{1001 * 4 * 3000 / cpu(lambda: verlet(lj, u0, dt=0.1, steps=3000, every=3000)) / 1e9:5.2f} G updates/s"
    )
    u0 = bump(np.arange(100_001), 5e4, 1e4)
    for M in (30, 60, 120, 500):
        model, found = Springs.paper(1.0, M), {}
        for name, limit in (("sum", 10**9), ("fft", 0)):
            saved, evolve._FFT_FROM = evolve._FFT_FROM, limit
            found[name] = cpu(lambda: verlet(model, u0, dt=model.time_step(), steps=20, every=20), 2)
            evolve._FFT_FROM = saved
        print(
            f"100,001 nodes, {M:3d} neighbours: sum {50 * found['sum']:6.2f} ms a step, convolution "
            f"{50 * found['fft']:6.2f}"
        )
    x = np.arange(4096) / 4096
    for M in (8, 24, 64, 200):
        kernel, found = Kernel("box", (M + 0.4) / 4096, 1 / 4096), {}
        for method in ("stencil", "fft"):
            run = advect(np.sin(2 * np.pi * x), kernel, duration=0.002, viscosity=1e-3, method=method, times=2)
            found[method] = cpu(
                lambda: advect(np.sin(2 * np.pi * x), kernel, duration=0.02, viscosity=1e-3, method=method, times=2), 2
            )
            steps = run.steps * 10
        print(
            f"Burgers, 4096 nodes, {kernel.neighbors:3d} neighbours: stencil {1e3 * found['stencil'] / steps:6.3f} ms "
            f"a step, fft {1e3 * found['fft'] / steps:6.3f}"
        )


if __name__ == "__main__":
    main()
