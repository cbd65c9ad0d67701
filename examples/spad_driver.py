"""A minimal driver of a gated SPAD array: publishes `sensor` once, latched, and `gates` at a fixed rate."""
import contextlib
import json
from array import array

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String

ROWS, COLS, CYCLES, PERIOD_S, NOTHING = 32, 32, 1504, 0.01, 65535   # a message: 1,504 laser cycles, 10 ms
SENSOR = {"schema_version": 1, "rows": ROWS, "cols": COLS, "num_bins": 153, "bin_width_s": 250e-12,
          "irf": [0.04, 0.25, 0.71, 1, 0.71, 0.25, 0.04], "frame_id": "spad_optical",
          "projection": {"kind": "pinhole", "fx": 183.0, "fy": 183.0, "cx": 15.5, "cy": 15.5},
          "gates": {"first_word": 0, "no_detection": NOTHING}}
rng = np.random.default_rng(0)


def read_cycles() -> np.ndarray:
    """Replace this by your SDK: ToA words, uint16 [CYCLES, ROWS, COLS]; here 20 photons per pixel, half noise."""
    words, photons = np.full((CYCLES, ROWS, COLS), NOTHING, np.uint16), 20 * ROWS * COLS
    toa = np.where(rng.random(photons) < 0.5, rng.normal(80, 1.2, photons).round(), rng.integers(0, 153, photons))
    words.reshape(-1)[rng.integers(0, words.size, photons)] = toa       # bin 80: everything is 3 m away
    return words


def publish() -> None:
    message = Image(height=CYCLES * ROWS, width=COLS, encoding="16UC1", step=2 * COLS)
    started = node.get_clock().now().nanoseconds - round(PERIOD_S * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(started, 10**9)
    message.header.frame_id = SENSOR["frame_id"]
    message.data = array("B", read_cycles().tobytes())                  # a NumPy array takes 100 times as long
    gates.publish(message)


rclpy.init()
node = rclpy.create_node("spad_driver")
sensor = node.create_publisher(String, "sensor", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
sensor.publish(String(data=json.dumps(SENSOR)))
gates = node.create_publisher(Image, "gates", QoSProfile(depth=5))
node.create_timer(PERIOD_S, publish)
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(node)
