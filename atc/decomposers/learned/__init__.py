"""Machine-learned potentials through automatic differentiation: energies of atoms as a function of edges, and makers
for the models of well-known packages. Only what is in here needs torch, and only when it is used."""
