"""A sensor driver for tests: describes its sensor, sends so many packets of `gates` that see a plane, and stays.

Parameters: sensor (path of its description), range_m, packets, start_s (of the first stamp; packets are 10 ms apart).
"""

import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonGates
from srt3d_ros.messages import gates
from srt3d_ros.messages import sensor as sensor_message

CYCLES, SPREAD_BINS, INTERVAL_NS = 40, 2, 10_000_000

rclpy.init()
node = rclpy.create_node("driver", automatically_declare_parameters_from_overrides=True)
given = ("sensor", "range_m", "packets", "start_s")
path, range_m, packets, start_s = (node.get_parameter(name).value for name in given)
sensor = sensor_message.from_json(Path(path).read_text())
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
description = node.create_publisher(String, "sensor", latched)
description.publish(sensor_message.encode(sensor))
publisher = node.create_publisher(Image, "gates", QoSProfile(depth=packets))
while not publisher.get_subscription_count() or not description.get_subscription_count():
    time.sleep(0.01)
description.wait_for_all_acked()

depth = (range_m - sensor.range_offset_m) / sensor.bin_width_m - sensor.toa_offset_bins
random = np.random.default_rng(0)
for packet in range(packets):
    toa = np.rint(random.normal(depth, SPREAD_BINS, (CYCLES, sensor.rows, sensor.cols))).astype(np.uint16)
    cycles = PhotonGates(toa + np.uint16(sensor.gates.first_word), round(start_s * 1e9) + packet * INTERVAL_NS)
    publisher.publish(gates.encode_cdr(cycles, sensor, sensor.frame_id))
print(f"sent {packets}", flush=True)
time.sleep(1000)
