"""The commands of LAMMPS input scripts (manual, "Commands by category" and the command styles of its packages): what is none is a slip of the pen."""

from __future__ import annotations

import difflib
import warnings

from ...errors import AtcError, AtcWarning

#: Commands that define the model.
MODEL = (
    "angle_coeff angle_style atom_style bond_coeff bond_style dielectric dihedral_coeff dihedral_style dimension hybrid improper_coeff improper_style include "
    "kspace_modify kspace_style labelmap mass pair_coeff pair_modify pair_style read_data special_bonds units variable"
).split()
COMMANDS = frozenset(MODEL) | frozenset(
    (
        "angle_write atom_modify balance bond_write boundary box change_box clear comm_modify comm_style compute compute_modify create_atoms create_bonds "
        "create_box delete_atoms delete_bonds derived_thermo dihedral_write displace_atoms dump dump_modify dynamical_matrix echo fitpod fix fix_modify geturl group "
        "group2ndx hyper if info jump kim kim_init kim_interactions kim_param kim_property kim_query label lattice log mdi message min_modify min_style minimize "
        "minimize/kk molecule ndx2group neb neb/spin neigh_modify neighbor newton next package pair_write partition plugin prd print processors python quit "
        "read_dump read_restart region region2vmd replicate rerun reset_atom_ids reset_atoms reset_ids reset_mol_ids reset_timestep restart run run_style server "
        "set shell suffix tad temper temper/grem temper/npt thermo thermo_modify thermo_style third_order timer timestep uncompute undump unfix velocity "
        "write_coeff write_data write_dump write_restart dynamical_matrix/kk third_order/kk"
    ).split()
)


def check_known(name: str, where: str, script: bool) -> None:
    """Complain of a word that is no LAMMPS command: in pasted lines always, in a script (which has run, so that it may know more) where it looks like a slip."""
    if name in COMMANDS:
        return
    near = difflib.get_close_matches(name, MODEL, n=1, cutoff=0.75)
    if near or not script:
        hint = f"did you mean {near[0]}?" if near else "correct it or leave it out"
        raise AtcError(f"{where}: {name!r} is not a LAMMPS command: {hint}")
    warnings.warn(f"{where}: {name!r} is not a command of LAMMPS that atc knows: it is ignored", AtcWarning, stacklevel=2)
