"""StaticTransform: the sensor's pose on /tf_static."""

from geometry_msgs.msg import TransformStamped

from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.motion_input import parse_extrinsics


class StaticTransform:
    """Publishes `extrinsics` in the frame `extrinsics_frame`, if that is set; without tf2_msgs the log says why not."""

    def __init__(self, node: PipelineNode):
        self._node, self._parent, self._child = node, node.parameters["extrinsics_frame"], ""
        self._publisher = None
        try:
            if self._parent:
                self._publisher = node.advertise(topics.TF_STATIC.name)
        except ModuleNotFoundError:
            node.get_logger().warning(f"extrinsics_frame {self._parent}: nothing is published on /tf_static, as "
                                      "tf2_msgs is missing (sudo apt install ros-jazzy-tf2-msgs; pip has none)")

    def publish(self, child: str) -> None:
        """Publish the pose of the sensor's frame `child`, unless it was the last one."""
        if self._publisher is None or child == self._child:
            return
        pose = parse_extrinsics(self._node.parameters["extrinsics"])
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id, message.header.stamp = self._parent, self._node.get_clock().now().to_msg()
        moved, turned = message.transform.translation, message.transform.rotation
        moved.x, moved.y, moved.z = pose.translation.tolist()
        turned.x, turned.y, turned.z, turned.w = pose.quaternion
        self._node.publish(self._publisher, self._publisher.msg_type(transforms=[message]))
        self._child = child
