"""Labelled results: as an xarray dataset, and as a pandas table with a row per pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from stiffscope.runtime.brief import describe_briefly
from stiffscope.runtime.formats import to_dataframe
from stiffscope.vjm.model.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd  # pyright: ignore[reportMissingTypeStubs]
    import xarray as xr

    from stiffscope.vjm.kinematics.configurations import Configurations

POSE = "pose"
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
Variables: TypeAlias = "Mapping[str, tuple[Sequence[str], Any, str]]"
"""Dimensions, values and unit of each variable; "m, rad" for a twist's or wrench's two units."""


class Labelled(ABC):
    """A result at n poses with labelled axes and a short summary."""

    __repr__ = describe_briefly

    @abstractmethod
    def to_xarray(self) -> xr.Dataset:
        """Return values labelled by pose, twist (x y z rx ry rz) and wrench, with units."""

    def to_pandas(self) -> pd.DataFrame:
        """Return a row per pose and a column per labelled number, e.g. `stiffness_fx_x`."""
        dataset: Any = self.to_xarray()
        columns: dict[str, Any] = {
            name: each.to_numpy()
            for name, each in dataset.coords.items()
            if each.dims == (POSE,)
        }
        for name, values in dataset.data_vars.items():
            rest = [dim for dim in values.dims if dim != POSE]
            flat = values.transpose(POSE, *rest).to_numpy()
            labels = [dataset[dim].to_numpy().astype(str) for dim in rest]
            for place in np.ndindex(flat.shape[1:]):
                words = [each[k] for each, k in zip(labels, place, strict=True)]
                columns["_".join([name, *words])] = flat[(slice(None), *place)]
        return to_dataframe(columns)


def make_dataset(
    configurations: Configurations, variables: Variables, **names: Sequence[Any]
) -> xr.Dataset:
    """Return results at configurations as a dataset.

    Parameters
    ----------
    configurations
        Configurations at the n poses.
    variables
        Dimensions, values and unit of each variable.
    names
        Labels along dimensions other than pose, twist and wrench.
    """
    import xarray as xr

    pose = configurations.mechanism.tool.pose
    places = {
        name: (
            POSE,
            configurations.poses[:, k],
            {"units": "rad" if name.startswith("r") else "m"},
        )
        for k, name in enumerate(pose)
    }
    axes = {"twist": COORDINATES, "wrench": WRENCH, **names}
    used = {dim for dims, _, _ in variables.values() for dim in dims}
    given = variables.items()
    data = {
        k: (tuple(dims), np.asarray(v), {"units": unit}) for k, (dims, v, unit) in given
    }
    labels = places | {dim: list(each) for dim, each in axes.items() if dim in used}
    return xr.Dataset(data, labels, {"axes": "base axes, at M", "source": "stiffscope"})
