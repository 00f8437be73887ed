"""Energies of atoms that are functions of the bispectrum of their neighbours, and their gradients by the vectors to
them.

Four atoms are done together, lane by lane, and of each atom four edges at a time: everything is straight arithmetic of
`vec4`. For each edge U(a, b) is made twice, once for the density u of its atom, once more with the derivative of the
energy by u (Y) in hand, of which the derivatives by a and b follow row by row backwards: the forces cost about three
times what U does, whatever the number of components (compare Gayatri et al., arXiv:2011.12875).
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...simd import JIT_FMA, address, load4, splat4, store4, sum4

_PI = np.pi
#: Places in front of U, where l − 1 of the first row points.
FRONT = 1


@njit(cache=True, nogil=True, error_model="numpy")
def switch(d, rc, inner, half, params):
    """f_c f_inner of a distance and its derivative. params : rmin0, whether to switch at r_c, and at the inside."""
    rmin = params[0]
    f, df = 1.0, 0.0
    if params[1] > 0.0 and d > rmin:
        c = _PI / (rc - rmin)
        f, df = 0.5 + 0.5 * np.cos(c * (d - rmin)), -0.5 * c * np.sin(c * (d - rmin))
    if params[2] > 0.0 and d < inner + half:
        if d <= inner - half:
            return 0.0, 0.0
        c = 0.5 * _PI / half
        angle = c * (d - inner + half)
        g, dg = 0.5 - 0.5 * np.cos(angle), 0.5 * c * np.sin(angle)
        f, df = f * g, df * g + f * dg
    return f, df


@njit(**JIT_FMA)
def _four(ab_k, U_k, R_out, R_from, R_n, R_middle, p, q):
    """The rows of U of four edges from their a and b."""
    ab, U = address(ab_k), address(U_k) + 64 * FRONT
    ar, ai, br, bi = load4(ab, 0), load4(ab, 4), load4(ab, 8), load4(ab, 12)
    zero = splat4(0.0)
    store4(U, 0, splat4(1.0))
    store4(U, 4, zero)
    for row in range(len(R_out)):
        o, f = R_out[row], R_from[row]
        if R_middle[row]:
            xr, xi, yr, yi = br, bi, ar, ai
        else:
            xr, xi, yr, yi = ar, zero - ai, zero - br, bi
        for l in range(R_n[row] + 1):
            at = 8 * (f + l)
            pr, pi, qr, qi = load4(U, at), load4(U, at + 4), load4(U, at - 8), load4(U, at - 4)
            cp, cq = p[o + l], q[o + l]
            store4(U, 8 * (o + l), cp * (xr * pr - xi * pi) + cq * (yr * qr - yi * qi))
            store4(U, 8 * (o + l) + 4, cp * (xr * pi + xi * pr) + cq * (yr * qi + yi * qr))


@njit(**JIT_FMA)
def _gather(U_k, by, R_out, R_n, u, lane):
    """u += Σ over four edges of weight times U, rows 2k ≤ n."""
    U, w = address(U_k) + 64 * FRONT, load4(address(by), 0)
    u[0, lane] += sum4(w)
    for row in range(len(R_out)):
        for at in range(R_out[row], R_out[row] + R_n[row] + 1):
            u[2 * at, lane] += sum4(w * load4(U, 8 * at))
            u[2 * at + 1, lane] += sum4(w * load4(U, 8 * at + 4))


@njit(**JIT_FMA)
def _back(ab_k, U_k, V_k, Y, lane, R_out, R_from, R_n, R_middle, p, q, back):
    """Of Re Σ Y* U of four edges: itself, and its derivatives by Re a, Im a, Re b, Im b, into back."""
    ab, U, V, out = address(ab_k), address(U_k) + 64 * FRONT, address(V_k) + 64 * FRONT, address(back)
    ar, ai, br, bi = load4(ab, 0), load4(ab, 4), load4(ab, 8), load4(ab, 12)
    zero = splat4(0.0)
    for row in range(len(R_out)):
        for at in range(R_out[row], R_out[row] + R_n[row] + 1):
            store4(V, 8 * at, splat4(Y[2 * at, lane]))
            store4(V, 8 * at + 4, splat4(Y[2 * at + 1, lane]))
    value = splat4(Y[0, lane])
    gar, gai, gbr, gbi = zero, zero, zero, zero
    for row in range(len(R_out) - 1, -1, -1):
        o, f = R_out[row], R_from[row]
        if R_middle[row]:
            xr, xi, yr, yi = br, bi, ar, ai
        else:
            xr, xi, yr, yi = ar, zero - ai, zero - br, bi
        hxr, hxi, hyr, hyi = zero, zero, zero, zero
        for l in range(R_n[row] + 1):
            at = 8 * (o + l)
            vr, vi = load4(V, at), load4(V, at + 4)
            yy_r, yy_i = Y[2 * (o + l), lane], Y[2 * (o + l) + 1, lane]
            value = value + yy_r * load4(U, at) + yy_i * load4(U, at + 4)
            cp, cq = p[o + l], q[o + l]
            at = 8 * (f + l)
            tr, ti = cp * vr, cp * vi
            pr, pi = load4(U, at), load4(U, at + 4)
            hxr = hxr + tr * pr + ti * pi
            hxi = hxi + ti * pr - tr * pi
            store4(V, at, load4(V, at) + xr * tr + xi * ti)
            store4(V, at + 4, load4(V, at + 4) + xr * ti - xi * tr)
            tr, ti = cq * vr, cq * vi
            qr, qi = load4(U, at - 8), load4(U, at - 4)
            hyr = hyr + tr * qr + ti * qi
            hyi = hyi + ti * qr - tr * qi
            store4(V, at - 8, load4(V, at - 8) + yr * tr + yi * ti)
            store4(V, at - 4, load4(V, at - 4) + yr * ti - yi * tr)
        if R_middle[row]:
            gbr, gbi, gar, gai = gbr + hxr, gbi + hxi, gar + hyr, gai + hyi
        else:
            gar, gai, gbr, gbi = gar + hxr, gai - hxi, gbr - hyr, gbi + hyi
    store4(out, 0, value)
    store4(out, 4, gar)
    store4(out, 8, gai)
    store4(out, 12, gbr)
    store4(out, 16, gbi)


@njit(**JIT_FMA)
def _products(first, last, a, b, C, u_a, u_b):
    """Σ C u_a u_b of four atoms; u_a, u_b : where their densities begin."""
    zr = zi = splat4(0.0)
    for t in range(first, last):
        at_a, at_b, c = 8 * a[t], 8 * b[t], C[t]
        ar, ai, br, bi = load4(u_a, at_a), load4(u_a, at_a + 4), load4(u_b, at_b), load4(u_b, at_b + 4)
        ar, ai = c * ar, c * ai
        zr = zr + ar * br - ai * bi
        zi = zi + ar * bi + ai * br
    return zr, zi


@njit(**JIT_FMA)
def bispectrum(component, role, out, own, first, a, b, C, factors, channels, size, u, B):
    """B (components, 4) of four atoms from u (channels, 2 size, 4), all rows."""
    count = component[-1] + 1
    B[:] = 0.0
    at_B, at_u = address(B), address(u)
    which = np.empty(3, np.int64)
    for label in range(channels**3):
        which[0], which[1], which[2] = label // (channels * channels), label // channels % channels, label % channels
        for s in range(len(out)):
            if own[s] == 0.0:
                continue
            f = factors[role[s]]
            zr, zi = _products(
                first[s], first[s + 1], a, b, C, at_u + 64 * size * which[f[0]], at_u + 64 * size * which[f[1]]
            )
            u_o = at_u + 64 * size * which[f[2]]
            z = own[s] * (load4(u_o, 8 * out[s]) * zr + load4(u_o, 8 * out[s] + 4) * zi)
            k = 4 * (label * count + component[s])
            store4(at_B, k, load4(at_B, k) + z)


@njit(**JIT_FMA)
def adjoint(component, role, out, weight, first, a, b, C, factors, channels, size, u, beta, Y):
    """Y (channels, 2 size, 4) = Σ beta ∂B/∂u* of four atoms, what counts twice twice; beta (components, 4)."""
    count = component[-1] + 1
    Y[:] = 0.0
    at_beta, at_u, at_Y = address(beta), address(u), address(Y)
    which = np.empty(3, np.int64)
    for label in range(channels**3):
        which[0], which[1], which[2] = label // (channels * channels), label // channels % channels, label % channels
        for s in range(len(out)):
            f = factors[role[s]]
            zr, zi = _products(
                first[s], first[s + 1], a, b, C, at_u + 64 * size * which[f[0]], at_u + 64 * size * which[f[1]]
            )
            w = weight[s] * load4(at_beta, 4 * (label * count + component[s]))
            to, k = at_Y + 64 * size * which[f[2]], 8 * out[s]
            store4(to, k, load4(to, k) + w * zr)
            store4(to, k + 4, load4(to, k + 4) + w * zi)


@njit(cache=True, nogil=True, error_model="numpy")
def centres(s0, s1, most, near, density, rows, mirror, table, factors, channels, expansion, units, g_end, energies):
    """U of the atoms s0..s1; into g_end[pair, side] the gradient of the energy of the atom at that side by the vector
    from it to the other one.

    density : radius, share, inner, half (t,): R, w, and where the inner switch is; factor: rcutfac; theta: rfac0;
        params; wide
    params : rmin0, whether to switch at r_c, and at the inside. wide : whether all densities have their atom in them
    rows, mirror, table : see `snap_tables`. expansion : constant (t,), beta (t, k), alpha (t, k, k) or (t, 0, 0), B0
        (t, k). units : length and energy of the file
    """
    start, pair, end, pair_a, pair_b, r, d, element, atom = near
    radius, share, inner, half, factor, theta, params, wide = density
    R_out, R_from, R_n, R_middle, p, q = rows
    mirror_to, mirror_from, mirror_sign = mirror
    component, role, out, weight, own, first, a, b, C = table
    (constant, beta, alpha, B0), (length, energy) = expansion, units
    size = len(p)
    count = beta.shape[1]
    quadratic = alpha.shape[1] > 0
    groups = most // 4 + 1 + channels
    U, V = np.zeros(8 * (size + FRONT)), np.zeros(8 * (size + FRONT))
    u, Y = np.zeros((channels, 2 * size, 4)), np.zeros((channels, 2 * size, 4))
    B, slope = np.zeros((count, 4)), np.zeros((count, 4))
    ab, by, back = np.zeros((4, groups, 16)), np.zeros((4, groups, 4)), np.zeros(20)
    n_c, far = np.zeros((4, groups, 4, 3)), np.ones((4, groups, 4))
    dby, turn = np.zeros((4, groups, 4)), np.zeros((4, groups, 4))
    slot, channel, filled = np.zeros((4, groups, 4), np.int64), np.zeros((4, groups), np.int64), np.zeros(4, np.int64)
    value = np.zeros(4)
    total = 0.0
    for s in range(s0, s1, 4):
        lanes = min(4, s1 - s)
        u[:] = 0.0
        slope[:] = 0.0
        for lane in range(lanes):
            es = element[s + lane]
            # Edges, by the density that they belong to, four together.
            g, k = -1, 4
            for c in range(channels):
                k = 4
                for e in range(start[s + lane], start[s + lane + 1]):
                    side = end[e]
                    o = element[pair_b[pair[e]] if side == 0 else pair_a[pair[e]]]
                    if channels > 1 and o != c:
                        continue
                    x = d[pair[e]] / length
                    rc = factor * (radius[es] + radius[o])
                    if x >= rc:
                        continue
                    if k == 4:
                        g, k = g + 1, 0
                        channel[lane, g] = c
                        by[lane, g] = 0.0
                        dby[lane, g] = 0.0
                        ab[lane, g] = 0.0
                        slot[lane, g] = -1
                    f, df = switch(x, rc, 0.5 * (inner[es] + inner[o]), 0.5 * (half[es] + half[o]), params)
                    turn[lane, g, k] = theta * _PI / (rc - params[0])
                    angle = turn[lane, g, k] * (x - params[0])
                    if angle < 0.0:
                        # As LAMMPS does: sin θ counts as positive.
                        angle += _PI
                    sine, sign = np.sin(angle), -1.0 if side == 0 else 1.0
                    for i in range(3):
                        n_c[lane, g, k, i] = sign * r[pair[e], i] / (length * x)
                    far[lane, g, k] = x
                    ab[lane, g, k] = np.cos(angle)
                    ab[lane, g, 4 + k] = -sine * n_c[lane, g, k, 2]
                    ab[lane, g, 8 + k] = -sine * n_c[lane, g, k, 1]
                    ab[lane, g, 12 + k] = -sine * n_c[lane, g, k, 0]
                    by[lane, g, k], dby[lane, g, k] = share[o] * f, share[o] * df
                    slot[lane, g, k] = 2 * pair[e] + side
                    k += 1
            filled[lane] = g + 1
            for g in range(filled[lane]):
                _four(ab[lane, g], U, R_out, R_from, R_n, R_middle, p, q)
                _gather(U, by[lane, g], R_out, R_n, u[channel[lane, g]], lane)
            for c in range(channels):
                if channels > 1 and c != es and not wide:
                    continue
                # The atom itself: U of no rotation.
                u[c, 0, lane] += 1.0
                for row in range(len(R_out)):
                    n = R_n[row]
                    k = (R_out[row] - n * (n + 1) * (2 * n + 1) // 6) // (n + 1)
                    u[c, 2 * (R_out[row] + k), lane] += 1.0
        for c in range(channels):
            for t in range(len(mirror_to)):
                to, of, sign = 2 * mirror_to[t], 2 * mirror_from[t], mirror_sign[t]
                for lane in range(4):
                    u[c, to, lane] = sign * u[c, of, lane]
                    u[c, to + 1, lane] = -sign * u[c, of + 1, lane]
        value[:] = 0.0
        if quadratic:
            bispectrum(component, role, out, own, first, a, b, C, factors, channels, size, u, B)
        for lane in range(lanes):
            es = element[s + lane]
            value[lane] = constant[es]
            for k in range(count):
                slope[k, lane] = beta[es, k]
            if quadratic:
                for k in range(count):
                    B[k, lane] -= B0[es, k]
                for k in range(count):
                    x = 0.0
                    for m in range(count):
                        x += alpha[es, k, m] * B[m, lane]
                    value[lane] += B[k, lane] * (beta[es, k] + 0.5 * x)
                    slope[k, lane] += x
        adjoint(component, role, out, weight, first, a, b, C, factors, channels, size, u, slope, Y)
        if not quadratic:
            # B is of third degree in u: 3 Σ beta B = Re Σ Y* u.
            for c in range(channels):
                for t in range(2 * size):
                    for lane in range(lanes):
                        value[lane] += Y[c, t, lane] * u[c, t, lane] / 3.0
        for lane in range(lanes):
            total += value[lane] * energy
            if len(energies):
                energies[atom[s + lane]] += value[lane] * energy
            for g in range(filled[lane]):
                _four(ab[lane, g], U, R_out, R_from, R_n, R_middle, p, q)
                _back(ab[lane, g], U, V, Y[channel[lane, g]], lane, R_out, R_from, R_n, R_middle, p, q, back)
                for k in range(4):
                    if slot[lane, g, k] < 0:
                        continue
                    cosine = ab[lane, g, k]
                    nx, ny, nz = n_c[lane, g, k, 0], n_c[lane, g, k, 1], n_c[lane, g, k, 2]
                    sine = -(nz * ab[lane, g, 4 + k] + ny * ab[lane, g, 8 + k] + nx * ab[lane, g, 12 + k])
                    gar, gai, gbr, gbi = back[4 + k], back[8 + k], back[12 + k], back[16 + k]
                    w = by[lane, g, k]
                    by_angle = -sine * gar - cosine * (nz * gai + ny * gbr + nx * gbi)
                    along = w * turn[lane, g, k] * by_angle + dby[lane, g, k] * back[k]
                    z = w * sine / far[lane, g, k]
                    tx, ty, tz = -z * gbi, -z * gbr, -z * gai
                    along -= tx * nx + ty * ny + tz * nz
                    i, side = slot[lane, g, k] // 2, slot[lane, g, k] % 2
                    g_end[i, side, 0] = (along * nx + tx) * (energy / length)
                    g_end[i, side, 1] = (along * ny + ty) * (energy / length)
                    g_end[i, side, 2] = (along * nz + tz) * (energy / length)
    return total
