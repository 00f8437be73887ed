"""How large the error of a field is.

``random_points``    the same sums a second time, at random points, by the exact method
``strongest_bonds``  where errors of sums over bonds are largest: around the strongest bonds of a frame
``input_error``      what the digits of the trajectory leave in doubt
"""
