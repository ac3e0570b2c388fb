"""Solids drawn with Open CASCADE, for parametric shapes. Lengths in mm.

build123d draws with the same calls, but its import alone takes three seconds of a processor, more
than any of these parts. Slow to import, like `stiffscope.cad.kernel`.
"""

# pyright: reportAttributeAccessIssue=false
from collections.abc import Sequence
from typing import Any

from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakePolygon,
    BRepBuilderAPI_MakeWire,
)
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakePrism,
    BRepPrimAPI_MakeRevol,
)
from OCP.collections import List_TopoDS_Shape
from OCP.gp import gp_Ax1, gp_Ax2, gp_Circ, gp_Dir, gp_Pnt, gp_Vec
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.Standard import Standard_Failure
from OCP.StdFail import StdFail_NotDone
from OCP.TopoDS import TopoDS, TopoDS_Wire

from stiffscope.cad.kernel import Edge, Face, Shape, is_valid

Point = Sequence[float]


def box(corner: Point, sizes: Point) -> Shape:
    """Return a box from its corner of least coordinates (3,) and its sizes (3,)."""
    return BRepPrimAPI_MakeBox(gp_Pnt(*corner), *sizes).Shape()


def cylinder(base: Point, radius: float, height: float) -> Shape:
    """Return a cylinder along z from the centre (3,) of its base."""
    axes = gp_Ax2(gp_Pnt(*base), gp_Dir(0.0, 0.0, 1.0))
    return BRepPrimAPI_MakeCylinder(axes, radius, height).Shape()


def polygon(corners: Sequence[Point]) -> TopoDS_Wire:
    """Return the closed polygon of corners (n, 3)."""
    sides = BRepBuilderAPI_MakePolygon()
    for corner in corners:
        sides.Add(gp_Pnt(*corner))
    sides.Close()
    return sides.Wire()


def circle_about_x(radius: float) -> TopoDS_Wire:
    """Return the circle about the x axis in the plane x = 0."""
    axes = gp_Ax2(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(1.0, 0.0, 0.0), gp_Dir(0.0, 1.0, 0.0))
    edge = BRepBuilderAPI_MakeEdge(gp_Circ(axes, radius)).Edge()
    return BRepBuilderAPI_MakeWire(edge).Wire()


def plane_face(border: TopoDS_Wire, holes: Sequence[TopoDS_Wire] = ()) -> Face:
    """Return the plane face in a border, without holes whose borders run the same way round."""
    face = BRepBuilderAPI_MakeFace(border, True)
    for hole in holes:
        face.Add(TopoDS.Wire(hole.Reversed()))
    return face.Face()


def extrude_along_x(face: Face, length: float) -> Shape:
    """Return the prism of a face, of a length along x."""
    return BRepPrimAPI_MakePrism(face, gp_Vec(length, 0.0, 0.0)).Shape()


def revolve_about_x(face: Face) -> Shape:
    """Return the solid of a face revolved about the x axis."""
    axis = gp_Ax1(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(1.0, 0.0, 0.0))
    return _unify(BRepPrimAPI_MakeRevol(face, axis).Shape())


def unite(first: Shape, second: Shape) -> Shape:
    """Return the union, with faces and edges of one surface or curve united."""
    return _operate(BRepAlgoAPI_Fuse(), first, second)


def subtract(first: Shape, second: Shape) -> Shape:
    """Return the first shape without the second, united as by `unite`."""
    return _operate(BRepAlgoAPI_Cut(), first, second)


def fillet(shape: Shape, edges: Sequence[Edge], radius: float) -> Shape:
    """Return a shape with rounded edges; raise ValueError if the kernel cannot round them."""
    builder = BRepFilletAPI_MakeFillet(shape)
    for edge in edges:
        builder.Add(radius, edge)
    try:
        rounded = builder.Shape()
    except (StdFail_NotDone, Standard_Failure) as error:
        raise ValueError("the CAD kernel finds no fillet") from error
    if not is_valid(rounded):
        raise ValueError("the fillet crosses other faces")
    return rounded


def _operate(operation: Any, first: Shape, second: Shape) -> Shape:
    arguments = List_TopoDS_Shape()
    arguments.Append(first)
    tools = List_TopoDS_Shape()
    tools.Append(second)
    operation.SetArguments(arguments)
    operation.SetTools(tools)
    operation.Build()
    return _unify(operation.Shape())


def _unify(shape: Shape) -> Shape:
    unify = ShapeUpgrade_UnifySameDomain(shape, True, True, True)
    unify.AllowInternalEdges(False)
    unify.Build()
    return unify.Shape()
