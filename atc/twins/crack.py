"""Where the crack is in a run and in its twin: the tip, its speed, the cracked area, from the bonds that both have
lost."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..frame import Frame
from ..pd.damage import damage_n
from .choice import orientation
from .smoothing import Smoothing

#: Straight cuts that tell what a crack's damage is: how many, and within which part of the body's extent.
_CUTS, _MIDDLE = 8, (0.35, 0.65)


def unit_vector(given, what) -> np.ndarray:
    """A direction of length 1."""
    v = np.array(given, float)
    if not (np.isfinite(v).all() and np.linalg.norm(v) > 0):
        raise AtcError(f"[twin] {what}: expected a direction that is not 0, e.g. [1, 0, 0]")
    return v / np.linalg.norm(v)


class Crack:
    """Follows a crack that runs along a direction, in material coordinates (those of the reference).

    Damage of atoms and nodes is smoothed with one kernel at the nodes of the reference. The crack is the largest
    connected group of nodes with at least half of the damage that a straight cut through the body does there (the
    median of the largest values of eight cuts), each side by its own; its tip is the furthest place along the
    direction that reaches this, interpolated. The cracked area is the sum over lost bonds of the area of the crack's
    plane that each stands for, such that a straight cut at any height has the area that it has, in both; branches and
    damage beside the crack count in it. In the MD bonds have those of the perfect crystal (`damage.areas_of`), in the
    PD V_i V_j (1/g_i + 1/g_j), g = Σ V |ξ·n| of a node's family, so that families at surfaces count as whole ones.

    Parameters
    ----------
    made : TwinBody. reference : Frame. kernel : of internal lengths
    bonds : NearestBonds of the atoms. sim : pd.Simulation
    along, normal : (3,) unit vectors, where the crack runs and the normal of its plane
    axes_cc : (3, 3) rows, where the crystal's axes point in the run
    carried : where the nodes carry atoms along, gives their frame: the twin's bonds are then those, as of the MD
    """

    def __init__(self, made, reference, kernel, bonds, sim, along, normal, axes_cc=None, carried=None):
        if not abs(along @ normal) < 1e-6:
            raise AtcError("[twin] crack_normal: must be normal to crack_direction")
        body = made.body
        self.X, self.along, self.edge = body.X_nc, along, float(made.edges.max())
        self.bonds, self.sim, self.carried = bonds, sim, carried
        atoms = made.smoothing
        # Nodes that are the atoms are not smoothed; their damage is.
        self.atoms = atoms if isinstance(atoms, Smoothing) else Smoothing(reference, kernel, self.X)
        nodes = Frame(self.X, body.cell, reference.units, masses=body.rho_n * body.V_n)
        self.nodes = Smoothing(nodes, kernel, self.X)
        s_g = self.X @ normal
        lo, hi = np.quantile(s_g, _MIDDLE)
        x_atoms, r_atoms = reference.positions @ normal, bonds.r_bc @ normal
        table = body.bonds
        xi = table.xi_bc(self.X) @ normal  # from i to j
        V, reach = body.V_n, np.abs(xi)
        g_n = table.sums(V[table.j_b] * reach, V[table.i_b] * reach)
        each = np.divide(1.0, g_n, out=np.zeros(len(V)), where=g_n > 0)
        self.area_pd = V[table.i_b] * V[table.j_b] * (each[table.i_b] + each[table.j_b])
        self.area_md = bonds.area_b(normal, np.eye(3) if axes_cc is None else axes_cc)
        tops = []
        # Between layers of nodes, not through one: its bonds would end on the plane.
        for s in lo + (np.arange(_CUTS) + 0.5) * (hi - lo) / _CUTS + 0.013 * self.edge:
            cut_md = (x_atoms[bonds.i] - s) * (x_atoms[bonds.i] - r_atoms - s) < 0
            cut_pd = (s_g[table.i_b] - s) * (s_g[table.i_b] + xi - s) < 0
            md = self._smooth(self.atoms, bonds.share(cut_md)).max()
            tops.append((md, md if carried else self._smooth(self.nodes, self._broken(cut_pd)).max()))
        self.least = 0.5 * np.median(tops, axis=0)
        if not (self.least > 0).all():
            raise AtcError("[twin] crack_normal: a cut across the body crosses no bonds: the body has no such plane")

    def _broken(self, gone_b):
        return damage_n(self.sim.body, ~gone_b)

    @staticmethod
    def _smooth(smoothing, damage_n):
        mass = smoothing.weights_gn @ (smoothing.mass_n * damage_n)
        return np.divide(mass, smoothing.density_g, out=np.zeros(len(mass)), where=smoothing.density_g > 0)

    def measure(self, frame) -> list:
        """[(tip, area) of the MD, (tip, area) of the PD] now, internal units; no tip (NaN) before anything is lost."""
        found = [self._of_atoms(frame)]
        if self.carried:
            found.append(self._of_atoms(self.carried()))
        else:
            gone = np.asarray(self.sim.state.intact_b) == 0
            found.append((self._smooth(self.nodes, self._broken(gone)), self.area_pd[gone].sum()))
        return [(self._tip(d_g, self.least[k]), float(area)) for k, (d_g, area) in enumerate(found)]

    def _of_atoms(self, frame):
        gone = self.bonds.gone(frame)
        return self._smooth(self.atoms, self.bonds.share(gone)), self.area_md[gone].sum()

    def _tip(self, d_g, least) -> float:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        over = np.flatnonzero(d_g >= least)
        if not len(over):
            return np.nan
        pairs = cKDTree(self.X[over]).query_pairs(1.5 * self.edge, output_type="ndarray")
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(over), len(over)))
        _, label = connected_components(graph, directed=False)
        crack = over[label == np.bincount(label).argmax()]
        s_g = self.X @ self.along
        end, w = s_g[crack].max(), self.edge
        front = crack[s_g[crack] > end - 0.5 * w]
        ahead = (s_g > end + 0.5 * w) & (s_g < end + 1.5 * w)
        ahead &= cKDTree(self.X[front]).query(self.X)[0] < 1.8 * w
        if not ahead.any():  # it has come to the end of the body
            return float(end + 0.5 * w)
        top, next_ = d_g[front].max(), d_g[ahead].max()
        return float(end + w * min(1.0, (top - least) / (top - next_))) if top > next_ else float(end)


def notches_of(scene, get, length, dimension) -> list:
    """The cuts that [twin] says the reference has: parallelograms, in the plane lines."""
    from .. import pd

    out = []
    for given in get("notches", []):
        corners = np.array(given, float) if len({len(p) for p in given}) == 1 else np.zeros(0)
        if corners.shape != ((2, 2) if dimension == 2 else (3, 3)):
            wanted = (
                "[[x, y], [x, y]], where it begins and ends"
                if dimension == 2
                else "a corner and two edges, [x, y, z] each"
            )
            raise scene.bad(("twin", "notches"), f"each is {wanted}")
        make = pd.Notch.line if dimension == 2 else pd.Notch
        try:
            make(*corners.tolist())  # complains in the user's numbers
        except AtcError as e:
            raise scene.bad(("twin", "notches"), e) from None
        out.append(make(*(corners * length), as_damage=True))
    return out


def require_crossed(scene, body) -> None:
    """Raise unless every notch of a body crosses bonds."""
    counts = body.cuts if body.notches and len(body.bonds) else []
    for k, crossed in enumerate(counts):
        if not crossed:
            raise scene.wrong(("twin", "notches"), f"notch {k + 1} crosses no bond of the nodes")


def crack_of(scene, get, made, reference, kernel, bonds, sim, carried=None):
    """What follows the crack, where [twin] says along which direction it runs."""
    if get("crack_direction") is None:
        if get("crack_normal") is not None:
            raise scene.wrong(("twin", "crack_normal"), "crack_normal needs crack_direction too")
        return None
    if bonds is None:
        raise scene.bad(("twin", "crack_direction"), "a crack is followed where bonds break: fracture = true")
    if get("crack_normal") is None:
        raise scene.wrong(
            ("twin", "crack_direction"), "crack_direction needs crack_normal too, the normal of the crack's plane"
        )
    along, normal = (unit_vector(get(k), k) for k in ("crack_direction", "crack_normal"))
    return Crack(made, reference, kernel, bonds, sim, along, normal, orientation(scene), carried)


def add_crack(data, units, times, found) -> None:
    """md_ and pd_crack_tip, _crack_speed and _crack_area into a dataset, of what `Crack.measure` found a frame."""
    found = np.array(found, float)  # (frames, side, tip or area)
    length, speed = units.label("length"), units.label("velocity")
    across = "" if units.dimension == 2 else "^2"
    for k, side in enumerate(("md", "pd")):
        tip, area = found[:, k].T
        v = np.full(len(tip), np.nan)
        known = np.flatnonzero(np.isfinite(tip))
        if len(known) > 1:
            v[known] = np.gradient(tip[known], times[known])
        for name, values, unit, what in (
            (
                "crack_tip",
                units.to_user("length", tip),
                length,
                "the crack's tip along crack_direction, in the reference",
            ),
            ("crack_speed", units.to_user("velocity", v), speed, "speed of the crack's tip in the reference"),
            (
                "crack_area",
                area / units.length ** (units.dimension - 1),
                f"{length}{across}",
                "cracked area: that of a straight cut that loses as many bonds",
            ),
        ):
            data[f"{side}_{name}"] = ("frame", values, {"units": unit, "long_name": f"{what}, {side.upper()}"})


def crack_lines(data) -> list[str]:
    """What became of the crack, for a person: the speed is that of a straight line through the tip's places."""
    unit = str(data["md_crack_tip"].attrs["units"])
    out = []
    for side in ("md", "pd"):
        tip, area = (data[f"{side}_{n}"].values for n in ("crack_tip", "crack_area"))
        known = np.flatnonzero(np.isfinite(tip))
        if not len(known):
            out.append(f"crack, {side.upper()}: there is none")
            continue
        v = np.nanmedian(data[f"{side}_crack_speed"].values) if len(known) > 1 else np.nan
        out.append(
            f"crack, {side.upper()}: from frame {known[0]} on, tip from {tip[known[0]]:.4g} to {tip[known[-1]]:.4g} "
            f"{unit}, median speed {v:.4g} {data[f'{side}_crack_speed'].attrs['units']}, area {area[-1]:.4g} "
            f"{data[f'{side}_crack_area'].attrs['units']}"
        )
    return out
