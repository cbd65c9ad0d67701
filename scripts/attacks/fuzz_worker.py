"""One door, one process, coverage-guided: started by fuzz.py, which reads the counts while it works.

    fuzz_worker.py DOOR RUNS SEED FOLDER

FOLDER gets `counts` (inputs tried, read, defects: three 64-bit integers) and each input that is a defect, with the
reason beside it. An input that ends the process is saved by libFuzzer as crash-…, timeout-… or oom-….
"""

import hashlib
import mmap
import os
import struct
import sys
import traceback
from pathlib import Path

import atheris
from process import REPOSITORY

COUNTS = struct.Struct("<QQQ")
INSTRUMENTED = ["srt3d_ros", "rosbags"]
MAX_BYTES = 1 << 16         # of an input, or twice the longest example
HANG_S = 60
RSS_LIMIT_MB = 6000


def main() -> None:
    name, runs, seed, folder = sys.argv[1], sys.argv[2], sys.argv[3], Path(sys.argv[4])
    with atheris.instrument_imports(include=INSTRUMENTED, exclude=kernels()):
        import fuzz_doors
        door = fuzz_doors.doors()[name]
        read, examples = door.make()
        examples = list(examples)
        for example in examples:        # imports what is imported late
            fuzz_doors.knock(door, read, example)
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    for example in examples:
        (corpus / hashlib.sha1(example).hexdigest()).write_bytes(example)
    with open(folder / "counts", "r+b") as file:
        counts = mmap.mmap(file.fileno(), COUNTS.size)
    longest, known = max(MAX_BYTES, 2 * max(map(len, examples))), set()

    def tell(tried: int = 0, were_read: int = 0, defects: int = 0) -> None:
        now = COUNTS.unpack_from(counts)
        COUNTS.pack_into(counts, 0, now[0] + tried, now[1] + were_read, now[2] + defects)

    def one(raw: bytes) -> None:
        tell(tried=1)
        try:
            tell(were_read=fuzz_doors.knock(door, read, raw))
        except fuzz_doors.Defect as defect:
            where = traceback.extract_tb((defect.__cause__ or defect).__traceback__)[-1]
            key = type(defect.__cause__), where.filename, where.lineno
            if key not in known:        # one example of each
                known.add(key)
                tell(defects=1)
                saved = folder / f"defect-{hashlib.sha1(raw).hexdigest()[:12]}"
                saved.write_bytes(raw)
                saved.with_suffix(".txt").write_text("".join(traceback.format_exception(defect)))

    atheris.Setup([sys.argv[0], f"-runs={runs}", f"-seed={seed}", f"-max_len={longest}", f"-timeout={HANG_S}",
                   f"-rss_limit_mb={RSS_LIMIT_MB}", f"-artifact_prefix={folder}{os.sep}", "-len_control=0",
                   "-verbosity=0", str(corpus)], one)
    atheris.Fuzz()


def kernels() -> list[str]:
    """Modules that are left as they are: numba reads their bytecode. Atheris goes by the whole name of each."""
    return [".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
            for path in (REPOSITORY / "srt3d_ros" / "kernels").rglob("*.py")]


if __name__ == "__main__":
    main()
