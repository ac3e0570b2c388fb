"""Effects of instruments: the one at M, and each sensor."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Effect, Place, Setting

INSTRUMENT = "instrument"
"""The instrument at M; all sensors where nothing is read there."""
TRANSLATION, ROTATION = "translation", "rotation"
"""What of it reads displacements, and what reads rotations."""


@dataclass(frozen=True)
class InstrumentEffect(Effect):
    """An effect on what one instrument shows."""

    instrument: str

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At the instrument at M, or all sensors together, and at each sensor that reads displacements."""
        together = [INSTRUMENT] if setting.tool_is_read or len(setting.sensors) > 1 else []
        for name in (*together, *(sensor for sensor, moves in setting.sensors.items() if moves)):
            yield cls(name).make_candidate(Place(name), component=name)
