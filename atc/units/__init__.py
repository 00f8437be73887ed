"""Unit systems: from the user's units to the internal ones and back.

Inside atc there is one consistent system: Å, eV, amu, elementary charge, kelvin, and the time unit that makes
amu Å²/t² one eV (about 10.18 fs; ASE's). LAMMPS style ``lj`` stays reduced: every factor is 1.

Each LAMMPS style keeps LAMMPS's *own* constants (its Boltzmann constant, its mvv2e, its nktv2p ...), so that energies,
pressures and temperatures agree with LAMMPS to rounding instead of to the seventh digit of a physical constant.
The numbers are those of ``Update::set_units`` in LAMMPS and are checked against a running LAMMPS in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt

from ..errors import AtcError

# CODATA 2018; exact by definition of the SI except the atomic mass and the Bohr radius.
_E_CHARGE = 1.602176634e-19  # C, and J per eV
_AMU = 1.66053906660e-27  # kg
_AVOGADRO = 6.02214076e23
_BOHR = 0.529177210903  # Å
_HARTREE = 27.211386245988  # eV
_STATCOULOMB = 3.33564095198152e-10  # C

_KCAL_MOL = 4184.0 / (_AVOGADRO * _E_CHARGE)  # eV
_KJ_MOL = 1000.0 / (_AVOGADRO * _E_CHARGE)  # eV


@dataclass(frozen=True)
class Units:
    """One unit system. ``length``, ``energy``, ``mass``, ``charge`` and ``velocity`` are the sizes of its units in
    internal units; the constants ``boltzmann`` and ``coulomb`` are in internal units (energy/temperature, and
    energy·length/charge²).

    ``dimension`` is 3, or 2 for runs in a plane (`planar`): what is per volume is per area then. ``pressure`` and
    ``density`` are LAMMPS's for it: pressure times length and density times length, since LAMMPS puts the area where
    the volume stands otherwise."""

    name: str
    length: float
    energy: float
    mass: float
    charge: float
    velocity: float
    boltzmann: float
    coulomb: float
    pressure: float
    density: float
    labels: dict = field(default_factory=dict, repr=False, compare=False)
    dimension: int = 3

    @property
    def time(self) -> float:
        """The time unit in internal units, chosen so that length/time is the velocity unit."""
        return self.length / self.velocity

    @property
    def reduced(self) -> bool:
        return self.name == "lj"

    def factor(self, dimension: str) -> float:
        """Size of this system's unit of `dimension` in internal units: internal = factor · user's."""
        return _DIMENSIONS[dimension](self)

    def to_internal(self, dimension: str, value):
        """Convert a number or array from this system's unit of `dimension`."""
        f = self.factor(dimension)
        return value if f == 1.0 else value * f

    def to_user(self, dimension: str, value):
        """Convert a number or array of internal units to this system's unit of `dimension`."""
        f = self.factor(dimension)
        return value if f == 1.0 else value / f

    def label(self, dimension: str) -> str:
        """What to print as the unit of `dimension`, e.g. ``"bar"``."""
        return self.labels[dimension]

    @property
    def planar(self) -> Units:
        """The same units for a run in two dimensions: fields per area, pressure a force per length."""
        if self.dimension == 2:
            return self
        labels = self.labels
        length, energy, time, velocity = (labels[k] for k in ("length", "energy", "time", "velocity"))
        pressure, density = _PER_AREA.get(self.name) or (
            f"{labels['pressure']}*{length}",
            f"{labels['density']}*{length}",
        )
        mass_flow = f"{labels['mass']}*{velocity}" if "/" not in velocity else f"{labels['mass']}*({velocity})"
        area = f"{length}^2"
        flat = {
            "volume": area,
            "number_density": f"1/{area}",
            "pressure": pressure,
            # bar*angstrom times angstrom^2
            "pressure_volume": labels["pressure_volume"] if self.name not in _PER_AREA else f"{pressure}*{area}",
            "density": density,
            "momentum": f"{mass_flow}/{area}",
            "energy_density": f"{energy}/{area}",
            "energy_flux": f"{energy}/({length}*{time})",
            "power_density": f"{energy}/({area}*{time})",
            "conductivity": f"kB/{time}" if self.reduced else f"{energy}/({time}*K)",
            "force_density": f"{energy}/{length}^3"
            if labels["force"] == f"{energy}/{length}"
            else f"{labels['force']}/{area}",
        }
        return replace(
            self,
            dimension=2,
            pressure=self.pressure * self.length,
            density=self.density * self.length,
            labels={**labels, **flat},
        )


# Units of pressure and density per area, of the styles in which these have no name of their own (bar, g/cm^3).
_PER_AREA = {
    "lj": ("epsilon/sigma^2", "m/sigma^2"),
    "si": ("Pa*m", "kg/m^2"),
    "cgs": ("dyne/cm", "g/cm^2"),
    "micro": ("pg/us^2", "pg/um^2"),
    "nano": ("ag/ns^2", "ag/nm^2"),
    "electron": ("Pa*bohr", "amu/bohr^2"),
    "ase": ("eV/angstrom^2", "amu/angstrom^2"),
    "gpumd": ("eV/angstrom^2", "amu/angstrom^2"),
    "mdanalysis": ("kJ/(mol*angstrom^2)", "amu/angstrom^2"),
}

_DIMENSIONS = {
    "dimensionless": lambda u: 1.0,
    "temperature": lambda u: 1.0,
    "length": lambda u: u.length,
    "volume": lambda u: u.length**u.dimension,
    "number_density": lambda u: u.length**-u.dimension,
    "energy": lambda u: u.energy,
    "mass": lambda u: u.mass,
    "charge": lambda u: u.charge,
    "velocity": lambda u: u.velocity,
    "time": lambda u: u.time,
    "rate": lambda u: 1.0 / u.time,
    "force": lambda u: u.energy / u.length,
    "pressure": lambda u: u.pressure,
    "pressure_volume": lambda u: u.pressure * u.length**u.dimension,
    "density": lambda u: u.density,
    "momentum": lambda u: u.mass * u.velocity / u.length**u.dimension,
    "energy_density": lambda u: u.energy / u.length**u.dimension,
    "energy_flux": lambda u: u.energy / (u.length ** (u.dimension - 1) * u.time),
    "energy_current": lambda u: u.energy * u.velocity,
    "power_density": lambda u: u.energy / (u.length**u.dimension * u.time),
    "conductivity": lambda u: u.energy / (u.time * u.length ** (u.dimension - 2)),
    "force_density": lambda u: u.energy / u.length ** (u.dimension + 1),
}


def _make(
    name, labels, *, length=1.0, energy=1.0, mass=1.0, charge=1.0, mvv2e=1.0, boltz=1.0, qqr2e=1.0, nktv2p=1.0, mv2d=1.0
):
    """Build a system from the size of its units and the conversion constants as LAMMPS defines them."""
    len_, en, ma, ve, ti, pr, de, ch = labels.split()
    vol = f"{len_}^3"
    full = {
        "dimensionless": "1",
        "temperature": "epsilon/kB" if name == "lj" else "K",
        "length": len_,
        "volume": vol,
        "number_density": f"1/{vol}",
        "energy": en,
        "mass": ma,
        "charge": ch,
        "velocity": ve,
        "time": ti,
        "rate": f"1/{ti}",
        "force": f"{en}/{len_}",
        "pressure": pr,
        "pressure_volume": f"{pr}*{vol}",
        "density": de,
        "momentum": f"{ma}*{ve}/{vol}" if "/" not in ve else f"{ma}*({ve})/{vol}",
        "energy_density": f"{en}/{vol}",
        "energy_flux": f"{en}/({len_}^2*{ti})",
        "energy_current": f"{en}*{ve}" if "/" not in ve else f"{en}*({ve})",
        "power_density": f"{en}/({vol}*{ti})",
        "conductivity": "kB/(sigma*tau)" if name == "lj" else f"{en}/({ti}*{len_}*K)",
        "force_density": f"{en}/{len_}^4",
    }
    # Where force has a unit of its own.
    named = {"si": "N", "cgs": "dyne"}.get(name)
    if named:
        full.update(force=named, force_density=f"{named}/{vol}")
    return Units(
        name=name,
        length=length,
        energy=energy,
        mass=mass,
        charge=charge,
        velocity=sqrt(mvv2e * energy / mass),
        boltzmann=boltz * energy,
        coulomb=qqr2e * energy * length / charge**2,
        pressure=energy / length**3 / nktv2p,
        density=mass / length**3 / mv2d,
        labels=full,
    )


# Labels: length, energy, mass, velocity, time, pressure, density, charge.
# fmt: off
_SYSTEMS = {u.name: u for u in (
    _make("lj", "sigma epsilon m sigma/tau tau epsilon/sigma^3 m/sigma^3 q*"),
    _make("real", "angstrom kcal/mol g/mol angstrom/fs fs atm g/cm^3 e",
          energy=_KCAL_MOL, mvv2e=48.88821291 * 48.88821291, boltz=0.0019872067, qqr2e=332.06371, nktv2p=68568.415,
          mv2d=1.0 / 0.602214129),
    _make("metal", "angstrom eV g/mol angstrom/ps ps bar g/cm^3 e",
          mvv2e=1.0364269e-4, boltz=8.617343e-5, qqr2e=14.399645, nktv2p=1.6021765e6, mv2d=1.0 / 0.602214129),
    _make("si", "m J kg m/s s Pa kg/m^3 C",
          length=1e10, energy=1.0 / _E_CHARGE, mass=1.0 / _AMU, charge=1.0 / _E_CHARGE, boltz=1.3806504e-23,
          qqr2e=8.9876e9),
    _make("cgs", "cm erg g cm/s s dyne/cm^2 g/cm^3 statC",
          length=1e8, energy=1e-7 / _E_CHARGE, mass=1e-3 / _AMU, charge=_STATCOULOMB / _E_CHARGE,
          boltz=1.3806504e-16),
    _make("electron", "bohr hartree amu bohr/fs fs Pa amu/bohr^3 e",
          length=_BOHR, energy=_HARTREE, mvv2e=1.06657236, boltz=3.16681534e-6, nktv2p=2.94210108e13),
    _make("micro", "um pg*um^2/us^2 pg um/us us pg/(um*us^2) pg/um^3 pC",
          length=1e4, energy=1e-15 / _E_CHARGE, mass=1e-15 / _AMU, charge=1e-12 / _E_CHARGE, boltz=1.3806504e-8,
          qqr2e=8.987556e6),
    _make("nano", "nm ag*nm^2/ns^2 ag nm/ns ns ag/(nm*ns^2) ag/nm^3 e",
          length=10.0, energy=1e-21 / _E_CHARGE, mass=1e-21 / _AMU, boltz=0.013806504, qqr2e=230.7078669),
    # ASE: its own CODATA 2014 constants (ase.units); its time unit is the internal one.
    _make("ase", "angstrom eV amu angstrom/t_ase t_ase eV/angstrom^3 amu/angstrom^3 e",
          boltz=8.617330337217213e-05, qqr2e=14.399645351950548),
    # GPUMD's extended XYZ files: ASE's units but for velocities, in Å/fs; 1 amu (Å/fs)² in eV by CODATA 2018.
    _make("gpumd", "angstrom eV amu angstrom/fs fs eV/angstrom^3 amu/angstrom^3 e",
          mvv2e=1e10 * _AMU / _E_CHARGE, boltz=8.617333262e-05, qqr2e=14.399645),
    # MDAnalysis: Å, ps, amu, kJ/mol; amu (Å/ps)² is 0.01 kJ/mol.
    _make("mdanalysis", "angstrom kJ/mol amu angstrom/ps ps kJ/(mol*angstrom^3) amu/angstrom^3 e",
          energy=_KJ_MOL, mvv2e=0.01, boltz=8.31446261815324e-3, qqr2e=1389.354576),
)}
# fmt: on

LAMMPS_STYLES = ("lj", "real", "metal", "si", "cgs", "electron", "micro", "nano")


def units(name: str | Units) -> Units:
    """The unit system called `name`: a LAMMPS unit style, ``"ase"``, ``"gpumd"`` or ``"mdanalysis"``. Anything else is
    an error."""
    if isinstance(name, Units):
        return name
    try:
        return _SYSTEMS[name]
    except (KeyError, TypeError):
        raise AtcError(f"unknown units {name!r}: expected one of {', '.join(_SYSTEMS)}") from None


def require_compatible(a: Units, b: Units, what_a: str, what_b: str) -> None:
    """Reduced and physical units cannot be mixed: there is no conversion between them."""
    if a.reduced != b.reduced:
        raise AtcError(
            f"{what_a} is in {a.name!r} units and {what_b} in {b.name!r}: reduced (lj) and physical units cannot be "
            "mixed; give both in the same system"
        )
