"""Numbers that are the method's, not a device's: those that the kernels of every kind of device share."""

# The start (`search`).
NARROWEST = 0.7     # window of a point that its own pixel shows, pixels
FAINTEST = 0.05     # of a pixel's first surface that a further one must give: less may be a wrong IRF's
APART = 4.0         # widths of the matched filter beyond which a pixel's surfaces are two
STAY = 1.5          # nats by which another depth must be better than that of the last frame
DIMMEST = 1e-6      # photons that are divided by, at least

# The tangent plane of a point (`descend`).
FITS = 2            # the first fit decides which neighbours lie on the plane, the second goes through them
FIT_RADIUS = 3      # pixels: farther neighbours pool, but no longer tilt the plane
RIDGE = 1e-3        # pixels²: keeps the plane finite where its support is a line
STD_FLOOR = 0.01    # bins²: keeps the plane's weights finite

# The neighbours whose depths are compared with it (`relief`).
STEP = 2            # pixels between those that are looked at: nearer ones share their photons

# The intensity of the points (`settle`).
SHARE_WINDOW = 2.0  # pixels: σ of the neighbourhood that tells how far pixels differ
LEAST_SHARE = 0.01  # of its pool's intensity that a point has at least

# Evidence of a pixel's own photons (`evidence`).
LIKENESS = 2.0      # neighbours' intensities may differ by this factor and still be one surface's
SHARING = 4.0       # and where surfaces share pixels
DEAD = -1.0         # nats that a pixel without any photon speaks against a surface, at most: it may be dead
LEFT = 1e-6         # photons that a pixel with some keeps, at least, without those of its other surfaces

# Creation, competition and removal of points (`propose`).
REACH = 2           # pixels: of the neighbourhood that votes
VOTE_SIGMA = 1.2    # pixels: σ of a vote's weight by distance
BELIEF = 0.45       # nats that a neighbour's vote is worth before its own photons are asked
VOTES = (0.0, 0.7)  # nats that it is worth at least and at most
BLANK = 0.2         # nats that a neighbour with photons, but no surface, speaks against a new one
ENOUGH = 3          # neighbours that must agree on a new surface
CREATE = 0.6        # nats in favour of a new surface
SAME = 0.7          # agreement of candidates that need no judgement of their own
ALONE = 0.5         # nats that a neighbour with fewer surfaces speaks against a further one
RESOLVED = 0.7      # widths of the matched filter within which depths are one surface, for sure
FILL_WINDOW = 2.0   # pixels: window of a point that an empty pixel got from its neighbours
NEVER = -1e30       # evidence that any other exceeds

# Gradient steps of the baselines (`pixelwise`, `poisson`).
INTENSITY_RATE = 0.5        # of the full step: the points of a pixel change together

# The baselines' denoiser (`apss`). Lengths are in pixels, also along the depth.
APSS_REACH = 2.0            # h of the weights (1 − d²/h²)²: one more than the neighbourhood's radius
APSS_SAME_SURFACE = 4.0     # points nearer in depth than this to a surface's mean join it
APSS_ENOUGH = 4             # points of a 3 × 3 neighbourhood that make a surface
APSS_PROJECTIONS = 5        # of a point onto the surface that is fitted around it, at most
APSS_STILL = 0.1            # a projection that moves a point less is the last one
APSS_SHARED = 0.1           # how much of its intensity a point takes from its neighbours
APSS_RIDGE = 1e-3           # pixels²: keeps slopes and curvature finite where the support is a line or a point
