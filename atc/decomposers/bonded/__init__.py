"""Forces along the topology's bonds, angles, torsions and impropers, and what they share."""
