"""What experiments on one part register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    commands=(
        Command(
            "compliance",
            "stiffscope.parts.command.compliance",
            "A part",
            "6x6 compliance of a part, with error bars.",
        ),
        Command(
            "compare",
            "stiffscope.parts.command.experiments",
            "A part",
            "Compare two robots or versions, or a robot's parts by FEA, beam theory and published values.",
        ),
        Command(
            "interfaces",
            "stiffscope.parts.command.experiments",
            "A part",
            "Effect of clamping and loading on a part's compliance.",
        ),
        Command(
            "faces",
            "stiffscope.parts.command.experiments",
            "A part",
            "List the faces of a STEP file.",
        ),
        Command(
            "element",
            "stiffscope.parts.command.elements",
            "A part",
            "Stiffness of a bearing, guide or screw from its data sheet.",
        ),
    ),
)
