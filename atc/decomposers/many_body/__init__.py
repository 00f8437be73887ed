"""Potentials of atoms with their neighbours: embedded atoms, three bodies, bond orders, descriptors."""
