"""The KIM API's C interface, as far as energies and their derivatives by distances need it (openkim.org, version 2)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_double, c_int, c_void_p
from functools import cache

import numpy as np

from ...errors import AtcError


class _Name(ctypes.Structure):
    """Every enumeration of the interface is one of these, by value."""

    _fields_ = (("id", c_int),)


_NEIGHBORS = ctypes.CFUNCTYPE(
    c_int, c_void_p, c_int, POINTER(c_double), c_int, c_int, POINTER(c_int), POINTER(POINTER(c_int))
)
_DEDR = ctypes.CFUNCTYPE(c_int, c_void_p, c_double, c_double, POINTER(c_double), c_int, c_int)


@cache
def shared_object():
    """The shared library.

    Raises
    ------
    AtcError where there is none.
    """
    import ctypes.util

    for name in (ctypes.util.find_library("kim-api"), "libkim-api.so.2", "libkim-api.2.dylib"):
        try:
            found = ctypes.CDLL(name) if name else None
        except OSError:
            continue
        if found is not None:
            # Its messages go to a file kim.log otherwise, wherever one is.
            found.KIM_Log_PushDefaultVerbosity(_Name.in_dll(found, "KIM_LOG_VERBOSITY_silent"))
            found.KIM_SpeciesName_FromString.restype = _Name
            found.KIM_ComputeArguments_SetCallbackPointer.argtypes = [c_void_p, _Name, _Name, c_void_p, c_void_p]
            return found
    raise AtcError("kim: the KIM API is not installed: e.g. apt install libkim-api-dev openkim-models (openkim.org)")


def _constant(name) -> _Name:
    return _Name.in_dll(shared_object(), f"KIM_{name}")


class Model:
    """A portable model in Å and eV.

    Attributes
    ----------
    influence : how far an atom may be that an atom's energy depends on. cutoffs : of the lists of neighbours it wants
    """

    def __init__(self, name: str):
        self.name, self._model, self._arguments = name, c_void_p(), c_void_p()
        lib, accepted = shared_object(), c_int()
        units = ("LENGTH_UNIT_A", "ENERGY_UNIT_eV", "CHARGE_UNIT_e", "TEMPERATURE_UNIT_K", "TIME_UNIT_ps")
        failed = lib.KIM_Model_Create(
            _constant("NUMBERING_zeroBased"),
            *(_constant(unit) for unit in units),
            str(name).encode(),
            byref(accepted),
            byref(self._model),
        )
        if failed:
            self._model = c_void_p()
            raise AtcError(
                f"kim: no portable model {name!r} is installed, or it does not work (kim-api-collections-management "
                "list says which there are; simulator models are scripts of LAMMPS: give their lines)"
            )
        if not accepted.value:
            raise AtcError(f"kim: {name} does not work in Å and eV")
        d, count, cutoffs, none = c_double(), c_int(), POINTER(c_double)(), POINTER(c_int)()
        lib.KIM_Model_GetInfluenceDistance(self._model, byref(d))
        lib.KIM_Model_GetNeighborListPointers(self._model, byref(count), byref(cutoffs), byref(none))
        self.influence, self.cutoffs = d.value, [cutoffs[k] for k in range(count.value)]
        if lib.KIM_Model_ComputeArgumentsCreate(self._model, byref(self._arguments)):
            raise AtcError(f"kim: {name} cannot be evaluated")
        self._support()

    def _support(self):
        """What it gives, and that nothing is missing."""
        lib, status = shared_object(), _Name()
        lib.KIM_ComputeArguments_GetCallbackSupportStatus(
            self._arguments, _constant("COMPUTE_CALLBACK_NAME_ProcessDEDrTerm"), byref(status)
        )
        no = _constant("SUPPORT_STATUS_notSupported").id
        if status.id == no:
            raise AtcError(
                f"kim: {self.name} does not give the derivatives of its energy by distances (ProcessDEDrTerm): a model "
                "that does is needed"
            )
        self.shares = True
        for what in ("partialEnergy", "partialParticleEnergy"):
            lib.KIM_ComputeArguments_GetArgumentSupportStatus(
                self._arguments, _constant(f"COMPUTE_ARGUMENT_NAME_{what}"), byref(status)
            )
            if status.id == no and what == "partialEnergy":
                raise AtcError(f"kim: {self.name} gives no energy")
            self.shares &= status.id != no

    def code(self, element: str) -> int:
        """The number of an element; AtcError if it has none."""
        lib, known, code = shared_object(), c_int(), c_int()
        species = lib.KIM_SpeciesName_FromString(element.encode())
        if lib.KIM_Model_GetSpeciesSupportAndCode(self._model, species, byref(known), byref(code)) or not known.value:
            raise AtcError(f"kim: {self.name} has no element {element!r}")
        return code.value

    def evaluate(self, x_pc, code_p, contributing_p, lists):
        """Energy, energies of the particles (zeros where it gives none), and every derivative by a distance.

        Parameters
        ----------
        x_pc : (p, 3) Å. code_p, contributing_p : (p,) int32
        lists : for each of the cutoffs (start (p + 1,), neighbours) int32

        Returns
        -------
        energy, energies_p, i, j (int), r_bc = x_i − x_j, dEdr/r; None if it fails
        """
        lib, found = shared_object(), []
        count, energy, energies = c_int(len(x_pc)), c_double(), np.zeros(len(x_pc))

        def neighbors(_, n_lists, cutoffs, which, particle, out_n, out):
            start, other = lists[which]
            first, last = int(start[particle]), int(start[particle + 1])
            out_n[0] = last - first
            out[0] = ctypes.cast(other.ctypes.data + 4 * first, POINTER(c_int))
            return 0

        def derivative(_, de, r, dx, i, j):
            found.append((i, j, -dx[0], -dx[1], -dx[2], de / r))
            return 0

        calls = _NEIGHBORS(neighbors), _DEDR(derivative)
        integers = {
            "numberOfParticles": byref(count),
            "particleSpeciesCodes": code_p,
            "particleContributing": contributing_p,
        }
        doubles = {"coordinates": x_pc, "partialEnergy": byref(energy)}
        if self.shares:
            doubles["partialParticleEnergy"] = energies
        for kind, values in (("Integer", integers), ("Double", doubles)):
            put = getattr(lib, f"KIM_ComputeArguments_SetArgumentPointer{kind}")
            for name, value in values.items():
                at = value.ctypes.data_as(c_void_p) if isinstance(value, np.ndarray) else value
                put(self._arguments, _constant(f"COMPUTE_ARGUMENT_NAME_{name}"), at)
        language = _constant("LANGUAGE_NAME_c")
        for name, call in zip(("GetNeighborList", "ProcessDEDrTerm"), calls):
            lib.KIM_ComputeArguments_SetCallbackPointer(
                self._arguments, _constant(f"COMPUTE_CALLBACK_NAME_{name}"), language, ctypes.cast(call, c_void_p), None
            )
        ready = c_int()
        lib.KIM_ComputeArguments_AreAllRequiredArgumentsAndCallbacksPresent(self._arguments, byref(ready))
        if not ready.value or lib.KIM_Model_Compute(self._model, self._arguments):
            return None
        table = np.array(found, float).reshape(-1, 6)
        return energy.value, energies, table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:5], table[:, 5]

    def __del__(self):
        if self._arguments:
            shared_object().KIM_Model_ComputeArgumentsDestroy(self._model, byref(self._arguments))
        if self._model:
            shared_object().KIM_Model_Destroy(byref(self._model))

    def __reduce__(self):
        return Model, (self.name,)
