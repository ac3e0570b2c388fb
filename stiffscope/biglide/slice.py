"""What the published model registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=90,
    commands=(
        Command(
            "audit",
            "stiffscope.biglide.command",
            "A machine",
            "Recompute the paper's numbers, each with a verdict.",
        ),
    ),
)
