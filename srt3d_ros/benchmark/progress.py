"""The progress bar of a part: what is being measured, and how far it is."""

import sys

from tqdm import tqdm

FORMAT = "{desc:<50} |{bar:20}| {n_fmt}/{total_fmt} [{elapsed}]"


class Progress(tqdm):
    """A bar on stderr; where that is no terminal, a line every ten seconds.

    Args:
        title: before what is being done.
        steps: of the bar.
    """

    def __init__(self, title: str, steps: int):
        self._title, self._live = title, sys.stderr.isatty()
        super().__init__(total=steps, mininterval=0.1 if self._live else 10.0, bar_format=FORMAT, file=sys.stderr,
                         leave=self._live)

    def says(self, what: str) -> None:
        """This is being done now."""
        self.set_description_str(f"{self._title}: {what}", refresh=self._live)

    def update(self, n: float = 1) -> bool | None:
        """Move by n, no further than to the end: what is found may take more steps than were foreseen."""
        return super().update(min(n, self.total - self.n))
