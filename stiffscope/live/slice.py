"""What the live page registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=90,
    commands=(
        Command(
            "live",
            "stiffscope.live.command",
            "A robot",
            "Open a page with the turning robot and a slider for every value, pose and load.",
        ),
    ),
)
