"""Constants of the method and limits of the inputs, shared by all kernel backends.

docs/RESULTS.md has what each constant of the method does, by `python -m benchmarks ablation`.
"""

from math import ceil
from typing import NamedTuple


class Window(NamedTuple):
    """A window of the iterations: σ, the distance up to which neighbours count one by one (pixels), Newton steps."""

    sigma: float
    fine: int
    steps: int = 1


# ---- Limits

MAX_SKETCH_SIZE = 64        # m: frequencies of a sketch
MAX_PIXEL_PHOTONS = 2**32 - 1     # of a pixel; more photons count as so many with the same mean

# ---- Start: windows of the matched filter (`search`)

START_SCALES = 0.0, 1.0, 2.5    # σ, pixels: a pixel takes the first whose score is enough
WIDE_SCALE = 6.0        # σ, pixels, for pixels still open after the first iteration
START_SCORE = 7.0       # σ; lower starts more wrong surfaces, which survive next to right ones
SLANT = 1.75            # times δ / σ: slope of slanted windows, bins per pixel; they overlap with the flat one
SLANTED_SCORE = 6.0     # σ; starts a slanted surface, which a flat window smears
STEEPER = 1.3           # times the flat window's nats: what a slanted one needs, for some plane fits across any edge
SEEN_SCORE = SLANTED_SCORE / 2**0.5     # of a flat window, half the nats; below, no slanted window reaches enough
SURE_SCORE = START_SCORE * 2**0.5       # twice a start's nats; above, no slanted one is tried: most of a bright frame

# ---- Planes of the start (`turn_planes`)

PLANE_RADIUS, PLANE_STEP = 4, 2     # pixels: places of the points that support a plane, and the distance between them
PLANE_TURNS = 2         # the second time hands planes on
TURN_GAIN = 1.5         # times the support of a point's own plane that another one needs: across edges, some fit better

# ---- Iterations: the pool (`pooled_step`)

REACH = 1.5             # σ; half the width of a window
# Each σ is about twice the one before, because depths are known better. Two steps in the first window, because the
# start is up to a peak's width from the top.
WINDOWS = Window(2.0, 4, steps=2), Window(4.5, 1), Window(2 * 4.5, 4)
SAME_SURFACE = 4.1      # standard deviations by which depths of one surface may differ; less shares fewer photons

# ---- Iterations: the birth/death update (`birth_death`)

VOTE = 0.45             # nats that a neighbour's surface adds to its log-likelihood ratio, as a vote
BIRTH_COST = VOTE       # nats that a new surface needs
FEWER_COST = VOTE       # nats by which a neighbour with fewer surfaces votes against a further one
DEAD_LIMIT = VOTE       # nats by which a pixel without photons speaks against a surface, at most: it may be dead
MAX_VOTES = 1.5         # times VOTE that a neighbour adds, at most: a bright one is still one neighbour
EMPTY_VOTES = 0.5       # times VOTE by which a neighbour without a surface votes against a new one, at most
NEAR_SIGMA = 1.2        # σ of the neighbourhood that votes, and that tells how far pixels' intensities differ, pixels
VOTE_RADIUS = ceil(REACH * NEAR_SIGMA)
LIKENESS = 2.0          # factor by which neighbours' intensities may differ; its square where surfaces share pixels
NEW_RADIUS = 6          # pixels: half the side of the square over which new pixels share their photons
HOLE = 2                # pixels within which points on so many of a pixel's sides …
HOLE_SIDES = 3          # … make it a hole, not an outline
SPREAD = 4              # pixels by which surfaces may grow into empty ones in each iteration

# ---- Ghosts (`drop_ghosts`)

# ‖d‖: how far an IRF may be wrong beyond intensity, depth, width and skew. A real head's echo has 1 %; on it 0.015 is
# enough, for widths wrong by a quarter 0.02. Surfaces with a smaller share of their pixel's light are lost.
WRONG_SHAPE = 0.02

# ---- End (`trim`, `drop_blobs`, `finalise`)

LOCAL_SIGMA = WINDOWS[0].sigma     # pixels, of the window over which pixels are compared
WHOLE_SCORE = 2.0       # σ above a start's that the best point of a surface needs: growth has fitted it to chance
RELIEF_SCORE = 3.0      # σ by which a window's relief must show to count there; else it counts in the whole frame
RIM = 3                 # pixels without a surface, of the 8 around, that make a point one of the rim
TRIMMED = 2 * SPREAD    # pixels of dim outlines that may go: the start's windows reach beyond them, then growth

# ---- Geometry and numerics of the pool, not the method's

OVERLAP = 0.95          # of coinciding surfaces, instead of 1: keeps the steps of `solve_pairs` finite
RIDGE = 1e-3            # pixels²: keeps the plane finite where the support is a line but for rounding
CELL = 3                # pixels along the side of the cells that sum farther neighbours; odd
TINY, EPSILON = 1e-12, 1e-6     # photons: added where 0 must not be divided by; the least divisor

# ---- Gradient steps of the baselines (`pixelwise`, `poisson`)

INTENSITY_RATE = 0.5    # of the full step, because the points of a pixel change together

# ---- The baselines' denoiser (`apss`). Lengths are in pixels, also along the depth.

APSS_REACH = 2.0            # h of the weights (1 − d²/h²)²: one more than the neighbourhood's radius
APSS_SAME_SURFACE = 4.0     # points nearer in depth than this to a surface's mean join it
APSS_ENOUGH = 4             # points of a 3 × 3 neighbourhood that make a surface
APSS_PROJECTIONS = 5        # of a point onto the surface that is fitted around it, at most
APSS_STILL = 0.1            # a projection that moves a point less is the last one
APSS_SHARED = 0.1           # how much of its intensity a point takes from its neighbours
APSS_RIDGE = 1e-3           # pixels²: keeps slopes and curvature finite where the support is a line or a point


def cell_size(sigma: float) -> int:
    """Pixels along the side of the cells that a window of the start adds up: σ, from 1 to CELL."""
    return min(max(int(sigma), 1), CELL)
