"""From atoms to peridynamics: chains, gradient series, dispersion of crystals. Nothing is imported here; take what you
need from the modules."""
