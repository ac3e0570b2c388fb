"""What the exports of a robot register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=30,
    commands=(
        Command(
            "export",
            "stiffscope.exports.command",
            "Files",
            "Write a robot for another program, such as MuJoCo.",
        ),
    ),
)
