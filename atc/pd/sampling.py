"""How well nodes sample a material: elastic constants, or the stiffness of long waves, that their sums have against
those of the law itself."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..frame import Cell
from .voigt import to_voigt, unit_strain

#: How far the moduli of nodes may be from those of the kernel they sample: beyond the first a warning, beyond the
#: second an error.
MODULI_WARN, MODULI_REFUSE = 0.02, 0.10


def dynamical_matrix(k_kc, xi_bc, springs_bcc, mass) -> np.ndarray:
    """(k, 3, 3) D of a node with these bonds, as they stand from both its sides: Σ 2 sin²(k·ξ/2) S/m."""
    turns = 2 * np.sin(0.5 * np.atleast_2d(np.asarray(k_kc, float)) @ np.transpose(xi_bc)) ** 2
    return np.tensordot(turns, springs_bcc, axes=1) / mass


def long_waves(D_of, model) -> np.ndarray:
    """(3 directions, 3) stiffness of long waves along [100], [110], [111] by nodes' D(k), over that of the kernel they
    sample, branches ascending; NaN where the kernel has none."""
    k = 1e-3 * 2 * np.pi / np.linalg.norm(model.crystal.conventional[0])
    e = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1]]) / np.sqrt([[1], [2], [3]])
    a, b = (np.linalg.eigvalsh(D(k * e)) for D in (D_of, model.dynamical_matrix))
    return a / np.where(b > 0, b, np.nan)


def check_moduli(D_of, model, spacing) -> None:
    """Warn where the stiffness of long waves that nodes have, by their D(k), is 2 % off the kernel's they sample;
    raise AtcError where it is 10 % off."""
    off = long_waves(D_of, model)
    worst = float(np.abs(off - 1).max())
    if worst <= MODULI_WARN:
        return
    u = model.crystal.units
    length = f"{u.to_user('length', spacing):.4g} {u.label('length')}"
    found = (
        f"{model.label}: nodes {length} apart sample the kernel too coarsely: stiffnesses of long waves are "
        f"{off.min():.3g} to {off.max():.3g} times the kernel's own"
    )
    if not worst <= MODULI_REFUSE:
        raise AtcError(f"{found}; take a smaller spacing, or a coarse lattice (coarse2, coarse3)")
    warnings.warn(f"{found}; a smaller spacing comes closer", AtcWarning, stacklevel=4)


def sampled_constants(
    material, step_cc, horizon, density, strain=1e-6, *, dimension=3, plane="stress", thickness=1.0, components=None
) -> np.ndarray:
    """(6, 6) ∂σ/∂ε of a periodic body of nodes `step_cc` apart: what the sums over nodes make of the material.

    Voigt's order xx yy zz yz xz xy. `components` : which columns to compute (default all; the others are 0). In bodies
    of lower dimension only rows and columns of strains within it have a meaning.
    """
    from .body import Body
    from .simulation import Simulation

    step = np.asarray(step_cc, float)
    within = np.arange(3) < dimension
    # Few nodes, whose families are mostly their images.
    reach = horizon * np.linalg.norm(np.linalg.inv(step), axis=0)
    counts = np.where(within, np.ceil(reach / 3), 1).astype(int)
    s = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    area = abs(np.linalg.det(step[:dimension, :dimension]))
    volume = area * (thickness if dimension < 3 else 1.0)
    body = Body(
        s @ step,
        volume,
        density,
        horizon,
        cell=Cell(step * counts[:, None], periodic=within),
        dimension=dimension,
        **({"plane": plane, "thickness": thickness} if dimension < 3 else {}),
        spacing=area ** (1 / dimension),
        warn=False,
    )
    out = np.zeros((6, 6))
    for v in range(6) if components is None else components:
        stress = []
        for sign in (1, -1):
            f = Simulation(body, material, strain=sign * strain * unit_strain(v), threads=1).bond_forces()
            virial = -np.einsum("bi,bj->ij", f.r_bc, f.F_bc) / (volume * len(body))
            stress.append(to_voigt(0.5 * (virial + virial.T)))
        out[:, v] = (stress[0] - stress[1]) / (2 * strain)
    return out


def lattice_error(material, body) -> float:
    """The largest difference of the elastic constants that a square lattice of a body's spacing and horizon has from
    those that an isotropic material means to have, relative to the largest of these."""
    d = body.dimension
    lam, mu = material.lame(body)
    columns = [0] if d == 1 else [0, 5]
    C = sampled_constants(
        material,
        body.spacing * np.eye(3),
        body.horizon,
        float(body.rho_n.mean()),
        dimension=d,
        plane=body.plane,
        thickness=body.thickness,
        components=columns,
    )
    found = [C[0, 0]] if d == 1 else [C[0, 0], C[1, 0], C[5, 5]]
    return float(np.abs(np.subtract(found, [lam + 2 * mu, lam, mu][: len(found)])).max() / (lam + 2 * mu))
