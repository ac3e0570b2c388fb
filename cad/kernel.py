"""Queries of faces and edges through Open CASCADE, build123d's CAD kernel. Lengths in mm.

A build123d shape wraps a kernel shape (`shape.wrapped`); `build123d.Solid(shape)` wraps one.
Slow to import (0.5 to 1.5 s): import it inside functions.
"""

# pyright: reportAttributeAccessIssue=false
from collections.abc import Sequence
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from OCP.Bnd import Bnd_Box
from OCP.BOPAlgo import BOPAlgo_ArgumentAnalyzer
from OCP.BOPTools import BOPTools_AlgoTools3D
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepAlgoAPI import (
    BRepAlgoAPI_Common,
    BRepAlgoAPI_Fuse,
    BRepAlgoAPI_Section,
    BRepAlgoAPI_Splitter,
)
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeVertex,
    BRepBuilderAPI_MakeWire,
    BRepBuilderAPI_Sewing,
)
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepFeat import BRepFeat_SplitShape
from OCP.BRepGProp import BRepGProp, BRepGProp_Face
from OCP.BRepLib import BRepLib
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.collections import List_TopoDS_Shape
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
from OCP.gp import (
    gp_Ax2,
    gp_Ax3,
    gp_Circ,
    gp_Cone,
    gp_Cylinder,
    gp_Dir,
    gp_Pln,
    gp_Pnt,
    gp_Sphere,
    gp_Trsf,
    gp_Vec,
)
from OCP.GProp import GProp_GProps
from OCP.Message import Message, Message_PrinterOStream
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.ShapeFix import ShapeFix_Shape, ShapeFix_Solid
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import (
    TopoDS,
    TopoDS_Compound,
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Iterator,
    TopoDS_Shape,
    TopoDS_Solid,
    TopoDS_Vertex,
)

from stiffscope.runtime.types import Array

Floats = NDArray[np.float64]
Shape: TypeAlias = TopoDS_Shape
Solid: TypeAlias = TopoDS_Solid
Face: TypeAlias = TopoDS_Face
Edge: TypeAlias = TopoDS_Edge
Vertex: TypeAlias = TopoDS_Vertex


_FORMS: dict[str, Any] = {
    "Plane": gp_Pln,
    "Cylinder": gp_Cylinder,
    "Cone": gp_Cone,
    "Sphere": gp_Sphere,
}
_SAME = 1e-4  # mm: tolerance of splines that are one of these


def silence() -> None:
    """Suppress kernel messages on standard output, which carries the program's own output."""
    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        if isinstance(printer, Message_PrinterOStream):
            messenger.RemovePrinter(printer)


silence()


class Numbering:
    """Numbers of shapes by first occurrence, regardless of orientation (neighbours share them)."""

    def __init__(self) -> None:
        self._by_hash: dict[int, list[tuple[int, Shape]]] = {}
        self.count = 0

    def number_shape(self, item: Shape) -> int:
        """Return the number of a shape; new shapes get the next one."""
        same_hash = self._by_hash.setdefault(
            hash(item.Oriented(TopAbs_Orientation.TopAbs_FORWARD)), []
        )
        for number, other in same_hash:
            if item.IsSame(other):
                return number
        same_hash.append((self.count, item))
        self.count += 1
        return self.count - 1


def _list_distinct(shape: Shape, kind: Any, cast_to: Any) -> list[Any]:
    """Return distinct sub-shapes of a kind, in order of first occurrence."""
    explorer = TopExp_Explorer(shape, kind)
    distinct = []
    numbers = Numbering()
    while explorer.More():
        item = explorer.Current()
        if numbers.number_shape(item) == len(distinct):
            distinct.append(cast_to(item))
        explorer.Next()
    return distinct


def faces(shape: Shape) -> list[Face]:
    """Return the faces; their order, as in build123d's `solid.faces()`, defines face indices."""
    return _list_distinct(shape, TopAbs_ShapeEnum.TopAbs_FACE, TopoDS.Face)


def edges(shape: Shape) -> list[Edge]:
    """Return the distinct edges."""
    return _list_distinct(shape, TopAbs_ShapeEnum.TopAbs_EDGE, TopoDS.Edge)


def vertices(shape: Shape) -> list[Vertex]:
    """Return the distinct vertices."""
    return _list_distinct(shape, TopAbs_ShapeEnum.TopAbs_VERTEX, TopoDS.Vertex)


def solids(shape: Shape) -> list[Solid]:
    """Return the distinct solids."""
    return _list_distinct(shape, TopAbs_ShapeEnum.TopAbs_SOLID, TopoDS.Solid)


def round_holes(face: Face) -> list[tuple[Edge, Floats, float]]:
    """Return an edge, the centre (3,) and radius of each full-circle inner border of a face."""
    outer = BRepTools.OuterWire_s(face)
    holes = list[tuple[Edge, Floats, float]]()
    for wire in _list_distinct(face, TopAbs_ShapeEnum.TopAbs_WIRE, TopoDS.Wire):
        curves = [(edge, BRepAdaptor_Curve(edge)) for edge in edges(wire)]
        if wire.IsSame(outer) or not all(
            c.GetType() == GeomAbs_CurveType.GeomAbs_Circle for _, c in curves
        ):
            continue
        centres = np.array([xyz(c.Circle().Location()) for _, c in curves])
        radius = curves[0][1].Circle().Radius()
        turn = sum(c.LastParameter() - c.FirstParameter() for _, c in curves)
        if np.ptp(centres, axis=0).max() < 1e-6 and abs(turn - 2.0 * np.pi) < 1e-6:
            holes.append((curves[0][0], centres[0], radius))
    return holes


def count_borders(face: Face) -> int:
    """Return the number of closed borders of a face: 1 without holes."""
    return len(_list_distinct(face, TopAbs_ShapeEnum.TopAbs_WIRE, TopoDS.Wire))


def imprint_circle(
    solid: Solid, face: Face, centre: Floats, normal: Floats, radius: float
) -> tuple[Solid, list[Face]]:
    """Split a plane face along a circle; return the solid, and the pieces of the face in it.

    Parameters
    ----------
    solid, face
        Solid, and its plane face.
    centre, normal, radius
        Of the circle: (3,), (3,), and its radius in the unit of the solid.
    """
    circle = gp_Circ(gp_Ax2(gp_Pnt(*centre), gp_Dir(*normal)), radius)
    split = BRepFeat_SplitShape(solid)
    split.Add(
        BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire(), face
    )
    split.Build()
    return TopoDS.Solid(split.Shape()), [
        TopoDS.Face(piece) for piece in split.Modified(face)
    ]


def borders(shape: Shape) -> dict[tuple[int, int], list[Edge]]:
    """Return the common edges of adjacent faces, by pairs of face indices, smaller first."""
    numbers = Numbering()
    beside: dict[int, list[int]] = {}
    by_faces: dict[tuple[int, int], list[Edge]] = {}
    for index, face in enumerate(faces(shape)):
        for edge in edges(face):
            met = beside.setdefault(numbers.number_shape(edge), [])
            for other in met:
                by_faces.setdefault((other, index), []).append(edge)
            met.append(index)
    return by_faces


def corner_numbers(shape: Shape) -> list[frozenset[int]]:
    """Return the numbers of the vertices of each face; faces that touch have a common one."""
    numbers = Numbering()
    return [
        frozenset(numbers.number_shape(vertex) for vertex in vertices(face))
        for face in faces(shape)
    ]


def normal_angle(edge: Edge, beside: tuple[Face, Face]) -> float:
    """Return the angle (rad) between the outward normals of two faces at a common edge."""
    normals = []
    for face in beside:
        normal = gp_Dir()
        BOPTools_AlgoTools3D.GetNormalToFaceOnEdge_s(edge, face, normal)
        normals.append(xyz(normal))
    return float(np.arccos(np.clip(normals[0] @ normals[1], -1.0, 1.0)))


def compound(*shapes: Shape) -> TopoDS_Compound:
    """Return a compound of the shapes."""
    builder = BRep_Builder()
    union = TopoDS_Compound()
    builder.MakeCompound(union)
    for shape in shapes:
        builder.Add(union, shape)
    return union


def children(shape: Shape) -> list[Solid]:
    """Return the solids of a compound, in order."""
    walk = TopoDS_Iterator(shape)
    parts = list[Solid]()
    while walk.More():
        parts.append(TopoDS.Solid(walk.Value()))
        walk.Next()
    return parts


def is_valid(shape: Shape) -> bool:
    """Return whether the kernel finds the shape's topology and geometry consistent."""
    return BRepCheck_Analyzer(shape).IsValid()


def orient_solid(solid: Solid) -> Solid:
    """Return the solid with outward face normals."""
    turned = TopoDS.Solid(solid)
    BRepLib.OrientClosedSolid_s(turned)
    return turned


def diagonal(shape: Shape) -> float:
    """Return the bounding box diagonal; infinite for an unbounded or empty shape."""
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    return (
        float("inf")
        if box.IsVoid() or box.IsOpen()
        else float(np.sqrt(box.SquareExtent()))
    )


def find_interferences(shape: Shape) -> list[tuple[Floats, float]]:
    """Return where faces, edges or vertices interfere other than at shared borders.

    Neighbours within their tolerances count, which many sound solids have.

    Returns
    -------
    list
        Place (3,), and the size of what interferes if it is one face with itself, else 0.
    """
    analyzer = BOPAlgo_ArgumentAnalyzer()
    analyzer.SetShape1(shape)
    analyzer.SelfInterMode = True
    analyzer.Perform()
    interferences = []
    for result in analyzer.GetCheckResult() if analyzer.HasFaulty() else ():
        faulty = list(result.GetFaultyShapes1())
        if len(faulty) > 1:
            search = BRepExtrema_DistShapeShape(faulty[0], faulty[1])
            ends = [search.PointOnShape1(1), search.PointOnShape2(1)]
            interferences.append((np.mean([xyz(end) for end in ends], axis=0), 0.0))
        else:
            limits = bounds(faulty[0] if faulty else shape)
            interferences.append(
                (limits.mean(axis=0), float(np.linalg.norm(np.ptp(limits, axis=0))))
            )
    return interferences


def find_fault(shape: Shape) -> Floats | None:
    """Return the place (3,) of the first face that the kernel finds invalid; None if none is."""
    analyzer = BRepCheck_Analyzer(shape)
    for face in faces(shape):
        shapes = [face, *edges(face), *vertices(face)]
        if not all(analyzer.IsValid(each) for each in shapes):
            return bounds(face).mean(axis=0)
    return None


def heal_solid(shape: Shape) -> tuple[Shape, list[str]]:
    """Return a shape with its faults mended as far as the kernel can, and what was done."""
    done = []
    fix = ShapeFix_Shape(shape)
    if fix.Perform():
        done.append("faces, wires and tolerances fixed")
    healed = fix.Shape()
    if not is_valid(healed) or not solids(healed):
        sewing = BRepBuilderAPI_Sewing(1e-2)
        for face in faces(healed):
            sewing.Add(face)
        sewing.Perform()
        sewn = sewing.SewedShape()
        shells = _list_distinct(sewn, TopAbs_ShapeEnum.TopAbs_SHELL, TopoDS.Shell)
        if len(shells) == 1:
            healed = ShapeFix_Solid().SolidFromShell(shells[0])
            done.append("faces sewn within 0.01 mm")
    if not is_valid(healed):
        unify = ShapeUpgrade_UnifySameDomain(healed, True, True, False)
        unify.Build()
        healed = unify.Shape()
        done.append("faces of one surface united")
    return healed, done


def fuse(shapes: Sequence[Shape], fuzzy: float) -> Shape:
    """Return the union of several shapes; faces within ``fuzzy`` of each other coincide."""
    first = List_TopoDS_Shape()
    others = List_TopoDS_Shape()
    first.Append(shapes[0])
    for shape in shapes[1:]:
        others.Append(shape)
    union = BRepAlgoAPI_Fuse()
    union.SetArguments(first)
    union.SetTools(others)
    union.SetFuzzyValue(fuzzy)
    union.Build()
    if not union.IsDone():
        return compound()
    union.SimplifyResult(True, True)
    return union.Shape()


def surface_under(face: Face) -> tuple[str, Any]:
    """Return the kind of a face's surface, splines recognized, and its `gp_Pln` etc. or None."""
    surface = BRepAdaptor_Surface(face)
    form = None
    kind = surface.GetType().name.removeprefix("GeomAbs_")
    if kind in {*_FORMS, "Torus"}:
        form = getattr(surface, kind)()
    else:
        known = ShapeAnalysis_CanonicalRecognition(face)
        forms = ((each, empty()) for each, empty in _FORMS.items())
        kind, form = next(
            (e for e in forms if getattr(known, f"Is{e[0]}")(_SAME, e[1])),
            ("other", None),
        )
    return kind.lower(), form


def xyz(point: Any) -> Floats:
    """Return the coordinates (3,) of a kernel point, direction or vector."""
    return np.array([point.X(), point.Y(), point.Z()])


def rows_of(form: Any, columns: int) -> Floats:
    """Return a kernel matrix (3, 3), or a transformation (3, 4), as an array."""
    return np.array([[form.Value(i, j + 1) for j in range(columns)] for i in (1, 2, 3)])


def position(vertex: Vertex) -> Floats:
    """Return the position (3,) of a vertex."""
    return xyz(BRep_Tool.Pnt_s(vertex))


def closest(shape: Shape, point: Floats) -> Floats:
    """Return the point (3,) of a shape, borders included, closest to `point` (3,)."""
    search = BRepExtrema_DistShapeShape(
        BRepBuilderAPI_MakeVertex(gp_Pnt(*point)).Vertex(), shape
    )
    return xyz(search.PointOnShape2(1))


def closest_under(face: Face, points: Floats) -> Floats:
    """Return the points (n, 3) closest to `points` on a face's surface, in its parameter range."""
    search = GeomAPI_ProjectPointOnSurf()
    search.Init(BRep_Tool.Surface_s(face), *BRepTools.UVBounds_s(face), 1e-9)
    found = np.empty_like(points)
    for i, point in enumerate(points):
        search.Perform(gp_Pnt(*point))
        candidates = [
            closest(face, point)
        ]  # includes borders, if there is no perpendicular foot
        if search.NbPoints() > 0:
            candidates.append(xyz(search.NearestPoint()))
        found[i] = min(
            candidates, key=lambda candidate: float(np.linalg.norm(candidate - point))
        )
    return found


def distance(shape: Shape, point: Floats) -> float:
    """Return the distance from `point` (3,) to the shape."""
    return float(np.linalg.norm(closest(shape, point) - point))


def find_gap(shape: Shape, other: Shape) -> tuple[float, Floats]:
    """Return the distance between two shapes, and the point (3,) in the middle of the gap."""
    search = BRepExtrema_DistShapeShape(shape, other)
    ends = xyz(search.PointOnShape1(1)), xyz(search.PointOnShape2(1))
    return search.Value(), np.mean(ends, axis=0)


def in_axes(solid: Solid, origin: Floats, x: Floats, z: Floats) -> Solid:
    """Return the solid in axes of an origin (3,) and directions x, z (3,), in its present axes.

    Parameters
    ----------
    solid
        Solid in its present axes.
    origin
        Origin (3,) of the new axes, in the unit of the solid.
    x, z
        Directions (3,) of the new x and z.
    """
    change = gp_Trsf()
    change.SetTransformation(gp_Ax3(gp_Pnt(*origin), gp_Dir(*z), gp_Dir(*x)))
    return TopoDS.Solid(solid.Moved(TopLoc_Location(change)))


def place_solid(solid: Solid, rotation: Array, translation: Array) -> Solid:
    """Return the solid rotated by (3, 3), then translated by (3,)."""
    change = gp_Trsf()
    change.SetValues(*np.column_stack((rotation, translation)).ravel().tolist())
    return TopoDS.Solid(solid.Moved(TopLoc_Location(change)))


def bounds(shape: Shape) -> Floats:
    """Return the smallest and largest coordinates (2, 3) of a shape."""
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    return np.array([xyz(box.CornerMin()), xyz(box.CornerMax())])


def middle_of(face: Face) -> tuple[Floats, Floats]:
    """Return the point (3,) at the middle of a face's parameters, and its outward normal (3,)."""
    u, u_end, v, v_end = BRepTools.UVBounds_s(face)
    point = gp_Pnt()
    normal = gp_Vec()
    BRepGProp_Face(face).Normal(0.5 * (u + u_end), 0.5 * (v + v_end), point, normal)
    return xyz(point), xyz(normal)


def round_extent(
    face: Face, origin: Floats, axis: Floats, half_angle: float
) -> tuple[bool, Floats]:
    """Return whether a round face is hollow (solid outside), and its ends (2,) along its axis."""
    point, normal = middle_of(face)
    out = point - origin
    out -= axis * (axis @ out)  # for a sphere, whose axis is zero, from its centre
    if BRepAdaptor_Surface(face).GetType().name.removeprefix("GeomAbs_") in {
        *_FORMS,
        "Torus",
    }:
        ends = np.cos(half_angle) * np.array(BRepTools.UVBounds_s(face)[2:])
    else:
        ends = np.array(
            [axis @ (position(vertex) - origin) for vertex in vertices(face)]
        )
    return bool(normal @ out < 0.0), np.array([ends.min(), ends.max()])


def common_area(faces: tuple[Face, Face], step: Floats) -> tuple[float, Floats]:
    """Return the common area (mm²) of plane faces, the second moved by ``step``, and its centre."""
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(*step.tolist()))
    cut = BRepAlgoAPI_Common(faces[0], faces[1].Moved(TopLoc_Location(move)))
    properties = area_properties(cut.Shape() if cut.IsDone() else compound())
    return float(properties.Mass()), xyz(properties.CentreOfMass())


def common_outline(faces: tuple[Face, Face], step: Floats) -> list[Edge]:
    """Return the borders of the common of plane faces, the second moved by ``step``, mm."""
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(*step.tolist()))
    cut = BRepAlgoAPI_Common(faces[0], faces[1].Moved(TopLoc_Location(move)))
    return edges(cut.Shape()) if cut.IsDone() else []


def section(face: Face, point: Floats, normal: Floats) -> list[Edge]:
    """Return the edges in which a plane through a point (3,) cuts a face."""
    plane = gp_Pln(gp_Pnt(*point.tolist()), gp_Dir(*normal.tolist()))
    cut = BRepAlgoAPI_Section(face, plane, False)
    cut.Build()
    return edges(cut.Shape()) if cut.IsDone() else []


def is_seam(edge: Edge, face: Face) -> bool:
    """Return whether an edge is where a closed face meets itself."""
    return bool(BRep_Tool.IsClosed_s(edge, face))


def middle_of_edge(edge: Edge) -> Floats:
    """Return the point (3,) at the middle of an edge's parameters."""
    curve = BRepAdaptor_Curve(edge)
    return xyz(curve.Value(0.5 * (curve.FirstParameter() + curve.LastParameter())))


def inner_point(face: Face) -> Floats:
    """Return a point (3,) near a face, well within its borders: of its largest triangle."""
    size = diagonal(face)
    ((nodes, triangles),) = triangulate(face, 0.01 * size, 0.3)
    if not len(triangles):
        return middle_of(face)[0]
    corners = nodes[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    largest = int(np.argmax(np.linalg.norm(normals, axis=1)))
    return corners[largest].mean(axis=0)


def imprint_lines(
    solid: Solid, lines: list[Edge]
) -> tuple[Solid, dict[int, tuple[int, ...]]] | None:
    """Split a solid's faces along edges that lie on them; None if that gives no valid solid.

    Returns
    -------
    tuple
        The solid, and the indices of the pieces of each face, by its former index.
    """
    arguments, tools = List_TopoDS_Shape(), List_TopoDS_Shape()
    arguments.Append(solid)
    for line in lines:
        tools.Append(line)
    split = BRepAlgoAPI_Splitter()
    split.SetArguments(arguments)
    split.SetTools(tools)
    split.Build()
    solids_cut = solids(split.Shape()) if split.IsDone() else []
    if len(solids_cut) != 1 or not is_valid(solids_cut[0]):
        return None
    numbers = Numbering()
    for face in faces(solids_cut[0]):
        numbers.number_shape(face)
    count = numbers.count
    pieces = {}
    for index, face in enumerate(faces(solid)):
        pieces_of_face = [TopoDS.Face(piece) for piece in split.Modified(face)] or [
            face
        ]
        pieces[index] = tuple(numbers.number_shape(shape) for shape in pieces_of_face)
    if numbers.count > count:  # a piece that the solid has not
        return None
    return solids_cut[0], pieces


def volume_properties(shape: Shape) -> GProp_GProps:
    """Return volume (`Mass`), centre and inertia for density 1, in mm."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return properties


def area_properties(shape: Shape) -> GProp_GProps:
    """Return area (`Mass`), centre and second moments in mm."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties)
    return properties


def inertia(properties: GProp_GProps) -> Floats:
    """Return the inertia (3, 3) about the centre of mass."""
    return rows_of(properties.MatrixOfInertia(), 3)


def triangulate(
    shape: Shape, deflection: float, angle: float
) -> list[tuple[Floats, NDArray[np.int64]]]:
    """Return nodes (n, 3) and outward triangles (t, 3) of each face of a shape.

    Parameters
    ----------
    shape
        Shape whose faces are triangulated.
    deflection
        Largest distance of a triangle from its face, in the unit of the shape.
    angle
        Largest angle between normals of adjacent triangles, rad.
    """
    BRepTools.Clean_s(shape)
    BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    return [_triangles(face) for face in faces(shape)]


def _triangles(face: Face) -> tuple[Floats, NDArray[np.int64]]:
    place = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, place)
    if mesh is None:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    move = place.Transformation()
    nodes = np.array(
        [xyz(mesh.Node(i).Transformed(move)) for i in range(1, mesh.NbNodes() + 1)]
    )
    triangles = (
        np.array(
            [mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)],
            dtype=np.int64,
        )
        - 1
    )
    turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return nodes, cast("NDArray[np.int64]", triangles[:, ::-1] if turned else triangles)
