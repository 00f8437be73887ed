"""From the sums over a snapshot to continuum fields.

``driver``       frames in, fields out; a frame is a group of one
``passes``       one frame's sums: over bonds, over atoms, with the kernel's gradient
``tiles``        the pass over the bonds, tile by tile (``tile_cuts``: how a frame is cut)
``groups``       which sums of several frames are added up before they are finished
``registry``     what each quantity needs and how it is formed; new quantities are one entry there
``sources``      the per-atom and per-bond factors that are summed
``deposits``     the sums at one set of points, each by its own method
``sums``         the finished sums at the grid points and the algebra on them
``accuracy``     the error, measured on the spot; ``tightening``: when it is too large
"""
