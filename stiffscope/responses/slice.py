"""What measured responses register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=30,
    commands=(
        Command(
            "responses",
            "stiffscope.responses.command",
            "A machine",
            "Show measured frequency responses: resonances, static stiffness, doubts.",
        ),
    ),
)
