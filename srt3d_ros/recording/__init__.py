"""Recordings (.rrd): written off-screen while the pipeline runs, read back without a viewer. rerun only here."""

import os

os.environ.setdefault("RERUN_TELEMETRY", "0")       # before rerun is first imported: nothing is sent anywhere
