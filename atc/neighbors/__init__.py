"""Pairs of atoms within a cutoff: cell lists, and lists kept over frames."""
