"""Where fields are wanted: regular grids, planes, lines, slab profiles, points, the atoms."""

from .bound import BoundGrid
from .grid import FOLLOWS, Grid

__all__ = ["FOLLOWS", "BoundGrid", "Grid"]
