"""A minimal driver of a gated SPAD array: publishes `sensor` once, latched, and `gates` at a fixed rate.

Its simulated camera sees a head before a wall; with the argument `wall`, the wall alone.
"""
import json
import signal
import sys
from array import array

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String

ROWS, COLS, CYCLES, PERIOD_S, NOTHING = 32, 32, 1504, 0.01, 65535   # a message: 1,504 laser cycles, 10 ms
REPORT_S, BIN_M, WALL_BIN = 5.0, 0.03747, 80                        # a bin of 250 ps is 37 mm: the wall is 3 m away
# Head, nose, neck and shoulders: centre x, y, z and radii of an ellipsoid, metres, optical frame.
BODY = () if "wall" in sys.argv[1:] else (
    (0, -0.05, 2.45, 0.08, 0.11, 0.1), (0, -0.03, 2.35, 0.02, 0.03, 0.05), (0, 0.08, 2.47, 0.05, 0.1, 0.05),
    (0, 0.24, 2.47, 0.2, 0.12, 0.1))
SENSOR = {"schema_version": 1, "rows": ROWS, "cols": COLS, "num_bins": 153, "bin_width_s": 250e-12,
          "irf": [0.04, 0.25, 0.71, 1, 0.71, 0.25, 0.04], "frame_id": "spad_optical",
          "projection": {"kind": "pinhole", "fx": 183.0, "fy": 183.0, "cx": 15.5, "cy": 15.5},
          "gates": {"first_word": 0, "no_detection": NOTHING}}
rng, published = np.random.default_rng(0), []


def scene_bins() -> np.ndarray:
    """The bin of what each pixel sees, [ROWS · COLS]: where its ray meets the first ellipsoid, or the wall."""
    row, col = np.mgrid[:ROWS, :COLS].reshape(2, -1)
    rays = np.stack([(col - 15.5) / 183, (row - 15.5) / 183, np.ones(ROWS * COLS)])
    rays, bins = rays / np.linalg.norm(rays, axis=0), np.full(ROWS * COLS, float(WALL_BIN))
    for *centre, a, b, c in BODY:
        ray, middle = rays / [[a], [b], [c]], np.array(centre) / (a, b, c)
        square, along = (ray**2).sum(axis=0), middle @ ray
        inside = along**2 - square * (middle @ middle - 1)
        bins[inside > 0] = np.minimum(bins, (along - np.sqrt(np.maximum(inside, 0))) / square / BIN_M)[inside > 0]
    return bins


def read_cycles() -> np.ndarray:
    """Replace this by your SDK: ToA words, uint16 [CYCLES, ROWS, COLS]; here 20 photons per pixel, half noise."""
    words, photons = np.full((CYCLES, ROWS, COLS), NOTHING, np.uint16), 20 * ROWS * COLS
    place = rng.integers(0, words.size, photons)
    echo = rng.normal(BINS[place % len(BINS)], 1.2).round()
    words.reshape(-1)[place] = np.where(rng.random(photons) < 0.5, echo, rng.integers(0, 153, photons))
    return words


def publish() -> None:
    message = Image(height=CYCLES * ROWS, width=COLS, encoding="16UC1", step=2 * COLS)
    started = node.get_clock().now().nanoseconds - round(PERIOD_S * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(started, 10**9)
    message.header.frame_id = SENSOR["frame_id"]
    message.data = array("B", read_cycles().tobytes())                  # a NumPy array takes 100 times as long
    gates.publish(message)
    published.append(message.header.stamp)


def report() -> None:
    node.get_logger().info(f"publishing gates, {len(published) / REPORT_S:.0f} a second")
    published.clear()


BINS = scene_bins()
rclpy.init()
stop = []
for number in (signal.SIGINT, signal.SIGTERM):      # rclpy's handler would raise KeyboardInterrupt, anywhere in rclpy
    signal.signal(number, lambda *_: stop.append(True))
node = rclpy.create_node("spad_driver")
sensor = node.create_publisher(String, "sensor", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
sensor.publish(String(data=json.dumps(SENSOR)))
gates = node.create_publisher(Image, "gates", QoSProfile(depth=5))
node.create_timer(PERIOD_S, publish)
node.create_timer(REPORT_S, report)
while not stop:
    rclpy.spin_once(node)
