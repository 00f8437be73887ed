"""What section 4 of the 2009 paper computes with: the chain, for how long, and on which grid."""

from __future__ import annotations

import numpy as np

LENGTH, DURATION, SPACING, NEIGHBORS = 1000.0, 300.0, 0.25, 20
PROFILE_TIME = 150.05


def grid(spacing: float) -> np.ndarray:
    """Reference positions from end to end, ends included."""
    return np.arange(round(LENGTH / spacing) + 1) * spacing
