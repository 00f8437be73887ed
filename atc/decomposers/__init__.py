"""Potentials as sums of bonds: every interaction becomes pairs of atoms with G = ∂U/∂ξ.

`potential` makes a model from LAMMPS lines, a LAMMPS input script, or the objects named here.
"""

from __future__ import annotations

from importlib import import_module

#: Files that register LAMMPS styles when they are imported, and what of them is public.
_STYLES = {
    "pairs.lennard_jones": "LennardJones LennardJonesSmoothLinear LennardJonesQuadratic LennardJonesExpand",
    "pairs.morse": "Morse MorseSmoothLinear Pedone MOMB",
    "pairs.buckingham": "Buckingham Born",
    "pairs.yukawa": "Yukawa",
    "pairs.soft": "Soft",
    "pairs.table": "Table",
    "pairs.coulomb": "CoulombCut CoulombDSF CoulombWolf",
    "pairs.zbl": "ZBL",
    "pairs.zero": "",
    "pairs.inverse_powers": "Mie NM LennardJones96 Class2 Spica",
    "pairs.mdf": "LennardJonesMDF LennardMDF BuckinghamMDF",
    "pairs.gromacs": "LennardJonesGromacs CoulombGromacs",
    "pairs.charmm": "LennardJonesCharmm LennardJonesCharmmFSW CoulombCharmm CoulombCharmmImplicit CoulombCharmmFSH",
    "pairs.lj_smooth": "LennardJonesSmooth LennardJonesCubic RelativeResolution",
    "pairs.gauss": "Gauss GaussCut BornGauss UhlenbeckFord",
    "pairs.beck": "Beck",
    "pairs.pirani": "Pirani",
    "pairs.finite_range": "WangFrenkel CosineSquared HarmonicCut DPD",
    "pairs.colloid": "Colloid",
    "pairs.screened_coulomb": "CoulombDebye CoulombSlater CoulombDiel",
    "pairs.soft_core": "LennardJonesSoft Class2Soft CoulombSoft MorseSoft",
    "pairs.with_coulomb": "",
    "pairs.coulomb_long": "CoulombLong",
    "pairs.tip4p": "TIP4P",
    "lepton": "",
    "pairs.listed": "ListedPairs",
    "many_body.stillinger_weber": "StillingerWeber StillingerWeberMod",
    "bonded.bond": "HarmonicBond MorseBond FeneBond FeneExpandBond TableBond ZeroBond",
    "bonded.bond_curves": (
        "Class2Bond GromosBond NonlinearBond HarmonicShiftBond HarmonicShiftCutBond MM3Bond FeneNMBond GaussianBond"
    ),
    "bonded.bond_pairwise": "QuarticBond SpecialBond",
    "bonded.angle": "HarmonicAngle CosineAngle CosineSquaredAngle CosineDeltaAngle CharmmAngle TableAngle ZeroAngle",
    "bonded.angle_curves": (
        "QuarticAngle MM3Angle FourierAngle FourierSimpleAngle CosinePeriodicAngle RestrictedAngle "
        "WormLikeAngle CosineShiftAngle CosineShiftExpAngle GaussianAngle"
    ),
    "bonded.angle_coupled": "Class2Angle Class2P6Angle CrossAngle",
    "bonded.mesocnt": "MesoBond MesoAngle",
    "bonded.dihedral": (
        "HarmonicTorsion CharmmTorsion OPLSTorsion MultiHarmonicTorsion NHarmonicTorsion FourierTorsion ZeroTorsion"
    ),
    "bonded.improper": "HarmonicImproper CvffImproper ZeroImproper",
    "bonded.improper_curves": (
        "UmbrellaImproper FourierImproper InversionHarmonicImproper DistanceImproper DistHarmImproper "
        "SqDistHarmImproper RingImproper Class2Improper CosineSquaredImproper"
    ),
    "bonded.dihedral_curves": "QuadraticTorsion HelixTorsion CosineShiftExpTorsion RestrictedTorsion",
    "bonded.dihedral_coupled": "Class2Torsion SphericalTorsion",
    "bonded.dihedral_table": "TableTorsion TableCutTorsion read_torsion_section",
    "bonded.lepton": "LeptonBond LeptonAngle LeptonTorsion",
    "bonded.angle_spica": "SpicaAngle",
    "many_body.embedded_atom": "EmbeddedAtom",
    "many_body.tersoff": "Tersoff",
    "many_body.tersoff_variants": (
        "TersoffMod TersoffModC TersoffModEntry TersoffModCEntry TersoffZBL TersoffZBLEntry GaoWeber GaoWeberZBL"
    ),
    "many_body.three_body": "Vashishta VashishtaEntry HarmonicTriplets ScreenedTriplets",
    "many_body.angular_dependent": "AngularDependent",
    "many_body.edip": "EDIP EDIPEntry",
    "many_body.meam": "MEAM",
    "many_body.embedded_ion": "EmbeddedIon",
    "many_body.spline_meam": "SplineMEAM",
    "many_body.local_density": "LocalDensity",
    "many_body.concentration_eam": "ConcentrationEAM",
    "many_body.polymorphic": "Polymorphic",
    "many_body.axilrod_teller": "AxilrodTeller",
    "pairs.spin_exchange": "SpinExchange",
    "pairs.electron_force_field": "ElectronForceField",
    "many_body.snap": "SNAP",
    "many_body.nep": "NEP",
}
#: Likewise what stands elsewhere.
_OTHERS = {
    "base": "Decomposition Term",
    "potentials": "Potential",
    "pairs.pairs": "Pairs PairStyle",
    "long_range.ewald": "LongRangeCoulomb",
    "pairs.generic": "Generic",
    "pairs.special_bonds": "SpecialBonds",
    "many_body.stillinger_weber_file": "SWEntry",
    "bonded.topology": "HybridTerm",
    "bonded.table": "read_tables",
    "many_body.eam_file": "EAMTables",
    "many_body.tersoff_file": "TersoffEntry",
    "many_body.of_distances": "ManyBody",
    "constraints.held": "Constraints",
    "constraints.virtual_sites": "VirtualSites",
    "constraints.rules": "AllBonds HeldPairs HydrogenBonds RigidMolecules Shake",
}
_WHERE = {name: module for module, names in (_STYLES | _OTHERS).items() for name in names.split()}

__all__ = [*_WHERE, "potential"]


def __getattr__(name):
    if name in _WHERE:
        value = getattr(import_module(f".{_WHERE[name]}", __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted(__all__)


def potential(
    source,
    units=None,
    *,
    special_bonds=None,
    folder=None,
    name=None,
    partition=None,
    run=None,
    trajectory=(),
    alpha=None,
    **openmm,
):
    """A model of the interactions, ready to decompose frames.

    Parameters
    ----------
    source : str, path, Term, PairStyle, list of these, or Potential
        LAMMPS lines (a string with several lines, or one that starts with a LAMMPS command), the path of a LAMMPS input
        script, which is executed as LAMMPS does (variables, conditions, loops, included files) up to its runs, or
        objects of `atc.decomposers`; or a System of OpenMM, its XML (system.xml), or a file that OpenMM's readers make
        one from: AMBER (prmtop, parm7), CHARMM (psf), GROMACS (top).
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
    alpha : float, optional
        For long-range Coulomb only (``kspace_style``): the α of Ewald's split, 1 over the potential's unit of length,
        which local values depend on. Default: 4.05 over the script's Coulomb cutoff.
    **openmm
        For systems of OpenMM, AMBER, CHARMM and GROMACS, what the file does not say of the run: ``method`` ("PME",
        "CutoffPeriodic", ...), ``cutoff`` and ``switch`` in Å, ``switching`` ("potential-switch", "force-switch",
        "vfswitch"), ``chiral`` (torsions that tell a molecule from its mirror image, by forces across bonds),
        ``constraints`` ("hbonds", ...), ``rigid_water``, ``parameters`` (CHARMM's files), ``defines`` and ``include``
        (GROMACS).

    Returns
    -------
    Potential

    Raises
    ------
    AtcError that names the file and line: unsupported style, wrong or missing coefficients, unknown units, missing
    file.
    """
    pot = _made(source, units, special_bonds, folder, name, run, trajectory, openmm)
    if alpha is not None:
        from .long_range.kspace import with_alpha

        pot = with_alpha(pot, alpha)
    return pot if partition is None else pot.partitioned(partition)


def _made(source, units, special_bonds, folder, name, run, trajectory, openmm):
    """`potential` without what changes it afterwards."""
    from pathlib import Path

    from ..errors import AtcError
    from .base import Term
    from .pairs.pairs import Pairs, PairStyle
    from .potentials import Potential

    if isinstance(source, Potential):
        return source
    from .openmm import is_openmm, potential_from_openmm

    if is_openmm(source):
        if units is not None or special_bonds is not None or run is not None:
            raise AtcError(
                "units, special_bonds and run go with LAMMPS lines: a System of OpenMM says all of it itself"
            )
        return potential_from_openmm(
            source if folder is None or not isinstance(source, str) else Path(folder) / source, **openmm
        )
    if openmm:
        raise AtcError(f"{next(iter(openmm))} goes with systems of OpenMM, AMBER, CHARMM and GROMACS: leave it out")
    if isinstance(source, str | Path):
        if special_bonds is not None:
            raise AtcError("special_bonds= goes with objects; in LAMMPS lines write a special_bonds line")
        for module in _STYLES:
            import_module(f".{module}", __name__)
        from .lammps import potential_from_lammps

        return potential_from_lammps(source, units, folder, name, run, trajectory)
    parts = list(source) if isinstance(source, list | tuple) else [source]
    styles = [p for p in parts if isinstance(p, PairStyle)]
    terms = [p for p in parts if isinstance(p, Term)]
    if len(styles) + len(terms) != len(parts) or not parts:
        odd = next((p for p in parts if not isinstance(p, PairStyle | Term)), None)
        if hasattr(odd, "get_potential_energy") or hasattr(odd, "get_property"):
            raise AtcError(
                f"{type(odd).__name__}: a calculator of ASE gives the force on each atom, and a stress field needs "
                "that of each pair of atoms: give the same model as LAMMPS lines, or a machine-learned one by "
                "atc.mace(model), atc.nequip(file), atc.metatomic(file), atc.nep(file), or a function of edges by "
                "atc.edge_model"
            )
        raise AtcError(
            "a potential is made from LAMMPS lines, a LAMMPS input script, or objects of atc.decomposers, not from "
            f"{type(odd).__name__}"
        )
    known = {p.units.name: p.units for p in parts if p.units is not None}
    if units is None:
        if not known:
            raise AtcError("say which units the potential is in: units='metal' (or lj, real, ...)")
        units = next(iter(known.values()))
    from ..units import require_compatible
    from ..units import units as get_units

    for u in known.values():
        require_compatible(get_units(units), u, "the potential", "one of its parts")
    if styles:
        from .pairs.special_bonds import SpecialBonds

        special = SpecialBonds.from_lines([(special_bonds.split(), "special_bonds")] if special_bonds else [])
        terms.insert(0, Pairs(styles, min(s.n_types for s in styles), special))
    return Potential(terms, units)
