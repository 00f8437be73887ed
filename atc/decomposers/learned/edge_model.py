"""The public door for machine-learned potentials: energies of atoms as a function of edges, in torch."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Mapping

import numpy as np

from ...errors import AtcError, AtcWarning
from ...frame import Frame
from ...units import units as get_units
from ..base import Term, Work
from ..many_body.elements import ElementMap
from ..potentials import Potential
from .edge_work import EdgeWork
from .graph import Edges, Part, Place
from .guards import GUARD
from .torch_here import device_of, first_line, free_memory, require_torch

#: Edges up to which a frame is not worth being looked at for its memory.
_SMALL = 20_000
#: What of the memory that is free batches may take.
_PART_OF_MEMORY = 0.4
#: What a double backward pass keeps, over what the forward pass keeps (measured: 2 to 2.6).
_FLUX_MEMORY = 3.0


class OfInputs:
    """Energies of atoms as a function of `messages.Inputs`: what a package's model is made into."""

    #: whether it is told positions and cell besides the edges
    positions = False
    #: whether it makes the edges' vectors of positions, so that these are pulled at too
    vectors_of_positions = False

    def __call__(self, at):
        """(m,) tensor"""
        raise NotImplementedError


class _OfEdges(OfInputs):
    def __init__(self, energies):
        self.energies = energies

    def __call__(self, at):
        return self.energies(at.r_ec, at.centre, at.neighbour, at.types_n)


class EdgeModel(Term):
    """U = Σ_j U^(j), of the vectors of edges centre → neighbour; see `edge_model`."""

    _threads = 1  # of torch; no part of what the model is
    _per_edge: float | None = None  # bytes, as soon as they are known

    def __init__(
        self,
        energies,
        cutoff,
        hops,
        *,
        units,
        types=None,
        stress="edge",
        species=None,
        reference=None,
        batch=None,
        device="cpu",
        precision="float64",
        name="energies of edges",
        own=None,
        said=(),
    ):
        self.energies, self.own, self.name = energies, own, name
        u = get_units(units)
        self.length, self.energy = float(u.to_internal("length", 1.0)), float(u.to_internal("energy", 1.0))
        if not callable(energies):
            raise AtcError(f"{name}: energies must be a function, got {type(energies).__name__}")
        if not (isinstance(cutoff, (int, float, np.number)) and np.isfinite(cutoff) and cutoff > 0):
            raise AtcError(f"{name}: the cutoff must be a positive number, got {cutoff!r}")
        if not (isinstance(hops, (int, np.integer)) and not isinstance(hops, bool) and hops >= 1):
            raise AtcError(f"{name}: hops must be a whole number of 1 or more, the layers of messages, got {hops!r}")
        if stress not in ("edge", "central"):
            raise AtcError(f'{name}: stress must be "edge" or "central", got {stress!r}')
        if stress == "central" and hops > 1:
            raise AtcError(
                f'{name}: stress="central" is for models of one hop, of which an atom and its neighbours are all that '
                f'its energy depends on; this one has {hops}: use stress="edge"'
            )
        if precision not in GUARD:
            raise AtcError(f'{name}: precision must be "float64" or "float32", got {precision!r}')
        if precision == "float32":
            warnings.warn(
                f"{name}: in float32 forces and fluxes are good to 6 digits or so, and so are the balances: leave "
                "precision out for float64",
                AtcWarning,
                stacklevel=4,
            )
        if batch is not None and not (isinstance(batch, (int, np.integer)) and batch >= 1):
            raise AtcError(f"{name}: batch must be a number of atoms, got {batch!r}")
        require_torch(name)
        self.cutoff, self.hops, self.stress = float(cutoff) * self.length, int(hops), stress
        self.depth = 2.0 * self.hops
        self.central, self.edges = stress == "central", stress == "edge"
        self.batch, self.device, self.precision, self.said = batch, device_of(device, name), precision, tuple(said)
        self.species = None if species is None else [str(s) for s in species]
        self.types = _types(types, self.species, name)
        self.reference = self._reference(reference)
        self._looked, self._evaluated = False, 0

    def use_threads(self, count: int) -> None:
        self._threads = count

    # --- what it says

    def describe(self) -> str:
        hops = "one hop" if self.hops == 1 else f"{self.hops} hops"
        what = ", ".join([self.name, *self.said])
        if self.central:
            return f"{what}, {hops}, central, minimal norm per star, weights f_c f_c, energy to the centre of its star"
        return f"{what}, edge gradient of the total energy, {hops}, energy of each atom its own; one merged bond a pair"

    @property
    def attributes(self):
        out = {
            "energy_path": "edges from neighbour to centre" if self.hops == 1 else "edges of the model, layer by layer",
            "precision": self.precision,
        }
        out["energy_reference"] = "the model's own zero, which may hold energies of single atoms (E0)"
        if self.reference is not None:
            names = self.species or [str(k) for k in self.reference]
            less = (f"{n}: {e:.10g}" for n, e in zip(names, self.reference.values(), strict=True))
            out["energy_reference"] = f"energies of atoms less {', '.join(less)}"
        return out

    def _reference(self, reference):
        """{number of a species: energy to subtract, in the model's unit} or None."""
        if reference is None:
            return None
        if reference == "isolated":
            if self.species is None and self.types is None:
                raise AtcError(
                    f'{self.name}: reference="isolated" needs species= or types=, to know which atoms there are'
                )
            known = range(len(self.species)) if self.species is not None else self.types
            numbers = sorted({t for t in known if t is not None})
            return {k: self._alone(k) for k in numbers}
        if not isinstance(reference, Mapping):
            raise AtcError(
                f'{self.name}: reference must be "isolated", or energies of atoms to subtract, e.g. {{"Si": -163.2}}, '
                f"got {reference!r}"
            )
        out = {}
        for key, value in reference.items():
            if self.species is not None and key not in self.species:
                raise AtcError(f"{self.name}: reference: no species {key!r}: it has {', '.join(self.species)}")
            try:
                out[self.species.index(key) if self.species is not None else int(key)] = float(value)
            except (TypeError, ValueError):
                raise AtcError(f"{self.name}: reference: expected an energy for {key!r}, got {value!r}") from None
        return {k: out.get(k, 0.0) for k in range(len(self.species))} if self.species is not None else out

    def _alone(self, number: int) -> float:
        none = np.zeros(0, int)
        part = Part(np.zeros(1, int), slice(None), none, none, np.zeros((0, 3)), np.ones(1, bool))
        place = Place(np.zeros((1, 3)), np.eye(3), np.zeros(3, bool))
        found = self.evaluate(part, np.array([number]), place, None, "an atom alone")
        return float(found.energy_n[0])

    def map(self, frame: Frame):
        """(n,) the number of each atom's species, and the indices of atoms that take part (None: all)."""
        types = self.types
        if self.species is None:
            if types is None:
                return frame.types.astype(np.int64), None
            numbers = np.array([-1, *(-1 if t is None else t for t in types)])
            if len(frame) and frame.types.max() >= len(numbers):
                raise AtcError(
                    f"{frame.source}: atoms of type {int(frame.types.max())} but types= of {self.name} has "
                    f"{len(types)} entries: one for each type, None for those left out"
                )
            found = numbers[frame.types].astype(np.int64)
            return found, None if (found >= 0).all() else np.flatnonzero(found >= 0).astype(np.int32)
        if types is None:
            types = self._named(frame)
        found, who = ElementMap(types, self.species, self.name).apply(frame)
        return found.astype(np.int64), who

    def _named(self, frame: Frame):
        """The species of each type, by the names that the trajectory has for its types."""
        present = [int(t) for t in np.unique(frame.types)]
        names = {t: frame.type_names.get(t) for t in present}
        unknown = [t for t in present if names[t] not in self.species]
        if unknown and len(self.species) == 1 and len(present) == 1 and names[present[0]] is None:
            return [self.species[0]] * present[0]
        if unknown:
            named = [str(names[t]) for t in unknown if names[t] is not None]
            raise AtcError(
                f"{frame.source}: {self.name} has the species {', '.join(self.species[:12])}"
                f"{' ...' if len(self.species) > 12 else ''}, but types {', '.join(map(str, unknown))} are "
                f"{', '.join(named) or 'not named'}: say the species of each type, types={self.species[:3]!r}, say"
            )
        return [names.get(t) for t in range(1, max(present, default=0) + 1)]

    def prepare(self, frame: Frame) -> Work:
        return EdgeWork(self, frame)

    # --- the model

    def evaluate(self, part, species_n, place: Place, velocities_nc, source: str):
        """`messages.gradient` of a part of a frame, in the model's units."""
        import torch

        from . import messages

        dtype = getattr(torch, self.precision)
        before, threads = torch.get_default_dtype(), torch.get_num_threads()
        try:
            torch.set_default_dtype(dtype)
            torch.set_num_threads(max(1, int(self._threads)))
            energies = self.energies if isinstance(self.energies, OfInputs) else _OfEdges(self.energies)
            at = messages.Inputs(part, species_n, dtype, self.device, place if energies.positions else None)
            return messages.gradient(energies, at, velocities_nc)
        except AtcError:
            raise
        except messages.NoGradient as e:
            raise AtcError(f"{source}: {self.name}: {e}") from None
        except Exception as e:  # of whatever function it is
            raise AtcError(f"{source}: {self.name} cannot be evaluated: {first_line(e)}") from None
        finally:
            torch.set_default_dtype(before)
            torch.set_num_threads(threads)

    def look(self, edges: Edges, species_n, place: Place, source: str, sources: bool) -> int | None:
        """Once: does what the energy of an atom depends on end where `hops` says? Returns how many atoms fit into the
        memory at once, None for all of them."""
        from . import messages

        if not self._looked:
            k = np.diff(edges.start)
            probe = int(np.argmax(k)) if len(k) else 0
            part = edges.around(np.array([probe]), self.hops + 1) if len(k) else None
            if part is not None and len(part):
                inner = np.zeros(len(edges), bool)
                inner[edges.around(np.array([probe]), self.hops).edges] = True
                beyond = ~inner[part.edges]
                g = self.evaluate(part, species_n, place, None, source).g_ec
                size = np.abs(g).max(initial=0.0)
                if np.isfinite(size) and beyond.any() and np.abs(g[beyond]).max() > 1e-12 * size:
                    raise AtcError(
                        f"{source}: {self.name}: the energy of an atom depends on edges that start more than "
                        f"{self.hops - 1} neighbours away from it, so it has more than hops={self.hops} layers: say "
                        "how many there are (models with terms of all atoms at once, a mean or charges, have none)"
                    )
            self._looked = True
        if self.batch is not None:
            return self.batch if self.batch < edges.n else None
        if len(edges) <= _SMALL:
            return None
        if self._per_edge is None:
            some = edges.around(np.arange(min(32, edges.n)), self.hops)
            with messages.SavedBytes() as saved:
                self.evaluate(some, species_n, place, None, source)
            self._per_edge = saved.bytes / max(1, len(some))
        free = free_memory(self.device) * _PART_OF_MEMORY / (_FLUX_MEMORY if sources else 1.0)
        most = max(1.0, free / max(1.0, self._per_edge))  # edges
        return None if len(edges) <= most else self._fitting(edges, most)

    def _fitting(self, edges: Edges, most: float) -> int:
        """How many atoms, with what is around them, have so many edges."""
        batch = edges.n
        while batch > 1:
            first = np.arange(edges.n // 2, min(edges.n, edges.n // 2 + batch))
            if len(edges.around(first, self.hops)) <= most:
                break
            batch = batch // 2
        return batch

    def __getstate__(self):
        try:
            pickle.dumps(self.energies)
        except Exception:
            raise AtcError(
                f"{self.name}: its function cannot be sent to other processes: define it in a module, or use threads "
                "instead of workers"
            ) from None
        return dict(self.__dict__)


def _types(types, species, name):
    if types is None:
        return None
    if isinstance(types, str) or not hasattr(types, "__iter__"):
        raise AtcError(f"{name}: types must be a list, one entry for each atom type from 1, got {types!r}")
    types = [None if t in (None, "NULL") else t for t in types]
    if species is not None:
        types = [None if t is None else str(t) for t in types]
        ElementMap(types, species, name)  # which says what is wrong with them
        return types
    if not all(t is None or (isinstance(t, (int, np.integer)) and t >= 0) for t in types):
        raise AtcError(f"{name}: types: without species= expected numbers of 0 or more (None: left out), got {types!r}")
    return [None if t is None else int(t) for t in types]


def edge_model(
    energies,
    *,
    cutoff,
    hops=1,
    units,
    types=None,
    stress="edge",
    species=None,
    reference=None,
    batch=None,
    device="cpu",
    precision="float64",
    name="energies of edges",
) -> Potential:
    """A potential whose energy is a sum of atoms' energies, each a function of edges, written in torch.

    Forces and stress come from one backward pass, heat flux from two more, whatever the number of layers. Both balance
    momentum and energy to rounding; see docs/machine_learned.md.

    Parameters
    ----------
    energies : function ``(r_ec, centre_e, neighbour_e, types_n) -> U_n`` of tensors. r_ec (e, 3): from the atom
        `centre_e` to its neighbour `neighbour_e`, through whichever periodic image, in the unit of length of `units`;
        both directions of every pair within the cutoff, ordered by centre. types_n (n,): int64. U_n (n,): the energy of
        each atom, in the unit of energy of `units`. It may be called with some of the atoms of a frame.
    cutoff : length of the longest edge
    hops : how many layers of messages there are: the energy of an atom may depend on edges that start at most
        ``hops - 1`` neighbours away from it. Checked.
    units : unit style
    types : what `energies` gets in types_n. A list with an entry for each atom type from 1: a number, or with `species`
        one of its names; None or "NULL" for atoms that do not interact. Default: the types as they are, or with
        `species` by the names that the trajectory has for its types.
    stress : "edge", the gradient of the energy by the edges: forces across them, a stress of nine components that is
        not symmetric at a point, no churning. "central", for one hop only: forces along the distances of an atom and
        its neighbours, the ones of least norm with weights that vanish at the cutoff: symmetric, seven times the bonds.
    species : names for the numbers 0, 1, … in types_n
    reference : energies of single atoms to subtract, {species or number: energy}, or "isolated" to ask the model. They
        matter to energies and, in mixtures, to the heat flux (ε v and the kinetic part carry them).
    batch : atoms to evaluate at once. Default: all, or as many as fit into the memory; what is around them comes along,
        so that nothing changes.
    device : of torch. precision : "float64" or "float32"
    name : what to call it in messages and outputs

    Returns
    -------
    Potential

    Raises
    ------
    AtcError for arguments that make no sense, without torch; for a frame whose energies do not follow from the edges,
    reach further than `hops`, whose virial is not symmetric, or where the power that edges carry is not, atom by atom,
    the change of its energy: then nothing is put out.

    Examples
    --------
    >>> def energies(r, c, n, types):                                                            # doctest: +SKIP
    ...     d2 = (r * r).sum(1)
    ...     s6 = (3.4**2 / d2) ** 3
    ...     U = 0.5 * 4 * 0.0104 * (s6 * s6 - s6)
    ...     return torch.zeros(len(types), dtype=r.dtype).index_add(0, c, U)
    >>> pot = atc.edge_model(energies, cutoff=8.5, hops=1, units="metal")                        # doctest: +SKIP
    """
    term = EdgeModel(
        energies,
        cutoff,
        hops,
        units=units,
        types=types,
        stress=stress,
        species=species,
        reference=reference,
        batch=batch,
        device=device,
        precision=precision,
        name=name,
    )
    return Potential([term], units)
