"""The energy of a homogeneously deformed crystal (Cauchy and Born): W(F) = min over inner displacements of U(F, s)/V0.

W depends on F through Green's strain E = (FᵀF − 1)/2 alone. `CauchyBorn` evaluates it under the potential itself,
`StrainEnergy` as a polynomial in E that has the symmetry of the cube, with a measured error. Internal units.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from ..errors import AtcError
from ..pd.voigt import constants_of, from_voigt, tensor_of, to_voigt
from .crystal import Crystal, evaluate, response
from .deformed_crystals import DeformedCrystals

#: How far a polynomial's stress may be from the crystal's, relative to the linear stress of the same strain.
TOLERANCE = 1e-4
#: What is tried: sizes of strains, and degrees of polynomials of them.
REACHES, DEGREES = (0.03, 0.045, 0.06, 0.085, 0.12), (4, 6)
_SAMPLES = 600
#: Steps that a basis has to come to rest, and how little (in shortest lattice vectors) is rest.
_ITERATIONS, _AT_REST = 40, 1e-10


def strain_v(H_ncc) -> np.ndarray:
    """(n, 6) Green's strain of displacement gradients H = F − 1 in Voigt's order, shears doubled."""
    H = np.asarray(H_ncc, float)
    E = 0.5 * (H + H.swapaxes(-1, -2) + H.swapaxes(-1, -2) @ H)
    return to_voigt(E) * np.array([1.0, 1, 1, 2, 2, 2])


def stretches(E_nv) -> np.ndarray:
    """(n, 3, 3) the symmetric U with U² = 1 + 2E; NaN where there is none."""
    values, axes = np.linalg.eigh(np.eye(3) + 2 * from_voigt(E_nv, 0.5))
    with np.errstate(invalid="ignore"):
        return (axes * np.sqrt(values)[:, None, :]) @ axes.swapaxes(1, 2)


class CauchyBorn:
    """W(E) and S = ∂W/∂E of a crystal under its potential, the basis at rest at every strain.

    Parameters
    ----------
    crystal : Crystal at zero pressure (`crystal.relax`)
    model : potential of `atc.potential`, or an ASE calculator

    Attributes
    ----------
    moduli_vv : (6, 6) C = ∂S/∂E at E = 0, energy/length³
    """

    def __init__(self, crystal: Crystal, model):
        self.crystal, self.copies = crystal, DeformedCrystals(crystal, model)
        r = response(crystal, model)
        values, modes = np.linalg.eigh(r.phi_xx)
        inner = values > 1e-7 * np.abs(values).max(initial=0.0)
        # Inner displacements of unit forces, and of unit strains.
        self._give_xx = (modes[:, inner] / values[inner]) @ modes[:, inner].T
        self._shift_xv = self._give_xx @ r.lambda_xv
        C = r.born_vv - r.lambda_xv.T @ self._shift_xv / crystal.volume
        self.moduli_vv = 0.5 * (C + C.T)
        self._rest = float(evaluate(model, crystal.frame())[0])

    def __call__(self, E_nv) -> tuple[np.ndarray, np.ndarray]:
        """(n,) W (per reference volume, 0 at rest) and (n, 6) S in Voigt's order.

        Inner displacements by Broyden's method from the undeformed crystal's Hessian. NaN where the basis finds no
        rest: this crystal does not exist at that strain.
        """
        E = np.atleast_2d(np.asarray(E_nv, float))
        U = stretches(E)
        W, S = np.full(len(E), np.nan), np.full((len(E), 6), np.nan)
        there = np.isfinite(U).all(axis=(1, 2))
        W[there], S[there], _ = self._at(E[there], U[there])
        return W, S

    def basis(self, E_nv) -> np.ndarray:
        """(n, atoms, 3) inner displacements at rest, on top of U X; NaN where there are none."""
        E = np.atleast_2d(np.asarray(E_nv, float))
        return self._at(E, stretches(E))[2]

    def _at(self, E, U):
        n, m = len(E), len(self.crystal)
        size = np.linalg.norm(self.crystal.vectors, axis=1).min()
        u = E @ self._shift_xv.T
        energy, f, virial = self.copies(U, u.reshape(n, m, 3))
        f = f.reshape(n, -1)
        alive = np.ones(n, bool)
        if m > 1:
            B = np.broadcast_to(self._give_xx, (n, 3 * m, 3 * m)).copy()
            moving = np.arange(n)
            for _ in range(_ITERATIONS):
                du = np.einsum("nxy,ny->nx", B[moving], f[moving])
                largest = np.abs(du).max(axis=1)
                # Forces that no longer move anything: what they do to the energy is far below rounding.
                alive[moving[~(largest < 0.2 * size)]] = False
                go = (largest > _AT_REST * size) & alive[moving]
                moving, du = moving[go], du[go]
                if not len(moving):
                    break
                u[moving] += du
                energy[moving], g, virial[moving] = self.copies(U[moving], u[moving].reshape(-1, m, 3))
                df, f[moving] = g.reshape(len(moving), -1) - f[moving], g.reshape(len(moving), -1)
                Bdf, duB = (np.einsum(s, B[moving], v) for s, v in (("nxy,ny->nx", df), ("nxy,nx->ny", du)))
                scale = np.einsum("nx,nx->n", duB, df)
                B[moving] -= (du + Bdf)[:, :, None] * duB[:, None] / scale[:, None, None]
            alive[moving] = False
        inverse = np.linalg.inv(U)
        S = inverse @ virial @ inverse.swapaxes(1, 2) / self.crystal.volume
        S = to_voigt(S)
        W = np.where(alive, (energy - self._rest) / self.crystal.volume, np.nan)
        u = np.where(alive[:, None], u, np.nan).reshape(n, m, 3)
        return W, np.where(alive[:, None], S, np.nan), u


class StrainEnergy:
    """W(E) as a polynomial that is invariant under the symmetries of the cube.

    Attributes
    ----------
    degree : of the polynomial. reach : √(E:E) up to which it holds
    error : the largest |S − S_exact| relative to the linear stress |C:E|, over strains that it was not fitted to
    """

    def __init__(self, degree: int):
        self.degree, self.reach, self.error = int(degree), 0.0, np.nan
        # Monomials of the normal strains and of the shears; the coefficients of their products are a matrix. Mirror
        # planes let through only shears whose exponents are all even or all odd.
        self._normal = p = _exponents(degree)
        self._shear = q = p[(p % 2 == p[:, :1] % 2).all(axis=1)]
        place = {tuple(e): k for k, e in enumerate(p)}
        self._columns = np.array([place[tuple(e)] for e in q])
        self._lower = np.array([[place[tuple(np.maximum(e - d, 0))] for e in p] for d in np.eye(3, dtype=int)])
        self.orbits = _orbits(p, q, degree)
        self.coefficients = np.zeros((len(p), len(q)))

    @classmethod
    def fitted(cls, exact: CauchyBorn, tolerance: float = TOLERANCE, reaches=REACHES) -> StrainEnergy | None:
        """The polynomial of the widest reach whose stress stays within `tolerance`; the elastic constants are exact.
        None where there is none, as for a potential whose force jumps at its cutoff."""
        found = None
        for reach in sorted(reaches):
            made = cls._within(exact, reach, tolerance)
            if made is None:
                break
            found = made
        return found

    @classmethod
    def _within(cls, exact, reach, tolerance):
        E_nv = _ball(_SAMPLES, reach)
        W, S_nv = exact(E_nv)
        if not np.isfinite(W).all():
            return None
        linear = np.linalg.norm(E_nv @ exact.moduli_vv, axis=1)
        fit, held = np.arange(len(E_nv)) % 3 > 0, np.arange(len(E_nv)) % 3 == 0
        for degree in DEGREES:
            made = cls(degree)
            made._fit(exact.moduli_vv, E_nv[fit], S_nv[fit], linear[fit])
            off = np.linalg.norm(made(E_nv[held])[1] - S_nv[held], axis=1) / linear[held]
            if off.max() <= tolerance:
                made.reach, made.error = reach, float(off.max())
                return made
        return None

    def _fit(self, C_vv, E_nv, S_nv, linear_n):
        A = self.rows(E_nv)
        order = self.orders
        found = np.zeros(len(self.orbits))
        # The second order from the constants: the rows of strains that are zero but for one are linear in E there.
        small = self.rows(np.eye(6) * 1e-3)[:, :, order == 2] / 1e-3
        found[order == 2] = np.linalg.lstsq(small.reshape(36, -1), C_vv.ravel(), rcond=None)[0]
        weight = 1.0 / linear_n[:, None]
        M = (A[:, :, order > 2] * weight[..., None]).reshape(-1, (order > 2).sum())
        size = np.linalg.norm(M, axis=0)
        rest = (S_nv - A[:, :, order == 2] @ found[order == 2]) * weight
        found[order > 2] = np.linalg.lstsq(M / size, rest.ravel(), rcond=None)[0] / size
        self.set(found)

    def set(self, found) -> None:
        """The coefficients of the orbits."""
        for (i, j), c in zip(self.orbits, found):
            self.coefficients[i, j] = c

    @property
    def orders(self) -> np.ndarray:
        """(orbits,) the degree of each."""
        return np.array([(self._normal[i[0]] + self._shear[j[0]]).sum() for i, j in self.orbits])

    def _monomials(self, x_nc):
        """(m, n) of three variables."""
        powers = np.ones((3, self.degree + 1, len(x_nc)))
        for k in range(self.degree):
            powers[:, k + 1] = powers[:, k] * x_nc.T
        p = self._normal
        return powers[0, p[:, 0]] * powers[1, p[:, 1]] * powers[2, p[:, 2]]

    def rows(self, E_nv) -> np.ndarray:
        """(n, 6, orbits) the derivative of every orbit's sum."""
        a, b = self._monomials(E_nv[:, :3]), self._monomials(E_nv[:, 3:])
        out = np.zeros((len(E_nv), 6, len(self.orbits)))
        p = self._normal
        for k, (i, j) in enumerate(self.orbits):
            j = self._columns[j]
            for c in range(3):
                out[:, c, k] = (p[i, c, None] * a[self._lower[c, i]] * b[j]).sum(axis=0)
                out[:, 3 + c, k] = (p[j, c, None] * a[i] * b[self._lower[c, j]]).sum(axis=0)
        return out

    def __call__(self, E_nv) -> tuple[np.ndarray, np.ndarray]:
        """(n,) W and (n, 6) S in Voigt's order."""
        E = np.asarray(E_nv, float)
        a, b = self._monomials(E[:, :3]), self._monomials(E[:, 3:])
        p, q = self._normal, self._columns
        right, left = self.coefficients @ b[q], self.coefficients.T @ a
        S = np.empty((len(E), 6))
        for c in range(3):
            S[:, c] = np.einsum("an,an,a->n", a[self._lower[c]], right, p[:, c])
            S[:, 3 + c] = np.einsum("bn,bn,b->n", b[self._lower[c, q]], left, p[q, c])
        return np.einsum("an,an->n", a, right), S


class CrystalLaw:
    """W and P = ∂W/∂F of a crystal: the polynomial within its reach, the potential itself beyond it.

    Parameters
    ----------
    exact : CauchyBorn. quick : StrainEnergy or None. axes : (3, 3) rows: where the crystal's x, y, z point
    warm : what the crystal's vibrations add, called like a StrainEnergy (`free_energy.vibrational`); or None

    Attributes
    ----------
    moduli_vv : (6, 6) ∂S/∂E at rest along the body's axes. beyond : how often the potential itself was asked
    """

    def __init__(self, exact: CauchyBorn, quick: StrainEnergy | None = None, axes=None, warm=None):
        self.exact, self.quick, self.warm = exact, quick, warm
        self.axes = np.eye(3) if axes is None else np.asarray(axes, float)
        self.beyond = 0
        C = exact.moduli_vv
        if warm is not None:
            h = 1e-5 * np.eye(6)
            C = C + (warm(h)[1] - warm(-h)[1]) / 2e-5
        self.moduli_vv = turned(0.5 * (C + C.T), self.axes)

    def __call__(self, H_ncc) -> tuple[np.ndarray, np.ndarray]:
        """(n,) W and (n, 3, 3) P at displacement gradients H = F − 1.

        Raises AtcError where the crystal does not exist.
        """
        # In the crystal's axes.
        Q = self.axes
        H = Q @ H_ncc @ Q.T
        E = strain_v(H)
        W, S = np.empty(len(E)), np.empty((len(E), 6))
        inside = np.zeros(len(E), bool)
        if self.quick is not None:
            inside = size_of(E) <= self.quick.reach
            W[inside], S[inside] = self.quick(E[inside])
        if not inside.all():
            self.beyond += int((~inside).sum())
            W[~inside], S[~inside] = self.exact(E[~inside])
            lost = np.isnan(W)
            if lost.any():
                k = np.flatnonzero(lost)[np.argmax(size_of(E[lost]))]
                raise AtcError(
                    f"{self.exact.crystal.name}: the crystal does not exist at the strain of {int(lost.sum())} nodes "
                    f"(Green's strain xx yy zz yz xz xy up to {', '.join(f'{e:.3g}' for e in E[k])}): its atoms find "
                    "no rest; cauchy-born holds for bodies that stay whole"
                )
        if self.warm is not None:
            w, s = self.warm(E)
            W, S = W + w, S + s
        P = (np.eye(3) + H) @ from_voigt(S)
        return W, Q.T @ P @ Q

    def free_stretch(self) -> float:
        """How much longer than at rest the crystal's edges are where it has no stress."""
        from scipy.optimize import brentq

        pressure = lambda x: float(np.trace(self(x * np.eye(3)[None])[1][0]))  # noqa: E731
        return 1.0 + brentq(pressure, -0.02, 0.06) if self.warm is not None else 1.0

    def ellipticity(self, H_ncc, directions: int = 100) -> np.ndarray:
        """(n,) the least eigenvalue of the acoustic tensor A_ik = ∂P_iJ/∂F_kL N_J N_L over directions N, relative to
        that of the undeformed crystal: not positive where the crystal is no longer stable against localisation."""
        N_d = _sphere(directions)

        def least(H):
            A, h = np.empty((len(H), 3, 3, 3, 3)), 1e-5
            for k, L in product(range(3), repeat=2):
                d = np.zeros((3, 3))
                d[k, L] = h
                A[:, :, :, k, L] = (self(H + d)[1] - self(H - d)[1]) / (2 * h)
            found = np.full(len(H), np.inf)
            for N in N_d:
                acoustic = np.einsum("niJkL,J,L->nik", A, N, N)
                found = np.minimum(found, np.linalg.eigvalsh(0.5 * (acoustic + acoustic.swapaxes(1, 2)))[:, 0])
            return found

        return least(np.asarray(H_ncc, float)) / least(np.zeros((1, 3, 3)))


def size_of(E_nv) -> np.ndarray:
    """(n,) √(E:E)."""
    return np.sqrt((E_nv**2) @ np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]))


def turned(C_vv, Q) -> np.ndarray:
    """Elastic constants along axes in which the crystal's own are the rows of Q."""
    return constants_of(np.einsum("ai,bj,ck,dl,abcd->ijkl", Q, Q, Q, Q, tensor_of(C_vv)))


def _ball(n: int, reach: float) -> np.ndarray:
    """(n, 6) strains with √(E:E) up to `reach`, more of them small than an even filling has; always the same."""
    rng = np.random.default_rng(20240611)
    E = rng.normal(size=(n, 6)) * np.array([1.0, 1, 1, 2**0.5, 2**0.5, 2**0.5])
    return E * (reach * np.sqrt(np.linspace(1e-3, 1, n)) / size_of(E))[:, None]


def _sphere(n: int) -> np.ndarray:
    """(n, 3) directions, even over half a sphere (Fibonacci's spiral), and those of the cube."""
    k = np.arange(n) + 0.5
    z, phi = 1 - k / n, np.pi * (1 + 5**0.5) * k
    spiral = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], axis=1)
    cube = np.array([p for p in product((-1, 0, 1), repeat=3) if p > (0, 0, 0)], float)
    return np.concatenate([spiral, cube / np.linalg.norm(cube, axis=1)[:, None]])


def _exponents(degree) -> np.ndarray:
    """(m, 3) all exponents of three variables up to a degree."""
    return np.array([p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree])


def _orbits(normal, shear, degree) -> list[tuple[np.ndarray, np.ndarray]]:
    """Monomials that permutations of the axes bring into each other; a constant is none of them."""
    place_n, place_s = ({tuple(p): k for k, p in enumerate(q)} for q in (normal, shear))
    seen, out = set(), []
    for p, s in product(map(tuple, normal), map(tuple, shear)):
        if not 1 <= sum(p) + sum(s) <= degree or (p, s) in seen:
            continue
        orbit = {(tuple(p[k] for k in o), tuple(s[k] for k in o)) for o in permutations(range(3))}
        seen |= orbit
        out.append(tuple(np.array(v) for v in zip(*((place_n[a], place_s[b]) for a, b in sorted(orbit)))))
    return out


def cubic_of(C_vv) -> tuple[float, float, float]:
    """C11, C12, C44 averaged over the cube's axes."""
    C = np.asarray(C_vv)
    return float(np.trace(C[:3, :3]) / 3), float(C[:3, :3][~np.eye(3, dtype=bool)].mean()), float(C[3:, 3:].trace() / 3)
