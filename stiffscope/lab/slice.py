"""What the virtual laboratory registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=20,
    commands=(
        Command(
            "blind",
            "stiffscope.lab.command",
            "A machine",
            "Test the diagnosis on campaigns whose effects are withheld.",
        ),
    ),
)
