"""Registry of the effects, and their application to robots.

Every class of this package that defines `word` is an effect. The robot file determines where an
effect may act: its elements, groups and parts.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import stiffscope.gap.effects
from stiffscope.errors import InputError, require
from stiffscope.gap.effects.effect import Effect, Setting
from stiffscope.gap.effects.elements import change_robot
from stiffscope.robot.file.parse import naming_key
from stiffscope.robot.nominal import NominalRobot

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from stiffscope.gap.effects.effect import Candidate
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.model.mechanism import Mechanism


def _find_kinds() -> tuple[type[Effect], ...]:
    """Return the effect classes, sorted by precedence."""
    by_word: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(stiffscope.gap.effects.__path__):
        if module.name != "vocabulary":
            for value in vars(
                importlib.import_module(f"stiffscope.gap.effects.{module.name}")
            ).values():
                if (
                    isinstance(value, type)
                    and issubclass(value, Effect)
                    and "word" in vars(value)
                ):
                    by_word[value.word] = value
    return tuple(sorted(by_word.values(), key=lambda kind: kind.precedence))


KINDS = _find_kinds()
_KIND_OF = {word: kind for kind in KINDS for word in (kind.word, *kind.also)}
EFFECTS = {
    word: tuple((p.name, p.unit) for p in k.parameters) for word, k in _KIND_OF.items()
}
"""Parameters of every effect, as pairs (name, SI unit)."""


def find_kind(effect: str) -> type[Effect]:
    """Return the class of an effect by any of its names."""
    return _KIND_OF[effect]


def word_of(name: str) -> str:
    """Return the primary effect name of an `effect @ place`."""
    effect = name.partition(" @ ")[0]
    return _KIND_OF[effect].word if effect in _KIND_OF else effect


def find_candidates(
    setting: Setting, without: Collection[str] = ()
) -> Iterator[Candidate]:
    """Yield every effect at every place of a robot and its instruments, except excluded effects."""
    for kind in KINDS:
        if kind.word not in without:
            yield from (c for c in kind.candidates(setting) if c.effect not in without)


def apply_effect(
    robot: NominalRobot, effect: str, place: str, parameters: Mapping[str, float]
) -> NominalRobot:
    """Return the robot with an effect added.

    Parameters
    ----------
    robot
        The robot; effects already adopted are kept.
    effect, place, parameters
        As named in `EFFECTS`, SI; omitted parameters keep their nominal values.

    Raises
    ------
    InputError
        For names that are not in the vocabulary, and for an effect that is not part of the robot.
    """
    _check_words(effect, place, parameters)
    reason = _KIND_OF[effect].refusal(robot, place)
    if reason:
        raise InputError(reason)
    if not EFFECTS[effect]:
        return robot
    known = _find_candidate(robot, effect, place, list(parameters))
    names = known.parts or known.names
    require(parameters, f"{effect} @ {place}", f"parameters {', '.join(names)}", "none")
    nominal = np.zeros(len(known.scale))
    nominal = nominal if known.parts else known.physical(nominal)
    values = dict(zip(names, nominal, strict=True)) | dict(parameters)
    influence = known.action.influence(
        known.internal(np.array(list(values.values()), dtype=float))
    )
    return replace(robot, mechanism=change_robot(robot.mechanism, influence))


def _check_words(effect: str, place: str, parameters: Mapping[str, float]) -> None:
    """Raise InputError for a word or a factor that no robot can have."""
    require(effect in EFFECTS, "effect", f"one of {', '.join(EFFECTS)}", f"{effect!r}")
    factor = parameters.get("factor", 1.0)
    require(factor > 0.0, f"{effect} @ {place}, factor", "more than 0", f"{factor:g}")


def _find_candidate(
    robot: NominalRobot, effect: str, place: str, given: list[str]
) -> Candidate:
    """Return the matching effect with the fewest parameters, in terms of the requested name."""
    name = f"{effect} @ {place}"
    known = tuple(find_candidates(Setting(robot)))
    placed = [c for c in known if name in (c.name, *c.aliases)]
    places = dict.fromkeys(c.place for c in known if c.effect == effect)
    require(placed, f"{effect}, place", f"one of {', '.join(places)}", repr(place))
    fitting = [c for c in placed if set(given) <= set(c.parts or c.names)]
    names = ", ".join(placed[0].parts or placed[0].names) or "none"
    require(fitting, effect, f"parameters {names}", ", ".join(given))
    candidate = min(fitting, key=lambda c: len(c.names))
    kind = _KIND_OF[effect]
    if isinstance(candidate.action, kind) or kind.conversion is None:
        return candidate
    return replace(candidate, physical=kind.conversion[0], internal=kind.conversion[1])


def apply_effects(mechanism: Mechanism, robot: RobotFile) -> Mechanism:
    """Return the mechanism with the effects adopted in its file, in order.

    Raises InputError, with the line in the file, for an effect that is not part of the robot.
    """
    nominal = NominalRobot(mechanism, robot)
    for number, each in enumerate(robot.effects):
        with robot.source.refusing(), naming_key("effects", number):
            nominal = apply_effect(nominal, each.effect, each.place, each.parameters)
    return nominal.mechanism


def check_effects(robot: RobotFile) -> None:
    """Raise InputError, with the line in the file, for an adopted effect that no robot can have."""
    for number, each in enumerate(robot.effects):
        with robot.source.refusing(), naming_key("effects", number):
            _check_words(each.effect, each.place, each.parameters)
