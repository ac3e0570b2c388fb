"""What studies and sensitivities register."""

from stiffscope.registry import Command, Slice

SLICE = Slice(
    commands=(
        Command(
            "sensitivity",
            "stiffscope.design.command",
            "A design",
            "Rank the parameters by their effect on the stiffness.",
        ),
        Command(
            "study",
            "stiffscope.design.command",
            "A design",
            "Evaluate many designs: a sweep, an optimum under constraints, a Pareto front.",
        ),
    ),
    keys=(("study", "stiffscope.design.study_reading:SECTIONS"),),
)
