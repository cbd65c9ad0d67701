"""The sources of the player: a photon file or the simulator, as messages and when each is due."""

from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import chain
from math import ceil
from typing import NamedTuple

from rclpy.serialization import serialize_message

from srt3d_ros import datasets
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.simulation import bust
from srt3d_ros.datasets.simulation.motion_profiles import LAP_S, MOTIONS, OPTICAL
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages.cdr import NS_PER_S
from srt3d_ros.messages.odometry import BODY_FRAME, encode_odometry
from srt3d_ros.nodes.common.topics import ODOM, PHOTONS, SENSOR

LATE_S = 0.5            # frames that are later are skipped, so that the player catches up after a stall
MAX_DRAWN_BYTES = 2**28 # of messages that are drawn ahead
PACKETS = 10            # per frame of the moving sensor
SCENE_HZ = 10.0         # frame k of the head shows it at k / SCENE_HZ, whatever the rate
FILE, THE_SIMULATOR = "a photon file", "the simulator"
PARAMETERS_OF = {       # of the player's parameters, those of one source
    FILE: ("sensor_file",),
    THE_SIMULATOR: ("ppp", "sbr", "cycles", "seed", "motion"),
}
Clock = Callable[[], int]       # gives the nanoseconds since the first message was sent


class Item(NamedTuple):
    """A message to send.

    Args:
        topic: one of the source's.
        raw: the serialised message.
        due_ns: when to send it, after the beginning.
        stamp_ns: its stamp, after the beginning.
        skipped: number of late frames that were left out before this one.
    """

    topic: str
    raw: bytes
    due_ns: int
    stamp_ns: int
    skipped: int = 0


def open_source(parameters: Mapping, changed: Collection[str] = ()) -> "Source":
    """The source for the player's parameters.

    Raises:
        InvalidInput: it cannot be played, or a parameter that is `changed` from its default is for other sources.
    """
    path, sensor_file, motion = parameters["input"], parameters["sensor_file"], parameters["motion"]
    require(not is_bag(path), "input", path, "a photon file or simulator; `ros2 bag play` plays bags")
    kind = THE_SIMULATOR if path == SIMULATOR else FILE
    for source, own in PARAMETERS_OF.items():
        for name in {*own} & {*changed} if source != kind else ():
            raise InvalidInput(name, problem=f"{name} {parameters[name]}: only for {source}, and input {path} is "
                               f"{kind}.")
    rate_hz, frames = parameters["rate_hz"], parameters["frames"]
    if kind == FILE:
        photons = datasets.read_photons(path, sensor=datasets.open_sensor(sensor_file) if sensor_file else None)
        return Source(photons.sensor, lambda k: photons.events, rate_hz, frames, notes=photons.notes)
    if motion != "off":
        return MovingSource(parameters)
    simulator = Simulator(sensor=default_sensor().replace(cycles=parameters["cycles"] or None), ppp=parameters["ppp"],
                          sbr=parameters["sbr"], seed=parameters["seed"], frame_rate_hz=SCENE_HZ)
    return Source(simulator.sensor, lambda k: simulator.frame(k)[0], rate_hz, frames, round(bust.PERIOD_S * SCENE_HZ))


class Source:
    """A source whose packets are drawn before the first is sent, so that the player computes nothing while it plays.

    Packet k is due k / rate_hz after the first. After a lap, the same packets are sent again.

    Args:
        draw: gives the photons of packet k.
        packets: their number; 0: no end.
        lap: packets after which the scene repeats.
        packets_per_frame: late frames are skipped whole.
        notes: one line for each assumption.

    Raises:
        InvalidInput: the first packet cannot be sent.
    """

    topics = (SENSOR, PHOTONS)
    before_s = exposure_s = 0.0     # the first packet is acquired `before_s` after the beginning, each in `exposure_s`

    def __init__(self, sensor: SensorModel, draw: Callable[[int], PhotonEvents], rate_hz: float, packets: int,
                 lap: int = 1, packets_per_frame: int = 1, notes: tuple[str, ...] = ()):
        self.sensor, self.notes = sensor, notes
        self._draw, self._rate_hz, self._packets, self._per_frame = draw, rate_hz, packets, packets_per_frame
        self._lap = min(packets or lap, lap)
        self._drawn = [self._encode(0)]

    def _encode(self, k: int) -> bytes:
        return photon_frames.PHOTONS.encode_cdr(self._draw(k), self.sensor, self.sensor.frame_id)

    def prepare(self, stopped: Callable[[], bool]) -> None:
        """Draw a lap or, if it would take more, the frames that fill MAX_DRAWN_BYTES, which are repeated."""
        used = sum(map(len, self._drawn))
        while len(self._drawn) < self._lap and (used < MAX_DRAWN_BYTES or len(self._drawn) % self._per_frame):
            if stopped():
                return
            self._drawn.append(self._encode(len(self._drawn)))
            used += len(self._drawn[-1])
        self._lap = len(self._drawn)

    def items(self, elapsed_ns: Clock) -> Iterator[Item]:
        """Yield the messages in the order in which they are due, from the beginning at each call.

        Skips frames that are late by the clock, and still yields the number of frames asked for.
        """
        k = sent = 0
        while not self._packets or sent < self._packets:
            late_s = elapsed_ns() / NS_PER_S - self._due_s(k) if k % self._per_frame == 0 else 0
            skipped = int(late_s * self._rate_hz / self._per_frame) if late_s > LATE_S else 0
            k += skipped * self._per_frame
            due_ns = round(self._due_s(k) * NS_PER_S)
            stamp_ns = due_ns - round(self.exposure_s * NS_PER_S)
            yield Item(PHOTONS.name, self._drawn[k % self._lap], due_ns, stamp_ns, skipped)
            k, sent = k + 1, sent + 1

    def _due_s(self, k: int) -> float:
        return k / self._rate_hz + self.before_s + self.exposure_s


REPORT_NS = NS_PER_S // 100         # between odometry
BEFORE_S, AFTER_NS = 0.5, NS_PER_S // 5     # odometry begins before the photons, and ends after them


class MovingSource(Source):
    """The simulator's room seen by a moving sensor: packets, sent once they are acquired, and odometry."""

    topics, before_s = (ODOM, *Source.topics), BEFORE_S

    def __init__(self, parameters: Mapping):
        self._path, cycles = MOTIONS[parameters["motion"]], ceil(parameters["cycles"] / PACKETS)
        rate_hz = PACKETS * parameters["rate_hz"]
        self.exposure_s = 1 / rate_hz
        sensor = moving_sensor().replace(cycles=cycles or None)
        simulator = Simulator(MovingView(Room(), self._path, sensor, self.exposure_s), sensor, parameters["sbr"],
                              parameters["ppp"] / PACKETS, parameters["seed"], rate_hz)
        note = (f"each frame has {PACKETS} packets and odom gives the pose of {BODY_FRAME}: start the sketcher with "
                f"motion:=odom packets_per_frame:={PACKETS} extrinsics:='{extrinsics()}'")
        super().__init__(sensor, lambda k: simulator.frame(k)[0], rate_hz, PACKETS * parameters["frames"],
                         max(round(LAP_S * parameters["rate_hz"]), 1) * PACKETS, PACKETS, (note,))

    def items(self, elapsed_ns: Clock) -> Iterator[Item]:
        """Yield each packet after the odometry up to it, and then the last odometry."""
        lap_s = self._lap / self._rate_hz if self._lap != self._packets else float("inf")
        report_ns = last_ns = 0
        for packet in chain(super().items(elapsed_ns), [None]):
            last_ns = packet.due_ns if packet else last_ns + AFTER_NS
            while report_ns <= last_ns:
                at_s = report_ns / NS_PER_S - BEFORE_S
                pose = self._path(at_s % lap_s if at_s > 0 else at_s)
                yield Item(ODOM.name, serialize_message(encode_odometry(pose)), report_ns, report_ns)
                report_ns += REPORT_NS
            if packet:
                yield packet


def extrinsics() -> str:
    """The pose of the sensor on the body, as text for the sketcher's parameter."""
    return "0 0 0 " + " ".join(f"{number:g}" for number in OPTICAL.quaternion)
