"""The peridynamics engine: bodies of nodes, bonds that pull and break, velocity Verlet and quasi-static solvers.

    from atc import pd
    body = pd.Body.lattice(pd.Cylinder("y", (0, 0), 0.037, -0.0025, 0.0), spacing=0.0005, horizon=0.0015001,
    density=2200) sim = pd.Simulation(body, pd.PMB(c=1.6863e22), damage=pd.CriticalStretch(0.0005, 0.25), contact=True,
    dt=1e-7,
                        indenter=pd.Indenter(0.005, 1e17, center=(0, 0.0051, 0), velocity=(0, -100, 0)))
    sim.step(2000);  sim.damage();  sim.energies();  sim.bond_forces()

Any consistent units (SI, say); nothing converts. Arrays carry their axes: n node, b bond, c Cartesian.

`Body(positions, volumes, density, horizon, cell=, dimension=, plane=, thickness=, spacing=, materials=, notches=)`
    X_nc, V_n, rho_n, material_n, cell, horizon, spacing, radius_n; `.bonds` (Families: i_b, j_b, r0_b, xi_bc(X),
    sums()), `.nodes(region)`, `Body.lattice(region, spacing, horizon, density, ...)`. Regions: Box, Cylinder, Sphere,
    Nodes, combined with | & - ~. `Notch(origin, a, b)`, `Notch.line`.
`Simulation(body, materials, damage=, no_fail=, contact=, indenter=, walls=, conditions=, damping=, dt=, state=,
velocities=, displacements=, strain=, interfaces=, threads=, lammps_compat=)`
    .step(n, callback) .state .time_step_stable .dt .positions_nc .damage() (n,) .forces() (n, 3) .energies()
    .strain_energy_n() .bond_forces() .n_broken
`State` : u_nc, v_nc, F_nc, external_nc, smin_n, intact_b, step, time, ledger, pending; to_arrays() / from_arrays() for
exact restarts: Simulation(..., state=State.from_arrays(a)) `BondForces` : i, j, r_bc (y_i − y_j), R_bc (X_i − X_j),
F_bc (force on i from j, volumes included), G_b (F = −G r; None if not central), bond_b; .bonds() → atc.bonds.Bonds
`snapshot(sim)` : (frame, bonds) for `atc.fields`; `reference_frame(sim)`
`Prescribed(region, velocity= | displacement=)`, `BodyForce(region, density= | total=)`, `Indenter`, `Wall`, `Contact`,
`CriticalStretch(s00, alpha)` / `.from_energy(Gc, material, body)`, `CriticalEnergy(Gc)`
`relax(sim, time=)` adaptive dynamic relaxation, `solve_static(sim, time=)` Newton-Krylov: static states with prescribed
displacements and forces, each a step.
`strain_gauge(sim, points, normals)` strain and stress at points, at free surfaces too.
`bond_law` : decorator of the law of a bond, with which a subclass of PMB is a bond-based material of its own.
`Conduction(conductivity, specific_heat)` for `Simulation(conduction=)`, with `FixedTemperature` and `HeatSource` among
the conditions: heat flows in the bonds, and expands bodies with `expansion`.
Materials: PMB, LPS, Correspondence, BondAssociated, Elastic, Viscoelastic, Plastic; Linear (a micromodulus tensor,
e.g. of a crystal) and Hyperelastic (any W(F) through correspondence); the table MATERIALS {name: make(bulk, shear)} for
tests that loop over all.
"""

from __future__ import annotations

#: What is public, by file.
_PUBLIC = {
    "body": "Body",
    "bonds": "Notch Families",
    "regions": "Region Box Cylinder Sphere Nodes Everywhere",
    "materials": "PMB LPS Elastic Correspondence Hyperelastic Linear MATERIALS INFLUENCE BondForces Material bond_law "
    "Plastic Viscoelastic BondAssociated",
    "damage": "CriticalStretch CriticalEnergy",
    "contact": "Contact",
    "indenter": "Indenter Wall",
    "conditions": "Prescribed BodyForce",
    "state": "State Energies",
    "simulation": "Simulation",
    "fields": "SnapshotBonds reference_frame snapshot",
    "statics": "relax solve_static Converged",
    "gauges": "strain_gauge",
    "conduction": "Conduction FixedTemperature HeatSource",
}
_LAZY = {name: file for file, names in _PUBLIC.items() for name in names.split()}

__all__ = list(_LAZY)


def __getattr__(name):
    if name in _LAZY:
        from importlib import import_module

        value = getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'atc.pd' has no attribute {name!r}")


def __dir__():
    return sorted(__all__)
