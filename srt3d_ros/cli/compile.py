"""`srt3d compile`: compile kernels ahead, so that the first start is as fast as any other."""

import argparse
import time

from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "compile",
        description="Compile the CPU's kernels for this user and processor, or the GPU's for one sensor. Kernels of "
                    "other methods are compiled at their first use.")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu",
                        help="compile for it (default: %(default)s)")
    parser.add_argument("--sensor-file", metavar="FILE", help="sensor description, for --device cuda (default: the "
                        "simulator's sensor)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    require(args.device == "cuda" or not args.sensor_file, "--sensor-file",
            problem="--sensor-file needs --device cuda: the CPU's kernels suit every sensor.")
    if args.device == "cuda":
        return _for_gpu(args.sensor_file)
    from srt3d_ros import precompile
    from srt3d_ros.kernels.cpu.compiling import FOLDER, NOT_KEPT

    require(not NOT_KEPT, "NUMBA_CACHE_DIR", problem=f"Cannot keep kernels: {NOT_KEPT}. Set "
            "NUMBA_CACHE_DIR to a folder that only you can write to.")
    started, before = time.perf_counter(), set(FOLDER.rglob("*.nbc"))
    precompile.everything()
    new = set(FOLDER.rglob("*.nbc")) - before
    print(f"compiled {len(new)} kernels in {time.perf_counter() - started:.0f} s; they are in {FOLDER}")
    return 0


def _for_gpu(sensor_file: str | None) -> int:
    """Reconstruct a frame of the sensor on the GPU, so that torch compiles its kernels and caches them on disk."""
    from srt3d_ros import datasets
    from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE, choose_frequencies
    from srt3d_ros.datasets.simulation.scene import default_sensor
    from srt3d_ros.reconstruction import Reconstructor

    sensor, started = datasets.open_sensor(sensor_file) if sensor_file else default_sensor(), time.perf_counter()
    reconstructor = Reconstructor(sensor, choose_frequencies("auto", sensor, DEFAULT_SKETCH_SIZE), device="cuda")
    print(f"compiling for frames of {sensor.rows} × {sensor.cols} pixels; the first time takes minutes", flush=True)
    reconstructor.warm_up()
    require(reconstructor.device == "cuda", "--device",
            problem=f"Cannot use --device cuda: {reconstructor.device_reason}")
    print(f"compiled in {time.perf_counter() - started:.0f} s; torch keeps the kernels in TORCHINDUCTOR_CACHE_DIR")
    return 0
