"""What differs between the ROS 2 distributions that the nodes run on: Jazzy has Fast DDS 2, Kilted Fast DDS 3."""

from importlib.metadata import version

FAST_DDS_3 = int(version("rclpy").split(".")[0]) >= 9       # rclpy is 7.1 in Jazzy, 9.1 in Kilted
PROFILE_VARIABLE = "FASTDDS_DEFAULT_PROFILES_FILE" if FAST_DDS_3 else "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES = "config/kilted" if FAST_DDS_3 else "config"      # for the other version, a profile is an error
SEGMENT = "fastdds_" if FAST_DDS_3 else "fastrtps_"         # how files in /dev/shm are named


def kilted(profile: str) -> str:
    """A profile of Fast DDS 2 as Fast DDS 3 wants it, where one element has another name."""
    return profile.replace("FASTRTPS_", "FASTDDS_").replace("heartbeatPeriod>", "heartbeat_period>")
