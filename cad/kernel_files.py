"""Files of the CAD kernel: STEP, and the kernel's exact binary format to exchange solids between processes.

Slow to import, as `stiffscope.cad.kernel` is.
"""

# pyright: reportAttributeAccessIssue=false
from pathlib import Path

from OCP.BinTools import BinTools
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader, STEPControl_StepModelType, STEPControl_Writer
from OCP.TopoDS import TopoDS

from stiffscope.cad.kernel import Shape, Solid, compound


def read_step(path: Path) -> Shape:
    """Return the content of a STEP file as one shape, in mm; an empty compound when nothing can be read."""
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone and reader.TransferRoots():
        shape = reader.OneShape()
        if shape is not None and not shape.IsNull():
            return shape
    return compound()


def write_step(shape: Shape, path: Path) -> None:
    """Write a STEP file, in mm; OSError when it cannot be written."""
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise OSError(f"{path}: cannot be written")


def read_binary(path: Path) -> Solid:
    """Return the solid that `write_binary` wrote."""
    shape = Shape()
    BinTools.Read_s(shape, str(path))
    return TopoDS.Solid(shape)


def write_binary(shape: Shape, path: Path) -> None:
    """Write a shape exactly, for another process."""
    BRepTools.Clean_s(shape)
    BinTools.Write_s(shape, str(path))
