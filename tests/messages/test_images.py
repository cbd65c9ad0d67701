"""Images of one number a pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as arrays

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import images
from srt3d_ros.messages.cdr import Header


@settings(max_examples=100, deadline=None)
@given(image=arrays.arrays(np.float32, arrays.array_shapes(min_dims=2, max_dims=2)))
def test_any_image_makes_the_trip(image):
    header, back = images.decode_cdr(images.encode_cdr(image, 7, "cam"))
    assert header == Header(7, "cam")
    assert back.shape == image.shape and back.tobytes() == image.tobytes() and back.flags.writeable


def test_image_that_is_not_contiguous_is_written_right():
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    assert (images.decode_cdr(images.encode_cdr(image[:, ::2], 0, ""))[1] == image[:, ::2]).all()


@pytest.mark.parametrize("image", [np.zeros((2, 3)), np.zeros((2, 3, 1), np.float32)])
def test_other_types_and_shapes_are_refused(image):
    with pytest.raises(InvalidInput, match=r"^image is float.*: expected float32 \[rows, cols\]"):
        images.encode_cdr(image, 0, "lidar")
