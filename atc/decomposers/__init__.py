"""Potentials as sums of bonds: every interaction becomes pairs of atoms with G = ∂U/∂ξ.

`potential` makes a model from LAMMPS lines, a LAMMPS input script, or the objects named here.
"""

from __future__ import annotations

from importlib import import_module

_WHERE = {
    "Potential": "base",
    "Decomposition": "base",
    "Term": "base",
    "Pairs": "pair",
    "SNAP": "snap",
    "PairStyle": "pair",
    "LennardJones": "lennard_jones",
    "LennardJonesSmoothLinear": "lennard_jones",
    "LennardJonesQuadratic": "lennard_jones",
    "LennardJonesExpand": "lennard_jones",
    "Morse": "morse",
    "Buckingham": "buckingham",
    "Born": "buckingham",
    "Yukawa": "yukawa",
    "Soft": "soft",
    "Table": "table",
    "CoulombCut": "coulomb",
    "CoulombDSF": "coulomb",
    "CoulombWolf": "coulomb",
    "CoulombLong": "coulomb_long",
    "LongRangeCoulomb": "long_range.ewald",
    "ZBL": "zbl",
    "Mie": "inverse_powers",
    "NM": "inverse_powers",
    "LennardJones96": "inverse_powers",
    "Class2": "inverse_powers",
    "Spica": "inverse_powers",
    "LennardJonesMDF": "mdf",
    "LennardMDF": "mdf",
    "BuckinghamMDF": "mdf",
    "LennardJonesGromacs": "gromacs",
    "CoulombGromacs": "gromacs",
    "LennardJonesCharmm": "charmm",
    "LennardJonesCharmmFSW": "charmm",
    "CoulombCharmm": "charmm",
    "CoulombCharmmImplicit": "charmm",
    "CoulombCharmmFSH": "charmm",
    "LennardJonesSmooth": "lj_smooth",
    "LennardJonesCubic": "lj_smooth",
    "RelativeResolution": "lj_smooth",
    "Gauss": "gauss",
    "GaussCut": "gauss",
    "BornGauss": "gauss",
    "UhlenbeckFord": "gauss",
    "Beck": "beck",
    "Pirani": "pirani",
    "WangFrenkel": "finite_range",
    "CosineSquared": "finite_range",
    "HarmonicCut": "finite_range",
    "DPD": "finite_range",
    "Colloid": "colloid",
    "CoulombDebye": "screened_coulomb",
    "CoulombSlater": "screened_coulomb",
    "CoulombDiel": "screened_coulomb",
    "LennardJonesSoft": "soft_core",
    "Class2Soft": "soft_core",
    "CoulombSoft": "soft_core",
    "MorseSoft": "soft_core",
    "MorseSmoothLinear": "morse",
    "Pedone": "morse",
    "MOMB": "morse",
    "ListedPairs": "pair_list",
    "Generic": "generic",
    "SpecialBonds": "special_bonds",
    "StillingerWeber": "stillinger_weber",
    "SWEntry": "sw_file",
    "HybridTerm": "bonded",
    "read_tables": "bonded_table",
    "HarmonicBond": "bond",
    "MorseBond": "bond",
    "FeneBond": "bond",
    "FeneExpandBond": "bond",
    "TableBond": "bond",
    "ZeroBond": "bond",
    "HarmonicAngle": "angle",
    "CosineAngle": "angle",
    "CosineSquaredAngle": "angle",
    "CosineDeltaAngle": "angle",
    "CharmmAngle": "angle",
    "TableAngle": "angle",
    "ZeroAngle": "angle",
    "HarmonicTorsion": "dihedral",
    "CharmmTorsion": "dihedral",
    "OPLSTorsion": "dihedral",
    "MultiHarmonicTorsion": "dihedral",
    "NHarmonicTorsion": "dihedral",
    "FourierTorsion": "dihedral",
    "HarmonicImproper": "improper",
    "CvffImproper": "improper",
    "Class2Bond": "bond_curves",
    "GromosBond": "bond_curves",
    "NonlinearBond": "bond_curves",
    "HarmonicShiftBond": "bond_curves",
    "HarmonicShiftCutBond": "bond_curves",
    "MM3Bond": "bond_curves",
    "FeneNMBond": "bond_curves",
    "GaussianBond": "bond_curves",
    "QuarticBond": "bond_pairwise",
    "SpecialBond": "bond_pairwise",
    "MesoBond": "mesocnt",
    "LeptonBond": "bonded_lepton",
    "LeptonAngle": "bonded_lepton",
    "LeptonTorsion": "bonded_lepton",
    "SpicaAngle": "angle_spica",
    "MesoAngle": "mesocnt",
    "QuarticAngle": "angle_curves",
    "MM3Angle": "angle_curves",
    "FourierAngle": "angle_curves",
    "FourierSimpleAngle": "angle_curves",
    "CosinePeriodicAngle": "angle_curves",
    "RestrictedAngle": "angle_curves",
    "WormLikeAngle": "angle_curves",
    "CosineShiftAngle": "angle_curves",
    "CosineShiftExpAngle": "angle_curves",
    "GaussianAngle": "angle_curves",
    "Class2Angle": "angle_coupled",
    "Class2P6Angle": "angle_coupled",
    "CrossAngle": "angle_coupled",
    "QuadraticTorsion": "dihedral_curves",
    "HelixTorsion": "dihedral_curves",
    "CosineShiftExpTorsion": "dihedral_curves",
    "RestrictedTorsion": "dihedral_curves",
    "Class2Torsion": "dihedral_coupled",
    "SphericalTorsion": "dihedral_coupled",
    "TableTorsion": "dihedral_table",
    "TableCutTorsion": "dihedral_table",
    "read_torsion_section": "dihedral_table",
    "UmbrellaImproper": "improper_curves",
    "FourierImproper": "improper_curves",
    "InversionHarmonicImproper": "improper_curves",
    "DistanceImproper": "improper_curves",
    "DistHarmImproper": "improper_curves",
    "SqDistHarmImproper": "improper_curves",
    "RingImproper": "improper_curves",
    "Class2Improper": "improper_curves",
    "CosineSquaredImproper": "improper_curves",
    "EmbeddedAtom": "embedded_atom",
    "EAMTables": "eam_file",
    "Tersoff": "tersoff",
    "TersoffEntry": "tersoff_file",
    "TersoffMod": "tersoff_variants",
    "TersoffModC": "tersoff_variants",
    "TersoffModEntry": "tersoff_variants",
    "TersoffZBL": "tersoff_variants",
    "TersoffZBLEntry": "tersoff_variants",
    "GaoWeber": "tersoff_variants",
    "GaoWeberZBL": "tersoff_variants",
    "StillingerWeberMod": "stillinger_weber",
    "Vashishta": "three_body",
    "VashishtaEntry": "three_body",
    "HarmonicTriplets": "three_body",
    "ScreenedTriplets": "three_body",
    "AngularDependent": "angular_dependent",
    "EDIP": "edip",
    "EDIPEntry": "edip",
    "MEAM": "meam",
    "SplineMEAM": "spline_meam",
    "EmbeddedIon": "embedded_ion",
    "LocalDensity": "local_density",
    "ConcentrationEAM": "concentration_eam",
    "Polymorphic": "polymorphic",
    "AxilrodTeller": "axilrod_teller",
    "SpinExchange": "spin_exchange",
    "ElectronForceField": "electron_force_field",
    "ManyBody": "many_body",
    "Constraints": "constraints",
    "HeldPairs": "constraint_rules",
    "HydrogenBonds": "constraint_rules",
    "RigidMolecules": "constraint_rules",
    "Shake": "constraint_rules",
}

__all__ = [*_WHERE, "potential"]


def __getattr__(name):
    if name in _WHERE:
        value = getattr(import_module(f".{_WHERE[name]}", __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted(__all__)


# Modules whose import registers LAMMPS styles.
_STYLE_MODULES = (
    "lennard_jones",
    "morse",
    "buckingham",
    "yukawa",
    "soft",
    "table",
    "coulomb",
    "zbl",
    "zero",
    "inverse_powers",
    "mdf",
    "gromacs",
    "charmm",
    "lj_smooth",
    "gauss",
    "beck",
    "pirani",
    "finite_range",
    "colloid",
    "screened_coulomb",
    "soft_core",
    "with_coulomb",
    "coulomb_long",
    "lepton",
    "pair_list",
    "stillinger_weber",
    "bond",
    "bond_curves",
    "bond_pairwise",
    "angle",
    "angle_curves",
    "angle_coupled",
    "mesocnt",
    "dihedral",
    "improper",
    "improper_curves",
    "dihedral_curves",
    "dihedral_coupled",
    "dihedral_table",
    "bonded_lepton",
    "angle_spica",
    "embedded_atom",
    "tersoff",
    "tersoff_variants",
    "three_body",
    "angular_dependent",
    "edip",
    "meam",
    "embedded_ion",
    "spline_meam",
    "local_density",
    "concentration_eam",
    "polymorphic",
    "axilrod_teller",
    "spin_exchange",
    "electron_force_field",
    "snap",
    "nep",
)


def potential(
    source, units=None, *, special_bonds=None, folder=None, name=None, partition=None, run=None, trajectory=()
):
    """A model of the interactions, ready to decompose frames.

    Parameters
    ----------
    source : str, path, Term, PairStyle, list of these, or Potential
        LAMMPS lines (a string with several lines, or one that starts with a LAMMPS command), the path of a LAMMPS input
        script, which is executed as LAMMPS does (variables, conditions, loops, included files) up to its runs, or
        objects of `atc.decomposers`.
    units : str or Units
        Units of the numbers in LAMMPS lines that have no ``units`` line. For objects: the units that descriptions refer
        to.
    special_bonds : str, optional
        For objects only: what LAMMPS's ``special_bonds`` would say, e.g. ``"lj/coul 0 1 1"``. Default, as in LAMMPS,
        ``0 0 0``: atoms one, two or three bonds apart have no pair interaction, if the frame has bonds.
    folder : path, optional
        For LAMMPS lines only: where the files they name are. Default: the current directory.
    name : str, optional
        For LAMMPS lines only: what messages call them.
    partition : str or dict, optional
        How the energy is shared among the atoms, which heat flux and churning depend on, and energy, forces and stress
        do not: ``"equal"``, ``"center"`` or a dict by term such as ``{"sw": "center"}``; see `Potential.partitioned`.
        Default: ``"equal"`` for LAMMPS lines; objects as they are.

    run : int, optional
        For a script with several runs: the number of the run (counted from 1, ``minimize`` and the like included) that
        the frames belong to. Needed where the model changes from run to run.
    trajectory : paths, optional
        For a script: the files with the frames, which its ``dump`` lines may name, so that `run` need not be given.

    Returns
    -------
    Potential

    Raises
    ------
    AtcError that names the file and line: unsupported style, wrong or missing coefficients, unknown units, missing
    file.
    """
    from pathlib import Path

    from ..errors import AtcError
    from .base import Potential, Term
    from .pair import Pairs, PairStyle

    if partition is not None:
        return potential(
            source, units, special_bonds=special_bonds, folder=folder, name=name, run=run, trajectory=trajectory
        ).partitioned(partition)
    if isinstance(source, Potential):
        return source
    if isinstance(source, str | Path):
        if special_bonds is not None:
            raise AtcError("special_bonds= goes with objects; in LAMMPS lines write a special_bonds line")
        for module in _STYLE_MODULES:
            import_module(f".{module}", __name__)
        from .lammps import potential_from_lammps

        return potential_from_lammps(source, units, folder, name, run, trajectory)
    parts = list(source) if isinstance(source, list | tuple) else [source]
    styles = [p for p in parts if isinstance(p, PairStyle)]
    terms = [p for p in parts if isinstance(p, Term)]
    if len(styles) + len(terms) != len(parts) or not parts:
        odd = next((p for p in parts if not isinstance(p, PairStyle | Term)), None)
        raise AtcError(
            "a potential is made from LAMMPS lines, a LAMMPS input script, or objects of atc.decomposers, not from "
            f"{type(odd).__name__}"
        )
    known = {p.units.name: p.units for p in parts if getattr(p, "units", None) is not None}
    if units is None:
        if not known:
            raise AtcError("say which units the potential is in: units='metal' (or lj, real, ...)")
        units = next(iter(known.values()))
    from ..units import require_compatible
    from ..units import units as get_units

    for u in known.values():
        require_compatible(get_units(units), u, "the potential", "one of its parts")
    if styles:
        from .special_bonds import SpecialBonds

        special = SpecialBonds.from_lines([(special_bonds.split(), "special_bonds")] if special_bonds else [])
        terms.insert(0, Pairs(styles, min(s.n_types for s in styles), special))
    return Potential(terms, units)
