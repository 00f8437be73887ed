"""What both sides do at the nodes themselves, and the classical wave equation from the same start."""

from __future__ import annotations

import numpy as np

from ..pd.voigt import tensor_of
from .smoothing import Same


def classical_waves(tensor, density, cell, counts, u_nc, v_nc, times) -> np.ndarray:
    """(t, n, 3) displacements of the classical wave equation ρ ü_i = C_ijkl ∂_j ∂_l u_k in a periodic body, exactly for
    every wave that its nodes have.

    Parameters
    ----------
    tensor : (3, 3, 3, 3) C_ijkl. density : ρ
    counts : nodes along the cell's edges; nodes in C order
    u_nc, v_nc : displacement and velocity at time 0
    """
    shape = (*counts, 3)
    k = np.stack(np.meshgrid(*(np.fft.fftfreq(n) * n for n in counts), indexing="ij"), axis=-1)
    k_gc = 2 * np.pi * k @ cell.inverse.T
    A = np.einsum("ijkl,...j,...l->...ik", tensor, k_gc, k_gc) / density
    w2, e = np.linalg.eigh(0.5 * (A + np.swapaxes(A, -1, -2)))
    w = np.sqrt(np.maximum(w2, 0.0))
    project = lambda a: np.einsum(  # noqa: E731
        "...im,...i->...m", e, np.fft.fftn(a.reshape(shape), axes=(0, 1, 2))
    )
    u, v = project(u_nc), project(v_nc)
    out = []
    for t in times:
        q = u * np.cos(w * t) + v * t * np.sinc(w * t / np.pi)
        out.append(np.fft.ifftn(np.einsum("...im,...m->...i", e, q), axes=(0, 1, 2)).real.reshape(-1, 3))
    return np.array(out)


def add_nodes(data, units, made, md_tnc, pd_tnc, classical_tnc=None) -> None:
    """Displacements at the nodes into a dataset: smoothed once (MD), as they are (PD), and those of the classical wave
    equation where there is one."""
    length = {"units": units.label("length")}
    data["node_position"] = (("node", "i"), units.to_user("length", made.body.X_nc), length)
    for side, u_tnc, what in (
        ("md", md_tnc, "smoothed displacement of the atoms at the nodes"),
        ("pd", pd_tnc, "displacement of the nodes"),
        ("classical", classical_tnc, "displacement by the classical wave equation with the crystal's constants"),
    ):
        if u_tnc is not None:
            attrs = {**length, "long_name": what}
            data[f"{side}_node_displacement"] = (
                ("frame", "node", "i"),
                units.to_user("length", np.array(u_tnc)),
                attrs,
            )


def nodes_line(data) -> str:
    """How far the twin and the classical equation are from the run at the nodes, for a person: rms over nodes and the
    frames behind the first, in which all are the same."""
    md, pd, classical = (data[f"{s}_node_displacement"].values[1:] for s in ("md", "pd", "classical"))
    rms = lambda v: float(np.sqrt(np.mean(v**2)))  # noqa: E731
    size = rms(md)
    off = lambda v: f"{100 * rms(v - md) / size:.3g} %" if size > 0 else f"{rms(v - md):.3g}"  # noqa: E731
    return (
        f"at the nodes: displacement of the twin {off(pd)} of the MD's off (rms, frames behind the first), by the "
        f"classical wave equation {off(classical)}"
    )


def classical_of(made, material, reference, frames, times, u_nc, acted: bool):
    """The classical waves from the run's first frame, or None where the body is not one whole periodic lattice that
    nothing holds or pushes."""
    cell = reference.cell
    counts = np.rint(np.linalg.norm(cell.vectors, axis=1) / np.linalg.norm(made.step_cc, axis=1)).astype(int)
    lattice = not isinstance(made.smoothing, Same) and len(made.body) == counts.prod()
    whole = cell.periodic.all() and lattice and len(frames) > 1
    C = material.crystal_vv
    if acted or not whole or C is None or any(f.cell != cell for f in frames):
        return None
    v_nc = made.smoothing.mean(frames[0].velocities)
    return classical_waves(tensor_of(C), made.density, cell, counts, u_nc, v_nc, times)
