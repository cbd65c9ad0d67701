"""The contract of the kernels: what each computes. `reference`, `cpu` and `cuda` have these names and arguments.

Notation:
    T            bins of a period (`num_bins`); depths are bins on a circle of T
    K, m         surfaces of a pixel, frequencies of a sketch; ω_l = 2π k_l / T
    x_p, n       times of arrival of a pixel's photons, bins, and their number
    h, ĥ_l       impulse response (IRF), and its spectrum Σ_b h(b) exp(i ω_l b)
    z_l          a pixel's matched sketch, conj(ĥ_l) · Σ_p exp(i ω_l x_p)
    t, r, g      depth (bins) and intensity (signal photons at g = 1) of a point, exposure of its pixel: the points of
                 a pixel are expected to show z_l = g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)
    E, C         Σ_l |ĥ_l|² and Σ_l ω_l² |ĥ_l|²: curvature of the data term in r, and of that over r² in t (bins⁻²)
    δ            √(E / C), width of a matched filter's peak, bins (`resolution_bins`)
    R(z, t)      response to the matched filter, Σ_l Re(z_l exp(−i ω_l t))
    (·)₊, wrap   the positive part; a difference of depths on the circle, in [−T/2, T/2]
    ρ(u)         what a mean response u of background photons is worth, standard deviations per √photon
    CAPITALS     constants of `kernels.constants` and `kernels.maps`

Maps of complex numbers are float32 [rows, 2m, cols], real parts before imaginary ones. Maps with rows', cols' are
padded, and states are float32 [rows', K, FIELDS, cols'] (`kernels.maps`). `scratch` is memory for results that last
until the next call with it. Types are those of `cpu` and `cuda`; `reference` computes in float64 and complex128. Arrays
lie on the kernels' device unless said to be NumPy's.
"""

from typing import Protocol

from srt3d_ros.kernels.data import Array, FrameData, FrameStream, PhotonData, Scratch


class Kernels(Protocol):
    """The names of a backend, which is a module."""

    ON_HOST: bool               # whether its arrays are NumPy's, in the host's memory
    WARM_FRAMES: int            # frames of a sensor's own size before all are fast; 0: one frame of any size is enough
    Scratch: type[Scratch]
    FrameStream: type[FrameStream]

    # ---- Arrays

    def array(self, values: Array) -> Array:
        """The values of a NumPy array on the device, contiguous; may be the same array."""

    def photon_array(self, values: Array) -> Array:
        """The same for the pixels, times or words of photons, which the kernels only read."""

    def numpy(self, values: Array) -> Array:
        """The NumPy array of an array on the device; waits for the kernels that write it."""

    # ---- Photons → sketch: Σ_p exp(i ω_l x_p)

    def fixed_rows(self, table: Array) -> Array:
        """A table of exp(i ω_l b), float32 [T, 2m], re and im interleaved, as the backend's `sketch_*` read it."""

    def new_sums(self, pixels: int, values: int) -> tuple[Array, Array]:
        """Empty sums of `values` = 2m numbers for each pixel, and numbers of photons, int64 [pixels].

        The form of the sums is the backend's, but [pixels, …], and 0 for no photons. Sums of `cpu` and `cuda` are
        integers: the same photons give the same bits in any order.
        """

    def read_sums(self, sums: Array, photons: Array, values: int) -> tuple[Array, Array]:
        """Σ_p exp(i ω_l x_p) · min(1, MAX_PHOTONS / n), complex64 [pixels, m], and min(n, MAX_PHOTONS), uint32.

        `values` may be less than the sums have: the first count.
        """

    def counted(self, sums: Array, column: int) -> Array:
        """Photons whose row has a 1 in this column, where all others have 0 there; int64 [pixels]."""

    def inspect_events(self, pixel: Array, toa: Array, pixels: int, num_bins: int) -> tuple[bool, bool]:
        """Whether all photons have a pixel below `pixels` and 0 ≤ x < T, and whether `pixel` never decreases."""

    def find_stray(self, words: Array, first_word: int, no_detection: int, num_bins: int) -> int:
        """The highest word, of uint16 [G, pixels], that is neither `no_detection` nor `first_word` + a bin; else −1."""

    def sketch_sorted(self, pixel: Array, toa: Array, rows: Array, sums: Array, photons: Array) -> None:
        """sums[pixel_p] += rows[x_p], photons[pixel_p] += 1, in place, for photons sorted by pixel.

        Args:
            pixel: uint32 [N], below the number of pixels, never decreasing.
            toa: unsigned integers [N], below T.
            rows: of `fixed_rows`.
        """

    def sketch_unsorted(self, pixel: Array, toa: Array, rows: Array, sums: Array, photons: Array) -> None:
        """As `sketch_sorted`, for photons in any order."""

    def sketch_continuous(self, pixel: Array, toa: Array, frequencies, num_bins: int, ordered: bool, sums: Array,
                          photons: Array) -> None:
        """sums[pixel_p] += exp(2πi k_l x_p / T), photons[pixel_p] += 1, for times x, float32 bins, with fractions.

        Photons are sorted by pixel if `ordered` says so. `frequencies` are the integers k_l.
        """

    def sketch_gates(self, words: Array, rows: Array, first_word: int, no_detection: int, sums: Array,
                     photons: Array) -> None:
        """As `sketch_sorted`, for the photons x = word − `first_word` of all words that are not `no_detection`.

        `words` are uint16 [G, pixels], a laser cycle a row, without stray ones.
        """

    def sketch_histograms(self, counts: Array, table: Array, of_template: Array | None, sums: Array,
                          photons: Array) -> None:
        """sums_i += Σ_j counts_ij table_j − of_template, and its last column but one, if above 0, to photons_i.

        A product of matrices in float32: what it costs does not depend on the counts. `sums` may be of 2m values only,
        then what is behind them counts for `photons` alone.

        Args:
            counts: uint8, uint16, int32 or float32 [pixels, n].
            table: float32 [n, 2m + 2] of exp(i ω_l b), re and im interleaved, then 1 and 0; [pixels, n, 2m + 2] if
                pixels have bins of their own; zeros for bins that do not count.
            of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
        """

    # ---- A sensor that moves

    def move_sketch(self, sums: Array, photons: Array, used: Array, rays: Array, ranges: Array, motions: Array,
                    group: Array, lens: Array, bin_frequencies: Array, late: Array, metres_per_bin: float,
                    steepest: float, moved: Array, numbers: Array) -> None:
        """Add the photons of one instant, moved to where they would be seen from at another: to moved and numbers.

        The photons of a pixel with ray d come from range ρ. At the other instant what they show lies at X = ρ R d + p.
        The four pixels i around the place at which X is seen share the photons by bilinear weights w_i; those that lie
        on another surface than the nearest of them, by more than `steepest` of its range, or outside of the array,
        leave their share to it. Between the four lies X, at ρ' = 1 / Σ (w_i / ρ'_i), exactly on a plane that a pinhole
        sees, and ρ = |ρ' X / |X| − p|:

            moved_i += w_i exp(−i ω_l (ρ / metres_per_bin + late)) sums,    numbers_i += w_i n.

        `read_moved` adds the pixel's own range again: photons so come to lie on the surface that they were on, at each
        pixel's own place on it. ρ is not known before the place is: the first is that of the pixel, and LOOKS times
        that of the point at the pixel found. Photons that no pixel would see are left out.

        Args:
            sums, photons: as of `prepare`.
            used: float32 [rows, cols], 0 in masked pixels, whose photons are left out.
            rays: float32 [rows, cols, 3], unit vectors.
            ranges: float32 [rows, cols], ρ' along each ray, m, of every pixel.
            motions: float32 [G, 3, 4], R and p (m).
            group: uint8 [rows, cols], which of the motions is that of a pixel.
            lens: as in `kernels.lens`.
            late: float32 [rows, cols], delays, bins.
            moved: complex64 [rows, cols, m]; changed in place, as are
            numbers: float32 [rows, cols].
        """

    def read_moved(self, moved: Array, numbers: Array, ranges: Array, late: Array, bin_frequencies: Array,
                   metres_per_bin: float) -> tuple[Array, Array]:
        """moved_l exp(i ω_l (ρ' / metres_per_bin + late)) n / numbers, complex64, and n, numbers rounded, uint32.

        So the means stay those of photons. A pixel with less than half a photon has none.
        """

    # ---- Start

    def prepare(self, sums: Array, photons: Array, equaliser: Array, used: Array, scratch: Scratch | None = None,
                taken: Array | None = None, shown: Array | None = None) -> tuple[Array, Array]:
        """z_l = equaliser_l · sums_l − taken · shown_l, and used · n: a frame's `matched` and `counts`, padded with 0.

        Args:
            sums: complex64 [rows, cols, m], Σ_p exp(i ω_l x_p).
            photons: uint32 [rows, cols], n.
            equaliser: complex64 [rows or 1, cols or 1, m], conj(ĥ_l) with the pixel's delay; 0 masks it.
            used: float32 [rows, cols], 1, or 0 in masked pixels.
            taken: float32 [rows, cols], background photons to subtract; 0 in masked pixels. None for none.
            shown: complex64 [rows or 1, cols or 1, m], what each of them adds to z_l on average.
        """

    def blur(self, values: Array, weights: Array, step: int) -> Array:
        """Σ_ab w_a w_b · cells[i + a, c, j + b] at [i, c, j], cells the sums over `step` × `step` pixels, 0 outside.

        `values` are float32 [rows, C, cols], the result [⌈rows / step⌉, C, ⌈cols / step⌉], and `weights` float32
        [2 · radius + 1], those of `maps.window_weights` for rows and columns of cells.
        """

    def match(self, matched: Array, energy: Array, bin_frequencies: Array, num_bins: int,
              surfaces: int) -> tuple[Array, Array]:
        """t_k = arg max_t R(z, t), r_k = R(z, t_k) / E, then z_l −= r_k |ĥ_l|² exp(i ω_l t_k); for k = 1 … K.

        R has no frequency above max k_l: its peak is found on a grid of 4 max k_l cells (rounded up to 16), and by a
        parabola through the highest one and its neighbours.

        `matched` is float32 [rows, 2m, cols], z_l, without padding. Returns depth, bins, less than a cell outside
        [0, T], and intensity times exposure, float32 [rows, K, cols].
        """

    def search(self, frame: FrameData, matched: Array, state: Array, layer: int, sigma: float, step: int, enough: float,
               scratch: Scratch | None = None, carried: Array | None = None, confirmed: float = 0.0,
               slope: tuple[float, float] = (0.0, 0.0), before: Array | None = None) -> None:
        """Give open pixels the surface that one scale shows: score = √(p / q) · ρ(S E / p) / c(t) > `enough`.

        Open is a used pixel without surface `layer`, but with the one before. Of the open pixels around each cell
        z̄ = Σ w z, N = Σ w² n and G = Σ w g are pooled, as by `blur` with σ / step; with other pixels, surfaces would
        grow over those that see background alone. t and S are `match` of z̄. q = Σ w² / Σ w is 1 for one pixel, 1/2 for
        a Gaussian; p = N / q. Since S E ≤ Σ_l |z̄_l|, most cells that are not sure need no filter.

        With a slope, z_l exp(−i ω_l slope · position) are pooled instead, which adds up a plane of this slope as a flat
        window adds up one of slope 0, and slope · position is added to t, of each pixel. So slopes are tried one after
        the other, with pixels that are open `before` the first of them: a surface found since is replaced by one with
        a higher score, while its own is below DOUBTFUL. Positions count from (0, 0) of the whole array: a part of it,
        whose `origin` is a whole number of cells, gets the same bits.

        The cell's open pixels get depth t, the slopes, intensity S / G and standard deviation
        √(q (S M₁ + (p − S)₊ M₀)) / (S C), at most T. A further surface must be farther than APART · δ from the others,
        and brighter than FAINTEST of the first.

        Args:
            matched: float32 [rows', 2m, cols'], z: of the frame, or of `residual`.
            state: changed in place.
            layer: index of the surface that is searched for.
            sigma: σ of the window, pixels; 0: every pixel on its own.
            step: pixels along the side of a cell.
            enough: standard deviations.
            carried: the state of the frame before. Its depth and slopes stay, measured anew at that depth, where the
                score there is above `confirmed`, and the new one is not better by STAY: (score² − score_old²) / 2.
            confirmed: standard deviations.
            slope: of the window's plane, bins per pixel to the right and downwards; 0 if sigma is.
            before: the state that tells which pixels are open; None: `state`.
        """

    def residual(self, frame: FrameData, state: Array, terms: Array, layer: int,
                 scratch: Scratch | None = None) -> Array:
        """z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k): each surface as strong as its own pixel shows it.

        With the intensities of pools too much would be taken from some pixels, and the filter would respond half a
        period away.
        """

    def drop_weak(self, state: Array, weak: float) -> None:
        """r = 0 where the score is below `weak` standard deviations; in place."""

    # ---- Iterations

    def expand(self, frame: FrameData, state: Array, scratch: Scratch | None = None) -> Array:
        """The data term of every point to second order, f(t + d) ≈ v + s d − b d² / 2, at the depth t that it shows.

        With z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k), what other surfaces leave of a pixel:
        v = Σ Re z'_l = R(z, t), s = Σ ω_l Im z'_l, b = Σ ω_l² Re z'_l.

        Returns:
            float32 [rows', K, TERMS, cols']: v, s, b, and n, n, g; 0 where there is no point.
        """

    def log_likelihood_ratio(self, frame: FrameData, state: Array, terms: Array,
                             scratch: Scratch | None = None) -> Array:
        """Of each point's own photons, against "background alone": p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀).

        v ≥ 0 is the response of `expand`. p is n less the photons of the pixel's other surfaces, at least 1/2.
        μ is s = v / E, clipped to within a factor LIKENESS of g r (its square if there are other surfaces);
        D = μ − s + s ln(s / μ) is half the deviance of a Poisson number. A pixel with n = 0
        gives at least DEAD_PIXEL.

        Returns:
            float32 [rows', K, cols'], nats; 0 where there is no point.
        """

    def birth_death(self, frame: FrameData, state: Array, terms: Array, max_chi2: float,
                    scratch: Scratch | None = None) -> Array:
        """Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood, or none.

        Candidates are the surfaces q of the neighbourhood (VOTE_RADIUS), carried along their planes: t_q − slopes ·
        offset. Two agree by a = (1 − e² / (v_q + v_c))₊, e = wrap(t_q − t_c), v = max_chi2 · std² + (RESOLVED · δ)².
        The pixel's surface k is the candidate c of its 3 × 3 neighbourhood with the highest

            ratio of the pixel's photons + Σ_q w_q a_qc clip(PRIOR_VOTE + ratio_q, 0, MAX_VOTE)
                − Σ_q w_q FEWER_PENALTY / count_q

        (see `log_likelihood_ratio`), w = exp(−distance² / 2 VOTE_SIGMA²). The last sum, for k > 0, is over the surfaces
        of neighbours that have no more than k, whose votes do not count: a pixel that truly sees two surfaces keeps
        both, and edges show no double points. A candidate needs BIRTH, unless it is for the first surface of a pixel
        that has one; in a pixel without surfaces, EMPTY_PENALTY · w more for each used neighbour without a surface, of
        those without photons times 1 − exp(−g r), the probability that it would show there. Candidates that agree by
        more than JUDGED with one before are not judged again. The pixel keeps its own point if that
        agrees with the best, else it takes the mean of what agrees, weighted by w a, with score 0. What agrees and the
        photons it explains are left out for the next k. Points with a standard deviation above MAX_STD · T count as
        none. Pixels stay as they are where their 3 × 3 neighbourhood agrees with them already.

        Then SPREAD more times, for pixels with fewer than K surfaces of whose neighbourhood the time before has
        changed: surfaces so grow by as many pixels.

        Returns the next state. `max_chi2` is the square of the standard deviations within which depths may be one
        surface's.
        """

    def pooled_step(self, frame: FrameData, state: Array, terms: Array, sigma: float, radius: int, max_chi2: float,
                    scratch: Scratch | None = None, out: Array | None = None) -> Array:
        """Gauss-Newton step of every point on Σ_q w_q f_q, the data terms of the window moved along its tangent plane.

        w = exp(−distance² / 2σ²) · (1 − e² / max_chi2 (std² + std_q²))₊² is the weight of a surface q at distance e
        (bins) from the point's plane. Over the round window, distance² ≤ radius (radius + 1),

            V = Σ w (v − s e − b e² / 2),  S = Σ w (s + b e),  B = Σ w b,  N = Σ w² n,  p = Σ w n,  G = Σ w g.

        Neighbours within the square of FINE pixels count one by one. Farther ones, if radius > FINE, count in cells of
        CELL × CELL pixels at multiples of CELL: the same sums over the cell (N with w²), with w = the agreement alone,
        along the plane of the cell's middle point.

        The plane is fitted to the depths of pixels, and of the cells' middle points, by least squares: weights
        w / std_q², of cells CELL² as much, and the ridge C / (E Σ w / std_q²) + RIDGE on the slopes. Its turn (Δ_col,
        Δ_row) moves S by −Δ · Σ w b · offset. The step is d = S / max(B, V₊ C / 2E), at most δ, and
        R = V + d S − d² B / 2.

        With S' = min(R₊ / E, p) the point gets intensity R₊ / (E G), standard deviation
        √((S' M₁ + (p − S') M₀) N / p) / (S' C), at most T, score R / √(N E / 2), and residual
        √(Σ w b e² / B − (std_before² − std²)₊)₊: how far the surface leaves the plane, by about which the
        depth may be wrong, less noise that the step takes away.

        Args:
            sigma, radius: of the window, pixels; radius at most MARGIN.
            max_chi2: as of `birth_death`.
            out: where the next state, which is returned, goes: not to `state`. Its margins are left as they are.
        """

    # ---- End

    def trim(self, frame: FrameData, state: Array, terms: Array, enough: float,
             scratch: Scratch | None = None) -> None:
        """r = 0 for the points of rims that the photons of the rim do not pay for; in place.

        A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. What the pixels of
        the rim within VOTE_RADIUS (a square) show is pooled: V = Σ v, p = Σ n, μ = Σ g r, over their points. A point of
        the pixel goes if these photons do not show a surface of any intensity, √p ρ(V₊ / p) / c(t) ≤ `enough`, and
        speak for none rather than for one as bright as the pools of `pooled_step` make it,

            p ρ(V₊ / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀) < 0,   D = μ − s + s ln(s / μ),   s = V₊ / E

        (`log_likelihood_ratio` has the same). What lies behind is the rim then: SPREAD rounds, as far as surfaces grow
        in an iteration. `terms` are `expand` of the state.
        """

    def finalise(self, frame: FrameData, photons: Array, state: Array, terms: Array, enough: float,
                 scratch: Scratch | None = None) -> tuple[Array, Array, Array]:
        """Points with score / c(t) > `enough`: r + (own − r) (1 − v / s²)₊, √(std² + residual²), and (n − g Σ_k r_k)₊.

        own = R(z, t) / (g E) is the intensity by the point's own pixel, r that of its pool. v = (g r I₁ + (n − g r)₊
        I₀) / (E g)² is the variance of own by photon noise, s² the mean square of own − r, both averaged with a
        Gaussian of σ = SHARE_WINDOW pixels: s² − v is how far the pixels themselves differ (James and Stein's
        estimator). An intensity is at least LEAST_SHARE · r; points below FAINTEST of their pixel's strongest are
        dropped.

        `photons` are n, masked pixels included, uint32 [rows, cols]. Returns intensity (0: no point) and standard
        deviation, bins, float32 [rows, K, cols], and background photons, float32 [rows, cols].
        """

    def unexplained(self, frame: FrameData, state: Array, intensity: Array, own: Array, taken: Array, background: Array,
                    photons: Array, passed: Array) -> Array:
        """What points leave of a frame, as far as it may be background; y = g Σ_k r_k exp(i ω_l t_k), w = b̄ / n̄.

        Args:
            intensity: of `finalise`, r.
            own, taken: float32 [rows, cols], background photons: of `finalise`, and as subtracted before; 0 in masked
                pixels.
            background, photons: float32 [rows, cols], b̄ and n̄: own and n, averaged over a window.
            passed: complex64 [rows or 1, cols or 1, m], q_l: a background photon adds q_l · exp(i ω_l x) to z_l.

        Returns:
            float32 [4m + 4], sums over the pixels: of w conj(q_l) (z_l − |ĥ_l|² y_l), real parts before imaginary ones;
            of w y_l in the same way; of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄.
        """

    def collect(self, state: Array, intensity: Array, std: Array, rays: Array, metres_per_bin: float, metres: float,
                num_bins: int) -> tuple[Array, ...]:
        """The points as `unpack` reads them, by pixel, the strongest first: xyz = ray · (metres_per_bin · t + metres).

        `intensity` and `std` are those of `finalise`, `rays` unit vectors, float32 [rows, cols, 3].
        """

    def unpack(self, points: tuple[Array, ...]) -> tuple[Array, Array, Array, Array, Array]:
        """Waits for the points of `collect`: row, column, uint16 [N]; rank in the pixel, uint8 [N]; values; xyz.

        Values, float32 [5, N], are depth (bins), intensity (photons), standard deviation (bins), slopes down and to the
        right (bins per pixel). xyz is float32 [N, 3], metres.
        """

    # ---- Baselines

    def pixelwise(self, frame: FrameData, table: Array, rate: float, usual: float, depth: Array,
                  intensity: Array) -> None:
        """Gradient step on n (z − Ψ_θ)ᵀ W (z − Ψ_θ): t += rate Δ_rt s / max(s, usual g)², r += INTENSITY_RATE Δ_r / g.

        Of d_l = (z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)) exp(−i ω_l t) the table's rows make
        Δ_rt = a₀ · Re d + a₁ · Im d and Δ_r = a₂ · Re d + a₃ · Im d (`core.weighting`). s = g max(r, the new r). A step
        in depth is at most δ, an intensity at least 0. All points move at once.

        Args:
            frame: without padding.
            table: float32 [levels, 4, m], a for shares g r / n from 0 to 1.
            rate: of the full step in depth.
            usual: intensity below which points move less than their curvature allows; 0 for none.
            depth, intensity: float32 [rows, K, cols], bins and photons; changed in place.
        """

    def poisson(self, frame: PhotonData, background: Array, rate: float, usual: float, depth: Array,
                intensity: Array) -> Array:
        """Gradient step on Σ_p ln(Σ_k r_k h(x_p − t_k) + b) − g Σ_k r_k, in every pixel.

        With q_pk = r_k h(x_p − t_k) / (Σ r h + b) and s_k = Σ_p q_pk:
        t_k += rate · (−Σ_p q_pk h′/h) / (max(s_k, usual g) J), at most 1/√J, J the information;
        ln r_k += INTENSITY_RATE · (s_k − g r_k) / max(g r_k, usual g), at most 1.

        Args:
            background: float32 [rows, cols], b, photons per bin at g = 1.
            rate: of the full step in depth.
            usual: intensity below which the curvatures at `usual` are taken.
            depth, intensity: float32 [rows, K, cols], bins and photons; changed in place.

        Returns:
            float32 [rows, cols], Σ_p b / (Σ r h + b): photons of the background.
        """

    def apss(self, depth: Array, intensity: Array, normal: Array | None, exposure: Array, scale: float,
             num_bins: int) -> tuple[Array, Array, Array]:
        """A pass of the point cloud's denoiser, algebraic point set surfaces (Guennebaud and Gross, 2007).

        Lengths are in pixels, (column, row, t / scale). Points of 3 × 3 pixels whose depths lie within
        APSS_SAME_SURFACE of their mean make a surface, if they are APSS_ENOUGH, or as many as there are pixels. For
        each of the K strongest the pixel's point moves along its line of sight onto the surface that is fitted with
        weights (1 − distance² / APSS_REACH²)₊²: a plane by least squares without normals, else a sphere
        u₀ + u · x + u_q |x|² = 0 whose gradient fits them; up to APSS_PROJECTIONS times, until it moves by less than
        APSS_STILL. Intensity is 1 − APSS_SHARED times the pixel's own, and APSS_SHARED times its neighbours' mean, so
        that surfaces grow into pixels without a point.

        Args:
            depth, intensity: float32 [rows, K, cols], bins and photons.
            normal: float32 [2, rows, K, cols], x and y of unit normals with z > 0; None in the first pass.
            exposure: float32 [rows, cols]; pixels with 0 get no point.
            scale: bins that count as one pixel.
            num_bins: T.

        Returns:
            Depth, intensity and normal, the strongest point of a pixel first.
        """
