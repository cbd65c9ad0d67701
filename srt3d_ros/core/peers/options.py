"""The options that all peers share."""

from srt3d_ros.core.srt3d import DEFAULT_FALSE_ALARM_RATE, check_options, kernels_for
from srt3d_ros.errors import require


def kernels_of(name: str, surfaces: int, device: str, false_alarm_rate: float | None = None):
    """The kernels for method `name`, or InvalidInput for an option that it cannot use."""
    check_options(surfaces, DEFAULT_FALSE_ALARM_RATE if false_alarm_rate is None else false_alarm_rate)
    require(device in ("auto", "cpu"), "device", device, f"cpu or auto: {name} has no CUDA kernels")
    return kernels_for("cpu")[1]
