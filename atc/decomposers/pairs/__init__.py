"""Laws of pairs of atoms: one file a law or family, and the loop over pairs that runs them all."""
