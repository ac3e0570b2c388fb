"""What vibration registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=20,
    commands=(
        Command(
            "modes",
            "stiffscope.vibration.command",
            "A robot",
            "Natural frequencies and mode shapes of the robot at tool poses.",
        ),
        Command(
            "frf",
            "stiffscope.vibration.command",
            "A robot",
            "Frequency response from a force at one point to the displacement at another.",
        ),
    ),
)
