"""A frame in the forms in which it may travel: how many bytes each takes after zstd, and the clouds that come of it.

What helps packing is tried for each form: byte planes, differences to the pixel before, order by pixel. "pooled" is our
reconstruction, which shares photons along surfaces; "pixel" takes each pixel alone.
"""

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from srt3d_ros import zstd
from srt3d_ros.benchmark.codes import (
    coarse_codes,
    correlate,
    expected_codes,
    gray_codes,
    gray_fourier,
    truncated_fourier,
)
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import MAX_WORDS, PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketch_design import design_for
from srt3d_ros.core.sketching import phase_table, sketch_photons
from srt3d_ros.messages import coded_sketch
from srt3d_ros.messages.sketch import INT16_SCALE

LEVEL = 9               # of zstd: coarse histograms become a tenth smaller than at 3, its default; others hardly
POOLED, PIXEL, WINDOW = "pooled", "pixel", "3 × 3"
SKETCH_SIZES = (3, 5, 7, 10, 14, 20, 28, 40, 56)       # steps of √2
STEPS = (coded_sketch.DEFAULT_STEP, 1.4)        # σ; coarser ones save the bytes for more frequencies
COARSE_BINS = (8, 11, 16, 23, 32, 45, 64, 91, 128, 181, 256, 362, 512, 724, 1024)
RECEIVED_SIZES = (20, 40)   # m of the sketches that a receiver of counts or photons makes: it may take any
KEPT = (5, 7, 10, 14, 20, 28, 40, 56, 80)       # bytes a pixel that photons are thinned to
ALONE = SKETCH_SIZES[:8:2]      # m that are reconstructed by "pixel" as well, which takes most of the time
TRIED = 2**20           # numbers on which forms of packing are tried
SEED = 3
Cloud = tuple[str, Callable[[], PointCloud]]    # how, and what reconstructs


class Packed(NamedTuple):
    """A frame in one form and size (in words), its bytes after packing, and the clouds that may come of it."""

    size: str
    bytes: int
    clouds: list[Cloud]


class Frame:
    """Photons of one frame, and how codes of them become clouds.

    Args:
        photons, sensor: the frame.
        surfaces: K; of "pixel" and "3 × 3" always one.
        device: of "pooled".
    """

    def __init__(self, photons: PhotonEvents, sensor: SensorModel, surfaces: int = 1, device: str = "cpu"):
        order = np.lexsort((photons.toa, photons.pixel))
        self.photons = PhotonEvents(photons.pixel[order], photons.toa[order])
        self.sensor, self.surfaces, self.device = sensor, surfaces, device
        self.bins = sensor.toa_bins(self.photons.toa).astype(np.int64)

    @cached_property
    def counts(self) -> np.ndarray:
        """Photons of each pixel, int64 [pixels]."""
        return np.bincount(self.photons.pixel, minlength=self.sensor.pixels)

    def frequencies(self, m: int) -> tuple[int, ...]:
        """Those that `auto` chooses for the photons."""
        return design_for(self.photons, self.sensor, sketch_size=m).frequencies

    def sizes(self) -> list[int]:
        """The sketch sizes that T allows."""
        return [m for m in SKETCH_SIZES if m <= (self.sensor.num_bins - 1) // 2]

    def pooled(self, sketch: Sketch, sensor: SensorModel | None = None) -> PointCloud:
        """Our reconstruction."""
        method = METHODS["pooled"].build(sensor or self.sensor, sketch.frequencies, surfaces=self.surfaces,
                                         device=self.device)
        return method(sketch)

    def pooled_photons(self, events: PhotonEvents, sensor: SensorModel, most: int) -> list[Cloud]:
        """Our reconstruction of the sketches that a receiver may make of photons, of frequencies up to `most`."""
        def cloud(m: int) -> PointCloud:
            frequencies = design_for(events, sensor, sketch_size=m).frequencies
            frequencies = tuple(k for k in frequencies if k <= most)
            return self.pooled(sketch_photons(events, sensor, frequencies), sensor)
        return [(POOLED, partial(cloud, m)) for m in {min(m, most) for m in RECEIVED_SIZES}]

    def by_pixel(self, codes, matrix: np.ndarray, window: int = 1) -> PointCloud:
        """The depth of each pixel by its codes [pixels, K] alone, or by the sums over a square of pixels."""
        sensor, shape = self.sensor, (self.sensor.rows, self.sensor.cols)
        seen = self.counts.reshape(shape) > 0 if sensor.mask is None else (self.counts.reshape(shape) > 0) & sensor.mask
        if window > 1:
            codes = _sums_around(codes.reshape(*shape, -1), window).reshape(sensor.pixels, -1)
            seen = _sums_around(seen[..., None], window)[..., 0] > 0
        depth = correlate(codes, expected_codes(matrix, sensor)).reshape(shape) + sensor.first_bin_center
        if sensor.delay_bins is not None:
            depth = depth - sensor.delay_bins
        one = np.ones((sensor.rows, 1, sensor.cols))
        return PointCloud.from_layers(sensor, depth[:, None], one * seen[:, None], one, 0 * seen, 0)


def coded(choose: Callable[[Frame, int], tuple[int, ...]]) -> Callable[[Frame, int], Iterator[Packed]]:
    """Sketches in the layout `coded` of the sketcher: ours, or Fourier codes, which it rounds and packs as well."""
    def pack(frame: Frame, every: int) -> Iterator[Packed]:
        for m in frame.sizes()[::every]:
            sketch = sketch_photons(frame.photons, frame.sensor, choose(frame, m))
            for step in STEPS:
                raw = coded_sketch.encode(sketch, step)
                photons, sums, added = coded_sketch.decode(raw, sketch.frequencies)
                arrived = Sketch(sketch.frequencies, sums, photons, added_variance=added)
                clouds = [(POOLED, partial(frame.pooled, arrived))]
                if m in ALONE and step == STEPS[0]:
                    codes = sums.view(np.float32).reshape(frame.sensor.pixels, -1)
                    matrix = phase_table(sketch.frequencies, frame.sensor.num_bins, frame.sensor.first_bin_center)
                    clouds.append((PIXEL, partial(frame.by_pixel, codes, matrix)))
                yield Packed(f"m = {m}, {step:g} σ", len(raw), clouds)
    return pack


def plain(layout: str) -> Callable[[Frame, int], Iterator[Packed]]:
    """Sketches in the layouts float32 and int16, packed."""
    def pack(frame: Frame, every: int) -> Iterator[Packed]:
        for m in frame.sizes()[::every]:
            sketch = sketch_photons(frame.photons, frame.sensor, frame.frequencies(m))
            numbers = sketch.z.view(np.float32).reshape(frame.sensor.pixels, -1).T
            if layout == "int16":
                numbers = np.rint(numbers * INT16_SCALE).astype(np.int16)
                sums = numbers.T.astype(np.float32) / INT16_SCALE * frame.counts[:, None].astype(np.float32)
                sums = np.ascontiguousarray(sums).view(np.complex64).reshape(sketch.sums.shape)
                sketch = Sketch(sketch.frequencies, sums, sketch.photons)
            size = packed_size(frame.counts[None]) + packed_size(numbers)
            yield Packed(f"m = {m}", size, [(POOLED, partial(frame.pooled, sketch))])
    return pack


def gray(frame: Frame, every: int) -> Iterator[Packed]:
    """Gray codes, rounded to integers; there are at most log₂ T of them."""
    for count in range(2, frame.sensor.num_bins.bit_length())[::every]:
        matrix = gray_codes(frame.sensor.num_bins, count)
        codes = np.stack([np.bincount(frame.photons.pixel, code[frame.bins], frame.sensor.pixels)
                          for code in matrix.T], axis=1)
        codes = np.rint(codes).astype(np.int32)
        yield Packed(f"K = {count}", packed_size(codes.T), [
            (PIXEL, partial(frame.by_pixel, codes, matrix)), (WINDOW, partial(frame.by_pixel, codes, matrix, 3))])


def coarse(frame: Frame, every: int) -> Iterator[Packed]:
    """Histograms of fewer, wider bins."""
    widths = dict.fromkeys(-(-frame.sensor.num_bins // count) for count in COARSE_BINS)
    for width in [width for width in widths if width > 1][::every]:
        yield from _histogram(frame, width)


def full(frame: Frame, _: int) -> Iterator[Packed]:
    """The histogram of all bins; the pixels are matched with log h, as maximum likelihood wants."""
    for packed in _histogram(frame, 1):
        yield Packed(packed.size, packed.bytes, _of_photons(frame, frame.photons))


def photons(frame: Frame, every: int) -> Iterator[Packed]:
    """Times of arrival, pixel after pixel; as large a share of them, drawn at random, as fits into some sizes."""
    place = np.random.default_rng(SEED).random(frame.photons.photons)

    def kept(share: float) -> tuple[PhotonEvents, int]:
        some = PhotonEvents(frame.photons.pixel[place < share], frame.photons.toa[place < share])
        return some, photon_bytes(some, frame.sensor)

    every_photon, whole = kept(1)
    for target in np.multiply(KEPT[::every], frame.sensor.pixels):
        if target >= whole:
            break
        share, size, some = 1.0, whole, every_photon
        while size > target and some.photons:       # fewer photons take more bytes each
            share *= 0.99 * target / size
            some, size = kept(share)
        yield Packed(f"{100 * share:.3g} %", size, _of_photons(frame, some))
    yield Packed("100 %", whole, _of_photons(frame, every_photon))


OURS = "coded sketch"
# All forms by name: a function of the frame, and of `every`: only every so-many-th size. Sizes grow.
REPRESENTATIONS: dict[str, Callable[[Frame, int], Iterator[Packed]]] = {
    OURS: coded(lambda frame, m: frame.frequencies(m)),
    "int16 sketch": plain("int16"),
    "float32 sketch": plain("float32"),
    "truncated Fourier": coded(lambda frame, m: truncated_fourier(frame.sensor.num_bins, m)),
    "Gray-based Fourier": coded(lambda frame, m: gray_fourier(frame.sensor.num_bins, m)),
    "Gray codes": gray,
    "coarse histogram": coarse,
    "full histogram": full,
    "photons": photons}


def packed_size(values: np.ndarray) -> int:
    """Bytes of numbers [codes, pixels] after zstd, in the form that is smallest for a part of them."""
    forms: list[Callable[[np.ndarray], np.ndarray]] = [lambda part: part, np.transpose]
    if values.dtype.kind != "f":
        values = values.astype(np.int16 if np.abs(values).max(initial=0) < 2**14 else np.int32, copy=False)
        forms = [_sign_last, lambda part: _sign_last(part.T),
                 lambda part: _sign_last(np.diff(part, axis=1, prepend=part.dtype.type(0)))]
    some = values[:, :max(TRIED // len(values), 1)]
    best = min(forms, key=lambda form: _packed(_planes(form(some))))
    return _packed(_planes(best(values)))


def _sign_last(values: np.ndarray) -> np.ndarray:
    """0, −1, 1, −2 … as 0, 1, 2, 3 …: small numbers of either sign have no high bits."""
    return values << 1 ^ values >> 8 * values.itemsize - 1


def photon_bytes(events: PhotonEvents, sensor: SensorModel) -> int:
    """Bytes of photons sorted by pixel and time: how many each pixel has, and their times or differences of these."""
    counts = packed_size(np.bincount(events.pixel, minlength=sensor.pixels)[None])
    if events.toa.dtype.kind == "f":
        return counts + _packed(_planes(events.toa))
    differences = np.diff(events.toa, prepend=events.toa.dtype.type(0))
    return counts + min(_packed(_planes(form)) for form in (events.toa, differences))


def _planes(values: np.ndarray) -> bytes:
    """The low bytes of all numbers, then the next ones …"""
    return np.ascontiguousarray(np.ascontiguousarray(values).view(np.uint8).reshape(-1, values.itemsize).T).data


def _packed(data) -> int:
    return len(zstd.compress(data, level=LEVEL))


def _of_photons(frame: Frame, kept: PhotonEvents) -> list[Cloud]:
    """The reconstructions of photons that have arrived."""
    def matched() -> PointCloud:
        return METHODS["xcorr"].build(frame.sensor)(kept)
    return [*frame.pooled_photons(kept, frame.sensor, (frame.sensor.num_bins - 1) // 2), (PIXEL, matched)]


def _histogram(frame: Frame, width: int) -> Iterator[Packed]:
    """The histogram of bins that are `width` bins of the sensor wide; none if there are too many, or too few."""
    from scipy.sparse import coo_array

    sensor, pixel = frame.sensor, frame.photons.pixel
    count = -(-sensor.num_bins // width)
    if count * sensor.pixels > MAX_WORDS or sensor.irf.shape[-1] + width - width % 2 > count * width:
        return
    cell = frame.bins // width
    sparse = coo_array((np.ones(len(cell), np.float32), (pixel, cell)), (sensor.pixels, count)).tocsr()
    size = packed_size(sparse.astype(np.int16 if sparse.max() < 2**14 else np.int32).toarray().T)
    middles = PhotonEvents(pixel, (cell * width + (width - 1) / 2 + sensor.first_bin_center).astype(np.float32))
    yield Packed(f"K = {count}", size, [
        *frame.pooled_photons(middles, coarse_sensor(sensor, width), (count - 1) // 2),
        (PIXEL, lambda: frame.by_pixel(sparse, coarse_codes(sensor.num_bins, width)))])


def coarse_sensor(sensor: SensorModel, width: int) -> SensorModel:
    """The sensor as its histograms of wider bins show it: photons lie in the middle, so the IRF is as wide as a bin."""
    box = np.ones(width + 1 - width % 2)
    if width % 2 == 0:
        box[[0, -1]] = 0.5          # of an even width the ends are halves
    irf = np.apply_along_axis(np.convolve, -1, sensor.irf.astype(np.float64), box)
    count = -(-sensor.num_bins // width)
    shape = sensor.background_shape
    if shape is not None:
        shape = np.pad(shape, (0, count * width - sensor.num_bins))
    return sensor.replace(num_bins=count * width, irf=irf, irf_ref=sensor.irf_ref + len(box) // 2,
                          background_shape=shape)


def _sums_around(values: np.ndarray, side: int) -> np.ndarray:
    """Sums over the square around each pixel, [rows, cols, K]."""
    for axis in (0, 1):
        margin = [(side // 2, side // 2) if k == axis else (0, 0) for k in range(3)]
        padded = np.pad(values, margin)
        values = sum(padded.take(range(k, k + values.shape[axis]), axis) for k in range(side))
    return values
