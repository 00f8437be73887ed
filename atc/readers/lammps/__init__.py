"""What LAMMPS reads and writes: dumps of all kinds, data files, logs, molecules, grids."""
