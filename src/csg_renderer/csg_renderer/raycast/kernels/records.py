"""The records of arrays that the compiled loops take. n leaves, c children, q products, l lights, g terrains.

numba accepts named tuples as they are, and their arrays reach the machine code as if they were single arguments.
"""

from __future__ import annotations

from typing import NamedTuple

from msgs_py.numeric.typed import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray

from ..programs.surface_data import SurfaceData


class Hierarchy(NamedTuple):
    """Boxes within boxes, in preorder: a node's first part follows it.

    Attributes
    ----------
    frame : (3, 3)
        Orthogonal: a vector of the scene frame along the axes of the boxes.
    box : (6, nodes)
        Low x y z, high x y z, metres, along these axes.
    skip : (nodes,)
        The node after all parts of a node.
    child : (nodes,)
        The child whose box a node is, -1 for boxes of several.
    """

    frame: FloatArray
    box: FloatArray
    skip: IntArray
    child: IntArray


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
        Bounds of each child along the axes of the hierarchy: low x y z, high x y z, metres.
    hierarchy : Hierarchy
        Over these boxes.
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
    hierarchy: Hierarchy
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
    least : (n,)
        Least depth of each leaf, metres.
    """

    local: FloatArray
    origin: FloatArray
    limit: FloatArray
    sphere: FloatArray
    span: Int32Array
    near: FloatArray
    listed: IntArray
    chosen: IntArray
    least: FloatArray


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
        See RenderOptions; 0 where not every pixel takes all samples.
    samples
        Those of a pixel along a side, where it takes all.
    places : (n * n, 3) float64
        Of the samples of a pixel, see :func:`..raw_view.box_samples`.
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
    samples: int
    places: FloatArray


class RawRays(NamedTuple):
    """The rays of a camera whose lens distorts.

    Attributes
    ----------
    rays : (h + 2, w + 2, 2)
        (x, y) of the rays (x, y, 1) through the centres of the raw pixels, and of a border of one pixel about them; NaN
        where no light arrives.
    fx, fy, cx, cy, width, height
        Of the ideal camera that sees them all, whose pixels the spans of the Plan and of CameraData are.
    """

    rays: FloatArray
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class Lens(NamedTuple):
    """The distortion of a lens.

    Attributes
    ----------
    equidistant : bool
        Else rational_polynomial, of which plumb_bob is a part.
    coefficients : (8,)
        In the order of camera_info; zeros where there are fewer.
    widest
        See LensDistortion.
    """

    equidistant: bool
    coefficients: FloatArray
    widest: float


class Target(NamedTuple):
    """The arrays of a Frame, (h, w) and (h, w, 3); radiance is (0, 0, 3) where nobody wants it."""

    image: ByteArray
    depth: Float32Array
    primitive: Int32Array
    face: Int32Array
    object: Int32Array
    normal: Float32Array
    radiance: Float32Array


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


class Packets(NamedTuple):
    """Rays of a batch that are bounded together.

    Attributes
    ----------
    start : (PACKETS + 1,)
        The first ray of each, and the end of the last.
    many : (1,)
        How many there are.
    """

    start: IntArray
    many: IntArray


class Faces(NamedTuple):
    """Memory for bringing what lies on one face together.

    Attributes
    ----------
    number : (codes,)
        Of each code of a hit that has been found, -1 for all others and whenever nothing is being grouped.
    code, place : (STRIDE,)
        Of each number the code, and where its next member goes.
    """

    number: IntArray
    code: IntArray
    place: IntArray


class Meeting(NamedTuple):
    """Children that the packets of a batch may meet: the first of each array, as packets.children_met says. c children.

    Attributes
    ----------
    found : (c,)
        From near to far.
    order : (c,)
        The least length along a ray at which each may be met by any.
    place : (PACKETS, c)
        The same for the rays of each packet, inf where none ever meets it.
    work
        The parts of packets.py, one after another.
    """

    found: IntArray
    order: FloatArray
    place: FloatArray
    work: FloatArray


class SecondaryRayWorkspace(NamedTuple):
    """Memory and options of shadows, mirrors and glass. c children.

    Attributes
    ----------
    batch
        The parts of secondary_rays.py, one after another.
    stack : (rays, RAY_PARTS)
        Rays still to be cast.
    waiting : (2,)
        How many visible points are in the batch, and how many rays on the stack.
    colours : (3, rays)
        Sums of the light along each ray from the camera.
    bounds, beams : (PACKETS + 1, BOUNDS)
        Of the packets of the batch, see packets.py.
    open : (PACKETS,)
        How far the rays of each packet may still have something to find; negative when no ray has.
    lanes, given : (STRIDE,)
        Which rays of the batch are looked at closely, or in which order; scratch.
    packets : Packets
    faces : Faces
    meeting : Meeting
    levels, shadows
        See RenderOptions.
    departure, tolerance
        Metres, see program.View.
    """

    batch: FloatArray
    stack: FloatArray
    waiting: IntArray
    colours: FloatArray
    bounds: FloatArray
    beams: FloatArray
    open: FloatArray
    lanes: IntArray
    given: IntArray
    packets: Packets
    faces: Faces
    meeting: Meeting
    levels: int
    shadows: bool
    departure: float
    tolerance: float


class SurfaceRayWorkspace(NamedTuple):
    """Memory, data and options of pictures, metals, lights with a size and surroundings.

    Attributes
    ----------
    rays : SecondaryRayWorkspace
        What casting rays and feelers takes; its batch has the parts of surface_rays.py, too, its stack is not used.
    stack : (rays, SURFACE_RAY_PARTS)
        Rays still to be cast.
    samples
        See RenderOptions.
    surfaces
        Of the scene.
    """

    rays: SecondaryRayWorkspace
    stack: FloatArray
    samples: int
    surfaces: SurfaceData


class Differences(NamedTuple):
    """What tells where samples of a pixel may differ (differences.py). n leaves, p corners, l lights.

    Attributes
    ----------
    lines : (p, 6)
        Edges of the leaves, of what is round its outline: pixels of both ends, each with one over its depth, per metre.
    start : (n + 1,)
        Into lines; a half-space has none.
    bounds : (n, 4)
        Least and greatest column and row of the lines of each leaf.
    bend : (n,)
        Square of the greatest stretch from the camera's frame to the unit frame, per square metre.
    matt, shine : (n,)
        How much the shade changes at most, 1 a radian, while the angle to the lights changes, and while that of the
        mirrored ray to one of them does: two highlights are hardly ever at one place.
    narrow : (n,)
        Square of the turn of normals from pixel to pixel beyond which a highlight is narrower than a pixel.
    products : (n, 2)
        The first of those of the child of each leaf, and behind the last; two equal ones where it is no union of them.
    error : (n,)
        How far the lines may be off the leaf's, pixels.
    lights : (l, 3)
        Metres, camera frame.
    bent : (n,) bool
        Whether curved leaves are in the same child.
    """

    lines: FloatArray
    start: IntArray
    bounds: FloatArray
    bend: FloatArray
    matt: FloatArray
    shine: FloatArray
    narrow: FloatArray
    products: IntArray
    error: FloatArray
    lights: FloatArray
    bent: BoolArray


class Cells(NamedTuple):
    """Scratch memory for the pixels of a tile and their samples. t pixels; room for STRIDE samples.

    Attributes
    ----------
    flag : (t,)
        See differences.py.
    bent : (3 c,)
        Of a row of c columns and its colours, whether they bend.
    near : (t,)
        One over the depth of the nearest edge that passes among the samples, or 0.
    doubtful, sampled : (t,)
        Pixels whose corners are asked, and those that take all samples: their places in the tile.
    order : (STRIDE,)
        Of points that are shaded, brought together face by face, which each is.
    pixel, group, weight : (STRIDE,)
        Of each point: which of the pixels at hand it belongs to, the group of its face, and its share of the pixel.
    groups, members : (STRIDE,)
        Of each group the hit, and how many points there are.
    codes : (STRIDE,)
        Of the faces in a pixel: hits.
    aside, down : (STRIDE,)
        Of each sample: how far its ray is off that of the centre.
    quarter : (STRIDE,)
        Of each sample: in which quarter of the pixel it is.
    quarters : (4, 4)
        Sums over the samples on one face in each quarter.
    """

    flag: ByteArray
    bent: ByteArray
    near: FloatArray
    doubtful: IntArray
    sampled: IntArray
    order: IntArray
    pixel: IntArray
    group: IntArray
    weight: FloatArray
    groups: FloatArray
    members: IntArray
    codes: FloatArray
    aside: FloatArray
    down: FloatArray
    quarter: IntArray
    quarters: FloatArray


class Rays(NamedTuple):
    """Which rays of a row of samples lie where. w columns; room for STRIDE rays.

    Attributes
    ----------
    first : (w + 1,)
        The first ray at or behind a column.
    column : (rays,)
        Of each ray.
    pixel : (pixels,)
        The columns of the pixels that are sampled.
    order : (2 * rays,)
        Which ray each hit is once they are grouped; from ``taken`` on zeros, for finding that out.
    taken
    start : (rays + 1,)
        First rays of runs that see one face.
    sums : (3, pixels)
        Of colours.
    """

    first: IntArray
    column: IntArray
    pixel: IntArray
    order: IntArray
    taken: int
    start: IntArray
    sums: FloatArray


class Ray(NamedTuple):
    """One ray: origin and direction, metres."""

    ox: float
    oy: float
    oz: float
    dx: float
    dy: float
    dz: float


class PixelRun(NamedTuple):
    """The pixels first..last of the image rows row..bottom, in which rays lie."""

    row: int
    first: int
    last: int
    bottom: int
