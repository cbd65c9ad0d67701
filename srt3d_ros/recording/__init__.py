"""Write and read recordings (.rrd) without a viewer. No other room imports rerun."""

import os

os.environ.setdefault("RERUN_TELEMETRY", "0")       # set before rerun is imported: send no telemetry
