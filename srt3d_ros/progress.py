"""Progress bars of what may take long."""

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

DELAY_S = 2.0           # what is done before needs none
KERNELS = "srt3d_ros.kernels"
OF_A_CLOUD = 17         # kernels that the first cloud compiles


def progress(steps: range, doing: str) -> Iterable[int]:
    """The steps, one after the other; on a terminal with a bar if they take longer than DELAY_S."""
    from tqdm import tqdm  # here: it takes a tenth of `import srt3d_ros`

    return tqdm(steps, doing, delay=DELAY_S, disable=None, leave=False)


@contextmanager
def compiling() -> Iterator[None]:
    """Show a bar if kernels are compiled within the block; none where they log it themselves, as in nodes."""
    from numba.core import event  # here: slow
    from tqdm import tqdm

    class Bar(event.Listener):
        bar, under_way = None, 0        # a kernel compiles what it calls within its own compilation

        def on_start(self, event) -> None:
            if self.bar is None and event.data["dispatcher"].__module__.startswith(KERNELS):
                self.bar = tqdm(total=OF_A_CLOUD, desc="compiling kernels (`srt3d compile` does it beforehand)",
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
