"""Keys of a study's file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import field_validator

from stiffscope.robot.file.values import Reads, Says, Section, parse_whole

Method = Literal["grid", "latin-hypercube", "sobol", "optimum", "pareto"]
DESIGNS = {"latin-hypercube": 64, "sobol": 64, "optimum": 120, "pareto": 400}
MOST_DESIGNS = 1_000_000
RANGE = 'a range such as ["15 mm", "40 mm"]'


def _list_texts(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _read_count(value: Any) -> int:
    if not 1 <= parse_whole(value) <= MOST_DESIGNS:
        raise ValueError(f"expected 1 to {MOST_DESIGNS}, got {value}")
    return parse_whole(value)


Texts = Annotated[tuple[str, ...], Reads(_list_texts, says="texts in a list")]
Number = Annotated[int, Reads(_read_count, says="a whole number above 0")]


class StudySection(Section):
    """The top level of the file. `minimize` and `maximize` name responses; a sweep needs neither."""

    robot: Annotated[str, Says("a robot file, seen from the study's folder, or the name of a bundled robot")]
    components: Literal["fea", "beam", "published"] | None = None
    set: Texts = ()
    tolerance: Annotated[str | None, Says("error bar of the parts' matrices, as `--tolerance` takes it")] = None
    method: Method
    designs: Annotated[int | None, Reads(lambda value: value and _read_count(value), says="how many at most")] = None
    seed: Annotated[int, Reads(parse_whole, says="a whole number")] = 1
    parameters: Annotated[dict[str, Any], Says('a table such as "slider.thickness" = ["15 mm", "40 mm"]')]
    responses: Annotated[dict[str, Any], Says('a table such as stiffness = "K_tx"')]
    constraints: Annotated[Texts, Says('texts such as "mass <= 3 kg"')] = ()
    minimize: Texts = ()
    maximize: Texts = ()


class RangeSection(Section):
    """A parameter as a table: a range with its number of grid points, or a list of values."""

    range: Annotated[list[Any] | None, Says(RANGE)] = None
    steps: Number = 5
    values: Annotated[list[Any] | None, Says('values such as [0, 2, 4] or ["steel", "titanium"]')] = None

    @field_validator("values")
    @classmethod
    def _some(cls, value: list[Any] | None) -> list[Any] | None:
        if value is not None and not value:
            raise ValueError("expected one value at least, got []")
        return value


class ResponseSection(Section):
    """A response as a table; a text alone is its `of`, with the worst value over the named poses."""

    of: Annotated[str, Says('an expression over quantities such as "K_tx" or "K_tx/mass"')]
    at: Annotated[Any, Says('poses by name or numbers in a list, or "map": a grid of the robot file\'s [map]')] = None
    points: Annotated[Number, Says("points of that grid along either coordinate")] = 5
    path: Annotated[str | None, Says("a job of `stiffscope path`; `of`: error, normal, along, binormal")] = None
    take: Literal["least", "greatest", "mean", "worst", "rms"] | None = None
    unit: Annotated[str | None, Says('SI unit, for expressions of several quantities: "N/m/kg"')] = None


SECTIONS = (
    ("the top level", StudySection),
    ("[parameters], NAME.KEY = a range, or a table", RangeSection),
    ("[responses], NAME = an expression, or a table", ResponseSection),
)
