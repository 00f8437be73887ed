"""Distances, bodies and sites that a run holds: which ones, and the forces that hold them."""
