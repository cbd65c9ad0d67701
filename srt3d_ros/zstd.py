"""zstd, as Python 3.14 has it and `backports.zstd` gives it before."""

import sys

if sys.version_info >= (3, 14):
    from compression.zstd import *  # noqa: F403
else:
    from backports.zstd import *  # noqa: F403
