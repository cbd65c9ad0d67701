"""The frames that are measured: the simulated head of `srt3d demo`, in images of any size, with any photon count."""

import numpy as np

from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.datasets.scene import StaticScene, default_sensor, net_sensor
from srt3d_ros.datasets.simulator import Simulator

FOV_DEG = 11.0              # of the default sensor: finer pixels, not more of the scene
SBR, SEED = 1.0, 1
BAND_PHOTONS = 5_000_000    # drawn together: the simulator needs some 30 bytes a photon while it draws


def sensor_of(side: int) -> SensorModel:
    """The default sensor with side × side pixels."""
    return default_sensor().replace(rows=side, cols=side, projection=Pinhole.from_fov(side, side, FOV_DEG))


def photons_of(sensor: SensorModel, ppp: float, band_photons: float = BAND_PHOTONS) -> PhotonEvents:
    """One frame of the head at `ppp` photons per pixel, signal and background alike, sorted by pixel.

    It is drawn in bands of rows, so that a frame of 2·10⁸ photons takes no more memory than its photons.
    """
    depth, signal, background = Simulator(sensor=sensor, sbr=SBR, ppp=ppp, seed=SEED).expected(0)
    rows = max(int(sensor.rows * band_photons / max(ppp * sensor.pixels, 1)), 1)
    parts = []
    for first in range(0, sensor.rows, rows):
        band = slice(first, min(first + rows, sensor.rows))
        below = sensor.replace(rows=band.stop - band.start)
        rates = signal[:, band].sum(), background[band].sum()
        scene = StaticScene(sensor.range_m(depth[:, band]), signal[:, band])
        drawn, _ = Simulator(scene, below, sbr=rates[0] / rates[1], ppp=sum(rates) / below.pixels,
                             seed=SEED + first).frame(0)
        parts.append((drawn.pixel + np.uint32(first * sensor.cols), drawn.toa))
    return PhotonEvents(*(np.concatenate(arrays) for arrays in zip(*parts)))


def shuffled(events: PhotonEvents) -> PhotonEvents:
    """The same photons in no order."""
    order = np.random.default_rng(SEED).permutation(events.photons)
    return PhotonEvents(events.pixel[order], events.toa[order])


def gates_sensor() -> SensorModel:
    """A 32 × 32 array, T = 153, that is read out laser cycle by laser cycle."""
    return net_sensor().replace(gates=GateWords())


def gates_of(sensor: SensorModel, ppp: float, cycles: int) -> PhotonGates:
    """Cycles of an array, `ppp` photons per pixel in all of them together, each in any cycle; of two in one, one."""
    random = np.random.default_rng(SEED)
    words = np.full((cycles, sensor.pixels), sensor.gates.no_detection, np.uint16)
    pixel = np.repeat(np.arange(sensor.pixels), random.poisson(ppp, sensor.pixels))
    words[random.integers(0, cycles, len(pixel)), pixel] = random.integers(0, sensor.num_bins, len(pixel))
    return PhotonGates(words.reshape(cycles, sensor.rows, sensor.cols))
