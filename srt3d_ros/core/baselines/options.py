"""The options that all baselines share."""

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.pooled import DEFAULT_FALSE_ALARM_RATE, check_options


def kernels_of(surfaces: int, device: str, false_alarm_rate: float | None = None):
    """The device that is meant and its kernels, or InvalidInput for an option that a baseline cannot use."""
    check_options(surfaces, DEFAULT_FALSE_ALARM_RATE if false_alarm_rate is None else false_alarm_rate)
    return kernels_for(device)
