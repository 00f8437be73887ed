"""Stress and energy current of the smooth part: modes on the wave vectors Q of the smoothed field, before smoothing,
from products of fields on a mesh.

Charges smeared with e^{−s τ k²/2} are ρ_τ. Φ_τ = (4πC/k²) ρ_τ, E_τ = −∇Φ_τ, c = 4πC:

    σ = (1/c)(E₁⊗E₁ − ½E₁² 1) − (s/2) ∫₀¹ dt [E_{2−t}⊗∇ρ_t + ∇ρ_t⊗E_{2−t} − 1 ∇·(ρ_t E_{2−t})]

With currents J_τ smeared alike, W_τ = (c/k²) J_τ without its mean, and [v, W] = −v×(∇×W) − (∇·W) v:

    A = ½ { (1/c)[∇Φ₁, W₁] + (s/2) ∫₀¹ dt ( [∇ρ_t, W_{2−t}] − c ρ_t J_{2−t} + [∇Φ_{2−t}, J_t] − c ρ_{2−t} J_t ) } + ½
    <J> Φ₂

Both are the sums over pairs of modes of the package's docstring, (1/2V) Σ K_µν J_ν(a) ρ(b) the second. The integrals
are Gauss-Legendre's, whose error falls like that of a spectral method. A mesh of n ≥ 2(m_a + m_Q) nodes along an axis
confuses no modes that matter: those of the charges go up to m_a + m_Q, the field's up to m_Q.
"""

from __future__ import annotations

from itertools import chain
from math import pi, sqrt

import numpy as np

from ...errors import AtcError
from .sheet import Sheet
from .transform import Transform, box_modes, good_length, largest_of, wave_vectors

# Components of symmetric tensors.
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
# Real arrays on the mesh that there are at the same time, and the bytes that they may take.
ARRAYS, LARGEST = 16, 6.0e9
# Bytes of the planes of the mesh that products are taken on at a time: about what a cache holds.
PART = 2.0**24
#: Tolerances of fields from which on their products may be in single precision: smoothing averages what it rounds.
SINGLE = 1e-5
MOST_NODES = 24
#: Steps in κ up to which the modes of kernels that jump are looked at.
LAST_MODE = 60_000


class Products:
    """The fields of one frame on a mesh that is fine enough for the products' modes up to `largest_q`.

    Parameters
    ----------
    term : LongRangeCoulomb
    frame : Frame
    largest_q : (3,) largest mode numbers of the products
    tolerance : what of the smooth part may be left out
    nodes : of the integrals
    wide : > 1 for a mesh that is finer than it has to be
    single : fields and transforms in single precision
    charges : whether their modes are wanted
    """

    def __init__(
        self,
        term,
        frame,
        largest_q,
        tolerance: float,
        nodes: int,
        threads: int = 1,
        wide: float = 1.0,
        single: bool = False,
        charges: bool = True,
    ):
        self.term, self.frame, self.nodes, self.threads = term, frame, nodes, threads
        self.vectors, self.origin = term.box(frame)
        self.volume = abs(float(np.linalg.det(self.vectors)))
        split = term.split
        self.s = split.s
        self.real, self.complex = (np.float32, np.complex64) if single else (np.float64, np.complex128)
        self.counts, largest = mesh_of(self.vectors, split, largest_q, tolerance, wide, np.dtype(self.real).itemsize)
        self.transform = Transform(self.vectors, self.origin, largest, max(0.02 * tolerance, 1e-13), threads)
        self.index, self.q_index = self.transform.index, box_modes(largest_q)
        k_c = wave_vectors(self.index, self.vectors)
        k2 = sum(k * k for k in k_c)
        self.k_c, self.k2 = [k.astype(self.real) for k in k_c], k2.astype(self.real)
        if charges:
            self.c = 4 * pi * split.constant
            with np.errstate(divide="ignore"):
                self.potential = np.where(k2 > 0, self.c / k2, 0.0).astype(self.real)
            self.rho = self.transform.modes(frame.positions, frame.charges[:, None])[0].astype(self.complex)
            self.rho[0, 0, 0] = 0.0
        x, w = np.polynomial.legendre.leggauss(nodes)
        self.rule = [(float(t), float(weight)) for t, weight in zip(0.5 * (1.0 + x), 0.5 * w)]

    # --- the mesh
    def _real(self, F):
        """The field on the mesh from its modes."""
        from scipy import fft

        n0, n1, n2 = (int(n) for n in self.counts)
        G = np.zeros((n0, F.shape[1], F.shape[2]), self.complex)
        G[self.index[0]] = F
        G = fft.ifft(G, axis=0, norm="forward", overwrite_x=True, workers=self.threads)
        H = np.zeros((n0, n1, F.shape[2]), self.complex)
        H[:, self.index[1]] = G
        H = fft.ifft(H, axis=1, norm="forward", overwrite_x=True, workers=self.threads)
        out = fft.irfft(H, n=n2, axis=2, norm="forward", workers=self.threads)
        out /= self.volume
        return out

    def _modes(self, f):
        """Modes Q of a field on the mesh, ∫ f e^{−iQ·x}."""
        from scipy import fft

        F = fft.rfft(f, axis=2, norm="forward", workers=self.threads)[:, :, self.q_index[2]]
        F = fft.fft(F, axis=1, norm="forward", workers=self.threads)[:, self.q_index[1]]
        F = fft.fft(F, axis=0, norm="forward", workers=self.threads)[self.q_index[0]]
        return F.astype(complex) * self.volume

    def _products(self, fields, form, n: int) -> np.ndarray:
        """(n, q0, q1, q2) the modes of the n products that `form` makes of fields on the mesh, a few planes of it at a
        time: there is never a whole field on it.

        fields : iterable of (modes, what): "f" for the field, "g" for its gradient, "gf" for this and that
        form : (f, planes, n1, n2), the fields in their order -> iterable of n (planes, n1, n2)
        """
        from scipy import fft

        n0, n1, n2 = (int(n) for n in self.counts)
        index, q, b = self.index, self.q_index, 2 * pi * np.linalg.inv(self.vectors)
        number = index[0][:, None, None].astype(self.real)
        # Wave vectors but for their share along the first axis, whose derivative there is a transform of its own.
        across = [(b[c, 1] * index[1][:, None] + b[c, 2] * index[2]).astype(self.real) for c in range(3)]

        def first(F):
            G = np.zeros((n0, *F.shape[1:]), self.complex)
            G[index[0]] = F
            return fft.ifft(G, axis=0, norm="forward", overwrite_x=True, workers=self.threads)

        G_f = [(first(F), first(number * F) if "g" in what else None, what) for F, what in fields]
        count = sum(3 * ("g" in what) + ("f" in what) for *_, what in G_f)
        out = np.empty((n, n0, len(q[1]), len(q[2])), self.complex)
        step = max(1, int(PART / (np.dtype(self.complex).itemsize * count * n1 * n2)))
        for planes in (slice(k, min(k + step, n0)) for k in range(0, n0, step)):
            H = np.zeros((count, planes.stop - planes.start, n1, len(index[2])), self.complex)
            to = iter(H)
            for G, slope, what in G_f:
                for c in range(3 if "g" in what else 0):
                    next(to)[:, index[1]] = 1j * (float(b[c, 0]) * slope[planes] + across[c] * G[planes])
                if "f" in what:
                    next(to)[:, index[1]] = G[planes]
            H = fft.ifft(H, axis=2, norm="forward", overwrite_x=True, workers=self.threads)
            f = fft.irfft(H, n=n2, axis=3, norm="forward", workers=self.threads)
            f /= self.volume
            for found, part in zip(out, form(f)):
                F = fft.rfft(part, axis=2, norm="forward", workers=self.threads)[:, :, q[2]]
                found[planes] = fft.fft(F, axis=1, norm="forward", workers=self.threads)[:, q[1]]
        del G_f
        return fft.fft(out, axis=1, norm="forward", workers=self.threads)[:, q[0]].astype(complex) * self.volume

    def _smear(self, tau):
        return np.exp(-0.5 * self.s * tau * self.k2)

    def _gradient(self, F):
        return [self._real(1j * k * F) for k in self.k_c]

    # --- stress
    def stress(self) -> np.ndarray:
        """(6, q0, q1, q2) xx, yy, zz, yz, xz, xy; tension positive, energy."""

        def maxwell(E):
            trace = -0.5 * (E * E).sum(0)
            for a, b in PAIRS:
                part = E[a] * E[b]
                if a == b:
                    part += trace
                yield part

        modes = self._products([(-self.potential * self._smear(1.0) * self.rho, "g")], maxwell, 6) / self.c
        for t, weight in self.rule:

            def smeared(f):
                E, wide, slope, rho = f[:3], f[3], f[4:7], f[7]
                # ∇·E = c ρ, but for the mean of ρ, which is 0.
                trace = self.c * rho * wide + (E * slope).sum(0)
                for a, b in PAIRS:
                    part = E[a] * slope[b]
                    part += part if a == b else E[b] * slope[a]
                    if a == b:
                        part -= trace
                    yield part

            wide = self._smear(2.0 - t) * self.rho
            fields = (-self.potential * wide, "g"), (wide, "f"), (self._smear(t) * self.rho, "gf")
            modes -= (0.5 * self.s * weight) * self._products(fields, smeared, 6)
        E0 = self.term.bare_field(self.frame)
        if E0:
            self._add_slab(modes, E0)
        return modes

    def _pick(self):
        """The places of the products' modes among those of the charges."""
        at = [np.searchsorted(np.sort(i), q) for i, q in zip(self.index, self.q_index)]
        order = [np.argsort(i) for i in self.index]
        return np.ix_(*(o[a] for o, a in zip(order, at)))

    def _add_slab(self, modes, E0):
        """The slab's uniform field with the charges' own, and with itself."""
        m0, m1, m2 = (len(i) for i in self.q_index)
        pick = self._pick()
        k_c = wave_vectors(self.q_index, self.vectors)
        E = [-1j * k * self.potential[pick] * self.rho[pick] for k in k_c]
        for c, (a, b) in enumerate(PAIRS):
            part = np.zeros((m0, m1, m2), complex)
            if b == 2:
                part += E0 * E[a]
            if a == 2:
                part += E0 * E[b]
            if a == b:
                part -= E0 * E[2]
            modes[c] += part / self.c
        own = 0.5 * E0 * E0 / self.c * self.volume
        modes[:3, 0, 0, 0] += own * np.array([-1.0, -1.0, 1.0])

    # --- energy current
    def current(self, v_nc) -> np.ndarray:
        """(3, q0, q1, q2) A for charges that move with v (n, 3)."""
        J = self.transform.modes(self.frame.positions, self.frame.charges[:, None] * v_nc).astype(self.complex)
        mean = J[:, 0, 0, 0].real.copy()
        J[:, 0, 0, 0] = 0.0
        k = self.k_c

        def curl(f):
            """−v×(∇×W) − (∇·W) v of v (3), ∇×W (3) and ∇·W."""
            v, w, div = f[:3], f[3:6], f[6]
            for a in range(3):
                b, d = (a + 1) % 3, (a + 2) % 3
                yield v[d] * w[b] - v[b] * w[d] - div * v[a]

        def bracket(potential, W):
            """[∇potential, W], both by their modes."""
            turn = ((1j * (k[b] * W[d] - k[d] * W[b]), "f") for b, d in ((1, 2), (2, 0), (0, 1)))
            div = sum(1j * q * w for q, w in zip(k, W))
            return self._products(chain([(potential, "g")], turn, [(div, "f")]), curl, 3)

        def carried(f):
            """ρ_t J_{2−t} + ρ_{2−t} J_t."""
            return (f[0] * f[2 + a] + f[1] * f[5 + a] for a in range(3))

        g, U = self._smear(1.0), self.potential
        modes = (0.5 / self.c) * bracket(U * g * self.rho, U * g * J)
        for t, weight in self.rule:
            near, wide = self._smear(t), self._smear(2.0 - t)
            part = bracket(near * self.rho, U * wide * J) + bracket(U * wide * self.rho, near * J)
            both = (
                (g * x, "f")
                for g, x in chain(((near, self.rho), (wide, self.rho)), zip([wide] * 3 + [near] * 3, [*J, *J]))
            )
            part -= self.c * self._products(both, carried, 3)
            modes += (0.25 * self.s * weight) * part
        # Charges that all move alike: the mode of J that has no potential.
        Phi = (U * self._smear(2.0) * self.rho)[self._pick()]
        modes += (0.5 / self.volume) * mean[:, None, None, None] * Phi
        if self.term.slab is not None:
            self._add_slab_current(modes, J, v_nc)
        return modes

    def _add_slab_current(self, modes, J, v_nc):
        """The slab's potential Φ_s = −E₀ z + const with the charges' own, and with itself, in the way of `current`.

        Its vector potential is that of every charge, −(2πC/V)(z − z_j)² q_j v_j. What is left of it where the charges
        have a current along z, which would grow with z, is ½ ∂E₀/∂t Σ q_j z_j in ∇·A; it is given the potential flow
        that has this divergence. Charges that all move alike have A = −σ·v, as they must.
        """
        q_n, x_nc = self.frame.charges, self.frame.positions
        sheet = Sheet(q_n, x_nc[:, 2], self.term.split.constant, self.volume)
        pick = self._pick()
        Q_c = wave_vectors(self.q_index, self.vectors)
        U = self.potential[pick] / self.c
        E0, rate = -sheet.k * sheet.M, -sheet.k * float(q_n @ v_nc[:, 2])
        W = [U * j[pick] for j in J]
        slope = [1j * Q * U * self.rho[pick] for Q in Q_c]
        # E₀ ẑ × (∇×W) + E₀ (∇·W) ẑ = E₀ (∂_x W_z ... ): by components.
        div = sum(1j * Q * w for Q, w in zip(Q_c, W))
        for a in (0, 1):
            modes[a] += 0.5 * E0 * 1j * (Q_c[a] * W[2] - Q_c[2] * W[a])
        modes[2] += 0.5 * E0 * div
        # −∇Φ×(ẑ×P) − P_z ∇Φ, P = (4πC/V) Σ q z v.
        P = sheet.k * ((q_n * sheet.z_n) @ v_nc)
        along = sum(P[a] * slope[a] for a in range(3))
        for a in range(3):
            modes[a] += 0.5 * (P[a] * slope[2] - (along if a == 2 else 0.0) - P[2] * slope[a])
        z = self.transform.modes(x_nc, (q_n * sheet.z_n)[:, None])[0][pick]
        for a in range(3):
            modes[a] -= 0.5 * rate * 1j * Q_c[a] * U * z
        w_n6 = sheet.virials_n6()
        modes[:, 0, 0, 0] -= np.einsum("nc,nc->c", w_n6[:, :3], v_nc)


def mesh_of(vectors, split, largest_q, tolerance, wide=1.0, itemsize=8):
    """(nodes along each axis, largest modes of the charges)."""
    a = split.largest_wave(tolerance)
    m_a, m_q = largest_of(a, vectors), np.asarray(largest_q)
    # Products of two fields smeared with half of the whole reach further than m_a where Q is small.
    largest = np.maximum(m_a + m_q, largest_of(sqrt(2.0) * a, vectors))
    counts = np.array([good_length(int(np.ceil(wide * n))) for n in np.maximum(2 * (m_a + m_q), largest + m_q) + 2])
    if itemsize * ARRAYS * np.prod(counts, dtype=float) > LARGEST:
        raise AtcError(
            f"long-range Coulomb: a mesh of {' x '.join(map(str, counts))} nodes would be needed for this kernel and "
            "tolerance: take a smoother kernel (gaussian, lucy), a larger radius or a looser tolerance"
        )
    return counts, np.minimum(largest, (counts - 1) // 2)


def nodes_for(split, tolerance: float, q_max: float, hat) -> int:
    """How many Gauss-Legendre nodes keep the error of the integrals below the tolerance for modes up to q_max, weighted
    with φ̂ = hat(Q)."""
    a = split.largest_wave(tolerance)
    x_a, q = np.meshgrid(np.linspace(0.02, 1.0, 40) * a, np.linspace(0.0, 1.0, 60) * q_max, indexing="ij")
    weight = np.abs(hat(q))
    for nodes in range(2, MOST_NODES):
        t, w = np.polynomial.legendre.leggauss(nodes)
        t, w = 0.5 * (1 + t), 0.5 * w
        worst = 0.0
        for b in (x_a + q, np.abs(x_a - q)):
            # e^{−(s/2)[(2−t) a² + t b²]}, t from 0 to 1, as it enters the virial: times s a².
            z = 0.5 * split.s * (b * b - x_a * x_a)
            exact = np.where(np.abs(z) > 1e-6, -np.expm1(-z) / np.where(z == 0, 1.0, z), 1.0 - 0.5 * z)
            rule = sum(wi * np.exp(-z * ti) for ti, wi in zip(t, w))
            off = np.abs(rule - exact) * np.exp(-split.s * x_a**2) * split.s * x_a**2 * weight
            worst = max(worst, float(off.max()))
        if worst <= tolerance:
            return nodes
    return MOST_NODES


def largest_wave_of(kernel, tolerance: float, alpha: float) -> float:
    """The wave number up to which the smoothed field's modes are kept: φ̂ decays, and K_µν like α/Q beyond."""
    from ...deposit import fourier

    if kernel.jumps and kernel.last_mode is None:  # a product of functions of x, y and z
        kappa = (np.arange(LAST_MODE) + 0.5) * 0.05
        k, power = kappa / kernel.scale, kernel.hat_along(kappa) ** 2
    else:
        spec = fourier.spectrum(kernel)
        k, power = spec.k / spec.scale, spec.power
    power = power * np.minimum(1.0, (alpha / k) ** 2)
    tail = np.cumsum(power[::-1])[::-1] / power.sum()
    fine = np.sqrt(3.0 * tail) <= tolerance
    # Near the table's end the tail is cut short.
    if not fine.any() or np.argmax(fine) > 0.5 * len(k):
        raise AtcError(
            f"long-range Coulomb: the modes of kernel {kernel.name!r} decay too slowly for this tolerance: "
            f"{float(np.sqrt(3.0 * tail[len(k) // 2])):.1g} of the field is in those beyond "
            f"{k[len(k) // 2] * kernel.radius:.3g} over its radius: take a smoother kernel (gaussian, lucy) or a "
            "looser tolerance"
        )
    return float(k[np.argmax(fine)])
