"""What is made of fields and trajectories: comparison, balance laws, speed against error, conductivity."""
