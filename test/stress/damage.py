"""Ways in which messages arrive broken. Each takes a random generator and good messages, and damages them in place.

Every function here leaves messages that rclpy still sends; raw bytes that cannot be deserialised are made by
:func:`garbled`.
"""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

Messages = dict[str, Any]
TOPICS = ('left/image_rect', 'left/camera_info', 'right/image_rect', 'right/camera_info')
ODD_FLOATS = (float('nan'), float('inf'), -float('inf'), 0.0, -1.0, 1e-300, 1e300, 1e9, -1e9)
ODD_SIZES = (0, 1, 2, 3, 7, 97, 640, 65535, 2**31, 2**32 - 1)
ENCODINGS = (
    '',
    'mono8',
    'rgb8',
    'bgr8',
    'mono16',
    '32FC1',
    '8UC1',
    '8UC3',
    '16UC1',
    'yuv422',
    'bayer_rggb8',
    'rgba8',
    'MONO8',
    'mono8 ',
    '\U0001f4f7',
    'x' * 10000,
)


def one_of(rng: np.random.Generator, choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


# -- stereo pairs --------------------------------------------------------------------------------------------------


def data_length(rng, messages: Messages) -> None:
    image = messages[one_of(rng, TOPICS[::2])]
    length = int(
        one_of(rng, (0, 1, len(image.data) // 2, len(image.data) - 1, len(image.data) + 1, 3 * len(image.data)))
    )
    image.data = array.array('B', (bytes(image.data) * 4)[:length])


def image_field(rng, messages: Messages) -> None:
    image = messages[one_of(rng, TOPICS[::2])]
    field = one_of(rng, ('width', 'height', 'step', 'is_bigendian'))
    setattr(image, field, int(rng.integers(256)) if field == 'is_bigendian' else one_of(rng, ODD_SIZES))


def encoding(rng, messages: Messages) -> None:
    for topic in TOPICS[::2]:
        if rng.random() < 0.7:
            messages[topic].encoding = one_of(rng, ENCODINGS)


def noise(rng, messages: Messages) -> None:
    image = messages[one_of(rng, TOPICS[::2])]
    image.data = array.array('B', rng.integers(0, 256, len(image.data), dtype=np.uint8).tobytes())


def calibration(rng, messages: Messages) -> None:
    info = messages[one_of(rng, TOPICS[1::2])]
    matrix = one_of(rng, ('k', 'p', 'r', 'd'))
    values = np.array(getattr(info, matrix), float)
    for _ in range(int(rng.integers(1, 4))):
        values[rng.integers(len(values))] = one_of(rng, ODD_FLOATS)
    setattr(info, matrix, values.tolist())


def calibration_shape(rng, messages: Messages) -> None:
    info = messages[one_of(rng, TOPICS[1::2])]
    info.d = rng.normal(size=one_of(rng, (0, 1, 3, 7, 100))).tolist()
    info.distortion_model = one_of(rng, ('', 'plumb_bob', 'equidistant', 'rational_polynomial', 'none', '\x01'))


def info_size(rng, messages: Messages) -> None:
    for topic in TOPICS[1::2]:
        if rng.random() < 0.7:
            setattr(messages[topic], one_of(rng, ('width', 'height')), one_of(rng, ODD_SIZES))


def exchanged(rng, messages: Messages) -> None:
    kind = one_of(rng, ('image_rect', 'camera_info'))
    left, right = f'left/{kind}', f'right/{kind}'
    messages[left], messages[right] = messages[right], messages[left]


def one_stamp(rng, messages: Messages) -> None:
    """A message of another moment: the pair never completes."""
    stamp = messages[one_of(rng, TOPICS)].header.stamp
    stamp.nanosec = int(one_of(rng, (1, 999_999_999, 2**32 - 1)))


def clock_jump(rng, messages: Messages) -> None:
    now = messages[TOPICS[0]].header.stamp.sec
    for message in messages.values():
        message.header.stamp.sec = max(-(2**31), int(one_of(rng, (0, -1, -(2**31), now - 5, now + 5))))


def frame(rng, messages: Messages) -> None:
    name = one_of(rng, ('', '/', 'a b', '\U0001f4f7', 'f' * 5000))
    for message in messages.values():
        message.header.frame_id = name


def missing(rng, messages: Messages) -> None:
    del messages[one_of(rng, TOPICS)]


STEREO: tuple[Callable[..., None], ...] = (
    data_length,
    image_field,
    encoding,
    noise,
    calibration,
    calibration_shape,
    info_size,
    exchanged,
    one_stamp,
    clock_jump,
    frame,
    missing,
)


# -- feature clouds ------------------------------------------------------------------------------------------------


def cloud_data(rng, cloud: Any) -> None:
    data = bytes(cloud.data)
    length = int(one_of(rng, (0, 1, len(data) // 2, len(data) - 1, len(data) + 1, 2 * len(data))))
    cloud.data = array.array('B', (data * 2 + b'\0')[:length])


def cloud_bytes(rng, cloud: Any) -> None:
    data = np.frombuffer(bytes(cloud.data), np.uint8).copy()
    where = rng.integers(0, len(data), int(rng.integers(1, len(data))))
    data[where] = rng.integers(0, 256, len(where))
    cloud.data = array.array('B', data.tobytes())


def cloud_values(rng, cloud: Any) -> None:
    """Odd numbers, at the place of a field."""
    data = bytearray(bytes(cloud.data))
    for _ in range(int(rng.integers(1, 6))):
        row = int(rng.integers(cloud.width))
        field = cloud.fields[int(rng.integers(4, len(cloud.fields)))]
        start = row * cloud.point_step + field.offset
        data[start : start + 8] = np.array([one_of(rng, ODD_FLOATS)], '<f8').tobytes()
    cloud.data = array.array('B', bytes(data))


def cloud_size(rng, cloud: Any) -> None:
    setattr(cloud, one_of(rng, ('width', 'height', 'point_step', 'row_step')), one_of(rng, ODD_SIZES))


def cloud_fields(rng, cloud: Any) -> None:
    fields = list(cloud.fields)
    index = int(rng.integers(len(fields)))
    how = int(rng.integers(4))
    if how == 0:
        del fields[index]
    elif how == 1:
        fields[index].name = one_of(rng, ('', 'x', 'kind', 'start_x', 'n' * 1000))
    elif how == 2:
        fields[index].offset = one_of(rng, ODD_SIZES)
    else:
        fields[index].datatype = int(rng.integers(256))
    cloud.fields = fields


def cloud_order(rng, cloud: Any) -> None:
    cloud.is_bigendian = True


def cloud_stamp(rng, cloud: Any) -> None:
    cloud.header.stamp.sec = int(one_of(rng, (0, -1, -(2**31), 2**31 - 1)))


CLOUD: tuple[Callable[..., None], ...] = (
    cloud_data,
    cloud_bytes,
    cloud_values,
    cloud_size,
    cloud_fields,
    cloud_order,
    cloud_stamp,
)


# -- bytes on the wire ---------------------------------------------------------------------------------------------


def garbled(rng: np.random.Generator, message: Any) -> bytes:
    """A serialised message, cut short or with bytes changed where the lengths stand."""
    raw = bytearray(serialize_message(message))
    if rng.random() < 0.5:
        return bytes(raw[: int(rng.integers(4, min(len(raw), 400)))])
    for position in rng.integers(4, min(len(raw), 120), int(rng.integers(1, 6))):
        raw[position] = int(rng.integers(256))
    return bytes(raw)


# -- parameters ----------------------------------------------------------------------------------------------------


def parameter_value(rng: np.random.Generator) -> Any:
    """A value of any type that a parameter can have."""
    choices = (
        True,
        False,
        0,
        1,
        -1,
        2**62,
        -(2**62),
        10**6,
        *ODD_FLOATS,
        '',
        'native',
        'no such',
        '/',
        '../..',
        '\0',
        'x' * 3000,
        [],
        [''],
        ['a', 'b'],
        ['/etc/passwd'],
        [1, 2],
        [1.0, float('nan')],
        [True],
        b'bytes',
    )
    return one_of(rng, choices)
