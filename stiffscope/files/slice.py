"""What bundled robots, keys and the cache register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=10,
    commands=(
        Command(
            "robots", "stiffscope.files.command", "Files", "List the bundled robots."
        ),
        Command(
            "new",
            "stiffscope.files.command",
            "Files",
            "Copy a bundled robot to start from: stiffscope new delta mine.toml.",
        ),
        Command(
            "keys",
            "stiffscope.files.command",
            "Files",
            "List every key of a robot file, study, job or campaign, with its meaning.",
        ),
        Command(
            "cache",
            "stiffscope.files.store",
            "Files",
            "Show, list or clear the results of earlier runs.",
        ),
    ),
)
