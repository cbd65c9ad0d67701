#!/bin/sh
# Reconstruct a frame and run some tests on an emulated arm64 processor, a Cortex-A72 with Debian 13.
#
#     sudo apt install debootstrap debian-archive-keyring qemu-user-static
#     sudo tools/on_arm64.sh
#
# Root, for debootstrap and chroot. The userland, 1 GB, stays in build/arm64. PYTHON has the package installed; the points
# of its processor must have the same bits. PyPI has no ROS 2 for arm64, so nodes are not tested.
set -e
cd "$(dirname "$0")/.."
root=$PWD/build/arm64
python=${PYTHON:-$PWD/.venv/bin/python}
points='import hashlib, srt3d_ros
cloud = srt3d_ros.reconstruct("examples/head.npz")
arrays = cloud.row, cloud.col, cloud.depth_bins, cloud.intensity, cloud.depth_std_bins, cloud.background
print(len(cloud), "points", hashlib.sha256(b"".join(map(bytes, arrays))).hexdigest()[:16])'

if ! test -e /proc/sys/fs/binfmt_misc/qemu-aarch64; then
    echo 'on_arm64.sh: Linux does not run arm64 programs here: install qemu-user-static, or mount binfmt_misc' >&2
    exit 1
fi
if ! test -e "$root/installed"; then
    rm -rf "$root"
    debootstrap --arch=arm64 --variant=minbase --include=python3,libgomp1 trixie "$root"
    "$python" -m pip install --quiet --target "$root/opt/packages" --only-binary=:all: --python-version 3.13 \
        --platform manylinux_2_28_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux_2_17_aarch64 \
        --platform manylinux2014_aarch64 -c constraints.txt \
        numpy scipy numba tqdm jsonschema pytest pytest-xdist hypothesis
    touch "$root/installed"
fi
rm -rf "$root/srt3d_ros" && mkdir "$root/srt3d_ros"
tar -c --exclude=__pycache__ srt3d_ros tests tools examples pyproject.toml | tar -x -C "$root/srt3d_ros"

on_arm64() {
    QEMU_CPU=cortex-a72 PYTHONPATH=/opt/packages NUMBA_CACHE_DIR=/var/cache/numba ROOT="$root" unshare --mount sh -c '
        mount -t proc proc "$ROOT/proc" && exec chroot "$ROOT" sh -c "cd /srt3d_ros && exec python3 \"\$@\"" sh "$@"' sh "$@"
}

there=$(on_arm64 -c "$points")
here=$("$python" -c "$points")
echo "arm64: $there"
echo "here:  $here"
test "$there" = "$here"
on_arm64 -m pytest -q -p no:cacheprovider tests/core/sketching/test_frame_sketcher.py tests/core/test_metrics.py \
    tests/core/method/test_pooled.py -k 'not as_large_as_points_claim'
