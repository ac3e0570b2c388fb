"""What the error along a path registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    commands=(
        Command(
            "path",
            "stiffscope.path.command",
            "A machine at work",
            "Error of the tool along a path under process forces.",
        ),
    ),
    keys=(("job", "stiffscope.path.job:SECTIONS"),),
)
