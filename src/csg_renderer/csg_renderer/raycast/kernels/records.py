"""The records of arrays that the compiled loops take. n leaves, c children, q products, l lights, g terrains.

numba accepts named tuples as they are, and their arrays reach the machine code as if they were single arguments.
"""

from __future__ import annotations

from typing import NamedTuple

from msgs_py.numeric.typed import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray


class CsgPrograms(NamedTuple):
    """The children of a program, flattened.

    Attributes
    ----------
    product_start : (q + 1,)
        Into factors, the leaves of each product, its ``positive`` (q,) positives first.
    ambiguity : (q,)
        settings.AMBIGUOUS for one of several products of a child, 0 for a child's only one.
    code_start : (c + 1,)
        Into code and jump: postfix programs; after code[i], an empty list on the stack lets the program go on at
        jump[i], if that is not 0 (early out, Roth 1982).
    simple : (c,)
        The leaf of a child that is a single leaf, else -1.
    child_of : (n,)
        The child of each leaf.
    box : (6, c)
        Bounds of each child in the scene frame: low x y z, high x y z, metres.
    kind : (n,)
        Of the leaves.
    inverse : (n, 3, 4)
        Unit frame from scene.
    halfspaces : (n,)
    sphere : (n, 4)
        About each leaf in the scene frame: centre, metres, and squared radius.
    """

    product_start: IntArray
    positive: IntArray
    ambiguity: FloatArray
    factors: IntArray
    code_start: IntArray
    code: IntArray
    jump: IntArray
    simple: IntArray
    child_of: IntArray
    box: FloatArray
    kind: IntArray
    inverse: FloatArray
    sphere: FloatArray
    halfspaces: IntArray


class Materials(NamedTuple):
    """Surfaces and lights of a scene.

    Attributes
    ----------
    colours : (n, 6, 3) float64
        Linear RGB of each face.
    coefficients : (n, 6) float64
        Ambient, diffuse, specular, shininess, reflection, transparency.
    flat_normals : (n, 6, 3) float64
        Unit, of flat faces, scene frame.
    lights : (l, 3) float64
        Metres, scene frame.
    light_colours : (l, 3)
    ambient_light, background : (3,)
        Linear RGB.
    """

    colours: FloatArray
    coefficients: FloatArray
    flat_normals: FloatArray
    lights: FloatArray
    light_colours: FloatArray
    ambient_light: FloatArray
    background: FloatArray


class TerrainGrids(NamedTuple):
    """The terrains of a program.

    Attributes
    ----------
    leaf : (g,)
    heights : (sum of points,)
        Metres, row by row (Terrain.relief).
    there : (sum of points,)
        Whether the cell is there whose corner of least row and column a height is.
    start : (g,)
        Into heights and there.
    rows, columns : (g,)
    bilinear : (g,)
    low, high : (g,)
        Least and greatest height, metres.
    tints : (t, 4)
        Height (metres) and colour, of all terrains that are coloured by height.
    tint_start : (g + 1,)
        Into tints; where two are equal, the terrain between them has its surface's colour.
    """

    leaf: IntArray
    heights: FloatArray
    there: BoolArray
    start: IntArray
    rows: IntArray
    columns: IntArray
    bilinear: BoolArray
    low: FloatArray
    high: FloatArray
    tints: FloatArray
    tint_start: IntArray


class CameraData(NamedTuple):
    """Leaves and products as a camera sees them.

    Attributes
    ----------
    local : (n, 3, 4)
        Unit frame from camera.
    origin : (n, 3)
        Its last column with rounding removed.
    limit : (n, 3)
        Local direction components below it are zero.
    sphere : (n, 4)
        As in CsgPrograms, camera frame.
    span : (n, h, 2) int32
        First and last pixel of each image row that the leaf may touch; first > last: none.
    near : (q,)
        Least depth of each product, metres.
    listed : (k,)
        Children to evaluate by lists.
    chosen : (p,)
        Products to evaluate, front to back.
    """

    local: FloatArray
    origin: FloatArray
    limit: FloatArray
    sphere: FloatArray
    span: Int32Array
    near: FloatArray
    listed: IntArray
    chosen: IntArray


class Plan(NamedTuple):
    """What to render and how.

    Attributes
    ----------
    xs : (w,)
    ys : (h,)
        Ray components of pixel centres.
    dx, dy
        Ray component of one pixel.
    rotation : (3, 4)
        scene_T_camera.
    tolerance
        Metres, see program.View.
    span : (q, h, 2)
        Pixels of each product in each row.
    band : (q, bands, 2)
        The same for bands of ``size`` rows.
    size
        Pixels a side of a tile.
    whole
        No tiling.
    box
        See RenderOptions.
    """

    xs: FloatArray
    ys: FloatArray
    dx: float
    dy: float
    rotation: FloatArray
    tolerance: float
    span: Int32Array
    band: Int32Array
    size: int
    whole: bool
    box: int


class Target(NamedTuple):
    """The arrays of a Frame, (h, w) and (h, w, 3)."""

    image: ByteArray
    depth: Float32Array
    primitive: Int32Array
    face: Int32Array
    object: Int32Array
    normal: Float32Array


class Workspace(NamedTuple):
    """Scratch memory of one thread.

    Attributes
    ----------
    row
        The parts of rows.py, one after another.
    times, hits, starts
        See tree.child_boundaries.
    products : (q + 1,)
        Those of one tile.
    colours : (3, w)
        Sums of samples.
    counts : (4,)
        Intersections, nodes and combines so far (frame.RenderStats), and 1 once the rendering is to end (stop.Stop).
    """

    row: FloatArray
    times: FloatArray
    hits: FloatArray
    starts: IntArray
    products: IntArray
    colours: FloatArray
    counts: IntArray


class SecondaryRayWorkspace(NamedTuple):
    """Memory and options of shadows, mirrors and glass.

    Attributes
    ----------
    batch
        The parts of secondary_rays.py, one after another.
    stack : (rays, RAY_PARTS)
        Rays still to be cast.
    levels, shadows
        See RenderOptions.
    departure, tolerance
        Metres, see program.View.
    """

    batch: FloatArray
    stack: FloatArray
    levels: int
    shadows: bool
    departure: float
    tolerance: float


class Ray(NamedTuple):
    """One ray: origin and direction, metres."""

    ox: float
    oy: float
    oz: float
    dx: float
    dy: float
    dz: float


class PixelRun(NamedTuple):
    """The pixels first..last of an image row, in which rays lie."""

    row: int
    first: int
    last: int
