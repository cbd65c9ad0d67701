"""Write and read recordings (.rrd) without a viewer. Nothing else but compat.py imports rerun."""

import os

os.environ.setdefault("RERUN_TELEMETRY", "0")       # set before rerun is imported: send no telemetry
