"""What a sensor is: geometry, timing, calibration."""
