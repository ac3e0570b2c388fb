"""What the stiffness of a robot registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=10,
    commands=(
        Command(
            "run",
            "stiffscope.statics.command.run",
            "A robot",
            "From CAD to report: parts, robot, tables, pictures.",
        ),
        Command(
            "check",
            "stiffscope.statics.command.check",
            "A robot",
            "Report what a robot file describes, without virtual experiments.",
        ),
        Command(
            "stiffness",
            "stiffscope.statics.command.poses",
            "A robot",
            "6x6 stiffness and sag of the robot at tool poses.",
        ),
        Command(
            "deflection",
            "stiffscope.statics.command.poses",
            "A robot",
            "Deflection of the tool under a wrench, and each element's share of it.",
        ),
        Command(
            "map",
            "stiffscope.statics.command.map",
            "A robot",
            "Stiffness over the workspace: figures, numbers, a report.",
        ),
    ),
    pictures="stiffscope.statics.show.maps:order_map",
)
