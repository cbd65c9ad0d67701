"""Progress bars for long work."""

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

DELAY_S = 2.0           # shorter work shows no bar
KERNELS = "srt3d_ros.kernels"
FIRST_KERNELS = 15      # kernels that the first cloud compiles


def progress(steps: range, doing: str) -> Iterable[int]:
    """The steps one by one, with a bar on a terminal after DELAY_S."""
    from tqdm import tqdm  # imported here: it takes a tenth of `import srt3d_ros`

    return tqdm(steps, doing, delay=DELAY_S, disable=None, leave=False)


@contextmanager
def compiling() -> Iterator[None]:
    """Show a bar while kernels compile in the block, unless their logger reports it, as in nodes."""
    from numba.core import event  # imported here: slow
    from tqdm import tqdm

    class Bar(event.Listener):
        bar, under_way = None, 0        # compilations nest: a kernel compiles what it calls

        def on_start(self, event) -> None:
            if self.bar is None and event.data["dispatcher"].__module__.startswith(KERNELS):
                self.bar = tqdm(total=FIRST_KERNELS, desc="compiling kernels (`srt3d compile` does it in advance)",
                                bar_format="{desc}: |{bar}| {n}/{total}", leave=False)
            self.under_way += 1

        def on_end(self, event) -> None:
            self.under_way -= 1
            if self.bar is not None and self.under_way == 0:
                self.bar.update()

    if logging.getLogger(KERNELS).isEnabledFor(logging.INFO):
        yield
        return
    with event.install_listener("numba:compile", Bar()) as shown:
        try:
            yield
        finally:
            if shown.bar is not None:
                shown.bar.close()
