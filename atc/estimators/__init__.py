"""From the two sums over a snapshot to continuum fields.

``registry``   what each quantity needs and how it is formed; new quantities are one entry there
``sources``    the per-atom and per-bond factors that are summed
``sums``       the finished sums at the grid points and the algebra on them
``compute``    one frame in, arrays out: one pass over the bonds and one over the atoms for everything asked
``accuracy``   the error, measured on the spot at random points
"""
