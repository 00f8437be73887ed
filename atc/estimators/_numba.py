"""Bare kernels of the estimators: arrays only."""

from math import sqrt

from ..compiled import njit

#: Of a difference of two products, over their sizes.
ROUNDING = 1e-14


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


@njit(cache=True, nogil=True, error_model="numpy")
def scatter_moment(i, j, r_bc, F_bc, out_n9):
    """Add −½ r⊗F (row-major) of every bond to both its ends."""
    for b in range(len(F_bc)):
        p = i[b]
        q = j[b]
        for c in range(3):
            h = -0.5 * r_bc[b, c]
            for k in range(3):
                t = h * F_bc[b, k]
                out_n9[p, 3 * c + k] += t
                out_n9[q, 3 * c + k] += t


@njit(cache=True, nogil=True, error_model="numpy")
def put_moment(r_bc, F_bc, at, out_bk):
    """−r⊗F in columns at .. at+8, as `tensors.general` takes it. What is across the bond by rounding alone is 0: such
    bonds cost a deposit less."""
    for b in range(len(F_bc)):
        x, y, z = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        f, g, h = F_bc[b, 0], F_bc[b, 1], F_bc[b, 2]
        out_bk[b, at], out_bk[b, at + 1], out_bk[b, at + 2] = -x * f, -y * g, -z * h
        for k, p, q in ((3, -y * h, -z * g), (4, -x * h, -z * f), (5, -x * g, -y * f)):
            out_bk[b, at + k] = 0.5 * (p + q)
            out_bk[b, at + k + 3] = 0.5 * (p - q) if abs(p - q) > ROUNDING * (abs(p) + abs(q)) else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def scatter_residual(i, j, F_bc, D_bdc, out_n4):
    """What the bonds' z = −F + ∂U^(i)/∂x_j − ∂U^(j)/∂x_i adds up to at every atom, F the force on i: ∇·(r β) = φ_j −
    φ_i, so −z goes to i and +z to j.

    The fourth column is Σ |F|, the size of what cancels.
    """
    for b in range(len(F_bc)):
        p = i[b]
        q = j[b]
        square = 0.0
        for c in range(3):
            f = -F_bc[b, c]
            z = f + D_bdc[b, 0, c] - D_bdc[b, 1, c]
            out_n4[p, c] -= z
            out_n4[q, c] += z
            square += f * f
        out_n4[p, 3] += sqrt(square)
        out_n4[q, 3] += sqrt(square)


@njit(cache=True, nogil=True, error_model="numpy")
def _power(b, p, q, D_bdc, P_b, v_nc):
    """v_q·∂U^(p)/∂x_q − v_p·∂U^(q)/∂x_p of bond b between atoms p and q, and what messages carry from q to p."""
    power = P_b[b] if len(P_b) else 0.0
    for c in range(3):
        power += v_nc[q, c] * D_bdc[b, 0, c] - v_nc[p, c] * D_bdc[b, 1, c]
    return power


@njit(cache=True, nogil=True, error_model="numpy")
def put_power(i, j, r_bc, D_bdc, P_b, v_nc, at, out_bk):
    """(v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i + P) r in columns at .. at+2: both ordered pairs of the bond (A of formulas.md
    §4)."""
    for b in range(len(r_bc)):
        power = _power(b, i[b], j[b], D_bdc, P_b, v_nc)
        for c in range(3):
            out_bk[b, at + c] = power * r_bc[b, c]


@njit(cache=True, nogil=True, error_model="numpy")
def put_sources(r_bc, D_bdc, at, out_bk):
    """r⊗(∂U^(i)/∂x_j − ∂U^(j)/∂x_i) in columns at .. at+8, row-major: both ordered pairs of the bond (M of formulas.md
    §4)."""
    for b in range(len(r_bc)):
        for k in range(3):
            d = D_bdc[b, 0, k] - D_bdc[b, 1, k]
            for c in range(3):
                out_bk[b, at + 3 * c + k] = r_bc[b, c] * d


@njit(cache=True, nogil=True, error_model="numpy")
def add_power(i, j, r_bc, D_bdc, P_b, v_nc, out_c):
    """Add Σ_b (v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i + P) r over all bonds."""
    x = y = z = 0.0
    for b in range(len(r_bc)):
        power = _power(b, i[b], j[b], D_bdc, P_b, v_nc)
        x += power * r_bc[b, 0]
        y += power * r_bc[b, 1]
        z += power * r_bc[b, 2]
    out_c[0] += x
    out_c[1] += y
    out_c[2] += z
