"""LAMMPS input scripts: what a run computes, from the lines that it executed.

script      words, quotes, continued lines
variables   ``variable``, ``${x}``, ``$(formula)``
commands    every command of LAMMPS and what it means to the forces of a frame
input       styles and coefficients become the terms of a `Potential`
data_coeffs coefficients in data files
"""

from .input import potential_from_lammps

__all__ = ["potential_from_lammps"]
