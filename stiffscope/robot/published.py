"""The numbers that the paper prints, read from `data/published/`."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any

from stiffscope.data import FOLDER

if TYPE_CHECKING:
    import numpy as np


def published(name: str) -> dict[str, Any]:
    """Content of `data/published/<name>.toml` as it stands there (numbers in multiples of its `unit`)."""
    with (FOLDER / "published" / f"{name}.toml").open("rb") as stream:
        return tomllib.load(stream)


def slider_compliance() -> np.ndarray:
    """Eq. (29): the slider's compliance at A_i in axes {O}, (6, 6), SI."""
    import numpy as np

    content = published("slider")
    return np.array(content["compliance"]) * content["unit"]
