"""Adoption of diagnosed effects in a robot file, with their provenance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import tomlkit

from stiffscope.errors import InputError, naming, require_given
from stiffscope.experiments.robot_files import robot_document
from stiffscope.gap.effects.drives import ActuatorStiffness, Backlash
from stiffscope.gap.effects.effect import UNNAMED
from stiffscope.gap.effects.masses import WHOLE, Gravity, Mass
from stiffscope.gap.effects.vocabulary import apply_effect, find_kind
from stiffscope.gap.inference.diagnosis import Adoptable, Parameter
from stiffscope.runtime import output

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from stiffscope.gap.inference.diagnosis import Diagnosis, Effect
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.nominal import NominalRobot

_LEAST_TOGETHER = 2  # effects on drives that may share one


def check_target(target: Path, robot: RobotFile | None) -> None:
    """Raise InputError early if the target cannot be written or there is no robot."""
    require_given(
        robot, "--adopt", "a campaign with a robot", "predictions instead of one"
    )
    with naming("--adopt"):
        output.check_new(target)


def adopt(
    target: Path,
    robot: RobotFile,
    bare: NominalRobot,
    diagnosis: Diagnosis,
    *,
    campaign: str,
    components: str | None,
    modelled: Sequence[str] = (),
) -> None:
    """Write a robot file with all effects of which a diagnosis is certain.

    Their values are those of a fit without what is left out.

    Parameters
    ----------
    target
        The file to write.
    robot, bare
        The robot file used for the diagnosis, and the elastic robot built from it.
    diagnosis
        The diagnosis.
    campaign
        Name of the campaign, for the provenance.
    components
        Source of the parts' matrices stated by the campaign, to be written; None: as in the robot file.
    modelled
        Effects already in the model, as stated by the campaign.

    Raises
    ------
    InputError
        The verdict is neither "identified" nor "partly", or the file cannot contain all effects.
    """
    if diagnosis.verdict not in {"identified", "partly"}:  # whose effects are certain
        verdict = f"the verdict is {diagnosis.verdict}, not identified"
        raise InputError(f"--adopt: nothing is adopted: {verdict}")
    sure = what_is_sure(diagnosis)
    found = sure.effects
    heavy = Gravity.word in {*modelled, *(e.effect for e in found)} or robot.carries(
        Gravity.word
    )
    left = list(_refusals(bare, found, heavy=heavy))
    if left:
        raise InputError(f"--adopt: nothing is adopted: {'; '.join(left)}")
    document = robot_document(robot, target, components)
    multiplied = _multiply_out(sure)
    entries = [_entry(effect, diagnosis, campaign) for effect in multiplied]
    output.write_new(target, _text(document, entries).encode())


def what_is_sure(diagnosis: Diagnosis) -> Adoptable:
    """Return what a robot file may take over; of a diagnosis without a search, all named effects."""
    if diagnosis.adoptable is not None:
        return diagnosis.adoptable
    return Adoptable(diagnosis.effects, diagnosis.drives)


def name_of(effect: Effect) -> str:
    """Return `effect @ place`."""
    return f"{effect.effect} @ {effect.place}"


def _multiply_out(sure: Adoptable) -> list[Effect]:
    """Return effects with each drive's resulting factor where a set and a member both soften it."""
    found = sure.effects
    soft = [e for e in found if e.effect == ActuatorStiffness.word]
    changed = {
        name: drive
        for name, drive in sure.drives.items()
        if drive.seen and drive.value != drive.stated
    }
    if len(soft) < _LEAST_TOGETHER or not changed:
        return list(found)
    out = [e for e in found if e not in soft]
    for name, drive in changed.items():
        factor = Parameter(drive.value / drive.stated, drive.sigma / drive.stated, "1")
        own = {"place": name, "parameters": {"factor": factor}, "errors": {}}
        out.append(replace(soft[0], **own))
    return out


def _refusals(
    bare: NominalRobot, found: Sequence[Effect], *, heavy: bool
) -> Iterator[str]:
    """Yield reasons why effects cannot be adopted. heavy: whether the robot's weight will act."""
    for effect in found:
        if effect.effect == UNNAMED:
            yield f"{effect.place}: fitted together with the effects, but not a known effect"
            continue
        if effect.effect == Mass.word and effect.place == WHOLE:
            heavier = (e for e in found if e is not effect and e.effect != UNNAMED)
            names = [name_of(e) for e in heavier if find_kind(e.effect).weighs]
            if names:
                listed = ", ".join(names)
                yield f"{name_of(effect)}: beside {listed}, which springs do not carry"
                continue
        if find_kind(effect.effect).weighs and not heavy:
            yield f"{name_of(effect)}: masses count only where gravity is modelled"
            continue
        if effect.effect == Backlash.word and len(effect.parameters) > 1:
            yield f"{name_of(effect)}: drives of a robot file start in the middle of their gap"
            continue
        strange = [n for n, p in effect.parameters.items() if not p.plausible]
        if strange:
            yield f"{name_of(effect)}: {', '.join(strange)} is not plausible"
            continue
        try:
            apply_effect(bare, effect.effect, effect.place, _values(effect))
        except InputError as error:
            yield str(error)


def _values(effect: Effect) -> dict[str, float]:
    """Return the parameters of an effect for a file: individual errors if there are many."""
    return {name: p.value for name, p in (effect.errors or effect.parameters).items()}


def _text(document: Any, entries: list[dict[str, Any]]) -> str:
    former: list[dict[str, Any]] = (
        document.pop("effects").unwrap() if "effects" in document else []
    )
    if not former:
        document.add(tomlkit.nl())
    effects: Any = tomlkit.aot()
    document["effects"] = effects
    for entry in [*former, *entries]:
        table: Any = tomlkit.table()
        for key, value in entry.items():
            table.add(key, _inline(value) if isinstance(value, dict) else value)
        effects.append(table)
    return tomlkit.dumps(document)


def _entry(effect: Effect, diagnosis: Diagnosis, campaign: str) -> dict[str, Any]:
    gap = diagnosis.gap
    provenance: dict[str, Any] = {
        "campaign": campaign,
        "probability": _round(effect.probability),
        "confused_with": list(effect.confused_with),
        "gap_before": _round(gap.nominal),
        "gap_after": _round(gap.explained),
        "gap_noise": _round(gap.noise),
        "unit": "% rms",
        "sigma": {
            name: _round(p.sigma)
            for name, p in effect.parameters.items()
            if math.isfinite(p.sigma)
        },
    }
    if math.isfinite(gap.held_out):
        provenance["gap_held_out"] = _round(gap.held_out)
    return {
        "effect": effect.effect,
        "place": effect.place,
        "parameters": _values(effect),
        "provenance": provenance,
    }


def _round(value: float) -> float:
    return float(f"{value:.4g}")


def _inline(values: Any) -> Any:
    table: Any = tomlkit.inline_table()
    table.update(values)
    return table
