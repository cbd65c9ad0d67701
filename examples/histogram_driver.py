"""A minimal driver of a histogramming sensor: publishes `sensor` once, latched, and `histograms` at a fixed rate."""
import json
import signal
from array import array

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String

ROWS, COLS, BINS, PERIOD_S = 32, 48, 64, 1 / 60
SENSOR = {"schema_version": 1, "rows": ROWS, "cols": COLS, "num_bins": BINS, "bin_width_s": 400e-12,
          "irf": [0.03, 0.38, 1, 0.38, 0.03], "frame_id": "tof_optical",
          "projection": {"kind": "pinhole", "fx": 44.0, "fy": 44.0, "cx": 23.5, "cy": 15.5},
          "histograms": {"num_bins": BINS, "template": [60, 20, 5] + [0] * (BINS - 3)}}     # the cover glass
rng = np.random.default_rng(0)
shape = np.exp(-0.5 * ((np.arange(BINS) - 40) / 0.72)**2)               # bin 40: everything is 2.4 m away
expected = 2 + 50 * shape + SENSOR["histograms"]["template"]            # photons: ambient light, echo, cover glass


def read_histograms() -> np.ndarray:
    """Replace this by your SDK: photons per bin, uint8, uint16, int32 or float32 [ROWS, COLS, BINS]."""
    return rng.poisson(expected, (ROWS, COLS, BINS)).astype(np.uint16)


def publish() -> None:
    counts = read_histograms()
    message = Image(height=ROWS, width=COLS, encoding=f"16UC{BINS}", step=counts[0].nbytes)
    started = node.get_clock().now().nanoseconds - round(PERIOD_S * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(started, 10**9)
    message.header.frame_id = SENSOR["frame_id"]
    message.data = array("B", counts.tobytes())                         # a NumPy array takes 100 times as long
    histograms.publish(message)


rclpy.init()
stop = []
for number in (signal.SIGINT, signal.SIGTERM):      # rclpy's handler would raise KeyboardInterrupt, anywhere in rclpy
    signal.signal(number, lambda *_: stop.append(True))
node = rclpy.create_node("histogram_driver")
sensor = node.create_publisher(String, "sensor", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
sensor.publish(String(data=json.dumps(SENSOR)))
histograms = node.create_publisher(Image, "histograms", QoSProfile(depth=5))
node.create_timer(PERIOD_S, publish)
while not stop:
    rclpy.spin_once(node)
