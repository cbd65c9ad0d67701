"""One fuzz target in a process of its own, started by `python -m robustness fuzz`, which reads `counts` meanwhile.

    python -m robustness.fuzz_worker TARGET ROUNDS SEED FOLDER

FOLDER gets each input that is a defect, with the reason beside it. An input that ends the process is saved there by
libFuzzer as crash-…, timeout-… or oom-….
"""

import hashlib
import os
import sys
import traceback
from pathlib import Path

import atheris
import numpy as np

KERNELS = Path(__file__).resolve().parents[1] / "srt3d_ros" / "kernels"
MAX_BYTES = 1 << 16         # of an input, or twice the longest example
HANG_S = 60
RSS_LIMIT_MB = 6000


def main() -> None:
    name, rounds, seed, folder = sys.argv[1], sys.argv[2], sys.argv[3], Path(sys.argv[4])
    # numba reads the kernels' bytecode, which must stay as it is. Atheris goes by the whole name of each module.
    kernels = [".".join(path.relative_to(KERNELS.parents[1]).with_suffix("").parts) for path in KERNELS.rglob("*.py")]
    with atheris.instrument_imports(include=["srt3d_ros", "rosbags"], exclude=kernels):
        from robustness.fuzz import DEFECTS, READ, TRIED
        from robustness.targets import Defect, targets, try_input
        target = targets()[name]
        read, examples = target.make()
        examples = list(examples)
        for example in examples:        # imports what is imported late
            try_input(target, read, example)
    for example in examples:
        (folder / "corpus" / hashlib.sha1(example).hexdigest()).write_bytes(example)
    counts, known = np.memmap(folder / "counts", np.uint64, "r+"), set()

    def one(raw: bytes) -> None:
        counts[TRIED] += 1
        try:
            counts[READ] += try_input(target, read, raw)
        except Defect as defect:
            where = traceback.extract_tb((defect.__cause__ or defect).__traceback__)[-1]
            key = type(defect.__cause__), where.filename, where.lineno
            if key not in known:        # one example of each
                known.add(key)
                counts[DEFECTS] += 1
                saved = folder / f"defect-{hashlib.sha1(raw).hexdigest()[:12]}"
                saved.write_bytes(raw)
                saved.with_suffix(".txt").write_text("".join(traceback.format_exception(defect)))

    atheris.Setup([sys.argv[0], f"-runs={rounds}", f"-seed={seed}",
                   f"-max_len={max(MAX_BYTES, 2 * max(map(len, examples)))}", f"-timeout={HANG_S}",
                   f"-rss_limit_mb={RSS_LIMIT_MB}", f"-artifact_prefix={folder}{os.sep}", "-len_control=0",
                   "-verbosity=0", str(folder / "corpus")], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
