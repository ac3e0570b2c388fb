"""What the stability of cuts registers."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=60,
    commands=(
        Command(
            "lobes",
            "stiffscope.lobes.command",
            "A machine at work",
            "Depths of cut that stay stable over the spindle's speed, along a path.",
        ),
    ),
    keys=(("job", "stiffscope.lobes.model:SECTIONS"),),
    sections=(("job", "lobes", "stiffscope.lobes.model:LobesSection"),),
)
