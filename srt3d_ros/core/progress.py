"""Progress bars of what may take long."""

from collections.abc import Iterable

DELAY_S = 2.0           # what is done before needs none


def progress(steps: range, doing: str) -> Iterable[int]:
    """The steps, one after the other; on a terminal with a bar if they take longer than DELAY_S."""
    from tqdm import tqdm  # here: it takes a tenth of `import srt3d_ros`

    return tqdm(steps, doing, delay=DELAY_S, disable=None, leave=False)
