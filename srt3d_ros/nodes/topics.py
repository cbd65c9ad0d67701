"""The topics of the pipeline. msg_schemas/ has the layouts of their messages."""

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterEvent
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.nodes.node_spec import Topic

SENSOR = Topic("sensor", String, "the sensor's description (JSON)", latched=True)
LENS = Topic("sensor/camera_info", CameraInfo, "the sensor's pinhole and lens, instead of the description's projection",
             when="a calibrated camera publishes it")
PHOTONS = Topic("photons", PointCloud2, "photons as events: row, col, time of arrival (ToA)")
GATES = Topic("gates", Image, "photons as the ToA words of a gated SPAD array")
SKETCH_SENSOR = Topic("sketch/sensor", String, "sensor, frequencies and window of the sketches (JSON)", latched=True)
SKETCH = Topic("sketch", PointCloud2, "of each pixel, the number of photons and m complex numbers")
POINTS = Topic("points", PointCloud2, "the surfaces' points, metres, in the sensor's frame")
WATCHED = "while somebody subscribes"
IMAGES = (
    Topic("depth", Image, "metres to the strongest point of each pixel: z of a pinhole sensor, range of a scanner",
          when=WATCHED),
    Topic("intensity", Image, "signal photons of the strongest point of each pixel", when=WATCHED),
    Topic("background", Image, "background photons of each pixel", when=WATCHED),
)
CAMERA_INFO = Topic("camera_info", CameraInfo, "the camera of the images", when=f"{WATCHED}, of a pinhole sensor")
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, "rates, latency, photons, points, drops by cause, last error")
ROSOUT = Topic("/rosout", Log, "what the nodes log")
PARAMETER_EVENTS = Topic("/parameter_events", ParameterEvent, "changes of the nodes' parameters")
