"""From the sums over a snapshot to continuum fields.

``driver``       frames in, fields out; a frame is a group of one
``runs``         consecutive frames with one cell, and the sums that they give
``bond_pass``    one frame's sums over its bonds, and what is summed of them
``atom_pass``    the same of its atoms, with the kernel's gradient too
``place``        where sums are wanted, and how they are taken there
``forming``      the fields, formed once from the sums, and their errors
``tiles``        the pass over the bonds, tile by tile (``tile_cuts``: how a frame is cut)
``results``      the fields of a frame, and how those of several are put together
``groups``       which sums of several frames are added up before they are finished
``quantities``   what each quantity needs and how it is formed, by kind: one entry each (``registry``: by name)
``summed``       what can be summed: one entry each
``work``         what is to be summed for some quantities, and nothing else
``reference``    displacements and bonds relative to a reference frame
``deposits``     the sums at one set of points, each by its own method
``sums``         the finished sums at the grid points (``tensors``: the algebra on them)
``balance``      residuals of the balance laws
``accuracy``     the error, measured on the spot; ``tightening``: when it is too large
"""
