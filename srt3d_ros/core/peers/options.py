"""The options that all peers share."""

from srt3d_ros.core.srt3d import MAX_SURFACES, kernels_for
from srt3d_ros.errors import require


def kernels_of(name: str, surfaces: int, device: str, false_alarm_rate: float | None = None):
    """The kernels for method `name`, or InvalidInput for an option that it cannot use."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")
    require(device in ("auto", "cpu"), "device", device, f"cpu or auto: {name} has no CUDA kernels")
    require(false_alarm_rate is None or 0 < false_alarm_rate < 1, "false_alarm_rate", false_alarm_rate,
            "a probability between 0 and 1")
    return kernels_for("cpu")[1]
