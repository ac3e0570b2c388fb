"""All parametric shapes, by the name that a robot file gives them.

A new shape is a subclass of `SolidParameters` that says everything of itself, and a line here.
"""

from stiffscope.cad.beam import (
    BoxParameters,
    ChannelParameters,
    IParameters,
    TubeParameters,
)
from stiffscope.cad.link import LinkParameters
from stiffscope.cad.slider import SliderParameters
from stiffscope.cad.solid import SolidParameters

SHAPES: dict[str, type[SolidParameters]] = {
    made.shape: made
    for made in (
        LinkParameters,
        SliderParameters,
        TubeParameters,
        BoxParameters,
        IParameters,
        ChannelParameters,
    )
}
