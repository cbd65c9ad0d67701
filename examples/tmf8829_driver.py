"""A driver of the ams TMF8829: republishes the ZeroMQ messages of ams' Python driver as `sensor` and `histograms`.

    python tmf8829_driver.py tcp://169.254.0.2:5558         # set `histograms` to 1 in the device's configuration
"""
import signal
import sys

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import String
from tmf8829_messages import decode

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photon_frames, sensor_message

try:
    import zmq
except ModuleNotFoundError:
    sys.exit("tmf8829_driver: zmq is not installed: pip install pyzmq")
MOVED = 0.02        # Σ |h − h'| of two reference pulses of sum 1 if the pulse has moved by 0.04 bins; noise gives 0.01


def publish() -> None:
    global described
    if not socket.poll(0):
        return
    stamp_ns = node.get_clock().now().nanoseconds
    try:
        photons = decode(b"".join(socket.recv_multipart()), stamp_ns)
    except InvalidInput as error:
        node.get_logger().warning(str(error), throttle_duration_sec=5.0)
        return
    if photons is None:
        node.get_logger().warning("results only: set histograms to 1 in the configuration", throttle_duration_sec=5.0)
        return
    newest = photons.sensor
    if (described is None or described.irf.shape != newest.irf.shape
            or abs(described.irf - newest.irf).sum(axis=-1).max() > MOVED):
        described = newest
        sensor.publish(sensor_message.encode_cdr(described))
    histograms.publish(photon_frames.HISTOGRAMS.encode_cdr(photons.frame, described, described.frame_id))


_, *addresses = rclpy.utilities.remove_ros_args(sys.argv)
if len(addresses) != 1:
    sys.exit("tmf8829_driver: give the address of ams' driver, such as tcp://169.254.0.2:5558")
rclpy.init()
stop = []
for number in (signal.SIGINT, signal.SIGTERM):      # rclpy's handler would raise KeyboardInterrupt, anywhere in rclpy
    signal.signal(number, lambda *_: stop.append(True))
node = rclpy.create_node("tmf8829_driver")
described = None
sensor = node.create_publisher(String, "sensor", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
histograms = node.create_publisher(Image, "histograms", QoSProfile(depth=5))
socket = zmq.Context().socket(zmq.SUB)          # reconnects when the device comes back
socket.setsockopt(zmq.SUBSCRIBE, b"")
socket.setsockopt(zmq.RCVHWM, 4)                # drop older measurements
socket.setsockopt(zmq.HEARTBEAT_IVL, 1000)      # ms; a device that loses power does not close the connection
socket.connect(addresses[0])
node.create_timer(0.005, publish)
while not stop:
    rclpy.spin_once(node)
