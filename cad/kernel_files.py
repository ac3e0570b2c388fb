"""CAD kernel files: STEP, and an exact binary format for exchange between processes.

Slow to import, like `stiffscope.cad.kernel`.
"""

# pyright: reportAttributeAccessIssue=false
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.BinTools import BinTools
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.StepBasic import StepBasic_Product
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.STEPControl import (
    STEPControl_Reader,
    STEPControl_StepModelType,
    STEPControl_Writer,
)
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name, TDataStd_TreeNode
from OCP.TDocStd import TDocStd_Document
from OCP.TopoDS import TopoDS
from OCP.XCAFDoc import XCAFDoc, XCAFDoc_Material, XCAFDoc_ShapeTool
from OCP.XCAFPrs import (
    XCAFPrs_DocumentExplorer,
    XCAFPrs_DocumentExplorerFlags_OnlyLeafNodes,
)

from stiffscope.cad.kernel import Shape, Solid, compound, rows_of


def read_step(path: Path) -> Shape:
    """Return the content of a STEP file as one shape, mm; an empty compound if it is unreadable."""
    reader = STEPControl_Reader()
    if (
        reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
        and reader.TransferRoots()
    ):
        shape = reader.OneShape()
        if shape is not None and not shape.IsNull():
            return shape
    return compound()


@dataclass(frozen=True, eq=False)
class PlacedProduct:
    """A leaf of an assembly tree: names on its path, product number, shape, place and material.

    ``place`` (3, 4): rotation, and translation in mm.
    """

    path: list[str]
    product: int
    shape: Shape
    place: list[list[float]]
    material: str


def read_products(path: Path) -> list[PlacedProduct]:
    """Return the leaves of a STEP file's product tree, mm; none if it is unreadable."""
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    reader.SetMatMode(True)
    if reader.ReadFile(
        str(path)
    ) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        return []
    explorer = XCAFPrs_DocumentExplorer(
        document, XCAFPrs_DocumentExplorerFlags_OnlyLeafNodes
    )
    products = []
    while explorer.More():
        node = explorer.Current()
        depth = explorer.CurrentDepth()
        nodes = (explorer.Current(level) for level in range(depth + 1))
        products.append(
            PlacedProduct(
                path=[
                    _label_name(label.Label) or _label_name(label.RefLabel)
                    for label in nodes
                ],
                product=node.RefLabel.Tag(),
                shape=XCAFDoc_ShapeTool.GetShape_s(node.RefLabel),
                place=rows_of(node.Location.Transformation(), 4).tolist(),
                material=_material_name(node.RefLabel),
            )
        )
        explorer.Next()
    return products


def _label_name(label: Any) -> str:
    if not label.IsAttribute(TDataStd_Name.GetID_s()):
        return ""
    name = TDataStd_Name()
    label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return "".join(
        letter for letter in name.Get().ToExtString() if letter.isprintable()
    ).strip()


def _material_name(label: Any) -> str:
    """Return a product's material name in the file, or ""."""
    if not label.IsAttribute(XCAFDoc.MaterialRefGUID_s()):
        return ""
    link = TDataStd_TreeNode()
    material = XCAFDoc_Material()
    label.FindAttribute(XCAFDoc.MaterialRefGUID_s(), link)
    link.Father().Label().FindAttribute(XCAFDoc_Material.GetID_s(), material)
    return material.GetName().String().ToCString().strip()


def write_step(shape: Shape, path: Path) -> None:
    """Write a reproducible STEP file, mm, without date. Raises OSError if it cannot be written."""
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    model = writer.Model()
    name = TCollection_HAsciiString(path.stem)
    APIHeaderSection_MakeHeader(model).SetTimeStamp(
        TCollection_HAsciiString("1970-01-01T00:00:00")
    )
    for number in range(1, model.NbEntities() + 1):
        entity = model.Value(number)
        if isinstance(entity, StepBasic_Product):  # numbered by the kernel
            entity.SetId(name)
            entity.SetName(name)
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        path.write_bytes(
            bytes(1 << 20)
        )  # raises the system's reason, which the kernel keeps, e.g. a full disk
        raise OSError(f"{path}: cannot be written")


def read_binary(path: Path) -> Solid:
    """Return the solid written by `write_binary`."""
    return TopoDS.Solid(read_any(path))


def read_any(path: Path) -> Shape:
    """Return the shape written by `write_binary`."""
    shape = Shape()
    BinTools.Read_s(shape, str(path))
    return shape


def write_binary(shape: Shape, path: Path) -> None:
    """Write a shape exactly, for another process."""
    BRepTools.Clean_s(shape)
    BinTools.Write_s(shape, str(path))
