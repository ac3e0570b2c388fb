"""What imported robots register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=20,
    commands=(
        Command(
            "import",
            "stiffscope.imports.command",
            "Files",
            "Convert a URDF or MJCF model, or a STEP assembly, to a robot file.",
        ),
    ),
    doubts="stiffscope.imports.import_record:find_doubts",
)
