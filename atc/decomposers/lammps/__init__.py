"""LAMMPS input scripts: what a run computes, from the lines that it executed.

script      words, quotes, continued lines
variables   ``variable``, ``${x}``, ``$(formula)``
commands    every command of LAMMPS and what it means to the forces of a frame
interpreter which commands LAMMPS gets to before each of its runs; control those that say which line is next, unsure
            lines that it may or may not get to, state what holds at a run
model       what they say of the model: styles with their coefficient lines
data_coeffs coefficients in data files
assemble    styles and coefficients become the terms of a `Potential`; pair_terms those of the pair style
setup       what the script says of the atoms of a frame
input       all of it: from the text to the `Potential`
"""

from .input import potential_from_lammps

__all__ = ["potential_from_lammps"]
