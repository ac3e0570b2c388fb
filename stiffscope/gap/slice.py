"""What campaigns and their diagnosis register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    rank=10,
    commands=(
        Command(
            "diagnose",
            "stiffscope.gap.command",
            "A machine",
            "Find the effects that explain the gap between model and measurements.",
        ),
        Command(
            "campaign",
            "stiffscope.gap.command",
            "A machine",
            "Create or check a campaign of measurements.",
        ),
    ),
    keys=(("campaign", "stiffscope.gap.campaign.campaign_header:SECTIONS"),),
    changes=(("effects", "stiffscope.gap.effects.vocabulary:apply_effects"),),
)
