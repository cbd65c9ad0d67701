"""How much is measured: the paper's sizes in full, or a first look; and what ends a part early."""

from dataclasses import dataclass

PARTS = ("table1", "figure1", "sketching", "ros", "bytes")


class PartFailed(Exception):
    """A part could not be measured to its end; its argument is a list of what went wrong, in words."""


@dataclass(frozen=True)
class Plan:
    """The settings of a run; images have `side` × `side` pixels, in Table 1 each of `sides`.

    Args:
        device: "cpu" or "cuda", where methods compute; those that cannot stay on the CPU, and their lines say so.
        repeats: timed runs of each work.
        sketch_sizes: m of Table 1.
        ppps, dense_ppps: photons per pixel of Figure 1 and of sketching.
        cycles: laser cycles in a frame of gates.
        rate_s: how long each frame rate is tried through ROS, seconds.
        rate_steps: bisections in search of the highest rate.
        repeat_limit_s: a work whose runs have taken so long together is not repeated.
        limit_s: a method is not run on frames of so many photons that it would take longer than this for one.
        lights: (SBR, photons per pixel) of the simulated frames of `bytes`.
        photons: files for `bytes`.
        tolerance: of the files, as for `evaluation.cases.tolerance_bins`; None for the usual.
        every_size: of `bytes`: only every so-many-th size of a representation.
    """

    device: str = "cpu"
    repeats: int = 5
    sides: tuple[int, ...] = (141, 282, 423, 564, 705)
    sketch_sizes: tuple[int, ...] = (5, 10)
    side: int = 141
    ppps: tuple[float, ...] = (1, 3.16, 10, 31.6, 100, 316, 1000, 3160, 10_000)
    dense_ppps: tuple[float, ...] = (10, 100, 1000)
    cycles: int = 15_040
    rate_s: float = 3.0
    rate_steps: int = 4
    repeat_limit_s: float = 10.0
    limit_s: float = 60.0
    lights: tuple[tuple[float, float], ...] = ((1, 1), (1, 10), (1, 100), (0.1, 30))
    photons: tuple[str, ...] = ()
    tolerance: str | None = None
    every_size: int = 1


FULL = Plan()
QUICK = Plan(sides=(141, 282), ppps=(1, 10, 100, 1000), dense_ppps=(100,), rate_s=2.0, rate_steps=2,
             repeat_limit_s=3.0, lights=((1, 10),), every_size=2)
