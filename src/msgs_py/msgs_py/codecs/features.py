"""FeatureSet to and from sensor_msgs/PointCloud2: one point for each feature.

Fields, in this order: x y z float32 (the feature's middle, for viewers), kind uint8, then float64 start_x..z, end_x..z,
radius_major, radius_minor, err_par, err_per, major_x..z, arc_start, arc_sweep, and 21 fields cov_A_B, the upper
triangle of the covariance of both ends: A and B are sx sy sz of start and ex ey ez of end; NaN where it is not known.
Where features have an error in common, six more: common_A. Decoding goes by field name; major_*, arc_*, cov_* and
common_* may be missing, floats may be 32 or 64 bit. The round trip is exact.
"""

from __future__ import annotations

import array
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from ..features import FeatureSet
from ..numeric.covariances import UPPER, from_upper_triangles, upper_triangles
from .errors import CodecError

# Of both ends, in the order of the covariance's rows.
COORDINATES = ('sx', 'sy', 'sz', 'ex', 'ey', 'ez')
# Arrays of a FeatureSet, and the fields of the cloud that hold their columns.
VECTORS = {
    'start': ('start_x', 'start_y', 'start_z'),
    'end': ('end_x', 'end_y', 'end_z'),
    'radii': ('radius_major', 'radius_minor'),
    'err_par': ('err_par',),
    'err_per': ('err_per',),
    'major_axis': ('major_x', 'major_y', 'major_z'),
    'arc': ('arc_start', 'arc_sweep'),
    'covariance': tuple(f'cov_{COORDINATES[a]}_{COORDINATES[b]}' for a, b in zip(*UPPER)),
    'common': tuple(f'common_{name}' for name in COORDINATES),
}
# Arrays that a cloud may lack.
OPTIONAL = ('major_axis', 'arc', 'covariance', 'common')
ROW_WITH_COMMON = np.dtype(
    [('middle', '<f4', (3,)), ('kind', 'u1'), ('pad', 'V3')]
    + [(attribute, '<f8', (len(names),)) for attribute, names in VECTORS.items()]
)
ROW = np.dtype([(name, ROW_WITH_COMMON[name]) for name in ROW_WITH_COMMON.names or () if name != 'common'])

# Kinds of clouds, as publishers make them, whose layout is remembered.
LAYOUTS_KEPT = 16
_DATATYPES = {
    PointField.INT8: 'i1',
    PointField.UINT8: 'u1',
    PointField.INT16: 'i2',
    PointField.UINT16: 'u2',
    PointField.INT32: 'i4',
    PointField.UINT32: 'u4',
    PointField.FLOAT32: 'f4',
    PointField.FLOAT64: 'f8',
}
_CODES = {'f4': PointField.FLOAT32, 'u1': PointField.UINT8, 'f8': PointField.FLOAT64}


def features_to_cloud(features: FeatureSet, header: Header | None = None) -> PointCloud2:
    """The message of a set of features.

    Parameters
    ----------
    features : FeatureSet
        Metres, in the header's frame.
    header : std_msgs.msg.Header, optional

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        One point for each feature, little endian, height 1; the fields are those at the top of this module.

    Examples
    --------
    >>> cloud = features_to_cloud(FeatureSet.from_edges([[0, 0, 0.5]], [[0.1, 0, 0.5]]))
    >>> cloud.width, cloud.fields[3].name
    (1, 'kind')
    >>> cloud_to_features(cloud)
    FeatureSet(1 EDGE, 0 CURVE, 0 AXIS)
    """
    row = ROW_WITH_COMMON if features.common.any() else ROW
    rows = np.zeros(len(features), row)
    rows['middle'] = features.midpoints
    rows['kind'] = features.kind
    for attribute, names in VECTORS.items():
        if attribute not in (row.names or ()):
            continue
        values = getattr(features, attribute)
        if attribute == 'covariance':
            values = upper_triangles(values)
        rows[attribute] = values.reshape(len(features), len(names))
    cloud = PointCloud2()
    if header is not None:
        cloud.header = header
    cloud.height, cloud.width = 1, len(features)
    cloud.is_bigendian = False
    cloud.point_step = row.itemsize
    cloud.row_step = row.itemsize * len(features)
    cloud.is_dense = True
    cloud.fields = _fields(row)
    cloud.data = array.array('B', rows.tobytes())
    return cloud


def cloud_to_features(cloud: PointCloud2) -> FeatureSet:
    """The features of a cloud.

    Raises
    ------
    CodecError
        Names the field, when one is missing, truncated or out of range.
    """
    n = int(cloud.width) * int(cloud.height)
    point_step, row_step = int(cloud.point_step), int(cloud.row_step)
    offered = tuple((field.name, field.offset, field.datatype) for field in cloud.fields)
    row, columns = _layout(offered, bool(cloud.is_bigendian), point_step)
    if n and row_step < point_step * int(cloud.width):
        raise CodecError(f'features.row_step: {row_step} bytes, expected at least {point_step * int(cloud.width)}')
    needed = row_step * (int(cloud.height) - 1) + point_step * int(cloud.width) if n else 0
    if len(cloud.data) < needed:
        raise CodecError(f'features.data: {len(cloud.data)} bytes, expected {needed} for {n} features; truncated?')
    if n == 0:
        return FeatureSet.empty()
    buffer = np.frombuffer(cloud.data, np.uint8)
    rows = np.concatenate(
        [buffer[i * row_step : i * row_step + point_step * int(cloud.width)] for i in range(int(cloud.height))]
    ).view(row)
    values = {
        attribute: np.concatenate([np.asarray(rows[name], np.float64).reshape(n, -1) for name in names], axis=1)
        for attribute, names in columns.items()
    }
    for attribute in ('err_par', 'err_per'):
        values[attribute] = values[attribute][:, 0]
    if 'covariance' in values:
        values['covariance'] = from_upper_triangles(values['covariance'])
    try:
        return FeatureSet(kind=rows['kind'].astype(np.int64), **values)
    except ValueError as error:
        raise CodecError(f'features.data: {error}') from None


def _fields(row: np.dtype[Any]) -> list[PointField]:
    """What the columns of rows are called."""
    assert row.fields is not None
    names = {'middle': ('x', 'y', 'z'), 'kind': ('kind',), **VECTORS}
    made = []
    for part, columns in names.items():
        if part not in row.fields:
            continue
        dtype, start = row.fields[part][:2]
        for k, name in enumerate(columns):
            offset = start + k * dtype.base.itemsize
            made.append(PointField(name=name, offset=offset, datatype=_CODES[dtype.base.str[1:]], count=1))
    return made


@lru_cache(maxsize=LAYOUTS_KEPT)
def _layout(
    fields: tuple[tuple[str, int, int], ...], is_bigendian: bool, point_step: int
) -> tuple[np.dtype[Any], dict[str, tuple[str, ...]]]:
    """How the points of a cloud lie in memory, and for each array of a FeatureSet the parts that make it.

    fields : name, offset and datatype of each

    Raises
    ------
    CodecError
        Names the field, when one is missing or out of range.
    """
    offered = {name: (offset, datatype) for name, offset, datatype in fields}
    columns = {
        attribute: names
        for attribute, names in VECTORS.items()
        if attribute not in OPTIONAL or all(name in offered for name in names)
    }
    wanted = ['kind', *(name for names in columns.values() for name in names)]
    missing = [name for name in wanted if name not in offered]
    if missing:
        raise CodecError(
            f'features.fields: no field {missing[0]!r}; is this a cloud of features? '
            f'It has {", ".join(offered) or "no fields"}'
        )
    places: dict[str, tuple[int, np.dtype[Any]]] = {}
    order: Literal['>', '<'] = '>' if is_bigendian else '<'
    for name in wanted:
        offset, datatype = offered[name]
        if datatype not in _DATATYPES:
            raise CodecError(f'features.fields: {name} has the unknown datatype {datatype}')
        dtype = np.dtype(_DATATYPES[datatype]).newbyteorder(order)
        if offset + dtype.itemsize > point_step:
            raise CodecError(
                f'features.fields: {name} ends at byte {offset + dtype.itemsize}, beyond point_step {point_step}'
            )
        places[name] = offset, dtype
    parts: dict[str, tuple[int, Any]] = {'kind': places['kind']}
    made: dict[str, tuple[str, ...]] = {}
    for attribute, names in columns.items():
        start, dtype = places[names[0]]
        # Columns that lie side by side are read at once.
        if all(places[name] == (start + k * dtype.itemsize, dtype) for k, name in enumerate(names)):
            parts[attribute], made[attribute] = (start, (dtype, (len(names),))), (attribute,)
        else:
            parts.update({name: places[name] for name in names})
            made[attribute] = names
    offsets, formats = zip(*parts.values())
    row = np.dtype({'names': list(parts), 'formats': formats, 'offsets': offsets, 'itemsize': point_step})
    return row, made
