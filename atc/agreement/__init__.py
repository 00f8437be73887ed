"""Is this the potential of the run: forces, energies and pressure of the model beside those of the trajectory and its
log file."""
