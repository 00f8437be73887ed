"""What acts on the atoms of a run from outside, from its script: who is held, and the forces that nodes feel in their
place."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from ..decomposers.outside import Along, Constant, Friction, Indenter, Put, Wall
from ..errors import AtcError, AtcWarning
from ..frame import Frame
from .conditions import mapped
from .smoothed import Shape


@dataclass
class FromScript:
    """held_nc : (atoms, 3) components that the script holds or drives. forces : `NodeForce` objects, for
    `pd.Simulation(walls=)`. lines : what was found and what is left out, for a person."""

    held_nc: np.ndarray
    forces: list
    lines: list


class NodeForce:
    """A law for the force on an atom, on nodes: each feels it as often as it has the mass of an atom; or, given the
    atoms, on the places where the nodes carry these, with the work-conjugate forces on the nodes. What pushes a surface
    must meet the atoms' surface (the outermost nodes lie up to half their distance below it), and the sum of the forces
    on some of the atoms must stay what it is.

    Parameters
    ----------
    law : of `atc.decomposers.outside`, or a function of time that gives one
    inside_g, inside_n : (nodes,), (atoms,) who feels it. mass : of an atom. cell : Cell, to find images by
    carried : (X_nc, `smoothed.Shape`) of the atoms, or None
    """

    friction = 0.0  # the engine's, which no law of a script has

    def __init__(self, law, inside_g, mass, cell, units, inside_n, carried=None):
        self.reference_cell, self.carried = cell, carried
        self.law, self.inside_g, self.mass, self.cell, self.units = law, inside_g, float(mass), cell, units
        self.inside_n = inside_n
        self.force = np.zeros(3)

    def bind(self, body):
        self.atoms_n = body.rho_n * body.V_n / self.mass
        return self

    def at(self, t):
        """The law at time t."""
        return self.law(t) if callable(self.law) else self.law

    def on_atoms(self, frame, t) -> np.ndarray:
        """(3,) the sum of its forces on the atoms of a frame at time t."""
        f = self.at(t).force(frame, np.zeros((len(frame), 3)), self.inside_n)
        return np.where(self.inside_n[:, None], f, 0.0).sum(axis=0)

    def add(self, t, z, F_nc):
        """Add the forces at time t; their energy is not kept."""
        law = self.at(t)
        if self.carried is not None:
            X, shape = self.carried
            own = lambda x: mapped(x, self.reference_cell, self.cell)  # noqa: E731
            x = own(X) + shape.weights_kJ @ (z[:, 3:6] + z[:, :3] - own(z[:, 3:6]))
            frame = Frame(x, self.cell, self.units, masses=np.full(len(x), self.mass))
            f = np.where(self.inside_n[:, None], law.force(frame, np.zeros_like(x), self.inside_n), 0.0)
            F_nc += shape.weights_kJ.T @ f
            self.force = f.sum(axis=0)
            return 0.0
        n = len(z)
        frame = Frame(z[:, 3:6] + z[:, :3], self.cell, self.units, masses=np.full(n, self.mass))
        f = np.where(self.inside_g[:, None], law.force(frame, np.zeros((n, 3)), self.inside_g), 0.0)
        f *= self.atoms_n[:, None]
        F_nc += f
        self.force = f.sum(axis=0)
        return 0.0


def from_script(pot, reference, made, indenter=None, gripped=False) -> FromScript:
    """What the script of a potential does to the atoms of a reference, and what stands for it in a `TwinBody`.

    Parameters
    ----------
    pot : Potential. indenter : (centre, velocity, radius, stiffness per atom), internal units, or None
    gripped : whether the scene names nodes that are held. They stand for groups whose atoms the script does not tell

    Notes
    -----
    Atoms of ``fix move``, and those whose forces are set to constants (``fix setforce 0 0 0``, ``freeze``) or lose
    components (``lineforce``, ``planeforce`` of an axis), move there as somebody wanted: the nodes made of them follow
    their smoothed displacement. Friction and noise are left out.
    """
    held = np.zeros((len(reference), 3), bool)
    forces, lines, left = [], [], []
    mass = reference.masses.mean()
    share = lambda inside: made.smoothing.share(inside) >= 0.5  # noqa: E731
    surface = lambda law: callable(law) or isinstance(law, Indenter | Wall)  # noqa: E731
    acting = pot.acting
    laws = acting.laws if acting is not None else ()
    moved = tuple(pot.moved)
    frame = reference
    if (moved or laws) and pot.setup is not None:
        try:
            frame = _with_groups(pot, reference, moved)
        except AtcError as e:
            names = _held_groups(moved, laws)
            if not gripped or names is None:
                raise AtcError(
                    f"[twin] cannot tell whom the script holds or pushes: {e}"
                    + ("" if names is None else "; name who is held by grips or grip_types in [twin]")
                ) from None
            lines.append(f"held or moved by {', '.join(names)}: the nodes of grips, as the script does not tell whom")
            moved, laws = (), [law for law in laws if _left_out(law)]
    carried = None

    def add(law, inside):
        """What pushes a surface or only some of the atoms acts on the atoms, so that nothing of it is lost."""
        nonlocal carried
        some = surface(law) or not inside.all()
        if some and carried is None:
            carried = (reference.positions, shape_of(reference, made))
        who = share(inside)
        forces.append(NodeForce(law, who, mass, reference.cell, reference.units, inside, carried if some else None))
        return "the places of the atoms, which nodes carry" if some else "every atom's mass of the nodes"

    def hold(inside, components, what, name):
        nodes = share(inside)
        held[inside] |= components
        if not nodes.any():
            warnings.warn(
                f"{what} of group {name}: no node has half of its mass from these {int(inside.sum())} atoms, so that "
                "none is held: take a smaller spacing or kernel radius, or name nodes by grips",
                AtcWarning,
                stacklevel=3,
            )
        lines.append(f"{what} of group {name}: held at the smoothed displacement of its atoms ({nodes.sum()} nodes)")

    for k, name in enumerate(moved):
        bit = frame.groups >> (len(pot.setup.groups) + k) if name != "all" else np.ones(len(frame), np.int64)
        hold((bit & 1) == 1, np.ones(3, bool), "fix move", name)
    for law in laws:
        what = f"fix {law.name}"
        if _left_out(law):
            left.append(what)
            continue
        inside = law.group.inside(frame, law.where)
        if isinstance(law, Put):
            hold(inside, np.array([v is not None for v in law.values]), what, law.group.name)
        elif isinstance(law, Along):
            hold(inside, ~_free_axes(law), what, law.group.name)
        else:
            lines.append(f"{what} of group {law.group.name}: the same force on {add(law, inside)}")
    left += [
        other for other in (acting.others if acting is not None else ()) if indenter is None or "indent" not in other
    ]
    if indenter is not None:
        centre, velocity, radius, stiffness = indenter
        law = Indenter(name="indent", shape="sphere", radius=radius, stiffness=stiffness)
        on = add(lambda t: replace(law, centre=tuple(centre + t * velocity)), np.ones(len(reference), bool))
        lines.append(f"indenter of [twin]: the same force on {on}")
    if left:
        lines.append(f"left out of what the script does to atoms: {', '.join(left)}")
    return FromScript(held, forces, lines)


def _free_axes(law):
    """(3,) which components a force along an axis, or in the plane normal to one, leaves; None for other directions."""
    along = np.abs(np.array(law.direction)) > 1e-9 * np.linalg.norm(law.direction)
    if along.sum() != 1:
        return None
    return ~along if law.plane else along


def shape_of(reference, made):
    """How nodes carry the atoms."""
    if made.step_cc is None or (
        len(made.body) == len(reference) and np.array_equal(made.body.X_nc, reference.positions)
    ):
        return Shape(reference)
    return Shape(reference, made.body.X_nc, made.step_cc)


def indenters(forces) -> list:
    """Those of `NodeForce` objects that are indenters."""
    return [f for f in forces if isinstance(f.at(0.0), Indenter)]


def add_indenters(data, units, md_tc, pd_tc) -> list[str]:
    """The force on the indenters over time, of atoms and nodes (frames, 3), into the dataset; a line for a person."""
    for side, F_tc in (("md", md_tc), ("pd", pd_tc)):
        attrs = {"units": units.label("force"), "long_name": f"force on the indenters, {side.upper()}"}
        data[f"{side}_indenter_force"] = (("frame", "i"), units.to_user("force", np.array(F_tc)), attrs)
    md, pd = (np.array(F) for F in (md_tc, pd_tc))
    size = float(np.sqrt((md**2).sum(axis=1).mean()))
    off = float(np.sqrt(((pd - md) ** 2).sum(axis=1).mean()))
    relative = f" ({100 * off / size:.3g} %)" if size > 0 else ""
    show = lambda v: f"{units.to_user('force', v):.4g}"  # noqa: E731
    return [
        f"indenters: force rms {show(size)} {units.label('force')} in the MD, the twin's is {show(off)} off{relative}"
    ]


def _with_groups(pot, reference, names):
    """The reference with who is in which group of the script; those of `names` behind those that it needs anyway."""
    return replace(pot.setup, groups=(*pot.setup.groups, *names), if_known=frozenset()).complete(reference)


def _left_out(law) -> bool:
    """What nodes have nothing for: friction, directions askew to the axes, forces on charges."""
    if isinstance(law, Along):
        return _free_axes(law) is None
    return isinstance(law, Friction) or (isinstance(law, Constant) and law.per == "charges")


def _held_groups(moved, laws) -> list[str] | None:
    """["fix move of group left", ...] where the script does nothing to atoms but hold or move them; None where it
    pushes some, too."""
    laws = [law for law in laws if not _left_out(law)]
    if not all(isinstance(law, Put | Along) for law in laws):
        return None
    return [*(f"fix move of group {g}" for g in moved), *(f"fix {law.name} of group {law.group.name}" for law in laws)]
