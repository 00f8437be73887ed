"""How well nodes sample a kernel: the stiffness of long waves in their sum against that in its integral."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning

#: How far the moduli of nodes may be from those of the kernel they sample: beyond the first a warning, beyond the
#: second an error.
MODULI_WARN, MODULI_REFUSE = 0.02, 0.10


def long_waves(dynamical_matrix, model) -> np.ndarray:
    """(3 directions, 3) stiffness of long waves along [100], [110], [111] by nodes' D(k), over that of the kernel they
    sample, branches ascending; NaN where the kernel has none."""
    k = 1e-3 * 2 * np.pi / np.linalg.norm(model.crystal.conventional[0])
    e = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1]]) / np.sqrt([[1], [2], [3]])
    a, b = (np.linalg.eigvalsh(D(k * e)) for D in (dynamical_matrix, model.dynamical_matrix))
    return a / np.where(b > 0, b, np.nan)


def check_moduli(dynamical_matrix, model, spacing) -> None:
    """Warn where the stiffness of long waves that nodes have, by their D(k), is 2 % off the kernel's they sample;
    raise AtcError where it is 10 % off."""
    off = long_waves(dynamical_matrix, model)
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
