"""Every command of LAMMPS (manual, "General commands" and the command styles of its packages) and what it means to the
forces of a frame.

model      defines which forces act: styles, coefficients, weights
atoms      makes, changes or names atoms, bonds and the box before the run (`setup`)
control    decides which lines are executed, and with which values
run        moves atoms: what comes after it belongs to the next run
fix        see `fixes`
harmless   changes no force of a given frame
refused    changes the model in a way that its line does not say
"""

from __future__ import annotations

import difflib
import warnings

from ...errors import AtcError, AtcWarning

#: class → ((reason, commands), ...)
_CLASSES = {
    "model": (
        (
            "defines which forces act",
            "angle_coeff angle_style atom_style bond_coeff bond_style dielectric dihedral_coeff dihedral_style "
            "dimension improper_coeff improper_style kspace_modify kspace_style labelmap mass pair_coeff pair_modify "
            "pair_style read_data special_bonds units clear",
        ),
    ),
    "atoms": (
        (
            "makes, changes or names atoms, bonds and the box",
            "boundary change_box create_atoms create_bonds create_box delete_atoms delete_bonds displace_atoms group "
            "lattice molecule neigh_modify read_dump "
            "region replicate reset_atom_ids reset_atoms reset_ids reset_mol_ids set ndx2group",
        ),
    ),
    "control": (
        (
            "decides which lines are executed, and with which values",
            "if include jump label next partition print quit shell variable python",
        ),
    ),
    "run": (
        (
            "moves atoms",
            "run minimize minimize/kk rerun hyper neb neb/spin prd tad temper temper/grem temper/npt server",
        ),
    ),
    "fix": (("see the table of fixes", "fix unfix"),),
    "harmless": (
        (
            "measures or writes",
            "angle_write bond_write compute compute_modify dihedral_write dump dump_modify dynamical_matrix "
            "dynamical_matrix/kk echo group2ndx info log pair_write region2vmd restart third_order third_order/kk "
            "thermo thermo_modify thermo_style uncompute undump write_coeff write_data write_dump write_restart fitpod "
            "derived_thermo geturl",
        ),
        (
            "steers how LAMMPS computes, not what",
            "atom_modify balance box comm_modify comm_style newton package processors suffix timer neighbor plugin",
        ),
        ("steers how atoms move", "min_modify min_style reset_timestep run_style timestep velocity"),
        ("says what LAMMPS adds to its own sums", "fix_modify"),
        ("opens a line to another program, whose forces come by fix client/md", "message"),
    ),
    "refused": (
        ("the model is in a binary file", "read_restart"),
        ("another program drives LAMMPS", "mdi"),
        ("the model comes from the archive of KIM", "kim kim_init kim_interactions kim_param kim_property kim_query"),
    ),
}

#: command → (class, reason)
CLASSES = {
    name: (kind, reason) for kind, groups in _CLASSES.items() for reason, names in groups for name in names.split()
}
COMMANDS = frozenset(CLASSES)

#: Commands that define the model, which a slip of the pen may mean.
MODEL = [*_CLASSES["model"][0][1].split(), "variable", "include"]


def check_known(name: str, where: str, script: bool) -> None:
    """Complain of a word that is no LAMMPS command: in pasted lines always, in a script (which has run, so that it may
    know more) where it looks like a slip."""
    if name in COMMANDS:
        return
    near = difflib.get_close_matches(name, MODEL, n=1, cutoff=0.75)
    if near or not script:
        hint = f"did you mean {near[0]}?" if near else "correct it or leave it out"
        raise AtcError(f"{where}: {name!r} is not a LAMMPS command: {hint}")
    warnings.warn(
        f"{where}: {name!r} is not a command of LAMMPS that atc knows: it is ignored", AtcWarning, stacklevel=2
    )
