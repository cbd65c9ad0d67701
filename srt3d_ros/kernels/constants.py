"""Numbers that are the method's, not a device's: those that the kernels of every kind of device share."""

# The tangent plane of a point (`descend`).
FITS = 2            # the first fit decides which neighbours lie on the plane, the second goes through them
FIT_RADIUS = 3      # pixels: farther neighbours pool, but no longer tilt the plane
RIDGE = 1e-3        # pixels²: keeps the plane finite where its support is a line
STD_FLOOR = 0.01    # bins²: keeps the plane's weights finite

# The neighbours whose depths are compared with it (`relief`).
STEP = 2            # pixels between those that are looked at: nearer ones share their photons
