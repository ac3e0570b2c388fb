"""Effects on instruments: the one at M and each sensor."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Effect, Place, Setting

INSTRUMENT = "instrument"
"""The instrument at M, or all sensors if nothing is read at M."""
TRANSLATION = "translation"
ROTATION = "rotation"
"""Its parts that read displacements and rotations."""


@dataclass(frozen=True)
class InstrumentEffect(Effect):
    """An effect on the readings of one instrument."""

    instrument: str

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the instrument at M, or all sensors together, and at each sensor."""
        together = (
            [INSTRUMENT] if setting.tool_is_read or len(setting.sensors) > 1 else []
        )
        for name in (
            *together,
            *(sensor for sensor, moves in setting.sensors.items() if moves),
        ):
            yield cls(name).make_candidate(Place(name), component=name)
