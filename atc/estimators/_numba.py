"""Bare kernels of the estimators: arrays only."""

from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def scatter_virial(i, j, r_bc, G_b, out_n6):
    """Add ½ G r⊗r (xx, yy, zz, yz, xz, xy) of every bond to both its ends."""
    for b in range(len(G_b)):
        h = 0.5 * G_b[b]
        x = r_bc[b, 0]
        y = r_bc[b, 1]
        z = r_bc[b, 2]
        p = i[b]
        q = j[b]
        t = h * x * x
        out_n6[p, 0] += t
        out_n6[q, 0] += t
        t = h * y * y
        out_n6[p, 1] += t
        out_n6[q, 1] += t
        t = h * z * z
        out_n6[p, 2] += t
        out_n6[q, 2] += t
        t = h * y * z
        out_n6[p, 3] += t
        out_n6[q, 3] += t
        t = h * x * z
        out_n6[p, 4] += t
        out_n6[q, 4] += t
        t = h * x * y
        out_n6[p, 5] += t
        out_n6[q, 5] += t
